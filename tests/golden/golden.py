"""The golden set: what fixed cells and tunings do, to the last bit, through the public commands alone.

``python tests/golden/golden.py`` compares with ``golden.json`` and names what differs; ``--write`` renews it. Per cell,
episode and robot it keeps the outcome, all metrics as exact floats, and a digest of states and traces as exact
floats; no hash of a configuration, name or reason, so that a reshaped house passes and a changed number does not.
"""

import argparse
import hashlib
import json
import multiprocessing
import os
import platform
import sys
import tempfile
from importlib.metadata import packages_distributions, version
from pathlib import Path
from typing import Any

FILE = Path(__file__).with_name("golden.json")
METRICS = (
    "path_length_m", "time_s", "collisions", "robot_collisions", "standing_collisions", "min_clearance_m",
    "mean_speed_mps", "heading_ise", "total_turning_rad", "w_sign_changes", "goal_distance_m",
)  # fmt: skip
STATES = ("t_s", "x_m", "y_m", "heading_rad", "v_mps", "w_radps")
KEYS = ("run_id", "episode", "robot_index")

CONTROLLERS = (
    "sflc", "pid", "pso_pid", "abc_pid", "fa_pid", "mixed", "oa_to", "oa_to_ga", "oa_to_printed", "multi_agent",
    "dual_layer", "dual_layer_slow", "go_to_goal",
)  # fmt: skip
WORLDS = ("deadlock", "random_discs", "random_movers", "lei_circle3", "nemeiksis_rooms")
NOISE = "sensors.noise_std_m=0.01 sensors.dropout_probability=0.02"
DRIFT = "sensors.odometry.travel_noise=0.02 sensors.odometry.wheel_scale_std=0.01"
MOVED = "start_jitter_m=0.02 start_heading_jitter_rad=1.0 episodes=3"
CELLS = (
    *(f"controller={controller} world={world}" for controller in CONTROLLERS for world in WORLDS),
    *(f"controller={c} world=no_deadlock {MOVED} {NOISE} {DRIFT} seed=3" for c in ("sflc", "pid", "multi_agent")),
    f"controller=dual_layer world=lei_circle6 episodes=2 sensors=disc_tracker {DRIFT} "
    "sensors.tracker.position_noise_std_m=0.05",
    f"controller=oa_to world=random_crossing episodes=3 {NOISE} seed=5",
    f"controller=go_to_goal world=deadlock simulator.on_collision=block {MOVED}",
    "controller=go_to_goal world=random_movers simulator.on_collision=block episodes=3",
    "controller=pid world=lei_circle6 simulator.on_collision=block",
    f"controller=sflc world=deadlock simulator.drive=limited {MOVED}",
    "controller=oa_to world=zhao2017_dynamic simulator.drive=limited",
    "controller=dual_layer world=swap_circle episodes=2",
    "controller=go_to_goal world=swap_circle episodes=2 seed=9",
    f"controller=multi_agent world=nemeiksis_wall {MOVED}",
    "controller=oa_to world=random_single_mover episodes=3",
    "controller=sflc world=lei_corner robot=disc015",
    "controller=oa_to_ga world=zhao2018_static episodes=2 start_jitter_m=2.0",
    "controller=dual_layer_slow world=lei_wall",
)
TUNINGS = (
    *(f"controller=pid tuner={t} objective=ise world=corner budget=45" for t in ("pso", "abc", "fa", "de", "random")),
    "controller=pid tuner=pso objective=weighted world=deadlock worlds=[corner] budget=30 episodes=2 "
    "start_jitter_m=0.02 seed=4",
    "controller=oa_to tuner=ga objective=zhao2018 world=zhao2018_static budget=60",
)


def _exact(value: Any) -> str | int:
    return value if isinstance(value, int) else float(value).hex()


def _cell(words: str, folder: Path) -> dict[str, Any]:
    """Run one cell and return what is kept of it, by episode and robot."""
    import numpy as np
    import pyarrow.parquet as pq

    import navbench

    ran = navbench.run(*words.split(), "workers=0")
    folder = ran.path
    rows = {}
    episodes = [
        row for part in sorted((folder / "episodes").glob("*.parquet")) for row in pq.read_table(part).to_pylist()
    ]
    tables = [pq.read_table(part) for part in sorted((folder / "trajectories").glob("*.parquet"))]
    for row in episodes:
        digest = hashlib.sha256()
        lengths = 0
        for table in tables:
            mine = np.flatnonzero(
                (table["episode"].to_numpy() == row["episode"])
                & (table["robot_index"].to_numpy() == row["robot_index"])
            )
            if not len(mine):
                continue
            traces = sorted(name for name in table.column_names if name not in (*KEYS, *STATES))
            lengths += len(mine)
            for name in (*STATES, *traces):
                digest.update(table[name].to_numpy()[mine].astype(np.float64).tobytes())
        kept = {name: _exact(row[name]) for name in METRICS}
        rows[f"{row['episode']}/{row['robot_index']}"] = {
            "outcome": row["outcome"], **kept, "states": lengths, "digest": digest.hexdigest()[:16],
        }  # fmt: skip
    return rows


def _tuning(words: str, folder: Path) -> dict[str, Any]:
    """Run one tuning and return each evaluation's cost, robots and parameters."""
    import pyarrow.parquet as pq

    from navbench.cli import main as cli

    engine = ["simulator=pybullet", "verify=null"]
    argv, sys.argv = sys.argv, ["navbench", "tune", *words.split(), *engine, "workers=0", f"hydra.run.dir={folder}"]
    sys.stdout.flush()
    out = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    try:
        cli.main()
    except SystemExit as end:
        if end.code:
            raise RuntimeError(f"tune {words}: exit {end.code}") from None
    finally:
        sys.stdout.flush()
        os.dup2(out, 1)
        sys.argv = argv
    (part,) = (folder / "evaluations").glob("*.parquet")
    table = pq.read_table(part)
    columns = [name for name in table.column_names if name not in ("tuning_id", "name", "tuner", "seed")]
    digest = hashlib.sha256()
    for row in table.select(columns).to_pylist():
        digest.update(json.dumps([_exact(v) if not isinstance(v, str) else v for v in row.values()]).encode())
    costs = table["cost"].to_pylist()
    return {
        "evaluations": len(costs),
        "least": min(costs).hex(),
        "last": costs[-1].hex(),
        "digest": digest.hexdigest()[:16],
    }


def one(job: tuple[str, str]) -> tuple[str, dict[str, Any]]:
    """Run one cell or tuning in a folder of its own; of the same words it returns the same."""
    kind, words = job
    with tempfile.TemporaryDirectory() as folder:
        return f"{kind} {words}", (_cell if kind == "run" else _tuning)(words, Path(folder) / "results")


JOBS = (*(("run", words) for words in CELLS), *(("tune", words) for words in TUNINGS))


def machine() -> dict[str, str]:
    """Return what the last bit may depend on."""
    names = ("numpy", "numba", "llvmlite", packages_distributions()["pybullet"][0])
    return {"python": platform.python_version(), "machine": f"{platform.system()} {platform.machine()}",
            "libc": " ".join(platform.libc_ver()), **{name: version(name) for name in names}}  # fmt: skip


def differences(wanted: dict[str, Any], found: dict[str, Any], place: str = "") -> list[str]:
    """Return a line for each value that is not as wanted."""
    lines = []
    for key in dict.fromkeys([*wanted, *found]):
        old, new, where = wanted.get(key), found.get(key), f"{place}{key}"
        if isinstance(old, dict) and isinstance(new, dict):
            lines += differences(old, new, f"{where}: ")
        elif old != new:
            lines.append(f"{where}: wanted {old}, found {new}")
    return lines


def main() -> int:
    """Run all jobs and compare or write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="renew golden.json")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--only", default="", help="jobs whose words hold this")
    given = parser.parse_args()
    jobs = [job for job in JOBS if given.only in " ".join(job)]
    with multiprocessing.get_context("spawn").Pool(given.workers) as pool:
        found = dict(pool.map(one, jobs, chunksize=1))
    if given.write:
        FILE.write_text(json.dumps({"machine": machine(), "jobs": found}, indent=1) + "\n")
        return 0
    wanted = json.loads(FILE.read_text())["jobs"]
    lines = differences({name: wanted[name] for name in found}, found)
    print("\n".join(lines[:50]) or f"{len(found)} jobs: as wanted, to the last bit")
    return bool(lines)


if __name__ == "__main__":
    sys.exit(main())
