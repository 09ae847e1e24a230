"""What drives one robot through one episode: its controller with its sensors, and what is kept of its trajectory."""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from navbench.contract import Controller, trace_of
from navbench.episode.failures import ContractError, Failure, wrong_trace
from navbench.episode.perception import Perception
from navbench.policy import CompiledController
from navbench.records import Outcome, Thing

FloatArray = NDArray[np.float64]


@dataclass(slots=True)
class Pilot:
    """One robot's controller with its sensors, and what is kept of its trajectory."""

    controller: Controller
    perception: Perception
    rows: list[float] = field(default_factory=list)
    states: FloatArray = field(default_factory=lambda: np.empty((0, 6)))
    traces: list[bytes] = field(default_factory=list)
    trace_names: tuple[str, ...] | None = None
    ranges: list[FloatArray] = field(default_factory=list)  # (periods, n_sensors) each [m]
    latencies_s: list[float] = field(default_factory=list)
    outcome: Outcome = "timed_out"
    failure: Failure = Failure()
    hit: Thing | None = None
    end_s: float = 0.0
    _in_order: Callable[[Mapping[str, float]], tuple[float, ...]] = field(default=lambda _: ())
    _packed: Callable[..., bytes] = bytes

    def keep_trace(self) -> None:
        """Keep the latest act's trace, packed: it is checked by packing and takes little room.

        Raises:
            ContractError: it is no mapping, its names are not those of the first act, or a value is no number.
        """
        if isinstance(self.controller, CompiledController):
            self.trace_names = self.controller.policy.trace_names
            self.traces.append(self.controller.policy.trace.tobytes())
            return
        if self.trace_names == () and not hasattr(self.controller, "trace"):
            return
        trace = trace_of(self.controller)
        if not trace and type(trace) is dict and not self.trace_names:
            self.trace_names = ()
            return
        try:
            if self.trace_names is None:
                self.trace_names = names = tuple(trace)
                self._packed = struct.Struct(f"{len(names)}d").pack
                self._in_order = itemgetter(*names) if len(names) > 1 else lambda one: tuple(one[n] for n in names)
            if len(trace) == len(self.trace_names):
                self.traces.append(self._packed(*self._in_order(trace)))
                return
        except (AttributeError, KeyError, TypeError, struct.error):
            pass  # said below
        raise ContractError(wrong_trace(trace, self.trace_names or ()))
