"""Which things are near a place: a grid of squares, each with the numbers of all that matters to a robot in it.

What matters is what comes within a reach of the square, and what may be the nearest thing to a place in it. The squares
are halved until they are half a reach wide, and each is given what still matters of its parent's things.
"""

import math

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled
from navbench.mathematics.geometry import box_gap, polygon_gap

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Index = tuple[FloatArray, IntArray, IntArray, IntArray, IntArray]

MANY = 256  # things: fewer are looked at one by one
LEVELS_MAX = 7  # halvings: 128 squares a side
HAIR = 1e-9  # of a distance: rounding stays below it


def index_of(
    boxes: FloatArray, discs: FloatArray, polygons: FloatArray, still_discs: int, still_polygons: int, reach_m: float
) -> Index:
    """Return an index of things, with everything in one list where they are few or the reach is infinite.

    Args:
        boxes: (n, 6) as in ``Layout.box_rows``.
        discs: (m, 5) as in ``Layout.disc_rows``.
        polygons: (l, 5 + 2 k) as in ``Layout.polygon_rows``.
        still_discs: how many of the first discs stand; the others are near everywhere.
        still_polygons: how many of the first polygons do.
        reach_m: from a robot's centre [m].

    Returns:
        (4,) where the squares begin along x and y, their side [m], and how many there are a side; (3, squares + 2)
        where each square's numbers begin, of boxes, discs and polygons; and these numbers, in ascending order, three
        arrays. The last list, for places outside all squares, holds everything.
    """
    counts = len(boxes), len(discs), len(polygons)
    if sum(counts) < MANY or reach_m == math.inf:
        boxes_of, discs_of, polygons_of = map(np.arange, counts)
        return np.array([0.0, 0.0, 1.0, 0.0]), np.array([[0, n] for n in counts]), boxes_of, discs_of, polygons_of
    centres = np.concatenate([boxes[:, :2], discs[:still_discs, :2], polygons[:still_polygons, :2]])
    low, high = centres.min(axis=0) - reach_m, centres.max(axis=0) + reach_m
    place = np.array([*low, max(high - low), 1.0])
    begins, items = np.array([0, sum(counts)]), np.arange(sum(counts))
    for _ in range(LEVELS_MAX):
        if place[2] <= 0.5 * reach_m:
            break
        place[2:] *= 0.5, 2.0
        begins, items = _halved(place, begins, items, boxes, discs, polygons, still_discs, still_polygons, reach_m)
    kinds, first = [], 0
    for count in counts:
        own = (items >= first) & (items < first + count)
        before = np.append(np.concatenate([[0], np.cumsum(own)])[begins], own.sum() + count)
        kinds.append((before, np.concatenate([items[own] - first, np.arange(count)])))
        first += count
    return place, np.stack([before for before, _ in kinds]), kinds[0][1], kinds[1][1], kinds[2][1]


@compiled
def nearby(x_m: float, y_m: float, index: Index) -> tuple[IntArray, IntArray, IntArray]:
    """Return the numbers of the boxes, discs and polygons that may be within reach of a place, or nearest to it."""
    place, begins, boxes, discs, polygons = index
    column, row = (x_m - place[0]) / place[2], (y_m - place[1]) / place[2]
    square = begins.shape[1] - 2
    if 0.0 <= column < place[3] and 0.0 <= row < place[3]:
        square = int(row) * int(place[3]) + int(column)
    return (
        boxes[begins[0, square] : begins[0, square + 1]],
        discs[begins[1, square] : begins[1, square + 1]],
        polygons[begins[2, square] : begins[2, square + 1]],
    )


@compiled
def _halved(
    place: FloatArray,
    begins: IntArray,
    items: IntArray,
    boxes: FloatArray,
    discs: FloatArray,
    polygons: FloatArray,
    still_discs: int,
    still_polygons: int,
    reach_m: float,
) -> tuple[IntArray, IntArray]:
    """Return the lists of squares from those of squares twice as wide; things are numbered through all kinds."""
    side, count = place[2], int(place[3])
    found, ends = np.empty(4 * items.shape[0], np.int64), np.zeros(count * count + 1, np.int64)
    gaps, half, end = np.empty(items.shape[0]), math.sqrt(0.5) * side, 0
    for square in range(count * count):
        row, column = square // count, square % count
        x, y = place[0] + (column + 0.5) * side, place[1] + (row + 0.5) * side
        parent = row // 2 * (count // 2) + column // 2
        nearest = math.inf
        for k in range(begins[parent], begins[parent + 1]):
            disc, polygon = items[k] - boxes.shape[0], items[k] - boxes.shape[0] - discs.shape[0]
            gaps[k] = -math.inf  # of a mover
            if disc < 0:
                gaps[k] = box_gap(x, y, boxes, items[k])[0]
            elif disc < still_discs:
                gaps[k] = math.hypot(x - discs[disc, 0], y - discs[disc, 1]) - discs[disc, 2]
            elif 0 <= polygon < still_polygons:
                gaps[k] = polygon_gap(x, y, polygons, polygon)[0]
            if gaps[k] > -math.inf:
                nearest = min(nearest, gaps[k])
        far = (max(reach_m, nearest + half) + half) * (1.0 + HAIR)
        for k in range(begins[parent], begins[parent + 1]):
            if gaps[k] <= far:
                found[end] = items[k]
                end += 1
        ends[square + 1] = end
    return ends, found[:end].copy()
