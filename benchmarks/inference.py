"""One fuzzy inference, for four sizes of rule base: in compiled code, from Python, and by scikit-fuzzy."""

import itertools
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from typing import Any

import numpy as np

from benchmarks.harness import Effort, Side, Sides, Table, compare, peer
from benchmarks.peers import scikit_fuzzy
from navbench.compiled import compiled
from navbench.fuzzy.inference import FuzzyInference, Variable, infer

SIZES = {
    "1 input, 11 rules": (11,),
    "2 inputs, 32 rules": (4, 8),
    "3 inputs, 64 rules": (4, 4, 4),
    "4 inputs, 81 rules": (3,) * 4,
}
POINTS = 50


def evenly(n_terms: int, *, shoulders: bool) -> Variable:
    """Return a variable in [0, 1] with evenly spaced peaks, named 0, 1, ..."""
    peaks = {str(k): float(peak) for k, peak in enumerate(np.linspace(0.0, 1.0, n_terms + 2)[1:-1])}
    return Variable.from_peaks(peaks, 0.0, 1.0, shoulders=shoulders)


def complete(
    inputs: Mapping[str, Variable], outputs: Mapping[str, Variable], method: str = "centroid"
) -> FuzzyInference:
    """Return a rule base with a rule for each combination of the inputs' sets, and conclusions dealt out in turn."""
    terms = [list(variable.terms) for variable in outputs.values()]
    premises = itertools.product(*(variable.terms for variable in inputs.values()))
    rules = [(*premise, *(names[i % len(names)] for names in terms)) for i, premise in enumerate(premises)]
    return FuzzyInference(inputs, outputs, rules, fallback=dict.fromkeys(outputs, 0.0), defuzzification=method)


def drawn(inputs: Mapping[str, Variable]) -> list[dict[str, float]]:
    """Return some random values of every input."""
    rng = np.random.default_rng(0)
    return [{name: float(rng.uniform(v.low, v.high)) for name, v in inputs.items()} for _ in range(POINTS)]


@compiled
def answer_all(base: Any, points: Any, out: Any) -> None:
    """Ask a rule base for every point, without Python between."""
    for i in range(points.shape[0]):
        infer(base, points[i], out)


def in_bulk(*bases: FuzzyInference) -> Side:
    """Return a function that asks rule bases, one after the other, for many points in compiled code."""
    asked = [
        (base.base, np.array([list(point.values()) for point in drawn(base.inputs)]), np.empty(len(base.outputs)))
        for base in bases
    ]

    def ask() -> int:
        for arguments in asked:
            answer_all(*arguments)
        return POINTS

    return ask


def from_python(answer: Callable[[Mapping[str, float]], object], inputs: Mapping[str, Variable]) -> Side:
    """Return a function that asks for one point after another from Python."""
    points = drawn(inputs)

    def ask() -> int:
        for point in points:
            answer(point)
        return POINTS

    return ask


def of_size(terms: tuple[int, ...], _: ExitStack) -> Sides:
    """Return all sides of a complete rule base over inputs with so many terms, and two outputs."""
    outputs = {name: evenly(n, shoulders=False) for name, n in {"v": 4, "w": 11}.items()}
    base = complete({f"x{i}": evenly(n, shoulders=True) for i, n in enumerate(terms)}, outputs)
    return {
        "from Python": from_python(lambda at: base(*at.values()), base.inputs),
        "in compiled code": in_bulk(base),
        "scikit-fuzzy": peer(lambda: scikit_fuzzy(base, drawn(base.inputs))),
    }


def inference(effort: Effort) -> Table:
    """Measure one inference."""
    groups: dict[str, Callable[[ExitStack], Sides]] = {
        name: partial(of_size, size) for name, size in [*SIZES.items()][: effort.few(4)]
    }
    text = "Complete Mamdani rule bases with two outputs of 4 and 11 sets, centroids of 200 samples, random inputs."
    return compare("Fuzzy inference", text, "inferences", groups, effort)
