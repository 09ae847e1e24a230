"""The file of a tuned controller: what was tuned and how; all else it inherits from the controller that was tuned."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from navbench.experiments.cells import leaves_below
from navbench.experiments.store import write_table
from navbench.experiments.tunings import Tuning, TuningRecord


def write_controller(tuning: Tuning, record: TuningRecord, path: Path) -> Path:
    """Write the tuned controller's YAML below a results directory, and return where it is."""
    cell = tuning.cells[0]
    controller = cell.names.controller
    worlds = ", ".join(cell.names.world for cell in tuning.cells)
    how = f"navbench tune controller={controller} tuner={tuning.tuner_name} objective={tuning.objective_name}"
    source = {"tuned": f"{how}, in {worlds}, budget={tuning.budget}", "seed": tuning.seed}
    best = record.best()
    build: dict[str, Any] = {}
    for name, value in best.items():
        place = build
        *words, last = name.split(".")
        for word in words:
            place = place.setdefault(word, {})
        place[last] = value
    whole = cell.configuration["controller"]["build"]
    keys = source_keys(best, tuning.configuration["tunable"], cell.sources["controller"], whole)
    content = {
        "defaults": [controller, "_self_"],
        "build": build,
        "sources": {key: dict(source) for key in keys},  # each its own, or YAML would refer from one to another
    }
    title = f"# {controller}, its parameters tuned by {tuning.tuner_name} for {tuning.objective_name} in {worlds}\n"
    file = path / "conf" / "controller" / f"{tuning.name}.yaml"
    write_table(file, title + yaml.safe_dump(content, sort_keys=False, width=120))
    return file


def source_keys(
    names: Iterable[str], tunable: Iterable[str], sources: Iterable[str], build: dict[str, Any]
) -> list[str]:
    """Return the keys under which the tuned parameters' source is to stand, so that none has two sources.

    They are those of the controller that was tuned, wherever all that such a key covers was tuned, and else the
    places that ``tunable`` names.

    Args:
        names: the tuned parameters' dotted places below ``build``.
        tunable: the places that the controller lets a tuning search.
        sources: the keys of its sources.
        build: its ``build``.
    """
    tuned = {f"build.{name}" for name in names}
    every = [f"build.{leaf}" for key in build if key != "_target_" for leaf in leaves_below(key, build)]
    own = [key for key in sources if {leaf for leaf in every if _covers(key, leaf)} <= tuned]
    keys = [*own, *(f"build.{key}" for key in tunable)]
    return list(dict.fromkeys(next(key for key in keys if _covers(key, name)) for name in every if name in tuned))


def _covers(key: str, name: str) -> bool:
    return name == key or name.startswith(f"{key}.")
