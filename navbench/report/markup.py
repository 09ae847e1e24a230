"""Tables in three forms: Markdown to read, CSV to compute with, LaTeX (booktabs) to print."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from navbench.experiments.store import write_table

if TYPE_CHECKING:
    import pandas as pd

MISSING = "–"
LATEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "±": r"$\pm$",
    "×": r"$\times$",
    "<": r"$<$",
    ">": r"$>$",
    MISSING: "--",
    "…": r"\dots{}",
}


def save_table(
    out: Path,
    stem: str,
    raw: "pd.DataFrame",
    headers: Sequence[str],
    rows: Sequence[Sequence[str]],
    groups: Mapping[str, int] | None = None,
) -> str:
    """Write a table below ``tables/`` as CSV and LaTeX, and return it in Markdown with links to both.

    Args:
        out: the report's directory.
        stem: the files' name without its ending.
        raw: the numbers, for the CSV file.
        headers: of the printed table; the first column is aligned to the left, the others to the right.
        rows: its entries, as words.
        groups: how many columns stand under a common heading, from the second column on; None for no headings.
    """
    write_table(out / "tables" / f"{stem}.csv", raw.to_csv(index=False))
    write_table(out / "tables" / f"{stem}.tex", latex(headers, rows, groups))
    above = [f"{title}: " for title, columns in (groups or {}).items() for _ in range(columns)]
    above = ["", *above] if groups else [""] * len(headers)
    full = [first + header for first, header in zip(above, headers, strict=True)]
    return f"{markdown(full, rows)}\n[CSV](tables/{stem}.csv), [LaTeX](tables/{stem}.tex)\n"


def markdown(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in GitHub's Markdown."""
    right = _right(headers, rows)
    lines = [headers, ["---:" if is_right else "---" for is_right in right], *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def latex(headers: Sequence[str], rows: Sequence[Sequence[str]], groups: Mapping[str, int] | None = None) -> str:
    """Return a table in LaTeX; it needs the package booktabs."""
    columns = "".join("r" if is_right else "l" for is_right in _right(headers, rows))
    lines = [f"\\begin{{tabular}}{{{columns}}}", "\\toprule"]
    if groups:
        titles = [f"\\multicolumn{{{count}}}{{c}}{{{escape(title)}}}" for title, count in groups.items()]
        lines.append(" & ".join(["", *titles]) + " \\\\")
        first, rules = 2, []
        for count in groups.values():
            rules.append(f"\\cmidrule(lr){{{first}-{first + count - 1}}}")
            first += count
        lines.append(" ".join(rules))
    lines += [_latex_row(headers), "\\midrule", *map(_latex_row, rows), "\\bottomrule", "\\end{tabular}"]
    return "\n".join(lines) + "\n"


def escape(text: str) -> str:
    """Return words as LaTeX prints them."""
    return "".join(LATEX.get(letter, letter) for letter in text)


def number(value: float, decimals: int) -> str:
    """Return a number with so many decimals; a dash where it is missing, a word where it is infinite."""
    if math.isnan(value):
        return MISSING
    if math.isinf(value):
        return "inf" if value > 0 else "-inf"
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def between(low: float, high: float, decimals: int) -> str:
    """Return an interval or a range."""
    return f"[{number(low, decimals)}, {number(high, decimals)}]"


def _right(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> list[bool]:
    """Return which columns are aligned to the right: those whose entries begin like numbers."""
    return [
        i > 0 and all(not row[i] or row[i] == MISSING or row[i][0] in "-0123456789[" for row in rows)
        for i in range(len(headers))
    ]


def _latex_row(cells: Sequence[str]) -> str:
    # a bracket at the beginning of a row would be read as the argument of the \\ before it
    return " & ".join(("{}" if cell.startswith("[") else "") + escape(cell) for cell in cells) + " \\\\"
