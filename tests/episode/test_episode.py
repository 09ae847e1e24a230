import hashlib
import math
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import (
    BLOCK,
    IDEAL,
    STAND,
    Scripted,
    a_ring,
    a_robot,
    a_runner,
    a_world,
    always,
    run,
    run_one,
    same,
    schedule,
    to_and_fro,
)

from navbench.contract import Command, Controller, Observation, Setup
from navbench.episode.similarity import Native
from navbench.episode.starts import Jitter
from navbench.mathematics.kinematics import advance_arc
from navbench.mathematics.streams import stream
from navbench.records import Thing
from navbench.robot import Robot
from navbench.sensors import Odometry, Tracker
from navbench.simulation.options import SimulatorOptions
from navbench.validation import DescriptionError
from navbench.world.layout import DrawnWorld, FinishLine, Start
from navbench.world.shapes import Box, Disc, Point, Wall

WALL = Wall(x1_m=5.1, y1_m=-50.0, x2_m=5.1, y2_m=50.0, thickness_m=0.1)  # its face stands at 5.05


def starts(*places: tuple[float, float, float]) -> tuple[Start, ...]:
    return tuple(Start(x_m=x, y_m=y, heading_rad=heading) for x, y, heading in places)


def to(x_m: float, y_m: float, tolerance_m: float = 0.01) -> dict[str, Any]:
    """Return what sends the only robot of a world to a goal."""
    return {"goals": (Point(x_m=x_m, y_m=y_m),), "goal_tolerance_m": tolerance_m}


# --- arrival ---


def test_a_robot_that_flies_through_the_goals_disc_within_a_substep_arrives_where_it_enters_it() -> None:
    record = run_one(a_world(**to(3.33, 0.005)), always(1.0))
    entered = 3.33 - math.sqrt(0.01**2 - 0.005**2)
    assert record.outcome == "reached"
    assert record.reason == ""
    assert record.metrics["time_s"] == pytest.approx(entered, abs=1e-9)
    assert record.states[-1, :4] == pytest.approx([entered, entered, 0.0, 0.0], abs=1e-9)
    assert record.states[-2, [0, 4, 5]] == pytest.approx([3.3, 1.0, 0.0])  # the mean over the 0.02 s that it drove


def test_a_goal_missed_by_more_than_the_tolerance_is_not_reached() -> None:
    assert run_one(a_world(**to(3.33, 0.0101)), always(1.0)).outcome == "timed_out"
    assert run_one(a_world(**to(3.33, 0.0099)), always(1.0)).outcome == "reached"


@pytest.mark.parametrize("period_s", [0.07, 0.25, 2.0])
def test_arrival_on_an_arc_is_where_it_enters_the_goals_disc_and_the_robot_stays_there(period_s: float) -> None:
    """By the law of cosines in the triangle of the arc's centre, the goal and the point of entrance."""
    rng = np.random.default_rng(1)
    for _ in range(10):
        radius, turned, aside = rng.uniform(2.0, 6.0), rng.uniform(0.3, 2.5), rng.uniform(-0.009, 0.009)
        v = rng.choice([-0.5, 0.5])
        w = rng.choice([-1.0, 1.0]) * 0.5 / radius
        centre_y = v / w
        goal_x, goal_y, _ = advance_arc(0.0, 0.0, 0.0, v, w, turned / abs(w))
        goal_x, goal_y = goal_x * (1.0 + aside / radius), centre_y + (goal_y - centre_y) * (1.0 + aside / radius)
        record = run_one(a_world(**to(goal_x, goal_y), time_limit_s=60.0), always(v, w), period_s=period_s)
        to_goal = radius + aside
        before = math.acos((radius**2 + to_goal**2 - 0.01**2) / (2.0 * radius * to_goal))
        assert record.outcome == "reached"
        assert record.metrics["time_s"] == pytest.approx((turned - before) / abs(w), abs=1e-9)
        ahead = advance_arc(0.0, 0.0, 0.0, v, w, (turned - before) / abs(w))
        assert record.states[-1, 1:3] == pytest.approx(ahead[:2], abs=1e-9)
        assert record.metrics["goal_distance_m"] == pytest.approx(0.01, abs=1e-9)


@pytest.mark.parametrize("period_s", [0.02, 0.25, 2.0])
def test_arrival_is_the_first_instant_that_is_near_enough_whatever_the_period(period_s: float) -> None:
    record = run_one(a_world(**to(2.93, 0.0, tolerance_m=0.2)), always(1.0), period_s=period_s)
    assert record.metrics["time_s"] == pytest.approx(2.73, abs=1e-12)


def test_a_robot_at_its_goal_arrives_at_once_and_never_moves() -> None:
    controller = always(1.0)
    record = run_one(a_world(**to(0.0, 0.0)), controller)
    assert (record.outcome, record.metrics["time_s"]) == ("reached", 0.0)
    assert record.states[-1, :4] == pytest.approx([0.0, 0.0, 0.0, 0.0], abs=1e-12)
    assert len(controller.seen) == 1


@pytest.mark.parametrize("options", [IDEAL, BLOCK], ids=["end", "block"])
def test_what_comes_first_counts_arrival_or_contact_within_one_substep_too(options: SimulatorOptions) -> None:
    """The hull meets the wall at 4.05 m; the goal's disc begins before or beyond that."""
    for x, y in ((3.98, 0.0), (4.02, 0.0), (4.059, 0.0), (4.0555, 0.008), (4.0565, 0.008)):
        record = run_one(a_world(walls=(WALL,), **to(x, y)), always(1.0), options=options)
        entered = x - math.sqrt(0.01**2 - y**2)
        outcome = "reached" if entered < 4.05 else "timed_out" if options is BLOCK else "collided"
        assert record.outcome == outcome
        assert record.reason == ("hit wall 0" if outcome == "collided" else "")
        assert record.metrics["collisions"] == (entered > 4.05)
        ended = 10.0 if outcome == "timed_out" else min(entered, 4.05)
        assert record.metrics["time_s"] == pytest.approx(ended, abs=1e-9)
        assert record.states[-1, 1] == pytest.approx(min(entered, 4.05), abs=1e-9)


@pytest.mark.parametrize("options", [IDEAL, BLOCK], ids=["end", "block"])
def test_contact_beats_arrival_at_the_same_instant(options: SimulatorOptions) -> None:
    """Both come at 4 m, in numbers that are exact in binary."""
    wall = Wall(x1_m=5.5, y1_m=-50.0, x2_m=5.5, y2_m=50.0, thickness_m=1.0)
    world = a_world(walls=(wall,), **to(4.25, 0.0, tolerance_m=0.25))
    record = run_one(world, always(1.0), options=options, period_s=0.5)
    assert record.metrics["collisions"] == 1
    assert record.states[-1, 1] == 4.0
    if options is IDEAL:
        assert (record.outcome, record.reason, record.metrics["time_s"]) == ("collided", "hit wall 0", 4.0)


# --- finish lines ---


def line(x1: float, y1: float, x2: float, y2: float) -> dict[str, Any]:
    return {"finish_line": FinishLine(x1_m=x1, y1_m=y1, x2_m=x2, y2_m=y2)}


@pytest.mark.parametrize(("top", "bottom"), [(3.33, 3.33), (5.33, 1.33), (1.0, 5.66)])
def test_a_straight_way_crosses_the_finish_line_at_the_exact_instant(top: float, bottom: float) -> None:
    record = run_one(a_world(**line(top, 7.0, bottom, -7.0)), always(0.9))
    assert record.outcome == "reached"
    assert record.metrics["time_s"] == pytest.approx(0.5 * (top + bottom) / 0.9, abs=1e-12)
    assert record.states[-1, 1:3] == pytest.approx([0.5 * (top + bottom), 0.0], abs=1e-12)


def test_a_curved_path_crosses_the_finish_line_at_the_exact_instant() -> None:
    for x in np.linspace(1.0, 3.5, 21).tolist():
        record = run_one(a_world(**line(x, 9.0, x, -9.0)), always(0.8, 0.2))
        crossed = math.asin(x / 4.0) / 0.2
        assert record.metrics["time_s"] == pytest.approx(crossed, abs=1e-9)
        assert record.states[-1, 1:3] == pytest.approx([x, 4.0 * (1.0 - math.cos(0.2 * crossed))], abs=1e-9)


def test_with_a_finish_line_neither_the_goal_nor_a_way_around_the_line_is_an_arrival() -> None:
    world = a_world(**line(3.0, 1.0, 3.0, -1.0), **to(6.0, 0.0, tolerance_m=4.0))
    assert run_one(world, always(1.0)).metrics["time_s"] == pytest.approx(3.0)
    aside = schedule([(0.0, 0.6)] * 10 + [(1.0, 0.0)] * 90, 0.1)
    assert run_one(world, aside).outcome == "timed_out"


def test_a_robot_may_drive_back_through_the_finish_line_only_after_it_is_done() -> None:
    record = run_one(a_world(**line(3.0, 1.0, 3.0, -1.0)), schedule([(1.0, 0.0)] * 35 + [(-1.0, 0.0)] * 20, 0.1))
    assert record.states[-1, 0] == pytest.approx(3.0)


# --- time ---


@pytest.mark.parametrize("period_s", [0.05, 0.1, 0.3, 1.0 / 3.0])
def test_time_is_the_periods_number_times_the_period_to_the_last_bit(period_s: float) -> None:
    controller = always(0.5)
    record = run_one(a_world(time_limit_s=20.0), controller, period_s=period_s)
    n = math.ceil(20.0 / period_s - 1e-9)
    assert record.states[:-1, 0].tolist() == [k * period_s for k in range(n)]
    assert [seen.t_s for seen in controller.seen] == [k * period_s for k in range(n)]


@pytest.mark.parametrize("limit_s", [0.04, 1.03, 1.0, 9.999])
def test_the_last_period_is_cut_at_the_time_limit(limit_s: float) -> None:
    record = run_one(a_world(time_limit_s=limit_s), always(0.7), period_s=0.1)
    assert (record.outcome, record.reason) == ("timed_out", "")
    assert record.metrics["time_s"] == pytest.approx(limit_s, abs=1e-12)
    assert record.states[-1, :2] == pytest.approx([limit_s, 0.7 * limit_s], abs=1e-12)
    assert len(record.states) == math.ceil(limit_s / 0.1 - 1e-9) + 1


def test_a_goal_just_beyond_the_time_limit_is_not_reached() -> None:
    assert run_one(a_world(**to(1.06, 0.0), time_limit_s=1.04), always(1.0)).outcome == "timed_out"
    assert run_one(a_world(**to(1.03, 0.0), time_limit_s=1.04), always(1.0)).outcome == "reached"


def test_a_record_holds_each_periods_pose_mean_speeds_and_latency() -> None:
    commands = [(0.5, 0.2), (1.0, 0.0), (-0.3, -0.4)]
    record = run_one(a_world(time_limit_s=0.3), schedule(commands, 0.1), period_s=0.1)
    pose = (0.0, 0.0, 0.0)
    for k, (v, w) in enumerate(commands):
        assert record.states[k] == pytest.approx((0.1 * k, *pose, v, w), abs=1e-12)
        pose = advance_arc(*pose, v, w, 0.1)
    assert record.states[3] == pytest.approx((0.3, *pose, *commands[-1]), abs=1e-12)
    assert record.latencies_s.shape == (3,)
    assert (record.latencies_s > 0.0).all()
    assert record.traces.shape == (4, 0)


def test_headings_are_kept_within_half_a_turn() -> None:
    headings = run_one(a_world(), always(0.1, 1.2)).states[:, 3]
    assert headings.max() <= math.pi
    assert headings.min() > -math.pi
    assert np.unwrap(headings)[-1] == pytest.approx(12.0)


# --- several robots ---


def test_all_robots_observe_the_same_instant_before_any_moves() -> None:
    world = a_world(starts=starts((0, 0, 0), (0, 9, 0), (0, 18, 0)), time_limit_s=1.0)
    controllers = [always(0.5), always(0.7), always(-0.6)]
    records = run(world, controllers, sensors=a_ring(1, 1.0, 5.0, tracker=Tracker(range_m=99.0)))
    for k in range(10):
        for i, controller in enumerate(controllers):
            others = [record.states[k, 1:3].tolist() for record in records if record.robot_index != i]
            assert controller.seen[k].discs[:, :2].tolist() == others


def test_a_contact_ends_both_robots_at_once_and_no_other() -> None:
    world = a_world(starts=starts((0, 0, 0), (6.03, 0, math.pi), (0, 9, 0)))
    first, second, third = run(world, always(1.0))
    assert (first.outcome, first.reason) == ("collided", "hit robot 1")
    assert (second.outcome, second.reason) == ("collided", "hit robot 0")
    assert first.metrics["time_s"] == second.metrics["time_s"] == pytest.approx(2.015, abs=1e-9)
    assert first.metrics["collisions"] == second.metrics["collisions"] == 1
    assert third.outcome == "timed_out"
    assert third.metrics["path_length_m"] == pytest.approx(10.0)


def test_a_robot_that_drives_into_a_standing_one_ends_both() -> None:
    world = a_world(starts=starts((0, 0, 0), (6.03, 0, 1.0)))
    records = run(world, [always(1.0), always(0.0)])
    assert [record.outcome for record in records] == ["collided", "collided"]
    assert records[1].metrics["time_s"] == pytest.approx(4.03, abs=1e-9)
    assert records[1].metrics["path_length_m"] == 0.0


def test_a_contact_of_three_robots_at_one_instant_ends_all_three() -> None:
    world = a_world(starts=starts((0, 0, 0), (3, 0, 0), (6, 0, math.pi)))
    records = run(world, [always(1.0), always(0.0), always(1.0)])
    assert [record.metrics["time_s"] for record in records] == pytest.approx([1.0] * 3, abs=1e-12)
    assert [record.outcome for record in records] == ["collided"] * 3
    assert [record.hit for record in (records[0], records[2])] == [Thing("robot", 1)] * 2
    assert records[1].hit in (Thing("robot", 0), Thing("robot", 2))  # rounding decides which came first


def test_an_ended_robot_is_an_obstacle_that_keeps_its_outcome() -> None:
    world = a_world(
        starts=starts((0, 0, 0), (6.0, 0, 0)),
        goals=(Point(x_m=500.0, y_m=0.0), Point(x_m=6.5, y_m=0.0)),
    )
    first, second = run(world, [always(1.0), always(0.5)])
    assert (second.outcome, second.metrics["collisions"]) == ("reached", 0)
    assert second.metrics["time_s"] == pytest.approx(0.8, abs=1e-9)
    assert (first.outcome, first.reason) == ("collided", "hit robot 1")
    assert first.metrics["time_s"] == pytest.approx(4.4, abs=1e-9)


def test_an_ended_robot_is_seen_by_rays_and_by_the_tracker_and_stands() -> None:
    world = a_world(starts=starts((0, 0, 0), (4.0, 0, 0)), goals=(Point(x_m=500.0, y_m=0.0), Point(x_m=4.55, y_m=0.0)))
    watcher = always(0.0)
    _, second = run(
        world, [watcher, always(0.5)], sensors=a_ring(1, 1.0, 50.0, tracker=Tracker(range_m=50.0)), period_s=0.1
    )
    rests = second.states[-1, 1]
    assert second.outcome == "reached"
    for seen in watcher.seen[20:]:
        assert seen.ranges_m == pytest.approx([rests - 2.0], abs=1e-6)
        assert seen.discs == pytest.approx(np.array([[rests, 0.0, 1.0, 0.0, 0.0]]))
    assert watcher.seen[5].discs == pytest.approx(np.array([[4.25, 0.0, 1.0, 0.5, 0.0]]))


def test_a_mover_that_hits_a_standing_robot_ends_it_and_passes_on_to_the_next_one() -> None:
    mover = to_and_fro((10.0, 0.0), (-100.0, 0.0), speeds=[2.0], radius_m=0.5)
    world = a_world(starts=starts((0, 0, 0), (-6.0, 0, 0)), movers=(mover,))
    first, second = run(world, always(0.0))
    for record, touch_s in ((first, (10.0 - 1.5) / 2.0), (second, (16.0 - 1.5) / 2.0)):
        assert (record.outcome, record.reason) == ("collided", "hit mover 0")
        assert record.metrics["time_s"] == pytest.approx(touch_s, abs=1e-9)
        assert record.metrics["path_length_m"] == 0.0
        assert record.metrics["collisions"] == 1


def test_a_mover_passes_through_a_robot_that_has_arrived() -> None:
    mover = to_and_fro((10.0, 0.0), (-100.0, 0.0), speeds=[2.0], radius_m=0.5)
    world = a_world(movers=(mover,), starts=starts((0, 0, 0), (0, 9, 0)), goals=(Point(x_m=0, y_m=0),) * 2)
    watcher = always(0.0)
    first, second = run(world, [always(0.0), watcher], sensors=a_ring(1, 1.0, 5.0, tracker=Tracker(range_m=99.0)))
    assert (first.outcome, first.metrics["time_s"], first.metrics["collisions"]) == ("reached", 0.0, 0)
    assert second.outcome == "timed_out"
    places = [seen.discs[0, 0] for seen in watcher.seen]
    assert places == pytest.approx([10.0 - 0.2 * k for k in range(100)])


def test_a_blocked_robot_goes_on_feels_the_touch_and_counts_it() -> None:
    touched: list[bool] = []

    def act(seen: Observation) -> Command:
        touched.append(seen.touching)
        return Command(-1.0, 0.0) if 6.0 < seen.t_s < 7.0 else Command(1.0, 0.0)

    record = run_one(a_world(walls=(WALL,)), Scripted(act), options=BLOCK)
    assert (record.outcome, record.metrics["collisions"]) == ("timed_out", 2)
    assert not any(touched[:41])
    assert all(touched[41:61])
    assert not any(touched[62:70])
    assert touched[-1]
    assert record.states[:, 1].max() == pytest.approx(4.05, abs=1e-9)
    assert record.states[50, 4:] == pytest.approx([0.0, 0.0], abs=1e-12)


# --- starts ---


def test_without_jitter_every_episode_begins_at_the_worlds_starts() -> None:
    world = a_world(starts=(Start(x_m=0.1, y_m=0.2), Start(x_m=7.0, y_m=7.0, heading_rad=-2.5)))
    with a_runner(world, always(0.0)) as runner:
        for episode in (0, 5):
            assert runner.draw(episode).starts == [
                (0.1, 0.2, math.atan2(-0.2, 499.9)),
                (7.0, 7.0, -2.5),
            ]


def test_jitter_is_uniform_in_place_and_heading() -> None:
    world = a_world(starts=starts((3.0, -2.0, 3.0)))
    with a_runner(world, always(0.0), jitter=Jitter(0.5, 0.3)) as runner:
        poses = np.array([runner.draw(episode).starts[0] for episode in range(2000)])
    moved = poses - [3.0, -2.0, 3.0]
    moved[:, 2] = [math.remainder(turn, 2.0 * math.pi) for turn in moved[:, 2]]
    for axis, width in ((0, 0.5), (1, 0.5), (2, 0.3)):
        scaled = moved[:, axis] / width
        assert 0.99 < np.abs(scaled).max() <= 1.0 + 1e-12
        assert scaled.std() == pytest.approx(1.0 / math.sqrt(3.0), rel=0.05)
        assert abs(scaled.mean()) < 5.0 / math.sqrt(3.0 * 2000)
        counts, _ = np.histogram(scaled, 4, (-1.0, 1.0))
        assert counts.min() > 400
    assert np.abs(poses[:, 2]).max() <= math.pi
    assert np.abs(np.corrcoef(moved.T) - np.eye(3)).max() < 5.0 / math.sqrt(2000)


def test_a_start_in_contact_is_drawn_again_from_its_own_stream() -> None:
    things: dict[str, Any] = {
        "discs": (Disc(x_m=2.2, y_m=0.0, radius_m=1.0),),
        "boxes": (Box(x_m=-2.3, y_m=0.0, length_m=2.0, width_m=9.0),),
    }
    world = a_world(starts=starts((0, 0, 0), (0, 2.5, 0)), **things)
    redrawn = 0
    with a_runner(world, always(0.0), jitter=Jitter(1.0, 0.0), seed=3) as runner:
        for episode in range(100):
            first, second = runner.draw(episode).starts
            for pose in (first, second):
                assert math.hypot(pose.x_m - 2.2, pose.y_m) > 2.0
                assert pose.x_m > -0.3
            assert math.hypot(first.x_m - second.x_m, first.y_m - second.y_m) > 2.0
            draws = stream(3, "scene", episode, "start", 0).uniform(-1.0, 1.0, (50, 3))
            free = [x > -0.3 and math.hypot(x - 2.2, y) > 2.0 for x, y, _ in draws.tolist()].index(True)
            redrawn += free > 0
            assert (first.x_m, first.y_m) == pytest.approx(tuple(draws[free, :2]), abs=1e-15)
    assert redrawn > 30


def test_an_episode_begins_where_its_starts_were_drawn() -> None:
    with a_runner(a_world(), always(0.0), jitter=Jitter(0.5, 0.3)) as runner:
        (record,) = runner.run(7)
        assert tuple(record.states[0, 1:4]) == runner.draw(7).starts[0]


def test_a_start_without_a_free_place_in_its_jitter_is_an_error() -> None:
    """Two robots fill a box of 4.02 m by 2.02 m: where the first one moves, the second one has no room left."""
    walls = (
        Wall(x1_m=-9.0, y1_m=1.06, x2_m=9.0, y2_m=1.06, thickness_m=0.1),
        Wall(x1_m=-9.0, y1_m=-1.06, x2_m=9.0, y2_m=-1.06, thickness_m=0.1),
        Wall(x1_m=-1.06, y1_m=-9.0, x2_m=-1.06, y2_m=9.0, thickness_m=0.1),
        Wall(x1_m=3.06, y1_m=-9.0, x2_m=3.06, y2_m=9.0, thickness_m=0.1),
    )
    world = a_world(starts=starts((0, 0, 0), (2.0001, 0, 0)), walls=walls)
    with a_runner(world, always(0.0)) as runner:
        assert len(runner.run(0)) == 2
    with a_runner(world, always(0.0), jitter=Jitter(0.9, 0.0)) as runner:
        records = runner.run(0)
    assert [record.outcome for record in records] == ["no_layout"] * 2
    assert re.match(r"start_jitter_m=0\.9: .* starts\[1\]", records[0].reason)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"discs": (Disc(x_m=1.9, y_m=0.0, radius_m=1.0),)}, ["world.starts[0]", "(0.0, 0.0)", "1.0 m", "obstacle"]),
        ({"walls": (WALL,), "starts": starts((4.1, 0, 0))}, ["world.starts[0]", "(4.1, 0.0)", "1.0 m", "obstacle"]),
        ({"starts": starts((0, 0, 0), (0, 1.9, 0))}, ["world.starts[1]", "2.0 m", "another start"]),
    ],
)
def test_a_start_in_contact_is_refused_before_anything_runs(changes: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(DescriptionError) as caught:
        a_runner(a_world(**changes), always(0.0))
    for word in words:
        assert word in str(caught.value)


# --- the same seed, the same bytes ---


def wander(seen: Observation) -> Command:
    """Drive by everything that is seen, so that no difference stays hidden."""
    away = float(seen.ranges_m @ np.sin(np.arange(len(seen.ranges_m)) * 0.7854))
    return Command(0.6 + 0.1 * math.sin(seen.t_s), 0.2 * away / 9.0 + 0.1 * math.sin(seen.pose.heading_rad * 3.0))


def busy_world(**changes: Any) -> DrawnWorld:
    mover = to_and_fro((9.0, -6.0), (9.0, 9.0), speeds=[0.8], radius_m=0.7, phase_s=2.0)
    values: dict[str, Any] = {
        "starts": starts((0, 0, 0), (0, 4, 0.2), (0, -5, -0.1)),
        "discs": (Disc(x_m=5.0, y_m=0.5, radius_m=1.0),),
        "boxes": (Box(x_m=12.0, y_m=4.0, length_m=1.0, width_m=4.0, heading_rad=0.4),),
        "movers": (mover,),
        "time_limit_s": 15.0,
    }
    return a_world(**values | changes)


NOISY = a_ring(
    8,
    1.0,
    5.0,
    noise_std_m=0.05,
    dropout_probability=0.05,
    odometry=Odometry(travel_noise=0.05, wheel_scale_std=0.02),
    tracker=Tracker(range_m=9.0, position_noise_std_m=0.05),
)


def busy_runner(controllers: Controller | list[Controller] | None = None, seed: int = 4) -> Any:
    controllers = Scripted(wander, lambda seen: {"w": seen.w_radps}) if controllers is None else controllers
    return a_runner(busy_world(), controllers, sensors=NOISY, seed=seed, jitter=Jitter(0.4, 0.2))


def test_episodes_in_another_order_in_another_runner_are_the_same_to_the_last_bit() -> None:
    with busy_runner() as runner:
        forward = {episode: runner.run(episode) for episode in range(5)}
    with busy_runner() as runner:
        backward = {episode: runner.run(episode) for episode in (3, 1, 3, 4, 0, 2, 1)}
    for episode, records in forward.items():
        for one, other in zip(records, backward[episode], strict=True):
            assert same(one, other)
    assert len({record.states.tobytes() for records in forward.values() for record in records}) == 15
    assert len({record.outcome for records in forward.values() for record in records}) > 1


def digest() -> str:
    """Return the SHA-256 of two episodes."""
    total = hashlib.sha256()
    with busy_runner() as runner:
        for episode in (0, 1):
            for record in runner.run(episode):
                total.update(repr(record[:4]).encode() + record.states.tobytes() + record.traces.tobytes())
    return total.hexdigest()


def test_another_process_gives_the_same_bytes() -> None:
    paths = list(map(str, Path(__file__).parents[:2]))
    program = f"import sys; sys.path[:0] = {paths!r}; import test_episode; print(test_episode.digest())"
    environment = os.environ | {"PYTHONHASHSEED": "12345"}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.strip() == digest()


def test_another_seed_is_another_episode() -> None:
    with busy_runner() as one, busy_runner(seed=5) as other:
        for first, second in zip(one.run(0), other.run(0), strict=True):
            assert first.states[0].tobytes() != second.states[0].tobytes()


def test_every_controller_meets_the_same_starts_and_the_same_first_readings() -> None:
    seen = []
    for act, draws in ((wander, 0), (lambda _: STAND, 17)):
        controllers = [Greedy(act, draws) for _ in range(3)]
        with busy_runner([*controllers]) as runner:
            runner.run(2)
        seen.append([controller.seen[0] for controller in controllers])
    for one, other in zip(*seen, strict=True):
        assert one[:5] == other[:5]
        assert one.ranges_m.tobytes() == other.ranges_m.tobytes()
        assert one.discs.tobytes() == other.discs.tobytes()


class Greedy(Scripted):
    """Draws from its generator whatever it likes."""

    def __init__(self, act: Callable[[Observation], Any], draws: int) -> None:
        super().__init__(act)
        self.draws = draws

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        super().reset(setup, rng)
        rng.standard_normal(self.draws)


def test_noise_meets_a_robot_at_the_same_instants_whatever_its_controller_draws() -> None:
    kept = []
    for draws in (0, 9):
        controllers = [Greedy(wander, draws) for _ in range(3)]
        with busy_runner([*controllers]) as runner:
            kept.append(runner.run(0))
    for one, other in zip(*kept, strict=True):
        assert same(one, other)


def test_a_controllers_chance_is_named_by_seed_world_episode_and_robot() -> None:
    controllers = [always(0.0) for _ in range(3)]
    with busy_runner([*controllers]) as runner:
        runner.run(6)
    for i, controller in enumerate(controllers):
        assert controller.rng is not None
        assert controller.rng.random() == stream(4, "scene", 6, "controller", i).random()


def test_nobody_can_write_to_an_observation_and_it_leads_to_no_other() -> None:
    seen: list[Observation] = []

    def look(observation: Observation) -> Command:
        seen.append(observation)
        return wander(observation)

    for sensors in (a_ring(8, 1.0, 5.0), a_ring(8, 1.0, 5.0, tracker=Tracker(range_m=9.0))):
        with a_runner(busy_world(), Scripted(look), sensors=sensors) as runner:
            runner.run(0)
    assert {len(one.discs) > 0 for one in seen} == {False, True}
    for one in seen:
        for array in (one.ranges_m, one.discs):
            assert isinstance(array.base, bytes)
            assert len(array.base) == array.nbytes
            with pytest.raises(ValueError, match="WRITEABLE"):
                array.setflags(write=True)


# --- controllers that fail ---


def fail(error: Exception) -> Callable[[Observation], Any]:
    def act(seen: Observation) -> Any:
        if seen.t_s < 0.95:
            return Command(0.5, 0.0)
        raise error

    return act


def give(command: Any) -> Callable[[Observation], Any]:
    return lambda seen: Command(0.5, 0.0) if seen.t_s < 0.95 else command


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (fail(ZeroDivisionError("no way")), "ZeroDivisionError: no way"),
        (fail(ValueError("two\n  lines")), "ValueError: two lines"),
        (give(Command(math.nan, 0.0)), "returned Command(v_mps=nan, w_radps=0.0) (scenes.py, line "),
        (give(Command(0.0, math.nan)), "nan"),
        (give(Command(math.inf, 0.0)), "inf"),
        (give(Command(0.1, -math.inf)), "inf"),
        (give(None), "it returned None; is a `return` missing? (scenes.py, line "),
        (give(0.5), "act must return Command(v_mps, w_radps), two finite numbers; it returned 0.5"),
        (give((0.5,)), "returned (0.5,)"),
        (give((0.5, 0.1, 0.1)), "returned (0.5, 0.1, 0.1)"),
        (give(np.zeros((2, 2))), "returned an array of shape (2, 2)"),
        (give(np.zeros(3)), "returned an array of shape (3,)"),
        (give("ab"), "returned 'ab'"),
        (give(("0.5", "0.1")), "returned ('0.5', '0.1')"),
        (give((1j, 0.0)), "returned (1j, 0.0)"),
        (give({"v_mps": 0.5, "w_radps": 0.0}), "returned {'v_mps': 0.5, 'w_radps': 0.0}"),
    ],
)
def test_a_controller_that_fails_ends_its_robot_with_the_reason_and_the_others_go_on(
    act: Callable[[Observation], Any], words: str
) -> None:
    world = a_world(starts=starts((0, 0, 0), (0, 9, 0)), time_limit_s=3.0)
    failed, other = run(world, [Scripted(act, lambda seen: {"t": seen.t_s}), always(0.5)], period_s=0.1)
    assert failed.outcome == "controller_error"
    assert words in failed.reason
    assert "\n" not in failed.reason
    assert failed.metrics["time_s"] == pytest.approx(1.0)
    assert failed.metrics["path_length_m"] == pytest.approx(0.5)
    assert failed.states[-1, :4] == pytest.approx([1.0, 0.5, 0.0, 0.0])
    assert failed.states.shape == (11, 6)
    assert failed.traces.shape == (11, 1)
    assert np.isfinite(failed.states).all()
    assert np.isfinite(failed.traces[:10]).all()
    assert other.outcome == "timed_out"
    assert other.metrics["path_length_m"] == pytest.approx(1.5)


def test_a_long_reason_is_cut_to_one_short_line() -> None:
    record = run_one(a_world(), Scripted(fail(ValueError("x" * 5000))))
    assert len(record.reason) <= 250
    assert record.reason.startswith("ValueError: xxx")


class FailsInReset:
    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        raise RuntimeError("not today")

    def act(self, observation: Observation) -> Command:
        return STAND


def test_a_controller_that_fails_in_reset_leaves_its_robot_standing_and_the_others_go_on() -> None:
    world = a_world(starts=starts((0, 0, 0.5), (-6.0, 0, 0)))
    failed, other = run(world, [FailsInReset(), always(1.0)])
    assert failed.outcome == "controller_error"
    assert re.fullmatch(
        r'RuntimeError: not today \(test_episode.py, line \d+: raise RuntimeError\("not today"\)\)', failed.reason
    )
    assert failed.states[:, :4].tolist() == [[0.0, 0.0, 0.0, 0.5]]
    assert failed.traces.shape == (1, 0)
    assert (failed.metrics["time_s"], failed.metrics["path_length_m"], failed.metrics["collisions"]) == (0.0, 0.0, 0)
    assert (other.outcome, other.reason) == ("collided", "hit robot 0")


def test_where_every_controller_fails_the_episode_ends() -> None:
    records = run(a_world(starts=starts((0, 0, 0), (0, 9, 0))), FailsInReset())
    assert [record.outcome for record in records] == ["controller_error"] * 2


def test_a_controller_that_failed_in_one_episode_may_run_the_next() -> None:
    def act(seen: Observation) -> Command:
        if seen.goal[0] and not acted:
            acted.append(True)
            raise ValueError("only once")
        return Command(0.5, 0.0)

    acted: list[bool] = []
    with a_runner(a_world(), Scripted(act)) as runner:
        assert runner.run(0)[0].outcome == "controller_error"
        assert runner.run(1)[0].outcome == "timed_out"


def test_a_command_too_large_for_the_worlds_units_never_makes_a_state_that_is_no_number() -> None:
    small = Robot(radius_m=0.01, track_m=0.01, wheel_speed_max_mps=0.001)
    big = a_robot(1.0, 1.0)
    controller = always(-1.7e308, 1.7e308)
    record = run_one(a_world(time_limit_s=1.0), controller, robot=big, native=Native(small, 0.1))
    assert np.isfinite(record.states).all()


# --- traces ---


def traced(*names_by_period: dict[str, Any]) -> Scripted:
    """Return a controller that stands and offers one trace a period, the last one for ever."""
    return Scripted(lambda _: STAND, lambda seen: names_by_period[min(round(seen.t_s / 0.1), len(names_by_period) - 1)])


def test_the_trace_of_each_act_is_kept_beside_the_state_it_acted_in() -> None:
    controller = Scripted(lambda _: Command(0.5, 0.0), lambda seen: {"x": seen.pose.x_m, "agent": 2})
    record = run_one(a_world(time_limit_s=1.0), controller)
    assert record.trace_names == ("x", "agent")
    assert record.traces.shape == (11, 2)
    assert record.traces[:-1, 0].tolist() == record.states[:-1, 1].tolist()
    assert (record.traces[:-1, 1] == 2.0).all()
    assert np.isnan(record.traces[-1]).all()


@pytest.mark.parametrize(
    "traces",
    [
        [{"a": 1.0, "b": 2.0}, {"a": 1.0}],
        [{"a": 1.0}, {"a": 1.0, "b": 2.0}],
        [{"a": 1.0, "b": 2.0}, {"a": 1.0, "c": 2.0}],
        [{"a": 1.0}, {}],
        [{}, {"a": 1.0}],
    ],
    ids=["fewer", "more", "others", "none", "late"],
)
def test_a_trace_whose_names_change_is_the_controllers_error(traces: list[dict[str, Any]]) -> None:
    record = run_one(a_world(time_limit_s=1.0), traced(*traces))
    assert record.outcome == "controller_error"
    assert "trace" in record.reason
    assert record.metrics["time_s"] == pytest.approx(0.1)


def test_a_trace_in_another_order_keeps_each_number_under_its_name() -> None:
    record = run_one(a_world(time_limit_s=0.3), traced({"a": 1.0, "b": 2.0}, {"b": 2.0, "a": 1.0}))
    if record.outcome == "controller_error":
        assert "trace" in record.reason
    else:
        a, b = record.trace_names.index("a"), record.trace_names.index("b")
        assert record.traces[:-1, [a, b]].tolist() == [[1.0, 2.0]] * 3


@pytest.mark.parametrize("value", ["avoid", [1.0, 2.0]])
def test_a_trace_that_is_no_number_costs_the_robot_and_not_the_study(value: Any) -> None:
    world = a_world(starts=starts((0, 0, 0), (0, 9, 0)), time_limit_s=1.0)
    failed, other = run(world, [traced({"agent": value}), always(0.5)])
    assert failed.outcome == "controller_error"
    assert failed.reason.startswith(f"trace['agent'] must be a number; it is {value!r} (scenes.py, line ")
    assert other.outcome == "timed_out"


@pytest.mark.parametrize("trace", [None, "avoid", [1.0, 2.0], 3.0])
def test_a_trace_that_is_no_mapping_is_the_controllers_error(trace: Any) -> None:
    record = run_one(a_world(time_limit_s=1.0), traced(trace))
    assert record.reason.startswith(f"trace must be a mapping of names to numbers; it is {trace!r}")
    assert record.traceback == ""


def test_the_traceback_of_what_a_controller_raises_begins_in_its_own_file() -> None:
    def deeper() -> Command:
        return Command([0.0][99], 0.0)

    record = run_one(a_world(time_limit_s=1.0), Scripted(lambda _: deeper()))
    assert record.reason.startswith("IndexError: list index out of range (test_episode.py, line ")
    assert record.reason.endswith(": return Command([0.0][99], 0.0))")
    files = re.findall(r'File "(.*)", line', record.traceback)
    assert [Path(file).name for file in files] == ["scenes.py", "test_episode.py", "test_episode.py"]
    assert record.traceback.endswith("IndexError: list index out of range\n")


def test_the_line_of_a_failure_is_the_users_where_a_library_raises() -> None:
    record = run_one(a_world(time_limit_s=1.0), Scripted(lambda _: np.linalg.inv(np.zeros((2, 2)))))
    assert "(test_episode.py, line " in record.reason
    assert "linalg" in record.traceback


def test_a_trace_that_raises_is_the_controllers_error() -> None:
    class Broken(Scripted):
        @property
        def trace(self) -> dict[str, float]:
            raise KeyError("no trace")

        @trace.setter
        def trace(self, value: object) -> None:
            pass

    record = run_one(a_world(time_limit_s=1.0), Broken(lambda _: STAND))
    assert record.outcome == "controller_error"
    assert "KeyError" in record.reason


# --- drives in the loop ---


def test_what_a_robot_measures_of_its_speed_is_what_its_wheels_do() -> None:
    controller = always(1.0, 0.2)
    run_one(a_world(time_limit_s=2.0), controller, robot=a_robot(1.0, 2.0, accel_mps2=0.5))
    for seen in controller.seen:
        left, right = min(0.85, 0.5 * seen.t_s), min(1.15, 0.5 * seen.t_s)
        assert (seen.v_mps, seen.w_radps) == pytest.approx((0.5 * (left + right), (right - left) / 1.5), abs=1e-9)


def test_a_limited_drive_reaches_the_goal_later_by_its_delay_and_its_lag() -> None:
    options = SimulatorOptions(drive="limited", motor_lag_s=0.1, command_delay_s=0.25)
    world = a_world(**to(3.33, 0.0005, tolerance_m=0.001))
    ideal = run_one(world, always(0.5))
    record = run_one(world, always(0.5), options=options)
    assert record.metrics["time_s"] - ideal.metrics["time_s"] == pytest.approx(0.35, abs=1e-4)
