"""Rays alone, by kind of obstacle."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial

from benchmarks.field import RAYS, Field
from benchmarks.harness import Effort, Side, Sides, Table, compare
from navbench.simulation.base import Simulator

AMONG = {"10 discs": 10, "100 discs": 100}  # grids come here


def cast_all(simulator: Simulator) -> Side:
    """Return a function that reads every robot's ring once, and returns how many rays that were."""
    return lambda: len(simulator.ranges()) * RAYS


def among(discs: int, on: ExitStack) -> Sides:
    """Return both simulators with the robots at their starts."""
    sides = {}
    for name in ("pybullet", "planar"):
        runner = Field(50, discs).runner(name, steps=1, on=on)
        runner.run(0)
        sides[name] = cast_all(runner.simulator)
    return sides


def rays(effort: Effort) -> Table:
    """Measure rays."""
    groups: dict[str, Callable[[ExitStack], Sides]] = {name: partial(among, count) for name, count in AMONG.items()}
    text = "The rings of 50 robots, 16 rays each, called once for all."
    return compare("Rays", text, "rays", groups, effort)
