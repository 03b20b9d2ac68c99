"""Whether a chain of curves crosses itself, to the accuracy of chords."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grassfire.geometry.batch import CurveBatch
from grassfire.geometry.curve import Curve, FloatArray, cross
from grassfire.geometry.flatten import flatten_parameters
from grassfire.geometry.line import Line

LONGEST_SHARE = 4.0
"""Chords longer than this many times the mean are cut, so that near ones are quickly found."""
CLOSE = 8
"""Chords along the chain within which crossings are looked for first."""


def first_crossing(curves: Sequence[Curve], accuracy: float, closed: bool) -> FloatArray | None:
    """Return a point (2,) where chords of the curves cross, None if there is none.

    Parameters
    ----------
    curves : sequence of Curve
        In order; where one ends and the next starts elsewhere the chain is interrupted.
    accuracy : float
        Largest distance of the chords from the curves, in mm.
    closed : bool
        Whether the last curve ends where the first starts.
    """
    start, end, joined = _chords(curves, accuracy)
    number, start, end = _cut(start, end)
    # Consecutive parts of the chain share an end: no crossing.
    follows = np.append(joined, joined[-1] if closed else False)
    # Noise crosses close by: no need to look for all pairs then.
    close = np.arange(2, min(CLOSE, len(start) - 1) + 1)
    one, shift = (part.ravel() for part in np.meshgrid(np.arange(len(start)), close))
    inside = one + shift < len(start)
    pairs = np.stack([one, one + shift], axis=1)[inside]
    found = _crossing(pairs, number, start, end, follows)
    if found is not None:
        return found
    from scipy.spatial import cKDTree

    half = 0.5 * np.hypot(*(end - start).T)
    tree = cKDTree(0.5 * (start + end))
    pairs = tree.query_pairs(2.0 * float(half.max()), output_type="ndarray")
    return _crossing(pairs, number, start, end, follows)


def _crossing(
    pairs: np.ndarray, number: np.ndarray, start: FloatArray, end: FloatArray, follows: np.ndarray
) -> FloatArray | None:
    """Return where the first of the pairs (m, 2) of chords cross that do not follow each other."""
    one, two = pairs[:, 0], pairs[:, 1]
    count = int(number[-1]) + 1
    apart = number[two] - number[one]
    beside = (apart == 0) | ((apart == 1) & follows[number[one]])
    beside |= (apart == count - 1) & follows[count - 1]
    one, two = one[~beside], two[~beside]
    first, second = end[one] - start[one], end[two] - start[two]
    between = start[two] - start[one]
    side_start, side_end = cross(first, between), cross(first, end[two] - start[one])
    back_start = cross(second, -between)
    back_end = cross(second, end[one] - start[two])
    hits = np.flatnonzero((side_start * side_end < 0.0) & (back_start * back_end < 0.0))
    if not len(hits):
        return None
    hit = hits[np.argmin(one[hits])]
    share = back_start[hit] / (back_start[hit] - back_end[hit])
    return np.asarray(start[one[hit]] + share * first[hit])


def _chords(curves: Sequence[Curve], accuracy: float) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """Return starts and ends (m, 2) of the chords, and whether each is followed by the next."""
    index, parameter = [], []
    for place, curve in enumerate(curves):
        t = np.array([0.0, 1.0])
        if not isinstance(curve, Line):
            t = flatten_parameters(curve, accuracy)
        index.append(np.full(len(t), place))
        parameter.append(t)
    which = np.concatenate(index)
    points = CurveBatch(tuple(curves)).point(which, np.concatenate(parameter))
    inside = which[:-1] == which[1:]
    start, end = points[:-1][inside], points[1:][inside]
    gap = np.hypot(*(np.roll(start, -1, axis=0) - end).T)
    size = float(np.abs(points - points[0]).max())
    return start, end, np.asarray(gap[:-1] <= 1e-9 * size)


def _cut(start: FloatArray, end: FloatArray) -> tuple[np.ndarray, FloatArray, FloatArray]:
    """Return chord numbers, starts and ends of the parts of chords, none much above the mean."""
    length = np.hypot(*(end - start).T)
    # The median keeps few long chords from hiding many short ones; the mean bounds the parts.
    longest = LONGEST_SHARE * max(float(np.median(length)), 0.05 * float(length.mean()))
    parts = np.maximum(np.ceil(length / longest), 1.0).astype(np.int64)
    number = np.repeat(np.arange(len(start)), parts)
    within = np.arange(len(number)) - np.repeat(np.cumsum(parts) - parts, parts)
    low, high = within / parts[number], (within + 1) / parts[number]
    change = end - start
    cut_start = start[number] + low[:, None] * change[number]
    return number, cut_start, start[number] + high[:, None] * change[number]
