import math
from collections.abc import Callable

import numpy as np
import pytest

from navbench.mathematics.kinematics import advance_arc, body_speed, lag_speed, ramp_speed

Motion = tuple[float, float, float, float, float]  # x, y, heading, v, w


def integrate(motion: Motion, dt_s: float, steps: int = 4000) -> tuple[float, float, float]:
    """Return the pose after dt by the fourth-order Runge-Kutta rule: for a given heading, that is Simpson's."""
    x, y, heading, v, w = motion
    h = dt_s / steps
    begins = heading + w * h * np.arange(steps)
    x += v * h / 6.0 * float((np.cos(begins) + 4.0 * np.cos(begins + 0.5 * w * h) + np.cos(begins + w * h)).sum())
    y += v * h / 6.0 * float((np.sin(begins) + 4.0 * np.sin(begins + 0.5 * w * h) + np.sin(begins + w * h)).sum())
    return x, y, heading + w * dt_s


def random_motion(rng: np.random.Generator) -> Motion:
    x, y, heading, v, w = rng.uniform(-3.0, 3.0, 5).tolist()
    return x, y, heading, v, w


def integrate_speed(rate: Callable[[float], float], speed: float, dt_s: float, steps: int) -> tuple[float, float]:
    """Return the mean and the final speed over dt by Heun's rule, for an acceleration that depends on the speed."""
    h, travel = dt_s / steps, 0.0
    for _ in range(steps):
        guess = speed + h * rate(speed)
        after = speed + 0.5 * h * (rate(speed) + rate(guess))
        travel += 0.5 * h * (speed + after)
        speed = after
    return travel / dt_s, speed


def test_wheels_turn_the_body_about_their_mean_towards_the_slower_one() -> None:
    assert body_speed(0.25, 0.75, 0.5) == (0.5, 1.0)
    assert body_speed(-1.0, 1.0, 2.0) == (0.0, 1.0)


def test_a_ten_second_arc_agrees_with_numerical_integration_to_a_millionth_of_a_millimetre() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        motion = random_motion(rng)
        assert advance_arc(*motion, 10.0) == pytest.approx(integrate(motion, 10.0), abs=1e-9)


def test_a_quarter_of_a_circle_to_the_left_ends_one_radius_ahead_and_one_to_the_left() -> None:
    pose = advance_arc(0.0, 0.0, 0.0, 2.0 * math.pi, math.pi, 0.5)
    assert pose == pytest.approx((2.0, 2.0, 0.5 * math.pi), abs=1e-12)


def test_a_full_circle_comes_back_with_its_turn_counted() -> None:
    x, y, heading = advance_arc(1.0, -2.0, 0.3, 1.5, -0.7, 2.0 * math.pi / 0.7)
    assert (x, y) == pytest.approx((1.0, -2.0), abs=1e-12)
    assert heading == pytest.approx(0.3 - 2.0 * math.pi)


@pytest.mark.parametrize("w", [0.0, 1e-14, 1.9e-10, 2.1e-10, 1e-8, 1e-6, -1e-10, -1e-8])
def test_a_vanishing_turning_rate_gives_the_straight_line(w: float) -> None:
    motion = (1.0, 2.0, 0.7, 3.0, w)
    x, y, heading = advance_arc(*motion, 10.0)
    sideways = 0.5 * 30.0 * w * 10.0  # the chord turns by half of what the heading turns
    assert x == pytest.approx(1.0 + 30.0 * math.cos(0.7) - sideways * math.sin(0.7), abs=1e-8)
    assert y == pytest.approx(2.0 + 30.0 * math.sin(0.7) + sideways * math.cos(0.7), abs=1e-8)
    assert heading == pytest.approx(0.7 + 10.0 * w, abs=1e-15)


def test_two_arcs_in_turn_are_one_arc() -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        x, y, heading, v, w = random_motion(rng)
        first, second = rng.uniform(0.0, 5.0, 2).tolist()
        halfway = advance_arc(x, y, heading, v, w, first)
        whole = advance_arc(x, y, heading, v, w, first + second)
        assert advance_arc(*halfway, v, w, second) == pytest.approx(whole, abs=1e-12)


def test_the_reversed_motion_leads_back() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        x, y, heading, v, w = random_motion(rng)
        there = advance_arc(x, y, heading, v, w, 4.0)
        assert advance_arc(*there, -v, -w, 4.0) == pytest.approx((x, y, heading), abs=1e-12)


def test_the_mirrored_motion_ends_at_the_mirrored_pose() -> None:
    rng = np.random.default_rng(4)
    for _ in range(100):
        x, y, heading, v, w = random_motion(rng)
        end_x, end_y, end_heading = advance_arc(x, y, heading, v, w, 2.0)
        assert advance_arc(x, -y, -heading, v, -w, 2.0) == pytest.approx((end_x, -end_y, -end_heading), abs=1e-14)


@pytest.mark.parametrize("dt_s", [0.05, 0.5, 2.0])
def test_the_ramps_mean_and_end_agree_with_fine_integration(dt_s: float) -> None:
    rng = np.random.default_rng(5)
    finished = 0
    for _ in range(30):
        speed, target = rng.uniform(-2.0, 2.0, 2).tolist()
        accel = 10.0 ** rng.uniform(-1.0, 2.0)
        times = (np.arange(200_000) + 0.5) * dt_s / 200_000
        speeds = speed + np.sign(target - speed) * np.minimum(accel * times, abs(target - speed))
        mean, final = ramp_speed(speed, target, accel, dt_s)
        finished += final == target
        assert mean == pytest.approx(float(speeds.mean()), abs=1e-8)
        assert final == pytest.approx(float(speeds[-1]), abs=accel * dt_s / 200_000)
    assert 0 < finished < 30


def test_without_an_acceleration_limit_the_wheel_runs_at_its_target_at_once() -> None:
    assert ramp_speed(-0.7, 1.3, math.inf, 0.1) == (1.3, 1.3)
    assert ramp_speed(1.3, 1.3, 0.5, 0.1) == (1.3, 1.3)


@pytest.mark.parametrize("dt_s", [0.01, 0.1, 1.0])
def test_the_lags_mean_and_end_agree_with_fine_integration(dt_s: float) -> None:
    rng = np.random.default_rng(6)
    for _ in range(10):
        speed, target = rng.uniform(-2.0, 2.0, 2).tolist()
        lag = rng.uniform(0.05, 0.5)

        def rate(now: float, target: float = target, lag: float = lag) -> float:
            return (target - now) / lag

        expected = integrate_speed(rate, speed, dt_s, 4000)
        assert lag_speed(speed, target, lag, dt_s) == pytest.approx(expected, abs=2e-5 * dt_s**2)


def test_a_lag_in_two_steps_is_a_lag_in_one() -> None:
    first_mean, halfway = lag_speed(-0.4, 1.1, 0.3, 0.2)
    second_mean, final = lag_speed(halfway, 1.1, 0.3, 0.5)
    mean, whole = lag_speed(-0.4, 1.1, 0.3, 0.7)
    assert final == pytest.approx(whole, abs=1e-14)
    assert 0.2 * first_mean + 0.5 * second_mean == pytest.approx(0.7 * mean, abs=1e-14)
