"""What measured episodes allow to say: shares, times and paired comparisons, each with its interval.

A failure never looks quick: a time counts only where the goal was reached, and a failure counts as the worst. Assumed
is that episodes are independent draws of a world's starts, and that a pair is one start, met by both sides.

Errors: every function raises ValueError, naming the argument, for arrays that are empty, not of the shape it documents,
unequal in length or not finite, and for anything that is not of the kind or not in the range that its Args give.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

CONFIDENCE = 0.95
RESAMPLES = 9999
ROUNDING = 1e-12  # times that differ by less than this part of the time limit are the same


class Estimate(NamedTuple):
    """A figure between its limits, in the unit of what it measures.

    Attributes:
        value: the estimate.
        low: the lower limit, as the function says that made it.
        high: the upper limit.
        n: the cases or pairs that it rests on.
    """

    value: float
    low: float
    high: float
    n: int


class WinRatio(NamedTuple):
    """How often one side beat the other, pair by pair.

    Attributes:
        wins: pairs that the first side won.
        losses: pairs that it lost.
        ties: the other pairs.
        ratio: wins / losses; n counts all pairs, ties too.
    """

    wins: int
    losses: int
    ties: int
    ratio: Estimate


class Ranking(NamedTuple):
    """What a test over several treatments says, with their average ranks.

    Attributes:
        statistic: Friedman's chi-square, corrected for ties.
        p_value: the probability of one at least as large, if the treatments do not differ.
        mean_ranks: (k,) each treatment's average rank, 1 for the least value, ties sharing theirs.
        n: the blocks.
    """

    statistic: float
    p_value: float
    mean_ranks: tuple[float, ...]
    n: int


def wilson(successes: int, n: int, *, confidence: float = CONFIDENCE) -> Estimate:
    """Return a share with the score interval of Wilson (1927), J. Am. Stat. Assoc. 22:209-212.

    It stays within [0, 1], and says something at 0 and n too. No continuity correction.

    Args:
        successes: how many cases held, 0 to n.
        n: how many cases there were, >= 1.
        confidence: the nominal coverage, in (0, 1).
    """
    if not all(isinstance(count, int | np.integer) for count in (successes, n)):
        raise ValueError(f"successes and n must be whole numbers, not {successes!r} and {n!r}")
    if n < 1 or not 0 <= successes <= n:
        raise ValueError(f"needs n >= 1 and 0 <= successes <= n, not {successes} of {n}")
    z2 = _normal_quantile(confidence) ** 2
    p = successes / n
    centre = p + z2 / (2 * n)
    half = math.sqrt(z2 * (p * (1.0 - p) / n + z2 / (4 * n * n)))
    low = 0.0 if successes == 0 else (centre - half) / (1.0 + z2 / n)
    high = 1.0 if successes == n else (centre + half) / (1.0 + z2 / n)
    return Estimate(p, low, high, int(n))


def share(cases: BoolArray, *, confidence: float = CONFIDENCE) -> Estimate:
    """Return the share of cases that hold, with Wilson's interval.

    Args:
        cases: (n,) booleans, n >= 1.
        confidence: the nominal coverage, in (0, 1).
    """
    held = _booleans("cases", cases)
    return wilson(int(held.sum()), held.size, confidence=confidence)


def newcombe_paired(a: BoolArray, b: BoolArray, *, confidence: float = CONFIDENCE) -> Estimate:
    """Return the difference of two paired shares, a's minus b's.

    The interval is method 10 of Newcombe (1998), "Improved confidence intervals for the difference between binomial
    proportions based on paired data", Stat. Med. 17:2635-2650: Wilson's intervals of the two shares, squared and added
    with the pairs' correlation, whose numerator loses n / 2 where it is positive, but not more than it has. It lies
    within [-1, 1]; without any discordant pair it is symmetric about 0 and still has a width, and where all pairs hold
    on both sides (or on neither) it is 0 -/+ z^2 / (n + z^2), z the normal quantile.

    Args:
        a: (n,) booleans of one side, n >= 1.
        b: (n,) booleans of the other side in the same order.
        confidence: the nominal coverage, in (0, 1).
    """
    a, b = _booleans("a", a), _booleans("b", b)
    n = _paired_length("a", a, "b", b)
    both, only_a, only_b = int((a & b).sum()), int((a & ~b).sum()), int((b & ~a).sum())
    neither = n - both - only_a - only_b
    of_a = wilson(both + only_a, n, confidence=confidence)
    of_b = wilson(both + only_b, n, confidence=confidence)
    margins = (both + only_a) * (only_b + neither) * (both + only_b) * (only_a + neither)
    excess: float = both * neither - only_a * only_b
    if excess > 0:
        excess = max(excess - n / 2, 0.0)
    phi = excess / math.sqrt(margins) if margins else 0.0

    def added(below: float, above: float) -> float:
        """Return the length of the two distances' sum, at the angle that their correlation makes."""
        return math.sqrt(below * below - 2.0 * phi * below * above + above * above)

    difference = (only_a - only_b) / n
    low = difference - added(of_a.value - of_a.low, of_b.high - of_b.value)
    high = difference + added(of_b.value - of_b.low, of_a.high - of_a.value)
    return Estimate(difference, low, high, n)


def restricted_mean(
    times_s: FloatArray, reached: BoolArray, limit_s: float, rng: np.random.Generator, *, confidence: float = CONFIDENCE
) -> Estimate:
    """Return the mean time to the goal up to a limit [s], a failure counting as the limit, whenever it came.

    The restricted mean is that of Royston & Parmar (2013), BMC Med. Res. Methodol. 13:152, for the time to the goal; a
    failed episode is not censored, it never reaches, so no survival curve has to be estimated. The interval is the
    BCa bootstrap's, Efron (1987), J. Am. Stat. Assoc. 82:171-185, too narrow for fewer than some 20 episodes. Where
    all took the same time, it is that time alone: nothing varied, which does not say that nothing can.

    Args:
        times_s: (n,) each episode's time to its outcome, >= 0 [s].
        reached: (n,) booleans, whether the outcome was the goal.
        limit_s: the time limit, > 0 [s].
        rng: draws the resamples.
        confidence: the nominal coverage, in (0, 1).
    """
    restricted_s = _restricted("", times_s, reached, limit_s)
    return _bootstrapped(restricted_s, np.mean, "BCa", ROUNDING * limit_s, rng, confidence)


def restricted_mean_difference(
    times_a_s: FloatArray,
    reached_a: BoolArray,
    times_b_s: FloatArray,
    reached_b: BoolArray,
    limit_s: float,
    rng: np.random.Generator,
    *,
    confidence: float = CONFIDENCE,
) -> Estimate:
    """Return the paired difference of two restricted means, a's minus b's [s]; below 0, a is quicker.

    Pairs are resampled whole, so that what the pairs share cancels. Sources and the interval as in
    ``restricted_mean``.

    Args:
        times_a_s: (n,) one side's times to its outcomes, >= 0 [s].
        reached_a: (n,) booleans, whether its outcomes were the goal.
        times_b_s: (n,) the other side's times in the same order [s].
        reached_b: (n,) its booleans.
        limit_s: the time limit of all, > 0 [s].
        rng: draws the resamples.
        confidence: the nominal coverage, in (0, 1).
    """
    a_s = _restricted("_a", times_a_s, reached_a, limit_s)
    b_s = _restricted("_b", times_b_s, reached_b, limit_s)
    _paired_length("times_a_s", a_s, "times_b_s", b_s)
    return _bootstrapped(a_s - b_s, np.mean, "BCa", ROUNDING * limit_s, rng, confidence)


def win_ratio(
    times_a_s: FloatArray,
    reached_a: BoolArray,
    times_b_s: FloatArray,
    reached_b: BoolArray,
    *,
    tolerance_s: float = 0.0,
    confidence: float = CONFIDENCE,
) -> WinRatio:
    """Return how many pairs a won for each that it lost, a failure being the worst that can happen.

    The matched win ratio of Pocock et al. (2012), Eur. Heart J. 33:176-182: a wins a pair if it reached and b did not,
    or if both reached and a was quicker; two failures tie. As there, the interval is that of p = wins / (wins +
    losses), carried over by p / (1 - p). They take p's normal interval, which is empty at 0 losses and passes 1 before
    that; here it is Wilson's, as Fagerland, Lydersen & Laake (2014), Stat. Med. 33:2850-2875, do for the same ratio of
    discordant pairs. Both agree in large samples. With no loss the ratio and the upper limit are infinite and the
    lower limit is wins / z^2, z the normal quantile; with no win it is the inverse; with neither, the ratio is nan
    between 0 and infinity.

    Args:
        times_a_s: (n,) one side's times to its outcomes, >= 0 [s].
        reached_a: (n,) booleans, whether its outcomes were the goal.
        times_b_s: (n,) the other side's times in the same order [s].
        reached_b: (n,) its booleans.
        tolerance_s: two arrivals that lie at most this far apart tie, >= 0 [s].
        confidence: the nominal coverage, in (0, 1).
    """
    a_s, a = _times("_a", times_a_s, reached_a)
    b_s, b = _times("_b", times_b_s, reached_b)
    n = _paired_length("times_a_s", a_s, "times_b_s", b_s)
    if not 0.0 <= tolerance_s < math.inf:
        raise ValueError(f"tolerance_s must be finite and not negative, not {tolerance_s}")
    wins = int((a & (~b | (b_s - a_s > tolerance_s))).sum())
    losses = int((b & (~a | (a_s - b_s > tolerance_s))).sum())
    if wins + losses == 0:
        _normal_quantile(confidence)  # refuses a bad confidence, though nothing is left to estimate
        return WinRatio(0, 0, n, Estimate(math.nan, 0.0, math.inf, n))
    won = wilson(wins, wins + losses, confidence=confidence)
    lost = wilson(losses, wins + losses, confidence=confidence)  # 1 - won, without its rounding near 1
    ratio = Estimate(_over(wins, losses), _over(won.low, lost.high), _over(won.high, lost.low), n)
    return WinRatio(wins, losses, n - wins - losses, ratio)


def median_and_range(values: FloatArray) -> Estimate:
    """Return the median between the least and the greatest value; low and high are those, not confidence limits.

    Args:
        values: (n,) finite numbers, n >= 1.
    """
    x = _numbers("values", values)
    return Estimate(float(np.median(x)), float(x.min()), float(x.max()), x.size)


def bootstrap_median(values: FloatArray, rng: np.random.Generator, *, confidence: float = CONFIDENCE) -> Estimate:
    """Return the median with its percentile bootstrap interval.

    Percentile, not BCa: BCa's acceleration comes from the jackknife, which fails for the median (Efron & Tibshirani
    (1993), An Introduction to the Bootstrap, sections 11.6 and 13.3). Where all values are equal, it is that value.

    Args:
        values: (n,) finite numbers, n >= 1.
        rng: draws the resamples.
        confidence: the nominal coverage, in (0, 1).
    """
    return _bootstrapped(_numbers("values", values), np.median, "percentile", 0.0, rng, confidence)


def friedman(table: FloatArray) -> Ranking:
    """Return the test of several treatments over the same blocks, Friedman (1937), J. Am. Stat. Assoc. 32:675-701.

    The p-value is chi-square's with k - 1 degrees of freedom, which wants many blocks: Demsar (2006), J. Mach. Learn.
    Res. 7:1-30, asks for n > 10 and k > 5. Where each block's values are all equal, p is 1.

    Args:
        table: (n, k) finite numbers: a row for each block (a world, a start), a column for each treatment (a
            controller), n >= 2, k >= 3.
    """
    shape = np.shape(table)
    if len(shape) != 2 or shape[0] < 2 or shape[1] < 3:
        raise ValueError(f"table must have at least 2 rows of blocks and 3 columns of treatments, not shape {shape}")
    x = _numbers("table", np.ravel(table)).reshape(shape)
    from scipy.stats import friedmanchisquare, rankdata

    mean_ranks = tuple(float(rank) for rank in rankdata(x, axis=1).mean(axis=0))
    if (x == x[:, :1]).all():
        return Ranking(0.0, 1.0, mean_ranks, len(x))
    result = friedmanchisquare(*x.T)
    return Ranking(float(result.statistic), float(result.pvalue), mean_ranks, len(x))


def _bootstrapped(
    values: FloatArray, mean: Callable[..., Any], method: str, slack: float, rng: np.random.Generator, confidence: float
) -> Estimate:
    """Return a mean (or median) with its bootstrap interval, that alone where values differ by the slack at most."""
    _normal_quantile(confidence)
    if np.ptp(values) <= slack:
        value = float(values[0])  # their mean might be off by a bit
        return Estimate(value, value, value, values.size)
    from scipy.stats import bootstrap

    limits = bootstrap(
        (values,),
        mean,
        vectorized=True,
        n_resamples=RESAMPLES,
        batch=max(1, 2_000_000 // values.size),  # some 50 MB
        confidence_level=confidence,
        method=method,
        random_state=rng,
    ).confidence_interval
    return Estimate(float(mean(values)), float(limits.low), float(limits.high), values.size)


def _normal_quantile(confidence: float) -> float:
    """Return the z that a normal variable stays within -z and z with this probability."""
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence must lie in (0, 1), not {confidence}")
    from scipy.special import ndtri

    return float(ndtri(0.5 + 0.5 * confidence))


def _over(wins: float, losses: float) -> float:
    """Return wins / losses, infinite where there are no losses."""
    return wins / losses if losses > 0 else math.inf


def _restricted(side: str, times_s: FloatArray, reached: BoolArray, limit_s: float) -> FloatArray:
    """Return each episode's time up to the limit, failures at the limit [s]."""
    times_s, reached = _times(side, times_s, reached)
    if not 0.0 < limit_s < math.inf:
        raise ValueError(f"limit_s must be finite and above 0, not {limit_s}")
    return np.where(reached, np.minimum(times_s, limit_s), limit_s)


def _times(side: str, times_s: FloatArray, reached: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Return one side's checked times [s] and outcomes."""
    times, outcomes = _numbers(f"times{side}_s", times_s), _booleans(f"reached{side}", reached)
    _paired_length(f"times{side}_s", times, f"reached{side}", outcomes)
    if times.min() < 0.0:
        raise ValueError(f"times{side}_s must not be negative, as {times.min()} is")
    return times, outcomes


def _numbers(name: str, values: FloatArray) -> FloatArray:
    """Return a checked one-dimensional array of finite numbers."""
    array = np.asarray(values)
    if array.ndim != 1 or array.size == 0 or array.dtype.kind not in "iuf":
        raise ValueError(f"{name} must be one-dimensional numbers, at least one, not {array.dtype} of {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    return array.astype(np.float64)


def _booleans(name: str, values: BoolArray) -> BoolArray:
    """Return a checked one-dimensional array of booleans."""
    array = np.asarray(values)
    if array.ndim != 1 or array.size == 0 or array.dtype != np.bool_:
        raise ValueError(f"{name} must be one-dimensional booleans, at least one, not {array.dtype} of {array.shape}")
    return array


def _paired_length(first: str, x: FloatArray | BoolArray, second: str, y: FloatArray | BoolArray) -> int:
    """Return the length that two arrays share."""
    if x.size != y.size:
        raise ValueError(f"{first} and {second} must be equally long, not {x.size} and {y.size}")
    return x.size
