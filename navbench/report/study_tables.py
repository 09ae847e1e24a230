"""Sections of a report that are tables: printed beside measured figures, outcomes, rules, claims, findings, errata."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navbench.analysis.claims import EVIDENCE, judged, verdicts_in
from navbench.analysis.measuring import measure
from navbench.analysis.stored import StoredResults, reached
from navbench.experiments.store import write_table
from navbench.mathematics.statistics import Estimate
from navbench.report.markup import MISSING, between, latex, markdown, number, save_table
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    import pandas as pd

Select = Mapping[str, Any]
DECIMALS = {"time_s": 2, "path_length_m": 3, "mean_speed_mps": 3, "min_clearance_m": 3, "heading_ise": 3}


def printed_table(
    stored: StoredResults,
    out: Path,
    *,
    file: str,
    metric: str,
    select: Select,
    worlds: Mapping[str, str],
    printed: Mapping[str, Sequence[float | None]],
) -> str:
    """Return a paper's table with, for each entry, the printed figure, ours and the ratio of ours to it.

    Ours is the median, with the range where there are several runs, over the robots that reached; where not all
    reached, how many did stands beside it.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        metric: the metric that the table holds.
        select: which cells.
        worlds: the world behind each of the paper's columns.
        printed: the printed figures of each row, one a column; null where the paper prints none.
    """
    import pandas as pd

    decimals, raw, rows = DECIMALS.get(metric, 4), [], []
    for label, figures in printed.items():
        row = [label]
        for (title, world), figure in zip(worlds.items(), figures, strict=True):
            runs = stored.select(**select, label=label, world=world)
            values = reached(runs)[metric]
            ours, low, high = values.median(), values.min(), values.max()
            ratio = float("nan") if figure is None else ours / figure
            text = number(ours, decimals) + (f" {between(low, high, decimals)}" if low != high and len(values) else "")
            text += "" if len(values) == len(runs) else f" ({len(values)} of {len(runs)} reached)"
            row += [MISSING if figure is None else f"{figure:g}", text, number(ratio, 2)]
            raw.append([label, title, world, figure, ours, low, high, len(values), len(runs), ratio])
        rows.append(row)
    names = ["label", "where", "world", "printed", "median", "low", "high", "reached", "runs", "ratio"]
    headers = ["", *["printed", "here", "ratio"] * len(worlds)]
    return save_table(out, file, pd.DataFrame(raw, columns=names), headers, rows, dict.fromkeys(worlds, 3))


def outcomes_table(
    stored: StoredResults, out: Path, *, file: str, cells: Mapping[str, Select], worlds: Mapping[str, str]
) -> str:
    """Return for some cells and worlds how many reached, and the median time and length of those.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        cells: what each row is called, and which cells it holds.
        worlds: what each column is called, and its world.
    """
    import pandas as pd

    raw, rows = [], []
    for title, select in cells.items():
        row = [title]
        for world in worlds.values():
            runs = stored.select(**select, world=world)
            good = reached(runs)
            counts = [int((runs["outcome"] == name).sum()) for name in ("collided", "timed_out", "controller_error")]
            time_s, length_m = good["time_s"].median(), good["path_length_m"].median()
            raw.append([title, world, len(runs), len(good), *counts, time_s, length_m])
            failed = [f"{n} {word}" for n, word in zip(counts, ("collided", "timed out", "error"), strict=True) if n]
            row += [f"{len(good)} of {len(runs)}" + (f" ({', '.join(failed)})" if failed else "")]
            row += [number(time_s, 2), number(length_m, 3)]
        rows.append(row)
    names = ["cells", "world", "runs", "reached", "collided", "timed_out", "controller_error", "time_s"]
    headers = ["", *["reached", "time [s]", "length [m]"] * len(worlds)]
    table = pd.DataFrame(raw, columns=[*names, "path_length_m"])
    return save_table(out, file, table, headers, rows, dict.fromkeys(worlds, 3))


def rules(stored: StoredResults, out: Path, *, file: str, table: str) -> str:
    """Return the rules that a controller offers of itself.

    Args:
        stored: the study's results.
        out: the report's directory.
        file: the files' name.
        table: the name of the described table.
    """
    described = stored.described(table)
    headers = [name.replace("_", " ") for name in described.columns]
    return save_table(out, file, described, headers, described.astype(str).to_numpy().tolist())


def claims(stored: StoredResults, out: Path, *, groups: Mapping[str, Sequence[str]]) -> str:
    """Return every claim with its verdict, and how many there are of each verdict and evidence.

    Args:
        stored: the study's results.
        out: the report's directory.
        groups: counted apart: the claims whose ids begin with one of these.
    """
    table = judged(stored)
    counts, verdicts = [], verdicts_in(table)
    for title, beginnings in {**groups, "all claims": [""]}.items():
        chosen = table[table["id"].str.startswith(tuple(beginnings))]
        counts.append([title, *(str(int((chosen["verdict"] == verdict).sum())) for verdict in verdicts)])
    for evidence in EVIDENCE:
        chosen = table[table["evidence"] == evidence]
        if len(chosen):
            title = f"of these, evidence {evidence.replace('_', ' ')}"
            counts.append([title, *(str(int((chosen["verdict"] == verdict).sum())) for verdict in verdicts)])
    rows = []
    for claim in table.to_dict("records"):
        reason = f": {claim['reason']}" if claim["reason"] else ""
        printed = printed_figure(claim)
        words = [claim["id"], claim["statement"], claim["where"], printed, told_figure(claim), str(claim["n"])]
        words += [claim["tolerance"], claim["evidence"].replace("_", " "), claim["verdict"].replace("_", " ") + reason]
        rows.append(words)
    headers = ["id", "statement", "where", "printed", "measured", "n", "tolerance", "evidence", "verdict"]
    write_table(out / "claims.csv", table.to_csv(index=False))
    write_table(out / "tables" / "claims.tex", latex(headers, rows))
    heads = ["", *(verdict.replace("_", " ") for verdict in verdicts)]
    counted = save_table(out, "verdicts", _frame(counts, ["claims", *verdicts]), heads, counts)
    return f"{counted}\n{markdown(headers, rows)}\n[CSV](claims.csv), [LaTeX](tables/claims.tex)\n"


def findings(stored: StoredResults, out: Path, *, sentences: Sequence[Mapping[str, Any]]) -> str:
    """Return sentences whose numbers are measured.

    Args:
        stored: the study's results.
        out: the report's directory; nothing is written into it.
        sentences: each ``say`` with names in braces, and for each name, under ``with``, its measure. A name is
            written ``{x:.2f}`` (the value), ``{x:percent}``, ``{x:count}`` (held of n) or ``{x:range .2f}`` (with low
            and high).
    """
    lines = []
    for i, sentence in enumerate(sentences):
        values = {}
        for name, spec in sentence.get("with", {}).items():
            of = {key: value for key, value in spec.items() if key != "name"}
            values[name] = Told(measure(stored, spec["name"], of))
        try:
            lines.append(f"- {sentence['say'].format(**values)}\n")
        except (KeyError, ValueError, IndexError) as error:
            raise DescriptionError(f"sentences[{i}].say: {error!r} in {sentence.get('say')!r}") from None
    return "".join(lines)


class Told:
    """A measured figure that can be put into a sentence.

    Args:
        measured: the figure, or None where there was no case.
    """

    def __init__(self, measured: Estimate | None) -> None:
        self._measured = measured

    def __format__(self, form: str) -> str:
        """Return it as ``findings`` says."""
        if self._measured is None:
            return "no case"
        value, low, high, n = self._measured
        if form == "percent":
            return f"{100.0 * value:.0f} %"
        if form == "count":
            return f"{round(value * n)} of {n}"
        if form.startswith("range "):
            inner = form.removeprefix("range ")
            return f"{value:{inner}} [{low:{inner}}, {high:{inner}}]"
        return format(value, form)


def errata(stored: StoredResults, out: Path, *, items: Sequence[Mapping[str, str]]) -> str:
    """Return what a paper prints wrong or leaves open, and what is done here.

    Args:
        stored: the study's results.
        out: the report's directory; nothing is written into it.
        items: each ``where`` in the paper, ``printed`` and what is done ``here``.
    """
    return markdown(["where", "the paper", "here"], [[item["where"], item["printed"], item["here"]] for item in items])


def printed_figure(claim: Mapping[Any, Any]) -> str:
    """Return the number that a paper prints of a claim, a row of ``claims.csv``, where it prints one."""
    return MISSING if claim["printed"] != claim["printed"] else f"{claim['printed']:g} {claim['unit']}".strip()


def told_figure(claim: Mapping[Any, Any]) -> str:
    """Return what was measured of a claim, a row of ``claims.csv``, with its interval or range where it has one."""
    if not claim["n"]:
        return MISSING
    words = f"{claim['measured']:.4g}"
    return words if claim["low"] == claim["high"] else f"{words} [{claim['low']:.4g}, {claim['high']:.4g}]"


def _frame(rows: Sequence[Sequence[Any]], names: Sequence[str]) -> "pd.DataFrame":
    import pandas as pd

    return pd.DataFrame(rows, columns=list(names))
