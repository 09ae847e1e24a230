"""Jobs of SLURM do as this machine's cores do; where there is no sbatch, submitit runs them here."""

import shutil
from pathlib import Path

import pytest
from clusters import check_a_killed_process_costs_nothing, check_deaths_and_errors, check_same_bytes
from commands import Command

pytest.importorskip("submitit")

from navbench.experiments.clusters.slurm import Slurm, _say_once  # noqa: E402


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run jobs on this machine, also where there is an sbatch that may lead to a cluster, and look at them often."""
    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.setattr("navbench.experiments.clusters.slurm.LOOK_S", 1.0)
    _say_once.cache_clear()


def slurm(folder: Path) -> Slurm:
    return Slurm(partition=None, time_min=5, mem_gb=1.0, folder=str(folder / "jobs"))


def test_a_sweep_in_jobs_leaves_the_same_bytes(command: Command, tmp_path: Path) -> None:
    check_same_bytes(command, tmp_path, "engine=slurm", "engine.mem_gb=1.0")
    assert not (tmp_path / "outputs/slurm").exists()


def test_a_job_that_is_killed_costs_nothing(tmp_path: Path) -> None:
    check_a_killed_process_costs_nothing(slurm(tmp_path), tmp_path)


def test_deaths_and_errors_are_those_of_the_task_in_jobs(tmp_path: Path) -> None:
    check_deaths_and_errors(slurm(tmp_path))


def test_without_sbatch_it_is_said_once_that_jobs_run_here(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(2):  # as in the generations of a tuning
        slurm(tmp_path).open(2).stop()
    assert caplog.messages == ["engine=slurm: there is no sbatch here, so that 2 jobs run on this machine"]


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("engine.time_min=0", "engine.time_min=0: must be greater than or equal to 1"),
        ("engine.mem_gb=0", "engine.mem_gb=0: must be greater than 0"),
        ("engine.memory=3", "engine.memory: unknown key; allowed here: _target_, partition, time_min, mem_gb, folder"),
    ],
)
def test_a_wrong_option_of_a_job_is_refused(command: Command, word: str, said: str) -> None:
    done = command("controller=sflc", "engine=slurm", word)
    assert done.code == 2
    assert said in done.err
