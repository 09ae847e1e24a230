"""What a page plays: the trajectories and layouts of some episodes, failures first, and a row for each robot."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from navbench.analysis.stored import StoredResults, driven
from navbench.experiments.store import ResultsError
from navbench.report.packed import packed_layouts, packed_states, rounded
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.validation import describe

if TYPE_CHECKING:
    import pandas as pd

TRAJECTORIES = 200  # of robots
BYTES = 1_200_000  # of layouts and states
COARSEST = 8  # where these are more, one state in so many at most, before there are fewer episodes
FURTHER = 1000  # robots that failed, and are not played, but have a row
TRACEBACK = 4000  # letters

Episode = tuple[str, int]  # run_id and index


class Playback(NamedTuple):
    """What a page plays.

    Attributes:
        data: plain values for the page's script.
        rows: a row for each robot that is played, and for further ones that failed.
        counts: how many robots ended how, of all.
        note: what is left out, in words.
    """

    data: dict[str, Any]
    rows: list[dict[str, Any]]
    counts: dict[str, int]
    note: str


def playback(stored: StoredResults, budget: int = BYTES) -> Playback:
    """Return what a page plays of some results.

    Args:
        stored: the results.
        budget: for layouts and states [bytes].
    """
    rows = driven(stored.rows)
    rows = rows.assign(place=list(zip(rows["run_id"], rows["episode"], strict=True)))
    failed = rows["outcome"] != "reached"
    robots: dict[Episode, int] = rows["place"].value_counts(sort=False).to_dict()
    lost = set(rows["place"][failed])
    order = [key for of in (True, False) for key in _spread([key for key in robots if (key in lost) == of])]
    most, stride, paths = TRAJECTORIES, 1, _paths(stored, order, robots)
    while True:
        layouts, drawn_in = packed_layouts({key: stored.world(*key) for key in paths})
        states, told = packed_states(paths, stride)
        if len(layouts) + len(states) <= budget or len(paths) <= 1:
            break
        if len(states) > len(layouts) and stride < COARSEST:
            stride *= 2
        else:
            most //= 2
            paths = {key: paths[key] for key in _first(paths, robots, most)}
    numbers = {key: number for number, key in enumerate(paths)}
    played = rows["place"].isin(paths.keys())
    shown = [*np.flatnonzero(played), *np.flatnonzero(failed & ~played)[:FURTHER]]
    listed = [_row(stored, row, numbers) for row in rows.iloc[shown].to_dict("records")]
    cells = list(dict.fromkeys(run_id for run_id, _ in paths))
    ends = dict(zip(zip(rows["place"], rows["robot_index"], strict=True), rows["outcome"], strict=True))
    episodes = [
        {
            "cell": cells.index(key[0]),
            "episode": key[1],
            "layout": drawn_in[key],
            "robots": [{"robot": robot, "outcome": ends[key, robot], **of} for robot, of in told[key].items()],
        }
        for key in paths
    ]
    data = {"cells": [_cell(stored, run_id) for run_id in cells], "episodes": episodes, "words": _words(stored)}
    counts = rows["outcome"].value_counts().sort_index(key=lambda names: names != "reached").to_dict()
    return Playback({**data, "layouts": layouts, "states": states}, listed, counts, _note(failed, played, stride))


def _spread(keys: Sequence[Episode]) -> list[Episode]:
    """Return keys in an order of which every beginning is an even sample: by their places' bits, reversed."""
    bits = len(keys).bit_length()
    return [keys[place] for place in sorted(range(len(keys)), key=lambda place: f"{place:0{bits}b}"[::-1])]


def _first(keys: Any, robots: Mapping[Episode, int], most: int) -> Iterator[Episode]:
    """Yield the first keys, of so many robots at most, and at least one."""
    total = 0
    for key in keys:
        total += robots[key]
        if robots[key] < total > most:
            return
        yield key


def _paths(
    stored: StoredResults, order: Sequence[Episode], robots: Mapping[Episode, int]
) -> "dict[Episode, dict[int, pd.DataFrame]]":
    """Return the robots' trajectories of the first episodes, in this order, whose cells keep them."""
    found: dict[Episode, dict[int, pd.DataFrame]] = {}
    without: set[str] = set()
    while True:
        wanted = dict.fromkeys(_first((key for key in order if key[0] not in without), robots, TRAJECTORIES))
        for run_id in dict.fromkeys(run_id for run_id, _ in wanted):
            try:
                of_run = stored.results.trajectories(run_id)
            except ResultsError:
                without.add(run_id)
                continue
            for (episode, robot), places in of_run.groupby(["episode", "robot_index"]).indices.items():
                if (run_id, episode) in wanted:
                    found.setdefault((run_id, int(episode)), {})[int(robot)] = of_run.iloc[places]
        if not any(run_id in without for run_id, _ in wanted):
            return {key: found[key] for key in wanted if key in found}


def _row(stored: StoredResults, row: Mapping[Any, Any], numbers: Mapping[Episode, int]) -> dict[str, Any]:
    """Return what a table says of a robot: ``place`` is its episode's among those that are played, or None."""
    cell = stored.configuration(row["run_id"])
    name, world = cell["name"], cell["world"]
    hit = f"hit {row['hit']} {row['hit_index']}" if row.get("hit") else ""
    return {
        **{key: row[key] for key in ("seed", "episode", "robot_index", "outcome", "time_s", "path_length_m")},
        "label": cell["label"],
        "world": name if name.startswith(world) else f"{world} ({name})",
        "reason": row["reason"] or hit,
        "traceback": (row.get("traceback") or "")[-TRACEBACK:],
        "place": numbers.get(row["place"]),
    }


def _cell(stored: StoredResults, run_id: str) -> dict[str, Any]:
    """Return what the page knows of a cell: its names, its robot's radius, and its range sensors."""
    cell = stored.configuration(run_id)
    configuration = cell["configuration"]
    robot = describe(Robot, configuration["robot"], "robot")
    mounts: list[list[Any]] = []
    if configuration["sensors"]:
        suite = describe(Sensors, configuration["sensors"], "sensors").scaled_to(robot.radius_m)
        lengths = [
            [m.x_m, m.y_m, m.heading_rad, m.max_range_m or 0.0, m.cone_half_angle_rad or 0.0, m.rays or 1]
            for m in suite.complete_mounts()
        ]
        mounts = [[m.role, *of] for m, of in zip(suite.mounts, rounded(lengths), strict=True)]
    names = {key: cell[key] for key in ("label", "name", "world", "simulator", "seed")}
    return {
        **names,
        "radius": robot.radius_m,
        "tolerance": configuration["world"]["goal_tolerance_m"],
        "mounts": mounts,
    }


def _words(stored: StoredResults) -> dict[str, dict[str, str]]:
    """Return what the study's report calls the values of a trace, as its time series are told it."""
    outline = [spec for spec in (stored.manifest["study"] or {}).get("report") or [] if isinstance(spec, Mapping)]
    return {
        column: {f"{value:g}": word for word, value in ticks.items()}
        for spec in outline
        for axis, ticks in (spec.get("ticks") or {}).items()
        for column in (spec.get("series") or {}).get(axis, {})
    }


def _note(failed: "pd.Series[bool]", played: "pd.Series[bool]", stride: int) -> str:
    """Return how many of the robots' trajectories are played, and how coarsely."""
    coarse = f"; one state in {stride}" if stride > 1 else ""
    further = int((failed & ~played).sum())
    rows = f" The table also lists {min(further, FURTHER)} of the other {further} that failed." if further else ""
    return (
        f"Played here: {int(played.sum())} of {len(played)} trajectories, {int((played & failed).sum())} of the "
        f"{int(failed.sum())} that failed; failures first, then an even sample{coarse}. Places are rounded to a "
        f"millimetre.{rows}"
    )
