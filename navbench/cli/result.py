"""What was measured, as tables and pictures: of a run, a sweep or a study, just run or stored long ago."""

import html
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from navbench.analysis.stored import StoredResults
from navbench.cli.errors import check_flags, one_line_errors, path_of
from navbench.experiments.store import Results
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

ROWS_MAX = 60  # of a table that stands in a notebook


class Result:
    """What a run, a sweep or a study left.

    Attributes:
        path: the results directory; a temporary one is removed with the object.
        reasons: why what is missing could not be run, a line each; () where it was loaded.
    """

    def __init__(self, path: Path, reasons: tuple[str, ...] = (), keeps: object = None) -> None:
        self.path, self.reasons, self._keeps = path, reasons, keeps
        self._stored = StoredResults(Results(path))

    @property
    def planned(self) -> int:
        """How many episodes were to be run, over all cells."""
        return int(self._stored.manifest["planned"]["episodes"])

    @property
    def finished(self) -> int:
        """How many of them are there."""
        return self._stored.finished

    @cached_property
    def episodes(self) -> "pd.DataFrame":
        """One row a robot and episode, with all metrics, as ``episodes.csv`` has it.

        Sorted by run_id, episode and robot_index, with an index that counts the rows from 0.
        """
        return self._stored.rows.reset_index(drop=True)

    @cached_property
    def trajectories(self) -> "pd.DataFrame":
        """One row a control period of each robot, and one for its end, with pose, speeds and the controller's trace.

        Sorted by run_id, episode, robot_index and t_s, with an index that counts the rows from 0.
        """
        return self._stored.results.trajectories()

    @cached_property
    def layouts(self) -> "pd.DataFrame":
        """One row a distinct layout: ``layout_id``, as ``episodes`` have it, and ``layout``, its geometry as JSON.

        Sorted by layout_id, with an index that counts the rows from 0.
        """
        import pandas as pd

        return pd.DataFrame(sorted(self._stored.results.layouts().items()), columns=["layout_id", "layout"])

    @cached_property
    def table(self) -> "pd.DataFrame":
        """One row a cell, as ``table.csv`` has it: who arrived, and the means of those; the index counts the rows."""
        from navbench.cli.tables import table_of

        return table_of(self._stored.results)

    def plot(self, episode: int | None = None, robot: int | None = None, **cell: str) -> "Figure":
        """Return the picture of one episode that ``navbench show`` draws; a notebook needs ``%matplotlib inline``.

        Args:
            episode: its index; None for the first in which a robot failed.
            robot: which robot stands in front of the others; None for all.
            cell: where there are several, which: ``run_id`` (which may be cut short), ``name``, ``label``, ``world``.

        Raises:
            DescriptionError: there is no such episode, robot or cell, or no trajectories are kept of it.
        """
        from navbench.cli.show import picture_of

        with one_line_errors():
            return picture_of(self._stored, {key: str(name) for key, name in cell.items()}, episode, robot).figure

    def report(self, out: str | Path, *, trust: bool = False, config_dir: str | None = None) -> Path:
        """Write the report of ``navbench report`` into a directory, and return its ``report.html``.

        Args:
            out: the directory.
            trust: whether measures and sections that stored results name outside navbench may be run.
            config_dir: the folder with the study, where the results do not say it.

        Raises:
            DescriptionError: the results cannot be reported, or a part of the report cannot be made; the rest is there.
        """
        from navbench.report.reports import write_report

        folder = path_of("out", out)
        check_flags(trust=trust)
        given = None if config_dir is None else str(path_of("config_dir", config_dir))
        with one_line_errors():
            written = write_report([self._stored.results], folder, trust=trust, config_dir=given)
        if written.problems:
            raise DescriptionError("; ".join(written.problems))
        return folder / "report.html"

    def __repr__(self) -> str:
        """Return how much is there, and the table that the command line prints."""
        from navbench.report.tables import to_text

        return "\n".join([self._says, *self.reasons, *([to_text(self.table)] if self.finished else [])])

    def _repr_html_(self) -> str:
        """Return the same for a notebook, where nothing in it is taken for a tag."""
        from navbench.report.tables import to_text

        lines = [self._says, *self.reasons]
        if len(self.table) > ROWS_MAX:
            lines.append(f"the first {ROWS_MAX} of {len(self.table)} cells:")
        said = "".join(f"<p>{html.escape(line)}</p>" for line in lines)
        return said + (to_text(self.table.head(ROWS_MAX), "html") if self.finished else "")

    @property
    def _says(self) -> str:
        cells = len(self._stored.planned)
        return f"{self.finished} of {self.planned} planned episodes, {cells} cell{'s' if cells != 1 else ''}"
