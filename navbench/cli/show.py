"""One picture of one thing: an episode, a controller, a world, a robot or a sensor suite."""

import re
import webbrowser
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from navbench.cli.composing import key_of
from navbench.cli.limits import check_directory
from navbench.cli.progress import complain, tell
from navbench.cli.words import sort_words
from navbench.records import NOT_DRIVEN
from navbench.validation import DescriptionError, instead

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from navbench.analysis.stored import StoredResults
    from navbench.experiments.store import Results

HELP = """navbench show DIR [episode=K] [robot=I]: draw one episode of a results directory of a run, a sweep or a study
navbench show controller=NAME world=NAME [episodes=N]: run them, and draw the first episode in which a robot failed
navbench show controller=NAME: draw its fuzzy sets, control surfaces and rules, its ring, and list its parameters
navbench show world=NAME [seed=S] [episodes=6]: draw the layouts of that many episodes
navbench show robot=NAME: draw its body and wheels
navbench show sensors=NAME: draw where its rays begin, where they look, and how far

  episode=K                                         which episode; without it the first in which a robot failed
  robot=I                                           one robot in front of the others, which are grey, and its trace
  run_id=ID name=NAME label=LABEL world=NAME controller=NAME
                                                    which cell, where there are several; ID may be cut short
  out=FILE.png|FILE.svg                             where to; default a name in this directory that says what it is
  --open                                            show it with the system's viewer
  --config-dir DIR                                  your own controllers, worlds, robots and sensors
  KEY=VALUE                                         as of a run, where no directory is named, such as robot=disc4
"""
CELL = ("run_id", "name", "label", "world")  # what chooses a cell
CHOOSING = (*CELL, "controller")  # and what does where each controller has one label
OF_RUN = ("episode", "robot", *CHOOSING)
SUBJECTS = ("controller", "world", "robot", "sensors")
LISTED_MAX = 6  # cells in a message
FORMS = (".png", ".svg")


class Shown(NamedTuple):
    """A picture, what the file is called where nobody says, and a line that says what it shows."""

    figure: "Figure"
    stem: str
    says: str


def show(arguments: Sequence[str]) -> int:
    """Draw what the words name, and return the exit code."""
    words = sort_words(arguments, ("--config-dir", "--open"))
    own = [word for word in words.overrides if not word.startswith("out=")]
    out = next((word.removeprefix("out=") for word in words.overrides if word.startswith("out=")), "")
    if out and Path(out).suffix not in FORMS:
        raise DescriptionError(f"out={out}: must end in {' or '.join(FORMS)}")
    if len(words.names) > 1:
        raise DescriptionError(f"show {' '.join(words.names)}: name one results directory")
    keep = partial(_keep, out=out, view=words.open)
    if words.names:
        return keep(_of_run(Path(words.names[0]), own))
    subjects = [key_of(word) for word in own if key_of(word) in SUBJECTS]
    if {"controller", "world"} <= {*subjects}:
        from navbench.cli.run import run

        folder = ["--config-dir", words.config_dir] if words.config_dir else []
        return run([*own, *folder], lambda results: keep(_of_results(results)))
    if not subjects:
        raise DescriptionError("show: name a results directory, or one of controller=, world=, robot=, sensors=")
    from navbench.cli.shown import draw_named

    return keep(Shown(*draw_named(subjects[0], own, words.config_dir)))


def _keep(shown: Shown, out: str, view: bool) -> int:
    """Save a picture, say where it is, open it where that is wanted, and return the exit code."""
    from navbench.report.figures import save_whole

    file = Path(out) if out else Path(f"{_file_name(shown.stem)}.png")
    save_whole(shown.figure, file)
    tell(shown.says)
    tell(f"figure: {file}")
    if view and not webbrowser.open(file.absolute().as_uri()):
        return complain(f"--open: there is no viewer here; the picture is {file}")
    return 0


def _age(file: Path) -> float:
    return file.stat().st_mtime


def _of_results(results: "Results") -> Shown:
    """Return the picture of what has just been run."""
    from navbench.analysis.stored import StoredResults

    return picture_of(StoredResults(results), {}, None, None)


def _file_name(words: str) -> str:
    return re.sub(r"[^\w.]+", "-", words).strip("-")


def _of_run(path: Path, words: Sequence[str]) -> Shown:
    """Return the picture of one episode of a results directory."""
    from navbench.analysis.stored import StoredResults
    from navbench.experiments.store import Results

    given = {}
    for word in words:
        key, _, value = word.partition("=")
        if key not in OF_RUN or not value:
            allowed = instead(key, (*OF_RUN, "out"), "allowed with show DIR")
            raise DescriptionError(f"{word}: unknown key; {allowed}")
        given[key] = value
    check_directory(f"show {path}", path)
    manifests = [*path.glob("*/manifest.json"), *path.glob("*/*/manifest.json")]
    inner = sorted([file for file in manifests if (file.parent / "episodes").is_dir()], key=_age)
    if inner and not (path / "manifest.json").is_file():
        raise DescriptionError(f"{path}: no results here; the newest within are in {inner[-1].parent}")
    cell = {key: given[key] for key in CHOOSING if key in given}
    return picture_of(StoredResults(Results(path)), cell, number("episode", given), number("robot", given))


def picture_of(stored: "StoredResults", wanted: Mapping[str, str], episode: int | None, robot: int | None) -> Shown:
    """Return the picture of one episode.

    Args:
        stored: the results.
        wanted: what chooses a cell, as ``CELL``.
        episode: its index; None for the first in which a robot failed.
        robot: which robot stands in front; None for all.

    Raises:
        DescriptionError: there is no such cell, episode or robot, or no trajectories are kept.
    """
    from navbench.report.episodes import draw_episode

    cell = cell_of_results(stored, wanted)
    called = f"{cell['label']} in {cell['world']}"
    rows = stored.rows[stored.rows["run_id"] == cell["run_id"]]
    episode, note = episode_of(rows, episode)
    figure = draw_episode(stored, str(cell["run_id"]), episode, robot_of(rows, robot), note)
    one = "" if robot is None else f" robot {robot}"
    said = f"{called}, episode {episode}{one and ','}{one}" + (f": {note}" if note else "")
    return Shown(figure, f"{called.replace(' in ', ' ')} episode {episode}{one}", said)


def robot_of(rows: "pd.DataFrame", robot: int | None) -> int | None:
    """Return a robot's index, or None, where it is one of the robots of a cell; raises ``DescriptionError``."""
    robots = int(rows["robot_index"].max()) + 1
    if robot is not None and robot not in range(robots):
        raise DescriptionError(f"robot={robot}: there is no such robot; {_there('robot', range(robots))}")
    return robot


def number(key: str, given: Mapping[str, str]) -> int | None:
    """Return a whole number from 0 among the words, or None where it does not stand there."""
    if key not in given:
        return None
    if not re.fullmatch(r"\d{1,9}", given[key]):
        raise DescriptionError(f"{key}={given[key]}: must be a whole number, at least 0")
    return int(given[key])


def cell_of_results(stored: "StoredResults", wanted: Mapping[str, str]) -> Mapping[str, Any]:
    """Return the entry in the manifest of the one cell that is chosen, of which trajectories are kept; see above."""
    cells = {cell["run_id"]: cell for cell in reversed(stored.manifest["cells"])}
    found: list[dict[str, Any]] = list(reversed(cells.values()))
    for key, value in wanted.items():
        if key not in CHOOSING:
            raise DescriptionError(f"{key}={value}: unknown key; {instead(key, CHOOSING)}")
        left = [cell for cell in found if (cell[key].startswith(value) if key == "run_id" else cell[key] == value)]
        if not left:
            there = dict.fromkeys(cell[key] for cell in found)
            raise DescriptionError(f"{key}={value}: there is no such cell; {instead(value, there, 'there are')}")
        found = left
    if len(found) != 1:
        raise DescriptionError(f"{stored.results.path}: {len(found)} cells; {_choices(found, stored.results)}")
    called, run_id = f"{found[0]['label']} in {found[0]['world']}", found[0]["run_id"]
    if run_id not in set(stored.rows["run_id"]):
        raise DescriptionError(f"{stored.results.path}: no episode of {called} is there yet")
    if not stored.results.keeps_trajectories(run_id):
        raise DescriptionError(f"{stored.results.path}: no trajectories are kept of {called}")
    return found[0]


def _choices(cells: Sequence[Mapping[str, Any]], results: "Results") -> str:
    """Return how one of some cells is chosen: all of them with their digits, or of many the words they differ in."""
    if len(cells) <= LISTED_MAX:
        from navbench.report.runs import Joined

        every = {cell["run_id"]: cell for cell in Joined([results]).manifest()["cells"]}  # with what tells them apart
        told = [
            f"{every[run]['label']} in {every[run]['name']} (run_id={run[:8]})" for run in (c["run_id"] for c in cells)
        ]
        return f"choose one by {'=, '.join(CELL[:-1])}= or {CELL[-1]}=: {'; '.join(told)}"
    words = {key: dict.fromkeys(cell[key] for cell in cells) for key in reversed(CELL)}
    told = [f"{key}={', '.join(values)}" for key, values in words.items() if len(values) > 1]
    return f"choose one by {'; '.join(told)}"


def episode_of(rows: "pd.DataFrame", wanted: int | None) -> tuple[int, str]:
    """Return which of a cell's episodes is shown, and where nobody chose it why."""
    there = sorted(rows["episode"].unique().tolist())
    undrawn = rows[rows["outcome"].isin(list(NOT_DRIVEN))].set_index("episode")["reason"]
    if wanted is not None:
        if wanted not in there:
            raise DescriptionError(f"episode={wanted}: there is no such episode; {_there('episode', there)}")
        if wanted in undrawn.index:
            raise DescriptionError(f"episode={wanted}: was not run: {undrawn[wanted]}")
        return wanted, ""
    driven = [episode for episode in there if episode not in undrawn.index]
    if not driven:
        raise DescriptionError(f"no episode was run: {undrawn.iloc[0]}")
    if len(driven) == 1:
        return driven[0], ""
    failed = sorted(rows[~rows["outcome"].isin(["reached", *NOT_DRIVEN])]["episode"].unique().tolist())
    if failed:
        which = f"the first of {len(failed)} failed episodes" if len(failed) > 1 else "the only failed episode"
        return failed[0], f"{which}, of {len(driven)}"
    return driven[0], f"no failure in {len(driven)} episodes; this is the first"


def _there(what: str, numbers: Sequence[int]) -> str:
    return f"there is only {what} {numbers[0]}" if len(numbers) == 1 else f"there are {what}s {_spans(numbers)}"


def _spans(numbers: Sequence[int]) -> str:
    """Return ascending whole numbers as words, those that follow each other as one span."""
    spans: list[list[int]] = []
    for number in numbers:
        if spans and number == spans[-1][1] + 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return ", ".join(f"{first} to {last}" if last > first else str(first) for first, last in spans)
