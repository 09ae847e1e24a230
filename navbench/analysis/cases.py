"""Independent cases: runs of one start whose tuned parameters hardly differ are one, not several."""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

SAME = 0.01  # of what was searched: parameters that lie nearer to each other than this make no other case


def cases_of(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return for each run the first run of the same case.

    Of one case are runs that differ in tuned parameters alone, each by at most 1 % of the range that was searched.

    Args:
        manifest: of the results.

    Returns:
        By run_id the run_id of the case's first run.
    """
    tunable: dict[str, Any] = {}
    for tuning in manifest["tunings"]:
        tunable |= tuning["configuration"].get("tunable", {})
    found: dict[str, str] = {}
    firsts: dict[str, list[tuple[str, list[float]]]] = {}
    for cell in manifest["cells"]:
        rest, values = _parted(cell, tunable)
        same = firsts.setdefault(rest, [])
        case = next((run_id for run_id, others in same if _near(values, others)), None)
        if case is None:
            same.append((cell["run_id"], values))
        found.setdefault(cell["run_id"], case or cell["run_id"])
    return found


def _parted(cell: Mapping[str, Any], tunable: Mapping[str, Any]) -> tuple[str, list[float]]:
    """Return everything that decides a cell's episodes but its tuned numbers, and these as shares of their range."""
    rest, values = [cell[key] for key in ("controller", "world", "seed")], []
    for place, value in _leaves("", cell["configuration"]):
        name = place.removeprefix(".controller.build.")
        bounds: Mapping[str, Any] = next(
            (of for key, of in tunable.items() if name == key or name.startswith(f"{key}.")), {}
        )
        if "low" not in bounds or isinstance(value, bool) or not isinstance(value, int | float):
            rest.append((place, value))
            continue
        of_log = math.log if bounds.get("scale") == "log" else float
        low, high = of_log(bounds["low"]), of_log(bounds["high"])
        values.append((of_log(value) - low) / (high - low))
    return repr(rest), values


def _leaves(place: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _leaves(f"{place}.{key}", inner)
    else:
        yield place, value


def _near(values: Iterable[float], others: Iterable[float]) -> bool:
    return all(abs(value - other) <= SAME for value, other in zip(values, others, strict=True))


def was_driven(trajectory: "pd.DataFrame", time_limit_s: float) -> bool:
    """Return whether a trajectory has finite poses at rising times within twice the time limit [s]."""
    poses = trajectory[["t_s", "x_m", "y_m", "heading_rad"]].to_numpy(dtype=float)
    later_s = np.diff(poses[:, 0], prepend=0.0, append=2.0 * time_limit_s)
    return bool(np.isfinite(poses).all() and (later_s >= 0.0).all())
