"""What every engine on a cluster must do: as this machine's cores do, also where its processes are killed."""

import os
import signal
from multiprocessing import parent_process
from pathlib import Path

import pytest
from commands import Command

from navbench.experiments.engines import Engine, Work, run
from navbench.experiments.workers import Death

SWEEP = (
    *("-m", "controller=sflc,pid", "world=deadlock", "world.time_limit_s=0.5", "simulator=planar", "episodes=10"),
    *("start_jitter_m=0.01", "workers=2"),
)


def parts_of(folder: Path) -> dict[str, bytes]:
    """Return what a run left, but for what is never the same twice: when it ran, and how long a controller took."""
    files = (file for file in folder.rglob("*") if file.is_file())
    kept = {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}
    return {name: data for name, data in kept.items() if name != "manifest.json" and not name.startswith("latency/")}


def check_same_bytes(command: Command, folder: Path, *engine: str) -> None:
    """Run a sweep on an engine and on this machine's cores."""
    assert command(*SWEEP, "hydra.sweep.dir=here").code == 0
    done = command(*SWEEP, *engine, "hydra.sweep.dir=there")
    assert done.code == 0, done.err
    assert parts_of(folder / "there") == parts_of(folder / "here")
    assert len(list((folder / "there/latency").iterdir())) == len(list((folder / "here/latency").iterdir()))


def _kill_the_process_of_the_cluster_once(marker: Path) -> str:
    if not marker.exists():
        marker.touch()
        parent = parent_process()
        assert parent is not None
        os.kill(int(parent.pid or 0), signal.SIGKILL)
    return marker.name


def _end(number: int) -> int:
    if number < 0:
        os._exit(7)
    if number == 0:
        raise ZeroDivisionError("of the task's own")
    return number


def _lost(one: list[int], death: Death) -> list[str | int]:
    return [death.reason, *one]


NUMBERS: Work[list[int], list[str | int]] = Work(
    lambda numbers: [_end(number) for number in numbers],
    lambda numbers: [[number] for number in numbers],
    _lost,
    lambda pieces: [number for piece in pieces for number in piece],
)


def check_a_killed_process_costs_nothing(engine: Engine, folder: Path) -> None:
    """Kill the cluster's process in the middle of a task."""
    work = Work(_kill_the_process_of_the_cluster_once, lambda one: [one], lambda _, death: death.reason, "".join)
    markers = [folder / str(index) for index in range(3)]
    markers[0].touch()
    markers[2].touch()
    assert sorted(run(work, markers, engine, 2)) == [(0, "0"), (1, "1"), (2, "2")]
    assert markers[1].exists()


def check_deaths_and_errors(engine: Engine) -> None:
    """End the worker process, and raise, in a task."""
    ended = "its process ended with exit code 7"
    assert sorted(run(NUMBERS, [[1, -1, 2], [3]], engine, 2)) == [(0, [1, ended, -1, 2]), (1, [3])]
    with pytest.raises(ZeroDivisionError, match="of the task's own"):
        list(run(NUMBERS, [[0]], engine, 2))
