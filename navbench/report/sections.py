"""The sections that a report's outline may name by one word; others it names by their dotted names."""

import inspect
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeAlias

from navbench.analysis.resolving import check_arguments, resolve
from navbench.report import (
    claims,
    comparison,
    convergence,
    crossing,
    described,
    outcomes,
    provenance,
    tables,
    trajectories,
    wheels,
)
from navbench.report.document import Block, Heading, Paragraph
from navbench.report.page import Page, Section
from navbench.validation import DescriptionError, instead

Spec: TypeAlias = Mapping[str, Any]
SECTIONS: Mapping[str, Section] = {
    "findings": claims.findings,
    "verdicts": claims.verdicts,
    "printed_table": claims.printed_table,
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
    name = str(spec.get("name"))
    if "." not in name and name not in SECTIONS:
        raise DescriptionError(
            f"{key}.name={name}: there is no such section; {instead(name, SECTIONS)}, or module.function"
        )
    section = SECTIONS.get(name) or resolve(f"{key}.name", name, "", trust=trust)
    _, *parameters = inspect.signature(section).parameters.values()
    check_arguments(f"{key}.", name, parameters, [word for word in spec if word != "name"], COMMON)
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
    return [Heading(title), *text, *section(here, **arguments)]
