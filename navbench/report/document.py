"""What a report is made of, as data: headings, paragraphs, findings, tables and plots; renderers turn it into text."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from numbers import Integral
from typing import Any, TypeAlias

MISSING = "–"
FORMS = {
    "value": "{value}",
    "interval": "{value} [{low}, {high}]",
    "count": "{held} of {n}",
    "held": "{held} of {n} [{low}, {high}]",
    "percent": "{percent} %",
    "share": "{held} of {n}: {value} [{low}, {high}]",
    "of": "{value} [{low}, {high}] of {n}",
}

COUNTED = ("count", "held", "share")
RARE = "rare"  # an interval, and the count of cases where the decimals show none

Cell: TypeAlias = Any  # a word, a number, a figure with its interval (value, low, high, n), or None where there is none


def number(value: float, decimals: int | None = None, signed: bool = False) -> str:
    """Return a number with so many decimals, without any to four digits; a dash where it is missing."""
    if math.isnan(value):
        return MISSING
    sign = "+" if signed else ""
    text = f"{value:{sign}.4g}" if decimals is None else f"{value:{sign}.{decimals}f}"
    return text.lstrip("-") if decimals is not None and float(text) == 0.0 else text


def words(cell: Cell, show: str = "interval", decimals: int | None = None, signed: bool = False) -> str:
    """Return a table's entry or a finding's figure as it is printed.

    Args:
        cell: the entry.
        show: for a figure with its interval, a key of ``FORMS``; an interval without width is left out. Or ``rare``.
        decimals: of its numbers; None for four digits.
        signed: whether a plus stands before what is greater than 0.
    """
    if cell is None:
        return MISSING
    if isinstance(cell, str | Integral):
        return str(cell)
    if not isinstance(cell, tuple):
        return number(float(cell), decimals, signed)
    value, low, high, n = cell
    if math.isnan(value):
        return MISSING
    told = {name: number(x, decimals, signed) for name, x in (("value", value), ("low", low), ("high", high))}
    if show == RARE:
        show = "count" if told["low"] == told["high"] else "interval"
    form = FORMS["value" if show == "interval" and (low == high or math.isnan(low)) else show]
    if show in COUNTED:
        told["held"] = str(round(value * n))
    return form.format(**told, n=n, percent=f"{100.0 * value:.0f}")


@dataclass(frozen=True, slots=True)
class Heading:
    """A heading; level 1 is the report's title."""

    text: str
    level: int = 2


@dataclass(frozen=True, slots=True)
class Paragraph:
    """Words, with Markdown's marks within the line."""

    text: str


@dataclass(frozen=True, slots=True)
class Lines:
    """A list of words, such as the episodes that failed."""

    lines: Sequence[str]


@dataclass(frozen=True, slots=True)
class Link:
    """A link to a file, relative to the report."""

    text: str
    file: str


@dataclass(frozen=True, slots=True)
class Figure:
    """A measured figure.

    Attributes:
        words: how it is printed.
        value: the figure; None, as the others, where there was no case.
        low: the lower end of its interval or range.
        high: the upper end.
        n: of how many cases.
    """

    words: str
    value: float | None
    low: float | None
    high: float | None
    n: int


@dataclass(frozen=True, slots=True)
class Finding:
    """A sentence with its measured figures.

    Attributes:
        say: the sentence, with a name in braces for each figure.
        figures: the figures by name.
    """

    say: str
    figures: Mapping[str, Figure]

    @property
    def text(self) -> str:
        """The sentence as it is printed."""
        return self.say.format(**{name: figure.words for name, figure in self.figures.items()})


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table.

    Attributes:
        title: its heading; None for one that only the CSV file holds.
        name: what the CSV file calls it; empty for one that is only printed.
        unit: of its numbers.
        decimals: of its printed numbers; None for four digits.
        show: how a figure with its interval is printed, as for ``words``; the CSV file holds all of it.
        group: a heading above those of several columns.
    """

    title: str | None
    name: str = ""
    unit: str = ""
    decimals: int | None = None
    show: str = "interval"
    group: str = ""

    @property
    def heading(self) -> str:
        """The title with the unit."""
        return f"{self.title} [{self.unit}]" if self.unit else str(self.title)


@dataclass(frozen=True, slots=True)
class Data:
    """What a table's CSV file holds where that is not what is printed: names and rows."""

    names: Sequence[str]
    rows: Sequence[Sequence[Cell]]


@dataclass(frozen=True, slots=True)
class Table:
    """A table, printed, as CSV and as LaTeX.

    Attributes:
        file: the files' name below ``tables/``; empty for a table that is only printed.
        columns: its columns.
        rows: its entries.
        data: for the CSV file, where that is not the table itself.
        title: of a table that is only linked to, what the link says; empty for one that is printed.
        csv: the CSV file, relative to the report; empty for the usual place.
    """

    file: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    data: Data | None = None
    title: str = ""
    csv: str = ""

    @property
    def files(self) -> dict[str, str]:
        """Its files by their form, relative to the report."""
        if not self.file:
            return {}
        return {"CSV": self.csv or f"tables/{self.file}.csv", "LaTeX": f"tables/{self.file}.tex"}

    @property
    def printed(self) -> tuple[Sequence[Column], list[list[str]]]:
        """The columns and entries that are printed, as words."""
        shown = [(i, column) for i, column in enumerate(self.columns) if column.title is not None]
        rows = [[words(row[i], column.show, column.decimals) for i, column in shown] for row in self.rows]
        return [column for _, column in shown], rows

    @property
    def raw(self) -> Data:
        """What the CSV file holds: a figure with its interval fills four columns."""
        if self.data is not None:
            return self.data
        names: list[str] = []
        entries: list[Sequence[Cell]] = []
        for column, cells in zip(self.columns, zip(*self.rows, strict=True), strict=True):
            if not column.name:
                continue
            if any(isinstance(cell, tuple) for cell in cells):
                names += [column.name, *(f"{column.name}_{part}" for part in ("low", "high", "n"))]
                entries += zip(*(cell or (None,) * 4 for cell in cells), strict=True)
            else:
                names.append(column.name)
                entries.append(cells)
        return Data(names, list(zip(*entries, strict=True)))


@dataclass(frozen=True, slots=True)
class Plot:
    """A picture.

    Attributes:
        file: the files' name below ``figures/``.
        caption: what it shows, which is also what stands for it where it cannot be seen.
    """

    file: str
    caption: str

    @property
    def files(self) -> dict[str, str]:
        """Its files by their form, relative to the report."""
        return {form: f"figures/{self.file}.{form.lower()}" for form in ("PNG", "SVG")}


@dataclass(frozen=True, slots=True)
class Problem:
    """Why a part of the report is not there, which the command line says, too, and ends with another exit code."""

    text: str


Block: TypeAlias = Heading | Paragraph | Lines | Link | Finding | Table | Plot | Problem
Blocks: TypeAlias = Sequence[Block]


@dataclass(frozen=True, slots=True)
class Document:
    """A report.

    Attributes:
        title: its title.
        blocks: what it consists of, in order.
        summary: what it says first.
        errata: what a paper prints wrong or leaves open: ``where``, ``printed`` and ``here``.
    """

    title: str
    blocks: Blocks
    summary: str = ""
    errata: Sequence[Mapping[str, str]] = field(default=())

    @property
    def problems(self) -> list[str]:
        """Why parts of it are not there."""
        return [block.text for block in self.blocks if isinstance(block, Problem)]

    @property
    def files(self) -> list[str]:
        """The files that it links to, relative to it."""
        found: dict[str, None] = {}
        for block in self.blocks:
            if isinstance(block, Link):
                found[block.file] = None
            elif isinstance(block, Table | Plot):
                found |= dict.fromkeys(block.files.values())
        return list(found)

    def findings(self) -> dict[str, Any]:
        """Return what it found as plain values, for ``findings.json``."""
        told = [
            {"text": block.text, "figures": {name: asdict(figure) for name, figure in block.figures.items()}}
            for block in self.blocks
            if isinstance(block, Finding)
        ]
        errata = [dict(item) for item in self.errata]
        return {"title": self.title, "summary": self.summary, "findings": told, "errata": errata}
