"""Chains of lines and arcs in the plane as columns, the form in which rings are linked and cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grassfire.geometry import Arc, Line, Loop, fit_arcs
from grassfire.plan.places import BoolArray, IntArray, Places
from grassfire.toolpath import FloatArray

SAME = 1e-9
"""Places that are no further apart are one, mm."""

SAMPLES = 256
"""Places on a chain among which crossings to others are looked for."""

_FULL_TURN = 2 * np.pi


@dataclass(frozen=True)
class Nearest:
    """Nearest point of a chain: arc length along it, the point and how far away it is, mm."""

    along: float
    point: FloatArray
    distance: float


@dataclass(frozen=True)
class Path:
    """Connected lines and circular arcs; closed where the last point is the first.

    Attributes
    ----------
    points : (n + 1, 2) float array
        Ends of the pieces, mm.
    centre : (n, 2) float array
        Centre of each arc, mm; NaN for lines.
    sweep : (n,) float array
        Signed sweep of each arc, radians, counter-clockwise positive; 0 for lines.
    """

    points: FloatArray
    centre: FloatArray
    sweep: FloatArray

    def __len__(self) -> int:
        return len(self.sweep)

    @property
    def start(self) -> FloatArray:
        """(2,) first point, mm."""
        return np.asarray(self.points[0])

    @property
    def end(self) -> FloatArray:
        """(2,) last point, mm."""
        return np.asarray(self.points[-1])

    @cached_property
    def is_arc(self) -> BoolArray:
        """(n,) whether each piece is an arc."""
        return np.asarray(self.sweep != 0.0)

    @cached_property
    def radius(self) -> FloatArray:
        """(n,) radius of each arc, mm; infinite for lines."""
        offset = self.points[:-1] - self.centre
        return np.where(self.is_arc, np.hypot(offset[:, 0], offset[:, 1]), np.inf)

    @cached_property
    def lengths(self) -> FloatArray:
        """(n,) length of each piece, mm."""
        chord = self.points[1:] - self.points[:-1]
        straight = np.hypot(chord[:, 0], chord[:, 1])
        arc = self.is_arc.nonzero()[0]
        if len(arc):
            straight[arc] = self.radius[arc] * np.abs(self.sweep[arc])
        return straight

    @cached_property
    def cumulative(self) -> FloatArray:
        """(n + 1,) arc length at each point, mm."""
        total = np.zeros(len(self) + 1)
        np.cumsum(self.lengths, out=total[1:])
        return total

    @cached_property
    def rows(self) -> tuple[list[list[float]], list[list[float]], list[float]]:
        """End, centre and sweep of each piece as lists."""
        return self.points[1:].tolist(), self.centre.tolist(), self.sweep.tolist()

    @property
    def length(self) -> float:
        """Total length, mm."""
        return float(self.cumulative[-1])

    @property
    def closed(self) -> bool:
        """Whether the chain ends where it starts."""
        return bool(np.all(self.points[0] == self.points[-1])) and len(self) > 0

    @cached_property
    def extent(self) -> float:
        """Larger side of the bounding box of the sampled chain, mm."""
        sampled = self.at(np.linspace(0.0, self.length, 4 * len(self) + 1))
        corners = np.concatenate([sampled, self.points])
        return float(np.max(corners.max(axis=0) - corners.min(axis=0)))

    def reversed(self) -> Path:
        """The same chain travelled the other way."""
        return Path(self.points[::-1], self.centre[::-1], -self.sweep[::-1])

    def _locate(self, along: FloatArray) -> tuple[IntArray, FloatArray]:
        inside = np.minimum(np.maximum(along, 0.0), self.length)
        piece = self.cumulative.searchsorted(inside, side="right") - 1
        piece = np.minimum(np.maximum(piece, 0), len(self) - 1)
        size = np.maximum(self.lengths[piece], 1e-300)
        fraction = (inside - self.cumulative[piece]) / size
        return piece, np.minimum(np.maximum(fraction, 0.0), 1.0)

    def _evaluate(self, piece: IntArray, fraction: FloatArray) -> FloatArray:
        begin, end = self.points[piece], self.points[piece + 1]
        exact = begin + (end - begin) * fraction[..., None]
        arc = self.is_arc[piece]
        if arc.any():
            angle = self.sweep[piece] * fraction
            exact[arc] = turned(begin, self.centre[piece], angle)[arc]
        done = fraction >= 1.0
        if done.any():
            exact[done] = end[done]
        return exact

    def at(self, along: FloatArray) -> FloatArray:
        """(m, 2) points at arc lengths `along` (m,), mm."""
        piece, fraction = self._locate(np.asarray(along, dtype=np.float64))
        return self._evaluate(piece, fraction)

    def point(self, along: float) -> FloatArray:
        """(2,) point at arc length `along`, mm; to the last bit that of `at`."""
        return self._place(*self._piece(along))

    def _piece(self, along: float) -> tuple[int, float]:
        """As `_locate` for one place."""
        inside = min(max(along, 0.0), self.length)
        piece = int(self.cumulative.searchsorted(inside, side="right")) - 1
        piece = min(max(piece, 0), len(self) - 1)
        fraction = (inside - self.cumulative[piece]) / max(self.lengths[piece], 1e-300)
        return piece, float(min(max(fraction, 0.0), 1.0))

    def _place(self, piece: int, fraction: float) -> FloatArray:
        """As `_evaluate` for one place."""
        if fraction >= 1.0:
            return np.array(self.points[piece + 1])
        begin = self.points[piece]
        if not self.is_arc[piece]:
            return np.asarray(begin + (self.points[piece + 1] - begin) * fraction)
        centre = self.centre[piece]
        x, y = (begin - centre).tolist()
        angle = self.sweep[piece] * fraction
        cos, sin = np.cos(angle), np.sin(angle)
        return np.asarray(centre + np.array([cos * x - sin * y, sin * x + cos * y]))

    def tangent(self, along: float) -> FloatArray:
        """(2,) unit direction of travel at arc length `along`."""
        piece, fraction = self._piece(along)
        if not self.is_arc[piece]:
            chord = self.points[piece + 1] - self.points[piece]
            return np.asarray(chord / np.hypot(chord[0], chord[1]))
        offset = self._place(piece, fraction) - self.centre[piece]
        normal = offset / np.hypot(offset[0], offset[1])
        turn = np.sign(self.sweep[piece])
        return np.array([-normal[1] * turn, normal[0] * turn])

    def slice(self, start: float, stop: float) -> Path:
        """The part between two arc lengths, 0 <= start < stop <= length, mm."""
        (first, left), (last, kept) = self._piece(start), self._piece(stop)
        if kept == 0.0 and last > first:
            last, kept = last - 1, 1.0
        inner = self.points[first + 1 : last + 1]
        share = np.ones(last - first + 1)
        share[-1] = kept
        share[0] -= left
        return Path(
            np.concatenate([self._place(first, left)[None], inner, self._place(last, kept)[None]]),
            self.centre[first : last + 1],
            self.sweep[first : last + 1] * share,
        )

    def started_at(self, along: float, snap: float = 1e-3) -> Path:
        """A closed chain begun at another place; a joint within `snap` mm is taken instead."""
        joint = int(np.argmin(np.abs(self.cumulative - along)))
        if abs(self.cumulative[joint] - along) <= snap:
            along = float(self.cumulative[joint])
        if along <= 0.0 or along >= self.length:
            return self
        if len(self) == 1 and abs(abs(self.sweep[0]) - _FULL_TURN) < 1e-12:
            place = self.point(along)
            return Path(np.stack([place, place]), self.centre, self.sweep)
        return join(self.slice(along, self.length), self.slice(0.0, along))

    def nearest(self, point: FloatArray) -> Nearest:
        """Nearest point of the chain to `point` (2,)."""
        pieces = Pieces(self.points[:-1], self.points[1:], self.centre, self.sweep)
        fraction, distance = pieces.nearest(point)
        best = int(np.argmin(distance))
        place = self._place(best, float(fraction[best]))
        along = float(self.cumulative[best] + fraction[best] * self.lengths[best])
        return Nearest(along, place, float(distance[best]))

    def sample(self, step: float) -> tuple[FloatArray, FloatArray]:
        """Points (m, 2) and arc lengths (m,) at most `step` mm apart, joints included."""
        count = np.maximum(1, np.ceil(self.lengths / step)).astype(np.int64)
        piece = np.repeat(np.arange(len(self)), count)
        first = np.repeat(np.cumsum(count) - count, count)
        fraction = (np.arange(len(piece)) - first) / count[piece]
        points = self._evaluate(piece, fraction)
        along = self.cumulative[piece] + fraction * self.lengths[piece]
        return np.concatenate([points, self.points[-1:]]), np.append(along, self.length)

    @cached_property
    def sampled(self) -> tuple[FloatArray, FloatArray]:
        """Points and arc lengths of some `SAMPLES` places, joints included."""
        return self.sample(max(self.length / SAMPLES, 1e-9))

    @cached_property
    def tree(self) -> Places:
        """Of the points of `sampled`, for nearest-place queries by the hundred."""
        return Places(self.sampled[0])


def turned(points: FloatArray, centre: FloatArray, angle: FloatArray) -> FloatArray:
    """(..., 2) points turned about centres by angles (...,), counter-clockwise."""
    offset = points - centre
    cos, sin = np.cos(angle), np.sin(angle)
    result = np.empty_like(offset)
    result[..., 0] = cos * offset[..., 0] - sin * offset[..., 1]
    result[..., 1] = sin * offset[..., 0] + cos * offset[..., 1]
    return np.asarray(centre + result)


def arc_centres(begin: FloatArray, end: FloatArray, sweep: FloatArray) -> FloatArray:
    """(n, 2) centres of arcs by their ends and sweeps, mm; far away for straight ones."""
    chord = end - begin
    cot = 1 / np.tan(np.where(np.abs(sweep) < 1e-9, 1e-9, sweep) / 2)
    normal = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
    return np.asarray((begin + end + normal * cot[:, None]) / 2)


def left_of_arcs(offset: FloatArray, chord: FloatArray, half: FloatArray) -> FloatArray:
    """(n,) how far to the left of arcs, or of their circles, points lie, mm; of lines as well.

    With curvature c and the start tangent's normal n, 2 f / (1 + sqrt(1 - 2 c f)) for
    f = n.w - c w^2 / 2 is the distance, and n.w when c is zero.

    Parameters
    ----------
    offset, chord : (n, 2) float arrays
        From where the arcs begin to the points (w), and to where they end, mm.
    half : (n,) float array
        Half their sweeps, radians.
    """
    size = np.maximum(np.hypot(*chord.T), 1e-300)
    unit = chord / size[:, None]
    cos, sin = np.cos(half), np.sin(half)
    tangent_x = cos * unit[:, 0] + sin * unit[:, 1]
    tangent_y = -sin * unit[:, 0] + cos * unit[:, 1]
    bend = 2.0 * sin / size
    height = tangent_x * offset[:, 1] - tangent_y * offset[:, 0]
    height = height - 0.5 * bend * np.sum(offset * offset, axis=1)
    root = np.sqrt(np.maximum(1.0 - 2.0 * bend * height, 0.0))
    return np.asarray(2.0 * height / (1.0 + root))


class Pieces:
    """Lines and arcs as columns, prepared for the nearest place of each of them.

    Parameters
    ----------
    start, end : (n, 2) float arrays
        mm.
    centre : (n, 2) float array
        Of arcs, mm.
    sweep : (n,) float array
        Radians; 0 for lines.
    """

    def __init__(
        self, start: FloatArray, end: FloatArray, centre: FloatArray, sweep: FloatArray
    ) -> None:
        self._start, self._end = start, end
        self._chord = end - start
        self._square = np.maximum(_dot(self._chord, self._chord), 1e-300)
        self._arc = arc = sweep.nonzero()[0]
        self._centre = centre[arc]
        self._spoke = start[arc] - self._centre
        self._radius = np.hypot(self._spoke[:, 0], self._spoke[:, 1])
        self._size, self._sign = np.abs(sweep[arc]), np.sign(sweep[arc])

    def nearest(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest place of each piece to one point (2,), mm.

        Returns
        -------
        fraction : (n,) float array
            Where along each piece, in [0, 1].
        distance : (n,) float array
            How far from `point`, mm.
        """
        along = _dot(point - self._start, self._chord) / self._square
        fraction = np.minimum(np.maximum(along, 0.0), 1.0)
        foot = self._start + self._chord * fraction[:, None] - point
        distance = np.hypot(foot[:, 0], foot[:, 1])
        arc = self._arc
        if len(arc):
            spoke, towards = self._spoke, point - self._centre
            turn = np.arctan2(
                spoke[:, 0] * towards[:, 1] - spoke[:, 1] * towards[:, 0], _dot(spoke, towards)
            )
            swept = np.mod(turn * self._sign, _FULL_TURN)
            on_arc = swept <= self._size
            first, last = self._start[arc] - point, self._end[arc] - point
            to_start = np.hypot(first[:, 0], first[:, 1])
            to_end = np.hypot(last[:, 0], last[:, 1])
            near_end = np.where(to_end < to_start, 1.0, 0.0)
            fraction[arc] = np.where(on_arc, swept / self._size, near_end)
            gap = np.abs(np.hypot(towards[:, 0], towards[:, 1]) - self._radius)
            distance[arc] = np.where(on_arc, gap, np.minimum(to_start, to_end))
        return fraction, distance


def _dot(one: FloatArray, other: FloatArray) -> FloatArray:
    """(n,) inner products of plane vectors (n, 2)."""
    return np.asarray(one[:, 0] * other[:, 0] + one[:, 1] * other[:, 1])


def ranges(first: IntArray, count: IntArray) -> IntArray:
    """Consecutive integers, so many from each first one."""
    stop = count.cumsum()
    total = int(stop[-1]) if len(stop) else 0
    return np.asarray(np.arange(total) + (first - stop + count).repeat(count))


def _before(column: NDArray[Any]) -> NDArray[Any]:
    """The rows of a closed chain, each in the place of the one after it."""
    return np.concatenate([column[-1:], column[:-1]])


def join(*paths: Path) -> Path:
    """Chains laid end to end; each must start where the one before ends."""
    points = [paths[0].points] + [path.points[1:] for path in paths[1:]]
    return Path(
        np.concatenate(points),
        np.concatenate([path.centre for path in paths]),
        np.concatenate([path.sweep for path in paths]),
    )


def segment(start: FloatArray, end: FloatArray) -> Path:
    """One straight piece."""
    return Path(np.stack([start, end]), np.full((1, 2), np.nan), np.zeros(1))


def circle(centre: FloatArray, start: FloatArray, turn: float) -> Path:
    """A full turn about `centre` from `start`; `turn` > 0 is counter-clockwise."""
    return Path(
        np.stack([start, start]), np.array([centre]), np.array([np.copysign(_FULL_TURN, turn)])
    )


def repeat(path: Path, count: int) -> Path:
    """A closed chain travelled `count` times."""
    return join(*([path] * count))


def from_loop(loop: Loop, fit_tolerance: float, shortest: float = 1e-4) -> Path:
    """A loop as lines and arcs.

    Parameters
    ----------
    loop : Loop
        Closed; lines and arcs are kept, other curves fitted.
    fit_tolerance : float
        How far a fitted arc may lie from its curve, mm.
    shortest : float
        Pieces shorter than this are merged into their neighbours, which moves the chain by less
        than as much, mm.
    """
    starts: list[FloatArray] = []
    pieces: list[Line | Arc] = []
    for curve in loop.curves:
        own = [curve] if isinstance(curve, Line | Arc) else fit_arcs(curve, fit_tolerance)
        pieces += own
        starts += [piece.start for piece in own]
    return tidy(_from_pieces(starts, pieces), shortest)


def _from_pieces(starts: Sequence[FloatArray], pieces: Sequence[Line | Arc]) -> Path:
    """Closed chain through `starts`; arcs whose own ends differ from these are moved onto them."""
    points = np.array([*starts, starts[0]], dtype=np.float64)
    centre = np.full((len(pieces), 2), np.nan)
    sweep = np.zeros(len(pieces))
    for index, piece in enumerate(pieces):
        if isinstance(piece, Arc):
            centre[index] = piece.centre
            sweep[index] = piece.sweep
    return _recentred(Path(points, centre, sweep))


def tidy(path: Path, shortest: float = 1e-4) -> Path:
    """A closed chain without pieces shorter than `shortest` mm, equal neighbours made one.

    A chain shorter than `shortest` in all stays as it is. Arcs whose ends moved get the centre on
    the bisector of their new chord that is nearest to the old one.
    """
    if path.length <= 4 * shortest:
        return path
    while True:
        short = path.lengths < shortest
        if not short.any() or len(path) < 3:
            break
        # of neighbouring short pieces only every other one is dropped at a time: the rest grows
        drop = short & ~_before(short)
        if not drop.any():
            drop[::2] = True
        keep = ~drop
        # a kept piece starts where the dropped one before it started
        own = path.points[:-1]
        start = np.where(_before(drop)[:, None], _before(own), own)
        kept = start[keep]
        points = np.concatenate([kept, kept[:1]])
        path = _recentred(Path(points, path.centre[keep], path.sweep[keep]))
    return _merged(path)


def _recentred(path: Path) -> Path:
    """Centres moved onto the bisectors of the chords, so that both radii of an arc agree."""
    chord = path.points[1:] - path.points[:-1]
    size = np.hypot(chord[:, 0], chord[:, 1])
    usable = path.is_arc & (size > 1e-9)
    safe = np.maximum(size, 1e-300)[:, None]
    middle = (path.points[:-1] + path.points[1:]) / 2
    along = chord / safe
    slip = _dot(path.centre - middle, along)
    centre = np.where(usable[:, None], path.centre - along * slip[:, None], path.centre)
    first, last = path.points[:-1] - centre, path.points[1:] - centre
    turn = np.arctan2(first[:, 0] * last[:, 1] - first[:, 1] * last[:, 0], _dot(first, last))
    whole = np.round((path.sweep - turn) / _FULL_TURN) * _FULL_TURN
    sweep = np.where(usable, turn + whole, path.sweep)
    return Path(path.points, centre, sweep)


def _merged(path: Path, angular: float = 1e-8, tolerance: float = 1e-7) -> Path:
    """Collinear neighbours and arcs of one circle made one piece each (closed chain)."""
    count = len(path)
    if count < 2:
        return path
    chord = path.points[1:] - path.points[:-1]
    size = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-300)
    unit = chord / size[:, None]
    before = _before(unit)
    bend = np.abs(unit[:, 0] * before[:, 1] - unit[:, 1] * before[:, 0])
    arc, arc_before = path.is_arc, _before(path.is_arc)
    same_line = ~arc & ~arc_before & (_dot(unit, before) > 0) & (bend <= angular)
    same_circle = arc & arc_before
    if same_circle.any():
        side = np.sign(path.sweep)
        same_circle &= side == _before(side)
        gap = path.centre - _before(path.centre)
        same_circle &= np.nan_to_num(np.hypot(gap[:, 0], gap[:, 1]), nan=np.inf) <= tolerance
        radius = np.where(arc, path.radius, 0.0)
        same_circle &= np.abs(radius - _before(radius)) <= tolerance
    starts = np.flatnonzero(~(same_line | same_circle))
    if len(starts) == count:
        return path
    if not len(starts):
        if not arc.all():
            return path
        sweep = np.array([np.copysign(_FULL_TURN, path.sweep[0])])
        return Path(path.points[[0, 0]], path.centre[:1], sweep)
    order = np.roll(np.arange(count), -int(starts[0]))
    runs = starts - starts[0]
    sweep = np.add.reduceat(path.sweep[order], runs)
    begin = path.points[starts]
    return Path(np.concatenate([begin, begin[:1]]), path.centre[starts], sweep)
