"""Engines: what finishes is yielded, what kills its process costs itself alone."""

import os
import signal
import sys
import time
from pathlib import Path
from typing import NamedTuple

import pytest
from commands import workers_of
from joblib.externals.loky import get_reusable_executor

from navbench.cli.configuration import compose_cell
from navbench.experiments.engines import Work, in_processes, run, start
from navbench.experiments.plan import Plan
from navbench.experiments.running import run_plan
from navbench.validation import DescriptionError

KILLER = 13


def double(batch: list[int]) -> list[int]:
    """Double some numbers; one of them kills the process that does it."""
    if KILLER in batch:
        os.kill(os.getpid(), signal.SIGKILL)
    return [2 * number for number in batch]


def _pieces(batch: list[int]) -> list[list[int]]:
    return [[number] for number in batch]


def _lost(batch: list[int]) -> list[int]:
    return [-number for number in batch]


def _join(parts: list[list[int]]) -> list[int]:
    return [number for part in parts for number in part]


DOUBLE: Work[list[int], list[int]] = Work(double, _pieces, _lost, _join)  # type: ignore[arg-type]


@pytest.mark.parametrize("workers", [1, 2])
def test_every_batch_is_done_once(workers: int) -> None:
    batches = [[1, 2], [3], [4, 5, 6]]
    assert sorted(run(DOUBLE, batches, workers=workers)) == [(0, [2, 4]), (1, [6]), (2, [8, 10, 12])]


def test_only_the_piece_that_kills_its_process_is_lost() -> None:
    batches = [[1, 2], [3, KILLER, 4], [5], [6]]
    done = sorted(run(DOUBLE, batches, workers=2))
    assert done == [(0, [2, 4]), (1, [6, -KILLER, 8]), (2, [10]), (3, [12])]


def test_a_single_batch_that_kills_its_process_is_lost_alone_too() -> None:
    assert dict(run(DOUBLE, [[1, KILLER]], workers=2)) == {0: [2, -KILLER]}


def _half(number: int) -> float:
    if number == KILLER:
        os.kill(os.getpid(), signal.SIGKILL)
    return 1.0 / number


@pytest.mark.parametrize("workers", [1, 2])
def test_in_processes_does_as_map(workers: int) -> None:
    assert in_processes(_half, [1, 2, 4, 8], workers=workers) == [1.0, 0.5, 0.25, 0.125]
    with pytest.raises(ZeroDivisionError):
        in_processes(_half, [1, 0, 2], workers=workers)


def test_in_processes_says_of_what_a_process_died() -> None:
    with pytest.raises(DescriptionError, match=f"a process died of its work on {KILLER}"):
        in_processes(_half, [1, KILLER], workers=2)


@pytest.fixture
def without_processes() -> None:
    """No process is left of what ran before."""
    get_reusable_executor(max_workers=2).shutdown(wait=True, kill_workers=True)


def _seen(module: str) -> tuple[int, bool]:
    """Return which process this is, and whether it has imported a module."""
    return os.getpid(), module in sys.modules


@pytest.mark.usefixtures("without_processes")
def test_processes_that_were_started_do_the_work_and_have_imported_what_was_named() -> None:
    start(["colorsys", "this"], 2)
    started = workers_of(os.getpid())
    assert len(started) == 2
    for module in ("colorsys", "this"):
        seen = in_processes(_seen, [module] * 8, workers=2)
        assert {process for process, _ in seen} <= set(started)
        assert any(imported for _, imported in seen)
        assert module not in sys.modules


@pytest.mark.usefixtures("without_processes")
def test_for_a_single_worker_no_process_is_started() -> None:
    start(["colorsys"], 1)
    assert workers_of(os.getpid()) == []


class _Taken(NamedTuple):
    """A batch that leaves a file where it begins."""

    file: Path


def _begin(batch: _Taken) -> float:
    batch.file.touch()
    return time.time()


def test_a_process_goes_on_while_the_caller_makes_use_of_a_result(tmp_path: Path) -> None:
    batches = [_Taken(tmp_path / str(index)) for index in range(8)]
    done = run(Work(_begin, lambda batch: [batch], _begin, lambda began: began[0]), batches, workers=2)
    next(done)
    deadline = time.monotonic() + 60.0
    while len(list(tmp_path.iterdir())) < 4 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert len(list(tmp_path.iterdir())) == 4  # two are done, and the next two were waiting
    assert len(list(done)) == 7


def test_an_unknown_engine_is_refused() -> None:
    with pytest.raises(ValueError, match="engine=cloud: there is no such engine; allowed: local"):
        list(run(DOUBLE, [[1]], engine="cloud"))


def test_an_episode_that_kills_its_process_is_a_row_with_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "suicidal.py").write_text(
        "import os, signal\n"
        "class Suicidal:\n"
        "    def reset(self, setup, rng): self.doomed = rng.random() < 0.2\n"
        "    def act(self, observation):\n"
        "        if self.doomed: os.kill(os.getpid(), signal.SIGKILL)\n"
        "        return (0.1, 0.0)\n"
    )
    (tmp_path / "conf/controller").mkdir(parents=True)
    (tmp_path / "conf/controller/suicidal.yaml").write_text("# Dies\nbuild: {_target_: suicidal.Suicidal}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    words = ("controller=suicidal", "world=empty", "episodes=8", "world.time_limit_s=0.1")
    cell = compose_cell(*words, config_dir=str(tmp_path / "conf"))
    ran = run_plan(Plan(cells=(cell,)), tmp_path / "results", workers=2)
    assert (ran.finished, ran.planned, ran.reasons) == (8, 8, ())
    rows = ran.results.episodes()
    died = rows["outcome"] == "controller_error"
    assert list(rows["episode"]) == list(range(8))
    assert 0 < died.sum() < 5
    assert set(rows["reason"][died]) == {"the controller's process died"}
    assert set(rows["outcome"][~died]) == {"timed_out"}
    assert ran.results.finished() == {rows["run_id"][0]: set(range(8))}
    assert len(list((tmp_path / "results/episodes").iterdir())) == 2
