"""Reconstructions: a study's cells as another reader might have rebuilt them, and what its claims say of each.

A point u in [0, 1]^d stands for one reconstruction: a coordinate for each factor of the cells, for the seed of each
tuning whose parameters they take, and for each argument of a claim's measure of which more than one value is
plausible. A value that a cell's own overrides set is that cell's purpose, and stays.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.claims import Claim, Entry
from navbench.analysis.factors import Factor, apply, bounds_at
from navbench.analysis.measuring import MeasureError
from navbench.analysis.multiverse import Multiverse
from navbench.analysis.shares import CHAOTIC, FAILS, HOLDS, PARTLY, UNKNOWN
from navbench.analysis.verdicts import figure_of, verdict
from navbench.cli.rebuilding import Made, between, made_part, moved, rebuilt
from navbench.cli.sample import Offered, Places, Sample
from navbench.episode.loop import EpisodeRunner
from navbench.experiments.cells import Cell
from navbench.mathematics.statistics import Estimate
from navbench.records import CellKey, RobotRecord
from navbench.tuning.space import Side
from navbench.validation import DescriptionError

CODES = {"reproduced": HOLDS, "partly": PARTLY, "not_testable": CHAOTIC}


@dataclass(frozen=True, slots=True)
class Choice:
    """A factor that is no source's: the seed of a tuning, or what a claim's measure might plausibly take.

    Attributes:
        name: such as "pso.seed" or "slows.within_s".
        of: the claim's name; empty of tunings.
        word: "seed", or the argument.
        values: what it may be, the nominal one first.
    """

    name: str
    of: str
    word: str
    values: tuple[Any, ...]

    def at(self, u: float) -> Any:
        """Return what it is at a place in [0, 1]."""
        return self.values[min(int(u * len(self.values)), len(self.values) - 1)]


class Part(NamedTuple):
    """A part of cells: the configuration of a controller, world, robot, sensor suite or simulator.

    Attributes:
        part: which of these.
        thing: what it is called, such as "sflc".
        configuration: its plain values.
        factors: the places among all dimensions of those that move it.
        own: the dotted places of the values that its cells' overrides set.
    """

    part: str
    thing: str
    configuration: Mapping[str, Any]
    factors: tuple[int, ...]
    own: frozenset[str]


class Drawn(NamedTuple):
    """A cell that is drawn anew in each reconstruction.

    Attributes:
        cell: as its study has it; of a tuned one with its controller's own parameters.
        parts: the places of its parts.
        gains: for each seed of its tuning the parameters that it takes from it.
        searched: what that tuning searched, by name.
    """

    cell: Cell
    parts: tuple[int, ...]
    gains: Mapping[int, Mapping[str, Any]]
    searched: Mapping[str, Side]


class Told(NamedTuple):
    """What the claims say of one reconstruction, in their order.

    Attributes:
        codes: (n,) HOLDS, FAILS, PARTLY, CHAOTIC, or UNKNOWN without a case.
        values: (n,) what was measured.
        counts: (n,) over how many cases.
        episodes: how many were run.
        steps: of all robots.
        possible: whether such cells can be made; without, no claim has a case.
    """

    codes: NDArray[np.int8]
    values: NDArray[np.float64]
    counts: NDArray[np.int32]
    episodes: int
    steps: int
    possible: bool = True

    def copy_from(self, other: "Told", claims: Sequence[int]) -> None:
        """Say of some claims what another one says."""
        self.codes[claims], self.values[claims], self.counts[claims] = (
            other.codes[claims], other.values[claims], other.counts[claims],
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Reconstructions:
    """All reconstructions of a study, ready to be run one by one.

    Attributes:
        study: its name, title and claims as plain values.
        cells: those that its claims use.
        parts: of these cells.
        factors: of these parts.
        choices: further ones, after the factors.
        claims: what is asked of each reconstruction: what makes it admissible, then the study's claims.
        multiverse: what the study says of it.
        uses: for each claim the places of its cells.
        episodes: how many a cell runs at first, and how many where a claim is not decided by these.
        places, offered: what samples remember of one another, see ``Sample``.
    """

    study: Mapping[str, Any]
    cells: tuple[Drawn, ...]
    parts: tuple[Part, ...]
    factors: tuple[Factor, ...]
    choices: tuple[Choice, ...]
    claims: tuple[Entry, ...]
    multiverse: Multiverse
    uses: tuple[frozenset[int], ...]
    episodes: tuple[int, ...]
    places: Places = field(default_factory=dict, repr=False, compare=False)
    offered: Offered = field(default_factory=dict, repr=False, compare=False)

    def __str__(self) -> str:
        """Return what a message calls them."""
        return f"a reconstruction of {self.study['name']}"

    @property
    def foreign(self) -> frozenset[str]:
        """What their cells run that is not navbench's own, by name."""
        return frozenset().union(*(one.cell.foreign for one in self.cells))

    @property
    def names(self) -> list[str]:
        """The names of all dimensions, factors first."""
        return [*(factor.name for factor in self.factors), *(choice.name for choice in self.choices)]

    @cached_property
    def touched(self) -> list[frozenset[int]]:
        """For each dimension the places of the claims that it may change."""
        found = []
        for i in range(len(self.factors)):
            found.append(self._using({k for k, one in enumerate(self.cells) if self._is_moved(one, i)}))
        for choice in self.choices:
            tuned = set() if choice.of else {k for k, one in enumerate(self.cells) if one.cell.tuning}
            own = {k for k, entry in enumerate(self.claims) if entry.name == choice.of}
            found.append(self._using(tuned) | own)
        return found

    @property
    def reaches(self) -> dict[str, list[int]]:
        """For each claim the dimensions that may change it."""
        return {
            entry.name: [i for i, claims in enumerate(self.touched) if k in claims]
            for k, entry in enumerate(self.claims)
        }

    def _is_moved(self, one: Drawn, factor: int) -> bool:
        """Return whether a factor may change a cell: more than what that sets itself or takes from its tuning."""
        parts = [part for part in map(self.parts.__getitem__, one.parts) if factor in part.factors]
        moving = self.factors[factor]
        if one.cell.tuning and parts and bounds_at([(moving, 0.5)]):
            return True
        tuned = {f"controller.build.{name}" for gains in one.gains.values() for name in gains}
        places = (set(apply(moving, 0.5, {part.part: part.configuration})) - part.own for part in parts)
        return any(of - tuned for of in places)

    def _using(self, cells: set[int]) -> frozenset[int]:
        return frozenset(k for k, used in enumerate(self.uses) if used & cells)

    def tell(self, u: NDArray[np.float64] | None) -> Told:
        """Run a reconstruction and return what the claims say of it.

        Args:
            u: (d,) where it lies in the range of each dimension; None for the study's own.
        """
        return _Run(self, u).tell(range(len(self.claims)))

    def nothing(self, *, possible: bool) -> Told:
        """Return that the claims say nothing."""
        count = len(self.claims)
        return Told(np.full(count, UNKNOWN, np.int8), np.full(count, np.nan), np.zeros(count, np.int32), 0, 0, possible)

    def unmeasured(self) -> dict[str, str]:
        """Return why some claims cannot be measured of the study's own reconstruction, by their names."""
        run = _Run(self, None)
        run.tell(range(len(self.claims)))
        return run.errors

    def tell_changed(
        self, u: NDArray[np.float64], others: NDArray[np.float64], claims: Collection[str]
    ) -> Iterator[tuple[int, Told]]:
        """Run a reconstruction, and again with each dimension moved alone; yield (-1, all) and then (dimension, Told).

        What moving a dimension does not change is not run again, and its codes are those of the first. A dimension
        that no claim hangs on is left out.

        Args:
            u: (d,) where it lies.
            others: (d,) to where each dimension is moved.
            claims: the names of those that are asked.
        """
        asked = {k for k, entry in enumerate(self.claims) if entry.name in claims}
        first = _Run(self, u)
        told = first.tell(sorted(asked))
        yield -1, told
        for i, touched in enumerate(self.touched):
            if touched & asked:
                moved = u.copy()
                moved[i] = others[i]
                changed = _Run(self, moved, first if told.possible else None).tell(sorted(touched & asked))
                changed.copy_from(told, sorted(asked - touched))
                yield i, changed


@dataclass(slots=True)
class _CellRun:
    """The episodes of one cell in one reconstruction."""

    cell: Cell
    key: CellKey
    records: list[list[tuple[int, RobotRecord]]] = field(default_factory=list)
    runner: EpisodeRunner | None = None

    def extend(self, count: int) -> list[RobotRecord]:
        """Run episodes until there are so many, as far as the cell has them; return what the new ones left."""
        runner = self.runner = self.runner or self.cell.runner()
        new = [[(episode, record) for record in runner.run(episode)] for episode in self._todo(count)]
        self.records += new
        return [record for episode in new for _, record in episode]

    def _todo(self, count: int) -> range:
        return self.cell.indices[len(self.records) : count]


class _Run:
    """One reconstruction under way.

    Args:
        of: which it is one of.
        u: where it lies; None for the study's own.
        first: another one, of which all is taken that is the same.
    """

    def __init__(self, of: Reconstructions, u: NDArray[np.float64] | None, first: "_Run | None" = None) -> None:
        self.of, self.u, self._first = of, u, first
        self.told = of.nothing(possible=True)
        self.errors: dict[str, str] = {}  # why a claim could not be measured, by its name
        self._runs: dict[int, _CellRun] = {}
        self._made: dict[int, Made] = {}
        self.episodes = self.steps = 0

    def tell(self, claims: Sequence[int]) -> Told:
        """Return what some claims say; where no such cells can be made, as of a robot in a wall, they say nothing."""
        try:
            self.told = self._tell(claims)
        except DescriptionError:
            self.told = self.of.nothing(possible=False)
        return self.told

    def _tell(self, claims: Sequence[int]) -> Told:
        of = self.of
        told = of.nothing(possible=True)
        open_claims, before = [k for k in claims if not self._take_over(k, told)], 0
        for size in of.episodes:
            open_claims = [k for k in open_claims if any(of.cells[i].cell.episodes > before for i in of.uses[k])]
            for index in sorted({i for k in open_claims for i in of.uses[k]}):
                self._extend(index, size)
            runs = self._runs.values()
            there = [(run.cell, run.key, [pair for one in run.records[:size] for pair in one]) for run in runs]
            sample = Sample(of.study, there, of.places, of.offered)
            open_claims, before = [k for k in open_claims if not self._judge(sample, k, told)], size
        return told._replace(episodes=self.episodes, steps=self.steps)

    def _take_over(self, index: int, told: Told) -> bool:
        """Keep what the first run says of a claim, and return whether it does: all that the claim hangs on is there."""
        first, name = self._first, self.of.claims[index].name
        if first is None or self._chosen(name) != first._chosen(name):
            return False
        same = all(map(self._is_same, self.of.uses[index]))
        if same:
            told.copy_from(first.told, [index])
        return same

    def _is_same(self, index: int) -> bool:
        """Return whether a cell is the same in the first run."""
        first, drawn = self._first, self.of.cells[index]
        if first is None:
            return False
        if drawn.cell.tuning and (self._chosen(""), self._bounds(drawn)) != (first._chosen(""), first._bounds(drawn)):
            return False
        return all(self._part(place) is first._part(place) for place in drawn.parts)

    def _extend(self, index: int, size: int) -> None:
        """Run a cell's episodes up to a size."""
        if index not in self._runs and self._first is not None and self._is_same(index):
            self._runs[index] = self._first._runs[index]
        elif index not in self._runs:
            cell = self._cell(index)
            self._runs[index] = _CellRun(cell, cell.key())
        records = self._runs[index].extend(size)
        self.episodes += sum(record.robot_index == 0 for record in records)
        self.steps += sum(len(record.states) - 1 for record in records)

    def _judge(self, sample: Sample, index: int, told: Told) -> bool:
        """Hold a claim against the sample, keep what it says, and return whether more episodes can change it little."""
        entry = self.of.claims[index]
        claim = entry.claim
        try:
            figure = figure_of(sample, claim, {**(claim.of or {}), **self._chosen(entry.name)}, trust=True)
        except MeasureError as error:
            self.errors[entry.name] = str(error)
            return False
        if figure is None:
            return False
        told.values[index], told.counts[index] = figure.value, figure.n
        told.codes[index] = code = _code(claim, figure)
        ends = (Estimate(end, end, end, figure.n) for end in (figure.low, figure.high) if math.isfinite(end))
        return all(_code(claim, end) == code for end in ends)

    def _cell(self, index: int) -> Cell:
        """Return a cell as this reconstruction has it."""
        drawn = self.of.cells[index]
        cell = rebuilt(drawn.cell, {self.of.parts[place].part: self._part(place) for place in drawn.parts})
        if cell.tuning:
            seed = self._chosen("").get("seed", min(drawn.gains))
            seed = seed if seed in drawn.gains else min(drawn.gains)
            gains = between(drawn.gains[seed], drawn.searched, self._bounds(drawn))
            cell = replace(cell.with_parameters(gains), tuning_seed=seed)
        return cell

    def _bounds(self, drawn: Drawn) -> dict[str, dict[str, float]]:
        """Return which bounds of a cell's tuning are others in this reconstruction."""
        if self.u is None:
            return {}
        moving = {i for place in drawn.parts for i in self.of.parts[place].factors}
        return bounds_at((self.of.factors[i], float(self.u[i])) for i in sorted(moving))

    def _chosen(self, of: str) -> dict[str, Any]:
        """Return what was chosen for a claim, or of the tunings, by its word."""
        if self.u is None:
            return {}
        places = zip(self.of.choices, self.u[len(self.of.factors) :], strict=True)
        return {choice.word: choice.at(float(u)) for choice, u in places if choice.of == of}

    def _part(self, index: int) -> Made:
        """Return what is made of a part in this reconstruction: that of the first run where it is the same."""
        if index not in self._made:
            one, first = self.of.parts[index], None if self._first is None else self._first._part(index)
            moving = [] if self.u is None else [(self.of.factors[i], float(self.u[i])) for i in one.factors]
            values = moved(one.part, one.configuration, moving, one.own)
            if first is None or first.values != values:
                first = made_part(one.part, one.thing, values)
            self._made[index] = first
        return self._made[index]


def _code(claim: Claim, figure: Estimate) -> int:
    """Return what a figure says of a claim; of a hypothesis the side on which it lies, for its cases are few."""
    if claim.threshold is not None:
        side, number = claim.threshold
        return HOLDS if (figure.value < number if side == "below" else figure.value > number) else FAILS
    return CODES.get(verdict(claim, figure)[0], FAILS)
