"""Whether a simulator misses a contact or misstates an instant: random scenes against an independent, exact checker.

Discs, boxes, walls, convex polygons and movers, round and outlined, stand and drive at random; one to three robots
drive among them by rules that look, that do not look, and that wander. Wheels obey at once, so a robot drives one arc a
control period. From the recorded velocities alone the checker follows these arcs: shapely knows the shapes, movers are
placed from their waypoints, and the least gap and the instant of arrival are found on the arc by bracketing.

Told are, of all robots: how deep one ever was in something before it ended (a missed contact, where that is more than
the bound), how far from touching one ended that is said to have hit something, by how much the instants of arrival are
off, which arrivals were missed, and whether an end changes when something far away moves too.

    python -m benchmarks.soak --scenes 2000 [--simulators planar,pybullet] [--first 0]
"""

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar
from shapely import affinity
from tabulate import tabulate

from benchmarks.field import MAKERS, CompiledRule, PythonRule
from navbench.contract import Command, Controller, Observation, Setup
from navbench.episode.loop import EpisodeRunner
from navbench.episode.similarity import Native
from navbench.episode.starts import Jitter
from navbench.records import RobotRecord
from navbench.robot import Robot
from navbench.sensors import Mount, Sensors
from navbench.simulation.options import SimulatorOptions
from navbench.world.layout import Layout, Start
from navbench.world.shapes import Bounds, Box, Disc, Mover, Point, Polygon, Wall
from navbench.world.world import World

SIDE_M, RADIUS_M, TOLERANCE_M, LIMIT_S, PERIOD_S = 6.0, 0.1, 0.15, 40.0, 0.2
ROBOT = Robot(radius_m=RADIUS_M, track_m=0.15, wheel_speed_max_mps=0.8)
DEEP_RADII = 1e-6  # no overlap deeper than this may go unseen
INSTANT = 1e-9  # of an instant, by which it may be off
ROUNDING_M = 1e-12  # of the distance to the goal at the instant of arrival
SAMPLES = 12  # of each arc, between which the least gap and the arrival are bracketed

FloatArray = NDArray[np.float64]
Gap = Callable[[FloatArray], FloatArray]


class Wander:
    """Drives at random, and looks at nothing."""

    def __init__(self, blindness: float) -> None:
        self._towards = blindness

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Take the stream."""
        self._rng = rng

    def act(self, observation: Observation) -> Command:
        """Return a random turn, more or less towards the goal."""
        x, y, heading = observation.pose
        bearing = math.atan2(observation.goal[1] - y, observation.goal[0] - x)
        turn = math.remainder(bearing - heading, math.tau)
        return Command(float(self._rng.uniform(0.0, 0.6)), self._towards * turn + float(self._rng.normal(0.0, 0.6)))


CONTROLLERS: tuple[Callable[[], Controller], ...] = (
    partial(CompiledRule, 0.0),
    partial(PythonRule, 0.0),
    partial(Wander, 2.0),
    partial(Wander, 0.3),
)


class Finding(NamedTuple):
    """What the checker found of one robot.

    Attributes:
        deep_m: how deep it ever was in something before it ended [m]; below 0 for never.
        off_touch_m: of one that is said to have hit something, how far that was from touching it [m]; else 0.
        arrival: of one that arrived, by what part of the instant it is off; infinite for an arrival that was missed.
        moved: by what part of the instant its end is another when something far away moves; infinite for another end.
    """

    deep_m: float
    off_touch_m: float
    arrival: float
    moved: float


def scene(number: int) -> Layout:
    """Return a random scene."""
    rng = np.random.default_rng([number, 5])
    starts: list[tuple[float, float]] = []
    while len(starts) < 1 + number % 3:
        place = tuple(rng.uniform(0.5, SIDE_M - 0.5, 2).tolist())
        if all(math.dist(place, other) > 0.6 for other in starts):
            starts.append(place)
    goals = rng.uniform(0.3, SIDE_M - 0.3, (len(starts), 2)).tolist()
    free = [(*place, 0.35) for place in starts] + [(x, y, 0.01) for x, y in goals]
    kept: list[Disc | Box | Wall | Polygon] = []
    while len(kept) < 9:
        thing = _thing(rng)
        if all(shape_of(thing).distance(shapely.Point(x, y)) > room for x, y, room in free):
            kept.append(thing)
    movers = [_mover(rng, outlined=k % 2 == 1) for k in range(int(rng.integers(0, 4)))]
    places = [*starts, *map(tuple, goals)]
    movers = [m for m in movers if all(math.dist(m.place(0.0), place) > 0.8 for place in places)]
    return Layout(
        bounds=Bounds.of(SIDE_M, SIDE_M),
        discs=tuple(thing for thing in kept if isinstance(thing, Disc)),
        boxes=tuple(thing for thing in kept if isinstance(thing, Box)),
        walls=tuple(thing for thing in kept if isinstance(thing, Wall)),
        polygons=tuple(thing for thing in kept if isinstance(thing, Polygon)),
        movers=tuple(movers),
        starts=tuple(Start(x, y, float(rng.uniform(-math.pi, math.pi))) for x, y in starts),
        goals=tuple(Point(x, y) for x, y in goals),
    )


def _thing(rng: np.random.Generator) -> Disc | Box | Wall | Polygon:
    kind = ("discs", "boxes", "walls", "polygons")[rng.integers(4)]
    x, y = rng.uniform(0.6, SIDE_M - 0.6, 2).tolist()
    if kind == "discs":
        return Disc(x, y, float(rng.uniform(0.02, 0.4)))
    if kind == "boxes":
        length, width = rng.uniform(0.05, 0.8, 2).tolist()
        return Box(x, y, length, width, float(rng.uniform(-math.pi, math.pi)))
    if kind == "walls":
        turn, half = rng.uniform(0.0, math.pi), rng.uniform(0.1, 0.6)
        dx, dy = half * math.cos(turn), half * math.sin(turn)
        return Wall(x - dx, y - dy, x + dx, y + dy, float(rng.uniform(0.01, 0.1)))
    return Polygon(corners=tuple(Point(x + p.x_m, y + p.y_m) for p in _around(rng)))


def _around(rng: np.random.Generator) -> list[Point]:
    """Return the corners of a convex polygon on a circle, whose centre it holds."""
    count, radius = int(rng.integers(3, 8)), rng.uniform(0.1, 0.4)
    turns = (np.arange(count) + rng.uniform(-0.2, 0.2, count)) * math.tau / count
    return [Point(radius * math.cos(a), radius * math.sin(a)) for a in turns.tolist()]


def _mover(rng: np.random.Generator, outlined: bool) -> Mover:
    count, cyclic = int(rng.integers(2, 5)), bool(rng.integers(2))
    outline = tuple(_around(rng)) if outlined else ()
    radius = max((math.hypot(p.x_m, p.y_m) for p in outline), default=float(rng.uniform(0.05, 0.3)))
    return Mover(
        radius_m=radius,
        waypoints=tuple(Point(*rng.uniform(0.5, SIDE_M - 0.5, 2).tolist()) for _ in range(count)),
        speeds_mps=tuple(rng.uniform(0.1, 0.7, count if cyclic else count - 1).tolist()),
        cyclic=cyclic,
        phase_s=float(rng.uniform(0.0, 10.0)),
        outline=outline,
    )


def shape_of(thing: Disc | Box | Wall | Polygon) -> shapely.Geometry:
    """Return what shapely makes of a thing; of a disc its centre."""
    if isinstance(thing, Disc):
        return shapely.Point(thing.x_m, thing.y_m).buffer(thing.radius_m)
    if isinstance(thing, Polygon):
        return shapely.Polygon([(p.x_m, p.y_m) for p in thing.corners])
    if isinstance(thing, Wall):
        length = math.dist((thing.x1_m, thing.y1_m), (thing.x2_m, thing.y2_m))
        turn = math.atan2(thing.y2_m - thing.y1_m, thing.x2_m - thing.x1_m)
        middle = 0.5 * (thing.x1_m + thing.x2_m), 0.5 * (thing.y1_m + thing.y2_m)
        return _rectangle(*middle, length, thing.thickness_m, turn)
    return _rectangle(thing.x_m, thing.y_m, thing.length_m, thing.width_m, thing.heading_rad)


def _rectangle(x: float, y: float, length: float, width: float, turn: float) -> shapely.Geometry:
    flat = shapely.box(-0.5 * length, -0.5 * width, 0.5 * length, 0.5 * width)
    return affinity.translate(affinity.rotate(flat, turn, origin=(0.0, 0.0), use_radians=True), x, y)


def place_of(mover: Mover, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return where a mover is at some instants, walked along its waypoints: x and y [m]."""
    points = [(p.x_m, p.y_m) for p in mover.waypoints]
    speeds = list(mover.speeds_mps)
    round_trip = [*points, points[0]] if mover.cyclic else [*points, *points[-2::-1]]
    speeds = speeds if mover.cyclic else [*speeds, *speeds[::-1]]
    lengths = [math.dist(a, b) for a, b in zip(round_trip, round_trip[1:], strict=False)]
    at = np.concatenate([[0.0], np.cumsum(np.array(lengths) / speeds)])
    left = (times_s + mover.phase_s) % at[-1]
    x, y = np.array(round_trip).T
    return np.interp(left, at, x), np.interp(left, at, y)


class Path:
    """Where a robot is at any instant, from the pose and velocities at the beginning of each control period."""

    def __init__(self, record: RobotRecord) -> None:
        self.states, self.end_s = record.states, float(record.states[-1, 0])

    def at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return x and y at some instants [m]; after its end it stands there."""
        k = np.maximum(np.searchsorted(self.states[:-1, 0], times_s, side="right") - 1, 0)
        begin, x, y, heading, v, w = self.states[k].T
        tau = np.minimum(times_s, self.end_s) - begin
        half = 0.5 * w * tau
        chord = v * tau * np.sinc(half / math.pi)
        return x + chord * np.cos(heading + half), y + chord * np.sin(heading + half)


def gaps_of(layout: Layout, paths: Sequence[Path], index: int) -> list[Gap]:
    """Return functions of instants: from a robot's hull to each thing, and to each other robot [m]."""
    path = paths[index]

    def to_disc(x_m: float, y_m: float, radius_m: float, times_s: FloatArray) -> FloatArray:
        x, y = path.at(times_s)
        return np.hypot(x - x_m, y - y_m) - radius_m - RADIUS_M

    def to_shape(shape: shapely.Geometry, times_s: FloatArray) -> FloatArray:
        return _outside(shape, *path.at(times_s))

    def to_mover(mover: Mover, times_s: FloatArray) -> FloatArray:
        (x, y), (mx, my) = path.at(times_s), place_of(mover, times_s)
        if not mover.outline:
            return np.hypot(x - mx, y - my) - mover.radius_m - RADIUS_M
        return _outside(shapely.Polygon([(p.x_m, p.y_m) for p in mover.outline]), x - mx, y - my)

    def to_robot(other: Path, times_s: FloatArray) -> FloatArray:
        (x, y), (ox, oy) = path.at(times_s), other.at(times_s)
        return np.hypot(x - ox, y - oy) - 2.0 * RADIUS_M

    solid: list[Box | Wall | Polygon] = [*layout.boxes, *layout.walls, *layout.polygons]
    return [
        *(partial(to_disc, disc.x_m, disc.y_m, disc.radius_m) for disc in layout.discs),
        *(partial(to_shape, shape_of(thing)) for thing in solid),
        *(partial(to_mover, mover) for mover in layout.movers),
        *(partial(to_robot, other) for k, other in enumerate(paths) if k != index),
    ]


def _outside(shape: shapely.Geometry, x: FloatArray, y: FloatArray) -> FloatArray:
    distances: FloatArray = shapely.distance(shape, shapely.points(x, y)) - RADIUS_M
    return distances


def least_gap(gap: Gap, end_s: float, closing_mps: float) -> float:
    """Return the least value of a gap from 0 to an end, exact where it may be below 0.

    Args:
        gap: the gap.
        end_s: the end [s].
        closing_mps: how much of it is lost in a second at most [m/s].
    """
    times = _instants(end_s)
    values = gap(times)
    least = float(values.min())
    for k in np.flatnonzero(np.minimum(values[:-1], values[1:]) < closing_mps * np.diff(times)):
        found = minimize_scalar(
            lambda t_s: float(gap(np.array([t_s]))[0]),
            bounds=(times[k], times[k + 1]),
            method="bounded",
            options={"xatol": 1e-12},
        )
        least = min(least, float(found.fun))
    return least


def arrival_s(path: Path, goal: Point) -> float:
    """Return when a robot first comes within the tolerance of its goal [s]; infinite where it never does."""

    def away(times_s: FloatArray) -> FloatArray:
        x, y = path.at(times_s)
        return np.hypot(x - goal.x_m, y - goal.y_m) - TOLERANCE_M

    times = _instants(path.end_s)
    there = np.flatnonzero(away(times) <= ROUNDING_M)
    if not len(there) or there[0] == 0:
        return 0.0 if len(there) else math.inf
    end = float(times[there[0]])
    if away(np.array([end]))[0] > 0.0:
        return end
    return float(brentq(lambda t_s: float(away(np.array([t_s]))[0]), float(times[there[0] - 1]), end, xtol=1e-14))


def _instants(end_s: float) -> FloatArray:
    """Return instants of which SAMPLES lie in each control period, its ends among them."""
    periods = np.append(np.arange(0.0, end_s, PERIOD_S), end_s)
    parts = np.linspace(0.0, 1.0, SAMPLES, endpoint=False)
    return np.append((periods[:-1, None] + parts * np.diff(periods)[:, None]).ravel(), end_s)


def run(layout: Layout, number: int, simulator: str) -> list[RobotRecord]:
    """Drive in a scene."""
    turns = np.linspace(0.0, math.tau, 16, endpoint=False).tolist()
    mounts = tuple(
        Mount(role=str(i), x_m=RADIUS_M * math.cos(a), y_m=RADIUS_M * math.sin(a), heading_rad=a)
        for i, a in enumerate(turns)
    )
    runner = EpisodeRunner(
        make_controller=CONTROLLERS[number % len(CONTROLLERS)],
        make_simulator=partial(MAKERS[simulator], SimulatorOptions()),
        native=Native(ROBOT, PERIOD_S),
        world=World(name="soak", source=layout, goal_tolerance_m=TOLERANCE_M, time_limit_s=LIMIT_S),
        robot=ROBOT,
        sensors=Sensors(drawn_for_radius_m=RADIUS_M, mounts=mounts, max_range_m=3.0),
        seed=number,
        jitter=Jitter(),
    )
    with runner:
        return runner.run(0)


def check(number: int, simulator: str) -> list[Finding]:
    """Return what the checker finds of each robot of a scene."""
    layout = scene(number)
    records = run(layout, number, simulator)
    far = Mover(radius_m=0.1, waypoints=(Point(1e3, 1e3), Point(1e3, 1e3 + 9.0)), speeds_mps=(2.0,))
    again = run(replace(layout, movers=(*layout.movers, far)), number, simulator)
    paths = [Path(record) for record in records]
    closing = 2.0 * 0.8 + max((max(mover.speeds_mps) for mover in layout.movers), default=0.0)
    found = []
    for i, (record, other) in enumerate(zip(records, again, strict=True)):
        gaps, end_s = gaps_of(layout, paths, i), paths[i].end_s
        hit = record.outcome == "collided"
        arrived = arrival_s(paths[i], layout.goals[i])
        told = end_s if record.outcome == "reached" else math.inf
        found.append(
            Finding(
                deep_m=max((-least_gap(gap, end_s, closing) for gap in gaps), default=-math.inf),
                off_touch_m=abs(min(float(gap(np.array([end_s]))[0]) for gap in gaps)) if hit else 0.0,
                arrival=_apart(arrived, told),
                moved=_apart(end_s, float(other.states[-1, 0])) if record.outcome == other.outcome else math.inf,
            )
        )
    return found


def _apart(one_s: float, other_s: float) -> float:
    """Return by what part of the earlier of two instants they differ; of one in the first period, of the period."""
    return 0.0 if one_s == other_s else abs(one_s - other_s) / max(min(one_s, other_s), PERIOD_S)


def row(simulator: str, findings: Sequence[Finding]) -> tuple[list[str], bool]:
    """Return a simulator's row, and whether all is well."""
    deep = max(finding.deep_m for finding in findings) / RADIUS_M
    off = max(finding.off_touch_m for finding in findings) / RADIUS_M
    late = max(finding.arrival for finding in findings)
    missed = sum(finding.deep_m > DEEP_RADII * RADIUS_M for finding in findings)
    moved = max(finding.moved for finding in findings)
    hits = sum(finding.off_touch_m > 0.0 for finding in findings)
    told = [
        simulator,
        str(len(findings)),
        str(hits),
        str(missed),
        f"{deep:.1e}",
        f"{off:.1e}",
        f"{late:.1e}",
        f"{moved:.1e}",
    ]
    return told, missed == 0 and off <= DEEP_RADII and late <= INSTANT and moved <= INSTANT


def main() -> None:
    """Check the scenes of the command line, and exit with 1 where something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="the number of the first scene")
    parser.add_argument("--simulators", default="planar,pybullet")
    given = parser.parse_args()
    rows, well = [], True
    for simulator in given.simulators.split(","):
        findings = []
        for number in range(given.first, given.first + given.scenes):
            for finding in check(number, simulator):
                findings.append(finding)
                if finding.deep_m > DEEP_RADII * RADIUS_M or max(finding.arrival, finding.moved) > INSTANT:
                    print(f"scene {number}, {simulator}: {finding}", file=sys.stderr)
        told, is_well = row(simulator, findings)
        rows.append(told)
        well &= is_well
    head = ["simulator", "robots", "hit something", "missed contacts", "deepest [radii]", "off touch [radii]"]
    print(tabulate(rows, [*head, "arrival off by", "what is far shifts ends by"], disable_numparse=True))
    sys.exit(not well)


if __name__ == "__main__":
    main()
