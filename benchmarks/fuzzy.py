"""Time one fuzzy inference, from compiled code and from Python, and one rebuild, beside scikit-fuzzy's control system.

Run ``python benchmarks/fuzzy.py``. Times are the best of several repeats; the ratio to scikit-fuzzy comes from the same
run, over the same inputs, and is left out where scikit-fuzzy is not installed.
"""

import itertools
import timeit
from collections.abc import Callable
from functools import partial
from typing import Any

import numba
import numpy as np

from navbench.fuzzy.inference import FuzzyInference, Variable, infer

SIZES = {
    "1 input, 11 rules": (11,),
    "2 inputs, 32 rules": (4, 8),
    "3 inputs, 64 rules": (4, 4, 4),
    "4 inputs, 81 rules": (3,) * 4,
}
OUTPUT_TERMS = {"v": 4, "w": 11}


def evenly(n_terms: int, *, shoulders: bool) -> Variable:
    """Return a variable in [0, 1] with evenly spaced peaks, named 0, 1, ..."""
    peaks = {str(k): float(peak) for k, peak in enumerate(np.linspace(0.0, 1.0, n_terms + 2)[1:-1])}
    return Variable.from_peaks(peaks, 0.0, 1.0, shoulders=shoulders)


def rule_base(terms_of_inputs: tuple[int, ...]) -> FuzzyInference:
    """Return a complete rule base over inputs with so many terms, two outputs, and conclusions dealt out in turn."""
    inputs = {f"x{i}": evenly(n, shoulders=True) for i, n in enumerate(terms_of_inputs)}
    outputs = {name: evenly(n, shoulders=False) for name, n in OUTPUT_TERMS.items()}
    premises = itertools.product(*(variable.terms for variable in inputs.values()))
    rules = [(*premise, str(r % 4), str(r * 7 % 11)) for r, premise in enumerate(premises)]
    return FuzzyInference(inputs, outputs, rules, fallback={"v": 0.0, "w": 0.0})


def microseconds(call: Callable[[], object], number: int, repeats: int = 7) -> float:
    """Return the time of one call [us], the best mean of several repeats, after one repeat that warms up."""
    return 1e6 * min(timeit.repeat(call, number=number, repeat=repeats + 1)[1:]) / number


def sweep(answer: Callable[..., object], points: list[tuple[float, ...]]) -> Callable[[], None]:
    """Return a function of no arguments that asks for the answer at every point."""

    def ask() -> None:
        for point in points:
            answer(*point)

    return ask


@numba.njit  # type: ignore[untyped-decorator,unused-ignore]
def infer_all(base: Any, points: Any, out: Any) -> None:
    """Answer every point in one compiled loop."""
    for i in range(points.shape[0]):
        infer(base, points[i], out)


def scikit_fuzzy(inference: FuzzyInference) -> Callable[[float], Any]:
    """Return scikit-fuzzy's control system of a rule base with one input, as a function of that input.

    Its memory of past answers is off, since a robot hardly meets the same input twice.
    """
    from skfuzzy import control, trapmf, trimf

    def described(kind: Any, name: str, variable: Variable) -> Any:
        axis = kind(np.linspace(variable.low, variable.high, 201), name)
        for term_name, term in variable.terms.items():
            shape = trimf if term.shape == "triangle" else trapmf
            axis[term_name] = shape(axis.universe, term.points)
        return axis

    ((name, variable),) = inference.inputs.items()
    x = described(control.Antecedent, name, variable)
    outputs = [described(control.Consequent, name, variable) for name, variable in inference.outputs.items()]
    rules = [
        control.Rule(x[premise], [output[term] for output, term in zip(outputs, conclusions, strict=True)])
        for premise, *conclusions in inference.rules
    ]
    simulation = control.ControlSystemSimulation(control.ControlSystem(rules), cache=False)

    def answer(value: float) -> Any:
        simulation.input[name] = value
        simulation.compute()
        return simulation.output

    return answer


def main() -> None:
    """Print the table."""
    rng = np.random.default_rng(0)
    print(f"{'':22s}{'us compiled':>12s}{'us from Python':>16s}{'us per rebuild':>16s}")
    for title, terms_of_inputs in SIZES.items():
        inference = rule_base(terms_of_inputs)
        points = rng.random((2000, len(terms_of_inputs)))
        all_us = microseconds(partial(infer_all, inference.base, points, np.empty(2)), 5, repeats=50)
        call_us = microseconds(sweep(inference, [tuple(point) for point in points[:100].tolist()]), 100) / 100
        rebuild_us = microseconds(partial(inference.replaced, rules=inference.rules), 50)
        print(f"{title:22s}{all_us / len(points):12.2f}{call_us:16.2f}{rebuild_us:16.0f}")
    inference = rule_base(SIZES["1 input, 11 rules"])
    asked: list[tuple[float, ...]] = [(float(x),) for x in rng.random(50)]
    try:
        other = scikit_fuzzy(inference)
    except ImportError as error:
        print(f"scikit-fuzzy: skipped ({error})")
        return
    own_us = microseconds(sweep(inference, asked), 100) / len(asked)
    other_us = microseconds(sweep(other, asked), 1, repeats=3) / len(asked)
    print(f"scikit-fuzzy, 1 input, 11 rules: {other_us:.0f} us per call, {other_us / own_us:.0f} times as long")


if __name__ == "__main__":
    main()
