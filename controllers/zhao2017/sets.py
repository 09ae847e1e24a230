"""The fuzzy sets and rules of Zhao and Lee's two fuzzy controllers, as checked data.

R. Zhao, H.-K. Lee, "Fuzzy-based Path Planning for Multiple Mobile Robots in Unknown Dynamic Environment", Journal of
Electrical Engineering & Technology 12, 2017; section 3, Figures 3 and 5, Tables 1 and 2.

The sets of OA-FLC are given one by one, by left foot l, peak c and right foot r, as zhao2018 evolves them: the first
set of a variable has no l and the last one no r. Those of TO-FLC, which nobody evolves, are given by their peaks.
Names are the papers': S small, M medium, B big, V very; R right, L left, F front, B back; N negative, P positive.
"""

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Literal, NamedTuple, get_args

from pydantic.dataclasses import dataclass

from navbench.validation import STRICT, Number

Speed = Literal["NB", "NS", "Z", "PS", "PB"]
Table = Mapping[str, Mapping[str, Speed]]

SPEEDS: tuple[str, ...] = get_args(Speed)
DANGERS = ("S", "M", "B", "VB")
DIRECTIONS = ("RB", "R", "RF", "F", "LF", "L", "LB", "B")
DISTANCES = ("VS", "S", "M", "B", "VB")
TURNS = ("NB", "NM", "NS", "Z", "PS", "PM", "PB")


class Universe(NamedTuple):
    """Where the peaks of a variable may lie; the two ends of a circle are the same place."""

    low: float
    high: float
    circular: bool = False


UNIVERSES = {
    "R_s": Universe(0.0, 6.0),  # the end is assumed, half as long again as the distance to the un-evolved peak of VB
    "Phi_rad": Universe(-math.pi, math.pi, circular=True),
    "vL": Universe(-1.0, 1.0),  # shares of the wheels' limit (section 3.1)
    "vR": Universe(-1.0, 1.0),
}


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class First:
    """The first set of a variable: peak and right foot."""

    c: Number
    r: Number

    def __post_init__(self) -> None:
        """Check the order."""
        if not self.c < self.r:
            raise ValueError(f"needs c < r, not {self.c}, {self.r}")


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Middle:
    """A set between two others: left foot, peak and right foot."""

    l: Number  # noqa: E741 - the papers' letter
    c: Number
    r: Number

    def __post_init__(self) -> None:
        """Check the order."""
        if not self.l < self.c < self.r:
            raise ValueError(f"needs l < c < r, not {self.l}, {self.c}, {self.r}")


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Last:
    """The last set of a variable: left foot and peak."""

    l: Number  # noqa: E741 - the papers' letter
    c: Number

    def __post_init__(self) -> None:
        """Check the order."""
        if not self.l < self.c:
            raise ValueError(f"needs l < c, not {self.l}, {self.c}")


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class DangerSets:
    """The sets of R [s]."""

    S: First
    M: Middle
    B: Middle
    VB: Last

    def __post_init__(self) -> None:
        """Check the peaks."""
        _check_peaks(peaks_of(self), UNIVERSES["R_s"])


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class DirectionSets:
    """The sets of Phi [rad]."""

    RB: First
    R: Middle
    RF: Middle
    F: Middle
    LF: Middle
    L: Middle
    LB: Middle
    B: Last

    def __post_init__(self) -> None:
        """Check the peaks."""
        _check_peaks(peaks_of(self), UNIVERSES["Phi_rad"])


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class SpeedSets:
    """The sets of a wheel's speed [share of its limit]."""

    NB: First
    NS: Middle
    Z: Middle
    PS: Middle
    PB: Last

    def __post_init__(self) -> None:
        """Check the peaks."""
        _check_peaks(peaks_of(self), UNIVERSES["vL"])


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class OaMemberships:
    """The sets of OA-FLC: inputs R and Phi, outputs the left and the right wheel's speed."""

    R_s: DangerSets
    Phi_rad: DirectionSets
    vL: SpeedSets
    vR: SpeedSets


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class ToMemberships:
    """The peaks of TO-FLC's sets, ascending: D [robot radii], Psi [rad], both wheels' speed [share of their limit]."""

    D_radii: Mapping[str, Number]
    Psi_rad: Mapping[str, Number]
    v: Mapping[str, Number]

    def __post_init__(self) -> None:
        """Check the names and the peaks."""
        for key, terms, universe in (
            ("D_radii", DISTANCES, Universe(0.0, math.inf)),
            ("Psi_rad", TURNS, Universe(-math.pi, math.pi)),
            ("v", SPEEDS, UNIVERSES["vL"]),
        ):
            peaks = getattr(self, key)
            if tuple(peaks) != terms:
                raise ValueError(f"{key} must name the sets {', '.join(terms)}, in this order")
            _check_peaks(peaks, universe, f"{key}: ")


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class OaRules:
    """Table 1: for each set of R, by row, and of Phi, by column, the left and the right wheel's speed."""

    vL: Table
    vR: Table

    def __post_init__(self) -> None:
        """Check that every cell is there."""
        _check_table("vL", self.vL, DANGERS, DIRECTIONS)
        _check_table("vR", self.vR, DANGERS, DIRECTIONS)


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class ToRules:
    """Table 2: for each set of D, by row, and of Psi, by column, the left and the right wheel's speed."""

    vL: Table
    vR: Table

    def __post_init__(self) -> None:
        """Check that every cell is there."""
        _check_table("vL", self.vL, DISTANCES, TURNS)
        _check_table("vR", self.vR, DISTANCES, TURNS)


def sets_of(sets: Any) -> dict[str, First | Middle | Last]:
    """Return the sets of a variable by name, in order."""
    return {field.name: getattr(sets, field.name) for field in fields(sets)}


def peaks_of(sets: Any) -> dict[str, float]:
    """Return the peaks of a variable's sets by name, in order."""
    return {name: one.c for name, one in sets_of(sets).items()}


def _check_peaks(peaks: Mapping[str, float], universe: Universe, key: str = "") -> None:
    at = list(peaks.values())
    if not all(before < after for before, after in zip(at, at[1:], strict=False)):
        raise ValueError(f"{key}the peaks must ascend from {list(peaks)[0]} to {list(peaks)[-1]}, not {at}")
    if not universe.low <= at[0] <= at[-1] <= universe.high:
        raise ValueError(f"{key}the peaks must lie from {universe.low} to {universe.high}, not {at}")
    if universe.circular and at[-1] - at[0] >= universe.high - universe.low:
        raise ValueError(f"{key}the first and the last peak must not be the same place on the circle")


def _check_table(key: str, table: Table, rows: tuple[str, ...], columns: tuple[str, ...]) -> None:
    if set(table) != set(rows):
        raise ValueError(f"{key} must have the rows {', '.join(rows)}")
    for row in rows:
        if set(table[row]) != set(columns):
            raise ValueError(f"{key}.{row} must have the columns {', '.join(columns)}")
