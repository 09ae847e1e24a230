"""What is kept of an episode and of the cell it belongs to: the words that the loop, the store and the reader share."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.metrics import DECLARED, Metric
from navbench.world.layout import Layout

FloatArray = NDArray[np.float64]
Outcome = Literal["reached", "collided", "timed_out", "controller_error", "no_layout", "impossible"]
NOT_DRIVEN = {  # outcomes of episodes in which no controller had a part, and what is said of some
    "no_layout": "layouts could not be drawn",
    "impossible": "tasks are impossible",
}


NO_RANGES: FloatArray = np.empty((0, 0))


@dataclass(frozen=True, slots=True, order=True)
class Thing:
    """Something that a robot can touch: of what kind, and which one of these in its world."""

    kind: Literal["box", "cell", "disc", "mover", "polygon", "robot", "wall"]
    index: int

    def __str__(self) -> str:
        """Return what people call it, such as "disc 0"."""
        return f"{self.kind} {self.index}"


class RobotRecord(NamedTuple):
    """What one robot did in one episode.

    Attributes:
        robot_index: which robot of the world.
        outcome: "reached", "collided", "timed_out", "controller_error"; "no_layout" where none could be drawn, or
            "impossible" where one was in which the task cannot be done.
        reason: what it hit, or what the controller did; empty where the outcome says all.
        metrics: each metric's value by its name.
        states: (n + 1, 6) t [s], x, y [m], heading [rad], v [m/s], w [rad/s] of the world at the beginning of each of
            the n control periods, v and w being the period's means, and at the end, where v and w stand as they were.
        traces: (n + 1, n_names) the controller's trace, native; nan at the end, where it acted no more.
        trace_names: its names.
        latencies_s: (n,) the time of each act on the machine's clock [s].
        hit: what a robot that collided hit.
        layout: what was driven in; None where nothing was driven.
        traceback: of what a controller raised; empty where it raised nothing.
        ranges_m: (n, n_sensors) what the range sensors read in each control period [m], or ``NO_RANGES``, not kept.
    """

    robot_index: int
    outcome: Outcome
    reason: str
    metrics: Mapping[str, float]
    states: FloatArray
    traces: FloatArray
    trace_names: tuple[str, ...]
    latencies_s: FloatArray
    hit: Thing | None = None
    layout: Layout | None = None
    traceback: str = ""
    ranges_m: FloatArray = NO_RANGES

    @classmethod
    def lost(
        cls, robot_index: int, outcome: Outcome, reason: str, metrics: Iterable[Metric], traceback: str = ""
    ) -> "RobotRecord":
        """Return what is known of a robot of which nothing was recorded."""
        values, none = {metric.name: metric.lost for metric in metrics}, np.empty((0, 0))
        return cls(robot_index, outcome, reason, values, np.empty((0, 6)), none, (), np.empty(0), traceback=traceback)


class Names(NamedTuple):
    """What a cell's parts are called in the configuration."""

    controller: str
    world: str
    robot: str
    sensors: str
    simulator: str


class CellKey(NamedTuple):
    """What results know of a cell.

    Attributes:
        name: what it is there for, such as "printed" or "fair"; the cells of a comparison share it.
        label: what tables and reports call its controller.
        names: what its parts are called.
        configuration: its resolved configuration, of plain values.
        sources: where each part's parameters come from.
        config_hash: digits over names and configuration: everything that decides an episode but seed and index.
        run_id: digits over config_hash and seed; two runs of the same cell share it.
        seed: of every stream.
        episodes: how many.
        first_episode: the index of the first one.
        tuning: the name of the tuning that its parameters come from, or empty.
        tuning_seed: that tuning's seed; -1 without one.
        packages: what the simulator runs on, whose versions belong to the results.
        loop: what closes its loop, "compiled" code or "python".
        metrics: what its metrics are.
    """

    name: str
    label: str
    names: Names
    configuration: Mapping[str, Any]
    sources: Mapping[str, Any]
    config_hash: str
    run_id: str
    seed: int
    episodes: int
    first_episode: int = 0
    tuning: str = ""
    tuning_seed: int = -1
    packages: tuple[str, ...] = ()
    loop: str = "python"
    metrics: tuple[Metric, ...] = DECLARED


class TuningKey(NamedTuple):
    """What results know of a tuning.

    Attributes:
        name: what it is called; a study's tunings of one name differ in their seeds.
        tuner: the tuner's configuration name.
        objective: the objective's configuration name.
        controller: whose parameters it searches.
        worlds: where it tries them.
        config_hash: digits over everything that decides an evaluation but seed, budget and index.
        tuning_id: digits over config_hash, budget and seed.
        seed: of the tuner and of the evaluations.
        budget: how many evaluations.
        configuration: as resolved, of plain values.
        sources: where the tuner's and the objective's parameters come from.
    """

    name: str
    tuner: str
    objective: str
    controller: str
    worlds: tuple[str, ...]
    config_hash: str
    tuning_id: str
    seed: int
    budget: int
    configuration: Mapping[str, Any]
    sources: Mapping[str, Any]
