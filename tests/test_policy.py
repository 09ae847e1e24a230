"""Compiled policies: their arrays, and that ``act`` is the same function."""

import math

import numpy as np
import pytest

from navbench.contract import Body, FloatArray, Observation, Pose, Setup
from navbench.policy import SIGNATURE, CompiledController, Policy, compiled, pack, part

SETUP = Setup(Body(0.1, 0.2, 1.0, None), (), 0.1)


@compiled
def step(
    state: FloatArray,
    parameters: FloatArray,
    ranges_m: FloatArray,
    discs: FloatArray,
    pose: tuple[float, float, float],
    goal: tuple[float, float],
    speed: tuple[float, float],
    trace: FloatArray,
) -> tuple[float, float]:
    state[0] += 1.0
    trace[0], trace[1] = state[0], ranges_m[1] + discs[0, 4] + goal[1] + speed[1]
    return parameters[0] * speed[0], pose[2]


class Counting(CompiledController):
    def make_policy(self, setup: Setup) -> Policy:
        return Policy(step=step, state=np.zeros(1), parameters=np.array([3.0]), trace_names=("count", "sum"))


def observation() -> Observation:
    return Observation(0.5, Pose(1.0, 2.0, 3.0), (4.0, 5.0), 6.0, 7.0, np.array([8.0, 9.0]), False, np.ones((1, 5)))


def test_act_is_one_step_of_the_policy_and_shows_its_trace() -> None:
    controller = Counting()
    controller.reset(SETUP, np.random.default_rng(0))
    assert [tuple(controller.act(observation())) for _ in range(2)] == [(18.0, 3.0)] * 2
    assert controller.trace == {"count": 2.0, "sum": 22.0}
    controller.reset(SETUP, np.random.default_rng(0))
    assert controller.trace == {"count": 0.0, "sum": 0.0}
    controller.act(observation())
    assert controller.trace["count"] == 1.0, "an episode begins with what the one before remembered"


def test_act_is_compiled_once_and_for_the_signature() -> None:
    controller = Counting()
    controller.reset(SETUP, np.random.default_rng(0))
    controller.act(observation())
    assert getattr(step, "signatures", [SIGNATURE.args]) == [SIGNATURE.args]


def test_arrays_of_integers_and_with_gaps_are_read_as_what_they_hold() -> None:
    controller = Counting()
    controller.policy = Policy(
        step=step, state=np.array([5]), parameters=np.array([3, 9, 4])[::2], trace_names=("a", "b")
    )
    seen = observation()._replace(ranges_m=np.array([8, 0, 9])[::2], discs=np.ones((1, 10))[:, ::2])
    assert controller.act(seen) == (18.0, 3.0)
    assert controller.trace == {"a": 6.0, "b": 22.0}


@pytest.mark.parametrize("arrays", [(), (np.zeros(0),), (np.array([1.0, math.inf]), 3.0, np.eye(2), np.zeros(0))])
def test_what_is_packed_is_found_again(arrays: tuple[FloatArray, ...]) -> None:
    packed = pack(*arrays)
    assert [part(packed, i).tolist() for i in range(len(arrays))] == [np.ravel(array).tolist() for array in arrays]
