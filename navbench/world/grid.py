"""An occupancy grid: square cells of a rectangle, of which some are occupied."""

import base64
import math
import zlib
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic.dataclasses import dataclass

from navbench.compiled import compiled, compiled_for_vectors
from navbench.validation import STRICT, Count, DescriptionError, Number, Positive

FloatArray = NDArray[np.float64]
FreeArray = NDArray[np.uint8]

SIDE_MAX = 2**15  # cells along a side: more are a slip
FREE_MAX = 255  # cells that are known to be free around one: more are passed in several steps


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Grid:
    """Which cells are occupied; everything outside the rectangle is free.

    Attributes:
        x_min_m: where the rectangle begins [m].
        y_min_m: where it begins [m].
        resolution_m: a cell's side [m].
        width: how many cells it has along x.
        height: how many along y.
        cells: one bit a cell, row by row from ``y_min_m``, in each from ``x_min_m``, 1 for occupied: packed into bytes,
            deflated, and written in base 64; see ``Grid.of``.

    Raises:
        DescriptionError: the cells are not as many as that.
    """

    x_min_m: Number
    y_min_m: Number
    resolution_m: Positive
    width: Count
    height: Count
    cells: str

    def __post_init__(self) -> None:
        """Check that there is a bit for each cell."""
        if max(self.width, self.height) > SIDE_MAX:
            raise DescriptionError(f"width: at most {SIDE_MAX} cells a side, got {self.width} x {self.height}")
        wanted = (self.width * self.height + 7) // 8
        try:
            unpacked = zlib.decompressobj().decompress(base64.b64decode(self.cells, validate=True), wanted + 1)
        except (ValueError, zlib.error):
            raise DescriptionError("cells: must be deflated bits in base 64") from None
        if len(unpacked) != wanted:
            raise DescriptionError(f"cells: must hold {self.width * self.height} bits, one a cell")

    @classmethod
    def of(cls, occupied: ArrayLike, resolution_m: float, x_min_m: float = 0.0, y_min_m: float = 0.0) -> "Grid":
        """Return a grid of occupied cells.

        Args:
            occupied: (height, width), true or not 0 where a cell is occupied; the first row has the lowest y.
            resolution_m: a cell's side [m].
            x_min_m: where the first column begins [m].
            y_min_m: where the first row begins [m].
        """
        bits = np.atleast_2d(np.asarray(occupied, dtype=bool))
        height, width = bits.shape
        cells = base64.b64encode(zlib.compress(np.packbits(bits).tobytes(), 9)).decode()
        return cls(x_min_m=x_min_m, y_min_m=y_min_m, resolution_m=resolution_m, width=width, height=height, cells=cells)

    def occupied(self) -> NDArray[np.bool_]:
        """Return the occupied cells: (height, width)."""
        bits = np.frombuffer(zlib.decompress(base64.b64decode(self.cells)), np.uint8)
        return np.unpackbits(bits, count=self.width * self.height).reshape(self.height, self.width).astype(bool)

    def arrays(self) -> tuple[FreeArray, FloatArray]:
        """Return the grid as compiled functions take it.

        Returns:
            (height, width) for each cell how many cells away, along either axis, the nearest occupied one is, at most
            ``FREE_MAX``; and (3,) ``x_min_m``, ``y_min_m``, ``resolution_m``.
        """
        return _free_cells(self), np.array([self.x_min_m, self.y_min_m, self.resolution_m])

    def rectangles(self) -> FloatArray:
        """Return the occupied cells as boxes, (n, 6) as in ``Layout.box_rows``, one for each run in a row."""
        edges = np.diff(np.pad(self.occupied().astype(np.int8), ((0, 0), (1, 1))), axis=1)
        (rows, begins), (_, ends) = np.nonzero(edges == 1), np.nonzero(edges == -1)
        side = self.resolution_m
        columns = (
            self.x_min_m + 0.5 * side * (begins + ends), self.y_min_m + side * (rows + 0.5),
            0.5 * side * (ends - begins), np.full(len(rows), 0.5 * side), np.ones(len(rows)), np.zeros(len(rows)),
        )  # fmt: skip
        return np.column_stack(columns)


NO_GRID: tuple[FreeArray, FloatArray] = np.zeros((0, 0), np.uint8), np.array([0.0, 0.0, 1.0])


@lru_cache(maxsize=8)
def _free_cells(grid: Grid) -> FreeArray:
    from scipy.ndimage import distance_transform_cdt

    occupied = grid.occupied()
    if not occupied.any():
        return np.full(occupied.shape, FREE_MAX, np.uint8)
    away: FreeArray = np.minimum(distance_transform_cdt(~occupied, metric="chessboard"), FREE_MAX).astype(np.uint8)
    return away


@compiled
def cell_gap(x_m: float, y_m: float, place: FloatArray, row: int, column: int) -> tuple[float, float, float]:
    """Return the signed distance from a point to a cell [m], and the unit vector away from it, as ``box_gap`` does."""
    half = 0.5 * place[2]
    dx, dy = x_m - place[0] - place[2] * column - half, y_m - place[1] - place[2] * row - half
    px, py = abs(dx) - half, abs(dy) - half
    if px <= 0.0 and py <= 0.0:
        gap = max(px, py)
        px, py = (1.0, 0.0) if px > py else (0.0, 1.0)
    else:
        px, py = max(px, 0.0), max(py, 0.0)
        gap = math.sqrt(px * px + py * py)
        px, py = px / gap, py / gap
    return gap, math.copysign(px, dx), math.copysign(py, dy)


@compiled
def nearest_cell(x_m: float, y_m: float, free: FreeArray, place: FloatArray) -> float:
    """Return the signed distance from a point to the nearest occupied cell [m], infinite where there is none.

    Cells are tried ring by ring around the point's own, until none further out can be nearer.
    """
    height, width = free.shape
    nearest = math.inf
    if height == 0:
        return nearest
    row = min(max(int(math.floor((y_m - place[1]) / place[2])), 0), height - 1)
    column = min(max(int(math.floor((x_m - place[0]) / place[2])), 0), width - 1)
    for ring in range(int(free[row, column]), max(height, width)):
        if (ring - 1) * place[2] >= nearest:
            break
        for i in range(max(row - ring, 0), min(row + ring, height - 1) + 1):
            step = 1 if abs(i - row) == ring else 2 * ring  # the ring's first and last row are whole
            for j in range(column - ring, column + ring + 1, max(step, 1)):
                if 0 <= j < width and free[i, j] == 0:
                    nearest = min(nearest, cell_gap(x_m, y_m, place, i, j)[0])
    return nearest


@compiled_for_vectors
def ray_to_cell(ax: float, ay: float, ux: float, uy: float, far_m: float, free: FreeArray, place: FloatArray) -> float:
    """Return how far it is from a along a unit vector u to an occupied cell [m], infinite where it is beyond ``far_m``.

    The ray steps out of the largest square of free cells around the one that it is in; where it enters an occupied one,
    the step was exact.
    """
    height, width = free.shape
    px, py, limit, t = (ax - place[0]) / place[2], (ay - place[1]) / place[2], far_m / place[2], 0.0
    across, along, is_right, is_up = 1.0 / ux, 1.0 / uy, ux > 0.0, uy > 0.0
    if not (0.0 <= px < width and 0.0 <= py < height):  # enter the rectangle, if at all
        left, right, low, high = -px * across, (width - px) * across, -py * along, (height - py) * along
        t = max(min(left, right), min(low, high), 0.0)
        if not t <= min(max(left, right), max(low, high), limit):
            return math.inf
    column = min(max(np.intp(math.floor(px + t * ux)), 0), width - 1)
    row = min(max(np.intp(math.floor(py + t * uy)), 0), height - 1)
    while t <= limit and 0 <= row < height and 0 <= column < width:
        c = np.intp(free[row, column])
        if c == 0:
            hit: float = t * place[2]
            return hit
        left_end, right_end, low_end, high_end = column - c + 1, column + c, row - c + 1, row + c
        out_x = ((right_end if is_right else left_end) - px) * across
        out_y = ((high_end if is_up else low_end) - py) * along
        is_side = out_x < out_y or uy == 0.0
        t = out_x if is_side else out_y
        in_column = min(max(np.intp(math.floor(px + t * ux)), left_end), right_end - 1)
        in_row = min(max(np.intp(math.floor(py + t * uy)), low_end), high_end - 1)
        column = (right_end if is_right else left_end - 1) if is_side else in_column
        row = in_row if is_side else (high_end if is_up else low_end - 1)
    return math.inf
