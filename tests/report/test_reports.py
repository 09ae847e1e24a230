import json
import math
import os
import pickle
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from stored import CROSSING, LIMIT_S, Fleet, a_cell, a_drive, a_record, store, told

from navbench.analysis.stored import StoredResults
from navbench.cli.configuration import compose_cell
from navbench.controllers.aouf2019.sections import surface
from navbench.controllers.aouf2019.sflc import RULES, Sflc
from navbench.controllers.zhao2018.sections import rules_compared
from navbench.experiments.engines import in_processes
from navbench.experiments.store import Results
from navbench.records import CellKey, RobotRecord
from navbench.report import latex, markdown
from navbench.report.claims import findings, printed_table
from navbench.report.comparison import comparison
from navbench.report.document import RARE, Column, Document, Finding, Paragraph, Table, number, words
from navbench.report.drawing import thinned
from navbench.report.figures import PALETTE, styles
from navbench.report.outcomes import outcomes_table
from navbench.report.page import Page
from navbench.report.provenance import sources
from navbench.report.reports import write_document, write_report
from navbench.report.sections import SECTIONS, build_section, check_section
from navbench.validation import DescriptionError

OF = "navbench.controllers."
NAVBENCH = str(Path(sys.executable).with_name("navbench"))
WORLDS = {"Fig 1": "plain", "Fig 2": "other"}
FASTER = {"name": "share_better", "metric": "time_s", "select": {"label": "F"}, "than": {"label": "PID"}}
SHOWN = {"a": "count", "b": "percent"}
CLAIM: dict[str, Any] = {
    "says": "F's time, 100 % & more_or_less",
    "where": "Table 1",
    "printed": "10 s",
    "within": "5 %",
    "measure": "median",
    "of": {"metric": "time_s", "cell": "printed", "label": "F", "world": "plain"},
}
REPORT: list[dict[str, Any]] = [
    {
        "name": "findings",
        "sentences": [
            {
                "say": "quicker in {a}, {b}",
                "with": {"a": {**FASTER, "show": "count"}, "b": {**FASTER, "show": "percent"}},
            }
        ],
    },
    {"name": "verdicts", "groups": {"times": ["time-"]}},
    {
        "name": "printed_table",
        "file": "table_1",
        "metric": "time_s",
        "select": {"name": "printed"},
        "worlds": WORLDS,
        "claims": "time-",
        "labels": ["F", "PID"],
    },
    {"name": "summary"},
    {"name": "metrics"},
    {"name": "failures"},
    {"name": "outcomes_table", "file": "outcomes", "cells": {"F": {"name": "fair", "label": "F"}}, "worlds": WORLDS},
    {
        "name": "trajectories",
        "file": "paths",
        "caption": "Paths.",
        "select": {"name": "printed"},
        "panels": WORLDS,
        "labels": ["F", "PID"],
    },
    {
        "name": f"{OF}aouf2019.sections.velocities",
        "file": "speeds",
        "caption": "Speeds.",
        "select": {"name": "printed"},
        "panels": WORLDS,
        "labels": ["F"],
    },
    {
        "name": f"{OF}aouf2019.sections.phases",
        "file": "phases",
        "caption": "Phases.",
        "select": {"name": "printed", "label": "F"},
    },
    {
        "name": "memberships",
        "file": "sets",
        "caption": "Sets.",
        "table": "sflc-memberships",
        "axes": {"heading_error": {"title": "error [rad]", "low": -1.0, "high": 1.0}},
    },
    {"name": "rules", "file": "rules", "table": "sflc-rules"},
    {
        "name": "rule_grid",
        "file": "grid",
        "table": "sflc-rules",
        "down": ["heading_error"],
        "across": ["speed"],
        "of": ["turn"],
    },
    {"name": "printed_beside", "file": "beside", "claims": ["time-"]},
    {"name": f"{OF}nemeiksis2019.sections.counts", "file": "counts", "table": "sflc-rules", "by": ["turn"]},
    {"name": f"{OF}aouf2019.sections.surface", "file": "surface", "caption": "Surface.", "table": "sflc-surface"},
    {
        "name": f"{OF}lei2014.sections.surface_2d",
        "file": "surface_2d",
        "caption": "Surface.",
        "table": "dual_layer-danger",
        "x": "eta_t",
        "y": "eta_d",
        "value": "DDC",
    },
    {
        "name": "tuners_compared",
        "file": "tuners",
        "caption": "Tuners.",
        "unit": "rad^2 s",
        "tunings": {"pso": "PID", "fa": "F", "de": "P"},
    },
    {
        "name": f"{OF}zhao2018.sections.evolution",
        "file": "evolution",
        "caption": "Evolution.",
        "tunings": {"pso": "PID", "fa": "F", "de": "P"},
        "first": 3,
    },
    {
        "name": f"{OF}zhao2018.sections.gains",
        "file": "gains",
        "rows": {
            "one world": {"select": {"name": "printed", "label": "F"}, "than": {"name": "printed", "label": "PID"}},
            "fair": {"select": {"name": "fair", "label": "F"}, "than": {"name": "fair", "label": "PID"}},
        },
        "printed": {"one world": [None, 20.0]},
    },
    {
        "name": f"{OF}zhao2018.sections.rules_compared",
        "file": "rules_both",
        "tables": {"printed": "sflc-rules", "evolved": "evolved-rules"},
    },
    {
        "name": "frames",
        "file": "frames",
        "caption": "Frames.",
        "select": {"name": "fleet", "label": "F", "episode": 1},
        "times_s": [0.0, 3.0, 9.0],
    },
    {
        "name": "wheel_velocities",
        "file": "wheels",
        "caption": "Wheels.",
        "panels": {"first": {"name": "fleet", "episode": 0}, "second": {"name": "fleet", "episode": 1}},
        "active": "at_obstacle",
        "marked": "at an obstacle",
    },
    {
        "name": "fleet_table",
        "file": "fleets",
        "select": {"name": "fleet"},
        "worlds": {"Crossing": "crossing"},
        "labels": ["F"],
    },
    {
        "name": "time_series",
        "file": "series",
        "caption": "Series.",
        "panels": {"F": {"name": "printed", "label": "F"}, "PID": {"name": "printed", "label": "PID"}},
        "series": {"speed [m/s]": {"v_mps": "v"}, "[degrees], [m]": {"heading_error_rad": "e", "goal_distance_m": "d"}},
    },
    {
        "name": f"{OF}nemeiksis2019.sections.spells_on_path",
        "file": "spells",
        "caption": "Spells.",
        "select": {"name": "fleet", "episode": 1},
        "column": "at_obstacle",
        "values": {"free": 0.0, "at an obstacle": 1.0},
        "least_periods": 1,
    },
    {"name": "robustness", "file": "robustness", "cells": {"F": {"name": "fair", "label": "F"}}, "worlds": WORLDS},
    {
        "name": "success_map",
        "file": "success",
        "caption": "Success.",
        "panels": {"fair": {"name": "fair"}, "printed": {"name": "printed"}},
        "groups": {"one paper": ["plain"], "another": ["other"]},
        "home": {"F": "one paper"},
    },
    {
        "name": "crossed_tables",
        "file": "crossed",
        "select": {"name": "fair"},
        "groups": {"one paper": ["plain"], "another": ["other"]},
    },
    {
        "name": "comparison",
        "file": "fair",
        "select": {"name": "fair"},
        "worlds": WORLDS,
        "reference": "F",
    },
    {
        "name": f"{OF}aouf2019.sections.constant_speeds",
        "file": "speeds_swept",
        "select": {"name": "fair"},
        "worlds": WORLDS,
        "reference": "F",
        "speeds_mps": {"PID": 0.15, "P": 0.2},
        "level": ["F"],
    },
    {"name": "sources", "file": "sources"},
    {"name": "errata", "items": [{"where": "eq. 1", "printed": "a | b", "here": "c"}]},
]
STUDY: dict[str, Any] = {
    "name": "smoke",
    "title": "A smoke study",
    "summary": "It is small.",
    "claims": {"time-f": CLAIM, "other": {**CLAIM, "printed": "99 s"}},
    "checks": {"copied": {**CLAIM, "printed": "10.0 s"}},
    "questions": {"how-long": {key: CLAIM[key] for key in ("says", "measure", "of")}},
    "report": [{"title": f"The {spec['name']}", **spec} for spec in REPORT],
}


def a_crossing(periods: int) -> Fleet:
    """Return two robots that pass each other on the left, the second twice as slowly and not to its end."""
    fleet = []
    for i, (begin, step) in enumerate(((1.0, 18.0 / periods), (19.0, -9.0 / periods))):
        k = np.arange(periods + 1)
        places = np.column_stack([begin + step * k, 5.0 + (0.5 - i) * np.sin(math.pi * k / periods)])
        v_mps, at_obstacle = [abs(step)] * periods, (abs(k - periods / 2) < 2.0)[:-1].astype(float).tolist()
        record = a_drive(
            v_mps, ("reached", "timed_out")[i], i, places=places.tolist(), at_obstacle=at_obstacle, behavior=at_obstacle
        )
        record.states[:, 3] = math.pi * i
        record.states[:, 5] = 0.4 * np.cos(math.pi * k / periods)
        fleet.append(record)
    return fleet


def smoke(path: Path) -> StoredResults:
    """Return a small study with everything that the sections ask for."""
    rng = np.random.default_rng(3)
    cells: list[tuple[CellKey, Sequence[RobotRecord | Fleet]]] = []
    for world in WORLDS.values():
        cells.append((a_cell("F", world), [a_record(time_s=10.0)]))
        cells += [
            (a_cell("PID", world, tuning="pso", seed=seed, kp=9.0 + seed), [a_record(time_s=12.0 + seed)])
            for seed in (0, 1)
        ]
        for label in ("F", "PID", "P"):
            records = [
                a_record("collided" if label != "F" and i % 4 == 0 else "reached", float(rng.uniform(9.0, 15.0)))
                for i in range(8)
            ]
            cells.append((a_cell(label, world, "fair"), records))
    cells.append((a_cell("F", "crossing", "fleet", scene=CROSSING), [a_crossing(9), a_crossing(12)]))
    costs = {(name, seed): rng.uniform(1.0, 2.0, 6).tolist() for name in ("pso", "fa", "de") for seed in range(3)}
    descriptions: dict[str, dict[str, Any]] = {
        "sflc-memberships": {
            "variable": ["heading_error"] * 3,
            "term": ["Z"] * 3,
            "x": [-0.5, 0.0, 0.5],
            "degree": [0.0, 1.0, 0.0],
        },
        "sflc-rules": {"heading_error": ["Z", "P"], "speed": ["L", "S"], "turn": ["Z", "P"]},
        "evolved-rules": {"heading_error": ["Z", "P"], "speed": ["L", "L"], "turn": ["Z", "P"]},
        "dual_layer-danger": {"eta_d": [0.0, 0.0, 4.0, 4.0], "eta_t": [0.0, 6.0] * 2, "DDC": [1.0, 1.0, 1.0, 0.0]},
        "sflc-surface": {"phi_rad": [-1.0, 0.0, 1.0], "v_mps": [0.1, 0.2, 0.1], "w_radps": [-1.0, 0.0, 1.0]},
    }
    return store(path, cells, STUDY, costs, descriptions)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> StoredResults:
    return smoke(tmp_path_factory.mktemp("smoke"))


@pytest.fixture(scope="module")
def files(stored: StoredResults, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The small study's report, which takes seconds: what it says that it wrote."""
    return write_report([stored.results], tmp_path_factory.mktemp("report")).files


@pytest.fixture(scope="module")
def written(files: list[Path]) -> Path:
    return next(file.parent for file in files if file.name == "report.md")


def bytes_of(out: Path) -> dict[str, bytes]:
    return {str(file.relative_to(out)): file.read_bytes() for file in sorted(out.rglob("*")) if file.is_file()}


def test_the_smoke_study_has_every_section() -> None:
    assert {spec["name"] for spec in REPORT} >= set(SECTIONS)


@pytest.mark.parametrize("spec", STUDY["report"], ids=lambda spec: spec["name"])
def test_every_section_runs_and_links_only_to_what_it_wrote(
    spec: dict[str, Any], stored: StoredResults, tmp_path: Path
) -> None:
    document = Document("", build_section(Page(stored, tmp_path), spec))
    write_document(document, tmp_path)
    text = markdown.render(document)
    assert f"## The {spec['name']}\n\n" in text
    linked = set(re.findall(r"\]\(([^)]+)\)", text))
    assert linked == set(document.files)
    assert linked | {"report.md"} == set(bytes_of(tmp_path))


def test_a_report_lists_its_files_and_holds_title_summary_and_making(files: list[Path], written: Path) -> None:
    assert sorted(str(file.relative_to(written)) for file in files) == sorted(bytes_of(written))
    text = (written / "report.md").read_text()
    assert text.startswith("# A smoke study\n\nIt is small.\n\n## The findings")
    assert "`navbench study smoke`" in text
    assert "seeds 0 to 2" in text
    assert not re.search(r"/tmp|/home", text)


def test_a_report_is_the_same_bytes_without_pybullet_and_hydra(
    stored: StoredResults, written: Path, tmp_path: Path
) -> None:
    code = (
        "import sys\n"
        "for name in ('pybullet', 'hydra', 'omegaconf'): sys.modules[name] = None\n"
        "from pathlib import Path\n"
        "from navbench.report.reports import write_report\n"
        "from navbench.experiments.store import Results\n"
        "write_report([Results(Path(sys.argv[1]))], Path(sys.argv[2]))\n"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "12345", "TZ": "Asia/Tokyo"}
    path = stored.results.path
    subprocess.run([sys.executable, "-c", code, str(path), str(tmp_path)], check=True, env=environment)
    assert bytes_of(tmp_path) == bytes_of(written)


def test_a_report_is_the_same_bytes_from_several_processes(
    stored: StoredResults, written: Path, tmp_path: Path
) -> None:
    write_report([stored.results], tmp_path, partial(in_processes, workers=2))
    assert bytes_of(tmp_path) == bytes_of(written)


def test_reading_loads_no_slow_library_before_it_is_needed() -> None:
    code = (
        "import sys, navbench.report.reports\n"
        "print([n for n in ('pandas', 'matplotlib', 'scipy.stats', 'tabulate', 'pybullet') if n in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert run.stdout.strip() == "[]"


def test_claims_are_written_as_a_table_of_their_own(written: Path) -> None:
    table = pd.read_csv(written / "claims.csv")
    assert table["verdict"].fillna("").tolist() == ["reproduced", "not_reproduced", "passed", ""]
    counts = pd.read_csv(written / "tables/verdicts.csv").to_numpy().tolist()
    assert ["times", 1, 0, 0, 0] in counts
    assert ["all claims", 1, 0, 1, 0] in counts
    assert ["of these, evidence selected", 1, 0, 1, 0] in counts
    text = (written / "report.md").read_text()
    assert (
        "### Checks\n\nInputs copied from the paper, and what holds by construction; none of them is a claim: 1 passed"
        in text
    )
    questions = text[text.index("### Our questions") :].split("\n## ")[0]
    assert "10 s" not in questions
    assert "| how-long |" in questions
    assert r"100 \% \& more\_or\_less" in (written / "tables/claims.tex").read_text()


def test_the_small_manifest_has_hashes_and_no_configurations_or_times(written: Path) -> None:
    manifest = json.loads((written / "manifest.json").read_text())
    assert "configuration" not in manifest["cells"][0]
    assert manifest["cells"][0]["config_hash"]
    assert not {"began", "ended"} & set(manifest)
    assert manifest["tunings"][0]["budget"] == 4


def test_a_printed_table_never_averages_a_failure(tmp_path: Path) -> None:
    cells = [
        (a_cell("F", seed=0), [a_record("collided", 0.5, 0.1)]),
        (a_cell("F", seed=1), [a_record(time_s=10.0)]),
        (a_cell("F", seed=2), [a_record(time_s=12.0)]),
        (a_cell("PID"), [a_record("timed_out", LIMIT_S)]),
    ]
    claims = {
        f"time-{label}": {**CLAIM, "printed": printed, "of": {**CLAIM["of"], "label": label}}
        for label, printed in (("F", "22 s"), ("PID", "5 s"))
    }
    reading = store(tmp_path / "in", cells, {**STUDY, "claims": claims})
    text = told(
        printed_table,
        reading,
        tmp_path,
        metric="time_s",
        select={"name": "printed"},
        worlds={"Fig 1": "plain"},
        claims="time-",
        labels=["F", "PID"],
    )
    assert "| F | 22 | 11.00 [10.00, 12.00] (2 of 3 reached) | 0.50 |" in text
    assert "| PID | 5 | – (0 of 1 reached) | – |" in text
    table = pd.read_csv(tmp_path / "tables/t.csv")
    assert table["median"][0] == 11.0
    assert math.isnan(table["median"][1])
    assert table["reached"].tolist() == [2, 0]


def test_outcomes_count_failures_and_take_medians_of_the_reached(tmp_path: Path) -> None:
    records = [
        a_record(time_s=10.0),
        a_record("collided", 1.0, 0.1),
        a_record("timed_out", 60.0),
        a_record(time_s=20.0),
    ]
    reading = store(tmp_path / "in", [(a_cell("F"), records)])
    text = told(outcomes_table, reading, tmp_path, cells={"F": {"label": "F"}}, worlds={"plain": "plain"})
    assert "| F | 2 of 4 (1 collided, 1 timed out) | 15.00 | 3.000 |" in text


def test_dying_early_never_looks_fast_in_the_comparison(tmp_path: Path) -> None:
    slow = [a_record(time_s=30.0 + i) for i in range(8)]
    dying = [a_record("collided", 0.5, 0.1)] * 7 + [a_record(time_s=5.0)]
    reading = store(tmp_path / "in", [(a_cell("F"), slow), (a_cell("D"), dying)])
    told(comparison, reading, tmp_path, select={"name": "printed"}, worlds={"plain": "plain"}, reference="F")
    row = pd.read_csv(tmp_path / "tables/t_plain.csv").set_index("label").loc["D"]
    assert row["time_s"] == pytest.approx((7 * LIMIT_S + 5.0) / 8)
    assert row["time_difference_s"] > 0.0
    assert (row["wins"], row["losses"], row["ties"]) == (1, 7, 0)
    assert row["reached_difference"] == pytest.approx(-7 / 8)
    assert row["path_length_m_better_n"] == 1


def test_sources_join_what_things_share_and_tell_what_was_tuned(stored: StoredResults, tmp_path: Path) -> None:
    told(sources, stored, tmp_path)
    rows = pd.read_csv(tmp_path / "tables/t.csv", keep_default_na=False, dtype=str).to_dict("records")
    found = {(row["part"], row["parameter"], row["source"]): row for row in rows}
    assert len(found) == len(rows)
    assert found["world", "boxes", "fitted"]["name"] == "other, plain"
    assert found["controller", "build.kp", "public"]["value"] == "5.0"
    assert "pso" in found["controller", "build.kp", "tuned"]["why"]
    assert found["controller", "build.gain", "assumed"]["range"] == "[0.5, 2.0]"
    assert ("tuner", "build.n", "–") in found


@pytest.mark.parametrize(
    ("form", "expected"),
    [
        ({}, "0.25 [0.1, 0.5]"),
        ({"show": "value", "decimals": 1}, "0.2"),
        ({"show": "percent"}, "25 %"),
        ({"show": "count"}, "2 of 8"),
        ({"decimals": 2, "signed": True}, "+0.25 [+0.10, +0.50]"),
        ({"show": "share", "decimals": 2}, "2 of 8: 0.25 [0.10, 0.50]"),
    ],
)
def test_a_measured_figure_is_printed_in_several_forms(form: dict[str, Any], expected: str) -> None:
    assert words((0.25, 0.1, 0.5, 8), **form) == expected
    assert words(None, **form) == words((math.nan, math.nan, math.nan, 0), **form) == "–"


def test_an_interval_without_width_is_not_printed() -> None:
    assert words((0.5, 0.5, 0.5, 1), decimals=2) == "0.50"


@pytest.mark.parametrize(
    ("figure", "expected"),
    [
        ((0.25, 0.2, 0.3, 100), "0.250 [0.200, 0.300]"),
        ((0.0004, 0.0002, 0.0006, 16384), "0.000 [0.000, 0.001]"),
        ((2 / 16384, 0.0, 0.0003, 16384), "2 of 16384"),
        ((0.0, 0.0, 0.0, 16384), "0 of 16384"),
        ((16383 / 16384, 0.9997, 1.0, 16384), "16383 of 16384"),
        ((0.25, math.nan, math.nan, 8), "2 of 8"),
    ],
)
def test_a_rare_share_whose_decimals_say_nothing_is_printed_as_a_count(
    figure: tuple[float, float, float, int], expected: str
) -> None:
    assert words(figure, show=RARE, decimals=3) == expected


@pytest.mark.parametrize("say", ["{b}", "{a:furlongs}", "{a"])
def test_a_sentence_that_cannot_be_told_is_refused(say: str, stored: StoredResults, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"sentences\[0\]\.say"):
        told(findings, stored, tmp_path, sentences=[{"say": say, "with": {"a": FASTER}}])


def test_a_form_of_a_figure_that_there_is_not_is_refused_with_those_there_are(
    stored: StoredResults, tmp_path: Path
) -> None:
    with pytest.raises(DescriptionError, match=r"sentences\[0\]\.with\.a\.show=furlongs: .*interval"):
        told(findings, stored, tmp_path, sentences=[{"say": "{a}", "with": {"a": {**FASTER, "show": "furlongs"}}}])


def test_findings_are_kept_as_data_beside_the_report(stored: StoredResults, written: Path) -> None:
    kept = json.loads((written / "findings.json").read_text())
    (finding,) = kept["findings"]
    assert f"- {finding['text']}\n" in (written / "report.md").read_text()
    assert finding["text"].startswith("quicker in ")
    assert set(finding["figures"]) == {"a", "b"}
    share = finding["figures"]["a"]
    assert share["words"] == f"{round(share['value'] * share['n'])} of {share['n']}"
    assert 0.0 <= share["low"] <= share["value"] <= share["high"] <= 1.0
    assert kept["errata"] == STUDY["report"][-1]["items"]


def test_a_figure_without_a_case_is_told_and_kept_as_such(tmp_path: Path) -> None:
    failed = store(tmp_path / "in", [(a_cell("F"), [a_record("collided")])])
    spec = {"name": "median", "metric": "time_s", "select": {"label": "F"}}
    (finding,) = findings(Page(failed, tmp_path), sentences=[{"say": "it takes {t}", "with": {"t": spec}}])
    assert isinstance(finding, Finding)
    assert finding.text == "it takes no case"
    assert (finding.figures["t"].value, finding.figures["t"].n) == (None, 0)


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ({"name": "plot", "title": "a"}, ["report[0].name=plot", "printed_table"]),
        (
            {"name": "errata", "title": "a", "items": [], "colour": 1},
            ["report[0].colour", "items, title, text, file, caption"],
        ),
        ({"name": "errata", "title": "a"}, ["report[0].items: missing"]),
        ({"name": "comparisn"}, ["report[0].name=comparisn", "did you mean comparison?"]),
        ("nowhere.sections.mine", ["report[0].name=nowhere.sections.mine: lies outside navbench", "--trust"]),
        ("navbench.report.nowhere.mine", ["report[0].name=navbench.report.nowhere.mine: cannot be imported"]),
    ],
)
def test_an_unknown_section_or_argument_is_refused_by_name(spec: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(DescriptionError) as error:
        check_section("report[0]", spec)
    assert all(word in str(error.value) for word in words)


def test_an_argument_with_a_default_may_be_left_out() -> None:
    check_section("report[0]", {"name": "trajectories", "panels": {}})
    check_section("report[0]", "comparison")


def test_rules_that_differ_from_the_first_ones_have_a_star(stored: StoredResults, tmp_path: Path) -> None:
    tables = {"printed": "sflc-rules", "evolved": "evolved-rules"}
    text = told(rules_compared, stored, tmp_path, tables=tables)
    assert "| heading_error | turn | speed: printed | speed: evolved |" in text
    assert "| Z | Z | L | L |" in text
    assert "| P | P | S | L* |" in text


def test_a_missing_description_is_named(stored: StoredResults, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"'zhao-surface'.*sflc-surface"):
        told(surface, stored, tmp_path, table="zhao-surface")


def test_runs_without_a_study_get_the_comparison_of_a_study_failures_and_trajectories(tmp_path: Path) -> None:
    runs = []
    for kp in (1, 2):
        records = [a_record(time_s=10.0), a_record("collided", 1.0, 0.1)]
        cell = a_cell("pid", name="run", seed=kp, kp=kp)
        runs.append(store(tmp_path / str(kp), [(cell, records)]).results)
    files = write_report(runs, tmp_path / "out").files
    text = (tmp_path / "out/report.md").read_text()
    assert "1 of 2" in text
    assert "## Failures\n\n- pid (kp=1) in plain, seed 0, episode 1, robot 0: collided after 1.00 s\n" in text
    assert {str(file.relative_to(tmp_path / "out")) for file in files} == {
        *(f"figures/{name}.{form}" for name in ("comparison", "trajectories_1") for form in ("png", "svg")),
        *(f"tables/{name}.{form}" for name in ("comparison_1", "summary") for form in ("csv", "tex")),
        "report.md",
        "report.html",
    }
    rows = pd.read_csv(tmp_path / "out/tables/comparison_1.csv").to_dict("records")
    found = [[row[name] for name in ("label", "reached", "reached_difference", "wins", "ties")] for row in rows]
    assert found[1] == ["pid (kp=2)", 0.5, 0.0, 0.0, 2.0]
    assert pd.read_csv(tmp_path / "out/tables/summary.csv")["time_s"].tolist() == [10.0, 10.0]


def test_a_section_of_ones_own_is_run_where_it_is_trusted_and_named_where_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/sections.py").write_text(
        "from navbench.report.document import Column\n\n\n"
        "def fastest(page, *, select):\n"
        "    least = page.stored.select(**select)['time_s'].min()\n"
        "    return [page.table([Column('fastest', 'time_s', 's', 1)], [[least]])]\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    for name in [*sys.modules]:
        if name.partition(".")[0] == "mine":  # another test's
            monkeypatch.delitem(sys.modules, name)
    report = [{"name": "mine.sections.fastest", "select": {"label": "F"}}, "comparison"]
    cells = [(a_cell("F"), [a_record(time_s=9.5)]), (a_cell("G"), [a_record(time_s=8.0)])]
    results = store(tmp_path / "in", cells, {**STUDY, "claims": {}, "report": report}).results
    refused = r"report\[0\]\.name=mine\.sections\.fastest: lies outside navbench; --trust"
    with pytest.raises(DescriptionError, match=refused):
        write_report([results], tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert "mine" not in sys.modules
    command = [NAVBENCH, "report", "in", "out=out"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (run.returncode, len(run.stderr.splitlines())) == (2, 1), run.stderr
    assert "report[0].name=mine.sections.fastest" in run.stderr
    subprocess.run([*command, "--trust"], cwd=tmp_path, check=True)
    text = (tmp_path / "out/report.md").read_text()
    assert "## Fastest\n\nSimulator: ideal.\n\n| fastest [s] |\n| --- |\n| 9.5 |\n\n[CSV](tables/fastest.csv)" in text
    assert "## Comparison" in text


def test_several_reports_stand_in_folders_and_are_linked(tmp_path: Path) -> None:
    cell = (a_cell("F", name="run"), [a_record()])
    study = store(tmp_path / "study", [cell], {**STUDY, "claims": {}, "report": STUDY["report"][-1:]}).results
    run = store(tmp_path / "run", [cell]).results
    files = write_report([study, run], tmp_path / "out").files
    assert tmp_path / "out/smoke/report.md" in files
    assert "(smoke/report.md)" in (tmp_path / "out/report.md").read_text()


def test_what_holds_no_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="no results here"):
        write_report([Results(tmp_path)], tmp_path / "out")


def test_latex_escapes_what_it_would_read_as_commands() -> None:
    text = latex.render(Table("", [Column("")], [[r"a_b & 5 % of $x #1 {c} ~ ^ \d ± 1"]]))
    escaped = r"a\_b \& 5 \% of \$x \#1 \{c\} \textasciitilde{} \textasciicircum{} \textbackslash{}d $\pm$ 1 \\"
    assert text.splitlines()[4] == escaped


def test_a_latex_table_has_booktabs_rules_and_common_headings() -> None:
    columns = [Column(""), Column("a_1", group="Fig 1"), Column("b", group="Fig 1")]
    text = latex.render(Table("", columns, [["x & y", 1, "[2, 3]"], ["[z]", None, 4]]))
    assert text == (
        "\\begin{tabular}{lrr}\n\\toprule\n"
        " & \\multicolumn{2}{c}{Fig 1} \\\\\n\\cmidrule(lr){2-3}\n"
        " & a\\_1 & b \\\\\n\\midrule\n"
        "x \\& y & 1 & {}[2, 3] \\\\\n{}[z] & -- & 4 \\\\\n\\bottomrule\n\\end{tabular}\n"
    )


def test_a_markdown_table_escapes_bars_and_aligns_numbers() -> None:
    assert markdown.table(["", "n"], [["a|b", "1"]]) == "|  | n |\n| --- | ---: |\n| a\\|b | 1 |\n"


def test_a_saved_table_has_the_raw_numbers_beside_the_printed_words(tmp_path: Path) -> None:
    columns = [Column(""), Column("x", "x", "m", 2, group="Fig 1"), Column(None, "hidden")]
    document = Document("", [Table("t", columns, [["a", (1.23456789, 1.0, 2.0, 3), 7]])])
    write_document(document, tmp_path)
    assert (tmp_path / "tables/t.csv").read_text() == "x,x_low,x_high,x_n,hidden\n1.23456789,1.0,2.0,3,7\n"
    assert "|  | Fig 1: x [m] |" in markdown.render(document)
    assert "| a | 1.23 [1.00, 2.00] |" in markdown.render(document)
    assert not list(tmp_path.rglob("*.tmp"))


@pytest.mark.parametrize(
    ("value", "expected"), [(1.005, "1.00"), (-0.001, "0.00"), (math.nan, "–"), (math.inf, "inf"), (-math.inf, "-inf")]
)
def test_numbers_are_printed_without_a_negative_zero(value: float, expected: str) -> None:
    assert number(value, 2) == expected


def test_the_first_label_keeps_its_colour_to_itself() -> None:
    found = styles([f"label {i}" for i in range(20)])
    assert found["label 0"].color == PALETTE[0]
    assert all(style.color != PALETTE[0] for label, style in found.items() if label != "label 0")
    assert len({style.color for style in list(found.values())[: len(PALETTE)]}) == len(PALETTE)
    assert len(set(found.values())) == 20  # a colour comes again with another mark


def test_a_thinned_line_keeps_its_ends_and_its_shape() -> None:
    angle = np.linspace(0.0, math.pi, 500)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    few = thinned(circle, 0.001)
    assert len(few) < 80
    assert (few[[0, -1]] == circle[[0, -1]]).all()
    away = np.interp(angle, np.arctan2(few[:, 1], few[:, 0]), np.hypot(*few.T))
    assert np.abs(away - 1.0).max() < 0.002
    assert len(thinned(np.column_stack([angle, 2.0 * angle]), 1e-9)) == 2
    assert len(thinned(circle[:1], 0.1)) == 1


@pytest.fixture(scope="module")
def described() -> dict[str, dict[str, list[Any]]]:
    controller = compose_cell("controller=sflc", "world=deadlock").make_controller()
    assert isinstance(controller, Sflc)
    return controller.describe()


def test_the_described_rules_are_those_of_table_2(described: dict[str, dict[str, list[Any]]]) -> None:
    assert list(zip(*described["rules"].values(), strict=True)) == list(RULES)


def test_the_described_sets_rise_to_one_and_cover_the_input(described: dict[str, dict[str, list[Any]]]) -> None:
    table = pd.DataFrame(described["memberships"])
    assert table.groupby(["variable", "term"])["degree"].max().eq(1.0).all()
    assert table.groupby("variable")["term"].nunique().to_dict() == {"heading_error": 11, "speed": 4, "turn": 11}
    assert table[table["variable"] == "heading_error"]["x"].abs().max() == pytest.approx(math.pi)


def test_the_described_surface_is_odd_in_w_and_even_in_v(described: dict[str, dict[str, list[Any]]]) -> None:
    surface = pd.DataFrame(described["surface"])
    assert surface["w_radps"].to_numpy() == pytest.approx(-surface["w_radps"].to_numpy()[::-1], abs=1e-12)
    assert surface["v_mps"].to_numpy() == pytest.approx(surface["v_mps"].to_numpy()[::-1], abs=1e-12)
    at_18 = surface.iloc[(surface["phi_rad"] - math.radians(18.0)).abs().argmin()]
    assert at_18["w_radps"] == pytest.approx(1.2, abs=1e-3)
    assert at_18["v_mps"] == pytest.approx(0.1111, abs=1e-3)


TUNED = {"name": "tuners_compared", "tunings": {"pso": "PSO-PID", "fa": "FA-PID"}}


def tuned(path: Path) -> StoredResults:
    costs = {("pso", 0): [4.0, 2.0], ("pso", 1): [4.0, 3.0], ("fa", 0): [5.0, 6.0]}
    return store(path, [(a_cell("A"), [a_record()])], costs=costs)


def test_what_the_best_cost_when_it_was_run_again_stands_beside_the_least_cost(tmp_path: Path) -> None:
    blocks = build_section(Page(tuned(tmp_path / "kept"), tmp_path), TUNED)
    assert blocks[1] == Paragraph("Simulator: planar.")
    text = markdown.render(Document("", blocks))
    heads = "| seeds | evaluations | least cost | mean rank | verified (ideal) | fresh (planar) | fresh (ideal) | kp |"
    assert heads in text
    assert "| PSO-PID | 2 | 2 | 2.50000 [2.00000, 3.00000] | – | 3.50000 [3.00000, 4.00000] | 4.50000" in text
    assert "Not verified" not in text


def test_tunings_that_were_not_run_again_are_told_as_not_verified(tmp_path: Path) -> None:
    stored = tuned(tmp_path / "kept")
    shutil.rmtree(tmp_path / "kept/checks")
    text = markdown.render(Document("", build_section(Page(stored, tmp_path), TUNED)))
    assert "| seeds | evaluations | least cost | mean rank | kp |" in text
    assert "Not verified: no best was run again in another simulator." in text


def test_each_section_says_which_simulator_made_its_numbers(tmp_path: Path) -> None:
    here, there = a_cell("A"), a_cell("B", name="fair")
    planar = there._replace(names=there.names._replace(simulator="planar"))
    stored = store(tmp_path / "kept", [(here, [a_record()]), (planar, [a_record()])])
    worlds = {"world": "plain"}
    for cells, line in (
        ({"A": {"label": "A"}}, "Simulator: ideal."),
        ({"A": {"label": "A"}, "B": {"label": "B"}}, "Simulator: ideal (printed); planar (fair)."),
    ):
        blocks = build_section(Page(stored, tmp_path), {"name": "outcomes_table", "cells": cells, "worlds": worlds})
        assert blocks[1] == Paragraph(line)
    metrics = build_section(Page(stored, tmp_path), {"name": "metrics"})
    assert not any("Simulator" in str(block) for block in metrics)


def test_results_that_travel_to_another_process_are_read_there_once(tmp_path: Path) -> None:
    one, other = (store(tmp_path / name, [(a_cell("A"), [a_record()])]) for name in ("one", "other"))
    sent = pickle.dumps(one)
    read = pickle.loads(sent)
    assert read is not one
    assert read.results.path == one.results.path
    assert pickle.loads(sent) is read
    assert pickle.loads(pickle.dumps(other)).results.path == other.results.path
    assert pickle.loads(sent) is not read, "only the last one is kept"
