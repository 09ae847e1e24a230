"""What a search moves in: the parameters' sides of the unit cube, and what a tuner may know of the cube."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from navbench.contract import FloatArray

Scale = Literal["linear", "log"]
Repair = Callable[[dict[str, float]], Mapping[str, float]]


@dataclass(frozen=True, slots=True)
class Dimension:
    """One number to tune: a side of the unit cube.

    Attributes:
        name: what the parameter is called.
        low: its value at 0.
        high: its value at 1, above ``low``.
        scale: "linear", or "log": equal steps of the unit multiply the value by equal factors; ``low`` is above 0.
        start: its value before the search, or None; the start's place leads back to exactly this value.
        integer: whether only whole numbers are tried: a place stands for the nearest one.
    """

    name: str
    low: float
    high: float
    scale: Scale
    start: float | None = None
    integer: bool = False

    def __post_init__(self) -> None:
        """Check the bounds.

        Raises:
            ValueError: a value is wrong; the message names it and what is allowed.
        """
        _check_name(self.name)
        if not isinstance(self.integer, bool):
            raise ValueError(f"{self.name}.integer={self.integer!r}: must be true or false")
        for key in ("low", "high"):
            value = getattr(self, key)
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise ValueError(f"{self.name}.{key}={value!r}: must be a finite number")
            if self.integer and value != int(value):
                raise ValueError(f"{self.name}.{key}={value!r}: must be a whole number, or integer: false")
        if self.scale not in get_args(Scale):
            raise ValueError(f"{self.name}.scale={self.scale!r}: must be one of {', '.join(get_args(Scale))}")
        if self.high <= self.low:
            raise ValueError(f"{self.name}.high={self.high!r}: must be greater than low={self.low!r}")
        if self.scale == "log" and self.low <= 0.0:
            raise ValueError(f"{self.name}.low={self.low!r}: must be greater than 0 on a log scale")
        if not math.isfinite(self.high - self.low):
            raise ValueError(f"{self.name}.high={self.high!r}: must be a finite distance above low={self.low!r}")
        if self.start is not None:
            self.unit_at(self.start)
            if self.integer and self.start != int(self.start):
                raise ValueError(f"{self.name}.start={self.start!r}: must be a whole number")

    @property
    def levels(self) -> int:
        """No levels: any value between the bounds will do."""
        return 0

    def value_at(self, unit: float) -> float:
        """Return the value at a place in [0, 1]; exactly ``low`` at 0 and ``high`` at 1.

        Raises:
            ValueError: the place lies outside.
        """
        _check_unit(self.name, unit)
        if unit in (0.0, 1.0):
            return float(self.high if unit else self.low)
        if self.start is not None and unit == self.unit_at(self.start):
            return float(self.start)
        if self.scale == "log":
            value = math.exp((1.0 - unit) * math.log(self.low) + unit * math.log(self.high))
        else:
            value = self.low + unit * (self.high - self.low)
        value = min(max(value, self.low), self.high)  # rounding may step over a bound
        return float(round(value)) if self.integer else value

    def unit_at(self, value: float) -> float:
        """Return the place in [0, 1] of a value.

        Raises:
            ValueError: the value lies outside the bounds.
        """
        if not self.low <= value <= self.high:
            raise ValueError(f"{self.name}={value!r}: must be between {self.low!r} and {self.high!r}")
        if self.scale == "log":
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def parameter(self, value: float) -> float:
        """Return what a controller's parameter becomes: the value itself."""
        return int(value) if self.integer else value


@dataclass(frozen=True, slots=True)
class Choice:
    """One choice to tune: a side of the unit cube, cut into a level for each choice.

    The search knows a choice by its index; only the controller's parameter is the choice itself.

    Attributes:
        name: what the parameter is called.
        choices: at least two different names, or whole numbers, in an order in which neighbours are alike.
        start: the index of the choice before the search, or None.
    """

    name: str
    choices: tuple[str, ...] | tuple[int, ...]
    start: int | None = None

    def __post_init__(self) -> None:
        """Check the choices.

        Raises:
            ValueError: a value is wrong; the message names it and what is allowed.
        """
        _check_name(self.name)
        given: Any = self.choices
        kinds = {type(choice) for choice in given} if isinstance(given, list | tuple) else set()
        if kinds not in ({str}, {int}) or len(given) < 2 or len(set(given)) < len(given):
            raise ValueError(f"{self.name}.choices={given!r}: must be two or more different names, or whole numbers")
        object.__setattr__(self, "choices", tuple(given))  # a YAML file gives a list
        if self.start is not None:
            self.unit_at(self.start)

    @property
    def levels(self) -> int:
        """How many choices there are."""
        return len(self.choices)

    def value_at(self, unit: float) -> float:
        """Return the index of the choice at a place in [0, 1]: each has an equal share of it.

        Raises:
            ValueError: the place lies outside.
        """
        _check_unit(self.name, unit)
        levels = len(self.choices)
        return float(min(int(unit * levels), levels - 1))

    def unit_at(self, value: float) -> float:
        """Return the middle of the share of a choice, given by its index.

        Raises:
            ValueError: there is no such choice.
        """
        if value not in range(self.levels):
            raise ValueError(f"{self.name}={value!r}: must be a whole number from 0 to {self.levels - 1}")
        return (value + 0.5) / self.levels

    def parameter(self, value: float) -> str | int:
        """Return what a controller's parameter becomes: the choice of an index."""
        return self.choices[int(value)]


Side = Dimension | Choice


@dataclass(frozen=True, slots=True)
class Space:
    """What a tuner knows of the unit cube that it searches.

    Attributes:
        levels: (D,) for each side in how many levels it is cut, so that level k of n stands at (k + 0.5) / n;
            0 for a side without levels.
        start: (D,) the place before the search, or None.
        repair: from places (n, D) to the allowed places (n, D) that are evaluated in their stead: those with levels
            moved to the middle of theirs, and whatever must hold between the parameters made to hold.
    """

    levels: NDArray[np.int64]
    start: FloatArray | None
    repair: Callable[[FloatArray], FloatArray]

    @property
    def size(self) -> int:
        """The number of sides, D."""
        return len(self.levels)


def space_of(sides: Sequence[Side], repair: Repair | None = None) -> Space:
    """Return what a tuner knows of these sides.

    Args:
        sides: the parameters. There is a start where each of them has one.
        repair: makes hold what must hold between the parameters, by name: from values to allowed values; an index
            stands for a choice. None where the bounds are all. What it raises, or what it returns outside of the
            bounds, is a ValueError when a place is repaired.
    """
    starts = [side.unit_at(side.start) for side in sides if side.start is not None]
    start = np.array(starts) if len(starts) == len(sides) else None
    levels = np.array([side.levels for side in sides], dtype=np.int64)
    if repair is None and not levels.any():
        return Space(levels, start, lambda places: places)
    return Space(levels, start, lambda places: np.array([_allowed(sides, repair, p) for p in places.tolist()]))


def values_at(sides: Sequence[Side], place: Sequence[float]) -> list[float]:
    """Return the values at a place in the cube."""
    return [side.value_at(unit) for side, unit in zip(sides, place, strict=True)]


def _allowed(sides: Sequence[Side], repair: Repair | None, place: Sequence[float]) -> list[float]:
    """Return the allowed place that stands for a place; one whose value stays as it was does not move at all."""
    old = values_at(sides, place)
    new = old if repair is None else _repaired(sides, old, repair)
    return [
        side.unit_at(after) if side.levels or after != before else unit
        for side, unit, before, after in zip(sides, place, old, new, strict=True)
    ]


def _repaired(sides: Sequence[Side], values: Sequence[float], repair: Repair) -> list[float]:
    """Return values after their repair, or refuse what the repair does."""
    names = [side.name for side in sides]
    try:
        given = dict(zip(names, values, strict=True))
        new = {name: float(value) for name, value in repair(dict(given)).items()}
        if new.keys() != given.keys():
            raise ValueError(f"must return a value for each of the {len(names)} names that it is given, and no other")
        for side in sides:
            if new[side.name] != given[side.name]:
                side.unit_at(new[side.name])
    except ValueError as error:
        raise ValueError(f"controller.repair: {error}") from None
    except Exception as error:  # a user's repair may raise anything
        raise ValueError(f"controller.repair: {type(error).__name__}: {error}") from None
    return [new[name] for name in names]


def _check_name(name: Any) -> None:
    if not isinstance(name, str) or not name:
        raise ValueError(f"name={name!r}: must be a word that is not empty")


def _check_unit(name: str, unit: float) -> None:
    if not 0.0 <= unit <= 1.0:
        raise ValueError(f"{name}: unit={unit!r}: must be between 0 and 1")
