"""Tables and figures again, from results directories; nothing is run."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from navbench.cli.limits import check_directory
from navbench.cli.progress import UNFINISHED, complain, tell
from navbench.cli.words import sort_words
from navbench.raised import one_line
from navbench.validation import DescriptionError, instead

if TYPE_CHECKING:
    from navbench.report.reports import Written

HELP = """navbench report DIR [out=DIR]: rebuild report.md, the page report.html, tables and figures; run nothing
navbench report DIR... out=DIR: of several results directories together
navbench report join=DIR: join the reports in a directory into its README.md

  --trust                                           run measures and sections that the results name outside navbench
  --config-dir DIR                                  the folder with the study, where the results do not say it
"""
KEYS = ("out", "join")
FIGURE = ("measured", "low", "high", "n")  # columns of claims.csv
SHOWN_MAX = 12  # claims; of more it is told how many have which verdict


def report(arguments: Sequence[str]) -> int:
    """Rebuild tables and figures from results directories, or join the reports in one."""
    words = sort_words(arguments, ("--trust", "--config-dir"))
    from navbench.analysis.stored import StoredResults
    from navbench.experiments.store import Results
    from navbench.report.joined import write_joined
    from navbench.report.reports import write_report

    given: dict[str, Path] = {}
    for word in words.overrides:
        key, _, value = word.partition("=")
        if key in KEYS and not value:
            raise DescriptionError(f"{word}: must name a directory")
        if key not in KEYS:
            raise DescriptionError(f"{word}: unknown key; {instead(key, KEYS, 'allowed with report, each as KEY=DIR')}")
        given[key] = Path(value)
    if "out" in given and given["out"].exists():
        check_directory(f"out={given['out']}", given["out"])
    if "join" in given:
        if words.names or "out" in given:
            raise DescriptionError(f"join={given['join']}: stands alone; it writes into that directory")
        tell(f"report: {write_joined(given['join'])}")
        return 0
    if not words.names:
        raise DescriptionError("report: name at least one results directory")
    for name in words.names:
        check_directory(f"report {name}", Path(name))
    if len(words.names) > 1 and "out" not in given:  # the report of the first alone lies in it
        raise DescriptionError(f"report {' '.join(words.names)}: name where their report is to go, as out=DIR")
    runs = [Results(Path(name)) for name in words.names]
    study = [(run.manifest()["study"] or {}).get("name", "") for run in runs][0]
    own = len(runs) == 1 and study and not study.startswith("tune ")  # a tuning's name is no folder
    out = given.get("out", Path("results") / study if own else runs[0].path / "report")
    if "out" not in given and out.is_symlink():
        raise DescriptionError(f"{out}: is a link; name where the report is to go, as out=DIR")
    try:
        written = write_report(runs, out, trust=words.trust, config_dir=words.config_dir)
    except (AttributeError, IndexError, KeyError, TypeError) as error:  # of claims and an outline that are no study's
        raise DescriptionError(f"{' '.join(words.names)}: cannot be reported: {one_line(error)}") from None
    code = print_written(written)
    for run in runs:
        whole = run.manifest_is_whole()
        if whole is False or whole is None and run.manifest().get("checksums"):
            complain(f"{run.path}: manifest.json: changed since it was written; `navbench verify` says more")
            code = UNFINISHED
        if wanting := StoredResults(run).wanting:
            complain(f"{run.path}: {wanting}")
            code = UNFINISHED
    return code


def print_written(written: "Written") -> int:
    """Print what became of the claims, where each report lies, and what of it is not there; return a code."""
    for file in written.files:
        if file.name == "claims.csv":
            tell("\n".join(_answers(file)))
    for file in written.files:
        if file.name == "report.md":
            tell(f"report: {file} ({len(written.files)} files)")
        elif file.name == "report.html":
            tell(f"page: {file}")
    for problem in written.problems:
        complain(f"{problem}; all else is written")
    return UNFINISHED if written.problems else 0


def _answers(file: Path) -> list[str]:
    """Return a line for each claim of a report with its verdict and what was measured, or for all of many claims."""
    import pandas as pd

    from navbench.analysis.verdicts import COUNTED, verdicts_in
    from navbench.report.document import words

    table = pd.read_csv(file, keep_default_na=False, na_values={name: [""] for name in FIGURE})
    claims = table[table["kind"].isin(COUNTED)]
    said = claims["verdict"].str.replace("_", " ")
    if len(claims) > SHOWN_MAX:
        kinds = [verdict.replace("_", " ") for verdict in verdicts_in(claims)]
        return [f"{len(claims)} claims: {', '.join(f'{(said == kind).sum()} {kind}' for kind in kinds)}"]
    figures = [words(tuple(row)) for row in claims[list(FIGURE)].to_numpy(dtype=float)]
    told = zip(claims["id"], said, figures, claims["unit"], strict=True)
    return [f"{name}: {verdict}, {figure} {unit}".rstrip() for name, verdict, figure, unit in told]
