"""What the environments share: built from the words of a command line, spaces, and one control period as arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from pathlib import Path
from types import EllipsisType
from typing import Any, Literal, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from navbench.cli.composing import key_of
from navbench.cli.configuration import SEED_MAX
from navbench.cli.errors import one_line_errors, texts
from navbench.cli.interface import cells_of
from navbench.episode.stepping import GOAL_X, GOAL_Y, HEADING, Outside, Stepper, V, W, X, Y
from navbench.experiments.cells import Cell
from navbench.gym.reward import Period, Reward
from navbench.learning import Scales
from navbench.raised import shortened
from navbench.simulation.motion import COLLIDED, REACHED, RUNNING
from navbench.validation import DescriptionError
from navbench.world.layout import Layout
from navbench.world.world import Source, World

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Observed = Any  # float32: one vector, or a dict of its parts
Form = Literal["flat", "dict"]

BESIDE = ("goal", "velocity")  # two numbers each, after the ranges


class Told(NamedTuple):
    """What a control period brought, (episodes, robots) each.

    Attributes:
        rewards: 0 where an episode began.
        terminated: whether a robot reached its goal or hit something.
        truncated: whether the time is over for a robot that did not.
    """

    rewards: FloatArray
    terminated: BoolArray
    truncated: BoolArray


def cell_of_words(words: Sequence[str], choices: dict[str, Any], config_dir: str | Path | None) -> Cell:
    """Return the cell that the words describe, in planar; its controller is nobody's.

    Args:
        words: such as "world=deadlock".
        choices: further ones as keys and values, see ``navbench.cli.given``; None says nothing.
        config_dir: a folder with further worlds, robots and sensors.

    Raises:
        DescriptionError: one line that names the key, its value and what is allowed.
    """
    keys = {*map(key_of, texts(words)), *(key for key, value in choices.items() if value is not None)}
    first = {"controller": "go_to_goal", "simulator": "planar"}
    added = [f"{key}={name}" for key, name in first.items() if key not in keys]
    with one_line_errors():
        (cell,) = cells_of([*added, *words], choices, config_dir).cells
    if not cell.simulator.is_compiled:
        raise DescriptionError(f"simulator={cell.names.simulator}: environments need a compiled one, such as planar")
    if cell.sensors.tracker is not None:
        raise DescriptionError(
            f"sensors={cell.names.sensors}: environments have no tracker; choose sensors without one"
        )
    return cell


def numbers(key: str, given: object, shape: tuple[int, ...], counted: BoolArray | EllipsisType = ...) -> FloatArray:
    """Return what a program gives as an array of finite numbers.

    Args:
        key: what it is called, for the error message.
        given: an array, or lists in lists.
        shape: which it must have.
        counted: of which of them it is looked at whether they are finite.

    Raises:
        ValueError: one line that says what is allowed.
    """
    try:
        found = np.asarray(given)
        fits = found.shape == shape and found.dtype.kind in "biuf" and bool(np.isfinite(found[counted]).all())
    except (TypeError, ValueError):  # of no array, or of lists that are not equally long
        fits = False
    if not fits:
        raise ValueError(f"{key}={shortened(repr(given), 100)}: must be finite numbers of shape {shape}")
    return np.asarray(found, np.float64)


def whole(key: str, given: object, least: int = 0, most: int = SEED_MAX) -> int:
    """Return a whole number that a program gives; raises ``DescriptionError`` where it is none, or out of bounds."""
    number = int(given) if isinstance(given, Integral) and not isinstance(given, bool) else -1
    if not least <= number <= most:
        raise DescriptionError(f"{key}={given!r:.80}: must be a whole number from {least} to {most}")
    return number


def episode_of(options: Mapping[str, Any] | None) -> int | None:
    """Return which episode the options of a reset ask for; what else they hold is for others.

    Raises:
        DescriptionError: they are no mapping, or it is no whole number.
    """
    if options is not None and not isinstance(options, Mapping):
        raise DescriptionError(f"options={options!r:.80}: must be a mapping")
    asked = (options or {}).get("episode")
    return None if asked is None else whole("options.episode", asked)


class Core:
    """Some episodes side by side, their observations and rewards.

    Args:
        cell: what is driven.
        reward: see ``navbench.gym.reward``.
        observation: "flat" or "dict".
        options: of ``Stepper``.

    Attributes:
        stepper: what drives.
        observation_space: one robot's.
        action_space: one robot's.
    """

    def __init__(self, cell: Cell, reward: Reward, observation: Form, **options: Any) -> None:
        if observation not in ("flat", "dict"):
            raise DescriptionError(f"observation={observation}: must be flat or dict")
        if not callable(reward):
            raise DescriptionError(f"reward={reward!r:.80}: must be a function of a Period, see navbench.gym.reward")
        self._cell, self._reward, self._form = cell, reward, observation
        self._next = cell.first_episode
        outside = replace(cell, controller=Outside, configuration={"controller": {"build": {}}})
        self.stepper = Stepper(outside.runner, **options)
        self._scales, ring = Scales.of(self.stepper.setup), self.stepper.setup.sensors
        self._sensors = len(ring)
        self._first_m = np.ones(self.stepper.outcomes.shape)
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        parts: dict[str, spaces.Space[Any]] = {"ranges": spaces.Box(0.0, 1.0, (self._sensors,), np.float32)}
        parts |= {name: spaces.Box(-np.inf, np.inf, (2,), np.float32) for name in BESIDE}
        low, high = (np.concatenate([getattr(part, side) for part in parts.values()]) for side in ("low", "high"))
        self.observation_space: spaces.Space[Any] = (
            spaces.Dict(parts) if observation == "dict" else spaces.Box(low, high, dtype=np.float32)
        )

    def begin(self, seed: int | None, options: Mapping[str, Any] | None) -> int:
        """Begin an episode in the first place, and return its index.

        Args:
            seed: of which the first episode is begun; None for the next one.
            options: of a reset; ``episode`` in them says which one instead.

        Raises:
            DescriptionError: they are wrong, or no layout can be drawn.
        """
        asked = episode_of(options)
        if seed is not None:
            self.stepper.reseed(whole("seed", seed))
            self._next = self._cell.first_episode
        episode = self.stepper.begin_next(0, self._next if asked is None else asked, 1)
        self._next = episode + 1
        return episode

    def seen(self) -> NDArray[np.float32]:
        """Return what the robots observe, (episodes, robots, n_sensors + 4), newly made."""
        known = self.stepper.known
        pose, goal = (known[..., X], known[..., Y], known[..., HEADING]), (known[..., GOAL_X], known[..., GOAL_Y])
        return self._scales.observed(self.stepper.ranges_m, pose, goal, (known[..., V], known[..., W]))

    def formed(self, seen: NDArray[np.float32]) -> Observed:
        """Return observations, (..., n_sensors + 4), as they were asked for."""
        if self._form == "flat":
            return seen
        return {"ranges": seen[..., :-4], "goal": seen[..., -4:-2], "velocity": seen[..., -2:]}

    def perceive(self) -> NDArray[np.float32]:
        """Return what the robots of episodes observe that have all been begun just now."""
        self.stepper.move(np.zeros((*self.stepper.outcomes.shape, 2)))
        self._first_m[:] = self.stepper.distances_m
        return self.seen()

    def step(self, actions: FloatArray) -> Told:
        """Move all through one control period, and tell what it brought.

        Args:
            actions: (episodes, robots, 2) as ``action_space``, finite.

        Raises:
            RuntimeError: somewhere no episode goes on.
            ValueError: the reward is not a finite number a robot.
        """
        stepper = self.stepper
        before_m, begun, ran = stepper.distances_m.copy(), stepper.begun.copy()[:, None], stepper.outcomes == RUNNING
        stepper.move(actions * self._scales[1:])
        if begun.any():
            self._first_m = np.where(begun, stepper.distances_m, self._first_m)
        reached, collided = stepper.outcomes == REACHED, stepper.outcomes == COLLIDED
        over = (stepper.periods == stepper.periods_max)[:, None] & (stepper.outcomes == RUNNING)
        kept = stepper.distances_m, self._first_m, stepper.clearances_m
        distance_m, first_m, clearance_m = (values.copy() for values in kept)  # which a reward may write to
        period = Period(
            distance_m, before_m, first_m, clearance_m, reached.copy(), collided.copy(), over.copy(), actions,
            1.0 / stepper.periods_max, self._cell.robot.radius_m,
        )  # fmt: skip
        counted = ran & ~begun
        rewards = numbers("reward", self._reward(period), reached.shape, counted)
        return Told(np.where(counted, rewards, 0.0), reached | collided, over)

    def told(self, place: int, index: int, *, measures: bool = True) -> dict[str, Any]:
        """Return what an environment's info says of a robot that has ended."""
        if not measures:
            outcomes = {RUNNING: "timed_out", REACHED: "reached", COLLIDED: "collided"}
            return {"outcome": outcomes[int(self.stepper.outcomes[place, index])]}
        record = self.stepper.record(place, index)
        return {"outcome": record.outcome, "reason": record.reason, "metrics": dict(record.metrics)}


@dataclass(frozen=True)
class Alone:
    """Draws what another source draws, without all robots but the first.

    Attributes:
        source: the other one.
        robots: how many robots drive.
    """

    source: Source
    robots: int = 1

    @property
    def fastest_mps(self) -> float:
        """The largest speed of any mover [m/s]."""
        return float(getattr(self.source, "fastest_mps", 0.0))

    def draw(self, rng: np.random.Generator, episode: int) -> Layout:
        """Return an episode's layout with its first robot."""
        layout = self.source.draw(rng, episode)
        return replace(layout, starts=layout.starts[:1], goals=layout.goals[:1])


def alone(world: World) -> World:
    """Return a world in which only its first robot drives, in the same layouts."""
    if world.robots == 1:
        return world
    source = world.source
    if isinstance(source, Layout):
        return replace(world, source=replace(source, starts=source.starts[:1], goals=source.goals[:1]))
    return replace(world, source=Alone(source))
