"""The sections that a report's outline may name by one word; others it names by their dotted names."""

import inspect
from collections.abc import Mapping, Set
from dataclasses import replace
from difflib import get_close_matches
from typing import Any, TypeAlias

from navbench.analysis.resolving import resolve
from navbench.report.claims import errata, findings, printed_table, verdicts
from navbench.report.comparison import comparison
from navbench.report.convergence import tuners_compared
from navbench.report.crossing import crossed_tables, success_map
from navbench.report.described import memberships, rules
from navbench.report.document import Block, Heading, Paragraph
from navbench.report.outcomes import fleet_table, outcomes_table, robustness
from navbench.report.page import Page, Section
from navbench.report.provenance import sources
from navbench.report.tables import failed, metrics, summary
from navbench.report.trajectories import frames, time_series, trajectories
from navbench.report.wheels import wheel_velocities
from navbench.validation import DescriptionError

Spec: TypeAlias = Mapping[str, Any]
SECTIONS: Mapping[str, Section] = {
    "findings": findings,
    "verdicts": verdicts,
    "printed_table": printed_table,
    "summary": summary,
    "comparison": comparison,
    "failures": failed,
    "metrics": metrics,
    "outcomes_table": outcomes_table,
    "fleet_table": fleet_table,
    "robustness": robustness,
    "trajectories": trajectories,
    "frames": frames,
    "time_series": time_series,
    "wheel_velocities": wheel_velocities,
    "memberships": memberships,
    "rules": rules,
    "tuners_compared": tuners_compared,
    "success_map": success_map,
    "crossed_tables": crossed_tables,
    "sources": sources,
    "errata": errata,
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
        near = get_close_matches(name, SECTIONS, 1)
        hint = f"did you mean {near[0]}?" if near else f"allowed: {', '.join(SECTIONS)}, or module.function"
        raise DescriptionError(f"{key}.name={name}: there is no such section; {hint}")
    section = SECTIONS.get(name) or resolve(f"{key}.name", name, "", trust=trust)
    parameters = dict(list(inspect.signature(section).parameters.items())[1:])
    allowed = ", ".join((*COMMON, *parameters))
    for given in spec:
        if given not in ("name", *COMMON, *parameters):
            raise DescriptionError(f"{key}.{given}: unknown key; {name} takes {allowed}")
    for needed, parameter in parameters.items():
        if needed not in spec and parameter.default is inspect.Parameter.empty:
            raise DescriptionError(f"{key}.{needed}: missing; {name} takes {allowed}")
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
    with page.stored.noting() as noted:
        blocks = section(here, **arguments)
    return [Heading(title), *text, *_simulators(noted), *blocks]


def _simulators(noted: Set[tuple[str, str]]) -> list[Block]:
    """Return the line that says which simulator made a section's numbers, of which cells where there are several."""
    found = {simulator: sorted(name for of, name in noted if of == simulator) for simulator, _ in sorted(noted)}
    told = [f"{simulator} ({', '.join(names)})" if len(found) > 1 else simulator for simulator, names in found.items()]
    return [Paragraph(f"Simulator: {'; '.join(told)}.")] if told else []
