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


@compiled
def displacement(x: float, y: float, before: FloatArray) -> tuple[float, float]:
    """Return the shortest distance to a point from an outline [m], infinite where there is none.

    Args:
        x: the point's x [m].
        y: the point's y [m].
        before: (n, 2) the outline's points in order, nan where it is broken [m].
    """
    best, best_x, best_y = math.inf, math.inf, math.inf
    for i in range(before.shape[0]):
        if math.isnan(before[i, 0]):
            continue
        ax, ay = before[i, 0], before[i, 1]
        ux, uy = 0.0, 0.0
        if i + 1 < before.shape[0] and not math.isnan(before[i + 1, 0]):
            ux, uy = before[i + 1, 0] - ax, before[i + 1, 1] - ay
        length2 = ux * ux + uy * uy
        along = 0.0 if length2 == 0.0 else min(max(((x - ax) * ux + (y - ay) * uy) / length2, 0.0), 1.0)
        dx, dy = x - ax - along * ux, y - ay - along * uy
        if math.hypot(dx, dy) < best:
            best, best_x, best_y = math.hypot(dx, dy), dx, dy
    return best_x, best_y


@compiled
def scan(
    mounts: FloatArray, ranges_m: FloatArray, pose: tuple[float, float, float], period_s: float, reach_m: float,
    before: FloatArray, obstacles: FloatArray,
) -> int:  # fmt: skip
    """Write the hits as obstacles, remember them as the next outline, and return how many there are.

    Args:
        mounts: (n, 4) x [m], y [m], heading [rad] and largest reading [m] of each sensor, in the order of bearings.
        ranges_m: (n,) readings in that order [m].
        pose: the robot's x [m], y [m] and heading [rad].
        period_s: time since the scan before [s].
        reach_m: how far an obstacle may have moved in it [m].
        before: (n, 2) the outline; read, then written.
        obstacles: (n, 5) x, y, radius [m], vx, vy [m/s]; the first rows are written.
    """
    x, y, psi = pose
    c, s = math.cos(psi), math.sin(psi)
    now = np.full(before.shape, np.nan)
    count = 0
    for i in range(mounts.shape[0]):
        if ranges_m[i] >= mounts[i, 3]:
            continue
        ahead = mounts[i, 0] + ranges_m[i] * math.cos(mounts[i, 2])
        left = mounts[i, 1] + ranges_m[i] * math.sin(mounts[i, 2])
        now[i, 0], now[i, 1] = x + c * ahead - s * left, y + s * ahead + c * left
        dx, dy = displacement(now[i, 0], now[i, 1], before)
        if math.hypot(dx, dy) > reach_m:
            dx, dy = 0.0, 0.0
        obstacles[count] = now[i, 0], now[i, 1], 0.0, dx / period_s, dy / period_s
        count += 1
    before[:] = now
    return count


class Hits:
    """The ring's hits as obstacles, and the scan that it remembers.

    Args:
        sensors: the ring's sensors, in the order of the readings.
        period_s: time between two scans [s].
        speed_max_mps: how fast an obstacle may move [m/s].
    """

    def __init__(self, sensors: tuple[RangeSensor, ...], period_s: float, speed_max_mps: float) -> None:
        rows = [(sensor.x_m, sensor.y_m, sensor.heading_rad, sensor.max_range_m) for sensor in sensors]
        mounts = np.array(rows, dtype=np.float64).reshape(-1, 4)
        self._order = np.argsort(np.arctan2(np.sin(mounts[:, 2]), np.cos(mounts[:, 2])), kind="stable")
        self._mounts = mounts[self._order]
        self._period_s, self._reach_m = period_s, speed_max_mps * period_s
        self._before = np.full((len(mounts), 2), np.nan)
        self._obstacles = np.empty((len(mounts), 5))

    def __call__(self, ranges_m: FloatArray, pose: tuple[float, float, float]) -> FloatArray:
        """Return the hits of the readings [m] taken at a pose as (n_hits, 5) x, y, radius [m], vx, vy [m/s]."""
        count = scan(
            self._mounts, ranges_m[self._order], pose, self._period_s, self._reach_m, self._before, self._obstacles
        )
        return self._obstacles[:count]
