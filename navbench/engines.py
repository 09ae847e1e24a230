"""Where work runs: one generator hides whether a batch runs here or in another process."""

import os
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

Work = TypeVar("Work")
Result = TypeVar("Result")


def run(
    work: Callable[[Work], Result], batches: Sequence[Work], workers: int | None = None
) -> Iterator[tuple[int, Result]]:
    """Run the work on each batch and yield (index of the batch, result) as they finish, in any order.

    Args:
        work: a function that can be sent to another process.
        batches: what to run it on.
        workers: processes; None for one a core. One worker, or one batch, runs in this process.

    Raises:
        Whatever the work raises; what finished before has been yielded.
    """
    count = min(workers or os.cpu_count() or 1, len(batches))
    if count <= 1:
        for index, batch in enumerate(batches):
            yield index, work(batch)
        return
    from joblib import Parallel, delayed

    tasks = (delayed(_indexed)(work, index, batch) for index, batch in enumerate(batches))
    with Parallel(n_jobs=count, backend="loky", return_as="generator_unordered", batch_size=1) as parallel:
        yield from parallel(tasks)


def _indexed(work: Callable[[Work], Result], index: int, batch: Work) -> tuple[int, Result]:
    return index, work(batch)
