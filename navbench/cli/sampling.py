"""Reconstructions drawn from scrambled Sobol sequences, in blocks that any process can run."""

import time
from collections.abc import Iterator, Sequence
from functools import lru_cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.cli.reconstructions import Reconstructions, Told
from navbench.experiments.engines import Work
from navbench.experiments.samples import CODE, DRAWN, MOVED, VALUE
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
        claims: the names of those that are asked.
    """

    of: Reconstructions
    kind: str
    seed: int
    scramble: int
    first: int
    size: int
    claims: tuple[str, ...]

    @property
    def name(self) -> str:
        """What its part is called."""
        return f"{self.kind}-{self.scramble:02d}-{self.first:06d}-{self.size:03d}"


def drawn_blocks(of: Reconstructions, seed: int, count: int) -> list[Block]:
    """Return the blocks of a sample, those that lie first in their scrambles before others: any beginning is a sample.

    Args:
        of: what is drawn.
        seed: of the multiverse.
        count: how many reconstructions in all, a multiple of ``SCRAMBLES * BLOCK``.
    """
    claims = tuple(entry.name for entry in of.claims)
    firsts = range(0, count // SCRAMBLES, BLOCK)
    return [Block(of, DRAWN, seed, k, first, BLOCK, claims) for first in firsts for k in range(SCRAMBLES)]


def moved_blocks(of: Reconstructions, seed: int, count: int, claims: Sequence[str]) -> list[Block]:
    """Return the blocks in whose reconstructions each dimension is moved alone, in the order of ``drawn_blocks``.

    Args:
        of: what is drawn.
        seed: of the multiverse.
        count: in how many reconstructions in all, a multiple of ``SCRAMBLES``.
        claims: the names of those that are asked; without any there is nothing to do.
    """
    firsts = range(count // SCRAMBLES if claims else 0)
    return [Block(of, MOVED, seed, k, first, 1, tuple(claims)) for first in firsts for k in range(SCRAMBLES)]


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
    chosen = [k for k, entry in enumerate(block.of.claims) if entry.name in block.claims]
    columns: dict[str, Any] = {
        "scramble": np.full(len(rows), block.scramble, np.int16),
        "index": np.array([index for index, _, _, _ in rows], np.int32),
        "moved": np.array([moved for _, moved, _, _ in rows], np.int16),
        "seconds": np.array([seconds for _, _, _, seconds in rows], np.float32),
    }
    for name in ("possible", "episodes", "steps"):
        columns[name] = np.array([getattr(told, name) for _, _, told, _ in rows], np.int32)
    kept = {CODE: np.array([told.codes for _, _, told, _ in rows], np.int8)}
    if block.kind == DRAWN:
        kept[VALUE] = np.array([told.values for _, _, told, _ in rows], np.float32)
    return columns | {f"{what}{block.of.claims[k].name}": of[:, k] for what, of in kept.items() for k in chosen}


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
        for moved, told in of.tell_changed(design.a[index], design.b[index], block.claims):
            yield index, moved, told, time.process_time() - begin
            begin = time.process_time()


def _lost(block: Block, death: Death) -> dict[str, Any]:
    what = f"{block.name}: "
    raise MachineError(death, what) if death.by_machine else DescriptionError(f"{what}{death.reason}")


BLOCKS: Work[Block, dict[str, Any]] = Work(
    run_block, lambda block: [block], _lost, lambda done: done[0], attrgetter("of.foreign")
)
