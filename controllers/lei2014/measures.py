"""What only the claims about lei2014 measure: what its controller starts when, its surfaces, its fleets' clearance."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from navbench.analysis.estimates import exact, median_of, share_of
from navbench.analysis.fleets import fleets
from navbench.analysis.stored import PAIR, StoredResults
from navbench.analysis.traces import records_of, trajectories_of
from navbench.mathematics.statistics import Estimate

if TYPE_CHECKING:
    import pandas as pd

Select = Mapping[str, Any]


def time_at_least(
    stored: StoredResults, columns: Sequence[str], level: float, when: Literal["begin", "end"], select: Select
) -> Estimate | None:
    """Return when a robot's trace first reaches a level, or last leaves it, the median over robots with its range [s].

    It is at the level from the control period in which one of the columns is, to the beginning of the period after the
    last such one. Robots that never reach it are left out.

    Args:
        stored: the study's results.
        columns: columns of the trajectory; the largest counts.
        level: the level.
        when: "begin" or "end".
        select: which cells.
    """
    times_s = []
    for trajectory in trajectories_of(stored, select):
        rows = np.flatnonzero(trajectory[list(columns)].iloc[:-1].max(axis=1).to_numpy() >= level)
        if len(rows):
            times_s.append(trajectory["t_s"].to_numpy()[rows[0] if when == "begin" else rows[-1] + 1])
    return median_of(times_s)


def time_in(
    stored: StoredResults, column: str, state: float, when: Literal["begin", "end"], select: Select
) -> Estimate | None:
    """Return when a robot is first in a state, or last leaves it, the median over robots with its range [s].

    Arguments as ``share_of_time`` and ``time_at_least``; robots that never are in it are left out.
    """
    times_s = []
    for trajectory in trajectories_of(stored, select):
        rows = np.flatnonzero(trajectory[column].to_numpy()[:-1] == state)
        if len(rows):
            times_s.append(trajectory["t_s"].to_numpy()[rows[0] if when == "begin" else rows[-1] + 1])
    return median_of(times_s)


def share_mainly_while(
    stored: StoredResults,
    column: str,
    states: Sequence[float],
    danger: Sequence[str],
    level: float,
    endangered: bool,
    select: Select,
) -> Estimate | None:
    """Return the share of robots that, while in danger or while not, are in some states in most control periods.

    Args:
        stored: the study's results.
        column: the column of the trajectory that holds the state.
        states: the states.
        danger: columns of the trajectory; the largest counts.
        level: in danger is a robot from here on.
        endangered: whether the periods in danger count, or the others; robots without any are left out.
        select: which cells.
    """
    held = []
    for trajectory in trajectories_of(stored, select):
        periods = trajectory.iloc[:-1]
        counted = (periods[list(danger)].max(axis=1) >= level) == endangered
        if counted.any():
            held.append(bool(periods[column][counted].isin(states).mean() > 0.5))
    return share_of(held)


def share_of_time(stored: StoredResults, column: str, states: Sequence[float], select: Select) -> Estimate | None:
    """Return the share of its time that a robot spends in some states, the median over robots with its range.

    Args:
        stored: the study's results.
        column: the column of the trajectory that holds the state.
        states: the states.
        select: which cells.
    """
    shares = [
        sum(_times(trajectory, column).get(state, 0.0) for state in states)
        for trajectory in trajectories_of(stored, select)
    ]
    return median_of(shares)


def share_mainly(
    stored: StoredResults, column: str, states: Sequence[float], begin_s: float, end_s: float, select: Select
) -> Estimate | None:
    """Return the share of robots that spend more time in each of some states than in any other one.

    Args:
        stored: the study's results.
        column: the column of the trajectory that holds the state.
        states: the states.
        begin_s: only control periods that begin at this time or later count [s].
        end_s: and that begin before this one [s]; robots that have ended before ``begin_s`` are left out.
        select: which cells.
    """
    held = []
    for trajectory in trajectories_of(stored, select):
        times = _times(trajectory, column, begin_s, end_s)
        if times:
            most_else = max((time for state, time in times.items() if state not in states), default=0.0)
            held.append(all(times.get(state, 0.0) > most_else for state in states))
    return share_of(held)


def share_longer_in(
    stored: StoredResults, column: str, states: Sequence[float], select: Select, than: Select
) -> Estimate | None:
    """Return the share of pairs in which one robot spends a larger share of its time in some states than the other.

    A pair is a world, seed, episode and robot that both meet.

    Args:
        stored: the study's results.
        column: the column of the trajectory that holds the state.
        states: the states.
        select: the cells that are said to spend more.
        than: the cells that they are compared with.
    """
    shares = [
        {
            tuple(row[name] for name in PAIR): sum(
                _times(stored.trajectory(row), column).get(state, 0.0) for state in states
            )
            for row in records_of(side, *PAIR[:2])
        }
        for side in stored.sides(select, than)
    ]
    return share_of(np.array([share > shares[1][pair] for pair, share in shares[0].items() if pair in shares[1]]))


def share_of_fleets_free(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the share of episodes in which no robot touched anything."""
    return share_of((fleets(stored.cases(**select))["contacts"] == 0).to_numpy())


def share_of_fleets_clearer(stored: StoredResults, select: Select, than: Select) -> Estimate | None:
    """Return the share of episodes in which the least clearance of all robots is greater than another controller's.

    Args:
        stored: the study's results.
        select: the cells that are said to keep further away from everything.
        than: the cells that they are compared with, over the same starts.
    """
    here, there = map(fleets, stored.sides(select, than))
    pairs = here.merge(there, on=["world", "seed", "episode"], suffixes=("", "_other"))
    return share_of((pairs["clearance_m"] > pairs["clearance_m_other"]).to_numpy())


def share_of_worlds_safer(stored: StoredResults, select: Select, than: Select) -> Estimate | None:
    """Return the share of worlds in which more robots touch nothing, of the same starts, than of another controller.

    Args:
        stored: the study's results.
        select: the cells that are said to be safer.
        than: the cells that they are compared with.
    """
    rows = stored.pairs(select, than)
    free = (rows[["collisions", "collisions_other"]] == 0).groupby(rows["world"]).sum()
    return share_of((free["collisions"] > free["collisions_other"]).to_numpy())


def described_total(stored: StoredResults, table: str, column: str) -> Estimate | None:
    """Return the sum of a column of a described table."""
    values = stored.described(table, column)[column]
    return exact(values.sum(), len(values))


def described_ratio(stored: StoredResults, table: str, column: str, where: Select, over: Select) -> Estimate | None:
    """Return the value of a described table in one row over that in another one; arguments as ``described_value``."""
    value = stored.described_value(table, column, where) / stored.described_value(table, column, over)
    return exact(value)


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
    rows = stored.described(table, column, *along)
    held = []
    for axis in along:
        others = [name for name in along if name != axis]
        for _, line in rows.groupby(others) if others else [((), rows)]:
            held.append(np.diff(line.sort_values(axis)[column].to_numpy()) <= within)
    return share_of(np.concatenate(held))


def _times(
    trajectory: "pd.DataFrame", column: str, begin_s: float = 0.0, end_s: float = math.inf
) -> dict[float, float]:
    """Return the share of time that a robot spends in each state."""
    begins_s, states = trajectory["t_s"].to_numpy()[:-1], trajectory[column].to_numpy()[:-1]
    lasts_s = np.diff(trajectory["t_s"].to_numpy())
    chosen = (begins_s >= begin_s) & (begins_s < end_s)
    total_s = lasts_s[chosen].sum()
    return {float(s): float(lasts_s[chosen & (states == s)].sum() / total_s) for s in np.unique(states[chosen])}
