"""What mkdocs asks for while it builds the site: pages made from the code and from ``results/``, links and formulas."""

import ast
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omegaconf import MissingMandatoryValue

from navbench.analysis.verdicts import COLUMNS
from navbench.cli.catalogue import CONF, files_of
from navbench.cli.composing import Composer, composing
from navbench.experiments.columns import TABLES, Columns
from navbench.metrics import DECLARED
from navbench.sources import KINDS

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "results"
QUAD = r"\qquad"  # between formulas of one line
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
LONGEST = 80  # of a value in a table of parameters


def on_config(config: "MkDocsConfig") -> None:
    """Put the pages that are made below the ones that name them."""
    made: dict[str, list[dict[str, str]]] = {"controllers/index.md": [], "studies/README.md": []}
    for page in pages():
        index = next((name for name in made if page.startswith(name.split("/")[0]) and page != name), None)
        if index:
            made[index].append({page.removesuffix("/report.md").removesuffix(".md").partition("/")[2]: page})
    for section in config.nav or []:
        for title, entries in section.items():
            if isinstance(entries, list):
                section[title] = [_with_pages(entry, made) for entry in entries]


def _with_pages(entry: Any, made: Mapping[str, Sequence[Mapping[str, str]]]) -> Any:
    titles = {"controllers/index.md": "Controllers", "studies/README.md": "Studies"}
    return {titles[entry]: [entry, *made[entry]]} if entry in titles else entry


def on_files(files: "Files", config: "MkDocsConfig") -> None:
    """Add the pages that are made, and the pictures and tables that reports name."""
    from mkdocs.structure.files import File

    for name, text in pages().items():
        files.append(File.generated(config, name, content=text))
    for file in (RESULTS / "first_look.png", *RESULTS.glob("*/**/*.*")):
        place = file.relative_to(RESULTS).as_posix()
        if file.name != "report.md":
            files.append(File.generated(config, f"studies/{place}", abs_src_path=str(file)))


def on_page_markdown(markdown: str, page: "Page", **_: Any) -> str:
    """Let a written page's links to results lead to their pages here; those to files that only a clone has go."""
    if "/" in page.file.src_uri:
        return markdown
    return re.sub(r"\[([^]]+)\]\(\.\./[^)]*\)", r"\1", re.sub(r"\]\(\.\./results/", "](studies/", markdown))


def on_page_content(html: str, **_: Any) -> str:
    """Turn formulas into MathML, which browsers draw by themselves; those of one line that is too long wrap."""
    from latex2mathml.converter import convert

    def drawn(found: re.Match[str]) -> str:
        if found[1] == "span":
            return str(convert(found[2], display="inline"))
        return f"<div class=formulas>{''.join(convert(one, display='block') for one in found[2].split(QUAD))}</div>"

    return FORMULA.sub(drawn, html)


@cache
def pages() -> dict[str, str]:
    """Return the pages that are made: Markdown by its place in the site."""
    made = {"index.md": _index(), "metrics.md": _metrics(), "tables.md": _tables()}
    with composing() as composer:
        names = files_of("controller", [CONF])
        controllers = {name: _controller(name, title, composer) for name, title in names.items()}
    rows = [f"[`{name}`]({name}.md) | {title}" for name, title in names.items()]
    made["controllers/index.md"] = _joined("# Controllers", CONTROLLERS, _table("name | what it is", rows))
    made |= {f"controllers/{name}.md": text for name, text in controllers.items()}
    for report in (RESULTS / "README.md", *sorted(RESULTS.rglob("report.md"), key=lambda file: file.parent)):
        made[f"studies/{report.relative_to(RESULTS).as_posix()}"] = _report(report)
    return made


CONTROLLERS = """Each has a page with what it is, its picture, and where each of its parameters comes from.
`navbench show controller=NAME` draws its picture from what is installed."""


def _index() -> str:
    """Return the README with links that hold in the site."""
    readme = (ROOT / "README.md").read_text()
    return re.sub(r"\]\((?!docs/|https?:|#)", "](../", readme).replace("](docs/", "](")


def _report(file: Path) -> str:
    """Return a report, with a link to the page that plays its episodes where that is there."""
    text = file.read_text()
    if file.with_suffix(".html").is_file():
        title, _, rest = text.partition("\n")
        return f"{title}\n\n[The same as one page that plays the episodes](report.html)\n{rest}"
    return text


def _metrics() -> str:
    """Return the metrics by their declarations."""
    better = {"less": "less is better", "more": "more is better", "": ""}
    rows = [
        f"`{metric.name}` | {metric.unit} | {better[metric.better]} | {metric.definition} | {metric.source}"
        for metric in DECLARED
    ]
    return _joined("# Metrics", METRICS, _table("metric | unit | | definition | source", rows), FORMULAS)


METRICS = """One number of one robot in one episode, each declared once in `navbench/metrics.py`: what the tables,
comparisons, reports and objectives read. Yours is declared [in the same way](own-metric.md). A failed robot's numbers
are kept, up to its end, and never averaged with those of robots that reached."""

FORMULAS = r"""## Formulas

A robot follows exact arcs: in substep $j$ of length $h_j$ it drives at speed $v_j$ and turning rate $\omega_j$. Control
period $k$ has the length $\Delta_k$ and begins with the heading error $e_k$, in $(-\pi, \pi]$.

The length of the path, the total turning, the squared heading error and the mean speed up to the end $T$ are

$$L = \sum_j |v_j|\, h_j, \qquad \Theta = \sum_j |\omega_j|\, h_j, \qquad
E = \sum_k e_k^2\, \Delta_k, \qquad \bar v = \frac{L}{T}$$

and the least clearance is

$$c = \min_j \left( \min_{o} d(p_j, o) - r \right)$$

with the robot's centre $p_j$ at the end of substep $j$, its radius $r$, and the distance $d$ to the shape $o$ of
whatever stands or moves in the world, other robots too."""


def _tables() -> str:
    """Return the columns of the stored tables."""
    averaged = {metric.name: f"see [Metrics](metrics.md) [{metric.unit or '1'}]" for metric in DECLARED}
    parts = [
        f"## {kind}\n\n{TITLES[kind]}\n\n{_columns({**columns, **(averaged if kind == 'episodes' else {})})}"
        for kind, columns in TABLES.items()
    ]
    return _joined("# Tables and columns", STORED, *parts, "## claims.csv\n\nOf a study's report.", _columns(COLUMNS))


STORED = """A results directory keeps each table as Parquet files, one for each batch of work, in a folder of its
name; `episodes.csv` beside them is the table of episodes as one file. pandas reads a folder as one table:
`pd.read_parquet("DIR/trajectories")`. Rows of `latency` and `episodes` join on `run_id`, `episode` and
`robot_index`."""

TITLES = {
    "episodes": "One row per robot and episode. A metric of your own adds its column.",
    "trajectories": "One row per robot and control period. Every other column is one of the controller's trace.",
    "latency": "One row per robot and episode: how long the controller took, which is never the same twice.",
    "layouts": "One row per distinct layout that was driven.",
    "evaluations": "One row per evaluation of a tuning. Every other column is a parameter that was searched.",
    "checks": "What the best of a tuning cost when it was run again.",
}


def _columns(columns: Columns) -> str:
    return _table("column | holds", [f"`{name}` | {holds}" for name, holds in columns.items()])


def _controller(name: str, title: str, composer: Composer) -> str:
    """Return the page of a controller: its docstring, its picture, its parameters and their sources."""
    values = _composed([f"controller={name}"], composer)
    target = values["build"]["_target_"]
    spec = find_spec(target.rpartition(".")[0])
    doc = ast.get_docstring(ast.parse(Path(spec.origin).read_text())) if spec and spec.origin else ""
    place = f"media/controllers/{name}.png"
    picture = f"![What navbench show controller={name} draws](../{place})"
    drawn = picture if (ROOT / "docs" / place).is_file() else f"`navbench show controller={name}` draws it."
    file = f"`{target}`, configured in `conf/controller/{name}.yaml`."
    return _joined(
        "---\nhide: [toc]\n---",
        f"# {name}",
        f"{title}.",
        file,
        drawn,
        "## What it is",
        doc or "",
        "## Parameters and their sources",
        _table("parameter | value | source | which, or why | another reader might take", _parameters(values)),
    )


def _composed(words: Sequence[str], composer: Composer) -> Any:
    """Return a controller's values, with what only a user can give left open."""
    try:
        return composer.values("run", words).values["controller"]
    except MissingMandatoryValue as error:
        return _composed([*words, f"{error.full_key}=FILE"], composer)


def _parameters(controller: Mapping[str, Any]) -> Iterator[str]:
    """Yield a row for each source of a controller's values."""
    for key, source in (controller.get("sources") or {}).items():
        kind = next(kind for kind in KINDS if source.get(kind))
        varied = source.get("range") or source.get("choices")
        value: Any = controller
        for word in key.split("."):
            value = value.get(word, "") if isinstance(value, dict) else ""
        cells = (f"`{key}`", _shown(value), kind, source[kind], _shown(varied) if varied else "")
        yield " | ".join(str(cell).replace("|", "\\|").replace("\n", " ") for cell in cells)


def _shown(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False).replace('"', "")
    text = re.sub(r"\d+\.\d{7,}", lambda digits: f"{float(digits[0]):.6g}", text)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"


def _table(head: str, rows: Iterator[str] | Sequence[str]) -> str:
    return "\n".join((f"| {head} |", "|---" * (head.count("|") + 1) + "|", *(f"| {row} |" for row in rows)))


def _joined(*blocks: str) -> str:
    return "\n\n".join(blocks) + "\n"
