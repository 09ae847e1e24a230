import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import a_ring, a_robot, a_world, always, run_one

from navbench.contract import Observation, Pose
from navbench.episode.perception import Perception, Senses
from navbench.episode.similarity import Similarity
from navbench.mathematics.kinematics import advance_arc
from navbench.mathematics.streams import stream
from navbench.sensors import Mount, Odometry, Sensors, Tracker
from navbench.world.shapes import Disc

FloatArray = NDArray[np.float64]

NATIVE = Similarity(1.0, 1.0)
START = Pose(1.0, 2.0, 0.5)
GOAL = (7.0, -3.0)
NO_DISCS: FloatArray = np.empty((0, 5))
EVERY_ERROR: dict[str, Any] = {
    "noise_std_m": 0.1,
    "dropout_probability": 0.2,
    "odometry": Odometry(travel_noise=0.1, wheel_scale_std=0.05),
    "tracker": Tracker(range_m=50.0, position_noise_std_m=0.2),
}


def a_perception(
    sensors: Sensors, episode: int = 0, index: int = 0, seed: int = 0, similarity: Similarity = NATIVE
) -> Perception:
    return Perception(Senses.of(sensors, similarity, 1.5), START, GOAL, (seed, "scene", episode, index))


def observe(
    perception: Perception, ranges: Any, t_s: float = 0.0, pose: Pose = START, discs: FloatArray | None = None
) -> Observation:
    return perception.observe(t_s, pose, (0.4, 0.1), np.array(ranges, dtype=np.float64), False, discs)


def test_without_errors_a_robot_knows_the_truth() -> None:
    perception = a_perception(a_ring(3, 1.0, 9.0))
    discs = np.array([[3.0, 2.0, 0.5, 0.1, -0.2]])
    exact = np.array([1.0, 2.0, 9.0])
    seen = perception.observe(1.5, Pose(4.0, 5.0, -1.0), (0.4, 0.1), exact.copy(), True, None)
    assert seen[:5] == (1.5, Pose(4.0, 5.0, -1.0), GOAL, 0.4, 0.1)
    assert seen.ranges_m.tolist() == exact.tolist()
    assert seen.touching
    assert seen.discs.shape == (0, 5)
    tracking = a_perception(a_ring(3, 1.0, 9.0, tracker=Tracker(range_m=5.0)))
    assert observe(tracking, exact, discs=discs).discs.tolist() == discs.tolist()


def test_readings_lie_between_each_mounts_least_and_largest_range() -> None:
    mounts = (
        Mount(role="a", x_m=0.0, y_m=0.0, heading_rad=0.0),
        Mount(role="b", x_m=0.0, y_m=0.0, heading_rad=0.0, min_range_m=0.5),
        Mount(role="c", x_m=0.0, y_m=0.0, heading_rad=0.0, max_range_m=1.0),
    )
    sensors = Sensors(drawn_for_radius_m=1.0, mounts=mounts, min_range_m=0.1, max_range_m=2.0)
    assert observe(a_perception(sensors), [0.0, 0.0, 0.0]).ranges_m.tolist() == [0.1, 0.5, 0.1]
    assert observe(a_perception(sensors), [0.3, 0.6, 0.3]).ranges_m.tolist() == [0.3, 0.6, 0.3]
    noisy = a_perception(replace(sensors, noise_std_m=5.0))
    readings = np.array([observe(noisy, [1.0, 1.0, 0.5]).ranges_m for _ in range(100)])
    assert readings.min(axis=0).tolist() == [0.1, 0.5, 0.1]
    assert readings.max(axis=0).tolist() == [2.0, 2.0, 1.0]


def test_a_thing_between_hull_and_mount_reads_the_least_range() -> None:
    mount = Mount(role="boom", x_m=1.5, y_m=0.0, heading_rad=0.0)
    sensors = Sensors(drawn_for_radius_m=1.0, mounts=(mount,), min_range_m=0.2, max_range_m=5.0)
    controller = always(0.0)
    world = a_world(discs=(Disc(x_m=1.2, y_m=0.0, radius_m=0.1),), time_limit_s=0.1)
    run_one(world, controller, robot=a_robot(), sensors=sensors)
    assert controller.seen[0].ranges_m.tolist() == [0.2]


@pytest.mark.parametrize("reach_m", [2.9, 7.7, 8.0, 13.1])
def test_where_nothing_is_seen_every_reading_is_exactly_the_largest_that_the_setup_names(reach_m: float) -> None:
    controller = always(0.5)
    world = a_world(discs=(Disc(x_m=-2.3, y_m=0.0, radius_m=1.0),), time_limit_s=1.0)
    mounts = tuple(mount for mount in a_ring(9, 1.0, reach_m, 1.1).mounts if abs(mount.heading_rad) < 1.5)
    sensors = Sensors(drawn_for_radius_m=1.0, mounts=mounts, max_range_m=reach_m)
    run_one(world, controller, sensors=sensors)
    assert controller.setup is not None
    for seen in controller.seen:
        assert seen.ranges_m.tolist() == [sensor.max_range_m for sensor in controller.setup.sensors]


# --- noise and drop-out ---


def test_range_noise_has_the_stated_spread_and_no_bias_and_is_white() -> None:
    perception = a_perception(a_ring(200, 1.0, 100.0, noise_std_m=0.03))
    errors = np.array([observe(perception, np.full(200, 50.0)).ranges_m - 50.0 for _ in range(300)])
    n = errors.size
    assert errors.std() == pytest.approx(0.03, rel=5.0 / math.sqrt(2.0 * n))
    assert abs(errors.mean()) < 5.0 * 0.03 / math.sqrt(n)
    assert abs(float((errors[1:] * errors[:-1]).mean())) < 5.0 * 0.03**2 / math.sqrt(n)
    assert abs(float((errors[:, 1:] * errors[:, :-1]).mean())) < 5.0 * 0.03**2 / math.sqrt(n)


def test_range_noise_is_gaussian() -> None:
    perception = a_perception(a_ring(200, 1.0, 100.0, noise_std_m=1.0))
    errors = np.array([observe(perception, np.full(200, 50.0)).ranges_m - 50.0 for _ in range(300)]).ravel()
    for width, share in ((1.0, 0.682689), (2.0, 0.954500), (3.0, 0.997300)):
        spread = 5.0 * math.sqrt(share * (1.0 - share) / errors.size)
        assert float((np.abs(errors) < width).mean()) == pytest.approx(share, abs=spread)


def test_where_nothing_is_seen_there_is_nothing_to_err_about() -> None:
    perception = a_perception(a_ring(200, 1.0, 8.0, noise_std_m=1.0))
    readings = observe(perception, np.array([8.0, 6.0] * 100)).ranges_m
    assert set(readings[::2].tolist()) == {8.0}
    assert (readings[1::2] != 6.0).all()


def test_drop_out_happens_as_often_as_stated_and_reads_as_nothing_seen() -> None:
    perception = a_perception(a_ring(200, 1.0, 8.0, dropout_probability=0.07))
    readings = np.array([observe(perception, np.full(200, 3.0)).ranges_m for _ in range(200)])
    assert set(readings.ravel().tolist()) == {3.0, 8.0}
    assert float((readings == 8.0).mean()) == pytest.approx(0.07, abs=5.0 * math.sqrt(0.07 * 0.93 / readings.size))


def test_a_sensor_that_always_drops_out_sees_nothing_even_with_noise() -> None:
    perception = a_perception(a_ring(5, 1.0, 8.0, dropout_probability=1.0, noise_std_m=1.0))
    assert observe(perception, np.full(5, 3.0)).ranges_m.tolist() == [8.0] * 5


# --- odometry ---

TRAVEL = (0.30, 0.36)  # of the left and the right wheel in one period [m]


def believed_after(odometry: Odometry, episode: int, periods: int = 1) -> Observation:
    perception = a_perception(a_ring(1, 1.0, 8.0, odometry=odometry), episode)
    for _ in range(periods):
        perception.travel(*TRAVEL, 0.1)
    return observe(perception, [1.0])


def wheels_of(seen: Observation, periods: int = 1) -> tuple[float, float]:
    """Return what each wheel is believed to have covered in the latest period [m]."""
    turn = 0.5 * seen.w_radps * 1.5
    return (seen.v_mps - turn) * 0.1, (seen.v_mps + turn) * 0.1


def test_travel_noise_errs_each_wheel_in_proportion_and_independently() -> None:
    wheels = np.array([wheels_of(believed_after(Odometry(travel_noise=0.04), episode)) for episode in range(4000)])
    relative = wheels / TRAVEL - 1.0
    assert relative.std(axis=0) == pytest.approx([0.04, 0.04], rel=5.0 / math.sqrt(2.0 * 4000))
    assert np.abs(relative.mean(axis=0)).max() < 5.0 * 0.04 / math.sqrt(4000)
    assert abs(float(np.corrcoef(relative[:, 0], relative[:, 1]).min())) < 5.0 / math.sqrt(4000)


def test_travel_noise_is_drawn_anew_each_period_and_the_wheels_scale_once_an_episode() -> None:
    def relative(odometry: Odometry, periods: int) -> FloatArray:
        return np.array(
            [[wheels_of(believed_after(odometry, e, k))[0] / TRAVEL[0] for k in (1, periods)] for e in range(1500)]
        )

    noise, scale = relative(Odometry(travel_noise=0.04), 2), relative(Odometry(wheel_scale_std=0.04), 2)
    assert abs(float(np.corrcoef(noise[:, 0], noise[:, 1]).min())) < 5.0 / math.sqrt(1500)
    assert scale[:, 0] == pytest.approx(scale[:, 1], rel=1e-9)
    assert scale[:, 0].std() == pytest.approx(0.04, rel=5.0 / math.sqrt(2.0 * 1500))
    assert abs(scale[:, 0].mean() - 1.0) < 5.0 * 0.04 / math.sqrt(1500)


def test_the_believed_heading_spreads_as_the_wheels_errors_add_up() -> None:
    odometry, periods, n = Odometry(travel_noise=0.05), 20, 2500
    turned = np.array([believed_after(odometry, e, periods).pose.heading_rad - START.heading_rad for e in range(n)])
    expected = 0.05 * math.sqrt(periods * (TRAVEL[0] ** 2 + TRAVEL[1] ** 2)) / 1.5
    assert turned.mean() == pytest.approx(periods * (TRAVEL[1] - TRAVEL[0]) / 1.5, abs=5.0 * expected / math.sqrt(n))
    assert turned.std() == pytest.approx(expected, rel=5.0 / math.sqrt(2.0 * n))


def test_the_believed_pose_is_the_arc_of_the_believed_wheels() -> None:
    seen = believed_after(Odometry(travel_noise=0.2, wheel_scale_std=0.1), 3)
    assert seen.v_mps != pytest.approx(0.5 * sum(TRAVEL) / 0.1, rel=1e-3)
    assert seen.pose == pytest.approx(advance_arc(*START, seen.v_mps, seen.w_radps, 0.1), abs=1e-12)


def test_odometry_begins_at_the_true_start_and_at_rest() -> None:
    perception = a_perception(a_ring(1, 1.0, 8.0, odometry=Odometry(travel_noise=0.5)))
    assert observe(perception, [1.0])[1:5] == (START, GOAL, 0.0, 0.0)


@pytest.mark.parametrize("speed", [0.2, 0.7])
def test_drift_in_the_loop_is_counted_once_a_period_from_what_the_wheels_did(speed: float) -> None:
    controller = always(speed, 0.3)
    sensors = a_ring(1, 1.0, 8.0, odometry=Odometry(wheel_scale_std=0.1))
    record = run_one(a_world(time_limit_s=3.0), controller, sensors=sensors, period_s=0.1)
    scale = 1.0 + 0.1 * stream(0, "scene", 0, "odometry", 0).standard_normal(2)
    left, right = scale * (speed + np.array([-1.0, 1.0]) * 0.5 * 0.3 * 1.5)
    for k, seen in enumerate(controller.seen):
        expected = advance_arc(0.0, 0.0, 0.0, 0.5 * (left + right), (right - left) / 1.5, 0.1 * k)
        assert seen.pose == pytest.approx(expected, abs=1e-9)
    true = advance_arc(0.0, 0.0, 0.0, speed, 0.3, 3.0)
    assert record.states[-1, 1:4] == pytest.approx(true, abs=1e-9)


def test_the_goal_keeps_its_place_in_the_drifting_frame() -> None:
    perception = a_perception(a_ring(1, 1.0, 8.0, odometry=Odometry(wheel_scale_std=0.3)))
    perception.travel(2.0, 1.0, 1.0)
    assert observe(perception, [1.0]).goal == GOAL


# --- the tracker ---


def test_the_tracker_reports_what_its_range_reaches_from_centre_to_surface() -> None:
    perception = a_perception(a_ring(1, 1.0, 8.0, tracker=Tracker(range_m=2.0)))
    x, y = START.x_m, START.y_m
    discs = np.array([[x + 2.99, y, 1.0, 0, 0], [x, y - 3.01, 1.0, 0, 0], [x, y + 2.1, 0.2, 0.3, 0.4]])
    assert observe(perception, [1.0], discs=discs).discs.tolist() == discs[[0, 2]].tolist()


def test_the_trackers_noise_moves_places_and_nothing_else() -> None:
    perception = a_perception(a_ring(1, 1.0, 8.0, tracker=Tracker(range_m=20.0, position_noise_std_m=0.05)))
    discs = np.column_stack((np.random.default_rng(1).uniform(-4.0, 4.0, (50, 2)), np.full((50, 3), 0.3)))
    seen = np.array([observe(perception, [1.0], discs=discs).discs for _ in range(400)])
    errors = seen[:, :, :2] - discs[:, :2]
    assert (seen[:, :, 2:] == 0.3).all()
    assert errors.std() == pytest.approx(0.05, rel=5.0 / math.sqrt(2.0 * errors.size))
    assert abs(errors.mean()) < 5.0 * 0.05 / math.sqrt(errors.size)


def test_tracked_discs_stand_to_the_believed_pose_as_the_real_ones_to_the_true_pose() -> None:
    sensors = a_ring(1, 1.0, 8.0, odometry=Odometry(wheel_scale_std=0.3), tracker=Tracker(range_m=99.0))
    perception = a_perception(sensors)
    perception.travel(3.0, 2.0, 1.0)
    true = Pose(-2.0, 4.0, 2.9)
    discs = np.array([[3.0, 1.0, 0.5, 0.7, -0.2], [-4.0, 4.5, 1.5, 0.0, 0.3]])
    seen = observe(perception, [1.0], pose=true, discs=discs)
    assert abs(seen.pose.heading_rad - true.heading_rad) > 0.5

    def relative(rows: FloatArray, pose: Pose) -> list[list[complex | float]]:
        turn = complex(math.cos(pose.heading_rad), -math.sin(pose.heading_rad))
        here = complex(pose.x_m, pose.y_m)
        return [[(complex(x, y) - here) * turn, r, complex(vx, vy) * turn] for x, y, r, vx, vy in rows.tolist()]

    for got, expected in zip(relative(seen.discs, seen.pose), relative(discs, true), strict=True):
        assert got == pytest.approx(expected, abs=1e-12)


# --- units ---


def test_everything_a_controller_sees_is_in_its_own_units() -> None:
    length, time = 4.0, 0.5
    sensors = a_ring(2, 1.0, 8.0, min_range_m=2.0, tracker=Tracker(range_m=99.0))
    perception = a_perception(sensors, similarity=Similarity(length, time))
    seen = perception.observe(
        3.0, Pose(4.0, 8.0, 1.2), (0.4, 0.1), np.array([1.0, 6.0]), False, np.array([[4.0, 8.0, 2.0, 0.4, -0.8]])
    )
    assert seen.t_s == pytest.approx(6.0)
    assert seen.pose == pytest.approx((1.0, 2.0, 1.2))
    assert seen.goal == pytest.approx((1.75, -0.75))
    assert (seen.v_mps, seen.w_radps) == pytest.approx((0.05, 0.05))
    assert seen.ranges_m == pytest.approx([0.5, 1.5])
    assert seen.discs == pytest.approx(np.array([[1.0, 2.0, 0.5, 0.05, -0.1]]))


# --- streams ---


def one_of_each(sensors: Sensors, seed: int = 0, episode: int = 0, index: int = 0) -> dict[str, list[float]]:
    """Return the errors of two observations by kind."""
    perception = a_perception(sensors, episode, index, seed)
    discs = np.tile([3.0, 2.0, 0.5, 0.0, 0.0], (4, 1))
    errors: dict[str, list[float]] = {"range": [], "odometry": [], "tracker": []}
    for _ in range(2):
        if perception.drifts:
            perception.travel(*TRAVEL, 0.1)
        seen = observe(perception, np.full(6, 50.0), discs=discs if sensors.tracker else None)
        errors["range"] += seen.ranges_m.tolist()
        errors["odometry"] += [seen.v_mps, seen.w_radps]
        relative = np.hypot(seen.discs[:, 0] - seen.pose.x_m, seen.discs[:, 1] - seen.pose.y_m)
        errors["tracker"] += relative.tolist()
    return errors


def test_switching_one_error_on_leaves_the_draws_of_the_others_as_they_were() -> None:
    ring = a_ring(6, 1.0, 100.0)
    everything = replace(ring, **EVERY_ERROR | {"dropout_probability": 1e-300})
    together = one_of_each(everything)
    noise = one_of_each(replace(ring, noise_std_m=0.1))
    odometry = one_of_each(replace(ring, odometry=EVERY_ERROR["odometry"]))
    tracker = one_of_each(replace(ring, tracker=EVERY_ERROR["tracker"]))
    assert noise["range"] == together["range"]
    assert odometry["odometry"] == together["odometry"]
    assert tracker["tracker"] == pytest.approx(together["tracker"], abs=1e-12)
    assert len(set(together["range"])) == 12


def test_each_error_is_drawn_from_the_stream_of_its_own_name() -> None:
    noisy, holey = a_ring(6, 1.0, 100.0, noise_std_m=0.1), a_ring(60, 1.0, 100.0, dropout_probability=0.4)
    normal = stream(3, "scene", 2, "range", 1).standard_normal(6)
    readings = observe(a_perception(noisy, 2, 1, 3), np.full(6, 50.0)).ranges_m
    assert readings == pytest.approx(50.0 + 0.1 * normal)
    lost = stream(3, "scene", 2, "dropout", 1).random(60) < 0.4
    assert (observe(a_perception(holey, 2, 1, 3), np.full(60, 50.0)).ranges_m == 100.0).tolist() == lost.tolist()
    tracking = a_ring(1, 1.0, 9.0, tracker=Tracker(range_m=9.0, position_noise_std_m=0.2))
    disc = np.array([[3.0, 2.0, 0.5, 0.0, 0.0]])
    error = observe(a_perception(tracking, 2, 1, 3), [1.0], discs=disc).discs[0, :2] - disc[0, :2]
    assert error == pytest.approx(0.2 * stream(3, "scene", 2, "tracker", 1).standard_normal(2))


def test_a_disc_out_of_range_leaves_the_noise_of_the_others_as_it_was() -> None:
    """Controllers drive different ways, past different discs, and still meet the same noise."""
    tracking = a_ring(1, 1.0, 9.0, tracker=Tracker(range_m=9.0, position_noise_std_m=0.2))
    near = np.array([[3.0, 2.0, 0.5, 0.0, 0.0], [2.0, 3.0, 0.5, 0.0, 0.0]])
    seen = []
    for x in (4.0, 400.0):
        perception = a_perception(tracking)
        discs = np.concatenate([[[x, 0.0, 1.0, 0.0, 0.0]], near])
        seen.append([observe(perception, [1.0], discs=discs).discs[-2:].tolist() for _ in range(3)])
    assert seen[0] == seen[1]


def test_dropping_readings_leaves_the_noise_of_the_kept_ones_as_it_was() -> None:
    ring = a_ring(50, 1.0, 100.0, noise_std_m=0.1)
    whole, holey = a_perception(ring), a_perception(replace(ring, dropout_probability=0.3))
    for _ in range(5):
        kept = observe(holey, np.full(50, 50.0)).ranges_m
        full = observe(whole, np.full(50, 50.0)).ranges_m
        assert 0 < (kept == 100.0).sum() < 50
        assert (kept[kept != 100.0] == full[kept != 100.0]).all()


def test_seed_episode_and_robot_each_change_every_error_and_nothing_else_does() -> None:
    sensors = replace(a_ring(6, 1.0, 100.0), **EVERY_ERROR | {"dropout_probability": 0.0})
    first = one_of_each(sensors)
    assert one_of_each(sensors) == first
    for other in ({"seed": 1}, {"episode": 1}, {"index": 1}):
        changed = one_of_each(sensors, **other)
        for kind in ("range", "odometry", "tracker"):
            assert not set(changed[kind]) & set(first[kind])


def test_streams_of_different_names_have_nothing_in_common() -> None:
    names = [
        (0, "a", 0, "range", 0),
        (1, "a", 0, "range", 0),
        (0, "b", 0, "range", 0),
        (0, "a", 1, "range", 0),
        (0, "a", 0, "start", 0),
        (0, "a", 0, "range", 1),
        (0, "ab", 0, "range", 0),
        (0, "a", 0, "brange", 0),
    ]
    draws = [tuple(stream(*name).random(4).tolist()) for name in names]
    assert len({draw for one in draws for draw in one}) == 4 * len(names)
    assert [tuple(stream(*name).random(4).tolist()) for name in names] == draws


def test_a_stream_depends_on_its_name_alone_in_whatever_process_or_year() -> None:
    raw = stream(7, "deadlock", 3, "range", 1).bit_generator.random_raw(2)
    assert np.asarray(raw).tolist() == [8105229430547311885, 4001026819637557532]
