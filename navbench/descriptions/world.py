"""The world: bounds, obstacles, walls and movers in the plane, and for each robot a start and a goal."""

import math
from collections.abc import Iterator

import numba
import numpy as np
from numpy.typing import NDArray
from pydantic.dataclasses import dataclass

from navbench.descriptions.description import STRICT, DescriptionError, Flag, NonNegative, Number, Positive
from navbench.mathematics.geometry import distance_to_nearest, segment_crossing

FloatArray = NDArray[np.float64]

GOAL_BEYOND_LINE_M = 1.0  # a goal behind a finish line is a direction to drive in, so it must not stop the robot early


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Bounds:
    """The rectangle that holds every centre and frames every picture; it does not block [m]."""

    x_min_m: Number
    x_max_m: Number
    y_min_m: Number
    y_max_m: Number

    def __post_init__(self) -> None:
        """Check that the rectangle has an inside."""
        if self.x_min_m >= self.x_max_m or self.y_min_m >= self.y_max_m:
            raise DescriptionError("x_min_m must be below x_max_m, and y_min_m below y_max_m")

    def hold(self, x_m: float, y_m: float) -> bool:
        """Return whether a point lies inside or on the edge."""
        return self.x_min_m <= x_m <= self.x_max_m and self.y_min_m <= y_m <= self.y_max_m


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Box:
    """A rectangle around its centre, ``length_m`` along its heading and ``width_m`` across it [m, rad]."""

    x_m: Number
    y_m: Number
    length_m: Positive
    width_m: Positive
    heading_rad: Number = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Disc:
    """A round obstacle [m]."""

    x_m: Number
    y_m: Number
    radius_m: Positive


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Wall:
    """A straight wall between two points, thickened by half its thickness to either side [m]."""

    x1_m: Number
    y1_m: Number
    x2_m: Number
    y2_m: Number
    thickness_m: Positive

    def __post_init__(self) -> None:
        """Check that the wall has a length."""
        if (self.x1_m, self.y1_m) == (self.x2_m, self.y2_m):
            raise DescriptionError("a wall's two ends must be different points")


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Point:
    """A point in the plane [m]."""

    x_m: Number
    y_m: Number


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
class Mover:
    """A disc that drives along way-points and yields to nobody: its place is a function of time.

    Attributes:
        radius_m: radius [m].
        waypoints: the points it visits, in order, from the first one at time 0.
        speeds_mps: one speed a leg [m/s]. n points have n - 1 legs back and forth, or n legs in a cycle.
        cyclic: from the last point on to the first one; otherwise it turns round and comes back, each leg at its speed.
        phase_s: how far along its way it is at time 0 [s].
    """

    radius_m: Positive
    waypoints: tuple[Point, ...]
    speeds_mps: tuple[Positive, ...]
    cyclic: Flag = False
    phase_s: NonNegative = 0.0

    def __post_init__(self) -> None:
        """Check the points and that each leg has a speed."""
        if len(self.waypoints) < 2:
            raise DescriptionError(f"waypoints: at least 2 are needed, got {len(self.waypoints)}")
        if any(length == 0.0 for *_, length in self._legs()):
            raise DescriptionError("waypoints: two neighbours must be different points")
        legs = len(self.waypoints) - (not self.cyclic)
        if len(self.speeds_mps) != legs:
            raise DescriptionError(f"speeds_mps: one a leg, {legs} in all, got {len(self.speeds_mps)}")

    def _legs(self) -> Iterator[tuple[Point, Point, float]]:
        ends = (*self.waypoints[1:], self.waypoints[0]) if self.cyclic else self.waypoints[1:]
        for a, b in zip(self.waypoints, ends, strict=False):
            yield a, b, math.hypot(b.x_m - a.x_m, b.y_m - a.y_m)

    def schedule(self) -> FloatArray:
        """Return one round of the mover as (n_legs, 6) rows: begin and end time [s], x, y [m], vx, vy [m/s]."""
        legs = [(a, b, length, speed) for (a, b, length), speed in zip(self._legs(), self.speeds_mps, strict=True)]
        if not self.cyclic:
            legs += [(b, a, length, speed) for a, b, length, speed in reversed(legs)]
        rows, begin = [], 0.0
        for a, b, length, speed in legs:
            end = begin + length / speed
            rows.append((begin, end, a.x_m, a.y_m, speed * (b.x_m - a.x_m) / length, speed * (b.y_m - a.y_m) / length))
            begin = end
        return np.array(rows)


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class World:
    """A world, as drawn for one robot; it is never scaled.

    Attributes:
        name: its configuration name, which also names its random streams.
        bounds: the rectangle that holds every centre.
        boxes: rectangular obstacles.
        discs: round obstacles.
        walls: straight walls.
        movers: moving discs.
        starts: one a robot.
        goals: one a robot.
        goal_tolerance_m: how near to its goal a robot's centre must come [m].
        finish_line: where there is one, arrival is crossing it, and the goals lie at least 1 m beyond.
        time_limit_s: when an episode ends for every robot still running [s].
    """

    name: str
    bounds: Bounds
    boxes: tuple[Box, ...] = ()
    discs: tuple[Disc, ...] = ()
    walls: tuple[Wall, ...] = ()
    movers: tuple[Mover, ...] = ()
    starts: tuple[Start, ...]
    goals: tuple[Point, ...]
    goal_tolerance_m: Positive
    finish_line: FinishLine | None = None
    time_limit_s: Positive

    def __post_init__(self) -> None:
        """Check what no single value shows: counts, bounds, goals inside obstacles, the finish line."""
        if not self.starts or len(self.starts) != len(self.goals):
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
        boxes, discs = self.box_rows(), self.disc_rows()
        for i, goal in enumerate(self.goals):
            if distance_to_nearest(goal.x_m, goal.y_m, boxes, discs) < 0.0:
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
        """Return discs, then movers at a time [s], as (n, 5) rows: x, y, radius [m], vx, vy [m/s]."""
        still = [(disc.x_m, disc.y_m, disc.radius_m, 0.0, 0.0) for disc in self.discs]
        rows = np.array(still + [(0.0, 0.0, mover.radius_m, 0.0, 0.0) for mover in self.movers]).reshape(-1, 5)
        place_movers(t_s, *self.mover_tables(), rows)
        return rows

    def mover_tables(self) -> tuple[FloatArray, FloatArray]:
        """Return the movers for ``place_movers``: phases (n,) [s] and the legs of all movers (m, 7), mover first."""
        legs = [np.column_stack((np.full(len(s), i), s)) for i, s in enumerate(m.schedule() for m in self.movers)]
        return np.array([mover.phase_s for mover in self.movers]), np.concatenate([np.empty((0, 7)), *legs])


@numba.njit(cache=True)
def place_movers(t_s: float, phases: FloatArray, legs: FloatArray, discs: FloatArray) -> None:
    """Write the movers' places and velocities at a time into the last rows of ``discs``.

    Args:
        t_s: time since the episode began [s].
        phases: (n,) how far along its way each mover is at time 0 [s].
        legs: (m, 7) mover, begin [s], end [s], x, y [m], vx, vy [m/s], sorted by mover and time.
        discs: (k, 5) x, y, radius, vx, vy with the movers last; changed in place.
    """
    first = 0
    for mover in range(phases.shape[0]):
        last = first
        while last + 1 < legs.shape[0] and legs[last + 1, 0] == mover:
            last += 1
        clock = (t_s + phases[mover]) % legs[last, 2]
        leg = first
        while leg < last and clock >= legs[leg, 2]:
            leg += 1
        row = discs.shape[0] - phases.shape[0] + mover
        for axis in range(2):
            discs[row, axis] = legs[leg, 3 + axis] + legs[leg, 5 + axis] * (clock - legs[leg, 1])
            discs[row, 3 + axis] = legs[leg, 5 + axis]
        first = last + 1
