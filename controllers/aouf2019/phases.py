"""What a robot of aouf2019 went through, read from the trace that its arbitration left: turn, approach, stall, ..."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

PHASES = ("turn", "approach", "stall", "follow", "release", "reach")  # also the order of those of one control period
GO_TO_GOAL, FOLLOW_WALL = 0.0, 1.0  # the trace's "behavior"
TURNED_RAD = 0.1
APPROACHED_M = 0.1


class Phase(NamedTuple):
    """A phase and the row of the trajectory in which it came about."""

    row: int
    name: str


def phases(trajectory: "pd.DataFrame", outcome: str) -> list[Phase]:
    """Return the phases of one robot's trajectory, in the order in which they came about.

    "turn": the heading error's size falls below 0.1 rad for the first time, having been above at the start.
    "approach": in a spell of go-to-goal, the goal is 0.1 m nearer than at its beginning.
    "stall": before an obstacle, there was no progress for the arbitration's window.
    "follow": wall following begins. "release": it ends. "reach": the goal is reached.

    Args:
        trajectory: with the trace of ``controllers/aouf2019/equations.py``.
        outcome: the robot's outcome.
    """
    acted = trajectory.iloc[:-1]  # at the end the controller acted no more
    error_rad, behavior = acted["heading_error_rad"].to_numpy(), acted["behavior"].to_numpy()
    distance_m = acted["goal_distance_m"].to_numpy()
    happened: list[Phase] = []
    turned = np.flatnonzero(np.abs(error_rad) < TURNED_RAD)
    if len(turned) and turned[0] > 0:
        happened.append(Phase(int(turned[0]), "turn"))
    for begin, end in _spans(behavior == GO_TO_GOAL):
        near = np.flatnonzero(distance_m[begin:end] <= distance_m[begin] - APPROACHED_M)
        if len(near):
            happened.append(Phase(begin + int(near[0]), "approach"))
    stalled = (acted["stalled"].to_numpy() == 1.0) & (acted["at_obstacle"].to_numpy() == 1.0)
    happened += [Phase(begin, "stall") for begin, _ in _spans(stalled)]
    for begin, end in _spans(behavior == FOLLOW_WALL):
        happened.append(Phase(begin, "follow"))
        if end < len(behavior):
            happened.append(Phase(end, "release"))
    if outcome == "reached":
        happened.append(Phase(len(acted), "reach"))
    return sorted(happened, key=lambda phase: (phase.row, PHASES.index(phase.name)))


def is_within(wanted: Sequence[str], happened: Sequence[str]) -> bool:
    """Return whether the wanted names stand among the others in their order, others between them or not."""
    rest = iter(happened)
    return all(name in rest for name in wanted)


def _spans(holds: Any) -> list[tuple[int, int]]:
    """Return the (begin, end) of each unbroken run of true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    return [(int(begin), int(end)) for begin, end in zip(edges[::2], edges[1::2], strict=True)]
