"""A plan carried out for a person: its progress, its tables, what an interrupt leaves, and the exit code."""

import errno
import logging
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import Any

from navbench.cli.errors import one_line
from navbench.cli.progress import UNFINISHED, Step, complain, progress
from navbench.cli.tables import write_tables
from navbench.experiments.plan import Plan
from navbench.experiments.running import run_plan
from navbench.experiments.store import Results
from navbench.experiments.workers import MachineError
from navbench.validation import DescriptionError

NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)  # on the disk
INTERRUPTED = 130  # the exit code
NEEDED = ("pandas", "matplotlib.image")  # by tables and pictures, and imported while processes run episodes


def carry_out(
    plan: Plan,
    path: Path,
    again: Sequence[str],
    finish: Callable[[Results], int | None],
    missing: int = 0,
    **options: Any,
) -> int:
    """Run a plan, and return the exit code: 0 only if every planned episode has its row, and all is written.

    Args:
        plan: what to run.
        path: the results directory.
        again: the words of the command line that goes on where this one stops.
        finish: prints and writes what the results are for, when all was run that could be; may return an exit code.
        missing: how many episodes were asked for but are not in the plan, for their cells cannot be run.
        options: workers, engine, other_code and overwrite of ``run_plan``.

    Raises:
        DescriptionError: nothing of it can be run.
    """
    if path.exists() and not path.is_dir():
        raise DescriptionError(f"{path}: is a file; results need a directory")
    logging.basicConfig(format="navbench: %(message)s", stream=sys.stderr)
    step: Step | None = None
    stage = ""
    try:
        with _importing(), progress() as told:
            try:
                ran = run_plan(plan, path, progress=told, **options)
            finally:
                step = told.last
        step, stage = Step("episodes", ran.finished, ran.planned), ", while tables and figures were written"
        code = finish(ran.results) or 0
    except (KeyboardInterrupt, OSError, MachineError, MemoryError) as error:  # of a full disk, say
        return _stopped(error, step, stage, path, shlex.join(["navbench", *again]))
    planned = ran.planned + missing
    if ran.finished == planned:
        return code
    reasons = [*(["the cells named above cannot be run"] if missing else []), *ran.reasons]
    complain(f"{ran.finished} of {planned} planned episodes are there: {'; '.join(reasons)}")
    return UNFINISHED


@contextmanager
def _importing() -> Iterator[None]:
    """Import meanwhile what is needed thereafter."""
    thread = Thread(target=lambda: [import_module(module) for module in NEEDED])
    thread.start()
    try:
        yield
    finally:
        thread.join()


def _stopped(error: BaseException, step: Step | None, stage: str, path: Path, again: str) -> int:
    """Say what is kept and how to go on, and return the exit code.

    Raises:
        OSError: nothing was begun.
    """
    interrupted = isinstance(error, KeyboardInterrupt)
    if isinstance(error, OSError) and not (error.filename or stage):
        error.filename = str(path)
    kept = (path / "manifest.json").is_file()
    by_machine = isinstance(error, MachineError) or isinstance(error, OSError) and error.errno in NO_ROOM
    if by_machine and not kept:
        complain(f"{one_line(error)}; nothing is kept")
        return UNFINISHED
    if not interrupted and not (kept and step):
        raise error
    if not kept:
        complain("interrupted before anything was finished; nothing is kept")
        return INTERRUPTED
    far = f"{step.done} of {step.of} {step.what.split()[-1]}" if step else ""
    what = f"out of memory: {one_line(error)}" if isinstance(error, MemoryError) else one_line(error)
    said = f"interrupted{' after ' if far else ''}{far}" if interrupted else f"{what}: after {far}"
    kept_so_far = "they are" if far else "what was finished is"
    complain(f"{said}{stage}; {kept_so_far} kept in {path}, and this goes on from there: {again}")
    if interrupted and not stage and (path / "episodes").is_dir():
        write_tables(Results(path))
    return INTERRUPTED if interrupted else UNFINISHED
