"""Controllers beside each other over the same starts: who arrives, when, and against a reference start by start."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from navbench.analysis.estimates import median_of, share_of
from navbench.analysis.fleets import fleets
from navbench.analysis.stored import StoredResults, outcomes, reached
from navbench.mathematics.statistics import (
    Estimate,
    WinRatio,
    newcombe_paired,
    restricted_mean,
    restricted_mean_difference,
    share,
    win_ratio,
)
from navbench.metrics import DECLARED, Metric

if TYPE_CHECKING:
    import pandas as pd


class Comparison(NamedTuple):
    """One controller beside the reference, over the starts that both met.

    Attributes:
        label: what the controller is called.
        reached: the share that reached.
        reached_difference: less the reference's share; None of the reference itself, as below.
        time_s: the mean time up to the limit, failures at the limit [s].
        time_difference_s: less the reference's [s].
        wins: against the reference.
        medians: of the path's length and of each metric beside navbench's own, over those that reached, with the
            range; None where none did.
        better: of the pairs in which both reached, the share in which each of these was better than the reference's.
    """

    label: str
    reached: Estimate
    reached_difference: Estimate | None
    time_s: Estimate
    time_difference_s: Estimate | None
    wins: WinRatio | None
    medians: Mapping[str, Estimate | None]
    better: Mapping[str, Estimate | None]


def compare(stored: StoredResults, select: Mapping[str, Any], label: str, reference: str) -> Comparison | None:
    """Return one controller beside the reference; None where they met no start in common.

    Args:
        stored: the stored results.
        select: the cells of one world in which both are.
        label: the controller's label.
        reference: the reference's label.
    """
    rows = stored.pairs({**select, "label": label}, {**select, "label": reference})
    if rows.empty:
        return None
    limit_s = stored.time_limit_s(rows["run_id"].iloc[0])
    mine, other = outcomes(rows).values()
    time_s, other_s = rows["time_s"].to_numpy(), rows["time_s_other"].to_numpy()
    metrics = compared_metrics(stored)
    medians = {metric.name: median_of(reached(rows)[metric.name].dropna().to_numpy()) for metric in metrics}
    alone = share(mine), restricted_mean(time_s, mine, limit_s)
    if label == reference:
        return Comparison(label, alone[0], None, alone[1], None, None, medians, {})
    both = rows[mine & other]
    return Comparison(
        label,
        alone[0],
        newcombe_paired(mine, other),
        alone[1],
        restricted_mean_difference(time_s, mine, other_s, other, limit_s),
        win_ratio(time_s, mine, other_s, other),
        medians,
        {metric.name: _share_better(metric, both) for metric in metrics},
    )


def level(stored: StoredResults, metric: str, select: Mapping[str, Any]) -> float:
    """Return the figure of one controller of which ``measures.difference`` takes two."""
    rows = stored.select(**select)
    if metric == "success":
        return float(fleets(rows)["success"].mean())
    arrived = (rows["outcome"] == "reached").to_numpy()
    if metric == "reached":
        return float(arrived.mean())
    if metric == "time_s":
        return restricted_mean(rows["time_s"].to_numpy(), arrived, stored.shared_time_limit_s(rows)).value
    return float(rows[metric][arrived].median())


def compared_metrics(stored: StoredResults) -> list[Metric]:
    """Return the metrics that a comparison shows beside time: the path's length, and those beside navbench's own."""
    own = {metric.name for metric in DECLARED} - {"path_length_m"}
    return [metric for name, metric in stored.metrics.items() if name not in own and name in stored.episodes]


def _share_better(metric: Metric, pairs: "pd.DataFrame") -> Estimate | None:
    """Return the share of pairs in which a metric is better than the other's; None where neither direction is."""
    known = pairs[[metric.name, f"{metric.name}_other"]].dropna().to_numpy()
    return share_of(metric.sign * known[:, 0] < metric.sign * known[:, 1]) if metric.sign else None
