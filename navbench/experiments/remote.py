"""What a process of a cluster does: it has a worker process of its machine do the task, as the driver does on its own.

Only bytes travel: what they mean, and what it imports, is known to the driver and to the worker process. The working
directory and the places to import from are the driver's, as far as they are there. Where another navbench, another
Python, other packages or another source of the user's lie, nothing is run.
"""

import os
import platform
import sys
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from multiprocessing import current_process
from multiprocessing.util import Finalize
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, NamedTuple

from navbench import simulation
from navbench.experiments.code import changed, digest_of
from navbench.experiments.crew import Crew, Task
from navbench.experiments.workers import Begun, Death, answer_to, refused
from navbench.simulation.base import Simulator

PACKAGES = ("numba", "numpy", "scipy")  # on whose versions, and the simulators', the last digits may depend


class Packed(NamedTuple):
    """A task as it travels.

    Attributes:
        message: its function and argument, pickled.
        alone: whether in a process of its own.
        foreign: what it runs that is not navbench's own.
        run: of which run it is.
        folder: where the driver works.
        path: where the driver imports from.
        code: of what source the driver has the user's modules.
        versions: of the driver.
    """

    message: bytes
    alone: bool
    foreign: frozenset[str]
    run: str
    folder: str
    path: tuple[str, ...]
    code: Mapping[str, str]
    versions: Mapping[str, str]


def versions() -> dict[str, str]:
    """Return what decides rows beside a user's code: the versions of Python and packages, and a digest of navbench."""
    found = {"python": platform.python_version()}
    for module in iter_modules(simulation.__path__, "navbench.simulation."):
        import_module(module.name)
    for package in dict.fromkeys((*PACKAGES, *(name for kind in Simulator.__subclasses__() for name in kind.packages))):
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    roots = [Path(__file__).parents[1], *map(Path, import_module("navbench.controllers").__path__)]
    files = (file for root in roots for file in root.rglob("*.py") if file.parent.name != "conf")
    sources = {digest_of(file.read_bytes()) for file in files}  # wherever they lie
    return {**found, "navbench's code": digest_of(" ".join(sorted(sources)).encode())}


VERSIONS = versions()  # when this process imported navbench, which is what it runs


def packed(task: Task, run: str, begun: Begun) -> Packed:
    """Return a task as it travels.

    Args:
        task: the task.
        run: what to call the run that it is of.
        begun: what the run was begun with.
    """
    import cloudpickle

    (folder, *path), code = begun
    message = cloudpickle.dumps((task.do, task.argument))
    return Packed(message, task.alone, task.foreign, run, folder, tuple(path), code, VERSIONS)


def do(task: Packed) -> bytes | Death:
    """Return what a task comes to, pickled, or the ``Death`` that its worker process died of it."""
    if current_process().daemon:
        current_process().daemon = False  # which might not have processes of its own
    for name, there in task.versions.items():
        if (here := VERSIONS.get(name, there)) != there:
            return Death(f"the worker on {platform.node()} has {name} {here}, and the driver {there}", by_machine=True)
    answer: bytes | Death = _crew(task.run).do(Task(_in_drivers_place, task, task.alone, task.foreign))
    return answer


def stop(run: str) -> None:
    """End the worker processes of a run, and do no more of it in this process."""
    _crew(run).end()


def unpacked(answer: bytes | Death) -> Any:
    """Return what a task came to, or the ``Death`` of its process.

    Raises:
        Exception: whatever the task raised.
    """
    import cloudpickle

    if isinstance(answer, Death):
        return answer
    result, raised = cloudpickle.loads(answer)
    if raised is not None:
        raise raised
    return result


@cache
def _crew(run: str) -> Crew:
    crew = Crew([])
    Finalize(None, crew.end, exitpriority=1)  # for which this process would wait when it ends
    return crew


def _in_drivers_place(task: Packed) -> bytes:
    """Do a task, in a worker process."""
    with suppress(OSError):
        os.chdir(task.folder)
    sys.path += [folder for folder in task.path if folder not in sys.path and Path(folder).is_dir()]
    if other := changed(task.code):
        return refused(f"the worker on {platform.node()} has another {other} than the driver")
    return answer_to(task.message)
