"""What pictures show: words beside paths, chatter, ranges of what does not change, and fuzzy sets to their ends."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from stored import a_cell, a_record, store, told

from navbench.analysis.stored import StoredResults
from navbench.controllers.nemeiksis2019.sections import spells_on_path
from navbench.report import page
from navbench.report.described import memberships
from navbench.report.drawing import sparse
from navbench.report.figures import LINES_MAX, draw_cells, panel_of, save_figure
from navbench.report.paths import Word, cut, draw_marks, number_places, write_beside
from navbench.report.trajectories import chatter, time_series, trajectories

HERE = {"label": "A"}
CORNERS = [
    ("bearing", "back", 0.5 * math.pi, 0.0),
    ("bearing", "back", math.pi, 1.0),
    ("bearing", "back", 1.5 * math.pi, 0.0),
    ("bearing", "ahead", -math.pi, 0.0),
    ("bearing", "ahead", 0.0, 1.0),
    ("bearing", "ahead", math.pi, 0.0),
    ("distance", "near", 0.0, 1.0),
    ("distance", "near", 1.0, 0.0),
    ("distance", "far", 0.0, 0.0),
    ("distance", "far", 1.0, 1.0),
]
SETS = {name: [row[i] for row in CORNERS] for i, name in enumerate(("variable", "term", "x", "degree"))}


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Keeps the figures that sections draw, instead of saving them, which takes its time."""
    figures: list[Figure] = []

    def keep(figure: Figure, _out: Path, _stem: str) -> None:
        figures.append(figure)

    monkeypatch.setattr(page, "save_figure", keep)
    return figures


def a_reading(path: Path, behavior: list[float], **changes: Any) -> StoredResults:
    """Return what a robot did that drove straight ahead, with its behaviours, one more than it acted upon."""
    record = a_record(**changes)
    traced = record.traces.copy()
    traced[:, 0] = behavior
    record = record._replace(traces=traced)
    return store(path, [(a_cell("A"), [record])], descriptions={"it-sets": SETS})


def drawn(ax: Axes, line: int) -> Any:
    """Return the (n, 2) points of a line."""
    return np.asarray(ax.lines[line].get_xydata())


def test_jumps_there_and_back_are_chatter_and_steps_one_way_or_far_apart_are_not() -> None:
    t_s = np.linspace(0.0, 20.0, 201)
    values = np.zeros(201)
    values[50:60:2] = 1.0  # there and back in each period
    values[100:150] = 1.0  # for 5 s
    values[160:] = np.minimum(np.arange(41) / 10.0, 1.0)  # a ramp of ten steps
    assert (np.flatnonzero(chatter(t_s, values)) + 1).tolist() == list(range(50, 60))
    assert not chatter(t_s, np.zeros(201)).any()


def test_places_are_drawn_to_the_end_and_the_rest_is_held_over_its_periods(tmp_path: Path, kept: list[Figure]) -> None:
    reading = a_reading(tmp_path / "in", [0.0, 1.0, 1.0, 0.0, 0.0], time_s=8.0)
    series = {"place": {"x_m": "x"}, "behaviour": {"behavior": "b"}}
    told(
        time_series,
        reading,
        tmp_path,
        panels={"": HERE},
        series=series,
        ticks={"behaviour": {"go": 0, "follow": 1}},
    )
    place, behavior = kept[0].axes
    assert drawn(place, 0)[:, 0].tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]
    assert drawn(behavior, 0)[:, 0].tolist() == [0.0, 2.0, 2.0, 4.0, 4.0, 6.0, 6.0, 8.0]
    assert drawn(behavior, 0)[:, 1].tolist() == [0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0]
    assert [tick.get_text() for tick in behavior.get_yticklabels()] == ["go", "follow"]


def test_what_does_not_change_takes_the_range_of_its_row(tmp_path: Path, kept: list[Figure]) -> None:
    drives = {"A": [0.0, 40.0, -60.0, 0.0, 0.0], "B": [0.0] * 5}
    cells = []
    for label, behavior in drives.items():
        record = a_record()
        traced = record.traces.copy()
        traced[:, 0] = behavior
        cells.append((a_cell(label), [record._replace(traces=traced)]))
    reading = store(tmp_path / "in", cells)
    panels = {label: {"label": label} for label in drives}
    told(time_series, reading, tmp_path, panels=panels, series={"b": {"behavior": "b"}})
    assert kept[0].axes[0].get_ylim() == kept[0].axes[1].get_ylim()
    told(time_series, reading, tmp_path, panels={"": {"label": "B"}}, series={"b": {"behavior": "b"}})
    assert kept[1].axes[0].get_ylim() == (-0.5, 0.5)


def test_the_legend_of_a_way_names_only_what_drove(tmp_path: Path, kept: list[Figure]) -> None:
    reading = a_reading(tmp_path / "in", [0.0, 1.0, 1.0, 1.0, 1.0])
    values = {"go": 0.0, "follow": 1.0, "wait": 2.0}
    told(
        spells_on_path,
        reading,
        tmp_path,
        file="w",
        select=HERE,
        column="behavior",
        values=values,
        least_periods=1,
    )
    assert [text.get_text() for text in kept[0].legends[0].get_texts()] == ["go", "follow"]
    (left, right), (bottom, top) = kept[0].axes[0].get_xlim(), kept[0].axes[0].get_ylim()
    assert top - bottom == pytest.approx(0.4 * (right - left))  # a straight path leaves no empty square


def test_a_number_stands_beside_its_way_within_the_frame() -> None:
    figure = Figure(layout="constrained")
    ax = figure.subplots()
    ax.set(aspect="equal", xlim=(-10.0, 10.0), ylim=(-10.0, 10.0))
    along = np.linspace(0.0, 3.0, 100)
    way = pd.DataFrame({"x_m": along, "y_m": along, "heading_rad": np.full(100, 0.25 * math.pi)})
    cut(ax, [way], 0.1)
    number_places(ax, [(1, 0.0, 0.0), (2, 1.5, 1.5), (3, 3.0, 3.0)], 0.1, [way])
    figure.draw_without_rendering()
    points = ax.transData.transform(way[["x_m", "y_m"]].to_numpy())
    boxes = [text.get_window_extent() for text in ax.texts]
    assert {text.get_text() for text in ax.texts} == {"1", "2", "3"}
    for box in boxes:
        assert not any(box.contains(*point) for point in points)
        assert ax.bbox.contains(*box.min)
        assert ax.bbox.contains(*box.max)


def test_words_beside_places_that_crowd_cover_no_other() -> None:
    figure = Figure(layout="constrained")
    ax = figure.subplots()
    ax.set(aspect="equal", xlim=(-10.0, 10.0), ylim=(-10.0, 10.0))
    places = [(0.6 * i, 0.2 * j) for i in range(5) for j in range(2)]
    nothing = pd.DataFrame(places, columns=["x_m", "y_m"])
    write_beside(ax, [Word(place, f"R{10 + i}") for i, place in enumerate(places)], [nothing])
    figure.draw_without_rendering()
    boxes = {text.get_text(): text.get_window_extent() for text in ax.texts}
    inner = [box.padded(-3.0) for box in boxes.values()]  # a text's box is higher than its letters
    assert len(inner) == 10
    assert not any(one.overlaps(other) for i, one in enumerate(inner) for other in inner[:i])


def test_fuzzy_sets_go_round_a_circle_and_on_where_their_variable_saturates(tmp_path: Path, kept: list[Figure]) -> None:
    axes = {
        "bearing": {"title": "bearing", "low": -3.1416, "high": 3.1416, "circle": True},
        "distance": {"title": "distance", "low": 0.0, "high": 2.0, "saturates": True},
    }
    reading = a_reading(tmp_path / "in", [0.0] * 5)
    told(memberships, reading, tmp_path, file="m", table="it-sets", axes=axes)
    bearing, distance = kept[0].axes
    back = [drawn(bearing, i) for i in range(3)]  # a turn before, here, and a turn behind
    between = [np.interp(-0.75 * math.pi, line[:, 0], line[:, 1], left=0.0, right=0.0) for line in back]
    assert max(between) == pytest.approx(0.5, abs=1e-4)
    assert sorted(text.get_text() for text in bearing.texts) == ["ahead", "back", "back"]
    assert drawn(distance, 1)[-1].tolist() == [2.0, 1.0]
    assert drawn(distance, 0)[-1].tolist() == [1.0, 0.0]


def test_sets_in_radians_are_shown_in_degrees_where_that_is_asked(tmp_path: Path, kept: list[Figure]) -> None:
    axes = {"bearing": {"title": "bearing", "low": -180, "high": 180, "degrees": True}}
    reading = a_reading(tmp_path / "in", [0.0] * 5)
    told(memberships, reading, tmp_path, file="m", table="it-sets", axes=axes)
    told(memberships, reading, tmp_path, file="m", table="it-sets", axes={"bearing": {**axes["bearing"], "degrees": 0}})
    in_degrees, in_radians = (drawn(figure.axes[0], 0) for figure in kept)
    assert in_degrees[:, 0] == pytest.approx(np.degrees(in_radians[:, 0]))
    assert in_degrees[:, 1].tolist() == in_radians[:, 1].tolist()


def test_marks_stand_where_the_robot_is_at_each_interval_and_point_where_it_heads() -> None:
    path = pd.DataFrame({"t_s": [0.0, 2.0, 5.0], "x_m": [0.0, 2.0, 2.0], "y_m": [0.0, 0.0, 3.0]})
    ax = Figure().subplots()
    draw_marks(ax, path.assign(heading_rad=[0.0, 0.0, 0.5 * math.pi]), 2.0, 0.4, "black")
    (marks,) = ax.collections
    corners = np.array([np.asarray(triangle.vertices)[:3] for triangle in marks.get_paths()])
    assert corners.mean(axis=1) == pytest.approx(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]]))
    tips = corners[:, 0] - corners.mean(axis=1)
    assert np.arctan2(tips[:, 1], tips[:, 0]) == pytest.approx([0.0, 0.0, math.pi / 3.0])
    assert np.hypot(*tips.T) == pytest.approx(0.46 * 0.4)


def test_a_controller_tuned_more_than_once_is_marked_once(tmp_path: Path, kept: list[Figure]) -> None:
    cells = [(a_cell("A", tuning="pso", seed=seed), [a_record(time_s=8.0)]) for seed in (0, 1)]
    reading = store(tmp_path / "in", cells)
    told(trajectories, reading, tmp_path, panels={"": "plain"}, labels=["A"], marks_s=2.0)
    assert [len(marks.get_paths()) for marks in kept[0].axes[0].collections] == [4]  # at 0, 2, 4 and 6 s


def a_panel(path: Path, count: int) -> Any:
    """Return what is drawn of a cell of so many episodes, every tenth of which failed."""
    records = [a_record("timed_out" if i % 10 == 3 else "reached") for i in range(count)]
    stored = store(path, [(a_cell("A"), records)])
    return panel_of(stored, stored.manifest["cells"][0]["run_id"], stored.episodes)


@pytest.mark.parametrize(("count", "shown"), [(3, 3), (LINES_MAX, LINES_MAX), (2 * LINES_MAX + 1, 134)])
def test_a_panel_of_very_many_paths_shows_an_even_sample_and_its_title_says_so(
    tmp_path: Path, count: int, shown: int
) -> None:
    (ax,) = draw_cells([a_panel(tmp_path, count)]).axes
    lines, ends = ax.collections
    assert isinstance(lines, LineCollection)
    assert len(lines.get_segments()) == len(np.asarray(ends.get_offsets())) == shown
    assert (f"\n{shown} of {count} paths, taken evenly" in ax.get_title()) == (shown < count)
    assert len(np.unique(np.asarray(ends.get_edgecolor()), axis=0)) == (1 if count == 3 else 2)
    assert legend_of(ax)[0] == f"reached: {count - (count + 6) // 10}"


def test_a_panel_reaches_as_far_as_its_paths(tmp_path: Path) -> None:
    cell, world, episodes, trajectories = a_panel(tmp_path, 3)
    (within,) = draw_cells([(cell, world, episodes, trajectories)]).axes
    away = trajectories.assign(x_m=trajectories["x_m"] + 50.0)
    (beyond,) = draw_cells([(cell, world, episodes, away)]).axes
    assert beyond.get_xlim()[1] >= away["x_m"].max() > within.get_xlim()[1]
    assert beyond.get_xlim()[0] <= within.get_xlim()[0]


def legend_of(ax: Axes) -> list[str]:
    legend = ax.get_legend()
    assert legend
    return [text.get_text() for text in legend.get_texts()]


def test_a_thin_path_keeps_its_ends_and_strays_less_than_a_pixel(tmp_path: Path) -> None:
    angle = np.linspace(0.0, 5.0, 5000)
    points = np.column_stack([np.cos(angle), np.sin(angle)])
    thin = sparse(points, 0.01)
    assert len(thin) < 1000
    assert (thin[[0, -1]] == points[[0, -1]]).all()
    at = np.unwrap(np.arctan2(thin[:, 1], thin[:, 0]))
    assert np.hypot(*(points - np.column_stack([np.interp(angle, at, part) for part in thin.T])).T).max() < 0.01
    assert sparse(points[:1], 0.01).tolist() == points[:1].tolist()


def test_a_cell_of_which_nothing_was_driven_has_an_empty_panel(tmp_path: Path) -> None:
    cell, _, episodes, trajectories = a_panel(tmp_path, 2)
    (ax,) = draw_cells([(cell, None, episodes.assign(outcome="no_layout"), trajectories[:0])]).axes
    assert legend_of(ax) == ["no layout: 2"]


def test_a_layout_that_differs_in_its_last_digit_leaves_the_same_svg(tmp_path: Path) -> None:
    saved = []
    for x in (0.1, 0.1 + 1e-13):
        figure = Figure()
        for k in range(2):
            figure.add_axes((x, 0.1 + 0.45 * k, 0.7, 0.35)).plot([0.0, 1.0], [0.0, float(k)])
        save_figure(figure, tmp_path / str(x), "lines")
        saved.append((tmp_path / str(x) / "figures/lines.svg").read_bytes())
    assert saved[0] == saved[1]
    assert set(re.findall(rb'clipPath id="(\w+)"', saved[0])) == {b"clip0", b"clip1"}
    assert set(re.findall(rb"url\(#(\w+)\)", saved[0])) == {b"clip0", b"clip1"}
