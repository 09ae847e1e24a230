"""Named random streams: every source of chance is named by what it is for, never by the controller that meets it."""

import hashlib
from functools import lru_cache
from typing import Any

import numpy as np


def stream(seed: int, world: str, episode: int, role: str, robot_index: int = 0) -> np.random.Generator:
    """Return the generator of one named stream.

    All controllers meet the same starts, layouts and noise, because nothing of the controller enters the name.

    Args:
        seed: the run's seed, >= 0.
        world: the world's configuration name.
        episode: the episode's index, >= 0.
        role: what the stream is for, such as "start", "range", "odometry" or "layout".
        robot_index: which robot of the world, >= 0.
    """
    words: Any = [seed, *_words(world), episode, *_words(role), robot_index]
    if max(seed, episode) < 2**32:
        words = np.array(words, np.uint32)  # of which numpy makes the same in a third of the time
    return np.random.default_rng(np.random.SeedSequence(words))


@lru_cache(maxsize=1000)
def _words(name: str) -> list[int]:
    """Return the SHA-256 of a name as eight 32-bit words."""
    words: list[int] = np.frombuffer(hashlib.sha256(name.encode()).digest(), ">u4").tolist()
    return words
