"""The section of a report on wheel speeds, with a state shaded by how much of the time it holds."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navbench.report.document import Blocks, Cell, Column
from navbench.report.figures import PALETTE, new_figure
from navbench.report.page import Page, Select

if TYPE_CHECKING:
    import pandas as pd

ACTIVE, DARKEST = "#666666", 0.5
BIN_S = 1.0  # of the shading: a state that comes and goes several times a second would be a solid block or a barcode
ROWS = (
    Column("", "episode"),
    Column("robot", "robot"),
    Column("active", "share", "%", 0),
    Column("begins", "begins", "times"),
    Column("begins", "rate", "1/s", 1),
)


def wheel_velocities(page: Page, *, panels: Mapping[str, Select], active: str, marked: str) -> Blocks:
    """Return both wheels' speeds over time, a column an episode and a row a robot, with a state shaded.

    The shade tells which share of each second the state holds, and a table how often it begins.

    Args:
        panels: each column's title, and one cell of one episode.
        active: the column of the trace that is not 0 where the state holds.
        marked: what it is called.
    """
    from matplotlib.patches import Patch

    chosen = {title: page.stored.select(**select).to_dict("records") for title, select in panels.items()}
    figure, axes = new_figure(max(map(len, chosen.values())), len(panels), 5.0, 1.7, sharex="col", sharey=True)
    counted: list[list[Cell]] = []
    for column, (title, rows) in zip(axes.T, chosen.items(), strict=True):
        robot = page.robot(rows[0]["run_id"])
        for ax, row in zip(column, rows, strict=False):
            path = page.stored.trajectory(row)
            spans, end_s = spans_of(path, active), float(path["t_s"].iloc[-1])
            for begin_s, share in shares_of(spans, end_s).items():
                shade = {"color": ACTIVE, "alpha": DARKEST * share, "linewidth": 0.0, "zorder": 0}
                ax.axvspan(begin_s, min(begin_s + BIN_S, end_s), **shade)
            held_s = sum(end - begin for begin, end in spans)
            robot_name = f"R{row['robot_index'] + 1}"
            counted.append([title, robot_name, 100.0 * held_s / end_s, len(spans), len(spans) / end_s])
            for side, color, name in ((-0.5, PALETTE[1], "left"), (0.5, PALETTE[0], "right")):
                speed = path["v_mps"] + side * robot.track_m * path["w_radps"]
                ax.step(path["t_s"], speed, where="post", color=color, linewidth=0.9, label=name)
            ax.set_ylabel(f"{robot_name} [m/s]")
            ax.grid(alpha=0.3)
        for ax in column[len(rows) :]:
            ax.set_axis_off()
        column[0].set_title(title)
        column[len(rows) - 1].set_xlabel("t [s]")
        column[len(rows) - 1].tick_params(labelbottom=True)
    handles, _ = axes[0, 0].get_legend_handles_labels()
    handles.append(Patch(color=ACTIVE, alpha=DARKEST, label=f"{marked} (the darker, the more of each second)"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return [page.plot(figure), page.table(ROWS, counted)]


def shares_of(spans: Sequence[tuple[float, float]], end_s: float) -> dict[float, float]:
    """Return, by when each second begins [s], which share of it lies in some spans; seconds with none are left out."""
    found: dict[float, float] = {}
    for begin_s in np.arange(0.0, end_s, BIN_S).tolist():
        until_s = min(begin_s + BIN_S, end_s)
        held_s = sum(max(0.0, min(end, until_s) - max(begin, begin_s)) for begin, end in spans)
        if held_s > 0.0:
            found[begin_s] = held_s / (until_s - begin_s)
    return found


def spans_of(path: "pd.DataFrame", column: str) -> list[tuple[float, float]]:
    """Return when a state begins and ends [s]."""
    on: NDArray[np.bool_] = path[column].fillna(0.0).to_numpy() != 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    t_s = path["t_s"].to_numpy()
    return [
        (float(t_s[begin]), float(t_s[min(end, len(t_s) - 1)]))
        for begin, end in zip(edges[::2], edges[1::2], strict=True)
    ]
