"""What every description (world, robot, sensors, simulator) shares: its strictness, its number types, its errors."""

import re
import reprlib
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from functools import cache, wraps
from typing import Annotated, Any, ParamSpec, TypeVar, cast, get_args, get_type_hints

from pydantic import ConfigDict, Field, Strict, TypeAdapter, ValidationError

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
LISTED_MAX = 12  # names; of more, the nearest one is named alone
REMEMBERED_MAX = 64  # more than one process works on in turn


class DescriptionError(ValueError):
    """A description, an option or a combination of them that cannot be run; the message names key, value, allowed."""


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
        errors = error.errors(include_url=False)
        first = next((one for one in errors if one["type"] == "unexpected_keyword_argument"), errors[0])
        loc = first["loc"]
        path = key + "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc)
        if first["type"] == "unexpected_keyword_argument":
            known = [field.name for field in fields(_kind_at(kind, loc[:-1]))]
            raise DescriptionError(f"{path}: unknown key; {instead(loc[-1], known, HERE)}") from None
        if first["type"] in ("missing", "missing_argument"):
            raise DescriptionError(f"{path}: missing; a value is needed") from None
        if first["type"] == "value_error":
            said = str(first["ctx"]["error"])
            inside = re.match(r"[a-z_]+(\[\d+\])?(\.\w+)*: ", said)
            raise DescriptionError(f"{path}.{said}" if inside else f"{path}: {said}") from None
        allowed = first["msg"].removeprefix("Input s").replace("hould be", "must be").replace("a valid ", "a ")
        allowed = re.sub(r"a dictionary( or an instance of \w+)?", "a mapping", allowed)
        raise DescriptionError(f"{path}={reprlib.repr(first['input'])}: {allowed}") from None


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


def _kind_at(kind: Any, loc: tuple[int | str, ...]) -> Any:
    """Return the dataclass that stands at a place inside another one."""
    for part in loc:
        if isinstance(part, int):
            continue
        hint = get_type_hints(kind)[part]
        kind = next((inner for inner in (hint, *get_args(hint)) if is_dataclass(inner)), hint)
    if not is_dataclass(kind):
        raise TypeError(f"no description stands at {loc}")
    return kind
