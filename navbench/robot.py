"""The robot: a round body on two wheels."""

from pydantic.dataclasses import dataclass

from navbench.validation import STRICT, Positive


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Robot:
    """A round two-wheeled body.

    Attributes:
        radius_m: radius of the hull [m].
        track_m: distance between the wheels [m].
        wheel_speed_max_mps: limit of each wheel's speed [m/s].
        wheel_accel_max_mps2: limit of each wheel's acceleration [m/s^2]; None: the limit of the controller's native
            robot, mapped, or none where that has none either.
    """

    radius_m: Positive
    track_m: Positive
    wheel_speed_max_mps: Positive
    wheel_accel_max_mps2: Positive | None = None
