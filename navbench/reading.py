"""A results directory as tables: its episodes, trajectories and evaluations beside what its cells are called."""

from functools import cached_property
from typing import TYPE_CHECKING, Any

from navbench.description import DescriptionError, describe
from navbench.store import Results
from navbench.world import World

if TYPE_CHECKING:
    import pandas as pd


class Reading:
    """A results directory, read once.

    Args:
        results: the directory.
    """

    def __init__(self, results: Results) -> None:
        self.results = results
        self.manifest = results.manifest()
        self._trajectories: dict[str, pd.DataFrame] = {}

    @cached_property
    def episodes(self) -> "pd.DataFrame":
        """The table of episodes, with each cell's name, label, tuning and tuning_seed in front.

        A cell that stands under two names gives its rows twice.
        """
        return self.cells.merge(self.results.episodes(), on="run_id")

    def trajectory(self, run_id: str) -> "pd.DataFrame":
        """Return the trajectories of one run."""
        if run_id not in self._trajectories:
            self._trajectories[run_id] = self.results.trajectories(run_id)
        return self._trajectories[run_id]

    @cached_property
    def evaluations(self) -> "pd.DataFrame":
        """The table of evaluations.

        Raises:
            ResultsError: nothing was tuned.
        """
        return self.results.evaluations()

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

    def world(self, run_id: str) -> World:
        """Return the world of a cell."""
        cell = self.configuration(run_id)
        return describe(World, {"name": cell["world"], **cell["configuration"]["world"]}, "world")

    @cached_property
    def labels(self) -> list[str]:
        """The labels of all cells, in the order in which the study first names them."""
        return list(dict.fromkeys(cell["label"] for cell in self.manifest["cells"]))

    def select(self, **wanted: Any) -> "pd.DataFrame":
        """Return the episodes of the cells that match: a value for each column, or a list of allowed ones.

        Raises:
            DescriptionError: there is no such column, or no episode matches.
        """
        rows = self.episodes
        for column, value in wanted.items():
            if column not in rows.columns:
                raise DescriptionError(f"select.{column}: there is no such column; allowed: {', '.join(rows.columns)}")
            rows = rows[rows[column].isin(value if isinstance(value, list) else [value])]
        if rows.empty:
            raise DescriptionError(f"{self.results.path}: no episodes match {wanted}")
        return rows
