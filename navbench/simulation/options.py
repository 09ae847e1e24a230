"""How an episode is simulated: the options that every simulator has."""

from typing import Literal

from pydantic.dataclasses import dataclass

from navbench.validation import STRICT, Flag, NonNegative


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class SimulatorOptions:
    """The options of every simulator; one that has more describes them in a subclass.

    Attributes:
        gui: open a window, where the simulator has one, and run in real time.
        drive: "ideal": no slip, within the robot's wheel-speed and acceleration limits; "limited": the same behind a
            motor lag and a command delay.
        on_collision: "end": a robot that hits ends; "block": it is held where it hit and counted.
        motor_lag_s: time constant of each wheel's first-order lag, used by "limited" [s].
        command_delay_s: how long a command takes to reach the wheels, used by "limited" [s].
    """

    gui: Flag = False
    drive: Literal["ideal", "limited"] = "ideal"
    on_collision: Literal["end", "block"] = "end"
    motor_lag_s: NonNegative = 0.0
    command_delay_s: NonNegative = 0.0
