"""What a report of a multiverse is made of."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.claims import Entry
from navbench.analysis.factors import Factor
from navbench.analysis.fitting import Fit
from navbench.analysis.multiverse import Multiverse
from navbench.analysis.shares import UNKNOWN, Drawn, admissible_of, held


class Search(NamedTuple):
    """How a best reconstruction was found.

    Attributes:
        evaluations: of the search; 0 for the best of the sample.
        free: how many values it may move.
        starts: over how many of a cell each is judged at most.
    """

    evaluations: int
    free: int
    starts: int


class MultiverseResults(NamedTuple):
    """What a report of a multiverse is made of.

    Attributes:
        study: its name.
        title: its title.
        drawn: the reconstructions.
        claims: the claims, and what makes a reconstruction admissible.
        multiverse: what the study says of it.
        factors: the factors among the dimensions.
        here: the verdict of each claim in the study's own results; empty where these are not at hand.
        measured: what was measured there.
        prior: what was drawn and asked, as it was written down before.
        best: the reconstruction in which most printed numbers hold together; None where no claim prints one.
        at_best: what each claim does there, and what is measured of it.
        search: how that was found.
    """

    study: str
    title: str
    drawn: Drawn
    claims: Sequence[Entry]
    multiverse: Multiverse
    factors: Sequence[Factor]
    here: Mapping[str, str]
    measured: Mapping[str, float]
    prior: Mapping[str, Any]
    best: Fit | None
    at_best: Mapping[str, tuple[int, float]]
    search: Search

    @property
    def holds_at_best(self) -> list[str]:
        """The names of the claims that hold there."""
        found = ((entry, np.array(self.at_best.get(entry.name, (UNKNOWN,))[0])) for entry in self.claims)
        return [entry.name for entry, code in found if held(code, entry.claim)]

    @property
    def choices(self) -> dict[str, Sequence[Any]]:
        """The choices of each value that has no range."""
        choices: dict[str, Sequence[Any]] = {factor.name: factor.choices for factor in self.factors}
        return choices | {choice["name"]: choice["values"] for choice in self.prior["choices"]}

    @property
    def admissible(self) -> NDArray[np.bool_]:
        """Which reconstructions are admissible."""
        return admissible_of(self.drawn, self.claims)
