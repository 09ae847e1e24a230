"""SLURM: a job a batch, submitted by submitit, through a folder that all nodes see; without sbatch, on this machine."""

import logging
import os
import shutil
import subprocess
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, ClassVar

from pydantic.dataclasses import dataclass

from navbench.experiments import remote
from navbench.experiments.crew import Task
from navbench.experiments.workers import Death, begun
from navbench.raised import one_line
from navbench.validation import STRICT, Count, DescriptionError, NotInstalledError, Positive

try:
    from submitit import AutoExecutor, Job
    from submitit.core.utils import FailedJobError, FailedSubmissionError, UncompletedJobError
except ModuleNotFoundError as error:
    raise NotInstalledError("engine=slurm", error, "slurm") from None

LOG = logging.getLogger("navbench")
WAIT_S = 0.1  # between two looks for results
LOOK_S = 5.0  # between two looks at the queue
JOBS = 256  # in the queue at a time


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Slurm:
    """The jobs of a cluster that SLURM manages.

    Attributes:
        partition: where jobs run; None for the cluster's default.
        time_min: what a batch may take [min].
        mem_gb: memory of a job [GB].
        folder: where jobs find their work and leave results, seen by all nodes.
    """

    shares_files: ClassVar[bool] = False
    partition: str | None
    time_min: Count
    mem_gb: Positive
    folder: str

    def open(self, workers: int | None) -> "_Jobs":
        """Return what does tasks: so many jobs at a time, by default as many as SLURM lets run."""
        return _Jobs(self, workers)


@cache
def _say_once(jobs: int) -> None:
    LOG.warning("engine=slurm: there is no sbatch here, so that %d jobs run on this machine", jobs)


class _Jobs:
    """The jobs of a run."""

    def __init__(self, options: Slurm, workers: int | None) -> None:
        Path(options.folder).mkdir(parents=True, exist_ok=True)
        self._folder = Path(mkdtemp(prefix="run-", dir=options.folder)).absolute()
        self._queued = shutil.which("sbatch") is not None
        self.limit = JOBS if self._queued else workers or os.cpu_count() or 1
        if not self._queued:
            _say_once(self.limit)
        self._executor = AutoExecutor(folder=self._folder, cluster="slurm" if self._queued else "local")
        self._executor.update_parameters(
            timeout_min=options.time_min,
            mem_gb=options.mem_gb,
            cpus_per_task=1,
            name="navbench",
            slurm_partition=options.partition,
            slurm_array_parallelism=min(workers or JOBS, JOBS),
        )
        self._jobs: dict[int, Job[bytes | Death]] = {}
        self._begun = begun()
        self._looked_s = time.monotonic()
        self._gone: set[int] = set()  # those that the queue did not hold when it was looked at last

    def send(self, tasks: Mapping[int, Task]) -> None:
        """Submit some tasks, as one array."""
        try:
            with self._executor.batch():
                jobs = [
                    self._executor.submit(remote.do, remote.packed(task, "", self._begun)) for task in tasks.values()
                ]
        except (FailedJobError, FailedSubmissionError, subprocess.CalledProcessError) as error:
            raise DescriptionError(f"engine=slurm: {one_line(error)}") from None
        self._jobs |= dict(zip(tasks, jobs, strict=True))

    def next(self) -> tuple[int, Any]:
        """Wait for any job to end."""
        while True:
            for number, job in self._jobs.items():
                if job.paths.result_pickle.exists():
                    return number, remote.unpacked(self._result(self._jobs.pop(number)))
            if time.monotonic() - self._looked_s > LOOK_S:
                gone = {number for number in self._missing() if number in self._jobs}
                for number in gone & self._gone:  # for long enough that its result would have come
                    job = self._jobs.pop(number)
                    return number, Death(f"job {job.job_id} ended without a result", by_machine=True)
                self._gone, self._looked_s = gone, time.monotonic()
            time.sleep(WAIT_S)

    def stop(self) -> None:
        """Cancel the jobs that have not ended, and remove what all have left."""
        for job in self._jobs.values():
            job.cancel(check=False)
        shutil.rmtree(self._folder, ignore_errors=True)
        with suppress(OSError):
            self._folder.parent.rmdir()

    def _result(self, job: "Job[bytes | Death]") -> bytes | Death:
        try:
            return job.result()
        except UncompletedJobError as error:
            return Death(f"job {job.job_id}: {one_line(error)}", by_machine=True)
        except FailedJobError as error:
            raise DescriptionError(f"engine=slurm: a job cannot do its task: {one_line(error)}") from error

    def _missing(self) -> set[int]:
        """Return the tasks whose jobs are not in the queue: submitit asks accounts, which not every cluster keeps."""
        if not self._queued:
            return {number for number, job in self._jobs.items() if job.done()}
        ids = ",".join({job.job_id.partition("_")[0] for job in self._jobs.values()})
        words = ["squeue", "--noheader", "--array", "--format=%i", f"--jobs={ids}"]
        asked = subprocess.run(words, capture_output=True, text=True, check=False)
        if asked.returncode and "Invalid job id" not in asked.stderr:
            return set()  # it does not answer now
        return {number for number, job in self._jobs.items() if job.job_id not in asked.stdout.split()}
