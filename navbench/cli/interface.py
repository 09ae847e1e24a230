"""The Python interface: what the command line does, with objects where it has names, and results that stay at hand."""

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from threading import RLock
from typing import Any, NamedTuple, TypeAlias, TypeVar

from navbench.cli.check import UNLESS_GIVEN
from navbench.cli.composing import composing, key_of
from navbench.cli.configuration import cell_of
from navbench.cli.engine import Where, where_of
from navbench.cli.errors import check_flags, one_line_errors, path_of, texts
from navbench.cli.given import AnyController, AnyRobot, AnySensors, AnyWorld, Values, given_words
from navbench.cli.limits import check_directory
from navbench.cli.result import Result
from navbench.cli.tables import write_tables
from navbench.experiments.cells import Cell
from navbench.experiments.conformance import Finding, findings
from navbench.experiments.plan import Plan
from navbench.experiments.running import Progress, run_plan
from navbench.experiments.store import Results
from navbench.validation import DescriptionError

T = TypeVar("T")
Several: TypeAlias = T | Sequence[T]

RUNNING = RLock()  # processes are shared, and an engine may speak to the streams of this one


class Asked(NamedTuple):
    """What words and arguments ask for.

    Attributes:
        cells: to be run.
        wrong: why others of a sweep cannot be run.
        where: an engine and how many workers.
    """

    cells: list[Cell]
    wrong: list[str]
    where: Where


def run(
    *words: str,
    controller: AnyController | None = None,
    world: AnyWorld | None = None,
    robot: AnyRobot | None = None,
    sensors: AnySensors | None = None,
    simulator: Values | None = None,
    episodes: int | None = None,
    episode: int | None = None,
    seed: int | None = None,
    start_jitter_m: float | None = None,
    start_heading_jitter_rad: float | None = None,
    metrics: Sequence[str] | None = None,
    workers: int | None = None,
    dir: str | Path | None = None,
    config_dir: str | Path | None = None,
    overwrite: bool = False,
    other_code: bool = False,
    progress: Progress = lambda *_: None,
) -> Result:
    """Run one cell, as the command line would: the same numbers, to the last bit.

    Whatever is not given is what the command line would take. Each of the five parts may be a name of the catalogue, a
    YAML file (a ``Path``, or a word that ends in .yaml), or a mapping of what stands in one, in which ``name`` says
    what results call it: of a world, the name of its random streams, too. A mapping may inherit, by
    ``"defaults": ["deadlock", "_self_"]``. A world, a robot and sensors may be a ``World``, ``Robot`` or ``Sensors``.

    Threads take turns.

    Args:
        words: of the command line, such as "simulator.drive=limited", "sensors.noise_std_m=0.01".
        controller: also an object with ``reset`` and ``act``, of which each robot of each episode has a copy; or what
            makes one: a class, a function, or a ``functools.partial`` with the parameters; alone, or as a mapping's
            ``build``. A file that ends in .onnx is a trained network, see ``conf/controller/policy.yaml``.
        world: where it drives.
        robot: what it drives; None for the robot that the world was drawn for.
        sensors: what it may know; None for what the controller needs.
        simulator: what moves and measures, such as "planar".
        episodes: how many.
        episode: the one episode of this index alone.
        seed: of every random stream.
        start_jitter_m: starts move at random by up to this [m].
        start_heading_jitter_rad: and turn by up to this [rad].
        metrics: further ones, each as module.function.
        workers: processes; None for one a core.
        dir: where the results go, stored as by the command line: what an earlier call with the same arguments finished
            there is not run again. None for a temporary directory that lives as long as what is returned. What an
            object does is only known from its class's file and its state: one of a class that lies in no file, as in
            a notebook, is run anew.
        config_dir: a folder with further controllers, worlds, robots and sensors.
        overwrite: whether finished parts in ``dir`` that are not of this work may be removed.
        other_code: whether to keep what other code made in ``dir``.
        progress: told what is under way, how much of it is done, and of how much.

    Returns:
        What was measured; also where some episodes are missing, as ``Result.reasons`` say.

    Raises:
        DescriptionError: a ValueError of one line: an unknown choice or key, a wrong value, parts that do not fit
            together, a directory that holds other work or in which another run goes on.
    """
    choices = {
        "controller": controller, "world": world, "robot": robot, "sensors": sensors, "simulator": simulator,
        "episodes": episodes, "episode": episode, "seed": seed, "start_jitter_m": start_jitter_m,
        "start_heading_jitter_rad": start_heading_jitter_rad, "metrics": metrics, "workers": workers,
    }  # fmt: skip
    with one_line_errors():
        asked = cells_of(words, choices, config_dir)
        return _carried_out(asked, dir, progress, overwrite=overwrite, other_code=other_code)


def sweep(
    *words: str,
    controller: Several[AnyController] | None = None,
    world: Several[AnyWorld] | None = None,
    robot: Several[AnyRobot] | None = None,
    sensors: Several[AnySensors] | None = None,
    simulator: Several[Values] | None = None,
    episodes: int | None = None,
    seed: Several[int] | None = None,
    start_jitter_m: Several[float] | None = None,
    start_heading_jitter_rad: Several[float] | None = None,
    metrics: Sequence[str] | None = None,
    workers: int | None = None,
    dir: str | Path | None = None,
    config_dir: str | Path | None = None,
    overwrite: bool = False,
    other_code: bool = False,
    progress: Progress = lambda *_: None,
) -> Result:
    """Run every combination, side by side, as the command line does with ``-m``.

    Arguments as of ``run``, and lists of them; in words, commas stand between several values. A combination that cannot
    be run costs nothing else: ``Result.reasons`` tell of it.

    Raises:
        DescriptionError: as ``run``; or no combination can be run.
    """
    choices = {
        "controller": controller, "world": world, "robot": robot, "sensors": sensors, "simulator": simulator,
        "episodes": episodes, "seed": seed, "start_jitter_m": start_jitter_m,
        "start_heading_jitter_rad": start_heading_jitter_rad, "metrics": metrics, "workers": workers,
    }  # fmt: skip
    with one_line_errors():
        asked = cells_of(words, choices, config_dir, sweep=True)
        return _carried_out(asked, dir, progress, overwrite=overwrite, other_code=other_code)


def load(path: str | Path) -> Result:
    """Return what a results directory holds, of a run, a sweep or a study.

    Raises:
        DescriptionError: there are no results.
    """
    folder = path_of("path", path)
    with one_line_errors():
        check_directory(f"load {path}", folder)
        return Result(folder)


def check(
    controller: AnyController,
    *words: str,
    world: AnyWorld | None = None,
    robot: AnyRobot | None = None,
    sensors: AnySensors | None = None,
    simulator: Values | None = None,
    episodes: int | None = None,
    seed: int | None = None,
    config_dir: str | Path | None = None,
) -> list[Finding]:
    """Hold a controller against the contract, as ``navbench check``; arguments as of ``run``.

    Returns:
        What each check found: its ``verdict`` ("ok", "note" or "FAIL"), its ``name``, and a line that says what.

    Raises:
        DescriptionError: as ``run``.
    """
    choices = {
        "controller": controller, "world": world, "robot": robot, "sensors": sensors, "simulator": simulator,
        "episodes": episodes, "seed": seed,
    }  # fmt: skip
    given = {*map(key_of, texts(words)), *(key for key, value in choices.items() if value is not None)}
    added = [f"{key}={value}" for key, value in UNLESS_GIVEN.items() if key not in given]
    with one_line_errors():
        (cell,) = cells_of([*added, *words], choices, config_dir).cells
        return list(findings(cell))


def cells_of(
    words: Sequence[str], choices: Mapping[str, Any], config_dir: str | Path | None = None, *, sweep: bool = False
) -> Asked:
    """Return the cells that words and arguments describe.

    Args:
        words: of the command line.
        choices: further ones, see ``given_words``.
        config_dir: a folder with further controllers, worlds and robots.
        sweep: whether several values may be given.

    Raises:
        DescriptionError: a wrong value; and what ``Composer.command`` raises.
    """
    folder = None if config_dir is None else path_of("config_dir", config_dir)
    for word in texts(words):
        if key_of(word).startswith("hydra"):
            raise DescriptionError(f"{word}: is for the command line; here the argument dir says where results go")
    given = given_words(words, choices, folder, sweep=sweep)
    makers = {thing.name: thing.make for thing in given.things if thing.make is not None}
    with composing(folder, [thing[:3] for thing in given.things]) as composer:
        composed = list(composer.command("run", given.words, sweep=sweep)[0])
    cells, wrong = [], []
    for index, one in enumerate(composed):
        try:
            cells.append(cell_of(one, makers))
        except DescriptionError as error:
            if len(composed) == 1:
                raise
            wrong.append(f"cell {index}: {error}")
    if not cells:
        raise DescriptionError(wrong[0])
    return Asked(cells, wrong, where_of(composed[0].values))


def _carried_out(asked: Asked, dir: str | Path | None, progress: Progress, **kept: Any) -> Result:
    """Run cells and return what they did; arguments as of ``run``."""
    check_flags(**kept)
    if not callable(progress):
        raise DescriptionError(
            f"progress={progress!r:.80}: must be a function of what is under way, done, and of how many"
        )
    own = tempfile.TemporaryDirectory(prefix="navbench-", ignore_cleanup_errors=True) if dir is None else None
    path = path_of("dir", own.name if own else dir)
    if path.exists() and not path.is_dir():
        raise DescriptionError(f"{path}: is a file; results need a directory")
    with RUNNING:
        ran = run_plan(Plan(cells=tuple(asked.cells)), path, progress=progress, **asked.where, **kept)
        if own is None:
            write_tables(Results(path))
    return Result(path, (*asked.wrong, *ran.reasons), own)
