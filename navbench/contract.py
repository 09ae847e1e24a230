"""What a controller is given and what it returns: the contract between a method and the framework.

x is forward, y is left, angles are counter-clockwise in (-pi, pi]. Lengths are metres and times seconds of the
controller's own paper: where the episode's robot is another one, the loop converts (``navbench.episode.similarity``).
"""

from collections.abc import Mapping
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Body(NamedTuple):
    """The robot that the controller drives, in the controller's own units.

    Attributes:
        radius_m: radius of the round hull [m].
        track_m: distance between the wheels [m].
        wheel_speed_max_mps: limit of each wheel's speed [m/s].
        wheel_accel_max_mps2: limit of each wheel's acceleration [m/s^2], None for none.
    """

    radius_m: float
    track_m: float
    wheel_speed_max_mps: float
    wheel_accel_max_mps2: float | None


class RangeSensor(NamedTuple):
    """One range sensor of the ring, in the robot frame and the controller's own units.

    Attributes:
        role: what the sensor is called, such as "front_left".
        x_m: mount position, forward of the robot's centre [m].
        y_m: mount position, left of the robot's centre [m].
        heading_rad: direction in which it looks [rad].
        min_range_m: smallest reading [m]; something nearer reads as this.
        max_range_m: largest reading [m]; nothing seen reads as this.
    """

    role: str
    x_m: float
    y_m: float
    heading_rad: float
    min_range_m: float
    max_range_m: float


class Setup(NamedTuple):
    """What one episode fixes.

    Attributes:
        robot: the body.
        sensors: the ring's sensors, in the order of ``Observation.ranges_m``.
        period_s: control period [s]: the time between two calls of ``act``.
    """

    robot: Body
    sensors: tuple[RangeSensor, ...]
    period_s: float


class Pose(NamedTuple):
    """A position and a heading: x [m], y [m], heading [rad]."""

    x_m: float
    y_m: float
    heading_rad: float


class Observation(NamedTuple):
    """What a controller knows at one instant.

    Attributes:
        t_s: time since the episode began [s].
        pose: the estimated pose (odometry: it may drift) [m, m, rad].
        goal: the goal's position, in the frame of ``pose`` [m, m].
        v_mps: measured forward speed [m/s].
        w_radps: measured turning rate, positive to the left [rad/s].
        ranges_m: (n_sensors,) distance from each mount to the nearest thing in its cone [m].
        touching: whether the robot touches something.
        discs: (n_discs, 5) tracked discs as x, y, radius, vx, vy in the frame of ``pose`` [m, m/s]; empty without
            a tracker.
    """

    t_s: float
    pose: Pose
    goal: tuple[float, float]
    v_mps: float
    w_radps: float
    ranges_m: FloatArray
    touching: bool
    discs: FloatArray


class Command(NamedTuple):
    """What a controller asks for: forward speed [m/s] and turning rate, positive to the left [rad/s]."""

    v_mps: float
    w_radps: float


@runtime_checkable
class Controller(Protocol):
    """The policy of one robot: observation in, command out.

    Three further attributes are optional. ``trace``, a mapping of names to numbers, the same names at every step, is
    read after each ``act`` and kept with the trajectory; its ``heading_error_rad``, if there is one, is what the
    metric ``heading_ise`` integrates. ``sensor_roles``, a tuple of names, is the sensor layout that the controller
    needs; a run with another one is refused. ``trace_words``, a mapping of a trace's name to what its values 0, 1, ...
    are called, is what a report's page tells of an instant; an empty word is not told.
    """

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Begin an episode: forget the last one. ``rng`` is the only source of chance."""
        ...

    def act(self, observation: Observation) -> Command:
        """Return the command for the coming control period."""
        ...


def trace_of(controller: Controller) -> Mapping[str, float]:
    """Return the controller's trace of its latest act, empty for a controller that offers none."""
    trace: Mapping[str, float] = getattr(controller, "trace", {})
    return trace


def check_roles(setup: Setup, needed: tuple[str, ...]) -> None:
    """Check that the ring's sensors are those that a controller needs, in order.

    Raises:
        ValueError: they are not.
    """
    roles = tuple(sensor.role for sensor in setup.sensors)
    if roles != needed:
        raise ValueError(f"sensors are {', '.join(roles) or 'none'}; needed are {', '.join(needed)}")
