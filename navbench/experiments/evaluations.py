"""Evaluations of a tuning's points: whole episodes, here or in worker processes, and what they cost."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from operator import attrgetter
from typing import TYPE_CHECKING, NamedTuple

from navbench.contract import Controller, FloatArray
from navbench.episode.loop import EpisodeRunner
from navbench.experiments.engines import Engine, Work, run
from navbench.experiments.workers import Death, MachineError
from navbench.records import NOT_DRIVEN, RobotRecord

if TYPE_CHECKING:
    from navbench.experiments.tunings import Objective, Tuning


class Evaluation(NamedTuple):
    """What one point cost.

    Attributes:
        cost: the mean over all robots and episodes that had a layout; infinite without any.
        reached: how many robots reached their goals.
        robots: of how many.
    """

    cost: float
    reached: int
    robots: int


class _Part(NamedTuple):
    """Some evaluations of one generation, or one episode of one of them.

    Attributes:
        tuning: of which.
        first_index: the index of the first one.
        values: (n, D) the points.
        episode: the index of a cell and that of its one episode that is run; None for all of all cells.
    """

    tuning: "Tuning"
    first_index: int
    values: FloatArray
    episode: tuple[int, int] | None = None


class _Driven(NamedTuple):
    """What one robot's episode cost: the evaluation's index, the cost, and whether the robot reached its goal."""

    evaluation: int
    cost: float | None  # none without a layout, in which the parameters had no part
    reached: bool


@contextmanager
def evaluator(
    tuning: "Tuning", workers: int | None, engine: Engine | None = None
) -> Iterator[Callable[[int, FloatArray], list[Evaluation]]]:
    """Give a function that evaluates a generation, here or in worker processes."""
    if workers == 0:
        with _runners(tuning) as runners:
            yield lambda first, values: _evaluations(_drive(_Part(tuning, first, values), runners), first, len(values))
        return

    def evaluate(first: int, values: FloatArray) -> list[Evaluation]:
        size = max(1, math.ceil(len(values) / (1 if workers == 1 else max(4, workers or 0))))
        parts = [_Part(tuning, first + i, values[i : i + size]) for i in range(0, len(values), size)]
        done = dict(run(EVALUATIONS, parts, engine, workers))
        return _evaluations(_join([done[i] for i in range(len(parts))]), first, len(values))

    yield evaluate


@contextmanager
def _runners(tuning: "Tuning") -> Iterator[list[EpisodeRunner]]:
    with ExitStack() as stack:
        yield [stack.enter_context(cell.runner()) for cell in tuning.cells]


def _drive(part: _Part, runners: Sequence[EpisodeRunner]) -> list[_Driven]:
    """Drive some points, all over the same episodes, so that their costs differ by their parameters alone."""
    tuning = part.tuning
    driven = []
    for index, point in enumerate(part.values.tolist(), part.first_index):
        make_controller = tuning.cells[0].with_parameters(tuning.parameters(point)).make_controller
        for number, (cell, runner) in enumerate(zip(tuning.cells, runners, strict=True)):
            runner.make_controller, runner.seed = make_controller, tuning.seed
            for episode in cell.indices:
                if part.episode in (None, (number, episode)):
                    driven += [_driven(index, record, tuning.objective) for record in runner.run(episode)]
    return driven


def _driven(index: int, record: RobotRecord, objective: "Objective") -> _Driven:
    cost = objective.cost(record) if record.outcome not in NOT_DRIVEN else None
    return _Driven(index, cost, record.outcome == "reached")


def _evaluations(driven: Sequence[_Driven], first_index: int, count: int) -> list[Evaluation]:
    """Return what a generation's points cost."""
    evaluations = []
    for index in range(first_index, first_index + count):
        mine = [one for one in driven if one.evaluation == index]
        costs = [one.cost for one in mine if one.cost is not None]
        cost = math.fsum(costs) / len(costs) if costs else math.inf
        evaluations.append(Evaluation(cost, sum(one.reached for one in mine), len(costs)))
    return evaluations


def _drive_part(part: _Part) -> list[_Driven]:
    with _runners(part.tuning) as runners:
        return _drive(part, runners)


def _pieces(part: _Part) -> list[_Part]:
    """Return a part's episodes, each alone."""
    episodes = [(i, episode) for i, cell in enumerate(part.tuning.cells) for episode in cell.indices]
    return [
        _Part(part.tuning, part.first_index + k, part.values[k : k + 1], episode)
        for k in range(len(part.values))
        for episode in episodes
    ]


def _lost(part: _Part, death: Death) -> list[_Driven]:
    """Return what an episode costs whose process died: as much as one in which the controller raised at once.

    Raises:
        MachineError: it was killed from outside, and there is nothing to compare the evaluation by.
    """
    if death.by_machine:
        raise MachineError(death, f"evaluation {part.first_index} of {part.tuning.name}: ")
    number, episode = part.episode or (0, 0)
    with part.tuning.cells[number].runner() as runner:
        runner.make_controller, runner.seed = _raise, part.tuning.seed
        return [_driven(part.first_index, record, part.tuning.objective) for record in runner.run(episode)]


def _raise() -> Controller:
    raise ChildProcessError


def _join(parts: Sequence[list[_Driven]]) -> list[_Driven]:
    return [driven for part in parts for driven in part]


EVALUATIONS: Work[_Part, list[_Driven]] = Work(_drive_part, _pieces, _lost, _join, attrgetter("tuning.foreign"))
