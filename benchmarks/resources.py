"""Memory over many episodes, start-up, and where an episode's time goes."""

import gc
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
import psutil

from benchmarks.field import PERIOD_S, RAYS, ROBOT, SPEED_MPS, CompiledRule, Field, step
from benchmarks.harness import Cell, Effort, Table, median
from navbench.cli.configuration import compose_cell
from navbench.cli.study_configuration import compose_study
from navbench.compiled import compiled
from navbench.policy import Policy
from navbench.simulation.motion import advance
from navbench.simulation.planar import PlanarSimulator, read_ring

WORLDS = {"discs": "random_discs", "polygons and movers": "random_movers", "robots that meet": "random_crossing"}
COMMANDS = {
    "navbench --help": ("--help",),
    "one episode, planar": ("controller=sflc", "world=no_deadlock", "simulator=planar"),
    "one episode, pybullet": ("controller=sflc", "world=no_deadlock", "simulator=pybullet"),
}


def resident_mb(world: str, simulator: str, after: tuple[int, ...]) -> list[float]:
    """Return the memory that this process holds after so many short episodes, each a layout of its own [MB]."""
    found = []
    cell = compose_cell("controller=oa_to", f"world={world}", f"simulator={simulator}", "world.time_limit_s=1.0")
    with cell.runner() as runner:
        for episode in range(after[-1] + 1):
            runner.run(episode)
            if episode in after:
                gc.collect()
                found.append(psutil.Process().memory_info().rss / 1e6)
    return found


def memory(effort: Effort) -> Table:
    """Measure memory, a process for each case; flat is what grows by at most 5 MB."""
    after = (effort.cut(100), effort.cut(1000, 3), effort.cut(10000, 4))
    rows: list[tuple[Cell, ...]] = []
    for name, world in list(WORLDS.items())[: effort.few(len(WORLDS))]:
        for simulator in ("pybullet", "planar"):
            with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
                held = process.submit(resident_mb, world, simulator, after).result()
            rows.append((f"{name}, {simulator}", *held, held[-1] - held[0]))
    header = ("", *(f"after {count:,} [MB]" for count in after), "growth [MB]")
    return Table("Memory", "Resident memory of a process that runs episodes, another layout each.", header, rows)


def startup(effort: Effort) -> Table:
    """Measure the command line in new processes, with compiled code kept and without, and a study's composition."""
    rows: list[tuple[Cell, ...]] = []
    for name, command in list(COMMANDS.items())[: effort.few(len(COMMANDS))]:
        found: tuple[list[float], list[float]] = [], []
        for _ in range(effort.few(effort.rounds)):
            with tempfile.TemporaryDirectory() as folder:
                for seconds in found:
                    seconds.append(cpu_seconds([sys.executable, "-m", "navbench", *command], folder))
        rows.append((name, *map(median, found)))
    begin_s = time.process_time()
    compose_study("smoke" if effort.is_quick else "papers")
    rows.append(("composing a study", "", time.process_time() - begin_s))
    return Table("Start-up", "CPU seconds of a new process.", ("", "nothing kept", "compiled code kept"), rows)


def cpu_seconds(command: list[str], folder: str) -> float:
    """Return what a command takes that works, and keeps compiled code, in a folder [s]."""
    begin = os.times()
    environment = {**os.environ, "NAVBENCH_CACHE_DIR": folder}
    subprocess.run(command, env=environment, cwd=folder, check=True, capture_output=True)
    end = os.times()
    return end.children_user - begin.children_user + end.children_system - begin.children_system


def shares(effort: Effort) -> Table:
    """Measure what each part of an episode takes."""
    parts = {"pybullet": bullet_parts, "planar": planar_parts}
    found = {name: [of(effort) for _ in range(effort.rounds)] for name, of in parts.items()}
    kinds = ("rays", "motion", "controller", "recording", "rest")
    rows: list[tuple[Cell, ...]] = [
        (name, *(median([100.0 * one[kind] / sum(one.values()) for one in rounds]) for kind in kinds))
        for name, rounds in found.items()
    ]
    text = "In percent, of episodes of 50 robots on the field, a compiled rule."
    return Table("Where the time goes", text, ("", *kinds), rows)


def timed(owner: Any, name: str, spent: dict[str, float], part: str) -> None:
    """Replace a function of an object by one that adds its time to a part's."""
    function: Callable[..., Any] = getattr(owner, name)

    def call(*arguments: Any) -> Any:
        begin = time.perf_counter()
        done = function(*arguments)
        spent[part] += time.perf_counter() - begin
        return done

    setattr(owner, name, call)


def bullet_parts(effort: Effort) -> dict[str, float]:
    """Return the seconds that the parts of an episode on PyBullet take."""
    spent = dict.fromkeys(("rays", "motion", "controller", "recording"), 0.0)

    def timed_rule(turn_radps: float) -> CompiledRule:
        made = CompiledRule(turn_radps)
        timed(made, "act", spent, "controller")
        return made

    with Field(50, 10).runner("pybullet", timed_rule, effort.cut(500)) as runner:
        for owner, name, part in (
            (runner.simulator, "ranges", "rays"),
            (runner.simulator, "advance", "motion"),
            (runner, "record", "recording"),
        ):
            timed(owner, name, spent, part)
        begin = time.perf_counter()
        runner.run(0)
        whole = time.perf_counter() - begin
    return spent | {"rest": whole - sum(spent.values())}


def planar_parts(effort: Effort) -> dict[str, float]:
    """Return the seconds that the parts of an episode take in compiled code: each part repeated by itself."""
    count, spent = effort.cut(500), {"recording": 0.0}
    with Field(50, 10).runner("planar", CompiledRule, count) as runner:
        runner.run(0)
        timed(runner, "record", spent, "recording")
        begin = time.perf_counter()
        runner.run(0)
        whole = time.perf_counter() - begin
        simulator, policy = runner.simulator, Policy(step=step, parameters=np.zeros(1))
        assert isinstance(simulator, PlanarSimulator)
        rays, arrays, ranges = simulator.rays, simulator.scene.arrays, np.ones(RAYS)
        ring = (rays.table, rays.reach_m, ROBOT.radius_m, simulator.beams, ranges)
        told = (policy.state, policy.parameters, ranges, np.empty((0, 5)), policy.trace)
        calls: dict[str, Callable[[int], None]] = {
            "rays": lambda n: repeat_rays(n, simulator.robots, arrays, *ring),
            "motion": lambda n: repeat_motion(n, simulator.robots, simulator.pipeline, arrays, simulator.fixed),
            "controller": lambda n: repeat_step(n * 50, step, *told),
        }
        for part, call in calls.items():
            call(1)
            begin = time.perf_counter()
            call(count)
            spent[part] = time.perf_counter() - begin
    return spent | {"rest": max(whole - sum(spent.values()), 0.0)}


@compiled
def repeat_rays(
    n: int, robots: Any, scenery: Any, table: Any, reach_m: float, radius_m: float, beams: Any, ranges: Any
) -> None:
    """Read every robot's ring n times."""
    for _ in range(n):
        for i in range(robots.shape[0]):
            read_ring(robots, i, scenery, table, reach_m, radius_m, beams, ranges)


@compiled
def repeat_motion(n: int, robots: Any, pipeline: Any, scenery: Any, fixed: Any) -> None:
    """Move all robots through n control periods."""
    for k in range(n):
        advance(robots, pipeline, scenery, fixed, PERIOD_S * k, PERIOD_S)


@compiled
def repeat_step(n: int, act: Any, state: Any, parameters: Any, ranges: Any, discs: Any, trace: Any) -> None:
    """Ask a policy n times."""
    for k in range(n):
        act(state, parameters, ranges, discs, (4.0, 0.1 * k, 1.0), (0.0, 0.0), (SPEED_MPS, 0.0), trace)
