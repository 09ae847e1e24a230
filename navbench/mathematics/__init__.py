"""Mathematics: fuzzy inference, geometry, kinematics, metrics, statistics and named random streams."""
