"""What a controller may know: a ring of range sensors, odometry, a tracker of discs."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Annotated, Any

from pydantic import Field
from pydantic.dataclasses import dataclass

from navbench.contract import RangeSensor
from navbench.validation import (
    STRICT,
    Count,
    DescriptionError,
    NonNegative,
    Number,
    Positive,
    Probability,
    describe,
)

RAYS_MAX = 10_000  # of a suite: more are a slip


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Mount:
    """One range sensor: where it sits on the robot, and what differs from the ring's common values.

    Attributes:
        role: the sensor's name, which a controller may ask for.
        x_m: forward of the robot's centre [m].
        y_m: left of the robot's centre [m].
        heading_rad: where it looks [rad].
        min_range_m: smallest reading [m]; None: the ring's.
        max_range_m: largest reading [m]; None: the ring's.
        cone_half_angle_rad: half the opening of its cone [rad]; None: the ring's.
        rays: rays spread evenly over the cone; None: the ring's.
    """

    role: str
    x_m: Number
    y_m: Number
    heading_rad: Number
    min_range_m: NonNegative | None = None
    max_range_m: Positive | None = None
    cone_half_angle_rad: NonNegative | None = None
    rays: Count | None = None


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Ring:
    """Range sensors at even steps, instead of a list of mounts: a ring on the rim, or a lidar, whose rays meet in it.

    Attributes:
        count: how many; their roles are ray_0, ray_1, ..., from the right to the left.
        fov_deg: the angle between the first and the last one [degrees]; of 360 ray_0 looks back, and the last one
            stands a step before it.
        radius_m: how far from ``x_m`` and ``y_m`` they stand, in the direction in which they look [m]; 0: a lidar.
        heading_deg: where the middle of the field lies, positive to the left [degrees].
        x_m: forward of the robot's centre [m].
        y_m: left of the robot's centre [m].
    """

    count: Annotated[Count, Field(le=RAYS_MAX)]
    fov_deg: Annotated[Positive, Field(le=360.0)]
    radius_m: NonNegative
    heading_deg: Number = 0.0
    x_m: Number = 0.0
    y_m: Number = 0.0

    def mounts(self) -> tuple[Mount, ...]:
        """Return the sensors, the same to the left as to the right of the middle, to the last bit."""
        middle, steps = (
            (self.count / 2, self.count) if self.fov_deg == 360.0 else ((self.count - 1) / 2, self.count - 1)
        )
        step = math.radians(self.fov_deg) / max(steps, 1)
        middle_rad = math.radians(self.heading_deg)
        headings = [math.remainder((i - middle) * step + middle_rad, math.tau) for i in range(self.count)]
        return tuple(
            Mount(
                role=f"ray_{i}",
                x_m=self.x_m + self.radius_m * math.cos(heading),
                y_m=self.y_m + self.radius_m * math.sin(heading),
                heading_rad=heading,
            )
            for i, heading in enumerate(headings)
        )


@lru_cache(maxsize=64)  # rings: each cell of a study asks for its own several times
def _completed(
    mounts: tuple[Mount, ...], min_range_m: float, max_range_m: float, cone_half_angle_rad: float, rays: int
) -> tuple[Mount, ...]:
    """Return mounts with the ring's common values filled in."""
    return tuple(
        replace(
            mount,
            min_range_m=min_range_m if mount.min_range_m is None else mount.min_range_m,
            max_range_m=max_range_m if mount.max_range_m is None else mount.max_range_m,
            cone_half_angle_rad=cone_half_angle_rad if mount.cone_half_angle_rad is None else mount.cone_half_angle_rad,
            rays=rays if mount.rays is None else mount.rays,
        )
        for mount in mounts
    )


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Odometry:
    """Errors of the pose that wheel encoders report; both are relative, so they fit a robot of any size.

    Attributes:
        travel_noise: standard deviation of each wheel's travel in one control period, relative to that travel.
        wheel_scale_std: standard deviation of each wheel's systematic scale error, drawn once an episode.
    """

    travel_noise: NonNegative = 0.0
    wheel_scale_std: NonNegative = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Tracker:
    """A sensor that reports round things (discs, movers, other robots) with position, radius and velocity.

    Attributes:
        range_m: how far it sees, from the robot's centre to the disc's surface [m].
        position_noise_std_m: standard deviation of the reported x and y [m].
    """

    range_m: Positive
    position_noise_std_m: NonNegative = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Sensors:
    """A sensor suite, drawn for a robot of one size and scaled to another one's.

    Attributes:
        drawn_for_radius_m: radius of the robot that all lengths here belong to [m].
        mounts: the ring's sensors, in the order of the readings.
        min_range_m: smallest reading [m].
        max_range_m: largest reading, also what an empty cone reads [m].
        cone_half_angle_rad: half the opening of a sensor's cone [rad].
        rays: rays spread evenly over a cone; the reading is the nearest hit. One ray looks straight ahead.
        noise_std_m: standard deviation of the Gaussian error of a reading that sees something [m].
        dropout_probability: probability that a reading is lost and reads as nothing seen.
        odometry: errors of the reported pose.
        tracker: a tracker of discs, or None.
    """

    drawn_for_radius_m: Positive
    mounts: tuple[Mount, ...] = ()
    min_range_m: NonNegative = 0.0
    max_range_m: Positive
    cone_half_angle_rad: Annotated[NonNegative, Field(lt=3.15)] = 0.0
    rays: Count = 1
    noise_std_m: NonNegative = 0.0
    dropout_probability: Probability = 0.0
    odometry: Odometry = Odometry()
    tracker: Tracker | None = None

    def __post_init__(self) -> None:
        """Check what no single value shows."""
        for i, mount in enumerate(self.complete_mounts()):
            if mount.min_range_m >= mount.max_range_m:  # type: ignore[operator]
                raise DescriptionError(
                    f"mounts[{i}] ({mount.role}): min_range_m={mount.min_range_m} must be below "
                    f"max_range_m={mount.max_range_m}"
                )
        roles = [mount.role for mount in self.mounts]
        twice = sorted({role for role in roles if roles.count(role) > 1})
        if twice:
            raise DescriptionError(f"mounts: each role must stand once, but {', '.join(twice)} is repeated")
        rays = sum(mount.rays or 0 for mount in self.complete_mounts())
        if rays > RAYS_MAX:
            raise DescriptionError(f"rays: the suite casts {rays} rays at once; at most {RAYS_MAX} are allowed")

    def complete_mounts(self) -> tuple[Mount, ...]:
        """Return the mounts with the ring's common values filled in."""
        return _completed(self.mounts, self.min_range_m, self.max_range_m, self.cone_half_angle_rad, self.rays)

    def scaled_to(self, radius_m: float) -> "Sensors":
        """Return the suite for a robot of another radius [m]: every length grows with it, no angle does."""
        factor = radius_m / self.drawn_for_radius_m
        if factor == 1.0:
            return self
        tracker = self.tracker
        return replace(
            self,
            drawn_for_radius_m=radius_m,
            mounts=tuple(
                replace(
                    mount,
                    x_m=mount.x_m * factor,
                    y_m=mount.y_m * factor,
                    min_range_m=None if mount.min_range_m is None else mount.min_range_m * factor,
                    max_range_m=None if mount.max_range_m is None else mount.max_range_m * factor,
                )
                for mount in self.mounts
            ),
            min_range_m=self.min_range_m * factor,
            max_range_m=self.max_range_m * factor,
            noise_std_m=self.noise_std_m * factor,
            tracker=None
            if tracker is None
            else Tracker(range_m=tracker.range_m * factor, position_noise_std_m=tracker.position_noise_std_m * factor),
        )

    def range_sensors(self, length: float = 1.0) -> tuple[RangeSensor, ...]:
        """Return the ring as a controller sees it, all lengths divided by ``length``."""
        return tuple(
            RangeSensor(
                mount.role,
                mount.x_m / length,
                mount.y_m / length,
                mount.heading_rad,
                (mount.min_range_m or 0.0) / length,
                (mount.max_range_m or 0.0) / length,
            )
            for mount in self.complete_mounts()
        )


def suite_of(values: Mapping[str, Any]) -> Sensors:
    """Return a suite from its plain values, in which ``ring`` may stand for the mounts.

    Raises:
        DescriptionError: one line that names the key, its value and what is allowed.
    """
    ring, values = values.get("ring"), {key: value for key, value in values.items() if key != "ring"}
    if ring is None:
        return describe(Sensors, values, "sensors")
    if not isinstance(ring, Mapping):
        raise DescriptionError(f"sensors.ring={ring!r}: must be a mapping")
    if values.get("mounts"):
        raise DescriptionError("sensors.mounts: must be empty, because sensors.ring places all range sensors")
    return describe(Sensors, {**values, "mounts": describe(Ring, ring, "sensors.ring").mounts()}, "sensors")
