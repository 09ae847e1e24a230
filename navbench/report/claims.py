"""Sections of a report on what a paper says: findings, claims with verdicts, its tables beside ours, its errata."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from navbench.analysis.claims import EVIDENCE, FAILED, claims_of, judged, quantity, verdicts_in
from navbench.analysis.measuring import MeasureError, arguments, check_measure, measure
from navbench.analysis.stored import StoredResults, reached
from navbench.mathematics.statistics import Estimate
from navbench.report.document import FORMS, MISSING, Block, Blocks, Column, Data, Figure, Finding, Problem, Table, words
from navbench.report.page import Page, Select
from navbench.validation import DescriptionError, instead

DECIMALS = {"time_s": 2, "path_length_m": 3, "mean_speed_mps": 3, "min_clearance_m": 3, "heading_ise": 3}
SHOWN = ("show", "decimals", "signed")
CLAIMS = ("id", "statement", "where", "printed", "measured", "n", "simulator", "tolerance", "evidence", "verdict")


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
    """Return every claim with its verdict, and how many there are of each verdict and evidence.

    Args:
        groups: counted apart: the claims whose ids begin with one of these.
    """
    table = judged(page.stored, trust=page.trust)
    kinds = verdicts_in(table)
    chosen = {
        title: table[table["id"].str.startswith(tuple(beginnings))]
        for title, beginnings in {**(groups or {}), "all claims": [""]}.items()
    }
    for evidence in EVIDENCE:
        of_it = table[table["evidence"] == evidence]
        if len(of_it):
            chosen[f"of these, evidence {plain(evidence)}"] = of_it
    counts = [[title, *((rows["verdict"] == verdict).sum() for verdict in kinds)] for title, rows in chosen.items()]
    columns = [Column("", "claims"), *(Column(plain(verdict), verdict) for verdict in kinds)]
    data = Data(list(table.columns), table.to_numpy(dtype=object).tolist())
    rows = [_told(claim) for claim in table.to_dict("records")]
    claims = Table("claims", [Column(title) for title in CLAIMS], rows, data, csv="claims.csv")
    failed = table[table["reason"].str.startswith(FAILED)].to_dict("records")
    problems = [Problem(f"claims.{claim['id']}: {claim['reason']}") for claim in failed]
    return [Table("verdicts", columns, counts), claims, *problems]


def _told(claim: Mapping[Any, Any]) -> list[str]:
    """Return a claim as a row of words."""
    reason = f": {claim['reason']}" if claim["reason"] else ""
    found = [claim["id"], claim["statement"], claim["where"], printed_figure(claim), measured_figure(claim)]
    return [
        *found,
        str(claim["n"]),
        claim["simulator"],
        claim["tolerance"],
        plain(claim["evidence"]),
        plain(claim["verdict"]) + reason,
    ]


def printed_figure(claim: Mapping[Any, Any]) -> str:
    """Return the number that a paper prints of a claim, a row of ``claims.csv``, where it prints one."""
    return MISSING if math.isnan(claim["printed"]) else f"{claim['printed']:g} {claim['unit']}".strip()


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
    printed = _printed(page.stored, claims)
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


def _printed(stored: StoredResults, beginning: str) -> dict[tuple[str | None, str], float]:
    """Return the printed figures of some claims by the label, None for every one, and world of each."""
    found = claims_of("claims", stored.manifest["study"]["claims"])
    return {
        (claim.of.get("label"), claim.of["world"]): quantity("printed", claim.printed)[0]
        for name, claim in found.items()
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
