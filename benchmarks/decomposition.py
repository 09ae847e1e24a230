"""What decomposing a rule base saves in time: the controllers of nemeiksis2019 and lei2014 beside one flat rule base.

A flat rule base has a rule for each combination of its inputs' sets, whose conclusions are dealt out in turn: the time
depends on how many rules there are and not on what they say.

- nemeiksis2019: the blocks 1FB and 4FB, which the obstacle agent takes and no agent takes more, and all four, as
  ``multi_agent`` evaluates them to trace the angles of the agents at rest, against 458,752 rules over nine inputs. With
  the three rear sensors there would be 29,360,128, which would take more than 3 GB as arrays: they are not timed.
- lei2014: DDCFC in three directions and VFC against 2187 rules over seven inputs.

Each stands twice: as a robot would call the rule bases, one after the other from Python, and in bulk, many points in
one compiled loop.
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from typing import Any

from benchmarks.harness import Effort, Sides, Table, compare
from benchmarks.inference import complete, from_python, in_bulk
from navbench.cli.configuration import compose_cell


def controller(*overrides: str) -> Any:
    """Return a controller as its file makes it."""
    return compose_cell(*overrides).make_controller()


def nemeiksis(how: str, _: ExitStack) -> Sides:
    """Compare the blocks of ``multi_agent`` with one block of what they take together."""
    blocks = controller("controller=multi_agent", "world=nemeiksis_bypass").blocks
    parts = (blocks.bypass, blocks.track_left, blocks.track_right, blocks.approach, blocks.speed)
    inputs = {key: variable for block in parts for key, variable in block.inputs.items() if key != "mu"}
    whole = complete(inputs, blocks.speed.outputs | blocks.bypass.outputs)
    agent = (blocks.bypass, blocks.speed)
    if how == "in bulk":
        rest = (blocks.track_left, blocks.approach)
        return {"flat": in_bulk(whole), "obstacle agent": in_bulk(*agent), "all agents": in_bulk(*agent, *rest)}

    def obstacle_agent(at: Mapping[str, float]) -> object:
        (mu,) = blocks.bypass(at["d_s4"], at["d_s2"], at["d_s3"])
        return blocks.speed(float(mu), at["d_destination"])

    def all_agents(at: Mapping[str, float]) -> object:
        blocks.track_left(at["d_s10"], at["d_s1"])
        blocks.approach(at["bearing"])
        return obstacle_agent(at)

    calls = {"flat": lambda at: whole(*at.values()), "obstacle agent": obstacle_agent, "all agents": all_agents}
    return {name: from_python(call, inputs) for name, call in calls.items()}


def lei(how: str, _: ExitStack) -> Sides:
    """Compare the two layers of ``dual_layer`` with one controller of all seven inputs."""
    layers = controller("controller=dual_layer", "world=lei_swap")
    factors = {f"{key}_{side}": v for side in "lfr" for key, v in layers.ddcfc.inputs.items()}
    inputs = {"theta_tar": layers.vfc.inputs["theta_tar"], **factors}
    whole = complete(inputs, layers.vfc.outputs, "weighted_mean_of_peaks")
    if how == "in bulk":
        return {"flat": in_bulk(whole), "two layers": in_bulk(*[layers.ddcfc] * 3, layers.vfc)}

    def both_layers(at: Mapping[str, float]) -> object:
        dangers = (layers.ddcfc(at[f"eta_d_{side}"], at[f"eta_t_{side}"])[0] for side in "lfr")
        return layers.vfc(at["theta_tar"], *dangers)

    flat = from_python(lambda at: whole(*at.values()), inputs)
    return {"flat": flat, "two layers": from_python(both_layers, inputs)}


def decomposition(effort: Effort) -> Table:
    """Measure decomposed rule bases beside flat ones."""
    papers = {"lei2014": lei} if effort.is_quick else {"lei2014": lei, "nemeiksis2019": nemeiksis}
    groups: dict[str, Callable[[ExitStack], Sides]] = {
        f"{name}, {how}": partial(make, how) for name, make in papers.items() for how in ("called", "in bulk")
    }
    text = "The rule bases of two papers beside one flat rule base of the same inputs; see decomposition.py."
    return compare("Decomposed rule bases", text, "evaluations", groups, effort)
