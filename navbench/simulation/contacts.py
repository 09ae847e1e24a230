"""Ends and contacts: how a robot's episode ends, and its contacts, each counted once and by what touched whom."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.records import Outcome

HAIR_RADII = 1e-6  # rounding


class Event(NamedTuple):
    """A robot's end: which one, how, why, and when [s]."""

    robot_index: int
    outcome: Outcome
    reason: str
    t_s: float


class Contacts(NamedTuple):
    """How often a robot touched something: in all, of that another robot, and of all while it stood still itself."""

    total: int = 0
    with_robots: int = 0
    standing: int = 0

    def and_one(self, reason: str, stands: bool) -> "Contacts":
        """Return these and one more, which a reason such as "hit robot 2" describes."""
        return Contacts(self.total + 1, self.with_robots + reason.startswith("hit robot"), self.standing + stands)


class ContactLedger:
    """The contacts of one episode.

    Attributes:
        counts: each robot's contacts so far.
        touching: whether each robot is held by something now.
        any_held: whether any contact lasts.
    """

    def __init__(self, robots: int) -> None:
        self.counts = [Contacts()] * robots
        self.touching = [False] * robots
        self.any_held = False
        self._held_m: list[float | None] = [None] * robots  # clearance where a robot was held

    def add(self, index: int, reason: str, robots: NDArray[np.void]) -> None:
        """Count one contact of a robot."""
        self.counts[index] = self.counts[index].and_one(reason, _stands(robots, index))

    def hold(self, hit: Mapping[int, str], robots: NDArray[np.void], radius_m: float) -> None:
        """Count those who are held now: a contact lasts until a robot is further from things than where it was held.

        Args:
            hit: what each robot touches that does.
            robots: (n,) of ``ROBOT``, where they are held.
            radius_m: every robot's hull [m].
        """
        for i, clearance_m in enumerate(robots["clearance_m"].tolist()):
            held_m = self._held_m[i]
            if i in hit:
                if held_m is None:
                    self.add(i, hit[i], robots)
                self._held_m[i] = clearance_m if held_m is None else max(held_m, clearance_m)
            elif held_m is not None and clearance_m > held_m + HAIR_RADII * radius_m:
                self._held_m[i] = None
            self.touching[i] = i in hit
        self.any_held = any(held_m is not None for held_m in self._held_m)


def _stands(robots: NDArray[np.void], index: int) -> bool:
    """Return whether a robot's wheels stood through the present substep: it did not drive into what it touches."""
    return bool(robots[index]["left_mean_mps"] == 0.0 and robots[index]["right_mean_mps"] == 0.0)
