"""The four fuzzy blocks of Nemeiksis and Osadcuks: their sets, their rule tables, and how many rules they save.

1FB turns away from an obstacle ahead, 2FB keeps a wall at its distance, 3FB turns to the destination; each answers with
a turning angle mu, positive to the left. 4FB turns the active one's mu and the distance to the destination into the
average speed, here as a share of V_max. All four are Mamdani's method with the weight centre, as printed.

The figures with the memberships carry no numbers that could be read here, so all peaks are assumed, as are the two
sets of distances: 2FB's must be narrow, or the wall's distance would have a dead zone wider than the printed band.
"""

import itertools
import math
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic.dataclasses import dataclass

from navbench.compiled import compiled
from navbench.contract import FloatArray
from navbench.fuzzy.describing import Columns, columns, membership_corners
from navbench.fuzzy.inference import FuzzyInference, Table, Term, Variable, infer, rules_from_table
from navbench.validation import STRICT, Number, Positive, describe, remembered

DISTANCES = ("C", "MD", "MF", "F")
TURNS = ("BSR", "MSR", "SSR", "Z", "SSL", "MSL", "BSL")
BEARINGS = ("FR", "MFR", "CR", "Z", "CL", "MFL", "FL")
SPEEDS = ("Z", "S", "M", "H")
BLOCKS_OF = {  # which blocks are evaluated together; 2FB has as many rules on either side
    "destination agent drives": ("3FB", "4FB"),
    "wall agent drives": ("2FB, left", "4FB"),
    "obstacle agent drives": ("1FB", "4FB"),
    "each act here": ("1FB", "2FB, left", "3FB", "4FB"),
}

TABLE_2: Table = {  # 1FB: by d_s4, then d_s2 down and d_s3 across
    "C": {
        "C": ["BSR", "BSR", "BSR", "BSR"],
        "MD": ["BSR", "BSR", "BSR", "BSR"],
        "MF": ["BSR", "BSR", "BSR", "BSR"],
        "F": ["BSR", "BSR", "BSR", "BSR"],
    },
    "MD": {
        "C": ["BSR", "BSR", "BSR", "BSR"],
        "MD": ["BSR", "BSR", "BSR", "BSR"],
        "MF": ["BSR", "BSR", "MSR", "MSR"],
        "F": ["BSR", "BSR", "MSR", "MSR"],
    },
    "MF": {
        "C": ["BSR", "BSR", "BSR", "BSR"],
        "MD": ["BSR", "BSR", "BSR", "BSR"],
        "MF": ["BSR", "MSR", "MSR", "MSR"],
        "F": ["BSR", "MSR", "MSR", "SSR"],
    },
    "F": {
        "C": ["BSR", "BSR", "BSR", "BSR"],
        "MD": ["BSR", "BSR", "BSR", "BSR"],
        "MF": ["BSR", "MSR", "MSR", "MSR"],
        "F": ["BSR", "MSR", "SSR", "Z"],
    },
}
TABLE_3_RIGHT: Table = {  # 2FB, tracked from the right: d_s6 down, d_s5 across
    "C": ["SSL", "SSR", "MSR", "MSR"],
    "MD": ["SSL", "Z", "SSR", "MSR"],
    "MF": ["MSL", "SSL", "SSR", "MSR"],
    "F": ["MSL", "MSL", "Z", "MSR"],
}
TABLE_3_LEFT: Table = {  # 2FB, tracked from the left: d_s10 down, d_s1 across
    "C": ["SSR", "SSL", "MSL", "MSL"],
    "MD": ["SSR", "Z", "SSL", "MSL"],
    "MF": ["MSR", "SSR", "SSL", "MSL"],
    "F": ["MSR", "MSR", "Z", "MSL"],
}
TABLE_4: Table = {"FL": "BSL", "MFL": "MSL", "CL": "SSL", "Z": "Z", "CR": "SSR", "MFR": "MSR", "FR": "BSR"}  # 3FB
TABLE_5: Table = {  # 4FB: mu down, d_destination (C, MD, MF, F) across
    "BSL": ["Z", "Z", "S", "M"],
    "MSL": ["Z", "Z", "S", "M"],
    "SSL": ["Z", "S", "M", "H"],
    "Z": ["Z", "S", "M", "H"],
    "SSR": ["Z", "S", "M", "H"],
    "MSR": ["Z", "Z", "S", "M"],
    "BSR": ["Z", "Z", "S", "M"],
}


@compiled
def answer(block: FloatArray, inputs: tuple[float, ...], work: FloatArray) -> float:
    """Return what a block answers to its inputs, NaN if one is.

    Args:
        block: a block's ``FuzzyInference.base``.
        inputs: in the order of the block's variables.
        work: (4,) is written.
    """
    for i in range(len(inputs)):
        work[i] = inputs[i]
    infer(block, work, work[3:])
    crisp: float = work[3]
    return crisp


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Peaks:
    """Where each fuzzy set has its peak, from the lowest to the highest; a set's feet are its neighbours' peaks.

    Attributes:
        bypass_distance_m: of a reading in 1FB; nearer than the first and further than the last changes nothing [m].
        tracking_distance_m: of a reading in 2FB, likewise [m].
        destination_bearing_rad: of the destination's bearing in 3FB, positive to the left [rad].
        bearing_limit_rad: to either side, its last sets stay 1 up to here [rad].
        turn_rad: of mu, positive to the left [rad].
        turn_limit_rad: to either side, mu's last sets stay 1 up to here and end [rad].
        destination_distance_m: of the distance to the destination in 4FB, from 0 [m].
        speed_share: of the average speed over V_max. All four sets are whole triangles, so that the weight centre of
            the first and of the last one is its peak.
    """

    bypass_distance_m: Mapping[str, Positive]
    tracking_distance_m: Mapping[str, Positive]
    destination_bearing_rad: Mapping[str, Number]
    bearing_limit_rad: Positive
    turn_rad: Mapping[str, Number]
    turn_limit_rad: Positive
    destination_distance_m: Mapping[str, Number]
    speed_share: Mapping[str, Number]

    def __post_init__(self) -> None:
        """Check names, order and range."""
        for name, needed, limit in (
            ("bypass_distance_m", DISTANCES, math.inf),
            ("tracking_distance_m", DISTANCES, math.inf),
            ("destination_bearing_rad", BEARINGS, self.bearing_limit_rad),
            ("turn_rad", TURNS, self.turn_limit_rad),
            ("destination_distance_m", DISTANCES, math.inf),
            ("speed_share", SPEEDS, math.inf),
        ):
            peaks = getattr(self, name)
            values = list(peaks.values())
            if tuple(peaks) != needed:
                raise ValueError(f"{name}: must name the sets {', '.join(needed)}, in this order")
            if any(after <= before for before, after in itertools.pairwise(values)):
                raise ValueError(f"{name}: must ascend from the first set to the last, not {values}")
            if max(map(abs, values)) > limit:
                raise ValueError(f"{name}: must lie within the limit, {limit} to either side, not {values}")
        for name in ("destination_distance_m", "speed_share"):
            if min(getattr(self, name).values()) < 0.0:
                raise ValueError(f"{name}: must not be negative")


class FuzzyBlocks:
    """The four blocks.

    Attributes:
        bypass: 1FB, from d_s4, d_s2 and d_s3 [m] to mu_1 [rad].
        track_left: 2FB of a wall on the left, from d_s10 and d_s1 [m] to mu_2 [rad].
        track_right: 2FB of a wall on the right, from d_s6 and d_s5 [m] to mu_2 [rad].
        approach: 3FB, from the destination's bearing [rad] to mu_3 [rad].
        speed: 4FB, from mu [rad] and d_destination [m] to the average speed as a share of V_max.
    """

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        """Check the peaks and build the blocks.

        Args:
            parameters: a value for each field of ``Peaks``.

        Raises:
            ValueError: a key is unknown or missing, or a set is missing, out of order or out of range.
        """
        peaks = describe(Peaks, parameters, "blocks")
        near, along = _distance(peaks.bypass_distance_m), _distance(peaks.tracking_distance_m)
        bearing = _angle(peaks.destination_bearing_rad, peaks.bearing_limit_rad)
        turn = _angle(peaks.turn_rad, peaks.turn_limit_rad)
        self.bypass = _block(TABLE_2, {"d_s4": near, "d_s2": near, "d_s3": near}, {"mu_1": turn})
        self.track_left = _block(TABLE_3_LEFT, {"d_s10": along, "d_s1": along}, {"mu_2": turn})
        self.track_right = _block(TABLE_3_RIGHT, {"d_s6": along, "d_s5": along}, {"mu_2": turn})
        self.approach = _block(TABLE_4, {"bearing": bearing}, {"mu_3": turn})
        distance, speed = _distance(peaks.destination_distance_m), _whole_triangles(peaks.speed_share)
        self.speed = _block(TABLE_5, {"mu": turn, "d_destination": distance}, {"V_avg": speed})

    def by_name(self) -> dict[str, FuzzyInference]:
        """Return the blocks by what the paper calls them, in the order of the class's docstring."""
        return {
            "1FB": self.bypass,
            "2FB, left": self.track_left,
            "2FB, right": self.track_right,
            "3FB": self.approach,
            "4FB": self.speed,
        }

    def describe(self) -> dict[str, Columns]:
        """Return tables for a report: memberships (Figs 2, 3, 5, 6), the rules of each block, and their complexity.

        A variable that several blocks share is called after its first one: d_s4 for the readings of 1FB, d_s10 for
        those of 2FB, mu_1 for every turning angle.
        """
        shown = {
            "d_s4": self.bypass.inputs["d_s4"],
            "d_s10": self.track_left.inputs["d_s10"],
            "bearing": self.approach.inputs["bearing"],
            "mu_1": self.bypass.outputs["mu_1"],
            "d_destination": self.speed.inputs["d_destination"],
            "V_avg": self.speed.outputs["V_avg"],
        }
        tables = {"memberships": membership_corners(shown)}
        for name, block in self.by_name().items():
            rules = columns((*block.inputs, *block.outputs), block.rules)
            tables[f"rules_{name.replace(', ', '_').lower()}"] = rules
        return {**tables, "complexity": self.complexity()}

    def complexity(self) -> Columns:
        """Return how many inputs and rules the blocks have, and one flat rule base in their place would have.

        A complete flat rule base has a rule for each combination of its inputs' sets. The smaller of the two flat
        ones takes only what the blocks take, each reading once with the sets that its block gives it; mu, which passes
        from one block to the next, is no input of it. The other one takes the three rear sensors too, which the paper
        feeds to 1FB, and is what the switch unit's ten sensors and the destination come to.

        Of several blocks, ``inputs`` is the most that one of them takes, and ``rules`` their sum: of those that the
        paper evaluates while an agent drives, of those that are evaluated in each act here, where the other agents'
        angles are traced too, and of all. Of an input no more than two sets overlap, so that ``fire_at_most`` rules
        have a strength at once.
        """
        blocks = self.by_name()
        rows = [(name, *_size([block])) for name, block in blocks.items()]
        for together, names in BLOCKS_OF.items():
            rows.append((together, *_size([blocks[name] for name in names])))
        rows.append(("all blocks", *_size(blocks.values())))
        sets = {
            key: len(variable.terms)
            for block in blocks.values()
            for key, variable in block.inputs.items()
            if key != "mu"
        }
        with_rear = sets | {f"d_s{sensor}": len(DISTANCES) for sensor in (7, 8, 9)}
        for name, flat in (("one flat block", sets), ("one flat block, with the rear", with_rear)):
            rows.append((name, len(flat), math.prod(flat.values()), 2 ** len(flat)))
        return columns(("block", "inputs", "rules", "fire_at_most"), rows)


@remembered
def fuzzy_blocks(parameters: Mapping[str, Any]) -> FuzzyBlocks:
    """Return the blocks for a value for each field of ``Peaks``; raises as ``FuzzyBlocks`` does."""
    return FuzzyBlocks(parameters)


def _size(blocks: Iterable[FuzzyInference]) -> tuple[int, int, int]:
    """Return of some blocks the most inputs of one, all rules, and how many of these have a strength at once."""
    together = list(blocks)
    inputs = [len(block.inputs) for block in together]
    return max(inputs), sum(len(block.rules) for block in together), sum(2**count for count in inputs)


def _block(table: Table, inputs: Mapping[str, Variable], outputs: Mapping[str, Variable]) -> FuzzyInference:
    rules = rules_from_table(table, inputs, outputs)
    return FuzzyInference(inputs, outputs, rules, fallback=dict.fromkeys(outputs, 0.0))  # a rule always fires


def _distance(peaks: Mapping[str, float]) -> Variable:
    """Return a distance: what lies beyond the last peak is as far."""
    return Variable.from_peaks(peaks, 0.0, max(peaks.values()), shoulders=True)


def _angle(peaks: Mapping[str, float], limit_rad: float) -> Variable:
    return Variable.from_peaks(peaks, -limit_rad, limit_rad, shoulders=True)


def _whole_triangles(peaks: Mapping[str, float]) -> Variable:
    """Return an output whose first and last sets are as wide outside their peaks as inside."""
    at = list(peaks.values())
    feet = [2.0 * at[0] - at[1], *at, 2.0 * at[-1] - at[-2]]
    terms = {name: Term("triangle", tuple(feet[i : i + 3])) for i, name in enumerate(peaks)}
    return Variable(feet[0], feet[-1], terms)
