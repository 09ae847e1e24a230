import itertools
import math
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

import navbench
from navbench.cli.building import made
from navbench.cli.configuration import compose_cell
from navbench.fuzzy.inference import FuzzyInference, Table, Term, Variable, fire, infer, memberships, rules_from_table

NAMES = ["NL", "NM", "N", "NS", "ZN", "Z", "ZP", "PS", "P", "PM", "PL"]
PHI_PEAKS_RAD = [-0.7854, -0.6283, -0.4712, -0.3142, -0.1571, 0.0, 0.1571, 0.3142, 0.4712, 0.6283, 0.7854]
W_PEAKS_RADPS = [-3.0, -2.4, -1.8, -1.2, -0.6, 0.0, 0.6, 1.2, 1.8, 2.4, 3.0]
SPEED_OF_TURN = dict(zip(NAMES, ["S", "S", "S", "M", "L", "L", "L", "M", "S", "S", "S"], strict=True))


def heading_controller(**options: Any) -> FuzzyInference:
    """Return the published controller of one input, the heading error, and 11 rules."""
    phi = Variable.from_peaks(dict(zip(NAMES, PHI_PEAKS_RAD, strict=True)), -math.pi, math.pi, shoulders=True)
    v = Variable.from_peaks({"S": 0.0, "M": 0.1111, "L": 0.2222, "VL": 0.3333}, 0.0, 0.3333, shoulders=False)
    w = Variable.from_peaks(dict(zip(NAMES, W_PEAKS_RADPS, strict=True)), -3.0, 3.0, shoulders=False)
    rules = [(name, SPEED_OF_TURN[name], name) for name in NAMES]
    return FuzzyInference({"phi": phi}, {"v": v, "w": w}, rules, fallback={"v": 0.0, "w": 0.0}, **options)


def one_rule_a_term(output: Variable, **options: Any) -> FuzzyInference:
    """Return an inference whose k-th input, in [0, 1], is the strength of the output's k-th term."""
    level = Variable(0.0, 1.0, {"on": Term("triangle", (0.0, 1.0, 1.0))})
    n = len(output.terms)
    rules = [["any"] * k + ["on"] + ["any"] * (n - 1 - k) + [term] for k, term in enumerate(output.terms)]
    inputs = {f"strength of {term}": level for term in output.terms}
    return FuzzyInference(inputs, {"out": output}, rules, fallback={"out": output.low}, **options)


def random_terms(rng: np.random.Generator, low: float, high: float, least_width: float) -> dict[str, Term]:
    """Return one to seven triangles and trapezoids, some with upright edges, some running past the ends."""
    terms = {}
    for k in range(rng.integers(1, 8)):
        centre, width = rng.uniform(low, high), (high - low) * 10.0 ** rng.uniform(math.log10(least_width), 0.2)
        inner = np.sort(rng.uniform(centre - width / 2.0, centre + width / 2.0, rng.integers(1, 3)))
        points = [centre - width / 2.0, *inner.tolist(), centre + width / 2.0]
        if rng.random() < 0.3:
            points[1] = points[0]
        if rng.random() < 0.3:
            points[-2] = points[-1]
        points.sort()
        terms[f"t{k}"] = Term("triangle" if len(points) == 3 else "trapezoid", tuple(points))
    return terms


KINDS = ["shoulders", "half triangles at the ends", "wide terms", "narrow terms", "smooth ends", "one crowd"]


def random_output(rng: np.random.Generator, kind: str) -> Variable:
    low = rng.uniform(-5.0, 5.0)
    high = low + 10.0 ** rng.uniform(-1.0, 1.0)
    if kind in ("shoulders", "half triangles at the ends"):
        peaks = {f"t{k}": peak for k, peak in enumerate(np.sort(rng.uniform(low, high, rng.integers(2, 9))))}
        return Variable.from_peaks(peaks, low, high, shoulders=kind == "shoulders")
    terms = random_terms(rng, low, high, {"narrow terms": 1e-4, "one crowd": 0.9}.get(kind, 0.1))
    if kind == "smooth ends":
        for k, shape in enumerate(["z", "s", "z", "s"]):
            points = np.sort(rng.uniform(low, high, 2)).tolist()
            terms[f"end{k}"] = Term(shape, tuple(points))
    return Variable(low, high, terms)


def rule_bases(controller: str) -> list[FuzzyInference]:
    """Return the rule bases with centroids of a controller of the configuration."""
    build = compose_cell(f"controller={controller}").configuration["controller"]["build"]
    owner = made("controller.build", build, ("reset", "act"))
    held = [*vars(owner).values(), *(vars(owner.blocks).values() if hasattr(owner, "blocks") else ())]
    return [base for base in held if isinstance(base, FuzzyInference)]


def random_strengths(rng: np.random.Generator, n: int) -> list[float]:
    """Return strengths from 1e-9 to 1, some 0, not all."""
    strengths = 10.0 ** rng.uniform(rng.choice([-9.0, -2.0]), 0.0, n) * (rng.random(n) < 0.7)
    strengths[rng.integers(n)] = rng.random() + 1e-9
    return [float(strength) for strength in np.minimum(strengths, 1.0)]


def parabolas(term: Term) -> list[tuple[float, float, float]]:
    """Return the lines and parabolas that a term follows: the factors of 1, x and x^2 of each."""
    if term.shape in ("z", "s"):
        foot, top = term.points if term.shape == "s" else term.points[::-1]
        k = 2.0 / (top - foot) ** 2
        return [(k * foot**2, -2.0 * k * foot, k), (1.0 - k * top**2, 2.0 * k * top, -k)]
    a, b, *top_end, d = term.points
    ramps = [(a, b), (d, top_end[0] if top_end else b)]
    return [(foot / (foot - top), 1.0 / (top - foot), 0.0) for foot, top in ramps if foot != top]


def meetings(one: tuple[float, float, float], other: tuple[float, float, float]) -> list[float]:
    """Return where two lines or parabolas meet."""
    e, p, q = (u - v for u, v in zip(one, other, strict=True))
    if q == 0.0:
        return [-e / p] if p != 0.0 else []
    root = np.emath.sqrt(p * p - 4.0 * q * e)
    larger = -0.5 * (p + math.copysign(1.0, p) * root)
    return [complex(x).real for x in (larger / q, e / larger if larger != 0.0 else 0.0)]  # one cut more does no harm


def exact_centroid(output: Variable, strengths: list[float]) -> float:
    """Return the centroid by cuts wherever any two curves meet, and Gauss's rule, exact for x times a parabola."""
    curves, cuts = [(0.0, 0.0, 0.0)], {output.low, output.high}
    for term, strength in zip(output.terms.values(), strengths, strict=True):
        cuts |= {*term.points, 0.5 * (term.points[0] + term.points[-1])}
        curves += [(strength, 0.0, 0.0), *parabolas(term)]
    for one, other in itertools.combinations(curves, 2):
        cuts |= set(meetings(one, other))
    edges = np.array(sorted(cut for cut in cuts if output.low <= cut <= output.high))
    half = 0.5 * np.diff(edges)
    area = moment = 0.0
    for gauss in (-1.0 / math.sqrt(3.0), 1.0 / math.sqrt(3.0)):
        x = edges[:-1] + half * (1.0 + gauss)
        height = np.minimum(memberships(output, x), np.array(strengths)[:, None]).max(axis=0)
        area += float(height @ half)
        moment += float((height * (x - output.low)) @ half)
    return output.low + moment / area


@pytest.mark.parametrize("kind", KINDS)
def test_centroid_is_exact(kind: str) -> None:
    rng = np.random.default_rng(7)
    for _ in range(150):
        output = random_output(rng, kind)
        strengths = random_strengths(rng, len(output.terms))
        (crisp,) = one_rule_a_term(output)(*strengths)
        assert abs(crisp - exact_centroid(output, strengths)) < 1e-9 * (output.high - output.low)


@pytest.mark.parametrize("controller", ["sflc", "oa_to", "oa_to_ga", "multi_agent"])
def test_centroids_of_the_shipped_rule_bases_are_exact(controller: str) -> None:
    rng = np.random.default_rng(12)
    bases = rule_bases(controller)
    assert bases
    for inference in bases:
        for _ in range(50):
            values = [rng.uniform(variable.low, variable.high) for variable in inference.inputs.values()]
            fired = inference.strengths(*values)
            for at, (output, crisp) in enumerate(zip(inference.outputs.values(), inference(*values), strict=True)):
                concluded = [rule[len(values) + at] for rule in inference.rules]
                strengths = [
                    max((f for f, name in zip(fired.tolist(), concluded, strict=True) if name == term), default=0.0)
                    for term in output.terms
                ]
                assert abs(crisp - exact_centroid(output, strengths)) < 1e-9 * (output.high - output.low)


def scikit_fuzzy_membership(skfuzzy: Any, term: Term, x: NDArray[np.float64]) -> Any:
    shapes: dict[str, Callable[[], Any]] = {
        "triangle": lambda: skfuzzy.trimf(x, term.points),
        "trapezoid": lambda: skfuzzy.trapmf(x, term.points),
        "z": lambda: skfuzzy.zmf(x, *term.points),
        "s": lambda: skfuzzy.smf(x, *term.points),
    }
    return shapes[term.shape]()


def test_random_systems_agree_with_scikit_fuzzy() -> None:
    skfuzzy = pytest.importorskip("skfuzzy")
    rng = np.random.default_rng(9)
    for _ in range(25):
        low, high = -1.0, 2.0
        x = np.linspace(low, high, 6001)
        ends = {"falling": Term("z", (-0.9, 0.4)), "rising": Term("s", (0.7, 1.8))}
        inputs = {name: Variable(low, high, {**random_terms(rng, low, high, 0.1), **ends}) for name in ("a", "b")}
        output = Variable(low, high, {**random_terms(rng, low, high, 0.1), **ends})
        terms = [list(variable.terms) for variable in (*inputs.values(), output)]
        rules = [tuple(str(rng.choice(names)) for names in terms) for _ in range(12)]
        inference = FuzzyInference(inputs, {"out": output}, rules, fallback={"out": 0.0})
        values = rng.uniform(low, high, 2)
        aggregated = np.zeros_like(x)
        strengths = []
        for *names, conclusion in rules:
            degrees = [
                scikit_fuzzy_membership(skfuzzy, variable.terms[name], np.array([value]))[0]
                for variable, name, value in zip(inputs.values(), names, values, strict=True)
            ]
            strengths.append(np.fmin(*degrees))
            shape = scikit_fuzzy_membership(skfuzzy, output.terms[conclusion], x)
            aggregated = np.fmax(aggregated, np.fmin(strengths[-1], shape))
        expected = skfuzzy.defuzz(x, aggregated, "centroid") if max(strengths) > 0.0 else 0.0
        np.testing.assert_allclose(inference.strengths(*values), strengths, atol=1e-12)
        assert inference(*values)[0] == pytest.approx(expected, abs=1e-3 * (high - low))


def test_z_and_s_are_smooth_mirrored_ramps() -> None:
    variable = Variable(0.0, 10.0, {"z": Term("z", (2.0, 6.0)), "s": Term("s", (2.0, 6.0))})
    z, s = memberships(variable, [0.0, 2.0, 3.0, 4.0, 5.0, 6.0, 10.0])
    np.testing.assert_allclose(z, [1.0, 1.0, 0.875, 0.5, 0.125, 0.0, 0.0])
    np.testing.assert_allclose(s, 1.0 - z)


def test_an_upright_edge_belongs_to_its_term() -> None:
    variable = Variable(0.0, 4.0, {"left": Term("triangle", (1.0, 1.0, 2.0)), "right": Term("trapezoid", (2, 3, 3, 3))})
    left, right = memberships(variable, [0.999, 1.0, 1.5, 2.5, 3.0, 3.001])
    np.testing.assert_allclose(left, [0.0, 1.0, 0.5, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(right, [0.0, 0.0, 0.0, 0.5, 1.0, 0.0])


def test_from_peaks_puts_feet_at_the_neighbouring_peaks() -> None:
    peaks = {"low": 1.0, "middle": 3.0, "high": 7.0}
    shouldered = Variable.from_peaks(peaks, 0.0, 10.0, shoulders=True).terms
    assert shouldered["low"] == Term("trapezoid", (0.0, 0.0, 1.0, 3.0))
    assert shouldered["middle"] == Term("triangle", (1.0, 3.0, 7.0))
    assert shouldered["high"] == Term("trapezoid", (3.0, 7.0, 10.0, 10.0))
    halved = Variable.from_peaks(peaks, 0.0, 10.0, shoulders=False).terms
    assert halved["low"] == Term("triangle", (1.0, 1.0, 3.0))
    assert halved["high"] == Term("triangle", (3.0, 7.0, 7.0))


def test_a_circular_input_wraps_at_its_ends() -> None:
    peaks = {"front": 0.0, "left": 90.0, "back": 180.0, "right": 270.0}
    bearing = Variable.from_peaks(peaks, 0.0, 360.0, shoulders=False, circular=True)
    degrees = memberships(bearing, [0.0, 45.0, 315.0, 360.0, -45.0, 405.0, 765.0])
    np.testing.assert_allclose(degrees[0], [1.0, 0.5, 0.5, 1.0, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(degrees.sum(axis=0), 1.0)
    past_the_end = Variable(-180.0, 180.0, {"back": Term("trapezoid", (150.0, 170.0, 200.0, 230.0))}, circular=True)
    np.testing.assert_allclose(
        memberships(past_the_end, [160.0, 180.0, -180.0, -165.0, -145.0, 0.0])[0], [0.5, 1, 1, 1, 0.5, 0]
    )


def test_an_input_outside_its_range_saturates_to_the_nearer_end() -> None:
    controller = heading_controller()
    assert controller(4.0) == controller(math.inf) == controller(math.pi)
    assert controller(-4.0) == controller(-math.inf) == controller(-math.pi)


@pytest.mark.parametrize("defuzzification", ["centroid", "weighted_mean_of_peaks"])
def test_an_output_on_which_no_rule_fires_takes_its_fallback(defuzzification: str) -> None:
    distance = Variable(0.0, 10.0, {"near": Term("triangle", (0.0, 1.0, 2.0)), "far": Term("triangle", (3, 4, 5))})
    speed = Variable.from_peaks({"slow": 0.0, "fast": 1.0}, 0.0, 1.0, shoulders=False)
    inference = FuzzyInference(
        {"distance": distance},
        {"v": speed, "w": speed},
        [("near", "slow", "none"), ("far", "none", "fast")],
        fallback={"v": 0.25, "w": 0.75},
        defuzzification=defuzzification,
    )
    assert inference(8.0) == (0.25, 0.75)
    assert inference(1.0)[0] != 0.25
    assert inference(1.0)[1] == 0.75
    assert inference(4.0)[0] == 0.25
    assert inference(5e-324) == (0.25, 0.75)  # too weak to divide by


@pytest.mark.parametrize("strength", [1e-190, 1e-30, 1e-6])
def test_a_weak_rule_moves_its_output_to_the_middle_of_the_term(strength: float) -> None:
    output = Variable(0.0, 1.0, {"only": Term("triangle", (0.2, 0.3, 0.6))})
    assert one_rule_a_term(output)(strength)[0] == pytest.approx(0.4, abs=1e-6)


def test_weighted_mean_of_peaks_matches_the_sum_by_hand() -> None:
    a = Variable.from_peaks({"low": 0.0, "high": 1.0}, 0.0, 1.0, shoulders=False)
    v = Variable(
        0.0,
        10.0,
        {
            "triangle": Term("triangle", (0.0, 2.0, 3.0)),
            "trapezoid": Term("trapezoid", (3.0, 4.0, 8.0, 9.0)),
            "z": Term("z", (1.0, 3.0)),
            "s": Term("s", (7.0, 9.0)),
        },
    )
    rules = [
        ("low", "low", "triangle"),  # min(0.8, 0.3) = 0.3
        ("low", "high", "trapezoid"),  # min(0.8, 0.7) = 0.7
        ("high", "low", "z"),  # min(0.2, 0.3) = 0.2
        ("high", "any", "s"),  # 0.2
        ("any", "high", "trapezoid"),  # 0.7: a second rule on one term counts again
        ("any", "any", "none"),
    ]
    inference = FuzzyInference(
        {"a": a, "b": a}, {"v": v}, rules, fallback={"v": 0.0}, defuzzification="weighted_mean_of_peaks"
    )
    np.testing.assert_allclose(inference.strengths(0.2, 0.7), [0.3, 0.7, 0.2, 0.2, 0.7, 1.0])
    expected = (0.3 * 2.0 + 0.7 * 6.0 + 0.2 * 1.0 + 0.2 * 9.0 + 0.7 * 6.0) / (0.3 + 0.7 + 0.2 + 0.2 + 0.7)
    assert inference(0.2, 0.7)[0] == pytest.approx(expected)


def test_a_surface_is_what_calls_return_and_refuses_what_they_refuse() -> None:
    a = Variable.from_peaks({"low": 0.0, "high": 1.0}, 0.0, 1.0, shoulders=False)
    v = Variable(0.0, 10.0, {"low": Term("triangle", (0.0, 2.0, 3.0)), "mid": Term("triangle", (1.0, 4.0, 8.0))})
    rules = [("low", "low", "low"), ("high", "any", "mid")]
    inference = FuzzyInference(
        {"a": a, "b": a}, {"v": v}, rules, fallback={"v": 5.0}, defuzzification="weighted_mean_of_peaks"
    )
    first, second = np.linspace(-0.2, 1.2, 7), np.linspace(0.0, 1.0, 4)
    surface = inference.surface(first, second)
    assert surface.shape == (7, 4, 1)
    assert surface.tolist() == [[list(inference(x, y)) for y in second] for x in first]
    with pytest.raises(ValueError, match="input 'b' is nan"):
        inference.surface([0.5], [0.5, np.nan])
    with pytest.raises(ValueError, match="the inputs are a, b, but 1 values were given"):
        inference.surface([0.5])


def test_control_surface_of_the_heading_controller_is_the_published_one() -> None:
    phi_deg = [0.0, 9.0, 13.5, 18.0, 22.5, 27.0, 36.0, 45.0, 60.0, 180.0]
    v_mps, w_radps = heading_controller().surface(np.radians(phi_deg)).T
    np.testing.assert_allclose(w_radps, [0, 0.6, 0.9, 1.2, 1.5, 1.8, 2.4, 2.801, 2.801, 2.801], atol=2e-3)
    np.testing.assert_allclose(
        v_mps, [0.2222, 0.2222, 0.1667, 0.1111, 0.0978, 0.037, 0.037, 0.037, 0.037, 0.037], atol=1e-4
    )


def test_turning_speed_is_odd_and_monotone_in_the_heading_error() -> None:
    phi_rad = np.linspace(-math.pi, math.pi, 2001)
    v_mps, w_radps = heading_controller().surface(phi_rad).T
    np.testing.assert_allclose(w_radps, -w_radps[::-1], atol=1e-9)
    np.testing.assert_allclose(v_mps, v_mps[::-1], atol=1e-9)
    assert (np.diff(w_radps) > -1e-12).all()


def test_surface_has_one_axis_an_input_and_one_for_the_outputs() -> None:
    output = Variable.from_peaks({"low": 0.0, "high": 1.0}, 0.0, 1.0, shoulders=False)
    inference = one_rule_a_term(output)
    surface = inference.surface([0.1, 0.5], [0.2, 0.4, 0.9])
    assert surface.shape == (2, 3, 1)
    assert surface[1, 2, 0] == inference(0.5, 0.9)[0]


@pytest.mark.parametrize("options", [{}, {"defuzzification": "weighted_mean_of_peaks"}])
def test_a_pickled_inference_gives_identical_outputs(options: dict[str, Any]) -> None:
    controller = heading_controller(**options)
    copy = pickle.loads(pickle.dumps(controller))
    for phi_rad in np.linspace(-4.0, 4.0, 101):
        assert copy(phi_rad) == controller(phi_rad)


def test_replacing_terms_or_rules_changes_the_answer_and_compiles_nothing() -> None:
    controller = heading_controller()
    before = controller(0.3)
    signatures = list(getattr(infer, "signatures", []))
    wider = Variable.from_peaks({"S": 0.0, "L": 0.3, "M": 0.8, "XL": 0.9, "VL": 1.0}, 0.0, 1.0, shoulders=True)
    faster = controller.replaced(outputs={"v": wider})
    mirrored = controller.replaced(
        rules=[(a, v, b) for (a, v, _), b in zip(controller.rules, NAMES[::-1], strict=True)]
    )
    assert faster(0.3)[0] > before[0]
    assert faster(0.3)[1] == before[1]
    assert mirrored(0.3)[1] == pytest.approx(-before[1])
    assert one_rule_a_term(wider)(0.1, 0.2, 0.3, 0.4, 0.5)[0] > 0.0
    assert heading_controller(defuzzification="weighted_mean_of_peaks")(0.3)[1] == pytest.approx(1.146, abs=1e-3)
    assert controller(0.3) == before
    assert list(getattr(infer, "signatures", [])) == signatures
    with pytest.raises(ValueError, match=r"no output 'speed'; allowed: v, w"):
        controller.replaced(outputs={"speed": wider})


def test_every_rule_base_has_the_type_that_is_compiled_once() -> None:
    whole = Term("triangle", (0, 180, 360))
    lone = {"x": Variable(0, 360, {"a": whole}, circular=True)}, {"y": Variable(0, 360, {"a": whole})}, [("a", "a")]
    rng = np.random.default_rng(11)
    cases = [heading_controller(), FuzzyInference(*lone, fallback={"y": 0})]
    cases += [heading_controller(defuzzification="weighted_mean_of_peaks")]
    cases += [one_rule_a_term(random_output(rng, "wide terms")) for _ in range(20)]
    types = {numba.typeof(case.base) for case in cases}  # type: ignore[no-untyped-call,unused-ignore]
    assert len(types) == 1


def test_compiled_code_can_call_the_inference() -> None:
    @numba.njit  # type: ignore[untyped-decorator,unused-ignore]
    def sweep(base: Any, phi_rad: Any, out: Any, strengths: Any) -> int:
        unusable = 0
        for i in range(phi_rad.size):
            unusable += infer(base, phi_rad[i : i + 1], out[i]) >= 0
            unusable += fire(base, phi_rad[i : i + 1], strengths[i]) >= 0
        return unusable

    controller = heading_controller()
    phi_rad = np.array([-0.5, 0.1, math.nan, 0.4])
    out, strengths = np.empty((4, 2)), np.empty((4, 11))
    assert sweep(controller.base, phi_rad, out, strengths) == 2
    assert np.isnan(out[2]).all()
    for i in (0, 1, 3):
        assert tuple(out[i]) == controller(phi_rad[i])
        assert (strengths[i] == controller.strengths(phi_rad[i])).all()


def test_without_compilation_the_outputs_are_the_same() -> None:
    cases = [heading_controller(), heading_controller(defuzzification="weighted_mean_of_peaks")]
    points = [-4.0, -0.3, 0.0, 0.123, 2.0]
    bearing = Variable.from_peaks({"front": 0.0, "back": 3.0}, -3.0, 3.0, shoulders=False, circular=True)
    cases.append(cases[0].replaced(inputs={"phi": bearing}, rules=[("front", "S", "NL"), ("back", "none", "PS")]))
    program = (
        "import pickle, sys; cases, points = pickle.load(sys.stdin.buffer);"
        "sys.stdout.buffer.write(pickle.dumps([[case(point) for point in points] for case in cases]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        input=pickle.dumps((cases, points)),
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(Path(navbench.__file__).parents[1])},
        capture_output=True,
        check=True,
    )
    np.testing.assert_allclose(
        pickle.loads(done.stdout), [[case(point) for point in points] for case in cases], rtol=1e-12
    )


def test_an_unusable_input_raises_and_is_named() -> None:
    controller = heading_controller()
    with pytest.raises(ValueError, match=r"input 'phi' is nan"):
        controller(math.nan)
    with pytest.raises(ValueError, match=r"input 'phi' is nan"):
        controller.strengths(math.nan)
    with pytest.raises(ValueError, match=r"the inputs are phi, but 2 values were given"):
        controller(0.1, 0.2)
    bearing = Variable.from_peaks({"front": 0.0, "back": 3.0}, -3.0, 3.0, shoulders=False, circular=True)
    circular = controller.replaced(inputs={"phi": bearing}, rules=[("front", "S", "Z")])
    with pytest.raises(ValueError, match=r"input 'phi' is inf"):
        circular(math.inf)
    with pytest.raises(ValueError, match="not finite"):
        memberships(bearing, [0.0, math.nan])


@pytest.mark.parametrize(
    ("shape", "points", "message"),
    [
        ("bell", (0.0, 1.0, 2.0), r"'bell' is unknown; allowed: triangle, trapezoid, z, s"),
        ("triangle", (0.0, 1.0), r"takes 3 points, not 2"),
        ("trapezoid", (0.0, 1.0, math.nan, 3.0), r"must be finite"),
        ("triangle", (0.0, 2.0, 1.0), r"must not descend"),
        ("z", (1.0, 1.0), r"must have a width"),
    ],
)
def test_a_wrong_term_is_refused(shape: str, points: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Term(shape, points)


def test_a_wrong_variable_is_refused() -> None:
    term = Term("triangle", (0.0, 0.5, 1.0))
    with pytest.raises(ValueError, match="low < high"):
        Variable(1.0, 0.0, {"a": term})
    with pytest.raises(ValueError, match="at least one term"):
        Variable(0.0, 1.0, {})
    with pytest.raises(ValueError, match="'any' cannot name a term"):
        Variable(0.0, 1.0, {"any": term})
    with pytest.raises(ValueError, match="cannot lie on a circular variable"):
        Variable(0.0, 1.0, {"a": Term("z", (0.0, 1.0))}, circular=True)
    with pytest.raises(ValueError, match="more than a period past"):
        Variable(0.0, 1.0, {"a": Term("triangle", (0.5, 1.0, 2.5))}, circular=True)
    with pytest.raises(ValueError, match="ascending"):
        Variable.from_peaks({"a": 0.5, "b": 0.2}, 0.0, 1.0, shoulders=True)
    with pytest.raises(ValueError, match="within"):
        Variable.from_peaks({"a": 0.5, "b": 1.2}, 0.0, 1.0, shoulders=True)
    with pytest.raises(ValueError, match="no shoulders"):
        Variable.from_peaks({"a": 0.2, "b": 0.5}, 0.0, 1.0, shoulders=True, circular=True)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rules": [("near", "slow"), ("far", "slow")]}, r"rule 2: input 'd' has no term 'far'; allowed: near, any"),
        ({"rules": [("near", "fast")]}, r"rule 1: output 'v' has no term 'fast'; allowed: slow, none"),
        ({"rules": [("near",)]}, r"rule 1 needs 1 input and 1 output terms"),
        ({"rules": []}, r"at least one input, one output and one rule"),
        ({"fallback": {"w": 0.0}}, r"fallback must name v, not w"),
        ({"fallback": {"v": 2.0}}, r"output 'v': the fallback 2.0 lies outside \[0.0, 1.0\]"),
        ({"fallback": {"v": math.nan}}, r"output 'v': the fallback nan lies outside"),
        ({"defuzzification": "bisector"}, r"'bisector' is unknown; allowed: centroid, weighted_mean_of_peaks"),
        ({"outputs": {"v": Variable(0.0, 1.0, {"slow": Term("z", (-2.0, -1.0))})}}, r"term 'slow' lies outside"),
        (
            {
                "outputs": {"v": Variable(0.0, 1.0, {"slow": Term("triangle", (-2.0, -1.0, 1.0))})},
                "defuzzification": "weighted_mean_of_peaks",
            },
            r"the peak -1.0 of 'slow' lies outside",
        ),
        (
            {"outputs": {"v": Variable(0.0, 1.0, {"slow": Term("triangle", (0.0, 0.5, 1.0))}, circular=True)}},
            r"output 'v' is circular",
        ),
    ],
)
def test_a_wrong_rule_base_is_refused(changes: dict[str, Any], message: str) -> None:
    right = {
        "inputs": {"d": Variable(0.0, 1.0, {"near": Term("triangle", (0.0, 0.0, 1.0))})},
        "outputs": {"v": Variable(0.0, 1.0, {"slow": Term("triangle", (0.0, 0.0, 1.0))})},
        "rules": [("near", "slow")],
        "fallback": {"v": 0.0},
    }
    FuzzyInference(**right)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=message):
        FuzzyInference(**{**right, **changes})


def test_a_printed_table_becomes_rules_in_its_order() -> None:
    near_far = Variable.from_peaks({"near": 0.0, "far": 1.0}, 0.0, 1.0, shoulders=False)
    speed = Variable.from_peaks({"stop": 0.0, "slow": 0.5, "fast": 1.0}, 0.0, 1.0, shoulders=False)
    inputs, one, two = {"a": near_far, "b": near_far}, {"v": speed}, {"v": speed, "w": speed}
    table: Table = {"near": ["stop", "slow"], "far": {"near": "slow", "any": "fast"}}
    assert rules_from_table(table, inputs, one) == [
        ("near", "near", "stop"),
        ("near", "far", "slow"),
        ("far", "near", "slow"),
        ("far", "any", "fast"),
    ]
    assert rules_from_table({"near": ["stop none", ["slow", "fast"]]}, inputs, two) == [
        ("near", "near", "stop", "none"),
        ("near", "far", "slow", "fast"),
    ]


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"close": ["stop", "slow"]}, r"input 'a' has no term 'close'; allowed: near, far, any"),
        ({"near": ["stop", "quick"]}, r"output 'v' has no term 'quick'; allowed: stop, slow, none"),
        ({"near": ["stop"]}, r"the table at \[near\] needs 2 entries, for input 'b', not 1"),
        ({"near": "stop"}, r"the table at \[near\] needs a mapping or a list over input 'b', not 'stop'"),
        ({"near": [["stop", "slow"], "slow"]}, r"the table at \[near, near\] needs 1 output term\(s\)"),
        ({"near": ["stop", None]}, r"the table at \[near, far\] needs 1 output term\(s\), not None"),
    ],
)
def test_a_wrong_table_is_refused(table: Any, message: str) -> None:
    near_far = Variable.from_peaks({"near": 0.0, "far": 1.0}, 0.0, 1.0, shoulders=False)
    speed = Variable.from_peaks({"stop": 0.0, "slow": 0.5}, 0.0, 1.0, shoulders=False)
    with pytest.raises(ValueError, match=message):
        rules_from_table(table, {"a": near_far, "b": near_far}, {"v": speed})


def test_a_rule_base_that_is_too_large_for_the_stack_answers_as_its_first_rules_do() -> None:
    def answer(terms: int) -> tuple[float, float]:
        axis = Variable.from_peaks({f"t{i}": float(i) for i in range(terms)}, 0.0, terms - 1.0, shoulders=True)
        output = Variable.from_peaks({"low": 0.0, "half": 1.0, "high": 2.0}, 0.0, 2.0, shoulders=False)
        rules = [(f"t{i}", f"t{j}", ("low", "half", "high")[(i + j) % 3]) for i in range(terms) for j in range(terms)]
        inference = FuzzyInference({"x": axis, "y": axis}, {"out": output}, rules, fallback={"out": 0.0})
        return *inference(0.3, 1.2), inference.strengths(0.3, 1.2).sum()

    assert answer(3) == answer(40)  # 9 and 1,600 rules


@pytest.mark.parametrize("inputs", [1, 2, 3])
def test_all_combinations_in_order_fire_as_the_same_rules_in_another_order(inputs: int) -> None:
    rng = np.random.default_rng(inputs)
    inputs_of = {
        f"x{i}": Variable.from_peaks({"a": 0.0, "b": 1.0 + i, "c": 4.0}, 0.0, 4.0, shoulders=False)
        for i in range(inputs)
    }
    output = {"y": Variable.from_peaks({"s": 0.0, "m": 2.0, "l": 3.0}, 0.0, 3.0, shoulders=True)}
    rules = [(*premises, str(rng.choice(list("sml")))) for premises in itertools.product("abc", repeat=inputs)]
    given: dict[str, Any] = {"fallback": {"y": 0.0}, "defuzzification": "centroid"}
    ordered = FuzzyInference(inputs_of, output, rules, **given)
    shuffled = rng.permutation(len(rules))
    other = FuzzyInference(inputs_of, output, [rules[i] for i in shuffled], **given)
    for values in rng.uniform(-1.0, 5.0, (200, inputs)):
        assert np.array_equal(ordered.strengths(*values)[shuffled], other.strengths(*values))
        assert ordered(*values) == other(*values)
    assert sum(ordered.strengths(*[1.5] * inputs) > 0.0) == 2**inputs
