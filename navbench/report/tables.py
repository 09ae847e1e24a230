"""Tables of stored results: a row a cell, every mean beside how many robots it is a mean of."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from navbench.analysis.fleets import fleets
from navbench.analysis.stored import driven, reached
from navbench.mathematics.statistics import clopper_pearson
from navbench.metrics import DECLARED, Metric
from navbench.reading import flat
from navbench.records import NOT_DRIVEN
from navbench.report import markdown
from navbench.report.document import Blocks, Column, Lines, Paragraph, Table, number
from navbench.report.page import Page

if TYPE_CHECKING:
    import pandas as pd

KEYS = ("controller", "world", "robot", "sensors", "simulator", "seed")
MEANS = tuple(metric.name for metric in DECLARED if metric.averaged)
FAILURES = ("collided", "timed_out", "controller_error", *NOT_DRIVEN)
PRINTED = ("controller", "world", "robot", "reached", "collisions", *MEANS[:4])
FLEET = ("fleets", "makespan_s")  # printed where several robots drive together
COUNTS = {"reached": "of", "fleets": "episodes"}  # counts, and of how many
COLUMNS = (*KEYS, "reached", "of", "collisions", *MEANS, *FAILURES, "robots", "episodes", *FLEET, "run_id")
WHERE_MANY = ("sensors", "simulator", "seed")  # printed where a table's cells differ in them


def summarize(episodes: "pd.DataFrame", metrics: Iterable[Metric] = DECLARED) -> "pd.DataFrame":
    """Return one row a cell.

    Means are over the robots that reached their goals and over no others: a robot that failed early would otherwise
    look short and quick. Where none reached, they are missing.

    Args:
        episodes: the table of episodes.
        metrics: what was measured.

    Returns:
        Columns controller, world, robot, sensors, simulator, seed, reached of how many, collisions (the sum over all
        robots), a mean of each metric, how many failed by each of ``FAILURES``; and robots (how many drive together),
        fleets (episodes in which all reached) of how many episodes, and the mean makespan_s of those. Episodes of
        which no layout could be drawn, or whose task is impossible, are counted as such and nowhere else.
    """
    import pandas as pd

    means = [metric.name for metric in metrics if metric.averaged and metric.name in episodes]
    together = fleets(driven(episodes))
    rows = []
    for run_id, group in episodes.groupby("run_id", sort=False):
        arrived = reached(group)
        row = {key: group[key].iloc[0] for key in KEYS}
        row |= {"reached": len(arrived), "of": len(driven(group))}
        row["collisions"] = int(group["collisions"].sum())
        row |= {name: arrived[name].mean() for name in means}
        row |= {name: int((group["outcome"] == name).sum()) for name in FAILURES}
        row |= {"robots": group["robot_index"].nunique(), **_fleet_columns(together[together["run_id"] == run_id])}
        rows.append({**row, "run_id": run_id})
    return pd.DataFrame(rows)


def to_text(summary: "pd.DataFrame", form: str = "simple") -> str:
    """Return the table for a terminal: the columns that a reader asks for first; means are over the reached.

    With ``form="html"`` it is the table for a page.

    Metrics beside navbench's own are printed, and where several robots drive together, what the fleets did. Sensors,
    simulator and seed are printed where they differ, and so is every column that is not ``summarize``'s own.
    """
    names = list(summary.columns)
    added = names[names.index(MEANS[-1]) + 1 : names.index(FAILURES[0])]
    more = [name for name in names if name not in (*COLUMNS, *added)]
    more += [name for name in WHERE_MANY if summary[name].nunique() > 1]
    many = FLEET if (summary["robots"] > 1).any() else ()
    return _table(summary, (*PRINTED[:3], *more, *PRINTED[3:], *added, *many), form)


def _fleet_columns(table: "pd.DataFrame") -> dict[str, object]:
    """Return what the fleets of one cell did."""
    won = table[table["success"]]
    return {"fleets": len(won), "episodes": len(table), "makespan_s": won["makespan_s"].mean()}


def to_markdown(summary: "pd.DataFrame") -> str:
    """Return the whole table in Markdown; means are over the reached."""
    return (
        _table(summary, [name for name in summary.columns if name not in ("run_id", *COUNTS.values())], "github") + "\n"
    )


def failures(episodes: "pd.DataFrame", at_most: int = 5) -> list[str]:
    """Return a line for each of the first robots that failed, or of which a metric failed: which, how and why."""
    episodes = driven(episodes)
    failed = episodes[(episodes["outcome"] != "reached") | (episodes["reason"] != "")]
    names = [f" (R{i + 1})" if episodes["robot_index"].max() else "" for i in failed["robot_index"]]  # in pictures
    lines = [
        f"{row['controller']} in {row['world']}, seed {row['seed']}, episode {row['episode']}, robot "
        f"{row['robot_index']}{name}: {row['outcome']} after {row['time_s']:.2f} s"
        + (f" ({_reason(row)})" if row["reason"] else "")
        for row, name in zip(failed.head(at_most).to_dict("records"), names, strict=False)
    ]
    more = len(failed) - at_most
    return [*lines, f"... and {more} more"] if more > 0 else lines


def _reason(row: Mapping[Any, Any]) -> str:
    """Return why a robot failed, other robots named as in pictures."""
    reason, index = str(row["reason"]), row["hit_index"]
    return reason.replace(f"robot {index}", f"R{index + 1}") if row["hit"] == "robot" else reason


def summary(page: Page) -> Blocks:
    """Return one row a cell: who arrived, and the means of those."""
    cells = page.stored.cells.drop_duplicates("run_id")
    metrics = page.stored.metrics.values()
    table = cells[["run_id", "label", "name"]].merge(summarize(page.stored.rows, metrics), on="run_id")
    held = [metric for metric in metrics if metric.name in table]
    summed = [*(metric.name for metric in held), *FAILURES, "makespan_s"]
    rows = []
    for row in table.to_dict("records"):
        arrived = clopper_pearson(row["reached"], row["of"]) if row["of"] else None
        told = [row[key] for key in ("name", "label", "simulator", "seed")]
        rows.append([*told, arrived, arrived, *(row[name] for name in summed)])
    columns = [Column("world", "world"), Column("controller", "controller")]
    columns += [Column("simulator", "simulator"), Column("seed", "seed")]
    columns += [Column("reached", show="count"), Column("share", "reached", decimals=3)]
    columns += [Column(metric.title, metric.name, metric.unit) for metric in held]
    columns += [*(Column(name.replace("_", " "), name) for name in FAILURES), Column("makespan", "makespan_s", "s")]
    return [
        Paragraph("Means are over the robots that reached their goals, and over no others."),
        *map(Paragraph, page.stored.missing),
        page.table(columns, rows),
    ]


def failed(page: Page, *, at_most: int = 20) -> Blocks:
    """Return the first robots that failed: which, how and why.

    Args:
        at_most: how many.
    """
    rows = page.stored.episodes.drop_duplicates(["run_id", "episode", "robot_index"])
    return [Lines(failures(rows.assign(controller=rows["label"]), at_most) or ["No robot failed."])]


def metrics(page: Page) -> Blocks:
    """Return what each metric is, which direction is better, and who defines it so."""
    rows = [[m.name, m.unit, m.better, m.definition, m.source] for m in page.stored.metrics.values()]
    return [Table("", [Column(title) for title in ("metric", "unit", "better", "definition", "source")], rows)]


def _table(summary: "pd.DataFrame", names: Sequence[str], form: str) -> str:
    from tabulate import tabulate

    words = [name for name in names if summary[name].dtype.kind not in "biuf" or name in COUNTS]
    shown = markdown.cell if form == "github" else flat
    text: str = tabulate(
        [[shown(_cell(row, name)) for name in names] for row in summary.to_dict("records")],
        headers=list(map(shown, names)),
        tablefmt=form,
        colalign=["left" if name in words else "right" for name in names],
        disable_numparse=True,
    )
    return text


def _cell(row: Mapping[Any, Any], name: str) -> str:
    """Return a table's entry: numbers to four digits, a missing mean as a dash, a count with of how many."""
    return (
        f"{row[name]} of {row[COUNTS[name]]}"
        if name in COUNTS
        else number(row[name])
        if isinstance(row[name], float)
        else str(row[name])
    )
