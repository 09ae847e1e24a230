"""Pictures of a robot's body and wheels, and of the rays of its sensors."""

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from navbench.report.drawing import draw_circle
from navbench.report.figures import PALETTE, Block
from navbench.robot import Robot
from navbench.sensors import Mount, Sensors

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WHEEL_LENGTH, WHEEL_WIDTH = 0.7, 0.16  # of a wheel as it is drawn, in radii: no robot says how large it is
LEVEL_MAX, NAMED_MAX = 20, 60  # roles that are written level, and that are written at all
AHEAD_RADII = 0.75  # where the arrow's tip is that shows the heading
BODY, WHEEL = "#5c677d", "#333333"
HALF_RADII, NAMED_RADII = 1.9, 2.6  # what a picture of the body shows to each side, without and with roles


def robot_block(robot: Robot) -> Block:
    """Return the picture of a body and its wheels, with what the robot says of itself beside it."""
    return Block(
        "",
        [
            partial(draw_body, radius_m=robot.radius_m, track_m=robot.track_m),
            partial(_draw_facts, facts=facts_of(robot)),
        ],
        2,
        4.4,
    )


def ring_block(sensors: Sensors, track_m: float | None = None) -> Block:
    """Return the picture of a suite on a robot of its size: where its sensors sit and look, and how far they see.

    Args:
        sensors: the suite.
        track_m: between the robot's wheels [m]; None where it has none to show.
    """
    panels = [partial(_draw_mounts, sensors=sensors, track_m=track_m), partial(_draw_reach, sensors=sensors)]
    return Block("sensors", panels, 2, 4.6)


def facts_of(robot: Robot) -> dict[str, str]:
    """Return what a robot says of itself, and what follows from it."""
    spin = 2.0 * robot.wheel_speed_max_mps / robot.track_m
    accel = robot.wheel_accel_max_mps2
    return {
        "radius": f"{robot.radius_m:g} m",
        "track, between the wheels": f"{robot.track_m:g} m",
        "greatest speed of a wheel": f"{robot.wheel_speed_max_mps:g} m/s",
        "greatest acceleration of a wheel": "not limited" if accel is None else f"{accel:g} m/s²",
        "greatest forward speed": f"{robot.wheel_speed_max_mps:g} m/s",
        "greatest turning rate, on the spot": f"{spin:.4g} rad/s",
        "time over its radius": f"{robot.radius_m / robot.wheel_speed_max_mps:.3g} s",
    }


def draw_body(ax: "Axes", radius_m: float, track_m: float | None) -> None:
    """Draw a hull with its heading, forward to the right, and its wheels where their distance is known."""
    from matplotlib.patches import Rectangle

    r, half = radius_m, 0.5 * (track_m or 0.0)
    draw_circle(ax, 0.0, 0.0, r, BODY)
    for y in (half, -half) if track_m is not None else ():
        place = (-0.5 * WHEEL_LENGTH * r, y - 0.5 * WHEEL_WIDTH * r)
        ax.add_patch(Rectangle(place, WHEEL_LENGTH * r, WHEEL_WIDTH * r, color=WHEEL, zorder=4))
    arrow: dict[str, Any] = {"arrowstyle": "-|>", "color": "black", "shrinkA": 0.0, "shrinkB": 0.0}
    ax.annotate("", (AHEAD_RADII * r, 0.0), (0.0, 0.0), arrowprops=arrow, zorder=7)
    _frame_body(ax, HALF_RADII * max(r, half))


def _frame_body(ax: "Axes", half_m: float) -> None:
    """Show so much to each side of a robot [m]."""
    ax.set(xlim=(-half_m, half_m), ylim=(-half_m, half_m), aspect="equal")
    ax.set(xlabel="x [m], forward", ylabel="y [m], left")


def _draw_facts(ax: "Axes", facts: dict[str, str]) -> None:
    ax.set_axis_off()
    for i, (name, value) in enumerate(facts.items()):
        ax.text(0.0, 0.9 - 0.09 * i, name, transform=ax.transAxes, fontsize=9)
        ax.text(0.72, 0.9 - 0.09 * i, value, transform=ax.transAxes, fontsize=9)


def _draw_mounts(ax: "Axes", sensors: Sensors, track_m: float | None) -> None:
    """Draw where the sensors sit and look, and what they are called."""
    r = sensors.drawn_for_radius_m
    draw_body(ax, r, track_m)
    mounts = sorted(sensors.mounts, key=lambda mount: mount.heading_rad)
    every = -(-len(mounts) // NAMED_MAX) or 1
    for i, mount in enumerate(mounts):
        color, ahead = PALETTE[i % len(PALETTE)], (math.cos(mount.heading_rad), math.sin(mount.heading_rad))
        ax.plot(mount.x_m, mount.y_m, "o", color=color, markersize=4, zorder=8)
        tip = mount.x_m + 0.28 * r * ahead[0], mount.y_m + 0.28 * r * ahead[1]
        ax.plot([mount.x_m, tip[0]], [mount.y_m, tip[1]], color=color, linewidth=1.4, zorder=8)
        if i % every == 0:
            bearing, away = math.atan2(tip[1], tip[0]), max(math.hypot(*tip), r) + 0.08 * r
            _name_mount(ax, mount.role, away, bearing, color, level=len(mounts) <= LEVEL_MAX)
    _frame_body(ax, NAMED_RADII * r)
    named = f", one of {every} named" if every > 1 else ""
    ax.set_title(f"{len(mounts)} range sensors{named}" if mounts else "no range sensors", fontsize=9)


def _name_mount(ax: "Axes", role: str, away_m: float, bearing_rad: float, color: str, level: bool) -> None:
    """Write a sensor's role at a distance from the middle, away from it: level, or where there are many as a ray."""
    x, y = math.cos(bearing_rad), math.sin(bearing_rad)
    side = "left" if x > (0.2 if level else 0.0) else "right" if x < (-0.2 if level else 0.0) else "center"
    turn = 0.0 if level else math.degrees(math.atan2(y, x) if x > 0.0 else math.atan2(-y, -x))
    look: dict[str, Any] = {"ha": side, "va": "center", "rotation": turn, "rotation_mode": "anchor"}
    ax.text(away_m * x, away_m * y, role, color=color, fontsize=8 if level else 7, zorder=9, **look)


def _draw_reach(ax: "Axes", sensors: Sensors) -> None:
    """Draw the rays of all cones, from their least to their greatest reading, and how far the tracker sees."""
    from matplotlib.collections import LineCollection

    mounts = sorted(sensors.complete_mounts(), key=lambda mount: mount.heading_rad)
    radius_m = sensors.drawn_for_radius_m
    draw_circle(ax, 0.0, 0.0, radius_m, BODY)
    rays = [_rays_of(mount) for mount in mounts]
    for i, of in enumerate(rays):
        ax.add_collection(LineCollection(of.tolist(), colors=PALETTE[i % len(PALETTE)], linewidths=0.9))
    far = float(np.abs(np.concatenate(rays)).max()) if rays else radius_m
    if sensors.tracker is not None:
        seen_m = radius_m + sensors.tracker.range_m
        ax.add_patch(_ring(seen_m))
        far = max(far, seen_m) if far > 0.1 * seen_m or not rays else far
    _frame_body(ax, 1.08 * far)
    ax.set_title("\n".join(told_of(sensors)), fontsize=9)


def _ring(radius_m: float) -> Any:
    from matplotlib.patches import Circle

    return Circle((0.0, 0.0), radius_m, fill=False, linestyle="--", color="0.5")


def _rays_of(mount: Mount) -> Any:
    """Return the rays of a mount's cone: (n, 2, 2), from its least reading to its greatest [m]."""
    half, count = mount.cone_half_angle_rad or 0.0, mount.rays or 1
    headings = mount.heading_rad + (np.linspace(-half, half, count) if count > 1 else np.zeros(1))
    ahead = np.column_stack([np.cos(headings), np.sin(headings)])
    ends = np.array([mount.min_range_m, mount.max_range_m], dtype=float)
    return np.array([mount.x_m, mount.y_m]) + ends[None, :, None] * ahead[:, None, :]


def told_of(sensors: Sensors) -> list[str]:
    """Return what a suite says of its rays, its noise and its tracker, a line each."""
    mounts, told = sensors.complete_mounts(), []
    if mounts:
        low, high = (
            min(mount.min_range_m or 0.0 for mount in mounts),
            max(mount.max_range_m or 0.0 for mount in mounts),
        )
        told.append(f"{sum(mount.rays or 1 for mount in mounts)} rays, readings from {low:.3g} to {high:.3g} m")
    noise = [f"noise {sensors.noise_std_m:g} m"] if sensors.noise_std_m else []
    noise += [f"drop-out {sensors.dropout_probability:g}"] if sensors.dropout_probability else []
    if noise:
        told.append(", ".join(noise))
    if sensors.tracker is not None:
        told.append(f"tracker of discs up to {sensors.tracker.range_m:.3g} m (dashed)")
    return told
