"""Ctrl-C, heard whenever it is pressed.

Python raises it between any two steps of the main thread. Where that is a callback of a library, or of a weak
reference, as each import has one, it prints the exception and goes on; and a library's own clearing up may fail of it
and raise another one instead.
"""

import signal
import sys
from _thread import interrupt_main
from threading import Event, Thread, get_ident, main_thread
from types import FrameType

INSIST_S = 0.5  # after which an interrupt that nothing deals with is raised again


class Interrupts:
    """Heeds Ctrl-C while the command runs; when it has ended, nothing is left to be interrupted."""

    def __init__(self) -> None:
        self._pressed, self._ended = False, Event()

    def __enter__(self) -> "Interrupts":
        """Heed it, unless whoever started this process had it ignored."""
        if get_ident() == main_thread().ident and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            Thread(target=self._insist, daemon=True).start()
            signal.signal(signal.SIGINT, self._press)
        return self

    def __exit__(self, *_: object) -> None:
        """Ignore it from now on: how the command ended is known."""
        if signal.getsignal(signal.SIGINT) == self._press:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        self._ended.set()

    def _press(self, number: int, frame: FrameType | None) -> None:
        self._pressed = True
        signal.default_int_handler(number, frame)

    def _insist(self) -> None:
        """Raise it again for as long as the main thread does not deal with it."""
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # which is for the main thread
        seen = False
        while not self._ended.wait(INSIST_S):
            if seen and not is_dealt_with():
                if hasattr(signal, "pthread_kill"):
                    signal.pthread_kill(main_thread().ident or 0, signal.SIGINT)
                else:
                    interrupt_main()
            seen = self._pressed


def is_dealt_with() -> bool:
    """Return whether the main thread is in a block that handles an interrupt, or what was raised because of one."""
    told: object = sys._current_exceptions().get(main_thread().ident or 0)
    error = told[1] if isinstance(told, tuple) else told  # a tuple until Python 3.12
    return isinstance(error, BaseException) and is_of_interrupt(error)


def is_of_interrupt(error: BaseException | None) -> bool:
    """Return whether an exception is an interrupt, or was raised while one was dealt with."""
    seen: set[int] = set()  # a chain may lead back into itself
    while error is not None and not isinstance(error, KeyboardInterrupt) and id(error) not in seen:
        seen.add(id(error))
        error = error.__cause__ or error.__context__
    return isinstance(error, KeyboardInterrupt)
