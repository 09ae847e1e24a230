"""A tuning: a controller's parameters searched for the least cost, every evaluation being whole episodes."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from pydantic.dataclasses import dataclass as described

from navbench.contract import FloatArray
from navbench.descriptions.description import STRICT, DescriptionError, NonNegative
from navbench.descriptions.record import RobotRecord, TuningKey
from navbench.descriptions.world import World
from navbench.experiments.cells import Cell, digest, place_of
from navbench.experiments.engines import Work, run
from navbench.loop.episode import EpisodeRunner
from navbench.mathematics.metrics import Metrics
from navbench.tuners.search import Dimension, Tuner, batches

SEEDS_MAX = 2**63  # of an evaluation


@described(frozen=True, slots=True, kw_only=True, config=STRICT)
class Objective:
    """What an episode costs: a weighted sum of metrics, and more where a robot fails.

    Attributes:
        weights: weight of each metric in the sum.
        failure_cost: added for a robot that does not reach its goal.
        failure_cost_per_m: added to that, times the distance from the goal at which it ended [1/m].
    """

    weights: Mapping[str, NonNegative]
    failure_cost: NonNegative
    failure_cost_per_m: NonNegative

    def __post_init__(self) -> None:
        """Check the metrics' names."""
        if not self.weights or not set(self.weights) <= set(Metrics._fields):
            raise DescriptionError(f"weights: must name at least one of {', '.join(Metrics._fields)}, and no other")

    def cost(self, record: RobotRecord, world: World) -> float:
        """Return what one robot's episode costs."""
        metrics = record.metrics._asdict()
        cost = math.fsum(weight * metrics[name] for name, weight in self.weights.items() if weight > 0.0)
        if record.outcome == "reached":
            return cost
        goal = world.goals[record.robot_index]
        away = math.hypot(goal.x_m - record.states[-1, 1], goal.y_m - record.states[-1, 2])
        return cost + self.failure_cost + self.failure_cost_per_m * away


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """A search for a controller's parameters.

    Attributes:
        name: what it is called; a study's tunings of one name differ in their seeds.
        tuner_name: the tuner's configuration name.
        objective_name: the objective's configuration name.
        cells: the same controller in one world or more; the cost is the mean over all their robots and episodes.
        tuner: the update rule.
        dimensions: the parameters, named by their dotted place below ``controller.build``, with their bounds.
        objective: what an episode costs.
        budget: how many evaluations.
        seed: of the tuner, and with an evaluation's index, of that evaluation's episodes.
        configuration: tuner, objective and bounds as plain values, for the manifest.
        sources: where the tuner's and the objective's parameters come from.
    """

    name: str
    tuner_name: str
    objective_name: str
    cells: tuple[Cell, ...]
    tuner: Tuner
    dimensions: tuple[Dimension, ...]
    objective: Objective
    budget: int
    seed: int
    configuration: Mapping[str, Any]
    sources: Mapping[str, Any]

    def __post_init__(self) -> None:
        """Check that the parameters exist and are numbers, and that the budget suffices.

        Raises:
            DescriptionError: one line that names the key, its value and what is allowed.
        """
        if self.budget < self.tuner.population:
            raise DescriptionError(
                f"budget={self.budget}: must be at least {self.tuner.population}, the first population of "
                f"tuner={self.tuner_name}"
            )
        for dimension in self.dimensions:
            place, last = place_of(dimension.name, self.cells[0].configuration["controller"]["build"])
            if isinstance(place[last], bool) or not isinstance(place[last], int | float):
                raise DescriptionError(f"controller.tunable.{dimension.name}: must name a number, not {place[last]!r}")

    def key(self) -> TuningKey:
        """Return what results know of this tuning."""
        cells = [cell.key() for cell in self.cells]
        config_hash = digest([self.configuration, [(cell.config_hash, cell.episodes) for cell in cells]])
        return TuningKey(
            self.name,
            self.tuner_name,
            self.objective_name,
            cells[0].names.controller,
            tuple(cell.names.world for cell in cells),
            config_hash,
            digest([config_hash, self.budget, self.seed]),
            self.seed,
            self.budget,
            {**self.configuration, "cells": [dict(cell.configuration) for cell in cells]},
            self.sources,
        )


class Evaluation(NamedTuple):
    """What one point cost.

    Attributes:
        cost: the mean over all robots and episodes.
        reached: how many robots reached their goals.
        robots: of how many.
    """

    cost: float
    reached: int
    robots: int


class TuningRecord(NamedTuple):
    """What a tuning evaluated, in order.

    Attributes:
        names: the parameters' names.
        values: (budget, n_names) their values.
        evaluations: what each cost.
        best_index: the first evaluation with the least cost.
    """

    names: tuple[str, ...]
    values: FloatArray
    evaluations: tuple[Evaluation, ...]
    best_index: int

    def best(self) -> dict[str, float]:
        """Return the best parameters by name."""
        return dict(zip(self.names, self.values[self.best_index].tolist(), strict=True))


def run_tuning(
    tuning: Tuning, workers: int | None = 1, progress: Callable[[int, float], None] | None = None
) -> TuningRecord:
    """Run a tuning and return all that it evaluated; the same for any number of workers.

    Args:
        tuning: what to search.
        workers: processes for the evaluations of a generation; None for one a core.
        progress: called after each generation with the number of evaluations and the least cost so far.

    Raises:
        ValueError: a cost is not finite.
    """
    rng = np.random.default_rng(np.random.SeedSequence([tuning.seed]))
    evaluations: list[Evaluation] = []
    with _evaluator(tuning, workers) as evaluate:
        search = batches(tuning.tuner, tuning.dimensions, tuning.budget, rng)
        batch = next(search)
        while True:
            evaluations += evaluate(batch.first_index, batch.values)
            if progress is not None:
                progress(len(evaluations), min(evaluation.cost for evaluation in evaluations))
            try:
                batch = search.send(np.array([e.cost for e in evaluations[batch.first_index :]]))
            except StopIteration as end:
                names = tuple(dimension.name for dimension in tuning.dimensions)
                return TuningRecord(names, end.value.values, tuple(evaluations), end.value.best_index)


class _Part(NamedTuple):
    """Some evaluations of one generation."""

    tuning: Tuning
    first_index: int
    values: FloatArray


@contextmanager
def _evaluator(tuning: Tuning, workers: int | None) -> Iterator[Callable[[int, FloatArray], list[Evaluation]]]:
    """Give a function that evaluates a generation, here or in worker processes."""
    if workers == 1:
        with _runners(tuning) as runners:
            yield lambda first, values: _evaluate(tuning, runners, first, values)
        return

    def evaluate(first: int, values: FloatArray) -> list[Evaluation]:
        size = max(1, math.ceil(len(values) / 4))
        parts = [_Part(tuning, first + i, values[i : i + size]) for i in range(0, len(values), size)]
        done = dict(run(EVALUATIONS, parts, workers=workers))
        return [evaluation for i in range(len(parts)) for evaluation in done[i]]

    yield evaluate


@contextmanager
def _runners(tuning: Tuning) -> Iterator[list[EpisodeRunner]]:
    with ExitStack() as stack:
        yield [stack.enter_context(cell.runner()) for cell in tuning.cells]


def _evaluate_part(part: _Part) -> list[Evaluation]:
    with _runners(part.tuning) as runners:
        return _evaluate(part.tuning, runners, part.first_index, part.values)


def _pieces(part: _Part) -> list[_Part]:
    return [_Part(part.tuning, part.first_index + k, part.values[k : k + 1]) for k in range(len(part.values))]


def _lost(part: _Part) -> list[Evaluation]:
    """Refuse an evaluation whose process died: there is nothing to compare it by."""
    values = dict(zip((d.name for d in part.tuning.dimensions), part.values[0].tolist(), strict=True))
    raise DescriptionError(
        f"tuner={part.tuning.tuner_name}: the process of evaluation {part.first_index} died: {values}"
    )


def _join(parts: Sequence[list[Evaluation]]) -> list[Evaluation]:
    return [evaluation for part in parts for evaluation in part]


EVALUATIONS: Work[_Part, list[Evaluation]] = Work(_evaluate_part, _pieces, _lost, _join)


def _evaluate(
    tuning: Tuning, runners: Sequence[EpisodeRunner], first_index: int, values: FloatArray
) -> list[Evaluation]:
    """Evaluate some points; each one's chance hangs on its own index alone."""
    names = [dimension.name for dimension in tuning.dimensions]
    evaluations = []
    for index, point in enumerate(values.tolist(), first_index):
        seed = int(np.random.SeedSequence([tuning.seed, index]).generate_state(1, np.uint64)[0] % SEEDS_MAX)
        costs: list[float] = []
        reached = 0
        for cell, runner in zip(tuning.cells, runners, strict=True):
            runner.make_controller = cell.with_parameters(dict(zip(names, point, strict=True))).make_controller
            runner.seed = seed
            for episode in range(cell.episodes):
                for record in runner.run(episode):
                    costs.append(tuning.objective.cost(record, cell.world))
                    reached += record.outcome == "reached"
        evaluations.append(Evaluation(math.fsum(costs) / len(costs), reached, len(costs)))
    return evaluations
