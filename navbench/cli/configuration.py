"""From a composed configuration to a cell: plain values, checked, and the controller ready to be made."""

import copy
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from navbench.cli.building import controller_maker
from navbench.cli.catalogue import check_folder
from navbench.cli.composing import Composed, composing
from navbench.cli.worlds import world_of
from navbench.episode.similarity import Native, Similarity, period_s
from navbench.episode.starts import Jitter
from navbench.experiments.cells import Cell
from navbench.records import Names
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.simulation.bullet import SUBSTEP_RADII
from navbench.simulation.options import SimulatorOptions
from navbench.validation import DescriptionError, describe
from navbench.world.world import World

EPISODES_MAX = 10**6
SEED_MAX = 2**63 - 1  # what a column of whole numbers holds
STEPS_MAX = 10**6  # of an episode: more are a slip in a unit, and would fill the memory


def compose_cell(*overrides: str, config_dir: str | None = None) -> Cell:
    """Return the cell that the command line would run with these words.

    Args:
        overrides: such as "controller=sflc", "world=deadlock", "episodes=10".
        config_dir: a folder with further controllers, worlds and robots, as after ``--config-dir``.

    Raises:
        hydra.errors.HydraException: an unknown choice or key.
        DescriptionError: a wrong value; and as ``cell_of``.
    """
    return cell_of(compose_run(*overrides, config_dir=config_dir))


def compose_run(*overrides: str, config_dir: str | None = None) -> Composed:
    """Return the composed configuration of a run; see ``compose_cell``."""
    if config_dir is not None:
        check_folder(Path(config_dir))
    with composing(config_dir) as composer:
        return composer.values("run", overrides)


def cell_of(run: Composed) -> Cell:
    """Return the cell that a composed configuration, of the primary config ``run``, describes.

    Raises:
        DescriptionError: one line that names the key, its value and what is allowed.
    """
    values = copy.deepcopy(run.values)  # of which a part after the other is taken
    _check_run(values, run.keys)
    names = Names(*(str(run.choices[name]) for name in Names._fields))
    sources = {
        name: latest_sources(_take(_mapping(values[name], name), "sources", f"{name}.")) for name in Names._fields
    }
    native = _native(values["controller"])
    for key in ("tunable", "repair"):
        _take(values["controller"], key, "controller.")  # for a tuning, which reads them for itself
    _check_keys(values["controller"], "controller", ("build", "native", "sources"))
    world, values["world"] = world_of(values["world"], names.world)
    robot = describe(Robot, values["robot"], "robot")
    sensors = describe(Sensors, values["sensors"], "sensors")
    options = describe(SimulatorOptions, values["simulator"], "simulator")
    make_controller = controller_maker(values["controller"].get("build"), sensors, names)
    world.check_fits(robot.radius_m)
    _check_steps(world, robot, native)
    if options.gui and sys.platform == "linux" and not os.environ.get("DISPLAY"):
        raise DescriptionError("simulator.gui=True: needs a display, and the variable DISPLAY names none")
    values["simulator"].pop("gui")  # a window changes nothing that is measured
    kept = (*Names._fields, "start_jitter_m", "start_heading_jitter_rad")
    return Cell(
        names=names,
        configuration={key: values[key] for key in kept},
        sources=sources,
        make_controller=make_controller,
        native=native,
        world=world,
        robot=robot,
        sensors=sensors,
        options=options,
        jitter=Jitter(values["start_jitter_m"], values["start_heading_jitter_rad"]),
        episodes=values["episodes"],
        seed=values["seed"],
    )


def _check_run(values: Mapping[str, Any], keys: Sequence[str]) -> None:
    """Check the keys beside the groups."""
    _check_keys(values, "", keys)
    for key in keys:
        if key not in values:
            raise DescriptionError(f"{key}: missing; a value is needed")
    most = {"episodes": (1, EPISODES_MAX), "workers": (1, float("inf")), "seed": (0, SEED_MAX)}
    for key, (low, high) in most.items():
        if values[key] is not None and not low <= values[key] <= high:
            allowed = f"at least {low}" if high == float("inf") else f"from {low} to {high}"
            raise DescriptionError(f"{key}={values[key]}: must be {allowed}")
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


def _take(values: dict[str, Any], key: str, above: str) -> Any:
    """Return a key's mapping and remove it; ``above`` is the place of the key, for the error message."""
    return _mapping(values.pop(key, None) or {}, f"{above}{key}")


def _check_keys(values: Mapping[str, Any], key: str, allowed: Iterable[str]) -> None:
    for name in values:
        if name not in allowed:
            place = f"{key}.{name}" if key else name
            raise DescriptionError(f"{place}: unknown key; allowed here: {', '.join(allowed)}")


def _native(controller: dict[str, Any]) -> Native | None:
    """Return what the controller was drawn for, or None where it does not say."""
    values = controller.get("native")
    if values is None:
        return None
    _check_keys(_mapping(values, "controller.native"), "controller.native", ("robot", "period_s"))
    for name in ("robot", "period_s"):
        if name not in values:
            raise DescriptionError(f"controller.native.{name}: missing; native needs a robot and a period_s")
    _take(_mapping(values["robot"], "controller.native.robot"), "sources", "controller.native.robot.")
    robot = describe(Robot, values["robot"], "controller.native.robot")
    period = values["period_s"]
    if isinstance(period, bool) or not isinstance(period, int | float) or not 0.0 < period < float("inf"):
        raise DescriptionError(f"controller.native.period_s={period!r}: must be a finite number above 0")
    return Native(robot, float(period))
