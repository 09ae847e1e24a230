"""Memory over many episodes, and start-up."""

import ctypes
import gc
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from typing import ParamSpec, TypeVar

import psutil

from benchmarks.harness import Cell, Effort, Table, median
from navbench.cli.configuration import compose_cell
from navbench.cli.study_configuration import compose_study

Given = ParamSpec("Given")
Returned = TypeVar("Returned")

WORLDS = {"discs": "random_discs", "polygons and movers": "random_movers", "robots that meet": "random_crossing"}
EPISODE = ("-m", "navbench", "controller=sflc", "world=no_deadlock")
COMMANDS = {
    "navbench --help": ("-m", "navbench", "--help"),
    "import navbench": ("-c", "import navbench"),
    "one episode, planar": (*EPISODE, "simulator=planar"),
    "one episode, planar, in the driver's own process": (*EPISODE, "simulator=planar", "workers=0"),
    "one episode, pybullet": (*EPISODE, "simulator=pybullet"),
}
SUBREAPER = 36  # of Linux's prctl: processes that lose their parent become this one's children


def apart(do: Callable[Given, Returned], *given: Given.args, **more: Given.kwargs) -> Returned:
    """Return what a function returns in a new process."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
        return process.submit(do, *given, **more).result()


def resident_mb(world: str, simulator: str, after: tuple[int, ...]) -> list[float]:
    """Return the memory that this process holds after so many short episodes, each a layout of its own [MB]."""
    found = []
    cell = compose_cell("controller=oa_to", f"world={world}", f"simulator={simulator}", "world.time_limit_s=1.0")
    with cell.runner() as runner:
        for episode in range(after[-1] + 1):
            runner.run(episode)
            if episode in after:
                gc.collect()
                found.append(psutil.Process().memory_info().rss / 1e6)
    return found


def memory(effort: Effort) -> Table:
    """Measure memory, a process for each case; flat is what grows by at most 5 MB."""
    after = (effort.cut(100), effort.cut(1000, 3), effort.cut(10000, 4))
    rows: list[tuple[Cell, ...]] = []
    for name, world in list(WORLDS.items())[: effort.few(len(WORLDS))]:
        for simulator in ("pybullet", "planar"):
            held = apart(resident_mb, world, simulator, after)
            rows.append((f"{name}, {simulator}", *held, held[-1] - held[0]))
    header = ("", *(f"after {count:,} [MB]" for count in after), "growth [MB]")
    return Table("Memory", "Resident memory of a process that runs episodes, another layout each.", header, rows)


def startup(effort: Effort) -> Table:
    """Measure the command line in new processes, at first without compiled code, and a study's composition."""
    rows: list[tuple[Cell, ...]] = []
    for name, words in list(COMMANDS.items())[: effort.few(len(COMMANDS))]:
        anew, *again = apart(cpu_seconds, [sys.executable, *words], 1 + effort.rounds)
        rows.append((name, anew, median(again)))
    begin_s = time.process_time()
    compose_study("smoke" if effort.is_quick else "papers")
    rows.append(("composing a study", "", time.process_time() - begin_s))
    return Table(
        "Start-up",
        "CPU seconds of a new process and of those that it starts.",
        ("", "nothing kept", "compiled code kept"),
        rows,
    )


def cpu_seconds(command: list[str], times: int) -> list[float]:
    """Return what a command and all its processes take each time, in a folder that keeps compiled code [s]."""
    found = []
    if sys.platform == "linux":  # where the server of the worker processes outlives the command
        ctypes.CDLL(None).prctl(SUBREAPER, 1)
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NAVBENCH_CACHE_DIR": folder}
        for _ in range(times):
            begin = os.times()
            subprocess.run(command, env=environment, cwd=folder, check=True, capture_output=True)
            with suppress(ChildProcessError):
                while True:
                    os.wait()
            end = os.times()
            found.append(end.children_user - begin.children_user + end.children_system - begin.children_system)
    return found
