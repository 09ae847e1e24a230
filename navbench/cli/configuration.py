"""From a composed configuration to a cell: plain values, checked, and the controller ready to be made."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from navbench.cli.building import check_keys, controller_maker, simulator_class
from navbench.cli.composing import Composed, composing
from navbench.cli.display import why_none
from navbench.cli.metrics import metrics_of
from navbench.cli.worlds import world_of
from navbench.contract import Controller
from navbench.episode.similarity import Native, Similarity, period_s
from navbench.episode.starts import Jitter
from navbench.experiments.cells import Cell
from navbench.records import Names
from navbench.robot import Robot
from navbench.sensors import suite_of
from navbench.simulation.motion import SUBSTEP_RADII
from navbench.sources import check_sources
from navbench.validation import DescriptionError, describe
from navbench.world.world import World

EPISODES_MAX = 10**6
SEED_MAX = 2**63 - 1  # what a column of whole numbers holds
TIMEOUT_S = 1e-3, 1e6  # what the timers of operating systems hold
NONE: Mapping[str, Callable[..., Controller]] = {}
STEPS_MAX = 10**6  # of an episode: more are a slip in a unit, and would fill the memory


def compose_cell(*overrides: str, config_dir: str | Path | None = None) -> Cell:
    """Return the cell that the command line would run with these words.

    Args:
        overrides: such as "controller=sflc", "world=deadlock", "episodes=10".
        config_dir: a folder with further controllers, worlds and robots, as after ``--config-dir``.

    Raises:
        hydra.errors.HydraException: an unknown choice or key.
        DescriptionError: a wrong value; and as ``cell_of``.
    """
    with composing(config_dir) as composer:
        return cell_of(composer.values("run", overrides))


def cell_of(run: Composed, makers: Mapping[str, Callable[..., Controller]] = NONE) -> Cell:
    """Return the cell that a composed configuration describes.

    Args:
        run: the configuration.
        makers: what makes a controller of some names, where a program gives that.

    Raises:
        DescriptionError: one line that names the key, its value and what is allowed.
    """
    _check_numbers(run.values)
    names = Names(*(str(run.choices[name]) for name in Names._fields))
    groups = {name: _mapping(run.values[name], name) for name in Names._fields}
    sources = {
        name: latest_sources(_mapping(group.get("sources") or {}, f"{name}.sources")) for name, group in groups.items()
    }
    for name, of in sources.items():
        check_sources(name, of)
    groups = {name: without(group, "sources") for name, group in groups.items()}
    controller = groups["controller"]
    check_keys(controller, "controller", ("build", "native", "sources", "tunable", "repair"))
    native, robot_drawn_for = native_of(controller.get("native"))
    if native is not None:
        controller["native"] = {**controller["native"], "robot": robot_drawn_for}
    groups["controller"] = without(controller, "tunable", "repair")  # they are a tuning's
    world, groups["world"] = world_of(groups["world"], names.world)
    robot = describe(Robot, groups["robot"], "robot")
    sensors = suite_of(groups["sensors"])
    if groups["sensors"].get("ring") is None:  # without one, results are called as before there were any
        groups["sensors"] = without(groups["sensors"], "ring")
    simulator = simulator_class(groups["simulator"].get("_target_"))
    options = describe(simulator.Options, without(groups["simulator"], "_target_"), "simulator")
    groups["simulator"] = without(groups["simulator"], "gui")  # a window changes nothing that is measured
    make_controller = controller_maker(controller.get("build"), sensors, names, makers.get(names.controller))
    if hasattr(make_controller.func, "digest"):  # of what it reads from a file
        groups["controller"]["digest"] = str(make_controller().digest)  # type: ignore[attr-defined]
    world.check_fits(robot.radius_m)
    world.check_starts()
    _check_steps(world, robot, native)
    if options.gui and not simulator.has_window:
        raise DescriptionError(f"simulator.gui=True: {names.simulator} has no window")
    if options.gui and (why := why_none()):
        raise DescriptionError(f"simulator.gui=True: needs a display, {why}")
    alone = run.values["episode"]
    jitter = {key: run.values[key] for key in ("start_jitter_m", "start_heading_jitter_rad")}
    metrics = {"metrics": [{"_target_": name} for name in run.values["metrics"]]} if run.values["metrics"] else {}
    return Cell(
        names=names,
        configuration={**groups, **jitter, **metrics},
        sources=sources,
        controller=make_controller.func,
        native=native,
        world=world,
        robot=robot,
        sensors=sensors,
        simulator=simulator,
        options=options,
        jitter=Jitter(*jitter.values()),
        seed=run.values["seed"],
        episodes=run.values["episodes"] if alone is None else 1,
        first_episode=alone or 0,
        metrics=metrics_of(run.values["metrics"]),
        timeout_s=run.values["controller_timeout_s"],
        keep_ranges=run.values["record"] == "ranges",
    )


def _check_numbers(values: Mapping[str, Any]) -> None:
    """Check the numbers beside the groups."""
    most = {"episodes": (1, EPISODES_MAX), "episode": (0, EPISODES_MAX), "seed": (0, SEED_MAX)}
    for key, (low, high) in most.items():
        if values[key] is not None and not low <= values[key] <= high:
            raise DescriptionError(f"{key}={values[key]}: must be from {low} to {high}")
    if values["record"] not in (None, "ranges"):
        raise DescriptionError(f"record={values['record']}: must be ranges, or null for nothing more")
    timeout_s, (low_s, high_s) = values["controller_timeout_s"], TIMEOUT_S
    if timeout_s is not None and not low_s <= timeout_s <= high_s:
        raise DescriptionError(f"controller_timeout_s={timeout_s}: must be from {low_s} to {high_s}, or null for any")
    for key in ("start_jitter_m", "start_heading_jitter_rad"):
        if not 0 <= values[key] < float("inf"):
            raise DescriptionError(f"{key}={values[key]}: must be finite and at least 0")


def _check_steps(world: World, robot: Robot, native: Native | None) -> None:
    """Check that an episode ends within a number of periods and substeps that a machine can bear."""
    fastest = max(robot.wheel_speed_max_mps, world.fastest_mps)
    period = period_s(native, Similarity.between(robot, native))
    step_s = min(period, SUBSTEP_RADII * robot.radius_m / fastest)
    if not world.time_limit_s <= STEPS_MAX * step_s:
        raise DescriptionError(
            f"world.time_limit_s={world.time_limit_s}: must be at most {STEPS_MAX} steps of {step_s:.3g} s here: "
            f"control period {period:.3g} s, speeds to {fastest:.3g} m/s, radius {robot.radius_m:.3g} m"
        )


def latest_sources(sources: Mapping[str, Any]) -> dict[str, Any]:
    """Return each parameter's source: where a tuned controller inherits from another one, how it was tuned."""
    latest = ("tuned", "seed")
    return {
        key: {kind: source[kind] for kind in latest if kind in source} if "tuned" in source else source
        for key, source in ((key, _mapping(source, f"sources.{key}")) for key, source in sources.items())
    }


def _mapping(values: Any, key: str) -> dict[str, Any]:
    if not isinstance(values, dict):
        raise DescriptionError(f"{key}={values!r}: must be a mapping")
    return values


def without(values: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    """Return a mapping without some keys."""
    return {key: value for key, value in values.items() if key not in keys}


def native_of(values: Any) -> tuple[Native | None, dict[str, Any]]:
    """Return what a controller was drawn for, or None where it does not say, and that robot's plain values."""
    if values is None:
        return None, {}
    check_keys(_mapping(values, "controller.native"), "controller.native", ("robot", "period_s"))
    for name in ("robot", "period_s"):
        if name not in values:
            raise DescriptionError(f"controller.native.{name}: missing; native needs a robot and a period_s")
    drawn_for = without(_mapping(values["robot"], "controller.native.robot"), "sources")
    robot = describe(Robot, drawn_for, "controller.native.robot")
    period = values["period_s"]
    if isinstance(period, bool) or not isinstance(period, int | float) or not 0.0 < period < float("inf"):
        raise DescriptionError(f"controller.native.period_s={period!r}: must be a finite number above 0")
    return Native(robot, float(period)), drawn_for
