"""What a configuration file may be: text of some length and depth, whose references do not blow it up."""

from pathlib import Path

import yaml

from navbench.reading import bounded
from navbench.validation import DescriptionError

BYTES_MAX = 2**22
DEPTH_MAX = 100
DIGITS_MAX = 4000  # of which Python reads 4,300
NODES_MAX = 10**6  # with each reference counted as all that it stands for
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def check_file(file: Path) -> None:
    """Check a configuration file before anything reads it.

    Raises:
        DescriptionError: it is no file, too long or too deep, or not in UTF-8; the message names it.
    """
    data = bounded(file, BYTES_MAX)
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise DescriptionError(f"{file}: must be text in UTF-8; its byte {error.start + 1} is none") from None
    try:
        _check_nodes(file, text)
    except yaml.YAMLError:  # of which a run says more
        pass


def check_directory(said: str, path: Path) -> None:
    """Check that a directory is there.

    Raises:
        DescriptionError: it is not, or is a file; the message begins with what was said.
    """
    if not path.is_dir():
        raise DescriptionError(f"{said}: {'is a file' if path.exists() else 'there is no such directory'}")


def _check_nodes(file: Path, text: str) -> None:
    """Count what a file holds without building it."""
    open_, sizes = [(None, 0)], dict[str | None, int]()  # the name and size of each collection that is under way
    for event in yaml.parse(text, Loader=LOADER):
        name, size = getattr(event, "anchor", None), 1
        if isinstance(event, yaml.CollectionStartEvent):
            open_.append((name, 1))
            if len(open_) > DEPTH_MAX:
                raise DescriptionError(f"{file}: must be at most {DEPTH_MAX} mappings and lists deep")
            continue
        if isinstance(event, yaml.CollectionEndEvent):
            name, size = open_.pop()
        elif isinstance(event, yaml.AliasEvent):
            if name in (of for of, _ in open_):
                raise DescriptionError(f"{file}: *{name} stands within &{name} itself")
            name, size = None, sizes.get(name, 1)
        elif not isinstance(event, yaml.ScalarEvent):
            continue
        elif len(event.value) > DIGITS_MAX and event.value.isdecimal():
            raise DescriptionError(f"{file}: {event.value[:20]}...: a number must have at most {DIGITS_MAX} digits")
        sizes[name] = size
        open_[-1] = open_[-1][0], open_[-1][1] + size
        if open_[-1][1] > NODES_MAX:
            raise DescriptionError(f"{file}: must hold at most {NODES_MAX} values")
