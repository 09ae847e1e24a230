"""The sections of lei2014's report: a surface over two values, printed numbers of rules beside counted, and eq. 3."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from navbench.analysis.claims import entries
from navbench.controllers.lei2014.measures import share_of_time, share_while, turning_cases
from navbench.mathematics.statistics import Estimate
from navbench.report.described import draw_surface
from navbench.report.document import Blocks, Column
from navbench.report.figures import new_figure
from navbench.report.page import Page, Select

CONCLUSIONS = (
    "v_L = v_R: along a straight line",
    "v_L = -v_R: on the spot",
    "v_L and v_R differ: round a circle of radius R",
)
TURNING = (
    Column("printed"),
    Column("v_L", "left_mps", "m/s"),
    Column("v_R", "right_mps", "m/s"),
    Column("R by eq. 3", "radius_m", "m", 3),
    Column("gets as far as", "moved_m", "m", 4),
    Column("turns", "turned_deg", "degrees", 2),
)


def surface_2d(page: Page, *, table: str, x: str, y: str, value: str) -> Blocks:
    """Return a described value over two others, as colours with lines of equal value.

    Args:
        table: the name of the described table: a row a point of a grid.
        x: its column that is drawn to the right.
        y: its column that is drawn upwards.
        value: its column that is drawn as a colour.
    """
    described = page.stored.described(table).pivot(index=y, columns=x, values=value)
    across, up, values = described.columns.to_numpy(), described.index.to_numpy(), described.to_numpy()
    figure, axes = new_figure(1, 1, 6.0, 4.2)
    ax = axes[0, 0]
    draw_surface(ax, across, up, values, value)
    ax.set(xlabel=x, ylabel=y)
    return [page.plot(figure)]


def rule_counts(page: Page, *, claims: str, tables: Mapping[str, str]) -> Blocks:
    """Return the printed numbers of rules beside those of several described tables.

    Args:
        claims: what the ids of the claims begin with that print them, each measured by ``described_value``.
        tables: what each reading is called, and its described table.
    """
    rows = []
    for name, _, claim in entries("", page.stored.manifest["study"], stored=True):
        if name.startswith(claims) and claim.printed is not None and claim.of and "where" in claim.of:
            asked = claim.of["column"], claim.of["where"]
            counted = [page.stored.described_value(table, *asked) for table in tables.values()]
            rows.append([claim.says, claim.where, str(claim.printed), *(f"{value:g}" for value in counted)])
    return [page.table([Column("rules"), Column("where"), Column("printed"), *map(Column, tables)], rows)]


def times_in(
    page: Page,
    *,
    column: str,
    states: Mapping[str, float],
    danger: Sequence[str],
    level: float,
    windows: Mapping[str, Mapping[str, Any]],
    cells: Mapping[str, Select],
) -> Blocks:
    """Return the share of the time that a cell's robots spend in each state, beside what the paper says of it.

    Args:
        column: the column of the trajectory that holds the state.
        states: the states by their names.
        danger: columns of the trajectory, for a last row: only control periods in danger.
        level: in danger is a robot from here on, where the largest of these is that much.
        windows: of each row, what is ``printed`` and where it begins and ends: ``begin_s``, ``end_s``.
        cells: what the columns show.
    """

    def shares(measure: Callable[..., Estimate | None], cell: Select, **more: Any) -> list[float | None]:
        found = [measure(page.stored, column, [state], select=cell, **more) for state in states.values()]
        return [None if one is None else 100.0 * one.value for one in found]

    rows = []
    for says, window in windows.items():
        times = {name: window[name] for name in ("begin_s", "end_s")}
        found = [shares(share_of_time, cell, **times) for cell in cells.values()]
        rows.append([says, window["printed"], *itertools.chain(*found)])
    found = [shares(share_while, cell, danger=danger, level=level) for cell in cells.values()]
    rows.append(["in danger", None, *itertools.chain(*found)])
    heads = [Column(name, f"{cell}, {name}", decimals=0, group=cell) for cell in cells for name in states]
    return [page.table([Column("when", "when"), Column("printed", "printed"), *heads], rows)]


def turning(page: Page, *, select: Select) -> Blocks:
    """Return the three conclusions on eq. 3 beside what comes of them for a cell's robot.

    Args:
        select: one cell.
    """
    cases = turning_cases(page.robot(page.first(select)["run_id"]).track_m)
    rows = [[says, *case[:4], math.degrees(case[4])] for says, case in zip(CONCLUSIONS, cases, strict=True)]
    return [page.table(TURNING, rows)]
