"""One page over the reports of several studies, from what their folders hold: claims, manifest and report."""

import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pydantic import BaseModel

from navbench.analysis.evidence import EVIDENCE
from navbench.analysis.verdicts import CHECK_VERDICTS, COLUMNS, HYPOTHESIS_VERDICTS, VERDICTS
from navbench.experiments.schema import LONGEST
from navbench.experiments.store import write_table
from navbench.reading import bounded
from navbench.report.claims import measured_figure, plain, printed_figure
from navbench.report.document import Block, Column, Document, Heading, Lines, Link, Paragraph, Plot, Table
from navbench.report.figures import save_figure
from navbench.report.markdown import render
from navbench.report.shares import VERDICTS as SHARE_VERDICTS
from navbench.report.shares import read_shares, read_told, strips
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    import pandas as pd

PAGE = "README.md"
MULTIVERSE = "multiverse"  # the folder of a study's
PLANAR = "planar"  # that of its report with every cell in this simulator
FINDINGS = 3  # of each study; its report holds all
VERDICT_WORDS = (
    "Within its tolerance a claim is reproduced, within twice the tolerance partly. Evidence says what an agreement "
    "is worth, by the sources of all values that the claim's cells use: *fitted*, one was fitted to this very figure, "
    "so that it cannot be tested by it; *selected*, one was chosen by success in the claim's world, or fitted there to "
    "another figure; *layout unknown*, the paper draws the world without numbers, so that a disagreement may be the "
    "layout's; *free*, none of these. Checks and our own questions are not counted."
)
FIGURES = ("measured", "low", "high", "n", "plausible_low", "plausible_high")  # the other columns are words
NEWER: dict[str, Any] = {  # columns that some tables of claims do not have yet, with what they would hold
    "kind": "claim",
    **dict.fromkeys(("simulator", "depends_on", "because"), ""),
    **dict.fromkeys(("plausible_low", "plausible_high"), math.nan),
}


class _Text(BaseModel):
    text: str


class _Erratum(BaseModel):
    where: str
    printed: str
    here: str


class _Findings(BaseModel):
    title: str
    summary: str
    findings: Sequence[_Text]
    errata: Sequence[_Erratum]


class Found(NamedTuple):
    """What one study found, as its folder holds it.

    Attributes:
        name: its folder's name.
        title: its title.
        summary: what its report says first, in Markdown.
        findings: its findings, each a sentence of Markdown.
        errata: what its paper prints wrong or leaves open: where, printed, here.
        claims: its table of what its paper claims, with the columns of ``claims.csv``; no rows where it has none.
        shares: in which share of the reconstructions each holds; no rows where there is no multiverse.
        together: whether each printed number holds where most of them do; no rows without any.
        factors: what the paper leaves open, the most telling first, with its bits; no rows without a multiverse.
        planar: as ``claims``, with every cell in the planar simulator; no rows where it was not run so.
    """

    name: str
    title: str
    summary: str
    findings: Sequence[str]
    errata: Sequence[Mapping[str, str]]
    claims: "pd.DataFrame"
    shares: "pd.DataFrame"
    together: "pd.DataFrame"
    factors: "pd.DataFrame"
    planar: "pd.DataFrame"


def write_joined(folder: Path) -> Path:
    """Write the page that joins the reports in a folder, and return it.

    Args:
        folder: it holds a folder for each study, with ``report.md``, ``findings.json`` and, where the study has
            claims, ``claims.csv``.

    Raises:
        DescriptionError: there is no such directory or no study in it, or a study's files are not those of a report.
    """
    if not folder.is_dir():
        raise DescriptionError(f"join={folder}: there is no such directory")
    studies = [read_study(file.parent) for file in sorted(folder.glob("*/findings.json"))]
    if not studies:
        raise DescriptionError(f"join={folder}: no study's report in it, such as {folder / 'NAME' / 'findings.json'}")
    studies.sort(key=lambda study: study.claims.empty)  # those of papers first; the sort keeps their order by name
    head = Paragraph(
        "For each study what it is, the link to its report and the first of its findings; then the claims of all "
        f"papers together. `navbench report join={folder.name}` writes this page from the studies' folders, and runs "
        "nothing."
    )
    told = [block for study in studies for block in _told(study)]
    blocks = [
        head,
        *told,
        *_counted(studies),
        *_shares(studies, folder),
        *_in_planar(studies),
        *_refuted(studies),
        *_errata(studies),
    ]
    write_table(folder / PAGE, render(Document("What the studies found", blocks)))
    return folder / PAGE


def read_study(path: Path) -> Found:
    """Return what a study's folder holds.

    Raises:
        DescriptionError: a file is missing or is not what a report writes.
    """
    file = path / "findings.json"
    try:
        told = _Findings.model_validate_json(bounded(file, LONGEST)).model_dump()
        found = Found(
            path.name,
            told["title"],
            told["summary"],
            [finding["text"] for finding in told["findings"]],
            told["errata"],
            read_claims(path / "claims.csv").query("kind == 'claim'"),
            read_shares(path / MULTIVERSE),
            read_told(path / MULTIVERSE, "together", ("id", "holds", "predicts")),
            read_told(path / MULTIVERSE, "factors", ("factor",), "bits"),
            read_claims(path / PLANAR / "claims.csv").query("kind == 'claim'"),
        )
    except (ValueError, KeyError, TypeError) as error:
        if isinstance(error, DescriptionError):
            raise
        again = f"navbench report outputs/study/{path.name}"
        raise DescriptionError(f"{file}: not of a study's report, or of an older one; write it by {again}") from None
    if not (path / "report.md").is_file():
        raise DescriptionError(f"{path / 'report.md'}: missing")
    return found


def read_claims(file: Path) -> "pd.DataFrame":
    """Return a table of claims; without rows where there is no such file.

    Raises:
        DescriptionError: it lacks columns, or a verdict or an evidence is unknown.
    """
    import pandas as pd

    if not file.is_file():
        return pd.DataFrame(columns=list(COLUMNS))
    try:
        texts = {column: str for column in COLUMNS if column not in FIGURES}
        table = pd.read_csv(
            io.BytesIO(bounded(file, LONGEST)), dtype=texts, na_values=dict.fromkeys(FIGURES, ""), keep_default_na=False
        )
    except (ValueError, OSError) as error:
        raise DescriptionError(f"{file}: {' '.join(str(error).split())}") from None
    if [column for column in COLUMNS if column in table or column not in NEWER] != list(table.columns):
        raise DescriptionError(f"{file}: its columns must be {', '.join(COLUMNS)}")
    table = table.assign(**{column: value for column, value in NEWER.items() if column not in table})[list(COLUMNS)]
    verdicts = (*VERDICTS, *HYPOTHESIS_VERDICTS, *CHECK_VERDICTS)
    for column, allowed in (("verdict", (*verdicts, "")), ("evidence", (*EVIDENCE, ""))):
        wrong = table[~table[column].isin(allowed)]
        if len(wrong):
            value = wrong[column].iloc[0]
            raise DescriptionError(
                f"{file}: {column}={value} of {wrong['id'].iloc[0]}; allowed: {', '.join(filter(None, allowed))}"
            )
    return table


def _told(study: Found) -> list[Block]:
    claims = study.claims
    counted = [f"{int((claims['verdict'] == verdict).sum())} {plain(verdict)}" for verdict in VERDICTS]
    verdicts = f" {len(claims)} claims: {', '.join(counted)}." if len(claims) else ""
    text = f"{study.summary.strip()}{verdicts} [Report]({study.name}/report.md)"
    first = [Lines(study.findings[:FINDINGS])] if study.findings else []
    return [Heading(study.title), Paragraph(text), *first]


def _counted(studies: Sequence[Found]) -> list[Block]:
    """Return how many claims there are of each verdict, by study and by evidence."""
    import pandas as pd

    with_claims = [study for study in studies if len(study.claims)]
    if not with_claims:
        return [Heading("Claims"), Paragraph("No study has claims.")]
    table = pd.concat([study.claims.assign(study=study.name) for study in with_claims])
    blocks: list[Block] = [Heading("Claims by verdict"), Paragraph(VERDICT_WORDS)]
    for column, rows in (("study", [study.name for study in with_claims]), ("evidence", list(EVIDENCE))):
        lines = [_count(table[table[column] == row], plain(row)) for row in rows]
        blocks.append(_table([column, *map(plain, VERDICTS), "in all"], [*lines, _count(table, "all")]))
    return blocks


def _shares(studies: Sequence[Found], folder: Path) -> list[Block]:
    """Return in how many reconstructions the claims of all papers hold."""
    asked = [study for study in studies if len(study.shares)]
    if not asked:
        return []
    save_figure(strips({study.name: study.shares for study in asked}), folder, "shares")
    rows = [[study.name, *_counts(study)] for study in asked]
    links = [Link(f"{study.title}: its multiverse", f"{study.name}/{MULTIVERSE}/report.md") for study in asked]
    text = (
        "The claims again, as far as reconstructions can be asked, with a few questions of our own that they can "
        "answer, in many reconstructions of what a paper leaves open: *robust* claims hold in 95 % of them or more, "
        "*contradicted* ones fail in 95 % or more, those *out of reach* hold in none that was drawn; *not testable* "
        "ones have no case or are chaotic in most; *open* ones depend on what is not printed, and the reports say on "
        "what, or have too often no case to be said to fail. *Hold here*: reproduced or supported in the study's own "
        "results, where those not testable do not count; *at best*: as reconstructions count, in the one that meets "
        "most printed numbers, to which it is fitted."
    )
    caption = "Each dot is a claim: in which share of the reconstructions it holds"
    worth = "the missing value worth most"
    table = _table(["study", "hold here", "at best", "printed numbers at best", *SHARE_VERDICTS, worth], rows)
    return [Heading("In how many reconstructions they hold"), Paragraph(text), Plot("shares", caption), table, *links]


def _counts(study: Found) -> list[str]:
    """Return how many claims hold where, how many have which verdict, and the missing value worth most."""
    shares, factors = study.shares, study.factors
    asked = study.together[study.together["predicts"].notna()]  # what does not follow from others
    return [
        str(int(shares["here"].isin(["reproduced", "supported"]).sum())) if "here" in shares else "–",
        str(int((shares["at_best"] == "yes").sum())) if len(asked) and "at_best" in shares else "–",
        f"{int((asked['holds'] == 'yes').sum())} of {len(asked)}" if len(asked) else "none printed",
        *(str(int((shares["verdict"] == word).sum())) for word in SHARE_VERDICTS),
        f"`{factors['factor'].iloc[0]}`, {factors['bits'].iloc[0]:.2f} bit" if factors["bits"].gt(0.0).any() else "–",
    ]


def _in_planar(studies: Sequence[Found]) -> list[Block]:
    """Return how the claims of all papers fare with every cell in the planar simulator."""
    counted, rows = [], []
    for study in (study for study in studies if len(study.planar)):
        both = study.claims.merge(study.planar, on="id", suffixes=("", "_planar"))
        other = both[both["verdict"] != both["verdict_planar"]]
        away = (both["measured_planar"] - both["measured"]).abs() / both["measured"].abs()
        equal = (both["measured"] == both["measured_planar"]) | both["measured"].isna() & both["measured_planar"].isna()
        most = f"{100.0 * away[~equal].max():.2g} %" if not equal.all() else "0"
        counted.append([study.name, str(len(both)), str(int(equal.sum())), most, str(len(other))])
        for claim in other.to_dict("records"):
            planar = {column: claim[f"{column}_planar"] for column in COLUMNS if column != "id"}
            found = [f"{plain(one['verdict'])}: {measured_figure(one)}" for one in (claim, planar)]
            rows.append([study.name, claim["id"], claim["statement"], printed_figure(claim), *found])
    if not counted:
        return []
    text = (
        "A study's single runs and its runs over many starts each have the simulator that its tables name. Here every "
        "cell is in the planar one, whose rays and contacts are exact."
    )
    blocks: list[Block] = [
        Heading("With every cell in the planar simulator"),
        Paragraph(text),
        _table(["study", "claims", "same figure to the last bit", "largest difference", "other verdict"], counted),
    ]
    heads = ["study", "id", "statement", "printed", "as reported", "in planar"]
    return [*blocks, _table(heads, rows) if rows else Paragraph("No verdict differs.")]


def _count(claims: "pd.DataFrame", title: str) -> list[str]:
    return [title, *(str(int((claims["verdict"] == verdict).sum())) for verdict in VERDICTS), str(len(claims))]


def _refuted(studies: Sequence[Found]) -> list[Block]:
    """Return every claim that was not reproduced."""
    rows = []
    for study in studies:
        for claim in study.claims[study.claims["verdict"] == "not_reproduced"].to_dict("records"):
            reason = claim["reason"] or f"{_off(claim)}; tolerance {claim['tolerance']}"
            words = [study.name, claim["id"], claim["statement"], printed_figure(claim), measured_figure(claim)]
            rows.append([*words, reason, plain(claim["evidence"])])
    heads = ["study", "id", "statement", "printed", "measured", "reason", "evidence"]
    return [Heading("What was not reproduced"), _table(heads, rows) if rows else Paragraph("Nothing.")]


def _off(claim: Mapping[Any, Any]) -> str:
    """Return how far the measured figure lies from the printed one, in the form of the claim's tolerance."""
    if not claim["printed"]:
        return f"holds in {100.0 * claim['measured']:.0f} %"
    printed = float(claim["printed"])
    away = claim["measured"] - printed
    if str(claim["tolerance"]).endswith("%"):
        return f"off by {100.0 * away / abs(printed):+.0f} %"
    return f"off by {away:+.3g}"


def _errata(studies: Sequence[Found]) -> list[Block]:
    """Return what all papers print wrong or leave open."""
    rows = [[study.name, item["where"], item["printed"], item["here"]] for study in studies for item in study.errata]
    table = _table(["paper", "where", "the paper", "here"], rows) if rows else Paragraph("Nothing is listed.")
    return [Heading("What the papers print wrong or leave open"), table]


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    return Table("", [Column(head) for head in heads], rows)
