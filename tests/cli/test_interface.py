"""The Python interface: objects, files and values beside names, results as tables and pictures, threads, errors."""

import math
import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from commands import Command
from pandas.testing import assert_frame_equal

import navbench
from navbench.cli.configuration import compose_cell
from navbench.cli.interface import cells_of
from navbench.contract import Command as Asked
from navbench.contract import Observation, Setup
from navbench.experiments.store import Results
from navbench.validation import DescriptionError
from navbench.world import Bounds, Layout, Point, Start
from navbench.world.world import World

PLANAR: dict[str, Any] = {"simulator": "planar", "workers": 1}


class Turner:
    """Turns to its goal and drives; remembers how often it acted."""

    def __init__(self, gain: float = 2.0, speed_mps: float = 0.1) -> None:
        self.gain, self.speed_mps, self.acted = gain, speed_mps, 0

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        assert self.acted == 0, "a robot of an episode has a copy of its own"

    def act(self, observation: Observation) -> Asked:
        self.acted += 1
        x, y, heading = observation.pose
        bearing = math.atan2(observation.goal[1] - y, observation.goal[0] - x)
        return Asked(self.speed_mps, self.gain * math.remainder(bearing - heading, math.tau))


def same(one: pd.DataFrame, other: pd.DataFrame) -> None:
    """Check that two tables tell the same to the last bit, of whatever controller."""
    beside = ["run_id", "controller", "config_hash"]
    assert_frame_equal(one.drop(columns=beside, errors="ignore"), other.drop(columns=beside, errors="ignore"), rtol=0.0)


@pytest.mark.parametrize("simulator", ["planar", "pybullet"])
def test_numbers_are_those_of_the_command_line_to_the_last_bit(
    simulator: str, command: Command, tmp_path: Path
) -> None:
    words = ("controller=sflc", "world=deadlock", "episodes=3", "start_jitter_m=0.02", f"simulator={simulator}")
    assert command(*words, "hydra.run.dir=told").code == 0
    ran = navbench.run(
        controller="sflc", world="deadlock", episodes=3, start_jitter_m=0.02, simulator=simulator, workers=1
    )
    told = Results(tmp_path / "told")
    assert_frame_equal(ran.episodes, told.episodes(), rtol=0.0, atol=0.0)
    assert_frame_equal(ran.trajectories, told.trajectories(), rtol=0.0, atol=0.0)
    assert dict(ran.layouts.itertuples(index=False)) == told.layouts()
    assert_frame_equal(ran.table, pd.read_csv(tmp_path / "told/table.csv"), check_dtype=False)


def test_a_controller_is_an_object_a_class_a_function_or_a_part_of_a_mapping() -> None:
    whats: list[Any] = [Turner(), Turner, lambda: Turner(), partial(Turner, gain=2.0), {"build": Turner(2.0)}]
    first, *others = [navbench.run(controller=what, world="empty", episodes=2, **PLANAR) for what in whats]
    assert list(first.episodes["outcome"]) == ["reached", "reached"]
    for other in others:
        same(other.episodes, first.episodes)
        same(other.trajectories, first.trajectories)


def test_an_object_drives_in_other_processes_too() -> None:
    words: dict[str, Any] = {"world": "empty", "episodes": 10, "simulator": "planar"}
    one, two = (navbench.run(controller=Turner(1.5), workers=workers, **words) for workers in (1, 2))
    assert_frame_equal(one.episodes, two.episodes, rtol=0.0, atol=0.0)


def test_a_compiled_controller_that_is_given_as_an_object_drives_in_the_compiled_loop() -> None:
    cell = compose_cell("controller=sflc", "world=corner", "simulator=planar")
    ran = navbench.run(controller=cell.make_controller(), world="corner", sensors="khepera3_ir", **PLANAR)
    told = navbench.run(controller="sflc", world="corner", **PLANAR)
    same(ran.episodes, told.episodes)
    choices = {"controller": cell.make_controller(), "simulator": "planar", "sensors": "khepera3_ir"}
    assert cells_of([], choices).cells[0].loop == "compiled"


def gate(half_m: float) -> World:
    bounds = Bounds(x_min_m=-half_m, x_max_m=half_m, y_min_m=-1.0, y_max_m=1.0)
    layout = Layout(bounds=bounds, starts=(Start(x_m=-0.5, y_m=0.0),), goals=(Point(x_m=0.5, y_m=0.0),))
    return World(name="gate", source=layout, goal_tolerance_m=0.05, time_limit_s=30.0)


def test_a_world_is_a_name_a_file_a_mapping_or_an_object(tmp_path: Path) -> None:
    file = tmp_path / "gate.yaml"
    file.write_text(
        "defaults: [/schema/world@_here_, _self_]\n"
        "bounds: {x_min_m: -1.0, x_max_m: 1.0, y_min_m: -1.0, y_max_m: 1.0}\n"
        "starts: [{x_m: -0.5, y_m: 0.0}]\ngoals: [{x_m: 0.5, y_m: 0.0}]\ngoal_tolerance_m: 0.05\ntime_limit_s: 30.0\n"
    )
    values = {
        "name": "gate", "bounds": {"x_min_m": -1, "x_max_m": 1, "y_min_m": -1, "y_max_m": np.float64(1.0)},
        "starts": [{"x_m": -0.5, "y_m": 0.0}], "goals": ({"x_m": 0.5, "y_m": 0.0},), "goal_tolerance_m": 0.05,
        "time_limit_s": 30.0,
    }  # fmt: skip
    given: list[Any] = [gate(1.0), values, file, str(file)]
    first, *others = [navbench.run(controller="go_to_goal", world=one, **PLANAR) for one in given]
    assert list(first.episodes["world"]) == ["gate"]
    assert list(first.episodes["outcome"]) == ["reached"]
    for other in others:
        same(other.episodes, first.episodes)


@pytest.mark.parametrize("name", ["random_movers", "swap_circle", "deadlock", "zhao2017_dynamic", "nemeiksis_rooms"])
def test_a_world_of_the_catalogue_is_the_same_as_an_object(name: str) -> None:
    cell = compose_cell("controller=go_to_goal", f"world={name}")
    renamed = World(
        name="mine",
        source=cell.world.source,
        goal_tolerance_m=cell.world.goal_tolerance_m,
        time_limit_s=cell.world.time_limit_s,
    )
    told = cells_of([], {"controller": "go_to_goal", "world": renamed, "robot": cell.robot, "sensors": cell.sensors})
    assert (told.cells[0].world, told.cells[0].robot, told.cells[0].sensors) == (renamed, cell.robot, cell.sensors)


def test_a_mapping_inherits_from_the_catalogue() -> None:
    quick = {"name": "short", "defaults": ["deadlock", "_self_"], "time_limit_s": 5.0}
    ran = navbench.run(controller="sflc", world=quick, **PLANAR)
    assert list(ran.episodes["outcome"]) == ["timed_out"]
    assert list(ran.episodes["time_s"]) == [5.0]


def test_a_sweep_runs_every_combination_and_tells_which_cannot_be_run() -> None:
    slow: Mapping[str, Any] = {"name": "slow", "build": partial(Turner, speed_mps=0.05)}
    ran = navbench.sweep(controller=["sflc", Turner, slow], world=["empty", gate(1.0)], seed=range(2), **PLANAR)
    assert [tuple(row) for row in ran.table[["controller", "world", "seed"]].to_numpy()] == [
        (controller, world, seed) for controller in ("sflc", "Turner", "slow") for world in ("empty", "gate")
        for seed in (0, 1)
    ]  # fmt: skip
    assert (ran.finished, ran.planned, ran.reasons) == (12, 12, ())
    ran = navbench.sweep("sensors.noise_std_m=0,0.01", controller="sflc", sensors=["ring16", "khepera3_ir"], **PLANAR)
    assert (ran.finished, ran.planned) == (2, 2)
    assert len(ran.reasons) == 2
    assert ran.reasons[0].startswith("cell 0: sensors=ring16: sflc needs")


def test_the_same_work_in_a_directory_is_not_run_again_and_other_work_is_refused(tmp_path: Path) -> None:
    told: list[str] = []

    def note(what: str, done: int, of: int) -> None:
        told.append(f"{done} of {of} {what}")

    words: dict[str, Any] = {"world": "empty", "dir": tmp_path / "here", "progress": note, **PLANAR}
    navbench.run(controller=Turner(2.0), episodes=2, **words)
    assert told == ["0 of 2 episodes", "2 of 2 episodes"]
    navbench.run(controller=Turner(2.0), episodes=2, **words)
    assert len(told) == 2
    assert (tmp_path / "here/table.csv").is_file()
    with pytest.raises(DescriptionError, match="holds the results of other work"):
        navbench.run(controller=Turner(1.0), episodes=2, **words)
    assert navbench.load(tmp_path / "here").finished == 2


def test_an_object_whose_code_lies_in_no_file_is_not_taken_for_another_one(tmp_path: Path) -> None:
    navbench.run(controller=lambda: Turner(2.0), world="empty", dir=tmp_path / "here", **PLANAR)
    with pytest.raises(DescriptionError, match="holds the results of other work"):
        navbench.run(controller=lambda: Turner(1.0), world="empty", dir=tmp_path / "here", **PLANAR)


def test_what_is_kept_nowhere_is_gone_with_its_result() -> None:
    ran = navbench.run(controller="go_to_goal", world="empty", **PLANAR)
    path = ran.path
    assert path.is_dir()
    del ran
    assert not path.exists()


def test_two_threads_get_what_one_after_another_gets() -> None:
    def run(gain: float) -> navbench.Result:
        return navbench.sweep(controller=Turner(gain), world=["empty", "corner"], seed=[0, 1], episodes=3, workers=1)

    alone = [run(gain) for gain in (1.0, 2.0)]
    with ThreadPoolExecutor(2) as threads:
        together = list(threads.map(run, (1.0, 2.0)))
    for one, other in zip(alone, together, strict=True):
        assert_frame_equal(one.episodes, other.episodes, rtol=0.0, atol=0.0)
        assert_frame_equal(one.trajectories, other.trajectories, rtol=0.0, atol=0.0)


def test_a_result_shows_itself_in_a_notebook_and_obeys_nothing_in_it(tmp_path: Path) -> None:
    ran = navbench.run(controller="go_to_goal", world="deadlock", episodes=3, dir=tmp_path / "here", **PLANAR)
    shown = ran._repr_html_()
    assert shown.startswith("<p>3 of 3 planned episodes, 1 cell</p><table>")
    assert "0 of 3" in shown
    assert "0 of 3" in repr(ran)
    manifest = tmp_path / "here/manifest.json"
    manifest.write_text(manifest.read_text().replace('"label": "go_to_goal"', '"label": "<script>x</script>"'))
    shown = navbench.load(tmp_path / "here")._repr_html_()
    assert "&lt;script&gt;" in shown
    assert "<script>" not in shown


def test_a_result_draws_an_episode_and_writes_a_report(tmp_path: Path) -> None:
    ran = navbench.sweep(controller=["go_to_goal", "sflc"], world="deadlock", episodes=2, **PLANAR)
    figure = ran.plot(label="go_to_goal")
    figure.savefig(tmp_path / "episode.png")
    assert (tmp_path / "episode.png").stat().st_size > 10_000
    with pytest.raises(DescriptionError, match="2 cells; choose one by"):
        ran.plot()
    with pytest.raises(DescriptionError, match="episode=7: there is no such episode; there are episodes 0 to 1"):
        ran.plot(7, label="sflc")
    with pytest.raises(DescriptionError, match="labl=sflc: unknown key; did you mean label"):
        ran.plot(labl="sflc")
    page = ran.report(tmp_path / "out")
    assert page == tmp_path / "out/report.html"
    assert "go_to_goal" in page.read_text()


TURNER: Any = Turner
WRONG: list[tuple[dict[str, Any], str]] = [
    ({"controller": "sfl"}, "controller=sfl: unknown choice; did you mean sflc?"),
    ({"controller": 3}, "controller=3: must be an object or a class with reset"),
    ({"controller": ["sflc"]}, r"controller=\['sflc'\]: must be one value; navbench.sweep takes several"),
    ({"controller": partial(TURNER, gin=1.0)}, "controller.build.gin: unknown key; did you mean gain"),
    ({"controller": partial(TURNER, gain="a")}, "controller.build.gain='a': must be a valid number"),
    ({"controller": {"name": "a b", "build": Turner}}, "controller.name='a b': must be letters, digits and _"),
    ({"controller": {"name": "sflc", "build": Turner}}, "controller=sflc: that name is taken"),
    ({"controller": int}, "must name a class with"),
    ({"world": "nope.yaml"}, "world=nope.yaml: there is no such file"),
    ({"world": {"bounds": 3, "goal_tolerance_m": 1.0, "time_limit_s": 1.0}}, "world.bounds=3: must be a mapping"),
    ({"world": {"defaults": ["deadlock", "_self_"], "time_limit": 1.0}}, "time_limit: unknown key; did you mean"),
    ({"world": Turner()}, "world=.*: must be a name, a YAML file, a mapping, a World"),
    ({"robot": {"radius_m": -1.0, "track_m": 1.0, "wheel_speed_max_mps": 1.0}}, "robot.radius_m=-1.0: must be greater"),
    ({"episodes": "many"}, "episodes=many: must be a whole number"),
    ({"workers": -1}, "workers=-1: must be at least 0"),
    ({"seed": -1}, "seed=-1: must be from 0"),
    ({"dir": __file__}, "is a file; results need a directory"),
    ({"dir": 5}, "dir=5: must be a path"),
    ({"dir": b"here"}, "dir=b'here': must be a path"),
    ({"dir": ""}, "dir='': must be a path"),
    ({"dir": "a\0b"}, "dir=.*: must be a path"),
    ({"dir": "x" * 300}, "File name too long"),
    ({"config_dir": 5}, "config_dir=5: must be a path"),
    ({"config_dir": ""}, "config_dir='': must be a path"),
    ({"world": "a\nb"}, "world=a b: cannot be read"),
    ({"overwrite": "no"}, "overwrite='no': must be True or False"),
    ({"other_code": 0}, "other_code=0: must be True or False"),
    ({"progress": 3}, "progress=3: must be a function"),
    ({"controller": lambda: 3}, "build._target_=test_interface.<lambda>: must name a class with reset"),
]


@pytest.mark.parametrize("verb", [navbench.run, navbench.sweep, partial(navbench.check, "sflc")])
@pytest.mark.parametrize("word", [5, b"controller=sflc", None])
def test_a_word_that_is_none_is_refused(verb: Any, word: Any) -> None:
    with pytest.raises(DescriptionError, match="must be a word, such as 'episodes=10'"):
        verb(word)


@pytest.mark.parametrize("path", [None, 3, b"here", "", "a\0b"])
def test_a_path_that_is_none_is_refused(path: Any) -> None:
    with pytest.raises(DescriptionError, match="path=.*: must be a path"):
        navbench.load(path)


def test_a_word_that_is_for_the_command_line_alone_is_refused_and_not_ignored(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="here the argument dir says where results go"):
        navbench.run(f"hydra.run.dir={tmp_path / 'here'}", controller="go_to_goal", world="empty", **PLANAR)
    with pytest.raises(DescriptionError, match="here the argument dir says where results go"):
        navbench.sweep(f"hydra.sweep.dir={tmp_path / 'here'}", controller="go_to_goal", **PLANAR)


def test_a_list_of_nothing_is_not_taken_for_the_default() -> None:
    with pytest.raises(DescriptionError, match=r"seed=\[\]: must hold at least one value"):
        navbench.sweep(controller="go_to_goal", seed=[])


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"out": 3}, "out=3: must be a path"),
        ({"out": ""}, "out='': must be a path"),
        ({"out": __file__}, "Not a directory"),
        ({"out": "there", "trust": "no"}, "trust='no': must be True or False"),
        ({"out": "there", "config_dir": 3}, "config_dir=3: must be a path"),
    ],
)
def test_a_report_to_a_wrong_place_is_a_value_error_of_one_line(
    given: dict[str, Any], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = navbench.run(controller="go_to_goal", world="empty", **PLANAR)
    with pytest.raises(DescriptionError, match=says):
        ran.report(**given)
    assert not list(tmp_path.iterdir())
    with pytest.raises(DescriptionError, match="run_id=None: there is no such cell"):
        ran.plot(run_id=None)  # type: ignore[arg-type]


@pytest.mark.parametrize(("given", "says"), WRONG)
def test_what_is_wrong_is_a_value_error_of_one_line(given: dict[str, Any], says: str) -> None:
    with pytest.raises(DescriptionError, match=says) as refusal:
        navbench.run(**given)
    assert len(str(refusal.value).splitlines()) == 1


def test_two_things_of_one_name_are_refused() -> None:
    with pytest.raises(DescriptionError, match="controller=Turner: two are called so; give it another one"):
        navbench.sweep(controller=[Turner(1.0), Turner(2.0)])


def test_what_is_given_to_one_call_is_unknown_to_the_next_one() -> None:
    navbench.run(controller=Turner(), world=gate(1.0), **PLANAR)
    with pytest.raises(DescriptionError, match="controller=Turner: unknown choice"):
        navbench.run(controller="Turner", **PLANAR)


def test_there_is_nothing_to_load_where_there_are_no_results(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="nope: there is no such directory"):
        navbench.load(tmp_path / "nope")
    with pytest.raises(DescriptionError, match="no results here"):
        navbench.load(tmp_path)


def test_a_controller_is_checked() -> None:
    found = {finding.name: finding for finding in navbench.check(Turner(), world="empty", episodes=1)}
    assert found["commands"].verdict == "ok"
    assert found["repeats"].verdict == "ok"
    assert {finding.verdict for finding in found.values()} <= {"ok", "note"}


def test_an_import_brings_none_of_what_takes_time() -> None:
    slow = ("numpy", "hydra", "pandas", "numba", "pydantic")
    code = f"import sys, navbench; print([name for name in {slow} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
    assert {"run", "sweep", "load", "check", "Result", "DescriptionError"} <= set(dir(navbench))
    with pytest.raises(AttributeError, match="has no attribute 'nope'"):
        navbench.nope  # noqa: B018
