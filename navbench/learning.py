"""What a learned policy is shown and what it answers: plain vectors, the same where it learns and where it is measured.

An observation is (n_sensors + 4,) of float32: the readings as shares of the ring's largest range; the goal's x and y
in the frame of the believed pose, in largest ranges; the measured speed and turning rate as shares of the largest
ones. The largest speed is the wheels' limit, the largest turning rate twice that over the track. An action is (2,) in
[-1, 1]: speed and turning rate as shares of the largest ones; each wheel is clipped.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navbench.contract import Setup

BESIDE = 4  # numbers after the ranges


class Scales(NamedTuple):
    """Of what observations and actions are shares.

    Attributes:
        range_m: the largest range; without a ring the robot's radius [m].
        v_mps: the largest speed [m/s].
        w_radps: the largest turning rate [rad/s].
    """

    range_m: float
    v_mps: float
    w_radps: float

    @classmethod
    def of(cls, setup: Setup) -> "Scales":
        """Return those of a setup, in its units."""
        body = setup.robot
        largest_m = max([sensor.max_range_m for sensor in setup.sensors], default=body.radius_m)
        return cls(largest_m, body.wheel_speed_max_mps, 2.0 / body.track_m * body.wheel_speed_max_mps)

    def observed(
        self, ranges_m: ArrayLike, pose: tuple[Any, Any, Any], goal: tuple[Any, Any], speed: tuple[Any, Any]
    ) -> NDArray[np.float32]:
        """Return observations.

        Args:
            ranges_m: (..., n_sensors) readings [m].
            pose: x, y [m] and heading [rad], (...) each.
            goal: x and y [m].
            speed: v [m/s] and w [rad/s].
        """
        readings = np.asarray(ranges_m)
        dx, dy = goal[0] - pose[0], goal[1] - pose[1]
        cosine, sine = np.cos(pose[2]) / self.range_m, np.sin(pose[2]) / self.range_m
        seen = np.empty((*readings.shape[:-1], readings.shape[-1] + BESIDE), np.float32)
        np.divide(readings, self.range_m, out=seen[..., :-BESIDE], casting="same_kind")
        seen[..., -4], seen[..., -3] = cosine * dx + sine * dy, cosine * dy - sine * dx
        seen[..., -2], seen[..., -1] = speed[0] / self.v_mps, speed[1] / self.w_radps
        return seen
