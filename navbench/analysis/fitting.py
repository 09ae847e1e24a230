"""How many printed numbers hold together in one reconstruction, and whether that is more than noise would give.

A target is a table to be met: the paper's own; the same with one number left out, which the best for the others then
predicts; and placebo tables: the same numbers, those of one unit permuted among the claims. A paper whose numbers hang
together as its world does is met better than these.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.claims import Entry
from navbench.analysis.printed import limits, quantity
from navbench.analysis.shares import Drawn

PLACEBOS = 20
SEED = 0  # of their permutations

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Target(NamedTuple):
    """Numbers to be met together.

    Attributes:
        name: "printed", "without CLAIM" or "placebo K".
        claims: (n) the claims that print them.
        numbers: (n,) which numbers.
        counts: (n,) which of them count.
    """

    name: str
    claims: tuple[Entry, ...]
    numbers: FloatArray
    counts: BoolArray

    def away(self, values: FloatArray) -> FloatArray:
        """Return (rows, n) how many tolerances each value lies from its number; infinitely many without a case."""
        columns = []
        for column, entry, number in zip(values.T, self.claims, self.numbers, strict=True):
            size, unit = quantity("within", entry.claim.within)
            low, high = limits("printed", entry.claim.printed)
            half = 0.5 * (high - low)
            width = size / 100.0 * abs(number) if unit == "%" else size
            beyond = np.maximum(abs(column - number) - half, 0.0)
            columns.append(np.nan_to_num(beyond / max(width, 1e-12), nan=np.inf))
        return np.stack(columns, axis=1)

    def cost(self, values: FloatArray) -> FloatArray:
        """Return (rows,) how many numbers that count are missed, and in the fraction how far all lie away."""
        away = self.away(values)[:, self.counts]
        far = 1.0 - 1.0 / (1.0 + away)
        missed: FloatArray = (away > 1.0).sum(axis=1) + far.sum(axis=1) / (away.shape[1] + 1.0)
        return missed


class Met(NamedTuple):
    """What meets a target best.

    Attributes:
        u: (d,) where that reconstruction lies.
        values: (n,) what was measured there.
    """

    u: FloatArray
    values: FloatArray


class Fit(NamedTuple):
    """The reconstruction in which most printed numbers hold.

    Attributes:
        claims: the claims that print them.
        u: (d,) where it lies.
        values: (n,) what was measured there.
        holds: (n,) which hold.
        predicted: (n,) what is measured of each where the others fit best.
        predicts: (n,) which of these hold.
        placebos: (PLACEBOS,) how many numbers of each placebo table hold where most of them do.
        printed: (n,) the numbers.
    """

    claims: tuple[Entry, ...]
    u: FloatArray
    values: FloatArray
    holds: BoolArray
    predicted: FloatArray
    predicts: BoolArray
    placebos: NDArray[np.int64]
    printed: FloatArray


def targets(claims: Sequence[Entry]) -> list[Target]:
    """Return all targets of some claims, the printed one first; none where no claim prints a number."""
    told = tuple(entry for entry in claims if entry.claim.printed is not None)
    if not told:
        return []
    numbers = np.array([quantity("printed", entry.claim.printed)[0] for entry in told])
    every = np.ones(len(told), dtype=bool)
    rng = np.random.default_rng(SEED)
    others = ~np.eye(len(told), dtype=bool)
    left_out = [Target(f"without {e.name}", told, numbers, of) for e, of in zip(told, others, strict=True)]
    placebos = [Target(f"placebo {k}", told, _permuted(told, numbers, rng), every) for k in range(PLACEBOS)]
    return [Target("printed", told, numbers, every), *(left_out if len(told) > 1 else []), *placebos]


def fit(claims: Sequence[Entry], meet: Callable[[Target], Met]) -> Fit | None:
    """Return the best reconstruction for some claims' printed numbers; None where none prints one.

    Args:
        claims: the claims; those that print nothing are left out.
        meet: tells what meets a target best.
    """
    asked = targets(claims)
    if not asked:
        return None
    printed, *others = asked
    met = {target.name: meet(target) for target in asked}
    best = met[printed.name]
    predicted = np.array([met.get(f"without {e.name}", best).values[i] for i, e in enumerate(printed.claims)])
    return Fit(
        claims=printed.claims,
        u=best.u,
        values=best.values,
        holds=printed.away(best.values[None])[0] <= 1.0,
        predicted=predicted,
        predicts=printed.away(predicted[None])[0] <= 1.0,
        placebos=np.array([int(t.counts.sum() - t.cost(met[t.name].values[None])[0] // 1) for t in others[-PLACEBOS:]]),
        printed=printed.numbers,
    )


def in_sample(drawn: Drawn) -> Callable[[Target], Met]:
    """Return what tells which reconstruction of a sample meets a target best."""

    def meet(target: Target) -> Met:
        values = values_in(drawn, target)
        row = int(np.argmin(target.cost(values)))
        return Met(drawn.u[row], values[row])

    return meet


def values_in(drawn: Drawn, target: Target) -> FloatArray:
    """Return (rows, n) what a sample measures of a target's claims."""
    return drawn.rows[[f"value:{entry.name}" for entry in target.claims]].to_numpy(np.float64)


def _permuted(claims: Sequence[Entry], numbers: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the numbers, those of one unit dealt anew among their claims."""
    units = np.array([quantity("printed", entry.claim.printed)[1] for entry in claims])
    dealt = numbers.copy()
    for unit in np.unique(units):
        places = np.flatnonzero(units == unit)
        dealt[places] = numbers[rng.permutation(places)]
    return dealt
