"""Layouts and trajectories in few bytes, for a page's script: rounded, deflated and in base 64.

States are whole numbers of a quantum, and stored are the differences between one and the next. What is missing of a
trace is 0 there, where its values begin with 1.
"""

import base64
import json
import zlib
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.experiments.rows import RANGES, TRAJECTORY
from navbench.world.layout import DrawnWorld

if TYPE_CHECKING:
    import pandas as pd

QUANTA = {"t_s": 1e-4, "x_m": 1e-3, "y_m": 1e-3, "heading_rad": 1e-3, "v_mps": 1e-3, "w_radps": 1e-3}
TRACES = 32  # columns at most
RANGE_M = 1e-3  # the quantum of what a range sensor read
LEVELS = 4000  # of a trace's values that are not whole numbers


def packed_layouts(worlds: Mapping[Any, DrawnWorld]) -> tuple[str, dict[Any, int]]:
    """Return the distinct layouts, packed, and which one each key has."""
    numbers: dict[str, int] = {}
    places = {}
    for key, world in worlds.items():
        text = json.dumps(_layout(world), separators=(",", ":"), allow_nan=False)
        places[key] = numbers.setdefault(text, len(numbers))
    return _packed(f"[{','.join(numbers)}]".encode()), places


def _layout(world: DrawnWorld) -> dict[str, Any]:
    """Return what is drawn of a layout, and what rays are cast at; boxes are (x, y, half sides, cos, sin)."""
    b, grid, line = world.bounds, world.grid, world.finish_line
    movers = [
        {
            "radius": mover.radius_m,
            "points": rounded([p.x_m, p.y_m] for p in mover.waypoints),
            "speeds": mover.speeds_mps,
            "cyclic": mover.cyclic,
            "phase": mover.phase_s,
            "outline": rounded([p.x_m, p.y_m] for p in mover.outline),
        }
        for mover in world.movers
    ]
    return {
        "bounds": [b.x_min_m, b.x_max_m, b.y_min_m, b.y_max_m],
        "boxes": rounded(world.box_rows().tolist()),
        "discs": rounded([d.x_m, d.y_m, d.radius_m] for d in world.discs),
        "polygons": [rounded([p.x_m, p.y_m] for p in polygon.corners) for polygon in world.polygons],
        "movers": movers,
        "goals": rounded([goal.x_m, goal.y_m] for goal in world.goals),
        "line": [] if line is None else [line.x1_m, line.y1_m, line.x2_m, line.y2_m],
        "grid": grid and [grid.x_min_m, grid.y_min_m, grid.resolution_m, grid.width, grid.height, grid.cells],
    }


def rounded(rows: Iterable[Sequence[float]]) -> list[list[float]]:
    """Return rows of lengths [m] or angles [rad] to a tenth of a thousandth."""
    return [[round(value, 4) for value in row] for row in rows]


def packed_states(
    paths: "Mapping[Any, Mapping[int, pd.DataFrame]]", stride: int
) -> tuple[str, dict[Any, dict[int, dict[str, Any]]]]:
    """Return trajectories, packed, and for each how to read it.

    Args:
        paths: of each key, each robot's trajectory.
        stride: one state in so many is kept, and the last one.

    Returns:
        The text, in which for each robot the columns of ``QUANTA``, of its trace, and of its range sensors follow each
        other; and for each robot ``n``, how many states it has, ``traces``: each column's name, lowest value and
        quantum, and where that is kept ``sensors``: how many there are.
    """
    columns: list[NDArray[np.int32]] = [np.zeros(0, np.int32)]
    told: dict[Any, dict[int, dict[str, Any]]] = {}
    for key, of in paths.items():
        told[key] = {}
        for robot, path in of.items():
            kept = path.iloc[np.unique([*range(0, len(path), stride), len(path) - 1])]
            columns += [_differences(kept[name].to_numpy() / quantum) for name, quantum in QUANTA.items()]
            traces = []
            for name in [name for name in kept.columns if name not in TRAJECTORY][:TRACES]:
                values = kept[name].to_numpy(dtype=float)
                there = values[np.isfinite(values)]
                if len(there):
                    low, quantum = float(there.min()), _quantum(there)
                    numbers = np.where(np.isfinite(values), 1.0 + (values - low) / quantum, 0.0)
                    columns.append(_differences(numbers))
                    traces.append([name, low, quantum])
            told[key][robot] = {"n": len(kept), "traces": traces}
            if readings := [row for row in kept.get(RANGES, ()) if row is not None]:
                told[key][robot]["sensors"] = len(readings[0])
                missing = np.zeros((len(kept) - len(readings), len(readings[0])))
                columns += map(_differences, np.concatenate([1.0 + np.array(readings) / RANGE_M, missing]).T)
    planes = np.concatenate(columns).astype("<i4").view(np.uint8).reshape(-1, 4).T  # bytes of one weight side by side
    return _packed(planes.tobytes()), told


def _quantum(values: NDArray[np.float64]) -> float:
    """Return the quantum of a trace's values: 1 of whole numbers, so that these stay what they are."""
    spread = float(np.ptp(values))
    whole = spread < LEVELS and bool((values == np.round(values)).all())
    return 1.0 if whole or spread == 0.0 else spread / LEVELS


def _differences(values: NDArray[np.float64]) -> NDArray[np.int32]:
    """Return (n,) the differences of the nearest whole numbers, the first from 0; both they and their sums wrap."""
    return np.diff(np.round(values).astype(np.int64), prepend=0).astype(np.int32)


def _packed(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data)).decode()
