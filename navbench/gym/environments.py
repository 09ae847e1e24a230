"""One robot in one environment, and many such environments in one compiled call."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from navbench.gym.core import Core, Form, Observed, alone, cell_of_words, episode_of, numbers, whole
from navbench.gym.reward import Reward, progress
from navbench.validation import DescriptionError

Infos = dict[str, Any]
ENVS_MAX, THREADS_MAX = 2**16, 2**10  # more are a slip, and would fill the memory


class NavigationEnv(gymnasium.Env[Observed, NDArray[np.float32]]):
    """A robot that drives to its goal in planar: the same layouts, starts, noise and motion as a cell of navbench.

    | | shape | holds |
    |---|---|---|
    | action | (2,) in [-1, 1] | speed and turning rate, as shares of the largest ones; each wheel is clipped |
    | observation ``ranges`` | (n_sensors,) | the ring's readings, as shares of the largest range |
    | ``goal`` | (2,) | the goal's x and y in the frame of the believed pose, in largest ranges |
    | ``velocity`` | (2,) | measured speed and turning rate, as shares of the largest ones |

    The largest speed is the wheels' limit, the largest turning rate is twice that over the track.

    A robot that reaches its goal or hits something is terminated, at the time limit it is truncated. The last info has
    ``outcome``, ``reason`` and ``metrics``. Each reset begins the next episode, one with a seed the first one of that
    seed; ``options={"episode": 7}`` begins that one. Of a world with several robots only the first one drives.

    Args:
        words: as on the command line, such as "world=random_discs", "sensors.noise_std_m=0.01".
        config_dir: a folder with further worlds, robots and sensors.
        reward: see ``navbench.gym.reward``.
        observation: "flat" for one vector, "dict" for its parts by name.
        choices: further words, such as ``world="random_discs", robot="khepera3", seed=1``. A controller's name takes
            its sensors and its control period.

    Raises:
        DescriptionError: an unknown choice or key, a wrong value, or parts that do not fit together.
    """

    metadata = {"render_modes": []}

    def __init__(
        self,
        *words: str,
        config_dir: str | Path | None = None,
        reward: Reward = progress,
        observation: Form = "flat",
        **choices: Any,
    ) -> None:
        cell = cell_of_words(words, choices, config_dir)
        self._core = Core(replace(cell, world=alone(cell.world)), reward, observation)
        self.observation_space, self.action_space = self._core.observation_space, self._core.action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observed, Infos]:
        """Begin an episode, and return its first observation and its index.

        Raises:
            DescriptionError: no layout can be drawn, or the seed or an option is wrong.
        """
        episode = self._core.begin(seed, options)
        super().reset(seed=None if seed is None else int(seed))
        return self._core.formed(self._core.perceive()[0, 0]), {"episode_index": episode}

    def step(self, action: NDArray[np.float32]) -> tuple[Observed, float, bool, bool, Infos]:
        """Drive through one control period.

        Raises:
            ValueError: the action is not two finite numbers, or the reward not one.
            RuntimeError: no episode goes on.
        """
        told = self._core.step(numbers("action", action, (2,))[None, None])
        rewards, terminated, truncated = (part[0, 0].item() for part in told)
        info = self._core.told(0, 0) if terminated or truncated else {}
        return self._core.formed(self._core.seen()[0, 0]), rewards, terminated, truncated, info

    def close(self) -> None:
        """Close the simulator."""
        self._core.stepper.close()


class NavigationVectorEnv(VectorEnv[Observed, NDArray[np.float32], NDArray[Any]]):
    """Many of ``NavigationEnv``, stepped by one compiled call; an episode that is over begins anew in the next step.

    Environment k drives the episodes k, k + num_envs, and so on, of one seed.

    Args:
        words: as of ``NavigationEnv``.
        num_envs: how many.
        threads: how many threads share them.
        layouts: after how many episodes their layouts and starts come again, each drawn once; None for never. Noise is
            that of the episode, always.
        metrics: whether the last info has ``reason`` and ``metrics``, beside ``outcome``.
        config_dir: as of ``NavigationEnv``.
        reward: the same.
        observation: the same.
        choices: the same.

    Raises:
        DescriptionError: as ``NavigationEnv``.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        *words: str,
        num_envs: int = 1,
        threads: int = 1,
        layouts: int | None = None,
        metrics: bool = True,
        config_dir: str | Path | None = None,
        reward: Reward = progress,
        observation: Form = "flat",
        **choices: Any,
    ) -> None:
        num_envs, threads = whole("num_envs", num_envs, 1, ENVS_MAX), whole("threads", threads, 1, THREADS_MAX)
        layouts = None if layouts is None else whole("layouts", layouts, 1)
        cell = cell_of_words(words, choices, config_dir)
        options = {"places": num_envs, "threads": threads, "layouts": layouts, "keeps": metrics}
        self._core = Core(replace(cell, world=alone(cell.world)), reward, observation, **options)
        self.num_envs, self._metrics = num_envs, metrics
        self._first = cell.first_episode
        self._next, self._over = self._first + np.arange(num_envs), np.zeros(num_envs, np.bool_)
        self.single_observation_space = self._core.observation_space
        self.single_action_space = self._core.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observed, Infos]:
        """Begin an episode everywhere.

        Raises:
            DescriptionError: no layout can be drawn, there is more than one seed, or an episode is asked for.
        """
        if isinstance(seed, list):
            raise DescriptionError(f"seed={seed}: must be one number, of which every environment drives other episodes")
        if episode_of(options) is not None:
            raise DescriptionError("options.episode: must not be there; every environment drives other episodes")
        if seed is not None:
            self._core.stepper.reseed(whole("seed", seed))
            self._next = self._first + np.arange(self.num_envs)
        super().reset(seed=None if seed is None else int(seed))
        episodes = self._begin(range(self.num_envs))
        self._over[:] = False
        return self._core.formed(self._core.perceive()[:, 0]), {"episode_index": episodes}

    def step(self, actions: NDArray[np.float32]) -> tuple[Observed, NDArray[Any], NDArray[Any], NDArray[Any], Infos]:
        """Drive through one control period, or begin anew where an episode was over; errors as of ``NavigationEnv``."""
        asked = numbers("actions", actions, (self.num_envs, 2))[:, None]
        self._begin(np.flatnonzero(self._over).tolist())
        told = self._core.step(asked)
        terminated, truncated = told.terminated[:, 0], told.truncated[:, 0]
        self._over = terminated | truncated
        infos: Infos = {}
        for place in np.flatnonzero(self._over).tolist():
            infos = self._add_info(infos, self._core.told(place, 0, measures=self._metrics), place)
        return self._core.formed(self._core.seen()[:, 0]), told.rewards[:, 0], terminated, truncated, infos

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads, and close the simulators."""
        self._core.stepper.close()

    def _begin(self, places: Any) -> NDArray[np.int64]:
        """Begin the next episodes in some places, and return which ones are driven in all."""
        for place in places:
            self._next[place] = self._core.stepper.begin_next(place, int(self._next[place]), self.num_envs)
            self._next[place] += self.num_envs
        return self._next - self.num_envs
