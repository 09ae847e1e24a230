"""The words of a command line, sorted: flags, key=value, and names."""

from argparse import ArgumentParser
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple, NoReturn

from navbench.cli.catalogue import LISTED, check_folder
from navbench.validation import DescriptionError

RESUME = "resume=other-code"
FLAGS = {
    "--config-dir": "-cd",
    "--multirun": "-m",
    "--cfg": "-c",
    "--video": "--video",
}  # the short form; beside -h, --help
SWITCHES = ("--multirun", "--trust", "--overwrite", "--open")  # which take no word


class Words(NamedTuple):
    """The words of a command line, sorted.

    Attributes:
        names: those without ``=``.
        overrides: those with it.
        config_dir: the folder after ``--config-dir``, or None.
        multirun: whether ``-m`` was given.
        cfg: whether ``--cfg job`` was given.
        other_code: whether ``resume=other-code`` was given.
        trust: whether ``--trust`` was given.
        overwrite: whether ``--overwrite`` was given.
        open: whether ``--open`` was given.
        video: the file after ``--video``, or None.
    """

    names: list[str]
    overrides: list[str]
    config_dir: str | None
    multirun: bool
    cfg: bool
    other_code: bool
    trust: bool
    overwrite: bool
    open: bool
    video: str | None

    @property
    def kept(self) -> dict[str, bool]:
        """Return what may be kept and what removed of what is there, as ``run_plan`` takes it."""
        return {"other_code": self.other_code, "overwrite": self.overwrite}

    def place(self, key: str, path: Path) -> list[str]:
        """Return the word that names a directory, where the others do not."""
        return [] if any(word.startswith(f"{key}=") for word in self.overrides) else [f"{key}={path}"]


def sort_words(arguments: Sequence[str], flags: Sequence[str] = ("--config-dir",)) -> Words:
    """Return the words of a command line, sorted.

    Args:
        arguments: the words, flags standing anywhere between the others.
        flags: which of ``FLAGS`` and ``SWITCHES`` may be given.

    Raises:
        DescriptionError: a flag is unknown, or the folder of configurations is missing.
    """
    allowed = ", ".join([*flags, "--help"])
    parser = _Parser(add_help=False, allow_abbrev=False)
    parser.add_argument("words", nargs="*")
    for flag in flags:
        if flag in SWITCHES:
            parser.add_argument(flag, FLAGS.get(flag, flag), action="store_true")
        else:
            parser.add_argument(flag, FLAGS[flag], choices=("job",) if flag == "--cfg" else None)
    given, unknown = parser.parse_known_intermixed_args(list(arguments))
    if unknown:
        word = unknown[0].lstrip("-")
        near = get_close_matches(unknown[0], flags, 1)
        meant = f"did you mean {(near or [word])[0]}? " if near or word.split("=")[0] in LISTED else ""
        raise DescriptionError(f"{unknown[0]}: unknown flag; {meant}allowed: {allowed}")
    config_dir: str | None = given.config_dir if "--config-dir" in flags else None
    if config_dir is not None:
        check_folder(Path(config_dir))
    overrides = [word for word in given.words if "=" in word or word.startswith("~")]
    for word in overrides:
        if word.startswith("resume=") and word != RESUME:
            raise DescriptionError(f"{word}: must be other-code")
    return Words(
        names=[word for word in given.words if word not in overrides],
        overrides=[word for word in overrides if word != RESUME],
        config_dir=config_dir,
        multirun=getattr(given, "multirun", False),
        cfg=getattr(given, "cfg", None) is not None,
        other_code=RESUME in overrides,
        trust=getattr(given, "trust", False),
        overwrite=getattr(given, "overwrite", False),
        open=getattr(given, "open", False),
        video=getattr(given, "video", None),
    )


class _Parser(ArgumentParser):
    """Argparse, but what is wrong is raised."""

    def error(self, message: str) -> NoReturn:
        """Raise what argparse would print with its usage."""
        raise DescriptionError(message.removeprefix("argument "))
