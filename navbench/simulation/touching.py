"""When a robot on an arc first touches something, arrives or crosses a line: the search for one instant, compiled.

Between two changes of its wheels' speeds a robot moves along one arc. On it the distance to anything convex that stands
or moves in a straight line is bounded from below by a parabola: it is convex in the robot's place, and the place has a
known acceleration. The parabola's root is an instant before which nothing can be touched; stepping from root to root
comes to the first contact, or past the nearest point, in a few steps.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled
from navbench.mathematics.geometry import box_gap, polygon_gap
from navbench.mathematics.kinematics import advance_arc

FloatArray = NDArray[np.float64]

TOUCH_RADII = 1e-12  # what is nearer touches
TURN_S = 1e-9  # movers that turn within this have turned
GRID_S = 1e-6 / math.pi  # where a search is taken up again; no instant that people write lies on it
STEPS_MAX = 100_000  # of the search for one contact: ten are many, but to circle a post at 1e-9 radii takes thousands
NONE, BOX, DISC, POLYGON, CELL, ROBOT_KIND, GOAL, LINE = range(8)  # what may be met


@compiled
def first_touch(
    robot: Any, other: Any, fixed: Any, begin: float, end: float, kind: int, things: FloatArray, k: int
) -> float:
    """Return when between two instants of a substep a moving robot first touches something, infinite for never.

    A robot that touches already and does not come nearer does not touch anew; a goal is reached from within too. What
    is found is found again from an instant of a grid: the same to the last bit, wherever the search began.

    Args:
        robot: of ``ROBOT``.
        other: of ``ROBOT``: the other one for ``ROBOT_KIND``, else of no matter.
        fixed: of ``FIXED``.
        begin: the first instant, at which the thing is where its row says [s].
        end: the last one [s].
        kind: ``BOX``, ``DISC``, ``POLYGON``, ``ROBOT_KIND``, ``GOAL``, or ``LINE`` for a finish line.
        things: its rows, if it has any.
        k: its row.
    """
    t, is_found = begin, False
    for _ in range(STEPS_MAX):
        gap, rate, bend = _gap(robot, other, fixed, t, begin, kind, things, k)
        if gap > TOUCH_RADII * fixed.radius_m:
            t += _step(gap, rate, bend)
        elif rate >= 0.0 and kind != GOAL and kind != LINE:
            t += max(_leave(rate, bend), TURN_S)
        elif is_found:
            break
        else:
            t, is_found = max(math.floor(t / GRID_S) * GRID_S, robot.arc_t_s), True
        if t > end:
            return math.inf
    return max(t, begin)


@compiled
def _gap(
    robot: Any, other: Any, fixed: Any, t: float, begin: float, kind: int, things: FloatArray, k: int
) -> tuple[float, float, float]:
    """Return how far a robot is from touching at an instant [m], how fast that grows, and what it may lose of that.

    Everything is as in ``first_touch``; the last number is the most by which the growth slows down [m/s^2].
    """
    v, w = velocities(robot, fixed.track_m)
    x, y, heading = pose_at(robot, t, fixed.track_m)
    vx, vy, bend, near = v * math.cos(heading), v * math.sin(heading), abs(v * w), fixed.radius_m
    cx, cy = other.x_m, other.y_m
    if kind == BOX or kind == LINE:
        gap, nx, ny = box_gap(x, y, things, k)
        return gap - (near if kind == BOX else 0.0), nx * vx + ny * vy, bend
    if kind == DISC or kind == POLYGON:
        ux, uy = things[k, 3], things[k, 4]
        x, y, vx, vy = x - ux * (t - begin), y - uy * (t - begin), vx - ux, vy - uy
        if kind == POLYGON:
            gap, nx, ny = polygon_gap(x, y, things, k)
            return gap - near, nx * vx + ny * vy, bend
        cx, cy, near = things[k, 0], things[k, 1], near + things[k, 2]
    elif kind == GOAL:
        cx, cy, near = robot.goal_x_m, robot.goal_y_m, fixed.goal_tolerance_m
    else:
        near *= 2.0
        if other.running and not other.is_held:
            v, w = velocities(other, fixed.track_m)
            cx, cy, heading = pose_at(other, t, fixed.track_m)
            vx, vy, bend = vx - v * math.cos(heading), vy - v * math.sin(heading), bend + abs(v * w)
    dx, dy = x - cx, y - cy
    away = math.hypot(dx, dy)
    return away - near, (dx * vx + dy * vy) / max(away, 1e-300), bend


@compiled
def velocities(robot: Any, track_m: float) -> tuple[float, float]:
    """Return a moving robot's speed [m/s] and turning rate [rad/s] on its arc."""
    left, right = robot.left_mean_mps, robot.right_mean_mps
    return 0.5 * (left + right), (right - left) / track_m


@compiled
def pose_at(robot: Any, t_s: float, track_m: float) -> tuple[float, float, float]:
    """Return where a moving robot is at an instant of its arc."""
    v, w = velocities(robot, track_m)
    pose: tuple[float, float, float] = advance_arc(
        robot.arc_x_m, robot.arc_y_m, robot.arc_heading_rad, v, w, t_s - robot.arc_t_s
    )
    return pose


@compiled
def _step(gap: float, rate: float, bend: float) -> float:
    """Return for how long gap + rate t - bend t^2 / 2 stays positive, for a positive gap; infinite for ever."""
    falls = math.sqrt(rate * rate + 2.0 * bend * gap) - rate
    return 2.0 * gap / falls if falls > 0.0 else math.inf


@compiled
def _leave(rate: float, bend: float) -> float:
    """Return for how long rate t - bend t^2 / 2 stays positive; infinite for ever."""
    return 2.0 * rate / bend if bend > 0.0 else math.inf
