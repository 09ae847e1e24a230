"""The multi-agent fuzzy planner of Nemeiksis and Osadcuks: a switch unit, three turning agents and a speed agent.

A. Nemeiksis, V. Osadcuks, "Development of Fuzzy Blocks Intended for Agents Constituting Intelligent System of Mobile
Robot Movement Planning", Rural Development 2019, doi:10.15544/RD.2019.016; Tables 1 to 5, Figures 1 to 10.

Ten range sensors stand round the robot. Which of them see something decides which agent drives: towards the
destination, round an obstacle or along a wall (Table 1). Each agent has a fuzzy block that answers with a turning angle
mu; a fourth block slows down for a large mu and near the destination. See ``nemeiksis2019_switch`` for the switch unit
and ``nemeiksis2019_blocks`` for the blocks.

| symbol | here | unit | where |
|---|---|---|---|
| d_s1 .. d_s10 | readings; 3 looks ahead, they count counter-clockwise down to 1, 10, 9, .. | m | Table 1 |
| phi, beta | the robot's heading, the destination's direction | rad | Fig. 4 |
| theta | deviation phi - beta; 3FB takes -theta, the bearing, positive to the left | rad | Fig. 4 |
| mu_1, mu_2, mu_3, mu | turning angles of the agents, of the active one; positive to the left | rad | Tables 2, 3, 4 |
| d_destination | distance to the destination | m | Table 5 |
| V_avg, V_max | average speed; the robot's wheel-speed limit | m/s | Table 5 |
| V_L, V_R | wheel speeds | m/s | Fig. 1 |
| k | ``turn_gain_per_s``: turning rate per turning angle | 1/s | none |

Errata, corrected here: the second branch of the wrap-around is for theta below -180 degrees; its "-180 < 0 < 180" means
theta; the sensors are inputs, not outputs, of 1FB, and theta is 3FB's input; mu_3 and V_avg are outputs in the captions
of Tables 4 and 5; "Inputs to 1FB" in the text on 2FB are 2FB's; Table 3's caption names the wrong agent; theta has five
triangular sets, not two; a wall takes the two sensors of one side (rows 8 and 9), not "all four"; the destination agent
drives with single flank sensors seeing something (rows 2 to 7), not only with none; the readings of 0.30 to 0.35 along
the wall are metres; the speed is the fourth block's output, not the second's; NB is FB; there is no Table 6; the robot
is no arm and nothing moves.

Left open, and decided here: where the sensors stand (2, 3, 4 in front, 7, 8, 9 behind, 1 and 10 left, 5 and 6 right,
which the order of Table 1's columns and the mirror of Table 3 imply); that L means negative for theta and mu alike, the
only pairing of Fig. 4 with Table 4 that turns towards the destination (positive to the left here, both turned); how mu
and V_avg make wheel speeds; what drives in the 107 patterns that Table 1 leaves out. With only the rear seeing
something 1FB gets the front's readings, which are far, so the robot drives on: it cannot back away. Table 2 knows no
turn to the left, so this controller has a handedness.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass

from navbench.compiled import compiled
from navbench.contract import Command, FloatArray, Observation, Setup
from navbench.validation import STRICT, Flag, Positive, describe

from .blocks import answer, fuzzy_blocks
from .switch import FRONT, LEFT, SwitchUnit, describe_modes, describe_patterns, pattern_of

SENSOR_ROLES = tuple(f"s{i}" for i in range(1, 11))
TRACE = (
    "agent",
    "pattern",
    "side",
    "mu_1_rad",
    "mu_2_rad",
    "mu_3_rad",
    "mu_rad",
    "v_avg_mps",
    "heading_error_rad",
    "d_destination_m",
    "d_s1_m",
    "d_s10_m",
    "d_s5_m",
    "d_s6_m",
)


@compiled
def deviation(phi: float, beta: float) -> float:
    """Return theta, from the destination's direction to the heading [rad], for angles within one turn of each other."""
    theta = phi - beta
    if theta > math.pi:
        return theta - 2.0 * math.pi
    if theta < -math.pi:  # printed without the sign
        return theta + 2.0 * math.pi
    return theta


@compiled
def wheel_speeds(mu: float, v_avg: float, k: float, track: float) -> tuple[float, float]:
    """Return V_L and V_R that turn the robot at k times mu, positive to the left, at an average speed."""
    half = 0.5 * k * mu * track
    return v_avg - half, v_avg + half


@compiled
def steered(
    bases: tuple[FloatArray, ...],
    ranges: FloatArray,
    reads_rear: bool,
    side: float,
    agent: int,
    bearing: float,
    d_destination: float,
    v_max: float,
) -> tuple[float, float, float, float, float]:
    """Return mu_1, mu_2, mu_3, the active agent's mu [rad] and V_avg [m/s], NaN where an input is.

    Args:
        bases: ``FuzzyBlocks.bases``.
        ranges: (10,) d_s1 to d_s10 [m].
        reads_rear: whether 1FB takes the rear's readings, see ``Drive``.
        side: of the wall that 2FB tracks, ``LEFT`` or ``RIGHT``.
        agent: the active one.
        bearing: -theta [rad].
        d_destination: distance to the destination [m].
        v_max: V_max [m/s].
    """
    bypass, track_left, track_right, approach, speed = bases
    d_s1, d_s2, d_s3, d_s4, d_s5 = ranges[0], ranges[1], ranges[2], ranges[3], ranges[4]
    d_s6, d_s7, d_s8, d_s9, d_s10 = ranges[5], ranges[6], ranges[7], ranges[8], ranges[9]
    mu_1 = answer(bypass, (d_s9, d_s7, d_s8) if reads_rear else (d_s4, d_s2, d_s3))
    if side == LEFT:
        mu_2 = answer(track_left, (d_s10, d_s1))
    else:
        mu_2 = answer(track_right, (d_s6, d_s5))
    mu_3 = answer(approach, (bearing,))
    mu = (mu_3, mu_1, mu_2)[agent]
    return mu_1, mu_2, mu_3, mu, answer(speed, (mu, d_destination)) * v_max


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Drive:
    """What is neither the switch unit's nor the blocks'.

    Attributes:
        turn_gain_per_s: turning rate per turning angle [1/s].
        bypass_reads_rear: whether, with only the rear seeing something, 1FB takes the rear's readings: d_s7, d_s8 and
            d_s9 for d_s2, d_s3 and d_s4.
    """

    turn_gain_per_s: Positive
    bypass_reads_rear: Flag


class MultiAgent:
    """The planner.

    Attributes:
        sensor_roles: the sensors that it needs, in this order.
        switch: the switch unit.
        blocks: the fuzzy blocks.
    """

    sensor_roles = SENSOR_ROLES

    def __init__(
        self,
        *,
        switch: Mapping[str, Any],
        blocks: Mapping[str, Any],
        turn_gain_per_s: float,
        bypass_reads_rear: bool,
    ) -> None:
        """Check the parameters and build the blocks.

        Args:
            switch: a value for each field of ``nemeiksis2019_switch.SwitchParameters``.
            blocks: a value for each field of ``nemeiksis2019_blocks.Peaks``.
            turn_gain_per_s: turning rate per turning angle [1/s].
            bypass_reads_rear: as in ``Drive``.

        Raises:
            ValueError: a parameter is unknown, missing or out of range.
        """
        given = {"turn_gain_per_s": turn_gain_per_s, "bypass_reads_rear": bypass_reads_rear}
        self._drive = describe(Drive, given, "build")
        self.switch, self.blocks = SwitchUnit(switch), fuzzy_blocks(blocks)
        self._front = pattern_of(FRONT)

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Begin an episode; nothing here is left to chance.

        Raises:
            ValueError: the ring's sensors are not ``sensor_roles``.
        """
        roles = tuple(sensor.role for sensor in setup.sensors)
        if roles != SENSOR_ROLES:
            raise ValueError(f"sensors are {', '.join(roles) or 'none'}; needed are {', '.join(SENSOR_ROLES)}")
        self._track_m, self._v_max_mps = setup.robot.track_m, setup.robot.wheel_speed_max_mps
        self.switch.reset()
        self._trace = dict.fromkeys(TRACE, 0.0)

    def act(self, observation: Observation) -> Command:
        """Return the wheel speeds for the active agent's turning angle and the speed agent's average speed."""
        (x, y, phi), goal = observation.pose, observation.goal
        d_destination = math.hypot(goal[0] - x, goal[1] - y)
        bearing = -deviation(phi, math.atan2(goal[1] - y, goal[0] - x))  # positive to the left
        ranges_m = observation.ranges_m.tolist()
        pattern = self.switch.pattern(ranges_m)
        side = self.switch.side(pattern, ranges_m)
        agent = self.switch.choose(pattern, side, bearing)

        reads_rear = self._drive.bypass_reads_rear and not pattern & self._front
        mu_1, mu_2, mu_3, mu, v_avg = steered(
            self.blocks.bases, observation.ranges_m, reads_rear, side, agent, bearing, d_destination, self._v_max_mps
        )
        if math.isnan(mu_1 + mu_2 + mu_3 + v_avg):
            raise ValueError("a reading, the pose or the goal is NaN, which has no membership")
        self._trace = {
            "agent": float(agent),
            "pattern": float(pattern),
            "side": side,
            "mu_1_rad": mu_1,
            "mu_2_rad": mu_2,
            "mu_3_rad": mu_3,
            "mu_rad": mu,
            "v_avg_mps": v_avg,
            "heading_error_rad": bearing,
            "d_destination_m": d_destination,
            "d_s1_m": ranges_m[0],
            "d_s10_m": ranges_m[9],
            "d_s5_m": ranges_m[4],
            "d_s6_m": ranges_m[5],
        }
        return Command.from_wheels(*wheel_speeds(mu, v_avg, self._drive.turn_gain_per_s, self._track_m), self._track_m)

    @property
    def trace(self) -> dict[str, float]:
        """The latest act: the active agent (0 destination, 1 obstacle, 2 wall), all turning angles, speed, readings.

        ``pattern`` has bit k set where the sensor of Table 1's column k sees something. ``side`` is where the wall is
        that the wall agent tracks or would track, 1 left and -1 right.
        """
        return self._trace

    def describe(self) -> dict[str, dict[str, list[Any]]]:
        """Return named tables for a report: those of the blocks, the switch unit's 1024 patterns and its 28 rows."""
        return {**self.blocks.describe(), "patterns": describe_patterns(), "modes": describe_modes()}
