"""One cell, or a sweep of several: composed, run side by side, and told as one table."""

from collections.abc import Sequence
from functools import partial

from navbench.cli.composing import composing
from navbench.cli.configuration import cell_of
from navbench.cli.flow import carry_out
from navbench.cli.progress import complain
from navbench.cli.tables import print_tables
from navbench.cli.words import sort_words
from navbench.experiments.cells import Cell
from navbench.experiments.engines import in_processes, start
from navbench.experiments.plan import Plan
from navbench.validation import DescriptionError

IMPORTED = (  # by processes, to run episodes, to keep them and to draw them
    *("navbench.experiments.cells", "navbench.experiments.running", "pyarrow.parquet", "pandas"),
    *("navbench.report.picture", "matplotlib.figure"),
)


def run(arguments: Sequence[str]) -> int:
    """Run the cells that the words describe, print their table, and return the exit code."""
    words = sort_words(arguments, ("--config-dir", "--multirun", "--cfg", "--overwrite"))
    with composing(words.config_dir) as composer:
        if words.names:
            raise DescriptionError(f"{words.names[0]}: cannot be read; a word is key=value without spaces")
        if words.cfg:
            print(composer.text("run", words.overrides), end="")
            return 0
        composing_them, path = composer.command("run", words.overrides, sweep=words.multirun)
        first = next(composing_them)
        if words.multirun and not path.exists():
            start(IMPORTED, first.values["workers"])  # while the others are composed
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
    workers = first.values["workers"]
    options = {"workers": workers, **words.kept}
    finish = partial(print_tables, each=partial(in_processes, workers=workers))
    return carry_out(Plan(cells=tuple(cells)), path, again, finish, sum(wrong.values()), **options)
