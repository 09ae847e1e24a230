"""Plans: what was finished is kept, under the same code; a sweep is one directory; what is missing is said."""

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import Mock

import pandas as pd
import pytest
from commands import NAVBENCH, Command

from navbench.cli.configuration import compose_cell
from navbench.cli.study_configuration import compose_tuning
from navbench.cli.tables import PANELS_MAX, _drawn
from navbench.experiments import parts
from navbench.experiments.cells import BATCH_MAX, batches_of
from navbench.experiments.code import code_of, roots_of
from navbench.experiments.plan import Plan, batches_of_all
from navbench.experiments.running import run_plan
from navbench.experiments.store import Results
from navbench.report.picture import save_trajectories
from navbench.validation import DescriptionError

KILLS = int(os.environ.get("NAVBENCH_KILLS", "2"))  # more of them for a closer look
MINE = """
from mine_speed import SPEED_MPS

class Mine:
    def reset(self, setup, rng): pass
    def act(self, seen): return SPEED_MPS, 0.0
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's folder with a controller in two modules."""
    (tmp_path / "conf/controller").mkdir(parents=True)
    (tmp_path / "conf/controller/mine.yaml").write_text("# Straight on\nbuild: {_target_: mine.Mine}\n")
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "mine_speed.py").write_text("SPEED_MPS = 0.1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in ("mine", "mine_speed"):  # of another test's folder
        sys.modules.pop(name, None)
    return tmp_path


def plan_of(own: Path, *controllers: str, episodes: int = 12) -> Plan:
    words = ("world=corner", "world.time_limit_s=0.5", f"episodes={episodes}")
    return Plan(
        cells=tuple(compose_cell(f"controller={name}", *words, config_dir=str(own / "conf")) for name in controllers)
    )


# Batches


@pytest.mark.parametrize(("episodes", "sizes"), [(1, [1]), (12, [5, 5, 2]), (20, [5] * 4), (60, [8] * 7 + [4])])
def test_batches_follow_the_work(episodes: int, sizes: list[int]) -> None:
    cell = compose_cell("controller=sflc", "world=corner", f"episodes={episodes}")
    batches = batches_of(cell, cell.indices)
    assert [len(batch.episodes) for batch in batches] == sizes
    assert [index for batch in batches for index in batch.episodes] == list(range(episodes))


def test_no_batch_is_too_much_to_lose() -> None:
    cell = compose_cell("controller=sflc", "world=corner", "episodes=1001")
    assert {len(batch.episodes) for batch in batches_of(cell, cell.indices)} == {BATCH_MAX, 1}


def test_equal_cells_run_each_episode_once() -> None:
    words = ("controller=sflc", "world=corner")
    cells = [compose_cell(*words, word) for word in ("episodes=7", "episode=9", "episode=3", "seed=1")]
    batches = batches_of_all(cells)
    assert [list(batch.episodes) for _, batch in batches] == [[0, 1, 2, 3, 4], [5, 6], [9], [0]]
    assert Plan(cells=tuple(cells)).episodes() == 9


def test_one_episode_alone_is_what_it_is_among_others(tmp_path: Path) -> None:
    words = ("controller=sflc", "world=corner", "start_jitter_m=0.05", "world.time_limit_s=3.0")
    alone = run_plan(Plan(cells=(compose_cell(*words, "episode=3"),)), tmp_path / "alone").results.episodes()
    among = run_plan(Plan(cells=(compose_cell(*words, "episodes=5"),)), tmp_path / "among").results.episodes()
    assert list(alone["episode"]) == [3]
    pd.testing.assert_frame_equal(alone, among[among["episode"] == 3].reset_index(drop=True), rtol=0.0, atol=0.0)


# Code


def test_the_code_of_a_cell_is_all_that_its_episodes_run_through(own: Path) -> None:
    (cell,) = plan_of(own, "mine").cells
    code = code_of(roots_of(cell.configuration))
    assert {"mine", "mine_speed", "navbench.episode.loop", "navbench.simulation.bullet", "navbench.robot"} <= set(code)
    assert not [name for name in code if re.match(r"navbench\.(experiments|analysis|report|cli)|numpy|math$", name)]
    other = code_of(roots_of(compose_cell("controller=sflc").configuration))
    assert "navbench.controllers.aouf2019.sflc" in other
    assert "mine" not in other


def test_a_resume_under_other_code_says_what_changed_and_runs_that_anew(
    own: Path, caplog: pytest.LogCaptureFixture
) -> None:
    plan, path = plan_of(own, "mine", "go_to_goal"), own / "results"
    before = {file.name: file.stat().st_ino for file in run_plan(plan, path, 1).results.path.glob("episodes/*")}
    (own / "mine_speed.py").write_text("SPEED_MPS = 0.10\n")
    results = run_plan(plan, path, 1).results
    assert "3 parts are of other code (mine_speed): they are run anew" in caplog.text
    after = {file.name: file.stat().st_ino for file in path.glob("episodes/*")}
    mine = results.manifest()["cells"][0]["run_id"]
    assert {name for name in before if before[name] != after[name]} == {name for name in before if mine in name}
    caplog.clear()
    run_plan(plan, path, 1)
    assert not caplog.text
    assert {file.name: file.stat().st_ino for file in path.glob("episodes/*")} == after


def test_parts_of_other_code_may_be_kept_and_that_is_recorded(own: Path, caplog: pytest.LogCaptureFixture) -> None:
    plan, path = plan_of(own, "mine"), own / "results"
    run_plan(plan, path, 1)
    before = {file: file.stat().st_ino for file in path.glob("episodes/*")}
    (own / "mine_speed.py").write_text("SPEED_MPS = 0.2\n")
    run_plan(plan, path, 1, other_code=True)
    assert {file: file.stat().st_ino for file in path.glob("episodes/*")} == before
    assert "they are kept" in caplog.text
    (note,) = json.loads((path / "manifest.json").read_text())["resumed"]
    assert (note["changed"], note["parts"], note["kept"]) == (["mine_speed"], 3, True)


def test_the_manifest_holds_the_modules_behind_the_digest_of_every_part_that_is_there_and_of_no_other(
    own: Path,
) -> None:
    def run(speed: float, other_code: bool) -> dict[str, str]:
        """Return which code of ``mine_speed`` made each part, as the manifest tells."""
        (own / "mine_speed.py").write_text(f"SPEED_MPS = {speed}\n")
        results = run_plan(plan_of(own, "mine"), own / "results", 1, other_code=other_code).results
        codes = results.manifest()["codes"]
        made = {part.name: results.code_of("episodes", part.name) for part in (own / "results/episodes").iterdir()}
        assert set(codes) == set(made.values())
        assert results.manifest()["code"] == {n: c for d in made.values() for n, c in codes[d].items()} or other_code
        return {name: codes[code]["mine_speed"] for name, code in made.items()}

    first = run(0.1, other_code=False)
    (own / "results/episodes" / min(first)).unlink()
    mixed = run(0.2, other_code=True)
    assert mixed[min(first)] != first[min(first)]
    assert {name: code for name, code in mixed.items() if name != min(first)} == {
        name: code for name, code in first.items() if name != min(first)
    }
    assert run(0.2, other_code=True) == mixed
    assert set(run(0.2, other_code=False).values()) == {mixed[min(first)]}


def test_a_directory_with_other_work_is_refused_and_stays(own: Path) -> None:
    run_plan(plan_of(own, "mine"), own / "results", 1)
    before = {file: file.read_bytes() for file in (own / "results").rglob("*") if file.is_file()}
    with pytest.raises(DescriptionError, match="holds the results of other work"):
        run_plan(plan_of(own, "go_to_goal"), own / "results", 1)
    assert {file: file.read_bytes() for file in (own / "results").rglob("*") if file.is_file()} == before


# Tunings


@pytest.mark.parametrize(("at", "then"), [(20, [30, 40]), (40, [])])
def test_a_tuning_that_is_interrupted_goes_on_after_its_last_generation(
    at: int, then: list[int], tmp_path: Path
) -> None:
    words = ["controller=pid", "tuner=pso", "objective=ise", "world=corner", "budget=40", "world.time_limit_s=1.0"]
    tuning, _, _ = compose_tuning(words)
    plan = Plan(cells=tuning.cells, tunings=(tuning,), study={"name": "tune it"})
    whole = run_plan(plan, tmp_path / "whole", 1).results

    def interrupt(what: str, done: int, of: int) -> None:
        if done == at:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_plan(plan, tmp_path / "stopped", 1, progress=interrupt)
    told: list[tuple[str, int, int]] = []
    results = run_plan(plan, tmp_path / "stopped", 1, progress=lambda *words: told.append(words)).results
    assert [done for what, done, _ in told if what.endswith("evaluations")] == then
    for table in (Results.evaluations, Results.checks):
        pd.testing.assert_frame_equal(table(results), table(whole), rtol=0.0, atol=0.0)
    assert [file.name.split("-")[0] for file in (tmp_path / "stopped/evaluations").iterdir()] == ["part"]


# What is missing


def test_a_batch_that_cannot_be_run_costs_its_own_episodes_and_is_gone_on_with(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from navbench.episode.loop import EpisodeRunner

    whole = EpisodeRunner.run

    def unlucky(self: EpisodeRunner, episode: int) -> object:
        if episode == 7:
            raise DescriptionError("no room in episode 7")
        return whole(self, episode)

    monkeypatch.setattr(EpisodeRunner, "run", unlucky)
    ran = run_plan(plan_of(own, "mine"), own / "results", workers=0)
    assert (ran.finished, ran.planned, ran.reasons) == (7, 12, ("mine in corner: no room in episode 7",))
    assert list(ran.results.episodes()["episode"]) == [0, 1, 2, 3, 4, 10, 11]
    monkeypatch.setattr(EpisodeRunner, "run", whole)
    again = run_plan(plan_of(own, "mine"), own / "results", workers=0)
    assert (again.finished, again.planned, again.reasons) == (12, 12, ())


def test_a_run_with_missing_episodes_exits_with_3_and_its_table_says_so(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from navbench.episode.loop import EpisodeRunner

    whole = EpisodeRunner.run

    def unlucky(self: EpisodeRunner, episode: int) -> object:
        if episode == 7:
            raise DescriptionError("no room in episode 7")
        return whole(self, episode)

    monkeypatch.setattr(EpisodeRunner, "run", unlucky)
    words = ("controller=go_to_goal", "world=empty", "world.time_limit_s=0.5", "episodes=12", "workers=0")
    done = command(*words, "hydra.run.dir=here")
    assert done.code == 3
    assert done.err == "navbench: 7 of 12 planned episodes are there: go_to_goal in empty: no room in episode 7\n"
    assert list(pd.read_csv(tmp_path / "here/table.csv")["planned"]) == [12]


# Sweeps


def test_a_picture_of_many_cells_shows_some_of_them_and_the_output_says_so(command: Command, tmp_path: Path) -> None:
    seeds = ",".join(map(str, range(PANELS_MAX + 5)))
    words = ("controller=go_to_goal", "world=empty", "world.time_limit_s=0.2", f"seed={seeds}", "workers=0")
    done = command("-m", *words, "hydra.sweep.dir=sweep")
    assert done.code == 0, done.err
    assert "trajectories.png: 30 of 35 cells, taken evenly: 30 of 35 with failures and 0 of 0 without" in done.out
    assert len(_drawn(Results(tmp_path / "sweep")).runs) == PANELS_MAX


def test_a_picture_is_drawn_again_only_where_episodes_have_changed(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save = Mock(wraps=save_trajectories)
    monkeypatch.setattr("navbench.report.picture.save_trajectories", save)
    words = ("controller=go_to_goal", "world=empty", "world.time_limit_s=0.5", "episodes=12", "workers=0")
    picture = tmp_path / "here/trajectories.png"
    first, again = (command(*words, "hydra.run.dir=here") for _ in range(2))
    assert (first.out, save.call_count) == (again.out, 1)
    before = picture.read_bytes()
    next(tmp_path.glob("here/episodes/*")).unlink()
    command(*words, "hydra.run.dir=here")
    assert (picture.read_bytes(), save.call_count) == (before, 2)
    picture.unlink()
    command(*words, "hydra.run.dir=here")
    assert (picture.read_bytes(), save.call_count) == (before, 3)


def test_a_table_of_episodes_is_read_once_and_again_when_a_part_has_changed(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = run_plan(plan_of(own, "mine"), own / "results", 1).results
    reader = Mock(wraps=parts.read)
    monkeypatch.setattr(parts, "read", reader)
    table = results.episodes()
    table["outcome"] = "changed by a reader"
    assert set(results.episodes()["outcome"]) == {"timed_out"}
    assert not reader.called
    next((own / "results/episodes").iterdir()).unlink()
    assert len(results.episodes()) < len(table)
    assert reader.call_count == 2


SWEEP = ("-m", "controller=sflc,pid", "world=corner,no_deadlock", "start_jitter_m=0.02", "episodes=12")


def sweep(folder: Path, *words: str) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    command = [NAVBENCH, *SWEEP, "workers=2", "hydra.sweep.dir=sweep", *words]
    return subprocess.Popen(command, cwd=folder, text=True, stdout=pipe, stderr=pipe, start_new_session=True)


def bytes_of(folder: Path) -> dict[str, bytes]:
    files = [file for kind in ("episodes", "trajectories") for file in sorted((folder / "sweep" / kind).glob("part-*"))]
    files += [folder / "sweep" / name for name in ("episodes.csv", "table.csv", "table.md", "trajectories.png")]
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sweep, run without a stop."""
    folder = tmp_path_factory.mktemp("finished")
    run = sweep(folder)
    _, err = run.communicate()
    assert run.returncode == 0, err
    return folder


@pytest.mark.parametrize("moment", range(KILLS))
def test_a_sweep_that_is_killed_ends_the_same_when_it_is_started_again(
    moment: int, finished: Path, tmp_path: Path
) -> None:
    run = sweep(tmp_path)
    parts = random.Random(moment).randrange(12)
    while len(list(tmp_path.glob("sweep/episodes/part-*"))) < parts and run.poll() is None:
        time.sleep(0.02)
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    again = sweep(tmp_path)
    _, err = again.communicate()
    assert again.returncode == 0, err
    assert bytes_of(tmp_path) == bytes_of(finished)


def test_the_module_is_the_command(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "navbench", "--version"]
    assert subprocess.run(words, capture_output=True, text=True, check=True).stdout.startswith("navbench ")


@pytest.mark.parametrize("verb", ["study", "tune", "report"])
def test_every_verb_tells_its_words(command: Command, verb: str) -> None:
    for flag in ("--help", "-h"):
        done = command(verb, flag)
        assert (done.code, done.err) == (0, "")
        assert f"navbench {verb} " in done.out
