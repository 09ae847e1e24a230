"""Mamdani inference over any number of inputs and outputs: min for "and" and implication, max over the rules.

A rule base is data. Building one turns it into one array, which ``infer``, compiled once for all rule bases, takes as
an argument: changing a membership or a rule costs a rebuild of the array and never a compilation.

The centroid is a sum over cells that no corner of a term crosses: an output's range is cut at all corners, and each
piece into equal cells no wider than range / samples, at least eight of them, so that narrow terms count in full. In a
cell a term is a straight line, whose mean after the cut at the rule's strength is exact; the aggregate takes the larger
mean. What remains is the error of cells in which two terms cross, and of z and s, whose curves the lines replace.
"""

import itertools
import math
from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navbench.compiled import compiled
from navbench.fuzzy.variables import Rules, Table, Term, Variable, number_rules, rules_from_table
from navbench.policy import pack, part

__all__ = ["FuzzyInference", "Table", "Term", "Variable", "fire", "infer", "memberships", "rules_from_table"]

FloatArray = NDArray[np.float64]

DEFUZZIFICATIONS = ("centroid", "weighted_mean_of_peaks")
CELLS_PER_PIECE = 8  # at least, between two neighbouring corners
NEGLIGIBLE = 1e-200  # a weaker output counts as not fired: its area would underflow to 0 / 0


# What ``pack`` makes a rule base of, in this order. Terms are numbered through, the inputs' first.
RANGES = 0  # (n_inputs, 3) low, high, period (0: not circular)
SHAPES = 1  # (n_terms, 5) corners a, b, c, d; 1 if the ramps are smooth
STARTS = 2  # (n_inputs + n_outputs + 1,) number of each variable's first term; last, n_terms
RULES = 3  # (n_rules, n_inputs + n_outputs) numbers of terms; n_terms stands for any and for none
SPANS = 4  # (n_terms, 3) an output term's first cell, its end, and where its lines begin; 0 for input terms
CELLS = 5  # (2, n_cells) width, width times midpoint; all outputs in a row
LINES = 6  # (3, n) each output term over the cells of its span: lower end, rise, 1 / (2 rise) or 0
PEAKS = 7  # (n_terms,)
FALLBACK = 8  # (n_outputs,)
WEIGHTED = 9  # (1,) 1 for the weighted mean of peaks, 0 for the centroid


@compiled
def _degree(x: float, shapes: FloatArray, term: int) -> float:
    """Return the membership of x in a term."""
    a, b, c, d = shapes[term, 0], shapes[term, 1], shapes[term, 2], shapes[term, 3]
    if x < a or x > d:
        return 0.0
    m = 1.0
    if x < b:
        m = (x - a) / (b - a)
    elif x > c:
        m = (d - x) / (d - c)
    if shapes[term, 4] == 0.0:
        return m
    return 2.0 * m * m if m <= 0.5 else 1.0 - 2.0 * (1.0 - m) * (1.0 - m)


@compiled
def _fuzzify(x: float, bounds: FloatArray, shapes: FloatArray, first: int, stop: int, degrees: FloatArray) -> None:
    """Write the membership of x in the terms from first to stop, after saturating or wrapping it."""
    low, high, period = bounds[0], bounds[1], bounds[2]
    if period == 0.0:
        x = min(max(x, low), high)
    elif x < low or x > high:
        x = low + (x - low) % period
    for t in range(first, stop):
        degrees[t] = _degree(x, shapes, t)
        if period > 0.0:  # a term past one end is met from the other
            degrees[t] = max(degrees[t], _degree(x - period, shapes, t), _degree(x + period, shapes, t))


@compiled
def _memberships(x: FloatArray, bounds: FloatArray, shapes: FloatArray) -> FloatArray:
    degrees = np.empty((x.size, shapes.shape[0]))
    for i in range(x.size):
        _fuzzify(x[i], bounds, shapes, 0, shapes.shape[0], degrees[i])
    return degrees


@compiled
def _fire(base: FloatArray, values: FloatArray, slots: FloatArray, strengths: FloatArray) -> int:
    """Write the degree of each input term and the strength of each rule; return which input is unusable, or -1."""
    ranges, shapes = part(base, RANGES).reshape(-1, 3), part(base, SHAPES).reshape(-1, 5)
    starts, n_inputs = part(base, STARTS), ranges.shape[0]
    rules = part(base, RULES).reshape(-1, starts.size - 1)
    for i in range(n_inputs):
        if math.isnan(values[i]) or (math.isinf(values[i]) and ranges[i, 2] > 0.0):
            return i
        _fuzzify(values[i], ranges[i], shapes, int(starts[i]), int(starts[i + 1]), slots)
    slots[shapes.shape[0]] = 1.0  # any
    for r in range(rules.shape[0]):
        strength = 1.0
        for i in range(n_inputs):
            strength = min(strength, slots[int(rules[r, i])])
        strengths[r] = strength
    return -1


@compiled
def _centroid(base: FloatArray, slots: FloatArray, first: int, stop: int, level: FloatArray) -> float:
    """Return the centroid of the terms from first to stop, each cut at its strength; NaN if none fired."""
    spans, cells = part(base, SPANS).reshape(-1, 3), part(base, CELLS).reshape(2, -1)
    lines = part(base, LINES).reshape(3, -1)
    begin, end = level.size, 0
    for t in range(first, stop):
        strength = slots[t]
        if strength > NEGLIGIBLE:
            cell, last, line = int(spans[t, 0]), int(spans[t, 1]), int(spans[t, 2])
            begin, end = min(begin, cell), max(end, last)
            at = line - cell
            for k in range(cell, last):
                below = min(strength, lines[0, at + k])
                cut = min(strength - below, lines[1, at + k])
                level[k] = max(level[k], below + cut - cut * cut * lines[2, at + k])
    area, moment = 0.0, 0.0
    for k in range(begin, end):
        area += level[k] * cells[0, k]
        moment += level[k] * cells[1, k]
    return moment / area if area > 0.0 else math.nan


@compiled
def _weighted_mean(slots: FloatArray, first: int, stop: int, peaks: FloatArray) -> float:
    """Return sum(strength * peak) / sum(strength) over the terms from first to stop; NaN if none fired."""
    total, moment = 0.0, 0.0
    for t in range(first, stop):
        total += slots[t]
        moment += slots[t] * peaks[t]
    return moment / total if total > NEGLIGIBLE else math.nan


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
    return _fire(base, values, np.empty(part(base, PEAKS).size + 1), strengths)


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
    starts, peaks, fallback = part(base, STARTS), part(base, PEAKS), part(base, FALLBACK)
    n_inputs, n_terms, weighted = starts.size - 1 - fallback.size, peaks.size, part(base, WEIGHTED)[0] > 0.0
    rules = part(base, RULES).reshape(-1, starts.size - 1)
    n_rules, n_slots = rules.shape[0], n_terms + 1
    work = np.empty(n_slots + n_rules + part(base, CELLS).size // 2)  # one allocation is cheaper than three
    slots, strengths, level = work[:n_slots], work[n_slots : n_slots + n_rules], work[n_slots + n_rules :]
    unusable = _fire(base, values, slots, strengths)
    if unusable >= 0:
        out[:] = math.nan
        return unusable
    slots[int(starts[n_inputs]) :] = 0.0
    for r in range(n_rules):  # by output term: the largest strength for the centroid, the sum for the weighted mean
        for o in range(n_inputs, rules.shape[1]):
            t = int(rules[r, o])
            slots[t] = slots[t] + strengths[r] if weighted else max(slots[t], strengths[r])
    level[:] = 0.0
    for o in range(fallback.size):
        first, stop = int(starts[n_inputs + o]), int(starts[n_inputs + o + 1])
        crisp = _weighted_mean(slots, first, stop, peaks) if weighted else _centroid(base, slots, first, stop, level)
        out[o] = fallback[o] if math.isnan(crisp) else crisp
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
    return _floats(_memberships(points, _floats(_bounds(variable)), _shapes(variable)).T)


def _cell_edges(variable: Variable, samples: int) -> FloatArray:
    """Return the edges of an output's cells, ascending from low to high."""
    corners = {corner for term in variable.terms.values() for corner in term.corners}
    cuts = np.array([variable.low, *sorted(c for c in corners if variable.low < c < variable.high), variable.high])
    lengths = np.diff(cuts)
    counts = np.maximum(CELLS_PER_PIECE, np.ceil(samples * lengths / (variable.high - variable.low))).astype(np.int64)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)  # of the cell in its piece
    return np.append(np.repeat(cuts[:-1], counts) + number * np.repeat(lengths / counts, counts), variable.high)


def _lines(variable: Variable, edges: FloatArray) -> FloatArray:
    """Return (n_terms, 3, n_cells), each term over each cell: lower end, rise, 1 / (2 rise) or 0 where it is flat."""
    degrees = memberships(variable, edges)  # an upright edge bounds its term's span, so each cell sees the right side
    left, right = degrees[:, :-1], degrees[:, 1:]
    rise = np.abs(right - left)
    half = np.divide(0.5, rise, out=np.zeros_like(rise), where=rise > NEGLIGIBLE)
    return np.stack([np.minimum(left, right), rise, half], axis=1)


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
        samples: int = 200,
    ) -> None:
        """Check a rule base and turn it into arrays.

        Args:
            inputs: the input variables, in the order of the values.
            outputs: the output variables, in the order of the results.
            rules: each one term name an input ("any": it does not matter), then one an output ("none": no conclusion).
            fallback: for each output the value where no rule fires on it, within its range.
            defuzzification: ``centroid`` of the aggregated area, or ``weighted_mean_of_peaks``, which is
                sum(strength * peak) / sum(strength) over the rules, with ``Term.peak``.
            samples: cells over an output's range, at least; the module says how they lie.

        Raises:
            ValueError: naming the variable, the term or the rule that is wrong.
        """
        self.inputs, self.outputs = dict(inputs), dict(outputs)
        self.rules = tuple(tuple(rule) for rule in rules)
        self.fallback = {name: float(value) for name, value in fallback.items()}
        self.defuzzification, self.samples = defuzzification, samples
        if not (self.inputs and self.outputs and self.rules):
            raise ValueError("an inference needs at least one input, one output and one rule")
        if defuzzification not in DEFUZZIFICATIONS:
            raise ValueError(f"defuzzification {defuzzification!r} is unknown; allowed: {', '.join(DEFUZZIFICATIONS)}")
        if samples < 1:
            raise ValueError(f"samples must be at least 1, not {samples}")
        if set(self.fallback) != set(self.outputs):
            raise ValueError(f"fallback must name {', '.join(self.outputs)}, not {', '.join(self.fallback)}")
        for name, variable in self.outputs.items():
            self._check_output(name, variable)
        self.base = self._packed()
        self._values, self._out = np.empty(len(self.inputs)), np.empty(len(self.outputs))

    def __reduce__(self) -> tuple[object, ...]:
        rebuild = partial(
            FuzzyInference, fallback=self.fallback, defuzzification=self.defuzzification, samples=self.samples
        )
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
            samples=self.samples,
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
        starts = np.cumsum([0, *(len(variable.terms) for variable in variables)])
        spans, cells, lines = [(0, 0, 0)] * int(starts[len(self.inputs)]), [], []
        n_cells = n_lines = 0
        for variable in self.outputs.values():
            edges = _cell_edges(variable, self.samples)
            for term, line in zip(variable.terms.values(), _lines(variable, edges), strict=True):
                feet = np.clip((term.corners[0], term.corners[3]), variable.low, variable.high)
                first, stop = np.searchsorted(edges, feet).tolist()
                spans.append((n_cells + first, n_cells + stop, n_lines))
                lines.append(line[:, first:stop])
                n_lines += stop - first
            widths = np.diff(edges)
            cells.append((widths, widths * 0.5 * (edges[:-1] + edges[1:])))
            n_cells += widths.size
        return pack(
            [_bounds(variable) for variable in self.inputs.values()],
            np.concatenate([_shapes(variable) for variable in variables]),
            starts,
            number_rules(self.rules, self.inputs, self.outputs),
            spans,
            np.concatenate(cells, axis=1),
            np.concatenate(lines, axis=1),
            [term.peak for variable in variables for term in variable.terms.values()],
            [self.fallback[name] for name in self.outputs],
            [self.defuzzification == "weighted_mean_of_peaks"],
        )
