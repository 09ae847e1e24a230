"""Timers: a step or an episode that takes too long ends its process, with a reason of its own."""

import time

import pytest

from navbench.episode.timeout import Timeout
from navbench.experiments.engines import in_processes
from navbench.validation import DescriptionError


def _steps(how: tuple[float, int, float, float]) -> str:
    """Take some steps with a limit, each with some CPU time and some waiting."""
    limit_s, count, busy_s, waits_s = how
    timeout = Timeout(limit_s)
    timeout.episode()
    for _ in range(count):
        timeout.step()
        end_s = time.process_time() + busy_s
        while time.process_time() < end_s:
            pass
        time.sleep(waits_s)
    return "done"


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ((0.1, 1, 60.0, 0.0), "a step took more CPU time than controller_timeout_s allows"),
        ((0.1, 60, 0.05, 0.0), "an episode took more CPU time than controller_timeout_s allows"),
        ((0.1, 1, 0.0, 60.0), "a step waited longer than controller_timeout_s allows"),
    ],
)
def test_what_takes_too_long_ends_with_a_reason(how: tuple[float, int, float, float], reason: str) -> None:
    with pytest.raises(DescriptionError, match=reason):
        in_processes(_steps, [how])


def test_steps_that_are_quick_enough_go_on_for_as_long_as_they_like_by_the_clock() -> None:
    assert in_processes(_steps, [(0.1, 15, 0.0, 0.1)]) == ["done"]


def test_timers_do_not_outlive_their_batch() -> None:
    assert in_processes(_steps, [(0.05, 1, 0.0, 0.0), (None, 1, 1.0, 0.0)], workers=1) == ["done", "done"]
