"""The closed loop: whole episodes, metrics and trajectories kept, beside a bare PyBullet loop and other simulators."""

import math
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Any

import pybullet

from benchmarks.field import STEPS, CompiledRule, Field, PythonRule
from benchmarks.harness import Effort, Side, Sides, Table, compare, peer
from benchmarks.peers import irsim_steps, navground_steps
from navbench.cli.configuration import compose_cell
from navbench.episode.loop import EpisodeRunner
from navbench.simulation.bullet import BulletSimulator

FIELDS = {"1 robot": (1, 10), "3 robots": (3, 10), "50 robots": (50, 10), "1 robot, 50 discs": (1, 50)}
SHIPPED = {
    f"{cell[0].removeprefix('controller=')} in {cell[1].removeprefix('world=')}": cell
    for cell in (
        ("controller=sflc", "world=deadlock"),
        ("controller=pid", "world=no_deadlock"),
        ("controller=oa_to", "world=zhao2018_static"),
        ("controller=multi_agent", "world=nemeiksis_rooms"),
        ("controller=dual_layer", "world=lei_circle6"),
        ("controller=oa_to", "world=swap_circle", "world.source.robots=100"),
    )
}


def whole_episodes(runner: EpisodeRunner) -> Side:
    """Return a function that runs one whole episode, and returns its robot-steps."""
    return lambda: sum(len(record.states) - 1 for record in runner.run(0))


def bare_loop(runner: EpisodeRunner) -> Side:
    """Return PyBullet alone over the poses of one of the runner's episodes: poses, detection, contacts, all rays."""
    records, simulator = runner.run(0), runner.simulator
    assert isinstance(simulator, BulletSimulator)
    client, scale, begins, ends = simulator.client, simulator.scale, simulator.begins, simulator.ends
    poses = [
        [
            (k, body, (x * scale, y * scale, 0.0), (0.0, 0.0, math.sin(0.5 * turn), math.cos(0.5 * turn)))
            for k, (_, x, y, turn, _, _) in enumerate(record.states[:-1].tolist())
        ]
        for body, record in zip(simulator.bodies, records, strict=True)
    ]
    steps: list[list[Any]] = [[] for _ in max(poses, key=len)]
    for k, *pose in sum(poses, []):
        steps[k].append((pose[0], pose[1], pose[2]))

    def loop() -> int:
        for robots in steps:
            for body, position, turn in robots:
                pybullet.resetBasePositionAndOrientation(body, position, turn, physicsClientId=client)
            pybullet.performCollisionDetection(physicsClientId=client)
            pybullet.getContactPoints(physicsClientId=client)
            for body, _, _ in robots:
                pybullet.rayTestBatch(begins, ends, parentObjectUniqueId=body, physicsClientId=client)
        return sum(map(len, steps))

    return loop


def in_field(robots: int, discs: int, steps: int, on: ExitStack) -> Sides:
    """Return all sides that drive in one field."""
    field = Field(robots, discs)
    return {
        "PyBullet alone, no controller": bare_loop(field.runner("pybullet", steps=steps, on=on)),
        "pybullet, Python rule": whole_episodes(field.runner("pybullet", PythonRule, steps, on)),
        "planar, Python rule": whole_episodes(field.runner("planar", PythonRule, steps, on)),
        "planar, compiled rule": whole_episodes(field.runner("planar", CompiledRule, steps, on)),
        "navground, Python rule": peer(lambda: navground_steps(field, has_lidar=True)),
        "navground, its C++ controller, no rays": peer(lambda: navground_steps(field, has_lidar=False)),
        "ir-sim, Python rule": peer(lambda: irsim_steps(field)),
    }


def of_cell(cell: tuple[str, ...], on: ExitStack) -> Sides:
    """Return both simulators, and PyBullet alone, over one cell."""
    bullet, planar = (
        on.enter_context(compose_cell(*cell, f"simulator={name}").runner()) for name in ("pybullet", "planar")
    )
    bare = on.enter_context(compose_cell(*cell).runner())
    return {
        "PyBullet alone": bare_loop(bare),
        "pybullet": whole_episodes(bullet),
        "planar": whole_episodes(planar),
    }


def closed_loop(effort: Effort) -> Table:
    """Measure whole episodes of a trivial rule."""
    groups: dict[str, Callable[[ExitStack], Sides]] = {
        name: partial(in_field, robots, discs, effort.cut(STEPS))
        for name, (robots, discs) in [*FIELDS.items()][: effort.few(len(FIELDS))]
    }
    text = (
        "A trivial rule on 16 rays of 3 m among 10 discs, a control period of 0.1 s, episodes of 2,000 periods that "
        "nothing ends. PyBullet alone resets the poses of the same episode, detects contacts and casts all rays."
    )
    return compare("Closed loop", text, "robot-steps", groups, effort)


def shipped(effort: Effort) -> Table:
    """Measure the papers' controllers."""
    groups: dict[str, Callable[[ExitStack], Sides]] = {
        name: partial(of_cell, cell) for name, cell in [*SHIPPED.items()][: effort.few(len(SHIPPED))]
    }
    text = "Each paper's controller in a world of its paper; the last cell has 100 robots."
    return compare("Shipped controllers", text, "robot-steps", groups, effort)
