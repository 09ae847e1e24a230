import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from scenes import a_world, to_and_fro
from shapes import Shard

from navbench.cli.worlds import world_of
from navbench.mathematics.geometry import box_gap, distance_to_nearest, polygon_gap
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.simulation.options import SimulatorOptions
from navbench.validation import REMEMBERED_MAX, DescriptionError, describe, remembered
from navbench.world.layout import DrawnWorld, Layout, Start
from navbench.world.shapes import Box, Disc, Mover, Point, Polygon, Wall, check_convex, polygon_table

PLAIN: dict[str, Any] = {
    "name": "plain",
    "bounds": {"x_min_m": -5.0, "x_max_m": 5.0, "y_min_m": -5.0, "y_max_m": 5.0},
    "boxes": [{"x_m": 2.0, "y_m": 2.0, "length_m": 2.0, "width_m": 1.0}],
    "discs": [{"x_m": -2.0, "y_m": 2.0, "radius_m": 0.5}],
    "walls": [{"x1_m": -4.0, "y1_m": -4.0, "x2_m": 4.0, "y2_m": -4.0, "thickness_m": 0.1}],
    "movers": [
        {"radius_m": 0.2, "waypoints": [{"x_m": 0.0, "y_m": 1.0}, {"x_m": 1.0, "y_m": 1.0}], "speeds_mps": [0.5]}
    ],
    "starts": [{"x_m": 0.0, "y_m": 0.0}],
    "goals": [{"x_m": 3.0, "y_m": 0.0}],
    "goal_tolerance_m": 0.1,
    "time_limit_s": 60.0,
}
LINE = {"x1_m": 1.5, "y1_m": -1.0, "x2_m": 1.5, "y2_m": 1.0}


def changed(path: str, value: Any) -> dict[str, Any]:
    """Return the plain world with one value changed, at a path such as "discs.0.radius_m"; None leaves it out."""

    def copy(node: Any) -> Any:
        if isinstance(node, Mapping):
            return {key: copy(inner) for key, inner in node.items()}
        return [copy(inner) for inner in node] if isinstance(node, list) else node

    world = copy(PLAIN)
    *way, last = [int(part) if part.isdigit() else part for part in path.split(".")]
    node = world
    for part in way:
        node = node[part]
    if value is None:
        del node[last]
    else:
        node[last] = value
    assert isinstance(world, dict)
    return world


def listed(values: dict[str, Any]) -> Layout:
    """Return what a world of these values always draws."""
    values = {key: value for key, value in values.items() if key != "name"}
    return world_of(values, "plain")[0].drawn_for(0, 0)


def message_for(path: str, value: Any) -> str:
    with pytest.raises(DescriptionError) as caught:
        listed(changed(path, value))
    return str(caught.value)


def test_the_plain_world_itself_is_valid() -> None:
    world = listed(PLAIN)
    assert world.boxes == (Box(x_m=2.0, y_m=2.0, length_m=2.0, width_m=1.0, heading_rad=0.0),)
    assert listed(changed("finish_line", LINE)).finish_line is not None


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("discs.0.radius_m", -0.5, ["world.discs[0].radius_m", "-0.5", "greater than 0"]),
        ("discs.0.radius_m", 0.0, ["world.discs[0].radius_m", "0.0", "greater than 0"]),
        ("discs.0.radius_m", "0.5", ["world.discs[0].radius_m", "'0.5'", "number"]),
        ("discs.0.radius_m", True, ["world.discs[0].radius_m", "True", "number"]),
        ("discs.0.x_m", math.nan, ["world.discs[0].x_m", "nan", "finite"]),
        ("boxes.0.length_m", math.inf, ["world.boxes[0].length_m", "inf", "finite"]),
        ("walls.0.thickness_m", 0.0, ["world.walls[0].thickness_m", "0.0", "greater than 0"]),
        ("time_limit_s", -1.0, ["world.time_limit_s", "-1.0", "greater than 0"]),
        ("goal_tolerance_m", 0.0, ["world.goal_tolerance_m", "0.0", "greater than 0"]),
        ("goal_tolerance_m", None, ["world.goal_tolerance_m", "missing"]),
        ("starts.0.y_m", None, ["world.starts[0].y_m", "missing"]),
        ("discs.0.raduis_m", 1.0, ["world.discs[0].raduis_m", "unknown", "x_m, y_m, radius_m"]),
        ("goal_tolerence_m", 1.0, ["world.goal_tolerence_m", "unknown", "goal_tolerance_m"]),
        ("movers.0.speeds_mps", [0.0], ["world.movers[0].speeds_mps[0]", "0.0", "greater than 0"]),
        ("movers.0.phase_s", -1.0, ["world.movers[0].phase_s", "-1.0", "greater than or equal to 0"]),
        ("movers.0.cyclic", 1, ["world.movers[0].cyclic", "1", "boolean"]),
        ("movers.0.speeds_mps", [0.5, 0.5], ["world.movers[0]", "speeds_mps", "1 in all", "got 2"]),
        ("movers.0.cyclic", True, ["world.movers[0]", "speeds_mps", "2 in all", "got 1"]),
        ("movers.0.waypoints", [{"x_m": 0.0, "y_m": 1.0}], ["world.movers[0]", "waypoints", "at least 2", "got 1"]),
        ("movers.0.waypoints.1.x_m", 0.0, ["world.movers[0]", "waypoints", "different"]),
        ("bounds.x_min_m", 5.0, ["world.bounds", "x_min_m", "below x_max_m"]),
        ("bounds.y_max_m", -6.0, ["world.bounds", "y_min_m", "below y_max_m"]),
        ("starts.0.x_m", 5.5, ["starts[0]", "5.5", "[-5.0, 5.0]"]),
        ("goals.0.y_m", -5.5, ["goals[0]", "-5.5", "[-5.0, 5.0]"]),
        ("boxes.0.y_m", 7.0, ["boxes[0]", "7.0", "[-5.0, 5.0]"]),
        ("discs.0.x_m", 7.0, ["discs[0]", "7.0", "[-5.0, 5.0]"]),
        ("goals", [], ["goals", "got 0 for 1"]),
        ("starts", [], ["goals", "at least one", "for 0"]),
        ("goals.0", {"x_m": 2.0, "y_m": 2.3}, ["goals[0]", "2.3", "outside every obstacle"]),
        ("goals.0", {"x_m": -2.0, "y_m": 1.8}, ["goals[0]", "1.8", "outside every obstacle"]),
        ("goals.0", {"x_m": 0.0, "y_m": -3.97}, ["goals[0]", "-3.97", "outside every obstacle"]),
        ("finish_line", LINE | {"x1_m": 2.1, "x2_m": 2.1}, ["goals[0]", "at least 1 m", "0.9 m"]),
        ("finish_line", LINE | {"y1_m": 0.1}, ["goals[0]", "finish line", "starts[0]"]),
        ("finish_line", LINE | {"x1_m": -1.0, "x2_m": -1.0}, ["goals[0]", "finish line", "starts[0]"]),
        ("finish_line", {"x1_m": 1.0, "y1_m": 1.0, "x2_m": 1.0, "y2_m": 1.0}, ["finish_line", "different"]),
    ],
)
def test_an_error_in_a_world_names_its_key_its_value_and_what_is_allowed(
    path: str, value: Any, words: list[str]
) -> None:
    message = message_for(path, value)
    assert "\n" not in message
    for word in words:
        assert word in message, message


def test_a_wall_between_equal_points_is_refused_by_its_place_in_the_world() -> None:
    message = message_for("walls.0", {"x1_m": 1.0, "y1_m": 2.0, "x2_m": 1.0, "y2_m": 2.0, "thickness_m": 0.1})
    assert "world.walls[0]" in message
    assert "different points" in message


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        (Robot, {"radius_m": 0.1, "track_m": 0.1, "wheel_speed_max_mps": 0.0}, ["wheel_speed_max_mps", "greater"]),
        (Robot, {"radius_m": 0.1, "track_m": 0.1}, ["wheel_speed_max_mps", "missing"]),
        (SimulatorOptions, {"drive": "wheel"}, ["drive", "'wheel'", "'ideal'", "'limited'"]),
        (SimulatorOptions, {"on_collision": "stop"}, ["on_collision", "'stop'", "'end'", "'block'"]),
        (SimulatorOptions, {"motor_lag_s": -0.1}, ["motor_lag_s", "-0.1", "greater than or equal to 0"]),
        (SimulatorOptions, {"command_delay": 0.1}, ["command_delay", "unknown", "command_delay_s"]),
        (Sensors, {"drawn_for_radius_m": 1.0, "max_range_m": 1.0, "rays": 0}, ["rays", "0", "greater"]),
        (Sensors, {"drawn_for_radius_m": 1.0, "max_range_m": 1.0, "rays": 1.5}, ["rays", "1.5", "a whole number"]),
        (Sensors, {"drawn_for_radius_m": 1.0, "max_range_m": 1.0, "dropout_probability": 1.1}, ["1.1", "less than"]),
        (Sensors, {"drawn_for_radius_m": 1.0, "max_range_m": 1.0, "cone_half_angle_rad": 4.0}, ["4.0", "less than"]),
    ],
)
def test_an_error_in_a_robot_simulator_or_suite_names_its_key_its_value_and_what_is_allowed(
    kind: type, values: dict[str, Any], words: list[str]
) -> None:
    with pytest.raises(DescriptionError) as caught:
        describe(kind, values, "thing")
    for word in ["thing.", *words]:
        assert word in str(caught.value), str(caught.value)


@pytest.mark.parametrize(
    ("mounts", "words"),
    [
        ([{"role": "a"}, {"role": "b"}, {"role": "a"}], ["mounts", "once", "a is repeated"]),
        ([{"role": "a", "min_range_m": 2.0}], ["mounts[0]", "min_range_m=2.0", "below max_range_m=1.0"]),
        ([{"role": "a", "rays": 10001}], ["rays", "10001", "10000"]),
        ([{"role": "a", "rays": 5000}, {"role": "b", "rays": 5001}], ["rays", "10001", "10000"]),
    ],
)
def test_mounts_that_do_not_go_together_are_refused(mounts: list[dict[str, Any]], words: list[str]) -> None:
    placed = [{"x_m": 0.0, "y_m": 0.0, "heading_rad": 0.0} | mount for mount in mounts]
    with pytest.raises(DescriptionError) as caught:
        describe(Sensors, {"drawn_for_radius_m": 1.0, "max_range_m": 1.0, "mounts": placed}, "sensors")
    for word in words:
        assert word in str(caught.value), str(caught.value)


def test_a_start_without_a_heading_looks_at_its_goal() -> None:
    starts = (Start(x_m=1.0, y_m=1.0), Start(x_m=5.0, y_m=5.0, heading_rad=-2.0))
    world = a_world(starts=starts, goals=(Point(x_m=0.0, y_m=2.0), Point(x_m=9.0, y_m=9.0)))
    assert world.start_heading_rad(0) == pytest.approx(0.75 * math.pi)
    assert world.start_heading_rad(1) == -2.0


def test_a_wall_is_a_box_around_the_line_between_its_points() -> None:
    world = a_world(walls=(Wall(x1_m=1.0, y1_m=2.0, x2_m=4.0, y2_m=6.0, thickness_m=0.4),))
    (box,) = world.solids()
    assert (box.x_m, box.y_m, box.length_m, box.width_m) == pytest.approx((2.5, 4.0, 5.0, 0.4))
    assert world.box_rows() == pytest.approx(np.array([[2.5, 4.0, 2.5, 0.2, 0.6, 0.8]]))


def places(world: DrawnWorld, times: list[float]) -> list[tuple[float, ...]]:
    """Return the last mover's x, y, vx, vy at each time."""
    return [tuple(world.disc_rows(t)[-1, [0, 1, 3, 4]].tolist()) for t in times]


def test_a_mover_back_and_forth_turns_round_at_its_ends_and_keeps_each_legs_speed() -> None:
    world = a_world(movers=(to_and_fro((0.0, 0.0), (4.0, 0.0), (4.0, 3.0), speeds=[2.0, 0.5], radius_m=0.3),))
    expected = {
        0.0: (0.0, 0.0, 2.0, 0.0),
        1.5: (3.0, 0.0, 2.0, 0.0),
        2.0: (4.0, 0.0, 0.0, 0.5),
        5.0: (4.0, 1.5, 0.0, 0.5),
        8.0: (4.0, 3.0, 0.0, -0.5),
        13.0: (4.0, 0.5, 0.0, -0.5),
        14.5: (3.0, 0.0, -2.0, 0.0),
        16.0: (0.0, 0.0, 2.0, 0.0),
        17.5: (3.0, 0.0, 2.0, 0.0),
        160.0 + 9.0: (4.0, 2.5, 0.0, -0.5),
    }
    assert places(world, list(expected)) == [pytest.approx(place, abs=1e-9) for place in expected.values()]


def test_a_cyclic_mover_goes_on_to_its_first_point() -> None:
    points = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)]
    world = a_world(movers=(to_and_fro(*points, speeds=[2.0, 1.0, 0.5], radius_m=0.3, cyclic=True),))
    expected = {
        1.0: (2.0, 0.0, 2.0, 0.0),
        3.0: (4.0, 1.0, 0.0, 1.0),
        5.0: (4.0, 3.0, -0.4, -0.3),
        10.0: (2.0, 1.5, -0.4, -0.3),
        15.0: (0.0, 0.0, 2.0, 0.0),
        46.0: (2.0, 0.0, 2.0, 0.0),
    }
    assert places(world, list(expected)) == [pytest.approx(place, abs=1e-9) for place in expected.values()]


@pytest.mark.parametrize("cyclic", [False, True])
def test_a_phase_is_a_head_start_in_time_even_of_many_rounds(cyclic: bool) -> None:
    points, speeds = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)], [2.0, 0.5, 1.0][: 3 if cyclic else 2]
    still = to_and_fro(*points, speeds=speeds, radius_m=0.3, cyclic=cyclic)
    ahead = to_and_fro(*points, speeds=speeds, radius_m=0.3, cyclic=cyclic, phase_s=71.3)
    times = np.linspace(0.0, 40.0, 173)
    early = places(a_world(movers=(ahead,)), times.tolist())
    late = places(a_world(movers=(still,)), (times + 71.3).tolist())
    assert np.array(early) == pytest.approx(np.array(late), abs=1e-9)


def test_a_mover_never_jumps_and_its_velocity_is_its_places_derivative() -> None:
    mover = to_and_fro((0.0, 0.0), (4.0, 0.0), (1.0, 3.0), (2.0, -1.0), speeds=[2.0, 0.7, 1.1], radius_m=0.3)
    rows = np.array(places(a_world(movers=(mover,)), np.arange(0.0, 40.0, 1e-3).tolist()))
    steps = np.diff(rows[:, :2], axis=0) / 1e-3
    assert np.hypot(*steps.T).max() <= 2.0 + 1e-9
    straight = (rows[1:, 2:] == rows[:-1, 2:]).all(axis=1)
    assert straight.mean() > 0.99
    assert steps[straight] == pytest.approx(rows[:-1, 2:][straight], abs=1e-6)


def test_several_movers_and_discs_keep_their_order() -> None:
    movers = tuple(
        to_and_fro((float(i), 0.0), (float(i), 9.0), speeds=[1.0 + i], radius_m=0.1 * (i + 1)) for i in range(3)
    )
    world = a_world(discs=(Disc(x_m=7.0, y_m=8.0, radius_m=0.9),), movers=movers)
    assert world.disc_rows(1.0) == pytest.approx(
        np.array([[7, 8, 0.9, 0, 0], [0, 1, 0.1, 0, 1], [1, 2, 0.2, 0, 2], [2, 3, 0.3, 0, 3]], dtype=float)
    )


# --- polygons ---


def points(*corners: tuple[float, float] | complex) -> tuple[Point, ...]:
    numbers = [corner if isinstance(corner, complex) else complex(*corner) for corner in corners]
    return tuple(Point(x_m=corner.real, y_m=corner.imag) for corner in numbers)


def a_shard(rng: np.random.Generator, count: int) -> Shard:
    """Return a convex polygon on an ellipse, anywhere and turned anyhow: it need not hold its ellipse's centre."""
    turns = np.sort(rng.uniform(0.0, math.tau, count))
    along, across = 10.0 ** rng.uniform(-1.0, 0.5, 2)
    tilt, centre = np.exp(1j * rng.uniform(0.0, math.tau)), complex(*rng.uniform(-2.0, 2.0, 2))
    return Shard(tuple((centre + tilt * (along * np.cos(turns) + 1j * across * np.sin(turns))).tolist()))


def test_the_distance_to_a_polygon_is_that_to_its_nearest_edge_and_negative_inside() -> None:
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(500):
        shards = [a_shard(rng, int(count)) for count in rng.integers(3, 9, 3)]  # tables repeat the last corners
        world = a_world(polygons=tuple(Polygon(corners=points(*shard.corners[:: (-1, 1)[k % 2]]))
                                       for k, shard in enumerate(shards)))  # fmt: skip
        rows = world.polygon_rows()
        for p in (complex(*rng.uniform(-4.0, 4.0, 2)), sum(shards[0].corners) / len(shards[0].corners)):
            expected = [shard.away(p) for shard in shards]
            inside += min(expected) < -1e-6
            gaps = [polygon_gap(p.real, p.imag, rows, k)[0] for k in range(len(rows))]
            assert gaps == pytest.approx(expected, abs=1e-9)
            nearest = distance_to_nearest(p.real, p.imag, np.empty((0, 6)), np.empty((0, 5)), rows)
            assert nearest == pytest.approx(min(expected), abs=1e-9)
    assert inside > 500


def test_a_rectangle_is_as_far_as_the_box_of_its_corners() -> None:
    boxes = np.array([[1.0, 2.0, 1.5, 0.5, 0.8, 0.6]])
    turn = complex(0.8, 0.6)
    corners = [1 + 2j + turn * complex(1.5 * a, 0.5 * b) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    rows = a_world(polygons=(Polygon(corners=points(*corners)),)).polygon_rows()
    for x, y in np.random.default_rng(6).uniform(-3.0, 5.0, (500, 2)).tolist():
        assert polygon_gap(x, y, rows, 0) == pytest.approx(box_gap(x, y, boxes, 0), abs=1e-12)


def test_a_table_of_polygons_repeats_last_corners_and_turns_all_counter_clockwise() -> None:
    triangle, square = points((1, 0), (0, 1), (-1, -1)), points((1, 1), (-1, 1), (-1, -1), (1, -1))
    table = polygon_table([(5.0, 6.0, 1.5, triangle[::-1]), (7.0, 8.0, 1.6, square)])
    assert table[0].tolist() == [5.0, 6.0, 1.5, 0.0, 0.0, 1, 0, 0, 1, -1, -1, -1, -1]
    assert table[1].tolist() == [7.0, 8.0, 1.6, 0.0, 0.0, 1, 1, -1, 1, -1, -1, 1, -1]
    assert polygon_table([]).shape == (0, 5)


def test_a_polygons_row_holds_its_centre_and_the_circle_around_it() -> None:
    (row,) = a_world(polygons=(Polygon(corners=points((4, 4), (6, 4), (6, 6), (4, 6))),)).polygon_rows()
    assert row[:5] == pytest.approx([5.0, 5.0, math.sqrt(2.0), 0.0, 0.0])


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("count", [3, 4, 7])
def test_corners_on_a_circle_are_convex_whichever_way_they_turn_and_not_when_one_is_pushed_in(
    count: int, turn: int
) -> None:
    corners = [complex(math.cos(math.tau * k / count), math.sin(turn * math.tau * k / count)) for k in range(count)]
    check_convex("corners", points(*corners))
    for wrong in (
        [*corners[:-1], 0.5 * (corners[0] + corners[-2])],  # three on a line
        [*corners, corners[-1]],  # one twice
        [*corners, 0.5 * corners[-1]],  # a dent
        [*corners, *corners],  # twice round
        [corners[0], corners[2], corners[1], *corners[3:]] if count > 3 else corners[:2],  # crossed, too few
    ):
        with pytest.raises(DescriptionError, match="corners: "):
            check_convex("corners", points(*wrong))


def test_an_outline_may_touch_the_circle_but_not_leave_it() -> None:
    way: dict[str, Any] = {"waypoints": points((0, 0), (9, 0)), "speeds_mps": (1.0,)}
    outline = points((1, 0), (0, 1), (-1, 0), (0, -1))
    assert Mover(radius_m=1.0, outline=outline, **way).outline == outline
    with pytest.raises(ValueError, match=r"outline: must lie within the radius, 0\.999 m"):
        Mover(radius_m=0.999, outline=outline, **way)


def test_an_outlined_mover_is_a_row_of_polygons_that_moves_without_turning() -> None:
    outline = points((1, 0), (-1, 1), (-1, -1))
    movers = (
        to_and_fro((0.0, 0.0), (3.0, 4.0), speeds=[2.5], radius_m=2.0, outline=outline),
        to_and_fro((0.0, 9.0), (5.0, 9.0), speeds=[1.0], radius_m=0.5),
    )
    world = a_world(movers=movers)
    assert (world.round_movers(), world.outlined_movers()) == (movers[1:], movers[:1])
    for t_s, x_m, y_m, speed_mps in ((0.0, 0.0, 0.0, 2.5), (1.0, 1.5, 2.0, 2.5), (3.0, 1.5, 2.0, -2.5)):
        (row,) = world.polygon_rows(t_s)
        assert row[:5] == pytest.approx([x_m, y_m, 2.0, 0.6 * speed_mps, 0.8 * speed_mps])
        assert row[5:] == pytest.approx([1, 0, -1, 1, -1, -1])
        assert movers[0].place(t_s) == pytest.approx((x_m, y_m))
    assert world.disc_rows(1.0)[:, :3] == pytest.approx(np.array([[1.0, 9.0, 0.5]]))


def test_a_movers_place_knows_its_phase_and_its_rounds() -> None:
    mover = to_and_fro(
        (0.0, 0.0), (4.0, 0.0), (4.0, 3.0), speeds=[2.0, 1.0, 0.5], radius_m=1.0, cyclic=True, phase_s=1.0
    )
    places = {0.0: (2.0, 0.0), 2.0: (4.0, 1.0), 9.0: (2.0, 1.5), 15.0: (2.0, 0.0), 14.0: (0.0, 0.0)}
    assert [mover.place(t_s) for t_s in places] == [pytest.approx(place, abs=1e-9) for place in places.values()]


def test_equal_values_give_what_was_built_before_and_others_do_not() -> None:
    built: list[object] = []

    @remembered
    def build(values: dict[str, object], gain: object = 1.0) -> list[object]:
        if gain is True:
            raise ValueError("gain=True: must be a number")
        built.append((values, gain))
        return [values, gain]

    first = build({"a": 1.0, "b": {"c": 2.0}})
    assert build({"a": 1.0, "b": {"c": 2.0}}) is first
    for other in ({"a": 1, "b": {"c": 2.0}}, {"b": {"c": 2.0}, "a": 1.0}, {"a": 1.0, "b": {"c": 2.5}}):
        assert build(other) == [other, 1.0]
    assert build({"a": 1.0, "b": {"c": 2.0}}, gain=2.0) == [{"a": 1.0, "b": {"c": 2.0}}, 2.0]
    for _ in range(2):
        with pytest.raises(ValueError, match="gain=True"):
            build({"a": 1.0}, gain=True)
    assert len(built) == 5
    for k in range(REMEMBERED_MAX):
        build({"k": k})
    assert build({"a": 1.0, "b": {"c": 2.0}}) is not first
