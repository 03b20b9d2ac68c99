"""Fewest arcs through samples of smooth curves: splines of degree two whose knots move.

Along a chain of tangent arcs the heading is continuous and piecewise linear in the arc length. Near
a curve of heading theta(s) the chain lies beside it, to first order, by the integral of the
difference of both headings. With the *course*, the integral of theta, that is how far a spline of
degree two, once differentiable, is from the course: the fewest arcs are a spline of the fewest
knots.

Splines are those of least squares, banded systems for all curves at once. Knots move to where the
spline is furthest off, several times, before one more is tried. Then arcs are laid through the
knots, each tangent to the one before it, and looked at beside all samples.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from grassfire.plan.banded import solved
from grassfire.plan.path import Path, arc_centres, join, left_of_arcs, ranges, segment
from grassfire.plan.places import IntArray
from grassfire.plan.pursuit import unit, wrapped
from grassfire.toolpath import FloatArray

ASTRAY, AWAY = np.radians(2.0), np.radians(6.0)
"""How far the heading of arcs may turn from that of the curve to the right, and to the left, where
a cut takes less, radians."""

HOPEFUL = 0.75
"""How many knots are tried first, as a part of how many an even spread would need."""

PATIENCE = 20
"""How often knots are moved before there is one more of them."""

HOPELESS = 4.0
"""So many times the tolerance off, one more knot is tried at once."""

DRAWN = 0.35
"""Power of the error of a span by which it draws knots."""

MOST_TURN = np.radians(150.0)
"""Most that a single arc may turn, radians."""

GROWTH, STRIDE = 3, 25
"""One more knot for so many spans that are off, and for so many that there are."""

PIN = 1e9
"""Weight of the ends of a curve, which stay where they are."""

RIDGE = 1e-5
"""Weight that keeps splines definite where a span has no sample, and needs above zero."""

LONGEST = 20000
"""Most samples of a curve that is fitted as a whole: the course of a spiral of hundreds of turns
grows to numbers whose rounding is no less than the tolerance."""

SLACK = 1.02
"""How far off arcs may be whose spline is within tolerance, in tolerances."""

DIGITS = 7
"""Samples are rounded to so many decimals, mm: how knots move makes differences in the last bit
grow, and the same cut seen in a mirror or reckoned in another order is to get the same arcs."""

FLAT = 1e-6
"""Arcs of less sweep times length than this are lines, mm; their bow is an eighth of it."""


class Curve(NamedTuple):
    """Samples of a smooth curve.

    Attributes
    ----------
    points : (n, 2) float array
        Two or more, no two neighbours equal, mm.
    right, left : (n,) float arrays
        How far beside them arcs may lie, mm.
    leave : float, optional
        Direction in which it leaves the first one, radians; without it as it bends beside it.
    """

    points: FloatArray
    right: FloatArray
    left: FloatArray
    leave: float = math.nan


class _Samples(NamedTuple):
    """Samples of several curves, one after the other.

    Attributes
    ----------
    points : (n, 2) float array
    along : (n,) float array
        Arc length on their curves, mm.
    heading, course : (n,) float arrays
        Direction of the curve, radians, and its integral over `along`.
    middle, width : (n,) float arrays
        Middle and half width of the band in which arcs are to lie, mm to the left.
    weight : (n,) float array
        Length of the curve that a sample stands for, mm.
    counts : (m,) int array
        How many each curve has.
    """

    points: FloatArray
    along: FloatArray
    heading: FloatArray
    course: FloatArray
    middle: FloatArray
    width: FloatArray
    weight: FloatArray
    counts: IntArray

    @property
    def owner(self) -> IntArray:
        """(n,) curve of each sample."""
        return np.arange(len(self.counts)).repeat(self.counts)

    @property
    def lift(self) -> FloatArray:
        """(m,) what is added to arc lengths of each curve to have those of all in order, mm."""
        return np.asarray(2.0 * np.arange(len(self.counts)) * (self.along.max() + 1.0))

    @property
    def lifted(self) -> FloatArray:
        """(n,) arc lengths so lifted."""
        return self.along + self.lift.repeat(self.counts)

    @property
    def first(self) -> IntArray:
        """(m,) first sample of each curve."""
        return self.counts.cumsum() - self.counts

    @property
    def last(self) -> IntArray:
        """(m,) last sample of each curve."""
        return self.counts.cumsum() - 1

    def take(self, curves: IntArray) -> _Samples:
        """Only the samples of some curves."""
        count = self.counts[curves]
        rows = ranges(self.first[curves], count)
        return _Samples._make([*(column[rows] for column in self[:-1]), count])


def _heads(numbers: IntArray) -> IntArray:
    """Where runs of equal numbers begin."""
    return np.flatnonzero(np.append(True, numbers[1:] != numbers[:-1]))


def _measured(curve: Curve) -> tuple[FloatArray, ...]:
    """Columns of `_Samples` of one curve."""
    points, right, left = (np.round(column, DIGITS) for column in curve[:3])
    chord = points[1:] - points[:-1]
    size = np.hypot(chord[:, 0], chord[:, 1])
    bearing = np.arctan2(chord[:, 1], chord[:, 0])
    bearing[1:] = bearing[0] + wrapped(bearing[1:] - bearing[:-1]).cumsum()
    along, heading, course, weight = np.zeros((4, len(points)))
    size.cumsum(out=along[1:])
    (bearing * size).cumsum(out=course[1:])
    heading[1:-1] = (bearing[:-1] * size[1:] + bearing[1:] * size[:-1]) / (size[:-1] + size[1:])
    heading[0], heading[-1] = bearing[0], bearing[-1]
    if len(points) > 2:
        # as the curve bends beside its ends
        heading[0], heading[-1] = 2 * bearing[0] - heading[1], 2 * bearing[-1] - heading[-2]
    if not math.isnan(curve.leave):
        heading[0] += wrapped(round(curve.leave, DIGITS) - heading[0])
    weight[:-1] = size / 2
    weight[1:] += size / 2
    middle = (left - right) / 2
    middle[0] = middle[-1] = 0.0
    return points, along, heading, course, middle, (left + right) / 2, weight


def _needed(it: _Samples) -> FloatArray:
    """(n,) how many arcs each curve needs to its samples, by how its curvature changes.

    With even changes arcs of length l are off by change l**3 / 125, their heading by
    change l**2 / 12.
    """
    step = np.maximum(it.along[1:] - it.along[:-1], RIDGE)
    bend = (it.heading[1:] - it.heading[:-1]) / step
    change = np.zeros(len(it.along))
    change[1:-1] = np.abs(bend[1:] - bend[:-1]) / (step[1:] + step[:-1]) * 2
    first, last = it.first, it.last
    change[first], change[last] = change[first + 1], change[last - 1]
    density = np.maximum(np.cbrt(change / (125 * it.width)), np.sqrt(change / (12 * ASTRAY)))
    share = np.zeros(len(density))
    share[1:] = ((density[1:] + density[:-1]) / 2 + RIDGE) * (it.along[1:] - it.along[:-1])
    share[first] = 0.0
    # each by itself, so that the others do not matter to the last bit
    return np.concatenate([part.cumsum() for part in np.split(share, first[1:])])


@dataclass(frozen=True)
class _Knots:
    """Knots of splines, a row for each curve.

    Attributes
    ----------
    along : (m, k) float array
        Arc lengths; the last one again and again in rows that have fewer, mm.
    parts : (m,) int array
        How many spans each spline has.
    """

    along: FloatArray
    parts: IntArray


def _spread(total: FloatArray, along: FloatArray, count: IntArray, parts: IntArray) -> _Knots:
    """Knots at equal shares of what is given at places of each curve, rising from 0."""
    last = count.cumsum() - 1
    first = last + 1 - count
    rows = np.arange(len(parts))
    number = np.arange(parts.max() + 1)
    share = np.minimum(number / parts[:, None], 1.0)
    owner = rows.repeat(count)
    lifted = total / total[last].repeat(count) + 2.0 * owner
    low = lifted.searchsorted(share + 2.0 * rows[:, None], side="right") - 1
    low = np.clip(low, first[:, None], last[:, None] - 1)
    wanted = share * total[last][:, None]
    part = (wanted - total[low]) / np.maximum(total[low + 1] - total[low], 1e-300)
    result = along[low] + (along[low + 1] - along[low]) * np.clip(part, 0.0, 1.0)
    result[:, 0] = 0.0
    result = np.where(number >= parts[:, None], along[last][:, None], result)
    return _Knots(result, parts)


class _Spline(NamedTuple):
    """Splines beside their samples.

    Attributes
    ----------
    value, slope : (m, k) float arrays
        Course and heading at the knots.
    span : (n,) int array
        In which span each sample is.
    off : (n,) float array
        How far off it is, in tolerances.
    """

    value: FloatArray
    slope: FloatArray
    span: IntArray
    off: FloatArray


def _spline(it: _Samples, knots: _Knots) -> _Spline:
    """Splines of least squares with given knots."""
    rows, width = knots.along.shape
    owner = it.owner
    span = _spans(it, knots)
    basis, slopes = _bases(it.along, knots, owner, span)
    flat, size = owner * (width + 1) + span, rows * (width + 1)
    near, straight = it.weight / it.width**2, it.weight / ASTRAY**2
    target = it.course + it.middle
    # coefficients that no span has are zero
    band, wanted = np.zeros((3, size)), np.zeros(size)
    begin = _heads(flat)
    at = flat[begin]
    for low in range(3):
        lateral, angular = near * basis[low], straight * slopes[low]
        for high in range(low, 3):
            part = np.add.reduceat(lateral * basis[high] + angular * slopes[high], begin)
            band[2 + low - high, at + high] += part
        wanted[at + low] += np.add.reduceat(lateral * target + angular * it.heading, begin)
    band[2] += RIDGE
    ends = np.arange(rows) * (width + 1)
    for place, sample in ((ends, it.first), (ends + knots.parts + 1, it.last)):
        band[2, place] += PIN
        wanted[place] += PIN * it.course[sample]
    table = solved(band.reshape(3, rows, -1), wanted.reshape(rows, -1), knots.parts + 2)
    found = table.ravel()
    own = [found[flat + each] for each in range(3)]
    beside = sum(part * each for part, each in zip(basis, own, strict=True)) - it.course
    turn = sum(part * each for part, each in zip(slopes, own, strict=True)) - it.heading
    off = np.abs(beside - it.middle) / it.width
    off[it.first] = off[it.last] = 0.0
    value, slope = _at_knots(table, knots)
    return _Spline(value, slope, span, np.maximum(off, _strayed(turn)))


def _strayed(turn: FloatArray) -> FloatArray:
    """How far headings that differ by a turn to the left are off, in tolerances."""
    return np.asarray(np.maximum(-turn / ASTRAY, turn / AWAY))


def _spans(it: _Samples, knots: _Knots) -> IntArray:
    """(n,) in which span each sample is."""
    rows, width = knots.along.shape
    found = (knots.along + it.lift[:, None]).ravel().searchsorted(it.lifted, side="right") - 1
    found -= (np.arange(rows) * width).repeat(it.counts)
    return np.asarray(np.clip(found, 0, (knots.parts - 1).repeat(it.counts)))


def _bases(
    along: FloatArray, knots: _Knots, owner: IntArray, span: IntArray
) -> tuple[list[FloatArray], list[FloatArray]]:
    """The three splines that are not zero at each sample, and their derivatives."""
    padded = np.pad(knots.along, ((0, 0), (1, 1)), mode="edge")
    width = padded.shape[1]
    flat, row = padded.ravel(), owner * width + span
    before, begin, end, after = (flat[row + each] for each in range(4))
    size = end - begin
    fall = (end - along) / (size * (end - before))
    rise = (along - begin) / (size * (after - begin))
    first, last = fall * (end - along), rise * (along - begin)
    return [first, 1 - first - last, last], [-2 * fall, 2 * (fall - rise), 2 * rise]


def _at_knots(found: FloatArray, knots: _Knots) -> tuple[FloatArray, FloatArray]:
    """Values and slopes of splines at their knots, (m, k) each, by their coefficients."""
    padded = np.pad(knots.along, ((0, 0), (1, 1)), mode="edge")
    before, after = knots.along - padded[:, :-2], padded[:, 2:] - knots.along
    size = np.maximum(before + after, 1e-300)
    # at the ends of a row one of both is zero
    value = (found[:, :-1] * after + found[:, 1:] * before) / size
    return value, 2 * (found[:, 1:] - found[:, :-1]) / size


def _worst(off: FloatArray, it: _Samples, knots: _Knots, span: IntArray) -> FloatArray:
    """(m, k - 1) how far off each span is at most, in tolerances."""
    rows, width = knots.along.shape
    flat = it.owner * (width - 1) + span
    begin = _heads(flat)
    result = np.zeros(rows * (width - 1))
    result[flat[begin]] = np.maximum.reduceat(off, begin)
    return result.reshape(rows, width - 1)


def _moved(knots: _Knots, worst: FloatArray, parts: IntArray) -> _Knots:
    """So many knots, nearer together where the spline was far off."""
    rows, width = knots.along.shape
    total = np.zeros((rows, width))
    draw = np.maximum(worst, 1e-2) ** DRAWN
    draw[np.arange(width - 1) >= knots.parts[:, None]] = 0.0
    draw.cumsum(axis=1, out=total[:, 1:])
    return _spread(total.ravel(), knots.along.ravel(), np.full(rows, width), parts)


class _Arcs(NamedTuple):
    """Ends (m, k, 2) and sweeps (m, k - 1) of the arcs of each curve; and how far off (n,)."""

    points: FloatArray
    sweep: FloatArray
    off: FloatArray


def _arcs(it: _Samples, knots: _Knots, spline: _Spline) -> _Arcs:
    """Tangent arcs through the knots of splines, compared with the samples."""
    rows, width = knots.along.shape
    points = _places(it, knots, spline.value)
    chord = points[:, 1:] - points[:, :-1]
    real = np.arange(width - 1) < knots.parts[:, None]
    wish = np.where(real, spline.slope[:, 1:] - spline.slope[:, :-1], 0.0)
    bearing = np.arctan2(chord[..., 1], chord[..., 0])
    # sweeps next to each other have twice the turn of their chords as their sum
    turn = wrapped(bearing[:, 1:] - bearing[:, :-1] - (wish[:, 1:] + wish[:, :-1]) / 2)
    turn = np.where(real[:, 1:], 2 * turn + wish[:, 1:] + wish[:, :-1], 0.0)
    sign = np.where(np.arange(width - 1) % 2, -1.0, 1.0)
    own = np.zeros((rows, width - 1))
    (sign[1:] * turn).cumsum(axis=1, out=own[:, 1:])
    # one after the other, so that wider rows do not matter to the last bit
    first = np.where(real, sign * wish - own, 0.0).cumsum(axis=1)[:, -1] / knots.parts
    sweep = np.where(real, sign * (own + first[:, None]), 0.0)
    owner = it.owner
    place = owner * (width - 1) + spline.span
    offset = it.points - points.reshape(-1, 2)[owner * width + spline.span]
    flat = sweep.ravel()[place]
    beside = -left_of_arcs(offset, chord.reshape(-1, 2)[place], flat / 2)
    begin = knots.along[:, :-1].ravel()[place]
    size = (knots.along[:, 1:] - knots.along[:, :-1]).ravel()[place]
    share = (it.along - begin) / size - 0.5
    course = bearing.ravel()[place] + flat * share
    off = np.abs(beside - it.middle) / it.width
    off[it.first] = off[it.last] = 0.0
    return _Arcs(points, sweep, np.maximum(off, _strayed(wrapped(course - it.heading))))


def _places(it: _Samples, knots: _Knots, value: FloatArray) -> FloatArray:
    """(m, k, 2) places of knots beside the samples."""
    width = knots.along.shape[1]
    low = it.lifted.searchsorted(knots.along + it.lift[:, None], side="right") - 1
    low = np.clip(low, it.first[:, None], it.last[:, None] - 1)
    gone, step = knots.along - it.along[low], it.along[low + 1] - it.along[low]
    course = (it.course[low + 1] - it.course[low]) / step
    place = it.points[low] + (it.points[low + 1] - it.points[low]) * (gone / step)[..., None]
    left = value - it.course[low] - course * gone
    place += unit(course + np.pi / 2) * left[..., None]
    place[:, 0] = it.points[it.first]
    ends = np.arange(width) >= knots.parts[:, None]
    return np.asarray(np.where(ends[..., None], it.points[it.last][:, None], place))


def fewest_arcs(curves: Sequence[Curve]) -> list[Path]:
    """Paths of few arcs beside samples of smooth curves, tangent-continuous; one for each.

    They begin and end where the curves do. Where the samples are not smooth enough for so many
    arcs as there are samples, the path has a corner; and where it is cut in halves as it has more
    samples than `LONGEST`, one of no more than the tolerances of headings.
    """
    paths: dict[int, Path] = {}
    for number, curve in enumerate(curves):
        if len(curve.points) == 2:
            paths[number] = segment(curve.points[0], curve.points[1])
        elif len(curve.points) > LONGEST:
            middle = len(curve.points) // 2
            paths[number] = join(*fewest_arcs(_halves(curve, middle)))
    active = np.array([row for row in range(len(curves)) if row not in paths], dtype=np.int64)
    if not len(active):
        return [paths[row] for row in range(len(curves))]
    it, knots = _begun([curves[row] for row in active.tolist()])
    tries = np.zeros(len(active), dtype=np.int64)
    while len(active):
        spline = _spline(it, knots)
        worst = _worst(spline.off, it, knots, spline.span)
        most = worst.max(axis=1)
        for row, points, sweep in _laid(it, knots, spline, (most <= 1.0).nonzero()[0]):
            number = int(active[row])
            points[[0, -1]] = curves[number].points[[0, -1]]
            paths[number] = _as_path(points, sweep)
        done = np.array([row in paths for row in active.tolist()])
        tries += 1
        # splines within tolerance whose arcs are not need another knot as well
        more = (tries >= PATIENCE) | (most > HOPELESS) | (most <= 1.0)
        tries[more] = 0
        growth = np.maximum((worst > 1.0).sum(axis=1) // GROWTH, knots.parts // STRIDE)
        parts = knots.parts + more * np.maximum(1, growth)
        stuck = ~done & more & (knots.parts == it.counts - 1)
        for row in stuck.nonzero()[0].tolist():
            off = spline.off[it.first[row] + 1 : it.last[row]]
            halves = _halves(curves[active[row]], int(off.argmax()) + 1)
            paths[int(active[row])] = join(*fewest_arcs(halves))
        rest = (~done & ~stuck).nonzero()[0]
        if len(rest):
            parts = np.minimum(parts, it.counts - 1)[rest]
            knots = _moved(_Knots(knots.along[rest], knots.parts[rest]), worst[rest], parts)
        it, active, tries = it.take(rest), active[rest], tries[rest]
    return [paths[row] for row in range(len(curves))]


def _halves(curve: Curve, sample: int) -> list[Curve]:
    """The parts of a curve up to and from a sample."""
    points, right, left, leave = curve
    first, last = slice(None, sample + 1), slice(sample, None)
    return [
        Curve(points[first], right[first], left[first], leave),
        Curve(points[last], right[last], left[last]),
    ]


def _begun(curves: Sequence[Curve]) -> tuple[_Samples, _Knots]:
    """Curves of three samples or more measured, and fewer knots than they are likely to need."""
    columns = [_measured(curve) for curve in curves]
    count = np.array([len(curve.points) for curve in curves])
    it = _Samples._make([*map(np.concatenate, zip(*columns, strict=True)), count])
    need = _needed(it)
    turn = np.maximum.reduceat(it.heading, it.first) - np.minimum.reduceat(it.heading, it.first)
    least = np.maximum(np.floor(HOPEFUL * need[it.last]), np.ceil(turn / MOST_TURN))
    parts = np.minimum(np.maximum(least.astype(np.int64), 1), count - 1)
    return it, _spread(need, it.along, count, parts)


def _laid(
    it: _Samples, knots: _Knots, spline: _Spline, chosen: IntArray
) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """Of some curves those whose arcs are within tolerance, with ends and sweeps of these."""
    if not len(chosen):
        return
    own = _Knots(knots.along[chosen], knots.parts[chosen])
    rows = ranges(it.first[chosen], it.counts[chosen])
    some = it.take(chosen)
    arcs = _arcs(
        some,
        own,
        _Spline(spline.value[chosen], spline.slope[chosen], spline.span[rows], spline.off[rows]),
    )
    most = np.maximum.reduceat(arcs.off, some.first)
    for number in (most <= SLACK).nonzero()[0].tolist():
        parts = int(own.parts[number])
        yield int(chosen[number]), arcs.points[number, : parts + 1], arcs.sweep[number, :parts]


def _as_path(points: FloatArray, sweep: FloatArray) -> Path:
    """Arcs, those that hardly bend as lines."""
    chord = points[1:] - points[:-1]
    flat = np.abs(sweep) * np.hypot(chord[:, 0], chord[:, 1]) < FLAT
    centre = arc_centres(points[:-1], points[1:], sweep)
    return Path(points, np.where(flat[:, None], np.nan, centre), np.where(flat, 0.0, sweep))
