"""How many printed numbers hold together in one reconstruction, and whether that is more than noise would give.

The best of a sample is chosen for a paper's table and, likewise, for placebo tables: the same numbers, those of one
unit permuted among the claims. A paper whose numbers hang together as its world does fits better than these. Each
number is also left out in turn, and predicted by the reconstruction that is best for the others.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.claims import Entry
from navbench.analysis.printed import limits, quantity
from navbench.analysis.shares import Drawn

PLACEBOS = 20
SEED = 0  # of their permutations
FAR = 3.0  # tolerances, at which a number is as far as it can be: one that is missing, too

FloatArray = NDArray[np.float64]


class Fit(NamedTuple):
    """The reconstruction of a sample in which most printed numbers hold.

    Attributes:
        claims: the claims that print them.
        row: which row of the sample.
        values: (n,) what was measured there.
        holds: (n,) which hold.
        predicted: (n,) what is measured of each where the others fit best.
        predicts: (n,) which of these hold.
        placebos: (PLACEBOS,) how many numbers of each placebo table hold in the row that is best for it.
        printed: (n,) the numbers.
    """

    claims: tuple[Entry, ...]
    row: int
    values: FloatArray
    holds: NDArray[np.bool_]
    predicted: FloatArray
    predicts: NDArray[np.bool_]
    placebos: NDArray[np.int64]
    printed: FloatArray


def fit(drawn: Drawn, claims: Sequence[Entry]) -> Fit | None:
    """Return the best reconstruction for some claims' printed numbers; None where none prints one.

    Args:
        drawn: the sample.
        claims: the claims; those that print nothing are left out.
    """
    told = tuple(entry for entry in claims if entry.claim.printed is not None)
    if not told:
        return None
    values = drawn.rows[[f"value:{entry.name}" for entry in told]].to_numpy(np.float64)
    numbers = np.array([quantity("printed", entry.claim.printed)[0] for entry in told])
    away = _away(values, told, numbers)
    best = _best(away)
    left_out = [_best(np.delete(away, i, axis=1)) for i in range(len(told))]
    columns = np.arange(len(told))
    rng = np.random.default_rng(SEED)
    placebos = []
    for _ in range(PLACEBOS):
        moved = _away(values, told, _permuted(told, numbers, rng))
        placebos.append(int((moved[_best(moved)] <= 1.0).sum()))
    return Fit(
        claims=told,
        row=best,
        values=values[best],
        holds=away[best] <= 1.0,
        predicted=values[left_out, columns],
        predicts=away[left_out, columns] <= 1.0,
        placebos=np.array(placebos),
        printed=numbers,
    )


def _away(values: FloatArray, claims: Sequence[Entry], numbers: FloatArray) -> FloatArray:
    """Return (rows, n) how many tolerances each value lies from what is printed, at most FAR."""
    columns = []
    for column, entry, number in zip(values.T, claims, numbers, strict=True):
        size, unit = quantity("within", entry.claim.within)
        low, high = limits("printed", entry.claim.printed)
        half = 0.5 * (high - low)
        width = size / 100.0 * abs(number) if unit == "%" else size
        beyond = np.maximum(abs(column - number) - half, 0.0)
        columns.append(np.minimum(np.nan_to_num(beyond / max(width, 1e-12), nan=FAR), FAR))
    return np.stack(columns, axis=1)


def _best(away: FloatArray) -> int:
    """Return the row in which most numbers hold, of equals that in which all lie nearest."""
    held = (away <= 1.0).sum(axis=1)
    return int(np.lexsort((away.sum(axis=1), -held))[0])


def _permuted(claims: Sequence[Entry], numbers: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the numbers, those of one unit dealt anew among their claims."""
    units = np.array([quantity("printed", entry.claim.printed)[1] for entry in claims])
    dealt = numbers.copy()
    for unit in np.unique(units):
        places = np.flatnonzero(units == unit)
        dealt[places] = numbers[rng.permutation(places)]
    return dealt
