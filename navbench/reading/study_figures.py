"""Sections of a report that are figures: overlaid ways and speeds, phases, memberships and surfaces."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from navbench.descriptions.description import describe
from navbench.descriptions.robot import Robot
from navbench.reading.figures import (
    PALETTE,
    FloatArray,
    Style,
    draw_circle,
    draw_world,
    new_figure,
    robot_color,
    save_figure,
    styles,
    thinned,
)
from navbench.reading.markup import number, save_table
from navbench.reading.phases import phases as phases_of
from navbench.reading.stored import Reading
from navbench.reading.study_tables import description

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

Select = Mapping[str, Any]
MARGIN_RADII = 3.0  # of a picture around the ways that it shows
THINNED_RADII = 0.015  # what a drawn way may stray from the driven one
NEAR_M = 0.12  # phases that came about nearer to each other than this share their number's place


def trajectories(
    reading: Reading,
    out: Path,
    *,
    file: str,
    caption: str,
    select: Select,
    panels: Mapping[str, str],
    labels: Sequence[str],
    columns: int = 2,
) -> str:
    """Return the ways of several controllers over each other, a panel a world, cut to where the robots went.

    Args:
        reading: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        select: which cells.
        panels: each panel's title and world.
        labels: whose ways, the first below the others, which are dashed.
        columns: how many panels stand side by side.
    """
    columns = min(columns, len(panels))
    figure, axes = new_figure(-(-len(panels) // columns), columns, 4.4, 4.2)
    style = styles(reading.labels)
    for ax, (title, world) in zip(axes.ravel(), panels.items(), strict=False):
        records = reading.select(**select, world=world, label=list(labels)).to_dict("records")
        draw_world(ax, reading.world(records[0]["run_id"], records[0]["episode"]))
        ways = [(row, reading.way(row)) for row in records]
        robot = describe(Robot, reading.configuration(records[0]["run_id"])["configuration"]["robot"], "robot")
        for row, way in ways:
            one = style[row["label"]]
            if len(labels) == 1:  # a fleet: a colour a robot
                one = one._replace(color=robot_color(row["robot_index"]))
            _draw_way(ax, way, one, labels.index(row["label"]), row["tuning_seed"] > 0, robot.radius_m)
            draw_circle(ax, way["x_m"].iloc[0], way["y_m"].iloc[0], robot.radius_m)
            if row["outcome"] != "reached":
                size = 9.0 - 2.5 * min(labels.index(row["label"]), 2)  # of several at one place each is seen
                end = way.iloc[-1]
                ax.plot(end["x_m"], end["y_m"], "X", color=style[row["label"]].color, markersize=size, zorder=20)
        cut(ax, [way for _, way in ways], robot.radius_m)
        ax.set_title(title)
    for ax in axes.ravel()[len(panels) :]:
        ax.set_axis_off()
    if len(labels) > 1:
        _legend(figure, style, labels, columns)
    return save_figure(figure, out, file, caption)


def velocities(
    reading: Reading,
    out: Path,
    *,
    file: str,
    caption: str,
    select: Select,
    panels: Mapping[str, str],
    labels: Sequence[str],
) -> str:
    """Return the forward speed and the turning rate over time, a column a world.

    Args:
        reading: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        select: which cells; where one has been tuned several times, its first tuning is drawn.
        panels: each column's title and world.
        labels: whose speeds.
    """
    figure, axes = new_figure(2, len(panels), 5.4, 2.6, sharex="col", sharey="row")
    style = styles(reading.labels)
    for column, (title, world) in zip(axes.T, panels.items(), strict=True):
        for depth, label in enumerate(labels):
            row = reading.select(**select, world=world, label=label).to_dict("records")[0]
            way = reading.way(row).iloc[:-1]
            for ax, name in zip(column, ("v_mps", "w_radps"), strict=True):
                ax.step(way["t_s"], way[name], where="post", color=style[label].color, linewidth=1.1, zorder=9 - depth)
        column[0].set_title(title)
        column[1].set_xlabel("t [s]")
    axes[0, 0].set_ylabel("v [m/s]")
    axes[1, 0].set_ylabel("w [rad/s]")
    for ax in axes.ravel():
        ax.grid(alpha=0.3)
    plain = {label: style[label]._replace(dashes=(0.0, ())) for label in labels}
    _legend(figure, plain, labels, len(labels))
    return save_figure(figure, out, file, caption)


def phases(reading: Reading, out: Path, *, file: str, caption: str, select: Select) -> str:
    """Return what a robot under aouf2019's arbitration went through, on its way and as a table.

    Args:
        reading: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        select: one cell of one episode.
    """
    row = reading.select(**select).to_dict("records")[0]
    way = reading.way(row).reset_index(drop=True)
    figure, axes = new_figure(1, 1, 5.2, 5.0)
    ax = axes[0, 0]
    draw_world(ax, reading.world(row["run_id"], row["episode"]))
    follows = (way["behavior"] == 1.0).to_numpy()
    for holds, color, name in ((~follows, PALETTE[0], "go to goal"), (follows, PALETTE[2], "follow wall")):
        shown = holds | np.roll(holds, 1)  # each piece reaches the beginning of the next
        ax.plot(way["x_m"].where(shown), way["y_m"].where(shown), color=color, linewidth=1.6, label=name, zorder=6)
    goal = reading.world(row["run_id"], row["episode"]).goals[row["robot_index"]]
    raw = []
    for i, phase in enumerate(phases_of(way, row["outcome"]), 1):
        at = way.iloc[phase.row]
        away_m = math.hypot(goal.x_m - at["x_m"], goal.y_m - at["y_m"])
        raw.append([i, phase.name, at["t_s"], at["x_m"], at["y_m"], away_m])
    number_places(ax, [(i, x_m, y_m) for i, _, _, x_m, y_m, _ in raw], NEAR_M)
    robot = describe(Robot, reading.configuration(row["run_id"])["configuration"]["robot"], "robot")
    cut(ax, [way], robot.radius_m)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    names = ["number", "phase", "t_s", "x_m", "y_m", "goal_distance_m"]
    rows = [[str(i), name, *(number(value, 2) for value in values)] for i, name, *values in raw]
    headers = ["", "phase", "t [s]", "x [m]", "y [m]", "to the goal [m]"]
    table = save_table(out, file, _frame(raw, names), headers, rows)
    return f"{save_figure(figure, out, file, caption)}\n{table}"


def memberships(
    reading: Reading, out: Path, *, file: str, caption: str, table: str, axes: Mapping[str, Mapping[str, Any]]
) -> str:
    """Return the fuzzy sets that a controller offers of itself, a panel a variable.

    Args:
        reading: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        table: the name of the described table: variable, term, x, degree at the sets' corners.
        axes: for each variable its ``title``, and the ``low`` and ``high`` end of what is shown; with ``circle: true``
            these are one direction, so that a set that leaves at one comes in at the other.
    """
    described = description(reading, table)
    figure, panels = new_figure(len(axes), 1, 8.0, 1.9)
    for ax, (variable, axis) in zip(panels.ravel(), axes.items(), strict=True):
        sets = described[described["variable"] == variable]
        for i, (term, corners) in enumerate(sets.groupby("term", sort=False)):
            color = PALETTE[i % len(PALETTE)]
            x, degree = _whole_set(corners["x"].to_numpy(), corners["degree"].to_numpy(), axis)
            turn = axis["high"] - axis["low"]
            for shift in (-turn, 0.0, turn) if axis.get("circle") else (0.0,):
                ax.plot(x + shift, degree, color=color, linewidth=1.4)
            top = corners[corners["degree"] == 1.0]["x"].clip(axis["low"], axis["high"]).mean()
            side = {axis["low"]: "left", axis["high"]: "right"}.get(top, "center")
            ax.annotate(str(term), (top, 1.0), (0, 3), textcoords="offset points", ha=side, color=color, fontsize=9)
        ax.set(xlim=(axis["low"], axis["high"]), ylim=(0.0, 1.2), xlabel=axis["title"], ylabel="degree")
        ax.margins(x=0.02)
    return save_figure(figure, out, file, caption)


def _whole_set(x: FloatArray, degree: FloatArray, axis: Mapping[str, Any]) -> tuple[FloatArray, FloatArray]:
    """Return a fuzzy set's corners, its plateau drawn to the axis's end where the set does not fall before it."""
    before = [axis["low"]] if degree[0] == 1.0 and not axis.get("circle") else []
    after = [axis["high"]] if degree[-1] == 1.0 and not axis.get("circle") else []
    ones = [1.0] * len(before), [1.0] * len(after)
    return np.concatenate([before, x, after]), np.concatenate([ones[0], degree, ones[1]])


def surface(reading: Reading, out: Path, *, file: str, caption: str, table: str) -> str:
    """Return the control surface of a controller of one input: what it answers to each heading error.

    Args:
        reading: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        table: the name of the described table: phi_rad, v_mps, w_radps.
    """
    described = description(reading, table)
    figure, axes = new_figure(1, 2, 4.4, 3.0)
    for ax, name, title in zip(axes.ravel(), ("v_mps", "w_radps"), ("v [m/s]", "w [rad/s]"), strict=True):
        ax.plot(np.degrees(described["phi_rad"]), described[name], color=PALETTE[0])
        ax.set(xlabel="heading error [degrees]", ylabel=title, xlim=(-90.0, 90.0), xticks=range(-90, 91, 30))
        ax.grid(alpha=0.3)
    return save_figure(figure, out, file, caption)


def _draw_way(ax: "Axes", way: "pd.DataFrame", style: Style, rank: int, faint: bool, radius_m: float) -> None:
    """Draw a way; of several tunings the first one strongly, the others behind it."""
    x_m, y_m = thinned(way[["x_m", "y_m"]].to_numpy(), THINNED_RADII * radius_m).T
    if faint:
        ax.plot(x_m, y_m, color=style.color, linewidth=0.7, alpha=0.35, zorder=4)
    else:
        ax.plot(x_m, y_m, color=style.color, linewidth=1.7, linestyle=style.dashes, zorder=5 + rank)


def cut(ax: "Axes", ways: Sequence["pd.DataFrame"], radius_m: float, square: bool = True) -> None:
    """Cut a picture to the ways, to a square or no wider and no higher than they, and no further than it reached."""
    limits = []
    for name, (low, high) in (("x_m", ax.get_xlim()), ("y_m", ax.get_ylim())):
        least = min(way[name].min() for way in ways) - MARGIN_RADII * radius_m
        most = max(way[name].max() for way in ways) + MARGIN_RADII * radius_m
        limits.append((max(least, low), min(most, high)))
    if not square:
        ax.set(xlim=limits[0], ylim=limits[1])
        return
    width = max(high - low for low, high in limits)
    centres = [0.5 * (low + high) for low, high in limits]
    ax.set(
        xlim=(centres[0] - 0.5 * width, centres[0] + 0.5 * width),
        ylim=(centres[1] - 0.5 * width, centres[1] + 0.5 * width),
    )


def _legend(figure: Any, style: Mapping[str, Style], labels: Sequence[str], columns: int) -> None:
    from matplotlib.lines import Line2D

    lines = [
        Line2D([], [], color=style[label].color, linewidth=1.7, linestyle=(0.0, style[label].dashes[1]), label=label)
        for label in labels
    ]
    count = min(len(labels), 2 * columns)
    figure.legend(handles=lines, loc="outside lower center", ncols=count, frameon=False, handlelength=4.0)


def number_places(
    ax: "Axes",
    numbered: Sequence[tuple[int, float, float]],
    near_m: float,
    offset: tuple[float, float] = (8.0, -4.0),
) -> None:
    """Write numbers beside places, those of one place together.

    Args:
        ax: where to write.
        numbered: each number with its x [m] and y [m].
        near_m: what lies nearer than this to a place's first number stands with it [m].
        offset: of a number from its place [points].
    """
    places: dict[tuple[float, float], list[str]] = {}
    for i, x_m, y_m in numbered:
        ax.plot(x_m, y_m, "o", color="black", markerfacecolor="none", markersize=5, zorder=8)
        near = next((place for place in places if math.hypot(place[0] - x_m, place[1] - y_m) < near_m), (x_m, y_m))
        places.setdefault(near, []).append(str(i))
    for place, names in places.items():
        ground = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.6}
        ax.annotate(", ".join(names), place, offset, textcoords="offset points", fontsize=9, zorder=9, bbox=ground)


def _frame(rows: Sequence[Sequence[Any]], names: Sequence[str]) -> "pd.DataFrame":
    import pandas as pd

    return pd.DataFrame(rows, columns=list(names))
