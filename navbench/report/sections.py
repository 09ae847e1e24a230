"""The sections that a report's outline may name by one word; others it names by their dotted names."""

import inspect
import reprlib
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from typing import Any, TypeAlias, get_args

from navbench.analysis.resolving import check_arguments, resolve
from navbench.raised import first_line, one_line
from navbench.reading import check_name
from navbench.report import (
    claims,
    comparison,
    convergence,
    crossing,
    described,
    latex,
    markdown,
    outcomes,
    provenance,
    tables,
    trajectories,
    wheels,
)
from navbench.report.claims import check_sentences, findings
from navbench.report.document import Block, Blocks, Document, Heading, Paragraph, Problem, Table
from navbench.report.page import Page, Section
from navbench.validation import DescriptionError, instead

Spec: TypeAlias = Mapping[str, Any]
SECTIONS: Mapping[str, Section] = {
    "findings": claims.findings,
    "verdicts": claims.verdicts,
    "printed_table": claims.printed_table,
    "printed_beside": claims.printed_beside,
    "summary": tables.summary,
    "comparison": comparison.comparison,
    "failures": tables.failed,
    "metrics": tables.metrics,
    "outcomes_table": outcomes.outcomes_table,
    "fleet_table": outcomes.fleet_table,
    "robustness": outcomes.robustness,
    "trajectories": trajectories.trajectories,
    "frames": trajectories.frames,
    "time_series": trajectories.time_series,
    "wheel_velocities": wheels.wheel_velocities,
    "memberships": described.memberships,
    "rules": described.rules,
    "rule_grid": described.rule_grid,
    "tuners_compared": convergence.tuners_compared,
    "success_map": crossing.success_map,
    "crossed_tables": crossing.crossed_tables,
    "sources": provenance.sources,
    "errata": claims.errata,
}
COMMON = ("title", "text", "file", "caption")


def named(spec: Spec | str) -> Spec:
    """Return a section's entry in an outline in full; a name alone takes no arguments."""
    return {"name": spec} if isinstance(spec, str) else spec


def check_section(key: str, spec: Spec | str, trust: bool = False) -> Section:
    """Return a section's function, and check that it takes these arguments.

    Raises:
        DescriptionError: there is no such section, or it does not; the message names what is allowed.
    """
    spec = named(spec)
    if "name" not in spec:
        raise DescriptionError(f"{key}.name: missing; a section is named, such as {{name: summary}}")
    name = str(spec["name"])
    if "." not in name and name not in SECTIONS:
        raise DescriptionError(
            f"{key}.name={name}: there is no such section; {instead(name, SECTIONS)}, or module.function"
        )
    section = SECTIONS.get(name) or resolve(f"{key}.name", name, "", trust=trust)
    _, *parameters = inspect.signature(section).parameters.values()
    check_arguments(f"{key}.", name, parameters, [word for word in spec if word != "name"], COMMON)
    if "file" in spec:
        try:
            check_name(str(spec["file"]))
        except DescriptionError as error:
            raise DescriptionError(f"{key}.file={error}") from None
    if section is findings:
        check_sentences(f"{key}.sentences", spec["sentences"], trust)
    return section


def build_section(page: Page, spec: Spec | str) -> list[Block]:
    """Return what a section consists of, under its heading.

    Args:
        spec: the section's entry in the outline.
    """
    spec = named(spec)
    section = check_section("report", spec, page.trust)
    name = str(spec["name"]).rpartition(".")[2]
    arguments = {key: value for key, value in spec.items() if key not in ("name", *COMMON)}
    title = spec.get("title") or name.replace("_", " ").capitalize()
    text = [Paragraph(spec["text"])] if spec.get("text") else []
    here = replace(page, file=spec.get("file", name), caption=spec.get("caption") or title)
    with page.stored.noting() as used:
        blocks = _built(section, here, arguments, str(spec["name"]))
    return [Heading(title), *text, *_simulators(used.simulators), *blocks]


def _simulators(found: Mapping[str, Set[str]]) -> list[Block]:
    """Return the line that says which simulator made a section's numbers, of which cells where there are several."""
    told = [f"{one} ({', '.join(sorted(of))})" if len(found) > 1 else one for one, of in sorted(found.items())]
    return [Paragraph(f"Simulator: {'; '.join(told)}.")] if told else []


def _built(section: Section, page: Page, arguments: Mapping[str, Any], name: str) -> Blocks:
    """Return what a section returns, or where it fails, why: a user's own may raise anything, or return anything."""
    try:
        blocks = section(page, **arguments)
        if isinstance(blocks, Sequence) and all(isinstance(block, get_args(Block)) for block in blocks):
            markdown.render(Document("", blocks))
            for block in blocks:
                files_of(block)
            return blocks
        returned = f"must return a list of what stands in navbench.report.document; it returned {reprlib.repr(blocks)}"
        return [Problem(f"section {name}: {returned}{first_line(section)}")]
    except Exception as error:
        return [Problem(f"section {name}: {one_line(error)}")]


def files_of(block: Block) -> dict[str, str]:
    """Return what the files of a table hold, by their names; of all else nothing."""
    import pandas as pd

    if not (isinstance(block, Table) and block.file):
        return {}
    raw = block.raw
    csv = pd.DataFrame(raw.rows, columns=list(raw.names)).to_csv(index=False)
    return {block.files["CSV"]: csv, block.files["LaTeX"]: latex.render(block)}
