"""The behaviours of ``aouf2019`` as an object: their parameters, checked, and what they remember between two steps."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass

from navbench.contract import Observation, Setup
from navbench.validation import STRICT, NonNegative, Positive, Probability, describe

from .equations import BEHAVIOR, PROGRESS_DISTANCE, SENSOR_ROLES, THRESHOLDS, TRACE, step


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class BehaviorParameters:
    """What the behaviours and the arbitration may be told; ``aouf2019`` says what each does.

    Attributes:
        blend_alpha: share of the goal's direction in the blend, in [0, 1].
        sensor_weights: weight of each sensor in the sum, one for each of ``SENSOR_ROLES``.
        wall_distance_m: distance from the robot's centre at which a wall is followed [m].
        at_obstacle_m: a front reading below it is an obstacle [m].
        unsafe_m: a front reading below it begins wall following at once [m].
        stall_window_s: time over which progress is judged [s].
        stall_min_progress_m: less than this over the window is none [m].
        progress_epsilon_m: how much nearer to the goal than ever ends wall following [m].
        side_tie_m: readings that differ by less are equally near [m].
    """

    blend_alpha: Probability
    sensor_weights: Mapping[str, Positive]
    wall_distance_m: Positive
    at_obstacle_m: Positive
    unsafe_m: NonNegative
    stall_window_s: Positive
    stall_min_progress_m: NonNegative
    progress_epsilon_m: NonNegative
    side_tie_m: NonNegative

    def __post_init__(self) -> None:
        """Check what no single type shows."""
        if set(self.sensor_weights) != set(SENSOR_ROLES):
            raise ValueError(f"sensor_weights: must name exactly {', '.join(SENSOR_ROLES)}")
        if self.unsafe_m > self.at_obstacle_m:
            raise ValueError(f"unsafe_m={self.unsafe_m}: must not exceed at_obstacle_m={self.at_obstacle_m}")


class Behaviors:
    """The behaviours and what they remember between two control periods.

    Attributes:
        parameters: the checked parameters.
    """

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        """Check the parameters, given by name.

        Args:
            parameters: a value for each field of ``BehaviorParameters``.

        Raises:
            ValueError: a key is unknown or missing, or a value is of the wrong type or out of range.
        """
        self.parameters = describe(BehaviorParameters, parameters, "behaviors")
        self._weights = np.array([self.parameters.sensor_weights[role] for role in SENSOR_ROLES])
        self._thresholds = tuple(float(getattr(self.parameters, name)) for name in THRESHOLDS)

    def reset(self, setup: Setup) -> None:
        """Begin an episode.

        Raises:
            ValueError: the ring's sensors are not ``SENSOR_ROLES``, in this order.
        """
        roles = tuple(sensor.role for sensor in setup.sensors)
        if roles != SENSOR_ROLES:
            raise ValueError(f"sensors are {', '.join(roles) or 'none'}; needed are {', '.join(SENSOR_ROLES)}")
        self._mounts = np.array([(sensor.x_m, sensor.y_m, sensor.heading_rad) for sensor in setup.sensors])
        self._best_m = np.zeros(max(1, round(self.parameters.stall_window_s / setup.period_s)))
        self._memory = np.zeros(len(TRACE))
        self._memory[PROGRESS_DISTANCE] = math.inf

    def heading_error(self, observation: Observation) -> float:
        """Return the heading error of the behaviour that is active at this observation [rad]."""
        pose, goal = observation.pose, observation.goal
        error: float = step(
            self._memory,
            self._best_m,
            self._mounts,
            self._weights,
            self._thresholds,
            observation.ranges_m,
            pose.x_m,
            pose.y_m,
            pose.heading_rad,
            goal[0],
            goal[1],
        )
        return error

    @property
    def active(self) -> float:
        """The active behaviour, ``GO_TO_GOAL`` or ``FOLLOW_WALL``."""
        return float(self._memory[BEHAVIOR])

    @property
    def trace(self) -> dict[str, float]:
        """The latest step: behaviour, side, distances, and the tests that the arbitration made (1 for true)."""
        behavior, side, error, goal, progress, clearance, at_obstacle, unsafe, stalled, made, sliding, periods = (
            self._memory.tolist()
        )
        return {
            "behavior": behavior,
            "side": side,
            "heading_error_rad": error,
            "goal_distance_m": goal,
            "progress_distance_m": progress,
            "front_clearance_m": clearance,
            "at_obstacle": at_obstacle,
            "unsafe": unsafe,
            "stalled": stalled,
            "progress_made": made,
            "sliding": sliding,
            "periods_in_behavior": periods,
        }
