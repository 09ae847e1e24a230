import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import BLIND, BLOCK, IDEAL, RADII, a_ring, a_robot, a_simulator, a_world, drive, pose_of, to_and_fro

from navbench.contract import Pose
from navbench.descriptions.layouts import convex_corners
from navbench.descriptions.obstacles import Box, Disc, Point, Polygon, Wall
from navbench.descriptions.sensors import RAYS_MAX, Mount, Sensors
from navbench.descriptions.simulation import SimulatorOptions
from navbench.descriptions.world import Start, World
from navbench.mathematics.kinematics import advance_arc
from navbench.physics import simulator as simulator_module
from navbench.physics.motion import move
from navbench.physics.simulator import Simulator

RAY_TOLERANCE_RADII = 2.5e-4  # PyBullet's 0.001 units, where a robot's radius is at least 4 units
CONTACT_HAIR_RADII = 1.1e-4  # PyBullet rounds a box's corners by its margin of 0.001 units: (sqrt(2) - 1) * 0.001 / 4


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


def shapes_of(world: World, radius_m: float, poses: Sequence[Pose], t_s: float, but: int = 0) -> list[Shape]:
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


def clutter(rng: np.random.Generator, radius_m: float, robots: int = 1, movers: int = 0) -> World:
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


# --- rays ---


@pytest.mark.parametrize("mount_radii", [1.0 - 1e-6, 0.6])
@pytest.mark.parametrize("radius_m", RADII)
def test_readings_are_analytic_to_a_fraction_of_the_radius(radius_m: float, mount_radii: float) -> None:
    rng = np.random.default_rng(11)
    errors: list[float] = []
    sensors = a_ring(90, radius_m, 15.0 * radius_m, mount_radii)
    for _ in range(25):
        world = clutter(rng, radius_m, robots=3, movers=2)
        with a_simulator(world, a_robot(radius_m), sensors) as simulator:
            poses = [pose_of(simulator, i) for i in range(3)]
            for i in range(3):
                shapes = shapes_of(world, radius_m, poses, 0.0, but=i)
                got = simulator.ranges()[i]
                errors += assert_readings_are_analytic(got, sensors, poses[i], radius_m, shapes)
    assert len(errors) > 2000
    assert np.percentile(errors, 99.0) < 4.5e-4
    assert np.median(errors) < 1e-5


@pytest.mark.parametrize("on_collision", [BLOCK, IDEAL])
@pytest.mark.parametrize("radius_m", RADII)
def test_readings_stay_analytic_while_robots_and_movers_drive_hit_arrive_and_are_blocked(
    radius_m: float, on_collision: SimulatorOptions
) -> None:
    rng = np.random.default_rng(12)
    sensors = a_ring(24, radius_m, 6.0 * radius_m, 1.0 - 1e-6)
    robot = a_robot(radius_m, speed_mps=radius_m)
    contacts = compared = 0
    for _ in range(12):
        world = clutter(rng, radius_m, robots=4, movers=2)
        with a_simulator(world, robot, sensors, on_collision) as simulator:
            for k in range(30):
                for i in range(4):
                    v, w = rng.uniform(-0.5, 1.0) * radius_m, rng.uniform(-1.0, 1.0)
                    simulator.command(i, v, w)
                contacts += len(simulator.advance(0.4 * k, 0.4)) + sum(simulator.touching)
                poses = [pose_of(simulator, i) for i in range(4)]
                for i, row in enumerate(simulator.rows()):
                    if row[11] and k % 3 == 0:  # the check takes much longer than the drive
                        shapes = shapes_of(world, radius_m, poses, 0.4 * (k + 1), but=i)
                        got = simulator.ranges()[i]
                        compared += len(assert_readings_are_analytic(got, sensors, poses[i], radius_m, shapes))
                if not simulator.running:
                    break
    assert contacts > 10
    assert compared > 500


@pytest.mark.parametrize("radius_m", RADII)
def test_a_cone_reads_the_nearest_of_its_rays(radius_m: float) -> None:
    rng = np.random.default_rng(13)
    half, rays = 0.4, 5
    ring = a_ring(8, radius_m, 10.0 * radius_m, 0.9)
    cones = Sensors(
        drawn_for_radius_m=radius_m,
        mounts=ring.mounts,
        max_range_m=10.0 * radius_m,
        cone_half_angle_rad=half,
        rays=rays,
    )
    turns = [-half, -0.5 * half, 0.0, 0.5 * half, half]
    single = Sensors(
        drawn_for_radius_m=radius_m,
        mounts=tuple(
            Mount(role=f"{mount.role} {turn}", x_m=mount.x_m, y_m=mount.y_m, heading_rad=mount.heading_rad + turn)
            for mount in ring.mounts
            for turn in turns
        ),
        max_range_m=10.0 * radius_m,
    )
    decided_aside = 0
    for _ in range(10):
        world = clutter(rng, radius_m)
        with a_simulator(world, a_robot(radius_m), cones) as simulator:
            together = simulator.ranges()[0]
        with a_simulator(world, a_robot(radius_m), single) as simulator:
            each = simulator.ranges()[0].reshape(8, rays)
        decided_aside += int((each.min(axis=1) < each[:, 2]).sum())
        assert together == pytest.approx(each.min(axis=1), rel=1e-9)
    assert decided_aside > 10


def test_one_ray_looks_straight_ahead_whatever_the_cone() -> None:
    mount = Mount(role="ahead", x_m=1.0, y_m=0.0, heading_rad=0.0)
    sensors = Sensors(drawn_for_radius_m=1.0, mounts=(mount,), max_range_m=10.0, cone_half_angle_rad=0.5, rays=1)
    world = a_world(discs=(Disc(x_m=5.0, y_m=2.0, radius_m=0.5), Disc(x_m=8.0, y_m=0.0, radius_m=1.0)))
    with a_simulator(world, a_robot(), sensors) as simulator:
        assert simulator.ranges()[0] == pytest.approx([6.0], abs=1e-6)


def test_a_mounts_own_reach_and_cone_stand_before_the_rings() -> None:
    mounts = (
        Mount(role="ring's", x_m=0.0, y_m=0.0, heading_rad=0.0),
        Mount(role="short", x_m=0.0, y_m=0.0, heading_rad=0.0, max_range_m=4.0),
        Mount(role="wide", x_m=0.0, y_m=0.0, heading_rad=0.0, cone_half_angle_rad=0.5 * math.pi, rays=3),
    )
    sensors = Sensors(drawn_for_radius_m=1.0, mounts=mounts, max_range_m=10.0)
    world = a_world(discs=(Disc(x_m=6.0, y_m=0.0, radius_m=1.0), Disc(x_m=0.0, y_m=3.0, radius_m=1.0)))
    with a_simulator(world, a_robot(), sensors) as simulator:
        assert simulator.ranges()[0] == pytest.approx([5.0, 4.0, 2.0], abs=1e-6)


def test_the_most_rays_that_are_allowed_at_once_still_see() -> None:
    mount = Mount(role="all round", x_m=0.0, y_m=0.0, heading_rad=math.pi)
    eye = Sensors(drawn_for_radius_m=1.0, mounts=(mount,), max_range_m=9.0, cone_half_angle_rad=math.pi, rays=RAYS_MAX)
    with a_simulator(a_world(discs=(Disc(x_m=4.0, y_m=0.5, radius_m=1.0),)), a_robot(), eye) as simulator:
        assert simulator.ranges()[0] == pytest.approx([math.hypot(4.0, 0.5) - 1.0], abs=1e-6)


@pytest.mark.parametrize("radius_m", RADII)
def test_a_scene_far_from_the_origin_reads_the_same(radius_m: float) -> None:
    rng = np.random.default_rng(23)
    sensors = a_ring(40, radius_m, 9.0 * radius_m, 0.9)
    far_x, far_y = 190.0 * radius_m, -170.0 * radius_m
    for _ in range(5):
        shapes = [*rng.uniform(-8.0, 8.0, (6, 2)) * radius_m]
        kept = []
        for dx, dy in ((0.0, 0.0), (far_x, far_y)):
            discs = tuple(Disc(x_m=x + dx, y_m=y + dy, radius_m=0.4 * radius_m) for x, y in shapes)
            with a_simulator(a_world(discs=discs), a_robot(radius_m), sensors, poses=[Pose(dx, dy, 0.4)]) as simulator:
                kept.append(simulator.ranges()[0] / radius_m)
        assert kept[1] == pytest.approx(kept[0], abs=1e-6)
        assert kept[0].min() < 8.0


def beside(sensors: Sensors, disc: Disc) -> float:
    """Return the only reading of a robot of radius 1 at the origin beside one disc."""
    with a_simulator(a_world(discs=(disc,)), a_robot(), sensors) as simulator:
        (reading,) = simulator.ranges()[0].tolist()
    return float(reading)


def boom(x_m: float, y_m: float, heading_rad: float, reach_m: float = 5.0) -> Sensors:
    mount = Mount(role="boom", x_m=x_m, y_m=y_m, heading_rad=heading_rad)
    return Sensors(drawn_for_radius_m=1.0, mounts=(mount,), max_range_m=reach_m)


def test_a_mount_outside_the_hull_measures_from_the_mount() -> None:
    assert beside(boom(1.5, 0.0, 0.0), Disc(x_m=4.0, y_m=0.0, radius_m=0.5)) == pytest.approx(2.0, abs=1e-6)
    assert beside(boom(0.9, 0.9, 0.25 * math.pi), Disc(x_m=3.0, y_m=3.0, radius_m=0.5)) == pytest.approx(
        2.1 * math.sqrt(2.0) - 0.5, abs=1e-6
    )


@pytest.mark.parametrize("x_m", [1.3, 1.5, 1.8])
def test_a_mount_outside_the_hull_reads_0_for_a_thing_between_hull_and_mount(x_m: float) -> None:
    thin = Disc(x_m=1.2, y_m=0.0, radius_m=0.05)
    assert beside(boom(x_m, 0.0, 0.0), thin) == 0.0
    assert beside(boom(1.1, 0.0, 0.0), thin) == pytest.approx(0.05, abs=1e-6)


@pytest.mark.parametrize("heading_rad", [0.5 * math.pi, 1.0, -2.0, math.pi])
def test_a_mount_inside_an_obstacle_reads_0_wherever_it_looks(heading_rad: float) -> None:
    assert beside(boom(1.3, 0.0, heading_rad), Disc(x_m=1.4, y_m=0.0, radius_m=0.3)) == 0.0


def test_a_mount_outside_the_hull_that_looks_back_sees_what_is_nearer_than_itself() -> None:
    disc = Disc(x_m=2.0, y_m=0.0, radius_m=0.2)
    assert beside(boom(3.0, 0.0, math.pi, reach_m=1.5), disc) == pytest.approx(0.8, abs=1e-6)


def test_a_free_ring_reads_its_largest_range_and_not_a_hair_more() -> None:
    sensors = a_ring(7, 1.0, 2.9, 1.3)
    world = a_world(discs=(Disc(x_m=0.0, y_m=5.5, radius_m=1.0),))  # near enough to be asked for, seen by no ray
    with a_simulator(world, a_robot(), sensors) as simulator:
        skipped = simulator.ranges()[0]
        asked = cautious(simulator).ranges()[0]
    assert asked.tolist() == skipped.tolist() == [2.9] * 7


# --- asking PyBullet only for what decides ---


def cautious(simulator: Simulator) -> Simulator:
    """Make a simulator ask PyBullet for every ray."""
    rays = simulator._rays

    def all_of_them(robots: NDArray[np.void], *_: object) -> list[int]:
        count, n = len(rays.begins), len(robots)
        return [n + 1 + count * i for i in range(n + 1)] + list(range(count)) * n

    rays.decisive = all_of_them  # type: ignore[method-assign,assignment]
    return simulator


@pytest.mark.parametrize("on_collision", ["end", "block"])
@pytest.mark.parametrize("radius_m", RADII)
@pytest.mark.parametrize("cone", [{}, {"cone_half_angle_rad": 0.3, "rays": 5}])
def test_asking_pybullet_only_for_what_decides_changes_nothing(
    cone: dict[str, Any], radius_m: float, on_collision: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def history(world: World, always: bool, seed: int) -> list[object]:
        monkeypatch.setattr(simulator_module, "CONTACT_MARGIN_RADII", 1e9 if always else 0.05)
        rng = np.random.default_rng(seed)
        kept: list[object] = []
        options = BLOCK if on_collision == "block" else IDEAL
        sensors = a_ring(9, radius_m, 4.0 * radius_m, 1.1, **cone)
        with a_simulator(world, a_robot(radius_m, radius_m), sensors, options) as s:
            if always:
                cautious(s)
            for k in range(40):
                rows = s.rows()
                ranges = s.ranges().tolist()
                kept.append([(i, ranges[i]) for i, row in enumerate(rows) if row[11]])
                for i in range(len(rows)):
                    s.command(i, rng.uniform(-0.5, 1.0) * radius_m, rng.uniform(-2.0, 2.0))
                kept.append([s.advance(0.3 * k, 0.3), s.touching, s.contacts, [row[:3] for row in s.rows()]])
                if not s.running:
                    break
        return kept

    rng = np.random.default_rng(14)
    ends = 0
    for seed in range(8):
        world = clutter(rng, radius_m, robots=4, movers=2)
        asked, skipped = history(world, True, seed), history(world, False, seed)
        assert asked == skipped
        ends += len(asked)
    assert ends > 50


def test_of_a_cones_rays_only_those_that_may_be_the_shortest_are_asked_for() -> None:
    mount = Mount(role="ahead", x_m=1.0, y_m=0.0, heading_rad=0.0)
    eye = Sensors(drawn_for_radius_m=1.0, mounts=(mount,), max_range_m=20.0, cone_half_angle_rad=0.5, rays=5)
    wall = Box(x_m=8.0, y_m=0.0, length_m=1.0, width_m=30.0, heading_rad=0.0)
    aslant = Box(x_m=8.0, y_m=0.0, length_m=1.0, width_m=30.0, heading_rad=0.4)
    triangle = Polygon(corners=(Point(x_m=9.0, y_m=2.0), Point(x_m=7.0, y_m=0.0), Point(x_m=9.0, y_m=-2.0)))
    asked = {}
    scenes: dict[str, dict[str, Any]] = {
        "wall": {"boxes": (wall,)},
        "wall aslant": {"boxes": (aslant,)},
        "disc": {"discs": (Disc(x_m=8.0, y_m=1.9, radius_m=1.0),)},
        "two as near as each other": {
            "discs": (Disc(x_m=8.0, y_m=1.9, radius_m=1.0), Disc(x_m=8.0, y_m=-1.9, radius_m=1.0))
        },
        "polygon": {"polygons": (triangle,)},
        "begins in it": {"boxes": (Box(x_m=2.5, y_m=0.0, length_m=4.0, width_m=9.0, heading_rad=0.0),)},
        "nothing": {},
    }
    for name, changes in scenes.items():
        with a_simulator(a_world(**changes), a_robot(), eye) as simulator:
            scene = simulator.scene
            begin, end, *rays = simulator._rays.decisive(simulator.robots, scene.boxes, scene.discs, scene.polygons)
            assert (begin, end) == (2, 2 + len(rays))
            asked[name] = rays
    assert asked == {
        "wall": [2],
        "wall aslant": [4],
        "disc": [3],
        "two as near as each other": [1, 3],
        "polygon": [1, 2, 3],
        "begins in it": [0, 1, 2, 3, 4],
        "nothing": [],
    }


def reading_towards(simulator: Simulator) -> float:
    """Return the first robot's only reading."""
    return float(simulator.ranges()[0, 0])


AHEAD = Sensors(
    drawn_for_radius_m=1.0, max_range_m=5.0, mounts=(Mount(role="ahead", x_m=1.0, y_m=0.0, heading_rad=0.0),)
)


def two_robots(second_x_m: float, **changes: object) -> World:
    """Return a robot at the origin and one ahead of it, both looking ahead."""
    starts = (Start(x_m=0.0, y_m=0.0, heading_rad=0.0), Start(x_m=second_x_m, y_m=0.0, heading_rad=0.0))
    return a_world(starts=starts, **changes)


def test_a_robot_that_arrives_within_a_substep_is_seen_where_it_arrived() -> None:
    goals = (Point(x_m=500.0, y_m=0.0), Point(x_m=6.95, y_m=0.0))
    with a_simulator(two_robots(6.8, goals=goals, goal_tolerance_m=0.01), a_robot(), AHEAD) as simulator:
        simulator.command(1, 1.0, 0.0)
        assert [event.outcome for event in simulator.advance(0.0, 0.25)] == ["reached"]
        assert reading_towards(simulator) == pytest.approx(4.95, abs=1e-6)


def test_a_robot_that_is_blocked_within_a_substep_is_seen_where_it_is_held() -> None:
    wall = Wall(x1_m=8.1, y1_m=-9.0, x2_m=8.1, y2_m=9.0, thickness_m=0.2)
    with a_simulator(two_robots(6.8, walls=(wall,)), a_robot(), AHEAD, BLOCK) as simulator:
        simulator.command(1, 1.0, 0.0)
        simulator.advance(0.0, 0.25)
        assert simulator.touching == [False, True]
        assert reading_towards(simulator) == pytest.approx(4.8, abs=1e-6)


# --- contacts ---


@pytest.mark.parametrize("radius_m", RADII)
def test_contact_is_decided_as_the_analytic_clearance_says(radius_m: float) -> None:
    rng = np.random.default_rng(15)
    touched = free = 0
    for _ in range(15):
        world = clutter(rng, radius_m, robots=2, movers=1)
        other = Pose(world.starts[1].x_m, world.starts[1].y_m, 0.0)
        shapes = shapes_of(world, radius_m, [other], 0.0, but=-1)
        with a_simulator(world, a_robot(radius_m)) as simulator:
            for _ in range(40):
                inside, outside = (complex(*rng.uniform(-12.0, 12.0, 2) * radius_m) for _ in range(2))
                if clearance(shapes, inside, radius_m) > 0.0:
                    inside, outside = outside, inside
                if clearance(shapes, inside, radius_m) > 0.0 or clearance(shapes, outside, radius_m) <= 0.0:
                    continue
                for _ in range(50):
                    middle = 0.5 * (inside + outside)
                    if clearance(shapes, middle, radius_m) > 0.0:
                        outside = middle
                    else:
                        inside = middle
                place = inside + radius_m * 10.0 ** rng.uniform(-6.0, -0.5) * np.exp(1j * rng.uniform(-4.0, 4.0))
                gap = clearance(shapes, complex(place), radius_m) / radius_m
                simulator.reset(simulator.scene, [Pose(place.real, place.imag, rng.uniform(-3.0, 3.0)), other])
                hit = any(event.robot_index == 0 for event in simulator.advance(0.0, 1e-12))
                touched += hit
                free += not hit
                if gap > 1e-9 or gap < -CONTACT_HAIR_RADII:
                    assert hit == (gap <= 0.0), gap
    assert touched > 100
    assert free > 100


@pytest.mark.parametrize("radius_m", RADII)
def test_contacts_are_right_beside_things_that_are_huge_or_tiny(radius_m: float) -> None:
    hair = 2.0 * CONTACT_HAIR_RADII * radius_m
    big, small = 50.0 * radius_m, 1e-3 * radius_m
    things: list[dict[str, object]] = [
        {"walls": (Wall(x1_m=-big, y1_m=0.0, x2_m=big, y2_m=0.0, thickness_m=2.0 * small),)},
        {"boxes": (Box(x_m=0.0, y_m=small - big, length_m=2.0 * big, width_m=2.0 * big),)},
        {"discs": (Disc(x_m=0.0, y_m=small - big, radius_m=big),)},
        {"discs": (Disc(x_m=0.0, y_m=0.0, radius_m=small),)},
    ]
    start = (Start(x_m=0.0, y_m=3.0 * radius_m, heading_rad=0.0),)
    for thing in things:
        with a_simulator(a_world(starts=start, **thing), a_robot(radius_m)) as simulator:
            for gap, expected in ((hair, 0), (-hair, 1), (-0.2 * radius_m, 1)):
                simulator.reset(simulator.scene, [Pose(0.0, small + radius_m + gap, 0.0)])
                assert len(simulator.advance(0.0, 1e-12)) == expected


def test_the_reason_names_what_was_hit() -> None:
    world = a_world(
        boxes=(Box(x_m=9.0, y_m=9.0, length_m=1.0, width_m=1.0), Box(x_m=2.0, y_m=0.0, length_m=1.0, width_m=1.0)),
        walls=(Wall(x1_m=-3.0, y1_m=1.5, x2_m=-3.0, y2_m=4.5, thickness_m=0.1),),
        discs=(Disc(x_m=0.0, y_m=-3.0, radius_m=1.0),),
        movers=(to_and_fro((-9.0, -9.0), (-9.0, 0.0), speeds=[0.1], radius_m=1.0),),
    )
    places = {"box 1": (1.0, 0.0), "wall 0": (-2.5, 3.0), "disc 0": (0.0, -1.5), "mover 0": (-8.0, -9.0)}
    with a_simulator(world, a_robot()) as simulator:
        for name, (x, y) in places.items():
            simulator.reset(simulator.scene, [Pose(x, y, 0.0)])
            (event,) = simulator.advance(3.0, 0.1)
            assert (event.outcome, event.reason) == ("collided", f"hit {name}")
            assert event.t_s == pytest.approx(3.1)


# --- substeps ---


@pytest.mark.parametrize("radius_m", RADII)
def test_a_fast_robot_with_a_period_of_2_s_hits_a_thin_wall(radius_m: float) -> None:
    rng = np.random.default_rng(16)
    speed = 30.0 * radius_m
    deepest = 0.0
    for _ in range(20):
        face = rng.uniform(2.0, 50.0) * radius_m
        turn = rng.uniform(-0.5, 0.5)
        dx, dy = 99.0 * radius_m * math.sin(turn), 99.0 * radius_m * math.cos(turn)
        wall = Wall(x1_m=face + dx, y1_m=-dy, x2_m=face - dx, y2_m=dy, thickness_m=1e-3 * radius_m)
        with a_simulator(a_world(walls=(wall,)), a_robot(radius_m, speed)) as simulator:
            (event,) = drive(simulator, [(speed, 0.0)], 2.0)
            touch_m = face - (radius_m + 0.5e-3 * radius_m) / math.cos(turn)
            late_m = speed * event.t_s - touch_m
            deepest = max(deepest, late_m)
            assert event.outcome == "collided"
            assert -1e-3 * radius_m <= late_m <= 0.2501 * radius_m
            assert pose_of(simulator).x_m == pytest.approx(speed * event.t_s)
    assert deepest > 0.15 * radius_m


@pytest.mark.parametrize("radius_m", RADII)
def test_a_fast_tiny_mover_does_not_pass_a_standing_robot_unnoticed(radius_m: float) -> None:
    rng = np.random.default_rng(17)
    speed, small = 40.0 * radius_m, 0.01 * radius_m
    for _ in range(20):
        far, aside = rng.uniform(5.0, 60.0) * radius_m, rng.uniform(-0.8, 0.8) * radius_m
        mover = to_and_fro((far, aside), (-10.0 * far, aside), speeds=[speed], radius_m=small)
        with a_simulator(a_world(movers=(mover,)), a_robot(radius_m)) as simulator:
            (event,) = drive(simulator, [(0.0, 0.0)], 2.0)
            touch_s = (far - math.sqrt((radius_m + small) ** 2 - aside**2)) / speed
            assert event.reason == "hit mover 0"
            assert -1e-3 <= (event.t_s - touch_s) * speed / radius_m <= 0.2501


def test_two_fast_robots_do_not_pass_through_each_other() -> None:
    rng = np.random.default_rng(18)
    for _ in range(20):
        gap = rng.uniform(3.0, 60.0)
        starts = (Start(x_m=0.0, y_m=0.0, heading_rad=0.0), Start(x_m=gap, y_m=0.0, heading_rad=math.pi))
        with a_simulator(a_world(starts=starts), a_robot(speed_mps=20.0)) as simulator:
            events = drive(simulator, [(20.0, 0.0)], 2.0)
            assert [event.reason for event in events] == ["hit robot 1", "hit robot 0"]
            assert 0.0 <= events[0].t_s - (gap - 2.0) / 40.0 <= 0.2501 / 20.0


def lengths_of_substeps(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return a list to which every substep will add its length [s]."""
    lengths: list[float] = []

    def spy(*arguments: Any) -> tuple[int, bool, bool]:
        made, unsettled, near = move(*arguments)
        lengths.extend([arguments[6]] * made)
        return made, unsettled, near

    monkeypatch.setattr(simulator_module, "move", spy)
    return lengths


@pytest.mark.parametrize("options", [IDEAL, SimulatorOptions(drive="limited", motor_lag_s=0.3, command_delay_s=0.7)])
@pytest.mark.parametrize("accel_mps2", [None, 5.0])
def test_no_robot_moves_further_than_a_quarter_of_its_radius_in_a_substep(
    options: SimulatorOptions, accel_mps2: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(19)
    with a_simulator(a_world(), a_robot(0.5, 10.0, accel_mps2), options=options) as simulator:
        lengths = lengths_of_substeps(monkeypatch)
        for k in range(60):
            before = simulator.rows()[0]
            simulator.command(0, rng.choice([0.0, 0.1, 9.0, -9.0]), rng.uniform(-20.0, 20.0))
            lengths.clear()
            simulator.advance(0.5 * k, 0.5)
            after = simulator.rows()[0]
            mean_speed = (after[9] - before[9]) / 0.5
            assert sum(lengths) == pytest.approx(0.5)
            assert mean_speed * max(lengths) <= 0.125 * (1.0 + 1e-6)
            if accel_mps2 is not None or options.motor_lag_s:
                fastest = max(abs(row[3] + row[4]) / 2.0 for row in (before, after))
                assert fastest * max(lengths) <= 0.125 * (1.0 + 1e-6)


@pytest.mark.parametrize("on_collision", [BLOCK, IDEAL])
def test_substeps_in_one_go_are_those_one_by_one(
    on_collision: SimulatorOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    def history(stride: int, seed: int) -> list[object]:
        def strided(*arguments: Any) -> tuple[int, bool, bool]:
            changed = [*arguments]
            changed[7] = min(arguments[7], stride)
            made: tuple[int, bool, bool] = move(*changed)
            return made

        monkeypatch.setattr(simulator_module, "move", strided)
        rng = np.random.default_rng(seed)
        kept: list[object] = []
        with a_simulator(clutter(rng, 1.0, robots=3), a_robot(1.0, 3.0, 2.0), BLIND, on_collision) as simulator:
            for k in range(30):
                for i in range(3):
                    simulator.command(i, rng.uniform(-1.0, 3.0), rng.uniform(-1.0, 1.0))
                kept.append([simulator.advance(0.7 * k, 0.7), simulator.contacts, simulator.robots.tobytes()])
                if not simulator.running:
                    break
        return kept

    for seed in range(6):
        assert history(1000, seed) == history(1, seed)


def test_substeps_are_as_long_as_the_present_command_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    with a_simulator(a_world(), a_robot(1.0, 10.0)) as simulator:
        lengths = lengths_of_substeps(monkeypatch)
        drive(simulator, [(10.0, 0.0), (1.0, 0.0), (0.0, 3.0)], 1.0)
    assert lengths == pytest.approx([0.025] * 40 + [0.25] * 4 + [1.0])


def test_a_mover_shortens_the_substeps_even_of_a_slow_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    mover = to_and_fro((900.0, 900.0), (900.0, -900.0), (-900.0, -900.0), speeds=[2.0, 8.0], radius_m=1.0)
    with a_simulator(a_world(movers=(mover,)), a_robot()) as simulator:
        lengths = lengths_of_substeps(monkeypatch)
        drive(simulator, [(0.01, 0.0)], 1.0)
    assert max(lengths) * 8.0 <= 0.25 * (1.0 + 1e-9)


# --- driving ---


def test_the_ideal_drive_clips_each_wheel_on_its_own() -> None:
    robot = a_robot(1.0, 2.0)
    cases = {
        (1.0, 0.4): (0.7, 1.3),
        (1.8, 0.4): (1.5, 2.0),
        (-1.8, 0.4): (-2.0, -1.5),
        (0.0, 4.0): (-2.0, 2.0),
        (5.0, -1.0): (2.0, 2.0),
        (0.5, 9.0): (-2.0, 2.0),
        (0.5, -2.4): (2.0, -1.3),
    }
    for (v, w), (left, right) in cases.items():
        with a_simulator(a_world(), robot) as simulator:
            drive(simulator, [(v, w)], 0.3)
            assert simulator.rows()[0][3:5] == pytest.approx((left, right))
            expected = advance_arc(0.0, 0.0, 0.0, 0.5 * (left + right), (right - left) / robot.track_m, 0.3)
            assert pose_of(simulator) == pytest.approx(expected, abs=1e-12)


def test_the_ideal_drive_follows_the_closed_form_arc_for_10_s_whatever_the_substeps() -> None:
    for speed in (0.02, 1.0, 25.0):
        with a_simulator(a_world(), a_robot(1.0, 2.0 * speed)) as simulator:
            drive(simulator, [(speed, 0.1 * speed)] * 20, 0.5)
            x, y, heading = advance_arc(0.0, 0.0, 0.0, speed, 0.1 * speed, 10.0)
            assert pose_of(simulator)[:2] == pytest.approx((x, y), abs=1e-9)
            assert math.remainder(pose_of(simulator).heading_rad - heading, 2.0 * math.pi) == pytest.approx(0, abs=1e-9)
            assert simulator.rows()[0][9:11] == pytest.approx((10.0 * speed, speed), rel=1e-12)


def test_no_wheel_accelerates_beyond_the_limit() -> None:
    rng = np.random.default_rng(20)
    with a_simulator(a_world(), a_robot(1.0, 2.0, accel_mps2=1.5)) as simulator:
        before, limited = np.zeros(2), 0
        for k in range(200):
            simulator.command(0, rng.uniform(-2.0, 2.0), rng.uniform(-2.0, 2.0))
            simulator.advance(0.2 * k, 0.2)
            after = np.array(simulator.rows()[0][3:5])
            change = np.abs(after - before).max()
            limited += change > 0.299
            assert change <= 0.3 + 1e-12
            before = after
    assert limited > 100


@pytest.mark.parametrize("period_s", [0.01, 0.1, 2.0])
def test_a_robot_starts_as_the_closed_form_of_constant_acceleration_says(period_s: float) -> None:
    with a_simulator(a_world(), a_robot(1.0, 2.0, accel_mps2=0.8)) as simulator:
        drive(simulator, [(1.5, 0.0)] * round(4.0 / period_s), period_s)
        ramp_s = 1.5 / 0.8
        assert pose_of(simulator).x_m == pytest.approx(0.5 * 0.8 * ramp_s**2 + 1.5 * (4.0 - ramp_s), abs=1e-9)
        assert simulator.rows()[0][3:5] == pytest.approx((1.5, 1.5))


@pytest.mark.parametrize("period_s", [0.05, 0.5, 2.0])
def test_a_turn_under_the_acceleration_limit_follows_fine_integration(period_s: float) -> None:
    rng = np.random.default_rng(21)
    radius, accel, n = 1.0, 0.7, 100_000
    robot = a_robot(radius, 1.0, accel)
    with a_simulator(a_world(), robot) as simulator:
        for k in range(10):
            row = simulator.rows()[0]
            targets = rng.uniform(-1.0, 1.0, 2)
            times = (np.arange(n) + 0.5) * period_s / n
            wheels = [
                now + np.sign(target - now) * np.minimum(accel * times, abs(target - now))
                for now, target in zip(row[3:5], targets, strict=True)
            ]
            turning = (wheels[1] - wheels[0]) / robot.track_m
            headings = row[2] + (np.cumsum(turning) - 0.5 * turning) * period_s / n
            x = row[0] + float((0.5 * (wheels[0] + wheels[1]) * np.cos(headings)).mean()) * period_s
            y = row[1] + float((0.5 * (wheels[0] + wheels[1]) * np.sin(headings)).mean()) * period_s
            simulator.command(0, 0.5 * targets.sum(), (targets[1] - targets[0]) / robot.track_m)
            simulator.advance(k * period_s, period_s)
            pose = pose_of(simulator)
            assert math.hypot(pose.x_m - x, pose.y_m - y) < 1e-2 * radius
            turned = pose.heading_rad - row[2] - float(turning.mean()) * period_s
            assert math.remainder(turned, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


def limited(lag_s: float, delay_s: float) -> SimulatorOptions:
    return SimulatorOptions(drive="limited", motor_lag_s=lag_s, command_delay_s=delay_s)


@pytest.mark.parametrize("period_s", [0.05, 0.4, 2.0])
def test_the_motor_lag_is_a_first_order_lag(period_s: float) -> None:
    lag, v = 0.5, 0.9
    with a_simulator(a_world(), a_robot(), options=limited(lag, 0.0)) as simulator:
        drive(simulator, [(v, 0.0)] * round(4.0 / period_s), period_s)
        assert simulator.rows()[0][3:5] == pytest.approx([v * (1.0 - math.exp(-4.0 / lag))] * 2)
        assert pose_of(simulator).x_m == pytest.approx(v * (4.0 - lag * (1.0 - math.exp(-4.0 / lag))), abs=1e-9)


def test_each_wheel_lags_on_its_own() -> None:
    lag, robot = 0.5, a_robot()
    with a_simulator(a_world(), robot, options=limited(lag, 0.0)) as simulator:
        drive(simulator, [(0.5, 0.2)] * 10, 0.1)
        turned = 0.2 * (1.0 - lag * (1.0 - math.exp(-1.0 / lag)))
        assert pose_of(simulator).heading_rad == pytest.approx(turned, abs=1e-12)


@pytest.mark.parametrize("delay_s", [0.03, 0.1, 0.13, 0.2, 0.57])
def test_a_command_takes_its_delay_to_reach_the_wheels_and_cuts_the_period_there(delay_s: float) -> None:
    commands = [(0.2, 0.0), (1.0, 0.0), (-0.5, 0.0), (0.3, 0.0), (0.8, 0.0), (0.0, 0.0), (0.6, 0.0), (0.1, 0.0)]
    speeds = np.array([v for v, _ in commands])
    with a_simulator(a_world(), a_robot(), options=limited(0.0, delay_s)) as simulator:
        for k in range(len(commands)):
            drive(simulator, [commands[k]], 0.1, first_period=k)
            passed = 0.1 * (k + 1) - delay_s - 0.1 * np.arange(len(commands))
            expected = float((speeds * np.clip(passed, 0.0, 0.1)).sum())
            assert pose_of(simulator).x_m == pytest.approx(expected, abs=1e-9)


def test_delay_and_lag_follow_their_closed_form_in_turn() -> None:
    lag, delay = 0.3, 0.17
    with a_simulator(a_world(), a_robot(), options=limited(lag, delay)) as simulator:
        drive(simulator, [(0.8, 0.0)] * 5 + [(-0.4, 0.0)] * 5, 0.1)

        def pushed(change: float, seconds: float) -> float:
            return change * (seconds - lag * (1.0 - math.exp(-seconds / lag)))

        expected = pushed(0.8, 1.0 - delay) + pushed(-1.2, 0.5 - delay)
        assert pose_of(simulator).x_m == pytest.approx(expected, abs=1e-9)


def test_the_ideal_drive_knows_neither_lag_nor_delay() -> None:
    options = SimulatorOptions(drive="ideal", motor_lag_s=0.5, command_delay_s=0.5)
    with a_simulator(a_world(), a_robot(), options=options) as simulator:
        drive(simulator, [(0.7, 0.0)], 0.1)
        assert pose_of(simulator).x_m == pytest.approx(0.07)


def test_a_lagging_wheel_keeps_the_acceleration_limit() -> None:
    with a_simulator(a_world(), a_robot(1.0, 1.0, accel_mps2=0.5), options=limited(0.01, 0.0)) as simulator:
        speeds = [0.0]
        for k in range(30):
            drive(simulator, [(1.0, 0.0)], 0.1, first_period=k)
            speeds.append(simulator.rows()[0][3])
    assert max(np.diff(speeds)) == pytest.approx(0.05, abs=1e-12)
    assert speeds[-1] == pytest.approx(1.0, abs=1e-6)


# --- blocking ---

WALL = Wall(x1_m=5.1, y1_m=-50.0, x2_m=5.1, y2_m=50.0, thickness_m=0.1)  # its face stands at 5.05


def test_a_blocked_robot_is_held_at_its_last_free_pose() -> None:
    with a_simulator(a_world(walls=(WALL,)), a_robot(), options=BLOCK) as simulator:
        assert drive(simulator, [(1.0, 0.0)] * 60, 0.1) == []
        assert pose_of(simulator) == pytest.approx((4.0, 0.0, 0.0), abs=1e-9)
        assert simulator.rows()[0][3:5] == (0.0, 0.0)
        assert simulator.rows()[0][9:11] == pytest.approx((4.0, 0.0), abs=1e-9)
        assert simulator.touching == [True]


def test_a_blocked_robots_turning_and_way_count_only_what_it_did() -> None:
    with a_simulator(a_world(walls=(WALL,)), a_robot(), options=BLOCK) as simulator:
        drive(simulator, [(0.9, 0.05)] * 80, 0.1)
        x, y, heading = pose_of(simulator)
        assert simulator.touching == [True]
        assert simulator.rows()[0][10] == pytest.approx(heading, rel=1e-9)
        assert simulator.rows()[0][9] == pytest.approx(heading * 0.9 / 0.05, rel=1e-9)
        assert (x, y) == pytest.approx((18.0 * math.sin(heading), 18.0 * (1.0 - math.cos(heading))), abs=1e-9)


def test_an_unbroken_push_counts_once_and_a_second_one_once_more() -> None:
    with a_simulator(a_world(walls=(WALL,)), a_robot(), options=BLOCK) as simulator:
        drive(simulator, [(1.0, 0.0)] * 60, 0.1)
        assert [count.total for count in simulator.contacts] == [1]
        drive(simulator, [(-1.0, 0.0)] * 5, 0.1, first_period=60)
        assert simulator.touching == [False]
        assert pose_of(simulator).x_m == pytest.approx(3.5, abs=1e-9)
        drive(simulator, [(1.0, 0.0)] * 20, 0.1, first_period=65)
        assert [count.total for count in simulator.contacts] == [2]
        assert simulator.touching == [True]


@pytest.mark.parametrize(
    ("accel_mps2", "options"),
    [
        (2.0, BLOCK),
        (None, SimulatorOptions(on_collision="block", drive="limited", motor_lag_s=0.2)),
        (None, SimulatorOptions(on_collision="block", drive="limited", command_delay_s=0.03)),
    ],
    ids=["acceleration limit", "lag", "delay"],
)
def test_an_unbroken_push_of_slow_wheels_counts_once(accel_mps2: float | None, options: SimulatorOptions) -> None:
    with a_simulator(a_world(walls=(WALL,)), a_robot(1.0, 1.0, accel_mps2), options=options) as simulator:
        drive(simulator, [(1.0, 0.0)] * 100, 0.1)
        assert [count.total for count in simulator.contacts] == [1]


def test_a_blocked_robot_can_leave_in_the_next_period_and_turn_on_the_spot() -> None:
    with a_simulator(a_world(walls=(WALL,)), a_robot(), options=BLOCK) as simulator:
        drive(simulator, [(1.0, 0.0)] * 50 + [(0.0, 1.0)] * 10, 0.1)
        assert pose_of(simulator) == pytest.approx((4.0, 0.0, 1.0), abs=1e-9)
        assert simulator.touching == [False]
        drive(simulator, [(-0.5, 0.0)], 0.1, first_period=60)
        assert pose_of(simulator)[:2] == pytest.approx((4.0 - 0.05 * math.cos(1.0), -0.05 * math.sin(1.0)), abs=1e-9)


def test_two_robots_that_push_each_other_are_both_held_and_both_counted_once() -> None:
    starts = (Start(x_m=0.0, y_m=0.0, heading_rad=0.0), Start(x_m=4.5, y_m=0.0, heading_rad=math.pi))
    with a_simulator(a_world(starts=starts), a_robot(), options=BLOCK) as simulator:
        assert drive(simulator, [(1.0, 0.0)] * 30, 0.1) == []
        assert pose_of(simulator, 0).x_m == pytest.approx(1.2, abs=1e-9)
        assert pose_of(simulator, 1).x_m == pytest.approx(3.3, abs=1e-9)
        assert [count.total for count in simulator.contacts] == [1, 1]
        drive(simulator, [(-1.0, 0.0)] * 3, 0.1, first_period=30)
        assert pose_of(simulator, 0).x_m == pytest.approx(0.9, abs=1e-9)
        assert simulator.touching == [False, False]


def test_a_robot_that_follows_a_blocked_one_is_never_held_inside_it() -> None:
    starts = (Start(x_m=0.0, y_m=0.0, heading_rad=0.0), Start(x_m=-2.02, y_m=0.0, heading_rad=0.0))
    with a_simulator(a_world(starts=starts, walls=(WALL,)), a_robot(), options=BLOCK) as simulator:
        for k in range(60):
            drive(simulator, [(1.0, 0.0)], 0.1, first_period=k)
            assert pose_of(simulator, 0).x_m - pose_of(simulator, 1).x_m > 2.0
        assert [count.total for count in simulator.contacts] == [1, 1]
        drive(simulator, [(-0.1, 0.0)], 0.1, first_period=60)
        assert simulator.touching == [False, False]


def test_a_mover_over_a_standing_robot_is_one_contact_and_reads_0_where_a_ray_begins_in_it() -> None:
    mover = to_and_fro((6.0, 0.3), (-60.0, 0.3), speeds=[1.0], radius_m=0.8)
    sensors = a_ring(16, 1.0, 5.0, 1.0 - 1e-6)
    robot = a_robot()
    buried = 0
    with a_simulator(a_world(movers=(mover,)), robot, sensors, BLOCK) as simulator:
        for k in range(120):
            drive(simulator, [(0.0, 0.0)], 0.1, first_period=k)
            place = complex(6.0 - 0.1 * (k + 1), 0.3)
            assert simulator.touching == [abs(place) <= 1.8]
            got = simulator.ranges()[0]
            inside = [abs(complex(mount.x_m, mount.y_m) - place) < 0.8 for mount in sensors.mounts]
            buried += sum(inside)
            assert (got[inside] == 0.0).all()
            assert_readings_are_analytic(got, sensors, pose_of(simulator), 1.0, [Round(place, 0.8)])
        assert [count.total for count in simulator.contacts] == [1]
        assert pose_of(simulator) == (0.0, 0.0, 0.0)
        drive(simulator, [(1.0, 0.0)], 0.1, first_period=120)
        assert pose_of(simulator).x_m == pytest.approx(0.1)
    assert buried > 50


# --- movers and trackers ---


def test_movers_are_where_their_schedule_puts_them_at_the_end_of_each_period() -> None:
    mover = to_and_fro((10.0, 0.0), (10.0, 4.0), (16.0, 4.0), speeds=[2.0, 3.0], radius_m=0.5, phase_s=0.7)
    world = a_world(movers=(mover,))
    with a_simulator(world, a_robot()) as simulator:
        for k in range(80):
            assert simulator.tracked_discs(0) == pytest.approx(world.disc_rows(0.137 * k), abs=1e-9)
            simulator.advance(0.137 * k, 0.137)


def test_the_tracker_sees_the_other_robots_with_their_velocities() -> None:
    starts = tuple(Start(x_m=9.0 * i, y_m=0.0, heading_rad=0.5 * math.pi * i) for i in range(3))
    with a_simulator(a_world(starts=starts, discs=(Disc(x_m=4.0, y_m=30.0, radius_m=2.0),)), a_robot()) as simulator:
        drive(simulator, [(0.6, 0.0)], 0.5)
        seen = simulator.tracked_discs(1)
        assert seen == pytest.approx(
            np.array([[4.0, 30.0, 2.0, 0.0, 0.0], [0.3, 0.0, 1.0, 0.6, 0.0], [17.7, 0.0, 1.0, -0.6, 0.0]]), abs=1e-9
        )


# --- episodes ---


@pytest.mark.parametrize("accel_mps2", [None, 0.8])
def test_a_reset_forgets_the_last_episode(accel_mps2: float | None) -> None:
    rng = np.random.default_rng(22)
    world = clutter(rng, 1.0, robots=3)
    with ExitStack() as stack:
        robot = a_robot(1.0, 1.0, accel_mps2)
        fresh, used = (stack.enter_context(a_simulator(world, robot, a_ring(8, 1.0, 6.0), BLOCK)) for _ in range(2))
        drive(used, [(1.0, 0.2)] * 60, 0.9)
        used.reset(used.scene, [Pose(start.x_m, start.y_m, start.heading_rad or 0.0) for start in world.starts])
        for k in range(60):
            for simulator in (fresh, used):
                drive(simulator, [(0.3, 0.4 * math.sin(k))], 0.9, first_period=k)
            assert fresh.robots.tobytes() == used.robots.tobytes()
            assert fresh.contacts == used.contacts
            assert fresh.ranges().tobytes() == used.ranges().tobytes()


def test_a_ring_without_sensors_reads_nothing() -> None:
    with a_simulator(a_world(discs=(Disc(x_m=2.5, y_m=0.0, radius_m=1.0),)), a_robot(), BLIND) as simulator:
        assert simulator.ranges().shape == (1, 0)
