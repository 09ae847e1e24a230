"""Functions by name: a short name is one of ours, a dotted one any module's, as far as it is trusted."""

import inspect
from collections.abc import Callable
from difflib import get_close_matches
from importlib import import_module
from typing import Any

from navbench.raised import one_line
from navbench.validation import DescriptionError

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
    if not trust and module and not module.startswith(OWN):
        raise DescriptionError(f"{key}={name}: lies outside navbench; --trust lets stored results name it")
    try:
        found = getattr(import_module(module or home), last, None)
    except Exception as error:  # a user's module may raise anything
        raise DescriptionError(f"{key}={name}: cannot be imported: {one_line(error)}") from None
    if last.startswith("_") or not inspect.isfunction(found) or not (trust or found.__module__.startswith(OWN)):
        raise DescriptionError(f"{key}={name}: there is no such function{_nearest(last, module or home)}")
    return found


def _nearest(name: str, module: str) -> str:
    """Return which of a module's own functions was meant, or which there are."""
    public = [
        other
        for other, function in vars(import_module(module)).items()
        if not other.startswith("_") and inspect.isfunction(function) and function.__module__ == module
    ]
    near = get_close_matches(name, public, 1)
    return f"; did you mean {near[0]}?" if near else f"; allowed: {', '.join(public)}, or module.function"
