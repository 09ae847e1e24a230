"""Sections on what controllers describe of themselves, and on how surely fleets succeed, on results made by hand."""

import math
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from stored import LEI2014, NEMEIKSIS2019, a_cell, a_record, store, told

from navbench.analysis.measuring import measure
from navbench.analysis.stored import StoredResults
from navbench.controllers.lei2014.sections import surface_2d, times_in
from navbench.controllers.nemeiksis2019.sections import counts, spells_on_path, switching_points
from navbench.experiments.store import Results
from navbench.records import RobotRecord
from navbench.report import page
from navbench.report.claims import printed_beside
from navbench.report.described import rule_grid
from navbench.report.outcomes import robustness

TABLES: dict[str, dict[str, Any]] = {
    "it-surface": {
        "x": [0.0, 0.0, 1.0, 1.0, 2.0, 2.0],
        "y": [0.0, 1.0, 0.0, 1.0, 0.0, 1.0],
        "z": [0.0, 0.25, 0.5, 0.5, 1.0, 0.75],
    },
    "it-rules": {
        "near": ["S", "S", "B"],
        "side": ["L", "R", "L"],
        "left": ["NB", "PB", "Z"],
        "right": ["PS", "NS", "PB"],
    },
    "it-list": {
        "number": [1, 2, 3, 4, 5],
        "agent": ["wall", "obstacle", "wall", "none", "wall"],
        "agrees": [True, True, False, True, True],
    },
}
HERE, THERE = {"label": "A"}, {"label": "B"}


def episode(clearance_m: float, contacts: int = 0, outcome: str = "reached", **changes: Any) -> RobotRecord:
    record = a_record(outcome, **changes)
    return record._replace(metrics={**record.metrics, "min_clearance_m": clearance_m, "collisions": contacts})


def store_fleets(path: Path, fleets: dict[str, list[list[RobotRecord]]]) -> StoredResults:
    """Return stored episodes of several robots, by their controller's label."""
    results = Results(path)
    cells = {label: a_cell(label) for label in fleets}
    results.begin(list(cells.values()), [], None)
    for label, episodes in fleets.items():
        rows = [
            (i, robot._replace(robot_index=k)) for i, robots in enumerate(episodes) for k, robot in enumerate(robots)
        ]
        results.write_batch(cells[label], range(len(episodes)), rows)
    results.end()
    return StoredResults(results)


@pytest.fixture
def reading(tmp_path: Path) -> StoredResults:
    here = [episode(0.4), episode(0.1), episode(0.3, outcome="timed_out"), episode(-0.01, 1, "collided")]
    there = [episode(0.2), episode(0.2), episode(0.3), episode(-0.02, 1, "collided")]
    cells = [(a_cell("A"), here), (a_cell("B"), there)]
    return store(tmp_path / "in", cells, descriptions=TABLES)


def test_counts_print_each_combination_once_and_keep_the_whole_table(reading: StoredResults, tmp_path: Path) -> None:
    text = told(counts, reading, tmp_path, file="c", table="it-list", by=["agent", "agrees"])
    lines = [line for line in text.splitlines() if line.startswith("|")][2:]
    assert lines == [
        "| none | True | 1 |",
        "| obstacle | True | 1 |",
        "| wall | False | 1 |",
        "| wall | True | 2 |",
    ]
    assert pd.read_csv(tmp_path / "tables/c.csv", keep_default_na=False).to_dict("list") == TABLES["it-list"]


def test_a_surface_lies_as_its_table_says_whatever_the_order_of_its_rows(
    reading: StoredResults, tmp_path: Path
) -> None:
    shuffled = {name: values[::-1] for name, values in TABLES["it-surface"].items()}
    other = store(tmp_path / "other", [(a_cell("A"), [a_record()])], descriptions={"it-surface": shuffled})
    drawn = []
    for i, one in enumerate((reading, other)):
        told(surface_2d, one, tmp_path / str(i), file="s", table="it-surface", x="x", y="y", value="z")
        drawn.append((tmp_path / str(i) / "figures/s.svg").read_bytes())
    assert drawn[0] == drawn[1]
    turned = {**TABLES["it-surface"], "z": TABLES["it-surface"]["z"][::-1]}
    third = store(tmp_path / "third", [(a_cell("A"), [a_record()])], descriptions={"it-surface": turned})
    told(surface_2d, third, tmp_path / "2", file="s", table="it-surface", x="x", y="y", value="z")
    assert (tmp_path / "2/figures/s.svg").read_bytes() != drawn[0]


def test_a_surface_has_the_one_column_to_the_right_and_the_other_upwards(
    reading: StoredResults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(page, "save_figure", lambda figure, *_: drawn.append(figure))
    told(surface_2d, reading, tmp_path, file="s", table="it-surface", x="x", y="y", value="z")
    ax = drawn[0].axes[0]
    assert (ax.get_xlim(), ax.get_ylim()) == ((0.0, 2.0), (0.0, 1.0))
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x", "y")


def test_described_rows_are_counted(reading: StoredResults) -> None:
    def count(**where: Any) -> tuple[float, int]:
        found = measure(reading, f"{NEMEIKSIS2019}.described_count", {"table": "it-list", "where": where})
        assert found is not None
        return found.value, found.n

    assert count(agent="wall") == (3.0, 5)
    assert count(agent="wall", agrees=True) == (2.0, 5)
    assert count(agent="floor") == (0.0, 5)


def test_a_fleet_is_free_when_none_of_its_robots_touched_anything(tmp_path: Path) -> None:
    fleets = store_fleets(tmp_path, {"A": [[episode(0.3), episode(0.2, 1)], [episode(0.3), episode(0.2)]]})
    found = measure(fleets, f"{LEI2014}.share_of_fleets_free", {"select": HERE})
    assert found is not None
    assert (found.value, found.n) == (0.5, 2)


def test_of_two_fleets_the_one_is_clearer_whose_least_clearance_is_greater(
    reading: StoredResults, tmp_path: Path
) -> None:
    found = measure(reading, f"{LEI2014}.share_of_fleets_clearer", {"select": HERE, "than": THERE})
    assert found is not None
    assert (found.value, found.n) == (0.5, 4)  # 0.4 > 0.2, 0.1 < 0.2, 0.3 = 0.3, -0.01 > -0.02
    fleets = {"A": [[episode(0.9), episode(0.1)]], "B": [[episode(0.2), episode(0.2)]]}
    found = measure(
        store_fleets(tmp_path / "two", fleets),
        f"{LEI2014}.share_of_fleets_clearer",
        {"select": HERE, "than": THERE},
    )
    assert found is not None
    assert (found.value, found.n) == (0.0, 1)


def test_robustness_counts_episodes_and_keeps_the_failures_clearance(reading: StoredResults, tmp_path: Path) -> None:
    text = told(robustness, reading, tmp_path, file="r", cells={"it": HERE}, worlds={"plain one": "plain"})
    row = pd.read_csv(tmp_path / "tables/r.csv").to_dict("records")[0]
    assert (row["reached"], row["free"], row["free_n"]) == (0.5, 0.75, 4)
    assert row["reached_low"] < 0.5 < row["reached_high"]
    assert row["clearance_m"] == pytest.approx(0.2)
    assert row["clearance_least_m"] == pytest.approx(-0.01)
    assert math.isnan(row["clearance_m_low"])  # a median of fewer than six has no interval
    assert "| plain one | it | 2 of 4: 0.500 [" in text
    assert "3 of 4: 0.750 [" in text


def test_where_nothing_stands_round_there_is_no_clearance(tmp_path: Path) -> None:
    alone = store(tmp_path / "in", [(a_cell("A"), [episode(math.inf)] * 3)])
    text = told(robustness, alone, tmp_path, file="r", cells={"it": HERE}, worlds={"plain": "plain"})
    assert "| – | – |\n" in text


def test_a_grid_holds_every_rule_where_its_inputs_meet(reading: StoredResults, tmp_path: Path) -> None:
    asked = {"table": "it-rules", "down": ["near"], "across": ["side"]}
    text = told(rule_grid, reading, tmp_path, of=["left"], **asked)
    assert "| near | side = L | side = R |" in text
    assert "| S | NB | PB |" in text
    assert "| B | Z | – |" in text  # no rule
    both = told(rule_grid, reading, tmp_path, of=["left", "right"], **asked)
    assert "| output | near | side = L | side = R |" in both
    assert "| right | S | PS | NS |" in both
    assert pd.read_csv(tmp_path / "tables/t.csv").to_dict("list") == TABLES["it-rules"]


def test_spells_that_begin_in_one_place_share_their_numbers(tmp_path: Path) -> None:
    record = a_record(time_s=8.0, length_m=2.4)
    states = [0.0, 1.0, 0.0, 0.0]
    places = record.states.copy()
    places[:, 1] = [0.0, 1.0, 1.01, 2.0, 2.4]
    record = record._replace(states=places)
    traced = record.traces.copy()
    traced[:4, 0] = states
    reading = store(tmp_path / "in", [(a_cell("A"), [record._replace(traces=traced)])])
    text = told(
        spells_on_path,
        reading,
        tmp_path,
        file="w",
        select=HERE,
        column="behavior",
        values={"go": 0.0, "follow": 1.0},
        least_periods=1,
        names={"2": "P1"},
    )
    table = pd.read_csv(tmp_path / "tables/w.csv")
    assert table["number"].tolist() == ["0", "1", "P1"]
    assert table["behavior"].tolist() == ["go", "follow", "go"]
    assert table["periods"].tolist() == [1, 1, 2]
    drawn = (tmp_path / "figures/w.svg").read_text()
    assert "<!-- 1, P1 -->" in drawn or ">1, P1<" in drawn
    assert "figures/w.png" in text


def test_the_change_near_a_switching_point_stands_beside_what_is_printed_of_it(tmp_path: Path) -> None:
    states, far_m = [0.0, 0.0, 1.0, 1.0], [4.0, 4.0, 3.0, 0.0]
    traced = a_record().traces.copy()
    traced[:4, 0], traced[:4, 2] = states, far_m
    reading = store(tmp_path / "in", [(a_cell("A"), [a_record()._replace(traces=traced)])])
    options: dict[str, Any] = {"select": HERE, "column": "behavior", "values": {"go": 0.0, "follow": 1.0}}
    options |= {"least_periods": 1, "at": {"P1": 1}, "printed": {"P1": "go, then follow"}, "within_periods": [1, 2]}
    told(switching_points, reading, tmp_path, file="s", changing={"far": "goal_distance_m"}, **options)
    (row,) = pd.read_csv(tmp_path / "tables/s.csv").to_dict("records")
    assert (row["point"], row["printed"], row["here"], row["t_s"]) == ("P1", "go, then follow", "go to follow", 5.0)
    assert (row["goal_distance_m_1"], row["goal_distance_m_2"]) == (0.25, 1.0)


def test_times_in_each_state_stand_by_window_and_in_danger(tmp_path: Path) -> None:
    traced = a_record().traces.copy()  # periods of 2.5 s
    traced[:4, 0], traced[:4, 2] = [0.0, 0.0, 1.0, 0.0], [0.0, 0.5, 1.0, 0.0]
    reading = store(tmp_path / "in", [(a_cell("A"), [a_record()._replace(traces=traced)])])
    windows = {
        "at first": {"printed": "mainly MG", "begin_s": 0.0, "end_s": 5.0},
        "then": {"printed": "mainly AO", "begin_s": 5.0, "end_s": 99.0},
        "too late": {"printed": "nothing", "begin_s": 50.0, "end_s": 99.0},
    }
    states, danger = {"MG": 0.0, "AO": 1.0}, ["goal_distance_m"]
    options: dict[str, Any] = {"column": "behavior", "states": states, "danger": danger, "level": 0.5}
    text = told(times_in, reading, tmp_path, file="t", windows=windows, cells={"here": HERE}, **options)
    lines = [line for line in text.splitlines() if line.startswith("|")][2:]
    assert lines == [
        "| at first | mainly MG | 100 | 0 |",
        "| then | mainly AO | 50 | 50 |",
        "| too late | nothing | – | – |",
        "| in danger | – | 50 | 50 |",
    ]


def test_claims_of_one_kind_stand_with_what_is_printed_beside_what_was_measured(tmp_path: Path) -> None:
    asked = {"metric": "time_s", "label": "A"}
    claim = {
        "says": "how long",
        "where": "Fig 1",
        "printed": "9.5 s",
        "within": "5 %",
        "measure": "median",
        "of": asked,
    }
    study = {
        "name": "s",
        "title": "S",
        "claims": {"time-a": claim, "other": {**claim, "says": "besides"}},
        "report": [],
    }
    reading = store(tmp_path / "in", [(a_cell("A"), [a_record(time_s=10.0)])], study)
    text = told(printed_beside, reading, tmp_path, claims=["time-"])
    assert "| how long | Fig 1 | 9.5 s | 10 |" in text
    assert "besides" not in text
