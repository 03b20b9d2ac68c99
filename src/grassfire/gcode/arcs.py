"""Arcs in one plane: centre from a radius, sweep, chords."""

from __future__ import annotations

import math

import numpy as np

from ..toolpath import FloatArray

Planar = tuple[float, float]


def sweep_of(begin: Planar, end: Planar, centre: Planar, counter: bool) -> float:
    """Signed sweep in radians, counter-clockwise positive; a full turn where both ends agree."""
    whole = 2 * math.pi if counter else -2 * math.pi
    if begin == end:
        return whole
    first = (begin[0] - centre[0], begin[1] - centre[1])
    last = (end[0] - centre[0], end[1] - centre[1])
    turn = math.atan2(
        first[0] * last[1] - first[1] * last[0], first[0] * last[0] + first[1] * last[1]
    )
    if counter:
        return turn + whole if turn <= 0 else turn
    return turn + whole if turn >= 0 else turn


def centres_by_radius(
    begin: FloatArray, end: FloatArray, radius: FloatArray, counter: FloatArray
) -> FloatArray:
    """(n, 2) centres of arcs given by R.

    Parameters
    ----------
    begin, end : (n, 2) float array
        mm; they differ.
    radius : (n,) float array
        mm; negative for arcs of more than half a turn. Where it is less than half the chord, the
        arc is half a turn.
    counter : (n,) float array
        1 for counter-clockwise arcs, -1 for the others.
    """
    chord = end - begin
    length = np.hypot(chord[:, 0], chord[:, 1])
    height = np.sqrt(np.maximum(radius**2 - length**2 / 4, 0.0))
    side = counter * np.sign(radius) * height / length
    normal = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
    return np.asarray((begin + end) / 2 + side[:, None] * normal)


def chords(
    begin: Planar, end: Planar, centre: Planar, sweep: float, height: float
) -> tuple[FloatArray, FloatArray]:
    """Points on an arc, its start left out, and the fraction of the sweep at each.

    Chords are at most `height` mm from the arc. Where the radii at both ends differ, the radius
    changes evenly with the angle. The last point is `end`.
    """
    first = (begin[0] - centre[0], begin[1] - centre[1])
    radii = (math.hypot(*first), math.hypot(end[0] - centre[0], end[1] - centre[1]))
    largest = max(radii)
    step = 2 * math.acos(max(1 - height / largest, 0.0)) if largest > 0 else math.inf
    count = max(1, math.ceil(abs(sweep) / step))
    fraction = np.arange(1, count + 1) / count
    angle = math.atan2(first[1], first[0]) + sweep * fraction
    radius = radii[0] + (radii[1] - radii[0]) * fraction
    points = np.stack(
        [centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)], axis=1
    )
    points[-1] = end
    return points, fraction
