"""The chromosome of zhao2018: which numbers and rules of OA-FLC evolve, and how a broken one is mended.

R. Zhao, H.-K. Lee, "Intelligent Navigation Algorithm for Mobile Robots based on Optimized Fuzzy Logic", Journal of
IKEEE 22, 2018; section III, Figure 3 and Table 2.

A chromosome holds the 58 numbers that draw the fuzzy sets, 10 of R, 22 of Phi and 13 of each wheel, and the 64 cells of
the rule table, as numbers of the wheel's sets. Crossover and mutation leave sets that no fuzzy controller can have: a
peak beyond its foot or beyond the next peak, a gap in which nothing fires. The paper does not say what happens to them;
here they are mended, by the least that makes them sets again, and what is sound is not touched.

Errata of the paper, corrected here: its Figure 3 gives the last set of a variable a peak and a right foot, where only
the left one is left to draw; there are 4, 8, 5 and 5 linguistic values, not five each; its "bits" are real numbers; and
Table 2 codes the cells M, RF and M, F of v_L by 5, which are NB, 1, in its Table 1. The codes 1 to 5 count from 0 here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import get_type_hints

from ..zhao2017.sets import DANGERS, DIRECTIONS, SPEEDS, UNIVERSES, OaMemberships, Universe

GAP = 0.01  # of a variable's range, assumed: between peaks, and from a peak to its feet; neighbours overlap by half
SLACK = 1.0 - 1e-9  # a gap that rounding has made this much narrower is whole

RULE_GENES = tuple(f"oa_rules.{wheel}.{r}.{phi}" for wheel in ("vL", "vR") for r in DANGERS for phi in DIRECTIONS)


def _corners() -> dict[str, list[tuple[str, ...]]]:
    """Return, for each variable, the names of each set's genes, in the order of Figure 3."""
    return {
        variable: [
            tuple(f"oa_memberships.{variable}.{name}.{corner.name}" for corner in fields(one))
            for name, one in get_type_hints(sets).items()
        ]
        for variable, sets in get_type_hints(OaMemberships).items()
    }


CORNERS = _corners()
MEMBERSHIP_GENES = tuple(gene for sets in CORNERS.values() for genes in sets for gene in genes)


class Repair:
    """Mends a chromosome; what is sound stays as it is, to the last bit, and so does what was mended."""

    def __call__(self, genes: Mapping[str, float]) -> dict[str, float]:
        """Return the mended genes, in the same order.

        Peaks are sorted and kept apart, each foot is put on its side of the peak and no further than the second
        peak from there, neighbours that do not overlap are drawn together, and rules become whole numbers of a set.

        Args:
            genes: by dotted name below ``build``: numbers of the fuzzy sets, all of a variable or none of it, and rules
                as numbers from 0 of ``zhao2017_sets.SPEEDS``.

        Raises:
            ValueError: a gene is unknown, or some of a variable's are missing.
        """
        mended = dict(genes)
        unknown = sorted(set(genes) - set(MEMBERSHIP_GENES) - set(RULE_GENES))
        if unknown:
            raise ValueError(f"{unknown[0]}: is no gene of OA-FLC")
        for variable, sets in CORNERS.items():
            names = [gene for corners in sets for gene in corners]
            missing = [gene for gene in names if gene not in genes]
            if missing and len(missing) < len(names):
                raise ValueError(f"{missing[0]}: missing; the fuzzy sets of {variable} can only be mended together")
            if not missing:
                mended.update(_mended(sets, genes, UNIVERSES[variable]))
        for gene in RULE_GENES:
            if gene in genes:
                mended[gene] = min(max(round(genes[gene]), 0), len(SPEEDS) - 1)
        return mended


def _mended(sets: Sequence[tuple[str, ...]], genes: Mapping[str, float], universe: Universe) -> dict[str, float]:
    """Return a variable's genes, mended."""
    low, high, circular = universe
    gap = GAP * (high - low)
    peak_of = [next(gene for gene in corners if gene.endswith(".c")) for corners in sets]
    # on a circle the first and the last peak are neighbours too
    peaks = spread([genes[gene] for gene in peak_of], low + gap if circular else low, high, gap)
    lefts = [left_foot(genes[sets[i][0]], peaks[i], peaks[i - 2] if i >= 2 else low, gap) for i in range(1, len(sets))]
    rights = [
        right_foot(genes[sets[i][-1]], peaks[i], peaks[i + 2] if i + 2 < len(sets) else high, gap)
        for i in range(len(sets) - 1)
    ]
    mended = dict(zip(peak_of, peaks, strict=True))
    for i, (right, left) in enumerate(zip(rights, lefts, strict=True)):
        mended[sets[i][-1]], mended[sets[i + 1][0]] = overlapping(right, left, 0.5 * gap)
    return mended


def spread(peaks: Sequence[float], low: float, high: float, gap: float) -> list[float]:
    """Return the peaks within the range, ascending and at least a gap apart; those that are so are left as given."""
    at = sorted(min(max(peak, low), high) for peak in peaks)
    for i in range(1, len(at)):
        if at[i] - at[i - 1] < SLACK * gap:
            at[i] = at[i - 1] + gap
    at[-1] = min(at[-1], high)
    for i in reversed(range(len(at) - 1)):
        if at[i + 1] - at[i] < SLACK * gap:
            at[i] = at[i + 1] - gap
    return at


def left_foot(foot: float, peak: float, furthest: float, gap: float) -> float:
    """Return a left foot at least a gap below its peak and not below the furthest place that it may have."""
    return max(foot if peak - foot >= SLACK * gap else peak - gap, furthest)


def right_foot(foot: float, peak: float, furthest: float, gap: float) -> float:
    """Return a right foot at least a gap above its peak and not above the furthest place that it may have."""
    return min(foot if foot - peak >= SLACK * gap else peak + gap, furthest)


def overlapping(right: float, left: float, least: float) -> tuple[float, float]:
    """Return the right foot of a set and the left foot of the next one, which lies at least this far below it."""
    if right - left >= SLACK * least:
        return right, left
    middle = 0.5 * (right + left)
    return middle + 0.5 * least, middle - 0.5 * least
