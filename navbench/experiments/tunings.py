"""A tuning: a controller's parameters searched for the least cost, every evaluation being whole episodes."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from pydantic.dataclasses import dataclass as described

from navbench.contract import FloatArray
from navbench.experiments.cells import Cell, digest
from navbench.experiments.code import foreign_of
from navbench.experiments.engines import Engine
from navbench.experiments.evaluations import Evaluation, evaluator
from navbench.metrics import declared
from navbench.records import RobotRecord, TuningKey
from navbench.tuning.search import Tuner, batches
from navbench.tuning.space import Repair, Side, space_of
from navbench.validation import STRICT, DescriptionError, NonNegative, Number

BUDGET_MAX = 10**6  # evaluations: more are a slip, and would fill the memory


@described(frozen=True, slots=True, kw_only=True, config=STRICT)
class Danger:
    """What it costs to come near to something, once, however often and however long.

    Attributes:
        clearance_m: the hull's least distance from anything at and below which it was dangerous [m].
        cost: what that costs.
    """

    clearance_m: NonNegative
    cost: NonNegative

    def cost_of(self, min_clearance_m: float) -> float:
        """Return the cost of an episode with this least clearance [m]."""
        return self.cost if min_clearance_m <= self.clearance_m else 0.0  # zhao2018, eq. (3)


@described(frozen=True, slots=True, kw_only=True, config=STRICT)
class Objective:
    """What an episode costs: a weighted sum of metrics, more where it was dangerous, and more where a robot fails.

    Attributes:
        weights: weight of each metric in the sum.
        failure_cost: added for a robot that does not reach its goal.
        failure_cost_per_m: added to that, times the distance from the goal at which it ended [1/m].
        danger: what it costs to come near to something; None for nothing.
        failed: the metrics that a robot that does not reach its goal is charged in place of its own, each that counts
            and no other; None for its own.
    """

    weights: Mapping[str, NonNegative]
    failure_cost: NonNegative
    failure_cost_per_m: NonNegative
    danger: Danger | None = None
    failed: Mapping[str, Number] | None = None

    def __post_init__(self) -> None:
        """Check the metrics' names, as far as they are known without a cell."""
        counting = dict.fromkeys([*self.weights, *(() if self.danger is None else ("min_clearance_m",))])
        if self.failed is not None and set(self.failed) != set(counting):
            raise DescriptionError(f"failed: must name {', '.join(counting)}, of which the cost is made, and no other")

    def cost(self, record: RobotRecord) -> float:
        """Return what one robot's episode costs."""
        reached = record.outcome == "reached"
        metrics = record.metrics
        if self.failed is not None and not reached:
            metrics = self.failed
        weighed = {name: weight * metrics[name] for name, weight in self.weights.items() if weight > 0.0}
        if missing := [name for name, part in weighed.items() if math.isnan(part)]:
            raise DescriptionError(
                f"objective.weights.{missing[0]}: has no value in an episode, as a clearance where nothing stands; "
                "weigh another metric"
            )
        cost = math.fsum(weighed.values())
        if self.danger is not None:
            cost += self.danger.cost_of(metrics["min_clearance_m"])
        if reached:
            return cost
        return cost + self.failure_cost + self.failure_cost_per_m * record.metrics["goal_distance_m"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """A search for a controller's parameters.

    Attributes:
        name: what it is called; a study's tunings of one name differ in their seeds.
        tuner_name: the tuner's configuration name.
        objective_name: the objective's configuration name.
        cells: the same controller in one world or more; the cost is the mean over all their robots and episodes.
        tuner: the update rule.
        dimensions: the parameters, named by their dotted place below ``controller.build``, with their bounds or
            choices, and where they start.
        objective: what an episode costs.
        budget: how many evaluations.
        seed: of the tuner and of the episodes, which are the same ones in every evaluation.
        configuration: tuner, objective, bounds and repair as plain values, for the manifest.
        sources: where the tuner's and the objective's parameters come from.
        repair: makes hold what must hold between the parameters, see ``space_of``; None where the bounds are all.
        verified_in: the same cells in another simulator, in which the best is run again; none for in no other.
    """

    name: str
    tuner_name: str
    objective_name: str
    cells: tuple[Cell, ...]
    tuner: Tuner
    dimensions: tuple[Side, ...]
    objective: Objective
    budget: int
    seed: int
    configuration: Mapping[str, Any]
    sources: Mapping[str, Any]
    repair: Repair | None = None
    verified_in: tuple[Cell, ...] = ()

    @property
    def foreign(self) -> frozenset[str]:
        """What it runs that is not navbench's own, by name."""
        return frozenset().union(foreign_of(self.configuration), *(cell.foreign for cell in self.cells))

    def __post_init__(self) -> None:
        """Check the metrics that cost, the budget, and that the repair can mend where the search starts.

        Raises:
            DescriptionError: one line that names the key, its value and what is allowed.
        """
        known, weights = [metric.name for metric in declared(self.cells[0].metrics)], self.objective.weights
        if not weights or not set(weights) <= set(known):
            raise DescriptionError(f"objective.weights: must name at least one of {', '.join(known)}, and no other")
        if not self.tuner.population <= self.budget <= BUDGET_MAX:
            raise DescriptionError(
                f"budget={self.budget}: must be at least {self.tuner.population}, the first population of "
                f"tuner={self.tuner_name}, and at most {BUDGET_MAX}"
            )
        space = space_of(self.dimensions, self.repair)
        if space.start is not None:
            try:
                space.repair(space.start[None, :])
            except ValueError as error:
                raise DescriptionError(str(error)) from None

    def key(self) -> TuningKey:
        """Return what results know of this tuning."""
        cells = [cell.key() for cell in (*self.cells, *self.verified_in)]
        config_hash = digest([self.configuration, [(cell.config_hash, cell.episodes) for cell in cells]])
        return TuningKey(
            self.name,
            self.tuner_name,
            self.objective_name,
            cells[0].names.controller,
            tuple(cell.names.world for cell in self.cells),
            config_hash,
            digest([config_hash, self.budget, self.seed]),
            self.seed,
            self.budget,
            {**self.configuration, "cells": [dict(cell.configuration) for cell in cells]},
            self.sources,
        )

    def parameters(self, values: Sequence[float]) -> dict[str, Any]:
        """Return the controller's parameters by name that values of the search stand for."""
        return {side.name: side.parameter(value) for side, value in zip(self.dimensions, values, strict=True)}


class Check(NamedTuple):
    """What the best of a tuning cost when it was run again.

    Attributes:
        kind: "searched" over the episodes of the search, "verified" over the same in another simulator, "fresh" over as
            many that the search has not seen.
        simulator: in which.
        first_episode: the index of the first episode.
        episodes: how many, in each world.
        cost: as of an ``Evaluation``, and so below.
        reached: how many robots reached their goals.
        robots: of how many.
    """

    kind: str
    simulator: str
    first_episode: int
    episodes: int
    cost: float
    reached: int
    robots: int


class TuningRecord(NamedTuple):
    """What a tuning evaluated, in order.

    Attributes:
        dimensions: the parameters.
        values: (budget, D) their values, a choice by its index.
        evaluations: what each cost.
        best_index: the first evaluation with the least cost.
    """

    dimensions: tuple[Side, ...]
    values: FloatArray
    evaluations: tuple[Evaluation, ...]
    best_index: int

    def columns(self) -> dict[str, Any]:
        """Return all of it as the columns of a table: evaluation, cost, reached, robots and each parameter."""
        columns: dict[str, Any] = {
            "evaluation": list(range(len(self.evaluations))),
            "cost": [evaluation.cost for evaluation in self.evaluations],
            "reached": [evaluation.reached for evaluation in self.evaluations],
            "robots": [evaluation.robots for evaluation in self.evaluations],
        }
        for side, values in zip(self.dimensions, self.values.T.tolist(), strict=True):
            columns[side.name] = list(map(side.parameter, values))
        return columns


def run_tuning(
    tuning: Tuning,
    workers: int | None = 0,
    known: Sequence[Evaluation] = (),
    after: Callable[[TuningRecord], None] = lambda _: None,
    engine: Engine | None = None,
) -> TuningRecord:
    """Run a tuning and return all that it evaluated; the same for any number of workers.

    Args:
        tuning: what to search.
        workers: processes for the evaluations of a generation, as of ``engines.run``.
        known: its first evaluations, of an earlier call; whole generations of them are not evaluated again.
        after: called after each generation that was evaluated, with all so far.
        engine: where the evaluations run, as of ``engines.run``.

    Raises:
        ValueError: a cost is not finite, or a repair leads out of the bounds.
    """
    rng = np.random.default_rng(np.random.SeedSequence([tuning.seed]))
    evaluations: list[Evaluation] = []
    values = np.empty((0, len(tuning.dimensions)))
    with evaluator(tuning, workers, engine) as evaluate:
        search = batches(tuning.tuner, tuning.dimensions, tuning.budget, rng, tuning.repair)
        batch = next(search)
        while True:
            end = batch.first_index + len(batch.values)
            values = np.vstack([values, batch.values])
            if end <= len(known):
                evaluations += known[batch.first_index : end]
            else:
                evaluations += evaluate(batch.first_index, batch.values)
                best = min(range(end), key=lambda i: evaluations[i].cost)
                after(TuningRecord(tuning.dimensions, values, tuple(evaluations), best))
            try:
                batch = search.send(np.array([e.cost for e in evaluations[batch.first_index :]]))
            except StopIteration as ended:
                return TuningRecord(tuning.dimensions, ended.value.values, tuple(evaluations), ended.value.best_index)


def checks_of(
    tuning: Tuning, record: TuningRecord, workers: int | None = 0, engine: Engine | None = None
) -> list[Check]:
    """Return what the best costs over the episodes of the search and over as many fresh ones, in each simulator.

    Args:
        tuning: what was searched.
        record: what it found.
        workers: processes, as of ``engines.run``.
        engine: where, as of ``engines.run``.
    """
    checks = []
    fresh, fresh_in = (
        tuple(replace(c, first_episode=c.indices.stop) for c in cells) for cells in (tuning.cells, tuning.verified_in)
    )
    asked = (("searched", tuning.cells), ("verified", tuning.verified_in), ("fresh", fresh), ("fresh", fresh_in))
    for kind, cells in asked:
        if cells:
            again = replace(tuning, cells=cells)
            where = cells[0].names.simulator, cells[0].first_episode, cells[0].episodes
            with evaluator(again, workers, engine) as evaluate:
                checks.append(Check(kind, *where, *evaluate(0, record.values[record.best_index][None, :])[0]))
    return checks
