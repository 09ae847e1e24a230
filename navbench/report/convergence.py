"""The section of a report that compares tuners at equal budgets."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from navbench.mathematics.statistics import friedman, median_and_range
from navbench.report.document import Blocks, Column, Paragraph, Plot, Table
from navbench.report.figures import PALETTE, Style, new_figure
from navbench.report.page import Page

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

NO_PARAMETERS = ("tuning_id", "name", "tuner", "seed", "evaluation", "cost", "reached", "robots")
PARAMETERS_SHOWN_MAX = 8  # of more, as of a whole rule table, a table shows nothing; the evaluations hold them all


def tuners_compared(page: Page, *, tunings: Mapping[str, str] | None = None, unit: str = "") -> Blocks:
    """Return how tuners fell over an equal budget and what they found, over their seeds.

    Beside the least cost stands what the best cost when it was run again: the search's own episodes flatter.

    Args:
        tunings: the name of each tuning and what it is called, as are the cells that take its best; None for all.
        unit: of the cost.
    """
    rows = page.stored.evaluations
    tunings = tunings or {name: name for name in dict.fromkeys(rows["name"])}
    best = rows.loc[rows[rows["name"].isin(list(tunings))].groupby(["name", "seed"])["cost"].idxmin()]
    parameters = [name for name in rows.columns if name not in NO_PARAMETERS and best[name].dtype.kind in "fi"]
    parameters = [name for name in parameters if best[name].notna().all()]
    if len(parameters) > PARAMETERS_SHOWN_MAX:
        parameters = []
    least = best.pivot(index="seed", columns="name", values="cost")[list(tunings)]
    least = least.dropna()  # seeds that not all have
    ranking = friedman(least.to_numpy()) if len(tunings) > 2 and len(least) > 1 else None
    checks = page.stored.checks
    again = checks.loc[checks["kind"] != "searched", ["kind", "simulator"]].drop_duplicates().to_numpy().tolist()
    costs = {tuple(key): rows["cost"].to_numpy() for key, rows in checks.groupby(["name", "kind", "simulator"])}
    entries = []
    for i, (name, label) in enumerate(tunings.items()):
        mine = best[best["name"] == name]
        found = [median_and_range(mine[x].to_numpy(dtype=float)) for x in ("cost", *parameters)]
        rank = ranking.mean_ranks[i] if ranking else None
        keys = [(name, *pair) for pair in again]
        checked = [median_and_range(costs[key]) if key in costs else None for key in keys]
        count = len(rows[rows["name"] == name]) // len(mine)
        entries.append([label, len(mine), count, found[0], rank, *checked, *found[1:]])
    columns = [Column("", "label"), Column("seeds", "seeds"), Column("evaluations", "budget")]
    columns += [Column("least cost", "cost", decimals=5), Column("mean rank", "mean_rank", decimals=1)]
    columns += [Column(f"{kind} ({of})", f"{kind}_{of}", decimals=5) for kind, of in again]
    columns += [Column(name, name) for name in parameters]
    kept = best[["name", "seed", "evaluation", "cost", *parameters]].sort_values(["name", "seed"])
    every = Table(
        f"{page.file}_best",
        [Column(name, name) for name in kept.columns],
        kept.to_numpy(dtype=object).tolist(),
        title="The best of every tuning",
    )
    test = "Median [range] over the seeds."
    if "verified" not in [kind for kind, _ in again]:
        test += " Not verified: no best was run again in another simulator."
    if ranking:
        test += (
            f" Friedman's test over {ranking.n} seeds: chi-square {ranking.statistic:.2f}, "
            f"p = {ranking.p_value:.2g}; the mean rank is 1 for the least cost."
        )
    return [_convergence(page, rows, tunings, unit), page.table(columns, entries), Paragraph(test), every]


def _convergence(page: Page, rows: "pd.DataFrame", tunings: Mapping[str, str], unit: str) -> Plot:
    """Return the figure of the least cost so far over the evaluations, all of it and near its end."""
    figure, axes = new_figure(1, 2, 4.6, 3.2)
    final = []
    for name, label in tunings.items():
        mine = rows[rows["name"] == name]
        best = mine.pivot(index="evaluation", columns="seed", values="cost").cummin()
        final.append(best.iloc[-1].max())
        for ax in axes.ravel():
            _band(ax, best, page.styles.get(label, Style(PALETTE[0], "o")), label)
    least = rows["cost"].min()
    axes[0, 0].set(xscale="log", title="all")
    spread = max(max(final) - least, 1e-6)
    title = (
        f"near the end, enlarged: {100.0 * 3.1 * spread / abs(least):.2g} % of the cost" if least else "near the end"
    )
    axes[0, 1].set(ylim=(least - 0.1 * spread, least + 3.0 * spread), title=title)
    for ax in axes.ravel():
        ax.set(xlabel="evaluations", ylabel="least cost so far" + (f" [{unit}]" if unit else ""))
        ax.grid(alpha=0.3)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, handlelength=4.0)
    return page.plot(figure)


def _band(ax: "Axes", best: "pd.DataFrame", style: Style, label: str) -> None:
    at = best.index + 1
    ax.fill_between(at, best.min(axis=1), best.max(axis=1), color=style.color, alpha=0.12, linewidth=0)
    ax.plot(at, best.median(axis=1), color=style.color, linewidth=1.6, label=label)
