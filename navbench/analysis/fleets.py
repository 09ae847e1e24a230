"""Fleets: what all robots of an episode did together."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd


def fleets(episodes: "pd.DataFrame") -> "pd.DataFrame":
    """Return one row an episode.

    Args:
        episodes: the table of episodes, one row a robot and episode.

    Returns:
        Columns run_id, episode, robots, and

        - success: whether all robots reached their goals;
        - makespan_s: when the last one did [s]; nan without success;
        - sum_of_times_s: the sum of their times, "flowtime" [s]; nan without success;
        - robot_contacts: contacts with another robot, counted by each of the two;
        - other_contacts: with everything else;
        - standing_contacts: of both, those of robots that stood and were driven into.
    """
    import pandas as pd

    groups = episodes.assign(arrived=episodes["outcome"] == "reached").groupby(["run_id", "episode"], sort=True)
    sums = groups[["time_s", "robot_collisions", "collisions", "standing_collisions"]].sum()
    success = groups["arrived"].all()
    columns = {
        "robots": groups.size(),
        "success": success,
        "makespan_s": groups["time_s"].max().where(success),
        "sum_of_times_s": sums["time_s"].where(success),
        "robot_contacts": sums["robot_collisions"],
        "other_contacts": sums["collisions"] - sums["robot_collisions"],
        "standing_contacts": sums["standing_collisions"],
    }
    return pd.DataFrame(columns).reset_index()


def clearances(episodes: "pd.DataFrame") -> "pd.DataFrame":
    """Return one row an episode: run_id, world, seed, episode, the least clearance_m of its robots and their contacts.

    Args:
        episodes: the table of episodes, one row a robot and episode.
    """
    import pandas as pd

    groups = episodes.groupby(["run_id", "world", "seed", "episode"], sort=True)
    columns = {"clearance_m": groups["min_clearance_m"].min(), "contacts": groups["collisions"].sum()}
    return pd.DataFrame(columns).reset_index()
