"""Studies: what was finished is not run again, whatever killed the rest, and wrong studies are refused in one line."""

import json
import os
import random
import re
import signal
import subprocess
import time
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pytest
from commands import NAVBENCH, Command, workers_of

from navbench.cli.configuration import compose_cell
from navbench.cli.study_configuration import compose_study, compose_tuning
from navbench.experiments import parts
from navbench.experiments.plan import Plan
from navbench.experiments.running import run_plan
from navbench.experiments.store import Results
from navbench.experiments.tunings import run_tuning
from navbench.records import CellKey
from navbench.validation import DescriptionError

RESULTS = Path(__file__).parents[2] / "results"
COMMITTED = sorted(file.parent.name for file in RESULTS.glob("*/manifest.json"))
KILLS = int(os.environ.get("NAVBENCH_KILLS", "2"))  # more of them for a closer look


def parts_of(path: Path) -> dict[str, bytes]:
    """Return what must not depend on how often a study was stopped: every part but the latencies, and the report."""
    kinds = ("episodes", "trajectories", "evaluations", "descriptions")
    files = [file for kind in kinds for file in sorted((path / "outputs/study/smoke" / kind).glob("*.parquet"))]
    files += [file for file in sorted((path / "results/smoke").rglob("*")) if file.is_file() and file.suffix != ".json"]
    return {str(file.relative_to(path)): file.read_bytes() for file in files}


def study(folder: Path, *words: str, name: str = "smoke") -> subprocess.Popen[str]:
    command = [NAVBENCH, "study", name, *words]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=folder, text=True, stdout=pipe, stderr=pipe, start_new_session=True)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The study, run without a stop in two worker processes."""
    folder = tmp_path_factory.mktemp("finished")
    run = study(folder, "workers=2")
    out, err = run.communicate()
    assert run.returncode == 0, err
    assert "results/smoke/report.md" in out
    return folder


def test_a_study_is_the_same_with_one_worker_and_with_two(finished: Path, tmp_path: Path) -> None:
    run = study(tmp_path, "workers=1")
    _, err = run.communicate()
    assert run.returncode == 0, err
    assert parts_of(tmp_path) == parts_of(finished)


@pytest.mark.parametrize("moment", range(KILLS))
def test_a_study_that_is_killed_ends_the_same_when_it_is_resumed(moment: int, finished: Path, tmp_path: Path) -> None:
    chance = random.Random(moment)
    run = study(tmp_path, "workers=2")
    while moment % 2 and not workers_of(run.pid) and run.poll() is None:
        time.sleep(0.05)
    time.sleep(chance.uniform(0.3, 3.0))
    if moment % 2:  # a worker: the study runs its batch again, and ends by itself
        if victims := workers_of(run.pid):
            os.kill(chance.choice(victims), signal.SIGKILL)
        _, err = run.communicate()
        assert run.returncode == 0, err
    else:  # the driver, which leaves its workers behind
        os.kill(run.pid, signal.SIGKILL)
        run.wait()
        if _alive(run.pid):
            os.killpg(run.pid, signal.SIGKILL)
        again = study(tmp_path, "workers=2")
        _, err = again.communicate()
        assert again.returncode == 0, err
    assert parts_of(tmp_path) == parts_of(finished)


def _alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize(
    ("begun", "kept"),
    [
        ("evaluations/part-*", r"( after \d+ of \d+ \w+; they are|; what was finished is)"),
        ("episodes/part-*-000025-*", r" after \d+ of 120006 episodes; they are"),  # of a cell without trajectories
    ],
)
def test_an_interrupt_ends_a_study_and_says_how_to_go_on(tmp_path: Path, begun: str, kept: str) -> None:
    text = (Path(__file__).parents[2] / "conf/study/smoke.yaml").read_text()
    (tmp_path / "study").mkdir()
    (tmp_path / "study/longer.yaml").write_text(text.replace("episodes: 60", "episodes: 60000"))
    run = study(tmp_path, "workers=2", "--config-dir", ".", name="longer")
    try:
        while not list((tmp_path / "outputs").rglob(begun)):
            time.sleep(0.005)
            assert run.poll() is None
        run.send_signal(signal.SIGINT)
        _, err = run.communicate(timeout=60)
    finally:
        run.kill()  # or it would run for minutes
    assert run.returncode == 130, err
    assert re.search(rf"^navbench: interrupted{kept} kept in outputs/study/longer, ", err), err
    assert err.endswith("and this goes on from there: navbench study longer workers=2 --config-dir .\n")


def test_finished_parts_are_not_run_again_and_others_are_removed_only_where_that_is_asked_for(tmp_path: Path) -> None:
    chosen = compose_study("smoke")
    path = tmp_path / "study"
    results = run_plan(chosen, path, 1).results
    before = {file: file.stat().st_mtime_ns for file in path.glob("episodes/*.parquet")}
    stray = path / "episodes" / "part-0123456789abcdef-000000-000024.parquet"
    parts.write(path, f"episodes/{stray.name}", pa.table({"run_id": ["of another configuration"]}), {})
    with pytest.raises(DescriptionError, match=f"1 finished parts that are not of this plan, such as .*{stray.name}; "):
        run_plan(chosen, path, 1)
    assert stray.exists()
    told: list[tuple[str, int, int]] = []
    run_plan(chosen, path, 1, progress=lambda *words: told.append(words), overwrite=True)
    assert told == []
    assert not stray.exists()
    assert {file: file.stat().st_mtime_ns for file in path.glob("episodes/*.parquet")} == before
    assert len(results.episodes()) == 2 * (1 + 2) + 120


def test_a_tuned_cell_takes_the_best_parameters_of_its_own_tuning(finished: Path) -> None:
    results = Results(finished / "outputs/study/smoke")
    manifest = results.manifest()
    evaluations = results.evaluations()
    tuned = [cell for cell in manifest["cells"] if cell["tuning"]]
    assert len(tuned) == 4
    for cell in tuned:
        rows = evaluations[evaluations["seed"] == cell["tuning_seed"]]
        best = rows.loc[rows["cost"].idxmin()]
        build = cell["configuration"]["controller"]["build"]
        assert {name: build[name] for name in ("kp", "ki", "kd")} == dict(best[["kp", "ki", "kd"]])


def test_every_evaluation_of_a_tuning_is_kept(finished: Path) -> None:
    evaluations = Results(finished / "outputs/study/smoke").evaluations()
    assert evaluations.groupby("seed")["evaluation"].apply(list).tolist() == [list(range(12))] * 2
    assert (evaluations["reached"] <= evaluations["robots"]).all()
    assert isinstance(evaluations, pd.DataFrame)


WRONG = {
    "claims.reaches.measure=share_reach: there is no such function; did you mean share_reached": (
        "measure: share_reached",
        "measure: share_reach",
    ),
    "claims.quicker.measure: of.then: unknown key; difference takes metric, than": (
        "than: untuned",
        "then: untuned",
    ),
    "holds=often: must be as": ("holds: in 95 % of the cases", "holds: often"),
    "claims.reaches.select.label=S.F.L.X.: no such cell is planned; did you mean S.F.L.C.?": (
        "of: {cell: fair, label: S.F.L.C.}",
        "of: {cell: fair, label: S.F.L.X.}",
    ),
    "claims.quicker.than.label=tuned PID: no such cell is planned; did you mean untuned PID?": (
        "than: untuned PID",
        "than: tuned PID",
    ),
    "report[1].select.name=unfair: no such cell is planned; did you mean fair? there are: printed, fair": (
        "select: {name: fair}",
        "select: {name: unfair}",
    ),
    "report[1].worlds.corner.world=cornr: no such cell is planned; did you mean corner?": (
        "worlds: {corner: corner}",
        "worlds: {corner: cornr}",
    ),
    "report[1].worlds.corner.world=deadlock: no such cell is planned; there are: corner": (
        "worlds: {corner: corner}",
        "worlds: {corner: deadlock}",
    ),
    "report[1].reference.label=S.F.L.X.: no such cell is planned; did you mean S.F.L.C.?": (
        "reference: S.F.L.C.",
        "reference: S.F.L.X.",
    ),
    "report[0].sentences[0].with.t.than.label=tuned PID: no such cell is planned; did you mean untuned PID?": (
        "report:\n",
        "report:\n  - {name: findings, sentences: [{say: '{t}', with: {t: {name: difference, metric: time_s, "
        "cell: fair, label: S.F.L.C., than: tuned PID}}}]}\n",
    ),
    "report[0].cells.all.label=S.F.L.X.: no such cell is planned": (
        "report:\n",
        "report:\n  - {name: robustness, cells: {all: {label: S.F.L.X.}}, worlds: {corner: corner}}\n",
    ),
    "report[0].groups.one.world=cornr: no such cell is planned": (
        "report:\n",
        "report:\n  - {name: crossed_tables, select: {name: fair}, groups: {one: [corner, cornr]}}\n",
    ),
    "report[0].labels.label=PID: no such cell is planned": (
        "report:\n",
        "report:\n  - {name: trajectories, labels: [S.F.L.C., PID]}\n",
    ),
    "cells[1].tuning=magic": (
        "tuning: random, overrides: [controller=pid",
        "tuning: magic, overrides: [controller=pid",
    ),
    "cells[0]: must have one of `label` and `controllers`": ("printed, label: S.F.L.C.,", "printed,"),
    "cells[1]: must have one of `label` and `controllers`": (
        "label: random PID,",
        "label: random PID, controllers: {S.F.L.C.: [controller=sflc]},",
    ),
    "budget=5: must be at least 10": ("budget=12", "budget=5"),
    "study/wrong.tunings: again is the search that random is; let its cells name random": (
        "budget=12], seeds: 2}",
        "budget=12], seeds: 2}\n"
        "  - {name: again, seeds: 1,\n"
        "     overrides: [controller=pid, tuner=random, objective=ise, world=corner, budget=12]}",
    ),
    "report[0].name": ("{name: verdicts, title", "{name: horoscope, title"),
    "must be above 0": ("practically_equal: 2 %", "practically_equal: 0"),
    "controller.tunable.kp.high": ("tuner=random,", "tuner=random, controller.tunable.kp.high=-1.0,"),
    "controller.tunable.kq|controller.build.kq": (
        "tuner=random,",
        'tuner=random, "+controller.tunable.kq={low: 0.0, high: 1.0, scale: linear}",',
    ),
}


@pytest.mark.parametrize("message", list(WRONG))
def test_a_wrong_study_is_refused_in_one_line(message: str, tmp_path: Path) -> None:
    there, wrong = WRONG[message]
    text = (Path(__file__).parents[2] / "conf/study/smoke.yaml").read_text()
    assert there in text
    (tmp_path / "study").mkdir()
    (tmp_path / "study/wrong.yaml").write_text(text.replace(there, wrong))
    with pytest.raises(DescriptionError) as refused:
        compose_study("wrong", str(tmp_path))
    assert any(words in str(refused.value) for words in message.split("|"))
    assert "\n" not in str(refused.value)


def test_cells_of_several_controllers_are_those_of_each_alone(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "conf/study/smoke.yaml").read_text()
    each = text[text.index("  - name: fair\n    label: S.F.L.C.") : text.index("claims:")]
    together = (
        "  - name: fair\n    controllers: {S.F.L.C.: [controller=sflc], untuned PID: [controller=pid]}\n"
        "    overrides: [world=corner, start_jitter_m=0.03, start_heading_jitter_rad=0.5, simulator=planar]\n"
        "    episodes: 60\n    trajectories: false\n\n"
    )
    (tmp_path / "study").mkdir()
    (tmp_path / "study/together.yaml").write_text(text.replace(each, together))

    def cells(study: Plan) -> list[CellKey]:
        return [cell.key() for cell in study.cells]

    assert cells(compose_study("together", str(tmp_path))) == cells(compose_study("smoke"))


def test_the_committed_controller_of_pso_is_what_the_tuning_finds(tmp_path: Path, command: Command) -> None:
    words = ("controller=pid", "tuner=pso", "objective=ise", "world=no_deadlock", "simulator=planar", "workers=1")
    done = command("tune", *words, "hydra.run.dir=tuned")
    assert done.code == 0, done.err
    committed = Path(__file__).parents[2] / "conf/controller/pso_pid.yaml"
    assert (tmp_path / "tuned/conf/controller/pso_pid.yaml").read_text() == committed.read_text()
    assert (tmp_path / "tuned/convergence.png").stat().st_size > 1000
    evaluations = Results(tmp_path / "tuned").evaluations()
    assert len(evaluations) == 210


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["budget=5"], "budget=5: must be at least 10"),
        (["controller.tunable.kp.low=20.0"], "controller.tunable.kp.high=10.0: must be greater than low=20.0"),
        (["controller.tunable.kp.low=nan"], "controller.tunable.kp.low=nan: must be a finite number"),
        (["+controller.tunable.kq={low: 0.0, high: 1.0, scale: linear}"], "controller.build.kq: there is no such"),
        (["controller=go_to_goal"], "controller.tunable: missing"),
        (["tuner=magic"], "tuner=magic: unknown choice"),
        (
            ["objective.weights.heading_ise=-1.0"],
            "objective.weights.heading_ise=-1.0: must be greater than or equal to 0",
        ),
        (["+objective.weights.luck=1.0"], "weights: must name at least one of path_length_m"),
        (["tuner.build.n=0"], "n=0"),
        (["worlds=[atlantis]"], "world=atlantis: unknown choice"),
        (["worlds=[no_deadlock]"], "worlds[0]=no_deadlock: stands there twice"),
        (["worlds=[corner,empty,corner]"], "worlds[2]=corner: stands there twice"),
        (["tuner=[pso,ga]"], "tuner=[pso,ga]: must be one name"),
        (["objective=null"], "objective=null: must be one name"),
        (["name=../pid_mine"], "name=../pid_mine: must be a word of letters"),
        (["name=pid"], "name=pid: must be a word of letters, digits, _ and -, and not the controller's own"),
        (["budget=1000001"], "budget=1000001: must be at least 10, the first population of tuner=pso, and at most"),
        (["+controller.repair=3"], "controller.repair._target_: missing; it must name a class"),
        (["sflc"], "sflc: unknown word"),
        (["--fast"], "--fast: unknown flag"),
    ],
)
def test_a_wrong_tuning_is_refused_in_one_line(
    words: list[str], message: str, command: Command, tmp_path: Path
) -> None:
    chosen = [word for word in ("controller=pid", "tuner=pso") if not words[0].startswith(word.partition("=")[0] + "=")]
    done = command("tune", *chosen, *words)
    assert done.code == 2, done.err
    assert message in done.err
    assert done.err.startswith("navbench: ")
    assert len(done.err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_cost_that_is_no_number_is_refused(tmp_path: Path, command: Command) -> None:
    (tmp_path / "blind.py").write_text(
        "class Blind:\n"
        "    trace = {'heading_error_rad': float('nan')}\n"
        "    def __init__(self, gain: float): pass\n"
        "    def reset(self, setup, rng): pass\n"
        "    def act(self, observation): return (0.1, 0.0)\n"
    )
    (tmp_path / "conf/controller").mkdir(parents=True)
    (tmp_path / "conf/controller/blind.yaml").write_text(
        "# Sees nothing\nbuild: {_target_: blind.Blind, gain: 1.0}\n"
        "tunable: {gain: {low: 0.1, high: 1.0, scale: log}}\n"
    )
    words = ["--config-dir", "conf", "controller=blind", "tuner=random", "workers=1", "world.time_limit_s=1.0"]
    done = command("tune", *words)
    assert done.code == 2
    assert "navbench: objective.weights.heading_ise: has no value in an episode" in done.err
    assert "Traceback" not in done.err


def test_there_are_committed_results() -> None:
    assert "aouf2019" in COMMITTED


@pytest.mark.parametrize("name", COMMITTED)
def test_the_committed_results_are_those_of_the_study_as_it_stands(name: str) -> None:
    manifest = json.loads((RESULTS / name / "manifest.json").read_text())
    chosen = compose_study(name)
    assert chosen.study
    assert manifest["study"]["title"] == chosen.study["title"]
    found = json.loads((RESULTS / name / "findings.json").read_text(encoding="utf-8"))
    assert found["summary"] == chosen.study["summary"].strip()
    planned = {(c.name, c.label, c.key().config_hash, c.seed, c.episodes) for c in chosen.cells if not c.tuning}
    kept = [cell for cell in manifest["cells"] if not cell["tuning"]]
    assert {
        tuple(cell[key] for key in ("name", "label", "config_hash", "seed", "episodes")) for cell in kept
    } == planned
    tunings = {(tuning.key().tuning_id, tuning.key().config_hash) for tuning in chosen.tunings}
    assert {(tuning["tuning_id"], tuning["config_hash"]) for tuning in manifest["tunings"]} == tunings
    tuned = [cell for cell in manifest["cells"] if cell["tuning"]]
    assert {(cell["name"], cell["label"], cell["world"]) for cell in tuned} == {
        (cell.name, cell.label, cell.names.world) for cell in chosen.cells if cell.tuning
    }


def test_a_tuning_among_touching_boxes_is_the_same_with_one_worker_and_with_two() -> None:
    words = ["controller=pid", "tuner=abc", "objective=weighted", "world=corner", "worlds=[deadlock]"]
    words += ["episodes=2", "start_heading_jitter_rad=0.3", "budget=20"]
    tuning, _, _ = compose_tuning(words)
    assert run_tuning(tuning, 1).evaluations == run_tuning(tuning, 2).evaluations


def test_a_tuning_in_further_worlds_keeps_its_number_of_workers() -> None:
    assert compose_tuning(["worlds=[deadlock]", "workers=1"])[2]["workers"] == 1


def test_a_file_that_changes_is_read_again(tmp_path: Path) -> None:
    (tmp_path / "world").mkdir()
    limits = []
    for limit in ("60.0", "61.0", "62.00"):
        (tmp_path / "world/mine.yaml").write_text(f"defaults: [corner, _self_]\ntime_limit_s: {limit}\n")
        limits.append(compose_cell("world=mine", config_dir=tmp_path).world.time_limit_s)
    assert limits == [60.0, 61.0, 62.0]
