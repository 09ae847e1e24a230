"""The verbs that are no plain run: tune, study and report."""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from navbench.cli.catalogue import CONF, check_folder, files_of
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    from navbench.experiments.cells import Cell
    from navbench.experiments.tunings import Tuning, TuningRecord

STUDY_KEYS = ("engine", "workers")
REPORT_KEYS = ("out", "join")
SHOWN_MAX = 20  # parameters; of more, a screen shows no better than the file


class Words(NamedTuple):
    """A verb's words, sorted.

    Attributes:
        names: those without ``=``.
        overrides: those with it.
        config_dir: the folder after ``--config-dir``, or None.
    """

    names: list[str]
    overrides: list[str]
    config_dir: str | None


def sort_words(arguments: Sequence[str]) -> Words:
    """Return the words of a verb, sorted, and make the working directory a place to import from.

    Raises:
        DescriptionError: a flag is unknown, or the folder of configurations is missing.
    """
    names: list[str] = []
    overrides: list[str] = []
    config_dir = None
    rest = iter(arguments)
    for word in rest:
        flag, _, value = word.partition("=")
        if flag in ("--config-dir", "-cd"):
            config_dir = value or next(rest, "")
            check_folder(Path(config_dir))
        elif word.startswith("-"):
            raise DescriptionError(f"{word}: unknown flag; allowed: --config-dir DIR")
        elif "=" in word or word.startswith("~"):
            overrides.append(word)
        else:
            names.append(word)
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())  # a console script does not look there, and a user's controller may lie there
    return Words(names, overrides, config_dir)


def study(arguments: Sequence[str]) -> int:
    """Run what is missing of a study, and write its report."""
    words = sort_words(arguments)
    known = files_of("study", [CONF, *([Path(words.config_dir)] if words.config_dir else [])])
    if len(words.names) != 1 or words.names[0] not in known:
        raise DescriptionError(f"study {' '.join(words.names)}: name one study; there are {', '.join(known)}")
    name = words.names[0]
    options = _study_options(words.overrides)
    from navbench.cli.study_configuration import compose_study
    from navbench.experiments.engines import in_processes
    from navbench.experiments.studies import run_study
    from navbench.report.reports import write_report

    path = Path("outputs/study") / name
    chosen = compose_study(name, words.config_dir)
    try:
        with _progress() as progress:
            results = run_study(chosen, path, options["workers"], options["engine"], progress)
    except KeyboardInterrupt:
        print(
            f"navbench: interrupted; what was finished is kept in {path}: `navbench study {name}` goes on from there",
            file=sys.stderr,
        )
        return 130
    written = write_report([results], Path("results") / name, partial(in_processes, **options), trust=True)
    print(_first_lines(written))
    return 0


def _study_options(overrides: Sequence[str]) -> dict[str, Any]:
    from navbench.experiments.engines import ENGINES

    options: dict[str, Any] = {"engine": "local", "workers": None}
    for word in overrides:
        key, _, value = word.partition("=")
        if key not in STUDY_KEYS:
            raise DescriptionError(f"{word}: unknown key; allowed with a study: {', '.join(STUDY_KEYS)}")
        if key == "engine" and value not in ENGINES:
            raise DescriptionError(f"engine={value}: unknown choice; allowed: {', '.join(ENGINES)}")
        if key == "workers" and not (value.isdecimal() and int(value) >= 1):
            raise DescriptionError(f"workers={value}: must be a whole number of at least 1")
        options[key] = int(value) if key == "workers" else value
    return options


def report(arguments: Sequence[str]) -> int:
    """Rebuild tables and figures from results directories, or join the reports in one; nothing is run."""
    from navbench.experiments.store import Results
    from navbench.report.joined import write_joined
    from navbench.report.reports import write_report

    words = sort_words([word for word in arguments if word != "--trust"])
    given: dict[str, Path] = {}
    for word in words.overrides:
        key, _, value = word.partition("=")
        if key not in REPORT_KEYS or not value:
            raise DescriptionError(f"{word}: unknown key; allowed with report: out=DIR, join=DIR, --trust")
        given[key] = Path(value)
    if "join" in given:
        if words.names or "out" in given:
            raise DescriptionError(f"join={given['join']}: stands alone; it writes into that directory")
        print(f"report: {write_joined(given['join'])}")
        return 0
    out = given.get("out")
    if not words.names:
        raise DescriptionError("report: name at least one results directory")
    runs = [run for name in words.names for run in _results_in(Path(name))]
    if out is None:
        study_of_it = (runs[0].manifest()["study"] or {}).get("name", "")
        kept = len(runs) == 1 and study_of_it and not study_of_it.startswith("tune ")  # a tuning's name is no folder
        out = Path("results") / study_of_it if kept else Path(words.names[0]) / "report"
    print(_first_lines(write_report([Results(run.path) for run in runs], out, trust="--trust" in arguments)))
    return 0


def _results_in(path: Path) -> list[Any]:
    """Return the results directory at a path, or those of a sweep's cells below it."""
    from navbench.experiments.store import Results

    if not path.is_dir():
        raise DescriptionError(f"report {path}: there is no such directory")
    below = sorted(manifest.parent for manifest in path.glob("*/manifest.json"))
    found = [Results(path)] if (path / "manifest.json").is_file() or not below else [Results(run) for run in below]
    for results in found:
        results.manifest()
    return found


def tune(arguments: Sequence[str]) -> int:
    """Search a controller's parameters, keep every evaluation, and write the tuned controller's file."""
    words = sort_words(arguments)
    if words.names:
        raise DescriptionError(f"{words.names[0]}: unknown word; tune takes key=value, such as tuner=pso")
    from navbench.cli.composing import check_words
    from navbench.cli.study_configuration import compose_tuning

    check_words(words.overrides)
    tuning, path, workers = compose_tuning(words.overrides, words.config_dir)
    from navbench.cli.tuned import write_controller
    from navbench.experiments.running import run_batches
    from navbench.experiments.store import Results, batch_name, discard_empty, existing, tuning_name
    from navbench.experiments.tunings import run_tuning
    from navbench.report.figures import save_convergence
    from navbench.report.tables import summarize, to_text

    results, there = Results(path), existing(path)
    placed = [_place(cell, f"untuned {cell.names.controller}") for cell in tuning.cells]
    content = {
        "name": f"tune {tuning.name}",
        "title": f"{tuning.name} tuned",
        "summary": "",
        "claims": [],
        "report": [],
    }
    results.begin([place for place, _ in placed], [tuning.key()], content)
    try:
        with _progress() as progress:
            record = run_tuning(
                tuning, workers, lambda done, best: progress(f"best cost {best:.6g}, evaluations", done, tuning.budget)
            )
    except BaseException as error:
        results.abandon()
        discard_empty(path, there)
        if not isinstance(error, KeyboardInterrupt):
            raise
        print("navbench: interrupted; of a tuning nothing is kept before its end", file=sys.stderr)
        return 130
    results.write_evaluations(tuning.key(), record.columns())
    placed += [_place(cell.with_parameters(record.best()), tuning.name) for cell in tuning.cells]
    results.begin([place for place, _ in placed], [tuning.key()], content)
    batches = [batch_name(place.key, batch.episodes) for place, cell in placed for batch in cell.batches()]
    results.keep_only(["evaluations"], [tuning_name(tuning.key())])
    results.keep_only(["episodes", "trajectories", "latency"], batches)
    run_batches([cell for _, cell in placed], results, workers, resume=False)
    results.end()
    save_convergence(results, path / "convergence.png")
    file = write_controller(tuning, record, path, words.overrides)
    labels = {place.key.run_id: place.label for place, _ in placed}
    summary = summarize(results.episodes())
    summary["controller"] = [labels[run_id] for run_id in summary["run_id"]]
    print(to_text(summary))
    print(
        f"cost {record.evaluations[record.best_index].cost:.6g} at evaluation {record.best_index} of {tuning.budget}:"
    )
    print(_changes(tuning, record))
    print(f"controller: {file}; {_use(file, tuning.cells[0].names.controller, words.config_dir)}")
    print(f"results: {path}")
    return 0


def _use(file: Path, inherited: str, config_dir: str | None) -> str:
    """Return how to use a tuned controller's file, which needs the one that it inherits from beside it."""
    beside = Path(config_dir or CONF) / "controller" / f"{inherited}.yaml"
    if config_dir and beside.is_file():
        return f"copy it beside {beside}, and use it with --config-dir {config_dir} controller={file.stem}"
    return f"use it with --config-dir {file.parents[1]} controller={file.stem}"


def _place(cell: "Cell", label: str) -> Any:
    from navbench.records import StudyCell

    return StudyCell(cell.key(), "tune", label), cell


def _changes(tuning: "Tuning", record: "TuningRecord") -> str:
    """Return the best parameters, a line each, or where they are many, how many of them the search changed."""
    best = record.best()
    if len(best) <= SHOWN_MAX:
        return "\n".join(f"  {name}: {v:.6g}" if isinstance(v, float) else f"  {name}: {v}" for name, v in best.items())
    values = record.values[record.best_index].tolist()
    changed = sum(value != side.start for side, value in zip(tuning.dimensions, values, strict=True))
    return f"  {changed} of {len(best)} parameters changed"


@contextmanager
def _progress() -> Iterator[Callable[[str, int, int], None]]:
    """Give a function that shows what is under way on stderr: a bar for a person, now and then a line for a log."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        told: dict[str, int] = {}

        def tell(what: str, done: int, of: int) -> None:
            kind = what.rpartition(", ")[2]
            if done == of or 10 * done // of > told.get(kind, -1):
                told[kind] = 10 * done // of
                print(f"{what}: {done} of {of}", file=sys.stderr, flush=True)

        yield tell
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        tasks: dict[str, Any] = {}

        def show(what: str, done: int, of: int) -> None:
            kind = what.rpartition(", ")[2]
            if kind not in tasks:
                tasks[kind] = bar.add_task(what, total=of)
            bar.update(tasks[kind], description=what, completed=done, total=of)

        yield show


def _first_lines(written: Sequence[Path]) -> str:
    """Return where the report lies and how much was written beside it."""
    reports = [file for file in written if file.name == "report.md"]
    return "\n".join(f"report: {file} ({len(written)} files)" for file in reports)
