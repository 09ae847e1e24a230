"""Measures of what controllers say of themselves: of the tables that they describe.

``navbench.analysis.measures`` says how measures are used, and registers these too.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from navbench.analysis.estimates import share_of
from navbench.analysis.stored import StoredResults
from navbench.mathematics.statistics import Estimate
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    import pandas as pd

Select = Mapping[str, Any]


def described_value(stored: StoredResults, table: str, column: str, where: Select) -> Estimate | None:
    """Return the one value of a described table in the row that matches.

    Args:
        stored: the study's results.
        table: the table's name, such as "sflc-rules".
        column: which of its columns.
        where: a value for each column that tells the row.

    Raises:
        DescriptionError: there is no such table or column, or not exactly one row matches.
    """
    value = _one(stored, table, column, where)
    return Estimate(value, value, value, 1)


def described_total(stored: StoredResults, table: str, column: str) -> Estimate | None:
    """Return the sum of a column of a described table."""
    values = _column(stored, table, column)[column]
    return Estimate(float(values.sum()), float(values.sum()), float(values.sum()), len(values))


def described_count(stored: StoredResults, table: str, where: Select) -> Estimate | None:
    """Return how many rows of a described table match, a value for each column; its n is how many there are."""
    rows = matching = _column(stored, table, next(iter(where)))
    for name, value in where.items():
        matching = matching[_column(stored, table, name).loc[matching.index, name] == value]
    return Estimate(float(len(matching)), float(len(matching)), float(len(matching)), len(rows))


def described_ratio(stored: StoredResults, table: str, column: str, where: Select, over: Select) -> Estimate | None:
    """Return the value of a described table in one row over that in another one; arguments as ``described_value``."""
    value = _one(stored, table, column, where) / _one(stored, table, column, over)
    return Estimate(value, value, value, 1)


def described_is_less(stored: StoredResults, table: str, column: str, where: Select, than: Select) -> Estimate | None:
    """Return 1 where a value of a described table is less than another one; arguments as ``described_value``."""
    return share_of(np.array([_one(stored, table, column, where) < _one(stored, table, column, than)]))


def share_falling(
    stored: StoredResults, table: str, column: str, along: Sequence[str], within: float
) -> Estimate | None:
    """Return the share of steps along a described surface in which its value does not rise.

    Args:
        stored: the study's results.
        table: the table's name: a row a point of the surface.
        column: the value.
        along: the surface's axes; a step goes from one value of an axis to its next, the others fixed.
        within: a rise up to this is none.
    """
    rows = _column(stored, table, column)
    held = []
    for axis in along:
        others = [name for name in along if name != axis]
        for _, line in rows.groupby(others) if others else [((), rows)]:
            held.append(np.diff(line.sort_values(axis)[column].to_numpy()) <= within)
    return share_of(np.concatenate(held))


def _column(stored: StoredResults, table: str, column: str) -> "pd.DataFrame":
    """Return a described table that has a column."""
    tables = stored.descriptions
    if table not in tables:
        allowed = ", ".join(tables) or "none"
        raise DescriptionError(f"{stored.results.path}: no description {table!r}; there are: {allowed}")
    if column not in tables[table].columns:
        allowed = ", ".join(tables[table].columns)
        raise DescriptionError(f"{stored.results.path}: {table}: no column {column!r}; there are: {allowed}")
    return tables[table]


def _one(stored: StoredResults, table: str, column: str, where: Select) -> float:
    rows = _column(stored, table, column)
    for name, value in where.items():
        rows = rows[_column(stored, table, name).loc[rows.index, name] == value]
    if len(rows) != 1:
        raise DescriptionError(f"{stored.results.path}: {table}: {len(rows)} rows match {dict(where)}, not one")
    return float(rows[column].iloc[0])


MEASURES = (
    described_value,
    described_total,
    described_count,
    described_ratio,
    described_is_less,
    share_falling,
)
