"""Sections of a report that are tables of outcomes: by cell and world, of fleets, and how reliably something works."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from navbench.analysis.fleets import fleets
from navbench.analysis.stored import reached
from navbench.mathematics.statistics import Estimate, median, share
from navbench.report.document import Blocks, Column, Data
from navbench.report.page import Page, Select

FAILED = {"collided": "collided", "timed_out": "timed out", "controller_error": "error"}


def outcomes_table(page: Page, *, cells: Mapping[str, Select], worlds: Mapping[str, str]) -> Blocks:
    """Return for some cells and worlds how many reached, and the median time and length of those.

    Args:
        cells: what each row is called, and which cells it holds.
        worlds: what each column is called, and its world.
    """
    raw, rows = [], []
    for title, select in cells.items():
        row: list[Any] = [title]
        for world in worlds.values():
            runs = page.stored.select(**select, world=world)
            good = reached(runs)
            counts = {name: int((runs["outcome"] == name).sum()) for name in FAILED}
            medians = good["time_s"].median(), good["path_length_m"].median()
            raw.append([title, world, len(runs), len(good), *counts.values(), *medians])
            failed = ", ".join(f"{n} {FAILED[name]}" for name, n in counts.items() if n)
            row += [f"{len(good)} of {len(runs)}" + (f" ({failed})" if failed else ""), *medians]
        rows.append(row)
    names = ["cells", "world", "runs", "reached", *FAILED, "time_s", "path_length_m"]
    columns = [Column("")]
    for title in worlds:
        columns += [Column("reached", group=title), Column("time", unit="s", decimals=2, group=title)]
        columns.append(Column("length", unit="m", decimals=3, group=title))
    return [page.table(columns, rows, Data(names, raw))]


FLEETS = (
    Column("", "world"),
    Column("", "label"),
    Column("all robots reached", "fleets", decimals=3, show="of"),
    Column("robots reached", "robots", decimals=3, show="of"),
    Column("makespan", "makespan_s", "s", 1),
    Column("sum of times", "sum_of_times_s", "s", 1),
    Column("contacts of robots", "robot_contacts"),
    Column("other contacts", "other_contacts"),
    Column("while standing", "standing_contacts"),
    Column("timed out", "timed_out"),
)


def fleet_table(page: Page, *, select: Select, worlds: Mapping[str, str], labels: Sequence[str]) -> Blocks:
    """Return what fleets did: all robots reached, when the last one did, and who touched whom.

    Args:
        select: which cells.
        worlds: each world's title and name.
        labels: which controllers.
    """
    rows = []
    for title, world in worlds.items():
        for label in labels:
            robots = page.stored.select(**select, world=world, label=label)
            table = fleets(robots)
            shares = [
                share(all_in.to_numpy(dtype=bool)) for all_in in (table["success"], robots["outcome"] == "reached")
            ]
            means = table[["makespan_s", "sum_of_times_s"]].mean()
            contacts = table[["robot_contacts", "other_contacts", "standing_contacts"]].sum()
            timed_out = (robots["outcome"] == "timed_out").sum()
            rows.append([title, label, *shares, *means, *contacts, timed_out])
    return [page.table(FLEETS, rows)]


ROBUST = (
    Column("", "world"),
    Column("", "label"),
    Column("all robots reached", "reached", decimals=3, show="share"),
    Column("nothing touched", "free", decimals=3, show="share"),
    Column("median least clearance", "clearance_m", "m", 3),
    Column("least of all", "clearance_least_m", "m", 3),
)


def robustness(page: Page, *, cells: Mapping[str, Select], worlds: Mapping[str, str]) -> Blocks:
    """Return for some cells and worlds the shares of episodes that succeed, and the clearance, with 95 % intervals.

    A case is an episode, whatever the number of its robots, since these are not independent of each other. Its least
    clearance is that of its robots' hulls from anything, failures included. Intervals are exact: Clopper
    and Pearson's and, for the median, the sign test's. Where there are no obstacles there is no clearance.

    Args:
        cells: what each row is called, and which cells it holds.
        worlds: each world's title and name.
    """
    rows = []
    for place, world in worlds.items():
        for title, select in cells.items():
            table = fleets(page.stored.select(**select, world=world))
            least_m = table["clearance_m"].to_numpy()
            shares = share(table["success"].to_numpy(dtype=bool)), share((table["contacts"] == 0).to_numpy())
            near: tuple[Estimate | None, float | None] = (None, None)
            if np.isfinite(least_m).all():
                near = median(least_m), float(least_m.min())
            rows.append([place, title, *shares, *near])
    return [page.table(ROBUST, rows)]
