"""How long a controller may take: timers of the operating system end its process, wherever in its code it is."""

import math
import signal
import time
from functools import cache

from numba.core import event

EPISODE_STEPS = 20.0  # times what a step may take is what an episode may take
CLOCK_STEPS = 10.0  # times that by the clock, for a step that waits and takes no CPU time
GRACE_S = 1.0  # beyond that, for the signal that should have ended the process
SLACK = 0.05  # of a limit, by which it may come early: timers are not set anew at each step

EXPIRED: dict[int, str] = {
    int(getattr(signal, name)): f"{what} than controller_timeout_s allows"
    for name, what in {
        "SIGPROF": "a step took more CPU time",
        "SIGVTALRM": "an episode took more CPU time",
        "SIGALRM": "a step waited longer",
    }.items()
    if hasattr(signal, name)
}  # what a process died of that one of these signals ended

TIMERS: list[int] = [signal.ITIMER_VIRTUAL, signal.ITIMER_PROF, signal.ITIMER_REAL] if EXPIRED else []

_due_s = math.inf  # when the step must have ended, by the monotonic clock


class Timeout:
    """Ends this process with a signal when a step or an episode takes too long; on Windows it never does.

    Args:
        step_s: CPU time that a step may take [s]; None for any.
    """

    def __init__(self, step_s: float | None) -> None:
        self._step_s = step_s if EXPIRED else None
        if self._step_s is not None:
            _pause_for_numba()
        self._episode_at_s = self._step_at_s = -1.0  # when the timers were last set

    def episode(self) -> None:
        """Begin an episode."""
        now_s = time.monotonic()
        if self._step_s is not None and now_s - self._episode_at_s > SLACK * EPISODE_STEPS * self._step_s:
            self._episode_at_s = now_s
            signal.setitimer(signal.ITIMER_VIRTUAL, EPISODE_STEPS * self._step_s)
        self.step()

    def step(self) -> None:
        """Begin a step."""
        now_s = time.monotonic()
        if self._step_s is not None and now_s - self._step_at_s > SLACK * self._step_s:
            self._step_at_s = now_s
            signal.setitimer(signal.ITIMER_PROF, self._step_s)
            signal.setitimer(signal.ITIMER_REAL, CLOCK_STEPS * self._step_s)
            global _due_s
            _due_s = now_s + CLOCK_STEPS * self._step_s


class _Pause(event.Listener):  # type: ignore[misc,unused-ignore]
    """Stops the timers while numba works on a function: nobody's step takes longer where nothing is compiled yet."""

    def __init__(self) -> None:
        self._depth, self._left_s, self._due_in_s = 0, dict.fromkeys(TIMERS, 0.0), math.inf

    def on_start(self, event: event.Event) -> None:
        """Stop the timers."""
        if self._depth == 0:
            self._due_in_s = _due_s - time.monotonic()
            self._left_s = stop_timers()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """Let them go on with what is left."""
        global _due_s
        self._depth -= 1
        if self._depth == 0:
            for timer, left_s in self._left_s.items():
                signal.setitimer(timer, left_s)
            _due_s = time.monotonic() + self._due_in_s


@cache
def _pause_for_numba() -> None:
    event.register("numba:compiler_lock", _Pause())  # type: ignore[no-untyped-call,unused-ignore]


def is_overdue() -> bool:
    """Return whether a step goes on that a signal should have ended; a controller may use these signals itself."""
    return time.monotonic() > _due_s + GRACE_S


def stop_timers() -> dict[int, float]:
    """Let nothing be timed any more, and return what each timer had left [s], 0 for none."""
    global _due_s
    _due_s = math.inf
    return {timer: signal.setitimer(timer, 0.0)[0] for timer in TIMERS}
