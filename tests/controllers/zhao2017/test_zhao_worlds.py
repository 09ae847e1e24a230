import functools
import math

import numpy as np
import pytest

from navbench.cli.configuration import compose_cell
from navbench.experiments.cells import Cell
from navbench.world.layout import DrawnWorld
from navbench.world.shapes import Mover

THREE = ["zhao2017_empty", "zhao2017_static", "zhao2017_dynamic", "zhao2018_fleet", "zhao2018_fleet_detour"]
ONE = ["zhao2018_static", "zhao2018_single", "zhao2018_single_detour"]
WITH_MOVERS = [
    *("zhao2017_dynamic", "zhao2018_single", "zhao2018_fleet", "zhao2018_single_detour", "zhao2018_fleet_detour")
]
# zhao2017, Table 4 as printed: radius, vertices, speeds as shares of the wheels' limit
TABLE_4 = [
    (3.5, [(20, 70), (50, 20)], [0.9]),
    (4, [(70, 90), (70, 30)], [0.3]),
    (3, [(25, 40), (90, 70), (70, 15)], [0.75, 0.3, 0.35]),
    (4, [(45, 25), (100, 35), (40, 80)], [0.7, 0.6, 0.3]),
]


@functools.cache
def cell(controller: str, world: str) -> Cell:
    return compose_cell(f"controller={controller}", f"world={world}")


def world_of(name: str) -> DrawnWorld:
    return cell("sflc", name).world.drawn_for(0, 0)


def place(mover: Mover, t_s: float) -> tuple[float, ...]:
    """Return x, y, vx, vy of a mover at a time."""
    world = world_of("zhao2017_dynamic")
    row = world.disc_rows(t_s)[len(world.discs) + world.movers.index(mover)]
    return tuple(row[[0, 1, 3, 4]].tolist())


@pytest.mark.parametrize("name", THREE + ONE)
def test_the_plane_and_the_robot_are_the_papers(name: str) -> None:
    world, robot = world_of(name), cell("sflc", name).robot
    bounds = world.bounds
    assert (bounds.x_min_m, bounds.x_max_m, bounds.y_min_m, bounds.y_max_m) == (0.0, 100.0, 0.0, 100.0)
    assert (robot.radius_m, robot.wheel_speed_max_mps) == (4.0, 4.0)
    assert not world.walls  # its border does not block
    assert len(world.starts) == (3 if name in THREE else 1)
    assert all(start.heading_rad is None for start in world.starts)  # they look at their targets


def test_starts_and_targets_are_those_of_section_5_1() -> None:
    world = world_of("zhao2017_empty")
    assert [(start.x_m, start.y_m) for start in world.starts] == [(0, 0), (100, 100), (0, 50)]
    assert [(goal.x_m, goal.y_m) for goal in world.goals] == [(100, 100), (0, 0), (100, 50)]
    assert not world.discs
    assert not world.movers


def test_the_counts_of_obstacles_are_those_of_the_text() -> None:
    assert len(world_of("zhao2017_static").discs) == 8  # O1 to O8
    assert (len(world_of("zhao2017_dynamic").discs), len(world_of("zhao2017_dynamic").movers)) == (2, 4)


@pytest.mark.parametrize("name", WITH_MOVERS)
def test_the_movers_are_those_of_table_4(name: str) -> None:
    world = world_of(name)
    limit = cell("sflc", name).robot.wheel_speed_max_mps
    assert len(world.movers) == len(TABLE_4)
    for mover, (radius, vertices, shares) in zip(world.movers, TABLE_4, strict=True):
        assert mover.radius_m == radius
        assert [(point.x_m, point.y_m) for point in mover.waypoints] == vertices
        assert mover.speeds_mps == pytest.approx([share * limit for share in shares])
        assert mover.cyclic == (len(vertices) == 3)
        assert mover.phase_s == 0.0


def test_two_vertices_are_driven_back_and_forth() -> None:
    mover = world_of("zhao2017_dynamic").movers[0]
    leg_s = math.hypot(30.0, 50.0) / 3.6  # 16.197 s
    vx, vy = 30.0 / leg_s, -50.0 / leg_s
    assert place(mover, 0.0) == pytest.approx((20.0, 70.0, vx, vy))
    assert place(mover, 0.5 * leg_s) == pytest.approx((35.0, 45.0, vx, vy))
    assert place(mover, 1.5 * leg_s) == pytest.approx((35.0, 45.0, -vx, -vy))
    assert place(mover, 2.0 * leg_s + 1.0) == pytest.approx((20.0 + vx, 70.0 + vy, vx, vy))


def test_three_vertices_are_a_closed_loop_with_a_speed_a_side() -> None:
    mover = world_of("zhao2017_dynamic").movers[2]
    ends = [(25.0, 40.0), (90.0, 70.0), (70.0, 15.0), (25.0, 40.0)]
    at_s = 0.0
    for (x1, y1), (x2, y2), speed in zip(ends, ends[1:], (3.0, 1.2, 1.4), strict=False):
        length = math.hypot(x2 - x1, y2 - y1)
        velocity = (speed * (x2 - x1) / length, speed * (y2 - y1) / length)
        middle_s = at_s + 0.5 * length / speed
        assert place(mover, middle_s) == pytest.approx((0.5 * (x1 + x2), 0.5 * (y1 + y2), *velocity))
        before, after = place(mover, at_s + length / speed - 1e-6), place(mover, at_s + length / speed + 1e-6)
        assert before[:2] == pytest.approx((x2, y2), abs=1e-5)
        assert after[:2] == pytest.approx((x2, y2), abs=1e-5)
        assert before[2:] == pytest.approx(velocity)
        assert after[2:] != pytest.approx(velocity)
        at_s += length / speed
    assert place(mover, at_s + 5.0) == pytest.approx(place(mover, 5.0))


def test_the_fleet_of_zhao2018_is_that_of_zhao2017() -> None:
    first, second = world_of("zhao2017_dynamic"), world_of("zhao2018_fleet")
    assert (first.discs, first.movers, first.starts, first.goals) == (
        second.discs, second.movers, second.starts, second.goals
    )  # fmt: skip


@pytest.mark.parametrize("name", THREE + ONE)
def test_no_mover_and_no_disc_stands_on_a_start_or_a_target_for_long(name: str) -> None:
    world, robot = world_of(name), cell("sflc", name).robot
    points = np.array([(p.x_m, p.y_m) for p in world.starts] + [(p.x_m, p.y_m) for p in world.goals])
    times = np.arange(0.0, world.time_limit_s, 0.5)
    blocked = np.zeros((len(times), len(points)), bool)
    for k, t_s in enumerate(times):
        discs = world.disc_rows(float(t_s))
        gaps = np.hypot(points[:, None, 0] - discs[None, :, 0], points[:, None, 1] - discs[None, :, 1])
        blocked[k] = (gaps - discs[:, 2] <= robot.radius_m).any(axis=1)
    assert not blocked[0].any()
    assert blocked.mean(axis=0).max() < 0.2


@pytest.mark.parametrize("name", ["zhao2017_empty", "zhao2017_dynamic"])
def test_three_robots_meet_and_all_arrive(name: str) -> None:
    with cell("oa_to", name).runner() as runner:
        records = runner.run(0)
    assert [record.outcome for record in records] == ["reached"] * 3
    for record in records:
        flc, situation = (record.traces[:-1, record.trace_names.index(n)] for n in ("active_flc", "special_situation"))
        assert 0.0 < flc.mean() < 1.0
        assert not situation[flc == 0.0].any()
    assert records[0].metrics["path_length_m"] > math.hypot(100.0, 100.0) - 2.0


def test_without_an_acceleration_limit_it_hardly_moves_on_among_discs() -> None:
    """With the limit the robot passes; without it, it oscillates before the first disc."""
    limited = cell("oa_to", "zhao2018_static")
    free = compose_cell(
        *("controller=oa_to", "world=zhao2018_static"),
        *("robot.wheel_accel_max_mps2=null", "controller.native.robot.wheel_accel_max_mps2=null"),
    )
    outcomes = []
    for one in (limited, free):
        with one.runner() as runner:
            outcomes.append(runner.run(0)[0].outcome)
    assert outcomes == ["reached", "timed_out"]
