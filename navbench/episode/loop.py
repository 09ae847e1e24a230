"""One episode: the closed loop of all robots of a world, from their starts until each has an outcome."""

import math
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.contract import Command, Controller, Observation, Pose, Setup
from navbench.episode.closed_loop import run_closed
from navbench.episode.failures import Failure, failure, measured, velocities
from navbench.episode.isolation import Isolation, let_interrupt
from navbench.episode.perception import Perception, Senses
from navbench.episode.pilot import Pilot
from navbench.episode.similarity import Native, Similarity, accel_max_mps2, native_setup, period_s
from navbench.episode.starts import Jitter, draw_starts
from navbench.episode.tasks import FreeSpace, free_space
from navbench.mathematics.streams import stream
from navbench.metrics import METRICS, MetricFunction, RobotRun, declared
from navbench.policy import CompiledController
from navbench.records import NO_RANGES, Outcome, RobotRecord
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.simulation.base import Simulator
from navbench.simulation.motion import RUNNING, STOPPED, RobotState
from navbench.simulation.planar import PlanarSimulator
from navbench.validation import DescriptionError
from navbench.world.layout import DrawnWorld, ImpossibleError, Layout
from navbench.world.world import World

FloatArray = NDArray[np.float64]

PERIODS_AT_ONCE = 512  # of a compiled loop whose errors are drawn beforehand
PERIODS_MAX = 16384  # of any


class Drawn(NamedTuple):
    """An episode's world, with where its robots may be, and where they begin."""

    space: FreeSpace
    starts: list[Pose]

    @property
    def world(self) -> DrawnWorld:
        """The world with its layout."""
        return self.space.world


class EpisodeRunner:
    """Runs episodes of one combination of world, robot, sensors, simulator and controller, one after another.

    Episodes do not depend on what ran before them. Use it in a ``with`` block: it holds a simulator.
    ``make_controller`` and ``seed`` may be set anew between two episodes, as a tuning does.

    Args:
        make_controller: makes one controller object, for one robot.
        make_simulator: makes a simulator of a robot, its sensors and the wheel-acceleration limit in force.
        native: what the controller was drawn for, or None.
        world: the world.
        robot: the robot that drives.
        sensors: the sensor suite, as drawn: it is scaled here.
        seed: the seed of all streams.
        jitter: of the starts.
        metrics: what is measured of each robot.
        timeout_s: CPU time that a step may take before this process ends [s]; None for any.
        keep_ranges: whether records keep what the range sensors read.

    Attributes:
        robots: how many robots drive.
        period_s: the control period in the world [s].
        periods: how many there are until the time limit.
        time_limit_s: when an episode ends [s].
        senses: the sensors.
        setup: what a controller is told.
        simulator: the simulator.

    Raises:
        DescriptionError: these do not fit together (see ``World.check_fits``).
    """

    def __init__(
        self,
        *,
        make_controller: Callable[[], Controller],
        make_simulator: Callable[[Robot, Sensors, float | None], Simulator],
        native: Native | None,
        world: World,
        robot: Robot,
        sensors: Sensors,
        seed: int,
        jitter: Jitter,
        metrics: Sequence[MetricFunction] = METRICS,
        timeout_s: float | None = None,
        keep_ranges: bool = False,
    ) -> None:
        world.check_fits(robot.radius_m)
        self._template, self._native, self._robot, self._jitter = world, native, robot, jitter
        self.make_controller, self.seed, self._metrics = make_controller, seed, metrics
        self._apart, self._keep_ranges = Isolation(timeout_s), keep_ranges
        self._made: tuple[object, dict[int, CompiledController]] = None, {}
        self._sensors = sensors.scaled_to(robot.radius_m)
        self._similarity = Similarity.between(robot, native)
        self._converts = not self._similarity.identity
        self.period_s = period_s(native, self._similarity)
        source = world.source
        self._always: FreeSpace | None = None
        if isinstance(source, Layout) and type(source).draw is Layout.draw:
            self._always = free_space(world, robot.radius_m)
        self._same: Drawn | None = None  # a layout and starts that are always the same
        self._possible: Drawn | None = None  # the last one whose task can be done
        users = [metric.__module__ for metric in metrics] + [type(source).__module__]
        self._is_users = not all(module.startswith("navbench.") for module in users)  # which may draw where it likes
        self.senses = Senses.of(self._sensors, self._similarity, robot.track_m)
        self.robots, self.time_limit_s = world.robots, world.time_limit_s
        self.periods = math.ceil(world.time_limit_s / self.period_s - 1e-9)
        self.setup = native_setup(robot, self._sensors, native)
        accel_max = accel_max_mps2(robot, native, self._similarity)
        self.simulator = make_simulator(robot, self._sensors, accel_max)

    def __enter__(self) -> "EpisodeRunner":
        """Return the runner itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the simulator."""
        self.simulator.close()

    def run(self, episode: int) -> list[RobotRecord]:
        """Run one episode, whose index names its streams, and return a record a robot."""
        if self._is_users:
            self._apart.begin((self.seed, self._template.name, episode, 0))
        try:
            drawn = self.draw(episode)
            self._check_possible(drawn)
        except DescriptionError as error:  # one bad draw costs its episode, not the study
            outcome: Outcome = "impossible" if isinstance(error, ImpossibleError) else "no_layout"
            metrics = declared(self._metrics)
            return [RobotRecord.lost(i, outcome, str(error), metrics) for i in range(self._template.robots)]
        self._apart.timeout.episode()
        pilots = self.begin(drawn, episode)
        if self.simulator.is_compiled and all(isinstance(pilot.controller, CompiledController) for pilot in pilots):
            try:
                self._close(pilots)
            except BaseException as error:  # a policy's own: its robot is found step by step
                let_interrupt(error)
                pilots = self.begin(drawn, episode)
                self._drive(pilots)
        else:
            self._drive(pilots)
        return [self.record(i, pilot) for i, pilot in enumerate(pilots)]

    def draw(self, episode: int) -> Drawn:
        """Draw an episode's layout and where its robots begin, see ``draw_starts``."""
        if self._same is not None:
            return self._same
        space, radius_m = self._always, self._robot.radius_m  # what is always the same was checked in the beginning
        if space is None:
            world = self._template.drawn_for(self.seed, episode)
            world.check_fits(radius_m, world.goal_tolerance_m)
            space = FreeSpace(world, radius_m)
        drawn = Drawn(space, draw_starts(space, self._jitter, self.seed, episode))
        if self._always and not any(self._jitter):
            self._same = drawn
        return drawn

    def _check_possible(self, drawn: Drawn) -> None:
        """Raise ImpossibleError where no controller could do this episode's task, see ``FreeSpace``."""
        if drawn is not self._possible:
            drawn.space.check(drawn.starts)
            self._possible = drawn

    def begin(self, drawn: Drawn, episode: int) -> list[Pilot]:
        """Put the robots of an episode at their starts and make their controllers."""
        self._world = drawn.world
        self.simulator.reset(drawn.world, drawn.starts, self._template.goal_tolerance_m)
        pilots = [self._pilot(i, start, episode) for i, start in enumerate(drawn.starts)]
        for i, pilot in enumerate(pilots):
            if pilot.outcome == "controller_error":
                self.simulator.stop(i)
        return pilots

    def _drive(self, pilots: list[Pilot]) -> None:
        """Run control periods one by one."""
        motions, ranges, time_limit_s = self.simulator.motions(), self.simulator.ranges(), self.time_limit_s
        for k in range(self.periods):
            if not self.simulator.active:
                break
            t_s = k * self.period_s
            self._apart.timeout.step()
            motions, ranges = self._period(pilots, motions, ranges, t_s, min(self.period_s, time_limit_s - t_s))
        for pilot in pilots:
            pilot.states = np.array(pilot.rows).reshape(-1, 6)

    def _close(self, pilots: list[Pilot]) -> None:
        """Run control periods in compiled code, many at a time."""
        simulator = self.simulator
        assert isinstance(simulator, PlanarSimulator)
        policies = [pilot.controller.policy for pilot in pilots if isinstance(pilot.controller, CompiledController)]
        (step,) = {policy.step for policy in policies}
        sights = [pilot.perception for pilot in pilots]
        stacked = tuple(
            np.array([getattr(policy, name) for policy in policies]) for name in ("state", "parameters", "trace")
        )
        senses = (
            self.senses.constants, self.senses.least, self.senses.most, np.array([sight.goal for sight in sights]),
            *(np.array([getattr(sight, name) for sight in sights]) for name in ("believed", "wheel_scale")),
        )  # fmt: skip
        scene, rays = simulator.scene, simulator.rays
        discs = len(scene.discs) + len(scene.polygons) + len(pilots) - 1
        room = simulator.beams, np.empty(len(rays.unobstructed)), np.empty((discs, 5))
        limit_s, first, keeps = self.time_limit_s, 0, self._keep_ranges
        blocks: list[list[FloatArray]] = [[] for _ in pilots]
        while simulator.running and first < self.periods:
            count = min(PERIODS_AT_ONCE if self.senses.errs else PERIODS_MAX, self.periods - first)
            drawn = [(*sight.draw(count, discs), sight.draw_travel(count)) for sight in sights]
            kept = (
                np.empty((len(pilots), count, 6)), np.empty((len(pilots), count, stacked[2].shape[1])),
                np.zeros(len(pilots), np.int64), np.empty((len(pilots), *((count, len(room[1])) if keeps else (0, 0)))),
            )  # fmt: skip
            simulator.reserve(min(self.period_s, limit_s))
            run_closed(
                step, stacked, simulator.robots, simulator.pipeline, scene.arrays, simulator.fixed,
                (rays.table, rays.reach_m, rays.unobstructed), senses, tuple(map(np.array, zip(*drawn, strict=True))),
                (first, first + count, self.period_s, limit_s), room, kept,
            )  # fmt: skip
            simulator.active = np.flatnonzero(simulator.robots["running"]).tolist()
            for i, (pilot, policy) in enumerate(zip(pilots, policies, strict=True)):
                blocks[i].append(kept[0][i, : kept[2][i]])
                pilot.traces.append(kept[1][i, : kept[2][i]].tobytes())
                pilot.trace_names = policy.trace_names
                pilot.ranges.append(kept[3][i, : kept[2][i]])
            first += count
        for i, (pilot, pieces) in enumerate(zip(pilots, blocks, strict=True)):
            pilot.states = np.concatenate([pilot.states, *pieces])
            self.end(i, pilot)

    def end(self, index: int, pilot: Pilot) -> None:
        """Say how a robot ended whose states come from compiled code."""
        state = self.simulator.robots[index]
        if state["outcome"] == RUNNING:
            begin_s = (len(pilot.states) - 1) * self.period_s
            pilot.end_s = begin_s + min(self.period_s, self.time_limit_s - begin_s)
        elif state["outcome"] != STOPPED:
            _, pilot.outcome, pilot.hit, pilot.end_s = self.simulator.end(index)
        else:
            pilot.end_s, command = float(state["end_s"]), Command(*map(float, pilot.states[-1][4:]))
            pilot.states[-1][4:] = 0.0
            try:
                v, w = velocities(command)
                self.simulator.command(index, *self._similarity.to_world(Command(v, w)))
            except ValueError as error:
                pilot.outcome, pilot.failure = "controller_error", failure(error, pilot.controller.act)

    def _pilot(self, index: int, start: Pose, episode: int) -> Pilot:
        world = self._world
        goal = (world.goals[index].x_m, world.goals[index].y_m)
        name = (self.seed, world.name, episode, index)
        perception = Perception(self.senses, start, goal, name)
        try:
            return Pilot(self._begun(index, name), perception)
        except BaseException as error:  # a user's code may raise anything; it costs this robot, not the study
            let_interrupt(error)
            return Pilot(_Absent(), perception, outcome="controller_error", failure=failure(error))

    def _begun(self, index: int, name: tuple[int, str, int, int]) -> Controller:
        """Return a robot's controller at the beginning of an episode."""
        maker, controllers = self._made
        if maker is not self.make_controller:
            self._made = maker, controllers = self.make_controller, {}
        if index in controllers:
            if not type(controllers[index]).__module__.startswith("navbench."):  # ours draw nothing
                self._apart.seed_compiled(name)
            controllers[index].begin(self.setup)
            return controllers[index]
        self._apart.begin(name)
        controller = self.make_controller()
        self._apart.check()
        controller.reset(self.setup, stream(*name[:3], "controller", index))
        self._apart.check()
        if isinstance(controller, CompiledController) and type(controller).reset is CompiledController.reset:
            controllers[index] = controller  # nothing of an episode is left in it but its policy, which is made anew
        return controller

    def _period(
        self, pilots: list[Pilot], before: list[list[float]], ranges: FloatArray, t_s: float, dt_s: float
    ) -> tuple[list[list[float]], FloatArray]:
        """Let every running robot observe and act, then move all; keep what they did, return new motions and ranges."""
        simulator, active = self.simulator, self.simulator.active.copy()
        touches = simulator.touching if simulator.options.on_collision == "block" else [False] * len(pilots)
        for i in active:
            self._act(pilots[i], i, t_s, before[i], ranges[i], touches[i])
        events, ranges = simulator.period(t_s, dt_s) if simulator.active else ([], ranges)
        ends, after = {event.robot_index: event for event in events} if events else {}, simulator.motions()
        for i in active:
            pilot, (x, y, heading, _, _, _, _) = pilots[i], before[i]
            if pilot.outcome == "controller_error":
                pilot.rows += t_s, x, y, heading, 0.0, 0.0
                pilot.end_s = t_s
                continue
            pilot.end_s = t_s + dt_s
            duration = dt_s
            if i in ends:
                _, pilot.outcome, pilot.hit, pilot.end_s = ends[i]
                duration = max(pilot.end_s - t_s, 1e-12)
            _, _, _, _, _, left, right = after[i]
            v, w = 0.5 * (left + right) / duration, (right - left) / self._robot.track_m / duration
            pilot.rows += t_s, x, y, heading, v, w
            if pilot.perception.drifts:
                pilot.perception.travel(left, right, duration)
        return after, ranges

    def _act(
        self, pilot: Pilot, index: int, t_s: float, motion: list[float], ranges_m: FloatArray, touching: bool
    ) -> None:
        """Let one robot observe and act; what it does wrong ends it with a reason."""
        simulator = self.simulator
        x, y, heading, left, right, _, _ = motion
        speed = (0.5 * (left + right), (right - left) / self._robot.track_m)
        discs = None if self._sensors.tracker is None else simulator.tracked_discs(index)
        observation = pilot.perception.observe(t_s, Pose(x, y, heading), speed, ranges_m, touching, discs)
        if self._keep_ranges:
            pilot.ranges.append(observation.ranges_m[np.newaxis] * self._similarity.length)
        try:
            begin_s = perf_counter()
            command = pilot.controller.act(observation)
            pilot.latencies_s.append(perf_counter() - begin_s)
            self._apart.check()
            v, w = velocities(command)
            pilot.keep_trace()
            if self._converts:
                v, w = self._similarity.to_world(Command(v, w))
            simulator.command(index, v, w)
        except BaseException as error:  # a user's code may raise anything; it costs this robot, not the study
            self._apart.check()
            let_interrupt(error)
            pilot.outcome, pilot.failure = "controller_error", failure(error, pilot.controller.act)
            simulator.stop(index)

    def record(self, index: int, pilot: Pilot) -> RobotRecord:
        """Return what one robot did, when it has ended."""
        robot = RobotState(*self.simulator.robots[index].item())
        *_, v, w = pilot.states[-1] if len(pilot.states) else (0.0, 0.0)
        end = (pilot.end_s, robot.x_m, robot.y_m, robot.heading_rad, v, w)
        states = np.empty((len(pilot.states) + 1, 6))
        states[:-1], states[-1] = pilot.states, end
        names = pilot.trace_names or ()
        traces = np.full((len(states), len(names)), np.nan)
        if names:
            acted = np.frombuffer(b"".join(pilot.traces)).reshape(-1, len(names))
            traces[: len(acted)] = acted
        if pilot.outcome == "controller_error":
            states = states[:-1] if len(pilot.states) else states
            traces = traces[: len(states)]
        run = RobotRun(
            robot_index=index,
            outcome=pilot.outcome,
            time_s=pilot.end_s,
            path_length_m=robot.path_length_m,
            turning_rad=robot.turning_rad,
            min_clearance_m=robot.min_clearance_m,
            collisions=robot.contacts,
            robot_collisions=robot.robot_contacts,
            standing_collisions=robot.standing_contacts,
            states=states,
            traces=traces,
            trace_names=names,
            radius_m=self._robot.radius_m,
            layout=self._world,
        )
        metrics, faults = measured(self._metrics, run)
        said = [Failure(f"hit {pilot.hit}") if pilot.hit else pilot.failure, *faults]
        return RobotRecord(
            index,
            pilot.outcome,
            "; ".join(failed.reason for failed in said if failed.reason),
            metrics,
            states,
            traces,
            names,
            np.array(pilot.latencies_s),
            pilot.hit,
            self._world,
            "\n".join(failed.traceback for failed in said if failed.traceback),
            np.concatenate([np.empty((0, len(self.senses.most))), *pilot.ranges]) if self._keep_ranges else NO_RANGES,
        )


class _Absent:
    """Stands where a controller could not be made; it never acts."""

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Do nothing."""

    def act(self, observation: Observation) -> Command:
        """Do not come here."""
        raise AssertionError("a robot without a controller does not act")
