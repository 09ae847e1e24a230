"""Measures that any study may use: functions from stored results to one figure with its interval or range.

A measure takes the stored results and keyword arguments; ``select`` and ``than`` say which cells, as a value or a list
of values for columns of the table of episodes. What only one paper's claims measure lies beside its controllers, in
``navbench.controllers.<paper>.measures``, and a user's own in any module.
"""

from collections.abc import Mapping
from typing import Any

from navbench.analysis.estimates import exact, median_of, share_of
from navbench.analysis.fleets import fleets, successes
from navbench.analysis.printed import fraction
from navbench.analysis.stored import StoredResults, outcomes, reached
from navbench.mathematics import statistics
from navbench.mathematics.statistics import Estimate, newcombe_paired, restricted_mean_difference

Select = Mapping[str, Any]


def median(stored: StoredResults, metric: str, select: Select) -> Estimate | None:
    """Return a metric's median over the robots that reached, with its range."""
    return median_of(reached(stored.cases(**select))[metric].to_numpy())


def share_reached(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the share of robots that reached their goals."""
    return share_of((stored.cases(**select)["outcome"] == "reached").to_numpy())


def share_without_collision(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the share of robots that touched nothing."""
    return share_of((stored.cases(**select)["collisions"] == 0).to_numpy())


def share_of_fleets(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the share of episodes in which all robots reached their goals."""
    return share_of(list(successes(stored.cases(**select)).values()))


def share_better(
    stored: StoredResults, metric: str, select: Select, than: Select, equal_within: float | str = 0.0
) -> Estimate | None:
    """Return the share of pairs in which one controller's metric is better than the other's.

    A pair is a world, seed, episode and robot that both meet; where one has been tuned several times, each tuning
    that is another case makes a pair. A failure counts as worse than any arrival; pairs in which both fail are left
    out.

    Args:
        stored: the study's results.
        metric: the metric's name, which is declared to be better in one direction.
        select: the cells that are said to be better.
        than: the cells that they are compared with.
        equal_within: by how much of the other's metric at most two arrivals are equal, and neither better: 0.01 or
            ``1 %``.

    Raises:
        DescriptionError: neither direction is better, or there is no such metric.
    """
    sign = stored.sign_of(metric)
    rows = stored.pairs(select, than, each=True)
    here, there = outcomes(rows).values()
    rows, here, there = rows[here | there], here[here | there], there[here | there]
    other = rows[f"{metric}_other"]
    equal = fraction("equal_within", equal_within) * other.abs()
    better = here & (~there | (sign * (other - rows[metric]) > equal).to_numpy())
    return share_of(better)


def difference(stored: StoredResults, metric: str, select: Select, than: Select) -> Estimate | None:
    """Return the paired difference of two controllers, the first less the second, with its 95 % interval.

    Args:
        stored: the study's results.
        metric: "success", of episodes in which all robots reached, and "reached", of robots: the difference of two
            shares; "time_s": of the mean times up to the time limit, failures at the limit; any other metric: the
            median difference of the pairs in which both reached.
        select: the cells of the first.
        than: the cells of the second, over the same starts.
    """
    if metric == "success":
        ours, theirs = map(fleets, stored.sides(select, than))
        pairs = ours.merge(theirs, on=["world", "seed", "episode"], suffixes=("", "_other"))
        successes = (pairs[f"success{side}"].to_numpy(dtype=bool) for side in ("", "_other"))
        return None if pairs.empty else newcombe_paired(*successes)
    pairs = stored.pairs(select, than)
    if pairs.empty:
        return None
    here, there = outcomes(pairs).values()
    if metric == "reached":
        return newcombe_paired(here, there)
    values = pairs[metric].to_numpy(), pairs[f"{metric}_other"].to_numpy()
    if metric == "time_s":
        return restricted_mean_difference(values[0], here, values[1], there, stored.shared_time_limit_s(pairs))
    both = here & there
    return statistics.median((values[0] - values[1])[both]) if both.any() else None


def described_value(stored: StoredResults, table: str, column: str, where: Select) -> Estimate | None:
    """Return the one value of a described table in the row that matches.

    Args:
        stored: the study's results.
        table: the table's name, such as "sflc-rules".
        column: which of its columns.
        where: a value for each column that tells the row.
    """
    value = stored.described_value(table, column, where)
    return exact(value)


def described_is_less(stored: StoredResults, table: str, column: str, where: Select, than: Select) -> Estimate | None:
    """Return 1 where a value of a described table is less than that in another row, see ``described_value``."""
    return share_of([stored.described_value(table, column, where) < stored.described_value(table, column, than)])
