"""Robots on a circle that change places with those opposite."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from navbench.validation import STRICT, DescriptionError, Positive
from navbench.world.layout import Layout, Start
from navbench.world.shapes import Bounds, Point


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Swap:
    """Robots on a circle, each of which wants to the opposite place; the circle is turned at random.

    Attributes:
        bounds: the circle is around their centre, and they grow where it needs more.
        robots: how many, 2 to 1000.
        radius_m: of the circle, at least [m].
        spacing_m: between neighbours along the circle, at least: with many robots the circle grows [m].
    """

    bounds: Bounds
    robots: Annotated[int, Field(ge=2, le=1000, strict=True)]
    radius_m: Positive
    spacing_m: Positive

    def circle_m(self) -> float:
        """Return the circle's radius [m]."""
        return max(self.radius_m, self.robots * self.spacing_m / math.tau)

    def neighbours_m(self) -> float:
        """Return the distance between two neighbours' starts [m]."""
        return 2.0 * self.circle_m() * math.sin(math.pi / self.robots)

    def check_fits(self, radius_m: float, goal_tolerance_m: float) -> None:
        """Check that neighbours stand free of each other; raises ``DescriptionError``."""
        if self.neighbours_m() <= 2.0 * radius_m:
            raise DescriptionError(
                f"spacing_m={self.spacing_m}: neighbours must stand further apart than two radii of the robot, "
                f"{2.0 * radius_m} m"
            )

    def draw(self, rng: np.random.Generator, episode: int) -> Layout:
        """Return the robots' starts and goals, within bounds that hold the circle."""
        b, radius = self.bounds, self.circle_m()
        x, y = 0.5 * (b.x_min_m + b.x_max_m), 0.5 * (b.y_min_m + b.y_max_m)
        first = rng.uniform(0.0, math.tau)
        turns = [first + math.tau * i / self.robots for i in range(self.robots)]
        arms = [(radius * math.cos(turn), radius * math.sin(turn)) for turn in turns]
        return Layout(
            bounds=Bounds(
                x_min_m=min(b.x_min_m, x - radius - self.spacing_m),
                x_max_m=max(b.x_max_m, x + radius + self.spacing_m),
                y_min_m=min(b.y_min_m, y - radius - self.spacing_m),
                y_max_m=max(b.y_max_m, y + radius + self.spacing_m),
            ),
            starts=tuple(Start(x + dx, y + dy) for dx, dy in arms),
            goals=tuple(Point(x - dx, y - dy) for dx, dy in arms),
        )
