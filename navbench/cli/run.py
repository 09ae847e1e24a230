"""One cell, or a sweep of several: composed, run side by side, and told as one table."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from navbench.cli.progress import complain
from navbench.cli.words import sort_words
from navbench.experiments.engines import in_processes, start
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    from navbench.experiments.cells import Cell
    from navbench.experiments.store import Results

DRIVING = (  # imported by processes, to run episodes and to keep them
    *("navbench.experiments.running", "navbench.experiments.warm", "navbench.simulation.bullet", "pyarrow.parquet"),
)
DRAWING = ("pandas", "navbench.report.picture", "matplotlib.figure")  # and to draw those of a sweep


def run(arguments: Sequence[str], then: Callable[["Results"], int] = lambda _: 0) -> int:
    """Run the cells that the words describe, print their table, and return the exit code.

    Args:
        arguments: the words.
        then: does more with the results, and returns an exit code.
    """
    words = sort_words(arguments, ("--config-dir", "--multirun", "--cfg", "--overwrite"))
    if words.names:
        raise DescriptionError(f"{words.names[0]}: cannot be read; a word is key=value without spaces")
    if not words.cfg and "workers=0" not in words.overrides:
        start([*DRIVING, *(DRAWING if words.multirun else ())])  # while this process imports and composes
    from navbench.cli.composing import composing
    from navbench.cli.configuration import cell_of
    from navbench.cli.engine import where_of
    from navbench.cli.flow import carry_out
    from navbench.cli.tables import print_tables
    from navbench.experiments.plan import Plan

    with composing(words.config_dir) as composer:
        if words.cfg:
            print(composer.text("run", words.overrides), end="")
            return 0
        composing_them, path = composer.command("run", words.overrides, sweep=words.multirun)
        first = next(composing_them)
        where = where_of(first.values)
        composed = [first, *composing_them]
    cells: list[Cell] = []
    wrong: dict[str, int] = {}
    for index, one in enumerate(composed):
        try:
            cells.append(cell_of(one))
        except DescriptionError as error:
            if not words.multirun:
                raise
            wrong[f"cell {index}: {error}"] = one.values["episodes"]
    for why in wrong:
        complain(why)
    if not cells:
        return 2
    again = [*arguments, *words.place(f"hydra.{'sweep' if words.multirun else 'run'}.dir", path)]

    def finish(results: "Results") -> int:
        print_tables(results, partial(in_processes, workers=where["workers"] if words.multirun else 0))
        return then(results)

    return carry_out(Plan(cells=tuple(cells)), path, again, finish, sum(wrong.values()), **where, **words.kept)
