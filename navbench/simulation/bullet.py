"""The simulator: exact arcs move the robots, PyBullet answers what a ray hits and what touches.

The only file that imports pybullet. Everything is simulated in units in which a robot's radius is between 4 and 8,
because PyBullet's ray tolerance is an absolute 0.001 units; the factor is a power of two, so converting is exact.
Round bodies are spheres centred on the sensor plane, where all rays run, so ranges are exact for circles in the plane.
"""

import ctypes
import math
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from navbench.contract import Pose
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.simulation.contacts import ContactLedger, Contacts, Event
from navbench.simulation.drive import Drive
from navbench.simulation.motion import (
    NOT_YET,
    ROBOT,
    count_clearance,
    hold,
    measure_clearance,
    move,
    other_robots,
    scaled_poses,
    stop_at_arrival,
)
from navbench.simulation.options import SimulatorOptions
from navbench.simulation.rays import Rays
from navbench.simulation.scene import Scene, prism
from navbench.world.shapes import Bounds

C_LIBRARY = ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None)


@contextmanager
def _silent(descriptor: int) -> Iterator[None]:
    """Keep what PyBullet prints about itself off a stream: 1, which belongs to the tables, or 2, to the errors."""
    kept = os.dup(descriptor)
    with open(os.devnull, "w") as sink:
        os.dup2(sink.fileno(), descriptor)
    try:
        yield
    finally:
        C_LIBRARY.fflush(None)  # into a pipe, the C library holds its text back until now
        os.dup2(kept, descriptor)
        os.close(kept)


with _silent(2):
    import pybullet

FloatArray = NDArray[np.float64]

SUBSTEP_RADII = 0.25  # no body moves further than this in a substep, so none jumps through another
CONTACT_MARGIN_RADII = 0.05  # PyBullet is asked for contacts only where the analytic clearance is below this
WALL_HEIGHT_RADII = 2.0  # only seen in the window: nothing leaves the plane


class Simulator:
    """One world with its robots in PyBullet; reset it for each episode, close it at the end.

    Everything is made anew for each episode: the engine's search tree remembers what was moved in it, and where two
    obstacles touch, the order in which it finds them shows in the last digits of a range.

    Args:
        robot: every robot's body.
        sensors: the suite that each robot carries, already scaled to the robot.
        options: how to simulate.
        accel_max_mps2: the wheel-acceleration limit in force [m/s^2], None for none.
    """

    def __init__(self, robot: Robot, sensors: Sensors, options: SimulatorOptions, accel_max_mps2: float | None) -> None:
        self.robot, self.options = robot, options
        self._accel_max_mps2 = accel_max_mps2
        self._scale = 2.0 ** math.ceil(math.log2(4.0 / robot.radius_m))
        self._rays = Rays(sensors, robot.radius_m, self._scale)
        with _silent(1):
            self._client = pybullet.connect(pybullet.GUI if options.gui else pybullet.DIRECT)
        if self._client < 0:
            raise RuntimeError("PyBullet could not be started; simulator.gui=true needs a display")
        self._names: dict[int, str] = {}
        self._robot_bodies: list[int] = []
        self._mover_bodies: list[int] = []
        self.robots = np.zeros(0, ROBOT)

    def __enter__(self) -> "Simulator":
        """Return the simulator itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the simulator."""
        self.close()

    def close(self) -> None:
        """Disconnect from PyBullet."""
        if pybullet.isConnected(self._client):
            with _silent(1):
                pybullet.disconnect(self._client)

    def reset(self, scene: Scene, starts: Sequence[Pose]) -> None:
        """Begin an episode in a scene, with one robot at each start.

        Args:
            scene: the world, whose movers the simulator moves.
            starts: one a goal of the world.
        """
        scene.move_to(0.0)
        self.scene, world = scene, scene.world
        self._goal_tolerance_m = world.goal_tolerance_m
        self._margin_m = CONTACT_MARGIN_RADII * self.robot.radius_m
        pybullet.resetSimulation(physicsClientId=self._client)
        if self.options.gui:
            self._look_from_above(world.bounds)
        self._names = {}
        # for spheres, of which PyBullet would make visual shapes of triangles, which takes longer than the bodies
        self._unseen = pybullet.createVisualShape(
            pybullet.GEOM_BOX, halfExtents=[1.0, 1.0, 1.0], physicsClientId=self._client
        )
        for i, box in enumerate(world.solids()):
            kind = f"box {i}" if i < len(world.boxes) else f"wall {i - len(world.boxes)}"
            self._add_box(kind, box.x_m, box.y_m, box.length_m, box.width_m, box.heading_rad)
        for i, disc in enumerate(world.discs):
            self._add_round(f"disc {i}", disc.x_m, disc.y_m, disc.radius_m, mass=0.0, colour=(0.5, 0.5, 0.5, 1.0))
        for i in range(len(world.polygons)):
            self._add_polygon(f"polygon {i}", scene.polygons[i])
        self._robot_bodies = [
            self._add_round(f"robot {i}", start.x_m, start.y_m, self.robot.radius_m, 1.0, (0.1, 0.4, 0.8, 1.0))
            for i, start in enumerate(starts)
        ]
        self._index = {body: i for i, body in enumerate(self._robot_bodies)}
        moving = [*scene.discs[len(world.discs) :], *scene.polygons[len(world.polygons) :]]
        self._mover_bodies = [
            self._add_polygon(name, row) if len(row) > 5 else self._add_mover(name, *row[:3].tolist())
            for name, row in zip(scene.mover_names(), moving, strict=True)
        ]
        self.robots = np.zeros(len(starts), ROBOT)
        for i, (start, goal) in enumerate(zip(starts, world.goals, strict=True)):
            self.robots[["x_m", "y_m", "heading_rad", "goal_x_m", "goal_y_m", "min_clearance_m", "running"]][i] = (
                *start, goal.x_m, goal.y_m, math.inf, 1,
            )  # fmt: skip
        self._drive = Drive(self.robot, self.options, self._accel_max_mps2, len(starts))
        self._ledger = ContactLedger(len(starts))
        self._nothing = np.tile(self._rays.nothing, (len(starts), 1))
        self._running = len(starts)
        self._poses = np.empty((len(starts), 4))
        self._posed = False
        self._measure_clearance()
        count_clearance(self.robots)

    def rows(self) -> list[tuple[float, ...]]:
        """Return what is known of each robot now, as plain tuples in the order of ``ROBOT``."""
        return self.robots.tolist()  # type: ignore[return-value]

    @property
    def running(self) -> int:
        """How many robots have no outcome yet."""
        return self._running

    @property
    def contacts(self) -> list[Contacts]:
        """Each robot's contacts so far."""
        return self._ledger.counts

    @property
    def touching(self) -> list[bool]:
        """Whether each robot is held by something now."""
        return self._ledger.touching

    def tracked_discs(self, index: int) -> FloatArray:
        """Return discs, movers, circles around polygons and the other robots: (n, 5) x, y, radius, vx, vy [m, m/s]."""
        return np.concatenate([self.scene.circles(), other_robots(self.robots, index, self.robot.radius_m)])

    def _measure_clearance(self) -> None:
        scene = self.scene
        measure_clearance(self.robots, scene.boxes, scene.discs, scene.polygons, self.robot.radius_m)

    def ranges(self) -> FloatArray:
        """Return what the running robots' rings measure without noise: (n_robots, n_sensors) [m].

        Where nothing is, and of robots that have ended, it is the largest range. PyBullet is asked only for the rays
        that may be what their sensors read.
        """
        rays, scene = self._rays, self.scene
        clearances_m = self.robots["clearance_m"].tolist()
        if min(clearances_m) > rays.reach_m:
            return self._nothing.copy()
        asked = rays.decisive(self.robots, scene.boxes, scene.discs, scene.polygons)
        count = len(clearances_m)
        if len(asked) == count + 1:
            return self._nothing.copy()
        if not self._posed:
            self._pose_bodies()
        readings = []
        for body, first, stop in zip(self._robot_bodies, asked, asked[1 : count + 1], strict=False):
            if first == stop:
                readings.append(rays.nothing)
                continue
            own = asked[first:stop]
            hits = pybullet.rayTestBatch(
                [rays.begins[ray] for ray in own],
                [rays.ends[ray] for ray in own],
                parentObjectUniqueId=body,
                physicsClientId=self._client,
            )
            readings.append(rays.read(own, [hit[2] for hit in hits]))
        ranges = np.array(readings)
        if self._ledger.any_held or min(clearances_m) <= rays.exposed_m:
            self._bury(ranges, clearances_m)
        return ranges

    def _bury(self, ranges: FloatArray, clearances_m: list[float]) -> None:
        """Set to 0, in place, what sensors read whose rays begin inside something, and so hit nothing."""
        rays, scene = self._rays, self.scene
        for i, clearance_m in enumerate(clearances_m):
            if (self._ledger.touching[i] or clearance_m <= rays.exposed_m) and self.robots[i]["running"]:
                row = self.robots[i]
                others = np.concatenate([scene.discs, other_robots(self.robots, i, self.robot.radius_m)])
                rays.bury(ranges[i], row["x_m"], row["y_m"], row["heading_rad"], scene.boxes, others, scene.polygons)

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
        robot, scene, drive = self.robot, self.scene, self._drive
        new_period = True
        for begin_s, duration_s in drive.segments(t_s, dt_s):
            fastest = max(drive.fastest_mps, scene.fastest_mps)
            substeps = max(1, math.ceil(fastest * duration_s / (SUBSTEP_RADII * robot.radius_m) - 1e-9))
            h = duration_s / substeps
            done = 0
            while done < substeps:
                if scene.fastest_mps:
                    scene.move_to(begin_s + done * h + h)
                made, unsettled, near = move(
                    self.robots, drive.in_force, scene.boxes, scene.discs, scene.polygons, scene.finish_line,
                    h, 1 if scene.fastest_mps else substeps - done, robot.radius_m, robot.track_m,
                    drive.accel_max_mps2, drive.lag_s, self._goal_tolerance_m, self._margin_m, new_period,
                    self._ledger.any_held,
                )  # fmt: skip
                new_period = self._posed = False
                done += made
                if unsettled:
                    self._settle(begin_s + (done - 1) * h, h, self._contacts() if near else {}, events)
                    if not self._running:
                        return events
        if self.options.gui:
            self._show(dt_s)
        return events

    def _settle(self, t_s: float, h: float, hit: dict[int, str], events: list[Event]) -> None:
        """Put back who is blocked or has arrived, count clearances there, and end who has an outcome."""
        blocks = self.options.on_collision == "block"
        if blocks:
            fresh = hit
            while fresh:  # one that is held may now stand in another's way
                for i in fresh:
                    hold(self.robots, i, h, self.robot.track_m)
                found = self._contacts()
                fresh = {i: reason for i, reason in found.items() if i not in hit}
                hit = {**found, **hit}
        arrivals = {
            i: arrival_s
            for i, arrival_s in enumerate(self.robots["arrival_s"].tolist())
            if arrival_s != NOT_YET and i not in hit and self.robots[i]["running"]
        }
        for i in arrivals:
            stop_at_arrival(self.robots, i, h, self.robot.track_m)
        self._posed = False
        self._measure_clearance()
        count_clearance(self.robots)
        if blocks:
            self._ledger.hold(hit, self.robots, self.robot.radius_m)
        else:
            for i, reason in hit.items():
                self._end(Event(i, "collided", reason, t_s + h), events)
        for i, arrival_s in arrivals.items():
            self._end(Event(i, "reached", "", t_s + arrival_s), events)

    def _contacts(self) -> dict[int, str]:
        """Return what each running robot touches now, by robot index."""
        self._pose_bodies()
        pybullet.performCollisionDetection(physicsClientId=self._client)
        hit: dict[int, str] = {}
        for point in pybullet.getContactPoints(physicsClientId=self._client):
            if point[8] > 0.0:
                continue
            for body, other in ((point[1], point[2]), (point[2], point[1])):
                i = self._index.get(body)
                if i is not None and self.robots[i]["running"]:
                    reason = f"hit {self._names[other]}"
                    hit[i] = min(hit.get(i, reason), reason)
        return dict(sorted(hit.items()))

    def _end(self, event: Event, events: list[Event]) -> None:
        if event.outcome == "collided":
            self._ledger.add(event.robot_index, event.reason, self.robots)
        self.stop(event.robot_index)
        events.append(event)

    def stop(self, index: int) -> None:
        """Take one robot out of the episode: it stays where it is, as an obstacle."""
        self.robots[index]["running"] = 0
        self.robots[index]["arrival_s"] = NOT_YET
        self._running -= 1

    def _pose_bodies(self) -> None:
        """Write the present poses into PyBullet."""
        scaled_poses(self.robots, self._scale, self._poses)
        pose, client = pybullet.resetBasePositionAndOrientation, self._client
        for body, (x, y, sine, cosine) in zip(self._robot_bodies, self._poses.tolist(), strict=True):
            pose(body, (x, y, 0.0), (0.0, 0.0, sine, cosine), physicsClientId=client)
        if self._mover_bodies:
            movers = self.scene.mover_places() * self._scale
            for body, (x, y) in zip(self._mover_bodies, movers.tolist(), strict=True):
                pose(body, (x, y, 0.0), (0.0, 0.0, 0.0, 1.0), physicsClientId=client)
        self._posed = True

    def _add_box(self, name: str, x_m: float, y_m: float, length_m: float, width_m: float, heading_rad: float) -> None:
        s = self._scale
        half = [0.5 * length_m * s, 0.5 * width_m * s, WALL_HEIGHT_RADII * self.robot.radius_m * s]
        shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, physicsClientId=self._client)
        self._add(name, shape, -1, 0.0, x_m, y_m, heading_rad)

    def _add_round(
        self, name: str, x_m: float, y_m: float, radius_m: float, mass: float, colour: tuple[float, ...]
    ) -> int:
        radius = radius_m * self._scale
        shape = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=radius, physicsClientId=self._client)
        if self.options.gui:
            visual = pybullet.createVisualShape(
                pybullet.GEOM_CYLINDER, radius=radius, length=radius, rgbaColor=colour, physicsClientId=self._client
            )
        else:
            visual = self._unseen
        return self._add(name, shape, visual, mass, x_m, y_m, 0.0)

    def _add_mover(self, name: str, x_m: float, y_m: float, radius_m: float) -> int:
        return self._add_round(name, x_m, y_m, radius_m, mass=0.0, colour=(0.9, 0.5, 0.1, 1.0))

    def _add_polygon(self, name: str, row: FloatArray) -> int:
        vertices, indices = prism(row * self._scale, WALL_HEIGHT_RADII * self.robot.radius_m * self._scale)
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            vertices=vertices,
            indices=indices,
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,  # exact for rays; as a hull it would carry a margin
            physicsClientId=self._client,
        )
        return self._add(name, shape, -1, 0.0, float(row[0]), float(row[1]), 0.0)

    def _add(self, name: str, shape: int, visual: int, mass: float, x_m: float, y_m: float, heading_rad: float) -> int:
        body: int = pybullet.createMultiBody(
            mass,
            shape,
            visual,
            (x_m * self._scale, y_m * self._scale, 0.0),
            (0.0, 0.0, math.sin(0.5 * heading_rad), math.cos(0.5 * heading_rad)),
            physicsClientId=self._client,
        )
        self._names[body] = name
        return body

    def _look_from_above(self, bounds: Bounds) -> None:
        """Turn the window's camera to the whole world, and hide the window's own panels."""
        b, s, client = bounds, self._scale, self._client
        centre = (0.5 * (b.x_min_m + b.x_max_m) * s, 0.5 * (b.y_min_m + b.y_max_m) * s, 0.0)
        size = max(b.x_max_m - b.x_min_m, b.y_max_m - b.y_min_m) * s
        pybullet.configureDebugVisualizer(pybullet.COV_ENABLE_GUI, 0, physicsClientId=client)
        pybullet.configureDebugVisualizer(pybullet.COV_ENABLE_SHADOWS, 0, physicsClientId=client)
        pybullet.resetDebugVisualizerCamera(size, 0.0, -89.9, centre, physicsClientId=client)

    def _show(self, dt_s: float) -> None:
        """Show the present poses and wait, so that the window runs in real time."""
        self._pose_bodies()
        now = time.monotonic()
        self._due = max(getattr(self, "_due", now), now - dt_s) + dt_s
        time.sleep(max(0.0, self._due - now))
