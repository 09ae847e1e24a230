"""Kill a driver or one of its processes at a random moment, and go on, again and again: ``python -m benchmarks.kill``.

Each round takes one of five commands of some seconds, sends ``SIGKILL`` at a moment between begin and end to the
driver or to a process that it has started, gives the same command again until it ends with 0, and compares every file
with those that an uninterrupted run left. Only what is never the same twice is left out: when it ran, and how long
controllers took. Then bits are flipped at random places of every part, of which ``navbench verify`` must find each.
"""

import argparse
import io
import json
import random
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout, suppress
from pathlib import Path
from typing import Any

import psutil

from navbench.cli.verify import verify

WORLD = """
defaults: [/schema/world@_here_, _self_, override /robot@_global_.robot: khepera3]
bounds: {x_min_m: -1.0, x_max_m: 3.0, y_min_m: -1.0, y_max_m: 1.0}
starts: [{x_m: 0.0, y_m: 0.0, heading_rad: 0.0}]
goals: [{x_m: 2.0, y_m: 0.0}]
goal_tolerance_m: 0.05
time_limit_s: 60.0
"""
STUDY = """# @package _global_
title: "tiny: a straight line"
summary: A robot drives 1.95 m; its speed is anything between 0.1 and a third of a metre a second.
cells:
  - {name: line, label: rule, overrides: [controller=go_to_goal, world=line, simulator=planar]}
claims:
  time: {says: it takes 10 s, printed: 10.0 s, within: 2.0 s, measure: median, of: {metric: time_s, cell: line}}
  arrives: {says: it arrives, holds: in 95 % of the cases, measure: share_reached, of: {cell: line}}
multiverse:
  admissible: {there: {says: it arrives, holds: in 80 % of the cases, measure: share_reached, of: {cell: line}}}
  implied: [arrives]
report: [{name: verdicts, title: Claims, groups: {}}]
"""
DRIVE = ("world=deadlock", "world.time_limit_s=2", "simulator=pybullet", "start_jitter_m=0.01", "workers=2")
COMMANDS: Mapping[str, Sequence[str]] = {
    "run": ("controller=sflc", *DRIVE, "episodes=30", "hydra.run.dir=out"),
    "sweep": ("-m", "controller=sflc,pid", *DRIVE, "episodes=15", "hydra.sweep.dir=out"),
    "study": ("study", "smoke", "workers=2"),
    "tune": ("tune", "controller=pid", "tuner=pso", "world=deadlock", "budget=30", "workers=2", "hydra.run.dir=out"),
    "multiverse": (*("multiverse", "tiny", "n=256", "decide=64", "search=32"), *("workers=2", "--config-dir", "conf")),
}
WHEN = ("began", "ended", "resumed", "seal")  # in a manifest: what follows from the time
TIMES = re.compile("/latency/|/seconds/")  # folders of what was measured with a clock
TRIES = 5  # of the same command until it ends with 0
FLIPS = 10  # of bits, a part


def prepare(folder: Path) -> None:
    """Write what the multiverse is of."""
    for name, text in (("world/line.yaml", WORLD), ("study/tiny.yaml", STUDY)):
        file = folder / "conf" / name
        file.parent.mkdir(parents=True)
        file.write_text(text)


def begun(folder: Path, words: Sequence[str]) -> subprocess.Popen[str]:
    """Begin a command."""
    pipe = subprocess.PIPE
    command = [sys.executable, "-m", "navbench", *words]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=pipe, text=True)


def left(folder: Path) -> dict[str, bytes]:
    """Return what commands left that is the same each time, by its name."""
    files = {file.relative_to(folder).as_posix(): file for file in sorted(folder.rglob("*")) if file.is_file()}
    return {name: _timeless(file) for name, file in files.items() if not TIMES.search(name)}


def _timeless(file: Path) -> bytes:
    if file.name in ("manifest.json", "prior.json"):
        values: dict[str, Any] = json.loads(file.read_bytes())
        return json.dumps({key: value for key, value in values.items() if key not in WHEN}, sort_keys=True).encode()
    lines = file.read_bytes().splitlines(keepends=True)
    return b"".join(line for line in lines if file.name != "report.md" or b"robot-steps in" not in line)


def kill_one(driver: psutil.Process, rng: random.Random) -> str:
    """Kill the driver, or one of its processes, and say which."""
    with suppress(psutil.Error):
        children = driver.children(recursive=True)
        victim = rng.choice([driver, *children]) if children and rng.random() < 0.5 else driver
        what = "driver" if victim == driver else "process"
        victim.kill()
        return what
    return "nothing"


def killed(kind: str, whole: Mapping[str, bytes], seconds: float, rng: random.Random) -> tuple[str, list[str]]:
    """Kill a command once, go on, and return whom it hit and when, and the files that differ."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        run, moment = begun(folder, COMMANDS[kind]), rng.uniform(0.0, seconds)
        time.sleep(moment)
        said = f"{kill_one(psutil.Process(run.pid), rng)} at {moment / seconds:.0%}"
        code, tries = run.wait(), 0
        while code and tries < TRIES:
            run, tries = begun(folder, COMMANDS[kind]), tries + 1
            errors, code = run.communicate()[1], run.returncode
        if code:
            return said, [f"exit {code}: {errors.strip()}"]
        found = left(folder)
        return said, [name for name in sorted({*found, *whole}) if found.get(name) != whole.get(name)]


def flipped(folder: Path, rng: random.Random, parts: int) -> tuple[int, int]:
    """Flip bits of some parts below a folder, one at a time; return how many verify found, and of how many."""
    marks = [*folder.rglob("manifest.json"), *folder.rglob("outputs/multiverse/*/prior.json")]
    files = sorted((file, mark.parent) for mark in marks for file in mark.parent.rglob("*.parquet"))
    count = found = 0
    for file, results in rng.sample(files, min(parts, len(files))):
        data = file.read_bytes()
        for _ in range(FLIPS):
            place, bit = rng.randrange(len(data)), rng.randrange(8)
            file.write_bytes(data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :])
            with redirect_stdout(io.StringIO()) as told:
                code = verify([str(results)])
            count, found = count + 1, found + (code == 3 and file.name in told.getvalue())
        file.write_bytes(data)
    return found, count


def main() -> None:
    """Kill and flip, and exit with 1 where something differs or is not found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--parts", type=int, default=20, help="in how many parts bits are flipped")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng, equal = random.Random(given.seed), 0
    with tempfile.TemporaryDirectory() as name:
        wholes: dict[str, tuple[dict[str, bytes], float]] = {}
        for number in range(given.rounds):
            kind = list(COMMANDS)[number % len(COMMANDS)]
            if kind not in wholes:
                folder = Path(name, kind)
                prepare(folder)
                began = time.monotonic()
                assert begun(folder, COMMANDS[kind]).wait() == 0, kind
                wholes[kind] = left(folder), time.monotonic() - began
            said, differ = killed(kind, *wholes[kind], rng)
            equal += not differ
            print(f"{kind}, {said}: {', '.join(differ) or 'the same bytes'}", flush=True)
        print(f"{equal} of {given.rounds} rounds left the bytes of an uninterrupted run", flush=True)
        found, count = flipped(Path(name), rng, given.parts)
        print(f"{found} of {count} flipped bits were found")
    sys.exit(not (equal == given.rounds and found == count))


if __name__ == "__main__":
    main()
