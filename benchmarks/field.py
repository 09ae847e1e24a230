"""The field that all simulators drive in: robots circle a field of discs, each with 16 rays of 3 m, and never end."""

import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from itertools import count, islice

import numpy as np

from navbench.contract import Command, Controller, FloatArray, Observation, Setup
from navbench.episode.loop import EpisodeRunner
from navbench.episode.similarity import Native
from navbench.episode.starts import Jitter
from navbench.mathematics.geometry import wrap_angle
from navbench.policy import CompiledController, Policy, compiled
from navbench.robot import Robot
from navbench.sensors import Mount, Sensors
from navbench.simulation.base import Simulator
from navbench.simulation.bullet import BulletSimulator
from navbench.simulation.options import SimulatorOptions
from navbench.simulation.planar import PlanarSimulator
from navbench.world.layout import Layout, Start
from navbench.world.shapes import Bounds, Disc, Point
from navbench.world.world import World

PERIOD_S, RAYS, RANGE_M = 0.1, 16, 3.0
ROBOT = Robot(radius_m=0.1, track_m=0.15, wheel_speed_max_mps=0.5)
SPEED_MPS, GAIN_PER_S, NEAR_M = 0.2, 2.0, 0.2
STEPS = 2000  # of an episode
MAKERS: dict[str, type[Simulator]] = {"pybullet": BulletSimulator, "planar": PlanarSimulator}

Place = tuple[float, float]


def rule(pose: tuple[float, float, float], goal: Place, ranges: Sequence[float], turn_radps: float) -> Place:
    """Return speed and turning rate: keep the goal to the left, and turn away from what is near."""
    x, y, heading = pose
    error = math.remainder(math.atan2(goal[1] - y, goal[0] - x) - heading - 0.5 * math.pi, math.tau)
    if min(ranges) < NEAR_M:
        error += 1.0 if sum(ranges[1:15:2]) > sum(ranges[2:15:2]) else -1.0
    return SPEED_MPS, turn_radps + GAIN_PER_S * error


@compiled
def step(
    state: FloatArray,
    parameters: FloatArray,
    ranges_m: FloatArray,
    discs: FloatArray,
    pose: tuple[float, float, float],
    goal: Place,
    speed: Place,
    trace: FloatArray,
) -> Place:
    """Return what ``rule`` does; a step of ``navbench.policy``."""
    error = wrap_angle(math.atan2(goal[1] - pose[1], goal[0] - pose[0]) - pose[2] - 0.5 * math.pi)
    if ranges_m.min() < NEAR_M:
        error += 1.0 if ranges_m[1:15:2].sum() > ranges_m[2:15:2].sum() else -1.0
    return SPEED_MPS, parameters[0] + GAIN_PER_S * error


class PythonRule:
    """The rule in Python."""

    def __init__(self, turn_radps: float) -> None:
        self._turn_radps = turn_radps

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Keep nothing."""

    def act(self, observation: Observation) -> Command:
        """Return a speed and a turn."""
        o = observation
        return Command(*rule(o.pose, o.goal, o.ranges_m.tolist(), self._turn_radps))


class CompiledRule(CompiledController):
    """The rule, compiled."""

    def __init__(self, turn_radps: float) -> None:
        self._parameters = np.array([turn_radps])

    def make_policy(self, setup: Setup) -> Policy:
        """Return the policy."""
        return Policy(step=step, parameters=self._parameters)


class Field:
    """Robots on a ring of at least 4 m, half a metre from each other, round some discs.

    Args:
        robots: how many.
        discs: how many, evenly spread in the middle.
        per_m2: with how many of them on a square metre, however far that goes; none keeps them within the ring.

    Attributes:
        radius_m: of the ring.
        starts: each robot's x, y [m] and heading [rad].
        discs: each disc's x, y and radius [m].
        turn_radps: with which the ring is followed.
    """

    def __init__(self, robots: int, discs: int, per_m2: float | None = None) -> None:
        self.radius_m = max(4.0, 0.5 * robots / math.tau)
        turns = [math.tau * i / robots for i in range(robots)]
        ring = [(self.radius_m * math.cos(a), self.radius_m * math.sin(a)) for a in turns]
        self.starts = [(x, y, a + 0.5 * math.pi) for (x, y), a in zip(ring, turns, strict=True)]
        apart_m = (self.radius_m - 1.0) / math.sqrt(discs) if per_m2 is None else 1.0 / math.sqrt(math.pi * per_m2)
        radius_m = min(0.25, 0.5 * apart_m)
        aisle_m = 0.2 + radius_m if radius_m < 0.15 else 0.0  # else these wall the goal off, and none could reach it
        apart_m *= 0.95 if aisle_m else 1.0
        spiral = ((apart_m * math.sqrt(i + 0.5), i * math.pi * (3.0 - math.sqrt(5.0))) for i in count())
        free = (
            (r, a)
            for r, a in spiral
            if abs(r - self.radius_m) > 0.9  # the ring, with its robots
            and (math.cos(a) < 0.0 or abs(r * math.sin(a)) >= aisle_m)
        )
        self.discs = [(r * math.cos(a), r * math.sin(a), radius_m) for r, a in islice(free, discs)]
        self.turn_radps = SPEED_MPS / self.radius_m

    def world(self, steps: int) -> World:
        """Return the world, with episodes of so many control periods."""
        side = max(self.radius_m, *(math.hypot(x, y) for x, y, _ in self.discs)) + 2.0
        layout = Layout(
            bounds=Bounds(x_min_m=-side, x_max_m=side, y_min_m=-side, y_max_m=side),
            discs=tuple(Disc(*disc) for disc in self.discs),
            starts=tuple(Start(*start) for start in self.starts),
            goals=(Point(x_m=0.0, y_m=0.0),) * len(self.starts),
        )
        return World(name="field", source=layout, goal_tolerance_m=0.2, time_limit_s=steps * PERIOD_S)

    def runner(
        self,
        simulator: str,
        make_controller: Callable[[float], Controller] = CompiledRule,
        steps: int = STEPS,
        on: ExitStack | None = None,
    ) -> EpisodeRunner:
        """Return what runs episodes of this, put on a stack."""
        mounts = tuple(
            Mount(role=str(i), x_m=0.1 * math.cos(a), y_m=0.1 * math.sin(a), heading_rad=a)
            for i, a in enumerate(np.linspace(0.0, math.tau, RAYS, endpoint=False).tolist())
        )
        made = EpisodeRunner(
            make_controller=partial(make_controller, self.turn_radps),
            make_simulator=partial(MAKERS[simulator], SimulatorOptions()),
            native=Native(ROBOT, PERIOD_S),
            world=self.world(steps),
            robot=ROBOT,
            sensors=Sensors(drawn_for_radius_m=0.1, mounts=mounts, max_range_m=RANGE_M),
            seed=0,
            jitter=Jitter(),
        )
        return made if on is None else on.enter_context(made)
