"""A layout at an instant, as the arrays that compiled functions take: boxes, and discs and polygons where they are."""

import math

import numpy as np
from numpy.typing import NDArray

from navbench.mathematics.geometry import distance_to_nearest
from navbench.simulation.index import index_of
from navbench.world.grid import NO_GRID, nearest_cell
from navbench.world.layout import Layout
from navbench.world.shapes import place_movers

FloatArray = NDArray[np.float64]


class Scene:
    """Everything in a layout but its robots, at time 0 until ``move_to`` says otherwise.

    Args:
        layout: the layout.
        reach_m: how far from its centre a robot may sense or touch things [m].

    Attributes:
        layout: the layout.
        boxes: (n, 6) as in ``Layout.box_rows``.
        discs: (m, 5) as in ``Layout.disc_rows``, changed in place.
        polygons: (l, 5 + 2 k) as in ``Layout.polygon_rows``, changed in place.
        finish_line: (1, 6) as a box without width, or (0, 6) for none.
        grid: as ``Grid.arrays``, (0, 0) without one.
        arrays: all of these, the movers' tables, round and outlined ones, and what is near where, as compiled functions
            take them.
        fastest_mps: the largest speed of any mover [m/s].
    """

    def __init__(self, layout: Layout, reach_m: float = math.inf) -> None:
        self.layout = layout
        self.boxes, self.discs, self.polygons = map(
            np.ascontiguousarray, (layout.box_rows(), layout.disc_rows(), layout.polygon_rows())
        )
        self.finish_line = layout.finish_line_row()
        self.fastest_mps = layout.fastest_mps
        self._round_tables, self._outlined_tables = layout.round_tables, layout.outlined_tables
        self.grid = NO_GRID if layout.grid is None else layout.grid.arrays()
        self.arrays = (
            self.boxes, self.discs, self.polygons, self.finish_line, self._round_tables, self._outlined_tables,
            *self.grid,
            index_of(self.boxes, self.discs, self.polygons, len(layout.discs), len(layout.polygons), reach_m),
        )  # fmt: skip

    def move_to(self, t_s: float) -> None:
        """Put the movers where they are at a time [s]."""
        if self.fastest_mps:
            place_movers(t_s, *self._round_tables, self.discs)
            place_movers(t_s, *self._outlined_tables, self.polygons)

    def mover_order(self) -> list[int]:
        """Return the movers' numbers in the layout, the round ones first, as in the rows of ``mover_places``."""
        return sorted(range(len(self.layout.movers)), key=lambda i: bool(self.layout.movers[i].outline))

    def mover_places(self) -> FloatArray:
        """Return where the movers are: (n, 2) x, y [m], the round ones first."""
        still = len(self.layout.discs), len(self.layout.polygons)
        return np.concatenate([self.discs[still[0] :, :2], self.polygons[still[1] :, :2]])

    def circles(self) -> FloatArray:
        """Return discs and the circles that hold the polygons: (n, 5) x, y, radius, vx, vy [m, m/s]."""
        return np.concatenate([self.discs, self.polygons[:, :5]])

    def distance(self, x_m: float, y_m: float) -> float:
        """Return the signed distance from a point to the nearest thing [m], infinite where there is none."""
        nearest: float = distance_to_nearest(x_m, y_m, self.boxes, self.discs, self.polygons)
        return min(nearest, nearest_cell(x_m, y_m, *self.grid))
