"""What only the claims about aouf2019 measure: phases of a run, orders of tunings, one speed."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from navbench.analysis.estimates import exact, median_of, share_of
from navbench.analysis.printed import fraction
from navbench.analysis.stored import StoredResults, outcomes, reached
from navbench.analysis.traces import records_of, spells
from navbench.controllers.aouf2019.behaviors import FOLLOW_WALL
from navbench.mathematics.statistics import Estimate
from navbench.world.layout import DrawnWorld

if TYPE_CHECKING:
    import pandas as pd

Select = Mapping[str, Any]

PHASES = ("turn", "approach", "stall", "follow", "release", "reach")  # also the order of those of one control period
TURNED_RAD = 0.1
APPROACHED_M = 0.1


class Phase(NamedTuple):
    """A phase and the row of the trajectory in which it came about."""

    row: int
    name: str


def median_over_straight(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the median of path length over the straight line from start to goal, less the goal's tolerance."""
    return median_of(_over_straight(stored, reached(stored.cases(**select))))


def share_straight(stored: StoredResults, margin: float | str, select: Select) -> Estimate | None:
    """Return the share of robots that reached by a path longer by at most a margin than the straight line, as above."""
    rows = stored.cases(**select)
    straight = [ratio <= 1.0 + fraction("margin", margin) for ratio in _over_straight(stored, rows)]
    return share_of((rows["outcome"] == "reached").to_numpy() & np.array(straight, dtype=bool))


def share_smooth(stored: StoredResults, changes_per_s: float, select: Select) -> Estimate | None:
    """Return the share of robots whose turning rate changed its sign at most so many times a second."""
    rows = stored.cases(**select)
    return share_of((rows["w_sign_changes"] <= changes_per_s * rows["time_s"]).to_numpy())


def affects(stored: StoredResults, metric: str, margin: float | str, select: Select) -> Estimate | None:
    """Return 1 where in some world a metric's greatest value exceeds its least by more than a margin of it, else 0."""
    found = reached(stored.select(**select)).groupby("world")[metric].agg(["min", "max"])
    return share_of([bool((found["max"] > (1.0 + fraction("margin", margin)) * found["min"]).any())])


def ratio_of_medians(stored: StoredResults, metric: str, select: Select, than: Select) -> Estimate | None:
    """Return a metric's median over that of the cells that are compared with, over the robots that reached."""
    ours, theirs = (reached(rows)[metric] for rows in stored.sides(select, than))
    return exact(ours.median() / theirs.median(), min(len(ours), len(theirs))) if len(ours) and len(theirs) else None


def described_count(stored: StoredResults, table: str, column: str, where: Select) -> Estimate | None:
    """Return how many different values a column of a described table has, in the rows that match."""
    stored.described(table, column)
    return exact(stored.described_rows(table, where)[column].nunique())


def share_ordered(
    stored: StoredResults, metric: str, labels: Sequence[str], select: Select, equal_within: float | str = 0.0
) -> Estimate | None:
    """Return the share of worlds and tuning seeds in which a metric falls from each label to the next.

    Two seeds with which every label has the same case are one, see ``cases_of``.

    Args:
        stored: the study's results.
        metric: the metric's name.
        labels: from the one said to have the most to the one said to have the least.
        select: which cells.
        equal_within: a step by at most this share of the greater value is none: 0.01 or ``1 %``.
    """
    runs = reached(stored.select(**select)).groupby(["world", "tuning_seed", "label"])
    table = runs[metric].mean().unstack().reindex(columns=list(labels)).dropna()
    cases = runs["case"].first().unstack().reindex(index=table.index, columns=list(labels)).reset_index("world")
    values = table[~cases.duplicated().to_numpy()].to_numpy()
    kept = 1.0 - fraction("equal_within", equal_within)
    return share_of(np.all(kept * values[:, :-1] > values[:, 1:], axis=1))


def share_with_outcome(stored: StoredResults, outcomes: Sequence[str], select: Select) -> Estimate | None:
    """Return the share of robots with one of some outcomes."""
    return share_of(stored.cases(**select)["outcome"].isin(list(outcomes)).to_numpy())


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
    here, there = outcomes(rows).values()
    close = here & there & (rows[metric] <= (1.0 + margin) * rows[f"{metric}_other"]).to_numpy()
    return share_of(close | ~there)


def speed_range(stored: StoredResults, select: Select) -> Estimate | None:
    """Return the median forward speed over all control periods, with the least and the greatest [m/s]."""
    rows = stored.cases(**select)
    speeds = [stored.trajectories(run_id)["v_mps"].to_numpy() for run_id in rows["run_id"].unique()]
    return median_of(np.concatenate(speeds))


def share_in_phases(
    stored: StoredResults,
    phases: Sequence[str],
    select: Select,
    turned_rad: float = TURNED_RAD,
    approached_m: float = APPROACHED_M,
) -> Estimate | None:
    """Return the share of episodes that go through some phases in this order, others between them or not.

    Args:
        stored: the study's results.
        phases: the phases' names, of ``PHASES``, in the order that the paper tells.
        select: which cells.
        turned_rad: as in ``phases_of``.
        approached_m: as in ``phases_of``.
    """
    happened = [
        phases_of(stored.trajectory(row), row["outcome"], turned_rad, approached_m)
        for row in records_of(stored.cases(**select), "outcome")
    ]
    return share_of([is_within(phases, [phase.name for phase in run]) for run in happened])


def phases_of(
    trajectory: "pd.DataFrame", outcome: str, turned_rad: float = TURNED_RAD, approached_m: float = APPROACHED_M
) -> list[Phase]:
    """Return the phases of one robot's trajectory, in the order in which they came about.

    "turn": the heading error's size falls below ``turned_rad`` for the first time, having been above at the start.
    "approach": in a spell of go-to-goal, the goal is ``approached_m`` nearer than at its beginning.
    "stall": before an obstacle, there was no progress for the arbitration's window.
    "follow": wall following begins. "release": it ends. "reach": the goal is reached.

    Args:
        trajectory: with the trace of ``behaviors``.
        outcome: the robot's outcome.
        turned_rad: a heading error below it is a turn that is done [rad].
        approached_m: so much nearer is an approach [m].
    """
    acted = trajectory.iloc[:-1]  # at the end the controller acted no more
    error_rad, behavior = acted["heading_error_rad"].to_numpy(), acted["behavior"].to_numpy()
    distance_m = acted["goal_distance_m"].to_numpy()
    happened: list[Phase] = []
    turned = np.flatnonzero(np.abs(error_rad) < turned_rad)
    if len(turned) and turned[0] > 0:
        happened.append(Phase(int(turned[0]), "turn"))
    for spell in spells(behavior):
        begin, end = spell.begin, spell.begin + spell.length
        near = np.flatnonzero(distance_m[begin:end] <= distance_m[begin] - approached_m)
        if spell.value == FOLLOW_WALL:
            happened.append(Phase(begin, "follow"))
            if end < len(behavior):
                happened.append(Phase(end, "release"))
        elif len(near):
            happened.append(Phase(begin + int(near[0]), "approach"))
    stalled = acted["stalled"].to_numpy() * acted["at_obstacle"].to_numpy()
    happened += [Phase(spell.begin, "stall") for spell in spells(stalled) if spell.value == 1.0]
    if outcome == "reached":
        happened.append(Phase(len(acted), "reach"))
    return sorted(happened, key=lambda phase: (phase.row, PHASES.index(phase.name)))


def is_within(wanted: Sequence[str], happened: Sequence[str]) -> bool:
    """Return whether the wanted names stand among the others in their order, others between them or not."""
    rest = iter(happened)
    return all(name in rest for name in wanted)


def least_cost(stored: StoredResults, tunings: Sequence[str]) -> Estimate | None:
    """Return the median, over some tunings and their seeds, of the least cost that was found, with its range."""
    return median_of(_best(stored, tunings)["cost"].to_numpy())


def share_at_bound(stored: StoredResults, parameter: str, tunings: Sequence[str]) -> Estimate | None:
    """Return the share of some tunings whose best value of a parameter lies within 1 % of the range at its upper end.

    Args:
        stored: the study's results.
        parameter: the parameter that was searched.
        tunings: the tunings' names.
    """
    best = _best(stored, tunings)
    tunable = next(t for t in stored.manifest["tunings"] if t["name"] in tunings)["configuration"]["tunable"]
    low, high = tunable[parameter]["low"], tunable[parameter]["high"]
    return share_of((best[parameter] >= high - 0.01 * (high - low)).to_numpy())


def _best(stored: StoredResults, tunings: Sequence[str]) -> "pd.DataFrame":
    """Return the evaluation of the least cost in each of some tunings with each of its seeds."""
    rows = stored.evaluations
    return rows.loc[rows[rows["name"].isin(list(tunings))].groupby(["name", "seed"])["cost"].idxmin()]


def _over_straight(stored: StoredResults, rows: "pd.DataFrame") -> list[float]:
    """Return the path lengths of some robots over the straight line from start to goal, less the goal's tolerance."""
    return [
        row["path_length_m"] / _straight_m(stored.world(row["run_id"], row["episode"]), row["robot_index"])
        for row in records_of(rows, "path_length_m")
    ]


def _straight_m(world: DrawnWorld, robot_index: int) -> float:
    start, goal = world.starts[robot_index], world.goals[robot_index]
    return math.hypot(goal.x_m - start.x_m, goal.y_m - start.y_m) - world.goal_tolerance_m
