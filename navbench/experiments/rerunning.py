"""Episodes run again and watched: what a controller was asked and answered, and where two runs of it first differ."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from navbench.contract import Command, Controller, Observation, Setup, trace_of
from navbench.episode.failures import velocities
from navbench.experiments.cells import Cell, Records
from navbench.records import RobotRecord

STATE_NAMES = ("t_s", "x_m", "y_m", "heading_rad", "v_mps", "w_radps")


@dataclass(slots=True)
class Acts:
    """What was seen of a controller's acts in some episodes.

    Attributes:
        setup: the latest episode's.
        commands: what it answered, as the loop reads it: v [m/s], w [rad/s], native.
        times_s: how long each act took [s].
    """

    setup: Setup | None = None
    commands: list[tuple[float, float]] = field(default_factory=list)
    times_s: list[float] = field(default_factory=list)


class _Watched:
    """A controller, and what is seen of it; the loop takes it for one in Python."""

    def __init__(self, controller: Controller, acts: Acts) -> None:
        self.controller, self.acts = controller, acts

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        self.acts.setup = setup
        self.controller.reset(setup, rng)

    def act(self, look: Observation) -> Command:
        begin = time.perf_counter()
        command = self.controller.act(look)
        self.acts.times_s.append(time.perf_counter() - begin)
        self.acts.commands.append(velocities(command))
        return command

    @property
    def trace(self) -> Mapping[str, float]:
        return trace_of(self.controller)


def drive(cell: Cell, *, back: bool = False) -> Records:
    """Run a cell's episodes, forwards or back."""
    with cell.runner() as runner:
        episodes = reversed(cell.indices) if back else cell.indices
        records = [(episode, record) for episode in episodes for record in runner.run(episode)]
    return sorted(records, key=lambda pair: (pair[0], pair[1].robot_index))


def watch(cell: Cell) -> tuple[Records, Acts]:
    """Run a cell's episodes, step by step, and watch its controllers."""
    acts = Acts()
    with cell.runner() as runner:
        runner.make_controller = lambda: _Watched(cell.make_controller(), acts)
        return [(episode, record) for episode in cell.indices for record in runner.run(episode)], acts


def difference(first: Records, second: Records) -> str:
    """Return where two runs of the same episodes first differ, or nothing."""
    for (episode, one), (_, other) in zip(first, second, strict=True):
        where = f"episode {episode}, robot {one.robot_index}"
        names = (*STATE_NAMES, *(f"trace {name}" for name in one.trace_names))
        if one.trace_names != other.trace_names:
            return f"{where}: the trace has other names"
        rows, others = (np.hstack((record.states, record.traces)) for record in (one, other))
        count = min(len(rows), len(others))
        differs = ~((rows[:count] == others[:count]) | (np.isnan(rows[:count]) & np.isnan(others[:count])))
        if differs.any():
            row = int(np.argmax(differs.any(axis=1)))
            column = int(np.argmax(np.where(differs[row], np.abs(rows[row] - others[row]), -1.0)))
            values = f"{rows[row, column].item()!r} and {others[row, column].item()!r}"
            return f"{where}, at {rows[row, 0]:.2f} s: {names[column]} is {values}"
        if len(rows) != len(others) or one.outcome != other.outcome:
            return f"{where}: {ended(one)}, and {ended(other)}"
    return ""


def ended(record: RobotRecord) -> str:
    """Return how an episode ended for a robot, and when."""
    return f"{record.outcome} after {record.states[-1, 0]:.2f} s" if len(record.states) else record.outcome
