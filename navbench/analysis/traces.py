"""What trajectories and traces offer to measures: each robot's control periods, and spells of one value.

A column is one of a trajectory's, such as ``v_mps``, or of the controller's trace. A spell is a run of control periods
over which one holds one value.
"""

import itertools
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.stored import StoredResults
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    import pandas as pd

Select = Mapping[str, Any]
FloatArray = NDArray[np.float64]


class Spell(NamedTuple):
    """A run of control periods over which a column holds one value: from ``begin`` on, ``length`` periods."""

    value: float
    begin: int
    length: int


def trajectories_of(stored: StoredResults, select: Select) -> "Iterator[pd.DataFrame]":
    """Return each robot's and episode's trajectory, its end included."""
    return map(stored.trajectory, records_of(stored.cases(**select)))


def records_of(rows: "pd.DataFrame", *columns: str) -> list[dict[str, Any]]:
    """Return what names each row's trajectory, and further columns, as mappings."""
    found: list[Any] = rows[["run_id", "episode", "robot_index", *columns]].to_dict("records")
    return found


def periods_of(stored: StoredResults, select: Select) -> "Iterator[pd.DataFrame]":
    """Return the control periods of each robot and episode."""
    return (trajectory.iloc[:-1] for trajectory in trajectories_of(stored, select))


def columns_of(stored: StoredResults, column: str, select: Select) -> Iterator[FloatArray]:
    """Yield a column of each robot's and episode's control periods.

    Raises:
        DescriptionError: there is no such column.
    """
    for periods in periods_of(stored, select):
        if column not in periods.columns:
            raise DescriptionError(f"{column}: there is no such column; allowed: {', '.join(periods.columns)}")
        yield periods[column].to_numpy()


def spells(values: FloatArray, least_periods: int = 1) -> list[Spell]:
    """Return the spells of a column in their order, without the short ones.

    Where a short one has parted two of the same value they count as one, which begins with the first of them.
    """
    found: list[Spell] = []
    begin = 0
    for value, run in itertools.groupby(values.tolist()):
        length = len(list(run))
        if length >= least_periods:
            if found and found[-1].value == value:
                found[-1] = found[-1]._replace(length=begin + length - found[-1].begin)
            else:
                found.append(Spell(value, begin, length))
        begin += length
    return found
