"""A world at an instant, as the arrays that compiled functions take: boxes, and discs and polygons where they are."""

import numpy as np
from numpy.typing import NDArray

from navbench.mathematics.geometry import distance_to_nearest
from navbench.world.shapes import mover_tables, place_movers
from navbench.world.layout import DrawnWorld

FloatArray = NDArray[np.float64]


class Scene:
    """Everything in a world but its robots, at time 0 until ``move_to`` says otherwise.

    Attributes:
        world: the layout, with its world's name, goal tolerance and time limit.
        boxes: (n, 6) as in ``Layout.box_rows``.
        discs: (m, 5) as in ``Layout.disc_rows``, changed in place.
        polygons: (l, 5 + 2 k) as in ``Layout.polygon_rows``, changed in place.
        finish_line: (4,) its ends x1, y1, x2, y2 [m], or (0,) for none.
        fastest_mps: the largest speed of any mover [m/s].
    """

    def __init__(self, world: DrawnWorld) -> None:
        self.world = world
        self.boxes, self.discs, self.polygons = world.box_rows(), world.disc_rows(), world.polygon_rows()
        line = world.finish_line
        self.finish_line = np.array([] if line is None else [line.x1_m, line.y1_m, line.x2_m, line.y2_m])
        self.fastest_mps = world.fastest_mps
        self._round_tables = mover_tables(world.round_movers())
        self._outlined_tables = mover_tables(world.outlined_movers())

    def move_to(self, t_s: float) -> None:
        """Put the movers where they are at a time [s]."""
        if self.fastest_mps:
            place_movers(t_s, *self._round_tables, self.discs)
            place_movers(t_s, *self._outlined_tables, self.polygons)

    def mover_names(self) -> list[str]:
        """Return the movers' names, the round ones first, as in the rows of ``mover_places``."""
        outlined = [bool(mover.outline) for mover in self.world.movers]
        return [f"mover {i}" for kind in (False, True) for i, is_kind in enumerate(outlined) if is_kind == kind]

    def mover_places(self) -> FloatArray:
        """Return where the movers are: (n, 2) x, y [m], the round ones first."""
        still = len(self.world.discs), len(self.world.polygons)
        return np.concatenate([self.discs[still[0] :, :2], self.polygons[still[1] :, :2]])

    def circles(self) -> FloatArray:
        """Return discs and the circles that hold the polygons: (n, 5) x, y, radius, vx, vy [m, m/s]."""
        return np.concatenate([self.discs, self.polygons[:, :5]])

    def distance(self, x_m: float, y_m: float) -> float:
        """Return the signed distance from a point to the nearest thing [m], infinite where there is none."""
        return distance_to_nearest(x_m, y_m, self.boxes, self.discs, self.polygons)


def prism(polygon: FloatArray, half_height_m: float) -> tuple[list[tuple[float, float, float]], list[int]]:
    """Return a polygon's sides as triangles: vertices [m] around its x and y, and three indices a triangle.

    It has no lids, which nothing in the plane could touch.

    Args:
        polygon: (5 + 2 k,) as in ``polygon_table``.
        half_height_m: how far it reaches to either side of the plane [m].
    """
    corners = list(dict.fromkeys(map(tuple, polygon[5:].reshape(-1, 2).tolist())))
    count = len(corners)
    vertices = [(x, y, z) for z in (-half_height_m, half_height_m) for x, y in corners]
    sides = [(k, (k + 1) % count) for k in range(count)]
    return vertices, [i for a, b in sides for i in (a, b, count + b, a, count + b, count + a)]
