"""Where work runs: one generator hides whether a batch runs here or in another process, and what happens to it there.

A batch whose process dies is run again. After two deaths its pieces run singly, each in a process of its own, so that
only the piece that kills is lost, and the rest of the work goes on.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

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
) -> Iterator[tuple[int, Result]]:
    """Run the work on each batch and yield (index of the batch, result) as they finish, in any order.

    Args:
        work: what to do.
        batches: what to do it on.
        engine: where: "local", this machine's cores.
        workers: processes; None for one a core. One worker, or one batch, runs in this process.

    Raises:
        ValueError: there is no such engine.
        Exception: whatever the work raises; what finished before has been yielded.
    """
    if engine not in ENGINES:
        raise ValueError(f"engine={engine}: there is no such engine; allowed: {', '.join(ENGINES)}")
    count = min(workers or os.cpu_count() or 1, len(batches))
    if count <= 1:
        for index, batch in enumerate(batches):
            yield index, work.do(batch)
    else:
        yield from ENGINES[engine](work, batches, count)


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
    """Run batches until all are done or a process dies; count a death for each batch that was under way then."""
    from concurrent.futures import FIRST_COMPLETED, wait

    executor = _executor(workers)
    under_way: dict[Any, int] = {}
    try:
        while todo or under_way:
            while todo and len(under_way) < workers:
                index = todo.pop(0)
                under_way[executor.submit(work.do, batches[index])] = index
            done, _ = wait(under_way, return_when=FIRST_COMPLETED)
            for future in done:
                result = future.result()
                yield under_way.pop(future), result
    except _broken() as death:
        for future, index in under_way.items():
            if not (future.done() and future.exception() is None):
                deaths[index] += 1
        del death
        return
    finally:
        executor.shutdown(wait=True, kill_workers=True)


def _alone(work: Work[Batch, Result], piece: Batch) -> Result:
    """Do one piece in a process of its own."""
    executor = _executor(1)
    try:
        result: Result = executor.submit(work.do, piece).result()
        return result
    except _broken():
        return work.lost(piece)
    finally:
        executor.shutdown(wait=True, kill_workers=True)


def _executor(workers: int) -> Any:
    from joblib.externals.loky import ProcessPoolExecutor

    return ProcessPoolExecutor(max_workers=workers)


def _broken() -> type[BaseException]:
    from joblib.externals.loky.process_executor import BrokenProcessPool

    broken: type[BaseException] = BrokenProcessPool
    return broken


ENGINES: dict[str, Callable[[Any, Any, int], Iterator[tuple[int, Any]]]] = {"local": _run_locally}
