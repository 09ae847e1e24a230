"""Convex obstacles at random places, for ``Scattered``."""

import math

import numpy as np
from pydantic.dataclasses import dataclass

from navbench.validation import STRICT
from navbench.world.generators.room import Room
from navbench.world.generators.spans import CornerCounts, Counts, Radii, mean_area_m2
from navbench.world.shapes import Point, Polygon

CORNER_SHIFT = 0.45  # of the even spacing; with less than a half, a triangle still holds its centre


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Polygons:
    """Convex polygons at random places: how many, in circles of which radii [m], with how many corners."""

    count: Counts
    radius_m: Radii
    corners: CornerCounts

    @property
    def area_m2(self) -> float:
        """The area that it asks for, on average [m^2]."""
        return mean_area_m2(self.count, self.radius_m)

    def add(self, rng: np.random.Generator, room: Room) -> None:
        """Place an episode's polygons; raises ``NoRoomError``."""
        for _ in range(rng.integers(*self.count, endpoint=True)):
            radius = rng.uniform(*self.radius_m)
            corners = convex_corners(rng, radius, self.corners)
            x, y = room.place(rng, radius, "polygons")
            room.take(Polygon(corners=tuple(Point(x + p.x_m, y + p.y_m) for p in corners)), x, y, radius)


def convex_corners(rng: np.random.Generator, radius_m: float, count: tuple[int, int]) -> tuple[Point, ...]:
    """Return the corners of a random convex polygon that lie on a circle around 0, which it holds [m]."""
    corners = int(rng.integers(*count, endpoint=True))
    places = (np.arange(corners) + rng.uniform(0.0, CORNER_SHIFT, corners)) / corners + rng.uniform()
    return tuple(
        Point(radius_m * math.cos(math.tau * place), radius_m * math.sin(math.tau * place)) for place in places.tolist()
    )
