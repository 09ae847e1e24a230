"""Small results directories with made-up records, which the tests of the reading floor share."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.stored import StoredResults
from navbench.cli.worlds import world_of
from navbench.experiments.store import Results
from navbench.experiments.tunings import Check
from navbench.metrics import DECLARED
from navbench.records import CellKey, Names, RobotRecord, Thing, TuningKey
from navbench.report.document import Blocks, Document
from navbench.report.markdown import render
from navbench.report.page import Page
from navbench.report.reports import write_document

FloatArray = NDArray[np.float64]
Fleet = list[RobotRecord]

AOUF2019 = "navbench.controllers.aouf2019.measures"
LEI2014 = "navbench.controllers.lei2014.measures"
NEMEIKSIS2019 = "navbench.controllers.nemeiksis2019.measures"
ZHAO2017 = "navbench.controllers.zhao2017.measures"
ZHAO2018 = "navbench.controllers.zhao2018.measures"
LIMIT_S = 60.0
TRACE = ("behavior", "heading_error_rad", "goal_distance_m", "at_obstacle", "stalled")
WORLD = {
    "bounds": {"x_min_m": -1.0, "x_max_m": 4.0, "y_min_m": -1.0, "y_max_m": 1.0},
    "boxes": [{"x_m": 1.5, "y_m": 0.5, "length_m": 0.2, "width_m": 0.2}],
    "starts": [{"x_m": 0.0, "y_m": 0.0, "heading_rad": 0.0}],
    "goals": [{"x_m": 3.0, "y_m": 0.0}],
    "goal_tolerance_m": 0.1,
    "time_limit_s": LIMIT_S,
}
ROBOT = {"radius_m": 0.1, "track_m": 0.15, "wheel_speed_max_mps": 0.5, "wheel_accel_max_mps2": None}
THEIRS: dict[str, Any] = {  # a study that somebody else ran
    "name": "theirs",
    "title": "Theirs",
    "summary": "What they found.",
    "claims": {"mine": {"says": "mine", "holds": "above 0", "measure": "share_reached", "of": {"label": "A"}}},
    "report": ["verdicts", {"name": "summary", "file": "sums"}, "failures"],
}
CROSSING: dict[str, Any] = {  # two robots change places among what is drawn anew for each episode
    "source": {
        "_target_": "navbench.world.generators.Scattered",
        "base": {
            "_target_": "navbench.world.Layout",
            "bounds": {"x_min_m": 0.0, "x_max_m": 20.0, "y_min_m": 0.0, "y_max_m": 10.0},
            "starts": [{"x_m": 1.0, "y_m": 5.0}, {"x_m": 19.0, "y_m": 5.0}],
            "goals": [{"x_m": 19.0, "y_m": 5.0}, {"x_m": 1.0, "y_m": 5.0}],
        },
        "gap_m": 0.5,
        "parts": {
            "discs": {"_target_": "navbench.world.generators.Discs", "count": [2, 3], "radius_m": [0.4, 0.8]},
            "polygons": {
                "_target_": "navbench.world.generators.Polygons",
                "count": [1, 2],
                "radius_m": [0.5, 0.9],
                "corners": [3, 6],
            },
            "movers": {
                "_target_": "navbench.world.generators.Wander",
                "count": [2, 3],
                "radius_m": [0.3, 0.6],
                "speed_mps": [0.2, 0.8],
                "leg_m": [2.0, 8.0],
                "polygon_share": 0.5,
                "corners": [3, 5],
                "duration_s": LIMIT_S,
            },
        },
    },
    "goal_tolerance_m": 0.2,
    "time_limit_s": LIMIT_S,
}
SOURCES = {
    "controller": {"build.kp": {"public": "a course"}, "build.gain": {"assumed": "why", "range": [0.5, 2.0]}},
    "world": {"boxes": {"fitted": "Fig 1"}},
    "robot": {"radius_m": {"paper": "Table 1"}},
}


def metrics_of(*values: float) -> dict[str, float]:
    """Return the value of each of navbench's own metrics by its name, in their order."""
    return dict(zip((metric.name for metric in DECLARED), values, strict=True))


def a_record(outcome: Any = "reached", time_s: float = 10.0, length_m: float = 3.0, **changes: Any) -> RobotRecord:
    """Return what a robot did that drove straight ahead."""
    metrics = metrics_of(length_m, time_s, int(outcome == "collided"), 0.1, length_m / time_s, 1.0, 0.5, 2, 0, 0, 0.0)
    t_s = np.linspace(0.0, time_s, 5)
    speed = np.full(5, length_m / time_s)
    states = np.column_stack([t_s, 0.29 * t_s, 0.0 * t_s, 0.0 * t_s, speed, 0.0 * t_s])
    nothing = np.zeros(5)
    traces = np.column_stack([nothing, nothing, 3.0 - 0.29 * t_s, nothing, nothing])
    record = RobotRecord(0, outcome, "", metrics, states, traces, TRACE, np.full(4, 1e-5))
    return record._replace(**changes)


def a_drive(
    v_mps: Sequence[float],
    outcome: Any = "reached",
    index: int = 0,
    hit: Thing | None = None,
    places: Sequence[tuple[float, float]] | None = None,
    contacts: tuple[int, int, int] = (0, 0, 0),
    time_s: float | None = None,
    **trace: Sequence[float],
) -> RobotRecord:
    """Return what one robot of a fleet did in control periods of 1 s, at rest at its start unless told otherwise.

    Args:
        v_mps: its speed in each period; as in a run, the last one is repeated at the end, where no trace is left.
        outcome: how it ended.
        index: which robot.
        hit: what it hit.
        places: where it was at the beginning of each period and at the end.
        contacts: all its contacts, those with robots, and those while it stood.
        time_s: when it ended; without it, after the last period.
        trace: what its controller traced, a value a period.
    """
    count = len(v_mps)
    states = np.zeros((count + 1, 6))
    states[:, 0] = np.arange(count + 1.0)
    states[:, 1:3] = np.zeros((count + 1, 2)) if places is None else np.array(places)
    states[:, 4] = [*v_mps, v_mps[-1]]
    traces = np.array([[*values, math.nan] for values in trace.values()]).reshape(len(trace), count + 1).T
    end_s = float(count) if time_s is None else time_s
    metrics = metrics_of(1.0, end_s, contacts[0], 0.1, 1.0 / end_s, 1.0, 0.5, 2, *contacts[1:], 0.0)
    return RobotRecord(index, outcome, "", metrics, states, traces, tuple(trace), np.full(count, 1e-5), hit)


def a_cell(
    label: str = "A",
    world: str = "plain",
    name: str = "printed",
    tuning: str = "",
    seed: int = -1,
    scene: Mapping[str, Any] = WORLD,
    **build: Any,
) -> CellKey:
    """Return a study's cell in a world of this configuration; what else differs makes its run_id."""
    run_id = f"{label}-{world}-{name}-{seed}".replace(" ", "").lower()
    configuration = {
        "controller": {"build": {"_target_": "somewhere.Pid", "kp": 5.0, "gain": 1.0, **build}},
        "world": scene,
        "robot": ROBOT,
        "sensors": {},
        "simulator": {},
    }
    names = Names("pid", world, "disc", "none", "ideal")
    return CellKey(name, label, names, configuration, SOURCES, run_id, run_id, 0, 1, 0, tuning, seed)


def a_tuning(name: str, seed: int, n: int = 10) -> TuningKey:
    """Return the key of a tuning by a swarm of n."""
    configuration = {
        "tuner": {"build": {"_target_": "somewhere.Pso", "n": n}},
        "objective": {"weights": {"heading_ise": 1.0}},
        "tunable": {"kp": {"low": 0.0, "high": 10.0, "scale": "linear"}},
    }
    return TuningKey(name, name, "ise", "pid", ("plain",), f"{n}", f"{name}-{seed}-{n}", seed, 4, configuration, {})


def store(
    path: Path,
    cells: Sequence[tuple[CellKey, Sequence[RobotRecord | Fleet]]],
    study: Mapping[str, Any] | None = None,
    costs: Mapping[tuple[str, int], Sequence[float]] | None = None,
    descriptions: Mapping[str, Mapping[str, Any]] | None = None,
    n: int = 10,
) -> StoredResults:
    """Write a results directory and return it as it is read.

    Args:
        path: the directory.
        cells: each cell with a record an episode, or with the records of an episode's robots.
        study: the study's name, title, claims and report.
        costs: of each tuning, by name and seed, the cost of each evaluation; the values of kp rise from 1 by 3.
        descriptions: named tables.
        n: of the swarm that tuned.
    """
    results = Results(path)
    tunings = [a_tuning(name, seed, n) for name, seed in costs or {}]
    results.begin([cell for cell, _ in cells], tunings, study)
    for cell, records in cells:
        fleets = [[one] if isinstance(one, RobotRecord) else one for one in records]
        world, _ = world_of(cell.configuration["world"], cell.names.world)
        pairs = [
            (episode, record._replace(layout=world.drawn_for(cell.seed, episode) if len(record.states) else None))
            for episode, fleet in enumerate(fleets)
            for record in fleet
        ]
        results.write_batch(cell, range(len(records)), pairs)
    for tuning, values in zip(tunings, (costs or {}).values(), strict=True):
        columns = {
            "evaluation": list(range(len(values))),
            "cost": list(values),
            "reached": [1] * len(values),
            "robots": [1] * len(values),
            "kp": [min(1.0 + 3.0 * i, 10.0) for i in range(len(values))],
        }
        results.write_evaluations(tuning, columns)
        checks = [("searched", "planar", 0), ("verified", "ideal", 0), ("fresh", "planar", 1), ("fresh", "ideal", 1)]
        results.write_checks(tuning, [Check(*check, 1, min(values) + i, 1, 1) for i, check in enumerate(checks)])
    for name, table in (descriptions or {}).items():
        results.write_description(name, table)
    results.end()
    return StoredResults(results)


def told(section: Callable[..., Blocks], stored: StoredResults, out: Path, **arguments: Any) -> str:
    """Build a section, write what it consists of, and return it in Markdown; ``file`` is "t" unless it is given."""
    own = {name: arguments.pop(name) for name in ("file", "caption") if name in arguments}
    document = Document("", section(Page(stored, out, **{"file": "t", "caption": "c", **own}), **arguments))
    write_document(document, out)
    return render(document)
