import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from scenes import BLOCK, STAND, Scripted, a_robot, a_world, always, run, run_one, schedule, to_and_fro

from navbench.contract import Command
from navbench.metrics import bearing_errors, sign_changes
from navbench.world.layout import Start
from navbench.world.shapes import Disc, Point, Wall

WALL = Wall(x1_m=5.1, y1_m=-50.0, x2_m=5.1, y2_m=50.0, thickness_m=0.1)  # its face stands at 5.05


def measured(commands: Sequence[tuple[float, float]], period_s: float, **changes: Any) -> Mapping[str, float]:
    """Return the metrics of a robot of radius 1 that is given these commands, one a period, and then stands."""
    options = {key: changes.pop(key) for key in ("robot", "options") if key in changes}
    changes.setdefault("time_limit_s", len(commands) * period_s)
    controller = schedule(commands, period_s)
    return run_one(a_world(**changes), controller, period_s=period_s, **options).metrics


@pytest.mark.parametrize(
    ("values", "changes"),
    [
        ([], 0),
        ([0.0, 0.0], 0),
        ([1.0, 2.0, 3.0], 0),
        ([1.0, -1.0, 1.0], 2),
        ([0.0, -1.0, 0.0], 0),
        ([1.0, 0.0, -1.0, 0.0, 0.0, -2.0, 1e-9, 0.0, 0.5, -0.0, -0.1], 3),
    ],
)
def test_a_sign_change_is_counted_across_zeros_and_never_to_or_from_one(values: list[float], changes: int) -> None:
    assert sign_changes(np.array(values)) == changes


def test_the_bearing_error_takes_the_short_way_round() -> None:
    poses = np.array([[0.0, 0.0, 3.0], [0.0, 0.0, -3.0], [1.0, 1.0, 0.5], [0.0, 4.0, 0.0]])
    errors = bearing_errors(poses, -10.0, 0.0)
    assert errors == pytest.approx(
        [math.pi - 3.0, 3.0 - math.pi, math.atan2(-1.0, -11.0) - 0.5 + 2.0 * math.pi, math.atan2(-4.0, -10.0)]
    )


def test_every_metric_of_a_way_worked_by_hand() -> None:
    commands = [(1.0, 0.0)] * 2 + [(0.0, 1.0)] * 2 + [(-0.5, 0.0)] * 2 + [(0.6, -0.4)] * 2
    disc = Disc(x_m=1.0, y_m=-3.5, radius_m=0.5)  # below the turning point, and the way back leads up and left
    metrics = measured(commands, 0.5, time_limit_s=5.0, discs=(disc,))
    assert metrics["path_length_m"] == pytest.approx(1.0 + 0.5 + 0.6)
    assert metrics["time_s"] == 5.0
    assert metrics["collisions"] == 0
    assert metrics["mean_speed_mps"] == pytest.approx(2.1 / 5.0)
    assert metrics["total_turning_rad"] == pytest.approx(1.0 + 0.4)
    assert metrics["w_sign_changes"] == 1
    x, y = 1.0 - 0.5 * math.cos(1.0), -0.5 * math.sin(1.0)
    clearances = [math.hypot(1.0, 3.5), 3.5, math.hypot(x - 1.0, y + 3.5)]
    assert metrics["min_clearance_m"] == pytest.approx(min(clearances) - 1.5)


def test_turning_across_half_a_turn_adds_only_what_was_turned() -> None:
    for turning in (0.7, -0.7):
        start = (Start(x_m=0.0, y_m=0.0, heading_rad=math.copysign(3.0, turning)),)
        metrics = measured([(0.0, turning)] * 100, 0.1, starts=start)
        assert metrics["total_turning_rad"] == pytest.approx(7.0)
        assert metrics["path_length_m"] == 0.0


def test_turning_to_and_fro_over_half_a_turn_adds_up_and_changes_sign_each_time() -> None:
    start = (Start(x_m=0.0, y_m=0.0, heading_rad=math.pi),)
    metrics = measured([(0.2, 0.5), (0.2, -0.5)] * 20, 0.1, starts=start)
    assert metrics["total_turning_rad"] == pytest.approx(2.0)
    assert metrics["w_sign_changes"] == 39


def test_turning_is_the_wheels_doing_so_a_clipped_command_counts_as_it_was_driven() -> None:
    metrics = measured([(1.0, 0.4)] * 10, 0.1)
    assert metrics["total_turning_rad"] == pytest.approx((1.0 - 0.7) / 1.5)
    assert metrics["path_length_m"] == pytest.approx(0.85)


def test_standing_between_two_turns_to_opposite_sides_is_one_sign_change() -> None:
    commands = [(0.5, 0.3), (0.5, 0.0), (0.0, 0.0), (0.5, -0.3), (0.5, 0.0), (0.5, -0.1)]
    assert measured(commands, 0.2)["w_sign_changes"] == 1


def test_turning_slower_than_the_dead_band_is_no_turning_and_changes_no_sign() -> None:
    assert sign_changes(np.array([0.3, 1e-17, -1e-17, -9e-10, 0.3])) == 0
    assert sign_changes(np.array([0.3, -1.1e-9, 0.3, 0.0, -1e-6])) == 3
    chatter = [(0.5, 9e-10), (0.5, -9e-10)] * 5
    assert measured(chatter, 0.2)["w_sign_changes"] == 0
    assert measured([(v, 2.0 * w) for v, w in chatter], 0.2)["w_sign_changes"] == 9


def test_reversing_adds_to_the_way() -> None:
    metrics = measured([(1.0, 0.0), (-1.0, 0.0)] * 5, 0.1)
    assert metrics["path_length_m"] == pytest.approx(1.0)
    assert metrics["mean_speed_mps"] == pytest.approx(1.0)


def test_a_failed_robot_keeps_its_way_and_its_time() -> None:
    metrics = measured([(1.0, 0.0)] * 80, 0.1, walls=(WALL,))
    assert metrics["path_length_m"] == pytest.approx(4.05)
    assert metrics["time_s"] == pytest.approx(4.05)
    assert metrics["mean_speed_mps"] == pytest.approx(1.0)
    assert metrics["collisions"] == 1
    assert metrics["min_clearance_m"] == pytest.approx(0.0, abs=1e-9)


def test_a_robot_that_never_arrives_keeps_its_way_and_the_time_limit() -> None:
    metrics = measured([(0.5, 0.0)] * 4, 0.5, time_limit_s=9.0)
    assert (metrics["path_length_m"], metrics["time_s"]) == pytest.approx((1.0, 9.0))
    assert metrics["mean_speed_mps"] == pytest.approx(1.0 / 9.0)


def test_a_robot_that_arrives_counts_its_way_up_to_the_instant_of_arrival() -> None:
    metrics = measured([(1.0, 0.0)] * 80, 0.1, goals=(Point(x_m=3.33, y_m=0.005),), goal_tolerance_m=0.01)
    entered = 3.33 - math.sqrt(0.01**2 - 0.005**2)
    got = metrics["path_length_m"], metrics["time_s"], metrics["mean_speed_mps"]
    assert got == pytest.approx((entered, entered, 1.0))


def test_a_robot_that_begins_at_its_goal_needs_no_time() -> None:
    metrics = measured([(1.0, 0.5)] * 8, 0.1, goals=(Point(x_m=0.0, y_m=0.0),))
    assert metrics["time_s"] == 0.0
    assert metrics["path_length_m"] == pytest.approx(0.0, abs=1e-12)
    assert metrics["total_turning_rad"] == pytest.approx(0.0, abs=1e-12)
    assert (metrics["mean_speed_mps"], metrics["heading_ise"], metrics["w_sign_changes"]) == (0.0, 0.0, 0)


def test_the_least_clearance_is_that_of_the_nearest_instant() -> None:
    metrics = measured([(1.0, 0.0)] * 30 + [(-1.0, 0.0)] * 30, 0.1, walls=(WALL,))
    assert metrics["min_clearance_m"] == pytest.approx(1.05)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.4, 0.5, 0.6, 0.8])
def test_a_least_clearance_is_off_by_no_more_than_the_documentation_says(share: float) -> None:
    post = Disc(x_m=5.0 + 0.25 * share, y_m=1.6, radius_m=0.5)  # which the robot of radius 1 passes at 0.1
    passing = measured([(1.0, 0.0)] * 40, 0.25, discs=(post,))["min_clearance_m"]
    assert 0.1 - 1e-9 <= passing <= 0.1 + 0.03
    nearest = 0.3 - 0.25 * share  # of a mover that turns back there
    mover = to_and_fro((10.0, 0.0), (1.5 + nearest, 0.0), speeds=[1.0, 1.0], radius_m=0.5, cyclic=True)
    turning = measured([(0.0, 0.0)] * 80, 0.25, movers=(mover,))["min_clearance_m"]
    assert nearest - 1e-9 <= turning <= nearest + 0.125 + 1e-9


def test_where_nothing_is_there_is_no_least_clearance() -> None:
    assert math.isnan(measured([(1.0, 0.0)] * 10, 0.1)["min_clearance_m"])


def test_the_start_counts_for_the_least_clearance() -> None:
    assert measured([(-1.0, 0.0)] * 10, 0.1, walls=(WALL,))["min_clearance_m"] == pytest.approx(4.05)


def test_the_least_clearance_of_a_standing_robot_is_that_to_a_passing_mover() -> None:
    mover = to_and_fro((5.0, 3.0), (-50.0, 3.0), speeds=[1.0], radius_m=0.5)
    metrics = measured([(0.0, 0.0)] * 80, 0.25, movers=(mover,))
    assert metrics["min_clearance_m"] == pytest.approx(1.5)


def test_the_least_clearance_counts_other_robots_even_those_that_have_ended() -> None:
    starts = (Start(x_m=0.0, y_m=0.0, heading_rad=0.0), Start(x_m=4.0, y_m=0.0, heading_rad=0.0))
    goals = (Point(x_m=1.5, y_m=0.0), Point(x_m=4.05, y_m=0.0))
    first, second = run(a_world(starts=starts, goals=goals, goal_tolerance_m=0.01), always(0.5))
    assert (first.outcome, second.outcome) == ("reached", "reached")
    assert first.metrics["min_clearance_m"] == pytest.approx(4.04 - 1.49 - 2.0, abs=1e-9)
    assert second.metrics["min_clearance_m"] == pytest.approx(2.0)


def test_what_lies_beyond_the_instant_of_arrival_does_not_count_for_the_least_clearance() -> None:
    goal = {"goals": (Point(x_m=3.81, y_m=0.0),), "goal_tolerance_m": 0.005}
    metrics = measured([(1.0, 0.0)] * 20, 0.25, walls=(WALL,), **goal)
    assert metrics["time_s"] == pytest.approx(3.805)
    assert metrics["min_clearance_m"] == pytest.approx(5.05 - 3.805 - 1.0)


def test_a_blocked_robots_metrics_stand_still() -> None:
    commands = [(0.9, 0.1)] * 150
    first = measured(commands[:70], 0.1, walls=(WALL,), options=BLOCK)
    second = measured(commands, 0.1, walls=(WALL,), options=BLOCK)
    assert first["collisions"] == second["collisions"] == 1
    assert second["path_length_m"] == pytest.approx(first["path_length_m"])
    assert second["total_turning_rad"] == pytest.approx(first["total_turning_rad"])
    assert first["total_turning_rad"] == pytest.approx(first["path_length_m"] / 9.0)
    assert second["w_sign_changes"] == 0
    assert second["time_s"] == pytest.approx(15.0)


def test_a_second_push_is_a_second_collision() -> None:
    commands = [(1.0, 0.0)] * 60 + [(-1.0, 0.0)] * 10 + [(1.0, 0.0)] * 20
    assert measured(commands, 0.1, walls=(WALL,), options=BLOCK)["collisions"] == 2


def test_an_accelerating_robots_way_is_that_of_constant_acceleration() -> None:
    metrics = measured([(1.0, 0.0)] * 40, 0.1, robot=a_robot(1.0, 1.0, accel_mps2=0.5))
    assert metrics["path_length_m"] == pytest.approx(0.5 * 0.5 * 2.0**2 + 2.0)


# --- the heading error ---


def test_without_a_trace_the_heading_error_is_the_goals_bearing_from_the_true_pose() -> None:
    start = (Start(x_m=0.0, y_m=0.0, heading_rad=0.3),)
    assert measured([(0.0, 0.0)] * 100, 0.1, starts=start)["heading_ise"] == pytest.approx(0.09 * 10.0)


def test_the_heading_error_of_a_cut_last_period_counts_for_its_true_length() -> None:
    start = (Start(x_m=0.0, y_m=0.0, heading_rad=0.3),)
    metrics = measured([(0.0, 0.0)] * 11, 0.1, starts=start, time_limit_s=1.03)
    assert metrics["heading_ise"] == pytest.approx(0.09 * 1.03)


def test_the_heading_error_is_held_over_each_period() -> None:
    metrics = measured([(0.0, 0.2)] * 50, 0.1)
    assert metrics["heading_ise"] == pytest.approx(sum((0.02 * k) ** 2 * 0.1 for k in range(50)))


def test_a_trace_of_the_heading_error_stands_before_the_bearing() -> None:
    controller = Scripted(lambda _: STAND, lambda seen: {"other": 9.0, "heading_error_rad": seen.t_s})
    start = (Start(x_m=0.0, y_m=0.0, heading_rad=0.3),)
    metrics = run_one(a_world(starts=start, time_limit_s=1.05), controller, period_s=0.5).metrics
    assert metrics["heading_ise"] == pytest.approx(0.0 * 0.5 + 0.25 * 0.5 + 1.0 * 0.05)


def test_a_trace_without_the_heading_error_leaves_it_to_the_bearing() -> None:
    controller = Scripted(lambda _: STAND, lambda _: {"other": 9.0})
    start = (Start(x_m=0.0, y_m=0.0, heading_rad=0.3),)
    assert run_one(a_world(starts=start), controller, period_s=0.5).metrics["heading_ise"] == pytest.approx(0.9)


def test_the_heading_error_of_a_robot_that_arrives_ends_with_it() -> None:
    controller = Scripted(lambda _: Command(1.0, 0.0), lambda _: {"heading_error_rad": 2.0})
    world = a_world(goals=(Point(x_m=3.33, y_m=0.005),), goal_tolerance_m=0.01)
    entered = 3.33 - math.sqrt(0.01**2 - 0.005**2)
    assert run_one(world, controller).metrics["heading_ise"] == pytest.approx(4.0 * entered)
