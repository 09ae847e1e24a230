"""Reports of several directories in which things are called alike."""

from pathlib import Path

import pytest
from stored import a_cell, a_record, store

from navbench.analysis.stored import StoredResults
from navbench.experiments.store import Results
from navbench.report.reports import write_report
from navbench.report.runs import Joined

HERE = {("pso", 0): [4.0, 2.0], ("pso", 1): [4.0, 3.0]}


def a_tuned(path: Path, costs: dict[tuple[str, int], list[float]], n: int = 10) -> Results:
    """Return the results of tunings by a swarm of n, and of a cell that takes the best of each."""
    cells = [
        (a_cell(name, name=f"swarm of {n}", tuning=name, seed=seed, kp=min(of)), [a_record()])
        for (name, seed), of in costs.items()
    ]
    return store(path, cells, {"name": "tune pso", "claims": {}, "report": []}, costs, n=n).results


def names_of(*runs: Results) -> dict[tuple[str, int], list[float]]:
    """Return the costs of each tuning by its name and seed, as a report of these directories has them."""
    stored = StoredResults(Joined(runs))
    rows = stored.evaluations
    costs: dict[tuple[str, int], list[float]] = {}
    for name, seed, cost in rows[["name", "seed", "cost"]].to_numpy().tolist():
        costs.setdefault((name, seed), []).append(cost)
    assert {(t["name"], t["seed"]) for t in stored.manifest["tunings"]} == set(costs)
    assert set(zip(stored.cells["tuning"], stored.cells["tuning_seed"], strict=True)) == set(costs)
    assert list(stored.cells["label"]) == list(stored.cells["tuning"])
    assert set(zip(stored.checks["name"], stored.checks["seed"], strict=True)) == set(costs)
    return costs


def test_tunings_of_one_name_are_called_by_what_differs_beside_their_seeds(tmp_path: Path) -> None:
    here = a_tuned(tmp_path / "here", HERE)
    other = a_tuned(tmp_path / "other", {("pso", 0): [5.0, 1.0]}, n=20)
    assert names_of(here, other) == {
        ("pso (n=10)", 0): [4.0, 2.0],
        ("pso (n=10)", 1): [4.0, 3.0],
        ("pso (n=20)", 0): [5.0, 1.0],
    }


def test_tunings_that_differ_in_their_seeds_alone_keep_their_name(tmp_path: Path) -> None:
    more = a_tuned(tmp_path / "more", {("pso", 2): [5.0, 1.0]})
    assert names_of(a_tuned(tmp_path / "here", HERE), more) == {**HERE, ("pso", 2): [5.0, 1.0]}


def test_a_tuning_that_stands_in_two_directories_counts_once(tmp_path: Path) -> None:
    here, copy = a_tuned(tmp_path / "here", HERE), a_tuned(tmp_path / "copy", HERE)
    assert names_of(here, copy) == HERE
    assert StoredResults(Joined([here, copy])).missing == []


@pytest.mark.parametrize("n", [10, 20])
def test_a_report_of_two_tunings_of_one_name_is_whole(tmp_path: Path, n: int) -> None:
    costs = {("pso", 0): [4.0, 2.0]}
    runs = [a_tuned(tmp_path / "here", costs), a_tuned(tmp_path / "other", costs, n=n)]
    written = write_report(runs, tmp_path / "out")
    assert written.problems == []
    text = (tmp_path / "out/report.md").read_text()
    label = "pso" if n == 10 else "pso (n=20)"
    assert f"| {label} | 1 | 2 | 2.00000 |" in text
