"""Figures of stored results: trajectories over their world; and how a figure is saved."""

import io
import re
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.stored import StoredResults, driven, reached
from navbench.experiments.files import inside, replacing
from navbench.experiments.store import Results
from navbench.report.drawing import draw_circle, draw_world, frame, sparse
from navbench.robot import Robot
from navbench.validation import describe
from navbench.world.layout import DrawnWorld

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]
Panel: TypeAlias = "tuple[dict[str, Any], DrawnWorld | None, pd.DataFrame, pd.DataFrame]"

warnings.filterwarnings("ignore", "Glyph")  # missing from a font, which Matplotlib says with the character as it is

COLOURS = {
    "reached": "#1b7f5a",
    "collided": "#c1121f",
    "timed_out": "#b5651d",
    "controller_error": "#6a0dad",
    "no_layout": "#7f7f7f",
    "impossible": "#b0b0b0",
}
LABELS = {name: name.replace("_", " ") for name in COLOURS}
PATH = ("x_m", "y_m")  # what is drawn of a trajectory
COLUMNS = 3  # of panels
LINES_MAX = 200  # more paths than this in a panel make a blot, not a picture
COLUMNS_MAX = 1000  # pixels of a panel, more than it has: two points in one are drawn as one
PALETTE = (  # Okabe and Ito's, for the colour-blind too, and two of Tol's; neighbours differ in hue and in lightness
    "#d55e00",
    "#0072b2",
    "#009e73",
    "#444444",
    "#cc79a7",
    "#e69f00",
    "#56b4e9",
    "#882255",
    "#999933",
)
MARKERS = "osD^vP*<p"
METADATA: dict[str, dict[str, str | None]] = {  # what would differ from one time to the next
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
}
ROW_INCHES, TITLE_INCHES = 5.6, 0.3  # of panels with what stands around them, and above all panels
STACK_INCHES = 10.0  # how wide a picture of blocks is
DPI = 110  # of a PNG; an SVG has its own
CLIPS = re.compile(rb'(?<=[#"])p[0-9a-f]{10}(?=[)"])')  # names of clip paths in an SVG


class Style(NamedTuple):
    """How one label is drawn in every figure of a report."""

    color: str
    marker: str


def styles(labels: Iterable[str]) -> dict[str, Style]:
    """Return a style for each label, in their order.

    The first label shares its colour with none; the others take turns with the rest of the palette, each turn with
    other marks.
    """
    first, *rest = PALETTE
    found: dict[str, Style] = {}
    for i, label in enumerate(dict.fromkeys(labels)):
        turn, place = divmod(i - 1, len(rest))
        found[label] = Style(rest[place] if i else first, MARKERS[(i + 2 * turn) % len(MARKERS) if i else 0])
    return found


def nested_width(rank: int, count: int) -> float:
    """Return a line's width [points]: later ones are narrower and lie on top, so that lines that coincide all show.

    Args:
        rank: of the line, the lowest 0.
        count: how many lines there are.
    """
    return 1.2 + 1.1 * (count - 1 - rank)


def robot_color(index: int) -> str:
    """Return the colour of one of a fleet's robots."""
    return PALETTE[index % len(PALETTE)]


def new_figure(rows: int, columns: int, width: float, height: float, **shared: Any) -> "tuple[Figure, Any]":
    """Return a figure and its (rows, columns) axes, each so wide and high [inches]."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width * columns, height * rows + 0.5), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


class Block(NamedTuple):
    """Some panels of a picture, side by side and below each other, under a title.

    Attributes:
        title: above them.
        panels: what draws each of them.
        columns: how many stand side by side.
        height: of each [inches].
    """

    title: str
    panels: "Sequence[Callable[[Axes], None]]"
    columns: int
    height: float


def stacked(title: str, blocks: Sequence[Block]) -> "Figure":
    """Return a picture of blocks below each other."""
    from matplotlib.figure import Figure

    rows = [-(-len(block.panels) // block.columns) for block in blocks]
    heights = [block.height * count + 0.3 for block, count in zip(blocks, rows, strict=True)]
    figure = Figure(figsize=(STACK_INCHES, sum(heights) + 0.4), layout="constrained")
    figure.suptitle(title, fontsize=11)
    parts = figure.subfigures(len(blocks), 1, height_ratios=heights, squeeze=False).ravel()
    for part, block, count in zip(parts, blocks, rows, strict=True):
        part.suptitle(block.title, fontsize=10)
        axes = part.subplots(count, block.columns, squeeze=False).ravel()
        for ax, draw in zip(axes, block.panels, strict=False):
            draw(ax)
        for ax in axes[len(block.panels) :]:
            ax.set_axis_off()
    return figure


def label_legend(
    figure: "Figure", style: Mapping[str, Style], labels: Sequence[str], widths: Sequence[float], columns: int = 99
) -> None:
    """Explain below a figure which line is whose.

    Args:
        figure: the figure.
        style: how each label is drawn.
        labels: the labels.
        widths: of their lines [points].
        columns: how many stand side by side at most.
    """
    from matplotlib.lines import Line2D

    lines = [
        Line2D([], [], color=style[label].color, linewidth=width, label=label)
        for label, width in zip(labels, widths, strict=True)
    ]
    count = min(len(labels), columns)
    figure.legend(handles=lines, loc="outside lower center", ncols=count, frameon=False, handlelength=4.0)


def save_figure(figure: "Figure", out: Path, stem: str) -> None:
    """Save a figure below ``figures/`` as PNG and SVG, the same bytes for the same figure.

    Args:
        figure: the figure.
        out: the report's directory.
        stem: the files' name without its ending.
    """
    for form in ("png", "svg"):
        save_whole(figure, inside(out, f"figures/{stem}.{form}"))


def panel_of(stored: StoredResults, run: str, episodes: "pd.DataFrame") -> "Panel":
    """Return what is drawn of a run: its entry in the manifest, what stands in all its episodes, and how they went.

    Raises:
        ResultsError: it keeps no trajectories.
    """
    return stored.configuration(run), stored.world_in_common(run), episodes, stored.results.trajectories(run, PATH)


def draw_cells(panels: "Sequence[Panel | None]", title: str = "") -> "Figure":
    """Return a figure with a panel per cell, in margins of one size: nothing need be measured to lay it out.

    Args:
        panels: what is drawn of each cell; the place of a None stays empty.
        title: what stands above all panels.
    """
    from matplotlib.figure import Figure

    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    top = 0.7 + TITLE_INCHES * bool(title)
    width, height = 5.2 * columns, ROW_INCHES * rows + top - 0.7
    figure = Figure(figsize=(width, height))
    figure.subplots_adjust(0.7 / width, 0.8 / height, 1.0 - 0.2 / width, 1.0 - top / height, 0.9 / 4.3, 1.5 / 4.1)
    figure.suptitle(title, y=1.0 - 0.08 / height, fontsize=12)
    for place, panel in enumerate(panels, 1):
        if panel is not None:
            draw_cell(figure.add_subplot(rows, columns, place), *panel)
    return figure


def draw_cell(
    ax: "Axes",
    cell: dict[str, Any],
    world: DrawnWorld | None,
    episodes: "pd.DataFrame",
    trajectories: "pd.DataFrame",
) -> None:
    """Draw a world with the paths of all episodes, or an even sample that the title tells of, coloured by outcome.

    Args:
        ax: where to draw.
        cell: the cell's entry in the manifest.
        world: what stands in all its episodes; None where no layout could be drawn.
        episodes: its rows of the table of episodes.
        trajectories: its rows of the table of trajectories.
    """
    robot = describe(Robot, cell["configuration"]["robot"], "robot")
    if world is not None:
        draw_world(ax, world)
    outcomes = episodes.set_index(["episode", "robot_index"])["outcome"].to_dict()
    trajectories = trajectories[trajectories["episode"].isin(episodes["episode"])]  # others may have ended meanwhile
    sample, seen_m = _draw_paths(ax, trajectories, outcomes, robot.radius_m)
    if world is not None:
        frame(ax, world, seen_m)
    for start in () if world is None else world.starts:
        draw_circle(ax, start.x_m, start.y_m, robot.radius_m)
    seen = [name for name in COLOURS if name in set(outcomes.values())]
    handles = [
        ax.plot([], [], color=COLOURS[name], label=f"{LABELS[name]}: {_count(outcomes, name)}")[0] for name in seen
    ]
    ax.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), borderaxespad=3.4, ncols=4, frameon=False)
    name = cell["name"] if cell["name"].startswith(cell["world"]) else cell["world"]  # of a sweep's, with what differs
    several = len({*episodes["layout_id"]} - {""}) > 1
    sample += "\nwhat differs between its layouts is not drawn" * several
    ax.set_title(f"{cell['label']} in {name}" + _numbers(driven(episodes)) + sample, wrap=True, y=1.0)


def _draw_paths(
    ax: "Axes", trajectories: "pd.DataFrame", outcomes: Mapping[Any, str], radius_m: float
) -> tuple[str, FloatArray]:
    """Draw paths and where they end.

    Returns:
        What a title says where they are only a sample, and their places (n, 2) [m].
    """
    from matplotlib.collections import EllipseCollection, LineCollection

    keys = trajectories[["episode", "robot_index"]].to_numpy()
    begins = np.flatnonzero(np.diff(keys, axis=0, prepend=-1).any(axis=1))
    paths = np.split(trajectories[["x_m", "y_m"]].to_numpy(), begins[1:])
    shown = range(0, len(begins), -(-len(begins) // LINES_MAX) or 1)  # of a world without a layout there are none
    colours = [COLOURS[outcomes[tuple(keys[begins[i]])]] for i in shown]
    lines = [sparse(paths[i], float(np.ptp(ax.get_xlim())) / COLUMNS_MAX) for i in shown]
    opacity = max(0.15, 6.0 / max(6, len(shown)))
    ax.add_collection(LineCollection(lines, colors=colours, linewidths=1.4, alpha=opacity, zorder=4), autolim=False)
    ends = np.reshape([line[-1] for line in lines], (-1, 2))
    place: dict[str, Any] = {"offsets": ends, "offset_transform": ax.transData, "units": "xy", "zorder": 3}
    size = 2.0 * radius_m
    ax.add_collection(EllipseCollection(size, size, 0.0, facecolors="none", edgecolors=colours, **place), autolim=False)
    says = f"\n{len(shown)} of {len(begins)} paths, taken evenly" if len(shown) < len(begins) else ""
    return says, np.concatenate(lines or [ends])


def _count(outcomes: dict[Any, str], name: str) -> int:
    return sum(outcome == name for outcome in outcomes.values())


def _numbers(episodes: "pd.DataFrame") -> str:
    """Return time and length under a title: the only robot's own, or the means of those that reached."""
    arrived = reached(episodes)
    if arrived.empty:
        return ""
    mean = "" if len(episodes) == 1 else f"means of {len(arrived)} of {len(episodes)}: "
    return f"\n{mean}{arrived['time_s'].mean():.2f} s, {arrived['path_length_m'].mean():.3f} m"


def save_convergence(results: Results, file: Path) -> None:
    """Draw the least cost so far over the evaluations, a line a tuning, and save the picture.

    Args:
        results: a results directory with evaluations.
        file: where to save; its ending chooses the format.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    ax = figure.subplots()
    for (name, seed), rows in results.evaluations().groupby(["name", "seed"]):
        evaluations = rows["evaluation"].to_numpy() + 1
        ax.plot(evaluations, rows["cost"], ".", color="#8d99ae", markersize=3)
        ax.step(evaluations, rows["cost"].cummin(), where="post", label=f"{name}, seed {seed}: least so far")
    ax.set(xlabel="evaluations", ylabel="cost", yscale="log" if (results.evaluations()["cost"] > 0).all() else "linear")
    ax.legend(frameon=False)
    save_whole(figure, file)


def save_whole(figure: "Figure", file: Path) -> None:
    """Save a figure whole or not at all, the same bytes for the same figure; its ending chooses the format.

    With a layout engine, it is laid out and measured here: asked for a tight box, ``savefig`` would draw it twice.
    """
    from matplotlib import rc_context, rcParams
    from matplotlib.backend_bases import get_registered_canvas_class

    content, form, box = io.BytesIO(), file.suffix[1:], None
    layout = figure.get_layout_engine()
    dpi = get_registered_canvas_class(form)(figure).fixed_dpi or DPI
    with rc_context({"svg.hashsalt": "navbench", "svg.fonttype": "none"}):
        figure.set_dpi(dpi)
        if layout is not None:
            layout.execute(figure)
            box = figure.get_tightbbox().padded(rcParams["savefig.pad_inches"])
        figure.set_layout_engine(None)
        figure.savefig(content, format=form, dpi=dpi, bbox_inches=box, metadata=METADATA.get(form))
        figure.set_layout_engine(layout)
    with replacing(file) as temporary:
        temporary.write_bytes(_numbered(content.getvalue()) if form == "svg" else content.getvalue())


def _numbered(svg: bytes) -> bytes:
    """Return an SVG whose clip paths are numbered: they are named by all digits of a layout, whose last ones vary."""
    names: dict[bytes, bytes] = {}
    return CLIPS.sub(lambda found: names.setdefault(found[0], b"clip%d" % len(names)), svg)
