"""The results store: the only file that writes or reads results.

A part is written under a temporary name and renamed, and its name depends only on the work: a killed run loses nothing
that was finished, and the same work writes the same bytes.
"""

import json
import os
import platform
import shutil
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from navbench.description import DescriptionError
from navbench.record import CellKey, RobotRecord

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

SCHEMA_VERSION = 1
PACKAGES = ("navbench", "numba", "numpy", "pandas", "pyarrow", "pybullet", "hydra-core", "scipy")
STATES = ("t_s", "x_m", "y_m", "heading_rad", "v_mps", "w_radps")


class ResultsError(DescriptionError):
    """A results directory that cannot be read or must not be written to."""


class Results:
    """One results directory.

    Args:
        path: the directory; it need not exist yet.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def begin(self, cells: Sequence[CellKey]) -> None:
        """Make the directory and write the manifest of what is about to run.

        Raises:
            ResultsError: the directory holds results of other work.
        """
        manifest = {
            "schema_version": SCHEMA_VERSION,
            "cells": [_described(cell) for cell in cells],
            "versions": {name: version(name) for name in PACKAGES},
            "python": platform.python_version(),
            "platform": f"{platform.system()} {platform.machine()}",
            "began": _now(),
            "ended": None,
        }
        if (self.path / "manifest.json").exists():
            if self.manifest()["cells"] != manifest["cells"]:
                raise ResultsError(f"{self.path}: holds the results of other work; choose another directory")
        elif self.path.is_dir() and any(self.path.glob("*/part-*.parquet")):
            raise ResultsError(f"{self.path}: holds parts without a manifest; choose another directory")
        self._write_json("manifest.json", manifest)

    def end(self) -> None:
        """Write ``episodes.csv`` for people, and into the manifest when the work ended."""
        self._write("episodes.csv", self.episodes().to_csv(index=False).encode())
        self._write_json("manifest.json", {**self.manifest(), "ended": _now()})

    def write_batch(self, cell: CellKey, first: int, records: Iterable[tuple[int, RobotRecord]]) -> None:
        """Write a batch's episodes, trajectories and latencies, each as one part.

        Args:
            cell: the cell that they belong to.
            first: the batch's first episode.
            records: (episode, record) pairs, in any order.
        """
        ordered = sorted(records, key=lambda pair: (pair[0], pair[1].robot_index))
        name = f"part-{cell.run_id}-{first:06d}.parquet"
        self._write_table(f"latency/{name}", _latency_table(cell, ordered))
        self._write_table(f"trajectories/{name}", _trajectory_table(cell, ordered))
        self._write_table(f"episodes/{name}", _episode_table(cell, ordered))

    def manifest(self) -> dict[str, Any]:
        """Return the manifest.

        Raises:
            ResultsError: there is none, or it is of another version of the format.
        """
        file = self.path / "manifest.json"
        if not file.is_file():
            raise ResultsError(f"{self.path}: no results here: manifest.json is missing")
        manifest: dict[str, Any] = json.loads(file.read_text())
        if manifest["schema_version"] != SCHEMA_VERSION:
            raise ResultsError(
                f"{file}: schema_version={manifest['schema_version']}, but this navbench reads {SCHEMA_VERSION}"
            )
        return manifest

    def episodes(self) -> "pd.DataFrame":
        """Return the table of episodes: one row a robot and episode, sorted by run, episode and robot."""
        return self._read("episodes", ["run_id", "episode", "robot_index"])

    def trajectories(self) -> "pd.DataFrame":
        """Return the table of trajectories, sorted by run, episode, robot and time."""
        return self._read("trajectories", ["run_id", "episode", "robot_index", "t_s"])

    def latency(self) -> "pd.DataFrame":
        """Return how long the controllers took: one row a robot and episode."""
        return self._read("latency", ["run_id", "episode", "robot_index"])

    def _read(self, kind: str, order: list[str]) -> "pd.DataFrame":
        import pandas as pd

        parts = sorted((self.path / kind).glob("part-*.parquet"))
        if not parts:
            raise ResultsError(f"{self.path}: no results here: {kind}/ holds no part")
        table = pd.concat([pd.read_parquet(part) for part in parts], ignore_index=True)
        return table.sort_values(order, kind="stable", ignore_index=True)

    def _write_table(self, name: str, table: "pa.Table") -> None:
        import pyarrow.parquet as pq

        with _Replacing(self.path / name) as temporary:
            pq.write_table(table, temporary, compression="zstd")

    def _write_json(self, name: str, value: Mapping[str, Any]) -> None:
        self._write(name, (json.dumps(value, indent=2) + "\n").encode())

    def _write(self, name: str, content: bytes) -> None:
        with _Replacing(self.path / name) as temporary:
            temporary.write_bytes(content)


class _Replacing:
    """Gives a temporary file beside the wanted one, and renames it when all went well."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._temporary = file.with_name(f".{file.name}.{os.getpid()}.tmp")

    def __enter__(self) -> Path:
        self._file.parent.mkdir(parents=True, exist_ok=True)
        return self._temporary

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            os.replace(self._temporary, self._file)
        else:
            self._temporary.unlink(missing_ok=True)


def discard_empty(path: Path) -> None:
    """Remove a directory that holds nothing, and those above it that then hold nothing, up to the working directory."""
    here = Path.cwd().resolve()
    path = path.resolve()
    while path != here and here in path.parents and path.is_dir() and not any(path.iterdir()):
        path.rmdir()
        path = path.parent


def discard(path: Path) -> None:
    """Remove a results directory and everything in it."""
    shutil.rmtree(path, ignore_errors=True)
    discard_empty(path.parent)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _described(cell: CellKey) -> dict[str, Any]:
    return {
        "run_id": cell.run_id,
        "config_hash": cell.config_hash,
        **cell.names._asdict(),
        "episodes": cell.episodes,
        "seed": cell.seed,
        "configuration": dict(cell.configuration),
        "sources": dict(cell.sources),
    }


def _episode_table(cell: CellKey, records: Sequence[tuple[int, RobotRecord]]) -> "pa.Table":
    import pyarrow as pa

    rows = [
        {
            "run_id": cell.run_id,
            **cell.names._asdict(),
            "config_hash": cell.config_hash,
            "seed": cell.seed,
            "episode": episode,
            "robot_index": record.robot_index,
            "outcome": record.outcome,
            "reason": record.reason,
            **record.metrics._asdict(),
        }
        for episode, record in records
    ]
    return pa.Table.from_pylist(rows)


def _trajectory_table(cell: CellKey, records: Sequence[tuple[int, RobotRecord]]) -> "pa.Table":
    import pyarrow as pa

    lengths = [len(record.states) for _, record in records]
    columns: dict[str, Any] = {
        "run_id": pa.array([cell.run_id] * sum(lengths)),
        "episode": np.repeat([episode for episode, _ in records], lengths),
        "robot_index": np.repeat([record.robot_index for _, record in records], lengths),
    }
    states = np.concatenate([record.states for _, record in records])
    columns |= {name: states[:, i] for i, name in enumerate(STATES)}
    for name in dict.fromkeys(name for _, record in records for name in record.trace_names):
        columns[name] = np.concatenate([_trace(record, name) for _, record in records])
    return pa.table(columns)


def _trace(record: RobotRecord, name: str) -> Any:
    if name in record.trace_names:
        return record.traces[:, record.trace_names.index(name)]
    return np.full(len(record.states), np.nan)


def _latency_table(cell: CellKey, records: Sequence[tuple[int, RobotRecord]]) -> "pa.Table":
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


def write_table(file: Path, text: str) -> None:
    """Write a table beside results, whole or not at all."""
    with _Replacing(file) as temporary:
        temporary.write_text(text)
