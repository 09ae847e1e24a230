import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from stored import a_cell, a_record, store

from navbench.analysis.claims import COLUMNS, Claim, check_claims, judged, quantity, verdict, verdicts_in
from navbench.mathematics.statistics import Estimate
from navbench.report.sections import check_section
from navbench.validation import DescriptionError, describe

CONF = Path(__file__).parents[1] / "conf/study"
STUDY = yaml.safe_load((CONF / "aouf2019.yaml").read_text())
CLAIMS = yaml.safe_load((CONF / "aouf2019/claims.yaml").read_text())
REPORT = yaml.safe_load((CONF / "aouf2019/report.yaml").read_text())["report"]
PAPERS = sorted(path.parent.name for path in CONF.glob("*/claims.yaml"))
PID_SPEED_MPS = 0.15


def a_number(printed: Any = "10 s", within: Any = "10 %", evidence: Any = "free") -> Claim:
    return Claim(says="it takes so long", printed=printed, within=within, measure="median", evidence=evidence)


def a_hypothesis(holds: str = "below 0", **changes: Any) -> Claim:
    return Claim(says="it is quicker", holds=holds, measure="difference", **changes)


def found(value: float, low: float | None = None, high: float | None = None) -> Estimate:
    return Estimate(value, value if low is None else low, value if high is None else high, 1)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (10.0, "reproduced"),
        (11.0, "reproduced"),
        (9.0, "reproduced"),
        (11.1, "partly"),
        (12.0, "partly"),
        (8.0, "partly"),
        (12.1, "not_reproduced"),
        (7.9, "not_reproduced"),
        (-10.0, "not_reproduced"),
    ],
)
def test_within_the_tolerance_is_reproduced_and_within_twice_of_it_partly(value: float, expected: str) -> None:
    assert verdict(a_number(), found(value)) == (expected, "")


def test_an_absolute_tolerance_is_in_the_unit_of_the_claim() -> None:
    claim = a_number(1.0, 0.05)
    assert [verdict(claim, found(value))[0] for value in (0.96, 0.91, 0.89)] == [
        "reproduced",
        "partly",
        "not_reproduced",
    ]


@pytest.mark.parametrize("printed", [-10.0, 10.0])
def test_a_relative_tolerance_has_a_width_for_either_sign(printed: float) -> None:
    assert verdict(a_number(printed), found(1.05 * printed))[0] == "reproduced"


@pytest.mark.parametrize("measured", [None, found(math.nan), found(math.inf)])
def test_what_could_not_be_measured_is_not_testable(measured: Estimate | None) -> None:
    decided, reason = verdict(a_number(), measured)
    assert decided == "not_testable"
    assert reason


@pytest.mark.parametrize(("value", "word"), [(10.0, "agrees"), (11.5, "partly agrees")])
def test_a_fitted_figure_that_agrees_is_not_testable(value: float, word: str) -> None:
    decided, reason = verdict(a_number(evidence="fitted"), found(value))
    assert decided == "not_testable"
    assert word in reason
    assert "fitted" in reason


def test_a_fitted_figure_that_disagrees_is_not_reproduced() -> None:
    assert verdict(a_number(evidence="fitted"), found(20.0)) == ("not_reproduced", "")


@pytest.mark.parametrize("evidence", ["free", "selected", "layout_unknown"])
def test_other_evidence_does_not_change_the_verdict(evidence: str) -> None:
    assert verdict(a_number(evidence=evidence), found(10.0))[0] == "reproduced"


@pytest.mark.parametrize(("value", "expected"), [(0.95, "reproduced"), (0.91, "partly"), (0.89, "not_reproduced")])
def test_a_statement_holds_in_so_many_cases_and_partly_with_twice_the_exceptions(value: float, expected: str) -> None:
    claim = Claim(says="it arrives", holds="in 95 % of the cases", measure="share_reached", evidence="free")
    assert verdict(claim, found(value + 1e-9))[0] == expected


@pytest.mark.parametrize(
    ("holds", "low", "high", "expected"),
    [
        ("below 0", -3.0, -1.5, "supported"),
        ("below 0", 1.5, 3.0, "contradicted"),
        ("below 0", -1.5, 0.5, "undecided"),
        ("below 0", -0.9, 0.9, "practically_equal"),
        ("below 0", -0.9, -0.1, "practically_equal"),  # it is less, but by less than makes a difference
        ("below 0", -1.0, -0.1, "supported"),
        ("above 0", 1.5, 3.0, "supported"),
        ("above 0", -3.0, -1.5, "contradicted"),
        ("above 2", 1.5, 3.5, "undecided"),
        ("above 2", 1.5, 2.5, "practically_equal"),
    ],
)
def test_the_interval_decides_on_a_hypothesis(holds: str, low: float, high: float, expected: str) -> None:
    assert verdict(a_hypothesis(holds), found((low + high) / 2, low, high), margin=1.0) == (expected, "")


def test_without_a_margin_nothing_is_practically_equal() -> None:
    assert verdict(a_hypothesis(), found(-1e-9, -1e-8, 1e-8))[0] == "undecided"
    assert verdict(a_hypothesis(), found(0.0))[0] == "undecided"


@pytest.mark.parametrize(
    ("text", "expected"),
    [("37.1 s", (37.1, "s")), ("-2 m/s", (-2.0, "m/s")), ("5 %", (5.0, "%")), (1.5, (1.5, "")), ("1e-3", (0.001, ""))],
)
def test_a_quantity_is_a_number_with_its_unit(text: Any, expected: tuple[float, str]) -> None:
    assert quantity("printed", text) == expected


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"evidence": "sure"}, "evidence"),
        ({"printed": "fast"}, "printed=fast: must be a number, or one with its unit"),
        ({"within": None}, "`within` beside `printed`"),
        ({"holds": "in 95 % of the cases"}, "either `printed` or `holds`"),
        ({"evidence": None}, "must have `evidence`"),
        ({"practically_equal": 1.0}, "only beside `holds: below` or `above`"),
        ({"extra": 1}, "extra"),
    ],
)
def test_a_claim_refuses_what_it_does_not_know(wrong: dict[str, Any], says: str) -> None:
    values = {"says": "", "printed": 1.0, "within": "10 %", "measure": "median", "evidence": "free"}
    describe(Claim, values, "claim")
    with pytest.raises(DescriptionError, match=says):
        describe(Claim, values | wrong, "claim")


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"holds": "under 0"}, "holds=under 0: must be as `in 95 % of the cases`"),
        ({"evidence": "free"}, "must have `evidence`"),
        ({"practically_equal": "-1 s"}, "practically_equal=-1 s: must be above 0"),
        (
            {"practically_equal": "2 %", "measure": "diference"},
            "measure=diference: must be a number, .* did you mean difference?",
        ),
        ({"practically_equal": "2 %", "measure": "median"}, "must be a number, unless the measure is `difference`"),
    ],
)
def test_a_hypothesis_refuses_what_it_does_not_know(wrong: dict[str, Any], says: str) -> None:
    values = {"says": "", "holds": "below 0", "practically_equal": "2 %", "measure": "difference"}
    describe(Claim, values, "claim")
    with pytest.raises(DescriptionError, match=says):
        describe(Claim, values | wrong, "claim")


def test_claims_of_all_kinds_are_judged_in_one_table(tmp_path: Path) -> None:
    mine = {"metric": "time_s", "label": "A"}
    number = {"printed": "9 s", "within": "5 %", "evidence": "free"}
    quicker = {"says": "it is", "holds": "below 0", "measure": "difference", "of": {**mine, "than": "B"}}
    claims = {
        "printed": {"says": "it takes 9 s", **number, "measure": "median", "of": mine},
        "none": {"says": "nothing compares", **number},
        "quicker": quicker,
        "equal": {**quicker, "practically_equal": "10.1 %"},  # of 10 s, and it is quicker by 1 s
        "seconds": {**quicker, "practically_equal": "0.9 s"},
    }
    cells = [(a_cell(label), [a_record(time_s=time_s)] * 3) for label, time_s in (("A", 9.0), ("B", 10.0))]
    table = judged(store(tmp_path, cells, {"name": "mine", "claims": claims}))
    assert list(table.columns) == COLUMNS
    assert table["id"].tolist() == list(claims)
    assert table["verdict"].tolist() == ["reproduced", "not_testable", "supported", "practically_equal", "supported"]
    assert table["tolerance"].tolist() == ["±5 %", "±5 %", "below 0", "below 0", "below 0"]
    assert table["measured"].tolist()[2:] == [-1.0] * 3
    assert table["n"].tolist() == [3, 0, 3, 3, 3]
    assert math.isnan(table["printed"][2])
    assert verdicts_in(table)[0] == "reproduced"
    assert verdicts_in(table[2:]) == ("not_testable", "supported", "contradicted", "practically_equal", "undecided")
    assert "supported" not in verdicts_in(table[:2])


def test_results_that_keep_their_claims_as_a_list_are_refused(tmp_path: Path) -> None:
    stored = store(tmp_path, [(a_cell("A"), [a_record()])], {"name": "old", "claims": [{"id": "a"}]})
    with pytest.raises(DescriptionError, match="must be a mapping from ids to claims"):
        judged(stored)


def claims_of(beginning: str) -> dict[str, dict[str, Any]]:
    return {id_: claim for id_, claim in CLAIMS.items() if id_.startswith(beginning)}


def test_the_study_of_aouf2019_claims_all_24_entries_of_its_tables() -> None:
    times, lengths = claims_of("time-"), claims_of("length-")
    assert len(times) == len(lengths) == 12
    for id_, claim in lengths.items():
        if "sflc" not in id_:  # every printed length of a PID is its printed time at one speed
            time_s = quantity("printed", times[id_.replace("length", "time")]["printed"])[0]
            length_m, unit = quantity("printed", claim["printed"])
            assert length_m == pytest.approx(PID_SPEED_MPS * time_s, abs=1e-9)
            assert unit == "m"


def test_no_claim_of_aouf2019_passes_for_free_evidence_where_something_was_chosen() -> None:
    evidence = {id_: claim["evidence"] for id_, claim in CLAIMS.items()}
    assert "free" not in evidence.values()
    for id_, kind in evidence.items():
        if id_.startswith(("time-", "length-", "faster-fig", "shorter-fig")):
            assert kind == ("selected" if id_.endswith("fig15") else "fitted"), id_
    assert evidence["pid-speed"] == "fitted"


@pytest.mark.parametrize("paper", PAPERS)
def test_the_claims_of_every_paper_are_understood(paper: str) -> None:
    check_claims("claims", yaml.safe_load((CONF / paper / "claims.yaml").read_text()))


def test_the_claims_and_the_report_of_aouf2019_name_what_its_cells_are_called() -> None:
    labels = {cell["label"] for cell in STUDY["cells"]}
    names = {cell["name"] for cell in STUDY["cells"]}
    for id_, claim in CLAIMS.items():
        than = claim["of"].get("than", {})
        for chosen in (claim["of"], {"label": than} if isinstance(than, str) else than):
            for column, known in (("label", labels), ("cell", names)):
                value = chosen.get(column, [])
                assert set(value if isinstance(value, list) else [value]) <= known, id_
    for i, section in enumerate(REPORT):
        check_section(f"report[{i}]", section)
