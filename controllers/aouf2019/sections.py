"""The sections of aouf2019's report: its vectors, phases of its arbitration, speeds, control surface, speed sweeps."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.stored import reached
from navbench.contract import Pose
from navbench.controllers.aouf2019.behaviors import FOLLOW_WALL
from navbench.controllers.aouf2019.equations import (
    Vector,
    avoidance_vector,
    blend,
    distance_error,
    following_vector,
    frame,
    goal_vector,
    heading_error,
    heading_of,
    perpendicular_to_wall,
    points_seen,
    unit,
    wall_points,
    wall_vector,
)
from navbench.controllers.aouf2019.measures import phases_of
from navbench.report.bodies import draw_body
from navbench.report.claims import printed_figures
from navbench.report.comparison import compared
from navbench.report.document import Blocks, Column
from navbench.report.drawing import draw_robot, draw_world
from navbench.report.figures import PALETTE, label_legend, nested_width, new_figure
from navbench.report.page import Page, Select
from navbench.report.paths import cut, draw_pieces, number_places
from navbench.sensors import Sensors
from navbench.simulation.options import SimulatorOptions
from navbench.simulation.planar import PlanarSimulator
from navbench.validation import describe

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]
MARKERS = ("o", "s", "^", "D")
NEAR_M = 0.12  # phases that came about nearer to each other than this share their number's place
SWEPT = "#444444"
AROUND_M, UNIT_M = 0.34, 0.15  # what a picture of vectors shows to each side, and how long it draws a direction
INSTANTS = (
    Column("t", "t_s", "s", 2),
    Column("behaviour", "behavior"),
    Column("vector", "vector"),
    Column("heading error by eqs 7 to 24", "heading_error_deg", "degrees", 3),
    Column("as the run noted it", "traced_deg", "degrees", 3),
)
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


def vectors(page: Page, *, select: Select, approach_s: float, follow_s: float) -> Blocks:
    """Return the paper's Figs 1 to 9: the robot, and at two instants of a run what its equations make of its readings.

    Args:
        select: one cell of one episode.
        approach_s: a control period on the way to the goal with something in reach [s]; the nearest on that way.
        follow_s: one along a wall, likewise [s].
    """
    row = page.first(select)
    entry = page.stored.configuration(row["run_id"])["configuration"]
    told, path = entry["controller"]["build"]["behaviors"], page.stored.trajectory(row)
    world, robot = page.stored.world(row["run_id"], row["episode"]), page.robot(row["run_id"])
    sensors = describe(Sensors, entry["sensors"], "sensors").scaled_to(robot.radius_m)
    mounts = np.array([frame(mount.x_m, mount.y_m, mount.heading_rad) for mount in sensors.mounts])
    weights = np.array([told["sensor_weights"][mount.role] for mount in sensors.mounts])
    figure, axes = new_figure(3, 3, 3.3, 3.2)
    first, *rest = axes.ravel()
    draw_body(first, robot.radius_m, robot.track_m)
    half = 0.5 * robot.track_m
    for wheel, y in (("V_L", half), ("V_R", -half)):
        _arrow(first, (0.0, y), (0.9 * robot.radius_m, 0.0), PALETTE[0], wheel)
    first.annotate("", (-0.05, half), (-0.05, -half), arrowprops={"arrowstyle": "<->", "color": PALETTE[1]})
    first.text(-0.045, 0.0, "L", color=PALETTE[1], va="center")
    first.set_title("Fig 1: the robot", fontsize=9)
    rows = []
    follows = path["behavior"] == FOLLOW_WALL
    for t_s, panels, there in ((approach_s, rest[:5], path[~follows]), (follow_s, rest[5:], path[follows])):
        if there.empty:  # in a reconstruction, say
            for ax in panels:
                ax.axis("off")
            continue
        now = there.iloc[int((there["t_s"] - t_s).abs().argmin())]
        u_p = float(now["x_m"]), float(now["y_m"])
        pose = Pose(*u_p, float(now["heading_rad"]))
        with PlanarSimulator(SimulatorOptions(), robot, sensors, None) as simulator:
            simulator.reset(world, [pose], world.goal_tolerance_m)
            ranges_m = simulator.ranges()[0]
        points = _points(mounts, ranges_m, (*u_p, pose.heading_rad))
        for ax in panels:
            draw_world(ax, world)
            draw_robot(ax, (*u_p, pose.heading_rad), robot.radius_m, "black")
            ax.set(xlim=(u_p[0] - AROUND_M, u_p[0] + AROUND_M), ylim=(u_p[1] - AROUND_M, u_p[1] + AROUND_M))
        if now["behavior"] == FOLLOW_WALL:
            ends = wall_points(points, ranges_m, float(now["side"]))
            u = _draw_following(panels, u_p, ends, told["wall_distance_m"])
        else:
            goal = world.goals[row["robot_index"]]
            u_ao, u_gtg = avoidance_vector(points, weights, u_p), goal_vector((goal.x_m, goal.y_m), u_p)
            seen = ranges_m < sensors.max_range_m
            u = _draw_approach(panels, u_p, points, mounts, pose.heading_rad, seen, (u_ao, u_gtg), told["blend_alpha"])
        made = math.degrees(heading_error(heading_of(u), pose.heading_rad))
        word, called = ("follow wall", "u_fw") if now["behavior"] == FOLLOW_WALL else ("go to goal", "u_ao_gtg")
        rows.append([float(now["t_s"]), word, called, made, math.degrees(now["heading_error_rad"])])
    return [page.plot(figure), page.table(INSTANTS, rows)]


def _points(mounts: FloatArray, ranges_m: FloatArray, pose: tuple[float, float, float]) -> FloatArray:
    points = np.empty((len(mounts), 2))
    points_seen(mounts.ravel(), ranges_m, pose, points)
    return points


def _draw_approach(
    panels: "Sequence[Axes]",
    u_p: Vector,
    points: FloatArray,
    mounts: FloatArray,
    heading_rad: float,
    seen: NDArray[np.bool_],
    made: tuple[Vector, Vector],
    alpha: float,
) -> Vector:
    """Draw Figs 2 to 6, the points seen to the blend, and return u_ao_gtg."""
    (u_ao, u_gtg), (rays, to_points, avoid, to_goal, blended) = made, panels
    for i, (point, mount) in enumerate(zip(points, mounts, strict=True), 1):
        color = PALETTE[0] if seen[i - 1] else "0.6"
        begin = _points(mount[None], np.zeros(1), (*u_p, heading_rad))[0]
        rays.plot([begin[0], point[0]], [begin[1], point[1]], color=color, linewidth=1.2, zorder=6)
        rays.plot(*point, "o", color=color, markersize=3.5, zorder=7)
        rays.annotate(f"P{i}", point, (4.0, 4.0), textcoords="offset points", fontsize=7, color=color)
        _arrow(to_points, u_p, (point[0] - u_p[0], point[1] - u_p[1]), color, f"u{i}")
    u, g, a = blend(u_gtg, u_ao, alpha), unit(u_gtg), unit(u_ao)
    _arrow(avoid, u_p, _long(a), PALETTE[1], "u_ao")
    _arrow(to_goal, u_p, _long(g), PALETTE[2], "u_gtg")
    for vector, color, called in ((a, PALETTE[1], "u_ao"), (g, PALETTE[2], "u_gtg"), (unit(u), PALETTE[4], "u_ao_gtg")):
        _arrow(blended, u_p, _long(vector), color, called)
    titles = ("points P_i, eqs 7 to 10", "vectors u_i", "u_ao, eq. 11", "u_gtg, eq. 13", "u_ao_gtg, eq. 14")
    for i, (ax, title) in enumerate(zip(panels, titles, strict=True), 2):
        ax.set_title(f"Fig {i}: {title}", fontsize=9)
    return u


def _draw_following(panels: "Sequence[Axes]", u_p: Vector, ends: tuple[Vector, Vector], d_fw: float) -> Vector:
    """Draw Figs 7 to 9, along the wall, to it, and both together, and return u_fw."""
    (p_1, p_2), (along, across, both) = ends, panels
    along_wall = wall_vector(p_1, p_2)
    t = unit(along_wall)
    u_fw_p = perpendicular_to_wall(p_1, u_p, t)
    error = distance_error(u_fw_p, d_fw)
    u = following_vector(t, error, d_fw)
    for called, place in (("P1", p_1), ("P2", p_2)):
        along.plot(*place, "o", color="black", markersize=3.5, zorder=7)
        along.annotate(called, place, (-16.0, 6.0), textcoords="offset points", fontsize=7)
    _arrow(along, p_1, along_wall, PALETTE[0], "u_fw,t")
    _arrow(across, u_p, u_fw_p, PALETTE[1], "u_fw,p")
    _arrow(both, u_p, error, PALETTE[2], "u'_fw,p")
    _arrow(both, u_p, u, PALETTE[4], "u_fw")
    titles = ("u_fw,t, eq. 17", "u_fw,p, eq. 20", "u'_fw,p and u_fw, eqs 21, 22")
    for i, (ax, title) in enumerate(zip(panels, titles, strict=True), 7):
        ax.set_title(f"Fig {i}: {title}", fontsize=9)
    return u


def _long(direction: Vector) -> Vector:
    return UNIT_M * direction[0], UNIT_M * direction[1]


def _arrow(ax: "Axes", begin: Vector, vector: Vector, color: str, called: str) -> None:
    """Draw a vector from a place, with its name at its tip."""
    tip = begin[0] + vector[0], begin[1] + vector[1]
    look = {"arrowstyle": "-|>", "color": color, "linewidth": 1.6, "shrinkA": 0.0, "shrinkB": 0.0}
    ax.annotate("", tip, begin, arrowprops=look, zorder=8)
    along = unit(vector)
    away = 10.0 * along[0], 10.0 * along[1]
    ax.annotate(called, tip, away, textcoords="offset points", ha="center", va="center", fontsize=8, color=color)


def abbreviations(page: Page, *, table: str, printed: Mapping[str, str]) -> Blocks:
    """Return the paper's Table 1: what it calls its sets, beside the variables that have them here.

    Args:
        table: the name of the described table of memberships.
        printed: what the paper prints of each abbreviation.
    """
    sets = page.stored.described(table)
    having = {str(term): ", ".join(dict.fromkeys(of["variable"])) for term, of in sets.groupby("term", sort=False)}
    terms = dict.fromkeys([*printed, *having])
    rows = [[term, printed.get(term, "–"), having.get(term, "–").replace("_", " ")] for term in terms]
    return [page.table([Column("abbreviation"), Column("printed"), Column("variables here")], rows)]


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
