"""Episodes that are stepped from outside are those of the loop: same bytes, whatever errs, moves, drifts or ends."""

from typing import Any

import numpy as np
import pytest

from navbench.cli.configuration import compose_cell
from navbench.contract import Controller, FloatArray, Observation, Pose
from navbench.episode.loop import EpisodeRunner
from navbench.episode.stepping import Stepper
from navbench.experiments.cells import Cell
from navbench.mathematics.streams import stream
from navbench.simulation.motion import RUNNING

ERRORS = "sensors.noise_std_m=0.01 sensors.dropout_probability=0.02 sensors.odometry.travel_noise=0.02"
CELLS = (
    "controller=sflc world=deadlock",
    f"controller=pid world=no_deadlock start_jitter_m=0.02 {ERRORS} sensors.odometry.wheel_scale_std=0.01 seed=3",
    f"controller=oa_to world=random_movers {ERRORS}",
    "controller=oa_to world=random_crossing simulator.on_collision=block",
    "controller=oa_to world=random_discs simulator.drive=limited simulator.command_delay_s=0.6",
    "controller=sflc world=lei_corner robot=disc015",
)
NO_DISCS = np.empty((0, 5))


def observed(stepper: Stepper, place: int, index: int) -> Observation:
    x, y, heading, goal_x, goal_y, v, w = stepper.known[place, index].tolist()
    t_s = stepper.periods[place] * stepper.setup.period_s
    ranges_m: FloatArray = stepper.ranges_m[place, index].copy()
    return Observation(t_s, Pose(x, y, heading), (goal_x, goal_y), v, w, ranges_m, False, NO_DISCS)


def controllers_of(cell: Cell, stepper: Stepper, episode: int) -> list[Controller]:
    made = [cell.make_controller() for _ in range(stepper.robots)]
    for i, controller in enumerate(made):
        controller.reset(stepper.setup, stream(cell.seed, cell.world.name, episode, "controller", i))
    return made


def driven(cell: Cell, episodes: list[int], **options: Any) -> list[Any]:
    """What the cell's controller does in some episodes at once, by commands from outside."""
    stepper = Stepper(cell.runner, len(episodes), **options)
    for place, episode in enumerate(episodes):
        stepper.begin(place, episode)
    controllers = [controllers_of(cell, stepper, episode) for episode in episodes]
    commands = np.zeros((len(episodes), stepper.robots, 2))
    stepper.move(commands)
    over: set[int] = set()
    records: list[Any] = [[] for _ in episodes]
    while len(over) < len(episodes):
        for place, mine in enumerate(controllers):
            for i, controller in enumerate(mine):
                if place not in over and stepper.outcomes[place, i] == RUNNING:
                    commands[place, i] = controller.act(observed(stepper, place, i))
        stepper.move(commands)
        for place in set(range(len(episodes))) - over:
            if stepper.periods[place] == stepper.periods_max or (stepper.outcomes[place] != RUNNING).all():
                over.add(place)
                records[place] = [stepper.record(place, i) for i in range(stepper.robots)]
                stepper.begin(place, episodes[place])  # what begins there changes nothing elsewhere
    stepper.close()
    return records


@pytest.mark.parametrize("words", CELLS)
def test_a_stepped_episode_gives_the_bytes_of_the_loop(words: str) -> None:
    cell, episodes = compose_cell(*words.split(), "simulator=planar"), [0, 4, 1]
    with cell.runner() as runner:
        wanted = [runner.run(episode) for episode in episodes]
    found = driven(cell, episodes, threads=2)
    for one, other in zip(found, wanted, strict=True):
        for mine, theirs in zip(one, other, strict=True):
            assert mine.outcome == theirs.outcome
            assert mine.states.tobytes() == theirs.states.tobytes()
            assert mine.metrics.keys() == theirs.metrics.keys()
            assert all(mine.metrics[name] == theirs.metrics[name] for name in mine.metrics if name != "heading_ise")


def test_layouts_come_again_and_noise_does_not() -> None:
    cell = compose_cell("controller=go_to_goal", "world=random_discs", "simulator=planar", "sensors.noise_std_m=0.1")
    drawn: list[EpisodeRunner] = []

    def runner() -> EpisodeRunner:
        drawn.append(cell.runner())
        return drawn[-1]

    stepper = Stepper(runner, layouts=2)
    seen = []
    for episode in range(4):
        stepper.begin(0, episode)
        stepper.move(np.zeros((1, stepper.robots, 2)))
        seen.append((stepper.distances_m.copy(), stepper.ranges_m.copy(), drawn[0].simulator.scene.layout))
    assert seen[0][2] is seen[2][2]
    assert seen[1][2] is seen[3][2]
    assert seen[0][2] != seen[1][2]
    assert not np.array_equal(seen[0][1], seen[2][1])


def test_a_stepper_without_an_episode_or_time_says_so() -> None:
    cell = compose_cell("controller=go_to_goal", "world=empty", "simulator=planar", "world.time_limit_s=0.12")
    stepper = Stepper(cell.runner)
    still = np.zeros((1, 1, 2))
    with pytest.raises(RuntimeError, match="reset begins one"):
        stepper.move(still)
    stepper.begin(0, 0)
    for _ in range(4):
        stepper.move(still)
    assert stepper.periods_max == stepper.periods[0] == 3
    assert stepper.record(0, 0).metrics["time_s"] == pytest.approx(0.12)
    with pytest.raises(RuntimeError, match="reset begins one"):
        stepper.move(still)
