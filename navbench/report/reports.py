"""Reports of stored results: what a study found beside what its paper prints, or what some runs did; runs nothing."""

import json
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from navbench.analysis.claims import check_claims, entries
from navbench.analysis.resolving import lies_outside
from navbench.analysis.stored import StoredResults
from navbench.experiments.files import inside
from navbench.experiments.store import Results, write_table
from navbench.raised import one_line
from navbench.report import html, markdown
from navbench.report.document import Block, Column, Document, Heading, Link, Paragraph, Table
from navbench.report.page import Page
from navbench.report.playback import BYTES, playback
from navbench.report.runs import Joined, sections_of
from navbench.report.sections import Spec, build_section, check_section, files_of, named

Each = Callable[[Callable[[Spec | str], list[Block]], Sequence[Spec | str]], Iterable[list[Block]]]

PAGE_MAX = 2_000_000  # bytes of a page that plays episodes
NAMED = ("run_id", "config_hash", "name", "label", "tuning", "tuning_seed")
WHERE = ("controller", "world", "robot", "sensors", "simulator", "episodes", "seed")
TUNED = ("tuning_id", "config_hash", "name", "tuner", "objective", "controller", "worlds", "seed", "budget")


class Written(NamedTuple):
    """A report that was written.

    Attributes:
        files: what it consists of.
        problems: why parts of it could not be made, a line each.
    """

    files: list[Path]
    problems: list[str]


def write_report(
    runs: Sequence[Results], out: Path, each: Each = map, trust: bool = False, config_dir: str | None = None
) -> Written:
    """Write a report of some results directories; what of it fails is told in its place, and costs nothing else.

    A study that says what its report holds gets that report: ``report.md``, its page ``report.html``,
    ``findings.json``, ``claims.csv``, ``tables/``, ``figures/`` and a small ``manifest.json``. Runs, sweeps and other
    studies get one report together. Where there are several reports, each stands in a folder of its study's name, and
    ``report.md`` links to them.

    Args:
        runs: the results directories.
        out: the report's directory.
        each: builds the sections of a study's report, which do not depend on each other: ``map``, or what does the
            same in several processes.
        trust: whether sections and measures outside navbench may be run.
        config_dir: the folder with a study that is not navbench's own; None for what the results say.

    Raises:
        DescriptionError: there are no results, a study asks for what they do not hold, or names what is not trusted.
    """
    every = [StoredResults(results) for results in runs]
    studies = {r.manifest["study"]["name"]: r for r in every if (r.manifest["study"] or {}).get("report")}
    others = [stored for stored in every if stored not in studies.values()]
    if len(studies) == 1 and not others:
        return _study(next(iter(studies.values())), out, each, trust, config_dir)
    told = [_study(stored, out / name, each, trust, config_dir) for name, stored in studies.items()]
    links = [Link(stored.manifest["study"]["title"], f"{name}/report.md") for name, stored in studies.items()]
    joined = StoredResults(Joined([stored.results for stored in others])) if others else None
    document = _runs(joined, out) if joined else Document("Reports", [])
    own = _written(Document(document.title, [*document.blocks, *links]), out, joined, trust)
    every_file = dict.fromkeys(file for written in (own, *told) for file in written.files)
    return Written(list(every_file), [problem for written in (own, *told) for problem in written.problems])


def _study(stored: StoredResults, out: Path, each: Each, trust: bool, config_dir: str | None) -> Written:
    """Write a study's report."""
    study, manifest = stored.manifest["study"], stored.manifest
    check_claims("", study, trust, stored=True)
    for i, spec in enumerate(study["report"]):
        check_section(f"report[{i}]", spec, trust)
    page = Page(stored, out, trust=trust)
    blocks = [block for built in each(partial(build_section, page), study["report"]) for block in built]
    errata = [item for spec in map(named, study["report"]) if spec["name"] == "errata" for item in spec["items"]]
    further = "multiverse/report.md"
    more = [Link("In how many reconstructions its claims hold", further)] if (out / further).is_file() else []
    document = Document(
        study["title"], [*more, *blocks, *_making(stored, config_dir)], study.get("summary") or "", errata
    )
    write_table(out / "manifest.json", json.dumps(_small(manifest), indent=1) + "\n")
    findings = json.dumps(document.findings(), indent=1, ensure_ascii=False) + "\n"
    write_table(out / "findings.json", findings)
    written = _written(document, out, stored, trust)
    return Written([*written.files, out / "findings.json"], written.problems)


def _runs(stored: StoredResults, out: Path) -> Document:
    """Return the report of runs without a study's report."""
    page = Page(stored, out)
    blocks = [block for spec in sections_of(stored) for block in build_section(page, spec)]
    count = len(stored.manifest["cells"])
    return Document(f"Results of {count} cells" if count != 1 else "Results of one cell", blocks)


def _written(document: Document, out: Path, stored: StoredResults | None, trust: bool) -> Written:
    """Write a report and, of the results that it is of, its page."""
    files, problems = write_document(document, out), document.problems
    page = html.render(document, out)
    try:
        if stored is not None:
            for budget in (BYTES, BYTES // 2, BYTES // 4):  # with many pictures there is room for fewer episodes
                page = html.render(document, out, playback(stored, trust, budget))
                if len(page.encode()) <= PAGE_MAX:
                    break
    except Exception as error:  # of results from anybody
        problems = [*problems, f"report.html plays no episodes: {one_line(error)}"]
    write_table(out / "report.html", page)
    return Written([files[0], out / "report.html", *files[1:]], problems)


def write_document(document: Document, out: Path) -> list[Path]:
    """Write a report and its tables, and return its files; the plots are there."""
    for block in document.blocks:
        for name, text in files_of(block).items():
            write_table(inside(out, name), text)
    write_table(out / "report.md", markdown.render(document))
    return [out / "report.md", *(out / name for name in document.files)]


def _making(stored: StoredResults, config_dir: str | None) -> list[Block]:
    """Return how a study's results were made."""
    manifest = stored.manifest
    study = manifest["study"]
    name, folder = study["name"], config_dir or study.get("config_dir")
    own = f" --config-dir {shlex.quote(folder)}" if folder else ""
    trust = " --trust" if any(map(lies_outside, _named(study))) else ""
    cells, tunings = manifest["cells"], manifest["tunings"]
    episodes = len(stored.rows[["run_id", "episode"]].drop_duplicates())
    seeds = _words(sorted({cell["seed"] for cell in cells}))
    tuned = ""
    if tunings:
        evaluations = sum(tuning["budget"] for tuning in tunings)
        tuning_seeds = _words(sorted({tuning["seed"] for tuning in tunings}))
        tuned = f", and {evaluations} evaluations in {len(tunings)} tunings, seeds {tuning_seeds}"
    text = (
        f"`navbench study {name}{own}` runs it all and writes this report; "
        f"`navbench report outputs/study/{name}{trust}` writes the report again from stored results, and runs nothing. "
        f"Measured: {episodes} episodes in {len({cell['run_id'] for cell in cells})} cells, seed {seeds}{tuned}, "
        f"on {manifest['platform']}."
    )
    versions = {"Python": manifest["python"], **manifest["versions"]}
    table = Table("", [Column(""), Column("version")], [list(pair) for pair in versions.items()])
    told = map(Paragraph, [text, *stored.missing])
    return [Heading("How it was made"), *told, Link("Manifest", "manifest.json"), table]


def _named(study: Mapping[str, Any]) -> list[str]:
    """Return what a study names that is run for its report: sections, measures of claims, measures in findings."""
    sections = list(map(named, study["report"]))
    claims = [entry.claim for entry in entries("", study, stored=True)]
    sentences = [sentence for section in sections for sentence in section.get("sentences", ())]
    specs = [*sections, *(spec for sentence in sentences for spec in sentence.get("with", {}).values())]
    return [*(claim.measure or "" for claim in claims), *(spec.get("name", "") for spec in specs)]


def _words(numbers: Sequence[int]) -> str:
    if len(numbers) > 2 and numbers == list(range(numbers[0], numbers[-1] + 1)):
        return f"{numbers[0]} to {numbers[-1]}"
    return ", ".join(map(str, numbers))


def _small(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return a manifest without configurations (their hashes stay), times, claims and the report's outline.

    Of the code of parts there is only what is not that of the last run.
    """
    kept = {key: value for key, value in manifest.items() if key not in ("study", "began", "ended", "checksums")}
    codes = {name: of for name, of in manifest.get("codes", {}).items() if not of.items() <= manifest["code"].items()}
    return {
        **kept,
        **({"codes": codes} if "codes" in kept else {}),
        "study": {key: manifest["study"][key] for key in ("name", "title")},
        "cells": [{key: cell[key] for key in (*NAMED, *WHERE)} for cell in manifest["cells"]],
        "tunings": [{key: tuning[key] for key in TUNED} for tuning in manifest["tunings"]],
    }
