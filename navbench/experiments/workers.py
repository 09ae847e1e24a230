"""Worker processes: each does one batch after another, and what ends it is known outside.

On Linux a worker is forked from a server that has imported what it needs, within milliseconds; elsewhere it is spawned.
It leads a process group of its own, so that Ctrl-C does not reach it and whatever it starts ends with it.
"""

import errno
import faulthandler
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import connection, current_process, get_context, parent_process
from multiprocessing.connection import Connection
from tempfile import gettempdir
from traceback import format_exc
from types import ModuleType
from typing import Any, NamedTuple

from navbench.episode.timeout import EXPIRED, is_overdue, stop_timers
from navbench.experiments.code import changed, loaded
from navbench.output import shielded
from navbench.raised import one_line
from navbench.validation import DescriptionError

NAME = "navbench worker"
FORKS = sys.platform == "linux"
PLACE_MAX = 70  # bytes of a path, below which the name of a socket, of at most 107, has another 37
GROUPS = hasattr(os, "setsid")
WATCH_S = 0.5  # between two looks at a worker
LOOKS = 20  # the last ones, which tell a step that waits from one that gets no core
OVERDUE = 254  # the exit code of a process whose controller turned off the signals of its timers
FULL = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN)  # no more files, memory or processes
UNKNOWN = 255  # the exit code of a process whose own was to be told by what it was forked from, which is gone
END_S = 5.0  # that a process may take to end that has been told to
SAFE = "PYTHONSAFEPATH"
MEMORY_SHARE = 0.8  # of the machine's memory is what one worker may take
PRELOADED = ("navbench.experiments.running", "navbench.experiments.warm")
CLOCK = getattr(signal, "SIGALRM", None)
STARVED = "a step got too little of a core: this machine does too much else"
FROM_OUTSIDE = {-getattr(signal, name) for name in ("SIGKILL", "SIGTERM", "SIGHUP") if hasattr(signal, name)}

_STARTING = threading.Lock()


class Death(NamedTuple):
    """How a worker ended before its batch was done.

    Attributes:
        reason: one line.
        traceback: where its code was then, as far as that is known.
        by_machine: whether it was killed from outside, as when memory runs out: no fault of what it did.
    """

    reason: str
    traceback: str = ""
    by_machine: bool = False


class MachineError(DescriptionError):
    """What was to be done was killed from outside each time that it was tried; nothing is wrong with it."""

    def __init__(self, death: Death, what: str = "") -> None:
        super().__init__(f"machine_error: {what}{death.reason}")


class Worker:
    """A worker process, begun where this process is and with what it imports from.

    Args:
        begun: as ``begun`` returned it when the run began; what lies here otherwise now, the process refuses to run.
        foreign: what it runs that is not navbench's own; empty for nothing, which no change of the user's code alters.
    """

    def __init__(self, begun: "Begun", foreign: frozenset[str] = frozenset()) -> None:
        context = _context()
        self.begun = begun
        self.foreign = foreign
        self._end, theirs = context.Pipe()
        self._said, says = context.Pipe(duplex=False)
        self._process = context.Process(target=_work, args=(theirs, says, begun.code if foreign else {}), name=NAME)
        with _STARTING, _without_main():
            start_server()
            self._process.start()
            self._server = _server_pid()
        theirs.close()
        says.close()
        self._pid = int(self._process.pid or 0)
        self._watched_s = time.monotonic()
        self._killed: Death | None = None
        self._runs: deque[bool] = deque(maxlen=LOOKS)  # whether it ran, or would with a core, when it was looked at

    def do(self, function: Callable[[Any], Any], argument: Any) -> Any:
        """Return what a function makes of an argument, or the ``Death`` that the process died of it.

        Raises:
            Exception: whatever the function raises.
        """
        import cloudpickle

        message = cloudpickle.dumps((function, argument))
        try:
            self._watch()
            self._end.send_bytes(message)
            while not connection.wait([self._end, self._process.sentinel], WATCH_S):
                self._watch()
            answer = self._end.recv_bytes()
        except (EOFError, OSError):
            return self._death()
        result, raised = cloudpickle.loads(answer)
        if raised is not None:
            raise raised
        return result

    @property
    def alive(self) -> bool:
        """Whether it can do more."""
        return bool(self._process.is_alive())

    def kill(self) -> None:
        """End it at once, and all that it has started."""
        if GROUPS:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._pid, signal.SIGKILL)
        self._process.kill()
        self._process.join(END_S)

    def _watch(self) -> None:
        """Look at it, and end it where it takes too much memory, or was stopped."""
        if time.monotonic() - self._watched_s < WATCH_S:
            return
        from psutil import STATUS_RUNNING, STATUS_STOPPED, Error, Process, virtual_memory

        self._watched_s = time.monotonic()
        with suppress(Error):  # it has ended meanwhile
            seen, most = Process(self._pid), MEMORY_SHARE * virtual_memory().total
            self._runs.append(seen.status() == STATUS_RUNNING)
            if seen.memory_info().rss > most:
                self._killed = Death(f"its process took more than {most / 1e9:.3g} GB of memory")
            elif seen.status() == STATUS_STOPPED:
                self._killed = Death("its process was stopped", by_machine=True)
        if self._killed:
            self.kill()

    def _death(self) -> Death:
        self._process.join(END_S)
        code = self._process.exitcode
        self.kill()  # what it left behind
        if self._killed:
            return self._killed
        if code == UNKNOWN and self._server and _has_ended(self._server):
            return Death("what its process was forked from was killed", by_machine=True)
        said = b""
        with suppress(OSError):
            while self._said.poll() and (more := os.read(self._said.fileno(), 65536)):
                said += more
        trace = said.decode(errors="replace")
        if code == OVERDUE and CLOCK:
            return Death(EXPIRED[CLOCK], trace)
        if code is None or code >= 0:
            return Death(f"its process ended with exit code {code}", trace)
        if -code in EXPIRED:
            starved = -code == CLOCK and sum(self._runs) > len(self._runs) / 2
            return Death(STARVED if starved else EXPIRED[-code], trace, starved)
        return Death(f"its process died of {signal.Signals(-code).name}", trace, code in FROM_OUTSIDE)


def _server_pid() -> int:
    """Return the process that workers are forked from; 0 without one."""
    if not FORKS:
        return 0
    from multiprocessing import forkserver

    return int(forkserver._forkserver._forkserver_pid or 0)  # type: ignore[attr-defined]


def _has_ended(pid: int) -> bool:
    """Return whether a process has ended, or does within a moment."""
    from psutil import STATUS_DEAD, STATUS_ZOMBIE, NoSuchProcess, Process

    with suppress(NoSuchProcess):
        for _ in range(20):
            if Process(pid).status() in (STATUS_DEAD, STATUS_ZOMBIE):
                return True
            time.sleep(0.01)
        return False
    return True


def _context() -> Any:
    return get_context("forkserver" if FORKS else "spawn")


def place() -> tuple[str, ...]:
    """Return where workers that are begun now work, and what they import from."""
    return (os.getcwd(), *sys.path)


class Begun(NamedTuple):
    """What a worker was begun with, which it has for good.

    Attributes:
        place: where it works, and what it imports from.
        code: the digest of each module of the user's, as of ``loaded``.
    """

    place: tuple[str, ...]
    code: Mapping[str, str]


def begun() -> Begun:
    """Return what workers that are begun now are begun with."""
    return Begun(place(), loaded())


def in_worker() -> bool:
    """Return whether this process is a worker."""
    return current_process().name == NAME


def start_server(modules: Sequence[str] = PRELOADED) -> None:
    """Start what workers are forked from, and return at once; where it runs, do nothing.

    Call it in another thread than the main one, which Ctrl-C does not interrupt.

    Args:
        modules: what it imports.
    """
    if not FORKS:
        return
    check_place()
    from multiprocessing import forkserver, resource_tracker

    forkserver.set_forkserver_preload(list(modules))
    with _safe_path():
        resource_tracker.ensure_running()  # which would let Ctrl-C through again
        with uninterrupted():
            forkserver.ensure_running()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let Ctrl-C, which is for this process alone, not reach those that begin meanwhile: they inherit the mask."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _safe_path() -> Iterator[None]:
    """Keep processes that begin with ``python -c`` from importing what lies in the working directory by chance."""
    before = os.environ.get(SAFE)
    os.environ[SAFE] = before or "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[SAFE]


def check_place() -> None:
    """Check that the sockets through which workers are begun have room for their names.

    Raises:
        DescriptionError: the folder for temporary files has too long a name.
    """
    if FORKS and len(os.fsencode(folder := gettempdir())) > PLACE_MAX:
        raise DescriptionError(f"TMPDIR={folder}: must be at most {PLACE_MAX} bytes long, for the sockets in it")


@contextmanager
def _without_main() -> Iterator[None]:
    """Hide the main module: a worker would import it, and a script without a guard would begin again there."""
    main, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _work(batches: Connection, says: Connection, code: Mapping[str, str]) -> None:
    """Do one batch after another, until the driver ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    shielded("stdout", 1)  # no controller fails because nobody reads what it prints
    shielded("stderr", 2)
    if GROUPS:
        os.setsid()
        faulthandler.enable(says.fileno(), all_threads=False)
        for number in EXPIRED:
            faulthandler.register(number, says.fileno(), all_threads=False, chain=True)
    threading.Thread(target=_end_in_time, args=(says.fileno(),), daemon=True).start()
    folder, process = os.getcwd(), os.getpid()
    other, usable = changed(code), True
    with suppress(EOFError, OSError):
        while usable:
            message = batches.recv_bytes()
            os.chdir(folder)
            try:
                answer = refused(f"{other}: changed since this run began") if other else answer_to(message)
            except (MemoryError, OSError) as error:
                answer, usable = _died(error), False
            stop_timers()
            print(end="", flush=True)
            if os.getpid() != process:  # a fork of the controller's, which is nobody's worker
                break
            batches.send_bytes(answer)
    os._exit(0)


def answer_to(message: bytes) -> bytes:
    """Return what a batch comes to, pickled: what its function returned, and what it raised.

    Raises:
        MemoryError, OSError: this process has no room for more.
    """
    import cloudpickle

    try:
        function, argument = cloudpickle.loads(message)
        answer: bytes = cloudpickle.dumps((function(argument), None))
    except Exception as error:
        if isinstance(error, MemoryError) or isinstance(error, OSError) and error.errno in FULL:
            raise
        error.add_note(format_exc())
        answer = _raised(error)
    except BaseException as error:  # of a user's code that means to end the process
        answer = cloudpickle.dumps((Death(one_line(error), format_exc()), None))
    return answer


def _died(error: MemoryError | OSError) -> bytes:
    """Return what a batch comes to in a process that has no room for more, pickled.

    How many files are open is the process's own, and so the fault of what it did; memory may be the machine's.
    """
    import cloudpickle

    own = isinstance(error, OSError) and error.errno == errno.EMFILE
    said = f"its process ran out of {'files' if own else 'memory, files or processes'}: {one_line(error)}"
    answer: bytes = cloudpickle.dumps((Death(said, format_exc(), by_machine=not own), None))
    return answer


def refused(why: str) -> bytes:
    """Return what a batch comes to in a process that must not run it, pickled: it may be run by another one."""
    import cloudpickle

    answer: bytes = cloudpickle.dumps((Death(why, by_machine=True), None))
    return answer


def _raised(error: Exception) -> bytes:
    """Return an exception pickled, or where it cannot be, one that says the same."""
    import cloudpickle

    try:
        answer: bytes = cloudpickle.dumps((None, error))
        cloudpickle.loads(answer)
    except Exception:
        answer = cloudpickle.dumps((None, RuntimeError(one_line(error))))
    return answer


def _end_in_time(says: int) -> None:
    """End when a controller takes too long whose timers were turned off, and with the driver, which nobody outlives."""
    parent = parent_process()
    assert parent is not None
    while not connection.wait([parent.sentinel], WATCH_S):
        if is_overdue():
            faulthandler.dump_traceback(says)
            os._exit(OVERDUE)
    if GROUPS:
        os.killpg(0, signal.SIGKILL)
    os._exit(1)
