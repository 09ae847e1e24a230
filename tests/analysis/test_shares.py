"""Shares of reconstructions, from made-up ones, and printed numbers fitted together."""

from typing import Any

import numpy as np
import pandas as pd
import pytest

from navbench.analysis.claims import Claim, Entry
from navbench.analysis.fitting import fit, in_sample
from navbench.analysis.multiverse import KIND, Conditioned, Multiverse
from navbench.analysis.printed import tolerated
from navbench.analysis.shares import CHAOTIC, FAILS, HOLDS, PARTLY, UNKNOWN, Drawn, halves, shares_of, undecided, worth
from navbench.mathematics.statistics import Estimate
from navbench.report.multiverse import _curved
from navbench.report.shares import central, curves, word_of
from navbench.report.specification import has_curve, specification

SCRAMBLES, EACH = 4, 250
N = SCRAMBLES * EACH


def drawn(codes: dict[str, Any], values: dict[str, Any] | None = None, u: Any = None) -> Drawn:
    """Return a sample with these codes and values of claims, and where each reconstruction lies."""
    u = np.random.default_rng(0).random((N, 2)) if u is None else u
    rows = pd.DataFrame(
        {
            "scramble": np.repeat(np.arange(SCRAMBLES), EACH),
            "index": np.tile(np.arange(EACH), SCRAMBLES),
            **{f"code:{name}": np.broadcast_to(of, N) for name, of in codes.items()},
            **{f"value:{name}": np.broadcast_to(of, N) for name, of in (values or {}).items()},
        }
    )
    return Drawn(rows, u, ["first", "second"], dict.fromkeys(codes, [0, 1]), pd.DataFrame())


def number(name: str, printed: str = "10.0 s", within: str = "10 %") -> Entry:
    return Entry(name, "claim", Claim(says=name, printed=printed, within=within, measure="median"))


ADMISSIBLE = Entry("ok", KIND, Claim(says="ok", holds="in 80 % of the cases", measure="share_reached"))
NOTHING = Multiverse(admissible={})


@pytest.mark.parametrize(
    ("held", "verdict"),
    [(N, "robust"), (N - 10, "robust"), (N - 45, "open"), (N // 2, "open"), (30, "contradicted"), (0, "out of reach")],
)
def test_a_verdict_goes_by_the_bound_of_the_interval(held: int, verdict: str) -> None:
    codes = np.where(np.random.default_rng(1).permutation(N) < held, HOLDS, FAILS)
    (one,) = shares_of(drawn({"a": codes}), [number("a")], NOTHING)
    assert one.all.value == held / N
    assert one.all.low <= one.all.value <= one.all.high
    assert one.verdict == verdict


def test_what_decides_is_asked_of_claims_between_of_all_or_of_admissible_reconstructions() -> None:
    ok = np.arange(N) % 2 == 0
    order = np.random.default_rng(1).permutation(N)
    codes = {
        "nearly all": np.where(order < N - 10, HOLDS, FAILS),
        "near the bound": np.where(order < N - 45, HOLDS, FAILS),
        "half": np.where(order < N // 2, HOLDS, FAILS),
        "hardly any": np.where(order < 10, HOLDS, FAILS),
        "never": FAILS,
        "of admissible ones": np.where(ok, FAILS, np.where(order < N - 10, HOLDS, FAILS)) | (ok & (order < 300)),
    }
    sample = drawn({"ok": np.where(ok, HOLDS, FAILS), **codes})
    claims = [ADMISSIBLE, *map(number, codes)]
    assert undecided(sample, claims, NOTHING) == ["near the bound", "half", "of admissible ones"]
    for one in shares_of(sample, claims, NOTHING):
        assert one.verdict != "open" or one.claim.name in undecided(sample, claims, NOTHING)


def run_of(name: str) -> Entry:
    """Return a claim that compares a printed single run with starts within a millimetre."""
    claim = Claim(says=name, printed="10.0 s", within="10 %", measure="median", compare="distribution")
    return Entry(name, "claim", claim)


@pytest.mark.parametrize(
    ("codes", "verdict", "share"),
    [
        ([(PARTLY, 400), (HOLDS, 100), (FAILS, 500)], "open", 0.5),  # a median within the tolerance is enough
        ([(PARTLY, 1000)], "robust", 1.0),
        ([(CHAOTIC, 300), (FAILS, 690), (HOLDS, 10)], "open", 0.01),  # what is chaotic does not fail
        ([(FAILS, 985), (CHAOTIC, 5), (HOLDS, 10)], "contradicted", 0.01),
        ([(CHAOTIC, 300), (UNKNOWN, 300), (HOLDS, 400)], "not testable", 0.4),
        ([(CHAOTIC, 1000)], "not testable", 0.0),
        ([(CHAOTIC, 400), (FAILS, 600)], "out of reach", 0.0),
    ],
)
def test_a_printed_run_holds_within_its_tolerance_and_fails_only_where_that_can_be_told(
    codes: list[tuple[int, int]], verdict: str, share: float
) -> None:
    shuffled = np.random.default_rng(2).permutation(np.repeat(*np.array(codes).T))
    (one,) = shares_of(drawn({"a": shuffled}), [run_of("a")], NOTHING)
    assert (one.verdict, one.all.value) == (verdict, share)


def test_partly_holds_of_no_other_claim() -> None:
    (one,) = shares_of(drawn({"a": PARTLY}), [number("a")], NOTHING)
    assert one.verdict == "out of reach"


def test_what_only_a_search_finds_is_within_reach() -> None:
    never = drawn({"a": FAILS})
    assert [one.verdict for one in shares_of(never, [number("a")], NOTHING)] == ["out of reach"]
    assert [one.verdict for one in shares_of(never, [number("a")], NOTHING, found=["a"])] == ["contradicted"]


def test_of_admissible_reconstructions_alone_the_share_is_another_and_decides_the_verdict() -> None:
    ok = np.arange(N) % 2 == 0
    sample = drawn({"ok": np.where(ok, HOLDS, FAILS), "a": np.where(ok, HOLDS, FAILS), "b": HOLDS})
    a, b = shares_of(sample, [ADMISSIBLE, number("a"), number("b")], Multiverse(admissible={}, implied=("b",)))
    assert (a.all.value, a.admissible and a.admissible.value, a.admissible and a.admissible.n) == (0.5, 1.0, N // 2)
    assert a.verdict == "robust"
    assert b.admissible is None


@pytest.mark.parametrize(("count", "verdict"), [(199, "open"), (200, "robust")])
def test_few_admissible_reconstructions_do_not_decide(count: int, verdict: str) -> None:
    ok = np.arange(N) < count
    sample = drawn({"ok": np.where(ok, HOLDS, FAILS), "a": np.where(ok, HOLDS, FAILS)})
    (a,) = shares_of(sample, [ADMISSIBLE, number("a")], NOTHING)
    assert a.verdict == verdict


def test_conditioned_are_those_that_meet_the_printed_numbers_which_are_tested_no_more() -> None:
    values = np.where(np.arange(N) % 4 == 0, 10.9, 13.0)
    sample = drawn({"a": FAILS, "b": np.where(np.arange(N) % 4 == 0, HOLDS, FAILS)}, {"a": values, "b": 0.0})
    conditioned = Conditioned(claims=("a",), within="10 %")
    a, b = shares_of(sample, [number("a"), number("b")], Multiverse(admissible={}, conditioned=conditioned))
    assert a.conditioned is None
    assert b.conditioned is not None
    assert (b.conditioned.value, b.conditioned.n) == (1.0, N // 4)


def test_what_has_no_case_and_what_is_chaotic_hold_nothing_and_are_counted_apart() -> None:
    codes = np.select([np.arange(N) % 10 == 0, np.arange(N) % 10 == 1], [UNKNOWN, CHAOTIC], HOLDS)
    (one,) = shares_of(drawn({"a": codes}), [number("a")], NOTHING)
    assert (one.all.value, one.without_case, one.chaotic) == (0.8, 0.1, 0.1)


def test_the_factor_that_decides_tells_most_and_one_that_cannot_reach_a_claim_is_not_asked() -> None:
    u = np.random.default_rng(2).random((N, 2))
    sample = drawn({"a": np.where(u[:, 1] > 0.5, HOLDS, FAILS)}, u=u)
    (one,) = shares_of(sample, [number("a")], NOTHING)
    assert one.bits is not None
    assert one.bits[0] == "second"
    assert one.bits[1].value == pytest.approx(1.0, abs=0.05)  # of 16 bins one lies on both sides
    assert worth([one], sample)[0][0] == "second"
    (one,) = shares_of(sample._replace(reaches={"a": [0]}), [number("a")], NOTHING)
    assert one.bits is not None
    assert one.bits[0] == "first"
    assert one.bits[1].value < 0.02


def test_a_curve_joins_the_parts_of_a_range_and_tells_choices_apart() -> None:
    u = np.random.default_rng(2).random((N, 2))
    sample = drawn({"a": np.where(u[:, 0] < 0.5, HOLDS, FAILS)})._replace(u=u, reaches={"a": [0]})
    (one,) = shares_of(sample, [number("a")], NOTHING)
    joined, apart = (
        curves(sample, [one], choices, ends).axes[0]
        for choices, ends in (({}, {"first": (0.03, 0.13)}), ({"first": (True, False)}, {}))
    )
    assert joined.lines[0].get_linestyle() == "-"
    assert np.asarray(joined.lines[0].get_ydata()).tolist() == [1.0] * 4 + [0.0] * 4
    assert [label.get_text() for label in joined.get_xticklabels()] == ["0.03", "0.13"]
    assert joined.get_xlabel() == "first, over its range"
    assert apart.lines[0].get_linestyle() == "None"
    assert np.asarray(apart.lines[0].get_ydata()).tolist() == [1.0, 0.0]
    assert [label.get_text() for label in apart.get_xticklabels()] == ["True", "False"]
    assert apart.get_xlabel() == "first, 2 choices"
    for numbers in ((3, 1), ("10 %", "5 %")):  # which stand in their order
        numbered = curves(sample, [one], {"first": numbers}, {}).axes[0]
        assert [label.get_text() for label in numbered.get_xticklabels()] == [str(numbers[1]), str(numbers[0])]
        assert np.asarray(numbered.lines[0].get_ydata()).tolist() == [0.0, 1.0]


def test_a_specification_curve_is_what_was_measured_in_order_over_the_values_that_decide_it() -> None:
    u = np.random.default_rng(0).random((N, 2))
    values = np.where(u[:, 1] < 0.02, np.nan, 20.0 * u[:, 0])  # few have no case
    sample = drawn({"a": np.where(abs(values - 10.0) <= 1.0, HOLDS, FAILS)}, {"a": values, "few": np.arange(N) % 9}, u)
    assert (has_curve(sample, "a"), has_curve(sample, "few")) == (True, False)
    (one,) = shares_of(sample, [number("a")], NOTHING)
    assert one.bits is not None
    one = one._replace(flips={"second": Estimate(0.3, 0.1, 0.5, 64)})  # which comes after what tells most
    figure = specification(sample, [one], {"second": (5, 1)}, {"first": (0.0, 3.0)}, {"a": 12.5})
    top, decides, other = figure.subfigs[0].axes
    holds, fails = (np.asarray(line.get_ydata(), dtype=float) for line in top.lines[:2])
    x = np.asarray(top.lines[0].get_xdata(), dtype=float)
    clear = np.abs(np.abs(holds - 10.0) - 1.0) > 0.1  # not at an end of where it holds
    np.testing.assert_array_equal(np.isnan(x)[clear], np.abs(holds - 10.0)[clear] > 1.0)
    assert (np.diff(holds) >= 0.0).all()
    np.testing.assert_array_equal(holds, fails)
    x = np.where(np.isnan(x), np.asarray(top.lines[1].get_xdata(), dtype=float), x)
    np.testing.assert_allclose(holds, np.quantile(values[np.isfinite(values)], x), atol=0.1)
    assert [float(np.asarray(line.get_ydata())[0]) for line in top.lines[2:4]] == [10.0, 12.5]
    assert top.get_ylabel() == "s"
    (found, even) = (np.asarray(axes.images[0].get_array()) for axes in (decides, other))
    assert np.abs(found.argmax(axis=0) - np.arange(64) // 8).max() <= 1  # the larger, the further right
    np.testing.assert_allclose(found.sum(axis=0), 1.0)
    assert even.shape == (2, 64)
    assert even[1].mean() == pytest.approx(np.mean(u[np.isfinite(values), 1] < 0.5), abs=0.01)  # 5, on top
    assert [label.get_text() for label in other.get_yticklabels()] == ["1", "5"]
    assert (decides.get_title(loc="left"), other.get_title(loc="left")) == ("first", "second")
    assert other.get_xlabel() == f"reconstructions with a case, sorted ({np.isfinite(values).sum()} of {N})"


def test_of_each_value_the_claim_that_depends_on_it_most_is_drawn_before_a_second_one() -> None:
    u = np.random.default_rng(5).random((N, 2))
    blurred = u[:, 0] + np.random.default_rng(6).normal(0.0, 0.1, N)
    codes = {"a bit": blurred < 0.5, "most": u[:, 0] < 0.5, "other": u[:, 1] < 0.2, "none": np.arange(N) % 2 == 0}
    sample = drawn({name: np.where(holds, HOLDS, FAILS) for name, holds in codes.items()}, u=u)
    shares = shares_of(sample, [*map(number, codes)], NOTHING)
    assert [one.claim.name for one in _curved(shares)] == ["most", "other", "a bit"]


def test_what_admissible_reconstructions_measure_is_told_of_200_or_more() -> None:
    ok = np.arange(N) % 2 == 0
    sample = drawn({"a": HOLDS}, {"a": np.where(ok, np.arange(N) / (N - 2), np.nan)})
    found = central(sample, number("a"), np.ones(N, dtype=bool))
    assert found is not None
    assert (*found[:3], found.n) == pytest.approx((0.5, 0.05, 0.95, N // 2))
    assert central(sample, number("a"), np.arange(N) < 398) is None
    assert central(sample, number("a"), np.arange(N) < 400) is not None


@pytest.mark.parametrize(
    ("printed", "within", "ends"),
    [
        ("10.0 s", "10 %", (8.95, 11.05)),
        ("0.9 s", "0.1 s", (0.75, 1.05)),
        ("-2 %", "2", (-4.0, 0.0)),
        (44, 1, (43, 45)),
    ],
)
def test_what_agrees_lies_beyond_the_printed_decimals_by_the_tolerance(
    printed: str | int, within: str | int, ends: tuple[float, float]
) -> None:
    assert tolerated(printed, within) == pytest.approx(ends)


@pytest.mark.parametrize(
    ("choice", "word"), [(None, "none"), (-0.39269908169872414, "-0.3927"), (1e-09, "1e-09"), (0.25, "0.25"), (7, "7")]
)
def test_a_choice_is_written_as_it_is_said(choice: Any, word: str) -> None:
    assert word_of(choice) == word


def test_numbers_that_hang_together_fit_better_than_permuted_ones() -> None:
    scale = np.random.default_rng(3).uniform(0.5, 2.0, N)  # one value stretches all three
    claims = [number(f"{printed}", f"{printed:.1f} s", "2 %") for printed in (10.0, 20.0, 35.0)]
    values = {entry.name: scale * float(entry.name) for entry in claims}
    found = fit(claims, in_sample(drawn(dict.fromkeys(values, HOLDS), values)))
    assert found is not None
    assert found.holds.tolist() == [True] * 3
    assert found.predicts.tolist() == [True] * 3
    np.testing.assert_allclose(found.values, [10.0, 20.0, 35.0], rtol=0.03)
    assert found.placebos.min() == 1
    assert fit([ADMISSIBLE], in_sample(drawn({"ok": HOLDS}, {"ok": 1.0}))) is None


def test_halves_of_the_scrambles_are_told_apart_only_where_they_differ() -> None:
    codes = np.where(np.random.default_rng(4).random(N) < 0.5, HOLDS, FAILS)
    first = np.arange(N) < N // 2
    alike = np.where(np.arange(N) % EACH < 125 + 5 * (np.arange(N) // EACH % 2), HOLDS, FAILS)  # of both halves
    assert halves(drawn({"a": alike}), number("a")) == 0.0
    assert halves(drawn({"a": np.where(first, HOLDS, codes)}), number("a")) > 1.96
    assert halves(drawn({"a": HOLDS}), number("a")) == 0.0


def test_a_number_that_has_nothing_to_do_with_the_others_is_met_but_not_predicted() -> None:
    rng = np.random.default_rng(5)
    claims = [number(f"{printed}", f"{printed:.1f} s", "5 %") for printed in (10.0, 20.0, 35.0)]
    scale = rng.uniform(0.9, 1.1, N)
    values = {"10.0": 10.0 * scale, "20.0": 20.0 * scale, "35.0": rng.uniform(0.0, 100.0, N)}
    found = fit(claims, in_sample(drawn(dict.fromkeys(values, HOLDS), values)))
    assert found is not None
    assert found.holds.tolist() == [True, True, True]
    assert found.predicts.tolist() == [True, True, False]
