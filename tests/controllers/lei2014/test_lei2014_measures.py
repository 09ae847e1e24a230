import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stored import a_cell, a_record, store

from navbench.analysis.measures import described_is_less, described_value
from navbench.analysis.stored import StoredResults
from navbench.controllers.lei2014.measures import (
    described_ratio,
    described_total,
    share_falling,
    share_longer_in,
    share_mainly,
    share_mainly_while,
    share_of_scenes,
    share_of_time,
    share_of_worlds_safer,
    share_on_circles,
    share_turning_as_printed,
    share_while,
    time_at_least,
    time_in,
    turning_cases,
)
from navbench.controllers.nemeiksis2019.measures import share_greater
from navbench.records import RobotRecord
from navbench.validation import DescriptionError

TABLES: dict[str, Any] = {
    "it-sizes": {"part": ["one", "two", "two"], "kind": ["a", "a", "b"], "rules": [4, 10, 20]},
    "it-surface": {"x": [0, 0, 0, 1, 1, 1], "y": [0, 1, 2, 2, 1, 0], "z": [3.0, 2.0, 2.5, 1.0, 1.0, 3.0]},
}
ONE, TWO = {"part": "one"}, {"part": "two", "kind": "b"}


def a_trajectory(states: list[float], period_s: float = 2.0, last_s: float = 1.0, **changes: Any) -> RobotRecord:
    """Return a record whose trace is a state a control period, the last of which is cut short."""
    t_s = np.append(period_s * np.arange(len(states)), period_s * (len(states) - 1) + last_s)
    rows = np.zeros((len(t_s), 6))
    rows[:, 0] = t_s
    traces = np.column_stack([np.append(states, np.nan), np.append(np.array(states) / 10.0, np.nan)])
    return a_record(time_s=float(t_s[-1]), states=rows, traces=traces, trace_names=("state", "level"), **changes)


def stored_of(path: Path, **labels: list[RobotRecord]) -> StoredResults:
    cells = [(a_cell(label), records) for label, records in labels.items()]
    return store(path, cells or [(a_cell("A"), [a_record()])], descriptions=TABLES)


def test_a_described_value_is_that_of_the_one_row_that_matches(tmp_path: Path) -> None:
    stored = stored_of(tmp_path)
    assert described_value(stored, "it-sizes", "rules", TWO) == (20.0, math.nan, math.nan, 1)
    with pytest.raises(DescriptionError, match="2 rows match"):
        described_value(stored, "it-sizes", "rules", {"part": "two"})
    with pytest.raises(DescriptionError, match="0 rows match"):
        described_value(stored, "it-sizes", "rules", {"part": "three"})


@pytest.mark.parametrize(
    ("table", "column", "where", "says"),
    [
        ("it-size", "rules", ONE, "no description 'it-size'; there are: it-sizes, it-surface"),
        ("it-sizes", "rule", ONE, "no column 'rule'; there are: part, kind, rules"),
        ("it-sizes", "rules", {"prat": "one"}, "no column 'prat'"),
    ],
)
def test_a_wrong_name_is_named(tmp_path: Path, table: str, column: str, where: Any, says: str) -> None:
    with pytest.raises(DescriptionError, match=says):
        described_value(stored_of(tmp_path), table, column, where)


def test_described_values_are_added_and_compared(tmp_path: Path) -> None:
    stored = stored_of(tmp_path)
    assert described_total(stored, "it-sizes", "rules") == (34.0, math.nan, math.nan, 3)
    assert described_ratio(stored, "it-sizes", "rules", ONE, over=TWO) == (0.2, math.nan, math.nan, 1)
    for where, than, held in ((ONE, TWO, 1.0), (TWO, ONE, 0.0), (ONE, ONE, 0.0)):
        found = described_is_less(stored, "it-sizes", "rules", where, than)
        assert found is not None
        assert found.value == held


@pytest.mark.parametrize(("within", "share"), [(0.0, 6 / 7), (0.4, 6 / 7), (0.5, 1.0)])
def test_a_surface_falls_from_each_point_to_the_next_along_an_axis(tmp_path: Path, within: float, share: float) -> None:
    found = share_falling(stored_of(tmp_path), "it-surface", "z", ["x", "y"], within)  # it rises from 2 to 2.5 once
    assert found is not None
    assert found.value == pytest.approx(share)
    assert found.n == 7


def test_a_level_holds_from_its_first_period_to_the_one_after_its_last(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path,
        A=[a_trajectory([0.0, 3.0, 0.0, 4.0, 0.0]), a_trajectory([0.0, 0.0, 2.0, 3.0]), a_trajectory([0.0, 1.0])],
    )
    for when, expected in (("begin", (4.0, 2.0, 6.0, 2)), ("end", (7.5, 7.0, 8.0, 2))):
        assert time_at_least(stored, ["level"], 0.3, when, {"label": "A"}) == pytest.approx(expected)  # type: ignore[arg-type]
    assert time_at_least(stored, ["level"], 0.5, "begin", {"label": "A"}) is None


def test_the_largest_of_several_columns_counts(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_trajectory([0.0, 3.0, 0.0])])
    found = time_at_least(stored, ["level", "state"], 1.0, "begin", {"label": "A"})
    assert found is not None
    assert found.value == 2.0


def test_a_share_of_time_weighs_the_period_that_is_cut_short(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_trajectory([0.0, 1.0, 2.0]), a_trajectory([2.0, 2.0])])
    assert share_of_time(stored, "state", [2.0], {"label": "A"}) == pytest.approx((0.6, 0.2, 1.0, 2))
    assert share_of_time(stored, "state", [0.0, 1.0], {"label": "A"}) == pytest.approx((0.4, 0.0, 0.8, 2))
    late = share_of_time(stored, "state", [2.0], {"label": "A"}, begin_s=4.0)  # which only the first lives to see
    assert late is not None
    assert (late.value, late.n) == (1.0, 1)


@pytest.mark.parametrize(
    ("states", "begin_s", "end_s", "share", "n"),
    [
        ([0.0], 0.0, 100.0, 1.0, 2),
        ([1.0], 0.0, 100.0, 0.0, 2),
        ([0.0, 1.0], 0.0, 100.0, 0.5, 2),  # in the second, 1 takes no more time than 2
        ([1.0], 4.0, 6.0, 0.5, 2),
        ([0.0], 2.0, 4.0, 1.0, 2),  # the period that begins at 4 s is another one
        ([2.0], 8.0, 100.0, 0.0, 1),  # only one robot lasts that long
    ],
)
def test_mainly_means_more_than_any_other_state(
    tmp_path: Path, states: list[float], begin_s: float, end_s: float, share: float, n: int
) -> None:
    stored = stored_of(tmp_path, A=[a_trajectory([0.0, 0.0, 1.0, 1.0, 0.0]), a_trajectory([0.0, 0.0, 2.0])])
    found = share_mainly(stored, "state", states, begin_s, end_s, {"label": "A"})
    assert found is not None
    assert (found.value, found.n) == (share, n)


@pytest.mark.parametrize(("states", "share"), [([0.0], 1.0), ([0.0, 1.0], 0.0)])
def test_robots_that_meet_are_one_case_which_holds_if_it_holds_for_all(
    tmp_path: Path, states: list[float], share: float
) -> None:
    robots = [a_trajectory([0.0, 0.0, 1.0, 1.0, 0.0]), a_trajectory([0.0, 0.0, 2.0])._replace(robot_index=1)]
    stored = store(tmp_path, [(a_cell("A"), [robots])])
    found = share_mainly(stored, "state", states, 0.0, 100.0, {"label": "A"})
    assert found == pytest.approx((share, math.nan, math.nan, 1), nan_ok=True)


def test_as_much_time_as_another_state_is_not_mainly(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_trajectory([0.0, 1.0], last_s=2.0)])
    found = share_mainly(stored, "state", [0.0], 0.0, 100.0, {"label": "A"})
    assert found is not None
    assert found.value == 0.0


def test_no_robot_that_lasts_is_no_case(tmp_path: Path) -> None:
    assert (
        share_mainly(stored_of(tmp_path, A=[a_trajectory([0.0])]), "state", [0.0], 50.0, 80.0, {"label": "A"}) is None
    )


def test_longer_in_a_state_compares_shares_of_time_pair_by_pair(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path,
        A=[
            a_trajectory([0.0, 1.0, 0.0]),
            a_trajectory([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            a_trajectory([1.0, 0.0]),
            a_trajectory([1.0]),
        ],
        B=[a_trajectory([0.0, 0.0, 0.0]), a_trajectory([1.0, 0.0]), a_trajectory([1.0, 0.0])],
    )
    found = share_longer_in(stored, "state", [1.0], {"label": "A"}, than={"label": "B"})
    assert found is not None
    assert found.value == pytest.approx(1 / 3)
    assert found.n == 3


def test_greater_compares_failures_too_and_a_tie_is_not_greater(tmp_path: Path) -> None:
    metrics = a_record().metrics
    near, far = ({**metrics, "min_clearance_m": value} for value in (0.1, 0.2))
    stored = stored_of(
        tmp_path,
        A=[a_record(metrics=far), a_record("collided", metrics=far), a_record(metrics=near)],
        B=[a_record(metrics=near), a_record(metrics=near), a_record(metrics=near)],
    )
    found = share_greater(stored, "min_clearance_m", {"label": "A"}, than={"label": "B"})
    assert found is not None
    assert found.value == pytest.approx(2 / 3)
    assert found.n == 3


def test_a_world_is_safer_where_more_robots_touch_nothing(tmp_path: Path) -> None:
    good, bad = a_record(), a_record("collided")
    cells = [
        (a_cell("A", "plain"), [good, good, bad]),
        (a_cell("B", "plain"), [bad, good, bad]),
        (a_cell("A", "other"), [bad, good]),
        (a_cell("B", "other"), [good, bad]),
    ]
    found = share_of_worlds_safer(store(tmp_path, cells), {"label": "A"}, than={"label": "B"})
    assert found == pytest.approx((0.5, math.nan, math.nan, 2), nan_ok=True)  # chosen worlds are no sample


def test_chosen_scenes_are_no_sample(tmp_path: Path) -> None:
    cells = [(a_cell("A", "plain"), [a_record()]), (a_cell("A", "other"), [a_record("collided")])]
    found = share_of_scenes(store(tmp_path, cells), {"label": "A"})
    assert found == pytest.approx((0.5, math.nan, math.nan, 2), nan_ok=True)


def test_a_state_lasts_from_its_first_period_to_the_end_of_its_last(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_trajectory([0.0, 1.0, 0.0, 1.0, 2.0])])
    assert time_in(stored, "state", 1.0, "begin", {"label": "A"}).value == 2.0  # type: ignore[union-attr]
    assert time_in(stored, "state", 1.0, "end", {"label": "A"}).value == 8.0  # type: ignore[union-attr]
    assert time_in(stored, "state", 5.0, "end", {"label": "A"}) is None


def test_what_is_mainly_done_in_danger_and_out_of_it_are_told_apart(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_trajectory([0.0, 0.0, 1.0, 2.0, 2.0])])

    def mainly(states: list[float], endangered: bool) -> float:
        found = share_mainly_while(stored, "state", states, ["level"], 0.1, endangered, {"label": "A"})
        assert found is not None
        return found.value

    assert (mainly([2.0], True), mainly([1.0], True), mainly([0.0], False)) == (1.0, 0.0, 1.0)


def test_a_share_in_danger_counts_its_periods_alone(tmp_path: Path) -> None:
    never = a_trajectory([0.0, 0.0])
    stored = stored_of(tmp_path, A=[a_trajectory([0.0, 0.0, 1.0, 2.0, 2.0]), a_trajectory([1.0, 2.0]), never])
    assert share_while(stored, "state", [2.0], ["level"], 0.1, {"label": "A"}) == pytest.approx((7 / 12, 0.5, 2 / 3, 2))
    assert share_while(stored, "state", [2.0], ["level"], 0.5, {"label": "A"}) is None


# --- eq. 3 ---


@pytest.mark.parametrize("track_m", [0.1, 0.4, 3.0])
def test_the_three_conclusions_on_eq_3_hold_for_any_track(tmp_path: Path, track_m: float) -> None:
    found = share_turning_as_printed(stored_of(tmp_path), track_m)
    assert found == pytest.approx((1.0, math.nan, math.nan, 3), nan_ok=True)  # three cases, but no sample
    straight, spot, circle = turning_cases(track_m)
    assert (straight[2], straight[3], straight[4]) == (math.inf, 0.1, 0.0)
    assert spot[2:4] == (0.0, 0.0)
    assert spot[4] == pytest.approx(0.2 / track_m)  # the left wheel leads: to the right
    assert circle[2] == pytest.approx(1.5 * track_m)
    assert circle[4] == pytest.approx(0.05 / track_m)


def test_only_periods_in_which_the_robot_turns_count_and_off_its_circle_it_fails(tmp_path: Path) -> None:
    t_s = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    v_mps, w_radps = np.full(5, 0.5), np.array([0.0, 1.0, 1.0, -2.0, 0.0])
    chord_m = np.append(0.5, 2.0 * np.abs(v_mps[1:4] / w_radps[1:4] * np.sin(0.5 * w_radps[1:4])))
    chord_m[2] += 1e-6  # beside its circle
    x_m = np.append(0.0, np.cumsum(chord_m))
    record = a_record(states=np.column_stack([t_s, x_m, 0.0 * t_s, 0.0 * t_s, v_mps, w_radps]), time_s=4.0)
    found = share_on_circles(store(tmp_path / "in", [(a_cell("A"), [record])]), {"label": "A"})
    assert found is not None
    assert found.value == pytest.approx(2 / 3)
    assert found.n == 3
