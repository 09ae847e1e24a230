"""Fuzzy sets, rules and inference."""
