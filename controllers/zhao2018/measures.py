"""What only the claims about zhao2018 measure: by how much evolution lowers a figure."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from navbench.analysis.estimates import median_of
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
    rows = stored.pairs(select, than, each=True)
    rows = rows[np.logical_and(*outcomes(rows).values())]
    return median_of(100.0 * (1.0 - rows[metric] / rows[f"{metric}_other"]))
