"""What keeps a controller's episode apart from its process: a folder, global generators, forks, Ctrl-C, its time."""

import hashlib
import mmap
import os
import random
import signal
import sys
from functools import cache
from os import getpid
from typing import Any

import numpy as np

from navbench.compiled import compiled, direct
from navbench.episode.timeout import Timeout
from navbench.mathematics.streams import stream

WIPE_ON_FORK = 18  # Linux's MADV_WIPEONFORK, which ``mmap`` does not name


class Isolation:
    """Puts back what a user's code may have changed, and ends a process in which nothing should go on.

    Args:
        step_s: as of ``Timeout``.

    Attributes:
        timeout: ends this process when a step or an episode takes too long.
    """

    def __init__(self, step_s: float | None) -> None:
        self.timeout = Timeout(step_s)
        self._mark, self._folder = _mark(getpid(), WIPE_ON_FORK), os.getcwd()

    def begin(self, name: tuple[int, str, int, int]) -> None:
        """Begin a robot's episode where this was made, with Python's and numpy's global generators seeded.

        Args:
            name: seed, world, episode and robot index of the controller's streams.
        """
        os.chdir(self._folder)
        self.seed_compiled(name)
        seed, world, episode, index = name
        words = stream(seed, world, episode, "global", index).integers(2**32, size=4).tolist()
        random.seed(repr(words))
        np.random.seed(words)  # noqa: NPY002

    def seed_compiled(self, name: tuple[int, str, int, int]) -> None:
        """Seed the generators that ``random`` and ``np.random`` are in compiled code; arguments as above.

        A stream would take ten times as long, which is much for a compiled controller.
        """
        _seeding()(int.from_bytes(hashlib.sha256(repr(name).encode()).digest()[:4]))

    def check(self) -> None:
        """End this process if it is a fork of a controller's, which would go on with the episode a second time."""
        if not self._mark[0]:
            os._exit(0)


@cache
def _mark(process: int, advice: int) -> "mmap.mmap | _Process":
    """Return what begins with a true value in a process, and with a false one in its forks, those from C too.

    A page that forks get empty is read in a tenth of the time in which the system says which process this is.
    """
    if sys.platform != "linux":
        return _Process(process)
    page = mmap.mmap(-1, mmap.PAGESIZE, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    try:
        page.madvise(advice)
    except OSError:  # before Linux 4.14
        return _Process(process)
    page[0] = 1
    return page


class _Process:
    """A page that forks get empty, where there is none."""

    def __init__(self, process: int) -> None:
        self._process = process

    def __getitem__(self, _: int) -> bool:
        return getpid() == self._process


@cache
def _seeding() -> Any:
    return direct(_seed, 0)


@compiled
def _seed(number: int) -> None:
    random.seed(number)
    np.random.seed(number)  # noqa: NPY002


def let_interrupt(error: BaseException) -> None:
    """Raise what a user's code raised again if it may be Ctrl-C, which a worker does not answer."""
    if isinstance(error, KeyboardInterrupt) and signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        raise error
