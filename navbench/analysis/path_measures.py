"""Measures of how robots drove rather than how they ended: from their trajectories and what the controllers traced.

Each is a measure as in ``navbench.analysis.measures``. A column is one of the trajectory's, such as ``v_mps``, or of
the controller's trace. A band is [low, high], both in it.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.estimates import median_of, share_of
from navbench.analysis.stored import PAIR, StoredResults
from navbench.mathematics.statistics import Estimate

if TYPE_CHECKING:
    import pandas as pd

Select = Mapping[str, Any]
Bands = Mapping[str, Sequence[float]]


def share_of_periods(
    stored: StoredResults, select: Select, where: Bands, state: str, settled_s: float, holds: Bands
) -> Estimate | None:
    """Return in what share of some of a robot's control periods some bands hold: the median robot's, with the range.

    Periods follow from one another, so they are not counted as independent cases.

    Args:
        stored: the study's results.
        select: which cells and robots.
        where: which periods: a band for each of some columns.
        state: of these, only those in which this column is 0 and
        settled_s: has been for so long [s], since it was last not 0 or since the beginning.
        holds: what must hold in them: a band for each of some columns.
    """
    shares = []
    for trajectory in _periods(stored, select):
        t_s = trajectory["t_s"]
        last_s = t_s.where(trajectory[state] != 0.0).ffill().fillna(0.0)
        chosen = trajectory[
            _within(trajectory, where) & (trajectory[state] == 0.0).to_numpy() & (t_s - last_s >= settled_s).to_numpy()
        ]
        if len(chosen):
            shares.append(float(_within(chosen, holds).mean()))
    return median_of(shares)


def share_with_least(stored: StoredResults, column: str, at_most: float, select: Select) -> Estimate | None:
    """Return the share of robots for which a column falls to a value or below it."""
    return share_of([trajectory[column].min() <= at_most for trajectory in _periods(stored, select)])


def share_slowing(stored: StoredResults, column: str, within_s: float, select: Select) -> Estimate | None:
    """Return the share of onsets of a state after which a robot is slower than before, within so long.

    An onset is a control period in which a column is not 0 after one in which it was; those in which the robot already
    backs or stands are left out.

    Args:
        stored: the study's results.
        column: what tells the state.
        within_s: how soon the least speed is looked for [s].
        select: which cells and robots.
    """
    slower = []
    for trajectory in _periods(stored, select):
        t_s, v_mps, on = (
            trajectory["t_s"].to_numpy(),
            trajectory["v_mps"].to_numpy(),
            trajectory[column].to_numpy() != 0.0,
        )
        for k in np.flatnonzero(on[1:] & ~on[:-1]) + 1:
            if v_mps[k - 1] > 0.0:
                soon = (t_s >= t_s[k]) & (t_s <= t_s[k] + within_s)
                slower.append(bool(v_mps[soon].min() < v_mps[k - 1]))
    return share_of(slower)


def share_regaining(stored: StoredResults, column: str, speed_mps: float, select: Select) -> Estimate | None:
    """Return the share of robots that drive as fast as this again after a state's last end.

    Args:
        stored: the study's results.
        column: what tells the state: not 0 in it. Robots that were never in it are left out.
        speed_mps: how fast [m/s].
        select: which cells and robots.
    """
    again = []
    for trajectory in _periods(stored, select):
        on = np.flatnonzero(trajectory[column].to_numpy() != 0.0)
        if len(on):
            again.append(bool((trajectory["v_mps"].to_numpy()[on[-1] + 1 :] >= speed_mps).any()))
    return share_of(again)


def share_passing_first(
    stored: StoredResults,
    column: str,
    first: int,
    second: int,
    slow_mps: float,
    fast_mps: float,
    within_m: float,
    settled_s: float,
    select: Select,
) -> Estimate | None:
    """Return the share of episodes in which two robots in danger slow down, one passes, and the other follows.

    In this order: both are near each other, in a state and slower than ``slow_mps``; the first is faster than the
    second while the second is still in it; and, after the first has left it for a while, the second is faster than
    ``fast_mps``. Episodes in which they are never in it near each other are left out.

    Args:
        stored: the study's results.
        column: what tells the state: not 0 in it.
        first: the index of the robot that passes first.
        second: that of the other one.
        slow_mps: the speed below which both have slowed down [m/s].
        fast_mps: the speed above which the second has speeded up [m/s].
        within_m: how near they meet, from centre to centre [m].
        settled_s: how long the first must have left the state, or until its end [s].
        select: which cells.
    """
    held = []
    rows = stored.select(**select)
    for _, fleet in rows.groupby(["run_id", "episode"], sort=False):
        trajectories = {row["robot_index"]: stored.trajectory(row).iloc[:-1] for row in fleet.to_dict("records")}
        if not {first, second} <= set(trajectories):
            continue
        length = min(len(trajectories[first]), len(trajectories[second]))
        v1, v2 = (trajectories[i]["v_mps"].to_numpy()[:length] for i in (first, second))
        on1, on2 = (trajectories[i][column].to_numpy()[:length] != 0.0 for i in (first, second))
        (x1, y1), (x2, y2) = (trajectories[i][["x_m", "y_m"]].to_numpy()[:length].T for i in (first, second))
        late = trajectories[second]["v_mps"].to_numpy()
        meet = on1 & on2 & (np.hypot(x1 - x2, y1 - y2) <= within_m)
        if not meet.any():
            continue
        slowed = _first(meet & (np.abs(v1) < slow_mps) & (np.abs(v2) < slow_mps), 0)
        passed = None if slowed is None else _first(on2 & (v1 > v2), slowed)
        left = (
            None if passed is None else _first(_off_for(on1, trajectories[first]["t_s"].to_numpy(), settled_s), passed)
        )
        held.append(left is not None and _first(late > fast_mps, left) is not None)
    return share_of(held)


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
    for trajectory in _trajectories(stored, select):
        rows = np.flatnonzero(trajectory[list(columns)].iloc[:-1].max(axis=1).to_numpy() >= level)
        if len(rows):
            times_s.append(trajectory["t_s"].to_numpy()[rows[0] if when == "begin" else rows[-1] + 1])
    return median_of(times_s)


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
        for trajectory in _trajectories(stored, select)
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
    for trajectory in _trajectories(stored, select):
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
            for row in stored.select(**side).to_dict("records")
        }
        for side in (select, than)
    ]
    return share_of(np.array([share > shares[1][pair] for pair, share in shares[0].items() if pair in shares[1]]))


def _first(holds: NDArray[np.bool_], begin: int) -> int | None:
    """Return the first place from ``begin`` on at which something holds."""
    found = np.flatnonzero(holds[begin:])
    return begin + int(found[0]) if len(found) else None


def _off_for(on: NDArray[np.bool_], t_s: NDArray[np.float64], lasting_s: float) -> NDArray[np.bool_]:
    """Return where a state is off and stays so for a while, or until its last row."""
    nexts = np.flatnonzero(on)
    following = np.searchsorted(nexts, np.arange(len(on)))  # of each row: the next one in which it is on
    until_s = np.append(t_s[nexts], math.inf)[following]
    return ~on & (until_s - t_s[: len(on)] >= lasting_s)


def _trajectories(stored: StoredResults, select: Select) -> "Iterator[pd.DataFrame]":
    """Yield each robot's and episode's trajectory, its end included."""
    for row in stored.select(**select).to_dict("records"):
        yield stored.trajectory(row)


def _periods(stored: StoredResults, select: Select) -> "Iterator[pd.DataFrame]":
    """Yield the control periods of each robot and episode."""
    for trajectory in _trajectories(stored, select):
        yield trajectory.iloc[:-1]


def _times(
    trajectory: "pd.DataFrame", column: str, begin_s: float = 0.0, end_s: float = math.inf
) -> dict[float, float]:
    """Return the share of time that a robot spends in each state."""
    begins_s, states = trajectory["t_s"].to_numpy()[:-1], trajectory[column].to_numpy()[:-1]
    lasts_s = np.diff(trajectory["t_s"].to_numpy())
    chosen = (begins_s >= begin_s) & (begins_s < end_s)
    total_s = lasts_s[chosen].sum()
    return {float(s): float(lasts_s[chosen & (states == s)].sum() / total_s) for s in np.unique(states[chosen])}


def _within(trajectory: "pd.DataFrame", bands: Bands) -> NDArray[np.bool_]:
    held = np.ones(len(trajectory), dtype=bool)
    for column, (low, high) in bands.items():
        held &= trajectory[column].between(low, high).to_numpy()
    return held


MEASURES = (
    share_of_periods,
    share_with_least,
    share_slowing,
    share_regaining,
    share_passing_first,
    time_at_least,
    share_of_time,
    share_mainly,
    share_longer_in,
)
