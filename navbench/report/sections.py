"""The sections of a report: functions by name, each from stored results to Markdown, tables and figures.

A section is ``function(stored, out, **arguments) -> str``: it writes below ``out`` and returns Markdown whose links
are relative to it. A study's file names it and gives its arguments, with a ``title`` and, where wanted, a ``text`` in
front.
"""

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from navbench.analysis.stored import StoredResults
from navbench.report.comparison import fair_comparison
from navbench.report.convergence import tuners_compared
from navbench.report.crossing import crossed_tables, success_map
from navbench.report.described import counts, surface_2d
from navbench.report.evolution import evolution, gains, rules_compared
from navbench.report.fleet_figures import fleet_table, frames, wheel_velocities
from navbench.report.provenance import sources
from navbench.report.robustness import robustness
from navbench.report.run_figures import spells_on_the_way, time_series
from navbench.report.study_figures import memberships, phases, surface, trajectories, velocities
from navbench.report.study_tables import claims, errata, findings, outcomes_table, printed_table, rules
from navbench.validation import DescriptionError

SECTIONS: Mapping[str, Callable[..., str]] = {
    function.__name__: function
    for function in (
        findings,
        claims,
        printed_table,
        outcomes_table,
        trajectories,
        velocities,
        phases,
        memberships,
        rules,
        counts,
        surface,
        surface_2d,
        tuners_compared,
        evolution,
        gains,
        rules_compared,
        frames,
        wheel_velocities,
        fleet_table,
        time_series,
        spells_on_the_way,
        robustness,
        success_map,
        crossed_tables,
        fair_comparison,
        sources,
        errata,
    )
}
OWN = ("name", "title", "text")  # the keys that every section has


def write_section(stored: StoredResults, out: Path, spec: Mapping[str, Any]) -> str:
    """Write a section's tables and figures, and return it in Markdown under its heading.

    Args:
        stored: the study's results.
        out: the report's directory.
        spec: its name, title, text and arguments.
    """
    arguments = {key: value for key, value in spec.items() if key not in OWN}
    text = f"{spec['text'].strip()}\n\n" if spec.get("text") else ""
    return f"## {spec['title']}\n\n{text}{SECTIONS[spec['name']](stored, out, **arguments)}"


def check_section(key: str, spec: Mapping[str, Any]) -> None:
    """Check that a section exists and takes these arguments.

    Raises:
        DescriptionError: it does not; the message names what is allowed.
    """
    name = str(spec.get("name"))
    if name not in SECTIONS:
        raise DescriptionError(f"{key}.name={name!r}: there is no such section; allowed: {', '.join(SECTIONS)}")
    parameters = dict(list(inspect.signature(SECTIONS[name]).parameters.items())[2:])
    allowed = ", ".join((*OWN[1:], *parameters))
    for given in spec:
        if given not in OWN and given not in parameters:
            raise DescriptionError(f"{key}.{given}: unknown key; {name} takes {allowed}")
    for needed, parameter in {"title": None, **parameters}.items():
        if needed not in spec and (parameter is None or parameter.default is inspect.Parameter.empty):
            raise DescriptionError(f"{key}.{needed}: missing; {name} takes {allowed}")
