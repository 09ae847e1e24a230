"""The section of a report that compares tuners at equal budgets."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from navbench.analysis.stored import StoredResults
from navbench.mathematics.statistics import friedman, median_and_range
from navbench.report.figures import Style, new_figure, save_figure, styles
from navbench.report.markup import save_table

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

NO_PARAMETERS = ("tuning_id", "name", "tuner", "seed", "evaluation", "cost", "reached", "robots")
PARAMETERS_SHOWN_MAX = 8  # of more, as of a whole rule table, a table shows nothing; the evaluations hold them all


def tuners_compared(
    stored: StoredResults, out: Path, *, file: str, caption: str, tunings: Mapping[str, str], unit: str
) -> str:
    """Return how tuners fell over an equal budget and what they found, over their seeds.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        tunings: the name of each tuning and what it is called, as are the cells that take its best.
        unit: of the cost.
    """
    import pandas as pd

    rows = stored.evaluations
    best = rows.loc[rows[rows["name"].isin(list(tunings))].groupby(["name", "seed"])["cost"].idxmin()]
    parameters = [name for name in rows.columns if name not in NO_PARAMETERS and best[name].dtype.kind in "fi"]
    parameters = [name for name in parameters if best[name].notna().all()]
    if len(parameters) > PARAMETERS_SHOWN_MAX:
        parameters = []
    least = best.pivot(index="seed", columns="name", values="cost")[list(tunings)]
    ranking = friedman(least.to_numpy())
    raw, printed = [], []
    for (name, label), rank in zip(tunings.items(), ranking.mean_ranks, strict=True):
        mine = best[best["name"] == name]
        budget = len(rows[rows["name"] == name]) // len(mine)
        cost = median_and_range(mine["cost"].to_numpy())
        gains = [median_and_range(mine[parameter].to_numpy(dtype=float)) for parameter in parameters]
        raw.append([label, len(mine), budget, *cost[:3], rank, *(gain.value for gain in gains)])
        words = [f"{cost.value:.5f} [{cost.low:.5f}, {cost.high:.5f}]", f"{rank:.1f}"]
        words += [f"{gain.value:.3g} [{gain.low:.3g}, {gain.high:.3g}]" for gain in gains]
        printed.append([label, str(len(mine)), str(budget), *words])
    names = ["label", "seeds", "budget", "cost", "cost_low", "cost_high", "mean_rank", *parameters]
    headers = ["", "seeds", "evaluations", "least cost", "mean rank", *parameters]
    table = save_table(out, file, pd.DataFrame(raw, columns=names), headers, printed)
    kept = best[["name", "seed", "evaluation", "cost", *parameters]].sort_values(["name", "seed"])
    entries = kept.to_numpy(dtype=object).tolist()
    told = [[f"{x:.6g}" if isinstance(x, float) else str(x) for x in entry] for entry in entries]
    save_table(out, f"{file}_best", kept, list(kept.columns), told)
    figure = _convergence(stored, rows, out, file, caption, tunings, unit)
    test = (
        f"Median [range] over the seeds. Friedman's test over {ranking.n} seeds: chi-square {ranking.statistic:.2f}, "
        f"p = {ranking.p_value:.2g}; the mean rank is 1 for the least cost. "
        f"[Every tuning's best](tables/{file}_best.csv), [LaTeX](tables/{file}_best.tex)."
    )
    return f"{figure}\n{table}\n{test}\n"


def _convergence(
    stored: StoredResults,
    rows: "pd.DataFrame",
    out: Path,
    stem: str,
    caption: str,
    tunings: Mapping[str, str],
    unit: str,
) -> str:
    """Return the figure of the least cost so far over the evaluations, all of it and near its end."""
    style = styles(stored.labels)
    figure, axes = new_figure(1, 2, 4.6, 3.2)
    final = []
    for name, label in tunings.items():
        mine = rows[rows["name"] == name]
        best = mine.pivot(index="evaluation", columns="seed", values="cost").cummin()
        final.append(best.iloc[-1].max())
        for ax in axes.ravel():
            _band(ax, best, style[label], label)
    least = rows["cost"].min()
    axes[0, 0].set(xscale="log", title="all")
    spread = max(max(final) - least, 1e-6)
    axes[0, 1].set(ylim=(least - 0.1 * spread, least + 3.0 * spread), title="near the end")
    for ax in axes.ravel():
        ax.set(xlabel="evaluations", ylabel=f"least cost so far [{unit}]")
        ax.grid(alpha=0.3)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, handlelength=4.0)
    return save_figure(figure, out, stem, caption)


def _band(ax: "Axes", best: "pd.DataFrame", style: Style, label: str) -> None:
    at = best.index + 1
    ax.fill_between(at, best.min(axis=1), best.max(axis=1), color=style.color, alpha=0.12, linewidth=0)
    ax.plot(at, best.median(axis=1), color=style.color, linewidth=1.6, label=label)
