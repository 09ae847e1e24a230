import base64
import hashlib
import json
import re
import zlib
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stored import a_cell, a_record, store

from navbench.analysis.stored import StoredResults
from navbench.records import RobotRecord
from navbench.report import html
from navbench.report.document import Block, Column, Document, Figure, Finding, Heading, Link, Paragraph, Table
from navbench.report.packed import QUANTA
from navbench.report.playback import TRAJECTORIES, playback
from navbench.report.reports import write_report

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)>'\"`${alert(3)}` & \u2028 {{ 7 * 7 }}"


class Read(HTMLParser):
    """What a page holds: its elements, its words, and the text of its scripts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.scripts: list[str] = []
        self._inside = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._inside = tag

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""

    def handle_data(self, data: str) -> None:
        (self.scripts if self._inside == "script" else self.words).append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    @property
    def data(self) -> dict[str, Any]:
        data: dict[str, Any] = json.loads(self.scripts[0])
        return data


def a_winding(rng: np.random.Generator, outcome: str = "reached", states: int = 600) -> RobotRecord:
    """Return a long record that deflates as badly as a noisy run's."""
    record = a_record(outcome)
    t_s = 0.05 * np.arange(states)
    w_radps = np.round(rng.normal(0.0, 0.5, states), 3)
    heading = np.cumsum(w_radps) * 0.05
    v_mps = 0.15 + 0.01 * rng.normal(size=states)
    x, y = (np.cumsum(v_mps * part) * 0.05 for part in (np.cos(heading), np.sin(heading)))
    traces = np.column_stack([rng.integers(0, 2, states), heading, 3.0 - x, w_radps > 0.5, 0.0 * t_s])
    traces[-1] = np.nan
    return record._replace(states=np.column_stack([t_s, x, y, heading, v_mps, w_radps]), traces=traces)


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> StoredResults:
    """A cell of 260 long episodes, of which every 20th failed."""
    rng = np.random.default_rng(1)
    records = [a_winding(rng, "reached" if i % 20 else "collided") for i in range(260)]
    return store(tmp_path_factory.mktemp("many"), [(a_cell("A"), records)])


def page_of(stored: StoredResults, out: Path) -> str:
    write_report([stored.results], out)
    return (out / "report.html").read_text("utf-8")


@pytest.fixture(scope="module")
def page(many: StoredResults, tmp_path_factory: pytest.TempPathFactory) -> str:
    return page_of(many, tmp_path_factory.mktemp("page"))


def test_a_page_of_200_trajectories_is_one_file_of_at_most_2_mb(page: str) -> None:
    assert len(page.encode()) <= 2_000_000
    data = Read(page).data
    assert len(data["episodes"]) == TRAJECTORIES
    assert "Played here: 200 of 260 trajectories, 13 of the 13 that failed" in page


def test_failures_are_played_first_and_the_others_evenly(many: StoredResults) -> None:
    episodes = [episode["episode"] for episode in playback(many).data["episodes"]]
    assert sorted(episodes[:13]) == list(range(0, 260, 20))
    assert np.ptp(np.histogram(episodes[13:77], 4, (0, 260))[0]) <= 2


def test_less_room_takes_coarser_states_and_then_fewer_episodes_and_says_so(many: StoredResults) -> None:
    full = playback(many, budget=10**7)
    assert "one state in" not in full.note
    size = len(full.data["states"])
    coarse = playback(many, budget=size // 3)
    assert len(coarse.data["states"]) <= size // 3
    assert len(coarse.data["episodes"]) == TRAJECTORIES
    assert re.search(r"one state in [248]\b", coarse.note)
    few = playback(many, budget=size // 40)
    assert 1 <= len(few.data["episodes"]) < TRAJECTORIES / 2
    assert "one state in 8" in few.note


def test_unpacked_states_are_within_half_a_quantum_and_whole_traces_exact(many: StoredResults) -> None:
    data = playback(many, budget=10**7).data
    planes = np.frombuffer(zlib.decompress(base64.b64decode(data["states"])), np.uint8)
    numbers = np.ascontiguousarray(planes.reshape(4, -1).T).view("<i4").ravel()
    first = data["episodes"][0]
    of_run = many.results.trajectories("a-plain-printed--1")
    driven = of_run[of_run["episode"] == first["episode"]]
    robot, place = first["robots"][0], 0
    for name, quantum in QUANTA.items():
        column = np.cumsum(numbers[place : place + robot["n"]]) * quantum
        assert np.abs(column - driven[name]).max() <= 0.5001 * quantum
        place += robot["n"]
    for name, low, quantum in robot["traces"]:
        column = np.cumsum(numbers[place : place + robot["n"]])
        assert column[-1] == 0, "the end has no trace"
        error = np.abs(low + (column[:-1] - 1) * quantum - driven[name].to_numpy()[:-1]).max()
        assert error == 0.0 if name == "behavior" else error <= 0.5001 * quantum
        place += robot["n"]


def test_recorded_ranges_reach_the_page_within_half_a_millimetre(tmp_path: Path) -> None:
    record = a_record(ranges_m=np.array([[0.5, 1.2345], [0.25, 2.0], [0.0, 0.1], [0.4999, 0.3]]))
    data = playback(store(tmp_path, [(a_cell(), [record])])).data
    planes = np.frombuffer(zlib.decompress(base64.b64decode(data["states"])), np.uint8)
    numbers = np.ascontiguousarray(planes.reshape(4, -1).T).view("<i4").ravel()
    (robot,) = data["episodes"][0]["robots"]
    assert robot["sensors"] == 2
    columns = numbers[-2 * robot["n"] :].reshape(2, -1).cumsum(axis=1)
    assert columns[:, -1].tolist() == [0, 0], "at the end nothing is read"
    np.testing.assert_allclose((columns[:, :-1].T - 1) * 1e-3, record.ranges_m, atol=0.5001e-3)


def test_what_users_wrote_stays_text_in_the_page(tmp_path: Path) -> None:
    cell = a_cell(HOSTILE)._replace(run_id="hostile", name=HOSTILE)
    record = a_record("controller_error", reason=HOSTILE, traceback=f"Traceback\n{HOSTILE}")
    page = page_of(store(tmp_path / "in", [(cell, [record, a_record()])]), tmp_path / "out")
    read = Read(page)
    assert [attributes.get("type") for tag, attributes in read.elements if tag == "script"] == [
        "application/json",
        None,
    ]
    assert not [name for _, attributes in read.elements for name in attributes if name.startswith("on")]
    assert all(str(of["src"]).startswith("data:image/png") for tag, of in read.elements if tag == "img")
    assert read.data["cells"][0]["label"] == HOSTILE
    assert " ".join(HOSTILE.split()) in read.text
    assert "49" not in read.text[read.text.index("<img src=x") :][: len(HOSTILE)]


def test_what_a_terminal_obeys_is_shown_in_the_page_as_a_symbol(tmp_path: Path) -> None:
    cell = a_cell("clear \x1b[2J and \x07\r")._replace(run_id="loud")
    page = page_of(
        store(tmp_path / "in", [(cell, [a_record("controller_error", reason="\x1b]0;x\x07")])]), tmp_path / "out"
    )
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f]", page)
    assert "clear \u241b[2J and \u2407" in page
    assert "\u241b]0;x\u2407" in page


def test_a_page_needs_nothing_beside_itself_and_runs_no_other_script(page: str) -> None:
    read = Read(page)
    assert not [tag for tag, _ in read.elements if tag in ("link", "iframe", "object", "embed", "base", "form")]
    assert not re.search(
        r"url\(|@import|https?:(?!//www\.w3\.org/2000/svg)", page[: page.index("<body")] + read.scripts[1]
    )
    allowed = base64.b64encode(hashlib.sha256(read.scripts[1].encode()).digest()).decode()
    policy = next(of["content"] for tag, of in read.elements if of.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None
    assert f"script-src 'sha256-{allowed}'" in policy
    assert policy.startswith("default-src 'none'")


def test_a_page_is_the_same_bytes_again(many: StoredResults, page: str, tmp_path: Path) -> None:
    assert page_of(StoredResults(many.results), tmp_path) == page


def test_findings_stand_before_all_else_and_tables_keep_their_intervals(tmp_path: Path) -> None:
    figures = {"share": Figure("90 %", 0.9, 0.8, 0.95, 40)}
    columns = [Column("name"), Column("share", decimals=2), Column("n")]
    table = Table("t", columns, [["x", (0.5, 0.25, 0.75, 8), 3], ["y", None, 12]])
    blocks: list[Block] = [
        Heading("Before"),
        table,
        Heading("Findings"),
        Finding("It holds in {share} **of them**.", figures),
    ]
    text = html.render(Document("Title", blocks, "What *this* is."), tmp_path)
    assert text.index("It holds in 90 % <strong>of them</strong>.") < text.index("What <em>this</em> is.")
    assert text.index("What <em>this</em> is.") < text.index(">Before</h2>")
    assert "<dt>share</dt><dd>0.9 [0.8, 0.95] of 40</dd>" in text
    assert 'data-sort="0.5"' in text
    assert "0.50 [0.25, 0.75]" in text
    assert "--begin:25.0;--width:50.0;--value:50.0" in text


def test_a_claim_opens_to_all_that_its_csv_file_says(tmp_path: Path) -> None:
    of = {"metric": "time_s", "cell": "printed", "label": "F", "world": "plain"}
    claim = {"says": "F's time & more", "where": "Table 1", "within": "5 %", "measure": "median", "of": of}
    claims = {"time-f": {**claim, "printed": "10 s"}, "other": {**claim, "printed": "99 s"}}
    study = {"name": "s", "title": "S", "claims": claims, "report": ["verdicts"]}
    page = page_of(store(tmp_path / "in", [(a_cell("F"), [a_record()])], study), tmp_path / "out")
    assert "1 reproduced 1 not reproduced" in Read(page).text
    assert '<span class="verdict v-not-reproduced">not reproduced</span>' in page
    row = page[page.index("time-f</td>") :].split("</tr>")[0]
    assert "<summary>F&#39;s time &amp; more</summary>" in row
    assert "<dt>evidence</dt><dd>selected</dd>" in row
    assert "<dt>because</dt><dd>plain.boxes fitted in plain</dd>" in row


def test_a_study_s_words_for_its_trace_reach_the_page(tmp_path: Path) -> None:
    series = {"name": "time_series", "panels": {"A": {"label": "A"}}, "series": {"doing": {"behavior": "b"}}}
    outline = [{**series, "ticks": {"doing": {"going": 0.0, "following": 1.0}}}]
    study = {"name": "s", "title": "S", "report": outline}
    data = playback(store(tmp_path, [(a_cell("A"), [a_record()])], study)).data
    assert data["cells"][0]["words"] == {"behavior": {"0": "going", "1": "following"}}


def test_a_controller_names_its_trace_s_values_and_one_outside_only_where_it_is_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "told.py").write_text("class Mine:\n    trace_words = {'behavior': ('rest', 'go')}\n")
    monkeypatch.syspath_prepend(tmp_path)
    words = []
    for i, target in enumerate(("told.Mine", "told.Gone", "navbench.controllers.aouf2019.sflc.Sflc")):
        stored = store(tmp_path / str(i), [(a_cell("A", _target_=target), [a_record()])])
        words.append([playback(stored, trust).data["cells"][0]["words"] for trust in (False, True)])
    ours = {"behavior": {"0": "go to goal", "1": "follow wall"}}
    assert words == [[{}, {"behavior": {"0": "rest", "1": "go"}}], [{}, {}], [ours, ours]]


def test_links_lead_to_pages_and_to_no_script() -> None:
    document = Document("", [Link("Other", "other/report.md"), Paragraph("[a](javascript:alert(1)) [b](t.csv)")])
    text = html.render(document, Path())
    assert '<a href="other/report.html">Other</a>' in text
    assert '<a href="t.csv">b</a>' in text
    assert 'href="javascript' not in text


def test_results_without_trajectories_have_a_page_with_their_failures(tmp_path: Path) -> None:
    stored = store(tmp_path / "in", [(a_cell("A"), [a_record(), a_record("collided", reason="hit the wall")])])
    for part in (tmp_path / "in/trajectories").iterdir():
        part.unlink()
    text = Read(page_of(stored, tmp_path / "out")).text
    assert "Played here: 0 of 2 trajectories, 0 of the 1 that failed" in text
    assert "hit the wall" in text


def test_trajectories_that_cannot_be_read_cost_the_player_alone(tmp_path: Path) -> None:
    stored = store(tmp_path / "in", [(a_cell("A"), [a_record()])])
    part = next((tmp_path / "in/trajectories").iterdir())
    part.write_bytes(part.read_bytes()[:100])
    written = write_report([stored.results], tmp_path / "out")
    assert any("report.html plays no episodes" in problem for problem in written.problems)
    assert "Results of one cell" in (tmp_path / "out/report.html").read_text("utf-8")
