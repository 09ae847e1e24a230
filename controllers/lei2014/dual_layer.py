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
from collections.abc import Mapping
from typing import Any

import numpy as np

from navbench.contract import FloatArray, Setup
from navbench.fuzzy.describing import Columns, columns, membership_corners
from navbench.fuzzy.inference import FuzzyInference, infer_and_fire
from navbench.policy import CompiledController, Policy, compiled, pack, part, scratch
from navbench.validation import Flag, Positive, checked, describe, remembered

from .danger import ASIDE, add_danger, azimuth, danger_controller, sector
from .hits import by_bearing, scan
from .rules import BEHAVIORS, Variant, rule_base, started, strongest_of_each
from .sets import FuzzySets, velocity_controller

OUTLINE, POINTS, OBSTACLES = range(3)  # parts of the state
MOUNTS, REACH, THRESHOLDS, BEHAVIOR, DDCFC, VFC = range(6)  # of the parameters
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
    """Return speed and turning rate for what is dangerous where, and for where the target is.

    A step of ``navbench.policy``; the state is the ring's last outline and room to work in, and NaN a goal's or an
    obstacle's.
    """
    thresholds, ddcfc, vfc = part(parameters, THRESHOLDS), part(parameters, DDCFC), part(parameters, VFC)
    outline, points = part(state, OUTLINE).reshape(-1, 4), part(state, POINTS).reshape(-1, 2)
    obstacles, behaviors = part(state, OBSTACLES).reshape(-1, 5), part(parameters, BEHAVIOR)
    mounts, reach_m = part(parameters, MOUNTS).reshape(-1, 6), part(parameters, REACH)[0]
    front_rad, side_rad, period_s = thresholds[3], thresholds[4], thresholds[1]
    hits = scan(mounts, ranges_m, pose, front_rad, side_rad, period_s, reach_m, outline, points, obstacles)
    situation, factors, fired = scratch((4,)), scratch((3,)), scratch((behaviors.size, 2))
    dangers, (x, y, psi) = situation[1:], pose
    dangers[:] = 0.0
    vx, vy = speed[0] * math.cos(psi), speed[0] * math.sin(psi)
    for k in range(hits):
        way, relative = (obstacles[k, 0] - x, obstacles[k, 1] - y), (obstacles[k, 2] - vx, obstacles[k, 3] - vy)
        add_danger(dangers, int(obstacles[k, 4]), ddcfc, thresholds, way, 0.0, relative, factors)
    for k in range(discs.shape[0]):
        way, relative = (discs[k, 0] - x, discs[k, 1] - y), (discs[k, 3] - vx, discs[k, 4] - vy)
        where = sector(azimuth(psi, math.atan2(way[1], way[0])), front_rad, side_rad)
        if where != ASIDE:
            add_danger(dangers, where, ddcfc, thresholds, way, discs[k, 2], relative, factors)
    situation[0] = azimuth(psi, math.atan2(goal[1] - y, goal[0] - x))
    trace[:3], trace[3] = dangers, situation[0]
    rules = infer_and_fire(vfc, situation, trace[8:], fired)
    if rules < 0:
        return math.nan, math.nan
    trace[4] = strongest_of_each(fired[:rules], behaviors, trace[5:8])
    return trace[8], -trace[9] if thresholds[6] > 0.0 else trace[9]  # psi' = -w, see lei2014


class DualLayer(CompiledController):
    """The two fuzzy controllers, one behind the other.

    Attributes:
        rules: the 81 rules of the second layer.
        ddcfc: the first layer: eta_d, eta_t to DDC.
        vfc: the second: theta_tar [rad], LDDC, FDDC, RDDC to v [m/s] and w, positive to the right [rad/s].
        trace_words: what the trace's values are called.
    """

    trace_words = {"behavior": ("move to goal", "avoid obstacle", "follow obstacle")}

    @checked("build")
    def __init__(
        self,
        *,
        rules: Variant,
        velocity_aware: Flag,
        w_turns_right: Flag,
        speed_max_mps: Positive,
        turn_max_radps: Positive,
        safety_distance_m: Positive,
        obstacle_speed_max_mps: Positive,
        sets: Mapping[str, Any],
    ) -> None:
        """Check the parameters and build both layers.

        Args:
            rules: "literal"; "safe" with guards against turning to the more dangerous side; or "symmetric", which gives
                the printed numbers of rules.
            velocity_aware: False: the danger degree knows of distances only, and eta_t counts as infinite.
            w_turns_right: whether psi' = -w, as eqs 1 and 9 have it; False: psi' = w, as eq. 2 prints.
            speed_max_mps: the largest speed [m/s].
            turn_max_radps: the largest turning rate to either side [rad/s].
            safety_distance_m: D_s [m].
            obstacle_speed_max_mps: what a hit would have had to exceed is new, and counts as standing still [m/s].
            sets: a value for each field of ``lei2014_sets.FuzzySets``.

        Raises:
            ValueError: a parameter is unknown, missing or out of range.
        """
        self._variant, self.rules = rules, rule_base(rules)
        checked_sets, self.ddcfc, self.vfc = _layers(rules, speed_max_mps, turn_max_radps, sets)
        self._obstacle_speed_max_mps = obstacle_speed_max_mps
        sectors = checked_sets.front_rad, checked_sets.side_rad
        last = checked_sets.eta_d_peaks["DB"], checked_sets.eta_t_peaks["TB"], checked_sets.danger_peaks["S"]
        self._thresholds = (safety_distance_m, *sectors, velocity_aware, w_turns_right, *last)

    def make_policy(self, setup: Setup) -> Policy:
        """Return the policy for a robot and its ring, with no scan remembered."""
        mounts, period_s = by_bearing(setup.sensors), setup.period_s
        thresholds = (setup.robot.radius_m, period_s, *self._thresholds)
        reach_m, behaviors = self._obstacle_speed_max_mps * period_s, [BEHAVIORS.index(r.behavior) for r in self.rules]
        room = [np.zeros(size) for size in (2 * len(mounts), 5 * len(mounts))]
        parameters = pack(mounts, reach_m, thresholds, behaviors, self.ddcfc.base, self.vfc.base)
        state = pack(np.full((len(mounts), 4), np.nan), *room)
        return Policy(step=step, state=state, parameters=parameters, trace_names=TRACE)

    def describe(self) -> dict[str, Columns]:
        """Return named tables for a report.

        ``memberships`` (Figs 3 and 5, a set by its corners), ``danger_rules`` (Table 1), ``rules``, ``behaviors`` (how
        many rules start each behaviour, conflict with another and are its own), ``danger`` (DDC
        over both factors) and ``complexity`` (how many rules there are, and would be in one layer).
        """
        eta_d, eta_t = (np.linspace(variable.low, variable.high, 49) for variable in self.ddcfc.inputs.values())
        ddc = self.ddcfc.surface(eta_d, eta_t)
        surface = [(d, t, ddc[i, j, 0]) for i, d in enumerate(eta_d) for j, t in enumerate(eta_t)]
        first = {**self.ddcfc.inputs, **self.ddcfc.outputs}
        return {
            "memberships": membership_corners({**first, **self.vfc.inputs, **self.vfc.outputs}),
            "danger_rules": columns(("eta_d", "eta_t", "DDC"), self.ddcfc.rules),
            "rules": columns(("theta_tar", "LDDC", "FDDC", "RDDC", "behavior", "v", "w"), self.rules),
            "behaviors": columns(("behavior", "started", "with_AO", "with_FO", "executed"), self._counts()),
            "danger": columns(("eta_d", "eta_t", "DDC"), [tuple(map(float, row)) for row in surface]),
            "complexity": columns(("structure", "inputs", "rules"), self._complexity()),
        }

    def _counts(self) -> list[tuple[str, int, int, int, int]]:
        """Return for each behaviour how many rules start it, how many start AO or FO too, and how many are its own."""
        starts = [set(started(self._variant, *rule[:4])) for rule in self.rules]
        own = [rule.behavior for rule in self.rules]
        rows = []
        for name in BEHAVIORS:
            others = [0 if name == o else sum({name, o} <= names for names in starts) for o in BEHAVIORS[1:]]
            rows.append((name, sum(name in names for names in starts), *others, own.count(name)))
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
