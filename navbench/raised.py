"""What is said of an exception of a user's own code: one line, with the place in their own file."""

import sysconfig
import traceback
from pathlib import Path

from navbench.validation import DescriptionError

PACKAGE = Path(__file__).parent
REASON_MAX = 160  # characters
LINE_MAX = 60  # characters of a source line


def one_line(error: BaseException) -> str:
    """Return what an exception says, shortened, and where it was raised, as ``own_line`` does."""
    kind = "" if isinstance(error, DescriptionError) else f"{type(error).__name__}: "
    text = f"{kind}{said_by(error)}".strip()
    return shortened(text, REASON_MAX) + own_line(error)


def shortened(text: str, most: int) -> str:
    """Return a text as one line of at most so many characters, cut where it is longer, within a word, too."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 3]}..."


def said_by(error: BaseException) -> str:
    """Return what an exception says, as one line."""
    try:
        said = str(error)
    except BaseException as wrong:  # of a user's own __str__
        said = f"says nothing: its __str__ raises {type(wrong).__name__}"
    return storable(" ".join(said.split()))


def storable(text: str) -> str:
    """Return a text without halves of characters, which no file takes."""
    return text.encode("utf-8", "backslashreplace").decode()


def own_line(error: BaseException) -> str:
    """Return the last line outside libraries and framework that an exception came through, in brackets, or nothing."""
    own = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not (is_framework(frame.filename) or _is_library(frame.filename))
    ]
    if not own:
        return ""
    text = shortened(own[-1].line or "", LINE_MAX)
    return f" ({Path(own[-1].filename).name}, line {own[-1].lineno}: {text})"


def first_line(function: object) -> str:
    """Return where a function begins, in brackets, or nothing where it is not of Python."""
    code = getattr(function, "__code__", None)
    return f" ({Path(code.co_filename).name}, line {code.co_firstlineno})" if code else ""


def is_framework(file: str) -> bool:
    """Return whether a file is navbench's, but no controller's."""
    path = Path(file)
    return path.is_relative_to(PACKAGE) and path.relative_to(PACKAGE).parts[0] != "controllers"


def _is_library(file: str) -> bool:
    packages = {"site-packages", "dist-packages"} & set(Path(file).parts)
    return bool(packages) or file.startswith(("<", sysconfig.get_path("stdlib")))
