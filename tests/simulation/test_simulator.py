"""The simulator: contacts, substeps, the drive, blocking, movers and trackers."""

import math
from contextlib import ExitStack

import numpy as np
import pytest
from scenes import (
    BLIND,
    BLOCK,
    RADII,
    a_ring,
    a_robot,
    a_simulator,
    a_world,
    again,
    drive,
    pose_of,
    reset,
    to_and_fro,
)
from shapes import Round, assert_readings_are_analytic, clearance, clutter, shapes_of

from navbench.contract import Pose
from navbench.mathematics.kinematics import advance_arc
from navbench.records import Thing
from navbench.simulation.base import Simulator
from navbench.simulation.options import SimulatorOptions
from navbench.world.layout import Start
from navbench.world.shapes import Box, Disc, Wall


def wheels_of(simulator: Simulator) -> tuple[float, float]:
    """Return the speeds of a robot's wheels."""
    state = simulator.states()[0]
    return state.left_mps, state.right_mps


def travelled(simulator: Simulator) -> tuple[float, float]:
    """Return how far a robot has driven and turned."""
    state = simulator.states()[0]
    return state.path_length_m, state.turning_rad


# --- contacts ---


@pytest.mark.parametrize("radius_m", RADII)
def test_the_clearance_is_the_analytic_one_outside_things_and_in_them(radius_m: float) -> None:
    rng = np.random.default_rng(15)
    found = []
    for _ in range(15):
        world = clutter(rng, radius_m, robots=2, movers=1)
        other = Pose(world.starts[1].x_m, world.starts[1].y_m, 0.0)
        shapes = shapes_of(world, radius_m, [other], 0.0, but=-1)
        with a_simulator(world, a_robot(radius_m)) as simulator:
            for x, y in (rng.uniform(-12.0, 12.0, (40, 2)) * radius_m).tolist():
                again(simulator, [Pose(x, y, rng.uniform(-3.0, 3.0)), other])
                found.append(simulator.states()[0].clearance_m / radius_m)
                assert found[-1] == pytest.approx(clearance(shapes, complex(x, y), radius_m) / radius_m, abs=1e-9)
    assert min(found) < -1.0
    assert max(found) > 1.0


@pytest.mark.parametrize("radius_m", RADII)
def test_contacts_are_right_beside_things_that_are_huge_or_tiny(radius_m: float) -> None:
    """Across to it and away from it, from afar, from the edge and from inside; and along it, aslant by a hair."""
    big, small, hair = 50.0 * radius_m, 1e-3 * radius_m, 1e-9 * radius_m
    things: list[dict[str, object]] = [
        {"walls": (Wall(x1_m=-big, y1_m=0.0, x2_m=big, y2_m=0.0, thickness_m=2.0 * small),)},
        {"boxes": (Box(x_m=0.0, y_m=small - big, length_m=2.0 * big, width_m=2.0 * big),)},
        {"discs": (Disc(x_m=0.0, y_m=small - big, radius_m=big),)},
        {"discs": (Disc(x_m=0.0, y_m=0.0, radius_m=small),)},
    ]
    start = (Start(x_m=0.0, y_m=3.0 * radius_m, heading_rad=0.0),)
    for thing in things:
        with a_simulator(a_world(starts=start, **thing), a_robot(radius_m, radius_m)) as simulator:
            cases = [
                (0.5 * radius_m, -0.5 * math.pi, True),
                (0.0, -0.5 * math.pi, True),
                (0.0, 0.5 * math.pi, False),
                (-0.2 * radius_m, -0.5 * math.pi, True),
                (-0.2 * radius_m, 0.5 * math.pi, False),
            ]
            if "discs" not in thing:  # which it would leave by driving straight on
                cases += [(hair, 0.0, False), (hair, -2e-9, True), (hair, 2e-9, False)]
            for gap, heading_rad, hits in cases:
                again(simulator, [Pose(0.0, small + radius_m + gap, heading_rad)])
                assert bool(drive(simulator, [(radius_m, 0.0)], 1.0)) == hits, (thing, gap, heading_rad)


def test_an_end_by_contact_names_what_was_hit_and_when() -> None:
    world = a_world(
        boxes=(Box(x_m=9.0, y_m=9.0, length_m=1.0, width_m=1.0), Box(x_m=2.0, y_m=0.0, length_m=1.0, width_m=1.0)),
        walls=(Wall(x1_m=-3.0, y1_m=1.5, x2_m=-3.0, y2_m=4.5, thickness_m=0.1),),
        discs=(Disc(x_m=0.0, y_m=-3.0, radius_m=1.0),),
        movers=(to_and_fro((-9.0, -9.0), (-9.0, 0.0), speeds=[0.1], radius_m=1.0),),
    )
    down = -0.5 * math.pi
    cases = {
        "box 1": (Pose(0.0, 0.0, 0.0), 0.5),
        "wall 0": (Pose(-1.5, 3.0, math.pi), 0.45),
        "disc 0": (Pose(0.0, -0.5, down), 0.5),
        "mover 0": (Pose(-9.0, -6.0, down), 1.0 / 1.1),
    }
    with a_simulator(world, a_robot()) as simulator:
        for name, (pose, touch_s) in cases.items():
            again(simulator, [pose])
            (event,) = drive(simulator, [(1.0, 0.0)] * 10, 0.1)
            assert (event.outcome, str(event.hit)) == ("collided", name)
            assert event.t_s == pytest.approx(touch_s, abs=1e-9)


# --- substeps ---


@pytest.mark.parametrize("radius_m", RADII)
def test_a_fast_robot_with_a_period_of_2_s_hits_a_thin_wall_where_it_stands(radius_m: float) -> None:
    rng = np.random.default_rng(16)
    speed = 30.0 * radius_m
    for _ in range(20):
        face = rng.uniform(2.0, 50.0) * radius_m
        turn = rng.uniform(-0.5, 0.5)
        dx, dy = 99.0 * radius_m * math.sin(turn), 99.0 * radius_m * math.cos(turn)
        wall = Wall(x1_m=face + dx, y1_m=-dy, x2_m=face - dx, y2_m=dy, thickness_m=1e-3 * radius_m)
        with a_simulator(a_world(walls=(wall,)), a_robot(radius_m, speed)) as simulator:
            (event,) = drive(simulator, [(speed, 0.0)], 2.0)
            touch_m = face - (radius_m + 0.5e-3 * radius_m) / math.cos(turn)
            assert event.outcome == "collided"
            assert speed * event.t_s == pytest.approx(touch_m, abs=1e-9 * radius_m)
            assert pose_of(simulator).x_m == pytest.approx(touch_m, abs=1e-9 * radius_m)


@pytest.mark.parametrize("radius_m", RADII)
def test_a_fast_tiny_mover_does_not_pass_a_standing_robot_unnoticed(radius_m: float) -> None:
    rng = np.random.default_rng(17)
    speed, small = 40.0 * radius_m, 0.01 * radius_m
    for _ in range(20):
        far, aside = rng.uniform(5.0, 60.0) * radius_m, rng.uniform(-1.009, 1.009) * radius_m
        mover = to_and_fro((far, aside), (-10.0 * far, aside), speeds=[speed], radius_m=small)
        with a_simulator(a_world(movers=(mover,)), a_robot(radius_m)) as simulator:
            (event,) = drive(simulator, [(0.0, 0.0)], 2.0)
            touch_s = (far - math.sqrt((radius_m + small) ** 2 - aside**2)) / speed
            assert event.hit == Thing("mover", 0)
            assert event.t_s == pytest.approx(touch_s, abs=1e-9)


def test_two_fast_robots_do_not_pass_through_each_other() -> None:
    rng = np.random.default_rng(18)
    for _ in range(20):
        gap = rng.uniform(3.0, 60.0)
        starts = (Start(x_m=0.0, y_m=0.0, heading_rad=0.0), Start(x_m=gap, y_m=0.0, heading_rad=math.pi))
        with a_simulator(a_world(starts=starts), a_robot(speed_mps=20.0)) as simulator:
            events = drive(simulator, [(20.0, 0.0)], 2.0)
            assert [str(event.hit) for event in events] == ["robot 1", "robot 0"]
            assert events[0].t_s == events[1].t_s == pytest.approx((gap - 2.0) / 40.0, abs=1e-9)


@pytest.mark.parametrize("moving", ["robot", "mover"])
def test_the_least_clearance_is_taken_each_quarter_of_a_radius_that_something_moves(moving: str) -> None:
    """Passing a post, a robot or a mover is at most an eighth of a radius from where it was nearest."""
    rng = np.random.default_rng(19)
    worst = 0.0
    for _ in range(60):
        far, aside, speed = rng.uniform(5.0, 50.0), rng.uniform(1.1, 1.5), rng.uniform(1.0, 30.0)
        post = {"discs": (Disc(x_m=far, y_m=aside, radius_m=0.01),)}
        mover = {"movers": (to_and_fro((far, aside), (-99.0, aside), speeds=[speed], radius_m=0.01),)}
        with a_simulator(a_world(**(post if moving == "robot" else mover)), a_robot(speed_mps=speed)) as simulator:
            assert drive(simulator, [(speed if moving == "robot" else 0.0, 0.0)], 60.0 / speed) == []
            least = simulator.states()[0].min_clearance_m + 1.01
        assert aside - 1e-9 <= least <= math.hypot(aside, 0.125) + 1e-9
        worst = max(worst, least - aside)
    assert worst > 0.002


@pytest.mark.parametrize("v_mps", [1.0, 10.0])
def test_a_blocked_robot_is_held_until_a_substep_ends_that_is_as_long_as_the_command_allows(v_mps: float) -> None:
    """It touches a mover that leaves it at 0.2 m/s, and follows it by no more than the substeps that are left."""
    mover = to_and_fro((3.0, 0.0), (900.0, 0.0), speeds=[0.2], radius_m=1.0)
    with a_simulator(a_world(movers=(mover,)), a_robot(speed_mps=10.0), options=BLOCK) as simulator:
        drive(simulator, [(v_mps, 0.0)] * 4, 0.5)
        behind = 3.0 + 0.2 * 2.0 - 2.0 - pose_of(simulator).x_m
        assert 0.0 <= behind <= 0.2 * (0.25 / v_mps) + 1e-9
        assert pose_of(simulator).x_m > 1.0 + 0.2 * (1.0 if v_mps == 1.0 else 1.9)


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
            assert wheels_of(simulator) == pytest.approx((left, right))
            expected = advance_arc(0.0, 0.0, 0.0, 0.5 * (left + right), (right - left) / robot.track_m, 0.3)
            assert pose_of(simulator) == pytest.approx(expected, abs=1e-12)


def test_the_ideal_drive_follows_the_closed_form_arc_for_10_s_whatever_the_substeps() -> None:
    for speed in (0.02, 1.0, 25.0):
        with a_simulator(a_world(), a_robot(1.0, 2.0 * speed)) as simulator:
            drive(simulator, [(speed, 0.1 * speed)] * 20, 0.5)
            x, y, heading = advance_arc(0.0, 0.0, 0.0, speed, 0.1 * speed, 10.0)
            assert pose_of(simulator)[:2] == pytest.approx((x, y), abs=1e-9)
            assert math.remainder(pose_of(simulator).heading_rad - heading, 2.0 * math.pi) == pytest.approx(0, abs=1e-9)
            assert travelled(simulator) == pytest.approx((10.0 * speed, speed), rel=1e-12)


def test_no_wheel_accelerates_beyond_the_limit() -> None:
    rng = np.random.default_rng(20)
    with a_simulator(a_world(), a_robot(1.0, 2.0, accel_mps2=1.5)) as simulator:
        before, limited = np.zeros(2), 0
        for k in range(200):
            simulator.command(0, rng.uniform(-2.0, 2.0), rng.uniform(-2.0, 2.0))
            simulator.advance(0.2 * k, 0.2)
            after = np.array(wheels_of(simulator))
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
        assert wheels_of(simulator) == pytest.approx((1.5, 1.5))


@pytest.mark.parametrize("period_s", [0.05, 0.5, 2.0])
def test_a_turn_under_the_acceleration_limit_follows_fine_integration(period_s: float) -> None:
    rng = np.random.default_rng(21)
    radius, accel, n = 1.0, 0.7, 100_000
    robot = a_robot(radius, 1.0, accel)
    with a_simulator(a_world(), robot) as simulator:
        for k in range(10):
            row = simulator.states()[0]
            targets = rng.uniform(-1.0, 1.0, 2)
            times = (np.arange(n) + 0.5) * period_s / n
            wheels = [
                now + np.sign(target - now) * np.minimum(accel * times, abs(target - now))
                for now, target in zip((row.left_mps, row.right_mps), targets, strict=True)
            ]
            turning = (wheels[1] - wheels[0]) / robot.track_m
            headings = row.heading_rad + (np.cumsum(turning) - 0.5 * turning) * period_s / n
            x = row.x_m + float((0.5 * (wheels[0] + wheels[1]) * np.cos(headings)).mean()) * period_s
            y = row.y_m + float((0.5 * (wheels[0] + wheels[1]) * np.sin(headings)).mean()) * period_s
            simulator.command(0, 0.5 * targets.sum(), (targets[1] - targets[0]) / robot.track_m)
            simulator.advance(k * period_s, period_s)
            pose = pose_of(simulator)
            assert math.hypot(pose.x_m - x, pose.y_m - y) < 1e-2 * radius
            turned = pose.heading_rad - row.heading_rad - float(turning.mean()) * period_s
            assert math.remainder(turned, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


def limited(lag_s: float, delay_s: float) -> SimulatorOptions:
    return SimulatorOptions(drive="limited", motor_lag_s=lag_s, command_delay_s=delay_s)


@pytest.mark.parametrize("period_s", [0.05, 0.4, 2.0])
def test_the_motor_lag_is_a_first_order_lag(period_s: float) -> None:
    lag, v = 0.5, 0.9
    with a_simulator(a_world(), a_robot(), options=limited(lag, 0.0)) as simulator:
        drive(simulator, [(v, 0.0)] * round(4.0 / period_s), period_s)
        assert wheels_of(simulator) == pytest.approx([v * (1.0 - math.exp(-4.0 / lag))] * 2)
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
            speeds.append(simulator.states()[0].left_mps)
    assert max(np.diff(speeds)) == pytest.approx(0.05, abs=1e-12)
    assert speeds[-1] == pytest.approx(1.0, abs=1e-6)


# --- blocking ---

WALL = Wall(x1_m=5.1, y1_m=-50.0, x2_m=5.1, y2_m=50.0, thickness_m=0.1)  # its face stands at 5.05


def test_a_blocked_robot_is_held_where_it_hit() -> None:
    with a_simulator(a_world(walls=(WALL,)), a_robot(), options=BLOCK) as simulator:
        assert drive(simulator, [(1.0, 0.0)] * 60, 0.1) == []
        assert pose_of(simulator) == pytest.approx((4.05, 0.0, 0.0), abs=1e-9)
        assert wheels_of(simulator) == (0.0, 0.0)
        assert travelled(simulator) == pytest.approx((4.05, 0.0), abs=1e-9)
        assert simulator.touching == [True]


def test_a_blocked_robots_turning_and_way_count_only_what_it_did() -> None:
    with a_simulator(a_world(walls=(WALL,)), a_robot(), options=BLOCK) as simulator:
        drive(simulator, [(0.9, 0.05)] * 80, 0.1)
        x, y, heading = pose_of(simulator)
        assert simulator.touching == [True]
        assert heading == pytest.approx(math.asin(4.05 / 18.0), abs=1e-9)
        assert simulator.states()[0].turning_rad == pytest.approx(heading, rel=1e-9)
        assert simulator.states()[0].path_length_m == pytest.approx(heading * 0.9 / 0.05, rel=1e-9)
        assert (x, y) == pytest.approx((18.0 * math.sin(heading), 18.0 * (1.0 - math.cos(heading))), abs=1e-9)


def test_an_unbroken_push_counts_once_and_a_second_one_once_more() -> None:
    with a_simulator(a_world(walls=(WALL,)), a_robot(), options=BLOCK) as simulator:
        drive(simulator, [(1.0, 0.0)] * 60, 0.1)
        assert [count.total for count in simulator.contacts] == [1]
        drive(simulator, [(-1.0, 0.0)] * 5, 0.1, first_period=60)
        assert simulator.touching == [False]
        assert pose_of(simulator).x_m == pytest.approx(3.55, abs=1e-9)
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
        assert pose_of(simulator) == pytest.approx((4.05, 0.0, 1.0), abs=1e-9)
        assert simulator.touching == [True]
        drive(simulator, [(-0.5, 0.0)], 0.1, first_period=60)
        assert simulator.touching == [False]
        assert pose_of(simulator)[:2] == pytest.approx((4.05 - 0.05 * math.cos(1.0), -0.05 * math.sin(1.0)), abs=1e-9)


def test_two_robots_that_push_each_other_are_both_held_and_both_counted_once() -> None:
    starts = (Start(x_m=0.0, y_m=0.0, heading_rad=0.0), Start(x_m=4.5, y_m=0.0, heading_rad=math.pi))
    with a_simulator(a_world(starts=starts), a_robot(), options=BLOCK) as simulator:
        assert drive(simulator, [(1.0, 0.0)] * 30, 0.1) == []
        assert pose_of(simulator, 0).x_m == pytest.approx(1.25, abs=1e-9)
        assert pose_of(simulator, 1).x_m == pytest.approx(3.25, abs=1e-9)
        assert [count.total for count in simulator.contacts] == [1, 1]
        drive(simulator, [(-1.0, 0.0)] * 3, 0.1, first_period=30)
        assert pose_of(simulator, 0).x_m == pytest.approx(0.95, abs=1e-9)
        assert simulator.touching == [False, False]


def test_a_robot_that_follows_a_blocked_one_is_never_held_inside_it() -> None:
    starts = (Start(x_m=0.0, y_m=0.0, heading_rad=0.0), Start(x_m=-2.02, y_m=0.0, heading_rad=0.0))
    with a_simulator(a_world(starts=starts, walls=(WALL,)), a_robot(), options=BLOCK) as simulator:
        for k in range(60):
            drive(simulator, [(1.0, 0.0)], 0.1, first_period=k)
            assert pose_of(simulator, 0).x_m - pose_of(simulator, 1).x_m > 2.0 - 1e-9
        assert [count.total for count in simulator.contacts] == [1, 1]
        drive(simulator, [(-0.1, 0.0)], 0.1, first_period=60)
        assert simulator.touching == [True, True]  # both leave the wall, and not each other
        simulator.command(1, -0.2, 0.0)
        simulator.advance(6.1, 0.1)
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
        reset(used, world, [Pose(start.x_m, start.y_m, start.heading_rad or 0.0) for start in world.starts])
        for k in range(60):
            for simulator in (fresh, used):
                drive(simulator, [(0.3, 0.4 * math.sin(k))], 0.9, first_period=k)
            assert fresh.robots.tobytes() == used.robots.tobytes()
            assert fresh.contacts == used.contacts
            assert fresh.ranges().tobytes() == used.ranges().tobytes()


def test_a_ring_without_sensors_reads_nothing() -> None:
    with a_simulator(a_world(discs=(Disc(x_m=2.5, y_m=0.0, radius_m=1.0),)), a_robot(), BLIND) as simulator:
        assert simulator.ranges().shape == (1, 0)
