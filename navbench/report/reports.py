"""Reports of stored results: what a study found beside what its paper prints, or what some runs did; runs nothing."""

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from navbench.analysis.stored import StoredResults
from navbench.experiments.store import Results, ResultsError, write_table
from navbench.report.figures import draw_cell, new_figure, save_figure
from navbench.report.markup import markdown
from navbench.report.sections import check_section, write_section
from navbench.report.tables import failures, summarize, to_markdown
from navbench.validation import DescriptionError

Each = Callable[[Callable[[Mapping[str, Any]], str], Sequence[Mapping[str, Any]]], Iterable[str]]

PANELS = 12  # a figure of more cells cannot be read
NAMED = ("run_id", "config_hash", "name", "label", "tuning", "tuning_seed")
WHERE = ("controller", "world", "robot", "sensors", "simulator", "episodes", "seed")
TUNED = ("tuning_id", "config_hash", "name", "tuner", "objective", "controller", "worlds", "seed", "budget")


def write_report(runs: Sequence[Results], out: Path, each: Each = map) -> list[Path]:
    """Write a report of some results directories, and return the files that it consists of.

    A study that says what its report holds gets that report: ``report.md``, ``claims.csv``, ``tables/``, ``figures/``
    and a small ``manifest.json``. Runs, sweeps and other studies get one report together. Where there are several
    reports, each stands in a folder of its study's name, and ``report.md`` links to them.

    Args:
        runs: the results directories.
        out: the report's directory.
        each: writes the sections of a study's report, which do not hang on each other: ``map``, or what does the same
            in several processes.

    Raises:
        DescriptionError: there are no results, or a study asks for what they do not hold.
    """
    all_stored = [StoredResults(results) for results in runs]
    studies = {r.manifest["study"]["name"]: r for r in all_stored if (r.manifest["study"] or {}).get("report")}
    others = [stored for stored in all_stored if stored not in studies.values()]
    if len(studies) == 1 and not others:
        return _finish(out, _study(next(iter(studies.values())), out, each))
    text, files = "", []
    for name, stored in studies.items():
        files += _finish(out / name, _study(stored, out / name, each))
        text += f"- [{stored.manifest['study']['title']}]({name}/report.md)\n"
    if others:
        text = f"{_runs(others, out)}\n{text}"
    else:
        text = f"# Reports\n\n{text}"
    return [*_finish(out, text), *files]


def _study(stored: StoredResults, out: Path, each: Each) -> str:
    """Write the sections of a study's report, and return it in Markdown."""
    study = stored.manifest["study"]
    for i, spec in enumerate(study["report"]):
        check_section(f"report[{i}]", spec)
    parts = [f"# {study['title']}\n"]
    if study.get("summary"):
        parts.append(study["summary"].strip() + "\n")
    parts += each(partial(write_section, stored, out), study["report"])
    parts.append(_making(stored.manifest))
    write_table(out / "manifest.json", json.dumps(_small(stored.manifest), indent=1) + "\n")
    return "\n".join(parts)


def _making(manifest: Mapping[str, Any]) -> str:
    """Return how a study's results were made."""
    name = manifest["study"]["name"]
    cells, tunings = manifest["cells"], manifest["tunings"]
    episodes = sum({cell["run_id"]: cell["episodes"] for cell in cells}.values())
    seeds = sorted({cell["seed"] for cell in cells})
    lines = [f"`navbench study {name}` runs it all and writes this report; `navbench report outputs/study/{name}` "]
    lines += ["writes the report again from stored results, and runs nothing. Measured: "]
    lines += [f"{episodes} episodes in {len({cell['run_id'] for cell in cells})} cells, seed {_words(seeds)}"]
    if tunings:
        evaluations = sum(tuning["budget"] for tuning in tunings)
        tuning_seeds = sorted({tuning["seed"] for tuning in tunings})
        lines += [f", and {evaluations} evaluations in {len(tunings)} tunings, seeds {_words(tuning_seeds)}"]
    versions = {"Python": manifest["python"], **manifest["versions"]}
    table = markdown(["", "version"], [[name, version] for name, version in versions.items()])
    return f"## How it was made\n\n{''.join(lines)}, on {manifest['platform']}. [Manifest](manifest.json)\n\n{table}"


def _words(numbers: Sequence[int]) -> str:
    if len(numbers) > 2 and numbers == list(range(numbers[0], numbers[-1] + 1)):
        return f"{numbers[0]} to {numbers[-1]}"
    return ", ".join(map(str, numbers))


def _small(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return a manifest without configurations (their hashes stay) and without times, and of the report the errata."""
    study = manifest["study"]
    errata = [item for section in study["report"] if section["name"] == "errata" for item in section["items"]]
    kept = {key: value for key, value in manifest.items() if key not in ("study", "began", "ended")}
    return {
        **kept,
        "study": {"name": study["name"], "title": study["title"], "summary": study["summary"] or "", "errata": errata},
        "cells": [{key: cell[key] for key in (*NAMED, *WHERE)} for cell in manifest["cells"]],
        "tunings": [{key: tuning[key] for key in TUNED} for tuning in manifest["tunings"]],
    }


def _runs(all_stored: Sequence[StoredResults], out: Path) -> str:
    """Write the tables and figures of runs without a study's report, and return the report in Markdown."""
    import pandas as pd

    episodes = pd.concat([stored.results.episodes() for stored in all_stored], ignore_index=True)
    episodes = episodes.drop_duplicates(["run_id", "episode", "robot_index"], ignore_index=True)
    summary = summarize(episodes)
    write_table(out / "tables" / "summary.csv", summary.to_csv(index=False))
    parts = [f"# Results of {len(summary)} cells\n" if len(summary) != 1 else "# Results of one cell\n"]
    parts.append("A row a cell; means are over the robots that reached, and over no others.\n")
    parts.append(to_markdown(summary) + "\n[CSV](tables/summary.csv)\n")
    failed = failures(episodes, at_most=20)
    if failed:
        parts.append("## Failures\n\n" + "".join(f"- {line}\n" for line in failed))
    parts += _trajectories(all_stored, out)
    return "\n".join(parts)


def _trajectories(all_stored: Sequence[StoredResults], out: Path) -> list[str]:
    """Return the figures of trajectories, a panel a cell of which they are kept."""
    panels = []
    for stored in all_stored:
        for run_id in dict.fromkeys(cell["run_id"] for cell in stored.manifest["cells"]):
            episodes = stored.results.episodes()
            try:
                stored.trajectories(run_id)
            except ResultsError:  # a cell that keeps none
                continue
            panels.append((stored, stored.configuration(run_id), episodes[episodes["run_id"] == run_id]))
    parts = []
    for page in range(0, len(panels), PANELS):
        shown = panels[page : page + PANELS]
        columns = min(3, len(shown))
        figure, axes = new_figure(-(-len(shown) // columns), columns, 5.2, 5.4)
        for ax in axes.ravel()[len(shown) :]:
            ax.set_axis_off()
        for ax, (stored, cell, episodes) in zip(axes.ravel(), shown, strict=False):
            draw_cell(ax, cell, episodes, stored.trajectories(cell["run_id"]))
        parts.append(save_figure(figure, out, f"trajectories_{page // PANELS + 1}", "Trajectories, a panel a cell."))
    return ["## Trajectories\n", *parts] if parts else []


def _finish(out: Path, text: str) -> list[Path]:
    """Write a report and return its files: those that it links to below its directory, and itself."""
    write_table(out / "report.md", text)
    linked = dict.fromkeys(re.findall(r"\]\(((?:tables/|figures/)?[\w.-]+)\)", text))
    missing = [name for name in linked if not (out / name).is_file()]
    if missing:
        raise DescriptionError(f"{out / 'report.md'}: links to what is not there: {', '.join(missing)}")
    return [out / "report.md", *(out / name for name in linked)]
