"""Tuning: how to search a controller's parameters: update rules and the budget."""
