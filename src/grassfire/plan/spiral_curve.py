"""Dense points made a smooth curve of lines and arcs: evened out, then fitted by biarcs."""

from __future__ import annotations

import numpy as np

from grassfire.plan.path import Path, arc_centres, left_of_arcs
from grassfire.plan.places import BoolArray, IntArray
from grassfire.toolpath import FloatArray

REACH = 4.0
"""Widths of the Gaussian beyond which it counts as zero."""

COINCIDENT = 1e-9
"""Points nearer to each other are one, mm."""

FLAT = 1e4
"""Arcs of a larger radius are written as lines, mm."""

SHORT = 2e-3
"""Shorter arcs are written as lines, mm: rounded ends must not make full circles of them."""

KINK = 0.4
"""Largest turn from one step of points to the next that arcs follow closely, radians."""

MOST_ROUNDS = 64
"""Rounds of blunting at most: turns of up to 160 degrees need no more."""


def evened(points: FloatArray, step: float) -> FloatArray:
    """Points (m, 2) of the same polyline at equal distances of about `step` mm."""
    gap = np.hypot(*np.diff(points, axis=0).T)
    points = points[np.concatenate([[True], gap > COINCIDENT])]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    count = max(8, int(np.ceil(along[-1] / step)))
    wanted = np.linspace(0.0, along[-1], count + 1)
    return np.stack([np.interp(wanted, along, points[:, axis]) for axis in (0, 1)], axis=1)


def smoothed(points: FloatArray, width: float, closed: bool) -> FloatArray:
    """Even points under a Gaussian of standard deviation `width`, in steps of the points.

    A corner of turn a gets curvature of at most 0.8 tan(a / 2) / width. Every point moves to a
    mean of its neighbours; neighbouring laps move alike, so that their distance hardly changes.
    A closed run has its first point again at its end.
    """
    reach = int(REACH * width + 0.5)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    own = points[:-1] if closed else points
    padded = np.pad(own, ((reach, reach), (0, 0)), mode="wrap" if closed else "edge")
    mean = [np.convolve(column, weight / weight.sum(), mode="valid") for column in padded.T]
    result = np.stack(mean, axis=1)
    return np.concatenate([result, result[:1]]) if closed else result


def blunted(points: FloatArray, side: float) -> FloatArray:
    """Even points (m, 2) of an open run, without sharp turns to one side; the ends stay.

    Arcs through points about a sharp turn bulge to its outside. What moves, moves to its inside.

    Parameters
    ----------
    points : (m, 2) float array
    side : float
        1 for turns to the left, -1 for those to the right.
    """
    points = points.copy()
    for _ in range(MOST_ROUNDS):
        step = np.diff(points, axis=0)
        turn = side * _angle(step[:-1], step[1:])
        sharp = turn > KINK
        if not sharp.any():
            break
        near = np.convolve(sharp, np.ones(5), "same")[: len(turn)] > 0
        row = np.flatnonzero(near & (turn > 0)) + 1
        points[row] += 0.25 * (step[row] - step[row - 1])
    return points


def directions(points: FloatArray, closed: bool) -> FloatArray:
    """(m, 2) unit tangents at points: of the circle through each and its neighbours."""
    if closed:
        wide = np.concatenate([points[-2:-1], points, points[1:2]])
    else:
        wide = np.concatenate(
            [2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]]
        )
    ahead, behind = wide[2:] - wide[1:-1], wide[1:-1] - wide[:-2]
    size_ahead = np.maximum(np.hypot(*ahead.T), 1e-300)[:, None]
    size_behind = np.maximum(np.hypot(*behind.T), 1e-300)[:, None]
    mean = ahead / size_ahead * size_behind + behind / size_behind * size_ahead
    if not closed and len(points) > 2:
        # at an open end the chord's direction, turned as much as the next one turns
        mean[0] = _mirrored(mean[1], points[1] - points[0])
        mean[-1] = _mirrored(mean[-2], points[-1] - points[-2])
    return np.asarray(mean / np.maximum(np.hypot(*mean.T), 1e-300)[:, None])


def _mirrored(tangent: FloatArray, chord: FloatArray) -> FloatArray:
    """Tangent at one end of an arc from that at the other."""
    unit = chord / np.hypot(*chord)
    return np.asarray(2 * np.dot(tangent, unit) * unit - tangent)


# -- biarcs ---------------------------------------------------------------------------------------


def fitted(points: FloatArray, tangents: FloatArray, tolerance: FloatArray, longest: int) -> Path:
    """Biarcs through some of the points, within tolerance of all.

    Parameters
    ----------
    points, tangents : (m, 2) float arrays
        Dense.
    tolerance : (m,) float array
        How far the result may be from each point, mm.
    longest : int
        Most steps of points under one biarc that is tried first; neighbours are then made one.

    Returns
    -------
    Path
        Tangent-continuous; from the first point to the last.
    """
    last = len(points) - 1
    done: list[IntArray] = []
    count = max(1, int(np.ceil(last / longest)))
    marks = np.unique(np.round(np.linspace(0, last, count + 1)).astype(np.int64))
    first, second = marks[:-1], marks[1:]
    while len(first):
        good = _deviation_within(points, tangents, tolerance, first, second)
        good |= second - first <= 1
        done.append(first[good])
        low, high = first[~good], second[~good]
        middle = (low + high) // 2
        first = np.concatenate([low, middle])
        second = np.concatenate([middle, high])
    starts = np.sort(np.concatenate([*done, [last]]))
    starts = _merged(points, tangents, tolerance, starts, 8 * longest)
    return _path(points, tangents, starts[:-1], starts[1:])


def _merged(
    points: FloatArray, tangents: FloatArray, tolerance: FloatArray, marks: IntArray, longest: int
) -> IntArray:
    """Marks without those that two biarcs made one do not need, in rounds of alternate pairs."""
    for turn in range(6):
        if len(marks) < 3:
            break
        middle = np.arange(1 + turn % 2, len(marks) - 1, 2)
        low, high = marks[middle - 1], marks[middle + 1]
        good = high - low <= longest
        good[good] = _deviation_within(points, tangents, tolerance, low[good], high[good])
        marks = np.delete(marks, middle[good])
    return marks


def _biarcs(
    points: FloatArray, tangents: FloatArray, first: IntArray, second: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Middles (k, 2), half sweeps of both arcs (k,), and whether each biarc is tame.

    Of equal arms d: v^2 = 2 d v.(a + b) + 2 d^2 (1 - a.b) for the chord v and the tangents a, b
    (Bolton 1975), in the form that does not cancel.
    """
    leave, arrive = tangents[first], tangents[second]
    chord = points[second] - points[first]
    slope = np.sum(chord * (leave + arrive), axis=1)
    square = np.sum(chord * chord, axis=1)
    open_ = 2.0 * (1.0 - np.sum(leave * arrive, axis=1))
    arm = square / np.maximum(slope + np.sqrt(np.maximum(slope**2 + open_ * square, 0.0)), 1e-300)
    middle = 0.5 * (points[first] + points[second] + arm[:, None] * (leave - arrive))
    one = _angle(leave, middle - points[first])
    two = _angle(points[second] - middle, arrive)
    tame = (np.abs(one) < 0.4 * np.pi) & (np.abs(two) < 0.4 * np.pi) & (slope > 0)
    return middle, one, two, tame


def _angle(one: FloatArray, two: FloatArray) -> FloatArray:
    """(k,) signed angle from one direction to another."""
    cross = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    return np.asarray(np.arctan2(cross, np.sum(one * two, axis=1)))


def _deviation_within(
    points: FloatArray,
    tangents: FloatArray,
    tolerance: FloatArray,
    first: IntArray,
    second: IntArray,
) -> BoolArray:
    """Whether each biarc is within tolerance of the points between its ends."""
    middle, one, two, good = _biarcs(points, tangents, first, second)
    inner = np.maximum(second - first - 1, 0)
    owner = np.repeat(np.arange(len(first)), inner)
    index = np.arange(len(owner)) - np.repeat(np.cumsum(inner) - inner, inner) + 1
    row = first[owner] + index
    place = points[row]
    side = np.sum((place - middle[owner]) * (points[second] - points[first])[owner], axis=1) < 0
    start = np.where(side[:, None], points[first][owner], middle[owner])
    end = np.where(side[:, None], middle[owner], points[second][owner])
    half = np.where(side, one[owner], two[owner])
    away = np.abs(left_of_arcs(place - start, end - start, half))
    bad = owner[away > tolerance[row]]
    good[bad] = False
    return good


def _path(points: FloatArray, tangents: FloatArray, first: IntArray, second: IntArray) -> Path:
    """Biarcs as a chain of lines and arcs."""
    middle, one, two, _ = _biarcs(points, tangents, first, second)
    ends = np.empty((2 * len(first) + 1, 2))
    ends[0:-1:2], ends[1::2], ends[-1] = points[first], middle, points[second[-1]]
    sweep = 2.0 * np.stack([one, two], axis=1).ravel()
    chord = np.diff(ends, axis=0)
    size = np.hypot(*chord.T)
    keep = size > COINCIDENT
    starts, chord, size, sweep = ends[:-1][keep], chord[keep], size[keep], sweep[keep]
    radius = 0.5 * size / np.maximum(np.abs(np.sin(0.5 * sweep)), 1e-300)
    sweep = np.where((radius > FLAT) | (size < SHORT), 0.0, sweep)
    centre = arc_centres(starts, starts + chord, sweep)
    centre[sweep == 0.0] = np.nan
    return Path(np.concatenate([starts, ends[-1:]]), centre, sweep)


# -- corners --------------------------------------------------------------------------------------


def filleted(ring: Path, radius: float, left_over: float) -> Path:
    """A closed chain with its corners rounded on the inside of the turn.

    Parameters
    ----------
    ring : Path
    radius : float
        Of the arcs, mm; less where a piece is short.
    left_over : float
        How far an arc may be from its corner at most, mm.
    """
    leave, arrive = end_tangents(ring)
    turn = _angle(arrive, np.roll(leave, -1, axis=0))
    half = 0.5 * np.abs(turn)
    corner = (np.abs(turn) > SHARP) & (half < 0.49 * np.pi)
    if not corner.any():
        return ring
    height = 1.0 / np.cos(np.where(corner, half, 0.0)) - 1.0
    own = np.minimum(radius, left_over / np.maximum(height, 1e-9))
    room = 0.4 * np.minimum(ring.lengths, np.roll(ring.lengths, -1))
    back = np.where(corner, np.minimum(own * np.tan(np.where(corner, half, 0.0)), room), 0.0)
    ahead = np.roll(back, 1)
    first, last = ring.cumulative[:-1] + ahead, ring.cumulative[1:] - back
    starts, ends = ring.at(first), ring.at(last)
    share = (last - first) / np.maximum(ring.lengths, 1e-300)
    begin = np.where((ahead > 0)[:, None], starts, ring.points[:-1])
    finish = np.where((back > 0)[:, None], ends, ring.points[1:])
    leave = _rotated(leave, ring.sweep * ahead / ring.lengths)
    arrive = _rotated(arrive, -ring.sweep * back / ring.lengths)
    return _with_arcs(ring, (begin, finish), (leave, arrive), share, corner)


SHARP = np.radians(0.5)
"""Larger turns between pieces are corners."""


def end_tangents(path: Path) -> tuple[FloatArray, FloatArray]:
    """(n, 2) unit directions at the start and at the end of each piece."""
    chord = np.diff(path.points, axis=0)
    unit = chord / np.maximum(np.hypot(*chord.T), 1e-300)[:, None]
    side = np.sign(path.sweep)[:, None]
    result = []
    for points in (path.points[:-1], path.points[1:]):
        arm = points - path.centre
        arm = arm / np.maximum(np.hypot(*arm.T), 1e-300)[:, None]
        across = np.stack([-arm[:, 1], arm[:, 0]], axis=1) * side
        result.append(np.where(path.is_arc[:, None], across, unit))
    return result[0], result[1]


def _rotated(vector: FloatArray, angle: FloatArray) -> FloatArray:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack(
        [cos * vector[:, 0] - sin * vector[:, 1], sin * vector[:, 0] + cos * vector[:, 1]], axis=1
    )


def _with_arcs(
    ring: Path,
    ends: tuple[FloatArray, FloatArray],
    tangents: tuple[FloatArray, FloatArray],
    share: FloatArray,
    corner: BoolArray,
) -> Path:
    """The pieces of a ring, shortened to `ends`, with biarcs where a corner follows."""
    count = len(ring)
    nodes = np.stack([ends[1], np.roll(ends[0], -1, axis=0)], axis=1).reshape(-1, 2)
    ways = np.stack([tangents[1], np.roll(tangents[0], -1, axis=0)], axis=1).reshape(-1, 2)
    row = 2 * np.arange(count)
    bridges = [
        _path(nodes, ways, row[index : index + 1], row[index : index + 1] + 1)
        for index in np.flatnonzero(corner)
    ]
    numbers = np.cumsum(corner) - 1
    points: list[FloatArray] = [ends[0][:1]]
    centre: list[FloatArray] = []
    sweep: list[FloatArray] = []
    for index in range(count):
        points.append(ends[1][index : index + 1])
        centre.append(ring.centre[index : index + 1])
        sweep.append(ring.sweep[index : index + 1] * share[index])
        if corner[index]:
            bridge = bridges[int(numbers[index])]
            points.append(bridge.points[1:])
            centre.append(bridge.centre)
            sweep.append(bridge.sweep)
    closed = np.concatenate(points)
    closed[-1] = closed[0]
    return Path(closed, np.concatenate(centre), np.concatenate(sweep))
