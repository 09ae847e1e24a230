"""Tables of stored results: a row a cell, every mean beside how many robots it is a mean of."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from navbench.analysis.fleets import fleets

if TYPE_CHECKING:
    import pandas as pd

KEYS = ("controller", "world", "robot", "sensors", "simulator", "seed")
MEANS = (
    "path_length_m",
    "time_s",
    "min_clearance_m",
    "mean_speed_mps",
    "heading_ise",
    "total_turning_rad",
    "w_sign_changes",
)
FAILURES = ("collided", "timed_out", "controller_error", "no_layout")
PRINTED = ("controller", "world", "robot", "reached", "collisions", *MEANS[:4])
FLEET = ("fleets", "makespan_s")  # printed where several robots drive together
WHERE_MANY = ("sensors", "simulator", "seed")  # printed where a table's cells differ in them


def summarize(episodes: "pd.DataFrame") -> "pd.DataFrame":
    """Return one row a cell.

    Means are over the robots that reached their goals and over no others: a robot that failed early would otherwise
    look short and quick. Where none reached, they are missing.

    Args:
        episodes: the table of episodes.

    Returns:
        Columns controller, world, robot, sensors, simulator, seed, reached ("n of N"), collisions (the sum over all
        robots), a mean of each metric, how many failed in each way (see ``FAILURES``); and robots
        (how many drive together), fleets ("n of N" episodes in which all reached) and the mean makespan_s of those.
    """
    import pandas as pd

    rows = []
    for run_id, group in episodes.groupby("run_id", sort=False):
        reached = group[group["outcome"] == "reached"]
        row = {key: group[key].iloc[0] for key in KEYS}
        row["reached"] = f"{len(reached)} of {len(group)}"
        row["collisions"] = int(group["collisions"].sum())
        row |= {name: reached[name].mean() for name in MEANS}
        row |= {name: int((group["outcome"] == name).sum()) for name in FAILURES}
        row |= _fleet_columns(group)
        rows.append({**row, "run_id": run_id})
    return pd.DataFrame(rows).sort_values([*KEYS, "run_id"], kind="stable", ignore_index=True)


def to_text(summary: "pd.DataFrame") -> str:
    """Return the table for a terminal: the columns that a reader asks for first; means are over the reached.

    Where several robots drive together, what the fleets did is printed too. Sensors, simulator and seed are printed
    where they differ, and so is every column that is not ``summarize``'s own.
    """
    usual = {*KEYS, "reached", "collisions", *MEANS, *FAILURES, "robots", *FLEET, "run_id"}
    more = [name for name in summary.columns if name not in usual]
    more += [name for name in WHERE_MANY if summary[name].nunique() > 1]
    many = FLEET if (summary["robots"] > 1).any() else ()
    return _table(summary, (*PRINTED[:3], *more, *PRINTED[3:], *many), "simple")


def _fleet_columns(group: "pd.DataFrame") -> dict[str, object]:
    """Return what the fleets of one cell did."""
    table = fleets(group)
    won = table[table["success"]]
    return {
        "robots": int(table["robots"].max()),
        "fleets": f"{len(won)} of {len(table)}",
        "makespan_s": won["makespan_s"].mean(),
    }


def to_markdown(summary: "pd.DataFrame") -> str:
    """Return the whole table in Markdown; means are over the reached."""
    return _table(summary, [name for name in summary.columns if name != "run_id"], "github") + "\n"


def failures(episodes: "pd.DataFrame", at_most: int = 5) -> list[str]:
    """Return a line for each of the first robots that failed: which, how and why."""
    failed = episodes[episodes["outcome"] != "reached"]
    lines = [
        f"{row['controller']} in {row['world']}, episode {row['episode']}, robot {row['robot_index']}: "
        f"{row['outcome']} after {row['time_s']:.2f} s" + (f" ({row['reason']})" if row["reason"] else "")
        for row in failed.head(at_most).to_dict("records")
    ]
    more = len(failed) - at_most
    return [*lines, f"... and {more} more"] if more > 0 else lines


def _table(summary: "pd.DataFrame", names: Sequence[str], form: str) -> str:
    from tabulate import tabulate

    words = summary[list(names)].select_dtypes(exclude="number").columns
    text: str = tabulate(
        [[_cell(value) for value in row] for row in summary[list(names)].to_numpy(dtype=object).tolist()],
        headers=list(names),
        tablefmt=form,
        colalign=["left" if name in words else "right" for name in names],
        disable_numparse=True,
    )
    return text


def _cell(value: object) -> str:
    """Return a table's entry: numbers to four digits, a missing mean as a dash."""
    if isinstance(value, float):
        return "-" if value != value else f"{value:.4g}"
    return f"{value!s}"
