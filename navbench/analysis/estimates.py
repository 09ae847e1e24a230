"""Estimates of measured cases, where there may be none; a single case has no interval."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navbench.mathematics.statistics import Estimate, clopper_pearson

CENTRAL = 0.9


class Distribution(Estimate):
    """A median with its range that keeps its cases."""

    cases: NDArray[np.float64]

    @property
    def central(self) -> Estimate:
        """The median with the limits of the central 90 % of the cases."""
        low, high = np.quantile(self.cases, [0.5 - 0.5 * CENTRAL, 0.5 + 0.5 * CENTRAL])
        return Estimate(self.value, float(low), float(high), self.n)


def exact(value: float, n: int = 1) -> Estimate:
    """Return a figure without interval: one deterministic run's, or one that is no sample."""
    return Estimate(float(value), math.nan, math.nan, n)


def median_of(values: ArrayLike) -> Distribution | None:
    """Return the median with the range; None of nothing."""
    values = np.asarray(values, dtype=np.float64)
    if not len(values):
        return None
    single = len(values) == 1
    low, high = (math.nan, math.nan) if single else (float(values.min()), float(values.max()))
    found = Distribution(float(np.median(values)), low, high, len(values))
    found.cases = values
    return found


def share_of_parts(parts: ArrayLike) -> Estimate | None:
    """Return the share of a thing's parts that hold, such as a run's moments: no sample, and so without interval."""
    parts = np.asarray(parts, dtype=bool)
    return exact(parts.mean(), len(parts)) if len(parts) else None


def share_of(cases: ArrayLike) -> Estimate | None:
    """Return the share of cases that hold, with its exact interval; None of no case."""
    cases = np.asarray(cases, dtype=bool)
    if len(cases) == 1:
        return exact(cases[0])
    return clopper_pearson(int(cases.sum()), len(cases)) if len(cases) else None
