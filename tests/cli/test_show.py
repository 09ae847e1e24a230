"""navbench show: one picture of an episode, a controller, a world, a robot or sensors; what is wrong, in one line."""

import re
import webbrowser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import Command, Done
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image
from stored import a_cell, a_record, store

from navbench.cli import tables
from navbench.cli.configuration import compose_cell
from navbench.cli.shown import draw_named
from navbench.experiments.store import Results
from navbench.metrics import DECLARED
from navbench.records import RobotRecord
from navbench.report import figures, picture
from navbench.report.controllers import draw_controller, draw_rules, fuzzy_parts
from navbench.report.sampling import sample_of


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """A folder with results: of one cell, of two, without trajectories, and with nothing in it."""
    failed = a_record("timed_out", time_s=60.0)
    store(tmp_path / "one", [(a_cell("A"), [a_record(), failed, a_record("collided"), a_record()])])
    store(tmp_path / "well", [(a_cell("A"), [a_record(), a_record()])])
    store(tmp_path / "two", [(a_cell("A"), [a_record()]), (a_cell("B"), [a_record()])])
    undrawn = RobotRecord.lost(0, "no_layout", "no room", DECLARED)
    store(tmp_path / "undrawn", [(a_cell("A"), [undrawn, failed])])
    bare = Results(tmp_path / "bare")
    bare.begin([a_cell("A")])
    bare.write_batch(a_cell("A"), range(1), [(0, a_record())], trajectories=False)
    (tmp_path / "empty").mkdir()
    return tmp_path


@pytest.mark.parametrize(
    ("words", "name", "says"),
    [
        (("one",), "A-plain-episode-1.png", "A in plain, episode 1: the first of 2 failed episodes, of 4"),
        (("one", "episode=3"), "A-plain-episode-3.png", "A in plain, episode 3"),
        (("one", "episode=3", "robot=0"), "A-plain-episode-3-robot-0.png", "A in plain, episode 3, robot 0"),
        (("well",), "A-plain-episode-0.png", "A in plain, episode 0: no failure in 2 episodes; this is the first"),
        (("undrawn",), "A-plain-episode-1.png", "A in plain, episode 1"),
        (("two", "label=B"), "B-plain-episode-0.png", "B in plain, episode 0"),
        (("two", "run_id=b-pl", "out=pictures/b.svg"), "pictures/b.svg", "B in plain, episode 0"),
    ],
)
def test_an_episode_is_drawn_the_first_that_failed_unless_one_is_chosen(
    here: Path, command: Command, words: tuple[str, ...], name: str, says: str
) -> None:
    done = command("show", *words)
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith(says)
    assert done.out.endswith(f"\nfigure: {name}\n")
    assert (here / name).read_bytes()[:5] == (b"<?xml" if name.endswith("svg") else b"\x89PNG\r")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "show: name a results directory, or one of controller=, world=, robot=, sensors="),
        (("none",), "show none: there is no such directory"),
        (("one", "two"), "show one two: name one results directory"),
        (("empty",), "empty: no results here: manifest.json is missing"),
        ((".",), ".: no results here; the newest within are in bare"),
        (("bare",), "bare: no trajectories are kept of A in plain"),
        (("one", "episode=4"), "episode=4: there is no such episode; there are episodes 0 to 3"),
        (("one", "episode=-1"), "episode=-1: must be a whole number, at least 0"),
        (("one", "robot=1"), "robot=1: there is no such robot; there is only robot 0"),
        (("one", "seed=1"), "seed=1: unknown key; allowed with show DIR: episode, robot, run_id"),
        (("undrawn", "episode=0"), "episode=0: was not run: no room"),
        (("two",), "two: 2 cells; choose one by run_id=, name=, label= or world=: A in plain (run_id=a-plain-); B in"),
        (("two", "controller=C"), "controller=C: there is no such cell; there are: "),
        (("two", "label=C"), "label=C: there is no such cell; there are: A, B"),
        (("one", "out=a.gif"), "out=a.gif: must end in .png or .svg"),
        (("--opn", "one"), "--opn: unknown flag"),
        (("controller=nope",), "controller=nope: unknown choice"),
        (("world=random_discs", "episodes=0"), "episodes=0: must be from 1 to 24 here"),
        (("robot=khepera3", "robot.radius_m=-1"), "robot.radius_m=-1"),
    ],
)
def test_what_cannot_be_shown_is_said_in_one_line(
    here: Path, command: Command, words: tuple[str, ...], said: str
) -> None:
    before = {path for path in here.rglob("*")}
    done = command("show", *words)
    check_refused(done)
    assert said in done.err
    assert {path for path in here.rglob("*")} == before


def test_a_controller_in_a_world_is_run_and_its_first_failure_drawn(command: Command, tmp_path: Path) -> None:
    words = ("controller=go_to_goal", "world=random_discs", "episodes=3", "simulator=planar", "hydra.run.dir=ran")
    done = command("show", *words, "out=failure.svg")
    assert done.code == 0, done.err
    assert re.search(r"^go_to_goal +random_discs +disc4 +\d of 9 ", done.out, re.M)
    assert re.search(
        r"\nresults: ran\ngo_to_goal in random_discs, episode \d: the .*\nfigure: failure.svg\n$", done.out
    )
    assert (tmp_path / "failure.svg").is_file()
    again = command("show", "ran", "out=again.svg")
    assert again.out.splitlines()[0] == done.out.splitlines()[-2]
    assert (tmp_path / "again.svg").read_bytes() == (tmp_path / "failure.svg").read_bytes()


def check_refused(done: Done) -> None:
    assert done.code == 2
    assert done.out == ""
    assert re.fullmatch(r"navbench: [^\n]+\n", done.err)


def test_many_cells_are_told_by_what_they_differ_in(tmp_path: Path, command: Command) -> None:
    cells = [(a_cell(label, world), [a_record()]) for label in "ABCD" for world in ("plain", "other")]
    store(tmp_path / "many", cells)
    assert "many: 8 cells; choose one by world=plain, other; label=A, B, C, D; run_id=" in command("show", "many").err


def test_cells_of_one_controller_in_one_world_are_told_apart(tmp_path: Path, command: Command) -> None:
    cells = [(a_cell("pid", name=f"n{kp}", kp=kp), [a_record()]) for kp in (1, 2)]
    store(tmp_path / "sweep", cells)
    said = "pid (kp=1) in plain (run_id=pid-plai); pid (kp=2) in plain (run_id=pid-plai)"
    assert said in command("show", "sweep").err


def test_open_hands_the_picture_to_the_viewer(here: Path, command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []

    def open_first(url: str) -> bool:
        opened.append(url)
        return len(opened) == 1

    monkeypatch.setattr(webbrowser, "open", open_first)
    assert command("show", "--open", "one").code == 0
    assert opened == [(here / "A-plain-episode-1.png").as_uri()]
    done = command("show", "--open", "one")  # where there is none
    assert (done.code, done.err) == (
        2, "navbench: --open: there is no viewer here; the picture is A-plain-episode-1.png\n"
    )  # fmt: skip


def test_help_names_every_key(command: Command) -> None:
    done = command("show", "--help")
    assert done.code == 0
    for key in ("episode=", "robot=", "run_id=", "label=", "world=", "out=", "--open", "controller=", "sensors="):
        assert key in done.out


def panels_of(subject: str, *words: str) -> list[Axes]:
    figure, _, _ = draw_named(subject, words, None)
    return [ax for ax in figure.axes if ax.axison]


@pytest.mark.parametrize("name", ["sflc", "dual_layer"])
def test_every_rule_base_of_a_controller_is_drawn(name: str) -> None:
    parts = dict(fuzzy_parts(compose_cell(f"controller={name}").make_controller()))
    outputs = sum(len(part.outputs) for part in parts.values())
    panels = panels_of("controller", f"controller={name}")
    assert parts
    assert sum(len(ax.images) for ax in panels) == outputs  # a grid of rules each
    curves_and_surfaces = [ax for ax in panels if ax.get_ylabel() in _answers(parts) or ax.get_label() == "<colorbar>"]
    assert len(curves_and_surfaces) >= outputs


def _answers(parts: dict[str, Any]) -> set[str]:
    return {output for part in parts.values() for output in part.outputs}


def test_a_grid_of_rules_holds_what_the_rules_conclude() -> None:
    part = dict(fuzzy_parts(compose_cell("controller=oa_to").make_controller()))["oa"]
    ax = Figure().subplots()
    draw_rules(ax, part, 1)
    down, across = ([label.get_text() for label in of.get_ticklabels()] for of in (ax.yaxis, ax.xaxis))
    drawn = {
        (down[int(text.get_position()[1])], across[int(text.get_position()[0])]): text.get_text() for text in ax.texts
    }
    assert drawn == {(r, phi): right for r, phi, _, right in part.rules}


def test_a_controller_without_fuzzy_parts_shows_its_parameters_with_their_sources() -> None:
    figure, stem, says = draw_named("controller", ["controller=go_to_goal", "controller.build.speed_mps=0.2"], None)
    words = [text.get_text() for ax in figure.axes for text in ax.texts]
    assert words[words.index("speed_mps") : words.index("speed_mps") + 3] == ["speed_mps", "0.2", "assumed"]
    assert (stem, says) == ("controller go_to_goal", "controller go_to_goal with sensors ring16")


def test_what_a_controller_describes_is_drawn_where_it_holds_no_rule_base() -> None:
    class Mine:
        def describe(self) -> dict[str, Any]:
            corners = {"variable": ["d"] * 4, "term": ["near"] * 2 + ["far"] * 2}
            sets = {**corners, "x": [0.0, 2.0, 1.0, 3.0], "degree": [1.0, 0.0, 0.0, 1.0]}
            return {"memberships": sets, "rules": {"d": ["near"], "v": ["slow"]}, "count": {"rules": [1]}}

    robot, sensors = compose_cell("controller=sflc").robot, compose_cell("controller=sflc").sensors
    figure = draw_controller("mine", Mine(), robot, sensors, [("gain", "2", "")])
    sets, rules, *_, parameters = figure.axes
    assert sets.get_xlim() == (0.0, 3.0)
    assert [text.get_text() for text in rules.texts] == ["d", "v", "near", "slow"]
    assert [text.get_text() for text in parameters.texts] == ["gain", "2", ""]
    assert len(figure.axes) == 5  # and where its sensors sit and look


@pytest.mark.parametrize(("words", "rays", "names"), [(("sensors=khepera3_ir",), 27, 9), (("sensors=ring45",), 45, 45)])
def test_every_ray_of_a_suite_is_drawn_and_every_role_named(words: tuple[str, ...], rays: int, names: int) -> None:
    mounts, reach = panels_of("sensors", *words)
    segments = [one for of in reach.collections if isinstance(of, LineCollection) for one in of.get_segments()]
    assert len(segments) == rays
    assert len({text.get_text() for text in mounts.texts} - {""}) == names
    farthest = max(np.hypot(*np.asarray(segment)[-1]) for segment in segments)
    assert farthest < reach.get_xlim()[1]


def test_sensors_are_drawn_in_the_size_of_the_robot_that_is_named() -> None:
    (_, own), (_, large) = panels_of("sensors", "sensors=ring16"), panels_of("sensors", "sensors=ring16", "robot=disc4")
    assert large.get_xlim()[1] == pytest.approx(4.0 * own.get_xlim()[1])


@pytest.mark.parametrize(
    ("words", "panels", "title"),
    [
        (("world=deadlock",), 1, ""),
        (("world=random_discs",), 6, "episode 5"),
        (("world=random_discs", "episodes=2", "seed=3"), 2, "episode 1"),
    ],
)
def test_a_world_is_drawn_once_where_it_is_fixed_and_else_by_several_episodes(
    words: tuple[str, ...], panels: int, title: str
) -> None:
    drawn = panels_of("world", *words)
    assert len(drawn) == panels
    assert drawn[-1].get_title() == title


def test_a_robot_shows_its_body_and_what_it_can_do(command: Command, tmp_path: Path) -> None:
    done = command("show", "robot=khepera3", "sensors=khepera3_ir")
    assert done.out == "robot khepera3 with sensors khepera3_ir\nfigure: robot-khepera3-with-sensors-khepera3_ir.png\n"
    with Image.open(tmp_path / "robot-khepera3-with-sensors-khepera3_ir.png") as picture:
        assert picture.height > 800  # both blocks


def test_a_picture_of_a_large_sweep_shows_the_cells_with_failures_first_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tables, "PANELS_MAX", 4)
    outcomes = ["timed_out" if i in (3, 5) else "reached" for i in range(7)]
    cells = [(a_cell(f"c{i}"), [a_record(outcome)]) for i, outcome in enumerate(outcomes)]
    stored = store(tmp_path / "sweep", cells)
    kept: list[Figure] = []

    def draw(panels: Any, title: str) -> Figure:
        kept.append(figures.draw_cells(panels, title))
        return kept[-1]

    monkeypatch.setattr(picture, "draw_cells", draw)
    tables.write_tables(stored.results)
    told = "4 of 7 cells, taken evenly: 2 of 2 with failures and 2 of 5 without"
    assert kept[0]._suptitle.get_text() == told  # type: ignore[attr-defined]
    drawn = [ax for row in kept for ax in row.axes if ax.axison]
    legends = [ax.get_legend() for ax in drawn]
    heads = [legend.get_texts()[0].get_text() for legend in legends if legend]
    assert heads == ["timed out: 1"] * 2 + ["reached: 1"] * 2


def test_of_more_failures_than_a_picture_holds_some_are_taken_evenly(tmp_path: Path) -> None:
    cells = [(a_cell(f"c{i}"), [a_record("collided")]) for i in range(8)]
    stored = store(tmp_path / "sweep", cells)
    runs = [cell["run_id"] for cell in stored.manifest["cells"]]
    sample = sample_of(runs, stored.rows, 4)
    assert sample.runs == runs[::2]
    assert sample.says == "4 of 8 cells, taken evenly: 4 of 8 with failures and 0 of 0 without"
    assert sample_of(runs, stored.rows, 8) == (runs, "")
