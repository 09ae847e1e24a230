"""Conformance: PyBullet and the planar simulator see the same, touch the same, and end whole episodes alike."""

import json
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scenes import BLIND

from benchmarks import conformance
from benchmarks.conformance import (
    Comparison,
    Episode,
    agrees,
    compare,
    episodes_of,
    judged,
    perturbed,
    place_at,
    ranges_at,
)
from navbench.cli.catalogue import CONF, files_of
from navbench.cli.composing import Composer, composing
from navbench.cli.configuration import cell_of, compose_cell
from navbench.contract import Command, Observation, Pose, Setup
from navbench.experiments.cells import Cell
from navbench.records import RobotRecord, Thing
from navbench.sensors import Sensors
from navbench.simulation.bullet import BulletSimulator
from navbench.simulation.planar import PlanarSimulator
from navbench.simulation.scene import Scene
from navbench.world.layout import Layout

WORLDS = list(files_of("world", [CONF]))
LOOKS = 2  # layouts, times and poses for each world and suite
USUAL_RADII, MOST_RADII = 1e-3, 0.05  # what 99 of 100 ranges differ by, and what all do
EPISODES = {"random_movers": 15}  # the only world with polygons
OPEN = {"empty_100", "nemeiksis_destination"}  # there is nothing to be seen
HAIR = 1e-3  # in radii or rad: more than PyBullet errs, less than matters


@pytest.fixture(scope="module")
def composer() -> Iterator[Composer]:
    with composing() as composer:
        yield composer


@pytest.fixture(scope="module")
def rings(composer: Composer) -> list[Sensors]:
    """All suites that have range sensors."""
    words = (["controller=go_to_goal", f"sensors={name}"] for name in files_of("sensors", [CONF]))
    suites = [cell_of(composer.values("run", some)).sensors for some in words]
    return [suite for suite in suites if suite.mounts]


class Stagger:
    """A controller that drives at random, into anything."""

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Stand where it looks."""
        self._rng, self._turn = rng, 0.0
        self._speed = 0.5 * setup.robot.wheel_speed_max_mps
        self._rate = self._speed / setup.robot.track_m

    def act(self, observation: Observation) -> Command:
        """Return a speed and a turn."""
        self._turn = 0.9 * self._turn + 0.1 * float(self._rng.normal())
        return Command(self._speed, self._rate * self._turn)


def cell_in(composer: Composer, world: str) -> Cell:
    """Return a world's robot in it, with randomly perturbed starts."""
    return perturbed(cell_of(composer.values("run", ["controller=go_to_goal", f"world={world}"])))


def free_poses(rng: np.random.Generator, layout: Layout, radius_m: float, t_s: float) -> list[Pose]:
    """Return a random free pose for each robot of a layout."""
    scene, bounds = Scene(layout), layout.bounds
    scene.move_to(t_s)
    low, high = (bounds.x_min_m, bounds.y_min_m, -math.pi), (bounds.x_max_m, bounds.y_max_m, math.pi)
    poses: list[Pose] = []
    while len(poses) < len(layout.starts):
        pose = Pose(*rng.uniform(low, high).tolist())
        gaps = [math.hypot(pose.x_m - other.x_m, pose.y_m - other.y_m) - radius_m for other in poses]
        if min([scene.distance(pose.x_m, pose.y_m), *gaps]) > radius_m:
            poses.append(pose)
    return poses


def test_ranges_agree_in_every_world_with_every_ring(composer: Composer, rings: list[Sensors]) -> None:
    rng = np.random.default_rng(5)
    apart: dict[str, list[float]] = {world: [] for world in WORLDS}
    for world in WORLDS:
        cell = cell_in(composer, world)
        radius_m = cell.robot.radius_m
        for sensors in rings:
            parts = cell.options, cell.robot, sensors.scaled_to(radius_m), None
            with BulletSimulator(*parts) as bullet, PlanarSimulator(*parts) as planar:
                for look in range(LOOKS):
                    layout, t_s = cell.world.drawn_for(0, look), rng.uniform(0.0, cell.world.time_limit_s)
                    poses = free_poses(rng, layout, radius_m, t_s)
                    theirs, mine = (ranges_at(simulator, layout, poses, t_s) for simulator in (bullet, planar))
                    far = np.abs(theirs - mine)[np.minimum(theirs, mine) < planar.rays.unobstructed] / radius_m
                    apart[world] += far.tolist()
                    if (far > MOST_RADII).any():  # an edge that a ray passes by a hair
                        turned = ([p._replace(heading_rad=p.heading_rad + by) for p in poses] for by in (-HAIR, HAIR))
                        near = np.array([mine, *(ranges_at(planar, layout, some, t_s) for some in turned)])
                        assert (near.min(axis=0) - MOST_RADII * radius_m <= theirs).all(), world
                        assert (theirs <= near.max(axis=0) + MOST_RADII * radius_m).all(), world
    assert {world for world, found in apart.items() if not found} <= OPEN
    together = [one for found in apart.values() for one in found]
    assert len(together) > 2000
    assert np.percentile(together, 99.0) < USUAL_RADII
    assert np.median(together) > 0.0


def touched(bullet: BulletSimulator, layout: Layout, poses: list[Pose], t_s: float) -> set[frozenset[Thing]]:
    """Return the pairs that PyBullet finds in touch."""
    place_at(bullet, layout, poses, t_s)
    return {frozenset(pair) for pair in bullet.touches()}


def end_of(record: RobotRecord) -> Pose:
    return Pose(*record.states[-1, 1:4].tolist())


def moved(pose: Pose, by_m: float, scene: Scene, other: Pose | None) -> Pose:
    """Return a pose further away from what is nearest, or from another robot."""
    if other is None:
        x, y, step = pose.x_m, pose.y_m, 1e-6
        away = complex(
            scene.distance(x + step, y) - scene.distance(x - step, y),
            scene.distance(x, y + step) - scene.distance(x, y - step),
        )
    else:
        away = complex(pose.x_m - other.x_m, pose.y_m - other.y_m)
    away *= by_m / abs(away)
    return pose._replace(x_m=pose.x_m + away.real, y_m=pose.y_m + away.imag)


def contacts_confirmed(bullet: BulletSimulator, episode: Episode, radius_m: float) -> Counter[str]:
    """Check each contact of an episode a hair before and after it, and return what was hit."""
    layout, hits = episode[0].layout, Counter[str]()
    assert layout is not None
    for i, record in enumerate(episode):
        if record.hit is None:
            continue
        t_s, poses = float(record.states[-1, 0]), [end_of(one) for one in episode]
        scene = Scene(layout)
        scene.move_to(t_s)
        other = poses[record.hit.index] if record.hit.kind == "robot" else None
        pair = frozenset((Thing("robot", i), record.hit))
        for by_m, touches in ((-HAIR * radius_m, True), (HAIR * radius_m, False)):
            there = [*poses[:i], moved(poses[i], by_m, scene, other), *poses[i + 1 :]]
            assert (pair in touched(bullet, layout, there, t_s)) == touches, (layout, record)
        hits[record.hit.kind] += 1
    return hits


def free_in_between(bullet: BulletSimulator, episode: Episode, radius_m: float) -> int:
    """Check that PyBullet finds no running robot in touch before its end, and return how often it was asked."""
    layout, looks = episode[0].layout, 0
    assert layout is not None
    last = max(len(record.states) for record in episode) - 1
    for k in range(0, last, max(last // 5, 1)):
        rows = [record.states[min(k, len(record.states) - 1)] for record in episode]
        pairs = touched(bullet, layout, [Pose(*row[1:4].tolist()) for row in rows], float(max(row[0] for row in rows)))
        free = bullet.robots["clearance_m"] > HAIR * radius_m
        running = {Thing("robot", i) for i, one in enumerate(episode) if k < len(one.states) - 1 and free[i]}
        assert not any(running & pair for pair in pairs)
        looks += len(running)
    return looks


def test_contacts_in_runs_are_those_that_pybullet_finds(composer: Composer) -> None:
    hits, looks = Counter[str](), 0
    for world in WORLDS:
        cell = replace(cell_in(composer, world), simulator=PlanarSimulator)
        with cell.runner() as runner, BulletSimulator(cell.options, cell.robot, BLIND, None) as bullet:
            runner.make_controller = Stagger
            for episode in map(runner.run, range(EPISODES.get(world, 3))):
                assert not any(record.outcome == "controller_error" for record in episode)
                hits += contacts_confirmed(bullet, episode, cell.robot.radius_m)
                looks += free_in_between(bullet, episode, cell.robot.radius_m)
    assert set(hits) == {"box", "disc", "mover", "polygon", "robot", "wall"}
    assert hits.total() > 50
    assert looks > 200


def test_whole_episodes_agree_as_far_as_pybullet_agrees_with_itself() -> None:
    calm = [compare("sflc", "random_movers", 6), compare("multi_agent", "nemeiksis_wall", 6)]
    switching = [compare("oa_to", world, 3) for world in ("lei_corner", "deadlock")]
    assert judged(calm + switching)[2]
    assert np.mean([agrees for one in calm for agrees in one.planar_agrees]) > 0.7
    assert any(one.differences for one in switching)  # else this is no test of what switches
    for one in (difference for comparison in switching for difference in comparison.differences):
        assert one.t_s > 0.0
        assert one.ranges_m


def a_comparison(planar: int, aside: int, reached: int, n: int = 500) -> Comparison:
    """Return a comparison in which so many of 500 episodes agree, and so many more robots arrive on planar."""

    def first(count: int) -> list[bool]:
        return [k < count for k in range(n)]

    return Comparison("any", "where", first(planar), first(aside), first(300), first(300 + reached), [])


def test_what_is_judged_is_refused_beyond_what_is_allowed_and_the_sample_can_tell() -> None:
    assert judged([a_comparison(450, 450, 0)])[2]
    assert judged([a_comparison(445, 450, 10)])[2]
    assert not judged([a_comparison(400, 450, 0)])[2]
    assert not judged([a_comparison(450, 450, 40)])[2]
    assert not judged([a_comparison(450, 450, -40)])[2]
    assert judged([a_comparison(4, 5, 0, n=5)])[2]


def test_an_episode_agrees_where_all_outcomes_and_path_lengths_do() -> None:
    cell = compose_cell("controller=go_to_goal", "world=zhao2017_empty", "world.time_limit_s=20.0")
    (one,) = episodes_of(replace(cell, simulator=PlanarSimulator))
    assert agrees(one, one)
    assert not agrees(one, [*one[:2], one[2]._replace(outcome="reached")])
    for part, same in ((1.005, True), (1.03, False), (math.nan, False)):
        longer = {**one[1].metrics, "path_length_m": part * one[1].metrics["path_length_m"]}
        assert agrees(one, [one[0], one[1]._replace(metrics=longer), one[2]]) == same


def test_the_script_prints_a_table_or_json(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["conformance.py", "--episodes", "2", "--controllers", "oa_to", "--worlds", "deadlock"]
    printed = []
    for more in ([], ["--json"]):
        monkeypatch.setattr("sys.argv", words + more)
        with pytest.raises(SystemExit) as end:
            conformance.main()
        assert end.value.code == 0
        printed.append(capsys.readouterr().out)
    (pair,) = json.loads(printed[1])
    assert (pair["controller"], pair["world"], len(pair["planar_agrees"])) == ("oa_to", "deadlock", 2)
    assert printed[0].count("| all ") == 3
    for one in pair["differences"]:
        assert f"episode {one['episode']}: robot {one['robot']} at {one['t_s']:.2f} s" in printed[0]
