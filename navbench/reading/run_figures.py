"""Sections of a report that draw what a controller left in its trace: over time, and along the way."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from navbench.descriptions.description import describe
from navbench.descriptions.robot import Robot
from navbench.reading.figures import draw_circle, draw_world, new_figure, robot_color, save_figure
from navbench.reading.markup import number, save_table
from navbench.reading.stored import Reading
from navbench.reading.study_figures import cut, number_places
from navbench.reading.trace_measures import spells

Select = Mapping[str, Any]
NEAR = 0.03  # of a picture's width: numbers of places nearer to each other stand together
PLACES = ("x_m", "y_m")
FLAT = 1e-6  # values that differ by less are drawn as one, not as their rounding errors


def time_series(
    reading: Reading,
    out: Path,
    *,
    file: str,
    caption: str,
    panels: Mapping[str, Select],
    series: Mapping[str, Mapping[str, str]],
    ticks: Mapping[str, Mapping[str, float]] | None = None,
) -> str:
    """Return columns of a trajectory over time: a row for each axis, a column for each run.

    Places are drawn through to the end; what holds for a control period is drawn in steps.

    Args:
        reading: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        panels: each run's title, and which cells; the first episode of them is drawn.
        series: each axis's title, such as "mu [degrees]", and the columns that it shows with what each is called;
            columns in radians are drawn in degrees.
        ticks: for some axes what their values are called.
    """
    figure, axes = new_figure(len(series), len(panels), 3.6 if len(panels) > 1 else 7.0, 1.8, sharex="col")
    for above, (title, select) in zip(axes.T, panels.items(), strict=True):
        whole = reading.way(reading.select(**select).to_dict("records")[0])
        for ax, (label, columns) in zip(above, series.items(), strict=True):
            for i, (column, called) in enumerate(columns.items()):
                way = whole if column in PLACES else whole.iloc[:-1]
                values = np.degrees(way[column]) if column.endswith("_rad") else way[column]
                stairs = "default" if column in PLACES else "steps-post"
                width = 0.9 + 0.5 * (len(columns) - 1 - i)  # where lines coincide, the lower ones look out
                ax.plot(way["t_s"], values, drawstyle=stairs, color=robot_color(i), linewidth=width, label=called)
            low, high = ax.get_ylim()
            if high - low < FLAT:
                ax.set_ylim(0.5 * (low + high) - 0.5, 0.5 * (low + high) + 0.5)
            ax.grid(alpha=0.3)
            ax.set_ylabel(label)
            named = (ticks or {}).get(label)
            if named:
                ax.set_yticks(list(named.values()), list(named))
            if len(columns) > 1:
                ax.legend(frameon=False, fontsize=8)
        above[0].set_title(title)
        above[-1].set_xlabel("t [s]")
    return save_figure(figure, out, file, caption)


def spells_on_the_way(
    reading: Reading,
    out: Path,
    *,
    file: str,
    caption: str,
    select: Select,
    column: str,
    values: Mapping[str, float],
    least_periods: int,
) -> str:
    """Return one run's way, coloured by the value of a column, and a table of its spells.

    Args:
        reading: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        select: which cells; the first episode is drawn.
        column: the column, such as the active agent.
        values: what each of its values is called.
        least_periods: shorter spells are drawn and left out of the table.
    """
    import pandas as pd

    row = reading.select(**select).to_dict("records")[0]
    way = reading.way(row)
    figure, axes = new_figure(1, 1, 6.0, 5.0)
    ax = axes[0, 0]
    draw_world(ax, reading.world(row["run_id"], row["episode"]))
    held = way[column].to_numpy()[:-1]
    x_m, y_m = way["x_m"].to_numpy(), way["y_m"].to_numpy()
    for i, (called, value) in enumerate(values.items()):
        shown = np.append(held == value, False)
        shown[1:] |= shown[:-1].copy()  # each piece reaches the beginning of the next
        if shown.any():
            drawn = [np.where(shown, along, np.nan) for along in (x_m, y_m)]
            ax.plot(*drawn, color=robot_color(i), linewidth=1.8, label=called)
    names, raw = {value: called for called, value in values.items()}, []
    for i, spell in enumerate(spells(held, least_periods)):
        at = way.iloc[spell.begin]
        raw.append([i, names[spell.value], at["t_s"], at["x_m"], at["y_m"], spell.length])
    robot = describe(Robot, reading.configuration(row["run_id"])["configuration"]["robot"], "robot")
    cut(ax, [way], robot.radius_m, square=False)
    left_m, right_m = ax.get_xlim()
    low_m, high_m = ax.get_ylim()
    figure.set_size_inches(6.0, max(5.0 * (high_m - low_m) / (right_m - left_m), 1.2) + 1.3)
    number_places(ax, [(i, x, y) for i, _, _, x, y, _ in raw if i], NEAR * (right_m - left_m), (4.0, 7.0))
    draw_circle(ax, x_m[0], y_m[0], robot.radius_m)
    figure.legend(loc="outside lower center", ncols=len(values), frameon=False)
    rows = [[str(i), called, number(t, 2), number(x, 2), number(y, 2), str(n)] for i, called, t, x, y, n in raw]
    frame = pd.DataFrame(raw, columns=["number", column, "t_s", "x_m", "y_m", "periods"])
    table = save_table(out, file, frame, ["", column, "from t [s]", "x [m]", "y [m]", "periods"], rows)
    return f"{save_figure(figure, out, file, caption)}\n{table}"
