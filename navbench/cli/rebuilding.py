"""Cells with other values of what their sources leave open: as another reader might have rebuilt them."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from navbench.analysis.factors import Factor, apply, bounds_at, factors_of
from navbench.cli.composing import composing
from navbench.cli.configuration import cell_of, native_of, without
from navbench.cli.worlds import world_of
from navbench.experiments.cells import Cell
from navbench.experiments.plan import Plan
from navbench.experiments.schema import LONGEST
from navbench.experiments.tunings import Tuning
from navbench.reading import bounded
from navbench.robot import Robot
from navbench.sensors import suite_of
from navbench.simulation.options import SimulatorOptions
from navbench.tuning.space import Dimension, Side
from navbench.validation import DescriptionError, describe

Base = Mapping[tuple[str, str], Mapping[str, Any]]  # by part and thing the thing's own configuration


class Made(NamedTuple):
    """A part of a cell: its plain values, and what they describe (of a controller what it was drawn for)."""

    values: Mapping[str, Any]
    thing: Any


def base_of(cells: Iterable[Cell], config_dir: str | Path | None = None) -> Base:
    """Return the configuration of each thing that some cells use, without any cell's overrides."""
    things = dict.fromkeys((part, thing) for cell in cells for part, thing in cell.names._asdict().items())
    with composing(config_dir) as composer:
        return {(part, thing): composer.values("run", [f"{part}={thing}"]).values[part] for part, thing in things}


def set_by(cell: Cell, part: str, base: Base) -> frozenset[str]:
    """Return the dotted places of a cell's part at which its own overrides set a value."""
    leaves = dict(_leaves(part, base[part, getattr(cell.names, part)]))
    own = _leaves(part, cell.configuration[part])
    return frozenset(place for place, value in own if place in leaves and leaves[place] != value)


def moved(
    part: str, values: Mapping[str, Any], to: Iterable[tuple[Factor, float]], own: frozenset[str]
) -> Mapping[str, Any]:
    """Return a part's values with factors moved.

    Args:
        part: which part.
        values: as they are.
        to: factors of this part, each with where in its range, in [0, 1].
        own: dotted places whose values stay.
    """
    found = values
    for factor, u in to:
        for place, value in apply(factor, u, {part: values}).items():
            if place not in own:
                found = _with(found, place.split(".")[1:], value)
    return found


def made_part(part: str, name: str, values: Mapping[str, Any]) -> Made:
    """Return what a part's values describe, checked.

    Raises:
        DescriptionError: they describe nothing.
    """
    if part == "controller":
        return Made(values, native_of(values.get("native"))[0])
    if part == "world":
        return Made(values, world_of(values, name)[0])
    if part == "simulator":
        return Made(values, describe(SimulatorOptions, without(values, "_target_"), part))
    return Made(values, suite_of(values) if part == "sensors" else describe(Robot, values, part))


def rebuilt(cell: Cell, parts: Mapping[str, Made]) -> Cell:
    """Return a cell of other parts."""
    return replace(
        cell,
        configuration={**cell.configuration, **{part: made.values for part, made in parts.items()}},
        native=parts["controller"].thing,
        world=parts["world"].thing,
        robot=parts["robot"].thing,
        sensors=parts["sensors"].thing,
        options=parts["simulator"].thing,
    )


def in_simulator(cells: Iterable[Cell], name: str, config_dir: str | Path | None = None) -> list[Cell]:
    """Return cells in the simulator of a name, with the options that they have."""
    with composing(config_dir) as composer:
        other = cell_of(composer.values("run", [f"simulator={name}"]))
    found = []
    for cell in cells:
        own = {key: value for key, value in cell.configuration["simulator"].items() if key != "_target_"}
        options = {**other.configuration["simulator"], **own}
        moved = replace(
            cell,
            names=cell.names._replace(simulator=name),
            configuration={**cell.configuration, "simulator": options},
            sources={**cell.sources, "simulator": other.sources["simulator"] if options["drive"] == "limited" else {}},
            simulator=other.simulator,
        )
        found.append(moved)
    return found


def at_point(
    cells: Sequence[Cell], point: Mapping[str, float], fitted: Mapping[str, Any], config_dir: str | Path | None = None
) -> list[Cell]:
    """Return cells with some factors moved, whose sources say that they were fitted.

    Args:
        cells: the cells.
        point: where in its range each factor lies, by its name.
        fitted: the source of what is moved.
        config_dir: as after ``--config-dir``.
    """
    factors = [factor for factor in factors_of(cell.key() for cell in cells) if factor.name in point]
    base = base_of(cells, config_dir)
    found = []
    for cell in cells:
        parts, sources = {}, dict(cell.sources)
        for part, name in cell.names._asdict().items():
            own = set_by(cell, part, base)
            to = [(f, point[f.name]) for f in factors if f.part == part and name in f.things]
            parts[part] = made_part(part, name, moved(part, cell.configuration[part], to, own))
            changed = {key: fitted for factor, _ in to for key in factor.members if f"{part}.{key}" not in own}
            sources[part] = {**sources[part], **changed}
        found.append(replace(rebuilt(cell, parts), sources=sources))
    return found


def fitted(plan: Plan, file: Path, config_dir: str | Path | None = None) -> Plan:
    """Return a study's plan with its cells as the best reconstruction of its multiverse has them.

    Its tunings search in the study's own reconstruction, within the best one's bounds.

    Args:
        plan: of the study.
        file: where that reconstruction stands.
        config_dir: as after ``--config-dir``.

    Raises:
        DescriptionError: there is no such file; the study's multiverse writes it.
    """
    study = dict(plan.study or {})
    if not file.is_file():
        raise DescriptionError(f"{file}: missing; `navbench multiverse {study['name']}` writes it")
    try:
        told = json.loads(bounded(file, LONGEST))
        if not all(0.0 <= u <= 1.0 for u in told["point"].values()) or not isinstance(told["claims"], list):
            raise ValueError
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise DescriptionError(
            f"{file}: is not of this study; `navbench multiverse {study['name']}` writes it"
        ) from None
    source = {"fitted": "as in the reconstruction that meets most printed numbers", "claims": told["claims"]}
    title = f"{study['title']}, in the reconstruction that meets most printed numbers"
    cells = tuple(at_point(plan.cells, told["point"], source, config_dir))
    tunings = tuple(_within(tuning, factors_of([tuning.cells[0].key()]), told["point"]) for tuning in plan.tunings)
    return replace(plan, cells=cells, tunings=tunings, study={**study, "title": title})


def _within(tuning: Tuning, factors: Iterable[Factor], point: Mapping[str, float]) -> Tuning:
    """Return a tuning with the bounds that some factors set; where it starts beyond one, it starts there."""
    bounds = bounds_at((factor, point[factor.name]) for factor in factors if factor.name in point)
    tunable = {name: {**of, **bounds.get(name, {})} for name, of in tuning.configuration["tunable"].items()}
    sides = [_moved_to(side, tunable[side.name]) if side.name in bounds else side for side in tuning.dimensions]
    return replace(tuning, dimensions=tuple(sides), configuration={**tuning.configuration, "tunable": tunable})


def _moved_to(side: Side, bounds: Mapping[str, Any]) -> Side:
    assert isinstance(side, Dimension)
    low, high = bounds["low"], bounds["high"]
    return replace(side, low=low, high=high, start=None if side.start is None else min(max(side.start, low), high))


def between(
    gains: Mapping[str, Any], searched: Mapping[str, Side], bounds: Mapping[str, Mapping[str, float]]
) -> dict[str, Any]:
    """Return what a tuning found as it would lie within other bounds: at the same place between them.

    So it is of what runs to a bound, as the kp of aouf2019 does; to tune anew in each reconstruction would take hours.
    """
    found = dict(gains)
    for name, bound in bounds.items():
        side = searched[name]
        if name in gains and isinstance(side, Dimension):
            low, high = bound.get("low", side.low), bound.get("high", side.high)
            found[name] = replace(side, low=low, high=high, start=None).value_at(side.unit_at(gains[name]))
    return found


def _with(values: Mapping[str, Any], path: Sequence[str], value: Any) -> dict[str, Any]:
    """Return a mapping with another value at a place."""
    first, *rest = path
    return {**values, first: _with(values[first], rest, value) if rest else value}


def _leaves(place: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _leaves(f"{place}.{name}", inner)
    else:
        yield place, value
