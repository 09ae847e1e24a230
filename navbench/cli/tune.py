"""A tuning: every evaluation is kept, the controller is run untuned and tuned, and the tuned one gets a file."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navbench.cli.catalogue import CONF
from navbench.cli.progress import tell
from navbench.cli.run import DRIVING
from navbench.cli.words import sort_words
from navbench.experiments.engines import start
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    from navbench.experiments.store import Results
    from navbench.experiments.tunings import Tuning

HELP = """navbench tune controller=NAME tuner=NAME [...]: search a controller's parameters for the least cost

  tuner= objective=                                 how to search, and for what: `navbench list tuner objective`
  budget=N                                          how many evaluations
  world= worlds=[...]                               where, and in which further worlds
  simulator=planar verify=NAME                      where it searches, and where the best is run again (null: nowhere)
  name=WORD                                         what to call the tuned controller; default TUNER_CONTROLLER
  +controller.tunable.KEY={low: X, high: X, scale: linear}
                                                    search one more parameter of the controller, within bounds
  resume=other-code                                 keep what was run before navbench or the controller was changed
  --overwrite                                       remove finished parts that are there and not of this tuning
  --cfg job                                         print the composed configuration and run nothing

and the keys of a run (`navbench --help`): episodes, seed, start_jitter_m, workers, engine, hydra.run.dir, ...
The same command with the same hydra.run.dir goes on where an earlier one was stopped, after its last generation.
"""
SHOWN_MAX = 20  # parameters; of more, a screen shows no better than the file


def tune(arguments: Sequence[str]) -> int:
    """Search a controller's parameters, keep every evaluation, and write the tuned controller's file."""
    words = sort_words(arguments, ("--config-dir", "--cfg", "--overwrite"))
    if words.names:
        raise DescriptionError(f"{words.names[0]}: unknown word; tune takes key=value, such as tuner=pso")
    if not words.cfg and "workers=0" not in words.overrides:
        start(DRIVING)  # while this process imports and composes
    from navbench.cli.composing import composing, key_of
    from navbench.cli.flow import carry_out
    from navbench.cli.study_configuration import compose_tuning
    from navbench.cli.tables import print_tables
    from navbench.cli.tuned import write_controller
    from navbench.experiments.plan import Plan
    from navbench.experiments.running import best_of
    from navbench.report.figures import save_convergence

    if words.cfg:
        with composing(words.config_dir) as composer:
            print(composer.text("tune", words.overrides), end="")
        return 0
    if "controller" not in map(key_of, words.overrides):
        raise DescriptionError("tune: name a controller, such as controller=pid")
    tuning, path, where = compose_tuning(words.overrides, words.config_dir)

    def finish(results: "Results") -> None:
        save_convergence(results, path / "convergence.png")
        index, cost, best = best_of(results, tuning)
        file = write_controller(tuning, best, path, words.overrides)
        print_tables(results)
        print(f"cost {cost:.6g} at evaluation {index} of {tuning.budget}:")
        print(_changes(tuning, best))
        for check in results.checks().to_dict("records"):
            told = f"{check['kind']} ({check['simulator']})"
            print(f"  {told:<22} cost {check['cost']:<10.6g} {check['reached']} of {check['robots']} reached")
        tell(f"controller: {file}; {_use(file, tuning.cells[0].names.controller, words.config_dir)}")

    untuned = [replace(cell, name="tune", label=f"untuned {cell.names.controller}") for cell in tuning.cells]
    tuned = [replace(c, label=tuning.name, tuning=tuning.name, tuning_seed=tuning.seed) for c in untuned]
    content = {
        "name": f"tune {tuning.name}",
        "title": f"{tuning.name} tuned",
        "summary": "",
        "claims": {},
        "report": [],
    }
    plan = Plan(cells=(*untuned, *tuned), tunings=(tuning,), study=content)
    again = ["tune", *arguments, *words.place("hydra.run.dir", path)]
    return carry_out(plan, path, again, finish, **where, **words.kept)


def _use(file: Path, inherited: str, config_dir: str | None) -> str:
    """Return how to use a tuned controller's file, which needs the one that it inherits from beside it."""
    beside = Path(config_dir or CONF) / "controller" / f"{inherited}.yaml"
    if config_dir and beside.is_file():
        return f"copy it beside {beside}, and use it with --config-dir {config_dir} controller={file.stem}"
    return f"use it with --config-dir {file.parents[1]} controller={file.stem}"


def _changes(tuning: "Tuning", best: dict[str, Any]) -> str:
    """Return the best parameters, a line each, or where they are many, how many of them the search changed."""
    if len(best) <= SHOWN_MAX:
        return "\n".join(f"  {name}: {v:.6g}" if isinstance(v, float) else f"  {name}: {v}" for name, v in best.items())
    changed = sum(side.start is None or best[side.name] != side.parameter(side.start) for side in tuning.dimensions)
    return f"  {changed} of {len(best)} parameters changed"
