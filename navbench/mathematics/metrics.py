"""The metrics of one robot in one episode, each defined once, here."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled
from navbench.mathematics.geometry import wrap_angle

FloatArray = NDArray[np.float64]


class Metrics(NamedTuple):
    """What is measured of one robot in one episode; a failed robot's numbers are kept, up to its end.

    Attributes:
        path_length_m: length of the way that the centre covered, summed over exact arcs [m]; aouf2019's "travelled
            distance" (its Table 4).
        time_s: from the beginning to the robot's outcome [s]; aouf2019's "navigation time" (its Table 3).
        collisions: separate contacts: an unbroken touch counts once. 0 or 1 where a contact ends the robot.
        min_clearance_m: the least distance from the hull to anything, computed from the shapes at the end of each
            substep, not by the physics engine; below 0, how deep the last substep went in [m].
        mean_speed_mps: path_length_m / time_s, 0 for a robot that ended at once [m/s].
        heading_ise: the integral of the squared heading error over time, summed over control periods as
            sum(error^2 * period) [rad^2 s], the error being the trace's ``heading_error_rad`` (aouf2019's objective
            for its PIDs, on the error of its eq. 25); without it, the bearing of the goal minus the heading.
        total_turning_rad: the integral of the turning rate's size, summed over exact arcs [rad].
        w_sign_changes: how often the turning rate changed its sign from one control period to the next, periods of no
            turning left out; counts chattering.
        robot_collisions: of the collisions, those with another robot.
        standing_collisions: of the collisions, those in which the robot itself stood: it was driven into.
        goal_distance_m: from the centre to the goal at the end [m].
    """

    path_length_m: float
    time_s: float
    collisions: int
    min_clearance_m: float
    mean_speed_mps: float
    heading_ise: float
    total_turning_rad: float
    w_sign_changes: int
    robot_collisions: int
    standing_collisions: int
    goal_distance_m: float


def heading_ise(errors_rad: FloatArray, durations_s: FloatArray) -> float:
    """Return the integral of the squared heading error [rad^2 s].

    Args:
        errors_rad: (n,) the error in force in each control period [rad].
        durations_s: (n,) each period's length [s].
    """
    return float((errors_rad * errors_rad * durations_s).sum())


@compiled
def bearing_errors(poses: FloatArray, goal_x_m: float, goal_y_m: float) -> FloatArray:
    """Return the goal's bearing minus the heading, in (-pi, pi] [rad], for (n, 3) poses x, y [m], heading [rad]."""
    errors = np.empty(poses.shape[0])
    for i in range(poses.shape[0]):
        errors[i] = wrap_angle(math.atan2(goal_y_m - poses[i, 1], goal_x_m - poses[i, 0]) - poses[i, 2])
    return errors


def sign_changes(values: FloatArray) -> int:
    """Return how often a series changes its sign, zeros left out."""
    signs = np.sign(values[values != 0.0])
    return int(np.count_nonzero(signs[1:] != signs[:-1]))
