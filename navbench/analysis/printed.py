"""Numbers as a paper prints them: with their unit, and known to half a unit of their last decimal."""

import re
from typing import Any

from navbench.validation import DescriptionError

NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"


def quantity(key: str, value: Any) -> tuple[float, str]:
    """Return a number and its unit, of ``37.1 s`` or a number alone.

    Raises:
        DescriptionError: it is neither.
    """
    number, unit = parts(key, value)
    return float(number), unit


def parts(key: str, value: Any) -> tuple[str, str]:
    """Return a number as it is printed, and its unit; errors as of ``quantity``."""
    found = re.fullmatch(rf"({NUMBER})(?: (\S.*))?", str(value))
    if found is None:
        raise DescriptionError(f"{key}={value}: must be a number, or one with its unit as `37.1 s` or `5 %`")
    return found[1], found[2] or ""


def limits(key: str, value: Any) -> tuple[float, float]:
    """Return between what a printed number lies: 0.30 in [0.295, 0.305); one without decimals is exact."""
    number, _ = parts(key, value)
    decimals = len(number.partition(".")[2]) if "e" not in number else 0
    half = 0.5 * 10.0**-decimals if decimals else 0.0
    return float(number) - half, float(number) + half


def tolerated(printed: Any, within: Any) -> tuple[float, float]:
    """Return between what a measured number agrees with a printed one: beyond its limits by its tolerance at most."""
    number, _ = quantity("printed", printed)
    size, unit = quantity("within", within)
    width = size / 100.0 * abs(number) if unit == "%" else size
    low, high = limits("printed", printed)
    return low - width, high + width


def band(low: float | str, high: float | str) -> tuple[float, float]:
    """Return a band's ends: a number as it is; one in quotes as printed, so "0.30" to "0.35" is 0.295 to 0.355."""
    return (
        limits("low", low)[0] if isinstance(low, str) else low,
        limits("high", high)[1] if isinstance(high, str) else high,
    )


def fraction(key: str, value: float | str) -> float:
    """Return 0.01 of ``1 %``, and a number as it is."""
    number, unit = quantity(key, value)
    return number / 100.0 if unit == "%" else number
