"""The metrics of one robot in one episode, each declared once: what the store, tables, reports and objectives read.

A metric of one's own is a function beside such a declaration in any module, named by ``metrics=[module.function]``. A
failed robot's numbers are kept, up to its end.
"""

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled
from navbench.mathematics.geometry import wrap_angle
from navbench.world.layout import Layout
from navbench.world.shapes import Point

FloatArray = NDArray[np.float64]
TURNS_RADPS = 1e-9  # what turns slower is rounding, far below any command
ARROWS = {"less": " ↓", "more": " ↑", "": ""}


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotRun:
    """One robot's finished episode, of which a metric is computed.

    Attributes:
        robot_index: which robot of the world.
        outcome: "reached", "collided", "timed_out" or "controller_error".
        time_s: when it ended [s].
        path_length_m: the length of its path, summed over exact arcs [m].
        turning_rad: its turning rate's size, integrated over exact arcs [rad].
        min_clearance_m: the least distance from its hull to anything, computed from the shapes at the end of each
            substep [m].
        collisions: its separate contacts: an unbroken touch counts once.
        robot_collisions: of these, those with another robot.
        standing_collisions: of these, those in which it stood itself.
        states: (n + 1, 6) t [s], x, y [m], heading [rad], v [m/s], w [rad/s], as ``RobotRecord.states``.
        traces: (n + 1, n_names) the controller's trace, nan at the end.
        trace_names: its names.
        radius_m: of its hull [m].
        layout: what it drove in.
    """

    robot_index: int
    outcome: str
    time_s: float
    path_length_m: float
    turning_rad: float
    min_clearance_m: float
    collisions: int
    robot_collisions: int
    standing_collisions: int
    states: FloatArray
    traces: FloatArray
    trace_names: tuple[str, ...]
    radius_m: float
    layout: Layout

    @property
    def goal(self) -> Point:
        """Where it should go."""
        return self.layout.goals[self.robot_index]

    @property
    def straight_m(self) -> float:
        """The straight line from its start to its goal [m]."""
        return math.hypot(self.goal.x_m - self.states[0, 1], self.goal.y_m - self.states[0, 2])

    @property
    def durations_s(self) -> FloatArray:
        """(n,) The length of each control period [s]."""
        times_s = self.states[:, 0]
        return times_s[1:] - times_s[:-1]


MetricFunction = Callable[[RobotRun], float]


@dataclass(frozen=True, slots=True)
class Metric:
    """What a metric is; as a decorator, ``@metric(...)``, it declares a function of a ``RobotRun`` as one.

    Attributes:
        name: the name of its column, which ends in its unit where that is one word, such as "time_s".
        unit: as printed, such as "m/s"; empty for a plain number.
        better: "less" or "more", or empty where neither is.
        definition: what it is, in words.
        source: who defines it so; empty for a definition of ours or of one's own.
        averaged: whether tables hold its mean over the robots that reached their goals.
        lost: its value of a robot of which nothing was recorded.
    """

    name: str
    unit: str
    better: Literal["less", "more", ""]
    definition: str
    source: str = ""
    averaged: bool = True
    lost: float = math.nan

    def __post_init__(self) -> None:
        """Check the name, which is a column's, and the direction."""
        if not re.fullmatch(r"[a-z]\w*", self.name):
            raise ValueError(f"metric name={self.name}: must be small letters, digits and _")
        if self.better not in ARROWS:
            raise ValueError(f"metric {self.name}: better={self.better}: must be less, more or empty")

    def __call__(self, function: MetricFunction) -> MetricFunction:
        """Declare a function as this metric."""
        function.__dict__["metric"] = self
        return function

    @property
    def sign(self) -> int:
        """1 where less is better, -1 where more is, 0 where neither is."""
        return {"less": 1, "more": -1, "": 0}[self.better]

    @property
    def title(self) -> str:
        """The name for people, without the unit, and with an arrow to where it is better."""
        word = self.name.removesuffix("_" + self.unit.replace("/", "p"))
        return word.replace("_", " ") + ARROWS[self.better]


metric = Metric  # as a decorator is called


def declared(functions: Iterable[MetricFunction]) -> tuple[Metric, ...]:
    """Return what some metrics are."""
    return tuple(function.__dict__["metric"] for function in functions)


@metric(
    "path_length_m",
    unit="m",
    better="less",
    lost=0.0,
    source="aouf2019, Table 4: travelled distance",
    definition="length of the path that the centre covered, summed over exact arcs",
)
def path_length_m(run: RobotRun) -> float:
    return run.path_length_m


@metric(
    "time_s",
    unit="s",
    better="less",
    lost=0.0,
    source="aouf2019, Table 3: navigation time",
    definition="from the beginning to the robot's outcome",
)
def time_s(run: RobotRun) -> float:
    return run.time_s


@metric(
    "collisions",
    unit="",
    better="less",
    lost=0,
    averaged=False,
    definition="separate contacts: an unbroken touch counts once; 0 or 1 where a contact ends the robot",
)
def collisions(run: RobotRun) -> int:
    return run.collisions


@metric(
    "min_clearance_m",
    unit="m",
    better="more",
    definition="the least distance from the hull to anything, computed from the shapes at the end of each substep, "
    "not by the physics engine; below 0, how deep a mover drove into a blocked robot; no number where nothing is there",
)
def min_clearance_m(run: RobotRun) -> float:
    return run.min_clearance_m if run.min_clearance_m < math.inf else math.nan


@metric(
    "mean_speed_mps",
    unit="m/s",
    better="more",
    lost=0.0,
    definition="path_length_m / time_s; 0 for a robot that ended at once",
)
def mean_speed_mps(run: RobotRun) -> float:
    return run.path_length_m / run.time_s if run.time_s > 0.0 else 0.0


@metric(
    "heading_ise",
    unit="rad² s",
    better="less",
    source="aouf2019: the objective for its PIDs, on the error of its eq. 25",
    definition="the integral of the squared heading error over time, summed over control periods as "
    "sum(error^2 * period), the error being the trace's heading_error_rad; without it, the bearing of the goal "
    "minus the heading",
)
def heading_ise(run: RobotRun) -> float:
    durations_s = run.durations_s
    if "heading_error_rad" in run.trace_names:
        errors = run.traces[: len(durations_s), run.trace_names.index("heading_error_rad")]
    else:
        errors = bearing_errors(run.states[: len(durations_s), 1:4], run.goal.x_m, run.goal.y_m)
    return float((errors * errors * durations_s).sum())


@metric(
    "total_turning_rad",
    unit="rad",
    better="less",
    lost=0.0,
    definition="the integral of the turning rate's size, summed over exact arcs",
)
def total_turning_rad(run: RobotRun) -> float:
    return run.turning_rad


@metric(
    "w_sign_changes",
    unit="",
    better="less",
    lost=0,
    definition="how often the turning rate changed its sign from one control period to the next, periods in which it "
    "is at most 1e-9 rad/s, which is rounding, left out; counts chattering",
)
def w_sign_changes(run: RobotRun) -> int:
    return sign_changes(run.states[:-1, 5])


@metric(
    "robot_collisions",
    unit="",
    better="less",
    lost=0,
    averaged=False,
    definition="of the collisions, those with another robot",
)
def robot_collisions(run: RobotRun) -> int:
    return run.robot_collisions


@metric(
    "standing_collisions",
    unit="",
    better="less",
    lost=0,
    averaged=False,
    definition="of the collisions, those in which the robot itself stood: it was driven into",
)
def standing_collisions(run: RobotRun) -> int:
    return run.standing_collisions


@metric("goal_distance_m", unit="m", better="less", averaged=False, definition="from the centre to the goal at the end")
def goal_distance_m(run: RobotRun) -> float:
    return math.hypot(run.goal.x_m - run.states[-1, 1], run.goal.y_m - run.states[-1, 2])


METRICS: tuple[MetricFunction, ...] = tuple(
    found for found in list(globals().values()) if hasattr(found, "metric")
)  # in the order above, which is that of the columns
DECLARED = declared(METRICS)


@compiled
def bearing_errors(poses: FloatArray, goal_x_m: float, goal_y_m: float) -> FloatArray:
    """Return the goal's bearing minus the heading, in (-pi, pi] [rad], for (n, 3) poses x, y [m], heading [rad]."""
    errors = np.empty(poses.shape[0])
    for i in range(poses.shape[0]):
        errors[i] = wrap_angle(math.atan2(goal_y_m - poses[i, 1], goal_x_m - poses[i, 0]) - poses[i, 2])
    return errors


@compiled
def sign_changes(values: FloatArray) -> int:
    """Return how often a series of turning rates changes its sign, those left out that are rounding."""
    count, last = 0, 0.0
    for value in values:
        if abs(value) > TURNS_RADPS:
            count += value * last < 0.0
            last = value
    return count
