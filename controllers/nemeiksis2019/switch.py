"""The switch unit of Nemeiksis and Osadcuks: which agent drives, from which of the ten sensors see something.

Table 1 names an agent for 28 patterns over the ten sensors, in which 2 means that a sensor does not matter. They cover
917 of the 1024 patterns, never contradict each other, and 13 of them are covered by the others. The 107 that no row
covers do come up in runs; ``completed_agent`` gives them an agent by four rules, tried in turn, which agree with the
table wherever it speaks. A pattern is a number: bit k is set where the sensor of the table's column k sees something.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Annotated, Any, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from navbench.validation import STRICT, NonNegative, Positive, describe

DESTINATION, OBSTACLE, WALL = 0, 1, 2  # values of the trace's "agent"
AGENTS = {"destination": DESTINATION, "obstacle": OBSTACLE, "wall": WALL}
LEFT, RIGHT = 1.0, -1.0  # values of the trace's "side": where the tracked wall is

COLUMNS = (10, 1, 2, 3, 4, 5, 6, 7, 8, 9)  # of Table 1, in its order; they run round the robot, clockwise
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
    return sum(1 << COLUMNS.index(sensor) for sensor in sensors)


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


@cache
def agents_by_pattern(agents: tuple[str, ...]) -> tuple[int, ...]:
    """Return the agent of each pattern, (1024,), where only some agents exist; the first takes the missing ones'."""
    return tuple(AGENTS[name if name in agents else agents[0]] for name in map(completed_agent, PATTERNS))


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


class SwitchUnit:
    """The switch unit and what it remembers: the agent that drives, and how long a change must wait.

    Attributes:
        parameters: the checked parameters.
    """

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        """Check the parameters.

        Args:
            parameters: a value for each field of ``SwitchParameters``.

        Raises:
            ValueError: a key is unknown or missing, or a value is of the wrong type or out of range.
        """
        self.parameters = given = describe(SwitchParameters, parameters, "switch")
        flanks = (*LEFT_FLANK, *RIGHT_FLANK)
        self._detect_m = [given.flank_detect_m if s in flanks else given.front_rear_detect_m for s in range(1, 11)]
        self._bits = [1 << COLUMNS.index(sensor) for sensor in range(1, 11)]
        self._agents = agents_by_pattern(given.agents)
        self._left, self._right = pattern_of(LEFT_FLANK), pattern_of(RIGHT_FLANK)
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        self._active = -1  # none yet
        self._waits = 0

    def pattern(self, ranges_m: Sequence[float]) -> int:
        """Return the pattern of some readings of the sensors 1 to 10 [m]."""
        pattern = 0
        for bit, reading_m, detect_m in zip(self._bits, ranges_m, self._detect_m, strict=True):
            if reading_m < detect_m:
                pattern |= bit
        return pattern

    def side(self, pattern: int, ranges_m: Sequence[float]) -> float:
        """Return which wall there is to track, ``LEFT`` or ``RIGHT``.

        It is the side both of whose sensors see something; where that is so of both sides or of none, the side whose
        two readings have the smaller sum, and of equal sums the left.
        """
        left, right = pattern & self._left == self._left, pattern & self._right == self._right
        if left != right:
            return LEFT if left else RIGHT
        (s1, s10), (s5, s6) = LEFT_FLANK, RIGHT_FLANK
        return LEFT if ranges_m[s1 - 1] + ranges_m[s10 - 1] <= ranges_m[s5 - 1] + ranges_m[s6 - 1] else RIGHT

    def choose(self, pattern: int, side: float, heading_error_rad: float) -> int:
        """Return the agent that drives in this control period.

        Args:
            pattern: which sensors see something.
            side: where the wall is that the wall agent would track.
            heading_error_rad: the destination's bearing, positive to the left [rad].
        """
        wanted, leave_rad = self._agents[pattern], self.parameters.leave_wall_rad
        if wanted == WALL and leave_rad is not None and -side * heading_error_rad >= leave_rad:
            wanted = DESTINATION
        if wanted != self._active:
            if self._waits and wanted != OBSTACLE:
                self._waits -= 1
            else:
                self._waits = 0 if self._active < 0 else self.parameters.dwell_periods
                self._active = wanted
        return self._active


def describe_patterns() -> dict[str, list[Any]]:
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
    names = ("pattern", "modes", "matches", "printed", "agent", "mirror", "mirror_agrees")
    return {name: [row[i] for row in rows] for i, name in enumerate(names)}


def describe_modes() -> dict[str, list[Any]]:
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
