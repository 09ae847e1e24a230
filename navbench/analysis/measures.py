"""How claims are measured: functions by name, each from stored results to one figure with its interval or range.

A study's file names a function here and gives its arguments; there is no code in a configuration. Where an argument
selects cells, it is a mapping from columns of the episodes' table (name, label, world, ...) to a value or a list.
"""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from navbench.analysis import description_measures, fleet_measures, path_measures, trace_measures
from navbench.analysis.estimates import median_of, share_of
from navbench.analysis.phases import is_within
from navbench.analysis.phases import phases as phases_of
from navbench.analysis.stored import StoredResults, outcomes, reached
from navbench.mathematics.statistics import Estimate, newcombe_paired, restricted_mean_difference
from navbench.validation import DescriptionError
from navbench.world.world import World

Select = Mapping[str, Any]
RESAMPLING_SEED = 0  # of the bootstrap: a report is the same bytes whenever it is written


def median(stored: StoredResults, metric: str, select: Select) -> Estimate | None:
    """Return a metric's median over the robots that reached, with its range.

    Args:
        stored: the study's results.
        metric: the metric's name.
        select: which cells.
    """
    return median_of(reached(stored.select(**select))[metric].to_numpy())


def median_ratio(stored: StoredResults, metric: str, over: str, select: Select) -> Estimate | None:
    """Return the median, over the robots that reached, of one metric over another one, with its range."""
    rows = reached(stored.select(**select))
    return median_of((rows[metric] / rows[over]).to_numpy())


def median_over_straight(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the median of path length over the straight line from start to goal, less the goal's tolerance."""
    rows = reached(stored.select(**select))
    ratios = [
        row["path_length_m"] / _straight_m(stored.world(row["run_id"], row["episode"]), row["robot_index"])
        for row in rows.to_dict("records")
    ]
    return median_of(ratios)


def share_better(stored: StoredResults, metric: str, select: Select, than: Select) -> Estimate | None:
    """Return the share of pairs in which one controller's metric is less than the other's.

    A pair is a world, seed, episode and robot that both meet; where one has been tuned several times, each tuning
    makes a pair. A failure counts as worse than any arrival; pairs in which both fail are left out.

    Args:
        stored: the study's results.
        metric: the metric's name; less is better.
        select: the cells that are said to be better.
        than: the cells that they are compared with.
    """
    rows = stored.pairs(select, than, each=True)
    here, there = rows["outcome"] == "reached", rows["outcome_other"] == "reached"
    rows, here, there = rows[here | there], here[here | there], there[here | there]
    better = here & (~there | (rows[metric] < rows[f"{metric}_other"]))
    return share_of(better.to_numpy())


def share_ordered(stored: StoredResults, metric: str, labels: Sequence[str], select: Select) -> Estimate | None:
    """Return the share of worlds and tuning seeds in which a metric falls strictly from each label to the next.

    Args:
        stored: the study's results.
        metric: the metric's name.
        labels: from the one said to have the most to the one said to have the least.
        select: which cells.
    """
    rows = reached(stored.select(**select))
    table = rows.pivot_table(index=["world", "tuning_seed"], columns="label", values=metric)
    table = table.reindex(columns=list(labels)).dropna()
    values = table.to_numpy()
    return share_of(np.all(values[:, :-1] > values[:, 1:], axis=1))


def share_reached(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the share of robots that reached their goals."""
    return share_of((stored.select(**select)["outcome"] == "reached").to_numpy())


def share_with_outcome(stored: StoredResults, outcomes: Sequence[str], select: Select) -> Estimate | None:
    """Return the share of robots with one of some outcomes."""
    return share_of(stored.select(**select)["outcome"].isin(list(outcomes)).to_numpy())


def share_without_collision(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the share of robots that touched nothing."""
    return share_of((stored.select(**select)["collisions"] == 0).to_numpy())


def share_as_good(stored: StoredResults, metric: str, select: Select, than: Select, margin: float) -> Estimate | None:
    """Return the share of pairs in which one controller reaches where the other does, and within a margin as well.

    Args:
        stored: the study's results.
        metric: the metric's name; less is better.
        select: the cells that are said to be as good.
        than: the cells that they are compared with.
        margin: how much more is as good, as a share of the other's metric.
    """
    rows = stored.pairs(select, than, each=True)
    here, there = rows["outcome"] == "reached", rows["outcome_other"] == "reached"
    close = here & there & (rows[metric] <= (1.0 + margin) * rows[f"{metric}_other"])
    return share_of((close | ~there).to_numpy())


def speed_range(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the median forward speed over all control periods, with the least and the greatest [m/s]."""
    rows = stored.select(**select)
    speeds = [stored.trajectories(run_id)["v_mps"].to_numpy() for run_id in rows["run_id"].unique()]
    return median_of(np.concatenate(speeds))


def share_in_phases(stored: StoredResults, phases: Sequence[str], select: Select) -> Estimate | None:
    """Return the share of episodes that go through some phases in this order, others between them or not.

    Args:
        stored: the study's results.
        phases: the phases' names (``navbench.analysis.phases``) in the order that the paper tells.
        select: which cells.
    """
    held = [
        is_within(phases, [phase.name for phase in phases_of(stored.trajectory(row), row["outcome"])])
        for row in stored.select(**select).to_dict("records")
    ]
    return share_of(held)


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


def share_of_worlds_safer(stored: StoredResults, select: Select, than: Select) -> Estimate | None:
    """Return the share of worlds in which more robots touch nothing, of the same starts, than of another controller.

    Args:
        stored: the study's results.
        select: the cells that are said to be safer.
        than: the cells that they are compared with.
    """
    rows = stored.pairs(select, than)
    free = (rows[["collisions", "collisions_other"]] == 0).groupby(rows["world"]).sum()
    return share_of((free["collisions"] > free["collisions_other"]).to_numpy())


def difference_in_reached(stored: StoredResults, select: Select, than: Select) -> Estimate | None:
    """Return the paired difference of two shares that reached, with Newcombe's interval."""
    rows = stored.pairs(select, than)
    if rows.empty:
        return None
    return newcombe_paired(*(outcomes(rows)[side] for side in ("", "_other")))


def difference_in_time(stored: StoredResults, select: Select, than: Select) -> Estimate | None:
    """Return the paired difference of two mean times up to the time limit, failures at the limit [s].

    Its interval is the bootstrap's, see ``statistics.restricted_mean_difference``.
    """
    rows = stored.pairs(select, than)
    if rows.empty:
        return None
    here, there = outcomes(rows).values()
    limits_s = {stored.world(run_id).time_limit_s for run_id in {*rows["run_id"], *rows["run_id_other"]}}
    if len(limits_s) != 1:
        raise DescriptionError(f"{stored.results.path}: {select}: the worlds must share one time limit")
    times_s = rows["time_s"].to_numpy(), rows["time_s_other"].to_numpy()
    rng = np.random.default_rng(RESAMPLING_SEED)
    return restricted_mean_difference(times_s[0], here, times_s[1], there, limits_s.pop(), rng)


def not_comparable(stored: StoredResults) -> Estimate | None:
    """Return nothing: for a claim that compares what cannot be compared, as its statement says."""
    return None


def median_decrease(stored: StoredResults, metric: str, select: Select, than: Select) -> Estimate | None:
    """Return by how much a metric is less than another controller's, in percent: the median pair's, with the range.

    Pairs are those in which both reached; where one has been tuned several times, each tuning makes a pair. An
    increase is negative.

    Args:
        stored: the study's results.
        metric: the metric's name.
        select: the cells that are said to have less.
        than: the cells that they are compared with.
    """
    rows = stored.pairs(select, than, each=True)
    rows = rows[np.logical_and(*outcomes(rows).values())]
    return median_of(100.0 * (1.0 - rows[metric] / rows[f"{metric}_other"]))


def least_cost(stored: StoredResults, tunings: Sequence[str]) -> Estimate | None:
    """Return the median, over some tunings and their seeds, of the least cost that was found, with its range."""
    rows = stored.evaluations
    costs = rows[rows["name"].isin(list(tunings))].groupby(["name", "seed"])["cost"].min()
    return median_of(costs.to_numpy())


def share_at_bound(stored: StoredResults, parameter: str, tunings: Sequence[str]) -> Estimate | None:
    """Return the share of some tunings whose best value of a parameter lies within 1 % of the range at its upper end.

    Args:
        stored: the study's results.
        parameter: the parameter that was searched.
        tunings: the tunings' names.
    """
    rows = stored.evaluations
    best = rows.loc[rows[rows["name"].isin(list(tunings))].groupby(["name", "seed"])["cost"].idxmin()]
    tunable = next(t for t in stored.manifest["tunings"] if t["name"] in tunings)["configuration"]["tunable"]
    low, high = tunable[parameter]["low"], tunable[parameter]["high"]
    return share_of((best[parameter] >= high - 0.01 * (high - low)).to_numpy())


def measure(stored: StoredResults, name: str, arguments: Mapping[str, Any]) -> Estimate | None:
    """Return what a named measure says."""
    found: Estimate | None = MEASURES[name](stored, **arguments)
    return found


def check_measure(key: str, spec: Mapping[str, Any]) -> None:
    """Check that a claim's measure exists and takes these arguments.

    Raises:
        DescriptionError: it does not; the message names what is allowed.
    """
    name = str(spec.get("name"))
    if name not in MEASURES:
        raise DescriptionError(f"{key}.name={name!r}: there is no such measure; allowed: {', '.join(MEASURES)}")
    allowed = list(inspect.signature(MEASURES[name]).parameters)[1:]
    for given in spec:
        if given != "name" and given not in allowed:
            raise DescriptionError(f"{key}.{given}: unknown key; {name} takes {', '.join(allowed)}")
    for needed in allowed:
        if needed not in spec:
            raise DescriptionError(f"{key}.{needed}: missing; {name} takes {', '.join(allowed)}")


def _straight_m(world: World, robot_index: int) -> float:
    start, goal = world.starts[robot_index], world.goals[robot_index]
    return math.hypot(goal.x_m - start.x_m, goal.y_m - start.y_m) - world.goal_tolerance_m


MEASURES: Mapping[str, Callable[..., Estimate | None]] = {
    function.__name__: function
    for function in (
        median,
        median_ratio,
        median_over_straight,
        share_better,
        share_ordered,
        share_reached,
        share_with_outcome,
        share_without_collision,
        share_as_good,
        share_greater,
        share_of_worlds_safer,
        speed_range,
        share_in_phases,
        difference_in_reached,
        difference_in_time,
        not_comparable,
        median_decrease,
        least_cost,
        share_at_bound,
        *description_measures.MEASURES,
        *trace_measures.MEASURES,
        *path_measures.MEASURES,
        *fleet_measures.MEASURES,
    )
}
