"""From a composed configuration to a tuning or a study."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from hydra.errors import HydraException
from pydantic import Field
from pydantic.dataclasses import dataclass

from navbench.analysis.claims import TABLES, asked_by, check_claims, entries
from navbench.analysis.multiverse import conditions, multiverse_of
from navbench.cli.building import made
from navbench.cli.catalogue import CONF
from navbench.cli.composing import Composed, Composer, combinations, composing, key_of
from navbench.cli.configuration import cell_of, without
from navbench.cli.engine import Where, where_of
from navbench.cli.errors import one_line
from navbench.cli.progress import complain
from navbench.cli.references import check_chosen, check_references
from navbench.cli.tunable import dimensions_of
from navbench.experiments.cells import Cell
from navbench.experiments.plan import Plan
from navbench.experiments.tunings import Objective, Tuning
from navbench.report.sections import check_section
from navbench.sources import check_sources
from navbench.validation import STRICT, Count, DescriptionError, Flag, describe, instead

Seed = Annotated[int, Field(ge=0, strict=True)]
Words = tuple[str, ...]

TUNER = ("population", "generations(space, rng)")
REPAIR = ("__call__(values)",)
OF_A_TUNING = "tuner objective budget name world worlds verify engine workers hydra".split()  # not of its cells


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class CellSpec:
    """Some cells of a study: every combination of its overrides' comma-separated values.

    Attributes:
        name: what they are there for; the cells of a comparison share it.
        label: what the report calls their controller.
        controllers: instead of ``label``, several of them: what the report calls each, and its own further overrides.
        overrides: as on the command line.
        episodes: how many episodes each.
        seed: of every stream.
        tuning: the name of the tunings whose best parameters the controller takes; empty for none.
        tuning_seeds: of those, only these seeds; None for all.
        trajectories: whether to keep the trajectories.
    """

    name: str = "cells"
    label: str = ""
    controllers: Mapping[str, Words] | None = None
    overrides: Words
    episodes: Count = 1
    seed: Seed = 0
    tuning: str = ""
    tuning_seeds: tuple[Seed, ...] | None = None
    trajectories: Flag = True

    def __post_init__(self) -> None:
        """Check that the controllers are named once."""
        if bool(self.label) == bool(self.controllers):
            raise ValueError("must have one of `label` and `controllers`, the latter as `label: [overrides]`")

    def labelled(self) -> dict[str, Words]:
        """Return the overrides of each controller by its label."""
        if self.controllers is None:
            return {self.label: self.overrides}
        return {label: (*own, *self.overrides) for label, own in self.controllers.items()}


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class TuningSpec:
    """Some tunings of a study: one for each seed.

    Attributes:
        name: what they are called.
        overrides: as on the command line of ``navbench tune``.
        seeds: how many, from seed 0.
    """

    name: str
    overrides: Words
    seeds: Count = 1


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class StudyFile:
    """A study's own file.

    Attributes:
        title: the report's heading.
        summary: what the report says first, in Markdown.
        tunings: what it searches.
        cells: what it runs.
        claims: what a paper prints, to hold the results against, or the study's own hypotheses: ``Claim``s by ids.
        checks: what holds by construction, in the same form.
        questions: what no paper claims, likewise.
        multiverse: which reconstructions of the paper count, see ``navbench.analysis.multiverse``.
        report: the report's sections, in order: each one's name (of ``navbench.report.sections``, or dotted), or a
            mapping with its ``name`` and its arguments.
    """

    title: str
    summary: str = ""
    tunings: tuple[TuningSpec, ...] = ()
    cells: tuple[CellSpec, ...]
    claims: Mapping[str, Mapping[str, Any]] | None = None
    checks: Mapping[str, Mapping[str, Any]] | None = None
    questions: Mapping[str, Mapping[str, Any]] | None = None
    multiverse: Mapping[str, Any] | None = None
    report: tuple[Mapping[str, Any] | str, ...] = ()


def compose_tuning(overrides: Sequence[str], config_dir: str | Path | None = None) -> tuple[Tuning, Path, Where]:
    """Return the tuning that the command line's words describe, where its results go, and where it runs.

    Raises:
        HydraException: an unknown choice or key.
        DescriptionError: a value is wrong; one line names the key, its value and what is allowed.
    """
    with composing(config_dir, in_halves=False) as composer:
        (composed,), path = composer.command("tune", overrides)
        return tuning_of(composed, overrides, composer), path, where_of(composed.values)


def compose_study(name: str, config_dir: str | Path | None = None) -> Plan:
    """Return the study of a name.

    Raises:
        HydraException: there is no such study, or a cell's overrides do not compose.
        DescriptionError: a value is wrong; one line names the key, its value and what is allowed.
    """
    with composing(config_dir) as composer:
        values = composer.study(name)
        file = describe(StudyFile, values, f"study/{name}")
        asked = check_claims(f"study/{name}.", values)
        for i, section in enumerate(file.report):
            check_section(f"study/{name}.report[{i}]", section, trust=True)
        tunings = tuple(
            tuning
            for i, spec in enumerate(file.tunings)
            for tuning in _tunings(f"study/{name}.tunings[{i}]", spec, composer)
        )
        _check_apart(f"study/{name}.tunings", tunings)
        known = {tuning.name for tuning in tunings}
        cells: list[Cell] = []
        for i, spec in enumerate(file.cells):
            if spec.tuning and spec.tuning not in known:
                allowed = instead(spec.tuning, sorted(known) or ["none: this study has no tunings"])
                raise DescriptionError(f"study/{name}.cells[{i}].tuning={spec.tuning}: unknown; {allowed}")
            own = [tuning for tuning in tunings if tuning.name == spec.tuning]
            cells += _cells(f"study/{name}.cells[{i}]", spec, composer, own)
    content = {key: values.get(key) for key in ("title", "summary", *TABLES, "multiverse", "report")}
    if values.get("multiverse"):
        told = multiverse_of({"name": name, **content}, entries("", content))
        asked["multiverse"] = {entry.name: asked_by(entry.claim) for entry in conditions({"name": name}, told)}
    content |= {} if config_dir is None else {"config_dir": str(config_dir)}
    check_references(f"study/{name}", {**asked, "report": values.get("report")}, cells)
    check_chosen(name, values, [*cells, *tunings], [CONF, *([Path(config_dir)] if config_dir else [])])
    return Plan(cells=tuple(cells), tunings=tunings, study={"name": name, **content})


def _check_apart(key: str, tunings: Sequence[Tuning]) -> None:
    """Check that no search is named twice: its evaluations bear one name."""
    names: dict[str, str] = {}
    for tuning in tunings:
        first = names.setdefault(tuning.key().tuning_id, tuning.name)
        if first != tuning.name:
            raise DescriptionError(f"{key}: {tuning.name} is the search that {first} is; let its cells name {first}")


def _cells(key: str, spec: CellSpec, composer: Composer, tunings: Sequence[Tuning]) -> list[Cell]:
    """Return the cells of one entry of a study; of one that is tuned, one for each of its tunings."""
    cells = []
    for label, overrides in spec.labelled().items():
        for words in combinations(overrides):
            try:
                cell = cell_of(composer.values("run", [*words, f"episodes={spec.episodes}", f"seed={spec.seed}"]))
            except DescriptionError as error:
                raise DescriptionError(f"{key}: {error}") from None
            cell = replace(cell, name=spec.name, label=label, keep_trajectories=spec.trajectories)
            seeds = [tuning.seed for tuning in tunings if spec.tuning_seeds is None or tuning.seed in spec.tuning_seeds]
            tuned = [replace(cell, tuning=spec.tuning, tuning_seed=seed) for seed in seeds]
            cells += tuned if spec.tuning else [cell]
    return cells


def _tunings(key: str, spec: TuningSpec, composer: Composer) -> list[Tuning]:
    try:
        first = tuning_of(composer.values("tune", spec.overrides), spec.overrides, composer)
    except DescriptionError as error:
        raise DescriptionError(f"{key}: {error}") from None
    return [replace(first, name=spec.name, seed=seed) for seed in range(spec.seeds)]


def tuning_of(composed: Composed, overrides: Sequence[str], composer: Composer) -> Tuning:
    """Return the tuning that a composed configuration describes.

    Args:
        composed: the configuration, of the primary config ``tune``.
        overrides: the words that it was composed with.
        composer: composes the cells in its further worlds.

    Raises:
        DescriptionError: one line that names the key, its value and what is allowed.
    """
    values, choices = composed.values, composed.choices
    cell = cell_of(composed)
    cells = (cell, *_further_cells(values["worlds"], choices, overrides, composer))
    tunable = values["controller"].get("tunable") or {}
    if not tunable:
        raise DescriptionError(
            f"controller.tunable: missing; {cell.names.controller} names no parameters to tune, "
            "as `kp: {low: 0.0, high: 10.0, scale: linear}`"
        )
    name = values["name"] or f"{choices['tuner']}_{cell.names.controller}"
    if not re.fullmatch(r"[A-Za-z0-9][\w-]*", name) or name == cell.names.controller:
        raise DescriptionError(f"name={name}: must be a word of letters, digits, _ and -, and not the controller's own")
    repair = values["controller"].get("repair")
    searched = {part: without(values[part], "sources") for part in ("tuner", "objective")}
    configuration = {**searched, "tunable": tunable}
    for part in searched:
        check_sources(part, values[part].get("sources", {}))
    return Tuning(
        name=name,
        tuner_name=str(choices["tuner"]),
        objective_name=str(choices["objective"]),
        cells=cells,
        tuner=made("tuner.build", searched["tuner"].get("build"), TUNER),
        dimensions=dimensions_of(tunable, cell.configuration["controller"]["build"]),
        objective=describe(Objective, searched["objective"], "objective"),
        budget=values["budget"],
        seed=values["seed"],
        configuration=configuration if repair is None else {**configuration, "repair": repair},
        sources={part: values[part].get("sources", {}) for part in searched},
        repair=None if repair is None else made("controller.repair", repair, REPAIR),
        verified_in=_verified_in(values["verify"], cells, overrides, composer),
    )


def _further_cells(
    worlds: Sequence[str], choices: Mapping[str, Any], overrides: Sequence[str], composer: Composer
) -> list[Cell]:
    """Return the cells of the same words in further worlds, each on the robot that it was drawn for or that they name.

    Raises:
        DescriptionError: a world stands there twice, or as ``cell_of``.
    """
    for i, world in enumerate(worlds):
        if world in (choices["world"], *worlds[:i]):
            raise DescriptionError(f"worlds[{i}]={world}: stands there twice; `world` is the first of them")
    chosen = [f"{group}={choices[group]}" for group in ("controller", "simulator")]
    kept = [
        word
        for word in overrides
        if key_of(word) not in ("controller", "simulator") and key_of(word).split(".")[0] not in OF_A_TUNING
    ]
    return [cell_of(composer.values("run", [*chosen, *kept, f"world={world}"])) for world in worlds]


def _verified_in(
    simulator: str | None, cells: Sequence[Cell], overrides: Sequence[str], composer: Composer
) -> tuple[Cell, ...]:
    """Return a tuning's cells in the simulator that verifies; none, and said, where it lacks what it needs.

    Raises:
        DescriptionError: there is no such simulator, or as ``cell_of``.
    """
    if simulator in (None, cells[0].names.simulator):
        return ()
    words = [word for word in overrides if key_of(word).startswith("simulator.")]
    try:
        other = cell_of(composer.values("run", [f"simulator={simulator}", *words]))
    except (HydraException, DescriptionError) as error:
        said = one_line(error)
        if not said.startswith("simulator._target_="):
            raise DescriptionError(f"{said.replace('simulator=', 'verify=', 1)}, or null for none") from None
        complain(f"verify={simulator}: skipped; {said}")
        return ()
    return tuple(
        replace(
            cell,
            names=cell.names._replace(simulator=simulator),
            configuration={**cell.configuration, "simulator": other.configuration["simulator"]},
            sources={**cell.sources, "simulator": other.sources["simulator"]},
            simulator=other.simulator,
            options=other.options,
        )
        for cell in cells
    )
