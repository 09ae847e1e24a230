"""A layout: one drawn instance of a world, with everything that stands and moves, and each robot's start and goal."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import fields, replace
from functools import cache, cached_property
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from navbench.mathematics.geometry import distance_to_nearest, segment_crossing
from navbench.validation import STRICT, DescriptionError, Number, Positive
from navbench.world.grid import NO_GRID, Grid, nearest_cell
from navbench.world.shapes import (
    Bounds,
    Box,
    Disc,
    Mover,
    Point,
    Polygon,
    Wall,
    mover_tables,
    place_movers,
    polygon_table,
)

FloatArray = NDArray[np.float64]

GOAL_BEYOND_LINE_M = 1.0  # a goal behind a finish line is a direction to drive in, so it must not stop the robot early


class ImpossibleError(DescriptionError):
    """A task that no controller can do: it is not run, and is no failure of any."""


@dataclass(frozen=True, slots=True, config=STRICT)
class Start:
    """Where a robot begins [m, rad]; without a heading it looks at its goal."""

    x_m: Number
    y_m: Number
    heading_rad: Number | None = None


@dataclass(frozen=True, slots=True, config=STRICT)
class FinishLine:
    """A line to cross, between two points [m]: where a world has one, arrival is crossing it."""

    x1_m: Number
    y1_m: Number
    x2_m: Number
    y2_m: Number


def _start(value: Any) -> Any:
    return Start(*value) if isinstance(value, tuple) else value


def _point(value: Any) -> Any:
    return Point(*value) if isinstance(value, tuple) else value


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Layout:
    """One drawn instance of a world, for the robots' size that it was drawn for; it is never scaled.

    A layout is itself a source of layouts: one that always draws itself.

    Attributes:
        bounds: the rectangle that holds every centre.
        boxes: rectangular obstacles.
        discs: round obstacles.
        polygons: convex obstacles.
        walls: straight walls.
        movers: moving discs and polygons.
        starts: one a robot; a ``Pose`` or a tuple of x and y [m] will do.
        goals: one a robot; a tuple of x and y [m] will do.
        finish_line: where there is one, arrival is crossing it, and the goals lie at least 1 m beyond.
        grid: an occupancy grid.

    Raises:
        DescriptionError: starts and goals do not match, or something lies outside the bounds or inside an obstacle.
    """

    bounds: Bounds
    boxes: tuple[Box, ...] = ()
    discs: tuple[Disc, ...] = ()
    polygons: tuple[Polygon, ...] = ()
    walls: tuple[Wall, ...] = ()
    movers: tuple[Mover, ...] = ()
    starts: tuple[Annotated[Start, BeforeValidator(_start)], ...] = ()
    goals: tuple[Annotated[Point, BeforeValidator(_point)], ...] = ()
    finish_line: FinishLine | None = None
    grid: Grid | None = None

    def __post_init__(self) -> None:
        """Check what no single value shows: counts, bounds, goals inside obstacles, the finish line."""
        if not self.starts or len(self.starts) != len(self.goals):
            raise DescriptionError(
                f"goals: must be as many as starts, and at least one; got {len(self.goals)} for {len(self.starts)}"
            )
        b = self.bounds
        inside = f"inside the bounds x [{b.x_min_m}, {b.x_max_m}], y [{b.y_min_m}, {b.y_max_m}]"
        centres: dict[str, tuple[Start | Point | Box | Disc, ...]] = {
            "starts": self.starts,
            "goals": self.goals,
            "boxes": self.boxes,
            "discs": self.discs,
        }
        for key, things in centres.items():
            for i, centre in enumerate(things):
                if not b.hold(centre.x_m, centre.y_m):
                    raise DescriptionError(f"{key}[{i}]: ({centre.x_m}, {centre.y_m}) must lie {inside}")
        for i, polygon in enumerate(self.polygons):
            if not all(b.hold(corner.x_m, corner.y_m) for corner in polygon.corners):
                raise DescriptionError(f"polygons[{i}]: must lie {inside}")
        obstacles = self.box_rows(), self.disc_rows(), self.polygon_rows()
        for i, goal in enumerate(self.goals):
            if self._away(goal, *obstacles) < 0.0:
                raise DescriptionError(f"goals[{i}]: ({goal.x_m}, {goal.y_m}) must lie outside every obstacle")
        if self.finish_line is not None:
            self._check_finish_line(self.finish_line)

    def _check_finish_line(self, line: FinishLine) -> None:
        ends = np.array([line.x1_m, line.y1_m, line.x2_m, line.y2_m])
        length = math.hypot(line.x2_m - line.x1_m, line.y2_m - line.y1_m)
        if length == 0.0:
            raise DescriptionError("finish_line: its two ends must be different points")
        for i, (start, goal) in enumerate(zip(self.starts, self.goals, strict=True)):
            beyond = abs((line.x2_m - line.x1_m) * (goal.y_m - line.y1_m) -
                         (line.y2_m - line.y1_m) * (goal.x_m - line.x1_m)) / length  # fmt: skip
            if segment_crossing(start.x_m, start.y_m, goal.x_m, goal.y_m, ends) < 0.0 or beyond < GOAL_BEYOND_LINE_M:
                raise DescriptionError(
                    f"goals[{i}]: must lie at least {GOAL_BEYOND_LINE_M:g} m beyond the finish line, seen from "
                    f"starts[{i}]; it lies {round(beyond, 6):g} m from it"
                )

    def draw(self, rng: np.random.Generator, episode: int) -> "Layout":
        """Return itself, whatever the episode."""
        return self

    def check_fits(self, radius_m: float, goal_tolerance_m: float) -> None:
        """Check that every robot stands free at its start and can come near enough to its goal.

        Args:
            radius_m: every robot's hull [m].
            goal_tolerance_m: how near to its goal a robot's centre must come [m].

        Raises:
            ImpossibleError: a start lies too near to an obstacle or to another start, or a goal to an obstacle.
        """
        obstacles = self.box_rows(), self.disc_rows(), self.polygon_rows()
        for i, start in enumerate(self.starts):
            place = f"starts[{i}]: ({start.x_m}, {start.y_m}) must lie further than"
            if self._away(start, *obstacles) <= radius_m:
                raise ImpossibleError(f"{place} the robot's radius {radius_m} m from an obstacle")
            if any(math.hypot(start.x_m - o.x_m, start.y_m - o.y_m) <= 2.0 * radius_m for o in self.starts[:i]):
                raise ImpossibleError(f"{place} two radii of the robot, {2.0 * radius_m} m, from another start")
        if self.finish_line is not None:
            return
        still = obstacles[0], obstacles[1][: len(self.discs)], obstacles[2][: len(self.polygons)]
        for i, goal in enumerate(self.goals):
            away = self._away(goal, *still)
            if away + goal_tolerance_m < radius_m:
                raise ImpossibleError(
                    f"goals[{i}]: ({goal.x_m}, {goal.y_m}) lies {round(away, 6):g} m from an obstacle, where a robot "
                    f"of radius {radius_m} m cannot come nearer to it than goal_tolerance_m={goal_tolerance_m}"
                )

    def _away(self, place: Start | Point, boxes: FloatArray, discs: FloatArray, polygons: FloatArray) -> float:
        """Return the signed distance from a place to the nearest of these obstacles or of the grid's cells [m]."""
        nearest: float = distance_to_nearest(place.x_m, place.y_m, boxes, discs, polygons)
        cells = NO_GRID if self.grid is None else self.grid.arrays()
        return min(nearest, nearest_cell(place.x_m, place.y_m, *cells))

    def start_heading_rad(self, index: int) -> float:
        """Return a start's heading [rad]: its own, or the direction of its goal."""
        start, goal = self.starts[index], self.goals[index]
        if start.heading_rad is not None:
            return start.heading_rad
        return math.atan2(goal.y_m - start.y_m, goal.x_m - start.x_m)

    def solids(self) -> tuple[Box, ...]:
        """Return everything rectangular: the boxes, then the walls as boxes."""
        return (*self.boxes, *(Box(*_along(wall, wall.thickness_m)) for wall in self.walls))

    def box_rows(self) -> FloatArray:
        """Return boxes and walls as (n, 6) rows: centre x, y, half length, half width, cos and sin of the heading."""
        return _box_rows([*self.boxes, *(_along(wall, wall.thickness_m) for wall in self.walls)])

    def finish_line_row(self) -> FloatArray:
        """Return the finish line as a box without width, (1, 6), or (0, 6) where there is none."""
        return _box_rows([] if self.finish_line is None else [_along(self.finish_line, 0.0)])

    def disc_rows(self, t_s: float = 0.0) -> FloatArray:
        """Return discs, then round movers at a time [s], as (n, 5) rows: x, y, radius [m], vx, vy [m/s]."""
        rows = self._discs.copy()
        place_movers(t_s, *self.round_tables, rows)
        return rows

    def polygon_rows(self, t_s: float = 0.0) -> FloatArray:
        """Return polygons, then outlined movers at a time [s], as rows of ``polygon_table``."""
        rows = self._polygons.copy()
        place_movers(t_s, *self.outlined_tables, rows)
        return rows

    @cached_property
    def round_tables(self) -> tuple[FloatArray, FloatArray]:
        """``mover_tables`` of the movers that are discs, not to be changed."""
        return mover_tables(self.round_movers())

    @cached_property
    def outlined_tables(self) -> tuple[FloatArray, FloatArray]:
        """``mover_tables`` of the movers that are polygons, not to be changed."""
        return mover_tables(self.outlined_movers())

    @cached_property
    def _discs(self) -> FloatArray:
        still = [(disc.x_m, disc.y_m, disc.radius_m, 0.0, 0.0) for disc in self.discs]
        moving = [(0.0, 0.0, mover.radius_m, 0.0, 0.0) for mover in self.round_movers()]
        return np.array(still + moving).reshape(-1, 5)

    @cached_property
    def _polygons(self) -> FloatArray:
        still = []
        for polygon in self.polygons:
            xs, ys = [p.x_m for p in polygon.corners], [p.y_m for p in polygon.corners]
            x, y = sum(xs) / len(xs), sum(ys) / len(ys)
            around = [Point(x_m=p.x_m - x, y_m=p.y_m - y) for p in polygon.corners]
            still.append((x, y, max(math.hypot(p.x_m, p.y_m) for p in around), around))
        moving = [(0.0, 0.0, mover.radius_m, mover.outline) for mover in self.outlined_movers()]
        return polygon_table([*still, *moving])

    def round_movers(self) -> tuple[Mover, ...]:
        """Return the movers that are discs."""
        return tuple(mover for mover in self.movers if not mover.outline)

    def outlined_movers(self) -> tuple[Mover, ...]:
        """Return the movers that are polygons."""
        return tuple(mover for mover in self.movers if mover.outline)

    @property
    def robots(self) -> int:
        """How many robots drive."""
        return len(self.starts)

    @property
    def fastest_mps(self) -> float:
        """The largest speed of any mover [m/s]."""
        return max((max(mover.speeds_mps) for mover in self.movers), default=0.0)

    def to_json(self) -> str:
        """Return its geometry as JSON that ``layout_of`` reads back to the last bit."""
        return _json().dump_json(self, exclude_defaults=True).decode()


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class DrawnWorld(Layout):
    """A layout with what its world says of an episode in it.

    Attributes:
        name: the world's configuration name, which also names its random streams.
        goal_tolerance_m: how near to its goal a robot's centre must come [m].
        time_limit_s: when an episode ends for every robot still running [s].
    """

    name: str
    goal_tolerance_m: Positive
    time_limit_s: Positive

    def __post_init__(self) -> None:
        """Check nothing again: it was checked as a layout."""


Rectangle = tuple[float, float, float, float, float]  # centre x, y, length, width [m], heading [rad]


def _along(line: Wall | FinishLine, width_m: float) -> Rectangle:
    """Return a line between two points as a rectangle of this width [m]."""
    dx, dy = line.x2_m - line.x1_m, line.y2_m - line.y1_m
    centre = 0.5 * (line.x1_m + line.x2_m), 0.5 * (line.y1_m + line.y2_m)
    return *centre, math.hypot(dx, dy), width_m, math.atan2(dy, dx)


def _box_rows(rectangles: Sequence[Box | Rectangle]) -> FloatArray:
    given = [(b.x_m, b.y_m, b.length_m, b.width_m, b.heading_rad) if isinstance(b, Box) else b for b in rectangles]
    rows = [(x, y, 0.5 * length, 0.5 * width, math.cos(turn), math.sin(turn)) for x, y, length, width, turn in given]
    return np.array(rows).reshape(-1, 6)


def parts_of(layout: Layout) -> dict[str, Any]:
    """Return a layout's own fields and their values."""
    return {item.name: getattr(layout, item.name) for item in fields(Layout)}


def layout_of(text: str) -> Layout:
    """Return the layout that ``Layout.to_json`` wrote.

    Raises:
        DescriptionError: it wrote nothing like that.
    """
    try:
        return _json().validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, ("layout", *first["loc"])))
        raise DescriptionError(f"{place}: {first['msg']}") from None


def layout_id(text: str) -> str:
    """Return sixteen digits of the SHA-256 of a layout's JSON: what results call it."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def in_common(worlds: "list[DrawnWorld]") -> DrawnWorld:
    """Return what stands and moves in all of some drawn worlds, at least one, within the bounds of the first."""
    parts: dict[str, Any] = {
        name: tuple(thing for thing in things if all(thing in getattr(world, name) for world in worlds[1:]))
        for name, things in parts_of(worlds[0]).items()
        if isinstance(things, tuple)
    }
    return replace(worlds[0], **parts)


@cache
def _json() -> TypeAdapter[Layout]:
    return TypeAdapter(Layout)
