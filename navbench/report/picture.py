"""The picture of a results directory: a panel a cell, its rows drawn apart, so that processes may share them."""

import io
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.stored import StoredResults
from navbench.experiments.files import replacing
from navbench.experiments.store import Results
from navbench.report.figures import COLUMNS, DPI, PATH, TITLE_INCHES, Panel, draw_cells
from navbench.report.runs import Joined
from navbench.world.layout import DrawnWorld

if TYPE_CHECKING:
    import pandas as pd

Each = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]


def save_trajectories(results: Results, runs: Sequence[str], file: Path, each: Each = map, title: str = "") -> None:
    """Draw all episodes of some runs of a results directory, a panel a run, and save the picture.

    Args:
        results: the directory.
        runs: the run_ids.
        file: where to save, as a PNG.
        each: draws the rows, which do not depend on each other: ``map``, or what does the same in several processes.
        title: what stands above all panels.
    """
    from matplotlib.image import imsave

    stored, episodes = StoredResults(Joined([results])), results.episodes()
    told = [
        (cell, stored.world_in_common(cell["run_id"]), episodes[episodes["run_id"] == cell["run_id"]])
        for cell in _told_apart([stored.configuration(run) for run in runs])
    ]
    rows = [_Row(results, told[i : i + COLUMNS], i, len(runs), title) for i in range(0, len(runs), COLUMNS)]
    pixels = np.vstack(list(each(_draw, rows)))
    content, metadata = io.BytesIO(), dict[str, Any](Software=None)
    imsave(content, pixels, format="png", dpi=DPI, metadata=metadata)
    with replacing(file) as temporary:
        temporary.write_bytes(content.getvalue())


def _told_apart(cells: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return cells, whose labels name the seed where only it differs."""
    seeds: defaultdict[tuple[str, str], set[int]] = defaultdict(set)
    for cell in cells:
        seeds[cell["label"], cell["name"]].add(cell["seed"])
    several = {called for called, of in seeds.items() if len(of) > 1}
    return [
        {**cell, "label": f"{cell['label']}, seed {cell['seed']}"} if (cell["label"], cell["name"]) in several else cell
        for cell in cells
    ]


class _Row(NamedTuple):
    """A row of panels: what each shows but its paths, and which of all panels the first one is; the picture's title."""

    results: Results
    told: "Sequence[tuple[dict[str, Any], DrawnWorld | None, pd.DataFrame]]"
    first: int
    of: int
    title: str


def _draw(row: _Row) -> NDArray[np.uint8]:
    """Return the pixels of a row: drawn at its place in the whole figure, for elsewhere they would round otherwise."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    panels: list[Panel | None] = [None] * row.of
    for place, (cell, world, episodes) in enumerate(row.told, row.first):
        panels[place] = cell, world, episodes, row.results.trajectories(cell["run_id"], PATH)
    figure = draw_cells(panels, row.title)
    figure.set_dpi(DPI)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())
    above = round(DPI * TITLE_INCHES) * bool(row.title)  # the first row has it
    place, height = row.first // COLUMNS, (len(pixels) - above) // -(-row.of // COLUMNS)
    return pixels[place * height + above * (place > 0) : (place + 1) * height + above].copy()
