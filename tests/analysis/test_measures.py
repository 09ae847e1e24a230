import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from stored import AOUF2019, LIMIT_S, TRACE, ZHAO2018, a_cell, a_record, store

from navbench.analysis.measuring import check_measure, measure
from navbench.analysis.stored import StoredResults
from navbench.controllers.aouf2019.measures import is_within, phases_of
from navbench.mathematics.statistics import Estimate
from navbench.records import RobotRecord
from navbench.validation import DescriptionError


def stored_of(path: Path, **labels: list[RobotRecord]) -> StoredResults:
    """Return a results directory with one cell a label."""
    return store(path, [(a_cell(label), records) for label, records in labels.items()])


def value_of(stored: StoredResults, name: str, **arguments: Any) -> Estimate:
    found = measure(stored, name, arguments)
    assert found is not None
    return found


def test_a_median_never_includes_a_failure(tmp_path: Path) -> None:
    records = [a_record(time_s=t) for t in (10.0, 12.0, 30.0)] + [
        a_record("collided", 1.0),
        a_record("timed_out", 60.0),
    ]
    stored = stored_of(tmp_path, A=records)
    assert value_of(stored, "median", metric="time_s", select={"label": "A"}) == (12.0, 10.0, 30.0, 3)


def test_a_median_of_failures_alone_is_nothing(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_record("collided")])
    assert measure(stored, "median", {"metric": "time_s", "select": {"label": "A"}}) is None
    assert measure(stored, f"{AOUF2019}.median_over_straight", {"select": {"label": "A"}}) is None


def test_the_straight_line_ends_at_the_edge_of_the_goal(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_record(length_m=2.9)])
    assert value_of(stored, f"{AOUF2019}.median_over_straight", select={"label": "A"}).value == pytest.approx(1.0)


def test_a_failure_is_worse_than_any_arrival_and_two_failures_say_nothing(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path,
        A=[a_record(time_s=10.0), a_record(time_s=50.0), a_record("collided", 1.0), a_record("collided", 1.0)],
        B=[a_record(time_s=11.0), a_record("collided", 1.0), a_record(time_s=50.0), a_record("timed_out", 60.0)],
    )
    found = value_of(stored, "share_better", metric="time_s", select={"label": "A"}, than={"label": "B"})
    assert found.value == pytest.approx(2 / 3)
    assert found.n == 3


def test_a_tie_is_not_better(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_record()], B=[a_record()])
    assert value_of(stored, "share_better", metric="time_s", select={"label": "A"}, than={"label": "B"}).value == 0.0


def test_as_good_allows_the_margin_and_demands_arrival_where_the_other_arrives(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path,
        A=[a_record(time_s=10.5), a_record(time_s=10.6), a_record("collided", 1.0), a_record("collided", 1.0)],
        B=[a_record(time_s=10.0), a_record(time_s=10.0), a_record(time_s=10.0), a_record("collided", 1.0)],
    )
    found = value_of(
        stored,
        f"{AOUF2019}.share_as_good",
        metric="time_s",
        select={"label": "A"},
        than={"label": "B"},
        margin=0.051,
    )
    assert (found.value, found.n) == (0.5, 4)


def test_an_order_must_hold_strictly_from_label_to_label_and_seeds_that_find_the_same_are_one(tmp_path: Path) -> None:
    times = {"A": (30.0, 30.0, 10.0, 30.0), "B": (20.0, 20.0, 20.0, 20.0), "C": (10.0, 20.0, 30.0, 10.0)}
    cells = [
        (a_cell(label, tuning=label, seed=seed, kp=1.0 + seed % 3), [a_record(time_s=time_s)])
        for label, all_s in times.items()
        for seed, time_s in enumerate(all_s)
    ]
    stored = store(tmp_path, cells)
    found = value_of(
        stored,
        f"{AOUF2019}.share_ordered",
        metric="time_s",
        labels=["A", "B", "C"],
        select={"name": "printed"},
    )
    assert (found.value, found.n) == pytest.approx((1 / 3, 3))


@pytest.mark.parametrize(("equal_within", "expected"), [("0 %", 1.0), ("1 %", 0.0)])
def test_an_order_by_less_than_what_is_equal_is_none(tmp_path: Path, equal_within: str, expected: float) -> None:
    stored = stored_of(tmp_path, A=[a_record(time_s=10.05)], B=[a_record(time_s=10.0)])
    found = value_of(
        stored,
        f"{AOUF2019}.share_ordered",
        metric="time_s",
        labels=["A", "B"],
        equal_within=equal_within,
        select={"name": "printed"},
    )
    assert found.value == expected


def test_a_path_is_straight_within_a_margin_and_only_if_it_reaches(tmp_path: Path) -> None:
    records = [a_record(length_m=2.9), a_record(length_m=3.2), a_record("collided", length_m=2.9)]
    stored = stored_of(tmp_path, A=records)
    found = value_of(stored, f"{AOUF2019}.share_straight", margin="5 %", select={"label": "A"})
    assert (found.value, found.n) == pytest.approx((1 / 3, 3))


@pytest.mark.parametrize(("changes_per_s", "expected"), [(0.1, 0.5), (0.2, 1.0)])
def test_a_run_is_smooth_by_its_changes_of_sign_a_second(tmp_path: Path, changes_per_s: float, expected: float) -> None:
    stored = stored_of(tmp_path, A=[a_record(time_s=10.0), a_record(time_s=20.0)])  # two changes each
    found = value_of(stored, f"{AOUF2019}.share_smooth", changes_per_s=changes_per_s, select={"label": "A"})
    assert found.value == expected


@pytest.mark.parametrize(("margin", "expected"), [("5 %", 1.0), ("20 %", 0.0)])
def test_what_spreads_a_metric_by_more_than_a_margin_affects_it(tmp_path: Path, margin: str, expected: float) -> None:
    stored = stored_of(tmp_path, A=[a_record(time_s=10.0)], B=[a_record(time_s=11.0)], C=[a_record("timed_out", 60.0)])
    arguments = {"metric": "time_s", "margin": margin, "select": {"name": "printed"}}
    assert value_of(stored, f"{AOUF2019}.affects", **arguments).value == expected


def test_a_ratio_of_medians_leaves_failures_out(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_record(time_s=10.0), a_record("timed_out", 60.0)], B=[a_record(time_s=40.0)])
    arguments = {"metric": "time_s", "select": {"label": "A"}, "than": {"label": "B"}}
    assert value_of(stored, f"{AOUF2019}.ratio_of_medians", **arguments).value == 0.25


def test_described_values_are_counted_once_each(tmp_path: Path) -> None:
    sets = {"variable": ["v", "v", "v", "w"], "term": ["S", "S", "L", "Z"]}
    stored = store(tmp_path, [(a_cell("A"), [a_record()])], descriptions={"it-sets": sets})
    arguments = {"table": "it-sets", "column": "term", "where": {"variable": "v"}}
    assert value_of(stored, f"{AOUF2019}.described_count", **arguments).value == 2.0


def test_an_order_with_a_label_that_never_arrived_is_nothing(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_record()], B=[a_record("collided")])
    arguments = {"metric": "time_s", "labels": ["A", "B"], "select": {"name": "printed"}}
    assert measure(stored, f"{AOUF2019}.share_ordered", arguments) is None


def test_shares_count_outcomes_with_an_exact_interval(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_record(), a_record("collided"), a_record("timed_out"), a_record("reached")])
    select = {"label": "A"}
    assert value_of(stored, "share_reached", select=select)[:1] == (0.5,)
    assert value_of(stored, "share_without_collision", select=select).value == 0.75
    found = value_of(
        stored,
        f"{AOUF2019}.share_with_outcome",
        outcomes=["timed_out", "collided"],
        select=select,
    )
    assert found.value == 0.5
    assert found.low == pytest.approx(0.0676, abs=1e-4)
    assert found.high == pytest.approx(0.9324, abs=1e-4)


def test_the_speed_is_taken_over_all_periods(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_record(length_m=2.0), a_record(length_m=4.0)])
    assert value_of(stored, f"{AOUF2019}.speed_range", select={"label": "A"}) == pytest.approx((0.3, 0.2, 0.4, 10))


def test_differences_are_paired_start_by_start(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path,
        A=[a_record(time_s=t) for t in (10.0, 20.0, 30.0, 40.0)] * 2,
        B=[a_record(time_s=11.0), a_record(time_s=22.0), a_record("collided", 1.0), a_record(time_s=41.0)] * 2,
    )
    reached = value_of(stored, "difference", metric="reached", select={"label": "A"}, than={"label": "B"})
    assert (reached.value, reached.n) == (0.25, 8)
    times = value_of(stored, "difference", metric="time_s", select={"label": "A"}, than={"label": "B"})
    assert times.value == pytest.approx((-1.0 - 2.0 - (LIMIT_S - 30.0) - 1.0) / 4)
    assert times.low <= times.value <= times.high


def test_a_start_that_one_side_met_twice_is_refused(tmp_path: Path) -> None:
    cells = [(a_cell("A", tuning="pso", seed=seed), [a_record()]) for seed in (0, 1)]
    stored = store(tmp_path, [*cells, (a_cell("B"), [a_record()])])
    with pytest.raises(DescriptionError, match="met the same start several times"):
        measure(stored, "difference", {"metric": "time_s", "select": {"label": "A"}, "than": {"label": "B"}})


def test_a_decrease_is_the_median_pairs_in_percent_of_the_other_and_negative_for_an_increase(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path,
        A=[a_record(time_s=9.0), a_record(time_s=15.0), a_record(time_s=6.0), a_record("collided", 1.0), a_record()],
        B=[
            a_record(time_s=10.0),
            a_record(time_s=10.0),
            a_record(time_s=10.0),
            a_record(),
            a_record("timed_out", 60.0),
        ],
    )
    found = value_of(
        stored,
        f"{ZHAO2018}.median_decrease",
        metric="time_s",
        select={"label": "A"},
        than={"label": "B"},
    )
    assert found == pytest.approx((10.0, -50.0, 40.0, 3))


def test_a_decrease_counts_each_tuning_and_is_nothing_where_never_both_reached(tmp_path: Path) -> None:
    tuned = [(a_cell("A", tuning="pso", seed=i, kp=float(i)), [a_record(time_s=8.0 - i)]) for i in (0, 1, 2)]
    stored = store(tmp_path, [*tuned, (a_cell("B"), [a_record(time_s=10.0)]), (a_cell("C"), [a_record("collided")])])
    arguments = {"metric": "time_s", "select": {"label": "A"}}
    found = value_of(stored, f"{ZHAO2018}.median_decrease", **arguments, than={"label": "B"})
    assert found == pytest.approx((30.0, 20.0, 40.0, 3))
    assert measure(stored, f"{ZHAO2018}.median_decrease", {**arguments, "than": {"label": "C"}}) is None


def test_hardly_shorter_is_what_falls_by_less_than_so_many_percent(tmp_path: Path) -> None:
    ours = [a_record(time_s=time_s) for time_s in (9.6, 9.4, 12.0)] + [a_record("collided", 1.0)]
    stored = stored_of(tmp_path, A=ours, B=[a_record(time_s=10.0)] * 4)
    arguments = {"metric": "time_s", "select": {"label": "A"}, "than": {"label": "B"}}
    for percent, share in ((5.0, 2 / 3), (3.9, 1 / 3), (7.0, 1.0)):
        found = value_of(stored, f"{ZHAO2018}.share_hardly_shorter", percent=percent, **arguments)
        assert (found.value, found.n) == pytest.approx((share, 3))


def test_rules_are_alike_where_both_wheels_are_told_the_same(tmp_path: Path) -> None:
    cells = {"R": ["S", "S", "M", "M"], "Phi": ["F", "B", "F", "B"], "vL": ["Z"] * 4, "vR": ["PB"] * 4}
    others = {**cells, "vL": ["Z", "NB", "Z", "Z"], "vR": ["PB", "PB", "PB", "NS"]}
    stored = store(tmp_path, [(a_cell("A"), [a_record()])], descriptions={"a-rules": cells, "b-rules": others})
    found = measure(stored, f"{ZHAO2018}.share_of_rules_alike", {"table": "a-rules", "other": "b-rules"})
    assert found is not None
    assert (found.value, found.n) == (0.5, 4)


def test_tunings_are_summed_up_over_their_seeds(tmp_path: Path) -> None:
    costs = {("pso", 0): [3.0, 2.0, 2.5, 4.0], ("pso", 1): [5.0, 4.0, 3.0, 1.0], ("fa", 0): [9.0, 9.0, 9.0, 8.0]}
    stored = store(tmp_path, [(a_cell(), [a_record()])], costs=costs)
    assert value_of(stored, f"{AOUF2019}.least_cost", tunings=["pso"]) == (1.5, 1.0, 2.0, 2)
    found = value_of(
        stored, f"{AOUF2019}.share_at_bound", parameter="kp", tunings=["pso", "fa"]
    )  # the best kp: 4, 10, 10
    assert (found.value, found.n) == pytest.approx((2 / 3, 3))


def test_a_selection_that_matches_nothing_is_an_error(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_record()])
    with pytest.raises(DescriptionError, match="no episodes match"):
        stored.select(label="B")
    with pytest.raises(DescriptionError, match="colour"):
        stored.select(colour="red")


def test_a_cell_that_stands_under_two_names_is_found_under_both(tmp_path: Path) -> None:
    first = a_cell("A")
    stored = store(tmp_path, [(first, [a_record()])])
    stored.manifest["cells"].append({**stored.manifest["cells"][0], "name": "laws"})
    again = StoredResults(stored.results)
    again.manifest = stored.manifest
    assert len(again.select(name="printed")) == len(again.select(name="laws")) == 1


@pytest.mark.parametrize(
    ("name", "of", "says"),
    [
        ("mean", {}, "key=mean: there is no such function; did you mean median"),
        ("median", {"metric": "time_s", "weight": 1}, "key: of.weight: unknown key; median takes metric, cell, label"),
        ("median", {"cell": "fair"}, "key: of.metric: missing; median takes metric, cell"),
        ("described_value", {"table": "t", "column": "c", "where": {}, "label": "A"}, "of.label: unknown key"),
        ("navbench.analysis.fleets.fleets", {}, "is no measure"),
        ("", {}, "key=: there is no such function"),
    ],
)
def test_an_unknown_measure_or_argument_is_refused_by_name(name: str, of: dict[str, Any], says: str) -> None:
    with pytest.raises(DescriptionError, match=re.escape(says)):
        check_measure("key", name, of, trust=False)


def test_cells_are_chosen_beside_the_arguments_and_than_says_what_differs(tmp_path: Path) -> None:
    cells = [
        (a_cell(label, name=name), [a_record(time_s=time_s)])
        for label, name, time_s in (("A", "fair", 10.0), ("B", "fair", 12.0), ("B", "printed", 90.0))
    ]
    stored = store(tmp_path, cells)
    fair = {"metric": "path_length_m", "cell": "fair", "label": "A"}
    assert measure(stored, "median", {**fair, "metric": "time_s"}) == (10.0, math.nan, math.nan, 1)
    for than in ("B", {"label": "B"}):
        assert measure(stored, "share_better", {**fair, "metric": "time_s", "than": than}) is not None
    same = measure(stored, "difference", {**fair, "than": {"cell": "printed", "label": "B"}})
    assert same == (0.0, math.nan, math.nan, 1)


def test_a_measure_of_a_users_own_module_is_asked_by_its_dotted_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "turned.py").write_text(
        "from navbench.analysis.estimates import median_of\n\n\n"
        "def turning(stored, factor, select):\n"
        "    return median_of(factor * stored.select(**select)['total_turning_rad'])\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    stored = stored_of(tmp_path / "stored", A=[a_record()])
    assert measure(stored, "turned.turning", {"factor": 2.0, "label": "A"}, trust=True) == (1.0, math.nan, math.nan, 1)
    with pytest.raises(DescriptionError, match="lies outside navbench"):
        measure(stored, "turned.turning", {"factor": 2.0, "label": "A"})


def test_any_metric_has_a_difference_over_the_pairs_in_which_both_reached(tmp_path: Path) -> None:
    stored = stored_of(
        tmp_path,
        A=[a_record(length_m=3.0), a_record(length_m=5.0), a_record("collided")] * 3,
        B=[a_record(length_m=4.0), a_record(length_m=6.0), a_record(length_m=1.0)] * 3,
    )
    found = value_of(stored, "difference", metric="path_length_m", select={"label": "A"}, than={"label": "B"})
    assert found == (-1.0, -1.0, -1.0, 6)


def a_trajectory(**columns: list[float]) -> pd.DataFrame:
    """Return a trajectory with this trace; its last row, where nothing acted, is added."""
    count = max(len(values) for values in columns.values())
    values = {name: [*columns.get(name, [0.0] * count), math.nan] for name in TRACE}
    return pd.DataFrame({"t_s": np.arange(count + 1.0), **values})


def names_of(trajectory: pd.DataFrame, outcome: str = "reached") -> list[str]:
    return [phase.name for phase in phases_of(trajectory, outcome)]


ESCAPE = a_trajectory(
    heading_error_rad=[-2.0, -1.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    goal_distance_m=[3.0, 3.0, 2.8, 2.0, 2.0, 2.0, 1.9, 1.7, 1.0],
    behavior=[0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0],
    stalled=[0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
    at_obstacle=[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0],
)


def test_an_escape_goes_through_all_phases_in_order() -> None:
    assert names_of(ESCAPE) == ["turn", "approach", "stall", "follow", "release", "approach", "reach"]
    assert [phase.row for phase in phases_of(ESCAPE, "reached")] == [2, 2, 4, 4, 7, 8, 9]


def test_a_failure_never_reaches() -> None:
    assert names_of(ESCAPE, "timed_out")[-1] == "approach"


def test_who_looks_ahead_at_the_start_does_not_turn() -> None:
    assert "turn" not in names_of(a_trajectory(heading_error_rad=[0.05, 2.0, 0.0]))


def test_standing_still_away_from_obstacles_is_no_stall() -> None:
    assert "stall" not in names_of(a_trajectory(stalled=[1.0, 1.0, 0.0]))
    assert "stall" in names_of(a_trajectory(stalled=[1.0, 1.0, 0.0], at_obstacle=[0.0, 1.0, 0.0]))


def test_wall_following_that_lasts_to_the_end_is_not_released() -> None:
    assert names_of(a_trajectory(behavior=[0.0, 1.0, 1.0]), "collided") == ["follow"]


def test_phases_may_have_others_between_them_but_not_another_order() -> None:
    happened = ["turn", "approach", "follow", "release", "follow", "release", "reach"]
    assert is_within(["turn", "follow", "reach"], happened)
    assert is_within(["follow", "release", "follow"], happened)
    assert not is_within(["release", "approach"], happened)
    assert not is_within(["stall"], happened)


def test_the_share_in_phases_counts_episodes(tmp_path: Path) -> None:
    straight = a_record()
    stored = stored_of(tmp_path, A=[straight, a_record("collided")])
    found = value_of(
        stored,
        f"{AOUF2019}.share_in_phases",
        phases=["approach", "reach"],
        select={"label": "A"},
    )
    assert (found.value, found.n) == (0.5, 2)


@pytest.mark.parametrize(
    ("name", "metric"), [("difference", "time_s"), ("difference", "success"), ("share_better", "time_s")]
)
def test_cells_of_two_simulators_are_not_compared(name: str, metric: str, tmp_path: Path) -> None:
    here, there = a_cell("A"), a_cell("B")
    planar = there._replace(names=there.names._replace(simulator="planar"))
    stored = store(tmp_path, [(here, [a_record()]), (planar, [a_record()])])
    with pytest.raises(DescriptionError, match="A and B ran in ideal and planar; compare cells of one simulator"):
        measure(stored, name, {"metric": metric, "label": "A", "than": "B"})


def test_what_is_selected_is_noted_with_its_simulator(tmp_path: Path) -> None:
    here, there = a_cell("A"), a_cell("B", name="fair")
    planar = there._replace(names=there.names._replace(simulator="planar"))
    stored = store(tmp_path, [(here, [a_record()]), (planar, [a_record()])])
    with stored.noting() as outer:
        with stored.noting() as inner:
            stored.select(label="B")
        assert inner.simulators == {"planar": {"fair"}}
        assert outer == inner
        stored.select(label="A")
    assert inner.simulators == {"planar": {"fair"}}
    assert outer.simulators == {"planar": {"fair"}, "ideal": {"printed"}}


def test_runs_whose_tuned_gains_hardly_differ_are_one_case_of_a_start(tmp_path: Path) -> None:
    gains = {"A": 5.0, "B": 5.09, "C": 5.11, "D": 9.0}  # searched between 0 and 10
    cells = [(a_cell(label, tuning="pso", kp=kp), [a_record(), a_record("collided")]) for label, kp in gains.items()]
    cells.append((a_cell("E", kp=5.0, gain=2.0), [a_record()] * 2))  # differs in what was not searched
    stored = store(tmp_path, cells, costs={("pso", 0): [1.0]})
    assert value_of(stored, "share_reached", select={"label": ["A", "B"]}).n == 2
    assert value_of(stored, "share_reached", select={"label": ["A", "B", "C", "D"]}).n == 6
    better = {"metric": "time_s", "than": {"label": ["A", "B", "D"]}}
    assert value_of(stored, "share_better", select={"label": "E"}, **better).n == 4
    assert len(stored.select(label=["A", "B"])) == 4
    alike = {"label": ["A", "C", "D"], "same_case": ["label"]}
    assert value_of(stored, "share_reached", select=alike).n == 2
    assert measure(stored, "share_better", {"metric": "time_s", "label": "E", "than": alike}).n == 2  # type: ignore[union-attr]
    with pytest.raises(DescriptionError, match="same_case=lable: did you mean label?"):
        stored.cases(label="A", same_case=["lable"])


def test_one_run_has_no_interval(tmp_path: Path) -> None:
    stored = stored_of(tmp_path, A=[a_record(time_s=10.0)])
    for name, of in (("share_reached", {}), ("median", {"metric": "time_s"})):
        found = value_of(stored, name, select={"label": "A"}, **of)
        assert math.isnan(found.low)
        assert math.isnan(found.high)


@pytest.mark.parametrize(("within", "better"), [(0.0, 0.75), ("1 %", 0.5), (0.05, 0.25)])
def test_arrivals_that_are_practically_equal_are_neither_better(
    within: float | str, better: float, tmp_path: Path
) -> None:
    times = [9.0, 9.8, 9.95, 10.05]
    stored = stored_of(tmp_path, A=[a_record(time_s=t) for t in times], B=[a_record(time_s=10.0)] * 4)
    of = {"metric": "time_s", "select": {"label": "A"}, "than": {"label": "B"}}
    assert value_of(stored, "share_better", **of, equal_within=within).value == better
