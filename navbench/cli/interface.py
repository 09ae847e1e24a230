"""The Python interface: what the command line does, returned as a table."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from navbench.cli.composing import composing
from navbench.cli.configuration import cell_of
from navbench.cli.engine import where_of
from navbench.cli.errors import one_line
from navbench.experiments.plan import Plan
from navbench.experiments.running import run_plan
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    import pandas as pd


def run_to_table(overrides: Sequence[str], path: str | Path | None, config_dir: str | None) -> "pd.DataFrame":
    """Run one cell and return its table of episodes; see ``navbench.run``."""
    try:
        with composing(config_dir) as composer:
            run = composer.values("run", overrides)
            cell, where = cell_of(run), where_of(run.values)
    except Exception as error:  # Hydra composes with errors of many kinds
        raise DescriptionError(one_line(error)) from error
    with tempfile.TemporaryDirectory() as folder:
        ran = run_plan(Plan(cells=(cell,)), Path(folder if path is None else path), **where)
        if ran.finished < ran.planned:
            raise DescriptionError(f"{ran.finished} of {ran.planned} episodes are there: {'; '.join(ran.reasons)}")
        return ran.results.episodes()
