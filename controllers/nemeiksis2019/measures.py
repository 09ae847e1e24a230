"""What only the claims about nemeiksis2019 measure: how agents take turns in a run, and how steadily it goes."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.estimates import exact, median_of, share_of, share_of_parts
from navbench.analysis.printed import band
from navbench.analysis.stored import StoredResults, reached
from navbench.analysis.traces import columns_of, records_of, spells
from navbench.contract import FloatArray
from navbench.controllers.nemeiksis2019.switch import pattern_of
from navbench.mathematics.statistics import Estimate

Select = Mapping[str, Any]


def median_periods(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the median number of control periods of the robots that reached, with its range."""
    rows = records_of(reached(stored.cases(**select)))
    return median_of([len(stored.trajectory(row)) - 1 for row in rows])


def median_spread(stored: StoredResults, column: str, select: Select) -> Estimate | None:
    """Return how far a column's values lie apart in an episode, the greatest less the least: the median episode's."""
    return median_of([float(np.ptp(values)) for values in columns_of(stored, column, select)])


def median_last(stored: StoredResults, column: str, select: Select) -> Estimate | None:
    """Return a column's value in the last control period: the median episode's, with the range."""
    return median_of([float(values[-1]) for values in columns_of(stored, column, select)])


def median_extreme(
    stored: StoredResults, columns: Sequence[str], end: Literal["least", "greatest"], select: Select
) -> Estimate | None:
    """Return the least or the greatest value of some columns in an episode: the median episode's, with the range."""
    reduce = {"least": np.min, "greatest": np.max}[end]
    episodes = zip(*(columns_of(stored, column, select) for column in columns), strict=True)
    return median_of([float(reduce(np.concatenate(values))) for values in episodes])


def share_of_periods_within(
    stored: StoredResults, columns: Sequence[str], low: float | str, high: float | str, select: Select
) -> Estimate | None:
    """Return in what share of an episode's control periods all of some columns lie within a band.

    The value is the median episode's, with the range: periods follow from one another and are no independent cases.

    Args:
        stored: the study's results.
        columns: which columns.
        low: the band's lower end, in it; in quotes as it is printed, so that "0.30" stands for 0.295.
        high: the band's upper end, likewise: "0.35" stands for 0.355.
        select: which cells.
    """
    shares, (least, most) = [], band(low, high)
    for values in zip(*(columns_of(stored, column, select) for column in columns), strict=True):
        shares.append(float(np.mean(np.all([(least <= one) & (one <= most) for one in values], axis=0))))
    return median_of(shares)


def share_of_periods_changing(stored: StoredResults, column: str, by: float, select: Select) -> Estimate | None:
    """Return in what share of an episode's control periods a column differs from the one before, by more than this.

    The value is the median episode's, with the range, see ``share_of_periods_within``.
    """
    changes = [np.abs(np.diff(values)) for values in columns_of(stored, column, select)]
    return median_of([float(np.mean(change > by)) for change in changes])


def share_of_changes_while(
    stored: StoredResults, column: str, by: float, active: str, value: float, select: Select
) -> Estimate | None:
    """Return what share of a column's changes begins or ends in control periods in which another has a value.

    The value is the median episode's, with the range; episodes without a change are left out.

    Args:
        stored: the study's results.
        column: the column.
        by: a change is more than this.
        active: the other column, such as the active agent.
        value: its value.
        select: which cells.
    """
    holds = [others == value for others in columns_of(stored, active, select)]
    return _share_of_changes(columns_of(stored, column, select), by, holds)


def share_of_changes_seen(
    stored: StoredResults, column: str, by: float, sensors: Sequence[int], select: Select
) -> Estimate | None:
    """Return what share of a column's changes begins or ends in control periods in which one of some sensors sees.

    As ``share_of_changes_while``; the sensors are by their numbers in the paper.
    """
    seen = [pattern.astype(int) & pattern_of(sensors) != 0 for pattern in columns_of(stored, "pattern", select)]
    return _share_of_changes(columns_of(stored, column, select), by, seen)


def _share_of_changes(columns: Iterable[FloatArray], by: float, holds: Iterable[NDArray[np.bool_]]) -> Estimate | None:
    """Return what share of the changes by more than this begins or ends where something holds: the median episode's."""
    shares = []
    for found, there in zip(columns, holds, strict=True):
        changes = np.abs(np.diff(found)) > by
        if changes.any():
            shares.append(float(np.mean((there[1:] | there[:-1])[changes])))
    return median_of(shares)


def share_never_rising(stored: StoredResults, column: str, slack: float, select: Select) -> Estimate | None:
    """Return the share of episodes in which a column rises from no control period to the next by more than a slack."""
    return share_of([bool((np.diff(values) <= slack).all()) for values in columns_of(stored, column, select)])


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
    happened = [[s.value for s in spells(found, least_periods)] for found in columns_of(stored, column, select)]
    return share_of([trajectory == list(values) for trajectory in happened])


def median_changes(stored: StoredResults, column: str, select: Select) -> Estimate | None:
    """Return how often a column changes its value in an episode: the median episode's, with the range."""
    return median_of([int(np.count_nonzero(np.diff(values))) for values in columns_of(stored, column, select)])


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
    for found, agents in zip(columns_of(stored, column, select), columns_of(stored, switched, select), strict=True):
        for before, after in itertools.pairwise(spells(agents, least_periods)):
            if value in (before.value, after.value):
                jumps.append(change_near(found, after.begin, least_periods) >= share_of_range * np.ptp(found))
    return share_of_parts(jumps)


def change_near(values: FloatArray, period: int, within: int) -> float:
    """Return how far values lie apart from some control periods before one to as many from it on."""
    return float(np.ptp(values[max(period - within, 0) : period + within]))


def share_greater(stored: StoredResults, metric: str, select: Select, than: Select) -> Estimate | None:
    """Return the share of pairs in which one controller's metric is greater than the other's, failures included.

    Args:
        stored: the study's results.
        metric: the metric's name, such as "min_clearance_m".
        select: the cells that are said to have more of it.
        than: the cells that they are compared with.
    """
    rows = stored.pairs(select, than)
    return share_of((rows[metric] > rows[f"{metric}_other"]).to_numpy())


def described_count(stored: StoredResults, table: str, where: Select) -> Estimate | None:
    """Return how many rows of a described table match, a value for each column; its n is how many there are."""
    return exact(len(stored.described_rows(table, where)), len(stored.described(table)))
