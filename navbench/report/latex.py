"""Tables in LaTeX; they need the package booktabs."""

from collections.abc import Sequence
from itertools import groupby

from navbench.reading import flat
from navbench.report.document import MISSING, Table
from navbench.report.markdown import aligned_right

ESCAPED = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        **{letter: f"\\{letter}" for letter in "&%$#_{}"},
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "±": r"$\pm$",
        "×": r"$\times$",
        "²": r"$^2$",
        "↓": r"$\downarrow$",
        "↑": r"$\uparrow$",
        "<": r"$<$",
        ">": r"$>$",
        MISSING: "--",
        "…": r"\dots{}",
    }
)


def render(table: Table) -> str:
    """Return a table in LaTeX."""
    columns, rows = table.printed
    letters = "".join("r" if is_right else "l" for is_right in aligned_right(len(columns), rows))
    lines = [f"\\begin{{tabular}}{{{letters}}}", "\\toprule"]
    if any(column.group for column in columns):
        titles, rules, first = [], [], 1
        for title, members in groupby(column.group for column in columns):
            count = len(list(members))
            titles.append(f"\\multicolumn{{{count}}}{{c}}{{{_words(title)}}}" if title else "")
            rules += [f"\\cmidrule(lr){{{first}-{first + count - 1}}}"] if title else []
            first += count
        lines += [" & ".join(titles) + " \\\\", " ".join(rules)]
    lines += [_row([column.heading for column in columns]), "\\midrule", *map(_row, rows)]
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}"]) + "\n"


def _words(text: str) -> str:
    return flat(text).translate(ESCAPED)


def _row(cells: Sequence[str]) -> str:
    # a bracket at the beginning of a row would be read as the argument of the \\ before it
    return " & ".join(("{}" if cell.startswith("[") else "") + _words(cell) for cell in cells) + " \\\\"
