"""What stands and moves in the plane: bounds, boxes, discs, polygons, walls and movers."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic.dataclasses import dataclass

from navbench.compiled import compiled
from navbench.validation import STRICT, DescriptionError, Flag, NonNegative, Number, Positive

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, config=STRICT)
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

    @classmethod
    def of(cls, width_m: float, height_m: float) -> "Bounds":
        """Return the rectangle of this size [m] whose lower left corner is the origin."""
        return cls(0.0, width_m, 0.0, height_m)

    def hold(self, x_m: float, y_m: float) -> bool:
        """Return whether a point lies inside or on the edge."""
        return self.x_min_m <= x_m <= self.x_max_m and self.y_min_m <= y_m <= self.y_max_m


@dataclass(frozen=True, slots=True, config=STRICT)
class Box:
    """A rectangle around its centre, ``length_m`` along its heading and ``width_m`` across it [m, rad]."""

    x_m: Number
    y_m: Number
    length_m: Positive
    width_m: Positive
    heading_rad: Number = 0.0


@dataclass(frozen=True, slots=True, config=STRICT)
class Disc:
    """A round obstacle [m]."""

    x_m: Number
    y_m: Number
    radius_m: Positive


@dataclass(frozen=True, slots=True, config=STRICT)
class Wall:
    """A straight wall between two points, thickened by half its thickness to either side [m]."""

    x1_m: Number
    y1_m: Number
    x2_m: Number
    y2_m: Number
    thickness_m: Positive = 0.05

    def __post_init__(self) -> None:
        """Check that the wall has a length."""
        if (self.x1_m, self.y1_m) == (self.x2_m, self.y2_m):
            raise DescriptionError("a wall's two ends must be different points")


@dataclass(frozen=True, slots=True, config=STRICT)
class Point:
    """A point in the plane [m]."""

    x_m: Number
    y_m: Number


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Polygon:
    """A convex obstacle, by its corners in either turning direction [m]."""

    corners: tuple[Point, ...]

    def __post_init__(self) -> None:
        """Check that the corners turn in one direction, all round."""
        check_convex("corners", self.corners)


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Mover:
    """A disc or a polygon that drives along waypoints and yields to nobody: its place is a function of time.

    Attributes:
        radius_m: radius [m]; of a polygon, of the circle around its centre that holds it.
        waypoints: the points it visits, in order, from the first one at time 0.
        speeds_mps: one speed a leg [m/s]. n points have n - 1 legs back and forth, or n legs in a cycle.
        cyclic: from the last point on to the first one; otherwise it turns round and comes back, each leg at its speed.
        phase_s: how far along its path it is at time 0 [s].
        outline: for a polygon, its convex corners, seen from its centre, which they hold; it drives without turning.
    """

    radius_m: Positive
    waypoints: tuple[Point, ...]
    speeds_mps: tuple[Positive, ...]
    cyclic: Flag = False
    phase_s: NonNegative = 0.0
    outline: tuple[Point, ...] = ()

    def __post_init__(self) -> None:
        """Check the points and that each leg has a speed."""
        if len(self.waypoints) < 2:
            raise DescriptionError(f"waypoints: at least 2 are needed, got {len(self.waypoints)}")
        if any(length == 0.0 for *_, length in self._legs()):
            raise DescriptionError("waypoints: two neighbours must be different points")
        legs = len(self.waypoints) - (not self.cyclic)
        if len(self.speeds_mps) != legs:
            raise DescriptionError(f"speeds_mps: one a leg, {legs} in all, got {len(self.speeds_mps)}")
        if not all(0.0 < length / speed < math.inf for (*_, length), speed in self._driven()):
            raise DescriptionError("speeds_mps: each leg must take a time that is finite and above 0")
        if self.outline:
            check_convex("outline", self.outline)
            if any(math.hypot(corner.x_m, corner.y_m) > self.radius_m * (1.0 + 1e-9) for corner in self.outline):
                raise DescriptionError(f"outline: must lie within the radius, {self.radius_m} m from its centre")
            ends = zip(self.outline, (*self.outline[1:], self.outline[0]), strict=True)
            turns = [a.x_m * b.y_m - a.y_m * b.x_m for a, b in ends]  # as seen from the centre
            if min(turns) < 0.0 < max(turns):
                raise DescriptionError("outline: must hold its centre, x_m 0 and y_m 0")

    def _legs(self) -> Iterator[tuple[Point, Point, float]]:
        ends = (*self.waypoints[1:], self.waypoints[0]) if self.cyclic else self.waypoints[1:]
        for a, b in zip(self.waypoints, ends, strict=False):
            yield a, b, math.hypot(b.x_m - a.x_m, b.y_m - a.y_m)

    def _driven(self) -> Iterator[tuple[tuple[Point, Point, float], float]]:
        """Yield each leg with its speed."""
        yield from zip(self._legs(), self.speeds_mps, strict=True)

    def place(self, t_s: float) -> tuple[float, float]:
        """Return where its centre is at a time: x, y [m]."""
        rows = np.zeros((1, 5))
        place_movers(t_s, *mover_tables([self]), rows)
        return float(rows[0, 0]), float(rows[0, 1])

    def schedule(self) -> FloatArray:
        """Return one round of the mover as (n_legs, 6) rows: begin and end time [s], x, y [m], vx, vy [m/s]."""
        legs = [(a, b, length, speed) for (a, b, length), speed in self._driven()]
        if not self.cyclic:
            legs += [(b, a, length, speed) for a, b, length, speed in reversed(legs)]
        rows, begin = [], 0.0
        for a, b, length, speed in legs:
            end = begin + length / speed
            rows.append((begin, end, a.x_m, a.y_m, speed * (b.x_m - a.x_m) / length, speed * (b.y_m - a.y_m) / length))
            begin = end
        return np.array(rows)


def mover_tables(movers: Sequence[Mover]) -> tuple[FloatArray, FloatArray]:
    """Return movers for ``place_movers``: phases (n,) [s] and the legs of all of them (m, 7), mover first."""
    legs = [np.column_stack((np.full(len(s), i), s)) for i, s in enumerate(m.schedule() for m in movers)]
    return np.array([mover.phase_s for mover in movers]), np.concatenate([np.empty((0, 7)), *legs])


def check_convex(key: str, corners: Sequence[Point]) -> None:
    """Check that corners are those of a convex polygon.

    Raises:
        DescriptionError: they are fewer than three, or do not turn in one direction, once round.
    """
    if len(corners) < 3:
        raise DescriptionError(f"{key}: at least 3 are needed, got {len(corners)}")
    sides = [(b.x_m - a.x_m, b.y_m - a.y_m) for a, b in zip(corners, (*corners[1:], corners[0]), strict=True)]
    nexts = [*sides[1:], sides[0]]
    turns = [math.atan2(ax * by - ay * bx, ax * bx + ay * by) for (ax, ay), (bx, by) in zip(sides, nexts, strict=True)]
    one_way = all(turn > 0.0 for turn in turns) or all(turn < 0.0 for turn in turns)
    if not one_way or abs(sum(turns)) > 2.0 * math.pi + 1e-6:
        raise DescriptionError(f"{key}: must be the corners of a convex polygon, in order")


def polygon_table(outlines: Sequence[tuple[float, float, float, Sequence[Point]]]) -> FloatArray:
    """Return convex polygons as rows for ``distance_to_nearest``.

    Args:
        outlines: x, y, radius [m] of each and its corners, seen from there [m].

    Returns:
        (n, 5 + 2 k): x, y, radius [m], vx, vy [m/s], all 0, and the corners counter-clockwise, seen from x and y [m],
        k being the most that any has; the last one is repeated.
    """
    most = max((len(corners) for *_, corners in outlines), default=0)
    rows = np.zeros((len(outlines), 5 + 2 * most))
    for row, (x, y, radius, corners) in zip(rows, outlines, strict=True):
        a, b, c = corners[:3]
        left = (b.x_m - a.x_m) * (c.y_m - b.y_m) > (b.y_m - a.y_m) * (c.x_m - b.x_m)
        ordered = list(corners if left else reversed(corners))
        ordered += ordered[-1:] * (most - len(ordered))
        row[:3] = x, y, radius
        row[5:] = [part for corner in ordered for part in (corner.x_m, corner.y_m)]
    return rows


@compiled
def place_movers(t_s: float, phases: FloatArray, legs: FloatArray, discs: FloatArray) -> None:
    """Write the movers' places and velocities at a time into the last rows of ``discs``.

    Args:
        t_s: time since the episode began [s].
        phases: (n,) how far along its path each mover is at time 0 [s].
        legs: (m, 7) mover, begin [s], end [s], x, y [m], vx, vy [m/s], sorted by mover and time.
        discs: (k, 5 or more) x, y, radius, vx, vy with the movers last; changed in place.
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


@compiled
def time_to_turn(t_s: float, phases: FloatArray, legs: FloatArray) -> float:
    """Return how long all movers keep the velocities of a time [s], infinite without movers; see ``place_movers``."""
    soonest, first = math.inf, 0
    for mover in range(phases.shape[0]):
        last = first
        while last + 1 < legs.shape[0] and legs[last + 1, 0] == mover:
            last += 1
        clock = (t_s + phases[mover]) % legs[last, 2]
        for leg in range(first, last + 1):
            if clock < legs[leg, 2]:
                soonest = min(soonest, legs[leg, 2] - clock)
                break
        first = last + 1
    return soonest
