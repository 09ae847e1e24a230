"""Reconstructions drawn from scrambled Sobol sequences, in blocks that any process can run."""

import time
from collections.abc import Iterator
from functools import lru_cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.cli.reconstructions import Reconstructions, Told
from navbench.experiments.engines import Work
from navbench.experiments.samples import DRAWN, MOVED
from navbench.experiments.workers import Death, MachineError
from navbench.mathematics.sensitivity import saltelli
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    import pandas as pd

SCRAMBLES = 16  # independent ones, between which the spread of a share is seen
BLOCK = 8  # reconstructions: some seconds of work


class Block(NamedTuple):
    """Some reconstructions of one scramble.

    Attributes:
        of: of what.
        kind: DRAWN or MOVED.
        seed: of the multiverse.
        scramble: which one.
        first: the index of the first reconstruction.
        size: how many.
    """

    of: Reconstructions
    kind: str
    seed: int
    scramble: int
    first: int
    size: int

    @property
    def name(self) -> str:
        """What its part is called."""
        return f"{self.kind}-{self.scramble:02d}-{self.first:06d}-{self.size:03d}"


def blocks_of(of: Reconstructions, seed: int, drawn: int, moved: int) -> list[Block]:
    """Return all blocks, those that lie first in their scrambles before others, so that any beginning is a sample.

    Args:
        of: what is drawn.
        seed: of the multiverse.
        drawn: how many reconstructions in all, a multiple of ``SCRAMBLES * BLOCK``.
        moved: in how many each dimension is moved alone, a multiple of ``SCRAMBLES``.
    """
    found = []
    for kind, total, size in ((DRAWN, drawn, BLOCK), (MOVED, moved, 1)):
        for first in range(0, total // SCRAMBLES, size):
            found += [Block(of, kind, seed, k, first, size) for k in range(SCRAMBLES)]
    return found


@lru_cache(maxsize=2 * SCRAMBLES)
def points(seed: int, scramble: int, dimensions: int, count: int) -> NDArray[np.float64]:
    """Return the first points of a scramble, (2^k, dimensions) with at least so many; more begin with the same.

    Which of Sobol's sequences a dimension gets is dealt anew in each scramble: some pairs of these fill the
    square badly, and no two factors are to keep one.
    """
    from scipy.stats.qmc import Sobol

    power = max(int(np.ceil(np.log2(max(count, 1)))), 0)
    rng = np.random.default_rng([seed, scramble, 0])
    dealt = rng.permutation(dimensions)
    found: NDArray[np.float64] = Sobol(dimensions, scramble=True, rng=rng).random_base2(power)[:, dealt]
    return found


def places(seed: int, dimensions: int, rows: "pd.DataFrame") -> NDArray[np.float64]:
    """Return (rows, dimensions) where the reconstructions of a sample lie, from their scramble and index."""
    count = int(rows["index"].max()) + 1
    return np.array(
        [points(seed, k, dimensions, count)[i] for k, i in zip(rows["scramble"], rows["index"], strict=True)]
    )


def run_block(block: Block) -> dict[str, Any]:
    """Run a block's reconstructions and return a column of each thing that is kept of them."""
    rows = list(_rows(block))
    names = [entry.name for entry in block.of.claims]
    columns: dict[str, Any] = {
        "scramble": np.full(len(rows), block.scramble, np.int16),
        "index": np.array([index for index, _, _, _ in rows], np.int32),
        "moved": np.array([moved for _, moved, _, _ in rows], np.int16),
        "seconds": np.array([seconds for _, _, _, seconds in rows], np.float32),
    }
    for name in ("possible", "episodes", "steps"):
        columns[name] = np.array([getattr(told, name) for _, _, told, _ in rows], np.int32)
    codes = np.array([told.codes for _, _, told, _ in rows], np.int8)
    columns |= {f"code:{name}": codes[:, i] for i, name in enumerate(names)}
    if block.kind == DRAWN:
        values = np.array([told.values for _, _, told, _ in rows], np.float32)
        columns |= {f"value:{name}": values[:, i] for i, name in enumerate(names)}
    return columns


def _rows(block: Block) -> Iterator[tuple[int, int, Told, float]]:
    """Yield the index, what was moved (-1 for nothing), what the claims say, and the CPU time [s]."""
    of, dimensions = block.of, len(block.of.names)
    last = block.first + block.size
    if block.kind == DRAWN:
        for index in range(block.first, last):
            begin = time.process_time()
            told = of.tell(points(block.seed, block.scramble, dimensions, last)[index])
            yield index, -1, told, time.process_time() - begin
        return
    base = 2 ** int(np.ceil(np.log2(max(last, 1))))
    design = saltelli(base, dimensions, np.random.default_rng([block.seed, block.scramble, 1]))
    for index in range(block.first, last):
        begin = time.process_time()
        for moved, told in of.tell_changed(design.a[index], design.b[index]):
            yield index, moved, told, time.process_time() - begin
            begin = time.process_time()


def _lost(block: Block, death: Death) -> dict[str, Any]:
    what = f"{block.name}: "
    raise MachineError(death, what) if death.by_machine else DescriptionError(f"{what}{death.reason}")


BLOCKS: Work[Block, dict[str, Any]] = Work(
    run_block, lambda block: [block], _lost, lambda done: done[0], attrgetter("of.foreign")
)
