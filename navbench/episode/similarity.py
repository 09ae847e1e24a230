"""Similarity: how a controller drawn for one robot drives another one, in a world of any size.

With lambda = r / r_native and tau = (r / v_limit) / (r / v_limit)_native, the controller's lengths are multiplied by
lambda and its times by tau, so that it always lives in its paper's units. On its native robot both are exactly 1.
"""

from typing import NamedTuple

from navbench.contract import Body, Command, Setup
from navbench.robot import Robot
from navbench.sensors import Sensors

DEFAULT_PERIOD_S = 0.05  # of a controller that names no native robot: runs unscaled


class Native(NamedTuple):
    """What a controller was drawn for: its robot, and its control period [s]."""

    robot: Robot
    period_s: float


class Similarity(NamedTuple):
    """The factors between a controller's units and the world's.

    Attributes:
        length: world length of one native length (lambda).
        time: world time of one native time (tau).
    """

    length: float
    time: float

    @classmethod
    def between(cls, robot: Robot, native: Native | None) -> "Similarity":
        """Return the factors for a robot under a controller drawn for another one; 1 and 1 without a native robot."""
        if native is None:
            return cls(1.0, 1.0)
        length = robot.radius_m / native.robot.radius_m
        return cls(length, length * native.robot.wheel_speed_max_mps / robot.wheel_speed_max_mps)

    @property
    def identity(self) -> bool:
        """Whether the controller's units are the world's."""
        return self.length == 1.0 and self.time == 1.0

    def to_world(self, command: Command) -> tuple[float, float]:
        """Return a native command as (v [m/s], w [rad/s]) of the world."""
        return command[0] * self.length / self.time, command[1] / self.time


def period_s(native: Native | None, similarity: Similarity) -> float:
    """Return the control period in the world [s]."""
    return DEFAULT_PERIOD_S if native is None else native.period_s * similarity.time


def accel_max_mps2(robot: Robot, native: Native | None, similarity: Similarity) -> float | None:
    """Return the wheel-acceleration limit in force in the world [m/s^2]: the robot's, else the native one's, mapped."""
    if robot.wheel_accel_max_mps2 is not None or native is None or native.robot.wheel_accel_max_mps2 is None:
        return robot.wheel_accel_max_mps2
    return native.robot.wheel_accel_max_mps2 * similarity.length / similarity.time**2


def native_setup(robot: Robot, sensors: Sensors, native: Native | None) -> Setup:
    """Return what the controller is told: the episode's robot and sensors in its own units.

    Args:
        robot: the episode's robot.
        sensors: the suite, already scaled to that robot.
        native: what the controller was drawn for, or None.
    """
    similarity = Similarity.between(robot, native)
    length, time = similarity
    accel = accel_max_mps2(robot, native, similarity)
    body = Body(
        robot.radius_m / length,
        robot.track_m / length,
        robot.wheel_speed_max_mps / length * time,
        None if accel is None else accel / length * time**2,
    )
    period = DEFAULT_PERIOD_S if native is None else native.period_s
    return Setup(body, sensors.range_sensors(length), period)
