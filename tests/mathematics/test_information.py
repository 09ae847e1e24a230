import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import qmc

from navbench.mathematics.information import beside, best_pair, classes, information_null, mutual_information
from navbench.mathematics.sensitivity import permutation_null

pytestmark = pytest.mark.filterwarnings("error")

Floats = NDArray[np.float64]


def points(dimensions: int, n: int = 1024, seed: int = 1) -> Floats:
    return np.asarray(qmc.Sobol(dimensions, scramble=True, rng=seed).random(n))


def entropy(p: float) -> float:
    return -p * math.log2(p) - (1.0 - p) * math.log2(1.0 - p)


# Classes


def test_each_of_few_distinct_values_is_a_class_however_rare() -> None:
    assert classes(np.array([7.0, -1.0, 7.0, 2.0, 7.0, 7.0, 7.0, 7.0]), 3).tolist() == [2, 0, 2, 1, 2, 2, 2, 2]


def test_one_value_too_many_leaves_no_class_beyond_the_last() -> None:
    assert classes(np.array([1.0, 2.0, 3.0, 4.0]), 3).tolist() == [0, 1, 2, 2]


def test_many_values_fall_into_equally_full_classes_in_their_order() -> None:
    x = np.random.default_rng(0).permutation(np.arange(120.0)) ** 3
    found = classes(x, 6)
    assert np.bincount(found).tolist() == [20] * 6
    assert (np.diff(found[np.argsort(x)]) >= 0).all()


def test_equal_values_share_a_class_even_where_they_are_most() -> None:
    x = np.concatenate([np.zeros(90), np.arange(1.0, 11.0)])
    assert np.unique(classes(x, 4)[:90]).size == 1
    assert classes(x, 4).max() <= 3


# One factor


def test_a_half_tells_exactly_one_bit() -> None:
    u = points(2)
    assert mutual_information(u[:, 0] > 0.5, u[:, 0]) == 1.0


def test_a_verdict_that_never_turns_cannot_be_told_of() -> None:
    assert mutual_information(np.ones(64, dtype=bool), points(1, 64)[:, 0]) == 0.0


def test_a_noisy_verdict_tells_the_capacity_of_its_channel() -> None:
    """A binary symmetric channel that errs in one of ten tells 1 - H(0.1) = 0.531 bit."""
    u, rng = points(1, 2**15)[:, 0], np.random.default_rng(3)
    y = (u > 0.5) ^ (rng.random(u.size) < 0.1)
    assert mutual_information(y, u) == pytest.approx(1.0 - entropy(0.1), abs=0.01)


def test_each_choice_of_a_few_is_told_apart() -> None:
    """One choice of three always holds: H(1/3), of which bins of equal probability would lose some."""
    choice = np.repeat([0.0, 1.0, 2.0], 300)
    assert mutual_information(choice == 1.0, choice) == pytest.approx(entropy(1 / 3), abs=1e-12)


def test_no_factor_tells_more_than_there_is_to_tell() -> None:
    u = points(1, 256)[:, 0]
    y = u > 0.98
    assert mutual_information(y, u, bins=256) == pytest.approx(entropy(y.mean()), abs=1e-12)


@pytest.mark.parametrize("share", [0.5, 0.1])
def test_an_irrelevant_factor_tells_next_to_nothing_where_plain_counts_tell_a_hundredth_of_a_bit(share: float) -> None:
    """The counts' own bias is 15 cells over 2 * 1,024 nats, 0.0106 bit."""
    rng = np.random.default_rng(2)
    told = [mutual_information(rng.random(1024) < share, rng.random(1024)) for _ in range(200)]
    assert np.mean(told) < 0.0025
    assert np.median(told) < 0.001
    assert min(told) == 0.0


def test_an_irrelevant_factor_is_significant_in_one_of_twenty_samples() -> None:
    """Of 400 independent samples 20 are expected; 31 or more have a probability of 1 %."""
    rng = np.random.default_rng(5)
    nulls = [information_null(rng.random(512) < 0.4, rng.random(512), rng) for _ in range(400)]
    assert 8 <= sum(null.p_value <= 0.05 for null in nulls) <= 30


def test_the_quick_null_is_that_of_permuted_verdicts() -> None:
    u = points(2, 512)
    y = u[:, 0] + 4.0 * u[:, 1] > 2.5
    quick = information_null(y, u[:, 0], np.random.default_rng(0), permutations=4000)
    slow = permutation_null(lambda x, y: mutual_information(y, x), u[:, 0], y, np.random.default_rng(1), 1000)
    assert quick.value == slow.value == mutual_information(y, u[:, 0])
    assert quick.p95 == pytest.approx(slow.p95, rel=0.15)
    assert quick.p_value == pytest.approx(slow.p_value, abs=0.05)


def test_a_permutation_that_is_less_by_rounding_alone_counts_as_equal() -> None:
    assert beside(0.1 + 0.2, np.array([0.3, 0.1])).p_value == 2 / 3


# Pairs


def test_only_both_factors_of_an_exclusive_or_tell_of_it() -> None:
    u = points(10)
    y = (u[:, 3] > 0.5) ^ (u[:, 7] > 0.5)
    assert max(mutual_information(y, column) for column in u.T) < 0.01
    assert best_pair(y, u) == (3, 7, 1.0)


def test_the_best_pair_is_that_of_one_factor_with_a_class_for_each_two_classes() -> None:
    rng = np.random.default_rng(4)
    factors = np.column_stack([rng.random((400, 4)), rng.integers(0, 3, 400)])
    y = factors[:, 1] + 0.5 * factors[:, 4] + 0.3 * rng.random(400) > 1.0
    columns = [classes(column, 6) for column in factors.T]
    told = {
        (i, j): mutual_information(y, (6 * columns[i] + columns[j]).astype(np.float64), bins=36)
        for i, j in itertools.combinations(range(5), 2)
    }
    best = max(told, key=lambda pair: told[pair])
    assert best == (1, 4)
    found = best_pair(y, factors)
    assert (found.i, found.j) == best
    assert found.bits == pytest.approx(told[best], abs=1e-12)


def test_the_best_of_irrelevant_pairs_is_no_better_than_its_null() -> None:
    rng = np.random.default_rng(6)
    factors, y = rng.random((256, 5)), rng.random(256) < 0.5
    null = permutation_null(lambda x, y: best_pair(y, x).bits, factors, y, rng, permutations=50)
    assert null.p_value > 0.05
    assert null.p95 > 0.0


# Bad input

Y, X = np.array([True, False, True]), np.array([0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: mutual_information(X, Y), "y must be booleans in 1 dimensions"),
        (lambda: mutual_information(Y, X[:2]), "y and x must be equally long, not 3 and 2"),
        (lambda: mutual_information(Y, X, bins=0), "bins must be a whole number of at least 1, not 0"),
        (lambda: mutual_information(Y, np.array([0.1, math.nan, 0.2])), "x must be finite"),
        (lambda: information_null(Y, X, np.random.default_rng(0), permutations=0), "permutations must be"),
        (lambda: best_pair(Y, X), "factors must be numbers in 2 dimensions"),
        (
            lambda: best_pair(Y, X[:, None]),
            r"factors must have 3 rows, as y, and at least 2 columns, not shape \(3, 1\)",
        ),
    ],
)
def test_bad_input_is_named(call: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()
