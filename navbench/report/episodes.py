"""The picture of one episode: what was driven in the layout that is stored, what was hit, and why, over the time."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.stored import StoredResults
from navbench.report.contacts import Touch, touch_of
from navbench.report.drawing import (
    MOVER,
    MOVER_EDGE,
    draw_goal,
    draw_obstacles,
    draw_pair,
    draw_robot,
    frame,
    mover_patch,
    patch_of,
    thinned,
)
from navbench.report.drives import BANDS, FEW, Drive, active_of, robots_of
from navbench.report.figures import COLOURS, PALETTE, robot_color
from navbench.report.paths import Word, draw_pieces, draw_stroke, together, write_beside
from navbench.report.strips import (
    STRIP_INCHES,
    draw_ranges,
    draw_trace,
    draw_velocities,
    readings_of,
    strip_height,
    trace_groups,
)
from navbench.robot import Robot
from navbench.validation import describe
from navbench.world.layout import DrawnWorld
from navbench.world.shapes import mover_tables, place_movers

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]

MAP_INCHES, MAP_HEIGHT_INCHES, LEGEND_INCHES = 6.2, (2.4, 7.0), 2.3
STEPS_S = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000)
MARKS_MAX, MARK_INCHES = 24, 0.3  # of a path, and how far apart they stand at least in the mean
NAMED_MAX = 3  # failures, in a title
NEAR_INCHES = 0.12  # numbers of marks nearer than this stand together
TITLE_LETTERS = 105  # a line
TAKEN_MAX = 2000  # points of paths that words do not cover
DOT = 1.0 / 1500.0  # of the picture's width: what a drawn path may stray


def draw_episode(
    stored: StoredResults, run_id: str, episode: int, robot: int | None = None, note: str = ""
) -> "Figure":
    """Return the picture of one episode.

    Args:
        stored: the results.
        run_id: of which cell; it keeps trajectories.
        episode: which of its episodes.
        robot: the index of the robot that is shown in front of the others, which are grey; None for all.
        note: a line more below the title.

    Raises:
        ResultsError: nothing was driven, or no trajectories are kept.
    """
    from matplotlib.figure import Figure

    cell, world = stored.configuration(run_id), stored.world(run_id, episode)
    body = describe(Robot, cell["configuration"]["robot"], "robot")
    rows = robots_of(stored, run_id, episode)
    drives = [Drive(row, stored.trajectory(row), robot_color(row["robot_index"])) for row in rows]
    shown = drives if robot is None else [drives[robot]]
    told = _told_of(shown)
    groups, recorded = trace_groups(told.path), len(readings_of(told.path)) > 0
    heights = [_map_height(world), *([STRIP_INCHES] * 2), *(strip_height(of) for of in groups.values())]
    heights += [STRIP_INCHES] * recorded
    figure = Figure(figsize=(MAP_INCHES + LEGEND_INCHES, sum(heights) + 1.0), layout="constrained")
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    ax = figure.add_subplot(grid[0])
    strips: list[Axes] = []
    for i in range(1, len(heights)):
        strips.append(figure.add_subplot(grid[i], sharex=strips[0] if strips else None))
    draw_velocities(strips[0], strips[1], shown, told)
    for strip, (title, columns) in zip(strips[2:], groups.items(), strict=not recorded):
        draw_trace(strip, told, title, columns)
    if recorded:
        draw_ranges(strips[-1], told)
    whose = f" of {told.name}" if len(shown) > 1 else ""
    units = _units(cell["configuration"]) if groups else ""
    if whose or units:
        for strip in strips[2:3]:
            strip.set_title(f"{'trace' if groups else 'ranges'}{whose}{units}", fontsize=8, loc="left")
    for strip in strips[:-1]:
        strip.tick_params(labelbottom=False)
    strips[-1].set_xlabel("t [s]")
    figure.suptitle(_title(cell, drives, shown, note), fontsize=10, x=0.01, ha="left", parse_math=False)
    _draw_map(ax, world, body.radius_m, drives, shown)
    return figure


def _units(configuration: Mapping[str, Any]) -> str:
    """Return in whose lengths and times a trace is, where they are not those of the robot that drives."""
    native = (configuration["controller"].get("native") or {}).get("robot") or configuration["robot"]
    keys = ("radius_m", "wheel_speed_max_mps")
    if all(native[key] == configuration["robot"][key] for key in keys):
        return ""
    return f", in the controller's own units: of a robot of radius {native['radius_m']:g} m"


def _told_of(shown: Sequence[Drive]) -> Drive:
    """Return the robot whose trace is shown: the first that failed, else the first."""
    failed = [drive for drive in shown if drive.row["outcome"] != "reached"]
    return (failed or list(shown))[0]


def _map_height(world: DrawnWorld) -> float:
    b, (low, high) = world.bounds, MAP_HEIGHT_INCHES
    return float(np.clip(MAP_INCHES * (b.y_max_m - b.y_min_m) / (b.x_max_m - b.x_min_m), low, high))


def _title(cell: Mapping[str, Any], drives: Sequence[Drive], shown: Sequence[Drive], note: str) -> str:
    row = drives[0].row
    first = f"{cell['label']} in {cell['world']}, episode {row['episode']}, seed {row['seed']}, {cell['simulator']}"
    if len(shown) == 1:
        only = shown[0]
        who = f"robot {only.row['robot_index']} ({only.name}) of {len(drives)} " if len(drives) > 1 else ""
        contacts = only.row.get("collisions", 0)
        held = (
            f", {contacts:.0f} contact{'s' * (contacts > 1)}"
            if contacts > 0 and only.row["outcome"] != "collided"
            else ""
        )
        told = f"{who}{only.end}{held}"
    else:
        failed = [drive for drive in shown if drive.row["outcome"] != "reached"]
        named = [textwrap.shorten(f"{drive.name} {drive.end}", TITLE_LETTERS) for drive in failed[:NAMED_MAX]]
        more = [f"and {len(failed) - NAMED_MAX} more"] if len(failed) > NAMED_MAX else []
        told = "; ".join([f"{len(shown) - len(failed)} of {len(shown)} robots reached", *named, *more])
    return "\n".join(line for one in (first, told, note) for line in textwrap.wrap(one, TITLE_LETTERS))


def _draw_map(ax: "Axes", world: DrawnWorld, radius_m: float, drives: Sequence[Drive], shown: Sequence[Drive]) -> None:
    """Draw the layout with the robots' and the movers' paths, time marks, and what was hit."""
    every = [drive.path[["x_m", "y_m"]].to_numpy() for drive in drives]
    frame(ax, world, np.concatenate(every))
    draw_obstacles(ax, world)
    width_m = float(np.ptp(ax.get_xlim()))
    end_s = max((float(drive.path["t_s"].iloc[-1]) for drive in shown if len(drive.path)), default=0.0)
    step_s = mark_step_s(end_s, float(np.median([drive.length_m for drive in shown])) * MAP_INCHES / width_m)
    marks_s = [float(step_s * i) for i in range(1, int(end_s / step_s) + 1)]
    _draw_movers(ax, world, marks_s, end_s, len(shown) <= FEW)
    words: list[Word] = []
    for drive in drives:
        if not any(drive is one for one in shown):
            ax.plot(drive.path["x_m"], drive.path["y_m"], color="0.75", linewidth=0.8, zorder=3)
    for drive in shown:
        _draw_goal(ax, world, drive)
    names = _draw_behaviors(ax, shown)
    for drive in shown:
        words += _draw_drive(ax, drive, world, radius_m, marks_s, width_m, len(shown))
    touches = [touch_of(world, drive.row, [one.path for one in drives], radius_m) for drive in shown]
    words = _draw_touches(ax, [touch for touch in touches if touch is not None]) + words
    _explain(ax, shown, step_s if len(marks_s) else 0, names, bool(world.movers))
    few = 1 + sum(len(drive.path) for drive in shown) // TAKEN_MAX
    write_beside(ax, words, [drive.path.iloc[::few] for drive in shown], radius_m)


def mark_step_s(end_s: float, inches: float) -> int:
    """Return the time between two marks of a path: 1 s, or more where they would crowd.

    Args:
        end_s: when the path ends [s].
        inches: how long it is on paper.
    """
    most = min(MARKS_MAX, max(3.0, inches / MARK_INCHES))
    return next((step for step in STEPS_S if end_s // step <= most), STEPS_S[-1])


def _draw_movers(ax: "Axes", world: DrawnWorld, marks_s: Sequence[float], end_s: float, numbered: bool) -> None:
    """Draw the movers' paths up to the end, where they are then, and in outline where they are at the time marks."""
    if not world.movers:
        return
    tables, rows = mover_tables(world.movers), np.zeros((len(world.movers), 5))

    def places(t_s: float) -> FloatArray:
        place_movers(t_s, *tables, rows)
        return rows[:, :2].copy()

    driven = np.stack([places(t_s) for t_s in np.linspace(0.0, end_s, 400)])
    for i, mover in enumerate(world.movers):
        ax.plot(*driven[:, i].T, "--", color=MOVER, linewidth=0.9, zorder=1)
        ax.add_patch(mover_patch(mover, *driven[-1, i], facecolor=MOVER, edgecolor=MOVER_EDGE, alpha=0.8))
        ax.annotate(str(i), driven[-1, i], ha="center", va="center", fontsize=8, color="white", zorder=9)
    for t_s in marks_s:
        for mover, place in zip(world.movers, places(t_s), strict=True):
            ax.add_patch(mover_patch(mover, *place, fill=False, edgecolor=MOVER, linewidth=0.6, zorder=1))
            if numbered:
                at: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 6, "color": MOVER_EDGE}
                ax.annotate(f"{t_s:g}", place, zorder=2, **at)


def _draw_goal(ax: "Axes", world: DrawnWorld, drive: Drive) -> None:
    """Draw a robot's goal, joined with its start."""
    index = drive.row["robot_index"]
    start, goal = world.starts[index], world.goals[index]
    draw_goal(ax, goal, world.goal_tolerance_m, drive.color)
    draw_pair(ax, start, goal, drive.color)


def _draw_behaviors(ax: "Axes", shown: Sequence[Drive]) -> dict[str, str]:
    """Draw a band along each path in the colour of the active behaviour, and return the behaviours' colours."""
    found: dict[str, str] = {}
    for drive in (drive for drive in shown if len(drive.path)):
        active = active_of(drive.path)
        for name in active:
            found.setdefault(name, BANDS[len(found) % len(BANDS)])
        draw_pieces(ax, drive.path, active, 7.0, 3.5, [found[name] for name in active])
    return found


def _draw_drive(
    ax: "Axes", drive: Drive, world: DrawnWorld, radius_m: float, marks_s: Sequence[float], width_m: float, robots: int
) -> list[Word]:
    """Draw a robot's path with its start and its time marks, and return the words that belong to it."""
    start = world.starts[drive.row["robot_index"]]
    path = drive.path
    if path.empty:  # what raised before the first period
        heading_rad = world.start_heading_rad(drive.row["robot_index"])
        draw_robot(ax, (start.x_m, start.y_m, heading_rad), radius_m, drive.color)
        return [Word((start.x_m, start.y_m), drive.name, drive.color)]
    poses = path[["x_m", "y_m", "heading_rad"]].to_numpy()
    ax.plot(*thinned(poses[:, :2], DOT * width_m).T, color=drive.color, linewidth=1.6 if robots < 10 else 1.0, zorder=5)
    draw_robot(ax, poses[0], radius_m, drive.color, 0.03 * width_m)
    end_s = float(path["t_s"].iloc[-1])
    numbered: list[tuple[int, float, float]] = []
    for t_s in (t_s for t_s in marks_s if t_s < end_s):
        x_m, y_m, heading_rad = poses[int(np.searchsorted(path["t_s"], t_s - 1e-9))]
        if robots <= FEW:
            draw_stroke(ax, x_m, y_m, heading_rad, drive.color)
            numbered.append((int(t_s), x_m, y_m))
        else:
            ax.plot(x_m, y_m, ".", color=drive.color, markersize=3.0, zorder=6)
    ax.plot(*poses[-1, :2], "o" if drive.row["outcome"] == "reached" else "X", zorder=9, markersize=5.0,
            color=COLOURS[str(drive.row["outcome"])])  # fmt: skip
    draw_robot(ax, poses[-1], radius_m, drive.color)
    return [
        Word(tuple(poses[0, :2].tolist()), drive.name, drive.color),
        *together(numbered, NEAR_INCHES / MAP_INCHES * width_m, drive.color),
    ]


def _draw_touches(ax: "Axes", touches: Sequence[Touch]) -> list[Word]:
    """Mark where robots hit something, and what it is, and return its names."""
    words: dict[str, Word] = {}
    for touch in touches:
        color = COLOURS["collided"]
        ax.add_patch(patch_of(touch.thing, fill=False, edgecolor=color, linewidth=1.6, zorder=8))
        ax.plot(*touch.place, "*", color=color, markeredgecolor="white", markersize=11, zorder=20)
        words.setdefault(touch.name, Word(touch.place, touch.name, color))
    return list(words.values()) if len(touches) <= FEW else []


def _explain(ax: "Axes", shown: Sequence[Drive], step_s: int, behaviors: Mapping[str, str], movers: bool) -> None:
    """Write the legend of the map to its right."""
    from matplotlib.lines import Line2D

    look: dict[str, dict[str, Any]] = {}
    for drive in shown[: len(PALETTE)]:
        look[drive.name] = {"color": drive.color, "linewidth": 1.6}
    if len(shown) > len(PALETTE):
        look[f"... to {shown[-1].name}"] = {"linestyle": "none"}
    look["start to goal"] = {"color": "0.4", "linestyle": ":"}
    if step_s:
        look[f"time marks every {step_s} s"] = {"color": "0.4", "marker": "|", "linestyle": "none", "markersize": 9}
    look |= {f"{name} active": {"color": color, "linewidth": 7.0} for name, color in behaviors.items()}
    if movers:
        look["mover, where it is at the end"] = {"color": MOVER, "marker": "o", "linestyle": "none"}
        look["mover at the time marks"] = {
            "color": MOVER, "marker": "o", "linestyle": "--", "markerfacecolor": "none", "linewidth": 0.9
        }  # fmt: skip
    if any(drive.row["outcome"] == "collided" for drive in shown):
        look["contact"] = {"color": COLOURS["collided"], "marker": "*", "linestyle": "none", "markersize": 10}
    for outcome in dict.fromkeys(str(drive.row["outcome"]) for drive in shown):
        mark = "o" if outcome == "reached" else "X"
        look[outcome.replace("_", " ")] = {"color": COLOURS[outcome], "marker": mark, "linestyle": "none"}
    handles = [Line2D([], [], **{"label": label, **style}) for label, style in look.items()]
    ax.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=8)
