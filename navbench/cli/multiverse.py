"""A study's multiverse: its claims in many reconstructions of what its paper leaves open."""

import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navbench.cli.catalogue import CONF, files_of
from navbench.cli.limits import check_directory
from navbench.cli.words import sort_words
from navbench.validation import DescriptionError, instead

if TYPE_CHECKING:
    from navbench.analysis.shares import Drawn
    from navbench.cli.reconstructions import Reconstructions
    from navbench.experiments.samples import Samples

HELP = """navbench multiverse STUDY: ask its claims in many reconstructions of what its paper leaves open

  n=16384                                           how many reconstructions are drawn
  decide=1024                                       in how many each factor is moved alone, to see what decides
  search=320                                        evaluations of each search for where printed numbers hold together
  seed=0                                            of all draws
  engine=local                                      where to run: `navbench list engine`, and engine.KEY=VALUE
  workers=N                                         processes; default one a core; 0 for none, for a debugger
  prior=NAME                                        another prior, which the study names; in a folder of its own
  tuned=DIR                                         the study's results, for what its tunings found
  out=DIR                                           where the reconstructions are kept; default outputs/multiverse/STUDY
  resume=other-code                                 go on with what was run before navbench or a controller was changed
  --config-dir DIR                                  a folder with further studies, controllers, worlds and robots

The prior is written before the first reconstruction; the same command goes on where an earlier one was stopped, also
with more of them. What is found is written into results/STUDY/multiverse.
"""
NUMBERS = {"n": 16384, "decide": 1024, "search": 320, "seed": 0}
MOST = 2**20  # reconstructions, or evaluations
TEXTS = ("prior", "tuned", "out")
KEYS = (*NUMBERS, *TEXTS, "engine", "workers", "resume")


def multiverse(arguments: Sequence[str]) -> int:
    """Run the reconstructions that are missing, and write what they say."""
    words = sort_words(arguments)
    known = files_of("study", [CONF, *([Path(words.config_dir)] if words.config_dir else [])])
    if len(words.names) != 1 or words.names[0] not in known:
        given = " ".join(["multiverse", *words.names])
        raise DescriptionError(f"{given}: name one study; {instead(given[11:], known, 'there are')}")
    name = words.names[0]
    placed = [word for word in words.overrides if re.match(r"(engine|workers)\b", word)]
    options = _options([word for word in words.overrides if word not in placed])
    from navbench.analysis.shares import undecided
    from navbench.cli.engine import where
    from navbench.cli.errors import one_line
    from navbench.cli.flow import INTERRUPTED
    from navbench.cli.prior import prior_of, reconstructions_of
    from navbench.cli.progress import UNFINISHED, complain, progress, tell
    from navbench.cli.reconstructions import Reconstructions
    from navbench.cli.sampling import BLOCKS, Block, drawn_blocks, moved_blocks
    from navbench.experiments.engines import in_processes, run
    from navbench.experiments.files import locked
    from navbench.experiments.samples import MOVED, PRIOR, Samples
    from navbench.experiments.workers import MachineError

    chosen = where(placed, words.config_dir, "multiverse")
    if options["tuned"]:
        check_directory(f"tuned={options['tuned']}", Path(options["tuned"]))
    tuned = Path(options["tuned"] or f"outputs/study/{name}")
    inner = [options["prior"]] if options["prior"] else []
    samples = Samples(Path(options["out"] or "-".join([f"outputs/multiverse/{name}", *inner])))
    of = reconstructions_of(name, tuned, words.config_dir, prior=options["prior"])
    (unmeasured,) = in_processes(Reconstructions.unmeasured, [of], chosen["workers"], attrgetter("foreign"))
    for claim, why in unmeasured.items():
        complain(f"{claim}: has no case in the study's own reconstruction; {why}")
    total, done = options["n"] + options["decide"], 0

    def run_missing(blocks: Sequence[Block]) -> None:
        nonlocal done
        todo = [block for block in blocks if not samples.has(block.name, block.claims)]
        done += sum(block.size for block in blocks) - sum(block.size for block in todo)
        for index, columns in run(BLOCKS, todo, **chosen):
            samples.write(todo[index].name, columns)
            done += todo[index].size
            told("reconstructions", done, total)

    try:
        with locked(samples.path), progress() as told:
            samples.begin(prior_of(of, options["seed"], options["prior"]), other_code=words.other_code)
            for file in samples.discard_damaged():
                complain(f"{file}: damaged, and made anew")
            run_missing(drawn_blocks(of, options["seed"], options["n"]))
            drawn = _drawn(of, samples)
            asked = undecided(drawn, of.claims, of.multiverse)
            run_missing(moved_blocks(of, options["seed"], options["decide"], asked))
            drawn = drawn._replace(moved=samples.even(MOVED, asked))
            files = _finish(of, samples, drawn, inner, options["search"], chosen["workers"], told)
    except (KeyboardInterrupt, OSError, MachineError, MemoryError) as error:  # of a full disk, say
        if isinstance(error, OSError) and not (samples.path / PRIOR).is_file():  # nothing was begun
            raise
        interrupted, again = isinstance(error, KeyboardInterrupt), shlex.join(["navbench", "multiverse", *arguments])
        said = "interrupted" if interrupted else f"{one_line(error)}:"
        complain(
            f"{said} after {done} of {total} reconstructions; they are kept in {samples.path}, and this goes on from "
            f"there: {again}"
        )
        return INTERRUPTED if interrupted else UNFINISHED
    tell(f"report: {files[0]} ({len(files)} files)")
    return 0


def _drawn(of: "Reconstructions", samples: "Samples") -> "Drawn":
    """Return the sample that is there."""
    import pandas as pd

    from navbench.analysis.shares import Drawn
    from navbench.cli.sampling import places
    from navbench.experiments.samples import DRAWN

    rows = samples.even(DRAWN)
    if rows.empty:
        raise DescriptionError(f"{samples.path}: not every scramble has a reconstruction yet")
    u = places(samples.prior()["seed"], len(of.names), rows)
    return Drawn(rows, u, of.names, of.reaches, pd.DataFrame())


def _finish(
    of: "Reconstructions",
    samples: "Samples",
    drawn: "Drawn",
    inner: Sequence[str],
    budget: int,
    workers: int | None,
    progress: Callable[[str, int, int], None],
) -> list[Path]:
    """Write what the reconstructions say, of another prior into an inner folder, and return the files of the report."""
    from navbench.analysis.fitting import fit, in_sample
    from navbench.cli.searching import STARTS, Evaluation, Searches, told_at
    from navbench.experiments.engines import in_processes
    from navbench.report.joined import read_claims
    from navbench.report.multiverse import write_multiverse
    from navbench.report.multiverse_results import MultiverseResults, Search

    prior, name = samples.prior(), str(of.study["name"])
    searches = Searches(of, drawn, samples, seed=prior["seed"], evaluations=budget, workers=workers, told=progress)
    best = fit(searches.claims, searches.meet if budget and searches.free else in_sample(drawn))
    out = Path("results") / name
    claims = read_claims(out / "claims.csv")
    here, measured = (dict(zip(claims["id"], claims[column], strict=True)) for column in ("verdict", "measured"))
    at_best: dict[str, tuple[int, float]] = {}
    starts = STARTS if budget else of.episodes[-1]
    if best is not None:
        judged = replace(of, episodes=(starts,), places={}, offered={})
        (found,) = in_processes(told_at, [Evaluation(judged, best.u)], workers, attrgetter("of.foreign"))
        at_best = dict(zip((entry.name for entry in of.claims), zip(*found, strict=True), strict=True))
    told = MultiverseResults(
        name, of.study["title"], drawn, of.claims, of.multiverse, of.factors, here, measured, prior,
        best, at_best, Search(budget, len(searches.free), starts),
    )  # fmt: skip
    samples.publish(drawn.rows, out.joinpath("multiverse", *inner))
    files = write_multiverse(told, out.joinpath("multiverse", *inner))
    return files


def _options(overrides: Sequence[str]) -> dict[str, Any]:
    from navbench.cli.configuration import SEED_MAX
    from navbench.cli.sampling import BLOCK, SCRAMBLES
    from navbench.cli.searching import POPULATION

    options: dict[str, Any] = {**NUMBERS, **dict.fromkeys(TEXTS)}
    for word in overrides:
        key, _, value = word.partition("=")
        if key not in KEYS:
            raise DescriptionError(f"{word}: unknown key; {instead(key, KEYS, 'allowed with a multiverse')}")
        if key in TEXTS:
            options[key] = value
            continue
        most = SEED_MAX if key == "seed" else MOST
        if not re.fullmatch("[0-9]{1,19}", value) or int(value) > most:
            raise DescriptionError(f"{word}: must be a whole number from 0 to {most}")
        options[key] = int(value)
    for key, size, why in (
        ("n", SCRAMBLES * BLOCK, f"so that each of the {SCRAMBLES} samples has as many"),
        ("decide", SCRAMBLES, f"so that each of the {SCRAMBLES} samples has as many"),
        ("search", POPULATION, "so that generations are whole"),
    ):
        if options[key] % size:
            raise DescriptionError(f"{key}={options[key]}: must be a multiple of {size}, {why}")
    return options
