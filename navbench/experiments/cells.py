"""A cell: one controller in one world on one robot, run for a number of episodes; and a batch of its episodes."""

import copy
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from navbench.contract import Controller
from navbench.episode.loop import EpisodeRunner
from navbench.episode.similarity import Native
from navbench.episode.starts import Jitter
from navbench.experiments.engines import Work
from navbench.mathematics.metrics import Metrics
from navbench.records import CellKey, Names, RobotRecord
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.simulation.base import Simulator
from navbench.simulation.options import SimulatorOptions
from navbench.validation import DescriptionError
from navbench.world.world import World

BATCH_EPISODES = 25  # fixed, so that the names of the parts depend on the work alone, never on the workers


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One combination to run.

    Attributes:
        names: what its parts are called.
        configuration: its resolved configuration, of plain values, for the manifest.
        sources: where each part's parameters come from.
        make_controller: makes one controller object; it is sent to worker processes.
        native: what the controller was drawn for, or None.
        world: the world.
        robot: the robot.
        sensors: the sensor suite, as drawn.
        simulator: the simulator's class.
        options: its options.
        jitter: of the starts.
        episodes: how many episodes, from index 0.
        seed: of every stream.
        keep_trajectories: whether they are kept beside the table of episodes.
    """

    names: Names
    configuration: Mapping[str, Any]
    sources: Mapping[str, Any]
    make_controller: partial[Controller]
    native: Native | None
    world: World
    robot: Robot
    sensors: Sensors
    simulator: type[Simulator]
    options: SimulatorOptions
    jitter: Jitter
    episodes: int
    seed: int
    keep_trajectories: bool = True

    def key(self) -> CellKey:
        """Return what results know of this cell."""
        config_hash = digest([self.names, self.configuration])
        run_id = digest([config_hash, self.seed])
        return CellKey(
            self.names,
            self.configuration,
            self.sources,
            config_hash,
            run_id,
            self.seed,
            self.episodes,
            self.simulator.packages,
        )

    def with_parameters(self, values: Mapping[str, Any]) -> "Cell":
        """Return the same cell with other parameters of its controller.

        Args:
            values: each parameter's dotted place below ``controller.build``, and its value.

        Raises:
            DescriptionError: there is no such parameter.
        """
        controller = copy.deepcopy(self.configuration["controller"])
        for name, value in values.items():
            place, last = place_of(name, controller["build"])
            place[last] = value
        parameters = {name: value for name, value in controller["build"].items() if name != "_target_"}
        return replace(
            self,
            configuration={**self.configuration, "controller": controller},
            make_controller=partial(self.make_controller.func, **parameters),
        )

    def batches(self) -> list["Batch"]:
        """Return the cell's episodes in batches of fixed size."""
        firsts = range(0, self.episodes, BATCH_EPISODES)
        return [Batch(self, range(first, min(first + BATCH_EPISODES, self.episodes))) for first in firsts]

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
        )


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
            raise DescriptionError(f"{key}: there is no such parameter; allowed here: {_names(place)}")
        place = inner
    if last not in place or last == "_target_":
        raise DescriptionError(f"{key}.{last}: there is no such parameter; allowed here: {_names(place)}")
    return place, last


def leaves_below(name: str, build: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters at and below a place, by their own dotted places, and their values; arguments as above."""
    place, last = place_of(name, build)
    if not isinstance(place[last], dict):
        return {name: place[last]}
    words = [word for word in place[last] if word != "_target_"]
    return {leaf: value for word in words for leaf, value in leaves_below(f"{name}.{word}", build).items()}


def _names(place: Mapping[str, Any]) -> str:
    return ", ".join(name for name in place if name != "_target_")


class Batch(NamedTuple):
    """Some episodes of a cell, run together in one process."""

    cell: Cell
    episodes: range


def run_batch(batch: Batch) -> list[tuple[int, RobotRecord]]:
    """Run a batch and return (episode, record) pairs, by episode and robot."""
    with batch.cell.runner() as runner:
        return [(episode, record) for episode in batch.episodes for record in runner.run(episode)]


def _pieces(batch: Batch) -> list[Batch]:
    return [Batch(batch.cell, range(episode, episode + 1)) for episode in batch.episodes]


def _lost(batch: Batch) -> list[tuple[int, RobotRecord]]:
    """Return what is known of episodes whose process died: that it did."""
    metrics = Metrics(0.0, 0.0, 0, math.nan, 0.0, math.nan, 0.0, 0, 0, 0, math.nan)
    reason = "the controller's process died"
    return [
        (
            episode,
            RobotRecord(i, "controller_error", reason, metrics, np.empty((0, 6)), np.empty((0, 0)), (), np.empty(0)),
        )
        for episode in batch.episodes
        for i in range(batch.cell.world.robots)
    ]


def _join(parts: Sequence[list[tuple[int, RobotRecord]]]) -> list[tuple[int, RobotRecord]]:
    return [pair for part in parts for pair in part]


EPISODES: Work[Batch, list[tuple[int, RobotRecord]]] = Work(run_batch, _pieces, _lost, _join)


def digest(value: Any) -> str:
    """Return sixteen digits of the SHA-256 of a value's JSON."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, allow_nan=False).encode()).hexdigest()[:16]
