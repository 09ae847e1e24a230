"""What a ring of range sensors tells ``dual_layer`` of obstacles: points, and how fast they come.

Lei et al. 2014 (``lei2014`` cites it) take obstacles as discs of known place, size and velocity, from an
omnidirectional camera and a radio. Where a robot has only range sensors, each hit is taken here as an obstacle without
size. Its velocity is what has changed since the scan before: the hits of that scan, joined in the order of their
bearings, draw the outline of what stood there, and a hit has moved as far as it lies from that outline. A wall that the
robot drives along lies on its own outline and so stands still, however the robot turned. A hit further off than
anything could have moved is seen for the first time, and counts as standing still.
"""

import math

import numpy as np

from navbench.compiled import compiled
from navbench.contract import FloatArray, RangeSensor

from .danger import ASIDE, azimuth, sector

ROUNDING_M = 1e-9  # more than rounding can bring nearer


@compiled
def displacement(x: float, y: float, outline: FloatArray, reach_m: float) -> tuple[float, float]:
    """Return the shortest vector to a point from an outline [m], 0 where none is within reach.

    Args:
        x: the point's x [m].
        y: the point's y [m].
        outline: (n, 4) as of ``join``.
        reach_m: how long the way may be [m].
    """
    best, best_x, best_y, near = math.inf, 0.0, 0.0, reach_m + ROUNDING_M
    for i in range(outline.shape[0]):
        px, py, ux, uy = x - outline[i, 0], y - outline[i, 1], outline[i, 2], outline[i, 3]
        if math.isnan(px):
            break
        if px < min(ux, 0.0) - near or px > max(ux, 0.0) + near:
            continue
        if py < min(uy, 0.0) - near or py > max(uy, 0.0) + near:
            continue
        length2 = ux * ux + uy * uy
        along = 0.0 if length2 == 0.0 else min(max((px * ux + py * uy) / length2, 0.0), 1.0)
        dx, dy = px - along * ux, py - along * uy
        if dx * dx + dy * dy > near * near:
            continue
        away = math.hypot(dx, dy)
        if away < best:
            best, best_x, best_y = away, dx, dy
            near = min(best, reach_m) + ROUNDING_M
    return (best_x, best_y) if best <= reach_m else (0.0, 0.0)


@compiled
def scan(
    mounts: FloatArray, ranges_m: FloatArray, pose: tuple[float, float, float], front_rad: float, side_rad: float,
    period_s: float, reach_m: float, outline: FloatArray, points: FloatArray, obstacles: FloatArray,
) -> int:  # fmt: skip
    """Write the hits as obstacles, remember them as the next outline, and return how many obstacles there are.

    Args:
        mounts: (n, 6) as ``by_bearing`` returns them.
        ranges_m: (n,) readings, in the order of the sensors [m].
        pose: the robot's x [m], y [m] and heading [rad].
        front_rad: how far the front sector reaches [rad].
        side_rad: a hit further aside is no obstacle [rad].
        period_s: time since the scan before [s].
        reach_m: how far an obstacle may have moved in it [m]; what has moved further is new, and stands still.
        outline: (n, 4) as of ``join``; read, then written.
        points: (n, 2) is written.
        obstacles: (n, 5) x, y [m], vx, vy [m/s] and the sector; the first rows are written.
    """
    x, y, psi = pose
    c, s = math.cos(psi), math.sin(psi)
    count = 0
    for i in range(mounts.shape[0]):
        range_m = ranges_m[int(mounts[i, 5])]
        if range_m >= mounts[i, 4]:
            points[i, 0] = math.nan
            continue
        ahead, left = mounts[i, 0] + range_m * mounts[i, 2], mounts[i, 1] + range_m * mounts[i, 3]
        hit_x, hit_y = x + c * ahead - s * left, y + s * ahead + c * left
        points[i, 0], points[i, 1] = hit_x, hit_y
        where = sector(azimuth(psi, math.atan2(hit_y - y, hit_x - x)), front_rad, side_rad)
        if where == ASIDE:
            continue
        dx, dy = displacement(hit_x, hit_y, outline, reach_m)
        obstacles[count, 0], obstacles[count, 1] = hit_x, hit_y
        obstacles[count, 2], obstacles[count, 3], obstacles[count, 4] = dx / period_s, dy / period_s, where
        count += 1
    join(points, outline)
    return count


@compiled
def join(points: FloatArray, outline: FloatArray) -> None:
    """Write the outline that some points draw, in the order of their bearings.

    Args:
        points: (n, 2) x and y [m], x nan where there is none.
        outline: (n, 4) x and y of each point, and the way to its neighbour, 0 without one [m], then a row that begins
            with nan; is written.
    """
    count = 0
    for i in range(points.shape[0]):
        if not math.isnan(points[i, 0]):
            ux, uy = 0.0, 0.0
            if i + 1 < points.shape[0] and not math.isnan(points[i + 1, 0]):
                ux, uy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
            outline[count, 0], outline[count, 1] = points[i, 0], points[i, 1]
            outline[count, 2], outline[count, 3] = ux, uy
            count += 1
    if count < outline.shape[0]:
        outline[count, 0] = math.nan


def by_bearing(sensors: tuple[RangeSensor, ...]) -> FloatArray:
    """Return a ring in the order of its bearings, for ``scan``.

    Returns:
        (n, 6) x [m], y [m], cosine and sine of the heading, largest reading [m], place among the readings.
    """
    bearings = [math.atan2(math.sin(sensor.heading_rad), math.cos(sensor.heading_rad)) for sensor in sensors]
    rows = [
        (sensor.x_m, sensor.y_m, math.cos(sensor.heading_rad), math.sin(sensor.heading_rad), sensor.max_range_m, i)
        for i, sensor in sorted(enumerate(sensors), key=lambda numbered: bearings[numbered[0]])
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 6)
