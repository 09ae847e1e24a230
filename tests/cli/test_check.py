"""``navbench check``: what breaks the contract fails, what a user should know is noted, and the rest is ok."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from commands import Command, Done

from navbench.experiments.crew import end_workers

HEAD = """
import math
import os
import random

import numpy as np

from navbench.contract import AnyRing, Command
from navbench.policy import CompiledController, Policy, compiled


def error(o):
    bearing = math.atan2(o.goal[1] - o.pose[1], o.goal[0] - o.pose[0])
    return math.remainder(bearing - o.pose[2], math.tau)


class Good:
    def reset(self, setup, rng):
        self.rng = rng

    def act(self, o):
        return Command(0.1, self.turn(o))

    def turn(self, o):
        return 2.0 * error(o)


"""
MINE = {
    "good": "class Mine(Good):\n    pass\n",
    "chance": "class Mine(Good):\n    def turn(self, o): return error(o) + 0.1 * self.rng.normal()\n",
    "random": "class Mine(Good):\n    def turn(self, o): return error(o) + random.uniform(-0.1, 0.1)\n",
    "numpy": "class Mine(Good):\n    def turn(self, o): return error(o) + 0.1 * np.random.normal()\n",
    "process": "class Mine(Good):\n    def turn(self, o): return error(o) + 1e-6 * os.getpid()\n",
    "remembers": "class Mine(Good):\n    acts = 0\n    def turn(self, o):\n        Mine.acts += 1\n"
    "        return error(o) + 1e-3 * Mine.acts\n",
    "changes": "class Mine(Good):\n    def turn(self, o):\n        o.ranges_m[0] = 0.0\n        return error(o)\n",
    "exits": "class Mine(Good):\n    def turn(self, o): os._exit(0)\n",
    "nan": "class Mine(Good):\n    def turn(self, o): return math.nan\n",
    "fast": "class Mine(Good):\n    def turn(self, o): return 100.0 * error(o)\n",
    "right": "class Mine(Good):\n    def turn(self, o): return 2.0 * error(o) - 0.5\n",
    "counts": "class Mine(Good):\n    def reset(self, setup, rng): self.n = 0\n    def turn(self, o):\n"
    "        self.n += 1\n        return 2.0 * error(o) if self.n > 120 else 1.5\n",
    "sees": "class Mine(Good):\n    def turn(self, o): return error(o) + 0.0 * o.ranges_m[3]\n",
    "few": "class Mine(Good):\n    sensor_kind = AnyRing(rays=4, fov_deg=90)\n"
    "    def turn(self, o): return error(o) + 0.0 * o.ranges_m[7]\n",
    "kind": "class Mine(Good):\n    sensor_kind = AnyRing(rays=4, fov_deg=90)\n"
    "    def turn(self, o): return error(o) + 0.0 * o.ranges_m[3]\n",
    "compiled": """
@compiled
def step(state, parameters, ranges_m, discs, pose, goal, speed, trace):
    trace[0] = math.atan2(goal[1] - pose[1], goal[0] - pose[0]) - pose[2]
    return 0.1, 2.0 * math.atan2(math.sin(trace[0]), math.cos(trace[0]))


class Mine(CompiledController):
    def make_policy(self, setup):
        return Policy(step=step, trace_names=("error",))

    def act(self, o):
        v, w = super().act(o)
        return Command(v, w * FACTOR)
""",
}
WORDS = ("check", "--config-dir", "conf", "controller=mine", "world=empty")
NAMES = ["commands", "limits", "repeats", "sensors", "mirrored", "period", "speed"]


@pytest.fixture(autouse=True)
def no_process_remembers_another_mine() -> Iterator[None]:
    yield
    end_workers()


def found(folder: Path, command: Command, kind: str, *words: str, factor: float = 1.0) -> tuple[Done, dict[str, str]]:
    (folder / "conf/controller").mkdir(parents=True, exist_ok=True)
    (folder / "conf/controller/mine.yaml").write_text("# Mine\nbuild: {_target_: mine.Mine}\n")
    (folder / "mine.py").write_text(HEAD + MINE[kind].replace("FACTOR", str(factor)))
    done = command(*WORDS, *words)
    lines = re.findall(r"^(ok|note|FAIL) +(\w+) +(.*)$", done.out, re.M)
    return done, {name: f"{verdict} {said}" for verdict, name, said in lines}


def test_a_controller_that_keeps_the_contract_is_ok_in_every_line(tmp_path: Path, command: Command) -> None:
    done, lines = found(tmp_path, command, "good")
    assert done.code == 0, done.out + done.err
    assert list(lines) == NAMES
    assert all(line.startswith("ok ") for line in lines.values()), done.out
    assert lines["commands"].endswith("3 of 3 robots reached their goal")
    assert lines["sensors"] == "ok states none, and drives without range sensors"
    assert re.search(r"us per act: Python", lines["speed"])
    assert done.out.splitlines()[-1] == "mine in empty: 7 ok"


@pytest.mark.parametrize("kind", ["chance", "random", "numpy"])
def test_its_own_stream_and_the_global_generators_repeat(tmp_path: Path, command: Command, kind: str) -> None:
    done, lines = found(tmp_path, command, kind)
    assert done.code == 0
    assert lines["repeats"].startswith("ok ")


@pytest.mark.parametrize(
    ("kind", "check", "said"),
    [
        ("process", "repeats", r"FAIL differs in another process: episode 0, robot 0, at 0\.00 s: w_radps is "),
        ("remembers", "repeats", r"FAIL differs run again, in another order"),
        ("changes", "commands", r"FAIL episode 0, robot 0: ValueError: assignment destination is read-only \(mine\.py"),
        ("nan", "commands", r"FAIL episode 0, robot 0: act must return Command\(v_mps, w_radps\), two finite numbers"),
        (
            "few",
            "sensors",
            r"FAIL takes any ring of at least 4 rays over 90 degrees, but with 4 over 90 degrees: Index",
        ),
    ],
)
def test_what_breaks_the_contract_fails_and_is_named(
    kind: str, check: str, said: str, tmp_path: Path, command: Command
) -> None:
    done, lines = found(tmp_path, command, kind)
    assert done.code == 3
    assert re.match(said, lines[check]), lines
    assert [name for name, line in lines.items() if line.startswith("FAIL")] == [check]


def test_a_controller_that_ends_its_process_fails_and_the_check_goes_on(tmp_path: Path, command: Command) -> None:
    done, lines = found(tmp_path, command, "exits")
    assert done.code == 3
    assert lines["commands"].startswith("FAIL episode 0, robot 0: SystemExit: os._exit(0) (mine.py")
    assert lines["repeats"] == "FAIL differs in another process: its process ended with exit code 0"
    assert list(lines) == NAMES


@pytest.mark.parametrize(
    ("kind", "check", "said"),
    [
        ("fast", "limits", r"note asks for more than the wheels can in [\d.]+ % of the periods"),
        ("right", "mirrored", r"note from \d+\.\d\d s on it leaves the mirrored path, by up to 0\.\d+ m"),
        ("counts", "period", r"note half the control period changes its time by [\d.]+ %, its path by [\d.]+ %"),
        ("sees", "sensors", r"note states none, but without range sensors: IndexError: .*sensor_roles or sensor_kind"),
        ("kind", "sensors", r"ok drives with any ring of at least 4 rays over 90 degrees"),
    ],
)
def test_what_a_user_may_want_is_noted_and_does_not_fail(
    kind: str, check: str, said: str, tmp_path: Path, command: Command
) -> None:
    done, lines = found(tmp_path, command, kind)
    assert done.code == 0, done.out
    assert re.match(said, lines[check]), lines


@pytest.mark.parametrize(("factor", "code", "verdict"), [(1.0, 0, "ok"), (1.0000001, 3, "FAIL")])
def test_act_and_the_compiled_policy_must_answer_the_same_to_the_last_bit(
    factor: float, code: int, verdict: str, tmp_path: Path, command: Command
) -> None:
    done, lines = found(tmp_path, command, "compiled", factor=factor)
    assert done.code == code
    assert lines["compiled"].startswith(f"{verdict} act ")
    assert lines["speed"].startswith("ok compiled: ")


def test_a_ring_that_is_not_the_same_on_both_sides_is_not_mirrored(tmp_path: Path, command: Command) -> None:
    ring = "sensors.ring={count: 5, fov_deg: 90, radius_m: 1.0, heading_deg: 20.0}"
    _, lines = found(tmp_path, command, "good", "sensors=disc_tracker", ring)
    assert lines["mirrored"] == "note not compared: the range sensors are not the same to the left and right"


def test_a_world_that_is_never_reached_is_noted(tmp_path: Path, command: Command) -> None:
    done, lines = found(tmp_path, command, "good", "world.time_limit_s=1.0", "episodes=2", "simulator=pybullet")
    assert done.code == 0
    assert lines["commands"] == "note 40 commands are finite; 0 of 2 robots reached their goal"
    assert lines["period"] == "note not compared: it does not reach its goal"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "check: name a controller, as controller=NAME"),
        (("mine",), "check mine: name a controller, as controller=NAME"),
        (("controller=sfcl",), "controller=sfcl: unknown choice; did you mean sflc?"),
        (("controller=sflc", "sensors=ring16"), "sensors=ring16: sflc needs the range sensors rear_left, "),
        (("controller=sflc", "-m"), "-m: unknown flag"),
    ],
)
def test_wrong_words_are_refused_in_one_line(words: tuple[str, ...], message: str, command: Command) -> None:
    done = command("check", *words)
    assert done.code == 2
    assert done.err.startswith(f"navbench: {message}")
    assert done.err.count("\n") == 1


SHUT = """# A start in a closed room
defaults: [/schema/world@_here_, _self_, override /robot@_global_.robot: khepera3]
bounds: {x_min_m: -3.0, x_max_m: 3.0, y_min_m: -3.0, y_max_m: 3.0}
starts: [{x_m: 0.0, y_m: 0.0}]
goals: [{x_m: 2.5, y_m: 0.0}]
walls:
  - {x1_m: -1.0, y1_m: -1.0, x2_m: 1.0, y2_m: -1.0}
  - {x1_m: 1.0, y1_m: -1.0, x2_m: 1.0, y2_m: 1.0}
  - {x1_m: 1.0, y1_m: 1.0, x2_m: -1.0, y2_m: 1.0}
  - {x1_m: -1.0, y1_m: 1.0, x2_m: -1.0, y2_m: -1.0}
goal_tolerance_m: 0.05
time_limit_s: 30.0
"""
SAYS = "1 of 1 impossible; episode 0: goals[0]: nothing leads there from starts[0] for a robot of radius 0.065 m"


def test_a_world_is_checked_for_impossible_tasks_and_so_is_its_picture(tmp_path: Path, command: Command) -> None:
    (tmp_path / "conf/world").mkdir(parents=True)
    (tmp_path / "conf/world/shut.yaml").write_text(SHUT)
    own = "world=shut", "--config-dir", str(tmp_path / "conf")
    checked = command("check", *own)
    assert (checked.code, checked.out) == (3, f"FAIL  tasks     {SAYS}\n")
    assert SAYS in command("show", *own, f"out={tmp_path / 'shut.png'}").out


def test_a_world_whose_tasks_can_be_done_is_ok(command: Command) -> None:
    checked = command("check", "world=random_discs", "episodes=3")
    assert (checked.code, checked.out) == (0, "ok    tasks     a robot of radius 4 m can do all of 3\n")
