"""The planar simulator: every ray in closed form, compiled, without any engine."""

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled, compiled_for_vectors, compiled_inline, direct
from navbench.mathematics.geometry import is_box_near
from navbench.memory import borrowed
from navbench.simulation.base import Simulator
from navbench.simulation.contacts import Event
from navbench.simulation.index import nearby
from navbench.simulation.motion import Scenery, advance
from navbench.world.grid import ray_to_cell

FloatArray = NDArray[np.float64]
RobotArray = NDArray[np.void]

AX, AY, UX, UY, FREE, LOW, HIGH = range(7)  # of a ray: where it begins, its direction, how far it comes; and room
ROWS = 7


class PlanarSimulator(Simulator):
    """Rays by closed forms; everything else is what every simulator does.

    Attributes:
        beams: room for a robot's rays, see ``read_ring``.
    """

    is_compiled = True

    def build(self) -> None:
        """Make room for a robot's rays, and for what the rings read."""
        self.beams, self._readings = np.empty((ROWS, len(self.rays.table))), np.empty_like(self._unobstructed)

    def place(self) -> None:
        """Do nothing: robots and movers are where their arrays say."""

    def cast(self, index: int, rays: list[int]) -> list[float]:
        """Return what share of each of these rays of a robot is free."""
        cast(self.robots, index, self.scene.arrays, self.rays.table, self.rays.reach_m, self.robot.radius_m, self.beams)
        shares: list[float] = np.minimum(self.beams[FREE] / self.rays.table["length_m"], 1.0)[rays].tolist()
        return shares

    def ranges(self) -> FloatArray:
        """Return what the running robots' rings measure without noise: (n_robots, n_sensors) [m]."""
        ranges = self._unobstructed.copy()
        self._read(self.robots, self.scene.arrays, *self._ring(), ranges)
        return ranges

    def period(self, t_s: float, dt_s: float) -> tuple[list[Event], FloatArray]:
        """Move everything and read the rings, in one call; the next one writes into the same array of ranges."""
        self.reserve(dt_s)
        return self._ended(self._move_and_read(self._moved(), t_s, dt_s), dt_s), self._readings

    def _moving(self) -> tuple[Any, ...]:
        return *super()._moving(), *self._ring(), self._unobstructed, self._readings

    def _ring(self) -> tuple[Any, ...]:
        return self.rays.table, self.rays.reach_m, self.robot.radius_m, self.beams

    @cached_property
    def _read(self) -> Callable[..., None]:
        return direct(_read_rings, self.robots, self.scene.arrays, *self._ring(), self._unobstructed)

    @cached_property
    def _move_and_read(self) -> Callable[..., int]:
        return direct(_advance_and_read, self._moved(), 0.0, 0.0)


@compiled
def _advance_and_read(moved: Any, t_s: float, dt_s: float) -> int:
    """Do as ``advance``, and then as ``_read_rings``, with all that was handed over before."""
    robots, pipeline, scenery, fixed, rays, reach_m, radius_m, beams, unobstructed, ranges = borrowed(moved[0])
    ranges[:] = unobstructed
    running = advance(robots, pipeline, scenery, fixed, t_s, dt_s)
    _read_rings(robots, scenery, rays, reach_m, radius_m, beams, ranges)
    return running


@compiled
def _read_rings(
    robots: RobotArray,
    scenery: Scenery,
    rays: NDArray[np.void],
    reach_m: float,
    radius_m: float,
    beams: FloatArray,
    ranges: FloatArray,
) -> None:
    """Write what all running robots' rings measure, (n_robots, n_sensors), as ``read_ring``."""
    robots, scenery, rays, beams, ranges = borrowed((robots, scenery, rays, beams, ranges))
    for i in range(robots.shape[0]):
        if robots[i].running:
            read_ring(robots, i, scenery, rays, reach_m, radius_m, beams, ranges[i])


@compiled_inline
def read_ring(
    robots: RobotArray,
    index: int,
    scenery: Scenery,
    rays: NDArray[np.void],
    reach_m: float,
    radius_m: float,
    beams: FloatArray,
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
        beams: (ROWS, n_rays) room.
        ranges: (n_sensors,) what is read where nothing is; what is hit is written [m].
    """
    if robots[index].clearance_m > reach_m:
        return
    cast(robots, index, scenery, rays, reach_m, radius_m, beams)
    for k in range(rays.shape[0]):
        if beams[FREE, k] < rays[k].length_m:
            sensor = rays[k].sensor
            ranges[sensor] = min(ranges[sensor], max(beams[FREE, k] - rays[k].offset_m, 0.0))


@compiled_inline
def cast(
    robots: RobotArray,
    index: int,
    scenery: Scenery,
    rays: NDArray[np.void],
    reach_m: float,
    radius_m: float,
    beams: FloatArray,
) -> None:
    """Write how far each of a robot's rays comes before it hits something, into ``beams[FREE]`` [m]; see ``read_ring``.

    A ray hits at once what it begins in, and never its own robot. It is infinite where nothing within reach is hit.
    """
    boxes, discs, polygons, grid, place = scenery[0], scenery[1], scenery[2], scenery[6], scenery[7]
    x, y, heading, far = robots[index].x_m, robots[index].y_m, robots[index].heading_rad, reach_m + radius_m
    cosine, sine = math.cos(heading), math.sin(heading)
    ax, ay, ux, uy, free, low, high = beams[AX], beams[AY], beams[UX], beams[UY], beams[FREE], beams[LOW], beams[HIGH]
    for k in range(rays.shape[0]):
        ray = rays[k]
        ax[k] = x + cosine * ray.begin_x_m - sine * ray.begin_y_m
        ay[k] = y + sine * ray.begin_x_m + cosine * ray.begin_y_m
        ux[k], uy[k] = cosine * ray.cosine - sine * ray.sine, sine * ray.cosine + cosine * ray.sine
        free[k] = math.inf
    near_boxes, near_discs, near_polygons = nearby(x, y, scenery[8])
    for k in near_boxes:
        if is_box_near(x, y, boxes, k, far):
            _stop_at_box(
                ax, ay, ux, uy, free, boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3], boxes[k, 4], boxes[k, 5]
            )
    for k in near_discs:
        if _is_within(x, y, discs[k, 0], discs[k, 1], far + discs[k, 2]):
            _stop_at_circle(ax, ay, ux, uy, free, discs[k, 0], discs[k, 1], discs[k, 2])
    for k in near_polygons:
        if _is_within(x, y, polygons[k, 0], polygons[k, 1], far + polygons[k, 2]):
            _stop_at_polygon(ax, ay, ux, uy, free, low, high, polygons[k])
    if grid.shape[0]:
        for k in range(rays.shape[0]):
            free[k] = min(free[k], ray_to_cell(ax[k], ay[k], ux[k], uy[k], rays[k].length_m, grid, place))
    for k in range(robots.shape[0]):
        if k != index and _is_within(x, y, robots[k].x_m, robots[k].y_m, far + radius_m):
            _stop_at_circle(ax, ay, ux, uy, free, robots[k].x_m, robots[k].y_m, radius_m)


@compiled
def _is_within(x: float, y: float, cx: float, cy: float, far: float) -> bool:
    return (x - cx) * (x - cx) + (y - cy) * (y - cy) <= far * far


@compiled_for_vectors
def _stop_at_circle(
    ax: FloatArray, ay: FloatArray, ux: FloatArray, uy: FloatArray, free: FloatArray, x: float, y: float, radius: float
) -> None:
    """Let rays, which begin at a and run along unit vectors u, come no further than a circle."""
    square = radius * radius
    for k in range(ax.shape[0]):
        dx, dy = x - ax[k], y - ay[k]
        along, across = dx * ux[k] + dy * uy[k], dx * uy[k] - dy * ux[k]
        outside2, chord2 = dx * dx + dy * dy - square, square - across * across
        near = outside2 / (along + math.sqrt(max(chord2, 0.0)))
        is_hit = (chord2 >= 0.0) & (along > 0.0) & (near < free[k])
        far = near if is_hit else free[k]
        free[k] = 0.0 if outside2 <= 0.0 else far


@compiled_for_vectors
def _stop_at_box(
    ax: FloatArray,
    ay: FloatArray,
    ux: FloatArray,
    uy: FloatArray,
    free: FloatArray,
    x: float,
    y: float,
    half_length: float,
    half_width: float,
    cosine: float,
    sine: float,
) -> None:
    """Let rays come no further than a box, see ``box_gap``."""
    for k in range(ax.shape[0]):
        dx, dy = ax[k] - x, ay[k] - y
        px, py = cosine * dx + sine * dy, cosine * dy - sine * dx
        vx, vy = cosine * ux[k] + sine * uy[k], cosine * uy[k] - sine * ux[k]
        left, right = (-half_length - px) / vx, (half_length - px) / vx
        below, above = (-half_width - py) / vy, (half_width - py) / vy
        low = max(min(left, right), min(below, above))
        high = min(max(left, right), max(below, above))
        near = max(low, 0.0)
        free[k] = near if (near <= high) & (near < free[k]) else free[k]


@compiled_for_vectors
def _stop_at_polygon(
    ax: FloatArray,
    ay: FloatArray,
    ux: FloatArray,
    uy: FloatArray,
    free: FloatArray,
    low: FloatArray,
    high: FloatArray,
    polygon: FloatArray,
) -> None:
    """Let rays come no further than a convex polygon, see ``polygon_gap``: where they have entered by all its sides."""
    count = polygon.shape[0]
    low[:], high[:] = 0.0, math.inf
    bx, by = polygon[0] + polygon[count - 2], polygon[1] + polygon[count - 1]
    for column in range(5, count, 2):
        cx, cy = bx, by
        bx, by = polygon[0] + polygon[column], polygon[1] + polygon[column + 1]
        nx, ny = by - cy, cx - bx  # outward, corners running counter-clockwise
        if nx == 0.0 and ny == 0.0:
            continue
        for k in range(ax.shape[0]):
            outside, leaving = nx * (ax[k] - cx) + ny * (ay[k] - cy), nx * ux[k] + ny * uy[k]
            at = -outside / leaving
            low[k] = at if (leaving < 0.0) & (at > low[k]) else low[k]
            high[k] = at if (leaving > 0.0) & (at < high[k]) else high[k]
            high[k] = -1.0 if (leaving == 0.0) & (outside > 0.0) else high[k]
    for k in range(ax.shape[0]):
        free[k] = low[k] if (low[k] <= high[k]) & (low[k] < free[k]) else free[k]
