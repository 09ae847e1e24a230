"""Figures of shares, in how many reconstructions claims hold, and the shares that a report holds."""

import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.claims import Entry
from navbench.analysis.fitting import Fit
from navbench.analysis.printed import tolerated
from navbench.analysis.shares import CASES_MIN, CONTRADICTED, ROBUST, Drawn, Shares
from navbench.experiments.schema import LONGEST
from navbench.mathematics.statistics import Estimate, clopper_pearson
from navbench.reading import bounded
from navbench.report.figures import PALETTE
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

VERDICTS = {  # with their colours
    "robust": PALETTE[2],
    "open": PALETTE[5],
    "contradicted": PALETTE[0],
    "out of reach": PALETTE[3],
    "not testable": "#999999",
}
SLICES = 8  # of a value's range, over which a share is told
NUMBER_MAX = 8  # characters of a choice that is a number; longer ones are rounded
NAMED_MAX = 24  # characters of all choices together if they are named; longer ones are numbered in their order


def read_shares(folder: Path) -> "pd.DataFrame":
    """Return in which share of its multiverse's reconstructions each claim of a study holds; no rows without one."""
    table = read_told(folder, "shares", ("id", "verdict"), "share")
    if wrong := set(table["verdict"]).difference(VERDICTS):
        raise DescriptionError(f"{folder / 'tables/shares.csv'}: verdict={wrong.pop()}; allowed: {', '.join(VERDICTS)}")
    return table


def read_told(folder: Path, name: str, words: Sequence[str], number: str = "") -> "pd.DataFrame":
    """Return a table of a report on a multiverse; no rows without one.

    Args:
        folder: of the report.
        name: of the table.
        words: columns that it must have.
        number: one more, which must be of numbers.
    """
    import pandas as pd

    file, columns = folder / "tables" / f"{name}.csv", [*words, *([number] if number else [])]
    if not file.is_file():
        return pd.DataFrame(columns=columns)
    table = pd.read_csv(io.BytesIO(bounded(file, LONGEST)))
    if not set(columns) <= set(table) or number and len(table) and table[number].dtype.kind not in "fi":
        of_numbers = f" of words and {number} of numbers" if number else ""
        raise DescriptionError(f"{file}: must have columns {' and '.join(words)}{of_numbers}")
    return table


def chart(shares: Sequence[Shares], verdicts: Mapping[str, str]) -> "Figure":
    """Return each claim's share with its interval, the largest on top.

    Args:
        shares: of the claims.
        verdicts: of the claims in the study's own results, by their names.
    """
    from matplotlib.figure import Figure

    ordered = sorted(shares, key=lambda one: (one.told.value, one.all.value))
    figure = Figure(figsize=(8.0, 1.2 + 0.2 * len(ordered)), layout="constrained")
    axes = figure.subplots()
    for y, one in enumerate(ordered):
        colour = VERDICTS[one.verdict]
        axes.plot([one.all.low, one.all.high], [y, y], color=colour, lw=2, solid_capstyle="butt")
        here = verdicts.get(one.claim.name) in ("reproduced", "supported")
        axes.plot(one.all.value, y, "o", color=colour, mfc=colour if here else "white", ms=5)
        if one.admissible is not None:
            axes.plot(one.admissible.value, y, "|", color="#222222", ms=9, mew=1.5)
    axes.set_yticks(range(len(ordered)), [one.claim.name for one in ordered], fontsize=7)
    axes.set(xlim=(-0.02, 1.02), ylim=(-0.7, len(ordered) - 0.3), xlabel="share of reconstructions in which it holds")
    for x in (0.05, 0.95):
        axes.axvline(x, color="#bbbbbb", lw=0.8, zorder=0)
    axes.grid(axis="y", color="#eeeeee", lw=0.6)
    axes.set_axisbelow(True)
    for word, colour in VERDICTS.items():
        if any(one.verdict == word for one in shares):
            axes.plot([], [], "o", color=colour, label=word)
    axes.plot([], [], "o", color="#777777", mfc="white", label="does not hold in the study's own results")
    axes.plot([], [], "|", color="#222222", ms=9, mew=1.5, label="share of the admissible ones")
    figure.legend(loc="outside lower center", ncols=3, fontsize=7, frameon=False)
    return figure


def curves(
    drawn: Drawn, shares: Sequence[Shares], choices: Mapping[str, Sequence[Any]], ends: Mapping[str, Sequence[float]]
) -> "Figure":
    """Return for each claim the share in which it holds over the range, or the choices, of the value that tells most.

    Args:
        drawn: the sample.
        shares: of the claims.
        choices: those of each value that has no range, by its name.
        ends: of each value's range.
    """
    from matplotlib.figure import Figure

    columns = min(3, len(shares))
    rows = math.ceil(len(shares) / columns)
    figure = Figure(figsize=(3.0 * columns, 2.6 * rows), layout="constrained")
    grid = np.atleast_1d(figure.subplots(rows, columns, sharey=True)).ravel()
    for axes, one in zip(grid, shares, strict=False):
        assert one.bits is not None
        name = one.bits[0]
        _curve(axes, drawn, one, name, choices.get(name, ()), ends.get(name, ()))
    for axes in grid[len(shares) :]:
        axes.set_visible(False)
    figure.supylabel("share in which it holds", fontsize=9)
    return figure


def _curve(axes: "Axes", drawn: Drawn, one: Shares, name: str, choices: Sequence[Any], ends: Sequence[float]) -> None:
    count = len(choices) or SLICES
    places = np.minimum((drawn.u[:, list(drawn.names).index(name)] * count).astype(int), count - 1)
    holds = drawn.holds(one.claim).ravel()
    order = sorted_choices(choices) if choices else range(count)
    slices = [holds[places == k] for k in order]
    found = [clopper_pearson(int(held.sum()), held.size) for held in slices]
    x = (np.arange(count) + 0.5) / count
    values = np.array([estimate.value for estimate in found])
    errors = [[e.value - e.low for e in found], [e.high - e.value for e in found]]
    joined = "none" if choices else "-"  # choices have no order
    axes.errorbar(x, values, yerr=errors, color=PALETTE[1], marker="o", ls=joined, ms=3, lw=1, capsize=2)
    axes.axhline(one.all.value, color="#888888", ls="--", lw=0.8)
    axes.set(xlim=(0, 1), ylim=(-0.03, 1.03), title=one.claim.name)
    axes.title.set_fontsize(8)
    axes.tick_params(labelsize=7)
    if choices:
        words = [word_of(choices[k]) for k in order]
        is_short = sum(map(len, words)) <= NAMED_MAX
        axes.set_xticks(x, words if is_short else [str(k + 1) for k in range(count)])
    if len(ends) == 2:
        axes.set_xticks([0.0, 1.0], [f"{end:g}" for end in ends])
    axes.set_xlabel(f"{name}, {f'{count} choices' if choices else 'over its range'}", fontsize=7)


def word_of(choice: Any) -> str:
    """Return a choice as it is written in tables and figures; the missing one is "none"."""
    word = "none" if choice is None else str(choice)
    return f"{choice:.4g}" if isinstance(choice, float) and len(word) > NUMBER_MAX else word


def sorted_choices(choices: Sequence[Any]) -> list[int]:
    """Return the places of choices in the order of their numbers; as they stand where some are none."""
    known = [number for number in map(_number, choices) if number is not None]
    places = range(len(choices))
    return sorted(places, key=known.__getitem__) if len(known) == len(choices) else list(places)


def _number(choice: Any) -> float | None:
    """Return the number that a choice is, in per cent too; None if it is none."""
    try:
        return None if isinstance(choice, bool) else float(str(choice).removesuffix("%"))
    except ValueError:
        return None


def central(drawn: Drawn, entry: Entry, admissible: NDArray[np.bool_]) -> Estimate | None:
    """Return the median and the ends of the central 90 % of what admissible reconstructions measure; None of few."""
    values = drawn.rows[f"value:{entry.name}"].to_numpy(np.float64)[admissible]
    values = values[np.isfinite(values)]
    if len(values) < CASES_MIN:
        return None
    low, median, high = np.quantile(values, [0.05, 0.5, 0.95]).tolist()
    return Estimate(median, low, high, len(values))


def numbers(drawn: Drawn, best: Fit, admissible: NDArray[np.bool_], here: Mapping[str, float]) -> "Figure":
    """Return each printed number beside what is measured: its range over admissible reconstructions, here and at best.

    Args:
        drawn: the sample.
        best: where most of them hold together.
        admissible: (rows,) which reconstructions are the paper's.
        here: what the study's own results measure, by the claims' names.
    """
    from matplotlib.figure import Figure

    told = [(k, entry) for k, entry in enumerate(best.claims) if best.printed[k] != 0.0]
    figure = Figure(figsize=(8.0, 1.3 + 0.24 * len(told)), layout="constrained")
    axes = figure.subplots()
    for y, (k, entry) in enumerate(told):
        band = central(drawn, entry, admissible)
        ends = np.divide(tolerated(entry.claim.printed, entry.claim.within), best.printed[k])
        axes.barh(y, np.ptp(ends), left=min(ends), height=0.8, color="#e3f1ea", zorder=0)
        if band is not None:
            ends = np.divide([band.low, band.high], best.printed[k])
            axes.plot(ends, [y, y], color="#888888", lw=2, solid_capstyle="butt")
        axes.plot(here.get(entry.name, math.nan) / best.printed[k], y, "o", color=PALETTE[1], ms=5)
        axes.plot(best.values[k] / best.printed[k], y, "D", color=PALETTE[0], ms=4)
    axes.axvline(1.0, color="#222222", lw=0.8)
    axes.set_yticks(range(len(told)), [entry.name for _, entry in told], fontsize=7)
    axes.set(ylim=(len(told) - 0.4, -0.6), xlabel="measured / printed")
    axes.plot([], [], "o", color=PALETTE[1], label="the study's own results")
    axes.plot([], [], "D", color=PALETTE[0], ms=4, label="where most numbers hold together (fitted)")
    axes.plot([], [], color="#888888", lw=2, label="90 % of the admissible reconstructions")
    axes.barh(0, 0, color="#e3f1ea", label="the claim's tolerance")
    figure.legend(loc="outside lower center", ncols=2, fontsize=7, frameon=False)
    return figure


def strips(shares: Mapping[str, "pd.DataFrame"]) -> "Figure":
    """Return the shares of all claims of several studies, a row of dots a study.

    Args:
        shares: the table of shares of each study, by its name.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 1.0 + 0.75 * len(shares)), layout="constrained")
    axes = figure.subplots()
    for row, table in enumerate(shares.values()):
        ordered = table.sort_values("share", kind="stable")
        y = row + 0.7 * (np.arange(len(ordered)) / max(len(ordered) - 1, 1) - 0.5)
        axes.scatter(ordered["share"], y, c=[VERDICTS[word] for word in ordered["verdict"]], s=14)
        if row:
            axes.axhline(row - 0.5, color="#cccccc", lw=0.6)
    axes.set_yticks(range(len(shares)), list(shares))
    axes.set(xlim=(-0.02, 1.02), ylim=(len(shares) - 0.5, -0.5), xlabel="share of reconstructions in which it holds")
    for x in (CONTRADICTED, ROBUST):
        axes.axvline(x, color="#bbbbbb", lw=0.8, zorder=0)
    for word, colour in VERDICTS.items():
        axes.plot([], [], "o", color=colour, label=word)
    figure.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return figure
