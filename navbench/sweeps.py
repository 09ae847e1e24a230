"""The end of a sweep: one joined table of its cells, printed and written."""

from pathlib import Path
from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from navbench.store import Results, write_table
from navbench.tables import failures, summarize, to_markdown, to_text


class JoinedTable(Callback):
    """Joins the results directories of a sweep when its last cell has ended."""

    def on_multirun_end(self, config: DictConfig, **_: Any) -> None:
        """Print the joined table and write it beside the cells, as CSV and Markdown."""
        import pandas as pd

        path = Path(config.hydra.sweep.dir)
        runs = [Results(manifest.parent) for manifest in sorted(path.glob("*/manifest.json"))]
        if not runs:
            return
        episodes = pd.concat([run.episodes() for run in runs], ignore_index=True)
        summary = summarize(episodes)
        write_table(path / "table.csv", summary.to_csv(index=False))
        write_table(path / "table.md", to_markdown(summary))
        print(to_text(summary))
        for line in failures(episodes):
            print(line)
        print(f"results: {path}")
