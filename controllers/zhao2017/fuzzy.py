"""The two fuzzy controllers of Zhao and Lee: OA-FLC for obstacle avoidance and TO-FLC for target orientation.

R. Zhao, H.-K. Lee, "Fuzzy-based Path Planning for Multiple Mobile Robots in Unknown Dynamic Environment", Journal of
Electrical Engineering & Technology 12, 2017; section 3, Tables 1 and 2.

OA-FLC turns danger and its direction (R, Phi) into two wheel speeds, TO-FLC distance and direction of the target
(D, Psi), both as shares of the wheels' limit. Sets are triangles; the first and the last of a variable stay 1 out to
the ends of its range. Only Phi is a circle, on which B and RB are neighbours across 180 degrees: the foot that each
lacks stands at the other's peak.

Min for implication, max over the rules and the centroid are the usual reading of such a controller; the paper names
none. Where no rule fires, which sets without gaps exclude, both wheels stand.
"""

from typing import Any

from navbench.fuzzy.describing import Columns, columns, membership_corners
from navbench.fuzzy.inference import FuzzyInference, Term, Variable

from .sets import (
    UNIVERSES,
    First,
    Last,
    OaMemberships,
    OaRules,
    ToMemberships,
    ToRules,
    Universe,
    peaks_of,
    sets_of,
)

STAND = {"vL": 0.0, "vR": 0.0}


def oa_flc(sets: OaMemberships, rules: OaRules) -> FuzzyInference:
    """Return OA-FLC: R [s] and Phi [rad] to the left and the right wheel's share of their limit."""
    variables = {name: _variable(getattr(sets, name), universe) for name, universe in UNIVERSES.items()}
    inputs = {name: variables[name] for name in ("R_s", "Phi_rad")}
    outputs = {name: variables[name] for name in ("vL", "vR")}
    return FuzzyInference(inputs, outputs, _rules(rules), fallback=STAND)


def to_flc(peaks: ToMemberships, rules: ToRules) -> FuzzyInference:
    """Return TO-FLC: D [robot radii] and Psi [rad] to the left and the right wheel's share of their limit."""
    psi, v = UNIVERSES["Phi_rad"], UNIVERSES["vL"]
    inputs = {
        "D_radii": Variable.from_peaks(peaks.D_radii, 0.0, max(peaks.D_radii.values()), shoulders=True),
        "Psi_rad": Variable.from_peaks(peaks.Psi_rad, psi.low, psi.high, shoulders=True),
    }
    output = Variable.from_peaks(peaks.v, v.low, v.high, shoulders=True)
    return FuzzyInference(inputs, {"vL": output, "vR": output}, _rules(rules), fallback=STAND)


def described(oa: FuzzyInference, to: FuzzyInference) -> dict[str, Columns]:
    """Return tables for a report: the corners of all sets, between which they are straight, and Tables 1 and 2."""
    return {
        "memberships": membership_corners({**oa.inputs, **oa.outputs, **to.inputs, "v": to.outputs["vL"]}),
        "oa_rules": columns(("R", "Phi", "vL", "vR"), oa.rules),
        "to_rules": columns(("D", "Psi", "vL", "vR"), to.rules),
    }


def _rules(rules: OaRules | ToRules) -> list[tuple[str, str, str, str]]:
    """Return both halves of a table as one list of rules, in the order in which it is printed."""
    left, right = rules.vL, rules.vR
    return [(row, column, left[row][column], right[row][column]) for row in left for column in left[row]]


def _variable(sets: Any, universe: Universe) -> Variable:
    low, high, circular = universe
    peaks = list(peaks_of(sets).values())
    terms = {}
    for name, one in sets_of(sets).items():
        if isinstance(one, First):
            before = peaks[-1] - (high - low)
            corners = (before, one.c, one.r) if circular else (low, low, one.c, one.r)
        elif isinstance(one, Last):
            after = peaks[0] + (high - low)
            corners = (one.l, one.c, after) if circular else (one.l, one.c, high, high)
        else:
            corners = (one.l, one.c, one.r)
        terms[name] = Term("triangle" if len(corners) == 3 else "trapezoid", corners)
    return Variable(low, high, terms, circular)
