"""Mamdani inference on a packed rule base, as compiled functions; ``inference`` packs it and says what it is."""

import math

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled
from navbench.fuzzy.centroid import NEGLIGIBLE, centroid
from navbench.memory import scratch

FloatArray = NDArray[np.float64]

SMALL = 1024  # rules: more would not fit on every thread's stack

# What ``pack`` makes a rule base of, in this order. Terms are numbered through, the inputs' first.
RANGES = 0  # (n_inputs, 3) low, high, period (0: not circular)
SHAPES = 1  # (n_terms, 5) corners a, b, c, d; 1 if the ramps are smooth
STARTS = 2  # (n_inputs + n_outputs + 1,) number of each variable's first term, and of all terms
PREMISES = 3  # (n_rules, n_inputs) numbers of terms; n_terms stands for any
SKIPS = 4  # (n_rules, n_inputs) the next rule with another premise up to this input
CONCLUSIONS = 5  # (n_outputs, n_rules) numbers of terms; n_terms stands for none
OUTPUTS = 6  # (n_outputs, 3) middle and half of the range, fallback
PEAKS = 7  # (n_terms,)
PIECES = 8  # (n_pieces, 7) of ``divided``, all outputs in a row
WINDOWS = 9  # (n_terms, 2) each output term's first piece, and the end of its pieces
WEIGHTED = 10  # (1,) 1 for the weighted mean of peaks, 0 for the centroid
GRID = 11  # (1,) 1 if the premises are all combinations of the terms, those of the last input running first


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
def degrees_of(x: FloatArray, base: FloatArray, n_terms: int) -> FloatArray:
    """Return the degrees of the terms of a base's only variable at each x, (n_x, n_terms)."""
    degrees = np.empty((x.size, n_terms))
    for k in range(x.size):
        _fuzzify(x[k], base, 0, degrees[k])
    return degrees


@compiled
def _fire(base: FloatArray, values: FloatArray, slots: FloatArray, fired: FloatArray) -> int:
    """Write the degree of each input term, and number and strength of each rule that fires, counted.

    Returns:
        How many fire; of an unusable input -1 less its number.
    """
    for i in range(_input_count(base)):
        if math.isnan(values[i]) or (math.isinf(values[i]) and base[int(base[RANGES]) + 3 * i + 2] > 0.0):
            return -1 - i
        _fuzzify(values[i], base, i, slots)
    return _fire_grid(base, slots, fired) if base[int(base[GRID])] > 0.0 else _fire_each(base, slots, fired)


@compiled
def _fire_grid(base: FloatArray, slots: FloatArray, fired: FloatArray) -> int:
    """Combine, input by input, what fires so far with each term met; the digits of a rule's number are its terms."""
    met, starts, count = scratch((slots.size,)), int(base[STARTS]), 1
    fired[0, 0], fired[0, 1] = 0.0, 1.0
    for i in range(_input_count(base)):
        first, end, width = int(base[starts + i]), int(base[starts + i + 1]), 0
        for t in range(first, end):
            if slots[t] > 0.0:
                met[width] = t
                width += 1
        for k in range(count - 1, -1, -1):  # from the last one, so that none is written over before it is read
            before, strength = fired[k, 0] * (end - first) - first, fired[k, 1]
            for j in range(width - 1, -1, -1):
                fired[k * width + j, 0] = before + met[j]
                fired[k * width + j, 1] = min(strength, slots[int(met[j])])
        count *= width
    return count


@compiled
def _fire_each(base: FloatArray, slots: FloatArray, fired: FloatArray) -> int:
    """Go through all rules, past those that share a premise that does not hold."""
    slots[slots.size - 1] = 1.0  # any
    n_inputs, count, r = _input_count(base), 0, 0
    premises, skips, n_rules = int(base[PREMISES]), int(base[SKIPS]), rule_count(base)
    while r < n_rules:
        strength, at, following = 1.0, n_inputs * r, r + 1
        for i in range(n_inputs):
            strength = min(strength, slots[int(base[premises + at + i])])
            if strength == 0.0:
                following = int(base[skips + at + i])
                break
        else:
            fired[count, 0], fired[count, 1] = r, strength
            count += 1
        r = following
    return count


@compiled
def _centroid(base: FloatArray, conclusions: int, count: int, fired: FloatArray, slots: FloatArray) -> float:
    """Return the centroid of an output, see ``centroid``; each term is cut at the strength of its strongest rule."""
    windows, none, begin, end = int(base[WINDOWS]), slots.size - 1, math.inf, 0.0
    for k in range(count):
        t = int(base[conclusions + int(fired[k, 0])])
        slots[t] = max(slots[t], fired[k, 1])
        if t < none:
            begin, end = min(begin, base[windows + 2 * t]), max(end, base[windows + 2 * t + 1])
    if end == 0.0:
        return math.nan
    return centroid(base, int(base[PIECES]) + 7 * int(begin), int(base[PIECES]) + 7 * int(end), slots)


@compiled
def _weighted_mean(
    base: FloatArray, conclusions: int, count: int, fired: FloatArray, slots: FloatArray, first: int, end: int
) -> float:
    """Return sum(strength * peak) / sum(strength) over an output's terms, of each the sum over its rules; NaN if 0."""
    for k in range(count):
        slots[int(base[conclusions + int(fired[k, 0])])] += fired[k, 1]
    total, moment, peaks = 0.0, 0.0, int(base[PEAKS])
    for t in range(first, end):
        total += slots[t]
        moment += slots[t] * base[peaks + t]
    return moment / total if total > NEGLIGIBLE else math.nan


@compiled
def _input_count(base: FloatArray) -> int:
    return int(base[RANGES + 1] - base[RANGES]) // 3


@compiled
def rule_count(base: FloatArray) -> int:
    """Return how many rules there are."""
    return int(base[SKIPS] - base[PREMISES]) // _input_count(base)


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
    rules = rule_count(base)
    fired = scratch((rules, 2)) if rules <= SMALL else np.empty((rules, 2))
    count = _fire(base, values, scratch((slot_count(base),)), fired)
    if count < 0:
        return -1 - count
    strengths[:] = 0.0
    for k in range(count):
        strengths[int(fired[k, 0])] = fired[k, 1]
    return -1


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
    rules = rule_count(base)
    fired = scratch((rules, 2)) if rules <= SMALL else np.empty((rules, 2))
    count = infer_and_fire(base, values, out, fired)
    return -1 if count >= 0 else -1 - count


@compiled
def infer_each(base: FloatArray, points: FloatArray, out: FloatArray) -> int:
    """Do what ``infer`` does at many points, in order.

    Args:
        base: as for ``infer``.
        points: (n, n_inputs) inputs.
        out: (n, n_outputs) is written.

    Returns:
        The number of the first point with an unusable input, after which nothing is written, else -1.
    """
    for k in range(len(points)):
        if infer(base, points[k], out[k]) >= 0:
            return k
    return -1


@compiled
def infer_and_fire(base: FloatArray, values: FloatArray, out: FloatArray, fired: FloatArray) -> int:
    """Do what ``infer`` does, and write which rules fire.

    Args:
        base: as for ``infer``.
        values: as for ``infer``.
        out: as for ``infer``.
        fired: (n_rules, 2) of each rule that fires its number and strength, in the order of their numbers; the first
            rows are written.

    Returns:
        How many rules fire; of an unusable input -1 less its number.
    """
    slots = scratch((slot_count(base),))
    count = _fire(base, values, slots, fired)
    for o in range(int(base[OUTPUTS + 1] - base[OUTPUTS]) // 3):
        at, starts = int(base[OUTPUTS]) + 3 * o, int(base[STARTS]) + _input_count(base) + o
        first, end, conclusions = (
            int(base[starts]),
            int(base[starts + 1]),
            int(base[CONCLUSIONS]) + rule_count(base) * o,
        )
        for t in range(first, end):
            slots[t] = 0.0
        if count < 0:
            out[o] = math.nan
        elif base[int(base[WEIGHTED])] > 0.0:
            out[o] = _weighted_mean(base, conclusions, count, fired, slots, first, end)
        else:
            out[o] = base[at] + base[at + 1] * _centroid(base, conclusions, count, fired, slots)
        if math.isnan(out[o]) and count >= 0:
            out[o] = base[at + 2]
    return count
