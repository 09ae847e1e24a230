"""Standard output that nothing fails of: what nobody takes, as of a closed pipe or a full disk, is dropped."""

import io
import sys
from typing import Any


class Output(io.FileIO):
    """Writes to a descriptor, and remembers what went wrong instead of raising it.

    Attributes:
        error: what went wrong first.
    """

    error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write bytes, or drop them."""
        try:
            return super().write(data) or 0
        except OSError as error:
            self.error = self.error or error
            return len(data)


def shielded(name: str, descriptor: int) -> Output:
    """Let ``sys.stdout`` or ``sys.stderr`` drop what it cannot write, and return what remembers that it did.

    One that is no file of this process's own, such as a notebook's, stays; one that was closed is one now.

    Args:
        name: stdout or stderr.
        descriptor: its number.
    """
    stream, output = getattr(sys, name), Output(descriptor, "w", closefd=False)
    below = getattr(stream, "buffer", None)
    own = type(getattr(below, "raw", below)) is io.FileIO and stream.fileno() == descriptor
    if own or stream is None:
        encoding, by_line = (
            getattr(stream, "encoding", None),
            name == "stderr" or stream is not None and stream.isatty(),
        )
        shield = io.TextIOWrapper(io.BufferedWriter(output), encoding, "backslashreplace", line_buffering=by_line)
        setattr(sys, name, shield)
    return output
