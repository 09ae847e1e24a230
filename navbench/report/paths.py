"""What the pictures of paths share: how they are cut, and words beside places that cover nothing else."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.report.figures import PALETTE

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.path import Path

FloatArray = NDArray[np.float64]

MARGIN_RADII = 3.0  # of a picture around the paths that it shows
LEAST_RATIO = 0.4  # of the shorter side of a picture to its longer one
SIDES = 16  # of a place, on which a word may stand
BESIDE_POINTS = (12.0, 19.0, 28.0)  # from a place to the middle of the word beside it: where there is room first
CLEAR_POINTS = 3.0  # of room suffice
LETTER_POINTS = 3.0  # half a letter's width
POINTS_PER_INCH = 72.0
TRIANGLE = ((0.46, 0.0), (-0.23, 0.28), (-0.23, -0.28))  # of a mark: forwards and to the left of its place, in radii


def cut(ax: "Axes", trajectories: Sequence["pd.DataFrame"], radius_m: float, square: bool = True) -> float:
    """Cut a picture to a rectangle around the paths, and no further than it reached; return its height over its width.

    Args:
        ax: the picture of a world.
        trajectories: trajectories.
        radius_m: the robots' radius; 3 of them are left around the paths [m].
        square: whether the picture is a square, as panels of one size are, or as narrow as its paths.
    """
    limits = []
    for name, (low, high) in (("x_m", ax.get_xlim()), ("y_m", ax.get_ylim())):
        least = min(trajectory[name].min() for trajectory in trajectories) - MARGIN_RADII * radius_m
        most = max(trajectory[name].max() for trajectory in trajectories) + MARGIN_RADII * radius_m
        limits.append((max(least, low), min(most, high)))
    longest = max(high - low for low, high in limits)
    sides = [longest if square else max(high - low, LEAST_RATIO * longest) for low, high in limits]
    (left, right), (bottom, top) = [
        (0.5 * (low + high - side), 0.5 * (low + high + side)) for (low, high), side in zip(limits, sides, strict=True)
    ]
    ax.set(xlim=(left, right), ylim=(bottom, top))
    return float(sides[1] / sides[0])


def draw_pieces(
    ax: "Axes",
    path: "pd.DataFrame",
    pieces: Mapping[str, NDArray[np.bool_]],
    linewidth: float,
    zorder: float = 2.0,
    colors: Sequence[str] = PALETTE,
) -> None:
    """Draw a path whose pieces differ in colour.

    Args:
        ax: where to draw.
        path: the trajectory, of n rows.
        pieces: what each kind of piece is called, and (n,) whether a row belongs to it.
        linewidth: of the path [points].
        zorder: above what it lies.
        colors: of the pieces, in their order.
    """
    for color, (called, holds) in zip(colors, pieces.items(), strict=False):
        shown = holds | np.append(False, holds[:-1])  # each piece reaches the beginning of the next
        if shown.any():
            drawn = path["x_m"].where(shown), path["y_m"].where(shown)
            ax.plot(*drawn, color=color, linewidth=linewidth, label=called, zorder=zorder)


def draw_marks(ax: "Axes", path: "pd.DataFrame", every_s: float, radius_m: float, color: str) -> None:
    """Draw where a robot is at the same intervals: triangles that point where it heads.

    Args:
        ax: where to draw.
        path: the trajectory.
        every_s: from one mark to the next, the first at the beginning [s].
        radius_m: the robot's radius [m].
        color: of its path.
    """
    from matplotlib.collections import PolyCollection

    t_s = path["t_s"].to_numpy()
    times = np.arange(0.0, t_s[-1], every_s)
    x, y = (np.interp(times, t_s, path[name]) for name in ("x_m", "y_m"))
    heading = np.interp(times, t_s, np.unwrap(path["heading_rad"]))
    forward, aside = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    corners = [np.array([x, y]) + radius_m * (a * forward + b * aside) for a, b in TRIANGLE]
    triangles = list(np.stack(corners).transpose(2, 0, 1))
    ax.add_collection(PolyCollection(triangles, facecolor="white", edgecolor=color, linewidth=0.7, zorder=20))


def number_places(
    ax: "Axes",
    numbered: Sequence[tuple[int | str, float, float]],
    near_m: float,
    trajectories: Sequence["pd.DataFrame"],
) -> None:
    """Mark places by strokes across their path and write their numbers beside them, those of one place together.

    Args:
        ax: where to write, with everything else in its place.
        numbered: each number, or what it is called, with its x [m] and y [m].
        near_m: what lies nearer than this to a place's first number stands with it [m].
        trajectories: the trajectories that the numbers do not cover.
    """
    driven = np.concatenate([trajectory[["x_m", "y_m", "heading_rad"]].to_numpy() for trajectory in trajectories])
    for _, x_m, y_m in numbered:
        heading_rad = driven[np.argmin(np.hypot(*(driven[:, :2] - (x_m, y_m)).T)), 2]
        draw_stroke(ax, x_m, y_m, heading_rad)
    write_beside(ax, together(numbered, near_m), trajectories)


def draw_stroke(ax: "Axes", x_m: float, y_m: float, heading_rad: float, color: str = "black") -> None:
    """Mark a place by a stroke across its path."""
    stroke = (2, 2, float(np.degrees(heading_rad)))
    ax.plot(x_m, y_m, marker=stroke, color=color, markersize=11, markeredgewidth=0.9, zorder=8)


def together(numbered: Sequence[tuple[int | str, float, float]], near_m: float, color: str = "black") -> list["Word"]:
    """Return the words for numbered places, those of one place together; arguments as of ``number_places``."""
    places: dict[tuple[float, float], list[str]] = {}
    for i, x_m, y_m in numbered:
        near = next((place for place in places if math.hypot(place[0] - x_m, place[1] - y_m) < near_m), (x_m, y_m))
        places.setdefault(near, []).append(str(i))
    return [Word(place, ", ".join(names), color) for place, names in places.items()]


class Word(NamedTuple):
    """A word that stands beside a place x, y [m]."""

    place: tuple[float, float]
    text: str
    color: str = "black"


def write_beside(
    ax: "Axes",
    words: Sequence[Word],
    trajectories: Sequence["pd.DataFrame"],
    radius_m: float = 0.0,
) -> None:
    """Write words beside places, each near, and on the side that is farthest from paths, obstacles and other words.

    Args:
        ax: where to write, with everything else in its place.
        words: the words, the most important first.
        trajectories: the trajectories.
        radius_m: of what stands around each place [m].
    """
    from matplotlib.path import Path
    from matplotlib.patheffects import Stroke

    figure: Any = ax.figure
    figure.draw_without_rendering()  # until then the axes are not where they will be
    point = figure.dpi / POINTS_PER_INCH
    radius = float(np.diff(ax.transData.transform([(0.0, 0.0), (radius_m, 0.0)])[:, 0])[0])
    solid = [patch.get_path().transformed(patch.get_transform()) for patch in ax.patches]
    taken = ax.transData.transform(
        np.concatenate([trajectory[["x_m", "y_m"]].to_numpy() for trajectory in trajectories])
    )
    for (x_m, y_m), word, color in words:
        place = ax.transData.transform((x_m, y_m))
        width = LETTER_POINTS * point * len(word)
        rooms: list[float] = []
        offsets: list[FloatArray] = []
        for away in BESIDE_POINTS:
            offsets += _offsets(radius + away * point, width - LETTER_POINTS * point)
            words_there = [_covered(place + offset, width, point) for offset in offsets[len(rooms) :]]
            rooms += [_room(ax, word_there, solid, taken) for word_there in words_there]
            if max(rooms) >= CLEAR_POINTS * point:
                break
        offset = offsets[int(np.argmax(rooms))]
        covered = _covered(place + offset, width, point)
        taken = np.concatenate([taken, covered])
        solid.append(Path(covered[[0, 4, 14, 10]]))  # no other word begins between its points
        look: dict[str, Any] = {
            "textcoords": "offset points",
            "ha": "center",
            "va": "center",
            "fontsize": 9,
            "zorder": 30,
            "color": color,
        }
        for effects in ([Stroke(linewidth=2.5, foreground="white")], []):  # a halo, and the word itself as text
            ax.annotate(word, (x_m, y_m), tuple(offset / point), path_effects=effects, **look)


def _offsets(away: float, wider: float) -> list[FloatArray]:
    """Return where the middle of a word may stand, from its place [pixels]: so far, and so much farther sideways."""
    angles = np.arange(SIDES) * (2.0 * math.pi / SIDES)
    return list(np.column_stack([(away + wider) * np.cos(angles), away * np.sin(angles)]))


def _covered(middle: FloatArray, width: float, point: float) -> FloatArray:
    """Return (15, 2) points that a word covers [pixels]."""
    x, y = np.meshgrid(np.linspace(-width, width, 5), np.array([-1.0, 0.0, 1.0]) * 2.0 * LETTER_POINTS * point)
    return middle + np.column_stack([x.ravel(), y.ravel()])


def _room(ax: "Axes", word: FloatArray, solid: "Sequence[Path]", taken: FloatArray) -> float:
    """Return how far a word is from what is taken [whole pixels]; less than 0 over an obstacle or the frame."""
    covers = any(path.contains_points(word).any() for path in solid)
    outside = not all(ax.bbox.contains(*at) for at in word)
    away = np.hypot(*(word[:, None] - taken[None]).reshape(-1, 2).T).min()
    return float(round(away)) - 1e4 * covers - 1e5 * outside
