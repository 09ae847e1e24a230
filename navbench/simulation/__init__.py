"""Simulation: how bodies move, and what rays and contacts say of them."""
