"""The compiled loop is the loop: same bytes, whatever errs, moves, drifts or ends."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scenes import a_ring, a_robot, a_world, same, starts, to_and_fro

from navbench.contract import FloatArray, Setup
from navbench.episode.loop import EpisodeRunner
from navbench.episode.similarity import Native
from navbench.episode.starts import Jitter
from navbench.mathematics.geometry import wrap_angle
from navbench.policy import CompiledController, Policy, compiled
from navbench.records import RobotRecord
from navbench.sensors import Odometry, Sensors, Tracker
from navbench.simulation.options import SimulatorOptions
from navbench.simulation.planar import PlanarSimulator
from navbench.world.layout import DrawnWorld
from navbench.world.shapes import Box, Disc, Point, Polygon, Wall
from navbench.world.world import World

Vector = tuple[float, float]


@compiled
def wander(
    state: FloatArray,
    parameters: FloatArray,
    ranges_m: FloatArray,
    discs: FloatArray,
    pose: tuple[float, float, float],
    goal: Vector,
    speed: Vector,
    trace: FloatArray,
) -> Vector:
    """Use everything: turn to the goal, away from what is near, and remember how often."""
    state[0] += 1.0
    error = wrap_angle(math.atan2(goal[1] - pose[1], goal[0] - pose[0]) - pose[2])
    near = ranges_m.min() if ranges_m.shape[0] else 9.0
    if near < parameters[0]:
        error += 1.2 if ranges_m[1] > ranges_m[-1] else -1.2
    pull = 0.0
    for k in range(discs.shape[0]):
        pull += discs[k, 3] / (1.0 + discs[k, 0] * discs[k, 0] + discs[k, 2])
    trace[0], trace[1], trace[2] = error, near, state[0]
    if state[0] == parameters[1]:
        return math.nan, 0.0
    if state[0] == parameters[2]:
        raise ValueError("enough")
    return 0.8 + 0.1 * speed[0], 1.5 * error + 0.01 * pull + 0.001 * state[0]


class Wander(CompiledController):
    def __init__(self, fails_at: float = -1.0, raises_at: float = -1.0) -> None:
        self.parameters = np.array([2.0, fails_at, raises_at])

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        self.parameters[0] = 1.5 + rng.random()
        names = ("heading_error_rad", "near_m", "acts")
        self.policy = Policy(step=wander, state=np.zeros(1), parameters=self.parameters, trace_names=names)


class StepByStep(PlanarSimulator):
    """The same simulator without its compiled loop."""

    is_compiled = False


ERRORS: dict[str, Any] = {
    "noise_std_m": 0.1,
    "dropout_probability": 0.05,
    "odometry": Odometry(travel_noise=0.05, wheel_scale_std=0.02),
    "tracker": Tracker(range_m=20.0, position_noise_std_m=0.1),
}


def crowd() -> DrawnWorld:
    """Three robots among everything that may stand or move."""
    square = tuple(Point(x_m=x, y_m=y) for x, y in ((0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)))
    return a_world(
        starts=starts((0, 0, 0), (0, 8, 0.5), (0, -8, -0.5)),
        goals=(Point(x_m=30.0, y_m=0.0), Point(x_m=32.0, y_m=-6.0), Point(x_m=28.0, y_m=7.0)),
        boxes=(Box(x_m=12.0, y_m=1.0, length_m=3.0, width_m=1.0, heading_rad=0.4),),
        discs=(Disc(x_m=20.0, y_m=-3.0, radius_m=1.5),),
        polygons=(Polygon(corners=tuple(Point(x_m=x, y_m=y) for x, y in ((8.0, -7.0), (11.0, -6.0), (9.0, -4.0)))),),
        walls=(Wall(x1_m=5.0, y1_m=12.0, x2_m=25.0, y2_m=12.0),),
        movers=(
            to_and_fro((16.0, 9.0), (16.0, -9.0), speeds=[1.0], radius_m=0.7),
            to_and_fro((6.0, -9.0), (6.0, 9.0), (9.0, 9.0), speeds=[0.7, 0.9], radius_m=0.8, outline=square),
        ),
        time_limit_s=60.0,
    )


def records(simulator: type[PlanarSimulator], options: SimulatorOptions, **given: Any) -> list[list[RobotRecord]]:
    robot, world = a_robot(accel_mps2=given.get("accel_mps2")), crowd()
    native = Native(replace(robot, **given["native"]) if "native" in given else robot, 0.1)
    sensors: Sensors = a_ring(16, 1.0, 6.0, 1.0, cone_half_angle_rad=0.1, rays=3, **given.get("sensors", {}))
    template = World(name=world.name, source=world, goal_tolerance_m=0.3, time_limit_s=given.get("limit_s", 60.0))
    makers = iter(given["controllers"]) if "controllers" in given else iter(Wander, None)
    with EpisodeRunner(
        make_controller=lambda: next(makers) if "controllers" in given else Wander(),
        make_simulator=lambda *parts: simulator(options, *parts),
        native=native, world=template, robot=robot, sensors=sensors, seed=4, jitter=Jitter(0.5, 0.5),
        keep_ranges=given.get("keep_ranges", True),
    ) as runner:  # fmt: skip
        return [runner.run(episode) for episode in range(given.get("episodes", 6))]


LIMITED = SimulatorOptions(drive="limited", motor_lag_s=0.1, command_delay_s=0.25)


@pytest.mark.parametrize("block", ["end", "block"])
@pytest.mark.parametrize(
    ("options", "given"),
    [
        (SimulatorOptions(), {}),
        (SimulatorOptions(), {"sensors": ERRORS}),
        (SimulatorOptions(), {"sensors": {"tracker": Tracker(range_m=15.0)}}),
        (LIMITED, {"accel_mps2": 2.0, "limit_s": 39.97}),
        (SimulatorOptions(), {"native": {"radius_m": 0.3, "wheel_speed_max_mps": 0.2}, "sensors": ERRORS}),
    ],
    ids=["exact", "errors", "tracker", "limited", "another robot"],
)
def test_the_compiled_loop_gives_the_bytes_of_the_loop_in_python(
    options: SimulatorOptions, given: dict[str, Any], block: Any
) -> None:
    options = replace(options, on_collision=block)
    compiled_ones, one_by_one = (records(kind, options, **given) for kind in (PlanarSimulator, StepByStep))
    outcomes = {record.outcome for episode in one_by_one for record in episode}
    assert "controller_error" not in outcomes
    assert len(outcomes) > 1 or block == "block"
    for mine, theirs in zip(compiled_ones, one_by_one, strict=True):
        for one, other in zip(mine, theirs, strict=True):
            assert same(one, other)
            assert (one.hit, one.layout, len(one.states)) == (other.hit, other.layout, len(other.states))
            assert one.ranges_m.shape == (len(one.states) - 1, 16)


def test_ranges_that_are_not_kept_change_nothing_else() -> None:
    kept, without = (records(PlanarSimulator, SimulatorOptions(), keep_ranges=keep) for keep in (True, False))
    for mine, theirs in zip(kept, without, strict=True):
        for one, other in zip(mine, theirs, strict=True):
            assert other.ranges_m.size == 0 < one.ranges_m.size
            assert same(one._replace(ranges_m=other.ranges_m), other)


def test_more_periods_than_go_at_once_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = records(PlanarSimulator, SimulatorOptions(), sensors=ERRORS)
    for at_once in (1, 7):
        monkeypatch.setattr("navbench.episode.loop.PERIODS_AT_ONCE", at_once)
        found = records(PlanarSimulator, SimulatorOptions(), sensors=ERRORS)
        assert all(
            same(a, b) for one, other in zip(found, wanted, strict=True) for a, b in zip(one, other, strict=True)
        )


@pytest.mark.parametrize("when", [{"fails_at": 7.0}, {"raises_at": 7.0}], ids=["nan", "raises"])
def test_a_policy_that_fails_costs_its_robot_and_says_what_it_did(when: dict[str, float]) -> None:
    both = [
        records(kind, SimulatorOptions(), episodes=1, controllers=[Wander(), Wander(**when), Wander()] * 2)[0]
        for kind in (PlanarSimulator, StepByStep)
    ]
    for one, other in zip(*both, strict=True):
        assert same(one, other)
        assert one.reason == other.reason
    failed = both[0][1]
    assert failed.outcome == "controller_error"
    assert failed.metrics["time_s"] == pytest.approx(0.6)
    assert ("nan" if "fails_at" in when else "enough") in failed.reason
    assert [record.outcome for record in both[0]].count("controller_error") == 1
