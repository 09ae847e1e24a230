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
    groups = episodes.groupby(["run_id", "episode"], sort=True)
    table = groups.agg(
        robots=("robot_index", "size"),
        success=("outcome", lambda outcomes: bool((outcomes == "reached").all())),
        makespan_s=("time_s", "max"),
        sum_of_times_s=("time_s", "sum"),
        robot_contacts=("robot_collisions", "sum"),
        contacts=("collisions", "sum"),
        standing_contacts=("standing_collisions", "sum"),
    ).reset_index()
    table.loc[~table["success"].astype(bool), ["makespan_s", "sum_of_times_s"]] = float("nan")
    table["other_contacts"] = table.pop("contacts") - table["robot_contacts"]
    return table


def clearances(episodes: "pd.DataFrame") -> "pd.DataFrame":
    """Return one row an episode: run_id, world, seed, episode, the least clearance_m of its robots and their contacts.

    Args:
        episodes: the table of episodes, one row a robot and episode.
    """
    groups = episodes.groupby(["run_id", "world", "seed", "episode"], sort=True)
    return groups.agg(clearance_m=("min_clearance_m", "min"), contacts=("collisions", "sum")).reset_index()
