"""Worlds: bounds, shapes, movers and what is drawn anew for each episode, as frozen data checked when made."""
