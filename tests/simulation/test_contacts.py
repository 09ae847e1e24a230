"""Contacts by kind, in the metrics of an episode; and the scene that is touched."""

import math
from typing import Any

import numpy as np
import pytest
from scenes import BLOCK, IDEAL, Scripted, a_robot, a_world, always, run, run_one, schedule, to_and_fro

from navbench.contract import Command, Observation
from navbench.records import RobotRecord, Thing
from navbench.simulation.bullet import prism
from navbench.simulation.options import SimulatorOptions
from navbench.simulation.scene import Scene
from navbench.world.layout import DrawnWorld, FinishLine, Start
from navbench.world.shapes import Disc, Point, Polygon, Wall

SQUARE = tuple(Point(x_m=x, y_m=y) for x, y in ((0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)))
WALL = Wall(x1_m=5.1, y1_m=-50.0, x2_m=5.1, y2_m=50.0, thickness_m=0.1)
BOTH = pytest.mark.parametrize("options", [IDEAL, BLOCK], ids=["end", "block"])


def starts(*places: tuple[float, float, float]) -> tuple[Start, ...]:
    return tuple(Start(x_m=x, y_m=y, heading_rad=heading) for x, y, heading in places)


def counted(record: RobotRecord) -> tuple[float, ...]:
    """Return all contacts of a robot, those with robots, and those while it stood."""
    return tuple(record.metrics[name] for name in ("collisions", "robot_collisions", "standing_collisions"))


def ended(options: SimulatorOptions) -> str:
    return "collided" if options.on_collision == "end" else "timed_out"


# --- who touched whom ---


@BOTH
def test_a_robot_that_drives_into_one_that_has_arrived_is_the_only_one_that_counts(options: SimulatorOptions) -> None:
    goals = (Point(x_m=500.0, y_m=0.0), Point(x_m=5.0, y_m=0.0))
    world = a_world(starts=starts((0, 0, 0), (5, 0, 0)), goals=goals)
    driver, arrived = run(world, always(1.0), options=options)
    assert (arrived.outcome, arrived.metrics["time_s"], counted(arrived)) == ("reached", 0.0, (0, 0, 0))
    assert (driver.outcome, counted(driver)) == (ended(options), (1, 1, 0))


def test_a_robot_that_drives_into_one_that_has_collided_leaves_its_count_alone() -> None:
    world = a_world(starts=starts((3.0, 0, 0), (-3.0, 0, 0)), walls=(WALL,))
    first, second = run(world, always(1.0))
    assert (first.outcome, first.reason, counted(first)) == ("collided", "hit wall 0", (1, 0, 0))
    assert (second.outcome, second.reason, counted(second)) == ("collided", "hit robot 0", (1, 1, 0))


def test_a_robot_that_drives_into_one_whose_controller_failed_is_the_only_one_that_counts() -> None:
    def fail(_: Observation) -> Command:
        raise RuntimeError("no luck")

    world = a_world(starts=starts((0, 0, 0), (5, 0, 0)))
    driver, failed = run(world, [always(1.0), Scripted(fail)])
    assert (failed.outcome, counted(failed)) == ("controller_error", (0, 0, 0))
    assert counted(driver) == (1, 1, 0)


@BOTH
def test_a_robot_that_is_still_running_but_stands_is_driven_into(options: SimulatorOptions) -> None:
    world = a_world(starts=starts((0, 0, 0), (5, 0, 1.0)))
    driver, standing = run(world, [always(1.0), always(0.0)], options=options)
    assert (driver.outcome, counted(driver)) == (ended(options), (1, 1, 0))
    assert (standing.outcome, counted(standing)) == (ended(options), (1, 1, 1))


@BOTH
def test_two_robots_head_on_both_touch_a_robot_and_neither_stood(options: SimulatorOptions) -> None:
    world = a_world(starts=starts((0, 0, 0), (6, 0, math.pi)))
    records = run(world, always(1.0), options=options)
    assert [(record.outcome, counted(record)) for record in records] == [(ended(options), (1, 1, 0))] * 2


@BOTH
@pytest.mark.parametrize("outline", [(), SQUARE], ids=["round", "square"])
@pytest.mark.parametrize(("v_mps", "stands"), [(0.0, 1), (0.1, 0), (-0.1, 0)])
def test_a_mover_drives_into_a_standing_robot_and_shares_the_blame_with_a_moving_one(
    options: SimulatorOptions, outline: tuple[Point, ...], v_mps: float, stands: int
) -> None:
    mover = to_and_fro((6.0, 0.0), (-100.0, 0.0), speeds=[2.0], radius_m=1.0, outline=outline)
    record = run_one(a_world(movers=(mover,)), always(v_mps), options=options)
    assert (record.outcome, counted(record)) == (ended(options), (1, 0, stands))


@BOTH
def test_a_robot_that_turns_on_the_spot_does_not_stand(options: SimulatorOptions) -> None:
    mover = to_and_fro((6.0, 0.0), (-100.0, 0.0), speeds=[2.0], radius_m=0.5)
    assert counted(run_one(a_world(movers=(mover,)), always(0.0, 0.5), options=options)) == (1, 0, 0)


@BOTH
def test_a_robot_that_has_come_to_rest_stands(options: SimulatorOptions) -> None:
    mover = to_and_fro((9.0, 0.0), (-100.0, 0.0), speeds=[2.0], radius_m=0.5)
    driven = schedule([(1.0, 0.0)] * 10, 0.1)
    assert counted(run_one(a_world(movers=(mover,)), driven, options=options)) == (1, 0, 1)


def test_a_robot_whose_wheels_still_roll_to_rest_does_not_stand() -> None:
    mover = to_and_fro((4.5, 0.0), (-100.0, 0.0), speeds=[2.0], radius_m=0.5)
    driven, robot = schedule([(1.0, 0.0)] * 10, 0.1), a_robot(accel_mps2=1.0)
    record = run_one(a_world(movers=(mover,)), driven, robot=robot)
    assert 1.0 < record.metrics["time_s"] < 2.0
    assert counted(record) == (1, 0, 0)


def test_blocked_contacts_are_counted_again_after_a_break_each_by_its_own_kind() -> None:
    """Two touches of a standing robot, then backward into a wall."""
    commands = [(1.0, 0.0)] * 15 + [(-1.0, 0.0)] * 5 + [(1.0, 0.0)] * 15 + [(-1.0, 0.0)] * 60
    wall = Wall(x1_m=-3.05, y1_m=-9.0, x2_m=-3.05, y2_m=9.0, thickness_m=0.1)
    world = a_world(starts=starts((0, 0, 0), (3, 0, 0)), walls=(wall,))
    driver, standing = run(world, [schedule(commands, 0.1), always(0.0)], options=BLOCK)
    assert counted(driver) == (3, 2, 0)
    assert counted(standing) == (2, 2, 2)


def test_a_contact_ends_with_a_gap_of_a_ten_thousandth_of_a_radius() -> None:
    commands = [(1.0, 0.0)] * 30 + [(-0.001, 0.0)] + [(1.0, 0.0)] * 5  # 0.05 mm away from the wall, and back
    wall = Wall(x1_m=1.6, y1_m=-9.0, x2_m=1.6, y2_m=9.0, thickness_m=0.1)
    record = run_one(a_world(walls=(wall,)), schedule(commands, 0.05), options=BLOCK)
    assert counted(record) == (2, 0, 0)


def test_an_unbroken_push_is_one_contact_of_the_one_that_is_pushed_too() -> None:
    world = a_world(starts=starts((0, 0, 0), (3, 0, 0)))
    records = run(world, [always(0.7), always(0.0)], options=BLOCK)
    assert [counted(record) for record in records] == [(1, 1, 0), (1, 1, 1)]


def test_of_three_robots_in_one_contact_each_counts_its_own_part() -> None:
    world = a_world(starts=starts((0, 0, 0), (3.03, 0, 0), (6.06, 0, math.pi)))
    records = run(world, [always(1.0), always(0.0), always(1.0)])
    assert [counted(record) for record in records] == [(1, 1, 0), (1, 1, 1), (1, 1, 0)]


@pytest.mark.parametrize(("index", "outlined"), [(0, True), (1, False), (2, True)])
def test_a_contact_names_the_mover_by_its_place_in_the_world(index: int, outlined: bool) -> None:
    """Round and outlined movers lie apart in the simulator's tables."""
    lanes = [-20.0, 0.0, 20.0]
    movers = tuple(
        to_and_fro((6.0, y), (-100.0, y), speeds=[2.0], radius_m=1.0, outline=SQUARE if k != 1 else ())
        for k, y in enumerate(lanes)
    )
    record = run_one(a_world(movers=movers, starts=starts((0, lanes[index], 0))), always(0.0))
    assert (record.hit, record.reason) == (Thing("mover", index), f"hit mover {index}")
    assert record.metrics["time_s"] == pytest.approx((6.0 - 1.0 - (0.5 if outlined else 1.0)) / 2.0, abs=1e-9)


def test_a_contact_names_a_polygon() -> None:
    corners = tuple(Point(x_m=x, y_m=y) for x, y in ((4.0, -1.0), (6.0, 0.0), (4.0, 1.0)))
    record = run_one(a_world(polygons=(Polygon(corners=corners),)), always(1.0))
    assert (record.reason, counted(record)) == ("hit polygon 0", (1, 0, 0))
    assert record.metrics["time_s"] == pytest.approx(3.0, abs=1e-9)


# --- how far the goal is at the end ---


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"time_limit_s": 4.0}, 6.0),
        ({"discs": (Disc(x_m=6.13, y_m=0.0, radius_m=1.0),)}, 5.87),
        ({"goal_tolerance_m": 0.05}, 0.05),
        ({"finish_line": FinishLine(x1_m=5.0, y1_m=-1.0, x2_m=5.0, y2_m=1.0)}, 5.0),
    ],
    ids=["timed out", "collided", "reached", "finished"],
)
def test_the_distance_to_the_goal_is_that_at_the_end(changes: dict[str, Any], expected: float) -> None:
    world = a_world(**{"goals": (Point(x_m=10.0, y_m=0.0),), "time_limit_s": 20.0, **changes})
    assert run_one(world, always(1.0)).metrics["goal_distance_m"] == pytest.approx(expected, abs=1e-9)


def test_each_robots_distance_is_to_its_own_goal_even_where_its_controller_fails_at_once() -> None:
    def fail(_: Observation) -> Command:
        raise RuntimeError("no luck")

    goals = (Point(x_m=0.0, y_m=30.0), Point(x_m=4.0, y_m=13.0))
    world = a_world(starts=starts((0, 0, 0), (0, 10, 0)), goals=goals, time_limit_s=1.0)
    records = run(world, [Scripted(fail), always(0.0)])
    assert [record.metrics["goal_distance_m"] for record in records] == pytest.approx([30.0, 5.0])


# --- the scene ---


@pytest.fixture(scope="module")
def mixed() -> DrawnWorld:
    outlines = [SQUARE, (), SQUARE[:3], ()]
    movers = tuple(
        to_and_fro((float(k), 0.0), (float(k), 50.0), speeds=[1.0 + k], radius_m=0.8, outline=outline)
        for k, outline in enumerate(outlines)
    )
    square = tuple(Point(x_m=20.0 + p.x_m, y_m=p.y_m) for p in SQUARE)
    disc = Disc(x_m=-30.0, y_m=0.0, radius_m=2.0)
    return a_world(movers=movers, polygons=(Polygon(corners=square),), discs=(disc,))


def test_movers_keep_their_numbers_and_places_whatever_their_shape(mixed: DrawnWorld) -> None:
    scene = Scene(mixed)
    scene.move_to(2.0)
    places = dict(zip(scene.mover_order(), scene.mover_places().tolist(), strict=True))
    assert places == {k: [float(k), 2.0 * (1.0 + k)] for k in range(4)}
    assert places == {k: list(mover.place(2.0)) for k, mover in enumerate(mixed.movers)}
    assert scene.fastest_mps == 4.0


def test_the_circles_hold_everything_that_is_not_a_box(mixed: DrawnWorld) -> None:
    scene = Scene(mixed)
    scene.move_to(1.0)
    found = {tuple(row) for row in np.round(scene.circles(), 12).tolist()}
    corner = round(math.sqrt(0.5), 12)
    moving = {(float(k), 1.0 + k, 0.8, 0.0, 1.0 + k) for k in range(4)}
    assert found == {(-30.0, 0.0, 2.0, 0.0, 0.0), (20.0, 0.0, corner, 0.0, 0.0)} | moving


def test_the_distance_in_a_scene_follows_its_movers(mixed: DrawnWorld) -> None:
    scene = Scene(mixed)
    assert scene.distance(-3.0, 0.0) == pytest.approx(2.5)  # to the left side of the first one's square
    scene.move_to(2.0)
    assert scene.distance(-3.0, 0.0) == pytest.approx(math.hypot(2.5, 1.5))
    assert Scene(a_world()).distance(0.0, 0.0) == math.inf


def test_a_prism_has_two_triangles_a_side_and_no_repeated_corner(mixed: DrawnWorld) -> None:
    rows = Scene(mixed).polygons
    three = next(row for row in rows if len({tuple(c) for c in row[5:].reshape(-1, 2).tolist()}) == 3)
    for row, corners in ((rows[0], 4), (three, 3)):
        vertices, indices = prism(row, 2.0)
        assert len(vertices) == len(set(vertices)) == 2 * corners
        assert len(indices) == 6 * corners
        triangles = np.array(vertices)[np.array(indices).reshape(-1, 3)]
        areas = 0.5 * np.linalg.norm(
            np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
        )
        around = np.array(vertices)[:corners, :2]
        lengths = np.hypot(*(np.roll(around, -1, axis=0) - around).T)
        assert areas.sum() == pytest.approx(4.0 * lengths.sum())
        assert areas.min() > 0.0


def test_a_standing_scene_moves_nothing() -> None:
    scene = Scene(a_world(discs=(Disc(x_m=9.0, y_m=0.0, radius_m=1.0),)))
    scene.move_to(5.0)
    assert scene.mover_order() == []
    assert scene.mover_places().shape == (0, 2)
    assert scene.fastest_mps == 0.0
