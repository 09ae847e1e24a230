"""What the pages tell of one's own controller, metric, world and study is what happens."""

import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
from commands import Command
from pages import ROOT, blocks_of, write_files

DOCS = ROOT / "docs"
OWN = ("--config-dir", "conf")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A user's folder, with the pages' own controllers, metric, world and study."""
    for page in ("own-controller", "own-metric", "own-world", "own-study"):
        write_files(DOCS / f"{page}.md", tmp_path)
    shutil.rmtree(tmp_path / "mine")  # of the page on worlds, which has no mine.py
    return tmp_path


def test_your_own_controller_takes_about_ten_lines(folder: Path) -> None:
    code = [line for line in (folder / "mine.py").read_text().splitlines() if line.strip()]
    assert len(code) <= 12


def test_the_pages_show_one_controller_of_your_own() -> None:
    shown = [{b.file: b.text for b in blocks_of(DOCS / f"own-{page}.md")} for page in ("controller", "study")]
    for file in ("mine.py", "conf/controller/mine.yaml"):
        assert shown[0][file] == shown[1][file]


@pytest.mark.parametrize("simulator", ["planar", "pybullet"])
@pytest.mark.parametrize("name", ["mine", "compiled_mine"])
def test_your_own_controller_runs_in_both_simulators(name: str, simulator: str, folder: Path, command: Command) -> None:
    printed = command(*OWN, f"controller={name}", "world=empty", f"simulator={simulator}").out
    assert re.search(rf"^{name} +empty +khepera3 +1 of 1 ", printed, re.M)


def test_a_compiled_controller_of_your_own_is_listed_as_such(folder: Path, command: Command) -> None:
    assert "[compiled]" in command(*OWN, "list", "controller").out.split("compiled_mine")[1]


def test_your_own_controller_with_a_native_robot_drives_a_larger_one(folder: Path, command: Command) -> None:
    printed = command(*OWN, "controller=sized", "world=empty_100").out
    assert re.search(r"^sized +empty_100 +disc4 +1 of 1 ", printed, re.M)


def test_your_own_metric_is_in_the_table(folder: Path, command: Command) -> None:
    printed = command("controller=sflc", "world=deadlock", "metrics=[measured.detour]").out
    assert printed.splitlines()[0].endswith("detour")


def test_your_own_study_answers_its_claims_with_a_measure_of_your_own(folder: Path, command: Command) -> None:
    printed = command("study", "quicker", *OWN, "workers=2").out
    assert "report: results/quicker/report.md" in printed
    assert re.search(r"^quicker: undecided, -?[\d.]+ \[-[\d.]+, [\d.]+\]\nturns: supported, [\d.]+ \[", printed, re.M)
    table = pd.read_csv(folder / "results/quicker/claims.csv").set_index("id")
    assert table["verdict"].to_dict() == {"quicker": "undecided", "turns": "supported"}
    assert table["n"].tolist() == [20, 20]
    refused = command("report", "outputs/study/quicker")
    assert refused.code == 2
    assert "turns.most_turning: lies outside navbench; --trust" in refused.err
    command("report", "outputs/study/quicker", "--trust", "out=again")
    made = "`navbench study quicker --config-dir conf` runs it all and writes this report; `navbench report "
    made += "outputs/study/quicker --trust` writes the report again"
    for report in ("results/quicker", "again"):
        assert made in (folder / report / "report.md").read_text()
    command("report", "outputs/study/quicker", "--trust", *OWN, "out=same")
    assert (folder / "same/report.md").read_bytes() == (folder / "again/report.md").read_bytes()
    assert (folder / "again/claims.csv").read_bytes() == (folder / "results/quicker/claims.csv").read_bytes()
