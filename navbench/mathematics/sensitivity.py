"""Which factors a result depends on: total effects, flips, and distances of distributions, over points of a unit cube.

A point u in [0, 1]^d is one choice of every factor; points come from scrambled Sobol sequences, whose scrambles are
independent of each other while the points of one are not. A verdict is a boolean result.

Errors: every function raises ValueError, naming the argument, for arrays that are empty, not of the shape and kind
that it documents or unequal in length, and for numbers that are not finite or out of range.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.mathematics.information import (
    PERMUTATIONS,
    Null,
    beside,
    check_count,
    checked,
    classes,
    permuted,
    verdict_table,
)
from navbench.mathematics.statistics import CONFIDENCE, Estimate, clopper_pearson

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]

SLICES = 10


class Design(NamedTuple):
    """Two samples of the unit cube, between which factors are exchanged one at a time.

    Attributes:
        a: (base, d) points, each a choice of every factor.
        b: (base, d) as many others.
    """

    a: FloatArray
    b: FloatArray

    def changed(self, i: int) -> FloatArray:
        """Return (base, d) the points of a with factor i taken from b."""
        points = self.a.copy()
        points[:, i] = self.b[:, i]
        return points


def saltelli(base: int, dimensions: int, seed: int | np.random.Generator) -> Design:
    """Return the design of Saltelli et al. (2010), Comput. Phys. Commun. 181:259-270, for total effects alone.

    It takes base * (dimensions + 1) runs: at ``a``, and at ``changed(i)`` for each factor. Both samples are one
    scrambled Sobol sequence of twice the dimensions, of which a factor has two neighbours, not one of either half:
    where points are few, some dimensions are aligned, and a factor with two such would change a choice between two
    always, or never. At 256 points this befalls some of 60 factors with the halves; with neighbours, none of up to 78
    factors from 64 points on. Finer choices may still be off by more than the standard error of independent points
    (4 times at 256 points, twice at 1,024). So take several scrambles: their spread shows it, and as each seed deals
    the dimensions to the factors anew, no factor keeps a bad place.

    Args:
        base: the points of each sample, a power of two.
        dimensions: the factors, >= 1.
        seed: scrambles, and deals the dimensions; other seeds give independent scrambles.
    """
    check_count("base", base)
    check_count("dimensions", dimensions)
    if base & (base - 1):
        raise ValueError(f"base must be a power of two, not {base}")
    from scipy.stats import qmc

    rng = np.random.default_rng(seed)
    places = 2 * rng.permutation(dimensions)
    points = qmc.Sobol(2 * dimensions, scramble=True, rng=rng).random(base)
    return Design(points[:, places], points[:, places + 1])


def total_effects(y_a: FloatArray | BoolArray, y_changed: FloatArray | BoolArray) -> FloatArray:
    """Return (d,) each factor's total Sobol index: the share of the variance that is left when only it is unknown.

    The estimator is that of Jansen (1999), Comput. Phys. Commun. 117:35-43. Where all results of a are equal nothing
    varies, and every index is 0. For verdicts it is the flip probability over 2 p (1 - p), p the share that hold.

    Args:
        y_a: (n,) results at a design's points a.
        y_changed: (d, n) results at ``changed(i)``, a row for each factor.
    """
    a = checked("y_a", y_a, "biuf", 1).astype(np.float64)
    changed = checked("y_changed", y_changed, "biuf", 2).astype(np.float64)
    if changed.shape[1] != a.size:
        raise ValueError(f"y_changed must have {a.size} columns, as y_a, not shape {changed.shape}")
    if np.ptp(a) == 0.0:
        return np.zeros(len(changed))
    return np.asarray(((changed - a) ** 2).mean(axis=1) / (2.0 * a.var()))


def flip_probability(
    y_a: BoolArray, y_changed: BoolArray, *, replicates: int | None = None, confidence: float = CONFIDENCE
) -> Estimate:
    """Return the probability that choosing one factor anew, and nothing else, turns the verdict.

    The interval is that of ``share_of_scrambles``.

    Args:
        y_a: (k, n) verdicts at the points a of k designs, a row for each scramble; or (n,) of all, one after another.
        y_changed: the verdicts at ``changed(i)``, in the same shape and order.
        replicates: into how many scrambles (n,) verdicts fall, >= 1; None: as many as there are rows.
        confidence: the nominal coverage, in (0, 1).
    """
    a, changed = np.atleast_2d(y_a), np.atleast_2d(y_changed)
    checked("y_a", a, "b", 2)
    checked("y_changed", changed, "b", 2)
    if a.shape != changed.shape:
        raise ValueError(f"y_a and y_changed must have the same shape, not {a.shape} and {changed.shape}")
    k = len(a) if replicates is None else replicates
    check_count("replicates", k)
    if a.size % k:
        raise ValueError(f"replicates must divide the {a.size} verdicts, as {k} does not")
    return share_of_scrambles((a != changed).reshape(k, -1), confidence=confidence)


def share_of_scrambles(y: BoolArray, *, confidence: float = CONFIDENCE) -> Estimate:
    """Return the share of verdicts that hold, over independent scrambles; n counts all points.

    Points of one scramble are not independent, but the scrambles' shares are: the interval is Student's t of these,
    wider by half a point to either side, for they come in steps of one, and clipped to [0, 1]. With one scramble, or
    where all shares agree (as they do where every verdict is the same, or none of few scrambles met a rare case), no
    spread was seen from which to tell one; there it is that of ``clopper_pearson``, as if all points were independent,
    which is mostly too wide, because a Sobol sequence fills the cube more evenly.

    Args:
        y: (k, n) verdicts, a row for each scramble.
        confidence: the nominal coverage, in (0, 1).
    """
    held = checked("y", y, "b", 2)
    pooled = clopper_pearson(int(held.sum()), held.size, confidence=confidence)
    shares = held.mean(axis=1)
    if np.ptp(shares) == 0.0:
        return pooled
    from scipy.special import stdtrit

    k = shares.size
    half = float(stdtrit(k - 1, 0.5 + 0.5 * confidence) * shares.std(ddof=1)) / math.sqrt(k) + 0.5 / held.size
    return Estimate(pooled.value, max(0.0, pooled.value - half), min(1.0, pooled.value + half), held.size)


def pawn(u: FloatArray, y: FloatArray | BoolArray, slices: int = SLICES) -> float:
    """Return how far knowing a factor moves the distribution of the result, in [0, 1].

    This is the index of Pianosi & Wagener (2018), Environ. Model. Softw. 108:197-207, from any sample: the factor is
    cut into equally probable slices, and the Kolmogorov-Smirnov distance from all results to those of each slice is
    taken; for a verdict it is the difference of two shares. Of the slices the largest distance counts, not the median:
    a factor matters if any part of its range turns the verdict. The largest is above 0 by chance alone: judge it by
    ``pawn_null``, or by ``permutation_null`` where y are numbers.

    Args:
        u: (n,) the factor's points or values; one slice for each value where no more than ``slices`` are distinct.
        y: (n,) results, verdicts or finite numbers.
        slices: how many, >= 1.
    """
    results, groups = checked("y", y, "biuf", 1), classes(checked("u", u, "iuf", 1), slices)
    _check_length(u, results)
    return float(_largest_distance(_counts(results, groups)))


def pawn_null(
    u: FloatArray, y: BoolArray, rng: np.random.Generator, *, slices: int = SLICES, permutations: int = PERMUTATIONS
) -> Null:
    """Return ``pawn`` of a verdict beside its permutation null, far sooner than ``permutation_null`` would.

    Args:
        u: (n,) the factor's points or values.
        y: (n,) verdicts.
        rng: draws the permutations.
        slices: as of ``pawn``.
        permutations: how many, >= 1.
    """
    table = verdict_table(y, u, slices)
    table = table[table.any(axis=1)]
    return beside(float(_largest_distance(table)), _largest_distance(permuted(table, rng, permutations)))


def rsa(u: FloatArray, y: BoolArray) -> float:
    """Return the Kolmogorov-Smirnov distance of a factor where the verdict holds from where it does not, in [0, 1].

    This is the regional sensitivity analysis of Spear & Hornberger (1980), Water Res. 14:43-49. Where all verdicts
    are the same there is no second region, and it is 0. Chance alone lifts it: judge it by ``permutation_null``.

    Args:
        u: (n,) the factor's points or values, finite.
        y: (n,) verdicts.
    """
    points, verdicts = checked("u", u, "iuf", 1), checked("y", y, "b", 1)
    _check_length(points, verdicts)
    regions = _distribution(_counts(points, verdicts.astype(np.intp)))
    return float(np.ptp(regions, axis=0).max())


def permutation_null(
    statistic: Callable[[Any, Any], float],
    u: NDArray[Any],
    y: NDArray[Any],
    rng: np.random.Generator,
    permutations: int = PERMUTATIONS,
) -> Null:
    """Return a statistic beside its values for permuted results, which no factor can tell.

    Permutations know only independent points. In a scrambled Sobol sequence most factors look less related by chance
    than these, but of 60 dimensions a few pairs are aligned: of irrelevant factors at 4,096 points 1 to 3 % have a
    p-value below 0.005, with up to 0.03 bit. Believe a small effect only where other scrambles, with the dimensions
    dealt to other factors, show it too.

    Args:
        statistic: of (u, y), the greater the more they have to do with each other, such as ``pawn`` or ``rsa``.
        u: (n,) or (n, d) points.
        y: (n,) results.
        rng: draws the permutations.
        permutations: how many, >= 1.
    """
    check_count("permutations", permutations)
    drawn = [statistic(u, rng.permutation(y)) for _ in range(permutations)]
    return beside(float(statistic(u, y)), np.array(drawn))


def _counts(values: NDArray[Any], groups: IntArray) -> IntArray:
    """Return (k, m) how often each of the m distinct values, in their order, occurs in each group that has any."""
    distinct, index = np.unique(values, return_inverse=True)
    cells = np.bincount(groups * distinct.size + index, minlength=distinct.size * (groups.max() + 1))
    counts = cells.reshape(-1, distinct.size)
    return counts[counts.any(axis=1)]


def _largest_distance(counts: IntArray) -> FloatArray:
    """Return (...) the largest distance of a row's distribution from that of all rows, of counts, (..., k, m)."""
    together = _distribution(counts.sum(axis=-2, keepdims=True))
    return np.asarray(abs(_distribution(counts) - together).max(axis=(-2, -1)))


def _distribution(counts: IntArray) -> FloatArray:
    """Return (..., m) the empirical distribution functions of counts, (..., m), at each distinct value."""
    return np.asarray(counts.cumsum(axis=-1) / counts.sum(axis=-1, keepdims=True))


def _check_length(u: NDArray[Any], y: NDArray[Any]) -> None:
    """Raise ValueError unless points and results are equally many."""
    if len(u) != len(y):
        raise ValueError(f"u and y must be equally long, not {len(u)} and {len(y)}")
