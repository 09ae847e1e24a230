"""What one robot did in an episode, as its picture takes it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.stored import StoredResults
from navbench.experiments.store import ResultsError
from navbench.records import Outcome

if TYPE_CHECKING:
    import pandas as pd

ACTIVE = "active_"  # what the columns of a trace begin with that say, 0 or 1, which behaviour is active
BANDS = ("#f6b48f", "#8fc6e8", "#9fd8a5", "#c9b3dd", "#f2dd7a", "#c9c9c9")  # of behaviours, along and below a path
FEW = 4  # robots: more are told apart by colour alone


@dataclass(frozen=True)
class Drive:
    """What one robot did: its row of the table of episodes, its trajectory, and how it is drawn."""

    row: Mapping[Any, Any]
    path: "pd.DataFrame"
    color: str

    @property
    def name(self) -> str:
        """What pictures call it: R1, R2, ..."""
        return named("robot", self.row["robot_index"])

    @property
    def length_m(self) -> float:
        """How long its path is [m]."""
        return float(np.hypot(*np.diff(self.path[["x_m", "y_m"]].to_numpy(), axis=0).T).sum())

    @property
    def end(self) -> str:
        """How it ended, such as "collided after 3.20 s: hit box 1"."""
        after = f" after {self.path['t_s'].iloc[-1]:.2f} s" if len(self.path) else ""
        reason, kind, index = str(self.row["reason"]), str(self.row["hit"]), int(self.row["hit_index"])
        why = f": {reason.replace(f'{kind} {index}', named(kind, index))}" if reason else ""
        return f"{str(self.row['outcome']).replace('_', ' ')}{after}{why}"


def robots_of(stored: StoredResults, run_id: str, episode: int) -> list[dict[Any, Any]]:
    """Return the rows of an episode in the table of episodes, one a robot.

    Raises:
        ResultsError: they are not of the robots that its layout has.
    """
    rows = stored.rows[(stored.rows["run_id"] == run_id) & (stored.rows["episode"] == episode)]
    robots = range(len(stored.world(run_id, episode).starts))
    if list(rows["robot_index"]) != list(robots) or not rows["outcome"].isin(get_args(Outcome)).all():
        raise ResultsError(f"{stored.results.path}: the rows of episode {episode} are not those of its robots")
    return rows.to_dict("records")


def named(kind: str, index: int) -> str:
    """Return what pictures call a thing of some kind: "box 1", but a robot R1, R2, ..."""
    return f"R{index + 1}" if kind == "robot" else f"{kind} {index}"


def active_of(path: "pd.DataFrame") -> dict[str, NDArray[np.bool_]]:
    """Return what the trace's columns ``active_*`` tell: each behaviour's name, and (n,) where it is active."""
    named = [name for name in path.columns if name.startswith(ACTIVE)]
    return {name.removeprefix(ACTIVE).replace("_", " "): (path[name] == 1.0).to_numpy() for name in named}
