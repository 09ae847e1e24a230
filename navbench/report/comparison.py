"""The section of a report that compares controllers over the same starts."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from navbench.analysis.measures import RESAMPLING_SEED
from navbench.analysis.stored import StoredResults, outcomes, reached
from navbench.mathematics.statistics import (
    Estimate,
    WinRatio,
    median_and_range,
    newcombe_paired,
    restricted_mean,
    restricted_mean_difference,
    share,
    win_ratio,
)
from navbench.report.figures import nested_width, new_figure, save_figure, styles
from navbench.report.markup import MISSING, between, number, save_table

Select = Mapping[str, Any]
SWEPT = "#444444"
NOTE = (
    "A difference is the row's minus that of **{reference}**, start by start; the mean time counts a failure as the "
    "time limit ({limit:g} s), whenever it came; the win ratio is pairs won over pairs lost, a failure being the worst "
    "and two failures a tie; lengths are compared where both reached. Intervals hold 95 %: Wilson's, Newcombe's, the "
    "BCa bootstrap's and, for the win ratio, Wilson's carried over."
)


class Comparison(NamedTuple):
    """One controller in one world beside the reference.

    Attributes:
        world: the world's title.
        label: what the controller is called.
        reached: the share that reached.
        reached_difference: less the reference's share; None of the reference itself, as below.
        time_s: the mean time up to the limit, failures at the limit [s].
        time_difference_s: less the reference's [s].
        wins: against the reference.
        length_m: the median length of those that reached, with the range [m]; None where none did.
        shorter: of the pairs in which both reached, the share in which the path was shorter than the reference's.
    """

    world: str
    label: str
    reached: Estimate
    reached_difference: Estimate | None
    time_s: Estimate
    time_difference_s: Estimate | None
    wins: WinRatio | None
    length_m: Estimate | None
    shorter: Estimate | None


def fair_comparison(
    stored: StoredResults,
    out: Path,
    *,
    file: str,
    select: Select,
    worlds: Mapping[str, str],
    reference: str,
    speeds_mps: Mapping[str, float] | None = None,
    level: Sequence[str] = (),
) -> str:
    """Return how controllers do over the same starts: who arrives, when, and against a reference start by start.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        select: which cells.
        worlds: each world's title and name.
        reference: the label that the others are compared with.
        speeds_mps: the labels that differ in their constant speed alone, with it [m/s]; they are drawn over it.
        level: the labels whose lines that figure shows for comparison.
    """
    found: list[Comparison] = []
    parts = []
    for i, (title, world) in enumerate(worlds.items()):
        rows = stored.select(**select, world=world)
        labels = [label for label in stored.labels if label in set(rows["label"])]
        here = [_compare(stored, select, title, world, label, reference) for label in labels]
        limit_s = stored.world(rows["run_id"].iloc[0]).time_limit_s
        parts.append(f"### {title}\n\n{_table(here, out, f'{file}_{world}')}")
        if i == 0:
            parts.insert(0, NOTE.format(reference=reference, limit=limit_s) + "\n")
        found += here
    parts.append(_forest(found, out, file, list(worlds), styles(stored.labels)))
    if speeds_mps:
        parts.append(_sweep(found, out, f"{file}_speeds", list(worlds), speeds_mps, level, styles(stored.labels)))
    return "\n".join(parts)


def _compare(stored: StoredResults, select: Select, title: str, world: str, label: str, reference: str) -> Comparison:
    """Return one controller in one world beside the reference."""
    rows = stored.pairs({**select, "world": world, "label": label}, {**select, "world": world, "label": reference})
    limit_s = stored.world(rows["run_id"].iloc[0]).time_limit_s
    mine, other = outcomes(rows).values()
    time_s, other_s = rows["time_s"].to_numpy(), rows["time_s_other"].to_numpy()
    lengths = reached(rows)["path_length_m"].to_numpy()
    length_m = median_and_range(lengths) if len(lengths) else None
    alone = share(mine), restricted_mean(time_s, mine, limit_s, np.random.default_rng(RESAMPLING_SEED))
    if label == reference:
        return Comparison(title, label, alone[0], None, alone[1], None, None, length_m, None)
    both = rows[mine & other]
    shorter = share((both["path_length_m"] < both["path_length_m_other"]).to_numpy()) if len(both) else None
    return Comparison(
        title,
        label,
        alone[0],
        newcombe_paired(mine, other),
        alone[1],
        restricted_mean_difference(time_s, mine, other_s, other, limit_s, np.random.default_rng(RESAMPLING_SEED)),
        win_ratio(time_s, mine, other_s, other),
        length_m,
        shorter,
    )


def _table(found: Sequence[Comparison], out: Path, stem: str) -> str:
    """Return one world's comparison as a table."""
    import pandas as pd

    raw, printed = [], []
    for c in found:
        wins = c.wins
        raw.append(
            {
                "label": c.label,
                "n": c.reached.n,
                **_columns("reached", c.reached),
                **_columns("reached_difference", c.reached_difference),
                **_columns("time_s", c.time_s),
                **_columns("time_difference_s", c.time_difference_s),
                "wins": wins.wins if wins else None,
                "losses": wins.losses if wins else None,
                "ties": wins.ties if wins else None,
                **_columns("win_ratio", wins.ratio if wins else None),
                **_columns("length_m", c.length_m),
                **_columns("shorter", c.shorter),
                "shorter_n": c.shorter.n if c.shorter else 0,
            }
        )
        won = f"{wins.wins}/{wins.losses}/{wins.ties}: {_told(wins.ratio, 2)}" if wins else MISSING
        printed.append(
            [
                c.label,
                f"{round(c.reached.value * c.reached.n)} of {c.reached.n}",
                _told(c.reached, 3),
                _told(c.reached_difference, 3),
                _told(c.time_s, 2),
                _told(c.time_difference_s, 2),
                won,
                number(c.length_m.value, 3) if c.length_m else MISSING,
                f"{_told(c.shorter, 2)} of {c.shorter.n}" if c.shorter else MISSING,
            ]
        )
    headers = ["", "reached", "share", "difference", "mean time [s]", "difference [s]"]
    headers += ["won/lost/tied: win ratio", "median length of the reached [m]", "shorter in"]
    return save_table(out, stem, pd.DataFrame(raw), headers, printed)


def _columns(name: str, interval: Estimate | None) -> dict[str, float | None]:
    value, low, high = interval[:3] if interval else (None, None, None)
    return {name: value, f"{name}_low": low, f"{name}_high": high}


def _told(interval: Estimate | None, decimals: int) -> str:
    if interval is None:
        return MISSING
    return f"{number(interval.value, decimals)} {between(interval.low, interval.high, decimals)}"


def _forest(found: Sequence[Comparison], out: Path, stem: str, worlds: Sequence[str], style: Mapping[str, Any]) -> str:
    """Return the figure of shares and times with their intervals, a column a world."""
    labels = list(dict.fromkeys(c.label for c in found))
    figure, axes = new_figure(2, len(worlds), 3.0, 0.25 * len(labels) + 0.9, sharey=True, sharex="row")
    for column, world in zip(axes.T, worlds, strict=True):
        for c in (c for c in found if c.world == world):
            for ax, interval in zip(column, (c.reached, c.time_s), strict=True):
                place = len(labels) - labels.index(c.label)
                ax.plot([interval.low, interval.high], [place, place], color=style[c.label].color, linewidth=1.6)
                ax.plot(interval.value, place, style[c.label].marker, color=style[c.label].color, markersize=5)
        column[0].set_title(world)
    for ax in axes.ravel():
        ax.set_yticks(range(len(labels), 0, -1), labels, fontsize=8)
        ax.grid(axis="x", alpha=0.3)
    for row, title in zip(axes, ("share that reached", "mean time, failures at the limit [s]"), strict=True):
        for ax in row:
            ax.set_xlabel(title, fontsize=9)
    counts = " to ".join(str(n) for n in sorted({min(c.reached.n for c in found), max(c.reached.n for c in found)}))
    caption = f"The comparison over {counts} starts a world: value and 95 % interval."
    return save_figure(figure, out, stem, caption)


def _sweep(
    found: Sequence[Comparison],
    out: Path,
    stem: str,
    worlds: Sequence[str],
    speeds_mps: Mapping[str, float],
    level: Sequence[str],
    style: Mapping[str, Any],
) -> str:
    """Return the figure of shares and times over the constant speed."""
    figure, axes = new_figure(2, len(worlds), 3.0, 2.3, sharex=True, sharey="row")
    for column, world in zip(axes.T, worlds, strict=True):
        here = {c.label: c for c in found if c.world == world}
        for ax, name in zip(column, ("reached", "time_s"), strict=True):
            swept = sorted((speed, getattr(here[label], name)) for label, speed in speeds_mps.items())
            at, intervals = [speed for speed, _ in swept], [interval for _, interval in swept]
            ax.plot(at, [i.value for i in intervals], "o-", color=SWEPT, label="PID at a constant speed", zorder=3)
            ax.fill_between(at, [i.low for i in intervals], [i.high for i in intervals], color=SWEPT, alpha=0.2)
            for i, label in enumerate(level):
                interval, width = getattr(here[label], name), nested_width(i, len(level))
                ax.axhline(interval.value, color=style[label].color, linewidth=width, label=label)
                ax.axhspan(interval.low, interval.high, color=style[label].color, alpha=0.15, linewidth=0)
            ax.grid(alpha=0.3)
        column[0].set_title(world)
        column[1].set_xlabel("constant speed [m/s]")
    axes[0, 0].set_ylabel("share that reached")
    axes[1, 0].set_ylabel("mean time [s],\nfailures at the limit")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, handlelength=4.0)
    caption = "One PID at several constant speeds, beside controllers that choose theirs; bands are 95 % intervals."
    return save_figure(figure, out, stem, caption)
