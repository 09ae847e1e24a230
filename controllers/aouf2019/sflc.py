"""The Same Fuzzy Logic Controller (S.F.L.C.) of Aouf, Boussaid and Sakly.

A. Aouf, L. Boussaid, A. Sakly, "Same Fuzzy Logic Controller for Two-Wheeled Mobile Robot Navigation in Strange
Environments", Journal of Robotics 2019, 2465219, doi:10.1155/2019/2465219; section 5, Tables 1 and 2, Figures 10 to 12.

One fuzzy controller of one input serves both behaviours, see ``aouf2019``: what it is given is the heading error of the
active one. Eleven rules turn it into a turning rate of the same size and sign and into a speed that falls as the error
grows. So the robot is quick where the path is straight and nearly turns on the spot where it is not.

| symbol | here | unit | where |
|---|---|---|---|
| Phi_ao_gtg, Phi_fw | heading error, the input | rad | Fig. 10, eqs 16, 24 |
| w | turning rate, positive to the left | rad/s | Fig. 11 |
| v | forward speed | m/s | Fig. 12 |

The figures print the memberships without numbers that could be read here, so all peaks are assumed: triangles, the
input's end sets open to -pi and pi, the outputs' end sets half triangles. Min for implication, max over the rules and
the centroid are the usual reading of a Mamdani controller; the paper names none.

Errata: Table 1 lacks L and lists NS before N, where Table 2 has the order in which the names mean what they say. The
text gives the speed four sets and Table 2 uses three, so VL is drawn and never concluded.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass

from navbench.contract import Command, Observation, Setup
from navbench.fuzzy.inference import FuzzyInference, Variable, memberships
from navbench.validation import STRICT, Number, describe, remembered

from .behaviors import Behaviors
from .equations import SENSOR_ROLES

# Table 2: heading error, linear velocity, angular velocity.
RULES = (
    ("NL", "S", "NL"),
    ("NM", "S", "NM"),
    ("N", "S", "N"),
    ("NS", "M", "NS"),
    ("ZN", "L", "ZN"),
    ("Z", "L", "Z"),
    ("ZP", "L", "ZP"),
    ("PS", "M", "PS"),
    ("P", "S", "P"),
    ("PM", "S", "PM"),
    ("PL", "S", "PL"),
)
ERRORS = tuple(error for error, _, _ in RULES)  # Table 1; the turning rate's sets have the same names
SPEEDS = ("S", "M", "L", "VL")  # Table 1, with the L that it lacks


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Peaks:
    """Where each fuzzy set has its peak, from the lowest to the highest.

    Attributes:
        heading_error_peaks_rad: of the input, within -pi and pi [rad].
        speed_peaks_mps: of the speed, from its lower to its upper end [m/s].
        turn_peaks_radps: of the turning rate, from its lower to its upper end [rad/s].
    """

    heading_error_peaks_rad: Mapping[str, Number]
    speed_peaks_mps: Mapping[str, Number]
    turn_peaks_radps: Mapping[str, Number]

    def __post_init__(self) -> None:
        """Check names, order and range."""
        for name, needed in (
            ("heading_error_peaks_rad", ERRORS),
            ("speed_peaks_mps", SPEEDS),
            ("turn_peaks_radps", ERRORS),
        ):
            peaks = getattr(self, name)
            values = list(peaks.values())
            if tuple(peaks) != needed:
                raise ValueError(f"{name}: must name the sets {', '.join(needed)}, in this order")
            if any(after <= before for before, after in zip(values, values[1:], strict=False)):
                raise ValueError(f"{name}: must ascend from the first set to the last, not {values}")
        if max(map(abs, self.heading_error_peaks_rad.values())) > math.pi:
            raise ValueError("heading_error_peaks_rad: must lie within -pi and pi")
        if min(self.speed_peaks_mps.values()) < 0.0:
            raise ValueError("speed_peaks_mps: must not be negative")


class Sflc:
    """The S.F.L.C.: two behaviours, one fuzzy controller.

    Attributes:
        sensor_roles: the sensors that it needs, in this order.
        inference: the fuzzy controller: heading error [rad] to speed [m/s] and turning rate [rad/s].
    """

    sensor_roles = SENSOR_ROLES

    def __init__(
        self,
        *,
        behaviors: Mapping[str, Any],
        heading_error_peaks_rad: Mapping[str, float],
        speed_peaks_mps: Mapping[str, float],
        turn_peaks_radps: Mapping[str, float],
    ) -> None:
        """Check the parameters and build the fuzzy controller.

        Args:
            behaviors: a value for each field of ``aouf2019_behaviors.BehaviorParameters``.
            heading_error_peaks_rad: peak of each of the eleven sets of the input [rad].
            speed_peaks_mps: peak of each of the four sets of the speed [m/s].
            turn_peaks_radps: peak of each of the eleven sets of the turning rate [rad/s].

        Raises:
            ValueError: a parameter is unknown, missing or out of range.
        """
        self._behaviors = Behaviors(behaviors)
        self.inference = same_fuzzy_controller(heading_error_peaks_rad, speed_peaks_mps, turn_peaks_radps)

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Begin an episode; nothing here is left to chance.

        Raises:
            ValueError: the ring's sensors are not ``sensor_roles``.
        """
        self._behaviors.reset(setup)

    def act(self, observation: Observation) -> Command:
        """Return the fuzzy controller's answer to the heading error of the active behaviour."""
        speed_mps, turn_radps = self.inference(self._behaviors.heading_error(observation))
        return Command(speed_mps, turn_radps)

    @property
    def trace(self) -> dict[str, float]:
        """What the behaviours and the arbitration did at the latest act: see ``aouf2019.TRACE``."""
        return self._behaviors.trace

    def describe(self) -> dict[str, dict[str, list[Any]]]:
        """Return named tables for a report: memberships (Figs 10 to 12), rules (Table 2) and the control surface.

        A set is given by its corners, between which it is straight; the surface in steps of half a degree.
        """
        corners = [
            (name, term, x, float(memberships(variable, x)[i, 0]))
            for name, variable in {**self.inference.inputs, **self.inference.outputs}.items()
            for i, (term, fuzzy_set) in enumerate(variable.terms.items())
            for x in sorted(set(fuzzy_set.corners))
        ]
        errors_rad = np.radians(np.linspace(-180.0, 180.0, 721))
        surface = self.inference.surface(errors_rad)
        return {
            "memberships": _columns(("variable", "term", "x", "degree"), corners),
            "rules": _columns(("heading_error", "speed", "turn"), self.inference.rules),
            "surface": _columns(("phi_rad", "v_mps", "w_radps"), np.column_stack([errors_rad, surface]).tolist()),
        }


def _columns(names: Sequence[str], rows: Sequence[Sequence[Any]]) -> dict[str, list[Any]]:
    return {name: [row[i] for row in rows] for i, name in enumerate(names)}


@remembered
def same_fuzzy_controller(
    heading_error_peaks_rad: Mapping[str, float],
    speed_peaks_mps: Mapping[str, float],
    turn_peaks_radps: Mapping[str, float],
) -> FuzzyInference:
    """Return the fuzzy controller: heading error [rad] to speed [m/s] and turning rate [rad/s].

    Args:
        heading_error_peaks_rad: peak of each of the eleven sets of the input [rad].
        speed_peaks_mps: peak of each of the four sets of the speed [m/s].
        turn_peaks_radps: peak of each of the eleven sets of the turning rate [rad/s].

    Raises:
        ValueError: a set is unknown, missing, out of order or out of range.
    """
    given = {
        "heading_error_peaks_rad": heading_error_peaks_rad,
        "speed_peaks_mps": speed_peaks_mps,
        "turn_peaks_radps": turn_peaks_radps,
    }
    peaks = describe(Peaks, given, "build")
    return FuzzyInference(
        {"heading_error": Variable.from_peaks(peaks.heading_error_peaks_rad, -math.pi, math.pi, shoulders=True)},
        {"speed": _output(peaks.speed_peaks_mps), "turn": _output(peaks.turn_peaks_radps)},
        RULES,
        fallback={"speed": peaks.speed_peaks_mps["S"], "turn": peaks.turn_peaks_radps["Z"]},  # a rule always fires
    )


def _output(peaks: Mapping[str, float]) -> Variable:
    """Return an output that reaches from its first peak to its last, with half triangles at the ends."""
    return Variable.from_peaks(peaks, min(peaks.values()), max(peaks.values()), shoulders=False)
