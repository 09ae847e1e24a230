"""Sections of a report in which every controller meets every world: who arrives, how soon, by which path."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from navbench.analysis.fleets import fleets
from navbench.analysis.stored import StoredResults, reached
from navbench.experiments.store import write_table
from navbench.mathematics.statistics import Estimate, share
from navbench.report.figures import PALETTE, new_figure, save_figure
from navbench.report.markup import MISSING, between, number, save_table
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Select = Mapping[str, Any]
Groups = Mapping[str, Sequence[str]]
HOME = PALETTE[0]
GAP = 0.35  # between two groups of worlds in the picture, in columns
DARK = 0.55  # shares above this are drawn so dark that their number is white


class Crossing(NamedTuple):
    """One controller in one world.

    Attributes:
        group: whose world it is.
        world: the world.
        label: what the controller is called.
        success: the share of episodes in which all robots reached, with Wilson's interval.
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


def crossed_tables(stored: StoredResults, out: Path, *, file: str, select: Select, groups: Groups) -> str:
    """Return who arrives in which world, with the median time and length of those, a row a world.

    An episode succeeds when all its robots reach, so that its success is one case, however many robots drive. Time and
    length are medians over the robots that reached, in the world's own units; how many did stands beside them.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        select: which cells.
        groups: whose worlds they are, and the worlds.
    """
    import pandas as pd

    found = _crossings(stored, select, groups)
    labels = _labels(stored, found)
    told = {
        "success": ("Episodes in which all robots reached [95 % interval]", _success),
        "time": ("Median time of the robots that reached [s]", lambda c: _median(c, c.time_s, 1)),
        "length": ("Median length of their ways [m]", lambda c: _median(c, c.length_m, 2)),
    }
    columns = {
        "success": lambda c: [*c.success],
        "time": lambda c: [c.time_s, c.arrived, c.robots],
        "length": lambda c: [c.length_m, c.arrived, c.robots],
    }
    names = {"success": ["success", "low", "high", "episodes"], "time": ["time_s", "reached", "robots"]}
    names["length"] = ["path_length_m", "reached", "robots"]
    whole = [[c.group, c.world, c.label, *c.success, c.arrived, c.robots, c.time_s, c.length_m] for c in found]
    every = ["drawn_for", "world", "label", *names["success"], "reached", "robots", "time_s", "path_length_m"]
    together = pd.DataFrame(whole, columns=every)
    write_table(out / "tables" / f"{file}.csv", together.to_csv(index=False))
    parts = [f"All in one table, a row for each controller in each world: [CSV](tables/{file}.csv)\n"]
    for kind, (title, words) in told.items():
        raw = [[c.group, c.world, c.label, *columns[kind](c)] for c in found]
        rows = [
            [group, world, *(words(next(c for c in found if (c.world, c.label) == (world, label))) for label in labels)]
            for group, worlds in groups.items()
            for world in worlds
        ]
        table = pd.DataFrame(raw, columns=["drawn_for", "world", "label", *names[kind]])
        parts.append(f"### {title}\n\n{save_table(out, f'{file}_{kind}', table, ['of', 'world', *labels], rows)}")
    return "\n".join(parts)


def success_map(
    stored: StoredResults,
    out: Path,
    *,
    file: str,
    caption: str,
    panels: Mapping[str, Select],
    groups: Groups,
    home: Mapping[str, str],
) -> str:
    """Return the share of episodes in which all robots reached, as a picture: a row a controller, a column a world.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        panels: what each panel is called, and its cells; the panels stand below each other.
        groups: whose worlds they are, and the worlds.
        home: for a controller's label the group whose worlds are its own paper's; they are framed.
    """
    import pandas as pd

    unknown = set(home.values()) - set(groups)
    if unknown:
        raise DescriptionError(f"home={sorted(unknown)[0]}: there is no such group; allowed: {', '.join(groups)}")
    found = {title: _crossings(stored, select, groups) for title, select in panels.items()}
    rows = {title: _labels(stored, crossings) for title, crossings in found.items()}
    heights = [len(labels) for labels in rows.values()]
    height = 0.34 * sum(heights) / len(heights) + 0.9
    figure, axes = new_figure(len(panels), 1, 11.5, height, height_ratios=heights)
    for i, (ax, title) in enumerate(zip(axes.ravel(), panels, strict=True)):
        _draw(ax, found[title], rows[title], groups, home, i == len(panels) - 1)
        ax.set_title(title, loc="left", pad=22, fontsize=11)
    raw = [[title, c.group, c.world, c.label, *c.success] for title, crossings in found.items() for c in crossings]
    names = ["panel", "drawn_for", "world", "label", "success", "low", "high", "episodes"]
    write_table(out / "tables" / f"{file}.csv", pd.DataFrame(raw, columns=names).to_csv(index=False))
    return f"{save_figure(figure, out, file, caption)}\n[CSV](tables/{file}.csv)\n"


def _crossings(stored: StoredResults, select: Select, groups: Groups) -> list[Crossing]:
    """Return every controller in every world, the worlds in the order of their groups."""
    found = []
    for group, worlds in groups.items():
        for world in worlds:
            rows = stored.select(**select, world=world)
            for label in (label for label in stored.labels if label in set(rows["label"])):
                mine = rows[rows["label"] == label]
                good = reached(mine)
                success = share(fleets(mine)["success"].to_numpy(dtype=bool))
                medians = float(good["time_s"].median()), float(good["path_length_m"].median())
                found.append(Crossing(group, world, label, success, len(good), len(mine), *medians))
    return found


def _labels(stored: StoredResults, found: Sequence[Crossing]) -> list[str]:
    """Return the controllers that met every world, in the study's order.

    Raises:
        DescriptionError: one of them met some worlds only.
    """
    worlds = {c.world for c in found}
    labels = [label for label in stored.labels if label in {c.label for c in found}]
    for label in labels:
        missing = worlds - {c.world for c in found if c.label == label}
        if missing:
            raise DescriptionError(f"select: {label} has no episodes in {', '.join(sorted(missing))}")
    return labels


def _success(c: Crossing) -> str:
    held = f"{round(c.success.value * c.success.n)} of {c.success.n}"
    return f"{held} {between(c.success.low, c.success.high, 2)}"


def _median(c: Crossing, value: float, decimals: int) -> str:
    return f"{number(value, decimals)} ({c.arrived} of {c.robots})" if c.arrived else MISSING


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
