"""A crew: the worker processes of this machine, one task each, that threads have do their tasks."""

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from multiprocessing.util import Finalize
from threading import Lock
from typing import Any, NamedTuple

from navbench.experiments.workers import Death, Worker, begun
from navbench.raised import one_line


class Task(NamedTuple):
    """What a worker process is to do.

    Attributes:
        do: a function; it and its argument can be sent to another process.
        argument: what it is called with.
        alone: whether in a process of its own, which does nothing else.
        foreign: what it runs that is not navbench's own, see ``Cell``: no process runs two such sets, nor one and
            what has none, since what one patches or leaves behind would be the other's.
    """

    do: Callable[[Any], Any]
    argument: Any
    alone: bool = False
    foreign: frozenset[str] = frozenset()


class Crew:
    """Does tasks, each in a worker process, for any number of threads, until it is stopped.

    Attributes:
        idle: the workers that have nothing to do: those of this list, and no other, take a task.
    """

    def __init__(self, idle: list[Worker]) -> None:
        self.idle = idle
        self._busy: set[Worker] = set()
        self._lock = Lock()
        self._stopped = False
        self._begun = begun()

    def do(self, task: Task) -> Any:
        """Return what a task comes to, or the ``Death`` that its process died of it.

        Raises:
            InterruptedError: the crew was stopped.
            Exception: whatever the task raises.
        """
        try:
            worker = Worker(self._begun, task.foreign) if task.alone else self._worker(task.foreign)
        except (EOFError, OSError) as error:  # what workers are forked from was killed, or there is no room for more
            return Death(f"its process could not be started: {one_line(error)}", by_machine=True)
        with self._lock:
            self._busy.add(worker)
        try:
            if self._stopped:
                raise InterruptedError
            return worker.do(task.do, task.argument)
        finally:
            with self._lock:
                self._busy.remove(worker)
            if task.alone:
                worker.kill()
            else:
                self.idle.append(worker)

    def stop(self) -> None:
        """Do no more: what is under way is ended, and nothing of it is written any more."""
        with self._lock:
            self._stopped = True
            for worker in self._busy:
                worker.kill()

    def end(self) -> None:
        """Stop, and end the idle workers, too."""
        self.stop()
        while self.idle:
            self.idle.pop().kill()

    def _worker(self, foreign: frozenset[str]) -> Worker:
        """Return an idle worker that runs this and nothing else, or a new one in the place of another."""
        others: list[Worker] = []
        found = None
        with suppress(IndexError):
            while found is None:
                worker = self.idle.pop()
                if not worker.alive or worker.begun != self._begun:
                    worker.kill()
                elif worker.foreign == foreign:
                    found = worker
                else:
                    others.append(worker)
        if found is None:
            if others:
                others.pop().kill()
            found = Worker(self._begun, foreign)
        self.idle += others
        return found


def end_workers() -> None:
    """End the workers that are kept."""
    Crew(kept()).end()


@cache
def kept() -> list[Worker]:
    """Return the workers that are kept from one run to the next."""
    return []


Finalize(None, end_workers, exitpriority=1)  # for which this process would wait when it ends
