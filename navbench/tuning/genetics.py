"""The operators of a genetic algorithm: ranking, stochastic universal sampling, crossover and mutation.

Chromosomes are places in the unit cube, a gene a side. A gene with n levels stands in the middle of one of them, at
(k + 0.5) / n, so that real numbers and choices lie in one chromosome; only mutation tells them apart.
"""

import numpy as np
from numpy.typing import NDArray

from navbench.contract import FloatArray

IntArray = NDArray[np.int64]


def expected_copies(costs: FloatArray, pressure: float) -> FloatArray:
    """Return how many parents each chromosome should be, by linear ranking; they sum up to the population.

    J. E. Baker, "Adaptive Selection Methods for Genetic Algorithms", 1985. Equal costs share their ranks' mean.

    Args:
        costs: (n,) less is better.
        pressure: copies of the best, 1 to 2; the worst gets 2 - pressure.
    """
    if len(costs) == 1:
        return np.ones(1)
    better = (costs[None, :] < costs[:, None]).sum(axis=1)
    equal = (costs[None, :] == costs[:, None]).sum(axis=1)
    rank = better + 0.5 * (equal - 1)  # 0 for the best, n - 1 for the worst
    copies: FloatArray = pressure - (2.0 * pressure - 2.0) * rank / (len(costs) - 1)
    return copies


def sus(expected: FloatArray, count: int, offset: float) -> IntArray:
    """Return the chromosomes that evenly spaced pointers meet on a wheel: stochastic universal sampling.

    J. E. Baker, "Reducing Bias and Inefficiency in the Selection Algorithm", 1987. Each is met as often as its share
    of the wheel says, rounded up or down.

    Args:
        expected: (n,) each one's share of the wheel, at least 0 and not all 0, in any unit.
        count: how many to choose.
        offset: where the first pointer stands between the wheel's beginning and the second one's place, 0 to below 1.
    """
    wheel = np.cumsum(expected)
    pointers = (offset + np.arange(count)) * (wheel[-1] / count)
    last = np.flatnonzero(expected)[-1]  # rounding may bring the last pointer to the wheel's end
    chosen: IntArray = np.minimum(np.searchsorted(wheel, pointers, side="right"), last)
    return chosen


def double_point_crossover(
    mother: FloatArray, father: FloatArray, begin: int, end: int
) -> tuple[FloatArray, FloatArray]:
    """Return two children: their parents with the genes from ``begin`` to before ``end`` exchanged."""
    daughter, son = mother.copy(), father.copy()
    daughter[begin:end], son[begin:end] = father[begin:end], mother[begin:end]
    return daughter, son


def mutated(
    x: FloatArray, levels: IntArray, rate: float, step: float, level_step: int, rng: np.random.Generator
) -> FloatArray:
    """Return chromosomes some of whose genes have moved, and stay in the cube.

    Args:
        x: (n, D) the chromosomes.
        levels: (D,) the levels of each gene; 0 for a real one.
        rate: probability that a gene moves.
        step: how far a real gene moves at most, to either side, in widths of its range.
        level_step: how many levels another gene moves at most, and at least one.
        rng: the chance.
    """
    moves = rng.random(x.shape) < rate
    real = rng.uniform(-step, step, x.shape)
    jumps = rng.integers(1, level_step + 1, x.shape) * rng.choice((-1, 1), x.shape)
    width = 1.0 / np.maximum(levels, 1)
    margin = np.where(levels > 0, 0.5 * width, 0.0)  # the middle of the outermost levels
    moved = x + np.where(levels > 0, jumps * width, real)
    return np.where(moves, moved.clip(margin, 1.0 - margin), x)
