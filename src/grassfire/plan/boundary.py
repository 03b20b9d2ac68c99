"""Distances from a boundary of lines and arcs, asked for by the hundred, thousands of times."""

from __future__ import annotations

import numpy as np

from grassfire.medial import MedialAxis
from grassfire.medial.sites import SiteKind, Sites
from grassfire.plan.places import BoolArray, IntArray
from grassfire.plan.pursuit import unit
from grassfire.toolpath import FloatArray

DIVISION = 4
"""Parts of a cell along each side when it is divided."""

FINEST = 1 / 256
"""Least size of a cell as a part of the longer side of the drawing."""


class Boundary:
    """Signed distance from all lines and arcs round a region, exact to rounding.

    The box of the region is divided into square cells; for each the sites are kept that may be the
    nearest to a place in it: those whose distance from the middle exceeds the least one by no more
    than the diagonal of the cell. Cells are divided level by level, each asking the sites of the
    one around it. The distance from the middle bounds that of all places in the cell.

    Parameters
    ----------
    axis : MedialAxis
        Without curves other than lines and arcs; see `suits`.
    cell : float
        Largest size of a cell, mm.
    """

    def __init__(self, axis: MedialAxis, cell: float) -> None:
        self._axis = axis
        self._columns = _Columns(axis.sites)
        left, low, right, high = axis.region.bounds()
        # tools and their rims may be a little outside
        beyond = 2 * cell
        size = max(right - left, high - low) + 2 * beyond
        self._corner = np.array([left - beyond, low - beyond])
        cell = max(cell, FINEST * size)
        levels = max(0, int(np.ceil(np.log(size / cell) / np.log(DIVISION))))
        self._side = DIVISION**levels
        self._cell = size / self._side
        self._first, self._count, self._site, self._bound = self._divided(size, levels)

    @staticmethod
    def suits(axis: MedialAxis) -> bool:
        """Whether the boundary is of lines and arcs alone."""
        return SiteKind.SPIRAL not in axis.sites.curved

    def clearance(self, points: FloatArray, enough: float = np.inf) -> FloatArray:
        """(n,) distance of points (n, 2) to the boundary, negative outside the region, mm.

        Where it is at least `enough` a bound of it may stand for it that is at least that as well.
        """
        if not len(points):
            return np.zeros(0)
        place = (points - self._corner) / self._cell
        if place.min() < 0 or place.max() >= self._side:
            beyond = ((place < 0) | (place >= self._side)).any(axis=1)
            result = np.empty(len(points))
            result[beyond] = self._axis.clearance(points[beyond])
            result[~beyond] = self.clearance(points[~beyond], enough)
            return result
        index = place.astype(np.int64)
        cell = index[:, 1] * self._side + index[:, 0]
        result = self._bound.take(cell)
        near = (result < enough).nonzero()[0]
        if len(near) == len(points):
            return self._exact(points, cell)
        if len(near):
            result[near] = self._exact(points.take(near, axis=0), cell.take(near))
        return np.asarray(result)

    def _exact(self, points: FloatArray, cell: IntArray) -> FloatArray:
        """(n,) signed distance of points in given cells, mm."""
        x, y = points[:, 0], points[:, 1]
        count, first = self._count.take(cell), self._first.take(cell)
        if count.max() == 1:
            away, inside = self._columns.distance(self._site.take(first), x, y)
            return np.where(inside, away, -away)
        ends = count.cumsum()
        start = ends - count
        pair = (first - start).repeat(count)
        pair += np.arange(len(pair))
        site = self._site.take(pair)
        away, inside = self._columns.distance(site, x.repeat(count), y.repeat(count))
        least = np.minimum.reduceat(away, start)
        nearest = (away == least.repeat(count)) & inside
        return np.where(np.logical_or.reduceat(nearest, start), least, -least)

    def _divided(self, size: float, levels: int) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
        """First row and number of the sites of each cell, row by row, the sites, and bounds.

        These are of the distance from the boundary inside the region, of all places of the cell.
        """
        sites = self._columns.sites
        first, count, side = np.zeros(1, dtype=np.int64), np.array([len(sites)]), 1
        bound = np.full(1, -np.inf)
        for _ in range(levels):
            parts = np.arange(side * DIVISION)
            parent = (parts[:, None] // DIVISION * side + parts[None] // DIVISION).ravel()
            side *= DIVISION
            middle = (parts + 0.5) * (size / side)
            x = np.tile(self._corner[0] + middle, side)
            y = np.repeat(self._corner[1] + middle, side)
            each = count[parent]
            start = each.cumsum() - each
            candidate = sites[np.arange(each.sum()) + (first[parent] - start).repeat(each)]
            away, inside = self._columns.distance(candidate, x.repeat(each), y.repeat(each))
            least = np.minimum.reduceat(away, start)
            inside &= away == least.repeat(each)
            diagonal = (np.sqrt(2) + 1e-9) * size / side
            bound = np.where(np.logical_or.reduceat(inside, start), least - diagonal / 2, -np.inf)
            kept = away <= (least + diagonal).repeat(each)
            count = np.add.reduceat(kept, start, dtype=np.int64)
            first, sites = count.cumsum() - count, candidate[kept]
        return first, count, sites, bound


class _Columns:
    """Lines and arcs as columns, for the distances of pairs of a site and a place."""

    def __init__(self, sites: Sites) -> None:
        self.sites = (sites.kind != SiteKind.POINT).nonzero()[0]
        arc = sites.kind == SiteKind.ARC
        before, after, reflex_before, reflex_after = sites.ends
        self._convex = np.stack([before, after], axis=1).ravel()
        self._reflex = np.stack([reflex_before, reflex_after], axis=1).ravel()
        self._arc = arc if arc.any() else None
        anchor = sites.anchor + sites.origin
        chord = np.where(arc[:, None], 1.0, sites.extent)
        square = np.maximum(chord[:, 0] ** 2 + chord[:, 1] ** 2, 1e-300)
        self._line = np.column_stack([anchor, chord, square])
        half = sites.extent[:, 1] / 2
        middle = sites.extent[:, 0] + half
        limit = np.where(np.abs(half) < np.pi, np.cos(half), -2.0)
        ends = [anchor + sites.radius[:, None] * unit(middle + turn) for turn in (-half, half)]
        columns = [anchor, sites.radius, unit(middle), limit, np.sign(half), *ends]
        self._bend = np.column_stack(columns)

    def distance(
        self, site: IntArray, x: FloatArray, y: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """(n,) distances of sites from places, and if places are inside as seen from there."""
        left, low, along, up, square = self._line[site].T
        right, above = x - left, y - low
        share = (right * along + above * up) / square
        foot = np.minimum(np.maximum(share, 0.0), 1.0)
        away = np.hypot(right - foot * along, above - foot * up)
        inside = along * above >= up * right
        at_end, high = foot != share, share > 1.0
        if self._arc is not None:
            rows = self._arc[site].nonzero()[0]
            if len(rows):
                found = self._from_arcs(site[rows], x[rows], y[rows])
                for column, part in zip((away, inside, at_end, high), found, strict=True):
                    column[rows] = part
        ends = at_end.nonzero()[0]
        if len(ends):
            # nearest points are convex corners from outside alone, reflex ones from inside
            number = 2 * site[ends] + high[ends]
            seen = inside[ends] | self._reflex[number]
            inside[ends] = np.where(self._convex[number], away[ends] == 0, seen)
        return away, inside

    def _from_arcs(
        self, site: IntArray, x: FloatArray, y: FloatArray
    ) -> tuple[FloatArray, BoolArray, BoolArray, BoolArray]:
        """Distance, side, if the nearest place is an end, and if that is the last one."""
        left, low, radius, along, up, limit, turn, *ends = self._bend[site].T
        right, above = x - left, y - low
        reach = np.hypot(right, above)
        away = np.abs(reach - radius)
        inside = (reach <= radius) == (turn > 0)
        high = (along * above - up * right) * turn > 0
        at_end = right * along + above * up < reach * limit
        rows = at_end.nonzero()[0]
        if len(rows):
            first_x, first_y, last_x, last_y = (column[rows] for column in ends)
            last = high[rows]
            end_x, end_y = np.where(last, last_x, first_x), np.where(last, last_y, first_y)
            away[rows] = np.hypot(x[rows] - end_x, y[rows] - end_y)
        return away, inside, at_end, high
