"""lei2014's controller in the paper's experiment and in worlds around it: who arrives, when, and past what."""

import functools
import math
from typing import Any

import numpy as np
import pytest

from navbench.cli.configuration import compose_cell
from navbench.records import RobotRecord

DANGER = 0.25  # from here on an obstacle is more than small danger
PERIOD_S = 2.0


@functools.cache
def run(*overrides: str) -> tuple[RobotRecord, ...]:
    with compose_cell(*overrides).runner() as runner:
        return tuple(runner.run(0))


def drive(world: str, *more: str, controller: str = "dual_layer", sensors: str = "disc_tracker") -> Any:
    return run(f"controller={controller}", f"world={world}", f"sensors={sensors}", *more)


def column(record: RobotRecord, name: str) -> Any:
    return record.traces[:-1, record.trace_names.index(name)]


def danger_span(record: RobotRecord) -> tuple[float, float]:
    """Return the first and the last time at which one of the three danger degrees is at least ``DANGER``."""
    times = record.states[:-1, 0][record.traces[:-1, :3].max(axis=1) >= DANGER]
    return float(times.min()), float(times.max())


def all_reach(records: tuple[RobotRecord, ...]) -> bool:
    return all(record.outcome == "reached" and record.metrics["min_clearance_m"] > 0.0 for record in records)


@pytest.mark.parametrize("rules", ["literal", "safe"])
def test_at_the_printed_speed_two_robots_exchange_places_in_51_seconds(rules: str) -> None:
    records = drive("lei_swap", f"controller.build.rules={rules}")
    assert all_reach(records)
    for record in records:
        assert record.metrics["time_s"] == pytest.approx(51.35, rel=0.02)
        assert danger_span(record) == (12.0, 26.0)
        assert (column(record, "behavior") == 2.0).sum() * PERIOD_S == 6.0
        assert record.metrics["min_clearance_m"] == pytest.approx(0.649, rel=0.02)


def test_at_the_printed_speed_nothing_is_dangerous_from_50_to_80_seconds() -> None:
    for record in drive("lei_swap"):
        late = record.states[:-1, 0] >= 28.0
        assert column(record, "fddc")[late].max() < DANGER


def test_at_the_fitted_speed_the_danger_lasts_from_48_to_80_seconds() -> None:
    records = drive("lei_swap", controller="dual_layer_slow")
    assert all_reach(records)
    for record in records:
        assert danger_span(record) == (48.0, 80.0)
        assert record.metrics["time_s"] == pytest.approx(153.75, rel=0.02)


def test_the_robots_never_avoid_an_obstacle_they_follow_it() -> None:
    for controller in ("dual_layer", "dual_layer_slow"):
        for record in drive("lei_swap", controller=controller):
            behaviors = set(column(record, "behavior").tolist())
            assert behaviors == {0.0, 2.0}


def test_in_the_experiment_no_rule_fires_of_a_target_ahead_with_danger_on_both_sides() -> None:
    for controller in ("dual_layer", "dual_layer_slow"):
        for record in drive("lei_swap", "controller.build.rules=literal", controller=controller):
            both = np.minimum(column(record, "lddc"), column(record, "rddc"))
            assert both.max() == 0.0  # so that it does not matter that literal drives straight on there, see Rule 2.3


def test_by_the_symmetric_rules_they_avoid_from_52_to_80_seconds_at_the_fitted_speed() -> None:
    records = drive("lei_swap", controller="dual_layer_symmetric")
    assert all_reach(records)
    for record in records:
        times, behavior = record.states[:-1, 0], column(record, "behavior")
        avoiding = times[behavior == 1.0]
        assert (avoiding.min(), avoiding.max() + PERIOD_S) == (52.0, 80.0)
        assert [round(float(np.mean(behavior == one)), 2) for one in (0.0, 1.0, 2.0)] == [0.81, 0.15, 0.04]


def test_read_as_eq_2_prints_it_they_do_not_exchange_places() -> None:
    assert not all_reach(drive("lei_swap", "controller.build.w_turns_right=false"))


def test_the_two_robots_do_the_same_turned_by_half_a_turn() -> None:
    first, second = drive("lei_swap")
    assert second.states[:, 1:3] == pytest.approx(np.array([4.0, 4.0]) - first.states[:, 1:3], abs=1e-6)


@pytest.mark.parametrize("sensors", ["disc_tracker", "ring45"])
@pytest.mark.parametrize("controller", ["dual_layer", "dual_layer_slow"])
@pytest.mark.parametrize("offset_m", [-0.3, -0.1, 0.1, 0.3])
def test_the_exchange_succeeds_from_places_aside(offset_m: float, controller: str, sensors: str) -> None:
    starts = f"world.starts=[{{x_m: 0.0, y_m: {2.0 + offset_m}}}, {{x_m: 4.0, y_m: 2.0}}]"
    assert all_reach(drive("lei_swap", starts, controller=controller, sensors=sensors))


def test_the_exchange_succeeds_with_an_inexact_tracker() -> None:
    overrides = ("controller=dual_layer", "world=lei_swap", "sensors=disc_tracker")
    with compose_cell(*overrides, "sensors.tracker.position_noise_std_m=0.12").runner() as runner:  # 3 cm on this robot
        assert all(all_reach(tuple(runner.run(episode))) for episode in range(10))


def test_the_ring_alone_needs_no_radio_and_does_as_well() -> None:
    records = drive("lei_swap", sensors="ring45")
    assert all_reach(records)
    for record, told in zip(records, drive("lei_swap"), strict=True):
        assert record.metrics["time_s"] == pytest.approx(told.metrics["time_s"], rel=0.05)
        begin, end = danger_span(record)
        assert begin <= 12.0
        assert 16.0 <= end <= 28.0


@pytest.mark.parametrize("sensors", ["disc_tracker", "ring45"])
@pytest.mark.parametrize("controller", ["dual_layer", "dual_layer_slow"])
@pytest.mark.parametrize("count", [3, 4, 6])
def test_robots_cross_a_circle_without_touching(count: int, controller: str, sensors: str) -> None:
    records = drive(f"lei_circle{count}", controller=controller, sensors=sensors)
    assert len(records) == count
    assert all_reach(records)


@pytest.mark.parametrize(
    ("world", "time_s", "clearance_m", "following"),
    [("lei_disc", 97.0, 0.50, 0.24), ("lei_wall", 104.0, 0.67, 0.21)],
)
def test_it_gets_round_what_stands_in_its_way(world: str, time_s: float, clearance_m: float, following: float) -> None:
    (record,) = drive(world)
    assert record.outcome == "reached"
    assert record.metrics["time_s"] == pytest.approx(time_s, rel=0.05)
    assert record.metrics["min_clearance_m"] == pytest.approx(clearance_m, rel=0.05)
    assert np.mean(column(record, "behavior") == 2.0) == pytest.approx(following, abs=0.02)


@pytest.mark.parametrize("sensors", ["disc_tracker", "ring45"])
@pytest.mark.parametrize("world", ["lei_disc", "lei_wall", "lei_corner"])
def test_it_gets_round_static_obstacles_with_either_sensor(world: str, sensors: str) -> None:
    assert all_reach(drive(world, sensors=sensors))


def test_a_robot_that_takes_the_posts_for_one_front_hits_the_gate() -> None:
    (record,) = drive("lei_gate")
    assert (record.outcome, record.reason) == ("collided", "hit disc 0")
    assert column(record, "fddc").max() > 0.9


def test_following_takes_more_of_the_way_round_a_large_disc_than_round_a_small_one() -> None:
    small = "world.discs=[{x_m: 3.0, y_m: 2.0, radius_m: 0.3}]"
    shares = [np.mean(column(drive("lei_disc", *more)[0], "behavior") == 2.0) for more in ((), (small,))]
    assert shares[0] > shares[1] + 0.05


def test_without_velocity_awareness_the_robots_notice_each_other_later() -> None:
    aware, unaware = drive("lei_swap"), drive("lei_swap", "controller.build.velocity_aware=false")
    assert danger_span(unaware[0])[0] > danger_span(aware[0])[0]
    assert unaware[0].metrics["min_clearance_m"] < aware[0].metrics["min_clearance_m"]


@pytest.mark.parametrize("count", [3, 4, 6])
def test_the_circles_lead_each_robot_across_the_middle(count: int) -> None:
    world = compose_cell("controller=dual_layer", f"world=lei_circle{count}").world.drawn_for(0, 0)
    for i, (start, goal) in enumerate(zip(world.starts, world.goals, strict=True)):
        turn = 2.0 * math.pi * i / count
        assert (start.x_m, start.y_m) == pytest.approx((2.0 * math.cos(turn), 2.0 * math.sin(turn)), abs=1e-6)
        assert (goal.x_m, goal.y_m) == pytest.approx((-start.x_m, -start.y_m))


def test_the_gate_is_as_wide_as_its_name_says() -> None:
    one, other = compose_cell("controller=dual_layer", "world=lei_gate").world.drawn_for(0, 0).discs
    assert abs(one.y_m - other.y_m) - one.radius_m - other.radius_m == pytest.approx(0.9)
