"""The command line: picks the verb, runs it, prints, and turns what is wrong into one line and exit code 2."""

import gc
import math
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from navbench import __version__
from navbench.cli.interrupts import Interrupts, is_of_interrupt
from navbench.cli.progress import UNFINISHED, complain
from navbench.output import shielded

HELP = """navbench: compare reactive navigation controllers of wheeled robots in simulated worlds

  navbench controller=sflc world=deadlock           run one cell and print its table
  navbench -m controller=sflc,pid world=deadlock,no_deadlock
                                                    run every combination and print one joined table
  navbench tune controller=pid tuner=pso world=no_deadlock
                                                    search a controller's parameters for the least cost
  navbench study aouf2019                           reproduce a paper, number beside number, into results/aouf2019
  navbench multiverse aouf2019                      ask its claims in many reconstructions of what the paper leaves open
  navbench report DIR... [out=DIR] [--trust]        rebuild tables and figures from results, compare, and run nothing
  navbench report join=results                      join the reports in that directory into its README.md
  navbench verify DIR...                            say whether results are whole, complete and of the installed code
  navbench show DIR [episode=K]                     draw one episode: by default the first in which a robot failed
  navbench show controller=sflc world=random_discs episodes=20
                                                    run them, and draw the first episode in which a robot failed
  navbench show controller=sflc                     draw a controller, or a world=, robot= or sensors=
  navbench replay DIR [episode=K] [--video FILE]    play one episode in a window, or write it as a video
  navbench list [controller|world|robot|sensors|simulator|engine|tuner|objective|study|metric]
                                                    what there is, a line each
  navbench new controller|world|robot|sensors|study NAME
                                                    write a template of your own, which runs, with a test
  navbench check controller=NAME                    hold a controller against the contract
  navbench doctor                                   what works on this machine, and what to install

keys of a run or sweep
  controller= world= robot= sensors= simulator=     choose a file of that group
  GROUP.KEY=VALUE                                   change one value, such as simulator.drive=limited
  episodes=N seed=N                                 how many episodes, and the seed of all random streams
  episode=K                                         the one episode of index K alone
  start_jitter_m=X start_heading_jitter_rad=X       move and turn the starts at random by up to this
  workers=N                                         processes, in which controllers run; default one a core; 0 runs them
                                                    in this one, for a debugger, and nothing protects it from them
  controller_timeout_s=X                            CPU time that a step of a controller may take; default 60
  hydra.run.dir=DIR hydra.sweep.dir=DIR             where the results go; default outputs/DATE/TIME-...; what an
                                                    earlier call with the same words finished there is kept
  record=ranges                                     keep what the range sensors read with the trajectories
  engine=local|dask|ray|slurm engine.KEY=VALUE      where they run: `navbench list engine`
  resume=other-code                                 keep it even where code that makes results has changed since
  --overwrite                                       remove finished parts that are there and not of this work; without
                                                    it such a directory is refused

options
  -m, --multirun                                    sweep over comma-separated values
  --config-dir DIR                                  add your own controllers, worlds and robots
  --cfg job                                         print the composed configuration and run nothing
  --version, -h, --help                             also after each verb

exit code: 0 if every planned episode has its row and every part of a report is there, 3 if not, 2 for wrong input,
           130 when interrupted
"""
MEANT = {  # words of other tools
    **dict.fromkeys(("plot", "draw", "view"), "show"),
    **dict.fromkeys(("play", "animate", "video"), "replay"),
    **dict.fromkeys(("train", "optimize", "optimise"), "tune"),
    **dict.fromkeys(("init", "create", "make"), "new"),
    **{"test": "check", "validate": "check", "ls": "list", "info": "doctor", "compare": "report"},
}
ADDRESS_SPACE_GB = 1.5  # what OpenBLAS, Arrow and LLVM reserve: of less they hang or break, with 1.1 now and then
VERBS = ("list", "tune", "study", "multiverse", "report", "verify", "show", "replay", "new", "check", "doctor")


def main() -> None:
    """Run the command line and exit: 0 when all ran, 2 for wrong input, 3 when episodes are missing, 130 for Ctrl-C."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:  # closed by >&-: the next file opened would get its number, and what is printed
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # by workers, too
    printed = shielded("stdout", 1)
    shielded("stderr", 2)
    try:
        with Interrupts():
            code = _command(sys.argv[1:])
    except BaseException as error:
        if not is_of_interrupt(error):
            raise
        complain("interrupted")
        code = 130
    print(end="", flush=True)
    if printed.error and not isinstance(printed.error, BrokenPipeError):  # whose reader, such as head, has seen enough
        code = code or complain(f"the output: {printed.error.strerror}")
    gc.freeze()  # else the interpreter looks through all objects once more before it ends
    sys.exit(code)


def _command(arguments: list[str]) -> int:
    verbs = (i for i, word in enumerate(arguments) if word in VERBS and arguments[i - 1] not in ("--config-dir", "-cd"))
    place = next(verbs, 0)  # flags may stand before the verb
    arguments = [*arguments[place : place + 1], *arguments[:place], *arguments[place + 1 :]]
    first = arguments[0] if arguments else "--help"
    if first == "help" or {"-h", "--help"} & {first, *arguments} and first not in VERBS[1:]:
        print(HELP, end="")
    elif first == "--version":
        print(f"navbench {__version__}")
    elif first == "list":
        return _list(arguments[1:])
    elif first == "doctor":
        from navbench.cli.doctor import doctor

        return doctor(arguments[1:])  # which says what is missing, where the others could not even begin
    elif first in VERBS:
        return _verb(first, arguments[1:])
    elif "=" in first or first.startswith(("-", "~")):
        return _verb("run", arguments)
    else:
        from navbench.validation import instead

        if arguments[1:] and arguments[1].startswith("="):
            return complain(f"{' '.join(arguments[:3])}: cannot be read; a word is key=value without spaces")
        if first == "run":
            return complain("run: unknown verb; a run has none: navbench controller=sflc world=deadlock")
        return complain(
            f"{first}: unknown verb; {instead(MEANT.get(first, first), VERBS)}, or keys of a run as key=value"
        )
    return 0


def _verb(verb: str, arguments: Sequence[str]) -> int:
    """Run a verb, each the function of its name in the module of its name."""
    from navbench.cli.errors import CONFIGURATION_ERRORS, one_line

    try:
        os.getcwd()
    except FileNotFoundError:
        return complain("the working directory: it is not there any more")
    if (may_have := _address_space_gb()) < ADDRESS_SPACE_GB:
        return complain(f"ulimit -v: {may_have:.2g} GB of address space; the libraries need {ADDRESS_SPACE_GB:g} GB")
    try:
        module = import_module(f"navbench.cli.{verb}")
        if {"-h", "--help"} & {*arguments}:
            print(module.HELP, end="")
            return 0
        code: int = getattr(module, verb)(arguments)
    except (*CONFIGURATION_ERRORS, ValueError) as error:
        if is_of_interrupt(error):
            raise
        return complain(one_line(error))
    except MemoryError as error:
        complain(f"out of memory: {one_line(error)}")
        return UNFINISHED
    return code


def _address_space_gb() -> float:
    """Return how much address space this process may have [GB]; what memory it may have is another matter."""
    try:
        from resource import RLIM_INFINITY, RLIMIT_AS, getrlimit
    except ImportError:  # on Windows
        return math.inf
    limit = getrlimit(RLIMIT_AS)[0]
    return math.inf if limit == RLIM_INFINITY else limit / 1e9


def _list(arguments: list[str]) -> int:
    from navbench.cli.catalogue import CONF, groups_in, print_catalogue
    from navbench.cli.words import sort_words
    from navbench.validation import DescriptionError, instead

    try:
        words = sort_words(arguments)
        folders = [CONF, *([Path(words.config_dir)] if words.config_dir else [])]
        known = groups_in(folders)
        for group in words.names + words.overrides:
            if group not in known:
                return complain(f"list {group}: unknown group; {instead(group, known, 'there are')}")
        print_catalogue(folders, words.names or known)
    except DescriptionError as error:
        return complain(str(error))
    except OSError as error:
        return complain(f"{error.filename}: {error.strerror}")
    return 0
