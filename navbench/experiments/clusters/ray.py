"""Ray: a cluster that runs already, or one of this machine's processes."""

import os
import socket
from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar
from urllib.parse import urlsplit

from pydantic.dataclasses import dataclass

from navbench.experiments import remote
from navbench.experiments.cells import digest
from navbench.experiments.crew import Task
from navbench.experiments.workers import Death, MachineError, begun
from navbench.raised import one_line
from navbench.validation import STRICT, DescriptionError, NotInstalledError

try:
    import ray
    from ray.exceptions import RayError, RayTaskError
except ModuleNotFoundError as error:
    raise NotInstalledError("engine=ray", error, "ray") from None

REACHED_S = 10.0  # within which a head takes a connection


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Ray:
    """A cluster of ray's.

    Attributes:
        address: that of its head, such as host:6379, or "auto" for the one of this machine; None starts worker
            processes on this machine.
    """

    shares_files: ClassVar[bool] = False
    address: str | None

    def open(self, workers: int | None) -> "_Ray":
        """Return what does tasks: with an address on all cores of that cluster, else with so many workers.

        Raises:
            DescriptionError: no cluster answers.
        """
        _connect(self.address, None if self.address else workers)
        return _Ray()


class _Ray:
    """A run on a cluster."""

    limit = 256

    def __init__(self) -> None:
        self._do = ray.remote(num_cpus=1, max_retries=0)(remote.do)
        self._numbers: dict[Any, int] = {}
        self._begun = begun()
        self._run = digest(self._begun)  # whose worker processes the next one may have

    def send(self, tasks: Mapping[int, Task]) -> None:
        """Begin with some tasks."""
        for number, task in tasks.items():
            self._numbers[self._do.remote(remote.packed(task, self._run, self._begun))] = number

    def next(self) -> tuple[int, Any]:
        """Wait for any task to end."""
        (done,), _ = ray.wait(list(self._numbers), num_returns=1)
        number = self._numbers.pop(done)
        try:
            answer = ray.get(done)
        except RayTaskError as error:
            raise DescriptionError(f"engine=ray: a worker cannot do its task: {one_line(error.cause)}") from error
        except RayError as error:
            answer = Death(f"ray: {one_line(error)}", by_machine=True)
        return number, remote.unpacked(answer)

    def stop(self) -> None:
        """End the processes of what is under way, with which their worker processes end."""
        for done in self._numbers:
            ray.cancel(done, force=True)


@cache
def _connect(address: str | None, workers: int | None) -> None:
    """Connect this process to a cluster, for as long as it lasts."""
    options: dict[str, Any] = {"logging_level": "ERROR", "log_to_driver": False}
    if address is not None:
        _check_heard(address)
    else:
        options |= {"num_cpus": workers or os.cpu_count() or 1, "include_dashboard": False}
    try:
        ray.init(address=address or "local", **options)
    except Exception as error:  # of ray's many kinds, such as a bare one where a process has no core in time
        if address is None:
            raise MachineError(Death(f"ray cannot be started: {one_line(error)}", by_machine=True)) from None
        raise DescriptionError(f"engine.address={address}: {one_line(error)}") from None


def _check_heard(address: str) -> None:
    """Check that somebody listens at an address, and greets as gRPC does: else ray tries for a quarter of an hour.

    Raises:
        DescriptionError: nobody does, or that is no address.
    """
    try:
        where = os.environ.get("RAY_ADDRESS", "") if address == "auto" else address  # as ray itself does
        place = urlsplit(where if "://" in where else f"//{where}")
        if place.hostname and place.port:  # else ray says what is wrong
            with socket.create_connection((place.hostname, place.port), REACHED_S) as heard:
                if "RAY_USE_TLS" not in os.environ and not heard.recv(1):  # else it waits for us to begin
                    raise ConnectionError
    except (OSError, ValueError):
        raise DescriptionError(f"engine.address={address}: no ray cluster answers there") from None
