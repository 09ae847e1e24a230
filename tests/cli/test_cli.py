"""The command line: what it prints and writes; and what is wrong is one line, exit code 2, and nothing left behind."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from commands import NAVBENCH, Command, Done, in_a_process
from stored import a_cell, a_record, store

import navbench
from navbench.cli import main as cli
from navbench.cli.catalogue import CONF, files_of
from navbench.experiments.store import Results
from navbench.metrics import DECLARED
from navbench.validation import DescriptionError

GO = ("controller=go_to_goal", "world=empty")
WRITTEN = {"episodes.csv", "table.csv", "table.md", "trajectories.png"}

MINE = """
import math

class Mine:
    def __init__(self, gain):
        self.gain = gain
    def reset(self, setup, rng):
        self.sensors = len(setup.sensors)
    def act(self, seen):
        bearing = math.atan2(seen.goal[1] - seen.pose.y_m, seen.goal[0] - seen.pose.x_m)
        turn = math.remainder(bearing - seen.pose.heading_rad, math.tau)
        return 0.15, self.gain * turn
"""
MINE_YAML = "# Towards the goal\nbuild: {_target_: mine.Mine, gain: 2.0}\n"
WORLD_YAML = """# A square with nothing in it
defaults: [/schema/world@_here_, _self_, override /robot@_global_.robot: khepera3]
bounds: {x_min_m: -1, x_max_m: 1, y_min_m: -1, y_max_m: 1}
starts: [{x_m: 0, y_m: 0}]
goals: [{x_m: 0.5, y_m: 0}]
goal_tolerance_m: 0.1
time_limit_s: 30
"""


def files_in(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if "__pycache__" not in path.parts}


def write(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def check_refused(done: Done, *said: str) -> None:
    """A command was refused in one short line that says these things."""
    assert done.code == 2, done
    assert done.out == ""
    assert re.fullmatch(r"navbench: [^\n]{1,410}\n", done.err), done.err
    for part in said:
        assert part in done.err


# What is wrong with a run


WRONG = [
    # choices
    (("controller=nope", "world=empty"), "controller=nope: unknown choice; allowed: ", "go_to_goal", "sflc"),
    (("controller=sflc", "world=nope"), "world=nope: unknown choice; allowed: ", "deadlock, "),
    ((*GO, "robot=nope"), "robot=nope: unknown choice; allowed: ", "khepera3"),
    ((*GO, "robot@controller.native.robot=nope"), "robot=nope: unknown choice; allowed: ", "khepera3"),
    ((*GO, "world=null"), "world=null: must be one name", "navbench list world"),
    ((*GO, "world=[empty,corner]"), "world=[empty,corner]: must be one name"),
    ((*GO, "robot=3"), "robot=3: must be one name"),
    ((*GO, "seed=1,2"), "seed=1,2: must be one value; only a sweep, with --multirun, takes several, ",
     "and a list is seed=[1,2]\n"),
    ((*GO, "objective=time"), "navbench: objective=time: is a key of `navbench tune`, not of a run\n"),
    ((*GO, "budget=3"), "navbench: budget=3: is a key of `navbench tune`, not of a run\n"),
    ((*GO, "world.source.x=1"), "world.source.x: unknown key; world.source is null here; set the whole mapping, as "),
    ((*GO, "world.source={_target_: os.getcwd}"), "world.source._target_=os.getcwd: must name a class with draw("),
    ((*GO, "metrics=[nope]"), "metrics[0]=nope: must name a metric of your own as module.function; always measured: "),
    (("study",), "navbench: study: name one study; there are: aouf2019, "),
    (("study", "aouf2019", "lei2014"), "navbench: study aouf2019 lei2014: name one study; "),
    # keys
    ((*GO, "nogroup=x"), "nogroup: unknown key; allowed here: controller, world, robot, sensors, simulator, engine"),
    ((*GO, "+nogroup=x"), "nogroup: unknown key; allowed here: controller, world, robot"),
    ((*GO, "world.time_limt_s=3"), "world.time_limt_s: unknown key; did you mean time_limit_s?"),
    ((*GO, "+world.time_limt_s=3"), "world.time_limt_s: unknown key; did you mean time_limit_s?"),
    ((*GO, "++world.name=other"), "world.name: unknown key; allowed here: bounds, "),
    ((*GO, "world.bounds.x_mn_m=3"), "world.bounds.x_mn_m: unknown key; did you mean x_min_m? allowed here: "),
    ((*GO, "world.boxes=[{foo: 3}]"), "world.boxes[0].foo: unknown key; allowed here: x_m, y_m, length_m"),
    ((*GO, "controller.foo=3"), "controller.foo: unknown key; allowed here: "),
    ((*GO, "+controller.native.foo=3"), "controller.native.foo: unknown key; allowed here: robot, period_s"),
    ((*GO, "controller.build.sped_mps=1"), "controller.build.sped_mps: unknown key; did you mean speed_mps? "),
    ((*GO, "+controller.build.sped_mps=1"), "controller.build.sped_mps: unknown key; did you mean speed_mps? "),
    ((*GO, "+controller.build._partial_=true"), "controller.build._partial_: unknown key"),
    ((*GO, "sensors.mounts.0.foo=1"), "sensors.mounts[0].foo: unknown key; allowed here: role, x_m, "),
    ((*GO, "sensors.tracker.range_m=1"), "sensors.tracker.range_m: ", "as sensors.tracker={range_m: 1}"),
    ((*GO, "~seed"), "seed: missing"),
    ((*GO, "~world"), "world: missing"),
    ((*GO, "~controller.build.speed_mps"), "controller.build.speed_mps: missing"),
    ((*GO, "world.boxes=[{x_m: 0, y_m: 0, width_m: 1}]"), "world.boxes[0].length_m: missing"),
    # types
    ((*GO, "episodes=abc"), "episodes=abc: must be a whole number"),
    ((*GO, "episodes=1.5"), "episodes=1.5: must be a whole number"),
    ((*GO, "episodes=true"), "episodes=true: must be a whole number"),
    ((*GO, "seed=null"), "seed=null: must not be null"),
    ((*GO, "workers=[1]"), "workers=[1]: must be a whole number"),
    ((*GO, "start_jitter_m=abc"), "start_jitter_m=abc: must be a number"),
    ((*GO, "simulator.gui=maybe"), "simulator.gui=maybe: must be true or false"),
    ((*GO, "simulator.drive=[limited]"), "simulator.drive=[limited]: must be a word"),
    ((*GO, "world.bounds=[1,2]"), "world.bounds=[1,2]: must be a mapping"),
    ((*GO, "world.boxes=hello"), "world.boxes=hello: must be a list"),
    ((*GO, "world.boxes=[1]"), "world.boxes=[1]: must be a mapping"),
    ((*GO, "sensors.mounts={a: 1}"), "sensors.mounts={a: 1}: must be a list"),
    ((*GO, "controller.native=3"), "controller.native=3: must be a mapping"),
    ((*GO, "robot.sources={radius_m: 3}"), "sources.radius_m=3: must be a mapping"),
    ((*GO, "controller.native.robot=null"), "controller.native.robot=None: must be a mapping"),
    ((*GO, "controller.native.period_s=abc"), "controller.native.period_s='abc'", "number above 0"),
    ((*GO, "controller.build.speed_mps=abc"), "controller.build.speed_mps='abc': must be a valid number"),
    ((*GO, "controller.build.speed_mps=true"), "controller.build.speed_mps=True: must be a valid number"),
    ((*GO, "controller.build.speed_mps=null"), "controller.build.speed_mps=None: must be a valid number"),
    (("controller=sflc", "controller.build.turn_peaks_radps.NL=abc"), "build.turn_peaks_radps.NL='abc': must be a"),
    # words that speak against each other
    ((*GO, "world=corner"), "world=corner: world=empty is there, too; a sweep is -m world=empty,corner\n"),
    ((*GO, "episode=3", "episodes=5"), "episode=3: runs it alone; leave out episodes=5\n"),
    ((*GO, "resume=x"), "resume=x: must be other-code\n"),
    (("tune",), "tune: name a controller, such as controller=pid\n"),
    (("tune", "tuner=pso"), "tune: name a controller, such as controller=pid\n"),
    (("report", "results", "--trsut"), "--trsut: unknown flag; did you mean --trust? allowed: --trust, "),
    (("report", "join="), "join=: must name a directory\n"),
    (("study", "smoke", "foo=1"), "foo=1: unknown key; allowed with a study: engine, workers, simulator, reconstr"),
    (("multiverse", "aouf2019", "tuned=nowhere"), "tuned=nowhere: there is no such directory\n"),
    (("multiverse", "aouf2019", "n=16"), "n=16: must be a multiple of 128, so that each of the 16 samples has as m"),
    (("controller=gr\udcc3\udcb6", "world=empty"), "cannot be read in this locale; set PYTHONUTF8=1\n"),
    ((*GO, "world.starts=[{x_m: -1.2, y_m: -1.18}]"), "world.starts[0]: (-1.2, -1.18) must lie further from its goal"),
    # ranges
    ((*GO, "episodes=0"), "episodes=0: must be from 1 to 1000000"),
    ((*GO, "episodes=1000000000000"), "episodes=1000000000000: must be from 1 to 1000000"),
    ((*GO, "seed=-1"), "seed=-1: must be from 0 to 9223372036854775807"),
    ((*GO, "seed=9223372036854775808"), "seed=9223372036854775808: must be from 0 to 9223372036854775807"),
    ((*GO, "workers=-1"), "workers=-1: must be at least 0"),
    ((*GO, "controller_timeout_s=0"), "controller_timeout_s=0.0: must be from 0.001 to 1000000.0, or null for any"),
    ((*GO, "controller_timeout_s=1e10"), "controller_timeout_s=10000000000.0: must be from 0.001 to 1000000.0"),
    ((*GO, "start_jitter_m=nan"), "start_jitter_m=nan: must be finite and at least 0"),
    ((*GO, "start_heading_jitter_rad=-0.1"), "start_heading_jitter_rad=-0.1: must be finite and at least 0"),
    ((*GO, "start_heading_jitter_rad=inf"), "start_heading_jitter_rad=inf: must be finite"),
    ((*GO, "robot.radius_m=nan"), "robot.radius_m=nan: must be a finite number"),
    ((*GO, "robot.track_m=0"), "robot.track_m=0.0: must be greater than 0"),
    ((*GO, "world.time_limit_s=1e400"), "world.time_limit_s=inf: must be a finite number"),
    ((*GO, "robot.radius_m=1e-12"), "world.time_limit_s=60.0: must be at most 1000000 steps", "radius 1e-12 m"),
    (
        ("controller=go_to_goal", "world=random_movers", "world.source.parts.movers.speed_mps=[1.0,1e4]",
         "world.source.parts.movers.leg_m=[20.0,50.0]"),
        "world.time_limit_s=150.0: must be at most 1000000 steps",
        "speeds to 1e+04 m/s",
    ),
    ((*GO, "world.goals=[{x_m: 1.495, y_m: 0}]"), "world.goals[0]: (1.495, 0.0) lies 0.005 m from an obst", "nearer"),
    ((*GO, "controller.native.period_s=1e-9"), "must be at most 1000000 steps", "control period 1e-09 s"),
    ((*GO, "controller.native.period_s=0"), "controller.native.period_s=0: must be a finite number above 0"),
    ((*GO, "controller.build.speed_mps=nan"), "controller.build.speed_mps=nan: must be a finite number"),
    ((*GO, "controller.build.speed_mps=-1"), "controller.build.speed_mps=-1: must be greater than 0"),
    ((*GO, "simulator.drive=fly"), "simulator.drive='fly': must be 'ideal' or 'limited'"),
    ((*GO, "simulator.motor_lag_s=-1"), "simulator.motor_lag_s=-1.0: must be greater than or equal to 0"),
    ((*GO, "sensors.rays=0"), "sensors.rays=0: must be greater than or equal to 1"),
    ((*GO, "sensors.dropout_probability=2"), "sensors.dropout_probability=2.0: must be less than or equal to 1"),
    ((*GO, "sensors.tracker={range_m: -1}"), "sensors.tracker.range_m=-1: must be greater than 0"),
    # what no single value shows
    (("controller=sflc", "sensors=ring16"), "sensors=ring16: sflc needs the range sensors rear_left, "),
    ((*GO, "world.starts=[{x_m: 1.48, y_m: 0}]"), "world.starts[0]: (1.48, 0.0) must lie further", "an obstacle"),
    ((*GO, "world.starts=[{x_m: 0, y_m: 0}, {x_m: 0.05, y_m: 0}]", "world.goals=[{x_m: 1, y_m: 0}, {x_m: 0, y_m: 1}]"),
     "world.starts[1]", "another start"),
    ((*GO, "world.goals=[{x_m: 9, y_m: 0}]"), "goals[0]: (9.0, 0.0) must lie inside the bounds"),
    ((*GO, "world.boxes=[{x_m: -1.2, y_m: -1.2, length_m: 0.1, width_m: 0.1}]"), "goals[0]", "outside every obstacle"),
    ((*GO, "world.finish_line={x1_m: 0, y1_m: 0, x2_m: 0, y2_m: 0}"), "finish_line: its two ends"),
    ((*GO, "world.movers=[{radius_m: 0.1, waypoints: [{x_m: 0, y_m: 0}], speeds_mps: [1]}]"), "world.movers[0]",
     "at least 2"),
    # classes
    ((*GO, "controller.build._target_=nope.Nope"), "controller.build._target_=nope.Nope: cannot be imported", "'nope'"),
    ((*GO, "controller.build._target_=null"), "controller.build._target_=None: must name a class"),
    ((*GO, "controller.build._target_=math.pi"), "controller.build._target_=math.pi: must name a class"),
    ((*GO, "controller.build._target_=builtins.dict"), "_target_=builtins.dict: must name a class with reset"),
    # references
    ((*GO, "seed=${nope}"), "seed: Interpolation key 'nope' not found"),
    ((*GO, "robot.radius_m=${deg:abc}"), "robot.radius_m: TypeError", "must be real number, not str"),
    # words
    (("nonsense",), "nonsense: unknown verb; allowed: list", "key=value"),
    ((*GO, "nonsense"), "nonsense: cannot be read; a word is key=value"),
    ((*GO, "world.boxes=["), "world.boxes=[: cannot be read"),
    ((*GO, "--config-dir", "nope"), "--config-dir=nope: there is no such directory"),
    ((*GO, "--config-dir=nope"), "--config-dir=nope: there is no such directory"),
    ((*GO, "--config-dir"), "--config-dir/-cd: expected one argument"),
    ((*GO, "--config-name=nope"), "--config-name=nope: unknown flag; did you mean --config-dir? allowed: "),
    ((*GO, "--resolve"), "--resolve"),
    ((*GO, "hydra.searchpath=[file:///nope]"), "hydra.searchpath: unknown key", "hydra.run.dir"),
    ((*GO, "hydra.run.dir=new/${nope}"), "hydra.run.dir", "'nope' not found"),
    ((*GO, "hydra.run.dir=/proc/nope"), "/proc/nope: No such file"),
    (("lst",), "lst: unknown verb; did you mean list? "),
    (("run", *GO), "run: unknown verb; a run has none: navbench controller=sflc world=deadlock"),
    (("plot", "results"), "plot: unknown verb; did you mean show? "),
    (("list", "wrld"), "list wrld: unknown group; did you mean world? "),
    (("study", "aouf2018"), "did you mean aouf2019? "),
    (("world", "=", "empty"), "world = empty: cannot be read; a word is key=value without spaces"),
    ((*GO, "seed", "=", "3"), "seed: cannot be read; a word is key=value without spaces"),
    (("--controller=pid",), "--controller=pid: unknown flag; did you mean controller=pid? "),
    (("controller=pid", "world=deadlok"), "world=deadlok: unknown choice; did you mean deadlock?\n"),
    (("controller=pid", "world=empty", "controller.kp=3"), "controller.kp: unknown key; did you mean controller.build"),
    (("controller=pid", "world=empty", "pid.kp=3"), "pid: unknown key; did you mean controller.build.kp?\n"),
    (("controller=pid", "world=empty", "kp=3"), "kp: unknown key; did you mean controller.build.kp?\n"),
    ((*GO, "noise_std_m=1"), "noise_std_m: unknown key; did you mean sensors.noise_std_m?"),
    (("controller=nan", "world=empty"), "controller=nan: must be one name; `navbench list controller` prints them"),
    ((*GO, "episods=3"), "episods: unknown key; did you mean episodes?"),
    ((*GO, "world.boxes=[{x_m: 1.0, y_m: 1.0, length_m: 0.2, width_m: 0.2}, {length_m: long}]"),
     "world.boxes[1].length_m='long': must be a number"),
    (("list", "nope"), "list nope: unknown group; there are: controller, world, "),
    (("list", "--config-dir", "nope"), "--config-dir=nope: there is no such directory"),
    (("list", "--config-dir"), "--config-dir/-cd: expected one argument"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "said"), [(row[0], row[1:]) for row in WRONG], ids=[" ".join(row[0]) for row in WRONG]
)
def test_a_wrong_input_is_refused_in_one_line_and_leaves_nothing(
    command: Command, tmp_path: Path, words: tuple[str, ...], said: tuple[str, ...]
) -> None:
    check_refused(command(*words), *said)
    assert files_in(tmp_path) == set()


@pytest.mark.parametrize("flag", ["--nope", "-x", "--workers=2", "--cfg=nope", "--cfg"])
def test_a_wrong_flag_is_refused_in_one_line(command: Command, tmp_path: Path, flag: str) -> None:
    check_refused(command(*GO, flag), flag.split("=")[0])
    assert files_in(tmp_path) == set()


def test_a_display_that_does_not_answer_is_told(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":98765")
    monkeypatch.setattr(sys, "platform", "linux")
    check_refused(command(*GO, "simulator.gui=true"), "simulator.gui=True: needs a display, and DISPLAY=:98765 is none")


def test_a_window_without_a_display_is_refused(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    check_refused(command(*GO, "simulator.gui=true"), "simulator.gui=True: needs a display")


def test_a_refused_run_leaves_no_directory_outside_the_working_one_either(
    command: Command, tmp_path_factory: pytest.TempPathFactory
) -> None:
    outside = tmp_path_factory.mktemp("outside")
    check_refused(command(*GO, "seed=-1", f"hydra.run.dir={outside}/one/two"), "seed=-1")
    assert files_in(outside) == set()
    assert outside.is_dir()


# What is wrong with a user's folder


WRONG_FILES = [
    ("mine.yaml", "build: [\n", "conf/controller/mine.yaml, line 2"),
    ("mine.yaml", "", "controller.build._target_: missing"),
    ("mine.yaml", "- 1\n", "controller=[1]: must be a mapping"),
    ("mine.yaml", "build: {_target_: mine.Mine, gain: 2}\nbild: 3\n", "controller.bild: unknown key; did you mean"),
    ("mine.yaml", "build: {_target_: mine.Mine, gain: .nan}\n", "controller.build.gain=nan: must be a finite number"),
    ("mine.yaml", "build: {_target_: mine.Mine, gain: [1, .inf]}\n", "controller.build.gain[1]=inf: must be a finite"),
    ("mine.yaml", "build: {_target_: mine.Mine}\n", "controller.build.gain: missing"),
    ("mine.yaml", "build: {_target_: mine.Mine, gain: \"${nope}\"}\n", "controller.build.gain: Interpolation key"),
    ("mine.yaml", "build: {_target_: mine.Mine, gain: 2}\nnative: {period_s: 1}\n", "controller.native.robot: missing"),
    ("mine.yaml", "defaults: [/nope/x@_here_, _self_]\n", "controller/mine", "nope/x"),
    ("mine.py", "import nope\n", "controller.build._target_=mine.Mine: cannot be imported", "'nope'"),
    ("mine.py", "class Mine(:\n", "cannot be imported: SyntaxError: invalid syntax (mine.py, line 1)"),
    ("mine.py", "1 / 0\n", "cannot be imported: ZeroDivisionError: division by zero (mine.py, line 1: 1 / 0)"),
    ("mine.py", MINE.replace("class Mine:", "class Mine:\n    sensor_roles = 3"), "sensor_roles must be a tuple"),
    ("mine.py", "def Mine(gain): return gain\n", "controller.build._target_=mine.Mine: must name a class with reset"),
    ("mine.py", MINE.replace("self.gain = gain", "raise RuntimeError('no\\nluck')"),
     "controller.build: RuntimeError: no luck"),
    ("mine.py", MINE.replace("gain)", "gain: tuple[float, str])", 1), "controller.build.gain=2.0: must be a valid "),
]  # fmt: skip


def test_a_folder_above_the_one_of_the_configurations_is_told_from_it(command: Command, tmp_path: Path) -> None:
    write(tmp_path, {"conf/controller/mine.yaml": MINE_YAML})
    check_refused(command("--config-dir", ".", "controller=mine"), "--config-dir=.: holds no ", "did you mean conf?")


def test_a_folder_may_be_named_before_the_verb(command: Command, tmp_path: Path) -> None:
    write(tmp_path, {"conf/controller/mine.yaml": MINE_YAML})
    assert "mine" in command("--config-dir", "conf", "list", "controller").out


def test_a_long_word_is_cut_and_its_key_is_told(command: Command) -> None:
    check_refused(command(*GO, f"seed={'9' * 4000}"), "navbench: seed=999", "999...")


@pytest.mark.parametrize(
    ("word", "said"),
    [
        (f"world.time_limit_s={'9' * 400}", "world.time_limit_s: must be a number, and is too large for one"),
        (f"world.boxes={'[' * 2000}{']' * 2000}", "nested too deeply"),
        (f"world={'x' * 5000}", "File name too long"),
    ],
)
def test_what_is_too_large_too_deep_or_too_long_is_refused_in_one_line(command: Command, word: str, said: str) -> None:
    check_refused(command("controller=go_to_goal", word), said)


def test_bytes_in_a_file_are_refused_by_their_key(command: Command, tmp_path: Path) -> None:
    write(tmp_path, {"mine.py": MINE, "conf/controller/mine.yaml": MINE_YAML.replace("2.0", "[1, !!binary aGk=]")})
    check_refused(command("--config-dir", "conf", "controller=mine"), "controller.build.gain[1]=b'hi': must be a word")


def test_a_file_that_cannot_be_listed_is_named(command: Command, tmp_path: Path) -> None:
    write(tmp_path, {"conf/controller/mine.yaml": MINE_YAML})
    (tmp_path / "conf/controller/loop.yaml").symlink_to("loop.yaml")
    check_refused(command("--config-dir", "conf", "list"), "conf/controller/loop.yaml: Too many levels of symbolic")


def test_a_working_directory_that_was_removed_is_told(command: Command, tmp_path: Path) -> None:
    (tmp_path / "gone").mkdir()
    os.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    check_refused(command(*GO), "the working directory: it is not there any more")


@pytest.mark.parametrize("place", ["import math", "self.gain = gain"])
def test_a_module_that_ends_the_process_is_refused_in_one_line(tmp_path: Path, place: str) -> None:
    text = "import os\n" + MINE.replace(place, "os._exit(0)")
    write(tmp_path, {"mine.py": text, "conf/controller/mine.yaml": MINE_YAML})
    done = in_a_process(tmp_path, "--config-dir", "conf", "controller=mine", "world=empty")
    check_refused(done, "SystemExit: os._exit(0) (mine.py, line ")


@pytest.mark.parametrize(("name", "text", "said"), [(row[0], row[1], row[2:]) for row in WRONG_FILES])
def test_a_wrong_controller_of_a_user_is_refused_in_one_line(
    command: Command, tmp_path: Path, name: str, text: str, said: tuple[str, ...]
) -> None:
    files = {"mine.py": MINE, "conf/controller/mine.yaml": MINE_YAML}
    write(tmp_path, files | {("conf/controller/mine.yaml" if name == "mine.yaml" else name): text})
    before = files_in(tmp_path)
    check_refused(command("--config-dir", "conf", "controller=mine", "world=empty"), *said)
    assert files_in(tmp_path) == before


BOXES = "time_limit_s: 30\nboxes: [{x_m: 2, y_m: 2, length_m: 0.1, width_m: 0.1}"


@pytest.mark.parametrize(
    ("line", "instead", "said"),
    [
        ("time_limit_s: 30", "time_limit_s: abc", "world/mine.yaml: world.time_limit_s=abc: must be a number"),
        ("time_limit_s: 30", "time_limit_s:", "world/mine.yaml: world.time_limit_s: must not be null"),
        ("time_limit_s: 30", "time_limt_s: 30", "world/mine.yaml: world.time_limt_s: unknown key; did you mean time"),
        ("time_limit_s: 30", "time_limit_s: .nan", "world.time_limit_s=nan: must be a finite number"),
        ("starts: [{x_m: 0, y_m: 0}]", "starts: {x_m: 0, y_m: 0}", "world/mine.yaml: "),
        (
            "time_limit_s: 30",
            BOXES + ", {x: 0, y: 0}]",
            "world/mine.yaml: world.boxes[1].x: unknown key; allowed here: x_m",
        ),
        (
            "time_limit_s: 30",
            BOXES + ", {length_m: long}]",
            "world/mine.yaml: world.boxes[1].length_m=long: must be a num",
        ),
        (
            "time_limit_s: 30",
            BOXES + "]\nwalls: [{x_m: 0, y1_m: 1}]",
            "world.walls[0].x_m: unknown key; did you mean x",
        ),
        ("goals: [{x_m: 0.5, y_m: 0}]", "goals: [{x_m: 0.5}]", "world.goals[0].y_m: missing"),
    ],
)
def test_a_wrong_world_of_a_user_is_refused_in_one_line(
    command: Command, tmp_path: Path, line: str, instead: str, said: str
) -> None:
    write(tmp_path, {"conf/world/mine.yaml": WORLD_YAML.replace(line, instead)})
    before = files_in(tmp_path)
    check_refused(command("controller=go_to_goal", "world=mine", "--config-dir", "conf"), said)
    assert files_in(tmp_path) == before


def test_a_forgotten_folder_is_named(command: Command, tmp_path: Path) -> None:
    write(tmp_path, {"conf/world/mine.yaml": WORLD_YAML, "conf/study/asks.yaml": ""})
    check_refused(
        command("controller=go_to_goal", "world=mine"), "mine: unknown choice; did you forget --config-dir conf?"
    )
    check_refused(command("study", "asks"), "study asks: name one study; did you forget --config-dir conf?")


def test_the_metrics_are_listed_with_their_units(command: Command) -> None:
    printed = command("list", "metric").out
    assert "  goal_distance_m      from the centre to the goal at the end [m]\n" in printed
    assert len(printed.splitlines()) == 1 + len(DECLARED)


def test_the_failures_of_a_sweep_come_in_its_order_and_say_what_tells_its_cells_apart(command: Command) -> None:
    words = (
        "-m",
        "controller=go_to_goal",
        "world=deadlock",
        "controller.build.speed_mps=0.3,0.1,0.2",
        "simulator=planar",
    )
    failed = [line for line in command(*words, "workers=0").out.splitlines() if line.startswith("go_to_goal (")]
    assert [line.split(",")[0] for line in failed] == [
        f"go_to_goal (speed_mps={x}) in deadlock" for x in (0.3, 0.1, 0.2)
    ]


def test_a_report_of_several_directories_does_not_replace_that_of_one(command: Command, tmp_path: Path) -> None:
    for name in ("one", "two"):
        store(tmp_path / name, [(a_cell(name), [a_record()])])
    assert command("report", "one").code == 0
    before = (tmp_path / "one/report/report.md").read_bytes()
    check_refused(command("report", "one", "two"), "report one two: name where their report is to go, as out=DIR")
    assert command("report", "one", "two", "out=both").code == 0
    assert (tmp_path / "one/report/report.md").read_bytes() == before


def test_a_users_file_does_not_hide_behind_one_of_the_same_name(command: Command, tmp_path: Path) -> None:
    write(tmp_path, {"conf/world/empty.yaml": WORLD_YAML})
    for words in ((*GO, "--config-dir", "conf"), ("list", "--config-dir=conf")):
        check_refused(command(*words), "conf/world/empty.yaml: navbench has a world of that name; choose another one")


def test_a_file_that_is_no_text_is_named(command: Command, tmp_path: Path) -> None:
    (tmp_path / "conf/controller").mkdir(parents=True)
    (tmp_path / "conf/controller/mine.yaml").write_bytes(b"# \xff\nbuild: {}\n")
    for words in (["controller=mine", "world=empty"], ["tune", "controller=mine"], ["study", "smoke"], ["list"]):
        done = command(*words, "--config-dir", "conf")
        check_refused(done, "conf/controller/mine.yaml: must be text in UTF-8; its byte 3 is none")


# Results directories


def test_a_directory_with_other_results_is_refused_and_kept(command: Command, tmp_path: Path) -> None:
    assert command(*GO, "hydra.run.dir=kept").code == 0
    before = {name: (tmp_path / name).read_bytes() for name in files_in(tmp_path) if (tmp_path / name).is_file()}
    check_refused(command(*GO, "seed=1", "hydra.run.dir=kept"), "kept: holds the results of other work")
    assert {name: (tmp_path / name).read_bytes() for name in before} == before


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("kept", "a file", "kept: is a file; results need a directory"),
        ("kept/manifest.json", "{", "kept/manifest.json: is no manifest of navbench"),
        ("kept/manifest.json", '{"schema_version": 99}', "schema_version=99, but this navbench reads "),
        ("kept/episodes/part-0.parquet", "", "kept: holds parts without a manifest"),
        ("kept/latency", "a file", "kept/latency: File exists"),
    ],
)
def test_a_directory_that_cannot_be_written_to_is_refused_and_kept(
    command: Command, tmp_path: Path, file: str, text: str, said: str
) -> None:
    write(tmp_path, {file: text})
    before = files_in(tmp_path)
    check_refused(command(*GO, "hydra.run.dir=kept"), said)
    assert files_in(tmp_path) == before
    assert (tmp_path / file).read_text() == text


# What is printed and written


def test_a_run_prints_its_table_and_says_where_the_results_are(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("navbench.cli.progress.EVERY_S", float("inf"))  # on a slow machine, too
    done = command("controller=sflc", "world=corner", "episodes=2", "start_jitter_m=0.01")
    assert done.code == 0
    assert done.err == ""
    header, rule, row, *_, last = done.out.splitlines()
    assert header.split()[:5] == ["controller", "world", "robot", "reached", "collisions"]
    assert set(rule) == {"-", " "}
    assert re.match(r"sflc +corner +khepera3 +2 of 2 +0 +", row)
    folder = tmp_path / last.removeprefix("results: ")
    assert re.fullmatch(r"results: outputs/\d{4}-\d\d-\d\d/\d\d-\d\d-\d\d-\d{6}-sflc-corner", last)
    names = {path.name for path in folder.iterdir()}
    assert names == {"manifest.json", "episodes", "trajectories", "latency", "layouts", *WRITTEN}
    assert (folder / "trajectories.png").read_bytes().startswith(b"\x89PNG")


def test_a_run_names_the_robots_that_failed_and_how(command: Command) -> None:
    done = command("controller=go_to_goal", "world=deadlock", "hydra.run.dir=here")
    assert re.search(
        r"^go_to_goal in deadlock, seed 0, episode 0, robot 0: collided after \S+ s \(hit box 0\)$", done.out, re.M
    )


def test_a_sweep_ends_with_one_joined_table_printed_and_written(command: Command, tmp_path: Path) -> None:
    done = command("-m", "controller=sflc,pid", "world=corner", "hydra.sweep.dir=sweep")
    assert done.code == 0
    assert [line.split()[0] for line in done.out.splitlines()[2:4]] == ["sflc", "pid"]  # in the order of the sweep
    assert done.out.splitlines()[-1] == "results: sweep"
    table = pd.read_csv(tmp_path / "sweep/table.csv")
    assert list(table["controller"]) == ["sflc", "pid"]
    assert table[["reached", "of"]].to_numpy().tolist() == [[1, 1], [1, 1]]
    written = (tmp_path / "sweep/table.md").read_text().splitlines()
    assert len(written) == 4
    assert all(re.fullmatch(r"\|( [^|]+ \|)+|\|[-:|]+\|", line) for line in written)
    assert {path.name for path in (tmp_path / "sweep").iterdir() if path.is_file()} == {"manifest.json", *WRITTEN}
    assert [cell["controller"] for cell in Results(tmp_path / "sweep").manifest()["cells"]] == ["sflc", "pid"]


def test_a_sweep_tells_its_cells_apart_by_what_differs(command: Command, tmp_path: Path) -> None:
    words = ("robot.wheel_speed_max_mps=0.2,0.3", "seed=1,2", "hydra.sweep.dir=sweep")
    done = command("-m", "controller=go_to_goal", "world=corner", *words)
    assert done.code == 0, done.err
    assert "robot.wheel_speed_max_mps" in done.out.splitlines()[0].split()
    table = pd.read_csv(tmp_path / "sweep/table.csv")
    cells = list(table[["robot.wheel_speed_max_mps", "seed"]].itertuples(index=False, name=None))
    assert cells == [(0.2, 1), (0.2, 2), (0.3, 1), (0.3, 2)]


def test_equal_cells_of_a_sweep_are_one_row(command: Command, tmp_path: Path) -> None:
    command("-m", *GO, "workers=1,2", "hydra.sweep.dir=sweep")
    assert list(pd.read_csv(tmp_path / "sweep/table.csv")["reached"]) == [1]


def test_a_sweep_with_a_wrong_cell_finishes_the_others_and_names_it(command: Command, tmp_path: Path) -> None:
    done = command("controller=sflc,go_to_goal", "-m", "world=corner", "sensors=ring16", "hydra.sweep.dir=sweep")
    assert done.code == 3
    wrong, missing = done.err.splitlines()
    assert wrong.startswith("navbench: cell 0: sensors=ring16: sflc needs the range sensors")
    assert missing == "navbench: 1 of 2 planned episodes are there: the cells named above cannot be run"
    assert re.match(r"go_to_goal +corner ", done.out.splitlines()[2])


def test_a_sweep_of_wrong_cells_leaves_nothing(command: Command, tmp_path: Path) -> None:
    done = command("-m", *GO, "world.time_limit_s=0,-1")
    assert done.code == 2
    assert done.out == ""
    assert done.err.splitlines() == [
        "navbench: cell 0: world.time_limit_s=0.0: must be greater than 0",
        "navbench: cell 1: world.time_limit_s=-1.0: must be greater than 0",
    ]
    assert files_in(tmp_path) == set()


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("episodes=1,abc", "episodes=abc: must be a whole number"),
        ("controller=sflc,nope", "controller=nope: unknown choice"),
        ("nope=1,2", "nope: unknown key"),
    ],
)
def test_a_sweep_that_cannot_be_composed_is_refused_before_anything_runs(
    command: Command, tmp_path: Path, word: str, said: str
) -> None:
    check_refused(command("-m", "world=empty", word, "hydra.sweep.dir=new/sweep"), said)
    assert files_in(tmp_path) == set()


@pytest.mark.parametrize("flags", [("--cfg=job",), ("-c", "job"), ("--cfg", "job")])
def test_flags_may_stand_anywhere(command: Command, flags: tuple[str, ...]) -> None:
    for words in ((*flags, *GO, "seed=7"), (GO[0], *flags, GO[1], "seed=7"), (*GO, "seed=7", *flags)):
        done = command(*words)
        assert done.code == 0, done.err
        assert "seed: 7" in done.out


def test_list_names_what_there_is_a_line_each(command: Command, tmp_path: Path) -> None:
    write(tmp_path, {"conf/world/mine.yaml": WORLD_YAML})
    done = command("list", "robot", "world", "--config-dir", "conf")
    lines = done.out.splitlines()
    robots = files_of("robot", [CONF])
    assert [line.split(maxsplit=1) for line in lines[1 : 1 + len(robots)]] == [[*item] for item in robots.items()]
    assert [line for line in lines if not line.startswith("  ")] == ["robot", "world"]
    assert re.search(r"^  mine +A square with nothing in it$", done.out, re.M)
    assert command("list").out.startswith("controller\n")
    assert "  _" not in command("list").out


def test_the_configuration_can_be_printed_without_running(command: Command, tmp_path: Path) -> None:
    done = command(*GO, "--cfg", "job")
    assert done.code == 0
    assert "radius_m: 0.065" in done.out
    assert files_in(tmp_path) == set()


@pytest.mark.parametrize("words", [(), ("-h",), ("--help",), ("help",)])
def test_help_shows_every_verb_and_every_key_of_a_run(command: Command, words: tuple[str, ...]) -> None:
    done = command(*words)
    assert done.code == 0
    for word in (*cli.VERBS, "controller=", "episodes=", "seed=", "start_jitter_m=", "workers=", "--config-dir", "-m"):
        assert word in done.out


def test_the_version_is_printed(command: Command) -> None:
    assert command("--version").out == f"navbench {navbench.__version__}\n"


# Your own controller


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A user's folder with a controller of ten lines."""
    write(tmp_path, {"mine.py": MINE, "conf/controller/mine.yaml": MINE_YAML})
    return tmp_path


def test_a_controller_of_plain_python_runs_from_a_folder_outside_the_project(own: Path) -> None:
    done = in_a_process(own, "--config-dir", "conf", "controller=mine", "world=empty")
    assert done.code == 0, done.err
    assert re.search(r"^mine +empty +khepera3 +1 of 1 ", done.out, re.M)


def test_a_controller_of_plain_python_reaches_worker_processes(own: Path) -> None:
    words = ("workers=2", "episodes=30", "start_jitter_m=0.01", "start_heading_jitter_rad=0.1")
    done = in_a_process(own, "-m", "--config-dir", "conf", "controller=mine,go_to_goal", "world=empty", *words)
    assert done.code == 0, done.err
    assert re.search(r"^mine +empty +khepera3 +30 of 30 ", done.out, re.M)
    assert re.search(r"^go_to_goal +empty +khepera3 +\d+ of 30 ", done.out, re.M)


def test_a_controller_of_plain_python_may_name_its_robot_and_its_sensors(command: Command, own: Path) -> None:
    defaults = "[/robot@native.robot: khepera3, _self_, override /sensors@_global_.sensors: khepera3_ir]"
    write(own, {"conf/controller/mine.yaml": f"defaults: {defaults}\n{MINE_YAML}native: {{period_s: 0.1}}\n"})
    done = command("--config-dir", "conf", "controller=mine", "world=empty_100", "hydra.run.dir=here")
    assert re.search(r"^mine +empty_100 +disc4 +1 of 1 ", done.out, re.M)
    cell = pd.read_json(own / "here/manifest.json", typ="series")["cells"][0]
    assert cell["sensors"] == "khepera3_ir"
    assert cell["configuration"]["controller"]["native"]["period_s"] == 0.1


def test_a_list_in_a_file_may_stand_for_a_tuple(command: Command, own: Path) -> None:
    code = MINE.replace("gain)", "gain: tuple[float, float])", 1).replace("self.gain *", "self.gain[0] *")
    write(own, {"mine.py": code, "conf/controller/mine.yaml": "build: {_target_: mine.Mine, gain: [2, 3.0]}\n"})
    done = command("--config-dir", "conf", "controller=mine", "world=corner")
    assert done.code == 0, done.err


RETURN = "act must return Command(v_mps, w_radps), two finite numbers; it returned "


@pytest.mark.parametrize(
    ("line", "instead", "reason"),
    [
        ("return 0.15, self.gain * turn", "raise KeyError('lost')", "KeyError: 'lost'"),
        (
            "return 0.15, self.gain * turn",
            "return float('nan'), 0.0",
            RETURN + "(nan, 0.0)",
        ),
        (
            "return 0.15, self.gain * turn",
            "pass",
            RETURN + "None; is a `return` missing?",
        ),
        ("self.sensors = len(setup.sensors)", "1 / 0", "ZeroDivisionError: division by zero"),
    ],
)
def test_a_controller_that_fails_is_a_row_with_its_reason(
    command: Command, own: Path, line: str, instead: str, reason: str
) -> None:
    write(own, {"mine.py": MINE.replace(line, instead)})
    done = command("--config-dir", "conf", "controller=mine", "world=corner", "hydra.run.dir=here")
    assert done.code == 0
    assert done.err == ""
    row = pd.read_csv(own / "here/episodes.csv").iloc[0]
    assert row["outcome"] == "controller_error"
    assert row["reason"].startswith(reason)
    assert f"robot 0: controller_error after 0.00 s ({reason}" in done.out
    place = re.search(r"\(mine.py, line (\d+)", done.out)
    assert place
    assert instead in (own / "mine.py").read_text().splitlines()[int(place[1]) - 1] or RETURN in reason


# The Python interface


def test_the_python_interface_takes_the_words_of_the_command_line(tmp_path: Path) -> None:
    ran = navbench.run("controller=sflc", "world=corner", "episodes=2", "workers=1", dir=tmp_path / "here")
    assert list(ran.episodes["outcome"]) == ["reached", "reached"]
    assert (tmp_path / "here/manifest.json").is_file()


@pytest.mark.parametrize("words", [("world=nope",), ("nope=3",), ("world=null",), ("seed=${nope}",), ("seed=-1",)])
def test_the_python_interface_refuses_with_a_value_error_that_is_one_line(words: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=words[0].split("=")[0]) as refusal:
        navbench.run(*words)
    assert isinstance(refusal.value, DescriptionError)
    assert len(str(refusal.value).splitlines()) == 1


def test_the_python_interface_refuses_a_folder_that_is_missing(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="nope: there is no such directory"):
        navbench.run(config_dir=str(tmp_path / "nope"))


# Processes


def test_ctrl_c_ends_a_run_quickly_and_keeps_what_was_finished(tmp_path: Path) -> None:
    words = ("controller=go_to_goal", "world=empty_100", "episodes=100000", "workers=2", "hydra.run.dir=here")
    pipe = subprocess.PIPE
    run = subprocess.Popen(
        [NAVBENCH, *words], cwd=tmp_path, stdout=pipe, stderr=pipe, text=True, start_new_session=True
    )
    while run.poll() is None and not list(tmp_path.glob("here/episodes/part-*")):
        time.sleep(0.05)
    os.killpg(run.pid, signal.SIGINT)
    try:
        out, err = run.communicate(timeout=20.0)
    finally:
        if run.poll() is None:  # or it would run for hours
            os.killpg(run.pid, signal.SIGKILL)
    assert run.returncode == 130
    assert out == ""
    said = "they are kept in here, and this goes on from there: navbench controller=go_to_goal world=empty_100 "
    assert re.search(rf"navbench: interrupted after \d+ of 100000 episodes; {said}.*hydra.run.dir=here\n$", err), err
    kept = pd.concat([pd.read_parquet(part) for part in tmp_path.glob("here/episodes/part-*")])
    assert len(kept) % 25 == 0
    assert len(kept) == len(pd.read_csv(tmp_path / "here/episodes.csv"))
    table = pd.read_csv(tmp_path / "here/table.csv")
    assert list(table["planned"]) == [100000]
    assert not [name for name in files_in(tmp_path) if name.endswith(".tmp")]


@pytest.mark.skipif(sys.platform != "linux", reason="limits of other systems differ")
def test_too_little_address_space_is_told_in_one_line_before_libraries_break_of_it(tmp_path: Path) -> None:
    words = ["bash", "-c", f"ulimit -v 700000; exec {NAVBENCH} controller=sflc world=deadlock"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    said = "navbench: ulimit -v: 0.72 GB of address space; the libraries need 1.5 GB\n"
    assert (done.returncode, done.stderr) == (2, said)
    assert files_in(tmp_path) == set()


def test_memory_that_runs_out_is_told_in_one_line(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: object) -> None:
        raise MemoryError("cannot take 9 GB")

    monkeypatch.setattr("navbench.cli.report.report", full)
    done = command("report", "here")
    assert (done.code, done.err) == (3, "navbench: out of memory: cannot take 9 GB\n")


@pytest.mark.parametrize("redirection", ["| true", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_an_output_that_nobody_reads_is_no_error(tmp_path: Path, redirection: str) -> None:
    line = f"set -o pipefail; {NAVBENCH} controller=sflc world=corner hydra.run.dir=here {redirection}"
    done = subprocess.run(["bash", "-c", line], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "here/trajectories.png").is_file()


@pytest.mark.skipif(sys.platform != "linux", reason="workers have sockets in a folder on Linux alone")
@pytest.mark.parametrize("workers", [0, 1])
def test_a_temporary_folder_of_too_long_a_name_is_one_line(tmp_path: Path, workers: int) -> None:
    folder = tmp_path / ("x" * 100)
    folder.mkdir()
    words = ("controller=go_to_goal", "world=empty", "simulator=planar", f"workers={workers}", "hydra.run.dir=here")
    given = {**os.environ, "TMPDIR": str(folder)}
    done = subprocess.run([NAVBENCH, *words], cwd=tmp_path, env=given, capture_output=True, text=True, check=False)
    assert done.returncode == 2 * workers
    said = f"navbench: TMPDIR={folder}: must be at most 70 bytes long, for the sockets in it\n"
    assert done.stderr == said * workers
    assert (tmp_path / "here").exists() == (not workers)


@pytest.mark.parametrize("redirection", ["| true", ">&- 2>&-", "> /dev/full 2> /dev/full"])
def test_no_controller_fails_because_nobody_reads_what_it_prints(tmp_path: Path, redirection: str) -> None:
    code = "import sys\n\nclass Loud:\n    def reset(self, setup, rng): pass\n    def act(self, observation):\n"
    code += "        print(10000 * 'x')\n        print(10000 * 'x', file=sys.stderr)\n        return 0.1, 0.0\n"
    (tmp_path / "loud.py").write_text(code)
    (tmp_path / "conf/controller").mkdir(parents=True)
    (tmp_path / "conf/controller/loud.yaml").write_text("build: {_target_: loud.Loud}\n")
    words = "--config-dir conf controller=loud world=empty world.time_limit_s=0.2 simulator=planar episodes=3 workers=1"
    subprocess.run(["bash", "-c", f"{NAVBENCH} {words} {redirection}"], cwd=tmp_path, capture_output=True, check=False)
    (rows,) = [pd.read_csv(file) for file in tmp_path.glob("outputs/*/*/episodes.csv")]
    assert list(rows["outcome"]) == ["timed_out"] * 3


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize(
    "words", ["list", "--help", "-m controller=sflc,pid world=corner simulator=planar hydra.sweep.dir=here"]
)
def test_a_full_output_is_one_line_and_all_is_written(tmp_path: Path, words: str) -> None:
    line = f"{NAVBENCH} {words} > /dev/full"
    done = subprocess.run(line, shell=True, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.endswith("navbench: the output: No space left on device\n")
    assert done.stderr.count("navbench:") == 1
    assert (tmp_path / "here/trajectories.png").is_file() == words.startswith("-m")
    assert subprocess.run(f"{line} 2>&1", shell=True, cwd=tmp_path, check=False).returncode == 2


def test_the_folder_of_configurations_may_stand_before_the_verb(own: Path, command: Command) -> None:
    assert command("--config-dir", "conf", "list", "controller") == command(
        "list", "controller", "--config-dir", "conf"
    )


def test_help_is_printed_wherever_it_stands_and_nothing_runs(command: Command, tmp_path: Path) -> None:
    for words in (["controller=sflc", "--help"], ["-m", "controller=sflc", "-h"], ["list", "--help"]):
        done = command(*words)
        assert (done.code, done.out.splitlines()[0]) == (0, command("--help").out.splitlines()[0])
    assert not list(tmp_path.iterdir())
