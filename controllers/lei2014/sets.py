"""The fuzzy sets of ``dual_layer``, checked, and its second layer built from them.

Lei et al. 2014 (``lei2014`` cites it), sections 3.1.2, 3.2.1 and 3.2.2, Figures 3 and 5. The paper prints the ranges
and draws the sets, triangles and for theta_tar "z-shaped" ones, without numbers that could be read: so where the peaks
stand is assumed. It prints 0.7 m/s as the end of v's range and drives its robots at 0.1 m/s at most, so here the sets
of v and w are shares of the largest speed and turning rate.
"""

import itertools
import math
from collections.abc import Mapping, Sequence

from pydantic.dataclasses import dataclass

from navbench.fuzzy.inference import FuzzyInference, Variable
from navbench.validation import STRICT, Number, Positive

from .danger import DANGERS, DISTANCE_FACTORS, TIME_FACTORS, between_ends
from .rules import AZIMUTHS, SPEEDS, TURNS, Rule


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class FuzzySets:
    """Where the sectors end and each fuzzy set has its peak.

    Attributes:
        front_rad: how far to either side the front sector reaches [rad].
        side_rad: how far the side sectors reach, and the range of theta_tar [rad].
        eta_d_peaks: of the distance factor; the first and the last are the ends of its range.
        eta_t_peaks: of the time factor, likewise.
        danger_peaks: of DDC, likewise, in both layers.
        theta_tar_peaks_rad: of the target's azimuth; the outer two sets stay 1 out to ``side_rad`` [rad].
        speed_peaks: of v, as shares of the largest speed.
        turn_peaks: of w, as shares of the largest turning rate.
    """

    front_rad: Positive
    side_rad: Positive
    eta_d_peaks: Mapping[str, Number]
    eta_t_peaks: Mapping[str, Number]
    danger_peaks: Mapping[str, Number]
    theta_tar_peaks_rad: Mapping[str, Number]
    speed_peaks: Mapping[str, Number]
    turn_peaks: Mapping[str, Number]

    def __post_init__(self) -> None:
        """Check names, order and range."""
        if not self.front_rad < self.side_rad <= math.pi:
            raise ValueError(f"side_rad={self.side_rad}: must lie above front_rad={self.front_rad} and not above pi")
        for name, needed, low, high in (
            ("eta_d_peaks", DISTANCE_FACTORS, 0.0, math.inf),
            ("eta_t_peaks", TIME_FACTORS, 0.0, math.inf),
            ("danger_peaks", DANGERS, 0.0, 1.0),
            ("theta_tar_peaks_rad", AZIMUTHS, -self.side_rad, self.side_rad),
            ("speed_peaks", SPEEDS, 0.0, 1.0),
            ("turn_peaks", TURNS, -1.0, 1.0),
        ):
            peaks = getattr(self, name)
            values = list(peaks.values())
            if tuple(peaks) != needed:
                raise ValueError(f"{name}: must name the sets {', '.join(needed)}, in this order")
            if values[0] < low or values[-1] > high or any(b <= a for a, b in itertools.pairwise(values)):
                raise ValueError(f"{name}: must ascend within {low:g} and {high:g}, not {values}")


def velocity_controller(
    sets: FuzzySets, rules: Sequence[Rule], speed_max_mps: float, turn_max_radps: float
) -> FuzzyInference:
    """Return VFC: theta_tar [rad], LDDC, FDDC, RDDC to v [m/s] and w, positive to the right [rad/s].

    Args:
        sets: the fuzzy sets.
        rules: the rules.
        speed_max_mps: the speed of which the sets of v are shares [m/s].
        turn_max_radps: the turning rate of which the sets of w are shares [rad/s].
    """
    danger = between_ends(sets.danger_peaks)
    azimuth = Variable.from_peaks(sets.theta_tar_peaks_rad, -sets.side_rad, sets.side_rad, shoulders=True)
    return FuzzyInference(
        {"theta_tar": azimuth, "LDDC": danger, "FDDC": danger, "RDDC": danger},
        {
            "v": between_ends({name: share * speed_max_mps for name, share in sets.speed_peaks.items()}),
            "w": between_ends({name: share * turn_max_radps for name, share in sets.turn_peaks.items()}),
        },
        [(rule.theta_tar, rule.lddc, rule.fddc, rule.rddc, rule.v, rule.w) for rule in rules],
        fallback={"v": sets.speed_peaks["Z"] * speed_max_mps, "w": sets.turn_peaks["Z"] * turn_max_radps},  # never
        defuzzification="weighted_mean_of_peaks",
    )
