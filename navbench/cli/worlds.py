"""From a world's plain values to the world: what it lists, or the source that it names."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from navbench.cli.building import check_keys, located, made
from navbench.validation import DescriptionError, describe
from navbench.world.layout import Layout
from navbench.world.world import World

LISTED = tuple(item.name for item in fields(Layout))
OWN = ("goal_tolerance_m", "time_limit_s")
DRAWS = ("draw(rng, episode)",)


def world_of(values: Mapping[str, Any], name: str) -> tuple[World, dict[str, Any]]:
    """Return a world and those of its values that results keep.

    Args:
        values: bounds, starts, goals, obstacles and movers, or ``source``, a class that draws them; and ``OWN``.
        name: the world's configuration name.

    Raises:
        DescriptionError: one line that names the key, its value and what is allowed.
    """
    check_keys(values, "world", (*LISTED, "source", *OWN))
    listed = {key: values[key] for key in LISTED if values.get(key) not in (None, [])}
    own = {key: values[key] for key in OWN if key in values}
    build = values.get("source")
    if build is None:
        source, kept = describe(Layout, listed, "world"), {**listed, **own}
    else:
        source, kept = source_of("world.source", build), {"source": build, **own}
        for key in listed:
            raise DescriptionError(f"world.{key}: must be empty, because world.source draws the whole layout")
    return describe(World, {"name": name, "source": source, **own}, "world"), kept


def source_of(key: str, build: Any, methods: tuple[str, ...] = DRAWS) -> Any:
    """Return what a ``_target_`` and the parameters beside it make, and first what those of them make that name one.

    Args:
        key: where ``build`` stands in the configuration, for the error message.
        build: ``_target_``, a class as module.Class, and a value for each of its parameters.
        methods: what the object must have; () for anything.

    Raises:
        DescriptionError: one line that names the key, its value and what is allowed.
    """
    if not isinstance(build, Mapping) or "_target_" not in build:
        return made(key, build, methods)  # which says what is missing
    target = located(f"{key}._target_", build["_target_"], methods)
    if not is_dataclass(target):
        return made(key, build, methods)
    parameters = {name: _inner(f"{key}.{name}", value) for name, value in build.items() if name != "_target_"}
    check_keys(build, key, ("_target_", *(item.name for item in fields(target) if item.init)))
    return describe(target, parameters, key)


def _inner(key: str, value: Any) -> Any:
    """Return a parameter, with what is named in it made."""
    if isinstance(value, Mapping):
        inner = {name: _inner(f"{key}.{name}", one) for name, one in value.items() if name != "_target_"}
        return source_of(key, value, ()) if "_target_" in value else inner
    return [_inner(f"{key}[{i}]", one) for i, one in enumerate(value)] if isinstance(value, list) else value
