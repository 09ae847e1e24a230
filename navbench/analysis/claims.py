"""Claims: what a paper prints or a study asks, how it is measured here, and the verdict.

There are three kinds. A *number* is ``printed`` and agrees ``within`` a tolerance, partly within twice that. A
*statement* ``holds: in 95 % of the cases``, partly with twice as many exceptions. A *hypothesis* ``holds: below 0`` or
``above 0``, and its interval decides: supported or contradicted where all of it lies on one side, practically equal
where it lies within a margin about that number, else undecided.
"""

import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

from pydantic.dataclasses import dataclass

from navbench.analysis.comparisons import level
from navbench.analysis.measuring import MeasureError, arguments, check_measure, measure
from navbench.analysis.stored import StoredResults
from navbench.mathematics.statistics import Estimate
from navbench.validation import STRICT, DescriptionError, describe, instead

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = (
    "id statement where printed unit measured low high n simulator tolerance evidence verdict reason"  # of claims.csv
).split()
VERDICTS = ("reproduced", "partly", "not_reproduced", "not_testable")
HYPOTHESIS_VERDICTS = ("supported", "contradicted", "practically_equal", "undecided")
EVIDENCE = ("free", "selected", "fitted", "layout_unknown")
FITTED = {"reproduced": "it agrees", "partly": "it partly agrees"}
FAILED = "not measured: "  # so begins the reason of a claim whose measure fails
NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
HOLDS = "`in 95 % of the cases`, `below 0` or `above 0`"


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Claim:
    """A number or statement that a paper prints, or a hypothesis of a study's own.

    Attributes:
        says: what is said, in our words.
        where: the paper's table, figure, equation or section.
        printed: the printed number with its unit, as ``37.1 s``.
        within: set before the run, how far from it agrees: ``5 %`` of it, or a number in its unit.
        holds: of a statement in how many cases it must hold, of a hypothesis on which side of a number.
        practically_equal: of a hypothesis, what makes no difference: a number, or ``2 %`` of the other side's figure.
        measure: a function of ``navbench.analysis.measures``, or any by its dotted name; none where nothing compares.
        of: what it takes, and the cells.
        evidence: "free": nothing about it was chosen by looking at the figure; "selected": parameters were chosen
            among candidates by success in such worlds; "fitted": to this very figure; "layout_unknown": the paper
            draws the world without numbers. A hypothesis has none.
    """

    says: str
    where: str = ""
    printed: float | str | None = None
    within: float | str | None = None
    holds: str | None = None
    practically_equal: float | str | None = None
    measure: str | None = None
    of: Mapping[str, Any] | None = None
    evidence: Literal["free", "selected", "fitted", "layout_unknown"] | None = None

    def __post_init__(self) -> None:
        """Check that it is of one kind, and that its numbers can be read."""
        if (self.printed is None) == (self.holds is None):
            raise DescriptionError("must have either `printed` or `holds`")
        if (self.within is None) != (self.printed is None):
            raise DescriptionError("must have `within` beside `printed`, and only there")
        if self.printed is not None:
            quantity("printed", self.printed)
            quantity("within", self.within)
        elif self.share is None and self.threshold is None:
            raise DescriptionError(f"holds={self.holds}: must be as {HOLDS}")
        if (self.evidence is None) == (self.threshold is None):
            raise DescriptionError(f"must have `evidence`, one of {', '.join(EVIDENCE)}, unless it is a hypothesis")
        if self.practically_equal is not None:
            if self.threshold is None:
                raise DescriptionError("must have `practically_equal` only beside `holds: below` or `above` a number")
            if quantity("practically_equal", self.practically_equal)[1] == "%" and self.measure != "difference":
                named = f"practically_equal={self.practically_equal} with measure={self.measure}"
                allowed = instead(self.measure, ["difference"], "allowed with %")
                raise DescriptionError(f"{named}: must be a number, unless the measure is `difference`; {allowed}")
            if quantity("practically_equal", self.practically_equal)[0] <= 0.0:
                raise DescriptionError(f"practically_equal={self.practically_equal}: must be above 0")

    @property
    def share(self) -> float | None:
        """In how many cases a statement must hold; None of the other kinds."""
        found = re.fullmatch(rf"in ({NUMBER}) % of the cases", self.holds or "")
        return float(found[1]) / 100.0 if found else None

    @property
    def threshold(self) -> tuple[str, float] | None:
        """The side and the number of a hypothesis; None of the other kinds."""
        found = re.fullmatch(rf"(below|above) ({NUMBER})", self.holds or "")
        return (found[1], float(found[2])) if found else None

    @property
    def tolerance(self) -> str:
        """What decides, as a reader would write it."""
        return self.holds or f"±{self.within:g}" if not isinstance(self.within, str) else f"±{self.within}"


def quantity(key: str, value: Any) -> tuple[float, str]:
    """Return a number and its unit, of ``37.1 s`` or a number alone.

    Raises:
        DescriptionError: it is neither.
    """
    found = re.fullmatch(rf"({NUMBER})(?: (\S.*))?", str(value))
    if found is None:
        raise DescriptionError(f"{key}={value}: must be a number, or one with its unit as `37.1 s` or `5 %`")
    return float(found[1]), found[2] or ""


def claims_of(key: str, table: Mapping[str, Any] | None) -> dict[str, Claim]:
    """Return the claims of a study's table, by id.

    Raises:
        DescriptionError: one of them is wrong; the message names it.
    """
    if not isinstance(table or {}, Mapping):
        raise DescriptionError(f"{key}: must be a mapping from ids to claims; older results keep them as a list")
    return {name: describe(Claim, claim, f"{key}.{name}") for name, claim in (table or {}).items()}


def check_claims(key: str, table: Mapping[str, Any] | None, trust: bool = True) -> dict[str, dict[str, Any]]:
    """Return the arguments of each claim's measure, after checking the table, and that its measures take them.

    Raises:
        DescriptionError: as ``claims_of`` and ``check_measure``.
    """
    asked = {}
    for name, claim in claims_of(key, table).items():
        if claim.measure is not None:
            of = claim.of or {}
            asked[name] = arguments(check_measure(f"{key}.{name}.measure", claim.measure, of, trust=trust), of)
    return asked


def verdict(claim: Claim, measured: Estimate | None, margin: float = 0.0) -> tuple[str, str]:
    """Return the verdict on a claim and, where it does not speak for itself, the reason.

    Args:
        claim: the claim.
        measured: what was measured of it; None without a case.
        margin: of a hypothesis, how far from its number makes no difference.
    """
    if measured is None or not math.isfinite(measured.value):
        return "not_testable", "no case to measure it on" if claim.measure else "not comparable, as the statement says"
    if claim.threshold is not None:
        return _decided(*claim.threshold, measured, margin), ""
    if claim.share is not None:
        away, width = abs(measured.value - 1.0), round(1.0 - claim.share, 12)
    else:
        printed, (size, unit) = quantity("printed", claim.printed)[0], quantity("within", claim.within)
        away, width = abs(measured.value - printed), size / 100.0 * abs(printed) if unit == "%" else size
    agrees = "reproduced" if away <= width else "partly" if away <= 2.0 * width else "not_reproduced"
    if claim.evidence == "fitted" and agrees != "not_reproduced":
        return "not_testable", f"{FITTED[agrees]}, but it was fitted to this figure"
    return agrees, ""


def judged(stored: StoredResults, *, trust: bool = False) -> "pd.DataFrame":
    """Return the table of a study's claims with their verdicts, with the columns of ``claims.csv``.

    Args:
        stored: the study's results, with its claims.
        trust: whether measures outside ``navbench`` may be asked.
    """
    import pandas as pd

    rows = []
    for name, claim in claims_of("claims", stored.manifest["study"]["claims"]).items():
        with stored.noting() as noted:
            try:
                found = measure(stored, claim.measure, claim.of or {}, trust=trust) if claim.measure else None
                decided = verdict(claim, found, _margin(stored, claim, trust))
            except MeasureError as error:
                found, decided = None, ("not_testable", f"{FAILED}{error}")
        printed, unit = (math.nan, "") if claim.printed is None else quantity("printed", claim.printed)
        figures = found if found is not None else (math.nan, math.nan, math.nan, 0)
        said = name, claim.says, claim.where, printed, unit
        simulators = ", ".join(sorted({simulator for simulator, _ in noted}))
        rows.append([*said, *figures, simulators, claim.tolerance, claim.evidence or "", *decided])
    return pd.DataFrame(rows, columns=COLUMNS)


def verdicts_in(table: "pd.DataFrame") -> tuple[str, ...]:
    """Return the verdicts that the claims of a table may have: of papers' claims, of hypotheses, or of both."""
    own = table["evidence"] == ""
    return (*(VERDICTS[-1:] if len(own) and own.all() else VERDICTS), *(HYPOTHESIS_VERDICTS if own.any() else ()))


def _decided(side: str, number: float, measured: Estimate, margin: float) -> str:
    """Return the verdict on a hypothesis."""
    low, high = measured.low - number, measured.high - number
    if side == "above":
        low, high = -high, -low
    if -margin < low and high < margin:
        return "practically_equal"
    return "supported" if high < 0.0 else "contradicted" if low > 0.0 else "undecided"


def _margin(stored: StoredResults, claim: Claim, trust: bool) -> float:
    """Return what makes no difference, in the unit of what is measured."""
    if claim.practically_equal is None or claim.measure is None:
        return 0.0
    size, unit = quantity("practically_equal", claim.practically_equal)
    if unit != "%":
        return size
    of = claim.of or {}
    asked = arguments(check_measure("measure", claim.measure, of, trust=trust), of)
    return size / 100.0 * abs(level(stored, asked["metric"], asked["than"]))
