"""What may come from anybody: files are read up to a length, names lead to no other folder, words do nothing."""

import re
import stat
from pathlib import Path

from navbench.validation import DescriptionError

FORBIDDEN = dict.fromkeys('/\\:*?[]<>|"')  # in the name of a file
NAME_MAX = 150  # characters
BREAK = re.compile(r"\s*[\r\n\v\f\x85\u2028\u2029]+\s*")
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ud800-\udfff\ufeff]")


def bounded(file: Path, most: int) -> bytes:
    """Return what a file holds.

    Args:
        file: the file.
        most: how many bytes it may hold.

    Raises:
        OSError: there is no such file, or it cannot be read.
        DescriptionError: it is a pipe, a device or a directory, from which reading may never end, or it is longer.
    """
    found = file.stat()
    if not stat.S_ISREG(found.st_mode):
        raise DescriptionError(f"{file}: must be a file, and no directory, pipe or device")
    if found.st_size > most:
        raise DescriptionError(f"{file}: holds {found.st_size} bytes, and must hold at most {most}")
    return file.read_bytes()


def check_name(name: str) -> str:
    """Return a name of which a file's name is made.

    Raises:
        DescriptionError: it could lead into another folder, or stand for several files.
    """
    if not name.isprintable() or set(name) & FORBIDDEN.keys() or name.startswith((".", "~")) or len(name) > NAME_MAX:
        raise DescriptionError(f"{name!r:.200}: must be a name of a file: no path, and none of {' '.join(FORBIDDEN)}")
    return name


def flat(text: str) -> str:
    """Return a text that can be printed, as ``printable`` does, on one line."""
    return printable(BREAK.sub(" ", text))


def printable(text: str) -> str:
    """Return a text with what a terminal would obey, or could not write, as an escape that can be read."""
    return CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), text)
