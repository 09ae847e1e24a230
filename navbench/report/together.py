"""The reconstruction in which most printed numbers hold together, as a multiverse's report tells it."""

from collections.abc import Mapping, Sequence
from typing import Any

from navbench.analysis.fitting import Fit
from navbench.report.document import Block, Column, Heading, Paragraph, Table
from navbench.report.multiverse_results import MultiverseResults
from navbench.report.shares import central, word_of

Worth = Sequence[tuple[str, float]]  # dimensions with their bits, as ``worth`` tells them
ASSUMED_MAX = 6  # values of the best reconstruction that its sentence names
APPLIED = {"scale": "x {:.4g}", "step": "{:+.4g}"}  # what a vector is multiplied by, or what is added to it
LISTED_MAX = 40  # characters of choices that a table lists; of longer ones it gives the number


def point(told: MultiverseResults, best: Fit) -> dict[str, Any]:
    """Return where the best reconstruction lies and what holds there, for ``reconstruction=best`` of a study."""
    names = [factor.name for factor in told.factors]
    return {
        "seed": told.prior["seed"],
        "search": told.search._asdict(),
        "claims": [entry.name for entry in best.claims],
        "holds": [entry.name for entry, holds in zip(best.claims, best.holds, strict=True) if holds],
        "point": dict(zip(names, map(float, best.u), strict=False)),
    }


def together(told: MultiverseResults, best: Fit) -> str:
    """Return in one sentence how many printed numbers hold at once, and how many of placebo tables."""
    search, count = told.search, int(best.holds.sum())
    searched = f"a search of {search.evaluations} evaluations over {search.free} values finds"
    found = searched if search.evaluations else "the sample has"
    held = [entry.name for entry, holds in zip(best.claims, best.holds, strict=True) if holds]
    wide = len(set(held).difference(told.holds_at_best))
    scattered = f", {wide} of them by the median of starts that scatter by more than the tolerance" if wide else ""
    placebos, predicts = best.placebos, int(best.predicts.sum())
    as_many = int((placebos >= count).sum())
    worth = "the reconstruction fits the paper better than chance"
    if as_many:
        worth = f"as many hold in {as_many} of these, so that it fits the paper hardly better than chance"
    return (
        f"In the best reconstruction that {found}, {count} of {len(best.claims)} printed numbers hold at once"
        f"{scattered}; of {len(placebos)} placebo tables, with the same numbers permuted, {placebos.min()} to "
        f"{placebos.max()}: {worth}. Of those left out in turn, the reconstruction that meets the others best "
        f"predicts {predicts}."
    )


def fitted(told: MultiverseResults, ranked: Worth) -> list[Block]:
    """Return each printed number beside what is measured, and what must be assumed for the best of them."""
    best = told.best
    if best is None:
        return []
    columns = [
        Column("claim", "id"),
        Column("printed", "printed"),
        Column("here", "here"),
        Column("admissible", "admissible"),
        Column("at best", "value"),
        Column("holds", "holds"),
        Column("predicted by the others", "predicted"),
        Column("holds", "predicts"),
    ]
    words, rows = {True: "yes", False: "no"}, []
    asked = {entry.name: k for k, entry in enumerate(best.claims)}
    for entry in (entry for entry in told.claims if entry.claim.printed is not None):
        k, name = asked.get(entry.name), entry.name
        row = [name, str(entry.claim.printed), told.measured.get(name), central(told.drawn, entry, told.admissible)]
        if k is None:
            rows.append([*row, told.at_best[name][1], words[name in told.holds_at_best], None, None])
        else:
            met, predicted = words[bool(best.holds[k])], words[bool(best.predicts[k])]
            rows.append([*row, best.values[k], met, best.predicted[k], predicted])
    text = (
        "The printed numbers: *here*, in the simulator and from the starts of the study's own report; the median and "
        "the central 90 % of the admissible reconstructions; *at best*, in the one that meets most of the "
        f"{len(asked)} that do not follow from others; and each of these as the reconstruction has it that meets the "
        f"others best, found in the same way. At best the median over up to {told.search.starts} starts within a "
        "millimetre must lie within the tolerance; whether these scatter by more is told above."
        f"{_assumed(told, best, ranked)}"
    )
    return [Heading("The printed numbers together"), Paragraph(text), Table("together", columns, rows)]


def _assumed(told: MultiverseResults, best: Fit, ranked: Worth) -> str:
    """Return what the best reconstruction has, of the values that move these numbers, as a sentence after another."""
    moves = {told.drawn.names[i] for entry in best.claims for i in told.drawn.reaches[entry.name]}
    names, values = [name for name, _ in ranked if name in moves][:ASSUMED_MAX], at_best_of(told, best)
    if not names:
        return ""
    return (
        f" To meet most it takes {', '.join(f'`{name}` {values[name]}' for name in names)}: of the values that move "
        "these numbers those on which the claims depend most. All stand under *What the paper leaves open*."
    )


def at_best_of(told: MultiverseResults, best: Fit) -> dict[str, str]:
    """Return what each dimension is in the best reconstruction, by its name: of a group its first value.

    Vectors are told as their source moves them, by a factor or a step; a long choice by its number.
    """
    factors, choices, found = {factor.name: factor for factor in told.factors}, told.choices, {}
    for name, u in zip(told.drawn.names, best.u.tolist(), strict=True):
        if not choices[name]:
            factor = factors[name]
            found[name] = APPLIED.get(factor.source.apply or "", "{:.4g}").format(factor.at(u))
            continue
        number = min(int(u * len(choices[name])), len(choices[name]) - 1)
        choice = choices[name][number]
        word = None if isinstance(choice, list | tuple | Mapping) else listed([choice])
        found[name] = f"no. {number + 1} of {len(choices[name])}" if word is None else word
    return found


def listed(choices: Sequence[Any]) -> str | None:
    """Return some choices as words; None where they are too long."""
    words = ", ".join(map(word_of, choices))
    return words if len(words) <= LISTED_MAX else None
