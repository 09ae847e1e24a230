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

from navbench.contract import FloatArray, Setup, check_roles
from navbench.fuzzy.describing import Columns
from navbench.mathematics.kinematics import body_speed
from navbench.policy import CompiledController, Policy, compiled, pack, part
from navbench.validation import Flag, Positive, checked

from .blocks import answer, fuzzy_blocks
from .switch import (
    IN_FRONT,
    LEFT,
    NOBODY,
    chosen,
    describe_modes,
    describe_patterns,
    pattern_seen,
    switch_unit,
    tracked_side,
)

SENSOR_ROLES = tuple(f"s{i}" for i in range(1, 11))
DETECT, AGENTS, SWITCH, DRIVE, BYPASS, TRACK_LEFT, TRACK_RIGHT, APPROACH, SPEED = range(9)  # parts of the parameters
TRACE = (
    "agent",  # the active one: 0 destination, 1 obstacle, 2 wall
    "pattern",  # bit k is set where the sensor of Table 1's column k sees something
    "side",  # where the wall is that the wall agent tracks or would track: 1 left, -1 right
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
def step(
    state: FloatArray,
    parameters: FloatArray,
    ranges_m: FloatArray,
    discs: FloatArray,
    pose: tuple[float, float, float],
    goal: tuple[float, float],
    speed: tuple[float, float],
    trace: FloatArray,
) -> tuple[float, float]:
    """Return the speeds for the active agent's turning angle and the speed agent's average speed.

    A step of ``navbench.policy``; the state is the switch unit's memory and room to work in, and NaN a reading's, a
    pose's or a goal's.
    """
    work, switch, drive, d_s = state[2:], part(parameters, SWITCH), part(parameters, DRIVE), ranges_m
    k, reads_rear, track, v_max = drive[0], drive[1] > 0.0, drive[2], drive[3]
    d_destination = math.hypot(goal[0] - pose[0], goal[1] - pose[1])
    bearing = -deviation(pose[2], math.atan2(goal[1] - pose[1], goal[0] - pose[0]))  # positive to the left
    pattern = pattern_seen(d_s, part(parameters, DETECT))
    side = tracked_side(pattern, d_s)
    agent = chosen(state, int(part(parameters, AGENTS)[pattern]), side, bearing, switch[0], switch[1])

    rear = reads_rear and pattern & IN_FRONT == 0
    bypass_inputs = (d_s[8], d_s[6], d_s[7]) if rear else (d_s[3], d_s[1], d_s[2])  # d_s4, d_s2, d_s3
    track_inputs = (d_s[9], d_s[0]) if side == LEFT else (d_s[5], d_s[4])
    mu_1 = answer(part(parameters, BYPASS), bypass_inputs, work)
    mu_2 = answer(part(parameters, TRACK_LEFT if side == LEFT else TRACK_RIGHT), track_inputs, work)
    mu_3 = answer(part(parameters, APPROACH), (bearing,), work)
    mu = (mu_3, mu_1, mu_2)[agent]
    v_avg = answer(part(parameters, SPEED), (mu, d_destination), work) * v_max
    trace[0], trace[1], trace[2] = agent, pattern, side
    trace[3], trace[4], trace[5], trace[6], trace[7] = mu_1, mu_2, mu_3, mu, v_avg
    trace[8], trace[9] = bearing, d_destination
    trace[10], trace[11], trace[12], trace[13] = d_s[0], d_s[9], d_s[4], d_s[5]
    if math.isnan(mu_1 + mu_2 + mu_3 + v_avg):
        return math.nan, math.nan
    left, right = wheel_speeds(mu, v_avg, k, track)
    return body_speed(left, right, track)


class MultiAgent(CompiledController):
    """The planner.

    Attributes:
        sensor_roles: the sensors that it needs, in this order.
        trace_words: what the trace's values are called.
        blocks: the fuzzy blocks.
    """

    sensor_roles = SENSOR_ROLES
    trace_words = {"agent": ("destination agent", "obstacle agent", "wall agent")}

    @checked("build")
    def __init__(
        self,
        *,
        switch: Mapping[str, Any],
        blocks: Mapping[str, Any],
        turn_gain_per_s: Positive,
        bypass_reads_rear: Flag,
    ) -> None:
        """Check the parameters and build the blocks.

        Args:
            switch: a value for each field of ``nemeiksis2019_switch.SwitchParameters``.
            blocks: a value for each field of ``nemeiksis2019_blocks.Peaks``.
            turn_gain_per_s: turning rate per turning angle [1/s].
            bypass_reads_rear: whether, with only the rear seeing something, 1FB takes the rear's readings: d_s7, d_s8
                and d_s9 for d_s2, d_s3 and d_s4.

        Raises:
            ValueError: a parameter is unknown, missing or out of range.
        """
        self._switch, self.blocks = switch_unit(switch), fuzzy_blocks(blocks)
        self._drive = (turn_gain_per_s, bypass_reads_rear)

    def make_policy(self, setup: Setup) -> Policy:
        """Return the policy for a robot and its ring.

        Raises:
            ValueError: the ring's sensors are not ``sensor_roles``.
        """
        check_roles(setup, SENSOR_ROLES)
        drive = (*self._drive, setup.robot.track_m, setup.robot.wheel_speed_max_mps)
        bases = [block.base for block in self.blocks.by_name().values()]
        parameters = pack(*self._switch, drive, *bases)
        state = np.array([NOBODY, 0.0, 0.0, 0.0, 0.0, 0.0])
        return Policy(step=step, state=state, parameters=parameters, trace_names=TRACE)

    def describe(self) -> dict[str, Columns]:
        """Return named tables for a report: those of the blocks, the switch unit's 1024 patterns and its 28 rows."""
        return {**self.blocks.describe(), "patterns": describe_patterns(), "modes": describe_modes()}
