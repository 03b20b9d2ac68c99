"""Ways through cleared area from the end of one cut to the start of the next."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from grassfire.medial import MedialAxis
from grassfire.plan.link import straight
from grassfire.plan.path import BoolArray, Path, join
from grassfire.plan.roadmap import RoadMap
from grassfire.plan.smooth import rounded, tangent_link
from grassfire.plan.tracing import Start
from grassfire.plan.walls import Walls
from grassfire.toolpath import FloatArray

RADII = 0.6, 0.3, 0.12
"""Radii of the arcs at both ends of a way that are tried, as parts of the tool radius."""

ROOM = 0.01
"""How much nearer to stock than the tool radius ways may pass, as a part of it."""

SLIVER = 0.03
"""The same to slivers that are left along the walls."""

AROUND, WALL_GAP = 1.5, 0.1
"""How much longer than straight a way along the wall may be; how near to it its ends are, in R."""

PROBE, ARC_PROBE = 0.1, 0.015
"""Distance of the places that are looked at on straight ways and arcs, in tool radii."""

MAP_STEP = 2.0
"""Distance of the places of the road map, as a part of the tool radius."""


class Returns:
    """Ways at the floor that keep the tool off stock and walls.

    Parameters
    ----------
    axis : MedialAxis
    walls : Walls
    wall, radius : float
        Least distance of the centre from the boundary, tool radius, mm.
    """

    def __init__(self, axis: MedialAxis, walls: Walls, wall: float, radius: float) -> None:
        self._axis = axis
        self._walls = walls
        self._wall = wall
        self._radius = radius
        self._stock: list[tuple[cKDTree, float]] = []

    def update(self, fronts: Sequence[FloatArray], left: Sequence[FloatArray] = ()) -> None:
        """Take note of the edges of the stock and of slivers that are left, in the frame."""
        self._stock = [
            (cKDTree(self._walls.frame(np.concatenate(edges)), balanced_tree=False), room)
            for edges, room in ((fronts, ROOM), (left, SLIVER))
            if edges
        ]

    def way(
        self, place: FloatArray, heading: float, start: Start, far: bool, smooth: bool = True
    ) -> Path | None:
        """From a place and heading to the start of a cut, all in the frame of the walls.

        Smooth at both ends where there is room, if `smooth`; `far` says whether ways over the road
        map are looked for as well. None where there is none.
        """
        for part in RADII if smooth else ():
            way = tangent_link(place, heading, start.point, start.heading, part * self._radius)
            if way is not None and self._clear_path(way):
                return way
        way = straight(place, start.point)
        if way is None or self._clear_path(way):
            return way
        beside = self._beside(place, start.point)
        if beside is not None and self._clear_path(beside):
            return beside
        if not far:
            return None
        ends = self._walls.frame(np.stack([place, start.point]))
        found = self.across(ends[0], ends[1])
        return None if found is None else self._walls.path(found)

    def _beside(self, place: FloatArray, end: FloatArray) -> Path | None:
        """Along the wall between two places at it; None where that is a long way round."""
        walls = self._walls
        low, high = walls.nearest(place), walls.nearest(end)
        if walls.first[low] != walls.first[high]:
            return None
        back = walls.size(high, low) < walls.size(low, high)
        ring = walls.slice(high, low) if back else walls.slice(low, high)
        if ring is None or ring.length > AROUND * float(np.hypot(*(end - place))):
            return None
        way = ring.reversed() if back else ring
        gaps = [np.hypot(*(way.start - place)), np.hypot(*(way.end - end))]
        if max(gaps) > WALL_GAP * self._radius:
            return None
        ends = (straight(place, way.start), way, straight(way.end, end))
        return join(*(part for part in ends if part is not None))

    def across(self, start: FloatArray, end: FloatArray) -> Path | None:
        """A way over the road map between two places, all in the drawing, its corners rounded."""
        found = self.map.way(start, end, self, self._clear(self.map.points))
        if found is None:
            return None
        for part in RADII:
            smooth = rounded(found, part * self._radius)
            if self._clear(self._probes(smooth)).all():
                return smooth
        return found

    def free(self, places: FloatArray) -> BoolArray:
        """Where on a way (in the frame) the tool touches neither wall nor stock."""
        return self._clear(self._walls.frame(places))

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
        held[owner[~self._clear(places, bite)]] = False
        return held

    @cached_property
    def map(self) -> RoadMap:
        """The medial axis of all places of the tool."""
        return RoadMap(self._axis, self._wall, MAP_STEP * self._radius)

    def _clear_path(self, way: Path) -> bool:
        places = self._walls.frame(self._probes(way))
        return bool(self._clear(places).all())

    def _probes(self, way: Path) -> FloatArray:
        """Places on a way, closer together on arcs: one that turns at a wall may dip into it."""
        step = np.where(way.is_arc, ARC_PROBE, PROBE) * self._radius
        count = np.maximum(1, np.ceil(way.lengths / step)).astype(np.int64)
        piece = np.repeat(np.arange(len(way)), count)
        first = np.repeat(np.cumsum(count) - count, count)
        share = (np.arange(len(piece)) - first) / count[piece]
        along = way.cumulative[piece] + share * way.lengths[piece]
        return way.at(np.append(along, way.length))

    def _clear(self, places: FloatArray, bite: float = ROOM) -> BoolArray:
        """Where on ways in the drawing the tool touches neither wall nor stock."""
        good = np.asarray(self._walls.room(self._walls.frame(places)) >= -1e-3)
        for tree, least in self._stock:
            rows = np.flatnonzero(good)
            if len(rows):
                near = self._radius * (1 - max(bite, least))
                gap = tree.query(places[rows], distance_upper_bound=near)[0]
                good[rows[np.isfinite(gap)]] = False
        return good
