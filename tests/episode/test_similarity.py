import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import Scripted, a_ring, a_runner, a_world, always, run, run_one, to_and_fro

from navbench.contract import Command, Observation
from navbench.episode.similarity import Native, Similarity, accel_max_mps2, native_setup, period_s
from navbench.records import RobotRecord
from navbench.robot import Robot
from navbench.sensors import Mount, Odometry, Sensors, Tracker
from navbench.world.layout import DrawnWorld, FinishLine, Start
from navbench.world.shapes import Bounds, Box, Disc, Point, Wall

KHEPERA = Robot(radius_m=0.065, track_m=0.0885, wheel_speed_max_mps=0.3333)
DISC = Robot(radius_m=4.0, track_m=7.0, wheel_speed_max_mps=4.0, wheel_accel_max_mps2=10.0)


def test_lambda_is_the_radii_and_tau_the_times_to_cross_a_radius() -> None:
    similarity = Similarity.between(DISC, Native(KHEPERA, 0.05))
    assert similarity.length == pytest.approx(4.0 / 0.065)
    assert similarity.time == pytest.approx((4.0 / 4.0) / (0.065 / 0.3333))
    assert not similarity.identity


def test_the_native_robot_and_no_native_robot_are_exactly_the_identity() -> None:
    assert Similarity.between(KHEPERA, Native(KHEPERA, 0.05)) == (1.0, 1.0)
    assert Similarity.between(DISC, None) == (1.0, 1.0)
    assert Similarity.between(DISC, None).identity
    heavier = replace(KHEPERA, track_m=0.1, wheel_accel_max_mps2=3.0)
    assert Similarity.between(heavier, Native(KHEPERA, 0.05)).identity


def test_the_control_period_is_the_native_one_times_tau_and_a_twentieth_without_a_native_robot() -> None:
    native = Native(KHEPERA, 0.05)
    similarity = Similarity.between(DISC, native)
    assert period_s(native, similarity) == pytest.approx(0.05 * 0.3333 / 0.065)
    assert period_s(None, Similarity(1.0, 1.0)) == 0.05
    assert native_setup(DISC, Sensors(drawn_for_radius_m=4.0, max_range_m=1.0), None).period_s == 0.05


def test_a_command_is_turned_into_the_worlds_units() -> None:
    assert Similarity(4.0, 0.5).to_world(Command(0.25, -3.0)) == pytest.approx((2.0, -6.0))


def test_the_setup_holds_the_episodes_robot_and_ring_in_native_units() -> None:
    native = Native(KHEPERA, 0.05)
    mount = Mount(role="ahead", x_m=8.0, y_m=-2.0, heading_rad=0.3, max_range_m=40.0)
    sensors = Sensors(drawn_for_radius_m=4.0, mounts=(mount,), min_range_m=1.0, max_range_m=60.0)
    setup = native_setup(DISC, sensors, native)
    length, time = 4.0 / 0.065, 0.3333 / 0.065
    assert setup.period_s == 0.05
    assert setup.robot.radius_m == pytest.approx(0.065)
    assert setup.robot.track_m == pytest.approx(7.0 / length)
    assert setup.robot.track_m != pytest.approx(KHEPERA.track_m, rel=0.1)
    assert setup.robot.wheel_speed_max_mps == pytest.approx(0.3333)
    assert setup.robot.wheel_accel_max_mps2 == pytest.approx(10.0 / length * time**2)
    (sensor,) = setup.sensors
    assert sensor.role == "ahead"
    assert sensor[1:] == pytest.approx((8.0 / length, -2.0 / length, 0.3, 1.0 / length, 40.0 / length))


def test_on_the_native_robot_the_setup_is_the_description_to_the_last_bit() -> None:
    sensors = a_ring(5, 0.065, 0.3, min_range_m=0.02)
    setup = native_setup(KHEPERA, sensors.scaled_to(0.065), Native(KHEPERA, 0.05))
    assert setup.robot == (0.065, 0.0885, 0.3333, None)
    assert [sensor[1:4] for sensor in setup.sensors] == [(m.x_m, m.y_m, m.heading_rad) for m in sensors.mounts]
    assert {sensor[4:] for sensor in setup.sensors} == {(0.02, 0.3)}


@pytest.mark.parametrize(
    ("own", "natives", "expected"),
    [
        (10.0, None, 10.0),
        (10.0, 0.7, 10.0),
        (None, 0.7, 0.7 * (4.0 / 0.065) / (0.3333 / 0.065) ** 2),
        (None, None, None),
    ],
)
def test_the_robots_own_acceleration_limit_stands_before_the_native_one_mapped(
    own: float | None, natives: float | None, expected: float | None
) -> None:
    robot = replace(DISC, wheel_accel_max_mps2=own)
    native = Native(replace(KHEPERA, wheel_accel_max_mps2=natives), 0.05)
    limit = accel_max_mps2(robot, native, Similarity.between(robot, native))
    assert limit == (None if expected is None else pytest.approx(expected))
    setup = native_setup(robot, Sensors(drawn_for_radius_m=4.0, max_range_m=1.0), native)
    if own is None:
        assert setup.robot.wheel_accel_max_mps2 == (None if natives is None else pytest.approx(natives))


def test_without_a_native_robot_only_the_robots_own_limit_is_in_force() -> None:
    assert accel_max_mps2(DISC, None, Similarity(1.0, 1.0)) == 10.0
    assert accel_max_mps2(KHEPERA, None, Similarity(1.0, 1.0)) is None


@pytest.mark.parametrize(("natives", "covered_m"), [(None, 4.0), (2.0, 4.0 - 0.5 * 4.0**2 / (2.0 * 0.5 / 0.125**2))])
def test_the_limit_in_force_is_the_one_that_moves_the_robot(natives: float | None, covered_m: float) -> None:
    """On lambda 0.5 and tau 0.125 the native limit of 2 m/s^2 is 64 m/s^2, and the wheels run up to 4 m/s."""
    big = Robot(radius_m=2.0, track_m=3.0, wheel_speed_max_mps=1.0, wheel_accel_max_mps2=natives)
    small = Robot(radius_m=1.0, track_m=1.5, wheel_speed_max_mps=4.0)
    assert Similarity.between(small, Native(big, 0.8)) == (0.5, 0.125)
    record = run_one(a_world(time_limit_s=1.0), always(1.0), robot=small, native=Native(big, 0.8))
    assert record.states[-1, 1] == pytest.approx(covered_m)


def test_a_suite_scaled_to_another_robot_scales_every_length_and_no_angle() -> None:
    sensors = Sensors(
        drawn_for_radius_m=2.0,
        mounts=(
            Mount(role="a", x_m=2.0, y_m=0.5, heading_rad=0.7, min_range_m=0.2, max_range_m=8.0),
            Mount(role="b", x_m=1.0, y_m=0.0, heading_rad=0.0, cone_half_angle_rad=0.3, rays=3),
        ),
        min_range_m=0.1,
        max_range_m=10.0,
        cone_half_angle_rad=0.2,
        rays=5,
        noise_std_m=0.4,
        dropout_probability=0.25,
        odometry=Odometry(travel_noise=0.1, wheel_scale_std=0.2),
        tracker=Tracker(range_m=20.0, position_noise_std_m=0.6),
    )
    assert sensors.scaled_to(2.0) is sensors
    assert sensors.scaled_to(1.0) == Sensors(
        drawn_for_radius_m=1.0,
        mounts=(
            Mount(role="a", x_m=1.0, y_m=0.25, heading_rad=0.7, min_range_m=0.1, max_range_m=4.0),
            Mount(role="b", x_m=0.5, y_m=0.0, heading_rad=0.0, cone_half_angle_rad=0.3, rays=3),
        ),
        min_range_m=0.05,
        max_range_m=5.0,
        cone_half_angle_rad=0.2,
        rays=5,
        noise_std_m=0.2,
        dropout_probability=0.25,
        odometry=Odometry(travel_noise=0.1, wheel_scale_std=0.2),
        tracker=Tracker(range_m=10.0, position_noise_std_m=0.3),
    )


# --- a scaled robot in a scaled world ---

BODY = Robot(radius_m=0.25, track_m=0.4, wheel_speed_max_mps=0.8, wheel_accel_max_mps2=1.5)
PERIOD_S = 0.1
SUITE = a_ring(
    8,
    0.25,
    2.0,
    min_range_m=0.02,
    cone_half_angle_rad=0.2,
    rays=3,
    noise_std_m=0.01,
    dropout_probability=0.02,
    odometry=Odometry(travel_noise=0.02, wheel_scale_std=0.01),
    tracker=Tracker(range_m=3.0, position_noise_std_m=0.02),
)


def react(seen: Observation) -> Command:
    """Turn to the goal and away from what is near, slow down before it: every input matters and none jumps."""
    x, y, heading = seen.pose
    bearing = math.atan2(seen.goal[1] - y, seen.goal[0] - x) - heading
    near = 1.0 / (seen.ranges_m + 0.1)
    away = near[1] + near[2] - near[6] - near[7]
    for disc in seen.discs.tolist():
        away += 0.05 * (disc[1] - y) + 0.02 * disc[3]
    w = 1.5 * math.sin(bearing) - 0.1 * away - 0.1 * seen.w_radps + 0.02 * math.sin(seen.t_s)
    return Command(0.7 - 0.04 * float(near[0]) + 0.05 * seen.v_mps, w)


def the_course(length: float, time: float, **changes: Any) -> DrawnWorld:
    """Return one course for two robots, all its lengths and times multiplied."""
    mover = to_and_fro(
        (3.0 * length, 2.0 * length), (3.0 * length, -2.0 * length),
        speeds=[0.3 * length / time], radius_m=0.2 * length, phase_s=3.0 * time,
    )  # fmt: skip
    values: dict[str, Any] = {
        "bounds": Bounds(x_min_m=-9.0 * length, x_max_m=9.0 * length, y_min_m=-9.0 * length, y_max_m=9.0 * length),
        "boxes": (
            Box(x_m=2.0 * length, y_m=1.2 * length, length_m=0.6 * length, width_m=0.4 * length, heading_rad=0.3),
        ),
        "discs": (Disc(x_m=2.2 * length, y_m=-0.8 * length, radius_m=0.4 * length),),
        "walls": (Wall(x1_m=0.0, y1_m=2.0 * length, x2_m=6.0 * length, y2_m=2.4 * length, thickness_m=0.1 * length),),
        "movers": (mover,),
        "starts": (Start(x_m=0.0, y_m=0.1 * length), Start(x_m=0.0, y_m=-2.0 * length, heading_rad=0.4)),
        "goals": (Point(x_m=5.5 * length, y_m=0.2 * length), Point(x_m=6.0 * length, y_m=-2.2 * length)),
        "goal_tolerance_m": 0.4 * length,
        "time_limit_s": 25.05 * time,
    }
    return a_world(**values | changes)


def drive_course(
    length: float, time: float, own_accel: bool = True, changes: Mapping[str, Any] = MappingProxyType({})
) -> list[RobotRecord]:
    robot = Robot(
        radius_m=BODY.radius_m * length,
        track_m=BODY.track_m * length,
        wheel_speed_max_mps=BODY.wheel_speed_max_mps * length / time,
        wheel_accel_max_mps2=1.5 * length / time**2 if own_accel else None,
    )
    return run(
        the_course(length, time, **changes),
        [Scripted(react), Scripted(react, lambda seen: {"x": seen.pose.x_m, "heading_error_rad": seen.w_radps})],
        robot=robot,
        sensors=SUITE,
        native=Native(BODY, PERIOD_S),
    )


def in_native_units(states: NDArray[np.float64], length: float, time: float) -> NDArray[np.float64]:
    native: NDArray[np.float64] = states / np.array([time, length, length, 1.0, length / time, 1.0 / time])
    return native


def assert_similar(scaled: Sequence[RobotRecord], native: Sequence[RobotRecord], length: float, time: float) -> None:
    for big, small in zip(scaled, native, strict=True):
        assert (big.outcome, big.reason) == (small.outcome, small.reason)
        assert big.states.shape == small.states.shape
        assert in_native_units(big.states, length, time) == pytest.approx(small.states, rel=1e-6, abs=1e-6)
        assert big.traces == pytest.approx(small.traces, rel=1e-6, abs=1e-6, nan_ok=True)
        assert big.metrics["path_length_m"] == pytest.approx(small.metrics["path_length_m"] * length, rel=1e-6)
        assert big.metrics["min_clearance_m"] == pytest.approx(
            small.metrics["min_clearance_m"] * length, rel=1e-6, abs=1e-6
        )
        assert big.metrics["time_s"] == pytest.approx(small.metrics["time_s"] * time, rel=1e-6)
        assert big.metrics["total_turning_rad"] == pytest.approx(small.metrics["total_turning_rad"], rel=1e-6)
        assert big.metrics["w_sign_changes"] == small.metrics["w_sign_changes"]
        assert big.metrics["heading_ise"] == pytest.approx(small.metrics["heading_ise"] * time, rel=1e-6)


@pytest.mark.parametrize("own_accel", [True, False])
@pytest.mark.parametrize(("length", "time"), [(16.0, 1.0), (16.0, 3.7), (1.0, 0.3), (0.25, 0.21)])
def test_a_scaled_robot_in_a_scaled_world_drives_the_scaled_way(length: float, time: float, own_accel: bool) -> None:
    native = drive_course(1.0, 1.0)
    assert {record.outcome for record in native} == {"reached"}
    assert min(len(record.states) for record in native) > 60
    assert_similar(drive_course(length, time, own_accel), native, length, time)


@pytest.mark.parametrize(("length", "time"), [(3.1, 1.7), (0.77, 0.4)])
def test_the_way_scales_too_where_pybullets_own_units_do_not(length: float, time: float) -> None:
    native, scaled = drive_course(1.0, 1.0), drive_course(length, time)
    for big, small in zip(scaled, native, strict=True):
        assert big.outcome == small.outcome
        n = min(len(big.states), len(small.states)) - 1
        assert big.states[:n, 1:3] / length == pytest.approx(small.states[:n, 1:3], abs=1e-3)


def test_collisions_scale_too() -> None:
    wall = {"walls": (Wall(x1_m=4.0, y1_m=-6.0, x2_m=4.0, y2_m=6.0, thickness_m=0.1),)}
    scaled = {"walls": (Wall(x1_m=32.0, y1_m=-48.0, x2_m=32.0, y2_m=48.0, thickness_m=0.8),)}
    native = drive_course(1.0, 1.0, changes=wall)
    assert {record.outcome for record in native} == {"collided"}
    assert_similar(drive_course(8.0, 1.3, changes=scaled), native, 8.0, 1.3)


def test_a_finish_line_scales_too() -> None:
    near = {"finish_line": FinishLine(x1_m=4.0, y1_m=-6.0, x2_m=4.3, y2_m=6.0)}
    far = {"finish_line": FinishLine(x1_m=32.0, y1_m=-48.0, x2_m=34.4, y2_m=48.0)}
    native = drive_course(1.0, 1.0, changes=near)
    assert {record.outcome for record in native} == {"reached"}
    assert_similar(drive_course(8.0, 1.3, changes=far), native, 8.0, 1.3)


def test_on_its_native_robot_a_controller_runs_as_without_any_similarity_to_the_last_bit() -> None:
    world = the_course(1.0, 1.0)
    kept = []
    for native in (Native(BODY, 0.05), None):
        controllers = [Scripted(react), Scripted(react)]
        records = run(world, controllers, robot=BODY, sensors=SUITE, native=native, period_s=None)
        kept.append(([record.states.tobytes() for record in records], [c.seen for c in controllers]))
    (states, seen), (plain_states, plain_seen) = kept
    assert states == plain_states
    for robot, plain_robot in zip(seen, plain_seen, strict=True):
        for one, other in zip(robot, plain_robot, strict=True):
            assert one[:5] == other[:5]
            assert one.ranges_m.tobytes() == other.ranges_m.tobytes()
            assert one.discs.tobytes() == other.discs.tobytes()


def test_goal_tolerance_and_time_limit_are_the_worlds_and_never_scaled() -> None:
    native = Native(Robot(radius_m=2.0, track_m=3.0, wheel_speed_max_mps=1.0), 0.5)
    small = Robot(radius_m=1.0, track_m=1.5, wheel_speed_max_mps=1.0)  # lambda and tau are 0.5
    world = a_world(goals=(Point(x_m=5.0, y_m=0.3),), goal_tolerance_m=0.31, time_limit_s=7.0)
    record = run_one(world, always(1.0), robot=small, native=native)
    assert record.outcome == "reached"
    assert record.metrics["time_s"] == pytest.approx(5.0 - math.sqrt(0.31**2 - 0.3**2))
    missed = run_one(a_world(time_limit_s=7.0), always(1.0), robot=small, native=native)
    assert (missed.outcome, missed.metrics["time_s"]) == ("timed_out", 7.0)


def test_the_sensors_are_scaled_from_the_robot_they_were_drawn_for_not_from_the_native_one() -> None:
    sensors = Sensors(
        drawn_for_radius_m=0.5, max_range_m=3.0, mounts=(Mount(role="a", x_m=0.5, y_m=0.0, heading_rad=0.0),)
    )
    native = Native(Robot(radius_m=0.25, track_m=0.4, wheel_speed_max_mps=1.0), 0.1)
    robot = Robot(radius_m=1.0, track_m=1.5, wheel_speed_max_mps=1.0)
    controller = always(0.0)
    world = a_world(discs=(Disc(x_m=5.0, y_m=0.0, radius_m=1.0),), time_limit_s=0.3)
    with a_runner(world, controller, robot=robot, sensors=sensors, native=native) as runner:
        runner.run(0)
    assert controller.setup is not None
    assert controller.setup.sensors[0].max_range_m == pytest.approx(6.0 / 4.0)
    assert controller.seen[0].ranges_m == pytest.approx([3.0 / 4.0], abs=1e-6)
