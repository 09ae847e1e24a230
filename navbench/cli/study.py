"""A study: what is missing of it is run, then its report is written."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from navbench.cli.catalogue import CONF, elsewhere, files_of
from navbench.cli.run import DRIVING
from navbench.cli.words import sort_words
from navbench.experiments.engines import start
from navbench.validation import DescriptionError, instead

HELP = """navbench study NAME: run what is missing of a study into outputs/study/NAME, and write results/NAME/report.md
and report.html

  engine=local                                      where to run: `navbench list engine`, and engine.KEY=VALUE
  workers=N                                         processes; default one a core; 0 for none, for a debugger
  reconstruction=best                               as the best reconstruction of its multiverse has it, which is fitted
                                                    to the printed numbers, into results/NAME/best
  simulator=planar                                  every cell in this simulator, into results/NAME/planar
  resume=other-code                                 keep what was run before navbench or a controller was changed
  --overwrite                                       remove finished parts that are there and not of this study any more
  --config-dir DIR                                  a folder with further studies, controllers, worlds and robots

The same command goes on where an earlier one was stopped. `navbench list study` prints the studies.
"""
REPORTING = ("pandas", "navbench.report.sections", "matplotlib.figure")  # imported by processes that build a report


def study(arguments: Sequence[str]) -> int:
    """Run what is missing of a study, and write its report."""
    words = sort_words(arguments, ("--config-dir", "--overwrite"))
    known = files_of("study", [CONF, *([Path(words.config_dir)] if words.config_dir else [])])
    if len(words.names) != 1 or words.names[0] not in known:
        given = " ".join(["study", *words.names])
        which = elsewhere("study", given[6:]) or instead(given[6:], known, "there are")
        raise DescriptionError(f"{given}: name one study; {which}")
    asked, others = _otherwise(words.overrides, words.config_dir)
    if "workers=0" not in others:
        start([*DRIVING, *REPORTING])  # while this process imports and composes
    from navbench.cli.engine import where
    from navbench.cli.flow import carry_out
    from navbench.cli.rebuilding import fitted, in_simulator
    from navbench.cli.report import print_written
    from navbench.cli.study_configuration import compose_study
    from navbench.experiments.engines import in_processes
    from navbench.experiments.store import Results
    from navbench.report.reports import write_report

    name, chosen = words.names[0], where(others, words.config_dir, "study", ("simulator", "reconstruction", "resume"))
    out = Path("results", name, *asked.values())

    def finish(results: Results) -> int:
        each = partial(in_processes, workers=chosen["workers"])
        return print_written(write_report([results], out, each, trust=True))

    plan, path = compose_study(name, words.config_dir), Path("outputs/study") / "-".join([name, *asked.values()])
    if "reconstruction" in asked:
        plan = fitted(plan, Path("results") / name / "multiverse" / "best.json", words.config_dir)
    if "simulator" in asked:
        title = f"{(plan.study or {})['title']}, every cell in {asked['simulator']}"
        cells = tuple(in_simulator(plan.cells, asked["simulator"], words.config_dir))
        plan = replace(plan, cells=cells, study={**(plan.study or {}), "title": title})
    return carry_out(plan, path, ["study", *arguments], finish, **words.kept, **chosen)


def _otherwise(words: Sequence[str], config_dir: str | None) -> tuple[dict[str, str], list[str]]:
    """Return what words ask of all cells of a study, and the other words.

    Raises:
        DescriptionError: there is no such reconstruction or simulator.
    """
    asked, others = {}, []
    for word in words:
        key, _, value = word.partition("=")
        if key == "reconstruction":
            known: Sequence[str] = ["best"]
        elif key == "simulator":
            known = list(files_of("simulator", [CONF, *([Path(config_dir)] if config_dir else [])]))
        else:
            others.append(word)
            continue
        if value not in known:
            raise DescriptionError(f"{word}: {instead(value, known)}")
        asked[key] = value
    return asked, others
