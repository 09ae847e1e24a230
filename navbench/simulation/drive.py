"""The drive: from commands to the wheel speeds in force, behind the robot's limits and, where asked for, a delay."""

import math
from collections import deque
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from navbench.robot import Robot
from navbench.simulation.options import SimulatorOptions

FloatArray = NDArray[np.float64]


class Drive:
    """All robots' wheels through one episode.

    Args:
        robot: every robot's body.
        options: how to simulate.
        accel_max_mps2: the wheel-acceleration limit in force [m/s^2], None for none.
        count: how many robots.

    Attributes:
        in_force: (count, 2) the command in force for each left and right wheel [m/s].
        accel_max_mps2: the wheel-acceleration limit [m/s^2], infinite for none.
        lag_s: the wheels' time constant [s], 0 for none.
        fastest_mps: no robot's centre is faster than this in the present period [m/s].
    """

    def __init__(self, robot: Robot, options: SimulatorOptions, accel_max_mps2: float | None, count: int) -> None:
        limited = options.drive == "limited"
        self.accel_max_mps2 = math.inf if accel_max_mps2 is None else accel_max_mps2
        self.lag_s = options.motor_lag_s if limited else 0.0
        self._delay_s = options.command_delay_s if limited else 0.0
        self._robot = robot
        self._issued: FloatArray = np.zeros((count, 2))
        self.in_force = self._issued if self._delay_s == 0.0 else self._issued.copy()
        self._in_flight: deque[tuple[float, FloatArray]] = deque()
        self.fastest_mps = 0.0
        self._forgets = self.accel_max_mps2 == math.inf and self.lag_s == 0.0 and self._delay_s == 0.0

    def command(self, index: int, v_mps: float, w_radps: float) -> None:
        """Set one robot's command; each wheel is clipped at its limit, separately.

        Raises:
            ValueError: the wheels' speeds are not finite.
        """
        limit = self._robot.wheel_speed_max_mps
        turn = 0.5 * w_radps * self._robot.track_m
        left, right = v_mps - turn, v_mps + turn
        if not (-limit <= left <= limit and -limit <= right <= limit):
            if not (math.isfinite(left) and math.isfinite(right)):
                raise ValueError(
                    f"the wheels' speeds must be finite, got v_mps={v_mps}, w_radps={w_radps} in the world"
                )
            left, right = min(max(left, -limit), limit), min(max(right, -limit), limit)
        speed = 0.5 * abs(left + right)
        if speed > self.fastest_mps:
            self.fastest_mps = speed
        self._issued[index, 0] = left
        self._issued[index, 1] = right

    def segments(self, t_s: float, dt_s: float) -> Iterator[tuple[float, float]]:
        """Yield (begin, duration) [s] of the pieces of a control period, each command in force from where it arrives.

        Args:
            t_s: the period's beginning [s].
            dt_s: its length [s].
        """
        if self._delay_s == 0.0:
            yield t_s, dt_s
        else:
            self._in_flight.append((t_s + self._delay_s, self._issued.copy()))
            begin = t_s
            while self._in_flight and self._in_flight[0][0] < t_s + dt_s - 1e-12:
                arrives, targets = self._in_flight.popleft()
                if arrives > begin:
                    yield begin, arrives - begin
                    begin = arrives
                self.in_force[:] = targets
            yield begin, t_s + dt_s - begin
        if self._forgets:
            self.fastest_mps = 0.0  # every command is new each period, and no wheel remembers an old one
