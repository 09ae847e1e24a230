"""Perception: what one robot knows at one instant, with the errors of its sensors, in its controller's units."""

import math
from collections.abc import Callable
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled, compiled_inline, direct
from navbench.contract import Observation, Pose
from navbench.episode.similarity import Similarity
from navbench.mathematics.geometry import wrap_angle
from navbench.mathematics.kinematics import advance_arc
from navbench.mathematics.streams import stream
from navbench.sensors import Sensors

FloatArray = NDArray[np.float64]

# What does not change in an episode, of what a robot's sensors do wrong and in which units its controller lives.
SENSING = np.dtype(
    [
        ("length", "f8"),  # world length of one native length
        ("time", "f8"),  # world time of one native time
        ("noise_std_m", "f8"),  # of ranges
        ("dropout_probability", "f8"),
        ("tracks", "i8"),  # whether there is a tracker
        ("tracker_range_m", "f8"),
        ("tracker_std_m", "f8"),
        ("drifts", "i8"),  # whether the believed pose may differ from the true one
        ("travel_noise", "f8"),
        ("track_m", "f8"),
    ]
)


def _frozen(array: FloatArray) -> FloatArray:
    """Return a copy that nobody can write to, and that leads to nothing else."""
    if array.ndim == 1 and array.size:
        return np.frombuffer(array.tobytes())  # in half the time
    return np.ndarray(array.shape, buffer=array.tobytes())


_observed = partial(tuple.__new__, Observation)  # of all its values, in a third of the time that it takes by itself
_NO_SCALE = _frozen(np.ones(2))
_NO_DISCS = _frozen(np.empty((0, 5)))


class Errors(NamedTuple):
    """The draws behind the errors of some observations, an array (n_periods, ...) a kind, without columns for none.

    Attributes:
        ranges: (n_periods, n_sensors) in standard deviations.
        dropouts: (n_periods, n_sensors) in [0, 1); below the probability a sensor sees nothing.
        places: (n_periods, n_discs, 2) of each disc's x and y, in standard deviations.
    """

    ranges: FloatArray
    dropouts: FloatArray
    places: FloatArray


_NO_ERRORS = Errors(np.empty((1, 0)), np.empty((1, 0)), np.empty((1, 0, 2)))


class Senses(NamedTuple):
    """A sensor suite on a robot under a controller, as arrays.

    Attributes:
        sensors: the suite, already scaled to the robot.
        constants: (1,) of ``SENSING``.
        least: (n_sensors,) the smallest readings [m].
        most: (n_sensors,) the largest readings [m].
        is_exact: whether without a tracker an observation is the truth in the world's units.
        errs: whether anything of it is drawn at random each period.
    """

    sensors: Sensors
    constants: NDArray[np.void]
    least: FloatArray
    most: FloatArray
    is_exact: bool
    errs: bool

    @classmethod
    def of(cls, sensors: Sensors, similarity: Similarity, track_m: float) -> "Senses":
        """Return a suite for the controller's units and the robot's track [m]."""
        tracker, odometry = sensors.tracker, sensors.odometry
        drifts = bool(odometry.travel_noise or odometry.wheel_scale_std)
        tracker_std_m = tracker.position_noise_std_m if tracker else 0.0
        constants = np.zeros(1, SENSING)
        constants[0] = (
            *similarity, sensors.noise_std_m, sensors.dropout_probability, tracker is not None,
            tracker.range_m if tracker else 0.0, tracker_std_m, drifts, odometry.travel_noise, track_m,
        )  # fmt: skip
        mounts = sensors.complete_mounts()
        least = np.array([mount.min_range_m for mount in mounts], dtype=np.float64)
        most = np.array([mount.max_range_m for mount in mounts], dtype=np.float64)
        errs = bool(sensors.noise_std_m or sensors.dropout_probability or drifts or tracker_std_m)
        return cls(sensors, constants, least, most, similarity.identity and not (errs or (least > 0.0).any()), errs)


class Perception:
    """One robot's sensors through one episode; it keeps the pose that odometry believes.

    Every kind of error has a stream of its own, so that switching one on leaves the others' draws as they were.

    Args:
        senses: what its sensors are.
        start: the true pose at the beginning, which odometry knows.
        goal: the goal's position [m].
        name: seed, world, episode and robot index of the streams.

    Attributes:
        drifts: whether the believed pose may differ from the true one, so that ``travel`` must be called.
        goal: the goal's position, native.
        wheel_scale: (2,) by what the encoders multiply the wheels' travel.
        believed: (5,) the believed x, y [m], heading [rad], v [m/s] and w [rad/s]; the true ones without drift.
    """

    def __init__(self, senses: Senses, start: Pose, goal: tuple[float, float], name: tuple[int, str, int, int]) -> None:
        seed, world, episode, index = name
        sensors, constants = senses.sensors, senses.constants[0]
        self._senses = senses
        self.drifts = bool(constants["drifts"])
        self._length, self._time = float(constants["length"]), float(constants["time"])
        self.goal = (goal[0] / self._length, goal[1] / self._length)
        self._streams: dict[str, np.random.Generator] = {}
        self.wheel_scale = _NO_SCALE
        if senses.errs:
            kinds = {
                "range": sensors.noise_std_m,
                "dropout": sensors.dropout_probability,
                "odometry": self.drifts,
                "tracker": constants["tracker_std_m"],
            }
            self._streams = {kind: stream(seed, world, episode, kind, index) for kind, errs in kinds.items() if errs}
        if self.drifts:
            errors = self._streams["odometry"].standard_normal(2)
            self.wheel_scale = _NO_SCALE + sensors.odometry.wheel_scale_std * errors
        self.believed = np.array([*start, 0.0, 0.0])

    def draw(self, periods: int, discs: int) -> Errors:
        """Draw the errors of the observations of the next control periods, with this many discs around."""
        sensors, drawn = len(self._senses.most), self._streams
        return Errors(
            drawn["range"].standard_normal((periods, sensors)) if "range" in drawn else np.empty((periods, 0)),
            drawn["dropout"].random((periods, sensors)) if "dropout" in drawn else np.empty((periods, 0)),
            drawn["tracker"].standard_normal((periods, discs, 2)) if "tracker" in drawn else np.empty((periods, 0, 2)),
        )

    def draw_travel(self, periods: int) -> FloatArray:
        """Draw the errors of the wheels' travel in the next control periods: (n_periods, 2) standard deviations."""
        return self._streams["odometry"].standard_normal((periods, 2)) if self.drifts else np.empty((periods, 0))

    def travel(self, left_m: float, right_m: float, dt_s: float) -> None:
        """Count what the wheels covered in a period [m], with the encoders' errors, and move the believed pose."""
        believe(self.believed, self.wheel_scale, left_m, right_m, dt_s, self.draw_travel(1)[0], self._senses.constants)

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
        senses = self._senses
        if senses.is_exact and discs is None:
            v, w = true_speed
            return _observed((t_s, true_pose, self.goal, v, w, _frozen(ranges_m), touching, _NO_DISCS))
        errors = self.draw(1, 0 if discs is None else len(discs)) if senses.errs else _NO_ERRORS
        if not self.drifts:
            self.believed[:] = *true_pose, *true_speed
        _direct_read()(ranges_m, errors.ranges[0], errors.dropouts[0], senses.least, senses.most, senses.constants)
        around = _NO_DISCS
        if discs is not None:
            around = discs.copy()
            seen = track(around, errors.places[0], *true_pose, self.believed, senses.constants)
            around = _frozen(around[:seen])
        x, y, heading, v, w = self.believed.tolist()
        length, time = self._length, self._time
        return Observation(
            t_s / time,
            Pose(x / length, y / length, heading),
            self.goal,
            v * time / length,
            w * time,
            _frozen(ranges_m),
            touching,
            around,
        )


@compiled
def believe(
    believed: FloatArray,
    scale: FloatArray,
    left_m: float,
    right_m: float,
    dt_s: float,
    errors: FloatArray,
    sensing: NDArray[np.void],
) -> None:
    """Move a believed pose and speed, (5,) x, y, heading, v, w, by what the wheels are thought to have covered."""
    left = left_m * scale[0] * (1.0 + sensing[0].travel_noise * errors[0])
    right = right_m * scale[1] * (1.0 + sensing[0].travel_noise * errors[1])
    v, w = 0.5 * (left + right) / dt_s, (right - left) / sensing[0].track_m / dt_s
    x, y, heading = advance_arc(believed[0], believed[1], believed[2], v, w, dt_s)
    believed[0], believed[1], believed[2], believed[3], believed[4] = x, y, wrap_angle(heading), v, w


@compiled_inline
def read(
    ranges: FloatArray,
    errors: FloatArray,
    chances: FloatArray,
    least: FloatArray,
    most: FloatArray,
    sensing: NDArray[np.void],
) -> None:
    """Add errors to exact readings [m], in place, keep them within what each sensor can read, and make them native.

    Args:
        ranges: (n,) exact readings.
        errors: (n,) of each reading, in standard deviations, or (0,) for none.
        chances: (n,) in [0, 1), or (0,) for none.
        least: (n,) the smallest readings.
        most: (n,) the largest readings, which stand for nothing seen: there is nothing to err about.
        sensing: (1,) of ``SENSING``.
    """
    for i in range(ranges.shape[0]):
        reading = ranges[i]
        if errors.shape[0] and reading < most[i]:
            reading += sensing[0].noise_std_m * errors[i]
        if chances.shape[0] and chances[i] < sensing[0].dropout_probability:
            reading = most[i]
        ranges[i] = max(min(reading, most[i]), least[i]) / sensing[0].length


@cache
def _direct_read() -> Callable[..., None]:
    none, one = np.zeros(0), np.zeros(1)
    return direct(read, one, none, none, one, one, np.zeros(1, SENSING))


@compiled_inline
def track(
    discs: FloatArray,
    errors: FloatArray,
    x: float,
    y: float,
    heading: float,
    believed: FloatArray,
    sensing: NDArray[np.void],
) -> int:
    """Move the discs that a tracker sees to the front, in the frame of the believed pose and native, and count them.

    Args:
        discs: (n, 5) x, y, radius, vx, vy of everything round [m, m/s]; changed in place.
        errors: (n, 2) of each place, in standard deviations, or (0, 1) for none.
        x: the true pose's x [m].
        y: its y [m].
        heading: its heading [rad].
        believed: (5,) the believed pose and speed.
        sensing: (1,) of ``SENSING``.
    """
    turn, count = believed[2] - heading, 0
    cosine, sine = math.cos(turn), math.sin(turn)
    for k in range(discs.shape[0]):
        dx, dy, radius, vx, vy = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2], discs[k, 3], discs[k, 4]
        if math.hypot(dx, dy) - radius > sensing[0].tracker_range_m:
            continue
        px, py = discs[k, 0], discs[k, 1]
        if errors.shape[0]:
            px, py = px + sensing[0].tracker_std_m * errors[k, 0], py + sensing[0].tracker_std_m * errors[k, 1]
        if sensing[0].drifts:
            dx, dy = px - x, py - y
            px, py = cosine * dx - sine * dy + believed[0], sine * dx + cosine * dy + believed[1]
            vx, vy = cosine * vx - sine * vy, sine * vx + cosine * vy
        discs[count, 0], discs[count, 1], discs[count, 2] = (
            px / sensing[0].length,
            py / sensing[0].length,
            radius / sensing[0].length,
        )
        discs[count, 3], discs[count, 4] = (
            vx * sensing[0].time / sensing[0].length,
            vy * sensing[0].time / sensing[0].length,
        )
        count += 1
    return count
