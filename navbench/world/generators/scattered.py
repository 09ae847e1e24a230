"""Things at random places between others: parts that are added, one after another, to what another source draws."""

import math
from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from navbench.validation import DescriptionError, Positive
from navbench.world.generators.room import Room
from navbench.world.layout import Layout
from navbench.world.world import NoRoomError, Source


@runtime_checkable
class Part(Protocol):
    """What adds things of one kind, such as ``Discs``; it may say its ``fastest_mps`` and ``area_m2``."""

    def add(self, rng: np.random.Generator, room: Room) -> None:
        """Draw an episode's things, find each its place, and take it.

        Raises:
            NoRoomError: there is no room.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True, config=ConfigDict(extra="forbid", arbitrary_types_allowed=True))
class Scattered:
    """What another source draws, and between it things at random places.

    Attributes:
        base: draws the bounds, the starts and goals, and what stands already.
        gap_m: free space around each added obstacle to every other one, and to each start and goal; movers keep it to
            the starts and goals when they begin [m].
        parts: what is added, by name, in this order.
    """

    base: Source
    gap_m: Positive
    parts: Mapping[str, Part]

    @property
    def robots(self) -> int:
        """How many robots drive, as far as the base says so; otherwise 1."""
        return int(getattr(self.base, "robots", 1))

    @property
    def fastest_mps(self) -> float:
        """The largest speed of any mover, as far as base and parts say so [m/s]."""
        return max(float(getattr(one, "fastest_mps", 0.0)) for one in (self.base, *self.parts.values()))

    def check_fits(self, radius_m: float, goal_tolerance_m: float) -> None:
        """Check that a robot fits through the gaps; raises ``DescriptionError``."""
        if radius_m >= self.gap_m:
            raise DescriptionError(f"gap_m={self.gap_m}: must be more than the robot's radius {radius_m} m")
        check = getattr(self.base, "check_fits", None)
        if check is not None:
            try:
                check(radius_m, goal_tolerance_m)
            except DescriptionError as error:
                raise DescriptionError(f"base.{error}") from None

    def draw(self, rng: np.random.Generator, episode: int) -> Layout:
        """Return the base's layout of an episode with the parts added; raises ``NoRoomError``."""
        base = self.base.draw(rng, episode)
        room = Room(base, self.gap_m)
        try:
            for part in self.parts.values():
                part.add(rng, room)
        except NoRoomError as error:
            asked_m2 = sum(float(getattr(part, "area_m2", 0.0)) for part in self.parts.values())
            raise NoRoomError(f"{error}; {asked_m2 / _free_m2(base):.0%} of the free area is asked for") from None
        return room.filled()


def _free_m2(layout: Layout) -> float:
    """Return how much of the plane nothing takes yet, as if nothing overlapped [m^2]."""
    b = layout.bounds
    taken = sum(box.length_m * box.width_m for box in layout.solids())
    taken += sum(math.pi * disc.radius_m**2 for disc in layout.discs)
    for polygon in layout.polygons:
        ends = zip(polygon.corners, (*polygon.corners[1:], polygon.corners[0]), strict=True)
        taken += 0.5 * abs(sum(a.x_m * c.y_m - a.y_m * c.x_m for a, c in ends))
    return max((b.x_max_m - b.x_min_m) * (b.y_max_m - b.y_min_m) - taken, 1e-9)
