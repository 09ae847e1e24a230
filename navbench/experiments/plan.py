"""A plan: what is to run, be it one cell, a sweep of several, a tuning, or a study's tunings and cells."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from navbench.experiments.cells import Batch, Cell, batches_of
from navbench.experiments.parts import batch_name
from navbench.experiments.tunings import Tuning
from navbench.records import CellKey

Planned = dict[str, tuple[CellKey, Batch]]  # batches by the names of their parts


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
        key, cell = max(same, key=lambda pair: (pair[1].keep_trajectories, pair[1].keep_ranges))
        episodes = sorted({index for _, one in same for index in one.indices})
        batches += [(key, batch) for batch in batches_of(cell, episodes)]
    return batches


def around(planned: Planned, there: Mapping[str, tuple[str, range]]) -> Planned:
    """Return planned batches around parts that are there in other cuts, as when more episodes are asked for.

    Args:
        planned: the batches.
        there: other parts: each one's run and episodes by its name.
    """
    keys = {key.run_id: (key, batch.cell) for key, batch in planned.values()}
    held: dict[str, set[int]] = {}
    kept: Planned = {}
    for name, (run_id, episodes) in there.items():
        if run_id in keys and not held.setdefault(run_id, set()).intersection(episodes):
            held[run_id].update(episodes)
            kept[name] = keys[run_id][0], Batch(keys[run_id][1], episodes)
    for name, (key, batch) in planned.items():
        left = [episode for episode in batch.episodes if episode not in held.get(key.run_id, ())]
        whole = len(left) == len(batch.episodes)
        for rest in [batch] if whole else batches_of(batch.cell, left):
            kept[name if whole else batch_name(key, rest.episodes)] = key, rest
    return kept
