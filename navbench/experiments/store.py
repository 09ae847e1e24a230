"""The results store: the only file that writes or reads results.

A part is written under a temporary name and renamed, and its name depends only on the work: a killed run loses nothing
that was finished, and the same work writes the same bytes.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import navbench.experiments.parts as parts
from navbench.experiments.files import OPEN, discard_empty, discard_half_written, is_whole, keep, replacing, sealed
from navbench.experiments.manifest import is_other_work, manifest_of, now
from navbench.experiments.parts import BESIDE, CODE, KINDS, RECORD, TUNING, batch_name, episodes_of, tuning_name
from navbench.experiments.rows import episode_table, latency_table, trajectory_table
from navbench.experiments.schema import LONGEST, read_manifest
from navbench.experiments.schema import ResultsError as ResultsError
from navbench.reading import bounded
from navbench.records import CellKey, RobotRecord, TuningKey
from navbench.world.layout import layout_id

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

MANIFEST = "manifest.json"
OTHERWISE = "choose another directory, or --overwrite removes them"


class Results:
    """One results directory.

    Args:
        path: the directory; it need not exist yet.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def begin(
        self,
        cells: Sequence[CellKey],
        tunings: Sequence[TuningKey] = (),
        study: Mapping[str, Any] | None = None,
        planned: Mapping[str, int] | None = None,
        codes: Mapping[str, Mapping[str, str]] | None = None,
        commit: str | None = None,
        *,
        overwrite: bool = False,
    ) -> list[str]:
        """Make the directory, write the manifest of what is about to run, and return which code changed since.

        A directory with the same work is taken up. Of a study only the name must be the same, for its file is edited.

        Args:
            cells: what will run, as far as it is known.
            tunings: what will be searched.
            study: the study's name, claims and report as plain values; None for a run.
            planned: how many episodes are planned.
            codes: the digest of each module that makes rows, under the digest of them all that a part names.
            commit: the git commit of navbench's sources.
            overwrite: whether the directory may hold other work.

        Returns:
            The modules whose code is not what it was when something was last run here.

        Raises:
            ResultsError: the directory holds results of other work.
        """
        manifest = manifest_of(cells, tunings, study, planned, codes or {}, commit)
        changed: list[str] = []
        if (self.path / MANIFEST).exists():
            old = self.manifest()
            if is_other_work(old, manifest) and not overwrite:
                raise ResultsError(f"{self.path}: holds the results of other work; {OTHERWISE}")
            before = old.get("code", {})
            manifest |= {key: old[key] for key in ("began", "resumed") if key in old}
            manifest["checksums"] = old.get("checksums", False)
            manifest["codes"] = old.get("codes", {}) | manifest["codes"]
            changed = [name for name, now in manifest["code"].items() if before.get(name) != now]
        elif any(self.parts(kind, "[!.]") for kind in KINDS):
            raise ResultsError(f"{self.path}: holds parts without a manifest; choose another directory")
        self._write_manifest(manifest)
        return changed

    def parts(self, kind: str, prefix: str = "part-") -> list[str]:
        """Return the names of the parts of a kind, sorted."""
        return sorted(file.name for file in (self.path / kind).glob(f"{prefix}*.parquet"))

    def faults(self) -> dict[str, str]:
        """Return by kind and name which parts are damaged, and which bear no checksum."""
        seals = self.manifest().get("checksums", False)
        names = [f"{kind}/{name}" for kind in KINDS for name in self.parts(kind, "[!.]")]
        found = {name: parts.fault_of(self.path, name, seals) for name in names}
        return {name: fault for name, fault in found.items() if fault}

    def remove(self, names: Iterable[str]) -> None:
        """Remove parts by their kind and name."""
        for name in names:
            (self.path / name).unlink()

    def lacking(self, name: str) -> list[str]:
        """Return, of what was written before a part of episodes, by kind and name what is no longer there."""
        beside = parts.notes_of(self.path, f"episodes/{name}").get(BESIDE, "").split()
        return [one for one in beside if not (self.path / one).is_file()]

    def holds_ranges(self, name: str) -> bool:
        """Return whether the trajectories beside a part of episodes hold what the range sensors read."""
        return parts.notes_of(self.path, f"episodes/{name}").get(RECORD, "") == "ranges"

    def record_resume(self, changed: Sequence[str], parts: int, kept: bool) -> None:
        """Write into the manifest that parts of other code were there: which modules had changed, and what was done.

        Args:
            changed: the modules.
            parts: how many parts.
            kept: whether they were kept; else they were run anew.
        """
        manifest = self.manifest()
        note = {"when": now(), "changed": list(changed), "parts": parts, "kept": kept}
        self._write_manifest({**manifest, "resumed": [*manifest["resumed"], note]})

    def abandon(self) -> None:
        """Remove what was written of a run of which nothing was finished."""
        discard_half_written(self.path)
        if any((self.path / "episodes").glob("part-*.parquet")) or any((self.path / "evaluations").glob("*.parquet")):
            return
        for kind in ("latency", "trajectories", "layouts", "episodes"):
            for part in (self.path / kind).glob("part-*.parquet"):
                part.unlink()
            discard_empty(self.path / kind, self.path.absolute())
        (self.path / MANIFEST).unlink(missing_ok=True)

    def keep_only(self, kinds: Iterable[str], names: Iterable[str]) -> None:
        """Remove the parts of some kinds whose names are not among these: they are of an earlier form of the work."""
        kept = set(names)
        for kind in kinds:
            for part in (self.path / kind).glob("[!.]*.parquet"):
                if part.name not in kept:
                    part.unlink()

    def write_csv(self) -> None:
        """Write ``episodes.csv`` for people, of the episodes that are there."""
        if any((self.path / "episodes").glob("part-*.parquet")):
            write_table(self.path / "episodes.csv", self.episodes().to_csv(index=False))

    def end(self, codes: Iterable[str] = ()) -> None:
        """Write ``episodes.csv``, and into the manifest when the work ended.

        Args:
            codes: the digests that parts name; what the manifest holds of others is dropped.
        """
        self.write_csv()
        discard_half_written(self.path)
        manifest = self.manifest()
        kept = {digest: manifest["codes"][digest] for digest in codes if digest in manifest["codes"]}
        self._write_manifest({**manifest, "codes": kept, "ended": now()})

    def finished(self) -> dict[str, set[int]]:
        """Return the episodes that are there, of each run, from the names of the parts."""
        found: dict[str, set[int]] = {}
        for name in self.parts("episodes"):
            run_id, episodes = episodes_of(name)
            found.setdefault(run_id, set()).update(episodes)
        return found

    def has(self, kind: str, name: str) -> bool:
        """Return whether a part of a kind ("episodes", "evaluations") is there."""
        return (self.path / kind / name).is_file()

    def code_of(self, kind: str, name: str) -> str:
        """Return the digest of the code that made a part; empty where the part does not say."""
        return parts.notes_of(self.path, f"{kind}/{name}").get(CODE, "")

    def tuning_of(self, kind: str, name: str) -> str:
        """Return the name and seed of the tuning whose parameters made a part; empty without one."""
        return parts.notes_of(self.path, f"{kind}/{name}").get(TUNING, "")

    def write_batch(
        self,
        cell: CellKey,
        episodes: range,
        records: Iterable[tuple[int, RobotRecord]],
        code: str = "",
        trajectories: bool = True,
        ranges: bool = False,
    ) -> None:
        """Write a batch's layouts, episodes, trajectories and latencies, each as one part, the episodes last.

        Args:
            cell: the cell that they belong to.
            episodes: the batch's episodes.
            records: (episode, record) pairs, in any order.
            code: a digest of the code that made them.
            trajectories: whether to keep the trajectories.
            ranges: whether the trajectories hold what the range sensors read, where anything was driven.
        """
        ordered = sorted(records, key=lambda pair: (pair[0], pair[1].robot_index))
        name = batch_name(cell, episodes)
        ids, beside = self._write_layouts(ordered)
        tables = {"latency": latency_table(cell, ordered)}
        if trajectories:
            tables["trajectories"] = trajectory_table(cell, ordered)
        for kind, table in tables.items():
            self._write_table(f"{kind}/{name}", table, code)
        beside += [f"{kind}/{name}" for kind in tables]
        tuning = f"{cell.tuning} {cell.tuning_seed}" if cell.tuning else ""
        notes = {BESIDE: " ".join(beside), TUNING: tuning, RECORD: "ranges" if ranges else ""}
        self._write_table(f"episodes/{name}", episode_table(cell, ordered, ids), code, **notes)

    def _write_layouts(self, records: Sequence[tuple[int, RobotRecord]]) -> tuple[dict[int, str], list[str]]:
        """Write the geometry of the layouts that were driven; return each episode's layout by its id, and the part.

        A part is named by what it holds, so that a fixed world's layout is kept once, however many batches and
        controllers drive in it, and so are the layouts that several controllers meet.
        """
        import pyarrow as pa

        made: dict[int, str] = {}  # a fixed world's layout is one object in all episodes
        ids, texts = {}, {}
        for episode, record in records:
            if record.layout is not None and episode not in ids:
                if id(record.layout) not in made:
                    text = record.layout.to_json()
                    made[id(record.layout)] = layout_id(text)
                    texts[layout_id(text)] = text
                ids[episode] = made[id(record.layout)]
        names = []
        if texts:
            name = f"layouts/part-{hashlib.sha256(''.join(sorted(texts)).encode()).hexdigest()[:16]}.parquet"
            if not (self.path / name).is_file():
                self._write_table(name, pa.table({"layout_id": list(texts), "layout": list(texts.values())}))
            names = [name]
        return ids, names

    def write_evaluations(
        self, tuning: TuningKey, columns: Mapping[str, Any], code: str = "", *, whole: bool = True
    ) -> None:
        """Write what a tuning evaluated: one row an evaluation, in order.

        Args:
            tuning: the tuning.
            columns: each column's values: evaluation, cost, reached, robots and the parameters.
            code: a digest of the code that made them.
            whole: whether that is all; else it is kept apart, to go on from there.
        """
        import pyarrow as pa

        count = len(columns["evaluation"])
        names = {"tuning_id": tuning.tuning_id, "name": tuning.name, "tuner": tuning.tuner, "seed": tuning.seed}
        table = pa.table({**{key: [value] * count for key, value in names.items()}, **columns})
        unfinished = f"evaluations/{parts.unfinished_name(tuning)}"
        self._write_table(f"evaluations/{tuning_name(tuning)}" if whole else unfinished, table, code)
        if whole:
            (self.path / unfinished).unlink(missing_ok=True)

    def write_checks(self, tuning: TuningKey, checks: Sequence[Any], code: str = "") -> None:
        """Write what the best of a tuning cost when it was run again: named tuples, a row each."""
        import pyarrow as pa

        names = {"tuning_id": tuning.tuning_id, "name": tuning.name, "tuner": tuning.tuner, "seed": tuning.seed}
        rows = [{**names, **check._asdict()} for check in checks]
        self._write_table(f"checks/{tuning_name(tuning)}", pa.Table.from_pylist(rows), code)

    def write_description(self, name: str, columns: Mapping[str, Any]) -> None:
        """Write a named table that a controller offers of itself."""
        import pyarrow as pa

        self._write_table(f"descriptions/{name}.parquet", pa.table(dict(columns)))

    def manifest(self) -> dict[str, Any]:
        """Return the manifest.

        Raises:
            ResultsError: there is none, or it is of another version of the format.
        """
        file = self.path / MANIFEST
        if not file.is_file():
            raise ResultsError(f"{self.path}: no results here: {MANIFEST} is missing")
        return read_manifest(file)

    def manifest_is_whole(self) -> bool | None:
        """Return whether the manifest is what was written; None where it bears no checksum."""
        return is_whole(MANIFEST, bounded(self.path / MANIFEST, LONGEST))

    def episodes(self) -> "pd.DataFrame":
        """Return the table of episodes: one row a robot and episode, sorted by run, episode and robot."""
        return self._read("episodes", ["run_id", "episode", "robot_index"]).copy()

    def trajectories(self, run_id: str = "", columns: Sequence[str] = ()) -> "pd.DataFrame":
        """Return the table of trajectories, of all runs or of one, sorted by run, episode, robot and time.

        Args:
            run_id: the run; empty for all.
            columns: what is read of it, beside what it is sorted by; none for all.
        """
        return self._read("trajectories", ["run_id", "episode", "robot_index", "t_s"], run_id, columns)

    def keeps_trajectories(self, run_id: str) -> bool:
        """Return whether trajectories of a run are there."""
        return any((self.path / "trajectories").glob(f"part-{run_id}*.parquet"))

    def layouts(self) -> dict[str, str]:
        """Return the layouts that were driven: each one's JSON by its id."""
        tables = [self._part(f"layouts/{name}") for name in self.parts("layouts")]
        return {row["layout_id"]: row["layout"] for table in tables for row in table.to_pylist()}

    def latency(self) -> "pd.DataFrame":
        """Return how long the controllers took: one row a robot and episode."""
        return self._read("latency", ["run_id", "episode", "robot_index"])

    def evaluations(self) -> "pd.DataFrame":
        """Return what the tunings evaluated, sorted by name, tuner, seed and evaluation."""
        return self._read("evaluations", ["name", "tuner", "seed", "evaluation"])

    def checks(self) -> "pd.DataFrame":
        """Return what the best of each tuning cost when it was run again, by name, tuner and seed; may be empty."""
        import pandas as pd

        if any((self.path / "checks").glob("part-*.parquet")):
            return self._read("checks", ["name", "tuner", "seed"])
        return pd.DataFrame(columns=["tuning_id", "name", "seed", "kind", "simulator", "cost"])

    def evaluations_of(self, tuning: TuningKey, *, whole: bool = True) -> "pd.DataFrame":
        """Return what one tuning evaluated, in order; or where it is not ``whole``, as far as it came."""
        name = tuning_name(tuning) if whole else parts.unfinished_name(tuning)
        evaluations: pd.DataFrame = self._part(f"evaluations/{name}").to_pandas()
        return evaluations

    def descriptions(self) -> "dict[str, pd.DataFrame]":
        """Return the tables that controllers offered of themselves, by name."""
        files = sorted((self.path / "descriptions").glob("*.parquet"))
        return {file.stem: self._part(f"descriptions/{file.name}").to_pandas() for file in files}

    def _read(self, kind: str, order: list[str], of: str = "", columns: Sequence[str] = ()) -> "pd.DataFrame":
        files = [self.path / kind / name for name in self.parts(kind, f"part-{escape(of)}")]
        if kind in ("trajectories", "latency"):  # a batch's episodes are written last: without them it is unfinished
            files = [file for file in files if self.has("episodes", file.name)]
        if not files:
            raise ResultsError(f"{self.path}: no results here: {kind}/ holds no part" + (f" of {of}" if of else ""))
        read = _frame_of if kind == "episodes" else _frame_of.__wrapped__
        changed = tuple((file, file.stat().st_mtime_ns) for file in files)
        return read(changed, tuple(order), tuple(columns), self._are_sealed())

    def _part(self, name: str) -> "pa.Table":
        return parts.read(self.path, name, seals=self._are_sealed())

    def _are_sealed(self) -> bool:
        """Return whether all parts bear seals; those of an older navbench do not."""
        file = self.path / MANIFEST
        return file.is_file() and _seals(file, file.stat().st_mtime_ns)

    def _write_table(self, name: str, table: "pa.Table", code: str = "", **notes: str) -> None:
        parts.write(self.path, name, table, {CODE: code, **notes})

    def _write_manifest(self, manifest: Mapping[str, Any]) -> None:
        text = json.dumps({**manifest, "seal": OPEN.decode()}, indent=2) + "\n"
        keep(self.path / MANIFEST, sealed(MANIFEST, text.encode()))


@lru_cache(maxsize=4)
def _seals(file: Path, _: int) -> bool:
    return bool(read_manifest(file).get("checksums", False))


@lru_cache(maxsize=4)
def _frame_of(
    files: tuple[tuple[Path, int], ...], order: tuple[str, ...], more: tuple[str, ...], seals: bool
) -> "pd.DataFrame":
    """Return some parts, each with the time of its last change, as one sorted table."""
    import pyarrow as pa

    columns = [*order, *more] if more else None
    tables = [parts.read(file.parents[1], f"{file.parent.name}/{file.name}", columns, seals) for file, _ in files]
    table = pa.concat_tables(tables, promote_options="permissive").combine_chunks()
    frame: pd.DataFrame = table.to_pandas()
    return frame.sort_values(list(order), kind="stable", ignore_index=True)


def write_table(file: Path, text: str) -> None:
    """Write a table beside results, whole or not at all."""
    with replacing(file) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
