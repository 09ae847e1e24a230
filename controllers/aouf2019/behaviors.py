"""When a robot of ``aouf2019`` heads for its goal and when it follows a wall: the arbitration, and what it remembers.

The paper says only that the robot switches to wall following when it makes no progress before an obstacle, and back
when the path is clear. Left open, and decided here (the names are those of ``Behaviors``):

- Wall following begins where a front sensor (all but the three rear ones) reads below ``unsafe_m``; or where one reads
  below ``at_obstacle_m`` and what ``begins`` names holds: "stalled", the best distance to the goal so far has improved
  by less than ``stall_min_progress_m`` in the last ``stall_window_s``, all of it spent in the other behaviour;
  "sliding", the robot would slide along the wall (as below), which asks that the goal lies beyond it and no more; or
  "both".
- It keeps the wall on the side of the nearest front sensor. Where both sides are equally near (``side_tie_m``), the
  side whose direction along the wall leads nearer to the goal; where that is equal too, the left.
- It ends when the robot is nearer to the goal by ``progress_epsilon_m`` than it was ever before wall following began
  (d_prog), and does not slide: u'_fw,t is no sum of positive shares of u_gtg and u_ao. That step already blends. Both
  tests are those of simiam, the simulator of a course on mobile robots that teaches these behaviours, whose d_prog is
  the distance at which wall following began (``progress_from``: "switch"), not the best one ("best").
"""

import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from pydantic.dataclasses import dataclass

from navbench.contract import FloatArray, Setup
from navbench.policy import CompiledController, compiled, part, scratch
from navbench.validation import STRICT, NonNegative, Positive, Probability

from .equations import (
    SENSOR_ROLES,
    Vector,
    avoidance_vector,
    blend,
    frame,
    goal_vector,
    heading_error,
    heading_of,
    is_sliding,
    points_seen,
    side_of_wall,
    wall_direction,
    wall_following,
)

GO_TO_GOAL, FOLLOW_WALL = 0.0, 1.0  # values of the trace's "behavior"
NO_SIDE = 0.0  # of its "side" where no wall is followed; else ``LEFT`` or ``RIGHT``

TRACE = (
    "behavior",
    "side",
    "heading_error_rad",
    "goal_distance_m",
    "progress_distance_m",
    "front_clearance_m",
    "at_obstacle",
    "unsafe",
    "stalled",
    "progress_made",
    "sliding",
    "periods_in_behavior",
)
(
    BEHAVIOR,
    SIDE,
    HEADING_ERROR,
    GOAL_DISTANCE,
    PROGRESS_DISTANCE,
    FRONT_CLEARANCE,
    AT_OBSTACLE,
    UNSAFE,
    STALLED,
    PROGRESS_MADE,
    SLIDING,
    PERIODS,
) = range(len(TRACE))
MEMORY, BEST, LAW_MEMORY = range(3)  # parts of a policy's state; the last one is a steering law's own
MOUNTS, WEIGHTS, THRESHOLDS, LAW, SECOND_LAW, CHOICE = range(6)  # parts of its parameters; so are the last three


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Behaviors:
    """What the behaviours and the arbitration are told.

    Attributes:
        blend_alpha: share of the goal's direction in the blend, in [0, 1].
        sensor_weights: weight of each sensor in the sum, one for each of ``SENSOR_ROLES``.
        wall_distance_m: distance from the robot's centre at which a wall is followed [m].
        at_obstacle_m: a front reading below it is an obstacle [m].
        unsafe_m: a front reading below it begins wall following at once [m].
        stall_window_s: time over which progress is judged [s].
        stall_min_progress_m: less than this over the window is none [m].
        progress_epsilon_m: how much nearer to the goal than d_prog ends wall following [m].
        side_tie_m: readings that differ by less are equally near [m].
        begins: what begins wall following at an obstacle.
        progress_from: what d_prog is: the best distance to the goal before wall following, or the one at its beginning.
    """

    blend_alpha: Probability
    sensor_weights: Mapping[str, Positive]
    wall_distance_m: Positive
    at_obstacle_m: Positive
    unsafe_m: NonNegative
    stall_window_s: Positive
    stall_min_progress_m: NonNegative
    progress_epsilon_m: NonNegative
    side_tie_m: NonNegative
    begins: Literal["stalled", "sliding", "both"]
    progress_from: Literal["best", "switch"]

    def __post_init__(self) -> None:
        """Check what no single type shows."""
        if set(self.sensor_weights) != set(SENSOR_ROLES):
            raise ValueError(f"sensor_weights: must name exactly {', '.join(SENSOR_ROLES)}")
        if self.unsafe_m > self.at_obstacle_m:
            raise ValueError(f"unsafe_m={self.unsafe_m}: must not exceed at_obstacle_m={self.at_obstacle_m}")

    def begin(self, setup: Setup) -> tuple[list[Any], list[Any]]:
        """Return the first parts of a policy's state and of its parameters, as an episode begins with them.

        Raises:
            ValueError: the ring's sensors are not ``SENSOR_ROLES``, in this order.
        """
        roles = tuple(sensor.role for sensor in setup.sensors)
        if roles != SENSOR_ROLES:
            raise ValueError(f"sensors are {', '.join(roles) or 'none'}; needed are {', '.join(SENSOR_ROLES)}")
        memory, best_m = np.zeros(len(TRACE)), np.zeros(max(1, round(self.stall_window_s / setup.period_s)))
        memory[PROGRESS_DISTANCE] = math.inf
        mounts = [frame(sensor.x_m, sensor.y_m, sensor.heading_rad) for sensor in setup.sensors]
        weights = [self.sensor_weights[role] for role in SENSOR_ROLES]
        steering = (self.blend_alpha, self.wall_distance_m, self.at_obstacle_m, self.unsafe_m)
        switching = (self.stall_min_progress_m, self.progress_epsilon_m, self.side_tie_m)
        readings = (("stalled", "sliding", "both").index(self.begins), self.progress_from == "switch")
        return [memory, best_m], [mounts, weights, (*steering, *switching, *readings)]


@dataclass(kw_only=True, config=STRICT)
class Behaving(CompiledController):
    """What steers by the heading error of the active behaviour.

    Attributes:
        sensor_roles: the sensors that it needs, in this order.
        trace_words: what the trace's values are called.
        behaviors: what the behaviours are told.
    """

    sensor_roles = SENSOR_ROLES
    trace_words = {"behavior": ("go to goal", "follow wall")}
    behaviors: Behaviors


@compiled
def active_heading_error(
    state: FloatArray,
    parameters: FloatArray,
    ranges_m: FloatArray,
    pose: tuple[float, float, float],
    goal: Vector,
    trace: FloatArray,
) -> float:
    """Return the heading error of the behaviour that is active in this control period [rad].

    Args:
        state: begins with what ``Behaviors.begin`` returns for it, read and written.
        parameters: begins with what ``Behaviors.begin`` returns for it.
        ranges_m: (9,) readings [m].
        pose: x [m], y [m] and heading [rad].
        goal: the goal's x and y [m].
        trace: begins with ``TRACE``, which is written.
    """
    memory, thresholds, u_p = part(state, MEMORY), part(parameters, THRESHOLDS), (pose[0], pose[1])
    points = scratch((len(ranges_m), 2))
    points_seen(part(parameters, MOUNTS), ranges_m, pose, points)
    u_ao = avoidance_vector(points, part(parameters, WEIGHTS), u_p)
    u_gtg = goal_vector(goal, u_p)
    arbitrate(memory, part(state, BEST), thresholds[2:], ranges_m, points, u_gtg, u_ao)
    if memory[BEHAVIOR] == GO_TO_GOAL:
        u = blend(u_gtg, u_ao, thresholds[0])
    else:
        u = wall_following(points, ranges_m, memory[SIDE], u_p, thresholds[1])
    memory[HEADING_ERROR] = heading_error(heading_of(u), pose[2])
    trace[: len(memory)] = memory
    error: float = memory[HEADING_ERROR]
    return error


@compiled
def arbitrate(
    memory: FloatArray,
    best_m: FloatArray,
    thresholds: FloatArray,
    ranges_m: FloatArray,
    points: FloatArray,
    u_gtg: Vector,
    u_ao: Vector,
) -> None:
    """Switch to the other behaviour where it is time to, and note the tests that were made.

    Args:
        memory: as ``TRACE``, read and written.
        best_m: as in ``has_stalled``, read and written.
        thresholds: at_obstacle_m, unsafe_m, stall_min_progress_m, progress_epsilon_m and side_tie_m [m]; 1 where
            sliding begins wall following, 2 where that and a stall do, else 0; and above 0 where d_prog is the
            distance at its beginning.
        ranges_m: (9,) readings [m].
        points: (9, 2) what they mean in the world [m].
        u_gtg: from the robot to the goal [m].
        u_ao: the weighted sum of the vectors from the robot to the points [m].
    """
    distance_m, clearance_m = math.hypot(u_gtg[0], u_gtg[1]), ranges_m[1:7].min()
    memory[GOAL_DISTANCE], memory[FRONT_CLEARANCE] = distance_m, clearance_m
    memory[AT_OBSTACLE], memory[UNSAFE] = clearance_m < thresholds[0], clearance_m < thresholds[1]
    memory[STALLED], memory[PROGRESS_MADE], memory[SLIDING] = 0.0, 0.0, 0.0
    memory[PERIODS] += 1.0
    if memory[BEHAVIOR] == GO_TO_GOAL:
        memory[PROGRESS_DISTANCE] = min(memory[PROGRESS_DISTANCE], distance_m)
        memory[STALLED] = has_stalled(memory, best_m, thresholds[2])
        side = side_of_wall(points, ranges_m, u_gtg, thresholds[4])
        if thresholds[5] > 0.0:
            memory[SLIDING] = is_sliding(u_gtg, u_ao, wall_direction(points, ranges_m, side))
        begins = memory[SLIDING] if thresholds[5] > 0.0 else 1.0
        if thresholds[5] != 1.0:
            begins *= memory[STALLED]
        if memory[UNSAFE] or (memory[AT_OBSTACLE] and begins):
            switch(memory, FOLLOW_WALL, side)
            if thresholds[6] > 0.0:
                memory[PROGRESS_DISTANCE] = distance_m
    else:
        memory[PROGRESS_MADE] = distance_m < memory[PROGRESS_DISTANCE] - thresholds[3]
        memory[SLIDING] = is_sliding(u_gtg, u_ao, wall_direction(points, ranges_m, memory[SIDE]))
        if memory[PROGRESS_MADE] and not memory[SLIDING]:
            switch(memory, GO_TO_GOAL, NO_SIDE)


@compiled
def has_stalled(memory: FloatArray, best_m: FloatArray, min_progress_m: float) -> bool:
    """Return whether the best distance has hardly improved over the window, and remember it.

    Args:
        memory: as ``TRACE``; read are the best distance and the periods in this behaviour, counted from 1.
        best_m: (n_periods,) the best distance at each of the window's periods, written in a circle [m].
        min_progress_m: less is no progress [m].
    """
    periods, best = int(memory[PERIODS]), memory[PROGRESS_DISTANCE]
    slot = periods % len(best_m)
    stalled: bool = periods > len(best_m) and best_m[slot] - best < min_progress_m
    best_m[slot] = best
    return stalled


@compiled
def switch(memory: FloatArray, behavior: float, side: float) -> None:
    """Begin a behaviour."""
    memory[BEHAVIOR], memory[SIDE], memory[PERIODS] = behavior, side, 0.0
