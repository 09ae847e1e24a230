"""The index of what is near: held to a search through everything, and episodes with it to episodes without."""

import math

import numpy as np
import pytest
from numba import typeof
from scenes import a_ring, a_robot, a_world, starts

from navbench.contract import Pose
from navbench.mathematics.geometry import distance_to_nearest, distance_to_nearest_of
from navbench.simulation import index as module
from navbench.simulation.index import nearby
from navbench.simulation.options import SimulatorOptions
from navbench.simulation.planar import PlanarSimulator
from navbench.simulation.scene import Scene
from navbench.world.grid import Grid
from navbench.world.layout import DrawnWorld
from navbench.world.shapes import Box, Disc, Mover, Point, Polygon

REACH_M = 3.0


def crowded(seed: int, things: int, side_m: float) -> DrawnWorld:
    """A square of boxes, discs and triangles round the origin, where nothing stands, with a mover on its way."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-0.5 * side_m, 0.5 * side_m, (3, things, 2))
    places = places[:, (abs(places) > 3.0).any(axis=2).all(axis=0)].tolist()
    corners = (Point(x_m=0.0, y_m=0.0), Point(x_m=0.4, y_m=0.0), Point(x_m=0.0, y_m=0.3))
    return a_world(
        boxes=tuple(Box(x_m=x, y_m=y, length_m=1.0, width_m=0.2, heading_rad=x) for x, y in places[0]),
        discs=tuple(Disc(x_m=x, y_m=y, radius_m=0.2) for x, y in places[1]),
        polygons=tuple(
            Polygon(corners=tuple(Point(x_m=x + p.x_m, y_m=y + p.y_m) for p in corners)) for x, y in places[2]
        ),
        movers=(Mover(radius_m=0.3, waypoints=(Point(x_m=9.0, y_m=9.0), Point(x_m=-9.0, y_m=9.0)), speeds_mps=(1.0,)),),
        starts=starts((0.0, 0.0, 0.3)),
    )


@pytest.mark.parametrize(("things", "side_m"), [(10, 40.0), (40, 100.0), (300, 40.0), (300, 400.0)])
def test_the_nearest_thing_and_all_within_reach_are_listed(things: int, side_m: float) -> None:
    scene = Scene(crowded(things, things, side_m), REACH_M)
    shapes, index = (scene.boxes, scene.discs, scene.polygons), scene.arrays[8]
    for x, y in np.random.default_rng(0).uniform(-0.8 * side_m, 0.8 * side_m, (500, 2)).tolist():
        near = nearby(x, y, index)
        assert distance_to_nearest_of(x, y, *shapes, *near) == distance_to_nearest(x, y, *shapes)
        for kind, rows in enumerate(shapes):
            assert (np.diff(near[kind]) > 0).all()
            for k in set(range(len(rows))) - set(near[kind].tolist()):
                alone = [rows[k : k + 1] if i == kind else shape[:0] for i, shape in enumerate(shapes)]
                assert distance_to_nearest(x, y, *alone) > REACH_M
    assert len(scene.discs) - 1 in nearby(0.0, 0.0, index)[1]  # the mover


def test_a_place_in_a_crowd_lists_few() -> None:
    scene = Scene(crowded(1, 3000, 300.0), REACH_M)
    assert sum(map(len, nearby(50.0, 50.0, scene.arrays[8]))) < 60


def driven(layout: DrawnWorld) -> list[object]:
    """What a robot measures and where it is, on a curve through a crowd until something is hit."""
    simulator = PlanarSimulator(SimulatorOptions(), a_robot(radius_m=0.3), a_ring(8, 0.3, 2.5), None)
    simulator.reset(layout, [Pose(0.0, 0.0, 0.3)], 0.1)
    found: list[object] = []
    for k in range(300):
        simulator.command(0, 0.8, 0.05 * math.sin(0.1 * k))
        events = simulator.advance(0.1 * k, 0.1)
        found += [simulator.ranges().tolist(), simulator.states(), events]
        if events:
            break
    return found


def test_an_episode_with_an_index_is_the_one_without_to_the_last_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    layouts = [crowded(seed, 150, 40.0) for seed in range(5)]
    indexed = [driven(layout) for layout in layouts]
    monkeypatch.setattr(module, "MANY", 10**9)
    assert repr(indexed) == repr([driven(layout) for layout in layouts])
    assert sum(len(episode) < 900 for episode in indexed) > 2  # most end at a thing


def test_the_arrays_of_all_scenes_have_the_same_types_which_direct_calls_do_not_check() -> None:
    empty, some, many = a_world(), crowded(0, 10, 40.0), crowded(0, 300, 400.0)
    gridded = a_world(grid=Grid.of(np.eye(20), 0.1, 3.0, 3.0))
    types = list(map(typeof, [Scene(world, REACH_M).arrays for world in (empty, some, many, gridded)]))
    assert types == types[:1] * 4
