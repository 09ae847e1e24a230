"""What measured episodes allow to say: shares, times and paired comparisons, each with its interval.

A failure never looks quick: a time counts only where the goal was reached, and a failure counts as the worst. Assumed
is that episodes are independent draws of a world's starts, and that a pair is one start, met by both sides.

How often each interval holds the truth, by the number of cases, stands in ``benchmarks/README.md``; from the least
number on at which it is told, that is at least 93.5 % of a nominal 95 %, whatever the distribution there. Where there
are fewer cases the limits are nan.

Errors: every function raises ValueError, naming the argument, for arrays that are empty, not of the shape it documents,
unequal in length or not finite, and for anything that is not of the kind or not in the range that its Args give.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

CONFIDENCE = 0.95
PAIRS_MIN = 8  # of which the correlation is known well enough for the interval of a difference of times


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


def clopper_pearson(successes: int, n: int, *, confidence: float = CONFIDENCE) -> Estimate:
    """Return a share with the exact interval of Clopper & Pearson (1934), Biometrika 26:404-413.

    Whatever the true share, it holds that at least as often as it says. Wilson's score interval does so on average over
    shares, but for rare failures, which decide between controllers, it holds a nominal 95 % in 84 % only, whatever n.
    The price is a width that is 10 % more at 50 cases and 5 % more at 200. With no failure in n cases it is the rule of
    three, from two sides: a failure is no likelier than some 3.7 / n.

    Args:
        successes: how many cases held, 0 to n.
        n: how many cases there were, >= 1.
        confidence: the nominal coverage, in (0, 1).
    """
    if not all(isinstance(count, int | np.integer) for count in (successes, n)):
        raise ValueError(f"successes and n must be whole numbers, not {successes!r} and {n!r}")
    if n < 1 or not 0 <= successes <= n:
        raise ValueError(f"needs n >= 1 and 0 <= successes <= n, not {successes} of {n}")
    tail = _tail(confidence)
    from scipy.special import betaincinv

    low = float(betaincinv(successes, n - successes + 1, tail)) if successes else 0.0
    high = 1.0 - float(betaincinv(n - successes, successes + 1, tail)) if successes < n else 1.0
    return Estimate(successes / n, low, high, int(n))


def share(cases: BoolArray, *, confidence: float = CONFIDENCE) -> Estimate:
    """Return the share of cases that hold, with the interval of ``clopper_pearson``.

    Args:
        cases: (n,) booleans, n >= 1.
        confidence: the nominal coverage, in (0, 1).
    """
    held = _booleans("cases", cases)
    return clopper_pearson(int(held.sum()), held.size, confidence=confidence)


def newcombe_paired(a: BoolArray, b: BoolArray, *, confidence: float = CONFIDENCE) -> Estimate:
    """Return the difference of two paired shares, a's minus b's.

    The interval is method 10 of Newcombe (1998), "Improved confidence intervals for the difference between binomial
    proportions based on paired data", Stat. Med. 17:2635-2650: the intervals of the two shares, squared and added
    with the pairs' correlation, whose numerator loses n / 2 where it is positive, but not more than it has. He takes
    Wilson's intervals; with those it holds a nominal 95 % in 50 to 94 % for rare failures, with those of
    ``clopper_pearson``, taken here, in 93.5 % at least. It lies within [-1, 1]; without any discordant pair it is
    symmetric about 0 and still has a width.

    Args:
        a: (n,) booleans of one side, n >= 1.
        b: (n,) booleans of the other side in the same order.
        confidence: the nominal coverage, in (0, 1).
    """
    a, b = _booleans("a", a), _booleans("b", b)
    n = _paired_length("a", a, "b", b)
    both, only_a, only_b = int((a & b).sum()), int((a & ~b).sum()), int((b & ~a).sum())
    neither = n - both - only_a - only_b
    of_a = clopper_pearson(both + only_a, n, confidence=confidence)
    of_b = clopper_pearson(both + only_b, n, confidence=confidence)
    margins = (both + only_a) * (only_b + neither) * (both + only_b) * (only_a + neither)
    excess: float = both * neither - only_a * only_b
    if excess > 0:
        excess = max(excess - n / 2, 0.0)
    return _difference(of_a, of_b, excess / math.sqrt(margins) if margins else 0.0)._replace(
        value=(only_a - only_b) / n
    )


def restricted_mean(
    times_s: FloatArray, reached: BoolArray, limit_s: float, *, confidence: float = CONFIDENCE
) -> Estimate:
    """Return the mean time to the goal up to a limit [s], a failure counting as the limit, whenever it came.

    The restricted mean is that of Royston & Parmar (2013), BMC Med. Res. Methodol. 13:152, for the time to the goal; a
    failed episode is not censored, it never reaches, so no survival curve has to be estimated. With the share p of
    failures and the mean time m of the others it is m + p (limit - m), and its interval is joined from those of p
    (``clopper_pearson``) and m (Student's t) by the method of variance estimates recovery, Zou & Donner (2008), Stat.
    Med. 27:1693-1702. So it reckons with failures that happened not to be seen: were all n episodes quick, its upper
    limit is some 3.7 / n of the way from m to the limit. A bootstrap draws what was seen
    and nothing else. Of fewer than two that reached, m may be anything from 0 to the limit; one episode has no
    interval.

    Args:
        times_s: (n,) each episode's time to its outcome, >= 0 [s].
        reached: (n,) booleans, whether the outcome was the goal.
        limit_s: the time limit, > 0 [s].
        confidence: the nominal coverage, in (0, 1).
    """
    return _restricted_mean(*_restricted("", times_s, reached, limit_s), limit_s, confidence)


def restricted_mean_difference(
    times_a_s: FloatArray,
    reached_a: BoolArray,
    times_b_s: FloatArray,
    reached_b: BoolArray,
    limit_s: float,
    *,
    confidence: float = CONFIDENCE,
) -> Estimate:
    """Return the paired difference of two restricted means, a's minus b's [s]; below 0, a is quicker.

    The interval joins those of ``restricted_mean`` as ``newcombe_paired`` joins those of two shares, with the
    correlation of the pairs' times, failures at the limit: what the pairs share cancels, failures that were not seen do
    not. Of fewer than 8 pairs that correlation is too uncertain, and there is no interval.

    Args:
        times_a_s: (n,) one side's times to its outcomes, >= 0 [s].
        reached_a: (n,) booleans, whether its outcomes were the goal.
        times_b_s: (n,) the other side's times in the same order [s].
        reached_b: (n,) its booleans.
        limit_s: the time limit of all, > 0 [s].
        confidence: the nominal coverage, in (0, 1).
    """
    a_s, a = _restricted("_a", times_a_s, reached_a, limit_s)
    b_s, b = _restricted("_b", times_b_s, reached_b, limit_s)
    n = _paired_length("times_a_s", a_s, "times_b_s", b_s)
    of_a, of_b = _restricted_mean(a_s, a, limit_s, confidence), _restricted_mean(b_s, b, limit_s, confidence)
    if n < PAIRS_MIN:
        return Estimate(of_a.value - of_b.value, math.nan, math.nan, n)
    off_a, off_b = a_s - a_s.mean(), b_s - b_s.mean()
    spread = math.sqrt(float((off_a @ off_a) * (off_b @ off_b)))
    return _difference(of_a, of_b, float(off_a @ off_b) / spread if spread else 0.0)


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
    that; here it is that of ``clopper_pearson``. Both agree in large samples. With no loss the ratio and the upper
    limit are infinite; with no win it is the inverse; with neither, the ratio is nan between 0 and infinity.

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
        _tail(confidence)  # refuses a bad confidence, though nothing is left to estimate
        return WinRatio(0, 0, n, Estimate(math.nan, 0.0, math.inf, n))
    won = clopper_pearson(wins, wins + losses, confidence=confidence)
    lost = clopper_pearson(losses, wins + losses, confidence=confidence)  # 1 - won, exact near 1
    ratio = Estimate(_over(wins, losses), _over(won.low, lost.high), _over(won.high, lost.low), n)
    return WinRatio(wins, losses, n - wins - losses, ratio)


def median_and_range(values: FloatArray) -> Estimate:
    """Return the median between the least and the greatest value; low and high are those, not confidence limits.

    Args:
        values: (n,) finite numbers, n >= 1.
    """
    x = _numbers("values", values)
    return Estimate(float(np.median(x)), float(x.min()), float(x.max()), x.size)


def median(values: FloatArray, *, confidence: float = CONFIDENCE) -> Estimate:
    """Return the median with the exact interval of the sign test, between two of the values.

    Each value lies below the true median with probability 1/2, so that the chance of both limits is binomial, whatever
    the distribution (Conover (1999), Practical Nonparametric Statistics, section 3.2). 95 % need at least 6 cases.

    Args:
        values: (n,) finite numbers, n >= 1.
        confidence: the nominal coverage, in (0, 1).
    """
    x = np.sort(_numbers("values", values))
    from scipy.stats import binom

    cut = int(binom.ppf(_tail(confidence), x.size, 0.5))
    low, high = (float(x[cut - 1]), float(x[-cut])) if cut else (math.nan, math.nan)
    return Estimate(float(np.median(x)), low, high, x.size)


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


def _restricted_mean(times_s: FloatArray, reached: BoolArray, limit_s: float, confidence: float) -> Estimate:
    """Return ``restricted_mean`` of checked times, failures at the limit."""
    n, arrived_s = times_s.size, times_s[reached]
    failed, tail = clopper_pearson(n - arrived_s.size, n, confidence=confidence), _tail(confidence)
    mean, low, high = (float(arrived_s.mean()) if arrived_s.size else 0.0), 0.0, limit_s
    if arrived_s.size > 1:
        from scipy.special import stdtrit

        half = float(stdtrit(arrived_s.size - 1, 1.0 - tail) * arrived_s.std(ddof=1)) / math.sqrt(arrived_s.size)
        low, high = max(low, mean - half), min(high, mean + half)
    p, left = failed.value, limit_s - mean
    value = float(times_s.mean())
    if n == 1:
        return Estimate(value, math.nan, math.nan, n)
    below = math.hypot((1.0 - p) * (mean - low), left * (p - failed.low))
    above = math.hypot((1.0 - p) * (high - mean), left * (failed.high - p))
    return Estimate(value, max(0.0, value - below), min(limit_s, value + above), n)


def _difference(a: Estimate, b: Estimate, correlation: float) -> Estimate:
    """Return a - b, its limits as far away as those of a and b, added at the angle that the correlation makes."""

    def added(x: float, y: float) -> float:
        return math.sqrt(max(0.0, x * x - 2.0 * correlation * x * y + y * y))

    value = a.value - b.value
    below, above = added(a.value - a.low, b.high - b.value), added(a.high - a.value, b.value - b.low)
    return Estimate(value, value - below, value + above, a.n)


def _tail(confidence: float) -> float:
    """Return the probability beyond each of two limits."""
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence must lie in (0, 1), not {confidence}")
    return 0.5 - 0.5 * confidence


def _over(wins: float, losses: float) -> float:
    """Return wins / losses, infinite where there are no losses."""
    return wins / losses if losses > 0 else math.inf


def _restricted(side: str, times_s: FloatArray, reached: BoolArray, limit_s: float) -> tuple[FloatArray, BoolArray]:
    """Return each episode's checked time up to the limit, failures at the limit [s], and which reached."""
    times_s, reached = _times(side, times_s, reached)
    if not 0.0 < limit_s < math.inf:
        raise ValueError(f"limit_s must be finite and above 0, not {limit_s}")
    return np.where(reached, np.minimum(times_s, limit_s), limit_s), reached


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
