"""The section of a report that tells how surely something works over many starts: success and clearance, by fleet."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from navbench.analysis.fleets import clearances, fleets
from navbench.analysis.measures import RESAMPLING_SEED
from navbench.analysis.stored import StoredResults
from navbench.mathematics.statistics import Estimate, bootstrap_median, share
from navbench.report.markup import MISSING, between, number, save_table

Select = Mapping[str, Any]
HEADERS = ("", "", "all robots reached", "nothing touched", "median least clearance [m]", "least of all [m]")


def robustness(
    stored: StoredResults, out: Path, *, file: str, cells: Mapping[str, Select], worlds: Mapping[str, str]
) -> str:
    """Return for some cells and worlds the shares of episodes that succeed, and the clearance, with 95 % intervals.

    A case is an episode, whatever the number of its robots, since these are not independent of each other. Its least
    clearance is that of its robots' hulls from anything, failures included. Intervals are Wilson's and, for the
    median, the percentile bootstrap's. Where nothing stands round there is no clearance.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        cells: what each row is called, and which cells it holds.
        worlds: each world's title and name.
    """
    import pandas as pd

    raw, printed = [], []
    for place, world in worlds.items():
        for title, select in cells.items():
            rows = stored.select(**select, world=world)
            kept = clearances(rows)
            least_m = kept["clearance_m"].to_numpy()
            success = share(fleets(rows)["success"].to_numpy(dtype=bool))
            free = share((kept["contacts"] == 0).to_numpy())
            median = _median(least_m)
            raw.append([place, title, *success, *free[:3], *median[:3], least_m.min()])
            words = [f"{round(x.value * x.n)} of {x.n}: {_told(x)}" for x in (success, free)]
            near = [_told(median), number(least_m.min(), 3)] if np.isfinite(median.value) else [MISSING] * 2
            printed.append([place, title, *words, *near])
    names = ["world", "label", "reached", "reached_low", "reached_high", "n", "free", "free_low", "free_high"]
    names += ["clearance_m", "clearance_low_m", "clearance_high_m", "clearance_least_m"]
    return save_table(out, file, pd.DataFrame(raw, columns=names), HEADERS, printed)


def _median(least_m: Any) -> Estimate:
    if not np.isfinite(least_m).all():
        return Estimate(float("nan"), float("nan"), float("nan"), len(least_m))
    return bootstrap_median(least_m, np.random.default_rng(RESAMPLING_SEED))


def _told(interval: Estimate) -> str:
    return f"{number(interval.value, 3)} {between(interval.low, interval.high, 3)}"
