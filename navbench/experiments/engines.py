"""Where work runs: one generator hides whether a batch runs here, in another process or on another machine.

The pieces of a batch whose process dies are run again singly, each in a process of its own, so that only the piece that
kills is lost, and the rest of the work goes on. A batch whose process was killed from outside is tried again later.
"""

import os
import sys
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from multiprocessing import current_process
from queue import SimpleQueue
from threading import Thread
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

from pydantic.dataclasses import dataclass as described

from navbench.experiments.crew import Crew, Task, kept
from navbench.experiments.workers import Death, MachineError, check_place, start_server
from navbench.validation import STRICT, DescriptionError

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
        foreign: what a batch runs that is not navbench's own, see ``Task``.
    """

    do: Callable[[Batch], Result]
    pieces: Callable[[Batch], Sequence[Batch]]
    lost: Callable[[Batch, Death], Result]
    join: Callable[[Sequence[Result]], Result]
    foreign: Callable[[Batch], frozenset[str]] = lambda _: frozenset()


class Cluster(Protocol):
    """Does tasks, somewhere.

    Attributes:
        limit: how many it takes before the first is done.
    """

    limit: int

    def send(self, tasks: Mapping[int, Task]) -> None:
        """Begin with some tasks, each under a number of its own."""

    def next(self) -> tuple[int, Any]:
        """Wait for any task to end; return its number, and what it came to or the ``Death`` of its process.

        Raises:
            DescriptionError: the cluster cannot do it.
            Exception: whatever the task raises.
        """

    def stop(self) -> None:
        """End what is under way and forget what is not; nothing is written any more."""


class Engine(Protocol):
    """The configuration of where work runs.

    Attributes:
        shares_files: whether its processes write into the driver's directories.
    """

    shares_files: ClassVar[bool]

    def open(self, workers: int | None) -> Cluster:
        """Return what does tasks, ready; a second call makes use of what the first one started.

        Args:
            workers: how many at a time; None for as many as the engine thinks fit.

        Raises:
            DescriptionError: it cannot be reached, and how it was tried.
        """


def run(
    work: Work[Batch, Result], batches: Sequence[Batch], engine: Engine | None = None, workers: int | None = None
) -> Generator[tuple[int, Result], None, None]:
    """Run the work on each batch and yield (index of the batch, result) as they finish, in any order.

    Args:
        work: what to do.
        batches: what to do it on.
        engine: where; None for this machine's cores.
        workers: processes; None for one a core; 0 does all in this process, as does a process that may have no others,
            such as those of ``multiprocessing.Pool``.

    Raises:
        DescriptionError: the engine cannot be reached.
        Exception: whatever the work raises; what finished before has been yielded.
    """
    if workers == 0 or current_process().daemon:
        for index, batch in enumerate(batches):
            yield index, work.do(batch)
    elif batches:
        with _stopping((engine or LOCAL).open(workers)) as cluster:
            yield from _run_on(cluster, work, batches)


def start(modules: Sequence[str]) -> None:
    """Begin to start the processes in which ``run`` will do local work, and return at once.

    Args:
        modules: what they import.

    Raises:
        DescriptionError: they cannot be started here.
    """
    check_place()
    thread = Thread(target=start_server, args=(modules,))
    thread.start()
    thread.join()


def in_processes(
    do: Callable[[Batch], Result],
    items: Sequence[Batch],
    workers: int | None = None,
    foreign: Callable[[Batch], frozenset[str]] = lambda _: frozenset(),
) -> list[Result]:
    """Return what ``do`` makes of each item, in order, as ``map`` does, but from several processes of this machine.

    Args:
        do: what to do; it and the items can be sent to another process.
        items: what to do it on.
        workers: processes, as in ``run``.
        foreign: as of ``Work``.

    Raises:
        DescriptionError: a process died of an item.
        MachineError: it was killed from outside, or there is no memory.
        Exception: whatever it raises.
    """

    def lost(item: Batch, death: Death) -> Result:
        said = f"{death.reason}, at its work on {str(item)[:100]}"
        raise MachineError(Death(said)) if death.by_machine else DescriptionError(said)

    work = Work(do, lambda item: [item], lost, lambda pieces: pieces[0], foreign)
    done = dict(run(work, items, workers=workers))
    return [done[index] for index in range(len(items))]


@contextmanager
def _stopping(cluster: Cluster) -> Iterator[Cluster]:
    try:
        yield cluster
    finally:  # also at an interrupt, an error of the work, or when the caller wants no more
        cluster.stop()


@dataclass(slots=True)
class _Turn:
    """A batch, or a piece of one, whose turn comes.

    Attributes:
        index: that of the batch.
        batch: what is done.
        place: which piece it is; None for the whole batch.
        of: of how many pieces.
        tries: how often it may still be tried.
    """

    index: int
    batch: Any
    place: int | None = None
    of: int = 1
    tries: int = TRIES


def _run_on(cluster: Cluster, work: Work[Any, Any], batches: Sequence[Any]) -> Iterator[tuple[int, Any]]:
    todo = deque(_Turn(index, batch) for index, batch in enumerate(batches))
    under_way: dict[int, _Turn] = {}
    pieces: dict[int, dict[int, Any]] = {}  # what those of a batch came to, by batch and place
    numbers = count()
    while todo or under_way:
        turns = {next(numbers): todo.popleft() for _ in range(min(cluster.limit - len(under_way), len(todo)))}
        under_way |= turns
        if turns:
            cluster.send({i: _task(work, turn) for i, turn in turns.items()})
        number, result = cluster.next()
        turn = under_way.pop(number)
        if isinstance(result, Death):
            turn.tries -= result.by_machine
            if result.by_machine and turn.tries:
                todo.append(turn)
                continue
            if not result.by_machine and turn.place is None:
                cut = work.pieces(turn.batch)
                todo.extend(_Turn(turn.index, piece, place, len(cut)) for place, piece in enumerate(cut))
                continue
            result = work.lost(turn.batch, result)
        if turn.place is None:
            yield turn.index, result
            continue
        done = pieces.setdefault(turn.index, {})
        done[turn.place] = result
        if len(done) == turn.of:
            yield turn.index, work.join([done[place] for place in range(turn.of)])


def _task(work: Work[Any, Any], turn: _Turn) -> Task:
    return Task(work.do, turn.batch, turn.place is not None, work.foreign(turn.batch))


class _Threads:
    """This machine's worker processes, each of which a thread looks after."""

    limit = sys.maxsize

    def __init__(self, workers: int) -> None:
        self._threads = ThreadPoolExecutor(workers)
        self._crew = Crew(kept())
        self._done: SimpleQueue[tuple[int, Future[Any]]] = SimpleQueue()

    def send(self, tasks: Mapping[int, Task]) -> None:
        """Begin with some tasks."""
        for number, task in tasks.items():
            future = self._threads.submit(self._crew.do, task)
            future.add_done_callback(lambda done, number=number: self._done.put((number, done)))  # type: ignore[misc]

    def next(self) -> tuple[int, Any]:
        """Wait for any task to end."""
        number, done = self._done.get()
        return number, done.result()

    def stop(self) -> None:
        """End what is under way."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        self._crew.stop()
        self._threads.shutdown()


@described(frozen=True, slots=True, kw_only=True, config=STRICT)
class Local:
    """This machine's cores."""

    shares_files: ClassVar[bool] = True

    def open(self, workers: int | None) -> Cluster:
        """Return what does tasks with so many workers, one a core by default."""
        return _Threads(workers or os.cpu_count() or 1)


LOCAL = Local()
