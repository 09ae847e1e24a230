"""Measures of what controllers say of themselves: of the tables that they describe.

``navbench.analysis.measures`` says how measures are used, and registers these too.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from navbench.analysis.claims import Measured
from navbench.analysis.stored import Reading
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    import pandas as pd

Select = Mapping[str, Any]


def described_value(reading: Reading, table: str, column: str, where: Select) -> Measured | None:
    """Return the one value of a described table in the row that matches.

    Args:
        reading: the study's results.
        table: the table's name, such as "sflc-rules".
        column: which of its columns.
        where: a value for each column that tells the row.

    Raises:
        DescriptionError: there is no such table or column, or not exactly one row matches.
    """
    value = _one(reading, table, column, where)
    return Measured(value, value, value, 1)


def described_total(reading: Reading, table: str, column: str) -> Measured | None:
    """Return the sum of a column of a described table."""
    values = _column(reading, table, column)[column]
    return Measured(float(values.sum()), float(values.sum()), float(values.sum()), len(values))


def described_count(reading: Reading, table: str, where: Select) -> Measured | None:
    """Return how many rows of a described table match, a value for each column; its n is how many there are."""
    rows = matching = _column(reading, table, next(iter(where)))
    for name, value in where.items():
        matching = matching[_column(reading, table, name).loc[matching.index, name] == value]
    return Measured(float(len(matching)), float(len(matching)), float(len(matching)), len(rows))


def described_ratio(reading: Reading, table: str, column: str, where: Select, over: Select) -> Measured | None:
    """Return the value of a described table in one row over that in another one; arguments as ``described_value``."""
    value = _one(reading, table, column, where) / _one(reading, table, column, over)
    return Measured(value, value, value, 1)


def described_is_less(reading: Reading, table: str, column: str, where: Select, than: Select) -> Measured | None:
    """Return 1 where a value of a described table is less than another one; arguments as ``described_value``."""
    return Measured.share(np.array([_one(reading, table, column, where) < _one(reading, table, column, than)]))


def share_falling(reading: Reading, table: str, column: str, along: Sequence[str], within: float) -> Measured | None:
    """Return the share of steps along a described surface in which its value does not rise.

    Args:
        reading: the study's results.
        table: the table's name: a row a point of the surface.
        column: the value.
        along: the surface's axes; a step goes from one value of an axis to its next, the others fixed.
        within: a rise up to this is none.
    """
    rows = _column(reading, table, column)
    held = []
    for axis in along:
        others = [name for name in along if name != axis]
        for _, line in rows.groupby(others) if others else [((), rows)]:
            held.append(np.diff(line.sort_values(axis)[column].to_numpy()) <= within)
    return Measured.share(np.concatenate(held))


def _column(reading: Reading, table: str, column: str) -> "pd.DataFrame":
    """Return a described table that has a column."""
    tables = reading.descriptions
    if table not in tables:
        allowed = ", ".join(tables) or "none"
        raise DescriptionError(f"{reading.results.path}: no description {table!r}; there are: {allowed}")
    if column not in tables[table].columns:
        allowed = ", ".join(tables[table].columns)
        raise DescriptionError(f"{reading.results.path}: {table}: no column {column!r}; there are: {allowed}")
    return tables[table]


def _one(reading: Reading, table: str, column: str, where: Select) -> float:
    rows = _column(reading, table, column)
    for name, value in where.items():
        rows = rows[_column(reading, table, name).loc[rows.index, name] == value]
    if len(rows) != 1:
        raise DescriptionError(f"{reading.results.path}: {table}: {len(rows)} rows match {dict(where)}, not one")
    return float(rows[column].iloc[0])


MEASURES = (
    described_value,
    described_total,
    described_count,
    described_ratio,
    described_is_less,
    share_falling,
)
