"""Measures of fleets and of the things that they drive among.

Each is a measure as in ``navbench.analysis.measures``.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from navbench.analysis.claims import Measured
from navbench.analysis.fleets import clearances, fleets
from navbench.analysis.stored import Reading
from navbench.mathematics.statistics import newcombe_paired
from navbench.robot import Robot
from navbench.validation import describe

Select = Mapping[str, Any]


def share_of_fleets(reading: Reading, select: Select) -> Measured | None:
    """Return the share of episodes in which all robots reached their goals."""
    return Measured.share(fleets(reading.select(**select))["success"])


def difference_in_fleets(reading: Reading, select: Select, than: Select) -> Measured | None:
    """Return the paired difference of two shares of episodes in which all robots reached, with Newcombe's interval."""
    sides = []
    for chosen in (select, than):
        rows = reading.select(**chosen)
        names = rows[["run_id", "world", "seed"]].drop_duplicates()
        sides.append(fleets(rows).merge(names, on="run_id"))
    pairs = sides[0].merge(sides[1], on=["world", "seed", "episode"], suffixes=("", "_other"))
    if pairs.empty:
        return None
    return Measured.of(newcombe_paired(*(pairs[f"success{side}"].to_numpy(dtype=bool) for side in ("", "_other"))))


def difference_in_fleets_is_above(reading: Reading, select: Select, than: Select) -> Measured | None:
    """Return 1 where more fleets reach than another controller's by more than chance: the whole interval is above 0."""
    difference = difference_in_fleets(reading, select, than)
    return None if difference is None else Measured(float(difference.low > 0.0), 0.0, 1.0, difference.n)


def share_of_fleets_free(reading: Reading, select: Select) -> Measured | None:
    """Return the share of episodes in which no robot touched anything."""
    return Measured.share((clearances(reading.select(**select))["contacts"] == 0).to_numpy())


def share_of_fleets_clearer(reading: Reading, select: Select, than: Select) -> Measured | None:
    """Return the share of episodes in which the least clearance of all robots is greater than another controller's.

    Args:
        reading: the study's results.
        select: the cells that are said to keep further away from everything.
        than: the cells that they are compared with, over the same starts.
    """
    here, there = (clearances(reading.select(**side)) for side in (select, than))
    pairs = here.merge(there, on=["world", "seed", "episode"], suffixes=("", "_other"))
    return Measured.share((pairs["clearance_m"] > pairs["clearance_m_other"]).to_numpy())


def mover_speed(reading: Reading, mover: int, leg: int, select: Select) -> Measured | None:
    """Return how fast a mover drives one of its legs, as a share of the robots' wheel-speed limit.

    Args:
        reading: the study's results.
        mover: its number in the world, from 0.
        leg: the leg's number, from 0.
        select: which cells; each cell counts once.
    """
    shares = []
    for run_id in reading.select(**select)["run_id"].unique():
        world = reading.world(run_id)
        one = world.movers[mover]
        begin, end = one.schedule()[leg, :2] - one.phase_s
        early, late = (one.place(begin + part * (end - begin)) for part in (0.25, 0.75))
        robot = describe(Robot, reading.configuration(run_id)["configuration"]["robot"], "robot")
        shares.append(math.dist(early, late) / (0.5 * (end - begin)) / robot.wheel_speed_max_mps)
    return Measured.median(shares)


def share_of_discs_met(reading: Reading, within_m: float, select: Select) -> Measured | None:
    """Return the share of a world's standing discs that some robot came near to, from hull to hull, and none hit.

    Args:
        reading: the study's results.
        within_m: how near counts [m].
        select: which cells.
    """
    met = []
    for _, fleet in reading.select(**select).groupby(["run_id", "episode"], sort=False):
        robots = fleet.to_dict("records")
        run_id = robots[0]["run_id"]
        world = reading.world(run_id, robots[0]["episode"])
        robot = describe(Robot, reading.configuration(run_id)["configuration"]["robot"], "robot")
        places = np.concatenate([reading.way(row)[["x_m", "y_m"]].to_numpy() for row in robots])
        hit = set(fleet.loc[fleet["hit"] == "disc", "hit_index"])
        for i, disc in enumerate(world.discs):
            away = np.hypot(*(places - (disc.x_m, disc.y_m)).T).min() - disc.radius_m - robot.radius_m
            met.append(away <= within_m and i not in hit)
    return Measured.share(met)


MEASURES = (
    share_of_fleets,
    share_of_fleets_free,
    share_of_fleets_clearer,
    difference_in_fleets,
    difference_in_fleets_is_above,
    mover_speed,
    share_of_discs_met,
)
