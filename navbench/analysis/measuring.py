"""Measures by name: found, their arguments checked, and asked.

A measure and what it takes are written as one mapping, ``{metric: time_s, cell: printed, label: PSO-PID}``: keys that
are parameters of the measure are its arguments, the others choose cells. ``than`` names the cells that these are
compared with: a label, or what differs from the first ones.
"""

import inspect
import reprlib
from collections.abc import Callable, Mapping
from functools import lru_cache
from numbers import Real
from typing import Any

from navbench.analysis.resolving import check_arguments, resolve
from navbench.analysis.stored import SELECTABLE, StoredResults
from navbench.mathematics.statistics import Estimate
from navbench.raised import first_line, one_line
from navbench.validation import DescriptionError

HOME = "navbench.analysis.measures"


class MeasureError(DescriptionError):
    """A measure that raised, or returned what is no estimate; the message says where."""


def measure(
    stored: StoredResults, name: str, of: Mapping[str, Any], *, trust: bool = False, key: str = "measure"
) -> Estimate | None:
    """Return what a measure says; None where there is no case.

    Args:
        stored: the results.
        name: a function of ``navbench.analysis.measures``, or any by its dotted name.
        of: its arguments and the cells, see above.
        trust: whether the function may lie outside ``navbench``.
        key: where the name stands, for the error message.

    Raises:
        MeasureError: the measure fails, as where the results hold no such cells.
        DescriptionError: as ``check_measure``.
    """
    function = check_measure(key, name, of, trust=trust)
    try:
        found = function(stored, **arguments(function, of))
    except Exception as error:  # a user's measure may raise anything
        raise MeasureError(f"{key}={name}: {one_line(error)}") from error
    numbers = isinstance(found, Estimate) and all(isinstance(part, Real) for part in found)
    if not (found is None or numbers):
        returned = f"must return an Estimate of numbers or None; it returned {reprlib.repr(found)}"
        raise MeasureError(f"{key}={name}: {returned}{first_line(function)}")
    return found


def check_measure(key: str, name: str, of: Mapping[str, Any], *, trust: bool) -> Callable[..., Estimate | None]:
    """Return the measure of a name, after checking that it takes these arguments.

    Raises:
        DescriptionError: there is no such measure, or an argument is unknown or missing.
    """
    function = resolve(key, str(name), HOME, trust=trust)
    takes, *parameters = _parameters(function).values()
    if takes.name != "stored":
        raise DescriptionError(f"{key}={name}: is no measure: it does not take the stored results first")
    needed = [parameter for parameter in parameters if parameter.name != "select"]
    choose = SELECTABLE if len(needed) < len(parameters) else ()
    given = [word for word in of if word != "select" or not choose]
    check_arguments(f"{key}: of.", name, needed, given, choose)
    return function


def arguments(function: Callable[..., Any], of: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a measure, with the cells under ``select`` and ``than``."""
    known = _parameters(function)
    found = {word: value for word, value in of.items() if word in known}
    if "select" not in known:
        return found
    if "select" in of:  # cells as columns, and both sides in full
        return found
    found["select"] = _columns({word: value for word, value in of.items() if word not in known})
    if "than" in found:
        than = found["than"]
        found["than"] = {**found["select"], **_columns({"label": than} if isinstance(than, str) else than)}
    return found


@lru_cache(maxsize=256)  # measures: a multiverse asks each of every reconstruction
def _parameters(function: Callable[..., Any]) -> Mapping[str, inspect.Parameter]:
    return inspect.signature(function).parameters


def _columns(cells: Mapping[str, Any]) -> dict[str, Any]:
    """Return which columns choose cells: what a study calls a cell's name stands in the column ``name``."""
    return {"name" if word == "cell" else word: value for word, value in cells.items()}
