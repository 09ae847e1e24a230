"""Dask: a cluster whose scheduler listens at an address, or one of this machine's processes."""

import asyncio
import os
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from typing import Any, ClassVar
from uuid import uuid4

from pydantic.dataclasses import dataclass

from navbench.experiments import remote
from navbench.experiments.crew import Task
from navbench.experiments.workers import Death, MachineError, begun, uninterrupted
from navbench.raised import one_line
from navbench.validation import STRICT, DescriptionError, NotInstalledError

try:
    from distributed import Client, Future, KilledWorker, LocalCluster, as_completed
    from distributed.client import FutureCancelledError
    from distributed.comm.core import connect
except ModuleNotFoundError as error:
    raise NotInstalledError("engine=dask", error, "dask") from None

REACHED_S = 10.0  # within which a scheduler answers, and a worker is there
WAIT_S = 0.01  # between two looks for results
CLOSED = "closed"  # what a client is that cannot reach its scheduler again


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Dask:
    """A cluster of dask's.

    Attributes:
        address: where its scheduler listens, such as tcp://host:8786; None starts worker processes on this machine.
    """

    shares_files: ClassVar[bool] = False
    address: str | None

    def open(self, workers: int | None) -> "_Dask":
        """Return what does tasks: with an address on all workers of that cluster, else with so many.

        Raises:
            DescriptionError: no scheduler answers, or it has no worker.
        """
        workers = None if self.address else workers
        client = _client(self.address, workers)
        if client.status == CLOSED:  # of an earlier run, whose scheduler went
            _client.cache_clear()
            client = _client(self.address, workers)
        return _Dask(client)


class _Dask:
    """A run on a cluster."""

    limit = 256

    def __init__(self, client: Client) -> None:
        self._client = client
        self._run, self._begun = uuid4().hex, begun()
        self._numbers: dict[Future[Any], int] = {}
        self._done = as_completed()

    def send(self, tasks: Mapping[int, Task]) -> None:
        """Begin with some tasks."""
        self._check_there()
        for number, task in tasks.items():
            future = self._client.submit(remote.do, remote.packed(task, self._run, self._begun), pure=False)
            self._numbers[future] = number
            self._done.add(future)

    def next(self) -> tuple[int, Any]:
        """Wait for any task to end."""
        while not self._done.has_ready():
            self._check_there()  # of which the futures need not tell
            time.sleep(WAIT_S)
        future = next(self._done)
        number = self._numbers.pop(future)
        try:
            answer = future.result()
        except (KilledWorker, FutureCancelledError) as error:
            answer = Death(f"dask: {one_line(error)}", by_machine=True)
        except Exception as error:  # no task's own, of which the answer tells
            raise DescriptionError(f"engine=dask: a worker cannot do its task: {one_line(error)}") from error
        return number, remote.unpacked(answer)

    def stop(self) -> None:
        """End what is under way, and the worker processes of this run."""
        with suppress(OSError, ValueError, TimeoutError):  # it is gone, and all that it did with it
            if self._client.status == CLOSED:
                return
            self._client.cancel(list(self._numbers), force=True)
            self._client.run(remote.stop, self._run, on_error="ignore")

    def _check_there(self) -> None:
        if self._client.status == CLOSED:
            raise MachineError(Death("dask: its scheduler is gone", by_machine=True))


@cache
def _client(address: str | None, workers: int | None) -> Client:
    """Return a connection, which lasts as long as this process."""
    if address is None:
        workers = workers or os.cpu_count() or 1
        options = {"threads_per_worker": 1, "dashboard_address": None, "memory_limit": 0, "silence_logs": "CRITICAL"}
        try:
            with uninterrupted():
                return Client(LocalCluster(n_workers=workers, **options))
        except (OSError, RuntimeError) as error:  # one of its processes was killed meanwhile
            raise MachineError(Death(f"dask cannot be started: {one_line(error)}", by_machine=True)) from None
    said = "no dask scheduler answers there"
    try:
        with ThreadPoolExecutor(1) as thread:  # this one may have a loop of its own, as in a notebook
            thread.submit(asyncio.run, _greet(address)).result()
        client = Client(address, timeout=REACHED_S)
        said = "the dask scheduler there has no worker"
        client.wait_for_workers(1, timeout=REACHED_S)
    except (OSError, ValueError):  # nobody listens, or that is no address
        raise DescriptionError(f"engine.address={address}: {said}") from None
    except Exception as error:  # of what somebody else answers, or of an encryption that is not set up
        raise DescriptionError(f"engine.address={address}: {said}: {one_line(error)}") from None
    return client


async def _greet(address: str) -> None:
    """Connect to a scheduler, and take leave: a client would wait for good for one that says nothing."""

    async def greet() -> None:
        comm = await connect(address, timeout=REACHED_S)
        await comm.close()

    await asyncio.wait_for(greet(), REACHED_S)
