"""How claims are measured: functions by name, each from stored results to one figure with its interval or range.

A study's file names a function here and gives its arguments; there is no code in a configuration. Where an argument
selects cells, it is a mapping from columns of the episodes' table (name, label, world, ...) to a value or a list.
"""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from navbench.claims import Measured
from navbench.description import DescriptionError
from navbench.reading import Reading
from navbench.statistics import Interval, newcombe_paired, restricted_mean_difference, wilson

if TYPE_CHECKING:
    import pandas as pd

Select = Mapping[str, Any]
PAIR = ["world", "seed", "episode", "robot_index"]  # two controllers that share these met the same start and noise


def median(reading: Reading, metric: str, select: Select) -> Measured | None:
    """Return a metric's median over the robots that reached, with its range.

    Args:
        reading: the study's results.
        metric: the metric's name.
        select: which cells.
    """
    return _median(reached(reading.select(**select))[metric].to_numpy())


def median_ratio(reading: Reading, metric: str, over: str, select: Select) -> Measured | None:
    """Return the median, over the robots that reached, of one metric over another one, with its range."""
    rows = reached(reading.select(**select))
    return _median((rows[metric] / rows[over]).to_numpy())


def median_over_straight(reading: Reading, select: Select) -> Measured | None:
    """Return the median of path length over the straight line from start to goal, less the goal's tolerance."""
    rows = reached(reading.select(**select))
    ratios = [
        row["path_length_m"] / _straight_m(reading.configuration(row["run_id"]), row["robot_index"])
        for row in rows.to_dict("records")
    ]
    return _median(np.array(ratios))


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
    rows = reading.select(**select).merge(reading.select(**than), on=PAIR, suffixes=("", "_other"))
    here, there = rows["outcome"] == "reached", rows["outcome_other"] == "reached"
    rows, here, there = rows[here | there], here[here | there], there[here | there]
    better = here & (~there | (rows[metric] < rows[f"{metric}_other"]))
    return _share(better.to_numpy())


def share_ordered(reading: Reading, metric: str, labels: Sequence[str], select: Select) -> Measured | None:
    """Return the share of worlds and tuning seeds in which a metric falls strictly from each label to the next.

    Args:
        reading: the study's results.
        metric: the metric's name.
        labels: from the one said to have the most to the one said to have the least.
        select: which cells.
    """
    rows = reached(reading.select(**select))
    table = rows.pivot_table(index=["world", "tuning_seed"], columns="label", values=metric)[list(labels)].dropna()
    values = table.to_numpy()
    return _share(np.all(values[:, :-1] > values[:, 1:], axis=1))


def share_reached(reading: Reading, select: Select) -> Measured | None:
    """Return the share of robots that reached their goals."""
    return _share((reading.select(**select)["outcome"] == "reached").to_numpy())


def share_with_outcome(reading: Reading, outcomes: Sequence[str], select: Select) -> Measured | None:
    """Return the share of robots with one of some outcomes."""
    return _share(reading.select(**select)["outcome"].isin(list(outcomes)).to_numpy())


def share_without_collision(reading: Reading, select: Select) -> Measured | None:
    """Return the share of robots that touched nothing."""
    return _share((reading.select(**select)["collisions"] == 0).to_numpy())


def share_as_good(reading: Reading, metric: str, select: Select, than: Select, margin: float) -> Measured | None:
    """Return the share of pairs in which one controller reaches where the other does, and within a margin as well.

    Args:
        reading: the study's results.
        metric: the metric's name; less is better.
        select: the cells that are said to be as good.
        than: the cells that they are compared with.
        margin: how much more is as good, as a share of the other's metric.
    """
    rows = reading.select(**select).merge(reading.select(**than), on=PAIR, suffixes=("", "_other"))
    here, there = rows["outcome"] == "reached", rows["outcome_other"] == "reached"
    close = here & there & (rows[metric] <= (1.0 + margin) * rows[f"{metric}_other"])
    return _share((close | ~there).to_numpy())


def speed_range(reading: Reading, select: Select) -> Measured | None:
    """Return the median forward speed over all control periods, with the least and the greatest [m/s]."""
    rows = reading.select(**select)
    speeds = [reading.trajectory(run_id)["v_mps"].to_numpy() for run_id in rows["run_id"].unique()]
    return _median(np.concatenate(speeds))


def share_in_phases(reading: Reading, phases: Sequence[str], select: Select) -> Measured | None:
    """Return the share of episodes whose trace goes through some phases in this order, others between them or not.

    The phases are those that the arbitration's trace tells: "turn" (at the start, the error's size falls below 0.1
    rad), "approach" (the distance to the goal falls by 0.1 m in go-to-goal), "stall" (no progress before an obstacle),
    "follow" (wall following begins), "release" (it ends), "reach".

    Args:
        reading: the study's results.
        phases: the phases' names in the order that the paper tells.
        select: which cells.
    """
    rows = reading.select(**select)
    held = []
    for row in rows.to_dict("records"):
        ways = reading.trajectory(row["run_id"])
        way = ways[(ways["episode"] == row["episode"]) & (ways["robot_index"] == row["robot_index"])]
        held.append(_is_within(phases, _phases(way, row["outcome"])))
    return _share(np.array(held))


def reached(rows: "pd.DataFrame") -> "pd.DataFrame":
    """Return the rows of the robots that reached their goals."""
    return rows[rows["outcome"] == "reached"]


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


def _median(values: Any) -> Measured | None:
    if not len(values):
        return None
    return Measured(float(np.median(values)), float(values.min()), float(values.max()), len(values))


def _share(cases: Any) -> Measured | None:
    if not len(cases):
        return None
    return _measured(wilson(int(cases.sum()), len(cases)))


def _measured(interval: Interval) -> Measured:
    return Measured(interval.value, interval.low, interval.high, interval.n)


def _straight_m(cell: Mapping[str, Any], robot_index: int) -> float:
    world = cell["configuration"]["world"]
    start, goal = world["starts"][robot_index], world["goals"][robot_index]
    straight = math.hypot(goal["x_m"] - start["x_m"], goal["y_m"] - start["y_m"])
    return straight - float(world["goal_tolerance_m"])


def _phases(way: "pd.DataFrame", outcome: str) -> list[str]:
    """Return the phases of one robot's trajectory, in the order in which they happened."""
    error, behavior = way["heading_error_rad"].to_numpy()[:-1], way["behavior"].to_numpy()[:-1]
    distance, stalled = way["goal_distance_m"].to_numpy()[:-1], way["stalled"].to_numpy()[:-1]
    happened: list[tuple[int, str]] = []
    turned = int(np.argmax(np.abs(error) < 0.1)) if (np.abs(error) < 0.1).any() else None
    if turned:
        happened.append((turned, "turn"))
    for begin, end in _spans(behavior == 0.0):
        near = np.flatnonzero(distance[begin:end] <= distance[begin] - 0.1)
        if len(near):
            happened.append((begin + int(near[0]), "approach"))
    happened += [(begin, "follow") for begin, _ in _spans(behavior == 1.0)]
    happened += [(end, "release") for _, end in _spans(behavior == 1.0) if end < len(behavior)]
    happened += [(int(k), "stall") for k in np.flatnonzero(stalled)]
    order = {name: i for i, name in enumerate(("turn", "approach", "stall", "follow", "release", "reach"))}
    names = [name for _, name in sorted(happened, key=lambda pair: (pair[0], order[pair[1]]))]
    return [*names, "reach"] if outcome == "reached" else names


def _spans(holds: Any) -> list[tuple[int, int]]:
    """Return the (begin, end) of each unbroken run of true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    return [(int(begin), int(end)) for begin, end in zip(edges[::2], edges[1::2], strict=True)]


def _is_within(wanted: Sequence[str], happened: Sequence[str]) -> bool:
    """Return whether the wanted names stand in the others in their order."""
    rest = iter(happened)
    return all(name in rest for name in wanted)


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
        speed_range,
        share_in_phases,
    )
}
