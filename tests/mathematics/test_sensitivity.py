import math
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from scipy.stats import qmc

from navbench.mathematics.sensitivity import (
    Design,
    flip_probability,
    pawn,
    pawn_null,
    permutation_null,
    rsa,
    saltelli,
    share_of_scrambles,
    total_effects,
)
from navbench.mathematics.statistics import clopper_pearson

pytestmark = pytest.mark.filterwarnings("error")

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def sobol(dimensions: int, n: int, seed: int = 1) -> Floats:
    return np.asarray(qmc.Sobol(dimensions, scramble=True, rng=seed).random(n))


def ishigami(u: Floats) -> Floats:
    """Return Ishigami's function with a = 7 and b = 0.1; what comes after the third factor has no part in it."""
    x = np.pi * (2.0 * u - 1.0)
    return np.asarray(np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0]))


def threshold(u: Floats) -> Bools:
    """Return whether the first two factors add to more than 1; what comes after them has no part in it."""
    return np.asarray(u[:, 0] + u[:, 1] > 1.0)


def results(model: Callable[[Floats], Any], design: Design) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return a model's results at the points a, and a row of those at the changed points of each factor."""
    return model(design.a), np.array([model(design.changed(i)) for i in range(design.a.shape[1])])


# The design


def test_a_changed_point_takes_one_factor_from_the_other_sample_and_leaves_the_design_alone() -> None:
    design = saltelli(16, 3, 0)
    before = design.a.copy()
    for i in range(3):
        changed = design.changed(i)
        assert (changed[:, i] == design.b[:, i]).all()
        assert (np.delete(changed, i, axis=1) == np.delete(design.a, i, axis=1)).all()
    assert (design.a == before).all()


def test_the_seed_alone_says_which_scramble_a_design_is() -> None:
    first, again, other = saltelli(64, 5, 3), saltelli(64, 5, 3), saltelli(64, 5, 4)
    assert (first.a == again.a).all()
    assert (first.b == again.b).all()
    assert (first.a != other.a).all()


def test_both_samples_fill_each_factor_evenly() -> None:
    for sample in saltelli(64, 60, 0):
        assert (np.sort((sample * 64).astype(int), axis=0) == np.arange(64)[:, None]).all()


@pytest.mark.parametrize("base", [64, 128, 256])
def test_a_choice_between_two_changes_in_half_of_few_points_for_each_of_60_factors(base: int) -> None:
    """The first and second half of the dimensions would change some in none, or in all."""
    for seed in range(3):
        a, b = saltelli(base, 60, seed)
        assert ((a > 0.5) != (b > 0.5)).mean(axis=0) == pytest.approx(0.5, abs=1e-12)


def test_each_seed_gives_the_bad_places_of_few_points_to_other_factors() -> None:
    """Of 16 points, some of the first 30 pairs of dimensions change all choices between two, or none."""
    designs = [saltelli(16, 30, seed) for seed in range(8)]
    bad = [frozenset(np.flatnonzero(abs(((a > 0.5) != (b > 0.5)).mean(axis=0) - 0.5) > 0.4)) for a, b in designs]
    assert all(bad)
    assert len(set(bad)) > 4


# Total effects and flips


@pytest.mark.parametrize("seed", range(3))
def test_ishigamis_total_effects_are_those_known_in_closed_form(seed: int) -> None:
    """Within 0.015: at 1,024 points the first has a standard deviation of 0.0033 over scrambles."""
    effects = total_effects(*results(ishigami, saltelli(1024, 4, seed)))
    assert effects[:3] == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.015)
    assert effects[3] == 0.0


def test_a_thresholds_flip_probability_and_total_effect_are_those_of_the_integral() -> None:
    """Given u2, the sum passes 1 with probability u2: two draws of u1 differ with 2 u2 (1 - u2), on average 1/3.

    The verdict's variance is 1/4, so that the total effect is 1/3 / (2 * 1/4) = 2/3.
    """
    y_a, y_changed = results(threshold, saltelli(4096, 3, 0))
    flips = [flip_probability(y_a, row).value for row in y_changed]
    assert flips == pytest.approx([1 / 3, 1 / 3, 0.0], abs=0.01)
    assert total_effects(y_a, y_changed) == pytest.approx([2 / 3, 2 / 3, 0.0], abs=0.02)


def test_the_total_effect_of_a_verdict_is_its_flip_probability_over_that_of_two_independent_verdicts() -> None:
    y_a, y_changed = results(lambda u: u[:, 0] * u[:, 1] > 0.6, saltelli(256, 2, 5))
    p = y_a.mean()
    flips = [flip_probability(y_a, row).value for row in y_changed]
    assert total_effects(y_a, y_changed) == pytest.approx(np.array(flips) / (2 * p * (1 - p)))


def test_nothing_has_an_effect_on_a_verdict_that_never_turns() -> None:
    y = np.ones(8, dtype=bool)
    assert (total_effects(y, np.tile(y, (3, 1))) == 0.0).all()


def test_an_irrelevant_factor_never_flips_and_its_interval_is_the_exact_one() -> None:
    y_a, y_changed = results(threshold, saltelli(64, 3, 0))
    assert flip_probability(y_a, y_changed[2]) == clopper_pearson(0, 64)
    stacked = np.stack([y_a, y_a])
    assert flip_probability(stacked, stacked) == clopper_pearson(0, 128)


def test_a_flip_probability_of_several_scrambles_has_the_t_interval_of_their_shares_and_half_a_point() -> None:
    y_a, y_changed = zip(*(results(threshold, saltelli(64, 3, seed)) for seed in range(6)), strict=True)
    a, changed = np.array(y_a), np.array(y_changed)[:, 0]
    shares = (a != changed).mean(axis=1)
    low, high = stats.t.interval(0.9, 5, shares.mean(), stats.sem(shares))
    ours, half_a_point = flip_probability(a, changed, confidence=0.9), 0.5 / (6 * 64)
    assert ours == pytest.approx((shares.mean(), low - half_a_point, high + half_a_point, 6 * 64))
    assert ours.low < 1 / 3 < ours.high
    assert flip_probability(a.ravel(), changed.ravel(), replicates=6, confidence=0.9) == ours


# Shares over scrambles


def test_one_scramble_has_the_exact_interval() -> None:
    assert share_of_scrambles(np.array([[True, False, True, True]])) == clopper_pearson(3, 4)


@pytest.mark.parametrize("held", [0, 3, 8])
def test_scrambles_that_all_agree_have_the_exact_interval_of_all_points(held: int) -> None:
    y = np.tile(np.arange(8) < held, (5, 1))
    assert share_of_scrambles(y) == clopper_pearson(5 * held, 40)


def test_an_interval_never_leaves_the_unit_interval() -> None:
    y = np.array([[False] * 4, [True] * 4])
    assert share_of_scrambles(y)[:3] == (0.5, 0.0, 1.0)


@pytest.mark.parametrize(("share", "k", "n"), [(0.5, 4, 64), (0.1, 8, 64), (0.02, 4, 32), (0.9, 3, 128)])
def test_the_interval_holds_the_truth_as_often_as_it_says_for_independent_points(share: float, k: int, n: int) -> None:
    """Where a scramble of a rare case meets none, the other shares alone speak: 0.92 leaves room for these."""
    rng = np.random.default_rng(11)
    estimates = [share_of_scrambles(rng.random((k, n)) < share) for _ in range(1000)]
    assert np.mean([one.low <= share <= one.high for one in estimates]) > 0.92


def test_the_interval_holds_the_truth_for_scrambled_points_and_is_narrower_than_the_exact_one() -> None:
    """The product of two factors passes 0.3 with probability 1 - 0.3 (1 - ln 0.3)."""
    truth = 1.0 - 0.3 * (1.0 - math.log(0.3))
    y = np.array([sobol(2, 64, seed).prod(axis=1) > 0.3 for seed in range(8 * 500)]).reshape(500, 8, 64)
    estimates = [share_of_scrambles(scrambles) for scrambles in y]
    pooled = clopper_pearson(round(truth * 8 * 64), 8 * 64)
    assert 0.92 < np.mean([one.low <= truth <= one.high for one in estimates]) < 0.98
    assert np.mean([one.high - one.low for one in estimates]) < 0.5 * (pooled.high - pooled.low)


# Distances of distributions


def test_pawn_finds_a_part_of_the_range_that_turns_the_verdict() -> None:
    """In the last tenth all hold, of all one in ten: the distance is 0.9, and the median's would be 0.1."""
    u = sobol(1, 4096)[:, 0]
    assert pawn(u, u > 0.5) == pytest.approx(0.5, abs=1e-3)
    assert pawn(u, u > 0.9) == pytest.approx(0.9, abs=1e-3)


def test_pawn_of_numbers_is_the_largest_distance_that_scipy_finds() -> None:
    u = sobol(2, 512)
    y = np.round(u[:, 0] ** 2 + u[:, 1], 2)  # with ties
    cuts = [y[(u[:, 0] >= k / 8) & (u[:, 0] < (k + 1) / 8)] for k in range(8)]
    assert pawn(u[:, 0], y, slices=8) == pytest.approx(max(stats.ks_2samp(cut, y).statistic for cut in cuts))


def test_pawn_gives_each_choice_of_a_few_a_slice_of_its_own() -> None:
    choice = np.repeat([0.0, 1.0, 2.0], [10, 80, 10])
    assert pawn(choice, choice == 2.0) == pytest.approx(0.9)


def test_the_regions_of_a_threshold_are_half_apart() -> None:
    """Where u1 + u2 > 1, u1 is distributed as u^2, else as 2 u - u^2: they differ most at 1/2, by 1/2."""
    u = sobol(3, 4096)
    y = threshold(u)
    assert [rsa(column, y) for column in u.T] == pytest.approx([0.5, 0.5, 0.0], abs=0.02)
    assert rsa(u[:, 0], u[:, 0] > 0.3) == 1.0
    assert rsa(u[:, 0], np.ones(4096, dtype=bool)) == 0.0


def test_the_regions_are_as_far_apart_as_scipy_finds() -> None:
    u = np.round(sobol(2, 256), 1)  # with ties
    y = threshold(u)
    assert rsa(u[:, 0], y) == pytest.approx(stats.ks_2samp(u[y, 0], u[~y, 0]).statistic)


# The permutation null


def test_a_null_counts_the_permutations_that_reach_the_value_and_the_value_itself() -> None:
    """The first verdict stays the first in one permutation of four, so that some 50 of 200 reach 1."""
    y = np.array([True, False, False, False])
    null = permutation_null(lambda u, y: float(y[0]), np.arange(4.0), y, np.random.default_rng(0))
    repeated = np.random.default_rng(0)
    reached = sum(repeated.permutation(y)[0] for _ in range(200))
    assert null == (1.0, 1.0, (1 + reached) / 201)


def test_a_factor_that_turns_the_verdict_is_beyond_every_permutation() -> None:
    u = sobol(2, 256)
    for statistic in (pawn, rsa):
        null = permutation_null(statistic, u[:, 0], threshold(u), np.random.default_rng(0), permutations=99)
        assert null.p_value == 0.01
        assert null.p95 < null.value


@pytest.mark.parametrize("statistic", [pawn, rsa])
def test_an_irrelevant_factor_is_significant_in_one_of_twenty_samples(statistic: Callable[..., float]) -> None:
    """Of 200 independent samples 10 are expected; 19 or more have a probability of 0.6 %."""
    rng = np.random.default_rng(5)
    nulls = [
        permutation_null(statistic, rng.random(128), rng.random(128) < 0.4, rng, permutations=59) for _ in range(200)
    ]
    assert 2 <= sum(null.p_value <= 0.05 for null in nulls) <= 18
    assert sum(null.value > null.p95 for null in nulls) <= 22


def test_the_quick_null_of_pawn_is_that_of_permuted_verdicts() -> None:
    u = sobol(2, 512)
    y = u[:, 0] + 4.0 * u[:, 1] > 2.5
    quick = pawn_null(u[:, 0], y, np.random.default_rng(0), permutations=4000)
    slow = permutation_null(pawn, u[:, 0], y, np.random.default_rng(1), permutations=1000)
    assert quick.value == slow.value == pawn(u[:, 0], y)
    assert quick.p95 == pytest.approx(slow.p95, rel=0.05)
    assert 0.05 < quick.p_value < 0.95
    assert quick.p_value == pytest.approx(slow.p_value, abs=0.05)


def test_a_null_of_a_factor_with_fewer_choices_than_slices_has_no_empty_slice() -> None:
    choice = np.repeat([0.0, 1.0], 32)
    null = pawn_null(choice, choice == 1.0, np.random.default_rng(0))
    assert (null.value, null.p_value) == (0.5, 1 / 201)
    assert null.p95 == pytest.approx(0.125, abs=0.04)


# Bad input

A = np.array([True, False, True, True])
U = np.array([0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: saltelli(48, 2, 0), "base must be a power of two, not 48"),
        (lambda: saltelli(0, 2, 0), "base must be a whole number of at least 1, not 0"),
        (lambda: saltelli(8, 0, 0), "dimensions must be a whole number of at least 1, not 0"),
        (lambda: total_effects(A, A), "y_changed must be numbers in 2 dimensions"),
        (lambda: total_effects(A, np.ones((3, 5))), r"y_changed must have 4 columns, as y_a, not shape \(3, 5\)"),
        (lambda: total_effects(np.array([1.0, math.nan]), np.ones((1, 2))), "y_a must be finite"),
        (lambda: flip_probability(A, A[:3]), "must have the same shape"),
        (lambda: flip_probability(U, U), "y_a must be booleans"),
        (lambda: flip_probability(A, A, replicates=3), "replicates must divide the 4 verdicts, as 3 does not"),
        (lambda: flip_probability(A, A, confidence=1.0), "confidence must lie in"),
        (lambda: share_of_scrambles(A), "y must be booleans in 2 dimensions"),
        (lambda: share_of_scrambles(np.zeros((2, 0), dtype=bool)), "not empty"),
        (lambda: pawn(U, A[:2]), "u and y must be equally long, not 4 and 2"),
        (lambda: pawn(U, A, slices=0), "must be a whole number of at least 1, not 0"),
        (lambda: pawn(np.array([0.1, math.inf]), A[:2]), "u must be finite"),
        (lambda: rsa(U, U), "y must be booleans"),
        (lambda: rsa(U, A[:2]), "u and y must be equally long"),
        (
            lambda: permutation_null(pawn, U, A, np.random.default_rng(0), permutations=0),
            "permutations must be a whole",
        ),
    ],
)
def test_bad_input_is_named(call: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()


def test_importing_it_leaves_scipys_statistics_alone() -> None:
    code = "import sys, navbench.mathematics.sensitivity; assert 'scipy.stats' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
