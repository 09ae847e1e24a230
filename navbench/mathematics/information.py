"""How many bits a factor, or a pair of factors, tells about a verdict, over any sample: mutual information.

Factors are binned with equal probability; counts stand for probabilities (the plug-in estimate), and the bias of that,
which lets an irrelevant factor tell something, is taken off to first order as Miller (1955), "Note on the bias of
information estimates", does: (cells of x + cells of y - cells of both - 1) / 2n nats, counting the cells that hold
anything. What is left lies between 0 and the verdict's entropy, and so does every figure here.

Errors: every function raises ValueError, naming the argument, for arrays that are empty, not of the shape and kind
that it documents or unequal in length, and for numbers that are not finite or out of range.
"""

import itertools
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]

BINS = 16
PAIR_BINS = 6  # a side
PERMUTATIONS = 200
ROUNDING = 1e-12  # statistics that differ by less are the same


class Null(NamedTuple):
    """A statistic beside what it would be if verdicts and factor had nothing to do with each other.

    Attributes:
        value: the statistic.
        p95: what 95 % of the permutations stay at or below.
        p_value: (1 + those at least as large) / (1 + permutations), Phipson & Smyth (2010), Stat. Appl. Genet. 9:39.
    """

    value: float
    p95: float
    p_value: float


class Pair(NamedTuple):
    """The two factors that together tell most.

    Attributes:
        i: the first factor's index.
        j: the second's, above i.
        bits: what both together tell about the verdict [bit].
    """

    i: int
    j: int
    bits: float


def mutual_information(y: BoolArray, x: FloatArray, *, bins: int = BINS) -> float:
    """Return what a factor tells about a verdict [bit], at most the verdict's entropy.

    Where one verdict is rare (fewer than some 10 cases a bin), part of the bias is left: judge by ``information_null``.

    Args:
        y: (n,) verdicts.
        x: (n,) finite numbers, the factor's values or the points that they were drawn from.
        bins: how many equally probable bins, >= 1; a factor of no more distinct values has one bin for each.
    """
    return float(_bits(verdict_table(y, x, bins)))


def information_null(
    y: BoolArray, x: FloatArray, rng: np.random.Generator, *, bins: int = BINS, permutations: int = PERMUTATIONS
) -> Null:
    """Return ``mutual_information`` beside its permutation null, far sooner than ``permutation_null`` would.

    Args:
        y: (n,) verdicts.
        x: (n,) finite numbers.
        rng: draws the permutations.
        bins: as of ``mutual_information``.
        permutations: how many, >= 1.
    """
    table = verdict_table(y, x, bins)
    return beside(float(_bits(table)), _bits(permuted(table, rng, permutations)))


def best_pair(y: BoolArray, factors: FloatArray, *, bins: int = PAIR_BINS) -> Pair:
    """Return the pair of factors that together tell most about a verdict, the first of equals.

    It is the largest of d (d - 1) / 2 figures, which chance alone lifts: beside it belongs its null,
    ``permutation_null(lambda x, y: best_pair(y, x).bits, factors, y, rng)``. A factor that tells much alone makes a
    good pair with any other, so compare also with ``mutual_information`` of each, at as many bins.

    Args:
        y: (n,) verdicts.
        factors: (n, d) finite numbers, a column for each factor, d >= 2.
        bins: how many bins each factor has, as of ``mutual_information``.
    """
    held, x = checked("y", y, "b", 1), checked("factors", factors, "iuf", 2)
    if len(x) != held.size or x.shape[1] < 2:
        raise ValueError(f"factors must have {held.size} rows, as y, and at least 2 columns, not shape {x.shape}")
    columns = [classes(column, bins) for column in x.T]
    pairs = list(itertools.combinations(range(len(columns)), 2))
    cells = [2 * bins * column + held for column in columns]
    tables = np.array([np.bincount(cells[i] + 2 * columns[j], minlength=2 * bins * bins) for i, j in pairs])
    bits = _bits(tables.reshape(len(pairs), -1, 2))
    best = int(bits.argmax())
    return Pair(*pairs[best], float(bits[best]))


def classes(x: FloatArray, bins: int) -> IntArray:
    """Return (n,) each value's class, from 0 to at most bins - 1; equal values share theirs.

    Args:
        x: (n,) finite numbers.
        bins: how many equally probable classes, >= 1; where there are no more distinct values, each is a class.
    """
    check_count("bins", bins)
    values = checked("x", x, "iuf", 1)
    ordered = np.sort(values)
    first = np.flatnonzero(np.diff(ordered)) + 1  # where a value differs from the one before
    if first.size < bins:
        edges = ordered[first]
    else:
        edges = ordered[np.arange(1, bins) * ordered.size // bins]
    return np.searchsorted(edges, values, side="right")


def verdict_table(y: BoolArray, x: FloatArray, bins: int) -> IntArray:
    """Return (bins, 2) how many verdicts of each class fail and hold; the last classes may be empty.

    Args:
        y: (n,) verdicts.
        x: (n,) finite numbers.
        bins: as of ``classes``.
    """
    held, column = checked("y", y, "b", 1), classes(x, bins)
    if held.size != column.size:
        raise ValueError(f"y and x must be equally long, not {held.size} and {column.size}")
    return np.bincount(2 * column + held, minlength=2 * bins).reshape(bins, 2)


def permuted(table: IntArray, rng: np.random.Generator, permutations: int) -> IntArray:
    """Return (permutations, bins, 2) the tables of permuted verdicts.

    These fall into the classes as balls drawn without replacement do, so that only the counts have to be drawn.

    Args:
        table: (bins, 2) how many verdicts of each class fail and hold.
        rng: draws the permutations.
        permutations: how many, >= 1.
    """
    check_count("permutations", permutations)
    sizes = table.sum(axis=1)
    held = rng.multivariate_hypergeometric(sizes, table[:, 1].sum(), size=permutations)
    return np.stack([sizes - held, held], axis=-1)


def beside(value: float, drawn: FloatArray) -> Null:
    """Return a statistic beside its null.

    Args:
        value: the statistic.
        drawn: (permutations,) what it is for permuted verdicts.
    """
    larger = int((drawn >= value - ROUNDING).sum())
    return Null(value, float(np.quantile(drawn, 0.95)), (1 + larger) / (1 + drawn.size))


def checked(name: str, values: ArrayLike, kinds: str, dimensions: int) -> NDArray[Any]:
    """Return a checked array that is not empty and, where it holds numbers, finite.

    Args:
        name: the argument, for the error message.
        values: what should be such an array.
        kinds: the letters of numpy's kinds that are allowed.
        dimensions: how many it must have.
    """
    array = np.asarray(values)
    if array.ndim != dimensions or array.size == 0 or array.dtype.kind not in kinds:
        wanted = "booleans" if kinds == "b" else "numbers"
        raise ValueError(
            f"{name} must be {wanted} in {dimensions} dimensions, not empty, not {array.dtype} of {array.shape}"
        )
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    return array


def check_count(name: str, count: int) -> None:
    """Raise ValueError unless a number is whole and at least 1."""
    if not isinstance(count, int | np.integer) or count < 1:
        raise ValueError(f"{name} must be a whole number of at least 1, not {count!r}")


def _bits(tables: IntArray) -> FloatArray:
    """Return (...) the corrected mutual information [bit] of tables of counts, (..., classes, 2)."""
    of_x, of_y, of_both = tables.sum(axis=-1), tables.sum(axis=-2), tables.reshape(*tables.shape[:-2], -1)
    limit = _entropy(of_y)
    cells = sum(sign * (counts > 0).sum(axis=-1) for sign, counts in ((1, of_x), (1, of_y), (-1, of_both)))
    bias = (cells - 1) / (2.0 * np.log(2.0) * of_y.sum(axis=-1))
    return np.asarray(np.clip(_entropy(of_x) + limit - _entropy(of_both) + bias, 0.0, limit))


def _entropy(counts: IntArray) -> FloatArray:
    """Return (...) the plug-in entropy [bit] of counts, (..., cells)."""
    n = counts.sum(axis=-1)
    return np.asarray(np.log2(n) - (counts * np.log2(np.maximum(counts, 1))).sum(axis=-1) / n)
