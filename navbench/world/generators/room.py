"""Where there is place in a layout that is being drawn."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from navbench.mathematics.geometry import distance_to_nearest
from navbench.world.layout import Layout
from navbench.world.shapes import Bounds, Disc, Mover, Polygon
from navbench.world.world import NoRoomError

FloatArray = NDArray[np.float64]

PLACES_MAX = 1000  # tried for one thing; what finds no place so often has none


@dataclass(slots=True)
class Room:
    """A layout to which things are added, each with a gap to all others and to the starts and goals.

    Attributes:
        layout: what stands already.
        gap_m: free space around every added thing [m].
        things: discs and polygons that were added.
        movers: movers that were added.
        circles: (m, 5) as in ``Layout.disc_rows``: the discs, and the circles around what was added.
    """

    layout: Layout
    gap_m: float
    things: list[Disc | Polygon] = field(default_factory=list)
    movers: list[Mover] = field(default_factory=list)
    circles: FloatArray = field(init=False)
    _boxes: FloatArray = field(init=False)
    _polygons: FloatArray = field(init=False)
    _ends: list[tuple[float, float]] = field(init=False)

    def __post_init__(self) -> None:
        """Look at what stands already."""
        self.circles, self._boxes = self.layout.disc_rows(), self.layout.box_rows()
        self._polygons = self.layout.polygon_rows()
        self._ends = [(start.x_m, start.y_m) for start in self.layout.starts]
        self._ends += [(goal.x_m, goal.y_m) for goal in self.layout.goals]

    @property
    def bounds(self) -> Bounds:
        """What holds every added thing whole."""
        return self.layout.bounds

    def place(
        self, rng: np.random.Generator, radius_m: float, what: str, ends_only: bool = False
    ) -> tuple[float, float]:
        """Return a random place for a circle, with the gap around it.

        Args:
            rng: the layout's stream.
            radius_m: of the circle [m].
            what: what is placed, for the error message.
            ends_only: whether to keep away from starts and goals alone.

        Raises:
            NoRoomError: there is no room.
        """
        b, away = self.bounds, radius_m + self.gap_m
        xs, ys = (b.x_min_m + radius_m, b.x_max_m - radius_m), (b.y_min_m + radius_m, b.y_max_m - radius_m)
        fits = xs[0] <= xs[1] and ys[0] <= ys[1]
        for _ in range(PLACES_MAX if fits else 0):
            x, y = rng.uniform(*xs), rng.uniform(*ys)
            if any(math.hypot(x - ex, y - ey) < away for ex, ey in self._ends):
                continue
            if ends_only or distance_to_nearest(x, y, self._boxes, self.circles, self._polygons) >= away:
                return x, y
        raise NoRoomError(f"no room for {what} of radius {radius_m:.3g} m within the bounds with gap_m={self.gap_m}")

    def take(self, thing: Disc | Polygon, x_m: float, y_m: float, radius_m: float) -> None:
        """Add a thing, and keep the circle that holds it free from now on."""
        self.things.append(thing)
        self.circles = np.concatenate([self.circles, [[x_m, y_m, radius_m, 0.0, 0.0]]])

    def filled(self) -> Layout:
        """Return the layout with what was added."""
        return replace(
            self.layout,
            discs=(*self.layout.discs, *(thing for thing in self.things if isinstance(thing, Disc))),
            polygons=(*self.layout.polygons, *(thing for thing in self.things if isinstance(thing, Polygon))),
            movers=(*self.layout.movers, *self.movers),
        )
