"""Factors: what a reconstruction chose and another reader might have chosen otherwise, ready to be sampled.

A factor takes a number u in [0, 1] to the values of all that varies with it: one value, a vector moved as its source
says, values that are tied to it, or a whole group. A range whose one end is null has two choices: off, and the other
end.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from navbench.records import CellKey
from navbench.sources import Source
from navbench.validation import DescriptionError, describe, instead

VECTORS = (Mapping, list, tuple)
SEARCHED = "tunable."  # before the places of what no cell has: the bounds within which tunings search


@dataclass(frozen=True, slots=True)
class Factor:
    """What varies together.

    Attributes:
        name: of its first thing and its value, as "sflc.behaviors.unsafe_m", or of its first thing and its group.
        part: of which part of a cell it is, such as "controller".
        things: what that part is called, such as "sflc"; the factor moves these alone. Controllers of which a value
            has the same source share one: a paper has it once.
        members: the sources of its values, by their dotted places in the part.
    """

    name: str
    part: str
    things: tuple[str, ...]
    members: Mapping[str, Source]

    @property
    def kind(self) -> str:
        """Of which kind its first source is: fitted, selected or assumed."""
        return self.source.kind

    @property
    def source(self) -> Source:
        """The source of its first value."""
        return next(iter(self.members.values()))

    @property
    def bounds(self) -> tuple[Any, ...]:
        """The ends of its first range, or its first choices."""
        return self.choices or self.source.range or ()

    @property
    def choices(self) -> tuple[Any, ...]:
        """Its first value's choices; none of a range."""
        return _choices(self.source)

    def at(self, u: float) -> float:
        """Return where in its first range it is at u in [0, 1]; of a factor without choices."""
        return _within(self.source, u)


def factors_of(cells: Iterable[CellKey]) -> list[Factor]:
    """Return the factors of some cells, such as a study's, in the order in which the cells first name them."""
    found: dict[str, Factor] = {}
    for cell in cells:
        for part, sources in cell.sources.items():
            thing = getattr(cell.names, part)
            for key, values in sources.items():
                source = describe(Source, values, f"{part}.sources.{key}")
                if source.range or source.choices:
                    name = f"{thing}.{source.group or key.removeprefix('build.')}"
                    members = found[name].members if name in found else {}
                    found[name] = Factor(name, part, (thing,), {**members, key: source})
    joined: dict[str, Factor] = {}
    for factor in found.values():
        alone = factor.name if factor.part != "controller" else ""
        first = joined.setdefault(repr((factor.members, alone)), factor)
        if first is not factor:
            joined[repr((factor.members, alone))] = replace(first, things=(*first.things, *factor.things))
    return list(joined.values())


def under(prior: Mapping[str, Any], factors: Iterable[Factor], key: str) -> list[Factor]:
    """Return the factors that a prior of the study's own names, with its ranges.

    Args:
        prior: for the name of each factor the range of its values that have one; None for as they are.
        factors: the factors.
        key: what the prior is called in messages.

    Raises:
        DescriptionError: there is no such factor, or a range does not suit it.
    """
    known = {factor.name: factor for factor in factors}
    for name in prior:
        if name not in known:
            raise DescriptionError(f"{key}.{name}: no such factor; {instead(name, known)}")
    return [_ranged(known[name], prior[name], f"{key}.{name}") for name in known if name in prior]


def _ranged(factor: Factor, ends: Any, key: str) -> Factor:
    if ends is None:
        return factor
    values = {place: asdict(source) for place, source in factor.members.items() if source.range}
    if len(values) != 1 or len(factor.members) != 1:
        raise DescriptionError(f"{key}: must be null, for it is no single value with a range")
    ((place, source),) = values.items()
    return replace(factor, members={place: describe(Source, {**source, "range": list(ends)}, key)})


def apply(factor: Factor, u: float, configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a factor sets in a cell, by dotted place: ``{"controller.build.unsafe_m": 0.05}``.

    Args:
        factor: the factor.
        u: where in its range, or among its choices, in [0, 1].
        configuration: the cell's, which holds what the factor moves.

    Raises:
        DescriptionError: a range stands beside a vector, and its source does not say how it moves.
        ValueError: u lies outside of [0, 1].
    """
    if not 0.0 <= u <= 1.0:
        raise ValueError(f"u must be in [0, 1], not {u!r}")
    found: dict[str, Any] = {}
    for key, source in factor.members.items():
        if key.startswith(SEARCHED):
            continue
        value = _at(configuration[factor.part], key)
        moved = _moved(f"{factor.part}.sources.{key}", value, source, u)
        for place in (key, *source.tie):
            found |= dict(_leaves(f"{factor.part}.{place}", moved))
    return found


def bounds_at(to: Iterable[tuple[Factor, float]]) -> dict[str, dict[str, float]]:
    """Return which bounds of what tunings search some factors set: ``{"kp": {"high": 2.0}}``.

    Args:
        to: factors, each with where in its range, in [0, 1].
    """
    found: dict[str, dict[str, float]] = {}
    for key, source, u in ((key, source, u) for factor, u in to for key, source in factor.members.items()):
        if key.startswith(SEARCHED):
            name, _, bound = key.removeprefix(SEARCHED).rpartition(".")
            found.setdefault(name, {})[bound] = _within(source, u)
    return found


def _moved(place: str, value: Any, source: Source, u: float) -> Any:
    """Return a value as its source moves it."""
    choices = _choices(source)
    if choices:
        return choices[min(int(u * len(choices)), len(choices) - 1)]
    x = _within(source, u)
    if not isinstance(value, VECTORS):
        whole = isinstance(value, int) and not isinstance(value, bool)
        return round(x) if whole else x
    if source.apply is None:
        raise DescriptionError(f"{place}: must have `apply`, one of scale, step, peak, beside the range of a vector")
    if source.apply == "step":
        return _each(value, lambda one: one + x)
    if source.apply == "peak":
        x /= max(abs(one) for _, one in _leaves("", value))
    return _each(value, lambda one: one * x)


def _choices(source: Source) -> tuple[Any, ...]:
    if source.range and None in source.range:
        return source.range
    return source.choices or ()


def _within(source: Source, u: float) -> float:
    low, high = (float(end or 0.0) for end in source.range or ())
    return math.exp(math.log(low) + u * math.log(high / low)) if source.scale == "log" else low + u * (high - low)


def _each(value: Any, move: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _each(inner, move) for name, inner in value.items()}
    return [_each(inner, move) for inner in value] if isinstance(value, list | tuple) else move(value)


def _leaves(place: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the values below a mapping; a list is a value of its own, but for its numbers' sizes."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _leaves(f"{place}.{name}", inner)
    elif not place and isinstance(value, list | tuple):
        for inner in value:
            yield from _leaves("", inner)
    else:
        yield place, value


def _at(values: Any, key: str) -> Any:
    for word in key.split("."):
        values = values[word]
    return values
