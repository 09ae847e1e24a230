"""A sweep's joined table."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navbench.experiments.store import Results, write_table
from navbench.report.tables import failures, summarize, to_markdown, to_text

if TYPE_CHECKING:
    import pandas as pd

PANELS_MAX = 30  # a picture of more cells cannot be read


def join(runs: Sequence[Results], path: Path) -> None:
    """Print the joined table of a sweep's cells and write it beside them, as CSV, Markdown and a picture.

    Args:
        runs: the cells' results.
        path: the sweep's directory.
    """
    import pandas as pd

    from navbench.report.figures import save_trajectories

    episodes = pd.concat([run.episodes() for run in runs], ignore_index=True)
    episodes = episodes.drop_duplicates(["run_id", "episode", "robot_index"], ignore_index=True)  # of equal cells
    summary = _told_apart(summarize(episodes), [cell for run in runs for cell in run.manifest()["cells"]])
    write_table(path / "table.csv", summary.to_csv(index=False))
    write_table(path / "table.md", to_markdown(summary))
    if len(runs) <= PANELS_MAX:
        save_trajectories(runs, path / "trajectories.png")
    print(to_text(summary))
    for line in failures(episodes):
        print(line)
    print(f"results: {path}")


def _told_apart(summary: "pd.DataFrame", cells: Sequence[Mapping[str, Any]]) -> "pd.DataFrame":
    """Return the table with a column for each key of the configuration in which cells of the same names differ."""
    values = {cell["run_id"]: dict(_leaves(cell["configuration"])) for cell in cells}
    keys: dict[str, None] = {}
    for _, group in summary.groupby(["controller", "world", "robot", "sensors", "simulator"]):
        alike = [values[run_id] for run_id in group["run_id"]]
        every = dict.fromkeys(key for leaves in alike for key in leaves)
        keys |= dict.fromkeys(key for key in every if len({leaves.get(key) for leaves in alike}) > 1)
    for place, key in enumerate(keys):
        summary.insert(5 + place, key, [values[run_id].get(key, "") for run_id in summary["run_id"]])
    return summary


def _leaves(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Yield a configuration's dotted keys with their values as words."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _leaves(inner, f"{key}.{name}" if key else str(name))
    else:
        yield key, str(value)
