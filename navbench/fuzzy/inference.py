"""Mamdani inference over any number of inputs and outputs: min for "and" and implication, max over the rules.

A rule base is data. Building one turns it into one array, which ``infer``, compiled once for all rule bases, takes as
an argument: changing a membership or a rule costs a rebuild of the array and never a compilation.

Only rules that can fire are visited: where an input's term does not hold, all rules that share it and the terms before
it are passed over at once, which saves most where rules stand in the order of a printed table. The centroid is exact.
"""

import itertools
import math
from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navbench.fuzzy.centroid import TERM, divided
from navbench.fuzzy.mamdani import degrees_of, fire, infer, infer_and_fire, infer_each
from navbench.fuzzy.variables import Rules, Table, Term, Variable, number_rules, rules_from_table
from navbench.policy import pack

__all__ = [
    "FuzzyInference",
    "Table",
    "Term",
    "Variable",
    "fire",
    "infer",
    "infer_and_fire",
    "memberships",
    "rules_from_table",
]

FloatArray = NDArray[np.float64]

DEFUZZIFICATIONS = ("centroid", "weighted_mean_of_peaks")


def _floats(values: ArrayLike) -> FloatArray:
    """Return the values in the one layout that compiled code is compiled for: another would compile it again."""
    return np.ascontiguousarray(values, dtype=np.float64)


def _bounds(variable: Variable) -> tuple[float, float, float]:
    return variable.low, variable.high, variable.high - variable.low if variable.circular else 0.0


def _shapes(variable: Variable) -> FloatArray:
    return _floats([(*term.corners, term.shape in ("z", "s")) for term in variable.terms.values()])


def memberships(variable: Variable, x: ArrayLike) -> FloatArray:
    """Return the degrees of a variable's terms at each x, as the inference sees them: (n_terms, n_x).

    Raises:
        ValueError: if an x is not finite.
    """
    points = _floats(x).ravel()
    if not np.isfinite(points).all():
        raise ValueError("a membership is asked for at an x that is not finite")
    shapes = _shapes(variable)
    return _floats(degrees_of(points, pack(_bounds(variable), shapes, [0, len(shapes)]), len(shapes)).T)


def _is_grid(premises: FloatArray, starts: list[int]) -> bool:
    """Return whether premises are all combinations of the inputs' terms, in the order of ``itertools.product``."""
    terms = [range(*ends) for ends in itertools.pairwise(starts)]
    if len(premises) != math.prod(map(len, terms)):
        return False
    return bool((premises == list(itertools.product(*terms))).all())


def _skips(premises: FloatArray) -> FloatArray:
    """Return for each rule and input the next rule with another premise up to this input, (n_rules, n_inputs)."""
    number = np.arange(1.0, len(premises) + 1.0)[:, None]
    last = np.append(
        np.logical_or.accumulate(premises[1:] != premises[:-1], axis=1), premises[:1] == premises[:1], axis=0
    )
    ends: FloatArray = np.where(last, number, np.inf)[::-1]
    return _floats(np.minimum.accumulate(ends)[::-1])


class FuzzyInference:
    """A Mamdani rule base that answers ``inference(*values)`` with one crisp value an output.

    An input outside the range of its variable saturates to the nearer end, infinity included, or wraps if the variable
    is circular. An input that is NaN raises ValueError. An output on which no rule fires takes its fallback. An object
    pickles, is changed only by ``replaced``, which returns a new one, and serves one thread at a time.

    Attributes:
        base: (n,) the whole rule base, for ``infer`` and ``fire``.
    """

    def __init__(
        self,
        inputs: Mapping[str, Variable],
        outputs: Mapping[str, Variable],
        rules: Rules,
        *,
        fallback: Mapping[str, float],
        defuzzification: str = "centroid",
    ) -> None:
        """Check a rule base and turn it into arrays.

        Args:
            inputs: the input variables, in the order of the values.
            outputs: the output variables, in the order of the results.
            rules: each one term name an input ("any": it does not matter), then one an output ("none": no conclusion).
            fallback: for each output the value where no rule fires on it, within its range.
            defuzzification: ``centroid`` of the aggregated area, or ``weighted_mean_of_peaks``, which is
                sum(strength * peak) / sum(strength) over the rules, with ``Term.peak``.

        Raises:
            ValueError: naming the variable, the term or the rule that is wrong.
        """
        self.inputs, self.outputs = dict(inputs), dict(outputs)
        self.rules = tuple(tuple(rule) for rule in rules)
        self.fallback = {name: float(value) for name, value in fallback.items()}
        self.defuzzification = defuzzification
        if not (self.inputs and self.outputs and self.rules):
            raise ValueError("an inference needs at least one input, one output and one rule")
        if defuzzification not in DEFUZZIFICATIONS:
            raise ValueError(f"defuzzification {defuzzification!r} is unknown; allowed: {', '.join(DEFUZZIFICATIONS)}")
        if set(self.fallback) != set(self.outputs):
            raise ValueError(f"fallback must name {', '.join(self.outputs)}, not {', '.join(self.fallback)}")
        for name, variable in self.outputs.items():
            self._check_output(name, variable)
        self.base = self._packed()
        self._values, self._out = np.empty(len(self.inputs)), np.empty(len(self.outputs))

    def __reduce__(self) -> tuple[object, ...]:
        rebuild = partial(FuzzyInference, fallback=self.fallback, defuzzification=self.defuzzification)
        return rebuild, (self.inputs, self.outputs, self.rules)

    def replaced(
        self,
        *,
        inputs: Mapping[str, Variable] | None = None,
        outputs: Mapping[str, Variable] | None = None,
        rules: Rules | None = None,
    ) -> "FuzzyInference":
        """Return an inference with other rules, or with other variables in place of those of the same name.

        Raises:
            ValueError: for an unknown variable, and as the constructor does.
        """
        for kind, given, own in (("input", inputs, self.inputs), ("output", outputs, self.outputs)):
            for name in given or {}:
                if name not in own:
                    raise ValueError(f"there is no {kind} {name!r}; allowed: {', '.join(own)}")
        return FuzzyInference(
            {**self.inputs, **(inputs or {})},
            {**self.outputs, **(outputs or {})},
            self.rules if rules is None else rules,
            fallback=self.fallback,
            defuzzification=self.defuzzification,
        )

    def __call__(self, *values: float) -> tuple[float, ...]:
        """Return one crisp value an output, in order.

        Raises:
            ValueError: for a wrong number of values, a NaN, or infinity on a circular input.
        """
        self._load(values)
        self._check_usable(infer(self.base, self._values, self._out))
        return tuple(self._out.tolist())

    def strengths(self, *values: float) -> FloatArray:
        """Return the firing strength of each rule, (n_rules,); raises as a call does."""
        self._load(values)
        strengths = np.empty(len(self.rules))
        self._check_usable(fire(self.base, self._values, strengths))
        return strengths

    def surface(self, *axes: ArrayLike) -> FloatArray:
        """Return the outputs over the grid of one axis an input, (len(axis 1), ..., len(axis n), n_outputs).

        Raises:
            ValueError: as a call.
        """
        grid = np.meshgrid(*(_floats(axis).ravel() for axis in axes), indexing="ij")
        self._check_count(len(grid))
        points = _floats([axis.ravel() for axis in grid]).T.copy()
        found = np.empty((len(points), len(self.outputs)))
        refused = infer_each(self.base, points, found)
        if refused >= 0:
            self(*points[refused])
        return found.reshape(*grid[0].shape, len(self.outputs))

    def _load(self, values: tuple[float, ...]) -> None:
        self._check_count(len(values))
        for i, value in enumerate(values):  # of so few values quicker than a slice
            self._values[i] = value

    def _check_count(self, count: int) -> None:
        if count != self._values.size:
            raise ValueError(f"the inputs are {', '.join(self.inputs)}, but {count} values were given")

    def _check_usable(self, unusable: int) -> None:
        if unusable >= 0:
            raise ValueError(
                f"input {list(self.inputs)[unusable]!r} is {self._values[unusable]}, which has no membership"
            )

    def _check_output(self, name: str, variable: Variable) -> None:
        low, high, fallback = variable.low, variable.high, self.fallback[name]
        if variable.circular:
            raise ValueError(f"output {name!r} is circular; only an input can be")
        if not low <= fallback <= high:
            raise ValueError(f"output {name!r}: the fallback {fallback} lies outside [{low}, {high}]")
        for term_name, term in variable.terms.items():
            if term.corners[0] >= high or term.corners[3] <= low:
                raise ValueError(f"output {name!r}: term {term_name!r} lies outside [{low}, {high}]")
            if self.defuzzification == "weighted_mean_of_peaks" and not low <= term.peak <= high:
                raise ValueError(f"output {name!r}: the peak {term.peak} of {term_name!r} lies outside [{low}, {high}]")

    def _packed(self) -> FloatArray:
        variables = [*self.inputs.values(), *self.outputs.values()]
        starts = np.cumsum([0, *(len(variable.terms) for variable in variables)]).tolist()
        shapes = [_shapes(variable) for variable in variables]
        n_inputs, rules = len(self.inputs), _floats(number_rules(self.rules, self.inputs, self.outputs))
        premises, conclusions = rules[:, :n_inputs], rules[:, n_inputs:]
        outputs, pieces, windows, stop = [], [], np.zeros((starts[-1], 2)), 0
        for (name, variable), shape, start in zip(
            self.outputs.items(), shapes[n_inputs:], starts[n_inputs:], strict=False
        ):
            pieces.append(divided(variable.low, variable.high, shape, start))
            for term in np.unique(pieces[-1][:, TERM]).astype(int):
                places = stop + np.flatnonzero(pieces[-1][:, TERM] == term)
                windows[term] = places[0], places[-1] + 1
            stop += len(pieces[-1])
            middle, half = 0.5 * (variable.low + variable.high), 0.5 * (variable.high - variable.low)
            outputs.append((middle, half, self.fallback[name]))
        return pack(
            [_bounds(variable) for variable in self.inputs.values()],
            np.concatenate(shapes),
            starts,
            premises,
            _skips(premises),
            conclusions.T,
            outputs,
            [term.peak for variable in variables for term in variable.terms.values()],
            np.concatenate(pieces),
            windows,
            [self.defuzzification == "weighted_mean_of_peaks"],
            [_is_grid(premises, starts[: n_inputs + 1])],
        )
