"""How long a controller may take: timers of the operating system end its process, wherever in its code it is."""

import math
import signal
import time

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

_due_s = math.inf  # when the step must have ended, by the monotonic clock


class Timeout:
    """Ends this process with a signal when a step or an episode takes too long; on Windows it never does.

    Args:
        step_s: CPU time that a step may take [s]; None for any.
    """

    def __init__(self, step_s: float | None) -> None:
        self._step_s = step_s if EXPIRED else None
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


def is_overdue() -> bool:
    """Return whether a step goes on that a signal should have ended; a controller may use these signals itself."""
    return time.monotonic() > _due_s + GRACE_S


def stop_timers() -> None:
    """Let nothing be timed any more."""
    global _due_s
    _due_s = math.inf
    if EXPIRED:
        for timer in (signal.ITIMER_VIRTUAL, signal.ITIMER_PROF, signal.ITIMER_REAL):
            signal.setitimer(timer, 0.0)
