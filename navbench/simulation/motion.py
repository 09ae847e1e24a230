"""One substep of all robots, compiled: wheels, arcs, arrival, clearance. No contact is decided here."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled
from navbench.mathematics.geometry import distance_to_nearest, segment_crossing, wrap_angle
from navbench.mathematics.kinematics import advance_arc, closest_approach, lag_speed, ramp_speed

FloatArray = NDArray[np.float64]
RobotArray = NDArray[np.void]

NOT_YET = -1.0  # no arrival in this substep

# What the simulator knows of each robot. The loop reads rows as plain tuples, so the first fields come in its order.
ROBOT = np.dtype(
    [
        ("x_m", "f8"),
        ("y_m", "f8"),
        ("heading_rad", "f8"),
        ("left_mps", "f8"),  # the wheels' speeds now
        ("right_mps", "f8"),
        ("left_travel_m", "f8"),  # of each wheel in the present control period
        ("right_travel_m", "f8"),
        ("clearance_m", "f8"),  # from the hull to the nearest thing, now
        ("min_clearance_m", "f8"),
        ("path_length_m", "f8"),
        ("turning_rad", "f8"),
        ("running", "i8"),
        ("goal_x_m", "f8"),
        ("goal_y_m", "f8"),
        ("start_x_m", "f8"),  # the pose before the present substep
        ("start_y_m", "f8"),
        ("start_heading_rad", "f8"),
        ("left_mean_mps", "f8"),  # the wheels' mean speeds over the present substep
        ("right_mean_mps", "f8"),
        ("arrival_s", "f8"),  # when in the present substep the goal was reached, NOT_YET for never
    ]
)


@compiled
def move(
    robots: RobotArray,
    targets_mps: FloatArray,
    boxes: FloatArray,
    discs: FloatArray,
    polygons: FloatArray,
    finish_line: FloatArray,
    dt_s: float,
    substeps: int,
    radius_m: float,
    track_m: float,
    accel_max_mps2: float,
    lag_s: float,
    goal_tolerance_m: float,
    margin_m: float,
    new_period: bool,
    any_held: bool,
) -> tuple[int, bool, bool]:
    """Move every running robot, in place, until a substep that must be settled: then it is known where all stand.

    Clearances are those at a substep's end, and are counted in those that need no settling; after one that does,
    ``count_clearance`` counts them.

    Args:
        robots: (n,) of ``ROBOT``.
        targets_mps: (n, 2) the command in force for each left and right wheel [m/s].
        boxes: (k, 6) as in ``World.box_rows``.
        discs: (m, 5) as in ``World.disc_rows``, at the substep's end.
        polygons: (l, ...) as in ``World.polygon_rows``, at the substep's end.
        finish_line: (4,) its ends, or (0,) for none.
        dt_s: the substep [s].
        substeps: how many at most; more than one only where nothing but the robots moves.
        radius_m: every robot's hull [m].
        track_m: distance between the wheels [m].
        accel_max_mps2: wheel-acceleration limit [m/s^2], infinite for none.
        lag_s: the wheels' time constant [s], 0 for none.
        goal_tolerance_m: how near the goal counts as arrived [m].
        margin_m: a substep in which a robot comes this near to something must be settled [m].
        new_period: whether the first substep is the first of a control period.
        any_held: whether a contact lasts, so that every substep must be settled.

    Returns:
        How many substeps were made, whether the last one must be settled, and whether a robot came near in it.
    """
    for k in range(substeps):
        arrived = _move_once(
            robots, targets_mps, finish_line, dt_s, track_m, accel_max_mps2, lag_s, goal_tolerance_m,
            new_period and k == 0,
        )  # fmt: skip
        near = measure_clearance(robots, boxes, discs, polygons, radius_m) <= margin_m
        if near or arrived or any_held:
            return k + 1, True, near
        count_clearance(robots)
    return substeps, False, False


@compiled
def _move_once(
    robots: RobotArray,
    targets_mps: FloatArray,
    finish_line: FloatArray,
    dt_s: float,
    track_m: float,
    accel_max_mps2: float,
    lag_s: float,
    goal_tolerance_m: float,
    new_period: bool,
) -> bool:
    """Move every running robot through one substep and return whether one came to its goal."""
    arrived = False
    for i in range(robots.shape[0]):
        robot = robots[i]
        if not robot.running:
            continue
        left, robot.left_mps = _wheel(robot.left_mps, targets_mps[i, 0], accel_max_mps2, lag_s, dt_s)
        right, robot.right_mps = _wheel(robot.right_mps, targets_mps[i, 1], accel_max_mps2, lag_s, dt_s)
        v, w = 0.5 * (left + right), (right - left) / track_m
        x, y, heading = robot.x_m, robot.y_m, robot.heading_rad
        robot.start_x_m, robot.start_y_m, robot.start_heading_rad = x, y, heading
        end_x, end_y, end_heading = advance_arc(x, y, heading, v, w, dt_s)
        robot.arrival_s = NOT_YET
        if finish_line.shape[0] == 4:
            fraction = segment_crossing(x, y, end_x, end_y, finish_line)
            if fraction >= 0.0:
                robot.arrival_s = fraction * dt_s
        else:
            when, distance = closest_approach(x, y, heading, v, w, dt_s, robot.goal_x_m, robot.goal_y_m)
            if distance <= goal_tolerance_m:
                robot.arrival_s = when
        arrived = arrived or robot.arrival_s != NOT_YET
        robot.x_m, robot.y_m, robot.heading_rad = end_x, end_y, wrap_angle(end_heading)
        robot.left_mean_mps, robot.right_mean_mps = left, right
        if new_period:
            robot.left_travel_m, robot.right_travel_m = 0.0, 0.0
        _count(robot, dt_s, track_m)
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
def scaled_poses(robots: NDArray[np.void], scale: float, poses: FloatArray) -> None:
    """Write each robot's x, y in simulation units and the sine and cosine of half its heading."""
    for i in range(robots.shape[0]):
        half = 0.5 * robots[i].heading_rad
        poses[i, 0], poses[i, 1] = robots[i].x_m * scale, robots[i].y_m * scale
        poses[i, 2], poses[i, 3] = math.sin(half), math.cos(half)


@compiled
def _count(robot: Any, dt_s: float, track_m: float) -> None:
    """Add what the robot covers in this time to its sums; a negative time takes it back."""
    left, right = robot.left_mean_mps, robot.right_mean_mps
    robot.left_travel_m += left * dt_s
    robot.right_travel_m += right * dt_s
    robot.path_length_m += 0.5 * abs(left + right) * dt_s
    robot.turning_rad += abs(right - left) / track_m * dt_s


@compiled
def _wheel(
    speed_mps: float, target_mps: float, accel_max_mps2: float, lag_s: float, dt_s: float
) -> tuple[float, float]:
    """Return a wheel's mean and final speed over the substep [m/s]."""
    if lag_s > 0.0:
        mean, final = lag_speed(speed_mps, target_mps, lag_s, dt_s)
        if abs(final - speed_mps) <= accel_max_mps2 * dt_s:
            return mean, final
        return ramp_speed(speed_mps, target_mps, accel_max_mps2, dt_s)
    return ramp_speed(speed_mps, target_mps, accel_max_mps2, dt_s)
