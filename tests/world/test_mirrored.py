"""The mirror image of a layout."""

import numpy as np
import pytest

from navbench.world import Bounds, Layout, Wall
from navbench.world.grid import Grid
from navbench.world.layout import FinishLine, Start
from navbench.world.mirrored import mirrored
from navbench.world.shapes import Box, Disc, Mover, Point, Polygon

LAYOUT = Layout(
    bounds=Bounds(-1.0, 2.0, -3.0, 5.0),
    boxes=(Box(0.5, 1.0, 0.4, 0.2, 0.3),),
    discs=(Disc(-0.5, 2.0, 0.1),),
    polygons=(Polygon(corners=(Point(1.0, 2.0), Point(1.5, 2.0), Point(1.2, 2.5))),),
    walls=(Wall(-1.0, 3.0, 2.0, 3.5, 0.1),),
    movers=(
        Mover(
            radius_m=0.3,
            waypoints=(Point(0.0, -1.0), Point(1.0, -2.0)),
            speeds_mps=(0.1,),
            phase_s=2.0,
            outline=(Point(0.2, 0.0), Point(-0.1, 0.2), Point(-0.1, -0.1)),
        ),
    ),
    starts=(Start(0.0, -0.5, 0.7), Start(0.0, 0.0)),
    goals=(Point(0.2, -2.5), Point(-0.9, 4.5)),
    grid=Grid.of([[1, 0, 0], [0, 0, 0]], 0.2, -0.9, 4.0),
)


def test_the_image_of_the_image_is_the_layout_itself() -> None:
    assert mirrored(mirrored(LAYOUT)) == LAYOUT
    assert mirrored(LAYOUT) != LAYOUT


def test_everything_lies_on_the_other_side() -> None:
    image = mirrored(LAYOUT)
    assert image.bounds == Bounds(-1.0, 2.0, -5.0, 3.0)
    assert image.boxes == (Box(0.5, -1.0, 0.4, 0.2, -0.3),)
    assert image.starts == (Start(0.0, 0.5, -0.7), Start(0.0, 0.0))
    assert image.walls == (Wall(-1.0, -3.0, 2.0, -3.5, 0.1),)
    assert image.movers[0].place(7.0) == pytest.approx(
        (LAYOUT.movers[0].place(7.0)[0], -LAYOUT.movers[0].place(7.0)[1])
    )
    assert [point.y_m for point in image.movers[0].outline] == [0.0, -0.2, 0.1]


def test_every_point_is_as_far_from_the_image_as_its_own_image_from_the_layout() -> None:
    image = mirrored(LAYOUT)
    assert image.grid is not None
    rng = np.random.default_rng(0)
    obstacles, others = ((lay.box_rows(), lay.disc_rows(), lay.polygon_rows()) for lay in (LAYOUT, image))
    for x, y in rng.uniform(-3.0, 5.0, (200, 2)).tolist():
        assert image._away(Point(x, -y), *others) == pytest.approx(LAYOUT._away(Point(x, y), *obstacles), abs=1e-9)


def test_a_finish_line_and_its_goals_are_mirrored_too() -> None:
    line = FinishLine(-1.0, 1.0, 2.0, 1.5)
    layout = Layout(bounds=LAYOUT.bounds, starts=(Start(0.0, 0.0),), goals=(Point(0.0, 4.0),), finish_line=line)
    assert mirrored(layout).finish_line == FinishLine(-1.0, -1.0, 2.0, -1.5)
