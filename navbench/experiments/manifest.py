"""What the manifest of a results directory says of the work that it holds."""

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

from navbench.experiments.schema import SCHEMA_VERSION
from navbench.metrics import Metric
from navbench.records import CellKey, Names, TuningKey

PACKAGES = ("navbench", "numba", "numpy", "pandas", "pyarrow", "hydra-core", "scipy")


def manifest_of(
    cells: Sequence[CellKey],
    tunings: Sequence[TuningKey],
    study: Mapping[str, Any] | None,
    planned: Mapping[str, int] | None,
    codes: Mapping[str, Mapping[str, str]],
    commit: str | None,
) -> dict[str, Any]:
    """Return the manifest of what is about to run; arguments as ``Results.begin``."""
    return {
        "schema_version": SCHEMA_VERSION,
        "study": study,
        "planned": planned or {"episodes": sum(cell.episodes for cell in cells)},
        "cells": [described(cell) for cell in cells],
        "tunings": [{**key._asdict(), "worlds": list(key.worlds)} for key in tunings],
        "versions": {name: version(name) for name in sorted({*PACKAGES, *(p for c in cells for p in c.packages)})},
        "metrics": [_plain(metric) for metric in dict.fromkeys(m for cell in cells for m in cell.metrics)],
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "commit": commit,
        "code": {name: found for modules in codes.values() for name, found in modules.items()},
        "codes": dict(codes),
        "checksums": True,
        "resumed": [],
        "began": now(),
        "ended": None,
    }


def now() -> str:
    """Return the time as a manifest holds it."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def is_other_work(old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    """Return whether a directory's manifest is of another study, or tuning, than a new one."""
    names = [(manifest["study"] or {}).get("name", "") for manifest in (old, new)]
    return bool(names[0] != names[1])


def described(cell: CellKey) -> dict[str, Any]:
    """Return what a manifest says of a cell."""
    values = cell._asdict()
    names: Names = values.pop("names")
    for name in ("packages", "metrics"):  # they stand once for all cells
        values.pop(name)
    return {**values, **names._asdict(), "configuration": dict(cell.configuration), "sources": dict(cell.sources)}


def _plain(metric: Metric) -> dict[str, Any]:
    """Return what a metric is as plain values."""
    return {name: value for name, value in asdict(metric).items() if name != "lost"}
