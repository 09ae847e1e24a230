"""Worlds: shapes and movers, layouts of them, and the sources that draw layouts, as frozen data checked when made."""

from navbench.contract import Pose
from navbench.world.layout import DrawnWorld, FinishLine, Layout, Start
from navbench.world.shapes import Bounds, Box, Disc, Mover, Point, Polygon, Wall
from navbench.world.world import NoRoomError, Source, World

__all__ = [
    "Bounds", "Box", "Disc", "DrawnWorld", "FinishLine", "Layout", "Mover", "NoRoomError", "Point", "Polygon", "Pose",
    "Source", "Start", "Wall", "World",
]  # fmt: skip
