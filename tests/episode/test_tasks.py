"""Which tasks no controller can do, on scenes whose answer is known."""

import math
from typing import Any

import numpy as np
import pytest
from scenes import BLOCK, a_robot, a_runner, a_world, always, starts

from navbench.episode.tasks import QUARTER, SLACK, FreeSpace
from navbench.world.grid import Grid
from navbench.world.layout import DrawnWorld, FinishLine, ImpossibleError
from navbench.world.shapes import Box, Disc, Mover, Point, Polygon, Wall
from navbench.world.world import World

R = 0.5
AHEAD = (Point(x_m=10.0, y_m=0.0),)
NOTHING_LEADS = r"^goals\[0\]: nothing leads there from starts\[0\] for a robot of radius 0.5 m$"


def a_room(x_m: float = 0.0, size_m: float = 6.0, door_m: float = 0.0, thickness_m: float = 0.1) -> tuple[Wall, ...]:
    """Return the walls of a square room around (x, 0), inside of their middles, with a door ahead."""
    half, low, high = 0.5 * size_m, x_m - 0.5 * size_m, x_m + 0.5 * size_m
    corners = [(low, -half, high, -half), (low, half, high, half), (low, -half, low, half)]
    ahead = (
        [(high, -half, high, -0.5 * door_m), (high, 0.5 * door_m, high, half)]
        if door_m
        else [(high, -half, high, half)]
    )
    return tuple(Wall(*ends, thickness_m) for ends in corners + ahead)


def is_possible(radius_m: float = R, **changes: Any) -> bool:
    world = a_world(**{"goals": AHEAD, "goal_tolerance_m": 0.1} | changes)
    try:
        FreeSpace(world, radius_m).check(world.starts)
    except ImpossibleError:
        return False
    return True


def pentagons(at: list[tuple[float, float]], size_m: float) -> tuple[Polygon, ...]:
    turns = [2.0 * math.pi * k / 5 for k in range(5)]
    return tuple(
        Polygon(corners=tuple(Point(x + size_m * math.cos(t), y + size_m * math.sin(t)) for t in turns)) for x, y in at
    )


def around(count: int, away_m: float) -> list[tuple[float, float]]:
    turns = [2.0 * math.pi * (k + 0.5) / count for k in range(count)]
    return [(away_m * math.cos(t), away_m * math.sin(t)) for t in turns]


@pytest.mark.parametrize(
    ("enclosing", "is_closed"),
    [
        ({"walls": a_room()}, True),
        ({"walls": a_room(door_m=0.9)}, True),
        ({"walls": a_room(door_m=1.1)}, False),
        ({"walls": a_room()[1:]}, False),
        ({"boxes": tuple(Box(x, y, 2.3, 2.3, 0.4) for x, y in around(8, 4.0))}, True),
        ({"discs": tuple(Disc(x, y, 1.3) for x, y in around(8, 4.0))}, True),
        ({"discs": tuple(Disc(x, y, 1.3) for x, y in around(8, 4.0)[1:])}, False),
        ({"polygons": pentagons(around(8, 4.0), 1.5)}, True),
        ({"grid": Grid.of(np.pad(np.zeros((8, 8)), 1, constant_values=1), 0.5, -2.5, -2.5)}, True),
    ],
)
def test_a_goal_outside_of_what_encloses_the_start_is_impossible(enclosing: dict[str, Any], is_closed: bool) -> None:
    assert is_possible(**enclosing) != is_closed
    assert is_possible(**enclosing, goals=(Point(x_m=1.0, y_m=1.0),)), "inside it can be reached"


def test_the_message_names_goal_start_and_radius() -> None:
    world = a_world(goals=AHEAD, walls=a_room())
    with pytest.raises(ImpossibleError, match=NOTHING_LEADS):
        FreeSpace(world, R).check(world.starts)


def test_a_ring_within_a_ring_parts_the_plane_in_three() -> None:
    nested = (*a_room(), *a_room(size_m=20.0))
    assert not is_possible(walls=nested, goals=(Point(x_m=6.0, y_m=0.0),))
    assert not is_possible(walls=nested, starts=starts((6, 0, 0)), goals=(Point(x_m=30.0, y_m=0.0),))
    assert is_possible(walls=nested, starts=starts((6, 0, 0)), goals=(Point(x_m=-6.0, y_m=0.0),))


@pytest.mark.parametrize("radius_m", [0.065, 0.5, 4.0])
def test_a_door_that_the_robot_touches_on_both_sides_counts_as_open_and_a_narrower_one_does_not(
    radius_m: float,
) -> None:
    for door_radii, is_open in ((2.0, True), (2.0 - 3.0 * SLACK, False)):
        room = a_room(door_m=door_radii)
        ends = [[radius_m * end for end in (wall.x1_m, wall.y1_m, wall.x2_m, wall.y2_m)] for wall in room]
        walls = tuple(Wall(x1, y1, x2, y2, 1e-9) for x1, y1, x2, y2 in ends)
        assert is_possible(radius_m, walls=walls, goals=(Point(10.0 * radius_m, 0.0),)) == is_open, door_radii


def test_round_things_are_never_larger_than_they_are() -> None:
    """Eight discs whose gaps are as wide as the robot, and then less by what a polygon of 64 corners may lose."""
    places = around(8, 4.0)
    side_m = math.dist(places[0], places[1])
    fits = 0.5 * side_m - R
    assert is_possible(discs=tuple(Disc(x, y, fits) for x, y in places))
    lost = (1.0 - math.cos(0.25 * math.pi / QUARTER)) * (fits + R) + SLACK * R
    assert not is_possible(discs=tuple(Disc(x, y, fits + 1.5 * lost) for x, y in places))


def test_a_goal_behind_a_wall_is_reached_from_this_side_within_its_tolerance() -> None:
    walls = a_room(thickness_m=1e-3)
    assert is_possible(walls=walls, goals=(Point(x_m=3.05, y_m=0.0),), goal_tolerance_m=0.6)
    assert not is_possible(walls=walls, goals=(Point(x_m=3.2, y_m=0.0),), goal_tolerance_m=0.6)


def test_a_finish_line_is_reached_where_any_of_it_is() -> None:
    def possible(y1_m: float, y2_m: float, **changes: Any) -> bool:
        return is_possible(finish_line=FinishLine(5.0, y1_m, 5.0, y2_m), **changes)

    assert possible(-1.0, 1.0)
    assert not possible(-1.0, 1.0, walls=a_room())
    assert possible(-9.0, 9.0, walls=a_room(size_m=12.0))
    assert possible(-1.0, 1.0, walls=a_room(x_m=10.0)), "the goal beyond it is a direction, and may lie in a room"


def test_movers_and_other_robots_block_nothing() -> None:
    mover = Mover(radius_m=3.0, waypoints=(Point(5.0, 0.0), Point(5.0, 0.1)), speeds_mps=(0.1,))
    assert is_possible(movers=(mover,))
    row = starts((0, 0, 0), *((1.5, y, 0) for y in range(-5, 6)))
    assert is_possible(starts=row, goals=tuple(Point(10.0, 3.0 * k) for k in range(12)))


@pytest.mark.parametrize(
    ("apart_m", "tolerance_m", "fits"), [(0.0, 0.1, False), (0.79, 0.1, False), (0.8, 0.1, True), (0.0, 0.5, True)]
)
def test_two_robots_need_room_at_their_goals(apart_m: float, tolerance_m: float, fits: bool) -> None:
    world = a_world(
        starts=starts((0, 0, 0), (0, 5, 0), (0, -9, 0)),
        goals=(Point(10.0, 0.0), Point(10.0, 9.0), Point(10.0, apart_m)),
        goal_tolerance_m=tolerance_m,
    )
    if fits:
        FreeSpace(world, R).check(world.starts)
        return
    with pytest.raises(
        ImpossibleError, match=rf"^goals\[2\]: lies {apart_m:g} m from goals\[0\], where two robots .* need 0.799 m"
    ):
        FreeSpace(world, R).check(world.starts)


def test_what_is_cheap_to_see_agrees_with_the_parts_of_the_plane() -> None:
    """Random scenes: where the quick looks say yes, so do the parts."""
    rng, seen = np.random.default_rng(3), {True: 0, False: 0}
    for _ in range(100):
        away_m, turn = rng.uniform(2.0, 6.0, 30), rng.uniform(-math.pi, math.pi, 30)
        places = np.column_stack([away_m * np.cos(turn), away_m * np.sin(turn), rng.uniform(0.3, 1.2, 30)])
        goal = Point(*rng.uniform(-7.0, 7.0, 2).tolist())
        discs = tuple(
            Disc(*place) for place in places.tolist() if math.dist(place[:2], (goal.x_m, goal.y_m)) > place[2]
        )
        space = FreeSpace(a_world(goals=(goal,), discs=discs), R)
        start = space.world.starts[0]
        joins = space._joins(start, 0)
        seen[joins] += 1
        assert joins or not (space._is_whole or space._is_straight(start, 0))
    assert min(seen.values()) > 0


def test_an_impossible_task_is_not_run_and_is_no_failure() -> None:
    class Sometimes:
        robots = 1

        def draw(self, rng: np.random.Generator, episode: int) -> DrawnWorld:
            return a_world(goals=AHEAD, walls=a_room() if episode == 1 else ())

    world = World(name="some", source=Sometimes(), goal_tolerance_m=0.1, time_limit_s=10.0)
    with a_runner(world, always(0.0), robot=a_robot(R), options=BLOCK) as runner:
        assert [runner.run(0)[0].outcome for _ in range(2)] == ["timed_out"] * 2
        (record,) = runner.run(1)
    assert (record.outcome, record.reason) == ("impossible", NOTHING_LEADS.strip("^$").replace("\\", ""))
    assert len(record.states) == 0
    assert record.layout is None
