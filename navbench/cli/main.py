"""The command line: picks the verb, runs it, prints, and turns what is wrong into one line and exit code 2."""

import os
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, NamedTuple

from navbench import __version__

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from navbench.experiments.store import Results

HELP = """navbench: compare reactive navigation controllers of wheeled robots in PyBullet worlds

  navbench controller=sflc world=deadlock           run one cell and print its table
  navbench -m controller=sflc,pid world=deadlock,no_deadlock
                                                    run every combination and print one joined table
  navbench tune controller=pid tuner=pso world=no_deadlock
                                                    search a controller's parameters for the least cost
  navbench study aouf2019                           reproduce a paper, number beside number, into results/aouf2019
  navbench report DIR... [out=DIR] [--trust]        rebuild tables and figures from results, and run nothing
  navbench report join=results                      join the reports in that directory into its README.md
  navbench list [controller|world|robot|sensors|simulator|tuner|objective|study]
                                                    what there is, a line each

keys of a run, and of a tuning
  controller= world= robot= sensors= simulator=     choose a file of that group
  GROUP.KEY=VALUE                                   change one value, such as simulator.drive=limited
  episodes=N seed=N                                 how many episodes, and the seed of all chance
  start_jitter_m=X start_heading_jitter_rad=X       move and turn the starts at random by up to this
  workers=N                                         processes; default one a core
  hydra.run.dir=DIR hydra.sweep.dir=DIR             where the results go; default outputs/DATE/TIME-...

further keys of a tuning
  tuner= objective= budget=N worlds=[...]           how to search, for what, and in which further worlds
  +controller.tunable.KEY={low: X, high: X, scale: linear}
                                                    search one more parameter of the controller, within bounds

options
  -m, --multirun                                    sweep over comma-separated values
  --config-dir DIR                                  add your own controllers, worlds and robots
  --cfg job                                         print the composed configuration and run nothing
  --version, -h, --help
"""
VERBS = ("list", "tune", "study", "report")
CONFIG_DIR = ("--config-dir", "-cd")


def main() -> None:
    """Run the command line and exit: 0 when all ran, 2 for wrong input, 130 when interrupted."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:  # closed by >&-: the next file opened would get its number, and what is printed
            os.open(os.devnull, os.O_RDWR)
    try:
        code = _verb(sys.argv[1:])
        print(end="", flush=True)
    except OSError as error:  # of the output: the reader of a pipe, such as head, has seen enough, or a disk is full
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # Python writes what is left when it ends
        code = 0 if isinstance(error, BrokenPipeError) else _complain(f"the output: {error.strerror}")
    except KeyboardInterrupt:
        code = _interrupted()
    sys.exit(code)


def _verb(arguments: list[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(HELP, end="")
    elif arguments[0] == "--version":
        print(f"navbench {__version__}")
    elif arguments[0] == "list":
        return _list(arguments[1:])
    elif arguments[0] in VERBS:
        return _other_verb(arguments[0], arguments[1:])
    else:
        return _run(arguments)
    return 0


def _list(arguments: list[str]) -> int:
    from navbench.cli.catalogue import CONF, check_folder, groups_in, print_catalogue
    from navbench.validation import DescriptionError

    folders, groups = [CONF], []
    words = iter(arguments)
    for word in words:
        name, _, value = word.partition("=")
        if name not in CONFIG_DIR:
            groups.append(word)
        elif value := value or next(words, ""):
            folders.append(Path(value))
        else:
            return _complain(f"{word}: needs a folder")
    try:
        for folder in folders[1:]:
            check_folder(folder)
    except DescriptionError as error:
        return _complain(str(error))
    known = groups_in(folders)
    for group in groups:
        if group not in known:
            return _complain(f"list {group}: unknown group; there are {', '.join(known)}")
    print_catalogue(folders, groups or known)
    return 0


def _other_verb(verb: str, arguments: list[str]) -> int:
    """Run a verb that is no plain run."""
    from navbench.cli import verbs
    from navbench.cli.errors import CONFIGURATION_ERRORS, one_line

    try:
        code: int = {"tune": verbs.tune, "study": verbs.study, "report": verbs.report}[verb](arguments)
    except (*CONFIGURATION_ERRORS, ValueError) as error:
        return _complain(one_line(error))
    return code


def _run(arguments: list[str]) -> int:
    """Run one cell or a sweep under Hydra, then print its table."""
    if not _is_word(arguments[0]) and not arguments[0].startswith("-"):
        return _complain(f"{arguments[0]}: unknown verb; allowed: {', '.join(VERBS)}, or keys of a run as key=value")
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra then raises instead of printing its own message
    import hydra

    from navbench.cli import schema
    from navbench.cli.errors import CONFIGURATION_ERRORS, one_line
    from navbench.cli.sweeps import MADE, Made, discard_made

    schema.register()
    made: list[Made] = []
    MADE.set(made)
    ran: list[Ran] = []
    failed: list[Exception] = []

    def task(config: "DictConfig") -> None:
        try:
            ran.append(_run_cell(config))
        except Exception as error:
            failed.append(error)
            if not isinstance(error, CONFIGURATION_ERRORS):
                raise  # a slip in navbench itself, whose place must be seen
            _complain(f"{_cell_of_a_sweep()}{one_line(error)}")

    try:
        if os.getcwd() not in sys.path:
            sys.path.append(os.getcwd())  # a console script does not look there, and a user's controller may lie there
        _check_arguments(arguments)
        sys.argv[1:] = sorted(arguments, key=_is_word, reverse=True)  # argparse stumbles over flags between words
        with warnings.catch_warnings():
            warnings.filterwarnings("error", category=UserWarning, module=r"hydra\.")  # a folder that is missing
            hydra.main(config_path="pkg://navbench.conf", config_name="run", version_base="1.3")(task)()
        if ran:
            _print_tables(ran)
    except (BrokenPipeError, KeyboardInterrupt):
        raise
    except SystemExit as end:  # after --help and the like, and after a wrong flag
        return 2 if end.code else 0
    except Exception as error:
        if error in failed:
            raise
        return _complain(one_line(error))  # Hydra composes with errors of many kinds
    finally:
        discard_made(made)
    return 2 if failed else 0


class Ran(NamedTuple):
    """A cell that ran: its results, and the sweep's directory where it was one of a sweep."""

    results: "Results"
    sweep: Path | None


def _is_word(argument: str) -> bool:
    return argument.startswith("~") or (not argument.startswith("-") and "=" in argument)


def _check_arguments(arguments: list[str]) -> None:
    """Check what Hydra would pass over or report as a slip in the program."""
    from navbench.cli.catalogue import check_folder
    from navbench.cli.composing import check_words
    from navbench.validation import DescriptionError

    check_words(arguments)
    for word, following in zip(arguments, [*arguments[1:], ""], strict=True):
        name, _, value = word.partition("=")
        if name in CONFIG_DIR:
            if not (value or following):
                raise DescriptionError(f"{word}: needs a folder")
            check_folder(Path(value or following))


def _run_cell(config: "DictConfig") -> Ran:
    """Run one cell into Hydra's directory."""
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    from navbench.cli.composing import plain
    from navbench.cli.configuration import cell_of

    job = HydraConfig.get()
    os.chdir(job.runtime.cwd)  # whatever hydra.job.chdir says: paths are relative to where the user stands
    path = Path(os.path.relpath(job.runtime.output_dir))
    cell = cell_of(plain(config, job.runtime.choices))
    from navbench.experiments.running import run_cells
    from navbench.report.figures import save_trajectories

    results = run_cells([cell], path, config.workers)
    save_trajectories([results], path / "trajectory.png")
    if job.mode != RunMode.MULTIRUN:
        return Ran(results, None)
    print(f"{job.job.num}: {cell.names.controller} in {cell.names.world}: done", file=sys.stderr)
    return Ran(results, Path(job.sweep.dir))


def _cell_of_a_sweep() -> str:
    """Return which cell of a sweep runs, as the beginning of a message; empty outside a sweep."""
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    job = HydraConfig.get()
    return f"cell {job.job.num}: " if job.mode == RunMode.MULTIRUN else ""


def _print_tables(ran: "Sequence[Ran]") -> None:
    """Print the table of a run, or write and print the joined table of a sweep."""
    from navbench.cli.sweeps import join
    from navbench.report.tables import failures, summarize, to_text

    last = ran[-1]
    if last.sweep is not None:
        join([cell.results for cell in ran], last.sweep)
        return
    episodes = last.results.episodes()
    print(to_text(summarize(episodes)))
    for line in failures(episodes):
        print(line)
    print(f"results: {last.results.path}")


def _complain(message: str) -> int:
    print(f"navbench: {shorten(message, 400, placeholder=' ...')}", file=sys.stderr)
    return 2


def _interrupted() -> int:
    _complain("interrupted; what was finished is kept")
    return 130
