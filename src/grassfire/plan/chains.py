"""Cuts written as lines and arcs: few arcs through the open, the rings' own along walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import dropwhile, pairwise

import numpy as np

from grassfire.plan.arcs import Curve, fewest_arcs
from grassfire.plan.fronts import length
from grassfire.plan.path import SAME, Path, join, segment
from grassfire.plan.places import BoolArray, IntArray
from grassfire.plan.pursuit import unit, wrapped
from grassfire.plan.tracing import SKIM, Piece
from grassfire.plan.walls import Walls
from grassfire.toolpath import FloatArray

OPEN = 0.0105
"""How far cuts may lie beside the exact way away from walls, as a part of the tool radius."""

NEAREST = 0.3
"""Least distance of the samples that are looked at, as a part of that in fronts."""

BENT = 0.1
"""Radius of turns from which on samples lie closer together, as a part of the tool radius."""

FEWEST = 8
"""Samples that are looked at in any part of a cut, however short."""

KINK = np.radians(3.0)
"""Cuts that meet a wall at a larger angle turn at a corner."""

BESIDE = 4
"""Samples at the ends of a run that may be past where it begins or ends."""

SHORT = 0.02
"""Parts of a cut along walls that are shorter are left out, as a part of the tool radius."""

STRAY = 1.5
"""How far along a ring from its nearest sample a cut may meet it, in steps."""

ALONG = 0.98
"""Cosine of the largest angle at which a cut through the open may be begun a step before it."""

EASED = 6.0
"""Steps over which a cut that is begun beside its first sample comes to its way."""


@dataclass
class _Run:
    """Part of a cut: through the open, or along a ring.

    Attributes
    ----------
    points : (n, 2) float array
        Samples, of which those along rings keep the first and the last only, mm.
    heading, room : (n,) float arrays
        Direction of travel; clearance beyond that of the wall.
    ring : tuple of int or None
        First and last sample of the wall.
    before, after : float
        How far on from these it begins and ends, mm.
    origin : (2,) float array or None
        Where exactly it begins, if that is known, mm.
    path : Path or None
        As lines and arcs, once that is known; None where it is too short.
    """

    points: FloatArray
    heading: FloatArray
    room: FloatArray
    ring: tuple[int, int] | None = None
    before: float = 0.0
    after: float = 0.0
    origin: FloatArray | None = None
    path: Path | None = None

    def eased(self, begin: FloatArray, size: float) -> None:
        """Begin at a place beside the first sample, and come to the others within a length."""
        gone = np.hypot(*(self.points - self.points[0]).T)
        size = max(min(size, gone[-1]), SAME)
        share = np.minimum.accumulate(np.maximum(1.0 - gone / size, 0.0))
        self.points = self.points + share[:, None] * (begin - self.points[0])

    def with_ends(self, begin: FloatArray | None, end: FloatArray | None, least: float) -> None:
        """Begin and end at other places, without samples that are not `least` before or past."""
        columns = self.points, self.heading, self.room
        if begin is not None:
            past = _ahead(self.points - begin, self.heading) > least
            past[BESIDE:] = past[-1] = True
            columns = _joined((begin[None], self.heading[:1], np.zeros(1)), _rows(columns, past))
        if end is not None:
            before = _ahead(end - columns[0], columns[1]) > least
            before[:-BESIDE] = before[0] = True
            last = end[None], columns[1][-1:], np.zeros(1)
            columns = _joined(_rows(columns, before), last)
        self.points, self.heading, self.room = columns


_Columns = tuple[FloatArray, FloatArray, FloatArray]


def _ahead(gap: FloatArray, heading: FloatArray) -> FloatArray:
    """(n,) how far vectors go in directions."""
    return np.asarray(np.sum(gap * unit(heading), axis=1))


def _rows(columns: _Columns, chosen: BoolArray | IntArray) -> _Columns:
    points, heading, room = columns
    return points[chosen], heading[chosen], room[chosen]


def _joined(one: _Columns, two: _Columns) -> _Columns:
    points, heading, room = (np.concatenate(pair) for pair in zip(one, two, strict=True))
    return points, heading, room


class Writer:
    """Writes cuts as lines and arcs, all in the frame of the walls.

    Parameters
    ----------
    walls : Walls
    radius : float
        Of the tool, mm.
    step : float
        Distance of the samples of fronts and walls, mm.
    """

    def __init__(self, walls: Walls, radius: float, step: float) -> None:
        self._walls = walls
        self._open = OPEN * radius
        self._bent = BENT * radius
        self._short = SHORT * radius
        self._step = step

    def paths(self, cuts: Sequence[list[Piece]]) -> list[Path | None]:
        """Cuts that have a length as lines and arcs; wall pieces are the wall rings' own.

        None where a cut comes back to where it begins before there is a sample to look at.
        """
        laid = [self._laid(pieces) for pieces in cuts]
        free = [run for runs in laid for run in runs if run.path is None]
        for run, path in zip(free, self._fitted(free), strict=True):
            run.path = path
        parts = [[run.path for run in runs if run.path is not None] for runs in laid]
        return [join(*own) if own else None for own in parts]

    def _laid(self, pieces: list[Piece]) -> list[_Run]:
        """Runs of a cut from end to end, those along rings as paths."""
        runs = self._runs(pieces)
        for one, two in pairwise(runs):
            if one.ring is not None and two.ring is None:
                one.after = self._along(one.ring[1], two.points[0])
            elif two.ring is not None and one.ring is None:
                two.before = self._met(one, two)
        for number, run in enumerate(runs):
            if run.ring is not None:
                self._lay(run, run.ring, number == 0, number == len(runs) - 1)
        result: list[_Run] = []
        place = runs[0].origin if runs else None
        for number, run in enumerate(runs):
            if run.ring is None:
                after = runs[number + 1].points[0] if number + 1 < len(runs) else None
                if run.origin is not None and math.dist(run.origin, run.points[0]) <= self._open:
                    run.eased(run.origin, EASED * self._step)
                run.with_ends(place, after, NEAREST * self._step)
                if length(run.points) > SAME:
                    result.append(run)
            else:
                if place is not None and math.dist(place, run.points[0]) > SAME:
                    gap = np.stack([place, run.points[0]])
                    result.append(_Run(gap, np.zeros(2), np.zeros(2), path=segment(*gap)))
                if run.path is not None:
                    result.append(run)
            place = run.points[-1]
        return result

    def _runs(self, pieces: list[Piece]) -> list[_Run]:
        """Pieces of a cut, those that follow each other in the open or on a ring made one."""
        runs: list[_Run] = []
        # a cut begins with its first piece that has a length
        for piece in dropwhile(lambda piece: not piece.long, pieces):
            own = piece.points, piece.heading, piece.room
            ring = None if piece.free else (int(piece.samples[0]), int(piece.samples[-1]))
            origin, behind = piece.origin, 0.0
            if ring is not None and origin is not None:
                behind = self._behind(piece, origin) or 0.0
            last = runs[-1] if runs else None
            if last is not None and self._go_on(last, ring):
                runs.pop()
                before = last.points, last.heading, last.room
                if ring is not None and last.ring is not None:
                    ring = last.ring[0], ring[1]
                own, origin, behind = _joined(before, own), last.origin, -last.before
            runs.append(_Run(*own, ring, -behind, origin=origin))
        return runs

    def leads(self, piece: Piece, place: FloatArray) -> bool:
        """Whether a piece can begin at a place that is hardly a step before it.

        One along a ring, on the ring; one through the open where that way hardly turns, or by no
        more than it may lie beside the exact way.
        """
        if not piece.free:
            return self._behind(piece, place) is not None
        gap = piece.points - place
        far = np.hypot(gap[:, 0], gap[:, 1])
        ahead = unit(piece.heading[far <= 2 * far[0]]) @ gap[0]
        near = SAME < far[0] <= STRAY * self._step
        return bool(near and (ahead.min() > ALONG * far[0] or far[0] <= self._open))

    def _behind(self, piece: Piece, place: FloatArray) -> float | None:
        """How far before the first sample of a piece a place on its ring is, mm; None elsewhere."""
        back, sample = 0.0, int(piece.samples[0])
        ahead = unit(float(piece.heading[0]))
        for _ in range(3):
            gap = self._walls.beside(sample, -back) - place
            back += float(gap @ ahead)
        on = math.hypot(*gap.tolist()) <= SAME
        return back if on and SAME < back <= STRAY * self._step else None

    def _go_on(self, last: _Run, ring: tuple[int, int] | None) -> bool:
        """Whether a piece, along a ring or in the open, goes on where a run has ended."""
        if ring is None or last.ring is None:
            return ring is None and last.ring is None
        low, middle = last.ring
        lap = self._walls.steps(low, middle) + self._walls.steps(*ring)
        return middle == ring[0] and lap < self._walls.count[low]

    def _along(self, sample: int, place: FloatArray) -> float:
        """How far on the ring from a sample a place beside it is, mm."""
        gap = place - self._walls.points[sample]
        return float(gap @ unit(float(self._walls.heading[sample])))

    def _met(self, free: _Run, wall: _Run) -> float:
        """How far from its first sample a run along a ring begins, mm: where the way meets it."""
        course = float(free.heading[-1])
        turn = wrapped(float(wall.heading[0]) - course)
        if abs(turn) <= KINK:
            return 0.0
        gap, ahead = free.points[-1] - wall.points[0], unit(course)
        along = float(gap[1] * ahead[0] - gap[0] * ahead[1]) / math.sin(turn)
        return min(max(along, -STRAY * self._step), STRAY * self._step)

    def _lay(self, run: _Run, ring: tuple[int, int], first: bool, last: bool) -> None:
        """The path of a run along a ring, and where it begins and ends.

        The first run of a cut begins where the cut does, the last one ends where it ends.
        """
        size = run.after - run.before + (self._walls.size(*ring) if ring[0] != ring[1] else 0.0)
        if size > self._short or (first and last):
            run.path = self._walls.slice(*ring, run.before, run.after)
        if run.path is not None:
            run.points = run.path.points[[0, -1]]
            if run.origin is not None:
                run.path = _begun(run.path, run.origin)
        elif first or last:
            run.points = run.points[:1] if first else run.points[-1:]
        else:
            run.points = self._walls.beside(ring[1], run.after)[None]

    def _fitted(self, runs: list[_Run]) -> list[Path]:
        """Runs through the open as arcs."""
        if not runs:
            return []
        points, heading, room, count = self._sampled(runs)
        right, left = self._tolerances(points, heading, room)
        last = count.cumsum() - 1
        columns = (np.split(column, last[:-1] + 1) for column in (points, right, left))
        leave = heading[last + 1 - count].tolist()
        return fewest_arcs([Curve(*curve) for curve in zip(*columns, leave, strict=True)])

    def _sampled(self, runs: list[_Run]) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Samples of runs, at even distances and not too few; how many each has."""
        points, heading, room = (
            np.concatenate(column)
            for column in zip(*((it.points, it.heading, it.room) for it in runs), strict=True)
        )
        count = np.array([len(it.points) for it in runs])
        owner, last = np.arange(len(runs)).repeat(count), count.cumsum() - 1
        first = last + 1 - count
        turn = np.abs(wrapped(heading[1:] - heading[:-1]))
        total = np.zeros(len(points))
        (_gaps(points) + self._bent * turn).cumsum(out=total[1:])
        total -= total[first][owner]
        step = np.minimum(self._step, total[last] / FEWEST)[owner]
        pinned = np.zeros(len(points), dtype=bool)
        pinned[first] = pinned[last] = True
        rows = _thinned(points, np.floor(total / step), pinned, NEAREST * step)
        columns, owner = _rows((points, heading, room), rows), owner[rows]
        parts = np.ones(len(rows), dtype=np.int64)
        parts[:-1] = np.maximum(1, np.ceil(_gaps(columns[0]) / (2 * step[rows[:-1]])))
        parts[:-1][owner[1:] != owner[:-1]] = 1
        return *_divided(columns, parts), np.bincount(owner.repeat(parts), minlength=len(runs))

    def _tolerances(
        self, points: FloatArray, heading: FloatArray, room: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """How far to the right and to the left of samples cuts may lie, mm."""
        near = (room < self._open).nonzero()[0]
        sides = np.full((2, len(points)), self._open)
        for side, turn in zip(sides, (-np.pi / 2, np.pi / 2), strict=True):
            beside = points[near] + self._open * unit(heading[near] + turn)
            rows = near[self._walls.clearance(beside) < self._walls.wall - SKIM]
            side[rows] = np.minimum(self._open, np.maximum(room[rows], 0.0) + SKIM)
        return sides[0], sides[1]


def _begun(path: Path, place: FloatArray) -> Path:
    """A path begun at a place that is its start but for rounding, perhaps beside a joint."""
    first = 1 if len(path) > 1 and path.lengths[0] <= SAME else 0
    points = np.concatenate([place[None], path.points[first + 1 :]])
    return Path(points, path.centre[first:], path.sweep[first:])


def _gaps(points: FloatArray) -> FloatArray:
    """(n - 1,) distances of neighbours, mm."""
    step = points[1:] - points[:-1]
    return np.asarray(np.hypot(step[:, 0], step[:, 1]))


def _thinned(
    points: FloatArray, bins: FloatArray, pinned: BoolArray, least: FloatArray
) -> IntArray:
    """The first samples of all bins that are not nearer to another than `least`, and pinned ones.

    Pinned are both ends of each run.
    """
    chosen = pinned.copy()
    chosen[1:] |= bins[1:] != bins[:-1]
    rows = chosen.nonzero()[0]
    near = _gaps(points[rows]) < least[rows[1:]]
    drop = np.zeros(len(rows), dtype=bool)
    drop[1:] = near
    drop[:-1] |= near & pinned[rows[1:]]
    return rows[~drop | pinned[rows]]


def _divided(columns: _Columns, parts: IntArray) -> _Columns:
    """Samples with others between, so that each step has so many parts."""
    index = np.arange(len(parts)).repeat(parts)
    share = (np.arange(len(index)) - (parts.cumsum() - parts)[index]) / parts[index]
    after = np.minimum(index + 1, len(parts) - 1)
    points, heading, room = columns
    turn = wrapped(heading[after] - heading[index])
    return (
        points[index] + (points[after] - points[index]) * share[:, None],
        heading[index] + turn * share,
        room[index] + (room[after] - room[index]) * share,
    )
