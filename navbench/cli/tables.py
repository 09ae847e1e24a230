"""The table and the picture of a results directory: of a run, a sweep or a tuning, whole or as far as it came."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navbench.cli.progress import tell
from navbench.experiments.store import Results, write_table
from navbench.reading import flat

if TYPE_CHECKING:
    import pandas as pd

    from navbench.report.picture import Each
    from navbench.report.sampling import Sample

PANELS_MAX = 30  # a picture of more cells cannot be read
NAMES = ("controller", "world", "robot", "sensors", "simulator")


def print_tables(results: Results, each: "Each" = map) -> None:
    """Write the tables and the picture, and print what a person asks for first; arguments as below."""
    from navbench.analysis.stored import StoredResults
    from navbench.report.runs import Joined
    from navbench.report.tables import failures, to_text

    table = write_tables(results, each)
    print(to_text(table))
    stored = StoredResults(Joined([results]))  # which tells cells of one controller in one world apart
    rows = stored.episodes.drop_duplicates(["run_id", "episode", "robot_index"])  # in the order of the plan
    told = failures(rows.assign(controller=rows["label"], world=rows["name"]))
    for line in (*told, *stored.missing):
        print(flat(line))
    sampled = _drawn(results).says
    if sampled:
        print(f"trajectories.png: {sampled}")
    tell(f"results: {results.path}")


def write_tables(results: Results, each: "Each" = map) -> "pd.DataFrame":
    """Write the table of the cells that have episodes, as CSV and Markdown, and return it.

    A picture is drawn where there is none, or where episodes, or how they are drawn, have changed since.

    Args:
        results: the directory.
        each: draws the rows of the picture: ``map``, or what does the same in several processes.
    """
    from navbench.report import figures, picture
    from navbench.report.tables import to_markdown

    table = table_of(results)
    write_table(results.path / "table.csv", table.to_csv(index=False))
    write_table(results.path / "table.md", to_markdown(table))
    file = results.path / "trajectories.png"
    drawn_of = [
        results.path / "episodes",
        results.path / "trajectories",
        *map(Path, (figures.__file__, picture.__file__)),
    ]
    if not (file.is_file() and all(file.stat().st_mtime > one.stat().st_mtime for one in drawn_of)):
        sample = _drawn(results)
        if sample.runs:
            picture.save_trajectories(results, sample.runs, file, each, sample.says)
    return table


def _drawn(results: Results) -> "Sample":
    """Return which of the runs that have episodes, and whose trajectories are kept, a picture shows."""
    from navbench.report.sampling import sample_of

    finished = results.finished()
    planned = dict.fromkeys(cell["run_id"] for cell in results.manifest()["cells"])
    runs = [run_id for run_id in planned if run_id in finished and results.keeps_trajectories(run_id)]
    return sample_of(runs, results.episodes(), PANELS_MAX)


def table_of(results: Results) -> "pd.DataFrame":
    """Return a row a cell, in the order of the plan.

    There is a column for each key in which cells of the same names differ, and where episodes are missing, the column
    ``planned``: how many rows there should be.
    """
    from navbench.analysis.stored import StoredResults
    from navbench.report.tables import summarize

    manifest = results.manifest()["cells"]
    cells = {cell["run_id"]: cell for cell in reversed(manifest)}
    order = {cell["run_id"]: place for place, cell in enumerate(manifest)}
    stored = StoredResults(results)
    table = summarize(stored.rows, stored.metrics.values())
    table = table.sort_values("run_id", key=lambda ids: ids.map(order), ignore_index=True)
    mine = [cells[run_id] for run_id in table["run_id"]]
    table["controller"] = [cell["label"] for cell in mine]
    _tell_apart(table, mine)
    rows = [len(stored.planned[run]) * robots for run, robots in zip(table["run_id"], table["robots"], strict=True)]
    there = stored.rows.groupby("run_id").size()
    if rows != [there[run_id] for run_id in table["run_id"]]:
        table.insert(len(NAMES), "planned", rows)
    return table


def _tell_apart(table: "pd.DataFrame", cells: Sequence[Mapping[str, Any]]) -> None:
    """Add a column for each key of the configuration in which cells of the same names differ."""
    from navbench.analysis.stored import leaves_of
    from navbench.report.runs import differing

    values = [dict(leaves_of(cell["configuration"])) for cell in cells]
    alike = table.groupby(list(NAMES)).indices.values()
    keys = dict.fromkeys(key for rows in alike for key in differing([values[row] for row in rows]))
    for place, key in enumerate(keys, len(NAMES)):
        table.insert(place, key, [own.get(key, "") for own in values])
