"""The reconstruction in which most printed numbers hold together, as a multiverse's report tells it."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from navbench.analysis.fitting import Fit
from navbench.report.document import Block, Column, Heading, Paragraph, Table
from navbench.report.shares import central

if TYPE_CHECKING:
    from navbench.report.multiverse import Search, Told

Worth = Sequence[tuple[str, float]]  # dimensions with their bits, as ``worth`` tells them
ASSUMED_MAX = 6  # values of the best reconstruction that its sentence names
LISTED_MAX = 40  # characters of choices that a table lists; of longer ones it gives the number


def point(told: "Told", best: Fit) -> dict[str, Any]:
    """Return where the best reconstruction lies and what holds there, for ``reconstruction=best`` of a study."""
    names = [factor.name for factor in told.factors]
    return {
        "seed": told.prior["seed"],
        "search": told.search._asdict(),
        "claims": [entry.name for entry in best.claims],
        "holds": [entry.name for entry, holds in zip(best.claims, best.holds, strict=True) if holds],
        "point": dict(zip(names, map(float, best.u), strict=False)),
    }


def together(best: Fit, search: "Search") -> str:
    """Return in one sentence how many printed numbers hold at once, and how many of placebo tables."""
    searched = f"a search of {search.evaluations} evaluations over {search.free} values finds"
    found = searched if search.evaluations else "the sample has"
    held, placebos, predicts = int(best.holds.sum()), best.placebos, int(best.predicts.sum())
    beaten = int((placebos < held).sum())
    worth = "the reconstruction fits the paper better than chance"
    if beaten < len(placebos):
        worth = (
            f"as many hold in {len(placebos) - beaten} of these, so that it fits the paper hardly better than chance"
        )
    return (
        f"In the best reconstruction that {found}, {held} of {len(best.claims)} printed numbers hold at once; of "
        f"{len(placebos)} placebo tables, with the same numbers permuted, {placebos.min()} to {placebos.max()}: "
        f"{worth}. "
        f"Of those left out in turn, the reconstruction that meets the others best predicts {predicts}."
    )


def fitted(told: "Told", ranked: Worth) -> list[Block]:
    """Return each printed number beside what is measured, and what must be assumed for the best of them."""
    best = told.best
    if best is None:
        return []
    columns = [
        Column("claim", "id"),
        Column("printed", "printed"),
        Column("here", "here"),
        Column("90 % of the admissible", "admissible"),
        Column("at best", "value"),
        Column("holds", "holds"),
        Column("predicted by the others", "predicted"),
        Column("holds", "predicts"),
    ]
    words, admissible = {True: "yes", False: "no"}, told.admissible
    rows = []
    for entry, value, holds, predicted, predicts in zip(
        best.claims, best.values, best.holds, best.predicted, best.predicts, strict=True
    ):
        band = central(told.drawn, entry, admissible)
        between = band and " to ".join(f"{end:.4g}" for end in band)
        at_best = [value, words[bool(holds)], predicted, words[bool(predicts)]]
        rows.append([entry.name, str(entry.claim.printed), told.measured.get(entry.name), between, *at_best])
    text = (
        "The printed numbers that do not follow from each other: in the study's own results (*here*), in the central "
        "90 % of the admissible reconstructions, in the one that meets most of them; and "
        "each as the reconstruction has it that meets the others best, found in the same way. At best the median over "
        f"up to {told.search.starts} starts within a millimetre must lie within the tolerance; whether these scatter "
        f"by more is told above. {_assumed(told, best, ranked)}"
    )
    return [Heading("The printed numbers together"), Paragraph(text), Table("together", columns, rows)]


def _assumed(told: "Told", best: Fit, ranked: Worth) -> str:
    """Return what must be assumed for the best reconstruction, by the values on which the verdicts depend most."""
    values = at_best_of(told, best)
    names = [name for name, _ in ranked if name in values][:ASSUMED_MAX]
    return (
        f"For the one that meets most must be assumed, among others: {', '.join(f'`{n}` {values[n]}' for n in names)}; "
        "its other values stand under *What the paper leaves open*."
    )


def at_best_of(told: "Told", best: Fit) -> dict[str, str]:
    """Return what each dimension that moves a printed number is in the best reconstruction, by its name.

    A long choice is told by its number.
    """
    factors, choices, found = {factor.name: factor for factor in told.factors}, told.choices, {}
    for i in sorted({i for entry in best.claims for i in told.drawn.reaches[entry.name]}):
        name, u = told.drawn.names[i], float(best.u[i])
        if name in factors and not factors[name].choices:
            found[name] = f"{factors[name].at(u):.3g}"
            continue
        number = min(int(u * len(choices[name])), len(choices[name]) - 1)
        word = listed([choices[name][number]], "off" if name in factors else "unset")
        found[name] = word or f"no. {number + 1} of {len(choices[name])}"
    return found


def listed(choices: Sequence[Any], missing: str) -> str | None:
    """Return some choices as words, the missing one by its own; None where they are too long."""
    words = ", ".join(missing if choice is None else str(choice) for choice in choices)
    return words if len(words) <= LISTED_MAX else None
