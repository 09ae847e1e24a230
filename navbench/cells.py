"""A cell: one controller in one world on one robot, run for a number of episodes; and a batch of its episodes."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from navbench.contract import Controller
from navbench.episode import EpisodeRunner, Jitter
from navbench.record import CellKey, Names, RobotRecord
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.similarity import Native
from navbench.simulation import SimulatorOptions
from navbench.world import World

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
        options: the simulator's options.
        jitter: of the starts.
        episodes: how many episodes, from index 0.
        seed: of every stream.
    """

    names: Names
    configuration: Mapping[str, Any]
    sources: Mapping[str, Any]
    make_controller: Callable[[], Controller]
    native: Native | None
    world: World
    robot: Robot
    sensors: Sensors
    options: SimulatorOptions
    jitter: Jitter
    episodes: int
    seed: int

    def key(self) -> CellKey:
        """Return what results know of this cell."""
        config_hash = _digest([self.names, self.configuration])
        run_id = _digest([config_hash, self.seed])
        return CellKey(self.names, self.configuration, self.sources, config_hash, run_id, self.seed, self.episodes)

    def batches(self) -> list["Batch"]:
        """Return the cell's episodes in batches of fixed size."""
        firsts = range(0, self.episodes, BATCH_EPISODES)
        return [Batch(self, range(first, min(first + BATCH_EPISODES, self.episodes))) for first in firsts]

    def runner(self) -> EpisodeRunner:
        """Return what runs this cell's episodes in this process."""
        return EpisodeRunner(
            self.make_controller,
            self.native,
            self.world,
            self.robot,
            self.sensors,
            self.options,
            self.seed,
            self.jitter,
        )


class Batch(NamedTuple):
    """Some episodes of a cell, run together in one process."""

    cell: Cell
    episodes: range


def run_batch(batch: Batch) -> list[tuple[int, RobotRecord]]:
    """Run a batch and return (episode, record) pairs, by episode and robot."""
    with batch.cell.runner() as runner:
        return [(episode, record) for episode in batch.episodes for record in runner.run(episode)]


def _digest(value: Any) -> str:
    """Return sixteen digits of the SHA-256 of a value's JSON."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, allow_nan=False).encode()).hexdigest()[:16]
