"""What the robots of Zhao and Lee see and decide: danger, special situations, and which fuzzy controller is active.

R. Zhao, H.-K. Lee, "Fuzzy-based Path Planning for Multiple Mobile Robots in Unknown Dynamic Environment", Journal of
Electrical Engineering & Technology 12, 2017; equations 4 to 10, section 3.2 and Table 3.

Each of 16 proximity sensors tells how fast what it sees comes nearer, and so in what time it would hit. The least of
these times, R, and the direction Phi of its sensor are what obstacle avoidance (OA) is given; where nothing is near or
none is urgent, the robot turns to its target (TO). Where it is most urgent, and right ahead, beside or astern, four
further sensors say which direction is freer, and Phi is rewritten to the direction whose rules go there.

| symbol | here | unit | equation |
|---|---|---|---|
| d_t1^i, d_t2^i | reading of sensor i at the last and at this instant | m | 4 |
| v_ro^i | approach speed, ``approach_speed`` | m/s | 4 |
| R_dc^i | expected time of collision, ``danger_coefficient`` | s | 5, 6 |
| R, Phi | the least of them, and the direction of its sensor | s, rad | 7, 8 |
| s_i | reading of sensor i: s_0 ahead, odd ones to the left, even ones to the right, s_15 behind | m | 9, 10 |
| D_dif^1, D_dif^2 | room on the left less room on the right; in front less behind | m | 9, 10 |
| psi_t, Psi | direction of the target, Psi = theta - psi_t | rad | section 3.2 |
| D | distance to the target in robot radii | 1 | section 3.2 |

Errata, corrected here:

- (4) takes two readings for those of one thing, which they need not be. Where the last one or this one is the end of
  the sensor's range, R_dc is infinite; so it is, as the paper says, where nothing approaches. Where all are infinite,
  Phi means nothing and TO runs.
- Section 3.1 puts angles in [-180, 180), which would turn s_15 to -180 degrees; here it lies at 180, on a circle.
- Section 4 takes the direction of danger from v_ro - v_r = -v_o, which no range sensor knows and which is nothing for
  what stands still; here it is Phi, the direction of the sensor of R.
- In (9) and (10) the s_i are readings, not sensors; one that sees nothing counts as the end of its range.
- Table 3 misses two ends of its loops and does OA twice where R is below medium. Here: OA, once, where something is
  nearer than D_safe and R is below T_safe; before it, where R is below medium, the special situation; otherwise TO.

Left open, and decided here: (10) mirrored for the left and (9) turned round for astern; D_safe, T_safe, "medium" and
the directions to which Phi is rewritten, which are parameters of ``oa_to``. Sensors stand 22.5 degrees apart on the
hull, and (4) picks up the robot's own turning. Of equal dangers the first sensor's counts.
"""

import math

from navbench.compiled import compiled
from navbench.contract import FloatArray
from navbench.mathematics.geometry import wrap_angle

SENSOR_ROLES = (  # s_0 to s_15
    *("ahead", "left_23", "right_23", "left_45", "right_45", "left_68", "right_68", "left_90", "right_90"),
    *("left_113", "right_113", "left_135", "right_135", "left_158", "right_158", "behind"),
)

NO_SITUATION, AHEAD, RIGHT, LEFT, ASTERN = 0, 1, 2, 3, 4
NO_SENSOR = -1
SITUATIONS = (  # of section 4, in which the danger lies at s_0 to s_15
    *(AHEAD, AHEAD, AHEAD, NO_SITUATION, NO_SITUATION, LEFT, RIGHT, LEFT, RIGHT, LEFT, RIGHT),
    *(NO_SITUATION, NO_SITUATION, ASTERN, ASTERN, ASTERN),
)


@compiled
def approach_speed(d_t1: float, d_t2: float, dt: float) -> float:
    """Return how fast what a sensor sees comes nearer [m/s]."""
    return (d_t1 - d_t2) / dt  # eq. (4)


@compiled
def danger_coefficient(d_t2: float, v_ro: float) -> float:
    """Return the expected time of collision [s], infinite where nothing approaches."""
    return d_t2 / v_ro if v_ro > 0.0 else math.inf  # eq. (5)


@compiled
def greatest_danger(before: FloatArray, ranges: FloatArray, limits: FloatArray, dt: float) -> tuple[float, int]:
    """Return R [s] and the number of its sensor, infinite and ``NO_SENSOR`` where there is no danger.

    Args:
        before: (16,) readings one period ago [m].
        ranges: (16,) readings now [m].
        limits: (16,) what each sensor reads where it sees nothing [m].
        dt: the control period [s].
    """
    least, sensor = math.inf, NO_SENSOR
    for i in range(ranges.shape[0]):  # eq. (6)
        if before[i] < limits[i] and ranges[i] < limits[i]:
            r = danger_coefficient(ranges[i], approach_speed(before[i], ranges[i], dt))
            if r < least:
                least, sensor = r, i  # eqs (7), (8)
    return least, sensor


@compiled
def room_ahead(s: FloatArray) -> float:
    """Return by how much the left front is freer than the right front [m]."""
    difference: float = 0.5 * (s[1] + s[3]) - 0.5 * (s[2] + s[4])  # eq. (9)
    return difference


@compiled
def room_right(s: FloatArray) -> float:
    """Return by how much the right front is freer than the right back [m]."""
    difference: float = 0.5 * (s[4] + s[6]) - 0.5 * (s[10] + s[12])  # eq. (10)
    return difference


@compiled
def room_left(s: FloatArray) -> float:
    """Return by how much the left front is freer than the left back [m]."""
    difference: float = 0.5 * (s[3] + s[5]) - 0.5 * (s[9] + s[11])  # eq. (10), mirrored
    return difference


@compiled
def room_astern(s: FloatArray) -> float:
    """Return by how much the left back is freer than the right back [m]."""
    difference: float = 0.5 * (s[11] + s[13]) - 0.5 * (s[12] + s[14])  # eq. (9), astern
    return difference


@compiled
def rewritten(situation: int, s: FloatArray, directions: FloatArray) -> float:
    """Return the direction that stands for a special situation [rad].

    Args:
        situation: ``AHEAD``, ``RIGHT``, ``LEFT`` or ``ASTERN``.
        s: (16,) readings [m].
        directions: (8,) for each of these in turn, where the difference is above 0 and where it is not [rad].
    """
    difference = (room_ahead(s), room_right(s), room_left(s), room_astern(s))[situation - AHEAD]
    phi: float = directions[2 * (situation - AHEAD) + (0 if difference > 0.0 else 1)]
    return phi


@compiled
def avoidance(
    r: float, sensor: int, s: FloatArray, angles: FloatArray, thresholds: FloatArray, directions: FloatArray
) -> tuple[bool, float, int]:
    """Return the decision of Table 3: whether OA is active, Phi [rad] and the special situation.

    Phi is 0 where there is no danger; the situation is ``NO_SITUATION`` unless Phi was rewritten for it.

    Args:
        r: R [s].
        sensor: the number of its sensor, or ``NO_SENSOR``.
        s: (16,) readings [m].
        angles: (16,) where each sensor looks [rad].
        thresholds: D_safe [m], T_safe [s], medium [s].
        directions: (8,) as of ``rewritten``.
    """
    d_safe, t_safe, medium = thresholds[0], thresholds[1], thresholds[2]
    avoids = s.min() < d_safe and r < t_safe
    situation = SITUATIONS[sensor] if avoids and r < medium else NO_SITUATION
    if situation != NO_SITUATION:
        return avoids, rewritten(situation, s, directions), situation
    return avoids, 0.0 if sensor == NO_SENSOR else angles[sensor], situation


@compiled
def target(x: float, y: float, theta: float, x_goal: float, y_goal: float, radius: float) -> tuple[float, float]:
    """Return D in robot radii and Psi [rad] in (-pi, pi], positive where the target lies to the right."""
    psi_t = math.atan2(y_goal - y, x_goal - x)
    return math.hypot(x_goal - x, y_goal - y) / radius, wrap_angle(theta - psi_t)


@compiled
def wheel_speed(share: float, gain: float, limit_mps: float) -> float:
    """Return the speed of a wheel [m/s] for a fuzzy controller's answer, a share of the wheels' limit."""
    return min(max(gain * share, -1.0), 1.0) * limit_mps
