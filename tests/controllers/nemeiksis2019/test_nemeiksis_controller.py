import copy
import functools
import itertools
import math
import pickle
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from navbench.cli.configuration import compose_cell
from navbench.contract import Body, Command, Controller, Observation, Pose, RangeSensor, Setup
from navbench.controllers.nemeiksis2019 import blocks, switch
from navbench.controllers.nemeiksis2019.multi_agent import SENSOR_ROLES, TRACE, MultiAgent, deviation, wheel_speeds
from navbench.controllers.nemeiksis2019.switch import DESTINATION, LEFT, OBSTACLE, PATTERNS, RIGHT, WALL

FAR_M, SEEN_M = 1.0, 0.3  # a sensor that sees nothing, and one that sees something
V_MAX = 0.67
BSR_DEG = (30.0 * -105.0 + 15.0 * -80.0) / 45.0  # weight centre of (-120, -120, -90, -60): a rectangle, a triangle
SETUP = Setup(
    Body(0.15, 0.30, V_MAX, None), tuple(RangeSensor(role, 0.0, 0.0, 0.0, 0.0, FAR_M) for role in SENSOR_ROLES), 0.0255
)


@functools.cache
def _composed() -> dict[str, Any]:
    parameters: dict[str, Any] = compose_cell("controller=multi_agent").configuration["controller"]["build"]
    return {key: value for key, value in parameters.items() if key != "_target_"}


def make(changes: Mapping[str, Any] | None = None, **build: Any) -> MultiAgent:
    """Return the controller of the YAML after reset, with these changes of its switch unit and of its other keys."""
    parameters = copy.deepcopy(_composed())
    parameters["switch"].update(changes or {})
    controller = MultiAgent(**(parameters | build))
    controller.reset(SETUP, np.random.default_rng(0))
    return controller


def see(
    ranges: Mapping[int, float] | None = None,
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    goal: tuple[float, float] = (5.0, 0.0),
) -> Observation:
    """Return an observation in which the sensors that are not named see nothing."""
    readings = np.array([(ranges or {}).get(sensor, FAR_M) for sensor in range(1, 11)])
    return Observation(0.0, Pose(*pose), goal, 0.0, 0.0, readings, False, np.empty((0, 5)))


def mirrored(look: Observation) -> Observation:
    (x, y, heading), (goal_x, goal_y) = look.pose, look.goal
    readings = look.ranges_m[[switch.mirrored_sensor(sensor) - 1 for sensor in range(1, 11)]]
    return look._replace(pose=Pose(x, -y, -heading), goal=(goal_x, -goal_y), ranges_m=readings)


def anything(seed: int, count: int = 400) -> list[Observation]:
    """Return what ten sensors might read anywhere, often in the stretch in which the sets overlap."""
    rng = np.random.default_rng(seed)
    looks = []
    for _ in range(count):
        readings = np.where(rng.random(10) < 0.5, FAR_M, rng.uniform(0.0, 0.7, 10))
        pose, goal = Pose(*rng.uniform(-3.0, 3.0, 3).tolist()), (rng.uniform(-3.0, 3.0), rng.uniform(-3.0, 3.0))
        looks.append(Observation(0.0, pose, goal, 0.0, 0.0, readings, False, np.empty((0, 5))))
    return looks


# ---- Table 1 ----

MODES = {  # sensors 10, 1, 2, .. 9, by mode
    "destination": "0000000000 0100010000 0100000000 0000010000 1000001000 1000000000 0000001000",
    "wall": "1100000000 0000011000 1100011000 1100012000 2100011000 2200011000 1100022000",
    "obstacle": "0000000122 0000000212 0000000221 0000000112 0000000121 0000000211 0000000111 "
    "2212222222 2221222222 2222122222 2211222222 2212122222 2221122222 2211122222",
}


def test_the_switch_units_rows_are_the_printed_ones() -> None:
    printed = [(row, agent) for agent, rows in MODES.items() for row in rows.split()]
    assert [(row.replace(" ", ""), agent) for row, agent in switch.TABLE_1] == printed
    assert switch.COLUMNS == (10, 1, 2, 3, 4, 5, 6, 7, 8, 9)


def test_the_printed_rows_cover_917_patterns_without_a_conflict() -> None:
    named = [switch.printed_agents(pattern) for pattern in PATTERNS]
    assert max(map(len, named)) == 1
    counts = {agent: named.count(frozenset({agent})) for agent in MODES}
    assert counts == {"destination": 7, "wall": 7, "obstacle": 903}
    assert sum(counts.values()) == 917


def test_the_completion_agrees_with_the_rows_and_gives_the_rest_to_wall_and_destination() -> None:
    rest = []
    for pattern in PATTERNS:
        named = switch.printed_agents(pattern)
        assert named <= {switch.completed_agent(pattern)}
        rest += [] if named else [switch.completed_agent(pattern)]
    assert (len(rest), rest.count("wall"), rest.count("destination")) == (107, 49, 58)


def test_thirteen_rows_are_redundant_together() -> None:
    table = switch.describe_modes()
    redundant = [mode for mode, never in zip(table["mode"], table["redundant"], strict=True) if never]
    assert redundant == [8, 9, 10, 11, 12, 18, 19, 20, 21, 25, 26, 27, 28]
    still = [p for p in PATTERNS if set(switch.matching_modes(p)) - set(redundant)]
    assert len(still) == 917


def test_the_same_agent_drives_in_the_mirrored_pattern() -> None:
    assert [switch.mirrored_sensor(i) for i in range(1, 11)] == [5, 4, 3, 2, 1, 10, 9, 8, 7, 6]
    for pattern in PATTERNS:
        assert switch.mirrored(switch.mirrored(pattern)) == pattern
        assert switch.completed_agent(switch.mirrored(pattern)) == switch.completed_agent(pattern)
        there = {switch.printed_agents(p) for p in (pattern, switch.mirrored(pattern))}
        assert len(there) == 1


@pytest.mark.parametrize(
    ("sensors", "agent"),
    [
        ((), DESTINATION),
        ((1, 5), DESTINATION),
        ((10, 5), DESTINATION),  # uncovered: a diagonal of the flanks
        ((1, 10), WALL),
        ((5, 6, 8), WALL),  # uncovered: a whole flank and the rear
        ((1, 8), DESTINATION),  # uncovered: half a flank and the rear
        ((7, 8, 9), OBSTACLE),
        ((1, 10, 5, 6, 3, 8), OBSTACLE),
    ],
)
def test_what_sees_something_decides_who_drives(sensors: tuple[int, ...], agent: int) -> None:
    controller = make()
    controller.act(see(dict.fromkeys(sensors, SEEN_M)))
    assert controller.trace["agent"] == agent
    assert controller.trace["pattern"] == switch.pattern_of(sensors)
    assert set(switch.seeing(int(controller.trace["pattern"]))) == set(sensors)


@pytest.mark.parametrize("sensor", range(1, 11))
def test_a_sensor_sees_something_just_below_its_limit(sensor: int) -> None:
    limit_m = 0.50 if sensor in (1, 10, 5, 6) else 0.40
    controller = make()
    controller.act(see({sensor: limit_m}))
    assert controller.trace["pattern"] == 0.0
    controller.act(see({sensor: math.nextafter(limit_m, 0.0)}))
    assert controller.trace["pattern"] == switch.pattern_of([sensor])


@pytest.mark.parametrize(
    ("near", "side"),
    [
        ({1: 0.3, 10: 0.4}, LEFT),
        ({5: 0.3, 6: 0.4}, RIGHT),
        ({1: 0.3, 10: 0.4, 5: 0.45, 6: 0.24}, RIGHT),
        ({1: 0.3, 10: 0.4, 5: 0.45, 6: 0.26}, LEFT),
        ({1: 0.3, 10: 0.3, 5: 0.3, 6: 0.3}, LEFT),
        ({1: 0.45, 10: 0.45, 5: 0.1, 6: 0.55}, LEFT),  # half a flank is no wall, however near
        ({5: 0.1}, RIGHT),
    ],
)
def test_the_tracked_wall_is_the_one_that_both_sensors_of_a_side_see_or_the_nearer(
    near: dict[int, float], side: float
) -> None:
    controller = make()
    controller.act(see(near))
    assert controller.trace["side"] == side


# ---- what is not in the paper: fewer agents, leaving a wall, dwelling ----


@pytest.mark.parametrize(
    ("agents", "driving"),
    [
        (["destination", "obstacle", "wall"], (DESTINATION, OBSTACLE, WALL)),
        (["destination", "obstacle"], (DESTINATION, OBSTACLE, DESTINATION)),
        (["destination", "wall"], (DESTINATION, DESTINATION, WALL)),
        (["obstacle", "destination"], (DESTINATION, OBSTACLE, OBSTACLE)),
        (["wall"], (WALL, WALL, WALL)),
    ],
)
def test_the_first_agent_takes_the_patterns_of_those_left_out(agents: list[str], driving: tuple[int, ...]) -> None:
    controller = make({"agents": agents})
    for near, agent in zip(({}, {3: 0.3}, {1: 0.3, 10: 0.3}), driving, strict=True):
        controller.act(see(near))
        assert controller.trace["agent"] == agent


@pytest.mark.parametrize(
    ("degrees", "wall", "agent"),
    [
        (-5.1, (1, 10), DESTINATION),
        (-4.9, (1, 10), WALL),
        (5.1, (1, 10), WALL),
        (5.1, (5, 6), DESTINATION),
        (4.9, (5, 6), WALL),
    ],
)
def test_a_wall_is_left_only_for_a_goal_on_the_free_side(degrees: float, wall: tuple[int, ...], agent: int) -> None:
    look = see(dict.fromkeys(wall, SEEN_M), pose=(0.0, 0.0, -math.radians(degrees)))
    leaving, staying = make({"leave_wall_rad": math.radians(5.0)}), make()
    leaving.act(look)
    staying.act(look)
    assert (leaving.trace["agent"], staying.trace["agent"]) == (agent, WALL)


def test_a_dwell_ignores_requests_but_those_for_the_obstacle_agent() -> None:
    looks: dict[str, dict[int, float]] = {"D": {}, "W": {1: SEEN_M, 10: SEEN_M}, "O": {3: SEEN_M}}

    def drivers(controller: MultiAgent, asked: str) -> str:
        driving = ""
        for letter in asked:
            controller.act(see(looks[letter]))
            driving += "DOW"[int(controller.trace["agent"])]
        return driving

    assert drivers(make(), "DWDWDOD") == "DWDWDOD"
    assert drivers(make({"dwell_periods": 2}), "DWDDD") == "DWWWD"  # the first one is no change
    assert drivers(make({"dwell_periods": 2}), "DWDWDD") == "DWWWWD"  # requests count, not periods
    assert drivers(make({"dwell_periods": 2}), "DWODDD") == "DWOOOD"


# ---- Tables 2 to 5 ----

# Table 2, by d_s4, d_s2, d_s3; every other of its 64 cells is BSR.
BESIDE_BSR = {
    **dict.fromkeys(["MD MF MF", "MD MF F", "MD F MF", "MD F F"], "MSR"),
    **dict.fromkeys(["MF MF MD", "MF MF MF", "MF MF F", "MF F MD", "MF F MF"], "MSR"),
    **dict.fromkeys(["F MF MD", "F MF MF", "F MF F", "F F MD"], "MSR"),
    "MF F F": "SSR",
    "F F MF": "SSR",
    "F F F": "Z",
}


def test_table_2_is_the_printed_one() -> None:
    printed = {
        (d4, d2, d3): BESIDE_BSR.get(f"{d4} {d2} {d3}", "BSR")
        for d4, d2, d3 in itertools.product(blocks.DISTANCES, repeat=3)
    }
    rules = make().blocks.bypass.rules
    assert len(rules) == 64
    assert {rule[:3]: rule[3] for rule in rules} == printed
    assert list(make().blocks.bypass.inputs) == ["d_s4", "d_s2", "d_s3"]


def test_table_2_is_handed_in_five_pairs_of_cells_and_never_turns_left() -> None:
    turn = {rule[:3]: rule[3] for rule in make().blocks.bypass.rules}
    handed = {cell for cell in turn if turn[cell] != turn[cell[1], cell[0], cell[2]]}
    pairs = [("MD", "MF", "MF"), ("MD", "MF", "F"), ("MD", "F", "MF"), ("MD", "F", "F"), ("MF", "F", "F")]
    assert handed == {cell for a, b, c in pairs for cell in ((a, b, c), (b, a, c))}
    assert not {"SSL", "MSL", "BSL"} & set(turn.values())


@pytest.mark.parametrize(
    ("name", "inputs", "printed"),
    [
        ("track_right", ["d_s6", "d_s5"], "SSL SSR MSR MSR SSL Z SSR MSR MSL SSL SSR MSR MSL MSL Z MSR"),
        ("track_left", ["d_s10", "d_s1"], "SSR SSL MSL MSL SSR Z SSL MSL MSR SSR SSL MSL MSR MSR Z MSL"),
    ],
)
def test_table_3_is_the_printed_one(name: str, inputs: list[str], printed: str) -> None:
    block = getattr(make().blocks, name)
    cells = itertools.product(blocks.DISTANCES, repeat=2)
    assert {rule[:2]: rule[2] for rule in block.rules} == dict(zip(cells, printed.split(), strict=True))
    assert list(block.inputs) == inputs


def test_table_3_is_its_own_mirror() -> None:
    other = {"R": "L", "L": "R", "Z": "Z"}
    left = {rule[:2]: rule[2] for rule in make().blocks.track_left.rules}
    right = {rule[:2]: rule[2] for rule in make().blocks.track_right.rules}
    assert {cell: turn[:-1] + other[turn[-1]] for cell, turn in left.items()} == right


def test_table_4_is_the_printed_one() -> None:
    printed = zip("FL MFL CL Z CR MFR FR".split(), "BSL MSL SSL Z SSR MSR BSR".split(), strict=True)
    assert {rule[0]: rule[1] for rule in make().blocks.approach.rules} == dict(printed)


def test_table_5_is_the_printed_one() -> None:
    printed = {"BSL": "ZZSM", "MSL": "ZZSM", "SSL": "ZSMH", "Z": "ZSMH", "SSR": "ZSMH", "MSR": "ZZSM", "BSR": "ZZSM"}
    rules = make().blocks.speed.rules
    assert len(rules) == 28
    assert {rule[:2]: rule[2] for rule in rules} == {
        (turn, distance): speed
        for turn, row in printed.items()
        for distance, speed in zip(blocks.DISTANCES, row, strict=True)
    }


def test_the_decomposition_saves_rules() -> None:
    table = make().blocks.complexity()
    rows = {name: tuple(row) for name, *row in zip(*table.values(), strict=True)}
    assert list(table) == ["block", "inputs", "rules", "fire_at_most"]
    assert rows["1FB"] == (3, 64, 8)
    assert rows["all blocks"] == (3, 64 + 2 * 16 + 7 + 28, 8 + 4 + 4 + 2 + 4)
    assert rows["one flat block"] == (9, 4**7 * 7 * 4, 2**9)
    assert rows["one flat block, with the rear"] == (12, 4**10 * 7 * 4, 2**12)


def test_an_agent_needs_its_own_block_and_that_of_the_speed() -> None:
    table = make().blocks.complexity()
    rules = dict(zip(table["block"], table["rules"], strict=True))
    assert rules["destination agent drives"] == 7 + 28
    assert rules["wall agent drives"] == 16 + 28
    assert rules["obstacle agent drives"] == 64 + 28
    assert rules["each act here"] == 64 + 16 + 7 + 28


def test_no_more_rules_have_a_strength_at_once_than_are_said_to() -> None:
    rng = np.random.default_rng(0)
    made = make().blocks
    table = made.complexity()
    most = dict(zip(table["block"], table["fire_at_most"], strict=True))
    for name, block in made.by_name().items():
        low, high = np.array([(variable.low, variable.high) for variable in block.inputs.values()]).T
        counts = [np.count_nonzero(block.strengths(*point)) for point in rng.uniform(low, high, (300, len(low)))]
        assert max(counts) == most[name], name


# ---- equations, signs and edges ----


@pytest.mark.parametrize(
    ("phi", "beta", "theta"),
    [
        (10, 30, -20),
        (350, 10, -20),
        (10, 350, 20),
        (179, -179, -2),
        (-179, 179, 2),
        (90, 100, -10),  # as printed, without the sign, this would become 350
        (180, 0, 180),
        (0, 180, -180),
    ],
)
def test_theta_is_wrapped_above_180_and_below_minus_180(phi: float, beta: float, theta: float) -> None:
    assert math.degrees(deviation(math.radians(phi), math.radians(beta))) == pytest.approx(theta)


@pytest.mark.parametrize("degrees", [5, 60, 100, 150, 179])
@pytest.mark.parametrize("side", [1, -1])
def test_it_turns_to_the_side_of_its_destination(degrees: float, side: int) -> None:
    angle = math.radians(side * degrees)
    controller = make()
    command = controller.act(see(goal=(5.0 * math.cos(angle), 5.0 * math.sin(angle))))
    assert math.copysign(1.0, command.w_radps) == side
    assert controller.trace["heading_error_rad"] == pytest.approx(angle)
    assert controller.trace["mu_rad"] == controller.trace["mu_3_rad"]


def test_wheel_speeds_turn_at_k_times_mu_about_their_mean() -> None:
    left, right = wheel_speeds(0.5, 0.4, 2.5, 0.3)
    assert (left, right) == pytest.approx((0.2125, 0.5875))
    controller = make()
    command = controller.act(see(goal=(3.0, 1.0)))
    assert command.w_radps == pytest.approx(2.5 * controller.trace["mu_rad"])
    assert command.v_mps == pytest.approx(controller.trace["v_avg_mps"])


PEAK_SPEEDS = [(0.0, 0.0), (0.40, 1 / 3), (0.45, 2 / 3), (0.50, 1.0), (9.0, 1.0)]


@pytest.mark.parametrize(("distance_m", "share"), PEAK_SPEEDS)
def test_straight_ahead_the_speed_is_that_of_table_5_at_the_peaks(distance_m: float, share: float) -> None:
    command = make().act(see(goal=(distance_m, 0.0)))
    assert command == pytest.approx(Command(share * V_MAX, 0.0), abs=1e-6)


def test_the_speed_falls_with_the_distance_and_with_the_turn() -> None:
    speed = make().blocks.speed
    by_distance = [speed(0.0, d)[0] for d in np.linspace(0.0, 0.6, 121)]
    assert (np.diff(by_distance) >= -1e-9).all()
    for turn in (math.radians(95.0), -math.radians(95.0)):
        assert speed(turn, 1.0)[0] == pytest.approx(2 / 3, abs=1e-5)


@pytest.mark.parametrize(
    ("near", "degrees"),
    [
        ({1: 0.325, 10: 0.325}, 0.0),  # MD, MD: Z
        ({1: 0.36, 10: 0.325}, 30.0),  # MF before MD: a small step towards the wall
        ({1: 0.29, 10: 0.36}, -60.0),  # C before MF: a moderate one away from it
        ({5: 0.36, 6: 0.325}, -30.0),
        ({5: 0.29, 6: 0.36}, 60.0),
    ],
)
def test_along_a_wall_the_angle_is_that_of_table_3_at_the_peaks(near: dict[int, float], degrees: float) -> None:
    controller = make()
    controller.act(see(near))
    assert math.degrees(controller.trace["mu_2_rad"]) == pytest.approx(degrees, abs=1e-3)
    assert controller.trace["mu_rad"] == controller.trace["mu_2_rad"]


@pytest.mark.parametrize(
    ("near", "degrees"),
    [({2: 0.325}, BSR_DEG), ({3: 0.325}, -60.0), ({4: 0.325}, -60.0), ({2: 0.2, 3: 0.2, 4: 0.2}, BSR_DEG)],
)
def test_at_an_obstacle_the_angle_is_that_of_table_2_at_the_peaks(near: dict[int, float], degrees: float) -> None:
    controller = make()
    controller.act(see(near))
    assert controller.trace["agent"] == OBSTACLE
    assert math.degrees(controller.trace["mu_1_rad"]) == pytest.approx(degrees, abs=0.01)
    assert controller.trace["mu_rad"] == controller.trace["mu_1_rad"]


def test_the_rear_alone_drives_on_unless_its_own_readings_are_taken() -> None:
    behind = see({7: 0.325})
    assert make().act(behind) == pytest.approx(Command(V_MAX, 0.0), abs=1e-6)
    own = make(bypass_reads_rear=True)
    assert own.act(behind).w_radps == pytest.approx(2.5 * math.radians(BSR_DEG), rel=1e-4)
    both = see({7: 0.325, 3: 0.325})
    assert own.act(both) == make().act(both)


@pytest.mark.parametrize("reading", [0.0, 1e-9, 1e9, math.inf])
@pytest.mark.parametrize("sensors", [(1, 10), (2, 3, 4), (5, 6), (7, 8, 9), tuple(range(1, 11))])
@pytest.mark.parametrize("goal", [(0.0, 0.0), (-5.0, 0.0), (1e-12, -1e-12), (1e6, 1e6)])
def test_extreme_readings_and_goals_get_a_finite_command(
    reading: float, sensors: tuple[int, ...], goal: tuple[float, float]
) -> None:
    controller = make()
    command = controller.act(see(dict.fromkeys(sensors, reading), goal=goal))
    assert all(map(math.isfinite, command))
    assert -1e-12 <= command.v_mps <= V_MAX * (1.0 + 1e-9)
    assert abs(command.w_radps) <= 2.5 * math.radians(120.0)


@pytest.mark.parametrize("seed", range(4))
def test_a_mirrored_observation_gets_the_mirrored_command_unless_the_obstacle_agent_drives(seed: int) -> None:
    controller, mirror = make(), make()
    drivers = set()
    for look in anything(seed):
        command, reflected = controller.act(look), mirror.act(mirrored(look))
        agent = controller.trace["agent"]
        assert mirror.trace["agent"] == agent
        drivers.add(agent)
        if agent != OBSTACLE:
            assert reflected == pytest.approx(Command(command.v_mps, -command.w_radps), abs=1e-9)
        else:
            assert max(command.w_radps, reflected.w_radps) <= 1e-9  # 1FB has no output to the left
    assert drivers == {DESTINATION, OBSTACLE, WALL}


# ---- the contract ----


def test_it_keeps_the_contract() -> None:
    controller = make()
    assert isinstance(controller, Controller)
    for look in anything(7, 50):
        controller.act(look)
        assert tuple(controller.trace) == TRACE
        assert all(type(value) is float and math.isfinite(value) for value in controller.trace.values())


def test_the_trace_holds_what_the_figures_draw() -> None:
    controller = make()
    controller.act(see({1: 0.31, 10: 0.34, 5: 0.9, 6: 0.8}, pose=(1.0, 2.0, 0.0), goal=(4.0, 6.0)))
    trace = controller.trace
    assert (trace["d_s1_m"], trace["d_s10_m"], trace["d_s5_m"], trace["d_s6_m"]) == (0.31, 0.34, 0.9, 0.8)
    assert trace["d_destination_m"] == pytest.approx(5.0)
    assert trace["heading_error_rad"] == pytest.approx(math.atan2(4.0, 3.0))


def test_reset_forgets_the_last_episode() -> None:
    changes = {"dwell_periods": 7}
    used, fresh = make(changes), make(changes)
    for look in anything(1, 30):
        used.act(look)
    used.reset(SETUP, np.random.default_rng(9))
    for look in anything(2, 60):
        assert used.act(look) == fresh.act(look)


def test_a_pickled_controller_goes_on_where_it_was() -> None:
    original = make({"dwell_periods": 7})
    for look in anything(3, 30):
        original.act(look)
    resumed = pickle.loads(pickle.dumps(original))
    for look in anything(4, 60):
        assert resumed.act(look) == original.act(look)


def test_another_ring_of_sensors_is_refused() -> None:
    for sensors in ((), SETUP.sensors[::-1], SETUP.sensors[:-1]):
        with pytest.raises(ValueError, match="needed are s1, s2"):
            make().reset(SETUP._replace(sensors=sensors), np.random.default_rng(0))


def test_the_ring_stands_as_the_tables_order_and_mirror_say() -> None:
    cell = compose_cell("controller=multi_agent", "world=nemeiksis_bypass")
    mounts = {mount.role: mount for mount in cell.sensors.complete_mounts()}
    assert tuple(mounts) == SENSOR_ROLES
    for sensor in range(1, 11):
        mount, other = mounts[f"s{sensor}"], mounts[f"s{switch.mirrored_sensor(sensor)}"]
        assert (other.x_m, other.y_m) == pytest.approx((mount.x_m, -mount.y_m), abs=1e-6)
        assert math.sin(other.heading_rad) == pytest.approx(-math.sin(mount.heading_rad), abs=1e-9)
        assert (mount.x_m, mount.y_m) == pytest.approx(
            (0.15 * math.cos(mount.heading_rad), 0.15 * math.sin(mount.heading_rad)), abs=1e-6
        )
    turns = np.diff(np.unwrap([mounts[f"s{sensor}"].heading_rad for sensor in switch.COLUMNS]))
    assert turns == pytest.approx(np.full(9, -math.radians(36.0)))  # clockwise, column by column
    assert mounts["s3"].heading_rad == 0.0


def test_what_it_offers_of_itself_are_tables() -> None:
    tables = make().describe()
    for name, table in tables.items():
        assert len({len(column) for column in table.values()}) == 1, name
    patterns = tables["patterns"]
    assert len(patterns["pattern"]) == len(set(patterns["pattern"])) == 1024
    assert patterns["printed"].count("none") == 107
    assert patterns["printed"].count("conflict") == 0
    assert all(patterns["mirror_agrees"])
    at = patterns["pattern"].index("1100011000")
    found = [patterns[key][at] for key in ("modes", "matches", "printed", "agent")]
    assert found == ["10 11 12 13 14", 5, "wall", "wall"]
    assert set(tables["memberships"]["variable"]) == {"d_s4", "d_s10", "bearing", "mu_1", "d_destination", "V_avg"}
    assert sum(len(table["mu_2"]) for table in tables.values() if "mu_2" in table) == 32


@pytest.mark.parametrize(
    ("group", "key", "value"),
    [
        ("switch", "agents", []),
        ("switch", "agents", ["destination", "destination"]),
        ("switch", "agents", ["fly"]),
        ("switch", "flank_detect_m", 0.0),
        ("switch", "front_rear_detect_m", "0.4"),
        ("switch", "leave_wall_rad", -0.1),
        ("switch", "dwell_periods", -1),
        ("switch", "dwell_periods", 1.5),
        ("switch", "dwel_periods", 1),
        ("blocks", "bypass_distance_m", {"C": 0.2, "MD": 0.3, "MF": 0.4}),
        ("blocks", "tracking_distance_m", {"C": 0.2, "MD": 0.3, "MF": 0.3, "F": 0.5}),
        ("blocks", "destination_distance_m", {"C": -0.1, "MD": 0.3, "MF": 0.4, "F": 0.5}),
        ("blocks", "speed_share", {"Z": -0.1, "S": 0.3, "M": 0.4, "H": 0.5}),
        ("blocks", "turn_limit_rad", 1.0),
        ("blocks", "bearing_limit_rad", 1.0),
        (None, "turn_gain_per_s", 0.0),
        (None, "bypass_reads_rear", "yes"),
    ],
)
def test_a_wrong_parameter_is_named(group: str | None, key: str, value: Any) -> None:
    parameters = copy.deepcopy(_composed())
    (parameters[group] if group else parameters)[key] = value
    named = {"turn_limit_rad": "turn_rad", "bearing_limit_rad": "destination_bearing_rad"}.get(key, key)
    with pytest.raises(ValueError, match=named):
        MultiAgent(**parameters)


@pytest.mark.parametrize("look", [see({3: math.nan}), see({2: math.nan}), see(goal=(math.nan, 0.0))])
def test_what_is_no_number_gets_no_command(look: Observation) -> None:
    assert all(map(math.isnan, make().act(look)))
