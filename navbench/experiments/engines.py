"""Where work runs: one generator hides whether a batch runs here or in another process, and what happens to it there.

A batch whose process dies is run again. After two deaths its pieces run singly, each in a process of its own, so that
only the piece that kills is lost, and the rest of the work goes on.
"""

import atexit
import gc
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any, Generic, NamedTuple, TypeVar

from navbench.validation import DescriptionError

Batch = TypeVar("Batch")
Result = TypeVar("Result")

DEATHS_MAX = 2  # one may be the machine's doing (memory, a signal); two are the batch's


class Work(NamedTuple, Generic[Batch, Result]):
    """A kind of work.

    Attributes:
        do: does one batch; it and its batches can be sent to another process.
        pieces: cuts a batch that keeps dying into smaller ones, in order.
        lost: the result of a piece whose process died.
        join: puts the results of a batch's pieces together.
    """

    do: Callable[[Batch], Result]
    pieces: Callable[[Batch], Sequence[Batch]]
    lost: Callable[[Batch], Result]
    join: Callable[[Sequence[Result]], Result]


def run(
    work: Work[Batch, Result], batches: Sequence[Batch], engine: str = "local", workers: int | None = None
) -> Generator[tuple[int, Result], None, None]:
    """Run the work on each batch and yield (index of the batch, result) as they finish, in any order.

    Args:
        work: what to do.
        batches: what to do it on.
        engine: where: "local", this machine's cores.
        workers: processes; None for one a core, and no more than there are batches. One runs in this process; a batch
            that kills its process is survived with two or more asked for, even if it is the only one.

    Raises:
        ValueError: there is no such engine.
        Exception: whatever the work raises; what finished before has been yielded.
    """
    if engine not in ENGINES:
        raise ValueError(f"engine={engine}: there is no such engine; allowed: {', '.join(ENGINES)}")
    count = workers or min(os.cpu_count() or 1, len(batches))
    if count <= 1:
        for index, batch in enumerate(batches):
            yield index, work.do(batch)
    else:
        yield from ENGINES[engine](work, batches, min(count, max(len(batches), 1)))


def start(modules: Sequence[str], workers: int | None = None) -> None:
    """Start the processes in which ``run`` will do local work, and return at once.

    Args:
        modules: what they import.
        workers: as in ``run``.
    """
    count = workers or os.cpu_count() or 1
    if count > 1:
        executor = _executor(count)
        with _starting_processes():
            for _ in range(count):
                executor.submit(_import, modules)


def _import(modules: Sequence[str]) -> None:
    for module in modules:
        import_module(module)


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

    def lost(item: Batch) -> Result:
        raise DescriptionError(f"a process died of its work on {str(item)[:100]}")

    work = Work(do, lambda item: [item], lost, lambda pieces: pieces[0])
    done = dict(run(work, items, engine, workers))
    return [done[index] for index in range(len(items))]


def _run_locally(work: Work[Batch, Result], batches: Sequence[Batch], workers: int) -> Iterator[tuple[int, Result]]:
    """Run batches in worker processes of this machine."""
    deaths = dict.fromkeys(range(len(batches)), 0)
    while deaths:
        dying = [index for index, count in deaths.items() if count >= DEATHS_MAX]
        for index in dying:
            yield index, work.join([_alone(work, piece) for piece in work.pieces(batches[index])])
            del deaths[index]
        for index, result in _until_a_death(work, batches, list(deaths), workers, deaths):
            del deaths[index]
            yield index, result


def _until_a_death(
    work: Work[Batch, Result], batches: Sequence[Batch], todo: list[int], workers: int, deaths: dict[int, int]
) -> Iterator[tuple[int, Result]]:
    """Run batches until all are done or a process dies; count a death for each batch that was under way then.

    Each process has the next batch waiting, so that none idles while the caller makes use of a result.
    """
    from concurrent.futures import FIRST_COMPLETED, wait

    executor = _executor(workers)
    under_way: dict[Any, int] = {}
    try:
        while todo or under_way:
            while todo and len(under_way) < 2 * workers:
                index = todo.pop(0)
                with _starting_processes():
                    under_way[executor.submit(work.do, batches[index])] = index
            done, _ = wait(under_way, return_when=FIRST_COMPLETED)
            for future in done:
                result = future.result()
                yield under_way.pop(future), result
    except _broken() as death:
        unfinished = [i for future, i in under_way.items() if not (future.done() and future.exception() is None)]
        for index in unfinished[:workers]:  # the others waited
            deaths[index] += 1
        del death
    except BaseException:  # an interrupt, an error of the work, or a caller that wants no more
        executor.shutdown(wait=True, kill_workers=True)
        raise


def _executor(workers: int) -> Any:
    """Return what runs work in processes; they are kept for the next call."""
    from joblib.externals.loky import get_reusable_executor

    # a process that holds much memory is replaced by a new one, and nothing is lost
    warnings.filterwarnings("ignore", "A worker stopped while some jobs were given")
    with _starting_processes():
        told = os.getpid(), os.getcwd(), *sys.path
        return get_reusable_executor(max_workers=workers, initializer=_begin, initargs=told)


def _alone(work: Work[Batch, Result], piece: Batch) -> Result:
    """Do one piece in a process of its own."""
    from joblib.externals.loky import ProcessPoolExecutor

    executor = ProcessPoolExecutor(max_workers=1, initializer=_begin, initargs=(os.getpid(), os.getcwd()))
    try:
        with _starting_processes():
            future = executor.submit(work.do, piece)
        result: Result = future.result()
        return result
    except _broken():
        return work.lost(piece)
    finally:
        executor.shutdown(wait=True, kill_workers=True)


def _begin(driver: int, folder: str, *_: str) -> None:
    """Have this worker end soon after its driver was killed: nobody would read what it says, and it would wait.

    A worker works in the folder and imports from where its driver did when it was started; where these have changed,
    others are started.
    """
    from psutil import Process

    os.chdir(folder)

    def watch() -> None:
        while (parent := Process().parent()) is not None and parent.pid == driver:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    atexit.register(gc.freeze)  # else the interpreter looks through all objects once more before it ends


@contextmanager
def _starting_processes() -> Iterator[None]:
    """Hold Ctrl-C back for a moment: loky's threads would be left half made, and the processes would answer it too."""
    if threading.current_thread() is not threading.main_thread() or sys.platform == "win32":
        yield  # Python lets no other thread set handlers, and Windows has no mask of signals
        return
    import multiprocessing.resource_tracker

    from joblib.externals.loky.backend import resource_tracker

    resource_tracker.ensure_running()  # started inside, either would let Ctrl-C through
    multiprocessing.resource_tracker.ensure_running()
    held: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: held.append(number))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # which a process inherits, for good
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, handler)
        if held:
            signal.raise_signal(signal.SIGINT)


def _broken() -> type[BaseException]:
    from joblib.externals.loky.process_executor import BrokenProcessPool

    broken: type[BaseException] = BrokenProcessPool
    return broken


ENGINES: dict[str, Callable[[Any, Any, int], Iterator[tuple[int, Any]]]] = {"local": _run_locally}
