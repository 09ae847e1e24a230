"""Measures of what controllers say of themselves: of the tables that they describe, and of the traces that they leave.

``navbench.reading.measures`` says how measures are used, and registers these too.
"""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from navbench.descriptions.description import DescriptionError
from navbench.reading.claims import Measured
from navbench.reading.stored import PAIR, Reading

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


def time_at_least(
    reading: Reading, columns: Sequence[str], level: float, when: Literal["begin", "end"], select: Select
) -> Measured | None:
    """Return when a robot's trace first reaches a level, or last leaves it, the median over robots with its range [s].

    It is at the level from the control period in which one of the columns is, to the beginning of the period after the
    last such one. Robots that never reach it are left out.

    Args:
        reading: the study's results.
        columns: columns of the trajectory; the largest counts.
        level: the level.
        when: "begin" or "end".
        select: which cells.
    """
    times_s = []
    for way in _ways(reading, select):
        rows = np.flatnonzero(way[list(columns)].iloc[:-1].max(axis=1).to_numpy() >= level)
        if len(rows):
            times_s.append(way["t_s"].to_numpy()[rows[0] if when == "begin" else rows[-1] + 1])
    return Measured.median(times_s)


def share_of_time(reading: Reading, column: str, states: Sequence[float], select: Select) -> Measured | None:
    """Return the share of its time that a robot spends in some states, the median over robots with its range.

    Args:
        reading: the study's results.
        column: the column of the trajectory that holds the state.
        states: the states.
        select: which cells.
    """
    shares = [sum(_times(way, column).get(state, 0.0) for state in states) for way in _ways(reading, select)]
    return Measured.median(shares)


def share_mainly(
    reading: Reading, column: str, states: Sequence[float], begin_s: float, end_s: float, select: Select
) -> Measured | None:
    """Return the share of robots that spend more time in each of some states than in any other one.

    Args:
        reading: the study's results.
        column: the column of the trajectory that holds the state.
        states: the states.
        begin_s: only control periods that begin at this time or later count [s].
        end_s: and that begin before this one [s]; robots that have ended before ``begin_s`` are left out.
        select: which cells.
    """
    held = []
    for way in _ways(reading, select):
        times = _times(way, column, begin_s, end_s)
        if times:
            most_else = max((time for state, time in times.items() if state not in states), default=0.0)
            held.append(all(times.get(state, 0.0) > most_else for state in states))
    return Measured.share(held)


def share_longer_in(
    reading: Reading, column: str, states: Sequence[float], select: Select, than: Select
) -> Measured | None:
    """Return the share of pairs in which one robot spends a larger share of its time in some states than the other.

    A pair is a world, seed, episode and robot that both meet.

    Args:
        reading: the study's results.
        column: the column of the trajectory that holds the state.
        states: the states.
        select: the cells that are said to spend more.
        than: the cells that they are compared with.
    """
    shares = [
        {
            tuple(row[name] for name in PAIR): sum(_times(reading.way(row), column).get(state, 0.0) for state in states)
            for row in reading.select(**side).to_dict("records")
        }
        for side in (select, than)
    ]
    return Measured.share(np.array([share > shares[1][pair] for pair, share in shares[0].items() if pair in shares[1]]))


def share_greater(reading: Reading, metric: str, select: Select, than: Select) -> Measured | None:
    """Return the share of pairs in which one controller's metric is greater than the other's, failures included.

    Args:
        reading: the study's results.
        metric: the metric's name, such as "min_clearance_m".
        select: the cells that are said to have more of it.
        than: the cells that they are compared with.
    """
    rows = reading.pairs(select, than)
    return Measured.share((rows[metric] > rows[f"{metric}_other"]).to_numpy())


def share_of_worlds_safer(reading: Reading, select: Select, than: Select) -> Measured | None:
    """Return the share of worlds in which more robots touch nothing, of the same starts, than of another controller.

    Args:
        reading: the study's results.
        select: the cells that are said to be safer.
        than: the cells that they are compared with.
    """
    rows = reading.pairs(select, than)
    free = (rows[["collisions", "collisions_other"]] == 0).groupby(rows["world"]).sum()
    return Measured.share((free["collisions"] > free["collisions_other"]).to_numpy())


def _ways(reading: Reading, select: Select) -> "list[pd.DataFrame]":
    return [reading.way(row) for row in reading.select(**select).to_dict("records")]


def _times(way: "pd.DataFrame", column: str, begin_s: float = 0.0, end_s: float = math.inf) -> dict[float, float]:
    """Return the share of time that a robot spends in each state."""
    begins_s, states = way["t_s"].to_numpy()[:-1], way[column].to_numpy()[:-1]
    lasts_s = np.diff(way["t_s"].to_numpy())
    chosen = (begins_s >= begin_s) & (begins_s < end_s)
    total_s = lasts_s[chosen].sum()
    return {float(s): float(lasts_s[chosen & (states == s)].sum() / total_s) for s in np.unique(states[chosen])}


def _column(reading: Reading, table: str, column: str) -> "pd.DataFrame":
    """Return a described table that has a column."""
    tables = reading.results.descriptions()
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
    time_at_least,
    share_of_time,
    share_mainly,
    share_longer_in,
    share_greater,
    share_of_worlds_safer,
)
