"""Physics: how bodies move, and what the simulator says of rays and contacts."""
