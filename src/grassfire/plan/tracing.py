"""One cut along a front: at the engagement limit in the open, along the wall elsewhere."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from grassfire.errors import PlanningError
from grassfire.plan.fronts import (
    GRAZE,
    WALL_SKIN,
    densified,
    direction,
    length,
    squares,
    swept_edge,
)
from grassfire.plan.places import BoolArray, IntArray
from grassfire.plan.pursuit import Pursuit, pursue, unit, wrapped
from grassfire.plan.walls import Walls, mirrored
from grassfire.toolpath import FloatArray

SAMPLING = 0.05
"""Distance of samples of fronts, walls and ways as a part of the tool radius."""

ENDING = 8
"""Last points of a front that tell how it goes on: fewer bend with the hook that a cut may leave at
a wall, and the next cut bends more."""

FIRST_BITE = 0.1, 0.2
"""Engagement with which the opening spiral and other cuts from the open begin, radians."""

EASE = 3.0, 1.2
"""Length over which it rises to the limit, as parts of the tool radius."""

LEAVING, WIDE_CUT = (0.02, 0.6), np.radians(70.0)
"""How much lower it is where a cut leaves a wall, radians, and over which length, in tool radii;
limits from which on it need not be: there a tooth feels the edge of the stock less."""

ABRUPT, SUDDEN, FEW = 0.88, (0.1, 0.4), 5
"""Turn of what a cut has met of its front where it leaves the wall at which it begins, as a part of
the limit, from which on it begins lower; how much lower, and over which length; fewest points that
tell. The rim meets a front as tight as the tool everywhere at once."""

LEADS = 0.5, 1.0, 1.5
"""How far before its front a cut from the open may begin, as parts of the tool radius."""

OUTWARDS = 0.6
"""Length over which the edge of the opening spiral leaves its closed front, in tool radii."""

TURNED = 2e-4
"""Step by which a turn at the end of a way is shown, as a part of the tool radius."""

AIR = 0.7
"""Longest way along a wall without cutting before the cut ends, as a part of the tool radius."""

WINDOW = 64, 220
"""Wall samples and front samples looked at together."""

SKIM = 1.5e-3
"""How far beyond the exact way cuts as written may lie at walls, mm."""

AT_WALL = 0.35
"""Fronts that begin nearer to the wall than this part of the tool radius begin at it."""

BACK = 60
"""Wall samples that a cut goes back at most to begin outside the stock."""

SHARPEST = np.radians(75.0), np.radians(60.0)
"""A cut that meets a wall turns along it to the left and to the right by this much at most."""

BACKWARDS = 2e-3
"""How far back a way may go from sample to sample, as a part of the tool radius: fronts as tight as
the tool hold it in one place, but for rounding."""

MOST_PIVOT = np.radians(30.0)
"""How far a cut turns on the spot at most where its front is too tight for the tool."""

WHOLE, ENDED, ON = -1, -2, -3
"""How a way in the open ends: with its front, where the tool would have to go back, or not yet."""

BETWEEN = 16
"""Places between two wall samples at which a cut may leave the wall."""

NEXT = 0.3
"""Samples nearer to where their way meets a wall than this part of a step are left out."""

MOST_CHANGES = 2000
"""Changes between wall and open in one cut: more are a fault."""


BITE, TIGHT, MOST_TURN = (0.0487, 0.0597), 2 / 3, np.radians(30.0)
"""Turn of the tool, radians, over what it advances from tooth to tooth, or over one of the chords
by which controllers follow an arc, on arcs as wide as the tool; the power of the radius that it
falls with on tighter ones, where chords are shorter; and most that it may be."""

SLACK = 0.05
"""How much tighter than the tool fronts may be that a way follows, as a part of its radius."""

STRAIGHT = 0.5
"""Turn of fronts up to which they count as straight, radians."""

WIDE_TURN = 0.012
"""What of it the opening spiral need not allow for, radians: most of its turns are wide."""

BESIDES = np.radians(4.0)
"""How far past the limit a cut may go into the stock of another front, radians."""

PROBES, PROBED = np.radians(3.0), 0.01
"""Angle between places round the rim where stock is looked for, radians, and how far outside the
rim these are, as a part of the tool radius."""


class Surroundings(NamedTuple):
    """What is known about the stock beside the front of a cut.

    Attributes
    ----------
    near : callable
        Gives points (m, 2) of other fronts that may be nearer to places (n, 2) than a distance, mm.
    cleared : callable
        Tells which places (n, 2) the tool's centre has been nearer to than a distance, mm.
    """

    near: Callable[[FloatArray, float], FloatArray]
    cleared: Callable[[FloatArray, float], BoolArray]

    def mirrored(self) -> Surroundings:
        """Those in the image in the x axis."""
        return Surroundings(
            lambda places, reach: mirrored(self.near(mirrored(places), reach)),
            lambda places, reach: self.cleared(mirrored(places), reach),
        )


class Start(NamedTuple):
    """Where a cut begins: at a wall sample, or in the open (-1) where the front begins.

    `lead` is how far before the front a cut from the open begins, mm: there it is laid out at the
    limit, and comes into the stock in passing; with none it begins with a small bite.
    """

    sample: int
    point: FloatArray
    heading: float
    lead: float = 0.0


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
    origin : (2,) float array or None
        Place before the first sample, on the ring along one, where it begins instead, mm.
    """

    points: FloatArray
    heading: FloatArray
    room: FloatArray
    samples: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    origin: FloatArray | None = None

    @property
    def free(self) -> bool:
        """Whether it runs through the open."""
        return not len(self.samples)

    @property
    def long(self) -> bool:
        """Whether it is longer than what cuts as written may be off."""
        if self.free:
            return length(self.points) > SKIM
        return bool(self.samples[0] != self.samples[-1])


@dataclass
class _Cut:
    """A cut on its way: its front, the last point passed, where the rim crosses it now.

    `lap` is the first piece of the lap of a spiral whose edge is not yet part of the front, or -1;
    `real` the number of points of the front that are to be cut, without its straight extension;
    `limit` is its engagement, radians; `beside` tells of stock of other fronts, None if there are
    none; `tail` tells how much of the front of a spiral need not be cut; `lead` is the number of
    points with which the front begins before the stock.
    """

    front: FloatArray
    index: int
    point: FloatArray
    pieces: list[Piece]
    lap: int
    real: int
    limit: float
    beside: Surroundings | None = None
    tail: Callable[[FloatArray], int] | None = None
    lead: int = 0


class Tracer:
    """Traces cuts along fronts, all in the frame of the walls.

    Parameters
    ----------
    walls : Walls
    radius, engagement : float
        Of the tool, mm; largest engagement, radians.
    film : float
        Thickest stock that may be left along the wall where a cut ends, mm.
    """

    def __init__(self, walls: Walls, radius: float, engagement: float, film: float) -> None:
        self._walls = walls
        self._radius = radius
        self._limit = engagement
        self._bite = BITE[0] + BITE[1] * math.cos(engagement)
        self._film = math.acos(1 - film / radius)
        self._step = SAMPLING * radius

    def spiral(
        self, front: FloatArray, room: float, tail: Callable[[FloatArray], int]
    ) -> list[Piece]:
        """From a closed front outwards, lap by lap along the edge that the lap before has left.

        `room` is that about its centre, mm; `tail` tells how many last points of a front may be
        left along the wall.
        """
        limit = self._limit - max(self._turned(room) - WIDE_TURN, 0.0)
        cut = _Cut(front, 0, front[0], [], 0, len(front), limit, tail=tail)
        bearing = direction(front[:2]) - np.pi / 2 + FIRST_BITE[0]
        ease: tuple[float, float] | None = (FIRST_BITE[0], EASE[0] * self._radius)
        while self._trace(cut, -1, bearing, ease) and cut.lap >= 0:
            offset = cut.front[-1] - cut.pieces[-1].points[-1]
            bearing, ease = float(np.arctan2(offset[1], offset[0])), None
            cut.index, cut.point = len(cut.front) - 1, cut.front[-1]
            self._wind(cut, None)
        return cut.pieces

    def _wind(self, cut: _Cut, wall: float | None) -> None:
        """Lengthen the front by the edge that the first piece of this lap has left.

        Where a wall ended that piece, the turn along it leaves an arc, the last of the front.
        `wall` is its heading if the tool is there still, radians; None after a lap.
        """
        way, after = cut.pieces[cut.lap].points, cut.pieces[cut.lap + 1 :]
        wall = float(after[0].heading[0]) if after else wall
        closed = wall is None
        if wall is not None:
            way = np.concatenate([way, way[-1:] + TURNED * self._radius * unit(wall)])
        edge, _ = swept_edge(way, self._radius, self._step)
        more = self._begun(cut.front, edge) if cut.lap == 0 else self._continued(cut.front, edge)
        front = np.concatenate([cut.front, more[1:]])
        cut.real = len(front)
        cut.front = front if closed else self._extended(front)
        if not closed and cut.tail is not None:
            cut.real = max(cut.real - cut.tail(cut.front[: cut.real]), cut.index + 3)
        cut.lap = len(cut.pieces) if closed else -1

    def start(
        self, front: FloatArray, wall: float, free: Callable[[FloatArray], BoolArray]
    ) -> Start:
        """Where to begin a cut along a front: on the wall that it starts at, else near its start.

        Parameters
        ----------
        front : (n, 2) float array
            In the frame of the walls, mm.
        wall : float
            Least distance of the tool centre from the boundary, mm.
        free : callable
            Tells of (n, 2) places whether the tool touches neither wall nor stock there.
        """
        radius = self._radius
        heading = direction(front[:4])
        turns = np.array([heading - np.pi / 2 + FIRST_BITE[1], heading - np.pi / 2 + self._limit])
        place, before = front[0] - radius * unit(turns)
        near = AT_WALL * radius
        at_front, at_place = self._walls.clearance(
            np.array([front[0], place]), max(wall, near)
        ).tolist()
        inside = at_place >= wall - 1e-6
        if at_front < near or not inside:
            back = self._walls.behind(self._walls.nearest(front[0]), BACK)
            points = self._walls.points.take(back, axis=0)
            clear = squares(points, front[:BACK]).min(axis=1) >= (radius * (1 - 1e-3)) ** 2
            if clear.any() or not inside:
                chosen = int(back[int(clear.argmax())])
                return Start(chosen, self._walls.points[chosen], float(self._walls.heading[chosen]))
        leads = np.array(LEADS) * radius
        places = before - leads[:, None] * unit(heading)
        chosen = _first(free(places))
        if chosen < len(leads):
            return Start(-1, places[chosen], heading, float(leads[chosen]))
        return Start(-1, place, heading)

    def cut(self, front: FloatArray, start: Start, beside: Surroundings) -> list[Piece]:
        """Along an open front from its start, among others."""
        ease: tuple[float, float] | None = (FIRST_BITE[1], EASE[1] * self._radius)
        lead = 0
        if start.lead > 0:
            lead = round(start.lead / self._step)
            before = np.arange(lead, 0, -1) * self._step
            front = np.concatenate([front[0] - before[:, None] * unit(start.heading), front])
            ease = None
        limit = self._narrowed(front)
        cut = _Cut(self._extended(front), 0, front[0], [], -1, len(front), limit, beside, lead=lead)
        offset = front[0] - start.point
        self._trace(cut, start.sample, float(np.arctan2(offset[1], offset[0])), ease)
        # where it meets the wall it ends, not at the next sample of that
        if len(cut.pieces) > 1 and not cut.pieces[-1].long and cut.pieces[-2].free:
            cut.pieces.pop()
        return cut.pieces

    def begin(self, pieces: list[Piece]) -> FloatArray | None:
        """Where a cut begins, or None without length."""
        return next((piece.points[0] for piece in pieces if piece.long), None)

    def _narrowed(self, front: FloatArray) -> float:
        """The limit less what the turns of the way add to the angle that a tooth cuts, radians.

        The way turns as the front does, less a tool radius. A front much tighter than the tool is
        no edge that the way follows.
        """
        chord = front[1:] - front[:-1]
        bearing = np.arctan2(chord[:, 1], chord[:, 0])
        turn = float(wrapped(bearing[1:] - bearing[:-1]).sum())
        if turn <= STRAIGHT:
            return self._limit
        wide = _gap(front[-1], front[0]) / (2 * math.sin(min(turn, math.pi) / 2))
        if wide < (1 - SLACK) * self._radius:
            return self._limit
        return self._limit - self._turned(wide - self._radius)

    def _turned(self, room: float) -> float:
        """What turns of a radius, mm, add to the angle that a tooth cuts, radians."""
        part = max(room / self._radius, 1e-9)
        return min(self._bite / max(part, math.pow(part, TIGHT)), float(MOST_TURN))

    def _extended(self, front: FloatArray) -> FloatArray:
        """A front with a straight tool radius more: what lies beyond its end is no more stock."""
        along = unit(direction(front[-ENDING:]))
        more = np.arange(1, round(self._radius / self._step) + 1) * self._step
        return np.concatenate([front, front[-1] + along * more[:, None]])

    def _begun(self, front: FloatArray, edge: FloatArray) -> FloatArray:
        """The edge that the first lap left, from a closed front outwards.

        It begins along the front again and comes to the edge by and by: a chord would turn in.
        """
        reach = int(OUTWARDS / SAMPLING)
        gap = squares(edge, front[reach : reach + 1])[:, 0]
        nearest = int(np.argmin(gap))
        offset = edge[nearest] - front[reach]
        share = np.linspace(0.0, 1.0, reach + 1)[:, None]
        return np.concatenate([front[: reach + 1] + share * offset, edge[nearest + 1 :]])

    def _continued(self, front: FloatArray, edge: FloatArray) -> FloatArray:
        """The edge that a lap left, from the end of the front that the lap followed."""
        end, along = front[-1], unit(direction(front[-2:]))
        offset = edge - end
        behind = (offset @ along <= 1e-6) & (np.hypot(*offset.T) < 2 * self._radius)
        return densified(np.concatenate([end[None], edge[int(np.argmin(behind)) :]]), self._step)

    def _trace(
        self, cut: _Cut, sample: int, bearing: float, ease: tuple[float, float] | None
    ) -> bool:
        """Open and wall by turns; whether the cut ended in the open at the end of the front."""
        for _ in range(MOST_CHANGES):
            if sample < 0:
                sample, bearing = self._open(cut, bearing, ease)
                if sample in (WHOLE, ENDED):
                    return sample == WHOLE
            else:
                left = self._slide(cut, sample)
                if left is None:
                    return False
                sample, bearing = -1, left
            ease = self._risen(cut)
        raise PlanningError(
            "a cut went back and forth between wall and open without end",
            place=(float(cut.point[0]), float(cut.point[1])),
            remedy="report the drawing; the strategy offset clears this pocket",
        )

    def _risen(self, cut: _Cut) -> tuple[float, float] | None:
        """Engagement with which a cut leaves a wall, and over which length it rises, or None."""
        less, over = LEAVING if cut.limit < WIDE_CUT else (0.0, 0.0)
        met = cut.front[: cut.index + 1]
        if len(met) > FEW and not any(piece.long for piece in cut.pieces):
            turn = wrapped(direction(met[-3:]) - direction(met[:3]))
            if turn > ABRUPT * cut.limit:
                less, over = min(SUDDEN[0], cut.limit / 4), SUDDEN[1]
        return (cut.limit - less, over * self._radius) if less else None

    def _open(
        self, cut: _Cut, bearing: float, ease: tuple[float, float] | None
    ) -> tuple[int, float]:
        """At the limit through the open; the wall sample that stops it, or WHOLE, ENDED or ON.

        And the bearing with which it goes on.
        """
        front = np.concatenate([cut.point[None], cut.front[cut.index + 1 :]])
        chord = front[1:] - front[:-1]
        same = np.hypot(chord[:, 0], chord[:, 1]) <= 1e-6 * self._radius
        if same.any():
            front = np.delete(front, same.nonzero()[0], axis=0)
        if len(front) < 2:
            return ENDED, bearing
        way = pursue(front, bearing, self._radius, _eased(front, cut.limit, ease))
        # the first row is where the way begins
        gone = ((way.centre[1:] - way.centre[:-1]) * unit(way.heading[1:])).sum(axis=1)
        stop = _first((way.advance[1:] < 0) | (gone < -BACKWARDS * self._radius)) + 1
        room = self._walls.room(way.centre[:stop])
        if cut.pieces and room[0] < -SKIM:
            # the rim met no front that goes on from here
            return ENDED, bearing
        outside = room < -1e-9
        # towards the wall the fitted way may be off by its tolerance
        outside[1:] |= (room[1:] < SKIM) & (room[1:] < room[:-1])
        outside[0] &= not cut.pieces
        leave = _first(outside)
        clear = self._clear_until(cut, way.centre[:leave], way.heading[:leave])
        if clear < leave:
            cut.pieces.append(Piece(way.centre[:clear], way.heading[:clear], room[:clear]))
            return ENDED, bearing
        if leave:
            cut.pieces.append(_until(way, room, leave, leave < stop))
        if leave == stop:
            cut.index = len(cut.front) - len(front) + stop - 1
            if stop == len(front):
                return WHOLE, bearing
            if cut.lap >= 0:
                # a lap of a spiral goes on as one piece
                return ENDED, bearing
            return self._pivoted(cut, way.centre[stop - 1], float(way.bearing[stop - 1]))
        sample = self._met(cut, way.centre[leave])
        cut.index = len(cut.front) - len(front) + leave
        cut.point = front[leave]
        turn = wrapped(float(self._walls.heading[sample] - way.heading[leave]))
        return sample if -SHARPEST[1] <= turn <= SHARPEST[0] else ENDED, bearing

    def _met(self, cut: _Cut, beyond: FloatArray) -> int:
        """The wall sample at which a way goes on that leaves the pocket: the first after its end.

        A way without length leaves it at once, to a place `beyond`.
        """
        if not cut.pieces:
            return self._walls.nearest(beyond)
        # the place beyond may be two samples further
        place = cut.pieces[-1].points[-1]
        sample = self._walls.nearest(place)
        if (self._walls.points[sample] - place) @ unit(float(self._walls.heading[sample])) < 0:
            return int(self._walls.ahead(sample, 2)[-1])
        return sample

    def _pivoted(self, cut: _Cut, centre: FloatArray, bearing: float) -> tuple[int, float]:
        """Over a place of the front that is tighter than the tool: ON or ENDED, and the bearing.

        There the front runs into the disk of the tool. Where it comes out again the rim meets it,
        and the tool turns on the spot to keep to the limit.
        """
        ahead = cut.front[cut.index + 1 : cut.index + 1 + WINDOW[1]]
        gap = _gaps(ahead, centre)
        out = gap > self._radius
        if out.all() or not out.any() or out[0]:
            return ENDED, bearing
        after = int(np.argmax(out))
        share = (self._radius - gap[after - 1]) / (gap[after] - gap[after - 1])
        point = ahead[after - 1] + (ahead[after] - ahead[after - 1]) * share
        offset = point - centre
        across = float(np.arctan2(offset[1], offset[0]))
        turn = wrapped(across - bearing)
        if abs(turn) > MOST_PIVOT:
            return ENDED, bearing
        cut.index, cut.point = cut.index + after, point
        return ON, bearing + turn

    def _slide(self, cut: _Cut, sample: int) -> float | None:
        """Along the wall until the limit is reached: the bearing there; None where the cut ends."""
        while cut.index < len(cut.front) - 2:
            if 0 <= cut.lap < len(cut.pieces) and len(cut.front) - cut.index < WINDOW[1]:
                self._wind(cut, float(self._walls.heading[sample]))
            ahead = self._walls.ahead(sample, WINDOW[0])
            touch = self._touch(cut, self._walls.points[ahead], self._walls.heading[ahead])
            leave = _first(touch.engagement >= cut.limit)
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
                return self._left(cut, ahead[: leave + 1], touch)
            self._slid(cut, ahead)
            cut.index += int(touch.passed[-1])
            if sample == int(ahead[-1]):
                return None
            sample = int(ahead[-1])
        return None

    def _left(self, cut: _Cut, samples: IntArray, touch: _Touch) -> float:
        """Along the wall to where the limit is reached, before the last sample; the bearing."""
        leave = len(samples) - 1
        if leave:
            share = np.arange(1, BETWEEN) / BETWEEN
            between = self._touch(cut, *self._walls.beyond(int(samples[-2]), share))
            first = _first(between.engagement >= cut.limit)
            if first < len(share):
                touch, leave, samples = between, first, samples[:-1]
        self._slid(cut, samples)
        cut.index += int(touch.passed[leave])
        cut.point = touch.point[leave]
        return float(touch.bearing[leave])

    def _astray(self, cut: _Cut, samples: IntArray, touch: _Touch) -> int:
        """First sample past the end of the front, or in the stock of another one, or all."""
        place = self._walls.points[samples]
        spent = cut.index + touch.passed >= cut.real - 1
        late = spent.nonzero()[0]
        if len(late):
            gap = cut.front[cut.real - 1] - place[late]
            bearing = np.arctan2(gap[:, 1], gap[:, 0])
            behind = wrapped(bearing - self._walls.heading[samples[late]] + np.pi / 2) < 0
            # the edge that is met beyond the end may be that of a film
            angle = touch.engagement[late]
            film = touch.found[late] & (angle >= 0) & (angle <= self._film)
            spent[late] = behind | film | (np.hypot(gap[:, 0], gap[:, 1]) > self._radius)
        heading = self._walls.heading[samples]
        others = self._near_others(cut, place, heading, touch.found)
        # in a slot the rim meets the front beside the tool: that is no edge behind it
        rows = np.union1d(others, touch.beside.nonzero()[0])
        spent[self._entered(cut, place, heading, rows)] = True
        return _first(spent)

    def _clear_until(self, cut: _Cut, place: FloatArray, heading: FloatArray) -> int:
        """How many places of a way come before it goes into another front past the limit.

        There is one at least; a single place past the limit is a touch.
        """
        entered, found = np.zeros(len(place), dtype=bool), np.ones(len(place), dtype=bool)
        rows = self._near_others(cut, place, heading, found)
        if not cut.pieces:
            # a front that began in another direction would lead through its own stock
            rows = np.union1d(rows, np.arange(min(cut.lead, len(place))))
        entered[self._entered(cut, place, heading, rows)] = True
        both = entered[:-1] & entered[1:]
        return max(_first(both), 1) if both.any() else len(place)

    def _near_others(
        self, cut: _Cut, place: FloatArray, heading: FloatArray, found: BoolArray
    ) -> IntArray:
        """Rows of places where the tool may be in stock of another front past the limit.

        `found` says where its own one is met.
        """
        none = np.zeros(0, dtype=np.int64)
        if cut.beside is None or not len(place):
            return none
        reach = self._radius * (1 - GRAZE)
        points = cut.beside.near(place, reach)
        if not len(points):
            return none
        row, column = (squares(place, points) < reach**2).nonzero()
        offset = points[column] - place[row]
        bearing = np.arctan2(offset[:, 1], offset[:, 0])
        angle = wrapped(bearing - heading[row] + np.pi / 2)
        ahead = (angle > cut.limit + BESIDES) & (angle < 0.9 * np.pi)
        # where a cut begins it can only go on
        ahead &= (row > 0) | bool(cut.pieces)
        return np.unique(row[ahead | ~found[row]])

    def _entered(
        self, cut: _Cut, place: FloatArray, heading: FloatArray, rows: IntArray
    ) -> IntArray:
        """Those of some rows of places where the tool is in stock past the limit.

        Where one front has been cut away nearly, another one may be entered far ahead.
        """
        if cut.beside is None or not len(rows):
            return np.zeros(0, dtype=np.int64)
        limit = cut.limit + BESIDES
        past = self.past(cut.beside.cleared, place.take(rows, axis=0), heading.take(rows), limit)
        return np.asarray(rows[past])

    def past(
        self,
        cleared: Callable[[FloatArray, float], BoolArray],
        place: FloatArray,
        heading: FloatArray,
        limit: float,
        skin: float = WALL_SKIN,
    ) -> BoolArray:
        """(n,) where the front half of the rim is in stock past a limit, whatever front that is of.

        `cleared` is that of `Surroundings`, the limit in radians. Stock nearer to the wall than
        `skin`, a part of the tool radius, is a film and left out; but beside a wall on the right it
        is the foot of what follows on it, and counts.
        """
        angle = np.arange(PROBES / 2, np.pi, PROBES)
        spoke = (1 + PROBED) * self._radius * unit(heading[:, None] - np.pi / 2 + angle)
        rim = (place[:, None] + spoke).reshape(-1, 2)
        stock = ~cleared(rim, self._radius)
        rows = stock.nonzero()[0]
        off = self._walls.off(rim.take(rows, axis=0), skin * self._radius)
        film = np.zeros_like(stock)
        film[rows], stock[rows] = ~off, off
        film, stock = film.reshape(-1, len(angle)), stock.reshape(-1, len(angle))
        foot = film.argmin(axis=1)
        count = stock.sum(axis=1) + foot * stock[np.arange(len(stock)), foot]
        return np.asarray(count * PROBES > limit)

    def _slid(self, cut: _Cut, samples: IntArray) -> None:
        cut.pieces.append(
            Piece(
                self._walls.points[samples],
                self._walls.heading[samples],
                np.zeros(len(samples)),
                samples,
            )
        )

    def _touch(self, cut: _Cut, place: FloatArray, heading: FloatArray) -> _Touch:
        """Where the rim crosses the front ahead, from places with headings."""
        front = cut.front[cut.index : cut.index + WINDOW[1]]
        inside = squares(place, front) < self._radius**2
        entered = inside.argmax(axis=1)
        rows = np.arange(len(place))
        found = inside[rows, entered]
        beyond = np.arange(len(front)) >= entered[:, None]
        beyond &= ~inside
        last = beyond.argmax(axis=1)
        last[~beyond[rows, last]] = len(front) - 1
        before = np.maximum(last - 1, 0)
        begin, end = front.take(before, axis=0), front.take(last, axis=0)
        low, high = _gaps(begin, place), _gaps(end, place)
        share = (self._radius - low) / np.maximum(high - low, 1e-12)
        share = np.minimum(np.maximum(share, 0.0), 1.0)
        point = begin + (end - begin) * share[:, None]
        offset = point - place
        bearing = np.arctan2(offset[:, 1], offset[:, 0])
        angle = wrapped(bearing - heading + np.pi / 2)
        ahead = angle < 0.9 * np.pi
        engagement = np.where(found & ahead, angle, -1.0)
        return _Touch(found, engagement, point, bearing, before, found & ~ahead)


class _Touch(NamedTuple):
    """Crossings of rim and front, one row a wall sample; `passed` counts from the cut's index.

    `beside` says where the front is met on the left of the tool or behind it: none is engaged then.
    """

    found: BoolArray
    engagement: FloatArray
    point: FloatArray
    bearing: FloatArray
    passed: IntArray
    beside: BoolArray


def _until(way: Pursuit, room: FloatArray, stop: int, at_wall: bool) -> Piece:
    """The part of a way before a sample, and to where it meets the wall before that one."""
    centre, heading, rest = way.centre[:stop], way.heading[:stop], room[:stop]
    if at_wall:
        before, after = max(float(room[stop - 1]), 0.0), min(float(room[stop]), 0.0)
        share = before / max(before - after, 1e-12)
        place = centre[-1] + share * (way.centre[stop] - centre[-1])
        turn = float(wrapped(way.heading[stop] - heading[-1]))
        # a sample next to it would tell nothing of the direction in which the way ends
        kept = stop - 1 if stop > 1 and share < NEXT else stop
        centre = np.concatenate([centre[:kept], place[None]])
        heading = np.append(heading[:kept], heading[-1] + share * turn)
        rest = np.append(rest[:kept], 0.0)
    return Piece(centre, heading, rest)


def _eased(front: FloatArray, limit: float, ease: tuple[float, float] | None) -> FloatArray:
    """(n - 1,) engagement along a front: the limit, reached smoothly where a cut begins."""
    if ease is None:
        return np.full(len(front) - 1, limit)
    gone = np.zeros(len(front) - 1)
    _gaps(front[1:-1], front[:-2]).cumsum(out=gone[1:])
    share = np.minimum(gone / ease[1], 1.0)
    return np.asarray(np.maximum(limit * share**2 * (3 - 2 * share), min(ease[0], limit)))


def _first(flags: BoolArray) -> int:
    """Where the first flag is set; how many there are where none is."""
    place = int(flags.argmax())
    return place if flags[place] else len(flags)


def _gaps(one: FloatArray, two: FloatArray) -> FloatArray:
    """(n,) distances of points (n, 2) from others."""
    offset = one - two
    return np.asarray(np.hypot(offset[:, 0], offset[:, 1]))


def _gap(one: FloatArray, two: FloatArray) -> float:
    return float(np.hypot(one[0] - two[0], one[1] - two[1]))


def _first_long_run(flags: BoolArray, longest: int, stop: int) -> int:
    """Where the first run of set flags begins that is longer than `longest` or reaches the end.

    Only flags before `stop` count; `stop` where there is none.
    """
    padded = np.zeros(stop + 2, dtype=bool)
    padded[1:-1] = flags[:stop]
    edges = (padded[1:] != padded[:-1]).nonzero()[0].tolist()
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        if end - begin > longest or end == len(flags):
            return int(begin)
    return stop
