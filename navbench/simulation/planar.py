"""The planar simulator: every ray in closed form, compiled, without any engine."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled
from navbench.mathematics.geometry import box_gap
from navbench.simulation.base import Simulator
from navbench.simulation.motion import Scenery

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
RobotArray = NDArray[np.void]
Ends = tuple[int, int, int, int]  # of boxes, discs, polygons and robots in an array of things near a robot


class PlanarSimulator(Simulator):
    """Rays by closed forms; everything else is what every simulator does.

    Attributes:
        near: room for what is near a robot, see ``read_ring``.
    """

    is_compiled = True

    def build(self) -> None:
        """Make room for what is near a robot."""
        scene = self.scene
        self.near = np.empty(len(scene.boxes) + len(scene.discs) + len(scene.polygons) + len(self.robots), np.int64)

    def place(self) -> None:
        """Do nothing: robots and movers are where their arrays say."""

    def cast(self, index: int, rays: list[int]) -> list[float]:
        """Return what share of each of these rays of a robot is free."""
        table = self.rays.table[rays]
        free = np.empty(len(table))
        cast(self.robots, index, self.scene.arrays, table, self.rays.reach_m, self.robot.radius_m, self.near, free)
        shares: list[float] = np.minimum(free / table["length_m"], 1.0).tolist()
        return shares

    def ranges(self) -> FloatArray:
        """Return what the running robots' rings measure without noise: (n_robots, n_sensors) [m]."""
        rays, ranges = self.rays, np.tile(self.rays.unobstructed, (len(self.robots), 1))
        for i in range(len(ranges)):
            read_ring(
                self.robots, i, self.scene.arrays, rays.table, rays.reach_m, self.robot.radius_m, self.near, ranges[i]
            )
        return ranges


@compiled
def read_ring(
    robots: RobotArray,
    index: int,
    scenery: Scenery,
    rays: NDArray[np.void],
    reach_m: float,
    radius_m: float,
    near: IntArray,
    ranges: FloatArray,
) -> None:
    """Write what one robot's ring measures without noise.

    Args:
        robots: (n,) of ``ROBOT``.
        index: the robot's.
        scenery: as ``Scene.arrays``.
        rays: (n_rays,) of ``RAY``.
        reach_m: what is further from the hull is hit by no ray [m].
        radius_m: every robot's hull [m].
        near: room for the number of everything in the scene and of the robots.
        ranges: (n_sensors,) what is read where nothing is; what is hit is written, of a running robot [m].
    """
    robot = robots[index]
    if not robot.running or robot.clearance_m > reach_m:
        return
    x, y, cosine, sine = robot.x_m, robot.y_m, math.cos(robot.heading_rad), math.sin(robot.heading_rad)
    ends = _find_near(robots, index, scenery, reach_m + radius_m, radius_m, near)
    if ends[3] == 0:
        return
    for k in range(rays.shape[0]):
        ray = rays[k]
        far = _free(x, y, cosine, sine, ray, robots, scenery, radius_m, near, ends)
        if far < ray.length_m:
            ranges[ray.sensor] = min(ranges[ray.sensor], max(far - ray.offset_m, 0.0))


@compiled
def cast(
    robots: RobotArray,
    index: int,
    scenery: Scenery,
    rays: NDArray[np.void],
    reach_m: float,
    radius_m: float,
    near: IntArray,
    free: FloatArray,
) -> None:
    """Write how far each ray of a robot comes, (n_rays,) [m], infinite where it hits nothing; see ``read_ring``."""
    robot = robots[index]
    cosine, sine = math.cos(robot.heading_rad), math.sin(robot.heading_rad)
    ends = _find_near(robots, index, scenery, reach_m + radius_m, radius_m, near)
    for k in range(rays.shape[0]):
        free[k] = _free(robot.x_m, robot.y_m, cosine, sine, rays[k], robots, scenery, radius_m, near, ends)


@compiled
def _find_near(robots: RobotArray, index: int, scenery: Scenery, far_m: float, radius_m: float, near: IntArray) -> Ends:
    """Write the rows of what comes this near to a robot's centre, kind by kind, and return where each kind ends."""
    boxes, discs, polygons = scenery[0], scenery[1], scenery[2]
    x, y, count = robots[index].x_m, robots[index].y_m, 0
    for k in range(boxes.shape[0]):
        if box_gap(x, y, boxes, k)[0] <= far_m:
            near[count] = k
            count += 1
    boxes_end = count
    for k in range(discs.shape[0]):
        if _is_within(x, y, discs[k, 0], discs[k, 1], far_m + discs[k, 2]):
            near[count] = k
            count += 1
    discs_end = count
    for k in range(polygons.shape[0]):
        if _is_within(x, y, polygons[k, 0], polygons[k, 1], far_m + polygons[k, 2]):
            near[count] = k
            count += 1
    polygons_end = count
    for k in range(robots.shape[0]):
        if k != index and _is_within(x, y, robots[k].x_m, robots[k].y_m, far_m + radius_m):
            near[count] = k
            count += 1
    return boxes_end, discs_end, polygons_end, count


@compiled
def _is_within(x: float, y: float, cx: float, cy: float, far: float) -> bool:
    return (x - cx) * (x - cx) + (y - cy) * (y - cy) <= far * far


@compiled
def _free(
    x: float,
    y: float,
    cosine: float,
    sine: float,
    ray: Any,
    robots: RobotArray,
    scenery: Scenery,
    radius_m: float,
    near: IntArray,
    ends: Ends,
) -> float:
    """Return how far a ray of a robot at x and y comes before it hits something [m], infinite where it does not.

    It hits at once what it begins in, and never its own robot.
    """
    boxes, discs, polygons = scenery[0], scenery[1], scenery[2]
    ax = x + cosine * ray.begin_x_m - sine * ray.begin_y_m
    ay = y + sine * ray.begin_x_m + cosine * ray.begin_y_m
    ux, uy = cosine * ray.cosine - sine * ray.sine, sine * ray.cosine + cosine * ray.sine
    far = math.inf
    for k in range(ends[0]):
        far = min(far, ray_to_box(ax, ay, ux, uy, boxes, near[k]))
    for k in range(ends[0], ends[1]):
        far = min(far, ray_to_circle(discs[near[k], 0] - ax, discs[near[k], 1] - ay, ux, uy, discs[near[k], 2]))
    for k in range(ends[1], ends[2]):
        far = min(far, ray_to_polygon(ax, ay, ux, uy, polygons, near[k]))
    for k in range(ends[2], ends[3]):
        far = min(far, ray_to_circle(robots[near[k]].x_m - ax, robots[near[k]].y_m - ay, ux, uy, radius_m))
    return far


@compiled
def ray_to_circle(dx: float, dy: float, ux: float, uy: float, radius: float) -> float:
    """Return how far it is along a unit vector u to a circle around d, seen from the ray's beginning, or infinity."""
    outside2 = dx * dx + dy * dy - radius * radius
    if outside2 <= 0.0:
        return 0.0
    along, across = dx * ux + dy * uy, dx * uy - dy * ux
    chord2 = radius * radius - across * across
    if along <= 0.0 or chord2 < 0.0:
        return math.inf
    return outside2 / (along + math.sqrt(chord2))


@compiled
def ray_to_box(ax: float, ay: float, ux: float, uy: float, boxes: FloatArray, k: int) -> float:
    """Return how far it is from a along a unit vector u to a box, see ``box_gap``, or infinity."""
    dx, dy, cosine, sine = ax - boxes[k, 0], ay - boxes[k, 1], boxes[k, 4], boxes[k, 5]
    low, high = 0.0, math.inf
    for axis in range(2):
        place = cosine * dx + sine * dy if axis == 0 else cosine * dy - sine * dx
        step = cosine * ux + sine * uy if axis == 0 else cosine * uy - sine * ux
        half = boxes[k, 2 + axis]
        if step == 0.0:
            if abs(place) > half:
                return math.inf
            continue
        first, second = (-half - place) / step, (half - place) / step
        low, high = max(low, min(first, second)), min(high, max(first, second))
    return low if low <= high else math.inf


@compiled
def ray_to_polygon(ax: float, ay: float, ux: float, uy: float, polygons: FloatArray, k: int) -> float:
    """Return how far it is from a along a unit vector u to a convex polygon, see ``polygon_gap``, or infinity."""
    px, py, columns = ax - polygons[k, 0], ay - polygons[k, 1], polygons.shape[1]
    low, high = 0.0, math.inf
    bx, by = polygons[k, columns - 2], polygons[k, columns - 1]
    for column in range(5, columns, 2):
        cx, cy = bx, by
        bx, by = polygons[k, column], polygons[k, column + 1]
        nx, ny = by - cy, cx - bx  # outward, corners running counter-clockwise
        outside, leaving = nx * (px - cx) + ny * (py - cy), nx * ux + ny * uy
        if leaving < 0.0:
            low = max(low, -outside / leaving)
        elif leaving > 0.0:
            high = min(high, -outside / leaving)
        elif outside > 0.0:
            return math.inf
    return low if low <= high else math.inf
