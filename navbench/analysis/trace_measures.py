"""Measures of how a run went rather than how it ended: from the trajectories and the trace that a controller left.

``navbench.analysis.measures`` says how measures are used, and registers these too. A column is one of a trajectory's,
such as ``v_mps``, or of the controller's trace. A spell is a run of control periods over which one holds one value.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.estimates import median_of, share_of
from navbench.analysis.stored import StoredResults, reached
from navbench.mathematics.statistics import Estimate
from navbench.validation import DescriptionError

FloatArray = NDArray[np.float64]
Select = Mapping[str, Any]


class Spell(NamedTuple):
    """A run of control periods over which a column holds one value: from ``begin`` on, ``length`` periods."""

    value: float
    begin: int
    length: int


def median_periods(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the median number of control periods of the robots that reached, with its range."""
    rows = reached(stored.select(**select)).to_dict("records")
    return median_of([len(stored.trajectory(row)) - 1 for row in rows])


def median_spread(stored: StoredResults, column: str, select: Select) -> Estimate | None:
    """Return how far a column's values lie apart in an episode, the greatest less the least: the median episode's."""
    return median_of([float(np.ptp(values)) for values in _columns(stored, column, select)])


def median_last(stored: StoredResults, column: str, select: Select) -> Estimate | None:
    """Return a column's value in the last control period: the median episode's, with the range."""
    return median_of([float(values[-1]) for values in _columns(stored, column, select)])


def share_of_periods_within(
    stored: StoredResults, columns: Sequence[str], low: float, high: float, select: Select
) -> Estimate | None:
    """Return in what share of an episode's control periods all of some columns lie within a band.

    The value is the median episode's, with the range: periods follow from one another and are no independent cases.

    Args:
        stored: the study's results.
        columns: which columns.
        low: the band's lower end, in it.
        high: the band's upper end, in it.
        select: which cells.
    """
    shares = []
    for values in zip(*(_columns(stored, column, select) for column in columns), strict=True):
        shares.append(float(np.mean(np.all([(low <= one) & (one <= high) for one in values], axis=0))))
    return median_of(shares)


def share_of_periods_changing(stored: StoredResults, column: str, by: float, select: Select) -> Estimate | None:
    """Return in what share of an episode's control periods a column differs from the one before, by more than this.

    The value is the median episode's, with the range, see ``share_of_periods_within``.
    """
    changes = [np.abs(np.diff(values)) for values in _columns(stored, column, select)]
    return median_of([float(np.mean(change > by)) for change in changes])


def share_never_rising(stored: StoredResults, column: str, slack: float, select: Select) -> Estimate | None:
    """Return the share of episodes in which a column rises from no control period to the next by more than a slack."""
    return share_of([bool((np.diff(values) <= slack).all()) for values in _columns(stored, column, select)])


def share_in_sequence(
    stored: StoredResults, column: str, values: Sequence[float], least_periods: int, select: Select
) -> Estimate | None:
    """Return the share of episodes in which a column takes just these values, one after the other.

    Args:
        stored: the study's results.
        column: the column, such as the active agent.
        values: in the order that the paper tells.
        least_periods: shorter spells do not count, and what they part is one spell.
        select: which cells.
    """
    happened = [[s.value for s in spells(found, least_periods)] for found in _columns(stored, column, select)]
    return share_of([trajectory == list(values) for trajectory in happened])


def median_changes(stored: StoredResults, column: str, select: Select) -> Estimate | None:
    """Return how often a column changes its value in an episode: the median episode's, with the range."""
    return median_of([int(np.count_nonzero(np.diff(values))) for values in _columns(stored, column, select)])


def share_jumping(
    stored: StoredResults,
    column: str,
    switched: str,
    value: float,
    least_periods: int,
    share_of_range: float,
    select: Select,
) -> Estimate | None:
    """Return at what share of the switches a column's values change by much of all that they change by in the episode.

    A switch is where a spell of one value, of some length at least, gives way to one of another. Looked at are as many
    control periods before it and after it as a spell must have.

    Args:
        stored: the study's results.
        column: the column that is said to jump.
        switched: the column whose spells are looked at, such as the active agent.
        value: only switches from or to this value of it count.
        least_periods: shorter spells do not count, see ``share_in_sequence``.
        share_of_range: this much of the episode's range, at least, is a jump.
        select: which cells.
    """
    jumps = []
    for found, agents in zip(_columns(stored, column, select), _columns(stored, switched, select), strict=True):
        for before, after in itertools.pairwise(spells(agents, least_periods)):
            if value in (before.value, after.value):
                near = found[max(after.begin - least_periods, 0) : after.begin + least_periods]
                jumps.append(bool(np.ptp(near) >= share_of_range * np.ptp(found)))
    return share_of(jumps)


def spells(values: FloatArray, least_periods: int = 1) -> list[Spell]:
    """Return the spells of a column in their order, without the short ones.

    Where a short one has parted two of the same value they count as one, which begins with the first of them.
    """
    found: list[Spell] = []
    begin = 0
    for value, run in itertools.groupby(values.tolist()):
        length = len(list(run))
        if length >= least_periods:
            if found and found[-1].value == value:
                found[-1] = found[-1]._replace(length=begin + length - found[-1].begin)
            else:
                found.append(Spell(value, begin, length))
        begin += length
    return found


def _columns(stored: StoredResults, column: str, select: Select) -> Iterator[FloatArray]:
    """Yield a column of each episode, without the row at its end, at which nothing acted any more."""
    for row in stored.select(**select).to_dict("records"):
        trajectory = stored.trajectory(row)
        if column not in trajectory.columns:
            raise DescriptionError(f"{column}: there is no such column; allowed: {', '.join(trajectory.columns)}")
        yield trajectory[column].to_numpy()[:-1]


MEASURES = (
    median_periods,
    median_spread,
    median_last,
    median_changes,
    share_of_periods_within,
    share_of_periods_changing,
    share_never_rising,
    share_in_sequence,
    share_jumping,
)
