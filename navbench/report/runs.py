"""What a report says of runs and sweeps that no study describes: the comparison, failures and trajectories."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from navbench.analysis.stored import Reading
from navbench.experiments.store import Results

SCENE = ("world", "start_jitter_m", "start_heading_jitter_rad")  # what cells share that met the same starts


def reading_of(runs: Sequence[Results]) -> Reading:
    """Return results directories as one, each cell called by what tells it from the others of its controller.

    A cell's ``name`` is its world, with what differs between cells in worlds of this name; its ``label`` is its
    controller, with what else differs between cells of this controller.
    """
    reading = Reading(*runs)
    cells = reading.manifest["cells"]
    scenes, rest = zip(*(_halves(cell["configuration"]) for cell in cells), strict=True)
    names = _told_apart([cell["world"] for cell in cells], scenes)
    labels = _told_apart([cell["controller"] for cell in cells], rest)
    for cell, name, label in zip(cells, names, labels, strict=True):
        cell |= {"name": name, "label": label if cell["label"] == cell["controller"] else cell["label"]}
    return reading


def sections_of(reading: Reading) -> list[dict[str, Any]]:
    """Return the outline of the report of runs: what there is to say of them."""
    scenes: dict[str, set[str]] = {}
    for cell in reading.manifest["cells"]:
        scenes.setdefault(cell["name"], set()).add(cell["label"])
    outline: list[dict[str, Any]] = [{"name": "summary"}]
    several = {scene: {"name": scene} for scene, labels in scenes.items() if len(labels) > 1}
    if several:
        outline.append({"name": "comparison", "worlds": several})
    if reading.manifest["tunings"]:
        outline.append({"name": "tuners_compared", "title": "Tunings"})
    return [*outline, {"name": "failures"}, {"name": "trajectories"}]


def _halves(configuration: Mapping[str, Any]) -> tuple[dict[str, str], dict[str, str]]:
    """Return a configuration's leaves: those of the scene, and the rest."""
    leaves = dict(_leaves(configuration))
    scene = {key: value for key, value in leaves.items() if key.split(".")[0] in SCENE}
    return scene, {key: value for key, value in leaves.items() if key not in scene}


def _told_apart(names: Sequence[str], leaves: Sequence[Mapping[str, str]]) -> list[str]:
    """Return each name with those of its values in which things of this name differ."""
    told = []
    for name, mine in zip(names, leaves, strict=True):
        alike = [other for other, called in zip(leaves, names, strict=True) if called == name]
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
