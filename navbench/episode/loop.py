"""One episode: the closed loop of all robots of a world, from their starts until each has an outcome."""

import math
import reprlib
import struct
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from navbench.contract import Command, Controller, Observation, Pose, Setup, trace_of
from navbench.episode.closed_loop import run_closed
from navbench.episode.failures import ContractError, Failure, failure, velocities, wrong_trace
from navbench.episode.perception import Perception, Senses
from navbench.episode.similarity import Native, Similarity, accel_max_mps2, native_setup, period_s
from navbench.episode.starts import Jitter, draw_starts
from navbench.mathematics.streams import stream
from navbench.metrics import METRICS, MetricFunction, RobotRun, declared
from navbench.policy import CompiledController
from navbench.records import Outcome, RobotRecord, Thing
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.simulation.base import Simulator
from navbench.simulation.motion import RUNNING, STOPPED, RobotState
from navbench.simulation.planar import PlanarSimulator
from navbench.validation import DescriptionError
from navbench.world.layout import Layout
from navbench.world.world import World

FloatArray = NDArray[np.float64]

PERIODS_AT_ONCE = 512  # of a compiled loop whose errors are drawn beforehand
PERIODS_MAX = 16384  # of any


@dataclass(slots=True)
class _Pilot:
    """One robot's controller with its sensors, and what is kept of its trajectory."""

    controller: Controller
    perception: Perception
    rows: list[float] = field(default_factory=list)
    states: FloatArray = field(default_factory=lambda: np.empty((0, 6)))
    traces: list[bytes] = field(default_factory=list)
    trace_names: tuple[str, ...] | None = None
    latencies_s: list[float] = field(default_factory=list)
    outcome: Outcome = "timed_out"
    failure: Failure = Failure()
    hit: Thing | None = None
    end_s: float = 0.0
    _in_order: Callable[[Mapping[str, float]], tuple[float, ...]] = field(default=lambda _: ())
    _packed: Callable[..., bytes] = bytes

    def keep_trace(self) -> None:
        """Keep the latest act's trace, packed: it is checked by packing and takes little room.

        Raises:
            ContractError: it is no mapping, its names are not those of the first act, or a value is no number.
        """
        if isinstance(self.controller, CompiledController):
            self.trace_names = self.controller.policy.trace_names
            self.traces.append(self.controller.policy.trace.tobytes())
            return
        trace = trace_of(self.controller)
        try:
            if self.trace_names is None:
                self.trace_names = names = tuple(trace)
                self._packed = struct.Struct(f"{len(names)}d").pack
                self._in_order = itemgetter(*names) if len(names) > 1 else lambda one: tuple(one[n] for n in names)
            if len(trace) == len(self.trace_names):
                self.traces.append(self._packed(*self._in_order(trace)))
                return
        except (AttributeError, KeyError, TypeError, struct.error):
            pass  # said below
        raise ContractError(wrong_trace(trace, self.trace_names or ()))


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
    ) -> None:
        world.check_fits(robot.radius_m)
        self._template, self._native, self._robot, self._jitter = world, native, robot, jitter
        self.make_controller, self.seed, self._metrics = make_controller, seed, metrics
        self._made: tuple[object, dict[int, CompiledController]] = None, {}
        self._sensors = sensors.scaled_to(robot.radius_m)
        self._similarity = Similarity.between(robot, native)
        self._converts = not self._similarity.identity
        self._period_s = period_s(native, self._similarity)
        source = world.source
        self._always = world.of(source) if isinstance(source, Layout) and type(source).draw is Layout.draw else None
        self._poses: list[Pose] = []  # of a layout and starts that are always the same
        self._senses = Senses.of(self._sensors, self._similarity, robot.track_m)
        self._periods = math.ceil(world.time_limit_s / self._period_s - 1e-9)
        self._setup = native_setup(robot, self._sensors, native)
        accel_max = accel_max_mps2(robot, native, self._similarity)
        self.simulator = make_simulator(robot, self._sensors, accel_max)

    def __enter__(self) -> "EpisodeRunner":
        """Return the runner itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the simulator."""
        self.simulator.close()

    def run(self, episode: int) -> list[RobotRecord]:
        """Run one episode and return a record a robot.

        Args:
            episode: its index, which names its streams.
        """
        try:
            starts = self.starts(episode)
        except DescriptionError as error:  # one bad draw costs its episode, not the study
            metrics = declared(self._metrics)
            return [RobotRecord.lost(i, "no_layout", str(error), metrics) for i in range(self._template.robots)]
        pilots = self._begin(starts, episode)
        if self.simulator.is_compiled and all(isinstance(pilot.controller, CompiledController) for pilot in pilots):
            try:
                self._close(pilots)
            except Exception:  # a policy's own: its robot is found step by step
                pilots = self._begin(starts, episode)
                self._drive(pilots)
        else:
            self._drive(pilots)
        return [
            self._record(i, pilot, state)
            for i, (pilot, state) in enumerate(zip(pilots, self.simulator.states(), strict=True))
        ]

    def _begin(self, starts: list[Pose], episode: int) -> list[_Pilot]:
        """Put the robots at their starts and make their controllers."""
        self.simulator.reset(self._world, starts, self._template.goal_tolerance_m)
        pilots = [self._pilot(i, start, episode) for i, start in enumerate(starts)]
        for i, pilot in enumerate(pilots):
            if pilot.outcome == "controller_error":
                self.simulator.stop(i)
        return pilots

    def _drive(self, pilots: list[_Pilot]) -> None:
        """Run control periods one by one."""
        motions, time_limit_s = self.simulator.motions(), self._template.time_limit_s
        for k in range(self._periods):
            if not self.simulator.active:
                break
            t_s = k * self._period_s
            motions = self._period(pilots, motions, t_s, min(self._period_s, time_limit_s - t_s))
        for pilot in pilots:
            pilot.states = np.array(pilot.rows).reshape(-1, 6)

    def _close(self, pilots: list[_Pilot]) -> None:
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
            self._senses.constants, self._senses.least, self._senses.most, np.array([sight.goal for sight in sights]),
            *(np.array([getattr(sight, name) for sight in sights]) for name in ("believed", "wheel_scale")),
        )  # fmt: skip
        scene, rays = simulator.scene, simulator.rays
        discs = len(scene.discs) + len(scene.polygons) + len(pilots) - 1
        room = simulator.beams, np.empty(len(rays.unobstructed)), np.empty((discs, 5))
        limit_s, first = self._template.time_limit_s, 0
        blocks: list[list[FloatArray]] = [[] for _ in pilots]
        while simulator.running and first < self._periods:
            count = min(PERIODS_AT_ONCE if self._senses.errs else PERIODS_MAX, self._periods - first)
            drawn = [(*sight.draw(count, discs), sight.draw_travel(count)) for sight in sights]
            kept = (
                np.empty((len(pilots), count, 6)), np.empty((len(pilots), count, stacked[2].shape[1])),
                np.zeros(len(pilots), np.int64),
            )  # fmt: skip
            simulator.reserve(min(self._period_s, limit_s))
            run_closed(
                step, stacked, simulator.robots, simulator.pipeline, scene.arrays, simulator.fixed,
                (rays.table, rays.reach_m, rays.unobstructed), senses, tuple(map(np.array, zip(*drawn, strict=True))),
                (first, first + count, self._period_s, limit_s), room, kept,
            )  # fmt: skip
            simulator.active = np.flatnonzero(simulator.robots["running"]).tolist()
            for i, (pilot, policy) in enumerate(zip(pilots, policies, strict=True)):
                blocks[i].append(kept[0][i, : kept[2][i]])
                pilot.traces.append(kept[1][i, : kept[2][i]].tobytes())
                pilot.trace_names = policy.trace_names
            first += count
        for i, (pilot, pieces) in enumerate(zip(pilots, blocks, strict=True)):
            pilot.states = np.concatenate([pilot.states, *pieces])
            self._end(i, pilot)

    def _end(self, index: int, pilot: _Pilot) -> None:
        """Say how a robot's compiled loop ended."""
        state = self.simulator.robots[index]
        if state["outcome"] == RUNNING:
            begin_s = (len(pilot.states) - 1) * self._period_s
            pilot.end_s = begin_s + min(self._period_s, self._template.time_limit_s - begin_s)
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

    def starts(self, episode: int) -> list[Pose]:
        """Draw an episode's layout and return where its robots begin, see ``draw_starts``."""
        self._world = self._always or self._template.drawn_for(self.seed, episode)
        if self._always and not any(self._jitter):
            self._poses = self._poses or draw_starts(
                self._world, self._robot.radius_m, self._jitter, self.seed, episode
            )
            return self._poses
        return draw_starts(self._world, self._robot.radius_m, self._jitter, self.seed, episode)

    def _pilot(self, index: int, start: Pose, episode: int) -> _Pilot:
        world = self._world
        goal = (world.goals[index].x_m, world.goals[index].y_m)
        name = (self.seed, world.name, episode, index)
        perception = Perception(self._senses, start, goal, name)
        try:
            return _Pilot(self._begun(index, name), perception)
        except (Exception, SystemExit) as error:  # a user's code may raise anything; it costs this robot, not the study
            return _Pilot(_Absent(), perception, outcome="controller_error", failure=failure(error))

    def _begun(self, index: int, name: tuple[int, str, int, int]) -> Controller:
        """Return a robot's controller at the beginning of an episode."""
        maker, controllers = self._made
        if maker is not self.make_controller:
            self._made = maker, controllers = self.make_controller, {}
        if index in controllers:
            controllers[index].begin(self._setup)
            return controllers[index]
        controller = self.make_controller()
        seed, world, episode, _ = name
        controller.reset(self._setup, stream(seed, world, episode, "controller", index))
        if isinstance(controller, CompiledController) and type(controller).reset is CompiledController.reset:
            controllers[index] = controller  # nothing of an episode is left in it but its policy, which is made anew
        return controller

    def _period(self, pilots: list[_Pilot], before: list[list[float]], t_s: float, dt_s: float) -> list[list[float]]:
        """Let every running robot observe and act, then move all; keep what they did and return their new motions."""
        simulator = self.simulator
        active, ranges, touches = simulator.active.copy(), simulator.ranges(), simulator.robots["touches"].tolist()
        for i in active:
            self._act(pilots[i], i, t_s, before[i], ranges[i], bool(touches[i]))
        ends = {event.robot_index: event for event in simulator.advance(t_s, dt_s)} if simulator.active else {}
        after = simulator.motions()
        for i in active:
            pilot, (x, y, heading, *_) = pilots[i], before[i]
            if pilot.outcome == "controller_error":
                pilot.rows += t_s, x, y, heading, 0.0, 0.0
                pilot.end_s = t_s
                continue
            pilot.end_s = t_s + dt_s
            duration = dt_s
            if i in ends:
                _, pilot.outcome, pilot.hit, pilot.end_s = ends[i]
                duration = max(pilot.end_s - t_s, 1e-12)
            *_, left, right = after[i]
            v, w = 0.5 * (left + right) / duration, (right - left) / self._robot.track_m / duration
            pilot.rows += t_s, x, y, heading, v, w
            if pilot.perception.drifts:
                pilot.perception.travel(left, right, duration)
        return after

    def _act(
        self, pilot: _Pilot, index: int, t_s: float, motion: list[float], ranges_m: FloatArray, touching: bool
    ) -> None:
        """Let one robot observe and act; what it does wrong ends it with a reason."""
        simulator = self.simulator
        x, y, heading, left, right, *_ = motion
        speed = (0.5 * (left + right), (right - left) / self._robot.track_m)
        discs = None if self._sensors.tracker is None else simulator.tracked_discs(index)
        observation = pilot.perception.observe(t_s, Pose(x, y, heading), speed, ranges_m, touching, discs)
        try:
            begin = time.perf_counter()
            command = pilot.controller.act(observation)
            pilot.latencies_s.append(time.perf_counter() - begin)
            v, w = velocities(command)
            pilot.keep_trace()
            if self._converts:
                v, w = self._similarity.to_world(Command(v, w))
            simulator.command(index, v, w)
        except (Exception, SystemExit) as error:  # a user's code may raise anything; it costs this robot, not the study
            pilot.outcome, pilot.failure = "controller_error", failure(error, pilot.controller.act)
            simulator.stop(index)

    def _record(self, index: int, pilot: _Pilot, robot: RobotState) -> RobotRecord:
        *_, v, w = pilot.states[-1] if len(pilot.states) else (0.0, 0.0)
        end = (pilot.end_s, robot.x_m, robot.y_m, robot.heading_rad, v, w)
        states = np.concatenate([pilot.states, [end]])
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
        metrics, faults = _measured(self._metrics, run)
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
        )


def _measured(metrics: Sequence[MetricFunction], run: RobotRun) -> tuple[dict[str, float], list[Failure]]:
    """Return each metric's value by its name, nan where it could not be computed, and why."""
    values: dict[str, float] = {}
    faults = []
    for function, metric in zip(metrics, declared(metrics), strict=True):
        try:
            value = function(run)
            if not isinstance(value, int | float | Real):
                raise ContractError(f"must return a number; it returned {reprlib.repr(value)}")
            values[metric.name] = value if type(value) is int else float(value)
        except (Exception, SystemExit) as error:  # a user's code may raise anything; it costs this value, no more
            fault = failure(error, function)
            values[metric.name] = math.nan
            faults.append(fault._replace(reason=f"metric {metric.name}: {fault.reason}"))
    return values, faults


class _Absent:
    """Stands where a controller could not be made; it never acts."""

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Do nothing."""

    def act(self, observation: Observation) -> Command:
        """Do not come here."""
        raise AssertionError("a robot without a controller does not act")
