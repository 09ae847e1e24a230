"""The sections of zhao2018's report: how its controllers evolved, and what that gained beside what is printed."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from navbench.analysis.stored import outcomes
from navbench.mathematics.statistics import Estimate, median, median_and_range, newcombe_paired, share
from navbench.report.document import Blocks, Column, Data
from navbench.report.figures import PALETTE, new_figure
from navbench.report.page import Page, Select

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIRST = "first population"
LEGEND_COLUMNS = 4
MANY = 10  # pairs: of fewer a range says more than an interval
GAINS = (
    Column("", "row"),
    Column("reached", "reached", show="count"),
    Column("reached, compared with", "other", show="count"),
    Column("difference of shares", "difference", decimals=3),
    Column("length: printed", "length_printed", "%", 2),
    Column("length: here", "length_decrease", "%", 2),
    Column("time: printed", "time_printed", "%", 2),
    Column("time: here", "time_decrease", "%", 2),
)


def evolution(page: Page, *, tunings: Mapping[str, str], first: int, columns: int = 2) -> Blocks:
    """Return how the cost fell, a panel a tuning and a line a seed, and what the first population alone would give.

    Args:
        tunings: the name of each tuning and what it is called.
        first: the size of the first population, the un-evolved chromosome first and its random mutants behind it.
        columns: how many panels stand side by side.
    """
    rows = page.stored.evaluations
    verified = page.stored.checks[page.stored.checks["kind"] == "verified"].set_index(["name", "seed"])["cost"]
    columns = min(columns, len(tunings))
    figure, axes = new_figure(-(-len(tunings) // columns), columns, 4.6, 2.9)
    entries = []
    for ax, (name, title) in zip(axes.ravel(), tunings.items(), strict=False):
        for seed in sorted(rows.loc[rows["name"] == name, "seed"].unique().tolist()):
            costs = rows[(rows["name"] == name) & (rows["seed"] == seed)].sort_values("evaluation")["cost"]
            best = np.minimum.accumulate(costs.to_numpy())
            ax.step(
                np.arange(1, len(best) + 1),
                best,
                where="post",
                color=PALETTE[seed % len(PALETTE)],
                linestyle="-" if seed < len(PALETTE) else "--",
                linewidth=1.2,
                label=f"seed {seed}",
            )
            start, mutant, least = float(best[0]), float(costs.iloc[1:first].min()), float(best[-1])
            gained = [100.0 * (1.0 - cost / start) for cost in (mutant, least)]
            entries.append([title, seed, len(best), start, mutant, least, verified.get((name, seed)), *gained])
        ax.axvline(first, color="#888888", linewidth=0.8, linestyle=":", label=FIRST)
        ax.set(title=title, xlabel="evaluations", ylabel="least cost so far")
        ax.grid(alpha=0.3)
    for ax in axes.ravel()[len(tunings) :]:
        ax.set_axis_off()
    _add_legend(figure, axes.ravel().tolist())
    heads = [Column("tuning", "tuning"), Column("seed", "seed"), Column("evaluations", "evaluations")]
    heads += [Column("un-evolved cost", "unevolved_cost", decimals=2)]
    heads += [Column(f"best of {first - 1} mutants", "best_first_mutant_cost", decimals=2)]
    heads += [Column("least cost", "least_cost", decimals=2), Column("verified", "verified_cost", decimals=2)]
    heads += [Column("gain of the mutant", "mutant_gain_percent", "%", 1)]
    heads += [Column("gain of evolution", "evolved_gain_percent", "%", 1)]
    return [page.plot(figure), page.table(heads, entries)]


def _add_legend(figure: "Figure", axes: "Sequence[Axes]") -> None:
    """Explain every seed that any panel holds, once, and last the dotted line."""
    found = [pair for ax in axes for pair in zip(*ax.get_legend_handles_labels(), strict=True)]
    handles = {label: handle for handle, label in found}
    line = handles.pop(FIRST)
    names = sorted(handles, key=lambda label: int(label.split()[-1]))
    figure.legend(
        [*(handles[name] for name in names), line],
        [*names, FIRST],
        loc="outside lower center",
        ncols=min(len(names) + 1, LEGEND_COLUMNS),
        frameon=False,
    )


def rules_compared(page: Page, *, tables: Mapping[str, str]) -> Blocks:
    """Return rule bases that controllers offer of themselves, side by side; what differs from the first has a star.

    Args:
        tables: what each rule base is called, and the name of its described table; all have the same inputs, in the
            same order, and the outputs last.
    """
    found = {title: page.stored.described(table) for title, table in tables.items()}
    first = next(iter(found.values()))
    inputs = [name for name in first.columns if all((table[name] == first[name]).all() for table in found.values())]
    outputs = [name for name in first.columns if name not in inputs]
    whole = first[inputs].copy()
    for output in outputs:
        for title, table in found.items():
            whole[f"{output}: {title}"] = table[output]
    told = whole.astype(str)
    for output in outputs:
        for title in found:
            name = f"{output}: {title}"
            told[name] = told[name].where(told[name] == first[output].astype(str), told[name] + "*")
    data = Data(list(whole.columns), whole.to_numpy(dtype=object).tolist())
    return [page.table([Column(name) for name in whole.columns], told.to_numpy().tolist(), data)]


def gains(
    page: Page, *, rows: Mapping[str, Mapping[str, Select]], printed: Mapping[str, Sequence[float | None]] | None = None
) -> Blocks:
    """Return by how much lengths and times fell, in percent of the other controller's, robot by robot.

    Pairs are those in which both reached; the median pair's decrease stands with its interval where there
    are at least 10 pairs, else with the range. An increase is negative.

    Args:
        rows: for each row's title, ``select`` (the cells that are said to have gained) and ``than`` (the others).
        printed: the decreases of length and time that a paper prints, for some of the rows; null
            for none: then there are no such columns.
    """
    entries = []
    for title, sides in rows.items():
        pairs = page.stored.pairs(sides["select"], sides["than"], each=True)
        mine, other = outcomes(pairs).values()
        both = pairs[mine & other]
        shares = [share(side) if len(pairs) else None for side in (mine, other)]
        entry: list[Any] = [title, *shares, newcombe_paired(mine, other) if len(pairs) >= MANY else None]
        for k, metric in enumerate(("path_length_m", "time_s")):
            decrease = 100.0 * (1.0 - both[metric].to_numpy() / both[f"{metric}_other"].to_numpy())
            entry += [(printed or {}).get(title, (None, None))[k], _median(decrease)]
        entries.append(entry)
    if printed is None:
        shown = [k for k, column in enumerate(GAINS) if not column.name.endswith("_printed")]
        return [page.table([GAINS[k] for k in shown], [[entry[k] for k in shown] for entry in entries])]
    return [page.table(GAINS, entries)]


def _median(values: Any) -> Estimate | None:
    if not len(values):
        return None
    return median_and_range(values) if len(values) < MANY else median(values)
