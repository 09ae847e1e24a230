"""The PID controller that Aouf, Boussaid and Sakly compare theirs with.

A. Aouf, L. Boussaid, A. Sakly, "Same Fuzzy Logic Controller for Two-Wheeled Mobile Robot Navigation in Strange
Environments", Journal of Robotics 2019, 2465219, doi:10.1155/2019/2465219; section 4, equation 25.

The behaviours and the arbitration are the fuzzy controller's, see ``aouf2019``; only the steering differs. The
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

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass

from navbench.compiled import compiled
from navbench.contract import Command, Observation, Setup
from navbench.mathematics.geometry import wrap_angle
from navbench.validation import STRICT, NonNegative, Positive, describe

from .behaviors import Behaviors
from .equations import SENSOR_ROLES


@compiled
def pid_terms(
    e: float, e_sum: float, e_before: float, period: float, kp: float, ki: float, kd: float
) -> tuple[float, float, float]:
    """Return the three terms whose sum is u(k): of the error, of the sum e(0) + ... + e(k), of the difference."""
    return kp * e, ki * period * e_sum, kd * wrap_angle(e - e_before) / period  # eq. (25)


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Law:
    """The steering law's parameters.

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


class PidLaw:
    """The law and what it remembers between two control periods.

    Args:
        parameters: its parameters.
    """

    def __init__(self, parameters: Law) -> None:
        self.parameters = parameters
        self.reset(1.0)

    def reset(self, period_s: float) -> None:
        """Begin an episode with this control period [s]."""
        self._period_s = period_s
        self._behavior: float | None = None
        self._sum_rad = 0.0
        self._error_rad = 0.0
        self._terms_radps = (0.0, 0.0, 0.0)
        self._turn_radps = 0.0  # before the limit

    def turn(self, error_rad: float, behavior: float) -> float:
        """Return the limited turning rate for the heading error of a behaviour [rad/s]."""
        law = self.parameters
        if behavior != self._behavior:
            self._behavior, self._sum_rad, self._error_rad = behavior, 0.0, error_rad
        total = self._sum_rad + error_rad
        self._terms_radps = pid_terms(error_rad, total, self._error_rad, self._period_s, law.kp, law.ki, law.kd)
        self._error_rad = error_rad
        self._turn_radps = turn_radps = sum(self._terms_radps)
        if abs(turn_radps) <= law.turn_limit_radps:
            self._sum_rad = total
        return min(max(turn_radps, -law.turn_limit_radps), law.turn_limit_radps)

    @property
    def trace(self) -> dict[str, float]:
        """The three terms of the latest turn, and whether the limit acted (1: true)."""
        proportional, integral, differential = self._terms_radps
        return {
            "proportional_radps": proportional,
            "integral_radps": integral,
            "differential_radps": differential,
            "turn_limited": float(abs(self._turn_radps) > self.parameters.turn_limit_radps),
        }


class Pid:
    """Two behaviours, one PID law.

    Attributes:
        sensor_roles: the sensors that it needs, in this order.
    """

    sensor_roles = SENSOR_ROLES

    def __init__(
        self,
        *,
        behaviors: Mapping[str, Any],
        kp: float,
        ki: float,
        kd: float,
        speed_mps: float,
        turn_limit_radps: float,
    ) -> None:
        """Check the parameters.

        Args:
            behaviors: a value for each field of ``aouf2019_behaviors.BehaviorParameters``.
            kp: proportional gain [1/s].
            ki: integral gain [1/s^2].
            kd: differential gain [1].
            speed_mps: the constant forward speed [m/s].
            turn_limit_radps: the largest turning rate to either side [rad/s].

        Raises:
            ValueError: a parameter is unknown, missing or out of range.
        """
        given = {"kp": kp, "ki": ki, "kd": kd, "speed_mps": speed_mps, "turn_limit_radps": turn_limit_radps}
        self._law = PidLaw(describe(Law, given, "Pid"))
        self._behaviors = Behaviors(behaviors)

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Begin an episode; nothing here is left to chance.

        Raises:
            ValueError: the ring's sensors are not ``sensor_roles``.
        """
        self._behaviors.reset(setup)
        self._law.reset(setup.period_s)

    def act(self, observation: Observation) -> Command:
        """Return the constant speed and the PID law's answer to the heading error of the active behaviour."""
        error = self._behaviors.heading_error(observation)
        return Command(self._law.parameters.speed_mps, self._law.turn(error, self._behaviors.active))

    @property
    def trace(self) -> dict[str, float]:
        """The behaviours' trace (``aouf2019.TRACE``) and the law's (``PidLaw.trace``)."""
        return {**self._behaviors.trace, **self._law.trace}
