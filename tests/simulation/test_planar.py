"""The planar simulator beside independent truth, shapely and the formula of a circle; and the same bytes every time."""

import math
import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pytest
import shapely
from scenes import RADII, a_robot, same
from shapely.geometry import LineString
from shapely.geometry import Point as Place
from shapes import Block, Round, Shape, Shard, clutter, shapes_of

from benchmarks.conformance import perturbed, ranges_at
from navbench.cli.configuration import compose_cell
from navbench.contract import Pose
from navbench.experiments.cells import Batch, Cell, Records, run_batch
from navbench.experiments.engines import in_processes
from navbench.records import RobotRecord
from navbench.sensors import Mount, Sensors
from navbench.simulation.options import SimulatorOptions
from navbench.simulation.planar import PlanarSimulator

EXACT_RADII = 1e-9
ROBOTS = 3
Solid: TypeAlias = "Round | shapely.Polygon"


def solid(shape: Shape) -> Solid:
    """Return a shape as shapely knows it; circles stay as they are, of which it would make polygons."""
    if isinstance(shape, Round):
        return shape
    if isinstance(shape, Shard):
        corners: Sequence[complex] = shape.corners
    else:
        along, across = shape.along * shape.half_length, 1j * shape.along * shape.half_width
        corners = [shape.centre + a * along + b * across for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return shapely.Polygon([(corner.real, corner.imag) for corner in corners])


def away(thing: Solid, p: complex) -> float:
    """Return the signed distance from a point to a thing."""
    if isinstance(thing, Round):
        return thing.away(p)
    place = Place(p.real, p.imag)
    return float(-thing.exterior.distance(place) if thing.contains(place) else thing.distance(place))


def free(thing: Solid, begin: complex, along: complex, reach: float) -> float:
    """Return how far a ray comes before it hits a thing, 0 from inside, infinite for one that it does not hit."""
    if away(thing, begin) <= 0.0:
        return 0.0
    if isinstance(thing, Round):
        return thing.hit(begin, along)
    end = begin + reach * along
    hit = LineString([(begin.real, begin.imag), (end.real, end.imag)]).intersection(thing)
    return math.inf if hit.is_empty else float(hit.distance(Place(begin.real, begin.imag)))


def truth(sensors: Sensors, pose: Pose, radius_m: float, things: Sequence[Solid]) -> list[float]:
    """Return what each sensor reads: the nearest hit of its rays, and 0 for one between the hull and the mount."""
    place, turn = complex(pose.x_m, pose.y_m), complex(math.cos(pose.heading_rad), math.sin(pose.heading_rad))
    readings = []
    for mount in sensors.complete_mounts():
        half, reach = mount.cone_half_angle_rad or 0.0, mount.max_range_m or 0.0
        reading, at = reach, complex(mount.x_m, mount.y_m)
        for aside in [0.0] if mount.rays == 1 else np.linspace(-half, half, mount.rays or 1):
            along = complex(math.cos(mount.heading_rad + aside), math.sin(mount.heading_rad + aside))
            back = 0.0
            if abs(at) > radius_m:  # then the ray begins where it leaves the hull, if it does before the mount
                entry = Round(0j, radius_m * (1.0 - 1e-6)).hit(at, -along)
                back = entry if math.isfinite(entry) else 0.0
            begin, length = place + turn * (at - back * along), back + reach
            hits = [free(thing, begin, turn * along, length) for thing in things]
            reading = min(reading, max(min(hits, default=math.inf) - back, 0.0))
        readings.append(reading)
    return readings


def any_ring(rng: np.random.Generator, radius_m: float) -> Sensors:
    """Return sensors in and outside the hull that look anywhere, some with cones."""
    mounts = tuple(
        Mount(
            role=str(i),
            x_m=radius_m * away_radii * math.cos(at),
            y_m=radius_m * away_radii * math.sin(at),
            heading_rad=heading,
            max_range_m=radius_m * reach,
            cone_half_angle_rad=half,
            rays=int(rng.integers(1, 6)),
        )
        for i, (away_radii, at, heading, reach, half) in enumerate(
            rng.uniform((0.0, -4.0, -4.0, 0.5, 0.0), (2.0, 4.0, 4.0, 14.0, 0.8), (24, 5)).tolist()
        )
    )
    return Sensors(drawn_for_radius_m=radius_m, mounts=mounts, max_range_m=radius_m)


@pytest.mark.parametrize("radius_m", RADII)
def test_ranges_and_clearances_are_exact(radius_m: float) -> None:
    rng = np.random.default_rng(31)
    inside = seen = 0
    for _ in range(20):
        world, sensors, t_s = clutter(rng, radius_m, ROBOTS, movers=2), any_ring(rng, radius_m), rng.uniform(0.0, 20.0)
        places = rng.uniform((-12.0, -12.0, -math.pi), (12.0, 12.0, math.pi), (ROBOTS, 3)) * (radius_m, radius_m, 1.0)
        poses = [Pose(*place) for place in places.tolist()]  # free or not
        with PlanarSimulator(SimulatorOptions(), a_robot(radius_m), sensors, None) as simulator:
            got = ranges_at(simulator, world, poses, t_s)
            clearances = simulator.robots["clearance_m"]
        for i, pose in enumerate(poses):
            things = [solid(shape) for shape in shapes_of(world, radius_m, poses, t_s, but=i)]
            wanted = truth(sensors, pose, radius_m, things)
            assert got[i] == pytest.approx(wanted, rel=0.0, abs=EXACT_RADII * radius_m)
            nearest = min(away(thing, complex(pose.x_m, pose.y_m)) for thing in things) - radius_m
            assert clearances[i] == pytest.approx(nearest, rel=0.0, abs=EXACT_RADII * radius_m)
            inside += wanted.count(0.0)
            seen += int((got[i] < simulator.rays.unobstructed).sum())
    assert inside > 50
    assert seen - inside > 500


def test_the_truth_agrees_with_shapes_of_known_distance() -> None:
    square = solid(Block(2 + 0j, 1 + 0j, 1.0, 0.5))
    assert isinstance(square, shapely.Polygon)
    assert (away(square, 0j), away(square, 2 + 0j)) == (1.0, -0.5)
    assert (free(square, 0j, 1 + 0j, 5.0), free(square, 0j, 1j, 5.0)) == (1.0, math.inf)
    assert free(Round(3 + 0j, 1.0), 0j, 1 + 0j, 5.0) == 2.0


@pytest.fixture(scope="module")
def cell() -> Cell:
    """Three robots among everything, with noise and randomly perturbed starts."""
    cell = compose_cell("controller=oa_to", "world=random_movers", "world.time_limit_s=40.0", "episodes=6")
    return replace(perturbed(cell), simulator=PlanarSimulator)


Episodes = dict[int, list[RobotRecord]]


def by_episode(records: Records) -> Episodes:
    """Return the records of each episode, by robot."""
    return {k: [record for episode, record in records if episode == k] for k in sorted({k for k, _ in records})}


@pytest.fixture(scope="module")
def once(cell: Cell) -> Episodes:
    return by_episode(run_batch(Batch(cell, cell.indices)))


def assert_same(one: Episodes, other: Episodes) -> None:
    """Check that the same episodes were run, and gave the same bytes."""
    assert one.keys() == other.keys()
    for k, records in one.items():
        assert all(same(*pair) for pair in zip(records, other[k], strict=True))


def test_repeats_give_the_same_bytes_and_other_seeds_others(cell: Cell, once: Episodes) -> None:
    assert_same(by_episode(run_batch(Batch(cell, cell.indices))), once)
    others = by_episode(run_batch(Batch(replace(cell, seed=1), cell.indices)))
    assert not any(same(others[k][0], once[k][0]) for k in once)
    assert len({record.outcome for records in once.values() for record in records}) > 1


@pytest.mark.parametrize("order", [(5, 4, 3, 2, 1, 0), (3, 0, 3, 5, 1, 4, 2)])
def test_the_order_of_episodes_does_not_matter(cell: Cell, once: Episodes, order: tuple[int, ...]) -> None:
    with cell.runner() as runner:
        assert_same({k: runner.run(k) for k in order}, {k: once[k] for k in order})


@pytest.mark.parametrize("size", [1, 4])
@pytest.mark.parametrize("workers", [1, 2])
def test_neither_batches_nor_workers_matter(cell: Cell, once: Episodes, size: int, workers: int) -> None:
    batches = [Batch(cell, cell.indices[k : k + size]) for k in range(0, cell.episodes, size)]
    done = in_processes(run_batch, batches, workers=workers)
    assert_same(by_episode([pair for records in done for pair in records]), once)


def test_another_process_gives_the_same_bytes(cell: Cell, once: Episodes, tmp_path: Path) -> None:
    (tmp_path / "cell").write_bytes(pickle.dumps(cell))
    program = (
        "import pickle, sys; from pathlib import Path; from navbench.experiments.cells import Batch, run_batch\n"
        "folder = Path(sys.argv[1]); cell = pickle.loads((folder / 'cell').read_bytes())\n"
        "(folder / 'records').write_bytes(pickle.dumps(run_batch(Batch(cell, range(2)))))\n"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "7"}
    subprocess.run([sys.executable, "-c", program, str(tmp_path)], env=environment, check=True)
    assert_same(by_episode(pickle.loads((tmp_path / "records").read_bytes())), {k: once[k] for k in range(2)})
