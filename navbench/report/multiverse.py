"""The report of a multiverse: in which share of the reconstructions each claim holds, and what decides it."""

import json
import math
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

from navbench.analysis.multiverse import KIND
from navbench.analysis.shares import CASES_MIN, Shares, halves, shares_of, worth
from navbench.experiments.store import write_table
from navbench.mathematics.information import BINS, PAIR_BINS
from navbench.mathematics.statistics import Estimate
from navbench.report.document import RARE, Block, Column, Document, Heading, Link, Paragraph, Plot, Table
from navbench.report.figures import save_figure
from navbench.report.multiverse_results import MultiverseResults
from navbench.report.reports import write_document
from navbench.report.shares import VERDICTS, chart, curves, numbers, read_shares
from navbench.report.specification import has_curve, specification
from navbench.report.together import Worth, at_best_of, fitted, listed, point, together

BEST = "best.json"
SHARE = ["share", "share_low", "share_high", "share_n"]  # columns of a table of shares
CURVES_MAX = 6  # claims of which the share is drawn over the value on which it depends most
SORTED_MAX = 4  # claims of which the specification curve is drawn


TUNED = (
    "Nothing is tuned or evolved anew: reconstructions take what the study's own tunings found in its own worlds, and "
    "within other bounds what lies at the same place between them. What a tuning would gain in another layout they do "
    "not tell."
)


def write_multiverse(told: MultiverseResults, out: Path) -> list[Path]:
    """Write the report into a directory and return its files."""
    shares = shares_of(told.drawn, told.claims, told.multiverse, told.holds_at_best)
    best, ranked = told.best, worth(shares, told.drawn)
    save_figure(chart(shares, told.here), out, "shares")
    plots = [Plot("shares", "In which share of the reconstructions each claim holds, with 95 % intervals")]
    ends = {factor.name: factor.bounds for factor in told.factors if not factor.choices}
    if curved := _curved(shares):
        save_figure(curves(told.drawn, curved[:CURVES_MAX], told.choices, ends), out, "curves")
        caption = (
            "The share in which a claim holds over the range, or at each choice, of the value on which it depends "
            "most; the dashed line is the share over all"
        )
        plots.append(Plot("curves", caption))
    if sorted_ones := [one for one in curved if has_curve(told.drawn, one.claim.name)][:SORTED_MAX]:
        save_figure(specification(told.drawn, sorted_ones, told.choices, ends, told.measured), out, "specification")
        caption = (
            "What the reconstructions measure for a claim, sorted, and below how often, from white to black, the "
            "values that decide it lie where in their ranges"
        )
        plots.append(Plot("specification", caption))
    if best and any(best.printed):
        save_figure(numbers(told.drawn, best, told.admissible, told.measured), out, "numbers")
        plots.append(Plot("numbers", "The printed numbers that do not follow from each other, beside what is measured"))
    document = Document(
        f"{told.title}: in how many reconstructions its claims hold",
        [
            *_first(told, shares, ranked),
            *plots,
            *_claims(told, shares),
            *_other_priors(told, shares, out),
            *fitted(told, ranked),
            *_deciding(shares),
            *_factors(told, shares, ranked),
            *_made(told, shares),
        ],
    )
    if best:
        write_table(out / BEST, json.dumps(point(told, best), indent=1) + "\n")
    return write_document(document, out)


def _first(told: MultiverseResults, shares: Sequence[Shares], ranked: Worth) -> list[Block]:
    """Return what a reader wants first: three sentences."""
    counts = {word: sum(one.verdict == word for one in shares) for word in VERDICTS}
    bits = [(name, value) for name, value in ranked[:3] if value > 0.0]
    most = ", ".join(f"`{name}` ({value:.2f} bit)" for name, value in bits)
    lines = [
        f"{len(shares)} claims: {counts['robust']} robust, holding in nearly every reconstruction; "
        f"{counts['contradicted']} contradicted, failing in nearly every one; {counts['out of reach']} out of reach, "
        f"holding in none of {len(told.drawn.rows)}; {counts['not testable']} not testable, without a case or chaotic "
        f"in most; {counts['open']} open, depending on what the paper does not print, or too often without a case.",
        together(told, told.best) if told.best else "No claim prints a number.",
        f"The missing values on which the verdicts of all claims together depend most: {most}."
        if most
        else "The verdicts depend on none of the missing values alone.",
    ]
    return [Paragraph(line) for line in lines]


def _claims(told: MultiverseResults, shares: Sequence[Shares]) -> list[Block]:
    columns = [
        Column("claim", "id"),
        Column("says", "statement"),
        Column("verdict", "verdict"),
        Column("here", "here"),
        Column("at best", "at_best"),
        Column("share", "share", decimals=3, show=RARE),
        Column("of admissible", "admissible", decimals=3, show=RARE),
        Column("given the printed", "conditioned", decimals=3, show=RARE),
        Column("decided by", "decided"),
    ]
    rows = [
        [
            one.claim.name,
            one.claim.claim.says,
            one.verdict,
            told.here.get(one.claim.name, "").replace("_", " ") or None,
            ("yes" if one.claim.name in told.holds_at_best else "no") if told.at_best else None,
            one.all,
            _enough(one.admissible),
            _enough(one.conditioned),
            one.decided or None,
        ]
        for one in shares
    ]
    texts = [
        "*Robust* holds, and *contradicted* fails, in 95 % or more, by the bound of the interval, over admissible "
        f"reconstructions where {CASES_MIN} or more are, else over all; *out of reach* holds in none that was drawn or "
        "found; *not testable* has no case or is chaotic in most; *open* is what is left, also what hardly ever holds "
        "but has too often no case to be said to fail.",
        "*Here* is the verdict in the study's own results; *at best*, whether it holds in the reconstruction that "
        "meets most printed numbers. *Of admissible* is the share of those in which the paper's controllers do what it "
        f"shows, see *How it was made*{_given(told, shares)}. *Decided by* names the missing value that most often "
        "turns an open claim when it alone is drawn anew, else the one on which it depends most.",
        "A share is one of our prior: of the ranges and choices of everything that the paper leaves open, drawn "
        "independently. Among reconstructions a printed single run holds where the median of starts within a "
        "millimetre lies within the tolerance and they scatter by no more; *here* it must lie among the central 90 % "
        "of them, too. Shares that the decimals do not show, and those of fewer than "
        f"{CASES_MIN} cases, which have no interval, are counts.",
    ]
    return [Heading("Claims"), *map(Paragraph, texts), Table("shares", columns, rows)]


def _given(told: MultiverseResults, shares: Sequence[Shares]) -> str:
    """Return of which reconstructions the conditioned shares are, as the end of a sentence."""
    conditioned = told.multiverse.conditioned
    if conditioned is None:
        return ""
    n = next((one.conditioned.n for one in shares if one.conditioned is not None), 0)
    names = ", ".join(conditioned.claims)
    return (
        f"; *given the printed* those {n} of them that measure within {conditioned.within} of what is printed for "
        f"{names}, and nothing is said there of the claims that follow from these"
    )


def _other_priors(told: MultiverseResults, shares: Sequence[Shares], out: Path) -> list[Block]:
    """Return the shares under the study's other priors, whose reports are there, beside those of this one."""
    tables = {name: read_shares(out / name).set_index("id") for name in told.multiverse.priors}
    tables = {name: table for name, table in tables.items() if len(table)}
    if not tables:
        return []
    columns = [Column("claim", "id"), Column("verdict", "verdict"), Column("share", "share", decimals=3, show=RARE)]
    rows: list[list[Any]] = [[one.claim.name, one.verdict, one.all] for one in shares]
    for name, table in tables.items():
        columns += [
            Column(f"{name}: verdict", f"{name}_verdict"),
            Column("share", f"{name}_share", decimals=3, show=RARE),
        ]
        for row in rows:
            its = table.loc[row[0]] if row[0] in table.index else None
            row += [None, None] if its is None else [its["verdict"], Estimate(*its[SHARE])]
    text = (
        "A share is one of its prior. Under another one that the study names, fewer values move, some of them in "
        "another range, and all others stay as the study has them."
    )
    links = [Link(f"All that is told under the prior {name}", f"{name}/report.md") for name in tables]
    return [Heading("Under other priors"), Paragraph(text), Table("priors", columns, rows), *links]


def _deciding(shares: Sequence[Shares]) -> list[Block]:
    columns = [
        Column("claim", "id"),
        Column("redrawn alone, turns it most often", "decided_by"),
        Column("how often", "flips", decimals=2),
        Column("depends most on", "best_factor"),
        Column("bit", "bits", decimals=3),
        Column("by chance", "bits_chance", decimals=3),
        Column("depends most on the pair", "best_pair"),
        Column("bit", "pair_bits", decimals=3),
        Column("associated among admissible", "associated"),
        Column("PAWN", "pawn", decimals=2),
        Column("by chance", "pawn_chance", decimals=2),
        Column("no case", "without_case", decimals=2),
        Column("chaotic", "chaotic", decimals=2),
    ]
    rows = []
    for one in shares:
        decided, flips = next(iter(one.flips.items()), (None, None))
        factor, bits = one.bits or (None, None)
        associated, pawn = one.associated or (None, None)
        first, second, together_bits = one.pair or (None, None, None)
        told = [bits and bits.value, bits and bits.p95, first and f"{first}, {second}", together_bits]
        found = [associated, pawn and pawn.value, pawn and pawn.p95, one.without_case, one.chaotic]
        rows.append([one.claim.name, decided, flips, factor, *told, *found])
    text = (
        "How often drawing one value anew, and nothing else, turns a claim, where it holds neither in nearly all "
        "reconstructions nor in hardly any; on which value, or two, it depends most, "
        "in bits (mutual information of value and verdict, with what 95 % of permutations stay below; of a pair in "
        f"{PAIR_BINS} classes each in place of {BINS}, so that it can seem to tell less than one of the two); over "
        "admissible reconstructions only association can be told (PAWN's index). *No case*: there is nothing to "
        "measure, as of a robot that does not arrive; *chaotic*: starts within a millimetre differ by more than the "
        "tolerance."
    )
    return [Heading("What decides them"), Paragraph(text), Table("deciding", columns, rows)]


def _enough(share: Estimate | None) -> Estimate | None:
    """Return a share without its interval where it is of few cases."""
    if share is None or share.n >= CASES_MIN:
        return share
    return Estimate(share.value, math.nan, math.nan, share.n)


def _factors(told: MultiverseResults, shares: Sequence[Shares], ranked: Worth) -> list[Block]:
    known, claims = {factor.name: factor for factor in told.factors}, {one.claim.name for one in shares}
    choices, at_best = told.choices, at_best_of(told, told.best) if told.best else {}
    rows = []
    for name, bits in ranked:
        factor = known.get(name)
        ends = factor.bounds if factor else choices[name]
        is_range = factor is not None and not factor.choices
        words = " to ".join(map(str, ends)) if is_range else listed(ends)
        bounds = words or f"{len(ends)} choices"
        asked = name.partition(".")[0]
        kind = factor.kind if factor else "a reading of the claim" if asked in claims else "ours"
        rows.append([name, ", ".join(factor.things) if factor else asked, bounds, at_best.get(name), kind, bits])
    columns = [
        Column("value", "factor"),
        Column("of", "things"),
        Column("from", "range"),
        Column("at best", "at_best"),
        Column("its source", "kind"),
        Column("bit, summed over the claims", "bits", decimals=3),
    ]
    text = (
        "What is drawn, and how much the verdicts of all claims depend on it; what does not exceed chance counts as "
        "nothing. *A reading of the claim* is drawn with them: a threshold, or which of several measured rows it "
        "means. *At best*: in the reconstruction that meets most printed numbers; of a group the first value, of a "
        "vector what multiplies it or is added to it, and a long choice by its number in the prior."
    )
    return [Heading("What the paper leaves open"), Paragraph(text), Table("factors", columns, rows)]


def _made(told: MultiverseResults, shares: Sequence[Shares]) -> list[Block]:
    rows, moved = told.drawn.rows, told.drawn.moved
    conditions = [entry for entry in told.claims if entry.kind == KIND]
    admissible, apart = int(told.admissible.sum()), sum(halves(told.drawn, one.claim) > 1.96 for one in shares)
    episodes, steps = int(rows["episodes"].sum()), int(rows["steps"].sum())
    seconds = float(rows["seconds"].sum())
    scrambles = rows["scramble"].nunique()
    prior = f" prior={told.prior['prior']}" if "prior" in told.prior else ""
    lines = [
        f"`navbench multiverse {told.study}{prior}` draws {scrambles} independent scrambles of a Sobol sequence, "
        f"{len(rows) // scrambles} points each, over {len(told.drawn.names)} dimensions, and runs every reconstruction "
        f"in {told.prior['simulator']}: {len(rows)} reconstructions, {episodes} episodes, {steps} robot-steps in "
        f"{seconds:.0f} s of CPU time, {steps / max(seconds, 1e-9):.0f} a second, with the claims' measures. "
        f"Seed {told.prior['seed']}.",
        f"A cell runs {told.prior['episodes'][0]} episodes, and up to {told.prior['episodes'][1]} where a claim's "
        f"interval over these does not settle it. {int((rows['possible'] == 0).sum())} reconstructions were "
        "impossible, such as a robot within a wall; no claim holds in them.",
        f"{admissible} reconstructions are admissible: {'; '.join(entry.claim.says for entry in conditions)}.",
        f"Between the two halves of the scrambles, which are independent, the share of {apart} of {len(shares)} claims "
        "differs by more than 1.96 standard errors.",
        f"Each dimension was moved alone in {int((moved['moved'] == -1).sum()) if len(moved) else 0} reconstructions, "
        "for the claims that hold neither in nearly all nor in hardly any.",
        *([TUNED] if any(choice["name"] == "tunings.seed" for choice in told.prior["choices"]) else []),
        "The prior was written down before the first reconstruction was run.",
    ]
    return [Heading("How it was made"), *map(Paragraph, lines), Link("Prior", "prior.json")]


def _curved(shares: Sequence[Shares]) -> list[Shares]:
    """Return the open claims that depend on some value: for each value the one that does most, then a second each."""
    found = [(one.bits, one) for one in shares if one.bits is not None and one.verdict == "open"]
    of_value: dict[str, list[Shares]] = {}
    for (name, null), one in sorted(found, key=lambda pair: -pair[0][1].value):
        if null.p_value < 0.01:
            of_value.setdefault(name, []).append(one)
    return [one for row in zip_longest(*of_value.values()) for one in row if one is not None]
