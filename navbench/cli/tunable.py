"""From a controller's ``tunable`` to the dimensions of a search: subtrees become their leaves, each with its start."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from navbench.experiments.cells import leaves_below
from navbench.tuning.space import Choice, Dimension, Side
from navbench.validation import DescriptionError


def dimensions_of(tunable: Mapping[str, Any], build: dict[str, Any]) -> tuple[Side, ...]:
    """Return the dimensions that a controller's ``tunable`` names.

    Args:
        tunable: bounds ``{low, high, scale}`` or ``{choices}`` by the dotted place, below ``build``, of a parameter,
            or of a mapping, which stands for every parameter in it. What ``build`` has as a whole number is searched
            as one, unless ``integer`` beside the bounds says otherwise.
        build: the controller's ``build``; the search starts from what it holds.

    Raises:
        DescriptionError: one line that names the key, its value and what is allowed.
    """
    dimensions: dict[str, Side] = {}
    for key, bounds in tunable.items():
        for name, value in leaves_below(key, build).items():
            if name in dimensions:
                raise DescriptionError(f"controller.tunable.{key}: {name} is named there twice")
            dimensions[name] = _started(_dimension(key, bounds, value), name, value)
    return tuple(dimensions.values())


def _dimension(key: str, bounds: Any, value: Any) -> Side:
    """Return a dimension without a start."""
    try:
        if isinstance(bounds, dict) and set(bounds) == {"choices"}:
            return Choice(key, bounds["choices"])
        if isinstance(bounds, dict) and set(bounds) - {"integer"} == {"low", "high", "scale"}:
            return Dimension(key, **{"integer": type(value) is int, **bounds})
    except ValueError as error:
        raise DescriptionError(f"controller.tunable.{error}") from None
    raise DescriptionError(f"controller.tunable.{key}: must hold low, high and scale, or choices, got {bounds!r}")


def _started(whole: Side, name: str, value: Any) -> Side:
    """Return a dimension of one parameter, with what the controller has there as its start."""
    place = f"controller.build.{name}={value!r}"
    if isinstance(whole, Choice):
        if isinstance(value, bool) or value not in whole.choices:
            allowed = ", ".join(map(str, whole.choices))
            raise DescriptionError(f"{place}: must be one of {allowed}, the choices of controller.tunable.{whole.name}")
        return replace(whole, name=name, start=whole.choices.index(value))
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DescriptionError(f"controller.tunable.{whole.name}: must name a number, not {name}={value!r}")
    try:
        return replace(whole, name=name, start=value)
    except ValueError:
        allowed = f"{'a whole number ' if whole.integer else ''}between {whole.low!r} and {whole.high!r}"
        raise DescriptionError(f"{place}: must be {allowed}, the bounds of controller.tunable.{whole.name}") from None
