"""Analytic shapes beside which the simulator is tested: how far things are, and where a ray hits them."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scenes import a_world, to_and_fro

from navbench.contract import Pose
from navbench.sensors import Sensors
from navbench.world.generators.polygons import convex_corners
from navbench.world.layout import DrawnWorld, Start
from navbench.world.shapes import Box, Disc, Point, Polygon, Wall

RAY_TOLERANCE_RADII = 2.5e-4  # PyBullet's 0.001 units, where a robot's radius is at least 4 units


class Round(NamedTuple):
    """A circle: centre and radius."""

    centre: complex
    radius: float

    def grown(self, by: float) -> "Round":
        return Round(self.centre, self.radius + by)

    def is_there(self) -> bool:
        return self.radius > 0.0

    def away(self, p: complex) -> float:
        return abs(p - self.centre) - self.radius

    def hit(self, begin: complex, along: complex) -> float:
        """Return how far along a ray of unit direction the first hit is, by the quadratic formula."""
        to_begin = begin - self.centre
        b = (to_begin * along.conjugate()).real
        square = b * b - (abs(to_begin) ** 2 - self.radius**2)
        if square < 0.0:
            return math.inf
        first = -b - math.sqrt(square)
        return first if first >= 0.0 else math.inf


class Block(NamedTuple):
    """A rectangle: centre, the unit vector along its length, half length and half width."""

    centre: complex
    along: complex
    half_length: float
    half_width: float

    def grown(self, by: float) -> "Block":
        return Block(self.centre, self.along, self.half_length + by, self.half_width + by)

    def is_there(self) -> bool:
        return min(self.half_length, self.half_width) > 0.0

    def away(self, p: complex) -> float:
        local = (p - self.centre) * self.along.conjugate()
        dx, dy = abs(local.real) - self.half_length, abs(local.imag) - self.half_width
        return math.hypot(max(dx, 0.0), max(dy, 0.0)) + min(max(dx, dy), 0.0)

    def hit(self, begin: complex, along: complex) -> float:
        """Return how far along a ray of unit direction the first hit is: it is on one of the four edges."""
        p, d = (begin - self.centre) * self.along.conjugate(), along * self.along.conjugate()
        hits = [math.inf]
        for side in (-1.0, 1.0):
            if d.real != 0.0:
                t = (side * self.half_length - p.real) / d.real
                hits += [t] * (t >= 0.0 and abs(p.imag + t * d.imag) <= self.half_width)
            if d.imag != 0.0:
                t = (side * self.half_width - p.imag) / d.imag
                hits += [t] * (t >= 0.0 and abs(p.real + t * d.real) <= self.half_length)
        return min(hits)


class Shard(NamedTuple):
    """A convex polygon: its corners, counter-clockwise."""

    corners: tuple[complex, ...]

    def edges(self) -> list[tuple[complex, complex]]:
        return list(zip(self.corners, self.corners[1:] + self.corners[:1], strict=True))

    def _scale(self, by: float) -> tuple[complex, float]:
        """Return a centre and by how much to stretch, so that every edge moves outward by that length at least."""
        centre = sum(self.corners) / len(self.corners)
        return centre, 1.0 + by / min(
            abs(((b - a).conjugate() * (centre - a)).imag) / abs(b - a) for a, b in self.edges()
        )

    def grown(self, by: float) -> "Shard":
        centre, scale = self._scale(by)
        return Shard(tuple(centre + max(scale, 0.0) * (corner - centre) for corner in self.corners))

    def is_there(self) -> bool:
        return abs(self.corners[0] - self.corners[1]) > 0.0

    def away(self, p: complex) -> float:
        sides = [((b - a).conjugate() * (p - a)).imag / abs(b - a) for a, b in self.edges()]
        if min(sides) >= 0.0:
            return -min(sides)
        along = [min(max(((p - a) / (b - a)).real, 0.0), 1.0) for a, b in self.edges()]
        return min(abs(p - a - t * (b - a)) for t, (a, b) in zip(along, self.edges(), strict=True))

    def hit(self, begin: complex, along: complex) -> float:
        """Return how far along a ray of unit direction the first hit is: it is on one of the edges."""
        hits = [math.inf]
        for a, b in self.edges():
            across = (along.conjugate() * (b - a)).imag
            if across != 0.0:
                t, s = (
                    ((a - begin).conjugate() * (b - a)).imag / across,
                    (along.conjugate() * (begin - a)).imag / across,
                )
                hits += [t] * (t >= 0.0 and 0.0 <= s <= 1.0)
        return min(hits)


Shape = Round | Block | Shard


def shapes_of(world: DrawnWorld, radius_m: float, poses: Sequence[Pose], t_s: float, but: int = 0) -> list[Shape]:
    """Return everything that a robot can meet at an instant: made from the description, not by navbench."""
    shapes: list[Shape] = [Round(complex(disc.x_m, disc.y_m), disc.radius_m) for disc in world.discs]
    for box in world.boxes:
        along = complex(math.cos(box.heading_rad), math.sin(box.heading_rad))
        shapes.append(Block(complex(box.x_m, box.y_m), along, 0.5 * box.length_m, 0.5 * box.width_m))
    for wall in world.walls:
        a, b = complex(wall.x1_m, wall.y1_m), complex(wall.x2_m, wall.y2_m)
        shapes.append(Block(0.5 * (a + b), (b - a) / abs(b - a), 0.5 * abs(b - a), 0.5 * wall.thickness_m))
    for mover in world.movers:  # only movers on their first leg
        a, b = (complex(point.x_m, point.y_m) for point in mover.waypoints[:2])
        place = a + (b - a) / abs(b - a) * mover.speeds_mps[0] * (t_s + mover.phase_s)
        outline = tuple(place + complex(corner.x_m, corner.y_m) for corner in mover.outline)
        shapes.append(Shard(outline) if outline else Round(place, mover.radius_m))
    shapes += [Shard(tuple(complex(p.x_m, p.y_m) for p in polygon.corners)) for polygon in world.polygons]
    shapes += [Round(complex(pose.x_m, pose.y_m), radius_m) for i, pose in enumerate(poses) if i != but]
    return shapes


def clearance(shapes: Iterable[Shape], p: complex, radius_m: float) -> float:
    return min((shape.away(p) for shape in shapes), default=math.inf) - radius_m


def clutter(rng: np.random.Generator, radius_m: float, robots: int = 1, movers: int = 0) -> DrawnWorld:
    """Return a world of random boxes, discs and walls with free starts, in which lengths go with the radius."""

    def place() -> list[float]:
        return [float(x) for x in rng.uniform(-12.0, 12.0, 2) * radius_m]

    def length(low: float, high: float) -> float:
        return float(radius_m * 10.0 ** rng.uniform(low, high))

    boxes, discs, walls, moving, polygons = [], [], [], [], []
    for _ in range(4):
        x, y = place()
        turn = rng.uniform(-4.0, 4.0)
        boxes.append(Box(x_m=x, y_m=y, length_m=length(-1.5, 0.6), width_m=length(-1.5, 0.6), heading_rad=turn))
        x, y = place()
        discs.append(Disc(x_m=x, y_m=y, radius_m=length(-1.0, 0.4)))
    for _ in range(2):
        (x1, y1), (x2, y2) = place(), place()
        walls.append(Wall(x1_m=x1, y1_m=y1, x2_m=x2, y2_m=y2, thickness_m=length(-2.0, -0.5)))
    for _ in range(2):
        x, y = place()
        corners = convex_corners(rng, length(-0.7, 0.4), (3, 6))
        polygons.append(Polygon(corners=tuple(Point(x_m=x + p.x_m, y_m=y + p.y_m) for p in corners)))
    for k in range(movers):
        (x1, y1), (x2, y2) = place(), place()
        leg = math.hypot(x2 - x1, y2 - y1)
        size = length(-0.7, 0.2)
        outline = convex_corners(rng, size, (3, 6)) if k % 2 else ()
        moving.append(
            to_and_fro(
                (x1, y1), (x2 + 99.0 * (x2 - x1), y2 + 99.0 * (y2 - y1)),
                speeds=[0.05 * leg], radius_m=size, phase_s=rng.uniform(0.0, 10.0), outline=outline,
            )
        )  # fmt: skip
    parts = {
        "boxes": tuple(boxes), "discs": tuple(discs), "walls": tuple(walls), "movers": tuple(moving),
        "polygons": tuple(polygons),
    }  # fmt: skip
    there = shapes_of(a_world(**parts), radius_m, [], 0.0)
    starts: list[Start] = []
    while len(starts) < robots:
        x, y = place()
        if clearance(there, complex(x, y), radius_m) > 0.01 * radius_m:
            starts.append(Start(x_m=x, y_m=y, heading_rad=rng.uniform(-math.pi, math.pi)))
            there.append(Round(complex(x, y), radius_m))
    return a_world(starts=tuple(starts), goal_tolerance_m=0.1 * radius_m, **parts)


def readings(
    sensors: Sensors, pose: Pose, radius_m: float, shapes: Sequence[Shape], grown: float
) -> Iterator[tuple[float, complex]]:
    """Yield each mount's analytic reading, with where its ray begins, for shapes grown by a hair to all sides.

    For single rays that begin at their mounts, which lie in the hull or on its rim.
    """
    shapes = [shape.grown(grown) for shape in shapes if shape.grown(grown).is_there()]
    turn = complex(math.cos(pose.heading_rad), math.sin(pose.heading_rad))
    for mount in sensors.mounts:
        begin = complex(pose.x_m, pose.y_m) + turn * complex(mount.x_m, mount.y_m)
        along = turn * complex(math.cos(mount.heading_rad), math.sin(mount.heading_rad))
        nearest = min((shape.hit(begin, along) for shape in shapes), default=math.inf)
        yield min(nearest, mount.max_range_m or sensors.max_range_m), begin


def assert_readings_are_analytic(
    got: np.ndarray, sensors: Sensors, pose: Pose, radius_m: float, shapes: Sequence[Shape]
) -> list[float]:
    """Check that each reading lies between those for shapes a hair larger and smaller; return the errors in radii.

    A ray that passes a corner within the hair may see it or what lies behind, so no bound on the error itself holds.
    """
    hair = RAY_TOLERANCE_RADII * radius_m
    nearest = readings(sensors, pose, radius_m, shapes, hair)
    exact = readings(sensors, pose, radius_m, shapes, 0.0)
    furthest = readings(sensors, pose, radius_m, shapes, -hair)
    errors = []
    for reading, (near, _), (middle, begin), (far, _) in zip(got.tolist(), nearest, exact, furthest, strict=True):
        away = min((shape.away(begin) for shape in shapes), default=math.inf)
        if away <= hair:  # it begins inside something or on its edge
            assert reading <= 2.0 * hair or away > -hair
            continue
        assert near - 1e-6 * radius_m <= reading <= far + 1e-6 * radius_m
        if middle < (sensors.max_range_m or 0.0):
            errors.append(abs(reading - middle) / radius_m)
    return errors
