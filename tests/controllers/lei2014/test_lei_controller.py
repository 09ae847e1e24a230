import copy
import functools
import itertools
import math
from collections import Counter
from typing import Any

import numpy as np
import pytest

from navbench.cli.configuration import compose_cell
from navbench.contract import Body, Observation, Pose, RangeSensor, Setup
from navbench.controllers.lei2014 import danger as lei2014
from navbench.controllers.lei2014.danger import ASIDE, FRONT, LEFT, RIGHT
from navbench.controllers.lei2014.dual_layer import TRACE, DualLayer
from navbench.controllers.lei2014.hits import by_bearing, scan
from navbench.controllers.lei2014.rules import (
    AZIMUTHS,
    BEHAVIORS,
    STARTS,
    Rule,
    rule_base,
    started,
    starts_ao,
    starts_fo,
    starts_mg,
)

PERIOD_S, RADIUS_M, SAFETY_M, SPEED_MPS, TURN_RADPS = 2.0, 0.25, 0.3, 0.1, 0.6
FAR_M = 4.0
MIRROR = {"L": "R", "C": "C", "R": "L"}
# The completed table: behaviour.turn.speed over FDDC = S, M, B (blocks) and RDDC = S, M, B, a row for each theta_tar
# and LDDC. Where the guards of "safe" change a turn, the turn without them follows after a slash.
TABLE = """
L S  MG.NS.F     MG.NM.F     MG.NB.F     | AO.NM.S     AO.NM.S     AO.NM.VS    | AO.NB.VS    AO.NB.VS    AO.NB.Z
L M  FO.PM.S     FO.PM.S     FO.PS/PM.VS | FO.PM.S     FO.PM.S     FO.PS/PM.VS | FO.PB/PM.VS FO.PB/PM.VS FO.PS/PM.VS
L B  FO.PB.VS    FO.PB.VS    FO.PB.VS    | FO.PB.VS    FO.PB.VS    FO.PB.VS    | FO.PB.VS    FO.PB.VS    FO.PB.VS
C S  MG.Z.VF     MG.Z.F      MG.Z.F      | FO.NM.S     FO.NM.S     FO.NM.VS    | FO.NB.VS    FO.NB.VS    FO.NB.VS
C M  MG.Z.F      AO.Z.S      AO.NS/Z.VS  | FO.PM/NM.S  FO.NM.S     FO.NM.VS    | FO.PB/NB.VS FO.NB.VS    FO.NB.VS
C B  MG.Z.F      AO.PS/Z.VS  AO.Z.VS     | FO.PM/NM.VS FO.PM/NM.VS FO.NM.VS    | FO.PB/NB.VS FO.PB/NB.VS FO.NB.VS
R S  MG.PS.F     FO.NM.S     FO.NB.VS    | AO.PM.S     FO.NM.S     FO.NB.VS    | AO.PB.VS    FO.NB/NM.VS FO.NB.VS
R M  MG.PM.F     FO.NM.S     FO.NB.VS    | AO.PM.S     FO.NM.S     FO.NB.VS    | AO.PB.VS    FO.NB/NM.VS FO.NB.VS
R B  MG.PB.F     FO.NS/NM.VS FO.NB.VS    | AO.PM.VS    FO.NS/NM.VS FO.NB.VS    | AO.PB.Z     FO.NS/NM.VS FO.NB.VS
"""
STATES = list(itertools.product(AZIMUTHS, "SMB", "SMB", "SMB"))


def a_ring(degrees: list[float]) -> tuple[RangeSensor, ...]:
    """Return sensors on the rim that look outwards."""
    turns = [math.radians(angle) for angle in degrees]
    return tuple(
        RangeSensor(f"s{i}", RADIUS_M * math.cos(turn), RADIUS_M * math.sin(turn), turn, 0.0, FAR_M)
        for i, turn in enumerate(turns)
    )


BLIND = Setup(Body(RADIUS_M, 0.4, 0.22, None), (), PERIOD_S)
BEARINGS = [8.0 * k for k in range(-22, 23)]
RINGED = BLIND._replace(sensors=a_ring(BEARINGS))


@functools.cache
def _composed() -> dict[str, Any]:
    build: dict[str, Any] = compose_cell("controller=dual_layer", "world=lei_swap").configuration["controller"]["build"]
    return build


def make(setup: Setup = BLIND, sets: dict[str, Any] | None = None, **changes: Any) -> DualLayer:
    """Return the controller with its YAML's parameters and these changes, after reset."""
    parameters = copy.deepcopy(_composed())
    del parameters["_target_"]
    parameters["sets"].update(sets or {})
    controller = DualLayer(**(parameters | changes))
    controller.reset(setup, np.random.default_rng(0))
    return controller


def see(
    *discs: tuple[float, float, float, float, float],
    goal: tuple[float, float] = (10.0, 0.0),
    heading: float = 0.0,
    v: float = SPEED_MPS,
    ranges: list[float] | None = None,
) -> Observation:
    """Return what a robot at the origin sees."""
    seen, ranges_m = np.array(discs, dtype=float).reshape(-1, 5), np.array(ranges or [], dtype=float)
    return Observation(0.0, Pose(0.0, 0.0, heading), goal, v, 0.0, ranges_m, False, seen)


def at(degrees: float, away_m: float, radius_m: float = 0.25) -> tuple[float, float, float, float, float]:
    """Return a standing disc at a bearing, positive to the left, with this much between it and the robot."""
    distance_m = away_m + radius_m + RADIUS_M
    turn = math.radians(degrees)
    return distance_m * math.cos(turn), distance_m * math.sin(turn), radius_m, 0.0, 0.0


def dangers(controller: DualLayer, observation: Observation) -> tuple[float, ...]:
    controller.act(observation)
    return tuple(controller.trace[name] for name in ("lddc", "fddc", "rddc"))


def mirrored(state: tuple[str, ...]) -> tuple[str, ...]:
    theta, left, front, right = state
    return MIRROR[theta], right, front, left


def mirrored_turn(w: str) -> str:
    return w.translate(str.maketrans("NP", "PN"))


# ---- equations 5 to 10 ----


def test_the_collision_time_counts_from_hull_to_hull() -> None:
    free = lei2014.free_distance(2.0, 0.25, 0.5)
    assert free == pytest.approx(1.25)
    assert lei2014.collision_time(free, 0.5, True) == pytest.approx(2.5)


def test_overlapping_hulls_are_no_negative_distance() -> None:
    assert lei2014.free_distance(0.4, 0.25, 0.25) == 0.0
    assert lei2014.collision_time(0.0, 0.1, True) == 0.0


@pytest.mark.parametrize(("speed", "closing"), [(0.1, False), (0.0, True), (1e-7, True), (0.0, False)])
def test_what_does_not_come_nearer_never_collides(speed: float, closing: bool) -> None:
    assert lei2014.collision_time(1.0, speed, closing) == math.inf
    assert lei2014.collision_time(0.0, speed, closing) == math.inf


def test_the_factors_count_in_periods_and_in_safety_distances() -> None:
    assert lei2014.time_factor(5.0, PERIOD_S) == pytest.approx(2.5)
    assert lei2014.distance_factor(0.75, SAFETY_M) == pytest.approx(2.5)
    assert lei2014.time_factor(math.inf, PERIOD_S) == math.inf


@pytest.mark.parametrize(
    ("psi", "bearing", "theta"),
    [(0.0, 90.0, -90.0), (0.0, -90.0, 90.0), (170.0, -170.0, -20.0), (-170.0, 170.0, 20.0), (45.0, 45.0, 0.0)],
)
def test_an_azimuth_is_negative_on_the_left(psi: float, bearing: float, theta: float) -> None:
    assert math.degrees(lei2014.azimuth(math.radians(psi), math.radians(bearing))) == pytest.approx(theta)


@pytest.mark.parametrize(
    ("degrees", "where"),
    [
        (0.0, FRONT),
        (-30.0, FRONT),
        (30.0, FRONT),
        (-30.001, LEFT),
        (30.001, RIGHT),
        (-90.0, LEFT),
        (90.0, RIGHT),
        (-90.001, ASIDE),
        (90.001, ASIDE),
        (180.0, ASIDE),
    ],
)
def test_each_azimuth_lies_in_one_sector(degrees: float, where: int) -> None:
    assert lei2014.sector(math.radians(degrees), math.radians(30), math.radians(90)) == where


# ---- the first layer ----


def test_table_1_answers_at_the_peaks_of_its_sets() -> None:
    ddc = make().ddcfc
    printed = [[ddc(eta_d, eta_t)[0] for eta_t in (0.0, 3.0, 6.0)] for eta_d in (0.0, 2.0, 4.0)]
    assert printed == [[1.0, 1.0, 1.0], [1.0, 0.5, 0.5], [1.0, 0.5, 0.0]]


def test_far_away_in_space_and_time_there_is_no_danger_at_all() -> None:
    assert make().ddcfc(math.inf, math.inf) == (0.0,)


def test_the_danger_falls_with_time_and_distance_but_for_what_the_minimum_bends() -> None:
    ddc = make().ddcfc.surface(np.linspace(0.0, 5.0, 101), np.linspace(0.0, 7.0, 141))[:, :, 0]
    assert np.diff(ddc, axis=0).max() < 0.05
    assert np.diff(ddc, axis=1).max() < 0.05
    for axis in (0, 1):
        climbed = ddc - np.minimum.accumulate(ddc, axis=axis)
        assert climbed.max() < 0.05
    assert ddc.min() == 0.0
    assert ddc.max() == 1.0


@pytest.mark.parametrize(("degrees", "which"), [(60.0, 0), (0.0, 1), (-60.0, 2)])
def test_an_obstacle_endangers_its_own_sector_only(degrees: float, which: int) -> None:
    found = dangers(make(), see(at(degrees, 0.3)))
    assert found[which] > 0.7
    assert [danger for i, danger in enumerate(found) if i != which] == [0.0, 0.0]


def test_an_obstacle_behind_is_no_danger() -> None:
    assert dangers(make(), see(at(150.0, 0.05))) == (0.0, 0.0, 0.0)


def test_the_worst_obstacle_of_a_sector_counts() -> None:
    controller = make()
    far, near = dangers(controller, see(at(50.0, 1.0)))[0], dangers(controller, see(at(70.0, 0.4)))[0]
    assert 0.0 < far < near
    assert dangers(controller, see(at(50.0, 1.0), at(70.0, 0.4)))[0] == near
    assert dangers(controller, see(at(70.0, 0.4), at(50.0, 1.0)))[0] == near


def test_the_danger_is_that_of_eq_8() -> None:
    controller = make()
    coming = (2.0, 0.0, 0.25, -0.1, 0.0)  # 1.5 m away, closing at 0.1 + 0.1 m/s: 7.5 s
    assert dangers(controller, see(coming))[1] == controller.ddcfc(1.5 / SAFETY_M, 7.5 / PERIOD_S)[0]


def test_the_relative_velocity_counts_in_full_not_only_along_the_line_of_sight() -> None:
    controller = make()
    crossing = (1.0, 0.0, 0.25, 0.0, 0.2)  # eq. 5 takes the size of the relative velocity
    expected = controller.ddcfc(0.5 / SAFETY_M, 0.5 / math.hypot(0.1, 0.2) / PERIOD_S)[0]
    assert dangers(controller, see(crossing))[1] == expected


@pytest.mark.parametrize("smallest", [0.0, 0.1])
def test_the_danger_of_a_sector_is_the_largest_of_its_obstacles_near_and_far(smallest: float) -> None:
    controller = make(sets={"danger_peaks": {"S": smallest, "M": 0.5, "B": 1.0}})
    rng, beyond = np.random.default_rng(5), 0
    for _ in range(200):
        discs = [(*rng.uniform(-6.0, 6.0, 2), 0.25, *rng.uniform(-0.5, 0.5, 2)) for _ in range(3)]
        expected = [0.0, 0.0, 0.0]
        for x, y, radius_m, vx, vy in discs:
            where = lei2014.sector(-math.atan2(y, x), math.radians(30.0), math.radians(90.0))
            if where == ASIDE:
                continue
            free_m = max(math.hypot(x, y) - RADIUS_M - radius_m, 0.0)
            closing = x * (vx - SPEED_MPS) + y * vy < 0.0
            t_c = free_m / math.hypot(vx - SPEED_MPS, vy) if closing else math.inf
            found = controller.ddcfc(free_m / SAFETY_M, t_c / PERIOD_S)[0]
            expected[where] = max(expected[where], found)
            beyond += found == smallest
        assert dangers(controller, see(*discs)) == pytest.approx(tuple(expected), abs=1e-12)
    assert 50 < beyond < 400


def test_what_draws_away_or_keeps_pace_is_as_dangerous_as_its_distance_alone() -> None:
    controller = make()
    by_distance = controller.ddcfc(0.5 / SAFETY_M, math.inf)[0]
    for vx in (0.1, 0.3):
        assert dangers(controller, see((1.0, 0.0, 0.25, vx, 0.0)))[1] == by_distance
    assert dangers(controller, see((1.0, 0.0, 0.25, -0.1, 0.0)))[1] > by_distance


def test_without_velocity_awareness_motion_changes_nothing() -> None:
    aware, unaware = make(), make(velocity_aware=False)
    coming, standing = see((1.0, 0.0, 0.25, -0.3, 0.0)), see((1.0, 0.0, 0.25, 0.0, 0.0), v=0.0)
    assert dangers(unaware, coming) == dangers(unaware, standing) == dangers(aware, standing)
    assert dangers(aware, coming) > dangers(unaware, coming)


# ---- the rules ----


@pytest.mark.parametrize("variant", ["literal", "safe"])
def test_the_rules_cover_every_state_once(variant: Any) -> None:
    rules = rule_base(variant)
    assert [tuple(rule[:4]) for rule in rules] == STATES
    assert len(set(STATES)) == 81


@pytest.mark.parametrize("variant", ["literal", "safe"])
def test_each_behaviour_has_as_many_rules_as_rules_1_1_to_1_3_leave_it(variant: Any) -> None:
    assert Counter(rule.behavior for rule in rule_base(variant)) == {"FO": 54, "AO": 16, "MG": 11}


def test_so_many_rules_start_each_behaviour_and_so_many_conflict() -> None:
    assert [sum(starts(*state) for state in STATES) for starts in (starts_fo, starts_ao, starts_mg)] == [54, 48, 27]
    assert sum(starts_ao(*state) and starts_fo(*state) for state in STATES) == 32
    assert sum(starts_mg(*state) and starts_fo(*state) for state in STATES) == 12
    assert sum(starts_mg(*s) and starts_ao(*s) and not starts_fo(*s) for s in STATES) == 4


def test_a_rule_belongs_to_the_behaviour_with_priority_among_those_that_start() -> None:
    for rule in rule_base("literal"):
        assert STARTS[rule.behavior](*rule[:4])
        for above in BEHAVIORS[BEHAVIORS.index(rule.behavior) + 1 :]:
            assert not STARTS[above](*rule[:4])


def test_the_symmetric_rules_give_six_of_the_eight_printed_numbers() -> None:
    starts = [started("symmetric", *state) for state in STATES]
    own = Counter(rule.behavior for rule in rule_base("symmetric"))
    both = {pair: sum(set(pair) <= set(names) for names in starts) for pair in (("AO", "FO"), ("MG", "AO"))}
    assert [sum(name in names for names in starts) for name in ("FO", "AO")] == [44, 58]
    assert both == {("AO", "FO"): 28, ("MG", "AO"): 4}
    assert own == {"FO": 44, "AO": 30, "MG": 7}


def test_the_symmetric_rules_differ_from_the_literal_ones_with_the_target_ahead_only() -> None:
    pairs = list(zip(rule_base("literal"), rule_base("symmetric"), strict=True))
    assert {a.theta_tar for a, b in pairs if a != b} == {"C"}
    odd = [rule for rule in rule_base("symmetric") if rule.w != mirrored_turn(by_mirror(rule).w)]
    assert all(rule.lddc == rule.rddc and rule.fddc != "S" for rule in odd)


def by_mirror(rule: Rule) -> Rule:
    return next(other for other in rule_base("symmetric") if other[:4] == mirrored(rule[:4]))


def test_read_as_eq_2_prints_it_the_robot_turns_to_the_other_side() -> None:
    look = see(goal=(10.0, 10.0))
    assert make(w_turns_right=False).act(look).w_radps == -make().act(look).w_radps != 0.0


def test_moving_to_the_goal_has_as_many_turns_as_rule_2_2_names() -> None:
    turns = {
        theta: [r.w for r in rule_base("literal") if (r.behavior, r.theta_tar) == ("MG", theta)] for theta in "LCR"
    }
    assert turns == {"L": ["NS", "NM", "NB"], "C": ["Z"] * 5, "R": ["PS", "PM", "PB"]}


@pytest.mark.parametrize("variant", ["literal", "safe"])
def test_each_behaviour_drives_as_fast_as_rule_3_says(variant: Any) -> None:
    speeds = {name: {rule.v for rule in rule_base(variant) if rule.behavior == name} for name in BEHAVIORS}
    assert speeds == {"FO": {"S", "VS"}, "AO": {"S", "VS", "Z"}, "MG": {"VF", "F"}}


@pytest.mark.parametrize(("variant", "count"), [("literal", 18), ("safe", 6)])
def test_the_rules_are_mirror_images_but_for_the_left_turn_before_what_is_in_front(variant: Any, count: int) -> None:
    by_state: dict[tuple[str, ...], Rule] = {rule[:4]: rule for rule in rule_base(variant)}
    odd = []
    for state, rule in by_state.items():
        other = by_state[mirrored(state)]
        assert (rule.behavior, rule.v) == (other.behavior, other.v)
        if mirrored_turn(rule.w) != other.w:
            odd.append(state)
    assert len(odd) == count
    assert all(theta == "C" and front != "S" for theta, _, front, _ in odd)
    if variant == "safe":
        assert all(left == right for _, left, _, right in odd)


def test_the_guards_change_eighteen_turns_and_nothing_else() -> None:
    pairs = list(zip(rule_base("literal"), rule_base("safe"), strict=True))
    assert sum(a.w != b.w for a, b in pairs) == 18
    assert all(a[:-1] == b[:-1] for a, b in pairs)


def test_a_guarded_robot_never_turns_far_to_the_more_dangerous_side() -> None:
    for rule in rule_base("safe"):
        if rule.behavior != "MG":
            left, right = "SMB".index(rule.lddc), "SMB".index(rule.rddc)
            if rule.fddc == "S" or rule.behavior == "FO":
                assert not (rule.w in ("PM", "PB") and right > left), rule
                assert not (rule.w in ("NM", "NB") and left > right), rule


def completed_table(variant: str) -> list[tuple[str, ...]]:
    """Return the rules of ``TABLE``."""
    rules: list[tuple[str, ...]] = []
    for row in TABLE.strip().splitlines():
        theta, left, *cells = row.replace("|", " ").split()
        for (front, right), cell in zip(itertools.product("SMB", "SMB"), cells, strict=True):
            behavior, turns, v = cell.split(".")
            rules.append((theta, left, front, right, behavior, v, turns.split("/")[0 if variant == "safe" else -1]))
    return rules


@pytest.mark.parametrize("variant", ["literal", "safe"])
def test_every_rule_is_that_of_the_completed_table(variant: Any) -> None:
    assert [tuple(rule) for rule in rule_base(variant)] == completed_table(variant)


def test_no_rule_holds_the_robot_where_it_is() -> None:
    assert not [rule for rule in (*rule_base("literal"), *rule_base("safe")) if (rule.v, rule.w) == ("Z", "Z")]


# ---- what the two layers do together ----


def test_with_the_target_ahead_and_nothing_in_sight_it_drives_straight_at_full_speed() -> None:
    controller = make()
    assert controller.act(see()) == pytest.approx((SPEED_MPS, 0.0))
    assert controller.trace["behavior"] == BEHAVIORS.index("MG")


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_it_turns_to_a_target_aside(side: float) -> None:
    controller = make()
    v, w = controller.act(see(goal=(1.0, side)))
    assert w * side > 0.0
    assert controller.trace["theta_tar_rad"] == pytest.approx(-side * math.pi / 4)
    assert controller.trace["w_command_radps"] == -w
    assert v == pytest.approx(0.75 * SPEED_MPS * 0.75 + SPEED_MPS * 0.25)  # 45 degrees: three quarters R, one C


@pytest.mark.parametrize(("side", "w"), [(1.0, -0.4), (-1.0, 0.4)])
def test_it_turns_away_from_an_obstacle_between_it_and_a_target_aside(side: float, w: float) -> None:
    controller = make()
    command = controller.act(see(at(60.0 * side, 0.6), goal=(1.0, 1.7321 * side), v=0.0))
    assert command == pytest.approx((0.5 * SPEED_MPS, w), rel=1e-3)  # eta_d = 2: DDC is M and nothing else
    assert controller.trace["behavior"] == BEHAVIORS.index("FO")
    assert controller.trace["fo"] == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("rules", ["literal", "safe"])
def test_it_turns_left_before_what_stands_in_front(rules: str) -> None:
    assert make(rules=rules).act(see(at(0.0, 0.6), v=0.0)) == pytest.approx((0.5 * SPEED_MPS, 2 / 3 * TURN_RADPS))


@pytest.mark.parametrize(("rules", "w"), [("literal", 0.4), ("safe", -0.4)])
def test_before_what_stands_in_front_only_the_guards_look_to_the_side(rules: str, w: float) -> None:
    assert make(rules=rules).act(see(at(0.0, 0.6), at(60.0, 0.6), v=0.0)).w_radps == pytest.approx(w)


def test_it_drives_on_between_dangers_on_both_sides() -> None:
    controller = make()
    command = controller.act(see(at(60.0, 0.6), at(-60.0, 0.6), v=0.0))
    assert command == pytest.approx((0.5 * SPEED_MPS, 0.0))
    assert controller.trace["behavior"] == BEHAVIORS.index("AO")


def test_of_two_equally_strong_behaviours_the_trace_names_the_one_with_priority() -> None:
    controller = make(safety_distance_m=0.5)
    controller.act(see(at(0.0, 1.5), v=0.0))  # eta_d = 3: DDC is 0.25, half S and half M
    assert controller.trace["mg"] == controller.trace["fo"] == 0.5
    assert controller.trace["behavior"] == BEHAVIORS.index("FO")


@pytest.mark.parametrize("degrees", [90.0, 120.0, 179.0, -90.0, -150.0])
def test_a_target_behind_counts_as_one_at_the_side(degrees: float) -> None:
    turn = math.radians(degrees)
    command = make().act(see(goal=(math.cos(turn), math.sin(turn))))
    assert command == pytest.approx((0.75 * SPEED_MPS, math.copysign(0.2, degrees)), rel=1e-5)


def scatter(seed: int) -> Observation:
    """Return a random sight of discs and hits, none on the edge of a sector."""
    rng = np.random.default_rng(seed)
    discs = [
        (*at(float(angle), float(away), 0.2)[:3], *rng.uniform(-0.2, 0.2, 2).tolist())
        for angle, away in zip(rng.uniform(-120, 120, 4), rng.uniform(0.0, 2.0, 4), strict=True)
    ]
    ranges = rng.uniform(0.1, FAR_M, len(BEARINGS))
    ranges[rng.random(len(BEARINGS)) < 0.6] = FAR_M
    return see(*discs, goal=tuple(rng.uniform(-3.0, 3.0, 2)), ranges=ranges.tolist())


@pytest.mark.parametrize("variant", ["literal", "safe"])
def test_a_mirrored_sight_gives_a_mirrored_command_unless_an_odd_rule_fires(variant: Any) -> None:
    by_state: dict[tuple[str, ...], Rule] = {rule[:4]: rule for rule in rule_base(variant)}
    odd = [mirrored_turn(rule.w) != by_state[mirrored(state)].w for state, rule in by_state.items()]
    compared = 0
    for seed in range(300):
        here, there = make(RINGED, rules=variant), make(RINGED, rules=variant)
        look = scatter(seed)
        goal_x, goal_y = look.goal
        flipped = look._replace(
            goal=(goal_x, -goal_y), ranges_m=look.ranges_m[::-1].copy(), discs=look.discs * np.array([1, -1, 1, 1, -1])
        )
        command, other = here.act(look), there.act(flipped)
        assert here.trace["lddc"] == pytest.approx(there.trace["rddc"])
        inputs = [here.trace[name] for name in ("theta_tar_rad", "lddc", "fddc", "rddc")]
        if not here.vfc.strengths(*inputs)[odd].any():
            compared += 1
            assert command == pytest.approx((other.v_mps, -other.w_radps))
    assert compared > 60


def test_commands_stay_within_the_largest_speed_and_turning_rate() -> None:
    controller = make(RINGED)
    for seed in range(200):
        v, w = controller.act(scatter(seed))
        assert 0.0 <= v <= SPEED_MPS
        assert abs(w) <= TURN_RADPS
        assert tuple(controller.trace) == TRACE


# ---- the ring ----


class Ring:
    """A ring with its scan before, for ``scan``."""

    def __init__(self, sensors: tuple[RangeSensor, ...] = RINGED.sensors, side_rad: float = math.pi) -> None:
        self.mounts, self.side_rad, count = by_bearing(sensors), side_rad, len(sensors)
        self.outline, self.points = np.full((count, 4), np.nan), np.zeros((count, 2))

    def __call__(self, ranges_m: Any, pose: tuple[float, float, float]) -> Any:
        obstacles = np.zeros((len(self.mounts), 5))
        arrays = (self.outline, self.points, obstacles)
        hits = scan(self.mounts, ranges_m, pose, math.radians(30), self.side_rad, PERIOD_S, 0.22 * PERIOD_S, *arrays)
        return obstacles[:hits]


def hits_of(
    ranges: dict[float, float], pose: tuple[float, float, float] = (0.0, 0.0, 0.0), ring: Ring | None = None
) -> Any:
    return (ring or Ring())(np.array([ranges.get(angle, FAR_M) for angle in BEARINGS]), pose)


def wall_ranges(x_m: float, pose: tuple[float, float, float]) -> dict[float, float]:
    """Return what the ring reads before the wall at an x, which runs along y."""
    readings = {}
    for angle in BEARINGS:
        across = math.cos(math.radians(angle) + pose[2])
        if across > 0.2:
            reading = (x_m - pose[0]) / across - RADIUS_M
            if 0.0 < reading < FAR_M:
                readings[angle] = reading
    return readings


def test_no_hit_is_no_obstacle() -> None:
    assert hits_of({}).shape == (0, 5)
    assert dangers(make(RINGED), see(ranges=[FAR_M] * len(BEARINGS))) == (0.0, 0.0, 0.0)


def test_a_hit_aside_is_no_obstacle_but_part_of_the_outline() -> None:
    ring = Ring(side_rad=math.pi / 2)
    assert hits_of({112.0: 1.0}, ring=ring).shape == (0, 5)
    beside = (0.0, 0.0, math.radians(112.0))  # it has turned: the same point is now right ahead
    assert hits_of({0.0: 1.2}, beside, ring)[0, 2:4] == pytest.approx(
        0.1 * np.array([math.cos(beside[2]), math.sin(beside[2])])
    )


def test_a_hit_is_a_point_in_the_frame_of_the_pose() -> None:
    assert hits_of({0.0: 1.0}, (1.0, 2.0, math.pi / 2)) == pytest.approx(np.array([[1.0, 3.25, 0.0, 0.0, FRONT]]))


def test_a_point_before_the_robot_is_as_dangerous_as_its_distance() -> None:
    controller = make(RINGED)
    ranges = [0.9 if angle == 0.0 else FAR_M for angle in BEARINGS]
    expected = controller.ddcfc(0.9 / SAFETY_M, 0.9 / SPEED_MPS / PERIOD_S)[0]
    assert dangers(controller, see(ranges=ranges))[1] == pytest.approx(expected)


def test_a_wall_stands_still_however_the_robot_moves() -> None:
    ring = Ring()
    for pose in ((0.0, 0.0, 0.0), (0.2, 0.1, 0.9), (0.3, 0.0, -0.7), (0.3, -0.2, 0.1)):
        seen = hits_of(wall_ranges(2.0, pose), pose, ring)
        inner = np.abs(seen[:, 1]) < 1.5  # beyond the ends of what was seen before, a hit lies off the outline
        assert inner.sum() > 5
        assert seen[inner, 2:4] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("speed", [0.1, -0.1])
def test_a_wall_that_moves_is_as_fast_as_it_is(speed: float) -> None:
    ring = Ring()
    hits_of(wall_ranges(2.0, (0.0, 0.0, 0.0)), ring=ring)
    pose = (0.1, 0.0, 0.05)
    seen = hits_of(wall_ranges(2.0 + speed * PERIOD_S, pose), pose, ring)
    inner = np.abs(seen[:, 1]) < 1.5
    assert seen[inner, 2] == pytest.approx(speed)
    assert seen[inner, 3] == pytest.approx(0.0, abs=1e-12)


def test_what_appears_where_nothing_was_stands_still() -> None:
    ring = Ring()
    hits_of({0.0: 3.0}, ring=ring)
    assert hits_of({0.0: 2.5}, ring=ring)[0, 2:4].tolist() == [0.0, 0.0]  # 0.25 m/s: too fast to be the same
    assert hits_of({0.0: 2.1}, ring=ring)[0, 2] == pytest.approx(-0.2)
    hits_of({}, ring=ring)
    assert hits_of({0.0: 2.0}, ring=ring)[0, 2:4].tolist() == [0.0, 0.0]


def test_the_order_of_the_mounts_does_not_matter() -> None:
    shuffled = np.random.default_rng(1).permutation(len(BEARINGS))
    plain, other = Ring(), Ring(tuple(RINGED.sensors[i] for i in shuffled))
    for x_m in (2.0, 1.9):
        ranges = wall_ranges(x_m, (0.0, 0.0, 0.0))
        readings = np.array([ranges.get(angle, FAR_M) for angle in BEARINGS])
        found = plain(readings, (0.0, 0.0, 0.0)), other(readings[shuffled], (0.0, 0.0, 0.0))
        assert np.array_equal(*found)


def test_a_new_episode_remembers_no_scan() -> None:
    controller = make(RINGED)
    sights = [see(ranges=[away if abs(angle) < 20 else FAR_M for angle in BEARINGS]) for away in (1.0, 0.8)]
    controller.act(sights[0])
    controller.reset(RINGED, np.random.default_rng(0))
    assert dangers(controller, sights[1]) == dangers(make(RINGED), sights[1])


# ---- what it says of itself ----


def test_it_describes_its_sets_rules_and_sizes() -> None:
    tables = make().describe()
    assert set(tables) == {"memberships", "danger_rules", "rules", "behaviors", "danger", "complexity"}
    for name, table in tables.items():
        assert len({len(column) for column in table.values()}) == 1, name
    assert len(tables["rules"]["w"]) == 81
    assert set(tables["memberships"]["variable"]) == {
        "eta_d",
        "eta_t",
        "DDC",
        "theta_tar",
        "LDDC",
        "FDDC",
        "RDDC",
        "v",
        "w",
    }
    assert tables["behaviors"] == {
        "behavior": ["MG", "AO", "FO"],
        "started": [27, 48, 54],
        "with_AO": [4, 0, 32],
        "with_FO": [12, 32, 0],
        "executed": [11, 16, 54],
    }
    assert tables["complexity"]["rules"] == [9, 81, 108, 3**7]
    assert tables["complexity"]["inputs"] == [2, 4, 7, 7]


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        ("rules", "printed"),
        ("velocity_aware", 1),
        ("speed_max_mps", 0.0),
        ("turn_max_radps", math.nan),
        ("safety_distance_m", -0.3),
        ("obstacle_speed_max_mps", "fast"),
    ],
)
def test_a_wrong_parameter_is_named(parameter: str, value: Any) -> None:
    with pytest.raises(ValueError, match=parameter):
        make(**{parameter: value})


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        ("front_rad", 2.0),
        ("side_rad", 3.5),
        ("eta_d_peaks", {"DS": 0.0, "DM": 2.0}),
        ("eta_t_peaks", {"TS": 0.0, "TM": 6.0, "TB": 3.0}),
        ("danger_peaks", {"S": 0.0, "M": 0.5, "B": 1.5}),
        ("theta_tar_peaks_rad", {"L": -2.0, "C": 0.0, "R": 1.0}),
        ("speed_peaks", {"Z": -0.1, "VS": 0.25, "S": 0.5, "F": 0.75, "VF": 1.0}),
        ("turn_peaks", {"Z": 0.0}),
        ("fornt_rad", 0.5),
    ],
)
def test_a_wrong_set_is_named(parameter: str, value: Any) -> None:
    with pytest.raises(ValueError, match=f"sets.*{parameter}"):
        make(sets={parameter: value})


def test_an_obstacle_or_a_goal_that_is_no_number_gets_no_command() -> None:
    for look in (see(goal=(math.nan, 0.0)), see((math.nan, 0.0, 0.25, 0.0, 0.0))):
        assert all(map(math.isnan, make().act(look)))
