"""What only the claims about zhao2018 measure: by how much evolution lowers a figure."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.estimates import exact, median_of, share_of
from navbench.analysis.stored import StoredResults, outcomes
from navbench.mathematics.statistics import Estimate

Select = Mapping[str, Any]


def median_decrease(stored: StoredResults, metric: str, select: Select, than: Select) -> Estimate | None:
    """Return by how much a metric is less than another controller's, in percent: the median pair's, with the range.

    Pairs are those in which both reached; where one has been tuned several times, each tuning makes a pair. An
    increase is negative.

    Args:
        stored: the study's results.
        metric: the metric's name.
        select: the cells that are said to have less.
        than: the cells that they are compared with.
    """
    return median_of(_decreases(stored, metric, select, than))


def share_hardly_shorter(
    stored: StoredResults, metric: str, percent: float, select: Select, than: Select
) -> Estimate | None:
    """Return the share of pairs in which a metric falls by less than so many percent, see ``median_decrease``."""
    return share_of(_decreases(stored, metric, select, than) < percent)


def share_of_rules_alike(stored: StoredResults, table: str, other: str) -> Estimate | None:
    """Return in what share of the cells of two described rule bases both wheels are told the same."""
    ours, theirs = (stored.described(name, "R", "Phi", "vL", "vR") for name in (table, other))
    pairs = ours.merge(theirs, on=["R", "Phi"], suffixes=("", "_other"))
    alike = (pairs["vL"] == pairs["vL_other"]) & (pairs["vR"] == pairs["vR_other"])
    return exact(alike.mean(), len(alike))


def _decreases(stored: StoredResults, metric: str, select: Select, than: Select) -> NDArray[np.float64]:
    """Return the decreases of a metric in the pairs in which both reached [percent]."""
    rows = stored.pairs(select, than, each=True)
    rows = rows[np.logical_and(*outcomes(rows).values())]
    found: NDArray[np.float64] = (100.0 * (1.0 - rows[metric] / rows[f"{metric}_other"])).to_numpy()
    return found
