"""A plan: what is to run, be it one cell, a sweep of several, a tuning, or a study's tunings and cells."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from navbench.experiments.cells import Batch, Cell, batches_of
from navbench.experiments.tunings import Tuning
from navbench.records import CellKey


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What is to run.

    Attributes:
        cells: the cells; one that takes its parameters from a tuning still has its controller's own here.
        tunings: what is searched before; those of one name differ in their seeds.
        study: name, title, summary, claims and report as plain values, for the manifest; None for a run or a sweep.
    """

    cells: tuple[Cell, ...]
    tunings: tuple[Tuning, ...] = ()
    study: Mapping[str, Any] | None = None

    def episodes(self) -> int:
        """Return how many episodes it has, those of equal cells once."""
        keys = [(cell.key().run_id, cell.tuning, cell.tuning_seed, cell.indices) for cell in self.cells]
        return len({(*key, index) for *key, indices in keys for index in indices})


def batches_of_all(cells: Sequence[Cell]) -> list[tuple[CellKey, Batch]]:
    """Return all episodes of some cells in batches, each with the key of its cell; those of equal cells once."""
    alike: dict[str, list[tuple[CellKey, Cell]]] = {}
    for cell in cells:
        key = cell.key()
        alike.setdefault(key.run_id, []).append((key, cell))
    batches = []
    for same in alike.values():
        key, cell = max(same, key=lambda pair: pair[1].keep_trajectories)
        episodes = sorted({index for _, one in same for index in one.indices})
        batches += [(key, batch) for batch in batches_of(cell, episodes)]
    return batches
