"""The planar simulator beside independent truth: shapely's polygons, and the quadratic formula of a circle."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from scenes import RADII, a_robot
from shapely.geometry import LineString
from shapely.geometry import Point as Place
from shapes import Block, Round, Shape, Shard, clutter, shapes_of

from benchmarks.conformance import ranges_at
from navbench.contract import Pose
from navbench.sensors import Mount, Sensors
from navbench.simulation.options import SimulatorOptions
from navbench.simulation.planar import PlanarSimulator

EXACT_RADII = 1e-9
ROBOTS = 3
Solid = Round | shapely.Polygon


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
    return -thing.exterior.distance(place) if thing.contains(place) else thing.distance(place)


def free(thing: Solid, begin: complex, along: complex, reach: float) -> float:
    """Return how far a ray comes before it hits a thing, 0 from inside, infinite for one that it does not hit."""
    if away(thing, begin) <= 0.0:
        return 0.0
    if isinstance(thing, Round):
        return thing.hit(begin, along)
    end = begin + reach * along
    hit = LineString([(begin.real, begin.imag), (end.real, end.imag)]).intersection(thing)
    return math.inf if hit.is_empty else hit.distance(Place(begin.real, begin.imag))


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
