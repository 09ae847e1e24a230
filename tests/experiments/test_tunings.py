"""Tunings of nested parameters and of choices, with a repair: from the configuration to the tuned controller's file."""

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from commands import Command
from stored import a_record, metrics_of

from navbench.cli.study_configuration import compose_tuning
from navbench.cli.tuned import source_keys, write_controller
from navbench.experiments.store import Results
from navbench.experiments.tunings import Objective, run_tuning
from navbench.records import Outcome, RobotRecord
from navbench.tuning.space import Choice, Dimension
from navbench.validation import DescriptionError, describe

CONF = Path(__file__).parents[2] / "conf"

MODULE = '''
"""A controller that turns towards its goal by a gain and by a rule, and what mends its parameters."""

import math


class Steer:
    def __init__(self, gains: dict, rules: dict):
        if not gains["far"]["least"] <= gains["far"]["most"]:
            raise ValueError("gains: least must be at most most")
        self.gains, self.rules = gains, rules

    def reset(self, setup, rng):
        pass

    def act(self, observation):
        x, y, heading = observation.pose
        error = math.remainder(math.atan2(observation.goal[1] - y, observation.goal[0] - x) - heading, 2.0 * math.pi)
        turn = {"hard_right": -1.0, "right": -0.3, "none": 0.0, "left": 0.3, "hard_left": 1.0}
        side = "left" if error > 0.05 else "right" if error < -0.05 else "ahead"
        far = self.gains["far"]
        return (min(max(self.gains["speed_mps"], far["least"]), far["most"]), turn[self.rules["turn"][side]])


class Pausing:
    def __init__(self, pause: int, speed_mps: float):
        self.pause, self.speed_mps, self.steps = pause, speed_mps, 0
        if type(pause) is not int:
            raise ValueError("pause: must be a whole number")

    def reset(self, setup, rng):
        self.steps = 0

    def act(self, observation):
        self.steps += 1
        return (self.speed_mps if self.steps % self.pause == 0 else 0.0, 0.0)


class Ordered:
    def __init__(self, least: str, most: str):
        self.least, self.most = least, most

    def __call__(self, values):
        low, high = sorted((values[self.least], values[self.most]))
        return {**values, self.least: low, self.most: high}


class Shifted:
    def __call__(self, values):
        return {name: value + 100.0 for name, value in values.items()}
'''
CONTROLLER = """# Steers by rules, for the tests of tunings
defaults:
  - _self_
  - override /sensors@_global_.sensors: khepera3_ir
build:
  _target_: toy_steering.Steer
  gains: {far: {least: 0.05, most: 0.3}, speed_mps: 0.1}
  rules: {turn: {left: none, ahead: none, right: none}}
tunable:
  gains.far: {low: 0.0, high: 0.33, scale: linear}
  gains.speed_mps: {low: 0.01, high: 0.33, scale: log}
  rules: {choices: [hard_right, right, none, left, hard_left]}
repair: {_target_: toy_steering.Ordered, least: gains.far.least, most: gains.far.most}
sources:
  build.gains: {assumed: for a test}
  build.rules.turn: {assumed: for a test}
"""
WORLD = """# A goal to the left, for the tests of tunings
defaults: [/schema/world@_here_, _self_, override /robot@_global_.robot: khepera3]
bounds: {x_min_m: -2.0, x_max_m: 2.0, y_min_m: -2.0, y_max_m: 2.0}
starts: [{x_m: 0.0, y_m: 0.0, heading_rad: 0.0}]
goals: [{x_m: 0.8, y_m: 0.5}]
goal_tolerance_m: 0.1
time_limit_s: 20.0
"""
ROOMS = """
from dataclasses import dataclass

from navbench.world import Bounds, Layout, Point, Start


@dataclass(frozen=True)
class Odd:
    def draw(self, rng, episode):
        if episode % 2:
            raise ValueError("no room")
        return Layout(bounds=Bounds.of(2, 2), starts=(Start(0.5, 1.0),), goals=(Point(1.5, 1.0),))
"""
WORDS = ["controller=steer", "tuner=ga", "objective=time", "world=aside", "budget=88"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's folder with a controller of his own."""
    (tmp_path / "toy_steering.py").write_text(MODULE)
    for group, name, text in (("controller", "steer", CONTROLLER), ("world", "aside", WORLD)):
        (tmp_path / "conf" / group).mkdir(parents=True)
        (tmp_path / "conf" / group / f"{name}.yaml").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "toy_steering", raising=False)
    return tmp_path


@pytest.fixture
def navbench(folder: Path, command: Command) -> Command:
    """The command line in the user's folder, with what lies there."""
    return lambda *words: command(*words, "--config-dir", "conf")


# ---- what there is to tune


def test_a_subtree_stands_for_every_parameter_below_it_and_starts_where_the_controller_is(folder: Path) -> None:
    tuning, _, _ = compose_tuning(WORDS, str(folder / "conf"))
    terms = ("hard_right", "right", "none", "left", "hard_left")
    assert tuning.dimensions == (
        Dimension("gains.far.least", 0.0, 0.33, "linear", 0.05),
        Dimension("gains.far.most", 0.0, 0.33, "linear", 0.3),
        Dimension("gains.speed_mps", 0.01, 0.33, "log", 0.1),
        *(Choice(f"rules.turn.{side}", terms, 2) for side in ("left", "ahead", "right")),
    )
    assert tuning.parameters([0.0, 0.1, 0.2, 0.0, 2.0, 4.0]) == {
        "gains.far.least": 0.0,
        "gains.far.most": 0.1,
        "gains.speed_mps": 0.2,
        "rules.turn.left": "hard_right",
        "rules.turn.ahead": "none",
        "rules.turn.right": "hard_left",
    }


def test_of_a_layout_that_could_not_be_drawn_no_robot_is_counted(folder: Path) -> None:
    (folder / "toy_rooms.py").write_text(ROOMS)
    world = "source: {_target_: toy_rooms.Odd}\ngoal_tolerance_m: 0.1\ntime_limit_s: 20.0\n"
    (folder / "conf/world/odd.yaml").write_text(f"{WORLD.splitlines()[1]}\n{world}")
    words = ["controller=pid", "tuner=random", "world=odd", "episodes=4", "budget=10"]
    tuning, _, _ = compose_tuning(words, str(folder / "conf"))
    assert {(one.reached, one.robots) for one in run_tuning(tuning).evaluations} == {(2, 2)}


def test_only_a_tuning_with_a_repair_says_so_in_its_configuration(folder: Path) -> None:
    own, _, _ = compose_tuning(WORDS, str(folder / "conf"))
    assert own.configuration["repair"]["_target_"] == "toy_steering.Ordered"
    without, _, _ = compose_tuning([*WORDS, "~controller.repair"], str(folder / "conf"))
    assert "repair" not in without.configuration
    assert own.key().tuning_id != without.key().tuning_id
    assert own.cells[0].key() == without.cells[0].key()


CHOICES = "{choices: [hard_right, right, none, left, hard_left]}"
WRONG = [
    (
        "gains.far: {low",
        "gains.near: {low",
        "controller.build.gains.near: there is no such parameter; allowed here: far,",
    ),
    (CHOICES, "{choices: [none]}", "controller.tunable.rules.choices=['none']: must be two or more different names"),
    (CHOICES, "{choices: [none, none]}", "controller.tunable.rules.choices=['none', 'none']: must be two or more"),
    (
        CHOICES,
        "{low: 0, choices: [a, b]}",
        "controller.tunable.rules: must hold low, high and scale, or choices, got {",
    ),
    (CHOICES, "5", "controller.tunable.rules: must hold low, high and scale, or choices, got 5"),
    ("ahead: none", "ahead: up", "controller.build.rules.turn.ahead='up': must be one of hard_right, right, none, "),
    (
        CHOICES,
        "{low: 0.0, high: 1.0, scale: linear}",
        "controller.tunable.rules: must name a number, not rules.turn.left='none'",
    ),
    ("far: {low: 0.0", "far: {low: 0.5", "controller.tunable.gains.far.high=0.33: must be greater than low=0.5"),
    (
        "{low: 0.0, high: 0.33",
        "{low: 0.0, high: 0.2",
        "controller.build.gains.far.most=0.3: must be between 0.0 and 0.2, the bounds of controller.tunable.gains.far",
    ),
    ("gains.far: {low", "gains: {low", "controller.tunable.gains.speed_mps: gains.speed_mps is named there twice"),
    ("steering.Ordered", "steering.Missing", "controller.repair._target_=toy_steering.Missing: cannot"),
    ("toy_steering.Ordered", "nowhere.Ordered", "controller.repair._target_=nowhere.Ordered: cannot be"),
    (", most: gains.far.most", "", "controller.repair.most: missing; a value is needed"),
    (
        "_target_: toy_steering.Ordered, ",
        "",
        "controller.repair._target_: missing; it must name a class with __call__(values)",
    ),
    ("most: gains.far.most", "most: gains.most", "controller.repair: KeyError: 'gains.most'"),
    (
        "Ordered, least: gains.far.least, most: gains.far.most",
        "Shifted",
        "controller.repair: gains.far.least=100.05: must be between 0.0 and 0.33",
    ),
]


@pytest.mark.parametrize(("there", "wrong", "message"), WRONG)
def test_a_wrong_tunable_is_refused_in_one_line(there: str, wrong: str, message: str, folder: Path) -> None:
    assert there in CONTROLLER
    (folder / "conf/controller/steer.yaml").write_text(CONTROLLER.replace(there, wrong))
    with pytest.raises(DescriptionError) as refused:
        compose_tuning(WORDS, str(folder / "conf"))
    assert str(refused.value).startswith(message)
    assert "\n" not in str(refused.value)


def test_the_command_line_refuses_a_wrong_tunable_with_exit_2(folder: Path, navbench: Command) -> None:
    done = navbench("tune", *WORDS, "controller.build.rules.turn.left=up")
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("navbench: controller.build.rules.turn.left='up': must be one of hard_right, ")
    assert len(done.err.splitlines()) == 1


# ---- what a tuning keeps and writes


def parts_of(path: Path) -> dict[str, bytes]:
    kinds = ("evaluations", "checks", "conf/controller", "episodes", "trajectories")
    return {str(file.relative_to(path)): file.read_bytes() for kind in kinds for file in (path / kind).iterdir()}


def test_a_tuning_of_choices_is_the_same_with_one_worker_and_with_two_and_writes_names(
    folder: Path, navbench: Command
) -> None:
    for workers in ("1", "2"):
        done = navbench("tune", *WORDS, f"workers={workers}", f"hydra.run.dir=with_{workers}")
        assert done.code == 0, done.err
        assert "  rules.turn.left: " in done.out
    assert parts_of(folder / "with_1") == parts_of(folder / "with_2")
    assert (folder / "with_1/convergence.png").stat().st_size > 1000

    rows = Results(folder / "with_1").evaluations()
    assert len(rows) == 88
    assert (rows["gains.far.least"] <= rows["gains.far.most"]).all()
    best = rows.iloc[int(rows["cost"].to_numpy().argmin())].to_dict()
    assert best["cost"] < rows["cost"].iloc[0]
    assert best["rules.turn.left"] in ("left", "hard_left")

    content = yaml.safe_load((folder / "with_1/conf/controller/ga_steer.yaml").read_text())
    assert content["defaults"] == ["steer", "_self_"]
    assert content["build"] == {
        "gains": {
            "far": {"least": best["gains.far.least"], "most": best["gains.far.most"]},
            "speed_mps": best["gains.speed_mps"],
        },
        "rules": {"turn": {side: best[f"rules.turn.{side}"] for side in ("left", "ahead", "right")}},
    }
    how = "navbench tune controller=steer tuner=ga objective=time simulator=planar, in aside, budget=88"
    told = {"tuned": how, "seed": 0}
    assert content["sources"] == {"build.gains": told, "build.rules.turn": told}

    (folder / "with_1/conf/controller/ga_steer.yaml").rename(folder / "conf/controller/ga_steer.yaml")
    again = navbench("controller=ga_steer", "world=aside", "hydra.run.dir=again")
    assert again.code == 0, again.err
    assert Results(folder / "again").episodes()["time_s"].tolist() == [best["cost"]]


JITTER = ("start_heading_jitter_rad=0.5", "episodes=2")


def test_every_evaluation_meets_the_same_episodes(folder: Path) -> None:
    (folder / "conf/controller/pausing.yaml").write_text(PAUSING)
    words = ["controller=pausing", "tuner=random", "objective=time", "world=empty", "start_jitter_m=0.1", "episodes=2"]
    record = run_tuning(compose_tuning([*words, "budget=30"], str(folder / "conf"))[0])
    costs = {(pause, evaluation) for (pause,), evaluation in zip(record.values, record.evaluations, strict=True)}
    assert len(costs) == len({pause for pause, _ in costs}) == len({evaluation.cost for _, evaluation in costs}) == 6


def test_the_best_is_run_again_in_pybullet_and_over_fresh_episodes(folder: Path, navbench: Command) -> None:
    done = navbench("tune", *WORDS[:-1], *JITTER, "budget=30", "workers=1", "hydra.run.dir=done")
    assert done.code == 0, done.err
    checks = Results(folder / "done").checks()
    assert checks[["kind", "simulator", "first_episode", "episodes"]].to_numpy().tolist() == [
        ["searched", "planar", 0, 2],
        ["verified", "pybullet", 0, 2],
        ["fresh", "planar", 2, 2],
        ["fresh", "pybullet", 2, 2],
    ]
    assert checks["cost"].iloc[0] == Results(folder / "done").evaluations()["cost"].min()
    (folder / "done/conf/controller/ga_steer.yaml").rename(folder / "conf/controller/ga_steer.yaml")
    for i, simulator in ((2, "planar"), (3, "pybullet")):
        words = ["controller=ga_steer", "world=aside", *JITTER, "episodes=4", f"simulator={simulator}"]
        again = navbench(*words, f"hydra.run.dir={simulator}")
        assert again.code == 0, again.err
        rows = Results(folder / simulator).episodes().iloc[2:]
        assert set(rows["outcome"]) == {"reached"}
        assert checks["cost"].iloc[i] == pytest.approx(rows["time_s"].mean(), abs=1e-12)
    for kind in ("searched (planar)", "verified (pybullet)", "fresh (planar)", "fresh (pybullet)"):
        assert f"  {kind} " in done.out


def test_a_tuning_is_verified_in_the_same_further_worlds_and_with_the_same_words(folder: Path) -> None:
    words = [*WORDS, *JITTER, "worlds=[empty]", "world.time_limit_s=9.0", "sensors=ring16", "seed=4"]
    tuning, _, _ = compose_tuning(words, str(folder / "conf"))
    for cell, other in zip(tuning.cells, tuning.verified_in, strict=True):
        assert (cell.names.simulator, other.names.simulator) == ("planar", "pybullet")
        assert cell.names._replace(simulator="pybullet") == other.names
        assert (cell.world, cell.sensors, cell.jitter) == (other.world, other.sensors, other.jitter)
        assert (cell.seed, cell.episodes) == (other.seed, other.episodes) == (4, 2)
    composed = compose_tuning([*words, "simulator=pybullet"], str(folder / "conf"))[0].cells
    assert [cell.key() for cell in tuning.verified_in] == [cell.key() for cell in composed]
    assert [cell.world.time_limit_s for cell in tuning.verified_in] == [9.0, 60.0]


@pytest.mark.parametrize("words", [["verify=null"], ["simulator=pybullet"], ["verify=planar"]])
def test_nothing_is_verified_where_that_is_not_asked_for(words: list[str], folder: Path) -> None:
    assert compose_tuning([*WORDS, *words], str(folder / "conf"))[0].verified_in == ()


def test_another_simulator_to_verify_in_makes_another_tuning(folder: Path) -> None:
    unverified, verified = (compose_tuning([*WORDS, *more], str(folder / "conf"))[0] for more in (["verify=null"], []))
    assert unverified.key().tuning_id != verified.key().tuning_id
    targets = [cell["simulator"]["_target_"] for cell in verified.key().configuration["cells"]]
    assert [target.rpartition(".")[2] for target in targets] == ["PlanarSimulator", "BulletSimulator"]


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("verify=none", "verify=none: unknown choice; allowed: planar, pybullet, or null for none"),
        ("verify=3", "verify=3: must be one name; `navbench list simulator` prints them, or null for none"),
    ],
)
def test_an_unknown_simulator_to_verify_in_is_refused_in_one_line(
    word: str, said: str, folder: Path, navbench: Command
) -> None:
    done = navbench("tune", *WORDS, word, "hydra.run.dir=done")
    assert (done.code, done.err) == (2, f"navbench: {said}\n")
    assert not (folder / "done").exists()


def test_without_pybullet_a_tuning_ends_and_says_that_it_is_not_verified(folder: Path) -> None:
    code = "import sys\nsys.modules['pybullet'] = None\nfrom navbench.cli.main import main\nmain()\n"
    words = ["tune", *WORDS[:-1], "budget=30", "workers=1", "hydra.run.dir=done", "--config-dir", "conf"]
    done = subprocess.run([sys.executable, "-c", code, *words], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "navbench: verify=pybullet: skipped; simulator._target_=" in done.stderr
    assert "needs PyBullet" in done.stderr
    assert Results(folder / "done").checks()["simulator"].tolist() == ["planar", "planar"]


PAUSING = """# Pauses, for the tests of tunings
build: {_target_: toy_steering.Pausing, pause: 3, speed_mps: 0.2}
tunable:
  pause: {low: 1, high: 6, scale: linear}
"""


@pytest.mark.parametrize("tuner", ["pso", "ga", "de", "random"])
def test_what_a_controller_has_as_a_whole_number_is_searched_as_one(tuner: str, folder: Path) -> None:
    (folder / "conf/controller/pausing.yaml").write_text(PAUSING)
    words = ["controller=pausing", f"tuner={tuner}", "objective=time", "world=empty", "world.time_limit_s=2.0"]
    tuning, _, _ = compose_tuning([*words, "budget=60"], str(folder / "conf"))
    columns = run_tuning(tuning).columns()
    assert {type(value) for value in columns["pause"]} == {int}
    assert set(columns["pause"]) <= set(range(1, 7))
    assert 1 in columns["pause"]


def test_the_file_of_a_tuned_controller_has_a_whole_number_as_one(folder: Path, navbench: Command) -> None:
    (folder / "conf/controller/pausing.yaml").write_text(PAUSING)
    words = ["controller=pausing", "tuner=random", "objective=time", "world=empty", "world.time_limit_s=2.0"]
    done = navbench("tune", *words, "budget=30", "workers=1", "hydra.run.dir=done", "verify=null")
    assert done.code == 0, done.err
    content = yaml.safe_load((folder / "done/conf/controller/random_pausing.yaml").read_text())
    assert content["build"] == {"pause": 1}
    assert type(content["build"]["pause"]) is int


@pytest.mark.parametrize(
    ("there", "wrong", "message"),
    [
        ("low: 1,", "low: 0.5,", "controller.tunable.pause.low=0.5: must be a whole number, or integer: false"),
        ("linear}", "linear, integer: 1}", "controller.tunable.pause.integer=1: must be true or false"),
        ("pause: 3", "pause: 7", "controller.build.pause=7: must be a whole number between 1 and 6"),
        ("  pause: {", "  speed_mps: {", "controller.build.speed_mps=0.2: must be a whole number between 1 and 6"),
    ],
)
def test_wrong_bounds_of_a_whole_number_are_refused(there: str, wrong: str, message: str, folder: Path) -> None:
    text = PAUSING.replace(there, wrong).replace("linear}", "linear, integer: true}")
    (folder / "conf/controller/pausing.yaml").write_text(text)
    with pytest.raises(DescriptionError) as refused:
        compose_tuning(["controller=pausing", "tuner=random"], str(folder / "conf"))
    assert str(refused.value).startswith(message)


def test_integer_false_searches_all_numbers_and_integer_true_whole_ones(folder: Path) -> None:
    more = "  speed_mps: {low: 0.0, high: 1.0, scale: linear, integer: true}\n"
    text = PAUSING.replace("linear}", "linear, integer: false}").replace("speed_mps: 0.2", "speed_mps: 1.0") + more
    (folder / "conf/controller/pausing.yaml").write_text(text)
    tuning, _, _ = compose_tuning(["controller=pausing", "tuner=random"], str(folder / "conf"))
    assert [side.parameter(side.value_at(0.3)) for side in tuning.dimensions] == [2.5, 0]


def test_a_swarm_tunes_choices_too(folder: Path) -> None:
    words = [word for word in WORDS if not word.startswith(("tuner", "budget"))]
    tuning, _, _ = compose_tuning([*words, "tuner=pso", "budget=60"], str(folder / "conf"))
    columns = run_tuning(tuning).columns()
    assert set(columns["rules.turn.left"]) == {"hard_right", "right", "none", "left", "hard_left"}
    assert all(low <= high for low, high in zip(columns["gains.far.least"], columns["gains.far.most"], strict=True))
    assert min(columns["cost"]) < 20.0


def test_the_first_evaluation_of_the_genetic_algorithm_is_the_controller_as_it_stands(folder: Path) -> None:
    tuning, _, _ = compose_tuning([*WORDS[:-1], "budget=30"], str(folder / "conf"))
    record = run_tuning(tuning)
    build = tuning.cells[0].configuration["controller"]["build"]
    assert (
        tuning.cells[0]
        .with_parameters(tuning.parameters(record.values[0].tolist()))
        .configuration["controller"]["build"]
        == build
    )
    with tuning.cells[0].runner() as runner:
        (episode,) = runner.run(0)
    assert record.evaluations[0].cost == tuning.objective.cost(episode)


def test_the_cost_of_several_worlds_is_the_mean_over_all_their_robots(folder: Path) -> None:
    far = WORLD.replace("y_m: 0.5}", "y_m: -1.5}").replace(
        "starts: [", "starts: [{x_m: 1.0, y_m: 1.0, heading_rad: 0.0}, "
    )
    (folder / "conf/world/far.yaml").write_text(far.replace("goals: [", "goals: [{x_m: 1.9, y_m: 1.0}, "))
    words = [*(word for word in WORDS[:-1] if word != "world=aside"), "budget=30"]
    both, aside, apart = (
        [e.cost for e in run_tuning(compose_tuning([*words, *more], str(folder / "conf"))[0]).evaluations]
        for more in (["world=aside", "worlds=[far]"], ["world=aside"], ["world=far"])
    )
    assert both == pytest.approx((np.array(aside) + 2.0 * np.array(apart)) / 3.0)


def test_a_further_world_is_run_with_the_same_words(folder: Path) -> None:
    words = [*WORDS, "worlds=[empty]", "controller.build.gains.speed_mps=0.2", "sensors=ring16"]
    words += ["sensors.noise_std_m=0.01", "simulator.drive=limited", "robot.radius_m=0.07", "episodes=2", "seed=4"]
    first, second = compose_tuning(words, str(folder / "conf"))[0].cells
    assert (first.names.world, second.names.world) == ("aside", "empty")
    assert second.names.controller == "steer"
    assert (second.sensors, second.options, second.robot) == (first.sensors, first.options, first.robot)
    assert (second.sensors.noise_std_m, second.options.drive, second.robot.radius_m) == (0.01, "limited", 0.07)
    assert second.configuration["controller"]["build"]["gains"]["speed_mps"] == 0.2
    assert (second.episodes, second.seed) == (2, 4)


def test_the_file_of_a_tuned_controller_holds_what_the_words_set_and_tells_them(
    folder: Path, navbench: Command
) -> None:
    given = ["controller.build.rules.turn.left=left", "simulator.drive=limited"]
    words = [*WORDS[:-1], *given, "budget=30", "name=mine", "workers=1", "hydra.run.dir=done"]
    done = navbench("tune", *words, "controller.tunable={}", "~controller.tunable.rules", "~controller.repair")
    assert done.code == 0, done.err
    beside = "copy it beside conf/controller/steer.yaml, and use it with --config-dir conf controller=mine"
    assert beside in done.out
    content = yaml.safe_load((folder / "done/conf/controller/mine.yaml").read_text())
    assert content["build"]["rules"] == {"turn": {"left": "left"}}
    assert set(content["sources"]) == {"build.gains", "build.rules.turn.left"}
    told = content["sources"]["build.gains"]["tuned"]
    assert told.startswith(
        f"navbench tune controller=steer tuner=ga objective=time simulator=planar {' '.join(given)} "
    )
    assert "hydra" not in told

    (folder / "done/conf/controller/mine.yaml").rename(folder / "conf/controller/mine.yaml")
    again = navbench("controller=mine", "world=aside", "simulator.drive=limited", "hydra.run.dir=again")
    assert again.code == 0, again.err
    (row,) = Results(folder / "again").episodes().to_dict("records")
    assert (row["outcome"], row["time_s"]) == ("reached", Results(folder / "done").evaluations()["cost"].min())


def test_the_file_of_a_tuned_controller_does_not_tell_where_the_tuning_ran(tmp_path: Path) -> None:
    words = ["controller=pid", "tuner=pso", "world=corner", "seed=1"]
    tuning, _, _ = compose_tuning(words)
    engine = ["engine=dask", "engine.address=tcp://head:8786", "workers=4"]
    here, there = [write_controller(tuning, {}, tmp_path, given).read_text() for given in (words, [*words, *engine])]
    assert here == there


def test_a_repair_that_fails_under_way_is_named_and_nothing_is_left(folder: Path, navbench: Command) -> None:
    late = "\n\nclass Late(Ordered):\n    calls = 0\n\n    def __call__(self, values):\n        self.calls += 1\n"
    late += "        return {} if self.calls > 40 else super().__call__(values)\n"
    (folder / "toy_steering.py").write_text(MODULE + late)
    before = sorted(folder.rglob("*.*"))
    done = navbench("tune", *WORDS, "controller.repair._target_=toy_steering.Late", "workers=1")
    assert done.code == 2
    assert done.err.splitlines()[-1].startswith("navbench: controller.repair: must return a value for each of the 6")
    assert [file for file in sorted(folder.rglob("*.*")) if file.suffix != ".pyc"] == before
    assert not (folder / "outputs").exists()


STUDY = """# @package _global_
# steering: a study of choices, for the tests of tunings
title: "steering: a study of choices"
tunings:
  - {name: evolved, overrides: [controller=steer, tuner=ga, objective=time, world=aside, budget=59], seeds: 2}
cells:
  - {name: after, label: evolved, tuning: evolved, overrides: [controller=steer, world=aside]}
"""


def test_a_study_runs_the_choices_that_its_tunings_made(folder: Path, navbench: Command) -> None:
    (folder / "conf/study").mkdir()
    (folder / "conf/study/steering.yaml").write_text(STUDY)
    done = navbench("study", "steering", "workers=1")
    assert done.code == 0, done.err
    results = Results(folder / "outputs/study/steering")
    rows, cells = results.evaluations(), results.manifest()["cells"]
    assert len(cells) == 2
    for cell in cells:
        mine = rows[rows["seed"] == cell["tuning_seed"]]
        best = mine.loc[mine["cost"].idxmin()]
        build = cell["configuration"]["controller"]["build"]
        assert build["rules"]["turn"] == {side: best[f"rules.turn.{side}"] for side in ("left", "ahead", "right")}
        assert build["rules"]["turn"]["left"] in ("left", "hard_left")
        assert build["gains"]["speed_mps"] == best["gains.speed_mps"]
    assert set(results.episodes()["outcome"]) == {"reached"}


def test_no_tuned_parameter_has_two_sources_and_what_was_not_tuned_keeps_its_own() -> None:
    build: dict[str, Any] = {"_target_": "a.B", "sets": {"R": {"S": 1.0, "M": 2.0}, "Phi": {"F": 0.0}}, "gain": 1.0}
    every = ["sets.R.S", "sets.R.M", "sets.Phi.F"]
    whole = source_keys(every, ["sets"], ["build.sets", "build.gain"], build)
    assert whole == ["build.sets"]
    finer = source_keys(every, ["sets"], ["build.sets.R", "build.sets.Phi.F", "build.gain"], build)
    assert finer == ["build.sets.R", "build.sets.Phi.F"]
    assert source_keys(every[:2], ["sets.R"], ["build.sets", "build.gain"], build) == ["build.sets.R"]
    assert source_keys(every, ["sets.R", "sets.Phi"], [], build) == ["build.sets.R", "build.sets.Phi"]


# ---- the objective of zhao2018


def test_a_metric_that_has_no_value_is_named() -> None:
    objective = file_of("weighted")
    objective = replace(objective, weights={"min_clearance_m": 1.0})
    record = a_record()._replace(metrics={**a_record().metrics, "min_clearance_m": math.nan})
    with pytest.raises(DescriptionError, match=r"^objective\.weights\.min_clearance_m: has no value in an episode"):
        objective.cost(record)


def file_of(name: str) -> Objective:
    values = {
        key: v for key, v in yaml.safe_load((CONF / f"objective/{name}.yaml").read_text()).items() if key != "sources"
    }
    return describe(Objective, values, "objective")


def record(outcome: Outcome, length_m: float, time_s: float, clearance_m: float) -> RobotRecord:
    metrics = metrics_of(length_m, time_s, 0, clearance_m, 1.0, 0.0, 0.0, 0, 0, 0, 2.5)
    return RobotRecord(0, outcome, "", metrics, np.zeros((1, 6)), np.empty((1, 0)), (), np.empty(0))


@pytest.mark.parametrize(
    ("outcome", "clearance_m", "cost"),
    [
        ("reached", 0.51, 165.07 + 64.28),
        ("reached", 0.5, 165.07 + 64.28 + 1000.0),  # equation 3: at d_s, too
        ("reached", 0.1, 165.07 + 64.28 + 1000.0),
        ("reached", math.inf, 165.07 + 64.28),
        ("collided", -0.01, 300.0 + 150.0 + 1000.0),
        ("timed_out", 7.0, 300.0 + 150.0 + 1000.0),
        ("controller_error", 7.0, 300.0 + 150.0 + 1000.0),
    ],
)
def test_the_cost_is_the_denominator_of_equation_4(outcome: Outcome, clearance_m: float, cost: float) -> None:
    assert file_of("zhao2018").cost(record(outcome, 165.07, 64.28, clearance_m)) == pytest.approx(cost, abs=1e-9)


def test_without_danger_and_charge_a_failure_costs_what_it_did_and_more_the_further_from_the_goal() -> None:
    assert file_of("time").cost(record("timed_out", 3.0, 60.0, 0.0)) == 60.0 + 1000.0 + 10.0 * 2.5
    assert file_of("time").cost(record("reached", 3.0, 60.0, 0.0)) == 60.0


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"failed": {"time_s": 1.0}}, "objective.failed: must name path_length_m, time_s, min_clearance_m"),
        ({"danger": {"clearance_m": -1.0, "cost": 1.0}}, "objective.danger.clearance_m=-1.0"),
        ({"danger": {"clearance_m": 1.0}}, "objective.danger.cost: missing"),
        ({"danger": {"clearance_m": 1.0, "cost": 1.0, "weight": 1.0}}, "objective.danger.weight: unknown key"),
        ({"peril": 1.0}, "objective.peril: unknown key"),
    ],
)
def test_a_wrong_objective_is_refused_in_one_line(more: dict[str, Any], message: str) -> None:
    values = yaml.safe_load((CONF / "objective/zhao2018.yaml").read_text())
    values.pop("sources")
    with pytest.raises(DescriptionError) as refused:
        describe(Objective, {**values, **more}, "objective")
    assert message in str(refused.value)
