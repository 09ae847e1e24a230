"""What the README and the pages tell a reader to type works, word for word, in the order of the page."""

import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest
from browser import CHROMIUM, Browser
from commands import Command, typed
from pages import PAGES, ROOT, blocks_of, write_files

from navbench.experiments.columns import TABLES
from navbench.experiments.parts import KINDS
from navbench.metrics import DECLARED

SLOW = {page.stem: [line for b in blocks_of(page) if b.mark == "slow" for line in b.commands] for page in PAGES}

FEW = ("n=128", "decide=16", "search=32", "workers=2")  # of a multiverse: as a reader types it, it takes hours


@pytest.fixture(autouse=True)
def _forgotten(tmp_path: Path) -> Iterator[None]:
    """A reader's own modules lie in a folder of each page's own: none is remembered."""
    yield
    for name, module in list(sys.modules.items()):
        if any(
            str(place).startswith(str(tmp_path)) for place in (getattr(module, "__path__", None) or [_file(module)])
        ):
            del sys.modules[name]


def _file(module: object) -> str:
    return str(getattr(module, "__file__", ""))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_of_a_page_works(
    page: Path, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)  # processes would take longer to begin than to run what is shown
    write_files(page, tmp_path)
    for block in blocks_of(page):
        for line in [] if block.mark else block.commands:
            done = typed(command, tmp_path, line)
            assert done.code == 0, f"{line}: {done.err}"
            assert "controller_error" not in done.out
            assert block.language == "sh" or block.printed in done.out, f"{line} prints {done.out}"


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page, lines in SLOW.items() if lines])
def test_the_commands_of_a_page_that_take_long_work_one_after_the_other(page: str, command: Command) -> None:
    for line in SLOW[page]:
        words = shlex.split(line, comments=True)[1:]
        done = command(*words, *(FEW if words[0] == "multiverse" else ()))
        assert done.code == 0, f"{line}: {done.err}"


def test_hardly_any_command_is_left_out() -> None:
    left = [line for page in PAGES for block in blocks_of(page) if block.mark == "not run" for line in block.commands]
    assert [line.split("#")[0].strip() for line in left] == [
        "make run",
        "source .venv/bin/activate",
        "make run",
        "make test",
        "navbench study aouf2019 engine=dask workers=4",
        "navbench study aouf2019 engine=dask engine.address=tcp://head:8786",
        "navbench study aouf2019 engine=slurm engine.partition=cpu engine.time_min=30 engine.mem_gb=2 workers=100",
        "docker build --tag navbench --file containers/Dockerfile .",
        'docker run --rm --read-only --tmpfs /tmp --user "$(id -u):$(id -g)" --volume "$PWD:/work" navbench '
        "controller=sflc world=deadlock",
        "apptainer build navbench.sif containers/navbench.def",
        "apptainer run navbench.sif controller=sflc world=deadlock",
    ]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_local_link_leads_to_a_file_of_the_repository(page: Path) -> None:
    """Of the places in pages that links name, the site's own builder checks whether they are there."""
    links = re.findall(r"\]\(([^)#\s]+)|\b(?:src|href)=\"([^\"#]+)", page.read_text())
    local = [link for link in map("".join, links) if not link.startswith(("http:", "https:", "mailto:"))]
    assert [link for link in local if not (page.parent / link).exists()] == []


def test_the_comparison_that_a_page_shows_is_the_one_that_its_commands_make(command: Command, tmp_path: Path) -> None:
    page = ROOT / "docs/compare.md"
    shown = re.findall(r"^\| (?:sflc|pid) \| \d+ of .*$", page.read_text(), re.M)
    assert len(shown) == 2
    for line in blocks_of(page)[0].commands:
        assert typed(command, tmp_path, line).code == 0
    made = (tmp_path / "compared/report.md").read_text().splitlines()
    head = made[made.index(shown[0]) - 2]
    assert set(shown) <= set(made)
    assert head in page.read_text().splitlines()


def test_the_numbers_of_aouf2019_that_a_page_shows_are_those_of_its_tables() -> None:
    tables = ROOT / "results/aouf2019/tables"
    names = ("table_3", "table_4_early", "readings")
    printed, early, gains = (pd.read_csv(tables / f"{name}.csv").to_dict("records") for name in names)
    times = {(row["label"], row["world"]): row["printed"] for row in printed}
    fitted = {(row["cells"], row["world"]): row["time_s"] for row in gains}
    paths = {(row["label"], row["world"]): (row["printed"], row["median"]) for row in early}
    page = (ROOT / "docs/reproduce.md").read_text()
    for label in ("PSO-PID", "ABC-PID", "FA-PID"):
        row = "| {} | {:g} | {:.3f}".format(label, *paths[label, "no_deadlock"])
        for world in ("deadlock", "corner"):
            row += f" | {times[label, world]:g} | {fitted[f'{label}, gains fitted', world]:.2f}"
        assert f"{row} |" in page.splitlines()


def test_the_ranges_of_papers_that_a_page_shows_are_those_of_its_report() -> None:
    report = (ROOT / "results/papers/report.md").read_text()
    finding = next(line for line in report.splitlines() if line.startswith("- With exact ranges"))
    counts = [(int(few), int(all_)) for few, all_ in re.findall(r"(\d+) of (\d+)", finding)]
    assert len(counts) == 12  # at home and away, of six controllers
    home, away = ([round(100 * few / all_) for few, all_ in counts[first::2]] for first in (0, 1))
    page = (ROOT / "docs/reproduce.md").read_text()
    assert f"{min(home)} to {max(home)} % of the episodes in a controller's own paper's worlds succeed" in page
    assert f"and {min(away)} to {max(away)} % in the other papers'" in page


def test_every_column_that_is_stored_is_described(command: Command, tmp_path: Path) -> None:
    words = ("controller=pid", "tuner=random", "world=corner", "budget=10", "simulator=planar", "workers=1")
    assert command("tune", *words, "record=ranges", "hydra.run.dir=tuned").code == 0
    others = {"episodes": {metric.name for metric in DECLARED}, "evaluations": {"kp", "ki", "kd"}}
    for kind in TABLES:
        for part in (tmp_path / "tuned" / kind).glob("part-*.parquet"):
            more = set(pq.read_schema(part).names) - set(TABLES[kind])
            assert set(TABLES[kind]) <= set(pq.read_schema(part).names), kind
            assert kind == "trajectories" or more == others.get(kind, set()), kind  # there they are the trace's
    episodes = pd.read_csv(tmp_path / "tuned/episodes.csv")
    assert set(episodes) == {*TABLES["episodes"], *(metric.name for metric in DECLARED)}


def test_a_described_table_is_one_that_is_stored() -> None:
    assert set(KINDS) - set(TABLES) == {"descriptions"}  # whose columns are the controller's
    assert set(TABLES) <= set(KINDS)


def test_the_pages_that_are_made_have_every_metric_column_controller_and_study() -> None:
    from generate import pages

    from navbench.cli.catalogue import CONF, files_of

    made = pages()
    assert all(f"| `{metric.name}` | {metric.unit} |" in made["metrics.md"] for metric in DECLARED)
    assert all(f"| `{name}` |" in made["tables.md"] for columns in TABLES.values() for name in columns)
    for name in files_of("controller", [CONF]):
        assert f"controllers/{name}.md" in made
    assert "| `build.oa_rules` | {vL: {S: {RB: PB" in made["controllers/oa_to.md"]
    assert "| paper | Table 1 |" in made["controllers/oa_to.md"]
    assert {page for page in made if page.startswith("studies/")} == {
        f"studies/{report.relative_to(ROOT / 'results').as_posix()}"
        for report in (ROOT / "results").rglob("*.md")
        if report.name in ("README.md", "report.md")
    }


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built without a warning."""
    pytest.importorskip("mkdocs")
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    folder = tmp_path_factory.mktemp("site")
    build(load_config(str(ROOT / "mkdocs.yml"), site_dir=str(folder), strict=True))
    return folder


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.parametrize("page", ["index", "metrics", "look", "controllers/sflc", "studies/zhao2017/report"])
def test_a_page_fits_a_phone_and_the_keyboard_reaches_what_scrolls(page: str, site: Path, tmp_path: Path) -> None:
    browser = Browser(tmp_path, 390, 844)
    try:
        browser.open(site / f"{page}.html", "document.querySelector('.md-search[aria-label]')")
        assert browser.ask("document.documentElement.scrollWidth") == 390
        scrolls = "[...document.querySelectorAll('.md-content *')].filter(e => e.scrollWidth > e.clientWidth + 1 && "
        scrolls += "['auto', 'scroll'].includes(getComputedStyle(e).overflowX))"
        browser.wait(f"{scrolls}.every(e => e.tabIndex === 0 || e.querySelector('a, button'))")
        assert not browser.errors
    finally:
        browser.close()


def test_the_site_asks_no_network(site: Path) -> None:
    for page in site.glob("*.html"):
        loaded = re.findall(r'<(?:script|img|iframe)[^>]* src="([^"]+)|<link[^>]* href="([^"]+)', page.read_text())
        assert not [link for found in loaded for link in found if link.startswith(("http", "//"))], page.name
    assert "<math" in (site / "statistics.html").read_text()
    assert "arithmatex" not in (site / "statistics.html").read_text()


def test_the_pictures_are_small() -> None:
    sizes = [file.stat().st_size for file in (ROOT / "docs/media").rglob("*.png")]
    assert max(sizes) <= 150_000
    assert sum(sizes) <= 1_500_000
    assert (ROOT / "docs/media/failure.mp4").stat().st_size <= 2_000_000
