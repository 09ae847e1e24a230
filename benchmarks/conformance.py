"""How far the planar simulator and PyBullet agree over whole episodes, beside how far PyBullet agrees with itself.

Controllers switch, and a switch amplifies the last digits of a range: PyBullet disagrees with itself in many episodes
once its robots begin a hair aside. So the same episodes, with randomly perturbed starts and noisy sensors, are run
three times: on PyBullet, on PyBullet with starts a hair aside, and on planar. The hair is by default as wide as
PyBullet's own tolerance of rays, 0.001 units where a robot's radius is at least 4: its rays end short of round bodies,
by 6e-5 radii on average, and what depends on that PyBullet does not know. Beside a much thinner hair planar disagrees
more often than PyBullet with itself, because all of PyBullet's runs share that error.

Two runs of an episode agree where every robot has the same outcome and a path as long as the other's to 1 %. Two things
are judged, over all episodes of all pairs of a controller and a world:

- agreement: the share of episodes in which planar agrees with PyBullet is below that in which PyBullet a hair aside
  does by no more than 2 points;
- success: the shares of robots that reach their goals differ by no more than 3 points.

The episodes are a sample, in which robots count singly, so each is refused only where the whole 95 % interval of its
paired difference (``newcombe_paired``) lies beyond what is allowed; a pair of its own only at a confidence that leaves
5 % for a false refusal among all pairs together. What an interval does not exclude is not proven: it is printed, and
shrinks with more episodes. Where planar disagrees, the first control period is shown in which a robot was told
something else, and what its ring measured there without noise.

    python -m benchmarks.conformance --episodes 100 --worlds random_movers,lei_corner --workers 2 [--json]
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import joblib
import numpy as np
from numpy.typing import NDArray
from tabulate import tabulate

from navbench.cli.catalogue import CONF, files_of
from navbench.cli.configuration import compose_cell
from navbench.contract import Pose
from navbench.episode.starts import Jitter
from navbench.experiments.cells import Batch, Cell, run_batch
from navbench.mathematics.statistics import CONFIDENCE, Estimate, newcombe_paired
from navbench.records import RobotRecord
from navbench.sensors import Tracker
from navbench.simulation.base import Simulator
from navbench.simulation.bullet import BulletSimulator
from navbench.simulation.motion import measure_clearance
from navbench.simulation.planar import PlanarSimulator
from navbench.world.layout import Layout

WORLDS = "random_movers,random_crossing,random_discs,zhao2018_static,deadlock,nemeiksis_wall,lei_corner"
HAIR_RADII = 2.5e-4
JITTER_RADII, JITTER_RAD, NOISE_RADII = 0.25, 0.2, 0.02
PATH_PART = 0.01  # path lengths that differ by less than this part are the same
TOLD_PART = 0.01  # of the wheels' limit: commands that differ by more are others
AGREEMENT, SUCCESS = 0.02, 0.03  # how much worse is allowed, and how different

Episode = list[RobotRecord]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Difference:
    """Where a run of an episode on planar left the one on PyBullet.

    Attributes:
        episode: its index.
        robot: which robot was first told something else.
        t_s: when its control period began [s].
        outcomes: all robots' outcomes on PyBullet, and on planar.
        ranges_m: what the robot's sensors that differ measured, by their roles: on PyBullet, and on planar [m].
    """

    episode: int
    robot: int
    t_s: float
    outcomes: tuple[str, str]
    ranges_m: dict[str, tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Comparison:
    """What became of the episodes of one controller in one world.

    Attributes:
        controller: its name.
        world: its name.
        planar_agrees: (n,) whether each episode on planar agrees with PyBullet.
        aside_agrees: (n,) whether each on PyBullet a hair aside does.
        reached: (m,) whether each robot of each episode reached its goal on PyBullet.
        planar_reached: (m,) whether it did on planar.
        differences: of the episodes in which planar disagrees.
    """

    controller: str
    world: str
    planar_agrees: list[bool]
    aside_agrees: list[bool]
    reached: list[bool]
    planar_reached: list[bool]
    differences: list[Difference]


def compare(controller: str, world: str, episodes: int, seed: int = 0, hair_radii: float = HAIR_RADII) -> Comparison:
    """Run the episodes of a controller in a world on PyBullet, on PyBullet a hair aside, and on planar."""
    drawn = compose_cell(f"controller={controller}", f"world={world}", f"episodes={episodes}", f"seed={seed}")
    cell = perturbed(drawn)
    cells = cell, perturbed(drawn, hair_radii), replace(cell, simulator=PlanarSimulator)
    bullet, aside, planar = map(episodes_of, cells)
    planar_agrees = [agrees(*pair) for pair in zip(bullet, planar, strict=True)]
    return Comparison(
        controller,
        world,
        planar_agrees,
        [agrees(*pair) for pair in zip(bullet, aside, strict=True)],
        [record.outcome == "reached" for records in bullet for record in records],
        [record.outcome == "reached" for records in planar for record in records],
        [difference(cell, k, bullet[k], planar[k]) for k, same in enumerate(planar_agrees) if not same],
    )


def perturbed(cell: Cell, hair_radii: float = 0.0) -> Cell:
    """Return a cell with noisy sensors, and starts perturbed by random shares of what is usual and a hair more."""
    radius_m, sensors = cell.robot.radius_m, cell.sensors
    noise_m = NOISE_RADII * sensors.drawn_for_radius_m
    tracker = sensors.tracker and Tracker(range_m=sensors.tracker.range_m, position_noise_std_m=noise_m)
    return replace(
        cell,
        jitter=Jitter((JITTER_RADII + hair_radii) * radius_m, JITTER_RAD + hair_radii),
        sensors=replace(sensors, noise_std_m=noise_m, tracker=tracker),
    )


def episodes_of(cell: Cell) -> list[Episode]:
    """Run a cell, and return a record a robot of each episode."""
    records = [record for _, record in run_batch(Batch(cell, cell.indices))]
    robots = cell.world.robots
    return [records[k : k + robots] for k in range(0, len(records), robots)]


def agrees(one: Episode, other: Episode) -> bool:
    """Return whether every robot has the same outcome and as long a path in two runs of an episode."""
    return all(
        a.outcome == b.outcome
        and np.isclose(a.metrics["path_length_m"], b.metrics["path_length_m"], rtol=PATH_PART, equal_nan=True)
        for a, b in zip(one, other, strict=True)
    )


def difference(cell: Cell, episode: int, bullet: Episode, planar: Episode) -> Difference:
    """Return where planar left PyBullet in an episode."""
    periods = [first_other_command(cell, *pair) for pair in zip(bullet, planar, strict=True)]
    robot = int(np.argmin(periods))
    period = periods[robot]
    rings = (
        ranges_of(cell, BulletSimulator, bullet, period)[robot],
        ranges_of(cell, PlanarSimulator, planar, period)[robot],
    )
    apart = np.flatnonzero(np.abs(rings[0] - rings[1]) > 1e-9 * cell.robot.radius_m).tolist()
    return Difference(
        episode,
        robot,
        float(bullet[robot].states[period, 0]),
        (" ".join(record.outcome for record in bullet), " ".join(record.outcome for record in planar)),
        {cell.sensors.mounts[k].role: (float(rings[0][k]), float(rings[1][k])) for k in apart},
    )


def first_other_command(cell: Cell, one: RobotRecord, other: RobotRecord) -> int:
    """Return the first control period in which a robot was told something else, or the first that one of two lacks."""
    count = min(len(one.states), len(other.states)) - 1
    limit, half_track_m = cell.robot.wheel_speed_max_mps, 0.5 * cell.robot.track_m
    (v, w), (other_v, other_w) = one.states[:count, 4:].T, other.states[:count, 4:].T
    apart = np.abs(v - other_v) + half_track_m * np.abs(w - other_w) > TOLD_PART * limit
    return int(np.append(np.flatnonzero(apart), count)[0])


def ranges_of(cell: Cell, kind: type[Simulator], episode: Episode, period: int) -> NDArray[np.float64]:
    """Return what all rings measured without noise when a control period began: (n_robots, n_sensors) [m]."""
    rows = [record.states[min(period, len(record.states) - 1)] for record in episode]
    layout = episode[0].layout
    assert layout is not None
    with kind(cell.options, cell.robot, cell.sensors.scaled_to(cell.robot.radius_m), None) as simulator:
        return ranges_at(simulator, layout, [Pose(*row[1:4].tolist()) for row in rows], max(row[0] for row in rows))


def ranges_at(simulator: Simulator, layout: Layout, poses: Sequence[Pose], t_s: float) -> NDArray[np.float64]:
    """Return what rings of robots at these poses measure without noise at a time [s]: (n_robots, n_sensors) [m]."""
    place_at(simulator, layout, poses, t_s)
    return simulator.ranges()


def place_at(simulator: Simulator, layout: Layout, poses: Sequence[Pose], t_s: float) -> None:
    """Put running robots at these poses, and movers where they are at a time [s]."""
    simulator.reset(layout, poses, 1.0)
    scene = simulator.scene
    scene.move_to(t_s)
    measure_clearance(simulator.robots, scene.arrays, simulator.robot.radius_m)
    simulator.place()


def judged(comparisons: Sequence[Comparison], confidence: float = CONFIDENCE) -> tuple[Estimate, Estimate, bool]:
    """Return the differences of agreement and of success, with their intervals, and whether neither is refused."""

    def all_of(name: str) -> BoolArray:
        return np.array([held for one in comparisons for held in getattr(one, name)])

    agreement = newcombe_paired(all_of("planar_agrees"), all_of("aside_agrees"), confidence=confidence)
    success = newcombe_paired(all_of("planar_reached"), all_of("reached"), confidence=confidence)
    holds = agreement.high >= -AGREEMENT and success.low <= SUCCESS and success.high >= -SUCCESS
    return agreement, success, holds


def row(names: Sequence[str], comparisons: Sequence[Comparison], confidence: float = CONFIDENCE) -> list[Any]:
    """Return a line of the table."""
    agreement, success, holds = judged(comparisons, confidence)
    shares = [
        100.0 * np.mean([held for one in comparisons for held in getattr(one, name)])
        for name in ("aside_agrees", "planar_agrees", "reached", "planar_reached")
    ]
    return [
        *names,
        agreement.n,
        *shares[:2],
        interval(agreement),
        *shares[2:],
        interval(success),
        "yes" if holds else "NO",
    ]


def interval(estimate: Estimate) -> str:
    """Return a difference in points, with its limits."""
    return f"{100.0 * estimate.value:+.1f} [{100.0 * estimate.low:+.1f}, {100.0 * estimate.high:+.1f}]"


def table(comparisons: Sequence[Comparison]) -> str:
    """Return a line for each pair of a controller and a world, each controller, and all."""
    alone = 1.0 - (1.0 - CONFIDENCE) / len(comparisons)
    rows = [row((one.controller, one.world), [one], alone) for one in comparisons]
    controllers = dict.fromkeys(one.controller for one in comparisons)
    alone = 1.0 - (1.0 - CONFIDENCE) / len(controllers)
    rows += [row((name, "all"), [one for one in comparisons if one.controller == name], alone) for name in controllers]
    rows.append(row(("all", "all"), comparisons))
    headers = (
        *("controller", "world", "episodes", "agrees: aside %", "planar %", "planar - aside"),
        *("reached: PyBullet %", "planar %", "planar - PyBullet", "holds"),
    )
    return str(tabulate(rows, headers, floatfmt=".1f", tablefmt="github"))


def described(comparison: Comparison, most: int) -> str:
    """Return a line for each of the first episodes in which planar disagrees."""
    lines = []
    for one in comparison.differences[:most]:
        ranges = sorted(one.ranges_m.items(), key=lambda item: -abs(item[1][0] - item[1][1]))[:3]
        seen = ", ".join(f"{role} {a:.9g} {b:.9g}" for role, (a, b) in ranges) or "the same"
        lines.append(
            f"{comparison.controller} in {comparison.world}, episode {one.episode}: robot {one.robot} at "
            f"{one.t_s:.2f} s; {one.outcomes[0]} / {one.outcomes[1]}; ranges [m] {seen}"
        )
    return "\n".join(lines)


def main() -> None:
    """Print the table, or everything as JSON; exit with 1 where something is refused."""
    parser = argparse.ArgumentParser(description="Compare whole episodes on planar and on PyBullet.")
    parser.add_argument("--episodes", type=int, default=20, help="of each controller in each world")
    parser.add_argument(
        "--controllers",
        default=",".join(name for name in files_of("controller", [CONF]) if name != "policy"),
        help="their names, by commas",
    )
    parser.add_argument("--worlds", default=WORLDS, help="their names, by commas")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--seed", type=int, default=0, help="of every random stream")
    parser.add_argument("--hair", type=float, default=HAIR_RADII, help="how far aside PyBullet begins, in robot radii")
    parser.add_argument("--shown", type=int, default=1, help="how many differing episodes of a pair to describe")
    parser.add_argument("--json", action="store_true", help="print everything as JSON")
    given = parser.parse_args()
    pairs = [(c, w) for c in given.controllers.split(",") for w in given.worlds.split(",")]
    running = joblib.Parallel(n_jobs=given.workers, return_as="generator")(
        joblib.delayed(compare)(controller, world, given.episodes, given.seed, given.hair)
        for controller, world in pairs
    )
    comparisons: list[Comparison] = []
    for comparison in running:
        comparisons.append(comparison)
        print(f"{len(comparisons)}/{len(pairs)}", comparison.controller, comparison.world, file=sys.stderr, flush=True)
    if given.json:
        print(json.dumps([asdict(comparison) for comparison in comparisons]))
    else:
        print("\n".join(filter(None, (described(one, given.shown) for one in comparisons))))
        print(table(comparisons))
    sys.exit(not judged(comparisons)[2])


if __name__ == "__main__":
    main()
