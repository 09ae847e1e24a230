"""Engines on many machines: a module each, imported only where it is asked for."""
