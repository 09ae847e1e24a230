"""Angles, distances and the round robot's clearance in the plane, as small compiled functions."""

import math

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled

FloatArray = NDArray[np.float64]


@compiled
def wrap_angle(angle_rad: float) -> float:
    """Return the angle in (-pi, pi] [rad]."""
    if -math.pi < angle_rad <= math.pi:
        return angle_rad
    wrapped: float = math.pi - (math.pi - angle_rad) % (2.0 * math.pi)
    return wrapped if wrapped > -math.pi else math.pi  # the remainder of a hair is rounded up to a whole turn


@compiled
def box_distance(x_m: float, y_m: float, box: FloatArray) -> float:
    """Return the signed distance from a point to a rotated box [m], negative inside.

    Args:
        x_m: the point's x [m].
        y_m: the point's y [m].
        box: (6,) centre x, centre y, half length, half width, cosine and sine of the heading.
    """
    dx: float = x_m - box[0]
    dy: float = y_m - box[1]
    along: float = abs(box[4] * dx + box[5] * dy) - box[2]
    across: float = abs(box[4] * dy - box[5] * dx) - box[3]
    if along <= 0.0 and across <= 0.0:
        return max(along, across)
    return math.hypot(max(along, 0.0), max(across, 0.0))


@compiled
def polygon_distance(x_m: float, y_m: float, polygon: FloatArray) -> float:
    """Return the signed distance from a point to a convex polygon [m], negative inside.

    Args:
        x_m: the point's x [m].
        y_m: the point's y [m].
        polygon: (5 + 2 k,) x, y [m], three numbers of no matter here, and k corners counter-clockwise, seen from x
            and y [m]; a corner may be repeated.
    """
    px: float = x_m - polygon[0]
    py: float = y_m - polygon[1]
    corners = (polygon.shape[0] - 5) // 2
    nearest, inside = math.inf, True
    for k in range(corners):
        after = (k + 1) % corners
        ax, ay = polygon[5 + 2 * k], polygon[6 + 2 * k]
        ux, uy = polygon[5 + 2 * after] - ax, polygon[6 + 2 * after] - ay
        qx, qy = px - ax, py - ay
        square = ux * ux + uy * uy
        along = min(max((qx * ux + qy * uy) / square, 0.0), 1.0) if square > 0.0 else 0.0
        nearest = min(nearest, math.hypot(qx - along * ux, qy - along * uy))
        inside = inside and ux * qy - uy * qx >= 0.0
    return -nearest if inside else nearest


@compiled
def distance_to_nearest(x_m: float, y_m: float, boxes: FloatArray, discs: FloatArray, polygons: FloatArray) -> float:
    """Return the signed distance from a point to the nearest box, disc or polygon [m], infinite where there is none.

    Args:
        x_m: the point's x [m].
        y_m: the point's y [m].
        boxes: (n, 6) as in ``box_distance``.
        discs: (n, 3 or more) centre x, centre y, radius [m].
        polygons: (n, 5 + 2 k) as in ``polygon_distance``.
    """
    nearest = math.inf
    for i in range(boxes.shape[0]):
        nearest = min(nearest, box_distance(x_m, y_m, boxes[i]))
    for i in range(discs.shape[0]):
        nearest = min(nearest, math.hypot(x_m - discs[i, 0], y_m - discs[i, 1]) - discs[i, 2])
    for i in range(polygons.shape[0]):
        nearest = min(nearest, polygon_distance(x_m, y_m, polygons[i]))
    return nearest


@compiled
def segment_crossing(ax: float, ay: float, bx: float, by: float, line: FloatArray) -> float:
    """Return where the line from a to b crosses a segment, as a fraction of its length in [0, 1]; -1 where it does not.

    Args:
        ax: x of the line's beginning [m].
        ay: y of the line's beginning [m].
        bx: x of the line's end [m].
        by: y of the line's end [m].
        line: (4,) the segment's two end points, x1, y1, x2, y2 [m].
    """
    ux, uy = line[2] - line[0], line[3] - line[1]
    before = ux * (ay - line[1]) - uy * (ax - line[0])
    after = ux * (by - line[1]) - uy * (bx - line[0])
    if before == after or (before > 0.0) == (after > 0.0):
        return -1.0
    fraction = before / (before - after)
    x, y = ax + fraction * (bx - ax), ay + fraction * (by - ay)
    along = (ux * (x - line[0]) + uy * (y - line[1])) / (ux * ux + uy * uy)
    return fraction if 0.0 <= along <= 1.0 else -1.0
