"""The danger degree of Lei, Xing, Feng, Guan and Du, the first of the two layers of ``dual_layer``.

Y. Lei, X. Xing, Z. Feng, X. Guan, L. Du, "Dynamic Path Planning Based on Fuzzy and Behavior Control Idea", 2014;
sections 2 to 3.2.1, equations 1 to 10, Table 1, Figure 3.

How dangerous an obstacle is depends on how soon the robot would hit it and on how near it is, both counted in what the
robot needs to react: sampling periods and safety distances. A fuzzy controller of nine rules (DDCFC) makes one number
of the two, the danger degree of collision DDC. The largest one to the left, in front and to the right is what the
second layer sees of the world.

| symbol | here | unit | where |
|---|---|---|---|
| T | the control period, ``Setup.period_s`` | s | eq. 6 |
| D_s | ``safety_distance_m`` | m | eq. 7 |
| R_rob, R_Ok | radii of the robot and of the obstacle | m | eq. 5 |
| D_ROk, abs(V_ROk) | distance between their centres, size of the relative velocity | m, m/s | eq. 5 |
| t_ck, eta_t, eta_d | collision time, time factor, distance factor | s, 1, 1 | eqs 5, 6, 7 |
| DDC; LDDC, FDDC, RDDC | danger degree; its maximum to the left, in front, to the right | 1 | eq. 8, definition 7 |
| psi, psi_tar, psi_obs | directions of the robot's speed, of target and obstacle, counter-clockwise | rad | eqs 9, 10 |
| theta_tar, theta_obs | how far to the right of the heading a thing stands; negative is left | rad | eqs 9, 10 |
| w | turning rate, positive to the right | rad/s | eq. 1 |

Errata, corrected here:

- Definitions 5 and 6 call both [-30, 30] and [30, 90] degrees "front": the second is the right. Their ends lie in two
  sectors each: here -30 and 30 degrees belong to the front. Nothing is said of what stands further than 90 degrees
  aside: such an obstacle is left out, and such a target counts as 90 degrees aside.
- By eq. 9, with left negative, psi runs counter-clockwise; by eq. 1 w is positive for right turns. So psi' = -w, where
  eq. 2 prints psi' = w: read as printed (``w_turns_right`` false), the robots of section 4 drive into each other. Eq.
  4's dy has the same wrong sign, and takes an arc for its chord; the simulator moves along the exact arc instead.
- Eq. 5 is positive also for an obstacle that draws away: there, and without relative motion, t_ck is infinite here.

The paper prints the ranges of eta_t, eta_d and DDC and draws triangles. Left open, and decided here: the smallest and
the largest set have their peaks at the ends of the range, the middle one halfway; "and" is the minimum; the output is
the mean of the concluded sets' peaks, weighted by the rules' strengths. With the centroid instead DDC would stay within
0.17 and 0.83, so that an empty world would not be free of danger.
"""

import math
from collections.abc import Mapping

from navbench.compiled import compiled
from navbench.contract import FloatArray
from navbench.fuzzy.inference import FuzzyInference, Variable, infer, rules_from_table
from navbench.mathematics.geometry import wrap_angle

TIME_FACTORS = ("TS", "TM", "TB")
DISTANCE_FACTORS = ("DS", "DM", "DB")
DANGERS = ("S", "M", "B")

# Table 1: DDC, over eta_t = TS, TM, TB.
TABLE_1 = {
    "DS": ("B", "B", "B"),
    "DM": ("B", "M", "M"),
    "DB": ("B", "M", "S"),
}
LEFT, FRONT, RIGHT, ASIDE = range(4)  # sectors; what stands aside is no danger
STANDSTILL_MPS = 1e-6  # a relative speed below it is none


@compiled
def free_distance(d_ro: float, r_rob: float, r_o: float) -> float:
    """Return the distance between the hulls of robot and obstacle [m], 0 where they touch."""
    return max(d_ro - r_rob - r_o, 0.0)  # numerator of eqs (5), (7)


@compiled
def collision_time(free_m: float, v_ro: float, closing: bool) -> float:
    """Return t_ck [s], infinite where the obstacle draws away or nothing moves."""
    if not closing or v_ro < STANDSTILL_MPS:
        return math.inf
    return free_m / v_ro  # eq. (5)


@compiled
def time_factor(t_c: float, period_s: float) -> float:
    """Return eta_t, the collision time in sampling periods."""
    return t_c / period_s  # eq. (6)


@compiled
def distance_factor(free_m: float, d_s: float) -> float:
    """Return eta_d, the distance in safety distances."""
    return free_m / d_s  # eq. (7)


@compiled
def azimuth(psi: float, psi_thing: float) -> float:
    """Return theta_tar or theta_obs, how far to the right of the heading a thing stands [rad]."""
    theta: float = wrap_angle(psi - psi_thing)
    return theta  # eqs (9), (10)


@compiled
def sector(theta_obs: float, front_rad: float, side_rad: float) -> int:
    """Return the sector of an azimuth: ``LEFT``, ``FRONT``, which has both its edges, ``RIGHT`` or ``ASIDE``."""
    if abs(theta_obs) <= front_rad:
        return FRONT
    if abs(theta_obs) > side_rad:
        return ASIDE
    return LEFT if theta_obs < 0.0 else RIGHT  # definition 6


@compiled
def add_danger(
    largest: FloatArray,
    where: int,
    ddcfc: FloatArray,
    thresholds: FloatArray,
    way: tuple[float, float],
    radius_m: float,
    velocity: tuple[float, float],
    work: FloatArray,
) -> None:
    """Raise the largest danger degree of a sector to that of an obstacle in it.

    Args:
        largest: (3,) LDDC, FDDC and RDDC, 0 before the first obstacle; written.
        where: the obstacle's sector, not ``ASIDE``.
        ddcfc: ``FuzzyInference.base`` of ``danger_controller``.
        thresholds: R_rob [m], T [s], D_s [m], how far the front and the sides reach [rad]; 1, or 0 if the collision
            time counts as infinite; one that is not read; the peaks of DB and of TB; that of S.
        way: from the robot's centre to the obstacle's, x and y [m].
        radius_m: the obstacle's.
        velocity: the obstacle's less the robot's, vx and vy [m/s].
        work: (3,) is written.
    """
    (dx, dy), (vx, vy) = way, velocity
    free_m = free_distance(math.hypot(dx, dy), thresholds[0], radius_m)
    closing = thresholds[5] > 0.0 and dx * vx + dy * vy < 0.0
    t_c = collision_time(free_m, math.hypot(vx, vy) if closing else 0.0, closing)
    work[0], work[1] = distance_factor(free_m, thresholds[2]), time_factor(t_c, thresholds[1])
    if work[0] >= thresholds[7] and work[1] >= thresholds[8] and thresholds[9] <= largest[where]:
        return  # of Table 1 the last rule alone starts, whose S raises nothing
    infer(ddcfc, work, work[2:])  # eq. (8)
    if work[2] > largest[where] or math.isnan(work[2]):
        largest[where] = work[2]  # definition 7


def danger_controller(
    eta_d_peaks: Mapping[str, float], eta_t_peaks: Mapping[str, float], danger_peaks: Mapping[str, float]
) -> FuzzyInference:
    """Return DDCFC: eta_d and eta_t, in this order, to DDC.

    Args:
        eta_d_peaks: peak of each of ``DISTANCE_FACTORS``.
        eta_t_peaks: peak of each of ``TIME_FACTORS``.
        danger_peaks: peak of each of ``DANGERS``.

    Raises:
        ValueError: peaks do not ascend.
    """
    inputs = {"eta_d": between_ends(eta_d_peaks), "eta_t": between_ends(eta_t_peaks)}
    outputs = {"DDC": between_ends(danger_peaks)}
    return FuzzyInference(
        inputs,
        outputs,
        rules_from_table(TABLE_1, inputs, outputs),
        fallback={"DDC": danger_peaks["S"]},  # a rule always fires
        defuzzification="weighted_mean_of_peaks",
    )


def between_ends(peaks: Mapping[str, float]) -> Variable:
    """Return a variable of triangles from its first peak to its last."""
    return Variable.from_peaks(peaks, min(peaks.values()), max(peaks.values()), shoulders=False)
