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

ROUNDING_M = 1e-9  # more than rounding can bring nearer


@compiled
def displacement(x: float, y: float, before: FloatArray, reach_m: float) -> tuple[float, float]:
    """Return the shortest way to a point from an outline [m], 0 where none is within reach.

    Args:
        x: the point's x [m].
        y: the point's y [m].
        before: (n, 2) the outline's points in order, nan where it is broken [m].
        reach_m: how long the way may be [m].
    """
    best, best_x, best_y = math.inf, 0.0, 0.0
    for i in range(before.shape[0]):
        ax, ay = before[i, 0], before[i, 1]
        if math.isnan(ax):
            continue
        ux, uy = 0.0, 0.0
        if i + 1 < before.shape[0] and not math.isnan(before[i + 1, 0]):
            ux, uy = before[i + 1, 0] - ax, before[i + 1, 1] - ay
        near = min(best, reach_m) + ROUNDING_M
        if min(ux, 0.0) - near > x - ax or x - ax > max(ux, 0.0) + near:
            continue
        if min(uy, 0.0) - near > y - ay or y - ay > max(uy, 0.0) + near:
            continue
        length2 = ux * ux + uy * uy
        along = 0.0 if length2 == 0.0 else min(max(((x - ax) * ux + (y - ay) * uy) / length2, 0.0), 1.0)
        dx, dy = x - ax - along * ux, y - ay - along * uy
        if math.hypot(dx, dy) < best:
            best, best_x, best_y = math.hypot(dx, dy), dx, dy
    return (best_x, best_y) if best <= reach_m else (0.0, 0.0)


@compiled
def scan(
    mounts: FloatArray, ranges_m: FloatArray, pose: tuple[float, float, float], period_s: float, reach_m: float,
    before: FloatArray, now: FloatArray, obstacles: FloatArray,
) -> int:  # fmt: skip
    """Write the hits as obstacles, remember them as the next outline, and return how many there are.

    Args:
        mounts: (n, 6) as ``by_bearing`` returns them.
        ranges_m: (n,) readings, in the order of the sensors [m].
        pose: the robot's x [m], y [m] and heading [rad].
        period_s: time since the scan before [s].
        reach_m: how far an obstacle may have moved in it [m]; what has moved further is new, and stands still.
        before: (n, 2) the outline; read, then written.
        now: (n, 2) is written.
        obstacles: (n, 5) x, y, radius [m], vx, vy [m/s]; the first rows are written.
    """
    x, y, psi = pose
    c, s = math.cos(psi), math.sin(psi)
    count = 0
    for i in range(mounts.shape[0]):
        range_m = ranges_m[int(mounts[i, 5])]
        if range_m >= mounts[i, 4]:
            now[i, 0] = math.nan
            continue
        ahead, left = mounts[i, 0] + range_m * mounts[i, 2], mounts[i, 1] + range_m * mounts[i, 3]
        now[i, 0], now[i, 1] = x + c * ahead - s * left, y + s * ahead + c * left
        dx, dy = displacement(now[i, 0], now[i, 1], before, reach_m)
        obstacles[count] = now[i, 0], now[i, 1], 0.0, dx / period_s, dy / period_s
        count += 1
    before[:] = now
    return count


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
