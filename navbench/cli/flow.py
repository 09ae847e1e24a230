"""A plan carried out for a person: its progress, its tables, what an interrupt leaves, and the exit code."""

import logging
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from navbench.cli.errors import one_line
from navbench.cli.progress import Step, complain, progress
from navbench.cli.tables import write_tables
from navbench.experiments.plan import Plan
from navbench.experiments.running import run_plan
from navbench.experiments.store import Results
from navbench.validation import DescriptionError

UNFINISHED, INTERRUPTED = 3, 130  # exit codes


def carry_out(
    plan: Plan,
    path: Path,
    again: str,
    finish: Callable[[Results], None],
    missing: int = 0,
    **options: Any,
) -> int:
    """Run a plan, and return the exit code: 0 only if every planned episode has its row.

    Args:
        plan: what to run.
        path: the results directory.
        again: the command that goes on where this one stops.
        finish: prints and writes what the results are for, when all has been run that could be.
        missing: how many episodes were asked for but are not in the plan, for their cells cannot be run.
        options: workers, engine and other_code of ``run_plan``.

    Raises:
        DescriptionError: nothing of it can be run.
    """
    if path.exists() and not path.is_dir():
        raise DescriptionError(f"{path}: is a file; results need a directory")
    logging.basicConfig(format="navbench: %(message)s", stream=sys.stderr)
    step: Step | None = None
    try:
        with progress() as told:
            try:
                ran = run_plan(plan, path, progress=told, **options)
            finally:
                step = told.last
    except KeyboardInterrupt:
        if not (path / "manifest.json").is_file():
            complain("interrupted before anything was finished; nothing is kept")
            return INTERRUPTED
        if (path / "episodes").is_dir():
            write_tables(Results(path))
        far = f" after {step.done} of {step.of} {step.what.split()[-1]}" if step else ""
        complain(f"interrupted{far}; they are kept in {path}, and this goes on from there: {again}")
        return INTERRUPTED
    except OSError as error:  # a full disk, say
        if step is None or not Results(path).finished():
            raise
        kinds = f"{step.done} of {step.of} {step.what.split()[-1]}"
        complain(f"{kinds} are kept in {path}: {one_line(error)}; this goes on from there: {again}")
        return UNFINISHED
    finish(ran.results)
    planned = ran.planned + missing
    if ran.finished == planned:
        return 0
    reasons = [*(["the cells named above cannot be run"] if missing else []), *ran.reasons]
    complain(f"{ran.finished} of {planned} planned episodes are there: {'; '.join(reasons)}")
    return UNFINISHED
