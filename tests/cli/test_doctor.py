"""``navbench doctor``: what works here and what is missing, a line each."""

import importlib.metadata
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from commands import Command

from navbench.cli import doctor as module


def lines_of(out: str) -> dict[str, str]:
    return {
        name: f"{verdict} {said}" for verdict, name, said in re.findall(r"^(ok|note|FAIL) +(\w+) +(.*)$", out, re.M)
    }


def test_a_sound_installation_fails_in_no_line(command: Command) -> None:
    done = command("doctor")
    lines = lines_of(done.out)
    assert done.code == 0, done.out
    assert {"navbench", "Python", "packages", "compiler", "planar", "pybullet", "cache", "results"} <= set(lines)
    assert lines["planar"] == "ok simulator=planar works"
    assert lines["pybullet"].startswith("ok simulator=pybullet works, on pybullet")
    assert "numpy " in lines["packages"]


def test_a_missing_and_a_wrong_package_are_named_with_what_to_install(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def version(name: str) -> str:
        if name == "rich":
            raise importlib.metadata.PackageNotFoundError(name)
        return "0.1" if name == "numba" else importlib.metadata.version(name)

    monkeypatch.setattr(module, "version", version)
    done = command("doctor")
    assert done.code == 3
    said = "FAIL numba 0.1, rich missing; pip install 'numba>=0.61' 'rich>=13'"
    assert lines_of(done.out)["packages"] == said


def test_a_simulator_without_its_package_is_noted_and_costs_no_other_line(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pybullet", None)
    monkeypatch.delitem(sys.modules, "navbench.simulation.bullet", raising=False)
    lines = lines_of(command("doctor").out)
    assert re.match("note needs PyBullet: pip install pybullet ", lines["pybullet"])
    assert lines["planar"].startswith("ok ")


def test_another_python_fails(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PYTHONS", ((3, 5), (3, 6)))
    done = command("doctor")
    assert done.code == 3
    assert lines_of(done.out)["Python"].endswith("; CPython from 3.5 to 3.6 is needed")


def test_what_a_look_raises_is_its_own_line(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> module.Line:
        raise RuntimeError("no\nluck")

    monkeypatch.setattr(module, "_videos", broken)
    done = command("doctor")
    assert done.code == 3
    assert lines_of(done.out)["videos"] == "FAIL RuntimeError: no luck"
    assert "results" in lines_of(done.out)


def test_a_display_is_told_from_none(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", "elsewhere:7")
    assert lines_of(command("doctor").out)["window"].startswith("ok ")
    monkeypatch.delenv("DISPLAY")
    assert lines_of(command("doctor").out)["window"].startswith("note no display")


def test_a_cache_that_cannot_be_written_is_noted(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NAVBENCH_CACHE_DIR", "/dev/null/nowhere")
    assert "NAVBENCH_CACHE_DIR=/dev/null/nowhere cannot be written; " in lines_of(command("doctor").out)["cache"]


def test_doctor_takes_no_words_but_help(command: Command) -> None:
    assert command("doctor", "--help").out == module.HELP
    done = command("doctor", "sflc")
    assert (done.code, done.err) == (2, "navbench: doctor sflc: unknown word; doctor takes none\n")


def test_without_compiled_functions_no_run_begins(tmp_path: Path) -> None:
    def said(*words: str) -> tuple[int, str]:
        environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
        command = [sys.executable, "-m", "navbench", *words]
        done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
        return done.returncode, done.stdout + done.stderr

    code, line = said("controller=go_to_goal", "world=corner", "simulator=planar")
    assert (code, line) == (2, "navbench: NUMBA_DISABLE_JIT: must not be set: robots move and sense in compiled code\n")
    assert list(tmp_path.iterdir()) == []
    code, lines = said("doctor")
    assert code == 3
    assert (
        lines_of(lines)["compiler"] == "FAIL NUMBA_DISABLE_JIT is set: robots move and sense in compiled code; unset it"
    )
