import math

import numpy as np
import pytest

from navbench.mathematics.geometry import box_gap, distance_to_nearest, segment_crossing, wrap_angle

NO_POLYGONS = np.empty((0, 5))


def distance_to_edge(p: complex, a: complex, b: complex) -> float:
    """Return the distance from a point to a segment, all as complex numbers."""
    along = ((p - a) * (b - a).conjugate()).real / abs(b - a) ** 2
    return abs(p - a - min(max(along, 0.0), 1.0) * (b - a))


def distance_to_outline(p: complex, box: tuple[float, float, float, float, float]) -> float:
    """Return the signed distance to a box from its four edges: centre x, y, half length, half width, heading."""
    x, y, length, width, heading = box
    turn = complex(math.cos(heading), math.sin(heading))
    corners = [complex(x, y) + turn * complex(a * length, b * width) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    edges = list(zip(corners, corners[1:] + corners[:1], strict=True))
    inside = all(((b - a).conjugate() * (p - a)).imag > 0.0 for a, b in edges)
    nearest = min(distance_to_edge(p, a, b) for a, b in edges)
    return -nearest if inside else nearest


def random_box(rng: np.random.Generator) -> tuple[float, float, float, float, float]:
    return (*rng.uniform(-2.0, 2.0, 2).tolist(), *(10.0 ** rng.uniform(-2.0, 0.5, 2)).tolist(), rng.uniform(-7.0, 7.0))


def as_row(box: tuple[float, float, float, float, float]) -> list[float]:
    return [*box[:4], math.cos(box[4]), math.sin(box[4])]


def test_a_wrapped_angle_points_where_the_angle_points_and_lies_in_the_half_open_turn() -> None:
    for angle in np.random.default_rng(1).uniform(-40.0, 40.0, 1000):
        wrapped = wrap_angle(angle)
        assert -math.pi < wrapped <= math.pi
        assert math.remainder(wrapped - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-13)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (math.pi, math.pi),
        (-math.pi, math.pi),
        (3.0 * math.pi, math.pi),
        (-3.0 * math.pi, math.pi),
        (2.0 * math.pi, 0.0),
        (0.75 * math.pi, 0.75 * math.pi),
        (1.25 * math.pi, -0.75 * math.pi),
    ],
)
def test_half_a_turn_wraps_to_plus_pi_whichever_way_it_is_reached(angle: float, wrapped: float) -> None:
    assert wrap_angle(angle) == pytest.approx(wrapped, abs=1e-14)


@pytest.mark.parametrize("turns", [-3, -1, 1, 3, 5])
@pytest.mark.parametrize("towards", [-math.inf, math.inf])
def test_a_hair_beside_half_a_turn_never_wraps_to_minus_pi(turns: int, towards: float) -> None:
    angle = turns * math.pi
    for _ in range(5):
        assert -math.pi < wrap_angle(angle) <= math.pi
        angle = math.nextafter(angle, towards)


def test_an_angle_within_the_turn_is_wrapped_to_the_same_bits() -> None:
    for angle in np.random.default_rng(2).uniform(-math.pi, math.pi, 200):
        assert wrap_angle(angle) == angle


def test_what_is_no_angle_is_none_when_wrapped() -> None:
    assert math.isnan(wrap_angle(math.nan))


def test_the_distance_to_a_box_is_that_to_its_nearest_edge_and_negative_inside() -> None:
    rng = np.random.default_rng(3)
    inside = 0
    for _ in range(2000):
        box = random_box(rng)
        x, y = rng.uniform(-4.0, 4.0, 2).tolist()
        expected = distance_to_outline(complex(x, y), box)
        inside += expected < 0.0
        assert box_gap(x, y, np.array([as_row(box)]), 0)[0] == pytest.approx(expected, abs=1e-12)
    assert inside > 40


def test_the_gradient_of_a_gap_is_how_the_distance_changes_and_points_away() -> None:
    rng, step = np.random.default_rng(6), 1e-6
    for _ in range(1000):
        box = random_box(rng)
        x, y = rng.uniform(-4.0, 4.0, 2).tolist()
        _, nx, ny = box_gap(x, y, np.array([as_row(box)]), 0)
        assert math.hypot(nx, ny) == pytest.approx(1.0, abs=1e-12)
        changes = [
            (distance_to_outline(complex(x, y) + turn, box) - distance_to_outline(complex(x, y) - turn, box))
            / 2.0
            / step
            for turn in (complex(step, 0.0), complex(0.0, step))
        ]
        if math.hypot(*changes) > 1.0 - 1e-6:  # not where two sides are as near as each other
            assert (nx, ny) == pytest.approx(tuple(changes), abs=1e-5)


@pytest.mark.parametrize(("x", "y", "gap"), [(2.0, 0.5, 0.0), (-2.0, -0.5, 0.0), (2.0, 1.0, 0.0), (0.0, 0.0, -1.0)])
def test_a_gap_has_a_unit_gradient_on_the_edge_at_a_corner_and_in_the_middle_too(
    x: float, y: float, gap: float
) -> None:
    got, nx, ny = box_gap(x, y, np.array([[0.0, 0.0, 2.0, 1.0, 1.0, 0.0]]), 0)
    assert got == gap
    assert math.hypot(nx, ny) == 1.0
    assert nx * x + ny * y >= 0.0


def test_the_nearest_of_boxes_and_discs_decides() -> None:
    rng = np.random.default_rng(4)
    won_by_disc = 0
    for _ in range(500):
        boxes = [random_box(rng) for _ in range(rng.integers(0, 4))]
        discs = rng.uniform(-4.0, 4.0, (rng.integers(1, 4), 3))
        discs[:, 2] = np.abs(discs[:, 2])
        x, y = rng.uniform(-4.0, 4.0, 2).tolist()
        to_boxes = [distance_to_outline(complex(x, y), box) for box in boxes]
        to_discs = [abs(complex(x - cx, y - cy)) - radius for cx, cy, radius in discs.tolist()]
        rows = np.array([as_row(box) for box in boxes]).reshape(-1, 6)
        won_by_disc += min(to_discs) <= min(to_boxes, default=math.inf)
        assert distance_to_nearest(x, y, rows, discs, NO_POLYGONS) == pytest.approx(min(to_boxes + to_discs), abs=1e-12)
    assert 100 < won_by_disc < 400


def test_nothing_is_infinitely_far() -> None:
    assert distance_to_nearest(1.0, 2.0, np.empty((0, 6)), np.empty((0, 3)), NO_POLYGONS) == math.inf


def test_a_way_crosses_a_segment_at_the_solution_of_the_two_lines() -> None:
    rng = np.random.default_rng(5)
    crossings = 0
    for _ in range(1000):
        a, b, p, q = rng.uniform(-1.0, 1.0, (4, 2))
        s, u = np.linalg.solve(np.column_stack((b - a, p - q)), p - a)
        expected = s if 0.0 <= s <= 1.0 and 0.0 <= u <= 1.0 else -1.0
        crossings += expected >= 0.0
        assert segment_crossing(a[0], a[1], b[0], b[1], np.concatenate((p, q))) == pytest.approx(expected, abs=1e-9)
    assert crossings > 100


def test_a_way_that_passes_beside_the_segments_end_does_not_cross_it() -> None:
    line = np.array([1.0, 0.0, 1.0, 2.0])
    assert segment_crossing(0.0, 1.9, 4.0, 1.9, line) == pytest.approx(0.25)
    assert segment_crossing(0.0, 2.1, 4.0, 2.1, line) == -1.0
    assert segment_crossing(0.0, -0.1, 4.0, -0.1, line) == -1.0


def test_a_way_along_or_short_of_the_segment_does_not_cross_it() -> None:
    line = np.array([1.0, 0.0, 1.0, 2.0])
    assert segment_crossing(1.0, -1.0, 1.0, 3.0, line) == -1.0
    assert segment_crossing(0.0, 1.0, 0.9, 1.0, line) == -1.0
    assert segment_crossing(0.0, 1.0, 0.0, 1.0, line) == -1.0


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_way_in_two_pieces_that_meet_on_the_segment_crosses_it_exactly_once(side: float) -> None:
    line = np.array([1.0, 0.0, 1.0, 2.0])
    before, after = 1.0 - side, 1.0 + side
    pieces = [segment_crossing(before, 1.0, 1.0, 1.0, line), segment_crossing(1.0, 1.0, after, 1.0, line)]
    assert sum(piece >= 0.0 for piece in pieces) == 1
