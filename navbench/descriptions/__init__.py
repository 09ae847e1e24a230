"""Descriptions: worlds, robots, sensors and records, as frozen data that is checked when it is made."""
