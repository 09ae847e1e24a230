"""The world: bounds, obstacles, walls and movers in the plane, and for each robot a start and a goal."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from pydantic.dataclasses import dataclass

from navbench.mathematics.geometry import distance_to_nearest, segment_crossing
from navbench.mathematics.streams import stream
from navbench.validation import STRICT, DescriptionError, Number, Positive
from navbench.world.layouts import Layout, Room
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


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Start:
    """Where a robot begins [m, rad]; without a heading it looks at its goal."""

    x_m: Number
    y_m: Number
    heading_rad: Number | None = None


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class FinishLine:
    """A line to cross, between two points [m]: where a world has one, arrival is crossing it."""

    x1_m: Number
    y1_m: Number
    x2_m: Number
    y2_m: Number


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class World:
    """A world, as drawn for one robot; it is never scaled.

    Attributes:
        name: its configuration name, which also names its random streams.
        bounds: the rectangle that holds every centre.
        boxes: rectangular obstacles.
        discs: round obstacles.
        polygons: convex obstacles.
        walls: straight walls.
        movers: moving discs and polygons.
        starts: one a robot.
        goals: one a robot.
        layout: what is drawn anew for each episode, beside what is listed here.
        goal_tolerance_m: how near to its goal a robot's centre must come [m].
        finish_line: where there is one, arrival is crossing it, and the goals lie at least 1 m beyond.
        time_limit_s: when an episode ends for every robot still running [s].
    """

    name: str
    bounds: Bounds
    boxes: tuple[Box, ...] = ()
    discs: tuple[Disc, ...] = ()
    polygons: tuple[Polygon, ...] = ()
    walls: tuple[Wall, ...] = ()
    movers: tuple[Mover, ...] = ()
    starts: tuple[Start, ...] = ()
    goals: tuple[Point, ...] = ()
    layout: Layout | None = None
    goal_tolerance_m: Positive
    finish_line: FinishLine | None = None
    time_limit_s: Positive

    def __post_init__(self) -> None:
        """Check what no single value shows: counts, bounds, goals inside obstacles, the finish line."""
        swaps = self.layout is not None and self.layout.swap is not None
        if swaps and (self.starts or self.goals):
            raise DescriptionError("starts: must be empty where layout.swap draws them, and goals too")
        if not swaps and (not self.starts or len(self.starts) != len(self.goals)):
            raise DescriptionError(
                f"goals: one a start and at least one are needed, got {len(self.goals)} for {len(self.starts)} starts"
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
        boxes, discs, polygons = self.box_rows(), self.disc_rows(), self.polygon_rows()
        for i, goal in enumerate(self.goals):
            if distance_to_nearest(goal.x_m, goal.y_m, boxes, discs, polygons) < 0.0:
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
                    f"starts[{i}]; it lies {beyond:.3g} m from it"
                )

    def start_heading_rad(self, index: int) -> float:
        """Return a start's heading [rad]: its own, or the direction of its goal."""
        start, goal = self.starts[index], self.goals[index]
        if start.heading_rad is not None:
            return start.heading_rad
        return math.atan2(goal.y_m - start.y_m, goal.x_m - start.x_m)

    def solids(self) -> tuple[Box, ...]:
        """Return everything rectangular: the boxes, then the walls as boxes."""
        walls = (
            Box(
                x_m=0.5 * (wall.x1_m + wall.x2_m),
                y_m=0.5 * (wall.y1_m + wall.y2_m),
                length_m=math.hypot(wall.x2_m - wall.x1_m, wall.y2_m - wall.y1_m),
                width_m=wall.thickness_m,
                heading_rad=math.atan2(wall.y2_m - wall.y1_m, wall.x2_m - wall.x1_m),
            )
            for wall in self.walls
        )
        return (*self.boxes, *walls)

    def box_rows(self) -> FloatArray:
        """Return boxes and walls as (n, 6) rows: centre x, y, half length, half width, cos and sin of the heading."""
        rows = [
            (box.x_m, box.y_m, 0.5 * box.length_m, 0.5 * box.width_m, math.cos(box.heading_rad),
             math.sin(box.heading_rad))
            for box in self.solids()
        ]  # fmt: skip
        return np.array(rows).reshape(-1, 6)

    def disc_rows(self, t_s: float = 0.0) -> FloatArray:
        """Return discs, then round movers at a time [s], as (n, 5) rows: x, y, radius [m], vx, vy [m/s]."""
        still = [(disc.x_m, disc.y_m, disc.radius_m, 0.0, 0.0) for disc in self.discs]
        moving = [(0.0, 0.0, mover.radius_m, 0.0, 0.0) for mover in self.round_movers()]
        rows = np.array(still + moving).reshape(-1, 5)
        place_movers(t_s, *mover_tables(self.round_movers()), rows)
        return rows

    def polygon_rows(self, t_s: float = 0.0) -> FloatArray:
        """Return polygons, then outlined movers at a time [s], as rows of ``polygon_table``."""
        still = []
        for polygon in self.polygons:
            xs, ys = [p.x_m for p in polygon.corners], [p.y_m for p in polygon.corners]
            x, y = sum(xs) / len(xs), sum(ys) / len(ys)
            around = [Point(x_m=p.x_m - x, y_m=p.y_m - y) for p in polygon.corners]
            still.append((x, y, max(math.hypot(p.x_m, p.y_m) for p in around), around))
        moving = [(0.0, 0.0, mover.radius_m, mover.outline) for mover in self.outlined_movers()]
        rows = polygon_table([*still, *moving])
        place_movers(t_s, *mover_tables(self.outlined_movers()), rows)
        return rows

    def round_movers(self) -> tuple[Mover, ...]:
        """Return the movers that are discs."""
        return tuple(mover for mover in self.movers if not mover.outline)

    def outlined_movers(self) -> tuple[Mover, ...]:
        """Return the movers that are polygons."""
        return tuple(mover for mover in self.movers if mover.outline)

    @property
    def robots(self) -> int:
        """How many robots drive."""
        return len(self.starts) if self.layout is None or self.layout.swap is None else self.layout.swap.robots

    def drawn_for(self, seed: int, episode: int) -> "World":
        """Return the world with what its layout leaves to chance drawn for an episode; itself where nothing is.

        Raises:
            DescriptionError: the layout finds no room, or draws what the world does not allow.
        """
        layout = self.layout
        if layout is None:
            return self
        world, rng = self, stream(seed, self.name, episode, "layout")
        if layout.swap is not None:
            bounds, places, goals = layout.swap.draw(rng, self.bounds)
            starts = tuple(Start(x_m=place.x_m, y_m=place.y_m) for place in places)
            try:
                world = replace(world, bounds=bounds, starts=starts, goals=goals, layout=None)
            except ValidationError as error:  # such as a goal inside a standing obstacle
                said = error.errors(include_url=False)[0]["ctx"]["error"]
                raise DescriptionError(f"world.layout.swap: drew {said}") from None
        ends = [(start.x_m, start.y_m) for start in world.starts] + [(goal.x_m, goal.y_m) for goal in world.goals]
        room = Room(world.bounds, world.box_rows(), world.disc_rows(), world.polygon_rows(), ends, layout.gap_m)
        discs, polygons = layout.draw_obstacles(rng, room)
        movers = layout.draw_movers(rng, room, self.time_limit_s)
        return replace(
            world,
            discs=(*world.discs, *discs),
            polygons=(*world.polygons, *polygons),
            movers=(*world.movers, *movers),
            layout=None,
        )
