"""A controller of one's own held against the contract: a line for each check."""

from collections.abc import Sequence

from navbench.cli.progress import UNFINISHED, tell
from navbench.cli.words import Words, sort_words
from navbench.importing import without_exit
from navbench.validation import DescriptionError

HELP = """navbench check controller=NAME [world=NAME] [...]: hold a controller against the contract, line by line
navbench check world=NAME [robot=NAME] [seed=S] [episodes=100]: whether its layouts can be drawn, and their tasks done

  commands    are finite, and nothing raises
  limits      whether the wheels can do what it asks for
  repeats     the same to the last bit again, in another order, in another process
  compiled    act answers as the compiled policy does
  sensors     it drives with what it says it needs (sensor_roles, sensor_kind)
  mirrored    in the mirrored world it drives the mirrored path, where its sensors are the same on both sides
  period      half the control period changes its time and path little
  speed       how long an act takes

Each line begins with ok, note (what you should know, but may want) or FAIL. All keys of a run may be given
(`navbench --help`); unless they are, it drives 3 episodes in planar with starts turned by up to 0.3 rad.
exit code: 0 without a FAIL, 3 with one, 2 for wrong input
"""
LAYOUTS, LAYOUTS_MAX = 100, 100_000  # of a world
UNLESS_GIVEN = {"simulator": "planar", "episodes": "3", "start_heading_jitter_rad": "0.3"}


def check(arguments: Sequence[str]) -> int:
    """Check a controller, print what is found, and return the exit code."""
    words = sort_words(arguments)
    from navbench.cli.composing import key_of
    from navbench.cli.configuration import compose_cell
    from navbench.experiments.conformance import findings

    given = {key_of(word) for word in words.overrides}
    if words.names or not given & {"controller", "world"}:
        raise DescriptionError(
            f"check {' '.join(words.names)}".rstrip()
            + ": name a controller, as controller=NAME, or a world, as world=NAME"
        )
    if "controller" not in given:
        return _check_world(words, "episodes" in given)
    added = [f"{key}={value}" for key, value in UNLESS_GIVEN.items() if key not in given]
    cell = compose_cell(*added, *words.overrides, config_dir=words.config_dir)
    count = dict.fromkeys(("ok", "note", "FAIL"), 0)
    with without_exit():
        for finding in findings(cell):
            count[finding.verdict] += 1
            tell(f"{finding.verdict:<5} {finding.name:<9} {finding.said}")
    print(
        f"{cell.names.controller} in {cell.names.world}: {', '.join(f'{n} {word}' for word, n in count.items() if n)}"
    )
    return UNFINISHED if count["FAIL"] else 0


def _check_world(words: Words, is_counted: bool) -> int:
    """Draw a world's layouts, say whether their tasks can be done, and return the exit code."""
    from navbench.cli.composing import composing
    from navbench.cli.shown import impossible, layouts_of, robot_of

    with composing(words.config_dir) as composer:
        composed = composer.values("run", words.overrides)
    layouts = layouts_of(composed, composed.values["episodes"] if is_counted else LAYOUTS, LAYOUTS_MAX)
    lines = impossible(composed, layouts)
    body = f"a robot of radius {robot_of(composed).radius_m:g} m"
    print(f"FAIL  tasks     {lines[0]}" if lines else f"ok    tasks     {body} can do all of {len(layouts)}")
    return UNFINISHED if lines else 0
