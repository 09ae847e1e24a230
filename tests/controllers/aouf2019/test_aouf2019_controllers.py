import copy
import functools
import math
import pickle
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from omegaconf import OmegaConf

from navbench.cli.catalogue import CONF
from navbench.cli.configuration import compose_cell
from navbench.contract import Body, Command, Controller, Observation, Pose, RangeSensor, Setup
from navbench.controllers.aouf2019 import equations as aouf2019
from navbench.controllers.aouf2019.behaviors import FOLLOW_WALL, GO_TO_GOAL, NO_SIDE, TRACE
from navbench.controllers.aouf2019.equations import LEFT, RIGHT, SENSOR_ROLES
from navbench.controllers.aouf2019.mixed import Mixed
from navbench.controllers.aouf2019.pid import Pid
from navbench.controllers.aouf2019.sflc import RULES, Sflc
from navbench.controllers.classical.go_to_goal import GoToGoal
from navbench.validation import DescriptionError

KINDS: dict[str, Any] = {"sflc": Sflc, "pid": Pid, "go_to_goal": GoToGoal, "mixed": Mixed}
PERIOD_S = 0.05
WINDOW = 20  # control periods of 0.05 s in the stall window of 1 s
FAR_M = 0.2  # a sensor that sees nothing
MOUNTS = (
    (-0.038, 0.048, 128),
    (0.019, 0.064, 75),
    (0.050, 0.050, 42),
    (0.070, 0.017, 13),
    (0.070, -0.017, -13),
    (0.050, -0.050, -42),
    (0.019, -0.064, -75),
    (-0.038, -0.048, -128),
    (-0.048, 0.0, 180),
)
SETUP = Setup(
    Body(0.065, 0.0885, 0.3333, None),
    tuple(
        RangeSensor(role, x, y, math.radians(heading), 0.02, FAR_M)
        for role, (x, y, heading) in zip(SENSOR_ROLES, MOUNTS, strict=True)
    ),
    PERIOD_S,
)
NONE = np.empty((0, 5))
MIRRORED = [7, 6, 5, 4, 3, 2, 1, 0, 8]  # the sensor that stands where a sensor's mirror image would


def build(name: str) -> dict[str, Any]:
    """Return the parameters of a controller's YAML."""
    parameters = copy.deepcopy(_composed(name))
    del parameters["_target_"]
    return parameters


@functools.cache
def _composed(name: str) -> dict[str, Any]:
    build: dict[str, Any] = compose_cell(f"controller={name}").configuration["controller"]["build"]
    return build


def make(name: str, behaviors: dict[str, Any] | None = None, **changes: Any) -> Any:
    """Return a controller with its YAML's parameters and these changes, after reset."""
    parameters = build(name)
    if name != "go_to_goal":
        parameters["behaviors"].update(behaviors or {})
    controller = KINDS[name](**(parameters | changes))
    controller.reset(SETUP, np.random.default_rng(0))
    return controller


def heading_error(controller: Any, observation: Observation) -> float:
    controller.act(observation)
    return float(controller.trace["heading_error_rad"])


def see(
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    goal: tuple[float, float] = (1.0, 0.0),
    ranges: dict[str, float] | None = None,
) -> Observation:
    """Return an observation in which the sensors that are not named see nothing."""
    ranges_m = np.array([(ranges or {}).get(role, FAR_M) for role in SENSOR_ROLES])
    return Observation(0.0, Pose(*pose), goal, 0.0, 0.0, ranges_m, False, np.zeros((0, 5)))


def mirrored(observation: Observation) -> Observation:
    x, y, heading = observation.pose
    goal_x, goal_y = observation.goal
    ranges = observation.ranges_m[MIRRORED]
    return observation._replace(pose=Pose(x, -y, -heading), goal=(goal_x, -goal_y), ranges_m=ranges)


def wander(seed: int, steps: int = 120) -> Iterator[Observation]:
    """Yield what a robot might see that stumbles towards its goal past walls on both sides."""
    rng = np.random.default_rng(seed)
    x, y, heading = 0.0, 0.0, rng.uniform(-math.pi, math.pi)
    ranges = rng.uniform(0.02, FAR_M, 9)
    for _ in range(steps):
        x, y, heading = x + rng.uniform(-0.01, 0.03), y + rng.uniform(-0.02, 0.02), heading + rng.uniform(-0.3, 0.3)
        ranges = np.clip(ranges + rng.uniform(-0.03, 0.03, 9), 0.02, FAR_M)
        pose = Pose(x, y, math.remainder(heading, 2.0 * math.pi))
        yield Observation(0.0, pose, (2.0, 0.5), 0.1, 0.0, ranges, False, np.zeros((0, 5)))


def drive(controller: Any, observations: Iterator[Observation]) -> list[tuple[Command, dict[str, float]]]:
    return [(controller.act(observation), dict(controller.trace)) for observation in observations]


# ---- equations 7 to 24 ----


def test_a_reading_becomes_a_point_in_the_robot_and_in_the_world() -> None:
    in_robot = aouf2019.to_robot_frame(aouf2019.frame(0.05, 0.05, math.pi / 2), aouf2019.sensor_point(0.1))
    assert in_robot == pytest.approx((0.05, 0.15))
    assert aouf2019.to_world_frame(aouf2019.frame(1.0, 2.0, math.pi / 2), in_robot) == pytest.approx((0.85, 2.05))


def test_a_transform_keeps_distances() -> None:
    a, b = (aouf2019.transform(aouf2019.frame(0.3, -0.7, 2.2), v) for v in ((1.0, 2.0), (-0.5, 0.25)))
    assert math.dist(a, b) == pytest.approx(math.dist((1.0, 2.0), (-0.5, 0.25)))


def test_the_avoidance_vector_weighs_vectors_from_the_robot_not_from_the_origin() -> None:
    points, weights = np.array([[5.2, 3.0], [5.0, 2.9]]), np.array([1.0, 2.0])
    assert aouf2019.avoidance_vector(points, weights, (5.0, 3.0)) == pytest.approx((0.2, -0.2))


@pytest.mark.parametrize("degrees", [0, 45, 135, 180, -45, -135])
def test_the_heading_of_a_vector_is_right_in_all_four_quadrants(degrees: int) -> None:
    angle = math.radians(degrees)
    assert aouf2019.heading_of((2.0 * math.cos(angle), 2.0 * math.sin(angle))) == pytest.approx(angle)


def test_the_goal_vector_points_from_the_robot_to_the_goal() -> None:
    assert aouf2019.goal_vector((-1.2, -1.2), (1.3, 1.0)) == pytest.approx((-2.5, -2.2))


def test_the_blend_depends_on_directions_not_on_lengths() -> None:
    assert aouf2019.blend((10.0, 0.0), (0.0, 0.1), 0.35) == pytest.approx((0.35, 0.65))
    assert aouf2019.blend((0.0, 0.0), (3.0, 4.0), 0.5) == pytest.approx((0.3, 0.4))


@pytest.mark.parametrize(
    ("wanted", "heading", "error"),
    [
        (3.0, -3.0, 6.0 - 2.0 * math.pi),
        (-3.0, 3.0, 2.0 * math.pi - 6.0),
        (math.pi / 2, -math.pi / 2, math.pi),
        (-math.pi / 2, math.pi / 2, math.pi),
        (0.5, 0.2, 0.3),
    ],
)
def test_the_heading_error_is_wrapped(wanted: float, heading: float, error: float) -> None:
    assert aouf2019.heading_error(wanted, heading) == pytest.approx(error)


def test_the_wall_points_from_the_rear_point_to_the_front_point() -> None:
    assert aouf2019.wall_vector((-0.1, 0.2), (0.2, 0.6)) == pytest.approx((0.3, 0.4))
    assert aouf2019.unit((0.3, 0.4)) == pytest.approx((0.6, 0.8))
    assert aouf2019.unit((0.0, 0.0)) == (0.0, 0.0)


def test_the_perpendicular_ends_on_the_wall() -> None:
    assert aouf2019.perpendicular_to_wall((1.0, 1.0), (3.0, 0.4), (1.0, 0.0)) == pytest.approx((0.0, 0.6))
    # the wall x + y = 2, seen from the origin along (1, -1): nearest at (1, 1)
    slanted = aouf2019.perpendicular_to_wall((3.0, -1.0), (0.0, 0.0), aouf2019.unit((1.0, -1.0)))
    assert slanted == pytest.approx((1.0, 1.0))


@pytest.mark.parametrize(("distance", "across"), [(0.25, 0.10), (0.15, 0.0), (0.05, -0.10)])
def test_following_turns_to_the_wall_when_too_far_and_away_when_too_near(distance: float, across: float) -> None:
    error = aouf2019.distance_error((0.0, distance), 0.15)
    assert error == pytest.approx((0.0, across))
    assert aouf2019.following_vector((1.0, 0.0), error, 0.15) == pytest.approx((0.15, across))


def test_the_distance_error_of_a_slanted_wall_lies_across_it() -> None:
    assert aouf2019.distance_error((0.3, 0.4), 0.15) == pytest.approx((0.21, 0.28))


# ---- what the arbitration decides ----


def points_of(ranges: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array(
        [
            aouf2019.to_robot_frame(aouf2019.frame(sensor.x_m, sensor.y_m, sensor.heading_rad), (reading, 0.0))
            for sensor, reading in zip(SETUP.sensors, ranges, strict=True)
        ]
    )


@pytest.mark.parametrize(
    ("near", "side", "rear", "front"),
    [
        ({}, LEFT, "rear_left", "left"),  # nothing in sight: both from the rear, so that it turns towards the wall
        ({}, RIGHT, "rear_right", "right"),
        ({"front_left_inner": 0.05, "front_left_outer": 0.04}, LEFT, "front_left_outer", "front_left_inner"),
        ({"front_left_inner": 0.04, "rear_left": 0.05}, LEFT, "rear_left", "front_left_inner"),
        ({"rear_left": 0.05}, LEFT, "rear_left", "left"),
        ({"front_right_inner": 0.05, "right": 0.04}, RIGHT, "right", "front_right_inner"),
        ({"front_right_outer": 0.05}, RIGHT, "rear_right", "front_right_outer"),
    ],
)
def test_the_wall_is_estimated_from_the_two_nearest_of_its_side(
    near: dict[str, float], side: float, rear: str, front: str
) -> None:
    ranges = see(ranges=near).ranges_m
    points = points_of(ranges)
    p_1, p_2 = aouf2019.wall_points(points, ranges, side)
    assert p_1 == pytest.approx(tuple(points[SENSOR_ROLES.index(rear)]))
    assert p_2 == pytest.approx(tuple(points[SENSOR_ROLES.index(front)]))


def test_sliding_means_between_the_goal_and_the_free_room() -> None:
    along = (1.0, 0.0)
    assert aouf2019.is_sliding((1.0, 1.0), (0.0, -2.0), along)  # the goal behind the wall on the left
    assert not aouf2019.is_sliding((1.0, -1.0), (0.0, -2.0), along)  # the goal on the free side
    assert not aouf2019.is_sliding((-1.0, 1.0), (0.0, -2.0), along)  # the goal behind
    assert not aouf2019.is_sliding((0.0, 1.0), (0.0, -2.0), along)  # parallel: no solution


def test_it_heads_straight_for_a_goal_ahead_when_nothing_is_in_sight() -> None:
    controller = make("sflc")
    assert heading_error(controller, see()) == pytest.approx(0.0, abs=1e-12)
    assert controller.trace["behavior"] == GO_TO_GOAL


def test_it_turns_away_from_what_is_near_on_one_side() -> None:
    assert heading_error(make("sflc"), see(ranges={"front_left_outer": 0.05, "left": 0.05})) < -0.1


def test_a_reading_below_unsafe_begins_wall_following_at_once() -> None:
    controller = make("sflc")
    heading_error(controller, see(ranges={"front_left_outer": 0.041}))
    assert controller.trace["behavior"] == GO_TO_GOAL
    heading_error(controller, see(ranges={"front_left_outer": 0.039}))
    assert (controller.trace["behavior"], controller.trace["unsafe"]) == (FOLLOW_WALL, 1.0)


@pytest.mark.parametrize("role", ["rear_left", "rear", "rear_right"])
def test_the_rear_sensors_begin_nothing(role: str) -> None:
    controller = make("sflc")
    for _ in range(3 * WINDOW):
        heading_error(controller, see(ranges={role: 0.02}))
    assert controller.trace["behavior"] == GO_TO_GOAL


def test_no_progress_before_an_obstacle_begins_wall_following_after_one_whole_window() -> None:
    controller = make("sflc")
    for _ in range(WINDOW):
        heading_error(controller, see(ranges={"left": 0.12}))
        assert controller.trace["behavior"] == GO_TO_GOAL
    heading_error(controller, see(ranges={"left": 0.12}))
    assert controller.trace["behavior"] == FOLLOW_WALL
    assert controller.trace["stalled"] == 1.0


def test_no_progress_away_from_obstacles_is_no_dead_end() -> None:
    controller = make("sflc")
    for _ in range(3 * WINDOW):
        heading_error(controller, see(ranges={"left": 0.131}))
    assert (controller.trace["behavior"], controller.trace["stalled"]) == (GO_TO_GOAL, 1.0)


@pytest.mark.parametrize(("goal", "expected"), [((1.0, 1.0), FOLLOW_WALL), ((1.0, -1.0), GO_TO_GOAL)])
def test_sliding_begins_wall_following_at_once_where_the_goal_is_beyond_the_obstacle(
    goal: tuple[float, float], expected: float
) -> None:
    controller = make("sflc", {"begins": "sliding"})
    heading_error(controller, see(goal=goal, ranges={"left": 0.12, "rear_left": 0.13}))
    assert controller.trace["behavior"] == expected
    assert controller.trace["stalled"] == 0.0


@pytest.mark.parametrize(("goal", "expected"), [((1.0, 1.0), FOLLOW_WALL), ((1.0, -1.0), GO_TO_GOAL)])
def test_by_the_letter_wall_following_begins_without_progress_and_with_the_goal_beyond(
    goal: tuple[float, float], expected: float
) -> None:
    controller = make("sflc", {"begins": "both"})
    for _ in range(WINDOW):
        heading_error(controller, see(goal=goal, ranges={"left": 0.12, "rear_left": 0.13}))
        assert controller.trace["behavior"] == GO_TO_GOAL
    heading_error(controller, see(goal=goal, ranges={"left": 0.12, "rear_left": 0.13}))
    assert (controller.trace["behavior"], controller.trace["stalled"]) == (expected, 1.0)


@pytest.mark.parametrize(("progress_from", "expected"), [("best", 4.0), ("switch", 5.0)])
def test_progress_counts_from_the_best_distance_or_from_the_switch(progress_from: str, expected: float) -> None:
    controller = make("sflc", {"progress_from": progress_from})
    heading_error(controller, see((1.0, 0.0, 0.0), (5.0, 0.0)))
    heading_error(controller, see((0.0, 0.0, 0.0), (5.0, 0.0), {"left": 0.03}))  # set back
    assert controller.trace["behavior"] == FOLLOW_WALL
    assert controller.trace["progress_distance_m"] == pytest.approx(expected)


@pytest.mark.parametrize(("over_the_window_m", "expected"), [(0.051, GO_TO_GOAL), (0.049, FOLLOW_WALL)])
def test_progress_is_judged_over_the_window(over_the_window_m: float, expected: float) -> None:
    controller = make("sflc")
    for k in range(3 * WINDOW):
        heading_error(controller, see((k * over_the_window_m / WINDOW, 0.0, 0.0), (5.0, 0.0), {"left": 0.12}))
    assert controller.trace["behavior"] == expected


def test_only_what_is_nearer_than_ever_is_progress() -> None:
    controller = make("sflc")
    heading_error(controller, see((1.0, 0.0, 0.0), (5.0, 0.0)))
    for k in range(2 * WINDOW):
        heading_error(controller, see((0.01 * k, 0.0, 0.0), (5.0, 0.0)))  # set back, and nearing the goal again
    heading_error(controller, see((0.01 * 2 * WINDOW, 0.0, 0.0), (5.0, 0.0), {"left": 0.12}))
    assert controller.trace["behavior"] == FOLLOW_WALL


@pytest.mark.parametrize(("near", "side"), [("front_left_inner", LEFT), ("front_right_outer", RIGHT)])
def test_it_keeps_the_wall_on_the_side_of_the_nearest_sensor(near: str, side: float) -> None:
    controller = make("sflc")
    # the goal lies on the wall's side, where a tie would send the robot the other way
    heading_error(
        controller, see(goal=(0.0, side), ranges={near: 0.03, SENSOR_ROLES[MIRRORED[SENSOR_ROLES.index(near)]]: 0.036})
    )
    assert controller.trace["side"] == side


@pytest.mark.parametrize(("goal_y", "side"), [(0.5, RIGHT), (-0.5, LEFT), (0.0, LEFT)])
def test_between_equally_near_sides_it_goes_round_by_the_goals_side(goal_y: float, side: float) -> None:
    controller = make("sflc")
    ahead = {"front_left_inner": 0.03, "front_right_inner": 0.03, "front_left_outer": 0.06, "front_right_outer": 0.06}
    heading_error(controller, see(goal=(0.5, goal_y), ranges=ahead))
    assert controller.trace["side"] == side


WALL_ON_THE_LEFT = {"rear_left": 0.07, "left": 0.06}


def following(goal: tuple[float, float]) -> Any:
    """Return behaviours that follow a wall on the left, entered at the origin."""
    controller = make("sflc")
    heading_error(controller, see(goal=goal, ranges=WALL_ON_THE_LEFT | {"front_left_outer": 0.03}))
    assert (controller.trace["behavior"], controller.trace["side"]) == (FOLLOW_WALL, LEFT)
    return controller


@pytest.mark.parametrize(("x", "expected"), [(0.099, FOLLOW_WALL), (0.101, GO_TO_GOAL)])
def test_wall_following_ends_nearer_to_the_goal_than_ever(x: float, expected: float) -> None:
    controller = following((2.0, 0.0))
    heading_error(controller, see((-0.5, 0.0, 0.0), (2.0, 0.0), WALL_ON_THE_LEFT))  # further away in between
    assert controller.trace["progress_distance_m"] == pytest.approx(2.0)
    heading_error(controller, see((x, 0.0, 0.6), (2.0, 0.0), WALL_ON_THE_LEFT))
    assert controller.trace["sliding"] == 0.0
    assert controller.trace["behavior"] == expected
    assert controller.trace["side"] == (LEFT if expected == FOLLOW_WALL else NO_SIDE)


def test_wall_following_goes_on_while_the_robot_slides() -> None:
    controller = following((2.0, 1.0))
    heading_error(controller, see((0.5, 0.0, 0.0), (2.0, 1.0), WALL_ON_THE_LEFT))
    assert (controller.trace["progress_made"], controller.trace["sliding"]) == (1.0, 1.0)
    assert controller.trace["behavior"] == FOLLOW_WALL


def test_the_trace_has_the_names_of_the_memory_in_its_order() -> None:
    controller = following((2.0, 0.0))
    assert tuple(controller.trace) == TRACE
    assert controller.trace["behavior"] == FOLLOW_WALL


def test_the_step_that_ends_wall_following_already_blends() -> None:
    controller, fresh = following((2.0, 0.0)), make("sflc")
    release = see((0.2, 0.0, 0.6), (2.0, 0.0), WALL_ON_THE_LEFT)
    assert heading_error(controller, release) == heading_error(fresh, release)
    assert controller.trace["behavior"] == GO_TO_GOAL


def test_after_wall_following_a_dead_end_takes_a_whole_window_again() -> None:
    controller = following((2.0, 0.0))
    stuck = see((0.2, 0.0, 0.6), (2.0, 0.0), WALL_ON_THE_LEFT)
    for _ in range(1 + WINDOW):
        heading_error(controller, stuck)
        assert controller.trace["behavior"] == GO_TO_GOAL
    heading_error(controller, stuck)
    assert controller.trace["behavior"] == FOLLOW_WALL


def test_following_a_wall_at_its_distance_heads_along_it() -> None:
    controller = make("sflc", {"unsafe_m": 0.06})
    # a wall at y = 0.15: what the two rear sensors of the left side read
    wall = {
        "rear_left": (0.15 - 0.048) / math.sin(math.radians(128)),
        "left": (0.15 - 0.064) / math.sin(math.radians(75)),
    }
    heading_error(controller, see(ranges=wall | {"front_left_inner": 0.05}))
    assert controller.trace["behavior"] == FOLLOW_WALL
    assert heading_error(controller, see(ranges=wall, goal=(0.0, 5.0))) == pytest.approx(0.0, abs=1e-9)


# ---- the fuzzy law ----

SURFACE = [  # heading error [deg], turning rate [rad/s], speed [m/s]
    (0, 0.0, 0.2222),
    (9, 0.6, 0.2222),
    (13.5, 0.9, 0.1667),
    (18, 1.2, 0.1111),
    (22.5, 1.5, 0.0978),
    (27, 1.8, 0.037),
    (36, 2.4, 0.037),
    (45, 2.801, 0.037),
    (120, 2.801, 0.037),
    (180, 2.801, 0.037),
]


def straight(name: str, **changes: Any) -> Any:
    """Return a controller whose heading error is the bearing of the goal, whatever the sensors read."""
    return make(name, behaviors={"blend_alpha": 1.0}, **changes)


def bearing(angle: float) -> Observation:
    return see(pose=(0.0, 0.0, -angle))


@pytest.mark.parametrize(("degrees", "turn", "speed"), SURFACE)
def test_the_control_surface_is_the_documented_one(degrees: float, turn: float, speed: float) -> None:
    command = straight("sflc").act(bearing(math.radians(degrees)))
    assert command.w_radps == pytest.approx(turn, abs=2e-3)
    assert command.v_mps == pytest.approx(speed, abs=2e-4)


def test_the_turning_rate_is_odd_and_grows_with_the_heading_error() -> None:
    controller = straight("sflc")
    errors = np.linspace(0.0, math.pi, 300)
    left = [controller.act(bearing(error)) for error in errors]
    right = [controller.act(bearing(-error)) for error in errors[:-1]]
    assert [command.w_radps for command in right] == pytest.approx(
        [-command.w_radps for command in left[:-1]], abs=1e-9
    )
    assert [command.v_mps for command in right] == pytest.approx([command.v_mps for command in left[:-1]], abs=1e-9)
    assert (np.diff([command.w_radps for command in left]) >= -1e-9).all()


def test_table_2_is_symmetric_in_every_row() -> None:
    opposite = {name: name.replace("N", "+").replace("P", "N").replace("+", "P") for name, _, _ in RULES}
    assert {opposite[error]: (speed, opposite[turn]) for error, speed, turn in RULES} == {
        error: (speed, turn) for error, speed, turn in RULES
    }


def test_the_fuzzy_law_is_the_same_in_both_behaviours() -> None:
    controller = make("sflc")
    for near in ({}, {"front_left_outer": 0.03}):
        command = controller.act(see(ranges=near))
        assert tuple(command) == controller.inference(controller.trace["heading_error_rad"])
    assert controller.trace["behavior"] == FOLLOW_WALL


# ---- the PID law ----


def test_the_pid_law_is_the_discrete_one_of_equation_25() -> None:
    controller = straight("pid", kp=2.0, ki=0.5, kd=0.1)
    # e = 0.1, 0.2, 0.15: 0.2 + 0.0025 + 0; 0.4 + 0.0075 + 0.2; 0.3 + 0.01125 - 0.1
    turns = [controller.act(bearing(error)).w_radps for error in (0.1, 0.2, 0.15)]
    assert turns == pytest.approx([0.2025, 0.6075, 0.21125])
    assert controller.trace["proportional_radps"] == pytest.approx(0.3)
    assert controller.trace["integral_radps"] == pytest.approx(0.01125)
    assert controller.trace["differential_radps"] == pytest.approx(-0.1)


def test_a_limited_step_does_not_count_in_the_sum() -> None:
    controller = straight("pid", kp=2.0, ki=0.5, kd=0.0)
    assert controller.act(bearing(0.1)).w_radps == pytest.approx(0.2025)
    assert controller.act(bearing(-2.0)).w_radps == -3.0
    assert controller.act(bearing(2.0)).w_radps == 3.0
    assert controller.act(bearing(2.1)).w_radps == 3.0
    assert controller.trace["turn_limited"] == 1.0
    assert controller.act(bearing(0.2)).w_radps == pytest.approx(0.4 + 0.5 * 0.05 * 0.3)
    assert controller.trace["turn_limited"] == 0.0


def test_a_switch_forgets_the_sum_and_skips_one_difference() -> None:
    controller = make("pid", kp=1.0, ki=0.5, kd=0.01)
    for _ in range(5):
        controller.act(see(pose=(0.0, 0.0, 0.3)))
    controller.act(see(ranges={"front_left_outer": 0.03}))
    first = controller.trace
    assert first["behavior"] == FOLLOW_WALL
    assert first["heading_error_rad"] != 0.0
    assert first["integral_radps"] == pytest.approx(0.5 * 0.05 * first["heading_error_rad"])
    assert first["differential_radps"] == 0.0
    controller.act(see(ranges={"front_left_outer": 0.05}))
    second = controller.trace
    change = second["heading_error_rad"] - first["heading_error_rad"]
    assert change != 0.0
    assert second["differential_radps"] == pytest.approx(0.01 * change / PERIOD_S)


def test_an_error_that_passes_pi_is_no_jump() -> None:
    controller = straight("pid", kp=0.0, ki=0.0, kd=0.1)
    controller.act(bearing(3.1))
    assert controller.act(bearing(-3.1)).w_radps == pytest.approx(0.1 * (2.0 * math.pi - 6.2) / PERIOD_S)


def test_a_new_episode_begins_without_a_difference() -> None:
    controller = straight("pid")
    for error in (0.3, -0.2):
        controller.act(bearing(error))
        assert controller.trace["differential_radps"] == 0.0
        controller.reset(SETUP, np.random.default_rng(0))


def test_the_pid_drives_at_the_quotient_of_tables_4_and_3() -> None:
    times = [37.1, 23.9, 12.2, 36.35, 22.45, 9.0, 33.95, 21.0, 7.5]
    distances = [5.565, 3.585, 1.83, 5.4525, 3.3675, 1.35, 5.0925, 3.15, 1.125]
    controller = make("pid")
    speeds = {controller.act(observation).v_mps for observation in wander(0)}
    assert len(speeds) == 1
    assert np.divide(distances, times) == pytest.approx(speeds.pop())


# ---- the floor ----


@pytest.mark.parametrize(("angle", "turn"), [(0.0, 0.0), (0.2, 1.0), (-0.2, -1.0), (1.0, 3.0), (-3.0, -3.0)])
def test_go_to_goal_turns_in_proportion_to_the_heading_error_within_its_limit(angle: float, turn: float) -> None:
    command = make("go_to_goal").act(bearing(angle))
    assert command == pytest.approx(Command(0.15, turn))


def test_go_to_goal_turns_the_short_way_round() -> None:
    beside = see(pose=(0.0, 0.0, 3.0), goal=(math.cos(-3.0), math.sin(-3.0)))
    assert make("go_to_goal").act(beside).w_radps == pytest.approx(5.0 * (2.0 * math.pi - 6.0))


def test_go_to_goal_ignores_its_sensors() -> None:
    blind, seeing = make("go_to_goal"), make("go_to_goal")
    assert blind.act(see(ranges=dict.fromkeys(SENSOR_ROLES, 0.02))) == seeing.act(see())


# ---- all of them ----


@pytest.mark.parametrize("name", KINDS)
def test_it_keeps_the_contract(name: str) -> None:
    assert isinstance(make(name), Controller)


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("seed", range(8))
def test_a_mirrored_observation_gets_the_mirrored_command(name: str, seed: int) -> None:
    # The one asymmetry is the left where both sides are exactly equal; random readings never are.
    controller, mirror = make(name), make(name)
    for observation in wander(seed):
        command, reflected = controller.act(observation), mirror.act(mirrored(observation))
        assert reflected == pytest.approx(Command(command.v_mps, -command.w_radps), abs=1e-9)


def test_wandering_visits_both_behaviours_and_both_sides() -> None:
    visited = {
        (trace["behavior"], trace["side"]) for seed in range(8) for _, trace in drive(make("sflc"), wander(seed))
    }
    assert visited == {(GO_TO_GOAL, NO_SIDE), (FOLLOW_WALL, LEFT), (FOLLOW_WALL, RIGHT)}


@pytest.mark.parametrize("name", KINDS)
def test_reset_forgets_the_last_episode(name: str) -> None:
    controller = make(name)
    first = drive(controller, wander(1))
    controller.reset(SETUP, np.random.default_rng(5))
    assert drive(controller, wander(1)) == first
    assert first != drive(controller, wander(2))


@pytest.mark.parametrize("name", KINDS)
def test_a_pickled_controller_goes_on_where_it_was(name: str) -> None:
    never_reset = KINDS[name](**build(name))
    copy = pickle.loads(pickle.dumps(never_reset))
    copy.reset(SETUP, np.random.default_rng(0))
    assert drive(copy, wander(3)) == drive(make(name), wander(3))
    original = make(name)
    drive(original, wander(3, steps=60))
    resumed = pickle.loads(pickle.dumps(original))
    assert drive(resumed, wander(4)) == drive(original, wander(4))


@pytest.mark.parametrize("name", KINDS)
def test_the_trace_has_the_same_finite_numbers_at_every_step(name: str) -> None:
    traces = [trace for _, trace in drive(make(name), wander(6))]
    assert {tuple(trace) for trace in traces} == {tuple(traces[0])}
    assert "heading_error_rad" in traces[0]
    assert all(type(value) is float and math.isfinite(value) for trace in traces for value in trace.values())


@pytest.mark.parametrize("name", KINDS)
def test_a_pose_that_is_no_number_is_answered_by_none(name: str) -> None:
    assert math.isnan(make(name).act(bearing(math.nan)).w_radps)


@pytest.mark.parametrize("name", ["sflc", "pid"])
def test_another_ring_of_sensors_is_refused(name: str) -> None:
    controller = make(name)
    for sensors in ((), SETUP.sensors[::-1], SETUP.sensors[:-1]):
        with pytest.raises(ValueError, match="needed are rear_left, left"):
            controller.reset(SETUP._replace(sensors=sensors), np.random.default_rng(0))


def test_the_sensors_file_has_the_roles_that_the_controllers_need() -> None:
    mounts = OmegaConf.load(CONF / "sensors" / "khepera3_ir.yaml").mounts
    assert tuple(mount.role for mount in mounts) == Sflc.sensor_roles == Pid.sensor_roles


def test_mounts_are_read_from_the_setup() -> None:
    turned = SETUP._replace(sensors=tuple(s._replace(heading_rad=-s.heading_rad) for s in SETUP.sensors))
    as_drawn, other = make("sflc"), make("sflc")
    other.reset(turned, np.random.default_rng(0))
    observation = see(ranges={"front_left_outer": 0.05})
    assert heading_error(as_drawn, observation) != heading_error(other, observation)


def test_the_sensor_weights_follow_their_formula() -> None:
    weights = build("sflc")["behaviors"]["sensor_weights"]
    expected = {s.role: 1.0 + 0.4 * abs(s.heading_rad) / math.pi for s in SETUP.sensors}
    assert weights == pytest.approx(expected, abs=5e-5)


@pytest.mark.parametrize("name", ["sflc", "pid"])
@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        ("blend_alpha", 1.01),
        ("blend_alpha", math.nan),
        ("wall_distance_m", 0.0),
        ("at_obstacle_m", math.inf),
        ("unsafe_m", 0.5),
        ("stall_window_s", "1.0"),
        ("stall_min_progress_m", -0.1),
        ("progress_epsilon_m", None),
        ("sensor_weights", {"left": 1.0}),
        ("wall_distnace_m", 0.15),
    ],
)
def test_a_wrong_behaviour_parameter_is_named(name: str, parameter: str, value: object) -> None:
    with pytest.raises(ValueError, match=parameter):
        make(name, behaviors={parameter: value})


@pytest.mark.parametrize(
    ("name", "parameter", "value"),
    [
        ("pid", "kp", -1.0),
        ("pid", "ki", math.nan),
        ("pid", "kd", "much"),
        ("pid", "speed_mps", 0.0),
        ("pid", "turn_limit_radps", math.inf),
        ("go_to_goal", "speed_mps", -0.1),
        ("go_to_goal", "gain_per_s", math.nan),
        ("go_to_goal", "turn_limit_radps", 0.0),
        ("sflc", "speed_peaks_mps", {"S": 0.0, "M": 0.1, "L": 0.2}),
        ("sflc", "speed_peaks_mps", {"S": -0.1, "M": 0.1, "L": 0.2, "VL": 0.3}),
        ("sflc", "turn_peaks_radps", {name: 0.0 for name, _, _ in RULES}),
        ("sflc", "heading_error_peaks_rad", {name: float(i) for i, (name, _, _) in enumerate(RULES)}),
        ("sflc", "heading_error_peaks_rad", {name: math.nan for name, _, _ in RULES}),
    ],
)
def test_a_wrong_parameter_is_named(name: str, parameter: str, value: Any) -> None:
    with pytest.raises(ValueError, match=parameter):
        make(name, **{parameter: value})


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("controller=pid controller.build.kp=-1", "kp=-1: must be greater than or equal to 0"),
        ("controller=pid +controller.build.kq=1", "kq: unknown key; allowed here: _target_, behaviors, kp, ki, kd, "),
        ("controller=pid ~controller.build.kp", "kp: missing; a value is needed"),
        (
            "controller=sflc +controller.build.behaviors.unsaf_m=1",
            "behaviors.unsaf_m: unknown key; did you mean unsafe_m",
        ),
        ("controller=sflc controller.build.behaviors=3", "behaviors=3: must be a mapping"),
        ("controller=sflc controller.build.speed_peaks_mps=3", "speed_peaks_mps=3: must be a mapping"),
        ("controller=sflc controller.build.speed_peaks_mps.S=-0.2", "speed_peaks_mps: must not be negative"),
        ("controller=mixed controller.build.fuzzy_turn_in=[fly]", "fuzzy_turn_in=['fly']: must be a list of any of "),
    ],
)
def test_what_is_wrong_in_a_file_is_said_in_one_line(words: str, message: str) -> None:
    with pytest.raises(DescriptionError, match=re.escape(f"controller.build.{message}")) as raised:
        compose_cell(*words.split(" "))
    assert "\n" not in str(raised.value)


LAWS_OF_BOTH = ["go_to_goal", "follow_wall"]


@pytest.mark.parametrize(
    ("turn", "speed", "turns_as", "drives_as"),
    [
        (LAWS_OF_BOTH, LAWS_OF_BOTH, "sflc", "sflc"),
        ([], [], "pid", "pid"),
        ([], LAWS_OF_BOTH, "pid", "sflc"),
        (LAWS_OF_BOTH, [], "sflc", "pid"),
    ],
)
def test_mixed_laws_are_the_laws_that_they_are_mixed_of(
    turn: list[str], speed: list[str], turns_as: str, drives_as: str
) -> None:
    mixed = make("mixed", fuzzy_turn_in=turn, fuzzy_speed_in=speed)
    turning, driving = make(turns_as), make(drives_as)
    rng = np.random.default_rng(5)
    behaviors = set()
    for k in range(200):
        ranges = rng.uniform(0.02, 0.2, 9)
        look = Observation(
            0.05 * k, Pose(*rng.uniform(-1.0, 1.0, 3).tolist()), (1.0, 0.5), 0.0, 0.0, ranges, False, NONE
        )
        command = mixed.act(look)
        assert command.w_radps == turning.act(look).w_radps
        assert command.v_mps == driving.act(look).v_mps
        behaviors.add(mixed.trace["behavior"])
    assert behaviors == {GO_TO_GOAL, FOLLOW_WALL}


def test_mixed_laws_change_with_the_behaviour() -> None:
    only_goal = make("mixed", fuzzy_turn_in=["go_to_goal"], fuzzy_speed_in=["go_to_goal"])
    fuzzy, pid = make("sflc"), make("pid")
    for ranges in (np.full(9, 0.2), np.full(9, 0.03)):  # the second is unsafe, so the wall is followed
        look = Observation(0.0, Pose(0.0, 0.0, 0.2), (1.0, 0.5), 0.0, 0.0, ranges, False, NONE)
        command, by_fuzzy, by_pid = only_goal.act(look), fuzzy.act(look), pid.act(look)
        assert by_fuzzy != by_pid
        assert command == (by_fuzzy if only_goal.trace["behavior"] == GO_TO_GOAL else by_pid)
    assert only_goal.trace["behavior"] == FOLLOW_WALL


def test_mixed_refuses_a_behaviour_that_does_not_exist() -> None:
    with pytest.raises(ValueError, match=r"fuzzy_turn_in=\['fly'\]: must be a list of any of go_to_goal, follow_wall"):
        make("mixed", fuzzy_turn_in=["fly"])
