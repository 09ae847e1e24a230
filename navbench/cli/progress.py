"""What is said on stderr: what is wrong in one line; what is under way as a bar, or now and then a line for a log."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

EVERY_S = 10.0  # between two lines of a log
UNFINISHED = 3  # the exit code where something that was asked for is not there


def complain(message: str) -> int:
    """Print what is wrong as one line, and return the exit code of wrong input."""
    from navbench.raised import shortened
    from navbench.reading import printable

    print(printable(f"navbench: {shortened(message, 400)}"), file=sys.stderr)
    return 2


def tell(message: str) -> None:
    """Print what may hold somebody's words or paths, of which a terminal obeys nothing."""
    from navbench.reading import printable

    print(printable(message), flush=True)


class Step(NamedTuple):
    """How far something is.

    Attributes:
        what: what is under way; its last word is what is counted.
        done: how many are done.
        of: of how many.
    """

    what: str
    done: int
    of: int


class Progress:
    """Remembers how far a plan is; subclasses show it."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.last: Step | None = None

    def __call__(self, what: str, done: int, of: int) -> None:
        """Take note of how far it is."""
        self.last = Step(what, done, of)
        self.show(self.last)

    def show(self, step: Step) -> None:
        """Show it."""


class _Log(Progress):
    """Prints a line from time to time."""

    def __init__(self) -> None:
        super().__init__()
        self._kind, self._began, self._done, self._said_s = "", 0.0, 0, 0.0

    def show(self, step: Step) -> None:
        now, kind = time.monotonic(), step.what.split()[-1]
        if kind != self._kind:
            self._kind, self._began, self._done, self._said_s = kind, now, step.done, now
        if now - self._said_s < EVERY_S:
            return
        self._said_s = now
        left = (now - self._began) * (step.of - step.done) / max(step.done - self._done, 1)
        told = f", {left:.0f} s left" if 0.0 < left < 120.0 else f", {left / 60.0:.0f} min left" if left else ""
        print(f"{step.what}: {step.done} of {step.of}{told}", file=sys.stderr, flush=True)


class _Bar(Progress):
    """Moves a bar."""

    def __init__(self, bar: Any) -> None:
        super().__init__()
        self._bar, self._tasks = bar, dict[str, Any]()

    def show(self, step: Step) -> None:
        kind = step.what.split()[-1]
        if kind not in self._tasks:
            self._tasks[kind] = self._bar.add_task(step.what, total=step.of, completed=step.done)
        self._bar.update(self._tasks[kind], description=step.what, completed=step.done, total=step.of)


@contextmanager
def progress() -> Iterator[Progress]:
    """Give what shows the progress of a plan."""
    if not sys.stderr.isatty():
        yield _Log()
        return
    from rich import progress as rich
    from rich.console import Console

    columns = (rich.TextColumn("{task.description}"), rich.BarColumn(), rich.MofNCompleteColumn())
    with rich.Progress(*columns, rich.TimeRemainingColumn(), console=Console(stderr=True), transient=True) as bar:
        yield _Bar(bar)
