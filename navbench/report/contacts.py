"""Where a robot touched something when its episode ended, and what that was."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.report.drawing import Thing, corners_of
from navbench.report.drives import named
from navbench.world.layout import DrawnWorld
from navbench.world.shapes import Box, Disc, Point, Polygon

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]


class Touch(NamedTuple):
    """A contact.

    Attributes:
        name: what was hit, by kind and index.
        thing: its outline at that instant.
        place: x, y [m] where the hulls touch.
    """

    name: str
    thing: Thing
    place: tuple[float, float]


def touch_of(
    world: DrawnWorld, row: Mapping[Any, Any], paths: Sequence["pd.DataFrame"], radius_m: float
) -> Touch | None:
    """Return what a robot hit when it ended, or None where it hit nothing.

    Args:
        world: what was driven in.
        row: the robot's row of the table of episodes.
        paths: the trajectories of the episode's robots, by their index.
        radius_m: the robots' radius [m].
    """
    kind, index = str(row["hit"]), int(row["hit_index"])
    if not kind:
        return None
    t_s, *place = paths[row["robot_index"]][["t_s", "x_m", "y_m"]].iloc[-1]
    if kind == "robot":
        other = paths[index]  # which may have ended before, and then stands where it did
        x_m, y_m = (float(np.interp(t_s, other["t_s"], other[name])) for name in ("x_m", "y_m"))
        thing: Thing = Disc(x_m, y_m, radius_m)
    else:
        thing = _standing(world, kind, index, float(t_s))
    return Touch(named(kind, index), thing, nearest_of(thing, *place))


def _standing(world: DrawnWorld, kind: str, index: int, t_s: float) -> Thing:
    """Return the outline of anything but a robot at a time [s]; kinds and indices as of ``records.Thing``."""
    if kind == "mover":
        mover = world.movers[index]
        x_m, y_m = mover.place(t_s)
        if not mover.outline:
            return Disc(x_m, y_m, mover.radius_m)
        return Polygon(corners=tuple(Point(x_m + p.x_m, y_m + p.y_m) for p in mover.outline))
    if kind == "cell" and world.grid is not None:
        row, column = divmod(index, world.grid.width)
        side = world.grid.resolution_m
        return Box(world.grid.x_min_m + (column + 0.5) * side, world.grid.y_min_m + (row + 0.5) * side, side, side)
    things: dict[str, Sequence[Thing]] = {
        "box": world.boxes,
        "wall": world.solids()[len(world.boxes) :],
        "disc": world.discs,
        "polygon": world.polygons,
    }
    return things[kind][index]


def nearest_of(thing: Thing, x_m: float, y_m: float) -> tuple[float, float]:
    """Return the point of an outline that is nearest to a place outside it: x, y [m]."""
    here = np.array([x_m, y_m])
    if isinstance(thing, Disc):
        middle = np.array([thing.x_m, thing.y_m])
        found: FloatArray = middle + thing.radius_m * (here - middle) / np.hypot(*(here - middle))
    else:
        begins = corners_of(thing)
        sides = np.roll(begins, -1, axis=0) - begins
        along = ((here - begins) * sides).sum(axis=1) / (sides**2).sum(axis=1)
        nearest = begins + np.clip(along, 0.0, 1.0)[:, None] * sides
        found = nearest[np.argmin(np.hypot(*(nearest - here).T))]
    return float(found[0]), float(found[1])
