"""Measures of fleets and of the things that they drive among.

Each is a measure as in ``navbench.analysis.measures``.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from navbench.analysis.estimates import median_of, share_of
from navbench.analysis.fleets import clearances, fleets
from navbench.analysis.stored import StoredResults
from navbench.mathematics.statistics import Estimate, newcombe_paired
from navbench.robot import Robot
from navbench.validation import describe

Select = Mapping[str, Any]


def share_of_fleets(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the share of episodes in which all robots reached their goals."""
    return share_of(fleets(stored.select(**select))["success"])


def difference_in_fleets(stored: StoredResults, select: Select, than: Select) -> Estimate | None:
    """Return the paired difference of two shares of episodes in which all robots reached, with Newcombe's interval."""
    sides = []
    for chosen in (select, than):
        rows = stored.select(**chosen)
        names = rows[["run_id", "world", "seed"]].drop_duplicates()
        sides.append(fleets(rows).merge(names, on="run_id"))
    pairs = sides[0].merge(sides[1], on=["world", "seed", "episode"], suffixes=("", "_other"))
    if pairs.empty:
        return None
    return newcombe_paired(*(pairs[f"success{side}"].to_numpy(dtype=bool) for side in ("", "_other")))


def difference_in_fleets_is_above(stored: StoredResults, select: Select, than: Select) -> Estimate | None:
    """Return 1 where more fleets reach than another controller's by more than chance: the whole interval is above 0."""
    difference = difference_in_fleets(stored, select, than)
    return None if difference is None else Estimate(float(difference.low > 0.0), 0.0, 1.0, difference.n)


def share_of_fleets_free(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the share of episodes in which no robot touched anything."""
    return share_of((clearances(stored.select(**select))["contacts"] == 0).to_numpy())


def share_of_fleets_clearer(stored: StoredResults, select: Select, than: Select) -> Estimate | None:
    """Return the share of episodes in which the least clearance of all robots is greater than another controller's.

    Args:
        stored: the study's results.
        select: the cells that are said to keep further away from everything.
        than: the cells that they are compared with, over the same starts.
    """
    here, there = (clearances(stored.select(**side)) for side in (select, than))
    pairs = here.merge(there, on=["world", "seed", "episode"], suffixes=("", "_other"))
    return share_of((pairs["clearance_m"] > pairs["clearance_m_other"]).to_numpy())


def mover_speed(stored: StoredResults, mover: int, leg: int, select: Select) -> Estimate | None:
    """Return how fast a mover drives one of its legs, as a share of the robots' wheel-speed limit.

    Args:
        stored: the study's results.
        mover: its number in the world, from 0.
        leg: the leg's number, from 0.
        select: which cells; each cell counts once.
    """
    shares = []
    for run_id in stored.select(**select)["run_id"].unique():
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
    for _, fleet in stored.select(**select).groupby(["run_id", "episode"], sort=False):
        robots = fleet.to_dict("records")
        run_id = robots[0]["run_id"]
        world = stored.world(run_id, robots[0]["episode"])
        robot = describe(Robot, stored.configuration(run_id)["configuration"]["robot"], "robot")
        places = np.concatenate([stored.trajectory(row)[["x_m", "y_m"]].to_numpy() for row in robots])
        reasons = set(fleet["reason"])
        for i, disc in enumerate(world.discs):
            away = np.hypot(*(places - (disc.x_m, disc.y_m)).T).min() - disc.radius_m - robot.radius_m
            met.append(away <= within_m and f"hit disc {i}" not in reasons)
    return share_of(met)


MEASURES = (
    share_of_fleets,
    share_of_fleets_free,
    share_of_fleets_clearer,
    difference_in_fleets,
    difference_in_fleets_is_above,
    mover_speed,
    share_of_discs_met,
)
