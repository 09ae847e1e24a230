"""From a composed configuration to a cell: plain values, checked, and the controller ready to be made."""

import inspect
import os
import typing
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from hydra import compose, initialize_config_module
from hydra.errors import HydraException
from hydra.utils import get_object, instantiate
from omegaconf import DictConfig, OmegaConf, open_dict
from pydantic import PydanticUserError, TypeAdapter, ValidationError

from navbench import schema
from navbench.cells import Cell
from navbench.contract import Controller
from navbench.description import DescriptionError, describe
from navbench.episode import Jitter, check_fits
from navbench.record import Names
from navbench.robot import Robot
from navbench.sensors import Sensors
from navbench.similarity import Native
from navbench.simulation import SimulatorOptions
from navbench.world import World


def compose_cell(*overrides: str, config_dir: str | None = None) -> Cell:
    """Return the cell that the command line would run with these words.

    Args:
        overrides: such as "controller=sflc", "world=deadlock", "episodes=10".
        config_dir: a folder with further controllers, worlds and robots, as after ``--config-dir``.

    Raises:
        hydra.errors.HydraException: an unknown choice or key.
        DescriptionError: a wrong value; and as ``cell_of``.
    """
    schema.register()
    search = [] if config_dir is None else [f"hydra.searchpath=[file://{os.path.abspath(config_dir)}]"]
    with initialize_config_module("navbench.conf", version_base="1.3"):
        config = compose("run", [*search, *overrides], return_hydra_config=True)
    choices = dict(config.hydra.runtime.choices)
    with open_dict(config):
        del config["hydra"]
    return cell_of(config, choices)


def cell_of(config: DictConfig, choices: Mapping[str, Any]) -> Cell:
    """Return the cell that a composed configuration describes.

    Args:
        config: the configuration, of the primary config ``run``.
        choices: which file was chosen in each group.

    Raises:
        DescriptionError: one line that names the key, its value and what is allowed.
        omegaconf.errors.OmegaConfBaseException: a value is missing or an interpolation does not resolve.
    """
    values: dict[str, Any] = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)  # type: ignore[assignment]
    names = Names(*(str(choices[name]) for name in Names._fields))
    sources = {name: _take(values[name], "sources") for name in Names._fields}
    native = _native(values["controller"])
    _check_keys(values["controller"], "controller", ("build", "native"))
    world = describe(World, {**values["world"], "name": names.world}, "world")
    robot = describe(Robot, values["robot"], "robot")
    sensors = describe(Sensors, values["sensors"], "sensors")
    options = describe(SimulatorOptions, values["simulator"], "simulator")
    make_controller = _controller_maker(values["controller"].get("build"), sensors, names)
    check_fits(world, robot)
    for key in ("episodes", "workers"):
        if values[key] is not None and values[key] < 1:
            raise DescriptionError(f"{key}={values[key]}: must be at least 1")
    for key in ("seed", "start_jitter_m", "start_heading_jitter_rad"):
        if not 0 <= values[key] < float("inf"):
            raise DescriptionError(f"{key}={values[key]}: must be finite and at least 0")
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


def _take(values: dict[str, Any], key: str) -> Any:
    """Return a key's value and remove it."""
    return values.pop(key, {})


def _check_keys(values: Mapping[str, Any], key: str, allowed: tuple[str, ...]) -> None:
    for name in values:
        if name not in allowed:
            raise DescriptionError(f"{key}.{name}: unknown key; allowed here: {', '.join(allowed)}, sources")


def _native(controller: dict[str, Any]) -> Native | None:
    """Return what the controller was drawn for, or None where it does not say."""
    values = controller.get("native")
    if values is None:
        return None
    _check_keys(values, "controller.native", ("robot", "period_s"))
    for name in ("robot", "period_s"):
        if name not in values:
            raise DescriptionError(f"controller.native.{name}: missing; native needs a robot and a period_s")
    _take(values["robot"], "sources")
    robot = describe(Robot, values["robot"], "controller.native.robot")
    period = values["period_s"]
    if isinstance(period, bool) or not isinstance(period, int | float) or not 0.0 < period < float("inf"):
        raise DescriptionError(f"controller.native.period_s={period!r}: must be a finite number above 0")
    return Native(robot, float(period))


def _controller_maker(build: Any, sensors: Sensors, names: Names) -> Callable[[], Controller]:
    """Return what makes a controller, after making one to see that its parameters and its sensors fit."""
    if not isinstance(build, dict) or "_target_" not in build:
        raise DescriptionError("controller.build._target_: missing; it names the controller's class, as module.Class")
    parameters = {name: value for name, value in build.items() if not name.startswith("_")}
    target = _located(build["_target_"])
    _check_parameters(target, parameters)
    try:
        controller = instantiate(build, _convert_="all")
    except Exception as error:  # whatever a constructor says of its parameters
        raise DescriptionError(f"controller.build: {error.__cause__ or error}") from None
    if not isinstance(controller, Controller):
        raise DescriptionError(f"controller.build._target_={build['_target_']}: must have reset(setup, rng) and act()")
    needed = getattr(controller, "sensor_roles", None)
    offered = tuple(mount.role for mount in sensors.mounts)
    if needed is not None and tuple(needed) != offered:
        raise DescriptionError(
            f"sensors={names.sensors}: {names.controller} needs {len(needed)} range sensors, {', '.join(needed)}; "
            f"this suite has {len(offered)}: {', '.join(offered)}"
        )
    return partial(target, **parameters)  # made for each episode anew: Hydra's own partial costs 0.1 ms a call


def _located(target: str) -> Callable[..., Any]:
    try:
        found: Callable[..., Any] = get_object(target)
    except (HydraException, ImportError, AttributeError, ValueError) as error:
        cause = error.__cause__ or error
        raise DescriptionError(
            f"controller.build._target_={target}: cannot be imported ({type(cause).__name__}: {cause})"
        ) from None
    return found


def _check_parameters(target: Callable[..., Any], parameters: Mapping[str, Any]) -> None:
    """Check names and types against the target's own signature, so that no word passes where a number belongs."""
    signature = inspect.signature(target)
    free = any(p.kind is p.VAR_KEYWORD for p in signature.parameters.values())
    for name in parameters:
        if name not in signature.parameters and not free:
            allowed = ", ".join(signature.parameters) or "none"
            raise DescriptionError(f"controller.build.{name}: unknown key; allowed here: {allowed}")
    for name, parameter in signature.parameters.items():
        required = parameter.default is parameter.empty and parameter.kind not in (
            parameter.VAR_KEYWORD,
            parameter.VAR_POSITIONAL,
        )
        if required and name not in parameters:
            raise DescriptionError(f"controller.build.{name}: missing; a value is needed")
    hints = typing.get_type_hints(target.__init__ if inspect.isclass(target) else target)
    for name, value in parameters.items():
        if name not in hints:
            continue
        try:
            TypeAdapter(hints[name]).validate_python(value, strict=True)
        except PydanticUserError:
            continue  # a type that only the controller itself can check
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            path = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"])
            allowed = first["msg"].replace("Input should be", "must be")
            raise DescriptionError(f"controller.build.{name}{path}={first['input']!r}: {allowed}") from None
