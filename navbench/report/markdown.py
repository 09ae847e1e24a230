"""A report in Markdown, as GitHub shows it."""

import re
from collections.abc import Sequence

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

NUMBER = re.compile(r"[-+\[]*(\d|inf\b)")


def render(document: Document) -> str:
    """Return a report in Markdown; its links are relative to it."""
    parts = [f"# {document.title}\n", *([f"\n{document.summary.strip()}\n"] if document.summary else [])]
    for i, block in enumerate(document.blocks):
        listed = isinstance(block, Finding) and i and isinstance(document.blocks[i - 1], Finding)
        parts.append(("" if listed else "\n") + _block(block))
    return "".join(parts)


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    right = aligned_right(len(headings), rows)
    lines = [headings, ["---:" if is_right else "---" for is_right in right], *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def aligned_right(count: int, rows: Sequence[Sequence[str]]) -> list[bool]:
    """Return which columns are aligned to the right: those whose entries begin like numbers."""
    return [
        i > 0 and all(not row[i] or row[i] == MISSING or NUMBER.match(row[i]) for row in rows) for i in range(count)
    ]


def _block(block: Block) -> str:
    match block:
        case Heading(text, level):
            return f"{'#' * level} {text}\n"
        case Paragraph(text):
            return f"{text.strip()}\n"
        case Problem(text):
            return f"**Not made:** {text}\n"
        case Lines(lines):
            return "".join(f"- {line}\n" for line in lines)
        case Link(text, file):
            return f"[{text}]({file})\n"
        case Finding():
            return f"- {block.text}\n"
        case Plot(_, caption):
            return f"![{caption}]({block.files['PNG']})\n\n*{caption}* [SVG]({block.files['SVG']})\n"
        case Table():
            return _table(block)


def _table(block: Table) -> str:
    links = ", ".join(f"[{form}]({file})" for form, file in block.files.items())
    if block.title:
        return f"{block.title}: {links}\n"
    columns, rows = block.printed
    headings = [f"{column.group}: {column.heading}" if column.group else column.heading for column in columns]
    return table(headings, rows) + (f"\n{links}\n" if links else "")
