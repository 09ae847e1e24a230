"""Sections of a report on a controller that evolved: its tunings, and what they gained beside what is printed."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from navbench.analysis.measures import RESAMPLING_SEED
from navbench.analysis.stored import StoredResults, outcomes
from navbench.mathematics.statistics import bootstrap_median, newcombe_paired, share
from navbench.report.figures import PALETTE, new_figure, save_figure
from navbench.report.markup import MISSING, number, save_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIRST = "first population"
LEGEND_COLUMNS = 4


def evolution(
    stored: StoredResults,
    out: Path,
    *,
    file: str,
    caption: str,
    tunings: Mapping[str, str],
    first: int,
    columns: int = 2,
) -> str:
    """Return how the cost fell, a panel a tuning and a line a seed, and what the first population alone would give.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        tunings: the name of each tuning and what it is called.
        first: the size of the first population, the un-evolved chromosome first and its random mutants behind it.
        columns: how many panels stand side by side.
    """
    import pandas as pd

    rows = stored.evaluations
    columns = min(columns, len(tunings))
    figure, axes = new_figure(-(-len(tunings) // columns), columns, 4.6, 2.9)
    raw, printed = [], []
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
            gains = [100.0 * (1.0 - cost / start) for cost in (mutant, least)]
            raw.append([title, seed, len(best), start, mutant, least, *gains])
            words = [number(value, 2) for value in (start, mutant, least)] + [number(value, 1) for value in gains]
            printed.append([title, str(seed), str(len(best)), *words])
        ax.axvline(first, color="#888888", linewidth=0.8, linestyle=":", label=FIRST)
        ax.set(title=title, xlabel="evaluations", ylabel="least cost so far")
        ax.grid(alpha=0.3)
    for ax in axes.ravel()[len(tunings) :]:
        ax.set_axis_off()
    _add_legend(figure, axes.ravel().tolist())
    names = ["tuning", "seed", "evaluations", "unevolved_cost", "best_first_mutant_cost", "least_cost"]
    names += ["mutant_gain_percent", "evolved_gain_percent"]
    headers = ["tuning", "seed", "evaluations", "un-evolved cost", f"best of {first - 1} mutants", "least cost"]
    headers += ["gain of the mutant [%]", "gain of evolution [%]"]
    table = save_table(out, file, pd.DataFrame(raw, columns=names), headers, printed)
    return f"{save_figure(figure, out, file, caption)}\n{table}"


def rules_compared(stored: StoredResults, out: Path, *, file: str, tables: Mapping[str, str]) -> str:
    """Return rule bases that controllers offer of themselves, side by side; what differs from the first has a star.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        tables: what each rule base is called, and the name of its described table; all have the same inputs, in the
            same order, and the outputs last.
    """
    found = {title: stored.described(table) for title, table in tables.items()}
    first = next(iter(found.values()))
    inputs = [name for name in first.columns if all((table[name] == first[name]).all() for table in found.values())]
    outputs = [name for name in first.columns if name not in inputs]
    whole = first[inputs].copy()
    for output in outputs:
        for title, table in found.items():
            whole[f"{output}: {title}"] = table[output]
    rows = []
    for i, line in enumerate(whole.astype(str).to_numpy().tolist()):
        old = [str(first[output].iloc[i]) for output in outputs for _ in found]
        rows.append(
            line[: len(inputs)]
            + [word if word == before else f"{word}*" for word, before in zip(line[len(inputs) :], old, strict=True)]
        )
    return save_table(out, file, whole, list(whole.columns), rows)


def gains(
    stored: StoredResults,
    out: Path,
    *,
    file: str,
    rows: Mapping[str, Mapping[str, Any]],
    printed: Mapping[str, Sequence[float | None]] | None = None,
) -> str:
    """Return by how much lengths and times fell, in percent of the other controller's, robot by robot.

    Pairs are those in which both reached; the median pair's decrease stands with the bootstrap's interval where there
    are at least 10 pairs, else with the range. An increase is negative.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        rows: for each row's title, ``select`` (the cells that are said to have gained) and ``than`` (the others).
        printed: the decreases of length and time that a paper prints, for some of the rows; null for none.
    """
    import pandas as pd

    raw, told = [], []
    for title, sides in rows.items():
        pairs = stored.pairs(sides["select"], sides["than"], each=True)
        mine, other = outcomes(pairs).values()
        both = pairs[mine & other]
        shares = [tuple(share(side)[:3]) if len(pairs) else (float("nan"),) * 3 for side in (mine, other)]
        row: list[Any] = [title, len(pairs), *shares[0], *shares[1]]
        words = [title, f"{int(mine.sum())} of {len(pairs)}", f"{int(other.sum())} of {len(pairs)}"]
        if len(pairs) >= 10:
            difference = newcombe_paired(mine, other)
            words.append(f"{difference.value:+.3f} [{difference.low:+.3f}, {difference.high:+.3f}]")
        else:
            words.append(MISSING)
        for k, metric in enumerate(("path_length_m", "time_s")):
            decrease = 100.0 * (1.0 - both[metric].to_numpy() / both[f"{metric}_other"].to_numpy())
            figure = (printed or {}).get(title, (None, None))[k]
            value, low, high = _median(decrease)
            row += [figure, value, low, high]
            words += [MISSING if figure is None else f"{figure:g}", _told(value, low, high)]
        raw.append(row)
        told.append(words)
    names = ["row", "pairs", "reached", "reached_low", "reached_high", "other", "other_low", "other_high"]
    names += [f"{metric}_{part}" for metric in ("length", "time") for part in ("printed", "decrease", "low", "high")]
    headers = ["", "reached", "reached, compared with", "difference of shares", "length: printed [%]", "here [%]"]
    headers += ["time: printed [%]", "here [%]"]
    return save_table(out, file, pd.DataFrame(raw, columns=names), headers, told)


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


def _median(values: Any) -> tuple[float, float, float]:
    if not len(values):
        return (float("nan"),) * 3
    if len(values) < 10:
        return float(np.median(values)), float(values.min()), float(values.max())
    found = bootstrap_median(values, np.random.default_rng(RESAMPLING_SEED))
    return found.value, found.low, found.high


def _told(value: float, low: float, high: float) -> str:
    if value != value:
        return MISSING
    return f"{value:.2f}" if low == high else f"{value:.2f} [{low:.2f}, {high:.2f}]"
