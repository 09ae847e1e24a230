"""Where the time of an episode goes: rays, motion, controller, recording, and the rest.

PyBullet is watched while it runs. In planar nothing can be watched, so the parts of an episode are run again by
themselves, compiled: its commands move the robots, with their rays and without, and its observations are answered.
"""

import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Any

import numpy as np

from benchmarks.field import CompiledRule, Field
from benchmarks.harness import Cell, Effort, Table, median
from benchmarks.loops import SHIPPED
from navbench.compiled import compiled
from navbench.contract import Command, Controller, Observation, Setup
from navbench.episode.loop import EpisodeRunner
from navbench.policy import CompiledController
from navbench.simulation.motion import advance, set_command
from navbench.simulation.planar import PlanarSimulator, read_ring

KINDS = ("rays", "motion", "controller", "recording", "rest")

Make = Callable[[str, ExitStack], EpisodeRunner]


def shares(effort: Effort) -> Table:
    """Measure what each part of an episode takes."""
    made: dict[str, Make] = {"a trivial rule, 50 robots": partial(in_field, effort.cut(500))}
    made |= {name: partial(of_cell, cell) for name, cell in SHIPPED.items()}
    rows: list[tuple[Cell, ...]] = []
    for name, make in [*made.items()][: effort.few(len(made))]:
        for simulator, parts in (("pybullet", bullet_parts), ("planar", planar_parts)):
            with ExitStack() as on:
                runner = make(simulator, on)
                found = [parts(runner) for _ in range(effort.rounds + 1)][1:]  # the first one compiles
            percent = [{kind: 100.0 * one[kind] / sum(one.values()) for kind in KINDS} for one in found]
            rows.append((name, simulator, *(median([one[kind] for one in percent]) for kind in KINDS)))
    text = "In percent of CPU time. The rest is drawing and placing episodes, sensing beyond the rays, and the loop."
    return Table("Where the time goes", text, ("", "simulator", *KINDS), rows)


def in_field(steps: int, simulator: str, on: ExitStack) -> EpisodeRunner:
    """Return what runs 50 robots on the field."""
    return Field(50, 10).runner(simulator, CompiledRule, steps, on)


def of_cell(cell: tuple[str, ...], simulator: str, on: ExitStack) -> EpisodeRunner:
    """Return what runs a cell."""
    from navbench.cli.configuration import compose_cell

    return on.enter_context(compose_cell(*cell, f"simulator={simulator}").runner())


def seconds(do: Callable[..., Any], *arguments: Any) -> float:
    """Return the CPU time that something takes [s]."""
    begin = time.process_time()
    do(*arguments)
    return time.process_time() - begin


def timed(owner: Any, name: str, spent: dict[str, float], part: str) -> None:
    """Replace a function of an object by one that adds its time to a part's."""
    function: Callable[..., Any] = getattr(owner, name)

    def call(*arguments: Any) -> Any:
        begin = time.process_time()
        done = function(*arguments)
        spent[part] += time.process_time() - begin
        return done

    setattr(owner, name, call)


def bullet_parts(runner: EpisodeRunner) -> dict[str, float]:
    """Return the seconds that the parts of an episode on PyBullet take."""
    spent, make = dict.fromkeys(KINDS[:-1], 0.0), runner.make_controller
    simulator = runner.simulator

    def timed_controller() -> Controller:
        made = make()
        timed(made, "act", spent, "controller")
        return made

    runner.make_controller = timed_controller
    for owner, name, part in (
        (simulator, "ranges", "rays"), (simulator, "advance", "motion"), (runner, "record", "recording"),
    ):  # fmt: skip
        timed(owner, name, spent, part)
    runner.run(0)  # makes the controllers, which other episodes take again
    spent.update(dict.fromkeys(spent, 0.0))
    whole = seconds(runner.run, 0)
    runner.make_controller = make
    for owner, name in ((simulator, "ranges"), (simulator, "advance"), (runner, "record")):
        delattr(owner, name)
    return spent | {"rest": whole - sum(spent.values())}


class Watched:
    """A controller whose observations and commands are kept."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.looks: list[Observation] = []
        self.commands: list[Command] = []

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Begin an episode."""
        self._controller.reset(setup, rng)

    def act(self, look: Observation) -> Command:
        """Return the controller's command."""
        self.looks.append(look._replace(ranges_m=look.ranges_m.copy(), discs=look.discs.copy()))
        self.commands.append(self._controller.act(look))
        return self.commands[-1]


def watched(runner: EpisodeRunner) -> list[Watched]:
    """Return what was seen and told in an episode, by robot."""
    make, robots = runner.make_controller, []

    def watched_controller() -> Controller:
        robots.append(Watched(make()))
        return robots[-1]

    runner.make_controller = watched_controller
    runner.run(0)
    runner.make_controller = make
    return robots


def planar_parts(runner: EpisodeRunner) -> dict[str, float]:
    """Return the seconds that the parts of an episode in planar take, each run again by itself."""
    robots, spent = watched(runner), dict.fromkeys(KINDS[:-1], 0.0)
    runner.run(0)
    timed(runner, "record", spent, "recording")
    whole = seconds(runner.run, 0)
    delattr(runner, "record")
    spent["motion"], with_rays = (driven_s(runner, robots, has_rays) for has_rays in (False, True))
    spent["rays"] = max(with_rays - spent["motion"], 0.0)
    spent["controller"] = sum(answered_s(runner, robot.looks) for robot in robots)
    return spent | {"rest": max(whole - sum(spent.values()), 0.0)}


def driven_s(runner: EpisodeRunner, robots: list[Watched], has_rays: bool) -> float:
    """Return how long it takes to move robots by their commands, and to read their rings [s]."""
    runner.begin(runner.draw(0), 0)
    simulator, similarity = runner.simulator, runner._similarity
    assert isinstance(simulator, PlanarSimulator)
    simulator.reserve(min(runner.period_s, runner.time_limit_s))
    commands = np.zeros((len(robots), max(len(robot.commands) for robot in robots), 2))
    for told, robot in zip(commands, robots, strict=True):
        told[: len(robot.commands)] = [similarity.to_world(command) for command in robot.commands]
    rays = simulator.rays
    ring = rays.table, rays.reach_m, rays.unobstructed, simulator.beams, rays.unobstructed.copy()
    where = simulator.robots, simulator.pipeline, simulator.scene.arrays, simulator.fixed
    return seconds(drive, commands, has_rays, *where, (runner.period_s, runner.time_limit_s), ring)


def answered_s(runner: EpisodeRunner, looks: list[Observation]) -> float:
    """Return how long a policy takes to answer all that one robot saw [s]."""
    controller = runner.make_controller()
    controller.reset(runner.setup, np.random.default_rng(0))
    assert isinstance(controller, CompiledController)
    policy = controller.policy
    firsts = np.cumsum([0, *(len(look.discs) for look in looks)])
    discs = np.concatenate([np.empty((0, 5)), *(look.discs for look in looks)])
    poses, goals, speeds = (
        np.array(rows)
        for rows in zip(*((look.pose, look.goal, (look.v_mps, look.w_radps)) for look in looks), strict=True)
    )
    seen = np.array([look.ranges_m for look in looks]), discs, firsts, poses, goals, speeds
    return seconds(answer, policy.step, policy.state, policy.parameters, policy.trace, *seen)


@compiled
def drive(
    commands: Any,
    has_rays: bool,
    robots: Any,
    pipeline: Any,
    scenery: Any,
    fixed: Any,
    clock: tuple[float, float],
    ring: Any,
) -> None:
    """Move robots by their commands (n, periods, 2), and read their rings where wanted."""
    table, reach_m, unobstructed, beams, ranges = ring
    for k in range(commands.shape[1]):
        for i in range(robots.shape[0]):
            if robots[i].running:
                if has_rays:
                    ranges[:] = unobstructed
                    read_ring(robots, i, scenery, table, reach_m, fixed[0].radius_m, beams, ranges)
                set_command(pipeline[0], i, commands[i, k, 0], commands[i, k, 1], fixed)
        advance(robots, pipeline, scenery, fixed, k * clock[0], min(clock[0], clock[1] - k * clock[0]))


@compiled
def answer(
    step: Any,
    state: Any,
    parameters: Any,
    trace: Any,
    ranges: Any,
    discs: Any,
    firsts: Any,
    poses: Any,
    goals: Any,
    speeds: Any,
) -> None:
    """Ask a policy for every observation of an episode."""
    for k in range(ranges.shape[0]):
        x, y, heading = poses[k]
        goal, speed = (goals[k, 0], goals[k, 1]), (speeds[k, 0], speeds[k, 1])
        step(state, parameters, ranges[k], discs[firsts[k] : firsts[k + 1]], (x, y, heading), goal, speed, trace)
