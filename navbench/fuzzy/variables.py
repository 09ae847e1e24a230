"""Fuzzy terms, the linguistic variables they divide, and the rules over them: checked data."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

ANY, NONE = "any", "none"  # in a rule: this input does not matter, this output is not concluded on
POINTS = {"triangle": 3, "trapezoid": 4, "z": 2, "s": 2}  # how many points draw each shape

Table = Mapping[str, "Table"] | Sequence["Table"] | str
Rules = Sequence[Sequence[str]]


@dataclass(frozen=True, slots=True)
class Term:
    """A fuzzy set: a shape and the points that draw it, in the unit of its variable.

    A triangle (a, b, c) rises from a to b and falls to c; a trapezoid (a, b, c, d) is 1 from b to c; z (a, b) is 1 up
    to a and falls to b; s (a, b) rises from a and is 1 from b. The ramp of z and s is smooth: with m on the straight
    ramp, 2 m^2 where m <= 1/2, else 1 - 2 (1 - m)^2. Two equal neighbouring points make an upright edge, itself in.
    """

    shape: str
    points: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.shape not in POINTS:
            raise ValueError(f"shape {self.shape!r} is unknown; allowed: {', '.join(POINTS)}")
        points = tuple(float(point) for point in self.points)
        object.__setattr__(self, "points", points)
        if len(points) != POINTS[self.shape]:
            raise ValueError(f"a {self.shape} takes {POINTS[self.shape]} points, not {len(points)}: {points}")
        if not all(map(math.isfinite, points)):
            raise ValueError(f"the points of a {self.shape} must be finite: {points}")
        if any(b < a for a, b in zip(points, points[1:], strict=False)):
            raise ValueError(f"the points of a {self.shape} must not descend: {points}")
        if points[0] == points[-1]:
            raise ValueError(f"a {self.shape} must have a width: {points}")

    @property
    def peak(self) -> float:
        """The value it stands for: a triangle's tip, the middle of a trapezoid's top, where the ramp of z or s is 1."""
        if self.shape == "trapezoid":
            return 0.5 * (self.points[1] + self.points[2])
        return self.points[0] if self.shape == "z" else self.points[1]

    @property
    def corners(self) -> tuple[float, float, float, float]:
        """The feet and the ends of the top (a, b, c, d), every shape drawn as a trapezoid; infinite on an open side."""
        points = self.points
        if self.shape == "triangle":
            return points[0], points[1], points[1], points[2]
        if self.shape == "z":
            return -math.inf, -math.inf, points[0], points[1]
        if self.shape == "s":
            return points[0], points[1], math.inf, math.inf
        return points[0], points[1], points[2], points[3]


@dataclass(frozen=True, slots=True)
class Variable:
    """A linguistic variable: its range and its terms in order.

    The terms may run past the ends of the range. A circular variable, such as a bearing, is an input whose two ends are
    the same place: its period is high - low, and a term that runs past one end goes on at the other.
    """

    low: float
    high: float
    terms: Mapping[str, Term]
    circular: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "low", float(self.low))
        object.__setattr__(self, "high", float(self.high))
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"a variable's range needs low < high, both finite, not [{self.low}, {self.high}]")
        object.__setattr__(self, "terms", dict(self.terms))
        if not self.terms:
            raise ValueError("a variable needs at least one term")
        for name, term in self.terms.items():
            if not isinstance(name, str) or name in (ANY, NONE):
                raise ValueError(f"{name!r} cannot name a term: it must be a string other than {ANY!r} and {NONE!r}")
            if self.circular:
                self._check_wraps(name, term)

    def _check_wraps(self, name: str, term: Term) -> None:
        period = self.high - self.low
        if term.shape in ("z", "s"):
            raise ValueError(f"term {name!r}: a {term.shape} shape has no end and cannot lie on a circular variable")
        if term.points[0] < self.low - period or term.points[-1] > self.high + period:
            raise ValueError(
                f"term {name!r}: its points {term.points} run more than a period past [{self.low}, {self.high}]"
            )

    @classmethod
    def from_peaks(
        cls, peaks: Mapping[str, float], low: float, high: float, *, shoulders: bool, circular: bool = False
    ) -> "Variable":
        """Return a variable of triangles, each with its feet at the neighbouring peaks.

        Args:
            peaks: the peak of each term, ascending and within the range.
            low: the range's lower end.
            high: the range's upper end.
            shoulders: True: the first and last set stay 1 out to the ends of the range (trapezoids, so that their
                ``peak`` is the middle of the shoulder); False: they are half triangles, 0 beyond their peaks.
            circular: the first and last set are each other's neighbours, and ``shoulders`` must be False.

        Raises:
            ValueError: with fewer than two peaks, or with peaks that do not ascend or lie outside the range.
        """
        at = [float(peak) for peak in peaks.values()]
        if len(at) < 2 or not all(a < b for a, b in zip(at, at[1:], strict=False)):
            raise ValueError(f"peaks must be two or more, in ascending order, not {dict(peaks)}")
        if not (low <= at[0] and at[-1] <= high):
            raise ValueError(f"peaks must lie within [{low}, {high}], not {dict(peaks)}")
        if circular:
            if shoulders or at[-1] - at[0] >= high - low:
                raise ValueError("a circular variable has no shoulders and its peaks span less than a period")
            feet = [at[-1] - (high - low), *at, at[0] + (high - low)]
        else:
            feet = [at[0], *at, at[-1]]
        terms = {name: Term("triangle", tuple(feet[i : i + 3])) for i, name in enumerate(peaks)}
        if shoulders:
            first, *_, last = peaks
            terms[first] = Term("trapezoid", (low, low, at[0], at[1]))
            terms[last] = Term("trapezoid", (at[-2], at[-1], high, high))
        return cls(low, high, terms, circular)


def rules_from_table(
    table: Table, inputs: Mapping[str, Variable], outputs: Mapping[str, Variable]
) -> list[tuple[str, ...]]:
    """Return the rules of a table as it is printed, one level of nesting an input.

    A level is a mapping from the input's term names ("any" too), or a list over all its terms in order. A cell is a
    list with one term an output, or a string: the term of the only output, or those of several, separated by spaces.
    ``{"near": ["stop", "slow"], "far": ["slow", "fast"]}`` has the first input's terms down and the second's across.

    Raises:
        ValueError: for an unknown term, naming the allowed ones, or a list of the wrong length.
    """
    rules = list(_table_rules(table, (), list(inputs.items()), len(outputs)))
    number_rules(rules, inputs, outputs)
    return rules


def _table_rules(
    table: Table, above: tuple[str, ...], levels: Sequence[tuple[str, Variable]], n_outputs: int
) -> Iterator[tuple[str, ...]]:
    where = f"the table at [{', '.join(map(str, above))}]"
    if not levels:
        if isinstance(table, str):
            cell = table.split() if n_outputs > 1 else [table]
        else:
            cell = [str(term) for term in table] if isinstance(table, Sequence) else []
        if len(cell) != n_outputs:
            raise ValueError(f"{where} needs {n_outputs} output term(s), not {table!r}")
        yield (*above, *cell)
        return
    name, variable = levels[0]
    if isinstance(table, str) or not isinstance(table, Mapping | Sequence):
        raise ValueError(f"{where} needs a mapping or a list over input {name!r}, not {table!r}")
    if isinstance(table, Sequence):
        if len(table) != len(variable.terms):
            raise ValueError(f"{where} needs {len(variable.terms)} entries, for input {name!r}, not {len(table)}")
        table = dict(zip(variable.terms, table, strict=True))
    for term, below in table.items():
        yield from _table_rules(below, (*above, term), levels[1:], n_outputs)


def number_rules(rules: Rules, inputs: Mapping[str, Variable], outputs: Mapping[str, Variable]) -> list[list[int]]:
    """Return the rules with numbers for names: terms numbered through, inputs first, then one number for any and none.

    Raises:
        ValueError: naming the first rule, counted from 1, that has a wrong length or an unknown term.
    """
    variables = [*inputs.values(), *outputs.values()]
    labels = [f"input {name!r}" for name in inputs] + [f"output {name!r}" for name in outputs]
    wildcards = [ANY] * len(inputs) + [NONE] * len(outputs)
    n_terms, count = sum(len(variable.terms) for variable in variables), itertools.count()
    numbers = [
        {name: next(count) for name in variable.terms} | {wildcard: n_terms}
        for variable, wildcard in zip(variables, wildcards, strict=True)
    ]
    for at, rule in enumerate(rules, start=1):
        if isinstance(rule, str) or len(rule) != len(variables):
            raise ValueError(f"rule {at} needs {len(inputs)} input and {len(outputs)} output terms, not {rule!r}")
        for label, known, term in zip(labels, numbers, rule, strict=True):
            if term not in known:
                raise ValueError(f"rule {at}: {label} has no term {term!r}; allowed: {', '.join(known)}")
    return [[known[term] for known, term in zip(numbers, rule, strict=True)] for rule in rules]
