"""Whether there is a display for a window: asked before a library is, which would end the process."""

import os
import socket
import sys
from contextlib import suppress


def why_none() -> str:
    """Return why no window can be opened here, to stand after "needs a display, "; nothing where one may be.

    Of a display on another machine it is believed that it is there.
    """
    if sys.platform != "linux":
        return ""
    display = os.environ.get("DISPLAY", "")
    if not display:
        return "and the variable DISPLAY names none"
    host, _, number = display.partition(":")
    place = f"/tmp/.X11-unix/X{number.partition('.')[0]}"
    if host not in ("", "unix") or any(map(_answers, (place, f"\0{place}"))):
        return ""
    return f"and DISPLAY={display} is none that answers"


def _answers(place: str) -> bool:
    with socket.socket(socket.AF_UNIX) as tried, suppress(OSError):
        tried.connect(place)
        return True
    return False
