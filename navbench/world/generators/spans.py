"""The spans that generators draw from: counts, radii, speeds, each as its least and its greatest value."""

import math
from typing import Annotated

from pydantic import AfterValidator, Field

from navbench.validation import Positive

RADIUS_MIN_M = 1e-6  # of a smaller polygon, far from 0, the corners are one point
THINGS_MAX = 1000  # of one kind
CORNERS_MAX = 100  # of a polygon: more are a disc


def _ascending(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError(f"the first must not be above the second, got {list(pair)}")
    return pair


Span = Annotated[tuple[Positive, Positive], AfterValidator(_ascending)]
Radius = Annotated[float, Field(ge=RADIUS_MIN_M, strict=True, allow_inf_nan=False)]
Radii = Annotated[tuple[Radius, Radius], AfterValidator(_ascending)]
Few = Annotated[int, Field(ge=0, le=THINGS_MAX, strict=True)]
Some = Annotated[int, Field(ge=1, le=THINGS_MAX, strict=True)]
Corners = Annotated[int, Field(ge=3, le=CORNERS_MAX, strict=True)]
Counts = Annotated[tuple[Few, Some], AfterValidator(_ascending)]
CornerCounts = Annotated[tuple[Corners, Corners], AfterValidator(_ascending)]


def mean_area_m2(count: tuple[int, int], radius_m: tuple[float, float]) -> float:
    """Return the area that so many circles of such radii take on average [m^2]."""
    low, high = radius_m
    return 0.5 * sum(count) * math.pi * (low * low + low * high + high * high) / 3.0
