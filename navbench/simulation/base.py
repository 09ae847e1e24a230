"""What every simulator does: exact arcs, the drive, arrival and contact at their instants, and what a contact does.

An engine adds only what a robot's rays hit: ``build``, ``place`` and ``cast`` of a subclass, which a file in
``conf/simulator`` names as its ``_target_``.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled, direct
from navbench.contract import Pose
from navbench.memory import borrowed, handed
from navbench.records import Thing
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.simulation.contacts import Contacts, Event
from navbench.simulation.motion import (
    COLLIDED,
    FIXED,
    ROBOT,
    STOPPED,
    Pipeline,
    RobotState,
    advance,
    measure_clearance,
    other_robots,
    set_command,
)
from navbench.simulation.options import SimulatorOptions
from navbench.simulation.rays import Rays
from navbench.simulation.scene import Scene
from navbench.simulation.touching import BOX, CELL, DISC, POLYGON
from navbench.world.layout import Layout

FloatArray = NDArray[np.float64]

_BEGUN = (
    *("x_m", "y_m", "heading_rad", "arc_x_m", "arc_y_m", "arc_heading_rad"),
    *("goal_x_m", "goal_y_m", "running"),
)
_MOTION = RobotState._fields.index("clearance_m")  # so many of a robot's numbers say how it moves: see ``motions``


class Simulator(ABC):
    """One layout with its robots at a time; reset it for each episode, close it at the end.

    The loop asks for ``ranges``, gives each robot a ``command``, and lets ``period`` move all through one control
    period and say what the rings read then. An engine makes its bodies in ``build``, from ``scene``, ``robots`` and
    ``robot``, and answers there.

    Args:
        options: how to simulate.
        robot: every robot's body.
        sensors: the suite that each robot carries, already scaled to the robot.
        accel_max_mps2: the wheel-acceleration limit in force [m/s^2], None for none.

    Attributes:
        Options: the description of the options, in which a subclass may have more.
        packages: the installed packages that decide what it computes.
        has_window: whether it can ``show`` what it does.
        is_compiled: whether a compiled loop can drive it, by the functions of ``navbench.simulation.planar``.
        scene: what the layout holds, where it is now.
        robots: (n_robots,) of ``ROBOT``, as they are now.
        rays: the ring's rays in the robot's frame.
        active: the numbers of those robots that have no outcome yet.
        fixed: (1,) of ``FIXED``, what does not change in the episode.
        pipeline: the commands on their way to the wheels: issued (n, 2) and in force (n, 2) for each left and right
            wheel [m/s]; of those in flight when each arrives (k,) [s] and it (k, n, 2); and how many these are (1,).
    """

    Options: ClassVar[type[SimulatorOptions]] = SimulatorOptions
    packages: ClassVar[tuple[str, ...]] = ()
    has_window: ClassVar[bool] = False
    is_compiled: ClassVar[bool] = False

    scene: Scene
    active: list[int]
    pipeline: Pipeline

    def __init__(self, options: SimulatorOptions, robot: Robot, sensors: Sensors, accel_max_mps2: float | None) -> None:
        self.options, self.robot, self.sensors = options, robot, sensors
        limited = options.drive == "limited"
        self.fixed = np.zeros(1, FIXED)
        self._delay_s = options.command_delay_s if limited else 0.0
        for name, value in {
            "radius_m": robot.radius_m,
            "track_m": robot.track_m,
            "wheel_speed_max_mps": robot.wheel_speed_max_mps,
            "accel_max_mps2": math.inf if accel_max_mps2 is None else accel_max_mps2,
            "lag_s": options.motor_lag_s if limited else 0.0,
            "delay_s": self._delay_s,
            "blocks": options.on_collision == "block",
        }.items():
            self.fixed[name] = value
        self.rays = Rays(sensors, robot.radius_m)
        self.robots = np.zeros(0, ROBOT)
        self._layout: Layout | None = None

    def __enter__(self) -> Self:
        """Return the simulator itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the simulator."""
        self.close()

    # --- what an engine answers ---

    @abstractmethod
    def build(self) -> None:
        """Make the bodies of a new episode: those of ``scene`` and ``robots``."""

    @abstractmethod
    def place(self) -> None:
        """Put robots and movers where they are now; called before ``cast`` if something has moved."""

    @abstractmethod
    def cast(self, index: int, rays: list[int]) -> list[float]:
        """Return what share of each of these of ``rays`` of a robot is free: 1 where it hits nothing."""

    def show(self, dt_s: float) -> None:
        """Show what is placed in a window, a control period [s] after the last time."""
        raise NotImplementedError

    def mark(self, lines: FloatArray, words: Sequence[str]) -> bool:
        """Show what is where now, with lines, (n, 4) from x, y to x, y [m], and lines of words, instead of the last.

        Returns:
            Whether the window is still open.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Give back what the engine holds."""
        return

    # --- what an episode asks ---

    def reset(self, layout: Layout, starts: Sequence[Pose], goal_tolerance_m: float) -> None:
        """Begin an episode in a layout, with one robot at each start.

        Args:
            layout: what stands and moves in it, and the goals.
            starts: one a goal of the layout.
            goal_tolerance_m: how near the goal counts as arrived [m].
        """
        count = len(starts)
        if layout is not self._layout:
            reach_m = self.robot.radius_m + max(self.rays.reach_m, self.robot.radius_m)
            self._layout, self.scene = layout, Scene(layout, reach_m)
        self.scene.move_to(0.0)
        scene, self.robots = self.scene, np.zeros(count, ROBOT)
        begun = [(*start, *start, goal.x_m, goal.y_m, 1) for start, goal in zip(starts, layout.goals, strict=True)]
        for name, column in zip(_BEGUN, zip(*begun, strict=True), strict=True):
            self.robots[name] = column
        self._touches = self.robots["touches"]
        self._motions = self.robots.view(np.float64).reshape(count, -1)[:, :_MOTION]
        self.fixed["goal_tolerance_m"], self.fixed["fastest_mover_mps"] = goal_tolerance_m, scene.fastest_mps
        self.pipeline = (
            np.zeros((count, 2)), np.zeros((count, 2)), np.zeros(0), np.zeros((0, count, 2)), np.zeros(1, np.int64)
        )  # fmt: skip
        self._reserved_s, self._handed = math.inf, None
        self._unobstructed = np.tile(self.rays.unobstructed, (count, 1))
        self.active = list(range(count))
        self.build()
        self._is_placed = False
        measure_clearance(self.robots, scene.arrays, self.robot.radius_m)
        self.robots["min_clearance_m"] = self.robots["clearance_m"]

    @property
    def running(self) -> int:
        """How many robots have no outcome yet."""
        return len(self.active)

    def states(self) -> list[RobotState]:
        """Return what is known of each robot now."""
        return list(map(RobotState._make, self.robots.tolist()))

    def motions(self) -> list[list[float]]:
        """Return of each robot's ``RobotState`` what comes before the clearance: pose, speeds and travel."""
        motions: list[list[float]] = self._motions.tolist()
        return motions

    def tracked_discs(self, index: int) -> FloatArray:
        """Return discs, movers, circles around polygons and the other robots: (n, 5) x, y, radius, vx, vy [m, m/s]."""
        circles = self.scene.circles()
        discs = np.concatenate([circles, np.empty((len(self.robots) - 1, 5))])
        other_robots(self.robots, index, self.robot.radius_m, discs[len(circles) :])
        return discs

    @property
    def contacts(self) -> list[Contacts]:
        """Each robot's contacts so far."""
        return [Contacts(robot.contacts, robot.robot_contacts, robot.standing_contacts) for robot in self.states()]

    @property
    def touching(self) -> list[bool]:
        """Whether each robot touches something that it hit."""
        return [touches != 0 for touches in self._touches.tolist()]

    def ranges(self) -> FloatArray:
        """Return what the running robots' rings measure without noise: (n_robots, n_sensors) [m].

        Where nothing is, and of robots that have ended, it is the largest range. The engine is asked only for the rays
        that may be what their sensors read.
        """
        rays, scene, robots = self.rays, self.scene, self.robots
        clearances_m, ranges = robots["clearance_m"].tolist(), self._unobstructed.copy()
        least_m = min(clearances_m)
        if least_m > rays.reach_m:
            return ranges
        if len(scene.grid[0]):
            deciding = rays.all_of(robots)
        else:
            deciding = rays.deciding(robots, scene.boxes, scene.discs, scene.polygons)
        shares: list[float] = []
        for i, own in enumerate(rays.split(deciding, len(robots))):
            if own:
                if not self._is_placed:
                    self._place()
                shares += self.cast(i, own)
        if not shares:
            return ranges
        rays.read(deciding, shares, ranges)
        if least_m <= rays.exposed_m:
            self._blind_inside_things(ranges, clearances_m)
        return ranges

    def command(self, index: int, v_mps: float, w_radps: float) -> None:
        """Set one robot's command for the coming period; each wheel is clipped at its limit, separately.

        Raises:
            ValueError: the wheels' speeds are not finite.
        """
        if not self._command(self.pipeline[0], index, v_mps, w_radps, self.fixed):
            raise ValueError(f"the wheels' speeds must be finite, got v_mps={v_mps}, w_radps={w_radps} in the world")

    def reserve(self, period_s: float) -> None:
        """Make room for the commands that may be in flight at once with a control period [s]."""
        if period_s >= self._reserved_s:
            return
        self._reserved_s = period_s
        issued, in_force, flight_s, flight, flying = self.pipeline
        more = max(math.ceil(self._delay_s / period_s) + 2 - len(flight_s), 0)
        flight_s = np.concatenate([flight_s, np.zeros(more)])
        flight = np.concatenate([flight, np.zeros((more, *issued.shape))])
        self.pipeline, self._handed = (issued, in_force, flight_s, flight, flying), None

    def advance(self, t_s: float, dt_s: float) -> list[Event]:
        """Move everything through one control period and return the ends that came in it, in order of time.

        Args:
            t_s: the period's beginning [s].
            dt_s: its length [s].
        """
        self.reserve(dt_s)
        return self._ended(self._advance(self._moved(), t_s, dt_s), dt_s)

    def period(self, t_s: float, dt_s: float) -> tuple[list[Event], FloatArray]:
        """Do as ``advance``, and return also what the ``ranges`` are then; arguments as there."""
        return self.advance(t_s, dt_s), self.ranges()

    def _ended(self, running: int, dt_s: float) -> list[Event]:
        """Return the ends that came in a period [s], of which this many robots were left."""
        self._is_placed = False
        if self.options.gui:
            self._place()
            self.show(dt_s)
        if running == len(self.active):
            return []
        before, self.active = self.active, np.flatnonzero(self.robots["running"]).tolist()
        ended = set(before).difference(self.active)
        return sorted(map(self.end, ended), key=lambda event: (event.t_s, event.robot_index))

    def end(self, index: int) -> Event:
        """Return how one robot ended."""
        robot = RobotState(*self.robots[index].item())
        if robot.outcome == COLLIDED:
            return Event(index, "collided", self._thing(robot.hit, robot.hit_index), robot.end_s)
        return Event(index, "reached", None, robot.end_s)

    def stop(self, index: int) -> None:
        """Take one robot out of the episode: it stays where it is, as an obstacle."""
        self.robots[index]["running"], self.robots[index]["outcome"] = 0, STOPPED
        self.active.remove(index)

    # --- how it is done ---

    @cached_property
    def _command(self) -> Callable[..., bool]:
        return direct(set_command, self.pipeline[0], 0, 0.0, 0.0, self.fixed)

    def _moving(self) -> tuple[Any, ...]:
        return self.robots, self.pipeline, self.scene.arrays, self.fixed

    def _moved(self) -> Any:
        """Return what moves as one object: to hand over each array anew takes longer than the work."""
        if self._handed is None:
            self._handed = self._hand_over(self._moving(), 1)
        return self._handed

    @cached_property
    def _hand_over(self) -> Callable[..., Any]:
        return direct(handed, self._moving(), 1)

    @cached_property
    def _advance(self) -> Callable[..., int]:
        return direct(_advance_handed, self._moved(), 0.0, 0.0)

    def _thing(self, kind: int, row: int) -> Thing:
        """Return what has this row among the scene's things of a kind."""
        layout = self.scene.layout
        if kind == BOX:
            walls_from = len(layout.boxes)
            return Thing("box", row) if row < walls_from else Thing("wall", row - walls_from)
        if kind == CELL:
            return Thing("cell", row)
        if kind not in (DISC, POLYGON):
            return Thing("robot", row)
        still = len(layout.discs) if kind == DISC else len(layout.polygons)
        if row < still:
            return Thing("disc" if kind == DISC else "polygon", row)
        before = len(layout.round_movers()) if kind == POLYGON else 0
        return Thing("mover", self.scene.mover_order()[before + row - still])

    def _place(self) -> None:
        self.place()
        self._is_placed = True

    def _blind_inside_things(self, ranges: FloatArray, clearances_m: list[float]) -> None:
        """Set to 0, in place, what sensors read whose rays begin inside something, and so hit nothing."""
        scene = self.scene
        for i, clearance_m in enumerate(clearances_m):
            robot = self.robots[i]
            if clearance_m <= self.rays.exposed_m and robot["running"]:
                others = np.empty((len(self.robots) - 1, 5))
                other_robots(self.robots, i, self.robot.radius_m, others)
                discs = np.concatenate([scene.discs, others])
                self.rays.blind_inside_things(ranges[i], robot, scene.boxes, discs, scene.polygons, scene.grid)


@compiled
def _advance_handed(moved: Any, t_s: float, dt_s: float) -> int:
    """Do as ``advance``, with what moves handed over before."""
    robots, pipeline, scenery, fixed = borrowed(moved[0])[:4]
    return advance(robots, pipeline, scenery, fixed, t_s, dt_s)
