"""Episodes in memory, asked as stored results are: run for a moment's measurement, and kept nowhere."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from navbench.analysis.stored import StoredResults, Used
from navbench.experiments.cells import Cell
from navbench.experiments.manifest import described
from navbench.experiments.rows import episode_rows, trajectory_table
from navbench.experiments.store import Results, ResultsError
from navbench.records import NOT_DRIVEN, RobotRecord
from navbench.world.layout import DrawnWorld

if TYPE_CHECKING:
    import pandas as pd

Ran = Sequence[tuple[Cell, Sequence[tuple[int, RobotRecord]]]]  # cells with (episode, record) pairs


class Sample(StoredResults):
    """What some cells did.

    Args:
        study: what the manifest of stored results would say of their study.
        ran: the cells with their records.
    """

    def __init__(self, study: Mapping[str, Any], ran: Ran) -> None:
        self._ran = [(cell, cell.key(), records) for cell, records in ran]
        self.results = _Nowhere(Path("a reconstruction"))
        self.manifest = {"study": study, "cells": [described(key) for _, key, _ in self._ran], "tunings": []}
        self._trajectories, self._places, self._used = {}, {}, Used()
        self._found: dict[str, pd.DataFrame] = {}

    @cached_property
    def episodes(self) -> "pd.DataFrame":
        """As of stored results; each run is a case of its own."""
        import pandas as pd

        rows = [
            {"name": key.name, "label": key.label, "tuning": key.tuning, "tuning_seed": key.tuning_seed, **row}
            for _, key, records in self._ran
            for row in episode_rows(key, records, {})
            if row["outcome"] not in NOT_DRIVEN
        ]
        columns = {name: [row[name] for row in rows] for name in rows[0]} if rows else {}
        words = {name: np.array(of, dtype=object) for name, of in columns.items() if isinstance(of[0], str)}
        return pd.DataFrame({**columns, **words, "case": words.get("run_id")})

    def select(self, *, same_case: Sequence[str] = (), **wanted: Any) -> "pd.DataFrame":
        """As of stored results; what is asked for several claims is looked for once."""
        return self._once("select", super().select, same_case=same_case, **wanted)

    def cases(self, **wanted: Any) -> "pd.DataFrame":
        """As of stored results."""
        return self._once("cases", super().cases, **wanted)

    def pairs(self, select: Mapping[str, Any], than: Mapping[str, Any], each: bool = False) -> "pd.DataFrame":
        """As of stored results."""
        return self._once("pairs", super().pairs, select=select, than=than, each=each)

    def _once(self, name: str, look: Callable[..., "pd.DataFrame"], /, **asked: Any) -> "pd.DataFrame":
        place = repr((name, asked))
        if place not in self._found:
            self._found[place] = look(**asked)
        return self._found[place]

    def _note(self, rows: "pd.DataFrame") -> None:
        """Note nothing: that no claim looks elsewhere is known before."""

    def world(self, run_id: str, episode: int = 0) -> DrawnWorld:
        """Return what was driven in an episode."""
        for _, key, records in self._ran:
            for index, record in records if key.run_id == run_id else ():
                if index == episode and isinstance(record.layout, DrawnWorld):
                    return record.layout
        raise ResultsError(f"{run_id}: no layout in episode {episode}")

    @cached_property
    def descriptions(self) -> "dict[str, pd.DataFrame]":
        """The tables that the controllers offer of themselves, the first cell of each controller's."""
        import pandas as pd

        found: dict[str, pd.DataFrame] = {}
        for name, cell in {cell.names.controller: cell for cell, _, _ in reversed(self._ran)}.items():
            controller: Any = cell.make_controller()
            tables = controller.describe() if hasattr(controller, "describe") else {}
            found |= {f"{name}-{part}": pd.DataFrame(dict(table)) for part, table in tables.items()}
        return found

    def trajectories(self, run_id: str) -> "pd.DataFrame":
        """Return the trajectories of one run."""
        if run_id not in self._trajectories:
            key, records = next((key, records) for _, key, records in self._ran if key.run_id == run_id)
            self._trajectories[run_id] = trajectory_table(key, records).to_pandas()
        return self._trajectories[run_id]


class _Nowhere(Results):
    """Results that were never stored, of which there are no evaluations."""

    def evaluations(self) -> "pd.DataFrame":
        """Say that there are none."""
        raise ResultsError("a reconstruction tunes nothing")
