"""The two behaviours of Aouf, Boussaid and Sakly, which ``sflc`` and ``pid`` share.

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

Left open, and decided here: a sensor that sees nothing counts in (11), and may be P_1 or P_2, with its point at the
end of its range; P_1 and P_2 come from the two smallest readings of the four sensors of the wall's side; of equal
readings the one further to the rear counts as smaller, so that the robot turns round a corner behind which it sees
nothing. When the robot switches is decided in ``behaviors``.
"""

import math

from navbench.compiled import compiled
from navbench.contract import FloatArray
from navbench.mathematics.geometry import wrap_angle

Vector = tuple[float, float]
Frame = tuple[float, float, float, float]  # x, y [m], cosine and sine of the heading

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
LEFT, RIGHT = 1.0, -1.0  # the side of the followed wall


@compiled
def sensor_point(d: float) -> Vector:
    """Return the point v_i that a reading means, in the sensor's frame."""
    return d, 0.0  # eq. (7)


@compiled
def frame(x: float, y: float, theta: float) -> Frame:
    """Return M_t(x, y, theta), as ``transform`` takes it."""
    return x, y, math.cos(theta), math.sin(theta)


@compiled
def transform(m_t: Frame, v: Vector) -> Vector:
    """Return M_t [v; 1]."""
    x, y, c, s = m_t
    return c * v[0] - s * v[1] + x, s * v[0] + c * v[1] + y  # eq. (9)


@compiled
def to_robot_frame(sensor: Frame, v: Vector) -> Vector:
    """Return v'_i, the point in the robot's frame."""
    return transform(sensor, v)  # eq. (8)


@compiled
def to_world_frame(robot: Frame, v: Vector) -> Vector:
    """Return v''_i, the point in the world, from the robot's frame and the point in it."""
    return transform(robot, v)  # eq. (10)


@compiled
def points_seen(mounts: FloatArray, ranges_m: FloatArray, pose: tuple[float, float, float], points: FloatArray) -> None:
    """Write the points v''_i that all readings mean, (9, 2), from each sensor's frame in that of the robot, (36,)."""
    robot = frame(pose[0], pose[1], pose[2])
    for i in range(len(points)):
        sensor = mounts[4 * i], mounts[4 * i + 1], mounts[4 * i + 2], mounts[4 * i + 3]
        in_robot = to_robot_frame(sensor, sensor_point(ranges_m[i]))
        points[i, 0], points[i, 1] = to_world_frame(robot, in_robot)


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
