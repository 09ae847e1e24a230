"""The picture of an episode: what was driven, what was hit and where, what was active, and the trace over the time."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, PathPatch
from stored import CROSSING, WORLD, a_cell, a_drive, a_record, store

from navbench.analysis.stored import StoredResults
from navbench.records import Thing
from navbench.report.contacts import nearest_of, touch_of
from navbench.report.drawing import MOVER, draw_obstacles
from navbench.report.drives import Drive
from navbench.report.episodes import draw_episode, mark_step_s
from navbench.report.strips import trace_groups
from navbench.world import Bounds, Box, Disc, Mover, Point, Polygon, Wall
from navbench.world.grid import Grid
from navbench.world.layout import DrawnWorld, Start

BOUNDS = Bounds(-5.0, 5.0, -5.0, 5.0)


def a_world(**things: object) -> DrawnWorld:
    ends = {"starts": (Start(-4.0, 0.0),), "goals": (Point(4.0, 0.0),)}
    return DrawnWorld(bounds=BOUNDS, name="w", goal_tolerance_m=0.1, time_limit_s=9.0, **{**ends, **things})  # type: ignore[arg-type]


def a_path(*places: tuple[float, float, float]) -> pd.DataFrame:
    return pd.DataFrame(places, columns=["t_s", "x_m", "y_m"])


@pytest.mark.parametrize(
    ("thing", "here", "there"),
    [
        (Disc(1.0, 0.0, 0.5), (3.0, 0.0), (1.5, 0.0)),
        (Box(0.0, 0.0, 2.0, 1.0), (0.3, 2.0), (0.3, 0.5)),
        (Box(0.0, 0.0, 2.0, 1.0, 0.5 * math.pi), (0.3, 2.0), (0.3, 1.0)),
        (Box(0.0, 0.0, 2.0, 1.0), (4.0, 3.0), (1.0, 0.5)),  # a corner
        (Polygon(corners=(Point(0.0, 0.0), Point(2.0, 0.0), Point(0.0, 2.0))), (2.0, 2.0), (1.0, 1.0)),
    ],
)
def test_a_contact_lies_where_the_outline_is_nearest(
    thing: Disc | Box | Polygon, here: tuple[float, float], there: tuple[float, float]
) -> None:
    assert nearest_of(thing, *here) == pytest.approx(there)


def test_what_was_hit_stands_where_it_was_at_that_instant() -> None:
    along = Mover(radius_m=0.5, waypoints=(Point(0.0, 0.0), Point(0.0, 4.0)), speeds_mps=(1.0,))
    square = tuple(Point(x, y) for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)))
    turned = Mover(radius_m=1.0, waypoints=along.waypoints, speeds_mps=(1.0,), outline=square)
    world = a_world(movers=(turned, along), walls=(Wall(3.0, -1.0, 3.0, 1.0, 0.2),), boxes=(Box(-2.0, 0.0, 1.0, 1.0),))
    end = a_path((0.0, 0.0, 0.0), (2.0, 1.0, 2.0))

    def touched(kind: str, index: int, *others: pd.DataFrame) -> tuple[str, tuple[float, float]]:
        row = {"hit": kind, "hit_index": index, "robot_index": 0}
        touch = touch_of(world, row, [end, *others], 0.25)
        assert touch
        x_m, y_m = touch.place
        return touch.name, (round(x_m, 9), round(y_m, 9))

    assert touched("mover", 1) == ("mover 1", (0.5, 2.0))
    assert touched("mover", 0) == ("mover 0", (0.5, 2.0))
    assert touched("wall", 0) == ("wall 0", (2.9, 1.0))
    assert touched("box", 0) == ("box 0", (-1.5, 0.5))
    ended = a_path((0.0, 5.0, 2.0), (1.0, 3.0, 2.0))  # a robot that has ended stays where it was
    assert touched("robot", 1, ended) == ("R2", (2.75, 2.0))
    assert touch_of(world, {"hit": "", "hit_index": -1, "robot_index": 0}, [end], 0.25) is None


def test_a_cell_of_a_grid_is_where_its_index_says_and_all_cells_are_drawn() -> None:
    occupied = np.zeros((4, 6), dtype=bool)
    occupied[2, 3:5] = True
    world = a_world(grid=Grid.of(occupied, 0.5, -1.0, -1.0))
    row = {"hit": "cell", "hit_index": 2 * 6 + 3, "robot_index": 0}
    touch = touch_of(world, row, [a_path((0.0, 0.0, 0.0), (1.0, 0.0, 0.2))], 0.2)
    assert touch
    assert touch.thing == Box(0.75, 0.25, 0.5, 0.5)
    assert touch.place == pytest.approx((0.5, 0.2))
    ax = Figure().subplots()
    draw_obstacles(ax, world)
    (cells,) = [patch for patch in ax.patches if isinstance(patch, PathPatch)]
    inside = cells.get_path().contains_points([(0.75, 0.25), (1.25, 0.25), (0.25, 0.25), (0.75, 0.75)])
    assert inside.tolist() == [True, True, False, False]


def test_time_marks_come_each_second_until_they_would_crowd() -> None:
    assert mark_step_s(12.0, 6.0) == 1
    assert mark_step_s(12.0, 1.0) == 5  # hardly moved
    assert mark_step_s(400.0, 20.0) == 20
    for end_s in (3.0, 30.0, 300.0, 3000.0):
        assert end_s // mark_step_s(end_s, 100.0) <= 24


def test_columns_of_a_trace_share_an_axis_where_they_share_a_unit() -> None:
    trace = {"on": [0, 1], "a_m": [1.0, 2.0], "b_m": [3.0, 4.0], "turn_rad": [0.1, 0.2], "side": [-1, 1]}
    trace |= {"count": [1, 70], "active_go": [0, 1], "empty": [math.nan, math.nan], "w_radps": [1.0, 1.0]}
    path = pd.DataFrame({"t_s": [0.0, 1.0], "run_id": ["r", "r"], **trace})
    assert trace_groups(path) == {
        "0 or 1": ["on"], "[m]": ["a_m", "b_m"], "[degrees]": ["turn_rad"], "-1 to 1": ["side"], "count": ["count"]
    }  # fmt: skip


def text_of(figure: Figure) -> str:
    title = figure._suptitle  # type: ignore[attr-defined]
    return str(title.get_text())


def legend_of(ax: Axes) -> list[str]:
    legend = ax.get_legend()
    assert legend
    return [text.get_text() for text in legend.get_texts()]


def words_in(ax: Axes) -> set[str]:
    return {text.get_text() for text in ax.texts} - {""}


@pytest.fixture
def one_robot(tmp_path: Path) -> StoredResults:
    going = a_drive(
        [0.5] * 6, "collided", hit=Thing("box", 0), places=[(0.2 * i, 0.08 * i) for i in range(7)],
        active_go=[1, 1, 1, 0, 0, 0], active_turn=[0, 0, 0, 1, 1, 1], level_m=[0.1 * i for i in range(6)],
    )  # fmt: skip
    return store(tmp_path / "in", [(a_cell("A"), [going._replace(reason="hit box 0")])])


def test_a_picture_of_one_robot_tells_how_it_ended_what_it_hit_and_what_was_active(one_robot: StoredResults) -> None:
    figure = draw_episode(one_robot, one_robot.manifest["cells"][0]["run_id"], 0, note="the only one")
    where, v, w, level = figure.axes
    lines = text_of(figure).splitlines()
    assert lines[0] == "A in plain, episode 0, seed 0, ideal"
    assert lines[1:] == ["collided after 6.00 s: hit box 0", "the only one"]
    assert words_in(where) == {"R1", "box 0", "2", "4"}
    assert {"R1", "go active", "turn active", "time marks every 2 s", "contact", "collided"} <= {*legend_of(where)}
    outlined = [patch for patch in where.patches if not patch.get_fill() and not isinstance(patch, Circle)]
    assert len(outlined) == 1  # the box that was hit
    bands = [line for line in where.lines if line.get_linewidth() == 7.0]
    seen = [np.isfinite(np.asarray(band.get_xdata(), dtype=float)).sum() for band in bands]
    assert seen == [4, 4]  # three periods each, and the beginning of the next
    assert v.get_ylabel() == "v [m/s]"
    assert w.get_ylabel() == "w [rad/s]"
    assert legend_of(level) == ["level_m"]
    assert v.get_shared_x_axes().joined(v, level)
    assert len(v.patches) == 2  # each behaviour is active once


@pytest.mark.parametrize(
    ("native", "said"),
    [
        (None, ""),
        ({"radius_m": 0.5, "wheel_speed_max_mps": 0.25}, ", in the controller's own units: of a robot of radius 0.5 m"),
    ],
)
def test_a_trace_says_when_it_is_in_the_units_of_another_robot(
    tmp_path: Path, native: dict[str, float] | None, said: str
) -> None:
    cell = a_cell("A")
    cell.configuration["controller"]["native"] = {"period_s": 0.1, **({"robot": native} if native else {})}
    drive = a_drive([0.5] * 3, "timed_out", turn_rad=[0.0, math.pi, 0.0])
    stored = store(tmp_path, [(cell, [drive])])
    *_, trace = draw_episode(stored, stored.manifest["cells"][0]["run_id"], 0).axes
    assert trace.get_title(loc="left") == (f"trace{said}" if said else "")
    assert (legend_of(trace), trace.get_ylabel()) == (["turn"], "[degrees]")
    assert max(np.asarray(trace.lines[0].get_ydata(), dtype=float)) == 180.0


def test_movers_are_drawn_where_they_are_at_the_time_marks_and_at_the_end(tmp_path: Path) -> None:
    far = [(1.0 + 2.0 * i, 5.0) for i in range(5)]
    near = [(19.0 - 2.0 * i, 5.0) for i in range(4)]
    drives = [a_drive([2.0] * 4, places=far), a_drive([2.0] * 3, "timed_out", index=1, places=near)]
    stored = store(tmp_path / "in", [(a_cell("A", scene=CROSSING), [drives])])
    run_id = stored.manifest["cells"][0]["run_id"]
    figure = draw_episode(stored, run_id, 0)
    where = figure.axes[0]
    world = stored.world(run_id, 0)
    step_s = int(next(text for text in legend_of(where) if text.startswith("time marks")).split()[3])
    outlined = [patch for patch in where.patches if not patch.get_fill() and patch.get_linewidth() == 0.6]
    assert len(outlined) == len(world.movers) * (4 // step_s) > 0
    solid = [
        patch for patch in where.patches if patch.get_fill() and patch.get_facecolor()[:3] == pytest.approx(rgb(MOVER))
    ]
    assert len(solid) == len(world.movers)
    assert "1 of 2 robots reached; R2 timed out after 3.00 s" in text_of(figure)
    assert {"R1", "R2", *map(str, range(len(world.movers)))} <= words_in(where)
    alone = draw_episode(stored, run_id, 0, robot=1)
    assert "robot 1 (R2) of 2 timed out after 3.00 s" in text_of(alone)
    assert "R1" not in words_in(alone.axes[0])


def test_a_robot_that_was_hit_is_called_what_the_picture_calls_it() -> None:
    row = {"robot_index": 0, "outcome": "collided", "reason": "hit robot 11", "hit": "robot", "hit_index": 11}
    assert Drive(row, a_path((0.0, 0.0, 0.0), (1.5, 1.0, 0.0)), "red").end == "collided after 1.50 s: hit R12"


def rgb(color: str) -> tuple[float, float, float]:
    from matplotlib.colors import to_rgb

    return to_rgb(color)


def test_what_ended_before_its_first_period_is_drawn_without_a_path(tmp_path: Path) -> None:
    still = a_drive([0.0], "controller_error")
    still = still._replace(states=still.states[:1], traces=still.traces[:1], reason="ValueError: $x_$")
    stored = store(tmp_path / "in", [(a_cell("A", scene=WORLD), [still])])
    figure = draw_episode(stored, stored.manifest["cells"][0]["run_id"], 0)
    figure.draw_without_rendering()  # a dollar is no formula
    assert "controller error" in text_of(figure)
    assert len(figure.axes) == 3


def test_recorded_ranges_have_a_strip_with_a_row_for_each_sensor(tmp_path: Path) -> None:
    readings = np.arange(8.0).reshape(4, 2)
    stored = store(tmp_path / "in", [(a_cell("A"), [a_record(ranges_m=readings)])])
    figure = draw_episode(stored, stored.manifest["cells"][0]["run_id"], 0)
    strip = figure.axes[-1]
    assert strip.get_ylabel() == "sensor"
    (mesh,) = strip.collections
    np.testing.assert_array_equal(mesh.get_array(), readings.T)
    assert strip.get_xlim()[1] >= stored.results.trajectories()["t_s"].max()
