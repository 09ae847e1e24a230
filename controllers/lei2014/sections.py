"""The section of lei2014's report that draws a described value over two others."""

from navbench.report.document import Blocks
from navbench.report.figures import new_figure
from navbench.report.page import Page

LEVELS = 10  # steps of colour


def surface_2d(page: Page, *, table: str, x: str, y: str, value: str) -> Blocks:
    """Return a described value over two others, as colours with lines of equal value.

    Args:
        table: the name of the described table: a row a point of a grid.
        x: its column that is drawn to the right.
        y: its column that is drawn upwards.
        value: its column that is drawn as a colour.
    """
    described = page.stored.described(table).pivot(index=y, columns=x, values=value)
    across, up, values = described.columns.to_numpy(), described.index.to_numpy(), described.to_numpy()
    figure, axes = new_figure(1, 1, 6.0, 4.2)
    ax = axes[0, 0]
    filled = ax.contourf(across, up, values, levels=LEVELS, cmap="viridis")
    lines = ax.contour(across, up, values, levels=filled.levels, colors="white", linewidths=0.6)
    ax.clabel(lines, fontsize=8)
    ax.set(xlabel=x, ylabel=y)
    figure.colorbar(filled, ax=ax, label=value)
    return [page.plot(figure)]
