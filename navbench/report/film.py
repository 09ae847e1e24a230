"""One episode as moving pictures: robots and movers in the layout at an instant, rays, speeds, and what is active."""

import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.stored import StoredResults
from navbench.experiments.rows import RANGES, TRAJECTORY
from navbench.report.drawing import MOVER, MOVER_EDGE, draw_goal, draw_obstacles, frame, mover_patch
from navbench.report.drives import ACTIVE, FEW, Drive, active_of, robots_of
from navbench.report.figures import COLOURS, robot_color
from navbench.report.playback import trace_words
from navbench.robot import Robot
from navbench.validation import describe
from navbench.world.layout import DrawnWorld

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]
Rays = Callable[[float, FloatArray], Sequence[FloatArray]]  # of an instant and all poses: (n, 5) a robot, see ``Film``

MAP_INCHES, HEIGHT_INCHES, TOLD_INCHES, TOP_INCHES, DPI = 6.6, (3.6, 7.2), 3.2, 0.45, 100
TRACES, LETTERS = 12, 36  # of the trace that is told, and how long a line may be
RAY, SEES = "#e8a33d", "#c1121f"


class Driven:
    """What one robot did, for looking up what it does at an instant.

    Args:
        drive: what it did.
        begin: x, y [m] and heading [rad] of its start.
        words: what values of its trace are called.

    Attributes:
        drive: what it did.
        poses: (n, 3) x, y [m] and heading [rad]; n >= 1.
        names: what is told of its trace in numbers.
        recorded: whether it is kept what its range sensors read.
    """

    def __init__(self, drive: Drive, begin: tuple[float, float, float], words: Mapping[str, Mapping[str, str]]) -> None:
        self.drive, path = drive, drive.path
        self.poses = path[["x_m", "y_m", "heading_rad"]].to_numpy(dtype=float) if len(path) else np.array([begin])
        self._times_s = path["t_s"].to_numpy(dtype=float)
        self._speeds = path[["v_mps", "w_radps"]].to_numpy(dtype=float)
        self._active = active_of(path)
        self._ranges: list[FloatArray | None] = path[RANGES].tolist() if RANGES in path.columns else []
        self.recorded = any(row is not None for row in self._ranges)
        names = [name for name in path.columns if name not in TRAJECTORY]
        names = [name for name in names if not name.startswith(ACTIVE) and path[name].notna().any()]
        self._words = {name: words[name] for name in names if name in words}
        self.names = [name for name in names if name not in words][:TRACES]
        self._trace = {name: path[name].to_numpy(dtype=float) for name in names}

    def place(self, t_s: float) -> int:
        """Return which of its states holds at an instant: the last one where it has ended."""
        return max(int(np.searchsorted(self._times_s, t_s + 1e-9)) - 1, 0)

    def read(self, t_s: float) -> FloatArray:
        """Return (n_sensors,) what its range sensors read at an instant [m]; (0,) at its end, and where it is lost."""
        row = self._ranges[self.place(t_s)] if self._ranges else None
        return np.empty(0) if row is None else row

    def ended(self, t_s: float) -> bool:
        """Return whether it has an outcome."""
        return self.place(t_s) == len(self.poses) - 1

    def says(self, t_s: float) -> list[str]:
        """Return what it does at an instant, in up to two lines: its speeds, and what is active; or how it ended."""
        if self.ended(t_s):
            return textwrap.wrap(f"{self.drive.name}  {self.drive.end}", LETTERS, max_lines=2, placeholder=" ...")
        place = self.place(t_s)
        words = [of.get(f"{self._trace[name][place]:g}", "") for name, of in self._words.items()]
        told = ", ".join(filter(None, [*(name for name, on in self._active.items() if on[place]), *words]))
        v_mps, w_radps = self._speeds[place]
        lines = [f"{self.drive.name}  {v_mps:.3f} m/s  {np.degrees(w_radps):+.0f} °/s"]
        return [*lines, *textwrap.wrap(told, LETTERS, max_lines=1, placeholder=" ...")]

    def trace(self, t_s: float) -> list[str]:
        """Return what its trace holds at an instant, a word for each of ``names``, empty for nothing."""
        values = [self._trace[name][self.place(t_s)] for name in self.names]
        return [f"{value:9.3f}" if np.isfinite(value) else "" for value in values]


class Played(NamedTuple):
    """An episode as it is played.

    Attributes:
        title: which one it is.
        world: what was driven in.
        radius_m: of each robot [m].
        robots: what each robot did.
        period_s: the control period [s].
        end_s: when the last robot ended [s].
    """

    title: str
    world: DrawnWorld
    radius_m: float
    robots: Sequence[Driven]
    period_s: float
    end_s: float

    @property
    def recorded(self) -> bool:
        """Whether it is kept what range sensors read."""
        return any(robot.recorded for robot in self.robots)

    def poses(self, t_s: float) -> FloatArray:
        """Return (robots, 3) x, y [m] and heading [rad] at an instant."""
        return np.array([robot.poses[robot.place(t_s)] for robot in self.robots])


def played(stored: StoredResults, run_id: str, episode: int) -> Played:
    """Return an episode of a cell that keeps trajectories.

    Raises:
        ResultsError: nothing was driven, or no trajectories are kept.
    """
    cell, world = stored.configuration(run_id), stored.world(run_id, episode)
    rows = robots_of(stored, run_id, episode)
    drives = [Drive(row, stored.trajectory(row), robot_color(row["robot_index"])) for row in rows]
    begins = [(start.x_m, start.y_m, world.start_heading_rad(i)) for i, start in enumerate(world.starts)]
    words = trace_words(stored, run_id)
    times_s = max((drive.path["t_s"].to_numpy(dtype=float) for drive in drives), key=len)
    return Played(
        title=f"{cell['label']} in {cell['world']}, episode {episode}, seed {cell['seed']}, {cell['simulator']}",
        world=world,
        radius_m=describe(Robot, cell["configuration"]["robot"], "robot").radius_m,
        robots=[Driven(drive, begin, words) for drive, begin in zip(drives, begins, strict=True)],
        period_s=float(times_s[1] - times_s[0]) if len(times_s) > 2 else 1.0,
        end_s=float(times_s.max(initial=0.0)),
    )


class Film:
    """A figure of which only what moves is drawn anew.

    Args:
        played: the episode.
        robots: whose rays are drawn, at least one; the first one's trace is told.
        rays: what these measure: of an instant and all poses, of each robot (n, 5) where a ray begins and ends [m], as
            x, y, x, y, and whether it sees something.
        note: where the rays come from.
        figure: where to draw; None for a new one.
    """

    def __init__(
        self, played: Played, robots: Sequence[int], rays: Rays, note: str, figure: "Figure | None" = None
    ) -> None:
        from matplotlib.figure import Figure

        self._played, self._robots, self._rays = played, robots, rays
        self._canvas: Any = None
        world, b, (low, high) = played.world, played.world.bounds, HEIGHT_INCHES
        height = float(np.clip(MAP_INCHES * (b.y_max_m - b.y_min_m) / (b.x_max_m - b.x_min_m), low, high)) + TOP_INCHES
        self.figure = Figure(dpi=DPI) if figure is None else figure
        self.figure.set_size_inches(MAP_INCHES + TOLD_INCHES, round(height * DPI / 2) * 2 / DPI)  # even, for a codec
        left, width = 0.75 / (MAP_INCHES + TOLD_INCHES), (MAP_INCHES - 0.95) / (MAP_INCHES + TOLD_INCHES)
        self._ax = ax = self.figure.add_axes((left, 0.55 / height, width, (height - TOP_INCHES - 0.65) / height))
        frame(ax, world, np.concatenate([robot.poses[:, :2] for robot in played.robots]))
        draw_obstacles(ax, world)
        for goal, robot in zip(world.goals, played.robots, strict=True):
            draw_goal(ax, goal, world.goal_tolerance_m, robot.drive.color)
        self.figure.text(0.01, 1.0 - 0.3 / height, played.title, fontsize=11, parse_math=False)
        self._sheet = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))  # for words, which a window redraws only in axes
        self._sheet.set_axis_off()
        beside = MAP_INCHES / (MAP_INCHES + TOLD_INCHES)
        self._sheet.text(beside, 0.12 / height, note, fontsize=8, color="0.35")
        self._parts(beside, height)

    def _parts(self, beside: float, height: float) -> None:
        """Make what moves."""
        from matplotlib.collections import LineCollection
        from matplotlib.lines import Line2D
        from matplotlib.patches import Circle

        ax = self._ax
        still: dict[str, Any] = {"animated": True}
        drives, radius_m = [robot.drive for robot in self._played.robots], self._played.radius_m
        look: dict[str, Any] = {"facecolor": MOVER, "edgecolor": MOVER_EDGE, "alpha": 0.8}
        self._movers = [mover_patch(mover, 0.0, 0.0, **look, **still) for mover in self._played.world.movers]
        self._beams = LineCollection([], colors=RAY, linewidths=0.7, zorder=4, **still)
        self._seen = Line2D([], [], color=SEES, marker=".", markersize=4, linestyle="none", zorder=5, **still)
        self._trails = [Line2D([], [], color=drive.color, linewidth=1.2, zorder=3, **still) for drive in drives]
        self._hulls = [Circle((0, 0), radius_m, edgecolor=d.color, linewidth=1.6, zorder=6, **still) for d in drives]
        self._noses = [Line2D([], [], color=drive.color, linewidth=1.6, zorder=7, **still) for drive in drives]
        for artist in (*self._movers, *self._hulls):
            ax.add_patch(artist)
        for line in (self._seen, *self._trails, *self._noses):
            ax.add_line(line)
        ax.add_collection(self._beams)
        write: dict[str, Any] = {"va": "top", "parse_math": False}
        self._clock = self._sheet.text(beside, 1.0 - 0.5 / height, "", fontsize=15, **write, **still)
        self._told = [
            self._sheet.text(
                beside, 1.0 - (0.9 + 0.4 * row) / height, "", fontsize=9, color=drives[i].color, **write, **still
            )
            for row, i in enumerate(self._listed())
        ]
        below = 1.0 - (1.0 + 0.4 * len(self._told)) / height
        look = {"fontsize": 7.5, "family": "monospace", **write}
        names = self._played.robots[self._robots[0]].names
        self._sheet.text(
            beside, below, "\n".join(name.replace("_", " ")[:30] for name in names), **look, animated=False
        )  # once: text takes the longest
        right = beside + 2.9 / (MAP_INCHES + TOLD_INCHES)
        self._trace = self._sheet.text(right, below, "", ha="right", **look, **still)

    def _listed(self) -> list[int]:
        """Return of which robots it is told what they do: of all, or where these are too many, of those in front."""
        every = range(len(self._played.robots))
        return list(every) if len(every) <= FEW else list(self._robots)[:FEW]

    def update(self, t_s: float) -> "list[Artist]":
        """Put everything where it is at an instant [s], and return what moves."""
        from matplotlib.transforms import Affine2D

        it, poses = self._played, self._played.poses(t_s)
        for mover, patch in zip(it.world.movers, self._movers, strict=True):
            patch.set_transform(Affine2D().translate(*mover.place(t_s)[:2]) + self._ax.transData)
        for i, (robot, (x, y, heading)) in enumerate(zip(it.robots, poses.tolist(), strict=True)):
            self._trails[i].set_data(*robot.poses[: robot.place(t_s) + 1, :2].T)
            self._hulls[i].set_center((x, y))
            self._hulls[i].set_facecolor(COLOURS[str(robot.drive.row["outcome"])] if robot.ended(t_s) else "white")
            tip = 1.5 * it.radius_m * np.array([np.cos(heading), np.sin(heading)])
            self._noses[i].set_data([x, x + tip[0]], [y, y + tip[1]])
        measured = self._rays(t_s, poses)
        rays = np.concatenate([np.empty((0, 5)), *(measured[i] for i in self._robots)])
        self._beams.set_segments(list(rays[:, :4].reshape(-1, 2, 2)))
        self._seen.set_data(*rays[rays[:, 4] > 0.0, 2:4].T)
        self._clock.set_text(f"{t_s:.2f} s")
        for i, text in zip(self._listed(), self._told, strict=True):
            text.set_text("\n".join(it.robots[i].says(t_s)))
        self._trace.set_text("\n".join(it.robots[self._robots[0]].trace(t_s)))
        return [
            *self._movers, *self._trails, self._beams, self._seen, *self._hulls, *self._noses, self._clock,
            *self._told, self._trace,
        ]  # fmt: skip

    def picture(self, t_s: float) -> NDArray[np.uint8]:
        """Return the frame of an instant [s], (height, width, 3) of red, green and blue, drawn off screen."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        if self._canvas is None:
            self._canvas = FigureCanvasAgg(self.figure)
            self._canvas.draw()
            self._background = self._canvas.copy_from_bbox(self.figure.bbox)
        self._canvas.restore_region(self._background)
        for artist in self.update(t_s):
            self.figure.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()
