"""What the README tells a reader to type works, word for word."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

README = (Path(__file__).parents[1] / "README.md").read_text()
NAVBENCH = shutil.which("navbench", path=str(Path(sys.executable).parent)) or "navbench"


def block_after(words: str, language: str) -> str:
    """The first fenced block of a language after some words."""
    found = re.search(rf"```{language}\n(.*?)```", README[README.index(words) :], re.S)
    assert found
    return found[1]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A user's folder, with the README's own controller and world."""
    for group in ("controller", "world", "study"):
        (tmp_path / "conf" / group).mkdir(parents=True)
    (tmp_path / "mine.py").write_text(block_after("`mine.py`", "python"))
    (tmp_path / "measured.py").write_text(block_after("`measured.py`", "python"))
    (tmp_path / "conf/controller/mine.yaml").write_text(block_after("`conf/controller/mine.yaml`", "yaml"))
    (tmp_path / "conf/controller/sized.yaml").write_text(block_after("drive robots of", "yaml"))
    (tmp_path / "conf/study/quicker.yaml").write_text(block_after("`conf/study/quicker.yaml`", "yaml"))
    (tmp_path / "turns.py").write_text(block_after("`turns.py`", "python"))
    (tmp_path / "conf/world/gate.yaml").write_text(block_after("`conf/world/gate.yaml`", "yaml"))
    return tmp_path


def navbench(folder: Path, *words: str) -> str:
    done = subprocess.run([NAVBENCH, *words], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_your_own_controller_takes_about_ten_lines(folder: Path) -> None:
    code = [line for line in (folder / "mine.py").read_text().splitlines() if line.strip()]
    assert len(code) <= 12


def test_your_own_controller_runs_from_a_folder_outside_the_project(folder: Path) -> None:
    printed = navbench(folder, "--config-dir", "conf", "controller=mine", "world=empty")
    assert re.search(r"^mine +empty +khepera3 +1 of 1 ", printed, re.M)


def test_your_own_controller_in_python_runs_in_planar_too(folder: Path) -> None:
    printed = navbench(folder, "--config-dir", "conf", "controller=mine", "world=empty", "simulator=planar")
    assert re.search(r"^mine +empty +khepera3 +1 of 1 ", printed, re.M)


def test_a_compiled_controller_of_your_own_runs_in_planar_as_in_pybullet(folder: Path) -> None:
    (folder / "compiled_mine.py").write_text(block_after("`compiled_mine.py`", "python"))
    yaml = "# A compiled policy\nbuild: {_target_: compiled_mine.Mine, gain: 2.0, near_m: 0.1}\n"
    (folder / "conf/controller/compiled_mine.yaml").write_text(yaml)
    assert "[compiled]" in navbench(folder, "--config-dir", "conf", "list", "controller").split("compiled_mine")[1]
    for simulator in ("planar", "pybullet"):
        words = ("controller=compiled_mine", "world=empty", f"simulator={simulator}")
        assert re.search(
            r"^compiled_mine +empty +khepera3 +1 of 1 ", navbench(folder, "--config-dir", "conf", *words), re.M
        )


def test_your_own_controller_with_a_native_robot_drives_a_larger_one(folder: Path) -> None:
    printed = navbench(folder, "--config-dir", "conf", "controller=sized", "world=empty_100")
    assert re.search(r"^sized +empty_100 +disc4 +1 of 1 ", printed, re.M)


def test_your_own_metric_is_in_the_table(folder: Path) -> None:
    command = re.search(r"`navbench ([^`]*metrics=[^`]*)`", README)
    assert command
    printed = navbench(folder, *shlex.split(command[1]))
    assert printed.splitlines()[0].endswith("detour")


def test_your_own_world_runs(folder: Path) -> None:
    printed = navbench(folder, "--config-dir", "conf", "controller=sflc", "world=gate")
    assert re.search(r"^sflc +gate +khepera3 +\d of 1 ", printed, re.M)
    assert "controller_error" not in printed


def test_your_own_study_answers_its_claims_with_a_measure_of_your_own(folder: Path) -> None:
    printed = navbench(folder, "study", "quicker", "--config-dir", "conf", "workers=2")
    assert "report: results/quicker/report.md" in printed
    table = pd.read_csv(folder / "results/quicker/claims.csv").set_index("id")
    assert table["verdict"].to_dict() == {"quicker": "undecided", "turns": "supported"}
    assert table["n"].tolist() == [20, 20]
    refused = subprocess.run([NAVBENCH, "report", "outputs/study/quicker"], cwd=folder, capture_output=True, text=True)
    assert refused.returncode == 2
    assert "turns.most_turning: lies outside navbench; --trust" in refused.stderr
    navbench(folder, "report", "outputs/study/quicker", "--trust", "out=again")
    made = "`navbench study quicker --config-dir conf` runs it all and writes this report; `navbench report "
    made += "outputs/study/quicker --trust` writes the report again"
    for report in ("results/quicker", "again"):
        assert made in (folder / report / "report.md").read_text()
    navbench(folder, "report", "outputs/study/quicker", "--trust", "--config-dir", "conf", "out=same")
    assert (folder / "same/report.md").read_bytes() == (folder / "again/report.md").read_bytes()
    assert (folder / "again/claims.csv").read_bytes() == (folder / "results/quicker/claims.csv").read_bytes()


def test_the_readme_prints_what_the_first_command_prints(folder: Path) -> None:
    printed = navbench(folder, "controller=sflc", "world=deadlock")
    shown = README[README.index("controller    world ") :].split("```")[0]
    assert shown.strip() == printed[: printed.index("\nresults:")].strip()
