"""Ways through cleared area from the end of one cut to the start of the next."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from grassfire.medial import MedialAxis
from grassfire.plan.arcs import Curve, fewest_arcs
from grassfire.plan.fronts import Front, Fronts, touched, touching
from grassfire.plan.link import straight
from grassfire.plan.path import Path, join, turned
from grassfire.plan.places import BoolArray, IntArray, box
from grassfire.plan.pursuit import wrapped
from grassfire.plan.roadmap import RoadMap, tightened
from grassfire.plan.smooth import rounded, tangent_link, two_arcs
from grassfire.plan.stock import Stock
from grassfire.plan.tracing import Start
from grassfire.plan.walls import Walls
from grassfire.toolpath import FloatArray

RADII = 0.6, 0.3, 0.12
"""Radii of the arcs at both ends of a way that are tried, as parts of the tool radius."""

LONGER = 1.1
"""How much longer a way of two arcs may be than one of three pieces."""

ROOM = 0.01
"""How much nearer to stock than the tool radius ways may pass, as a part of it."""

SLIVER = 0.03
"""The same to slivers that are left along the walls."""

AROUND, WALL_GAP = 1.5, 0.1
"""How much longer than straight a way along the wall may be; how near to it its ends are, in R."""

PLAIN, OFF = 3, 0.02
"""Pieces of ways along walls that are not made fewer; how far off the wall these are, in R."""

CORNER = 0.5
"""Turn from one place on a wall to the next from which on there is a corner, radians."""

PROBE, ARC_PROBE = 0.1, 0.015
"""Distance of the places that are looked at on straight ways and on the tightest arcs, in tool
radii. Wider arcs dip as little into a wall between places that are further apart."""

FEW = 8
"""Every so many of the places on ways is looked at first."""

SLACK = 1e-3
"""How much nearer to the wall than the walls of the pocket places may be, mm."""

MAP_STEP = 2.0
"""Distance of the places of the road map, as a part of the tool radius."""


class Returns:
    """Ways at the floor that keep the tool off stock and walls.

    Parameters
    ----------
    axis : MedialAxis
    walls : Walls
    stock : Stock
        Looked at whenever a way is asked for.
    radius, least : float
        Of the tool; of arcs by which ways bend, mm. Ways along the wall bend as that does.
    """

    def __init__(
        self, axis: MedialAxis, walls: Walls, stock: Stock, radius: float, least: float
    ) -> None:
        self._axis = axis
        self._walls = walls
        self._radius = radius
        self._least = least
        self._radii = sorted({max(part * radius, least) for part in RADII}, reverse=True)
        self._stock = stock
        self._near_map: dict[tuple[Front, float], IntArray] = {}

    def way(self, place: FloatArray, heading: float, start: Start) -> Path | None:
        """From a place and heading to the start of a cut, in the frame of the walls; or None."""
        found = self.direct(place, heading, start)
        if found is not None or straight(place, start.point) is None:
            return found
        return self.over_map(place, start)

    def direct(
        self, place: FloatArray, heading: float, start: Start, smooth: bool = True
    ) -> Path | None:
        """As `way`: straight or along the wall, with arcs tangent to both cuts if `smooth`."""
        ways = self._tangent(place, heading, start) if smooth else []
        line = straight(place, start.point)
        found = ways if line is None else [*ways, line]
        chosen = self._first_clear(found) if found else None
        if chosen is not None or line is None:
            return chosen
        return self._beside(place, start.point)

    def _tangent(self, place: FloatArray, heading: float, start: Start) -> list[Path]:
        """Ways with arcs tangent to both cuts, the one with fewest pieces first if it is short."""
        ways = [
            tangent_link(place, heading, start.point, start.heading, radius)
            for radius in self._radii
        ]
        found = [way for way in ways if way is not None]
        arcs = two_arcs(place, heading, start.point, start.heading) if found else None
        short = arcs is not None and arcs.length <= LONGER * found[0].length
        if arcs is not None and short and arcs.radius.min() >= self._least:
            found.insert(0, arcs)
        return found

    def _first_clear(self, ways: Sequence[Path]) -> Path | None:
        """The first way of the frame that touches neither wall nor stock."""
        places, first = self._probes(ways)
        stops = [*first[1:].tolist(), len(places)]
        # all of the first way, of the others a few places: these tell nearly always if they touch
        chosen = np.zeros(len(places), dtype=bool)
        chosen[: stops[0]] = chosen[::FEW] = chosen[first] = True
        rows = chosen.nonzero()[0]
        stopped = rows[~self._clear(places[rows])]
        owner = first.searchsorted(stopped, side="right") - 1
        for number, stop in enumerate(stops):
            if number in owner:
                continue
            if number == 0 or self._clear(places[first[number] : stop]).all():
                return ways[number]
        return None

    def over_map(self, place: FloatArray, start: Start) -> Path | None:
        """As `way`: over the road map."""
        ends = self._walls.frame(np.stack([place, start.point]))
        found = self.across(ends[0], ends[1])
        return None if found is None else self._walls.path(found)

    def _beside(self, place: FloatArray, end: FloatArray) -> Path | None:
        """Along the wall between two places at it, if clear; None where it is a long way round."""
        walls = self._walls
        low, high = walls.nearest(place), walls.nearest(end)
        if walls.first[low] != walls.first[high]:
            return None
        gaps = [np.hypot(*(walls.points[low] - place)), np.hypot(*(walls.points[high] - end))]
        size, back = min((walls.size(low, high), False), (walls.size(high, low), True))
        far = size > AROUND * float(np.hypot(*(end - place)))
        if max(gaps) > WALL_GAP * self._radius or far:
            return None
        ring = walls.slice(high, low) if back else walls.slice(low, high)
        if ring is None:
            return None
        exact = self._first_clear([_between(place, ring, back, end)])
        few = None if exact is None else self._eased(ring)
        eased = None if few is None else self._first_clear([_between(place, few, back, end)])
        return eased or exact

    def _eased(self, ring: Path) -> Path | None:
        """Part of a smooth ring in fewer arcs, if there are, a little off the wall on its right."""
        if len(ring) <= PLAIN:
            return None
        parts = max(FEW, int(np.ceil(ring.length / (PROBE * self._radius))))
        points = ring.at(np.linspace(0.0, ring.length, parts + 1))
        chord = points[1:] - points[:-1]
        bearing = np.arctan2(chord[:, 1], chord[:, 0])
        if np.abs(wrapped(bearing[1:] - bearing[:-1])).max() > CORNER:
            return None
        near, off = np.full(len(points), SLACK / 2), np.full(len(points), OFF * self._radius)
        way = fewest_arcs([Curve(points, near, off)])[0]
        return way if len(way) < len(ring) else None

    def across(self, start: FloatArray, end: FloatArray) -> Path | None:
        """A way over the road map between two places, all in the drawing, its corners rounded."""
        found = self.map.way(start, end, self, self._open_map())
        if found is None:
            return None
        found = tightened(found, self)
        ways = [rounded(found, radius) for radius in self._radii]
        chosen = self._first_clear([self._walls.path(way) for way in ways])
        return found if chosen is None else self._walls.path(chosen)

    def free(self, places: FloatArray) -> BoolArray:
        """Where in the frame the tool touches neither wall nor stock; places need be on no way."""
        inside = self._walls.clearance(places, self._walls.wall) - self._walls.wall >= -SLACK
        return self._unstocked(places, np.asarray(inside), ROOM)

    def open(self, place: FloatArray) -> bool:
        """Whether ways in the frame may end at a place that is none of a wall's, or on its ring."""
        return bool(self._unstocked(place[None], np.ones(1, dtype=bool), ROOM)[0])

    def holds(
        self,
        starts: FloatArray,
        ends: FloatArray,
        certain: BoolArray | None = None,
        bite: float = ROOM,
    ) -> BoolArray:
        """Whether each straight way (drawing) lies in cleared area.

        `bite` is how much nearer to stock than its radius the tool may come, as a part of it;
        `certain` is not needed.
        """
        gap = np.hypot(*(ends - starts).T)
        count = np.maximum(2, np.ceil(gap / (PROBE * self._radius)).astype(np.int64) + 1)
        owner = np.repeat(np.arange(len(gap)), count)
        first = np.repeat(np.cumsum(count) - count, count)
        share = (np.arange(len(owner)) - first) / (count[owner] - 1)
        places = starts[owner] + (ends - starts)[owner] * share[:, None]
        held = np.ones(len(gap), dtype=bool)
        held[owner[~self._clear(self._walls.frame(places), bite)]] = False
        return held

    @cached_property
    def map(self) -> RoadMap:
        """The medial axis of all places of the tool."""
        return RoadMap(self._axis, self._walls.wall, MAP_STEP * self._radius)

    @cached_property
    def _places(self) -> tuple[FloatArray, BoolArray]:
        """Places of the map in the frame, and if the walls leave room to the tool there."""
        places = self._walls.frame(self.map.points)
        return places, self._roomy(places)

    def _open_map(self) -> BoolArray:
        """(n,) where on the map the tool touches neither wall nor stock."""
        places, roomy = self._places
        known, self._near_map = self._near_map, {}
        result = roomy.copy()
        for edges, least in self._edges():
            for front in edges:
                rows = known.get((front, least))
                if rows is None:
                    rows = touched(places, front, self._radius * (1 - least))
                self._near_map[front, least] = rows
                result[rows] = False
        return result

    def _edges(self) -> tuple[tuple[Fronts, float], ...]:
        """Edges of the stock, and how much nearer to them than its radius the tool may come."""
        return (self._stock.fronts, ROOM), (self._stock.left, SLIVER)

    def _probes(self, ways: Sequence[Path]) -> tuple[FloatArray, IntArray]:
        """Places on ways, both ends among them, and the first one of each way.

        They are closer together on arcs: one that turns at a wall may dip into it.
        """
        begin = np.concatenate([way.points[:-1] for way in ways])
        chord = np.concatenate([way.points[1:] for way in ways]) - begin
        centre = np.concatenate([way.centre for way in ways])
        sweep = np.concatenate([way.sweep for way in ways])
        size = np.hypot(chord[:, 0], chord[:, 1])
        step = np.full(len(size), PROBE * self._radius)
        arcs = sweep.nonzero()[0]
        spoke = begin[arcs] - centre[arcs]
        radius = np.hypot(spoke[:, 0], spoke[:, 1])
        size[arcs] = radius * np.abs(sweep[arcs])
        wide = np.sqrt(np.maximum(radius / self._radii[-1], 1.0))
        step[arcs] = np.minimum(ARC_PROBE * wide, PROBE) * self._radius
        parts = np.maximum(1, np.ceil(size / step)).astype(np.int64)
        count = parts.copy()
        last = np.array([len(way) for way in ways]).cumsum() - 1
        count[last] += 1
        stop = count.cumsum()
        owner = np.arange(len(count)).repeat(count)
        share = (np.arange(stop[-1]) - (stop - count).take(owner)) / parts.take(owner)
        places = begin.take(owner, axis=0)
        places += chord.take(owner, axis=0) * share[:, None]
        rows = (sweep != 0.0).take(owner).nonzero()[0]
        if len(rows):
            arc = owner.take(rows)
            angle = sweep.take(arc) * share.take(rows)
            places[rows] = turned(begin.take(arc, axis=0), centre.take(arc, axis=0), angle)
        first = np.zeros(len(ways), dtype=np.int64)
        first[1:] = stop[last[:-1]]
        return places, first

    def _clear(self, places: FloatArray, bite: float = ROOM) -> BoolArray:
        """Where on ways in the frame the tool touches neither wall nor stock."""
        return self._unstocked(places, self._roomy(places), bite)

    def _unstocked(self, places: FloatArray, good: BoolArray, bite: float) -> BoolArray:
        """Good places where the tool does not touch stock either."""
        rows = good.nonzero()[0]
        if not len(rows):
            return good
        places = places.take(rows, axis=0)
        around = box(places)
        near = []
        for edges, least in self._edges():
            reach = self._radius * (1 - max(bite, least))
            near += [(front, reach) for front in edges.near(around, reach)]
        good[rows[touching(places, around, near)]] = False
        return good

    def _roomy(self, places: FloatArray) -> BoolArray:
        """Where on ways in the frame the walls leave room to the tool."""
        return np.asarray(self._walls.room(places) >= -SLACK)


def _between(place: FloatArray, ring: Path, back: bool, end: FloatArray) -> Path:
    """From a place along part of a ring, `back` or forth, to another place."""
    way = ring.reversed() if back else ring
    ends = (straight(place, way.start), way, straight(way.end, end))
    return join(*(part for part in ends if part is not None))
