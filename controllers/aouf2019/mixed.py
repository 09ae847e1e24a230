"""The behaviours of Aouf, Boussaid and Sakly under mixed laws, to tell what each part of their controller does.

Their S.F.L.C. turns and drives by one fuzzy controller in both behaviours; the PIDs that they compare it with turn by a
PID law and drive at a constant speed. Here each behaviour takes either law for its turning and either for its speed.
So the fuzzy law can serve one behaviour only, and a PID can drive at the fuzzy controller's own speed, so that only
the turning differs. Nothing of this is in the paper; see ``sflc``, ``pid`` and ``aouf2019`` for the parts.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from navbench.contract import Command, Observation, Setup
from navbench.validation import describe

from .behaviors import Behaviors
from .equations import FOLLOW_WALL, GO_TO_GOAL, SENSOR_ROLES
from .pid import Law, PidLaw
from .sflc import same_fuzzy_controller

BEHAVIORS = {"go_to_goal": GO_TO_GOAL, "follow_wall": FOLLOW_WALL}


class Mixed:
    """Two behaviours, a law of choice for each.

    Attributes:
        sensor_roles: the sensors that it needs, in this order.
    """

    sensor_roles = SENSOR_ROLES

    def __init__(
        self,
        *,
        behaviors: Mapping[str, Any],
        heading_error_peaks_rad: Mapping[str, float],
        speed_peaks_mps: Mapping[str, float],
        turn_peaks_radps: Mapping[str, float],
        kp: float,
        ki: float,
        kd: float,
        speed_mps: float,
        turn_limit_radps: float,
        fuzzy_turn_in: Sequence[str],
        fuzzy_speed_in: Sequence[str],
    ) -> None:
        """Check the parameters.

        Args:
            behaviors: a value for each field of ``aouf2019_behaviors.BehaviorParameters``.
            heading_error_peaks_rad: as of ``sflc.Sflc``.
            speed_peaks_mps: as of ``sflc.Sflc``.
            turn_peaks_radps: as of ``sflc.Sflc``.
            kp: as of ``pid.Pid``.
            ki: as of ``pid.Pid``.
            kd: as of ``pid.Pid``.
            speed_mps: as of ``pid.Pid``.
            turn_limit_radps: as of ``pid.Pid``.
            fuzzy_turn_in: behaviours, of ``BEHAVIORS``, that turn by the fuzzy controller; the others by the PID law.
            fuzzy_speed_in: behaviours that drive at the fuzzy controller's speed; the others at the constant one.

        Raises:
            ValueError: a parameter is unknown, missing or out of range.
        """
        for name, chosen in (("fuzzy_turn_in", fuzzy_turn_in), ("fuzzy_speed_in", fuzzy_speed_in)):
            if not set(chosen) <= set(BEHAVIORS):
                raise ValueError(f"{name}={list(chosen)}: must be a list of any of {', '.join(BEHAVIORS)}")
        given = {"kp": kp, "ki": ki, "kd": kd, "speed_mps": speed_mps, "turn_limit_radps": turn_limit_radps}
        self._law = PidLaw(describe(Law, given, "Mixed"))
        self._behaviors = Behaviors(behaviors)
        self._inference = same_fuzzy_controller(heading_error_peaks_rad, speed_peaks_mps, turn_peaks_radps)
        self._fuzzy_turn = {BEHAVIORS[name] for name in fuzzy_turn_in}
        self._fuzzy_speed = {BEHAVIORS[name] for name in fuzzy_speed_in}

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Begin an episode; nothing here is left to chance.

        Raises:
            ValueError: the ring's sensors are not ``sensor_roles``.
        """
        self._behaviors.reset(setup)
        self._law.reset(setup.period_s)

    def act(self, observation: Observation) -> Command:
        """Return the answer of the active behaviour's laws to its heading error."""
        error = self._behaviors.heading_error(observation)
        behavior = self._behaviors.active
        speed_mps, turn_radps = self._inference(error)
        pid_radps = self._law.turn(error, behavior)
        return Command(
            speed_mps if behavior in self._fuzzy_speed else self._law.parameters.speed_mps,
            turn_radps if behavior in self._fuzzy_turn else pid_radps,
        )

    @property
    def trace(self) -> dict[str, float]:
        """The behaviours' trace (``aouf2019.TRACE``) and the PID law's (``pid.PidLaw.trace``)."""
        return {**self._behaviors.trace, **self._law.trace}
