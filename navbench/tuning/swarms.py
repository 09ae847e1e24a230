"""The tuners' update rules: particle swarm, artificial bee colony, fireflies, and random points to compare with.

A. Aouf, L. Boussaid, A. Sakly, "Same Fuzzy Logic Controller for Two-Wheeled Mobile Robot Navigation in Strange
Environments", Journal of Robotics 2019, 2465219, doi:10.1155/2019/2465219; section 4, equations 26 to 32.

Each tuner is a set of parameters with one method, ``generations``: a generator that yields points (n, D) in the unit
cube [0, 1]^D, receives their n costs, of which less is better, and goes on until it is closed. It knows neither
bounds nor budget: ``navbench.tuning.search`` does. So the paper's x_min and x_max are 0 and 1 here, and every length,
the fireflies' distance among them, is measured in widths of the search range.

| symbol | here | equation |
|---|---|---|
| x_i | position, in [0, 1]^D | 26, 27, 31, 32 |
| f(x_i) | cost; the paper's is the integral of the squared error | 29 |
| V_i,j | candidate of bee i, changed in dimension j | 27 |
| fit, P_i | fitness, and probability that an onlooker chooses source i | 28, 29 |
| sn | ``sources`` | 28 |
| beta_0, gamma | ``beta0``, ``gamma`` | 30, 32 |
| m | 2, as (32) has it | 30 |
| r_ij | distance of two fireflies | 31 |
| alpha | ``alpha`` | 32 |

Errata, corrected here: the employed bees' neighbour is (27), where the text names (26); k differs from i, or (27)
would not move; a firefly's brightness is the negative cost, where the text has the cost itself.

Left open, and decided here:

- Bees. (27) moves one dimension j, drawn anew each time, as in Karaboga's report, which the paper cites. A candidate
  takes its source's place where its cost is less (for (29) that is the greater fitness). Onlookers are as many as
  sources. A phase is one generation: its candidates all start from where the sources stood at its beginning, and are
  then compared in order. After ``limit`` failures in a row a source is replaced by a scout's, by (26): every such
  source, the best one too. Outside the cube a candidate is clipped.
- Fireflies. A generation is compared by the costs it was evaluated with: firefly i meets, for j = 1..n, each brighter
  one, moves by (32) at once, its own random term with each, and measures the next distance from where it has come to,
  while the others are seen where they were evaluated. It is evaluated once, after its last move: n evaluations a
  generation, where a loop that evaluates each move would need up to n^2. The random number is one a dimension. With
  no brighter one, the random term alone moves it, the brightest included. alpha shrinks by ``damping`` a generation.
  A firefly outside the cube after its last move is clipped.
- Particles. The paper prints no equations and cites Lai et al. (2013); this is the usual swarm with an inertia weight
  and a global best (Shi and Eberhart 1998). First velocities lead halfway to another random point, and a particle
  that leaves the cube is clipped and loses its velocity across that side, both as in Clerc's standard swarm of 2007.
  Velocities have no other limit.
"""

import math
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navbench.contract import FloatArray
from navbench.tuning.space import Space

Generations = Generator[FloatArray, FloatArray, None]
IntArray = NDArray[np.int64]


def random_points(count: int, dimensions: int, rng: np.random.Generator) -> FloatArray:
    """Return (count, dimensions) uniform points."""
    return rng.random((count, dimensions))  # eq. (26), x_min = 0, x_max = 1


def neighbour(x_ij: FloatArray, x_kj: FloatArray, rand: FloatArray) -> FloatArray:
    """Return what bee i tries in dimension j, from its own place and that of another source; rand in (-1, 1)."""
    return x_ij + rand * (x_ij - x_kj)  # eq. (27)


def choice_probabilities(fit: FloatArray) -> FloatArray:
    """Return each source's probability to be chosen by an onlooker."""
    share = fit / fit.max()  # so that the sum of huge fitnesses stays finite
    probabilities: FloatArray = share / share.sum()  # eq. (28)
    return probabilities


def fitness(f: float) -> float:
    """Return the fitness, greater than 0, of a cost."""
    return 1.0 / (1.0 + f) if f >= 0.0 else 1.0 + abs(f)  # eq. (29)


def attractiveness(r_ij: float, beta0: float, gamma: float) -> float:
    """Return how strongly a firefly attracts another one at this distance."""
    return beta0 * math.exp(-gamma * r_ij**2)  # eq. (30), m = 2


def firefly_distance(x_i: FloatArray, x_j: FloatArray) -> float:
    """Return the distance of two fireflies."""
    return math.dist(x_i.tolist(), x_j.tolist())  # eq. (31)


def firefly_move(x_i: FloatArray, x_j: FloatArray, beta: float, alpha: float, rand: FloatArray) -> FloatArray:
    """Return where firefly i comes to, attracted by j with beta = beta(r_ij); rand (D,) in (0, 1)."""
    return x_i + beta * (x_j - x_i) + alpha * (rand - 0.5)  # eq. (32)


def particle_velocity(
    v: FloatArray,
    x: FloatArray,
    own_best: FloatArray,
    best: FloatArray,
    w: float,
    pull_own: FloatArray,
    pull: FloatArray,
) -> FloatArray:
    """Return the particles' velocities, pulled to their own best places and to the swarm's; not in the paper."""
    return w * v + pull_own * (own_best - x) + pull * (best - x)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pso:
    """Particle swarm with an inertia weight and a global best.

    Attributes:
        n: particles.
        w: inertia weight, 0 to 1.
        c1: pull to the particle's own best place.
        c2: pull to the swarm's best place.
    """

    n: int
    w: float
    c1: float
    c2: float

    def __post_init__(self) -> None:
        """Check the parameters; a wrong one is a ValueError."""
        require_whole(self, "n", least=1)
        require_number(self, "w", most=1.0)
        require_number(self, "c1")
        require_number(self, "c2")

    @property
    def population(self) -> int:
        """The size of the first generation."""
        return self.n

    def generations(self, space: Space, rng: np.random.Generator) -> Generations:
        """Yield the particles' places, generation by generation, and receive their costs."""
        x = random_points(self.n, space.size, rng)
        v = 0.5 * (random_points(self.n, space.size, rng) - x)
        own_best, own_costs = x, (yield x)
        while True:
            r1, r2 = rng.random((2, self.n, space.size))
            v = particle_velocity(v, x, own_best, own_best[own_costs.argmin()], self.w, self.c1 * r1, self.c2 * r2)
            free = x + v
            x = free.clip(0.0, 1.0)
            v = np.where(x == free, v, 0.0)
            costs = yield x
            better = costs < own_costs
            own_best = np.where(better[:, None], x, own_best)
            own_costs = np.where(better, costs, own_costs)


@dataclass(frozen=True, slots=True, kw_only=True)
class Abc:
    """Artificial bee colony: employed bees, onlookers and scouts.

    Attributes:
        sources: food sources, and as many employed bees and onlookers; at least 2.
        limit: failures in a row after which a source is left to a scout.
    """

    sources: int
    limit: int

    def __post_init__(self) -> None:
        """Check the parameters; a wrong one is a ValueError."""
        require_whole(self, "sources", least=2)
        require_whole(self, "limit", least=1)

    @property
    def population(self) -> int:
        """The size of the first generation."""
        return self.sources

    def generations(self, space: Space, rng: np.random.Generator) -> Generations:
        """Yield what the employed bees try, then the onlookers, then scouts, if any, and receive the costs."""
        x = random_points(self.sources, space.size, rng)
        costs = np.array((yield x.copy()))
        failures = np.zeros(self.sources, dtype=np.int64)
        while True:
            employed = np.arange(self.sources)
            tried = _candidates(x, employed, rng)
            _select(x, costs, failures, employed, tried, (yield tried))
            fit = np.array([fitness(f) for f in costs.tolist()])
            onlookers = rng.choice(self.sources, size=self.sources, p=choice_probabilities(fit))
            tried = _candidates(x, onlookers, rng)
            _select(x, costs, failures, onlookers, tried, (yield tried))
            scouts = np.flatnonzero(failures >= self.limit)
            if scouts.size:
                x[scouts] = random_points(scouts.size, space.size, rng)
                costs[scouts] = yield x[scouts]
                failures[scouts] = 0


def _candidates(x: FloatArray, bees: IntArray, rng: np.random.Generator) -> FloatArray:
    """Return one candidate a bee: its source, moved in one dimension relative to another source."""
    sources, dimensions = x.shape
    j = rng.integers(dimensions, size=bees.size)
    k = (bees + rng.integers(1, sources, size=bees.size)) % sources  # any but i
    rand = rng.uniform(-1.0, 1.0, size=bees.size)
    tried = x[bees]
    tried[np.arange(bees.size), j] = neighbour(x[bees, j], x[k, j], rand).clip(0.0, 1.0)
    return tried


def _select(
    x: FloatArray, costs: FloatArray, failures: IntArray, bees: IntArray, tried: FloatArray, tried_costs: FloatArray
) -> None:
    """Let each candidate in turn take its source's place where it costs less, and count where it does not."""
    for i, candidate, cost in zip(bees, tried, tried_costs, strict=True):
        if cost < costs[i]:
            x[i], costs[i], failures[i] = candidate, cost, 0
        else:
            failures[i] += 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Fa:
    """Firefly algorithm.

    Attributes:
        n: fireflies.
        beta0: attractiveness at no distance.
        gamma: absorption of light over the squared distance.
        alpha: width of the random term, in widths of the search range.
        damping: factor on alpha from one generation to the next, 0 to 1.
    """

    n: int
    beta0: float
    gamma: float
    alpha: float
    damping: float

    def __post_init__(self) -> None:
        """Check the parameters; a wrong one is a ValueError."""
        require_whole(self, "n", least=1)
        for key in ("beta0", "gamma", "alpha"):
            require_number(self, key)
        require_number(self, "damping", most=1.0)

    @property
    def population(self) -> int:
        """The size of the first generation."""
        return self.n

    def generations(self, space: Space, rng: np.random.Generator) -> Generations:
        """Yield the fireflies' places, generation by generation, and receive their costs."""
        x, alpha = random_points(self.n, space.size, rng), self.alpha
        while True:
            x = self.flight(x, (yield x), alpha, rng).clip(0.0, 1.0)
            alpha *= self.damping

    def flight(self, x: FloatArray, costs: FloatArray, alpha: float, rng: np.random.Generator) -> FloatArray:
        """Return where one generation's fireflies come to, not clipped."""
        moved = x.copy()
        for i, place in enumerate(x):
            brighter = np.flatnonzero(costs < costs[i])
            for j in brighter:
                beta = attractiveness(firefly_distance(place, x[j]), self.beta0, self.gamma)
                place = firefly_move(place, x[j], beta, alpha, rng.random(place.shape))
            if not brighter.size:
                place = firefly_move(place, place, 0.0, alpha, rng.random(place.shape))
            moved[i] = place
        return moved


@dataclass(frozen=True, slots=True, kw_only=True)
class Random:
    """Uniform random points; the same ones whatever ``n``.

    Attributes:
        n: points in a generation.
    """

    n: int

    def __post_init__(self) -> None:
        """Check the parameters; a wrong one is a ValueError."""
        require_whole(self, "n", least=1)

    @property
    def population(self) -> int:
        """The size of the first generation."""
        return self.n

    def generations(self, space: Space, rng: np.random.Generator) -> Generations:
        """Yield random points; the costs are of no consequence."""
        while True:
            yield random_points(self.n, space.size, rng)


def is_number(value: Any) -> bool:
    """Return whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def require_whole(tuner: Any, key: str, *, least: int) -> None:
    """Refuse a parameter that is not a whole number of at least this."""
    value = getattr(tuner, key)
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ValueError(f"{type(tuner).__name__}.{key}={value!r}: must be a whole number of at least {least}")


def require_number(tuner: Any, key: str, *, most: float = math.inf) -> None:
    """Refuse a parameter that is not a finite number from 0 to this."""
    value = getattr(tuner, key)
    if not is_number(value) or not 0.0 <= value <= most:
        allowed = "of at least 0" if most == math.inf else f"from 0 to {most:g}"
        raise ValueError(f"{type(tuner).__name__}.{key}={value!r}: must be a finite number {allowed}")
