"""The exact centroid of terms that are each cut at a strength, of which the largest counts at every point.

An output's range is divided, once for a rule base, into cells in which every term is one line or parabola and no two of
them cross. So in a cell the terms have one order. Of those from the highest down, cut at strengths h, only the ones
matter that are cut higher than all before: the first one is the aggregate up to its h, the next one above that h and up
to its own, and so on. Area and moment are thus sums of those of single terms cut at single strengths, which have a
closed form; where two cut terms cross need not be known.
"""

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from navbench.compiled import compiled

FloatArray = NDArray[np.float64]

NEGLIGIBLE = 1e-200  # a smaller area counts as not fired: it would underflow to 0 / 0

# A piece, which is a term in a cell. Over u, 0 at the cell's end where the term is lowest and 1 at the other one, it is
# LOWEST + SLOPE u + BEND u^2. Lengths are counted from the middle of the range, in halves of it.
TERM, OPENS, END, WIDTH, LOWEST, SLOPE, BEND = range(7)  # number; 1 if first of its cell; where u = 0; signed, along u


@compiled
def _cut(base: FloatArray, at: int, strength: float) -> tuple[float, float]:
    """Return the area below a piece that is cut at a strength, and its first moment."""
    width, lowest, slope, bend = base[at + WIDTH], base[at + LOWEST], base[at + SLOPE], base[at + BEND]
    low, top, rise, s = min(strength, lowest), max(strength - lowest, 0.0), slope + bend, 1.0
    if top >= rise:
        top = rise
    elif bend == 0.0:  # the cut is met at u = s
        s = top / rise
    else:
        s = 2.0 * top / (slope + math.sqrt(slope * slope + 4.0 * bend * top)) if top > 0.0 else 0.0
    area = abs(width) * (low + top * (1.0 - s) + s * s * (slope / 2.0 + s * bend / 3.0))
    moment = (low + top * (1.0 - s * s)) / 2.0 + s * s * s * (slope / 3.0 + s * bend / 4.0)
    return area, base[at + END] * area + abs(width) * width * moment


@compiled
def centroid(base: FloatArray, begin: int, end: int, strengths: FloatArray) -> float:
    """Return the centroid of an output, counted from the middle of its range in halves of it; NaN if none fired.

    Args:
        base: an array that holds, between two places, the rows of ``divided``.
        begin: where they begin.
        end: where they end.
        strengths: (n_terms,) at which each term is cut, by its number.
    """
    area, moment, reached = 0.0, 0.0, 0.0
    for at in range(begin, end, 7):
        if base[at + OPENS] > 0.0:
            reached = 0.0
        strength = strengths[int(base[at + TERM])]
        if strength > reached:
            more = _cut(base, at, strength)
            area, moment = area + more[0], moment + more[1]
            if reached > 0.0:
                less = _cut(base, at, reached)
                area, moment = area - less[0], moment - less[1]
            reached = strength
    return moment / area if area > NEGLIGIBLE else math.nan


def divided(low: float, high: float, shapes: FloatArray, first: int) -> FloatArray:
    """Return an output's pieces: (n, 7), cell by cell, in a cell from the highest down.

    Args:
        low: the range's lower end.
        high: the range's upper end.
        shapes: (n_terms, 5) corners a, b, c, d of each term; 1 if its ramps are smooth.
        first: the number of the first term.
    """
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    a, b, c, d = corners = (shapes[:, :4].T - middle) / half
    smooth, bends = shapes[:, 4] > 0.0, (0.5 * (a + b), 0.5 * (c + d))  # halfway a smooth ramp turns its bend
    ends = np.concatenate([[-1.0, 1.0], *corners, *(bend[smooth] for bend in bends)])
    coarse = np.unique(ends[np.abs(ends) <= 1.0])
    edges = np.unique(np.concatenate([coarse, _crossings(coarse, corners, smooth)]))
    lowest, slope, bend, end, width = _in_cells(edges, corners, smooth)
    middles = lowest + slope / 2.0 + bend / 4.0
    order = np.argsort(-middles, axis=1, kind="stable")  # NaN comes last
    opens, at = np.eye(1, order.shape[1]), (np.arange(len(order))[:, None], order)
    columns = first + order, opens.repeat(len(order), axis=0), *(of[at] for of in (end, width, lowest, slope, bend))
    rows: FloatArray = np.stack(columns, axis=-1)[~np.isnan(middles[at])]
    return rows


def _in_cells(edges: FloatArray, corners: FloatArray, smooth: NDArray[np.bool_]) -> tuple[FloatArray, ...]:
    """Return LOWEST, SLOPE, BEND, END and WIDTH of each term in each cell, (n_cells, n_terms) each; NaN if outside."""
    a, b, c, d = corners
    left, right = edges[:-1, None], edges[1:, None]
    middles = 0.5 * (left + right)
    falls = middles > c
    begin, end = np.where(falls, right, left), np.where(falls, left, right)
    with np.errstate(divide="ignore", invalid="ignore"):  # of an upright edge and an open side, which are not taken
        m, n = (np.where(falls, (d - x) / (d - c), np.where(middles < b, (x - a) / (b - a), 1.0)) for x in (begin, end))
    m = np.where((middles < a) | (middles > d), np.nan, np.clip(m, 0.0, 1.0))
    rise = np.clip(n, 0.0, 1.0) - m
    below = m + 0.5 * rise < 0.5
    lowest = np.where(smooth, np.where(below, 2.0 * m * m, 1.0 - 2.0 * (1.0 - m) ** 2), m)
    slope = rise * np.where(smooth, 4.0 * np.where(below, m, 1.0 - m), 1.0)
    bend = rise * rise * np.where(smooth, np.where(below, 2.0, -2.0), 0.0)
    return lowest, slope, bend, begin, end - begin


@cache
def _pairs(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    return np.triu_indices(count, 1)


def _crossings(edges: FloatArray, corners: FloatArray, smooth: NDArray[np.bool_]) -> FloatArray:
    """Return where two terms cross between two neighbouring edges."""
    lowest, slope, bend, _, width = _in_cells(edges, corners, smooth)
    falls = width < 0.0  # such a term is counted from the left too here
    lowest, slope = np.where(falls, lowest + slope + bend, lowest), np.where(falls, -slope - 2.0 * bend, slope)
    one, other = _pairs(len(smooth))
    e, p, q = (of[:, one] - of[:, other] for of in (lowest, slope, bend))
    with np.errstate(divide="ignore", invalid="ignore"):  # of lines, and of terms that do not meet
        root = -0.5 * (p + np.copysign(np.sqrt(p * p - 4.0 * q * e), p))
        u = np.stack([root / q, e / root])
    at = edges[:-1, None] + u * np.diff(edges)[:, None]
    return at[(u > 0.0) & (u < 1.0)]
