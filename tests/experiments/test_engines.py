"""Engines: what finishes is yielded, what kills its process costs itself alone."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import psutil
import pytest
from commands import workers_of

from navbench.experiments import workers
from navbench.experiments.crew import Crew, Task, end_workers
from navbench.experiments.engines import Work, in_processes, run
from navbench.experiments.workers import FORKS, Death
from navbench.validation import DescriptionError

KILLER = 13


def double(batch: list[int]) -> list[int]:
    """Double some numbers; one of them ends the process that does it."""
    if KILLER in batch:
        os._exit(7)
    return [2 * number for number in batch]


def _pieces(batch: list[int]) -> list[list[int]]:
    return [[number] for number in batch]


def _lost(batch: list[int], death: Death) -> list[int]:
    assert death == Death("its process ended with exit code 7")
    return [-number for number in batch]


def _join(parts: list[list[int]]) -> list[int]:
    return [number for part in parts for number in part]


DOUBLE: Work[list[int], list[int]] = Work(double, _pieces, _lost, _join)  # type: ignore[arg-type]


@pytest.mark.parametrize("workers", [0, 1, 2, None])
def test_every_batch_is_done_once(workers: int | None) -> None:
    batches = [[1, 2], [3], [4, 5, 6]]
    assert sorted(run(DOUBLE, batches, workers=workers)) == [(0, [2, 4]), (1, [6]), (2, [8, 10, 12])]


@pytest.mark.parametrize("workers", [1, 2])
def test_only_the_piece_that_ends_its_process_is_lost(workers: int) -> None:
    batches = [[1, 2], [3, KILLER, 4], [5], [6]]
    done = sorted(run(DOUBLE, batches, workers=workers))
    assert done == [(0, [2, 4]), (1, [6, -KILLER, 8]), (2, [10]), (3, [12])]


def test_a_single_batch_that_ends_its_process_is_lost_alone_too() -> None:
    assert dict(run(DOUBLE, [[1, KILLER]])) == {0: [2, -KILLER]}


def _end(do: Callable[[Any], Any], argument: Any) -> Any:
    """Return what a batch of one piece comes to, or what its process died of."""
    work: Work[Any, Any] = Work(do, lambda one: [one], lambda _, death: death, lambda done: done[0])
    return dict(run(work, [argument]))[0]


def _killed_at_first(marker: Path) -> str:
    """Be killed from outside, but only once."""
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def test_what_was_killed_from_outside_is_tried_again(tmp_path: Path) -> None:
    assert _end(_killed_at_first, tmp_path / "marker") == "done"


def _end_by(number: int) -> None:
    os.kill(os.getpid(), number)


@pytest.mark.parametrize(
    ("number", "by_machine"),
    [(signal.SIGKILL, True), (signal.SIGTERM, True), (signal.SIGSEGV, False), (signal.SIGABRT, False)],
)
def test_a_signal_from_outside_is_the_machines_fault_and_a_crash_is_not(number: int, by_machine: bool) -> None:
    death = _end(_end_by, number)
    assert (death.reason, death.by_machine) == (f"its process died of {signal.Signals(number).name}", by_machine)
    assert ("in _end_by" in death.traceback) != by_machine


def _killed_with_what_it_was_forked_from(_: None) -> None:
    os.kill(os.getppid(), signal.SIGKILL)
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.skipif(not FORKS, reason="workers are spawned here")
def test_whose_death_nobody_is_left_to_tell_of_was_killed_by_the_machine() -> None:
    reason = "what its process was forked from was killed"
    assert _end(_killed_with_what_it_was_forked_from, None) == Death(reason, by_machine=True)
    assert _end(os._exit, 255) == Death("its process ended with exit code 255")


def test_ctrl_c_reaches_whoever_began_a_worker_and_not_the_worker() -> None:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    blocked = Crew([]).do(Task(_blocked, None, alone=True))
    assert signal.SIGINT in blocked
    assert signal.SIGINT not in before
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before  # which children of this process inherit


def _blocked(_: None) -> set[int]:
    return {int(number) for number in signal.pthread_sigmask(signal.SIG_BLOCK, ())}


def test_a_process_that_is_stopped_is_the_machines_fault() -> None:
    assert _end(_end_by, signal.SIGSTOP) == Death("its process was stopped", by_machine=True)


def _expire(computes: bool) -> None:
    signal.setitimer(signal.ITIMER_REAL, 2.5)
    while True:
        if not computes:
            time.sleep(60.0)


@pytest.mark.parametrize("computes", [True, False])
def test_a_step_that_computes_until_the_clock_ends_it_is_the_machines_fault_and_one_that_waits_is_not(
    computes: bool,
) -> None:
    death = _end(_expire, computes)
    assert death.by_machine == computes
    assert ("too little of a core" in death.reason) == computes


def _rest(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def test_a_process_that_takes_too_much_memory_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "MEMORY_SHARE", 1e-4)
    death = _end(_rest, 60.0)
    assert death.reason.startswith("its process took more than 0.0")
    assert not death.by_machine


def _leave(file: Path) -> None:
    """Start a process, say which, and end this one."""
    file.write_text(str(subprocess.Popen(["sleep", "600"]).pid))
    os._exit(1)


def test_what_a_process_has_started_ends_with_it(tmp_path: Path) -> None:
    _end(_leave, tmp_path / "pid")
    left = int((tmp_path / "pid").read_text())
    deadline = time.monotonic() + 10.0
    while psutil.pid_exists(left) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not psutil.pid_exists(left)


def _write_late(file: Path) -> None:
    file.with_name("begun").touch()
    time.sleep(0.5)
    file.touch()


def test_nothing_is_written_any_more_when_the_caller_wants_no_more(tmp_path: Path) -> None:
    work = Work(_write_late, lambda file: [file], lambda *_: None, lambda done: done[0])
    quick, late = tmp_path / "quick", tmp_path / "late" / "late"
    late.parent.mkdir()
    with closing(run(work, [quick, late], workers=1)) as done:
        next(done)
        while not (tmp_path / "late" / "begun").exists():
            time.sleep(0.01)
    time.sleep(0.7)
    assert not late.exists()


def _leave_folder(folder: str) -> str:
    os.chdir(folder)
    return os.getcwd()


def test_every_batch_begins_in_the_callers_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "below").mkdir()
    assert in_processes(_leave_folder, ["below", "below"], workers=1) == [str(tmp_path / "below")] * 2


def told_by_script(folder: Path, *lines: str) -> tuple[str, str]:
    """Run a script in a process of its own, and return what it prints and complains of."""
    (folder / "script.py").write_text("\n".join(lines))
    done = subprocess.run([sys.executable, "script.py"], cwd=folder, capture_output=True, text=True, check=False)
    return done.stdout, done.stderr


def test_a_script_needs_no_guard(tmp_path: Path) -> None:
    told = told_by_script(
        tmp_path,
        "from navbench.experiments.engines import in_processes",
        "class Double:",
        "    def __call__(self, number): return 2 * number",
        "print(in_processes(Double(), [1, 2]))",
    )
    assert told == ("[2, 4]\n", "")


def _half(number: int) -> float:
    if number == KILLER:
        os._exit(7)
    return 1.0 / number


@pytest.mark.parametrize("workers", [0, 1, 2])
def test_in_processes_does_as_map(workers: int) -> None:
    assert in_processes(_half, [1, 2, 4, 8], workers=workers) == [1.0, 0.5, 0.25, 0.125]
    with pytest.raises(ZeroDivisionError):
        in_processes(_half, [1, 0, 2], workers=workers)


def test_in_processes_says_of_what_a_process_died() -> None:
    with pytest.raises(DescriptionError, match=f"its process ended with exit code 7, at its work on {KILLER}"):
        in_processes(_half, [1, KILLER], workers=2)


def _raise_unlike(number: int) -> None:
    raise Unlike(number, "a word")


class Unlike(Exception):
    """An exception that pickle cannot make again."""

    def __init__(self, number: int, word: str) -> None:
        super().__init__(word)


def test_an_exception_that_cannot_be_sent_is_told() -> None:
    with pytest.raises(RuntimeError, match="Unlike: a word"):
        in_processes(_raise_unlike, [1])


def _seen(module: str) -> tuple[int, bool]:
    """Return which process this is, and whether it has imported a module."""
    return os.getpid(), module in sys.modules


def test_processes_have_imported_what_was_named(tmp_path: Path) -> None:
    told = told_by_script(
        tmp_path,
        "import sys",
        "from navbench.experiments.engines import in_processes, start",
        "start(['colorsys', 'navbench.experiments.nothing'])",
        "print(in_processes(lambda name: name in sys.modules, ['colorsys']), 'colorsys' in sys.modules)",
    )
    assert told == ("[True] False\n", "")


def test_workers_are_kept_for_the_next_call_unless_they_import_from_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    end_workers()
    (first, _), (second, _) = (in_processes(_seen, ["this"])[0] for _ in range(2))
    assert first == second
    assert workers_of(os.getpid()) == [first]
    monkeypatch.syspath_prepend(str(tmp_path))
    assert in_processes(_seen, ["this"])[0][0] != first
    end_workers()
    assert workers_of(os.getpid()) == []


def test_without_workers_all_is_done_in_this_process() -> None:
    assert in_processes(_seen, ["sys"], workers=0) == [(os.getpid(), True)]


class _Taken(NamedTuple):
    """A batch that leaves a file where it begins."""

    file: Path


def _begin(batch: _Taken) -> float:
    batch.file.touch()
    return time.time()


def test_a_process_goes_on_while_the_caller_makes_use_of_a_result(tmp_path: Path) -> None:
    batches = [_Taken(tmp_path / str(index)) for index in range(8)]
    done = run(Work(_begin, lambda batch: [batch], lambda *_: 0.0, lambda began: began[0]), batches, workers=2)
    next(done)
    deadline = time.monotonic() + 60.0
    while len(list(tmp_path.iterdir())) < 8 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert len(list(tmp_path.iterdir())) == 8
    assert len(list(done)) == 7
