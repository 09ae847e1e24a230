"""How a layout, a robot and a path are drawn, the same in every picture."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from navbench.world.grid import Grid
from navbench.world.layout import DrawnWorld, Start
from navbench.world.shapes import Box, Disc, Mover, Point, Polygon

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch

FloatArray = NDArray[np.float64]
Thing: TypeAlias = Box | Disc | Polygon

OBSTACLE, MOVER, WALL = "#8d99ae", "#9b7fc9", "#5c677d"
MOVER_EDGE, GOAL = "#5e3f96", "#f4d35e"
MARGIN = 0.04  # around a world, of its longer side
NOWHERE: FloatArray = np.empty((0, 2))


def draw_world(ax: "Axes", world: DrawnWorld, t_s: float | None = None) -> None:
    """Draw a world: bounds, grid, boxes, walls, discs, polygons, movers, goals and the finish line.

    Args:
        ax: where to draw.
        world: what to draw.
        t_s: when [s]: the movers are drawn where they are then; without it, where they begin, and with their paths.
    """
    draw_obstacles(ax, world)
    draw_movers(ax, world, t_s)
    for goal in world.goals:
        draw_goal(ax, goal, world.goal_tolerance_m)
    frame(ax, world)


def draw_movers(ax: "Axes", world: DrawnWorld, t_s: float | None = None) -> None:
    """Draw the movers; arguments as of ``draw_world``."""
    for mover in world.movers:
        points = [*mover.waypoints, mover.waypoints[0]] if mover.cyclic else mover.waypoints
        if t_s is None:
            ax.plot([p.x_m for p in points], [p.y_m for p in points], "--", color=MOVER, linewidth=0.8, zorder=1)
        ax.add_patch(mover_patch(mover, *mover.place(t_s or 0.0), facecolor=MOVER, edgecolor=MOVER_EDGE, alpha=0.8))


def draw_obstacles(ax: "Axes", world: DrawnWorld) -> None:
    """Draw all that stands, and the finish line."""
    if world.grid is not None:
        _draw_grid(ax, world.grid)
    things: tuple[Thing, ...] = (*world.boxes, *world.discs, *world.polygons)
    for thing in things:
        ax.add_patch(patch_of(thing, color=OBSTACLE))
    for wall in world.solids()[len(world.boxes) :]:
        ax.add_patch(patch_of(wall, color=WALL))
    if world.finish_line is not None:
        line = world.finish_line
        ax.plot([line.x1_m, line.x2_m], [line.y1_m, line.y2_m], ":", color="black", zorder=3)


def _draw_grid(ax: "Axes", grid: Grid) -> None:
    """Draw the occupied cells, as one outline however many there are."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    x, y, half_length, half_width, *_ = grid.rectangles().T
    corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)]
    points = np.stack([(x + i * half_length, y + j * half_width) for i, j in corners], axis=1)
    codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY] * len(x)
    ax.add_patch(PathPatch(Path(points.T.reshape(-1, 2), codes), color=WALL, linewidth=0.3, zorder=2))


def draw_goal(ax: "Axes", goal: Point, tolerance_m: float, color: str = "black") -> None:
    """Draw a goal: the disc in which a robot has reached it, and its middle."""
    ax.add_patch(_circle(goal.x_m, goal.y_m, tolerance_m, color=GOAL, alpha=0.9))
    ax.plot(goal.x_m, goal.y_m, "x", color=color, markersize=7, zorder=5)


def draw_pair(ax: "Axes", start: Start, goal: Point, color: str) -> None:
    """Join a start with its goal."""
    ax.plot([start.x_m, goal.x_m], [start.y_m, goal.y_m], ":", color=color, linewidth=0.9, zorder=3)


def frame(ax: "Axes", world: DrawnWorld, paths: FloatArray = NOWHERE) -> None:
    """Set the limits of a picture to a world's bounds and to the paths (n, 2) [m] that lead out of them, and its axes.

    A margin of 4 % of the longer side is left around.
    """
    b = world.bounds
    points = np.concatenate([[(b.x_min_m, b.y_min_m), (b.x_max_m, b.y_max_m)], paths])
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    margin = MARGIN * max(right - left, top - bottom)
    ax.set(xlim=(left - margin, right + margin), ylim=(bottom - margin, top + margin))
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")


def patch_of(thing: Thing, **style: Any) -> "Patch":
    """Return the outline of something that stands, drawn in a style."""
    from matplotlib import patches

    if isinstance(thing, Disc):
        return _circle(thing.x_m, thing.y_m, thing.radius_m, **{"zorder": 2, **style})
    return patches.Polygon(corners_of(thing), **{"zorder": 2, **style})


def mover_patch(mover: Mover, x_m: float, y_m: float, **style: Any) -> "Patch":
    """Return the outline of a mover at a place [m], drawn in a style."""
    from matplotlib import patches

    if mover.outline:
        return patches.Polygon([(x_m + p.x_m, y_m + p.y_m) for p in mover.outline], **{"zorder": 3, **style})
    return _circle(x_m, y_m, mover.radius_m, **style)


def draw_circle(ax: "Axes", x_m: float, y_m: float, radius_m: float, color: str = "black") -> None:
    """Draw a robot's hull, such as where it begins."""
    ax.add_patch(_circle(x_m, y_m, radius_m, fill=False, color=color, zorder=6))


def draw_robot(ax: "Axes", pose: Sequence[float], radius_m: float, color: str, tip_m: float = 0.0) -> None:
    """Draw a robot's hull and its heading as an arrow.

    Args:
        ax: where to draw.
        pose: x, y [m] and heading [rad].
        radius_m: of the hull [m].
        color: of the hull.
        tip_m: how far from the centre the arrow's tip is [m], at least 1.5 radii.
    """
    x, y, heading_rad = pose
    draw_circle(ax, x, y, radius_m, color)
    reach = max(1.5 * radius_m, tip_m)
    tip = x + reach * math.cos(heading_rad), y + reach * math.sin(heading_rad)
    arrow = {"arrowstyle": "-|>", "color": "black", "linewidth": 1.0, "shrinkA": 0.0, "shrinkB": 0.0}
    ax.annotate("", tip, (x, y), arrowprops={**arrow, "mutation_scale": 7.0}, zorder=7)


def corners_of(thing: Box | Polygon) -> FloatArray:
    """Return the corners of what stands: (n, 2) x, y [m]."""
    if isinstance(thing, Polygon):
        return np.array([(p.x_m, p.y_m) for p in thing.corners])
    half = 0.5 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (thing.length_m, thing.width_m)
    cosine, sine = np.cos(thing.heading_rad), np.sin(thing.heading_rad)
    corners: FloatArray = half @ np.array([[cosine, sine], [-sine, cosine]]) + (thing.x_m, thing.y_m)
    return corners


def _circle(x_m: float, y_m: float, radius_m: float, **style: Any) -> "Patch":
    from matplotlib.patches import Circle

    return Circle((x_m, y_m), radius_m, **{"zorder": 3, **style})


def thinned(points: FloatArray, tolerance_m: float) -> FloatArray:
    """Return a polyline with fewer points that strays from it by no more than a tolerance, after Douglas and Peucker.

    Args:
        points: (n, 2) x, y [m], n >= 1.
        tolerance_m: the largest distance of a dropped point from its chord [m].
    """
    kept = np.zeros(len(points), dtype=bool)
    kept[[0, -1]] = True
    spans = [(0, len(points) - 1)]
    while spans:
        begin, end = spans.pop()
        chord, inner = points[end] - points[begin], points[begin + 1 : end] - points[begin]
        if not len(inner):
            continue
        length2 = float(chord @ chord)
        along = np.clip(inner @ chord / length2, 0.0, 1.0) if length2 > 0.0 else np.zeros(len(inner))
        away = np.hypot(*(inner - along[:, None] * chord).T)
        farthest = int(np.argmax(away))
        if away[farthest] > tolerance_m:
            middle = begin + 1 + farthest
            kept[middle] = True
            spans += [(begin, middle), (middle, end)]
    return points[kept]


def sparse(points: FloatArray, width_m: float) -> FloatArray:
    """Return a path (n, 2) without what lies in the same square, so wide [m], as the point before, but with its end."""
    moved = np.flatnonzero(np.diff(np.floor(points / width_m), axis=0).any(axis=1))
    kept: FloatArray = points[np.unique([0, *(moved + 1), len(points) - 1])]
    return kept
