"""A search within bounds and a budget: it asks a tuner for points, has them evaluated, and keeps all of them."""

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from typing import NamedTuple, Protocol

import numpy as np

from navbench.contract import FloatArray
from navbench.tuning.space import Repair, Side, Space, space_of, values_at

Evaluate = Callable[[FloatArray, int], FloatArray]


class Tuner(Protocol):
    """An update rule in the unit cube, such as those in ``navbench.tuning``."""

    @property
    def population(self) -> int:
        """The size of its first generation: the least budget."""

    def generations(self, space: Space, rng: np.random.Generator) -> Generator[FloatArray, FloatArray, None]:
        """Yield generations (n, space.size) in the unit cube for ever, and receive n costs for each; less is better.

        What is evaluated is ``space.repair`` of each; a tuner that wants to go on from there applies it itself.
        """


class Batch(NamedTuple):
    """Points that wait for their costs.

    Attributes:
        first_index: how many evaluations came before; point k is evaluation first_index + k, and whatever is left to
            chance in it is to be seeded from that number, so that it does not matter where and beside what it runs.
        values: (k, D) the parameters' values, a choice by its index, read-only.
    """

    first_index: int
    values: FloatArray


class Tuned(NamedTuple):
    """What a search evaluated.

    Attributes:
        values: (budget, D) the parameters' values, a choice by its index, in the order of the evaluations.
        costs: (budget,) their costs.
        best_index: the first evaluation with the least cost.
    """

    values: FloatArray
    costs: FloatArray
    best_index: int


def tune(
    tuner: Tuner,
    dimensions: Sequence[Side],
    budget: int,
    rng: np.random.Generator,
    evaluate: Evaluate,
    repair: Repair | None = None,
) -> Tuned:
    """Search with one function that evaluates.

    Args:
        tuner: the update rule.
        dimensions: the parameters, with their bounds or choices.
        budget: how many evaluations, all of which are used; the last generation is cut to what is left.
        rng: the tuner's chance; evaluations draw nothing from it.
        evaluate: from values (k, D) and the first one's index to costs (k,), finite, less is better.
        repair: makes hold what must hold between the parameters before they are evaluated, see ``space_of``.

    Raises:
        ValueError: the budget is less than the tuner's population, the parameters are none or share a name, a repair
            leads out of their bounds, or costs are of the wrong number or not finite.
    """
    search = batches(tuner, dimensions, budget, rng, repair)
    with closing(search):
        batch = next(search)
        while True:
            try:
                batch = search.send(evaluate(batch.values, batch.first_index))
            except StopIteration as end:
                tuned: Tuned = end.value
                return tuned


def batches(
    tuner: Tuner, dimensions: Sequence[Side], budget: int, rng: np.random.Generator, repair: Repair | None = None
) -> Generator[Batch, FloatArray, Tuned]:
    """Do as ``tune``, for a caller that evaluates elsewhere: yield batches, receive their costs, return the result."""
    _check(tuner, dimensions, budget)
    space = space_of(dimensions, repair)
    values = np.empty((budget, space.size))
    costs = np.empty(budget)
    done = 0
    with closing(tuner.generations(space, rng)) as generations:
        generation = next(generations)
        while True:
            size = min(len(generation), budget - done)
            end = done + size
            values[done:end] = [values_at(dimensions, place) for place in space.repair(generation[:size]).tolist()]
            asked = values[done:end]
            asked.flags.writeable = False
            costs[done:end] = _finite((yield Batch(done, asked)), done, size)
            if end == budget:
                return Tuned(values, costs, int(costs.argmin()))
            generation = generations.send(costs[done:end].copy())
            done = end


def _check(tuner: Tuner, dimensions: Sequence[Side], budget: int) -> None:
    """Refuse a search that cannot be made."""
    names = [side.name for side in dimensions]
    if not names:
        raise ValueError("dimensions=(): at least one is needed")
    if len(set(names)) < len(names):
        raise ValueError(f"dimensions={names}: each name may stand once")
    if isinstance(budget, bool) or not isinstance(budget, int):
        raise ValueError(f"budget={budget!r}: must be a whole number of evaluations")
    if budget < tuner.population:
        kind = type(tuner).__name__
        raise ValueError(f"budget={budget}: must be at least {tuner.population}, the first generation of {kind}")


def _finite(costs: FloatArray, first_index: int, size: int) -> FloatArray:
    """Return the costs of one batch, or refuse them."""
    received = np.asarray(costs, dtype=np.float64)
    if received.shape != (size,):
        raise ValueError(f"costs of shape {received.shape}: must be ({size},), one for each point of the batch")
    wrong = np.flatnonzero(~np.isfinite(received))
    if wrong.size:
        raise ValueError(f"cost of evaluation {first_index + wrong[0]}={received[wrong[0]]}: must be finite")
    return received
