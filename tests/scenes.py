"""Small worlds, robots and controllers that the tests of the physics share."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navbench.contract import Command, Controller, Observation, Pose, Setup
from navbench.episode.loop import EpisodeRunner
from navbench.episode.similarity import Native
from navbench.episode.starts import Jitter
from navbench.records import RobotRecord
from navbench.robot import Robot
from navbench.sensors import Mount, Sensors
from navbench.simulation.base import Simulator
from navbench.simulation.bullet import BulletSimulator
from navbench.simulation.contacts import Event
from navbench.simulation.options import SimulatorOptions
from navbench.world.layout import DrawnWorld, Layout, Start
from navbench.world.shapes import Bounds, Mover, Point
from navbench.world.world import World, drawn

FloatArray = NDArray[np.float64]
Act = Callable[[Observation], Any]

RADII = (0.065, 0.2, 4.0)
BLIND = Sensors(drawn_for_radius_m=1.0, max_range_m=1.0)
IDEAL = SimulatorOptions()
BLOCK = SimulatorOptions(on_collision="block")
STAND = Command(0.0, 0.0)
STILL = Jitter()


def a_world(**changes: Any) -> DrawnWorld:
    """Return an empty world of 2 km with one robot at the origin, facing a goal 500 m ahead."""
    values: dict[str, Any] = {
        "name": "scene",
        "bounds": Bounds(x_min_m=-1000.0, x_max_m=1000.0, y_min_m=-1000.0, y_max_m=1000.0),
        "starts": (Start(x_m=0.0, y_m=0.0, heading_rad=0.0),),
        "goal_tolerance_m": 0.1,
        "time_limit_s": 10.0,
    }
    values |= changes
    values.setdefault("goals", tuple(Point(x_m=500.0, y_m=10.0 * i) for i in range(len(values["starts"]))))
    own = {key: values.pop(key) for key in ("name", "goal_tolerance_m", "time_limit_s")}
    return drawn(Layout(**values), **own)


def a_robot(radius_m: float = 1.0, speed_mps: float = 1.0, accel_mps2: float | None = None) -> Robot:
    """Return a robot whose track is 1.5 radii."""
    return Robot(
        radius_m=radius_m,
        track_m=1.5 * radius_m,
        wheel_speed_max_mps=speed_mps,
        wheel_accel_max_mps2=accel_mps2,
    )


def starts(*places: tuple[float, float, float]) -> tuple[Start, ...]:
    """Return starts at x, y [m] with a heading [rad]."""
    return tuple(Start(x_m=x, y_m=y, heading_rad=heading) for x, y, heading in places)


def a_ring(n: int, radius_m: float, reach_m: float, mount_radii: float = 1.0, **changes: Any) -> Sensors:
    """Return n sensors around a robot, evenly spread, the first one looking ahead."""
    turns, away_m = [2.0 * math.pi * i / n for i in range(n)], mount_radii * radius_m
    mounts = tuple(
        Mount(role=f"s{i}", x_m=away_m * math.cos(turn), y_m=away_m * math.sin(turn), heading_rad=turn)
        for i, turn in enumerate(turns)
    )
    return Sensors(drawn_for_radius_m=radius_m, mounts=mounts, max_range_m=reach_m, **changes)


def to_and_fro(*points: tuple[float, float], speeds: Sequence[float], radius_m: float, **changes: Any) -> Mover:
    """Return a mover along these points."""
    places = tuple(Point(x_m=x, y_m=y) for x, y in points)
    return Mover(radius_m=radius_m, waypoints=places, speeds_mps=tuple(speeds), **changes)


def a_simulator(
    world: DrawnWorld,
    robot: Robot,
    sensors: Sensors = BLIND,
    options: SimulatorOptions = IDEAL,
    poses: Sequence[Pose] | None = None,
) -> Simulator:
    """Return a simulator with its robots at these poses, or at the world's starts."""
    simulator = BulletSimulator(options, robot, sensors.scaled_to(robot.radius_m), robot.wheel_accel_max_mps2)
    reset(
        simulator,
        world,
        [Pose(start.x_m, start.y_m, world.start_heading_rad(i)) for i, start in enumerate(world.starts)]
        if poses is None
        else poses,
        world.goal_tolerance_m,
    )
    return simulator


def reset(simulator: Simulator, layout: Layout, poses: Sequence[Pose], goal_tolerance_m: float = 0.1) -> None:
    """Begin an episode with the robots at these poses."""
    simulator.reset(layout, poses, goal_tolerance_m)


def again(simulator: Simulator, poses: Sequence[Pose]) -> None:
    """Begin another episode in the layout of the last one."""
    simulator.reset(simulator.scene.layout, poses, 0.1)


def pose_of(simulator: Simulator, index: int = 0) -> Pose:
    """Return where a robot is."""
    state = simulator.states()[index]
    return Pose(state.x_m, state.y_m, state.heading_rad)


def drive(
    simulator: Simulator, commands: Sequence[tuple[float, float]], period_s: float, first_period: int = 0
) -> list[Event]:
    """Give every robot each of these commands for one period, and return how the robots ended."""
    events: list[Event] = []
    for k, (v, w) in enumerate(commands, first_period):
        for i in range(len(simulator.robots)):
            simulator.command(i, v, w)
        events += simulator.advance(k * period_s, period_s)
    return events


class Scripted:
    """A controller that computes its command, and perhaps a trace, by a given function of the observation."""

    def __init__(self, act: Act, trace: Callable[[Observation], Any] | None = None) -> None:
        self._act, self._trace = act, trace
        self.trace: Mapping[str, float] = {}
        self.seen: list[Observation] = []
        self.setup: Setup | None = None
        self.rng: np.random.Generator | None = None

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        self.setup, self.rng, self.seen = setup, rng, []

    def act(self, observation: Observation) -> Command:
        self.seen.append(observation._replace(ranges_m=observation.ranges_m.copy(), discs=observation.discs.copy()))
        if self._trace is not None:
            self.trace = self._trace(observation)
        command: Command = self._act(observation)
        return command


def always(v_mps: float, w_radps: float = 0.0) -> Scripted:
    """Return a controller that never changes its mind."""
    return Scripted(lambda _: Command(v_mps, w_radps))


def schedule(commands: Sequence[tuple[float, float]], period_s: float) -> Scripted:
    """Return a controller that gives these commands, one a period, and then stands."""

    def act(observation: Observation) -> Command:
        k = round(observation.t_s / period_s)
        return Command(*commands[k]) if k < len(commands) else STAND

    return Scripted(act)


def a_runner(
    world: DrawnWorld | World,
    controllers: Controller | Sequence[Controller],
    *,
    robot: Robot | None = None,
    sensors: Sensors = BLIND,
    options: SimulatorOptions = IDEAL,
    period_s: float | None = 0.1,
    native: Native | None = None,
    seed: int = 0,
    jitter: Jitter = STILL,
) -> EpisodeRunner:
    """Return a runner whose robots get these controllers in turn, on their native robot unless told otherwise."""
    robot = a_robot() if robot is None else robot
    given = [controllers] if isinstance(controllers, Controller) else list(controllers)
    made = 0

    def make() -> Controller:
        nonlocal made
        made += 1
        return given[(made - 1) % len(given)]

    if native is None and period_s is not None:
        native = Native(robot, period_s)
    if isinstance(world, DrawnWorld):  # always the same
        world = World(
            name=world.name, source=world, goal_tolerance_m=world.goal_tolerance_m, time_limit_s=world.time_limit_s
        )
    return EpisodeRunner(
        make_controller=make,
        make_simulator=partial(BulletSimulator, options),
        native=native,
        world=world,
        robot=robot,
        sensors=sensors,
        seed=seed,
        jitter=jitter,
    )


def run(
    world: DrawnWorld | World, controllers: Controller | Sequence[Controller], *, episode: int = 0, **options: Any
) -> list[RobotRecord]:
    """Run one episode and return a record a robot."""
    with a_runner(world, controllers, **options) as runner:
        return runner.run(episode)


def run_one(world: DrawnWorld, controller: Controller, **options: Any) -> RobotRecord:
    """Run one episode of a world with one robot."""
    (record,) = run(world, controller, **options)
    return record


def same(one: RobotRecord, other: RobotRecord) -> bool:
    """Return whether two records are the same to the last bit, but for the machine's clock."""
    return (
        one[:4] == other[:4]
        and one.trace_names == other.trace_names
        and one.states.tobytes() == other.states.tobytes()
        and one.traces.tobytes() == other.traces.tobytes()
        and one.ranges_m.tobytes() == other.ranges_m.tobytes()
    )
