"""What every description (world, robot, sensors, simulator) shares: its strictness, its number types, its errors."""

import inspect
import re
import reprlib
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import is_dataclass
from difflib import get_close_matches
from functools import cache, wraps
from typing import Annotated, Any, ParamSpec, TypeVar, cast, get_args, get_type_hints

from pydantic import ConfigDict, Field, Strict, TypeAdapter, ValidationError
from pydantic_core import ArgsKwargs

STRICT = ConfigDict(extra="forbid")

Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Positive = Annotated[float, Strict(), Field(gt=0.0, allow_inf_nan=False)]
NonNegative = Annotated[float, Strict(), Field(ge=0.0, allow_inf_nan=False)]
Probability = Annotated[float, Strict(), Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Count = Annotated[int, Strict(), Field(ge=1)]
Flag = Annotated[bool, Strict()]

T = TypeVar("T")
Given = ParamSpec("Given")

HERE = "allowed here"  # before the keys of one place
LISTED_MAX = 14  # names; of more, the nearest one is named alone
REMEMBERED_MAX = 64  # more than one process works on in turn


class DescriptionError(ValueError):
    """A description, an option or a combination of them that cannot be run; the message names key, value, allowed."""


class NotInstalledError(DescriptionError):
    """A package is not installed; the message says what needs it, and how to install it."""

    def __init__(self, key: str, error: ImportError, extra: str) -> None:
        super().__init__(f"{key}: needs {error.name}; pip install 'navbench[{extra}]'")


def instead(name: object, known: Iterable[object], which: str = "allowed") -> str:
    """Return what may stand instead of an unknown name, for the end of an error message.

    Args:
        name: the unknown one.
        known: those that may stand there.
        which: what they are called.
    """
    names = [str(one) for one in known]
    near = get_close_matches(str(name), names, 1)
    meant = [f"did you mean {near[0]}?"] if near else []
    listed = [f"{which}: {', '.join(names) or 'none'}"] if not near or len(names) <= LISTED_MAX else []
    return " ".join(meant + listed)


def describe(kind: type[T], values: Mapping[str, Any], key: str) -> T:
    """Return a description made from plain values, as a YAML file holds them.

    Args:
        kind: the frozen dataclass to make.
        values: its fields; lists and mappings for the nested ones.
        key: what the values are called in the configuration, such as "world", for the error message.

    Raises:
        DescriptionError: one line that names the first wrong key, its value and what is allowed.
    """
    try:
        made: T = _adapter(cast(Hashable, kind)).validate_python(dict(values))
        return made
    except ValidationError as error:
        raise DescriptionError(_complaint(error, kind, key)) from None


def checked(key: str) -> Callable[[Callable[Given, None]], Callable[Given, None]]:
    """Return what lets a constructor check its arguments against their types; errors as of ``describe``.

    Args:
        key: what the arguments are called in the configuration, such as "build", for the error message.
    """

    def checking(init: Callable[Given, None]) -> Callable[Given, None]:
        @wraps(init)
        def checks(*args: Given.args, **kwargs: Given.kwargs) -> None:
            try:
                _adapter(init).validate_python(ArgsKwargs(args, kwargs))
            except ValidationError as error:
                raise DescriptionError(_complaint(error, init, key)) from None

        return checks

    return checking


def remembered(build: Callable[Given, T]) -> Callable[Given, T]:
    """Let a function give what it has built before from the same values.

    A controller is made anew for each robot and each episode, and building its rule bases takes longer than many acts.

    Args:
        build: takes plain values, as a YAML file holds them; what it returns is shared and must not be changed.
    """
    kept: dict[str, T] = {}

    @wraps(build)
    def built(*args: Given.args, **kwargs: Given.kwargs) -> T:
        key = repr((args, kwargs))  # tells 1 from 1.0 and from True, which a build may refuse
        if key not in kept:
            made = build(*args, **kwargs)
            if len(kept) == REMEMBERED_MAX:
                del kept[next(iter(kept))]
            kept[key] = made
        return kept[key]

    return built


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    """Return what validates a description; making it costs more than using it."""
    return TypeAdapter(kind)


def _complaint(error: ValidationError, kind: Any, key: str) -> str:
    """Return one line on the first thing that is wrong with what should make a description."""
    errors = error.errors(include_url=False)
    first = next((one for one in errors if one["type"] == "unexpected_keyword_argument"), errors[0])
    loc = first["loc"]
    path = key + "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc)
    if first["type"] == "unexpected_keyword_argument":
        known = [name for name in inspect.signature(_kind_at(kind, loc[:-1])).parameters if name != "self"]
        return f"{path}: unknown key; {instead(loc[-1], known, HERE)}"
    if first["type"].startswith("missing"):
        return f"{path}: missing; a value is needed"
    if first["type"] == "value_error":
        said = str(first["ctx"]["error"])
        inside = re.match(r"[a-z_]+(\[\d+\])?(\.\w+)*: ", said)
        return f"{path}.{said}" if inside else f"{path}: {said}"
    allowed = first["msg"].removeprefix("Input s").replace("hould be", "must be").replace("a valid ", "a ")
    allowed = allowed.replace("a integer", "a whole number")
    allowed = re.sub(r"a dictionary( or an instance of \w+)?", "a mapping", allowed)
    return f"{path}={reprlib.repr(first['input'])}: {allowed}"


def _kind_at(kind: Any, loc: tuple[int | str, ...]) -> Any:
    """Return the dataclass that stands at a place inside another one."""
    for part in loc:
        if isinstance(part, int):
            continue
        hint = get_type_hints(kind)[part]
        kind = next((inner for inner in (hint, *get_args(hint)) if is_dataclass(inner)), hint)
    return kind
