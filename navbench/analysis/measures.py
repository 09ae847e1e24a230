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
from navbench.analysis.claims import Measured
from navbench.analysis.phases import is_within
from navbench.analysis.phases import phases as phases_of
from navbench.analysis.stored import Reading, outcomes, reached
from navbench.mathematics.statistics import newcombe_paired, restricted_mean_difference
from navbench.validation import DescriptionError
from navbench.world.world import World

Select = Mapping[str, Any]
RESAMPLING_SEED = 0  # of the bootstrap: a report is the same bytes whenever it is written


def median(reading: Reading, metric: str, select: Select) -> Measured | None:
    """Return a metric's median over the robots that reached, with its range.

    Args:
        reading: the study's results.
        metric: the metric's name.
        select: which cells.
    """
    return Measured.median(reached(reading.select(**select))[metric].to_numpy())


def median_ratio(reading: Reading, metric: str, over: str, select: Select) -> Measured | None:
    """Return the median, over the robots that reached, of one metric over another one, with its range."""
    rows = reached(reading.select(**select))
    return Measured.median((rows[metric] / rows[over]).to_numpy())


def median_over_straight(reading: Reading, select: Select) -> Measured | None:
    """Return the median of path length over the straight line from start to goal, less the goal's tolerance."""
    rows = reached(reading.select(**select))
    ratios = [
        row["path_length_m"] / _straight_m(reading.world(row["run_id"], row["episode"]), row["robot_index"])
        for row in rows.to_dict("records")
    ]
    return Measured.median(ratios)


def share_better(reading: Reading, metric: str, select: Select, than: Select) -> Measured | None:
    """Return the share of pairs in which one controller's metric is less than the other's.

    A pair is a world, seed, episode and robot that both meet; where one has been tuned several times, each tuning
    makes a pair. A failure counts as worse than any arrival; pairs in which both fail are left out.

    Args:
        reading: the study's results.
        metric: the metric's name; less is better.
        select: the cells that are said to be better.
        than: the cells that they are compared with.
    """
    rows = reading.pairs(select, than, each=True)
    here, there = rows["outcome"] == "reached", rows["outcome_other"] == "reached"
    rows, here, there = rows[here | there], here[here | there], there[here | there]
    better = here & (~there | (rows[metric] < rows[f"{metric}_other"]))
    return Measured.share(better.to_numpy())


def share_ordered(reading: Reading, metric: str, labels: Sequence[str], select: Select) -> Measured | None:
    """Return the share of worlds and tuning seeds in which a metric falls strictly from each label to the next.

    Args:
        reading: the study's results.
        metric: the metric's name.
        labels: from the one said to have the most to the one said to have the least.
        select: which cells.
    """
    rows = reached(reading.select(**select))
    table = rows.pivot_table(index=["world", "tuning_seed"], columns="label", values=metric)
    table = table.reindex(columns=list(labels)).dropna()
    values = table.to_numpy()
    return Measured.share(np.all(values[:, :-1] > values[:, 1:], axis=1))


def share_reached(reading: Reading, select: Select) -> Measured | None:
    """Return the share of robots that reached their goals."""
    return Measured.share((reading.select(**select)["outcome"] == "reached").to_numpy())


def share_with_outcome(reading: Reading, outcomes: Sequence[str], select: Select) -> Measured | None:
    """Return the share of robots with one of some outcomes."""
    return Measured.share(reading.select(**select)["outcome"].isin(list(outcomes)).to_numpy())


def share_without_collision(reading: Reading, select: Select) -> Measured | None:
    """Return the share of robots that touched nothing."""
    return Measured.share((reading.select(**select)["collisions"] == 0).to_numpy())


def share_as_good(reading: Reading, metric: str, select: Select, than: Select, margin: float) -> Measured | None:
    """Return the share of pairs in which one controller reaches where the other does, and within a margin as well.

    Args:
        reading: the study's results.
        metric: the metric's name; less is better.
        select: the cells that are said to be as good.
        than: the cells that they are compared with.
        margin: how much more is as good, as a share of the other's metric.
    """
    rows = reading.pairs(select, than, each=True)
    here, there = rows["outcome"] == "reached", rows["outcome_other"] == "reached"
    close = here & there & (rows[metric] <= (1.0 + margin) * rows[f"{metric}_other"])
    return Measured.share((close | ~there).to_numpy())


def speed_range(reading: Reading, select: Select) -> Measured | None:
    """Return the median forward speed over all control periods, with the least and the greatest [m/s]."""
    rows = reading.select(**select)
    speeds = [reading.trajectory(run_id)["v_mps"].to_numpy() for run_id in rows["run_id"].unique()]
    return Measured.median(np.concatenate(speeds))


def share_in_phases(reading: Reading, phases: Sequence[str], select: Select) -> Measured | None:
    """Return the share of episodes that go through some phases in this order, others between them or not.

    Args:
        reading: the study's results.
        phases: the phases' names (``navbench.analysis.phases``) in the order that the paper tells.
        select: which cells.
    """
    held = [
        is_within(phases, [phase.name for phase in phases_of(reading.way(row), row["outcome"])])
        for row in reading.select(**select).to_dict("records")
    ]
    return Measured.share(held)


def share_greater(reading: Reading, metric: str, select: Select, than: Select) -> Measured | None:
    """Return the share of pairs in which one controller's metric is greater than the other's, failures included.

    Args:
        reading: the study's results.
        metric: the metric's name, such as "min_clearance_m".
        select: the cells that are said to have more of it.
        than: the cells that they are compared with.
    """
    rows = reading.pairs(select, than)
    return Measured.share((rows[metric] > rows[f"{metric}_other"]).to_numpy())


def share_of_worlds_safer(reading: Reading, select: Select, than: Select) -> Measured | None:
    """Return the share of worlds in which more robots touch nothing, of the same starts, than of another controller.

    Args:
        reading: the study's results.
        select: the cells that are said to be safer.
        than: the cells that they are compared with.
    """
    rows = reading.pairs(select, than)
    free = (rows[["collisions", "collisions_other"]] == 0).groupby(rows["world"]).sum()
    return Measured.share((free["collisions"] > free["collisions_other"]).to_numpy())


def difference_in_reached(reading: Reading, select: Select, than: Select) -> Measured | None:
    """Return the paired difference of two shares that reached, with Newcombe's interval."""
    rows = reading.pairs(select, than)
    if rows.empty:
        return None
    return Measured.of(newcombe_paired(*(outcomes(rows)[side] for side in ("", "_other"))))


def difference_in_time(reading: Reading, select: Select, than: Select) -> Measured | None:
    """Return the paired difference of two mean times up to the time limit, failures at the limit [s].

    Its interval is the bootstrap's, see ``statistics.restricted_mean_difference``.
    """
    rows = reading.pairs(select, than)
    if rows.empty:
        return None
    here, there = outcomes(rows).values()
    limits_s = {reading.world(run_id).time_limit_s for run_id in {*rows["run_id"], *rows["run_id_other"]}}
    if len(limits_s) != 1:
        raise DescriptionError(f"{reading.results.path}: {select}: the worlds must share one time limit")
    times_s = rows["time_s"].to_numpy(), rows["time_s_other"].to_numpy()
    rng = np.random.default_rng(RESAMPLING_SEED)
    return Measured.of(restricted_mean_difference(times_s[0], here, times_s[1], there, limits_s.pop(), rng))


def not_comparable(reading: Reading) -> Measured | None:
    """Return nothing: for a claim that compares what cannot be compared, as its statement says."""
    return None


def median_decrease(reading: Reading, metric: str, select: Select, than: Select) -> Measured | None:
    """Return by how much a metric is less than another controller's, in percent: the median pair's, with the range.

    Pairs are those in which both reached; where one has been tuned several times, each tuning makes a pair. An
    increase is negative.

    Args:
        reading: the study's results.
        metric: the metric's name.
        select: the cells that are said to have less.
        than: the cells that they are compared with.
    """
    rows = reading.pairs(select, than, each=True)
    rows = rows[np.logical_and(*outcomes(rows).values())]
    return Measured.median(100.0 * (1.0 - rows[metric] / rows[f"{metric}_other"]))


def least_cost(reading: Reading, tunings: Sequence[str]) -> Measured | None:
    """Return the median, over some tunings and their seeds, of the least cost that was found, with its range."""
    rows = reading.evaluations
    costs = rows[rows["name"].isin(list(tunings))].groupby(["name", "seed"])["cost"].min()
    return Measured.median(costs.to_numpy())


def share_at_bound(reading: Reading, parameter: str, tunings: Sequence[str]) -> Measured | None:
    """Return the share of some tunings whose best value of a parameter lies within 1 % of the range at its upper end.

    Args:
        reading: the study's results.
        parameter: the parameter that was searched.
        tunings: the tunings' names.
    """
    rows = reading.evaluations
    best = rows.loc[rows[rows["name"].isin(list(tunings))].groupby(["name", "seed"])["cost"].idxmin()]
    tunable = next(t for t in reading.manifest["tunings"] if t["name"] in tunings)["configuration"]["tunable"]
    low, high = tunable[parameter]["low"], tunable[parameter]["high"]
    return Measured.share((best[parameter] >= high - 0.01 * (high - low)).to_numpy())


def measure(reading: Reading, name: str, arguments: Mapping[str, Any]) -> Measured | None:
    """Return what a named measure says."""
    found: Measured | None = MEASURES[name](reading, **arguments)
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


MEASURES: Mapping[str, Callable[..., Measured | None]] = {
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
