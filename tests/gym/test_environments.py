"""The environments are navbench's own episodes, and do what gymnasium and PettingZoo ask for."""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray
from pages import ROOT, blocks_of
from pettingzoo.test import parallel_api_test

import navbench.gym
from navbench.cli.configuration import compose_cell
from navbench.contract import Command, Observation, Setup
from navbench.episode.loop import EpisodeRunner
from navbench.records import RobotRecord
from navbench.validation import DescriptionError

ERRORS = ("sensors.noise_std_m=0.02", "sensors.odometry.travel_noise=0.05", "start_jitter_m=0.02")


def scripted(period: int) -> NDArray[np.float32]:
    return np.array([0.7, 0.4 * np.sin(0.05 * period)], np.float32)


class Scripted:
    """The same script as a controller."""

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        self.period, limit = 0, setup.robot.wheel_speed_max_mps
        self.speeds = np.array([1.0, 2.0 / setup.robot.track_m]) * limit

    def act(self, observation: Observation) -> Command:
        v, w = scripted(self.period).astype(float) * self.speeds
        self.period += 1
        return Command(float(v), float(w))


def wanted(words: Sequence[str], episode: int) -> list[RobotRecord]:
    """What a cell of navbench records of the script."""
    cell = compose_cell("controller=go_to_goal", "simulator=planar", *words)
    cell = replace(cell, controller=Scripted, configuration={"controller": {"build": {}}})
    with cell.runner() as runner:
        return runner.run(episode)


def recorded(monkeypatch: pytest.MonkeyPatch) -> list[RobotRecord]:
    """Where each record goes that is made from now on."""
    records: list[RobotRecord] = []
    record = EpisodeRunner.record

    def keep(*given: Any) -> RobotRecord:
        records.append(record(*given))
        return records[-1]

    monkeypatch.setattr(EpisodeRunner, "record", keep)
    return records


def assert_same(found: RobotRecord, other: RobotRecord) -> None:
    assert found.outcome == other.outcome
    assert found.states.tobytes() == other.states.tobytes()
    assert found.metrics == other.metrics


@pytest.mark.parametrize("words", [("world=deadlock",), ("world=no_deadlock", *ERRORS), ("world=corner",)])
def test_a_script_drives_as_it_does_as_a_controller(words: Sequence[str], monkeypatch: pytest.MonkeyPatch) -> None:
    (theirs,) = wanted(words, 5)
    records = recorded(monkeypatch)
    env = navbench.gym.make(*words)
    for _ in range(2):  # an episode remembers nothing of the one before
        env.reset(seed=0, options={"episode": 5})
        period, over = 0, False
        while not over:
            *_, terminated, truncated, info = env.step(scripted(period))
            period, over = period + 1, terminated or truncated
        assert_same(records[-1], theirs)
        assert (info["outcome"], info["metrics"]) == (theirs.outcome, theirs.metrics)
        assert terminated == (theirs.outcome != "timed_out")


def test_a_fleet_of_scripts_drives_as_controllers_do(monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("world=random_discs", *ERRORS)
    theirs = wanted(words, 2)
    records = recorded(monkeypatch)
    fleet = navbench.gym.make_fleet(*words)
    fleet.reset(options={"episode": 2})
    period = 0
    while fleet.agents:
        fleet.step(dict.fromkeys(fleet.agents, scripted(period)))
        period += 1
    assert len(theirs) == len(records) == 3
    for one, other in zip(sorted(records, key=lambda record: record.robot_index), theirs, strict=True):
        assert_same(one, other)


def test_many_environments_step_as_each_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("world=random_discs", *ERRORS)
    vector = navbench.gym.make_vec(*words, num_envs=3, threads=2, observation="dict")
    single = navbench.gym.make(*words, observation="dict")
    seen, infos = vector.reset(seed=7)
    assert infos["episode_index"].tolist() == [0, 1, 2]
    history, beginnings = [seen], [0]
    while len(beginnings) < 3:
        *told, infos = vector.step(np.tile(scripted(len(history)), (3, 1)))
        history.append(told[0])
        if told[2][1] or told[3][1]:
            beginnings.append(len(history))
    single.reset(seed=7)
    for begin, end, episode in zip(beginnings, beginnings[1:], (1, 4), strict=False):
        mine, _ = single.reset(options={"episode": episode})
        for k in range(begin, end):
            if k > begin:
                mine, *_, terminated, truncated, info = single.step(scripted(k))
            assert all(np.array_equal(mine[name], history[k][name][1]) for name in ("ranges", "goal", "velocity"))
        assert terminated or truncated
        assert info["outcome"] in ("reached", "collided", "timed_out")


def test_an_episode_that_is_over_begins_anew_in_the_next_step() -> None:
    vector = navbench.gym.make_vec("world.time_limit_s=1.0", world="empty", num_envs=2)
    first, _ = vector.reset()
    for k in range(20):
        seen, rewards, terminated, truncated, infos = vector.step(np.full((2, 2), 0.5, np.float32))
        assert truncated.all() == (k == 19)
        assert not terminated.any()
    assert infos["outcome"].tolist() == ["timed_out"] * 2
    assert infos["metrics"]["time_s"].tolist() == pytest.approx([1.0, 1.0])
    assert not np.array_equal(seen, first)
    seen, rewards, terminated, truncated, infos = vector.step(np.full((2, 2), 0.5, np.float32))
    assert np.array_equal(seen, first)
    assert (rewards.tolist(), infos) == ([0.0, 0.0], {})
    assert not (terminated | truncated).any()


@pytest.mark.filterwarnings("ignore:.*Box observation space (minimum|maximum) value is:UserWarning")
@pytest.mark.parametrize("observation", ["flat", "dict"])
def test_gymnasium_finds_nothing_wrong(observation: Any) -> None:
    check_env(navbench.gym.make(world="random_discs", observation=observation), skip_render_check=True)


def test_pettingzoo_finds_nothing_wrong() -> None:
    parallel_api_test(navbench.gym.make_fleet(world="swap_circle"), num_cycles=500)


def test_rewards_add_up_to_what_the_documentation_says() -> None:
    env = navbench.gym.make(world="empty")
    seen, _ = env.reset()
    total, over = 0.0, False
    while not over:
        goal = seen[-4:-2]
        seen, reward, terminated, truncated, info = env.step(
            np.array([0.8, np.arctan2(goal[1], goal[0]) / 3], np.float32)
        )
        total, over = total + reward, terminated or truncated
    assert info["outcome"] == "reached"
    assert 1.0 < total < 2.0


def test_a_reward_of_ones_own_replaces_the_default() -> None:
    env = navbench.gym.make(world="empty", reward=lambda period: -period.distance_m)
    env.reset()
    assert env.step(np.zeros(2, np.float32))[1] < -0.1
    wrong = navbench.gym.make(world="empty", reward=lambda period: np.zeros(3))
    wrong.reset()
    with pytest.raises(ValueError, match=r"reward=array.*: must be finite numbers of shape \(1, 1\)"):
        wrong.step(np.zeros(2, np.float32))


@pytest.mark.parametrize(
    ("choices", "said"),
    [
        ({"world": "deadlok"}, "world=deadlok: unknown choice; did you mean deadlock"),
        ({"simulator": "pybullet"}, "simulator=pybullet: environments need a compiled one"),
        ({"sensors": "disc_tracker"}, "sensors=disc_tracker: environments have no tracker"),
        ({"observation": "image"}, "observation=image: must be flat or dict"),
        ({"wrld": "deadlock"}, "wrld"),
        ({"reward": "progress"}, "reward='progress': must be a function of a Period"),
    ],
)
def test_a_wrong_choice_is_one_line(choices: dict[str, Any], said: str) -> None:
    with pytest.raises(DescriptionError, match=said) as told:
        navbench.gym.make(**choices)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("word", [3, None, b"world=empty"])
def test_a_word_that_is_none_is_one_line(word: Any) -> None:
    with pytest.raises(DescriptionError, match="must be a word, such as 'episodes=10'"):
        navbench.gym.make(word)


@pytest.mark.parametrize("key", ["num_envs", "threads", "layouts"])
@pytest.mark.parametrize("count", [0, -1, 1.0, "2", True])
def test_a_count_that_is_none_is_one_line(key: str, count: Any) -> None:
    with pytest.raises(DescriptionError, match=f"{key}={count!r}: must be a whole number from 1 to"):
        navbench.gym.make_vec(world="empty", **{key: count})
    assert navbench.gym.make_vec(world="empty", num_envs=np.int64(2)).num_envs == 2  # type: ignore[arg-type]


@pytest.mark.parametrize(("key", "most"), [("num_envs", 65536), ("threads", 1024)])
def test_more_than_memory_holds_is_one_line(key: str, most: int) -> None:
    asked: dict[str, Any] = {key: 10**9}
    with pytest.raises(DescriptionError, match=f"{key}=1000000000: must be a whole number from 1 to {most}$"):
        navbench.gym.make_vec(world="empty", **asked)


class NoArray:
    def __array__(self, *_: Any, **__: Any) -> None:
        raise TypeError("lies on another device")


NO_ACTIONS: list[Any] = [
    *(None, 0.5, "ab", b"ab", object(), {}, [], [0.0], [0.0] * 3, [[0.0, 0.0]], [[0.0], [0.0]], [[0.0], [0.0, 1.0]]),
    *([np.nan, 0.0], [0.0, np.inf], [1j, 0.0], ["1", "2"], [None, 0.0], [10**400, 0], NoArray()),
    *(np.zeros(2, "datetime64[D]"), np.zeros((3, 2)), np.array([0.0, 1.0], object)),
]


@pytest.mark.parametrize("action", NO_ACTIONS, ids=range(len(NO_ACTIONS)))
def test_an_action_that_is_no_two_finite_numbers_is_refused_in_one_line_and_moves_nothing(action: Any) -> None:
    env, fleet = navbench.gym.make(world="empty"), navbench.gym.make_fleet(world="swap_circle")
    vector = navbench.gym.make_vec(world="empty", num_envs=4)
    seen = [env.reset(seed=0)[0], vector.reset(seed=0)[0], fleet.reset(seed=0)[0]["robot_3"]]
    still = np.zeros(2, np.float32)
    with pytest.raises(ValueError, match=r"^action=.*: must be finite numbers of shape \(2,\)$"):
        env.step(action)
    with pytest.raises(ValueError, match=r"^actions=.*: must be finite numbers of shape \(4, 2\)$"):
        vector.step([action] * 4)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"^actions=.*: must be finite numbers of shape \(10, 2\)$"):
        fleet.step({**dict.fromkeys(fleet.agents, still), "robot_3": action})
    seen_now = [env.step(still)[0], vector.step(np.zeros((4, 2)))[0]]  # type: ignore[arg-type]
    seen_now.append(fleet.step(dict.fromkeys(fleet.agents, still))[0]["robot_3"])
    assert all(np.array_equal(one, other) for one, other in zip(seen, seen_now, strict=True))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda actions: [*actions.values()], "actions=.*: must be a mapping from agents to actions"),
        (
            lambda actions: {**actions, "robot_10": np.zeros(2)},
            "actions.robot_10: there is no such agent; did you mean",
        ),
        (lambda actions: {"robot_0": np.zeros(2)}, "actions.robot_1: missing; every agent that drives needs an action"),
    ],
)
def test_a_fleet_wants_an_action_of_each_agent_that_drives_and_of_nobody_else(change: Any, said: str) -> None:
    fleet = navbench.gym.make_fleet(world="swap_circle")
    fleet.reset()
    with pytest.raises(ValueError, match=said):
        fleet.step(change(dict.fromkeys(fleet.agents, np.zeros(2))))


@pytest.mark.parametrize(
    "reward",
    [
        lambda period: None,
        lambda period: 1.0,
        lambda period: "fine",
        lambda period: np.full((1, 1), np.nan),
        lambda period: np.full((1, 1), np.inf),
        lambda period: np.full((1, 1), 1j),
        lambda period: np.full((1, 1), None),
    ],
)
def test_a_reward_that_is_no_finite_number_is_refused_in_one_line(reward: Any) -> None:
    env = navbench.gym.make(world="empty", reward=reward)
    env.reset()
    with pytest.raises(ValueError, match=r"^reward=.*: must be finite numbers of shape \(1, 1\)$"):
        env.step(np.zeros(2, np.float32))


def test_a_reward_that_writes_into_its_period_changes_nothing_else() -> None:
    def wipe(period: navbench.gym.Period) -> Any:
        reward = navbench.gym.progress(period)
        for values in period[:8]:
            values[...] = 0
        return reward

    env, other = navbench.gym.make(world="empty", reward=wipe), navbench.gym.make(world="empty")
    env.reset()
    other.reset()
    for k in range(10):
        assert env.step(scripted(k))[1] == other.step(scripted(k))[1]


@pytest.mark.parametrize("make", [navbench.gym.make, navbench.gym.make_vec, navbench.gym.make_fleet])
@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"seed": -1}, "seed=-1: must be a whole number from 0 to"),
        ({"seed": 1.5}, "seed=1.5: must be a whole number"),
        ({"seed": "a"}, "seed='a': must be a whole number"),
        ({"seed": 2**70}, "seed=.*: must be a whole number"),
        ({"options": 3}, "options=3: must be a mapping"),
        ({"options": {"episode": -1}}, "options.episode=-1: must be a whole number"),
        ({"options": {"episode": 1.5}}, "options.episode=1.5: must be a whole number"),
    ],
)
def test_a_reset_with_a_wrong_seed_or_option_is_one_line(make: Any, given: dict[str, Any], said: str) -> None:
    with pytest.raises(DescriptionError, match=said):
        make(world="empty").reset(**given)


def test_of_many_environments_no_one_episode_can_be_asked_for() -> None:
    vector = navbench.gym.make_vec(world="empty", num_envs=2)
    with pytest.raises(DescriptionError, match="options.episode: must not be there"):
        vector.reset(options={"episode": 3})
    with pytest.raises(DescriptionError, match=r"seed=\[1, 2\]: must be one number"):
        vector.reset(seed=[1, 2])


def test_where_no_episode_goes_on_a_step_is_refused() -> None:
    """Before the first reset, when it is over, and when all is closed, where nothing can be begun either."""
    still = np.zeros(2, np.float32)
    env = navbench.gym.make("world.time_limit_s=0.2", world="empty")
    fleet = navbench.gym.make_fleet("world.time_limit_s=0.2", world="swap_circle")
    vector = navbench.gym.make_vec(world="empty", num_envs=2, threads=2)
    steps: dict[Any, Any] = {
        env: lambda: env.step(still),
        fleet: lambda: fleet.step(dict.fromkeys(fleet.agents, still)),
        vector: lambda: vector.step(np.tile(still, (2, 1))),
    }
    for one, step in steps.items():
        with pytest.raises(RuntimeError, match="no episode goes on: reset begins one"):
            step()
        one.reset()
        if one is not vector:
            for _ in range(one._core.stepper.periods_max):
                step()
            with pytest.raises(RuntimeError, match="no episode goes on: reset begins one"):
                step()
        one.close()
        for again in (step, one.reset):
            with pytest.raises(RuntimeError, match="it is closed; make another one"):
                again()


def test_an_episode_that_ended_at_a_wall_is_over() -> None:
    env = navbench.gym.make(world="corner")
    env.reset()
    while not env.step(np.array([1.0, 0.0], np.float32))[2]:
        pass
    with pytest.raises(RuntimeError, match="no episode goes on: reset begins one"):
        env.step(np.array([1.0, 0.0], np.float32))


def test_the_lines_of_the_page_on_learning_run() -> None:
    (text,) = (block.text for block in blocks_of(ROOT / "docs/learn.md") if block.file == "learn.py")
    lines: dict[str, Any] = {}
    exec(text, lines)
    assert lines["observation"].shape == (20,)
    assert lines["envs"].reset()[0].shape == (256, 20)
    assert len(lines["fleet"].reset()[0]) == 10


def test_without_gymnasium_the_package_says_what_to_install() -> None:
    code = "import sys; sys.modules['gymnasium'] = None\nimport navbench.gym"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "navbench.gym needs gymnasium: pip install 'navbench[gym]'" in done.stderr
