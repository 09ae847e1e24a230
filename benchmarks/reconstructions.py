"""How fast a multiverse asks its reconstructions, beside what planar alone takes for the same episodes."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

from benchmarks.harness import Cell, Effort, Table, median
from benchmarks.shares import timed
from navbench.cli.prior import reconstructions_of
from navbench.cli.sampling import BLOCK, Block, run_block
from navbench.episode.loop import EpisodeRunner
from navbench.experiments.samples import DRAWN

STUDIES = ("nemeiksis2019", "lei2014", "zhao2017")  # those whose controllers need no tuning before


def reconstructions(effort: Effort) -> Table:
    """Measure reconstructions as they are asked what the claims say, and their episodes within."""
    rows: list[tuple[Cell, ...]] = []
    for study in STUDIES[: effort.few(len(STUDIES))]:
        of = reconstructions_of(study, Path())
        claims = tuple(entry.name for entry in of.claims)
        blocks = [Block(of, DRAWN, 0, k, 0, effort.few(BLOCK), claims) for k in range(effort.rounds + 1)]
        found = [asked(block) for block in blocks][1:]  # the first one compiles
        rows.append((study, *map(median, map(list, zip(*found, strict=True)))))
    text = (
        "Blocks of reconstructions of a study, drawn as `navbench multiverse` draws them and asked what every claim "
        "says. Planar alone is what their episodes take: layouts, starts, loops and records, without making the "
        "cells, the tables and the measures of the claims."
    )
    header = ("", "episodes", "robot-steps/s", "planar alone, robot-steps/s", "of planar's rate")
    return Table("Reconstructions", text, header, rows)


def asked(block: Block) -> tuple[float, float, float, float]:
    """Return a block's episodes, its robot-steps a second, those in its episodes alone, and their ratio."""
    with episodes_timed() as spent:
        begin = time.process_time()
        columns = run_block(block)
        whole, alone = time.process_time() - begin, spent["episodes"]
    steps = float(columns["steps"].sum())
    return float(columns["episodes"].sum()), steps / whole, steps / alone, alone / whole


@contextmanager
def episodes_timed() -> Iterator[dict[str, float]]:
    """Time every episode that is run [s]."""
    spent = {"episodes": 0.0}
    with patch.object(EpisodeRunner, "run", EpisodeRunner.run):
        timed(EpisodeRunner, "run", spent, "episodes")
        yield spent
