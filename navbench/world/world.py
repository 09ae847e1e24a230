"""A world: its name, a source of layouts, when a robot has arrived, and when an episode ends."""

import math
from typing import Any, Protocol, runtime_checkable

import numpy as np
from pydantic import ConfigDict, ValidationError
from pydantic.dataclasses import dataclass

from navbench.mathematics.streams import stream
from navbench.validation import DescriptionError, Positive
from navbench.world.layout import DrawnWorld, Layout, parts_of

LAYOUT_DRAWS_MAX = 100  # a source that finds no room this often finds none for the episode


class NoRoomError(DescriptionError):
    """A drawn thing finds no place: the whole layout is drawn again, from where its stream stands."""


@runtime_checkable
class Source(Protocol):
    """What draws layouts, such as a ``Layout``, which is always the same, or a generator.

    A source may also say, as ``Layout`` does, how many ``robots`` it draws for (otherwise one is counted where nothing
    could be drawn), the speed of its fastest mover, ``fastest_mps``, and by ``check_fits(radius_m, goal_tolerance_m)``
    that a robot is too large for it.
    """

    def draw(self, rng: np.random.Generator, episode: int) -> Layout:
        """Return an episode's layout.

        Args:
            rng: the episode's stream "layout": the same for every controller.
            episode: its index.

        Raises:
            NoRoomError: something found no place, and another draw may succeed.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True, config=ConfigDict(extra="forbid", arbitrary_types_allowed=True))
class World:
    """A world, as drawn for one robot; it is never scaled.

    Attributes:
        name: its configuration name, which also names its random streams.
        source: what draws its layouts.
        goal_tolerance_m: how near to its goal a robot's centre must come [m].
        time_limit_s: when an episode ends for every robot still running [s].
    """

    name: str
    source: Source
    goal_tolerance_m: Positive
    time_limit_s: Positive

    @property
    def robots(self) -> int:
        """How many robots drive, as far as the source says so; otherwise 1."""
        return int(getattr(self.source, "robots", 1))

    @property
    def fastest_mps(self) -> float:
        """The largest speed of any mover, as far as the source says so [m/s]."""
        return float(getattr(self.source, "fastest_mps", 0.0))

    def check_starts(self) -> None:
        """Check that no robot begins at its goal, as far as the layout is known: it would succeed without driving.

        Raises:
            DescriptionError: one does.
        """
        if not isinstance(self.source, Layout) or self.source.finish_line is not None:
            return
        for i, (start, goal) in enumerate(zip(self.source.starts, self.source.goals, strict=True)):
            if math.hypot(start.x_m - goal.x_m, start.y_m - goal.y_m) <= self.goal_tolerance_m:
                raise DescriptionError(
                    f"world.starts[{i}]: ({start.x_m}, {start.y_m}) must lie further from its goal than "
                    f"world.goal_tolerance_m={self.goal_tolerance_m}"
                )

    def check_fits(self, radius_m: float) -> None:
        """Check that a robot is not too large, as far as the source can tell before it draws.

        Raises:
            DescriptionError: it is.
        """
        check = getattr(self.source, "check_fits", None)
        if check is not None:
            try:
                check(radius_m, self.goal_tolerance_m)
            except DescriptionError as error:
                place = "world" if isinstance(self.source, Layout) else "world.source"
                raise DescriptionError(f"{place}.{error}") from None

    def drawn_for(self, seed: int, episode: int) -> DrawnWorld:
        """Return the world with the layout of an episode.

        Raises:
            DescriptionError: the source found no room in any of ``LAYOUT_DRAWS_MAX`` draws, raised, or drew no layout.
        """
        rng, where = stream(seed, self.name, episode, "layout"), f"world={self.name}, seed={seed}, episode={episode}"
        for _ in range(LAYOUT_DRAWS_MAX):
            try:
                layout = self.source.draw(rng, episode)
                break
            except NoRoomError as error:
                crowded = error
            except (Exception, SystemExit) as error:  # a user's code may raise anything; it costs this episode
                raise DescriptionError(f"{where}: {_reason(error)}") from None
        else:
            raise DescriptionError(f"{where}: {crowded}; tried {LAYOUT_DRAWS_MAX} times")
        if not isinstance(layout, Layout):
            raise DescriptionError(f"{where}: draw must return a Layout, got {type(layout).__name__}")
        return self.of(layout)

    def of(self, layout: Layout) -> DrawnWorld:
        """Return this world with a layout that was drawn before."""
        return drawn(layout, self.name, self.goal_tolerance_m, self.time_limit_s)


def drawn(layout: Layout, name: str, goal_tolerance_m: float, time_limit_s: float) -> DrawnWorld:
    """Return a layout with what its world says of an episode in it."""
    own: dict[str, Any] = parts_of(layout)
    return DrawnWorld(**own, name=name, goal_tolerance_m=goal_tolerance_m, time_limit_s=time_limit_s)


def _reason(error: BaseException) -> str:
    """Return what a source raised as one line."""
    if isinstance(error, ValidationError):
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"]))
        return f"{error.title}: {place}: {first['msg']}" if place else f"{error.title}: {first['msg']}"
    return " ".join((str(error) if isinstance(error, DescriptionError) else f"{type(error).__name__}: {error}").split())
