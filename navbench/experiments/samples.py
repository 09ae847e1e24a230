"""The reconstructions of a multiverse on disk: its prior, written before the first of them, and a part a block."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navbench.experiments import parts
from navbench.experiments.files import OPEN, discard_half_written, is_whole, keep, sealed
from navbench.experiments.schema import LONGEST, ResultsError
from navbench.reading import bounded

if TYPE_CHECKING:
    import pandas as pd

PRIOR, SECONDS, PUBLISHED = "prior.json", "seconds", "reconstructions.parquet"
PLACE = ["scramble", "index", "moved"]  # columns: which reconstruction a row is
OF, OTHER = "prior", "of another prior"  # under which a block names its prior, and the fault of one that is not here
DRAWN, MOVED = "drawn", "moved"  # kinds: of the sample, and of rows with each dimension moved alone
CODE, VALUE = "code:", "value:"  # before a claim's name: what it does, and what was measured


class Samples:
    """One directory of reconstructions.

    Args:
        path: the directory; it need not exist yet.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def begin(self, prior: Mapping[str, Any], *, other_code: bool = False) -> None:
        """Write the prior, or see that it is the one by which earlier reconstructions were drawn.

        What a run that was killed had begun to write is removed.

        Args:
            prior: what is drawn and asked, as plain values, with the digest of the code under "code".
            other_code: whether to go on with what other code made.

        Raises:
            ResultsError: the directory holds reconstructions of another prior, or that other code made.
        """
        file = self.path / PRIOR
        discard_half_written(self.path)
        if file.is_file():
            old = self.prior()
            here = "the reconstructions in it are kept; out= names another directory for new ones"
            for key in prior:
                if old.get(key) != prior[key] and not (key == "code" and other_code):
                    raise ResultsError(f"{self.path}: was begun with other {key}; {here}")
            return
        write_prior(self.path, prior)

    def has(self, name: str, claims: Iterable[str] = ()) -> bool:
        """Return whether a block is there, and says what these claims do."""
        file, columns = f"{name}.parquet", {f"{CODE}{claim}" for claim in claims}
        return (self.path / file).is_file() and (not columns or columns <= set(parts.columns_of(self.path, file)))

    def faults(self) -> dict[str, str]:
        """Return the blocks that are damaged or bear no checksum, by their files, and which of both."""
        files = sorted(
            str(file.relative_to(self.path)) for kind in ("", SECONDS) for file in (self.path / kind).glob("*.parquet")
        )
        try:
            self.prior()
            seals = is_whole(PRIOR, bounded(self.path / PRIOR, LONGEST))
            found = {} if seals else {PRIOR: parts.UNSEALED}
            seal = self._seal()
        except ResultsError:
            seals, found, seal = None, {PRIOR: parts.DAMAGED}, ""
        found |= {name: fault for name in files if (fault := parts.fault_of(self.path, name, seals=bool(seals)))}
        sound = [name for name in files if name not in found and seal]
        found |= {name: OTHER for name in sound if parts.notes_of(self.path, name).get(OF, seal) != seal}
        lost = (f"{SECONDS}/{name}" for name in files if name.startswith((f"{DRAWN}-", f"{MOVED}-")))
        return found | dict.fromkeys((name for name in lost if name not in files), parts.DAMAGED)

    def discard_damaged(self) -> list[Path]:
        """Remove the blocks that are damaged, to be made anew, and return their files."""
        faults = self.faults().items()
        bad = (parts.DAMAGED, OTHER)
        damaged = [self.path / name for name, fault in faults if fault in bad and name != PRIOR]
        for file in damaged:  # of a block and its seconds the block tells whether both are there
            (self.path / file.name).unlink(missing_ok=True)
        return damaged

    def write(self, name: str, columns: Mapping[str, Any]) -> None:
        """Write a block: columns of one length; how long each took lies apart, for it is never the same twice."""
        import pyarrow as pa

        kept = {key: column for key, column in columns.items() if key != SECONDS}
        apart = {f"{SECONDS}/{name}": {SECONDS: columns[SECONDS]}} if SECONDS in columns else {}
        for file, table in {**apart, name: kept}.items():
            parts.write(self.path, f"{file}.parquet", pa.table(table), {OF: self._seal()})

    def part(self, name: str) -> "pd.DataFrame":
        """Return a block that is there.

        Raises:
            DescriptionError: it is damaged.
        """
        frame: pd.DataFrame = parts.read(self.path, f"{name}.parquet").to_pandas()
        return frame

    def prior(self) -> dict[str, Any]:
        """Return the prior.

        Raises:
            ResultsError: it is damaged, or none.
        """
        file = self.path / PRIOR
        data = bounded(file, LONGEST)
        try:
            prior = json.loads(data)
        except (ValueError, RecursionError):
            prior = None
        if not isinstance(prior, dict) or is_whole(PRIOR, data) is False:
            raise ResultsError(
                f"{file}: damaged; put back the one that was written, or begin anew with another out=DIR"
            )
        prior.pop("seal", None)
        return prior

    def _seal(self) -> str:
        """Return the prior's seal, which every block names; nothing without one."""
        file = self.path / PRIOR
        return str(json.loads(bounded(file, LONGEST)).get("seal", "")) if file.is_file() else ""

    def even(self, kind: str, claims: Sequence[str] | None = None) -> "pd.DataFrame":
        """Return the reconstructions of a kind, of each scramble as many as all have, as ``read``."""
        rows = self.read(kind, claims)
        if rows.empty:
            return rows
        there = rows[rows["moved"] == -1].groupby("scramble")["index"]
        whole = int((there.max() + 1).min())
        return rows[rows["index"] < whole].reset_index(drop=True)

    def publish(self, rows: "pd.DataFrame", folder: Path) -> None:
        """Write a sample as one small file, and its prior: where it lies follows from scramble, index and its seed."""
        import pyarrow as pa

        write_prior(folder, self.prior())
        table = pa.Table.from_pandas(rows.drop(columns=[SECONDS, "moved"]), preserve_index=False)
        parts.write(folder, PUBLISHED, table, {OF: self._seal()}, level=19)

    def count(self) -> int:
        """Return how many reconstructions are there, as blocks or published."""
        if (self.path / PUBLISHED).is_file():
            return int(parts.read(self.path, PUBLISHED, ["index"]).num_rows)
        return len(self.read(DRAWN))

    def read(self, kind: str, claims: Sequence[str] | None = None) -> "pd.DataFrame":
        """Return the reconstructions of a kind, sorted by scramble, index and what was moved; empty without any.

        Args:
            kind: which.
            claims: of which alone is told what they do, of the blocks that say it of all of them; None for all that
                is there.
        """
        import pandas as pd
        import pyarrow as pa

        columns = None if claims is None else [*PLACE, *(f"{CODE}{claim}" for claim in claims)]
        files = [file for file in sorted(self.path.glob(f"{kind}-*.parquet")) if self.has(file.stem, claims or ())]
        if not files:
            return pd.DataFrame()
        tables = []
        for file in files:
            table = parts.read(self.path, file.name, columns)
            seconds = parts.read(self.path, f"{SECONDS}/{file.name}")
            tables.append(table.append_column(SECONDS, seconds[SECONDS]))
        frame: pd.DataFrame = pa.concat_tables(tables).to_pandas()
        return frame.sort_values(PLACE, kind="stable", ignore_index=True)


def write_prior(folder: Path, prior: Mapping[str, Any]) -> None:
    """Write what is drawn and asked, under a seal."""
    text = json.dumps({**prior, "seal": OPEN.decode()}, indent=1) + "\n"
    keep(folder / PRIOR, sealed(PRIOR, text.encode()))
