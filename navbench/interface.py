"""The Python interface: what the command line does, returned as a table."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from navbench.configuration import compose_cell
from navbench.running import run_cells

if TYPE_CHECKING:
    import pandas as pd


def run_to_table(overrides: Sequence[str], path: str | Path | None, config_dir: str | None) -> "pd.DataFrame":
    """Run one cell and return its table of episodes; see ``navbench.run``."""
    cell = compose_cell(*overrides, config_dir=config_dir)
    if path is not None:
        return run_cells([cell], Path(path)).episodes()
    with tempfile.TemporaryDirectory() as folder:
        return run_cells([cell], Path(folder)).episodes()
