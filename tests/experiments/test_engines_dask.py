"""Dask does as this machine's cores do."""

import socket
import threading
from pathlib import Path

import pytest
from clusters import check_a_killed_process_costs_nothing, check_deaths_and_errors, check_same_bytes
from commands import Command

pytest.importorskip("distributed")

from navbench.experiments.clusters.dask import Dask  # noqa: E402
from navbench.experiments.workers import MachineError  # noqa: E402

HERE = Dask(address=None)


def test_a_sweep_on_dask_leaves_the_same_bytes(command: Command, tmp_path: Path) -> None:
    check_same_bytes(command, tmp_path, "engine=dask")


def test_a_worker_of_dask_that_is_killed_costs_nothing(tmp_path: Path) -> None:
    check_a_killed_process_costs_nothing(HERE, tmp_path)


def test_deaths_and_errors_are_those_of_the_task_on_dask() -> None:
    check_deaths_and_errors(HERE)


def test_a_scheduler_that_goes_is_a_fault_of_the_machine_and_the_next_run_finds_another() -> None:
    begun = HERE.open(2)
    begun._client.close()
    with pytest.raises(MachineError, match="dask: its scheduler is gone"):
        begun.next()
    begun.stop()
    check_deaths_and_errors(HERE)


def test_a_scheduler_that_does_not_answer_is_told_in_one_line(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("navbench.experiments.clusters.dask.REACHED_S", 1.0)
    words = ("controller=sflc", "engine=dask", "engine.address=tcp://127.0.0.1:1", "hydra.run.dir=here")
    done = command(*words)
    assert (done.code, done.out) == (2, "")
    assert done.err == "navbench: engine.address=tcp://127.0.0.1:1: no dask scheduler answers there\n"
    assert not list(tmp_path.iterdir())


def test_somebody_who_takes_a_connection_and_says_nothing_is_no_scheduler(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("navbench.experiments.clusters.dask.REACHED_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        done = command("controller=sflc", "engine=dask", f"engine.address={address}", "hydra.run.dir=here")
    assert (done.code, done.err) == (2, f"navbench: engine.address={address}: no dask scheduler answers there\n")


def test_somebody_who_answers_in_another_language_is_no_scheduler(command: Command) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        address = f"tcp://127.0.0.1:{listening.getsockname()[1]}"
        answering = threading.Thread(target=lambda: listening.accept()[0].sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n"))
        answering.start()
        done = command("controller=sflc", "engine=dask", f"engine.address={address}", "hydra.run.dir=here")
        answering.join()
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert done.err.startswith(f"navbench: engine.address={address}: no dask scheduler answers there: ")


def test_an_encryption_that_is_not_set_up_is_told_in_one_line(command: Command) -> None:
    done = command("controller=sflc", "engine=dask", "engine.address='tls://127.0.0.1:1'", "hydra.run.dir=here")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "engine.address=tls://127.0.0.1:1: no dask scheduler answers there: " in done.err


def test_a_cluster_that_cannot_be_started_is_told_in_one_line(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(**_: object) -> None:
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr("navbench.experiments.clusters.dask.LocalCluster", fail)
    words = ("controller=sflc", "engine=dask", "workers=7", "simulator=planar", "hydra.run.dir=here")
    done = command(*words)
    assert (done.code, done.out) == (3, "")
    said = "dask cannot be started: RuntimeError: Nanny failed to start."
    assert done.err.startswith(f"navbench: machine_error: {said}")
    assert done.err.count("\n") == 1
    assert not list(tmp_path.iterdir())
