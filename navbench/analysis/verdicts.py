"""Verdicts: what is claimed held against what was measured."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from navbench.analysis.claims import Claim, Entry, entries
from navbench.analysis.comparisons import level
from navbench.analysis.estimates import CENTRAL, Distribution
from navbench.analysis.evidence import evidence_of
from navbench.analysis.measuring import MeasureError, arguments, check_measure, measure
from navbench.analysis.printed import limits, parts, quantity
from navbench.analysis.stored import StoredResults, Used
from navbench.mathematics.statistics import Estimate

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = {  # of claims.csv, and what each holds
    "id": "the claim's name in its study",
    "kind": "claim, hypothesis, check or question",
    "statement": "what is said, or asked",
    "where": "where the paper says it",
    "printed": "the number that the paper prints",
    "unit": "its unit",
    "measured": "the figure here",
    "low": "the lower limit of its interval or range; empty without one",
    "high": "the upper limit",
    "n": "how many cases it rests on",
    "simulator": "in which simulator these ran",
    "tolerance": "within what the two agree",
    "plausible_low": "the least figure over what else is plausible for the measure; empty without any",
    "plausible_high": "the greatest",
    "depends_on": "which of these would turn the verdict",
    "evidence": "what an agreement is worth: free, layout_unknown, selected or fitted",
    "because": "the values that make it so",
    "verdict": "the verdict",
    "reason": "why, where it does not speak for itself",
}
VERDICTS = ("reproduced", "partly", "not_reproduced", "not_testable")
HYPOTHESIS_VERDICTS = ("supported", "contradicted", "practically_equal", "undecided")
CHECK_VERDICTS = ("passed", "failed")
COUNTED = ("claim", "hypothesis")  # of which it is told what an agreement is worth
AGREES = {"reproduced": "agrees", "partly": "partly agrees", "not_reproduced": "does not agree"}
FAILED = "not measured: "  # so begins the reason of a claim whose measure fails


class Measured(NamedTuple):
    """What was measured of a claim: as it asks, and at what else is plausible; or why it could not be."""

    figure: Estimate | None
    margin: float
    plausible: dict[str, Estimate | None]
    used: Used
    error: str = ""


def verdict(claim: Claim, measured: Estimate | None, margin: float = 0.0, evidence: str = "free") -> tuple[str, str]:
    """Return the verdict on a claim and, where it does not speak for itself, the reason.

    Args:
        claim: the claim.
        measured: what was measured of it; None without a case.
        margin: of a hypothesis, how far from its number makes no difference.
        evidence: what an agreement is worth; what was fitted to this figure cannot be tested by it, whether it agrees.
    """
    if measured is None or not math.isfinite(measured.value):
        return "not_testable", "no case to measure it on" if claim.measure else "not comparable, as the statement says"
    if claim.threshold is not None:
        return _decided(*claim.threshold, measured, margin), ""
    if claim.share is None and claim.printed is None:
        return "", ""
    agrees, reason = _compared(claim, measured)
    if evidence == "fitted" and agrees in AGREES:
        return "not_testable", f"fitted to this figure, with which it {AGREES[agrees]}"
    return agrees, reason


def _compared(claim: Claim, measured: Estimate) -> tuple[str, str]:
    """Return the verdict on a number or statement, and its reason."""
    if claim.share is not None:
        if claim.compare is not None and 0.5 * (1.0 - CENTRAL) < measured.value < claim.share:
            return "not_testable", f"chaotic: it holds in {100.0 * measured.value:.0f} % of {measured.n} cases"
        return _graded(abs(measured.value - 1.0), round(1.0 - claim.share, 12)), ""
    printed, (size, unit) = quantity("printed", claim.printed)[0], quantity("within", claim.within)
    width = size / 100.0 * abs(printed) if unit == "%" else size
    low, high = limits("printed", claim.printed)
    away = max(low - measured.value, measured.value - high, 0.0)
    if claim.compare is None:
        return _graded(away, width), ""
    _, least, most, n = measured
    if most - least > 2.0 * width:
        return "not_testable", f"chaotic: {100.0 * CENTRAL:.0f} % of {n} cases lie in [{least:.4g}, {most:.4g}]"
    agrees = high >= least and low <= most
    return "reproduced" if agrees else "partly" if away <= width else "not_reproduced", ""


def _graded(away: float, width: float) -> str:
    return "reproduced" if away <= width else "partly" if away <= 2.0 * width else "not_reproduced"


def _decided(side: str, number: float, measured: Estimate, margin: float) -> str:
    """Return the verdict on a hypothesis."""
    low, high = measured.low - number, measured.high - number
    if side == "above":
        low, high = -high, -low
    if -margin < low and high < margin:
        return "practically_equal"
    return "supported" if high < 0.0 else "contradicted" if low > 0.0 else "undecided"


def judged(stored: StoredResults, *, trust: bool = False) -> "pd.DataFrame":
    """Return the table of a study's claims, checks and questions with their verdicts, as ``claims.csv`` holds it.

    Args:
        stored: the study's results, with its claims.
        trust: whether measures outside ``navbench`` may be asked.
    """
    import pandas as pd

    of_study = entries("", stored.manifest["study"], stored=True)
    found = [_measured(stored, entry.claim, trust) for entry in of_study]
    told = list(zip(of_study, found, strict=True))
    evidence = evidence_of(
        stored.manifest, {entry.name: of.used for entry, of in told if entry.kind in COUNTED and of.figure is not None}
    )
    rows = [_row(entry, of, *evidence.get(entry.name, ("", ""))) for entry, of in told]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _measured(stored: StoredResults, claim: Claim, trust: bool) -> Measured:
    with stored.noting() as used:
        if claim.measure is None:
            return Measured(None, 0.0, {}, used)
        try:
            figure = figure_of(stored, claim, claim.of or {}, trust=trust)
            plausible = {what: figure_of(stored, claim, of, trust=trust) for what, of in claim.variants()}
            return Measured(figure, margin_of(stored, claim, trust=trust), plausible, used)
        except MeasureError as error:
            return Measured(None, 0.0, {}, used, f"{FAILED}{error}")


def figure_of(stored: StoredResults, claim: Claim, of: Mapping[str, Any], *, trust: bool) -> Estimate | None:
    """Return what is measured of a claim, of a distribution with the limits of its central cases; None without a case.

    Args:
        stored: the results.
        claim: the claim, which has a measure.
        of: what that takes, and the cells: the claim's own, or what else is plausible.
        trust: whether the measure may lie outside ``navbench``.

    Raises:
        MeasureError: the measure fails, or has no distribution to compare with.
    """
    found = measure(stored, claim.measure or "", of, trust=trust)
    if claim.compare is None or claim.share is not None or found is None:
        return found
    if not isinstance(found, Distribution):
        raise MeasureError(f"measure={claim.measure}: has no distribution to compare with; allowed: those of a median")
    return found.central


def _row(entry: Entry, of: Measured, evidence: str, because: str) -> list[Any]:
    """Return a row of ``claims.csv``."""
    name, kind, claim = entry
    word, reason = ("not_testable", of.error) if of.error else verdict(claim, of.figure, of.margin, evidence)
    others = {what: verdict(claim, figure, of.margin, evidence)[0] for what, figure in of.plausible.items()}
    depends_on = "; ".join(f"{other.replace('_', ' ')} at {what}" for what, other in others.items() if other != word)
    if kind == "check":
        word = "passed" if word == "reproduced" else "failed"
    printed, unit = ("", "") if claim.printed is None else parts("printed", claim.printed)
    figure = of.figure if of.figure is not None else (math.nan, math.nan, math.nan, 0)
    values = [one.value for one in (of.figure, *of.plausible.values()) if one is not None] if of.plausible else []
    low, high = (min(values), max(values)) if values else (math.nan, math.nan)
    simulators = ", ".join(sorted(of.used.simulators))
    said = [name, kind, claim.says, claim.where, printed, unit, *figure, simulators, claim.tolerance]
    return [*said, low, high, depends_on, evidence, because, word, reason]


def verdicts_in(table: "pd.DataFrame") -> tuple[str, ...]:
    """Return the verdicts that the claims of a table may have: of papers' claims, of hypotheses, or of both."""
    own = table["kind"] == "hypothesis"
    return (*(VERDICTS[-1:] if len(own) and own.all() else VERDICTS), *(HYPOTHESIS_VERDICTS if own.any() else ()))


def margin_of(stored: StoredResults, claim: Claim, *, trust: bool) -> float:
    """Return what makes no difference to a claim, in the unit of what is measured."""
    if claim.practically_equal is None or claim.measure is None:
        return 0.0
    size, unit = quantity("practically_equal", claim.practically_equal)
    if unit != "%":
        return size
    of = claim.of or {}
    asked = arguments(check_measure("measure", claim.measure, of, trust=trust), of)
    return size / 100.0 * abs(level(stored, asked["metric"], asked["than"]))
