"""Occupancy grids: their cells as data, rays and distances against brute force, and what happens at them."""

import math

import numpy as np
import pytest
from scenes import a_ring, a_robot, a_world, always, starts
from shapely import LineString, box
from shapely import Point as Place
from shapely.ops import unary_union

from navbench.episode.loop import EpisodeRunner
from navbench.episode.similarity import Native
from navbench.episode.starts import Jitter
from navbench.records import Thing
from navbench.simulation.base import Simulator
from navbench.simulation.bullet import BulletSimulator
from navbench.simulation.options import SimulatorOptions
from navbench.simulation.planar import PlanarSimulator
from navbench.validation import DescriptionError
from navbench.world.grid import Grid, nearest_cell, ray_to_cell
from navbench.world.layout import DrawnWorld, layout_of
from navbench.world.shapes import Box
from navbench.world.world import World

SIDE = 0.25


def scattered(seed: int, share: float = 0.03) -> Grid:
    return Grid.of(np.random.default_rng(seed).random((40, 60)) < share, SIDE, -3.0, 2.0)


def cells_of(grid: Grid) -> list[tuple[float, float, float, float]]:
    """The occupied cells as x and y from, x and y to."""
    rows, columns = np.nonzero(grid.occupied())
    return [
        (grid.x_min_m + SIDE * x, grid.y_min_m + SIDE * y, grid.x_min_m + SIDE * (x + 1), grid.y_min_m + SIDE * (y + 1))
        for y, x in zip(rows.tolist(), columns.tolist(), strict=True)
    ]


def test_a_grid_gives_its_cells_back_also_from_a_layouts_json() -> None:
    occupied = np.random.default_rng(0).random((7, 13)) < 0.4
    grid = Grid.of(occupied, 0.1)
    assert (grid.width, grid.height) == (13, 7)
    assert (grid.occupied() == occupied).all()
    world = a_world(grid=Grid.of(occupied, 0.1, 5.0, 5.0))
    assert layout_of(world.to_json()).grid == world.grid


@pytest.mark.parametrize("cells", ["no bits", "AAAA", Grid.of(np.ones((3, 3)), 1.0).cells])
def test_a_grid_whose_bits_do_not_fit_is_refused(cells: str) -> None:
    with pytest.raises(ValueError, match="cells: must"):
        Grid(x_min_m=0.0, y_min_m=0.0, resolution_m=1.0, width=5, height=5, cells=cells)


def test_rays_end_where_the_first_cell_begins() -> None:
    rng, hits = np.random.default_rng(1), 0
    for seed in range(3):
        grid = scattered(seed)
        free, place = grid.arrays()
        walls = unary_union([box(*cell) for cell in cells_of(grid)])
        for _ in range(300):
            x, y, turn, reach = rng.uniform(-6.0, 15.0), rng.uniform(-1.0, 15.0), rng.uniform(0.0, 7.0), 12.0
            if seed == 2:
                turn = round(turn / (0.5 * math.pi)) * 0.5 * math.pi  # along an axis
            ux, uy = math.cos(turn), math.sin(turn)
            met = walls.intersection(LineString([(x, y), (x + reach * ux, y + reach * uy)]))
            wanted = math.inf if met.is_empty else Place(x, y).distance(met)
            assert ray_to_cell(x, y, ux, uy, reach, free, place) == pytest.approx(wanted, abs=1e-9)
            hits += wanted < math.inf
    assert hits > 200


def test_the_nearest_cell_is_the_nearest_of_all() -> None:
    rng = np.random.default_rng(2)
    for seed, share in enumerate((0.002, 0.03, 0.3)):
        grid = scattered(seed, share)
        free, place = grid.arrays()
        walls = unary_union([box(*cell) for cell in cells_of(grid)])
        for x, y in rng.uniform((-6.0, -1.0), (15.0, 15.0), (200, 2)).tolist():
            found = nearest_cell(x, y, free, place)
            assert max(found, 0.0) == pytest.approx(walls.distance(Place(x, y)), abs=1e-9)
            assert (found <= 0.0) == walls.intersects(Place(x, y))


def test_without_an_occupied_cell_nothing_is_met() -> None:
    free, place = Grid.of(np.zeros((300, 400)), 0.1).arrays()
    assert nearest_cell(20.0, 15.0, free, place) == math.inf
    assert ray_to_cell(20.0, 15.0, 1.0, 0.0, 1000.0, free, place) == math.inf


def test_a_cell_is_met_over_more_free_cells_than_a_rectangle_counts() -> None:
    occupied = np.zeros((300, 900))
    occupied[150, 20] = occupied[150, 820] = 1
    free, place = Grid.of(occupied, 1.0).arrays()
    for ux, uy, far in ((1.0, -0.0, 399.5), (-1.0, 0.0, 399.5), (0.0, 1.0, math.inf), (-0.0, -1.0, math.inf)):
        assert ray_to_cell(420.5, 150.5, ux, uy, 1000.0, free, place) == far
    assert ray_to_cell(420.5, 150.5, 1.0, 0.0, 399.0, free, place) == math.inf
    assert nearest_cell(420.5, 150.5, free, place) == 399.5


def outcome(world: DrawnWorld, simulator: type[Simulator]) -> tuple[str, Thing | None, float, float]:
    robot = a_robot()
    template = World(name="scene", source=world, goal_tolerance_m=0.1, time_limit_s=30.0)
    with EpisodeRunner(
        make_controller=lambda: always(0.9, 0.01), make_simulator=lambda *parts: simulator(SimulatorOptions(), *parts),
        native=Native(robot, 0.1), world=template, robot=robot, sensors=a_ring(8, 1.0, 5.0), seed=0, jitter=Jitter(),
    ) as runner:  # fmt: skip
        (record,) = runner.run(0)
    return record.outcome, record.hit, record.metrics["time_s"], record.metrics["min_clearance_m"]


@pytest.mark.parametrize("simulator", [PlanarSimulator, BulletSimulator])
def test_a_cell_is_hit_at_the_instant_at_which_a_box_in_its_place_would_be(simulator: type[Simulator]) -> None:
    occupied = np.zeros((20, 30))
    occupied[9, 20] = occupied[9, 21] = 1
    at = {"starts": starts((0.0, 0.0, 0.0))}
    grid = Grid.of(occupied, 0.5, 0.0, -5.0)
    told, hit, time_s, clearance_m = outcome(a_world(grid=grid, **at), simulator)
    boxed = a_world(boxes=(Box(x_m=10.25, y_m=-0.25, length_m=0.5, width_m=0.5),), **at)
    assert (told, hit) == ("collided", Thing("cell", 9 * 30 + 20))
    assert outcome(boxed, simulator)[2] == pytest.approx(time_s, rel=1e-12)
    assert clearance_m == pytest.approx(0.0, abs=1e-9)


def test_a_goal_in_a_cell_and_a_start_beside_one_are_refused() -> None:
    occupied = np.zeros((4, 4))
    occupied[2, 2] = 1
    with pytest.raises(ValueError, match=r"goals\[0\].*outside every obstacle"):
        a_world(grid=Grid.of(occupied, 1.0, 497.5, -2.5))
    with pytest.raises(DescriptionError, match=r"starts\[0\].*radius"):
        a_world(grid=Grid.of(occupied, 1.0, -1.0, -2.5)).check_fits(1.0, 0.1)
