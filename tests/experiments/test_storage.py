"""Storage: a part that is not what was written is found, named and made anew; and nothing finished is lost."""

import errno
import json
import os
import random
import re
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import NAVBENCH, Command
from stored import a_cell, a_record, store

from navbench.cli.configuration import compose_cell
from navbench.cli.study_configuration import compose_tuning
from navbench.experiments import files, parts
from navbench.experiments.parts import DAMAGED, UNSEALED
from navbench.experiments.plan import Plan
from navbench.experiments.running import run_plan
from navbench.experiments.store import Results
from navbench.validation import DescriptionError

FLIPS = 10  # in each part
GO = ("controller=go_to_goal", "world=empty", "world.time_limit_s=0.5", "simulator=planar", "workers=1")


def plan_of(episodes: int, *words: str) -> Plan:
    return Plan(cells=(compose_cell(*GO, f"episodes={episodes}", *words),))


def flipped(data: bytes, bit: int) -> bytes:
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def parts_of(path: Path) -> dict[str, bytes]:
    """Return the bytes of every part by its place, without the latencies, which are never the same."""
    found = sorted(file for file in path.rglob("*.parquet") if file.parent.name != "latency")
    return {str(file.relative_to(path)): file.read_bytes() for file in found}


# Bits


def test_every_part_in_which_one_bit_is_flipped_is_found(tmp_path: Path) -> None:
    run_plan(plan_of(30), tmp_path, 1)
    store(tmp_path / "tuned", [(a_cell(), [a_record()])], costs={("pso", 0): [3.0, 2.0]})
    chance, count = random.Random(0), 0
    for folder in (tmp_path, tmp_path / "tuned"):
        for file in [file for kind in parts.KINDS for file in sorted((folder / kind).glob("*.parquet"))]:
            name, data = f"{file.parent.name}/{file.name}", file.read_bytes()
            assert parts.fault_of(folder, name, seals=True) == ""
            for _ in range(FLIPS):
                file.write_bytes(flipped(data, chance.randrange(8 * len(data))))
                assert parts.fault_of(folder, name, seals=True) == DAMAGED
            file.write_bytes(data)
            count += 1
        assert Results(folder).faults() == {}
    assert count >= 20


def test_a_part_under_another_name_is_found(tmp_path: Path) -> None:
    run_plan(plan_of(12), tmp_path, 1)
    first, second, *_ = sorted((tmp_path / "episodes").iterdir())
    second.write_bytes(first.read_bytes())
    assert Results(tmp_path).faults() == {f"episodes/{second.name}": DAMAGED}


def test_a_seal_changes_nothing_that_a_part_holds(tmp_path: Path) -> None:
    table = pa.table({"says": ["sha256:" + "0" * 64, "sha256:"], "x": [1.0, float("nan")]})
    parts.write(tmp_path, "descriptions/a.parquet", table, {"code": "c", "tuning": ""})
    assert pq.read_table(tmp_path / "descriptions/a.parquet").column("says") == table.column("says")
    assert parts.read(tmp_path, "descriptions/a.parquet").column("says") == table.column("says")
    assert dict(parts.notes_of(tmp_path, "descriptions/a.parquet"))["code"] == "c"
    assert parts.fault_of(tmp_path, "descriptions/a.parquet", seals=True) == ""


def test_a_damaged_part_is_never_read(tmp_path: Path) -> None:
    results = run_plan(plan_of(12), tmp_path, 1).results
    file = sorted((tmp_path / "episodes").iterdir())[1]
    data = file.read_bytes()
    place = data.rindex(b"sha256:") - 200
    file.write_bytes(flipped(data, 8 * place))
    with pytest.raises(DescriptionError, match=f"{file.name}: damaged"):
        results.episodes()


# A resume


@pytest.mark.parametrize("kind", ["episodes", "trajectories", "latency", "layouts"])
@pytest.mark.parametrize(
    "change",
    [lambda data: b"", lambda data: data[: len(data) // 2], lambda data: flipped(data, 8 * (len(data) // 2))],
    ids=["emptied", "cut off", "a bit flipped"],
)
def test_a_damaged_part_is_named_and_made_anew(
    tmp_path: Path, kind: str, change: Callable[[bytes], bytes], caplog: pytest.LogCaptureFixture
) -> None:
    run_plan(plan_of(12), tmp_path, 1)
    before = parts_of(tmp_path)
    file = sorted((tmp_path / kind).iterdir())[0]
    others = {one: one.stat().st_ino for one in (tmp_path / "episodes").iterdir() if one.name != file.name}
    file.write_bytes(change(file.read_bytes()))
    run_plan(plan_of(12), tmp_path, 1)
    assert f"{kind}/{file.name}: damaged" in caplog.text
    assert parts_of(tmp_path) == before
    assert Results(tmp_path).faults() == {}
    if kind != "layouts":  # which all of them share
        assert {one: one.stat().st_ino for one in others} == others


@pytest.mark.parametrize("target", ["nowhere", "itself"])
def test_a_part_that_is_a_link_to_nothing_is_named_and_made_anew(
    tmp_path: Path, target: str, caplog: pytest.LogCaptureFixture
) -> None:
    run_plan(plan_of(12), tmp_path, 0)
    before = parts_of(tmp_path)
    file = sorted((tmp_path / "episodes").iterdir())[0]
    file.unlink()
    file.symlink_to(file if target == "itself" else target)
    assert Results(tmp_path).faults() == {f"episodes/{file.name}": "damaged"}
    run_plan(plan_of(12), tmp_path, 0)
    assert f"episodes/{file.name}: damaged" in caplog.text
    assert parts_of(tmp_path) == before


@pytest.mark.parametrize("kind", ["episodes", "trajectories", "layouts", "latency"])
def test_a_part_that_lost_its_seal_is_not_read_where_every_part_has_one(tmp_path: Path, kind: str) -> None:
    results = run_plan(plan_of(12), tmp_path, 1).results
    file = sorted((tmp_path / kind).iterdir())[0]
    pq.write_table(pq.read_table(file).replace_schema_metadata({}), file, compression="zstd")
    with pytest.raises(DescriptionError, match=f"{file}: damaged; the command that made it makes it anew"):
        getattr(results, kind)()
    assert results.faults() == {f"{kind}/{file.name}": "damaged"}


@pytest.mark.parametrize("kind", ["trajectories", "latency", "layouts"])
def test_a_part_that_is_missing_beside_its_episodes_is_made_anew(tmp_path: Path, kind: str) -> None:
    run_plan(plan_of(12), tmp_path, 1)
    before = parts_of(tmp_path)
    sorted((tmp_path / kind).iterdir())[0].unlink()
    run_plan(plan_of(12), tmp_path, 1)
    assert parts_of(tmp_path) == before


def test_results_without_checksums_are_read_and_gone_on_with(tmp_path: Path) -> None:
    results = run_plan(plan_of(12), tmp_path, 1).results
    first = sorted((tmp_path / "episodes").iterdir())[0]
    for file in tmp_path.rglob("*.parquet"):
        table = pq.read_table(file)
        code = (table.schema.metadata or {}).get(b"navbench.code", b"")
        pq.write_table(table.replace_schema_metadata({b"navbench.code": code}), file, compression="zstd")
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    manifest = {key: value for key, value in manifest.items() if key not in ("checksums", "seal")}
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    assert set(results.faults().values()) == {UNSEALED}
    first.write_bytes(first.read_bytes()[:-20])
    others = {file: file.stat().st_ino for file in (tmp_path / "episodes").iterdir() if file != first}
    run_plan(plan_of(12), tmp_path, 1)
    assert list(results.episodes()["episode"]) == list(range(12))
    assert {file: file.stat().st_ino for file in others} == others
    assert len(results.faults()) < len(list(tmp_path.rglob("*.parquet")))


# More episodes


def test_more_episodes_are_run_beside_those_that_are_there(tmp_path: Path) -> None:
    run_plan(plan_of(12), tmp_path / "grown", 1)
    before = {file: file.stat().st_ino for file in (tmp_path / "grown/episodes").iterdir()}
    for _ in range(2):  # the second time there is nothing left to do
        ran = run_plan(plan_of(100), tmp_path / "grown", 1)
        assert (ran.finished, ran.planned) == (100, 100)
    assert {file: file.stat().st_ino for file in before} == before
    whole = run_plan(plan_of(100), tmp_path / "whole", 1).results
    assert ran.results.episodes().equals(whole.episodes())
    assert ran.results.trajectories().equals(whole.trajectories())


def test_fewer_episodes_are_refused_and_only_overwriting_removes_the_others(tmp_path: Path) -> None:
    run_plan(plan_of(30), tmp_path, 1)
    before = parts_of(tmp_path)
    with pytest.raises(DescriptionError, match="holds the results of other work: 4 finished parts .* --overwrite"):
        run_plan(plan_of(12), tmp_path, 1)
    assert parts_of(tmp_path) == before
    ran = run_plan(plan_of(12), tmp_path, 1, overwrite=True)
    assert list(ran.results.episodes()["episode"]) == list(range(12))


def test_other_work_is_refused_in_one_line_with_exit_2_unless_it_is_to_be_overwritten(
    command: Command, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    words = (*GO, "episodes=3", "hydra.run.dir=here")
    assert command(*words).code == 0
    before = parts_of(tmp_path)
    done = command(*words, "seed=1")
    assert (done.code, len(done.err.splitlines())) == (2, 1)
    assert "here: holds the results of other work: 1 finished parts" in done.err
    assert parts_of(tmp_path) == before
    done = command(*words, "seed=1", "--overwrite")
    assert done.code == 0
    assert "here: 1 finished parts that are not of this plan are removed" in caplog.text
    assert set(Results(tmp_path / "here").episodes()["seed"]) == {1}


def test_a_folder_with_anybodys_tables_is_not_taken_for_results(tmp_path: Path) -> None:
    mine = tmp_path / "here/episodes/mine.parquet"
    mine.parent.mkdir(parents=True)
    mine.write_bytes(b"of years")
    with pytest.raises(DescriptionError, match="holds parts without a manifest"):
        run_plan(plan_of(1), tmp_path / "here", 1)
    assert mine.read_bytes() == b"of years"


# A lock


def test_a_second_run_says_who_holds_the_directory(tmp_path: Path) -> None:
    with (
        files.locked(tmp_path / "here"),
        pytest.raises(DescriptionError, match=rf"a run goes on here: process {os.getpid()} on .+ since 20\d\d-"),
    ):
        run_plan(plan_of(1), tmp_path / "here", 1)
    assert not list(tmp_path.rglob("manifest.json"))


@pytest.mark.parametrize("kind", ["link", "link to nothing", "pipe", "directory"])
def test_a_lock_that_is_no_file_is_refused_and_nothing_is_written_through_it(tmp_path: Path, kind: str) -> None:
    victim, lock = tmp_path / "victim", tmp_path / "there" / "lock"
    lock.parent.mkdir()
    if kind == "link":
        victim.write_text("precious")
    if kind.startswith("link"):
        lock.symlink_to(victim)
    elif kind == "pipe":
        os.mkfifo(lock)
    else:
        lock.mkdir()
    with pytest.raises(DescriptionError, match="lock: must be a file, and no link, directory, pipe or device"):
        run_plan(plan_of(12), lock.parent, 0)
    assert victim.exists() == (kind == "link")
    assert kind != "link" or victim.read_text() == "precious"


def test_two_runs_at_once_do_not_mix(tmp_path: Path) -> None:
    words = [NAVBENCH, "controller=go_to_goal", "world=empty_100", "episodes=100000", "workers=1", "hydra.run.dir=here"]
    first = subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while first.poll() is None and not list(tmp_path.glob("here/episodes/part-*")):
            time.sleep(0.05)
        second = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    finally:
        first.kill()
        first.wait()
    assert second.returncode == 2
    said = rf"navbench: here: a run goes on here: process {first.pid} on \S+ since \S+; wait for it, or choose another"
    assert re.fullmatch(rf"{said} directory\n", second.stderr)
    with files.locked(tmp_path / "here"):  # which the killed run no longer holds, though its file is there
        pass
    assert not (tmp_path / "here/lock").exists()


def test_of_many_that_want_a_directory_at_once_one_has_it(tmp_path: Path) -> None:
    code = (
        "import sys, time, pathlib\n"
        "from navbench.experiments.files import locked\n"
        "seen = pathlib.Path(sys.argv[1])\n"
        "for _ in range(60):\n"
        "    try:\n"
        "        with locked(seen):\n"
        "            inside = seen / 'inside'\n"
        "            inside.open('x').close()\n"
        "            inside.unlink()\n"
        "    except ValueError:\n"
        "        time.sleep(0.001)\n"
    )
    runs = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "here")]) for _ in range(4)]
    assert [run.wait() for run in runs] == [0] * 4


def test_a_lock_that_its_holder_removes_while_it_is_looked_at_is_taken_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, lock, opens, exists = tmp_path / "here", files._lock, files._opened, Path.exists
    taken, opened = list[int](), list[Path]()

    def removed(file: IO[str]) -> None:
        lock(file)
        taken.append(file.fileno())
        if len(taken) == 1:
            (here / "lock").unlink()

    def gone(path: Path) -> IO[str]:
        opened.append(path)
        if len(opened) == 2:
            path.parent.rmdir()
        return opens(path)

    monkeypatch.setattr(files, "_lock", removed)
    monkeypatch.setattr(files, "_opened", gone)
    monkeypatch.setattr(Path, "exists", lambda path: path.name == "lock" and len(opened) == 1 or exists(path))
    with files.locked(here):
        assert (len(taken), len(opened)) == (2, 3)
        assert f"process {os.getpid()} on" in (here / "lock").read_text()
    assert not os.listdir(here)


# A full disk


def full(*_: Any, **__: Any) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_file_that_a_full_disk_does_not_take_is_named_and_nothing_of_it_is_left(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Path, "write_bytes", full)
    done = command(*GO, "workers=0", "episodes=30", "hydra.run.dir=here")
    assert (done.code, done.out) == (3, "")
    assert done.err == "navbench: here/manifest.json: No space left on device; nothing is kept\n"
    assert not [file for file in tmp_path.rglob("*") if file.is_file()]
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    written, write = list[Path](), Path.write_bytes

    def fills(self: Path, data: bytes) -> int:
        written.append(self)
        if len(written) > 10:
            full()
        return write(self, data)

    monkeypatch.setattr(Path, "write_bytes", fills)
    done = command(*GO, "workers=0", "episodes=30", "hydra.run.dir=here")
    assert (done.code, done.out) == (3, "")
    assert re.match(
        r"navbench: .*here/\w+/[\w.-]+.parquet: No space left on device: after \d+ of 30 episodes; ", done.err
    )
    assert not list(tmp_path.rglob(".*.tmp"))
    monkeypatch.setattr(Path, "write_bytes", write)
    assert command(*GO, "workers=0", "episodes=30", "hydra.run.dir=here").code == 0
    run_plan(plan_of(30), tmp_path / "whole", 0)
    assert parts_of(tmp_path / "here") == parts_of(tmp_path / "whole")


def test_a_lock_that_a_full_disk_does_not_take_is_no_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.node", full)
    with pytest.raises(OSError, match="No space"):
        run_plan(plan_of(1), tmp_path, 0)
    assert not (tmp_path / "lock").exists()


# Power


def test_what_a_killed_process_was_writing_in_place_of_a_file_is_gone_when_it_is_written(tmp_path: Path) -> None:
    ended = subprocess.Popen(["true"])
    ended.wait()
    named = [f".a[1].md.{ended.pid}.tmp", f".a[1].md.{10**30}.tmp"]
    stay = [f".a[1].md.{os.getppid()}.tmp", f".b.md.{ended.pid}.tmp", f".a1.md.{ended.pid}.tmp", ".a[1].md.0x.tmp"]
    for name in (*named, *stay):  # of other processes that live, and of other files
        (tmp_path / name).write_text("half")
    files.keep(tmp_path / "a[1].md", b"whole")
    assert {file.name for file in tmp_path.iterdir()} == {"a[1].md", *stay}
    assert (tmp_path / "a[1].md").read_bytes() == b"whole"


def test_a_part_is_on_the_disk_before_it_has_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    fsync, replace = os.fsync, os.replace

    def synced(descriptor: int) -> None:
        told.append("directory" if os.path.isdir(f"/proc/self/fd/{descriptor}") else "file")
        fsync(descriptor)

    def replaced(*names: str) -> None:
        told.append("rename")
        replace(*names)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    parts.write(tmp_path, "episodes/part-a.parquet", pa.table({"a": [1]}), {})
    assert told == ["file", "rename", "directory"]


# Tunings


def tuning_plan(cells: bool = False) -> Plan:
    words = ["controller=pid", "tuner=pso", "objective=ise", "world=corner", "budget=30", "world.time_limit_s=0.5"]
    tuning, _, _ = compose_tuning([*words, "verify=null"])
    tuned = [replace(cell, tuning=tuning.name, tuning_seed=tuning.seed) for cell in tuning.cells] if cells else []
    return Plan(cells=(*tuning.cells, *tuned), tunings=(tuning,), study={"name": "tune it"})


def told_by(plan: Plan, path: Path) -> list[int]:
    """Run a plan and return after which evaluations it told how far it is."""
    told: list[tuple[str, int, int]] = []
    run_plan(plan, path, 1, progress=lambda *words: told.append(words))
    return [done for what, done, _ in told if what.endswith("evaluations")]


def test_a_tuning_whose_last_generation_was_written_half_goes_on_from_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = run_plan(tuning_plan(), tmp_path / "whole", 1).results
    replace_, names = os.replace, list[str]()

    def dies(source: str, target: Path) -> None:
        names.append(Path(target).name)
        if len([name for name in names if name.startswith("unfinished")]) == 3:
            raise KeyboardInterrupt  # between the temporary file and its name
        replace_(source, target)

    monkeypatch.setattr(os, "replace", dies)
    with pytest.raises(KeyboardInterrupt):
        run_plan(tuning_plan(), tmp_path / "stopped", 1)
    monkeypatch.setattr(os, "replace", replace_)
    assert told_by(tuning_plan(), tmp_path / "stopped") == [30]
    assert Results(tmp_path / "stopped").evaluations().equals(whole.evaluations())


def test_evaluations_that_are_damaged_are_named_and_searched_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    whole = run_plan(tuning_plan(), tmp_path, 1).results.evaluations()
    (file,) = (tmp_path / "evaluations").iterdir()
    file.write_bytes(flipped(file.read_bytes(), 999))
    assert told_by(tuning_plan(), tmp_path) == [10, 20, 30]
    assert f"evaluations/{file.name}: damaged" in caplog.text
    assert Results(tmp_path).evaluations().equals(whole)


def test_checks_that_are_missing_are_made_without_another_search(tmp_path: Path) -> None:
    whole = run_plan(tuning_plan(), tmp_path, 1).results.checks()
    next((tmp_path / "checks").iterdir()).unlink()
    assert told_by(tuning_plan(), tmp_path) == []
    assert Results(tmp_path).checks().equals(whole)


def test_parts_of_an_earlier_tuning_of_the_plan_are_no_other_work(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    results = run_plan(tuning_plan(cells=True), tmp_path, 1).results
    before = {file.name for file in (tmp_path / "episodes").iterdir()}
    (evaluations,) = results.parts("evaluations")
    table = parts.read(tmp_path, f"evaluations/{evaluations}")
    costs = pa.array([*table["cost"].to_pylist()[:-1], -1.0])  # as if other code had found the last one best
    other = table.set_column(table.schema.names.index("cost"), "cost", costs)
    parts.write(tmp_path, f"evaluations/{evaluations}", other, {"code": results.code_of("evaluations", evaluations)})
    run_plan(tuning_plan(cells=True), tmp_path, 1)
    assert "1 parts of an earlier tuning are removed" in caplog.text
    after = {file.name for file in (tmp_path / "episodes").iterdir()}
    assert (len(before), len(after), len(before & after)) == (2, 2, 1)
