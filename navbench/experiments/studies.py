"""A study: tunings, then cells, some with what was tuned; what an earlier call finished is not run again."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from navbench.experiments.cells import Cell
from navbench.experiments.engines import Work, run
from navbench.experiments.running import run_batches
from navbench.experiments.store import Results, batch_name, tuning_name
from navbench.experiments.tunings import Tuning, TuningRecord, run_tuning
from navbench.records import StudyCell

Report = Callable[[str, int, int], None]  # what is under way, how much of it is done, of how much


class Planned(NamedTuple):
    """A cell of a study before the tunings are made.

    Attributes:
        cell: the cell; where it is tuned, with its controller's own parameters.
        name: what it is there for; the cells of a comparison share it.
        label: what the report calls its controller.
        tuning: the name of the tunings whose best parameters it takes, one cell for each of their seeds; or empty.
        tuning_seeds: of those, only these; None for all.
    """

    cell: Cell
    name: str
    label: str
    tuning: str = ""
    tuning_seeds: tuple[int, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """What a study runs and what it asks.

    Attributes:
        name: its configuration name.
        tunings: what it searches first; those of one name differ in their seeds.
        cells: what it then runs.
        content: claims and report as plain values, for the manifest.
    """

    name: str
    tunings: tuple[Tuning, ...]
    cells: tuple[Planned, ...]
    content: Mapping[str, Any]


def run_study(study: Study, path: Path, workers: int | None, engine: str, report: Report | None = None) -> Results:
    """Run what is missing of a study, and return its results.

    Args:
        study: the study.
        path: its directory; finished parts in it are not run again, parts of another configuration are removed.
        workers: processes; None for one a core.
        engine: where to run, see ``engines.run``.
        report: told as the work goes on.

    Raises:
        DescriptionError: the directory holds other work.
        ValueError: a cost is not finite.
    """
    results = Results(path)
    content = {"name": study.name, **study.content}
    keys = [tuning.key() for tuning in study.tunings]
    results.begin([StudyCell(p.cell.key(), p.name, p.label) for p in study.cells if not p.tuning], keys, content)
    results.keep_only(["evaluations"], map(tuning_name, keys))
    workers = workers or os.cpu_count() or 1  # so that a single batch left over can kill its process, and no more
    _run_tunings(study.tunings, results, workers, engine, report)
    placed = [(place, cell) for planned in study.cells for place, cell in _places(planned, study.tunings, results)]
    results.begin([place for place, _ in placed], keys, content)
    cells = [cell for _, cell in placed]
    names = [batch_name(place.key, batch.episodes) for place, cell in placed for batch in cell.batches()]
    results.keep_only(["episodes", "trajectories", "latency"], names)
    for name, table in _descriptions(cells).items():
        results.write_description(name, table)

    def progress(done: int, of: int) -> None:
        if report is not None:
            report("episodes, in batches", done, of)

    run_batches(cells, results, workers, resume=True, engine=engine, progress=progress)
    results.end()
    return results


def _run_tunings(
    tunings: Sequence[Tuning], results: Results, workers: int | None, engine: str, report: Report | None
) -> None:
    todo = [tuning for tuning in tunings if not results.has("evaluations", tuning_name(tuning.key()))]
    for done, (index, record) in enumerate(run(TUNINGS, todo, engine, workers), 1):
        results.write_evaluations(todo[index].key(), record.columns())
        if report is not None:
            report("tunings", done, len(todo))


def _places(planned: Planned, tunings: Sequence[Tuning], results: Results) -> list[tuple[StudyCell, Cell]]:
    """Return the cells that a planned one becomes: itself, or one for each tuning that it takes parameters from."""
    if not planned.tuning:
        return [(StudyCell(planned.cell.key(), planned.name, planned.label), planned.cell)]
    placed = []
    for tuning in tunings:
        if tuning.name != planned.tuning or (
            planned.tuning_seeds is not None and tuning.seed not in planned.tuning_seeds
        ):
            continue
        table = results.evaluations_of(tuning.key())
        best = int(table["cost"].to_numpy().argmin())
        values = {side.name: table[side.name].tolist()[best] for side in tuning.dimensions}
        cell = planned.cell.with_parameters(values)
        placed.append((StudyCell(cell.key(), planned.name, planned.label, tuning.name, tuning.seed), cell))
    return placed


def _descriptions(cells: Sequence[Cell]) -> dict[str, Mapping[str, Any]]:
    """Return the tables that the cells' controllers offer of themselves, the first cell of each controller's."""
    tables: dict[str, Mapping[str, Any]] = {}
    for cell in cells:
        describe = getattr(cell.make_controller.func, "describe", None)
        if describe is None or any(name.startswith(f"{cell.names.controller}-") for name in tables):
            continue
        for name, table in cell.make_controller().describe().items():  # type: ignore[attr-defined]
            tables[f"{cell.names.controller}-{name}"] = table
    return tables


def _refuse(tuning: Tuning) -> TuningRecord:
    raise RuntimeError(f"tuning {tuning.name}, seed {tuning.seed}: its process died; run the study again to see why")


def _only(records: Sequence[TuningRecord]) -> TuningRecord:
    (record,) = records
    return record


TUNINGS: Work[Tuning, TuningRecord] = Work(run_tuning, lambda tuning: [tuning], _refuse, _only)
