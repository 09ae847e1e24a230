"""Sections of a report that are pictures of runs: trajectories over their world, frames of an episode, time series."""

import string
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.experiments.store import ResultsError
from navbench.report.document import Block, Blocks, Paragraph
from navbench.report.drawing import draw_circle, draw_robot, draw_world, thinned
from navbench.report.figures import (
    PALETTE,
    draw_cells,
    label_legend,
    nested_width,
    new_figure,
    panel_of,
    robot_color,
)
from navbench.report.page import Page, Select
from navbench.report.paths import Word, cut, draw_marks, write_beside
from navbench.report.sampling import sample_of
from navbench.world.layout import DrawnWorld

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]
THINNED_RADII = 0.015  # what a drawn path may stray from the driven one
WIDTH_INCHES, TITLE_INCHES = 2.5, 0.35  # of a frame
PANELS, FIGURES = 12, 5  # a figure of more cells cannot be read, and nobody reads more figures
FRAMES = 10  # where no times are given, so many, evenly from the beginning to the end
ASIDE_POINTS = 12.0  # from a robot's centre to its name in a frame
FLAT = 1e-6  # values that differ by less are drawn as one, not as their rounding errors
PLACE = ("x_m", "y_m", "heading_rad")  # columns that change between the control periods, too
JUMP = 0.05  # of the values' range: a greater step
CHATTER = 0.01  # of the time: jumps there and back within it are drawn faintly, lest they fill an area


def trajectories(
    page: Page,
    *,
    select: Select | None = None,
    panels: Mapping[str, str] | None = None,
    labels: Sequence[str] = (),
    columns: int = 0,
    marks_s: float = 0.0,
) -> Blocks:
    """Return the paths of several controllers over each other, a panel per world, cut to where the robots went.

    Args:
        select: which cells; None for all.
        panels: each panel's title and world; None for a panel per cell that keeps its trajectories.
        labels: whose paths, the first below the others, which are narrower; none for all.
        columns: how many panels stand side by side; 0 for what fits.
        marks_s: how often each robot's place and heading are marked on its path [s]; 0 for never.
    """
    select = select or {}
    if panels is None:
        return _by_cell(page, select)
    labels = labels or page.stored.labels
    columns = columns or 2
    columns = min(columns, len(panels))
    figure, axes = new_figure(-(-len(panels) // columns), columns, 4.4, 4.2)
    starts: dict[Axes, Any] = {}
    for ax, (title, world) in zip(axes.ravel(), panels.items(), strict=False):
        records = page.stored.select(**select, world=world, label=list(labels)).to_dict("records")
        draw_world(ax, page.stored.world(records[0]["run_id"], records[0]["episode"]))
        paths = [(row, page.stored.trajectory(row)) for row in records]
        robot = page.robot(records[0]["run_id"])
        for row, path in paths:
            one = page.styles[row["label"]]
            if len(labels) == 1:  # a fleet: a colour a robot
                one = one._replace(color=robot_color(row["robot_index"]))
            rank = labels.index(row["label"])
            _draw_path(ax, path, one.color, rank, len(labels), row["tuning_seed"] > 0, robot.radius_m)
            if marks_s and not row["tuning_seed"] > 0:
                draw_marks(ax, path, marks_s, robot.radius_m, one.color)
            draw_circle(ax, path["x_m"].iloc[0], path["y_m"].iloc[0], robot.radius_m)
            if row["outcome"] != "reached":
                size = 4.0 * nested_width(rank, len(labels))
                end = path[["x_m", "y_m"]].iloc[-1]
                ax.plot(*end, "X", color=page.styles[row["label"]].color, markersize=size, zorder=20 + rank)
        cut(ax, [path for _, path in paths], robot.radius_m)
        first = {f"R{row['robot_index'] + 1}": tuple(path[["x_m", "y_m"]].iloc[0]) for row, path in reversed(paths)}
        if len(first) > 1:
            starts[ax] = (
                [Word(place, name) for name, place in first.items()],
                [path for _, path in paths],
                robot.radius_m,
            )
        ax.set_title(title)
    for ax in axes.ravel()[len(panels) :]:
        ax.set_axis_off()
    if len(labels) > 1:
        widths = [nested_width(rank, len(labels)) for rank in range(len(labels))]
        label_legend(figure, page.styles, labels, widths, 2 * columns)
    for ax, arguments in starts.items():
        write_beside(ax, *arguments)
    return [page.plot(figure)]


def _by_cell(page: Page, select: Select) -> Blocks:
    """Return the trajectories of all episodes, a panel per cell of which they are kept, some panels a figure."""
    cells = {str(run_id): rows for run_id, rows in page.stored.select(**select).groupby("run_id", sort=False)}
    sample = sample_of(list(cells), page.stored.rows, PANELS * FIGURES)
    panels = []
    for run_id in sample.runs:
        try:
            panels.append(panel_of(page.stored, run_id, cells[run_id]))
        except ResultsError:  # a cell that keeps none
            continue
    plots: list[Block] = [Paragraph(f"{sample.says}.")] if sample.says else []
    for i in range(0, len(panels), PANELS):
        figure = draw_cells(panels[i : i + PANELS])
        plots.append(page.plot(figure, "Trajectories, a panel per cell.", more=f"_{i // PANELS + 1}"))
    return plots if panels else [Paragraph("No trajectories were kept.")]


def _draw_path(
    ax: "Axes", path: "pd.DataFrame", color: str, rank: int, count: int, faint: bool, radius_m: float
) -> None:
    """Draw a path; of several tunings the first one strongly, the others behind it."""
    x_m, y_m = thinned(path[["x_m", "y_m"]].to_numpy(), THINNED_RADII * radius_m).T
    if faint:
        ax.plot(x_m, y_m, color=color, linewidth=0.7, alpha=0.4, zorder=4)
    else:
        ax.plot(x_m, y_m, color=color, linewidth=nested_width(rank, count), zorder=5 + rank)


def frames(page: Page, *, select: Select, times_s: Sequence[float] = (), columns: int = 5) -> Blocks:
    """Return an episode of a fleet in frames a), b), ...: robots with their headings and paths so far, and movers.

    Args:
        select: one cell of one episode.
        times_s: when [s]; without any, ten times from the beginning to the end.
        columns: how many frames stand side by side.
    """
    rows = page.stored.select(**select).to_dict("records")
    paths = [page.stored.trajectory(row) for row in rows]
    world = page.stored.world(rows[0]["run_id"], rows[0]["episode"])
    robot = page.robot(rows[0]["run_id"])
    end_s = max(float(path["t_s"].iloc[-1]) for path in paths)
    times = list(times_s) or np.linspace(0.0, end_s, FRAMES).tolist()
    columns, b = min(columns, len(times)), world.bounds
    height = TITLE_INCHES + WIDTH_INCHES * min((b.y_max_m - b.y_min_m) / (b.x_max_m - b.x_min_m), 2.0)
    figure, axes = new_figure(-(-len(times) // columns), columns, WIDTH_INCHES, height, sharex=True, sharey=True)
    for i, (ax, t_s) in enumerate(zip(axes.ravel(), times, strict=False)):
        draw_world(ax, world, t_s)
        for path, color in zip(paths, map(robot_color, range(len(paths))), strict=True):
            so_far = path[path["t_s"] <= t_s]
            ax.plot(so_far["x_m"], so_far["y_m"], color=color, linewidth=1.0, zorder=5)
            draw_robot(ax, so_far[["x_m", "y_m", "heading_rad"]].iloc[-1], robot.radius_m, color)
        name_frame(ax, world, t_s, [path[path["t_s"] <= t_s].iloc[-1] for path in paths])
        ax.set(xlabel="", ylabel="")
        ax.set_title(f"{string.ascii_lowercase[i % 26]}) {t_s:.1f} s", fontsize=10)
    for ax in axes.ravel()[len(times) :]:
        ax.set_axis_off()
    for ax in axes.ravel()[len(times) - columns : len(times)]:
        ax.tick_params(labelbottom=True)  # nothing stands below these
    figure.supxlabel("x [m]", fontsize=10)
    figure.supylabel("y [m]", fontsize=10)
    return [page.plot(figure)]


def name_frame(ax: "Axes", world: DrawnWorld, t_s: float, robots: Sequence[Mapping[Any, float]]) -> None:
    """Write R1, R2, ... to the left of the robots of a frame, M1, ... on the movers and O1, ... on the discs."""
    for i, (mover, disc) in enumerate(zip_longest(world.movers, world.discs), 1):
        places = {"M": mover and mover.place(t_s), "O": disc and (disc.x_m, disc.y_m)}
        for letter, place in places.items():
            if place:
                x_m, y_m = place
                ax.text(x_m, y_m, f"{letter}{i}", fontsize=6, ha="center", va="center", color="white", zorder=9)
    for i, robot in enumerate(robots, 1):
        aside = -ASIDE_POINTS * np.sin(robot["heading_rad"]), ASIDE_POINTS * np.cos(robot["heading_rad"])
        look: dict[str, Any] = {"fontsize": 7, "ha": "center", "va": "center", "zorder": 30}
        ax.annotate(f"R{i}", (robot["x_m"], robot["y_m"]), aside, textcoords="offset points", **look)


def time_series(
    page: Page,
    *,
    panels: Mapping[str, Select],
    series: Mapping[str, Mapping[str, str]],
    ticks: Mapping[str, Mapping[str, float]] | None = None,
    spans: Mapping[str, Sequence[float]] | None = None,
    bands: Mapping[str, Sequence[float]] | None = None,
) -> Blocks:
    """Return columns of a trajectory over time: a row for each axis, a column for each run.

    Places are drawn through; all else is held over its control period. A series that does not change takes the range
    of the others in its row.

    Args:
        panels: each run's title, and which cells; the first episode of them is drawn.
        series: each axis's title, such as "mu [degrees]", and the columns that it shows with what each is called;
            columns in radians are drawn in degrees.
        ticks: of some axes, what their values are called.
        spans: what is told of some times, and from when to when [s]; shaded.
        bands: of some axes, between which values the paper holds what they show; shaded.
    """
    figure, axes = new_figure(len(series), len(panels), 3.6 if len(panels) > 1 else 7.0, 1.8, sharex="col")
    for above, (title, select) in zip(axes.T, panels.items(), strict=True):
        path = page.stored.trajectory(page.first(select))
        for ax, (label, columns) in zip(above, series.items(), strict=True):
            for i, (column, called) in enumerate(columns.items()):
                values = np.degrees(path[column]) if column.endswith(("_rad", "_radps")) else path[column]
                look = {"color": PALETTE[i], "linewidth": nested_width(i, len(columns))}
                if column in PLACE:
                    ax.plot(path["t_s"], values, label=called, **look)
                else:
                    stairs(ax, path["t_s"].to_numpy(), values.to_numpy(dtype=float), called, look)
            for called, (begin_s, end_s) in (spans or {}).items():
                ax.axvspan(begin_s, end_s, color="0.85", zorder=0, label=called if ax is axes[0, 0] else None)
            if bands and label in bands:
                ax.axhspan(*bands[label], color="0.85", zorder=0, label="as printed")
            ax.grid(alpha=0.3)
            ax.set_ylabel(label)
            if ticks and label in ticks:
                ax.set_yticks(list(ticks[label].values()), list(ticks[label]))
            if len(columns) > 1:
                ax.legend(frameon=False, fontsize=8)
        above[0].set_title(title)
        above[-1].set_xlabel("t [s]")
    for row in axes:
        widen_flat(row)
    return [page.plot(figure)]


def stairs(ax: "Axes", t_s: FloatArray, values: FloatArray, called: str, look: Mapping[str, Any]) -> None:
    """Draw what a controller held over each control period; its last row belongs to the end, when it acted no more.

    Args:
        ax: where to draw.
        t_s: (n,) when each period begins, and last the end [s].
        values: (n,) of each period; the last is not drawn.
        called: what the legend calls it.
        look: the line's colour and width.
    """
    if len(t_s) < 2:  # it ended before its first period was over
        return
    x, y = np.repeat(t_s, 2)[1:-1], np.repeat(values[:-1], 2)
    faint = chatter(t_s, values)
    if faint.any():
        ax.plot(x, y, color=look["color"], linewidth=0.4, alpha=0.3)
        at = 2 * np.flatnonzero(faint) + 2
        x, y = np.insert(x, at, np.nan), np.insert(y, at, np.nan)
    ax.plot(x, y, label=called, **look)


def chatter(t_s: FloatArray, values: FloatArray) -> NDArray[np.bool_]:
    """Return (n - 2,) whether the step at the end of each control period is a jump close to one the other path.

    Args:
        t_s: (n,) when each period begins, and last the end [s].
        values: (n,) of each period; the last does not count.
    """
    held = values[:-1]
    steps = np.diff(held)
    jumps = np.flatnonzero(np.abs(steps) > max(JUMP * float(np.ptp(held)), FLAT))
    back = steps[jumps[1:]] * steps[jumps[:-1]] < 0.0
    close = back & (np.diff(t_s[jumps + 1]) < CHATTER * (t_s[-1] - t_s[0]))
    found = np.zeros(len(held) - 1, dtype=bool)
    found[jumps] = np.append(close, False) | np.append(False, close)
    return found


def widen_flat(row: "Sequence[Axes]") -> None:
    """Give those axes of a row whose series do not change the range of the others, or one of 1 around their value."""
    limits = {ax: ax.get_ylim() for ax in row}
    flat = [ax for ax in row if np.ptp(ax.dataLim.intervaly) < FLAT]
    others = [limits[ax] for ax in row if ax not in flat]
    for ax in flat:
        value = float(ax.dataLim.intervaly.mean())
        lows, highs = zip(*others, strict=True) if others else ([value - 0.5], [value + 0.5])
        ax.set_ylim(min(value - FLAT, *lows), max(value + FLAT, *highs))
