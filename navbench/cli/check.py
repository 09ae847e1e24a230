"""A controller of one's own held against the contract: a line for each check."""

from collections.abc import Sequence

from navbench.cli.progress import UNFINISHED
from navbench.cli.words import sort_words
from navbench.validation import DescriptionError

HELP = """navbench check controller=NAME [world=NAME] [...]: hold a controller against the contract, line by line

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
UNLESS_GIVEN = {"simulator": "planar", "episodes": "3", "start_heading_jitter_rad": "0.3"}


def check(arguments: Sequence[str]) -> int:
    """Check a controller, print what is found, and return the exit code."""
    words = sort_words(arguments)
    from navbench.cli.composing import key_of
    from navbench.cli.configuration import compose_cell
    from navbench.experiments.conformance import findings

    given = {key_of(word) for word in words.overrides}
    if words.names or "controller" not in given:
        raise DescriptionError(f"check {' '.join(words.names)}".rstrip() + ": name a controller, as controller=NAME")
    added = [f"{key}={value}" for key, value in UNLESS_GIVEN.items() if key not in given]
    cell = compose_cell(*added, *words.overrides, config_dir=words.config_dir)
    count = dict.fromkeys(("ok", "note", "FAIL"), 0)
    for finding in findings(cell):
        count[finding.verdict] += 1
        print(f"{finding.verdict:<5} {finding.name:<9} {finding.said}", flush=True)
    print(
        f"{cell.names.controller} in {cell.names.world}: {', '.join(f'{n} {word}' for word, n in count.items() if n)}"
    )
    return UNFINISHED if count["FAIL"] else 0
