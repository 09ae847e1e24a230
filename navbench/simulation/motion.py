"""One control period of all robots, compiled: wheels, arcs, and the instants of arrival and contact."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled, compiled_inline
from navbench.mathematics.geometry import distance_to_nearest_of, wrap_angle
from navbench.mathematics.kinematics import lag_speed, ramp_speed
from navbench.memory import borrowed
from navbench.simulation.index import Index, nearby
from navbench.simulation.touching import (
    BOX,
    CELL,
    DISC,
    GOAL,
    LINE,
    NONE,
    POLYGON,
    ROBOT_KIND,
    TURN_S,
    first_touch,
    pose_at,
    velocities,
)
from navbench.world.grid import FreeArray, nearest_cell
from navbench.world.shapes import place_movers, time_to_turn

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
RobotArray = NDArray[np.void]
Movers = tuple[FloatArray, FloatArray]  # as ``mover_tables`` returns them
Scenery = tuple[  # see ``Scene.arrays``
    FloatArray, FloatArray, FloatArray, FloatArray, Movers, Movers, FreeArray, FloatArray, Index
]  # fmt: skip
Pipeline = tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray]  # see ``Simulator.pipeline``

SUBSTEP_RADII = 0.25  # clearances are taken at least each time that something may have moved this far
ROUNDING_RADII = 1e-6  # a contact lasts until a robot is further away than this

RUNNING, REACHED, COLLIDED, STOPPED = range(4)  # what may have become of a robot


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
        clearance_m: from the hull to the nearest thing, at the end of the latest substep [m].
        min_clearance_m: the least of these so far.
        path_length_m: what its centre has covered so far [m].
        turning_rad: how far it has turned so far, to either side [rad].
        goal_x_m: where it shall go [m].
        goal_y_m: where it shall go [m].
        arc_x_m: where its present arc begins [m].
        arc_y_m: where that is [m].
        arc_heading_rad: where it looked there.
        arc_t_s: when that was [s].
        left_mean_mps: the left wheel's mean speed on the arc [m/s].
        right_mean_mps: the right wheel's.
        end_s: when it ended [s].
        running: whether it has no outcome yet.
        outcome: ``RUNNING``, ``REACHED``, ``COLLIDED`` or ``STOPPED``.
        is_held: whether it stands until the present substep ends, because it hit something.
        touches: whether it touches something that it hit.
        hit: of what kind the last thing is that it hit, ``NONE`` for none.
        hit_index: its row in the scene's arrays, or its number among the robots.
        contacts: how often it touched something.
        robot_contacts: of these, how often another robot.
        standing_contacts: of all, how often while its wheels stood.
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
    goal_x_m: float
    goal_y_m: float
    arc_x_m: float
    arc_y_m: float
    arc_heading_rad: float
    arc_t_s: float
    left_mean_mps: float
    right_mean_mps: float
    end_s: float
    running: int
    outcome: int
    is_held: int
    touches: int
    hit: int
    hit_index: int
    contacts: int
    robot_contacts: int
    standing_contacts: int


ROBOT = np.dtype([(name, "f8" if kind is float else "i8") for name, kind in RobotState.__annotations__.items()])

# What does not change in an episode.
FIXED = np.dtype(
    [
        ("radius_m", "f8"),  # every robot's hull
        ("track_m", "f8"),  # distance between the wheels
        ("wheel_speed_max_mps", "f8"),
        ("accel_max_mps2", "f8"),  # wheel-acceleration limit, infinite for none
        ("lag_s", "f8"),  # the wheels' time constant, 0 for none
        ("delay_s", "f8"),  # how long a command takes to reach the wheels
        ("goal_tolerance_m", "f8"),  # how near the goal counts as arrived
        ("fastest_mover_mps", "f8"),
        ("blocks", "i8"),  # whether a contact holds a robot, and does not end it
    ]
)


@compiled_inline
def set_command(issued: FloatArray, index: int, v_mps: float, w_radps: float, fixed: NDArray[np.void]) -> bool:
    """Set one robot's command, each wheel clipped at its limit; return False for one that is not finite."""
    limit, turn = fixed[0].wheel_speed_max_mps, 0.5 * w_radps * fixed[0].track_m
    left, right = v_mps - turn, v_mps + turn
    if not (math.isfinite(left) and math.isfinite(right)):
        return False
    issued[index, 0], issued[index, 1] = min(max(left, -limit), limit), min(max(right, -limit), limit)
    return True


@compiled_inline
def advance(
    robots: RobotArray, pipeline: Pipeline, scenery: Scenery, fixed: NDArray[np.void], t_s: float, dt_s: float
) -> int:
    """Move everything through one control period, in place, and return how many robots still run.

    Args:
        robots: (n,) of ``ROBOT``, and the scene, as they are at the period's beginning.
        pipeline: the commands, as ``Simulator.pipeline``.
        scenery: as ``Scene.arrays``.
        fixed: (1,) of ``FIXED``.
        t_s: the period's beginning [s].
        dt_s: its length [s].
    """
    robots, scenery, fixed = borrowed(robots), borrowed(scenery), borrowed(fixed)
    issued, in_force, flight_s, flight, flying = borrowed(pipeline)
    for i in range(robots.shape[0]):
        robots[i].left_travel_m, robots[i].right_travel_m = 0.0, 0.0
    flight_s[flying[0]] = t_s + fixed[0].delay_s
    flight[flying[0]] = issued
    flying[0] += 1
    begin, landed = t_s, 0
    while begin < t_s + dt_s:
        end = t_s + dt_s
        while landed < flying[0] and flight_s[landed] <= begin:
            in_force[:] = flight[landed]
            landed += 1
        if landed < flying[0] and flight_s[landed] < end - 1e-12:
            end = flight_s[landed]
        _drive(robots, in_force, scenery, fixed[0], begin, end)
        begin = end
    flying[0] -= landed
    for k in range(flying[0]):
        flight_s[k], flight[k] = flight_s[k + landed], flight[k + landed]
    running = 0
    for i in range(robots.shape[0]):
        running += robots[i].running
    return running


@compiled_inline
def _drive(robots: RobotArray, targets: FloatArray, scenery: Scenery, fixed: Any, t_s: float, end_s: float) -> None:
    """Move everything while one command is in force for each robot, (n, 2) wheel speeds [m/s]."""
    fastest = fixed.fastest_mover_mps
    for i in range(robots.shape[0]):
        if robots[i].running:
            left = max(abs(robots[i].left_mps), abs(targets[i, 0]))
            right = max(abs(robots[i].right_mps), abs(targets[i, 1]))
            fastest = max(fastest, 0.5 * (left + right))
    substeps = max(1, math.ceil(fastest * (end_s - t_s) / (SUBSTEP_RADII * fixed.radius_m) - 1e-9))
    h, begin = (end_s - t_s) / substeps, t_s
    for k in range(substeps):
        for i in range(robots.shape[0]):
            if robots[i].running:
                _begin_arc(robots[i], targets[i, 0], targets[i, 1], fixed, begin, h)
        end = t_s + (k + 1) * h if k + 1 < substeps else end_s
        _substep(robots, scenery, fixed, begin, end, fastest)
        begin = end


@compiled_inline
def _begin_arc(robot: Any, left_target: float, right_target: float, fixed: Any, t_s: float, h: float) -> None:
    """Turn the wheels of a robot for a substep: its arc goes on where their mean speeds are those of before."""
    left, robot.left_mps = _wheel(robot.left_mps, left_target, fixed, h)
    right, robot.right_mps = _wheel(robot.right_mps, right_target, fixed, h)
    if left != robot.left_mean_mps or right != robot.right_mean_mps or robot.is_held:
        robot.arc_x_m, robot.arc_y_m, robot.arc_heading_rad, robot.arc_t_s = (
            robot.x_m,
            robot.y_m,
            robot.heading_rad,
            t_s,
        )
    robot.left_mean_mps, robot.right_mean_mps, robot.is_held = left, right, 0


@compiled_inline
def _substep(robots: RobotArray, scenery: Scenery, fixed: Any, t_s: float, end_s: float, fastest_mps: float) -> None:
    """Move everything through one substep, from event to event."""
    discs, polygons, round_movers, outlined_movers = scenery[1], scenery[2], scenery[4], scenery[5]
    moves = fixed.fastest_mover_mps > 0.0
    now = t_s
    while now < end_s:
        until = end_s
        if moves:
            turn = min(time_to_turn(now, *round_movers), time_to_turn(now, *outlined_movers))
            until = min(end_s, now + max(turn, TURN_S))
        when, who, kind, what = _first_event(robots, scenery, fixed, now, until, end_s - t_s, fastest_mps)
        now = min(when, until)
        if moves:
            place_movers(now, *round_movers, discs)
            place_movers(now, *outlined_movers, polygons)
        if kind != NONE:
            _pose_all(robots, now, fixed)
            measure_clearance(robots, scenery, fixed.radius_m)
            _meet(robots[who], kind, what, t_s, now, fixed)
            if kind == ROBOT_KIND and robots[what].running and not robots[what].is_held:
                _meet(robots[what], ROBOT_KIND, who, t_s, now, fixed)
    _pose_all(robots, end_s, fixed)
    measure_clearance(robots, scenery, fixed.radius_m)
    for i in range(robots.shape[0]):
        robot = robots[i]
        if robot.running:
            robot.min_clearance_m = min(robot.min_clearance_m, robot.clearance_m)
            robot.touches &= robot.clearance_m <= ROUNDING_RADII * fixed.radius_m
            if not robot.is_held:
                _count(robot, end_s - t_s, fixed.track_m)


@compiled
def _meet(robot: Any, kind: int, what: int, begin_s: float, t_s: float, fixed: Any) -> None:
    """Let a robot, posed where it is at an instant of the substep that began then, arrive or touch something."""
    _count(robot, t_s - begin_s, fixed.track_m)
    if kind != GOAL:
        if not robot.touches:
            robot.contacts += 1
            robot.robot_contacts += kind == ROBOT_KIND
            robot.standing_contacts += robot.left_mean_mps == 0.0 and robot.right_mean_mps == 0.0
        robot.touches, robot.hit, robot.hit_index = 1, kind, what
        if fixed.blocks:
            robot.is_held, robot.left_mps, robot.right_mps = 1, 0.0, 0.0
            return
    robot.min_clearance_m = min(robot.min_clearance_m, robot.clearance_m)
    robot.outcome = REACHED if kind == GOAL else COLLIDED
    robot.running, robot.end_s = 0, t_s


@compiled_inline
def _pose_all(robots: RobotArray, t_s: float, fixed: Any) -> None:
    """Put every robot that moves where it is at an instant of the substep."""
    for i in range(robots.shape[0]):
        if robots[i].running and not robots[i].is_held:
            robot = robots[i]
            robot.x_m, robot.y_m, heading = pose_at(robot, t_s, fixed.track_m)
            robot.heading_rad = wrap_angle(heading)


@compiled_inline
def _first_event(
    robots: RobotArray, scenery: Scenery, fixed: Any, begin: float, end: float, span_s: float, fastest_mps: float
) -> tuple[float, int, int, int]:
    """Return the first event between two instants of a substep of this length: when, whose, of what kind, with what.

    Contact beats arrival at the same instant; otherwise the first robot and the first thing of the scene count.
    """
    boxes, discs, polygons, line, _, _, free, place, index = scenery
    first, who, kind, what = math.inf, -1, NONE, -1
    limit, near = end, fixed.radius_m * (1.0 + ROUNDING_RADII)
    for i in range(robots.shape[0]):
        robot = robots[i]
        v = abs(velocities(robot, fixed.track_m)[0])
        far = near + (v + fastest_mps) * span_s
        # the clearance is that of the substep's beginning or of an event in it
        if not robot.running or robot.is_held or robot.clearance_m > far - fixed.radius_m:
            continue
        near_boxes, near_discs, near_polygons = nearby(robot.x_m, robot.y_m, index)
        for k in near_boxes:
            when = first_touch(robot, robot, fixed, begin, limit, BOX, boxes, k)
            if when < first:
                first, limit, who, kind, what = when, when, i, BOX, k
        for k in near_discs:
            if math.hypot(robot.x_m - discs[k, 0], robot.y_m - discs[k, 1]) - discs[k, 2] <= far:
                when = first_touch(robot, robot, fixed, begin, limit, DISC, discs, k)
                if when < first:
                    first, limit, who, kind, what = when, when, i, DISC, k
        for k in near_polygons:
            if math.hypot(robot.x_m - polygons[k, 0], robot.y_m - polygons[k, 1]) - polygons[k, 2] <= far:
                when = first_touch(robot, robot, fixed, begin, limit, POLYGON, polygons, k)
                if when < first:
                    first, limit, who, kind, what = when, when, i, POLYGON, k
        if free.shape[0]:
            cell = np.array([[0.0, 0.0, 0.5 * place[2], 0.5 * place[2], 1.0, 0.0]])
            low_row, high_row = _cells(robot.y_m, near + v * span_s, place[1], place[2], free.shape[1])
            low_column, high_column = _cells(robot.x_m, near + v * span_s, place[0], place[2], free.shape[2])
            for row in range(low_row, high_row):
                for column in range(low_column, high_column):
                    if free[0, row, column, 0] == 0:
                        cell[0, 0] = place[0] + place[2] * (column + 0.5)
                        cell[0, 1] = place[1] + place[2] * (row + 0.5)
                        when = first_touch(robot, robot, fixed, begin, limit, BOX, cell, 0)
                        if when < first:
                            first, limit, who, kind, what = when, when, i, CELL, row * free.shape[2] + column
        for k in range(robots.shape[0]):
            other = robots[k]
            if k < i and other.running and not other.is_held or k == i:
                continue  # a pair of two that move is looked at once
            if math.hypot(robot.x_m - other.x_m, robot.y_m - other.y_m) - fixed.radius_m <= far:
                when = first_touch(robot, other, fixed, begin, limit, ROBOT_KIND, boxes, -1)
                if when < first:
                    first, limit, who, kind, what = when, when, i, ROBOT_KIND, k
    for i in range(robots.shape[0]):
        robot = robots[i]
        if not robot.running or robot.is_held:
            continue
        when = math.inf
        if line.shape[0]:
            when = first_touch(robot, robot, fixed, begin, limit, LINE, line, 0)
        elif math.hypot(robot.x_m - robot.goal_x_m, robot.y_m - robot.goal_y_m) - fixed.goal_tolerance_m <= near:
            when = first_touch(robot, robot, fixed, begin, limit, GOAL, boxes, -1)
        if when < first:
            first, limit, who, kind, what = when, when, i, GOAL, -1
    return first, who, kind, what


@compiled
def _cells(at: float, reach: float, begin: float, side: float, count: int) -> tuple[int, int]:
    """Return the first cell along an axis that comes within reach of a place, and the one after the last."""
    first, last = math.floor((at - reach - begin) / side), math.floor((at + reach - begin) / side)
    return max(int(first), 0), min(int(last) + 1, count)


@compiled_inline
def measure_clearance(robots: RobotArray, scenery: Scenery, radius_m: float) -> None:
    """Write every running robot's present clearance."""
    boxes, discs, polygons, free, place = scenery[0], scenery[1], scenery[2], scenery[6], scenery[7]
    for i in range(robots.shape[0]):
        robot = robots[i]
        if not robot.running:
            continue
        nearest = distance_to_nearest_of(
            robot.x_m, robot.y_m, boxes, discs, polygons, *nearby(robot.x_m, robot.y_m, scenery[8])
        )
        nearest = min(nearest, nearest_cell(robot.x_m, robot.y_m, free, place))
        for j in range(robots.shape[0]):
            if j != i:
                dx, dy = robot.x_m - robots[j].x_m, robot.y_m - robots[j].y_m
                nearest = min(nearest, math.sqrt(dx * dx + dy * dy) - radius_m)
        robot.clearance_m = nearest - radius_m


@compiled_inline
def other_robots(robots: RobotArray, index: int, radius_m: float, discs: FloatArray) -> None:
    """Write all robots but one as discs, (n - 1, 5) x, y, radius, vx, vy [m, m/s]; an ended one stands."""
    for i in range(robots.shape[0]):
        if i != index:
            robot = robots[i]
            v = 0.5 * (robot.left_mps + robot.right_mps) if robot.running else 0.0
            heading, k = robot.heading_rad, i - (i > index)
            discs[k, 0], discs[k, 1], discs[k, 2] = robot.x_m, robot.y_m, radius_m
            discs[k, 3], discs[k, 4] = v * math.cos(heading), v * math.sin(heading)


@compiled_inline
def _count(robot: Any, dt_s: float, track_m: float) -> None:
    """Add what the robot covers in this time to its sums."""
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
