"""All robots of a world, as a parallel environment of PettingZoo."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Space
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from navbench.gym.core import Core, FloatArray, Form, Observed, cell_of_words, numbers
from navbench.gym.reward import Reward, progress
from navbench.raised import shortened
from navbench.validation import instead


class FleetEnv(ParallelEnv):  # type: ignore[misc]
    """All robots of a world, each with the actions, observations and rewards of ``NavigationEnv``.

    All observe the same instant, then all move. A robot that has ended is no agent any more, and stays as an obstacle.

    Args:
        words: as of ``NavigationEnv``.
        config_dir: the same.
        reward: the same.
        observation: the same.
        choices: the same.

    Raises:
        DescriptionError: as ``NavigationEnv``.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": [], "name": "navbench_fleet"}

    def __init__(
        self,
        *words: str,
        config_dir: str | Path | None = None,
        reward: Reward = progress,
        observation: Form = "flat",
        **choices: Any,
    ) -> None:
        cell = cell_of_words(words, choices, config_dir)
        self._core = Core(cell, reward, observation)
        self.possible_agents = [f"robot_{i}" for i in range(self._core.stepper.robots)]
        self.agents: list[str] = []
        self.render_mode = None
        self.observation_spaces = dict.fromkeys(self.possible_agents, self._core.observation_space)
        self.action_spaces = dict.fromkeys(self.possible_agents, self._core.action_space)

    def observation_space(self, agent: str) -> Space[Any]:
        """Return an agent's observation space, the same for all."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[Any]:
        """Return an agent's action space, the same for all."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observed], dict[str, dict[str, Any]]]:
        """Begin an episode, as ``NavigationEnv.reset``."""
        episode = self._core.begin(seed, options)
        self.agents = self.possible_agents[:]
        seen = self._core.perceive()[0]
        infos = {agent: {"episode_index": episode} for agent in self.agents}
        return {agent: self._core.formed(seen[i]) for i, agent in enumerate(self.agents)}, infos

    def step(self, actions: dict[str, NDArray[np.float32]]) -> tuple[Any, ...]:
        """Drive through one control period, and tell what it brought to each agent; errors as of ``NavigationEnv``."""
        told = self._core.step(self._asked(actions))
        rewards, terminated, truncated = (part[0].tolist() for part in told)
        seen, numbers = self._core.seen()[0], {agent: self.possible_agents.index(agent) for agent in self.agents}
        over = {agent for agent, i in numbers.items() if terminated[i] or truncated[i]}
        told_of = {agent: self._core.told(0, i) if agent in over else {} for agent, i in numbers.items()}
        self.agents = [agent for agent in self.agents if agent not in over]
        return (
            {agent: self._core.formed(seen[i]) for agent, i in numbers.items()},
            *({agent: part[i] for agent, i in numbers.items()} for part in (rewards, terminated, truncated)),
            told_of,
        )

    def close(self) -> None:
        """Close the simulator."""
        self._core.stepper.close()

    def _asked(self, actions: Mapping[str, Any]) -> FloatArray:
        """Return what is asked of every robot, (1, robots, 2); of one that has ended, which nobody drives, nothing.

        Raises:
            ValueError: an agent that drives has none, there is no such agent, or one is not two finite numbers.
        """
        if not isinstance(actions, Mapping):
            raise ValueError(f"actions={shortened(repr(actions), 100)}: must be a mapping from agents to actions")
        for agent in actions.keys() - self.action_spaces.keys():
            raise ValueError(f"actions.{agent}: there is no such agent; {instead(agent, self.possible_agents)}")
        for agent in self.agents:
            if agent not in actions:
                raise ValueError(f"actions.{agent}: missing; every agent that drives needs an action")
        asked, drive = (
            np.zeros((len(self.possible_agents), 2)),
            [agent in self.agents for agent in self.possible_agents],
        )
        if self.agents:
            asked[drive] = numbers("actions", [actions[agent] for agent in self.agents], (len(self.agents), 2))
        return asked[None]
