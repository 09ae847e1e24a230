"""How everything is measured: sides in turn, CPU time, and the median of the ratios of one round's sides."""

import gc
import math
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import NamedTuple

import numpy as np

from navbench.mathematics import statistics
from navbench.mathematics.statistics import Estimate

Side = Callable[[], float]  # does some work, and returns how much
Sides = Mapping[str, Side | str]  # or a word on why it cannot
Cell = str | float | Estimate


class Effort(NamedTuple):
    """How long to measure.

    Attributes:
        rounds: how often every side is measured, in turn.
        seconds: of CPU time that a side takes at least each time.
        is_quick: whether sizes are cut to what only shows that everything runs.
    """

    rounds: int = 7
    seconds: float = 0.5
    is_quick: bool = False

    def cut(self, size: int, least: int = 2) -> int:
        """Return a size, or a hundredth of it when quick."""
        return max(least, size // 100) if self.is_quick else size

    def few(self, count: int) -> int:
        """Return how many of some things to measure: all, or the first one when quick."""
        return 1 if self.is_quick else count


class Table(NamedTuple):
    """What one section found; a cell is a word, a figure, or a figure with its interval."""

    title: str
    text: str
    header: tuple[str, ...]
    rows: list[tuple[Cell, ...]]

    def figures(self) -> list[float]:
        """Return every number in the table."""
        cells = [cell for row in self.rows for cell in row if not isinstance(cell, str)]
        return [x for cell in cells for x in (told(cell) if isinstance(cell, Estimate) else [cell])]

    def markdown(self) -> str:
        """Return the table as Markdown, with its title and text."""
        rows = [self.header, ["---"] + ["---:"] * (len(self.header) - 1), *([shown(c) for c in r] for r in self.rows)]
        return "\n".join([f"## {self.title}\n", f"{self.text}\n", *(f"| {' | '.join(row)} |" for row in rows), ""])


def told(estimate: Estimate) -> tuple[float, ...]:
    """Return a figure and its limits, where it has any."""
    return estimate[:1] if math.isnan(estimate.low) else estimate[:3]


def shown(cell: Cell) -> str:
    """Return a cell's text: three digits, and the interval in brackets."""
    if isinstance(cell, str):
        return cell
    if isinstance(cell, Estimate):
        value, *limits = map(shown, told(cell))
        return f"{value} [{', '.join(limits)}]" if limits else value
    digits = 2 - math.floor(math.log10(abs(cell))) if cell else 0
    return f"{round(cell, digits):,.{max(digits, 0)}f}"


def median(values: list[float]) -> Estimate:
    """Return the median with its 95 % interval, of 6 values or more."""
    return statistics.median(np.array(values))


def rates(
    sides: Mapping[str, Side], effort: Effort, clock: Callable[[], float] = time.process_time
) -> dict[str, list[float]]:
    """Return how much each side does in a second, once a round; a first, uncounted run lets it compile.

    Args:
        sides: what to measure.
        effort: how long.
        clock: of CPU time, or the clock on the wall where other processes work.
    """
    for run in sides.values():
        run()
    found: dict[str, list[float]] = {name: [] for name in sides}
    for _ in range(effort.rounds):
        for name, run in sides.items():
            gc.collect()
            done, taken, begin = 0.0, 0.0, clock()
            while taken < effort.seconds:
                done += run()
                taken = clock() - begin
            found[name].append(done / taken)
    return found


def compare(
    title: str, text: str, unit: str, groups: Mapping[str, Callable[[ExitStack], Sides]], effort: Effort
) -> Table:
    """Measure some groups of sides, one group after another.

    Args:
        title: the table's.
        text: what it shows.
        unit: what is counted, such as "robot-steps".
        groups: how to make each group's sides; what must be closed afterwards goes on the stack. The first side is the
            one that the others are divided by.
        effort: how long to measure.
    """
    rows: list[tuple[Cell, ...]] = []
    for group, make in groups.items():
        with ExitStack() as stack:
            sides = make(stack)
            found = rates({name: side for name, side in sides.items() if not isinstance(side, str)}, effort)
        first = next(iter(found.values()), [])
        for name, side in sides.items():
            if isinstance(side, str):
                rows.append((group, name, side, ""))
                continue
            ratio = median([one / of for one, of in zip(found[name], first, strict=True)])
            rows.append((group, name, float(np.median(found[name])), ratio))
    return Table(title, text, ("", "side", f"{unit} a CPU-second", "ratio to the first side"), rows)


def peer(make: Callable[[], Side]) -> Side | str:
    """Return a peer's side, or that it is not there."""
    try:
        return make()
    except ImportError as error:
        return f"missing: {error}"
