"""Movers that wander in any direction, for ``Scattered``."""

import math

import numpy as np
from pydantic.dataclasses import dataclass

from navbench.validation import STRICT, DescriptionError, Positive, Probability
from navbench.world.generators.polygons import convex_corners
from navbench.world.generators.room import PLACES_MAX, Room
from navbench.world.generators.spans import CornerCounts, Counts, Radii, Span
from navbench.world.shapes import Mover, Point
from navbench.world.world import NoRoomError

LEGS_MAX = 10**5  # of a mover: more are a slip in a unit, and would fill the memory


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Wander:
    """Movers that turn into any direction and change their speed with every leg.

    When they begin they keep the gap to starts and goals; they pass through what stands, and through each other.

    Attributes:
        count: from and up to how many.
        radius_m: of which radii [m].
        speed_mps: how fast a leg is driven [m/s].
        leg_m: how long a leg is [m].
        polygon_share: the probability of each to be a polygon.
        corners: how many corners a polygon has.
        duration_s: for how long there are legs, at least; then a mover goes back along them [s].
    """

    count: Counts
    radius_m: Radii
    speed_mps: Span
    leg_m: Span
    polygon_share: Probability
    corners: CornerCounts
    duration_s: Positive

    def __post_init__(self) -> None:
        """Check that a mover's legs are not too many."""
        if self.duration_s * self.speed_mps[1] > LEGS_MAX * self.leg_m[0]:
            raise DescriptionError(
                f"leg_m: {list(self.leg_m)} is so short that a mover can have more than {LEGS_MAX} legs"
            )

    @property
    def fastest_mps(self) -> float:
        """The largest speed of any mover [m/s]."""
        return self.speed_mps[1]

    def add(self, rng: np.random.Generator, room: Room) -> None:
        """Place an episode's movers; raises ``NoRoomError``."""
        for _ in range(rng.integers(*self.count, endpoint=True)):
            radius = rng.uniform(*self.radius_m)
            outlined = rng.uniform() < self.polygon_share
            outline = convex_corners(rng, radius, self.corners) if outlined else ()
            points, speeds = self._path(rng, room, radius)
            room.movers.append(Mover(radius_m=radius, waypoints=points, speeds_mps=speeds, outline=outline))

    def _path(
        self, rng: np.random.Generator, room: Room, radius_m: float
    ) -> tuple[tuple[Point, ...], tuple[float, ...]]:
        """Return a random path within the bounds and the speed of each leg."""
        b = room.bounds
        x, y = room.place(rng, radius_m, "movers", ends_only=True)
        points, speeds, spent, misses = [Point(x, y)], list[float](), 0.0, 0
        while spent < self.duration_s:
            length, turn = rng.uniform(*self.leg_m), rng.uniform(0.0, math.tau)
            x, y = points[-1].x_m + length * math.cos(turn), points[-1].y_m + length * math.sin(turn)
            if b.x_min_m + radius_m <= x <= b.x_max_m - radius_m and b.y_min_m + radius_m <= y <= b.y_max_m - radius_m:
                points.append(Point(x, y))
                speeds.append(rng.uniform(*self.speed_mps))
                spent, misses = spent + length / speeds[-1], 0
            elif (misses := misses + 1) == PLACES_MAX:
                raise NoRoomError(f"no leg of a mover with leg_m={list(self.leg_m)} fits into the bounds")
        return tuple(points), tuple(speeds)
