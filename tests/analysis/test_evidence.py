"""What an agreement is worth, computed from the sources of the values that a claim's cells use."""

from pathlib import Path
from typing import Any

import pytest
from stored import a_cell, a_record, store

from navbench.analysis.verdicts import judged
from navbench.cli.study_configuration import compose_study
from navbench.sources import Source
from navbench.validation import DescriptionError, describe

FREE = {"robot": {"radius_m": {"paper": "Table 1"}}}


def told(path: Path, sources: dict[str, Any], **claims: dict[str, Any]) -> dict[str, tuple[str, str]]:
    """Return evidence and reason of some claims on a cell in "plain" with these sources, and on a free one in "other".

    Each claim is said by what its median of times selects.
    """
    cells = [
        (a_cell("A", "plain")._replace(sources={**FREE, **sources}), [a_record()]),
        (a_cell("A", "other")._replace(sources={**FREE, "controller": sources.get("controller", {})}), [a_record()]),
    ]
    asked = {
        name: {"says": "", "printed": "10 s", "within": "5 %", "measure": "median", "of": {"metric": "time_s", **of}}
        for name, of in claims.items()
    }
    table = judged(store(path, cells, {"name": "mine", "claims": asked})).set_index("id")
    return dict(zip(table.index, zip(table["evidence"], table["because"], strict=True), strict=True))


HERE, THERE = {"world": "plain"}, {"world": "other"}


def test_nothing_chosen_is_free(tmp_path: Path) -> None:
    sources = {"controller": {"build.kp": {"assumed": "why", "range": [0.0, 1.0]}}, "world": {"walls": {"paper": "x"}}}
    assert told(tmp_path, sources, here=HERE) == {"here": ("free", "")}


@pytest.mark.parametrize("id_", ["here", "mine.here"])
def test_what_was_fitted_to_a_claim_is_fitted_there_and_selected_to_the_others_in_its_worlds(
    id_: str, tmp_path: Path
) -> None:
    sources = {"controller": {"build.kp": {"fitted": "why", "claims": [id_]}}}
    assert told(tmp_path, sources, here=HERE, beside=HERE, there=THERE, both={}) == {
        "here": ("fitted", "pid.kp fitted to it"),
        "beside": ("selected", "pid.kp fitted in plain"),
        "there": ("free", ""),
        "both": ("selected", "pid.kp fitted in plain"),
    }


def test_a_world_that_was_fitted_to_another_study_is_selected(tmp_path: Path) -> None:
    sources = {"world": {"boxes": {"fitted": "why", "claims": ["other.here"]}}}
    found = told(tmp_path, sources, here=HERE, there=THERE)
    assert found == {"here": ("selected", "plain.boxes fitted in plain"), "there": ("free", "")}


def test_what_was_selected_in_a_world_is_selected_there_alone(tmp_path: Path) -> None:
    sources = {"controller": {f"build.{name}": {"selected": "why", "worlds": ["plain"]} for name in ("kp", "gain")}}
    found = told(tmp_path, sources, here=HERE, there=THERE)
    assert found == {"here": ("selected", "pid.gain, pid.kp selected in plain"), "there": ("free", "")}


def test_a_layout_that_is_assumed_is_unknown_unless_more_was_chosen(tmp_path: Path) -> None:
    sources: dict[str, Any] = {"world": {"boxes": {"assumed": "no numbers"}, "time_limit_s": {"assumed": "long"}}}
    assert told(tmp_path / "a", sources, here=HERE) == {"here": ("layout_unknown", "plain.boxes assumed")}
    sources["world"]["starts"] = {"selected": "why", "worlds": ["plain"]}
    assert told(tmp_path / "b", sources, here=HERE) == {"here": ("selected", "plain.starts selected in plain")}


def test_what_a_controller_tells_of_itself_depends_on_its_own_values_alone(tmp_path: Path) -> None:
    sources = {
        "controller": {"build.rules": {"fitted": "why", "claims": ["count"]}},
        "world": {"boxes": {"assumed": "no numbers"}},
    }
    cell = a_cell("A")._replace(sources=sources)
    of = {"table": "pid-rules", "column": "n", "where": {"kind": "AO"}}
    number = {"says": "", "printed": "58 rules", "within": "5 %", "measure": "described_value", "of": of}
    claims = {"count": number, "again": number}
    tables = {"pid-rules": {"kind": ["AO"], "n": [40]}}
    table = judged(store(tmp_path, [(cell, [a_record()])], {"name": "mine", "claims": claims}, None, tables))
    assert table["evidence"].tolist() == ["fitted", "free"]
    assert table["verdict"].tolist() == ["not_testable", "not_reproduced"]


@pytest.mark.parametrize(
    "source",
    [
        {"fitted": "why", "claims": ["a.b", "c"], "range": [0.0, 1.0], "scale": "linear"},
        {"selected": "why", "worlds": ["corner"], "choices": ["safe", "literal"]},
        {"assumed": "why", "range": [0.5, 2.0], "apply": "scale", "scale": "log"},
        {"assumed": "why", "range": [None, 10.0], "tie": ["build.left"]},
        {"assumed": "why", "group": "layout"},
        {"tuned": "by pso", "seed": 0},
    ],
)
def test_a_source_of_each_kind_is_taken(source: dict[str, Any]) -> None:
    assert describe(Source, source, "it").kind in source


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ({}, "must have one of paper, derived, public, tuned, fitted, selected, assumed, with why; it has none"),
        ({"paper": "a", "assumed": "b"}, "it has paper, assumed"),
        ({"fitted": "why"}, "must have `claims` beside `fitted`, and only there"),
        ({"assumed": "why", "worlds": ["corner"]}, "must have `worlds` beside `selected`, and only there"),
        ({"paper": "why", "range": [0.0, 1.0]}, "`range` or `choices` only beside fitted, selected, assumed"),
        ({"assumed": "why", "range": [1.0, 0.5]}, r"range=\[1, 0.5\]: the first must be below the second"),
        ({"assumed": "why", "range": [0.0, 0.5], "choices": [0, 1]}, "one of `range` and `choices`, not both"),
        ({"assumed": "why", "choices": [1]}, "must be at least two"),
        ({"assumed": "why", "range": [0.0, 0.5], "scale": "log"}, "scale=log: must have a range above 0"),
        ({"assumed": "why", "choices": [1, 2], "apply": "peak"}, "apply=peak: must have a range"),
        ({"assumed": "why", "apply": "scale"}, "`apply` only beside `range` or `choices`"),
        ({"assumed": "why", "apply": "shift", "range": [0.0, 0.5]}, "apply='shift': must be 'scale', 'step' or 'peak'"),
        ({"assume": "why"}, "assume: unknown key; did you mean assumed?"),
    ],
)
def test_a_source_that_says_too_little_or_too_much_is_refused(source: dict[str, Any], says: str) -> None:
    with pytest.raises(DescriptionError, match=says) as caught:
        describe(Source, source, "robot.sources.radius_m")
    assert str(caught.value).startswith("robot.sources.radius_m")
    assert "\n" not in str(caught.value)


STUDY = """# A study whose radius was chosen somewhere
title: mine
cells:
  - label: go_to_goal
    overrides: [controller=go_to_goal, world=corner, '~robot.sources.radius_m', '+robot.sources.radius_m={SOURCE}']
claims:
  arrives: {says: it arrives, holds: in 95 % of the cases, measure: share_reached, of: {label: go_to_goal}}
"""


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("fitted: why, claims: [arrives, mine.arrives, aouf2019.anything]", None),
        ("selected: why, worlds: [corner, lei_swap]", None),
        ("fitted: why, claims: [arrive]", "claims=arrive: unknown; did you mean arrives?"),
        ("fitted: why, claims: [mine.arrive]", "claims=mine.arrive: unknown; did you mean mine.arrives?"),
        ("fitted: why, claims: [aouf2091.arrives]", "claims=aouf2091.arrives: unknown; did you mean"),
        ("selected: why, worlds: [corners]", "worlds=corners: unknown; did you mean corner?"),
        ("selected: why", "robot.sources.radius_m: must have `worlds` beside `selected`"),
    ],
)
def test_claims_and_worlds_that_a_source_names_must_be_there(source: str, says: str | None, tmp_path: Path) -> None:
    (tmp_path / "study").mkdir()
    (tmp_path / "study/mine.yaml").write_text(STUDY.replace("SOURCE", source))
    if says is None:
        compose_study("mine", config_dir=tmp_path)
        return
    with pytest.raises(DescriptionError) as caught:
        compose_study("mine", config_dir=tmp_path)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
