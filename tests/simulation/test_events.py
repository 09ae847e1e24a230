"""Arrival and contact come at their instants on the arcs: the first roots that a fine grid and bisection find.

The truth is made of circles and of distances to centres and edges, as complex numbers, in metres.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from scenes import BLIND, BLOCK, IDEAL, RADII, a_robot, a_world, drive, to_and_fro
from scipy.optimize import brentq, minimize_scalar

from navbench.contract import Pose
from navbench.records import Thing
from navbench.robot import Robot
from navbench.simulation.base import Simulator
from navbench.simulation.bullet import BulletSimulator
from navbench.simulation.contacts import Event
from navbench.simulation.options import SimulatorOptions
from navbench.world.generators.polygons import convex_corners
from navbench.world.layout import DrawnWorld, FinishLine, Start
from navbench.world.shapes import Box, Disc, Point, Polygon, Wall

Motion = tuple[Pose, float, float]  # where a robot starts, v [m/s], w [rad/s]
Gap = Callable[[Any], Any]  # of an instant, or of many [s]: how far something is from touching [m]
PERIODS_S = (0.02, 0.1, 0.37, 2.0)


class Bare(Simulator):
    """What every simulator shares, without an engine."""

    def build(self) -> None: ...

    def place(self) -> None: ...

    def cast(self, index: int, rays: list[int]) -> list[float]:
        raise AssertionError("no contact asks for a ray")


def simulated(
    world: DrawnWorld, robot: Robot, poses: Sequence[Pose], options: SimulatorOptions = IDEAL, kind: Any = Bare
) -> Simulator:
    simulator: Simulator = kind(options, robot, BLIND, robot.wheel_accel_max_mps2)
    simulator.reset(world, poses, world.goal_tolerance_m)
    return simulator


def driven(
    world: DrawnWorld, robot: Robot, poses: Sequence[Pose], commands: Sequence[tuple[float, float]], period_s: float,
    end_s: float,
) -> tuple[Simulator, list[Event]]:  # fmt: skip
    """Drive each robot by a command of its own for at least this long, and return how the robots ended."""
    simulator, events = simulated(world, robot, poses), []
    for k in range(math.ceil(end_s / period_s)):
        for i, command in enumerate(commands):
            simulator.command(i, *command)
        events += simulator.advance(k * period_s, period_s)
    return simulator, events


def circle(pose: Pose, v: float, w: float, t: Any) -> Any:
    """Return where a robot is at an instant, or at many, by its circle's formula."""
    if w == 0.0:
        return complex(pose.x_m, pose.y_m) + v * t * np.exp(1j * pose.heading_rad)
    centre = complex(pose.x_m, pose.y_m) + 1j * v / w * np.exp(1j * pose.heading_rad)
    return centre - 1j * v / w * np.exp(1j * (pose.heading_rad + w * t))


def to_edges(p: Any, corners: Sequence[complex]) -> Any:
    """Return the distance from a point, or from many, to the nearest edge of a convex polygon, negative inside."""
    a, b = np.array(corners), np.roll(np.array(corners), -1)
    q = np.asarray(p)[..., None]
    along = np.clip(((q - a) / (b - a)).real, 0.0, 1.0)
    sides = ((b - a).conj() * (q - a)).imag
    inside = (sides > 0.0).all(axis=-1) | (sides < 0.0).all(axis=-1)
    return np.where(inside, -1.0, 1.0) * np.abs(q - a - along * (b - a)).min(axis=-1)


def first_root(gap: Gap, end_s: float, n: int = 4000) -> float:
    """Return when a gap first closes, infinity for never: at a change of its sign on a grid, or below a low there."""
    times = np.linspace(0.0, end_s, n + 1)
    gaps = gap(times)
    lows = [k for k in range(1, n) if gaps[k] <= min(gaps[k - 1], gaps[k + 1]) and gaps[k] > 0.0]
    steepest = np.abs(np.diff(gaps)).max()
    closed = np.flatnonzero(gaps <= 0.0)
    candidates = [(times[closed[0] - 1], times[closed[0]])] if len(closed) else []
    for k in lows:
        if gaps[k] <= 2.0 * steepest:
            low = minimize_scalar(gap, bounds=(times[k - 1], times[k + 1]), options={"xatol": 1e-12}, method="bounded")
            if low.fun <= 0.0:
                candidates.append((times[k - 1], low.x))
    return min((float(brentq(gap, a, b, xtol=1e-15, rtol=1e-15)) for a, b in candidates), default=math.inf)


def rectangle(length: float, width: float) -> list[complex]:
    return [complex(0.5 * a * length, 0.5 * b * width) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]


def place_of(simulator: Simulator, index: int = 0) -> complex:
    state = simulator.states()[index]
    return complex(state.x_m, state.y_m)


def at(z: complex) -> dict[str, float]:
    return {"x_m": float(z.real), "y_m": float(z.imag)}


Described = tuple[dict[str, Any], Callable[[Any, Any], Any]]  # in a world; how far a point is at an instant


def a_thing(kind: str, rng: np.random.Generator, place: complex, velocity: complex, r: float) -> Described:
    """Return a thing that is at a place at time 0, and there for ever unless it moves."""
    size, width = (r * 10.0 ** rng.uniform(-1.5, 0.5, 2)).tolist()
    turn = rng.uniform(-4.0, 4.0)
    outline = convex_corners(rng, size, (3, 6))
    shape = [complex(corner.x_m, corner.y_m) for corner in outline]
    far = place + 1e4 * velocity
    leg = ((place.real, place.imag), (far.real, far.imag))
    if kind == "disc":
        return {"discs": (Disc(**at(place), radius_m=size),)}, lambda t, p: np.abs(p - place) - size
    if kind == "moving disc":
        mover = to_and_fro(*leg, speeds=[abs(velocity)], radius_m=size)
        return {"movers": (mover,)}, lambda t, p: np.abs(p - place - velocity * t) - size
    if kind == "moving polygon":
        mover = to_and_fro(*leg, speeds=[abs(velocity)], radius_m=size, outline=outline)
        return {"movers": (mover,)}, lambda t, p: to_edges(p - place - velocity * t, shape)
    if kind == "polygon":
        corners = [place + corner for corner in shape]
        parts = {"polygons": (Polygon(corners=tuple(Point(**at(corner)) for corner in corners)),)}
        return parts, lambda t, p: to_edges(p, corners)
    corners = [place + corner * np.exp(1j * turn) for corner in rectangle(size, width)]
    if kind == "box":
        box = Box(**at(place), length_m=size, width_m=width, heading_rad=turn)
        return {"boxes": (box,)}, lambda t, p: to_edges(p, corners)
    half = 0.5 * size * np.exp(1j * turn)
    (x1, y1), (x2, y2) = (tuple(at(place + end).values()) for end in (-half, half))
    return {"walls": (Wall(x1, y1, x2, y2, width),)}, lambda t, p: to_edges(p, corners)


def a_motion(rng: np.random.Generator, r: float) -> Motion:
    """Return a start, a speed and a turning rate: forward or backward, straight or along an arc."""
    v = r * rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-0.5, 1.0)
    x, y = (rng.uniform(-5.0, 5.0, 2) * r).tolist()
    return Pose(x, y, rng.uniform(-3.0, 3.0)), v, rng.choice([0.0, rng.uniform(-2.0, 2.0)])


@pytest.mark.parametrize("radius_m", RADII)
@pytest.mark.parametrize("kind", ["disc", "box", "wall", "polygon", "moving disc", "moving polygon"])
def test_a_robot_hits_a_thing_at_the_first_instant_at_which_the_gap_closes(kind: str, radius_m: float) -> None:
    rng = np.random.default_rng(31)
    r, hits, robot = radius_m, 0, a_robot(radius_m, 20.0 * radius_m)
    for _ in range(50):
        pose, v, w = a_motion(rng, r)
        velocity = r * rng.uniform(0.2, 6.0) * np.exp(1j * rng.uniform(-3.0, 3.0)) if "moving" in kind else 0j
        meet = rng.uniform(0.5, 3.5)
        offset = r * rng.uniform(0.0, 1.5) * np.exp(1j * rng.uniform(-3.0, 3.0))
        place = complex(circle(pose, v, w, meet) + offset - velocity * meet)
        parts, away = a_thing(kind, rng, place, velocity, r)

        def gap(t: Any, away: Any = away, pose: Pose = pose, v: float = v, w: float = w) -> Any:
            return away(t, circle(pose, v, w, t)) - r

        if gap(0.0) <= 0.01 * r:
            continue
        when = first_root(gap, 4.0)
        simulator, events = driven(a_world(**parts), robot, [pose], [(v, w)], float(rng.choice(PERIODS_S)), 4.0)
        assert len(events) == (when < 4.0)
        if events:
            assert events[0].outcome == "collided"
            assert events[0].t_s == pytest.approx(when, rel=1e-9)
            assert abs(place_of(simulator) - circle(pose, v, w, when)) < 1e-9 * r
            hits += 1
    assert hits >= 20


@pytest.mark.parametrize("radius_m", RADII)
def test_two_robots_on_arcs_meet_at_the_first_instant_at_which_their_hulls_do(radius_m: float) -> None:
    rng = np.random.default_rng(32)
    r, hits, robot = radius_m, 0, a_robot(radius_m, 20.0 * radius_m)
    for _ in range(80):
        (one, v1, w1), (other, v2, w2) = a_motion(rng, r), a_motion(rng, r)
        meet = rng.uniform(0.5, 3.5)
        shift = circle(one, v1, w1, meet) - circle(other, v2, w2, meet)
        shift += 2.0 * r * rng.uniform(0.0, 1.1) * np.exp(1j * rng.uniform(-3.0, 3.0))
        other = Pose(other.x_m + shift.real, other.y_m + shift.imag, other.heading_rad)

        def gap(t: Any, one: Motion = (one, v1, w1), other: Motion = (other, v2, w2)) -> Any:
            return np.abs(circle(*one, t) - circle(*other, t)) - 2.0 * r

        if gap(0.0) <= 0.01 * r:
            continue
        when = first_root(gap, 4.0)
        world = a_world(starts=tuple(Start(pose.x_m, pose.y_m, 0.0) for pose in (one, other)))
        period_s = float(rng.choice(PERIODS_S))
        simulator, events = driven(world, robot, [one, other], [(v1, w1), (v2, w2)], period_s, 4.0)
        assert [event.hit for event in events] == [Thing("robot", 1), Thing("robot", 0)] * (when < 4.0)
        if events:
            assert events[0].t_s == events[1].t_s == pytest.approx(when, rel=1e-9)
            assert abs(place_of(simulator, 1) - circle(other, v2, w2, when)) < 1e-9 * r
            hits += 1
    assert hits >= 40


@pytest.mark.parametrize("radius_m", RADII)
@pytest.mark.parametrize("shape", ["disc", "corner", "face"])
def test_what_grazes_the_swept_hull_is_found_and_what_misses_it_is_not(shape: str, radius_m: float) -> None:
    """A post's nearest point lies across the path, by so much inside the hull's edge as it passes, or beyond it."""
    rng = np.random.default_rng(33)
    r, robot = radius_m, a_robot(radius_m, 20.0 * radius_m)
    for _ in range(150):
        pose, v, w = a_motion(rng, r)
        if w == 0.0 and shape == "face":
            continue
        size, side = r * 10.0 ** rng.uniform(-3.0, 0.3), rng.choice([-1.0, 1.0])
        inner = w != 0.0 and side * v * w > 0.0  # on the side of the arc's centre
        if inner and (shape == "face" or abs(v / w) < 1.1 * r + 2.0 * size):
            continue
        meet, overlap = (
            rng.uniform(0.2, 3.5),
            rng.choice([10.0 ** rng.uniform(-6.0, -2.0), -(10.0 ** rng.uniform(-9.0, -2.0))]),
        )
        across = 1j * side * np.exp(1j * (pose.heading_rad + w * meet))
        nearest = circle(pose, v, w, meet) + across * r * (1.0 - overlap)
        if abs(nearest - complex(pose.x_m, pose.y_m)) < 1.1 * r or (w and abs(w) * 3.7 > 6.0 and shape == "face"):
            continue
        if shape == "disc":
            parts: dict[str, Any] = {"discs": (Disc(**at(nearest + across * size), radius_m=size),)}
        else:
            half, turn = (size, 0.0) if shape == "face" else (math.sqrt(2.0) * size, 0.25 * math.pi)
            heading = float(np.angle(across)) + turn
            parts = {
                "boxes": (Box(**at(nearest + across * half), length_m=2 * size, width_m=2 * size, heading_rad=heading),)
            }
        simulator, events = driven(a_world(**parts), robot, [pose], [(v, w)], float(rng.choice(PERIODS_S)), meet + 0.1)
        assert len(events) == (overlap > 0.0), (overlap, w)
        if events:
            assert abs(abs(place_of(simulator) - circle(pose, v, w, events[0].t_s))) < 1e-9 * r
            assert events[0].t_s < meet


@pytest.mark.parametrize("radius_m", RADII)
@pytest.mark.parametrize("gap_radii", [1e-9, 1e-6, 1e-3])
def test_a_robot_that_circles_a_post_or_its_goal_as_near_as_that_neither_hits_nor_arrives(
    gap_radii: float, radius_m: float
) -> None:
    r = radius_m
    post = {"discs": (Disc(0.0, 0.0, 2.0 * r),)}
    away_m = r * (3.0 + gap_radii)
    pose, v, w = Pose(away_m, 0.0, 0.5 * math.pi), r, r / away_m
    assert driven(a_world(**post), a_robot(r, 2.0 * r), [pose], [(v, w)], 0.5, 30.0)[1] == []
    goal = {"goals": (Point(0.0, 0.0),), "goal_tolerance_m": 3.0 * r}
    assert driven(a_world(**goal), a_robot(r, 2.0 * r), [pose], [(v, w)], 0.5, 30.0)[1] == []


@pytest.mark.parametrize("speed_mps", [0.01, 0.05, 0.2, 0.21, 1.0, 5.0])
@pytest.mark.parametrize("period_s", [0.05, 0.1, 1.0])
def test_a_goals_disc_that_begins_5_mm_before_a_box_is_reached_at_every_speed(
    speed_mps: float, period_s: float
) -> None:
    world = a_world(
        boxes=(Box(2.0, 0.0, 1.0, 1.0),), goals=(Point(1.4, 0.0),), goal_tolerance_m=1.4 - (1.5 - 0.2 - 0.005)
    )
    _, (event,) = driven(world, a_robot(0.2, speed_mps), [Pose(0.0, 0.0, 0.0)], [(speed_mps, 0.0)], period_s, 200.0)
    assert event.outcome == "reached"
    assert event.t_s == pytest.approx(1.295 / speed_mps, rel=1e-12)


def crowd(r: float) -> dict[str, Any]:
    """Return movers, round and outlined, that are far away, fast, and turn often."""
    shape = tuple(Point(0.3 * r * x, 0.3 * r * y) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1)))
    return {
        "movers": (
            to_and_fro((-900.0, 900.0), (-900.0 + r, 900.0), speeds=[17.3 * r], radius_m=r),
            to_and_fro((-900.0, 700.0), (-900.0, 700.0 + 2 * r), speeds=[9.1 * r], radius_m=r, outline=shape),
        )
    }


@pytest.mark.parametrize("radius_m", RADII)
@pytest.mark.parametrize("ends", ["collided", "reached"])
def test_an_end_depends_neither_on_the_period_nor_on_what_happens_far_away(ends: str, radius_m: float) -> None:
    rng = np.random.default_rng(34)
    r, robot = radius_m, a_robot(radius_m, 20.0 * radius_m)
    for _ in range(20):
        pose, v, w = a_motion(rng, r)
        ahead = complex(circle(pose, v, w, rng.uniform(1.0, 3.0)))
        if abs(ahead - complex(pose.x_m, pose.y_m)) < 2.0 * r:
            continue
        goal = Point(**at(ahead)) if ends == "reached" else Point(500.0, 500.0)
        parts: dict[str, Any] = {"goal_tolerance_m": 0.3 * r, "goals": (goal,)}
        if ends == "collided":
            parts["discs"] = (Disc(**at(ahead), radius_m=0.5 * r),)
        found = [driven(a_world(**parts), robot, [pose], [(v, w)], period_s, 4.0) for period_s in PERIODS_S]
        parts["goals"] = (goal, Point(500.0, -500.0))
        parts["starts"] = (Start(0.0, 0.0, 0.0), Start(-900.0, -900.0, 0.0))
        poses, commands = [pose, Pose(-900.0, -900.0, 0.0)], [(v, w), (7.7 * r, 0.3)]
        beside = [driven(a_world(**parts, **crowd(r)), robot, poses, commands, period_s, 4.0) for period_s in PERIODS_S]
        for (alone, (event,)), (together, (same, *_)) in zip(found, beside, strict=True):
            assert event.outcome == ends
            assert event.t_s == pytest.approx(found[0][1][0].t_s, abs=1e-9)
            assert same == event
            assert place_of(together) == place_of(alone)


@pytest.mark.parametrize("radius_m", RADII)
def test_a_finish_line_is_crossed_at_the_root_of_the_side_on_which_the_centre_lies(radius_m: float) -> None:
    rng = np.random.default_rng(35)
    r, reached, robot = radius_m, 0, a_robot(radius_m, 20.0 * radius_m)
    for _ in range(60):
        pose, v, w = a_motion(rng, r)
        a = complex(circle(pose, v, w, rng.uniform(0.5, 3.0)) + r * rng.normal() + 1j * r * rng.normal())
        b = a + 3.0 * r * np.exp(1j * rng.uniform(-3.0, 3.0))

        def side(t: Any, a: complex = a, b: complex = b, motion: Motion = (pose, v, w)) -> Any:
            return (np.conj(b - a) * (circle(*motion, t) - a)).imag / abs(b - a)

        times = np.linspace(0.0, 4.0, 4001)
        changes = np.flatnonzero(np.diff(np.sign(side(times)))).tolist()
        roots = [float(brentq(side, times[k], times[k + 1], xtol=1e-15, rtol=1e-15)) for k in changes]
        between = [((circle(pose, v, w, root) - a) / (b - a)).real for root in roots]
        when = min((root for root, along in zip(roots, between, strict=True) if 0.0 <= along <= 1.0), default=math.inf)
        world = a_world(
            starts=(Start(-900.0, 0.0, 0.0),),
            goals=(Point(900.0, 0.0),),
            finish_line=FinishLine(0.0, -999.0, 0.0, 999.0),
        )
        simulator = simulated(world, robot, [pose])
        simulator.scene.finish_line[:] = a_world(walls=(Wall(a.real, a.imag, b.real, b.imag, 1.0),)).box_rows()
        simulator.scene.finish_line[:, 3] = 0.0
        events = drive(simulator, [(v, w)] * 40, 0.1)
        assert [event.outcome for event in events] == ["reached"] * (when < 4.0)
        if events:
            assert events[0].t_s == pytest.approx(when, rel=1e-9)
            reached += 1
    assert reached > 20


@pytest.mark.parametrize("radius_m", RADII)
@pytest.mark.parametrize("outlined", [False, True])
def test_a_mover_that_turns_within_a_substep_hits_on_its_new_leg_or_never(outlined: bool, radius_m: float) -> None:
    """It comes to a point beside a robot that stands, and drives on into it, or back, or away."""
    rng = np.random.default_rng(36)
    r, robot = radius_m, a_robot(radius_m, radius_m)
    half = 0.2 * r
    square = tuple(Point(half * x, half * y) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1)))
    for _ in range(40):
        gap, speeds = r * 10.0 ** rng.uniform(-9.0, -1.0), (r * rng.uniform(0.3, 9.0, 2)).tolist()
        touch = r + half + gap  # in line with the robot, both shapes are as wide
        legs = rng.uniform(1.0, 5.0) * r, rng.uniform(1.0, 5.0) * r
        turn_s = legs[0] / speeds[0]
        begin = complex(touch, 0.0) + legs[0] * np.exp(1j * rng.uniform(-1.5, 1.5))
        for towards, hits in ((-1.0, True), (1.0, False)):
            end = complex(touch + towards * legs[1], 0.0)
            points = [(begin.real, begin.imag), (touch, 0.0), (end.real, 0.0)]
            shape = {"radius_m": half * math.sqrt(2.0), "outline": square} if outlined else {"radius_m": half}
            mover = to_and_fro(*points, speeds=speeds, **shape)
            period_s, end_s = float(rng.choice(PERIODS_S)), turn_s + gap / speeds[1] + 0.3
            world = a_world(movers=(mover,))
            _, events = driven(world, robot, [Pose(0.0, 0.0, 0.0)], [(0.0, 0.0)], period_s, end_s)
            assert len(events) == hits
            if hits:
                assert events[0].t_s == pytest.approx(turn_s + gap / speeds[1], abs=2e-9)


def test_a_blocked_robot_touches_a_mover_that_glances_off_it_until_that_is_away_by_a_millionth_of_a_radius() -> None:
    """The mover turns where it has gone in by 0.02 m, and leaves."""
    for leaves_mps in (0.5, 0.09):
        mover = to_and_fro((2.13, 0.0), (1.98, 0.0), (9.0, 0.0), speeds=[1.0, leaves_mps], radius_m=1.0)
        simulator = simulated(a_world(movers=(mover,)), a_robot(), [Pose(0.0, 0.0, 0.0)], BLOCK)
        gone_s = 0.15 + 0.02 / leaves_mps
        for k in range(8):
            drive(simulator, [(0.0, 0.0)], 0.05, first_period=k)
            now = 0.05 * (k + 1)
            assert simulator.touching == [0.13 <= now <= gone_s]
        assert [count.total for count in simulator.contacts] == [1]


def test_a_touch_that_begins_and_ends_within_a_substep_is_counted_and_over() -> None:
    mover = to_and_fro((2.01, 0.0), (1.99, 0.0), (9.0, 0.0), speeds=[1.0, 1.0], radius_m=1.0)
    simulator = simulated(a_world(movers=(mover,)), a_robot(), [Pose(0.0, 0.0, 0.0)], BLOCK)
    for k, count in ((0, 1), (1, 1)):
        drive(simulator, [(0.0, 0.0)], 0.2, first_period=k)
        assert simulator.touching == [False]
        assert simulator.contacts[0] == (count, 0, 1)


@pytest.mark.parametrize("radius_m", RADII)
@pytest.mark.parametrize("kind", ["disc", "box", "wall", "polygon", "moving disc", "moving polygon"])
def test_pybullet_finds_in_touch_what_is_a_hair_deeper_and_not_what_is_a_hair_away(kind: str, radius_m: float) -> None:
    """Of polygons not the tiniest, at whose triangles PyBullet finds a contact that is up to 0.02 radii late."""
    rng = np.random.default_rng(37)
    r, robot, asked = radius_m, a_robot(radius_m, 20.0 * radius_m), 0
    while asked < 5:
        pose, v, w = a_motion(rng, r)
        velocity = r * rng.uniform(0.2, 6.0) * np.exp(1j * rng.uniform(-3.0, 3.0)) if "moving" in kind else 0j
        place = complex(circle(pose, v, w, 2.0) - 2.0 * velocity)
        parts, away = a_thing(kind, rng, place, velocity, r)
        simulator, events = driven(a_world(**parts), robot, [pose], [(v, w)], 0.1, 3.0)
        tiny = "polygon" in kind and -float(away(0.0, place)) < 0.05 * r
        if tiny or not events or away(0.0, complex(pose.x_m, pose.y_m)) < 1.01 * r:
            continue
        found, t_s, step = place_of(simulator), events[0].t_s, 1e-6 * r
        grows = [float(away(t_s, found + turn * step) - away(t_s, found - turn * step)) for turn in (1.0, 1j)]
        outward = complex(*grows) / abs(complex(*grows))
        for radii, touches in ((1e-3, []), (-1e-3, [{Thing("robot", 0), events[0].hit}])):
            there = found + radii * r * outward
            with simulated(
                a_world(**parts), robot, [Pose(there.real, there.imag, 0.0)], kind=BulletSimulator
            ) as bullet:
                assert isinstance(bullet, BulletSimulator)
                bullet.scene.move_to(t_s)
                bullet.place()
                assert [{*pair} for pair in bullet.touches()][:1] == touches
        asked += 1
