"""Specification curves: what all reconstructions measure for a claim, sorted, over the values that decide it."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.analysis.printed import quantity, tolerated
from navbench.analysis.shares import Drawn, Shares
from navbench.report.figures import PALETTE
from navbench.report.shares import sorted_choices, word_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FACTORS_MAX = 3  # under a curve
POINTS = 256  # of a curve, each the median of its slice of the sorted reconstructions
COLUMNS, ROWS = 64, 8  # of the map of a value: slices of the sorted reconstructions, and of its range
VALUES_MIN = 16  # different ones that make a curve
SHADED = 3.0  # times as often as by chance: black
WORD_MAX = 9  # characters of a choice that is written beside its row

FloatArray = NDArray[np.float64]


def has_curve(drawn: Drawn, claim: str) -> bool:
    """Return whether what is measured for a claim takes enough different values for a curve."""
    values = drawn.rows[f"value:{claim}"].to_numpy(np.float64)
    return len(np.unique(values[np.isfinite(values)])) >= VALUES_MIN


def specification(
    drawn: Drawn, shares: Sequence[Shares], choices: Mapping[str, Sequence[Any]], ends: Mapping[str, Sequence[float]],
    here: Mapping[str, float],
) -> "Figure":  # fmt: skip
    """Return for each claim the sorted values of all reconstructions, and below where in its range each value is there.

    Args:
        drawn: the sample.
        shares: of the claims, each with values that ``has_curve`` finds enough.
        choices: those of each value that has no range, by its name.
        ends: of each value's range.
        here: what the study's own results measure, by the claims' names.
    """
    from matplotlib.figure import Figure

    columns = min(2, len(shares))
    rows = math.ceil(len(shares) / columns)
    figure = Figure(figsize=(4.6 * columns, 4.2 * rows), layout="constrained")
    parts = figure.subfigures(rows, columns, squeeze=False).ravel()
    for part, one in zip(parts, shares, strict=False):
        names = _deciding(one)
        grid = part.subplots(1 + len(names), 1, sharex=True, height_ratios=[2.4, *[1.0] * len(names)], squeeze=False)
        (top, *strips) = grid[:, 0]
        values = drawn.rows[f"value:{one.claim.name}"].to_numpy(np.float64)
        known = np.flatnonzero(np.isfinite(values))
        order = known[np.argsort(values[known], kind="stable")]
        _curve(top, one, values[order], drawn.holds(one.claim).ravel()[order], here.get(one.claim.name, math.nan))
        for axes, name in zip(strips, names, strict=True):
            _map(axes, drawn.u[order, list(drawn.names).index(name)], name, choices.get(name, ()), ends.get(name, ()))
        strips[-1].set_xlabel(f"reconstructions with a case, sorted ({len(order)} of {len(values)})", fontsize=7)
    lines = {line.get_label(): line for part in parts for line in part.axes[0].lines if line.get_label()[0] != "_"}
    figure.legend(lines.values(), lines.keys(), loc="outside lower center", ncols=4, fontsize=7, frameon=False)
    return figure


def _deciding(one: Shares) -> list[str]:
    """Return what decides a claim: what tells most of it, then what most often turns it when it alone is moved."""
    assert one.bits is not None
    turning = [name for name, often in one.flips.items() if often.low > 0.0]
    return list(dict.fromkeys([one.bits[0], *turning, *map(str, (one.pair or ())[:2])]))[:FACTORS_MAX]


def _curve(axes: "Axes", one: Shares, values: FloatArray, holds: NDArray[np.bool_], here: float) -> None:
    claim = one.claim.claim
    slices = np.array_split(np.arange(len(values)), min(POINTS, len(values)))
    x = np.array([of.mean() for of in slices]) / max(len(values) - 1, 1)
    y = np.array([np.median(values[of]) for of in slices])
    most = np.array([holds[of].mean() > 0.5 for of in slices])
    words = {True: (PALETTE[2], "it holds in most of these"), False: ("#888888", "in half or fewer")}
    for is_so, (colour, word) in words.items():
        axes.plot(np.where(most == is_so, x, np.nan), y, ".", color=colour, ms=3, label=word)
    if claim.printed is not None:
        number, unit = quantity("printed", claim.printed)
        axes.set_ylabel(unit, fontsize=7)
        axes.axhspan(*tolerated(claim.printed, claim.within), color="#e3f1ea", zorder=0)
        axes.axhline(number, color="#222222", lw=0.8, label="printed, with its tolerance")
    axes.axhline(here, color=PALETTE[1], lw=0.9, ls="--", label="the study's own results")
    axes.set_title(one.claim.name, fontsize=8)
    axes.tick_params(labelsize=7)


def _map(axes: "Axes", u: FloatArray, name: str, choices: Sequence[Any], ends: Sequence[float]) -> None:
    """Draw how often a value lies where in its range, or has which choice, along the sorted reconstructions.

    The shade is the same in all maps: that of chance is a third of black.
    """
    count = len(choices) or ROWS
    places = np.minimum((u * count).astype(int), count - 1)
    slices = np.array_split(places, COLUMNS)
    order = sorted_choices(choices) if choices else range(count)
    table = np.stack([np.bincount(of, minlength=count) / max(len(of), 1) for of in slices], axis=1)
    black, extent = min(1.0, SHADED / count), (0.0, 1.0, 0.0, 1.0)
    axes.imshow(table[list(order)], origin="lower", aspect="auto", extent=extent, cmap="Greys", vmin=0.0, vmax=black)
    words = [word_of(choices[k]) for k in order] if choices else []
    if len(ends) == 2:
        axes.set_yticks([0.0, 1.0], [f"{end:g}" for end in ends])
    elif words and max(map(len, words)) <= WORD_MAX:
        axes.set_yticks((np.arange(count) + 0.5) / count, words)
    else:
        axes.set_yticks([0.5 / count, 1.0 - 0.5 / count], ["1", str(count)])
    axes.set_title(name, fontsize=7, loc="left", pad=3)
    axes.tick_params(labelsize=6)
