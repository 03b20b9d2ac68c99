"""Smooth ways as lines and arcs: biarcs through samples, links tangent at both ends."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from grassfire.plan.path import BoolArray, IntArray, Path
from grassfire.plan.pursuit import unit, wrapped
from grassfire.toolpath import FloatArray

LARGEST_RADIUS = 1e4
"""Arcs of a larger radius become lines, mm; their sagitta is far below any tolerance."""

FEW = 5
"""Into how many parts samples are divided, to look at those between the parts first."""

_NOWHERE = math.nan, math.nan


def _biarcs(
    begin: FloatArray, end: FloatArray, leave: FloatArray, arrive: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Joint (m, 2) and turns (m, 2) of the biarcs with given ends and headings.

    Both tangent arms are equally long: with V = end - begin, T = t0 + t1, the arm d solves
    V.V - 2 d V.T - 2 d^2 (1 - t0.t1) = 0 (Bolton 1975, "Biarc curves").
    """
    first, last = unit(leave), unit(arrive)
    chord = end - begin
    along = np.sum(chord * (first + last), axis=1)
    bend = 2 * (1 - np.sum(first * last, axis=1))
    size = np.sum(chord * chord, axis=1)
    # the stable root: also right where the headings agree
    arm = size / np.maximum(along + np.sqrt(along**2 + bend * size), 1e-300)
    joint = (begin + end + arm[:, None] * (first - last)) / 2
    halves = []
    for start, stop, heading, sign in ((begin, joint, leave, 1.0), (joint, end, arrive, -1.0)):
        direction = np.arctan2(stop[:, 1] - start[:, 1], stop[:, 0] - start[:, 0])
        halves.append(sign * 2 * wrapped(direction - heading))
    return joint, np.stack(halves, axis=1)


def _centres(begin: FloatArray, end: FloatArray, turn: FloatArray) -> FloatArray:
    """(m, 2) centres of arcs by their chords and sweeps; far away for straight ones."""
    chord = end - begin
    cot = 1 / np.tan(np.where(np.abs(turn) < 1e-9, 1e-9, turn) / 2)
    normal = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
    return np.asarray((begin + end + normal * cot[:, None]) / 2)


Samples = tuple[FloatArray, FloatArray, FloatArray]
"""Of a smooth curve: at least two points (n, 2), mm; headings (n,) there, radians; and how far
they may lie from a path through them (n,), mm."""


def fits(curves: Sequence[Samples]) -> list[Path]:
    """Lines and arcs through samples of smooth curves, tangent-continuous; a path for each."""
    if not curves:
        return []
    points, headings, tolerance = (np.concatenate(column) for column in zip(*curves, strict=True))
    stop = np.array([len(curve[0]) for curve in curves]).cumsum()
    low, high = np.append(0, stop[:-1]), stop - 1
    done: list[tuple[IntArray, IntArray, FloatArray, FloatArray]] = []
    while len(low):
        joint, turn = _biarcs(points[low], points[high], headings[low], headings[high])
        good = _close(points, tolerance, low, high, joint, turn) | (high - low <= 1)
        # between two samples that a turn on the spot has left in the wrong order
        wrong = good & _turns_back(turn)
        joint[wrong], turn[wrong] = (points[low[wrong]] + points[high[wrong]]) / 2, 0.0
        done.append((low[good], high[good], joint[good], turn[good]))
        low, high = low[~good], high[~good]
        middle = (low + high) // 2
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    columns = [np.concatenate(column) for column in zip(*done, strict=True)]
    order = np.argsort(columns[0])
    first, last, joints, turns = _merged(
        points, headings, tolerance, *(column[order] for column in columns)
    )
    count = np.diff(np.searchsorted(first, np.append(0, stop)))
    return _as_paths(points[first], joints, points[last], turns, count)


def _merged(
    points: FloatArray,
    headings: FloatArray,
    tolerance: FloatArray,
    first: IntArray,
    last: IntArray,
    joint: FloatArray,
    turn: FloatArray,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """The same biarcs, with neighbours made one where one will do: every other pair by turns."""
    idle, offset = 0, 0
    while idle < 2:
        every = np.arange(len(first))
        goes_on = np.append(last[:-1] == first[1:], False)
        # counted on each curve by itself, so that the others do not matter
        begin = np.maximum.accumulate(np.where(np.append(True, ~goes_on[:-1]), every, 0))
        rows = every[goes_on & ((every - begin) % 2 == offset)]
        low, high = first[rows], last[rows + 1]
        joints, turns = _biarcs(points[low], points[high], headings[low], headings[high])
        good = _close(points, tolerance, low, high, joints, turns)
        rows = rows[good]
        last[rows], joint[rows], turn[rows] = high[good], joints[good], turns[good]
        first, last = np.delete(first, rows + 1), np.delete(last, rows + 1)
        joint, turn = np.delete(joint, rows + 1, axis=0), np.delete(turn, rows + 1, axis=0)
        idle, offset = 0 if len(rows) else idle + 1, 1 - offset
    return first, last, joint, turn


def _close(
    points: FloatArray,
    tolerance: FloatArray,
    low: IntArray,
    high: IntArray,
    joint: FloatArray,
    turn: FloatArray,
) -> BoolArray:
    """(m,) which biarcs are within the tolerances of all samples between low and high."""
    # a biarc that turns back has left its samples
    result = ~_turns_back(turn)
    across = points[high] - points[low]
    centre = [_centres(points[low], joint, turn[:, 0]), _centres(joint, points[high], turn[:, 1])]
    radius = [_size(points[low] - centre[0]), _size(joint - centre[1])]

    def off(sample: IntArray, owner: IntArray) -> BoolArray:
        place = points.take(sample, axis=0)
        past, ahead = (place - joint.take(owner, axis=0)).T, across.take(owner, axis=0).T
        second = past[0] * ahead[0] + past[1] * ahead[1] > 0
        middle = np.where(second, centre[1].take(owner, axis=0).T, centre[0].take(owner, axis=0).T)
        size = np.where(second, radius[1].take(owner), radius[0].take(owner))
        gap = np.abs(np.hypot(place[:, 0] - middle[0], place[:, 1] - middle[1]) - size)
        return np.asarray(gap > tolerance.take(sample))

    count = high - low
    rows = result.nonzero()[0]
    # a few samples tell nearly always of those that are off
    few = low[rows, None] + count[rows, None] * np.arange(1, FEW) // FEW
    result[rows] = ~off(few.ravel(), rows.repeat(FEW - 1)).reshape(-1, FEW - 1).any(axis=1)
    rows = (result & (count > FEW)).nonzero()[0]
    inner = count[rows] - 1
    sample = np.arange(inner.sum()) + (low[rows] + 1 - (inner.cumsum() - inner)).repeat(inner)
    owner = rows.repeat(inner)
    result[owner[off(sample, owner)]] = False
    return result


def _size(vectors: FloatArray) -> FloatArray:
    """(n,) lengths of vectors (n, 2)."""
    return np.hypot(vectors[:, 0], vectors[:, 1])


def _turns_back(turn: FloatArray) -> BoolArray:
    """(m,) which biarcs have an arc of more than a right angle."""
    return np.asarray(np.any(np.abs(turn) > np.pi / 2, axis=1))


def _as_paths(
    begin: FloatArray, joint: FloatArray, end: FloatArray, turn: FloatArray, count: IntArray
) -> list[Path]:
    """Paths of so many biarcs each, without pieces that have no length."""
    start = np.stack([begin, joint], axis=1).reshape(-1, 2)
    stop = np.stack([joint, end], axis=1).reshape(-1, 2)
    sweep = turn.reshape(-1)
    chord = stop - start
    keep = np.hypot(chord[:, 0], chord[:, 1]) > 1e-9
    owner = np.arange(len(count)).repeat(2 * count)[keep]
    pieces = np.bincount(owner, minlength=len(count))
    points, size, sweep = start[keep], np.hypot(chord[:, 0], chord[:, 1])[keep], sweep[keep]
    # where pieces are left out the one before ends where the next begins
    after = np.concatenate([points[1:], end[-1:]])
    ends = pieces.cumsum()
    final = end[np.cumsum(count) - 1]
    after[ends[pieces > 0] - 1] = final[pieces > 0]
    flat = np.abs(sweep) * LARGEST_RADIUS < size
    sweep = np.where(flat, 0.0, sweep)
    centre = np.where(flat[:, None], np.nan, _centres(points, after, sweep))
    return [
        Path(np.concatenate([points[low:high], last[None]]), centre[low:high], sweep[low:high])
        for low, high, last in zip((ends - pieces).tolist(), ends.tolist(), final, strict=True)
    ]


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
    course = math.atan2(way_y, way_x) if math.hypot(way_x, way_y) > 1e-9 else arrive
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
    centre = _centres(points[:-1], points[1:], sweep)
    return Path(points, np.where(sweep[:, None] == 0.0, np.nan, centre), sweep)
