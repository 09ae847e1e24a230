import math

import numpy as np
import pytest
from scenes import BLIND, BLOCK, a_robot, a_runner, a_world, always

from navbench.episode.starts import Jitter, draw_starts
from navbench.episode.tasks import FreeSpace
from navbench.validation import DescriptionError
from navbench.world.generators import Discs, Scattered, Swap
from navbench.world.layout import Layout, Start
from navbench.world.shapes import Bounds, Disc, Point, Polygon
from navbench.world.world import Source, World

PLANE = Bounds(x_min_m=-40.0, x_max_m=40.0, y_min_m=-40.0, y_max_m=40.0)
SWAP = Swap(bounds=PLANE, robots=40, radius_m=20.0, spacing_m=4.0)  # the circle grows to 160 m around
WEDGE = Polygon(corners=(Point(x_m=1.5, y_m=0.0), Point(x_m=4.0, y_m=-2.0), Point(x_m=4.0, y_m=2.0)))


def a_drawn(source: Source, gap_m: float | None = None, discs: int = 0) -> World:
    """Return a world with this source, and with so many discs where there is a gap."""
    if gap_m is not None:
        source = Scattered(base=source, gap_m=gap_m, parts={"discs": Discs(count=(discs, 3), radius_m=(1.0, 2.0))})
    return World(name="scene", source=source, goal_tolerance_m=0.1, time_limit_s=10.0)


def test_a_robot_must_fit_through_the_gap() -> None:
    world = a_drawn(a_world(), gap_m=1.5)
    world.check_fits(1.49)
    with pytest.raises(DescriptionError, match=r"^world\.source\.gap_m=1\.5: .* the robot's radius 1\.5 m$"):
        world.check_fits(1.5)


@pytest.mark.parametrize(("gap_m", "place"), [(None, "world.source"), (9.0, "world.source.base")])
def test_swapping_robots_must_fit_beside_each_other(gap_m: float | None, place: str) -> None:
    distance_m, world = SWAP.neighbours_m(), a_drawn(SWAP, gap_m)
    assert 3.99 < distance_m < 4.0  # the chord is shorter than the arc
    world.check_fits(0.499 * distance_m)
    with pytest.raises(DescriptionError, match=rf"^{place}\.spacing_m=4\.0: .*radii of the robot, "):
        world.check_fits(0.5 * distance_m)


def test_a_robot_that_is_too_large_is_refused_before_anything_runs() -> None:
    with pytest.raises(DescriptionError, match="gap_m"):
        a_runner(a_drawn(a_world(), gap_m=1.5), always(0.0), robot=a_robot(2.0), sensors=BLIND)


@pytest.mark.parametrize(("radius_m", "free"), [(1.49, True), (1.51, False)])
def test_a_start_is_checked_against_polygons(radius_m: float, free: bool) -> None:
    world = a_drawn(a_world(polygons=(WEDGE,)))
    if free:
        world.check_fits(radius_m)
    else:
        with pytest.raises(DescriptionError, match=r"world\.starts\[0\]: .*1\.51 m from an obstacle"):
            world.check_fits(radius_m)


@pytest.mark.parametrize(("radius_m", "reached"), [(1.099, True), (1.101, False)])
def test_a_goal_that_no_robot_can_come_near_enough_to_is_refused(radius_m: float, reached: bool) -> None:
    disc = Disc(x_m=100.0, y_m=3.0, radius_m=2.0)  # 1 m from the goal, of which 0.1 m will do
    world = a_drawn(a_world(discs=(disc,), goals=(Point(x_m=100.0, y_m=0.0),)))
    if reached:
        world.check_fits(radius_m)
    else:
        with pytest.raises(DescriptionError, match=r"^world\.goals\[0\]: .* lies 1 m from an obstacle"):
            world.check_fits(radius_m)


def test_jittered_starts_of_swapping_robots_are_free_of_obstacles_and_of_each_other() -> None:
    world, robot_m = a_drawn(SWAP, gap_m=3.0, discs=3), 1.5
    for episode in range(3):
        drawn = world.drawn_for(0, episode)
        poses = draw_starts(FreeSpace(drawn, robot_m), Jitter(0.4, 0.2), 0, episode)
        places = np.array([pose[:2] for pose in poses])
        away = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)) + 99.0 * np.eye(len(poses))
        assert away.min() > 2.0 * robot_m
        for disc in drawn.discs:
            assert np.hypot(*(places - (disc.x_m, disc.y_m)).T).min() > disc.radius_m + robot_m
        moved = [
            math.hypot(pose.x_m - start.x_m, pose.y_m - start.y_m)
            for pose, start in zip(poses, drawn.starts, strict=True)
        ]
        assert 0.0 < max(moved) <= math.hypot(0.4, 0.4)


def test_a_drawn_start_in_contact_costs_its_episode_and_no_more() -> None:
    class Narrow:
        robots = 2

        def draw(self, rng: np.random.Generator, episode: int) -> Layout:
            disc = Disc(1.9 if episode == 1 else 9.0, 0.0, 1.0)
            return Layout(
                bounds=PLANE,
                discs=(disc,),
                starts=(Start(0.0, 0.0), Start(0.0, 9.0)),
                goals=(Point(0.0, 5.0), Point(5.0, 9.0)),
            )

    with a_runner(a_drawn(Narrow()), always(0.0), robot=a_robot(1.0), options=BLOCK) as runner:
        outcomes = [[record.outcome for record in runner.run(episode)] for episode in range(3)]
        reason = runner.run(1)[0].reason
    assert outcomes == [["timed_out"] * 2, ["impossible"] * 2, ["timed_out"] * 2]
    assert reason.startswith("starts[0]: (0.0, 0.0) must lie further than the robot's radius 1.0 m from an obstacle")


def test_a_start_that_shares_its_place_with_another_one_is_refused() -> None:
    world = a_drawn(a_world(starts=(Start(x_m=0.0, y_m=0.0), Start(x_m=1.99, y_m=0.0))))
    with pytest.raises(DescriptionError, match=r"^world\.starts\[1\]: .*another start$"):
        world.check_fits(1.0)
