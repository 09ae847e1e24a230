"""Episodes side by side, each moved through one control period at a time, all in one compiled call.

Whoever asks is the controller: it gives commands and finds what the robots perceive then.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled, compiled_without_lock, direct
from navbench.contract import Command, Observation, Setup
from navbench.episode.loop import Drawn, EpisodeRunner
from navbench.episode.perception import Perception, believe, read
from navbench.episode.pilot import Pilot
from navbench.memory import borrowed, handed
from navbench.records import RobotRecord
from navbench.simulation.motion import RUNNING, Pipeline, Scenery, advance, set_command
from navbench.simulation.planar import ROWS, PlanarSimulator, read_ring
from navbench.validation import DescriptionError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Episode = tuple[  # see ``move``
    NDArray[np.void], Pipeline, Scenery, NDArray[np.void], FloatArray, FloatArray, FloatArray, FloatArray, FloatArray,
    FloatArray, FloatArray,
]  # fmt: skip

BLOCK = 64  # periods whose errors are drawn at once
SKIPS_MAX = 100  # episodes in a row of which no layout can be drawn
X, Y, HEADING, GOAL_X, GOAL_Y, V, W = range(7)  # of what is known


class Outside:
    """Stands for a controller where the commands come from outside; it never acts."""

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Do nothing."""

    def act(self, observation: Observation) -> Command:
        """Do not come here."""
        raise AssertionError("commands come from outside")


class Stepper:
    """Drives episodes of one cell in some places, side by side.

    Args:
        make_runner: makes what knows the episodes; one is made for each place.
        places: how many episodes go on at once.
        threads: how many threads share them.
        layouts: after how many episodes their layouts and starts come again, drawn once; None for never.
        keeps: whether states are kept, so that ``record`` can tell what a robot did.

    Attributes:
        setup: what a controller is told: the robot, the ring and the control period, native.
        robots: how many robots an episode has.
        ranges_m: (places, robots, n_sensors) what the rings read, native [m].
        known: (places, robots, 7) the believed x, y [m], heading [rad], the goal's x, y [m], v [m/s] and w [rad/s],
            native.
        outcomes: (places, robots) ``RUNNING``, ``REACHED`` or ``COLLIDED`` of ``navbench.simulation.motion``.
        distances_m: (places, robots) true distances to the goals.
        clearances_m: (places, robots) from the hulls to the nearest thing.
        begun: (places,) where an episode was begun since the last ``move``.
        periods: (places,) how many control periods each episode has had.
        periods_max: with how many the time limit is reached.
    """

    def __init__(
        self,
        make_runner: Callable[[], EpisodeRunner],
        places: int = 1,
        threads: int = 1,
        layouts: int | None = None,
        keeps: bool = True,
    ) -> None:
        self._runners = [make_runner() for _ in range(places)]
        runner = self._runners[0]
        self.setup, self.robots, self.periods_max = runner.setup, runner.robots, runner.periods
        sensors = len(self.setup.sensors)
        self._layouts, self._drawn = layouts, dict[int, Drawn]()
        self._pilots: list[list[Pilot]] = [[] for _ in range(places)]
        self._states = [np.empty((self.robots, self.periods_max if keeps else 0, 6)) for _ in range(places)]
        self._errors: list[list[FloatArray]] = [[] for _ in range(places)]
        self.begun = np.ones(places, np.bool_)
        self._episodes: Any = None
        self.ranges_m, self.known = np.empty((places, self.robots, sensors)), np.empty((places, self.robots, 7))
        self.outcomes, self._lasted = np.zeros((2, places, self.robots), np.int64)
        self.distances_m, self.clearances_m = np.empty((places, self.robots)), np.empty((places, self.robots))
        self.periods = np.zeros(places, np.int64)
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None
        edges = np.linspace(0, places, threads + 1).astype(int).tolist()
        self._shares = list(zip(edges[:-1], edges[1:], strict=True))
        self._closed = False

    def close(self) -> None:
        """End the threads, and close the simulators."""
        self._closed = True
        if self._pool is not None:
            self._pool.shutdown()
        for runner in self._runners:
            runner.simulator.close()

    def reseed(self, seed: int) -> None:
        """Let all episodes that are begun from now on be those of another seed."""
        self._drawn.clear()
        for runner in self._runners:
            runner.seed = seed

    def begin(self, place: int, episode: int) -> None:
        """Begin an episode; the next ``move`` only perceives there.

        Raises:
            DescriptionError: no layout can be drawn, or it has another number of robots.
            RuntimeError: it is closed.
        """
        self._check_open()
        runner, index = self._runners[place], episode if self._layouts is None else episode % self._layouts
        drawn = self._drawn.get(index) or runner.draw(index)
        if self._layouts is not None:
            self._drawn[index] = drawn
        if len(drawn.starts) != self.robots:
            raise DescriptionError(
                f"world={drawn.world.name}: has {len(drawn.starts)} robots in episode {index} and {self.robots} before"
            )
        pilots, simulator = runner.begin(drawn, episode), runner.simulator
        simulator.reserve(min(runner.period_s, runner.time_limit_s))
        self._pilots[place], sights = pilots, [pilot.perception for pilot in pilots]
        self._errors[place] = errors = _errors_of(sights, 1)
        begun: Any = (
            simulator.robots, simulator.pipeline, simulator.scene.arrays, simulator.fixed,
            *(np.array([getattr(sight, name) for sight in sights]) for name in ("goal", "believed", "wheel_scale")),
            *errors, self._states[place],
        )  # fmt: skip
        if self._episodes is None:
            self._episodes = handed(begun, len(self._runners))
        _put(self._episodes, place, begun)
        self.periods[place], self.begun[place] = 0, True

    def begin_next(self, place: int, episode: int, step: int) -> int:
        """Begin an episode, or the next one in steps of this of which a layout can be drawn, and return which one.

        Raises:
            DescriptionError: none can be drawn.
        """
        for skipped in range(SKIPS_MAX):
            try:
                self.begin(place, episode + skipped * step)
                return episode + skipped * step
            except DescriptionError as error:
                crowded = error
        raise crowded

    def move(self, commands: FloatArray) -> None:
        """Move all through one control period; where an episode was begun since, only perceive.

        Args:
            commands: (places, robots, 2) v [m/s] and w [rad/s], native and finite.

        Raises:
            RuntimeError: somewhere no episode was begun, or it is over; or all is closed.
        """
        self._check_open()
        over = (self.periods >= self.periods_max) | (self.outcomes != RUNNING).all(axis=1)
        if self._episodes is None or (over & ~self.begun).any():
            raise RuntimeError("no episode goes on: reset begins one")
        if self._runners[0].senses.errs:
            for place in np.flatnonzero(((self.periods + 1) % BLOCK == 0) & ~self.begun).tolist():
                sights = [pilot.perception for pilot in self._pilots[place]]
                for errors, drawn in zip(self._errors[place], _errors_of(sights), strict=True):
                    errors[:] = drawn
        call = partial(self._move, *self._arguments(commands))
        if self._pool is None:
            call(0, len(self._runners))
        else:
            list(self._pool.map(lambda share: call(*share), self._shares))
        self.periods += ~self.begun
        self.begun[:] = False

    def record(self, place: int, index: int) -> RobotRecord:
        """Return what one robot did, when it has ended or the time is over."""
        runner, pilot = self._runners[place], self._pilots[place][index]
        pilot.states = self._states[place][index, : self._lasted[place, index]]
        runner.end(index, pilot)
        return runner.record(index, pilot)

    def _check_open(self) -> None:
        if self._closed:
            raise RuntimeError("it is closed; make another one")

    def _arguments(self, commands: FloatArray) -> tuple[Any, ...]:
        runner = self._runners[0]
        simulator, senses = runner.simulator, runner.senses
        assert isinstance(simulator, PlanarSimulator)
        rays = simulator.rays
        return (
            self._episodes, commands, self.begun, self.periods, (rays.table, rays.reach_m, rays.unobstructed),
            (senses.constants, senses.least, senses.most), (runner.period_s, runner.time_limit_s), self.ranges_m,
            self.known, self.outcomes, self._lasted, (self.distances_m, self.clearances_m),
        )  # fmt: skip

    @cached_property
    def _move(self) -> Callable[..., None]:
        return direct(move, *self._arguments(np.zeros((1, 1, 2))), 0, 0)


def _errors_of(sights: Sequence[Perception], first: int = 0) -> list[FloatArray]:
    """Draw the errors of a block of observations and of the travel before each; before row ``first`` there is none.

    Returns:
        (robots, ``BLOCK``, ...) of ranges, dropouts and travel.
    """
    drawn = [sight.draw(BLOCK, 0) for sight in sights]
    travels = [np.pad(sight.draw_travel(BLOCK - first), ((first, 0), (0, 0))) for sight in sights]
    return [np.array([one.ranges for one in drawn]), np.array([one.dropouts for one in drawn]), np.array(travels)]


@compiled
def _put(places: Any, place: int, episode: Episode) -> None:
    """Put an episode in its place."""
    places[place] = episode


@compiled_without_lock
def move(
    episodes: Any,
    commands: FloatArray,
    begins: NDArray[np.bool_],
    periods: IntArray,
    ring: tuple[NDArray[np.void], float, FloatArray],
    senses: tuple[NDArray[np.void], FloatArray, FloatArray],
    clock: tuple[float, float],
    ranges: FloatArray,
    known: FloatArray,
    outcomes: IntArray,
    lasted: IntArray,
    facts: tuple[FloatArray, FloatArray],
    first: int,
    end: int,
) -> None:
    """Move some episodes through one control period, as ``close`` does, and let their robots perceive then.

    Args:
        episodes: of each its robots, pipeline, scenery and ``fixed``, as in ``close``; the native goals (n, 2), the
            believed poses and speeds (n, 5), the encoders' scales (n, 2); the errors of a block of periods (n, block,
            ...) of ranges, dropouts and travel; and the states (n, periods or 0, 6), written.
        commands: (places, n, 2) native.
        begins: (places,) whether an episode has just begun: then its robots only perceive.
        periods: (places,) the number of the control period.
        ring: rays, their reach [m], and what each sensor reads where nothing is (n_sensors,) [m].
        senses: (1,) of ``SENSING``; least and largest readings (n_sensors,) [m].
        clock: a period's length and the time limit [s].
        ranges: written, as ``Stepper.ranges_m``; of a robot that ended before only once.
        known: written, as ``Stepper.known``.
        outcomes: written, as ``Stepper.outcomes``.
        lasted: (places, n) written: in how many control periods each robot has run.
        facts: written, as ``Stepper.distances_m`` and ``Stepper.clearances_m``.
        first: the first place to move.
        end: the place after the last one.
    """
    rays, reach_m, unobstructed = borrowed(ring)
    sensing, least, most = borrowed(senses)
    distances, clearances = borrowed(facts)
    ranges, known, outcomes = borrowed(ranges), borrowed(known), borrowed(outcomes)
    length, time, beams = sensing[0].length, sensing[0].time, np.empty((ROWS, rays.shape[0]))
    for place in range(first, end):
        robots, pipeline, scenery, fixed, goals, believed, scales, noise, dropouts, travels, states = borrowed(
            episodes[place]
        )
        radius_m, track_m, count, k = fixed[0].radius_m, fixed[0].track_m, robots.shape[0], periods[place]
        t_s, row = k * clock[0], 0
        dt_s = min(clock[0], clock[1] - t_s)
        if not begins[place]:
            row = (k + 1) % noise.shape[1]
            for i in range(count):
                robot = robots[i]
                outcomes[place, i] = robot.outcome
                if robot.running:
                    lasted[place, i] = k + 1
                    if k < states.shape[1]:
                        states[i, k, 0], states[i, k, 1], states[i, k, 2] = t_s, robot.x_m, robot.y_m
                        states[i, k, 3] = robot.heading_rad
                    set_command(
                        pipeline[0], i, commands[place, i, 0] * length / time, commands[place, i, 1] / time, fixed
                    )
            advance(robots, pipeline, scenery, fixed, t_s, dt_s)
        for i in range(count):
            robot = robots[i]
            if not begins[place]:
                if outcomes[place, i] != RUNNING:
                    continue
                duration_s = dt_s if robot.outcome == RUNNING else max(robot.end_s - t_s, 1e-12)
                left, right = robot.left_travel_m, robot.right_travel_m
                if k < states.shape[1]:
                    states[i, k, 4] = 0.5 * (left + right) / duration_s
                    states[i, k, 5] = (right - left) / track_m / duration_s
                if sensing[0].drifts:
                    believe(believed[i], scales[i], left, right, duration_s, travels[i, row], sensing)
            ranges[place, i] = unobstructed
            read_ring(robots, i, scenery, rays, reach_m, radius_m, beams, ranges[place, i])
            read(ranges[place, i], noise[i, row], dropouts[i, row], least, most, sensing)
            if not sensing[0].drifts:
                believed[i, 0], believed[i, 1], believed[i, 2] = robot.x_m, robot.y_m, robot.heading_rad
                believed[i, 3] = 0.5 * (robot.left_mps + robot.right_mps)
                believed[i, 4] = (robot.right_mps - robot.left_mps) / track_m
            mine = known[place, i]
            mine[X], mine[Y] = believed[i, 0] / length, believed[i, 1] / length
            mine[HEADING], mine[GOAL_X], mine[GOAL_Y] = believed[i, 2], goals[i, 0], goals[i, 1]
            mine[V], mine[W] = believed[i, 3] * time / length, believed[i, 4] * time
            distances[place, i] = math.hypot(robot.x_m - robot.goal_x_m, robot.y_m - robot.goal_y_m)
            clearances[place, i], outcomes[place, i] = robot.clearance_m, robot.outcome
