"""Trimmed offsets without clipping: { u : r(u) >= d }, carried over to the partner where r falls.

The boundary is a cyclic list of intervals, two for each polynomial piece of the axis (its two
sides) and one for each contact arc. At distance d every piece keeps the stretches with r >= d.
Walking the kept stretches along the boundary, and over the axis to the other side where a stretch
ends in r = d, closes the offset loops; lines stay lines and arcs stay arcs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from grassfire.errors import GeometryError
from grassfire.geometry import Arc, Curve, Line, Loop, ParallelCurve
from grassfire.medial.edges import evaluate_span
from grassfire.medial.nodes import WHOLE
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, SiteKind

if TYPE_CHECKING:
    from grassfire.medial.axis import MedialAxis


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
    for level, distance in enumerate(distances):
        effective = settled(axis, float(distance))
        stretches = walker.stretches(effective)
        component, vertex_component = walker.components(stretches, effective)
        found = walker.loops(stretches, component, vertex_component, effective)
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
        from_in, to_in = self.part_low >= distance, self.part_high >= distance
        crossing = np.flatnonzero(from_in != to_in)
        place = self._cross(crossing, distance)
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

    def _cross(self, part: IntArray, distance: float) -> FloatArray:
        """Fractions where r = distance on monotone parts: bisection, then secant on exact disks."""
        row = self.part_row[part]
        left, right = self.part_start[part].copy(), self.part_end[part].copy()
        rising = self.part_high[part] > self.part_low[part]
        for _ in range(45):
            middle = 0.5 * (left + right)
            above = self.axis.disks(row, middle)[:, 2] >= distance
            go_left = above == rising
            right = np.where(go_left, middle, right)
            left = np.where(go_left, left, middle)
        place = 0.5 * (left + right)
        return self._polish(part, place, distance)

    def _polish(self, part: IntArray, place: FloatArray, distance: float) -> FloatArray:
        axis = self.axis
        row = self.part_row[part]
        low, high = self.part_start[part], self.part_end[part]
        step = 1e-6
        ahead, behind = np.minimum(place + step, 1.0), np.maximum(place - step, 0.0)
        rise = axis.disks(row, ahead)[:, 2] - axis.disks(row, behind)[:, 2]
        slope = rise / np.maximum(ahead - behind, 1e-300)
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
        matrix = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(total, total))
        _, label = connected_components(matrix, directed=False)
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

    def loops(
        self,
        stretches: Stretches,
        component: IntArray,
        vertex_component: IntArray,
        distance: float,
    ) -> list[tuple[int, tuple[Loop, ...]]]:
        """Closed offset loops by component, the outer loop first."""
        items = _BoundaryItems(self, stretches, vertex_component)
        visited = np.zeros(len(items.interval), dtype=bool)
        found: dict[int, list[Loop]] = {}
        for begin in range(len(items.interval)):
            if visited[begin]:
                continue
            walk = []
            item = begin
            while not visited[item]:
                visited[item] = True
                walk.append(item)
                item = items.following[item]
            curves = self._curves(items, walk, distance)
            if curves:
                label = items.component(begin, component, vertex_component)
                found.setdefault(label, []).append(closed_loop(curves, self.sites.size))
        result = []
        for label, loops in found.items():
            ordered = sorted(loops, key=lambda loop: -loop.area)
            result.append((label, tuple(ordered)))
        return result

    def _curves(self, items: _BoundaryItems, walk: list[int], distance: float) -> list[Curve]:
        """Offset curves of a walk; neighbours on one site are one curve."""
        runs = [(int(items.site[k]), float(items.start[k]), float(items.end[k])) for k in walk]
        curves = [self.curve(*run, distance) for run in joined_runs(runs, cyclic=True)]
        return [curve for curve in curves if curve is not None]

    def curve(self, site: int, start: float, end: float, distance: float) -> Curve | None:
        """Offset of a part of a site, None where it has no length to speak of."""
        sites = self.sites
        kind = sites.kind[site]
        least = 1e-9 * sites.size
        origin = sites.origin
        if kind == SiteKind.SPIRAL:
            if end - start <= 1e-12:
                return None
            base = self.axis.beziers[int(sites.bezier[site])]
            if distance == 0:
                return base.subcurve(float(start), float(end))
            return ParallelCurve(base, distance, float(start), float(end))
        if kind == SiteKind.LINE:
            anchor, direction = sites.anchor[site] + origin, sites.extent[site]
            across = np.array([-direction[1], direction[0]]) / np.hypot(*direction)
            points = anchor + np.outer((start, end), direction) + distance * across
            if np.hypot(*(points[1] - points[0])) <= least:
                return None
            return Line(points[0], points[1])
        first, turn = sites.extent[site]
        if kind == SiteKind.POINT:
            radius, centre = distance, sites.anchor[site] + origin
            angle, sweep = first + start * turn, (end - start) * turn
        else:
            radius = sites.radius[site] - np.sign(turn) * distance
            centre = sites.anchor[site] + origin
            angle, sweep = first + start * turn, (end - start) * turn
        if radius * abs(sweep) <= least:
            return None
        return Arc(centre, float(radius), float(angle), float(sweep))


class _BoundaryItems:
    """Kept stretches as seen from the boundary, in boundary order, and their successors."""

    def __init__(self, walker: Walker, stretches: Stretches, vertex_component: IntArray) -> None:
        span = walker.axis.span
        row = stretches.row
        count = len(row)
        _, facing_start = walker.exact(row, stretches.start)
        _, facing_end = walker.exact(row, stretches.end)
        length = span.end[row] - span.start[row]
        own_start = span.start[row] + length * stretches.start
        own_end = np.where(
            stretches.cut_end, span.start[row] + length * stretches.end, span.end[row]
        )
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

    def component(self, item: int, component: IntArray, vertex_component: IntArray) -> int:
        """Component of an item."""
        if self.stretch[item] >= 0:
            return int(component[self.stretch[item]])
        return int(vertex_component[self.vertex[item]])


def joined_runs(
    runs: list[tuple[int, float, float]], cyclic: bool
) -> list[tuple[int, float, float]]:
    """Runs (site, start, end) that follow each other on one site made one."""
    result: list[tuple[int, float, float]] = []
    for site, start, end in runs:
        if result and result[-1][0] == site and result[-1][2] <= start <= result[-1][2] + 1e-9:
            result[-1] = (site, result[-1][1], end)
        else:
            result.append((site, start, end))
    if cyclic and len(result) > 1 and result[0][0] == result[-1][0]:
        site, start, end = result[-1]
        if end <= result[0][1] <= end + 1e-9:
            result[0] = (site, start, result[0][2])
            result.pop()
    return result


def closed_loop(curves: list[Curve], size: float) -> Loop:
    """A loop of curves whose ends agree to rounding; short lines bridge what does not."""
    extent = float(np.max(np.ptp([curve.start for curve in curves], axis=0)))
    least = 5e-10 * (min(size, extent) if len(curves) > 1 else size)
    closed: list[Curve] = []
    for curve, following in zip(curves, [*curves[1:], curves[0]], strict=True):
        closed.append(curve)
        end, start = np.asarray(curve.end), np.asarray(following.start)
        if np.hypot(*(start - end)) > least:
            closed.append(Line(end, start))
    return Loop(tuple(closed))
