"""The reconstruction in which most printed numbers hold together, by differential evolution from the best of a sample.

The paper's own table, each with a number left out, and placebo tables are searched for alike: from the best of the
same sample, with as many evaluations. Each is judged on the medians over more starts than the sample's.
"""

from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.fitting import Met, Target, targets, values_in
from navbench.analysis.shares import Drawn
from navbench.cli.reconstructions import Reconstructions
from navbench.experiments.engines import in_processes
from navbench.experiments.samples import Samples

POPULATION = 32  # reconstructions a generation
STARTS = 30  # of a cell in each, as far as it has them
AT_ONCE = 4  # evaluations that go to a process together

FloatArray = NDArray[np.float64]


class Evaluation(NamedTuple):
    """Reconstructions to be measured: (k, dimensions) where they lie."""

    of: Reconstructions
    u: FloatArray


def measured(evaluation: Evaluation) -> FloatArray:
    """Return (k, claims) what is measured in each reconstruction; nan without a case."""
    return np.array([evaluation.of.tell(u).values for u in evaluation.u])


def told_at(evaluation: Evaluation) -> tuple[NDArray[np.int8], FloatArray]:
    """Return (claims,) what each claim does in one reconstruction, of which ``u`` says where it lies, and its value."""
    told = evaluation.of.tell(evaluation.u)
    return told.codes, told.values


class Searches:
    """The searches of a multiverse, each generation kept as it is done.

    Args:
        of: the reconstructions.
        drawn: the sample from whose best they begin.
        samples: where generations are kept.
        seed: of the multiverse.
        evaluations: of each search, a multiple of ``POPULATION``.
        workers: processes.
        told: is called with what is under way, how many evaluations are done, and of how many.

    Attributes:
        claims: whose printed numbers are met together.
        free: the dimensions that may change what is measured of these; the others stay as in the sample's best.
    """

    def __init__(
        self,
        of: Reconstructions,
        drawn: Drawn,
        samples: Samples,
        *,
        seed: int,
        evaluations: int,
        workers: int | None,
        told: Callable[[str, int, int], None],
    ) -> None:
        self._drawn, self._samples, self._seed, self._workers, self._told = drawn, samples, seed, workers, told
        self._generations = evaluations // POPULATION
        named = of.multiverse.together
        chosen = [
            (entry, used)
            for entry, used in zip(of.claims, of.uses, strict=True)
            if entry.claim.printed is not None and (named is None or entry.name in named)
        ]
        self.claims = [entry for entry, _ in chosen]
        self.free = sorted({i for entry in self.claims for i in of.reaches[entry.name]})
        self._number = {target.name: k for k, target in enumerate(targets(self.claims))}
        uses = tuple(used for _, used in chosen)
        self._of = replace(of, claims=tuple(self.claims), uses=uses, episodes=(STARTS,), places={}, offered={})
        self._known: dict[bytes, FloatArray] = {}  # what was measured, by where
        self._done = 0

    def meet(self, target: Target) -> Met:
        """Return what meets a target best of all that its search evaluated."""
        from scipy.optimize import differential_evolution

        begin = self._first(target)
        tried: list[tuple[FloatArray, FloatArray]] = []

        def cost(x: FloatArray) -> FloatArray:
            u = np.repeat(begin[:1], x.shape[1], axis=0)
            u[:, self.free] = x.T
            values = self._generation(self._number[target.name], len(tried), u)
            tried.append((u, values))
            return target.cost(values)

        options = {
            "init": begin[:, self.free],
            "maxiter": self._generations - 1,
            "rng": np.random.default_rng([self._seed, 2, self._number[target.name]]),
        }
        bounds = [(0.0, 1.0)] * len(self.free)
        differential_evolution(cost, bounds, vectorized=True, updating="deferred", polish=False, tol=0.0, **options)
        u, values = (np.concatenate(of) for of in zip(*tried, strict=True))
        best = int(np.argmin(target.cost(values)))
        return Met(u[best], values[best])

    def _first(self, target: Target) -> FloatArray:
        """Return (POPULATION, dimensions) the best of the sample; the sample is at least so large."""
        cost = target.cost(values_in(self._drawn, target))
        return self._drawn.u[np.argsort(cost, kind="stable")[:POPULATION]]

    def _generation(self, number: int, generation: int, u: FloatArray) -> FloatArray:
        """Return (k, claims) what is measured of a generation, which is kept, or was before."""
        name = f"searched-{number:02d}-{generation:03d}"
        places, asked = [f"u:{i}" for i in range(u.shape[1])], [f"value:{entry.name}" for entry in self.claims]
        if self._samples.has(name):
            kept = self._samples.part(name)
            if {*places, *asked} <= set(kept) and np.array_equal(kept[places].to_numpy(), u):
                values = kept[asked].to_numpy()
                self._known.update(zip(map(np.ndarray.tobytes, u), values, strict=True))
                return self._tell(values)
        new = np.array([row for row in u if row.tobytes() not in self._known]).reshape(-1, u.shape[1])
        blocks = [Evaluation(self._of, new[k : k + AT_ONCE]) for k in range(0, len(new), AT_ONCE)]
        done = in_processes(measured, blocks, self._workers, attrgetter("of.foreign"))
        for block, found in zip(blocks, done, strict=True):
            self._known.update(zip(map(np.ndarray.tobytes, block.u), found, strict=True))
        values = np.array([self._known[row.tobytes()] for row in u])
        self._samples.write(name, dict(zip([*places, *asked], [*u.T, *values.T], strict=True)))
        return self._tell(values)

    def _tell(self, values: FloatArray) -> FloatArray:
        self._done += len(values)
        self._told("evaluations", self._done, self._generations * POPULATION * len(self._number))
        return values
