import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stored import TRACE, a_cell, a_record, store

from navbench.analysis.stored import StoredResults
from navbench.analysis.traces import spells
from navbench.controllers.nemeiksis2019 import measures
from navbench.controllers.nemeiksis2019.switch import pattern_of
from navbench.records import RobotRecord
from navbench.validation import DescriptionError

ALL = {"name": "printed"}


def a_run(outcome: Any = "reached", **columns: list[float]) -> RobotRecord:
    """Return what a robot did with this trace; at the end nothing acted any more."""
    n = max(map(len, columns.values()))
    states = np.column_stack([np.arange(n + 1.0), *(np.zeros(n + 1) for _ in range(5))])
    traces = np.full((n + 1, len(TRACE)), 0.0)
    for name, values in columns.items():
        traces[:n, TRACE.index(name)] = values
    traces[n] = np.nan
    return a_record(outcome, states=states, traces=traces)


def stored_of(path: Path, *records: RobotRecord) -> StoredResults:
    return store(path, [(a_cell(), list(records))])


def test_periods_are_counted_of_those_that_reached(tmp_path: Path) -> None:
    runs = [a_run(behavior=[0.0] * n) for n in (4, 6, 11)]
    stored = stored_of(tmp_path, *runs, a_run("collided", behavior=[0.0] * 100))
    assert measures.median_periods(stored, ALL) == (6.0, 4.0, 11.0, 3)


def test_spread_and_last_value_leave_out_the_row_at_the_end(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, a_run(goal_distance_m=[3.0, 5.0, 1.0]), a_run(goal_distance_m=[2.0, 2.0, 2.0]))
    assert measures.median_spread(stored, "goal_distance_m", ALL) == (2.0, 0.0, 4.0, 2)
    assert measures.median_last(stored, "goal_distance_m", ALL) == (1.5, 1.0, 2.0, 2)


def test_the_extremes_are_those_of_all_columns(tmp_path: Path) -> None:
    first = a_run(goal_distance_m=[3.0, 5.0, 1.0], heading_error_rad=[2.0, 6.0, 2.0])
    stored = stored_of(tmp_path, first, a_run(goal_distance_m=[2.0, 2.0], heading_error_rad=[2.0, 4.0]))
    both = ["goal_distance_m", "heading_error_rad"]
    assert measures.median_extreme(stored, both, "least", ALL) == (1.5, 1.0, 2.0, 2)
    assert measures.median_extreme(stored, both, "greatest", ALL) == (5.0, 4.0, 6.0, 2)


def test_a_band_counts_the_periods_in_which_all_columns_lie_in_it(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path, a_run(goal_distance_m=[0.30, 0.35, 0.36, 0.32], heading_error_rad=[0.32, 0.29, 0.32, 0.35])
    )
    found = measures.share_of_periods_within(stored, ["goal_distance_m", "heading_error_rad"], 0.30, 0.35, ALL)
    assert found == (0.5, math.nan, math.nan, 1)


def test_changing_and_rising_are_told_apart(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, a_run(stalled=[1.0, 1.0, 0.5, 0.4, 0.4]), a_run(stalled=[0.0, 0.0, 0.0, 0.0, 0.2]))
    changing = measures.share_of_periods_changing(stored, "stalled", 0.15, ALL)
    assert changing == (0.25, 0.25, 0.25, 2)
    falling = measures.share_never_rising(stored, "stalled", 0.1, ALL)
    assert falling is not None
    assert (falling.value, falling.n) == (0.5, 2)
    with_slack = measures.share_never_rising(stored, "stalled", 0.2, ALL)
    assert with_slack is not None
    assert with_slack.value == 1.0


def test_spells_leave_out_short_ones_and_join_what_they_parted() -> None:
    values = np.array([0.0] * 5 + [1.0] * 2 + [0.0] * 3 + [2.0] * 4 + [1.0])
    assert spells(values) == [(0.0, 0, 5), (1.0, 5, 2), (0.0, 7, 3), (2.0, 10, 4), (1.0, 14, 1)]
    assert spells(values, 3) == [(0.0, 0, 10), (2.0, 10, 4)]
    assert spells(values, 6) == []


@pytest.mark.parametrize(
    ("values", "least", "share"),
    [([0, 2, 0], 2, 1.0), ([0, 2], 2, 0.0), ([0, 2, 1, 0], 1, 1.0), ([0, 1, 2, 0], 1, 0.0)],
)
def test_a_sequence_must_hold_in_full_and_in_order(
    tmp_path: Path, values: list[float], least: int, share: float
) -> None:
    stored = stored_of(tmp_path, a_run(behavior=[0.0, 0.0, 2.0, 2.0, 2.0, 1.0, 0.0, 0.0]))
    found = measures.share_in_sequence(stored, "behavior", values, least, ALL)
    assert found is not None
    assert found.value == share


def test_changes_are_counted_with_every_blink(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, a_run(behavior=[0.0, 1.0, 0.0, 0.0, 2.0]))
    assert measures.median_changes(stored, "behavior", ALL) == (3.0, math.nan, math.nan, 1)


def test_a_jump_is_looked_for_around_the_switches_from_or_to_a_value(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path,
        a_run(
            behavior=[0.0] * 4 + [1.0] * 4 + [2.0] * 4 + [0.0] * 4,
            goal_distance_m=[0.0] * 4 + [10.0] * 10 + [9.0] * 2,
        ),
    )
    found = measures.share_jumping(stored, "goal_distance_m", "behavior", 0.0, 2, 0.5, ALL)
    assert found is not None
    assert (found.value, found.n) == (0.5, 2)  # at 4 it jumps, at 12 hardly; 1 to 2 is not looked at
    less = measures.share_jumping(stored, "goal_distance_m", "behavior", 0.0, 3, 0.1, ALL)
    assert less is not None
    assert less.value == 1.0  # 3 periods after the switch at 12 reach the small step


def test_an_unknown_column_is_named(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, a_run(behavior=[0.0]))
    with pytest.raises(DescriptionError, match="colour: there is no such column; allowed: .*behavior"):
        measures.median_spread(stored, "colour", ALL)


def test_nothing_to_measure_is_no_figure(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, a_run("collided", behavior=[0.0]))
    assert measures.median_periods(stored, ALL) is None
    assert measures.share_jumping(stored, "behavior", "behavior", 0.0, 1, 0.5, ALL) is None


def test_changes_count_where_another_column_has_a_value_before_or_after_them(tmp_path: Path) -> None:
    run = a_run(goal_distance_m=[1.0, 2.0, 2.0, 3.0, 4.0], behavior=[0.0, 1.0, 0.0, 0.0, 0.0])
    stored = stored_of(tmp_path, run)
    found = measures.share_of_changes_while(stored, "goal_distance_m", 0.5, "behavior", 1.0, ALL)
    assert found is not None
    assert found.value == pytest.approx(1.0 / 3.0)
    assert measures.share_of_changes_while(stored, "goal_distance_m", 5.0, "behavior", 1.0, ALL) is None


def test_changes_count_where_one_of_some_sensors_sees_before_or_after_them(tmp_path: Path) -> None:
    flank, front = pattern_of([1, 10]), pattern_of([1, 3])
    run = a_run(goal_distance_m=[1.0, 2.0, 2.0, 3.0, 4.0], stalled=[0.0, front, flank, flank, flank])
    named = tuple("pattern" if name == "stalled" else name for name in run.trace_names)
    stored = stored_of(tmp_path, run._replace(trace_names=named))
    for sensors, share in (([2, 3, 4], 1.0 / 3.0), ([1], 1.0), ([7, 8, 9], 0.0)):
        found = measures.share_of_changes_seen(stored, "goal_distance_m", 0.5, sensors, ALL)
        assert found is not None
        assert found.value == pytest.approx(share)
