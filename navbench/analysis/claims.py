"""Claims: what a paper prints, how it is measured here, with what tolerance, and the verdict."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from navbench.mathematics.statistics import Estimate
from navbench.validation import STRICT, DescriptionError, Number, Positive

if TYPE_CHECKING:
    import pandas as pd

Verdict = Literal["reproduced", "partly", "not_reproduced", "not_testable"]
COLUMNS = (
    "id statement where printed unit measured low high n tolerance evidence verdict reason"  # of claims.csv
).split()
FITTED = {"reproduced": "it agrees", "partly": "it partly agrees"}


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Tolerance:
    """How far from the printed value counts as reproduced: one of the two.

    Attributes:
        relative: a share of the printed value.
        absolute: in the claim's unit.
    """

    relative: Positive | None = None
    absolute: Positive | None = None

    def __post_init__(self) -> None:
        """Check that exactly one is given."""
        if (self.relative is None) == (self.absolute is None):
            raise DescriptionError("tolerance: give either relative or absolute")

    def width(self, printed: float) -> float:
        """Return the tolerance in the claim's unit."""
        return self.absolute if self.absolute is not None else (self.relative or 0.0) * abs(printed)

    def __str__(self) -> str:
        """Return it as a reader would write it."""
        return f"±{self.relative * 100.0:g} %" if self.relative is not None else f"±{self.absolute:g}"


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Claim:
    """A number or statement that a paper prints.

    Attributes:
        id: what it is called in the report.
        statement: what the paper says, in our words.
        where: the table, figure, equation or section.
        printed: the printed number; 1 for a statement, of which the share of cases in which it holds is measured.
        unit: of the printed number; empty for a share or a ratio.
        measure: the name of a function in ``navbench.analysis.measures``, and its arguments.
        tolerance: set before the run: within it "reproduced", within twice it "partly".
        evidence: "free": nothing about it was chosen by looking at the figure; "selected": parameters were chosen
            among candidates by success in such worlds; "fitted": to this very figure; "layout_unknown": the paper
            draws the world without numbers.
    """

    id: Annotated[str, Field(min_length=1)]
    statement: str
    where: str
    printed: Number
    unit: str
    measure: Mapping[str, Any]
    tolerance: Tolerance
    evidence: Literal["free", "selected", "fitted", "layout_unknown"]


def verdict(claim: Claim, measured: Estimate | None) -> tuple[Verdict, str]:
    """Return the verdict on a claim and, where it does not speak for itself, the reason."""
    if measured is None or not math.isfinite(measured.value):
        compares = claim.measure.get("name") != "not_comparable"
        return "not_testable", "no case to measure it on" if compares else "not comparable, as the statement says"
    away = abs(measured.value - claim.printed)
    width = claim.tolerance.width(claim.printed)
    agrees = "reproduced" if away <= width else "partly" if away <= 2.0 * width else "not_reproduced"
    if claim.evidence == "fitted" and agrees != "not_reproduced":
        return "not_testable", f"{FITTED[agrees]}, but it was fitted to this figure"
    return agrees, ""  # type: ignore[return-value]


def judge(claims: Sequence[Claim], measured: Sequence[Estimate | None]) -> "pd.DataFrame":
    """Return the table of claims, as ``claims.csv`` holds it."""
    import pandas as pd

    rows = []
    for claim, found in zip(claims, measured, strict=True):
        value, low, high, n = found if found is not None else (math.nan, math.nan, math.nan, 0)
        decided, reason = verdict(claim, found)
        rows.append(
            [
                claim.id,
                claim.statement,
                claim.where,
                claim.printed,
                claim.unit,
                value,
                low,
                high,
                n,
                str(claim.tolerance),
                claim.evidence,
                decided,
                reason,
            ]
        )
    return pd.DataFrame(rows, columns=COLUMNS)
