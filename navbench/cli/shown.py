"""Pictures of what a name of the catalogue stands for: a controller, a world, a robot, a sensor suite."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from navbench.cli.composing import Composed, composing, key_of
from navbench.cli.configuration import SEED_MAX, cell_of, latest_sources, without
from navbench.cli.worlds import world_of
from navbench.episode.tasks import why_impossible
from navbench.robot import Robot
from navbench.sensors import Sensors, suite_of
from navbench.sources import KINDS
from navbench.validation import DescriptionError, describe
from navbench.world.layout import DrawnWorld

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EPISODES, EPISODES_MAX = 6, 24  # layouts of a picture

Drawn = tuple["Figure", str, str]


def draw_named(subject: str, words: Sequence[str], config_dir: str | None) -> Drawn:
    """Return the picture of what some words of a run choose, what its file is called, and what it shows.

    Args:
        subject: of what: "controller", "world", "robot" or "sensors".
        words: as of a run.
        config_dir: the folder after ``--config-dir``.

    Raises:
        DescriptionError: a wrong value; and what ``Composer.values`` raises.
    """
    with composing(config_dir) as composer:
        return DRAWN[subject](composer.values("run", words), words)


def _controller(composed: Composed, words: Sequence[str]) -> Drawn:
    from navbench.report.controllers import draw_controller

    cell = cell_of(composed)
    name = cell.names.controller
    own = cell.native.robot if cell.native and not _gives("robot", words) else cell.robot
    controller = composed.values["controller"]
    says = f"controller {name} with sensors {cell.names.sensors}"
    figure = draw_controller(says, cell.make_controller(), own, cell.sensors, _parameters(controller))
    return figure, f"controller {name}", says


def _parameters(controller: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return each parameter of a controller's build: its name, its value, and where it comes from."""
    from navbench.analysis.stored import leaves_of

    sources = latest_sources(controller.get("sources") or {})
    rows = []
    for name, value in leaves_of(without(controller["build"], "_target_")):
        key = max((key for key in sources if f"build.{name}".startswith(key)), key=len, default="")
        rows.append((name, value, next((kind for kind in KINDS if kind in sources.get(key, {})), "")))
    return rows


def _world(composed: Composed, words: Sequence[str]) -> Drawn:
    from navbench.report.worlds import draw_layouts

    name, seed = str(composed.choices["world"]), composed.values["seed"]
    layouts = layouts_of(composed, composed.values["episodes"] if _gives("episodes", words) else EPISODES, EPISODES_MAX)
    fixed = len(layouts) == 1
    says = f"world {name}" + ("" if fixed else f", seed {seed}, episodes 0 to {len(layouts) - 1}")
    figure = draw_layouts(says, layouts, robot_of(composed).radius_m)
    return (
        figure,
        f"world {name}" + ("" if fixed else f" seed {seed}"),
        "\n".join([says, *impossible(composed, layouts)]),
    )


def layouts_of(composed: Composed, episodes: int, most: int) -> list[DrawnWorld]:
    """Return the composed world's layouts of its first episodes, or the one that is always the same.

    Args:
        composed: the world, with the seed.
        episodes: how many.
        most: how many may be asked for.

    Raises:
        DescriptionError: a wrong value; and what ``world_of`` and ``World.drawn_for`` raise.
    """
    seed = composed.values["seed"]
    if not 1 <= episodes <= most:
        raise DescriptionError(f"episodes={episodes}: must be from 1 to {most} here")
    if not 0 <= seed <= SEED_MAX:
        raise DescriptionError(f"seed={seed}: must be from 0 to {SEED_MAX}")
    world, _ = world_of(without(composed.values["world"], "sources"), str(composed.choices["world"]))
    layouts = [world.drawn_for(seed, episode) for episode in range(episodes)]
    return layouts[:1] if all(layout == layouts[0] for layout in layouts) else layouts


def impossible(composed: Composed, layouts: Sequence[DrawnWorld]) -> list[str]:
    """Return a line on how many layouts have a task that the composed robot cannot do, and why; empty without any."""
    reasons = {k: why_impossible(layout, robot_of(composed).radius_m) for k, layout in enumerate(layouts)}
    found = [f"episode {k}: {why}" for k, why in reasons.items() if why]
    return [f"{len(found)} of {len(layouts)} impossible; {found[0]}"] if found else []


def robot_of(composed: Composed) -> Robot:
    """Return the composed robot."""
    return describe(Robot, without(composed.values["robot"], "sources"), "robot")


def _robot(composed: Composed, words: Sequence[str]) -> Drawn:
    from navbench.report.bodies import ring_block, robot_block
    from navbench.report.figures import stacked

    robot, says = robot_of(composed), f"robot {composed.choices['robot']}"
    blocks = [robot_block(robot)]
    if _gives("sensors", words):
        blocks.append(ring_block(_sensors_of(composed).scaled_to(robot.radius_m), robot.track_m))
        says += f" with sensors {composed.choices['sensors']}"
    return stacked(says, blocks), says, says


def _sensors_of(composed: Composed) -> Sensors:
    return suite_of(without(composed.values["sensors"], "sources"))


def _sensors(composed: Composed, words: Sequence[str]) -> Drawn:
    """Draw a suite on the robot that is named, or else on one of the size that it was drawn for."""
    from navbench.report.bodies import ring_block
    from navbench.report.figures import stacked

    sensors, says = _sensors_of(composed), f"sensors {composed.choices['sensors']}"
    if not _gives("robot", words):
        return stacked(says, [ring_block(sensors)]), says, says
    robot = robot_of(composed)
    says += f" on robot {composed.choices['robot']}"
    return stacked(says, [ring_block(sensors.scaled_to(robot.radius_m), robot.track_m)]), says, says


def _gives(key: str, words: Sequence[str]) -> bool:
    return any(key_of(word) == key for word in words)


DRAWN: Mapping[str, Callable[[Composed, Sequence[str]], Drawn]] = {
    "controller": _controller,
    "world": _world,
    "robot": _robot,
    "sensors": _sensors,
}
