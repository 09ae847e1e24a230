"""What only the claims about lei2014 measure: what its controller starts when, its surfaces, its fleets' clearance."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from navbench.analysis.estimates import exact, median_of, share_of, share_of_parts
from navbench.analysis.fleets import fleets
from navbench.analysis.stored import PAIR, StoredResults
from navbench.analysis.traces import records_of, trajectories_of
from navbench.mathematics.kinematics import advance_arc, body_speed
from navbench.mathematics.statistics import Estimate

if TYPE_CHECKING:
    import pandas as pd

Select = Mapping[str, Any]
EXACT_M = 1e-9  # what an exact arc may miss


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
    """Return the share of episodes whose robots, while in danger or not, are in some states in most control periods.

    Args:
        stored: the study's results.
        column: the column of the trajectory that holds the state.
        states: the states.
        danger: columns of the trajectory; the largest counts.
        level: in danger is a robot from here on.
        endangered: whether the periods in danger count, or the others; robots without any are left out.
        select: which cells.
    """

    def mainly(trajectory: "pd.DataFrame") -> bool | None:
        share = _share_of_danger(trajectory, column, states, danger, level, endangered)
        return None if share is None else share > 0.5

    return _share_of_episodes(stored, select, mainly)


def share_while(
    stored: StoredResults, column: str, states: Sequence[float], danger: Sequence[str], level: float, select: Select
) -> Estimate | None:
    """Return the share of its control periods in danger that a robot is in some states, the median over robots.

    Arguments as ``share_mainly_while``; robots that are never in danger are left out.
    """
    shares = [
        _share_of_danger(trajectory, column, states, danger, level, True)
        for trajectory in trajectories_of(stored, select)
    ]
    return median_of([share for share in shares if share is not None])


def _share_of_danger(
    trajectory: "pd.DataFrame",
    column: str,
    states: Sequence[float],
    danger: Sequence[str],
    level: float,
    endangered: bool,
) -> float | None:
    """Return the share of the control periods in danger, or not in it, that are in some states; None without any."""
    periods = trajectory.iloc[:-1]
    counted = (periods[list(danger)].max(axis=1) >= level) == endangered
    return float(periods[column][counted].isin(states).mean()) if counted.any() else None


def share_of_time(
    stored: StoredResults,
    column: str,
    states: Sequence[float],
    select: Select,
    begin_s: float = 0.0,
    end_s: float = math.inf,
) -> Estimate | None:
    """Return the share of its time that a robot spends in some states, the median over robots with its range.

    Args:
        stored: the study's results.
        column: the column of the trajectory that holds the state.
        states: the states.
        select: which cells.
        begin_s: as ``share_mainly`` has it.
        end_s: likewise.
    """
    times = [_times(trajectory, column, begin_s, end_s) for trajectory in trajectories_of(stored, select)]
    return median_of([sum(one.get(state, 0.0) for state in states) for one in times if one])


def share_mainly(
    stored: StoredResults, column: str, states: Sequence[float], begin_s: float, end_s: float, select: Select
) -> Estimate | None:
    """Return the share of episodes whose robots spend more time in each of some states than in any other one.

    Args:
        stored: the study's results.
        column: the column of the trajectory that holds the state.
        states: the states.
        begin_s: only control periods that begin at this time or later count [s].
        end_s: and that begin before this one [s]; robots that have ended before ``begin_s`` are left out.
        select: which cells.
    """

    def mainly(trajectory: "pd.DataFrame") -> bool | None:
        times = _times(trajectory, column, begin_s, end_s)
        most_else = max((time for state, time in times.items() if state not in states), default=0.0)
        return all(times.get(state, 0.0) > most_else for state in states) if times else None

    return _share_of_episodes(stored, select, mainly)


def _share_of_episodes(
    stored: StoredResults, select: Select, holds: Callable[["pd.DataFrame"], bool | None]
) -> Estimate | None:
    """Return the share of episodes in which something holds for all robots of which it can be asked (not None).

    Robots that meet are one case, not several.
    """
    held: dict[tuple[str, int], bool] = {}
    for record in records_of(stored.cases(**select)):
        found = holds(stored.trajectory(record))
        if found is not None:
            case = record["run_id"], record["episode"]
            held[case] = held.get(case, True) and found
    return share_of(list(held.values()))


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


def share_of_scenes(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the share of single runs that reach, each in a scene that was chosen: no sample, so without interval."""
    return share_of_parts((stored.cases(**select)["outcome"] == "reached").to_numpy())


def share_of_worlds_safer(stored: StoredResults, select: Select, than: Select) -> Estimate | None:
    """Return the share of worlds in which more robots touch nothing, of the same starts, than of another controller.

    The worlds were chosen and are no sample: there is no interval.

    Args:
        stored: the study's results.
        select: the cells that are said to be safer.
        than: the cells that they are compared with.
    """
    rows = stored.pairs(select, than)
    free = (rows[["collisions", "collisions_other"]] == 0).groupby(rows["world"]).sum()
    return share_of_parts((free["collisions"] > free["collisions_other"]).to_numpy())


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
        ordered = rows.sort_values([*others, axis])
        lines = ordered[others].to_numpy()
        same = (lines[1:] == lines[:-1]).all(axis=1)
        held.append(np.diff(ordered[column].to_numpy())[same] <= within)
    return share_of_parts(np.concatenate(held))


def turning_cases(track_m: float) -> list[tuple[float, float, float, float, float]]:
    """Return what eq. 3 comes to where the wheels turn alike, against each other, and else, by the exact arc of 1 s.

    Args:
        track_m: D, between the wheels [m].

    Returns:
        For each case v_L, v_R [m/s], R [m] by eq. 3, how far the robot gets [m] and turns, positive to the right [rad].
    """
    cases = []
    for left_mps, right_mps in ((0.1, 0.1), (0.1, -0.1), (0.1, 0.05)):
        difference = left_mps - right_mps
        radius_m = 0.5 * track_m * (left_mps + right_mps) / difference if difference else math.inf
        x_m, y_m, heading_rad = advance_arc(0.0, 0.0, 0.0, *body_speed(left_mps, right_mps, track_m), 1.0)
        cases.append((left_mps, right_mps, radius_m, math.hypot(x_m, y_m), -heading_rad))
    return cases


def share_turning_as_printed(stored: StoredResults, track_m: float) -> Estimate | None:
    """Return the share of the three conclusions on eq. 3 that hold: straight on, on the spot, round a circle of R."""
    straight, spot, circle = turning_cases(track_m)
    return share_of_parts(
        [
            straight[4] == 0.0 and abs(straight[3] - straight[0]) < EXACT_M,
            spot[3] < EXACT_M and spot[4] != 0.0,
            abs(circle[3] - 2.0 * abs(circle[2] * math.sin(0.5 * circle[4]))) < EXACT_M,
        ]
    )


def share_on_circles(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the share of control periods in which a robot turns and gets as far as a circle of eq. 3's radius says.

    Args:
        stored: the study's results.
        select: which cells, driven without a limit of acceleration, so that the wheels hold their speeds.
    """
    held = []
    for trajectory in trajectories_of(stored, select):
        x_m, y_m, t_s = trajectory[["x_m", "y_m", "t_s"]].to_numpy().T
        v_mps, w_radps = trajectory[["v_mps", "w_radps"]].to_numpy()[:-1].T
        turned = w_radps * np.diff(t_s)
        turns = np.abs(turned) > 0.0
        chord_m = 2.0 * np.abs(v_mps[turns] / w_radps[turns] * np.sin(0.5 * turned[turns]))
        held.append(np.abs(np.hypot(np.diff(x_m), np.diff(y_m))[turns] - chord_m) < EXACT_M)
    return share_of_parts(np.concatenate(held))


def _times(
    trajectory: "pd.DataFrame", column: str, begin_s: float = 0.0, end_s: float = math.inf
) -> dict[float, float]:
    """Return the share of time that a robot spends in each state."""
    begins_s, states = trajectory["t_s"].to_numpy()[:-1], trajectory[column].to_numpy()[:-1]
    lasts_s = np.diff(trajectory["t_s"].to_numpy())
    chosen = (begins_s >= begin_s) & (begins_s < end_s)
    total_s = lasts_s[chosen].sum()
    return {float(s): float(lasts_s[chosen & (states == s)].sum() / total_s) for s in np.unique(states[chosen])}
