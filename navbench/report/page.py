"""What every section of a report is given, and how a study's outline names it.

A section is ``function(page, **arguments) -> blocks``: ``page`` reads the results and keeps figures, the arguments
stand in the study's outline beside the keys that every section has: ``name``, ``title``, ``text`` (what stands in
front), ``file`` (what its tables and figures are called) and ``caption`` (of its figure).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from navbench.analysis.stored import StoredResults
from navbench.report.document import Blocks, Cell, Column, Data, Plot, Table
from navbench.report.figures import Style, save_figure, styles
from navbench.robot import Robot
from navbench.validation import describe

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Section: TypeAlias = Callable[..., Blocks]
Select: TypeAlias = Mapping[str, Any]


@dataclass(frozen=True)
class Page:
    """What a section is given.

    Attributes:
        stored: the stored results.
        out: the report's directory.
        file: what its tables and figures are called.
        caption: of its figure.
        trust: whether measures outside navbench may be run.
    """

    stored: StoredResults
    out: Path
    file: str = ""
    caption: str = ""
    trust: bool = False

    @cached_property
    def styles(self) -> Mapping[str, Style]:
        """How each label is drawn."""
        return styles(self.stored.labels)

    def table(
        self, columns: Sequence[Column], rows: Sequence[Sequence[Cell]], data: Data | None = None, more: str = ""
    ) -> Table:
        """Return a table under the section's name and, where wanted, more behind it."""
        return Table(f"{self.file}{more}", columns, rows, data)

    def plot(self, figure: "Figure", caption: str = "", more: str = "") -> Plot:
        """Save a figure under the section's name and, where wanted, more behind it, and return it."""
        save_figure(figure, self.out, f"{self.file}{more}")
        return Plot(f"{self.file}{more}", caption or self.caption)

    def first(self, select: Select) -> Mapping[Any, Any]:
        """Return the first matching row of the table of episodes."""
        return self.stored.select(**select).to_dict("records")[0]

    def robot(self, run_id: str) -> Robot:
        """Return a cell's robot."""
        return describe(Robot, self.stored.configuration(run_id)["configuration"]["robot"], "robot")
