"""Scipy's differential evolution as a tuner: a minimiser that calls is turned into a generator that is asked.

The baseline from outside: R. Storn, K. Price, "Differential Evolution", Journal of Global Optimization 11, 1997, as
``scipy.optimize.differential_evolution`` has it. The first points are uniform, as with every tuner here; a generation
is evaluated as a whole; there is no polish and no end of its own. Scipy draws a coordinate outside the cube anew.
"""

import sys
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Thread
from typing import Any

import numpy as np

from navbench.contract import FloatArray
from navbench.tuning.space import Space
from navbench.tuning.swarms import Generations, is_number, random_points, require_number, require_whole

Objective = Callable[[FloatArray], FloatArray]

STRATEGIES = (
    *("best1bin", "best2bin", "rand1bin", "rand2bin", "randtobest1bin", "currenttobest1bin"),
    *("best1exp", "best2exp", "rand1exp", "rand2exp", "randtobest1exp", "currenttobest1exp"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class De:
    """Differential evolution.

    Attributes:
        n: points in the population, at least 5.
        strategy: one of ``STRATEGIES``, as scipy calls them.
        mutation: least and greatest differential weight, from 0 to below 2; drawn between them once a generation.
        recombination: probability that a coordinate comes from the mutant.
    """

    n: int
    strategy: str
    mutation: tuple[float, float]
    recombination: float

    def __post_init__(self) -> None:
        """Check the parameters; a wrong one is a ValueError."""
        require_whole(self, "n", least=5)
        if self.strategy not in STRATEGIES:
            raise ValueError(f"De.strategy={self.strategy!r}: must be one of {', '.join(STRATEGIES)}")
        pair: Any = self.mutation
        numbers = isinstance(pair, Sequence) and len(pair) == 2 and all(is_number(weight) for weight in pair)
        if not numbers or not 0.0 <= pair[0] <= pair[1] < 2.0:
            raise ValueError(f"De.mutation={pair!r}: must be two numbers, 0 <= least <= greatest < 2")
        object.__setattr__(self, "mutation", tuple(pair))  # a YAML file gives a list
        require_number(self, "recombination", most=1.0)

    @property
    def population(self) -> int:
        """The size of the first generation."""
        return self.n

    def generations(self, space: Space, rng: np.random.Generator) -> Generations:
        """Yield the population, then the trial points, generation by generation, and receive their costs."""
        from scipy.optimize import differential_evolution  # slow to import

        first = random_points(self.n, space.size, rng)

        def minimise(objective: Objective) -> None:
            with np.errstate(over="ignore", invalid="ignore"):  # in the spread of huge costs, which decides nothing
                differential_evolution(
                    lambda points: objective(points.T.copy()),
                    [(0.0, 1.0)] * space.size,
                    strategy=self.strategy,
                    mutation=self.mutation,
                    recombination=self.recombination,
                    init=first,
                    rng=rng,
                    vectorized=True,
                    updating="deferred",
                    polish=False,
                    maxiter=sys.maxsize,
                    tol=0.0,
                    atol=-1.0,  # no spread of costs is less: it never ends
                )

        yield from points_of(minimise)


class _Closed(BaseException):
    """Unwinds the minimiser once its generator is closed; no ``except Exception`` in between may stop it."""


def points_of(minimise: Callable[[Objective], object]) -> Generator[FloatArray, FloatArray, None]:
    """Yield every batch of points whose costs a minimiser wants; what is sent back, its cost function returns.

    The minimiser runs in a thread of its own, by turns with the caller: one of the two always waits. Closing or
    dropping the generator ends the minimiser at the point where it waits, and the thread with it. An error that the
    minimiser raises is raised here; where it returns, the generator ends.

    Args:
        minimise: runs a minimisation with the cost function that it is given.
    """
    asked: SimpleQueue[FloatArray | BaseException | None] = SimpleQueue()
    answers: SimpleQueue[FloatArray | None] = SimpleQueue()

    def objective(points: FloatArray) -> FloatArray:
        asked.put(points)
        answer = answers.get()
        if answer is None:
            raise _Closed
        return answer

    def work() -> None:
        try:
            minimise(objective)
            asked.put(None)
        except _Closed:
            pass
        except BaseException as error:
            asked.put(error)

    # A daemon, since a generator that is still alive when the program ends must not hold the program up.
    thread = Thread(target=work, name="navbench-minimiser", daemon=True)
    thread.start()
    is_finalizing = sys.is_finalizing  # a local name, which outlives the module
    try:
        while (points := asked.get()) is not None:
            if isinstance(points, BaseException):
                raise points
            answers.put((yield points))
    finally:
        answers.put(None)
        if not is_finalizing():  # then no other thread runs any more
            thread.join()
