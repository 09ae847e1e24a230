"""The command line: picks the verb, runs it, prints, and turns what is wrong into one line and exit code 2."""

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from navbench import __version__

if TYPE_CHECKING:
    from omegaconf import DictConfig

HELP = """navbench: compare reactive navigation controllers of wheeled robots in PyBullet worlds

  navbench controller=sflc world=deadlock           run one cell and print its table
  navbench -m controller=sflc,pid world=deadlock,no_deadlock
                                                    run every combination and print one joined table
  navbench list [controller|world|robot|sensors|simulator]
                                                    what there is, a line each

keys of a run
  controller= world= robot= sensors= simulator=     choose a file of that group
  GROUP.KEY=VALUE                                   change one value, such as simulator.drive=limited
  episodes=N seed=N                                 how many episodes, and the seed of all chance
  start_jitter_m=X start_heading_jitter_rad=X       move and turn the starts at random by up to this
  workers=N                                         processes; default one a core
  hydra.run.dir=DIR hydra.sweep.dir=DIR             where the results go; default outputs/DATE/TIME-...

options
  -m, --multirun                                    sweep over comma-separated values
  --config-dir DIR                                  add your own controllers, worlds and robots
  --cfg job                                         print the composed configuration and run nothing
  --version, -h, --help
"""
VERBS = ("list",)


def main() -> None:
    """Run the command line and exit: 0 when all ran, 2 for wrong input, 130 when interrupted."""
    arguments = sys.argv[1:]
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(HELP, end="")
    elif arguments[0] == "--version":
        print(f"navbench {__version__}")
    elif arguments[0] in VERBS:
        sys.exit(_list(arguments[1:]))
    else:
        sys.exit(_run(arguments))


def _list(arguments: list[str]) -> int:
    from navbench.catalogue import groups_in, print_catalogue

    folders = [Path(__file__).parent / "conf"]
    if "--config-dir" in arguments:
        at = arguments.index("--config-dir")
        if at + 1 == len(arguments):
            return _complain("--config-dir: needs a folder")
        folders.append(Path(arguments[at + 1]))
        arguments = arguments[:at] + arguments[at + 2 :]
    for folder in folders:
        if not folder.is_dir():
            return _complain(f"--config-dir={folder}: there is no such folder")
    known = groups_in(folders)
    for group in arguments:
        if group not in known:
            return _complain(f"list {group}: unknown group; there are {', '.join(known)}")
    print_catalogue(folders, arguments or known)
    return 0


def _run(arguments: list[str]) -> int:
    """Run one cell or a sweep under Hydra."""
    from navbench.errors import CONFIGURATION_ERRORS, one_line

    words = [word for word in arguments if not word.startswith("-") and "=" not in word and not word.startswith("~")]
    first = arguments[0]
    if first in words:
        return _complain(f"{first}: unknown verb; allowed: {', '.join(VERBS)}, or keys of a run as key=value")
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra then raises instead of printing its own message
    sys.path.append(os.getcwd())  # a console script does not look there, and a user's controller may lie there
    import hydra

    from navbench import schema

    schema.register()
    failed: list[str] = []

    def task(config: "DictConfig") -> None:
        try:
            _run_cell(config)
        except CONFIGURATION_ERRORS as error:
            failed.append(one_line(error))
            _complain(failed[-1])

    try:
        hydra.main(config_path="pkg://navbench.conf", config_name="run", version_base="1.3")(task)()
    except CONFIGURATION_ERRORS as error:
        return _complain(one_line(error))
    except KeyboardInterrupt:
        print("navbench: interrupted; what was finished is kept", file=sys.stderr)
        return 130
    return 2 if failed else 0


def _run_cell(config: "DictConfig") -> None:
    """Run one cell into Hydra's directory, and print its table unless it is one of a sweep."""
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    from navbench.configuration import cell_of
    from navbench.errors import CONFIGURATION_ERRORS
    from navbench.store import discard_empty

    job = HydraConfig.get()
    path = Path(os.path.relpath(job.runtime.output_dir))
    try:
        cell = cell_of(config, job.runtime.choices)
        from navbench.figures import save_trajectories
        from navbench.running import run_cells

        results = run_cells([cell], path, config.workers)
    except CONFIGURATION_ERRORS:
        discard_empty(path)
        raise
    save_trajectories(results, path / "trajectory.png")
    if job.mode == RunMode.MULTIRUN:
        print(f"{job.job.num}: {cell.names.controller} in {cell.names.world}: done", file=sys.stderr)
        return
    from navbench.tables import failures, summarize, to_text

    episodes = results.episodes()
    print(to_text(summarize(episodes)))
    for line in failures(episodes):
        print(line)
    print(f"results: {path}")


def _complain(message: str) -> int:
    print(f"navbench: {message}", file=sys.stderr)
    return 2
