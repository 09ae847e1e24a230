"""One substep of all robots, compiled: wheels, arcs, arrival, clearance. No contact is decided here."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled
from navbench.mathematics.geometry import distance_to_nearest, segment_crossing, wrap_angle
from navbench.mathematics.kinematics import advance_arc, closest_approach, lag_speed, ramp_speed

FloatArray = NDArray[np.float64]
RobotArray = NDArray[np.void]

NOT_YET = -1.0  # no arrival in this substep


class RobotState(NamedTuple):
    """What a simulator knows of a robot.

    Attributes:
        x_m: where it is [m].
        y_m: where it is [m].
        heading_rad: where it looks [rad].
        left_mps: the left wheel's speed now [m/s].
        right_mps: the right wheel's.
        left_travel_m: what the left wheel covered in the present control period [m].
        right_travel_m: what the right one did.
        clearance_m: from the hull to the nearest thing, now [m].
        min_clearance_m: the least of these so far.
        path_length_m: what its centre has covered so far [m].
        turning_rad: how far it has turned so far, to either side [rad].
        running: whether it has no outcome yet.
        goal_x_m: where it shall go [m].
        goal_y_m: where it shall go [m].
        start_x_m: where it was before the present substep [m].
        start_y_m: where it was then.
        start_heading_rad: where it looked then.
        left_mean_mps: the left wheel's mean speed over the present substep [m/s].
        right_mean_mps: the right wheel's.
        arrival_s: when in the present substep it reached its goal [s], ``NOT_YET`` for never.
    """

    x_m: float
    y_m: float
    heading_rad: float
    left_mps: float
    right_mps: float
    left_travel_m: float
    right_travel_m: float
    clearance_m: float
    min_clearance_m: float
    path_length_m: float
    turning_rad: float
    running: int
    goal_x_m: float
    goal_y_m: float
    start_x_m: float
    start_y_m: float
    start_heading_rad: float
    left_mean_mps: float
    right_mean_mps: float
    arrival_s: float


ROBOT = np.dtype([(name, "i8" if name == "running" else "f8") for name in RobotState._fields])

# What does not change in an episode.
FIXED = np.dtype(
    [
        ("radius_m", "f8"),  # every robot's hull
        ("track_m", "f8"),  # distance between the wheels
        ("accel_max_mps2", "f8"),  # wheel-acceleration limit, infinite for none
        ("lag_s", "f8"),  # the wheels' time constant, 0 for none
        ("goal_tolerance_m", "f8"),  # how near the goal counts as arrived
        ("margin_m", "f8"),  # a substep in which a robot comes this near to something must be settled
        ("has_finish_line", "i8"),
        ("finish_line", "f8", (4,)),  # its ends x1, y1, x2, y2 [m]
    ]
)


@compiled
def move(
    robots: RobotArray,
    targets_mps: FloatArray,
    boxes: FloatArray,
    discs: FloatArray,
    polygons: FloatArray,
    fixed: NDArray[np.void],
    dt_s: float,
    substeps: int,
    new_period: bool,
    any_held: bool,
) -> tuple[int, bool, bool]:
    """Move every running robot, in place, until a substep that must be settled: then it is known where all stand.

    Clearances are those at a substep's end, and are counted in those that need no settling; after one that does,
    ``count_clearance`` counts them.

    Args:
        robots: (n,) of ``ROBOT``.
        targets_mps: (n, 2) the command in force for each left and right wheel [m/s].
        boxes: (k, 6) as in ``Layout.box_rows``.
        discs: (m, 5) as in ``Layout.disc_rows``, at the substep's end.
        polygons: (l, ...) as in ``Layout.polygon_rows``, at the substep's end.
        fixed: (1,) of ``FIXED``.
        dt_s: the substep [s].
        substeps: how many at most; more than one only where nothing but the robots moves.
        new_period: whether the first substep is the first of a control period.
        any_held: whether a contact lasts, so that every substep must be settled.

    Returns:
        How many substeps were made, whether the last one must be settled, and whether a robot came near in it.
    """
    for k in range(substeps):
        arrived = _move_once(robots, targets_mps, fixed[0], dt_s, new_period and k == 0)
        near = measure_clearance(robots, boxes, discs, polygons, fixed[0].radius_m) <= fixed[0].margin_m
        if near or arrived or any_held:
            return k + 1, True, near
        count_clearance(robots)
    return substeps, False, False


@compiled
def _move_once(robots: RobotArray, targets_mps: FloatArray, fixed: Any, dt_s: float, new_period: bool) -> bool:
    """Move every running robot through one substep and return whether one came to its goal."""
    arrived = False
    for i in range(robots.shape[0]):
        robot = robots[i]
        if not robot.running:
            continue
        left, robot.left_mps = _wheel(robot.left_mps, targets_mps[i, 0], fixed, dt_s)
        right, robot.right_mps = _wheel(robot.right_mps, targets_mps[i, 1], fixed, dt_s)
        v, w = 0.5 * (left + right), (right - left) / fixed.track_m
        x, y, heading = robot.x_m, robot.y_m, robot.heading_rad
        robot.start_x_m, robot.start_y_m, robot.start_heading_rad = x, y, heading
        end_x, end_y, end_heading = advance_arc(x, y, heading, v, w, dt_s)
        robot.arrival_s = NOT_YET
        if fixed.has_finish_line:
            fraction = segment_crossing(x, y, end_x, end_y, fixed.finish_line)
            if fraction >= 0.0:
                robot.arrival_s = fraction * dt_s
        else:
            when, distance = closest_approach(x, y, heading, v, w, dt_s, robot.goal_x_m, robot.goal_y_m)
            if distance <= fixed.goal_tolerance_m:
                robot.arrival_s = when
        arrived = arrived or robot.arrival_s != NOT_YET
        robot.x_m, robot.y_m, robot.heading_rad = end_x, end_y, wrap_angle(end_heading)
        robot.left_mean_mps, robot.right_mean_mps = left, right
        if new_period:
            robot.left_travel_m, robot.right_travel_m = 0.0, 0.0
        _count(robot, dt_s, fixed.track_m)
    return arrived


@compiled
def measure_clearance(
    robots: RobotArray, boxes: FloatArray, discs: FloatArray, polygons: FloatArray, radius_m: float
) -> float:
    """Write every running robot's present clearance, and return the least of all [m]."""
    least = math.inf
    for i in range(robots.shape[0]):
        robot = robots[i]
        if not robot.running:
            continue
        nearest = distance_to_nearest(robot.x_m, robot.y_m, boxes, discs, polygons)
        for j in range(robots.shape[0]):
            if j != i:
                nearest = min(nearest, math.hypot(robot.x_m - robots[j].x_m, robot.y_m - robots[j].y_m) - radius_m)
        robot.clearance_m = nearest - radius_m
        least = min(least, robot.clearance_m)
    return least


@compiled
def count_clearance(robots: RobotArray) -> None:
    """Count every running robot's present clearance into its least one."""
    for i in range(robots.shape[0]):
        if robots[i].running:
            robots[i].min_clearance_m = min(robots[i].min_clearance_m, robots[i].clearance_m)


@compiled
def stop_at_arrival(robots: RobotArray, index: int, dt_s: float, track_m: float) -> None:
    """Set one robot back from the substep's end to the instant at which it arrived."""
    robot = robots[index]
    left, right = robot.left_mean_mps, robot.right_mean_mps
    x, y, heading = advance_arc(
        robot.start_x_m,
        robot.start_y_m,
        robot.start_heading_rad,
        0.5 * (left + right),
        (right - left) / track_m,
        robot.arrival_s,
    )
    robot.x_m, robot.y_m, robot.heading_rad = x, y, wrap_angle(heading)
    _count(robot, robot.arrival_s - dt_s, track_m)


@compiled
def hold(robots: RobotArray, index: int, dt_s: float, track_m: float) -> None:
    """Put one robot back to its pose before the substep, its wheels standing: it is blocked."""
    robot = robots[index]
    robot.x_m, robot.y_m, robot.heading_rad = robot.start_x_m, robot.start_y_m, robot.start_heading_rad
    _count(robot, -dt_s, track_m)
    robot.left_mps, robot.right_mps = 0.0, 0.0


@compiled
def other_robots(robots: RobotArray, index: int, radius_m: float) -> FloatArray:
    """Return all robots but one as discs: (n - 1, 5) x, y, radius, vx, vy [m, m/s]; an ended one stands."""
    discs = np.empty((robots.shape[0] - 1, 5))
    for i in range(robots.shape[0]):
        if i != index:
            robot = robots[i]
            v = 0.5 * (robot.left_mps + robot.right_mps) if robot.running else 0.0
            heading = robot.heading_rad
            discs[i - (i > index)] = robot.x_m, robot.y_m, radius_m, v * math.cos(heading), v * math.sin(heading)
    return discs


@compiled
def _count(robot: Any, dt_s: float, track_m: float) -> None:
    """Add what the robot covers in this time to its sums; a negative time takes it back."""
    left, right = robot.left_mean_mps, robot.right_mean_mps
    robot.left_travel_m += left * dt_s
    robot.right_travel_m += right * dt_s
    robot.path_length_m += 0.5 * abs(left + right) * dt_s
    robot.turning_rad += abs(right - left) / track_m * dt_s


@compiled
def _wheel(speed_mps: float, target_mps: float, fixed: Any, dt_s: float) -> tuple[float, float]:
    """Return a wheel's mean and final speed over the substep [m/s]."""
    if fixed.lag_s > 0.0:
        mean, final = lag_speed(speed_mps, target_mps, fixed.lag_s, dt_s)
        if abs(final - speed_mps) <= fixed.accel_max_mps2 * dt_s:
            return mean, final
    return ramp_speed(speed_mps, target_mps, fixed.accel_max_mps2, dt_s)
