"""Angles, distances and the round robot's clearance in the plane, as small compiled functions."""

import math
from collections.abc import Iterable

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
    return math.pi if wrapped <= -math.pi else wrapped  # the remainder of a hair is rounded up to a whole turn


@compiled
def box_gap(x_m: float, y_m: float, boxes: FloatArray, k: int) -> tuple[float, float, float]:
    """Return the signed distance from a point to a box [m], and its gradient: the unit vector away from the box.

    Args:
        x_m: the point's x [m].
        y_m: the point's y [m].
        boxes: (n, 6) centre x, centre y, half length, half width, cosine and sine of the heading.
        k: the box's row.
    """
    dx, dy, cosine, sine = x_m - boxes[k, 0], y_m - boxes[k, 1], boxes[k, 4], boxes[k, 5]
    along, across = cosine * dx + sine * dy, cosine * dy - sine * dx
    over_along, over_across = abs(along) - boxes[k, 2], abs(across) - boxes[k, 3]
    if over_along <= 0.0 and over_across <= 0.0:
        gap = max(over_along, over_across)
        px, py = (1.0, 0.0) if over_along > over_across else (0.0, 1.0)
    else:
        px, py = max(over_along, 0.0), max(over_across, 0.0)
        gap = math.hypot(px, py)
        px, py = px / gap, py / gap
    px, py = math.copysign(px, along), math.copysign(py, across)
    return gap, cosine * px - sine * py, sine * px + cosine * py


@compiled
def is_box_near(x_m: float, y_m: float, boxes: FloatArray, k: int, far_m: float) -> bool:
    """Return whether a box may be this near to a point, without a root; False surely says that ``box_gap`` is more."""
    dx, dy, cosine, sine = x_m - boxes[k, 0], y_m - boxes[k, 1], boxes[k, 4], boxes[k, 5]
    px = max(abs(cosine * dx + sine * dy) - boxes[k, 2], 0.0)
    py = max(abs(cosine * dy - sine * dx) - boxes[k, 3], 0.0)
    near: bool = px * px + py * py <= far_m * far_m * (1.0 + 1e-12) or px + py == 0.0
    return near


@compiled
def polygon_gap(x_m: float, y_m: float, polygons: FloatArray, k: int) -> tuple[float, float, float]:
    """Return the signed distance from a point to a convex polygon [m], and its gradient, as ``box_gap`` does.

    Args:
        x_m: the point's x [m].
        y_m: the point's y [m].
        polygons: (n, 5 + 2 c): x, y [m], three numbers of no matter here, and c corners counter-clockwise, seen from x
            and y [m]; a corner may be repeated.
        k: the polygon's row.
    """
    px, py = x_m - polygons[k, 0], y_m - polygons[k, 1]
    corners = (polygons.shape[1] - 5) // 2
    nearest, inside, rx, ry, nx, ny = math.inf, True, 0.0, 0.0, 0.0, 0.0
    ax, ay = polygons[k, 3 + 2 * corners], polygons[k, 4 + 2 * corners]
    for corner in range(corners):
        bx, by = polygons[k, 5 + 2 * corner], polygons[k, 6 + 2 * corner]
        ux, uy, qx, qy = bx - ax, by - ay, px - ax, py - ay
        ax, ay = bx, by
        length = math.hypot(ux, uy)
        if length == 0.0:
            continue
        ux, uy = ux / length, uy / length
        inside = inside and ux * qy - uy * qx >= 0.0
        along = min(max(qx * ux + qy * uy, 0.0), length)
        away = math.hypot(qx - along * ux, qy - along * uy)
        if away < nearest:
            nearest, rx, ry, nx, ny = away, qx - along * ux, qy - along * uy, uy, -ux
    return (-nearest, nx, ny) if inside else (nearest, rx / nearest, ry / nearest)


@compiled
def distance_to_nearest(x_m: float, y_m: float, boxes: FloatArray, discs: FloatArray, polygons: FloatArray) -> float:
    """Return the signed distance from a point to the nearest box, disc or polygon [m], infinite where there is none.

    Args:
        x_m: the point's x [m].
        y_m: the point's y [m].
        boxes: (n, 6) as in ``box_gap``.
        discs: (n, 3 or more) centre x, centre y, radius [m].
        polygons: (n, 5 + 2 c) as in ``polygon_gap``.
    """
    nearest: float = distance_to_nearest_of(
        x_m, y_m, boxes, discs, polygons, range(boxes.shape[0]), range(discs.shape[0]), range(polygons.shape[0])
    )
    return nearest


@compiled
def distance_to_nearest_of(
    x_m: float,
    y_m: float,
    boxes: FloatArray,
    discs: FloatArray,
    polygons: FloatArray,
    near_boxes: Iterable[int],
    near_discs: Iterable[int],
    near_polygons: Iterable[int],
) -> float:
    """Return what ``distance_to_nearest`` does, of some rows alone."""
    nearest = math.inf
    for i in near_boxes:
        if is_box_near(x_m, y_m, boxes, i, nearest):
            nearest = min(nearest, box_gap(x_m, y_m, boxes, i)[0])
    for i in near_discs:
        dx, dy = x_m - discs[i, 0], y_m - discs[i, 1]
        nearest = min(nearest, math.sqrt(dx * dx + dy * dy) - discs[i, 2])
    for i in near_polygons:
        nearest = min(nearest, polygon_gap(x_m, y_m, polygons, i)[0])
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
