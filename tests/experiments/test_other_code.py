"""Other code than a run began with, and than its driver has, makes no rows of it."""

import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest

import navbench
from navbench.experiments import remote
from navbench.experiments.code import changed, loaded
from navbench.experiments.crew import Task, end_workers
from navbench.experiments.engines import Work, run
from navbench.experiments.workers import begun

MINE = """
import os, signal


def told(number): return %r


def edit(number):
    with open(__file__, "a") as file: file.write("# edited")
    os.kill(os.getpid(), signal.SIGKILL)


class Mine:
    def reset(self, setup, rng): pass
    def act(self, observation): return %r, 0.0
"""


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A user's module, imported from the working directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    file = tmp_path / "edited.py"
    file.write_text(MINE % ("one", 0.1))
    importlib.import_module("edited")
    yield file
    del sys.modules["edited"]
    end_workers()


def change(file: Path) -> None:
    file.write_text(MINE % ("another", 0.1234))


def speed() -> float:
    build = {"build": {"_target_": "edited.Mine"}}
    result = navbench.run("world.time_limit_s=0.5", controller=build, world="empty", simulator="planar")
    return float(result.episodes["mean_speed_mps"].iloc[0])


@pytest.mark.parametrize("again", [str, importlib.reload])
def test_a_module_that_is_edited_between_two_runs_is_run_as_it_stands_now(
    mine: Path, again: Callable[[ModuleType], object]
) -> None:
    assert speed() == pytest.approx(0.1)
    change(mine)
    again(sys.modules["edited"])
    assert speed() == pytest.approx(0.1234)


def test_a_process_that_begins_after_an_edit_refuses_what_began_before(mine: Path) -> None:
    foreign = frozenset({"edited.edit"})
    work = Work(
        sys.modules["edited"].edit, lambda _: [], lambda _, death: death.reason, lambda _: "", lambda _: foreign
    )
    assert list(run(work, [0], workers=1)) == [(0, "edited: changed since this run began")]


def test_what_is_changed_is_named(mine: Path) -> None:
    before = loaded()
    assert "edited" in before
    assert "navbench.experiments.code" not in before
    assert changed(before) == ""
    change(mine)
    assert changed(before) == "edited"
    mine.unlink()
    assert changed(before) == "", "what is not there cannot be imported by mistake"


def test_the_driver_s_versions_are_named_and_told_apart() -> None:
    assert {"python", "numba", "numpy", "navbench's code"} <= set(remote.versions())


@pytest.mark.parametrize("name", ["python", "numba", "navbench's code"])
def test_a_worker_of_other_versions_is_refused_in_one_line(name: str) -> None:
    packed = remote.packed(Task(abs, -1), name, begun())
    assert remote.unpacked(remote.do(packed)) == 1
    death = remote.unpacked(remote.do(packed._replace(versions={**packed.versions, name: "0.1"})))
    remote.stop(name)
    assert death.by_machine
    assert death.reason.endswith(f" has {name} {remote.versions()[name]}, and the driver 0.1")


def test_a_worker_with_another_source_of_the_user_s_is_refused_in_one_line(mine: Path) -> None:
    packed = remote.packed(Task(sys.modules["edited"].told, 0), "edited", begun())
    change(mine)
    death = remote.unpacked(remote.do(packed))
    remote.stop("edited")
    assert death.by_machine
    assert death.reason.endswith(" has another edited than the driver")
