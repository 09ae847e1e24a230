"""A report as one page that needs nothing beside itself: tables that sort, claims that open, episodes that play.

The page is opened from a disk, sent by mail, kept for years, without a build step and without a network. One file of
plain JavaScript does that: the page's only state is which episode, which robot and when, for which a framework would
cost bytes and a build. What is written in it comes from a template that escapes it, and no other script may run.
"""

import base64
import hashlib
import html
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navbench.report.document import Block, Column, Document, Figure, Finding, Heading, Table, words
from navbench.report.figures import PALETTE
from navbench.report.markdown import aligned_right
from navbench.report.playback import Playback

if TYPE_CHECKING:
    from jinja2 import Template

COLOURS = 64  # of a picture
CHOSEN_BY = ("verdict", "evidence", "outcome", "controller", "world", "kind")  # columns whose values may be chosen
CONTROLS = {code: 0x2400 + code for code in range(32) if code not in b"\t\n"} | {0x7F: 0x2421}  # as visible symbols
CHOICES = 30  # of a column at most
SLUG = re.compile(r"[^a-z0-9]+")
MARKS = (  # Markdown's within a line, after the words are escaped
    (re.compile(r"`([^`]+)`"), r"<code>\1</code>"),
    (re.compile(r"\*\*([^*]+)\*\*"), r"<strong>\1</strong>"),
    (re.compile(r"(?<!\*)\*([^*]+)\*(?!\*)"), r"<em>\1</em>"),
    (re.compile(r"\[([^\]]+)\]\((https?://[^)\s]+|[\w./#-]+)\)"), r'<a href="\2">\1</a>'),
)


def render(document: Document, out: Path, played: Playback | None = None) -> str:
    """Return a report as a page.

    Args:
        document: the report.
        out: its directory, with the pictures that the page holds.
        played: the episodes that the page plays.
    """
    parts = _parts(document.blocks)
    script = _file("js")
    allowed = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    finds = [any(isinstance(block, Finding) for block in part["blocks"]) for part in parts]
    page = _template(out).render(
        title=document.title,
        summary=document.summary,
        first=[part for part, is_first in zip(parts, finds, strict=True) if is_first],
        rest=[part for part, is_first in zip(parts, finds, strict=True) if not is_first],
        verdicts=_verdicts(document.blocks),
        played=played,
        colours=PALETTE,
        style=_file("css"),
        script=script,
        allowed=allowed,
    )
    return page.translate(CONTROLS)


def _template(out: Path) -> "Template":
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined)
    environment.filters |= {"marked": marked, "table": _table, "slug": slug, "figure": _figure, "page": _page}
    environment.filters["picture"] = lambda file: _picture(out / file)
    environment.tests["block"] = lambda block, name: type(block).__name__ == name
    return environment.from_string(_file("html"))


def _file(kind: str) -> str:
    return files(__package__).joinpath(f"web/page.{kind}").read_text("utf-8")


def marked(text: str) -> Any:
    """Return words with Markdown's marks within the line as HTML, and all else escaped."""
    from markupsafe import Markup

    told = html.escape(text.strip())
    for mark, tag in MARKS:
        told = mark.sub(tag, told)
    return Markup(told)


def slug(text: str) -> str:
    """Return words as a name that an address or a class may hold."""
    return SLUG.sub("-", text.lower()).strip("-")


def _parts(blocks: Sequence[Block]) -> list[dict[str, Any]]:
    """Return a report's sections: each one's title, the name of its place in the page, and its blocks."""
    parts: list[dict[str, Any]] = []
    for block in blocks:
        if isinstance(block, Heading) and block.level <= 2 or not parts:
            title = block.text if isinstance(block, Heading) else ""
            parts.append({"title": title, "place": f"part-{len(parts) + 1}", "blocks": []})
            if title:
                continue
        parts[-1]["blocks"].append(block)
    return parts


def _verdicts(blocks: Iterable[Block]) -> dict[str, int]:
    """Return how many claims have which verdict."""
    counts: dict[str, int] = {}
    for block in blocks:
        if isinstance(block, Table) and block.data is not None and {"kind", "verdict"} <= set(block.data.names):
            for row in (dict(zip(block.data.names, values, strict=True)) for values in block.data.rows):
                if row["kind"] in ("claim", "hypothesis") and row["verdict"]:
                    verdict = str(row["verdict"]).replace("_", " ")
                    counts[verdict] = counts.get(verdict, 0) + 1
    return counts


def _page(file: str) -> str:
    """Return the file behind a link, for another report its page."""
    return re.sub(r"(^|/)report\.md$", r"\1report.html", file)


def _figure(figure: Figure) -> str:
    return words(None if figure.value is None else (figure.value, figure.low, figure.high, figure.n), "of")


def _picture(file: Path) -> str:
    """Return a picture as it is held in the page, in few colours; nothing where it is not there."""
    from PIL import Image

    if not file.is_file():
        return ""
    held = io.BytesIO()
    with Image.open(file) as picture:
        picture.convert("RGB").quantize(COLOURS).save(held, "PNG", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(held.getvalue()).decode()}"


def _table(table: Table) -> dict[str, Any]:
    """Return what the page shows of a table.

    Returns:
        ``columns``: each one's heading, and whether it is aligned to the right and may be chosen by; ``groups``:
        headings above several, with their widths; ``rows`` of ``cells``: each one's text, the number that it is sorted
        by, and where its interval is drawn; and of each row the ``details`` that are not printed.
    """
    columns, printed = table.printed
    shown = [i for i, column in enumerate(table.columns) if column.title is not None]
    right = aligned_right(len(columns), printed)
    details = _details(table, columns)
    scales = [None if table.columns[i].show == "count" else _scale([row[i] for row in table.rows]) for i in shown]
    groups = [(title, len(list(of))) for title, of in groupby(columns, lambda column: column.group)]
    rows = [
        {
            "cells": [
                {"text": text, "sort": _number(row[i]), "interval": _interval(row[i], scale)}
                for i, text, scale in zip(shown, texts, scales, strict=True)
            ],
            "details": details.get(texts[0], []),
        }
        for row, texts in zip(table.rows, printed, strict=True)
    ]
    choices = [_choices(column, [row[i] for row in printed]) for i, column in enumerate(columns)]
    heads = [
        {"heading": column.heading, "right": is_right, "choices": of}
        for column, is_right, of in zip(columns, right, choices, strict=True)
    ]
    opened = next((i for i, column in enumerate(columns) if column.title in ("statement", "question")), 0)
    return {"columns": heads, "groups": groups if len(groups) > 1 else [], "rows": rows, "opened": opened}


def _choices(column: Column, texts: Sequence[str]) -> list[str]:
    """Return what a column's rows may be chosen by: what stands before a colon, as before a verdict's reason."""
    found = sorted({text.partition(":")[0] for text in texts})
    return found if column.title in CHOSEN_BY and 1 < len(found) <= CHOICES < 2 * len(texts) + CHOICES else []


def _details(table: Table, columns: Sequence[Column]) -> Mapping[str, list[tuple[str, str]]]:
    """Return what the CSV file says of each row beside what is printed, by the row's id."""
    if table.data is None or "id" not in table.data.names or not columns or columns[0].title != "id":
        return {}
    told = [dict(zip(table.data.names, row, strict=True)) for row in table.data.rows]
    return {
        str(row["id"]): [
            (name.replace("_", " "), text)
            for name, value in row.items()
            if name not in ("id", "kind", "statement") and (text := words(value)) not in ("", words(None))
        ]
        for row in told
    }


def _number(cell: Any) -> float | None:
    """Return the number that an entry is sorted by; None for words, by which the page sorts then."""
    value = cell[0] if isinstance(cell, tuple) else cell
    return None if value is None or isinstance(value, str) or value != value else float(value)


def _scale(cells: Iterable[Any]) -> tuple[float, float]:
    """Return the least and the greatest end of a column's intervals."""
    ends = [float(end) for cell in cells if isinstance(cell, tuple) for end in cell[:3] if end == end]
    low, high = min(ends, default=0.0), max(ends, default=0.0)
    return (0.0, 1.0) if low >= 0.0 and high <= 1.0 else (low, high)


def _interval(cell: Any, scale: tuple[float, float] | None) -> tuple[float, float, float] | None:
    """Return where an interval begins, its width, and where its value stands, in percent of its column's scale."""
    if scale is None or not isinstance(cell, tuple) or any(end != end for end in cell[:3]):
        return None
    low, high = scale
    if not 0.0 < high - low < float("inf"):
        return None
    value, begin, end = (100.0 * (float(x) - low) / (high - low) for x in cell[:3])
    return round(begin, 1), round(end - begin, 1), round(value, 1)
