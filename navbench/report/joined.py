"""One page over the reports of several studies, from what their folders hold: claims, manifest and report."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from navbench.analysis.claims import COLUMNS, EVIDENCE, HYPOTHESIS_VERDICTS, VERDICTS
from navbench.experiments.store import write_table
from navbench.report.markup import markdown
from navbench.report.study_tables import printed_figure, told_figure
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    import pandas as pd

PAGE = "README.md"
FINDINGS = 3  # of each study; its report holds all
VERDICT_WORDS = (
    "Within its tolerance a claim is reproduced, within twice the tolerance partly. Evidence says what an agreement "
    "is worth: *free*, nothing about it was chosen by looking at the figure; *selected*, parameters were chosen by "
    "success in such worlds; *fitted*, to this very figure or one beside it, so that an agreement is not testable; "
    "*layout unknown*, the paper draws the world without numbers, so that a disagreement may be the layout's."
)


class Found(NamedTuple):
    """What one study found, as its folder holds it.

    Attributes:
        name: its folder's name.
        title: its title.
        summary: what its report says first, in Markdown.
        findings: the first of its report's findings, each a line of Markdown.
        errata: what its paper prints wrong or leaves open: where, printed, here.
        claims: its table of claims, with the columns of ``claims.csv``; no rows where it has none.
    """

    name: str
    title: str
    summary: str
    findings: Sequence[str]
    errata: Sequence[Mapping[str, str]]
    claims: "pd.DataFrame"


def write_joined(folder: Path) -> Path:
    """Write the page that joins the reports in a folder, and return it.

    Args:
        folder: it holds a folder for each study, with ``report.md``, ``manifest.json`` and, where the study has claims,
            ``claims.csv``.

    Raises:
        DescriptionError: there is no such folder or no study in it, or a study's files are not those of a report.
    """
    if not folder.is_dir():
        raise DescriptionError(f"join={folder}: there is no such directory")
    studies = [read_study(manifest.parent) for manifest in sorted(folder.glob("*/manifest.json"))]
    if not studies:
        raise DescriptionError(f"join={folder}: no study's report in it, such as {folder / 'NAME' / 'manifest.json'}")
    studies.sort(key=lambda study: study.claims.empty)  # those of papers first; the sort keeps their order by name
    parts = [_head(folder), *map(_paragraph, studies), _counted(studies), _refuted(studies), _errata(studies)]
    write_table(folder / PAGE, "\n".join(parts))
    return folder / PAGE


def read_study(path: Path) -> Found:
    """Return what a study's folder holds.

    Raises:
        DescriptionError: a file is missing or is not what a report writes.
    """
    manifest = path / "manifest.json"
    try:
        study = json.loads(manifest.read_text())["study"]
        title, summary, errata = (study[key] for key in ("title", "summary", "errata"))
    except (ValueError, KeyError, TypeError):
        again = f"navbench report outputs/study/{path.name}"
        raise DescriptionError(
            f"{manifest}: not of a study's report, or of an older one; write it by {again}"
        ) from None
    report = path / "report.md"
    if not report.is_file():
        raise DescriptionError(f"{report}: missing")
    findings = re.search(r"^## Findings$(.*?)^## ", report.read_text(), re.MULTILINE | re.DOTALL)
    told = re.findall(r"^- .*$", findings[1], re.MULTILINE)[:FINDINGS] if findings else []
    return Found(path.name, title, summary, told, errata, read_claims(path / "claims.csv"))


def read_claims(file: Path) -> "pd.DataFrame":
    """Return a table of claims; without rows where there is no such file.

    Raises:
        DescriptionError: it lacks columns, or a verdict or an evidence is unknown.
    """
    import pandas as pd

    if not file.is_file():
        return pd.DataFrame(columns=COLUMNS)
    try:
        table = pd.read_csv(file, dtype={"id": str, "statement": str, "reason": str, "unit": str})
    except (ValueError, OSError) as error:
        raise DescriptionError(f"{file}: {' '.join(str(error).split())}") from None
    table = table.fillna({"reason": "", "unit": "", "where": "", "evidence": ""})
    if list(table.columns) != list(COLUMNS):
        raise DescriptionError(f"{file}: its columns must be {', '.join(COLUMNS)}")
    for column, allowed in (("verdict", (*VERDICTS, *HYPOTHESIS_VERDICTS)), ("evidence", ("", *EVIDENCE))):
        wrong = table[~table[column].isin(allowed)]
        if len(wrong):
            value = wrong[column].iloc[0]
            raise DescriptionError(f"{file}: {column}={value} of {wrong['id'].iloc[0]}; allowed: {', '.join(allowed)}")
    return table


def _head(folder: Path) -> str:
    return (
        "# What the studies found\n\n"
        "For each study what it is, the link to its report and the first of its findings; then the claims of all "
        "papers together. "
        f"`navbench report join={folder.name}` writes this page from the studies' folders, and runs nothing.\n"
    )


def _paragraph(study: Found) -> str:
    claims = study.claims
    counted = [f"{int((claims['verdict'] == verdict).sum())} {_words(verdict)}" for verdict in VERDICTS]
    verdicts = f" {len(claims)} claims: {', '.join(counted)}." if len(claims) else ""
    findings = "\n".join(["", *study.findings, ""]) if study.findings else ""
    return f"## {study.title}\n\n{study.summary.strip()}{verdicts} [Report]({study.name}/report.md)\n{findings}"


def _counted(studies: Sequence[Found]) -> str:
    """Return how many claims there are of each verdict, by study and by evidence."""
    import pandas as pd

    with_claims = [study for study in studies if len(study.claims)]
    if not with_claims:
        return "## Claims\n\nNo study has claims.\n"
    table = pd.concat([study.claims.assign(study=study.name) for study in with_claims])
    heads = [*map(_words, VERDICTS), "in all"]
    parts = [f"## Claims by verdict\n\n{VERDICT_WORDS}\n"]
    for column, rows in (("study", [study.name for study in with_claims]), ("evidence", list(EVIDENCE))):
        lines = [_count(table[table[column] == row], _words(row)) for row in rows]
        parts.append(markdown([column, *heads], [*lines, _count(table, "all")]))
    return "\n".join(parts)


def _count(claims: "pd.DataFrame", title: str) -> list[str]:
    return [title, *(str(int((claims["verdict"] == verdict).sum())) for verdict in VERDICTS), str(len(claims))]


def _refuted(studies: Sequence[Found]) -> str:
    """Return every claim that was not reproduced."""
    rows = []
    for study in studies:
        for claim in study.claims[study.claims["verdict"] == "not_reproduced"].to_dict("records"):
            printed = printed_figure(claim)
            reason = claim["reason"] or f"{_off(claim)}; tolerance {claim['tolerance']}"
            words = [study.name, claim["id"], claim["statement"], printed, told_figure(claim)]
            rows.append([*words, reason, _words(claim["evidence"])])
    title = "## What was not reproduced\n\n"
    if not rows:
        return f"{title}Nothing.\n"
    return title + markdown(["study", "id", "statement", "printed", "measured", "reason", "evidence"], rows)


def _off(claim: Mapping[Any, Any]) -> str:
    """Return how far the measured figure lies from the printed one, in the form of the claim's tolerance."""
    if math.isnan(claim["printed"]):
        return f"holds in {100.0 * claim['measured']:.0f} %"
    away = claim["measured"] - claim["printed"]
    if str(claim["tolerance"]).endswith("%"):
        return f"off by {100.0 * away / abs(claim['printed']):+.0f} %"
    return f"off by {away:+.3g}"


def _errata(studies: Sequence[Found]) -> str:
    """Return what all papers print wrong or leave open."""
    rows = [[study.name, item["where"], item["printed"], item["here"]] for study in studies for item in study.errata]
    title = "## What the papers print wrong or leave open\n\n"
    return title + (markdown(["paper", "where", "the paper", "here"], rows) if rows else "Nothing is listed.\n")


def _words(name: str) -> str:
    return name.replace("_", " ")
