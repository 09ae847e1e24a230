"""Which cells are drawn where there are more than a picture can hold."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from navbench.records import NOT_DRIVEN

if TYPE_CHECKING:
    import pandas as pd


class Sample(NamedTuple):
    """The runs that are drawn, and where these are not all, a sentence on which they are."""

    runs: list[str]
    says: str


def sample_of(runs: Sequence[str], episodes: "pd.DataFrame", most: int) -> Sample:
    """Return so many of some runs at most: all, or of more those with failures before the others.

    Args:
        runs: the run_ids.
        episodes: the table of their episodes.
        most: how many.
    """
    if len(runs) <= most:
        return Sample(list(runs), "")
    with_failures = {*episodes.loc[~episodes["outcome"].isin(["reached", *NOT_DRIVEN]), "run_id"]}
    failed = [run for run in runs if run in with_failures]
    others = [run for run in runs if run not in with_failures]
    first = _evenly(failed, most)
    rest = _evenly(others, most - len(first))
    of = f"{len(first)} of {len(failed)} with failures and {len(rest)} of {len(others)} without"
    return Sample([*first, *rest], f"{most} of {len(runs)} cells, taken evenly: {of}")


def _evenly(runs: Sequence[str], most: int) -> list[str]:
    """Return so many of some runs at most, at even distances."""
    count = min(most, len(runs))
    return [runs[i * len(runs) // count] for i in range(count)]
