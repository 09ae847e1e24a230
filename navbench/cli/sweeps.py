"""A sweep's joined table; and the directories that a run or a sweep must not leave behind."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from navbench.experiments.store import Results, discard_empty, existing, write_table
from navbench.report.tables import failures, summarize, to_markdown, to_text

if TYPE_CHECKING:
    import pandas as pd

PANELS_MAX = 30  # a picture of more cells cannot be read


def join(runs: Sequence[Results], path: Path) -> None:
    """Print the joined table of a sweep's cells and write it beside them, as CSV, Markdown and a picture.

    Args:
        runs: the cells' results.
        path: the sweep's directory.
    """
    import pandas as pd

    from navbench.report.figures import save_trajectories

    episodes = pd.concat([run.episodes() for run in runs], ignore_index=True)
    episodes = episodes.drop_duplicates(["run_id", "episode", "robot_index"], ignore_index=True)  # of equal cells
    summary = _told_apart(summarize(episodes), [cell for run in runs for cell in run.manifest()["cells"]])
    write_table(path / "table.csv", summary.to_csv(index=False))
    write_table(path / "table.md", to_markdown(summary))
    if len(runs) <= PANELS_MAX:
        save_trajectories(runs, path / "trajectories.png")
    print(to_text(summary))
    for line in failures(episodes):
        print(line)
    print(f"results: {path}")


def _told_apart(summary: "pd.DataFrame", cells: Sequence[Mapping[str, Any]]) -> "pd.DataFrame":
    """Return the table with a column for each key of the configuration in which cells of the same names differ."""
    values = {cell["run_id"]: dict(_leaves(cell["configuration"])) for cell in cells}
    keys: dict[str, None] = {}
    for _, group in summary.groupby(["controller", "world", "robot", "sensors", "simulator"]):
        alike = [values[run_id] for run_id in group["run_id"]]
        every = dict.fromkeys(key for leaves in alike for key in leaves)
        keys |= dict.fromkeys(key for key in every if len({leaves.get(key) for leaves in alike}) > 1)
    for place, key in enumerate(keys):
        summary.insert(5 + place, key, [values[run_id].get(key, "") for run_id in summary["run_id"]])
    return summary


def _leaves(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Yield a configuration's dotted keys with their values as words."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _leaves(inner, f"{key}.{name}" if key else str(name))
    else:
        yield key, str(value)


class Made(NamedTuple):
    """A directory that Hydra makes, and the nearest one above it that was there before."""

    folder: Path
    there: Path


MADE: ContextVar[list[Made]] = ContextVar("MADE")  # set by the command line, filled by Hydra's callback


def discard_made(made: Sequence[Made]) -> None:
    """Remove those that hold nothing but what Hydra writes, and those above them."""
    for folder, there in made:
        if folder.is_dir() and folder != there and os.listdir(folder) == ["multirun.yaml"]:
            (folder / "multirun.yaml").unlink()
        discard_empty(folder, there)


class Remember(Callback):
    """Remembers the directories that Hydra makes for a run or a sweep, before it makes them."""

    def on_run_start(self, config: DictConfig, **_: Any) -> None:
        """Note what was there before a run."""
        self._there = _fixed_part(config.hydra.run)

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Note what was there before a sweep, and the sweep's own directory."""
        self._there = _fixed_part(config.hydra.sweep)
        MADE.get().append(Made(Path(config.hydra.sweep.dir).absolute(), self._there))

    def on_job_start(self, config: DictConfig, **_: Any) -> None:
        """Note the directory of a cell, before that of its sweep."""
        MADE.get().insert(0, Made(Path(config.hydra.runtime.output_dir), self._there))


def _fixed_part(node: DictConfig) -> Path:
    """Return the nearest directory that is there of what stands before the first ``${`` of a node's ``dir``."""
    written = OmegaConf.to_container(node, resolve=False)["dir"]  # type: ignore[index, call-overload]
    return existing(Path(str(written).split("${")[0]))
