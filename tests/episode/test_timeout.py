"""Timers: a step or an episode that takes too long ends its process, with a reason of its own."""

import time
from typing import NamedTuple

import numba
import numpy as np
import pytest

from navbench.episode import timeout
from navbench.experiments.engines import in_processes
from navbench.validation import DescriptionError


class Steps(NamedTuple):
    """Some steps: the limit of each, how many, the CPU time and the waiting of each, and the other two limits."""

    limit_s: float | None
    taken: int
    busy_s: float
    waits_s: float
    episode: float = 20.0
    clock: float = 60.0


def _take(steps: Steps) -> str:
    timeout.EPISODE_STEPS, timeout.CLOCK_STEPS = steps.episode, steps.clock
    limit = timeout.Timeout(steps.limit_s)
    limit.episode()
    for _ in range(steps.taken):
        limit.step()
        end_s = time.process_time() + steps.busy_s
        while time.process_time() < end_s:
            pass
        time.sleep(steps.waits_s)
    return "done"


def _compile(limit_s: float) -> float:
    """Return how many times the limit of a step a function takes to compile, in CPU time."""
    limit, began_s = timeout.Timeout(limit_s), time.process_time()
    limit.episode()
    numba.njit(lambda a: np.sort(np.cumsum(a)))(np.arange(3.0))
    return (time.process_time() - began_s) / limit_s


def _compile_and_spin(limit_s: float) -> None:
    _compile(limit_s)
    while True:
        pass


@pytest.mark.parametrize(
    ("steps", "reason"),
    [
        (Steps(0.3, 1, 60.0, 0.0), "a step took more CPU time than controller_timeout_s allows"),
        (Steps(0.5, 60, 0.1, 0.0, episode=1.5), "an episode took more CPU time than controller_timeout_s allows"),
        (Steps(0.3, 1, 0.0, 60.0, clock=1.0), "a step waited longer than controller_timeout_s allows"),
    ],
)
def test_what_takes_too_long_ends_with_a_reason(steps: Steps, reason: str) -> None:
    with pytest.raises(DescriptionError, match=reason):
        in_processes(_take, [steps], workers=1)


def test_a_step_may_wait_ten_times_as_long_as_it_may_compute_and_an_episode_take_twenty_times() -> None:
    assert (timeout.CLOCK_STEPS, timeout.EPISODE_STEPS) == (10.0, 20.0)  # as the pages say


def test_many_steps_may_take_longer_than_one() -> None:
    assert in_processes(_take, [Steps(0.5, 8, 0.1, 0.2, clock=2.0)], workers=1) == ["done"]


def test_timers_do_not_outlive_their_batch() -> None:
    assert in_processes(_take, [Steps(0.2, 1, 0.0, 0.0), Steps(None, 1, 0.5, 0.0)], workers=1) == ["done", "done"]


def test_compiling_is_not_timed_and_what_follows_is() -> None:
    assert in_processes(_compile, [0.1], workers=1)[0] > 2
    with pytest.raises(DescriptionError, match="a step took more CPU time than controller_timeout_s allows"):
        in_processes(_compile_and_spin, [0.1], workers=1)
