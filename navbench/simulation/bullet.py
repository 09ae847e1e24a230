"""The simulator on PyBullet, which answers what a ray hits and what touches; the only file that knows PyBullet.

Everything is simulated in units in which a robot's radius is between 4 and 8, because PyBullet's ray tolerance is an
absolute 0.001 units; the factor is a power of two, so converting is exact. Round bodies are spheres centred on the
sensor plane, where all rays run, so ranges are exact for circles in the plane.
"""

import ctypes
import math
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import distributions
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from navbench.records import Thing
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.simulation.base import Simulator
from navbench.simulation.options import SimulatorOptions
from navbench.validation import DescriptionError
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


try:
    with _silent(2):
        import pybullet
except ModuleNotFoundError:
    raise DescriptionError(
        "needs PyBullet: pip install pybullet on Linux x86-64 with CPython 3.11, pybullet-arm64 elsewhere; "
        "or choose simulator=planar"
    ) from None

FloatArray = NDArray[np.float64]
Triple = tuple[float, float, float]

BATCH_MAX = 8192  # rays; of 16384 at once PyBullet silently returns nothing
_BODIES = itemgetter(1, 2, 8)  # of a contact point: the two bodies and how far they are apart
SEEN, UNSEEN = (1, -1), (1, 0)  # what group of bodies one is in, and which groups it meets: rays are in the first
WALL_HEIGHT_RADII = 2.0  # only seen in the window: nothing leaves the plane
GREY, BLUE, ORANGE = (0.5, 0.5, 0.5, 1.0), (0.1, 0.4, 0.8, 1.0), (0.9, 0.5, 0.1, 1.0)
DOTS = 25  # of a line in the window
BLACK, RED = (0.0, 0.0, 0.0), (0.8, 0.1, 0.1)


class BulletSimulator(Simulator):
    """Every body and every ray of an episode in one PyBullet client.

    Everything is made anew for each episode: the engine's search tree remembers what was moved in it, and where two
    obstacles touch, the order in which it finds them shows in the last digits of a range.

    Attributes:
        client: PyBullet's number of the client.
        scale: simulation units a metre.
        begins: each ray's beginning in the robot's frame, in simulation units.
        ends: each ray's end.
        bodies: PyBullet's number of each robot's body.
    """

    packages = tuple(name for name in ("pybullet", "pybullet-arm64") if any(distributions(name=name)))
    has_window = True

    def __init__(self, options: SimulatorOptions, robot: Robot, sensors: Sensors, accel_max_mps2: float | None) -> None:
        super().__init__(options, robot, sensors, accel_max_mps2)
        self.scale = 2.0 ** math.ceil(math.log2(4.0 / robot.radius_m))
        self.begins, self.ends = self._scaled_rays("begin"), self._scaled_rays("end")
        self.bodies: list[int] = []
        self._marks: dict[str, int] = {}  # what ``mark`` has drawn: words, and dots under an empty one
        self._corners: list[list[float]] = []  # see _add_polygon
        self._vertices: list[list[float]] = []
        self._indices: list[int] = []
        with _silent(1):
            self.client: int = pybullet.connect(pybullet.GUI if options.gui else pybullet.DIRECT)
        if self.client < 0:
            raise RuntimeError("PyBullet could not be started; simulator.gui=true needs a display")

    def close(self) -> None:
        """Disconnect from PyBullet."""
        if pybullet.isConnected(self.client):
            with _silent(1):
                pybullet.disconnect(self.client)

    def build(self) -> None:
        """Make a body of everything; movers have no mass, because of two such bodies no contact is reported."""
        scene, world = self.scene, self.scene.layout
        pybullet.resetSimulation(physicsClientId=self.client)
        if self.options.gui:
            self._look_from_above(world.bounds)
        self._things: dict[int, Thing] = {}
        # for spheres, of which PyBullet would make visual shapes of triangles, which takes longer than the bodies
        self._unseen = pybullet.createVisualShape(
            pybullet.GEOM_BOX, halfExtents=(1.0, 1.0, 1.0), physicsClientId=self.client
        )
        for i, box in enumerate(world.solids()):
            walls_from = len(world.boxes)
            thing = Thing("box", i) if i < walls_from else Thing("wall", i - walls_from)
            self._add_box(thing, box.x_m, box.y_m, box.length_m, box.width_m, box.heading_rad)
        for i, (x, y, half_length, half_width, _, _) in enumerate(
            world.grid.rectangles().tolist() if world.grid else ()
        ):
            self._add_box(Thing("cell", i), x, y, 2.0 * half_length, 2.0 * half_width, 0.0)
        for i, disc in enumerate(world.discs):
            self._add_round(Thing("disc", i), disc.x_m, disc.y_m, disc.radius_m, 0.0, GREY)
        for i in range(len(world.polygons)):
            self._add_polygon(Thing("polygon", i), scene.polygons[i])
        self.bodies = [
            self._add_round(Thing("robot", i), x_m, y_m, self.robot.radius_m, 1.0, BLUE)
            for i, (x_m, y_m) in enumerate(self.robots[["x_m", "y_m"]].tolist())
        ]
        moving = [*scene.discs[len(world.discs) :], *scene.polygons[len(world.polygons) :]]
        self._movers = [
            self._add_polygon(Thing("mover", i), row)
            if world.movers[i].outline
            else self._add_round(Thing("mover", i), row[0], row[1], row[2], 0.0, ORANGE)
            for i, row in zip(scene.mover_order(), moving, strict=True)
        ]

    def place(self) -> None:
        """Write the present poses into PyBullet."""
        pose, scale, client = pybullet.resetBasePositionAndOrientation, self.scale, self.client
        for body, (x_m, y_m, heading_rad, *_) in zip(self.bodies, self.motions(), strict=True):
            half = 0.5 * heading_rad
            turn = 0.0, 0.0, math.sin(half), math.cos(half)
            pose(body, (x_m * scale, y_m * scale, 0.0), turn, physicsClientId=client)
        if self._movers:
            places = self.scene.mover_places() * scale
            for body, (x, y) in zip(self._movers, places.tolist(), strict=True):
                pose(body, (x, y, 0.0), (0.0, 0.0, 0.0, 1.0), physicsClientId=client)

    def cast(self, index: int, rays: list[int]) -> list[float]:
        """Return what share of each of these rays of a robot is free."""
        if len(rays) > BATCH_MAX:
            return self.cast(index, rays[:BATCH_MAX]) + self.cast(index, rays[BATCH_MAX:])
        own = self.bodies[index]
        if self.rays.cross_hull:
            pybullet.setCollisionFilterGroupMask(own, -1, *UNSEEN, physicsClientId=self.client)
        hits = pybullet.rayTestBatch(
            [self.begins[k] for k in rays],
            [self.ends[k] for k in rays],
            parentObjectUniqueId=own,
            physicsClientId=self.client,
        )
        if self.rays.cross_hull:
            pybullet.setCollisionFilterGroupMask(own, -1, *SEEN, physicsClientId=self.client)
        return [free for _, _, free, _, _ in hits]

    def touches(self) -> list[tuple[Thing, Thing]]:
        """Return the pairs of things that PyBullet finds in touch now; the exact instants do not ask it."""
        pybullet.performCollisionDetection(physicsClientId=self.client)
        points = pybullet.getContactPoints(physicsClientId=self.client)
        return [(self._things[one], self._things[other]) for one, other, away in map(_BODIES, points) if away <= 0.0]

    def show(self, dt_s: float) -> None:
        """Wait, so that the window runs in real time."""
        now = time.monotonic()
        self._due = max(getattr(self, "_due", now), now - dt_s) + dt_s
        time.sleep(max(0.0, self._due - now))

    def mark(self, lines: FloatArray, words: Sequence[str]) -> bool:
        """Show what is where now, with lines, dotted, and words above the world; tell whether the window is open.

        Each command waits for a frame of the window: all lines are one, and words that stand there stay.
        """
        bounds, scale, client = self.scene.layout.bounds, self.scale, self.client
        left, top, size = bounds.x_min_m * scale, bounds.y_max_m * scale, (bounds.y_max_m - bounds.y_min_m) * scale
        above = 2.0 * WALL_HEIGHT_RADII * self.robot.radius_m * scale
        along = np.linspace(0.0, 1.0, DOTS)[:, None, None]
        dots = (lines[:, :2] + along * (lines[:, 2:] - lines[:, :2])).reshape(-1, 2) * scale
        dots = np.concatenate([dots, np.zeros((len(dots), 1))], axis=1)
        try:
            self.place()
            if len(dots):
                last = self._marks.get("", -1)
                given = dots.tolist(), [RED] * len(dots), 3.0
                self._marks[""] = pybullet.addUserDebugPoints(*given, replaceItemUniqueId=last, physicsClientId=client)
            for word in [word for word in self._marks if word and word not in words]:
                pybullet.removeUserDebugItem(self._marks.pop(word), physicsClientId=client)
            for row, word in enumerate(words):
                if word not in self._marks:
                    place = left, top + (0.04 + 0.05 * (len(words) - row)) * size, above
                    self._marks[word] = pybullet.addUserDebugText(word, place, BLACK, 1.2, physicsClientId=client)
        except pybullet.error:  # of a window that was closed
            return False
        return bool(pybullet.isConnected(client))

    def _scaled_rays(self, point: str) -> list[Triple]:
        """Return where the rays begin or end."""
        x_m, y_m = (self.rays.table[f"{point}_{axis}_m"] for axis in "xy")
        return [(x, y, 0.0) for x, y in zip((x_m * self.scale).tolist(), (y_m * self.scale).tolist(), strict=True)]

    def _add_box(
        self, thing: Thing, x_m: float, y_m: float, length_m: float, width_m: float, heading_rad: float
    ) -> None:
        s = self.scale
        half = [0.5 * length_m * s, 0.5 * width_m * s, WALL_HEIGHT_RADII * self.robot.radius_m * s]
        shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, physicsClientId=self.client)
        self._add(thing, shape, -1, 0.0, x_m, y_m, heading_rad)

    def _add_round(
        self, thing: Thing, x_m: float, y_m: float, radius_m: float, mass: float, colour: tuple[float, ...]
    ) -> int:
        radius = radius_m * self.scale
        shape = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=radius, physicsClientId=self.client)
        visual = self._unseen
        if self.options.gui:
            visual = pybullet.createVisualShape(
                pybullet.GEOM_CYLINDER, radius=radius, length=radius, rgbaColor=colour, physicsClientId=self.client
            )
        return self._add(thing, shape, visual, mass, x_m, y_m)

    def _add_polygon(self, thing: Thing, row: FloatArray) -> int:
        """Add a polygon by lists that are always the same ones, because PyBullet never lets go of a mesh's."""
        vertices, indices = prism(row * self.scale, WALL_HEIGHT_RADII * self.robot.radius_m * self.scale)
        self._corners += [[] for _ in vertices[len(self._corners) :]]
        self._vertices[:], self._indices[:] = self._corners[: len(vertices)], indices
        for corner, vertex in zip(self._vertices, vertices, strict=True):
            corner[:] = vertex
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            vertices=self._vertices,
            indices=self._indices,
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,  # exact for rays; as a hull it would carry a margin
            physicsClientId=self.client,
        )
        return self._add(thing, shape, -1, 0.0, float(row[0]), float(row[1]))

    def _add(
        self, thing: Thing, shape: int, visual: int, mass: float, x_m: float, y_m: float, heading_rad: float = 0.0
    ) -> int:
        body: int = pybullet.createMultiBody(
            mass,
            shape,
            visual,
            (x_m * self.scale, y_m * self.scale, 0.0),
            (0.0, 0.0, math.sin(0.5 * heading_rad), math.cos(0.5 * heading_rad)),
            physicsClientId=self.client,
        )
        self._things[body] = thing
        return body

    def _look_from_above(self, bounds: Bounds) -> None:
        """Turn the window's camera to the whole world, and hide the window's own panels."""
        b, s, client = bounds, self.scale, self.client
        centre = (0.5 * (b.x_min_m + b.x_max_m) * s, 0.5 * (b.y_min_m + b.y_max_m) * s, 0.0)
        size = max(b.x_max_m - b.x_min_m, b.y_max_m - b.y_min_m) * s
        pybullet.configureDebugVisualizer(pybullet.COV_ENABLE_GUI, 0, physicsClientId=client)
        pybullet.configureDebugVisualizer(pybullet.COV_ENABLE_SHADOWS, 0, physicsClientId=client)
        pybullet.resetDebugVisualizerCamera(size, 0.0, -89.9, centre, physicsClientId=client)


def prism(polygon: FloatArray, half_height_m: float) -> tuple[list[tuple[float, float, float]], list[int]]:
    """Return a polygon's sides as triangles: vertices [m] around its x and y, and three indices a triangle.

    It has no lids, which nothing in the plane could touch.

    Args:
        polygon: (5 + 2 k,) as in ``polygon_table``.
        half_height_m: how far it reaches to either side of the plane [m].
    """
    corners = list(dict.fromkeys(map(tuple, polygon[5:].reshape(-1, 2).tolist())))
    count = len(corners)
    vertices = [(x, y, z) for z in (-half_height_m, half_height_m) for x, y in corners]
    sides = [(k, (k + 1) % count) for k in range(count)]
    return vertices, [i for a, b in sides for i in (a, b, count + b, a, count + b, count + a)]
