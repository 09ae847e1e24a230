"""Rays alone, by kind of obstacle."""

import math
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.field import RAYS, Field
from benchmarks.harness import Effort, Side, Sides, Table, compare
from navbench.compiled import compiled_for_vectors
from navbench.contract import FloatArray
from navbench.simulation.base import Simulator
from navbench.world.grid import Grid, ray_to_cell

AMONG = {"10 discs": 10, "100 discs": 100}
CELLS, CELL_M = 1600, 0.05
BEAMS, POSES, ARRIVED_M = 1080, 100, 1e-4
TEXT = f"""The rings of 50 robots, 16 rays each, called once for all.
And lidars of {BEAMS} beams over 270 degrees, rays alone, at {POSES} random places of a grid of {CELLS} x {CELLS} cells
of {CELL_M} m: a building of rooms along corridors, and a yard of 150 blocks; of such a range.
Marching on a distance transform is what f1tenth_gym does: it ends in a cell, not at its edge."""

BoolArray = NDArray[np.bool_]


def cast_all(simulator: Simulator) -> Side:
    """Return a function that reads every robot's ring once, and returns how many rays that were."""
    return lambda: len(simulator.ranges()) * RAYS


def among(discs: int, on: ExitStack) -> Sides:
    """Return both simulators with the robots at their starts."""
    sides = {}
    for name in ("pybullet", "planar"):
        runner = Field(50, discs).runner(name, steps=1, on=on)
        runner.run(0)
        sides[name] = cast_all(runner.simulator)
    return sides


def building() -> BoolArray:
    """Return rooms of 6 x 4 m with walls of 0.15 m, a door and a piece of furniture, on both sides of corridors."""
    rng, occupied = np.random.default_rng(0), np.zeros((CELLS, CELLS), np.bool_)
    for low in range(0, CELLS, 200):
        for rooms, wall in ((low, low + 80), (low + 120, low + 120)):
            occupied[low : low + 3], occupied[wall : wall + 3] = True, True
            for left in range(0, CELLS, 120):
                occupied[rooms : rooms + 80, left : left + 3] = True
                door, (up, along), (height, width) = (
                    rng.integers(10, 90),
                    rng.integers(10, 50, 2),
                    rng.integers(4, 25, 2),
                )
                occupied[wall : wall + 3, left + door : left + door + 18] = False
                occupied[rooms + up : rooms + up + height, left + along : left + along + width] = True
    return occupied


def yard() -> BoolArray:
    """Return blocks of up to 2.5 m in a walled square."""
    rng, occupied = np.random.default_rng(0), np.ones((CELLS, CELLS), np.bool_)
    occupied[1:-1, 1:-1] = False
    for _ in range(150):
        (row, column), (height, width) = rng.integers(0, CELLS - 50, 2), rng.integers(3, 50, 2)
        occupied[row : row + height, column : column + width] = True
    return occupied


@compiled_for_vectors
def march(ax: float, ay: float, ux: float, uy: float, far_m: float, away_m: FloatArray, place: FloatArray) -> float:
    """Return how far it is to an occupied cell [m], stepping as far as the nearest one is from each cell's centre."""
    t = 0.0
    while t <= far_m:
        x, y = (ax + t * ux - place[0]) / place[2], (ay + t * uy - place[1]) / place[2]
        if not (0.0 <= x < away_m.shape[1] and 0.0 <= y < away_m.shape[0]):
            break
        away = away_m[int(y), int(x)]
        if away <= ARRIVED_M:
            return t
        t += away
    return math.inf


def scans(cast: Callable[..., float], occupied: BoolArray, far_m: float, table: NDArray[np.generic]) -> Side:
    """Return a function that casts every beam of every lidar, and returns how many these were."""
    rng = np.random.default_rng(1)
    rows, columns = (rng.permutation(np.argwhere(~occupied))[:POSES].T + rng.random((2, POSES))) * CELL_M
    turns = rng.uniform(0.0, math.tau, (POSES, 1)) + np.linspace(-0.75 * math.pi, 0.75 * math.pi, BEAMS)
    cosines, sines, free_m = np.cos(turns), np.sin(turns), np.empty((POSES, BEAMS))
    place = np.array([0.0, 0.0, CELL_M])

    @compiled_for_vectors
    def all_beams(
        x: FloatArray, y: FloatArray, ux: FloatArray, uy: FloatArray, table: NDArray[np.generic], free_m: FloatArray
    ) -> None:
        for i in range(ux.shape[0]):
            for k in range(ux.shape[1]):
                free_m[i, k] = cast(x[i], y[i], ux[i, k], uy[i, k], far_m, table, place)

    def run() -> int:
        all_beams(columns, rows, cosines, sines, table, free_m)
        return POSES * BEAMS

    return run


def over(make: Callable[[], BoolArray], far_m: float, on: ExitStack) -> Sides:
    """Return lidars on a grid by both methods."""
    from scipy.ndimage import distance_transform_edt

    occupied = make()
    return {
        "marching": scans(march, occupied, far_m, CELL_M * distance_transform_edt(~occupied)),
        "planar": scans(ray_to_cell, occupied, far_m, Grid.of(occupied, CELL_M).arrays()[0]),
    }


def rays(effort: Effort) -> Table:
    """Measure rays."""
    groups: dict[str, Callable[[ExitStack], Sides]] = {
        name: partial(among, count) for name, count in [*AMONG.items()][: effort.few(len(AMONG))]
    }
    grids = (building, 10.0), (building, 100.0), (yard, 10.0), (yard, 100.0)
    for make, far_m in grids[:: 3 if effort.is_quick else 1]:
        groups[f"{make.__name__}, {far_m:g} m"] = partial(over, make, far_m)
    return compare("Rays", TEXT.replace("\n", " "), "rays", groups, effort)
