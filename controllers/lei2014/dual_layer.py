"""The dual-layer fuzzy controller of Lei, Xing, Feng, Guan and Du: danger degrees first, then speeds.

Y. Lei, X. Xing, Z. Feng, X. Guan, L. Du, "Dynamic Path Planning Based on Fuzzy and Behavior Control Idea", 2014;
section 3, Figures 2 to 5.

The first layer (DDCFC, ``lei2014``) turns what is known of each obstacle into its danger degree of collision. The
second (VFC, ``lei2014_rules``) turns the largest danger to the left, in front and to the right and the azimuth of the
target into a speed and a turning rate, by 81 rules that stand for three behaviours: move to goal, avoid obstacle and
follow obstacle. One fuzzy controller of all seven inputs would need 2187 rules. The symbols, the errata and what the
paper leaves open stand in those two files and in ``lei2014_sets``.

Obstacles are whatever the sensors offer: the discs of a tracker, as in the paper, and the hits of a range ring
(``lei2014_hits``), which see walls too. The ring may be any. The paper says that its robots need no communication, and
its experiment has them tell each other by radio where they are and how they move: the tracker stands for the radio, the
ring for the claim.

v and w are held over the control period T. By its own rules the method has two weaknesses. With nothing in sight MG
never turns by more than NS or PS and never drives slower than F, so that a goal aside within the circle which that
makes (0.375 m at 0.1 m/s and 0.6 rad/s) is circled for ever. And two robots side by side, each with its goal behind and
the other on the side to which it would turn, hold each other off and drive on together.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass

from navbench.contract import Command, Observation, Setup
from navbench.fuzzy.inference import FuzzyInference, memberships
from navbench.validation import STRICT, Flag, Positive, describe, remembered

from .danger import azimuth, danger_controller, directional_danger
from .hits import Hits
from .rules import BEHAVIORS, Variant, rule_base, started, strongest_of_each
from .sets import FuzzySets, velocity_controller

TRACE = (
    "lddc",
    "fddc",
    "rddc",
    "theta_tar_rad",  # negative to the left
    "behavior",  # whose rule is the strongest, by its number in BEHAVIORS: 0 MG, 1 AO, 2 FO
    "mg",  # strength of the strongest rule of each
    "ao",
    "fo",
    "v_command_mps",
    "w_command_radps",  # as in the paper, positive to the right
)


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Parameters:
    """What the controller may be told beside its fuzzy sets; ``DualLayer`` says what each is."""

    rules: Variant
    velocity_aware: Flag
    speed_max_mps: Positive
    turn_max_radps: Positive
    safety_distance_m: Positive
    obstacle_speed_max_mps: Positive


class DualLayer:
    """The two fuzzy controllers, one behind the other.

    Attributes:
        rules: the 81 rules of the second layer.
        ddcfc: the first layer: eta_d, eta_t to DDC.
        vfc: the second: theta_tar [rad], LDDC, FDDC, RDDC to v [m/s] and w, positive to the right [rad/s].
    """

    def __init__(
        self,
        *,
        rules: Variant,
        velocity_aware: bool,
        speed_max_mps: float,
        turn_max_radps: float,
        safety_distance_m: float,
        obstacle_speed_max_mps: float,
        sets: Mapping[str, Any],
    ) -> None:
        """Check the parameters and build both layers.

        Args:
            rules: "literal", or "safe" with guards against turning to the more dangerous side.
            velocity_aware: False: the danger degree knows of distances only, and eta_t counts as infinite.
            speed_max_mps: the largest speed [m/s].
            turn_max_radps: the largest turning rate to either side [rad/s].
            safety_distance_m: D_s [m].
            obstacle_speed_max_mps: what a hit would have had to exceed is new, and counts as standing still [m/s].
            sets: a value for each field of ``lei2014_sets.FuzzySets``.

        Raises:
            ValueError: a parameter is unknown, missing or out of range.
        """
        given = {
            "rules": rules,
            "velocity_aware": velocity_aware,
            "speed_max_mps": speed_max_mps,
            "turn_max_radps": turn_max_radps,
            "safety_distance_m": safety_distance_m,
            "obstacle_speed_max_mps": obstacle_speed_max_mps,
        }
        self._parameters = describe(Parameters, given, "build")
        self.rules = rule_base(rules)
        self._sets, self.ddcfc, self.vfc = _layers(rules, speed_max_mps, turn_max_radps, sets)
        self._behaviors = np.array([BEHAVIORS.index(rule.behavior) for rule in self.rules])

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Begin an episode with no scan remembered; nothing here is left to chance."""
        given, sets = self._parameters, self._sets
        self._thresholds = (
            setup.robot.radius_m,
            setup.period_s,
            given.safety_distance_m,
            sets.front_rad,
            sets.side_rad,
        )
        self._hits = Hits(setup.sensors, setup.period_s, given.obstacle_speed_max_mps)
        self._latest = dict.fromkeys(TRACE, 0.0)

    def act(self, observation: Observation) -> Command:
        """Return speed and turning rate for what is dangerous where, and for where the target is."""
        x, y, psi = observation.pose
        pose = (x, y, psi)
        hits, discs = self._hits(observation.ranges_m, pose), observation.discs
        obstacles = np.concatenate([hits, discs]) if len(discs) else hits
        dangers = directional_danger(
            self.ddcfc.base,
            self._thresholds,
            self._parameters.velocity_aware,
            pose,
            observation.v_mps,
            obstacles,
        )
        theta_tar = azimuth(psi, math.atan2(observation.goal[1] - y, observation.goal[0] - x))
        v, w = self.vfc(theta_tar, *dangers)
        strongest = strongest_of_each(self.vfc.strengths(theta_tar, *dangers), self._behaviors)
        behavior = max(range(len(BEHAVIORS)), key=lambda i: (strongest[i], i))  # of equal ones the one with priority
        self._latest = dict(zip(TRACE, (*dangers, theta_tar, float(behavior), *strongest, v, w), strict=True))
        return Command(v, -w)  # psi' = -w, see lei2014

    @property
    def trace(self) -> dict[str, float]:
        """What ``TRACE`` names, at the latest act."""
        return self._latest

    def describe(self) -> dict[str, dict[str, list[Any]]]:
        """Return named tables for a report.

        ``memberships`` (Figs 3 and 5, a set by its corners), ``danger_rules`` (Table 1), ``rules``, ``behaviors`` (how
        many rules start each behaviour, how many are left to it, and to which others the rest goes), ``danger`` (DDC
        over both factors) and ``complexity`` (how many rules there are, and would be in one layer).
        """
        corners = [
            (name, term, x, float(memberships(variable, x)[i, 0]))
            for layer in (self.ddcfc, self.vfc)
            for name, variable in {**layer.inputs, **layer.outputs}.items()
            for i, (term, fuzzy_set) in enumerate(variable.terms.items())
            for x in sorted(set(fuzzy_set.corners))
        ]
        eta_d, eta_t = (np.linspace(variable.low, variable.high, 49) for variable in self.ddcfc.inputs.values())
        ddc = self.ddcfc.surface(eta_d, eta_t)
        surface = [(d, t, ddc[i, j, 0]) for i, d in enumerate(eta_d) for j, t in enumerate(eta_t)]
        return {
            "memberships": _columns(("variable", "term", "x", "degree"), corners),
            "danger_rules": _columns(("eta_d", "eta_t", "DDC"), self.ddcfc.rules),
            "rules": _columns(("theta_tar", "LDDC", "FDDC", "RDDC", "behavior", "v", "w"), self.rules),
            "behaviors": _columns(("behavior", "started", "left_to_AO", "left_to_FO", "executed"), self._counts()),
            "danger": _columns(("eta_d", "eta_t", "DDC"), [tuple(map(float, row)) for row in surface]),
            "complexity": _columns(("structure", "inputs", "rules"), self._complexity()),
        }

    def _counts(self) -> list[tuple[str, int, int, int, int]]:
        """Return for each behaviour how many rules start it, go to AO or FO instead, and are its own."""
        starts = [(started(*rule[:4]), rule.behavior) for rule in self.rules]
        rows = []
        for name in BEHAVIORS:
            executed = [behavior for names, behavior in starts if name in names]
            elsewhere = (0 if name == other else executed.count(other) for other in ("AO", "FO"))
            rows.append((name, len(executed), *elsewhere, executed.count(name)))
        return rows  # type: ignore[return-value]

    def _complexity(self) -> list[tuple[str, int, int]]:
        """Return inputs and rules of each layer, of what one period fires for three directions, and of one layer."""
        directions = [name for name in self.vfc.inputs if name in ("LDDC", "FDDC", "RDDC")]
        factors = [len(variable.terms) for variable in self.ddcfc.inputs.values()]
        flat = [len(self.vfc.inputs["theta_tar"].terms), *factors * len(directions)]
        first, second = len(self.ddcfc.rules), len(self.vfc.rules)
        return [
            ("DDCFC", len(factors), first),
            ("VFC", len(self.vfc.inputs), second),
            ("dual layer, DDCFC in each direction", len(flat), first * len(directions) + second),
            ("one layer", len(flat), math.prod(flat)),
        ]


@remembered
def _layers(
    rules: Variant, speed_max_mps: float, turn_max_radps: float, sets: Mapping[str, Any]
) -> tuple[FuzzySets, FuzzyInference, FuzzyInference]:
    """Return the checked sets, DDCFC and VFC for the parameters of ``DualLayer``."""
    checked = describe(FuzzySets, sets, "sets")
    ddcfc = danger_controller(checked.eta_d_peaks, checked.eta_t_peaks, checked.danger_peaks)
    return checked, ddcfc, velocity_controller(checked, rule_base(rules), speed_max_mps, turn_max_radps)


def _columns(names: Sequence[str], rows: Sequence[Sequence[Any]]) -> dict[str, list[Any]]:
    return {name: [row[i] for row in rows] for i, name in enumerate(names)}
