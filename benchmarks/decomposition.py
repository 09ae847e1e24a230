"""What decomposing a rule base saves in time: the controllers of nemeiksis2019 and lei2014 beside one flat rule base.

All sides are ``navbench.fuzzy.inference`` over the same random inputs, and are timed in turn; the median of the
ratios is printed. A flat rule base has a rule for each combination of its inputs' sets, whose conclusions are dealt out
in turn: the time hangs on how many rules there are and not on what they say.

- nemeiksis2019: the blocks 1FB and 4FB, which the obstacle agent takes and no agent takes more, and all four, as
  ``multi_agent`` evaluates them to trace the angles of the agents at rest, against 458,752 rules over nine inputs. With
  the three rear sensors there would be 29,360,128, which would take more than 3 GB as arrays: they are not timed.
- lei2014: DDCFC in three directions and VFC against 2187 rules over seven inputs.

Each ratio stands twice: as a robot would call the rule bases, one after the other from Python, which takes a
microsecond or two a call, however many rules there are; and in bulk, many points in one compiled loop. ``infer`` goes
through all rules: one that looked up the at most 512 or 128 that have a strength at once would make a large rule base
quicker.

    python benchmarks/decomposition.py
"""

import itertools
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numba
import numpy as np

from navbench.cli.configuration import compose_cell
from navbench.fuzzy.inference import FuzzyInference, Variable, infer

Call = Callable[[Mapping[str, float]], object]
ROUNDS = 5
SECONDS = 0.2  # of CPU time a measurement


def flat(inputs: Mapping[str, Variable], outputs: Mapping[str, Variable], method: str) -> FuzzyInference:
    """Return a rule base with a rule for each combination of the inputs' sets, and conclusions dealt out in turn."""
    terms = [list(variable.terms) for variable in outputs.values()]
    premises = itertools.product(*(variable.terms for variable in inputs.values()))
    rules = [(*premise, *(names[i % len(names)] for names in terms)) for i, premise in enumerate(premises)]
    return FuzzyInference(inputs, outputs, rules, fallback=dict.fromkeys(outputs, 0.0), defuzzification=method)


def drawn(inputs: Mapping[str, Variable], count: int = 50) -> list[dict[str, float]]:
    """Return some random values of every input."""
    rng = np.random.default_rng(0)
    return [{name: float(rng.uniform(v.low, v.high)) for name, v in inputs.items()} for _ in range(count)]


def calls_per_second(call: Call, points: list[dict[str, float]]) -> float:
    """Return how often a call goes into a second of CPU time."""
    calls, begin = 0, time.process_time()
    while (taken := time.process_time() - begin) < SECONDS:
        call(points[calls % len(points)])
        calls += 1
    return float(calls / taken)


@numba.njit
def answer_all(base: Any, points: Any, out: Any) -> None:
    """Ask a rule base for every point, without Python between."""
    for i in range(points.shape[0]):
        infer(base, points[i], out)


def bulk_us(inference: FuzzyInference) -> float:
    """Return the time of one point among many in one compiled loop [us]."""
    points = np.array([list(point.values()) for point in drawn(inference.inputs)])
    out = np.empty(len(inference.outputs))
    return 1e6 / calls_per_second(lambda _: answer_all(inference.base, points, out), [{}]) / len(points)


def compare(name: str, parts: Mapping[str, tuple[Call, Sequence[FuzzyInference]]], whole: FuzzyInference) -> None:
    """Time some ways to decompose a rule base beside it, and print the times and ratios.

    Args:
        name: of the paper.
        parts: what each way is called, how it is asked, and the rule bases that it asks.
        whole: the flat rule base.
    """
    points = drawn(whole.inputs)
    sides: dict[str, Call] = {side: call for side, (call, _) in parts.items()}
    sides["flat"] = lambda at: whole(*at.values())
    blocks = {side: asked for side, (_, asked) in parts.items()} | {"flat": [whole]}
    rows = []
    for i in range(ROUNDS + 1):
        called = {side: 1e6 / calls_per_second(call, points) for side, call in sides.items()}
        bulk = {side: sum(bulk_us(block) for block in asked) for side, asked in blocks.items()}
        if i:  # the first round compiles
            rows.append((called, bulk))
    for k, how in enumerate(("called", "in_bulk")):
        for side in sides:
            print(f"{name}_{side}_{how}: {statistics.median(row[k][side] for row in rows):.2f} us")
        for side in parts:
            ratio = statistics.median(row[k]["flat"] / row[k][side] for row in rows)
            print(f"ratio_{name}_{side}_{how}: {ratio:.1f}", flush=True)


def controller(*overrides: str) -> Any:
    """Return a controller as its file makes it."""
    return compose_cell(*overrides).make_controller()


def nemeiksis() -> None:
    """Compare the blocks of ``multi_agent`` with one block of what they take together."""
    blocks = controller("controller=multi_agent", "world=nemeiksis_bypass").blocks
    parts = (blocks.bypass, blocks.track_left, blocks.track_right, blocks.approach, blocks.speed)
    inputs = {key: variable for block in parts for key, variable in block.inputs.items() if key != "mu"}
    whole = flat(inputs, blocks.speed.outputs | blocks.bypass.outputs, "centroid")

    def turn(at: Mapping[str, float]) -> float:
        (mu,) = blocks.bypass(at["d_s4"], at["d_s2"], at["d_s3"])
        return float(mu)

    def obstacle_agent(at: Mapping[str, float]) -> object:
        return blocks.speed(turn(at), at["d_destination"])

    def all_agents(at: Mapping[str, float]) -> object:
        blocks.track_left(at["d_s10"], at["d_s1"])
        blocks.approach(at["bearing"])
        return blocks.speed(turn(at), at["d_destination"])

    agent = (blocks.bypass, blocks.speed)
    act = (*agent, blocks.track_left, blocks.approach)
    compare("nemeiksis2019", {"obstacle_agent": (obstacle_agent, agent), "all_agents": (all_agents, act)}, whole)


def lei() -> None:
    """Compare the two layers of ``dual_layer`` with one controller of all seven inputs."""
    layers = controller("controller=dual_layer", "world=lei_swap")
    factors = {f"{key}_{side}": v for side in "lfr" for key, v in layers.ddcfc.inputs.items()}
    inputs = {"theta_tar": layers.vfc.inputs["theta_tar"], **factors}
    whole = flat(inputs, layers.vfc.outputs, "weighted_mean_of_peaks")

    def both_layers(at: Mapping[str, float]) -> object:
        dangers = (layers.ddcfc(at[f"eta_d_{side}"], at[f"eta_t_{side}"])[0] for side in "lfr")
        return layers.vfc(at["theta_tar"], *dangers)

    compare("lei2014", {"dual_layer": (both_layers, [layers.ddcfc] * 3 + [layers.vfc])}, whole)


if __name__ == "__main__":
    nemeiksis()
    lei()
