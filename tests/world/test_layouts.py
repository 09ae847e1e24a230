import dataclasses
import math
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import a_ring, a_robot, a_runner
from shapes import Block, Round, Shard

from navbench.cli import main as cli
from navbench.cli.configuration import compose_cell
from navbench.cli.worlds import world_of
from navbench.contract import Command, Observation, Setup
from navbench.sensors import Tracker
from navbench.validation import DescriptionError
from navbench.world.generators import Scattered
from navbench.world.generators.polygons import convex_corners
from navbench.world.generators.swap import Swap
from navbench.world.layout import DrawnWorld, Layout, layout_of
from navbench.world.shapes import Bounds, Mover, Polygon, check_convex
from navbench.world.world import World

ROUND = {"count": [2, 5], "radius_m": [1.0, 2.5]}
EDGED = {**ROUND, "corners": [3, 6]}
WANDER = {
    **EDGED,
    "radius_m": [0.5, 1.5],
    "speed_mps": [0.4, 2.0],
    "leg_m": [3.0, 20.0],
    "polygon_share": 0.5,
    "duration_s": 90.0,
}
CIRCLE = {"robots": 6, "radius_m": 20.0, "spacing_m": 4.0}
PLANE: dict[str, Any] = {
    "name": "drawn",
    "bounds": {"x_min_m": -30.0, "x_max_m": 40.0, "y_min_m": -25.0, "y_max_m": 25.0},
    "goal_tolerance_m": 0.5,
    "time_limit_s": 90.0,
}
WAYS: dict[str, Any] = {
    "starts": [{"x_m": -25.0, "y_m": -20.0}, {"x_m": 35.0, "y_m": 20.0}],
    "goals": [{"x_m": 35.0, "y_m": -20.0}, {"x_m": -25.0, "y_m": 20.0}],
}
STANDING: dict[str, Any] = {
    "boxes": [{"x_m": 5.0, "y_m": 0.0, "length_m": 10.0, "width_m": 4.0, "heading_rad": 0.6}],
    "discs": [{"x_m": -15.0, "y_m": 10.0, "radius_m": 3.0}],
    "polygons": [{"corners": [{"x_m": 20.0, "y_m": -5.0}, {"x_m": 30.0, "y_m": -2.0}, {"x_m": 21.0, "y_m": 6.0}]}],
}
GAP_M = 1.5
ALL = {"discs": ROUND, "polygons": EDGED, "movers": WANDER}


def a_layout(parts: Mapping[str, Any], **more: Any) -> World:
    """Return a world with these parts drawn between what stands in the plane, and two robots' starts and goals."""
    own = {key: more.pop(key, PLANE[key]) for key in ("name", "goal_tolerance_m", "time_limit_s")}
    base = {"_target_": "navbench.world.Layout", "bounds": PLANE["bounds"], **WAYS, **more}
    return a_source(scattered(parts, base), **own)


def scattered(parts: Mapping[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
    """Return parts over a base, as a YAML file holds them."""
    targets = {"discs": "Discs", "polygons": "Polygons", "movers": "Wander"}
    named = {name: {"_target_": f"navbench.world.generators.{targets[name]}", **part} for name, part in parts.items()}
    return {"_target_": "navbench.world.generators.Scattered", "gap_m": GAP_M, "base": base, "parts": named}


def a_swap(**changes: Any) -> dict[str, Any]:
    """Return robots that swap, as a YAML file holds them."""
    return {"_target_": "navbench.world.generators.Swap", "bounds": PLANE["bounds"], **CIRCLE, **changes}


def a_source(source: Mapping[str, Any], name: str = "drawn", **changes: Any) -> World:
    """Return a world with this source."""
    own = {key: PLANE[key] for key in ("goal_tolerance_m", "time_limit_s")}
    return world_of({"source": source, **own, **changes}, name)[0]


def standing_of(world: World) -> Layout:
    """Return what a world's parts are drawn onto."""
    assert isinstance(world.source, Scattered)
    assert isinstance(world.source.base, Layout)
    return world.source.base


def around(polygon: Polygon) -> Round:
    """Return the circle through the first three corners of a polygon."""
    a, b, c = (complex(p.x_m, p.y_m) for p in polygon.corners[:3])
    w = (c - a) / (b - a)
    centre = a + (b - a) * (w - abs(w) ** 2) / (2j * w.imag)
    return Round(centre, abs(a - centre))


def circles_of(world: DrawnWorld, discs_before: int = 0, polygons_before: int = 0) -> list[Round]:
    """Return the circles of what was drawn, movers left out."""
    rounds = [Round(complex(disc.x_m, disc.y_m), disc.radius_m) for disc in world.discs[discs_before:]]
    return rounds + [around(polygon) for polygon in world.polygons[polygons_before:]]


def lies_inside(bounds: Bounds, x_m: float, y_m: float, radius_m: float) -> bool:
    hair = 1e-9
    return (
        bounds.x_min_m + radius_m <= x_m + hair
        and x_m <= bounds.x_max_m - radius_m + hair
        and bounds.y_min_m + radius_m <= y_m + hair
        and y_m <= bounds.y_max_m - radius_m + hair
    )


def ends_of(world: Layout) -> list[complex]:
    """Return every start and every goal."""
    starts = [complex(start.x_m, start.y_m) for start in world.starts]
    return starts + [complex(goal.x_m, goal.y_m) for goal in world.goals]


def legs_of(mover: Mover) -> list[tuple[float, float]]:
    """Return the length of each leg and how long it takes, on the way out."""
    pairs = zip(mover.waypoints[:-1], mover.waypoints[1:], mover.speeds_mps, strict=True)
    lengths = [(math.hypot(b.x_m - a.x_m, b.y_m - a.y_m), speed) for a, b, speed in pairs]
    return [(length, length / speed) for length, speed in lengths]


# --- the same for every controller, other ones in each episode ---


def test_a_seed_and_an_episode_draw_the_same_layout_whatever_was_drawn_before() -> None:
    one, other = a_layout(ALL), a_layout(ALL)
    drawn = [one.drawn_for(7, episode) for episode in range(5)]
    assert [other.drawn_for(7, episode) for episode in reversed(range(5))] == drawn[::-1]


def test_other_episodes_seeds_and_names_draw_other_layouts() -> None:
    world = a_layout(ALL)
    drawn = [world.drawn_for(seed, episode) for seed in range(3) for episode in range(20)]
    drawn.append(a_layout(ALL, name="called otherwise").drawn_for(0, 0))
    assert len({(one.discs, one.polygons, one.movers) for one in drawn}) == len(drawn)


class Gambler:
    """Drives by chance, or stands, and remembers what it saw first."""

    def __init__(self, gambles: bool) -> None:
        self.gambles = gambles

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        self.rng, self.first = rng, b""

    def act(self, observation: Observation) -> Command:
        self.first = self.first or observation.discs.tobytes() + observation.ranges_m.tobytes()
        return Command(float(self.rng.uniform()) if self.gambles else 0.0, 0.0)


def test_every_controller_meets_the_layout_that_the_world_draws() -> None:
    world = a_layout(ALL, time_limit_s=0.3)
    ring = a_ring(8, 0.4, 30.0, tracker=Tracker(range_m=1000.0))
    firsts = []
    for gambles, episodes in ((False, [4]), (True, [0, 9, 4])):
        controllers = [Gambler(gambles), Gambler(gambles)]
        with a_runner(world, controllers, robot=a_robot(0.4), sensors=ring, seed=3) as runner:
            for episode in episodes:
                assert [record.outcome for record in runner.run(episode)] == ["timed_out"] * 2
        firsts.append([controller.first for controller in controllers])
    assert firsts[0] == firsts[1]
    drawn = world.drawn_for(3, 4)
    discs = np.frombuffer(firsts[0][0])[:-8].reshape(-1, 5)
    assert len(discs) == len(drawn.discs) + len(drawn.polygons) + len(drawn.movers) + 1  # and the other robot
    assert discs[: len(drawn.discs), :3].tolist() == [[d.x_m, d.y_m, d.radius_m] for d in drawn.discs]


def test_a_layout_draws_itself() -> None:
    drawn = a_layout(ALL).drawn_for(0, 0)
    assert drawn.draw(np.random.default_rng(1), 1) is drawn


def test_a_layout_comes_back_from_its_json_to_the_last_bit() -> None:
    for episode in range(40):
        drawn = a_layout(ALL, **STANDING).drawn_for(0, episode)
        own = {item.name: getattr(drawn, item.name) for item in dataclasses.fields(Layout)}
        assert layout_of(drawn.to_json()) == Layout(**own)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "layout: Invalid JSON: EOF"),
        ('{"discs": [{"x_m": "far"}]}', "layout.bounds: "),
        ("[" * 10**5, "layout: Invalid JSON: recursion limit"),
    ],
)
def test_what_is_no_layout_is_refused_in_one_line(text: str, said: str) -> None:
    with pytest.raises(DescriptionError) as error:
        layout_of(text)
    assert str(error.value).startswith(said)
    assert "\n" not in str(error.value)


def test_what_stands_in_the_world_stays_in_front_of_what_is_drawn() -> None:
    world = a_layout(ALL, **STANDING)
    drawn, base = world.drawn_for(0, 0), standing_of(world)
    assert drawn.boxes == base.boxes
    assert drawn.discs[:1] == base.discs
    assert drawn.polygons[:1] == base.polygons
    assert (drawn.starts, drawn.goals, drawn.bounds) == (base.starts, base.goals, base.bounds)


# --- room ---


def test_every_drawn_obstacle_lies_inside_with_the_gap_to_ends_to_what_stands_and_to_each_other() -> None:
    world = a_layout({"discs": ROUND, "polygons": EDGED}, **STANDING)
    base = standing_of(world)
    ends = ends_of(base)
    (box,), (disc,), (polygon,) = base.boxes, base.discs, base.polygons
    turn = complex(math.cos(box.heading_rad), math.sin(box.heading_rad))
    standing: list[Round | Block | Shard] = [
        Block(complex(box.x_m, box.y_m), turn, 0.5 * box.length_m, 0.5 * box.width_m),
        Round(complex(disc.x_m, disc.y_m), disc.radius_m),
        Shard(tuple(complex(p.x_m, p.y_m) for p in polygon.corners)),
    ]
    nearest = math.inf
    for episode in range(100):
        drawn = circles_of(world.drawn_for(1, episode), 1, 1)
        for i, (centre, radius) in enumerate(drawn):
            assert lies_inside(base.bounds, centre.real, centre.imag, radius)
            others = [other.away(centre) for other in (*standing, *drawn[:i], *drawn[i + 1 :])]
            free = min([abs(centre - end) for end in ends] + others) - radius
            assert free >= GAP_M - 1e-9
            nearest = min(nearest, free)
    assert nearest < GAP_M + 0.1  # and no more than the gap is asked for


def test_counts_radii_and_corners_fill_their_spans_and_never_leave_them() -> None:
    world = a_layout({"discs": ROUND, "polygons": EDGED})
    drawn = [world.drawn_for(0, episode) for episode in range(150)]
    for counts in ([len(one.discs) for one in drawn], [len(one.polygons) for one in drawn]):
        assert set(counts) == {2, 3, 4, 5}
    assert {len(polygon.corners) for one in drawn for polygon in one.polygons} == {3, 4, 5, 6}
    for radii in (
        [disc.radius_m for one in drawn for disc in one.discs],
        [around(polygon).radius for one in drawn for polygon in one.polygons],
    ):
        assert 1.0 - 1e-9 <= min(radii) < 1.05
        assert 2.45 < max(radii) <= 2.5 + 1e-9


def test_a_span_of_one_value_draws_this_value() -> None:
    exact = {"count": [3, 3], "radius_m": [1.25, 1.25], "corners": [4, 4]}
    movers = {**exact, "duration_s": 90.0, "speed_mps": [0.7, 0.7], "leg_m": [5.0, 5.0], "polygon_share": 1.0}
    discs = {name: exact[name] for name in ("count", "radius_m")}
    drawn = a_layout({"discs": discs, "polygons": exact, "movers": movers}).drawn_for(0, 0)
    assert [disc.radius_m for disc in drawn.discs] == [1.25] * 3
    assert [len(polygon.corners) for polygon in drawn.polygons] == [4] * 3
    assert [around(polygon).radius for polygon in drawn.polygons] == pytest.approx([1.25] * 3)
    assert [(mover.radius_m, len(mover.outline)) for mover in drawn.movers] == [(1.25, 4)] * 3
    assert {speed for mover in drawn.movers for speed in mover.speeds_mps} == {0.7}
    legs = [leg for mover in drawn.movers for leg, _ in legs_of(mover)]
    assert legs == pytest.approx([5.0] * 3 * math.ceil(90.0 * 0.7 / 5.0))


def test_a_count_from_0_may_draw_nothing() -> None:
    world = a_layout({"discs": {**ROUND, "count": [0, 1]}})
    assert {len(world.drawn_for(0, episode).discs) for episode in range(30)} == {0, 1}


@pytest.mark.parametrize(("x_min_m", "x_max_m", "fits"), [(0.0, 0.5, True), (0.0, 0.4999, False), (0.1, 0.6, True)])
def test_a_disc_as_wide_as_the_bounds_has_just_room(x_min_m: float, x_max_m: float, fits: bool) -> None:
    tight = {"bounds": {"x_min_m": x_min_m, "x_max_m": x_max_m, "y_min_m": -9.0, "y_max_m": 9.0}}
    ways = {"starts": [{"x_m": 0.4, "y_m": 9.0}], "goals": [{"x_m": 0.4, "y_m": -9.0}]}
    world = a_layout({"discs": {"count": [1, 1], "radius_m": [0.25, 0.25]}}, **tight, **ways)
    if fits:
        (disc,) = world.drawn_for(0, 0).discs
        assert disc.x_m == pytest.approx(x_min_m + 0.25)
    else:
        with pytest.raises(DescriptionError, match="no room"):
            world.drawn_for(0, 0)


def test_room_that_rounding_takes_away_is_no_room_and_no_failure() -> None:
    assert 0.7 - 0.1 >= 2.0 * 0.3 > (0.7 - 0.3) - (0.1 + 0.3) + 2.0 * 0.3
    tight = {"bounds": {"x_min_m": 0.1, "x_max_m": 0.7, "y_min_m": -9.0, "y_max_m": 9.0}}
    ways = {"starts": [{"x_m": 0.4, "y_m": 9.0}], "goals": [{"x_m": 0.4, "y_m": -9.0}]}
    with pytest.raises(DescriptionError, match="no room"):
        a_layout({"discs": {"count": [1, 1], "radius_m": [0.3, 0.3]}}, **tight, **ways).drawn_for(0, 0)


# --- polygons ---


@pytest.mark.parametrize("corners", [3, 4, 5, 12])
def test_a_drawn_polygon_is_convex_lies_on_its_circle_and_holds_its_centre(corners: int) -> None:
    rng = np.random.default_rng(corners)
    deepest, shallowest = -math.inf, math.inf
    for _ in range(500):
        drawn = convex_corners(rng, 2.0, (corners, corners))
        check_convex("corners", drawn)
        assert [math.hypot(p.x_m, p.y_m) for p in drawn] == pytest.approx([2.0] * corners, rel=1e-12)
        depth = -Shard(tuple(complex(p.x_m, p.y_m) for p in drawn)).away(0j)
        deepest, shallowest = max(deepest, depth), min(shallowest, depth)
    assert shallowest > 0.0
    assert deepest > 1.03 * shallowest  # they are irregular


# --- wandering movers ---


@pytest.fixture(scope="module")
def wandering() -> list[DrawnWorld]:
    world = a_layout({"movers": {**WANDER, "count": [1, 4]}}, **STANDING)
    return [world.drawn_for(0, episode) for episode in range(40)]


def test_movers_stay_whole_inside_the_bounds_for_the_whole_time_limit(wandering: list[DrawnWorld]) -> None:
    for world in wandering:
        for t_s in np.linspace(0.0, world.time_limit_s, 181).tolist():
            for rows in (world.disc_rows(t_s)[1:], world.polygon_rows(t_s)[1:]):
                assert all(lies_inside(world.bounds, x, y, radius) for x, y, radius in rows[:, :3].tolist())


def test_movers_do_not_turn_back_on_their_way_before_the_time_limit(wandering: list[DrawnWorld]) -> None:
    for mover in (mover for world in wandering for mover in world.movers):
        spent = [seconds for _, seconds in legs_of(mover)]
        assert sum(spent) >= 90.0 > sum(spent[:-1])


def test_legs_and_speeds_fill_their_spans_and_legs_go_in_every_direction(wandering: list[DrawnWorld]) -> None:
    movers = [mover for world in wandering for mover in world.movers]
    assert {len(world.movers) for world in wandering} == {1, 2, 3, 4}
    legs = [length for mover in movers for length, _ in legs_of(mover)]
    speeds = [speed for mover in movers for speed in mover.speeds_mps]
    for values, (low, high) in ((legs, (3.0, 20.0)), (speeds, (0.4, 2.0))):
        width = high - low
        assert low - 1e-9 <= min(values) < low + 0.05 * width
        assert high - 0.05 * width < max(values) <= high + 1e-9
    ways = [complex(vx, vy) for mover in movers for vx, vy in mover.schedule()[: len(mover.speeds_mps), 4:]]
    turns = np.histogram(np.angle(ways), 8, (-math.pi, math.pi))[0]
    assert turns.min() > 0.5 * turns.mean()
    assert all(len(set(mover.speeds_mps)) == len(mover.speeds_mps) for mover in movers)  # a new one with every leg


def test_movers_begin_with_the_gap_to_starts_and_goals_and_may_stand_over_obstacles(
    wandering: list[DrawnWorld],
) -> None:
    over, nearest = 0, math.inf
    for world in wandering:
        for mover in world.movers:
            place = complex(*mover.place(0.0))
            assert place == complex(mover.waypoints[0].x_m, mover.waypoints[0].y_m)
            nearest = min(nearest, *(abs(place - end) - mover.radius_m for end in ends_of(world)))
            over += abs(place - (-15 + 10j)) < mover.radius_m + 3.0
    assert GAP_M <= nearest < GAP_M + 3.0
    assert over > 0


@pytest.mark.parametrize(("share", "low", "high"), [(0.0, 0.0, 0.0), (0.3, 0.15, 0.45), (1.0, 1.0, 1.0)])
def test_the_share_of_polygons_among_movers_is_as_asked(share: float, low: float, high: float) -> None:
    world = a_layout({"movers": {**WANDER, "polygon_share": share}}, time_limit_s=1.0)
    movers = [mover for episode in range(40) for mover in world.drawn_for(0, episode).movers]
    assert low <= sum(bool(mover.outline) for mover in movers) / len(movers) <= high
    for mover in movers:
        assert len(mover.outline) in (0, 3, 4, 5, 6)
        assert [math.hypot(p.x_m, p.y_m) for p in mover.outline] == pytest.approx([mover.radius_m] * len(mover.outline))


# --- robots that swap ---


@pytest.mark.parametrize("robots", [2, 3, 6, 40, 100])
@pytest.mark.parametrize("radius_m", [20.0, 27.0])
def test_swapping_robots_start_opposite_their_goals_on_a_circle_that_grows_with_them(
    robots: int, radius_m: float
) -> None:
    world = a_source(a_swap(robots=robots, radius_m=radius_m))
    assert world.robots == robots
    drawn = world.drawn_for(0, 5)
    starts = [complex(start.x_m, start.y_m) for start in drawn.starts]
    goals = [complex(goal.x_m, goal.y_m) for goal in drawn.goals]
    assert len(starts) == len(goals) == robots == drawn.robots
    centre, circle = complex(5.0, 0.0), max(radius_m, robots * 4.0 / math.tau)
    assert [abs(start - centre) for start in starts] == pytest.approx([circle] * robots)
    assert [start + goal for start, goal in zip(starts, goals, strict=True)] == pytest.approx([2.0 * centre] * robots)
    turns = [
        math.remainder(float(np.angle((b - centre) / (a - centre))), math.tau)
        for a, b in zip(starts[:-1], starts[1:], strict=True)
    ]
    assert np.abs(turns) == pytest.approx([math.tau / robots] * (robots - 1))
    assert circle * math.tau / robots >= 4.0 - 1e-9
    nearest = min(abs(a - b) for i, a in enumerate(starts) for b in starts[:i])
    assert Swap(bounds=drawn.bounds, robots=robots, radius_m=radius_m, spacing_m=4.0).neighbours_m() == pytest.approx(
        nearest
    )
    assert all(lies_inside(drawn.bounds, end.real, end.imag, 4.0) for end in starts + goals)
    headings = [drawn.start_heading_rad(i) for i in range(robots)]
    assert headings == pytest.approx([float(np.angle(centre - start)) for start in starts])


def test_the_bounds_grow_only_as_far_as_the_circle_and_its_spacing_need() -> None:
    tall = a_source(a_swap(radius_m=27.0)).drawn_for(0, 0).bounds
    assert (tall.x_min_m, tall.x_max_m, tall.y_min_m, tall.y_max_m) == (-30.0, 40.0, -31.0, 31.0)
    small = a_source(a_swap()).drawn_for(0, 0).bounds
    assert (small.x_min_m, small.x_max_m, small.y_min_m, small.y_max_m) == tuple(PLANE["bounds"].values())


def test_the_circle_is_turned_at_random() -> None:
    world = a_source(a_swap())
    firsts = [world.drawn_for(0, episode).starts[0] for episode in range(60)]
    turns = np.histogram([math.atan2(first.y_m, first.x_m - 5.0) for first in firsts], 4, (-math.pi, math.pi))[0]
    assert turns.min() >= 5


def test_obstacles_keep_the_gap_to_swapping_robots_too() -> None:
    world = a_source(scattered({"discs": ROUND}, a_swap(robots=12)))
    for episode in range(20):
        drawn = world.drawn_for(0, episode)
        ends = ends_of(drawn)
        assert drawn.discs
        for disc in circles_of(drawn):
            assert min(disc.away(end) for end in ends) >= GAP_M - 1e-9


def test_a_hundred_swapping_robots_drive() -> None:
    words = ("world=swap_circle", "world.source.robots=100", "controller=go_to_goal", "world.time_limit_s=2.0")
    cell = compose_cell(*words)
    with cell.runner() as runner:
        records = runner.run(0)
    assert len(records) == 100
    for record in records:
        assert record.outcome == "timed_out"  # the circle is 254 m wide
        assert record.metrics["path_length_m"] > 1.0


# --- what is refused ---


def square(*corners: tuple[float, float]) -> list[dict[str, float]]:
    return [{"x_m": x, "y_m": y} for x, y in corners]


DART = square((0.0, 0.0), (4.0, 0.0), (1.0, 1.0), (0.0, 4.0))
STAR = square(*((3.0 * math.cos(0.8 * math.pi * k), 3.0 * math.sin(0.8 * math.pi * k)) for k in range(5)))
LINE = square((0.0, 0.0), (1.0, 0.0), (2.0, 0.0))
OUTSIDE = square((35.0, 0.0), (41.0, 0.0), (35.0, 5.0))
LATE = square((0.9, 0.0), (0.0, 1.01), (-0.9, 0.0))
ASIDE = square((0.2, 0.2), (0.6, 0.2), (0.2, 0.6))
MOVING = {"radius_m": 1.0, "waypoints": square((0.0, 0.0), (9.0, 0.0)), "speeds_mps": [1.0]}

WRONG_PARTS: list[tuple[dict[str, Any], list[str]]] = [
    (
        {"discs": {**ROUND, "radius_m": [2.0, 1.0]}},
        ["discs.radius_m", "[2.0, 1.0]", "must not be above the second"],
    ),
    ({"polygons": {**EDGED, "corners": [6, 3]}}, ["polygons.corners", "[6, 3]"]),
    ({"movers": {**WANDER, "speed_mps": [2.0, 1.0]}}, ["movers.speed_mps", "[2.0, 1.0]"]),
    ({"discs": {**ROUND, "count": [0, 0]}}, ["discs.count[1]=0", "or equal to 1"]),
    ({"discs": {**ROUND, "count": [-1, 2]}}, ["discs.count[0]=-1", "or equal to 0"]),
    ({"movers": {**WANDER, "count": [1, 1001]}}, ["movers.count[1]=1001", "less than or equal to 1000"]),
    ({"polygons": {**EDGED, "corners": [3, 101]}}, ["polygons.corners[1]=101", "less than or equal to 100"]),
    ({"discs": {**ROUND, "count": [1.0, 2.5]}}, ["discs.count", "whole number"]),
    ({"discs": {**ROUND, "radius_m": [0.0, 1.0]}}, ["discs.radius_m[0]=0.0", "equal to 0.000001"]),
    ({"polygons": {**EDGED, "radius_m": [1e-17, 1.0]}}, ["polygons.radius_m[0]=1e-17", "equal to 0.000001"]),
    ({"polygons": {**EDGED, "corners": [2, 4]}}, ["polygons.corners[0]=2", "greater than or equal to 3"]),
    ({"movers": {**WANDER, "polygon_share": 1.5}}, ["movers.polygon_share=1.5", "equal to 1"]),
    ({"movers": {**WANDER, "leg_m": [1e-6, 1e-6]}}, ["movers.leg_m: [1e-06, 1e-06]", "more than 100000 legs"]),
    ({"discs": {**ROUND, "radii_m": 1.0}}, ["discs.radii_m: unknown key", "count, radius_m"]),
]


@pytest.mark.parametrize(("parts", "words"), WRONG_PARTS)
def test_an_error_in_a_part_names_its_key_its_value_and_what_is_allowed(
    parts: dict[str, Any], words: list[str]
) -> None:
    with pytest.raises(DescriptionError) as caught:
        a_layout(parts)
    said = str(caught.value)
    assert said.startswith(f"world.source.parts.{words[0]}")
    assert "\n" not in said
    for word in words:
        assert word in said, said


WRONG_VALUES: list[tuple[dict[str, Any], list[str]]] = [
    ({"source": a_swap(robots=1)}, ["world.source.robots=1", "greater than or equal to 2"]),
    ({"source": a_swap(robots=1001)}, ["world.source.robots=1001", "or equal to 1000"]),
    ({"source": a_swap(), "starts": WAYS["starts"]}, ["world.starts: must be empty", "world.source draws"]),
    ({"source": {"robots": 3}}, ["world.source._target_: missing", "draw(rng, episode)"]),
    ({"source": {"_target_": "math.tau"}}, ["world.source._target_=math.tau: ", "draw(rng, episode)"]),
    ({"source": {"_target_": "navbench.world.Disc", "x_m": 1.0}}, ["world.source._target_=navbench.world.Disc: "]),
    ({"source": {"_target_": "no_such.Thing"}}, ["world.source._target_=no_such.Thing: cannot be imported"]),
    ({"source": {**scattered({}, a_swap()), "gap_m": 0.0}}, ["world.source.gap_m=0.0", "than 0"]),
    ({"source": scattered({}, WAYS)}, ["world.source.base=", "must be an instance of Source"]),
    ({"starts": [], "goals": []}, ["world.goals: ", "at least one", "got 0 for 0"]),
    ({"polygons": [{"corners": DART}]}, ["world.polygons[0].corners: ", "convex"]),
    ({"polygons": [{"corners": STAR}]}, ["world.polygons[0].corners: ", "convex"]),
    ({"polygons": [{"corners": LINE}]}, ["world.polygons[0].corners: ", "convex"]),
    ({"polygons": [{"corners": DART[:2]}]}, ["world.polygons[0].corners: ", "at least 3", "got 2"]),
    ({"polygons": [{"corners": OUTSIDE}]}, ["world.polygons[0]: ", "inside the bounds x [-30.0, 40.0]"]),
    ({"movers": [{**MOVING, "outline": DART}]}, ["world.movers[0].outline: ", "convex"]),
    ({"movers": [{**MOVING, "outline": ASIDE}]}, ["world.movers[0].outline: ", "must hold its centre"]),
    ({"movers": [{**MOVING, "outline": ASIDE[::-1]}]}, ["world.movers[0].outline: ", "must hold its centre"]),
    ({"movers": [{**MOVING, "waypoints": square((0.0, 0.0), (1e-300, 0.0)), "speeds_mps": [1e300]}]},
     ["world.movers[0].speeds_mps: ", "finite and above 0"]),
    ({"movers": [{**MOVING, "speeds_mps": [1e-309]}]}, ["world.movers[0].speeds_mps: ", "finite and above 0"]),
    ({"movers": [{**MOVING, "outline": LATE}]}, ["world.movers[0].outline: ", "within the radius, 1.0 m"]),
    ({"goals": [{"x_m": 22.0, "y_m": 0.0}] * 2, **{"polygons": STANDING["polygons"]}},
     ["world.goals[0]: (22.0, 0.0)", "outside every obstacle"]),
]  # fmt: skip


def a_world_of(changes: Mapping[str, Any]) -> World:
    """Return a world that lists these things, or has a source."""
    drawn = () if "source" in changes else ("bounds",)
    own = {key: PLANE[key] for key in (*drawn, "goal_tolerance_m", "time_limit_s")}
    return world_of({**own, **(WAYS if drawn else {}), **changes}, "drawn")[0]


@pytest.mark.parametrize(("changes", "words"), WRONG_VALUES)
def test_an_error_in_a_world_names_its_key_its_value_and_what_is_allowed(
    changes: dict[str, Any], words: list[str]
) -> None:
    with pytest.raises(DescriptionError) as caught:
        a_world_of(changes)
    said = str(caught.value)
    assert "\n" not in said
    for word in words:
        assert word in said, said


def test_a_clockwise_polygon_is_as_good_as_the_other_way_round() -> None:
    turned = {"polygons": [{"corners": STANDING["polygons"][0]["corners"][::-1]}]}
    here, there = (
        a_world_of(more).drawn_for(0, 0).polygon_rows() for more in (turned, {"polygons": STANDING["polygons"]})
    )
    assert {tuple(c) for c in here[0, 5:].reshape(-1, 2)} == {tuple(c) for c in there[0, 5:].reshape(-1, 2)}


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        (
            {"discs": {"count": [30, 30], "radius_m": [6.0, 6.0]}},
            ["no room for discs of radius 6 m", "; 97 % of"],
        ),
        ({"polygons": {**EDGED, "radius_m": [30.0, 30.0]}}, ["no room for polygons of radius 30 m"]),
        ({"movers": {**WANDER, "radius_m": [26.0, 26.0]}}, ["no room for movers of radius 26 m", "gap_m=1.5"]),
        ({"movers": {**WANDER, "leg_m": [99.0, 120.0]}}, ["no leg of a mover with leg_m=[99.0, 120.0] fits"]),
    ],
)
def test_what_finds_no_room_in_a_hundred_draws_says_where_and_how_dense_it_is(
    parts: dict[str, Any], words: list[str]
) -> None:
    with pytest.raises(DescriptionError) as caught:
        a_layout(parts).drawn_for(3, 7)
    said = str(caught.value)
    assert "\n" not in said
    for word in ("world=drawn, seed=3, episode=7: ", "of the free area is asked for; tried 100 times", *words):
        assert word in said.replace("97%", "97 %"), said


MOVERS, SWAP = ("controller=go_to_goal", "world=random_movers"), ("controller=go_to_goal", "world=swap_circle")
TRIANGLE = "[{x_m: 45, y_m: 45}, {x_m: 55, y_m: 45}, {x_m: %d, y_m: 55}]"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((*MOVERS, "world.source.parts.discs.count=[3,1]"), "parts.discs.count: the first must not be above"),
        ((*MOVERS, "robot.radius_m=9.0"), "world.source.gap_m=9.0: must be more than the robot's radius 9.0 m"),
        ((*MOVERS, "world.discs=[{x_m: 9, y_m: 9, radius_m: 1}]"), "world.discs: must be empty, because world.source"),
        (("controller=go_to_goal", "world=empty_100", f"world.polygons=[{{corners: {TRIANGLE % 120}}}]"),
         "world.polygons[0]: must lie inside the bounds"),
        (("controller=go_to_goal", "world=empty_100", f"world.movers=[{{radius_m: 3, waypoints: [{{x_m: 9, y_m: 9}}, "
          f"{{x_m: 30, y_m: 9}}], speeds_mps: [1], outline: {TRIANGLE % 50}}}]"),
         "world.movers[0].outline: must lie within the radius, 3.0"),
        ((*SWAP, "world.source.robots=0"), "world.source.robots=0: must be greater than or equal to 2"),
        ((*SWAP, "world.source.robots=100", "world.source.spacing_m=2.0"), "world.source.spacing_m=2.0: "),
        ((*SWAP, "world.source=null"), "world.bounds: missing; a value is needed"),
    ],
)  # fmt: skip
def test_the_command_line_refuses_it_in_one_line_with_exit_code_2(
    words: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")
    monkeypatch.setattr(sys, "argv", ["navbench", *words])
    with pytest.raises(SystemExit) as end:
        cli.main()
    out, err = capfd.readouterr()
    assert (end.value.code, out) == (2, "")
    assert re.fullmatch(r"navbench: [^\n]{1,410}\n", err), err
    assert said in err
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
