"""The 81 rules of the velocity fuzzy controller (VFC), the second layer of ``dual_layer``, made from Rules 1 to 3.

Lei et al. 2014 (``lei2014`` cites it), section 3.2.4. The paper prints no table but three kinds of rules: when each of
three behaviours starts, to which side it turns and how fast it drives. For each of the 3^4 combinations of the target's
azimuth and the danger to the left, in front and to the right they are applied here one after another.

Terms: theta_tar L, C, R (left, centre, right); DDC S, M, B (small, middle, big); v Z, VS, S, F, VF (zero to very fast);
w NB, NM, NS (left, big to small), Z, PS, PM, PB (right).

Errata and readings:

- Rule 1.3 says "conflict with FO behavior" twice; the second is AO. Counting out Rules 1.1 to 1.3 gives FO 54, AO 48,
  of which 16 are left to it, and MG 27, of which 11 are. The paper prints 44, 58 and 30, 18 and 7, which also make 81.
- Rule 2.2 speaks of AO, yet fits MG: read so, its {NS, NM, NB} and {PS, PM, PB} are as many as MG has rules for targets
  aside, 3 and 3; its one Z stands for five rules, or for one as ``symmetric`` has it. Its "turn left if theta_tar =
  Right" has to be right.
- Rule 2.1's "turn right if it walks along on the left side of obstacles" would turn towards the obstacle; read here as
  an obstacle on the robot's left. Before one in front the robot turns left, as printed.
- Rule 2.3, "turn right if abs(theta_tar) < abs(theta_obs)", makes sense for a target on the left only; read here, with
  its mirror image, as turning to the target's side of what is in front. With the target ahead and danger on both sides
  the robot drives on between them, where the rule, taken by the letter, has it turn right.
- Rule 3.3's VF and F are no sets of v as the text lists them (Z, VS, S); so v has five.
- The sizes of the turns follow Rule 2.1, the more danger the larger; Rule 3's choice among its sets is ours: the more
  sectors in big danger the slower, Z only where the robot turns too, VF with no danger at all and the target ahead.

``literal`` is this. ``safe`` changes 18 turns, which would else lead to the more dangerous side or be small for what is
in front: FO with the target ahead turns to the less dangerous side, and left only where both are alike; FO with the
target aside turns by the larger of the danger on its side and in front, but a little only where the other side is the
worse; AO with the target ahead turns a little from the worse side. The cells that are not mirror images of each other
are those of FO with the target ahead: 18 of ``literal``; 6 of ``safe``, where both sides are alike.

``symmetric`` gives six of the eight printed counts: AO 58, of which 28 conflict with FO and 30 are left, FO 44, and of
MG 4 conflict with AO and 7 are left; not MG's 18 and its 7 that conflict with FO. With the target ahead it takes
Rules 1.1.1 and 1.2.1 the other way round from what is printed: danger in front or on both sides starts AO, danger
aside alone FO. For a target aside the rules are those of ``literal``. How AO turns before what is in front of a target
ahead is no rule's: here away from the worse side, and left where both are alike, as Rule 2.1 has it for FO; FO with the
target ahead turns away from the side in danger, and drives on between two alike.
"""

import itertools
from functools import cache
from typing import Literal, NamedTuple

import numpy as np

from navbench.compiled import compiled
from navbench.contract import FloatArray

from .danger import DANGERS

AZIMUTHS = ("L", "C", "R")
SPEEDS = ("Z", "VS", "S", "F", "VF")
TURNS = ("NB", "NM", "NS", "Z", "PS", "PM", "PB")
BEHAVIORS = ("MG", "AO", "FO")  # move to goal, avoid obstacle, follow obstacle: the later has priority (Rule 1)
IN_DANGER = ("M", "B")

Variant = Literal["literal", "safe", "symmetric"]


class Rule(NamedTuple):
    """One rule: azimuth of the target, danger in three directions; behaviour, speed and turning rate."""

    theta_tar: str
    lddc: str
    fddc: str
    rddc: str
    behavior: str
    v: str
    w: str


def starts_fo(theta_tar: str, lddc: str, fddc: str, rddc: str) -> bool:
    """Rules 1.1.1 to 1.1.3: there is danger where the target is."""
    return {"C": fddc, "L": lddc, "R": rddc}[theta_tar] in IN_DANGER


def starts_ao(theta_tar: str, lddc: str, fddc: str, rddc: str) -> bool:
    """Rules 1.2.1 to 1.2.3: danger on both sides of a target ahead, or in front of one aside."""
    if theta_tar == "C":
        return lddc in IN_DANGER and rddc in IN_DANGER
    return fddc in IN_DANGER


def starts_mg(theta_tar: str, lddc: str, fddc: str, rddc: str) -> bool:
    """Rules 1.3.1 to 1.3.3: no danger in front, wherever the target is."""
    return fddc == "S"


STARTS = {"MG": starts_mg, "AO": starts_ao, "FO": starts_fo}


def symmetric_starts_fo(theta_tar: str, lddc: str, fddc: str, rddc: str) -> bool:
    """Rules 1.1.2 and 1.1.3, and with the target ahead danger at a side and none in front."""
    if theta_tar == "C":
        return fddc == "S" and (lddc in IN_DANGER or rddc in IN_DANGER)
    return starts_fo(theta_tar, lddc, fddc, rddc)


def symmetric_starts_ao(theta_tar: str, lddc: str, fddc: str, rddc: str) -> bool:
    """Rules 1.2.1 to 1.2.3, and danger in front of a target ahead."""
    return fddc in IN_DANGER or starts_ao(theta_tar, lddc, fddc, rddc)


SYMMETRIC_STARTS = {"MG": starts_mg, "AO": symmetric_starts_ao, "FO": symmetric_starts_fo}


def started(variant: Variant, theta_tar: str, lddc: str, fddc: str, rddc: str) -> tuple[str, ...]:
    """Return the behaviours that start here, in ascending priority (Rule 1)."""
    starts = SYMMETRIC_STARTS if variant == "symmetric" else STARTS
    return tuple(name for name, begins in starts.items() if begins(theta_tar, lddc, fddc, rddc))


def turn(behavior: str, theta_tar: str, lddc: str, fddc: str, rddc: str) -> str:
    """Rule 2, literally: N turns left, P right, by as much as the danger is."""
    if behavior == "FO":  # Rule 2.1
        return {"L": f"P{lddc}", "C": f"N{fddc}", "R": f"N{rddc}"}[theta_tar]
    if behavior == "AO":  # Rule 2.3
        return {"L": f"N{fddc}", "C": "Z", "R": f"P{fddc}"}[theta_tar]
    return {"L": f"N{rddc}", "C": "Z", "R": f"P{lddc}"}[theta_tar]  # Rule 2.2


def safe_turn(behavior: str, theta_tar: str, lddc: str, fddc: str, rddc: str) -> str:
    """Rule 2 with guards that keep FO and AO from turning to the more dangerous side."""
    left_is_worse, right_is_worse = worse(lddc, rddc), worse(rddc, lddc)
    if behavior == "FO" and theta_tar == "L":
        return "PS" if right_is_worse else f"P{worst(lddc, fddc)}"
    if behavior == "FO" and theta_tar == "R":
        return "NS" if left_is_worse else f"N{worst(rddc, fddc)}"
    if behavior == "FO" and left_is_worse:
        return f"P{fddc}"
    if behavior == "AO" and theta_tar == "C":
        return "PS" if left_is_worse else "NS" if right_is_worse else "Z"
    return turn(behavior, theta_tar, lddc, fddc, rddc)


def symmetric_turn(behavior: str, theta_tar: str, lddc: str, fddc: str, rddc: str) -> str:
    """Rule 2, and with the target ahead away from the side in more danger, before what is in front left if alike."""
    if behavior == "MG" or theta_tar != "C":
        return turn(behavior, theta_tar, lddc, fddc, rddc)
    alike = "Z" if fddc == "S" else f"N{fddc}"
    worst_of_all = worst(fddc, worst(lddc, rddc))
    return f"P{worst_of_all}" if worse(lddc, rddc) else f"N{worst_of_all}" if worse(rddc, lddc) else alike


def speed(behavior: str, theta_tar: str, lddc: str, fddc: str, rddc: str) -> str:
    """Rule 3: the more sectors in big danger, the slower."""
    big = (lddc, fddc, rddc).count("B")
    if behavior == "FO":
        return "S" if big == 0 else "VS"  # Rule 3.1
    if behavior == "AO":
        if big == 2 and theta_tar != "C":
            return "Z"  # the front and one side: it turns on the spot, where between two sides it would stand for ever
        return "S" if big == 0 else "VS"  # Rule 3.2
    return "VF" if (theta_tar, lddc, rddc) == ("C", "S", "S") else "F"  # Rule 3.3


@cache
def rule_base(variant: Variant) -> tuple[Rule, ...]:
    """Return the 81 rules of a variant, theta_tar first and RDDC last to run through its terms."""
    turning = {"literal": turn, "safe": safe_turn, "symmetric": symmetric_turn}[variant]
    made = []
    for state in itertools.product(AZIMUTHS, DANGERS, DANGERS, DANGERS):
        behavior = started(variant, *state)[-1]
        made.append(Rule(*state, behavior, speed(behavior, *state), turning(behavior, *state)))
    return tuple(made)


@compiled
def strongest_of_each(fired: FloatArray, behaviors: FloatArray, strongest: FloatArray) -> int:
    """Write how strong each behaviour's strongest rule is, and return the strongest; of equal ones that with priority.

    Args:
        fired: (n, 2) number and strength of each rule that fires.
        behaviors: (81,) whose rule each is, by its number in ``BEHAVIORS``.
        strongest: (3,) is written.
    """
    strongest[:] = 0.0
    for k in range(fired.shape[0]):
        own = int(behaviors[int(fired[k, 0])])
        strongest[own] = max(strongest[own], fired[k, 1])
    return strongest.size - 1 - int(np.argmax(strongest[::-1]))


def worse(danger: str, other: str) -> bool:
    """Return whether one danger is larger than another."""
    return DANGERS.index(danger) > DANGERS.index(other)


def worst(danger: str, other: str) -> str:
    """Return the larger of two dangers."""
    return danger if worse(danger, other) else other
