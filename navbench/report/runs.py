"""What a report says of runs and sweeps that no study describes: the comparison, failures and trajectories."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from navbench.analysis.stored import StoredResults
from navbench.experiments.store import Results

if TYPE_CHECKING:
    import pandas as pd

SCENE = ("world", "start_jitter_m", "start_heading_jitter_rad")  # what cells share that met the same starts
ENGINE = "simulator._target_"  # of a cell's simulator, whose numbers are compared with its own alone


class Joined(Results):
    """Results directories read as one, each cell called by what tells it from the others of its controller.

    A cell's ``name`` is its world, with what differs between cells in worlds of this name; its ``label`` is its
    controller, with what else differs between cells of this controller in worlds of this ``name``.

    Args:
        runs: the directories, at least one.
    """

    def __init__(self, runs: Sequence[Results]) -> None:
        super().__init__(runs[0].path)
        self._runs = runs
        self._where: dict[str, Results] = {}  # where a cell that stands in several directories is read
        for run in runs:
            for cell in run.manifest()["cells"]:
                self._where.setdefault(cell["run_id"], run)

    def manifest(self) -> dict[str, Any]:
        """Return the first directory's manifest with the cells and tunings of all."""
        manifests = [run.manifest() for run in self._runs]
        cells = [
            cell
            for run, manifest in zip(self._runs, manifests, strict=True)
            for cell in manifest["cells"]
            if self._where[cell["run_id"]] is run
        ]
        scenes, rest = zip(*map(_halves, cells), strict=True)
        worlds, controllers = ([cell[group] for cell in cells] for group in ("world", "controller"))
        names = _told_apart(worlds, scenes, worlds)
        labels = _told_apart(controllers, rest, list(zip(controllers, names, strict=True)))
        for cell, name, label in zip(cells, names, labels, strict=True):
            cell |= {"name": name, "label": label if cell["label"] == cell["controller"] else cell["label"]}
        return {
            **manifests[0],
            "cells": cells,
            "metrics": [one for manifest in manifests for one in manifest.get("metrics", [])],
            "tunings": [one for manifest in manifests for one in manifest["tunings"]],
        }

    def episodes(self) -> "pd.DataFrame":
        """Return the table of episodes."""
        import pandas as pd

        parts = [(run, run.episodes()) for run in self._runs]
        mine = [rows[[self._where[run_id] is run for run_id in rows["run_id"]]] for run, rows in parts]
        return pd.concat(mine, ignore_index=True)

    def trajectories(self, run_id: str = "") -> "pd.DataFrame":
        """Return the trajectories of one cell."""
        return (self._where[run_id] if run_id else self._runs[0]).trajectories(run_id)

    def layouts(self) -> dict[str, str]:
        """Return the layouts that were driven: each one's JSON by its id."""
        return {name: layout for run in self._runs for name, layout in run.layouts().items()}

    def evaluations(self) -> "pd.DataFrame":
        """Return the table of evaluations."""
        return self._of_tunings(Results.evaluations)

    def checks(self) -> "pd.DataFrame":
        """Return the table of what the best of each tuning cost when it was run again."""
        return self._of_tunings(Results.checks)

    def _of_tunings(self, table: Callable[[Results], "pd.DataFrame"]) -> "pd.DataFrame":
        import pandas as pd

        return pd.concat([table(run) for run in self._runs if run.manifest()["tunings"]], ignore_index=True)


def sections_of(stored: StoredResults) -> list[dict[str, Any]]:
    """Return the outline of the report of runs: what there is to say of them."""
    scenes: dict[str, set[str]] = {}
    for cell in stored.manifest["cells"]:
        scenes.setdefault(cell["name"], set()).add(cell["label"])
    outline: list[dict[str, Any]] = [{"name": "summary"}]
    several = {scene: {"name": scene} for scene, labels in scenes.items() if len(labels) > 1}
    if several:
        outline.append({"name": "comparison", "worlds": several})
    if stored.manifest["tunings"]:
        outline.append({"name": "tuners_compared", "title": "Tunings"})
    return [*outline, *({"name": name} for name in ("failures", "trajectories", "metrics"))]


def _halves(cell: Mapping[str, Any]) -> tuple[dict[str, str], dict[str, str]]:
    """Return the leaves of a cell's configuration: those of the scene, its simulator among them, and the rest."""
    leaves = {key: value for key, value in _leaves(cell["configuration"]) if key != ENGINE}
    scene = {key: value for key, value in leaves.items() if key.split(".")[0] in SCENE}
    rest = {key: value for key, value in leaves.items() if key not in scene}
    return {**scene, "simulator": cell["simulator"]}, rest


def _told_apart(names: Sequence[str], leaves: Sequence[Mapping[str, str]], kinds: Sequence[Hashable]) -> list[str]:
    """Return each name with those of its values in which things of its kind differ."""
    told = []
    for name, mine, kind in zip(names, leaves, kinds, strict=True):
        alike = [other for other, of in zip(leaves, kinds, strict=True) if of == kind]
        differ = [key for key in dict.fromkeys(k for one in alike for k in one) if len({o.get(key) for o in alike}) > 1]
        values = ", ".join(f"{key.rpartition('.')[2]}={mine[key]}" for key in differ if key in mine)
        told.append(f"{name} ({values})" if values else name)
    return told


def _leaves(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Yield a configuration's dotted keys with their values as words."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _leaves(inner, f"{key}.{name}" if key else str(name))
    else:
        yield key, str(value)
