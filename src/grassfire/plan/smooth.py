"""Smooth ways as lines and arcs: links tangent at both ends, ways with rounded corners."""

from __future__ import annotations

import math

import numpy as np

from grassfire.plan.path import SAME, Path, arc_centres
from grassfire.plan.pursuit import wrapped
from grassfire.toolpath import FloatArray

MOST_ARC = math.radians(200.0)
"""Largest sweep of an arc of a way of two."""

LEAST_ARC = 1e-3
"""Smallest sweep of it, radians."""

LONGEST_ARM = 1e6
"""Longest tangent arm of a way of two arcs, as a multiple of the distance of its ends."""

_NOWHERE = math.nan, math.nan


def tangent_link(
    start: FloatArray, leave: float, end: FloatArray, arrive: float, radius: float
) -> Path | None:
    """Left arc, straight way, left arc: from one heading into another, away from stock at right.

    The shortest such way (Dubins 1957, type LSL); None where both places and headings agree.

    Parameters
    ----------
    start, end : (2,) float arrays
        mm.
    leave, arrive : float
        Headings, radians.
    radius : float
        Of both arcs, mm.
    """
    one_x, one_y = float(start[0]), float(start[1])
    two_x, two_y = float(end[0]), float(end[1])
    # the centres are a radius to the left of the headings
    first = one_x - radius * math.sin(leave), one_y + radius * math.cos(leave)
    last = two_x - radius * math.sin(arrive), two_y + radius * math.cos(arrive)
    way_x, way_y = last[0] - first[0], last[1] - first[1]
    course = math.atan2(way_y, way_x) if math.hypot(way_x, way_y) > SAME else arrive
    turns = [(course - leave) % (2 * math.pi), (arrive - course) % (2 * math.pi)]
    # a turn of nearly a full circle is none, but for rounding
    turns = [0.0 if 2 * math.pi - turn < 1e-6 else turn for turn in turns]
    right, ahead = radius * math.sin(course), -radius * math.cos(course)
    corners = [(first[0] + right, first[1] + ahead), (last[0] + right, last[1] + ahead)]
    pieces = [(first, turns[0]), (_NOWHERE, 0.0), (last, turns[1])]
    points, centre, sweep = [(one_x, one_y)], [], []
    for corner, (middle, turn) in zip([*corners, (two_x, two_y)], pieces, strict=True):
        if math.hypot(corner[0] - points[-1][0], corner[1] - points[-1][1]) > 1e-6:
            points.append(corner)
            centre.append(middle if turn else _NOWHERE)
            sweep.append(turn)
    if len(points) < 2:
        return None
    points[-1] = two_x, two_y
    return Path(np.array(points), np.array(centre), np.array(sweep))


def two_arcs(start: FloatArray, leave: float, end: FloatArray, arrive: float) -> Path | None:
    """Two arcs to the left, from one heading into another.

    None where one would turn right, or the places are the same to 1e-9 mm.

    Both tangent arms are equally long: with V = end - begin, T = t0 + t1, the arm d solves
    V.V - 2 d V.T - 2 d^2 (1 - t0.t1) = 0 (Bolton 1975, "Biarc curves"). Parameters as those of
    `tangent_link`.
    """
    first = math.cos(leave), math.sin(leave)
    last = math.cos(arrive), math.sin(arrive)
    x, y = float(end[0] - start[0]), float(end[1] - start[1])
    along = x * (first[0] + last[0]) + y * (first[1] + last[1])
    bend = 2 * (1 - first[0] * last[0] - first[1] * last[1])
    size = x * x + y * y
    if size <= SAME**2:
        return None
    reach = along + math.sqrt(max(along**2 + bend * size, 0.0))
    if reach * LONGEST_ARM <= math.sqrt(size):
        # with equal headings straight beside or behind there is none, but for rounding
        return None
    arm = size / reach
    # from the start to the joint, and from there to the end
    one = (x + arm * (first[0] - last[0])) / 2, (y + arm * (first[1] - last[1])) / 2
    two = x - one[0], y - one[1]
    sweep = np.array(
        [
            2 * wrapped(math.atan2(one[1], one[0]) - leave),
            2 * wrapped(arrive - math.atan2(two[1], two[0])),
        ]
    )
    if sweep.min() < LEAST_ARC or sweep.max() > MOST_ARC:
        return None
    points = np.stack([start, start + np.array(one), end])
    return Path(points, arc_centres(points[:-1], points[1:], sweep), sweep)


def rounded(path: Path, radius: float) -> Path:
    """Straight pieces with arcs for corners, of `radius` mm or less where pieces are short."""
    chord = np.diff(path.points, axis=0)
    size = np.hypot(chord[:, 0], chord[:, 1])
    along = chord / size[:, None]
    heading = np.arctan2(chord[:, 1], chord[:, 0])
    turn = wrapped(np.diff(heading))
    room = np.minimum(size[:-1], size[1:]) / 2
    cut = np.minimum(radius * np.tan(np.abs(turn) / 2), room)
    corner = path.points[1:-1]
    before, after = corner - along[:-1] * cut[:, None], corner + along[1:] * cut[:, None]
    points = np.concatenate(
        [path.points[:1], np.stack([before, after], axis=1).reshape(-1, 2), path.points[-1:]]
    )
    sweep = np.zeros(len(points) - 1)
    sweep[1::2] = turn
    keep = np.hypot(*np.diff(points, axis=0).T) > 1e-6
    begin, stop = points[:-1][keep], points[1:][keep]
    points, sweep = np.concatenate([begin, stop[-1:]]), sweep[keep]
    centre = arc_centres(points[:-1], points[1:], sweep)
    return Path(points, np.where(sweep[:, None] == 0.0, np.nan, centre), sweep)
