"""How a two-wheeled robot moves: exact arcs, and wheel ramps and lags."""

import math

from navbench.compiled import compiled

_STRAIGHT_RAD = 1e-9  # below this turn the arc is a straight line to the last digit


@compiled
def body_speed(left_mps: float, right_mps: float, track_m: float) -> tuple[float, float]:
    """Return the forward speed [m/s] and the turning rate [rad/s] of a robot whose wheels turn at these speeds."""
    return 0.5 * (left_mps + right_mps), (right_mps - left_mps) / track_m


@compiled
def advance_arc(
    x_m: float, y_m: float, heading_rad: float, v_mps: float, w_radps: float, dt_s: float
) -> tuple[float, float, float]:
    """Return the pose after dt at constant speed and turning rate: the closed-form arc of the no-slip unicycle.

    The heading is not wrapped here, so that a caller can count turns.
    """
    half = 0.5 * w_radps * dt_s
    chord = v_mps * dt_s * (math.sin(half) / half if abs(half) > _STRAIGHT_RAD else 1.0)
    return (
        x_m + chord * math.cos(heading_rad + half),
        y_m + chord * math.sin(heading_rad + half),
        heading_rad + 2.0 * half,
    )


@compiled
def ramp_speed(speed_mps: float, target_mps: float, accel_max_mps2: float, dt_s: float) -> tuple[float, float]:
    """Return a wheel's mean and final speed over dt [m/s], driven towards a target at limited acceleration."""
    change = target_mps - speed_mps
    ramp_s = abs(change) / accel_max_mps2
    if ramp_s <= dt_s:
        return target_mps - 0.5 * change * ramp_s / dt_s, target_mps
    final = speed_mps + math.copysign(accel_max_mps2 * dt_s, change)
    return 0.5 * (speed_mps + final), final


@compiled
def lag_speed(speed_mps: float, target_mps: float, lag_s: float, dt_s: float) -> tuple[float, float]:
    """Return a wheel's mean and final speed over dt [m/s] behind a first-order lag with this time constant."""
    decay = math.exp(-dt_s / lag_s)
    final = target_mps + (speed_mps - target_mps) * decay
    return target_mps + (speed_mps - target_mps) * (1.0 - decay) * lag_s / dt_s, final
