"""What the planner of nemeiksis2019 does in its four worlds: as printed within a tenth, and from many starts."""

import functools
import itertools
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navbench.cli.configuration import compose_cell
from navbench.controllers.nemeiksis2019.switch import DESTINATION, OBSTACLE, WALL
from navbench.experiments.cells import Cell
from navbench.mathematics.geometry import distance_to_nearest
from navbench.records import RobotRecord

BLINK = 12  # control periods: a shorter spell of an agent is chatter at a border, not a part of the way
WITHOUT_WALL = "controller.build.switch.agents=[destination,obstacle]"
FIG_10_PERIOD = "controller.native.period_s=0.02569"


@functools.cache
def cell(world: str, *changes: str) -> Cell:
    return compose_cell("controller=multi_agent", f"world=nemeiksis_{world}", *changes)


@functools.cache
def runs(world: str, *changes: str, episodes: int = 1) -> list[RobotRecord]:
    with cell(world, *changes).runner() as runner:
        return [runner.run(episode)[0] for episode in range(episodes)]


def trace(record: RobotRecord, name: str) -> NDArray[np.float64]:
    column: NDArray[np.float64] = record.traces[:-1, record.trace_names.index(name)]
    return column


def way(record: RobotRecord) -> list[int]:
    """Return which agents drove, one after the other, without those that only blinked."""
    spells = [(int(agent), len(list(spell))) for agent, spell in itertools.groupby(trace(record, "agent"))]
    return [agent for agent, _ in itertools.groupby(agent for agent, length in spells if length >= BLINK)]


@pytest.mark.parametrize(
    ("world", "changes", "periods", "time_s"),
    [
        ("bypass", [], 769, 19.60),
        ("bypass", [WITHOUT_WALL], 769, 19.60),
        ("destination", [], 428, 11.9),
        ("rooms", [FIG_10_PERIOD], 1142, 29.34),
    ],
)
def test_it_arrives_in_the_printed_iterations_and_time_within_a_tenth(
    world: str, changes: list[str], periods: int, time_s: float
) -> None:
    (record,) = runs(world, *changes)
    assert record.outcome == "reached"
    assert len(record.states) - 1 == pytest.approx(periods, rel=0.1)
    assert record.metrics["time_s"] == pytest.approx(time_s, rel=0.1)
    assert record.metrics["collisions"] == 0


@pytest.mark.parametrize(
    ("world", "period_s", "more", "periods", "time_s"),
    [("destination", 0.0278, [], 428, 11.9), ("bypass", 0.02549, [WITHOUT_WALL], 769, 19.60)],
)
def test_another_fit_arrives_as_printed_at_the_period_printed_for_each(
    world: str, period_s: float, more: list[str], periods: int, time_s: float
) -> None:
    fit = [f"{robot}.wheel_speed_max_mps=0.755" for robot in ("robot", "controller.native.robot")]
    peaks = "controller.build.blocks.destination_distance_m"
    fit += [f"{peaks}.MD=0.47", f"{peaks}.MF=0.485", "world.goal_tolerance_m=0.0012"]
    (record,) = runs(world, *fit, *more, f"controller.native.period_s={period_s}")
    assert len(record.states) - 1 == pytest.approx(periods, rel=0.01)
    assert record.metrics["time_s"] == pytest.approx(time_s, rel=0.01)


def test_the_printed_times_make_two_periods_and_a_longer_one() -> None:
    periods_s = [19.60 / 769, 29.34 / 1142, 11.9 / 428]
    assert periods_s == pytest.approx([0.02549, 0.02569, 0.02780], abs=1e-5)
    native = cell("rooms").native
    assert native is not None
    assert native.period_s == pytest.approx(periods_s[0], abs=1e-4)


def test_past_the_box_it_goes_from_destination_to_obstacle_and_back_on_the_right_of_it() -> None:
    (record,) = runs("bypass", WITHOUT_WALL)
    assert way(record) == [DESTINATION, OBSTACLE, DESTINATION]
    at_box = record.states[np.argmin(np.abs(record.states[:, 1] - 4.25))]
    assert at_box[2] < 1.75 - 0.3 - 0.15
    (whole,) = runs("bypass")
    assert way(whole) == [DESTINATION, OBSTACLE, WALL, DESTINATION]


def test_along_the_wall_both_distances_stay_in_the_printed_band_nearly_always() -> None:
    (record,) = runs("wall")
    assert record.outcome == "reached"
    assert way(record) == [WALL]
    d_s1, d_s10 = trace(record, "d_s1_m"), trace(record, "d_s10_m")
    inside = (d_s1 >= 0.30) & (d_s1 <= 0.35) & (d_s10 >= 0.30) & (d_s10 <= 0.35)
    assert inside.mean() > 0.85
    assert min(d_s1.min(), d_s10.min()) > 0.29
    assert max(d_s1.max(), d_s10.max()) < 0.35


def test_along_the_wall_the_speed_is_constant_and_the_angle_is_not() -> None:
    (record,) = runs("wall")
    assert np.ptp(trace(record, "v_avg_mps")) < 0.01
    assert np.ptp(np.degrees(trace(record, "mu_2_rad"))) > 15.0
    assert trace(record, "d_destination_m").min() > 0.5  # so that 4FB takes it for far all the way


def test_to_the_destination_the_angle_stays_and_the_speed_drops() -> None:
    (record,) = runs("destination")
    assert way(record) == [DESTINATION]
    assert np.abs(trace(record, "mu_3_rad")).max() < 1e-6
    speed = trace(record, "v_avg_mps")
    assert (np.diff(speed) < 1e-9).all()
    assert speed[0] == pytest.approx(0.67)
    assert speed[-1] < 0.01
    assert trace(record, "d_destination_m")[-1] < 0.005


def test_between_the_boxes_it_drives_the_printed_sub_trajectories_with_a_bypass_before_each_wall() -> None:
    (record,) = runs("rooms", FIG_10_PERIOD)
    assert way(record) == [DESTINATION, OBSTACLE, WALL, DESTINATION, OBSTACLE, WALL, DESTINATION]
    assert record.metrics["min_clearance_m"] > 0.15


@pytest.mark.parametrize("world", ["bypass", "wall", "destination", "rooms"])
def test_starts_beside_the_printed_one_reach_too_by_the_same_way(world: str) -> None:
    (nominal,) = runs(world)
    for record in runs(world, "start_jitter_m=0.05", episodes=30):
        assert record.outcome == "reached"
        assert way(record) == way(nominal)
        assert record.metrics["time_s"] == pytest.approx(nominal.metrics["time_s"], rel=0.05)


@pytest.mark.parametrize("world", ["bypass", "rooms"])
def test_without_the_obstacle_agent_it_collides(world: str) -> None:
    (record,) = runs(world, "controller.build.switch.agents=[destination,wall]")
    assert record.outcome == "collided"


def test_a_dwell_ends_most_of_the_chatter() -> None:
    def switches(*changes: str) -> int:
        (record,) = runs("rooms", FIG_10_PERIOD, *changes)
        assert record.outcome == "reached"
        return int(np.count_nonzero(np.diff(trace(record, "agent"))))

    assert switches("controller.build.switch.dwell_periods=10") < 0.5 * switches()


def test_a_round_obstacle_is_circled_for_ever_unless_walls_may_be_left() -> None:
    disc: list[Any] = ["world.boxes=[]", "world.discs=[{x_m:4.25,y_m:1.75,radius_m:0.6}]"]
    (circling,) = runs("bypass", *disc)
    assert circling.outcome == "timed_out"
    (leaving,) = runs("bypass", *disc, "controller.build.switch.leave_wall_rad=0.0873")
    assert leaving.outcome == "reached"


def test_the_wall_stands_on_its_curve_and_passes_the_start_within_the_band() -> None:
    world = cell("wall").world.drawn_for(0, 0)
    boxes, discs, polygons = world.box_rows(), world.disc_rows(), world.polygon_rows()

    def surface_x_m(y_m: float) -> float:
        return 1.4483 - 0.1 * math.sin(2.0 * math.pi * (y_m - 0.4) / 4.0)

    for y_m in np.linspace(-0.5, 7.8, 400):
        assert distance_to_nearest(surface_x_m(y_m), y_m, boxes, discs, polygons) == pytest.approx(0.0, abs=2e-3)
        assert (
            distance_to_nearest(surface_x_m(y_m) - 0.025, y_m, boxes, discs, polygons) < 1e-9
        )  # no gap between two chords
    (record,) = runs("wall")
    assert 0.30 < trace(record, "d_s1_m")[0] < 0.35
    assert 0.30 < trace(record, "d_s10_m")[0] < 0.35


@pytest.mark.parametrize(
    ("world", "start", "goal"),
    [
        ("bypass", (0.5, 0.5), (8.0, 3.0)),
        ("wall", (1.9, 0.4), None),
        ("destination", (1.0, 1.0), (1.0, 4.0)),
        ("rooms", (3.0, 0.5), (6.0, 4.0)),
    ],
)
def test_starts_and_goals_are_the_printed_ones(
    world: str, start: tuple[float, float], goal: tuple[float, float] | None
) -> None:
    drawn = cell(world).world.drawn_for(0, 0)
    (begin,), (end,) = drawn.starts, drawn.goals
    assert (begin.x_m, begin.y_m) == start
    assert goal is None or (end.x_m, end.y_m) == goal
