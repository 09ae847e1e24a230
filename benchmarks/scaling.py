"""How times grow with robots, obstacles, episodes and workers."""

import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import psutil

from benchmarks.field import Field
from benchmarks.harness import Cell, Effort, Side, Table, median, rates
from navbench.cli.configuration import compose_cell
from navbench.episode.loop import EpisodeRunner
from navbench.experiments.plan import Plan
from navbench.experiments.running import run_plan

SIZES = {
    "robots": (1, 3, 10, 30, 100),
    "discs, all within the ring": (10, 100, 1000, 10000),
    "discs, one a m²": (10, 100, 1000, 10000),
    "episodes": (10, 100, 1000, 10000),
}
CONTROLLERS, WORLDS = ("sflc", "oa_to", "go_to_goal"), ("random_discs", "random_movers")
SWEPT = {"planar": 500, "pybullet": 50}  # episodes of each


def runs(runner: EpisodeRunner, episodes: int = 1) -> Side:
    """Return a function that runs some episodes to their time limit, and counts them as one."""

    def run() -> int:
        for episode in range(episodes):
            for record in runner.run(episode):
                assert record.outcome == "timed_out", record
        return 1

    return run


def field_of(kind: str, size: int) -> Field:
    """Return the field of a size."""
    return Field(size if kind == "robots" else 1, size if "discs" in kind else 10, 1.0 if "m²" in kind else None)


def of_kind(kind: str, simulator: str, effort: Effort, on: ExitStack) -> dict[str, Side]:
    """Return what to time for each size."""
    sides = {}
    for size in SIZES[kind][: 2 if effort.is_quick else None]:
        runner = field_of(kind, size).runner(simulator, steps=5 if kind == "episodes" else effort.cut(200), on=on)
        sides[str(size)] = runs(runner, size if kind == "episodes" else 1)
    return sides


def scaling(effort: Effort) -> Table:
    """Measure times over sizes, and the exponent: the slope of log time on log size."""
    rows: list[tuple[Cell, ...]] = []
    for kind in SIZES:
        for simulator in ("pybullet", "planar"):
            with ExitStack() as on:
                found = rates(of_kind(kind, simulator, effort, on), effort)
            sizes, times = np.log([float(size) for size in found]), -np.log(np.array(list(found.values())))
            slopes = [float(np.polyfit(sizes, column, 1)[0]) for column in times.T]
            spans = ", ".join(f"{size}: {1e3 / np.median(found[size]):.3g}" for size in found)
            rows.append((f"{kind}, {simulator}", spans, median(slopes)))
    text = "One robot and 10 discs but for what grows; episodes of 200 control periods, and of 5 where they are many."
    return Table("Scaling", text, ("", "CPU ms by size", "exponent"), rows)


def by(plan: Plan, workers: int) -> Side:
    """Return what runs a plan with so many workers, keeps the results, and returns how many episodes that were."""

    def run() -> float:
        with tempfile.TemporaryDirectory() as folder:
            return run_plan(plan, Path(folder), workers).finished

    return run


def workers(effort: Effort) -> Table:
    """Measure a run in one process and in two, on the clock on the wall."""
    cell = compose_cell("controller=oa_to", "world=random_movers", f"episodes={effort.cut(2000, 4)}")
    plan = Plan(cells=(cell,))
    found = rates({"1": by(plan, 1), "2": by(plan, 2)}, effort, time.perf_counter)
    rows: list[tuple[Cell, ...]] = [
        (name, float(np.median(one)), median([a / b for a, b in zip(one, found["1"], strict=True)]))
        for name, one in found.items()
    ]
    text = "oa_to in random_movers, results kept, on the clock on the wall, the processes' start included."
    return Table("Workers", text, ("workers", "episodes a second", "ratio to one"), rows)


def cpu_of_all() -> float:
    """Return what this process and all that it started have taken [s]."""
    own = psutil.Process()
    return sum(sum(process.cpu_times()[:4]) for process in (own, *own.children(recursive=True)))


def isolation(effort: Effort) -> Table:
    """Measure what it costs that episodes run in processes of their own: a sweep with workers beside one without."""
    rows: list[tuple[Cell, ...]] = []
    for simulator, count in [*SWEPT.items()][: effort.few(len(SWEPT))]:
        words = (f"simulator={simulator}", f"episodes={effort.cut(count)}")
        cells = [compose_cell(f"controller={c}", f"world={w}", *words) for c in CONTROLLERS for w in WORLDS]
        plan = Plan(cells=tuple(cells[: effort.few(len(cells))]))
        found = rates({str(workers): by(plan, workers) for workers in (0, 1, 2)}, effort, cpu_of_all)
        for name, one in found.items():
            more = [round(100.0 * (a / b - 1.0), 6) for a, b in zip(found["0"], one, strict=True)]  # sums of ticks
            rows.append((f"{simulator}, workers={name}", float(np.median(one)), median(more)))
    text = (
        f"A sweep of {', '.join(CONTROLLERS)} in {', '.join(WORLDS)}, results kept, in CPU seconds of all processes; "
        "workers=0 runs all in the driver's own process. That the workers' server starts is not in it: see Start-up."
    )
    return Table("Isolation", text, ("", "episodes a CPU-second", "more CPU than workers=0 [%]"), rows)
