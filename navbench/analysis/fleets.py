"""Fleets: what all robots of an episode did together."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd


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

    groups = episodes.assign(arrived=episodes["outcome"] == "reached").groupby(["run_id", "world", "seed", "episode"])
    sums = groups[["time_s", "robot_collisions", "collisions", "standing_collisions"]].sum()
    success = groups["arrived"].all()
    columns = {
        "robots": groups.size(),
        "success": success,
        "makespan_s": groups["time_s"].max().where(success),
        "sum_of_times_s": sums["time_s"].where(success),
        "clearance_m": groups["min_clearance_m"].min(),
        "contacts": sums["collisions"],
        "robot_contacts": sums["robot_collisions"],
        "other_contacts": sums["collisions"] - sums["robot_collisions"],
        "standing_contacts": sums["standing_collisions"],
    }
    return pd.DataFrame(columns).reset_index()
