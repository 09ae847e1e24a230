import itertools
import math
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from navbench.mathematics import statistics
from navbench.mathematics.statistics import (
    CONFIDENCE,
    PAIRS_MIN,
    Estimate,
    clopper_pearson,
    friedman,
    median,
    median_and_range,
    newcombe_paired,
    restricted_mean,
    restricted_mean_difference,
    share,
    win_ratio,
)

pytestmark = pytest.mark.filterwarnings("error")

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

Z = 1.959964  # the normal quantile of 95%
LIMIT_S = 60.0


def seeded() -> np.random.Generator:
    return np.random.default_rng(7)


def pairs(both: int, only_a: int, only_b: int, neither: int) -> tuple[Bools, Bools]:
    """Return the outcomes of two sides that make these counts."""
    a = np.repeat([True, True, False, False], [both, only_a, only_b, neither])
    b = np.repeat([True, False, True, False], [both, only_a, only_b, neither])
    return a, b


def duel(wins: int, losses: int, ties: int = 0) -> tuple[Floats, Bools, Floats, Bools]:
    """Return the times and outcomes of two sides that both always reach, with these wins of the first."""
    a_s = np.repeat([10.0, 20.0, 15.0], [wins, losses, ties])
    b_s = np.repeat([20.0, 10.0, 15.0], [wins, losses, ties])
    reached = np.ones(wins + losses + ties, dtype=bool)
    return a_s, reached, b_s, reached


def episodes(rng: np.random.Generator, n: int) -> tuple[Floats, Bools]:
    """Return skewed times, of which one in seven is a failure, often early."""
    return rng.gamma(6.0, 3.0, n) + 5.0, rng.random(n) < 0.85


def wilson(successes: int, n: int, *, confidence: float) -> Estimate:
    low, high = stats.binomtest(successes, n).proportion_ci(confidence, method="wilson")
    return Estimate(successes / n, low, high, n)


def limits(interval: Estimate) -> tuple[float, float]:
    return interval.low, interval.high


# Shares


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [(81, 263, 0.2527, 0.3676), (15, 148, 0.0578, 0.1617), (0, 20, 0.0, 0.1684), (1, 29, 0.0009, 0.1776)],
)
def test_a_share_has_the_exact_limits_printed_by_newcombe(successes: int, n: int, low: float, high: float) -> None:
    """Newcombe (1998), Stat. Med. 17:857-872, Table I, method 5."""
    assert limits(clopper_pearson(successes, n)) == pytest.approx((low, high), abs=5e-5)


@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.99])
def test_a_share_agrees_with_scipy_at_every_count(confidence: float) -> None:
    for n in (1, 2, 13, 200):
        for successes in range(n + 1):
            theirs = stats.binomtest(successes, n).proportion_ci(confidence, method="exact")
            ours = clopper_pearson(successes, n, confidence=confidence)
            assert ours == pytest.approx((successes / n, theirs.low, theirs.high, n), abs=1e-12)


def test_a_share_at_the_ends_is_exactly_0_and_1_and_obeys_the_rule_of_three() -> None:
    for n in (1, 20, 200):
        none, all_ = clopper_pearson(0, n), clopper_pearson(n, n)
        assert (none.low, all_.high) == (0.0, 1.0)
        assert none.high == pytest.approx(1.0 - 0.025 ** (1.0 / n))
        assert all_.low == pytest.approx(0.025 ** (1.0 / n))


def test_counting_failures_mirrors_a_share() -> None:
    for successes in range(38):
        won, lost = clopper_pearson(successes, 37), clopper_pearson(37 - successes, 37)
        assert limits(won) == pytest.approx((1.0 - lost.high, 1.0 - lost.low), abs=1e-15)


@pytest.mark.parametrize("truth", [0.001, 0.01, 0.05, 0.5, 0.9])
def test_a_share_covers_the_truth_at_least_as_often_as_it_says(truth: float) -> None:
    """Exactly: each count's probability, summed over the counts whose interval holds the truth."""
    for n in (2, 30, 200):
        covered = [k for k in range(n + 1) if clopper_pearson(k, n).low <= truth <= clopper_pearson(k, n).high]
        assert CONFIDENCE <= stats.binom.pmf(covered, n, truth).sum()


def test_more_confidence_makes_a_wider_interval() -> None:
    widths = [
        high - low for low, high in (limits(clopper_pearson(7, 20, confidence=c)) for c in (0.5, 0.9, 0.95, 0.999))
    ]
    assert widths == sorted(widths)
    assert widths[0] < widths[-1]


def test_a_share_counts_the_cases_that_hold() -> None:
    assert share(np.array([True, False, True, True])) == clopper_pearson(3, 4)
    assert share(np.array([False]), confidence=0.9) == clopper_pearson(0, 1, confidence=0.9)


# Paired shares


@pytest.mark.parametrize(
    ("counts", "low", "high"),
    [
        # Newcombe (1998), Stat. Med. 17:2635-2650, his worked examples, method 10
        ((36, 12, 2, 0), 0.0569, 0.3404),
        ((18, 12, 2, 18), 0.0562, 0.3290),
        ((53, 0, 0, 1), -0.0729, 0.0729),
        ((0, 30, 0, 0), 0.8395, 1.0),
        # Fagerland, Lydersen & Laake (2014), Stat. Med. 33:2850-2875, and their package contingencytables
        ((1, 1, 7, 12), -0.5069, -0.0256),
        ((59, 6, 16, 80), -0.1186, -0.0046),
    ],
)
def test_newcombe_gives_the_printed_limits_from_wilsons(
    counts: tuple[int, int, int, int], low: float, high: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(statistics, "clopper_pearson", wilson)
    n = sum(counts)
    assert newcombe_paired(*pairs(*counts)) == pytest.approx(((counts[1] - counts[2]) / n, low, high, n), abs=6e-5)


def test_swapping_the_sides_negates_newcombe() -> None:
    for counts in itertools.product((0, 1, 4), repeat=4):
        if sum(counts):
            a, b = pairs(*counts)
            forth, back = newcombe_paired(a, b), newcombe_paired(b, a)
            assert back == pytest.approx((-forth.value, -forth.high, -forth.low, forth.n), abs=1e-15)


def test_newcombe_stays_within_minus_1_and_1_around_its_value() -> None:
    for counts in itertools.product((0, 1, 5, 20), repeat=4):
        if sum(counts):
            interval = newcombe_paired(*pairs(*counts))
            assert -1.0 - 1e-12 <= interval.low <= interval.value <= interval.high <= 1.0 + 1e-12


@pytest.mark.parametrize("counts", [(200, 0, 0, 0), (0, 0, 0, 200)])
def test_where_no_pair_ever_differs_newcombe_is_the_width_that_one_share_has(
    counts: tuple[int, int, int, int],
) -> None:
    half = clopper_pearson(0, 200).high
    assert newcombe_paired(*pairs(*counts)) == pytest.approx((0.0, -half, half, 200), abs=1e-7)


def test_without_discordant_pairs_newcombe_is_symmetric_and_narrower_than_unpaired() -> None:
    interval = newcombe_paired(*pairs(30, 0, 0, 30))
    of_each = clopper_pearson(30, 60)
    unpaired = math.hypot(of_each.value - of_each.low, of_each.high - of_each.value)
    assert interval.high == -interval.low
    assert 0.0 < interval.high < 0.5 * unpaired


def test_a_weak_positive_correlation_counts_as_none_in_newcombe() -> None:
    a, b = pairs(6, 4, 4, 6)  # 6 * 6 - 4 * 4 = 20 exceeds n / 2 = 10; 5 * 5 - 5 * 4 = 5 does not exceed 9.5
    weak = newcombe_paired(*pairs(5, 5, 4, 5))
    of_a, of_b = clopper_pearson(10, 19), clopper_pearson(9, 19)
    assert weak.high - weak.value == pytest.approx(math.hypot(of_a.high - of_a.value, of_b.value - of_b.low))
    strong, of_each = newcombe_paired(a, b), clopper_pearson(10, 20)
    side = of_each.high - of_each.value
    assert strong.high == pytest.approx(side * math.sqrt(2.0 - 2.0 * (20 - 10) / 100))


def test_a_perfect_negative_correlation_adds_both_widths_in_newcombe() -> None:
    interval = newcombe_paired(*pairs(0, 29, 1, 0))
    of_a, of_b = clopper_pearson(29, 30), clopper_pearson(1, 30)
    assert limits(interval) == pytest.approx((of_a.low - of_b.high, of_a.high - of_b.low))


@pytest.mark.parametrize("chances", [(0.6, 0.2, 0.1, 0.1), (0.97, 0.02, 0.0, 0.01), (0.3, 0.4, 0.2, 0.1)])
def test_newcombe_covers_the_truth_about_as_often_as_it_says(chances: tuple[float, ...]) -> None:
    rng, truth, hits, draws = seeded(), chances[1] - chances[2], 0, 3000
    for counts in rng.multinomial(60, chances, size=draws).tolist():
        interval = newcombe_paired(*pairs(*counts))
        hits += interval.low <= truth <= interval.high
    assert 0.94 <= hits / draws


# Times


def test_a_failure_counts_as_the_time_limit_and_so_does_whatever_comes_after_it() -> None:
    times_s = np.array([10.0, 20.0, 2.0, 70.0])
    reached = np.array([True, True, False, True])
    assert restricted_mean(times_s, reached, LIMIT_S).value == 37.5


def test_when_a_failure_came_changes_nothing() -> None:
    times_s, reached = episodes(seeded(), 50)
    assert not reached.all()
    early = np.where(reached, times_s, 0.0)
    assert restricted_mean(early, reached, LIMIT_S) == restricted_mean(times_s, reached, LIMIT_S)
    other_s, other = episodes(np.random.default_rng(8), 50)
    assert win_ratio(early, reached, other_s, other) == win_ratio(times_s, reached, other_s, other)


def test_the_restricted_mean_joins_the_intervals_of_the_failures_and_of_the_times() -> None:
    """Zou & Donner (2008), their equation for a sum, at m + p (limit - m)."""
    times_s, reached = np.array([11.0, 12.0, 16.0, 21.0, 3.0]), np.array([True] * 4 + [False])
    m, p, half = 15.0, 0.2, stats.t.ppf(0.975, 3) * np.std([11.0, 12.0, 16.0, 21.0], ddof=1) / 2.0
    low, high = stats.binomtest(1, 5).proportion_ci(method="exact")
    value = m + p * (LIMIT_S - m)
    below = math.hypot(0.8 * half, (LIMIT_S - m) * (p - low))
    above = math.hypot(0.8 * half, (LIMIT_S - m) * (high - p))
    assert restricted_mean(times_s, reached, LIMIT_S) == pytest.approx((value, value - below, value + above, 5))


@pytest.mark.parametrize("n", [5, 30, 200])
def test_failures_that_were_not_seen_raise_the_upper_limit_by_the_rule_of_three(n: int) -> None:
    interval = restricted_mean(np.full(n, 10.0), np.ones(n, dtype=bool), LIMIT_S)
    assert interval == pytest.approx((10.0, 10.0, 10.0 + (1.0 - 0.025 ** (1.0 / n)) * 50.0, n))


@pytest.mark.parametrize("failing", [0.003, 0.01, 0.3])
def test_the_restricted_mean_covers_the_truth_with_rare_failures_too(failing: float) -> None:
    rng, hits, draws, n = seeded(), 0, 2000, 20
    truth = (1.0 - failing) * 12.0 + failing * LIMIT_S
    for _ in range(draws):
        interval = restricted_mean(rng.normal(12.0, 0.1, n), rng.random(n) >= failing, LIMIT_S)
        hits += interval.low <= truth <= interval.high
    assert 0.945 <= hits / draws


@pytest.mark.parametrize("failing", [0.01, 0.2])
def test_the_paired_difference_covers_the_truth_with_rare_failures_too(failing: float) -> None:
    rng, hits, draws, n = seeded(), 0, 2000, PAIRS_MIN
    truth = (1.0 - failing) * 13.0 + failing * LIMIT_S - 12.0
    for _ in range(draws):
        start_s = rng.normal(12.0, 2.0, n)
        a_s, a, b = start_s + rng.normal(1.0, 0.1, n), rng.random(n) >= failing, np.ones(n, dtype=bool)
        interval = restricted_mean_difference(a_s, a, start_s, b, LIMIT_S)
        hits += interval.low <= truth <= interval.high
    assert 0.945 <= hits / draws


def test_the_correlation_of_pairs_counts_as_it_does_for_shares() -> None:
    (a_s, a), (b_s, b) = episodes(seeded(), 40), episodes(np.random.default_rng(8), 40)
    b_s = 0.5 * (a_s + b_s)
    of_a, of_b = restricted_mean(a_s, a, LIMIT_S), restricted_mean(b_s, b, LIMIT_S)
    rho = np.corrcoef(np.where(a, a_s, LIMIT_S), np.where(b, b_s, LIMIT_S))[0, 1]
    below, above = of_a.value - of_a.low, of_b.high - of_b.value
    interval = restricted_mean_difference(a_s, a, b_s, b, LIMIT_S)
    assert interval.value - interval.low == pytest.approx(math.sqrt(below**2 - 2.0 * rho * below * above + above**2))


def test_too_few_episodes_have_no_interval() -> None:
    for n in (PAIRS_MIN - 1, PAIRS_MIN):
        (a_s, a), (b_s, b) = episodes(seeded(), n), episodes(np.random.default_rng(8), n)
        assert math.isnan(restricted_mean_difference(a_s, a, b_s, b, LIMIT_S).low) == (n < PAIRS_MIN)
    for n, is_told in ((1, False), (2, True)):
        interval = restricted_mean(np.arange(1.0, n + 1.0), np.ones(n, dtype=bool), LIMIT_S)
        assert [math.isfinite(end) for end in limits(interval)] == [is_told] * 2


def test_other_units_of_time_change_the_restricted_mean_alone() -> None:
    times_s, reached = episodes(seeded(), 30)
    once = restricted_mean(times_s, reached, LIMIT_S)
    twice = restricted_mean(2.0 * times_s, reached, 2.0 * LIMIT_S)
    assert twice == pytest.approx((2.0 * once.value, 2.0 * once.low, 2.0 * once.high, 30))


def test_of_none_that_reached_the_interval_says_how_many_might() -> None:
    interval = restricted_mean(np.full(7, 12.3), np.zeros(7, dtype=bool), LIMIT_S)
    assert interval == pytest.approx((LIMIT_S, 0.025 ** (1.0 / 7.0) * LIMIT_S, LIMIT_S, 7))


def test_the_interval_stays_between_0_and_the_limit() -> None:
    times_s = np.array([0.1, 59.0])
    assert limits(restricted_mean(times_s, np.ones(2, dtype=bool), LIMIT_S)) == (0.0, LIMIT_S)


def test_the_paired_difference_is_the_difference_of_the_restricted_means() -> None:
    a_s, b_s = np.array([10.0, 20.0, 5.0]), np.array([12.0, 30.0, 40.0])
    a, b = np.array([True, True, False]), np.array([True, True, True])
    assert restricted_mean_difference(a_s, a, b_s, b, LIMIT_S).value == pytest.approx((-2 - 10 + 20) / 3)


def test_the_paired_difference_sees_what_hard_and_easy_starts_hide() -> None:
    rng = seeded()
    start_s = rng.uniform(10.0, 50.0, 200)
    a_s, b_s, reached = start_s + rng.normal(0.0, 0.3, 200), start_s + 1.5, np.ones(200, dtype=bool)
    paired = restricted_mean_difference(a_s, reached, b_s, reached, LIMIT_S)
    shuffled = restricted_mean_difference(a_s, reached, rng.permutation(b_s), reached, LIMIT_S)
    assert paired.high < 0.0
    assert shuffled.low < 0.0 < shuffled.high


def test_swapping_the_sides_negates_the_paired_difference() -> None:
    rng = seeded()
    (a_s, a), (b_s, b) = episodes(rng, 30), episodes(rng, 30)
    forth = restricted_mean_difference(a_s, a, b_s, b, LIMIT_S)
    back = restricted_mean_difference(b_s, b, a_s, a, LIMIT_S)
    assert back == pytest.approx((-forth.value, -forth.high, -forth.low, 30))


# Win ratio


def test_a_pair_is_won_by_who_reached_alone_or_first() -> None:
    a_s = np.array([50.0, 1.0, 10.0, 30.0, 20.0, 5.0, 11.0])
    a = np.array([True, False, True, True, True, False, True])
    b_s = np.array([1.0, 50.0, 20.0, 25.0, 20.0, 60.0, 12.0])
    b = np.array([False, True, True, True, True, False, True])
    # won alone, lost alone, won first, lost second, tied at once, tied by failing, won first
    result = win_ratio(a_s, a, b_s, b)
    assert (result.wins, result.losses, result.ties) == (3, 2, 2)
    assert (result.ratio.value, result.ratio.n) == (1.5, 7)


def test_arrivals_within_the_tolerance_tie_and_failures_never_profit_from_it() -> None:
    a_s, b_s = np.array([10.0, 10.0, 10.0, 10.0]), np.array([10.5, 10.75, 9.25, 10.1])
    a, b = np.ones(4, dtype=bool), np.array([True, True, True, False])
    assert win_ratio(a_s, a, b_s, b)[:3] == (3, 1, 0)
    assert win_ratio(a_s, a, b_s, b, tolerance_s=0.5)[:3] == (2, 1, 1)
    assert win_ratio(a_s, a, b_s, b, tolerance_s=0.75)[:3] == (1, 0, 3)


def test_the_win_ratio_has_the_exact_limits_of_the_share_of_wins() -> None:
    low, high = stats.binomtest(6, 22).proportion_ci(method="exact")
    assert limits(win_ratio(*duel(6, 16)).ratio) == pytest.approx((low / (1.0 - low), high / (1.0 - high)))


def test_for_many_pairs_the_win_ratio_has_the_limits_of_pocock() -> None:
    """p = wins / (wins + losses) -/+ z * sqrt(p * (1 - p) / (wins + losses)), both carried over by p / (1 - p)."""
    p, half = 0.6, Z * math.sqrt(0.6 * 0.4 / 2000)
    expected = (1.5, (p - half) / (1 - p + half), (p + half) / (1 - p - half), 2000)
    assert win_ratio(*duel(1200, 800)).ratio == pytest.approx(expected, rel=2e-3)


def test_ties_leave_the_win_ratio_alone() -> None:
    assert win_ratio(*duel(12, 5, 40)).ratio[:3] == win_ratio(*duel(12, 5)).ratio[:3]


def test_swapping_the_sides_inverts_the_win_ratio() -> None:
    for wins, losses in [(12, 5), (1, 30), (7, 7), (0, 9)]:
        a_s, a, b_s, b = duel(wins, losses, 3)
        forth, back = win_ratio(a_s, a, b_s, b), win_ratio(b_s, b, a_s, a)
        assert (back.wins, back.losses, back.ties) == (losses, wins, 3)
        assert back.ratio.value * forth.ratio.value == pytest.approx(1.0) or {wins, losses} == {0, 9}
        assert back.ratio.low == pytest.approx(1.0 / forth.ratio.high)
        assert forth.ratio.low == (pytest.approx(1.0 / back.ratio.high) if wins else 0.0)


def test_without_a_loss_the_win_ratio_is_infinite_with_a_finite_lower_limit() -> None:
    ratio = win_ratio(*duel(20, 0)).ratio
    assert (ratio.value, ratio.high) == (math.inf, math.inf)
    assert ratio.low == pytest.approx(1.0 / (0.025**-0.05 - 1.0))


def test_each_further_loss_lowers_both_limits_of_the_win_ratio() -> None:
    ratios = [win_ratio(*duel(20, losses)).ratio for losses in range(6)]
    assert all(after.low < before.low and after.value < before.value for before, after in itertools.pairwise(ratios))
    assert all(after.high < before.high for before, after in itertools.pairwise(ratios))


def test_without_a_win_the_win_ratio_is_0_with_an_upper_limit() -> None:
    ratio = win_ratio(*duel(0, 20)).ratio
    assert (ratio.value, ratio.low) == (0.0, 0.0)
    assert ratio.high == pytest.approx(0.025**-0.05 - 1.0)


def test_where_all_pairs_tie_the_win_ratio_says_nothing() -> None:
    result = win_ratio(*duel(0, 0, 5))
    assert (result.wins, result.losses, result.ties) == (0, 0, 5)
    assert math.isnan(result.ratio.value)
    assert limits(result.ratio) == (0.0, math.inf)


# Medians


def test_the_median_stands_between_the_least_and_the_greatest() -> None:
    assert median_and_range(np.array([4.0, 1.0, 9.0, 2.0])) == (3.0, 1.0, 9.0, 4)
    assert median_and_range(np.array([5.0])) == (5.0, 5.0, 5.0, 1)


@pytest.mark.parametrize(("n", "kth"), [(6, 1), (8, 1), (9, 2), (20, 6), (50, 18), (100, 40)])
def test_the_median_has_the_limits_of_the_sign_test(n: int, kth: int) -> None:
    """Conover (1999), Practical Nonparametric Statistics, tables of the binomial distribution at p = 1/2."""
    values = np.sort(seeded().gamma(2.0, 3.0, n))
    assert median(seeded().permutation(values)) == (np.median(values), values[kth - 1], values[n - kth], n)


def test_fewer_than_six_values_have_no_interval_of_their_median() -> None:
    assert all(math.isnan(end) for n in range(1, 6) for end in limits(median(np.arange(float(n)))))


# Tests of no difference


ROUNDING_FIRST_BASE_S = """
    5.40 5.50 5.55  5.85 5.70 5.75  5.20 5.60 5.50  5.55 5.50 5.40  5.90 5.85 5.70  5.45 5.55 5.60  5.40 5.40 5.35
    5.45 5.50 5.35  5.25 5.15 5.00  5.85 5.80 5.70  5.25 5.20 5.10  5.65 5.55 5.45  5.60 5.35 5.45  5.05 5.00 4.95
    5.50 5.50 5.40  5.45 5.55 5.50  5.55 5.55 5.35  5.45 5.50 5.55  5.50 5.45 5.25  5.65 5.60 5.40  5.70 5.65 5.55
    6.30 6.30 6.25
"""

DEMSAR_RANKS = """
    4 3 2 1      1 2 3 4    4 1 2 3      4 1 3 2    4 2 3 1      1 2.5 4 2.5          3 2 4 1
    2.5 2.5 4 1  4 3 2 1    2.5 2.5 2.5 2.5         4 2.5 1 2.5  3 2 4 1    4 1 2 3   3 1 4 2
"""


def test_friedman_gives_what_hollander_and_wolfe_print() -> None:
    """Hollander & Wolfe (1973), Nonparametric Statistical Methods, p. 140 ff.; R's example of friedman.test."""
    result = friedman(np.array(ROUNDING_FIRST_BASE_S.split(), dtype=float).reshape(22, 3))
    assert result.statistic == pytest.approx(11.143, abs=5e-4)
    assert result.p_value == pytest.approx(0.003805, abs=5e-7)
    assert result.mean_ranks == pytest.approx((53 / 22, 47 / 22, 32 / 22))
    assert result.n == 22


def test_friedman_gives_the_average_ranks_of_demsar() -> None:
    """Demsar (2006), Table 6; his 9.28 is not corrected for the ties of four data sets, 78 of 14 * (4^3 - 4)."""
    result = friedman(np.array(DEMSAR_RANKS.split(), dtype=float).reshape(14, 4))
    assert result.mean_ranks == pytest.approx((3.143, 2.000, 2.893, 1.964), abs=5e-4)
    assert result.statistic * (1.0 - 78 / 840) == pytest.approx(9.28, abs=5e-3)


def test_friedman_follows_the_order_of_the_treatments() -> None:
    table = seeded().normal(0.0, 1.0, (12, 4)) + np.arange(4.0)
    order = [2, 0, 3, 1]
    there, here = friedman(table), friedman(table[:, order])
    assert here.mean_ranks == tuple(there.mean_ranks[i] for i in order)
    assert here.statistic == pytest.approx(there.statistic)
    assert there.mean_ranks == tuple(sorted(there.mean_ranks))


def test_treatments_that_never_differ_have_p_1_and_share_their_rank() -> None:
    table = np.repeat([[1.0], [7.0], [3.0]], 4, axis=1)
    assert friedman(table) == (0.0, 1.0, (2.5, 2.5, 2.5, 2.5), 3)


# What is refused

YES = np.array([True, False, True])
THREE = np.array([1.0, 2.0, 3.0])
NAN = np.array([1.0, np.nan, 3.0])
NEGATIVE = np.array([1.0, -2.0, 3.0])
NONE = np.array([])
DUEL = duel(7, 4)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: clopper_pearson(1, 0), "n >= 1"),
        (lambda: clopper_pearson(-1, 5), "0 <= successes"),
        (lambda: clopper_pearson(6, 5), "successes <= n"),
        (lambda: clopper_pearson(2.5, 5), "whole numbers"),  # type: ignore[arg-type]
        (lambda: share(np.array([], dtype=bool)), "cases .* at least one"),
        (lambda: share(np.array([1, 0])), "cases .* booleans"),
        (lambda: share(YES.reshape(3, 1)), "cases .* one-dimensional"),
        (lambda: newcombe_paired(YES, YES[:2]), "a and b must be equally long, not 3 and 2"),
        (lambda: newcombe_paired(YES, THREE), "b must be .* booleans"),
        (lambda: restricted_mean(NONE, YES[:0], 9.0), "times_s .* at least one"),
        (lambda: restricted_mean(NAN, YES, 9.0), "times_s must be finite"),
        (lambda: restricted_mean(NEGATIVE, YES, 9.0), "times_s must not be negative"),
        (lambda: restricted_mean(THREE, YES[:2], 9.0), "times_s and reached must be equally long"),
        (lambda: restricted_mean(THREE, YES, 0.0), "limit_s must be finite and above 0"),
        (lambda: restricted_mean(THREE, YES, math.nan), "limit_s must be finite and above 0"),
        (lambda: restricted_mean(THREE, YES, math.inf), "limit_s must be finite and above 0"),
        (lambda: restricted_mean_difference(THREE, YES, THREE[:2], YES[:2], 9.0), "times_a_s and times_b_s"),
        (lambda: restricted_mean_difference(THREE, YES, NAN, YES, 9.0), "times_b_s must be finite"),
        (lambda: win_ratio(THREE, YES, THREE[:2], YES[:2]), "times_a_s and times_b_s"),
        (lambda: win_ratio(THREE, YES, THREE, YES[:2]), "times_b_s and reached_b"),
        (lambda: win_ratio(THREE, YES, THREE, YES, tolerance_s=-0.1), "tolerance_s"),
        (lambda: median_and_range(NONE), "values .* at least one"),
        (lambda: median_and_range(NAN), "values must be finite"),
        (lambda: median_and_range(YES), "values must be one-dimensional numbers"),
        (lambda: median(NONE), "values .* at least one"),
        (lambda: friedman(THREE), r"not shape \(3,\)"),
        (lambda: friedman(np.ones((1, 3))), "at least 2 rows"),
        (lambda: friedman(np.ones((5, 2))), "3 columns"),
        (lambda: friedman(np.array([THREE, NAN])), "table must be finite"),
    ],
)
def test_bad_data_are_refused_by_name(call: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("confidence", [0.0, 1.0, 95.0, -0.5, math.nan])
@pytest.mark.parametrize(
    "measure",
    [
        lambda c: clopper_pearson(1, 3, confidence=c),
        lambda c: share(YES, confidence=c),
        lambda c: newcombe_paired(YES, ~YES, confidence=c),
        lambda c: restricted_mean(THREE, YES, 9.0, confidence=c),
        lambda c: restricted_mean(THREE, ~YES & YES, 9.0, confidence=c),
        lambda c: restricted_mean_difference(THREE, YES, THREE, ~YES, 9.0, confidence=c),
        lambda c: win_ratio(THREE, YES, THREE, ~YES, confidence=c),
        lambda c: win_ratio(THREE, YES, THREE, YES, confidence=c),
        lambda c: median(THREE, confidence=c),
    ],
)
def test_a_confidence_outside_0_and_1_is_refused(measure: Callable[[float], object], confidence: float) -> None:
    with pytest.raises(ValueError, match="confidence must lie in"):
        measure(confidence)


@pytest.mark.parametrize(
    "measure",
    [
        lambda c: share(YES, confidence=c),
        lambda c: newcombe_paired(YES, ~YES, confidence=c),
        lambda c: restricted_mean(THREE, YES, 9.0, confidence=c),
        lambda c: restricted_mean_difference(*DUEL[:4], 30.0, confidence=c),
        lambda c: win_ratio(THREE, YES, THREE, ~YES, confidence=c).ratio,
        lambda c: median(np.arange(20.0), confidence=c),
    ],
)
def test_the_confidence_asked_for_reaches_the_interval(measure: Callable[[float], Estimate]) -> None:
    half, most = measure(0.5), measure(0.95)
    assert most.low < half.low < half.high < most.high
    assert half.value == most.value


def test_importing_the_module_costs_no_scipy_stats() -> None:
    code = (
        "import sys, navbench.mathematics.statistics; sys.exit('scipy.stats' in sys.modules or 'pandas' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
