"""From a study to its reconstructions: which cells its claims use, and what of them its paper leaves open."""

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from navbench.analysis.claims import Entry, asked_by, entries
from navbench.analysis.factors import Factor, apply, factors_of, under
from navbench.analysis.multiverse import Multiverse, check_free, conditions, multiverse_of
from navbench.cli.rebuilding import Base, base_of, in_simulator, set_by
from navbench.cli.reconstructions import Choice, Drawn, Part, Reconstructions
from navbench.cli.references import COLUMNS, SELECTIONS
from navbench.cli.study_configuration import compose_study
from navbench.experiments.cells import Cell, digest
from navbench.experiments.code import code_of, roots_of
from navbench.experiments.parts import tuning_name
from navbench.experiments.running import best_of
from navbench.experiments.store import Results, ResultsError
from navbench.experiments.tunings import Tuning
from navbench.validation import DescriptionError, instead

SIMULATOR = "planar"  # in which all reconstructions run
CLAIMS = ("claim", "hypothesis")


def reconstructions_of(
    study: str,
    tuned: Path,
    config_dir: str | Path | None = None,
    episodes: tuple[int, int] = (5, 10),
    prior: str | None = None,
) -> Reconstructions:
    """Return the reconstructions of a study.

    Args:
        study: its name.
        tuned: the study's results, with what its tunings found.
        config_dir: as after ``--config-dir``.
        episodes: of a cell at first, and at most.
        prior: which other prior of the study, see ``Multiverse``; None for the ranges of its sources.

    Raises:
        DescriptionError: as ``compose_study``; or a tuning is not there, or there is no such prior.
    """
    plan = compose_study(study, config_dir)
    content = dict(plan.study or {})
    told = [entry for entry in entries("", content) if entry.kind in CLAIMS]
    multiverse = multiverse_of(content, told)
    claims = [*conditions(content, multiverse), *(entry for entry in told if entry.claim.measure)]
    cells = _in_planar(plan.cells, config_dir)
    uses = [_uses(entry, cells) for entry in claims]
    needed = sorted({k for used in uses for k in used})
    cells = [cells[k] for k in needed]
    places = {k: i for i, k in enumerate(needed)}
    factors = factors_of(cell.key() for cell in cells)
    check_free(multiverse, factors, {cell.key().label for cell in cells}, f"study/{study}.multiverse.free")
    key = f"study/{study}.multiverse.priors"
    others = {name: under(ranges, factors, f"{key}.{name}") for name, ranges in multiverse.priors.items()}
    if prior is not None:
        if prior not in others:
            raise DescriptionError(f"prior={prior}: no such prior; {instead(prior, others, 'there are')}")
        factors = others[prior]
    base = base_of(cells, config_dir)
    factors = [factor for factor in factors if any(_moves(factor, cell, base, multiverse) for cell in cells)]
    parts: dict[str, Part] = {}
    drawn = []
    for cell in cells:
        own = [_part(part, cell, factors, base, multiverse) for part in cell.names._fields]
        keys = [digest([part.part, part.thing, part.configuration, sorted(part.own)]) for part in own]
        parts |= dict(zip(keys, own, strict=True))
        drawn.append((cell, keys))
    order = {key: i for i, key in enumerate(parts)}
    gains = _gains(plan.tunings, {cell.tuning for cell in cells}, Results(tuned))
    searched = {tuning.name: {side.name: side for side in tuning.dimensions} for tuning in plan.tunings}
    return Reconstructions(
        study={key: content[key] for key in ("name", "title")},
        cells=tuple(
            Drawn(cell, tuple(order[key] for key in keys), gains.get(cell.tuning, {}), searched.get(cell.tuning, {}))
            for cell, keys in drawn
        ),
        parts=tuple(parts.values()),
        factors=tuple(factors),
        choices=() if prior else tuple(_choices(gains, claims)),
        claims=tuple(claims),
        multiverse=multiverse,
        uses=tuple(frozenset(places[k] for k in used) for used in uses),
        episodes=episodes,
    )


def prior_of(of: Reconstructions, seed: int, name: str | None = None) -> dict[str, Any]:
    """Return all that decides what is drawn and asked, as plain values.

    Args:
        of: the reconstructions.
        seed: of their draws.
        name: of another prior than that of the sources.
    """
    modules = code_of({root for one in of.cells for root in roots_of(one.cell.configuration)})
    return {
        "study": of.study["name"],
        "seed": seed,
        "episodes": list(of.episodes),
        "simulator": SIMULATOR,
        "factors": [
            {"name": factor.name, "things": list(factor.things), "of": _plain_members(factor)} for factor in of.factors
        ],
        "choices": [{"name": choice.name, "values": list(choice.values)} for choice in of.choices],
        "claims": {entry.name: _plain_claim(entry) for entry in of.claims},
        "cells": digest([one.cell.key().config_hash for one in of.cells]),
        "code": digest(modules),
        **({"prior": name} if name else {}),
    }


def _plain_members(factor: Factor) -> dict[str, Any]:
    """Return between what a factor's values are drawn, and how they move."""
    told = ("range", "choices", "apply", "scale", "tie")
    members = {key: {word: getattr(source, word) for word in told} for key, source in factor.members.items()}
    plain: dict[str, Any] = json.loads(json.dumps(members))
    return {key: {word: value for word, value in of.items() if value} for key, of in plain.items()}


def _plain_claim(entry: Entry) -> dict[str, Any]:
    claim = entry.claim
    words = ("printed", "within", "compare", "holds", "measure", "of")
    return {word: getattr(claim, word) for word in words if getattr(claim, word) is not None}


def _gains(tunings: Iterable[Tuning], wanted: Collection[str], results: Results) -> dict[str, dict[int, Any]]:
    """Return for each tuning that is wanted what each of its seeds found, as these results hold it.

    Raises:
        ResultsError: one of them is not there.
    """
    found: dict[str, dict[int, Any]] = {}
    for tuning in tunings:
        if tuning.name in wanted:
            if not results.has("evaluations", tuning_name(tuning.key())):
                raise ResultsError(
                    f"{results.path}: has no tuning {tuning.name}, seed {tuning.seed}; run the study first"
                )
            found.setdefault(tuning.name, {})[tuning.seed] = best_of(results, tuning)[2]
    return found


def _choices(gains: Mapping[str, Mapping[int, Any]], claims: Iterable[Entry]) -> Iterator[Choice]:
    """Yield the factors that are no source's; all tunings share one, so that those of one seed stay together."""
    seeds = tuple(sorted({seed for of in gains.values() for seed in of}))
    if len(seeds) > 1:
        yield Choice("tunings.seed", "", "seed", seeds)
    for name, _, claim in claims:
        for word, values in (claim.plausible or {}).items():
            if word != "cell":  # another cell is another reading, which the factors draw anyway
                yield Choice(f"{name}.{word}", name, word, ((claim.of or {}).get(word), *values))


def _in_planar(cells: Iterable[Cell], config_dir: str | Path | None) -> list[Cell]:
    """Return cells in the simulator of reconstructions; of those that differ in their tuning's seed alone the first."""
    found: dict[tuple[Any, ...], Cell] = {}
    for cell in in_simulator(cells, SIMULATOR, config_dir):
        key = cell.key()
        found.setdefault((key.name, key.label, key.run_id, key.tuning, cell.indices), cell)
    return list(found.values())


def _uses(entry: Entry, cells: Sequence[Cell]) -> set[int]:
    """Return the places of the cells that a claim's measure selects, also with what else is plausible."""
    claim = entry.claim
    found: set[int] = set()
    for of in [claim.of or {}, *(of for _, of in claim.variants())]:
        asked = asked_by(claim, of)
        selections = [asked[word] for word in SELECTIONS if isinstance(asked.get(word), Mapping)]
        for table in (asked[word] for word in ("table", "other") if word in asked):
            selections.append({"controller": str(table).rpartition("-")[0]})
        for selection in selections:
            found |= {k for k, cell in enumerate(cells) if _matches(cell, selection)}
    return found


def _matches(cell: Cell, selection: Mapping[str, Any]) -> bool:
    key = cell.key()
    row = {**key._asdict(), **key.names._asdict()}
    wanted = {word: value if isinstance(value, list | tuple) else [value] for word, value in selection.items()}
    return all(row[word] in values for word, values in wanted.items() if word in COLUMNS and word != "simulator")


def _part(part: str, cell: Cell, factors: Sequence[Factor], base: Base, multiverse: Multiverse) -> Part:
    moving = [(i, factor) for i, factor in enumerate(factors) if _is_of(factor, part, cell)]
    own = _own(part, cell, [factor for _, factor in moving], base, multiverse)
    return Part(part, getattr(cell.names, part), cell.configuration[part], tuple(i for i, _ in moving), own)


def _own(part: str, cell: Cell, factors: Iterable[Factor], base: Base, multiverse: Multiverse) -> frozenset[str]:
    """Return the places of a part that a cell sets and no factor moves: not those where it only names a reading."""
    label = cell.key().label
    free = [factor for factor in factors if label in multiverse.free.get(factor.name, ())]
    return set_by(cell, part, base) - {f"{part}.{key}" for factor in free for key in factor.members}


def _moves(factor: Factor, cell: Cell, base: Base, multiverse: Multiverse) -> bool:
    """Return whether a factor moves anything of a cell."""
    if not _is_of(factor, factor.part, cell):
        return False
    places = apply(factor, 0.5, cell.configuration)
    own = _own(factor.part, cell, [factor], base, multiverse)
    return not own.issuperset(places) if places else bool(cell.tuning)


def _is_of(factor: Factor, part: str, cell: Cell) -> bool:
    return factor.part == part and getattr(cell.names, part) in factor.things
