"""Environments to learn in: one by one in Python, beside many in one compiled call."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial

import numpy as np

from benchmarks.harness import Effort, Side, Sides, Table, compare, peer

WORLDS: dict[str, int | None] = {"deadlock": None, "random_discs": 1000}  # how many layouts a vector draws
SIZES = (64, 1024)
STEPS = 20  # a call


def one_by_one(world: str, count: int, on: ExitStack) -> Side:
    """Return what steps some environments in turn, begins an episode anew where one is over, and counts the steps."""
    from navbench.gym import make

    made = [make(world=world, sensors="ring16") for _ in range(count)]
    actions = _actions(count)
    for env in made:
        env.reset()
        on.callback(env.close)

    def steps() -> int:
        for _ in range(STEPS):
            for env, action in zip(made, actions, strict=True):
                *_, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    env.reset()
        return STEPS * count

    return steps


def at_once(world: str, count: int, on: ExitStack) -> Side:
    """Return what steps as many in a vector."""
    from navbench.gym import make_vec

    vector = make_vec(world=world, sensors="ring16", num_envs=count, layouts=WORLDS[world])
    actions = _actions(count)
    vector.reset()
    on.callback(vector.close)

    def steps() -> int:
        for _ in range(STEPS):
            vector.step(actions)
        return STEPS * count

    return steps


def environments(effort: Effort) -> Table:
    """Measure environment-steps, resets and metrics included."""

    def sides(world: str, on: ExitStack) -> Sides:
        found = {"one by one in Python": peer(partial(one_by_one, world, effort.cut(SIZES[0]), on))}
        for size in SIZES[: effort.few(len(SIZES))]:
            found[f"{size:,} in a vector"] = peer(partial(at_once, world, effort.cut(size), on))
        return found

    groups: dict[str, Callable[[ExitStack], Sides]] = {
        world: partial(sides, world) for world in [*WORLDS][: effort.few(len(WORLDS))]
    }
    text = (
        "`navbench.gym` with 16 rays, one robot each, one thread, actions that are drawn once; resets, rewards and the "
        "metrics of each episode are included. In random_discs the vector draws 1,000 layouts once."
    )
    return compare("Environments", text, "environment-steps", groups, effort)


def _actions(count: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return np.random.default_rng(0).uniform((0.2, -0.3), (1.0, 0.3), (count, 2)).astype(np.float32)
