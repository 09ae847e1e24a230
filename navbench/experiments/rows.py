"""What is kept of a batch as tables: how each robot's episode ended, its trajectory, and its latencies."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.records import CellKey, FloatArray, RobotRecord

if TYPE_CHECKING:
    import pyarrow as pa

STATES = ("t_s", "x_m", "y_m", "heading_rad", "v_mps", "w_radps")
RANGES = "ranges_m"  # the column that holds a list in each row
TRAJECTORY = ("run_id", "episode", "robot_index", *STATES, RANGES)  # the other columns are a trace


def episode_table(cell: CellKey, records: Sequence[tuple[int, RobotRecord]], layouts: Mapping[int, str]) -> "pa.Table":
    """Return how the episodes of (episode, record) pairs ended, and in which layouts: a row a robot and episode."""
    import pyarrow as pa

    return pa.Table.from_pylist(episode_rows(cell, records, layouts))


def episode_rows(
    cell: CellKey, records: Sequence[tuple[int, RobotRecord]], layouts: Mapping[int, str]
) -> list[dict[str, Any]]:
    """Return the rows of ``episode_table``."""
    return [
        {
            "run_id": cell.run_id,
            **cell.names._asdict(),
            "config_hash": cell.config_hash,
            "seed": cell.seed,
            "episode": episode,
            "robot_index": record.robot_index,
            "outcome": record.outcome,
            "reason": record.reason,
            "traceback": record.traceback,
            "hit": "" if record.hit is None else record.hit.kind,
            "hit_index": -1 if record.hit is None else record.hit.index,
            **record.metrics,
            "layout_id": layouts.get(episode, ""),
        }
        for episode, record in records
    ]


def trajectory_table(cell: CellKey, records: Sequence[tuple[int, RobotRecord]]) -> "pa.Table":
    """Return the trajectories of (episode, record) pairs: a row for each state, with the trace beside it."""
    import pyarrow as pa

    columns = trajectory_columns(records)
    run_id = pa.array([cell.run_id] * len(columns["episode"]), pa.string())
    return pa.table({"run_id": run_id, **columns})


def trajectory_columns(records: Sequence[tuple[int, RobotRecord]]) -> dict[str, NDArray[Any]]:
    """Return the columns of ``trajectory_table`` but the first."""
    lengths = [len(record.states) for _, record in records]
    columns: dict[str, NDArray[Any]] = {
        "episode": np.repeat([episode for episode, _ in records], lengths),
        "robot_index": np.repeat([record.robot_index for _, record in records], lengths),
    }
    states = np.concatenate([record.states for _, record in records])
    columns |= {name: states[:, i] for i, name in enumerate(STATES)}
    if any(record.ranges_m.size for _, record in records):
        columns[RANGES] = np.empty(sum(lengths), object)
        columns[RANGES][:] = [row for _, record in records for row in _ranges(record)]
    for name in dict.fromkeys(name for _, record in records for name in record.trace_names):
        column = f"trace_{name}" if name in TRAJECTORY else str(name)  # a trace never hides what is not of it
        columns[column] = np.concatenate([_trace(record, name) for _, record in records])
    return columns


def _trace(record: RobotRecord, name: str) -> Any:
    if name in record.trace_names:
        return record.traces[:, record.trace_names.index(name)]
    return np.full(len(record.states), np.nan)


def _ranges(record: RobotRecord) -> list[FloatArray | None]:
    """Return what the range sensors read at each state, nothing at the end."""
    return [*record.ranges_m, *[None] * (len(record.states) - len(record.ranges_m))]


def latency_table(cell: CellKey, records: Sequence[tuple[int, RobotRecord]]) -> "pa.Table":
    """Return how long the controllers of (episode, record) pairs took: a row a robot and episode."""
    import pyarrow as pa

    rows = []
    for episode, record in records:
        times = record.latencies_s if len(record.latencies_s) else np.array([np.nan])
        rows.append(
            {
                "run_id": cell.run_id,
                "episode": episode,
                "robot_index": record.robot_index,
                "acts": len(record.latencies_s),
                "act_median_s": float(np.median(times)),
                "act_p99_s": float(np.quantile(times, 0.99)),
                "act_max_s": float(times.max()),
            }
        )
    return pa.Table.from_pylist(rows)
