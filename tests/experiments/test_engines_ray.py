"""Ray does as this machine's cores do."""

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
