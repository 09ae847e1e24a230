"""Fleets: what all robots of an episode did together."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

KEYS = ("run_id", "world", "seed", "episode")


def successes(episodes: "pd.DataFrame") -> dict[tuple[Any, ...], bool]:
    """Return of each run, world, seed and episode in a table of episodes whether all robots reached their goals."""
    found: dict[tuple[Any, ...], bool] = {}
    for *name, outcome in zip(*(episodes[column].tolist() for column in (*KEYS, "outcome")), strict=True):
        found[tuple(name)] = found.get(tuple(name), True) and outcome == "reached"
    return found


def fleets(episodes: "pd.DataFrame") -> "pd.DataFrame":
    """Return one row an episode.

    Args:
        episodes: the table of episodes, one row a robot and episode.

    Returns:
        Columns run_id, world, seed, episode, robots, and

        - success: whether all robots reached their goals;
        - makespan_s: when the last one did [s]; nan without success;
        - sum_of_times_s: the sum of their times, "flowtime" [s]; nan without success;
        - clearance_m: the least of its robots [m];
        - contacts: of its robots with anything;
        - robot_contacts: with another robot, counted by each of the two;
        - other_contacts: with everything else;
        - standing_contacts: of both, those of robots that stood and were driven into.
    """
    import pandas as pd

    episodes_of = list(zip(*(episodes[name].tolist() for name in KEYS), strict=True))
    names = sorted(set(episodes_of))
    number = {name: i for i, name in enumerate(names)}
    group = np.array([number[name] for name in episodes_of], dtype=np.int64)
    order = np.argsort(group, kind="stable")
    begins = np.flatnonzero(np.diff(group[order], prepend=-1))

    def over(reduce: np.ufunc, values: "pd.Series[Any]") -> NDArray[Any]:
        sorted_values = values.to_numpy()[order]
        return reduce.reduceat(sorted_values, begins) if len(begins) else sorted_values

    success = over(np.logical_and, episodes["outcome"] == "reached")
    contacts, robot_contacts = over(np.add, episodes["collisions"]), over(np.add, episodes["robot_collisions"])
    columns = {
        **{name: episodes[name].iloc[order[begins]].reset_index(drop=True) for name in KEYS},
        "robots": np.diff(begins, append=len(order)),
        "success": success,
        "makespan_s": np.where(success, over(np.maximum, episodes["time_s"]), np.nan),
        "sum_of_times_s": np.where(success, over(np.add, episodes["time_s"]), np.nan),
        "clearance_m": over(np.fmin, episodes["min_clearance_m"]),
        "contacts": contacts,
        "robot_contacts": robot_contacts,
        "other_contacts": contacts - robot_contacts,
        "standing_contacts": over(np.add, episodes["standing_collisions"]),
    }
    return pd.DataFrame(columns)
