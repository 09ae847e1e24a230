"""The benchmarks run; how fast anything is, is not tested."""

import csv
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import soak
from benchmarks.__main__ import SECTIONS, main
from benchmarks.coverage import BAR, CASES, FILES, KINDS
from benchmarks.harness import Table, shown
from benchmarks.scaling import SIZES, field_of
from navbench.mathematics.statistics import Estimate
from navbench.records import RobotRecord
from navbench.world.layout import Layout
from navbench.world.shapes import Disc


def test_every_section_runs_and_finds_finite_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for size, small in (("coverage.DRAWS", 10_000), ("coverage.SCRAMBLES", 100), ("rays.CELLS", 400)):
        monkeypatch.setattr(f"benchmarks.{size}", small)
    studies = tmp_path / "studies.csv"
    studies.write_text("papers,1234.5\n")
    tables = main(["--quick", "--studies", str(studies)], tmp_path / "README.md")
    assert len(tables) == len(SECTIONS) + 1
    for table in tables:
        assert table.figures(), table.title
        assert all(map(math.isfinite, table.figures())), table
    assert not (tmp_path / "README.md").exists(), "a quick run says nothing about speed"


def test_a_section_measured_anew_leaves_the_others_in_the_readme(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SECTIONS, "rays", lambda effort: SECTIONS["loop"](effort)._replace(title="Rays"))
    monkeypatch.setitem(SECTIONS, "loop", lambda effort: sample("Closed loop", float(effort.rounds)))
    readme = tmp_path / "README.md"
    main(["loop", "rays", "--rounds", "3"], readme)
    main(["loop", "--rounds", "4"], readme)
    text = readme.read_text()
    assert text.count("## ") == 2
    assert "| a | 4.00 |" in text.split("## Rays")[0]
    assert "| a | 3.00 |" in text.split("## Rays")[1]


@pytest.mark.parametrize("kind", SIZES)
def test_whatever_grows_robots_drive_to_the_time_limit(kind: str) -> None:
    for size in SIZES[kind]:
        with field_of(kind, size).runner("planar", steps=5) as runner:
            assert {record.outcome for record in runner.run(0)} == {"timed_out"}, size


def test_an_unknown_section_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["lop"])
    assert "section lop: must be one of loop, " in capsys.readouterr().err


def test_every_interval_holds_the_truth_from_the_number_of_cases_on_at_which_it_is_told() -> None:
    with FILES[0].open() as file:
        lines = list(csv.DictReader(file))
    assert {line["interval"]: line["truth"] for line in lines}.keys() == KINDS.keys()
    for name, kind in KINDS.items():
        told = [line for line in lines if line["interval"] == name and int(line["cases"]) >= kind.least]
        assert {(line["truth"], int(line["cases"])) for line in told} == {
            (truth, n) for truth in kind.truths for n in CASES if n >= kind.least
        }
        assert all(float(line["told"]) == 1.0 and float(line["coverage"]) >= BAR for line in told), name
        assert all(int(line["samples"]) >= 10_000 for line in told)


def test_figures_have_three_digits() -> None:
    assert [shown(x) for x in (1234567.0, 12.345, 0.012345, 0.0)] == ["1,230,000", "12.3", "0.0123", "0"]
    assert shown(Estimate(1.0, 0.5, 2.0, 3)) == "1.00 [0.500, 2.00]"
    assert shown(Estimate(1.0, math.nan, math.nan, 3)) == "1.00"


def sample(title: str, figure: float) -> Table:
    return Table(title, "What it is.", ("", "figure"), [("a", figure)])


def test_the_checker_of_the_soak_finds_no_fault_in_either_simulator() -> None:
    for simulator in ("planar", "pybullet"):
        findings = [finding for number in range(8) for finding in soak.check(number, simulator)]
        told, is_well = soak.row(simulator, findings)
        assert is_well, told
        assert sum(finding.off_touch_m > 0.0 for finding in findings) >= 3


def test_the_checker_of_the_soak_sees_what_a_simulator_would_have_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    number = next(k for k in range(3, 99) if soak.run(soak.scene(k), k, "planar")[0].outcome == "reached")
    driven = soak.run

    def late(layout: Layout, number: int, simulator: str) -> list[RobotRecord]:
        first, *others = driven(layout, number, simulator)
        states = first.states.copy()
        states[-1, 0] += 1e-7
        return [first._replace(states=states), *others]

    monkeypatch.setattr(soak, "run", late)
    assert soak.check(number, "planar")[0].arrival > soak.INSTANT
    x, y = driven(soak.scene(number), number, "planar")[0].states[-5, 1:3].tolist()
    monkeypatch.setattr(soak, "run", driven)
    (path, *_), layout = [soak.Path(r) for r in driven(soak.scene(number), number, "planar")], soak.scene(number)
    post = replace(layout, discs=(Disc(x + 0.1 + 1e-3 - 1e-6, y, 1e-3),))
    assert soak.least_gap(soak.gaps_of(post, [path], 0)[0], path.end_s, 2.0) <= -1e-6


@pytest.mark.slow
def test_what_is_killed_at_random_moments_ends_the_same_and_every_flipped_bit_is_found() -> None:
    words = [sys.executable, "-m", "benchmarks.kill", "--rounds", "5", "--parts", "4"]
    done = subprocess.run(words, cwd=Path(__file__).parents[1], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "5 of 5 rounds left the bytes of an uninterrupted run\n40 of 40 flipped bits were found\n" in done.stdout
