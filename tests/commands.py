"""The command line as the tests call it: in a process of its own, or by the fixture ``command`` in this one."""

import shlex
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import psutil

NAVBENCH = str(Path(sys.executable).with_name("navbench"))


class Done(NamedTuple):
    """How a command ended."""

    code: int
    out: str
    err: str


Command = Callable[..., Done]


def in_a_process(folder: Path, *words: str) -> Done:
    done = subprocess.run([NAVBENCH, *words], cwd=folder, capture_output=True, text=True, check=False)
    return Done(done.returncode, done.stdout, done.stderr)


def typed(command: Command, folder: Path, line: str) -> Done:
    """Run a line as a reader types it; only what is no ``navbench`` needs a process of its own."""
    program, *words = shlex.split(line, comments=True)
    if program == "navbench":
        return command(*words)
    assert program == "python", line
    done = subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True, check=False)
    return Done(done.returncode, done.stdout, done.stderr)


def workers_of(pid: int) -> list[int]:
    """Return the worker processes of a driver that are alive."""
    with suppress(psutil.Error):  # it ended meanwhile
        for child in psutil.Process(pid).children():
            if any("multiprocessing.forkserver" in word for word in child.cmdline()):
                return [worker.pid for worker in child.children() if worker.status() != psutil.STATUS_ZOMBIE]
    return []
