import gc
import importlib
import math
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml
from scipy.optimize import differential_evolution
from scipy.stats import chisquare

from navbench.contract import FloatArray
from navbench.tuning.bridge import STRATEGIES, De, points_of
from navbench.tuning.search import Tuned, Tuner, batches, tune
from navbench.tuning.space import Dimension, Space, space_of
from navbench.tuning.swarms import (
    Abc,
    Fa,
    Generations,
    Pso,
    Random,
    attractiveness,
    choice_probabilities,
    firefly_distance,
    firefly_move,
    fitness,
    neighbour,
    particle_velocity,
    random_points,
)

FILES = sorted((Path(__file__).parents[2] / "conf" / "tuner").glob("*.yaml"))
NAMES = [path.stem for path in FILES]
PSO = Pso(n=10, w=0.7, c1=1.5, c2=1.5)
FA = Fa(n=6, beta0=0.9, gamma=1.3, alpha=0.2, damping=0.97)


class Problem(NamedTuple):
    """A test function in three dimensions, whose minimum is 0."""

    costs: Callable[[FloatArray], FloatArray]
    low: float
    high: float

    @property
    def sides(self) -> list[Dimension]:
        return [Dimension(name, self.low, self.high, "linear") for name in ("kp", "ki", "kd")]


def sphere_costs(x: FloatArray) -> FloatArray:
    return np.asarray(((x - 0.7) ** 2).sum(axis=1))


def rosenbrock_costs(x: FloatArray) -> FloatArray:
    return np.asarray((100.0 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1.0 - x[:, :-1]) ** 2).sum(axis=1))


def rastrigin_costs(x: FloatArray) -> FloatArray:
    return np.asarray(((x - 0.7) ** 2 - 10.0 * np.cos(2.0 * np.pi * (x - 0.7)) + 10.0).sum(axis=1))


PROBLEMS = {
    "sphere": Problem(sphere_costs, -5.12, 5.12),
    "rosenbrock": Problem(rosenbrock_costs, -2.0, 2.0),
    "rastrigin": Problem(rastrigin_costs, -5.12, 5.12),
}
SPHERE = PROBLEMS["sphere"]


def build(path: Path) -> Tuner:
    """One tuner of conf/, made as the framework makes it."""
    parameters = yaml.safe_load(path.read_text())["build"]
    module, name = parameters.pop("_target_").rsplit(".", 1)
    tuner: Tuner = getattr(importlib.import_module(module), name)(**parameters)
    return tuner


TUNERS = {path.stem: build(path) for path in FILES}


def cube(size: int) -> Space:
    """A cube of real numbers, without a start."""
    return space_of([Dimension(f"x{i}", 0.0, 1.0, "linear") for i in range(size)])


def search(tuner: Tuner, problem: Problem, budget: int, seed: int) -> Tuned:
    return tune(tuner, problem.sides, budget, np.random.default_rng(seed), lambda x, first: problem.costs(x))


def medians_of_both(
    ours: Tuner, theirs: Callable[[int], float], problem: Problem, budget: int, seeds: int
) -> tuple[float, float]:
    mine = [search(ours, problem, budget, seed).costs.min() for seed in range(seeds)]
    return float(np.median(mine)), float(np.median([theirs(seed) for seed in range(seeds)]))


# ---- dimensions


def test_the_unit_s_ends_are_exactly_the_bounds() -> None:
    rng = np.random.default_rng(0)
    for low, width in rng.uniform(0.001, 1000.0, (200, 2)).tolist():
        for scale in ("linear", "log"):
            side = Dimension("kp", low, low + width, scale)
            assert (side.value_at(0.0), side.value_at(1.0)) == (low, low + width)
            assert low <= side.value_at(math.nextafter(1.0, 0.0)) <= low + width


def test_the_middle_is_the_arithmetic_mean_or_on_a_log_scale_the_geometric_one() -> None:
    assert Dimension("kp", -2.0, 10.0, "linear").value_at(0.5) == 4.0
    assert Dimension("kp", 0.01, 100.0, "log").value_at(0.5) == pytest.approx(1.0)


def test_equal_steps_on_a_log_scale_multiply_by_equal_factors() -> None:
    side = Dimension("ki", 1e-4, 1e2, "log")
    values = [side.value_at(k / 6) for k in range(7)]
    assert values == pytest.approx([1e-4, 1e-3, 1e-2, 1e-1, 1.0, 1e1, 1e2])


@pytest.mark.parametrize("side", [Dimension("a", -3.0, 7.0, "linear"), Dimension("b", 1e-3, 50.0, "log")])
def test_a_value_leads_back_to_its_unit(side: Dimension) -> None:
    for unit in np.random.default_rng(1).random(200).tolist():
        assert side.unit_at(side.value_at(unit)) == pytest.approx(unit, abs=1e-12)
    assert (side.unit_at(side.low), side.unit_at(side.high)) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (("", 0.0, 1.0, "linear"), "name=''"),
        (("kp", 1.0, 1.0, "linear"), r"kp\.high=1\.0: must be greater than low=1\.0"),
        (("kp", 2.0, 1.0, "log"), r"kp\.high=1\.0: must be greater than low=2\.0"),
        (("kp", 0.0, 1.0, "log"), r"kp\.low=0\.0: must be greater than 0 on a log scale"),
        (("kp", 0.0, math.inf, "linear"), r"kp\.high=inf: must be a finite number"),
        (("kp", math.nan, 1.0, "linear"), r"kp\.low=nan: must be a finite number"),
        (("kp", "0", 1.0, "linear"), r"kp\.low='0': must be a finite number"),
        (("kp", False, 1.0, "linear"), r"kp\.low=False: must be a finite number"),
        (("kp", -1.7e308, 1.7e308, "linear"), r"kp\.high=1\.7e\+308: must be a finite distance"),
        (("kp", 0.0, 1.0, "cubic"), r"kp\.scale='cubic': must be one of linear, log"),
    ],
)
def test_a_wrong_dimension_is_refused_by_name_value_and_what_is_allowed(values: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Dimension(*values)


@pytest.mark.parametrize("unit", [-1e-9, 1.0 + 1e-9, math.nan])
def test_a_place_outside_the_cube_is_refused(unit: float) -> None:
    with pytest.raises(ValueError, match="must be between 0 and 1"):
        Dimension("kp", 0.0, 2.0, "linear").value_at(unit)


@pytest.mark.parametrize("value", [-0.1, 2.1, math.nan])
def test_a_value_outside_the_bounds_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match=r"kp=.*: must be between 0\.0 and 2\.0"):
        Dimension("kp", 0.0, 2.0, "linear").unit_at(value)


# ---- the search


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("extra", [0, 1, 7, 10, 53])
def test_a_budget_is_used_exactly_and_the_indices_run_through(name: str, extra: int) -> None:
    budget, seen = TUNERS[name].population + extra, []

    def evaluate(values: FloatArray, first_index: int) -> FloatArray:
        seen.append((first_index, values.copy()))
        return SPHERE.costs(values)

    tuned = tune(TUNERS[name], SPHERE.sides, budget, np.random.default_rng(3), evaluate)
    assert [first for first, _ in seen] == np.cumsum([0, *(len(values) for _, values in seen[:-1])]).tolist()
    assert np.vstack([values for _, values in seen]).tobytes() == tuned.values.tobytes()
    assert tuned.values.shape == (budget, 3)
    assert tuned.costs.tobytes() == SPHERE.costs(tuned.values).tobytes()
    assert tuned.costs[tuned.best_index] == tuned.costs.min()


@pytest.mark.parametrize("name", NAMES)
def test_a_smaller_budget_sees_the_beginning_of_a_greater_one(name: str) -> None:
    small, great = search(TUNERS[name], SPHERE, 43, 5), search(TUNERS[name], SPHERE, 120, 5)
    assert great.values[:43].tobytes() == small.values.tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_a_budget_below_the_first_generation_is_refused(name: str) -> None:
    least = TUNERS[name].population
    with pytest.raises(ValueError, match=f"budget={least - 1}: must be at least {least}"):
        search(TUNERS[name], SPHERE, least - 1, 0)


def test_a_budget_that_is_no_whole_number_is_refused() -> None:
    with pytest.raises(ValueError, match=r"budget=20\.0: must be a whole number"):
        search(PSO, SPHERE, 20.0, 0)  # type: ignore[arg-type]


def test_dimensions_are_needed_and_each_name_stands_once() -> None:
    side = Dimension("kp", 0.0, 1.0, "linear")
    for sides, message in ([], "at least one"), ([side, side], "each name may stand once"):
        with pytest.raises(ValueError, match=message):
            tune(PSO, sides, 20, np.random.default_rng(0), lambda x, first: np.zeros(len(x)))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_cost_that_is_not_finite_is_refused_by_its_index(name: str, bad: float) -> None:
    def evaluate(values: FloatArray, first_index: int) -> FloatArray:
        return np.where(np.arange(first_index, first_index + len(values)) == 13, bad, 1.0)

    with pytest.raises(ValueError, match=f"cost of evaluation 13={bad}: must be finite"):
        tune(TUNERS[name], SPHERE.sides, 60, np.random.default_rng(0), evaluate)


def test_costs_of_the_wrong_number_are_refused() -> None:
    with pytest.raises(ValueError, match=r"costs of shape \(1,\): must be \(10,\)"):
        tune(PSO, SPHERE.sides, 60, np.random.default_rng(0), lambda x, first: np.zeros(1))


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_gives_the_same_bytes_and_another_one_others(name: str) -> None:
    first, again, other = (search(TUNERS[name], SPHERE, 90, seed).values.tobytes() for seed in (4, 4, 5))
    assert first == again
    assert first != other


def noisy(index: int, place: FloatArray) -> float:
    """A cost whose chance comes from the evaluation's own index."""
    return float(((place - 0.7) ** 2).sum() + np.random.default_rng([9, index]).normal())


@pytest.mark.parametrize("name", NAMES)
def test_one_worker_and_two_give_the_same_bytes(name: str) -> None:
    def alone(values: FloatArray, first_index: int) -> FloatArray:
        return np.array([noisy(first_index + k, place) for k, place in enumerate(values)])

    one = tune(TUNERS[name], SPHERE.sides, 83, np.random.default_rng(8), alone)
    rng = np.random.default_rng(8)
    with closing(batches(TUNERS[name], SPHERE.sides, 83, rng)) as asked, ThreadPoolExecutor(2) as workers:
        batch = next(asked)
        while True:
            indices = range(batch.first_index, batch.first_index + len(batch.values))
            jobs = [workers.submit(noisy, index, place) for index, place in zip(indices, batch.values, strict=True)]
            try:
                batch = asked.send(np.array([job.result() for job in reversed(jobs)][::-1]))
            except StopIteration as end:
                two: Tuned = end.value
                break
    assert one.values.tobytes() == two.values.tobytes()
    assert one.costs.tobytes() == two.costs.tobytes()
    assert one.best_index == two.best_index


def test_who_evaluates_can_change_neither_the_record_nor_the_tuner() -> None:
    def evaluate(values: FloatArray, first_index: int) -> FloatArray:
        with pytest.raises(ValueError, match="read-only"):
            values[:] = 0.0
        reused[: len(values)] = SPHERE.costs(values)
        return reused[: len(values)]

    reused = np.empty(max(tuner.population for tuner in TUNERS.values()))
    for tuner in TUNERS.values():
        tuned = tune(tuner, SPHERE.sides, 60, np.random.default_rng(2), evaluate)
        assert tuned.values.tobytes() == search(tuner, SPHERE, 60, 2).values.tobytes()


class Careless:
    """A tuner that writes into what it receives."""

    population = 5

    def generations(self, space: Space, rng: np.random.Generator) -> Generations:
        while True:
            costs = yield rng.random((5, space.size))
            costs[:] = -1.0


def test_a_tuner_cannot_change_the_record() -> None:
    assert search(Careless(), SPHERE, 30, 0).costs.min() >= 0.0


def test_the_best_of_equals_is_the_first() -> None:
    tuned = tune(PSO, SPHERE.sides, 30, np.random.default_rng(0), lambda x, first: np.ones(len(x)))
    assert tuned.best_index == 0


# ---- all tuners


@pytest.mark.parametrize("name", NAMES)
def test_every_point_lies_in_the_cube_also_where_the_minimum_is_its_corner(name: str) -> None:
    with closing(TUNERS[name].generations(cube(4), np.random.default_rng(6))) as generations:
        points = next(generations)
        assert points.shape == (TUNERS[name].population, 4)
        for _ in range(60):
            assert points.min() >= 0.0
            assert points.max() <= 1.0
            points = generations.send(-points.sum(axis=1) - 5.0 * points[:, 0])
    if name != "random":
        assert points[:, 0].max() == pytest.approx(1.0, abs=1e-2)


# Generations of 30 and three genes mutated of 122 are of no use to three parameters: see test_ga.py
@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("random", "ga")])
@pytest.mark.parametrize("problem", PROBLEMS)
def test_a_tuner_beats_random_points_at_an_equal_budget(name: str, problem: str) -> None:
    found, floor = (
        [search(TUNERS[tuner], PROBLEMS[problem], 210, seed).costs.min() for seed in range(20)]
        for tuner in (name, "random")
    )
    assert np.median(found) < np.median(floor) * (0.1 if problem == "sphere" else 0.7)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("huge", [1.7e308, -1.7e308])
def test_any_finite_costs_will_do(name: str, huge: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tuned = tune(TUNERS[name], SPHERE.sides, 60, np.random.default_rng(0), lambda x, first: np.full(len(x), huge))
    assert np.isfinite(tuned.values).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_file_of_conf_names_the_source_of_each_parameter(name: str) -> None:
    content = yaml.safe_load((FILES[0].parent / f"{name}.yaml").read_text())
    assert set(content["sources"]) == {f"build.{key}" for key in content["build"] if key != "_target_"}


def parameters_of(tuner: Any) -> dict[str, Any]:
    return {key: getattr(tuner, key) for key in tuner.__slots__}


@pytest.mark.parametrize(
    ("name", "key", "bad", "allowed"),
    [
        ("pso", "n", 0, "a whole number of at least 1"),
        ("pso", "n", 10.0, "a whole number of at least 1"),
        ("pso", "n", True, "a whole number of at least 1"),
        ("pso", "w", 1.1, "a finite number from 0 to 1"),
        ("pso", "w", "0.7", "a finite number from 0 to 1"),
        ("pso", "c1", -0.1, "a finite number of at least 0"),
        ("pso", "c2", math.inf, "a finite number of at least 0"),
        ("abc", "sources", 1, "a whole number of at least 2"),
        ("abc", "limit", 0, "a whole number of at least 1"),
        ("fa", "n", 0, "a whole number of at least 1"),
        ("fa", "beta0", -1.0, "a finite number of at least 0"),
        ("fa", "gamma", math.nan, "a finite number of at least 0"),
        ("fa", "alpha", True, "a finite number of at least 0"),
        ("fa", "damping", 1.01, "a finite number from 0 to 1"),
        ("de", "n", 4, "a whole number of at least 5"),
        ("de", "strategy", "best3bin", "one of best1bin, "),
        ("de", "mutation", [1.0, 0.5], "two numbers, 0 <= least <= greatest < 2"),
        ("de", "mutation", [0.5, 2.0], "two numbers, 0 <= least <= greatest < 2"),
        ("de", "mutation", 0.5, "two numbers, 0 <= least <= greatest < 2"),
        ("de", "mutation", "ab", "two numbers, 0 <= least <= greatest < 2"),
        ("de", "recombination", 1.5, "a finite number from 0 to 1"),
        ("random", "n", 0, "a whole number of at least 1"),
    ],
)
def test_a_wrong_parameter_is_refused_by_key_value_and_what_is_allowed(
    name: str, key: str, bad: Any, allowed: str
) -> None:
    kind: Any = type(TUNERS[name])
    with pytest.raises(ValueError, match=rf"{kind.__name__}\.{key}=") as caught:
        kind(**{**parameters_of(TUNERS[name]), key: bad})
    assert str(caught.value).startswith(f"{kind.__name__}.{key}={bad!r}: must be {allowed}")


def test_random_points_do_not_depend_on_the_size_of_a_generation() -> None:
    assert search(Random(n=3), SPHERE, 40, 1).values.tobytes() == search(Random(n=17), SPHERE, 40, 1).values.tobytes()


# ---- bees


def test_first_points_are_uniform_in_the_cube() -> None:  # eq. (26)
    points = random_points(4000, 2, np.random.default_rng(0))
    cells = (4.0 * points).astype(int)
    assert chisquare(np.bincount(4 * cells[:, 0] + cells[:, 1], minlength=16)).pvalue > 0.01


def test_a_neighbour_lies_towards_or_away_from_another_source() -> None:  # eq. (27)
    here, there = np.array([0.5, 0.5, 0.5]), np.array([0.2, 0.2, 0.2])
    assert neighbour(here, there, np.array([0.5, -1.0, 0.0])) == pytest.approx([0.65, 0.2, 0.5])


def test_fitness_falls_with_the_cost_on_both_sides_of_zero() -> None:  # eq. (29)
    assert [fitness(f) for f in (-3.0, -0.5, 0.0, 1.0, 3.0)] == [4.0, 1.5, 1.0, 0.5, 0.25]


def test_probabilities_are_the_shares_of_the_fitness() -> None:  # eq. (28)
    assert choice_probabilities(np.array([1.0, 0.5, 0.25, 2.0])) == pytest.approx(np.array([4.0, 2.0, 1.0, 8.0]) / 15.0)


class Hive:
    """Drives a colony and keeps its books from outside: who tried what, and what each source should be."""

    def __init__(self, sources: int, limit: int, seed: int, first_costs: FloatArray | None = None) -> None:
        self.limit = limit
        self.bees = Abc(sources=sources, limit=limit).generations(cube(5), np.random.default_rng(seed))
        self.tried = next(self.bees)
        self.x, self.costs = self.tried.copy(), np.zeros(sources) if first_costs is None else first_costs
        self.failures = [0] * sources
        self.tried = self.bees.send(self.costs.copy())

    def owner(self, candidate: FloatArray) -> int:
        """The only source from which a candidate differs in one coordinate, or in none where that stays at a wall."""
        moved = (self.x != candidate).sum(axis=1)
        owners = np.flatnonzero(moved <= 1)
        assert owners.size == 1, "a candidate must move one coordinate of one source"
        owner = int(owners[0])
        if moved[owner]:
            j = int((self.x[owner] != candidate).argmax())
            offsets = np.abs(self.x[owner, j] - np.delete(self.x[:, j], owner))
            assert abs(candidate[j] - self.x[owner, j]) <= offsets.max(), "a candidate must not go farther than (27)"
        else:
            assert np.isin(candidate, (0.0, 1.0)).any(), "a candidate must move"
        return owner

    def phase(self, costs: FloatArray) -> list[int]:
        """Answer one phase of employed bees or onlookers, and return whose the candidates were."""
        owners = [self.owner(candidate) for candidate in self.tried]
        for i, candidate, cost in zip(owners, self.tried.copy(), costs, strict=True):
            if cost < self.costs[i]:
                self.x[i], self.costs[i], self.failures[i] = candidate, cost, 0
            else:
                self.failures[i] += 1
        self.tried = self.bees.send(costs.copy())
        return owners

    def cycle(self, costs: Callable[[int], FloatArray]) -> tuple[list[int], list[int]]:
        """Run employed bees, onlookers and scouts; return whom the onlookers chose and who became a scout."""
        n = len(self.x)
        assert self.phase(costs(n)) == list(range(n))
        onlookers = self.phase(costs(n))
        scouts = [i for i in range(n) if self.failures[i] >= self.limit]
        if scouts:
            assert len(self.tried) == len(scouts)
            answer = costs(len(scouts))
            for i, place, cost in zip(scouts, self.tried, answer, strict=True):
                self.x[i], self.costs[i], self.failures[i] = place, cost, 0
            self.tried = self.bees.send(answer)
        return onlookers, scouts


def test_bees_select_greedily_and_exhausted_sources_become_scouts_by_the_books() -> None:
    rng, scouts = np.random.default_rng(1), 0
    for seed in range(5):
        hive = Hive(4, 3, seed, rng.normal(size=4))
        for _ in range(200):
            scouts += len(hive.cycle(lambda k: rng.normal(size=k))[1])
    assert scouts > 500


def test_a_candidate_that_is_only_as_good_does_not_take_the_source_s_place() -> None:
    hive = Hive(4, 1000, 2)
    before = hive.x.copy()
    hive.cycle(np.zeros)
    assert [hive.owner(candidate) for candidate in hive.tried] == [0, 1, 2, 3]
    assert (hive.x == before).all()


def test_the_first_of_two_onlookers_at_one_source_stays_if_the_second_is_worse() -> None:
    hive = Hive(2, 1000, 3, np.array([0.0, 1e12]))
    hive.phase(np.array([1.0, 1e13]))
    first = hive.tried[0].copy()
    assert hive.phase(np.array([-2.0, -1.0])) == [0, 0]
    assert (hive.x[0] == first).all()
    assert hive.owner(hive.tried[0]) == 0


def test_scouts_land_anywhere_and_start_afresh() -> None:
    hive, landed = Hive(5, 1, 4), []
    for _ in range(400):
        before = hive.x.copy()
        _, scouts = hive.cycle(np.ones)
        assert scouts == [0, 1, 2, 3, 4]
        assert (hive.x != before).all()
        landed.append(hive.x.copy())
    assert hive.failures == [0] * 5
    assert chisquare(np.histogram(landed, bins=10, range=(0, 1))[0]).pvalue > 0.01


def test_onlookers_choose_by_the_shares_of_the_fitness() -> None:  # eqs. (28), (29)
    hive, chosen = Hive(4, 10**9, 5, np.array([0.0, 1.0, 3.0, -1.0])), np.zeros(4)
    for _ in range(1000):
        onlookers, _ = hive.cycle(lambda k: np.full(k, 9.0))
        chosen += np.bincount(onlookers, minlength=4)
    assert chosen.sum() == 4000
    assert chisquare(chosen, 4000.0 * np.array([4.0, 2.0, 1.0, 8.0]) / 15.0).pvalue > 0.01


def test_bees_use_every_dimension_and_every_other_source_alike_and_step_uniformly() -> None:
    moved, ranks, farthest = np.zeros(5), [], np.zeros(3)
    for seed in range(3000):
        hive = Hive(4, 10**9, seed)
        for i, candidate in enumerate(hive.tried):
            j = int((hive.x[i] != candidate).argmax())
            moved[j] += 1
            here, offsets = hive.x[i, j], np.abs(hive.x[i, j] - np.delete(hive.x[:, j], i))
            if offsets.max() <= min(here, 1.0 - here):  # no wall within reach
                step = candidate[j] - here
                # The share of steps that (27) makes shorter, and its side: uniform if k and rand are.
                ranks.append(math.copysign(np.minimum(abs(step) / offsets, 1.0).mean(), step))
                if abs(step) > np.sort(offsets)[1]:  # then k can only be the farthest one
                    k = int(np.abs(hive.x[:, j] - here).argmax())
                    farthest[(k - i) % 4 - 1] += 1
    assert chisquare(moved).pvalue > 0.01
    assert chisquare(farthest).pvalue > 0.01
    assert len(ranks) > 1000
    assert chisquare(np.histogram(ranks, bins=20, range=(-1, 1))[0]).pvalue > 0.01


@pytest.mark.parametrize("problem", PROBLEMS)
def test_bees_find_as_much_as_those_of_abcopt(problem: str) -> None:
    abcopt = pytest.importorskip("abcopt")
    costs, low, high = PROBLEMS[problem]

    def theirs(seed: int) -> float:
        solver = abcopt.CanonicalABCSolver(
            lambda x: float(costs(x[None])[0]), 3, [low] * 3, [high] * 3, 10, 300, limit=30, random_state=seed
        )
        return float(solver.solve()[1])

    ours, other = medians_of_both(Abc(sources=10, limit=30), theirs, PROBLEMS[problem], 300, 200)
    assert 0.5 < ours / other < 2.0


# ---- fireflies


def test_attraction_fades_with_the_square_of_the_distance() -> None:  # eq. (30)
    assert attractiveness(0.0, 0.8, 3.0) == 0.8
    assert attractiveness(2.0, 0.8, 0.5) == pytest.approx(0.8 * math.exp(-2.0))


def test_distance_is_euclidean() -> None:  # eq. (31)
    assert firefly_distance(np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.2, 0.7])) == pytest.approx(0.5)


def test_a_firefly_moves_a_share_of_the_way_and_a_random_step() -> None:  # eq. (32)
    moved = firefly_move(np.array([0.2, 0.4]), np.array([0.6, 0.0]), 0.5, 0.2, np.array([0.5, 0.0]))
    assert moved == pytest.approx([0.4, 0.1])


def literal_flight(
    x: list[list[float]], costs: list[float], tuner: Fa, alpha: float, rng: np.random.Generator
) -> list[list[float]]:
    """Equations 30 to 32, number by number."""
    moved = [list(place) for place in x]
    for i in range(len(x)):
        lonely = True
        for j in range(len(x)):
            if -costs[j] > -costs[i]:
                lonely = False
                squares = 0.0
                for k in range(len(x[i])):
                    squares += (moved[i][k] - x[j][k]) ** 2
                r = math.sqrt(squares)
                rand = rng.random(len(x[i]))
                for k in range(len(x[i])):
                    towards = tuner.beta0 * math.exp(-tuner.gamma * r**2) * (x[j][k] - moved[i][k])
                    moved[i][k] = moved[i][k] + towards + alpha * (rand[k] - 0.5)
        if lonely:
            rand = rng.random(len(x[i]))
            for k in range(len(x[i])):
                moved[i][k] = moved[i][k] + alpha * (rand[k] - 0.5)
    return [[min(max(value, 0.0), 1.0) for value in place] for place in moved]


def test_fireflies_fly_as_a_literal_loop_has_it_and_ever_more_calmly() -> None:
    ours, theirs = np.random.default_rng(7), np.random.default_rng(7)
    generations, tastes = FA.generations(cube(4), ours), np.random.default_rng(1)
    x, alpha = next(generations), FA.alpha
    assert x.tolist() == theirs.random((FA.n, 4)).tolist()
    for _ in range(40):
        costs = np.round(tastes.normal(size=FA.n), 1)  # some are equal
        expected = literal_flight(x.tolist(), costs.tolist(), FA, alpha, theirs)
        x = generations.send(costs)
        assert x == pytest.approx(np.array(expected), abs=1e-12)
        alpha *= FA.damping


def test_without_absorption_or_chance_the_dimmer_firefly_lands_on_the_brighter_which_stays() -> None:
    generations = Fa(n=2, beta0=1.0, gamma=0.0, alpha=0.0, damping=1.0).generations(cube(3), np.random.default_rng(0))
    before = next(generations).copy()
    after = generations.send(np.array([2.0, 1.0]))
    assert after == pytest.approx(before[[1, 1]], abs=1e-15)


def test_equally_bright_fireflies_do_not_attract_each_other() -> None:
    generations = Fa(n=5, beta0=1.0, gamma=0.0, alpha=0.0, damping=1.0).generations(cube(3), np.random.default_rng(0))
    before = next(generations).copy()
    assert (generations.send(np.ones(5)) == before).all()


# ---- particles


def test_a_particle_keeps_its_pace_and_is_pulled_to_both_best_places() -> None:
    v, x, own, best, pull_own, pull = (np.array([number]) for number in (0.1, 0.5, 0.7, 0.2, 1.0, 0.5))
    v = particle_velocity(v, x, own, best, 0.7, pull_own, pull)
    assert v == pytest.approx([0.07 + 0.2 - 0.15])


def test_particles_swarm_as_a_literal_loop_has_it_also_at_the_walls() -> None:
    ours, theirs, tastes = np.random.default_rng(7), np.random.default_rng(7), np.random.default_rng(1)
    n, walls = 6, 0
    generations = Pso(n=n, w=0.8, c1=1.7, c2=1.3).generations(cube(2), ours)
    x = next(generations)
    place, other = theirs.random((n, 2)), theirs.random((n, 2))
    v = [[0.5 * (other[i, k] - place[i, k]) for k in range(2)] for i in range(n)]
    costs = np.round(tastes.normal(size=n), 1)
    own, own_costs = place.copy(), costs.copy()
    for _ in range(60):
        leader = own[int(np.argmin(own_costs))].copy()
        r1, r2 = theirs.random((n, 2)), theirs.random((n, 2))
        for i in range(n):
            for k in range(2):
                pull = 1.7 * r1[i, k] * (own[i, k] - place[i, k]) + 1.3 * r2[i, k] * (leader[k] - place[i, k])
                v[i][k] = 0.8 * v[i][k] + pull
                place[i, k] += v[i][k]
                if not 0.0 <= place[i, k] <= 1.0:
                    place[i, k], v[i][k], walls = float(place[i, k] > 1.0), 0.0, walls + 1
        x = generations.send(costs)
        assert x == pytest.approx(place, abs=1e-12)
        costs = np.round(tastes.normal(size=n), 1)
        for i in range(n):
            if costs[i] < own_costs[i]:
                own[i], own_costs[i] = place[i], costs[i]
    assert walls > 20


@pytest.fixture
def pyswarms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Pyswarms, kept from writing a log file and from changing the process's logging and random state."""
    quiet = tmp_path / "logging.yaml"
    quiet.write_text("{version: 1, incremental: true}")
    monkeypatch.setenv("LOG_CFG", str(quiet))
    monkeypatch.chdir(tmp_path)
    state = np.random.get_state()  # noqa: NPY002
    yield pytest.importorskip("pyswarms")
    np.random.set_state(state)  # noqa: NPY002
    assert [path.name for path in tmp_path.iterdir()] == ["logging.yaml"]


def test_particles_take_the_very_steps_of_those_of_pyswarms(pyswarms: Any) -> None:
    def costs(x: FloatArray) -> FloatArray:
        return np.asarray((np.array([1.0, 3.0, 9.0]) * (x - 0.55) ** 2).sum(axis=1))

    bits = np.random.MT19937(413)
    seen = []
    with closing(PSO.generations(cube(3), np.random.Generator(bits))) as generations:
        seen.append(next(generations))
        for _ in range(30):
            seen.append(generations.send(costs(seen[-1])))
    assert np.min(seen) > 0.0
    assert np.max(seen) < 1.0, "this seed was chosen so that no wall is met"

    bits = np.random.MT19937(413)
    rng = np.random.Generator(bits)
    first, other = rng.random((10, 3)), rng.random((10, 3))
    options = {"w": PSO.w, "c1": PSO.c1, "c2": PSO.c2}
    swarm = pyswarms.single.GlobalBestPSO(10, 3, options, bounds=(np.zeros(3), np.ones(3)), init_pos=first)
    swarm.swarm.velocity = 0.5 * (other - first)
    key, position = bits.state["state"]["key"], bits.state["state"]["pos"]
    np.random.set_state(("MT19937", key, position, 0, 0.0))  # noqa: NPY002
    swarm.optimize(costs, 31, verbose=False)
    assert np.array(seen) == pytest.approx(np.array(swarm.pos_history), abs=1e-12)


@pytest.mark.parametrize("problem", PROBLEMS)
def test_particles_find_as_much_as_those_of_pyswarms(problem: str, pyswarms: Any) -> None:
    costs, low, high = PROBLEMS[problem]
    options = {"w": PSO.w, "c1": PSO.c1, "c2": PSO.c2}

    def theirs(seed: int) -> float:
        np.random.seed(seed)  # noqa: NPY002
        bounds = (np.full(3, low), np.full(3, high))
        swarm = pyswarms.single.GlobalBestPSO(10, 3, options, bounds=bounds, bh_strategy="nearest")
        return float(swarm.optimize(costs, 30, verbose=False)[0])

    ours, other = medians_of_both(PSO, theirs, PROBLEMS[problem], 300, 200)
    assert 0.5 < ours / other < 2.0


# ---- differential evolution


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_differential_evolution_is_scipy_s_own(strategy: str) -> None:
    ours, theirs, seen = np.random.default_rng(3), np.random.default_rng(3), []

    def costs(x: FloatArray) -> FloatArray:
        return rastrigin_costs(10.0 * x - 5.0)

    def recorded(x: FloatArray) -> FloatArray:
        seen.append(x.T.copy())
        return costs(x.T)

    tuner = De(n=8, strategy=strategy, mutation=(0.4, 0.9), recombination=0.6)
    sides = [Dimension(name, 0.0, 1.0, "linear") for name in "abc"]
    tuned = tune(tuner, sides, 8 * 21, ours, lambda x, first: costs(x))
    answer = differential_evolution(
        recorded,
        [(0.0, 1.0)] * 3,
        strategy=strategy,
        mutation=(0.4, 0.9),
        recombination=0.6,
        init=theirs.random((8, 3)),
        rng=theirs,
        maxiter=20,
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    assert tuned.values.tobytes() == np.vstack(seen).tobytes()
    assert tuned.costs[tuned.best_index] == answer.fun
    assert tuned.values[tuned.best_index].tolist() == answer.x.tolist()


def test_differential_evolution_goes_on_where_all_costs_are_equal() -> None:
    tuned = tune(TUNERS["de"], SPHERE.sides, 2000, np.random.default_rng(0), lambda x, first: np.zeros(len(x)))
    assert len(np.unique(tuned.values, axis=0)) > 1900


# ---- the bridge


def minimisers() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "navbench-minimiser"]


def started() -> Any:
    assert not minimisers()
    generations = TUNERS["de"].generations(cube(3), np.random.default_rng(0))
    generations.send(SPHERE.costs(next(generations)))
    assert len(minimisers()) == 1
    return generations


def test_a_generator_that_is_closed_leaves_no_thread() -> None:
    started().close()
    assert not minimisers()


def test_a_generator_that_is_dropped_leaves_no_thread() -> None:
    generations = started()
    del generations
    assert not minimisers()


def test_a_generator_that_is_dropped_within_a_cycle_leaves_no_thread() -> None:
    cycle: list[Any] = [started()]
    cycle.append(cycle)
    del cycle
    gc.collect()
    assert not minimisers()


def test_a_generator_that_was_never_asked_starts_no_thread() -> None:
    TUNERS["de"].generations(cube(3), np.random.default_rng(0)).close()
    assert not minimisers()


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt])
def test_an_error_of_an_evaluation_comes_through_and_leaves_no_thread(error: type[BaseException]) -> None:
    def evaluate(values: FloatArray, first_index: int) -> FloatArray:
        if first_index:
            raise error
        return SPHERE.costs(values)

    with pytest.raises(error):
        tune(TUNERS["de"], SPHERE.sides, 60, np.random.default_rng(0), evaluate)
    assert not minimisers()


def test_an_error_of_the_minimiser_is_raised_where_it_is_asked() -> None:
    def minimise(objective: Callable[[FloatArray], FloatArray]) -> None:
        objective(np.zeros((1, 1)))
        raise ZeroDivisionError("inside")

    points = points_of(minimise)
    next(points)
    with pytest.raises(ZeroDivisionError, match="inside"):
        points.send(np.zeros(1))
    assert not minimisers()


def test_a_minimiser_that_returns_ends_its_generator() -> None:
    points = points_of(lambda objective: objective(np.zeros((1, 1))))
    next(points)
    with pytest.raises(StopIteration):
        points.send(np.zeros(1))
    assert not minimisers()


def run(script: str) -> subprocess.CompletedProcess[str]:
    before = """
import signal, threading, time
import numpy as np
from navbench.tuning.bridge import De, points_of
from navbench.tuning.space import Dimension, space_of
cube = space_of([Dimension(name, 0.0, 1.0, "linear") for name in "ab"])
"""
    return subprocess.run([sys.executable, "-c", before + script], capture_output=True, text=True, timeout=120)


def test_a_generator_that_is_still_alive_does_not_hold_the_program_up() -> None:
    done = run("""
tuner = De(n=5, strategy="rand1bin", mutation=(0.5, 0.5), recombination=0.5)
generations = tuner.generations(cube, np.random.default_rng(0))
generations.send(np.zeros(len(next(generations))))
class Holder: pass
holder = Holder()
holder.itself, holder.generations = holder, generations
alive = tuner.generations(cube, np.random.default_rng(0))
next(alive)
""")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_minimiser_that_survives_every_exception_ends_with_its_generator() -> None:
    done = run("""
def minimise(objective):
    while True:
        try:
            objective(np.zeros((1, 1)))
        except Exception:
            pass
points = points_of(minimise)
points.send(np.zeros(len(next(points))))
points.close()
print(threading.active_count())
""")
    assert (done.stdout.split(), done.stderr) == (["1"], "")


def test_an_interrupt_during_the_minimiser_s_own_work_is_not_swallowed() -> None:
    done = run("""
def minimise(objective):
    objective(np.zeros((1, 1)))
    signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
    time.sleep(0.2)
    objective(np.zeros((1, 1)))
points = points_of(minimise)
next(points)
try:
    points.send(np.zeros(1))
except KeyboardInterrupt:
    print("interrupted", threading.active_count())
""")
    assert (done.stdout.split(), done.stderr) == (["interrupted", "1"], "")
