"""The switch unit of Nemeiksis and Osadcuks: which agent drives, from which of the ten sensors see something.

Table 1 names an agent for 28 patterns over the ten sensors, in which 2 means that a sensor does not matter. They cover
917 of the 1024 patterns, never contradict each other, and 13 of them are covered by the others. The 107 that no row
covers do come up in runs; ``completed_agent`` gives them an agent by four rules, tried in turn, which agree with the
table wherever it speaks. A pattern is a number: bit k is set where the sensor of the table's column k sees something.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from navbench.compiled import compiled
from navbench.contract import FloatArray
from navbench.fuzzy.describing import Columns, columns
from navbench.validation import STRICT, NonNegative, Positive, describe, remembered

DESTINATION, OBSTACLE, WALL = 0, 1, 2  # values of the trace's "agent"
NOBODY = -1.0  # drives before the first control period
AGENTS = {"destination": DESTINATION, "obstacle": OBSTACLE, "wall": WALL}
LEFT, RIGHT = 1.0, -1.0  # values of the trace's "side": where the tracked wall is

COLUMNS = (10, 1, 2, 3, 4, 5, 6, 7, 8, 9)  # of Table 1, in its order; they run round the robot, clockwise
BITS = tuple(1 << COLUMNS.index(sensor) for sensor in range(1, 11))  # of the sensors 1 to 10 in a pattern
FRONT, LEFT_FLANK, RIGHT_FLANK, REAR = (2, 3, 4), (1, 10), (5, 6), (7, 8, 9)
TABLE_1 = (  # 0: sees nothing, 1: sees something, 2: does not matter
    # 10  1  2  3  4  5  6  7  8  9
    ("0 0 0 0 0 0 0 0 0 0", "destination"),
    ("0 1 0 0 0 1 0 0 0 0", "destination"),
    ("0 1 0 0 0 0 0 0 0 0", "destination"),
    ("0 0 0 0 0 1 0 0 0 0", "destination"),
    ("1 0 0 0 0 0 1 0 0 0", "destination"),
    ("1 0 0 0 0 0 0 0 0 0", "destination"),
    ("0 0 0 0 0 0 1 0 0 0", "destination"),
    ("1 1 0 0 0 0 0 0 0 0", "wall"),
    ("0 0 0 0 0 1 1 0 0 0", "wall"),
    ("1 1 0 0 0 1 1 0 0 0", "wall"),
    ("1 1 0 0 0 1 2 0 0 0", "wall"),
    ("2 1 0 0 0 1 1 0 0 0", "wall"),
    ("2 2 0 0 0 1 1 0 0 0", "wall"),
    ("1 1 0 0 0 2 2 0 0 0", "wall"),
    ("0 0 0 0 0 0 0 1 2 2", "obstacle"),
    ("0 0 0 0 0 0 0 2 1 2", "obstacle"),
    ("0 0 0 0 0 0 0 2 2 1", "obstacle"),
    ("0 0 0 0 0 0 0 1 1 2", "obstacle"),
    ("0 0 0 0 0 0 0 1 2 1", "obstacle"),
    ("0 0 0 0 0 0 0 2 1 1", "obstacle"),
    ("0 0 0 0 0 0 0 1 1 1", "obstacle"),
    ("2 2 1 2 2 2 2 2 2 2", "obstacle"),
    ("2 2 2 1 2 2 2 2 2 2", "obstacle"),
    ("2 2 2 2 1 2 2 2 2 2", "obstacle"),
    ("2 2 1 1 2 2 2 2 2 2", "obstacle"),
    ("2 2 1 2 1 2 2 2 2 2", "obstacle"),
    ("2 2 2 1 1 2 2 2 2 2", "obstacle"),
    ("2 2 1 1 1 2 2 2 2 2", "obstacle"),
)
PATTERNS = range(1 << len(COLUMNS))


def mirrored_sensor(sensor: int) -> int:
    """Return the sensor on the other side of the robot: 1 and 5, 10 and 6, 2 and 4, 9 and 7; 3 and 8 are their own."""
    return (6 - sensor) % 10 or 10


def pattern_of(sensors: Sequence[int]) -> int:
    """Return the pattern in which just these sensors see something."""
    return sum(BITS[sensor - 1] for sensor in sensors)


IN_FRONT, ON_LEFT, ON_RIGHT = map(pattern_of, (FRONT, LEFT_FLANK, RIGHT_FLANK))


def seeing(pattern: int) -> tuple[int, ...]:
    """Return the sensors that see something in a pattern, in the order of ``COLUMNS``."""
    return tuple(sensor for k, sensor in enumerate(COLUMNS) if pattern >> k & 1)


def mirrored(pattern: int) -> int:
    """Return the pattern that the robot's mirror image would meet."""
    return pattern_of([mirrored_sensor(sensor) for sensor in seeing(pattern)])


def matching_modes(pattern: int) -> tuple[int, ...]:
    """Return the rows of Table 1 that match a pattern, counted from 1 as the table does."""
    return tuple(
        mode
        for mode, (row, _) in enumerate(TABLE_1, 1)
        if all(cell in ("2", str(pattern >> k & 1)) for k, cell in enumerate(row.split()))
    )


def printed_agents(pattern: int) -> frozenset[str]:
    """Return the agents that Table 1 names for a pattern: one, or none; two would be a conflict."""
    return frozenset(TABLE_1[mode - 1][1] for mode in matching_modes(pattern))


def completed_agent(pattern: int) -> str:
    """Return the agent of a pattern by the rules that complete Table 1; the first one that holds decides."""
    on = set(seeing(pattern))
    if on & set(FRONT):
        return "obstacle"
    if on >= set(LEFT_FLANK) or on >= set(RIGHT_FLANK):
        return "wall"
    if on and on <= set(REAR):
        return "obstacle"
    return "destination"


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class SwitchParameters:
    """What the switch unit may be told.

    Attributes:
        agents: which agents exist; the first one also drives in the patterns of those that are missing.
        flank_detect_m: sensors 1, 10, 5 and 6 see something where they read less [m].
        front_rear_detect_m: the other six see something where they read less [m].
        leave_wall_rad: wall tracking gives way to the destination where that lies at least this far to the free side
            [rad]; None: it does not. Not in the paper.
        dwell_periods: after a change, this many requests for another one are ignored, unless they are for the obstacle
            agent. Not in the paper, where it is 0.
    """

    agents: tuple[Literal["destination", "obstacle", "wall"], ...]
    flank_detect_m: Positive
    front_rear_detect_m: Positive
    leave_wall_rad: NonNegative | None
    dwell_periods: Annotated[int, Field(ge=0, strict=True)]

    def __post_init__(self) -> None:
        """Check that there is an agent and none stands twice."""
        if not self.agents or len(set(self.agents)) != len(self.agents):
            raise ValueError(f"agents: must name at least one agent, each once, not {list(self.agents)}")


@compiled
def pattern_seen(d_s: FloatArray, detect_m: FloatArray) -> int:
    """Return the pattern of the readings of the sensors 1 to 10 [m], which see something below these limits [m]."""
    pattern = 0
    for k in range(len(BITS)):
        if d_s[k] < detect_m[k]:
            pattern |= BITS[k]
    return pattern


@compiled
def tracked_side(pattern: int, d_s: FloatArray) -> float:
    """Return which wall there is to track, ``LEFT`` or ``RIGHT``.

    It is the side both of whose sensors see something; where that is so of both sides or of none, the side whose two
    readings have the smaller sum, and of equal sums the left.
    """
    left, right = pattern & ON_LEFT == ON_LEFT, pattern & ON_RIGHT == ON_RIGHT
    nearer = left if left != right else d_s[0] + d_s[9] <= d_s[4] + d_s[5]
    return LEFT if nearer else RIGHT


@compiled
def chosen(memory: FloatArray, wanted: int, side: float, bearing: float, leave_wall_rad: float, dwell: float) -> int:
    """Return the agent that drives in this control period.

    Args:
        memory: (2,) the agent that drives, ``NOBODY`` at first, and how many requests it still ignores; written.
        wanted: the pattern's agent.
        side: where the wall is that the wall agent would track.
        bearing: the destination's, positive to the left [rad].
        leave_wall_rad: as in ``SwitchParameters``, infinite for None.
        dwell: ``dwell_periods``.
    """
    if wanted == WALL and -side * bearing >= leave_wall_rad:
        wanted = DESTINATION
    if wanted != memory[0]:
        if memory[1] > 0.0 and wanted != OBSTACLE:
            memory[1] -= 1.0
        else:
            memory[0], memory[1] = wanted, 0.0 if memory[0] == NOBODY else dwell
    return int(memory[0])


@remembered
def switch_unit(parameters: Mapping[str, Any]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what the switch unit is told, for ``pattern_seen`` and ``chosen``.

    Args:
        parameters: a value for each field of ``SwitchParameters``.

    Returns:
        (10,) the limits of the sensors 1 to 10 [m]; (1024,) each pattern's agent; (2,) leave_wall_rad and dwell.

    Raises:
        ValueError: a key is unknown or missing, or a value is of the wrong type or out of range.
    """
    given = describe(SwitchParameters, parameters, "switch")
    flanks = (*LEFT_FLANK, *RIGHT_FLANK)
    detect_m = [given.flank_detect_m if s in flanks else given.front_rear_detect_m for s in range(1, 11)]
    names = map(completed_agent, PATTERNS)
    agents = [AGENTS[name if name in given.agents else given.agents[0]] for name in names]
    leave_wall_rad = math.inf if given.leave_wall_rad is None else given.leave_wall_rad
    return np.array(detect_m), np.array(agents, dtype=float), np.array([leave_wall_rad, given.dwell_periods])


def describe_patterns() -> Columns:
    """Return a table of all 1024 patterns: the rows that match, the printed agent, the completed one, its mirror's.

    ``printed`` is "none" where no row matches and "conflict" where rows of different agents do. ``mirror_agrees`` where
    both agents, the printed and the completed one, are those of the mirrored pattern.
    """
    rows = []
    for pattern in PATTERNS:
        modes, mirror = matching_modes(pattern), mirrored(pattern)
        agents, there = ((_printed(p), completed_agent(p)) for p in (pattern, mirror))
        told = " ".join(map(str, modes))
        rows.append((written(pattern), told, len(modes), *agents, written(mirror), agents == there))
    return columns(("pattern", "modes", "matches", "printed", "agent", "mirror", "mirror_agrees"), rows)


def describe_modes() -> Columns:
    """Return a table of the 28 rows of Table 1: how many patterns each covers, and how many of these it alone.

    A row that covers none alone is redundant; without all of these together the table still says the same.
    """
    covered = [matching_modes(pattern) for pattern in PATTERNS]
    modes = range(1, len(TABLE_1) + 1)
    alone = [sum(found == (mode,) for found in covered) for mode in modes]
    return {
        "mode": list(modes),
        "pattern": [row.replace(" ", "") for row, _ in TABLE_1],
        "agent": [agent for _, agent in TABLE_1],
        "patterns": [sum(mode in found for found in covered) for mode in modes],
        "alone": alone,
        "redundant": [count == 0 for count in alone],
    }


def written(pattern: int) -> str:
    """Return a pattern as Table 1 writes it, without its spaces."""
    return "".join(str(pattern >> k & 1) for k in range(len(COLUMNS)))


def _printed(pattern: int) -> str:
    named = printed_agents(pattern)
    return "none" if not named else "conflict" if len(named) > 1 else min(named)
