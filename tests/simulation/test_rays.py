"""Rays: readings are analytic, and PyBullet is asked only for those that decide them."""

import gc
import math
import sys
from typing import Any

import numpy as np
import pytest
from scenes import BLOCK, IDEAL, RADII, a_ring, a_robot, a_simulator, a_world, again, pose_of
from shapes import RAY_TOLERANCE_RADII, assert_readings_are_analytic, clutter, shapes_of

from navbench.contract import Pose
from navbench.sensors import RAYS_MAX, Mount, Sensors
from navbench.simulation.base import Simulator
from navbench.simulation.options import SimulatorOptions
from navbench.world.layout import DrawnWorld, Start
from navbench.world.shapes import Box, Disc, Point, Polygon, Wall

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
                for i, state in enumerate(simulator.states()):
                    if state.running and k % 3 == 0:  # the check takes much longer than the drive
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


@pytest.mark.parametrize("heading_rad", [0.0, 2.1])
@pytest.mark.parametrize("radius_m", RADII)
def test_a_ray_from_outside_its_own_hull_sees_through_it_what_lies_beyond(radius_m: float, heading_rad: float) -> None:
    """Looking back from afar, from the rim, and past the hull; beyond stand a disc and another robot."""
    r = radius_m
    places = {
        "afar": (3.0, 0.0),
        "rim": (1.0, 0.0),
        "aslant": (3.0, 0.5),
        "past": (3.0, 1.0),
        "near past": (3.0, 1.005),
    }
    mounts = tuple(Mount(role=role, x_m=x * r, y_m=y * r, heading_rad=math.pi) for role, (x, y) in places.items())
    turn = complex(math.cos(heading_rad), math.sin(heading_rad))
    sensors = Sensors(drawn_for_radius_m=r, mounts=mounts, max_range_m=20.0 * r)
    for x, size in ((-6.0, 2.0), (-4.0, 1.0)):
        beyond = turn * complex(x, -0.3) * r
        poses, changes = [Pose(0.0, 0.0, heading_rad)], {"discs": (Disc(beyond.real, beyond.imag, size * r),)}
        if size == 1.0:
            poses, changes = [*poses, Pose(beyond.real, beyond.imag, 0.0)], {}
        starts = tuple(Start(pose.x_m, pose.y_m, 0.0) for pose in poses)
        with a_simulator(a_world(starts=starts, **changes), a_robot(r), sensors, poses=poses) as simulator:
            seen = [
                begin - x - math.sqrt(size**2 - (y + 0.3) ** 2) if y + 0.3 < size else 20.0
                for begin, y in places.values()
            ]
            for _ in range(2):
                assert simulator.ranges()[0] / r == pytest.approx(seen, abs=RAY_TOLERANCE_RADII)


def test_a_robot_that_sees_through_its_own_hull_is_seen_by_others_as_ever() -> None:
    mount = Mount(role="back", x_m=3.0, y_m=0.0, heading_rad=math.pi)
    sensors = Sensors(drawn_for_radius_m=1.0, mounts=(mount,), max_range_m=20.0)
    with a_simulator(
        two_robots(-8.0), a_robot(), sensors, poses=[Pose(0.0, 0.0, 0.0), Pose(-8.0, 0.0, math.pi)]
    ) as both:
        for _ in range(2):
            assert both.ranges()[:, 0] == pytest.approx([10.0, 10.0], abs=1e-6)


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
    rays: Any = simulator.rays
    rays.deciding = lambda robots, *_: rays.all_of(robots)
    return simulator


@pytest.mark.parametrize("on_collision", ["end", "block"])
@pytest.mark.parametrize("radius_m", RADII)
@pytest.mark.parametrize("cone", [{}, {"cone_half_angle_rad": 0.3, "rays": 5}])
def test_asking_pybullet_only_for_what_decides_changes_nothing(
    cone: dict[str, Any], radius_m: float, on_collision: str
) -> None:
    def history(world: DrawnWorld, always: bool, seed: int) -> list[object]:
        rng = np.random.default_rng(seed)
        kept: list[object] = []
        options = BLOCK if on_collision == "block" else IDEAL
        sensors = a_ring(9, radius_m, 4.0 * radius_m, 1.1, **cone)
        with a_simulator(world, a_robot(radius_m, radius_m), sensors, options) as s:
            if always:
                cautious(s)
            for k in range(40):
                states = s.states()
                ranges = s.ranges().tolist()
                kept.append([(i, ranges[i]) for i, state in enumerate(states) if state.running])
                for i in range(len(states)):
                    s.command(i, rng.uniform(-0.5, 1.0) * radius_m, rng.uniform(-2.0, 2.0))
                kept.append(
                    [s.advance(0.3 * k, 0.3), s.touching, s.contacts, [pose_of(s, i) for i in range(len(states))]]
                )
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
            deciding = simulator.rays.deciding(simulator.robots, scene.boxes, scene.discs, scene.polygons)
            (asked[name],) = simulator.rays.split(deciding, 1)
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


def two_robots(second_x_m: float, **changes: object) -> DrawnWorld:
    """Return a robot at the origin and one ahead of it, both looking ahead."""
    starts = (Start(x_m=0.0, y_m=0.0, heading_rad=0.0), Start(x_m=second_x_m, y_m=0.0, heading_rad=0.0))
    return a_world(starts=starts, **changes)


def test_a_robot_that_arrives_within_a_substep_is_seen_where_it_arrived() -> None:
    goals = (Point(x_m=500.0, y_m=0.0), Point(x_m=6.95, y_m=0.0))
    with a_simulator(two_robots(6.8, goals=goals, goal_tolerance_m=0.01), a_robot(), AHEAD) as simulator:
        simulator.command(1, 1.0, 0.0)
        assert [event.outcome for event in simulator.advance(0.0, 0.25)] == ["reached"]
        assert reading_towards(simulator) == pytest.approx(4.94, abs=1e-6)


def test_a_robot_that_is_blocked_within_a_substep_is_seen_where_it_is_held() -> None:
    wall = Wall(x1_m=7.8, y1_m=-9.0, x2_m=7.8, y2_m=9.0, thickness_m=0.2)
    with a_simulator(two_robots(6.6, walls=(wall,)), a_robot(), AHEAD, BLOCK) as simulator:
        simulator.command(1, 1.0, 0.0)
        simulator.advance(0.0, 0.25)
        assert simulator.touching == [False, True]
        assert reading_towards(simulator) == pytest.approx(4.7, abs=1e-6)


def test_polygons_of_many_episodes_leave_nothing_behind() -> None:
    corners = tuple(Point(x_m=x, y_m=y) for x, y in ((20.5, 0.5), (19.5, 0.5), (19.5, -0.5), (20.5, -0.5)))
    world, held = a_world(polygons=(Polygon(corners=corners),) * 5), []
    with a_simulator(world, a_robot()) as simulator:
        for _ in range(3):
            for _ in range(50):
                again(simulator, [Pose(0.0, 0.0, 0.0)])
            gc.collect()
            held.append(sys.getallocatedblocks())
    assert held[2] - held[1] < 500, "PyBullet kept the corners of 250 meshes, 2000 lists of three numbers"
