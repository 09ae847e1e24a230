"""A search within bounds and a budget: it asks a tuner for points, has them evaluated, and keeps all of them."""

import math
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, get_args

import numpy as np

from navbench.contract import FloatArray

Scale = Literal["linear", "log"]
Evaluate = Callable[[FloatArray, int], FloatArray]


class Tuner(Protocol):
    """An update rule in the unit cube, such as those in ``navbench.tuners``."""

    @property
    def population(self) -> int:
        """The size of its first generation: the least budget."""

    def generations(self, dimensions: int, rng: np.random.Generator) -> Generator[FloatArray, FloatArray, None]:
        """Yield generations (n, dimensions) in the unit cube for ever, and receive n costs for each; less is better."""


@dataclass(frozen=True, slots=True)
class Dimension:
    """One parameter to tune: a side of the unit cube.

    Attributes:
        name: what the parameter is called.
        low: its value at 0.
        high: its value at 1, above ``low``.
        scale: "linear", or "log": equal steps of the unit multiply the value by equal factors; ``low`` is above 0.
    """

    name: str
    low: float
    high: float
    scale: Scale

    def __post_init__(self) -> None:
        """Check the bounds.

        Raises:
            ValueError: a value is wrong; the message names it and what is allowed.
        """
        if not isinstance(self.name, str) or not self.name:
            raise ValueError(f"name={self.name!r}: must be a word that is not empty")
        for key in ("low", "high"):
            value = getattr(self, key)
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise ValueError(f"{self.name}.{key}={value!r}: must be a finite number")
        if self.scale not in get_args(Scale):
            raise ValueError(f"{self.name}.scale={self.scale!r}: must be one of {', '.join(get_args(Scale))}")
        if self.high <= self.low:
            raise ValueError(f"{self.name}.high={self.high!r}: must be greater than low={self.low!r}")
        if self.scale == "log" and self.low <= 0.0:
            raise ValueError(f"{self.name}.low={self.low!r}: must be greater than 0 on a log scale")
        if not math.isfinite(self.high - self.low):
            raise ValueError(f"{self.name}.high={self.high!r}: must be a finite distance above low={self.low!r}")

    def value_at(self, unit: float) -> float:
        """Return the value at a place in [0, 1]; exactly ``low`` at 0 and ``high`` at 1.

        Raises:
            ValueError: the place lies outside.
        """
        if not 0.0 <= unit <= 1.0:
            raise ValueError(f"{self.name}: unit={unit!r}: must be between 0 and 1")
        if unit in (0.0, 1.0):
            return float(self.high if unit else self.low)
        if self.scale == "log":
            value = math.exp((1.0 - unit) * math.log(self.low) + unit * math.log(self.high))
        else:
            value = self.low + unit * (self.high - self.low)
        return min(max(value, self.low), self.high)  # rounding may step over a bound

    def unit_at(self, value: float) -> float:
        """Return the place in [0, 1] of a value.

        Raises:
            ValueError: the value lies outside the bounds.
        """
        if not self.low <= value <= self.high:
            raise ValueError(f"{self.name}={value!r}: must be between {self.low!r} and {self.high!r}")
        if self.scale == "log":
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


class Batch(NamedTuple):
    """Points that wait for their costs.

    Attributes:
        first_index: how many evaluations came before; point k is evaluation first_index + k, and whatever is left to
            chance in it is to be seeded from that number, so that it does not matter where and beside what it runs.
        values: (k, D) the parameters' values, read-only.
    """

    first_index: int
    values: FloatArray


class Tuned(NamedTuple):
    """What a search evaluated.

    Attributes:
        values: (budget, D) the parameters' values, in the order of the evaluations.
        costs: (budget,) their costs.
        best_index: the first evaluation with the least cost.
    """

    values: FloatArray
    costs: FloatArray
    best_index: int


def tune(
    tuner: Tuner, dimensions: Sequence[Dimension], budget: int, rng: np.random.Generator, evaluate: Evaluate
) -> Tuned:
    """Search with one function that evaluates.

    Args:
        tuner: the update rule.
        dimensions: the parameters and their bounds.
        budget: how many evaluations, all of which are used; the last generation is cut to what is left.
        rng: the tuner's chance; evaluations draw nothing from it.
        evaluate: from values (k, D) and the first one's index to costs (k,), finite, less is better.

    Raises:
        ValueError: the budget is less than the tuner's population, the dimensions are none or share a name, or costs
            are of the wrong number or not finite.
    """
    search = batches(tuner, dimensions, budget, rng)
    with closing(search):
        batch = next(search)
        while True:
            try:
                batch = search.send(evaluate(batch.values, batch.first_index))
            except StopIteration as end:
                tuned: Tuned = end.value
                return tuned


def batches(
    tuner: Tuner, dimensions: Sequence[Dimension], budget: int, rng: np.random.Generator
) -> Generator[Batch, FloatArray, Tuned]:
    """Do as ``tune``, for a caller that evaluates elsewhere: yield batches, receive their costs, return the result."""
    _check(tuner, dimensions, budget)
    values = np.empty((budget, len(dimensions)))
    costs = np.empty(budget)
    done = 0
    with closing(tuner.generations(len(dimensions), rng)) as generations:
        generation = next(generations)
        while True:
            size = min(len(generation), budget - done)
            end = done + size
            for row, place in zip(values[done:end], generation, strict=False):
                row[:] = [side.value_at(unit) for side, unit in zip(dimensions, place.tolist(), strict=True)]
            asked = values[done:end]
            asked.flags.writeable = False
            costs[done:end] = _finite((yield Batch(done, asked)), done, size)
            if end == budget:
                return Tuned(values, costs, int(costs.argmin()))
            generation = generations.send(costs[done:end].copy())
            done = end


def _check(tuner: Tuner, dimensions: Sequence[Dimension], budget: int) -> None:
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
