"""Episodes in memory, asked as stored results are: run for a moment's measurement, and kept nowhere."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.stored import CELL, PAIR, StoredResults, Used
from navbench.experiments.cells import Cell
from navbench.experiments.manifest import described
from navbench.experiments.rows import episode_rows, trajectory_columns
from navbench.experiments.store import Results, ResultsError
from navbench.records import NOT_DRIVEN, CellKey, RobotRecord
from navbench.world.layout import DrawnWorld

if TYPE_CHECKING:
    import pandas as pd

Places = dict[tuple[object, ...], dict[str, tuple[NDArray[np.intp], ...]]]  # by the shape of a sample and the question
Offered = dict[str, tuple[Mapping[str, Any], "dict[str, pd.DataFrame]"]]
Ran = Sequence[tuple[Cell, CellKey, Sequence[tuple[int, RobotRecord]]]]  # cells with (episode, record) pairs
FIXED = (*CELL, *PAIR)  # columns that are the same in all samples of the same cells and episodes
SHAPES_MAX = 100


class Sample(StoredResults):
    """What some cells did.

    Args:
        study: what the manifest of stored results would say of their study.
        ran: the cells with what results know of them, and with their records.
        places: where in the table of episodes lies what was asked of earlier samples, to be added to: in those of the
            same cells and as many episodes it lies there again.
        offered: by controller the configuration of the last one, and what that offers of itself, to be replaced.
    """

    def __init__(
        self, study: Mapping[str, Any], ran: Ran, places: Places | None = None, offered: Offered | None = None
    ) -> None:
        self._ran = ran
        self._known = {} if places is None else places
        self._offered = {} if offered is None else offered
        self.results = _Nowhere(study, [key for _, key, _ in ran])
        self._trajectories, self._used = {}, Used()
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
        words = {name: pd.Series(of, dtype=object) for name, of in columns.items() if isinstance(of[0], str)}
        return pd.DataFrame({**columns, **words, "case": words.get("run_id"), "place": range(len(rows))})

    @cached_property
    def _others(self) -> "pd.DataFrame":
        """The table of episodes with the names that columns have on a pair's other side."""
        return self.episodes.drop(columns=list(PAIR)).add_suffix("_other")

    @cached_property
    def _there(self) -> dict[str, tuple["NDArray[np.intp]", ...]]:
        """Where what was asked lies in the table of episodes of every sample of the same cells and episodes."""
        first = {key.run_id: i for i, (_, key, _) in reversed(list(enumerate(self._ran)))}  # of runs that are the same
        shape = tuple(
            (
                *(first[key.run_id], key.name, key.label, key.names, key.tuning, key.tuning_seed, key.seed),
                *((episode, one.robot_index) for episode, one in records if one.outcome not in NOT_DRIVEN),
            )
            for _, key, records in self._ran
        )
        if len(self._known) > SHAPES_MAX:
            self._known.clear()
        return self._known.setdefault(shape, {})

    def select(self, *, same_case: Sequence[str] = (), **wanted: Any) -> "pd.DataFrame":
        """As of stored results; what is asked for several claims is looked for once."""
        return self._chosen("select", super().select, same_case=same_case, **wanted)

    def cases(self, **wanted: Any) -> "pd.DataFrame":
        """As of stored results."""
        return self._chosen("cases", super().cases, **wanted)

    def pairs(self, select: Mapping[str, Any], than: Mapping[str, Any], each: bool = False) -> "pd.DataFrame":
        """As of stored results."""
        import pandas as pd

        asked = {"select": select, "than": than, "each": each}
        if not (_is_fixed(select) and _is_fixed(than)):
            return self._once("pairs", super().pairs, **asked)

        def look(**_: Any) -> "pd.DataFrame":
            place = repr(("pairs", asked))
            if place not in self._there:
                rows = super(Sample, self).pairs(select, than, each)
                self._there[place] = rows["place"].to_numpy(), rows["place_other"].to_numpy()
            sides = zip((self.episodes, self._others), self._there[place], strict=True)
            return pd.concat([table.take(places).reset_index(drop=True) for table, places in sides], axis=1)

        return self._once("pairs", look, **asked)

    def _chosen(self, name: str, look: Callable[..., "pd.DataFrame"], /, **wanted: Any) -> "pd.DataFrame":
        if not _is_fixed(wanted):
            return self._once(name, look, **wanted)

        def take(**_: Any) -> "pd.DataFrame":
            place = repr((name, wanted))
            if place not in self._there:
                self._there[place] = (look(**wanted)["place"].to_numpy(),)
            return self.episodes.take(self._there[place][0])

        return self._once(name, take, **wanted)

    def _once(self, name: str, look: Callable[..., "pd.DataFrame"], /, **asked: Any) -> "pd.DataFrame":
        place = repr((name, asked))
        if place not in self._found:
            self._found[place] = look(**asked)
        return self._found[place]

    def _note(self, rows: "pd.DataFrame") -> None:
        """Note nothing: that no claim looks elsewhere is known before."""

    def world(self, run_id: str, episode: int = 0) -> DrawnWorld:
        """Return what was driven in an episode."""
        for index, record in self._records.get(run_id, ()):
            if index == episode and isinstance(record.layout, DrawnWorld):
                return record.layout
        raise ResultsError(f"{run_id}: no layout in episode {episode}")

    @cached_property
    def descriptions(self) -> "dict[str, pd.DataFrame]":
        """The tables that the controllers offer of themselves, the first cell of each controller's."""
        import pandas as pd

        found: dict[str, pd.DataFrame] = {}
        for name, cell in {cell.names.controller: cell for cell, _, _ in reversed(self._ran)}.items():
            configuration = cell.configuration["controller"]
            if name not in self._offered or self._offered[name][0] != configuration:
                controller: Any = cell.make_controller()
                tables = controller.describe() if hasattr(controller, "describe") else {}
                frames = {f"{name}-{part}": pd.DataFrame(dict(table)) for part, table in tables.items()}
                self._offered[name] = configuration, frames
            found |= self._offered[name][1]
        return found

    def trajectories(self, run_id: str) -> "pd.DataFrame":
        """Return the trajectories of one run."""
        import pandas as pd

        if run_id not in self._trajectories:
            columns = trajectory_columns(self._records[run_id])
            self._trajectories[run_id] = pd.DataFrame({"run_id": run_id, **columns})
        return self._trajectories[run_id]

    def trajectory(self, row: Mapping[Any, Any]) -> "pd.DataFrame":
        """As of stored results."""
        first = 0
        for episode, record in self._records[row["run_id"]]:
            last = first + len(record.states)
            if episode == row["episode"] and record.robot_index == row["robot_index"]:
                return self.trajectories(row["run_id"]).iloc[first:last]
            first = last
        raise ResultsError(f"{row['run_id']}: no trajectory of episode {row['episode']}")

    @cached_property
    def _records(self) -> dict[str, Sequence[tuple[int, RobotRecord]]]:
        return {key.run_id: records for _, key, records in reversed(self._ran)}


def _is_fixed(wanted: Mapping[str, Any]) -> bool:
    """Return whether what is asked for lies at the same place in all samples of one shape."""
    return all(column in FIXED or (column == "same_case" and not of) for column, of in wanted.items())


class _Nowhere(Results):
    """Results that were never stored, of which there are no evaluations."""

    def __init__(self, study: Mapping[str, Any], keys: Sequence[CellKey]) -> None:
        super().__init__(Path("a reconstruction"))
        self._study, self._keys = study, keys

    def manifest(self) -> dict[str, Any]:
        """Return what the manifest of stored results would say of study and cells."""
        return {"study": self._study, "cells": [described(key) for key in self._keys], "tunings": []}

    def evaluations(self) -> "pd.DataFrame":
        """Say that there are none."""
        raise ResultsError("a reconstruction tunes nothing")
