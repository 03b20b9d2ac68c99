"""Trimmed offsets without clipping: { u : r(u) >= d }, carried over to the partner where r falls.

The boundary is a cyclic list of intervals, two for each polynomial piece of the axis (its two
sides) and one for each contact arc. At distance d every piece keeps the stretches with r >= d.
Walking the kept stretches along the boundary, and over the axis to the other side where a stretch
ends in r = d, closes the offset loops; lines stay lines and arcs stay arcs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry import Arc, Curve, Line, Loop, ParallelCurve
from grassfire.geometry.neighbours import connected
from grassfire.medial import recover
from grassfire.medial.edges import evaluate_span
from grassfire.medial.nodes import WHOLE
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, SiteKind

if TYPE_CHECKING:
    from grassfire.medial.axis import MedialAxis

_MOST_HALVINGS = 60
_STILL = 1e-14
"""Change of a fraction that ends the search for a crossing."""


@dataclass(frozen=True)
class OffsetNode:
    """A connected component of the points with clearance >= `distance`.

    Attributes
    ----------
    level : int
        Index of the distance.
    distance : float
        mm.
    loops : tuple of Loop
        Its boundary, region on the left: the outer loop first, then those around islands.
    parent : int
        Index of the component one level down that holds it; -1 at level 0.
    peak : (2,) float array
        Centre of its largest disk.
    peak_radius : float
        Clearance there, mm.
    area : float
        mm^2.
    """

    level: int
    distance: float
    loops: tuple[Loop, ...]
    parent: int
    peak: FloatArray
    peak_radius: float
    area: float


@dataclass(frozen=True)
class Stretches:
    """Kept stretches of pieces at one distance: rows of pieces, fractions, open ends."""

    row: IntArray
    start: FloatArray
    end: FloatArray
    cut_start: BoolArray
    cut_end: BoolArray


def offset_tree(axis: MedialAxis, distances: FloatArray) -> tuple[OffsetNode, ...]:
    """Trimmed offsets at ascending distances, linked by containment.

    Parameters
    ----------
    axis : MedialAxis
    distances : (k,) float array
        Ascending, above 0, mm.

    Returns
    -------
    tuple of OffsetNode
        By level, and within a level by the place of the first loop on the boundary.

    Raises
    ------
    GeometryError
        Distances that are not ascending or not above 0.
    """
    if len(distances) and (distances[0] <= 0 or np.any(np.diff(distances) <= 0)):
        raise GeometryError("offset distances must be above 0 and ascending")
    walker = axis.walker
    nodes: list[OffsetNode] = []
    previous: tuple[Stretches, IntArray, IntArray] | None = None
    offset = 0
    settled_distances = [settled(axis, float(distance)) for distance in distances]
    kept = walker.stretches_at(settled_distances)
    feet = walker.feet(kept)
    for level, distance in enumerate(distances):
        effective, stretches = settled_distances[level], kept[level]
        component, vertex_component = walker.components(stretches, effective)
        items = _BoundaryItems(walker, stretches, vertex_component, feet[level])
        found = walker.loops(items, component, vertex_component, effective)
        base = len(nodes)
        order: dict[int, int] = {}
        for label, loops in found:
            peak, radius, parent_of = walker.peak(
                stretches, component, vertex_component, label, effective
            )
            parent = -1
            if previous is not None:
                parent = offset + _parent(parent_of, previous)
            order[label] = len(nodes) - base
            nodes.append(
                OffsetNode(
                    level=level,
                    distance=float(distance),
                    loops=loops,
                    parent=parent,
                    peak=peak + axis.sites.origin,
                    peak_radius=radius,
                    area=float(sum(loop.area for loop in loops)),
                )
            )
        if not found:
            break
        renumber = np.array(
            [order.get(label, -1) for label in range(_label_count(component, vertex_component))],
            dtype=np.int64,
        )
        previous = (stretches, _relabel(component, renumber), _relabel(vertex_component, renumber))
        offset = base
    return tuple(nodes)


def settled(axis: MedialAxis, distance: float, ties: int = 1) -> float:
    """The distance, moved by 1e-10 of the region's size where r has a stationary value there.

    Ties with r (parallel walls, necks and disks of exactly this radius) are resolved one way
    throughout: left out for `ties` = 1, taken in for `ties` = -1.
    """
    slack = 1e-10 * axis.sites.size
    near = np.abs(axis.walker.levels - distance)
    return distance + ties * slack if np.any(near < slack) else distance


def _label_count(component: IntArray, vertex_component: IntArray) -> int:
    return int(max(component.max(initial=-1), vertex_component.max(initial=-1))) + 1


def _relabel(component: IntArray, renumber: IntArray) -> IntArray:
    return np.where(component >= 0, renumber[np.maximum(component, 0)], -1)


def _parent(place: tuple[str, int, float], previous: tuple[Stretches, IntArray, IntArray]) -> int:
    stretches, component, vertex_component = previous
    kind, index, fraction = place
    if kind == "vertex":
        return int(vertex_component[index])
    inside = (stretches.row == index) & (stretches.start <= fraction) & (fraction <= stretches.end)
    return int(component[np.flatnonzero(inside)[0]])


class Walker:
    """What all distances share: the boundary's intervals and the monotone parts of the pieces."""

    def __init__(self, axis: MedialAxis) -> None:
        self.axis = axis
        self.sites = axis.sites
        span, graph = axis.span, axis.graph
        count = len(span.site)
        whole = np.flatnonzero(graph.partner == WHOLE)
        site = np.concatenate([span.site, span.partner, graph.site[whole]])
        start = np.concatenate([span.start, span.facing_end, graph.start[whole]])
        order = np.lexsort((start, site))
        self.interval_site = site[order]
        self.interval_piece = np.concatenate(
            [np.arange(count), np.arange(count), np.full(len(whole), -1)]
        )[order]
        self.interval_side = np.concatenate(
            [np.zeros(count, int), np.ones(count, int), np.zeros(len(whole), int)]
        )[order]
        self.interval_vertex = np.concatenate([np.full(2 * count, -1), graph.first[whole]])[order]
        self.interval_start = start[order]
        end = np.concatenate([span.end, span.facing_start, graph.end[whole]])
        self.interval_end = end[order]
        self.following = self._following()
        self.position = np.zeros((2, count), dtype=np.int64)
        real = self.interval_piece >= 0
        rows = np.flatnonzero(real)
        self.position[self.interval_side[rows], self.interval_piece[rows]] = rows
        self._monotone_parts()

    def _following(self) -> IntArray:
        """Next interval along each loop."""
        loop = self.sites.loop[self.interval_site]
        following = np.arange(1, len(loop) + 1)
        for value in np.unique(loop):
            rows = np.flatnonzero(loop == value)
            following[rows[-1]] = rows[0]
        return following

    def _monotone_parts(self) -> None:
        """Cut every piece at the extrema of r; keep fraction and radius at both ends."""
        axis, span = self.axis, self.axis.span
        row, fraction, disks, _ = axis.critical
        count = len(span.site)
        vertex_radius = axis.fit.vertex_radius
        rows = np.concatenate([np.arange(count), np.arange(count), row])
        place = np.concatenate([np.zeros(count), np.ones(count), fraction])
        radius = np.concatenate([vertex_radius[span.first], vertex_radius[span.last], disks[:, 2]])
        self.levels = np.concatenate([vertex_radius, disks[:, 2]])
        order = np.lexsort((place, rows))
        rows, place, radius = rows[order], place[order], radius[order]
        same = np.flatnonzero(rows[1:] == rows[:-1])
        self.part_row = rows[same]
        self.part_start, self.part_end = place[same], place[same + 1]
        self.part_low, self.part_high = radius[same], radius[same + 1]

    # -- one distance -----------------------------------------------------------------------------

    def stretches(self, distance: float) -> Stretches:
        """Where r >= distance on every piece."""
        return self.stretches_at([distance])[0]

    def stretches_at(self, distances: Sequence[float]) -> list[Stretches]:
        """Where r >= distance on every piece, for each of some distances."""
        kept = [(self.part_low >= least, self.part_high >= least) for least in distances]
        crossing = [np.flatnonzero(from_in != to_in) for from_in, to_in in kept]
        count = [len(part) for part in crossing]
        place = self._cross(
            np.concatenate([np.zeros(0, dtype=np.int64), *crossing]),
            np.repeat(np.asarray(distances, dtype=np.float64), count),
        )
        places = np.split(place, np.cumsum(count))[:-1]
        return [
            self._stretches(from_in, to_in, part, where)
            for (from_in, to_in), part, where in zip(kept, crossing, places, strict=True)
        ]

    def _stretches(
        self, from_in: BoolArray, to_in: BoolArray, crossing: IntArray, place: FloatArray
    ) -> Stretches:
        """The parts that are wide enough at either end, cut at `place` where they cross."""
        start, end = self.part_start.copy(), self.part_end.copy()
        cut_start = np.zeros(len(start), dtype=bool)
        cut_end = np.zeros(len(start), dtype=bool)
        rising = to_in[crossing]
        start[crossing[rising]], cut_start[crossing[rising]] = place[rising], True
        end[crossing[~rising]], cut_end[crossing[~rising]] = place[~rising], True
        keep = np.flatnonzero(from_in | to_in)
        row, start, end = self.part_row[keep], start[keep], end[keep]
        cut_start, cut_end = cut_start[keep], cut_end[keep]
        # Parts that meet inside a piece are one stretch.
        if len(row):
            joined = (row[1:] == row[:-1]) & ~cut_end[:-1] & ~cut_start[1:]
            joined &= end[:-1] == start[1:]
            head = np.flatnonzero(np.concatenate([[True], ~joined]))
            tail = np.flatnonzero(np.concatenate([~joined, [True]]))
            row, start, cut_start = row[head], start[head], cut_start[head]
            end, cut_end = end[tail], cut_end[tail]
        return Stretches(row, start, end, cut_start, cut_end)

    def _cross(self, part: IntArray, distance: FloatArray) -> FloatArray:
        """Fractions where r = distance on monotone parts: on their polynomials, then exactly.

        Newton's method within brackets, which are halved where it would leave them or where it
        gains less than that.
        """
        row, rising = self.part_row[part], self.part_high[part] > self.part_low[part]
        left, right = self.part_start[part].copy(), self.part_end[part].copy()
        place, slope = 0.5 * (left + right), np.zeros(len(part))
        moved = right - left
        active = np.arange(len(part))
        for _ in range(_MOST_HALVINGS):
            if not len(active):
                break
            here = place[active]
            disks, growth = recover.jets(self.axis.fit, row[active], here, orders=1)
            excess, slope[active] = disks[:, 2] - distance[active], growth[:, 2]
            beyond = (excess >= 0) == rising[active]
            low = np.where(beyond, left[active], here)
            high = np.where(beyond, here, right[active])
            with np.errstate(divide="ignore", invalid="ignore"):
                new = here - excess / growth[:, 2]
            halved = 0.5 * (low + high)
            slow = np.abs(new - here) > 0.5 * moved[active]
            new = np.where((new >= low) & (new <= high) & ~slow, new, halved)
            left[active], right[active], place[active] = low, high, new
            moved[active] = np.abs(new - here)
            active = active[moved[active] > _STILL]
        return self._polish(part, place, slope, distance)

    def _polish(
        self, part: IntArray, place: FloatArray, slope: FloatArray, distance: FloatArray
    ) -> FloatArray:
        """Places on the polynomials moved to where the exact disks have the radius."""
        row, low, high = self.part_row[part], self.part_start[part], self.part_end[part]
        for _ in range(3):
            radius = self.exact(row, place)[0][:, 2]
            with np.errstate(divide="ignore", invalid="ignore"):
                delta = (distance - radius) / slope
            # A polynomial within tolerance is only moved a little; flat crossings stay.
            usable = np.isfinite(delta) & (np.abs(delta) < 1e-3)
            place = np.clip(place + np.where(usable, delta, 0.0), low, high)
        return place

    def exact(self, row: IntArray, fraction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Exact disks (k, 3) and contacts on the far side (k,) at fractions of pieces."""
        span = self.axis.span.take(row)
        disks, facing = evaluate_span(self.sites, span, fraction[:, None])
        return disks[:, 0], facing[:, 0]

    def components(self, stretches: Stretches, distance: float) -> tuple[IntArray, IntArray]:
        """Component of each stretch and of each vertex (-1 below the distance)."""
        span = self.axis.span
        radius = self.axis.fit.vertex_radius
        vertices, count = len(radius), len(stretches.row)
        index = np.arange(count) + vertices
        first, last = span.first[stretches.row], span.last[stretches.row]
        open_start, open_end = ~stretches.cut_start, ~stretches.cut_end
        rows = np.concatenate([index[open_start], index[open_end]])
        columns = np.concatenate([first[open_start], last[open_end]])
        total = vertices + count
        label = connected(rows, columns, total)
        return label[vertices:], np.where(radius >= distance, label[:vertices], -1)

    def peak(
        self,
        stretches: Stretches,
        component: IntArray,
        vertex_component: IntArray,
        label: int,
        distance: float,
    ) -> tuple[FloatArray, float, tuple[str, int, float]]:
        """Largest disk of a component and where on the axis it is."""
        axis = self.axis
        best = (-np.inf, ("vertex", -1, 0.0), np.zeros(2))
        members = np.flatnonzero(vertex_component == label)
        if len(members):
            vertex = int(members[np.argmax(axis.fit.vertex_radius[members])])
            radius = float(axis.fit.vertex_radius[vertex])
            best = (radius, ("vertex", vertex, 0.0), axis.fit.vertex_centre[vertex])
        mine = component == label
        row, fraction, disks, sign = axis.critical
        maxima = np.flatnonzero((sign < 0) & (disks[:, 2] >= distance))
        if len(maxima) and mine.any():
            index = np.searchsorted(stretches.row, row[maxima])
            for extremum, hint in zip(maxima, index, strict=True):
                if disks[extremum, 2] <= best[0]:
                    continue
                while hint < len(stretches.row) and stretches.row[hint] == row[extremum]:
                    inside = stretches.start[hint] <= fraction[extremum] <= stretches.end[hint]
                    if inside and mine[hint]:
                        place = ("piece", int(row[extremum]), float(fraction[extremum]))
                        best = (float(disks[extremum, 2]), place, disks[extremum, :2])
                    hint += 1
        return np.asarray(best[2]), best[0], best[1]

    # -- loops ------------------------------------------------------------------------------------

    def feet(self, kept: Sequence[Stretches]) -> list[FloatArray]:
        """(k, 2) contacts on the far side at both ends of stretches, for each distance."""
        row = np.concatenate([np.zeros(0, dtype=np.int64), *(item.row for item in kept)])
        ends = [np.stack([item.start, item.end], axis=1) for item in kept]
        span = self.axis.span.take(row)
        facing = evaluate_span(self.sites, span, np.concatenate([np.zeros((0, 2)), *ends]))[1]
        return np.split(facing, np.cumsum([len(item.row) for item in kept]))[:-1]

    def loops(
        self,
        items: _BoundaryItems,
        component: IntArray,
        vertex_component: IntArray,
        distance: float,
    ) -> list[tuple[int, tuple[Loop, ...]]]:
        """Closed offset loops by component, the outer loop first."""
        walks = items.walks()
        if not walks:
            return []
        order = np.concatenate([np.array(walk) for walk in walks])
        number = np.repeat(np.arange(len(walks)), [len(walk) for walk in walks])
        site, start, end, number = joined_runs(
            items.site[order], items.start[order], items.end[order], number
        )
        curves: list[list[Curve]] = [[] for _ in walks]
        made = self.curves(site, start, end, distance)
        for index, curve in zip(number.tolist(), made, strict=True):
            if curve is not None:
                curves[index].append(curve)
        found: dict[int, list[Loop]] = {}
        for walk, own in zip(walks, curves, strict=True):
            if own:
                label = items.component(walk[0], component, vertex_component)
                found.setdefault(label, []).append(closed_loop(own, self.sites.size))
        return [
            (label, tuple(sorted(loops, key=lambda loop: -loop.area)))
            for label, loops in found.items()
        ]

    def curves(
        self, site: IntArray, start: FloatArray, end: FloatArray, distance: float
    ) -> list[Curve | None]:
        """Offsets of parts of sites, None where they have no length to speak of."""
        kind = self.sites.kind[site]
        result: list[Curve | None] = [None] * len(site)
        rows = np.flatnonzero(kind == SiteKind.LINE)
        if len(rows):
            head, tail = self._lines(site[rows], start[rows], end[rows], distance)
            gap = tail - head
            long = np.flatnonzero(np.hypot(gap[:, 0], gap[:, 1]) > 1e-9 * self.sites.size)
            for index in long.tolist():
                result[rows[index]] = Line(head[index], tail[index])
        rows = np.flatnonzero((kind == SiteKind.ARC) | (kind == SiteKind.POINT))
        if len(rows):
            centre, radius, angle, sweep = self._arcs(site[rows], start[rows], end[rows], distance)
            long = np.flatnonzero(radius * np.abs(sweep) > 1e-9 * self.sites.size)
            table = zip(rows[long].tolist(), centre[long], radius[long].tolist(),
                        angle[long].tolist(), sweep[long].tolist(), strict=True)  # fmt: skip
            for index, *values in table:
                result[index] = Arc(*values)
        rows = np.flatnonzero((kind == SiteKind.SPIRAL) & (end - start > 1e-12))
        for index in rows.tolist():
            base = self.axis.beziers[int(self.sites.bezier[site[index]])]
            part = float(start[index]), float(end[index])
            if distance == 0:
                result[index] = base.subcurve(*part)
            else:
                result[index] = ParallelCurve(base, distance, *part)
        return result

    def _lines(
        self, site: IntArray, start: FloatArray, end: FloatArray, distance: float
    ) -> tuple[FloatArray, FloatArray]:
        """Ends (n, 2) of offsets of lines."""
        direction = self.sites.extent[site]
        across = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
        across *= (distance / np.hypot(direction[:, 0], direction[:, 1]))[:, None]
        anchor = self.sites.anchor[site] + self.sites.origin
        return (
            anchor + start[:, None] * direction + across,
            anchor + end[:, None] * direction + across,
        )

    def _arcs(
        self, site: IntArray, start: FloatArray, end: FloatArray, distance: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Centres (n, 2), radii, first angles and sweeps (n,) of offsets of arcs and points."""
        sites = self.sites
        first, turn = sites.extent[site].T
        point = sites.kind[site] == SiteKind.POINT
        radius = np.where(point, distance, sites.radius[site] - np.sign(turn) * distance)
        centre = sites.anchor[site] + sites.origin
        return centre, radius, first + start * turn, (end - start) * turn


class _BoundaryItems:
    """Kept stretches as seen from the boundary, in boundary order, and their successors."""

    def __init__(
        self,
        walker: Walker,
        stretches: Stretches,
        vertex_component: IntArray,
        feet: FloatArray,
    ) -> None:
        span = walker.axis.span
        row = stretches.row
        count = len(row)
        facing_start, facing_end = feet.T
        own_start = span.at(row, stretches.start)
        own_end = np.where(stretches.cut_end, span.at(row, stretches.end), span.end[row])
        whole = np.flatnonzero(
            (walker.interval_piece < 0)
            & (vertex_component[np.maximum(walker.interval_vertex, 0)] >= 0)
        )
        interval = np.concatenate([walker.position[0, row], walker.position[1, row], whole])
        start = np.concatenate([own_start, facing_end, walker.interval_start[whole]])
        end = np.concatenate([own_end, facing_start, walker.interval_end[whole]])
        stretch = np.concatenate([np.arange(count), np.arange(count), np.full(len(whole), -1)])
        cut = np.concatenate(
            [stretches.cut_end, stretches.cut_start, np.zeros(len(whole), dtype=bool)]
        )
        order = np.lexsort((start, interval))
        self.interval, self.start, self.end = interval[order], start[order], end[order]
        self.stretch, cut = stretch[order], cut[order]
        self.site = walker.interval_site[self.interval]
        self.vertex = walker.interval_vertex[self.interval]
        rank = np.empty(len(order), dtype=np.int64)
        rank[order] = np.arange(len(order))
        across = np.concatenate([rank[count : 2 * count], rank[:count], np.full(len(whole), -1)])[
            order
        ]
        first_item = np.full(len(walker.interval_site), -1, dtype=np.int64)
        first_item[self.interval[::-1]] = np.arange(len(order))[::-1]
        along = first_item[walker.following[self.interval]]
        self.following = np.where(cut, across, along)
        if np.any(self.following < 0):
            item = int(np.flatnonzero(self.following < 0)[0])
            rows = np.array([self.site[item]])
            place = walker.sites.point(rows, np.array([self.end[item]]))[0] + walker.sites.origin
            raise GeometryError("an offset does not close", place=tuple(place))

    def walks(self) -> list[list[int]]:
        """Items in the order of the closed walks through them, by their first items."""
        following = self.following.tolist()
        visited = [False] * len(following)
        walks = []
        for begin in range(len(following)):
            walk = []
            item = begin
            while not visited[item]:
                visited[item] = True
                walk.append(item)
                item = following[item]
            if walk:
                walks.append(walk)
        return walks

    def component(self, item: int, component: IntArray, vertex_component: IntArray) -> int:
        """Component of an item."""
        if self.stretch[item] >= 0:
            return int(component[self.stretch[item]])
        return int(vertex_component[self.vertex[item]])


def joined_runs(
    site: IntArray, start: FloatArray, end: FloatArray, walk: IntArray, cyclic: bool = True
) -> tuple[IntArray, FloatArray, FloatArray, IntArray]:
    """Runs from `start` to `end` that follow each other on one site of one walk made one.

    Rows are by walk, and in the order of travel; the last of a walk comes before its first where
    it is `cyclic`.
    """
    if not len(site):
        return site, start, end, walk
    joined = (site[1:] == site[:-1]) & (walk[1:] == walk[:-1])
    joined &= (end[:-1] <= start[1:]) & (start[1:] <= end[:-1] + 1e-9)
    head = np.flatnonzero(np.concatenate([[True], ~joined]))
    tail = np.flatnonzero(np.concatenate([~joined, [True]]))
    site, start, end, walk = site[head], start[head], end[tail], walk[head]
    if not cyclic:
        return site, start, end, walk
    first = np.flatnonzero(np.concatenate([[True], walk[1:] != walk[:-1]]))
    last = np.append(first[1:], len(walk)) - 1
    over = (first < last) & (site[first] == site[last])
    over &= (end[last] <= start[first]) & (start[first] <= end[last] + 1e-9)
    start[first[over]] = start[last[over]]
    keep = np.ones(len(walk), dtype=bool)
    keep[last[over]] = False
    return site[keep], start[keep], end[keep], walk[keep]


def closed_loop(curves: list[Curve], size: float) -> Loop:
    """A loop of curves whose ends agree to rounding; short lines bridge what does not."""
    starts = np.array([curve.start for curve in curves])
    ends = np.array([curve.end for curve in curves])
    extent = float(np.max(np.ptp(starts, axis=0)))
    least = 5e-10 * (min(size, extent) if len(curves) > 1 else size)
    gap = np.roll(starts, -1, axis=0) - ends
    closed = list(curves)
    for index in np.flatnonzero(np.hypot(gap[:, 0], gap[:, 1]) > least)[::-1].tolist():
        closed.insert(index + 1, Line(ends[index], starts[(index + 1) % len(curves)]))
    return Loop(tuple(closed))
