"""Sections of a report that are figures: overlaid paths and speeds, phases, memberships and surfaces."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from navbench.analysis.paths import cut, number_places, write_beside
from navbench.analysis.phases import phases as phases_of
from navbench.analysis.stored import StoredResults
from navbench.report.figures import (
    PALETTE,
    Style,
    draw_circle,
    draw_world,
    nested_width,
    new_figure,
    robot_color,
    save_figure,
    styles,
    thinned,
)
from navbench.report.markup import number, save_table
from navbench.robot import Robot
from navbench.validation import describe

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

Select = Mapping[str, Any]
THINNED_RADII = 0.015  # what a drawn path may stray from the driven one
ROUNDED = 1e-4  # of an axis: its ends are printed numbers
NAMED_APART, EDGE = 0.04, 0.015  # of an axis: between the names of two sets, and from its end
NEAR_M = 0.12  # phases that came about nearer to each other than this share their number's place


def trajectories(
    stored: StoredResults,
    out: Path,
    *,
    file: str,
    caption: str,
    select: Select,
    panels: Mapping[str, str],
    labels: Sequence[str],
    columns: int = 2,
) -> str:
    """Return the paths of several controllers over each other, a panel a world, cut to where the robots went.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        select: which cells.
        panels: each panel's title and world.
        labels: whose paths, the first below the others, which are narrower.
        columns: how many panels stand side by side.
    """
    columns = min(columns, len(panels))
    figure, axes = new_figure(-(-len(panels) // columns), columns, 4.4, 4.2)
    style = styles(stored.labels)
    starts: dict[Axes, Any] = {}
    for ax, (title, world) in zip(axes.ravel(), panels.items(), strict=False):
        records = stored.select(**select, world=world, label=list(labels)).to_dict("records")
        draw_world(ax, stored.world(records[0]["run_id"], records[0]["episode"]))
        trajectories = [(row, stored.trajectory(row)) for row in records]
        robot = describe(Robot, stored.configuration(records[0]["run_id"])["configuration"]["robot"], "robot")
        for row, trajectory in trajectories:
            one = style[row["label"]]
            if len(labels) == 1:  # a fleet: a colour a robot
                one = one._replace(color=robot_color(row["robot_index"]))
            rank = labels.index(row["label"])
            _draw_path(ax, trajectory, one.color, rank, len(labels), row["tuning_seed"] > 0, robot.radius_m)
            draw_circle(ax, trajectory["x_m"].iloc[0], trajectory["y_m"].iloc[0], robot.radius_m)
            if row["outcome"] != "reached":
                size = 4.0 * nested_width(rank, len(labels))
                end = trajectory[["x_m", "y_m"]].iloc[-1]
                ax.plot(*end, "X", color=style[row["label"]].color, markersize=size, zorder=20 + rank)
        cut(ax, [trajectory for _, trajectory in trajectories], robot.radius_m)
        first = {
            f"R{row['robot_index'] + 1}": tuple(trajectory[["x_m", "y_m"]].iloc[0])
            for row, trajectory in reversed(trajectories)
        }
        if len(first) > 1:
            starts[ax] = (
                [(place, name) for name, place in first.items()],
                [trajectory for _, trajectory in trajectories],
                robot.radius_m,
            )
        ax.set_title(title)
    for ax in axes.ravel()[len(panels) :]:
        ax.set_axis_off()
    if len(labels) > 1:
        widths = [nested_width(rank, len(labels)) for rank in range(len(labels))]
        _legend(figure, style, labels, columns, widths)
    for ax, arguments in starts.items():
        write_beside(ax, *arguments)
    return save_figure(figure, out, file, caption)


def velocities(
    stored: StoredResults,
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
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        select: which cells; where one has been tuned several times, its first tuning is drawn.
        panels: each column's title and world.
        labels: whose speeds.
    """
    figure, axes = new_figure(2, len(panels), 5.4, 2.6, sharex="col", sharey="row")
    style = styles(stored.labels)
    for column, (title, world) in zip(axes.T, panels.items(), strict=True):
        for depth, label in enumerate(labels):
            row = stored.select(**select, world=world, label=label).to_dict("records")[0]
            trajectory = stored.trajectory(row).iloc[:-1]
            for ax, name in zip(column, ("v_mps", "w_radps"), strict=True):
                ax.step(
                    trajectory["t_s"],
                    trajectory[name],
                    where="post",
                    color=style[label].color,
                    linewidth=1.1,
                    zorder=9 - depth,
                )
        column[0].set_title(title)
        column[1].set_xlabel("t [s]")
    axes[0, 0].set_ylabel("v [m/s]")
    axes[1, 0].set_ylabel("w [rad/s]")
    for ax in axes.ravel():
        ax.grid(alpha=0.3)
    _legend(figure, style, labels, len(labels), [1.7] * len(labels))
    return save_figure(figure, out, file, caption)


def phases(stored: StoredResults, out: Path, *, file: str, caption: str, select: Select) -> str:
    """Return what a robot under aouf2019's arbitration went through, on its way and as a table.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        select: one cell of one episode.
    """
    row = stored.select(**select).to_dict("records")[0]
    trajectory = stored.trajectory(row).reset_index(drop=True)
    figure, axes = new_figure(1, 1, 5.2, 5.0)
    ax = axes[0, 0]
    draw_world(ax, stored.world(row["run_id"], row["episode"]))
    follows = (trajectory["behavior"] == 1.0).to_numpy()
    for holds, color, name in ((~follows, PALETTE[0], "go to goal"), (follows, PALETTE[1], "follow wall")):
        shown = holds | np.roll(holds, 1)  # each piece reaches the beginning of the next
        ax.plot(
            trajectory["x_m"].where(shown),
            trajectory["y_m"].where(shown),
            color=color,
            linewidth=1.6,
            label=name,
            zorder=6,
        )
    goal = stored.world(row["run_id"], row["episode"]).goals[row["robot_index"]]
    raw = []
    for i, phase in enumerate(phases_of(trajectory, row["outcome"]), 1):
        at = trajectory.iloc[phase.row]
        away_m = math.hypot(goal.x_m - at["x_m"], goal.y_m - at["y_m"])
        raw.append([i, phase.name, at["t_s"], at["x_m"], at["y_m"], away_m])
    robot = describe(Robot, stored.configuration(row["run_id"])["configuration"]["robot"], "robot")
    cut(ax, [trajectory], robot.radius_m)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    number_places(ax, [(i, x_m, y_m) for i, _, _, x_m, y_m, _ in raw], NEAR_M, [trajectory])
    names = ["number", "phase", "t_s", "x_m", "y_m", "goal_distance_m"]
    rows = [[str(i), name, *(number(value, 2) for value in values)] for i, name, *values in raw]
    headers = ["", "phase", "t [s]", "x [m]", "y [m]", "to the goal [m]"]
    table = save_table(out, file, _frame(raw, names), headers, rows)
    return f"{save_figure(figure, out, file, caption)}\n{table}"


def memberships(
    stored: StoredResults, out: Path, *, file: str, caption: str, table: str, axes: Mapping[str, Mapping[str, Any]]
) -> str:
    """Return the fuzzy sets that a controller offers of itself, a panel a variable.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        table: the name of the described table: variable, term, x, degree at the sets' corners.
        axes: for each variable its ``title``, and the ``low`` and ``high`` end of what is shown; ``circle`` where
            these are one direction, so that a set that leaves at one comes in at the other; ``saturates`` where values
            beyond the sets belong to the outermost.
    """
    described = stored.described(table)
    figure, panels = new_figure(len(axes), 1, 8.0, 1.9)
    for ax, (variable, axis) in zip(panels.ravel(), axes.items(), strict=True):
        sets = described[described["variable"] == variable]
        tops: list[tuple[float, str, str]] = []
        near = ROUNDED * (axis["high"] - axis["low"])
        for i, (term, corners) in enumerate(sets.groupby("term", sort=False)):
            color = PALETTE[i % len(PALETTE)]
            for x, degree in _shapes(corners, axis):
                ax.plot(x, degree, color=color, linewidth=1.4)
                top = x[degree > degree.max() - 1e-9]
                if top.max() >= axis["low"] - near and top.min() <= axis["high"] + near:
                    low, high = top.clip(axis["low"], axis["high"])[[0, -1]]
                    tops.append((0.5 * (low + high), str(term), color))
        _name_sets(ax, tops, axis["low"], axis["high"])
        ax.set(xlim=(axis["low"], axis["high"]), ylim=(0.0, 1.3), xlabel=axis["title"], ylabel="degree")
        ax.set_yticks([0.0, 0.5, 1.0])
    return save_figure(figure, out, file, caption)


def surface(stored: StoredResults, out: Path, *, file: str, caption: str, table: str) -> str:
    """Return the control surface of a controller of one input: what it answers to each heading error.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        table: the name of the described table: phi_rad, v_mps, w_radps.
    """
    described = stored.described(table)
    figure, axes = new_figure(1, 2, 4.4, 3.0)
    for ax, name, title in zip(axes.ravel(), ("v_mps", "w_radps"), ("v [m/s]", "w [rad/s]"), strict=True):
        ax.plot(np.degrees(described["phi_rad"]), described[name], color=PALETTE[0])
        ax.set(xlabel="heading error [degrees]", ylabel=title, xlim=(-90.0, 90.0), xticks=range(-90, 91, 30))
        ax.grid(alpha=0.3)
    return save_figure(figure, out, file, caption)


def _draw_path(
    ax: "Axes", trajectory: "pd.DataFrame", color: str, rank: int, count: int, faint: bool, radius_m: float
) -> None:
    """Draw a path; of several tunings the first one strongly, the others behind it."""
    x_m, y_m = thinned(trajectory[["x_m", "y_m"]].to_numpy(), THINNED_RADII * radius_m).T
    if faint:
        ax.plot(x_m, y_m, color=color, linewidth=0.7, alpha=0.4, zorder=4)
    else:
        ax.plot(x_m, y_m, color=color, linewidth=nested_width(rank, count), zorder=5 + rank)


def _shapes(corners: "pd.DataFrame", axis: Mapping[str, Any]) -> list[tuple[Any, Any]]:
    """Return a set's corners as (x, degree): on a circle also a turn before and behind, lest it break off at an end."""
    x, degree = corners["x"].to_numpy(), corners["degree"].to_numpy()
    if axis.get("saturates") and degree[0] == 1.0:
        x, degree = np.append(min(x[0], axis["low"]), x), np.append(1.0, degree)
    if axis.get("saturates") and degree[-1] == 1.0:
        x, degree = np.append(x, max(x[-1], axis["high"])), np.append(degree, 1.0)
    turn = axis["high"] - axis["low"]
    return [(x + shift, degree) for shift in ((-turn, 0.0, turn) if axis.get("circle") else (0.0,))]


def _name_sets(ax: "Axes", tops: Sequence[tuple[float, str, str]], low: float, high: float) -> None:
    """Write each set's name over its top: within the frame, and higher where it would cover the one before."""
    before, raised = -math.inf, False
    for x, term, color in sorted(tops):
        raised = not raised and x - before < NAMED_APART * (high - low)
        side = "left" if x - low < EDGE * (high - low) else "right" if high - x < EDGE * (high - low) else "center"
        offset = {"left": 2, "right": -2, "center": 0}[side], 13 if raised else 3
        ax.annotate(term, (x, 1.0), offset, textcoords="offset points", ha=side, color=color, fontsize=9)
        before = x


def _legend(
    figure: Any, style: Mapping[str, Style], labels: Sequence[str], columns: int, widths: Sequence[float]
) -> None:
    from matplotlib.lines import Line2D

    lines = [
        Line2D([], [], color=style[label].color, linewidth=width, label=label)
        for label, width in zip(labels, widths, strict=True)
    ]
    count = min(len(labels), 2 * columns)
    figure.legend(handles=lines, loc="outside lower center", ncols=count, frameon=False, handlelength=4.0)


def _frame(rows: Sequence[Sequence[Any]], names: Sequence[str]) -> "pd.DataFrame":
    import pandas as pd

    return pd.DataFrame(rows, columns=list(names))
