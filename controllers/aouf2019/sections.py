"""The sections of aouf2019's report: phases of its arbitration, speeds over time, its control surface, speed sweeps."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from navbench.analysis.stored import reached
from navbench.controllers.aouf2019.behaviors import FOLLOW_WALL
from navbench.controllers.aouf2019.measures import phases_of
from navbench.report.claims import printed_figures
from navbench.report.comparison import compared
from navbench.report.document import Blocks, Column
from navbench.report.drawing import draw_world
from navbench.report.figures import PALETTE, label_legend, nested_width, new_figure
from navbench.report.page import Page, Select
from navbench.report.paths import cut, draw_pieces, number_places

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARKERS = ("o", "s", "^", "D")
NEAR_M = 0.12  # phases that came about nearer to each other than this share their number's place
SWEPT = "#444444"
PHASES = (
    Column("", "number"),
    Column("phase", "phase"),
    Column("t", "t_s", "s", 2),
    Column("x", "x_m", "m", 2),
    Column("y", "y_m", "m", 2),
    Column("to the goal", "goal_distance_m", "m", 2),
)


def printed_chart(
    page: Page, *, metrics: Mapping[str, str], worlds: Mapping[str, str], labels: Sequence[str], readings: Sequence[str]
) -> Blocks:
    """Return the paper's tables beside ours as a chart: an axis for each metric and world, a row for each controller.

    Args:
        metrics: each metric's title, with what the ids of its claims begin with, such as ``{time_s: time-}``.
        worlds: each world's title and name.
        labels: the rows.
        readings: names of cells, each a reading; of several runs the median is drawn, and their range as a line.
    """
    figure, axes = new_figure(len(metrics), len(worlds), 3.2, 2.1, sharey=True)
    for above, (metric, claims) in zip(axes, metrics.items(), strict=True):
        printed = printed_figures(page.stored, claims)
        for ax, (title, world) in zip(above, worlds.items(), strict=True):
            for row, label in enumerate(labels):
                ax.plot(printed[label, world], row, "k|", markersize=22, markeredgewidth=2.0)
                for i, name in enumerate(readings):
                    _draw_reading(ax, page, {"name": name, "label": label, "world": world}, metric, row, i)
            ax.set_title(f"{title}, {metric.rpartition('_')[0].replace('_', ' ')} [{metric.rpartition('_')[2]}]")
            ax.set_yticks(range(len(labels)), labels)
            ax.set_ylim(len(labels) - 0.5, -0.5)
            ax.grid(alpha=0.3)
    handles = [axes.ravel()[0].plot([], [], "k|", markersize=14, markeredgewidth=2.0, label="printed")[0]]
    for i, name in enumerate(readings):
        handles += axes.ravel()[0].plot([], [], MARKERS[i], color=PALETTE[i], label=name.replace("_", " "))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    return [page.plot(figure)]


def _draw_reading(ax: "Axes", page: Page, select: Select, metric: str, row: int, i: int) -> None:
    """Draw the median of the runs that reached with their range; nothing where a reading has no such controller."""
    rows = page.stored.episodes
    for column, value in select.items():
        rows = rows[rows[column] == value]
    values = reached(rows)[metric]
    if len(values):
        height = row + 0.16 * (i - 1)
        ax.plot([values.min(), values.max()], [height, height], color=PALETTE[i], linewidth=1.5)
        ax.plot(values.median(), height, MARKERS[i], color=PALETTE[i], markersize=6)


def phases(page: Page, *, select: Select) -> Blocks:
    """Return what a robot under aouf2019's arbitration went through, on its path and as a table.

    Args:
        select: one cell of one episode.
    """
    row = page.first(select)
    path = page.stored.trajectory(row).reset_index(drop=True)
    figure, axes = new_figure(1, 1, 5.2, 5.0)
    ax = axes[0, 0]
    draw_world(ax, page.stored.world(row["run_id"], row["episode"]))
    follows = (path["behavior"] == FOLLOW_WALL).to_numpy()
    draw_pieces(ax, path, {"go to goal": ~follows, "follow wall": follows}, 1.6, 6)
    goal = page.stored.world(row["run_id"], row["episode"]).goals[row["robot_index"]]
    rows = []
    for i, phase in enumerate(phases_of(path, row["outcome"]), 1):
        t_s, x_m, y_m = path[["t_s", "x_m", "y_m"]].iloc[phase.row]
        rows.append([i, phase.name, t_s, x_m, y_m, math.hypot(goal.x_m - x_m, goal.y_m - y_m)])
    robot = page.robot(row["run_id"])
    cut(ax, [path], robot.radius_m)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    number_places(ax, [(i, x_m, y_m) for i, _, _, x_m, y_m, _ in rows], NEAR_M, [path])
    return [page.plot(figure), page.table(PHASES, rows)]


def velocities(page: Page, *, select: Select, panels: Mapping[str, str], labels: Sequence[str]) -> Blocks:
    """Return the forward speed and the turning rate over time, a column a world.

    Args:
        select: which cells; where one has been tuned several times, its first tuning is drawn.
        panels: each column's title and world.
        labels: whose speeds.
    """
    figure, axes = new_figure(2, len(panels), 5.4, 2.6, sharex="col", sharey="row")
    for column, (title, world) in zip(axes.T, panels.items(), strict=True):
        for depth, label in enumerate(labels):
            row = page.first({**select, "world": world, "label": label})
            path = page.stored.trajectory(row).iloc[:-1]
            for ax, name in zip(column, ("v_mps", "w_radps"), strict=True):
                ax.step(
                    path["t_s"],
                    path[name],
                    where="post",
                    color=page.styles[label].color,
                    linewidth=1.1,
                    zorder=9 - depth,
                )
        column[0].set_title(title)
        column[1].set_xlabel("t [s]")
    axes[0, 0].set_ylabel("v [m/s]")
    axes[1, 0].set_ylabel("w [rad/s]")
    for ax in axes.ravel():
        ax.grid(alpha=0.3)
    label_legend(figure, page.styles, labels, [1.7] * len(labels))
    return [page.plot(figure)]


def surface(page: Page, *, table: str) -> Blocks:
    """Return the control surface of a controller of one input: what it answers to each heading error.

    Args:
        table: the name of the described table: phi_rad, v_mps, w_radps.
    """
    described = page.stored.described(table)
    figure, axes = new_figure(1, 2, 4.4, 3.0)
    for ax, name, title in zip(axes.ravel(), ("v_mps", "w_radps"), ("v [m/s]", "w [rad/s]"), strict=True):
        ax.plot(np.degrees(described["phi_rad"]), described[name], color=PALETTE[0])
        ax.set(xlabel="heading error [degrees]", ylabel=title, xlim=(-90.0, 90.0), xticks=range(-90, 91, 30))
        ax.grid(alpha=0.3)
    return [page.plot(figure)]


def constant_speeds(
    page: Page,
    *,
    select: Select,
    worlds: Mapping[str, str],
    speeds_mps: Mapping[str, float],
    level: Sequence[str],
    reference: str = "",
) -> Blocks:
    """Return the share that reached and the mean time over the constant speed of one PID.

    Args:
        select: which cells.
        worlds: each world's title and name.
        speeds_mps: the labels that differ in their constant speed alone, with it [m/s].
        level: the labels whose lines are shown for comparison.
        reference: the label whose starts are taken.
    """
    found = compared(page, select, worlds, reference)
    figure, axes = new_figure(2, len(found), 3.0, 2.3, sharex=True, sharey="row")
    for column, (world, beside) in zip(axes.T, found.items(), strict=True):
        here = {c.label: c for c in beside}
        for ax, name in zip(column, ("reached", "time_s"), strict=True):
            swept = sorted((speed, getattr(here[label], name)) for label, speed in speeds_mps.items())
            speeds, intervals = [speed for speed, _ in swept], [interval for _, interval in swept]
            ax.plot(speeds, [i.value for i in intervals], "o-", color=SWEPT, label="PID at a constant speed", zorder=3)
            ax.fill_between(speeds, [i.low for i in intervals], [i.high for i in intervals], color=SWEPT, alpha=0.2)
            for i, label in enumerate(level):
                interval, width = getattr(here[label], name), nested_width(i, len(level))
                ax.axhline(interval.value, color=page.styles[label].color, linewidth=width, label=label)
                ax.axhspan(interval.low, interval.high, color=page.styles[label].color, alpha=0.15, linewidth=0)
            ax.grid(alpha=0.3)
        column[0].set_title(world)
        column[1].set_xlabel("constant speed [m/s]")
    axes[0, 0].set_ylabel("share that reached")
    axes[1, 0].set_ylabel("mean time [s],\nfailures at the limit")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, handlelength=4.0)
    return [page.plot(figure)]
