"""Controllers, worlds, robots, sensors and simulators that a program gives: by name, as a file, values or an object."""

import hashlib
import inspect
import json
import os
import pickle
import re
import sys
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from omegaconf import OmegaConf

from navbench.cli.catalogue import CONF, GROUPS, files_of
from navbench.cli.limits import check_file
from navbench.contract import Controller
from navbench.experiments.cells import Unnamed
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.validation import DescriptionError
from navbench.world.layout import Layout
from navbench.world.world import World

Values: TypeAlias = str | os.PathLike[str] | Mapping[str, Any]  # a name, a YAML file, or what stands in one
AnyController: TypeAlias = Values | Controller | Callable[..., Controller]
AnyWorld: TypeAlias = Values | World
AnyRobot: TypeAlias = Values | Robot
AnySensors: TypeAlias = Values | Sensors

FILES = (".yaml", ".yml", ".onnx")
NAME = re.compile(r"[A-Za-z]\w*")
OBJECTS = {  # what may be given beside a name, a file and values
    "controller": "an object or a class with reset(setup, rng) and act(observation), or what makes one",
    "world": "a World",
    "robot": "a Robot",
    "sensors": "Sensors",
}


class Thing(NamedTuple):
    """What is given instead of a name, as a file of the catalogue holds it.

    Attributes:
        group: of the catalogue.
        name: what results call it.
        values: the file's.
        make: what makes the controller, where a program gives that; else ``values`` name it.
    """

    group: str
    name: str
    values: Mapping[str, Any]
    make: Callable[..., Controller] | None = None


class Given(NamedTuple):
    """The words of a command line, and what some of their names stand for."""

    words: list[str]
    things: list[Thing]


def given_words(
    words: Sequence[str], choices: Mapping[str, Any], config_dir: str | Path | None, *, sweep: bool = False
) -> Given:
    """Return the words of a command line that say the same as a program.

    Args:
        words: some of them, as they are.
        choices: others, each a key and its value; None says nothing.
        config_dir: the folder with a user's own files, whose names are taken.
        sweep: whether a list holds several values.

    Raises:
        DescriptionError: a value is nothing of its kind, or its name is taken.
    """
    found = Given(list(words), [])
    for key, value in choices.items():
        several = isinstance(value, list | tuple | range) and key != "metrics"
        if several and not sweep:
            raise DescriptionError(f"{key}={value!r:.80}: must be one value; navbench.sweep takes several")
        if value is None:
            continue
        if several and not value:
            raise DescriptionError(f"{key}={value!r}: must hold at least one value")
        told = [_word(key, one, found.things) for one in (value if several else [value])]
        found.words.append(f"{key}={','.join(told)}")
    _check_names(found.things, [CONF, *([Path(config_dir)] if config_dir else [])])
    return found


def _word(key: str, value: Any, things: list[Thing]) -> str:
    """Return a value as it stands in a word, and note what it stands for where it is no name."""
    if isinstance(value, str) and not (key in GROUPS and value.endswith(FILES)):
        return value
    if key not in GROUPS:
        return json.dumps(_plain(key, value))
    thing = _thing(key, value)
    if not any(thing is other or thing == other for other in things):
        things.append(thing)
    return thing.name


def _thing(group: str, value: Any) -> Thing:
    if isinstance(value, str | os.PathLike):
        return _of_file(group, Path(value))
    if isinstance(value, Mapping):
        return _of_values(group, value)
    if group == "controller":
        return _of_values(group, {"name": _called(value), "build": value})
    if group == "world" and isinstance(value, World):
        own = {"goal_tolerance_m": value.goal_tolerance_m, "time_limit_s": value.time_limit_s}
        return _of_values(group, {"name": value.name, **_source(value.source), **own})
    if (group == "robot" and isinstance(value, Robot)) or (group == "sensors" and isinstance(value, Sensors)):
        return _of_values(group, asdict(value))
    told = ", ".join(filter(None, ("a name", "a YAML file", "a mapping", OBJECTS.get(group))))
    raise DescriptionError(f"{group}={value!r:.80}: must be {told}")


def _of_file(group: str, file: Path) -> Thing:
    if not file.is_file():
        raise DescriptionError(f"{group}={file}: there is no such file")
    if group == "controller" and file.suffix == ".onnx":
        return Thing(group, file.stem, {"defaults": ["policy", "_self_"], "build": {"path": str(file)}})
    check_file(file)
    values = OmegaConf.to_container(OmegaConf.load(file))
    if not isinstance(values, Mapping):
        raise DescriptionError(f"{group}={file}: must hold a mapping")
    return Thing(group, file.stem, {str(key): value for key, value in values.items()})


def _of_values(group: str, given: Mapping[str, Any]) -> Thing:
    """Return what plain values describe, of which ``name`` is its name, and a controller's ``build`` may be an object.

    Without ``defaults`` they are held against the group's schema.
    """
    values, make = dict(given), None
    name = values.pop("name", group)
    if group == "controller" and not isinstance(values.get("build", {}), Mapping):
        values["build"], make = _build(values["build"])
    if group != "controller":
        values.setdefault("defaults", [f"/schema/{group}@_here_", "_self_"])
    return Thing(group, name, _plain(group, values), make)


def _source(source: Any) -> dict[str, Any]:
    """Return what a world's configuration says of its source."""
    if isinstance(source, Layout):
        listed: dict[str, Any] = json.loads(source.to_json())
        return listed
    if not is_dataclass(source):
        raise DescriptionError("world.source: must be a Layout or a dataclass with draw(rng, episode)")
    return {"source": source}


def _build(thing: Any) -> tuple[dict[str, Any], Callable[..., Controller]]:
    """Return what a configuration says of a controller that a program gives, and what makes it."""
    is_object = not inspect.isclass(thing) and hasattr(thing, "act")
    if not is_object and not callable(thing):
        raise DescriptionError(f"controller={thing!r:.80}: must be {OBJECTS['controller']}")
    bare = isinstance(thing, partial) and not thing.args
    make, parameters = (thing.func, thing.keywords) if bare else (thing, {})
    if not is_object and _is_named(make):
        try:
            return {"_target_": _dotted(make), **_plain("controller.build", parameters)}, make
        except DescriptionError:  # parameters that no configuration holds
            pass
    kind = type(thing) if is_object else make
    return {"_target_": _dotted(kind), "digest": _digest(thing, kind)}, Unnamed(thing, is_object)


def _digest(thing: Any, kind: Any) -> str:
    """Return digits that tell an object from others; such as no other has where its code or state cannot be told."""
    try:
        data = pickle.dumps(thing) if _is_named(kind) else uuid.uuid4().bytes
    except Exception:  # whatever an object's own code raises
        data = uuid.uuid4().bytes
    return hashlib.sha256(data).hexdigest()[:16]


def _is_named(kind: Any) -> bool:
    """Return whether a class or function is what its name stands for in a module that lies in a file."""
    module = sys.modules.get(getattr(kind, "__module__", None) or "")
    return bool(getattr(module, "__file__", None)) and getattr(module, getattr(kind, "__name__", ""), None) is kind


def _dotted(kind: Any) -> str:
    return f"{kind.__module__}.{getattr(kind, '__qualname__', type(kind).__qualname__)}"


def _called(controller: Any) -> str:
    """Return what results call a controller that a program gives."""
    kind = controller.func if isinstance(controller, partial) else controller
    name = kind.__name__ if hasattr(kind, "__name__") else type(kind).__name__
    return name if NAME.fullmatch(name) else "controller"


def _plain(key: str, value: Any) -> Any:
    """Return values as a file could hold them, a dataclass by its name and its fields."""
    if is_dataclass(value) and not inspect.isclass(value):
        own = {item.name: getattr(value, item.name) for item in fields(value) if item.init}
        return {"_target_": _dotted(type(value)), **_plain(key, own)}
    if isinstance(value, Mapping):
        return {str(name): _plain(f"{key}.{name}", inner) for name, inner in value.items()}
    if isinstance(value, list | tuple | range):
        return [_plain(f"{key}[{i}]", inner) for i, inner in enumerate(value)]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise DescriptionError(f"{key}={value!r:.80}: must be a number, a word, true or false, a list or a mapping")


def _check_names(things: Sequence[Thing], folders: Sequence[Path]) -> None:
    """Check that names can stand in words, and that each stands for one thing."""
    for place, (group, name, *_) in enumerate(things):
        if not (isinstance(name, str) and NAME.fullmatch(name)):
            raise DescriptionError(f"{group}.name={name!r}: must be letters, digits and _, and begin with a letter")
        other = (
            f"give it another one, as {{'name': ..., {'...' if group != 'controller' else repr('build') + ': ...'}}}"
        )
        if name in files_of(group, folders):
            raise DescriptionError(f"{group}={name}: that name is taken; {other}")
        if any((group, name) == thing[:2] for thing in things[:place]):
            raise DescriptionError(f"{group}={name}: two are called so; {other}")
