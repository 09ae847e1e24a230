"""One YAML file a thing: controllers, worlds, robots, sensors, simulators."""
