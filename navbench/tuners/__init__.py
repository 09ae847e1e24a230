"""Tuners: how to search a controller's parameters."""
