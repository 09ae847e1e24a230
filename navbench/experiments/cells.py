"""A cell: one controller in one world on one robot, run for some episodes; and the batches in which they are run."""

import copy
import hashlib
import inspect
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import Any, NamedTuple

from navbench.contract import Controller
from navbench.episode.loop import EpisodeRunner
from navbench.episode.similarity import Native
from navbench.episode.starts import Jitter
from navbench.experiments.code import foreign_of
from navbench.experiments.engines import Work
from navbench.experiments.workers import Death, MachineError, in_worker
from navbench.metrics import METRICS, MetricFunction, declared
from navbench.policy import CompiledController
from navbench.records import CellKey, Names, RobotRecord
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.simulation.base import Simulator
from navbench.simulation.options import SimulatorOptions
from navbench.validation import HERE, DescriptionError, instead
from navbench.world.world import World

BATCH_MIN, BATCH_MAX = 5, 25  # episodes: fewer are not worth a part's cost, more are too much to lose
BATCHES = 8  # of a cell whose batches lie between these, so that several cores share even one


@dataclass(frozen=True, slots=True)
class Unnamed:
    """Makes controllers of what a program gives and no dotted name stands for.

    Attributes:
        thing: a controller, of which each robot of each episode has a copy, or a class or function that makes one.
        is_object: whether it is a controller.
    """

    thing: Any
    is_object: bool

    def __call__(self, digest: str) -> Controller:
        """Return a controller; the digest tells the thing from others in a configuration."""
        made: Controller = copy.deepcopy(self.thing) if self.is_object else self.thing()
        return made

    @property
    def kind(self) -> Any:
        """The controller's class, as far as it is known."""
        return type(self.thing) if self.is_object else self.thing


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One combination to run.

    Attributes:
        names: what its parts are called.
        configuration: its resolved configuration, of plain values: the controller's parameters and, for the manifest,
            all that stands below as well.
        sources: where each part's parameters come from.
        controller: the controller's class, or what else makes one from its parameters.
        native: what the controller was drawn for, or None.
        world: the world.
        robot: the robot.
        sensors: the sensor suite, as drawn.
        simulator: the simulator's class.
        options: its options.
        jitter: of the starts.
        episodes: how many episodes.
        seed: of every stream.
        first_episode: the index of the first one.
        name: what the cell is there for; the cells of a comparison share it.
        label: what tables and reports call its controller; empty for its configuration's name.
        keep_trajectories: whether they are kept beside the table of episodes.
        keep_ranges: whether trajectories hold what the range sensors read, too.
        tuning: the name of the tuning whose best parameters it takes; empty for none.
        tuning_seed: that tuning's seed; -1 without one.
        metrics: what is measured of each robot.
        timeout_s: CPU time that a step may take in a worker [s]; None for any.
    """

    names: Names
    configuration: Mapping[str, Any]
    sources: Mapping[str, Any]
    controller: Callable[..., Controller]
    native: Native | None
    world: World
    robot: Robot
    sensors: Sensors
    simulator: type[Simulator]
    options: SimulatorOptions
    jitter: Jitter
    episodes: int
    seed: int
    first_episode: int = 0
    name: str = "run"
    label: str = ""
    keep_trajectories: bool = True
    keep_ranges: bool = False
    tuning: str = ""
    tuning_seed: int = -1
    metrics: tuple[MetricFunction, ...] = METRICS
    timeout_s: float | None = None

    @property
    def make_controller(self) -> partial[Controller]:
        """What makes one controller object; it can be sent to another process."""
        build = self.configuration["controller"]["build"]
        return partial(self.controller, **{name: value for name, value in build.items() if name != "_target_"})

    @property
    def foreign(self) -> frozenset[str]:
        """What it runs that is not navbench's own, by name, and which controller meets that; empty for nothing."""
        users = [metric for metric in self.metrics if not metric.__module__.startswith("navbench.")]
        found = foreign_of(self.configuration) | {f"{metric.__module__}.{metric.__qualname__}" for metric in users}
        if found or isinstance(self.controller, Unnamed):
            return found | {digest(self.configuration["controller"])}
        return found

    @property
    def indices(self) -> range:
        """The indices of its episodes."""
        return range(self.first_episode, self.first_episode + self.episodes)

    @property
    def loop(self) -> str:
        """What closes the loop: "compiled" code, or "python" where the simulator or the controller needs it."""
        kind = self.controller.kind if isinstance(self.controller, Unnamed) else self.controller
        is_policy = inspect.isclass(kind) and issubclass(kind, CompiledController)
        return "compiled" if is_policy and self.simulator.is_compiled else "python"

    def key(self) -> CellKey:
        """Return what results know of this cell."""
        config_hash = digest([self.names, self.configuration])
        return CellKey(
            name=self.name,
            label=self.label or self.names.controller,
            names=self.names,
            configuration=self.configuration,
            sources=self.sources,
            config_hash=config_hash,
            run_id=digest([config_hash, self.seed]),
            seed=self.seed,
            episodes=self.episodes,
            first_episode=self.first_episode,
            tuning=self.tuning,
            tuning_seed=self.tuning_seed,
            packages=self.simulator.packages,
            loop=self.loop,
            metrics=declared(self.metrics),
        )

    def with_parameters(self, values: Mapping[str, Any]) -> "Cell":
        """Return the same cell with other parameters of its controller.

        Args:
            values: each parameter's dotted place below ``controller.build``, and its value.

        Raises:
            DescriptionError: there is no such parameter.
        """
        controller = self.configuration["controller"]
        build = _copied(controller["build"])
        for name, value in values.items():
            place, last = place_of(name, build)
            place[last] = value
        return replace(self, configuration={**self.configuration, "controller": {**controller, "build": build}})

    def runner(self) -> EpisodeRunner:
        """Return what runs this cell's episodes in this process."""
        return EpisodeRunner(
            make_controller=self.make_controller,
            make_simulator=partial(self.simulator, self.options),
            native=self.native,
            world=self.world,
            robot=self.robot,
            sensors=self.sensors,
            seed=self.seed,
            jitter=self.jitter,
            metrics=self.metrics,
            timeout_s=self.timeout_s if in_worker() else None,
            keep_ranges=self.keep_ranges,
        )


def _copied(build: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy in which the value of any parameter can be changed: of the mappings, not of what they hold."""
    return {key: _copied(value) if isinstance(value, dict) else value for key, value in build.items()}


def place_of(name: str, build: dict[str, Any]) -> tuple[dict[str, Any], str]:
    """Return the mapping that holds a controller's parameter, and the parameter's key in it.

    Args:
        name: the parameter's dotted place, such as "kp" or "behaviors.blend_alpha".
        build: the controller's ``build``.

    Raises:
        DescriptionError: there is no such parameter.
    """
    place, key = build, "controller.build"
    *path, last = name.split(".")
    for word in path:
        key, inner = f"{key}.{word}", place.get(word)
        if not isinstance(inner, dict):
            raise DescriptionError(f"{key}: there is no such parameter; {instead(word, _names(place), HERE)}")
        place = inner
    if last not in place or last == "_target_":
        raise DescriptionError(f"{key}.{last}: there is no such parameter; {instead(last, _names(place), HERE)}")
    return place, last


def leaves_below(name: str, build: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters at and below a place, by their own dotted places, and their values; arguments as above."""
    place, last = place_of(name, build)
    if not isinstance(place[last], dict):
        return {name: place[last]}
    words = [word for word in place[last] if word != "_target_"]
    return {leaf: value for word in words for leaf, value in leaves_below(f"{name}.{word}", build).items()}


def _names(place: Mapping[str, Any]) -> list[str]:
    return [name for name in place if name != "_target_"]


class Batch(NamedTuple):
    """Some episodes of a cell, run together in one process."""

    cell: Cell
    episodes: range


def batches_of(cell: Cell, episodes: Sequence[int]) -> list[Batch]:
    """Return some episodes of a cell in batches, which depend on nothing else: not on workers, not on other cells.

    Args:
        cell: the cell.
        episodes: their indices, rising.
    """
    size = min(max(BATCH_MIN, math.ceil(len(episodes) / BATCHES)), BATCH_MAX)
    batches: list[Batch] = []
    for episode in episodes:
        last = batches[-1].episodes if batches else range(0)
        if last.stop == episode and 0 < len(last) < size:
            batches[-1] = Batch(cell, range(last.start, episode + 1))
        else:
            batches.append(Batch(cell, range(episode, episode + 1)))
    return batches


Records = list[tuple[int, RobotRecord]]  # of a batch: each episode's index with the record of each of its robots


def run_batch(batch: Batch) -> Records:
    """Run a batch and return (episode, record) pairs, by episode and robot."""
    with batch.cell.runner() as runner:
        return [(episode, record) for episode in batch.episodes for record in runner.run(episode)]


def attempt_batch(batch: Batch) -> Records | DescriptionError:
    """Run a batch, or return why it cannot be run: it costs its own episodes and no others."""
    try:
        return run_batch(batch)
    except DescriptionError as error:
        return error


def _pieces(batch: Batch) -> list[Batch]:
    return [Batch(batch.cell, range(episode, episode + 1)) for episode in batch.episodes]


def _lost(batch: Batch, death: Death) -> Records | DescriptionError:
    """Return what is known of episodes whose process died: of what, unless the machine is to blame."""
    if death.by_machine:
        return MachineError(death)
    metrics, robots = declared(batch.cell.metrics), range(batch.cell.world.robots)
    lost = [RobotRecord.lost(i, "controller_error", death.reason, metrics, death.traceback) for i in robots]
    return [(episode, record) for episode in batch.episodes for record in lost]


def _join(parts: Sequence[Records | DescriptionError]) -> Records | DescriptionError:
    failed = next((part for part in parts if isinstance(part, DescriptionError)), None)
    return failed or [pair for part in parts if not isinstance(part, DescriptionError) for pair in part]


EPISODES: Work[Batch, Records | DescriptionError] = Work(
    attempt_batch, _pieces, _lost, _join, attrgetter("cell.foreign")
)


def digest(value: Any) -> str:
    """Return sixteen digits of the SHA-256 of a value's JSON."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, allow_nan=False).encode()).hexdigest()[:16]
