"""A plan carried out for a person: its progress, its tables, what an interrupt leaves, and the exit code."""

import logging
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from navbench.cli.progress import Step, complain, progress
from navbench.cli.tables import write_tables
from navbench.experiments.plan import Plan
from navbench.experiments.running import run_plan
from navbench.experiments.store import Results

UNFINISHED, INTERRUPTED = 3, 130  # exit codes


def carry_out(
    plan: Plan,
    path: Path,
    again: str,
    finish: Callable[[Results], None],
    wrong: Mapping[str, int] | None = None,
    **options: Any,
) -> int:
    """Run a plan, and return the exit code: 0 only if every planned episode has its row.

    Args:
        plan: what to run.
        path: the results directory.
        again: the command that goes on where this one stops.
        finish: prints and writes what the results are for, when all has been run that could be.
        wrong: what is planned but is not in the plan, for it cannot be run: why, and how many episodes each.
        options: workers, engine and other_code of ``run_plan``.

    Raises:
        DescriptionError: nothing of it can be run.
    """
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
    finish(ran.results)
    planned = ran.planned + sum((wrong or {}).values())
    if ran.finished == planned:
        return 0
    complain(f"{ran.finished} of {planned} planned episodes are there: {'; '.join([*(wrong or {}), *ran.reasons])}")
    return UNFINISHED
