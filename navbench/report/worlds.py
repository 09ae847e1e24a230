"""The picture of a world: layouts that were drawn, side by side."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from navbench.report.drawing import MARGIN, draw_goal, draw_movers, draw_obstacles, draw_pair, draw_robot, frame
from navbench.report.figures import STACK_INCHES, Block, robot_color, stacked
from navbench.world.layout import DrawnWorld

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS, NAMED_MAX = 3, 12  # robots with names: more names cover the picture
NAME_POINTS = (6, 6)  # from a start to its robot's name
HEIGHT_INCHES = (1.5, 7.5)  # of a panel


def draw_layouts(title: str, layouts: Sequence[DrawnWorld], radius_m: float) -> "Figure":
    """Return the picture of the layouts of a world's first episodes.

    Args:
        title: what stands above it.
        layouts: at least one.
        radius_m: of the robots [m].
    """
    columns, b = min(COLUMNS, len(layouts)), layouts[0].bounds
    ratio = (b.y_max_m - b.y_min_m) / (b.x_max_m - b.x_min_m)
    height = float(np.clip((STACK_INCHES / columns - 0.7) * ratio + 0.7, *HEIGHT_INCHES))
    names = [f"episode {i}" if len(layouts) > 1 else "" for i in range(len(layouts))]
    panels = [
        partial(draw_layout, world=one, radius_m=radius_m, title=t) for one, t in zip(layouts, names, strict=True)
    ]
    return stacked(title, [Block("", panels, columns, height)])


def draw_layout(ax: "Axes", world: DrawnWorld, radius_m: float, title: str = "") -> None:
    """Draw a layout with its movers' paths, and each robot at its start, joined with its goal."""
    draw_obstacles(ax, world)
    draw_movers(ax, world)
    frame(ax, world)
    tip_m = MARGIN * float(np.ptp(ax.get_xlim()))
    for i, (start, goal) in enumerate(zip(world.starts, world.goals, strict=True)):
        color, place = robot_color(i), (start.x_m, start.y_m)
        draw_pair(ax, start, goal, color)
        draw_goal(ax, goal, world.goal_tolerance_m, color)
        draw_robot(ax, (*place, world.start_heading_rad(i)), radius_m, color, tip_m)
        if 1 < world.robots <= NAMED_MAX:
            ax.annotate(f"R{i + 1}", place, NAME_POINTS, textcoords="offset points", color=color, fontsize=8)
    ax.set_title(title, fontsize=9)
