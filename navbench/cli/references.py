"""What a study's claims and report ask for, held against the cells that it plans: before its first episode runs."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from navbench.experiments.cells import Cell
from navbench.validation import DescriptionError, instead

SELECTIONS = ("select", "than")  # under these keys stands which cells are meant
COLUMNS = ("name", "label", "world", "controller", "robot", "sensors", "simulator", "tuning", "seed")


def check_references(key: str, content: Mapping[str, Any], cells: Sequence[Cell]) -> None:
    """Check that every selection of cells finds one.

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


def _selections(key: str, value: Any) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield every selection in plain values, with its place."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            if name in SELECTIONS and isinstance(inner, Mapping):
                yield f"{key}.{name}", inner
            else:
                yield from _selections(f"{key}.{name}", inner)
    elif isinstance(value, list | tuple):
        for place, inner in enumerate(value):
            yield from _selections(f"{key}[{place}]", inner)
