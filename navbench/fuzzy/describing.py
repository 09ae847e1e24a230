"""What a controller tells of its fuzzy sets and rules: tables of named columns, as a report takes them."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from navbench.fuzzy.inference import memberships
from navbench.fuzzy.variables import Variable

Columns = dict[str, list[Any]]


def columns(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> Columns:
    """Return rows as columns of these names."""
    listed = list(rows)
    return {name: [row[i] for row in listed] for i, name in enumerate(names)}


def membership_corners(variables: Mapping[str, Variable]) -> Columns:
    """Return the corners of all sets of some variables, between which they are straight: the degree at each x."""
    corners = [
        (name, term, x, float(memberships(variable, x)[i, 0]))
        for name, variable in variables.items()
        for i, (term, fuzzy_set) in enumerate(variable.terms.items())
        for x in sorted(set(fuzzy_set.corners))
    ]
    return columns(("variable", "term", "x", "degree"), corners)
