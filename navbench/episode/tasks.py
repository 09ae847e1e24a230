"""Whether a task can be done at all: a goal that is connected with its start, and room for all bodies at their goals.

What is told is impossible is so for every controller: movers are left out, robots count only where they have arrived,
and bounds do not block. All rounding is in favour of possible: a round outline is taken as the polygon that lies in it,
of 64 corners, and a passage counts as wider by 2 ``SLACK`` than it is.
"""

import math
from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled
from navbench.contract import Pose
from navbench.mathematics.geometry import distance_to_nearest, segment_crossing
from navbench.simulation.scene import Scene
from navbench.world.grid import nearest_cell
from navbench.world.layout import DrawnWorld, ImpossibleError, Layout, Start
from navbench.world.world import World

if TYPE_CHECKING:
    import shapely

FloatArray = NDArray[np.float64]

SLACK = 1e-3  # of the robot's radius, by which obstacles count as further away
QUARTER = 16  # corners of a quarter of a round outline
KNOWN_MAX = 256  # starts of which a free space remembers what was found
MARGIN_M = 1.0  # around everything, in which a robot may drive past it


class FreeSpace:
    """Where the centre of a robot may be in a drawn world without touching what stands in it.

    Args:
        world: the world as drawn for an episode.
        radius_m: the robot's hull [m].

    Attributes:
        scene: the world as arrays, at time 0.
    """

    def __init__(self, world: DrawnWorld, radius_m: float) -> None:
        self.world, self.radius_m, self.scene = world, radius_m, Scene(world)
        self._near_m = (1.0 - SLACK) * radius_m
        self._known: dict[object, Any] = {}
        self._still = (
            self.scene.boxes, self.scene.discs[: len(world.discs)], self.scene.polygons[: len(world.polygons)]
        )  # fmt: skip

    def once(self, asked: object, find: Callable[[], Any]) -> Any:
        """Return what ``find`` does, found once for what is asked: controllers meet the same starts."""
        if asked not in self._known:
            if len(self._known) == KNOWN_MAX:
                self._known.clear()
            self._known[asked] = find()
        return self._known[asked]

    def check(self, starts: Sequence[Pose | Start]) -> None:
        """Check that every robot can reach its goal, and all of them together.

        Args:
            starts: where the robots begin, free of everything.

        Raises:
            ImpossibleError: one cannot; the message says which and why.
        """
        self.once(tuple(starts), lambda: self._check(starts))

    def _check(self, starts: Sequence[Pose | Start]) -> None:
        for i, start in enumerate(starts):
            if not (self._is_whole or self._is_straight(start, i) or self._joins(start, i)):
                raise ImpossibleError(
                    f"goals[{i}]: nothing leads there from starts[{i}] for a robot of radius {self.radius_m:g} m"
                )
        if len(starts) > 1 and self.world.finish_line is None:
            self._check_room()

    def _is_straight(self, start: Pose | Start, index: int) -> bool:
        """Return whether a robot can drive straight to its goal."""
        goal, line = self.world.goals[index], self.world.finish_line
        between = start.x_m, start.y_m, goal.x_m, goal.y_m
        if line is not None and segment_crossing(*between, np.array(_ends(line))) < 0.0:
            return False
        far = self.world.goal_tolerance_m, self._near_m
        return bool(_is_free(*between, *far, *self._still, *self.scene.grid))

    def _joins(self, start: Pose | Start, index: int) -> bool:
        """Return whether a connected part of the free space holds a start and comes near enough to its goal."""
        import shapely

        return bool(shapely.intersects_xy(self._around_goals[index], start.x_m, start.y_m).any())

    @cached_property
    def _around_goals(self) -> list[Any]:
        """For each goal the connected parts of the free space from which a robot arrives."""
        import shapely

        line, far_m = self.world.finish_line, SLACK * self.radius_m
        if line is not None:
            return [self._parts[shapely.distance(self._parts, _segment(line)) <= far_m]] * len(self.world.goals)
        far_m += self.world.goal_tolerance_m
        at = [shapely.Point(goal.x_m, goal.y_m) for goal in self.world.goals]
        return [self._parts[shapely.distance(self._parts, goal) <= far_m] for goal in at]

    @cached_property
    def _is_whole(self) -> bool:
        """Whether the free space is certainly in one piece."""
        boxes, discs, polygons = self._still
        if self.world.grid is not None:
            return False
        return bool(_is_forest(boxes, discs, polygons, self._near_m))

    @cached_property
    def _parts(self) -> Any:
        """The connected parts of the free space, see ``_free_parts``."""
        boxes, discs, _ = self._still
        if self.world.grid is not None:
            boxes = np.concatenate([boxes, self.world.grid.rectangles()])
        outlines = tuple(tuple((c.x_m, c.y_m) for c in one.corners) for one in self.world.polygons)
        b, line = self.world.bounds, self.world.finish_line
        around = (b.x_min_m, b.y_min_m, b.x_max_m, b.y_max_m), None if line is None else _ends(line)
        return _free_parts(boxes.tobytes(), discs.tobytes(), outlines, *around, self._near_m, MARGIN_M + self.radius_m)

    def _check_room(self) -> None:
        """Check that no two robots are in each other's place when both have arrived."""
        tolerance_m = self.world.goal_tolerance_m
        needed_m = 2.0 * (self._near_m - tolerance_m)
        i, j, apart_m = _closest(np.array([(goal.x_m, goal.y_m) for goal in self.world.goals]))
        if apart_m < needed_m:
            raise ImpossibleError(
                f"goals[{j}]: lies {apart_m:.3g} m from goals[{i}], where two robots of radius "
                f"{self.radius_m:g} m need {needed_m:.3g} m with goal_tolerance_m={tolerance_m:g}"
            )


@lru_cache(maxsize=16)  # worlds and robots: the controllers of a study share them
def free_space(world: World, radius_m: float) -> FreeSpace:
    """Return the free space of a world whose layout is always the same; arguments as of ``FreeSpace``."""
    assert isinstance(world.source, Layout)
    return FreeSpace(world.of(world.source), radius_m)


@lru_cache(maxsize=64)  # worlds and robots: the cells of a study share them, and to unite shapes takes a millisecond
def _free_parts(
    boxes: bytes,
    discs: bytes,
    outlines: Sequence[Sequence[tuple[float, float]]],
    bounds: tuple[float, float, float, float],
    line: Any,
    near_m: float,
    margin_m: float,
) -> Any:
    """Return the connected parts of the free space, polygons in a frame around everything.

    Args:
        boxes: the bytes of (n, 6) as in ``Layout.box_rows``.
        discs: of (m, 5) as in ``Layout.disc_rows``.
        outlines: of each polygon the corners' x and y [m].
        bounds: of the world, x and y of the lower left and of the upper right corner [m].
        line: x and y of the finish line's ends [m], None without one.
        near_m: how near to a thing the robot's centre may be [m].
        margin_m: how far the frame lies around everything [m].
    """
    import shapely

    shapes = [
        *shapely.polygons(_corners(np.frombuffer(boxes).reshape(-1, 6))),
        *(shapely.Point(x, y).buffer(r, QUARTER) for x, y, r, *_ in np.frombuffer(discs).reshape(-1, 5)),
        *map(shapely.Polygon, outlines),
    ]
    blocked = shapely.union_all(shapes).buffer(near_m, QUARTER)
    held = [blocked, shapely.box(*bounds), *([] if line is None else [shapely.LineString([line[:2], line[2:]])])]
    frame = shapely.box(*shapely.total_bounds(held)).buffer(margin_m, join_style="mitre")
    parts = shapely.get_parts(frame.difference(blocked))
    shapely.prepare(parts)
    return parts


def why_impossible(world: DrawnWorld, radius_m: float) -> str:
    """Return why no robot of this radius [m] can do a drawn world's task from its own starts; empty where one can."""
    try:
        world.check_fits(radius_m, world.goal_tolerance_m)
        FreeSpace(world, radius_m).check(world.starts)
    except ImpossibleError as error:
        return str(error)
    return ""


@compiled
def _is_free(
    x_m: float, y_m: float, goal_x_m: float, goal_y_m: float, tolerance_m: float, near_m: float,
    boxes: FloatArray, discs: FloatArray, polygons: FloatArray, free: NDArray[np.uint8], place: FloatArray,
) -> bool:  # fmt: skip
    """Return whether a straight drive from a place to within a goal's tolerance comes nowhere nearer than this [m]."""
    length = math.hypot(goal_x_m - x_m, goal_y_m - y_m)
    done = 0.0
    while done < length - tolerance_m:
        x, y = x_m + done / length * (goal_x_m - x_m), y_m + done / length * (goal_y_m - y_m)
        gap = min(distance_to_nearest(x, y, boxes, discs, polygons), nearest_cell(x, y, free, place)) - near_m
        if gap < 1e-3 * near_m:
            return False
        done += gap
    return True


@compiled
def _closest(at: FloatArray) -> tuple[int, int, float]:
    """Return which two of some points, (n, 2), are nearest to each other, and how near [m]."""
    first, second, least = 0, 0, math.inf
    for j in range(len(at)):
        for i in range(j):
            apart = math.hypot(at[i, 0] - at[j, 0], at[i, 1] - at[j, 1])
            if apart < least:
                first, second, least = i, j, apart
    return first, second, least


@compiled
def _is_forest(boxes: FloatArray, discs: FloatArray, polygons: FloatArray, near_m: float) -> bool:
    """Return whether nothing can be enclosed: circles around convex things, grown by this [m], overlap as trees do."""
    circles = np.empty((len(boxes) + len(discs) + len(polygons), 3))
    for i in range(len(boxes)):
        circles[i] = boxes[i, 0], boxes[i, 1], math.sqrt(boxes[i, 2] ** 2 + boxes[i, 3] ** 2)
    circles[len(boxes) : len(boxes) + len(discs)] = discs[:, :3]
    circles[len(boxes) + len(discs) :] = polygons[:, :3]
    root = np.arange(len(circles))
    for i in range(len(circles)):
        for j in range(i):
            reach = circles[i, 2] + circles[j, 2] + 2.0 * near_m
            dx, dy = circles[i, 0] - circles[j, 0], circles[i, 1] - circles[j, 1]
            if dx * dx + dy * dy <= reach * reach:
                a, b = i, j
                while root[a] != a:
                    a = root[a]
                while root[b] != b:
                    b = root[b]
                if a == b:
                    return False
                root[a] = b
    return True


def _corners(boxes: FloatArray) -> FloatArray:
    """Return (n, 4, 2) the corners of boxes, (n, 6) as in ``Layout.box_rows``."""
    x, y, length, width, cos, sin = boxes.T[:, :, None]
    along, across = length * np.array([-1.0, 1.0, 1.0, -1.0]), width * np.array([-1.0, -1.0, 1.0, 1.0])
    return np.stack([x + cos * along - sin * across, y + sin * along + cos * across], axis=-1)


def _ends(line: Any) -> tuple[float, float, float, float]:
    return line.x1_m, line.y1_m, line.x2_m, line.y2_m


def _segment(line: Any) -> "shapely.LineString":
    import shapely

    return shapely.LineString([_ends(line)[:2], _ends(line)[2:]])
