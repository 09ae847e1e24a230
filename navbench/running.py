"""Run cells and keep what they did."""

from collections.abc import Sequence
from pathlib import Path

from navbench.cells import Cell, run_batch
from navbench.engines import run
from navbench.store import Results


def run_cells(cells: Sequence[Cell], path: Path, workers: int | None = None) -> Results:
    """Run every episode of the cells, write each batch as it finishes, and return the results.

    Args:
        cells: what to run.
        path: the results directory; it may hold earlier results of the same work, which are replaced.
        workers: processes; None for one a core. A run with a window stays in this process.

    Raises:
        DescriptionError: a cell cannot be run, or the directory holds results of other work.
    """
    keys = [cell.key() for cell in cells]
    batches = [(key, batch) for key, cell in zip(keys, cells, strict=True) for batch in cell.batches()]
    results = Results(path)
    results.begin(keys)
    if any(cell.options.gui for cell in cells):
        workers = 1
    for index, records in run(run_batch, [batch for _, batch in batches], workers):
        key, batch = batches[index]
        results.write_batch(key, batch.episodes[0], records)
    results.end()
    return results
