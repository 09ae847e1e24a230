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

from navbench.compiled import compiled
from navbench.fuzzy.centroid import NEGLIGIBLE, centroid, divided
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
    "slot_count",
]

FloatArray = NDArray[np.float64]

DEFUZZIFICATIONS = ("centroid", "weighted_mean_of_peaks")

# What ``pack`` makes a rule base of, in this order. Terms are numbered through, the inputs' first.
RANGES = 0  # (n_inputs, 3) low, high, period (0: not circular)
SHAPES = 1  # (n_terms, 5) corners a, b, c, d; 1 if the ramps are smooth
STARTS = 2  # (n_inputs + 1,) number of each input's first term, and of the first output term
PREMISES = 3  # (n_rules, n_inputs) numbers of terms; n_terms stands for any
SKIPS = 4  # (n_rules, n_inputs) the next rule with another premise up to this input
CONCLUSIONS = 5  # (n_outputs, n_rules) numbers of terms; n_terms stands for none
OUTPUTS = 6  # (n_outputs, 5) first piece, end of pieces, middle and half of the range, fallback
PEAKS = 7  # (n_terms,)
PIECES = 8  # (n_pieces, 7) of ``divided``, all outputs in a row
WEIGHTED = 9  # (1,) 1 for the weighted mean of peaks, 0 for the centroid


@compiled
def _degree(x: float, base: FloatArray, at: int) -> float:
    """Return the membership of x in the term whose shape stands at a place of the base."""
    a, b, c, d = base[at], base[at + 1], base[at + 2], base[at + 3]
    if x < a or x > d:
        return 0.0
    m = 1.0
    if x < b:
        m = (x - a) / (b - a)
    elif x > c:
        m = (d - x) / (d - c)
    if base[at + 4] == 0.0:
        return m
    return 2.0 * m * m if m <= 0.5 else 1.0 - 2.0 * (1.0 - m) * (1.0 - m)


@compiled
def _fuzzify(x: float, base: FloatArray, i: int, degrees: FloatArray) -> None:
    """Write the membership of x in the terms of the i-th input, after saturating or wrapping it."""
    ends, starts, shapes = int(base[RANGES]) + 3 * i, int(base[STARTS]) + i, int(base[SHAPES])
    low, high, period = base[ends], base[ends + 1], base[ends + 2]
    if period == 0.0:
        x = min(max(x, low), high)
    elif x < low or x > high:
        x = low + (x - low) % period
    for t in range(int(base[starts]), int(base[starts + 1])):
        at = shapes + 5 * t
        degrees[t] = _degree(x, base, at)
        if period > 0.0:  # a term past one end is met from the other
            degrees[t] = max(degrees[t], _degree(x - period, base, at), _degree(x + period, base, at))


@compiled
def _memberships(x: FloatArray, base: FloatArray, n_terms: int) -> FloatArray:
    degrees = np.empty((x.size, n_terms))
    for k in range(x.size):
        _fuzzify(x[k], base, 0, degrees[k])
    return degrees


@compiled
def _fire(base: FloatArray, values: FloatArray, slots: FloatArray, strengths: FloatArray) -> int:
    """Write the degree of each input term and the strength of each rule; return which input is unusable, or -1."""
    n_inputs = int(base[STARTS + 1] - base[STARTS]) - 1
    for i in range(n_inputs):
        if math.isnan(values[i]) or (math.isinf(values[i]) and base[int(base[RANGES]) + 3 * i + 2] > 0.0):
            return i
        _fuzzify(values[i], base, i, slots)
    slots[-1] = 1.0  # any
    strengths[:] = 0.0
    premises, skips, r = int(base[PREMISES]), int(base[SKIPS]), 0
    while r < strengths.size:
        strength, at, following = 1.0, n_inputs * r, r + 1
        for i in range(n_inputs):
            strength = min(strength, slots[int(base[premises + at + i])])
            if strength == 0.0:
                following = int(base[skips + at + i])
                break
        strengths[r] = strength
        r = following
    return -1


@compiled
def _conclude(base: FloatArray, conclusions: int, weighted: bool, slots: FloatArray, strengths: FloatArray) -> None:
    """Write the strengths by term of an output: their sum for the weighted mean, the largest for the centroid."""
    slots[:] = 0.0
    for r in range(strengths.size):
        if strengths[r] > 0.0:
            t = int(base[conclusions + r])
            slots[t] = slots[t] + strengths[r] if weighted else max(slots[t], strengths[r])


@compiled
def _weighted_mean(base: FloatArray, peaks: int, slots: FloatArray) -> float:
    """Return sum(strength * peak) / sum(strength) over the terms; NaN if none fired."""
    total, moment = 0.0, 0.0
    for t in range(slots.size - 1):
        total += slots[t]
        moment += slots[t] * base[peaks + t]
    return moment / total if total > NEGLIGIBLE else math.nan


@compiled
def rule_count(base: FloatArray) -> int:
    """Return how many rules there are."""
    return int(base[SKIPS] - base[PREMISES]) // (int(base[STARTS + 1] - base[STARTS]) - 1)


@compiled
def slot_count(base: FloatArray) -> int:
    """Return how much room an inference needs, beside that for the rules' strengths."""
    return int(base[PEAKS + 1] - base[PEAKS]) + 1


@compiled
def fire(base: FloatArray, values: FloatArray, strengths: FloatArray) -> int:
    """Write how strongly each rule fires for the crisp inputs, callable from compiled code.

    Args:
        base: ``FuzzyInference.base``.
        values: (n_inputs,) inputs, as ``infer`` takes them.
        strengths: (n_rules,) is written, unless an input is unusable.

    Returns:
        The number of the first unusable input, else -1.
    """
    return _fire(base, values, np.empty(slot_count(base)), strengths)


@compiled
def infer(base: FloatArray, values: FloatArray, out: FloatArray) -> int:
    """Write the crisp outputs for the crisp inputs: the whole inference, callable from compiled code.

    Args:
        base: ``FuzzyInference.base``.
        values: (n_inputs,) inputs; outside its range one saturates to the nearer end, or wraps if it is circular.
        out: (n_outputs,) is written; all NaN if an input is unusable.

    Returns:
        The number of the first unusable input (NaN, or infinite on a circular variable), else -1.
    """
    return infer_and_fire(base, values, out, np.empty(rule_count(base)), np.empty(slot_count(base)))


@compiled
def infer_and_fire(
    base: FloatArray, values: FloatArray, out: FloatArray, strengths: FloatArray, slots: FloatArray
) -> int:
    """Do what ``infer`` does, and write how strongly each rule fires.

    Args:
        base: as for ``infer``.
        values: as for ``infer``.
        out: as for ``infer``.
        strengths: (n_rules,) is written, unless an input is unusable.
        slots: (``slot_count``,) room.

    Returns:
        As ``infer``.
    """
    unusable, n_outputs = _fire(base, values, slots, strengths), int(base[OUTPUTS + 1] - base[OUTPUTS]) // 5
    if unusable >= 0:
        out[:] = math.nan
        return unusable
    weighted, pieces = base[int(base[WEIGHTED])] > 0.0, int(base[PIECES])
    for o in range(n_outputs):
        at = int(base[OUTPUTS]) + 5 * o
        _conclude(base, int(base[CONCLUSIONS]) + strengths.size * o, weighted, slots, strengths)
        if weighted:
            crisp = _weighted_mean(base, int(base[PEAKS]), slots)
        else:
            begin, end = pieces + 7 * int(base[at]), pieces + 7 * int(base[at + 1])
            crisp = base[at + 2] + base[at + 3] * centroid(base, begin, end, slots)
        out[o] = base[at + 4] if math.isnan(crisp) else crisp
    return -1


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
    return _floats(_memberships(points, pack(_bounds(variable), shapes, [0, len(shapes)]), len(shapes)).T)


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
        """Return the outputs over the grid of one axis an input, (len(axis 1), ..., len(axis n), n_outputs)."""
        grid = [_floats(axis).ravel() for axis in axes]
        rows = [self(*point) for point in itertools.product(*grid)]
        return np.array(rows).reshape(*(axis.size for axis in grid), len(self.outputs))

    def _load(self, values: tuple[float, ...]) -> None:
        if len(values) != self._values.size:
            raise ValueError(f"the inputs are {', '.join(self.inputs)}, but {len(values)} values were given")
        for i, value in enumerate(values):  # of so few values quicker than a slice
            self._values[i] = value

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
        outputs, pieces, stop = [], [], 0
        for (name, variable), shape, start in zip(
            self.outputs.items(), shapes[n_inputs:], starts[n_inputs:], strict=False
        ):
            pieces.append(divided(variable.low, variable.high, shape, start))
            first, stop = stop, stop + len(pieces[-1])
            middle, half = 0.5 * (variable.low + variable.high), 0.5 * (variable.high - variable.low)
            outputs.append((first, stop, middle, half, self.fallback[name]))
        return pack(
            [_bounds(variable) for variable in self.inputs.values()],
            np.concatenate(shapes),
            starts[: n_inputs + 1],
            premises,
            _skips(premises),
            conclusions.T,
            outputs,
            [term.peak for variable in variables for term in variable.terms.values()],
            np.concatenate(pieces),
            [self.defuzzification == "weighted_mean_of_peaks"],
        )
