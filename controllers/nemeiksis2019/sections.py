"""The sections of nemeiksis2019's report: which agent drives where, what changes there, counts of described rows."""

from collections.abc import Mapping, Sequence

import numpy as np

from navbench.analysis.traces import spells
from navbench.controllers.nemeiksis2019.measures import change_near
from navbench.report.document import Blocks, Column, Data
from navbench.report.drawing import draw_circle, draw_world
from navbench.report.figures import new_figure
from navbench.report.page import Page, Select
from navbench.report.paths import cut, draw_pieces, number_places

NEAR = 0.03  # of a picture's width: numbers of places nearer to each other stand together
SIDE_INCHES, WORDS_INCHES = 6.0, 1.0  # the longer side of a picture of one path, and the words around it


def spells_on_path(
    page: Page,
    *,
    select: Select,
    column: str,
    values: Mapping[str, float],
    least_periods: int,
    names: Mapping[int | str, str] | None = None,
) -> Blocks:
    """Return one run's path, coloured by the value of a column, and a table of its spells.

    Args:
        select: which cells; the first episode is drawn.
        column: the column, such as the active agent.
        values: what each of its values is called.
        least_periods: shorter spells are drawn and left out of the table.
        names: what a paper calls the place where some of the spells begin, by the spell's number.
    """
    row = page.first(select)
    path = page.stored.trajectory(row)
    figure, axes = new_figure(1, 1, SIDE_INCHES, SIDE_INCHES)
    ax = axes[0, 0]
    draw_world(ax, page.stored.world(row["run_id"], row["episode"]))
    held = path[column].to_numpy()[:-1]
    draw_pieces(ax, path, {called: np.append(held == value, False) for called, value in values.items()}, 2.4)
    drives = {value: called for called, value in values.items()}
    places = {str(number): name for number, name in (names or {}).items()}  # a manifest's keys are words
    rows = [
        [places.get(str(i), i), drives[spell.value], *path[["t_s", "x_m", "y_m"]].iloc[spell.begin], spell.length]
        for i, spell in enumerate(spells(held, least_periods))
    ]
    robot = page.robot(row["run_id"])
    ratio = cut(ax, [path], robot.radius_m, square=False)
    figure.set_size_inches(SIDE_INCHES / max(ratio, 1.0) + WORDS_INCHES, SIDE_INCHES * min(ratio, 1.0) + WORDS_INCHES)
    draw_circle(ax, path["x_m"].iloc[0], path["y_m"].iloc[0], robot.radius_m)
    figure.legend(loc="outside lower center", ncols=len(values), frameon=False)
    left_m, right_m = ax.get_xlim()
    number_places(ax, [(i, x, y) for i, _, _, x, y, _ in rows[1:]], NEAR * (right_m - left_m), [path])
    begun = [Column("from t", "t_s", "s", 2), Column("x", "x_m", "m", 2), Column("y", "y_m", "m", 2)]
    columns = [Column("", "number"), Column(column, column), *begun, Column("periods", "periods")]
    return [page.plot(figure), page.table(columns, rows)]


def switching_points(
    page: Page,
    *,
    select: Select,
    column: str,
    values: Mapping[str, float],
    least_periods: int,
    at: Mapping[str, int],
    printed: Mapping[str, str],
    changing: Mapping[str, str],
    within_periods: Sequence[int],
) -> Blocks:
    """Return what a paper prints of places where a column changes its value, beside what happens there in one run.

    Args:
        select: which cells; the first episode is looked at.
        column: the column, such as the active agent.
        values: what each of its values is called.
        least_periods: shorter spells do not count.
        at: the spell that begins at each place.
        printed: what the paper prints of each place.
        changing: the columns of which the change near the place is shown, as a share of its range, by their names.
        within_periods: how many control periods before the place, and from it on, are near.
    """
    path = page.stored.trajectory(page.first(select)).iloc[:-1]
    found, drives = spells(path[column].to_numpy(), least_periods), {value: name for name, value in values.items()}
    shown = {name: path[one].to_numpy() for name, one in changing.items()}
    rows = []
    for place, number in at.items():
        begin, agents = found[number].begin, [drives[spell.value] for spell in found[number - 1 : number + 1]]
        shares = [change_near(one, begin, n) / np.ptp(one) for one in shown.values() for n in within_periods]
        rows.append([place, printed[place], " to ".join(agents), path["t_s"].iloc[begin], *shares])
    changes = [
        Column(f"{name} within {n} periods", f"{changing[name]}_{n}", decimals=2)
        for name in shown
        for n in within_periods
    ]
    told = [Column(name, name) for name in ("point", "printed", "here")]
    columns = [*told, Column("t", "t_s", "s", 2), *changes]
    return [page.table(columns, rows)]


def counts(page: Page, *, table: str, by: Sequence[str]) -> Blocks:
    """Return how often each combination of some columns of a described table comes up; the CSV holds the whole table.

    Args:
        table: the name of the described table.
        by: the columns.
    """
    described = page.stored.described(table)
    counted = described.groupby(list(by), sort=True).size().reset_index(name="count")
    columns = [Column(name.replace("_", " ")) for name in counted.columns]
    data = Data(list(described.columns), described.to_numpy(dtype=object).tolist())
    return [page.table(columns, counted.astype(str).to_numpy().tolist(), data)]
