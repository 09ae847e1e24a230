import math
from pathlib import Path
from typing import Any

import pytest
import yaml

from navbench.analysis.claims import COLUMNS, Claim, Tolerance, judge, verdict
from navbench.analysis.measures import check_measure
from navbench.mathematics.statistics import Estimate
from navbench.report.sections import check_section
from navbench.validation import DescriptionError, describe

CONF = Path(__file__).parents[1] / "conf/study"
STUDY = {
    key: value
    for name in ("aouf2019", "aouf2019/claims", "aouf2019/report")
    for key, value in yaml.safe_load((CONF / f"{name}.yaml").read_text()).items()
}
PID_SPEED_MPS = 0.15


def a_claim(printed: float = 10.0, evidence: Any = "free", **tolerance: float) -> Claim:
    return Claim(
        id="a",
        statement="it takes so long",
        where="Table 1",
        printed=printed,
        unit="s",
        measure={"name": "median"},
        tolerance=Tolerance(**(tolerance or {"relative": 0.1})),
        evidence=evidence,
    )


def found(value: float) -> Estimate:
    return Estimate(value, value, value, 1)


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
    assert verdict(a_claim(), found(value)) == (expected, "")


def test_an_absolute_tolerance_is_in_the_unit_of_the_claim() -> None:
    claim = a_claim(printed=1.0, absolute=0.05)
    assert [verdict(claim, found(value))[0] for value in (0.96, 0.91, 0.89)] == [
        "reproduced",
        "partly",
        "not_reproduced",
    ]


@pytest.mark.parametrize("printed", [-10.0, 10.0])
def test_a_relative_tolerance_has_a_width_for_either_sign(printed: float) -> None:
    assert verdict(a_claim(printed=printed), found(1.05 * printed))[0] == "reproduced"


@pytest.mark.parametrize("measured", [None, found(math.nan), found(math.inf)])
def test_what_could_not_be_measured_is_not_testable(measured: Estimate | None) -> None:
    decided, reason = verdict(a_claim(), measured)
    assert decided == "not_testable"
    assert reason


@pytest.mark.parametrize(("value", "word"), [(10.0, "agrees"), (11.5, "partly agrees")])
def test_a_fitted_figure_that_agrees_is_not_testable(value: float, word: str) -> None:
    decided, reason = verdict(a_claim(evidence="fitted"), found(value))
    assert decided == "not_testable"
    assert word in reason
    assert "fitted" in reason


def test_a_fitted_figure_that_disagrees_is_not_reproduced() -> None:
    assert verdict(a_claim(evidence="fitted"), found(20.0)) == ("not_reproduced", "")


@pytest.mark.parametrize("evidence", ["free", "selected", "layout_unknown"])
def test_other_evidence_does_not_change_the_verdict(evidence: str) -> None:
    assert verdict(a_claim(evidence=evidence), found(10.0))[0] == "reproduced"


@pytest.mark.parametrize("tolerance", [{}, {"relative": 0.1, "absolute": 1.0}])
def test_a_tolerance_is_relative_or_absolute(tolerance: dict[str, float]) -> None:
    with pytest.raises((ValueError, DescriptionError), match="either relative or absolute"):
        Tolerance(**tolerance)


@pytest.mark.parametrize("wrong", [{"evidence": "sure"}, {"printed": "10"}, {"id": ""}, {"extra": 1}])
def test_a_claim_refuses_what_it_does_not_know(wrong: dict[str, Any]) -> None:
    values = {
        "id": "a",
        "statement": "",
        "where": "",
        "printed": 1.0,
        "unit": "",
        "measure": {"name": "median"},
        "tolerance": {"relative": 0.1},
        "evidence": "free",
    }
    describe(Claim, values, "claim")
    with pytest.raises(DescriptionError, match=next(iter(wrong))):
        describe(Claim, values | wrong, "claim")


def test_the_table_of_claims_has_the_columns_that_readers_rely_on() -> None:
    table = judge([a_claim(), a_claim()], [found(10.0), None])
    assert list(table.columns) == [
        "id",
        "statement",
        "where",
        "printed",
        "unit",
        "measured",
        "low",
        "high",
        "n",
        "tolerance",
        "evidence",
        "verdict",
        "reason",
    ]
    assert list(table.columns) == COLUMNS
    assert table["verdict"].tolist() == ["reproduced", "not_testable"]
    assert table["n"].tolist() == [1, 0]
    assert table["tolerance"].tolist() == ["±10 %", "±10 %"]
    assert math.isnan(table["measured"][1])


def claims_of(beginning: str) -> dict[str, dict[str, Any]]:
    return {claim["id"]: claim for claim in STUDY["claims"] if claim["id"].startswith(beginning)}


def test_the_study_of_aouf2019_claims_all_24_entries_of_its_tables() -> None:
    times, lengths = claims_of("time-"), claims_of("length-")
    assert len(times) == len(lengths) == 12
    for id_, claim in lengths.items():
        if "sflc" not in id_:  # every printed length of a PID is its printed time at one speed
            time_s = times[id_.replace("length", "time")]["printed"]
            assert claim["printed"] == pytest.approx(PID_SPEED_MPS * time_s, abs=1e-9)


def test_the_printed_tables_of_the_report_take_each_entry_from_one_claim() -> None:
    tables = [section for section in STUDY["report"] if section["name"] == "printed_table"]
    assert [table["claims"] for table in tables] == ["time-", "length-"]
    for table in tables:
        entries = [
            (claim["measure"]["metric"], claim["measure"]["select"]["label"], claim["measure"]["select"]["world"])
            for claim in claims_of(table["claims"]).values()
        ]
        printed = table["labels"][:4]
        worlds = table["worlds"].values()
        assert sorted(entries) == sorted((table["metric"], label, world) for label in printed for world in worlds)


def test_no_claim_of_aouf2019_passes_for_free_evidence_where_something_was_chosen() -> None:
    evidence = {claim["id"]: claim["evidence"] for claim in STUDY["claims"]}
    assert "free" not in evidence.values()
    for id_, kind in evidence.items():
        if id_.startswith(("time-", "length-", "faster-fig", "shorter-fig")):
            assert kind == ("selected" if id_.endswith("fig15") else "fitted"), id_
    assert evidence["pid-speed"] == "fitted"


def test_the_claims_and_the_report_of_aouf2019_are_understood() -> None:
    ids = [claim["id"] for claim in STUDY["claims"]]
    assert len(set(ids)) == len(ids)
    for i, claim in enumerate(STUDY["claims"]):
        described = describe(Claim, claim, f"claims[{i}]")
        check_measure(f"claims[{i}].measure", described.measure)
    labels = {cell["label"] for cell in STUDY["cells"]}
    names = {cell["name"] for cell in STUDY["cells"]}
    for claim in STUDY["claims"]:
        for key in ("select", "than"):
            chosen = claim["measure"].get(key, {})
            for column, known in (("label", labels), ("name", names)):
                value = chosen.get(column, [])
                assert set(value if isinstance(value, list) else [value]) <= known, claim["id"]
    for i, section in enumerate(STUDY["report"]):
        check_section(f"report[{i}]", section)
