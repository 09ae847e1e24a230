"""The section of a report on wheel speeds, with the spans of a state marked."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navbench.report.document import Blocks
from navbench.report.figures import PALETTE, new_figure
from navbench.report.page import Page, Select

if TYPE_CHECKING:
    import pandas as pd

ACTIVE = "#cccccc"
GAP_S = 0.5  # between two marked spans: shorter ones are not drawn, or a flickering state is a barcode


def wheel_velocities(page: Page, *, panels: Mapping[str, Select], active: str, marked: str) -> Blocks:
    """Return both wheels' speeds over time, a column an episode and a row a robot, with the spans of a state marked.

    Args:
        panels: each column's title, and one cell of one episode.
        active: the column of the trace that is not 0 in the marked spans.
        marked: what they are called.
    """
    from matplotlib.patches import Patch

    chosen = {title: page.stored.select(**select).to_dict("records") for title, select in panels.items()}
    figure, axes = new_figure(max(map(len, chosen.values())), len(panels), 5.0, 1.7, sharex="col", sharey=True)
    for column, (title, rows) in zip(axes.T, chosen.items(), strict=True):
        robot = page.robot(rows[0]["run_id"])
        for ax, row in zip(column, rows, strict=False):
            path = page.stored.trajectory(row)
            for begin_s, end_s in spans_of(path, active):
                ax.axvspan(begin_s, end_s, color=ACTIVE, linewidth=0.0, zorder=0)
            for side, color, name in ((-0.5, PALETTE[1], "left"), (0.5, PALETTE[0], "right")):
                speed = path["v_mps"] + side * robot.track_m * path["w_radps"]
                ax.step(path["t_s"], speed, where="post", color=color, linewidth=0.9, label=name)
            ax.set_ylabel(f"R{row['robot_index'] + 1} [m/s]")
            ax.grid(alpha=0.3)
        for ax in column[len(rows) :]:
            ax.set_axis_off()
        column[0].set_title(title)
        column[len(rows) - 1].set_xlabel("t [s]")
        column[len(rows) - 1].tick_params(labelbottom=True)
    handles, _ = axes[0, 0].get_legend_handles_labels()
    handles.append(Patch(color=ACTIVE, label=f"{marked} (gaps below {GAP_S:g} s closed)"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return [page.plot(figure)]


def spans_of(path: "pd.DataFrame", column: str, gap_s: float = GAP_S) -> list[tuple[float, float]]:
    """Return when a state begins and ends [s], shorter gaps closed."""
    on: NDArray[np.bool_] = path[column].fillna(0.0).to_numpy() != 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    t_s = path["t_s"].to_numpy()
    spans: list[tuple[float, float]] = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        begin_s, end_s = float(t_s[begin]), float(t_s[min(end, len(t_s) - 1)])
        if spans and begin_s - spans[-1][1] < gap_s:
            begin_s, _ = spans.pop()
        spans.append((begin_s, end_s))
    return spans
