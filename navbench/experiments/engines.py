"""Where work runs: one generator hides whether a batch runs here or in another process, and what happens to it there.

The pieces of a batch whose process dies are run again singly, each in a process of its own, so that only the piece that
kills is lost, and the rest of the work goes on. A batch whose process was killed from outside is tried again later.
"""

import atexit
import os
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import suppress
from functools import cache
from multiprocessing import current_process
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, Generic, NamedTuple, TypeVar

from navbench.experiments.workers import Death, Worker, place, start_server
from navbench.validation import DescriptionError

Batch = TypeVar("Batch")
Result = TypeVar("Result")

TRIES = 3  # of what the machine kills


class Work(NamedTuple, Generic[Batch, Result]):
    """A kind of work.

    Attributes:
        do: does one batch; it and its batches can be sent to another process.
        pieces: cuts a batch that keeps dying into smaller ones, in order.
        lost: the result of a piece whose process died, and of what; of a whole batch where it was killed from outside.
        join: puts the results of a batch's pieces together.
    """

    do: Callable[[Batch], Result]
    pieces: Callable[[Batch], Sequence[Batch]]
    lost: Callable[[Batch, Death], Result]
    join: Callable[[Sequence[Result]], Result]


def run(
    work: Work[Batch, Result], batches: Sequence[Batch], engine: str = "local", workers: int | None = None
) -> Generator[tuple[int, Result], None, None]:
    """Run the work on each batch and yield (index of the batch, result) as they finish, in any order.

    Args:
        work: what to do.
        batches: what to do it on.
        engine: where: "local", this machine's cores.
        workers: processes, no more than there are batches; None for one a core; 0 does all in this process, as does a
            process that may have no others, such as those of ``multiprocessing.Pool``.

    Raises:
        ValueError: there is no such engine.
        Exception: whatever the work raises; what finished before has been yielded.
    """
    if engine not in ENGINES:
        raise ValueError(f"engine={engine}: there is no such engine; allowed: {', '.join(ENGINES)}")
    if workers == 0 or current_process().daemon:
        for index, batch in enumerate(batches):
            yield index, work.do(batch)
    else:
        yield from ENGINES[engine](work, batches, min(workers or os.cpu_count() or 1, len(batches)))


def start(modules: Sequence[str]) -> None:
    """Begin to start the processes in which ``run`` will do local work, and return at once.

    Args:
        modules: what they import.
    """
    thread = Thread(target=start_server, args=(modules,))
    thread.start()
    thread.join()


def in_processes(
    do: Callable[[Batch], Result], items: Sequence[Batch], engine: str = "local", workers: int | None = None
) -> list[Result]:
    """Return what ``do`` makes of each item, in order, as ``map`` does, but from several processes.

    Args:
        do: what to do; it and the items can be sent to another process.
        items: what to do it on.
        engine: where, as in ``run``.
        workers: processes, as in ``run``.

    Raises:
        DescriptionError: a process died of an item.
        Exception: whatever it raises.
    """

    def lost(item: Batch, death: Death) -> Result:
        raise DescriptionError(f"{death.reason}, at its work on {str(item)[:100]}")

    work = Work(do, lambda item: [item], lost, lambda pieces: pieces[0])
    done = dict(run(work, items, engine, workers))
    return [done[index] for index in range(len(items))]


def _run_locally(work: Work[Batch, Result], batches: Sequence[Batch], workers: int) -> Iterator[tuple[int, Result]]:
    """Run batches in worker processes of this machine, each of which a thread looks after."""
    todo: SimpleQueue[tuple[int, int]] = SimpleQueue()
    done: SimpleQueue[tuple[int, Result, BaseException | None]] = SimpleQueue()
    keepers = [_Keeper(work, batches, todo, done) for _ in range(workers)]
    for index in range(len(batches)):
        todo.put((index, TRIES))
    try:
        for keeper in keepers:
            keeper.start()
        for _ in batches:
            index, result, error = done.get()
            if error is not None:
                raise error
            yield index, result
    finally:  # also at an interrupt, an error of the work, or when the caller wants no more
        for keeper in keepers:
            keeper.stop()


class _Keeper(Thread):
    """Has a worker do batches that nobody has begun, one after another."""

    def __init__(self, work: Work[Any, Any], batches: Sequence[Any], todo: SimpleQueue[Any], done: Any) -> None:
        super().__init__(daemon=True)
        self._work, self._batches, self._todo, self._done = work, batches, todo, done
        self._worker: Worker | None = None
        self._stopped = False

    def run(self) -> None:
        """Do batches until none is left."""
        with suppress(Empty):
            while not self._stopped:
                index, tries = self._todo.get_nowait()
                try:
                    self._try(index, tries)
                except BaseException as error:  # of the work; it is raised where results are awaited
                    self._done.put((index, None, error))

    def stop(self) -> None:
        """Do no more: what is under way is ended, and nothing of it is written any more."""
        self._stopped = True
        if self._worker is not None:
            self._worker.kill()
        if self.is_alive():
            self.join()

    def _try(self, index: int, tries: int) -> None:
        """Do a batch, or have it tried again later."""
        batch, worker = self._batches[index], _worker()
        try:
            result = self._do(worker, batch)
        finally:
            _idle().append(worker)
        if isinstance(result, Death):
            if result.by_machine and tries > 1:
                self._todo.put((index, tries - 1))
                return
            if result.by_machine:
                result = self._work.lost(batch, result)
            else:
                result = self._work.join([self._alone(piece) for piece in self._work.pieces(batch)])
        self._done.put((index, result, None))

    def _alone(self, piece: Any) -> Any:
        """Return what a piece comes to in a process of its own."""
        for _ in range(TRIES):
            worker = Worker()
            try:
                result = self._do(worker, piece)
            finally:
                worker.kill()
            if not (isinstance(result, Death) and result.by_machine):
                break
        return self._work.lost(piece, result) if isinstance(result, Death) else result

    def _do(self, worker: Worker, batch: Any) -> Any:
        self._worker = worker
        if self._stopped:
            raise InterruptedError
        try:
            return worker.do(self._work.do, batch)
        finally:
            self._worker = None


def _worker() -> Worker:
    """Return a worker that has nothing to do, or a new one."""
    with suppress(IndexError):
        while True:
            worker = _idle().pop()
            if worker.alive and worker.place == place():
                return worker
            worker.kill()
    return Worker()


@cache
def _idle() -> list[Worker]:
    """Return the list of workers that have nothing to do; they are kept for the next call."""
    return []


@atexit.register
def end_workers() -> None:
    """End the workers that have nothing to do."""
    while _idle():
        _idle().pop().kill()


ENGINES: dict[str, Callable[[Any, Any, int], Iterator[tuple[int, Any]]]] = {"local": _run_locally}
