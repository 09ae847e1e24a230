"""The ring's rays: where they begin and end on the robot, and how hits become readings."""

import math

import numba
import numpy as np
from numpy.typing import NDArray

from navbench.descriptions.sensors import Sensors
from navbench.mathematics.geometry import distance_to_nearest

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HAIR_RADII = 0.01  # more than the engine's own tolerance, 0.001 units where a radius has 4 or more


class Rays:
    """A ring's rays in the robot frame, in simulation units, and how hits become readings.

    A ray begins where its line enters the hull, so that a thing between the hull and a mount outside it reads 0.

    Attributes:
        begins: each ray's beginning.
        ends: each ray's end.
        nothing: (n_sensors,) what is read where nothing is seen [m].
        reach_m: what is further from the hull is hit by no ray [m].
        exposed_m: what is further from the hull can hold no mount of a ray that does not begin in the hull [m].
    """

    def __init__(self, sensors: Sensors, radius_m: float, scale: float) -> None:
        self.begins: list[tuple[float, float, float]] = []
        self.ends: list[tuple[float, float, float]] = []
        lengths, offsets, first, points, tips = [], [], [0], [], []
        reach, exposed = 0.0, 0.0
        self.nothing = np.array([mount.max_range_m for mount in sensors.complete_mounts()], dtype=np.float64)
        for mount in sensors.complete_mounts():
            half, count, limit = mount.cone_half_angle_rad or 0.0, mount.rays or 1, mount.max_range_m or 0.0
            for turn in np.linspace(-half, half, count).tolist() if count > 1 else [0.0]:
                cosine, sine = math.cos(mount.heading_rad + turn), math.sin(mount.heading_rad + turn)
                back = _back_into_hull(mount.x_m, mount.y_m, cosine, sine, radius_m)
                away = math.hypot(mount.x_m, mount.y_m)
                if back == 0.0 and away > radius_m:
                    exposed = max(exposed, away)
                reach = max(reach, away, math.hypot(mount.x_m + limit * cosine, mount.y_m + limit * sine))
                begin = (mount.x_m - back * cosine, mount.y_m - back * sine)
                end = (mount.x_m + limit * cosine, mount.y_m + limit * sine)
                points.append(begin)
                tips.append(end)
                self.begins.append((begin[0] * scale, begin[1] * scale, 0.0))
                self.ends.append((end[0] * scale, end[1] * scale, 0.0))
                lengths.append(back + limit)
                offsets.append(back)
            first.append(len(lengths))
        self._lengths, self._offsets, self._first = np.array(lengths), np.array(offsets), np.array(first)
        self._points, self._tips = np.array(points).reshape(-1, 2), np.array(tips).reshape(-1, 2)
        self._sensors = np.repeat(np.arange(len(first) - 1), np.diff(first))
        self._radius_m = radius_m
        self.reach_m = reach - radius_m
        self.exposed_m = exposed - radius_m

    def near(
        self, robots: NDArray[np.void], boxes: FloatArray, discs: FloatArray, polygons: FloatArray
    ) -> tuple[IntArray, IntArray]:
        """Return the numbers of the running robots' rays that may hit something, and of some that pass it by a hair.

        Args:
            robots: (n,) of ``ROBOT``.
            boxes: (k, 6) as in ``World.box_rows``.
            discs: (m, 5) as in ``World.disc_rows``.
            polygons: (l, ...) as in ``World.polygon_rows``.

        Returns:
            All robots' numbers in a row, and (n + 1,) how many came before each robot's, with their sum as the last.
        """
        return _near(robots, self._radius_m, self.reach_m, self._points, self._tips, boxes, discs, polygons)

    def read(self, rays: IntArray, before: IntArray, fractions: list[float]) -> FloatArray:
        """Return the readings (n_robots, n_sensors) [m] for the fraction that is free of each ray of ``near``."""
        free = np.array(fractions, dtype=np.float64)
        return _nearest_of_each(rays, before, free, self._lengths, self._offsets, self._sensors, self.nothing)

    def bury(
        self,
        ranges: FloatArray,
        x_m: float,
        y_m: float,
        heading_rad: float,
        boxes: FloatArray,
        discs: FloatArray,
        polygons: FloatArray,
    ) -> None:
        """Set to 0, in place, the readings of sensors with a ray that begins inside something: it hits nothing."""
        _bury(ranges, self._points, self._first, x_m, y_m, heading_rad, boxes, discs, polygons)


def _back_into_hull(x_m: float, y_m: float, cosine: float, sine: float, radius_m: float) -> float:
    """Return how far back along its ray a mount must go to lie just inside the hull [m], 0 for one inside."""
    hull = radius_m * (1.0 - 1e-6)
    if math.hypot(x_m, y_m) <= hull:
        return 0.0
    along = x_m * cosine + y_m * sine
    square = along * along - (x_m * x_m + y_m * y_m - hull * hull)
    if square <= 0.0 or along <= 0.0:
        return 0.0  # this line misses the hull behind the mount
    return along - math.sqrt(square)


@numba.njit(cache=True)
def _nearest_of_each(
    rays: IntArray,
    before: IntArray,
    fractions: FloatArray,
    lengths: FloatArray,
    offsets: FloatArray,
    sensors: IntArray,
    nothing: FloatArray,
) -> FloatArray:
    ranges = np.empty((before.shape[0] - 1, nothing.shape[0]))
    for i in range(ranges.shape[0]):
        ranges[i] = nothing
        for k in range(before[i], before[i + 1]):
            ray, sensor = rays[k], sensors[rays[k]]
            if fractions[k] < 1.0:
                ranges[i, sensor] = min(ranges[i, sensor], max(fractions[k] * lengths[ray] - offsets[ray], 0.0))
    return ranges


@numba.njit(cache=True)
def _near(
    robots: NDArray[np.void],
    radius_m: float,
    reach_m: float,
    begins: FloatArray,
    ends: FloatArray,
    boxes: FloatArray,
    discs: FloatArray,
    polygons: FloatArray,
) -> tuple[IntArray, IntArray]:
    hair = HAIR_RADII * radius_m
    found = np.empty(robots.shape[0] * begins.shape[0], np.int64)
    before = np.empty(robots.shape[0] + 1, np.int64)
    count = 0
    for index in range(robots.shape[0]):
        before[index] = count
        if not robots[index].running or robots[index].clearance_m > reach_m:
            continue
        x, y, heading = robots[index].x_m, robots[index].y_m, robots[index].heading_rad
        cosine, sine = math.cos(heading), math.sin(heading)
        for ray in range(begins.shape[0]):
            ax = x + cosine * begins[ray, 0] - sine * begins[ray, 1]
            ay = y + sine * begins[ray, 0] + cosine * begins[ray, 1]
            ux = cosine * (ends[ray, 0] - begins[ray, 0]) - sine * (ends[ray, 1] - begins[ray, 1])
            uy = sine * (ends[ray, 0] - begins[ray, 0]) + cosine * (ends[ray, 1] - begins[ray, 1])
            hit = False
            for i in range(boxes.shape[0]):
                hit = hit or _meets_box(ax, ay, ux, uy, boxes[i], hair)
            for i in range(discs.shape[0]):
                hit = hit or _meets_circle(ax, ay, ux, uy, discs[i, 0], discs[i, 1], discs[i, 2] + hair)
            for i in range(polygons.shape[0]):
                hit = hit or _meets_circle(ax, ay, ux, uy, polygons[i, 0], polygons[i, 1], polygons[i, 2] + hair)
            for i in range(robots.shape[0]):
                if i != index:
                    hit = hit or _meets_circle(ax, ay, ux, uy, robots[i].x_m, robots[i].y_m, radius_m + hair)
            if hit:
                found[count] = ray
                count += 1
    before[-1] = count
    return found[:count], before


@numba.njit(cache=True)
def _meets_circle(ax: float, ay: float, ux: float, uy: float, x: float, y: float, radius: float) -> bool:
    """Return whether the segment from a along u comes into a circle."""
    dx, dy = x - ax, y - ay
    along = min(max((dx * ux + dy * uy) / (ux * ux + uy * uy), 0.0), 1.0)
    dx, dy = dx - along * ux, dy - along * uy
    return dx * dx + dy * dy <= radius * radius


@numba.njit(cache=True)
def _meets_box(ax: float, ay: float, ux: float, uy: float, box: FloatArray, hair: float) -> bool:
    """Return whether the segment from a along u comes into a box: its part within both pairs of sides is not empty."""
    dx, dy = ax - box[0], ay - box[1]
    low, high = 0.0, 1.0
    for axis in range(2):
        place = box[4] * dx + box[5] * dy if axis == 0 else box[4] * dy - box[5] * dx
        step = box[4] * ux + box[5] * uy if axis == 0 else box[4] * uy - box[5] * ux
        half = box[2 + axis] + hair
        if step == 0.0:
            if abs(place) > half:
                return False
            continue
        first, second = (-half - place) / step, (half - place) / step
        low, high = max(low, min(first, second)), min(high, max(first, second))
    return low <= high


@numba.njit(cache=True)
def _bury(
    ranges: FloatArray,
    points: FloatArray,
    first: NDArray[np.int64],
    x_m: float,
    y_m: float,
    heading_rad: float,
    boxes: FloatArray,
    discs: FloatArray,
    polygons: FloatArray,
) -> None:
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    for sensor in range(ranges.shape[0]):
        for ray in range(first[sensor], first[sensor + 1]):
            px = x_m + cosine * points[ray, 0] - sine * points[ray, 1]
            py = y_m + sine * points[ray, 0] + cosine * points[ray, 1]
            if distance_to_nearest(px, py, boxes, discs, polygons) <= 0.0:
                ranges[sensor] = 0.0
