"""OA-FLC and TO-FLC of Zhao and Lee: several robots that avoid obstacles and each other without a word between them.

R. Zhao, H.-K. Lee, "Fuzzy-based Path Planning for Multiple Mobile Robots in Unknown Dynamic Environment", Journal of
Electrical Engineering & Technology 12, 2017; evolved by a genetic algorithm in R. Zhao, H.-K. Lee, "Intelligent
Navigation Algorithm for Mobile Robots based on Optimized Fuzzy Logic", Journal of IKEEE 22, 2018.

Each robot turns to its target by one fuzzy controller, TO-FLC, and away from danger by another one, OA-FLC; which of
them drives is decided anew every 0.1 s. Danger is the time to a collision, which a sensor tells from two readings, so
that standing and moving obstacles and other robots are all one. ``zhao2017`` holds the equations and that decision,
``zhao2017_fuzzy`` the fuzzy controllers, ``zhao2017_sets`` what they are made of.

| symbol | here | unit | where |
|---|---|---|---|
| R, Phi | inputs of OA-FLC: least time to a collision, its direction | s, rad | eqs 7, 8 |
| D, Psi | inputs of TO-FLC: distance of the target, heading less its direction | radii, rad | section 3.2 |
| v_L, v_R | outputs: speed of the left and the right wheel | m/s | Tables 1 and 2 |
| D_safe, T_safe, medium | ``safe_distance_m``, ``safe_time_s``, ``medium_time_s`` | m, s, s | Table 3 |

Errata of zhao2017, corrected here beside those of ``zhao2017``:

- Its (1) and (3) turn by (v_L - v_R) / L, against its own Psi = theta - psi_t and its rules: the sign is the other one.
  (3) also adds d to velocities; P_W and P_R are one point here, as on all of this project's robots.
- A set at the end of the range has its centroid inside: PB alone gives 5/6 and "the maximum speed" would never be
  driven. The output is multiplied by ``output_gain`` and clipped to 1.

Kept as printed: in Table 1 F and B turn left by design, and RB and LB turn towards the danger in the rows M to VB; in
Table 2 the cell VB, PS of v_R is PB, where the mirror image of VB, NS would be NB.
"""

import math
from collections.abc import Mapping
from dataclasses import astuple
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass

from navbench.contract import FloatArray, Setup, check_roles
from navbench.fuzzy.describing import Columns
from navbench.fuzzy.inference import FuzzyInference, infer
from navbench.mathematics.kinematics import body_speed
from navbench.policy import CompiledController, Policy, compiled, pack, part
from navbench.validation import STRICT, Number, Positive, describe, remembered

from .decisions import SENSOR_ROLES, avoidance, greatest_danger, target, wheel_speed
from .fuzzy import described, oa_flc, to_flc
from .sets import OaMemberships, OaRules, ToMemberships, ToRules

R_SHOWN_MAX_S = 1000.0  # what the trace shows for a greater R, infinity included: a trace is finite
RING, ANGLES, ROBOT, NAVIGATION, DIRECTIONS, OA, TO = range(7)  # parts of the parameters
TRACE = (
    "R_s",  # at most R_SHOWN_MAX_S
    "Phi_rad",  # as OA-FLC is given it, 0 without danger
    "danger_sensor",  # its number, -1 without danger
    "active_flc",  # 0 TO, 1 OA
    "special_situation",  # 0 none, 1 ahead, 2 right, 3 left, 4 astern
    "D_radii",
    "Psi_rad",
    "vL_mps",  # as commanded
    "vR_mps",
)


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Navigation:
    """The thresholds of Table 3, and what its fuzzy controllers' answers are multiplied by.

    Attributes:
        safe_distance_m: D_safe: nothing is avoided while all readings are at least this [m].
        safe_time_s: T_safe: nor while R is at least this [s].
        medium_time_s: "medium": below this R, special situations are looked for [s].
        output_gain: of both fuzzy controllers' outputs, before they are clipped to [-1, 1].
    """

    safe_distance_m: Positive
    safe_time_s: Positive
    medium_time_s: Positive
    output_gain: Positive


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class SpecialPhi:
    """To what Phi is rewritten in the special situations of section 4 [rad], in the order of ``zhao2017.rewritten``.

    Attributes:
        ahead_turn_left: danger ahead, and the left is freer.
        ahead_turn_right: danger ahead, and the left is not freer.
        right_forward: danger on the right, and the front is freer.
        right_backward: danger on the right, and the front is not freer.
        left_forward: danger on the left, and the front is freer.
        left_backward: danger on the left, and the front is not freer.
        astern_left_freer: danger astern, and the left is freer.
        astern_right_freer: danger astern, and the left is not freer.
    """

    ahead_turn_left: Number
    ahead_turn_right: Number
    right_forward: Number
    right_backward: Number
    left_forward: Number
    left_backward: Number
    astern_left_freer: Number
    astern_right_freer: Number


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
    """Return what Table 3 commands: the answer of OA-FLC to the danger, or of TO-FLC to the target.

    A step of ``navbench.policy``; the state is the readings of one period ago, and NaN a pose's or a goal's.
    """
    robot, chosen = part(parameters, ROBOT), part(parameters, NAVIGATION)
    period_s, radius_m, limit_mps, track_m, gain = robot[0], robot[1], robot[2], robot[3], chosen[3]
    r, sensor = greatest_danger(state, ranges_m, part(parameters, RING), period_s)
    state[:] = ranges_m
    directions = part(parameters, DIRECTIONS)
    avoids, phi, situation = avoidance(r, sensor, ranges_m, part(parameters, ANGLES), chosen, directions)
    trace[0], trace[1], trace[2] = min(r, R_SHOWN_MAX_S), phi, sensor
    trace[3], trace[4] = avoids, situation
    trace[5], trace[6] = target(pose[0], pose[1], pose[2], goal[0], goal[1], radius_m)
    if infer(part(parameters, OA if avoids else TO), trace[:2] if avoids else trace[5:7], trace[7:]) >= 0:
        return math.nan, math.nan
    trace[7], trace[8] = wheel_speed(trace[7], gain, limit_mps), wheel_speed(trace[8], gain, limit_mps)
    return body_speed(trace[7], trace[8], track_m)


class OaTo(CompiledController):
    """Two fuzzy controllers, one for danger and one for the target.

    Attributes:
        sensor_roles: the sensors that it needs, in this order.
        trace_words: what the trace's values are called.
        oa: OA-FLC: R [s] and Phi [rad] to shares of the wheels' limit.
        to: TO-FLC: D [robot radii] and Psi [rad] to shares of the wheels' limit.
    """

    sensor_roles = SENSOR_ROLES
    trace_words = {
        "active_flc": ("TO-FLC", "OA-FLC"),
        "special_situation": ("", "special ahead", "special right", "special left", "special astern"),
    }

    def __init__(
        self,
        *,
        navigation: Mapping[str, float],
        special_phi_rad: Mapping[str, float],
        oa_memberships: Mapping[str, Mapping[str, Mapping[str, float]]],
        oa_rules: Mapping[str, Mapping[str, Mapping[str, str]]],
        to_memberships: Mapping[str, Mapping[str, float]],
        to_rules: Mapping[str, Mapping[str, Mapping[str, str]]],
    ) -> None:
        """Check the parameters and build the fuzzy controllers.

        Args:
            navigation: a value for each field of ``Navigation``.
            special_phi_rad: a value for each field of ``SpecialPhi``.
            oa_memberships: the sets of OA-FLC, as ``zhao2017_sets.OaMemberships``.
            oa_rules: Table 1, as ``zhao2017_sets.OaRules``.
            to_memberships: the peaks of TO-FLC's sets, as ``zhao2017_sets.ToMemberships``.
            to_rules: Table 2, as ``zhao2017_sets.ToRules``.

        Raises:
            ValueError: a parameter is unknown, missing or out of range.
        """
        self.oa, self.to = _oa_flc(oa_memberships, oa_rules), _to_flc(to_memberships, to_rules)
        self._chosen = (*_limits(navigation, special_phi_rad), self.oa.base, self.to.base)

    def make_policy(self, setup: Setup) -> Policy:
        """Return the policy for a robot and its ring.

        Raises:
            ValueError: the ring's sensors are not ``sensor_roles``.
        """
        check_roles(setup, SENSOR_ROLES)
        robot = setup.robot
        unseen = np.array([sensor.max_range_m for sensor in setup.sensors])
        angles = [sensor.heading_rad for sensor in setup.sensors]
        of_robot = (setup.period_s, robot.radius_m, robot.wheel_speed_max_mps, robot.track_m)
        parameters = pack(unseen, angles, of_robot, *self._chosen)
        return Policy(step=step, state=unseen, parameters=parameters, trace_names=TRACE)

    def describe(self) -> dict[str, Columns]:
        """Return named tables for a report: memberships (Figs 3 and 5), rules (Tables 1 and 2)."""
        return described(self.oa, self.to)


@remembered
def _limits(navigation: Mapping[str, float], special_phi_rad: Mapping[str, float]) -> tuple[tuple[Any, ...], ...]:
    """Return the values of ``Navigation`` and of ``SpecialPhi``."""
    return (
        astuple(describe(Navigation, navigation, "build.navigation")),
        astuple(describe(SpecialPhi, special_phi_rad, "build.special_phi_rad")),
    )


@remembered
def _oa_flc(memberships: Mapping[str, Any], rules: Mapping[str, Any]) -> FuzzyInference:
    """Return OA-FLC for the parameters of ``OaTo``."""
    return oa_flc(
        describe(OaMemberships, memberships, "build.oa_memberships"), describe(OaRules, rules, "build.oa_rules")
    )


@remembered
def _to_flc(memberships: Mapping[str, Any], rules: Mapping[str, Any]) -> FuzzyInference:
    """Return TO-FLC for the parameters of ``OaTo``."""
    return to_flc(
        describe(ToMemberships, memberships, "build.to_memberships"), describe(ToRules, rules, "build.to_rules")
    )
