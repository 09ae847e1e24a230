"""The floor under every comparison: drive to the goal and look at nothing.

It is no paper's method. At a constant speed it turns towards the goal in proportion to the heading error, within a
limit, and has no sensors: what it reaches needed no avoidance, and what it hits did.
"""

import math

import numpy as np
from pydantic.dataclasses import dataclass

from navbench.compiled import compiled
from navbench.contract import Command, Observation, Setup
from navbench.mathematics.geometry import wrap_angle
from navbench.validation import STRICT, Positive, describe


@compiled
def heading_error(x: float, y: float, theta: float, x_goal: float, y_goal: float) -> float:
    """Return how far to turn to the left to face the goal [rad]."""
    error: float = wrap_angle(math.atan2(y_goal - y, x_goal - x) - theta)
    return error


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Steering:
    """What it may be told.

    Attributes:
        speed_mps: the constant forward speed [m/s].
        gain_per_s: turning rate for each radian of heading error [1/s].
        turn_limit_radps: the largest turning rate to either side [rad/s].
    """

    speed_mps: Positive
    gain_per_s: Positive
    turn_limit_radps: Positive


class GoToGoal:
    """Constant speed, proportional heading, no sensors."""

    def __init__(self, *, speed_mps: float, gain_per_s: float, turn_limit_radps: float) -> None:
        """Check the parameters.

        Args:
            speed_mps: the constant forward speed [m/s].
            gain_per_s: turning rate for each radian of heading error [1/s].
            turn_limit_radps: the largest turning rate to either side [rad/s].

        Raises:
            ValueError: a parameter is not a finite positive number.
        """
        given = {"speed_mps": speed_mps, "gain_per_s": gain_per_s, "turn_limit_radps": turn_limit_radps}
        self._steering = describe(Steering, given, "GoToGoal")
        self._error_rad = 0.0

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Begin an episode: there is nothing to forget but the trace."""
        self._error_rad = 0.0

    def act(self, observation: Observation) -> Command:
        """Return the constant speed and a turning rate towards the goal."""
        pose, goal = observation.pose, observation.goal
        self._error_rad = heading_error(pose.x_m, pose.y_m, pose.heading_rad, goal[0], goal[1])
        limit = self._steering.turn_limit_radps
        return Command(self._steering.speed_mps, min(max(self._steering.gain_per_s * self._error_rad, -limit), limit))

    @property
    def trace(self) -> dict[str, float]:
        """The heading error at the latest act [rad]."""
        return {"heading_error_rad": self._error_rad}
