"""Control steps per CPU-second: whole episodes beside the bare PyBullet loop, with the same bodies and rays.

The bare loop has no controller: reset every robot's pose, detect collisions, ask for contacts, cast every robot's rays.
It replays the poses that the episodes visited. Whole episodes include the controller, sensing, recording and metrics.
Ratios are taken between runs in turn, and the median is printed.

    python benchmarks/closed_loop.py
"""

import math
import statistics
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import pybullet

from navbench.cli.configuration import compose_cell
from navbench.contract import Command, Observation, Setup
from navbench.episode.loop import EpisodeRunner
from navbench.episode.similarity import Native
from navbench.episode.starts import Jitter
from navbench.robot import Robot
from navbench.sensors import Mount, Sensors
from navbench.simulation.bullet import BulletSimulator
from navbench.simulation.options import SimulatorOptions
from navbench.world.layout import Layout, Start
from navbench.world.shapes import Bounds, Disc, Point
from navbench.world.world import World

ROUNDS = 7
SECONDS = 0.7  # of CPU time a measurement


class Rule:
    """A trivial Python rule: towards the goal, turning away from what is near."""

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Keep nothing."""

    def act(self, observation: Observation) -> Command:
        """Return a speed and a turn."""
        x, y, heading = observation.pose
        ranges = observation.ranges_m.tolist()
        error = math.remainder(math.atan2(observation.goal[1] - y, observation.goal[0] - x) - heading, math.tau)
        if min(ranges) < 0.2:
            error += 1.0 if sum(ranges[1:15:2]) > sum(ranges[2:15:2]) else -1.0
        return Command(0.2, 2.0 * error)


def rule_runner(robots: int) -> EpisodeRunner:
    """Return episodes of the rule: robots on a ring in a field of 10 discs, 16 rays of 3 m, a period of 0.1 s."""
    rng = np.random.default_rng(0)
    side = 6.0
    angles = np.linspace(0.0, math.tau, 10, endpoint=False)
    discs = tuple(
        Disc(x_m=1.8 * math.cos(a), y_m=1.8 * math.sin(a), radius_m=float(rng.uniform(0.1, 0.25)))
        for a in angles.tolist()
    )
    ring = [math.tau * i / robots for i in range(robots)]
    world = World(
        name="benchmark",
        source=Layout(
            bounds=Bounds(x_min_m=-side, x_max_m=side, y_min_m=-side, y_max_m=side),
            discs=discs,
            starts=tuple(Start(x_m=4.0 * math.cos(a), y_m=4.0 * math.sin(a)) for a in ring),
            goals=tuple(Point(x_m=-4.0 * math.cos(a), y_m=-4.0 * math.sin(a)) for a in ring),
        ),
        goal_tolerance_m=0.001,
        time_limit_s=20.0,
    )
    mounts = tuple(
        Mount(role=str(i), x_m=0.1 * math.cos(a), y_m=0.1 * math.sin(a), heading_rad=a)
        for i, a in enumerate(np.linspace(0.0, math.tau, 16, endpoint=False).tolist())
    )
    sensors = Sensors(drawn_for_radius_m=0.1, mounts=mounts, max_range_m=3.0)
    robot = Robot(radius_m=0.1, track_m=0.15, wheel_speed_max_mps=0.5)
    return EpisodeRunner(
        make_controller=Rule,
        make_simulator=partial(BulletSimulator, SimulatorOptions()),
        native=Native(robot, 0.1),
        world=world,
        robot=robot,
        sensors=sensors,
        seed=0,
        jitter=Jitter(),
    )


def sflc_runner() -> EpisodeRunner:
    """Return episodes of S.F.L.C. in the world ``deadlock``: one robot, 27 rays, 7 boxes and walls."""
    return compose_cell("controller=sflc", "world=deadlock").runner()


def swap_runner() -> EpisodeRunner:
    """Return episodes of oa_to on 50 robots that swap their places on a circle: 16 rays each."""
    return compose_cell("controller=oa_to", "world=swap_circle", "world.source.robots=50").runner()


def bare_loop(runner: EpisodeRunner) -> Callable[[], int]:
    """Return the bare loop over the poses of one of the runner's episodes; it returns its control steps."""
    records = runner.run(0)
    simulator = runner.simulator
    assert isinstance(simulator, BulletSimulator)
    client, scale, begins, ends = simulator.client, simulator.scale, simulator.begins, simulator.ends
    steps: list[list[tuple[int, tuple[float, float, float], tuple[float, float, float, float]]]] = []
    for body, record in zip(simulator.bodies, records, strict=True):
        for k, (_, x, y, heading, _, _) in enumerate(record.states[:-1].tolist()):
            if k == len(steps):
                steps.append([])
            turn = (0.0, 0.0, math.sin(0.5 * heading), math.cos(0.5 * heading))
            steps[k].append((body, (x * scale, y * scale, 0.0), turn))

    def loop() -> int:
        for robots in steps:
            for body, position, turn in robots:
                pybullet.resetBasePositionAndOrientation(body, position, turn, physicsClientId=client)
            pybullet.performCollisionDetection(physicsClientId=client)
            pybullet.getContactPoints(physicsClientId=client)
            for body, _, _ in robots:
                pybullet.rayTestBatch(begins, ends, parentObjectUniqueId=body, physicsClientId=client)
        return len(steps)

    return loop


def whole_episodes(runner: EpisodeRunner) -> Callable[[], int]:
    """Return a function that runs one whole episode, and returns its control steps."""
    return lambda: max(len(record.states) - 1 for record in runner.run(0))


def steps_per_cpu_second(run: Callable[[], int]) -> float:
    """Return how many control steps a second of CPU time does."""
    steps, begin = 0, time.process_time()
    while time.process_time() - begin < SECONDS:
        steps += run()
    return steps / (time.process_time() - begin)


def compare(name: str, make: Callable[[], EpisodeRunner]) -> None:
    """Measure both sides in turn and print their speeds and their ratio.

    Each side has a simulator of its own, one after the other, so that neither finds the other's bodies changed.
    """
    rows = []
    for _ in range(ROUNDS):
        with make() as runner:
            loop = bare_loop(runner)
            loop()
            bare = steps_per_cpu_second(loop)
        with make() as runner:
            episodes = whole_episodes(runner)
            episodes()
            rows.append((bare, steps_per_cpu_second(episodes)))
    print(f"bare_{name}: {statistics.median(bare for bare, _ in rows):.0f} steps/s")
    print(f"episodes_{name}: {statistics.median(whole for _, whole in rows):.0f} steps/s")
    print(f"ratio_{name}: {statistics.median(whole / bare for bare, whole in rows):.2f}", flush=True)


if __name__ == "__main__":
    compare("1_robot", sflc_runner)
    compare("swap_circle_50", swap_runner)
    for count in (1, 3, 50):
        compare(f"rule_{count}", lambda count=count: rule_runner(count))  # type: ignore[misc]
