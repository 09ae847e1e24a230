"""The Same Fuzzy Logic Controller (S.F.L.C.) of Aouf, Boussaid and Sakly.

A. Aouf, L. Boussaid, A. Sakly, "Same Fuzzy Logic Controller for Two-Wheeled Mobile Robot Navigation in Strange
Environments", Journal of Robotics 2019, 2465219, doi:10.1155/2019/2465219; section 5, Tables 1 and 2, Figures 10 to 12.

One fuzzy controller of one input serves both behaviours, see ``equations``: what it is given is the heading error of
the active one. Eleven rules turn it into a turning rate of the same size and sign and into a speed that falls as the
error grows. So the robot is quick where the path is straight and nearly turns on the spot where it is not.

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

from navbench.contract import FloatArray, Setup
from navbench.fuzzy.inference import FuzzyInference, Variable, infer, memberships
from navbench.policy import Policy, compiled, pack, part, scratch
from navbench.validation import STRICT, Number, remembered

from .behaviors import LAW, TRACE, Behaving, active_heading_error

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


@compiled
def fuzzy_law(base: FloatArray, error: float) -> tuple[float, float]:
    """Return v and w, the fuzzy controller's answer to a heading error, both NaN where that is.

    Args:
        base: ``FuzzyInference.base`` of ``same_fuzzy_controller``.
        error: the heading error [rad].
    """
    given, answer = scratch((1,)), scratch((2,))
    given[0] = error
    infer(base, given, answer)
    return answer[0], answer[1]


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
    """Return the fuzzy controller's answer to the active behaviour; a step of ``navbench.policy``."""
    return fuzzy_law(part(parameters, LAW), active_heading_error(state, parameters, ranges_m, pose, goal, trace))


@dataclass(kw_only=True, config=STRICT)
class Fuzzy(Behaving):
    """What steers by the fuzzy controller; each fuzzy set has its peak, from the lowest to the highest.

    Attributes:
        heading_error_peaks_rad: of the input, within -pi and pi [rad].
        speed_peaks_mps: of the speed, from its lower to its upper end [m/s].
        turn_peaks_radps: of the turning rate, from its lower to its upper end [rad/s].
        inference: the fuzzy controller: heading error [rad] to speed [m/s] and turning rate [rad/s].
    """

    heading_error_peaks_rad: Mapping[str, Number]
    speed_peaks_mps: Mapping[str, Number]
    turn_peaks_radps: Mapping[str, Number]

    def __post_init__(self) -> None:
        """Check names, order and range, and build the fuzzy controller."""
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
        self.inference = same_fuzzy_controller(
            self.heading_error_peaks_rad, self.speed_peaks_mps, self.turn_peaks_radps
        )


@dataclass(kw_only=True, config=STRICT)
class Sflc(Fuzzy):
    """The S.F.L.C.: two behaviours, one fuzzy controller."""

    def make_policy(self, setup: Setup) -> Policy:
        """Return the policy for a robot and its ring.

        Raises:
            ValueError: the ring's sensors are not ``sensor_roles``.
        """
        state, parameters = self.behaviors.begin(setup)
        return Policy(
            step=step, state=pack(*state), parameters=pack(*parameters, self.inference.base), trace_names=TRACE
        )

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
    """Return the fuzzy controller of some peaks, which are checked: see ``Fuzzy``."""
    return FuzzyInference(
        {"heading_error": Variable.from_peaks(heading_error_peaks_rad, -math.pi, math.pi, shoulders=True)},
        {"speed": _output(speed_peaks_mps), "turn": _output(turn_peaks_radps)},
        RULES,
        fallback={"speed": speed_peaks_mps["S"], "turn": turn_peaks_radps["Z"]},  # a rule always fires
    )


def _output(peaks: Mapping[str, float]) -> Variable:
    """Return an output that reaches from its first peak to its last, with half triangles at the ends."""
    return Variable.from_peaks(peaks, min(peaks.values()), max(peaks.values()), shoulders=False)
