"""Estimates of measured cases, where there may be none."""

import numpy as np
from numpy.typing import ArrayLike

from navbench.mathematics.statistics import Estimate, wilson


def median_of(values: ArrayLike) -> Estimate | None:
    """Return the median with the range; None of nothing."""
    values = np.asarray(values, dtype=np.float64)
    if not len(values):
        return None
    return Estimate(float(np.median(values)), float(values.min()), float(values.max()), len(values))


def share_of(cases: ArrayLike) -> Estimate | None:
    """Return the share of cases that hold, with Wilson's interval; None of no case."""
    cases = np.asarray(cases, dtype=bool)
    return wilson(int(cases.sum()), len(cases)) if len(cases) else None
