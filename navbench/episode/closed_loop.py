"""The compiled loop: sensing, a policy, motion and recording of all robots, many control periods in one call."""

import math
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import typeof, types
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from navbench.compiled import compiled
from navbench.episode.perception import believe, read, track
from navbench.memory import borrowed
from navbench.policy import SIGNATURE
from navbench.simulation.motion import RUNNING, STOPPED, Pipeline, Scenery, advance, other_robots, set_command
from navbench.simulation.planar import read_ring

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_types: Any = types  # numba's are untyped


@compiled
def close(
    step: Any,
    policies: tuple[FloatArray, FloatArray, FloatArray],
    robots: NDArray[np.void],
    pipeline: Pipeline,
    scenery: Scenery,
    fixed: NDArray[np.void],
    ring: tuple[NDArray[np.void], float, FloatArray],
    senses: tuple[NDArray[np.void], FloatArray, FloatArray, FloatArray, FloatArray, FloatArray],
    errors: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    clock: tuple[int, int, float, float],
    room: tuple[FloatArray, FloatArray, FloatArray],
    kept: tuple[FloatArray, FloatArray, IntArray, FloatArray],
) -> int:
    """Run control periods until no robot runs, and return how many were begun.

    Args:
        step: a policy's step, the same for all robots.
        policies: states, parameters and latest traces, (n, ...) each.
        robots: (n,) of ``ROBOT``.
        pipeline: as ``Simulator.pipeline``.
        scenery: as ``Scene.arrays``.
        fixed: as ``Simulator.fixed``.
        ring: rays, their reach [m], and what each sensor reads where nothing is (n_sensors,) [m].
        senses: (1,) of ``SENSING``; least and largest readings (n_sensors,); the native goals (n, 2); the believed
            poses and speeds (n, 5); the encoders' scales (n, 2).
        errors: of ranges (n, periods, ...), dropouts, places and travel, as ``Errors`` and ``draw_travel``.
        clock: the number of the first control period and after the last one; a period's length, the time limit [s].
        room: for a robot's rays, as ``read_ring``; for a ring's readings; for the discs around a robot.
        kept: states and traces (n, periods, ...), written: those of each period begun while the robot ran; and how
            many these are, (n,). The last state of a robot that was stopped holds its command. Then
            what the sensors read [m], (n, periods, n_sensors), or (n, 0, 0) where that is not kept.
    """
    states, parameters, traces = borrowed(policies)
    robots, pipeline, scenery, fixed = borrowed(robots), borrowed(pipeline), borrowed(scenery), borrowed(fixed)
    ring, senses, errors, room, kept = (
        borrowed(ring),
        borrowed(senses),
        borrowed(errors),
        borrowed(room),
        borrowed(kept),
    )
    rays, reach_m, unobstructed = ring
    sensing, least, most, goals, believed, scales = senses
    range_errors, dropouts, places, travels = errors
    beams, ranges, around = room
    kept_states, kept_traces, kept_counts, kept_ranges = kept
    count, radius_m, track_m = robots.shape[0], fixed[0].radius_m, fixed[0].track_m
    length, time = sensing[0].length, sensing[0].time
    acted = np.zeros(count, np.int64)
    running = 0
    for i in range(count):
        running += robots[i].running
    for k in range(clock[0], clock[1]):
        if running == 0:
            return k - clock[0]
        row = k - clock[0]
        t_s = k * clock[2]
        dt_s = min(clock[2], clock[3] - t_s)
        for i in range(count):
            robot = robots[i]
            acted[i] = robot.running
            if not robot.running:
                continue
            ranges[:] = unobstructed
            read_ring(robots, i, scenery, rays, reach_m, radius_m, beams, ranges)
            read(ranges, range_errors[i, row], dropouts[i, row], least, most, sensing)
            if kept_ranges.shape[1]:
                kept_ranges[i, row] = ranges * length
            if not sensing[0].drifts:
                believed[i, 0], believed[i, 1], believed[i, 2] = robot.x_m, robot.y_m, robot.heading_rad
                believed[i, 3] = 0.5 * (robot.left_mps + robot.right_mps)
                believed[i, 4] = (robot.right_mps - robot.left_mps) / track_m
            seen = 0
            if sensing[0].tracks:
                discs = _gather(robots, i, scenery, radius_m, around)
                seen = track(
                    around[:discs], places[i, row], robot.x_m, robot.y_m, robot.heading_rad, believed[i], sensing
                )
            v, w = step(
                states[i],
                parameters[i],
                ranges,
                around[:seen],
                (believed[i, 0] / length, believed[i, 1] / length, believed[i, 2]),
                (goals[i, 0], goals[i, 1]),
                (believed[i, 3] * time / length, believed[i, 4] * time),
                traces[i],
            )
            kept_counts[i] = row + 1
            kept_traces[i, row] = traces[i]
            if not (math.isfinite(v) and math.isfinite(w)):
                kept_traces[i, row] = math.nan
            kept_states[i, row, 0], kept_states[i, row, 1], kept_states[i, row, 2] = t_s, robot.x_m, robot.y_m
            kept_states[i, row, 3], kept_states[i, row, 4], kept_states[i, row, 5] = robot.heading_rad, v, w
            if not set_command(pipeline[0], i, v * length / time, w / time, fixed):
                robot.running, robot.outcome, robot.end_s = 0, STOPPED, t_s
        running = advance(robots, pipeline, scenery, fixed, t_s, dt_s)
        for i in range(count):
            robot = robots[i]
            if acted[i] and robot.outcome != STOPPED:
                duration_s = dt_s if robot.outcome == RUNNING else max(robot.end_s - t_s, 1e-12)
                left, right = robot.left_travel_m, robot.right_travel_m
                kept_states[i, row, 4] = 0.5 * (left + right) / duration_s
                kept_states[i, row, 5] = (right - left) / track_m / duration_s
                if sensing[0].drifts:
                    believe(believed[i], scales[i], left, right, duration_s, travels[i, row], sensing)
    return clock[1] - clock[0]


@compiled
def _gather(robots: NDArray[np.void], index: int, scenery: Scenery, radius_m: float, around: FloatArray) -> int:
    """Write everything round, as seen by one robot, and return how much it is."""
    discs, polygons = scenery[1], scenery[2]
    count: int = discs.shape[0] + polygons.shape[0]
    around[: discs.shape[0]] = discs
    around[discs.shape[0] : count] = polygons[:, :5]
    other_robots(robots, index, radius_m, around[count:])
    others: int = robots.shape[0] - 1
    return count + others


def _remember(step: Any) -> None:
    """Let numba find a step's machine code at once: it asks twice a call, and would search for 100 us."""
    found = step.get_compile_result(SIGNATURE)
    library = SimpleNamespace(get_pointer_to_function=cache(found.library.get_pointer_to_function))
    known = SimpleNamespace(fndesc=found.fndesc, library=library)
    step.get_compile_result = lambda _: known


class _Loop:
    """``close`` around any policy's step; the machine code is one for all steps."""

    def __init__(self) -> None:
        self._close: Any = None
        self._steps: set[Any] = set()

    def __call__(self, step: Any, *arguments: Any) -> int:
        """Return what ``close`` returns."""
        if not isinstance(step, Dispatcher):
            return int(close(step, *arguments))
        if step not in self._steps:
            step.compile(SIGNATURE.args)
            _remember(step)
            self._steps.add(step)
        if self._close is None:
            loop: Any = close
            loop.compile((_types.FunctionType(SIGNATURE), *map(typeof, arguments)))
            loop.disable_compile()
            (overload,) = loop.overloads.values()
            self._close = overload.entry_point  # the types of arguments are always those, and not looked up again
        return int(self._close(step, *arguments))


run_closed = _Loop()
