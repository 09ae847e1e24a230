"""Sections of a report in which every controller meets every world: who arrives, how soon, by which path."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from navbench.analysis.fleets import fleets
from navbench.analysis.stored import reached
from navbench.mathematics.statistics import Estimate, share
from navbench.report.document import Block, Blocks, Column, Data, Heading, Table, number, words
from navbench.report.figures import PALETTE, new_figure
from navbench.report.page import Page, Select
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Groups = Mapping[str, Sequence[str]]
HOME = PALETTE[0]
GAP = 0.35  # between two groups of worlds in the picture, in columns
EVERY = (
    "drawn_for",
    "world",
    "label",
    "success",
    "low",
    "high",
    "episodes",
    "reached",
    "robots",
    "time_s",
    "path_length_m",
)
TABLES = {
    "success": "Episodes in which all robots reached [95 % interval]",
    "time": "Median time of the robots that reached [s]",
    "length": "Median length of their paths [m]",
}
SHARES = (
    Column("panel", "panel"),
    Column("of", "drawn_for"),
    Column("world", "world"),
    Column("controller", "label"),
    Column("success", "success", decimals=3),
)
DARK = 0.55  # shares above this are drawn so dark that their number is white


class Crossing(NamedTuple):
    """One controller in one world.

    Attributes:
        group: whose world it is.
        world: the world.
        label: what the controller is called.
        success: the share of episodes in which all robots reached, with its interval.
        arrived: how many robots reached.
        robots: of how many.
        time_s: the median time of those [s]; nan where none reached.
        length_m: the median length of their paths [m]; nan where none reached.
    """

    group: str
    world: str
    label: str
    success: Estimate
    arrived: int
    robots: int
    time_s: float
    length_m: float


def crossed_tables(page: Page, *, select: Select, groups: Groups) -> Blocks:
    """Return who arrives in which world, with the median time and length of those, a row per world.

    An episode succeeds when all its robots reach, so that its success is one case, however many robots drive. Time and
    length are medians over the robots that reached, in the world's own units; how many did stands beside them.

    Args:
        select: which cells.
        groups: whose worlds they are, and the worlds.
    """
    found = _crossings(page, select, groups)
    labels = _labels(page, found)
    by = {(c.world, c.label): c for c in found}
    together = Data(EVERY, [[*c[:3], *c.success, *c[4:]] for c in found])
    blocks: list[Block] = []
    for kind, title in TABLES.items():
        rows = [
            [group, world, *(_told(kind, by[world, label]) for label in labels)]
            for group, worlds in groups.items()
            for world in worlds
        ]
        columns = [Column("of"), Column("world"), *map(Column, labels)]
        table = Table(f"{page.file}_{kind}", columns, rows, together, csv=f"tables/{page.file}.csv")
        blocks += [Heading(title, 3), table]
    return blocks


def _told(kind: str, c: Crossing) -> str | None:
    if kind == "success":
        return words(c.success, "held", 2)
    value, decimals = (c.time_s, 1) if kind == "time" else (c.length_m, 2)
    return f"{number(value, decimals)} ({c.arrived} of {c.robots})" if c.arrived else None


def success_map(page: Page, *, panels: Mapping[str, Select], groups: Groups, home: Mapping[str, str]) -> Blocks:
    """Return the share of episodes in which all robots reached, as a picture: a row per controller, a column per world.

    Args:
        panels: what each panel is called, and its cells; the panels stand below each other.
        groups: whose worlds they are, and the worlds.
        home: for a controller's label the group whose worlds are its own paper's; they are framed.
    """
    unknown = set(home.values()) - set(groups)
    if unknown:
        raise DescriptionError(f"home={sorted(unknown)[0]}: there is no such group; allowed: {', '.join(groups)}")
    found = {title: _crossings(page, select, groups) for title, select in panels.items()}
    rows = {title: _labels(page, crossings) for title, crossings in found.items()}
    heights = [len(labels) for labels in rows.values()]
    height = 0.34 * sum(heights) / len(heights) + 0.9
    figure, axes = new_figure(len(panels), 1, 11.5, height, height_ratios=heights)
    for i, (ax, title) in enumerate(zip(axes.ravel(), panels, strict=True)):
        _draw(ax, found[title], rows[title], groups, home, i == len(panels) - 1)
        ax.set_title(title, loc="left", pad=22, fontsize=11)
    rows_of_all = [[title, *c[:4]] for title, crossings in found.items() for c in crossings]
    return [page.plot(figure), Table(page.file, SHARES, rows_of_all, title="The shares")]


def _crossings(page: Page, select: Select, groups: Groups) -> list[Crossing]:
    """Return every controller in every world, the worlds in the order of their groups."""
    found = []
    for group, worlds in groups.items():
        for world in worlds:
            rows = page.stored.select(**select, world=world)
            for label in (label for label in page.stored.labels if label in set(rows["label"])):
                mine = rows[rows["label"] == label]
                good = reached(mine)
                success = share(fleets(mine)["success"].to_numpy(dtype=bool))
                medians = float(good["time_s"].median()), float(good["path_length_m"].median())
                found.append(Crossing(group, world, label, success, len(good), len(mine), *medians))
    return found


def _labels(page: Page, found: Sequence[Crossing]) -> list[str]:
    """Return the controllers that met every world, in the study's order.

    Raises:
        DescriptionError: one of them met some worlds only.
    """
    worlds = {c.world for c in found}
    labels = [label for label in page.stored.labels if label in {c.label for c in found}]
    for label in labels:
        missing = worlds - {c.world for c in found if c.label == label}
        if missing:
            raise DescriptionError(f"select: {label} has no episodes in {', '.join(sorted(missing))}")
    return labels


def _draw(
    ax: "Axes", found: Sequence[Crossing], labels: Sequence[str], groups: Groups, home: Mapping[str, str], named: bool
) -> None:
    """Draw one panel: a square a controller and world, dark where all arrive, with the share in percent in it."""
    from matplotlib import colormaps
    from matplotlib.patches import Rectangle

    colour = colormaps["Blues"]
    places, ticks, column = {}, [], 0.0
    for group, worlds in groups.items():
        middle = (column + 0.5 * len(worlds), 0.0)
        ax.annotate(group, middle, (0, 5), textcoords="offset points", ha="center", va="bottom", fontsize=9)
        for world in worlds:
            places[world] = column
            ticks.append(column + 0.5)
            column += 1.0
        for row, label in enumerate(labels):
            if home.get(label) == group:
                frame = Rectangle((column - len(worlds), row), len(worlds), 1.0, fill=False, zorder=3, clip_on=False)
                frame.set(edgecolor=HOME, linewidth=2.0)
                ax.add_patch(frame)
        column += GAP
    for c in found:
        at, row, value = places[c.world], labels.index(c.label), c.success.value
        ax.add_patch(Rectangle((at, row), 1.0, 1.0, facecolor=colour(0.9 * value), edgecolor="white"))
        ink = "white" if value > DARK else "black"
        ax.text(at + 0.5, row + 0.5, f"{100.0 * value:.0f}", ha="center", va="center", color=ink, fontsize=8)
    ax.set(xlim=(0.0, column - GAP), ylim=(len(labels), 0.0))
    ax.set_yticks(np.arange(len(labels)) + 0.5, labels, fontsize=9)
    ax.set_xticks(ticks, list(places) if named else [""] * len(places), fontsize=8, rotation=45, ha="right")
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
