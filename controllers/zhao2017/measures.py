"""What only the claims about zhao2017 measure: how robots slow down before a danger and pass each other; eq. 4."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.estimates import exact, median_of, share_of, share_of_parts
from navbench.analysis.stored import StoredResults
from navbench.analysis.traces import FloatArray, periods_of, records_of, spells
from navbench.mathematics.statistics import Estimate
from navbench.robot import Robot
from navbench.validation import describe

if TYPE_CHECKING:
    import pandas as pd

Select = Mapping[str, Any]
Bands = Mapping[str, Sequence[float]]  # for a column [low, high], both in it
ROUNDED_S = 1e-9  # of times that are sums of periods


def share_of_periods(
    stored: StoredResults,
    select: Select,
    where: Bands,
    holds: Bands,
    state: str | None = None,
    settled_s: float = 0.0,
) -> Estimate | None:
    """Return in what share of some of a robot's control periods some bands hold: the median robot's, with the range.

    Periods follow from one another, so they are not counted as independent cases.

    Args:
        stored: the study's results.
        select: which cells and robots.
        where: which periods: a band for each of some columns.
        holds: what must hold in them: a band for each of some columns.
        state: of these, only those in which this column is 0 and
        settled_s: has been for so long [s], since it was last not 0 or since the beginning.
    """
    shares = []
    for path in _paths(stored, stored.cases(**select)):
        periods = path.iloc[:-1]
        counts = _within(periods, where)
        if state is not None:
            t_s = periods["t_s"]
            last_s = t_s.where(periods[state] != 0.0).ffill().fillna(0.0)
            counts &= ((periods[state] == 0.0) & (t_s - last_s >= settled_s)).to_numpy()
        if counts.any():
            shares.append(float(_within(periods[counts], holds).mean()))
    return median_of(shares)


def share_ever(
    stored: StoredResults, holds: Bands, select: Select, passing: bool = False, of_fleets: bool = False
) -> Estimate | None:
    """Return the share of robots for which some bands hold in some control period.

    Args:
        stored: the study's results.
        holds: what must hold at one time: a band for each of some columns.
        select: which cells and robots.
        passing: whether only episodes count in which all robots of the fleet reached.
        of_fleets: whether a case is an episode in which it holds for some robot, not a robot.
    """
    rows = _passing(stored, select) if passing else stored.cases(**select)
    held = [bool(_within(path.iloc[:-1], holds).any()) for path in _paths(stored, rows)]
    if of_fleets:
        return share_of(rows.assign(held=held).groupby(["run_id", "episode"])["held"].any())
    return share_of(held)


def in_some(
    stored: StoredResults, holds: Bands, select: Select, passing: bool = False, of_fleets: bool = False
) -> Estimate | None:
    """Return 1 where some bands hold in some case, and 0 where in none; arguments as of ``share_ever``."""
    found = share_ever(stored, holds, select, passing, of_fleets)
    return None if found is None else exact(float(found.value > 0.0), found.n)


def least_speed(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the least forward speed of the robots of fleets that all reach, 0 of one that backs: the median [m/s]."""
    rows = _passing(stored, select)
    return median_of([max(0.0, float(path["v_mps"].iloc[1:-1].min())) for path in _paths(stored, rows)])


def share_slowing(
    stored: StoredResults, column: str, within_s: float, quiet_s: float, select: Select
) -> Estimate | None:
    """Return the share of entries into a state after which a robot is slower than before, within so long.

    An entry is a control period in which a column is not 0 after it was 0 for a while; those in which the robot already
    backs or stands are left out.

    Args:
        stored: the study's results.
        column: what tells the state.
        within_s: how soon the least speed is looked for [s].
        quiet_s: for how long it must have been 0 before, or since the beginning [s]; a state that flickers is entered
            once.
        select: which cells and robots.
    """
    slower = []
    for trajectory in periods_of(stored, select):
        t_s, v_mps = trajectory["t_s"].to_numpy(), trajectory["v_mps"].to_numpy()
        on = trajectory[column].to_numpy() != 0.0
        for k in np.flatnonzero(on[1:] & ~on[:-1]) + 1:
            quiet = not on[:k][t_s[1 : k + 1] > t_s[k] - quiet_s + ROUNDED_S].any()
            if quiet and v_mps[k - 1] > 0.0:
                soon = (t_s >= t_s[k]) & (t_s <= t_s[k] + within_s)
                slower.append(bool(v_mps[soon].min() < v_mps[k - 1]))
    return share_of_parts(slower)


def share_regaining(
    stored: StoredResults, column: str, speed_mps: float, beyond: Bands, select: Select
) -> Estimate | None:
    """Return the share of robots that drive as fast as this again after a state's last end.

    Args:
        stored: the study's results.
        column: what tells the state: not 0 in it. Robots that were never in it are left out.
        speed_mps: how fast [m/s].
        beyond: where its last period must lie, a band for each of some columns; robots elsewhere are left out.
        select: which cells and robots.
    """
    again = []
    for trajectory in periods_of(stored, select):
        on = np.flatnonzero(trajectory[column].to_numpy() != 0.0)
        if len(on) and _within(trajectory, beyond)[on[-1]]:
            again.append(bool((trajectory["v_mps"].to_numpy()[on[-1] + 1 :] >= speed_mps).any()))
    return share_of_parts(again)


def share_possible_approach(stored: StoredResults, speed_mps: float, select: Select) -> Estimate | None:
    """Return in what share of its periods of OA-FLC (4) tells a speed that is possible: the median robot's, with range.

    Among standing discs nothing approaches faster than the robot drives.

    Args:
        stored: the study's results.
        speed_mps: the fastest possible approach [m/s].
        select: which cells and robots, among standing discs alone.
    """
    return median_of([float((told <= speed_mps).mean()) for told, _ in _approaches(stored, select)])


def median_approach(stored: StoredResults, told: bool, select: Select) -> Estimate | None:
    """Return with what speed a disc comes nearer in OA-FLC's periods [m/s]: the median robot's median, with the range.

    Args:
        stored: the study's results.
        told: whether the speed that (4) tells is meant, or the true one.
        select: which cells and robots, among standing discs alone.
    """
    return median_of([float(np.median(speeds[0 if told else 1])) for speeds in _approaches(stored, select)])


def share_not_approaching(stored: StoredResults, select: Select) -> Estimate | None:
    """Return in what share of its periods of OA-FLC its disc comes no nearer: the median robot's, with the range."""
    return median_of([float((true <= 0.0).mean()) for _, true in _approaches(stored, select)])


def share_turning_left(stored: StoredResults, sensor: int, select: Select, special: bool = True) -> Estimate | None:
    """Return the share of robots that are always told to turn left in OA-FLC's periods with the danger at one sensor.

    Robots without such a period are left out.

    Args:
        stored: the study's results.
        sensor: the sensor's number.
        select: which cells and robots.
        special: whether periods in special situations count, too.
    """
    held = []
    for path in _paths(stored, stored.cases(**select)):
        periods = path.iloc[:-1]
        chosen = periods[(periods["active_flc"] != 0.0) & (periods["danger_sensor"] == sensor)]
        if not special:
            chosen = chosen[chosen["special_situation"] == 0.0]
        if len(chosen):
            held.append(bool((chosen["vR_mps"] > chosen["vL_mps"]).all()))
    return share_of(held)


def share_turning_by_wheels(stored: StoredResults, column: str, lasting_s: float, select: Select) -> Estimate | None:
    """Return the share of turns in which a robot ends up turning towards the wheel that is told to be slower.

    A turn is a spell of control periods in a state in which the same wheel is told to be faster. Wheels need time to
    follow, so a turn counts where it lasts long enough, and by the turning rate in its last period.

    Args:
        stored: the study's results.
        column: what tells the state: not 0 in it.
        lasting_s: how long a turn must last [s].
        select: which cells and robots.
    """
    held = []
    for path in _paths(stored, stored.cases(**select)):
        t_s, periods = path["t_s"].to_numpy(), path.iloc[:-1]
        faster = np.sign((periods["vR_mps"] - periods["vL_mps"]).to_numpy()) * (periods[column] != 0.0).to_numpy()
        for side, begin, length in spells(faster):
            end = begin + length
            if side != 0.0 and t_s[end] - t_s[begin] >= lasting_s - ROUNDED_S:
                held.append(bool(np.sign(periods["w_radps"].iloc[end - 1]) == side))
    return share_of_parts(held)


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
    passing: bool = False,
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
        passing: whether only episodes count in which all robots reached.
    """
    held = []
    rows = _passing(stored, select) if passing else stored.cases(**select)
    paths = dict(zip(rows.index, _paths(stored, rows), strict=True))
    for _, fleet in rows.groupby(["run_id", "episode"], sort=False):
        trajectories = {index: paths[at].iloc[:-1] for at, index in fleet["robot_index"].items()}
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


def mover_radius(stored: StoredResults, mover: int, select: Select) -> Estimate | None:
    """Return the radius of a mover of a world [m], by its number from 0."""
    runs = stored.cases(**select)["run_id"].unique()
    return median_of([stored.world(run_id).movers[mover].radius_m for run_id in runs])


def share_of_places(stored: StoredResults, places: Mapping[str, Sequence[Any]], select: Select) -> Estimate | None:
    """Return the share of printed places at which a world has what is printed there, each cell's world alike.

    Args:
        stored: the study's results.
        places: the printed [x, y] of its ``starts`` or ``goals``, or the lists of them that its ``movers`` go along.
        select: which cells.
    """
    found = []
    for run_id in stored.cases(**select)["run_id"].unique():
        world = stored.world(run_id)
        there: dict[str, Any] = {
            "starts": [[start.x_m, start.y_m] for start in world.starts],
            "goals": [[goal.x_m, goal.y_m] for goal in world.goals],
            "movers": [[[point.x_m, point.y_m] for point in mover.waypoints] for mover in world.movers],
        }
        found += [one == other for what, of in places.items() for one, other in zip(of, there[what], strict=True)]
    return share_of_parts(found)


def share_of_discs_met(stored: StoredResults, within_m: float, select: Select) -> Estimate | None:
    """Return the share of a world's standing discs that some robot came near to, from hull to hull, and none hit.

    Args:
        stored: the study's results.
        within_m: how near counts [m].
        select: which cells.
    """
    met = []
    for _, fleet in stored.cases(**select).groupby(["run_id", "episode"], sort=False):
        robots = records_of(fleet)
        run_id = robots[0]["run_id"]
        world = stored.world(run_id, robots[0]["episode"])
        robot = describe(Robot, stored.configuration(run_id)["configuration"]["robot"], "robot")
        places = np.concatenate([stored.trajectory(row)[["x_m", "y_m"]].to_numpy() for row in robots])
        hit = set(fleet.loc[fleet["hit"] == "disc", "hit_index"])
        for i, disc in enumerate(world.discs):
            away = np.hypot(*(places - (disc.x_m, disc.y_m)).T).min() - disc.radius_m - robot.radius_m
            met.append(away <= within_m and i not in hit)
    return share_of_parts(met)


def _approaches(stored: StoredResults, select: Select) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield of each robot's periods of OA-FLC the speed that (4) tells, and that with which this disc comes nearer.

    The first is the reading of the sensor of R, a ray from the robot's place to the discs, over R; the second follows
    from the robot's motion since the reading before. Robots without such a period are left out.
    """
    for row in records_of(stored.cases(**select)):
        configuration = stored.configuration(row["run_id"])["configuration"]
        angles = np.array([mount["heading_rad"] for mount in configuration["sensors"]["mounts"]])
        discs = np.array([(disc.x_m, disc.y_m, disc.radius_m) for disc in stored.world(row["run_id"]).discs])
        periods = stored.trajectory(row).iloc[:-1]
        places = periods[["x_m", "y_m"]].to_numpy()
        moved = np.diff(places, axis=0, prepend=places[:1])
        period_s = float(periods["t_s"].diff().median())
        on = (periods["active_flc"] != 0.0).to_numpy()
        active = periods[on]
        direction = active["heading_rad"].to_numpy() + angles[active["danger_sensor"].to_numpy(dtype=int)]
        away = discs[None, :, :2] - places[on][:, None, :]
        ahead = away[..., 0] * np.cos(direction)[:, None] + away[..., 1] * np.sin(direction)[:, None]
        half = discs[:, 2] ** 2 - (away**2).sum(axis=2) + ahead**2  # of the ray's chord, squared
        reach = np.where((half >= 0.0) & (ahead > 0.0), ahead - np.sqrt(np.maximum(half, 0.0)), np.inf)
        seen = np.isfinite(reach.min(axis=1))
        if seen.any():
            told = reach.min(axis=1) - configuration["robot"]["radius_m"]  # the sensors stand on the hull
            now = away[np.arange(len(away)), reach.argmin(axis=1)]  # to the centre of the disc that the ray hits
            nearer_m = np.hypot(*(now + moved[on]).T) - np.hypot(*now.T)
            yield (told / active["R_s"].to_numpy())[seen], nearer_m[seen] / period_s


def _passing(stored: StoredResults, select: Select) -> "pd.DataFrame":
    """Return the cases of the episodes in which all robots reached, also those that are not selected."""
    rows = stored.cases(**select)
    fleet = stored.cases(**{column: of for column, of in select.items() if column != "robot_index"})
    lost = set(zip(*(fleet.loc[fleet["outcome"] != "reached", of] for of in ("run_id", "episode")), strict=True))
    return rows.loc[[of not in lost for of in zip(rows["run_id"], rows["episode"], strict=True)]]


def _paths(stored: StoredResults, rows: "pd.DataFrame") -> "list[pd.DataFrame]":
    """Return the trajectory of each row; each cell's table is looked through once for all of them."""
    places = {
        run_id: stored.trajectories(run_id).groupby(["episode", "robot_index"]).indices
        for run_id in rows["run_id"].unique()
    }
    keys = zip(rows["run_id"], rows["episode"], rows["robot_index"], strict=True)
    return [stored.trajectories(run).iloc[places[run][(episode, index)]] for run, episode, index in keys]


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
