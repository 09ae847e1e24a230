"""Measure everything in one run: ``python -m benchmarks [section ...] [--quick] [--rounds N] [--studies FILE]``.

Writes ``benchmarks/README.md``, in which the tables of sections that were not asked for stay.
"""

import argparse
import csv
import os
import platform
import re
from collections.abc import Callable
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from benchmarks.coverage import coverage
from benchmarks.decomposition import decomposition
from benchmarks.environments import environments
from benchmarks.harness import Cell, Effort, Table
from benchmarks.inference import inference
from benchmarks.loops import closed_loop, shipped
from benchmarks.rays import rays
from benchmarks.reconstructions import reconstructions
from benchmarks.resources import memory, startup
from benchmarks.scaling import isolation, scaling, workers
from benchmarks.shares import shares

SECTIONS: dict[str, Callable[[Effort], Table]] = {
    "loop": closed_loop,
    "shipped": shipped,
    "environments": environments,
    "inference": inference,
    "decomposition": decomposition,
    "rays": rays,
    "scaling": scaling,
    "workers": workers,
    "isolation": isolation,
    "memory": memory,
    "startup": startup,
    "shares": shares,
    "reconstructions": reconstructions,
    "coverage": coverage,
}
PACKAGES = ("numpy", "numba", "pybullet", "navground", "ir-sim", "scikit-fuzzy")
README = Path(__file__).with_name("README.md")
QUICK = Effort(1, 0.001, is_quick=True)
HEAD = """# Speed, and how often intervals hold

Written by `python -m benchmarks`, which measures this on your machine; `pip install -e '.[bench,gym]'` brings the
peers, and one that is missing is named as missing. `python -m benchmarks loop rays` measures two sections anew and
leaves the others; `--rounds 15` narrows the intervals.

Sides are measured in turn, in CPU seconds of the process; a speed is the median of the rounds, a ratio the median of
the rounds' ratios with its 95 % interval, from 6 rounds on. Absolute speeds are those of one machine: compare ratios.
"""


def machine() -> str:
    """Return what this was measured on."""
    info = Path("/proc/cpuinfo")
    model = re.search(r"model name\s*: (.*)", info.read_text()) if info.is_file() else None
    cpu = f"{model[1] if model else platform.processor() or platform.machine()}, {os.cpu_count()} cores"
    return f"{cpu}; CPython {platform.python_version()}; {', '.join(map(installed, PACKAGES))}"


def installed(package: str) -> str:
    """Return a package with its version."""
    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return f"no {package}"


def studies(file: Path) -> Table:
    """Return the table of a file of lines ``study,seconds``: whole studies take too long to be run here."""
    rows: list[tuple[Cell, ...]] = [(name, float(seconds)) for name, seconds in csv.reader(file.open())]
    return Table("Studies", "Whole studies from the shell, all cores.", ("study", "seconds"), rows)


def main(arguments: list[str] | None = None, readme: Path = README) -> list[Table]:
    """Measure, print, and rewrite the README; return the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__.splitlines()[0])
    parser.add_argument("sections", nargs="*", metavar="section", help=f"of {', '.join(SECTIONS)}; all without any")
    parser.add_argument("--quick", action="store_true", help="only show that everything runs; writes nothing")
    parser.add_argument("--rounds", type=int, default=Effort().rounds, help="how often each side is measured")
    parser.add_argument("--studies", type=Path, metavar="FILE", help="lines study,seconds of studies that were timed")
    given = parser.parse_args(arguments)
    if unknown := [name for name in given.sections if name not in SECTIONS]:
        parser.error(f"section {unknown[0]}: must be one of {', '.join(SECTIONS)}")
    effort = QUICK if given.quick else Effort(given.rounds)
    kept = dict(re.findall(r"(?ms)^## (.*?)\n(.*?)(?=^## |\Z)", readme.read_text())) if readme.is_file() else {}
    texts = {title: f"## {title}\n\n{body.strip()}\n\n" for title, body in kept.items()}
    asked = [partial(SECTIONS[name], effort) for name in given.sections or SECTIONS]
    asked += [partial(studies, given.studies)] if given.studies else []
    tables = []
    for measure in asked:
        tables.append(measure())
        print(tables[-1].markdown(), flush=True)
        texts[tables[-1].title] = f"{tables[-1].markdown()}\nMeasured on {machine()}.\n\n"
        if not given.quick:  # what is measured is kept, should the rest be interrupted
            readme.write_text("\n".join([HEAD, *texts.values()]).rstrip() + "\n")
    return tables


if __name__ == "__main__":
    main()
