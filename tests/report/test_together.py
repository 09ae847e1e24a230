"""What a multiverse's report says of the reconstruction in which most printed numbers hold together."""

from typing import cast

import numpy as np
import pytest

from navbench.analysis.claims import Claim, Entry
from navbench.analysis.fitting import Fit
from navbench.report.multiverse_results import MultiverseResults, Search
from navbench.report.together import together


class Results:
    """Those of which the sentence tells."""

    def __init__(self, holds_at_best: list[str], evaluations: int = 0) -> None:
        self.search, self.holds_at_best = Search(evaluations, 3, 30), holds_at_best


def best_of(*holds: bool, placebos: tuple[int, ...] = (1, 1, 2)) -> Fit:
    claims = tuple(Entry(name, "claim", Claim(says="", printed=1.0, within=0.1)) for name in "abc"[: len(holds)])
    nothing = np.full(len(holds), np.nan)
    return Fit(
        claims=claims, u=np.zeros(1), values=nothing, holds=np.array(holds), predicted=nothing,
        predicts=np.zeros(len(holds), bool), placebos=np.array(placebos), printed=nothing,
    )  # fmt: skip


def sentence(results: Results, best: Fit) -> str:
    return together(cast(MultiverseResults, results), best)


def test_what_holds_by_the_median_of_starts_that_scatter_too_far_is_counted_apart() -> None:
    assert "2 of 3 printed numbers hold at once; of 3 placebo" in sentence(
        Results(["a", "b"]), best_of(True, True, False)
    )
    said = sentence(Results(["a"]), best_of(True, True, False))
    assert "hold at once, 1 of them by the median of starts that scatter by more than the tolerance; of 3" in said


@pytest.mark.parametrize(
    ("placebos", "says"),
    [((0, 1, 1), "fits the paper better than chance"), ((1, 2, 3), "as many hold in 2 of these, so that it fits")],
)
def test_as_many_in_one_placebo_table_are_hardly_better_than_chance(placebos: tuple[int, ...], says: str) -> None:
    assert says in sentence(Results(["a", "b"], 32), best_of(True, True, False, placebos=placebos))
