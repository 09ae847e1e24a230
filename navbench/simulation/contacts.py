"""Ends and contacts: how a robot's episode ends, and its contacts, each counted once and by what touched whom."""

from typing import NamedTuple

from navbench.records import Outcome, Thing


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
