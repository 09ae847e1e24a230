"""A part: one Parquet file of a results directory, which says what made it and bears a seal over all its bytes."""

import io
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from navbench.experiments.files import OPEN, is_whole, keep, sealed
from navbench.experiments.schema import EPISODES_MAX
from navbench.reading import bounded
from navbench.records import CellKey, TuningKey
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

KINDS = ("episodes", "trajectories", "latency", "layouts", "evaluations", "checks", "descriptions")
CODE = "code"  # under which a part names the code that made it
BESIDE = "beside"  # the parts that were written before it and that it needs
RECORD = "record"  # what its trajectories hold beyond what they always hold
TUNING = "tuning"  # the tuning that its parameters come from, and its seed
NOTE = "navbench."  # before each of these in the file
DAMAGED = "damaged"
UNSEALED = "no checksum"
LONGEST = 2**32  # bytes of a part, and numbers in it
PART = re.compile(r"part-(.+)-(\d{1,9})-(\d{1,9})\.parquet")

WORDS: Mapping[str, tuple[str, ...]] = {  # the columns of words, of whole numbers and of numbers that each kind has
    "episodes": ("run_id", "controller", "world", "robot", "sensors", "simulator", "outcome", "reason", "layout_id"),
    "trajectories": ("run_id",),
    "latency": ("run_id",),
    "layouts": ("layout_id", "layout"),
    "evaluations": ("name", "tuner"),
    "checks": ("name", "kind", "simulator"),
}
WHOLE: Mapping[str, tuple[str, ...]] = {
    **{kind: ("episode", "robot_index") for kind in ("trajectories", "latency")},
    "episodes": ("seed", "episode", "robot_index"),
    "evaluations": ("seed", "evaluation", "reached", "robots"),
    "checks": ("seed",),
}
NUMBERS: Mapping[str, tuple[str, ...]] = {
    "episodes": ("time_s",),
    "trajectories": ("t_s", "x_m", "y_m", "heading_rad", "v_mps", "w_radps"),
    "evaluations": ("cost",),
    "checks": ("cost",),
}


def write(folder: Path, name: str, table: "pa.Table", notes: Mapping[str, str], level: int | None = None) -> None:
    """Write a part, whole or not at all.

    Args:
        folder: the results directory.
        name: the part's kind and name, such as "episodes/part-...".
        table: what it holds.
        notes: what it says of itself; those without a word are left out.
        level: of compression, up to 22; None for the usual one.
    """
    import pyarrow.parquet as pq

    told = {f"{NOTE}{key}": value for key, value in notes.items() if value}
    sink = io.BytesIO()
    marked = table.replace_schema_metadata({**told, f"{NOTE}seal": OPEN.decode()})
    pq.write_table(marked, sink, compression="zstd", compression_level=level)
    keep(folder / name, sealed(name, sink.getvalue()))


def read(folder: Path, name: str, columns: Sequence[str] | None = None, seals: bool = False) -> "pa.Table":
    """Return a part's columns, read alone: as one of a data set it would take three times as long.

    Args:
        folder: the results directory.
        name: the part's kind and name.
        columns: which; all without.
        seals: whether every part of this directory bears a seal, so that one without is damaged.

    Raises:
        DescriptionError: it is damaged, or no part of its kind.
    """
    opened = _opened(folder, name, (False, None) if seals else (False,))
    if opened.metadata.num_rows * opened.metadata.num_columns > LONGEST:
        raise DescriptionError(f"{folder / name}: holds more than {LONGEST} numbers")
    _check_columns(folder, name, opened.schema_arrow)
    try:
        return opened.read(columns, use_threads=False)
    except (ValueError, OSError):
        raise _damaged(folder, name) from None


def columns_of(folder: Path, name: str) -> list[str]:
    """Return the names of a part's columns; errors as of ``read``."""
    names: list[str] = _opened(folder, name).schema_arrow.names
    return names


def notes_of(folder: Path, name: str) -> Mapping[str, str]:
    """Return what a part says of itself; errors as of ``read``."""
    return _notes_of(folder, name, (folder / name).stat().st_mtime_ns)


@lru_cache(maxsize=10**4)
def _notes_of(folder: Path, name: str, _: int) -> Mapping[str, str]:
    metadata = _opened(folder, name).schema_arrow.metadata or {}
    notes = {key.decode(errors="replace"): value.decode(errors="replace") for key, value in metadata.items()}
    return {key.removeprefix(NOTE): value for key, value in notes.items() if key.startswith(NOTE)}


def fault_of(folder: Path, name: str, seals: bool) -> str:
    """Return ``DAMAGED`` or ``UNSEALED``, or nothing where a part is what was written.

    Args:
        folder: the results directory.
        name: the part's kind and name.
        seals: whether every part of this directory bears a seal; else one without may be of an older navbench.
    """
    try:
        whole = is_whole(name, bounded(folder / name, LONGEST))
        if whole is None and not seals:
            _opened(folder, name)
            return UNSEALED
    except (DescriptionError, OSError):  # no file, or one that cannot be read
        whole = False
    return "" if whole else DAMAGED


def _opened(folder: Path, name: str, refused: tuple[bool | None, ...] = ()) -> "pq.ParquetFile":
    import pyarrow as pa
    import pyarrow.parquet as pq

    data = bounded(folder / name, LONGEST)
    if refused and is_whole(name, data) in refused:
        raise _damaged(folder, name)
    try:
        return pq.ParquetFile(pa.BufferReader(data))
    except (ValueError, OSError):
        raise _damaged(folder, name) from None


def _damaged(folder: Path, name: str) -> DescriptionError:
    return DescriptionError(f"{folder / name}: damaged; the command that made it makes it anew")


def _check_columns(folder: Path, name: str, schema: "pa.Schema") -> None:
    from pyarrow import types

    kind = name.partition("/")[0]
    for names, fits, what in (
        (WORDS, types.is_string, "words"),
        (WHOLE, types.is_integer, "whole numbers"),
        (NUMBERS, types.is_floating, "numbers"),
    ):
        for column in names.get(kind, ()):
            if schema.get_field_index(column) < 0 or not fits(schema.field(column).type):
                raise DescriptionError(f"{folder / name}: must have a column {column} of {what}")


def batch_name(cell: CellKey, episodes: range) -> str:
    """Return the name of a batch's parts: it depends on the work alone."""
    return f"part-{cell.run_id}-{episodes[0]:06d}-{episodes[-1]:06d}.parquet"


def episodes_of(name: str) -> tuple[str, range]:
    """Return the run and the episodes of a part by its name; no episodes where it is not named so."""
    found = PART.fullmatch(name)
    episodes = range(int(found[2]), int(found[3]) + 1) if found else range(0)
    return (found[1], episodes) if found and len(episodes) <= EPISODES_MAX else (name, range(0))


def tuning_name(tuning: TuningKey) -> str:
    """Return the name of a tuning's part: it depends on the work alone."""
    return f"part-{tuning.tuning_id}.parquet"


def unfinished_name(tuning: TuningKey) -> str:
    """Return the name under which a tuning that goes on keeps what it has evaluated."""
    return f"unfinished-{tuning.tuning_id}.parquet"
