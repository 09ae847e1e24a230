"""``navbench verify``: what is missing of results, or other than it was written, planned and installed."""

import json
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from commands import Command, Done
from stored import a_cell, a_record, store

from navbench.cli.verify import HELP, problems_of
from navbench.experiments.store import Results

RUN = "controller=go_to_goal world=empty world.time_limit_s=0.5 simulator=planar episodes=12 workers=1".split()


def changed(path: Path, **values: object) -> None:
    """Write other values into a manifest."""
    manifest = json.loads((path / "manifest.json").read_text())
    (path / "manifest.json").write_text(json.dumps(manifest | values))


def flip(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[len(data) // 3] ^= 4
    file.write_bytes(data)


@pytest.fixture
def ran(command: Command, tmp_path: Path) -> Path:
    """A run of twelve episodes in three batches, in the working directory."""
    assert command(*RUN, "hydra.run.dir=here").code == 0
    return tmp_path / "here"


def lines_of(done: Done) -> list[str]:
    assert (done.code, done.err) == (3, "")
    return [line.removeprefix("here: ") for line in done.out.splitlines()]


def test_what_has_just_run_is_well_also_when_it_lies_elsewhere(ran: Path, command: Command) -> None:
    ran.rename(ran.with_name("there"))
    done = command("verify", "there")
    assert (done.code, done.out, done.err) == (0, "there: all well: 12 episodes in 10 parts\n", "")


@pytest.mark.parametrize("what", ["verify", "report", "show"])
def test_a_report_without_its_episodes_says_what_runs_them(tmp_path: Path, command: Command, what: str) -> None:
    (tmp_path / "report.md").touch()
    (tmp_path / "manifest.json").write_text('{"schema_version": 1, "cells": [], "study": {"name": "smoke"}}')
    done = command(what, str(tmp_path))
    said = f"navbench: {tmp_path}: a study's report without its episodes; `navbench study NAME` runs them\n"
    assert (done.code, done.out, done.err) == (2, "", said)


CHANGES: list[tuple[Callable[[Path], object], str]] = [
    (lambda path: flip(min(path.glob("episodes/*"))), "episodes/part-RUN-000000-000004.parquet: damaged"),
    (lambda path: flip(min(path.glob("latency/*"))), "latency/part-RUN-000000-000004.parquet: damaged"),
    (lambda path: min(path.glob("trajectories/*")).unlink(), "trajectories/part-RUN-000000-000004.parquet: missing"),
    (lambda path: max(path.glob("episodes/*")).unlink(), "go_to_goal in empty, seed 0: 2 of 12 episodes missing, the"),
    (lambda path: changed(path, ended=None), "manifest.json: changed since it was written"),
    (lambda path: changed(path, ended=None), "manifest.json: the work that began "),
    (lambda path: changed(path, python="3.1.4"), "Python: made with 3.1.4, here is 3."),
    (lambda path: changed(path, versions={"numpy": "0.1", "no-such": "2"}), "numpy: made with 0.1, here is "),
    (lambda path: changed(path, versions={"numpy": "0.1", "no-such": "2"}), "no-such: made with 2, here is none"),
    (lambda path: changed(path, codes={}), "3 parts are of code that the manifest does not name"),
    (lambda path: max(path.glob("episodes/*")).rename(path / "episodes/part-x.parquet"), "episodes/part-x.parquet: da"),
]


@pytest.mark.parametrize(("change", "said"), CHANGES, ids=[said for _, said in CHANGES])
def test_what_is_missing_or_other_is_a_line_and_exit_3(
    ran: Path, command: Command, change: Callable[[Path], object], said: str
) -> None:
    run_id = json.loads((ran / "manifest.json").read_text())["cells"][0]["run_id"]
    change(ran)
    assert any(line.startswith(said.replace("RUN", run_id)) for line in lines_of(command("verify", "here")))


def test_a_report_of_unfinished_work_says_so_and_ends_with_3(ran: Path, command: Command) -> None:
    max(ran.glob("episodes/*")).unlink()
    done = command("report", "here")
    assert (done.code, done.err) == (3, "navbench: here: 10 of 12 planned episodes are there\n")


def test_code_that_has_changed_since_is_named(ran: Path, command: Command) -> None:
    manifest = json.loads((ran / "manifest.json").read_text())
    for modules in manifest["codes"].values():
        modules["navbench.robot"] = "0123456789abcdef"
        modules["mine"] = "0123456789abcdef"
    changed(ran, codes=manifest["codes"])
    assert "3 parts are of other code than is here: navbench.robot, mine" in lines_of(command("verify", "here"))


def test_results_without_checksums_say_so_and_are_reported(ran: Path, command: Command) -> None:
    manifest = json.loads((ran / "manifest.json").read_text())
    for file in ran.rglob("*.parquet"):
        table = pq.read_table(file)
        code = (table.schema.metadata or {}).get(b"navbench.code", b"")
        pq.write_table(table.replace_schema_metadata({b"navbench.code": code}), file, compression="zstd")
    manifest = {key: value for key, value in manifest.items() if key not in ("checksums", "seal")}
    (ran / "manifest.json").write_text(json.dumps(manifest))
    kinds = {"episodes": 3, "trajectories": 3, "latency": 3, "layouts": 1}
    assert lines_of(command("verify", "here")) == [
        "manifest.json: no checksum",
        *(f"{kind}: no checksum in {count} parts, of an older navbench" for kind, count in kinds.items()),
    ]
    assert command("report", "here").code == 0


def test_evaluations_that_are_missing_are_named(tmp_path: Path) -> None:
    store(tmp_path, [(a_cell(), [a_record()])], costs={("pso", 0): [3.0, 2.0, 1.0, 0.5], ("pso", 1): [3.0]})
    next((tmp_path / "checks").glob("*-0-10.parquet")).unlink()
    told = list(problems_of(Results(tmp_path)))
    assert "tuning pso, seed 0: checks/part-pso-0-10.parquet: missing" in told
    assert "tuning pso, seed 1: 1 of 4 evaluations" in told
    next((tmp_path / "evaluations").glob("*-1-10.parquet")).unlink()
    assert "tuning pso, seed 1: evaluations/part-pso-1-10.parquet: missing" in list(problems_of(Results(tmp_path)))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "verify: name at least one results directory"),
        (("nope",), "verify nope: there is no such directory"),
        ((".",), ".: no results here: manifest.json is missing"),
        (("out=x",), "out=x: unknown key; verify takes directories alone"),
        (("--trust",), "--trust: unknown flag; allowed: --help"),
    ],
)
def test_a_wrong_word_is_refused_in_one_line(command: Command, words: tuple[str, ...], said: str) -> None:
    done = command("verify", *words)
    assert (done.code, done.out, done.err) == (2, "", f"navbench: {said}\n")


def test_its_help_is_printed(command: Command) -> None:
    assert command("verify", "--help").out == HELP
