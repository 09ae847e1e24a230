"""Run a plan and keep what it did: tunings, then cells side by side; what is there already is not run again."""

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any, NamedTuple

from navbench.experiments.cells import EPISODES, Batch, Cell, Records, digest
from navbench.experiments.code import code_of, commit, roots_of
from navbench.experiments.engines import LOCAL, Engine, Work, in_processes, run
from navbench.experiments.evaluations import Evaluation
from navbench.experiments.files import discard_empty, existing, locked
from navbench.experiments.parts import DAMAGED, batch_name, episodes_of, tuning_name, unfinished_name
from navbench.experiments.plan import Plan, Planned, around, batches_of_all
from navbench.experiments.store import OTHERWISE, Results
from navbench.experiments.tunings import Tuning, TuningRecord, checks_of, run_tuning
from navbench.experiments.workers import Death, MachineError
from navbench.importing import check_apart
from navbench.records import CellKey, TuningKey
from navbench.validation import DescriptionError

LOG = logging.getLogger("navbench")
PARTS = ("episodes", "trajectories", "latency")
SEARCH = "navbench.tuning.search"  # from which the code of a tuning is reached, beside that of its episodes

Progress = Callable[[str, int, int], None]  # what is under way, how much of it is done, of how much


class Ran(NamedTuple):
    """How a plan ended.

    Attributes:
        results: what it left.
        finished: how many of the planned episodes are there.
        planned: how many there should be.
        reasons: why the others are not.
    """

    results: Results
    finished: int
    planned: int
    reasons: tuple[str, ...]


def run_plan(
    plan: Plan,
    path: Path,
    workers: int | None = None,
    engine: Engine = LOCAL,
    progress: Progress = lambda *_: None,
    *,
    other_code: bool = False,
    overwrite: bool = False,
) -> Ran:
    """Run what is missing of a plan, and write each part as it finishes.

    Args:
        plan: what is to run.
        path: the results directory. What an earlier call finished there is not run again, unless code that makes it
            has changed since; parts that are damaged are named and made anew.
        workers: processes, as of ``engines.run``. A run with a window stays in this process.
        engine: where to run, see ``engines.run``.
        progress: told as the work goes on.
        other_code: whether to keep what other code made, too.
        overwrite: whether to remove finished parts that are not of the plan.

    Raises:
        DescriptionError: the directory holds other work, another run goes on in it, nothing of the plan can be run, or
            controllers would import each other's helpers.
        ValueError: a cost is not finite.
    """
    check_apart()
    results, there = Results(path), existing(path)
    if any(cell.options.gui for cell in plan.cells):
        workers = 0
    running = _Running(plan, results, workers, engine, progress, other_code, overwrite)
    try:
        with locked(path):
            return _carried_out(running)
    finally:
        discard_empty(path, there)


def _carried_out(running: "_Running") -> Ran:
    """Return how a plan ended, and leave no manifest where nothing of it was finished."""
    results = running.results
    running.begin()
    try:
        running.search()
        ran = running.drive()
    except BaseException as error:
        if isinstance(error, ValueError) and not isinstance(
            error, MachineError
        ):  # what cannot be run is not gone on with
            results.keep_only(["evaluations"], [tuning_name(tuning.key()) for tuning in running.plan.tunings])
        results.write_csv()
        results.abandon()
        raise
    results.end(running.codes)
    return ran


def best_of(results: Results, tuning: Tuning) -> tuple[int, float, dict[str, Any]]:
    """Return the first evaluation with the least cost of a finished tuning: its index, its cost, its parameters."""
    table = results.evaluations_of(tuning.key())
    costs = table["cost"].to_numpy()
    best = int(costs.argmin())
    return best, float(costs[best]), {side.name: table[side.name].tolist()[best] for side in tuning.dimensions}


class _Search(NamedTuple):
    """A tuning to be run, where it is kept, the digest of its code, and where and with how many processes it runs."""

    tuning: Tuning
    results: Results
    code: str
    workers: int | None
    engine: Engine = LOCAL

    @property
    def key(self) -> TuningKey:
        return self.tuning.key()


def _search(search: _Search, progress: Callable[[TuningRecord], None] = lambda _: None) -> Evaluation:
    """Run a tuning from where an earlier call left it, keep it, and return what was best."""
    key, results = search.key, search.results
    known: list[Evaluation] = []
    name = tuning_name(key)
    whole = results.has("evaluations", name) and results.code_of("evaluations", name) == search.code
    if whole or results.has("evaluations", unfinished_name(key)):
        table = results.evaluations_of(key, whole=whole)
        known = [Evaluation(*row) for row in table[list(Evaluation._fields)].itertuples(index=False)]

    def keep(record: TuningRecord) -> None:
        results.write_evaluations(key, record.columns(), search.code, whole=False)
        progress(record)

    record = run_tuning(search.tuning, search.workers, known, keep, search.engine)
    results.write_checks(key, checks_of(search.tuning, record, search.workers, search.engine), search.code)
    results.write_evaluations(key, record.columns(), search.code)
    return record.evaluations[record.best_index]


def _carefully(search: _Search) -> list[_Search]:
    """Return a search whose process died, to go on with its evaluations in processes of their own."""
    return [search._replace(workers=1)]


def _refuse(search: _Search, death: Death) -> Evaluation:
    what = f"tuning {search.tuning.name}, seed {search.tuning.seed}: "
    raise MachineError(death, what) if death.by_machine else DescriptionError(f"{what}{death.reason}")


SEARCHES: Work[_Search, Evaluation] = Work(_search, _carefully, _refuse, itemgetter(0), attrgetter("tuning.foreign"))


class _Part(NamedTuple):
    """A batch of a cell, and where the process that runs it keeps what it did.

    A piece of a batch that keeps dying is ``given_back`` to be joined with the others, as is a batch of an engine that
    shares no files.
    """

    key: CellKey
    batch: Batch
    results: Results
    code: str
    given_back: bool = False

    def keep(self, records: Records) -> None:
        """Write what the batch did."""
        cell, episodes = self.batch
        self.results.write_batch(self.key, episodes, records, self.code, cell.keep_trajectories, cell.keep_ranges)


def _run_part(part: _Part) -> Records | DescriptionError | None:
    """Run a batch and keep what it did, or return it, or why it cannot be run."""
    records = EPISODES.do(part.batch)
    if part.given_back or isinstance(records, DescriptionError):
        return records
    part.keep(records)
    return None


def _pieces(part: _Part) -> list[_Part]:
    return [part._replace(batch=batch, given_back=True) for batch in EPISODES.pieces(part.batch)]


def _join(pieces: Sequence[Records | DescriptionError | None]) -> Records | DescriptionError:
    return EPISODES.join([piece for piece in pieces if piece is not None])


PARTS_OF_CELLS: Work[_Part, Records | DescriptionError | None] = Work(
    _run_part, _pieces, lambda part, death: EPISODES.lost(part.batch, death), _join, attrgetter("batch.cell.foreign")
)


@dataclass(slots=True)
class _Running:
    """A plan under way; the first fields are the arguments of ``run_plan``."""

    plan: Plan
    results: Results
    workers: int | None
    engine: Engine
    progress: Progress
    other_code: bool
    overwrite: bool
    codes: set[str] = field(default_factory=set)  # the digests that parts name
    _modules: dict[str, dict[str, str]] = field(default_factory=dict)  # under the digest of them all
    _digests: dict[tuple[str, ...], str] = field(default_factory=dict)  # of each set of classes
    _changed: list[str] = field(default_factory=list)

    @property
    def anywhere(self) -> Results:
        """The results as a process finds them that works in another directory."""
        return Results(self.results.path.absolute())

    def begin(self) -> None:
        """Write the manifest of what is known, and remove what is damaged, or not of the plan.

        Raises:
            DescriptionError: the directory holds finished work that is not of the plan, and must not be overwritten.
        """
        tunings = [tuning.key() for tuning in self.plan.tunings]
        for key in tunings:
            self._code(key.configuration, SEARCH)
        for cell in self.plan.cells:
            self._code(cell.configuration)
        there = (self.results.path / "manifest.json").is_file()
        faults = self.results.faults() if there else {}
        damaged = [name for name, fault in faults.items() if fault == DAMAGED]
        strange = self._strange(damaged) if there else []
        if strange and not self.overwrite:
            raise DescriptionError(
                f"{self.results.path}: holds the results of other work: {len(strange)} finished parts that are not of "
                f"this plan, such as {strange[0]}; {OTHERWISE}"
            )
        self._changed = self._write_manifest([cell for cell in self.plan.cells if not cell.tuning])
        if strange:
            LOG.warning("%s: %d finished parts that are not of this plan are removed", self.results.path, len(strange))
        for name in damaged:
            LOG.warning("%s: damaged; it is removed and made anew", self.results.path / name)
        self.results.remove([*strange, *damaged])

    def _strange(self, damaged: Sequence[str]) -> list[str]:
        """Return the finished parts that are not of the plan, by kind and name.

        Which parts a cell with tuned parameters has is known when it is tuned: those of the plan's tunings are its own.
        """
        results, keys = self.results, [tuning.key() for tuning in self.plan.tunings]
        known = {tuning_name(key) for key in keys} | {unfinished_name(key) for key in keys}
        found = [f"evaluations/{name}" for name in results.parts("evaluations", "[!.]") if name not in known]
        found = [name for name in found if name not in damaged]
        indices: dict[str, set[int]] = {}
        for cell in self.plan.cells:
            indices.setdefault(cell.key().run_id, set()).update(cell.indices)
        tunings = {f"{tuning.name} {tuning.seed}" for tuning in self.plan.tunings}
        for name in results.parts("episodes"):
            if f"episodes/{name}" in damaged:
                continue
            run_id, episodes = episodes_of(name)
            mine = run_id in indices and indices[run_id].issuperset(episodes)
            if not mine and not (tunings and results.tuning_of("episodes", name) in tunings):
                found.append(f"episodes/{name}")
        return found

    def search(self) -> None:
        """Run the tunings that are missing: side by side, or each on all cores, as where they are few."""
        keys = [tuning.key() for tuning in self.plan.tunings]
        codes = [self._code(key.configuration, SEARCH) for key in keys]
        whole = dict(zip(map(tuning_name, keys), codes, strict=True))
        parts = whole | dict(zip(map(unfinished_name, keys), codes, strict=True))
        self.results.keep_only(["evaluations", "checks"], parts)
        stale = self._of_other_code("evaluations", parts)
        self.results.keep_only(["evaluations"], set(parts) - (stale - set(whole)))
        todo = [
            _Search(tuning, self.anywhere, code, self.workers, self.engine)
            for tuning, (name, code) in zip(self.plan.tunings, whole.items(), strict=True)
            if name in stale or not all(self.results.has(kind, name) for kind in ("evaluations", "checks"))
        ]
        budgets = [search.tuning.budget for search in todo]
        done = 0
        side_by_side = len(todo) >= (os.cpu_count() or 1 if self.workers is None else self.workers) > 1
        if side_by_side and self.engine.shares_files:
            alone = [search._replace(workers=0) for search in todo]
            for index, _ in run(SEARCHES, alone, self.engine, self.workers):
                done += budgets[index]
                self.progress("evaluations", done, sum(budgets))
        else:
            for search, budget in zip(todo, budgets, strict=True):
                _search(search, partial(self._tell, done, sum(budgets)))
                done += budget

    def _tell(self, before: int, of: int, record: TuningRecord) -> None:
        best = record.evaluations[record.best_index].cost
        self.progress(f"best cost {best:.6g}, evaluations", before + len(record.evaluations), of)

    def drive(self) -> Ran:
        """Run the episodes that are missing, those of all cells side by side."""
        results = self.results
        cells = [self._tuned(cell) for cell in self.plan.cells]
        if self.plan.tunings:
            self._write_manifest(cells)
        self._write_descriptions(cells)
        batches = self._batches(cells)
        parts = {
            name: _Part(key, batch, self.anywhere, self._code(batch.cell.configuration), not self.engine.shares_files)
            for name, (key, batch) in batches.items()
        }
        replaced = [name for name in results.parts("episodes") if name not in parts]
        if replaced:  # of other parameters, for their tuning was run anew
            LOG.warning("%s: %d parts of an earlier tuning are removed", results.path, len(replaced))
        results.keep_only(PARTS, parts)
        stale = self._of_other_code("episodes", {name: part.code for name, part in parts.items()})
        todo = [part for name, part in parts.items() if name in stale or not self._is_finished(name, part.batch.cell)]
        planned = sum(len(part.batch.episodes) for part in parts.values())
        finished = planned - sum(len(part.batch.episodes) for part in todo)
        if todo:
            self.progress("episodes", finished, planned)
        reasons: dict[str, DescriptionError] = {}
        with closing(run(PARTS_OF_CELLS, todo, self.engine, self.workers)) as done:  # so that no more is written
            for index, ended in done:
                part = todo[index]
                if isinstance(ended, DescriptionError):
                    reasons[f"{part.key.label} in {part.key.names.world}: {ended}"] = ended
                    continue
                if ended is not None:  # it was given back
                    part.keep(ended)
                finished += len(part.batch.episodes)
                self.progress("episodes", finished, planned)
        if not finished:
            reason, error = next(iter(reasons.items()))
            raise error if isinstance(error, MachineError) else DescriptionError(reason)
        return Ran(results, finished, planned, tuple(reasons))

    def _batches(self, cells: Sequence[Cell]) -> Planned:
        """Return the batches of some cells by the names of their parts, those that are there as they were cut."""
        planned = {batch_name(key, batch.episodes): (key, batch) for key, batch in batches_of_all(cells)}
        others = [name for name in self.results.parts("episodes") if name not in planned]
        return around(planned, {name: episodes_of(name) for name in others}) if others else planned

    def _is_finished(self, name: str, cell: Cell) -> bool:
        is_there = self.results.has("episodes", name) and not self.results.lacking(name)
        return is_there and (self.results.holds_ranges(name) or not cell.keep_ranges)

    def _tuned(self, cell: Cell) -> Cell:
        """Return a cell with the parameters of its tuning."""
        for tuning in self.plan.tunings:
            if (tuning.name, tuning.seed) == (cell.tuning, cell.tuning_seed):
                return cell.with_parameters(best_of(self.results, tuning)[2])
        return cell

    def _write_manifest(self, cells: Sequence[Cell]) -> list[str]:
        tunings = [tuning.key() for tuning in self.plan.tunings]
        planned = {"episodes": self.plan.episodes()}
        known = [cell.key() for cell in cells], tunings, self.plan.study, planned, self._modules, commit()
        return self.results.begin(*known, overwrite=self.overwrite)

    def _code(self, configuration: Any, *roots: str) -> str:
        """Return the digest of the code that a configuration runs through."""
        roots = (*roots, *roots_of(configuration))
        if roots not in self._digests:
            modules = code_of(roots)
            self._digests[roots] = digest(modules)
            self._modules[digest(modules)] = modules
        return self._digests[roots]

    def _of_other_code(self, kind: str, codes: Mapping[str, str]) -> set[str]:
        """Return the parts that other code made and that are to be made anew, and say and note what was changed."""
        results = self.results
        there = {name: results.code_of(kind, name) for name in codes if results.has(kind, name)}
        found = {name for name, code in there.items() if code != codes[name]}
        self.codes |= {*codes.values(), *(there.values() if self.other_code else ())}
        if found:
            results.record_resume(self._changed, len(found), self.other_code)
            said = ", ".join(self._changed) or "see resumed in its manifest"
            done = "they are kept" if self.other_code else "they are run anew; resume=other-code would keep them"
            LOG.warning("%s: %d parts are of other code (%s): %s", results.path, len(found), said, done)
        return set() if self.other_code else found

    def _write_descriptions(self, cells: Sequence[Cell]) -> None:
        """Write the tables that the cells' controllers offer of themselves, the first cell of each controller's."""
        first = {cell.names.controller: cell for cell in reversed(cells) if hasattr(cell.controller, "describe")}
        if self.plan.study:
            told = in_processes(_described, list(first.values()), self.workers, attrgetter("foreign"))
            for name, tables in zip(first, told, strict=True):
                for part, table in tables.items():
                    self.results.write_description(f"{name}-{part}", table)


def _described(cell: Cell) -> dict[str, Any]:
    tables: dict[str, Any] = cell.make_controller().describe()  # type: ignore[attr-defined]
    return tables
