"""The ring's rays: where they begin and end on the robot, and how hits become readings."""

import math
from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled, direct
from navbench.mathematics.geometry import box_gap, distance_to_nearest
from navbench.memory import borrowed
from navbench.sensors import Mount, Sensors
from navbench.world.grid import FreeArray, nearest_cell

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# A ray in the robot frame, and how a hit becomes a reading.
RAY = np.dtype(
    [
        ("begin_x_m", "f8"),
        ("begin_y_m", "f8"),
        ("end_x_m", "f8"),
        ("end_y_m", "f8"),
        ("length_m", "f8"),
        ("offset_m", "f8"),  # of it, how much lies before the mount
        ("sensor", "i8"),
        ("is_only_one", "i8"),  # of its sensor
        ("cosine", "f8"),  # of its direction
        ("sine", "f8"),
    ]
)
HAIR_RADII = 0.01  # an engine may err by less than this about where a thing begins


class Rays:
    """A ring's rays in the robot frame, and how hits become readings.

    A ray begins where its line enters the hull, so that a thing between the hull and a mount outside it reads 0.

    Attributes:
        table: (n_rays,) of ``RAY``.
        unobstructed: what each sensor reads where nothing is seen [m].
        reach_m: what is further from the hull is hit by no ray [m].
        exposed_m: what is further from the hull can hold no mount of a ray that does not begin in the hull, at least 0
            [m].
        cross_hull: whether a ray comes from outside the hull and through it, or nearly; no ray sees its own robot.
    """

    def __init__(self, sensors: Sensors, radius_m: float) -> None:
        self.unobstructed = np.array([float(mount.max_range_m or 0.0) for mount in sensors.complete_mounts()])
        self.table, self.reach_m, self.exposed_m, self.cross_hull = _table(sensors.complete_mounts(), radius_m)
        self._radius_m = radius_m
        self._room = np.empty(0, np.int64)
        self._find: Callable[..., int] | None = None
        self._lower: Callable[..., None] | None = None

    def deciding(
        self, robots: NDArray[np.void], boxes: FloatArray, discs: FloatArray, polygons: FloatArray
    ) -> IntArray:
        """Return the numbers of those rays that may be what their sensors read; see ``split``.

        They may hit something, perhaps by a hair, and no other ray of the same sensor surely reads less. Of a robot
        that has ended there are none.

        Args:
            robots: (n,) of ``ROBOT``.
            boxes: (k, 6) as in ``Layout.box_rows``.
            discs: (m, 5) as in ``Layout.disc_rows``.
            polygons: (l, ...) as in ``Layout.polygon_rows``.
        """
        places = len(robots) * (1 + len(self.table)) + 1
        if len(self._room) != places:
            self._room = np.empty(places, np.int64)
        given = robots, self._radius_m, self.reach_m, self.table, boxes, discs, polygons, self._room
        self._find = self._find or direct(_deciding, *given)
        end: int = self._find(*given)
        return self._room[:end]

    def all_of(self, robots: NDArray[np.void]) -> IntArray:
        """Return the numbers of all rays of those robots that run, as ``deciding`` does."""
        count, running = len(self.table), robots["running"]
        begins = len(robots) + 1 + count * np.concatenate([[0], np.cumsum(running)])
        return np.concatenate([begins, np.tile(np.arange(count), running.sum())])

    def split(self, deciding: IntArray, robots: int) -> list[list[int]]:
        """Return the numbers of the deciding rays of each robot."""
        found = deciding.tolist()
        return [found[begin:end] for begin, end in pairwise(found[: robots + 1])]

    def read(self, deciding: IntArray, shares: list[float], readings: FloatArray) -> None:
        """Lower readings, (n_robots, n_sensors) [m], to what the deciding rays hit of which these shares are free."""
        given = deciding, self.table, np.array(shares), readings
        self._lower = self._lower or direct(_read, *given)
        self._lower(*given)

    def blind_inside_things(
        self,
        ranges: FloatArray,
        robot: np.void,
        boxes: FloatArray,
        discs: FloatArray,
        polygons: FloatArray,
        grid: tuple[FreeArray, FloatArray],
    ) -> None:
        """Set to 0, in place, a robot's readings of sensors with a ray that begins inside something: it hits nothing.

        Args:
            ranges: (n_sensors,) the readings [m].
            robot: of ``ROBOT``.
            boxes: as above.
            discs: as above, and the other robots.
            polygons: as above.
            grid: as ``Scene.grid``.
        """
        pose = robot["x_m"], robot["y_m"], robot["heading_rad"]
        _blind_inside_things(ranges, self.table, *pose, boxes, discs, polygons, *grid)


@lru_cache(maxsize=64)  # rings on robots: the cells of a study share them, and nobody writes into a table
def _table(mounts: tuple[Mount, ...], radius_m: float) -> tuple[NDArray[np.void], float, float, bool]:
    """Return ``table``, ``reach_m``, ``exposed_m`` and ``cross_hull`` of ``Rays``."""
    rays: list[tuple[float, ...]] = []
    reach, exposed, cross_hull = 0.0, 0.0, False
    for sensor, mount in enumerate(mounts):
        half, count, limit = mount.cone_half_angle_rad or 0.0, mount.rays or 1, mount.max_range_m or 0.0
        for turn in np.linspace(-half, half, count).tolist() if count > 1 else [0.0]:
            cosine, sine = math.cos(mount.heading_rad + turn), math.sin(mount.heading_rad + turn)
            back = _back_into_hull(mount.x_m, mount.y_m, cosine, sine, radius_m)
            away = math.hypot(mount.x_m, mount.y_m)
            if back == 0.0 and away > radius_m:
                exposed = max(exposed, away)
                aside = abs(mount.x_m * sine - mount.y_m * cosine)
                cross_hull |= aside <= (1.0 + HAIR_RADII) * radius_m
            reach = max(reach, away, math.hypot(mount.x_m + limit * cosine, mount.y_m + limit * sine))
            begin = (mount.x_m - back * cosine, mount.y_m - back * sine)
            end = (mount.x_m + limit * cosine, mount.y_m + limit * sine)
            rays.append((*begin, *end, back + limit, back, sensor, count == 1, cosine, sine))
    return np.array(rays, RAY), reach - radius_m, max(exposed - radius_m, 0.0), cross_hull


def _back_into_hull(x_m: float, y_m: float, cosine: float, sine: float, radius_m: float) -> float:
    """Return how far back along its ray a mount must go to lie just inside the hull [m], 0 for one inside."""
    hull = radius_m * (1.0 - 1e-6)
    if math.hypot(x_m, y_m) <= hull:
        return 0.0
    along = x_m * cosine + y_m * sine
    square = along * along - (x_m * x_m + y_m * y_m - hull * hull)
    if square <= 0.0 or along <= 0.0:
        return 0.0  # this line misses the hull behind the mount
    return along - math.sqrt(square)


@compiled
def _read(deciding: IntArray, rays: NDArray[np.void], shares: FloatArray, readings: FloatArray) -> None:
    """Lower the readings, (n_robots, n_sensors) [m], to what the rays hit."""
    first = readings.shape[0] + 1
    for i in range(readings.shape[0]):
        for k in range(deciding[i], deciding[i + 1]):
            ray = rays[deciding[k]]
            if shares[k - first] < 1.0:
                reading = max(shares[k - first] * ray.length_m - ray.offset_m, 0.0)
                readings[i, ray.sensor] = min(readings[i, ray.sensor], reading)


@compiled
def _deciding(
    robots: NDArray[np.void],
    radius_m: float,
    reach_m: float,
    rays: NDArray[np.void],
    boxes: FloatArray,
    discs: FloatArray,
    polygons: FloatArray,
    asked: IntArray,
) -> int:
    """Write where each robot's numbers begin and where the last one's end, n + 1 places, then these; return the end."""
    robots, rays, boxes, discs, polygons = borrowed((robots, rays, boxes, discs, polygons))
    hair = HAIR_RADII * radius_m
    least = np.empty(rays.shape[0])  # what each ray may read at least
    most = np.empty(rays.shape[0])  # what each sensor reads at most, by its number; no more sensors than rays
    near_boxes = np.empty(boxes.shape[0], np.int64)
    near_circles = np.empty((discs.shape[0] + polygons.shape[0] + robots.shape[0], 4))
    count: int = robots.shape[0] + 1
    for index in range(robots.shape[0]):
        asked[index] = count
        if not robots[index].running or robots[index].clearance_m > reach_m:
            continue
        x, y, heading = robots[index].x_m, robots[index].y_m, robots[index].heading_rad
        cosine, sine = math.cos(heading), math.sin(heading)
        n_boxes = _boxes_within(x, y, reach_m + radius_m, boxes, near_boxes)
        n_circles = _circles_within(x, y, reach_m + radius_m, robots, index, radius_m, discs, polygons, near_circles)
        most[:] = math.inf
        for k in range(rays.shape[0]):
            ray = rays[k]
            ax = x + cosine * ray.begin_x_m - sine * ray.begin_y_m
            ay = y + sine * ray.begin_x_m + cosine * ray.begin_y_m
            ux = cosine * (ray.end_x_m - ray.begin_x_m) - sine * (ray.end_y_m - ray.begin_y_m)
            uy = sine * (ray.end_x_m - ray.begin_x_m) + cosine * (ray.end_y_m - ray.begin_y_m)
            first, last = math.inf, math.inf
            for i in range(n_boxes):
                enough = -1.0 if ray.is_only_one else last  # a sensor's only ray decides whatever it reads at most
                low, high = _enters_box(ax, ay, ux, uy, boxes, near_boxes[i], hair, enough)
                first, last = min(first, low), min(last, high)
            for i in range(n_circles):  # number by number: to pass a row takes longer than what is done with it
                cx, cy, radius, is_disc = near_circles[i, 0], near_circles[i, 1], near_circles[i, 2], near_circles[i, 3]
                enough = -1.0 if ray.is_only_one else last
                low, high = _enters_circle(ax, ay, ux, uy, cx, cy, radius, is_disc == 1.0, hair, enough)
                first, last = min(first, low), min(last, high)
            least[k] = max(first * ray.length_m - ray.offset_m, 0.0)
            most[ray.sensor] = min(most[ray.sensor], max(last * ray.length_m - ray.offset_m, 0.0))
        for k in range(rays.shape[0]):
            if least[k] < math.inf and least[k] <= most[rays[k].sensor]:
                asked[count] = k
                count += 1
    asked[robots.shape[0]] = count
    return count


@compiled
def _boxes_within(x: float, y: float, far_m: float, boxes: FloatArray, found: IntArray) -> int:
    """Write the numbers of the boxes that come this near to a point, and return how many do."""
    count = 0
    for i in range(boxes.shape[0]):
        if box_gap(x, y, boxes, i)[0] <= far_m:
            found[count] = i
            count += 1
    return count


@compiled
def _circles_within(
    x: float,
    y: float,
    far_m: float,
    robots: NDArray[np.void],
    index: int,
    radius_m: float,
    discs: FloatArray,
    polygons: FloatArray,
    found: FloatArray,
) -> int:
    """Write what is round and comes this near to a robot's centre, and return how many do.

    A row holds x, y, radius [m], and 1, or 0 for the circle around a polygon, which does not say where that is hit.
    """
    count = 0
    for i in range(discs.shape[0]):
        if math.hypot(discs[i, 0] - x, discs[i, 1] - y) - discs[i, 2] <= far_m:
            found[count] = discs[i, 0], discs[i, 1], discs[i, 2], 1.0
            count += 1
    for i in range(polygons.shape[0]):
        if math.hypot(polygons[i, 0] - x, polygons[i, 1] - y) - polygons[i, 2] <= far_m:
            found[count] = polygons[i, 0], polygons[i, 1], polygons[i, 2], 0.0
            count += 1
    for i in range(robots.shape[0]):
        if i != index and math.hypot(robots[i].x_m - x, robots[i].y_m - y) - radius_m <= far_m:
            found[count] = robots[i].x_m, robots[i].y_m, radius_m, 1.0
            count += 1
    return count


@compiled
def _enters_circle(
    ax: float,
    ay: float,
    ux: float,
    uy: float,
    x: float,
    y: float,
    radius: float,
    is_disc: bool,
    hair: float,
    enough: float,
) -> tuple[float, float]:
    """Return the least and the largest share of the ray from a to a + u at which a circle may be hit, or infinity.

    The least is that of a circle larger by a hair, the largest that of one smaller by a hair; it is infinite where the
    circle may be passed, or a may lie in it, since a ray does not hit what it begins in. Where even the least is not
    below ``enough``, the largest is not sought, and infinite.
    """
    dx, dy = x - ax, y - ay
    outer, inner = radius + hair, radius - hair
    if dx * dx + dy * dy <= outer * outer:
        return 0.0, math.inf
    along, across, length2 = dx * ux + dy * uy, dx * uy - dy * ux, ux * ux + uy * uy
    outside2 = outer * outer * length2 - across * across
    if along <= 0.0 or outside2 < 0.0:
        return math.inf, math.inf
    low = (along - math.sqrt(outside2)) / length2
    if low > 1.0:
        return math.inf, math.inf
    inside2 = inner * inner * length2 - across * across
    if low >= enough or not is_disc or inner <= 0.0 or inside2 <= 0.0:
        return low, math.inf
    high = (along - math.sqrt(inside2)) / length2
    return low, high if high < 1.0 else math.inf


@compiled
def _enters_box(
    ax: float, ay: float, ux: float, uy: float, boxes: FloatArray, box: int, hair: float, enough: float
) -> tuple[float, float]:
    """Return the least and the largest share of the ray from a to a + u at which a box may be hit, as for a circle."""
    low = _enters_sides(ax, ay, ux, uy, boxes, box, hair)
    if low == 0.0 or low >= enough:
        return low, math.inf
    high = _enters_sides(ax, ay, ux, uy, boxes, box, -hair)
    return low, high if high < 1.0 else math.inf


@compiled
def _enters_sides(ax: float, ay: float, ux: float, uy: float, boxes: FloatArray, box: int, hair: float) -> float:
    """Return what share of the ray is free before a box larger by a hair, 0 from inside, or infinity without a hit."""
    dx, dy = ax - boxes[box, 0], ay - boxes[box, 1]
    cosine, sine = boxes[box, 4], boxes[box, 5]
    low, high = 0.0, 1.0
    for axis in range(2):
        place = cosine * dx + sine * dy if axis == 0 else cosine * dy - sine * dx
        step = cosine * ux + sine * uy if axis == 0 else cosine * uy - sine * ux
        half = boxes[box, 2 + axis] + hair
        if half <= 0.0:
            return math.inf
        if step == 0.0:
            if abs(place) > half:
                return math.inf
            continue
        first, second = (-half - place) / step, (half - place) / step
        low, high = max(low, min(first, second)), min(high, max(first, second))
    return low if low <= high else math.inf


@compiled
def _blind_inside_things(
    ranges: FloatArray,
    rays: NDArray[np.void],
    x_m: float,
    y_m: float,
    heading_rad: float,
    boxes: FloatArray,
    discs: FloatArray,
    polygons: FloatArray,
    free: FreeArray,
    place: FloatArray,
) -> None:
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    for k in range(rays.shape[0]):
        px = x_m + cosine * rays[k].begin_x_m - sine * rays[k].begin_y_m
        py = y_m + sine * rays[k].begin_x_m + cosine * rays[k].begin_y_m
        nearest = min(distance_to_nearest(px, py, boxes, discs, polygons), nearest_cell(px, py, free, place))
        if nearest <= 0.0:
            ranges[rays[k].sensor] = 0.0
