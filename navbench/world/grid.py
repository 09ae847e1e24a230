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
FREE_MAX = 255  # cells along a side of a free rectangle: more are passed in several steps


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
            (4, height, width, 2) for each cell how many columns and rows of free cells begin there, both 0 for an
            occupied one: as the rows and columns run, with the columns reversed, with the rows reversed, and with both;
            and (3,) ``x_min_m``, ``y_min_m``, ``resolution_m``.
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


NO_GRID: tuple[FreeArray, FloatArray] = np.zeros((0, 0, 0, 2), np.uint8), np.array([0.0, 0.0, 1.0])


@lru_cache(maxsize=8)
def _free_cells(grid: Grid) -> FreeArray:
    occupied = grid.occupied()
    views = (occupied, occupied[:, ::-1], occupied[::-1], occupied[::-1, ::-1])
    return np.stack([_free_rectangles(np.ascontiguousarray(view)) for view in views])


@compiled
def _free_rectangles(occupied: NDArray[np.bool_]) -> FreeArray:
    """Return how many columns and rows of free cells begin at each cell: (height, width, 2).

    It is the next row's rectangle with this row added or the next column's with this column added: that of these whose
    shorter side is longer.
    """
    height, width = occupied.shape
    free = np.full((height + 1, width + 1, 2), FREE_MAX, np.uint8)  # what is outside is free
    rows = np.full(width, FREE_MAX)  # how many are free from here on in each column
    for i in range(height - 1, -1, -1):
        columns = FREE_MAX
        for j in range(width - 1, -1, -1):
            if occupied[i, j]:
                columns, rows[j], free[i, j] = 0, 0, 0
                continue
            columns, rows[j] = min(columns + 1, FREE_MAX), min(rows[j] + 1, FREE_MAX)
            next_row, next_column = free[i + 1, j], free[i, j + 1]
            wide = min(np.intp(next_row[0] or columns), columns), min(np.intp(next_row[1]) + 1, FREE_MAX)
            high = min(np.intp(next_column[0]) + 1, FREE_MAX), min(np.intp(next_column[1] or rows[j]), rows[j])
            free[i, j, 0], free[i, j, 1] = wide if (min(wide), max(wide)) > (min(high), max(high)) else high
    return free[:height, :width]


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

    Cells are tried ring by ring around the point's own, beginning beyond those that are known to be free, until none
    further out can be nearer; free rectangles lead along a ring in large steps.
    """
    height, width = free.shape[1], free.shape[2]
    nearest = math.inf
    if height == 0:
        return nearest
    row = min(max(int(math.floor((y_m - place[1]) / place[2])), 0), height - 1)
    column = min(max(int(math.floor((x_m - place[0]) / place[2])), 0), width - 1)
    known = FREE_MAX
    for quarter in range(4):
        cell = free[quarter, height - 1 - row if quarter & 2 else row, width - 1 - column if quarter & 1 else column]
        known = min(known, int(np.intp(cell.min())))
    for ring in range(known, max(height, width)):
        if (ring - 1) * place[2] >= nearest:
            break
        for i in (row - ring, row + ring):
            j = max(column - ring, 0)
            while 0 <= i < height and j <= min(column + ring, width - 1):
                if free[0, i, j, 0] == 0:
                    nearest = min(nearest, cell_gap(x_m, y_m, place, i, j)[0])
                j += max(np.intp(free[0, i, j, 0]), 1)
        for j in (column - ring, column + ring):
            i = max(row - ring, 0)
            while 0 <= j < width and i <= min(row + ring, height - 1):
                if free[0, i, j, 1] == 0:
                    nearest = min(nearest, cell_gap(x_m, y_m, place, i, j)[0])
                i += max(np.intp(free[0, i, j, 1]), 1)
    return nearest


@compiled_for_vectors
def ray_to_cell(ax: float, ay: float, ux: float, uy: float, far_m: float, free: FreeArray, place: FloatArray) -> float:
    """Return how far it is from a along a unit vector u to an occupied cell [m], infinite where it is beyond ``far_m``.

    Columns and rows are counted so that they grow along the ray. It steps out of the free rectangle that begins at the
    cell that it is in; where it enters an occupied one, the step was exact.
    """
    height, width, is_left, is_down = free.shape[1], free.shape[2], ux < 0.0, uy < 0.0
    px, py, limit, t = (ax - place[0]) / place[2], (ay - place[1]) / place[2], far_m / place[2], 0.0
    px, py, quarter = width - px if is_left else px, height - py if is_down else py, free[2 * is_down + is_left]
    ux, uy = abs(ux), abs(uy)
    across, along = 1.0 / ux, 1.0 / uy
    if not (0.0 <= px < width and 0.0 <= py < height):  # enter the rectangle, if at all
        t = max(-px * across, -py * along, 0.0)
        if not t <= min((width - px) * across, (height - py) * along, limit):
            return math.inf
    column, row = min(np.intp(px + t * ux), width - 1), min(np.intp(py + t * uy), height - 1)
    while t <= limit and column < width and row < height:
        right, up = column + np.intp(quarter[row, column, 0]), row + np.intp(quarter[row, column, 1])
        if right == column:
            hit: float = t * place[2]
            return hit
        out_x, out_y = (right - px) * across, (up - py) * along
        if out_x < out_y:
            t, column, row = out_x, right, min(np.intp(py + out_x * uy), up - 1)
        else:
            t, column, row = out_y, min(np.intp(px + out_y * ux), right - 1), up
    return math.inf
