"""The genetic algorithm: its operators one by one, against DEAP and by their laws, and what they find together."""

from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.stats import chisquare, kstest

from navbench.contract import FloatArray
from navbench.tuning.ga import Ga
from navbench.tuning.genetics import double_point_crossover, expected_copies, mutated, sus
from navbench.tuning.search import Tuner, tune
from navbench.tuning.space import Choice, Dimension, Side, space_of
from navbench.tuning.swarms import Pso, Random

FILE = Path(__file__).parents[2] / "conf" / "tuner" / "ga.yaml"
VALUES = {key: value for key, value in yaml.safe_load(FILE.read_text())["build"].items() if key != "_target_"}
GA = Ga(**VALUES)
PSO = Pso(n=10, w=0.7, c1=1.5, c2=1.5)
TERMS = ("NB", "NS", "Z", "PS", "PB")

REALS = [Dimension(f"x{i}", -5.12, 5.12, "linear") for i in range(30)]
RULES = [Choice(f"rule{i}", TERMS) for i in range(30)]
MIXED: list[Side] = [*REALS[:15], *RULES[:15]]


def changed(**other: Any) -> Ga:
    return Ga(**{**VALUES, **other})


# ---- selection


def test_the_best_is_expected_twice_the_worst_never_and_all_together_as_often_as_they_are() -> None:
    expected = expected_copies(np.array([7.0, 1.0, 3.0, 9.0, 5.0]), 2.0)
    assert expected.tolist() == [0.5, 2.0, 1.5, 0.0, 1.0]
    rng = np.random.default_rng(0)
    for pressure in (1.0, 1.3, 2.0):
        costs = rng.integers(0, 9, 30).astype(float)  # some are equal
        expected = expected_copies(costs, pressure)
        assert expected.sum() == pytest.approx(30.0)
        assert expected.min() >= 2.0 - pressure - 1e-12
        assert expected.max() <= pressure + 1e-12


def test_equal_costs_are_expected_equally_often_and_less_more_often() -> None:
    expected = expected_copies(np.array([2.0, 1.0, 2.0, 3.0, 2.0]), 1.8)
    assert len(set(expected[[0, 2, 4]])) == 1
    assert expected[1] > expected[0] > expected[3]
    assert expected_copies(np.full(6, 4.0), 2.0).tolist() == [1.0] * 6
    assert expected_copies(np.array([4.0]), 2.0).tolist() == [1.0]


def test_ranks_hang_on_the_order_of_the_costs_alone() -> None:
    costs = np.random.default_rng(1).uniform(1.0, 1450.0, 30)
    assert (expected_copies(costs, 2.0) == expected_copies(-1.0 / costs, 2.0)).all()  # F = 1 / cost, equation 4


def test_each_is_chosen_as_often_as_its_share_rounded_up_or_down() -> None:
    rng = np.random.default_rng(2)
    for count in (1, 7, 29, 100):
        for _ in range(100):
            shares = rng.random(12) * (rng.random(12) < 0.8) + [0.01, *([0.0] * 11)]
            copies = np.bincount(sus(shares, count, rng.random()), minlength=12)
            expected = count * shares / shares.sum()
            assert copies.sum() == count
            assert (copies >= np.floor(expected - 1e-9)).all()
            assert (copies <= np.ceil(expected + 1e-9)).all()


def test_on_average_each_is_chosen_as_often_as_its_share() -> None:
    rng, shares = np.random.default_rng(3), np.array([0.3, 2.0, 0.7, 1.1, 0.0])
    copies = np.mean([np.bincount(sus(shares, 7, rng.random()), minlength=5) for _ in range(4000)], axis=0)
    assert copies == pytest.approx(7 * shares / shares.sum(), abs=0.03)


def test_what_has_no_share_is_never_chosen_not_even_at_the_wheel_s_ends() -> None:
    for shares in ([0.0, 1.0, 1.0, 0.0], [0.0, 0.1, 0.1, 0.1, 0.0]):
        for offset in (0.0, 0.5, np.nextafter(1.0, 0.0)):
            for count in (1, 3, 10, 30):
                assert np.array(shares)[sus(np.array(shares), count, offset)].min() > 0.0


@pytest.mark.parametrize("count", [3, 10, 29])
def test_the_wheel_stops_where_that_of_deap_does(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    tools = pytest.importorskip("deap.tools")
    rng = np.random.default_rng(count)
    for _ in range(200):
        shares = np.sort(rng.random(12))[::-1]  # DEAP turns the wheel from the fittest on
        offset = rng.random()
        monkeypatch.setattr("random.uniform", lambda low, high, share=offset: low + share * (high - low))
        individuals = [SimpleNamespace(index=i, fitness=Fitness(share)) for i, share in enumerate(shares.tolist())]
        chosen = tools.selStochasticUniversalSampling(individuals, count)
        assert [one.index for one in chosen] == sus(shares, count, offset).tolist()


class Fitness:
    """As much of a DEAP fitness as its selection asks for."""

    def __init__(self, value: float) -> None:
        self.values = (value,)

    def __lt__(self, other: "Fitness") -> bool:
        return self.values < other.values

    def __gt__(self, other: "Fitness") -> bool:
        return self.values > other.values


# ---- crossover


def test_two_cuts_are_those_of_deap(monkeypatch: pytest.MonkeyPatch) -> None:
    tools = pytest.importorskip("deap.tools")
    for begin in range(1, 7):
        for end in range(begin + 1, 8):
            draws = iter([begin, end - 1])  # DEAP draws the second cut from one place fewer, and steps over the first
            monkeypatch.setattr("random.randint", lambda low, high, draws=draws: next(draws))
            mother, father = list(range(7)), list(range(10, 17))
            ours = double_point_crossover(np.array(mother), np.array(father), begin, end)
            theirs = tools.cxTwoPoint(mother, father)
            assert [child.tolist() for child in ours] == list(theirs)


def offspring(tuner: Ga, sides: list[Side], seed: int) -> tuple[FloatArray, FloatArray]:
    """A first population, as repaired, and the children that it has at equal costs."""
    with closing(tuner.generations(space_of(sides), np.random.default_rng(seed))) as generations:
        first = next(generations)
        return first, generations.send(np.zeros(len(first)))


def test_crossover_keeps_every_gene_at_its_place_and_loses_none() -> None:
    tuner = changed(genes_mutated=0.0, elite=0, ranking_pressure=1.0, crossover_rate=1.0)  # so each is once a parent
    for seed in range(50):
        parents, children = offspring(tuner, [*REALS], seed)
        assert (np.sort(children, axis=0) == np.sort(parents, axis=0)).all()
        assert not any((child == parents).all(axis=1).any() for child in children)


def test_a_child_has_a_piece_of_its_second_parent_between_two_cuts_anywhere_behind_the_first_gene() -> None:
    tuner = changed(genes_mutated=0.0, elite=0, ranking_pressure=1.0, crossover_rate=1.0, n=2)
    cuts = np.zeros((7, 7))
    sides: list[Side] = [Dimension(f"x{i}", 0.0, 1.0, "linear") for i in range(6)]
    for seed in range(3000):
        parents, children = offspring(tuner, sides, seed)
        mother = next(parent for parent in parents if parent[0] == children[0, 0])
        foreign = np.flatnonzero(children[0] != mother)
        begin, end = foreign[0], foreign[-1] + 1
        assert len(foreign) == end - begin
        cuts[begin, end] += 1
    places = cuts[np.triu_indices(7, 1)].reshape(-1)
    assert (cuts[0] == 0.0).all()
    assert np.count_nonzero(places) == 15  # pairs of different cuts among the six places from 1 to 6
    assert chisquare(places[places > 0.0]).pvalue > 0.01


def test_mates_cross_over_as_often_as_the_rate_says_and_an_odd_one_never_does() -> None:
    tuner = changed(genes_mutated=0.0, elite=1, ranking_pressure=1.0, crossover_rate=0.7, n=10)  # four couples
    crossed = []
    for seed in range(500):
        parents, children = offspring(tuner, MIXED, seed)
        same = np.array([(child == parents).all(axis=1).any() for child in children])
        assert same[-1]
        crossed.append(9 - np.count_nonzero(same))
    assert np.mean(crossed) / 8.0 == pytest.approx(0.7 * (1.0 - 1.0 / 90.0), abs=0.03)  # now and then both are copies


def test_a_single_gene_cannot_cross_over() -> None:
    parents, children = offspring(changed(genes_mutated=0.0), [REALS[0]], 0)
    assert np.isin(children, parents).all()


# ---- mutation


def test_genes_mutate_as_often_as_the_rate_says_and_step_evenly_or_by_whole_levels() -> None:
    rng, levels = np.random.default_rng(4), np.array([0, 0, 9, 9])
    x = np.tile([0.5, 0.4, 4.5 / 9, 4.5 / 9], (20000, 1))
    steps = mutated(x, levels, 0.1, 0.2, 3, rng) - x
    moved = steps != 0.0
    assert moved.mean(axis=0) == pytest.approx(0.1, abs=0.008)
    assert (
        chisquare(
            np.bincount(moved.sum(axis=1), minlength=5)[:4], 20000 * binomial(4, 0.1)[:4], ddof=0, sum_check=False
        ).pvalue
        > 0.01
    )
    real = steps[:, :2][moved[:, :2]]
    assert kstest(real, "uniform", (-0.2, 0.4)).pvalue > 0.01
    jumps = 9.0 * steps[:, 2:][moved[:, 2:]]
    assert jumps == pytest.approx(jumps.round())
    sizes, counts = np.unique(jumps.round(), return_counts=True)
    assert sizes.tolist() == [-3, -2, -1, 1, 2, 3]
    assert chisquare(counts).pvalue > 0.01


def binomial(n: int, p: float) -> FloatArray:
    from scipy.stats import binom

    return np.asarray(binom.pmf(np.arange(n + 1), n, p))


def test_a_mutation_stops_at_the_end_of_the_range() -> None:
    levels = np.array([0, 5])
    for edge in ([0.0, 0.1], [1.0, 0.9]):
        moved = mutated(np.tile(edge, (500, 1)), levels, 1.0, 1.0, 4, np.random.default_rng(5))
        assert (moved[:, 0].min(), moved[:, 0].max()) == pytest.approx((0.0, 1.0), abs=0.02)
        assert set((5.0 * moved[:, 1] - 0.5).round(9)) == {0.0, 1.0, 2.0, 3.0, 4.0}


# ---- the search


def test_the_first_population_is_the_start_to_the_bit_and_mutants_of_it() -> None:
    values = np.random.default_rng(6).uniform(-5.12, 5.12, 15).tolist()
    sides: list[Side] = [Dimension(f"x{i}", -5.12, 5.12, "linear", value) for i, value in enumerate(values)]
    sides += [Choice(f"rule{i}", TERMS, i % 5) for i in range(15)]
    tuned = tune(GA, sides, 30, np.random.default_rng(0), lambda x, first: np.zeros(len(x)))
    start = [*values, *(float(i % 5) for i in range(15))]
    assert tuned.values[0].tolist() == start
    moved = tuned.values != start
    assert 1.0 < moved[1:].sum(axis=1).mean() < 5.0
    assert np.abs(tuned.values - start)[:, :15].max() <= 0.2 * 10.24 + 1e-9
    assert np.abs(tuned.values - start)[:, 15:].max() == 2.0


def test_without_a_start_the_first_population_is_anywhere() -> None:
    with closing(GA.generations(space_of(REALS), np.random.default_rng(0))) as generations:
        assert kstest(next(generations).reshape(-1), "uniform").pvalue > 0.01
    half: list[Side] = [Dimension("a", 0.0, 1.0, "linear", 0.5), Dimension("b", 0.0, 1.0, "linear")]
    assert space_of(half).start is None


@pytest.mark.parametrize("elite", [0, 1, 3])
def test_the_elite_live_on_and_keep_their_costs_and_are_not_evaluated_again(elite: int) -> None:
    tuner, kept = changed(elite=elite, genes_mutated=0.0, crossover_rate=0.0, n=10), []
    for seed in range(20):
        with closing(tuner.generations(space_of(MIXED), np.random.default_rng(seed))) as generations:
            best = next(generations)[4]
            children = generations.send(np.where(np.arange(10) == 4, 1.0, 50.0))
            costs = np.random.default_rng(seed).uniform(100.0, 200.0, (40, 10 - elite))
            for answer in costs:  # its copies are told to be as bad as any: only what is remembered of it counts
                children = generations.send(answer)
            kept.append((children == best).all(axis=1).any())
    assert all(kept) == (elite > 0)


def ordered(values: Mapping[str, float]) -> dict[str, float]:
    """Sort the numbers, as peaks of memberships are, and keep them a little apart."""
    names = [name for name in values if name.startswith("x")]
    peaks = np.sort([values[name] for name in names])
    peaks = np.minimum(peaks, 5.12 - 1e-3 * np.arange(len(peaks))[::-1])
    for i in range(1, len(peaks)):
        peaks[i] = min(max(peaks[i], peaks[i - 1] + 1e-3), 5.12)
    return {**values, **dict(zip(names, peaks.tolist(), strict=True))}


@pytest.mark.parametrize("tuner", [GA, PSO, Random(n=10)])
def test_only_mended_points_are_evaluated_whatever_the_tuner(tuner: Tuner) -> None:
    tuned = tune(tuner, MIXED, 300, np.random.default_rng(8), lambda x, first: -x.sum(axis=1), ordered)
    assert (np.diff(tuned.values[:, :15]) > 0.0).all()
    assert set(np.unique(tuned.values[:, 15:])) == {0.0, 1.0, 2.0, 3.0, 4.0}


def test_a_mended_chromosome_is_what_lives_on() -> None:
    with closing(GA.generations(space_of(MIXED, ordered), np.random.default_rng(9))) as generations:
        points = next(generations)
        for _ in range(20):  # what it yields is mended already, and children come of that
            assert (np.diff(points[:, :15]) > 0.0).all()
            points = generations.send(points.sum(axis=1))


def test_parents_are_shuffled_or_copies_of_one_would_be_mates() -> None:
    tuner = changed(genes_mutated=0.0, crossover_rate=0.0)
    with closing(tuner.generations(space_of(MIXED), np.random.default_rng(10))) as generations:
        first = next(generations)
        children = generations.send(np.arange(30.0))
        parents = [int((first == child).all(axis=1).argmax()) for child in children]
        assert sorted(parents) != parents
        assert parents.count(0) in (1, 2)


def test_a_sound_point_is_not_moved_by_a_bit() -> None:
    rng = np.random.default_rng(10)
    for repair in (None, lambda values: dict(values)):
        space = space_of(MIXED, repair)
        places = rng.random((200, 30))
        assert (space.repair(places)[:, :15] == places[:, :15]).all()
        assert (space.repair(space.repair(places)) == space.repair(places)).all()


@pytest.mark.parametrize(
    ("repair", "message"),
    [
        (lambda values: {**values, "x3": 9.0}, r"repair: x3=9\.0: must be between -5\.12 and 5\.12"),
        (lambda values: {**values, "x3": float("nan")}, "repair: x3=nan: must be between"),
        (lambda values: {**values, "rule2": 5.0}, r"repair: rule2=5\.0: must be a whole number from 0 to 4"),
        (lambda values: {**values, "rule2": 1.5}, r"repair: rule2=1\.5: must be a whole number from 0 to 4"),
        (lambda values: {"x3": 1.0}, "repair: must return a value for each of the 30 names"),
        (lambda values: {**values, "x99": 1.0}, "repair: must return a value for each of the 30 names"),
        (lambda values: {**values, "x3": "NB"}, "repair: could not convert"),
        (lambda values: values["kp"], "repair: KeyError: 'kp'"),
        (lambda values: None, "repair: AttributeError"),
    ],
)
def test_a_repair_that_is_none_is_refused(repair: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        tune(GA, MIXED, 30, np.random.default_rng(0), lambda x, first: np.zeros(len(x)), repair)


def sphere(x: FloatArray) -> FloatArray:
    return np.asarray(((x - 0.7) ** 2).sum(axis=1))


def rastrigin(x: FloatArray) -> FloatArray:
    return np.asarray(((x - 0.7) ** 2 - 10.0 * np.cos(2.0 * np.pi * (x - 0.7)) + 10.0).sum(axis=1))


def wrong_rules(x: FloatArray) -> FloatArray:
    """How many steps the rules are from those wanted: OneMax for five terms."""
    return np.asarray(np.abs(x - np.arange(x.shape[1]) % 5).sum(axis=1))


def both(x: FloatArray) -> FloatArray:
    return sphere(x[:, :15]) + wrong_rules(x[:, 15:])


@pytest.mark.parametrize(
    ("sides", "costs", "share"),
    [(REALS, sphere, 0.3), (REALS, rastrigin, 0.5), (RULES, wrong_rules, 0.5), (MIXED, both, 0.3)],
)
def test_it_beats_random_points_at_an_equal_budget(sides: list[Side], costs: Any, share: float) -> None:
    found, floor = (
        np.median(
            [tune(tuner, sides, 900, np.random.default_rng(i), lambda x, _: costs(x)).costs.min() for i in range(7)]
        )
        for tuner in (GA, Random(n=30))
    )
    assert found < share * floor


def test_it_finds_as_much_as_a_loop_of_deap_s_operators(monkeypatch: pytest.MonkeyPatch) -> None:
    tools = pytest.importorskip("deap.tools")
    import random

    def theirs(seed: int) -> float:
        """The same algorithm, with selection and crossover from DEAP, and its mutation written out."""
        chance, rng = random.Random(seed), np.random.default_rng([9, seed])
        for name in ("uniform", "randint"):
            monkeypatch.setattr(f"random.{name}", getattr(chance, name))
        x = rng.uniform(-5.12, 5.12, (30, 30))
        costs = rastrigin(x)
        for _ in range(30):
            ranks = costs.argsort().argsort()
            wheel = [
                SimpleNamespace(genes=one, fitness=Fitness(29.0 - k)) for one, k in zip(x, ranks.tolist(), strict=True)
            ]
            children = [one.genes.tolist() for one in tools.selStochasticUniversalSampling(wheel, 29)]
            chance.shuffle(children)
            for i in range(0, 28, 2):
                if chance.random() < GA.crossover_rate:
                    tools.cxTwoPoint(children[i], children[i + 1])
            made = np.array(children)
            steps = np.where(rng.random(made.shape) < 0.1, rng.uniform(-2.048, 2.048, made.shape), 0.0)
            made = (made + steps).clip(-5.12, 5.12)
            best = int(costs.argmin())
            x, costs = np.vstack([x[best], made]), np.append(costs[best], rastrigin(made))
        return float(costs.min())

    ours = [tune(GA, REALS, 900, np.random.default_rng(i), lambda x, _: rastrigin(x)).costs.min() for i in range(40)]
    other = [theirs(i) for i in range(40)]
    assert np.median(ours) == pytest.approx(np.median(other), rel=0.1)


@pytest.mark.parametrize(
    ("key", "bad", "allowed"),
    [
        ("n", 1, "a whole number of at least 2"),
        ("elite", -1, "a whole number of at least 0"),
        ("elite", 30, "less than n=30"),
        ("ranking_pressure", 2.1, "a finite number from 1 to 2"),
        ("ranking_pressure", 0.9, "a finite number from 1 to 2"),
        ("crossover_rate", 1.1, "a finite number from 0 to 1"),
        ("genes_mutated", -0.1, "a finite number of at least 0"),
        ("step", 1.1, "a finite number from 0 to 1"),
        ("level_step", 0, "a whole number of at least 1"),
        ("level_step", 1.0, "a whole number of at least 1"),
        ("level_step", 10**21, "at most 1000"),
    ],
)
def test_a_wrong_parameter_is_refused_by_key_value_and_what_is_allowed(key: str, bad: Any, allowed: str) -> None:
    with pytest.raises(ValueError, match=rf"Ga\.{key}={bad}: must be {allowed}"):
        changed(**{key: bad})


# ---- choices


def test_each_choice_has_an_equal_share_of_the_unit() -> None:
    side = Choice("rule", TERMS)
    assert [side.value_at(unit) for unit in (0.0, 0.199, 0.2, 0.5, 0.799, 0.8, 1.0)] == [0, 0, 1, 2, 3, 4, 4]
    assert [side.parameter(side.value_at(side.unit_at(k))) for k in range(5)] == list(TERMS)
    assert [side.unit_at(k) for k in range(5)] == pytest.approx([0.1, 0.3, 0.5, 0.7, 0.9])


def test_whole_numbers_may_be_chosen_too() -> None:
    side = Choice("neighbours", (1, 2, 4, 8), 2)
    assert [side.parameter(side.value_at(unit)) for unit in (0.0, 0.3, 0.6, 1.0)] == [1, 2, 4, 8]


@pytest.mark.parametrize("bad", [(), ("NB",), ("NB", "NB"), ("NB", 1), (1.0, 2.0), (True, False), "NB", None])
def test_choices_that_are_none_are_refused(bad: Any) -> None:
    with pytest.raises(ValueError, match=r"rule\.choices=.*: must be two or more different names, or whole numbers"):
        Choice("rule", bad)


def test_a_start_outside_the_bounds_is_refused() -> None:
    with pytest.raises(ValueError, match=r"kp=7\.0: must be between 0\.0 and 5\.0"):
        Dimension("kp", 0.0, 5.0, "linear", 7.0)
    with pytest.raises(ValueError, match="rule=5: must be a whole number from 0 to 4"):
        Choice("rule", TERMS, 5)


def test_the_place_of_the_start_leads_back_to_it_to_the_bit() -> None:
    rng = np.random.default_rng(11)
    for value in rng.uniform(-180.0, 180.0, 500).tolist():
        side = Dimension("phi", -180.0, 180.0, "linear", value)
        assert side.value_at(side.unit_at(value)) == value
    for value in rng.uniform(0.01, 6.0, 500).tolist():
        side = Dimension("r", 1e-3, 6.0, "log", value)
        assert side.value_at(side.unit_at(value)) == value
