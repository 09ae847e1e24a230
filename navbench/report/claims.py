"""Sections of a report on what a paper says: findings, claims with verdicts, its tables beside ours, its errata."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from navbench.analysis.claims import entries
from navbench.analysis.evidence import EVIDENCE
from navbench.analysis.measuring import MeasureError, arguments, check_measure, measure
from navbench.analysis.printed import quantity
from navbench.analysis.stored import StoredResults, reached
from navbench.analysis.verdicts import CHECK_VERDICTS, FAILED, judged, verdicts_in
from navbench.mathematics.statistics import Estimate
from navbench.report.document import (
    FORMS,
    MISSING,
    Block,
    Blocks,
    Column,
    Data,
    Figure,
    Finding,
    Heading,
    Paragraph,
    Problem,
    Table,
    number,
    words,
)
from navbench.report.page import Page, Select
from navbench.validation import DescriptionError, instead

if TYPE_CHECKING:
    import pandas as pd

DECIMALS = {"time_s": 2, "path_length_m": 3, "mean_speed_mps": 3, "min_clearance_m": 3, "heading_ise": 3}
SHOWN = ("show", "decimals", "signed")
SAID = ("id", "statement", "where", "printed", "measured", "n", "simulator", "tolerance")
CLAIMS = (*SAID, "evidence", "verdict", "where something else is plausible")
CHECKS = (*SAID, "verdict")
ALWAYS = CHECKS  # columns that are there even if they hold nothing
QUESTIONS = ("id", "question", "measured", "n", "simulator", "verdict", "where something else is plausible")


def findings(page: Page, *, sentences: Sequence[Mapping[str, Any]]) -> Blocks:
    """Return sentences whose numbers are measured.

    Args:
        sentences: each ``say`` with names in braces, and for each name, under ``with``, its measure and how it is
            shown: ``show`` (value, interval, count or percent), ``decimals`` and ``signed``.
    """
    check_sentences("sentences", sentences, page.trust)
    told: list[Block] = []
    for i, sentence in enumerate(sentences):
        try:
            told.append(_finding(page, f"sentences[{i}]", sentence))
        except MeasureError as error:
            told.append(Problem(str(error)))
    return told


def check_sentences(key: str, sentences: Sequence[Mapping[str, Any]], trust: bool) -> None:
    """Check the measures of sentences, and the forms in which they are shown.

    Raises:
        DescriptionError: there is no such measure or form, or an argument is unknown or missing.
    """
    for i, sentence in enumerate(sentences):
        for name, spec in sentence.get("with", {}).items():
            place, show = f"{key}[{i}].with.{name}", spec.get("show", "interval")
            if show not in FORMS:
                raise DescriptionError(f"{place}.show={show}: unknown; {instead(show, FORMS)}")
            asked(place, spec, trust)


def _finding(page: Page, key: str, sentence: Mapping[str, Any]) -> Finding:
    figures = {}
    for name, spec in sentence.get("with", {}).items():
        of = asked(f"{key}.with.{name}", spec, page.trust)
        found = measure(page.stored, spec.get("name", ""), of, trust=page.trust, key=f"{key}.with.{name}")
        told = "no case" if found is None else words(found, **{word: spec[word] for word in SHOWN if word in spec})
        figures[name] = Figure(told, *(found or (None, None, None, 0)))
    finding = Finding(sentence["say"], figures)
    try:
        finding.text  # noqa: B018
    except (KeyError, ValueError, IndexError) as error:
        raise DescriptionError(f"{key}.say: {error!r} in {sentence['say']!r}") from None
    return finding


def asked(key: str, spec: Mapping[str, Any], trust: bool = True) -> dict[str, Any]:
    """Return the arguments of the measure of a finding's figure, with its cells under ``select`` and ``than``.

    Raises:
        DescriptionError: there is no such measure, or it does not take these arguments.
    """
    of = {word: value for word, value in spec.items() if word not in (*SHOWN, "name")}
    return arguments(check_measure(key, spec.get("name", ""), of, trust=trust), of)


def verdicts(page: Page, *, groups: Mapping[str, Sequence[str]] | None = None) -> Blocks:
    """Return every claim with its verdict, and how many there are of each; and apart the checks and our questions.

    Args:
        groups: counted apart: the claims whose ids begin with one of these.
    """
    table = judged(page.stored, trust=page.trust)
    claims = table[table["kind"].isin(["claim", "hypothesis"])]
    kinds = verdicts_in(claims)
    chosen = {
        title: claims[claims["id"].str.startswith(tuple(beginnings))]
        for title, beginnings in {**(groups or {}), "all claims": [""]}.items()
    }
    for evidence in EVIDENCE:
        of_it = claims[claims["evidence"] == evidence]
        if len(of_it):
            chosen[f"of these, evidence {plain(evidence)}"] = of_it
    counts = [[title, *((rows["verdict"] == verdict).sum() for verdict in kinds)] for title, rows in chosen.items()]
    columns = [Column("", "claims"), *(Column(plain(verdict), verdict) for verdict in kinds)]
    data = Data(list(table.columns), table.to_numpy(dtype=object).tolist())
    blocks: list[Block] = [
        Table("verdicts", columns, counts),
        Table("claims", *_printed_rows(claims, CLAIMS), data, csv="claims.csv"),
    ]
    checks, questions = (table[table["kind"] == kind] for kind in ("check", "question"))
    if len(checks):
        held = ", ".join(f"{(checks['verdict'] == word).sum()} {word}" for word in CHECK_VERDICTS)
        text = f"Inputs copied from the paper, and what holds by construction; none of them is a claim: {held}."
        blocks += [Heading("Checks", 3), Paragraph(text), Table("checks", *_printed_rows(checks, CHECKS))]
    if len(questions):
        text = "What the paper does not claim: nothing is printed to hold these figures against."
        blocks += [
            Heading("Our questions", 3),
            Paragraph(text),
            Table("questions", *_printed_rows(questions, QUESTIONS)),
        ]
    failed = table[table["reason"].str.startswith(FAILED)].to_dict("records")
    return [*blocks, *(Problem(f"claims.{claim['id']}: {claim['reason']}") for claim in failed)]


def _printed_rows(table: "pd.DataFrame", columns: Sequence[str]) -> tuple[list[Column], list[list[str]]]:
    """Return the columns and rows of a table of claims, checks or questions, without columns that hold nothing."""
    told = [_told(row) for row in table.to_dict("records")]
    filled = [column for column in columns if column in ALWAYS or any(row[column] for row in told)]
    return [Column(column) for column in filled], [[row[column] for column in filled] for row in told]


def _told(claim: Mapping[Any, Any]) -> dict[str, str]:
    """Return a row of ``claims.csv`` as words by their columns."""
    reason = f": {claim['reason']}" if claim["reason"] else ""
    return {
        **{word: claim[word] for word in ("id", "statement", "where", "simulator", "tolerance")},
        "question": claim["statement"],
        "printed": printed_figure(claim),
        "measured": measured_figure(claim),
        "n": str(claim["n"]),
        "evidence": plain(claim["evidence"]),
        "verdict": plain(claim["verdict"]) + reason,
        "where something else is plausible": _plausible(claim),
    }


def _plausible(claim: Mapping[Any, Any]) -> str:
    """Return a figure's range over what its measure might plausibly take, and whether the verdict depends on it."""
    if math.isnan(claim["plausible_low"]):
        return ""
    figures = f"{number(claim['plausible_low'])} to {number(claim['plausible_high'])}"
    return f"{figures}; " + (
        f"the verdict depends on it: {claim['depends_on']}" if claim["depends_on"] else "the same verdict"
    )


def printed_figure(claim: Mapping[Any, Any]) -> str:
    """Return the number that a paper prints of a claim, a row of ``claims.csv``, where it prints one."""
    return f"{claim['printed']} {claim['unit']}".strip() or MISSING


def measured_figure(claim: Mapping[Any, Any]) -> str:
    """Return what was measured of a claim, with its interval or range where it has one."""
    return words((claim["measured"], claim["low"], claim["high"], claim["n"])) if claim["n"] else MISSING


def printed_table(
    page: Page, *, metric: str, select: Select, worlds: Mapping[str, str], claims: str, labels: Sequence[str]
) -> Blocks:
    """Return a paper's table with, for each entry, the printed figure, ours and the ratio of ours to it.

    The printed figures are those of the claims. Ours is the median, with the range where there are several runs, over
    the robots that reached; where not all reached, how many did stands beside it.

    Args:
        metric: the metric that the table holds.
        select: which cells.
        worlds: the world behind each of the paper's columns.
        claims: what the ids of the claims begin with that hold the printed figures, each of one label and world.
        labels: the rows; of some of them the paper may print nothing.
    """
    decimals, raw, rows = DECIMALS.get(metric, 4), [], []
    printed = printed_figures(page.stored, claims)
    for label in labels:
        row: list[Any] = [label]
        for title, world in worlds.items():
            runs = page.stored.select(**select, label=label, world=world)
            values = reached(runs)[metric]
            figure = printed.get((label, world), printed.get((None, world)))
            ours = Estimate(values.median(), values.min(), values.max(), len(values))
            ratio = None if figure is None else ours.value / figure
            fewer = "" if len(values) == len(runs) else f" ({len(values)} of {len(runs)} reached)"
            row += [None if figure is None else f"{figure:g}", words(ours, decimals=decimals) + fewer, ratio]
            raw.append([label, title, world, figure, *ours, len(runs), ratio])
        rows.append(row)
    names = ["label", "where", "world", "printed", "median", "low", "high", "reached", "runs", "ratio"]
    heads = [Column(head, decimals=2, group=title) for title in worlds for head in ("printed", "here", "ratio")]
    return [page.table([Column(""), *heads], rows, Data(names, raw))]


def printed_figures(stored: StoredResults, beginning: str) -> dict[tuple[str | None, str], float]:
    """Return the printed figures of some claims by the label, None for every one, and world of each."""
    return {
        (claim.of.get("label"), claim.of["world"]): quantity("printed", claim.printed)[0]
        for name, _, claim in entries("", stored.manifest["study"], stored=True)
        if name.startswith(beginning) and claim.of and claim.printed is not None
    }


def errata(page: Page, *, items: Sequence[Mapping[str, str]]) -> Blocks:
    """Return what a paper prints wrong or leaves open, and what is done here.

    Args:
        items: each ``where`` in the paper, ``printed`` and what is done ``here``.
    """
    rows = [[item["where"], item["printed"], item["here"]] for item in items]
    return [Table("", [Column("where"), Column("the paper"), Column("here")], rows)]


def plain(name: str) -> str:
    """Return a verdict or an evidence in words."""
    return name.replace("_", " ")


def printed_beside(page: Page, *, claims: Sequence[str]) -> Blocks:
    """Return what the paper prints of some claims beside what was measured.

    Args:
        claims: what their ids begin with.
    """
    table = judged(page.stored, trust=page.trust)
    chosen = table[table["id"].str.startswith(tuple(claims))].to_dict("records")
    rows = [[one["statement"], one["where"], printed_figure(one), measured_figure(one)] for one in chosen]
    return [page.table([Column("what"), Column("where"), Column("printed"), Column("here")], rows)]
