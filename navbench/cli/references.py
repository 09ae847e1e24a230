"""What a study's claims and report ask for, held against the cells that it plans: before its first episode runs."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from navbench.analysis.claims import TABLES
from navbench.analysis.resolving import lies_outside
from navbench.cli.catalogue import files_of
from navbench.experiments.cells import Cell
from navbench.experiments.tunings import Tuning
from navbench.report.claims import asked
from navbench.validation import DescriptionError, instead

SELECTIONS = ("select", "than")  # under these keys stands which cells are meant
COLUMNS = ("name", "label", "world", "controller", "robot", "sensors", "simulator", "tuning", "seed")


def check_references(key: str, content: Mapping[str, Any], cells: Sequence[Cell]) -> None:
    """Check that every selection of cells, and every world and label that is named, is planned.

    Args:
        key: the study's place, for the error message.
        content: its claims and report, as plain values.
        cells: what it runs.

    Raises:
        DescriptionError: one line that names the selection, its value and what is allowed.
    """
    keys = [cell.key() for cell in cells]
    rows = [{column: value for column, value in {**k._asdict(), **k.names._asdict()}.items()} for k in keys]
    for place, selection in _selections(key, content):
        matching = rows
        for column in (column for column in COLUMNS if column in selection):
            wanted = selection[column] if isinstance(selection[column], list) else [selection[column]]
            for value in wanted:
                there = dict.fromkeys(row[column] for row in matching)
                if value not in there:
                    raise DescriptionError(
                        f"{place}.{column}={value}: no such cell is planned; {instead(value, there, 'there are')}"
                    )
            matching = [row for row in matching if row[column] in wanted]


def check_chosen(
    study: str, content: Mapping[str, Any], planned: Sequence[Cell | Tuning], folders: Sequence[Path]
) -> None:
    """Check that the claims to which values were fitted are there, and the worlds in which they were selected.

    Args:
        study: its name. Of claims of other studies, written ``STUDY.ID``, the study must be there.
        content: its claims, checks and questions, as plain values.
        planned: what it runs.
        folders: with the worlds and studies.

    Raises:
        DescriptionError: one line that names the source, the claim or world and what is allowed.
    """
    ids = [name for table in TABLES for name in content.get(table) or {}]
    others = [f"{other}." for other in files_of("study", folders) if other != study]
    known = {"claims": [*ids, *(f"{study}.{name}" for name in ids)], "worlds": list(files_of("world", folders))}
    named = {
        f"{part}.sources.{key}.{word}={name}": (word, name)
        for one in planned
        for part, sources in one.sources.items()
        for key, source in sources.items()
        for word in known
        for name in source.get(word, ())
    }
    for place, (word, name) in named.items():
        if name not in known[word] and not (word == "claims" and name.startswith(tuple(others))):
            raise DescriptionError(f"study/{study}: {place}: unknown; {instead(name, known[word])}")


def _selections(key: str, value: Any) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield every selection in plain values, with its place."""
    if isinstance(value, list | tuple):
        for i, inner in enumerate(value):
            yield from _selections(f"{key}[{i}]", inner)
    elif isinstance(value, Mapping):
        name = str(value.get("name", ""))
        for word, inner in value.items():
            place = f"{key}.{word}"
            if word in SELECTIONS and isinstance(inner, Mapping):
                yield place, inner
            elif word == "with" and isinstance(inner, Mapping):  # the measures of a finding
                for figure, spec in inner.items():
                    yield from _selections(f"{place}.{figure}", asked(f"{place}.{figure}", spec))
            else:
                for more, selection in () if name == "verdicts" or lies_outside(name) else _named(word, inner):
                    yield f"{place}{more}", {**value.get("select", {}), **selection}
                yield from _selections(place, inner)


def _named(word: str, value: Any) -> list[tuple[str, Mapping[str, Any]]]:
    """Return the cells that an argument of a section or measure names: its place in the argument, and a selection."""
    if word in ("labels", "reference", "home") and value:
        return [("", {"label": value if isinstance(value, str) else list(value)})]
    if word in ("worlds", "panels", "cells", "groups") and isinstance(value, Mapping):
        return [(f".{of}", cells if isinstance(cells, Mapping) else {"world": cells}) for of, cells in value.items()]
    return []
