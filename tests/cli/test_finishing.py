"""How a command ends when its episodes have run: what fails then costs nothing else, and all that is kept is said."""

import os
import re
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from commands import Command

from navbench.cli import tables
from navbench.report import figures

STUDY = """# A small study of one's own
# @package _global_
title: mine
cells:
  - {name: fair, label: Go, overrides: [controller=go_to_goal, world=empty, world.time_limit_s=0.5], episodes: 2}
claims:
  mine: {says: mine, holds: above 0, measure: broken_things.SIDE, of: {label: Go}}
  ours: {says: ours, holds: above -1, measure: share_reached, of: {label: Go}}
report:
  - {name: verdicts, title: Claims}
  - {name: findings, sentences: [{say: "{a}", with: {a: {name: broken_things.SIDE, label: Go}}}, {say: still here}]}
  - {name: broken_things.SECTION, file: mine}
  - summary
"""
CODE = """
from navbench.mathematics.statistics import Estimate
from navbench.report.document import Column, Table


def measure_raises(stored, select):
    raise KeyError("speed")


def measure_returns_a_number(stored, select):
    return 3.0


def measure_returns_words(stored, select):
    return Estimate("a", "b", "c", 1)


def measure_works(stored, select):
    return Estimate(1.0, 1.0, 1.0, 2)


def section_raises(page):
    return 1 / 0


def section_returns_words(page):
    return "fine"


def section_has_a_ragged_table(page):
    return [page.table([Column("a", "a"), Column("b", "b")], [[1.0, 2.0], [3.0]])]


def section_works(page):
    return []
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's folder with measures and sections that fail."""
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "broken_things.py").write_text(CODE)
    (tmp_path / "conf/study").mkdir(parents=True)
    return tmp_path


def study(own: Path, command: Command, measure: str = "measure_works", section: str = "section_works") -> Any:
    text = STUDY.replace("SIDE", measure).replace("SECTION", section)
    (own / "conf/study/mine.yaml").write_text(text)
    return command("study", "mine", "--config-dir", "conf", "workers=1")


@pytest.mark.parametrize(
    ("measure", "said"),
    [
        ("measure_raises", "KeyError: 'speed' (broken_things.py, line 7: raise KeyError(\"speed\"))"),
        ("measure_returns_a_number", "must return an Estimate of numbers or None; it returned 3.0 (broken_things.py, "),
        ("measure_returns_words", "must return an Estimate of numbers or None; it returned Estimate(valu"),
    ],
)
def test_a_measure_that_fails_costs_its_own_claim_and_sentence_alone(
    own: Path, command: Command, measure: str, said: str
) -> None:
    done = study(own, command, measure)
    assert done.code == 3
    first, second = done.err.strip().splitlines()
    assert first.startswith("navbench: claims.mine: not measured: ")
    assert second.startswith(f"navbench: sentences[0].with.a=broken_things.{measure}: ")
    assert said in first
    assert said in second
    table = pd.read_csv(own / "results/mine/claims.csv").set_index("id")
    assert table["verdict"].to_dict() == {"mine": "not_testable", "ours": "supported"}
    assert said in table["reason"]["mine"]
    report = (own / "results/mine/report.md").read_text()
    assert "still here" in report
    assert "## Summary" in report
    assert len(pd.read_csv(own / "outputs/study/mine/episodes.csv")) == 2


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ("section_raises", "ZeroDivisionError: division by zero (broken_things.py, line 23: return 1 / 0)"),
        ("section_returns_words", "navbench.report.document; it returned 'fine' (broken_things.py, line 26)"),
        ("section_has_a_ragged_table", "IndexError: list index out of range"),
    ],
)
def test_a_section_that_fails_says_why_in_its_place_and_all_others_are_there(
    own: Path, command: Command, section: str, said: str
) -> None:
    done = study(own, command, section=section)
    assert done.code == 3
    assert done.err.startswith(f"navbench: section broken_things.{section}: ")
    assert len(done.err.strip().splitlines()) == 1
    assert said in done.err
    report = (own / "results/mine/report.md").read_text()
    assert said in report
    assert {"## Claims", "## Findings", "## Summary", "still here"} <= set(re.findall(r"## \w+|still here", report))
    again = command("report", "outputs/study/mine", "--trust", "out=again")
    assert (again.code, again.err) == (3, done.err)


def test_a_study_whose_parts_all_work_ends_with_0(own: Path, command: Command) -> None:
    done = study(own, command)
    assert (done.code, done.err) == (0, "")


def test_a_sentence_with_a_measure_that_there_is_not_is_refused_before_anything_runs(
    own: Path, command: Command
) -> None:
    done = study(own, command, "measure_rases")
    assert (done.code, (own / "outputs").exists()) == (2, False)


RUN = (
    "controller=go_to_goal",
    "world=empty",
    "world.time_limit_s=0.5",
    "episodes=6",
    "workers=1",
    "hydra.run.dir=here",
)


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (KeyboardInterrupt(), 130, "interrupted after 6 of 6 episodes"),
        (OSError(28, "No space left on device", "table.csv"), 3, "table.csv: No space left on device: after 6 of 6"),
    ],
)
def test_what_stops_the_tables_says_where_the_results_are_and_how_to_go_on(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, said: str
) -> None:
    def stop(*_: Any) -> None:
        raise error

    for _ in range(2):  # also where all episodes were there before
        with monkeypatch.context() as patch:
            patch.setattr(tables, "write_table", stop)
            done = command(*RUN)
        assert done.code == code
        assert len(done.err.strip().splitlines()) == 1
        assert f"navbench: {said}" in done.err
        assert "while tables and figures were written; they are kept in here, and this goes on from there: " in done.err
        assert done.err.strip().endswith("workers=1 hydra.run.dir=here")
        assert len(pd.read_csv(tmp_path / "here/episodes.csv")) == 6
    assert command(*RUN).code == 0
    assert (tmp_path / "here/table.csv").is_file()


def test_a_figure_that_cannot_be_written_leaves_nothing_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    figure, _ = figures.new_figure(1, 1, 1.0, 1.0)
    with pytest.raises(OSError, match="No space"):
        figures.save_figure(figure, tmp_path, "one")
    assert not [file for file in tmp_path.rglob("*") if file.is_file()]
