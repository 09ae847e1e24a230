"""Functions by name: a short name is one of ours, a dotted one any module's, as far as it is trusted."""

import inspect
from collections.abc import Callable, Iterable, Sequence
from types import ModuleType
from typing import Any

from navbench.importing import import_named
from navbench.raised import one_line
from navbench.validation import DescriptionError, instead

OWN = ("navbench.analysis.", "navbench.controllers.", "navbench.report.")  # what lies beside them may be results


def resolve(key: str, name: str, home: str, *, trust: bool) -> Callable[..., Any]:
    """Return the function that a name stands for.

    Args:
        key: where the name stands, for the error message.
        name: a public function of ``home``, or module.function.
        home: the module of the short names.
        trust: whether the module may lie outside ``OWN``: a user's own file may name any, but what is read from
            stored results may be anybody's, and to import a module is to run it.

    Raises:
        DescriptionError: there is no such function, its module cannot be imported, or it is not trusted.
    """
    module, _, last = name.rpartition(".")
    if not trust and lies_outside(name):
        raise DescriptionError(f"{key}={name}: lies outside navbench; --trust lets stored results name it")
    try:
        found = getattr(import_named(module or home), last, None)
    except Exception as error:  # a user's module may raise anything
        raise DescriptionError(f"{key}={name}: cannot be imported: {one_line(error)}") from None
    if last.startswith("_") or not inspect.isfunction(found) or not (trust or found.__module__.startswith(OWN)):
        there = instead(last, _public(import_named(module or home)))
        raise DescriptionError(f"{key}={name}: there is no such function; {there}, or module.function")
    return found


def check_arguments(
    place: str, name: str, parameters: Sequence[inspect.Parameter], given: Iterable[str], more: Sequence[str] = ()
) -> None:
    """Check that a function takes the arguments that a file gives it, and that none is missing.

    Args:
        place: what stands before an argument's name in the error message.
        name: the function's name.
        parameters: of these parameters.
        given: the arguments' names.
        more: what may stand beside them.

    Raises:
        DescriptionError: one is unknown or missing.
    """
    given, known = list(given), [parameter.name for parameter in parameters]
    takes = f"{name} takes {', '.join((*known, *more))}"
    for word in given:
        if word not in (*known, *more):
            raise DescriptionError(f"{place}{word}: unknown key; {takes}")
    for parameter in parameters:
        if parameter.name not in given and parameter.default is inspect.Parameter.empty:
            raise DescriptionError(f"{place}{parameter.name}: missing; {takes}")


def lies_outside(name: str) -> bool:
    """Return whether a name is one of a module that stored results may name only where it is trusted."""
    return "." in name and not name.startswith(OWN)


def _public(module: ModuleType) -> list[str]:
    """Return the names of a module's own functions."""
    functions = inspect.getmembers(module, inspect.isfunction)
    return [name for name, own in functions if not name.startswith("_") and own.__module__ == module.__name__]
