"""What a world leaves to chance: obstacles, wandering movers and swapping robots, drawn anew for each episode."""

import math
from dataclasses import dataclass as plain_dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field
from pydantic.dataclasses import dataclass

from navbench.mathematics.geometry import distance_to_nearest
from navbench.validation import STRICT, DescriptionError, Positive, Probability
from navbench.world.shapes import Bounds, Disc, Mover, Point, Polygon

FloatArray = NDArray[np.float64]

DRAWS_MAX = 1000  # for one thing; what finds no place so often has none
RADIUS_MIN_M = 1e-6  # of a smaller polygon, far from 0, the corners are one point
THINGS_MAX = 1000  # of one kind
CORNERS_MAX = 100  # of a polygon: more are a disc
LEGS_MAX = 10**5  # of a mover: more are a slip in a unit, and would fill the memory
CORNER_SHIFT = 0.45  # of the even spacing; with less than a half, a triangle still holds its centre


def _ascending(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError(f"the first must not be above the second, got {list(pair)}")
    return pair


Span = Annotated[tuple[Positive, Positive], AfterValidator(_ascending)]
Radius = Annotated[float, Field(ge=RADIUS_MIN_M, strict=True, allow_inf_nan=False)]
Radii = Annotated[tuple[Radius, Radius], AfterValidator(_ascending)]
Few = Annotated[int, Field(ge=0, le=THINGS_MAX, strict=True)]
Some = Annotated[int, Field(ge=1, le=THINGS_MAX, strict=True)]
Corners = Annotated[int, Field(ge=3, le=CORNERS_MAX, strict=True)]
CountSpan = Annotated[tuple[Few, Some], AfterValidator(_ascending)]
CornerSpan = Annotated[tuple[Corners, Corners], AfterValidator(_ascending)]


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Scatter:
    """Discs at random places: from and up to how many, and of which radii [m]."""

    count: CountSpan
    radius_m: Radii


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Shards:
    """Convex polygons at random places: how many, in circles of which radii [m], with how many corners."""

    count: CountSpan
    radius_m: Radii
    corners: CornerSpan


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Wander:
    """Movers that turn into any direction and change their speed with every leg.

    Attributes:
        count: from and up to how many.
        radius_m: of which radii [m].
        speed_mps: how fast a leg is driven [m/s].
        leg_m: how long a leg is [m].
        polygon_share: the probability of each to be a polygon.
        corners: how many corners a polygon has.
    """

    count: CountSpan
    radius_m: Radii
    speed_mps: Span
    leg_m: Span
    polygon_share: Probability
    corners: CornerSpan


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Swap:
    """Robots on a circle, each of which wants to the opposite place; the circle is turned at random.

    Attributes:
        robots: how many, 2 to 1000.
        radius_m: of the circle, at least [m].
        spacing_m: between neighbours along the circle, at least: with many robots the circle grows [m].
    """

    robots: Annotated[int, Field(ge=2, le=1000, strict=True)]
    radius_m: Positive
    spacing_m: Positive

    def circle_m(self) -> float:
        """Return the circle's radius [m]."""
        return max(self.radius_m, self.robots * self.spacing_m / math.tau)

    def neighbours_m(self) -> float:
        """Return the distance between two neighbours' starts [m]."""
        return 2.0 * self.circle_m() * math.sin(math.pi / self.robots)

    def draw(self, rng: np.random.Generator, bounds: Bounds) -> tuple[Bounds, tuple[Point, ...], tuple[Point, ...]]:
        """Return bounds that hold the circle, around the same centre, and the robots' starts and goals."""
        x, y = 0.5 * (bounds.x_min_m + bounds.x_max_m), 0.5 * (bounds.y_min_m + bounds.y_max_m)
        radius = self.circle_m()
        first = rng.uniform(0.0, math.tau)
        turns = [first + math.tau * i / self.robots for i in range(self.robots)]
        ways = [(radius * math.cos(turn), radius * math.sin(turn)) for turn in turns]
        held = Bounds(
            x_min_m=min(bounds.x_min_m, x - radius - self.spacing_m),
            x_max_m=max(bounds.x_max_m, x + radius + self.spacing_m),
            y_min_m=min(bounds.y_min_m, y - radius - self.spacing_m),
            y_max_m=max(bounds.y_max_m, y + radius + self.spacing_m),
        )
        starts = tuple(Point(x_m=x + dx, y_m=y + dy) for dx, dy in ways)
        return held, starts, tuple(Point(x_m=x - dx, y_m=y - dy) for dx, dy in ways)


@plain_dataclass(slots=True)
class Room:
    """Where there is place: what stands already, and the starts and goals to keep away from.

    Attributes:
        bounds: what holds every drawn thing whole.
        boxes: (n, 6) as in ``World.box_rows``.
        discs: (m, 5) as in ``World.disc_rows``, and the circles around what was drawn.
        polygons: (l, ...) as in ``World.polygon_rows``.
        ends: x, y of the starts and goals [m].
        gap_m: free way around every drawn thing [m].
    """

    bounds: Bounds
    boxes: FloatArray
    discs: FloatArray
    polygons: FloatArray
    ends: list[tuple[float, float]]
    gap_m: float

    def place(
        self, rng: np.random.Generator, radius_m: float, key: str, ends_only: bool = False
    ) -> tuple[float, float]:
        """Return a random place for a circle, with the gap around it.

        Args:
            rng: the layout's chance.
            radius_m: of the circle [m].
            key: what is placed, for the error message.
            ends_only: whether to keep away from starts and goals alone.

        Raises:
            DescriptionError: there is no room.
        """
        b, away = self.bounds, radius_m + self.gap_m
        xs, ys = (b.x_min_m + radius_m, b.x_max_m - radius_m), (b.y_min_m + radius_m, b.y_max_m - radius_m)
        fits = xs[0] <= xs[1] and ys[0] <= ys[1]
        for _ in range(DRAWS_MAX if fits else 0):
            x, y = rng.uniform(*xs), rng.uniform(*ys)
            if any(math.hypot(x - ex, y - ey) < away for ex, ey in self.ends):
                continue
            if ends_only or distance_to_nearest(x, y, self.boxes, self.discs, self.polygons) >= away:
                return x, y
        raise DescriptionError(f"world.layout.{key}: no room within the bounds with gap_m={self.gap_m}")

    def take(self, x_m: float, y_m: float, radius_m: float) -> None:
        """Keep a circle free from now on."""
        self.discs = np.concatenate([self.discs, [[x_m, y_m, radius_m, 0.0, 0.0]]])


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Layout:
    """What is drawn for each episode, from the stream "layout": the same for every controller.

    Attributes:
        gap_m: free way around each obstacle to every other one, and from each start and goal; the movers keep it to
            the starts and goals when they begin [m].
        discs: round obstacles.
        polygons: convex obstacles.
        movers: wandering movers.
        swap: starts and goals on a circle.
    """

    gap_m: Positive
    discs: Scatter | None = None
    polygons: Shards | None = None
    movers: Wander | None = None
    swap: Swap | None = None

    def __post_init__(self) -> None:
        """Check that there is something to draw."""
        if all(part is None for part in (self.discs, self.polygons, self.movers, self.swap)):
            raise DescriptionError("must draw at least one of discs, polygons, movers, swap")

    def draw_obstacles(self, rng: np.random.Generator, room: Room) -> tuple[list[Disc], list[Polygon]]:
        """Return this episode's standing obstacles, and take their room.

        Raises:
            DescriptionError: there is no room.
        """
        discs, polygons = [], []
        if self.discs is not None:
            for _ in range(rng.integers(*self.discs.count, endpoint=True)):
                radius = rng.uniform(*self.discs.radius_m)
                x, y = room.place(rng, radius, "discs")
                room.take(x, y, radius)
                discs.append(Disc(x_m=x, y_m=y, radius_m=radius))
        if self.polygons is not None:
            for _ in range(rng.integers(*self.polygons.count, endpoint=True)):
                radius = rng.uniform(*self.polygons.radius_m)
                corners = convex_corners(rng, radius, self.polygons.corners)
                x, y = room.place(rng, radius, "polygons")
                room.take(x, y, radius)
                polygons.append(Polygon(corners=tuple(Point(x_m=x + p.x_m, y_m=y + p.y_m) for p in corners)))
        return discs, polygons

    def draw_movers(self, rng: np.random.Generator, room: Room, duration_s: float) -> list[Mover]:
        """Return this episode's movers, with legs for so long [s].

        Raises:
            DescriptionError: there is no room.
        """
        wander, movers = self.movers, []
        if wander is not None:
            for _ in range(rng.integers(*wander.count, endpoint=True)):
                radius = rng.uniform(*wander.radius_m)
                outlined = rng.uniform() < wander.polygon_share
                outline = convex_corners(rng, radius, wander.corners) if outlined else ()
                way, speeds = _way(rng, room, wander, radius, duration_s)
                movers.append(Mover(radius_m=radius, waypoints=way, speeds_mps=speeds, outline=outline))
        return movers


def convex_corners(rng: np.random.Generator, radius_m: float, count: tuple[int, int]) -> tuple[Point, ...]:
    """Return the corners of a random convex polygon that lie on a circle around 0, which it holds [m]."""
    corners = int(rng.integers(*count, endpoint=True))
    places = (np.arange(corners) + rng.uniform(0.0, CORNER_SHIFT, corners)) / corners + rng.uniform()
    return tuple(
        Point(x_m=radius_m * math.cos(math.tau * place), y_m=radius_m * math.sin(math.tau * place))
        for place in places.tolist()
    )


def _way(
    rng: np.random.Generator, room: Room, wander: Wander, radius_m: float, duration_s: float
) -> tuple[tuple[Point, ...], tuple[float, ...]]:
    """Return a random way within the bounds and the speed of each leg, for at least so long."""
    b = room.bounds
    points, speeds, spent, misses = [room.place(rng, radius_m, "movers", ends_only=True)], list[float](), 0.0, 0
    while spent < duration_s:
        length, turn = rng.uniform(*wander.leg_m), rng.uniform(0.0, math.tau)
        x, y = points[-1][0] + length * math.cos(turn), points[-1][1] + length * math.sin(turn)
        if b.x_min_m + radius_m <= x <= b.x_max_m - radius_m and b.y_min_m + radius_m <= y <= b.y_max_m - radius_m:
            points.append((x, y))
            speeds.append(rng.uniform(*wander.speed_mps))
            spent, misses = spent + length / speeds[-1], 0
            if len(speeds) > LEGS_MAX:
                leg = f"world.layout.movers.leg_m={list(wander.leg_m)}"
                raise DescriptionError(f"{leg}: so short that a mover has more than {LEGS_MAX} legs")
        elif (misses := misses + 1) == DRAWS_MAX:
            raise DescriptionError(f"world.layout.movers.leg_m={list(wander.leg_m)}: no leg fits into the bounds")
    return tuple(Point(x_m=x, y_m=y) for x, y in points), tuple(speeds)
