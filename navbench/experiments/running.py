"""Run cells and keep what they did."""

from collections.abc import Callable, Sequence
from pathlib import Path

from navbench.experiments.cells import EPISODES, Cell
from navbench.experiments.engines import run
from navbench.experiments.store import Results, batch_name, discard_empty, existing
from navbench.records import StudyCell

Progress = Callable[[int, int], None]  # how many batches are done, of how many


def run_cells(cells: Sequence[Cell], path: Path, workers: int | None = None) -> Results:
    """Run every episode of the cells, write each batch as it finishes, and return the results.

    Args:
        cells: what to run.
        path: the results directory; it may hold earlier results of the same work, which are replaced.
        workers: processes; None for one a core. A run with a window stays in this process.

    Raises:
        DescriptionError: a cell cannot be run, or the directory holds results of other work.
    """
    results, there = Results(path), existing(path)
    results.begin([StudyCell(cell.key(), "run", cell.names.controller) for cell in cells])
    try:
        run_batches(cells, results, workers, resume=False)
        results.end()
    except BaseException:
        results.abandon()
        discard_empty(path, there)
        raise
    return results


def run_batches(
    cells: Sequence[Cell],
    results: Results,
    workers: int | None,
    *,
    resume: bool,
    engine: str = "local",
    progress: Progress | None = None,
) -> None:
    """Run the batches of some cells and write each as it finishes.

    Args:
        cells: what to run; equal cells run once.
        results: where to keep it.
        workers: processes; None for one a core. A run with a window stays in this process.
        resume: whether to leave out the batches whose parts are there.
        engine: where to run, see ``engines.run``.
        progress: told after each batch.
    """
    keys = {id(cell): cell.key() for cell in cells}
    once = {keys[id(cell)].run_id: cell for cell in cells}
    todo = [batch for cell in once.values() for batch in cell.batches()]
    if resume:
        todo = [b for b in todo if not results.has("episodes", batch_name(keys[id(b.cell)], b.episodes))]
    if any(cell.options.gui for cell in cells):
        workers = 1
    for done, (index, records) in enumerate(run(EPISODES, todo, engine, workers), 1):
        batch = todo[index]
        results.write_batch(keys[id(batch.cell)], batch.episodes, records, batch.cell.keep_trajectories)
        if progress is not None:
            progress(done, len(todo))
