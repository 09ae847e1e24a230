"""From a ``_target_`` and its parameters to what makes the object: the class found, the parameters checked."""

import copy
import inspect
import json
import math
import re
import sys
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from pydantic import PydanticUserError, TypeAdapter, ValidationError
from pydantic.dataclasses import is_pydantic_dataclass

from navbench.compiled import COMPILES
from navbench.contract import Controller
from navbench.episode.isolation import let_interrupt
from navbench.importing import import_named, without_exit
from navbench.raised import one_line, own_line, said_by
from navbench.records import Names
from navbench.sensors import Sensors
from navbench.simulation.base import Simulator
from navbench.validation import HERE, DescriptionError, NotInstalledError, describe, instead

CONTROLLER = ("reset(setup, rng)", "act(observation)")


def controller_maker(
    build: Any, sensors: Sensors, names: Names, target: Callable[..., Controller] | None = None
) -> partial[Controller]:
    """Return what makes a controller, after making one to see that its parameters and its sensors fit.

    Args:
        build: ``_target_``, the controller's class as module.Class, and a value for each of its parameters.
        sensors: the suite that it will have.
        names: what controller and suite are called, for the error message.
        target: what makes it, where a program gives that; its name is then only told.

    Raises:
        DescriptionError: one line that names the key, its value and what is allowed.
    """
    maker = maker_of("controller.build", build, CONTROLLER, target)
    controller = made_by(maker, "controller.build", CONTROLLER)
    needed, kind = getattr(controller, "sensor_roles", None), getattr(controller, "sensor_kind", None)
    offered = tuple(mount.role for mount in sensors.mounts)
    if needed is not None and not (isinstance(needed, list | tuple) and all(isinstance(role, str) for role in needed)):
        raise DescriptionError(
            f"controller.build._target_={build['_target_']}: its sensor_roles must be a tuple of names"
        )
    if needed is not None and tuple(needed) != offered:
        raise DescriptionError(
            f"sensors={names.sensors}: {names.controller} needs "
            f"{'the range sensors ' + ', '.join(needed) + ', in this order' if needed else 'no range sensors'}; "
            f"this suite has {_few(offered)}"
        )
    if kind is not None and not hasattr(kind, "lack"):
        raise DescriptionError(f"controller.build._target_={build['_target_']}: its sensor_kind must be an AnyRing")
    lack = kind.lack(sensors.range_sensors()) if kind is not None else ""
    if lack:
        raise DescriptionError(f"sensors={names.sensors}: {names.controller} needs {kind}; {lack}")
    return maker


def simulator_class(target: Any) -> type[Simulator]:
    """Return the class of a simulator.

    Args:
        target: its dotted name, the configuration's ``simulator._target_``.

    Raises:
        DescriptionError: it names no such class.
    """
    if not COMPILES:
        raise DescriptionError("NUMBA_DISABLE_JIT: must not be set: robots move and sense in compiled code")
    found = located("simulator._target_", target, ())
    if not (inspect.isclass(found) and issubclass(found, Simulator)):
        raise DescriptionError(f"simulator._target_={target}: must name a subclass of {Simulator.__module__}.Simulator")
    return found


def made(key: str, build: Any, methods: Sequence[str]) -> Any:
    """Return what a ``_target_`` and the parameters beside it make; arguments and errors as ``maker_of``."""
    return made_by(maker_of(key, build, methods), key, methods)


def maker_of(key: str, build: Any, methods: Sequence[str], target: Callable[..., Any] | None = None) -> partial[Any]:
    """Return what makes an object of a class that the configuration names, each time anew.

    Args:
        key: where ``build`` stands in the configuration, such as "controller.build", for the error message.
        build: ``_target_``, a class or a function as module.name, and a value for each of its parameters.
        methods: what the object must have, such as "act(observation)".
        target: the class or function itself, where its name need not be looked up.

    Raises:
        DescriptionError: one line that names the key, its value and what is allowed.
    """
    if not isinstance(build, Mapping) or "_target_" not in build:
        raise DescriptionError(f"{key}._target_: missing; it {_kind(methods)}")
    parameters = {name: copy.deepcopy(value) for name, value in build.items() if name != "_target_"}
    target = target or located(f"{key}._target_", build["_target_"], methods)
    _check_plain(key, parameters)
    _check_parameters(key, target, parameters)
    return partial(target, **parameters)


def made_by(maker: partial[Any], key: str, methods: Sequence[str]) -> Any:
    """Return what a maker makes; arguments and errors as ``maker_of``."""
    try:
        if inspect.isclass(maker.func) and is_pydantic_dataclass(maker.func):
            thing = describe(maker.func, maker.keywords, key.rpartition(".")[2])  # whose complaint is one line
        else:
            with without_exit():
                thing = maker()
    except BaseException as error:  # whatever a constructor says of its parameters
        let_interrupt(error)
        raise DescriptionError(_complaint(error, key, maker)) from None
    if not all(hasattr(thing, method.split("(")[0]) for method in methods):
        func = getattr(maker.func, "thing", maker.func)  # of an object that a program gave
        target = f"{func.__module__}.{getattr(func, '__qualname__', func)}"
        raise DescriptionError(f"{key}._target_={target}: {_kind(methods)}")
    return thing


def _kind(methods: Sequence[str]) -> str:
    return f"must name a class{' with ' if methods else ''}{' and '.join(methods)}, as module.Class"


def located(key: str, target: Any, methods: Sequence[str]) -> Callable[..., Any]:
    """Return what a dotted name stands for."""
    complaint = f"{key}={target}:"
    module, _, name = target.rpartition(".") if isinstance(target, str) else ("", "", "")
    if not module or not name or module.partition(".")[0] in sys.stdlib_module_names:  # such as os.system
        raise DescriptionError(f"{complaint} {_kind(methods)}")
    try:
        found = getattr(import_named(module), name)
    except NotInstalledError:
        raise
    except BaseException as error:  # a user's module may raise anything
        let_interrupt(error)
        raise DescriptionError(f"{complaint} cannot be imported: {one_line(error)}") from None
    lacks = inspect.isclass(found) and not all(hasattr(found, method.split("(")[0]) for method in methods)
    if lacks or not callable(found):
        raise DescriptionError(f"{complaint} {_kind(methods)}")
    return found  # type: ignore[no-any-return]


def check_keys(values: Iterable[str], key: str, allowed: Sequence[str]) -> None:
    """Check the names of what stands at a key; raises ``DescriptionError``."""
    for name in values:
        if name not in allowed:
            raise DescriptionError(f"{key}.{name}: unknown key; {instead(name, allowed, HERE)}")


def _check_plain(key: str, value: Any) -> None:
    """Check the values at any depth: what is not finite, or bytes, has no place in a manifest, and hides a slip."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for name, part in inner:
        _check_plain(f"{key}.{name}" if isinstance(value, dict) else f"{key}[{name}]", part)
    if isinstance(value, float) and not math.isfinite(value):
        raise DescriptionError(f"{key}={value}: must be a finite number")
    if isinstance(value, bytes):  # which YAML has, and JSON has not
        raise DescriptionError(f"{key}={value!r}: must be a word, a number, a list or a mapping")


def _check_parameters(key: str, target: Callable[..., Any], parameters: Mapping[str, Any]) -> None:
    """Check names and types against the target's own signature, so that no word passes where a number belongs."""
    try:
        signature = inspect.signature(target)
    except ValueError:  # a built-in without one
        return
    kinds = inspect.Parameter
    named = {
        name: parameter
        for name, parameter in signature.parameters.items()
        if parameter.kind not in (kinds.VAR_KEYWORD, kinds.VAR_POSITIONAL)
    }
    free = any(parameter.kind is kinds.VAR_KEYWORD for parameter in signature.parameters.values())
    for name in parameters:
        if name not in named and not free:
            raise DescriptionError(f"{key}.{name}: unknown key; {instead(name, ('_target_', *named), HERE)}")
    for name, parameter in named.items():
        if parameter.default is parameter.empty and name not in parameters:
            raise DescriptionError(f"{key}.{name}: missing; a value is needed")
    try:
        hints = typing.get_type_hints(target.__init__ if inspect.isclass(target) else target)
    except Exception:  # a hint may name what only a type checker imports
        return
    for name, value in parameters.items():
        if name in hints:
            _check_type(f"{key}.{name}", hints[name], value)


def _check_type(key: str, hint: Any, value: Any) -> None:
    try:
        adapter = TypeAdapter(hint)
    except (PydanticUserError, NameError):
        return  # a type that only the controller itself can check
    try:
        adapter.validate_json(json.dumps(value), strict=True)  # as JSON, so that a list may stand for a tuple
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"])
        allowed = first["msg"].replace("Input should be", "must be").replace("an object", "a mapping")
        raise DescriptionError(f"{key}{place}={first['input']!r}: {allowed}") from None


def _complaint(error: BaseException, key: str, maker: partial[Any]) -> str:
    """Return what a constructor says of its parameters, named by their places in the configuration."""
    own = getattr(maker.func, "__name__", "")
    text = re.sub(rf"^({re.escape(own)}|{key.rpartition('.')[2]})(\.|: )", "", said_by(error))
    if not isinstance(error, ValueError) or not text:
        text = f"{type(error).__name__}: {text}{own_line(error)}"
    about = re.match(r"\w*", text)
    return f"{key}.{text}" if about and about[0] in maker.keywords else f"{key}: {text}"


def _few(names: tuple[str, ...], most: int = 4) -> str:
    """Return some names and how many there are beside them."""
    shown = ", ".join(names[:most]) or "none"
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
