"""What every simulator does: exact arcs, the drive, substeps, arrival, clearance, and what a contact does.

An engine adds only which bodies there are, what its rays hit and what touches what: ``build``, ``place``, ``cast`` and
``touches`` of a subclass, which a file in ``conf/simulator`` names as its ``_target_``.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navbench.contract import Pose
from navbench.records import Thing
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.simulation.contacts import ContactLedger, Contacts, Event
from navbench.simulation.drive import Drive
from navbench.simulation.motion import (
    FIXED,
    NOT_YET,
    ROBOT,
    RobotState,
    count_clearance,
    hold,
    measure_clearance,
    move,
    other_robots,
    stop_at_arrival,
)
from navbench.simulation.options import SimulatorOptions
from navbench.simulation.rays import Rays
from navbench.simulation.scene import Scene
from navbench.world.layout import Layout

FloatArray = NDArray[np.float64]

SUBSTEP_RADII = 0.25  # no body moves further than this in a substep, so none jumps through another
CONTACT_MARGIN_RADII = 0.05  # an engine is asked for contacts only where the analytic clearance is below this


class Simulator(ABC):
    """One layout with its robots at a time; reset it for each episode, close it at the end.

    The loop asks for ``ranges``, gives each robot a ``command``, and lets ``advance`` move all through one control
    period. An engine makes its bodies in ``build``, from ``scene``, ``robots`` and ``robot``, and answers there.

    Args:
        options: how to simulate.
        robot: every robot's body.
        sensors: the suite that each robot carries, already scaled to the robot.
        accel_max_mps2: the wheel-acceleration limit in force [m/s^2], None for none.

    Attributes:
        Options: the description of the options, in which a subclass may have more.
        packages: the installed packages that decide what it computes.
        has_window: whether it can ``show`` what it does.
        scene: what the layout holds, where it is now.
        robots: (n_robots,) of ``ROBOT``, as they are now.
        rays: the ring's rays in the robot's frame.
        running: how many robots have no outcome yet.
        contacts: each robot's contacts so far.
        touching: whether each robot is held by something now.
    """

    Options: ClassVar[type[SimulatorOptions]] = SimulatorOptions
    packages: ClassVar[tuple[str, ...]] = ()
    has_window: ClassVar[bool] = False

    scene: Scene
    running: int
    contacts: list[Contacts]
    touching: list[bool]

    def __init__(self, options: SimulatorOptions, robot: Robot, sensors: Sensors, accel_max_mps2: float | None) -> None:
        self.options, self.robot = options, robot
        self._accel_max_mps2 = accel_max_mps2
        self.rays = Rays(sensors, robot.radius_m)
        self.robots = np.zeros(0, ROBOT)

    def __enter__(self) -> "Simulator":
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
        """Put robots and movers where they are now; called before ``cast`` and ``touches`` if something has moved."""

    @abstractmethod
    def cast(self, index: int, rays: list[int]) -> list[float]:
        """Return what share of each of these of ``rays`` of a robot is free: 1 where it hits nothing."""

    @abstractmethod
    def touches(self) -> Iterable[tuple[Thing, Thing]]:
        """Return the pairs of things that touch now and of which one is a robot, in any order."""

    def show(self, dt_s: float) -> None:
        """Show what is placed in a window, a control period [s] after the last time."""
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
        count, radius_m = len(starts), self.robot.radius_m
        self.scene = scene = Scene(layout)
        scene.move_to(0.0)
        self.robots = np.zeros(count, ROBOT)
        for i, (start, goal) in enumerate(zip(starts, layout.goals, strict=True)):
            self.robots[["x_m", "y_m", "heading_rad", "goal_x_m", "goal_y_m", "min_clearance_m", "running"]][i] = (
                *start, goal.x_m, goal.y_m, math.inf, 1,
            )  # fmt: skip
        self._drive = Drive(self.robot, self.options, self._accel_max_mps2, count)
        line = scene.finish_line
        self._fixed = np.zeros(1, FIXED)
        self._fixed[:] = (
            radius_m, self.robot.track_m, self._drive.accel_max_mps2, self._drive.lag_s, goal_tolerance_m,
            CONTACT_MARGIN_RADII * radius_m, len(line) > 0, line if len(line) else 0.0,
        )  # fmt: skip
        self._ledger = ContactLedger(count)
        self.contacts, self.touching = self._ledger.counts, self._ledger.touching
        self._unobstructed = np.tile(self.rays.unobstructed, (count, 1))
        self.running = count
        self.build()
        self._is_placed = False
        self._measure_clearance()
        count_clearance(self.robots)

    def states(self) -> list[RobotState]:
        """Return what is known of each robot now."""
        return list(map(RobotState._make, self.robots.tolist()))

    def tracked_discs(self, index: int) -> FloatArray:
        """Return discs, movers, circles around polygons and the other robots: (n, 5) x, y, radius, vx, vy [m, m/s]."""
        return np.concatenate([self.scene.circles(), other_robots(self.robots, index, self.robot.radius_m)])

    def ranges(self) -> FloatArray:
        """Return what the running robots' rings measure without noise: (n_robots, n_sensors) [m].

        Where nothing is, and of robots that have ended, it is the largest range. The engine is asked only for the rays
        that may be what their sensors read.
        """
        rays, scene = self.rays, self.scene
        clearances_m = self.robots["clearance_m"].tolist()
        least_m = min(clearances_m)
        if least_m > rays.reach_m:
            return self._unobstructed.copy()
        asked = rays.deciding(self.robots, scene.boxes, scene.discs, scene.polygons)
        if not any(asked):
            return self._unobstructed.copy()
        if not self._is_placed:
            self._place()
        ranges = np.array(
            [rays.read(own, self.cast(i, own)) if own else rays.unobstructed for i, own in enumerate(asked)]
        )
        if self._ledger.any_held or least_m <= rays.exposed_m:
            self._blind_inside_things(ranges, clearances_m)
        return ranges

    def command(self, index: int, v_mps: float, w_radps: float) -> None:
        """Set one robot's command for the coming period, see ``Drive.command``."""
        self._drive.command(index, v_mps, w_radps)

    def advance(self, t_s: float, dt_s: float) -> list[Event]:
        """Move everything through one control period and return the ends that came in it.

        Args:
            t_s: the period's beginning [s].
            dt_s: its length [s].
        """
        events: list[Event] = []
        scene, drive = self.scene, self._drive
        new_period = True
        for begin_s, duration_s in drive.segments(t_s, dt_s):
            fastest = max(drive.fastest_mps, scene.fastest_mps)
            substeps = max(1, math.ceil(fastest * duration_s / (SUBSTEP_RADII * self.robot.radius_m) - 1e-9))
            h = duration_s / substeps
            done = 0
            while done < substeps:
                if scene.fastest_mps:
                    scene.move_to(begin_s + done * h + h)
                made, unsettled, near = move(
                    self.robots, drive.in_force, scene.boxes, scene.discs, scene.polygons, self._fixed, h,
                    1 if scene.fastest_mps else substeps - done, new_period, self._ledger.any_held,
                )  # fmt: skip
                new_period = self._is_placed = False
                done += made
                if unsettled:
                    self._settle(begin_s + (done - 1) * h, h, self._contacts() if near else {}, events)
                    if not self.running:
                        return events
        if self.options.gui:
            self._place()
            self.show(dt_s)
        return events

    def stop(self, index: int) -> None:
        """Take one robot out of the episode: it stays where it is, as an obstacle."""
        self.robots[index]["running"] = 0
        self.robots[index]["arrival_s"] = NOT_YET
        self.running -= 1

    # --- how it is done ---

    def _settle(self, t_s: float, h: float, hit: dict[int, Thing], events: list[Event]) -> None:
        """Put back who is blocked or has arrived, count clearances there, and end who has an outcome."""
        blocks, track_m = self.options.on_collision == "block", self.robot.track_m
        if blocks:
            fresh = hit
            while fresh:  # one that is held may now stand in another's path
                for i in fresh:
                    hold(self.robots, i, h, track_m)
                found = self._contacts()
                fresh = {i: thing for i, thing in found.items() if i not in hit}
                hit = {**found, **hit}
        arrivals = {
            i: arrival_s
            for i, arrival_s in enumerate(self.robots["arrival_s"].tolist())
            if arrival_s != NOT_YET and i not in hit and self.robots[i]["running"]
        }
        for i in arrivals:
            stop_at_arrival(self.robots, i, h, track_m)
        self._is_placed = False
        self._measure_clearance()
        count_clearance(self.robots)
        if blocks:
            self._ledger.hold(hit, self.robots, self.robot.radius_m)
        else:
            for i, thing in hit.items():
                self._ledger.add(i, thing, self.robots)
                self.stop(i)
                events.append(Event(i, "collided", thing, t_s + h))
        for i, arrival_s in arrivals.items():
            self.stop(i)
            events.append(Event(i, "reached", None, t_s + arrival_s))

    def _contacts(self) -> dict[int, Thing]:
        """Return what each running robot touches now, by robot index; of several things the first one by name."""
        self._place()
        hit: dict[int, Thing] = {}
        for one, other in self.touches():
            for robot, thing in ((one, other), (other, one)):
                if robot.kind == "robot" and self.robots[robot.index]["running"]:
                    hit[robot.index] = min(hit.get(robot.index, thing), thing)
        return dict(sorted(hit.items()))

    def _place(self) -> None:
        self.place()
        self._is_placed = True

    def _measure_clearance(self) -> None:
        scene = self.scene
        measure_clearance(self.robots, scene.boxes, scene.discs, scene.polygons, self.robot.radius_m)

    def _blind_inside_things(self, ranges: FloatArray, clearances_m: list[float]) -> None:
        """Set to 0, in place, what sensors read whose rays begin inside something, and so hit nothing."""
        scene = self.scene
        for i, clearance_m in enumerate(clearances_m):
            robot = self.robots[i]
            if (self.touching[i] or clearance_m <= self.rays.exposed_m) and robot["running"]:
                others = np.concatenate([scene.discs, other_robots(self.robots, i, self.robot.radius_m)])
                self.rays.blind_inside_things(ranges[i], robot, scene.boxes, others, scene.polygons)
