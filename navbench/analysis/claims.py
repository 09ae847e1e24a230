"""Claims, checks and questions: what a paper prints or a study asks, and how it is measured here.

A study's ``claims`` are what a paper claims, or a hypothesis of the study's own. A *number* is ``printed`` and agrees
``within`` a tolerance, partly within twice that. A *statement* ``holds: in 95 % of the cases``, partly with twice as
many exceptions. A *hypothesis* ``holds: below 0`` or ``above 0``, and its interval decides: supported or contradicted
where all of it lies on one side, practically equal where it lies within a margin about that number, else undecided.

Its ``checks`` have the form of numbers and statements, but hold by construction: inputs copied from the paper, and
identities. They pass or fail, and count as no claims. Its ``questions`` are what the paper does not claim: they print
nothing and are judged by no print, at most as a hypothesis.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple

from pydantic.dataclasses import dataclass

from navbench.analysis.measuring import arguments, check_measure
from navbench.analysis.printed import NUMBER, quantity
from navbench.validation import STRICT, DescriptionError, describe, instead

TABLES = ("claims", "checks", "questions")  # of a study
HOLDS = "`in 95 % of the cases`, `below 0` or `above 0`"
COMPUTED = "evidence"  # once typed; results that were stored then still have it


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Claim:
    """What a paper prints or a study asks.

    Attributes:
        says: what is said, in our words.
        where: the paper's table, figure, equation or section.
        printed: the printed number with its unit and all its decimals, as ``37.10 s``; 0.30 means [0.295, 0.305).
        within: how far from it agrees: ``5 %`` of it, or a number in its unit.
        compare: with "distribution" a printed single run is held against the cases of a median: it agrees if it lies
            in their central 90 %, and they are not testable where that is wider than the tolerance to both sides. A
            statement on a single run is not testable where it holds in more than 5 % of the cases, but not in as many
            as it must: one run could have shown either.
        holds: of a statement in how many cases it must hold, of a hypothesis on which side of a number.
        practically_equal: of a hypothesis, what makes no difference: a number, or ``2 %`` of the other side's figure.
        measure: a function of ``navbench.analysis.measures``, or any by its dotted name; none where nothing compares.
        of: what it takes, and the cells.
        plausible: for some of these, what else might have been taken: the figure and the verdict are given for each.
    """

    says: str
    where: str = ""
    printed: int | float | str | None = None
    within: float | str | None = None
    compare: Literal["distribution"] | None = None
    holds: str | None = None
    practically_equal: float | str | None = None
    measure: str | None = None
    of: Mapping[str, Any] | None = None
    plausible: Mapping[str, tuple[Any, ...]] | None = None

    def __post_init__(self) -> None:
        """Check that it is of one kind, and that its numbers can be read."""
        if self.printed is not None and self.holds is not None:
            raise DescriptionError("must have either `printed` or `holds`")
        if (self.within is None) != (self.printed is None):
            raise DescriptionError("must have `within` beside `printed`, and only there")
        if self.compare and self.printed is None and self.share is None:
            raise DescriptionError("must have `compare` only beside `printed` or a share that `holds`")
        if self.plausible and self.measure is None:
            raise DescriptionError("must have `plausible` only beside `measure`")
        if missing := set(self.plausible or ()).difference(self.of or ()):
            name = min(missing)  # else nobody could say what is asked beside what is plausible
            raise DescriptionError(
                f"plausible.{name}: must stand in `of`, too; {instead(name, self.of or (), 'there')}"
            )
        if self.printed is not None:
            quantity("printed", self.printed)
            quantity("within", self.within)
        elif self.holds is not None and self.share is None and self.threshold is None:
            raise DescriptionError(f"holds={self.holds}: must be as {HOLDS}")
        if self.practically_equal is not None:
            self._check_margin(self.practically_equal)

    def _check_margin(self, margin: float | str) -> None:
        if self.threshold is None:
            raise DescriptionError("must have `practically_equal` only beside `holds: below` or `above` a number")
        size, unit = quantity("practically_equal", margin)
        if unit == "%" and self.measure != "difference":
            named = f"practically_equal={margin} with measure={self.measure}"
            allowed = instead(self.measure, ["difference"], "allowed with %")
            raise DescriptionError(f"{named}: must be a number, unless the measure is `difference`; {allowed}")
        if size <= 0.0:
            raise DescriptionError(f"practically_equal={margin}: must be above 0")

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
        if self.within is None:
            return self.holds or ""
        return f"±{self.within}" if isinstance(self.within, str) else f"±{self.within:g}"

    def variants(self) -> Iterator[tuple[str, Mapping[str, Any]]]:
        """Yield what else its measure might plausibly take: a name for it, and all that it takes then."""
        for word, values in (self.plausible or {}).items():
            for value in values:
                yield f"{word}={value}", {**(self.of or {}), word: value}


class Entry(NamedTuple):
    """A claim with its id and its kind: claim, hypothesis, check or question."""

    name: str
    kind: str
    claim: Claim


def entries(key: str, study: Mapping[str, Any], *, stored: bool = False) -> list[Entry]:
    """Return a study's claims, checks and questions.

    Args:
        key: where the study stands, for the error message, such as "study/aouf2019."; empty for stored results.
        study: with its tables.
        stored: whether it is of stored results, whose claims may still have a typed evidence.

    Raises:
        DescriptionError: one of them is wrong; the message names it.
    """
    found: dict[str, Entry] = {}
    for table in TABLES:
        rows = study.get(table) or {}
        if not isinstance(rows, Mapping):
            raise DescriptionError(f"{key}{table}: must be a mapping from ids; older results keep a list")
        for name, values in rows.items():
            place = f"{key}{table}.{name}"
            if name in found:
                raise DescriptionError(f"{place}: this id stands in another table too")
            if COMPUTED in values and not stored:
                raise DescriptionError(f"{place}.{COMPUTED}: unknown key; it is computed from the sources of the cells")
            claim = describe(Claim, {word: of for word, of in values.items() if word != COMPUTED}, place)
            found[name] = Entry(name, _kind(place, table, claim), claim)
    return list(found.values())


def check_claims(key: str, study: Mapping[str, Any], trust: bool = True, *, stored: bool = False) -> dict[str, Any]:
    """Return the arguments of each measure by table, after checking the tables and that the measures take them.

    What else is plausible stands beside: ``{"claims": {"band": {...}, "band.plausible.low=0.3": {...}}}``.

    Raises:
        DescriptionError: as ``entries`` and ``check_measure``.
    """
    asked: dict[str, Any] = {table: {} for table in TABLES}
    for name, kind, claim in entries(key, study, stored=stored):
        table = f"{kind}s" if f"{kind}s" in TABLES else "claims"
        if claim.measure is None:
            continue
        for what, of in [("", claim.of or {}), *((f".plausible.{what}", of) for what, of in claim.variants())]:
            place = f"{key}{table}.{name}{what}.measure"
            asked[table][f"{name}{what}"] = arguments(check_measure(place, claim.measure, of, trust=trust), of)
    return asked


def asked_by(claim: Claim, of: Mapping[str, Any] | None = None, key: str = "measure") -> dict[str, Any]:
    """Return the arguments of a claim's measure, checked.

    Args:
        claim: the claim, which has a measure.
        of: what that takes instead of the claim's own.
        key: where it stands, for the error message.
    """
    of = of if of is not None else claim.of or {}
    return arguments(check_measure(key, claim.measure or "", of, trust=True), of)


def _kind(place: str, table: str, claim: Claim) -> str:
    """Return the kind of what stands in a table, after checking that it may."""
    hypothesis = claim.threshold is not None
    if table == "questions":
        if claim.printed is not None or claim.share is not None or claim.measure is None:
            raise DescriptionError(f"{place}: a question has a measure, and neither `printed` nor a share that `holds`")
        return "question"
    if claim.printed is None and claim.holds is None:
        raise DescriptionError(f"{place}: must have either `printed` or `holds`")
    if table == "checks":
        if hypothesis:
            raise DescriptionError(
                f"{place}.holds={claim.holds}: a check is no hypothesis; allowed: in 100 % of the cases"
            )
        return "check"
    return "hypothesis" if hypothesis else "claim"
