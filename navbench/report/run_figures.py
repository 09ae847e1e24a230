"""Sections of a report that draw what a controller left in its trace: over time, and along the path."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.paths import cut, number_places
from navbench.analysis.stored import StoredResults
from navbench.analysis.traces import spells
from navbench.report.figures import PALETTE, draw_circle, draw_world, nested_width, new_figure, save_figure
from navbench.report.markup import number, save_table
from navbench.robot import Robot
from navbench.validation import describe

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]
Select = Mapping[str, Any]
NEAR = 0.03  # of a picture's width: numbers of places nearer to each other stand together
FLAT = 1e-6  # values that differ by less are drawn as one, not as their rounding errors
PLACE = ("x_m", "y_m", "heading_rad")  # columns that change between the control periods, too
JUMP = 0.05  # of the values' range: a greater step
CHATTER = 0.01  # of the time: jumps there and back within it are drawn faintly, lest they fill an area
SIDE_INCHES, WORDS_INCHES = 6.0, 1.0  # the longer side of a picture of one way, and the words around it


def time_series(
    stored: StoredResults,
    out: Path,
    *,
    file: str,
    caption: str,
    panels: Mapping[str, Select],
    series: Mapping[str, Mapping[str, str]],
    ticks: Mapping[str, Mapping[str, float]] | None = None,
) -> str:
    """Return columns of a trajectory over time: a row for each axis, a column for each run.

    Places are drawn through; all else is held over its control period. A series that does not change takes the range
    of the others in its row.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        panels: each run's title, and which cells; the first episode of them is drawn.
        series: each axis's title, such as "mu [degrees]", and the columns that it shows with what each is called;
            columns in radians are drawn in degrees.
        ticks: of some axes, what their values are called.
    """
    figure, axes = new_figure(len(series), len(panels), 3.6 if len(panels) > 1 else 7.0, 1.8, sharex="col")
    for above, (title, select) in zip(axes.T, panels.items(), strict=True):
        trajectory = stored.trajectory(stored.select(**select).to_dict("records")[0])
        for ax, (label, columns) in zip(above, series.items(), strict=True):
            for i, (column, called) in enumerate(columns.items()):
                values = np.degrees(trajectory[column]) if column.endswith("_rad") else trajectory[column]
                look = {"color": PALETTE[i], "linewidth": nested_width(i, len(columns))}
                if column in PLACE:
                    ax.plot(trajectory["t_s"], values, label=called, **look)
                else:
                    _stairs(ax, trajectory["t_s"].to_numpy(), values.to_numpy(dtype=float), called, look)
            ax.grid(alpha=0.3)
            ax.set_ylabel(label)
            if ticks and label in ticks:
                ax.set_yticks(list(ticks[label].values()), list(ticks[label]))
            if len(columns) > 1:
                ax.legend(frameon=False, fontsize=8)
        above[0].set_title(title)
        above[-1].set_xlabel("t [s]")
    for row in axes:
        _widen_flat(row)
    return save_figure(figure, out, file, caption)


def _stairs(ax: "Axes", t_s: FloatArray, values: FloatArray, called: str, look: Mapping[str, Any]) -> None:
    """Draw what a controller held over each control period; its last row belongs to the end, when it acted no more.

    Args:
        ax: where to draw.
        t_s: (n,) when each period begins, and last the end [s].
        values: (n,) of each period; the last is not drawn.
        called: what the legend calls it.
        look: the line's colour and width.
    """
    x, y = np.repeat(t_s, 2)[1:-1], np.repeat(values[:-1], 2)
    faint = chatter(t_s, values)
    if faint.any():
        ax.plot(x, y, color=look["color"], linewidth=0.4, alpha=0.3)
        at = 2 * np.flatnonzero(faint) + 2
        x, y = np.insert(x, at, np.nan), np.insert(y, at, np.nan)
    ax.plot(x, y, label=called, **look)


def chatter(t_s: FloatArray, values: FloatArray) -> NDArray[np.bool_]:
    """Return (n - 2,) whether the step at the end of each control period is a jump close to one the other way.

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


def _widen_flat(row: "Sequence[Axes]") -> None:
    """Give those axes of a row whose series do not change the range of the others, or one of 1 around their value."""
    limits = {ax: ax.get_ylim() for ax in row}
    flat = [ax for ax in row if np.ptp(ax.dataLim.intervaly) < FLAT]
    others = [limits[ax] for ax in row if ax not in flat]
    for ax in flat:
        value = float(ax.dataLim.intervaly.mean())
        lows, highs = zip(*others, strict=True) if others else ([value - 0.5], [value + 0.5])
        ax.set_ylim(min(value - FLAT, *lows), max(value + FLAT, *highs))


def spells_on_the_way(
    stored: StoredResults,
    out: Path,
    *,
    file: str,
    caption: str,
    select: Select,
    column: str,
    values: Mapping[str, float],
    least_periods: int,
) -> str:
    """Return one run's path, coloured by the value of a column, and a table of its spells.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        select: which cells; the first episode is drawn.
        column: the column, such as the active agent.
        values: what each of its values is called.
        least_periods: shorter spells are drawn and left out of the table.
    """
    import pandas as pd

    row = stored.select(**select).to_dict("records")[0]
    trajectory = stored.trajectory(row)
    figure, axes = new_figure(1, 1, SIDE_INCHES, SIDE_INCHES)
    ax = axes[0, 0]
    draw_world(ax, stored.world(row["run_id"], row["episode"]))
    held = trajectory[column].to_numpy()[:-1]
    x_m, y_m = trajectory["x_m"].to_numpy(), trajectory["y_m"].to_numpy()
    for i, (called, value) in enumerate(values.items()):
        shown = np.append(held == value, False)
        shown[1:] |= shown[:-1].copy()  # each piece reaches the beginning of the next
        if shown.any():
            drawn = np.where(shown, x_m, np.nan), np.where(shown, y_m, np.nan)
            ax.plot(*drawn, color=PALETTE[i], linewidth=2.4, label=called)
    names, raw = {value: called for called, value in values.items()}, []
    for i, spell in enumerate(spells(held, least_periods)):
        at = trajectory.iloc[spell.begin]
        raw.append([i, names[spell.value], at["t_s"], at["x_m"], at["y_m"], spell.length])
    robot = describe(Robot, stored.configuration(row["run_id"])["configuration"]["robot"], "robot")
    ratio = cut(ax, [trajectory], robot.radius_m, square=False)
    figure.set_size_inches(SIDE_INCHES / max(ratio, 1.0) + WORDS_INCHES, SIDE_INCHES * min(ratio, 1.0) + WORDS_INCHES)
    draw_circle(ax, x_m[0], y_m[0], robot.radius_m)
    figure.legend(loc="outside lower center", ncols=len(values), frameon=False)
    left_m, right_m = ax.get_xlim()
    number_places(ax, [(i, x, y) for i, _, _, x, y, _ in raw if i], NEAR * (right_m - left_m), [trajectory])
    rows = [[str(i), called, number(t, 2), number(x, 2), number(y, 2), str(n)] for i, called, t, x, y, n in raw]
    frame = pd.DataFrame(raw, columns=["number", column, "t_s", "x_m", "y_m", "periods"])
    table = save_table(out, file, frame, ["", column, "from t [s]", "x [m]", "y [m]", "periods"], rows)
    return f"{save_figure(figure, out, file, caption)}\n{table}"
