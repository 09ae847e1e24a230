"""The configuration's schema: the descriptions' own fields, as the structured configs that Hydra checks against."""

import math
import types
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, make_dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import omegaconf
from hydra.core.config_store import ConfigStore
from omegaconf import OmegaConf

from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.simulation.options import SimulatorOptions
from navbench.world.layout import Layout
from navbench.world.world import World


@dataclass
class Run:
    """The keys of a run beside its groups."""

    controller: Any = omegaconf.MISSING
    world: Any = omegaconf.MISSING
    robot: Any = omegaconf.MISSING
    sensors: Any = omegaconf.MISSING
    simulator: Any = omegaconf.MISSING
    engine: Any = omegaconf.MISSING
    episodes: int = omegaconf.MISSING
    episode: int | None = omegaconf.MISSING
    seed: int = omegaconf.MISSING
    start_jitter_m: float = omegaconf.MISSING
    start_heading_jitter_rad: float = omegaconf.MISSING
    workers: int | None = omegaconf.MISSING
    controller_timeout_s: float | None = omegaconf.MISSING
    metrics: list[str] = omegaconf.MISSING
    record: str | None = omegaconf.MISSING


@dataclass
class Tune(Run):
    """The keys of a tuning beside those of a run."""

    tuner: Any = omegaconf.MISSING
    objective: Any = omegaconf.MISSING
    budget: int = omegaconf.MISSING
    worlds: list[str] = omegaconf.MISSING
    name: str | None = omegaconf.MISSING
    verify: str | None = omegaconf.MISSING


def schema_of(description: Any, *, without: tuple[str, ...] = ()) -> type:
    """Return a mutable dataclass with a description's fields, in the types that OmegaConf knows.

    Args:
        description: a frozen dataclass whose fields are numbers, strings, flags, literals, descriptions, or tuples.
        without: fields to leave out, because the configuration does not hold them.
    """
    hints = get_type_hints(description)
    made: list[tuple[str, Any, Any]] = []
    for item in fields(description):
        if item.name in without:
            continue
        kind = _configured(hints[item.name])
        if item.default is MISSING:
            default: Any = omegaconf.MISSING
        elif is_dataclass(item.default):
            default = field(default_factory=kind)
        elif isinstance(item.default, tuple):
            default = field(default_factory=list)
        else:
            default = item.default
        made.append((item.name, kind, default))
    return make_dataclass(description.__name__, made)


def _configured(hint: Any) -> Any:
    """Return a field's type as OmegaConf knows it."""
    if get_origin(hint) is Annotated:
        return _configured(get_args(hint)[0])
    if get_origin(hint) is Literal:
        return str
    if get_origin(hint) in (Union, types.UnionType):
        inner = next(arg for arg in get_args(hint) if arg is not type(None))
        # OmegaConf cannot set a typed mapping that is null, so such a one is left to the description to check.
        return Any if is_dataclass(inner) else _configured(inner) | None
    if get_origin(hint) is tuple:
        return list[_configured(get_args(hint)[0])]  # type: ignore[misc]
    return schema_of(hint) if is_dataclass(hint) else hint


def _world() -> type:
    """Return a world's schema: what a layout lists, none of it where a source draws it, and the world's own keys."""
    own = schema_of(World, without=("name", "source"))
    source: list[tuple[str, Any, Any]] = [("bounds", Any, None), ("source", Any, None)]
    return make_dataclass("World", source, bases=(schema_of(Layout, without=("bounds",)), own))


def _sensors() -> type:
    """Return a suite's schema, in which a ring may stand for the mounts."""
    ring: list[tuple[str, Any, Any]] = [("ring", Any, None)]
    return make_dataclass("Sensors", ring, bases=(schema_of(Sensors),))


def _with_sources(schema: type) -> type:
    """Return a schema with the map of sources that a file may carry."""
    sources: Any = field(default_factory=dict)
    return make_dataclass(schema.__name__, [("sources", dict[str, Any], sources)], bases=(schema,))


def _with_target(schema: type) -> type:
    """Return a schema with the dotted name of the class that has these options."""
    return make_dataclass(schema.__name__, [("_target_", str, omegaconf.MISSING)], bases=(schema,))


def register() -> None:
    """Put the schemas into Hydra's store, and beside them the resolver ``deg``: degrees to radians."""
    store = ConfigStore.instance()
    store.store(group="schema", name="run", node=Run)
    store.store(group="schema", name="tune", node=Tune)
    store.store(group="schema", name="robot", node=_with_sources(schema_of(Robot)))
    store.store(group="schema", name="world", node=_with_sources(_world()))
    store.store(group="schema", name="sensors", node=_with_sources(_sensors()))
    store.store(group="schema", name="simulator", node=_with_sources(_with_target(schema_of(SimulatorOptions))))
    OmegaConf.register_new_resolver("deg", math.radians, replace=True)
