"""How often navbench's intervals hold the truth, by the number of cases: ``python -m benchmarks coverage``.

What is simulated was fixed before it was run: the numbers of cases ``CASES``, 10,000 samples of each, and these truths.

- Shares: drawn uniformly, and each of ``SHARES``, of which the least coverage is told. Paired shares: the same, with
  pairs that are independent, half and wholly dependent. Win ratios: from the same shares, without ties and with half.
- Times: normal (30 -/+ 5 s), lognormal (median 20 s, log deviation 0.5), bimodal (one in five takes 60 s, the others
  30 s, -/+ 4 s); of restricted means 0, 1, 10 and 30 % fail, at a time limit of 100 s. In paired differences one side
  takes a tenth longer and fails twice as often; what the two share makes half or nine tenths of their variance.
- Medians: of the same three distributions, and of their paired differences.
- Shares over scrambles: six factors at 64 points, of which one, two or all decide; populations of 2,000 scrambles.

Of each interval and number of cases the mean over its truths is told, and the least. The bar is 93.5 % of a nominal
95 %, from the number of cases on from which the interval is told; the least has to pass it too.
"""

import csv
import math
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import Cell, Effort, Table
from navbench.mathematics.sensitivity import saltelli, share_of_scrambles
from navbench.mathematics.statistics import (
    PAIRS_MIN,
    Estimate,
    clopper_pearson,
    median,
    newcombe_paired,
    restricted_mean,
    restricted_mean_difference,
    win_ratio,
)

FloatArray = NDArray[np.float64]
Rng = np.random.Generator

SEED = 20
CASES = (2, 3, 5, 8, 10, 15, 20, 30, 50, 100, 200)
REPLICATIONS = 10_000
BAR = 0.935
SHARES = (0.5, 0.8, 0.9, 0.95, 0.99, 0.999)
DEPENDENCE = (0.0, 0.5, 1.0)  # of paired outcomes, between independent and as alike as their shares allow
TIMES = ("normal", "lognormal", "bimodal")
FAILING = (0.0, 0.01, 0.1, 0.3)
LIMIT_S = 100.0
LONGER, COMMON = 1.1, (0.5, 0.9)  # of the first side of a pair, and what both share of their variance
POINTS, FACTORS, SCRAMBLES = 64, 6, 2000
DRAWS = 10_000_000  # of a truth that has no closed form
FILES = Path(__file__).with_name("coverage.csv"), Path(__file__).with_name("coverage.png")

Sampled = Iterable[tuple[float, Estimate]]  # truths, and what is told of samples of them
Draw = Callable[[Rng, int, int], Sampled]  # of so many cases, so many samples


class Kind(NamedTuple):
    """One interval: from how many cases on it is told, and how to draw samples from each truth, by its name."""

    least: int
    truths: Mapping[str, Draw]


def counted(counts: NDArray[np.int64], truths: FloatArray | float, tell: Callable[..., Estimate]) -> Sampled:
    """Yield what is told of rows of counts, asked once for rows that are the same."""
    told = cache(lambda row: tell(*row))
    for row, truth in zip(counts.tolist(), np.broadcast_to(truths, len(counts)).tolist(), strict=True):
        yield truth, told(tuple(row))


def of_share(p: float | None, rng: Rng, n: int, samples: int) -> Sampled:
    """Sample a share, the given one or uniformly drawn ones."""
    truth = rng.random(samples) if p is None else np.full(samples, p)
    return counted(rng.binomial(n, truth)[:, None], truth, lambda held: clopper_pearson(held, n))


def chances(a: float, b: float, dependence: float) -> tuple[float, float, float, float]:
    """Return how often both, a alone, b alone and neither hold."""
    both = a * b + dependence * (min(a, b) - a * b)
    return both, a - both, b - both, max(0.0, 1.0 - a - b + both)


def of_pairs(of: tuple[float, ...] | None, rng: Rng, n: int, samples: int) -> Sampled:
    """Sample the difference of two paired shares."""

    def tell(*counts: int) -> Estimate:
        a, b = (np.repeat(np.array(held), counts) for held in ([True, True, False, False], [True, False, True, False]))
        return newcombe_paired(a, b)

    p = rng.dirichlet(np.ones(4), samples) if of is None else np.tile(of, (samples, 1))
    return counted(rng.multinomial(n, p), p[:, 1] - p[:, 2], tell)


def of_wins(p: float | None, ties: float, rng: Rng, n: int, samples: int) -> Sampled:
    """Sample a win ratio; p is the share of wins among the pairs that do not tie."""

    def tell(wins: int, losses: int, ties: int) -> Estimate:
        a_s, b_s = (np.repeat(of, (wins, losses, ties)) for of in ([1.0, 2.0, 1.0], [2.0, 1.0, 1.0]))
        return win_ratio(a_s, np.ones(n, dtype=bool), b_s, np.ones(n, dtype=bool)).ratio

    won = rng.random(samples) if p is None else np.full(samples, p)
    all_ = np.column_stack([(1.0 - ties) * won, (1.0 - ties) * (1.0 - won), np.full(samples, ties)])
    return counted(rng.multinomial(n, all_), won / (1.0 - won), tell)


def times(name: str, rng: Rng, shape: tuple[int, int], common: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Return the times of two sides that share this much of their variance."""
    noise = rng.normal(size=(3, *shape))
    ours, theirs = (math.sqrt(common) * noise[0] + math.sqrt(1.0 - common) * own for own in noise[1:])
    if name == "lognormal":
        return 20.0 * np.exp(0.5 * ours), 20.0 * np.exp(0.5 * theirs)
    if name == "normal":
        return 30.0 + 5.0 * ours, 30.0 + 5.0 * theirs
    late, late_too = either(rng, shape, common)
    return 30.0 + 30.0 * (late < 0.2) + 4.0 * ours, 30.0 + 30.0 * (late_too < 0.2) + 4.0 * theirs


def either(rng: Rng, shape: tuple[int, int], common: float) -> tuple[FloatArray, FloatArray]:
    """Return two uniform draws, the same one in this share of the cases."""
    first, other = rng.random((2, *shape))
    return first, np.where(rng.random(shape) < common, first, other)


@cache
def mean_s(name: str, factor: float) -> float:
    """Return the mean time up to the limit, of ``DRAWS`` draws."""
    ours, _ = times(name, np.random.default_rng(SEED), (1, DRAWS))
    return float(np.minimum(factor * ours, LIMIT_S).mean())


def restricted(name: str, factor: float, failing: float) -> float:
    """Return a restricted mean's truth [s]."""
    return (1.0 - failing) * mean_s(name, factor) + failing * LIMIT_S


def of_mean(name: str, failing: float, rng: Rng, n: int, samples: int) -> Sampled:
    """Sample a restricted mean."""
    taken, _ = times(name, rng, (samples, n))
    reached = rng.random((samples, n)) >= failing
    truth = restricted(name, 1.0, failing)
    return ((truth, restricted_mean(*one, LIMIT_S)) for one in zip(np.maximum(taken, 0.0), reached, strict=True))


def of_mean_pairs(name: str, failing: float, common: float, rng: Rng, n: int, samples: int) -> Sampled:
    """Sample the paired difference of two restricted means."""
    ours, theirs = (np.maximum(one, 0.0) for one in times(name, rng, (samples, n), common))
    luck, other = either(rng, (samples, n), common)
    truth = restricted(name, LONGER, failing) - restricted(name, 1.0, 0.5 * failing)
    sides = LONGER * ours, luck >= failing, theirs, other >= 0.5 * failing
    return ((truth, restricted_mean_difference(*one, LIMIT_S)) for one in zip(*sides, strict=True))


def of_median(name: str, is_paired: bool, rng: Rng, n: int, samples: int) -> Sampled:
    """Sample a median, of times or of paired differences."""
    truth = median_s(name, is_paired)
    return ((truth, median(one)) for one in values(name, is_paired, rng, (samples, n)))


def values(name: str, is_paired: bool, rng: Rng, shape: tuple[int, int]) -> FloatArray:
    """Return times, or their paired differences."""
    ours, theirs = times(name, rng, shape, COMMON[0])
    return LONGER * ours - theirs if is_paired else ours


@cache
def median_s(name: str, is_paired: bool) -> float:
    """Return a median's truth, of ``DRAWS`` draws."""
    return float(np.median(values(name, is_paired, np.random.default_rng(SEED), (1, DRAWS))))


@cache
def verdicts(deciding: int, share: float) -> NDArray[np.bool_]:
    """Return (SCRAMBLES, POINTS) verdicts, which hold where the mean of the first factors lies low enough."""
    designs = [saltelli(POINTS, FACTORS, seed).a for seed in range(SCRAMBLES)]
    means = np.array(designs)[:, :, :deciding].mean(axis=2)
    return np.asarray(means < np.quantile(means, share))


def of_scrambles(deciding: int, share: float, rng: Rng, n: int, samples: int) -> Sampled:
    """Sample a share over scrambles."""
    population = verdicts(deciding, share)
    truth = float(population.mean())
    return ((truth, share_of_scrambles(population[k])) for k in rng.integers(SCRAMBLES, size=(samples, n)))


def bind(function: Callable[..., Sampled], *given: Any) -> Draw:
    """Return how to draw, of a function and what comes first in it."""
    return lambda rng, n, samples: function(*given, rng, n, samples)


UNIFORM = "uniform"
KINDS = {
    "share": Kind(2, {UNIFORM if p is None else f"{p}": bind(of_share, p) for p in (None, *SHARES)}),
    "difference of shares": Kind(
        2,
        {UNIFORM: bind(of_pairs, None)}
        | {
            f"{a} and {b}, dependence {d}": bind(of_pairs, chances(a, b, d))
            for i, a in enumerate(SHARES)
            for b in SHARES[i:]
            for d in DEPENDENCE
        },
    ),
    "win ratio": Kind(
        2,
        {f"{p or UNIFORM}, {ties} tied": bind(of_wins, p, ties) for p in (None, *SHARES) for ties in (0.0, 0.5)},
    ),
    "mean time": Kind(2, {f"{name}, {f} failing": bind(of_mean, name, f) for name in TIMES for f in FAILING}),
    "difference of mean times": Kind(
        PAIRS_MIN,
        {
            f"{name}, {f} failing, {c} common": bind(of_mean_pairs, name, f, c)
            for name in TIMES
            for f in FAILING
            for c in COMMON
        },
    ),
    "median": Kind(6, {name: bind(of_median, name, False) for name in TIMES}),
    "median difference": Kind(6, {name: bind(of_median, name, True) for name in TIMES}),
    "share over scrambles": Kind(
        2, {f"{p}, {k} deciding": bind(of_scrambles, k, p) for k in (1, 2, FACTORS) for p in (0.02, 0.1, 0.5)}
    ),
}
HEADER = ("interval", "truth", "cases", "samples", "told", "coverage")


def covered(kind: Kind, n: int, truth: str, samples: int) -> tuple[float, float]:
    """Return in how many samples of one truth an interval was told, and in how many of those it held the truth."""
    rng = np.random.default_rng([SEED, n, list(kind.truths).index(truth)])
    told = held = 0
    for true, interval in kind.truths[truth](rng, n, samples):
        if not math.isnan(interval.low):
            told += 1
            held += interval.low - 1e-12 <= true <= interval.high + 1e-12
    return told / samples, held / told if told else math.nan


def coverage(effort: Effort) -> Table:
    """Simulate all intervals, and keep each truth's coverage in a file beside this one."""
    samples, cases = effort.cut(REPLICATIONS), CASES[4:5] if effort.is_quick else CASES
    lines = [
        (name, truth, n, samples, *covered(kind, n, truth, samples))
        for name, kind in KINDS.items()
        for truth in list(kind.truths)[: 2 if effort.is_quick else None]
        for n in cases
    ]
    if not effort.is_quick:
        with FILES[0].open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([HEADER, *(map(cell, line) for line in lines)])
        picture(lines)
    rows: list[tuple[Cell, ...]] = []
    for name, kind in KINDS.items():
        found = [at(lines, name, n) if n >= kind.least else None for n in cases]
        for i, which in enumerate(("mean", "least")):
            rows.append(
                (f"{name}, {which}", str(kind.least), *("–" if one is None else 100.0 * one[i] for one in found))
            )
    text = (
        f"In how many of {samples:,} samples a 95 % interval holds the truth [%], by the number of cases: the mean "
        f"over the truths and the least, see coverage.py. From the second column's number on the interval is told, and "
        f"below it none. Nominal less 1.5 is {100.0 * BAR:.1f}.\n\n![Coverage by the number of cases](coverage.png)"
    )
    return Table("Coverage of intervals", text, ("", "from", *map(str, cases)), rows)


def cell(value: object) -> str:
    """Return what stands in the file."""
    return f"{value:.4f}" if isinstance(value, float) else str(value)


def at(lines: Iterable[tuple[Any, ...]], name: str, n: int) -> tuple[float, float]:
    """Return the mean and the least coverage of one interval at one number of cases."""
    found = [line[-1] for line in lines if line[0] == name and line[2] == n]
    return float(np.mean(found)), min(found)


def picture(lines: list[tuple[Any, ...]]) -> None:
    """Draw the mean and the least coverage of each interval by the number of cases."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.8), layout="constrained")
    axes = figure.subplots(2, 4, sharex=True, sharey=True)
    for ax, (name, kind) in zip(axes.ravel(), KINDS.items(), strict=True):
        cases = [n for n in CASES if n >= kind.least]
        means, leasts = zip(*(at(lines, name, n) for n in cases), strict=True)
        ax.plot(cases, means, "o-", ms=3, lw=1.2, label="mean over the truths")
        ax.plot(cases, leasts, "v--", ms=3, lw=1.0, label="least")
        ax.axhline(0.95, color="#888888", lw=0.8)
        ax.axhline(BAR, color="#888888", lw=0.8, ls=":", label="nominal less 1.5 points")
        ax.set(title=name, xscale="log", ylim=(0.9, 1.002))
        ax.title.set_fontsize(9)
        ax.set_xticks([2, 5, 10, 20, 50, 100, 200], ["2", "5", "10", "20", "50", "100", "200"], fontsize=8)
        ax.minorticks_off()
        ax.grid(alpha=0.25)
    figure.supylabel("coverage of a 95 % interval, by the number of cases", fontsize=9)
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8, frameon=False
    )
    figure.savefig(FILES[1], dpi=110)
