"""Nemeiksis and Osadcuks 2019: a switch unit over fuzzy agents."""
