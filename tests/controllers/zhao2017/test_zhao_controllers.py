import copy
import functools
import math
import pickle
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from navbench.cli.composing import composing
from navbench.cli.configuration import compose_cell
from navbench.contract import Body, Command, Controller, Observation, Pose, RangeSensor, Setup
from navbench.controllers.zhao2017 import decisions as zhao2017
from navbench.controllers.zhao2017.decisions import AHEAD, ASTERN, LEFT, NO_SENSOR, NO_SITUATION, RIGHT, SENSOR_ROLES
from navbench.controllers.zhao2017.oa_to import R_SHOWN_MAX_S, OaTo
from navbench.controllers.zhao2017.sets import DANGERS, DIRECTIONS, DISTANCES, SPEEDS, TURNS, UNIVERSES
from navbench.controllers.zhao2018.genes import MEMBERSHIP_GENES, RULE_GENES, Repair
from navbench.fuzzy.inference import memberships
from navbench.mathematics.kinematics import body_speed

ANGLES_DEG = [0, 22.5, -22.5, 45, -45, 67.5, -67.5, 90, -90, 112.5, -112.5, 135, -135, 157.5, -157.5, 180]
RANGE_M = 30.0
PERIOD_S = 0.1
RADIUS_M, TRACK_M, LIMIT_MPS = 4.0, 7.0, 4.0
MIRRORED = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 15]
SETUP = Setup(
    Body(RADIUS_M, TRACK_M, LIMIT_MPS, 10.0),
    tuple(
        RangeSensor(
            role,
            RADIUS_M * math.cos(math.radians(degrees)),
            RADIUS_M * math.sin(math.radians(degrees)),
            math.radians(degrees),
            0.0,
            RANGE_M,
        )
        for role, degrees in zip(SENSOR_ROLES, ANGLES_DEG, strict=True)
    ),
    PERIOD_S,
)

# zhao2017, Table 1 as printed
OA_LEFT = """
    RB R  RF F  LF L  LB B
S   PB PB NB NB NS PB PB PS
M   PB PB NB NB PB PB PS PS
B   PB PB NS Z  PB PB PS PS
VB  PB PB PS PS PB PB PS PS
"""
OA_RIGHT = """
    RB R  RF F  LF L  LB B
S   PB PB NS NS NB PB PB PB
M   PS PB PB Z  NB PB PB PB
B   PS PB PB PB NS PB PB PB
VB  PS PB PB PB PS PB PB PB
"""
# zhao2017, Table 2 as printed
TO_LEFT = """
    NB NM NS Z  PS PM PB
VS  NB NB NS PS PS PB PB
S   NB NS Z  PB PB PB PB
M   NB NS Z  PB PB PB PB
B   NB NB NS PB PB PB PB
VB  NB NB NB PB PB PB PB
"""
TO_RIGHT = """
    NB NM NS Z  PS PM PB
VS  PB PB PS PS NS NB NB
S   PB PB PB PB Z  NS NB
M   PB PB PB PB Z  NS NB
B   PB PB PB PB NS NB NB
VB  PB PB PB PB PB NB NB
"""
# zhao2018, Table 3, with PB for RB and PS for RS, and its missing row from Table 1 above
EVOLVED_LEFT = """
    RB R  RF F  LF L  LB B
S   PB PS NB NB NS PS PS PS
M   PB PB NB NB PB PB PB NS
B   PB PB NS Z  PB PB PS PS
VB  PB PB PB PS PB PB PB PB
"""
EVOLVED_RIGHT = """
    RB R  RF F  LF L  LB B
S   PB PS NS NB NB PB PB PB
M   PS PB PB NB NB PB PB PB
B   PS PB PB PB NB PB NB NS
VB  PS PB PB PB PS PB PB PB
"""


def printed(table: str) -> dict[str, dict[str, str]]:
    head, *rows = (line.split() for line in table.strip().splitlines())
    return {name: dict(zip(head, cells, strict=True)) for name, *cells in rows}


def build(name: str = "oa_to") -> dict[str, Any]:
    """Return the parameters of a controller's YAML."""
    parameters: dict[str, Any] = copy.deepcopy(_controller(name)["build"])
    del parameters["_target_"]
    return parameters


@functools.cache
def _controller(name: str) -> dict[str, Any]:
    with composing() as composer:
        values: dict[str, Any] = composer.values("run", [f"controller={name}"]).values["controller"]
    return values


def make(name: str = "oa_to", **changes: Any) -> OaTo:
    """Return a controller with its YAML's parameters and these changes, after reset."""
    controller = OaTo(**(build(name) | changes))
    controller.reset(SETUP, np.random.default_rng(0))
    return controller


def see(
    ranges: dict[int, float] | None = None,
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    goal: tuple[float, float] = (50.0, 0.0),
) -> Observation:
    """Return an observation in which the sensors that are not numbered see nothing."""
    ranges_m = np.array([(ranges or {}).get(i, RANGE_M) for i in range(16)])
    return Observation(0.0, Pose(*pose), goal, 0.0, 0.0, ranges_m, False, np.empty((0, 5)))


def approach(sensor: int, distance_m: float, time_s: float, **others: float) -> tuple[Observation, Observation]:
    """Return two observations: a thing at one sensor that would hit in this time; others s1=.. stand still."""
    standing = {int(name[1:]): value for name, value in others.items()}
    return (
        see(standing | {sensor: distance_m * (1.0 + PERIOD_S / time_s)}),
        see(standing | {sensor: distance_m}),
    )


def drive(controller: OaTo, observations: Iterator[Observation] | Any) -> list[tuple[Command, dict[str, float]]]:
    return [(controller.act(observation), dict(controller.trace)) for observation in observations]


def last(controller: OaTo, observations: Any) -> tuple[Command, dict[str, float]]:
    return drive(controller, observations)[-1]


def wander(seed: int, steps: int = 150) -> Iterator[Observation]:
    """Yield what a robot might see that stumbles about among things on all sides."""
    rng = np.random.default_rng(seed)
    x, y, heading = rng.uniform(0.0, 100.0, 2).tolist() + [rng.uniform(-math.pi, math.pi)]
    ranges = rng.uniform(0.5, 35.0, 16)
    for _ in range(steps):
        x, y, heading = x + rng.uniform(-0.4, 0.4), y + rng.uniform(-0.4, 0.4), heading + rng.uniform(-0.1, 0.1)
        ranges = np.clip(ranges + rng.uniform(-1.5, 1.4, 16), 0.05, 35.0)
        pose = Pose(x, y, math.remainder(heading, math.tau))
        yield Observation(0.0, pose, (80.0, 40.0), 0.0, 0.0, np.minimum(ranges, RANGE_M), False, np.empty((0, 5)))


def mirrored(observation: Observation) -> Observation:
    x, y, heading = observation.pose
    goal_x, goal_y = observation.goal
    ranges = observation.ranges_m[MIRRORED]
    return observation._replace(pose=Pose(x, -y, -heading), goal=(goal_x, -goal_y), ranges_m=ranges)


# ---- equations 4 to 8 ----


def test_the_sensors_stand_as_the_paper_numbers_them() -> None:
    sensors = compose_cell("controller=oa_to").sensors
    assert tuple(mount.role for mount in sensors.mounts) == SENSOR_ROLES
    assert [math.degrees(mount.heading_rad) for mount in sensors.mounts] == pytest.approx(ANGLES_DEG)
    for mount in sensors.mounts:
        assert (mount.x_m, mount.y_m) == pytest.approx(
            (math.cos(mount.heading_rad), math.sin(mount.heading_rad)), abs=1e-6
        )
    assert sensors.max_range_m * RADIUS_M / sensors.drawn_for_radius_m == RANGE_M


def test_the_expected_time_of_collision_is_distance_over_approach_speed() -> None:
    assert zhao2017.approach_speed(10.4, 10.0, 0.1) == pytest.approx(4.0)
    assert zhao2017.danger_coefficient(10.0, 4.0) == 2.5
    assert zhao2017.danger_coefficient(0.0, 4.0) == 0.0


@pytest.mark.parametrize("speed", [0.0, -0.0, -4.0])
def test_what_does_not_approach_never_hits(speed: float) -> None:
    assert zhao2017.danger_coefficient(10.0, speed) == math.inf


def test_the_danger_is_the_least_time_and_not_the_least_distance() -> None:
    first = see({3: 2.1, 8: 11.0})
    second = see({3: 2.0, 8: 10.0})  # 2 s at s3, 1 s at s8
    _, trace = last(make(), [first, second])
    assert trace["R_s"] == pytest.approx(1.0)
    assert trace["danger_sensor"] == 8.0
    assert trace["Phi_rad"] == pytest.approx(-math.pi / 2)


@pytest.mark.parametrize("sensor", range(16))
def test_the_direction_is_that_of_the_sensor(sensor: int) -> None:
    _, trace = last(make(), approach(sensor, 5.0, 2.0))
    assert trace["R_s"] == pytest.approx(2.0)
    assert trace["Phi_rad"] == pytest.approx(math.radians(ANGLES_DEG[sensor]))


@pytest.mark.parametrize(
    "ranges",
    [
        [{}],  # nothing in sight
        [{0: 3.0}],  # the first reading of all
        [{}, {0: 3.0}],  # a new echo
        [{0: 3.0}, {}],  # a lost one
        [{0: 3.0}, {0: 3.0}],  # standing
        [{0: 3.0}, {0: 3.1}],  # going away
    ],
)
def test_without_an_approach_there_is_no_danger(ranges: list[dict[int, float]]) -> None:
    _, trace = last(make(), [see(one) for one in ranges])
    assert trace["R_s"] == R_SHOWN_MAX_S
    assert (trace["danger_sensor"], trace["Phi_rad"], trace["active_flc"]) == (float(NO_SENSOR), 0.0, 0.0)


# ---- equations 9 and 10, the special situations ----


@pytest.mark.parametrize(
    ("difference", "more", "less"),
    [
        (zhao2017.room_ahead, (1, 3), (2, 4)),  # eq. 9
        (zhao2017.room_right, (4, 6), (10, 12)),  # eq. 10
        (zhao2017.room_left, (3, 5), (9, 11)),
        (zhao2017.room_astern, (11, 13), (12, 14)),
    ],
)
def test_the_differences_of_room_are_those_of_equations_9_and_10(
    difference: Any, more: tuple[int, int], less: tuple[int, int]
) -> None:
    for sensor in range(16):
        reading = np.zeros(16)
        reading[sensor] = 6.0
        assert difference(reading) == (3.0 if sensor in more else -3.0 if sensor in less else 0.0)


def test_the_special_situations_are_the_papers_sensors() -> None:
    sets = {AHEAD: {0, 1, 2}, ASTERN: {13, 14, 15}, LEFT: {5, 7, 9}, RIGHT: {6, 8, 10}}
    for sensor in range(16):
        expected = next((name for name, sensors in sets.items() if sensor in sensors), NO_SITUATION)
        assert zhao2017.SITUATIONS[sensor] == expected
    assert (NO_SITUATION, AHEAD, RIGHT, LEFT, ASTERN) == (0, 1, 2, 3, 4)  # what the trace documents


WAYS = [  # sensor of the danger, a near thing elsewhere, situation, Phi, the way to go: turn, drive
    (0, "s4", AHEAD, -45, ("left", "")),
    (1, "s4", AHEAD, -45, ("left", "")),
    (2, "s3", AHEAD, 45, ("right", "")),
    (0, "s3", AHEAD, 45, ("right", "")),
    (8, "s12", RIGHT, -90, ("", "forward")),
    (6, "s12", RIGHT, -90, ("", "forward")),
    (8, "s4", RIGHT, 0, ("", "backward")),
    (10, "s4", RIGHT, 0, ("", "backward")),
    (7, "s11", LEFT, 90, ("", "forward")),
    (7, "s3", LEFT, 0, ("", "backward")),
    (5, "s3", LEFT, 0, ("", "backward")),
    (9, "s3", LEFT, 0, ("", "backward")),
    (15, "s12", ASTERN, 135, ("", "forward")),
    (13, "s12", ASTERN, 135, ("", "forward")),
    (15, "s11", ASTERN, -135, ("", "forward")),
    (14, "s11", ASTERN, -135, ("", "forward")),
]


@pytest.mark.parametrize(("sensor", "near", "situation", "phi_deg", "way"), WAYS)
def test_in_a_special_situation_it_goes_where_there_is_room(
    sensor: int, near: str, situation: int, phi_deg: float, way: tuple[str, str]
) -> None:
    command, trace = last(make(), approach(sensor, 5.0, 0.4, **{near: 1.0}))
    assert trace["special_situation"] == situation
    assert trace["Phi_rad"] == pytest.approx(math.radians(phi_deg))
    if way[0]:
        assert math.copysign(1.0, command.w_radps) == (1.0 if way[0] == "left" else -1.0)
    if way[1]:
        assert math.copysign(1.0, command.v_mps) == (1.0 if way[1] == "forward" else -1.0)


@pytest.mark.parametrize(("sensor", "phi_deg"), [(0, 45), (8, 0), (7, 0), (15, -135)])
def test_without_a_difference_it_does_not_go_where_a_positive_one_would_send_it(sensor: int, phi_deg: float) -> None:
    _, trace = last(make(), approach(sensor, 5.0, 0.4))
    assert trace["Phi_rad"] == pytest.approx(math.radians(phi_deg))


@pytest.mark.parametrize(("time_s", "situation"), [(0.99, AHEAD), (1.01, NO_SITUATION)])
def test_situations_are_special_below_medium_only(time_s: float, situation: int) -> None:
    _, trace = last(make(), approach(0, 5.0, time_s, s4=1.0))
    assert trace["special_situation"] == situation
    assert trace["Phi_rad"] == pytest.approx(0.0 if situation == NO_SITUATION else -math.pi / 4)


@pytest.mark.parametrize("sensor", [3, 4, 11, 12])
def test_a_danger_on_the_diagonals_is_never_special(sensor: int) -> None:
    _, trace = last(make(), approach(sensor, 5.0, 0.2))
    assert (trace["active_flc"], trace["special_situation"]) == (1.0, NO_SITUATION)


# ---- Table 3: which controller is active ----


@pytest.mark.parametrize(
    ("distance_m", "time_s", "near", "active"),
    [
        (11.9, 3.9, {}, 1.0),
        (12.1, 3.9, {}, 0.0),  # nothing is within D_safe
        (11.9, 4.1, {}, 0.0),  # nothing hits within T_safe
        (12.1, 3.9, {"s15": 11.9}, 1.0),  # D_safe asks for the nearest reading, whichever it is
    ],
)
def test_avoidance_needs_something_near_and_urgent(
    distance_m: float, time_s: float, near: dict[str, float], active: float
) -> None:
    controller = make()
    command, trace = last(controller, approach(3, distance_m, time_s, **near))
    assert trace["active_flc"] == active
    inference = controller.oa if active else controller.to
    values = ("R_s", "Phi_rad") if active else ("D_radii", "Psi_rad")
    shares = inference(*(trace[name] for name in values))
    expected = [min(max(1.2 * share, -1.0), 1.0) * LIMIT_MPS for share in shares]
    assert [trace["vL_mps"], trace["vR_mps"]] == pytest.approx(expected)
    assert command == body_speed(trace["vL_mps"], trace["vR_mps"], TRACK_M)


@pytest.mark.parametrize(("heading_deg", "psi_deg"), [(30, 30), (-30, -30), (180, 180), (-170, -170)])
def test_psi_is_the_heading_less_the_targets_direction(heading_deg: float, psi_deg: float) -> None:
    _, trace = last(make(), [see(pose=(10.0, 0.0, math.radians(heading_deg)))])
    assert trace["Psi_rad"] == pytest.approx(math.radians(psi_deg))
    assert trace["D_radii"] == pytest.approx(10.0)  # 40 m, radius 4 m


def test_psi_is_wrapped() -> None:
    _, trace = last(make(), [see(pose=(0.0, 0.0, 3.0), goal=(10.0 * math.cos(-3.0), 10.0 * math.sin(-3.0)))])
    assert trace["Psi_rad"] == pytest.approx(6.0 - math.tau)


def test_at_the_target_itself_everything_stays_finite() -> None:
    command, trace = last(make(), [see(pose=(50.0, 0.0, 0.4))])
    assert (trace["D_radii"], trace["Psi_rad"]) == (0.0, 0.4)
    assert all(map(math.isfinite, command))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("degrees", [30, 60, 90, 135, 170])
def test_it_turns_towards_the_target(degrees: float, side: float) -> None:
    command = make().act(see(pose=(0.0, 0.0, -side * math.radians(degrees)), goal=(10.0, 0.0)))
    assert side * command.w_radps > 0.05


def test_towards_a_far_target_straight_ahead_it_drives_at_the_limit() -> None:
    assert make().act(see(goal=(96.0, 0.0))).v_mps == pytest.approx(LIMIT_MPS, rel=1e-3)
    assert make().act(see(goal=(96.0, 0.0))).v_mps <= LIMIT_MPS


def test_the_setup_gives_radius_track_and_limit() -> None:
    controller = make()
    controller.reset(SETUP._replace(robot=Body(2.0, 3.0, 1.0, None)), np.random.default_rng(0))
    command, trace = last(controller, [see(pose=(0.0, 0.0, 0.5))])
    assert trace["D_radii"] == 25.0
    assert command == body_speed(trace["vL_mps"], trace["vR_mps"], 3.0)
    assert max(abs(trace["vL_mps"]), abs(trace["vR_mps"])) <= 1.0


# ---- Tables 1 and 2 ----

TABLES = [
    ("oa_to", "oa_rules", OA_LEFT, OA_RIGHT, DANGERS, DIRECTIONS),
    ("oa_to", "to_rules", TO_LEFT, TO_RIGHT, DISTANCES, TURNS),
    ("oa_to_printed", "oa_rules", EVOLVED_LEFT, EVOLVED_RIGHT, DANGERS, DIRECTIONS),
    ("oa_to_printed", "to_rules", TO_LEFT, TO_RIGHT, DISTANCES, TURNS),
]


@pytest.mark.parametrize(("name", "rules", "left", "right", "rows", "columns"), TABLES)
def test_every_cell_of_the_tables_is_as_printed(
    name: str, rules: str, left: str, right: str, rows: tuple[str, ...], columns: tuple[str, ...]
) -> None:
    tables = build(name)[rules]
    for wheel, table in (("vL", printed(left)), ("vR", printed(right))):
        assert tables[wheel] == table
        assert set(table) == set(rows)
        assert all(set(row) == set(columns) for row in table.values())


@pytest.mark.parametrize(("name", "rules", "left", "right", "rows", "columns"), TABLES)
def test_at_two_peaks_one_cell_alone_decides(
    name: str, rules: str, left: str, right: str, rows: tuple[str, ...], columns: tuple[str, ...]
) -> None:
    controller = make(name)
    inference = controller.oa if rules == "oa_rules" else controller.to
    (first, second) = inference.inputs.values()
    centroid = {"NB": -5 / 6, "NS": -0.5, "Z": 0.0, "PS": 0.5, "PB": 5 / 6}
    for row in rows:
        for column in columns:
            at = (peak(first.terms[row]), peak(second.terms[column]))
            expected = (centroid[printed(left)[row][column]], centroid[printed(right)[row][column]])
            assert inference(*at) == pytest.approx(expected, abs=1e-3)
            assert sorted(inference.strengths(*at))[-2:] == pytest.approx([0.0, 1.0], abs=1e-12)


def peak(term: Any) -> float:
    """Return a place where a set is 1 and no other one is above 0: the end of its top that looks inwards or its tip."""
    _, b, c, _ = term.corners
    return float(c if abs(c) < abs(b) or b == 0.0 else b)


# Where the mirror image of a cell is another one: in Table 1 the columns F and B, which turn left by design; in Table 2
# one cell, and with it its image.
ASYMMETRIC_OA = {(row, "F") for row in DANGERS} | {(row, "B") for row in DANGERS}
ASYMMETRIC_TO = {("VB", "NS"), ("VB", "PS")}
SIDE_OF_PHI = dict(zip(DIRECTIONS, ("LB", "L", "LF", "F", "RF", "R", "RB", "B"), strict=True))
SIDE_OF_PSI = dict(zip(TURNS, reversed(TURNS), strict=True))


def asymmetric(rules: dict[str, Any], mirror: dict[str, str]) -> set[tuple[str, str]]:
    left, right = rules["vL"], rules["vR"]
    return {
        (row, column)
        for row in left
        for column in left[row]
        if left[row][column] != right[row][mirror[column]] or right[row][column] != left[row][mirror[column]]
    }


def test_the_printed_tables_are_symmetric_but_for_the_listed_cells() -> None:
    assert asymmetric(build()["oa_rules"], SIDE_OF_PHI) == ASYMMETRIC_OA
    assert asymmetric(build()["to_rules"], SIDE_OF_PSI) == ASYMMETRIC_TO


def symmetric_rules() -> dict[str, Any]:
    """Return the rules with the listed cells made symmetric."""
    parameters = build()
    for row, column in ASYMMETRIC_OA:
        for wheel in ("vL", "vR"):
            parameters["oa_rules"][wheel][row][column] = "NS"
    parameters["to_rules"]["vR"]["VB"]["PS"] = "NB"
    return {name: parameters[name] for name in ("oa_rules", "to_rules")}


@pytest.mark.parametrize("seed", range(8))
def test_a_mirrored_observation_gets_the_mirrored_command_but_for_the_listed_cells(seed: int) -> None:
    # One more asymmetry is the first of equally great dangers and equal rooms; random readings never are equal.
    rules = symmetric_rules()
    one, other = make(**rules), make(**rules)
    for observation in wander(seed):
        command, reflected = one.act(observation), other.act(mirrored(observation))
        assert reflected == pytest.approx(Command(command.v_mps, -command.w_radps), abs=1e-9)


def test_wandering_visits_both_controllers_and_every_situation() -> None:
    traces = [trace for seed in range(8) for _, trace in drive(make(), wander(seed))]
    visited = {(trace["active_flc"], trace["special_situation"]) for trace in traces}
    assert visited == {(0.0, 0.0), *((1.0, float(situation)) for situation in range(5))}


# ---- the fuzzy sets ----


@pytest.mark.parametrize("name", ["R_s", "Phi_rad", "vL", "vR", "D_radii", "Psi_rad"])
def test_the_un_evolved_sets_add_up_to_one_everywhere(name: str) -> None:
    controller = make()
    variable = {**controller.oa.inputs, **controller.oa.outputs, **controller.to.inputs}[name]
    degrees = memberships(variable, np.linspace(variable.low, variable.high, 400))
    assert degrees.sum(axis=0) == pytest.approx(np.ones(400))


def test_back_goes_on_across_the_seam_of_the_circle() -> None:
    phi = make().oa.inputs["Phi_rad"]
    for degrees, back, right_back, left_back in (
        (180, 1.0, 0.0, 0.0),
        (-160, 5 / 9, 4 / 9, 0.0),
        (160, 5 / 9, 0, 4 / 9),
    ):
        at = dict(zip(phi.terms, memberships(phi, math.radians(degrees))[:, 0], strict=True))
        assert (at["B"], at["RB"], at["LB"]) == pytest.approx((back, right_back, left_back))


def test_a_moved_peak_at_the_seam_moves_the_foot_of_its_neighbour() -> None:
    sets = build()["oa_memberships"]
    sets["Phi_rad"]["B"]["c"] = math.radians(170)
    sets["Phi_rad"]["RB"]["c"] = math.radians(-140)
    terms = make(oa_memberships=sets).oa.inputs["Phi_rad"].terms
    assert terms["RB"].points == pytest.approx(np.radians([-190, -140, -90]))
    assert terms["B"].points == pytest.approx(np.radians([135, 170, 220]))


def test_target_orientation_keeps_its_sets_when_avoidance_is_evolved() -> None:
    sets = build()["oa_memberships"]
    sets["vL"]["PS"]["c"] = 0.7
    evolved = make(oa_memberships=sets)
    assert evolved.oa.outputs["vL"] != make().oa.outputs["vL"]
    assert evolved.to.outputs == make().to.outputs


# ---- the edges of the inputs, and the contract ----


@pytest.mark.parametrize("before", [0.0, 1e-9, 5.0, RANGE_M])
@pytest.mark.parametrize("after", [0.0, 1e-9, 5.0, RANGE_M])
def test_any_readings_get_a_finite_command_within_the_wheels_limit(before: float, after: float) -> None:
    for command, trace in drive(make(), [see(dict.fromkeys(range(16), value)) for value in (before, after)]):
        assert all(map(math.isfinite, (*command, *trace.values())))
        assert abs(command.v_mps) + 0.5 * TRACK_M * abs(command.w_radps) <= LIMIT_MPS * (1.0 + 1e-12)


@pytest.mark.parametrize("name", ["oa_to", "oa_to_printed"])
def test_it_keeps_the_contract(name: str) -> None:
    assert isinstance(make(name), Controller)


def test_the_trace_has_the_same_finite_numbers_at_every_step() -> None:
    traces = [trace for _, trace in drive(make(), wander(6))]
    assert {tuple(trace) for trace in traces} == {
        ("R_s", "Phi_rad", "danger_sensor", "active_flc", "special_situation", "D_radii", "Psi_rad", "vL_mps", "vR_mps")
    }
    assert all(type(value) is float and math.isfinite(value) for trace in traces for value in trace.values())


def test_reset_forgets_the_last_episode() -> None:
    controller = make()
    first = drive(controller, wander(1))
    controller.reset(SETUP, np.random.default_rng(5))
    assert drive(controller, wander(1)) == first


def test_a_pickled_controller_goes_on_where_it_was() -> None:
    original = make()
    drive(original, wander(3, steps=60))
    resumed = pickle.loads(pickle.dumps(original))
    assert drive(resumed, wander(4)) == drive(original, wander(4))


def test_an_observation_that_its_owner_writes_into_again_does_no_harm() -> None:
    controller, reused = make(), make()
    first, second = approach(0, 5.0, 2.0)
    expected = last(controller, [first, second])
    reused.act(first)
    first.ranges_m[:] = second.ranges_m
    assert (reused.act(first), reused.trace) == expected


def test_another_ring_of_sensors_is_refused() -> None:
    for sensors in ((), SETUP.sensors[::-1], SETUP.sensors[:-1]):
        with pytest.raises(ValueError, match="needed are ahead, left_23"):
            make().reset(SETUP._replace(sensors=sensors), np.random.default_rng(0))


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ("navigation.safe_distance_m", 0.0, r"navigation\.safe_distance_m=0\.0"),
        ("navigation.safe_time_s", math.inf, r"navigation\.safe_time_s"),
        ("navigation.medium_time_s", "1.0", r"navigation\.medium_time_s"),
        ("navigation.output_gian", 1.2, r"navigation\.output_gian: unknown key"),
        ("special_phi_rad.ahead_turn_left", math.nan, r"special_phi_rad\.ahead_turn_left"),
        ("oa_memberships.R_s.M.l", 1.5, r"oa_memberships\.R_s\.M: needs l < c < r, not 1\.5, 1\.0, 2\.0"),
        ("oa_memberships.R_s.VB.c", 6.5, r"oa_memberships\.R_s: the peaks must lie from 0\.0 to 6\.0"),
        ("oa_memberships.R_s.S.l", 0.1, r"oa_memberships\.R_s\.S\.l: unknown key"),
        ("oa_memberships.Phi_rad.RB.c", -4.0, r"oa_memberships\.Phi_rad: the peaks must lie"),
        ("oa_memberships.Phi_rad.RB.c", -math.pi, r"oa_memberships\.Phi_rad: the first and the last peak"),
        ("oa_memberships.vL.NS.r", -0.6, r"oa_memberships\.vL\.NS: needs l < c < r"),
        ("oa_memberships.vR.PB.l", 1.0, r"oa_memberships\.vR\.PB: needs l < c"),
        ("oa_memberships.vR.NB.r", -1.0, r"oa_memberships\.vR\.NB: needs c < r"),
        ("oa_rules.vL.S.RB", "RB", r"oa_rules\.vL\.S\.RB='RB'"),
        ("oa_rules.vL.XB", {}, r"oa_rules: vL must have the rows S, M, B, VB"),
        ("to_rules.vR.VS.NX", "NB", r"to_rules: vR\.VS must have the columns NB, NM"),
        ("to_memberships.D_radii.S", 20.0, r"to_memberships: D_radii: the peaks must ascend"),
        ("to_memberships.v.PB", 1.1, r"to_memberships\.v: the peaks must lie"),
        ("to_memberships.Psi_rad.B", 3.0, r"to_memberships: Psi_rad must name the sets NB, NM"),
    ],
)
def test_a_wrong_parameter_is_named(place: str, value: Any, message: str) -> None:
    parameters = build()
    *path, key = place.split(".")
    functools.reduce(lambda inner, name: inner[name], path, parameters)[key] = value
    with pytest.raises(ValueError, match=message):
        OaTo(**parameters)


def test_two_peaks_in_the_wrong_order_are_refused() -> None:
    sets = build()["oa_memberships"]
    sets["R_s"]["M"] = {"l": 0.5, "c": 3.0, "r": 3.5}
    with pytest.raises(ValueError, match=r"oa_memberships\.R_s: the peaks must ascend from S to VB"):
        make(oa_memberships=sets)


def test_it_describes_its_sets_and_tables_as_columns() -> None:
    tables = make().describe()
    assert set(tables) == {"memberships", "oa_rules", "to_rules"}
    for table in tables.values():
        assert len({len(column) for column in table.values()}) == 1
    rules = list(zip(*tables["oa_rules"].values(), strict=True))
    left, right = printed(OA_LEFT), printed(OA_RIGHT)
    assert rules == [(row, column, left[row][column], right[row][column]) for row in left for column in left[row]]
    assert len(tables["to_rules"]["vR"]) == 35
    sets = list(zip(*tables["memberships"].values(), strict=True))
    assert [one[2:] for one in sets if one[:2] == ("R_s", "VB")] == [(2.0, 0.0), (4.0, 1.0), (6.0, 1.0)]
    assert {one[0] for one in sets} == {"R_s", "Phi_rad", "vL", "vR", "D_radii", "Psi_rad", "v"}


# ---- the chromosome of zhao2018 ----


def gene(parameters: dict[str, Any], name: str) -> Any:
    return functools.reduce(lambda inner, key: inner[key], name.split("."), parameters)


def un_evolved() -> dict[str, float]:
    parameters = build()
    rules = {name: float(SPEEDS.index(gene(parameters, name))) for name in RULE_GENES}
    return {name: gene(parameters, name) for name in MEMBERSHIP_GENES} | rules


def evolved(genes: dict[str, float]) -> OaTo:
    """Return the controller that these genes draw."""
    parameters = build()
    for name, value in genes.items():
        *path, key = name.split(".")
        place = functools.reduce(lambda inner, word: inner[word], path, parameters)
        place[key] = SPEEDS[int(value)] if name in RULE_GENES else value
    return OaTo(**parameters)


def random_genes(rng: np.random.Generator) -> dict[str, float]:
    """Return genes anywhere within their bounds, every fourth time crowded at one place or on the bounds."""
    kind = rng.integers(8)
    genes: dict[str, float] = {}
    for name in MEMBERSHIP_GENES:
        low, high, _ = UNIVERSES[name.split(".")[1]]
        value = rng.uniform(low, high)
        if kind == 0:
            value = low + 0.5 * (high - low) * (1.0 + 1e-4 * rng.standard_normal())
        elif kind == 1:
            value = rng.choice([low, high])
        genes[name] = float(np.clip(value, low, high))
    return genes | {name: float(rng.uniform(-0.7, 4.7)) for name in RULE_GENES}


def leaves(value: Any, path: str) -> list[str]:
    if isinstance(value, dict):
        return [leaf for key, inner in value.items() for leaf in leaves(inner, f"{path}.{key}")]
    return [path]


def test_there_are_58_numbers_and_64_rules_to_evolve() -> None:
    counts = [sum(name.split(".")[1] == variable for name in MEMBERSHIP_GENES) for variable in UNIVERSES]
    assert counts == [10, 22, 13, 13]
    assert (len(set(MEMBERSHIP_GENES)), len(set(RULE_GENES))) == (58, 64)


def test_the_genes_are_the_leaves_of_the_parameters_that_may_be_tuned() -> None:
    parameters = build()
    assert tuple(leaves(parameters["oa_memberships"], "oa_memberships")) == MEMBERSHIP_GENES
    assert set(leaves(parameters["oa_rules"], "oa_rules")) == set(RULE_GENES)
    tunable = _controller("oa_to")["tunable"]
    for name in (*MEMBERSHIP_GENES, *RULE_GENES):
        assert sum(name.startswith(f"{key}.") for key in tunable) == 1, name


def test_the_bounds_are_those_that_the_repair_knows() -> None:
    tunable = _controller("oa_to")["tunable"]
    assert tuple(tunable["oa_rules"]["choices"]) == SPEEDS
    for variable, universe in UNIVERSES.items():
        bounds = tunable[f"oa_memberships.{variable}"]
        assert (bounds["low"], bounds["high"], bounds["scale"]) == (universe.low, universe.high, "linear")


def test_the_controller_names_its_repair() -> None:
    target = _controller("oa_to")["repair"]["_target_"]
    assert target == f"{Repair.__module__}.{Repair.__qualname__}"


def test_the_un_evolved_chromosome_passes_to_the_last_bit() -> None:
    genes = un_evolved()
    assert {name: value.hex() for name, value in genes.items()} == {
        name: float(value).hex() for name, value in Repair()(genes).items()
    }


@pytest.mark.parametrize("seed", range(20))
def test_any_mended_chromosome_makes_a_controller_without_gaps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    repair = Repair()
    for trial in range(200):
        mended = repair(random_genes(rng))
        assert list(mended) == [*MEMBERSHIP_GENES, *RULE_GENES]
        assert {name: float(v).hex() for name, v in repair(mended).items()} == {
            name: float(v).hex() for name, v in mended.items()
        }
        for variable, (low, high, circular) in UNIVERSES.items():
            check_sets(variable, mended, low, high, circular)
        assert all(mended[name] in range(5) for name in RULE_GENES)
        if trial % 20 == 0:
            check_fires(evolved(mended))


def check_sets(variable: str, genes: dict[str, float], low: float, high: float, circular: bool) -> None:
    """Check what a repair promises, set by set."""
    names = DANGERS if variable == "R_s" else DIRECTIONS if circular else SPEEDS
    corner = {
        (name, side): genes.get(f"oa_memberships.{variable}.{name}.{side}")
        for name in names
        for side in ("l", "c", "r")
    }
    peaks = [corner[name, "c"] for name in names]
    assert all(low <= p <= high for p in peaks if p is not None)
    gap = 0.01 * (high - low) * (1.0 - 1e-6)
    beyond = [low, low, *peaks, high, high]
    for i, name in enumerate(names):
        left, at, right = corner[name, "l"], corner[name, "c"], corner[name, "r"]
        assert at is not None
        if left is not None:
            assert low <= left <= at - gap
            assert left >= beyond[i]  # type: ignore[operator]
            foot, before = corner[names[i - 1], "r"], peaks[i - 1]
            assert foot is not None
            assert before is not None
            assert at - before >= gap
            assert foot - left >= 0.5 * gap
        if right is not None:
            assert at + gap <= right <= high
            assert right <= beyond[i + 4]  # type: ignore[operator]
    if circular:
        assert peaks[0] + (high - low) - peaks[-1] >= gap  # type: ignore[operator]


def check_fires(controller: OaTo) -> None:
    """Check that some rule fires wherever R and Phi may lie."""
    for variable in (*controller.oa.inputs.values(), *controller.oa.outputs.values()):
        degrees = memberships(variable, np.linspace(variable.low, variable.high, 500))
        assert degrees.max(axis=0).min() > 0.0


def test_a_mutation_that_breaks_one_set_leaves_the_others_alone() -> None:
    genes = un_evolved()
    genes["oa_memberships.R_s.M.l"] = 1.5  # beyond its peak at 1.0
    mended = Repair()(genes)
    assert mended.pop("oa_memberships.R_s.M.l") == pytest.approx(1.0 - 0.06)
    del genes["oa_memberships.R_s.M.l"]
    # S must still overlap M: its right foot, which stood at 1.0, does
    assert mended == genes


def test_peaks_are_sorted_and_feet_reach_no_further_than_two_peaks() -> None:
    genes = un_evolved()
    genes["oa_memberships.vL.NS.c"], genes["oa_memberships.vL.PS.c"] = 0.4, -0.4
    genes["oa_memberships.vL.NB.r"] = 0.9
    mended = Repair()(genes)
    assert [mended[f"oa_memberships.vL.{name}.c"] for name in SPEEDS] == [-1.0, -0.4, 0.0, 0.4, 1.0]
    assert mended["oa_memberships.vL.NB.r"] == 0.0


def test_neighbours_that_left_a_gap_are_drawn_together() -> None:
    genes = un_evolved()
    genes["oa_memberships.R_s.B.r"], genes["oa_memberships.R_s.VB.l"] = 2.5, 3.5
    mended = Repair()(genes)
    assert mended["oa_memberships.R_s.B.r"] == pytest.approx(3.0 + 0.015)
    assert mended["oa_memberships.R_s.VB.l"] == pytest.approx(3.0 - 0.015)


@pytest.mark.parametrize(("given", "mended"), [(-0.6, 0), (0.4, 0), (0.6, 1), (3.7, 4), (4.6, 4), (9.0, 4)])
def test_rules_are_rounded_and_clipped(given: float, mended: int) -> None:
    result = Repair()({"oa_rules.vR.VB.LF": given})
    assert result == {"oa_rules.vR.VB.LF": mended}
    assert type(result["oa_rules.vR.VB.LF"]) is int


def test_a_chromosome_that_cannot_be_mended_is_refused() -> None:
    with pytest.raises(ValueError, match=r"oa_memberships\.R_s\.S\.l: is no gene"):
        Repair()({"oa_memberships.R_s.S.l": 0.0})
    with pytest.raises(ValueError, match=r"oa_memberships\.R_s\.S\.r: missing"):
        Repair()({"oa_memberships.R_s.S.c": 0.0})


def test_a_goal_that_is_no_number_gets_no_command() -> None:
    assert all(map(math.isnan, make().act(see(goal=(math.nan, 0.0)))))
