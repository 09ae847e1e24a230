"""Sections of a report on fleets: frames of an episode, wheel speeds with the spans of avoidance, and who arrived."""

import math
import string
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.fleets import fleets
from navbench.analysis.stored import StoredResults
from navbench.mathematics.statistics import share
from navbench.report.figures import PALETTE, draw_circle, draw_world, new_figure, robot_color, save_figure
from navbench.report.markup import number, save_table
from navbench.robot import Robot
from navbench.validation import describe

if TYPE_CHECKING:
    import pandas as pd

Select = Mapping[str, Any]
WIDTH_INCHES, TITLE_INCHES = 2.5, 0.35  # of a frame
ACTIVE = "#cccccc"
GAP_S = 0.5  # between two marked spans: shorter ones are not drawn, or a flickering state is a barcode
FRAMES = 10  # where no times are given, so many, evenly from the beginning to the end


def frames(
    stored: StoredResults,
    out: Path,
    *,
    file: str,
    caption: str,
    select: Select,
    times_s: Sequence[float] = (),
    columns: int = 5,
) -> str:
    """Return an episode of a fleet in frames a), b), ...: robots with their headings and paths so far, and movers.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        select: one cell of one episode.
        times_s: when [s]; without any, ten times from the beginning to the end.
        columns: how many frames stand side by side.
    """
    rows = stored.select(**select).to_dict("records")
    trajectories = [stored.trajectory(row) for row in rows]
    world = stored.world(rows[0]["run_id"], rows[0]["episode"])
    robot = describe(Robot, stored.configuration(rows[0]["run_id"])["configuration"]["robot"], "robot")
    end_s = max(float(trajectory["t_s"].iloc[-1]) for trajectory in trajectories)
    times = list(times_s) or np.linspace(0.0, end_s, FRAMES).tolist()
    columns, b = min(columns, len(times)), world.bounds
    height = TITLE_INCHES + WIDTH_INCHES * min((b.y_max_m - b.y_min_m) / (b.x_max_m - b.x_min_m), 2.0)
    figure, axes = new_figure(-(-len(times) // columns), columns, WIDTH_INCHES, height, sharex=True, sharey=True)
    for i, (ax, t_s) in enumerate(zip(axes.ravel(), times, strict=False)):
        draw_world(ax, world, t_s)
        for trajectory, color in zip(trajectories, map(robot_color, range(len(trajectories))), strict=True):
            so_far = trajectory[trajectory["t_s"] <= t_s]
            ax.plot(so_far["x_m"], so_far["y_m"], color=color, linewidth=1.0, zorder=5)
            x, y, heading = so_far[["x_m", "y_m", "heading_rad"]].iloc[-1]
            draw_circle(ax, x, y, robot.radius_m, color)
            tip = x + 1.5 * robot.radius_m * math.cos(heading), y + 1.5 * robot.radius_m * math.sin(heading)
            ax.plot([x, tip[0]], [y, tip[1]], color="black", linewidth=1.2, zorder=7)
        ax.set(xlabel="", ylabel="")
        ax.set_title(f"{string.ascii_lowercase[i % 26]}) {t_s:.1f} s", fontsize=10)
    for ax in axes.ravel()[len(times) :]:
        ax.set_axis_off()
    for ax in axes.ravel()[len(times) - columns : len(times)]:
        ax.tick_params(labelbottom=True)  # nothing stands below these
    figure.supxlabel("x [m]", fontsize=10)
    figure.supylabel("y [m]", fontsize=10)
    return save_figure(figure, out, file, caption)


def wheel_velocities(
    stored: StoredResults, out: Path, *, file: str, caption: str, panels: Mapping[str, Select], active: str, marked: str
) -> str:
    """Return both wheels' speeds over time, a column an episode and a row a robot, with the spans of a state marked.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        caption: what the figure shows.
        panels: each column's title, and one cell of one episode.
        active: the column of the trace that is not 0 in the marked spans.
        marked: what they are called.
    """
    from matplotlib.patches import Patch

    chosen = {title: stored.select(**select).to_dict("records") for title, select in panels.items()}
    figure, axes = new_figure(max(map(len, chosen.values())), len(panels), 5.0, 1.7, sharex="col", sharey=True)
    for column, (title, rows) in zip(axes.T, chosen.items(), strict=True):
        robot = describe(Robot, stored.configuration(rows[0]["run_id"])["configuration"]["robot"], "robot")
        for ax, row in zip(column, rows, strict=False):
            trajectory = stored.trajectory(row)
            for begin_s, end_s in _spans(trajectory, active):
                ax.axvspan(begin_s, end_s, color=ACTIVE, linewidth=0.0, zorder=0)
            for side, color, name in ((-0.5, PALETTE[1], "left"), (0.5, PALETTE[0], "right")):
                speed = trajectory["v_mps"] + side * robot.track_m * trajectory["w_radps"]
                ax.step(trajectory["t_s"], speed, where="post", color=color, linewidth=0.9, label=name)
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
    return save_figure(figure, out, file, caption)


def fleet_table(
    stored: StoredResults, out: Path, *, file: str, select: Select, worlds: Mapping[str, str], labels: Sequence[str]
) -> str:
    """Return what fleets did: all robots reached, when the last one did, and who touched whom.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        select: which cells.
        worlds: each world's title and name.
        labels: which controllers.
    """
    import pandas as pd

    raw, printed = [], []
    for title, world in worlds.items():
        for label in labels:
            rows = stored.select(**select, world=world, label=label)
            table = fleets(rows)
            all_in = share(table["success"].to_numpy(dtype=bool))
            robots = share((rows["outcome"] == "reached").to_numpy())
            means = table[["makespan_s", "sum_of_times_s"]].mean()
            contacts = [int(table[name].sum()) for name in ("robot_contacts", "other_contacts", "standing_contacts")]
            timed_out = int((rows["outcome"] == "timed_out").sum())
            raw.append([title, label, *all_in, *robots, *means, *contacts, timed_out])
            shares = [f"{x.value:.3f} [{x.low:.3f}, {x.high:.3f}] of {x.n}" for x in (all_in, robots)]
            words = [number(means["makespan_s"], 1), number(means["sum_of_times_s"], 1), *map(str, contacts)]
            printed.append([title, label, *shares, *words, str(timed_out)])
    names = [
        "world",
        "label",
        *(f"{kind}{part}" for kind in ("fleets", "robots") for part in ("", "_low", "_high", "_n")),
    ]
    names += ["makespan_s", "sum_of_times_s", "robot_contacts", "other_contacts", "standing_contacts", "timed_out"]
    headers = ["", "", "all robots reached", "robots reached", "makespan [s]", "sum of times [s]"]
    headers += ["contacts of robots", "other contacts", "while standing", "timed out"]
    return save_table(out, file, pd.DataFrame(raw, columns=names), headers, printed)


def _spans(trajectory: "pd.DataFrame", column: str) -> list[tuple[float, float]]:
    """Return when a state begins and ends [s], short gaps closed."""
    on: NDArray[np.bool_] = trajectory[column].fillna(0.0).to_numpy() != 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    t_s = trajectory["t_s"].to_numpy()
    spans: list[tuple[float, float]] = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        begin_s, end_s = float(t_s[begin]), float(t_s[min(end, len(t_s) - 1)])
        if spans and begin_s - spans[-1][1] < GAP_S:
            begin_s, _ = spans.pop()
        spans.append((begin_s, end_s))
    return spans
