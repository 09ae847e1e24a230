"""What a page plays: the trajectories and layouts of some episodes, failures first, and a row for each robot."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.resolving import lies_outside
from navbench.analysis.stored import StoredResults, driven
from navbench.experiments.store import ResultsError
from navbench.report.packed import packed_layouts, packed_states, rounded
from navbench.robot import Robot
from navbench.sensors import suite_of
from navbench.validation import describe

if TYPE_CHECKING:
    import pandas as pd

TRAJECTORIES = 200  # of robots
BYTES = 1_200_000  # of layouts and states
COARSEST = 8  # where these are more, one state in so many at most, before there are fewer episodes
FURTHER = 1000  # robots that failed, and are not played, but have a row
TRACEBACK = 4000  # letters

Episode: TypeAlias = tuple[str, int]  # run_id and index
Paths: TypeAlias = "dict[Episode, dict[int, pd.DataFrame]]"  # each robot's trajectory


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


def playback(stored: StoredResults, trust: bool = False, budget: int = BYTES) -> Playback:
    """Return what a page plays of some results.

    Args:
        stored: the results.
        trust: whether a controller outside navbench may be asked what its trace's values are called.
        budget: for layouts and states [bytes].
    """
    rows = driven(stored.rows)
    keys: list[Episode] = list(zip(rows["run_id"].tolist(), rows["episode"].tolist(), strict=True))
    failed = (rows["outcome"] != "reached").to_numpy(dtype=bool)
    packed = _packed(stored, _paths(stored, *_order(keys, failed)), budget)
    numbers = {key: number for number, key in enumerate(packed.told)}
    played = np.array([key in numbers for key in keys], dtype=bool)
    shown = [*np.flatnonzero(played), *np.flatnonzero(failed & ~played)[:FURTHER]]
    listed = [
        {**_row(stored, row), "place": numbers.get(keys[i])}
        for i, row in zip(shown, rows.iloc[shown].to_dict("records"), strict=True)
    ]
    outcomes = dict(zip(zip(keys, rows["robot_index"], strict=True), rows["outcome"], strict=True))
    cells = list(dict.fromkeys(run_id for run_id, _ in numbers))
    episodes = [
        {
            "cell": cells.index(key[0]),
            "episode": key[1],
            "layout": packed.drawn_in[key],
            "robots": [{"robot": robot, "outcome": outcomes[key, robot], **one} for robot, one in of.items()],
        }
        for key, of in packed.told.items()
    ]
    data = {
        "cells": [_cell(stored, run_id, trust) for run_id in cells],
        "episodes": episodes,
        "layouts": packed.layouts,
        "states": packed.states,
    }
    ends = Counter(rows["outcome"])
    counts = {name: ends[name] for name in sorted(ends, key=lambda name: name != "reached")}
    return Playback(data, listed, counts, _note(failed, played, packed.stride))


def _order(keys: Sequence[Episode], failed: NDArray[np.bool_]) -> tuple[list[Episode], dict[Episode, int]]:
    """Return the episodes in the order in which they are played, failures first, and how many robots each has."""
    robots = Counter(keys)
    lost = {key for key, is_failed in zip(keys, failed, strict=True) if is_failed}
    order = [key for of in (True, False) for key in _spread([key for key in robots if (key in lost) == of])]
    return order, robots


def _spread(keys: Sequence[Episode]) -> list[Episode]:
    """Return keys in an order of which every beginning is an even sample: by their places' bits, reversed."""
    bits = len(keys).bit_length()
    return [keys[place] for place in sorted(range(len(keys)), key=lambda place: f"{place:0{bits}b}"[::-1])]


def _first(keys: Iterable[Episode], robots: Mapping[Episode, int], most: int) -> Iterator[Episode]:
    """Yield the first keys, of so many robots at most, and at least one."""
    total = 0
    for key in keys:
        total += robots[key]
        if robots[key] < total > most:
            return
        yield key


def _paths(stored: StoredResults, order: Sequence[Episode], robots: Mapping[Episode, int]) -> "Paths":
    """Return the robots' trajectories of the first episodes, in this order, whose cells keep them."""
    found: Paths = {}
    without: set[str] = set()
    while True:
        wanted = dict.fromkeys(_first((key for key in order if key[0] not in without), robots, TRAJECTORIES))
        for run_id in dict.fromkeys(run_id for run_id, _ in wanted):
            try:
                of_run = stored.results.trajectories(run_id)
            except ResultsError:
                without.add(run_id)
                continue
            places: Mapping[Any, Any] = of_run.groupby(["episode", "robot_index"]).indices
            for (episode, robot), of in places.items():
                if (run_id, episode) in wanted:
                    found.setdefault((run_id, int(episode)), {})[int(robot)] = of_run.iloc[of]
        if not any(run_id in without for run_id, _ in wanted):
            return {key: found[key] for key in wanted if key in found}


class Packed(NamedTuple):
    """Packed episodes, see ``navbench.report.packed``; of the states one in ``stride`` is kept."""

    layouts: str
    drawn_in: Mapping[Episode, int]
    states: str
    told: Mapping[Episode, Mapping[int, Mapping[str, Any]]]
    stride: int


def _packed(stored: StoredResults, paths: "Paths", budget: int) -> Packed:
    """Return the first of some episodes, packed into so many bytes: first states are left out, then episodes."""
    stride = 1
    while True:
        layouts, drawn_in = packed_layouts({key: stored.world(*key) for key in paths})
        states, told = packed_states(paths, stride)
        if len(layouts) + len(states) <= budget or len(paths) <= 1:
            return Packed(layouts, drawn_in, states, told, stride)
        if len(states) > len(layouts) and stride < COARSEST:
            stride *= 2
        else:
            paths = {key: paths[key] for key in list(paths)[: len(paths) // 2]}


def _row(stored: StoredResults, row: Mapping[Any, Any]) -> dict[str, Any]:
    """Return what a table says of a robot."""
    cell = stored.configuration(row["run_id"])
    name, world = cell["name"], cell["world"]
    hit = f"hit {row['hit']} {row['hit_index']}" if row.get("hit") else ""
    return {
        **{key: row[key] for key in ("seed", "episode", "robot_index", "outcome", "time_s", "path_length_m")},
        "label": cell["label"],
        "world": name if name.startswith(world) else f"{world} ({name})",
        "reason": row["reason"] or hit,
        "traceback": (row.get("traceback") or "")[-TRACEBACK:],
    }


def _cell(stored: StoredResults, run_id: str, trust: bool) -> dict[str, Any]:
    """Return what the page knows of a cell: its names, its robot's radius, its range sensors, its trace's words."""
    cell = stored.configuration(run_id)
    configuration = cell["configuration"]
    robot = describe(Robot, configuration["robot"], "robot")
    mounts: list[list[Any]] = []
    if configuration["sensors"]:
        suite = suite_of(configuration["sensors"]).scaled_to(robot.radius_m)
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
        "words": trace_words(stored, run_id, trust),
    }


def trace_words(stored: StoredResults, run_id: str, trust: bool = False) -> dict[str, dict[str, str]]:
    """Return what the values of a cell's trace are called: by its column and the value as a word."""
    build = stored.configuration(run_id)["configuration"]["controller"]["build"]
    return _words_of_study(stored) | _words_of(build.get("_target_", ""), trust)


def _words_of(controller: str, trust: bool) -> dict[str, dict[str, str]]:
    """Return what a controller calls the values of its trace: nothing where it does not say, or is not trusted."""
    module, _, name = controller.rpartition(".")
    if not module or lies_outside(controller) and not trust:
        return {}
    try:
        told = getattr(getattr(import_module(module), name), "trace_words", {})
        return {column: {str(value): str(word) for value, word in enumerate(words)} for column, words in told.items()}
    except Exception:  # a user's module may raise anything, and may be gone
        return {}


def _words_of_study(stored: StoredResults) -> dict[str, dict[str, str]]:
    """Return what the study's report calls the values of a trace, as its time series are told it."""
    outline = [spec for spec in (stored.manifest["study"] or {}).get("report") or [] if isinstance(spec, Mapping)]
    return {
        column: {f"{value:g}": word for word, value in ticks.items()}
        for spec in outline
        for axis, ticks in (spec.get("ticks") or {}).items()
        for column in (spec.get("series") or {}).get(axis, {})
    }


def _note(failed: NDArray[np.bool_], played: NDArray[np.bool_], stride: int) -> str:
    """Return how many of the robots' trajectories are played, and how coarsely."""
    coarse = f"; one state in {stride}" if stride > 1 else ""
    further = int((failed & ~played).sum())
    rows = f" The table also lists {min(further, FURTHER)} of the other {further} that failed." if further else ""
    return (
        f"Played here: {int(played.sum())} of {len(played)} trajectories, {int((played & failed).sum())} of the "
        f"{int(failed.sum())} that failed; failures first, then an even sample{coarse}. Places are rounded to a "
        f"millimetre.{rows}"
    )
