"""Ends and contacts: how a robot's episode ends, and its contacts, each counted once and by what touched whom."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.records import Outcome, Thing

ROUNDING_RADII = 1e-6


class Event(NamedTuple):
    """A robot's end: which one, how, what it hit if it did, and when [s]."""

    robot_index: int
    outcome: Outcome
    hit: Thing | None
    t_s: float


class Contacts(NamedTuple):
    """How often a robot touched something: in all, of that another robot, and of all while it stood still itself."""

    total: int = 0
    with_robots: int = 0
    standing: int = 0

    def plus(self, thing: Thing, stands: bool) -> "Contacts":
        """Return these and one more, with that thing."""
        return Contacts(self.total + 1, self.with_robots + (thing.kind == "robot"), self.standing + stands)


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

    def add(self, index: int, thing: Thing, robots: NDArray[np.void]) -> None:
        """Count one contact of a robot, which stands if its wheels did through the present substep."""
        robot = robots[index]
        stands = bool(robot["left_mean_mps"] == 0.0 and robot["right_mean_mps"] == 0.0)
        self.counts[index] = self.counts[index].plus(thing, stands)

    def hold(self, hit: Mapping[int, Thing], robots: NDArray[np.void], radius_m: float) -> None:
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
            elif held_m is not None and clearance_m > held_m + ROUNDING_RADII * radius_m:
                self._held_m[i] = None
            self.touching[i] = i in hit
        self.any_held = any(held_m is not None for held_m in self._held_m)
