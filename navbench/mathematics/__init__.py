"""Mathematics: geometry, kinematics, metrics, statistics and named random streams."""
