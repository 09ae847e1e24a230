"""Where the robots of an episode begin: the world's starts, randomly perturbed, and free of everything."""

import math
from typing import NamedTuple

from navbench.contract import Pose
from navbench.episode.tasks import FreeSpace
from navbench.mathematics.geometry import wrap_angle
from navbench.mathematics.streams import stream
from navbench.simulation.scene import Scene
from navbench.validation import DescriptionError
from navbench.world.layout import Start

DRAWS_MAX = 1000  # a start that stays in contact this often has no free place within its jitter


class Jitter(NamedTuple):
    """How far starts are perturbed: uniform in [-j, j], for x and y [m] and for the heading [rad]."""

    position_m: float = 0.0
    heading_rad: float = 0.0


def draw_starts(space: FreeSpace, jitter: Jitter, seed: int, episode: int) -> list[Pose]:
    """Return a pose for each of a drawn world's starts, randomly perturbed, drawn again while in contact.

    A start that lies outside the bounds or behind an obstacle, seen from the world's own, is drawn again too.

    Args:
        space: of the world as drawn for the episode, and of every robot's hull.
        jitter: how far the starts are perturbed.
        seed: of the streams.
        episode: its index, which names its streams.

    Raises:
        DescriptionError: a robot finds no free place.
    """
    found: list[Pose] = space.once((jitter, seed, episode), lambda: _drawn(space, jitter, seed, episode))
    return found


def _drawn(space: FreeSpace, jitter: Jitter, seed: int, episode: int) -> list[Pose]:
    world, scene, radius_m = space.world, space.scene, space.radius_m
    poses: list[Pose] = []
    for i, start in enumerate(world.starts):
        rng = stream(seed, world.name, episode, "start", i)
        for _ in range(DRAWS_MAX):
            dx, dy, turn = rng.uniform(-1.0, 1.0, 3).tolist()
            pose = Pose(
                start.x_m + dx * jitter.position_m,
                start.y_m + dy * jitter.position_m,
                wrap_angle(world.start_heading_rad(i) + turn * jitter.heading_rad),
            )
            if _reachable(scene, start, pose, radius_m) and _free(scene, pose, radius_m, poses):
                poses.append(pose)
                break
        else:
            raise DescriptionError(f"start_jitter_m={jitter.position_m}: no free place within it of starts[{i}]")
    return poses


def _reachable(scene: Scene, start: Start, pose: Pose, radius_m: float) -> bool:
    """Return whether a drawn start lies inside the bounds and on the same side of everything as the world's own."""
    if not scene.layout.bounds.hold(pose.x_m, pose.y_m):
        return False
    dx, dy = pose.x_m - start.x_m, pose.y_m - start.y_m
    steps = math.ceil(math.hypot(dx, dy) / (0.25 * radius_m))
    return all(scene.distance(start.x_m + dx * k / steps, start.y_m + dy * k / steps) > 0.0 for k in range(1, steps))


def _free(scene: Scene, pose: Pose, radius_m: float, others: list[Pose]) -> bool:
    """Return whether a robot stands free of the obstacles and of the robots already placed."""
    if scene.distance(pose.x_m, pose.y_m) <= radius_m:
        return False
    return all(math.hypot(pose.x_m - other.x_m, pose.y_m - other.y_m) > 2.0 * radius_m for other in others)
