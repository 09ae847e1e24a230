"""Ray does as this machine's cores do."""

import socket
from pathlib import Path

import pytest
from clusters import check_a_killed_process_costs_nothing, check_deaths_and_errors, check_same_bytes
from commands import Command

pytest.importorskip("ray")

from navbench.experiments.clusters.ray import Ray  # noqa: E402

HERE = Ray(address=None)


def test_a_sweep_on_ray_leaves_the_same_bytes(command: Command, tmp_path: Path) -> None:
    check_same_bytes(command, tmp_path, "engine=ray")


def test_a_worker_of_ray_that_is_killed_costs_nothing(tmp_path: Path) -> None:
    check_a_killed_process_costs_nothing(HERE, tmp_path)


def test_deaths_and_errors_are_those_of_the_task_on_ray() -> None:
    check_deaths_and_errors(HERE)


def test_a_cluster_that_cannot_be_started_is_told_in_one_line(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(**_: object) -> None:
        raise Exception("The current node timed out during startup.")

    monkeypatch.setattr("ray.init", fail)
    words = ("controller=sflc", "engine=ray", "workers=7", "simulator=planar", "hydra.run.dir=here")
    done = command(*words)
    assert (done.code, done.out) == (3, "")
    said = "ray cannot be started: Exception: The current node timed out during startup."
    assert done.err.startswith(f"navbench: machine_error: {said}")
    assert done.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_an_address_at_which_nobody_listens_is_told_in_one_line(command: Command, tmp_path: Path) -> None:
    words = ("controller=sflc", "engine=ray", "engine.address=127.0.0.1:1", "hydra.run.dir=here")
    done = command(*words)
    assert (done.code, done.out) == (2, "")
    assert done.err == "navbench: engine.address=127.0.0.1:1: no ray cluster answers there\n"
    assert not list(tmp_path.iterdir())


def test_somebody_who_takes_a_connection_and_says_nothing_is_no_cluster(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("navbench.experiments.clusters.ray.REACHED_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"127.0.0.1:{silent.getsockname()[1]}"
        done = command("controller=sflc", "engine=ray", f"engine.address={address}", "hydra.run.dir=here")
    assert (done.code, done.err) == (2, f"navbench: engine.address={address}: no ray cluster answers there\n")
