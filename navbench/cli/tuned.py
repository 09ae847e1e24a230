"""The file of a tuned controller: what was tuned and how; all else it inherits from the controller that was tuned."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from navbench.cli.composing import key_of
from navbench.experiments.cells import leaves_below
from navbench.experiments.store import write_table
from navbench.experiments.tunings import Tuning

TOLD = (
    "controller tuner objective simulator world worlds budget seed name engine workers verify".split()
)  # or of no matter


def write_controller(tuning: Tuning, parameters: Mapping[str, Any], path: Path, overrides: Sequence[str] = ()) -> Path:
    """Write the tuned controller's YAML, and return where it is.

    Args:
        tuning: the tuning.
        parameters: the best ones, by their dotted places below ``controller.build``.
        path: its results directory.
        overrides: the words of the command line: what they set in the controller is written too, and their conditions
            are told with the source.
    """
    cell = tuning.cells[0]
    controller = cell.names.controller
    worlds = ", ".join(cell.names.world for cell in tuning.cells)
    how = f"navbench tune controller={controller} tuner={tuning.tuner_name} objective={tuning.objective_name}"
    how += f" simulator={cell.names.simulator}"
    further = [
        word for word in overrides if key_of(word) not in TOLD and not key_of(word).startswith(("hydra.", "engine."))
    ]
    source = {"tuned": f"{' '.join([how, *further])}, in {worlds}, budget={tuning.budget}", "seed": tuning.seed}
    whole = cell.configuration["controller"]["build"]
    best = {**_given(overrides, whole), **parameters}
    build: dict[str, Any] = {}
    for name, value in best.items():
        place = build
        *words, last = name.split(".")
        for word in words:
            place = place.setdefault(word, {})
        place[last] = value
    places = [*tuning.configuration["tunable"], *best]
    keys = source_keys(best, places, cell.sources["controller"], whole)
    content = {
        "defaults": [controller, "_self_"],
        "build": build,
        "sources": {key: dict(source) for key in keys},  # each its own, or YAML would refer from one to another
    }
    title = f"# {controller}, its parameters tuned by {tuning.tuner_name} for {tuning.objective_name} in {worlds}\n"
    file = path / "conf" / "controller" / f"{tuning.name}.yaml"
    write_table(file, title + yaml.safe_dump(content, sort_keys=False, width=120))
    return file


def _given(overrides: Iterable[str], build: dict[str, Any]) -> dict[str, Any]:
    """Return what words set below ``controller.build``, by the dotted place, other than the class itself."""
    keys = [key_of(word) for word in overrides if not word.startswith("~")]
    names = [key.removeprefix("controller.build.") for key in keys if key.startswith("controller.build.")]
    return {leaf: value for name in names if name != "_target_" for leaf, value in leaves_below(name, build).items()}


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
