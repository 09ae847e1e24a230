"""Round obstacles at random places, for ``Scattered``."""

import numpy as np
from pydantic.dataclasses import dataclass

from navbench.validation import STRICT
from navbench.world.generators.room import Room
from navbench.world.generators.spans import Counts, Radii, mean_area_m2
from navbench.world.shapes import Disc


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Discs:
    """Discs at random places: from and up to how many, and of which radii [m]."""

    count: Counts
    radius_m: Radii

    @property
    def area_m2(self) -> float:
        """The area that it asks for, on average [m^2]."""
        return mean_area_m2(self.count, self.radius_m)

    def add(self, rng: np.random.Generator, room: Room) -> None:
        """Place an episode's discs; raises ``NoRoomError``."""
        for _ in range(rng.integers(*self.count, endpoint=True)):
            radius = rng.uniform(*self.radius_m)
            x, y = room.place(rng, radius, "discs")
            room.take(Disc(x, y, radius), x, y, radius)
