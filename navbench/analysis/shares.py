"""What many reconstructions say of each claim: in which share of them it holds, and what decides it.

A share is one of our prior: of the ranges and choices that the sources of a study's values give, drawn independently
and uniformly. Its interval tells how well the sample knows it, not how well the prior knows the paper.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.claims import Claim, Entry
from navbench.analysis.multiverse import KIND, Conditioned, Multiverse
from navbench.analysis.printed import limits, quantity
from navbench.mathematics.information import Null, best_pair, information_null
from navbench.mathematics.sensitivity import flip_probability, pawn_null, share_of_scrambles
from navbench.mathematics.statistics import Estimate, clopper_pearson

if TYPE_CHECKING:
    import pandas as pd

HOLDS, FAILS, PARTLY, CHAOTIC, UNKNOWN = 1, 0, 2, 3, -1  # the verdict on a claim in one reconstruction
ROBUST, CONTRADICTED = 0.95, 0.05  # by the bound of the share's interval on this side
CASES_MIN = 200  # admissible or conditioned reconstructions below which no interval is told
SEED = 0  # of permutations: a report is the same bytes whenever it is written

BoolArray = NDArray[np.bool_]


def held(codes: NDArray[np.integer], claim: Claim) -> BoolArray:
    """Return where a claim holds, by the verdicts on it.

    A printed single run also holds where the verdict is partly: the median of starts within a millimetre lies within
    the tolerance, and they scatter by no more. The verdict on one reconstruction also asks that the run lies among the
    central 90 % of them. Hardly any of many reconstructions has that: they differ by more than such starts.
    """
    within = claim.compare is not None and claim.printed is not None
    found: BoolArray = np.isin(codes, (HOLDS, PARTLY) if within else HOLDS)
    return found


class Drawn(NamedTuple):
    """A sample of reconstructions.

    Attributes:
        rows: one a reconstruction, all scrambles with the same number of them, in order: the verdict on each claim in
            the columns ``code:ID``, and what was measured in ``value:ID``.
        u: (rows, dimensions) where each lies.
        names: of the dimensions.
        reaches: for each claim the dimensions that may change it.
        moved: rows in which each dimension is moved alone, of those with ``moved`` -1, with the verdicts on the claims
            that ``undecided`` names; empty for none.
    """

    rows: "pd.DataFrame"
    u: NDArray[np.float64]
    names: Sequence[str]
    reaches: Mapping[str, Sequence[int]]
    moved: "pd.DataFrame"

    def codes(self, claim: Entry) -> NDArray[np.int64]:
        """Return (scrambles, n) the verdict on a claim in each reconstruction."""
        return self._by_scramble(self.rows, claim)

    def holds(self, claim: Entry) -> BoolArray:
        """Return (scrambles, n) in which reconstructions a claim holds."""
        return held(self.codes(claim), claim.claim)

    def _by_scramble(self, rows: "pd.DataFrame", claim: Entry) -> NDArray[np.int64]:
        codes: NDArray[np.int64] = rows[f"code:{claim.name}"].to_numpy(np.int64).reshape(rows["scramble"].nunique(), -1)
        return codes

    def flips(self, claim: Entry) -> dict[str, Estimate]:
        """Return for each dimension with what probability moving it alone turns a claim; those that cannot left out."""
        found = {}
        if f"code:{claim.name}" in self.moved:
            first, *others = (
                held(self._by_scramble(self.moved[self.moved["moved"] == i], claim), claim.claim)
                for i in (-1, *self.reaches[claim.name])
            )
            for i, other in zip(self.reaches[claim.name], others, strict=True):
                if (first != other).any():
                    found[self.names[i]] = flip_probability(first, other)
        return found


class Shares(NamedTuple):
    """What many reconstructions say of one claim.

    Attributes:
        claim: the claim.
        all: the share of all reconstructions in which it holds.
        admissible: that of the admissible ones; None where being admissible implies it, or none are.
        conditioned: that of those which meet the printed numbers; None where the claim is one of these, or without any.
        fails: the share in which it fails, of those that the verdict goes by.
        untold: the share of these in which that cannot be told: without a case, or chaotic.
        without_case: the share in which it has no case, as of a robot that does not arrive.
        chaotic: the share in which a printed single run cannot be told from chance.
        flips: the probability that moving a dimension alone turns it, the largest first.
        bits: the dimension that tells most of it, and how much beside what chance would.
        pair: the two that together tell most, and how much [bit].
        associated: over admissible ones, the dimension of the largest PAWN index, and that beside what chance would.
        found: whether a search found one in which it holds.
    """

    claim: Entry
    all: Estimate
    admissible: Estimate | None
    conditioned: Estimate | None
    fails: Estimate
    untold: float
    without_case: float
    chaotic: float
    flips: dict[str, Estimate]
    bits: tuple[str, Null] | None
    pair: tuple[str, str, float] | None
    associated: tuple[str, Null] | None
    found: bool

    @property
    def told(self) -> Estimate:
        """The share that the verdict goes by: of admissible reconstructions where there are enough, else of all."""
        return _told(self.all, self.admissible)

    @property
    def verdict(self) -> str:
        """Robust, contradicted, open, out of reach where it holds in none that was drawn or found, or not testable."""
        return _verdict(self.told, self.fails, self.untold, self.all.value > 0.0 or self.found)

    @property
    def decided(self) -> str:
        """What decides an open claim: what most often turns it alone, else what tells most; empty where none does."""
        turning = next(iter(self.flips.items()), None)
        if self.verdict != "open":
            return ""
        if turning is not None and turning[1].low > 0.0:
            return turning[0]
        return self.bits[0] if self.bits is not None and self.bits[1].value > self.bits[1].p95 else ""


def shares_of(
    drawn: Drawn, claims: Sequence[Entry], multiverse: Multiverse, found: Collection[str] = ()
) -> list[Shares]:
    """Return what a sample says of each claim.

    Args:
        drawn: the sample.
        claims: the claims, and among them what makes a reconstruction admissible.
        multiverse: what the study says of it.
        found: the claims that hold in what a search found.
    """
    admissible = admissible_of(drawn, claims)
    meets = admissible & _meets(drawn.rows, {entry.name: entry.claim for entry in claims}, multiverse.conditioned)
    return [
        _shares(drawn, entry, admissible, meets, multiverse, entry.name in found)
        for entry in claims
        if entry.kind != KIND
    ]


def undecided(drawn: Drawn, claims: Sequence[Entry], multiverse: Multiverse) -> list[str]:
    """Return the claims of which it is asked what decides them: that hold in some reconstructions, not nearly all."""
    admissible = admissible_of(drawn, claims)
    found = []
    for entry in claims:
        holds = drawn.holds(entry)
        if entry.kind != KIND and 0 < holds.sum() < holds.size:
            counted = _counted(drawn, entry, admissible, entry.name in multiverse.implied)
            if CONTRADICTED < counted.all.value < ROBUST or _verdict(*counted[1:], found=True) == "open":
                found.append(entry.name)
    return found


def admissible_of(drawn: Drawn, claims: Sequence[Entry]) -> BoolArray:
    """Return (rows,) which reconstructions do all that makes them the paper's."""
    found = np.ones(len(drawn.rows), dtype=bool)
    for entry in claims:
        if entry.kind == KIND:
            found &= drawn.holds(entry).ravel()
    return found


def halves(drawn: Drawn, claim: Entry) -> float:
    """Return by how many standard errors a claim's share differs between the two halves of the scrambles."""
    shares = drawn.holds(claim).mean(axis=1)
    first, second = np.array_split(shares, 2)
    if len(second) < 2 or np.ptp(shares) == 0.0:
        return 0.0
    error = math.sqrt(first.var(ddof=1) / len(first) + second.var(ddof=1) / len(second))
    return float(abs(first.mean() - second.mean()) / error) if error else math.inf


def _shares(
    drawn: Drawn, entry: Entry, admissible: BoolArray, meets: BoolArray, multiverse: Multiverse, found: bool
) -> Shares:
    codes = drawn.codes(entry)
    flat = drawn.holds(entry).ravel()
    conditioned = multiverse.conditioned
    tested = conditioned is not None and entry.name not in (*conditioned.claims, *conditioned.leave_out)
    implied = entry.name in multiverse.implied
    varies = 0 < flat.sum() < flat.size
    flips = drawn.flips(entry) if varies else {}
    counted = _counted(drawn, entry, admissible, implied)
    associated = admissible if not implied and 0 < flat[admissible].sum() < admissible.sum() else None
    return Shares(
        claim=entry,
        all=counted.all,
        admissible=None if implied else _share(flat[admissible]),
        conditioned=_share(flat[meets]) if tested and not implied else None,
        fails=counted.fails,
        untold=counted.untold,
        without_case=float((codes == UNKNOWN).mean()),
        chaotic=float((codes == CHAOTIC).mean()),
        flips=dict(sorted(flips.items(), key=lambda item: -item[1].value)),
        bits=_most(drawn, entry.name, lambda x, rng: information_null(flat, x, rng)) if varies else None,
        pair=_pair(drawn, entry.name, flat) if varies else None,
        associated=None
        if associated is None
        else _most(drawn, entry.name, lambda x, rng: pawn_null(x[associated], flat[associated], rng)),
        found=found,
    )


def _told(of_all: Estimate, admissible: Estimate | None) -> Estimate:
    return admissible if admissible is not None and admissible.n >= CASES_MIN else of_all


class _Counted(NamedTuple):
    """In which share of all reconstructions a claim holds; and of those that the verdict goes by, as of ``Shares``."""

    all: Estimate
    told: Estimate
    fails: Estimate
    untold: float


def _counted(drawn: Drawn, entry: Entry, admissible: BoolArray, implied: bool) -> _Counted:
    codes, holds = drawn.codes(entry), drawn.holds(entry)
    untold = np.isin(codes, (CHAOTIC, UNKNOWN))
    fails, of_all = ~holds & ~untold, share_of_scrambles(holds)
    if implied or admissible.sum() < CASES_MIN:
        return _Counted(of_all, of_all, share_of_scrambles(fails), float(untold.mean()))
    told, failing = (clopper_pearson(int(of.ravel()[admissible].sum()), int(admissible.sum())) for of in (holds, fails))
    return _Counted(of_all, told, failing, float(untold.ravel()[admissible].mean()))


def _verdict(told: Estimate, fails: Estimate, untold: float, found: bool) -> str:
    if untold > 0.5:
        return "not testable"
    if not found:
        return "out of reach"
    return "robust" if told.low >= ROBUST else "contradicted" if fails.low >= 1.0 - CONTRADICTED else "open"


def _share(holds: BoolArray) -> Estimate | None:
    return clopper_pearson(int(holds.sum()), holds.size) if holds.size else None


def _meets(rows: "pd.DataFrame", claims: Mapping[str, Claim], conditioned: Conditioned | None) -> BoolArray:
    """Return which reconstructions meet the printed numbers."""
    meets = np.ones(len(rows), dtype=bool)
    if conditioned is not None:
        size, _ = quantity("within", conditioned.within)
        for name in conditioned.claims:
            printed = quantity("printed", claims[name].printed)[0]
            low, high = limits("printed", claims[name].printed)
            width = size / 100.0 * abs(printed)
            values = rows[f"value:{name}"].to_numpy()
            meets &= (values >= low - width) & (values <= high + width)
    return meets


def _most(
    drawn: Drawn, claim: str, null: Callable[[NDArray[np.float64], np.random.Generator], Null]
) -> tuple[str, Null] | None:
    """Return the dimension of the largest statistic, of those that may change a claim, and that beside chance."""
    rng = np.random.default_rng(SEED)
    found = {i: null(drawn.u[:, i], rng) for i in drawn.reaches[claim]}
    best = max(found, key=lambda i: found[i].value, default=None)
    return None if best is None else (drawn.names[best], found[best])


def _pair(drawn: Drawn, claim: str, y: BoolArray) -> tuple[str, str, float] | None:
    reached = list(drawn.reaches[claim])
    if len(reached) < 2:
        return None
    i, j, bits = best_pair(y, drawn.u[:, reached])
    return drawn.names[reached[i]], drawn.names[reached[j]], bits


def worth(shares: Sequence[Shares], drawn: Drawn) -> list[tuple[str, float]]:
    """Return each dimension's bits, summed over the claims, the most first; what chance would give is taken off."""
    total = dict.fromkeys(drawn.names, 0.0)
    for one in shares:
        y = drawn.holds(one.claim).ravel()
        if 0 < y.sum() < y.size:
            rng = np.random.default_rng(SEED)
            for i in drawn.reaches[one.claim.name]:
                null = information_null(y, drawn.u[:, i], rng)
                total[drawn.names[i]] += null.value if null.value > null.p95 else 0.0
    return sorted(total.items(), key=lambda item: -item[1])
