"""One cut along a front: at the engagement limit in the open, along the wall elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from grassfire.errors import PlanningError
from grassfire.plan.fronts import GRAZE, densified, swept_edge
from grassfire.plan.path import BoolArray, IntArray, Path, join, segment
from grassfire.plan.pursuit import pursue, unit, wrapped
from grassfire.plan.smooth import fit
from grassfire.plan.walls import Walls
from grassfire.toolpath import FloatArray

SAMPLING = 0.05
"""Distance of samples of fronts, walls and ways as a part of the tool radius."""

FIRST_BITE = 0.1, 0.2
"""Engagement with which the opening spiral and other cuts from the open begin, radians."""

EASE = 6.0, 1.2
"""Length over which it rises to the limit, as parts of the tool radius."""

AIR = 0.7
"""Longest way along a wall without cutting before the cut ends, as a part of the tool radius."""

WINDOW = 64, 220
"""Wall samples and front samples looked at together."""

FIT = 1.5e-3, 6e-3
"""How far cuts may lie from the exact way at walls and away from them, mm."""

AT_WALL = 0.35
"""Fronts that begin nearer to the wall than this part of the tool radius begin at it."""

BACK = 60
"""Wall samples that a cut goes back at most to begin outside the stock."""

SHARPEST = np.radians(75.0), np.radians(60.0)
"""A cut that meets a wall turns along it to the left and to the right by this much at most."""

WHOLE, ENDED = -1, -2
"""How a cut ends in the open: at the end of its front, or where it would have to turn back."""

MOST_CHANGES = 2000
"""Changes between wall and open in one cut: more are a fault."""


class Start(NamedTuple):
    """Where a cut begins: at a wall sample, or in the open (-1) where the front begins."""

    sample: int
    point: FloatArray
    heading: float


@dataclass(frozen=True)
class Piece:
    """Part of a cut: free samples of the way, or wall samples.

    Attributes
    ----------
    points : (n, 2) float array
    heading : (n,) float array
    room : (n,) float array
        Clearance beyond that of the wall, or less, mm.
    samples : (n,) int array
        Indices of wall samples; empty for free pieces.
    """

    points: FloatArray
    heading: FloatArray
    room: FloatArray
    samples: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def free(self) -> bool:
        """Whether it runs through the open."""
        return not len(self.samples)


def start_of(front: FloatArray, walls: Walls, wall: float, radius: float) -> Start:
    """Where to begin a cut along a front: on the wall that it starts at, else at its start.

    Parameters
    ----------
    front : (n, 2) float array
        In the frame of the walls, mm.
    walls : Walls
    wall, radius : float
        Least distance of the tool centre from the boundary, radius of the tool, mm.
    """
    heading = direction(front[:4])
    place = front[0] - radius * unit(heading - np.pi / 2 + FIRST_BITE[1])
    at_front, at_place = walls.clearance(np.stack([front[0], place]))
    inside = at_place >= wall - 1e-6
    if at_front < AT_WALL * radius or not inside:
        back = walls.behind(walls.nearest(front[0]), BACK)
        gap = walls.points[back][:, None] - front[None, :BACK]
        clear = np.hypot(gap[..., 0], gap[..., 1]).min(axis=1) >= radius * (1 - 1e-3)
        if clear.any() or not inside:
            chosen = int(back[int(np.argmax(clear))])
            return Start(chosen, walls.points[chosen], float(walls.heading[chosen]))
    return Start(-1, place, heading)


@dataclass
class _Cut:
    """A cut on its way: its front, the last point passed, where the rim crosses it now.

    `lap` is the first piece of the lap of a spiral whose edge is not yet part of the front, or -1;
    `real` the number of points of the front without its straight extension; `others` holds the
    points of all other fronts.
    """

    front: FloatArray
    index: int
    point: FloatArray
    pieces: list[Piece]
    lap: int
    real: int
    others: cKDTree | None


class Tracer:
    """Traces cuts along fronts, all in the frame of the walls.

    Parameters
    ----------
    walls : Walls
    radius, engagement : float
        Of the tool, mm; largest engagement, radians.
    """

    def __init__(self, walls: Walls, radius: float, engagement: float) -> None:
        self._walls = walls
        self._radius = radius
        self._limit = engagement
        self._step = SAMPLING * radius

    def spiral(self, front: FloatArray) -> list[Piece]:
        """From a closed front outwards, lap by lap along the edge that the lap before has left."""
        cut = _Cut(front, 0, front[0], [], 0, len(front), None)
        bearing = direction(front[:2]) - np.pi / 2 + FIRST_BITE[0]
        ease: tuple[float, float] | None = (FIRST_BITE[0], EASE[0] * self._radius)
        while self._trace(cut, -1, bearing, ease) and cut.lap >= 0:
            offset = cut.front[-1] - cut.pieces[-1].points[-1]
            bearing, ease = float(np.arctan2(offset[1], offset[0])), None
            cut.index, cut.point = len(cut.front) - 1, cut.front[-1]
            self._wind(cut, len(cut.pieces) == cut.lap + 1)
        return cut.pieces

    def _wind(self, cut: _Cut, closed: bool) -> None:
        """Lengthen the front by the edge that the first piece of this lap has left.

        After a lap that met a wall (not `closed`) that is the last of the front.
        """
        edge, _ = swept_edge(cut.pieces[cut.lap].points, self._radius, self._step)
        gap = 0.6 * self._radius if cut.lap == 0 else 1e-6
        more = self._continued(cut.front, edge, gap)
        cut.real = len(cut.front) + len(more) - 1
        cut.front = np.concatenate([cut.front, (more if closed else self._extended(more))[1:]])
        cut.lap = len(cut.pieces) if closed else -1

    def cut(self, front: FloatArray, start: Start, others: Sequence[FloatArray]) -> list[Piece]:
        """Along an open front from its start, among others."""
        tree = cKDTree(np.concatenate(others), balanced_tree=False) if others else None
        cut = _Cut(self._extended(front), 0, front[0], [], -1, len(front), tree)
        offset = front[0] - start.point
        bearing = float(np.arctan2(offset[1], offset[0]))
        self._trace(cut, start.sample, bearing, (FIRST_BITE[1], EASE[1] * self._radius))
        return cut.pieces

    def path(self, pieces: list[Piece]) -> Path:
        """A cut as lines and arcs; wall pieces are the wall rings' own."""
        paths: list[Path] = []
        for piece in pieces:
            if piece.free:
                tolerance = np.clip(piece.room / 2, *FIT)
                own = fit(piece.points, piece.heading, tolerance) if len(piece.points) > 1 else None
            else:
                own = self._walls.slice(int(piece.samples[0]), int(piece.samples[-1]))
            begin = piece.points[0] if own is None else own.start
            if paths and np.hypot(*(begin - paths[-1].end)) > 1e-9:
                paths.append(segment(paths[-1].end, begin))
            if own is not None:
                if paths:
                    own = Path(
                        np.concatenate([paths[-1].end[None], own.points[1:]]), own.centre, own.sweep
                    )
                paths.append(own)
        return join(*paths)

    def _extended(self, front: FloatArray) -> FloatArray:
        """A front with a straight tool radius more: what lies beyond its end is no more stock."""
        along = unit(direction(front[-4:]))
        more = np.arange(1, round(self._radius / self._step) + 1) * self._step
        return np.concatenate([front, front[-1] + along * more[:, None]])

    def _continued(self, front: FloatArray, edge: FloatArray, gap: float) -> FloatArray:
        """The edge that a lap left, from the end of the front that the lap followed."""
        end, along = front[-1], unit(direction(front[-2:]))
        offset = edge - end
        behind = (offset @ along <= gap) & (np.hypot(*offset.T) < 2 * self._radius)
        return densified(np.concatenate([end[None], edge[int(np.argmin(behind)) :]]), self._step)

    def _trace(
        self, cut: _Cut, sample: int, bearing: float, ease: tuple[float, float] | None
    ) -> bool:
        """Open and wall by turns; whether the cut ended in the open at the end of the front."""
        for _ in range(MOST_CHANGES):
            if sample < 0:
                sample = self._open(cut, bearing, ease)
                if sample < 0:
                    return sample == WHOLE
            else:
                left = self._slide(cut, sample)
                if left is None:
                    return False
                sample, bearing = -1, left
            ease = None
        raise PlanningError(
            "a cut went back and forth between wall and open without end",
            place=(float(cut.point[0]), float(cut.point[1])),
            remedy="report the drawing; the strategy offset clears this pocket",
        )

    def _open(self, cut: _Cut, bearing: float, ease: tuple[float, float] | None) -> int:
        """At the limit through the open; the wall sample that stops it, else WHOLE or ENDED."""
        front = np.concatenate([cut.point[None], cut.front[cut.index + 1 :]])
        gap = np.hypot(*np.diff(front, axis=0).T)
        front = front[np.append(gap > 1e-6 * self._radius, True)]
        if len(front) < 2:
            return ENDED
        way = pursue(front, bearing, self._radius, self._engagement(front, ease))
        back = way.advance < 0
        stop = int(np.argmax(back)) if back.any() else len(back)
        if stop == 0:
            return ENDED
        room = self._walls.room(way.centre[:stop])
        outside = room < -1e-9
        # towards the wall the fitted way may be off by its tolerance
        outside[1:] |= (room[1:] < FIT[0]) & (room[1:] < room[:-1])
        outside[0] &= not cut.pieces
        leave = int(np.argmax(outside)) if outside.any() else stop
        if leave:
            cut.pieces.append(Piece(way.centre[:leave], way.heading[:leave], room[:leave]))
        if leave == stop:
            cut.index = len(cut.front) - len(front) + stop - 1
            return WHOLE if stop == len(front) else ENDED
        sample = self._walls.nearest(way.centre[leave])
        cut.index = len(cut.front) - len(front) + leave
        cut.point = front[leave]
        turn = float(wrapped(self._walls.heading[sample] - way.heading[leave]))
        return sample if -SHARPEST[1] <= turn <= SHARPEST[0] else ENDED

    def _engagement(self, front: FloatArray, ease: tuple[float, float] | None) -> FloatArray:
        """(n - 1,) engagement along a front: the limit, reached smoothly where a cut begins."""
        if ease is None:
            return np.full(len(front) - 1, self._limit)
        gone = np.cumsum(np.hypot(*np.diff(front, axis=0).T))
        share = np.clip(np.concatenate([[0.0], gone[:-1]]) / ease[1], 0.0, 1.0)
        return np.maximum(self._limit * share**2 * (3 - 2 * share), min(ease[0], self._limit))

    def _slide(self, cut: _Cut, sample: int) -> float | None:
        """Along the wall until the limit is reached: the bearing there; None where the cut ends."""
        if 0 <= cut.lap < len(cut.pieces) and len(cut.front) - cut.index < WINDOW[1]:
            self._wind(cut, closed=False)
        while cut.index < len(cut.front) - 2:
            ahead = self._walls.ahead(sample, WINDOW[0])
            touch = self._touch(cut, ahead)
            over = touch.engagement >= self._limit
            leave = int(np.argmax(over)) if over.any() else len(ahead)
            # round a corner of the pocket the front may be touched for long before it is cut
            patience = AIR * self._radius / self._step if cut.pieces else BACK
            end = _first_long_run(~touch.found, int(patience), leave)
            end = min(end, self._astray(cut, ahead, touch))
            if end < leave:
                if end:
                    self._slid(cut, ahead[:end])
                    cut.index += int(touch.passed[end - 1])
                return None
            if leave < len(ahead):
                self._slid(cut, ahead[: leave + 1])
                cut.index += int(touch.passed[leave])
                cut.point = touch.point[leave]
                return float(touch.bearing[leave])
            self._slid(cut, ahead)
            cut.index += int(touch.passed[-1])
            if sample == int(ahead[-1]):
                return None
            sample = int(ahead[-1])
        return None

    def _astray(self, cut: _Cut, samples: IntArray, touch: _Touch) -> int:
        """First sample past the end of the front, or in the stock of another one, or all."""
        place = self._walls.points[samples]
        gap = cut.front[cut.real - 1] - place
        bearing = np.arctan2(gap[:, 1], gap[:, 0])
        behind = wrapped(bearing - self._walls.heading[samples] + np.pi / 2) < 0
        spent = (cut.index + touch.passed >= cut.real - 1) & (
            behind | (np.hypot(gap[:, 0], gap[:, 1]) > self._radius)
        )
        if cut.others is not None:
            least = self._radius * (1 - GRAZE)
            near = cut.others.query(place, distance_upper_bound=least)[0]
            spent |= ~touch.found & np.isfinite(near)
        return int(np.argmax(spent)) if spent.any() else len(samples)

    def _slid(self, cut: _Cut, samples: IntArray) -> None:
        cut.pieces.append(
            Piece(
                self._walls.points[samples],
                self._walls.heading[samples],
                np.zeros(len(samples)),
                samples,
            )
        )

    def _touch(self, cut: _Cut, samples: IntArray) -> _Touch:
        """Where the rim crosses the front ahead, from wall samples."""
        front = cut.front[cut.index : cut.index + WINDOW[1]]
        place = self._walls.points[samples]
        gap = np.hypot(place[:, None, 0] - front[None, :, 0], place[:, None, 1] - front[None, :, 1])
        inside = gap < self._radius
        found = np.asarray(inside.any(axis=1))
        entered = np.argmax(inside, axis=1)
        beyond = ~inside & (np.arange(len(front))[None] >= entered[:, None])
        last = np.where(beyond.any(axis=1), np.argmax(beyond, axis=1), len(front) - 1)
        before = np.maximum(last - 1, 0)
        rows = np.arange(len(samples))
        low, high = gap[rows, before], gap[rows, last]
        share = np.clip((self._radius - low) / np.maximum(high - low, 1e-12), 0.0, 1.0)
        point = front[before] + (front[last] - front[before]) * share[:, None]
        offset = point - place
        bearing = np.arctan2(offset[:, 1], offset[:, 0])
        angle = wrapped(bearing - self._walls.heading[samples] + np.pi / 2)
        engagement = np.where(found & (angle < 0.9 * np.pi), angle, -1.0)
        return _Touch(found, engagement, point, bearing, before)


class _Touch(NamedTuple):
    """Crossings of rim and front, one row a wall sample; `passed` counts from the cut's index."""

    found: BoolArray
    engagement: FloatArray
    point: FloatArray
    bearing: FloatArray
    passed: IntArray


def direction(points: FloatArray) -> float:
    """Of the chord of a chain, radians."""
    step = points[-1] - points[0]
    return float(np.arctan2(step[1], step[0]))


def _first_long_run(flags: BoolArray, longest: int, stop: int) -> int:
    """Where the first run of set flags begins that is longer than `longest` or reaches the end.

    Only flags before `stop` count; `stop` where there is none.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags[:stop].astype(np.int8), [0]])))
    for begin, end in edges.reshape(-1, 2).tolist():
        if end - begin > longest or end == len(flags):
            return int(begin)
    return stop
