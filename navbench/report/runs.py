"""What a report says of runs and sweeps that no study describes: the comparison, failures and trajectories."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from navbench.analysis.stored import StoredResults, leaves_of
from navbench.experiments.store import Results

if TYPE_CHECKING:
    import pandas as pd

SCENE = ("world", "start_jitter_m", "start_heading_jitter_rad")  # what cells share that met the same starts
ENGINE = "simulator._target_"  # of a cell's simulator, whose numbers are compared with its own alone


class Joined(Results):
    """Results directories read as one, each cell called by what tells it from the others of its controller.

    A cell's ``name`` is its world, with what differs between cells in worlds of this name; its ``label`` is its
    controller, with what else differs between cells of this controller in worlds of this ``name``. A tuning's name is
    its own, with what differs between tunings of this name beside their seeds.

    Args:
        runs: the directories, at least one.
    """

    def __init__(self, runs: Sequence[Results]) -> None:
        super().__init__(runs[0].path)
        self._runs = runs
        self._where: dict[str, Results] = {}  # where a cell or a tuning that stands in several directories is read
        manifests = [run.manifest() for run in runs]
        for run, manifest in zip(runs, manifests, strict=True):
            for key in (*(c["run_id"] for c in manifest["cells"]), *(t["tuning_id"] for t in manifest["tunings"])):
                self._where.setdefault(key, run)
        self._tunings = _names_of(manifests)  # what each is called

    def manifest(self) -> dict[str, Any]:
        """Return the first directory's manifest with the cells and tunings of all."""
        manifests = [run.manifest() for run in self._runs]
        cells: list[dict[str, Any]] = []
        tunings: list[dict[str, Any]] = []
        for run, manifest in zip(self._runs, manifests, strict=True):
            called = {(t["name"], t["seed"]): self._tunings[t["tuning_id"]] for t in manifest["tunings"]}
            for cell in manifest["cells"]:
                tuning = called.get((cell["tuning"], cell["tuning_seed"]), "")
                cell |= {"tuning": tuning, "label": tuning if cell["label"] == cell["tuning"] else cell["label"]}
            cells += [cell for cell in manifest["cells"] if self._where[cell["run_id"]] is run]
            mine = [tuning for tuning in manifest["tunings"] if self._where[tuning["tuning_id"]] is run]
            tunings += [{**tuning, "name": self._tunings[tuning["tuning_id"]]} for tuning in mine]
        scenes, rest = zip(*map(_halves, cells), strict=True)
        worlds, controllers = ([cell[group] for cell in cells] for group in ("world", "controller"))
        names = _told_apart(worlds, scenes, worlds)
        labels = _told_apart(controllers, rest, list(zip(controllers, names, strict=True)))
        for cell, name, label in zip(cells, names, labels, strict=True):
            cell |= {"name": name, "label": label if cell["label"] == cell["controller"] else cell["label"]}
        return {
            **manifests[0],
            "planned": {"episodes": len({planned for cell in cells for planned in _planned(cell)})},
            "cells": cells,
            "metrics": [one for manifest in manifests for one in manifest.get("metrics", [])],
            "tunings": tunings,
        }

    def episodes(self) -> "pd.DataFrame":
        """Return the table of episodes."""
        import pandas as pd

        parts = [(run, run.episodes()) for run in self._runs]
        mine = [rows[[self._where[run_id] is run for run_id in rows["run_id"]]] for run, rows in parts]
        return pd.concat(mine, ignore_index=True)

    def trajectories(self, run_id: str = "", columns: Sequence[str] = ()) -> "pd.DataFrame":
        """Return the trajectories of one cell."""
        return (self._where[run_id] if run_id else self._runs[0]).trajectories(run_id, columns)

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

        parts = [(run, table(run)) for run in self._runs if run.manifest()["tunings"]]
        mine = [rows[[self._where[tuning] is run for tuning in rows["tuning_id"]]] for run, rows in parts]
        every = pd.concat(mine, ignore_index=True)
        return every.assign(name=every["tuning_id"].map(self._tunings))


def sections_of(stored: StoredResults) -> list[dict[str, Any]]:
    """Return the outline of the report of runs: what there is to say of them."""
    outline: list[dict[str, Any]] = [{"name": "summary"}]
    labels = stored.episodes.groupby("name", sort=False)["label"].nunique()
    several = {scene: {"name": scene} for scene in dict.fromkeys(stored.cells["name"]) if labels.get(scene, 0) > 1}
    if several:
        outline.append({"name": "comparison", "worlds": several})
    if stored.manifest["tunings"]:
        outline.append({"name": "tuners_compared", "title": "Tunings"})
    shown = ("failures", *([] if stored.episodes.empty else ["trajectories"]), "metrics")
    return [*outline, *({"name": name} for name in shown)]


def _halves(cell: Mapping[str, Any]) -> tuple[dict[str, str], dict[str, str]]:
    """Return the leaves of a cell's configuration: those of the scene, its simulator among them, and the rest."""
    values = {key: value for key, value in leaves_of(cell["configuration"]) if key != ENGINE}
    scene = {key: value for key, value in values.items() if key.split(".")[0] in SCENE}
    rest = {key: value for key, value in values.items() if key not in scene}
    return {**scene, "simulator": cell["simulator"]}, rest


def _planned(cell: Mapping[str, Any]) -> Iterator[tuple[Any, ...]]:
    """Yield what tells each of a cell's planned episodes from all others, as a plan counts them."""
    for index in range(cell["first_episode"], cell["first_episode"] + cell["episodes"]):
        yield cell["run_id"], cell["tuning"], cell["tuning_seed"], index


def _names_of(manifests: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return what each tuning is called, by its id: its name, with what differs between tunings of this name."""
    found = {tuning["tuning_id"]: (tuning, m["cells"]) for m in manifests for tuning in m["tunings"]}
    names = [tuning["name"] for tuning, _ in found.values()]
    for values in (_asked, _values, lambda tuning, _: {"config_hash": tuning["config_hash"]}):
        names = _told_apart(names, [values(*one) for one in found.values()], names)
    return dict(zip(found, names, strict=True))


def _asked(tuning: Mapping[str, Any], cells: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return what a tuning was asked to do, but its seed."""
    own = [tuning["name"], tuning["seed"]]
    episodes = [cell["episodes"] for cell in cells if [cell["tuning"], cell["tuning_seed"]] == own]
    asked = {key: tuning[key] for key in ("tuner", "objective", "controller", "budget")}
    return dict(leaves_of({**asked, "worlds": " ".join(tuning["worlds"]), "episodes": max(episodes, default=0)}))


def _values(tuning: Mapping[str, Any], _: object) -> dict[str, str]:
    """Return the leaves of a tuning's configuration."""
    configuration = tuning["configuration"]
    return dict(leaves_of({**configuration, "cells": dict(enumerate(configuration.get("cells", [])))}))


def _told_apart(names: Sequence[str], values: Sequence[Mapping[str, str]], kinds: Sequence[Hashable]) -> list[str]:
    """Return each name with those of its values in which things of its kind differ."""
    told = []
    for name, mine, kind in zip(names, values, kinds, strict=True):
        differ = differing([other for other, of in zip(values, kinds, strict=True) if of == kind])
        own = ", ".join(f"{key.rpartition('.')[2]}={mine[key]}" for key in differ if key in mine)
        told.append(f"{name} ({own})" if own else name)
    return told


def differing(alike: Sequence[Mapping[str, str]]) -> list[str]:
    """Return the keys in which some configurations' leaves differ."""
    every = dict.fromkeys(key for one in alike for key in one)
    return [key for key in every if len({one.get(key) for one in alike}) > 1]
