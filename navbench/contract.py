"""What a controller is given and what it returns: the contract between a method and the framework.

x is forward, y is left, angles are counter-clockwise in (-pi, pi]. Lengths are metres and times seconds of the
controller's own paper: where the episode's robot is another one, the loop converts (``navbench.episode.similarity``).
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
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


class AnyRing(NamedTuple):
    """A kind of ring that a controller needs: any that has enough rays in a field of view, spread over it.

    Attributes:
        rays: how many rays at least, each of a sensor of its own, look into the field.
        fov_deg: the field, half of it to either side of straight ahead [degrees]. Two neighbouring rays lie at most
            twice ``fov_deg / rays`` apart, and the outermost ones at most that from the edges.
    """

    rays: int
    fov_deg: float

    def __str__(self) -> str:
        """Return it in words."""
        return f"any ring of at least {self.rays} rays over {self.fov_deg:g} degrees"

    def lack(self, sensors: Sequence[RangeSensor]) -> str:
        """Return what a suite lacks to be of this kind, empty where it lacks nothing."""
        half, step = 0.5 * self.fov_deg, self.fov_deg / self.rays
        around = (math.degrees(math.remainder(sensor.heading_rad, math.tau)) for sensor in sensors)
        inside = sorted(heading for heading in around if abs(heading) <= half + _HAIR_DEG)
        if len(inside) < self.rays:
            return f"this suite has {len(inside)} there"
        low, high = max(pairwise([-half - step, *inside, half + step]), key=lambda gap: gap[1] - gap[0])
        if high - low <= 2.0 * step + _HAIR_DEG:
            return ""
        return f"this suite sees nothing between {max(low, -half):.0f} and {min(high, half):.0f} degrees"


_HAIR_DEG = 1e-6  # by which a heading in radians may miss the edge


@runtime_checkable
class Controller(Protocol):
    """The policy of one robot: observation in, command out.

    Five further attributes are optional. ``trace``, a mapping of names to numbers, the same names at every step, is
    read after each ``act`` and kept with the trajectory; its ``heading_error_rad``, if there is one, is what the
    metric ``heading_ise`` integrates. ``sensor_roles``, a tuple of names, is the sensor layout that the controller
    needs, and ``sensor_kind``, an ``AnyRing`` or what has the same ``lack``, a kind of layout; a run with another one
    is refused. ``digest``, a word, tells what was read from a file, so that results know it from another file.
    ``trace_words``, a mapping of a trace's name to what its values 0, 1, ... are called, is what a report's page tells
    of an instant; an empty word is not told.
    """

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Begin an episode: forget the last one. ``rng`` is the only source of randomness."""
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
