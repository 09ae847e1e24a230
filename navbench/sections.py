"""The sections of a report: functions by name, each from stored results to Markdown, with tables and figures beside it."""

from collections.abc import Callable, Mapping
from typing import Any

SECTIONS: Mapping[str, Callable[..., str]] = {}


def check_section(key: str, spec: Mapping[str, Any]) -> None:
    """Check that a section exists and takes these arguments."""
