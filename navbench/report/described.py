"""Sections of a report on the tables that controllers describe: surfaces over two inputs, and counts of long ones."""

from collections.abc import Sequence
from pathlib import Path

from navbench.analysis.stored import StoredResults
from navbench.report.figures import new_figure, save_figure
from navbench.report.markup import save_table

LEVELS = 10  # steps of colour


def surface_2d(
    stored: StoredResults,
    out: Path,
    *,
    file: str,
    caption: str,
    table: str,
    x: str,
    y: str,
    value: str,
) -> str:
    """Return a described value over two others, as colours with lines of equal value.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        table: the name of the described table: a row a point of a grid.
        x: its column that is drawn to the right.
        y: its column that is drawn upwards.
        value: its column that is drawn as a colour.
    """
    described = stored.described(table).pivot(index=y, columns=x, values=value)
    across, up, values = described.columns.to_numpy(), described.index.to_numpy(), described.to_numpy()
    figure, axes = new_figure(1, 1, 6.0, 4.2)
    ax = axes[0, 0]
    filled = ax.contourf(across, up, values, levels=LEVELS, cmap="viridis")
    lines = ax.contour(across, up, values, levels=filled.levels, colors="white", linewidths=0.6)
    ax.clabel(lines, fontsize=8)
    ax.set(xlabel=x, ylabel=y)
    figure.colorbar(filled, ax=ax, label=value)
    return save_figure(figure, out, file, caption)


def counts(stored: StoredResults, out: Path, *, file: str, table: str, by: Sequence[str]) -> str:
    """Return how often each combination of some columns of a described table comes up; the CSV holds the whole table.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        table: the name of the described table.
        by: the columns.
    """
    described = stored.described(table)
    counted = described.groupby(list(by), sort=True).size().reset_index(name="count")
    headers = [name.replace("_", " ") for name in counted.columns]
    return save_table(out, file, described, headers, counted.astype(str).to_numpy().tolist())
