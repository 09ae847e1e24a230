"""What is said of a controller or metric that fails: a line that names its own file, and the traceback."""

import math
import reprlib
import struct
import traceback
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any, NamedTuple

from navbench.episode.isolation import let_interrupt
from navbench.metrics import MetricFunction, RobotRun
from navbench.raised import REASON_MAX, first_line, is_framework, one_line, shortened, storable

FRAMES_MAX = 20  # of a traceback, the innermost


class ContractError(ValueError):
    """A controller does not do what the contract says; the message says what it did and what is expected."""


class Failure(NamedTuple):
    """What a controller did wrong.

    Attributes:
        reason: one short line, with the place in the user's own file.
        traceback: from the first line outside the framework; empty where nothing was raised.
    """

    reason: str = ""
    traceback: str = ""


def velocities(command: Any) -> tuple[float, float]:
    """Return what ``act`` returned as a forward speed [m/s] and a turning rate [rad/s].

    Raises:
        ContractError: it is not two finite numbers.
    """
    try:
        v_mps, w_radps = command
        if math.isfinite(v_mps) and math.isfinite(w_radps):
            return v_mps, w_radps
    except (TypeError, ValueError):
        pass  # said below
    shape = getattr(command, "shape", None)
    returned = repr(command) if isinstance(command, tuple) and len(command) == 2 else reprlib.repr(command)
    returned = f"an array of shape {shape}" if shape not in (None, (2,)) else returned
    hint = "; is a `return` missing?" if command is None else ""
    raise ContractError(f"act must return Command(v_mps, w_radps), two finite numbers; it returned {returned}{hint}")


def wrong_trace(trace: object, names: Sequence[str]) -> str:
    """Return what is wrong with a trace that cannot be kept; ``names`` are those of the first act."""
    if not isinstance(trace, Mapping):
        return f"trace must be a mapping of names to numbers; it is {reprlib.repr(trace)}"
    if set(trace) != set(names):
        now, first = (", ".join(map(str, some)) or "none" for some in (trace, names))
        return f"trace must have the same names at every step; it had {first}, and now has {now}"
    for name, value in trace.items():
        try:
            struct.pack("d", value)
        except struct.error:
            return f"trace[{name!r}] must be a number; it is {reprlib.repr(value)}"
    return "trace must be a mapping of names to numbers"


def failure(error: BaseException, act: object = None) -> Failure:
    """Return what is said of an exception.

    Args:
        error: what a controller raised, or the loop because of it.
        act: the controller's method, which a ``ContractError`` is about.
    """
    if isinstance(error, ContractError):
        return Failure(shortened(str(error), REASON_MAX) + first_line(act))
    frame = error.__traceback__
    while frame is not None and frame.tb_next is not None and is_framework(frame.tb_frame.f_code.co_filename):
        frame = frame.tb_next
    lines = traceback.format_exception(type(error), error, frame, limit=-FRAMES_MAX)
    return Failure(one_line(error), storable("".join(lines)))


PLAIN = (float, int)  # whose values are kept as they are


def measured(metrics: Sequence[MetricFunction], run: RobotRun) -> tuple[dict[str, float], list[Failure]]:
    """Return each metric's value by its name, nan where it could not be computed, and why."""
    values: dict[str, float] = {}
    faults = []
    for function in metrics:
        name = function.__dict__["metric"].name
        try:
            value = function(run)
            if type(value) not in PLAIN:
                if not isinstance(value, Real):
                    raise ContractError(f"must return a number; it returned {reprlib.repr(value)}")
                value = float(value)
            values[name] = value
        except BaseException as error:  # a user's code may raise anything; it costs this value, no more
            let_interrupt(error)
            fault = failure(error, function)
            values[name] = math.nan
            faults.append(fault._replace(reason=f"metric {name}: {fault.reason}"))
    return values, faults
