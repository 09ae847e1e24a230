"""The section of a report that compares controllers over the same starts."""

from collections.abc import Mapping, Sequence
from typing import Any

from navbench.analysis.comparisons import Comparison, compare, compared_metrics
from navbench.report.document import Block, Blocks, Column, Heading, Paragraph, Plot, Table
from navbench.report.figures import new_figure
from navbench.report.page import Page, Select
from navbench.validation import DescriptionError

NOTE = (
    "A difference is the row's minus that of the reference, which has none, start by start: the same world, seed, "
    "episode and robot. The mean time counts a failure as the world's time limit, whenever it came. The win ratio is "
    "pairs won over pairs lost; a failure is the worst, and two failures are a tie. Medians are of those that "
    "reached, and metrics are compared where both did. Intervals hold 95 %: Clopper and Pearson's of shares "
    "and of the win ratio, Newcombe's of their differences, and of the mean time one that reckons with failures that "
    "were not seen; its difference has an interval from 8 pairs on."
)
COLUMNS = (
    Column("", "label"),
    Column("reached", show="count"),
    Column("share", "reached", decimals=3),
    Column("difference", "reached_difference", decimals=3),
    Column("mean time", "time_s", "s", 2),
    Column("difference", "time_difference_s", "s", 2),
    Column("won/lost/tied"),
    Column(None, "wins"),
    Column(None, "losses"),
    Column(None, "ties"),
    Column("win ratio", "win_ratio", decimals=2),
)


def comparison(
    page: Page,
    *,
    select: Select | None = None,
    worlds: Mapping[str, str | Select] | None = None,
    reference: str = "",
) -> Blocks:
    """Return how controllers do over the same starts: who arrives, when, and against a reference start by start.

    Args:
        select: which cells; None for all.
        worlds: each world's title and name, or the cells in it; None for every world of those cells.
        reference: the label that the others are compared with; empty for the first.
    """
    found = compared(page, select or {}, worlds, reference)
    blocks: list[Block] = [Paragraph(NOTE)]
    for i, (title, here) in enumerate(found.items(), 1):
        world = (worlds or {}).get(title, title)
        blocks += [Heading(title, 3), _table(page, here, world if isinstance(world, str) else str(i))]
    return [*blocks, _forest(page, found)]


def compared(
    page: Page, select: Select, worlds: Mapping[str, str | Select] | None, reference: str
) -> dict[str, list[Comparison]]:
    """Return for each world's title every controller beside the reference, in the study's order.

    Raises:
        DescriptionError: the reference is not among the controllers of a world.
    """
    if worlds is None:
        worlds = {name: name for name in dict.fromkeys(page.stored.select(**select)["world"])}
    found = {}
    for title, world in worlds.items():
        cells = {**select, **({"world": world} if isinstance(world, str) else world)}
        here = set(page.stored.select(**cells)["label"])
        labels = [label for label in page.stored.labels if label in here]
        if reference and reference not in here:
            raise DescriptionError(f"reference={reference}: has no episodes in {title}; allowed: {', '.join(labels)}")
        beside = [compare(page.stored, cells, label, reference or labels[0]) for label in labels]
        found[title] = [one for one in beside if one is not None]
    return found


def _table(page: Page, found: Sequence[Comparison], world: str) -> Table:
    """Return one world's comparison as a table."""
    rows, columns, metrics = [], list(COLUMNS), compared_metrics(page.stored)
    for metric in metrics:
        columns.append(Column(f"median {metric.title}", metric.name, metric.unit, 3, "value"))
        columns.append(Column("better in", f"{metric.name}_better", decimals=2, show="of"))
    for c in found:
        counts = c.wins[:3] if c.wins else (None,) * 3
        won = "/".join(map(str, counts)) if c.wins else None
        ratio = c.wins.ratio if c.wins else None
        measured = [value for m in metrics for value in (c.medians[m.name], c.better.get(m.name))]
        rows.append([c.label, c.reached, *c[1:5], won, *counts, ratio, *measured])
    return page.table(columns, rows, more=f"_{world}")


def _forest(page: Page, found: Mapping[str, Sequence[Comparison]]) -> Plot:
    """Return the figure of shares and times with their intervals, a column a world."""
    every = [c for here in found.values() for c in here]
    labels = list(dict.fromkeys(c.label for c in every))
    figure, axes = new_figure(2, len(found), 3.0, 0.25 * len(labels) + 0.9, sharey=True, sharex="row")
    for column, (world, here) in zip(axes.T, found.items(), strict=True):
        for c in here:
            style: Any = page.styles[c.label]
            for ax, interval in zip(column, (c.reached, c.time_s), strict=True):
                place = len(labels) - labels.index(c.label)
                ax.plot([interval.low, interval.high], [place, place], color=style.color, linewidth=1.6)
                ax.plot(interval.value, place, style.marker, color=style.color, markersize=5)
        column[0].set_title(world)
    for ax in axes.ravel():
        ax.set_yticks(range(len(labels), 0, -1), labels, fontsize=8)
        ax.grid(axis="x", alpha=0.3)
    for row, title in zip(axes, ("share that reached", "mean time, failures at the limit [s]"), strict=True):
        for ax in row:
            ax.set_xlabel(title, fontsize=9)
    counts = " to ".join(map(str, sorted({f(c.reached.n for c in every) for f in (min, max)})))
    return page.plot(figure, f"The comparison over {counts} starts per world: value and 95 % interval.")
