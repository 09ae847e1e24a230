"""What works on this machine and what does not: Python, packages, simulators, window, videos, engines, folders.

Its imports at the top are Python's own, so that it can say which package is missing.
"""

import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, NamedTuple

import navbench
from navbench.cli.display import why_none
from navbench.cli.progress import UNFINISHED, complain

HELP = """navbench doctor: what works on this machine and what to install, a line each

Each line begins with ok, note (what is missing that you may not need) or FAIL (without it navbench does not work).
exit code: 0 without a FAIL, 3 with one
"""
PYTHONS = ((3, 11), (3, 13))  # the oldest and the newest
SHOWN = ("numpy", "numba", "scipy", "hydra-core", "pydantic", "matplotlib")  # of the packages, with their versions
MEGABYTE, GIGABYTE = 1e6, 1e9


class Line(NamedTuple):
    """What is said of one thing."""

    verdict: Literal["ok", "note", "FAIL"]
    said: str


def doctor(arguments: Sequence[str]) -> int:
    """Print what works here, and return the exit code."""
    if {"-h", "--help"} & {*arguments}:
        print(HELP, end="")
        return 0
    if arguments:
        return complain(f"doctor {' '.join(arguments)}: unknown word; doctor takes none")
    failed = False
    for name, line in _lines():
        failed = failed or line.verdict == "FAIL"
        print(f"{line.verdict:<5} {name:<10} {line.said}", flush=True)
    return UNFINISHED if failed else 0


def _lines() -> Iterator[tuple[str, Line]]:
    """Yield what is said of each thing, and its name."""
    looks: dict[str, Callable[[], Line]] = {
        "navbench": _navbench, "Python": _python, "packages": _packages, "compiler": _compiler,
        **_simulators(), "window": _window, "videos": _videos, "engines": _engines, "cache": _cache,
        "results": _results,
    }  # fmt: skip
    for name, look in looks.items():
        try:
            yield name, look()
        except Exception as error:  # a broken installation may raise anything
            yield name, Line("FAIL", " ".join(f"{type(error).__name__}: {error}".split()))


def _navbench() -> Line:
    return Line("ok", f"{navbench.__version__} in {Path(navbench.__file__).parent}")


def _python() -> Line:
    here, (oldest, newest) = sys.version_info[:2], PYTHONS
    said = f"{platform.python_implementation()} {platform.python_version()}, {platform.system()} {platform.machine()}"
    if oldest <= here <= newest and sys.implementation.name == "cpython":
        return Line("ok", said)
    return Line("FAIL", f"{said}; CPython from {oldest[0]}.{oldest[1]} to {newest[0]}.{newest[1]} is needed")


def _packages() -> Line:
    """Hold what is installed against what navbench requires here."""
    if find_spec("packaging") is None:
        return Line("FAIL", "pip install packaging")
    from packaging.requirements import Requirement

    needed = [Requirement(line) for line in requires("navbench") or ()]
    needed = [one for one in needed if one.marker is None or one.marker.evaluate({"extra": ""})]
    there = {one.name: _version_of(one.name) for one in needed}
    wrong = [
        one for one in needed if not (there[one.name] and one.specifier.contains(there[one.name], prereleases=True))
    ]
    if wrong:
        has = ", ".join(f"{one.name} {there[one.name] or 'missing'}" for one in wrong)
        wheels = " ".join(f"'{one.name}{one.specifier}'" for one in wrong)
        return Line("FAIL", f"{has}; pip install {wheels}")
    shown = ", ".join(f"{name} {there[name]}" for name in SHOWN if name in there)
    return Line("ok", f"all {len(needed)} as required: {shown}")


def _version_of(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def _compiler() -> Line:
    numba: Any = import_module("numba")
    if numba.config.DISABLE_JIT:
        return Line("FAIL", "NUMBA_DISABLE_JIT is set: robots move and sense in compiled code; unset it")
    numba.njit(lambda: 0)()
    return Line("ok", f"numba {numba.__version__} compiles")


def _simulators() -> dict[str, Callable[[], Line]]:
    """Return how to look at each simulator that there is a file of."""
    folder = Path(navbench.__path__[0], "conf", "simulator")
    if not folder.is_dir():
        folder = Path(navbench.__path__[-1], "conf", "simulator")
    return {file.stem: lambda file=file: _simulator(file) for file in sorted(folder.glob("*.yaml"))}  # type: ignore[misc]


def _simulator(file: Path) -> Line:
    """Return whether a simulator can be made."""
    import yaml

    module, _, name = yaml.safe_load(file.read_text(encoding="utf-8"))["_target_"].rpartition(".")
    try:
        simulator: Any = getattr(import_module(module), name)
    except ValueError as error:  # of a module that says itself what it needs
        return Line("note", str(error))
    wheels = " and ".join(f"{package} {version(package)}" for package in simulator.packages)
    return Line("ok", f"simulator={file.stem} works{', on ' + wheels if wheels else ''}")


def _window() -> Line:
    if why := why_none():
        return Line("note", f"no display: simulator.gui=true needs one, {why}")
    return Line("ok", "there is a display for simulator.gui=true")


def _videos() -> Line:
    found = "imageio-ffmpeg" if find_spec("imageio_ffmpeg") else shutil.which("ffmpeg")
    return Line("ok", f"ffmpeg: {found}") if found else Line("note", "no ffmpeg for MP4s: pip install imageio-ffmpeg")


def _engines() -> Line:
    import psutil

    memory = psutil.virtual_memory()
    said = f"{os.cpu_count()} cores, {memory.available / GIGABYTE:.1f} of {memory.total / GIGABYTE:.1f} GB memory free"
    return Line("ok", f"local: {said}")


def _cache() -> Line:
    from navbench.compiled import cache_folder

    try:
        folder = cache_folder()
    except OSError:
        return Line("note", "no folder can be written: functions are compiled in each process; set NAVBENCH_CACHE_DIR")
    wanted = os.environ.get("NAVBENCH_CACHE_DIR", "")
    if wanted and Path(wanted).absolute() not in folder.parents:
        return Line("note", f"NAVBENCH_CACHE_DIR={wanted} cannot be written; {folder} is used")
    return Line("ok", f"{folder}: can be written, {_size(folder) / MEGABYTE:.0f} MB; NAVBENCH_CACHE_DIR moves it")


def _size(folder: Path) -> int:
    size = 0
    for at, _, names in os.walk(folder):
        for name in names:
            with suppress(FileNotFoundError):  # another run has removed it meanwhile
                size += os.lstat(os.path.join(at, name)).st_size
    return size


def _results() -> Line:
    free = f"{shutil.disk_usage('.').free / GIGABYTE:.1f} GB free"
    if not os.access(".", os.W_OK):
        return Line("note", f"{os.getcwd()} cannot be written: run elsewhere, or name hydra.run.dir; {free}")
    return Line("ok", f"{os.getcwd()}/outputs can be written, {free}")
