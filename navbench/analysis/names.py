"""What a study names: a word of navbench's own, or a function of any package by its dotted name."""

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from importlib import import_module
from typing import Any

from navbench.validation import DescriptionError

OURS = "navbench."


def resolve(key: str, name: str, own: Mapping[str, Callable[..., Any]], trust: bool) -> Callable[..., Any]:
    """Return the function that a study names.

    Args:
        key: where the name stands, for the error message.
        name: a key of ``own``, or a dotted name.
        own: navbench's own functions by name.
        trust: whether code outside navbench may be run; a stored result is data, so its names are not trusted.

    Raises:
        DescriptionError: there is no such function, or it is not trusted.
    """
    if name in own:
        return own[name]
    module, _, function = name.rpartition(".")
    if not module:
        near = get_close_matches(name, own, 1)
        hint = f"did you mean {near[0]}? " if near else ""
        allowed = ", ".join(own)
        raise DescriptionError(f"{key}={name}: unknown; {hint}allowed: {allowed}, or a dotted name")
    if not (trust or name.startswith(OURS)):
        raise DescriptionError(f"{key}={name}: is no part of navbench; `navbench report ... --trust` runs such code")
    try:
        found = getattr(import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise DescriptionError(f"{key}={name}: cannot be imported: {error}") from None
    if not callable(found):
        raise DescriptionError(f"{key}={name}: must name a function")
    return found  # type: ignore[no-any-return]
