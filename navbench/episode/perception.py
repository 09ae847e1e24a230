"""Perception: what one robot knows at one instant, with the errors of its sensors, in its controller's units."""

import math

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled
from navbench.contract import Observation, Pose
from navbench.episode.similarity import Similarity
from navbench.mathematics.geometry import wrap_angle
from navbench.mathematics.kinematics import advance_arc
from navbench.mathematics.streams import stream
from navbench.sensors import Sensors

FloatArray = NDArray[np.float64]

_NO_DISCS: FloatArray = np.empty((0, 5))
_NO_DISCS.flags.writeable = False
_NONE: FloatArray = np.empty(0)


class Perception:
    """One robot's sensors through one episode; it keeps the pose that odometry believes.

    Every kind of error has a stream of its own, so that switching one on leaves the others' draws as they were.

    Args:
        sensors: the suite, already scaled to the robot.
        similarity: from the controller's units to the world's.
        track_m: the robot's track [m].
        start: the true pose at the beginning, which odometry knows.
        goal: the goal's position [m].
        name: seed, world, episode and robot index of the streams.

    Attributes:
        drifts: whether the believed pose may differ from the true one, so that ``travel`` must be called.
    """

    def __init__(
        self,
        sensors: Sensors,
        similarity: Similarity,
        track_m: float,
        start: Pose,
        goal: tuple[float, float],
        name: tuple[int, str, int, int],
    ) -> None:
        seed, world, episode, index = name
        self._sensors, self._similarity, self._track_m, self._goal = sensors, similarity, track_m, goal
        mounts = sensors.complete_mounts()
        self._min = np.array([mount.min_range_m for mount in mounts], dtype=np.float64)
        self._max = np.array([mount.max_range_m for mount in mounts], dtype=np.float64)
        self._range_rng = stream(seed, world, episode, "range", index) if sensors.noise_std_m else None
        self._dropout_rng = stream(seed, world, episode, "dropout", index) if sensors.dropout_probability else None
        self._errs = bool(sensors.noise_std_m or sensors.dropout_probability)
        self._has_least = bool((self._min > 0.0).any())  # else no reading without errors is below it
        self._converts = not similarity.identity
        length, time = similarity
        self._to_native = np.array([1.0 / length, 1.0 / length, 1.0 / length, time / length, time / length])
        tracker = sensors.tracker
        self._tracker_rng = (
            stream(seed, world, episode, "tracker", index) if tracker and tracker.position_noise_std_m else None
        )
        self.drifts = bool(sensors.odometry.travel_noise or sensors.odometry.wheel_scale_std)
        self._believed = start
        self._believed_speed = (0.0, 0.0)
        if self.drifts:
            self._odometry_rng = stream(seed, world, episode, "odometry", index)
            self._wheel_scale = 1.0 + sensors.odometry.wheel_scale_std * self._odometry_rng.standard_normal(2)

    def travel(self, left_m: float, right_m: float, dt_s: float) -> None:
        """Count what the wheels covered in a period [m], with the encoders' errors, and move the believed pose."""
        noise = 1.0 + self._sensors.odometry.travel_noise * self._odometry_rng.standard_normal(2)
        left, right = (np.array([left_m, right_m]) * self._wheel_scale * noise).tolist()
        v, w = 0.5 * (left + right) / dt_s, (right - left) / self._track_m / dt_s
        x, y, heading = advance_arc(*self._believed, v, w, dt_s)
        self._believed, self._believed_speed = Pose(x, y, wrap_angle(heading)), (v, w)

    def observe(
        self,
        t_s: float,
        true_pose: Pose,
        true_speed: tuple[float, float],
        ranges_m: FloatArray,
        touching: bool,
        discs: FloatArray | None,
    ) -> Observation:
        """Return the native observation.

        Args:
            t_s: time in the world [s].
            true_pose: the robot's pose [m, rad].
            true_speed: its v [m/s] and w [rad/s].
            ranges_m: (n_sensors,) exact readings [m]; changed in place.
            touching: whether the robot touches something.
            discs: (n, 5) x, y, radius, vx, vy of everything round [m, m/s]; None without a tracker.
        """
        if self._errs:
            count, sensors = len(ranges_m), self._sensors
            errors = _NONE if self._range_rng is None else self._range_rng.standard_normal(count)
            chances = _NONE if self._dropout_rng is None else self._dropout_rng.random(count)
            _err(ranges_m, errors, sensors.noise_std_m, chances, sensors.dropout_probability, self._min, self._max)
        elif self._has_least:
            np.maximum(ranges_m, self._min, out=ranges_m)
        pose, (v, w) = (self._believed, self._believed_speed) if self.drifts else (true_pose, true_speed)
        seen = _NO_DISCS if discs is None else self._track(discs, true_pose, pose)
        if not self._converts:
            return Observation(t_s, pose, self._goal, v, w, ranges_m, touching, seen)
        length, time = self._similarity
        return Observation(
            t_s / time,
            Pose(pose.x_m / length, pose.y_m / length, pose.heading_rad),
            (self._goal[0] / length, self._goal[1] / length),
            v * time / length,
            w * time,
            ranges_m / length,
            touching,
            seen if discs is None else seen * self._to_native,
        )

    def _track(self, discs: FloatArray, true_pose: Pose, pose: Pose) -> FloatArray:
        """Return the discs in range, with the tracker's errors, in the frame of the believed pose."""
        tracker = self._sensors.tracker
        assert tracker is not None
        in_range = np.hypot(discs[:, 0] - true_pose.x_m, discs[:, 1] - true_pose.y_m) - discs[:, 2] <= tracker.range_m
        seen: FloatArray = discs[in_range]
        if self._tracker_rng is not None:
            errors = self._tracker_rng.standard_normal((len(discs), 2))[in_range]
            seen[:, :2] += tracker.position_noise_std_m * errors
        if self.drifts:
            turn = pose.heading_rad - true_pose.heading_rad
            cosine, sine = math.cos(turn), math.sin(turn)
            turned = np.array([[cosine, sine], [-sine, cosine]])  # rows times this matrix turn left by ``turn``
            seen[:, :2] = (seen[:, :2] - true_pose[:2]) @ turned + pose[:2]
            seen[:, 3:] = seen[:, 3:] @ turned
        return seen


@compiled
def _err(
    ranges: FloatArray,
    errors: FloatArray,
    noise_std: float,
    chances: FloatArray,
    dropout_probability: float,
    least: FloatArray,
    most: FloatArray,
) -> None:
    """Add errors to exact readings [m], in place, and keep them within what each sensor can read.

    Args:
        ranges: (n,) exact readings.
        errors: (n,) of each reading, in standard deviations, or (0,) for none.
        noise_std: the standard deviation.
        chances: (n,) in [0, 1), or (0,) for none; below ``dropout_probability`` a sensor sees nothing.
        dropout_probability: how often that is.
        least: (n,) the smallest readings.
        most: (n,) the largest readings, which stand for nothing seen: there is nothing to err about.
    """
    for i in range(ranges.shape[0]):
        if errors.shape[0] and ranges[i] < most[i]:
            ranges[i] += noise_std * errors[i]
        if chances.shape[0] and chances[i] < dropout_probability:
            ranges[i] = most[i]
        ranges[i] = max(min(ranges[i], most[i]), least[i])
