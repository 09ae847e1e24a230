"""Rewards: what the environments tell a reward of one control period, and the one that they use by default."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Period(NamedTuple):
    """What happened to some robots in one control period; all arrays are (episodes, robots).

    Attributes:
        distance_m: true distance to the goal at the end of the period [m].
        distance_before_m: the same at its beginning.
        distance_first_m: the same when the episode began.
        clearance_m: from the hull to the nearest thing, at the end of the period [m].
        reached: whether the goal was reached.
        collided: whether something was hit that ended the robot.
        timed_out: whether the time is over.
        actions: (episodes, robots, 2) what was asked for.
        share: the period's share of the time limit.
        radius_m: every robot's radius [m].
    """

    distance_m: FloatArray
    distance_before_m: FloatArray
    distance_first_m: FloatArray
    clearance_m: FloatArray
    reached: BoolArray
    collided: BoolArray
    timed_out: BoolArray
    actions: FloatArray
    share: float
    radius_m: float


Reward = Callable[[Period], FloatArray]


def progress(period: Period) -> FloatArray:
    """Return the default reward: progress, arrival, contact, and time.

    The share of the first distance to the goal by which the robot came nearer, 1 for arrival, -1 for a contact that
    ends it, and minus the period's share of the time limit. An episode's sum lies near 2 for a quick arrival, in any
    world, and below 1 without one.
    """
    nearer = (period.distance_before_m - period.distance_m) / period.distance_first_m
    return nearer + period.reached - 1.0 * period.collided - period.share
