"""The two behaviours of Aouf, Boussaid and Sakly and the arbitration between them, which ``sflc`` and ``pid`` share.

A. Aouf, L. Boussaid, A. Sakly, "Same Fuzzy Logic Controller for Two-Wheeled Mobile Robot Navigation in Strange
Environments", Journal of Robotics 2019, 2465219, doi:10.1155/2019/2465219; equations 7 to 24.

Towards the goal the robot heads along a blend of the direction to the goal and the weighted sum of what its infrared
sensors see, which points to where the room is. Where that leads into a dead end, it follows the wall, which it
estimates from two of its sensors, until it is nearer to the goal than ever and free to go. Both behaviours end in one
number, the error of the heading, which the steering law (fuzzy or PID) turns into speeds.

| symbol | here | unit | equation |
|---|---|---|---|
| d_i, v_i | reading of sensor i, its point in the sensor's frame | m | 7 |
| M_t | rotation by theta, then translation by (x, y) | | 9 |
| v'_i, v''_i | the point in the robot's frame, in the world | m | 8, 10 |
| u_i, alpha_i | vector from the robot to the point, ``sensor_weights`` | m, 1 | 11 |
| u_ao, theta_ao | sum of the weighted u_i, its heading | m, rad | 11, 12 |
| u_gtg | vector from the robot to the goal | m | 13 |
| alpha, u_ao_gtg, theta_ao_gtg | ``blend_alpha``, the blend, its heading | 1, 1, rad | 14, 15 |
| P_1, P_2 | the rear and the front point of the estimated wall | m | 17 |
| u_fw,t, u'_fw,t | along the wall, and its unit vector | m, 1 | 17, 18 |
| u_a, u_p | P_1, the robot's position | m | 19 |
| u_fw,p | from the robot to the wall, perpendicular | m | 20 |
| d_fw, u_fw, theta_fw | ``wall_distance_m``, wall following vector, its heading | m, m, rad | 21, 22, 23 |
| Phi_ao_gtg, Phi_fw | heading errors | rad | 16, 24 |

Errata, corrected here: u_i is v''_i - (x, y), which (11) leaves unsaid; (12), (15) and (23) need all four quadrants;
(14) blends unit vectors; (16) and (24) are wrapped to (-pi, pi]; the product in (20) is a dot product; u'_fw,p is an
error vector in (21) and a unit vector in (22), so u_fw = d_fw u'_fw,t + (u_fw,p - d_fw p) with p = u_fw,p / |u_fw,p|.

The paper says only that the robot switches to wall following when it makes no progress before an obstacle, and back
when the path is clear. Left open, and decided here (the parameters are those of ``aouf2019_behaviors``):

- A sensor that sees nothing counts in (11), and may be P_1 or P_2, with its point at the end of its range.
- Wall following begins where a front sensor (all but the three rear ones) reads below ``unsafe_m``; or where one reads
  below ``at_obstacle_m`` and the best distance to the goal so far has improved by less than ``stall_min_progress_m``
  in the last ``stall_window_s``, all of it spent in the other behaviour.
- It keeps the wall on the side of the nearest front sensor. Where both sides are equally near (``side_tie_m``), the
  side whose direction along the wall leads nearer to the goal; where that is equal too, the left.
- P_1 and P_2 come from the two smallest readings of the four sensors of that side; of equal readings the one further
  to the rear counts as smaller, so that the robot turns round a corner behind which it sees nothing.
- It ends when the robot is nearer to the goal by ``progress_epsilon_m`` than it was ever before wall following began
  (d_prog), and does not slide: u'_fw,t is no sum of positive shares of u_gtg and u_ao. That step already blends. Both
  tests are those of simiam, the simulator of a course on mobile robots that teaches these behaviours.
"""

import math

import numpy as np

from navbench.compiled import compiled
from navbench.contract import FloatArray
from navbench.mathematics.geometry import wrap_angle

Vector = tuple[float, float]

SENSOR_ROLES = (  # simiam's sensors 1 to 9, clockwise; 2 to 7, here 1 to 6, are the front ones
    "rear_left",
    "left",
    "front_left_outer",
    "front_left_inner",
    "front_right_inner",
    "front_right_outer",
    "right",
    "rear_right",
    "rear",
)
GO_TO_GOAL, FOLLOW_WALL = 0.0, 1.0  # values of the trace's "behavior"
LEFT, NO_SIDE, RIGHT = 1.0, 0.0, -1.0  # values of the trace's "side": where the followed wall is

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

# The parameters that ``step`` takes as they are, in its order: a plain tuple passes into compiled code faster than a
# named one.
THRESHOLDS = (
    "blend_alpha",
    "wall_distance_m",
    "at_obstacle_m",
    "unsafe_m",
    "stall_min_progress_m",
    "progress_epsilon_m",
    "side_tie_m",
)


@compiled
def sensor_point(d: float) -> Vector:
    """Return the point v_i that a reading means, in the sensor's frame."""
    return d, 0.0  # eq. (7)


@compiled
def to_robot_frame(x_s: float, y_s: float, theta_s: float, v: Vector) -> Vector:
    """Return v'_i, the point in the robot's frame."""
    return transform(x_s, y_s, theta_s, v)  # eq. (8)


@compiled
def transform(x: float, y: float, theta: float, v: Vector) -> Vector:
    """Return M_t(x, y, theta) [v; 1]."""
    c, s = math.cos(theta), math.sin(theta)
    return c * v[0] - s * v[1] + x, s * v[0] + c * v[1] + y  # eq. (9)


@compiled
def to_world_frame(x: float, y: float, theta: float, v: Vector) -> Vector:
    """Return v''_i, the point in the world, from the robot's pose and the point in its frame."""
    return transform(x, y, theta, v)  # eq. (10)


@compiled
def avoidance_vector(points: FloatArray, alpha: FloatArray, u_p: Vector) -> Vector:
    """Return u_ao, the weighted sum of the vectors u_i from the robot to the points."""
    x, y = 0.0, 0.0
    for i in range(len(points)):
        x += alpha[i] * (points[i, 0] - u_p[0])
        y += alpha[i] * (points[i, 1] - u_p[1])
    return x, y  # eq. (11)


@compiled
def heading_of(u: Vector) -> float:
    """Return the heading of a vector: theta_ao, theta_ao_gtg or theta_fw."""
    return math.atan2(u[1], u[0])  # eqs (12), (15), (23)


@compiled
def goal_vector(goal: Vector, u_p: Vector) -> Vector:
    """Return u_gtg, from the robot to the goal."""
    return goal[0] - u_p[0], goal[1] - u_p[1]  # eq. (13)


@compiled
def blend(u_gtg: Vector, u_ao: Vector, alpha: float) -> Vector:
    """Return u_ao_gtg, both away from what is near and towards the goal."""
    g, a = unit(u_gtg), unit(u_ao)
    return alpha * g[0] + (1.0 - alpha) * a[0], alpha * g[1] + (1.0 - alpha) * a[1]  # eq. (14)


@compiled
def heading_error(theta_wanted: float, theta: float) -> float:
    """Return Phi_ao_gtg or Phi_fw, how far to turn to the left."""
    error: float = wrap_angle(theta_wanted - theta)
    return error  # eqs (16), (24)


@compiled
def wall_vector(p_1: Vector, p_2: Vector) -> Vector:
    """Return u_fw,t, the piece of wall from the rear point to the front point."""
    return p_2[0] - p_1[0], p_2[1] - p_1[1]  # eq. (17)


@compiled
def unit(u: Vector) -> Vector:
    """Return the vector at length 1, such as u'_fw,t; a zero vector stays zero."""
    length = math.hypot(u[0], u[1])
    if length == 0.0:
        return 0.0, 0.0
    return u[0] / length, u[1] / length  # eq. (18)


@compiled
def perpendicular_to_wall(u_a: Vector, u_p: Vector, t: Vector) -> Vector:
    """Return u_fw,p, from the robot u_p to the nearest point of the line through u_a along u'_fw,t."""
    x, y = u_a[0] - u_p[0], u_a[1] - u_p[1]  # eq. (19)
    along = x * t[0] + y * t[1]
    return x - along * t[0], y - along * t[1]  # eq. (20)


@compiled
def distance_error(u_fw_p: Vector, d_fw: float) -> Vector:
    """Return what is missing to the distance d_fw: towards the wall where it is too far, away where it is too near."""
    p = unit(u_fw_p)
    return u_fw_p[0] - d_fw * p[0], u_fw_p[1] - d_fw * p[1]  # eq. (21)


@compiled
def following_vector(t: Vector, error: Vector, d_fw: float) -> Vector:
    """Return u_fw, along the wall and back to the distance d_fw."""
    return d_fw * t[0] + error[0], d_fw * t[1] + error[1]  # eq. (22)


@compiled
def wall_points(points: FloatArray, ranges_m: FloatArray, side: float) -> tuple[Vector, Vector]:
    """Return P_1 and P_2 of the wall on a side; sensors count from the rear, and the first of equal readings wins."""
    rear, forward = (0, 1) if side == LEFT else (7, -1)
    nearest, second = rear, -1
    for i in (rear + forward, rear + 2 * forward, rear + 3 * forward):
        if ranges_m[i] < ranges_m[nearest]:
            nearest, second = i, nearest
        elif second < 0 or ranges_m[i] < ranges_m[second]:
            second = i
    p_1, p_2 = (nearest, second) if (second - nearest) * forward > 0 else (second, nearest)
    return (points[p_1, 0], points[p_1, 1]), (points[p_2, 0], points[p_2, 1])


@compiled
def wall_direction(points: FloatArray, ranges_m: FloatArray, side: float) -> Vector:
    """Return u'_fw,t of the wall on a side."""
    p_1, p_2 = wall_points(points, ranges_m, side)
    return unit(wall_vector(p_1, p_2))


@compiled
def wall_following(points: FloatArray, ranges_m: FloatArray, side: float, u_p: Vector, d_fw: float) -> Vector:
    """Return u_fw along the wall on a side."""
    t = wall_direction(points, ranges_m, side)
    u_a, _ = wall_points(points, ranges_m, side)
    return following_vector(t, distance_error(perpendicular_to_wall(u_a, u_p, t), d_fw), d_fw)


@compiled
def is_sliding(u_gtg: Vector, u_ao: Vector, t: Vector) -> bool:
    """Return whether [u_gtg u_ao] sigma = u'_fw,t has a solution of two positive shares."""
    determinant = u_gtg[0] * u_ao[1] - u_gtg[1] * u_ao[0]
    if determinant == 0.0:
        return False
    sigma_1 = (t[0] * u_ao[1] - t[1] * u_ao[0]) / determinant
    sigma_2 = (u_gtg[0] * t[1] - u_gtg[1] * t[0]) / determinant
    return sigma_1 > 0.0 and sigma_2 > 0.0


@compiled
def side_of_wall(points: FloatArray, ranges_m: FloatArray, u_gtg: Vector, tie_m: float) -> float:
    """Return the side on which to keep the wall, ``LEFT`` or ``RIGHT``."""
    left_m = min(ranges_m[1], ranges_m[2], ranges_m[3])
    right_m = min(ranges_m[4], ranges_m[5], ranges_m[6])
    if abs(left_m - right_m) >= tie_m:
        return LEFT if left_m < right_m else RIGHT
    t_left, t_right = wall_direction(points, ranges_m, LEFT), wall_direction(points, ranges_m, RIGHT)
    left_gain = t_left[0] * u_gtg[0] + t_left[1] * u_gtg[1]
    right_gain = t_right[0] * u_gtg[0] + t_right[1] * u_gtg[1]
    return LEFT if left_gain >= right_gain else RIGHT


@compiled
def has_stalled(memory: FloatArray, best_m: FloatArray, min_progress_m: float) -> bool:
    """Return whether the best distance has hardly improved over the window, and remember it.

    Args:
        memory: as ``TRACE``; read are the best distance and the periods in this behaviour, counted from 1.
        best_m: (n_periods,) the best distance at each of the window's periods, written in a circle [m].
        min_progress_m: less is no progress [m].
    """
    periods = int(memory[PERIODS])
    slot = periods % len(best_m)
    best = memory[PROGRESS_DISTANCE]
    stalled: bool = periods > len(best_m) and best_m[slot] - best < min_progress_m
    best_m[slot] = best
    return stalled


@compiled
def switch(memory: FloatArray, behavior: float, side: float) -> None:
    """Begin a behaviour."""
    memory[BEHAVIOR], memory[SIDE], memory[PERIODS] = behavior, side, 0.0


@compiled
def step(
    memory: FloatArray,
    best_m: FloatArray,
    mounts: FloatArray,
    weights: FloatArray,
    thresholds: tuple[float, ...],
    ranges_m: FloatArray,
    x: float,
    y: float,
    theta: float,
    x_goal: float,
    y_goal: float,
) -> float:
    """Return the heading error of one control period [rad], the arbitration made.

    Args:
        memory: as ``TRACE``, read and written.
        best_m: as in ``has_stalled``, read and written.
        mounts: (9, 3) pose x [m], y [m], heading [rad] of each sensor in the robot's frame.
        weights: (9,) alpha_i.
        thresholds: as ``THRESHOLDS``.
        ranges_m: (9,) readings [m].
        x: the robot's x [m].
        y: the robot's y [m].
        theta: the robot's heading [rad].
        x_goal: the goal's x [m].
        y_goal: the goal's y [m].
    """
    alpha, d_fw, at_obstacle_m, unsafe_m, min_progress_m, epsilon_m, tie_m = thresholds
    u_p = (x, y)
    points = np.empty((len(mounts), 2))
    for i in range(len(mounts)):
        in_robot = to_robot_frame(mounts[i, 0], mounts[i, 1], mounts[i, 2], sensor_point(ranges_m[i]))
        points[i, 0], points[i, 1] = to_world_frame(x, y, theta, in_robot)
    u_ao = avoidance_vector(points, weights, u_p)
    u_gtg = goal_vector((x_goal, y_goal), u_p)

    distance_m = math.hypot(u_gtg[0], u_gtg[1])
    clearance_m = ranges_m[1:7].min()
    at_obstacle, unsafe = clearance_m < at_obstacle_m, clearance_m < unsafe_m
    stalled, progress_made, sliding = False, False, False
    memory[PERIODS] += 1.0
    if memory[BEHAVIOR] == GO_TO_GOAL:
        memory[PROGRESS_DISTANCE] = min(memory[PROGRESS_DISTANCE], distance_m)
        stalled = has_stalled(memory, best_m, min_progress_m)
        if unsafe or (at_obstacle and stalled):
            switch(memory, FOLLOW_WALL, side_of_wall(points, ranges_m, u_gtg, tie_m))
    else:
        progress_made = distance_m < memory[PROGRESS_DISTANCE] - epsilon_m
        sliding = is_sliding(u_gtg, u_ao, wall_direction(points, ranges_m, memory[SIDE]))
        if progress_made and not sliding:
            switch(memory, GO_TO_GOAL, NO_SIDE)

    if memory[BEHAVIOR] == GO_TO_GOAL:
        u = blend(u_gtg, u_ao, alpha)
    else:
        u = wall_following(points, ranges_m, memory[SIDE], u_p, d_fw)
    error: float = heading_error(heading_of(u), theta)

    memory[HEADING_ERROR], memory[GOAL_DISTANCE], memory[FRONT_CLEARANCE] = error, distance_m, clearance_m
    memory[AT_OBSTACLE], memory[UNSAFE], memory[STALLED] = at_obstacle, unsafe, stalled
    memory[PROGRESS_MADE], memory[SLIDING] = progress_made, sliding
    return error
