"""The page that joins several reports, and the sections in which every controller meets every world."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from commands import Command
from stored import a_cell, a_record, store, told
from test_reports import CLAIM, STUDY

from navbench.analysis.stored import StoredResults
from navbench.report.crossing import crossed_tables, success_map
from navbench.report.joined import read_claims, read_study, write_joined
from navbench.report.reports import write_report
from navbench.report.shares import read_shares
from navbench.validation import DescriptionError

GROUPS = {"one paper": ["plain"], "another": ["other"]}


def a_report(
    folder: Path, name: str, claims: dict[str, dict[str, Any]], errata: list[dict[str, str]], **more: dict[str, Any]
) -> Path:
    """Write a small study's report into a folder of its name."""
    cells = [(a_cell("F"), [a_record(time_s=10.0)]), (a_cell("G"), [a_record(), a_record("collided")])]
    report: list[dict[str, Any]] = [{"name": "verdicts", "title": "Claims"}] if claims else []
    report += [{"name": "errata", "title": "Errata", "items": errata}] if errata else []
    report += [{"name": "sources", "title": "Sources", "file": "sources"}]
    study = {
        **STUDY,
        "name": name,
        "title": f"{name}: a title",
        "claims": claims,
        "checks": {},
        "questions": {},
        **more,
        "report": report,
    }
    write_report([store(folder / "raw" / name, cells, study).results], folder / "results" / name)
    return folder / "results" / name


@pytest.fixture
def joined(tmp_path: Path) -> Path:
    """A folder with three reports: two of papers, one without claims and errata."""
    wrong = {"where": "eq. 1", "printed": "a | b", "here": "c"}
    statement = {key: value for key, value in CLAIM.items() if key not in ("printed", "within")}
    claims = {
        "time-f": CLAIM,
        "off": {**CLAIM, "printed": "20 s"},
        "off-absolute": {**CLAIM, "printed": "8.5 s", "within": 0.25},
        "said": {**statement, "holds": "in 95 % of the cases", "measure": "share_reached", "of": {"label": "G"}},
    }
    a_report(tmp_path, "all", {}, [])
    asked = {key: CLAIM[key] for key in ("says", "measure", "of")}
    a_report(tmp_path, "one1999", claims, [wrong], checks={"copied": CLAIM}, questions={"open": asked})
    a_report(tmp_path, "two2001", {"near": {**CLAIM, "printed": "10.8 s"}}, [{**wrong, "where": "Table 7"}])
    return tmp_path / "results"


def rows_of(text: str, heading: str) -> list[list[str]]:
    """The rows of the tables under a heading, without their heads."""
    part = text[text.index(f"## {heading}\n") :].split("\n## ")[0]
    lines = [re.split(r"(?<!\\)\|", line)[1:-1] for line in part.splitlines() if line.startswith("|")]
    return [[word.strip() for word in line] for line in lines if not set(line[0].strip()) <= {"-"}]


def test_the_page_has_a_paragraph_and_a_link_for_each_study_those_of_papers_first(joined: Path) -> None:
    text = write_joined(joined).read_text()
    assert re.findall(r"\[Report\]\((.*)\)", text) == ["one1999/report.md", "two2001/report.md", "all/report.md"]
    assert all((joined / link).is_file() for link in re.findall(r"\]\(([^)]+)\)", text))
    assert (
        "## one1999: a title\n\nIt is small. 4 claims: 1 reproduced, 0 partly, 3 not reproduced, 0 not testable."
        in text
    )
    assert "## all: a title\n\nIt is small. [Report]" in text


def test_the_first_findings_stand_below_a_study_s_paragraph(tmp_path: Path) -> None:
    path = a_report(tmp_path, "one1999", {"time-f": CLAIM}, [])
    file = path / "findings.json"
    kept = json.loads(file.read_text())
    file.write_text(json.dumps({**kept, "findings": [{"text": word, "figures": {}} for word in "abcd"]}))
    text = write_joined(path.parent).read_text()
    assert "[Report](one1999/report.md)\n\n- a\n- b\n- c\n\n## Claims by verdict" in text


def test_claims_are_counted_by_study_and_by_evidence(joined: Path) -> None:
    rows = rows_of(write_joined(joined).read_text(), "Claims by verdict")
    assert ["one1999", "1", "0", "3", "0", "4"] in rows
    assert ["two2001", "0", "1", "0", "0", "1"] in rows
    assert rows.count(["all", "1", "1", "3", "0", "5"]) == 2
    assert ["selected", "1", "1", "3", "0", "5"] in rows  # checks and questions count nowhere
    assert ["fitted", "0", "0", "0", "0", "0"] in rows


def test_claims_that_fare_otherwise_in_the_planar_simulator_stand_in_one_list(joined: Path) -> None:
    assert "planar" not in write_joined(joined).read_text()
    planar = read_claims(joined / "one1999/claims.csv")
    other = planar["id"] == "off"
    planar["verdict"], planar["measured"] = (
        planar["verdict"].mask(other, "partly"),
        planar["measured"].mask(other, 18.2),
    )
    (joined / "one1999/planar").mkdir()
    planar.to_csv(joined / "one1999/planar/claims.csv", index=False)
    rows = rows_of(write_joined(joined).read_text(), "With every cell in the planar simulator")
    assert ["one1999", "4", "3", "82 %", "1"] in rows
    assert [row[:2] + row[3:] for row in rows if len(row) == 6][1:] == [
        ["one1999", "off", "20 s", "not reproduced: 10", "partly: 18.2"]
    ]


def test_every_claim_that_was_not_reproduced_stands_in_one_list(joined: Path) -> None:
    rows = rows_of(write_joined(joined).read_text(), "What was not reproduced")[1:]
    assert [row[:2] for row in rows] == [["one1999", "off"], ["one1999", "off-absolute"], ["one1999", "said"]]
    assert rows[0][3:] == ["20 s", "10", "off by -50 %; tolerance ±5 %", "selected"]
    assert rows[1][3:] == ["8.5 s", "10", "off by +1.5; tolerance ±0.25", "selected"]
    assert rows[2][3] == "–"
    assert rows[2][5:] == ["holds in 50 %; tolerance in 95 % of the cases", "selected"]


def test_the_errata_of_all_papers_stand_in_one_list(joined: Path) -> None:
    rows = rows_of(write_joined(joined).read_text(), "What the papers print wrong or leave open")[1:]
    assert rows == [["one1999", "eq. 1", "a \\| b", "c"], ["two2001", "Table 7", "a \\| b", "c"]]


def test_the_command_writes_the_page_without_pybullet_and_the_same_bytes(joined: Path, command: Command) -> None:
    done = command("report", "join=results")
    assert (done.code, done.out) == (0, "report: results/README.md\n"), done.err
    first = (joined / "README.md").read_bytes()
    code = (
        "import sys\n"
        "for name in ('pybullet', 'hydra', 'omegaconf'): sys.modules[name] = None\n"
        "from pathlib import Path\n"
        "from navbench.report.joined import write_joined\n"
        "write_joined(Path(sys.argv[1]))\n"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "12345"}
    subprocess.run([sys.executable, "-c", code, str(joined)], check=True, env=environment)
    assert (joined / "README.md").read_bytes() == first


def test_what_the_multiverses_say_stands_in_one_table(joined: Path) -> None:
    tables = {
        "shares": "id,verdict,here,at_best,share\na,robust,reproduced,yes,1.0\nb,open,not reproduced,yes,0.5\n"
        "c,open,supported,no,0.4\nd,out of reach,partly,no,0.0\n",
        "together": "id,printed,holds,predicts\na,1 s,yes,no\nb,2 s,no,no\nc,3 s,yes,no\nd,6 m,yes,\n",
        "factors": "factor,bits\nsflc.speed,1.234\nsflc.turn,0.5\n",
    }
    for study, names in (("one1999", tables), ("two2001", ["shares"])):
        (joined / study / "multiverse/tables").mkdir(parents=True)
        for name in names:
            (joined / study / f"multiverse/tables/{name}.csv").write_text(tables[name])
    _, one, two = rows_of(write_joined(joined).read_text(), "In how many reconstructions they hold")
    assert one == ["one1999", "2", "2", "2 of 3", "1", "2", "0", "1", "0", "`sflc.speed`, 1.23 bit"]
    assert two == ["two2001", "2", "–", "none printed", "1", "2", "0", "1", "0", "–"]
    (joined / "one1999/multiverse/tables/factors.csv").write_text("factor,bits\nsflc.speed,0.0\n")
    assert rows_of(write_joined(joined).read_text(), "In how many reconstructions they hold")[1][-1] == "–"
    (joined / "one1999/multiverse/tables/factors.csv").write_text("factor,bits\nsflc.speed,many\n")
    with pytest.raises(DescriptionError, match=r"factors\.csv: must have columns factor of words and bits of numbers"):
        write_joined(joined)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("id,what\na,1\n", "must have columns id and verdict of words and share of numbers"),
        ("id,verdict,share\na,robust,much\n", "must have columns id and verdict of words and share of numbers"),
        ("id,verdict,share\na,evil,0.5\n", "verdict=evil; allowed: "),
    ],
)
def test_a_table_of_shares_that_was_meddled_with_is_refused(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables/shares.csv").write_text(text)
    with pytest.raises(DescriptionError, match=f"tables/shares.csv: {said}"):
        read_shares(tmp_path)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["join=nowhere"], "join=nowhere: there is no such directory"),
        (["join=empty"], "join=empty: no study's report in it"),
        (["join=results", "out=elsewhere"], "join=results: stands alone"),
        (["join=results", "results"], "join=results: stands alone"),
        (["join="], "join=: must name a directory"),
        (
            ["joined=results"],
            "joined=results: unknown key; did you mean join? allowed with report, each as KEY=DIR: out, join",
        ),
    ],
)
def test_a_wrong_joining_is_refused_in_one_line(
    words: list[str], message: str, tmp_path: Path, command: Command
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "results").mkdir()
    done = command("report", *words)
    assert done.code == 2
    assert done.err.startswith("navbench: ")
    assert message in done.err
    assert len(done.err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    "content", ["{", "[]", '{"title": "a"}', '{"title": "a", "summary": "", "findings": [1], "errata": []}']
)
def test_findings_that_are_no_reports_are_named_with_what_to_do(content: str, joined: Path) -> None:
    (joined / "one1999/findings.json").write_text(content)
    with pytest.raises(DescriptionError, match=r"one1999/findings\.json.*navbench report outputs/study/one1999"):
        write_joined(joined)
    assert not (joined / "README.md").exists()


def test_a_report_that_is_missing_is_named(joined: Path) -> None:
    (joined / "two2001/report.md").unlink()
    with pytest.raises(DescriptionError, match=r"two2001/report\.md: missing"):
        write_joined(joined)


@pytest.mark.parametrize(
    ("there", "wrong", "message"),
    [
        ("not_reproduced", "maybe", "verdict=maybe of off; allowed: reproduced"),
        (",selected", ",guessed", "evidence=guessed of time-f; allowed: free"),
        ("statement,where", "where,statement", "its columns must be id, kind, statement, where"),
    ],
)
def test_a_table_of_claims_that_was_meddled_with_is_refused(there: str, wrong: str, message: str, joined: Path) -> None:
    file = joined / "one1999/claims.csv"
    file.write_text(file.read_text().replace(there, wrong))
    with pytest.raises(DescriptionError, match=f"claims.csv: {message}"):
        read_claims(file)


def test_a_table_of_claims_that_was_written_before_some_columns_is_read(joined: Path) -> None:
    file = joined / "one1999/claims.csv"
    table = pd.read_csv(file, dtype=str)
    table.drop(columns=["kind", "simulator", "because", "depends_on", "plausible_low", "plausible_high"]).to_csv(
        file, index=False
    )
    old = read_claims(file)
    assert old["kind"].tolist() == ["claim"] * len(table)
    assert old["printed"].tolist() == table["printed"].fillna("").tolist()


def test_an_empty_table_of_claims_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "claims.csv").write_text("")
    with pytest.raises(DescriptionError, match=r"claims\.csv: \S.*") as refused:
        read_claims(tmp_path / "claims.csv")
    assert "\n" not in str(refused.value)


def test_findings_keep_title_summary_and_errata(joined: Path) -> None:
    kept = json.loads((joined / "one1999/findings.json").read_text())
    assert (kept["title"], kept["summary"]) == ("one1999: a title", "It is small.")
    assert kept["errata"] == [{"where": "eq. 1", "printed": "a | b", "here": "c"}]
    assert read_study(joined / "all").errata == []


@pytest.fixture
def crossed(tmp_path: Path) -> StoredResults:
    """Two controllers in two worlds: F alone in one, in the other in pairs, of which one half fails."""
    pair = [a_record(time_s=12.0), a_record("collided", 1.0, 0.2)._replace(robot_index=1)]
    cells = [
        (a_cell("F", "plain"), [a_record(time_s=10.0), a_record(time_s=20.0), a_record("timed_out", 60.0, 9.0)]),
        (a_cell("G", "plain"), [a_record("collided", 1.0, 0.1)] * 3),
        (a_cell("F", "other"), [a_record(time_s=11.0)] * 2),
        (a_cell("G", "other"), [a_record(time_s=13.0)] * 2),
    ]
    reading = store(tmp_path / "in", cells)
    pairs = [(0, pair[0]), (0, pair[1]), (1, pair[0]), (1, pair[0]._replace(robot_index=1))]
    reading.results.write_batch(cells[2][0], range(2), pairs)
    return StoredResults(reading.results)


def test_a_fleet_succeeds_as_one_case_and_its_robots_give_the_medians(crossed: StoredResults, tmp_path: Path) -> None:
    text = told(crossed_tables, crossed, tmp_path, file="c", select={"name": "printed"}, groups=GROUPS)
    assert "| one paper | plain | 2 of 3 [0.09, 0.99] | 0 of 3 [0.00, 0.71] |" in text
    assert "| another | other | 1 of 2 [0.01, 0.99] | 2 of 2 [0.16, 1.00] |" in text
    assert "| one paper | plain | 15.0 (2 of 3) | – |" in text
    assert "| another | other | 12.0 (3 of 4) | 13.0 (2 of 2) |" in text
    whole = pd.read_csv(tmp_path / "tables/c.csv").query("world == 'other' and label == 'F'")
    assert whole[["success", "reached", "robots", "time_s"]].to_numpy().tolist() == [[0.5, 3, 4, 12.0]]
    table = pd.read_csv(tmp_path / "tables/c.csv")
    assert table[["success", "episodes"]].to_numpy().tolist() == [[pytest.approx(2 / 3), 3], [0, 3], [0.5, 2], [1, 2]]


def test_the_picture_holds_every_share_in_percent_and_frames_the_home(crossed: StoredResults, tmp_path: Path) -> None:
    panels = {"panel 1": {"name": "printed"}}
    told(success_map, crossed, tmp_path, file="m", panels=panels, groups=GROUPS, home={"F": "another"})
    drawn = (tmp_path / "figures/m.svg").read_text()
    words = re.findall(r">([^<>\n]+)</text>", drawn)
    assert [word for word in words if word.isdigit()] == ["67", "0", "50", "100"]
    assert {"plain", "other", "one paper", "another", "F", "G", "panel 1"} <= set(words)
    assert drawn.count("stroke: #d55e00") == 1
    shares = pd.read_csv(tmp_path / "tables/m.csv")["success"].tolist()
    assert shares == pytest.approx([2 / 3, 0.0, 0.5, 1.0])


def test_a_home_that_is_no_group_is_refused(crossed: StoredResults, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="home=elsewhere: there is no such group; allowed: one paper, another"):
        told(
            success_map,
            crossed,
            tmp_path,
            file="m",
            panels={"": {}},
            groups=GROUPS,
            home={"F": "elsewhere"},
        )


def test_a_controller_that_missed_a_world_is_refused(tmp_path: Path) -> None:
    cells = [(a_cell("F", "plain"), [a_record()]), (a_cell("G", "other"), [a_record()])]
    reading = store(tmp_path / "in", cells)
    with pytest.raises(DescriptionError, match="select: F has no episodes in other"):
        told(crossed_tables, reading, tmp_path, file="c", select={"name": "printed"}, groups=GROUPS)
