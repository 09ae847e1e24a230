"""A results directory as tables: its episodes, trajectories and evaluations beside what its cells are called."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.cases import cases_of, was_driven
from navbench.experiments.store import Results, ResultsError
from navbench.metrics import DECLARED, Metric
from navbench.records import NOT_DRIVEN
from navbench.validation import DescriptionError, instead
from navbench.world.layout import DrawnWorld, in_common, layout_of
from navbench.world.world import drawn

if TYPE_CHECKING:
    import pandas as pd

PAIR = ["world", "seed", "episode", "robot_index"]  # two controllers that share these met the same start and noise
SELECTABLE = (  # what chooses cells or robots; "cell" is a study's name of some cells
    *("cell", "label", "tuning", "tuning_seed", "controller", "world", "robot", "sensors", "simulator"),
    *("seed", "episode", "robot_index", "same_case"),
)
CELL = ("name", "label", "tuning", "tuning_seed", "controller", "robot", "sensors", "simulator")


@dataclass(slots=True)
class Used:
    """What was looked at.

    Attributes:
        cells: simulator, name and run_id of the cells whose episodes were selected, and of tunings, without run_id.
        tables: the names of the tables that controllers offered of themselves.
    """

    cells: set[tuple[str, str, str]] = field(default_factory=set)
    tables: set[str] = field(default_factory=set)

    @property
    def simulators(self) -> dict[str, set[str]]:
        """The names of the cells by their simulator."""
        return {simulator: {name for of, name, _ in self.cells if of == simulator} for simulator, _, _ in self.cells}


class StoredResults:
    """A results directory, read once.

    Args:
        results: the directory.
    """

    def __init__(self, results: Results) -> None:
        self.results = results
        self._trajectories: dict[str, pd.DataFrame] = {}
        self._places: dict[str, Mapping[Any, Any]] = {}
        self._used = Used()
        self._name = uuid4().hex
        self.manifest  # noqa: B018  (read here, where an error of it belongs)

    def __reduce__(self) -> tuple[object, ...]:
        """Travel to another process as the directory alone, to be read there, once for all that is asked of it."""
        return _read, (self._name, self.results)

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """The manifest."""
        return self.results.manifest()

    @cached_property
    def rows(self) -> "pd.DataFrame":
        """The table of episodes as it is stored, with the episodes of which no layout could be drawn."""
        rows = self.results.episodes()
        return rows[rows["run_id"].isin(list(self._entries))]  # others may stand there while a study is changed

    @cached_property
    def episodes(self) -> "pd.DataFrame":
        """The table of the episodes that were driven, with each cell's name, label, tuning and tuning_seed in front.

        A cell that stands under two names gives its rows twice. Rows that share ``case`` and their start are one case.
        """
        rows = self.cells.merge(driven(self.rows), on="run_id")
        return rows.assign(case=rows["run_id"].map(cases_of(self.manifest)))

    @cached_property
    def planned(self) -> dict[str, set[int]]:
        """The episodes that were planned of each run."""
        found: dict[str, set[int]] = {}
        for cell in self.manifest["cells"]:
            first = cell["first_episode"]
            found.setdefault(cell["run_id"], set()).update(range(first, first + cell["episodes"]))
        return found

    @cached_property
    def finished(self) -> int:
        """How many of the planned episodes are there."""
        cells = self.cells[["run_id", "tuning", "tuning_seed"]].drop_duplicates()  # as a plan counts its episodes
        return len(cells.merge(self.rows[["run_id", "episode"]].drop_duplicates()))

    @property
    def wanting(self) -> str:
        """How many of the planned episodes are there, where some are not; else nothing."""
        there, planned = self.finished, self.manifest["planned"]["episodes"]
        return f"{there} of {planned} planned episodes are there" if there < planned else ""

    @cached_property
    def missing(self) -> list[str]:
        """A sentence each on episodes that are not there, layouts that were not drawn, and impossible tasks."""
        scenes = self.rows["run_id"].map(lambda run_id: str(self.configuration(run_id)["configuration"]["world"]))
        layouts = self.rows.assign(scene=scenes).drop_duplicates(["scene", "world", "seed", "episode"])
        told = [f"{self.wanting}."] if self.wanting else []
        for outcome, says in NOT_DRIVEN.items():
            lost = layouts[layouts["outcome"] == outcome]
            if len(lost):
                first = f"{lost['world'].iloc[0]}, episode {lost['episode'].iloc[0]}: {lost['reason'].iloc[0]}"
                told.append(f"{len(lost)} of {len(layouts)} {says}, and count nowhere; the first of them in {first}")
        return told

    @cached_property
    def metrics(self) -> dict[str, Metric]:
        """What was measured, by name, as the manifest declares it."""
        told = [Metric(**metric) for metric in self.manifest.get("metrics", [])]
        return {metric.name: metric for metric in told or DECLARED}

    def sign_of(self, metric: str) -> int:
        """Return 1 where less of a metric is better, and -1 where more is.

        Raises:
            DescriptionError: neither is, or there is no such metric.
        """
        signs = {name: told.sign for name, told in self.metrics.items() if told.sign}
        if metric not in signs:
            raise DescriptionError(
                f"metric={metric}: must be one of which less or more is better, of {', '.join(signs)}"
            )
        return signs[metric]

    def trajectories(self, run_id: str) -> "pd.DataFrame":
        """Return the trajectories of one run."""
        if run_id not in self._trajectories:
            self._trajectories[run_id] = self.results.trajectories(run_id)
        return self._trajectories[run_id]

    def trajectory(self, row: Mapping[Any, Any]) -> "pd.DataFrame":
        """Return the trajectory that belongs to a row of the table of episodes."""
        run_id = row["run_id"]
        trajectories = self.trajectories(run_id)
        if run_id not in self._places:
            self._places[run_id] = trajectories.groupby(["episode", "robot_index"]).indices
        places = self._places[run_id].get((row["episode"], row["robot_index"]), [])
        trajectory: pd.DataFrame = trajectories.iloc[places]
        if not was_driven(trajectory, self.time_limit_s(run_id)):  # of results from anybody
            raise ResultsError(f"{self.results.path}: the trajectory of episode {row['episode']} was never driven")
        return trajectory

    @property
    def evaluations(self) -> "pd.DataFrame":
        """The table of evaluations.

        Raises:
            ResultsError: nothing was tuned.
        """
        self._note(self.checks[self.checks["kind"] == "searched"])
        return self._evaluations

    @cached_property
    def _evaluations(self) -> "pd.DataFrame":
        return self.results.evaluations()

    @cached_property
    def checks(self) -> "pd.DataFrame":
        """The table of what the best of each tuning cost when it was run again; without rows where none was."""
        return self.results.checks()

    @cached_property
    def descriptions(self) -> "dict[str, pd.DataFrame]":
        """The tables that controllers offered of themselves, by name."""
        return self.results.descriptions()

    def described(self, table: str, *columns: str) -> "pd.DataFrame":
        """Return a table that a controller offered of itself.

        Raises:
            DescriptionError: there is no such table, or it has no such column.
        """
        if table not in self.descriptions:
            allowed = ", ".join(self.descriptions) or "none"
            raise DescriptionError(f"{self.results.path}: no description {table!r}; there are: {allowed}")
        self._used.tables.add(table)
        rows = self.descriptions[table]
        for column in columns:
            if column not in rows.columns:
                allowed = ", ".join(rows.columns)
                raise DescriptionError(f"{self.results.path}: {table}: no column {column!r}; there are: {allowed}")
        return rows

    def described_rows(self, table: str, where: Mapping[str, Any]) -> "pd.DataFrame":
        """Return the rows of a described table that have these values in these columns."""
        rows = self.described(table, *where)
        for name, value in where.items():
            rows = rows[rows[name] == value]
        return rows

    def described_value(self, table: str, column: str, where: Mapping[str, Any]) -> float:
        """Return the value of a described table in the one row that matches.

        Raises:
            DescriptionError: as ``described``, or not exactly one row matches.
        """
        self.described(table, column)
        rows = self.described_rows(table, where)
        if len(rows) != 1:
            raise DescriptionError(f"{self.results.path}: {table}: {len(rows)} rows match {dict(where)}, not one")
        return float(rows[column].iloc[0])

    @cached_property
    def cells(self) -> "pd.DataFrame":
        """One row a cell: run_id, name, label, tuning, tuning_seed."""
        import pandas as pd

        names = ["run_id", "name", "label", "tuning", "tuning_seed"]
        return pd.DataFrame([[cell[name] for name in names] for cell in self.manifest["cells"]], columns=names)

    def configuration(self, run_id: str) -> dict[str, Any]:
        """Return a cell's entry in the manifest."""
        return self._entries[run_id]

    @cached_property
    def _entries(self) -> dict[str, dict[str, Any]]:
        return {cell["run_id"]: cell for cell in reversed(self.manifest["cells"])}

    def world(self, run_id: str, episode: int = 0) -> DrawnWorld:
        """Return what was driven in an episode: the world of a cell with the layout that is stored.

        Raises:
            ResultsError: there is none: none could be drawn, or the episode did not run.
        """
        layout = self._layouts.get(self._layout_ids.get((run_id, episode), ""))
        if layout is None:
            raise ResultsError(f"{self.results.path}: no layout is stored for episode {episode} of {run_id}")
        cell = self.configuration(run_id)
        world = cell["configuration"]["world"]
        return drawn(layout_of(layout), cell["world"], world["goal_tolerance_m"], world["time_limit_s"])

    def time_limit_s(self, run_id: str) -> float:
        """Return when the episodes of a cell end for every robot still running [s]."""
        return float(self.configuration(run_id)["configuration"]["world"]["time_limit_s"])

    def shared_time_limit_s(self, rows: "pd.DataFrame") -> float:
        """Return the one time limit of all cells of some episodes or pairs [s].

        Raises:
            DescriptionError: they have several.
        """
        runs = {run_id for column in ("run_id", "run_id_other") if column in rows for run_id in rows[column]}
        limits_s = {self.time_limit_s(run_id) for run_id in runs}
        if len(limits_s) != 1:
            worlds = ", ".join(sorted(set(rows["world"])))
            raise DescriptionError(f"{self.results.path}: {worlds}: the worlds must share one time limit")
        return limits_s.pop()

    def world_in_common(self, run_id: str) -> DrawnWorld | None:
        """Return what stands in all episodes of a cell, or None where no layout is stored."""
        distinct = {layout: episode for (run, episode), layout in self._layout_ids.items() if run == run_id and layout}
        return in_common([self.world(run_id, episode) for episode in distinct.values()]) if distinct else None

    @cached_property
    def _layouts(self) -> dict[str, str]:
        return self.results.layouts()

    @cached_property
    def _layout_ids(self) -> dict[tuple[str, int], str]:
        rows = self.rows
        return dict(zip(zip(rows["run_id"], rows["episode"], strict=True), rows["layout_id"], strict=True))

    @cached_property
    def labels(self) -> list[str]:
        """The labels of all cells, in the order in which the study first names them."""
        return list(dict.fromkeys(cell["label"] for cell in self.manifest["cells"]))

    def select(self, *, same_case: Sequence[str] = (), **wanted: Any) -> "pd.DataFrame":
        """Return the episodes of the cells that match: a value for each column, or a list of allowed ones.

        Args:
            same_case: what makes no other case of a start, such as ``[label, tuning_seed]`` of controllers that do the
                same; without it the column ``case`` tells, see ``cases_of``.
            wanted: the value, or values, of each column.

        Raises:
            DescriptionError: there is no such column, or no episode matches.
        """
        rows = self.episodes
        matching = np.ones(len(rows), dtype=bool)
        for column, value in wanted.items():
            if column not in rows.columns:
                raise DescriptionError(f"select.{column}: there is no such column; allowed: {', '.join(rows.columns)}")
            matching &= rows[column].isin(value if isinstance(value, list) else [value]).to_numpy()
        rows = rows[matching]
        if rows.empty:
            raise DescriptionError(f"{self.results.path}: no episodes match {wanted}")
        if wrong := [column for column in same_case if column not in CELL]:
            raise DescriptionError(f"select.same_case={wrong[0]}: {instead(wrong[0], CELL)}")
        if same_case:
            rows = rows.assign(case=rows[[column for column in CELL if column not in same_case]].apply(tuple, axis=1))
        self._note(rows)
        return rows

    def _note(self, rows: "pd.DataFrame") -> None:
        used = rows.reindex(columns=["simulator", "name", "run_id"], fill_value="")
        self._used.cells |= set(used.drop_duplicates().itertuples(index=False, name=None))

    def cases(self, **wanted: Any) -> "pd.DataFrame":
        """Return the independent cases among the episodes that match, see ``cases_of``; errors as of ``select``."""
        return self.select(**wanted).drop_duplicates(["case", *PAIR])

    @contextmanager
    def noting(self) -> Iterator[Used]:
        """Give what holds, at the end, all that was looked at meanwhile."""
        outer, inner = self._used, Used()
        self._used = inner
        try:
            yield inner
        finally:
            outer.cells |= inner.cells
            outer.tables |= inner.tables
            self._used = outer

    def sides(self, select: Mapping[str, Any], than: Mapping[str, Any]) -> tuple["pd.DataFrame", "pd.DataFrame"]:
        """Return the episodes of the cells that are compared, of the one and of the other.

        Raises:
            DescriptionError: they ran in different simulators.
        """
        sides = self.select(**select), self.select(**than)
        simulators = sorted({simulator for rows in sides for simulator in rows["simulator"].unique()})
        if len(simulators) > 1:
            labels = " and ".join(rows["label"].iloc[0] for rows in sides)
            raise DescriptionError(
                f"{self.results.path}: {labels} ran in {' and '.join(simulators)}; compare cells of one simulator"
            )
        return sides

    def pairs(self, select: Mapping[str, Any], than: Mapping[str, Any], each: bool = False) -> "pd.DataFrame":
        """Return the pairs of two controllers that met the same start and noise, the other's columns with "_other".

        Args:
            select: the cells of the one.
            than: the cells of the other.
            each: whether one that met the same start several times, as with several tunings, makes a pair for each of
                its independent cases.

        Raises:
            DescriptionError: one of them met a start several times, as with several tunings: pairs are not single;
                and as ``sides``.
        """
        sides = self.sides(select, than)
        for rows in sides:
            if not each and rows.duplicated(PAIR).any():
                raise DescriptionError(f"{self.results.path}: {rows['label'].iloc[0]} met the same start several times")
        rows = sides[0].merge(sides[1], on=PAIR, suffixes=("", "_other"))
        return rows.drop_duplicates([*PAIR, "case", "case_other"])


def driven(rows: "pd.DataFrame") -> "pd.DataFrame":
    """Return the rows of the robots that drove: those of episodes that were run."""
    return rows[~rows["outcome"].isin(list(NOT_DRIVEN))]


def reached(rows: "pd.DataFrame") -> "pd.DataFrame":
    """Return the rows of the robots that reached their goals."""
    return rows[rows["outcome"] == "reached"]


def outcomes(rows: "pd.DataFrame") -> dict[str, NDArray[np.bool_]]:
    """Return for both sides of some pairs, called "" and "_other", which of them reached."""
    return {side: (rows[f"outcome{side}"] == "reached").to_numpy(dtype=bool) for side in ("", "_other")}


def leaves_of(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Yield a configuration's dotted keys with their values as words."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from leaves_of(inner, f"{key}.{name}" if key else str(name))
    else:
        yield key, str(value)


_last_read: dict[str, StoredResults] = {}  # in this process, of another's


def _read(name: str, results: Results) -> StoredResults:
    """Return what another process knows by a name: the same object as before, where it was the last one."""
    if name not in _last_read:
        _last_read.clear()
        _last_read[name] = StoredResults(results)
    return _last_read[name]
