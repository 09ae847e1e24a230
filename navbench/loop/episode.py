"""One episode: the closed loop of all robots of a world, from their starts until each has an outcome."""

import math
import struct
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.contract import Command, Controller, Observation, Pose, Setup, trace_of
from navbench.descriptions.description import DescriptionError
from navbench.descriptions.record import Outcome, RobotRecord
from navbench.descriptions.robot import Robot
from navbench.descriptions.sensors import Sensors
from navbench.descriptions.simulation import SimulatorOptions
from navbench.descriptions.world import Start, World
from navbench.loop.perception import Perception
from navbench.loop.similarity import Native, Similarity, accel_max_mps2, native_setup, period_s
from navbench.mathematics.geometry import distance_to_nearest, wrap_angle
from navbench.mathematics.metrics import Metrics, bearing_errors, heading_ise, sign_changes
from navbench.mathematics.streams import stream
from navbench.physics.simulator import Simulator

FloatArray = NDArray[np.float64]

START_DRAWS_MAX = 1000  # a start that stays in contact this often has no free place within its jitter


class Jitter(NamedTuple):
    """How far starts are moved at random: uniform in [-j, j], for x and y [m] and for the heading [rad]."""

    position_m: float = 0.0
    heading_rad: float = 0.0


@dataclass(slots=True)
class _Pilot:
    """One robot's controller with its sensors, and what is kept of its way."""

    controller: Controller
    perception: Perception
    states: list[tuple[float, ...]] = field(default_factory=list)
    traces: list[bytes] = field(default_factory=list)
    trace_names: tuple[str, ...] | None = None
    latencies_s: list[float] = field(default_factory=list)
    outcome: Outcome = "timed_out"
    reason: str = ""
    end_s: float = 0.0
    _in_order: Callable[[Mapping[str, float]], tuple[float, ...]] = field(default=lambda _: ())
    _packed: Callable[..., bytes] = bytes

    def keep_trace(self, trace: Mapping[str, float]) -> None:
        """Keep one act's trace, packed: it is checked by packing and takes little room.

        Raises:
            ValueError: its names are not those of the first act.
            struct.error: a value is no number.
        """
        if self.trace_names is None:
            self.trace_names = names = tuple(trace)
            self._packed = struct.Struct(f"{len(names)}d").pack
            self._in_order = itemgetter(*names) if len(names) > 1 else lambda one: tuple(one[name] for name in names)
        try:
            values = self._in_order(trace) if len(trace) == len(self.trace_names) else None
        except KeyError:
            values = None
        if values is None:
            raise ValueError(
                f"the trace must have the same names at every step: {', '.join(self.trace_names) or 'none'}"
            )
        self.traces.append(self._packed(*values))


class EpisodeRunner:
    """Runs episodes of one combination of world, robot, sensors, simulator and controller, one after another.

    Episodes do not depend on what ran before them. Use it in a ``with`` block: it holds a simulator.
    ``make_controller`` and ``seed`` may be set anew between two episodes, as a tuning does.

    Args:
        make_controller: makes one controller object, for one robot.
        native: what the controller was drawn for, or None.
        world: the world.
        robot: the robot that drives.
        sensors: the sensor suite, as drawn: it is scaled here.
        options: the simulator's options.
        seed: the seed of all streams.
        jitter: of the starts.

    Raises:
        DescriptionError: these do not fit together (see ``check_fits``).
    """

    def __init__(
        self,
        make_controller: Callable[[], Controller],
        native: Native | None,
        world: World,
        robot: Robot,
        sensors: Sensors,
        options: SimulatorOptions,
        seed: int,
        jitter: Jitter,
    ) -> None:
        check_fits(world, robot)
        self._native, self._world, self._robot, self._jitter = native, world, robot, jitter
        self.make_controller, self.seed = make_controller, seed
        self._boxes, self._discs = world.box_rows(), world.disc_rows()
        self._sensors = sensors.scaled_to(robot.radius_m)
        self._similarity = Similarity.between(robot, native)
        self._period_s = period_s(native, self._similarity)
        self._setup = native_setup(robot, self._sensors, native)
        accel_max = accel_max_mps2(robot, native, self._similarity)
        self._simulator = Simulator(world, robot, self._sensors, options, accel_max)

    def __enter__(self) -> "EpisodeRunner":
        """Return the runner itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the simulator."""
        self._simulator.close()

    def run(self, episode: int) -> list[RobotRecord]:
        """Run one episode and return a record a robot.

        Args:
            episode: its index, which names its streams.
        """
        starts = self.starts(episode)
        simulator = self._simulator
        simulator.reset(starts)
        pilots = [self._pilot(i, start, episode) for i, start in enumerate(starts)]
        for i, pilot in enumerate(pilots):
            if pilot.outcome == "controller_error":
                simulator.stop(i)
        rows = simulator.rows()
        periods = math.ceil(self._world.time_limit_s / self._period_s - 1e-9)
        for k in range(periods):
            if not simulator.running:
                break
            t_s = k * self._period_s
            rows = self._period(pilots, rows, t_s, min(self._period_s, self._world.time_limit_s - t_s))
        return [self._record(i, pilot, rows[i]) for i, pilot in enumerate(pilots)]

    def starts(self, episode: int) -> list[Pose]:
        """Return where the robots begin: the world's starts, moved at random, drawn again while in contact.

        A start that lies outside the bounds or behind an obstacle, seen from the world's own, is drawn again too.
        """
        world = self._world
        poses: list[Pose] = []
        for i, start in enumerate(world.starts):
            rng = stream(self.seed, world.name, episode, "start", i)
            for _ in range(START_DRAWS_MAX):
                dx, dy, turn = rng.uniform(-1.0, 1.0, 3).tolist()
                pose = Pose(
                    start.x_m + dx * self._jitter.position_m,
                    start.y_m + dy * self._jitter.position_m,
                    wrap_angle(world.start_heading_rad(i) + turn * self._jitter.heading_rad),
                )
                if self._reachable(start, pose) and _free(pose, self._robot.radius_m, self._boxes, self._discs, poses):
                    poses.append(pose)
                    break
            else:
                raise DescriptionError(f"start_jitter_m: no free place near world.starts[{i}]")
        return poses

    def _reachable(self, start: Start, pose: Pose) -> bool:
        """Return whether a drawn start lies inside the bounds and on the same side of everything as the world's own."""
        if not self._world.bounds.hold(pose.x_m, pose.y_m):
            return False
        dx, dy = pose.x_m - start.x_m, pose.y_m - start.y_m
        steps = math.ceil(math.hypot(dx, dy) / (0.25 * self._robot.radius_m))
        return all(
            distance_to_nearest(start.x_m + dx * k / steps, start.y_m + dy * k / steps, self._boxes, self._discs) > 0.0
            for k in range(1, steps)
        )

    def _pilot(self, index: int, start: Pose, episode: int) -> _Pilot:
        world = self._world
        goal = (world.goals[index].x_m, world.goals[index].y_m)
        name = (self.seed, world.name, episode, index)
        perception = Perception(self._sensors, self._similarity, self._robot.track_m, start, goal, name)
        rng = stream(self.seed, world.name, episode, "controller", index)
        try:
            controller = self.make_controller()
            controller.reset(self._setup, rng)
        except (Exception, SystemExit) as error:  # a user's code may raise anything; it costs this robot, not the study
            return _Pilot(_Absent(), perception, outcome="controller_error", reason=_reason(error))
        return _Pilot(controller, perception)

    def _period(
        self, pilots: list[_Pilot], before: list[tuple[float, ...]], t_s: float, dt_s: float
    ) -> list[tuple[float, ...]]:
        """Let every running robot observe and act, then move all; keep what they did and return their new rows."""
        simulator = self._simulator
        active = [i for i, row in enumerate(before) if row[11]]
        for i in active:
            self._act(pilots[i], i, t_s, before[i])
        events = simulator.advance(t_s, dt_s) if simulator.running else []
        ends = {event.robot_index: event for event in events}
        after = simulator.rows()
        for i in active:
            pilot, (x, y, heading), row = pilots[i], before[i][:3], after[i]
            if pilot.outcome == "controller_error":
                pilot.states.append((t_s, x, y, heading, 0.0, 0.0))
                pilot.end_s = t_s
                continue
            pilot.end_s = t_s + dt_s
            duration = dt_s
            if i in ends:
                _, pilot.outcome, pilot.reason, pilot.end_s = ends[i]
                duration = max(pilot.end_s - t_s, 1e-12)
            left, right = row[5], row[6]
            v, w = 0.5 * (left + right) / duration, (right - left) / self._robot.track_m / duration
            pilot.states.append((t_s, x, y, heading, v, w))
            if pilot.perception.drifts:
                pilot.perception.travel(left, right, duration)
        return after

    def _act(self, pilot: _Pilot, index: int, t_s: float, row: tuple[float, ...]) -> None:
        """Let one robot observe and act; what it does wrong ends it with a reason."""
        simulator = self._simulator
        speed = (0.5 * (row[3] + row[4]), (row[4] - row[3]) / self._robot.track_m)
        discs = None if self._sensors.tracker is None else simulator.tracked_discs(index)
        observation = pilot.perception.observe(
            t_s, Pose(row[0], row[1], row[2]), speed, simulator.ranges(index, row[7]), simulator.touching[index], discs
        )
        try:
            begin = time.perf_counter()
            command = pilot.controller.act(observation)
            pilot.latencies_s.append(time.perf_counter() - begin)
            v, w = command
            if not (math.isfinite(v) and math.isfinite(w)):
                raise ValueError(f"the command must be finite, got v_mps={v}, w_radps={w}")
            pilot.keep_trace(trace_of(pilot.controller))
            if not self._similarity.identity:
                v, w = self._similarity.to_world(Command(v, w))
            simulator.command(index, v, w)
        except (Exception, SystemExit) as error:  # a user's code may raise anything; it costs this robot, not the study
            pilot.outcome, pilot.reason = "controller_error", _reason(error)
            simulator.stop(index)

    def _record(self, index: int, pilot: _Pilot, row: tuple[float, ...]) -> RobotRecord:
        last = pilot.states[-1] if pilot.states else (0.0,) * 6
        states = np.array([*pilot.states, (pilot.end_s, *row[:3], *last[4:])])
        names = pilot.trace_names or ()
        traces = np.full((len(states), len(names)), np.nan)
        if names:
            traces[: len(pilot.traces)] = np.frombuffer(b"".join(pilot.traces)).reshape(-1, len(names))
        if pilot.outcome == "controller_error":
            states = states[:-1] if pilot.states else states
            traces = traces[: len(states)]
        durations = np.diff(states[:, 0])
        n = len(durations)
        if "heading_error_rad" in names:
            errors = traces[:n, names.index("heading_error_rad")]
        else:
            goal = self._world.goals[index]
            errors = bearing_errors(states[:n, 1:4], goal.x_m, goal.y_m)
        metrics = Metrics(
            path_length_m=row[9],
            time_s=pilot.end_s,
            collisions=self._simulator.contacts[index],
            min_clearance_m=row[8],
            mean_speed_mps=row[9] / pilot.end_s if pilot.end_s > 0.0 else 0.0,
            heading_ise=heading_ise(errors, durations),
            total_turning_rad=row[10],
            w_sign_changes=sign_changes(states[:n, 5]),
        )
        latencies = np.array(pilot.latencies_s)
        return RobotRecord(index, pilot.outcome, pilot.reason, metrics, states, traces, names, latencies)


def check_fits(world: World, robot: Robot) -> None:
    """Check that every robot stands free at its start.

    Raises:
        DescriptionError: a start lies inside an obstacle or too near to another start.
    """
    boxes, discs = world.box_rows(), world.disc_rows()
    poses: list[Pose] = []
    for i, start in enumerate(world.starts):
        pose = Pose(start.x_m, start.y_m, 0.0)
        if not _free(pose, robot.radius_m, boxes, discs, poses):
            near = distance_to_nearest(start.x_m, start.y_m, boxes, discs)
            what = "an obstacle" if near <= robot.radius_m else "another start"
            raise DescriptionError(
                f"world.starts[{i}]: ({start.x_m}, {start.y_m}) must lie further than the robot's radius "
                f"{robot.radius_m} m from {what}" + ("" if what == "an obstacle" else "'s robot")
            )
        poses.append(pose)


def _free(pose: Pose, radius_m: float, boxes: FloatArray, discs: FloatArray, others: list[Pose]) -> bool:
    """Return whether a robot stands free of the obstacles and of the robots already placed."""
    if distance_to_nearest(pose.x_m, pose.y_m, boxes, discs) <= radius_m:
        return False
    return all(math.hypot(pose.x_m - other.x_m, pose.y_m - other.y_m) > 2.0 * radius_m for other in others)


def _reason(error: BaseException) -> str:
    """Return an exception as one short line."""
    text = " ".join(f"{type(error).__name__}: {error}".split())
    return text if len(text) <= 200 else text[:197] + "..."


class _Absent:
    """Stands where a controller could not be made; it never acts."""

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Do nothing."""

    def act(self, observation: Observation) -> Command:
        """Do not come here."""
        raise AssertionError("a robot without a controller does not act")
