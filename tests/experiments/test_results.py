"""Results: what stands in them, that the same seed gives the same bytes, and that nothing in them is half written."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from commands import NAVBENCH, workers_of
from stored import a_cell, a_record

from navbench.cli.configuration import compose_cell
from navbench.experiments.cells import Cell, batches_of, run_batch
from navbench.experiments.plan import Plan
from navbench.experiments.running import run_plan
from navbench.experiments.store import Results, ResultsError
from navbench.records import RobotRecord
from navbench.report.tables import failures, summarize, to_markdown, to_text

EPISODES = 60  # eight parts, the last one shorter
WORDS = (
    "controller=sflc",
    "world=corner",
    "world.time_limit_s=20",
    "start_jitter_m=0.05",
    "start_heading_jitter_rad=0.3",
    "sensors.noise_std_m=0.005",
    "sensors.dropout_probability=0.01",
    "sensors.odometry.travel_noise=0.02",
    "sensors.odometry.wheel_scale_std=0.01",
    f"episodes={EPISODES}",
)
EPISODE_COLUMNS = [
    "run_id", "controller", "world", "robot", "sensors", "simulator", "config_hash", "seed", "episode", "robot_index",
    "outcome", "reason", "traceback", "hit", "hit_index", "path_length_m", "time_s", "collisions", "min_clearance_m",
    "mean_speed_mps", "heading_ise", "total_turning_rad", "w_sign_changes", "robot_collisions", "standing_collisions",
    "goal_distance_m", "layout_id",
]  # fmt: skip
STATE_COLUMNS = ["run_id", "episode", "robot_index", "t_s", "x_m", "y_m", "heading_rad", "v_mps", "w_radps"]


@pytest.fixture(scope="module")
def cell() -> Cell:
    """A cell in which everything that is left to chance is left to chance."""
    return compose_cell(*WORDS)


@pytest.fixture(scope="module")
def once(cell: Cell, tmp_path_factory: pytest.TempPathFactory) -> Results:
    """The cell, run once in this process."""
    return run_cell(cell, tmp_path_factory.mktemp("once"), 1)


def parts_of(path: Path) -> dict[str, bytes]:
    """Return the bytes that must repeat: those of episodes/ and trajectories/."""
    files = sorted([*path.glob("episodes/*"), *path.glob("trajectories/*")])
    return {str(file.relative_to(path)): file.read_bytes() for file in files}


def run_cell(cell: Cell, path: Path, workers: int) -> Results:
    return run_plan(Plan(cells=(cell,)), path, workers).results


def run_in_a_process(path: Path, *words: str) -> None:
    subprocess.run([NAVBENCH, *WORDS, *words, f"hydra.run.dir={path}"], check=True, capture_output=True)


# The same seed gives the same bytes


def test_a_run_is_eight_parts_of_each_kind(once: Results) -> None:
    run_id = once.manifest()["cells"][0]["run_id"]
    names = [f"part-{run_id}-{first:06d}-{min(first + 7, 59):06d}.parquet" for first in range(0, 60, 8)]
    for kind in ("episodes", "trajectories", "latency"):
        assert sorted(path.name for path in (once.path / kind).iterdir()) == names


def test_the_same_seed_gives_the_same_bytes_twice(once: Results, cell: Cell, tmp_path: Path) -> None:
    assert parts_of(run_cell(cell, tmp_path, 1).path) == parts_of(once.path)


@pytest.mark.parametrize("workers", [1, 2])
def test_the_same_seed_gives_the_same_bytes_in_another_process(once: Results, tmp_path: Path, workers: int) -> None:
    run_in_a_process(tmp_path, f"workers={workers}")
    assert parts_of(tmp_path) == parts_of(once.path)


def test_the_same_seed_gives_the_same_bytes_with_two_workers(once: Results, cell: Cell, tmp_path: Path) -> None:
    assert parts_of(run_cell(cell, tmp_path, 2).path) == parts_of(once.path)


def test_the_same_seed_gives_the_same_bytes_in_another_order(once: Results, cell: Cell, tmp_path: Path) -> None:
    results = Results(tmp_path)
    code = once.code_of("episodes", next(once.path.glob("episodes/*")).name)
    results.begin([cell.key()])
    with cell.runner() as runner:
        for batch in reversed(batches_of(cell, cell.indices)):
            backwards = [(episode, record) for episode in reversed(batch.episodes) for record in runner.run(episode)]
            results.write_batch(cell.key(), batch.episodes, backwards, code=code)
    assert parts_of(tmp_path) == parts_of(once.path)


def test_running_again_into_the_same_directory_runs_nothing_again(once: Results, cell: Cell, tmp_path: Path) -> None:
    run_cell(cell, tmp_path, 1)
    first = {name: (tmp_path / name).stat().st_ino for name in parts_of(tmp_path)}
    run_cell(cell, tmp_path, 1)
    assert parts_of(tmp_path) == parts_of(once.path)
    assert all((tmp_path / name).stat().st_ino == inode for name, inode in first.items())


def test_the_csv_repeats_too(once: Results, cell: Cell, tmp_path: Path) -> None:
    again = run_cell(cell, tmp_path, 2)
    assert (again.path / "episodes.csv").read_bytes() == (once.path / "episodes.csv").read_bytes()


def test_another_seed_gives_other_episodes(once: Results, tmp_path: Path) -> None:
    other = run_cell(compose_cell(*WORDS, "seed=1"), tmp_path, 1)
    for name in ("path_length_m", "min_clearance_m", "heading_ise"):
        assert not np.intersect1d(once.episodes()[name], other.episodes()[name]).size, name
    assert not set(parts_of(tmp_path).values()) & set(parts_of(once.path).values())


@pytest.mark.parametrize("word", [word for word in WORDS if "noise" in word or "jitter" in word or "std" in word])
def test_each_kind_of_chance_changes_something(once: Results, tmp_path: Path, word: str) -> None:
    without = run_cell(compose_cell(*WORDS, f"{word.split('=')[0]}=0.0", "episodes=5"), tmp_path, 1)
    assert not np.isin(without.episodes()["heading_ise"], once.episodes()["heading_ise"]).any()


def test_all_controllers_meet_the_same_starts(once: Results, tmp_path: Path) -> None:
    other = run_cell(compose_cell(*WORDS, "controller=pid"), tmp_path, 1)

    def starts(results: Results) -> bytes:
        first = results.trajectories().groupby("episode").head(1)
        return first[["x_m", "y_m", "heading_rad"]].to_numpy().tobytes()

    assert starts(other) == starts(once)


# What stands in them


def test_the_tables_have_exactly_their_columns(once: Results) -> None:
    for part in (once.path / "episodes").iterdir():
        schema = pq.read_schema(part)
        assert schema.names == EPISODE_COLUMNS
        kinds = {name: str(schema.field(name).type) for name in schema.names}
        assert {kinds[name] for name in EPISODE_COLUMNS[:7] + ["outcome", "reason"]} == {"string"}
        assert {kinds[name] for name in ("seed", "episode", "robot_index", "collisions", "w_sign_changes")} == {"int64"}
        assert {kinds[name] for name in ("path_length_m", "time_s", "min_clearance_m", "heading_ise")} == {"double"}
    for part in (once.path / "trajectories").iterdir():
        schema = pq.read_schema(part)
        assert schema.names[:9] == STATE_COLUMNS
        assert "heading_error_rad" in schema.names[9:]
        assert {str(kind) for kind in schema.types[3:]} == {"double"}
    assert list(once.latency()) == [
        "run_id", "episode", "robot_index", "acts", "act_median_s", "act_p99_s", "act_max_s",
    ]  # fmt: skip


def test_every_episode_is_a_row_and_its_trajectory_ends_with_it(once: Results) -> None:
    episodes, trajectories = once.episodes(), once.trajectories()
    assert list(episodes["episode"]) == list(range(EPISODES))
    assert set(episodes["outcome"]) == {"reached", "timed_out"}
    last = trajectories.groupby("episode").last()
    assert np.array_equal(last["t_s"], episodes["time_s"])
    assert (trajectories.groupby("episode")["t_s"].first() == 0.0).all()


def test_of_trajectories_the_columns_that_are_asked_for_are_read_beside_those_of_their_order(once: Results) -> None:
    whole = once.trajectories()
    read = once.trajectories(columns=("y_m", "x_m"))
    assert list(read) == ["run_id", "episode", "robot_index", "t_s", "y_m", "x_m"]
    pd.testing.assert_frame_equal(read, whole[list(read)])
    assert list(once.trajectories()) == list(whole)
    run_id = whole["run_id"][0]
    pd.testing.assert_frame_equal(once.trajectories(run_id, ("v_mps",)), whole[[*read][:4] + ["v_mps"]])


def test_the_csv_holds_the_same_rows(once: Results) -> None:
    read = pd.read_csv(once.path / "episodes.csv", keep_default_na=False)
    pd.testing.assert_frame_equal(read, once.episodes(), check_dtype=False, rtol=0.0, atol=0.0)


def test_the_manifest_says_what_ran_with_what_and_where_the_numbers_come_from(once: Results, cell: Cell) -> None:
    manifest = json.loads((once.path / "manifest.json").read_text())
    assert manifest["began"] <= manifest["ended"]
    assert set(manifest["versions"]) >= {
        "navbench",
        "numpy",
        "numba",
        packages_distributions()["pybullet"][0],
        "pyarrow",
    }
    (entry,) = manifest["cells"]
    assert entry["seed"] == 0
    assert entry["episodes"] == EPISODES
    assert entry["config_hash"] == cell.key().config_hash
    assert [entry[name] for name in ("controller", "world", "robot", "sensors", "simulator")] == [
        "sflc", "corner", "khepera3", "khepera3_ir", "pybullet",
    ]  # fmt: skip
    configuration = entry["configuration"]
    assert configuration["start_jitter_m"] == 0.05
    assert configuration["sensors"]["noise_std_m"] == 0.005
    assert configuration["world"]["time_limit_s"] == 20.0
    assert configuration["controller"]["build"]["_target_"] == "navbench.controllers.aouf2019.sflc.Sflc"
    assert entry["sources"]["robot"]["radius_m"]


def test_the_hash_is_of_all_that_decides_an_episode_but_seed_and_number(cell: Cell) -> None:
    def key_of(*words: str) -> tuple[str, str]:
        key = compose_cell(*WORDS, *words).key()
        return key.config_hash, key.run_id

    config_hash, run_id = cell.key().config_hash, cell.key().run_id
    assert key_of("episodes=1") == (config_hash, run_id)
    assert key_of("workers=2") == (config_hash, run_id)
    assert key_of("seed=1")[0] == config_hash
    assert key_of("seed=1")[1] != run_id
    for word in ("start_jitter_m=0.06", "robot.track_m=0.08", "world.goal_tolerance_m=0.06", "simulator.drive=limited"):
        assert key_of(word)[0] != config_hash


# Tables


@pytest.fixture
def mixed(tmp_path: Path) -> pd.DataFrame:
    """Four episodes of one cell, of which two reached, and one of another cell that failed."""
    results, first, second = Results(tmp_path), a_cell("A"), a_cell("B", world="hard")
    results.begin([first, second])
    records = [
        a_record(time_s=10.0, length_m=3.0),
        a_record(time_s=14.0, length_m=5.0),
        a_record("collided", time_s=1.0, length_m=0.1, reason="hit box 0"),
        a_record("timed_out", time_s=60.0, length_m=20.0),
    ]
    results.write_batch(first, range(4), list(enumerate(records)))
    results.write_batch(second, range(1), [(0, a_record("controller_error", time_s=0.5, reason="ValueError: x"))])
    return results.episodes()


def test_a_table_averages_those_that_reached_and_no_others(mixed: pd.DataFrame) -> None:
    plain, hard = summarize(mixed).to_dict("records")
    assert (plain["reached"], plain["of"]) == (2, 4)
    assert plain["time_s"] == 12.0
    assert plain["path_length_m"] == 4.0
    assert [plain[name] for name in ("collided", "timed_out", "controller_error", "collisions")] == [1, 1, 0, 1]
    assert (hard["reached"], hard["of"]) == (0, 1)
    assert np.isnan(hard["time_s"])
    assert hard["controller_error"] == 1


def test_a_table_prints_a_dash_where_none_reached(mixed: pd.DataFrame) -> None:
    for text in (to_text(summarize(mixed)), to_markdown(summarize(mixed))):
        hard = next(line for line in text.splitlines() if "hard" in line)
        assert "0 of 1" in hard
        assert "nan" not in text
        assert hard.split().count("–") >= 4


def test_a_markdown_table_has_every_column_and_a_row_a_cell(mixed: pd.DataFrame) -> None:
    summary = summarize(mixed)
    lines = to_markdown(summary).splitlines()
    cells = [[part.strip() for part in line.strip("|").split("|")] for line in lines]
    assert cells[0] == [name for name in summary.columns if name not in ("of", "episodes", "run_id")]
    assert len(lines) == 2 + len(summary)
    assert {len(row) for row in cells} == {len(cells[0])}


def test_failures_are_named_with_their_reasons_and_counted(mixed: pd.DataFrame) -> None:
    assert failures(mixed, at_most=2) == [
        "pid in plain, seed 0, episode 2, robot 0: collided after 1.00 s (hit box 0)",
        "pid in plain, seed 0, episode 3, robot 0: timed_out after 60.00 s",
        "... and 1 more",
    ]


def test_a_failure_names_the_robots_of_a_fleet_as_pictures_do(mixed: pd.DataFrame) -> None:
    hit = mixed.assign(robot_index=1, outcome="collided", hit="robot", hit_index=2, reason="hit robot 2")
    assert failures(hit, at_most=1)[0].endswith(" robot 1 (R2): collided after 10.00 s (hit R3)")


# Nothing is half written


def test_a_crash_while_writing_leaves_no_half_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results, cell = Results(tmp_path), a_cell()
    results.begin([cell])
    results.write_batch(cell, range(1), [(0, a_record())])
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    for episodes in (range(1), range(1, 2)):
        with pytest.raises(OSError, match="No space left"):
            results.write_batch(cell, episodes, [(episodes[0], a_record(time_s=7.0))])
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("finish", [Results.end, Results.abandon])
def test_what_a_killed_process_was_writing_is_gone_at_the_end(
    tmp_path: Path, finish: Callable[[Results], None]
) -> None:
    results, cell = Results(tmp_path), a_cell()
    results.begin([cell])
    results.write_batch(cell, range(1), [(0, a_record())])
    for kind in ("episodes", "trajectories", "latency"):
        (tmp_path / kind / ".part-a.parquet.7.tmp").write_bytes(b"PAR1 and then")
    finish(results)
    assert not list(tmp_path.rglob("*.tmp"))
    assert len(results.episodes()) == 1


def test_a_batch_whose_episodes_are_missing_is_not_read(tmp_path: Path) -> None:
    results, cell = Results(tmp_path), a_cell()
    results.begin([cell])
    for episode in range(2):
        results.write_batch(cell, range(episode, episode + 1), [(episode, a_record())])
    next(path for path in (tmp_path / "episodes").iterdir() if path.stem.endswith("000001")).unlink()
    assert set(results.episodes()["episode"]) == {0}
    assert set(results.trajectories()["episode"]) == {0}
    assert set(results.latency()["episode"]) == {0}


def test_a_run_that_breaks_before_its_first_batch_leaves_nothing(
    cell: Cell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> Iterator[tuple[int, list[tuple[int, RobotRecord]]]]:
        raise MemoryError
        yield 0, []

    monkeypatch.setattr("navbench.experiments.running.run", broken)
    with pytest.raises(MemoryError):
        run_cell(cell, tmp_path / "new" / "results", 1)
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_breaks_later_keeps_what_was_finished(
    cell: Cell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: object, batches: list[object], *__: object) -> Iterator[tuple[int, list[tuple[int, RobotRecord]]]]:
        yield 1, run_batch(batches_of(cell, cell.indices)[1])
        raise MemoryError

    monkeypatch.setattr("navbench.experiments.running.run", broken)
    with pytest.raises(MemoryError):
        run_cell(cell, tmp_path, 1)
    results = Results(tmp_path)
    assert list(results.episodes()["episode"]) == list(range(8, 16))
    assert results.manifest()["ended"] is None


@pytest.mark.parametrize("victim", ["a worker", "the run"])
def test_what_a_kill_leaves_is_whole(tmp_path: Path, once: Results, victim: str) -> None:
    command = [NAVBENCH, *WORDS, "episodes=300", "workers=2", f"hydra.run.dir={tmp_path}"]
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    while run.poll() is None and not list(tmp_path.glob("episodes/part-*")):
        time.sleep(0.02)
    workers = workers_of(run.pid)
    assert workers
    os.kill(workers[0] if victim == "a worker" else run.pid, signal.SIGKILL)
    _, err = run.communicate(timeout=300.0)  # which waits for the workers too, for they hold the pipe
    if victim == "a worker":
        assert run.returncode == 0, err
        assert list(Results(tmp_path).episodes()["episode"]) == list(range(300))
    for kind in ("episodes", "trajectories", "latency"):
        for part in (tmp_path / kind).glob("part-*"):
            pq.read_table(part)
    for kept, whole in zip(_tables(Results(tmp_path)), _tables(once), strict=True):
        both = set(kept["episode"]) & set(whole["episode"])
        assert both
        left, right = (table[table["episode"].isin(both)].reset_index(drop=True) for table in (kept, whole))
        pd.testing.assert_frame_equal(left, right, rtol=0.0, atol=0.0)


def _tables(results: Results) -> tuple[pd.DataFrame, pd.DataFrame]:
    return results.episodes(), results.trajectories()


def test_a_trace_never_hides_a_column_of_the_trajectory(tmp_path: Path) -> None:
    results, cell = Results(tmp_path), a_cell()
    results.begin([cell])
    results.write_batch(cell, range(1), [(0, a_record(trace_names=("v_mps", "run_id", "a", "b", "c")))])
    table = results.trajectories()
    assert list(table) == [*STATE_COLUMNS, "trace_v_mps", "trace_run_id", "a", "b", "c"]
    assert set(table["v_mps"]) == {0.3}
    assert set(table["trace_v_mps"]) == {0.0}


def test_parts_with_different_traces_are_read_together(tmp_path: Path) -> None:
    results, cell = Results(tmp_path), a_cell()
    results.begin([cell])
    results.write_batch(cell, range(1), [(0, a_record())])
    silent = a_record(trace_names=(), traces=np.empty((5, 0)))
    results.write_batch(cell, range(1, 2), [(1, silent)])
    table = results.trajectories()
    assert table.loc[table["episode"] == 1, "behavior"].isna().all()
    assert table.loc[table["episode"] == 0, "behavior"].notna().all()


@pytest.mark.parametrize("text", ["", "{", "[]", "3", '{"cells": []}'])
def test_a_manifest_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(ResultsError, match="is no manifest of navbench"):
        Results(tmp_path).manifest()


def test_a_directory_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match="manifest.json is missing"):
        Results(tmp_path).manifest()
    with pytest.raises(ResultsError, match="episodes/ holds no part"):
        Results(tmp_path).episodes()
