"""The ring's rays: where they begin and end on the robot, and how hits become readings."""

import math

import numba
import numpy as np
from numpy.typing import NDArray

from navbench.descriptions.sensors import Sensors
from navbench.mathematics.geometry import distance_to_nearest

FloatArray = NDArray[np.float64]


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
        lengths, offsets, first, points = [], [], [0], []
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
                self.begins.append((begin[0] * scale, begin[1] * scale, 0.0))
                self.ends.append((end[0] * scale, end[1] * scale, 0.0))
                lengths.append(back + limit)
                offsets.append(back)
            first.append(len(lengths))
        self._lengths, self._offsets, self._first = np.array(lengths), np.array(offsets), np.array(first)
        self._points = np.array(points).reshape(-1, 2)
        self.reach_m = reach - radius_m
        self.exposed_m = exposed - radius_m

    def read(self, fractions: list[float]) -> FloatArray:
        """Return the readings (n_sensors,) [m] for the fraction of each ray that is free."""
        ranges = self.nothing.copy()
        _nearest_of_each(np.array(fractions), self._lengths, self._offsets, self._first, ranges)
        return ranges

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
    fractions: FloatArray, lengths: FloatArray, offsets: FloatArray, first: NDArray[np.int64], ranges: FloatArray
) -> None:
    for sensor in range(ranges.shape[0]):
        for ray in range(first[sensor], first[sensor + 1]):
            if fractions[ray] < 1.0:
                ranges[sensor] = min(ranges[sensor], max(fractions[ray] * lengths[ray] - offsets[ray], 0.0))


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
