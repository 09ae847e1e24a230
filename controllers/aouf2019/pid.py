"""The PID controller that Aouf, Boussaid and Sakly compare theirs with.

A. Aouf, L. Boussaid, A. Sakly, "Same Fuzzy Logic Controller for Two-Wheeled Mobile Robot Navigation in Strange
Environments", Journal of Robotics 2019, 2465219, doi:10.1155/2019/2465219; section 4, equation 25.

The behaviours and the arbitration are the fuzzy controller's, see ``equations``; only the steering differs. The
heading error of the active behaviour is driven to zero by a discrete PID law on the turning rate, at a constant speed.
The paper tunes its three gains by particle swarm, artificial bees and fireflies to a small integral of the squared
error.

| symbol | here | unit | equation |
|---|---|---|---|
| e(k) | heading error of the active behaviour | rad | 16, 24 |
| T | control period | s | 25 |
| k_P, k_I, k_D | ``kp``, ``ki``, ``kd`` | 1/s, 1/s^2, 1 | 25 |
| u(k) | turning rate w, positive to the left | rad/s | 25 |

Erratum, corrected here: the sum in (25) runs over the errors e(j), j = 0..k.

The speed is nowhere printed, but every distance of a PID in Table 4 is 0.15 m/s times its time in Table 3. Left open,
and decided here: the turning rate is limited, and a step at which the limit acts does not count in the sum; where the
behaviour changes, the sum begins again and the difference of that step is zero, as at the first step; the difference
is wrapped to (-pi, pi], so that an error passing pi is no jump.
"""

import math

from pydantic.dataclasses import dataclass

from navbench.contract import FloatArray, Setup
from navbench.mathematics.geometry import wrap_angle
from navbench.policy import Policy, compiled, pack, part
from navbench.validation import STRICT, NonNegative, Positive

from .behaviors import BEHAVIOR, LAW, LAW_MEMORY, TRACE, Behaving, active_heading_error

TERMS = ("proportional_radps", "integral_radps", "differential_radps", "turn_limited")  # the law's own trace
PERIOD, KP, KI, KD, SPEED, LIMIT = range(6)  # of the law's parameters
LAST_BEHAVIOR, SUM, ERROR = range(3)  # of its memory
FRESH = (math.nan, 0.0, 0.0)  # its memory before the first step


@compiled
def pid_terms(
    e: float, e_sum: float, e_before: float, period: float, kp: float, ki: float, kd: float
) -> tuple[float, float, float]:
    """Return the three terms whose sum is u(k): of the error, of the sum e(0) + ... + e(k), of the difference."""
    return kp * e, ki * period * e_sum, kd * wrap_angle(e - e_before) / period  # eq. (25)


@compiled
def pid_turn(law: FloatArray, memory: FloatArray, error: float, behavior: float, trace: FloatArray) -> float:
    """Return the limited turning rate for the heading error of a behaviour [rad/s].

    Args:
        law: T, k_P, k_I and k_D, then the speed [m/s] and the limit [rad/s].
        memory: the last step's behaviour, the sum and the last error, read and written.
        error: the heading error [rad].
        behavior: whose error it is.
        trace: ends with ``TERMS``, which are written.
    """
    if behavior != memory[LAST_BEHAVIOR]:
        memory[LAST_BEHAVIOR], memory[SUM], memory[ERROR] = behavior, 0.0, error
    total, limit = memory[SUM] + error, law[LIMIT]
    p, i, d = pid_terms(error, total, memory[ERROR], law[PERIOD], law[KP], law[KI], law[KD])
    u = p + i + d
    trace[-4], trace[-3], trace[-2], trace[-1] = p, i, d, abs(u) > limit
    memory[ERROR] = error
    if abs(u) <= limit:
        memory[SUM] = total
    limited: float = min(max(u, -limit), limit)
    return limited


@compiled
def step(
    state: FloatArray,
    parameters: FloatArray,
    ranges_m: FloatArray,
    discs: FloatArray,
    pose: tuple[float, float, float],
    goal: tuple[float, float],
    speed: tuple[float, float],
    trace: FloatArray,
) -> tuple[float, float]:
    """Return the constant speed and the law's answer to the active behaviour; a step of ``navbench.policy``."""
    law = part(parameters, LAW)
    error = active_heading_error(state, parameters, ranges_m, pose, goal, trace)
    return law[SPEED], pid_turn(law, part(state, LAW_MEMORY), error, trace[BEHAVIOR], trace)


@dataclass(kw_only=True, config=STRICT)
class Pid(Behaving):
    """Two behaviours, one PID law.

    Attributes:
        kp: proportional gain [1/s].
        ki: integral gain [1/s^2].
        kd: differential gain [1].
        speed_mps: the constant forward speed [m/s].
        turn_limit_radps: the largest turning rate to either side [rad/s].
    """

    kp: NonNegative
    ki: NonNegative
    kd: NonNegative
    speed_mps: Positive
    turn_limit_radps: Positive

    def law(self, period_s: float) -> tuple[float, ...]:
        """Return the law's parameters, in the order of ``pid_turn``, for a control period [s]."""
        return period_s, self.kp, self.ki, self.kd, self.speed_mps, self.turn_limit_radps

    def make_policy(self, setup: Setup) -> Policy:
        """Return the policy for a robot and its ring.

        Raises:
            ValueError: the ring's sensors are not ``sensor_roles``.
        """
        state, parameters = self.behaviors.begin(setup)
        return Policy(
            step=step,
            state=pack(*state, FRESH),
            parameters=pack(*parameters, self.law(setup.period_s)),
            trace_names=(*TRACE, *TERMS),
        )
