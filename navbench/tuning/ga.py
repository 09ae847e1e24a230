"""The genetic algorithm of zhao2018, which evolves the memberships and the rules of a fuzzy controller together.

R. Zhao, H.-K. Lee, "Intelligent Navigation Algorithm for Mobile Robots based on Optimized Fuzzy Logic", Journal of
IKEEE 22(2), 2018; section III. The paper names the operators and prints neither a number nor an equation of them.

| in the paper | here |
|---|---|
| chromosome: membership points, then rules coded 1 to 5 | a place in the unit cube; a rule is a gene with levels |
| F_i = 1 / (w1 L_i + w2 T_i + w3 d_i), equation 4 | the cost is 1 / F_i; the objective says it |
| stochastic universal sampling | ``genetics.sus`` on ``genetics.expected_copies`` |
| double-point crossover | ``genetics.double_point_crossover`` |
| real-valued mutation | ``genetics.mutated`` |

Left open, and decided here:

- Selection samples ranks, not F itself: near the end the costs of a whole population differ by a few per cent, and
  shares of F would choose almost at random. Only the order of F counts then, so that any cost will do, also one of 0.
- As many parents as children are wanted are drawn, shuffled, and mated two by two; an odd last one has no mate. The
  two cuts are different places behind the first gene, so that no crossover exchanges nothing or everything.
- A mutation moves a real gene by up to ``step`` of its range, evenly to either side, and a rule by one level or more;
  what would leave the range stops at its end.
- The first population is the controller as it stands and mutants of it, or random where there is none.
- Repair is Lamarckian: a chromosome that breaks the order of its memberships lives on as it was mended.
- The elite live on unchanged, and keep their costs; they are not evaluated again.
"""

from dataclasses import dataclass

import numpy as np

from navbench.contract import FloatArray
from navbench.tuning.genetics import double_point_crossover, expected_copies, mutated, sus
from navbench.tuning.space import Space
from navbench.tuning.swarms import Generations, is_number, random_points, require_number, require_whole

LEVEL_STEP_MAX = 1000  # no gene has so many levels


@dataclass(frozen=True, slots=True, kw_only=True)
class Ga:
    """Genetic algorithm over real genes and genes with levels.

    Attributes:
        n: chromosomes in the population, at least 2.
        elite: how many of the best live on, fewer than ``n``; the others are replaced by children.
        ranking_pressure: how often the best is a parent on average, 1 to 2; the worst is 2 minus that.
        crossover_rate: probability that two mates cross over.
        genes_mutated: how many genes of a chromosome mutate on average; of fewer genes, all do.
        step: how far a mutation moves a real gene at most, in widths of its range, 0 to 1.
        level_step: how many levels a mutation moves another gene at most.
    """

    n: int
    elite: int
    ranking_pressure: float
    crossover_rate: float
    genes_mutated: float
    step: float
    level_step: int

    def __post_init__(self) -> None:
        """Check the parameters; a wrong one is a ValueError."""
        require_whole(self, "n", least=2)
        require_whole(self, "elite", least=0)
        if self.elite >= self.n:
            raise ValueError(f"Ga.elite={self.elite}: must be less than n={self.n}")
        if not is_number(self.ranking_pressure) or not 1.0 <= self.ranking_pressure <= 2.0:
            raise ValueError(f"Ga.ranking_pressure={self.ranking_pressure!r}: must be a finite number from 1 to 2")
        require_number(self, "crossover_rate", most=1.0)
        require_number(self, "genes_mutated")
        require_number(self, "step", most=1.0)
        require_whole(self, "level_step", least=1)
        if self.level_step > LEVEL_STEP_MAX:
            raise ValueError(f"Ga.level_step={self.level_step}: must be at most {LEVEL_STEP_MAX}")

    @property
    def population(self) -> int:
        """The size of the first generation."""
        return self.n

    def generations(self, space: Space, rng: np.random.Generator) -> Generations:
        """Yield the first population, then its children, generation by generation, and receive their costs."""
        x = space.repair(self._first(space, rng))
        costs = yield x
        while True:
            children = space.repair(self._mutants(self._mated(self._parents(x, costs, rng), rng), space, rng))
            children_costs = yield children
            best = costs.argsort(kind="stable")[: self.elite]
            x, costs = np.concatenate([x[best], children]), np.concatenate([costs[best], children_costs])

    def _first(self, space: Space, rng: np.random.Generator) -> FloatArray:
        if space.start is None:
            return random_points(self.n, space.size, rng)
        mutants = self._mutants(np.tile(space.start, (self.n - 1, 1)), space, rng)
        return np.concatenate([space.start[None, :], mutants])

    def _parents(self, x: FloatArray, costs: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return a parent for each child, in random order: beside a copy of itself, none could cross over."""
        expected = expected_copies(costs, self.ranking_pressure)
        parents: FloatArray = x[rng.permutation(sus(expected, self.n - self.elite, rng.random()))]
        return parents

    def _mated(self, parents: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return the children of neighbours."""
        children, (count, size) = parents.copy(), parents.shape
        for i in range(0, count - 1 if size > 1 else 0, 2):
            if rng.random() < self.crossover_rate:
                begin, end = sorted(rng.choice(np.arange(1, size + 1), 2, replace=False).tolist())
                children[i], children[i + 1] = double_point_crossover(parents[i], parents[i + 1], begin, end)
        return children

    def _mutants(self, x: FloatArray, space: Space, rng: np.random.Generator) -> FloatArray:
        rate = min(1.0, self.genes_mutated / space.size)
        return mutated(x, space.levels, rate, self.step, self.level_step, rng)
