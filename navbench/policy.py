"""Compiled policies: one fixed signature, with which a compiled loop calls any controller without Python.

A controller offers one by deriving from ``CompiledController`` and writing ``make_policy``. The same function answers
``act``, so that both drive alike to the last bit.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numba import float64, types
from numba.core.dispatcher import Dispatcher

from navbench.compiled import compiled
from navbench.contract import Command, FloatArray, Observation, Setup
from navbench.memory import scratch

__all__ = ["SIGNATURE", "CompiledController", "Policy", "compiled", "pack", "part", "scratch"]

_types: Any = types  # numba's are untyped
_PAIR, _ARRAY = _types.UniTuple(float64, 2), float64[::1]
SIGNATURE = _PAIR(
    _ARRAY, _ARRAY, _ARRAY, float64[:, ::1], _types.UniTuple(float64, 3), _PAIR, _PAIR, _ARRAY
)  # a step's

Step = Callable[..., tuple[float, float]]


def _as_given(array: FloatArray) -> FloatArray:
    """Return an array as the signature has it, itself if it is so: compiled code would misread another one."""
    return np.ascontiguousarray(array, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Policy:
    """A controller as a compiled function and its arrays; a policy drives one robot through one episode.

    Attributes:
        step: ``step(state, parameters, ranges_m, discs, pose, goal, speed, trace) -> (v, w)``, made by ``compiled``:
            the command [m/s, rad/s] for what ``Observation`` has by these names; pose, goal and speed, which is v and
            w, are tuples. It writes ``state`` and ``trace`` only. NaN ends the robot.
        state: (n,) what it remembers, as an episode begins with it.
        parameters: (m,) what it is told.
        trace_names: what its trace holds, in order.
        trace: (len(trace_names),) the latest step's.
    """

    step: Step
    state: FloatArray = field(default_factory=lambda: np.zeros(0))
    parameters: FloatArray = field(default_factory=lambda: np.zeros(0))
    trace_names: tuple[str, ...] = ()
    trace: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        """Make room for the trace, and make of all arrays what the signature says."""
        for name in ("state", "parameters"):
            object.__setattr__(self, name, _as_given(getattr(self, name)))
        object.__setattr__(self, "trace", np.zeros(len(self.trace_names)))

    def begun(self) -> "Policy":
        """Return the policy for one more episode, with a state and a trace of its own."""
        return Policy(step=self.step, state=self.state.copy(), parameters=self.parameters, trace_names=self.trace_names)


@cache
def _direct(step: Any) -> Step:
    """Return a step for arguments of its signature's types, which are not looked up at each call."""
    found: Step = step.compile(SIGNATURE.args) if isinstance(step, Dispatcher) else step
    return found


class CompiledController:
    """A controller that is a compiled policy.

    One that leaves something to chance writes a ``reset`` of its own, which sets ``policy``.

    Attributes:
        policy: what drives in this episode.
    """

    policy: Policy
    _made: tuple[Setup, Policy] | None = None

    def make_policy(self, setup: Setup) -> Policy:
        """Return the policy for a setup, as every episode begins with it."""
        raise NotImplementedError

    def begin(self, setup: Setup) -> None:
        """Begin an episode with the setup's policy, which is made once."""
        if self._made is None or self._made[0] is not setup:
            self._made = setup, self.make_policy(setup)
        self.policy = self._made[1].begun()

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Begin an episode; nothing is left to chance."""
        self.begin(setup)

    def act(self, observation: Observation) -> Command:
        """Return the policy's command."""
        policy = self.policy
        _, pose, goal, v_mps, w_radps, ranges_m, _, discs = observation
        ranges_m, discs = _as_given(ranges_m), _as_given(discs)
        v, w = _direct(policy.step)(
            policy.state, policy.parameters, ranges_m, discs, pose, goal, (v_mps, w_radps), policy.trace
        )
        return Command(v, w)

    @property
    def trace(self) -> dict[str, float]:
        """The policy's trace, by name."""
        return dict(zip(self.policy.trace_names, self.policy.trace.tolist(), strict=True))


def pack(*arrays: Any) -> FloatArray:
    """Return some arrays as one, from which ``part`` takes them again; each is flattened."""
    flat = [np.asarray(array, dtype=np.float64).ravel() for array in arrays]
    begins = np.cumsum([len(flat) + 1, *map(len, flat)])
    return np.concatenate([begins, *flat])


@compiled
def part(packed: FloatArray, number: int) -> FloatArray:
    """Return one of the arrays that were given to ``pack``, as a view."""
    return packed[int(packed[number]) : int(packed[number + 1])]
