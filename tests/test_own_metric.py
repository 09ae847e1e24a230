"""A metric of a user's own: one Python file in a folder outside, and a word of the command line."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import Command, in_a_process

from navbench.cli.configuration import compose_cell
from navbench.cli.study_configuration import compose_tuning
from navbench.experiments.tunings import run_tuning
from navbench.metrics import DECLARED, Metric
from navbench.validation import DescriptionError

OWN = """
from navbench.metrics import RobotRun, metric


@metric("detour", unit="", better="less", definition="path length over the straight line", source="a book")
def detour(run: RobotRun) -> float:
    return run.path_length_m / run.straight_m


@metric("turns", unit="rad", better="more", definition="nothing but where it reached")
def turns(run):
    if run.outcome != "reached":
        raise ValueError("it did not arrive")
    return "many" if run.time_s > 15.0 else run.turning_rad


@metric("progress_mps", unit="m/s", better="more", definition="the straight line over the time")
def progress(run):
    return run.straight_m / run.time_s


@metric("label", unit="", better="", definition="a column of that name is there")
def taken(run):
    return 1.0


def plain(run):
    return 1.0
"""
WORDS = ("controller=go_to_goal", "world=empty")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    (tmp_path / "own_metrics.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    sys.modules.pop("own_metrics", None)  # the next test has a file of its own


def test_a_metric_in_one_file_is_in_the_table_the_csv_file_and_the_report(folder: Path, command: Command) -> None:
    words = ("episodes=6", "workers=2", "start_jitter_m=0.05", "metrics=[own_metrics.detour]")
    done = command(*WORDS, *words, "hydra.run.dir=out")
    assert done.code == 0, done.err
    heads, _, values, *_ = done.out.splitlines()
    assert heads.split()[-1] == "detour"
    rows = pd.read_csv(folder / "out/episodes.csv")
    assert list(rows.columns)[-2:] == ["detour", "layout_id"]
    assert (rows["detour"] > 0.5).all()
    assert float(values.split()[-1]) == pytest.approx(rows["detour"].mean(), rel=1e-3)
    (folder / "own_metrics.py").unlink()  # stored results need no import
    done = in_a_process(folder, "report", "out", "out=report")
    assert done.code == 0, done.err
    text = (folder / "report/report.md").read_text()
    assert "| detour ↓ |" in text
    assert "| detour |  | less | path length over the straight line | a book |" in text
    assert pd.read_csv(folder / "report/tables/summary.csv")["detour"][0] == pytest.approx(rows["detour"].mean())


def test_the_manifest_keeps_every_metrics_declaration_without_what_a_lost_robot_has(
    folder: Path, command: Command
) -> None:
    assert command(*WORDS, "workers=1", "metrics=[own_metrics.detour]", "hydra.run.dir=out").code == 0
    manifest = json.loads((folder / "out/manifest.json").read_text())
    assert [metric["name"] for metric in manifest["metrics"]] == [*(metric.name for metric in DECLARED), "detour"]
    assert manifest["metrics"][-1] == {
        "name": "detour",
        "unit": "",
        "better": "less",
        "definition": "path length over the straight line",
        "source": "a book",
        "averaged": True,
    }


@pytest.mark.parametrize(
    ("limit_s", "said"),
    [
        (0.5, 'ValueError: it did not arrive (own_metrics.py, line 13: raise ValueError("it did not arrive"))'),
        (60.0, "must return a number; it returned 'many' (own_metrics.py, line 10)"),
    ],
)
def test_a_metric_that_fails_costs_its_value_and_no_more(
    limit_s: float, said: str, folder: Path, command: Command
) -> None:
    words = ("controller=sflc", "world=deadlock", f"world.time_limit_s={limit_s}", "workers=1")
    done = command(*words, "metrics=[own_metrics.turns]", "hydra.run.dir=out")
    assert done.code == 0, done.err
    assert said in done.out
    row = pd.read_csv(folder / "out/episodes.csv").iloc[0]
    assert pd.isna(row["turns"])
    assert row["reason"] == f"metric turns: {said}"
    assert row["path_length_m"] > 0.0


def test_a_metric_is_compared_the_way_that_is_better(folder: Path, command: Command) -> None:
    words = ("-m", "controller=go_to_goal,sflc", "world=empty", "episodes=3", "start_jitter_m=0.05", "workers=1")
    assert command(*words, "metrics=[own_metrics.detour,own_metrics.progress]", "hydra.sweep.dir=out").code == 0
    assert command("report", "out", "out=report").code == 0
    table = pd.read_csv(next((folder / "report/tables").glob("comparison_*.csv"))).set_index("label")
    rows = pd.read_csv(folder / "out/episodes.csv").pivot(index="episode", columns="controller")
    for name, is_better in (("detour", np.less), ("progress_mps", np.greater)):
        mine, other = (rows[name, label].to_numpy() for label in ("sflc", "go_to_goal"))
        assert (mine != other).all()
        assert table[f"{name}_better"]["sflc"] == is_better(mine, other).mean()
        assert table[name]["sflc"] == np.median(mine)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ("own_metrics.detuor", "metrics[0]=own_metrics.detuor: there is no such function; did you mean detour?"),
        ("own_metrics.plain", "metrics[0]=own_metrics.plain: is no metric; declare it with @metric"),
        ("own_metrics.taken", "metrics[0]=own_metrics.taken: its name label is taken"),
        ("time_s", "metrics[0]=time_s: must name a metric of your own as module.function; did you mean time_s? always"),
        ("nope", "module.function; always measured: path_length_m, time_s, "),
        ("own_metrics.detour,own_metrics.detour", "metrics[1]=own_metrics.detour: its name detour is taken"),
        ("nowhere.detour", "metrics[0]=nowhere.detour: cannot be imported: ModuleNotFoundError"),
    ],
)
def test_what_is_no_metric_is_refused_in_one_line(names: str, message: str, folder: Path) -> None:
    with pytest.raises(DescriptionError) as refused:
        compose_cell(*WORDS, f"metrics=[{names}]")
    assert message in str(refused.value)


@pytest.mark.parametrize("changes", [{"name": "Path length"}, {"better": "shorter"}])
def test_a_declaration_that_cannot_be_read_is_refused(changes: dict[str, str]) -> None:
    values = {"name": "detour", "unit": "", "better": "less", "definition": "", **changes}
    with pytest.raises(ValueError, match=next(iter(changes.values()))):
        Metric(**values)  # type: ignore[arg-type]


def test_a_metric_is_part_of_a_cells_identity_and_no_metric_leaves_it_as_it_was(folder: Path) -> None:
    alone, more = compose_cell(*WORDS).key(), compose_cell(*WORDS, "metrics=[own_metrics.detour]").key()
    assert "metrics" not in alone.configuration
    assert alone.run_id != more.run_id


def test_an_objective_may_weigh_any_metric_of_the_cell_and_no_other(folder: Path) -> None:
    words = ["controller=pid", "world=corner", "tuner=random", "budget=10", "+objective.weights.detour=100.0"]
    with pytest.raises(DescriptionError, match=r"objective.weights: must name at least one of .*, and no other"):
        compose_tuning(words)
    weighed, _, _ = compose_tuning([*words, "metrics=[own_metrics.detour]"])
    plain, _, _ = compose_tuning(words[:-1])
    costs = [run_tuning(tuning).evaluations for tuning in (weighed, plain)]
    assert all(one.cost > other.cost + 10.0 for one, other in zip(*costs, strict=True))
