"""The baseline of every comparison: drive to the goal and look at nothing.

It is no paper's method. At a constant speed it turns towards the goal in proportion to the heading error, within a
limit, and has no sensors: what it reaches needed no avoidance, and what it hits did.
"""

import math

import numpy as np

from navbench.contract import FloatArray, Setup
from navbench.mathematics.geometry import wrap_angle
from navbench.policy import CompiledController, Policy, compiled
from navbench.validation import Positive, checked


@compiled
def heading_error(x: float, y: float, theta: float, x_goal: float, y_goal: float) -> float:
    """Return how far to turn to the left to face the goal [rad]."""
    error: float = wrap_angle(math.atan2(y_goal - y, x_goal - x) - theta)
    return error


@compiled
def step(
    state: FloatArray,
    parameters: FloatArray,
    ranges_m: FloatArray,
    discs: FloatArray,
    pose: tuple[float, float, float],
    goal: tuple[float, float],
    speed: tuple[float, float],
    trace: FloatArray,
) -> tuple[float, float]:
    """Return the constant speed and a turning rate towards the goal; a step of ``navbench.policy``."""
    speed_mps, gain_per_s, limit_radps = parameters[0], parameters[1], parameters[2]
    trace[0] = heading_error(pose[0], pose[1], pose[2], goal[0], goal[1])
    return speed_mps, min(max(gain_per_s * trace[0], -limit_radps), limit_radps)


class GoToGoal(CompiledController):
    """Constant speed, proportional heading, no sensors."""

    @checked("GoToGoal")
    def __init__(self, *, speed_mps: Positive, gain_per_s: Positive, turn_limit_radps: Positive) -> None:
        """Check the parameters.

        Args:
            speed_mps: the constant forward speed [m/s].
            gain_per_s: turning rate for each radian of heading error [1/s].
            turn_limit_radps: the largest turning rate to either side [rad/s].

        Raises:
            ValueError: a parameter is not a finite positive number.
        """
        self._parameters = np.array([speed_mps, gain_per_s, turn_limit_radps])

    def make_policy(self, setup: Setup) -> Policy:
        """Return the policy, which is the same for every robot."""
        return Policy(step=step, parameters=self._parameters, trace_names=("heading_error_rad",))
