import math
from typing import Any

import numpy as np
import pytest
from scenes import BLIND, BLOCK, a_robot, a_runner, a_world, always

from navbench.episode.starts import Jitter, check_fits, draw_starts
from navbench.simulation.scene import Scene
from navbench.validation import DescriptionError
from navbench.world.layouts import Layout, Scatter, Swap
from navbench.world.shapes import Bounds, Disc, Point, Polygon
from navbench.world.world import Start, World

SWAP = Swap(robots=40, radius_m=20.0, spacing_m=4.0)  # the circle grows to 160 m around
DISCS = Scatter(count=(1, 3), radius_m=(1.0, 2.0))
WEDGE = Polygon(corners=(Point(x_m=1.5, y_m=0.0), Point(x_m=4.0, y_m=-2.0), Point(x_m=4.0, y_m=2.0)))


def swapping(gap_m: float = 9.0, **parts: Any) -> World:
    return a_world(starts=(), goals=(), layout=Layout(gap_m=gap_m, swap=SWAP, **parts))


def test_a_robot_must_fit_through_the_gap() -> None:
    world = a_world(layout=Layout(gap_m=1.5, discs=DISCS))
    check_fits(world, a_robot(1.49))
    with pytest.raises(DescriptionError, match=r"^world\.layout\.gap_m=1\.5: .* the robot's radius 1\.5 m$"):
        check_fits(world, a_robot(1.5))


def test_swapping_robots_must_fit_beside_each_other() -> None:
    distance_m = SWAP.neighbours_m()
    assert 3.99 < distance_m < 4.0  # the chord is shorter than the arc
    check_fits(swapping(), a_robot(0.499 * distance_m))
    with pytest.raises(DescriptionError, match=r"^world\.layout\.swap\.spacing_m=4\.0: .*radii of the robot, "):
        check_fits(swapping(), a_robot(0.5 * distance_m))


def test_a_robot_that_is_too_large_is_refused_before_anything_runs() -> None:
    with pytest.raises(DescriptionError, match="gap_m"):
        a_runner(a_world(layout=Layout(gap_m=1.5, discs=DISCS)), always(0.0), robot=a_robot(2.0), sensors=BLIND)


@pytest.mark.parametrize(("radius_m", "free"), [(1.49, True), (1.51, False)])
def test_a_start_is_checked_against_polygons(radius_m: float, free: bool) -> None:
    world = a_world(polygons=(WEDGE,))
    if free:
        check_fits(world, a_robot(radius_m))
    else:
        with pytest.raises(DescriptionError, match=r"world\.starts\[0\]: .*1\.51 m from an obstacle"):
            check_fits(world, a_robot(radius_m))


def test_jittered_starts_of_swapping_robots_are_free_of_obstacles_and_of_each_other() -> None:
    world, robot_m = swapping(3.0, discs=Scatter(count=(3, 3), radius_m=(1.0, 2.0))), 1.5
    bounds = Bounds(x_min_m=-40.0, x_max_m=40.0, y_min_m=-40.0, y_max_m=40.0)
    world = a_world(starts=(), goals=(), layout=world.layout, bounds=bounds)
    for episode in range(3):
        drawn = world.drawn_for(0, episode)
        poses = draw_starts(Scene(drawn), robot_m, Jitter(0.4, 0.2), 0, episode)
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


def test_a_swapping_robot_that_starts_in_contact_with_what_stands_is_refused() -> None:
    """The discs around the circle leave the goals free, but not the robots' hulls."""
    swap = Swap(robots=2, radius_m=20.0, spacing_m=4.0)
    ring = tuple(
        Disc(x_m=(20.0 + side) * math.cos(turn), y_m=(20.0 + side) * math.sin(turn), radius_m=0.9)
        for turn in np.linspace(0.0, math.tau, 120, endpoint=False).tolist()
        for side in (-1.5, 1.5)
    )
    world = a_world(starts=(), goals=(), layout=Layout(gap_m=2.0, swap=swap), discs=ring)
    with a_runner(world, always(0.0), robot=a_robot(1.0), options=BLOCK) as runner:
        with pytest.raises(DescriptionError, match=r"world\.starts\[0\]"):
            runner.run(0)


def test_a_start_that_shares_its_place_with_another_one_is_refused() -> None:
    world = a_world(starts=(Start(x_m=0.0, y_m=0.0), Start(x_m=1.99, y_m=0.0)))
    with pytest.raises(DescriptionError, match=r"^world\.starts\[1\]: .*another start's robot$"):
        check_fits(world, a_robot(1.0))
