"""Conformance: every file in conf/ composes, runs and names the source of each of its parameters."""

import functools
import pickle
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml

from navbench.cli.catalogue import GROUPS, files_of
from navbench.cli.composing import composing
from navbench.cli.configuration import cell_of, latest_sources
from navbench.contract import Command, Controller, Observation, Pose, Setup, trace_of
from navbench.episode.similarity import native_setup
from navbench.experiments.cells import Cell
from navbench.policy import CompiledController
from navbench.records import RobotRecord
from navbench.simulation.base import Simulator
from navbench.simulation.bullet import BulletSimulator
from navbench.simulation.planar import PlanarSimulator
from navbench.sources import Source
from navbench.validation import describe

CONF = Path(__file__).parents[1] / "conf"
DESCRIBED = (*GROUPS, "tuner", "objective")
FILES = [(group, name) for group in DESCRIBED for name in files_of(group, [CONF])]
CONTROLLERS = [name for name in files_of("controller", [CONF]) if name != "policy"]  # which needs a user's file
WORLDS = list(files_of("world", [CONF]))
CLAIMS = {
    path.parent.name: set(yaml.safe_load(path.read_text())) for path in sorted((CONF / "study").glob("*/claims.yaml"))
}
OUTSIDE = {"defaults", "sources"}
CellOf = Callable[[str, str], Cell]


@pytest.fixture(scope="module")
def cell() -> Iterator[CellOf]:
    """Composes a controller in a world, for 6 s."""
    with composing() as composer:

        @functools.cache
        def cell(controller: str, world: str) -> Cell:
            words = (f"controller={controller}", f"world={world}", "world.time_limit_s=6.0")
            return cell_of(composer.values("run", words))

        yield cell


def load(group: str, name: str) -> dict[str, object]:
    """One file with the parts of its own group that its defaults list draws in, without the schema."""
    own = yaml.safe_load((CONF / group / f"{name}.yaml").read_text())
    merged: dict[str, object] = {}
    for entry in own.get("defaults", []):
        key, part = next(iter(entry.items())) if isinstance(entry, dict) else ("", entry)
        part, _, place = str(part).partition("@") if not key else (str(part), "", "")
        if part != "_self_" and "/" not in f"{key}{part}" and not key.startswith("override"):
            content = load(group, part)
            for name in reversed(place.split(".") if place else []):
                content = {name: content}
            merge(merged, content)
    merge(merged, own)
    return merged


def merge(into: dict[str, object], more: dict[str, object]) -> None:
    for key, value in more.items():
        old = into.get(key)
        if isinstance(value, dict) and isinstance(old, dict):
            merge(old, value)
        else:
            into[key] = value


def leaves(value: object, path: tuple[str, ...] = ()) -> list[str]:
    if isinstance(value, dict) and value:
        return [leaf for key, inner in value.items() if key != "_target_" for leaf in leaves(inner, (*path, str(key)))]
    return [".".join(path)]


@pytest.mark.parametrize(("group", "name"), FILES)
def test_a_file_begins_with_a_line_that_says_what_it_is(group: str, name: str) -> None:
    title = files_of(group, [CONF])[name]
    assert 20 < len(title) < 120


@pytest.mark.parametrize(("group", "name"), FILES)
def test_every_parameter_carries_its_source(group: str, name: str) -> None:
    content = load(group, name)
    assert isinstance(content["sources"], dict)
    sources = latest_sources(content["sources"])
    parameters = leaves({key: value for key, value in content.items() if key not in OUTSIDE})
    for leaf in parameters:
        covering = [key for key in sources if leaf == key or leaf.startswith(f"{key}.")]
        assert len(covering) == 1, f"{leaf}: {covering or 'no source'}"
    for key, source in sources.items():
        assert any(leaf == key or leaf.startswith(f"{key}.") for leaf in parameters), f"{key}: no such parameter"
        for name in describe(Source, source, key).claims:
            study, _, claim = name.partition(".")
            assert claim in CLAIMS[study], f"{key}: {name}"
        assert set(source.get("worlds", ())) <= set(WORLDS), key


@pytest.mark.parametrize("simulator", [BulletSimulator, PlanarSimulator])
@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("controller", CONTROLLERS)
def test_every_controller_drives_in_every_world(
    cell: CellOf, controller: str, world: str, simulator: type[Simulator]
) -> None:
    chosen = replace(cell(controller, world), simulator=simulator)
    with chosen.runner() as runner:
        records = runner.run(0)
    for record in records:
        assert record.outcome != "controller_error", record.reason
        assert np.isfinite(record.states).all()
        assert np.isfinite(record.traces[:-1]).all()
        assert record.metrics["path_length_m"] > 0.0
        limit = chosen.robot.wheel_speed_max_mps
        v, w = record.states[:, 4], record.states[:, 5]
        assert (np.abs(v) + 0.5 * chosen.robot.track_m * np.abs(w)).max() <= limit * (1.0 + 1e-9)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_controller_is_deterministic_and_forgets_at_reset(cell: CellOf, controller: str) -> None:
    def run() -> RobotRecord:
        with cell(controller, "deadlock").runner() as runner:
            runner.run(3)
            return runner.run(0)[0]

    first, second = run(), run()
    assert first.metrics == second.metrics
    assert first.states.tobytes() == second.states.tobytes()
    assert first.traces.tobytes() == second.traces.tobytes()


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_controller_can_be_sent_to_another_process_before_and_after_it_acts(cell: CellOf, controller: str) -> None:
    chosen = cell(controller, "deadlock")
    setup = native_setup(chosen.robot, chosen.sensors.scaled_to(chosen.robot.radius_m), chosen.native)
    ranges = np.array([sensor.max_range_m for sensor in setup.sensors])
    look = Observation(0.0, Pose(0.0, 0.0, 0.3), (1.0, 0.5), 0.0, 0.0, ranges, False, np.empty((0, 5)))
    pickle.loads(pickle.dumps(chosen.make_controller))
    here = pickle.loads(pickle.dumps(chosen.make_controller()))
    here.reset(setup, np.random.default_rng(0))
    here.act(look)
    there = pickle.loads(pickle.dumps(here))
    assert here.act(look) == there.act(look)


class Drive(NamedTuple):
    """What one robot's controller was asked in an episode, and the bytes of what it answered."""

    make: Callable[[], Controller]
    setup: Setup
    looks: list[Observation]
    answers: list[bytes]

    def begun(self, controller: Controller | None = None) -> Any:
        """Return a controller, by default a new one, at the beginning of the episode."""
        controller = controller or self.make()
        controller.reset(self.setup, np.random.default_rng(0))
        return controller


class Watched:
    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.looks: list[Observation] = []
        self.answers: list[bytes] = []

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        self.setup = setup
        self.controller.reset(setup, rng)

    def act(self, look: Observation) -> Command:
        self.looks.append(look._replace(ranges_m=look.ranges_m.copy(), discs=look.discs.copy()))
        command = self.controller.act(look)
        self.answers.append(answer_of(command, self.controller))
        return command


def answer_of(command: Command, controller: Controller) -> bytes:
    return np.array([*command, *trace_of(controller).values()]).tobytes()


@pytest.fixture(scope="module")
def drive(cell: CellOf) -> Callable[[str, str], Drive]:
    """Drives a controller in a world through the loop; returns what the first robot's was asked and answered."""

    @functools.cache
    def drive(controller: str, world: str) -> Drive:
        chosen, made = cell(controller, world), []

        def make() -> Controller:
            made.append(Watched(chosen.make_controller()))
            return made[-1]

        with chosen.runner() as runner:
            runner.make_controller = make
            runner.run(0)
        return Drive(chosen.make_controller, made[0].setup, made[0].looks, made[0].answers)

    return drive


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_compiled_policy_drives_as_act_does_to_the_last_bit(
    drive: Callable[[str, str], Drive], controller: str
) -> None:
    driven = drive(controller, "deadlock")
    fresh = driven.begun()
    if not isinstance(fresh, CompiledController):
        pytest.skip("offers no compiled policy")
    step, state, parameters, trace = (getattr(fresh.policy, name) for name in ("step", "state", "parameters", "trace"))
    told = parameters.copy()
    for look, answer in zip(driven.looks, driven.answers, strict=True):
        speed = (look.v_mps, look.w_radps)
        command = step(state, parameters, look.ranges_m, look.discs, tuple(look.pose), look.goal, speed, trace)
        assert np.array([*command, *trace]).tobytes() == answer
    assert parameters.tobytes() == told.tobytes()


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_two_controllers_of_one_class_share_no_state(drive: Callable[[str, str], Drive], controller: str) -> None:
    driven, elsewhere = drive(controller, "deadlock"), drive(controller, "no_deadlock")
    here, other = driven.begun(), elsewhere.begun()
    for i, (look, answer) in enumerate(zip(driven.looks, driven.answers, strict=True)):
        other.act(elsewhere.looks[i % len(elsewhere.looks)])
        assert answer_of(here.act(look), here) == answer


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_controller_begins_each_episode_anew(drive: Callable[[str, str], Drive], controller: str) -> None:
    driven = drive(controller, "deadlock")
    used = driven.begun()
    for _ in range(2):
        assert [answer_of(used.act(look), used) for look in driven.looks] == driven.answers
        driven.begun(used)


def test_every_line_of_the_configuration_fits_an_editor() -> None:
    for file in CONF.rglob("*.yaml"):
        for line in file.read_text(encoding="utf-8").splitlines():
            assert len(line) <= 125 or " " not in line.partition(": ")[2], f"{file.relative_to(CONF)}: {line}"


def test_a_schema_stands_behind_every_file_of_a_description() -> None:
    for group in ("world", "robot", "sensors", "simulator"):
        for name in files_of(group, [CONF]):
            content = yaml.safe_load((CONF / group / f"{name}.yaml").read_text())
            assert f"/schema/{group}@_here_" in content["defaults"], f"{group}/{name}"
