"""A report in Markdown, as GitHub shows it."""

import re
from collections.abc import Sequence

from navbench.reading import flat, printable
from navbench.report.document import (
    MISSING,
    Block,
    Document,
    Finding,
    Heading,
    Lines,
    Link,
    Paragraph,
    Plot,
    Problem,
    Table,
)

TAG = re.compile(r"<(?=[A-Za-z/!?])")
LINK = re.compile(r"\]\((?!\s*(?:https?://|[\w./%#~+-]+[\s)]|\)))")  # to what is neither on the web nor a file
NAMED = re.compile(r"^([\s>*+-]*\[[^\]\n]+\]):", re.M)  # a link's target in a line of its own
PICTURE = re.compile(r"!(?=\[)")
NUMBER = re.compile(r"[-+\[]*(\d|inf\b)")


def render(document: Document) -> str:
    """Return a report in Markdown; its links are relative to it."""
    summary = [f"\n{words(document.summary.strip())}\n"] if document.summary else []
    parts = [f"# {line(document.title)}\n", *summary]
    for i, block in enumerate(document.blocks):
        listed = isinstance(block, Finding) and i and isinstance(document.blocks[i - 1], Finding)
        parts.append(("" if listed else "\n") + _block(block))
    return "".join(parts)


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    right = aligned_right(len(headings), rows)
    lines = [headings, ["---:" if is_right else "---" for is_right in right], *rows]
    return "".join("| " + " | ".join(map(cell, row)) + " |\n" for row in lines)


def words(text: str) -> str:
    """Return words with Markdown's marks as they are shown; HTML, pictures and links that are none do nothing.

    What stands in results may come from anybody, and a page that shows it may run what it finds.
    """
    text = TAG.sub("&lt;", printable(text))
    text = NAMED.sub(r"\1\\:", LINK.sub(r"]\\(", text))
    return PICTURE.sub(r"!\\", text)


def line(text: str) -> str:
    """Return words as they are shown on one line."""
    return words(flat(text))


def cell(text: str) -> str:
    """Return words as they are shown in a table."""
    return line(text).replace("|", "\\|")


def aligned_right(count: int, rows: Sequence[Sequence[str]]) -> list[bool]:
    """Return which columns are aligned to the right: those whose entries begin like numbers."""
    return [
        i > 0 and all(not row[i] or row[i] == MISSING or NUMBER.match(row[i]) for row in rows) for i in range(count)
    ]


def _block(block: Block) -> str:
    match block:
        case Heading(text, level):
            return f"{'#' * level} {line(text)}\n"
        case Paragraph(text):
            return f"{words(text.strip())}\n"
        case Problem(text):
            return f"**Not made:** {line(text)}\n"
        case Lines(lines):
            return "".join(f"- {line(one)}\n" for one in lines)
        case Link(text, file):
            return f"[{line(text)}]({file})\n"
        case Finding():
            return f"- {line(block.text)}\n"
        case Plot(_, caption):
            shown = line(caption)
            return f"![{shown}]({block.files['PNG']})\n\n*{shown}* [SVG]({block.files['SVG']})\n"
        case Table():
            return _table(block)


def _table(block: Table) -> str:
    links = ", ".join(f"[{form}]({file})" for form, file in block.files.items())
    if block.title:
        return f"{line(block.title)}: {links}\n"
    columns, rows = block.printed
    headings = [f"{column.group}: {column.heading}" if column.group else column.heading for column in columns]
    return table(headings, rows) + (f"\n{links}\n" if links else "")
