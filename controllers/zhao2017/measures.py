"""What only the claims about zhao2017 measure: how robots slow down before a danger and pass each other; its movers."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.estimates import median_of, share_of
from navbench.analysis.measures import difference
from navbench.analysis.stored import StoredResults
from navbench.analysis.traces import periods_of
from navbench.mathematics.statistics import Estimate
from navbench.robot import Robot
from navbench.validation import describe

if TYPE_CHECKING:
    import pandas as pd

Select = Mapping[str, Any]
Bands = Mapping[str, Sequence[float]]  # for a column [low, high], both in it


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
    for trajectory in periods_of(stored, select):
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
    return share_of([trajectory[column].min() <= at_most for trajectory in periods_of(stored, select)])


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
    for trajectory in periods_of(stored, select):
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
    for trajectory in periods_of(stored, select):
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
    rows = stored.cases(**select)
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


def difference_in_fleets_is_above(stored: StoredResults, select: Select, than: Select) -> Estimate | None:
    """Return 1 where more fleets reach than another controller's by more than chance: the whole interval is above 0."""
    found = difference(stored, "success", select, than)
    return None if found is None else Estimate(float(found.low > 0.0), 0.0, 1.0, found.n)


def mover_speed(stored: StoredResults, mover: int, leg: int, select: Select) -> Estimate | None:
    """Return how fast a mover drives one of its legs, as a share of the robots' wheel-speed limit.

    Args:
        stored: the study's results.
        mover: its number in the world, from 0.
        leg: the leg's number, from 0.
        select: which cells; each cell counts once.
    """
    shares = []
    for run_id in stored.cases(**select)["run_id"].unique():
        world = stored.world(run_id)
        one = world.movers[mover]
        begin, end = one.schedule()[leg, :2] - one.phase_s
        early, late = (one.place(begin + part * (end - begin)) for part in (0.25, 0.75))
        robot = describe(Robot, stored.configuration(run_id)["configuration"]["robot"], "robot")
        shares.append(math.dist(early, late) / (0.5 * (end - begin)) / robot.wheel_speed_max_mps)
    return median_of(shares)


def share_of_discs_met(stored: StoredResults, within_m: float, select: Select) -> Estimate | None:
    """Return the share of a world's standing discs that some robot came near to, from hull to hull, and none hit.

    Args:
        stored: the study's results.
        within_m: how near counts [m].
        select: which cells.
    """
    met = []
    for _, fleet in stored.cases(**select).groupby(["run_id", "episode"], sort=False):
        robots = fleet.to_dict("records")
        run_id = robots[0]["run_id"]
        world = stored.world(run_id, robots[0]["episode"])
        robot = describe(Robot, stored.configuration(run_id)["configuration"]["robot"], "robot")
        places = np.concatenate([stored.trajectory(row)[["x_m", "y_m"]].to_numpy() for row in robots])
        hit = set(fleet.loc[fleet["hit"] == "disc", "hit_index"])
        for i, disc in enumerate(world.discs):
            away = np.hypot(*(places - (disc.x_m, disc.y_m)).T).min() - disc.radius_m - robot.radius_m
            met.append(away <= within_m and i not in hit)
    return share_of(met)


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


def _within(trajectory: "pd.DataFrame", bands: Bands) -> NDArray[np.bool_]:
    held = np.ones(len(trajectory), dtype=bool)
    for column, (low, high) in bands.items():
        held &= trajectory[column].between(low, high).to_numpy()
    return held
