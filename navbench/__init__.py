"""Compare reactive navigation controllers of wheeled robots in simulated worlds."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

if not (Path(__file__).parent / "conf").is_dir():  # in the source tree conf and controllers stand beside this folder
    __path__.append(str(Path(__file__).parents[1]))

__version__ = "0.1.0"


def run(*overrides: str, path: str | Path | None = None, config_dir: str | None = None) -> "pd.DataFrame":
    """Run one cell, as the command line would, and return its table of episodes: one row a robot and episode.

    Args:
        overrides: the words of the command line, such as "controller=sflc", "world=deadlock", "episodes=10".
        path: where to keep the results; None keeps none.
        config_dir: a folder with further controllers, worlds and robots.

    Raises:
        ValueError: an unknown choice or key, a wrong value, or parts that do not fit together.
    """
    from navbench.cli.interface import run_to_table

    return run_to_table(overrides, path, config_dir)
