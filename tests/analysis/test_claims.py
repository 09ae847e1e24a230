import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from stored import a_cell, a_record, store

from navbench.analysis.claims import Claim, check_claims, entries
from navbench.analysis.estimates import median_of
from navbench.analysis.printed import band, limits, quantity
from navbench.analysis.verdicts import COLUMNS, judged, verdict, verdicts_in
from navbench.mathematics.statistics import Estimate, clopper_pearson
from navbench.report.sections import check_section
from navbench.validation import DescriptionError, describe

CONF = Path(__file__).parents[2] / "conf/study"
STUDY = yaml.safe_load((CONF / "aouf2019.yaml").read_text())
CLAIMS = yaml.safe_load((CONF / "aouf2019/claims.yaml").read_text())
REPORT = yaml.safe_load((CONF / "aouf2019/report.yaml").read_text())["report"]
PAPERS = sorted(path.parent.name for path in CONF.glob("*/claims.yaml"))
PID_SPEED_MPS = 0.15


def a_number(printed: Any = "10 s", within: Any = "10 %", **more: Any) -> Claim:
    return Claim(says="it takes so long", printed=printed, within=within, measure="median", **more)


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
    claim = a_number(1, 0.05)
    assert [verdict(claim, found(value))[0] for value in (0.96, 0.91, 0.89)] == [
        "reproduced",
        "partly",
        "not_reproduced",
    ]


@pytest.mark.parametrize("printed", [-10, 10])
def test_a_relative_tolerance_has_a_width_for_either_sign(printed: int) -> None:
    assert verdict(a_number(printed), found(1.05 * printed))[0] == "reproduced"


@pytest.mark.parametrize("measured", [None, found(math.nan), found(math.inf)])
def test_what_could_not_be_measured_is_not_testable(measured: Estimate | None) -> None:
    decided, reason = verdict(a_number(), measured)
    assert decided == "not_testable"
    assert reason


@pytest.mark.parametrize(("value", "word"), [(10.0, "agrees"), (11.5, "partly agrees"), (20.0, "does not agree")])
def test_a_figure_that_was_fitted_is_not_testable_whether_it_agrees_or_not(value: float, word: str) -> None:
    told = "not_testable", f"fitted to this figure, with which it {word}"
    assert verdict(a_number(), found(value), evidence="fitted") == told


def test_a_printed_number_with_decimals_reaches_half_a_unit_of_the_last_one_to_both_sides() -> None:
    assert limits("printed", "0.30 m") == (0.295, 0.305)
    assert limits("printed", "18 s") == limits("printed", 18) == (18.0, 18.0)
    assert verdict(a_number("0.3 m", 0.01), found(0.358))[0] == "reproduced"
    assert verdict(a_number("0.30 m", 0.01), found(0.316))[0] == "partly"


def test_a_band_s_ends_reach_further_where_they_are_as_printed() -> None:
    assert band("0.30", "0.35") == pytest.approx((0.295, 0.355))
    assert band(0.3, 0.35) == (0.3, 0.35)


@pytest.mark.parametrize(
    ("cases", "expected"),
    [
        ([*range(95, 106), 95, 105] * 2 + [300], "reproduced"),  # one lies far away, outside of the central ones
        ([101 + 0.1 * i for i in range(20)], "partly"),
        ([120 + 0.1 * i for i in range(20)], "not_reproduced"),
        ([80, 90, 100, 110, 120] * 4, "not_testable"),
    ],
)
def test_a_printed_single_run_is_held_against_the_central_cases(cases: list[float], expected: str) -> None:
    measured = median_of(cases)
    assert measured is not None
    decided, reason = verdict(a_number("100 s", "10 %", compare="distribution"), measured.central)
    assert decided == expected
    assert reason == ("chaotic: 90 % of 20 cases lie in [80, 120]" if expected == "not_testable" else "")


@pytest.mark.parametrize("evidence", ["free", "selected", "layout_unknown"])
def test_other_evidence_does_not_change_the_verdict(evidence: str) -> None:
    assert verdict(a_number(), found(10.0), evidence=evidence)[0] == "reproduced"


@pytest.mark.parametrize(("value", "expected"), [(0.95, "reproduced"), (0.91, "partly"), (0.89, "not_reproduced")])
def test_a_statement_holds_in_so_many_cases_and_partly_with_twice_the_exceptions(value: float, expected: str) -> None:
    claim = Claim(says="it arrives", holds="in 95 % of the cases", measure="share_reached")
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
        ({"printed": "fast"}, "printed=fast: must be a number, or one with its unit"),
        ({"within": None}, "`within` beside `printed`"),
        ({"holds": "in 95 % of the cases"}, "either `printed` or `holds`"),
        ({"compare": "median"}, "compare"),
        ({"measure": None, "plausible": {"metric": ["time_s"]}}, "`plausible` only beside `measure`"),
        ({"practically_equal": 1.0}, "only beside `holds: below` or `above`"),
        ({"extra": 1}, "extra"),
    ],
)
def test_a_claim_refuses_what_it_does_not_know(wrong: dict[str, Any], says: str) -> None:
    values = {"says": "", "printed": 1.0, "within": "10 %", "measure": "median"}
    describe(Claim, values, "claim")
    with pytest.raises(DescriptionError, match=says):
        describe(Claim, values | wrong, "claim")


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"holds": "under 0"}, "holds=under 0: must be as `in 95 % of the cases`"),
        ({"holds": "below 0", "compare": "distribution"}, "`compare` only beside `printed` or a share that `holds`"),
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
    mine = {"metric": "path_length_m", "label": "A"}
    number = {"printed": "9 m", "within": "5 %"}
    shorter = {"says": "it is", "holds": "below 0", "measure": "difference", "of": {**mine, "than": "B"}}
    claims = {
        "printed": {"says": "it takes 9 m", **number, "measure": "median", "of": mine},
        "none": {"says": "nothing compares", **number},
        "shorter": shorter,
        "equal": {**shorter, "practically_equal": "10.1 %"},  # of 10 m, and it is shorter by 1 m
        "metres": {**shorter, "practically_equal": "0.9 m"},
    }
    cells = [(a_cell(label), [a_record(length_m=length_m)] * 6) for label, length_m in (("A", 9.0), ("B", 10.0))]
    table = judged(store(tmp_path, cells, {"name": "mine", "claims": claims}))
    assert list(table.columns) == list(COLUMNS)
    assert table["id"].tolist() == list(claims)
    assert table["verdict"].tolist() == ["reproduced", "not_testable", "supported", "practically_equal", "supported"]
    assert table["tolerance"].tolist() == ["±5 %", "±5 %", "below 0", "below 0", "below 0"]
    assert table["measured"].tolist()[2:] == [-1.0] * 3
    assert table["n"].tolist() == [6, 0, 6, 6, 6]
    assert table["printed"].tolist() == ["9", "9", "", "", ""]
    assert verdicts_in(table)[0] == "reproduced"
    assert verdicts_in(table[2:]) == ("not_testable", "supported", "contradicted", "practically_equal", "undecided")
    assert "supported" not in verdicts_in(table[:2])


STATEMENT = {"says": "", "holds": "in 100 % of the cases", "measure": "share_reached"}
ASKED = {"says": "does it?", "measure": "share_reached", "of": {"label": "A"}}


@pytest.mark.parametrize(
    ("study", "says"),
    [
        ({"claims": {"a": ASKED}}, "mine.claims.a: must have either `printed` or `holds`"),
        ({"checks": {"a": {**ASKED, "holds": "below 0"}}}, "mine.checks.a.holds=below 0: a check is no hypothesis"),
        ({"questions": {"a": STATEMENT}}, "mine.questions.a: a question has a measure, and neither `printed`"),
        ({"claims": {"a": STATEMENT}, "checks": {"a": STATEMENT}}, "mine.checks.a: this id stands in another table"),
        ({"claims": {"a": {**STATEMENT, "evidence": "free"}}}, "mine.claims.a.evidence: unknown key; it is computed"),
        (
            {"claims": {"a": {**STATEMENT, "of": {"metrc": 2}, "plausible": {"metrc": [1]}}}},
            "mine.claims.a.measure: of.metrc: unknown key; share_reached takes",
        ),
        (
            {"claims": {"a": {**STATEMENT, "of": {"world": "A"}, "plausible": {"wrld": ["B"]}}}},
            "mine.claims.a.plausible.wrld: must stand in `of`, too; did you mean world?",
        ),
    ],
)
def test_what_stands_in_a_wrong_table_is_refused_in_one_line(study: dict[str, Any], says: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        check_claims("mine.", study)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_results_that_were_stored_with_a_typed_evidence_are_read() -> None:
    (entry,) = entries("", {"claims": {"a": {**STATEMENT, "evidence": "free"}}}, stored=True)
    assert (entry.name, entry.kind) == ("a", "claim")


def test_checks_pass_or_fail_and_questions_have_no_verdict(tmp_path: Path) -> None:
    share = {"says": "it arrives", "measure": "share_reached", "of": {"label": "A"}}
    study = {
        "name": "mine",
        "claims": {"statement": {**share, "holds": "in 95 % of the cases"}},
        "checks": {
            "all": {**share, "holds": "in 100 % of the cases"},
            "time": {**share, "printed": "3 s", "within": 0.5, "measure": "median", "of": {"metric": "time_s"}},
            "none": {**share, "holds": "in 95 % of the cases", "of": {"label": "Z"}},
        },
        "questions": {"open": share, "most": {**share, "holds": "above 0.1"}},
    }
    table = judged(store(tmp_path, [(a_cell("A"), [a_record()] * 40)], study)).set_index("id")
    assert table["verdict"].to_dict() == {
        "statement": "reproduced",
        "all": "passed",
        "time": "failed",
        "none": "failed",
        "open": "",
        "most": "supported",
    }
    assert table["kind"].tolist() == ["claim", *["check"] * 3, *["question"] * 2]
    assert table["reason"]["none"].startswith("not measured: ")
    assert table["evidence"].tolist() == ["selected", "", "", "", "", ""]


def test_a_claim_tells_its_figure_over_what_is_plausible_and_whether_the_verdict_depends_on_it(tmp_path: Path) -> None:
    of = {"metric": "time_s", "label": "A"}
    claim = {"says": "", "printed": "10 s", "within": "5 %", "measure": "median", "of": of}
    claims = {
        "hangs": {**claim, "plausible": {"label": ["B"], "metric": ["path_length_m", "time_s"]}},
        "stays": {**claim, "plausible": {"label": ["A"]}},
    }
    cells = [(a_cell(label), [a_record(time_s=time_s)]) for label, time_s in (("A", 10.0), ("B", 10.9))]
    table = judged(store(tmp_path, cells, {"name": "mine", "claims": claims})).set_index("id")
    assert table["depends_on"].tolist() == ["partly at label=B; not reproduced at metric=path_length_m", ""]
    assert table[["plausible_low", "plausible_high"]].to_numpy().tolist() == [[3.0, 10.9], [10.0, 10.0]]


@pytest.mark.parametrize(
    ("held", "word"), [(96, "reproduced"), (94, "not_testable"), (40, "not_testable"), (4, "not_reproduced")]
)
def test_a_statement_on_a_single_run_is_refuted_only_where_hardly_any_case_shows_it(held: int, word: str) -> None:
    values = {"says": "", "holds": "in 95 % of the cases", "compare": "distribution", "measure": "share_reached"}
    measured = clopper_pearson(held, 100)
    decided, reason = verdict(describe(Claim, values, "claim"), measured)
    assert decided == word
    assert reason == (f"chaotic: it holds in {held} % of 100 cases" if word == "not_testable" else "")


def test_only_a_median_has_a_distribution_to_compare_with(tmp_path: Path) -> None:
    claim = {"says": "", "printed": "10.0 s", "within": "5 %", "compare": "distribution"}
    claims = {
        "median": {**claim, "measure": "median", "of": {"metric": "time_s"}},
        "share": {**claim, "measure": "share_reached", "of": {"label": "A"}},
    }
    records = [a_record(time_s=9.9 + 0.01 * i) for i in range(21)]
    table = judged(store(tmp_path, [(a_cell("A"), records)], {"name": "mine", "claims": claims})).set_index("id")
    assert table["verdict"].to_dict() == {"median": "reproduced", "share": "not_testable"}
    assert table[["low", "high"]].to_numpy()[0].tolist() == pytest.approx([9.91, 10.09])
    assert "share_reached: has no distribution to compare with" in table["reason"]["share"]


def test_results_that_keep_their_claims_as_a_list_are_refused(tmp_path: Path) -> None:
    stored = store(tmp_path, [(a_cell("A"), [a_record()])], {"name": "old", "claims": [{"id": "a"}]})
    with pytest.raises(DescriptionError, match="claims: must be a mapping from ids"):
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


@pytest.mark.parametrize("paper", PAPERS)
def test_the_claims_of_every_paper_are_understood(paper: str) -> None:
    check_claims("", {"claims": yaml.safe_load((CONF / paper / "claims.yaml").read_text())})


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
