"""Sections of a report on the tables that controllers describe: fuzzy sets and rules."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.report.document import Blocks, Column, Data
from navbench.report.figures import PALETTE, new_figure
from navbench.report.page import Page

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]

LEVELS, EXACT = 10, 9  # steps of colour, decimals
ROUNDED = 1e-4  # of an axis: its ends are printed numbers
NAMED_APART, EDGE = 0.04, 0.015  # of an axis: between the names of two sets, and from its end


def rules(page: Page, *, table: str) -> Blocks:
    """Return the rules that a controller offers of itself.

    Args:
        table: the name of the described table.
    """
    described = page.stored.described(table)
    columns = [Column(name.replace("_", " "), name) for name in described.columns]
    return [page.table(columns, described.astype(str).to_numpy().tolist())]


def rule_grid(page: Page, *, table: str, down: Sequence[str], across: Sequence[str], of: Sequence[str]) -> Blocks:
    """Return rules that a controller offers of itself as a grid, as papers print them; the CSV holds them as a list.

    Args:
        table: the name of the described table, a row a rule.
        down: the inputs whose terms stand in front of the rows.
        across: the inputs whose terms stand above the columns.
        of: what the rules conclude; of several the grids stand below each other.
    """
    described = page.stored.described(table)
    told = described.astype(str).to_dict("records")
    heads = dict.fromkeys(tuple(rule[name] for name in across) for rule in told)
    grid: dict[tuple[str, ...], dict[tuple[str, ...], str]] = {}
    for output in of:
        for rule in told:
            row = ((output,) if len(of) > 1 else ()) + tuple(rule[name] for name in down)
            grid.setdefault(row, {})[tuple(rule[name] for name in across)] = rule[output]
    named = [Column(name.replace("_", " ")) for name in (["output"] if len(of) > 1 else []) + list(down)]
    above = ", ".join(name.replace("_", " ") for name in across)
    columns = [*named, *(Column(f"{above} = {', '.join(terms)}") for terms in heads)]
    rows = [[*row, *(cells.get(terms, "–") for terms in heads)] for row, cells in grid.items()]
    return [page.table(columns, rows, Data(list(described.columns), described.to_numpy(dtype=object).tolist()))]


def memberships(page: Page, *, table: str, axes: Mapping[str, Mapping[str, Any]]) -> Blocks:
    """Return the fuzzy sets that a controller offers of itself, a panel per variable.

    Args:
        table: the name of the described table: variable, term, x, degree at the sets' corners.
        axes: for each variable its ``title``, and the ``low`` and ``high`` end of what is shown; ``circle`` where
            these are one direction, so that a set that leaves at one comes in at the other; ``saturates`` where values
            beyond the sets belong to the outermost; ``degrees`` where the sets' radians are shown in degrees, as the
            ends are then given.
    """
    described = page.stored.described(table)
    figure, panels = new_figure(len(axes), 1, 8.0, 1.9)
    for ax, (variable, axis) in zip(panels.ravel(), axes.items(), strict=True):
        draw_sets(ax, described[described["variable"] == variable], axis)
    return [page.plot(figure)]


def draw_sets(ax: "Axes", sets: "pd.DataFrame", axis: Mapping[str, Any]) -> None:
    """Draw the fuzzy sets of one variable.

    Args:
        ax: where to draw.
        sets: term, x, degree at the sets' corners, of one term after the other.
        axis: as of ``memberships``.
    """
    tops: list[tuple[float, str, str]] = []
    near = ROUNDED * (axis["high"] - axis["low"])
    for i, (term, corners) in enumerate(sets.groupby("term", sort=False)):
        color = PALETTE[i % len(PALETTE)]
        for x, degree in _shapes(corners, axis):
            ax.plot(x, degree, color=color, linewidth=1.4)
            top = x[degree > degree.max() - 1e-9]
            if top.max() >= axis["low"] - near and top.min() <= axis["high"] + near:
                low, high = top.clip(axis["low"], axis["high"])[[0, -1]]
                tops.append((0.5 * (low + high), str(term), color))
    _name_sets(ax, tops, axis["low"], axis["high"])
    ax.set(xlim=(axis["low"], axis["high"]), ylim=(0.0, 1.3), xlabel=axis["title"], ylabel="degree")
    ax.set_yticks([0.0, 0.5, 1.0])


def draw_surface(ax: "Axes", across: FloatArray, up: FloatArray, values: FloatArray, label: str) -> None:
    """Draw a value over two others, as colours with lines of equal value.

    Args:
        ax: where to draw.
        across: (n,) to the right.
        up: (m,) upwards.
        values: (m, n).
        label: what the value is called.
    """
    values = np.round(values, EXACT)  # a plateau's rounding errors would be drawn as lines
    filled = ax.contourf(across, up, values, levels=LEVELS, cmap="viridis")
    lines = ax.contour(across, up, values, levels=filled.levels, colors="white", linewidths=0.6)
    ax.clabel(lines, fontsize=8)
    ax.figure.colorbar(filled, ax=ax, label=label)


def _shapes(corners: "pd.DataFrame", axis: Mapping[str, Any]) -> list[tuple[Any, Any]]:
    """Return a set's corners as (x, degree): on a circle also a turn before and behind, lest it break off at an end."""
    x, degree = corners["x"].to_numpy(), corners["degree"].to_numpy()
    x = np.degrees(x) if axis.get("degrees") else x
    if axis.get("saturates") and degree[0] == 1.0:
        x, degree = np.append(min(x[0], axis["low"]), x), np.append(1.0, degree)
    if axis.get("saturates") and degree[-1] == 1.0:
        x, degree = np.append(x, max(x[-1], axis["high"])), np.append(degree, 1.0)
    turn = axis["high"] - axis["low"]
    return [(x + shift, degree) for shift in ((-turn, 0.0, turn) if axis.get("circle") else (0.0,))]


def _name_sets(ax: "Axes", tops: Sequence[tuple[float, str, str]], low: float, high: float) -> None:
    """Write each set's name over its top: within the frame, and higher where it would cover the one before."""
    before, raised = -math.inf, False
    for x, term, color in sorted(tops):
        raised = not raised and x - before < NAMED_APART * (high - low)
        side = "left" if x - low < EDGE * (high - low) else "right" if high - x < EDGE * (high - low) else "center"
        offset = {"left": 2, "right": -2, "center": 0}[side], 13 if raised else 3
        ax.annotate(term, (x, 1.0), offset, textcoords="offset points", ha=side, color=color, fontsize=9)
        before = x
