"""Measures of how robots drove, each on a few control periods made by hand."""

import math
from pathlib import Path
from typing import Any

import pytest
from stored import WORLD, ZHAO2017, Fleet, a_cell, a_drive, store

from navbench.analysis.measuring import measure
from navbench.analysis.stored import StoredResults
from navbench.mathematics.statistics import Estimate
from navbench.records import RobotRecord
from navbench.validation import DescriptionError

A = {"label": "A"}
Bands = dict[str, list[float]]


def stored_of(path: Path, *records: RobotRecord | Fleet) -> StoredResults:
    return store(path, [(a_cell("A"), records)])


def value_of(stored: StoredResults, name: str, **arguments: Any) -> Estimate | None:
    return measure(stored, name, {"select": A, **arguments})


def share_of(found: Estimate | None) -> tuple[float, int]:
    assert found is not None
    return found.value, found.n


# --- in what share of some periods something holds ---


def share_of_periods(stored: StoredResults, where: Bands, holds: Bands, settled_s: float = 0.0) -> Estimate | None:
    """Return what is measured of the periods in which the column "danger" is 0."""
    arguments = {"where": where, "holds": holds, "state": "danger", "settled_s": settled_s}
    return value_of(stored, f"{ZHAO2017}.share_of_periods", **arguments)


def calm(*v_mps: float, **trace: Any) -> RobotRecord:
    """Return a path without any danger."""
    return a_drive(v_mps, danger=[0.0] * len(v_mps), **trace)


def test_the_share_of_periods_is_the_median_robots_and_not_the_pooled_one(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path,
        calm(0.1, 0.2, 0.3, 0.4, on=[1, 1, 1, 0]),  # 2 of 3
        calm(*[0.1] * 9, on=[1] * 9),  # 9 of 9
        calm(0.5, 0.1, on=[1, 0]),  # 0 of 1
    )
    found = share_of_periods(stored, {"on": [1, 1]}, {"v_mps": [0.0, 0.2]})
    assert found == pytest.approx((2 / 3, 0.0, 1.0, 3))


def test_both_ends_of_a_band_lie_in_it_and_all_bands_must_hold(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, calm(0.1, 0.2, 0.3, 0.4, near_m=[1.0, 2.0, 3.0, 4.0], on=[1, 1, 0, 1]))
    cases: list[tuple[Bands, float]] = [
        ({"v_mps": [0.2, 0.4]}, 0.75),
        ({"v_mps": [0.2, 0.4], "near_m": [0.0, 3.0]}, 0.5),
        ({"v_mps": [0.2, 0.4], "near_m": [0.0, 3.0], "on": [1, 1]}, 0.25),
        ({}, 1.0),
    ]
    for holds, expected in cases:
        assert share_of(share_of_periods(stored, {}, holds)) == (expected, 1)
    found = share_of_periods(stored, {"on": [1, 1], "near_m": [2, 9]}, {"v_mps": [0.4, 1]})
    assert share_of(found) == (0.5, 1)


def test_the_end_of_a_way_is_no_period(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, calm(0.1, 0.5))  # the last speed stands twice in the table
    assert share_of(share_of_periods(stored, {}, {"v_mps": [0.5, 0.5]})) == (0.5, 1)


def test_without_a_state_all_periods_count(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, a_drive([0.1, 0.2, 0.3], on=[1, 1, 0]))
    found = value_of(stored, f"{ZHAO2017}.share_of_periods", where={"on": [1, 1]}, holds={"v_mps": [0.2, 1.0]})
    assert share_of(found) == (0.5, 1)


def test_robots_without_such_a_period_do_not_count_and_none_is_nothing(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, calm(0.1, on=[0]), calm(0.1, on=[1]))
    assert share_of(share_of_periods(stored, {"on": [1, 1]}, {"v_mps": [0, 1]})) == (1.0, 1)
    assert share_of_periods(stored, {"on": [2, 3]}, {}) is None


@pytest.mark.parametrize(
    ("settled_s", "expected"),
    [
        (0.0, 5 / 6),
        (1.0, 4 / 5),  # the path's first period does not count
        (1.001, 1 / 2),
        (2.0, 1 / 2),
        (2.5, 1.0),
        (3.5, None),
    ],
)
def test_periods_count_only_where_a_state_has_been_over_for_so_long(
    settled_s: float, expected: float | None, tmp_path: Path
) -> None:
    """Danger is in the periods from 2, 4 and 5 s; the others begin 0, 1, 1, 1, 2 and 3 s after it; one is slow."""
    speeds = [0.5, 0.5, 0.0, 0.5, 0.0, 0.0, 0.5, 0.1, 0.5]
    stored = stored_of(tmp_path, a_drive(speeds, danger=[0, 0, 1, 0, -2, 1, 0, 0, 0]))
    found = share_of_periods(stored, {}, {"v_mps": [0.5, 0.5]}, settled_s)
    if expected is None:
        assert found is None
    else:
        assert share_of(found) == pytest.approx((expected, 1))


def test_a_robot_that_is_always_in_danger_has_no_period_that_counts(tmp_path: Path) -> None:
    assert share_of_periods(stored_of(tmp_path, a_drive([0.5, 0.5], danger=[1, 1])), {}, {}) is None


# --- how low a column falls ---


def test_what_held_in_one_period_counts_at_the_bound_and_the_end_does_not(tmp_path: Path) -> None:
    lanes = [(0.0, float(y)) for y in (5, 4, 3, 0)]
    stored = stored_of(
        tmp_path,
        a_drive([0.1] * 3, near_m=[5.0, 2.0, 9.0]),
        a_drive([0.1] * 3, near_m=[5.0, 2.001, 9.0]),
        a_drive([0.1] * 3, near_m=[5.0, -1.0, 9.0], places=lanes),
    )
    assert share_of(value_of(stored, f"{ZHAO2017}.share_ever", holds={"near_m": [-9, 2.0]})) == pytest.approx(
        (2 / 3, 3)
    )
    # the third robot's y is 0 only at its end
    assert share_of(value_of(stored, f"{ZHAO2017}.share_ever", holds={"y_m": [-9, 0.0]})) == pytest.approx((2 / 3, 3))


# --- slowing down when a state begins ---


def test_slowing_is_looked_for_from_the_onset_on_and_within_the_time(tmp_path: Path) -> None:
    drive = a_drive([0.5, 0.5, 0.5, 0.4, 0.5], on=[0, 1, 1, 1, 1])
    stored = stored_of(tmp_path, drive)
    for within_s, slows in ((0.0, 0.0), (1.0, 0.0), (1.9, 0.0), (2.0, 1.0), (99.0, 1.0)):
        assert share_of(value_of(stored, f"{ZHAO2017}.share_slowing", column="on", within_s=within_s, quiet_s=0.0)) == (
            slows,
            1,
        )


def test_who_was_slow_before_the_onset_has_not_slowed_down_after_it(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, a_drive([0.1, 0.5, 0.5, 0.5], on=[0, 0, 1, 1]))
    assert share_of(value_of(stored, f"{ZHAO2017}.share_slowing", column="on", within_s=9.0, quiet_s=0.0)) == (0.0, 1)


def test_every_onset_counts_and_those_of_robots_that_stand_or_back_do_not(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path,
        a_drive([0.5, 0.3, 0.3, 0.3, 0.0, 0.2, -0.1, 0.2], on=[0, 1, 0, 1, 0, 1, 0, 1]),
        a_drive([0.1, 0.5], on=[1, 1]),  # it was in it from the beginning: no onset
    )
    assert share_of(value_of(stored, f"{ZHAO2017}.share_slowing", column="on", within_s=0.5, quiet_s=0.0)) == (0.5, 2)


def test_a_state_of_any_sign_is_a_state_and_without_an_onset_there_is_nothing(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, a_drive([0.5, 0.1], on=[0, -2], off=[0, 0]))
    assert share_of(value_of(stored, f"{ZHAO2017}.share_slowing", column="on", within_s=1.0, quiet_s=0.0)) == (1.0, 1)
    assert value_of(stored, f"{ZHAO2017}.share_slowing", column="off", within_s=1.0, quiet_s=0.0) is None


def test_a_state_that_flickers_is_entered_once(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, a_drive([0.5, 0.3, 0.3, 0.4, 0.3, 0.3], on=[0, 1, 0, 1, 0, 0]))
    for quiet_s, expected in ((0.0, (0.5, 2)), (1.0, (0.5, 2)), (1.5, (1.0, 1)), (2.0, (1.0, 1))):
        found = value_of(stored, f"{ZHAO2017}.share_slowing", column="on", within_s=0.5, quiet_s=quiet_s)
        assert share_of(found) == expected


# --- speeding up again when a state is over ---


def test_a_speed_is_regained_only_after_the_states_last_end(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path,
        a_drive([0.5, 0.1, 0.5, 0.1, 0.2], on=[0, 1, 0, 1, 0]),  # 0.5 lies between two spans
        a_drive([0.5, 0.1, 0.3], on=[0, 1, 0]),
        a_drive([0.5, 0.1, 0.3], on=[0, 1, 1]),  # it was never over
        a_drive([0.5, 0.5, 0.5], on=[0, 0, 0]),  # never in it: left out
    )
    assert share_of(
        value_of(stored, f"{ZHAO2017}.share_regaining", column="on", speed_mps=0.3, beyond={})
    ) == pytest.approx((1 / 3, 3))
    assert share_of(
        value_of(stored, f"{ZHAO2017}.share_regaining", column="on", speed_mps=0.2, beyond={})
    ) == pytest.approx((2 / 3, 3))
    assert share_of(value_of(stored, f"{ZHAO2017}.share_regaining", column="on", speed_mps=0.31, beyond={})) == (0.0, 3)


def test_who_never_was_in_a_state_regains_nothing(tmp_path: Path) -> None:
    assert (
        value_of(
            stored_of(tmp_path, a_drive([0.5], on=[0])),
            f"{ZHAO2017}.share_regaining",
            column="on",
            speed_mps=0.1,
            beyond={},
        )
        is None
    )


def test_a_robot_whose_last_danger_lies_elsewhere_is_left_out(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path,
        a_drive([0.5, 0.1, 0.5], on=[0, 1, 0], D=[9.0, 5.0, 1.0]),
        a_drive([0.5, 0.1, 0.1], on=[0, 1, 0], D=[9.0, 3.9, 1.0]),
    )
    found = value_of(stored, f"{ZHAO2017}.share_regaining", column="on", speed_mps=0.5, beyond={"D": [4.0, 99.0]})
    assert share_of(found) == (1.0, 1)


# --- fleets that all reach ---


def test_only_fleets_that_all_reach_pass_and_one_robot_makes_a_fleets_case(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path,
        [a_drive([0.5, -0.2, 0.5], index=0), a_drive([0.5, 0.3, 0.5], index=1)],
        [a_drive([0.5, 0.4, 0.5], index=0), a_drive([0.5, -0.3, 0.5], "collided", index=1)],
    )
    backing = {"holds": {"v_mps": [-9.0, 0.0]}}
    for more, expected in (({}, (0.5, 4)), ({"passing": True}, (0.5, 2)), ({"of_fleets": True}, (1.0, 2))):
        assert share_of(value_of(stored, f"{ZHAO2017}.share_ever", **backing, **more)) == expected
    assert share_of(value_of(stored, f"{ZHAO2017}.least_speed")) == pytest.approx((0.15, 2))  # 0 and 0.3
    first = {"select": {**A, "robot_index": 0}, **backing, "passing": True}  # whose fleet reached only once
    assert share_of(measure(stored, f"{ZHAO2017}.share_ever", first)) == (1.0, 1)


# --- turning by the wheels ---


def a_turn(turning: list[float], on: list[int], left: list[float], right: list[float]) -> RobotRecord:
    """Return a path with a turning rate and two told wheel speeds for each period."""
    drive = a_drive([0.1] * len(turning), on=on, vL_mps=left, vR_mps=right)
    states = drive.states.copy()
    states[:, 5] = [*turning, turning[-1]]
    return drive._replace(states=states)


def test_a_turn_is_judged_by_its_last_period_and_counts_where_it_lasts(tmp_path: Path) -> None:
    turns = [
        a_turn([-0.1, 0.2, 0.2], [1, 1, 1], [0.0] * 3, [1.0] * 3),  # to the left, after a period of lag
        a_turn([-0.1, -0.2, 0.2], [1, 1, 0], [0.0] * 3, [1.0] * 3),  # it never turns to the left while it is told so
        a_turn([-0.1, -0.2, 0.2], [1, 1, 1], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]),  # to the right, then to the left
        a_turn([0.1, 0.1, 0.1], [1, 1, 1], [1.0] * 3, [1.0] * 3),  # no wheel is told to be faster
        a_turn([0.1, 0.1, 0.1], [0, 0, 0], [0.0] * 3, [1.0] * 3),  # never in the state
    ]
    stored = stored_of(tmp_path, *turns)
    for lasting_s, expected in ((1.0, (3 / 4, 4)), (2.0, (2 / 3, 3)), (3.0, (1.0, 1))):
        found = value_of(stored, f"{ZHAO2017}.share_turning_by_wheels", column="on", lasting_s=lasting_s)
        assert share_of(found) == pytest.approx(expected)
    assert value_of(stored, f"{ZHAO2017}.share_turning_by_wheels", column="on", lasting_s=3.1) is None


# --- how fast a disc comes nearer ---


def test_the_told_approach_is_the_reading_over_r_and_the_true_one_what_the_robot_moved(tmp_path: Path) -> None:
    cell = a_cell("A", scene=WORLD | {"boxes": [], "discs": [{"x_m": 2.0, "y_m": 0.0, "radius_m": 0.5}]})
    mounts = [{"heading_rad": 0.0}, {"heading_rad": math.pi / 2.0}]  # the second one sees nothing
    cell = cell._replace(configuration={**cell.configuration, "sensors": {"mounts": mounts}})
    drive = a_drive(
        [0.1, 0.1, 0.1, -0.1, 0.1],
        places=[(0.0, 0.0), (0.1, 0.0), (0.2, 0.0), (0.1, 0.0), (0.2, 0.0), (0.3, 0.0)],
        active_flc=[0, 1, 1, 1, 1],
        danger_sensor=[0, 0, 0, 0, 1],
        R_s=[1.0, 0.65, 0.2, 1.3, 1.0],  # of readings of 1.3, 1.2 and 1.3 m: 2, 6 and 1 m/s
    )
    stored = store(tmp_path, [(cell, [drive])])
    assert share_of(value_of(stored, f"{ZHAO2017}.share_possible_approach", speed_mps=2.5)) == pytest.approx((2 / 3, 1))
    for told, expected in ((True, 2.0), (False, 0.1)):
        assert share_of(value_of(stored, f"{ZHAO2017}.median_approach", told=told)) == pytest.approx((expected, 1))
    assert share_of(value_of(stored, f"{ZHAO2017}.share_not_approaching")) == pytest.approx((1 / 3, 1))


# --- one passes first ---

PASSING: dict[str, Any] = {
    "column": "on",
    "first": 0,
    "second": 1,
    "slow_mps": 0.2,
    "fast_mps": 0.4,
    "within_m": 1.0,
    "settled_s": 0.0,
}
ONE_PASSES = ([0.5, 0.1, 0.3, 0.5, 0.5], [1, 1, 1, 0, 0])
OTHER_FOLLOWS = ([0.5, 0.1, 0.1, 0.1, 0.5], [1, 1, 1, 1, 0])


def passing(path: Path, one: Any = ONE_PASSES, other: Any = OTHER_FOLLOWS, **changes: Any) -> tuple[float, int]:
    fleet = [a_drive(v, index=i, on=on) for i, (v, on) in enumerate((one, other))]
    arguments = PASSING | changes
    return share_of(value_of(stored_of(path, fleet), f"{ZHAO2017}.share_passing_first", **arguments))


def test_one_passes_and_the_other_follows(tmp_path: Path) -> None:
    assert passing(tmp_path / "as told") == (1.0, 1)
    assert passing(tmp_path / "the other way round", first=1, second=0) == (0.0, 1)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (([0.5, 0.2, 0.3, 0.5, 0.5], [1, 1, 1, 0, 0]), OTHER_FOLLOWS),  # the first never was slow with the other
        (ONE_PASSES, ([0.5, 0.1, 0.1, 0.1, 0.5], [1, 0, 1, 1, 0])),  # nor the other with the first in the state
        (ONE_PASSES, ([0.5, 0.1, 0.3, 0.5, 0.5], [1, 1, 1, 1, 0])),  # the first never was the faster one
        (([0.5, 0.1, 0.3, 0.5, 0.5], [1, 1, 1, 1, 1]), OTHER_FOLLOWS),  # the first never left the state
        (ONE_PASSES, ([0.5, 0.1, 0.1, 0.1, 0.4], [1, 1, 1, 1, 0])),  # the other never was fast again
        (ONE_PASSES, ([0.5, 0.1, 0.1], [1, 1, 1])),  # or ended before
        (([0.5, 0.1, 0.1, 0.3, 0.5], [1, 1, 1, 1, 0]), ([0.5, 0.1, 0.1, 0.1, 0.5], [1, 1, 0, 0, 0])),  # only afterwards
        (([0.5, 0.1, 0.3, 0.5, 0.5], [0, 1, 1, 1, 1]), OTHER_FOLLOWS),  # the first was out of it only before
    ],
)
def test_what_misses_a_step_or_its_order_is_no_passing(one: Any, other: Any, tmp_path: Path) -> None:
    assert passing(tmp_path, one, other) == (0.0, 1)


def test_the_other_may_follow_after_the_first_has_arrived_and_backing_is_as_slow_as_it_is_fast(tmp_path: Path) -> None:
    arrived = ([0.5, 0.1, 0.3, 0.5], [1, 1, 1, 0])
    assert passing(tmp_path / "arrived", arrived, ([0.5, 0.1, 0.1, 0.1, 0.1, 0.5], [1, 1, 1, 1, 1, 0])) == (1.0, 1)
    backing = ([0.5, -0.3, 0.3, 0.5], [1, 1, 1, 0])
    assert passing(tmp_path / "backing", backing) == (0.0, 1)


def test_who_never_meets_is_no_case_of_passing(tmp_path: Path) -> None:
    fleet = [a_drive(v, index=i, on=on) for i, (v, on) in enumerate((ONE_PASSES, OTHER_FOLLOWS))]
    stored = stored_of(tmp_path, fleet)
    assert value_of(stored, f"{ZHAO2017}.share_passing_first", **PASSING) is not None
    assert value_of(stored, f"{ZHAO2017}.share_passing_first", **(PASSING | {"within_m": -1.0})) is None


def test_a_state_that_is_back_at_once_was_not_left(tmp_path: Path) -> None:
    flickers = ([0.5, 0.1, 0.3, 0.5, 0.5, 0.5], [1, 1, 1, 0, 1, 1])
    follows = ([0.5, 0.1, 0.1, 0.1, 0.5, 0.5], [1, 1, 1, 1, 0, 0])
    assert passing(tmp_path / "left", flickers, follows) == (1.0, 1)
    assert passing(tmp_path / "back", flickers, follows, settled_s=1.5) == (0.0, 1)
    assert passing(tmp_path / "to the end", ONE_PASSES, OTHER_FOLLOWS, settled_s=100.0) == (1.0, 1)


def test_each_episode_is_one_case_of_passing(tmp_path: Path) -> None:
    def fleet(one: Any, other: Any) -> Fleet:
        return [a_drive(v, index=i, on=on) for i, (v, on) in enumerate((one, other))]

    stored = stored_of(tmp_path, fleet(ONE_PASSES, OTHER_FOLLOWS), fleet(OTHER_FOLLOWS, ONE_PASSES))
    assert share_of(value_of(stored, f"{ZHAO2017}.share_passing_first", **PASSING)) == (
        0.5,
        2,
    )


# --- what none of them is given ---


@pytest.mark.parametrize(
    "arguments",
    [
        {
            "name": f"{ZHAO2017}.share_of_periods",
            "where": {},
            "holds": {},
            "state": "on",
            "settled_s": 0.0,
        },
        {"name": f"{ZHAO2017}.share_ever", "holds": {"v_mps": [0.0, 1.0]}},
        {"name": f"{ZHAO2017}.share_slowing", "column": "on", "within_s": 1.0, "quiet_s": 0.0},
        {"name": f"{ZHAO2017}.share_regaining", "column": "on", "speed_mps": 1.0, "beyond": {}},
        {"name": f"{ZHAO2017}.share_passing_first", **PASSING},
    ],
)
def test_cells_that_do_not_exist_are_an_error(arguments: dict[str, Any], tmp_path: Path) -> None:
    stored = stored_of(tmp_path, a_drive([0.1], on=[1]))
    name = arguments.pop("name")
    with pytest.raises(DescriptionError, match="no episodes match"):
        measure(stored, name, {"select": {"label": "B"}, **arguments})


def test_a_robot_that_failed_before_its_first_period_has_no_way_that_counts(tmp_path: Path) -> None:
    at_once = a_drive([0.1], "controller_error", on=[1], danger=[0])
    at_once = at_once._replace(
        states=at_once.states[:1], traces=at_once.traces[:1], latencies_s=at_once.latencies_s[:0]
    )
    stored = stored_of(tmp_path, at_once, a_drive([0.5, 0.1, 0.5], on=[0, 1, 0], danger=[0, 1, 0]))
    assert share_of(share_of_periods(stored, {}, {"v_mps": [0.5, 0.5]})) == (1.0, 1)
    assert share_of(value_of(stored, f"{ZHAO2017}.share_slowing", column="on", within_s=1.0, quiet_s=0.0)) == (1.0, 1)
    assert share_of(value_of(stored, f"{ZHAO2017}.share_regaining", column="on", speed_mps=0.5, beyond={})) == (1.0, 1)
    found = value_of(stored, f"{ZHAO2017}.share_ever", holds={"v_mps": [-9.0, math.inf]})
    assert share_of(found) == (0.5, 2)
