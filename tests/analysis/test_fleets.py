"""What fleets did together: tables, measures and what is drawn of them, on stored results made by hand."""

import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from stored import CROSSING, LIMIT_S, ROBOT, WORLD, ZHAO2017, ZHAO2018, Fleet, a_cell, a_drive, a_record, store, told

from navbench.analysis.fleets import fleets, successes
from navbench.analysis.measuring import measure
from navbench.analysis.stored import StoredResults
from navbench.cli.worlds import world_of
from navbench.controllers.zhao2018.sections import evolution, gains
from navbench.mathematics.statistics import Estimate
from navbench.records import Thing
from navbench.report.drawing import MOVER as MOVER_COLOUR
from navbench.report.outcomes import fleet_table
from navbench.report.tables import summarize, to_markdown, to_text
from navbench.report.trajectories import frames
from navbench.report.wheels import shares_of, spans_of, wheel_velocities
from navbench.validation import DescriptionError

A, B = {"label": "A"}, {"label": "B"}


@pytest.fixture(autouse=True)
def kept(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Keeps the figures that sections draw, instead of saving them, which takes its time."""
    figures: list[Figure] = []

    def keep(figure: Figure, _out: Path, _stem: str) -> None:
        figures.append(figure)

    monkeypatch.setattr("navbench.report.page.save_figure", keep)
    return figures


def a_fleet(*times_s: float | None, contacts: tuple[tuple[int, int, int], ...] = ()) -> Fleet:
    """Return an episode of robots that reached at these times; None for one that did not within the limit."""
    told = contacts or ((0, 0, 0),) * len(times_s)
    return [
        a_drive(
            [0.3] * 3, "timed_out" if t is None else "reached", i, time_s=LIMIT_S if t is None else t, contacts=told[i]
        )
        for i, t in enumerate(times_s)
    ]


def two_controllers(path: Path) -> StoredResults:
    here = [a_fleet(10.0, 12.0), a_fleet(30.0, 20.0), a_fleet(5.0, None), a_fleet(None, None)]
    there = [a_fleet(11.0, 11.0), a_fleet(11.0, None), a_fleet(None, None), a_fleet(None, 9.0)]
    return store(path, [(a_cell("A"), here), (a_cell("B"), there)])


# --- the table of fleets ---


def test_a_fleet_succeeds_when_all_reach_and_its_makespan_is_the_last_ones_time(tmp_path: Path) -> None:
    episodes = two_controllers(tmp_path).select(label="A")
    table = fleets(episodes)
    assert table["episode"].tolist() == [0, 1, 2, 3]
    assert table["robots"].tolist() == [2, 2, 2, 2]
    assert table["success"].tolist() == [True, True, False, False]
    assert [*successes(episodes).values()] == [True, True, False, False]
    assert table["makespan_s"].tolist()[:2] == [12.0, 30.0]
    assert table["sum_of_times_s"].tolist()[:2] == [22.0, 50.0]
    assert table[["makespan_s", "sum_of_times_s"]].iloc[2:].isna().to_numpy().all()


def test_contacts_of_a_fleet_are_summed_by_kind(tmp_path: Path) -> None:
    episodes = [
        a_fleet(9.0, 9.0, 9.0, contacts=((3, 2, 0), (2, 2, 2), (1, 0, 1))),
        a_fleet(9.0, 9.0, 9.0),
    ]
    table = fleets(store(tmp_path, [(a_cell("A"), episodes)]).episodes)
    assert table[["robot_contacts", "other_contacts", "standing_contacts"]].to_numpy().tolist() == [
        [4, 2, 3],
        [0, 0, 0],
    ]


@pytest.mark.parametrize("outcome", ["collided", "timed_out", "controller_error"])
def test_whatever_else_becomes_of_one_robot_is_no_success_of_the_fleet(outcome: str, tmp_path: Path) -> None:
    episode = [a_drive([0.3], index=0), a_drive([0.3], outcome, 1)]
    table = fleets(store(tmp_path, [(a_cell("A"), [episode])]).episodes)
    assert table["success"].tolist() == [False]
    assert math.isnan(table["makespan_s"][0])


def test_a_single_robot_is_a_fleet_of_one(tmp_path: Path) -> None:
    table = fleets(store(tmp_path, [(a_cell("A"), [a_record(time_s=7.0)])]).episodes)
    assert table[["robots", "makespan_s", "sum_of_times_s"]].to_numpy().tolist() == [[1, 7.0, 7.0]]


# --- the summary's columns ---


def test_the_summary_counts_fleets_and_averages_the_makespan_of_those_that_succeeded(tmp_path: Path) -> None:
    table = summarize(two_controllers(tmp_path).results.episodes())
    assert table["robots"].tolist() == [2, 2]
    assert table[["reached", "of"]].to_numpy().tolist() == [[5, 8], [4, 8]]
    assert table[["fleets", "episodes"]].to_numpy().tolist() == [[2, 4], [1, 4]]
    assert table["makespan_s"].tolist() == [21.0, 11.0]


def test_a_cell_without_a_success_has_no_makespan(tmp_path: Path) -> None:
    table = summarize(store(tmp_path, [(a_cell("A"), [a_fleet(9.0, None)])]).results.episodes())
    assert table[["fleets", "episodes"]].to_numpy().tolist() == [[0, 1]]
    assert math.isnan(table["makespan_s"][0])
    assert to_text(table).splitlines()[-1].split()[-1] == "–"


def test_fleets_are_printed_only_where_robots_drive_together(tmp_path: Path) -> None:
    many = summarize(two_controllers(tmp_path / "many").results.episodes())
    single = summarize(store(tmp_path / "single", [(a_cell("A"), [a_record()])]).results.episodes())
    assert to_text(many).split("\n")[0].split()[-2:] == ["fleets", "makespan_s"]
    assert "2 of 4" in to_text(many)
    assert "fleets" not in to_text(single)
    assert "makespan_s" in to_markdown(single)  # the whole table keeps one form
    assert to_text(many.assign(job=["a", "b"])).split("\n")[0].split()[3] == "job"


# --- measures of fleets ---


def value_of(stored: StoredResults, name: str, **arguments: Any) -> Estimate:
    found = measure(stored, name, arguments)
    assert found is not None
    return found


def test_the_share_of_fleets_counts_episodes_and_not_robots(tmp_path: Path) -> None:
    found = value_of(two_controllers(tmp_path), "share_of_fleets", select=A)
    assert (found.value, found.n) == (0.5, 4)
    assert found.low < 0.5 < found.high


def test_fleets_are_compared_episode_by_episode(tmp_path: Path) -> None:
    found = value_of(two_controllers(tmp_path), "difference", metric="success", select=A, than=B)
    assert (found.value, found.n) == (0.25, 4)
    assert found.low < 0.25 < found.high
    back = value_of(
        StoredResults(two_controllers(tmp_path / "again").results), "difference", metric="success", select=B, than=A
    )
    assert back.value == -0.25


def test_fleets_that_never_met_the_same_world_have_no_difference(tmp_path: Path) -> None:
    cells = [(a_cell("A", "plain"), [a_fleet(9.0, 9.0)]), (a_cell("B", "other"), [a_fleet(9.0, 9.0)])]
    reading = store(tmp_path, cells)
    assert measure(reading, "difference", {"metric": "success", "select": A, "than": B}) is None
    assert measure(reading, "difference", {"metric": "reached", "select": A, "than": B}) is None
    assert measure(reading, "difference", {"metric": "time_s", "select": A, "than": B}) is None
    assert (
        measure(
            reading,
            f"{ZHAO2018}.median_decrease",
            {"metric": "time_s", "select": A, "than": B},
        )
        is None
    )


def test_only_shared_episodes_are_compared(tmp_path: Path) -> None:
    cells = [(a_cell("A"), [a_fleet(9.0, 9.0), a_fleet(9.0, 9.0)]), (a_cell("B"), [a_fleet(9.0, None)])]
    found = value_of(store(tmp_path, cells), "difference", metric="success", select=A, than=B)
    assert (found.value, found.n) == (1.0, 1)


MOVER = {
    "radius_m": 0.2,
    "waypoints": [{"x_m": 0.0, "y_m": 0.8}, {"x_m": 3.0, "y_m": 0.8}, {"x_m": 3.0, "y_m": -0.8}],
    "speeds_mps": [0.4, 0.1],
}


@pytest.mark.parametrize("phase_s", [0.0, 3.3, 100.0])
def test_a_movers_speed_is_told_leg_by_leg_as_a_share_of_the_wheels_limit(phase_s: float, tmp_path: Path) -> None:
    scene = {**WORLD, "movers": [{**MOVER, "speeds_mps": [0.25, 0.25]}, {**MOVER, "phase_s": phase_s}]}
    reading = store(tmp_path, [(a_cell("A", scene=scene), [a_record(), a_record()])])
    assert ROBOT["wheel_speed_max_mps"] == 0.5
    for mover, leg, share in ((1, 0, 0.8), (1, 1, 0.2), (1, 2, 0.2), (1, 3, 0.8), (0, 1, 0.5)):
        found = value_of(reading, f"{ZHAO2017}.mover_speed", mover=mover, leg=leg, select=A)
        assert (found.value, found.n) == pytest.approx((share, 1))


def test_a_movers_speed_counts_each_cell_once(tmp_path: Path) -> None:
    scenes = {f"w{speed}": {**WORLD, "movers": [{**MOVER, "speeds_mps": [speed, 0.1]}]} for speed in (0.1, 0.2, 0.4)}
    reading = store(tmp_path, [(a_cell("A", name, scene=scene), [a_record()] * 2) for name, scene in scenes.items()])
    assert value_of(reading, f"{ZHAO2017}.mover_speed", mover=0, leg=0, select=A) == pytest.approx((0.4, 0.2, 0.8, 3))


def test_printed_places_and_radii_are_those_of_the_world(tmp_path: Path) -> None:
    reading = store(tmp_path, [(a_cell("A", scene={**WORLD, "movers": [MOVER]}), [a_record()])])
    assert value_of(reading, f"{ZHAO2017}.mover_radius", mover=0, select=A).value == 0.2
    waypoints: Any = MOVER["waypoints"]
    of_world: Any = WORLD["starts"]
    ways = [[point["x_m"], point["y_m"]] for point in waypoints]
    starts = [[start["x_m"], start["y_m"]] for start in of_world]
    for places, share in (({"movers": [ways]}, 1.0), ({"movers": [ways], "starts": [[9, 9], *starts[1:]]}, None)):
        found = value_of(reading, f"{ZHAO2017}.share_of_places", places=places, select=A)
        assert found.value == (len(starts) / (1 + len(starts)) if share is None else share)


DISCS = [{"x_m": 1.0, "y_m": 0.5, "radius_m": 0.3}, {"x_m": 2.0, "y_m": -0.7, "radius_m": 0.2}]


def test_a_disc_is_met_from_hull_to_hull_by_whichever_robot_and_not_when_it_was_hit(tmp_path: Path) -> None:
    scene = {**WORLD, "boxes": [], "discs": DISCS}
    still, along = [(0.0, -0.9)] * 4, [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (3.0, 0.0)]
    fleet = [a_drive([0.1] * 3, index=0, places=still), a_drive([0.1] * 3, index=1, places=along)]
    reading = store(tmp_path / "met", [(a_cell("A", scene=scene), [fleet])])
    # hulls of 0.1 m pass the first disc at 0.5 - 0.3 - 0.1 = 0.1 m, the second at 0.7 - 0.2 - 0.1 = 0.4 m
    for within_m, share in ((0.0999, 0.0), (0.1001, 0.5), (0.3999, 0.5), (0.4001, 1.0)):
        found = value_of(reading, f"{ZHAO2017}.share_of_discs_met", within_m=within_m, select=A)
        assert (found.value, found.n) == (share, 2)
    hit = [fleet[0], a_drive([0.1] * 3, "collided", 1, Thing("disc", 0), along)]
    reading = store(tmp_path / "hit", [(a_cell("A", scene=scene), [fleet, hit])])
    found = value_of(reading, f"{ZHAO2017}.share_of_discs_met", within_m=9.0, select=A)
    assert (found.value, found.n) == (0.75, 4)


def test_in_a_world_without_discs_none_is_met(tmp_path: Path) -> None:
    reading = store(tmp_path, [(a_cell("A"), [a_fleet(9.0, 9.0)])])
    assert measure(reading, f"{ZHAO2017}.share_of_discs_met", {"within_m": 1.0, "select": A}) is None


def test_discs_are_those_that_the_layout_drew_for_the_episode(tmp_path: Path) -> None:
    cell, episodes = a_cell("A", "crossing", scene=CROSSING), []
    none = store(tmp_path / "none", [(cell, [a_fleet(9.0, 9.0)] * 3)])
    drawn = [none.world(cell.run_id, episode) for episode in range(3)]
    assert len({one.discs for one in drawn}) == 3
    for one in drawn:  # each robot stands in the middle of every disc in turn
        places = [(disc.x_m, disc.y_m) for disc in one.discs]
        episodes.append([a_drive([0.1] * (len(places) - 1), index=0, places=places)])
    reading = store(tmp_path / "in", [(cell, episodes)])
    found = value_of(reading, f"{ZHAO2017}.share_of_discs_met", within_m=-0.4, select=A)
    assert (found.value, found.n) == (1.0, sum(len(one.discs) for one in drawn))


# --- the stored world and pairs ---


def test_the_stored_world_is_the_one_that_was_driven(tmp_path: Path) -> None:
    cell = a_cell("A", "crossing", scene=CROSSING)
    reading = store(tmp_path, [(cell, [a_fleet(9.0, 9.0)] * 2)])
    first, second = reading.world(cell.run_id), reading.world(cell.run_id, 1)
    assert [first, second] == [world_of(CROSSING, "crossing")[0].drawn_for(0, episode) for episode in range(2)]
    assert first.movers
    assert first != second
    assert first == reading.world(cell.run_id, 0)
    assert first.starts == second.starts


def test_each_tuning_makes_a_pair_only_when_asked(tmp_path: Path) -> None:
    tuned = [(a_cell("A", tuning="pso", seed=seed, kp=1.0 + seed), [a_fleet(9.0, 8.0)]) for seed in (0, 1, 2)]
    reading = store(tmp_path, [*tuned, (a_cell("B"), [a_fleet(7.0, 6.0)])])
    with pytest.raises(DescriptionError, match="A met the same start several times"):
        reading.pairs(A, B)
    pairs = reading.pairs(A, B, each=True)
    assert sorted(zip(pairs["tuning_seed"], pairs["robot_index"], pairs["time_s_other"], strict=True)) == [
        (seed, robot, 7.0 - robot) for seed in (0, 1, 2) for robot in (0, 1)
    ]
    assert len(reading.pairs(B, A, each=True)) == 6


# --- frames and wheel speeds ---


def a_crossing(path: Path) -> StoredResults:
    straight = [[(1.0 + k, 5.0 + 0.1 * k) for k in range(19)], [(19.0 - k, 5.0) for k in range(10)]]
    fleet = [
        a_drive([0.5] * (len(places) - 1), index=i, places=places, on=[0] + [1] * (len(places) - 2))
        for i, places in enumerate(straight)
    ]
    return store(path, [(a_cell("A", "crossing", scene=CROSSING), [fleet, fleet])])


def test_frames_show_every_robot_where_it_was_and_the_movers_of_that_episode(
    tmp_path: Path, kept: list[Figure]
) -> None:
    reading = a_crossing(tmp_path / "in")
    select = {"label": "A", "episode": 1}
    text = told(frames, reading, tmp_path, file="f", select=select, times_s=[0.0, 4.5, 99.0], columns=2)
    assert "figures/f.png" in text
    world = reading.world(reading.episodes["run_id"][0], 1)
    shown = [ax for ax in kept[0].axes if ax.axison]
    assert [ax.xaxis.get_tick_params()["labelbottom"] for ax in shown] == [False, True, True]  # below b) is nothing
    assert [ax.get_title() for ax in shown] == ["a) 0.0 s", "b) 4.5 s", "c) 99.0 s"]
    for ax, places, t_s in zip(
        shown, ([(1.0, 5.0), (19.0, 5.0)], [(5.0, 5.4), (15.0, 5.0)], [(19.0, 6.8), (10.0, 5.0)]), (0.0, 4.5, 99.0),
        strict=True,
    ):  # fmt: skip
        hulls = [p for p in ax.patches if isinstance(p, Circle) and not p.get_fill()]
        assert [hull.center for hull in hulls] == [pytest.approx(place) for place in places]
        assert [hull.radius for hull in hulls] == [0.1, 0.1]
        assert to_rgba(MOVER_COLOUR) not in {tuple(hull.get_edgecolor()) for hull in hulls}
        filled = {(round(p.center[0], 9), round(p.center[1], 9)) for p in ax.patches if isinstance(p, Circle)}
        for mover in world.round_movers():
            x, y = mover.place(t_s)
            assert (round(x, 9), round(y, 9)) in filled
        named = [text.get_text() for text in ax.texts if text.get_text()]
        assert sorted(named) == sorted(
            f"{letter}{i}"
            for letter, things in (("R", places), ("M", world.movers), ("O", world.discs))
            for i, _ in enumerate(things, 1)
        )


def test_without_times_ten_frames_go_from_the_beginning_to_the_end(tmp_path: Path, kept: list[Figure]) -> None:
    told(frames, a_crossing(tmp_path / "in"), tmp_path, file="f", select={"label": "A", "episode": 0})
    titles = [ax.get_title() for ax in kept[0].axes]
    assert (titles[0], titles[1], titles[-1], len(titles)) == ("a) 0.0 s", "b) 2.0 s", "j) 18.0 s", 10)


def test_fewer_frames_than_columns_leave_no_empty_place(tmp_path: Path, kept: list[Figure]) -> None:
    select = {"label": "A", "episode": 0}
    told(frames, a_crossing(tmp_path / "in"), tmp_path, file="f", select=select, times_s=[1.0, 2.0])
    assert len(kept[0].axes) == 2


def test_wheel_speeds_are_the_two_wheels_and_the_state_is_marked_where_it_lasted(
    tmp_path: Path, kept: list[Figure]
) -> None:
    turning = a_drive([0.3, 0.2, 0.1, 0.3], index=0, on=[0, 1, 1, 0])
    turning.states[:, 5] = 0.4
    ahead = a_drive([0.3, 0.3], index=1, on=[1, 1])
    reading = store(tmp_path / "in", [(a_cell("A"), [[turning, ahead], [turning]])])
    panels = {"two": {"label": "A", "episode": 0}, "one": {"label": "A", "episode": 1}}
    told(wheel_velocities, reading, tmp_path, file="w", panels=panels, active="on", marked="on")
    axes = np.array(kept[0].axes).reshape(2, 2)
    assert [[ax.axison for ax in row] for row in axes] == [[True, True], [True, False]]
    left, right = axes[0, 0].lines
    assert left.get_ydata() == pytest.approx([0.27, 0.17, 0.07, 0.27, 0.27])  # the track is 0.15 m
    assert right.get_ydata() == pytest.approx([0.33, 0.23, 0.13, 0.33, 0.33])
    spans = [[(p.get_x(), p.get_x() + p.get_width()) for p in ax.patches] for ax in axes.ravel()]
    assert spans == [[(1.0, 2.0), (2.0, 3.0)], [(1.0, 2.0), (2.0, 3.0)], [(0.0, 1.0), (1.0, 2.0)], []]
    assert [ax.get_xlabel() for ax in axes.ravel()] == ["", "t [s]", "t [s]", ""]
    assert axes[0, 1].xaxis.get_tick_params()["labelbottom"]  # the column ends there
    assert [ax.get_ylabel() for ax in axes[:, 0]] == ["R1 [m/s]", "R2 [m/s]"]
    assert [text.get_text() for text in kept[0].legends[0].texts] == [
        "left",
        "right",
        "on (the darker, the more of each second)",
    ]
    table = pd.read_csv(tmp_path / "tables/w.csv")
    assert table[["episode", "robot", "share", "begins"]].to_numpy().tolist() == [
        ["two", "R1", 50.0, 1],
        ["two", "R2", 100.0, 1],
        ["one", "R1", 50.0, 1],
    ]


def test_a_state_that_flickers_shades_each_second_by_its_share() -> None:
    t_s = np.arange(0.0, 2.4, 0.2)
    on = [0, 1, 0, 1, 0, 0, 0, 1, 1, 0, 0, 0]
    spans = spans_of(pd.DataFrame({"t_s": t_s, "on": on}), "on")
    assert spans == [pytest.approx(span) for span in ((0.2, 0.4), (0.6, 0.8), (1.4, 1.8))]
    assert shares_of(spans, 2.2) == {0.0: pytest.approx(0.4), 1.0: pytest.approx(0.4)}
    assert shares_of([(0.0, 1.5)], 1.5) == {0.0: 1.0, 1.0: 1.0}


# --- the table of fleets in a report ---


def test_the_fleet_table_has_shares_of_fleets_and_robots_means_and_contacts(tmp_path: Path) -> None:
    contacts = ((2, 2, 0), (3, 2, 2))
    cells = [
        (a_cell("A"), [a_fleet(10.0, 12.0, contacts=contacts), a_fleet(20.0, 30.0), a_fleet(5.0, None)]),
        (a_cell("B"), [a_fleet(None, None)]),
    ]
    reading = store(tmp_path / "in", cells)
    text = told(
        fleet_table,
        reading,
        tmp_path,
        select={"name": "printed"},
        worlds={"Fig 1": "plain"},
        labels=["A", "B"],
    )
    one, other = pd.read_csv(tmp_path / "tables/t.csv").to_dict("records")
    assert (one["label"], other["label"]) == ("A", "B")
    assert (one["fleets"], one["fleets_n"], one["robots"], one["robots_n"]) == pytest.approx((2 / 3, 3, 5 / 6, 6))
    assert one["fleets_low"] < one["fleets"] < one["fleets_high"]
    assert (one["makespan_s"], one["sum_of_times_s"]) == (21.0, 36.0)
    kinds = ("robot_contacts", "other_contacts", "standing_contacts", "timed_out")
    assert [one[kind] for kind in kinds] == [4, 1, 2, 1]
    assert math.isnan(other["makespan_s"])
    assert "| Fig 1 | B | 0.000 [" in text
    assert "| 21.0 | 36.0 | 4 | 1 | 2 | 1 |" in text
    assert "makespan [s] | sum of times [s]" in text
    assert "| – | – | 0 | 0 | 0 | 2 |" in text


# --- evolution ---


COSTS = {("ga", 0): [8.0, 6.0, 9.0, 4.0, 5.0], ("ga", 2): [10.0, 12.0, 11.0, 9.0], ("pso", 0): [3.0, 4.0, 5.0]}


def evolved(path: Path) -> StoredResults:
    return store(path, [(a_cell("A"), [a_record()])], costs=COSTS)


def test_evolution_is_told_from_the_first_chromosome_beside_the_best_random_one(tmp_path: Path) -> None:
    tunings = {"ga": "mean time", "pso": "length"}
    text = told(evolution, evolved(tmp_path / "in"), tmp_path, file="e", tunings=tunings, first=3)
    rows = pd.read_csv(tmp_path / "tables/e.csv")
    assert rows[["tuning", "seed", "evaluations"]].to_numpy().tolist() == [
        ["mean time", 0, 5],
        ["mean time", 2, 4],
        ["length", 0, 3],
    ]
    # of the first population, its first chromosome is the un-evolved one: 2 mutants are left
    costs = rows[["unevolved_cost", "best_first_mutant_cost", "least_cost"]].to_numpy().tolist()
    assert costs == [[8.0, 6.0, 4.0], [10.0, 11.0, 9.0], [3.0, 4.0, 3.0]]
    assert rows["mutant_gain_percent"].tolist() == pytest.approx([25.0, -10.0, -100.0 / 3.0])
    assert rows["evolved_gain_percent"].tolist() == pytest.approx([50.0, 10.0, 0.0])
    assert "best of 2 mutants" in text
    assert "| mean time | 2 | 4 | 10.00 | 11.00 | 9.00 | 10.00 | -10.0 | 10.0 |" in text


def test_evolution_is_told_without_what_was_not_verified(tmp_path: Path) -> None:
    stored = evolved(tmp_path / "in")
    shutil.rmtree(tmp_path / "in/checks")
    text = told(evolution, stored, tmp_path, file="e", tunings={"ga": "mean time"}, first=3)
    assert "| mean time | 2 | 4 | 10.00 | 11.00 | 9.00 | – | -10.0 | 10.0 |" in text


def test_the_drawn_cost_never_rises_and_every_seed_is_in_the_legend(tmp_path: Path, kept: list[Figure]) -> None:
    tunings = {"pso": "length", "ga": "mean time"}  # the first panel lacks a seed of the second
    told(evolution, evolved(tmp_path / "in"), tmp_path, file="e", tunings=tunings, first=3, columns=1)
    one, other = kept[0].axes
    assert [np.asarray(line.get_ydata()).tolist() for line in other.lines[:2]] == [[8, 6, 6, 4, 4], [10, 10, 10, 9]]
    assert np.asarray(other.lines[0].get_xdata()).tolist() == [1, 2, 3, 4, 5]
    assert [np.asarray(line.get_ydata()).tolist() for line in one.lines[:1]] == [[3, 3, 3]]
    (legend,) = kept[0].legends
    assert [text.get_text() for text in legend.get_texts()] == ["seed 0", "seed 2", "first population"]


def paired(path: Path, pairs: list[tuple[float | None, float | None]], other: str = "plain") -> StoredResults:
    """Return A's and B's times, None where they failed; A's way is 2 m, B's 4 m."""
    sides = [
        [a_record("collided" if t is None else "reached", t or 1.0, length_m) for t in times]
        for times, length_m in zip(zip(*pairs, strict=True), (2.0, 4.0), strict=True)
    ]
    return store(path, [(a_cell("A"), sides[0]), (a_cell("B", other), sides[1])])


ROWS = {"all": {"select": A, "than": B}}


def test_gains_are_the_median_pairs_with_the_range_where_they_are_few(tmp_path: Path) -> None:
    pairs = [(9.0, 10.0), (5.0, 10.0), (12.0, 10.0), (None, 10.0), (3.0, None)]
    text = told(gains, paired(tmp_path / "in", pairs), tmp_path, file="g", rows=ROWS, printed={"all": [40.0, None]})
    row = pd.read_csv(tmp_path / "tables/g.csv").iloc[0]
    assert (row["reached_n"], row["reached"], row["other"]) == pytest.approx((5, 0.8, 0.8))
    assert row[["length_decrease", "length_decrease_low", "length_decrease_high"]].tolist() == [50.0, 50.0, 50.0]
    assert row[["time_decrease", "time_decrease_low", "time_decrease_high"]].tolist() == pytest.approx(
        [10.0, -20.0, 50.0]
    )
    assert (row["length_printed"], math.isnan(row["time_printed"])) == (40.0, True)
    assert "| all | 4 of 5 | 4 of 5 | – | 40.00 | 50.00 | – | 10.00 [-20.00, 50.00] |" in text


@pytest.mark.parametrize(("count", "is_range"), [(9, True), (10, False)])
def test_gains_have_an_interval_from_ten_pairs_on(count: int, is_range: bool, tmp_path: Path) -> None:
    pairs: list[tuple[float | None, float | None]] = [(10.0 - 0.5 * k, 10.0) for k in range(count)]
    told(gains, paired(tmp_path / "in", pairs), tmp_path, file="g", rows=ROWS)
    row = pd.read_csv(tmp_path / "tables/g.csv").iloc[0]
    found = row["time_decrease_low"], row["time_decrease_high"]
    assert (found == pytest.approx((0.0, 5.0 * (count - 1)))) == is_range


def test_gains_of_many_pairs_have_exact_and_paired_intervals(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    pairs: list[tuple[float | None, float | None]] = [(float(t), 10.0) for t in rng.uniform(6.0, 10.0, 40)]
    pairs[:4] = [(8.0, None)] * 4
    text = told(gains, paired(tmp_path / "in", pairs), tmp_path, file="g", rows=ROWS)
    row = pd.read_csv(tmp_path / "tables/g.csv").iloc[0]
    decreases = [100.0 * (1.0 - t / 10.0) for t, _ in pairs[4:] if t is not None]
    assert row["time_decrease"] == pytest.approx(np.median(decreases))
    assert min(decreases) < row["time_decrease_low"] < row["time_decrease"] < row["time_decrease_high"] < max(decreases)
    assert "| all | 40 of 40 | 36 of 40 | 0.100 [" in text


@pytest.mark.parametrize(
    ("pairs", "other"), [([(None, 9.0), (9.0, None)], "plain"), ([(9.0, 9.0)], "elsewhere")], ids=["failed", "apart"]
)
def test_gains_of_no_pair_are_missing(pairs: Any, other: str, tmp_path: Path) -> None:
    text = told(gains, paired(tmp_path / "in", pairs, other), tmp_path, file="g", rows=ROWS)
    row = pd.read_csv(tmp_path / "tables/g.csv").iloc[0]
    assert row[["length_decrease", "time_decrease"]].isna().all()
    assert "| – | – | – |\n" in text  # no printed figures, no columns of them
