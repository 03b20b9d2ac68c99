"""Search over the whole boundary: the nearest site and the maximal disk at a boundary point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from grassfire.medial.contact import Tangents, contact
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, SiteKind, Sites, disk_through

_FIRST_NEIGHBOURS = 8


@dataclass(frozen=True)
class Contacts:
    """Maximal disks at boundary points: radius (n,), partner site (n,), its parameter (n,).

    `partner` is -1 where nothing but the curvature at the point bounds the disk; `osculating` tells
    where the disk is the osculating one, whether or not something else touches it too.
    """

    radius: FloatArray
    partner: IntArray
    parameter: FloatArray
    osculating: BoolArray


class BoundarySearch:
    """A k-d tree of boundary samples that finds candidates; distances are to the exact curves.

    Samples are at most `spacing` apart along each site and turn by at most 0.35 rad from one to
    the next, so that every boundary point has a sample of its own site within half of that. Which
    samples can hide a nearer site follows from this bound, and as many are fetched as it demands.
    """

    def __init__(self, sites: Sites, samples: int = 256) -> None:
        self.sites = sites
        length, turn = _extents(sites)
        curved = sites.kind != SiteKind.POINT
        self.perimeter = float(length[curved].sum())
        spacing = self.perimeter / max(samples, 1)
        count = np.maximum(np.ceil(length / spacing), np.ceil(turn / 0.35))
        count = np.maximum(count, 1).astype(np.int64)
        count[~curved] = 1
        site = np.repeat(np.arange(len(sites)), count)
        index = np.arange(len(site)) - np.repeat(np.cumsum(count) - count, count)
        fraction = (index + 0.5) / count[site]
        self.site = site
        self.parameter = sites.low[site] + (sites.high[site] - sites.low[site]) * fraction
        self.point = sites.point(site, self.parameter)
        self.tree = cKDTree(self.point)
        self.half_step, self.bulge = self._cover(turn / count)

    def _cover(self, turn: FloatArray) -> tuple[float, float]:
        """How far the boundary lies from the samples of its own site, along it and by its bend."""
        sites, site = self.sites, self.site
        start = np.flatnonzero(np.concatenate([[True], site[1:] != site[:-1]]))
        last = np.concatenate([start[1:], [len(site)]]) - 1
        gap = np.hypot(*np.diff(self.point, axis=0).T) / 2
        gap[start[1:] - 1] = 0.0
        owner = site[start]
        head = np.hypot(*(self.point[start] - sites.point(owner, sites.low[owner])).T)
        tail = np.hypot(*(self.point[last] - sites.point(owner, sites.high[owner])).T)
        # An arc over its chord: 2 % longer at most for the turn of 0.35 rad between samples.
        half = 1.02 * np.maximum(
            np.maximum(head, tail), np.maximum.reduceat(np.append(gap, 0.0), start)
        )
        return float(half.max()), float(np.max(half * turn[owner])) / 4

    def reach(self, radius: FloatArray) -> FloatArray:
        """Distance within which a site closer than `radius` must show a sample."""
        return np.asarray(np.hypot(radius, self.half_step) + self.bulge)

    # -- nearest ----------------------------------------------------------------------------------

    def nearest(
        self, centre: FloatArray, excluded: IntArray | None = None
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Distance to the boundary, nearest site and its parameter, each (n,).

        Parameters
        ----------
        centre : (n, 2) float array
            In the sites' coordinates.
        excluded : (n, e) int array, optional
            Sites to leave out, row by row.
        """
        count = len(centre)
        distance = np.full(count, np.inf)
        site = np.full(count, -1, dtype=np.int64)
        parameter = np.full(count, np.nan)
        active = np.arange(count)
        neighbours = _FIRST_NEIGHBOURS
        while len(active):
            row, target, hint, farthest = self._candidates(centre[active], neighbours)
            if excluded is not None:
                keep = np.all(excluded[active][row] != target[:, None], axis=1)
                row, target, hint = row[keep], target[keep], hint[keep]
            where, away = self.sites.project(target, centre[active][row], hint)
            first, best = _minimum_by_row(row, away)
            chosen = active[first]
            distance[chosen] = away[best]
            site[chosen] = target[best]
            parameter[chosen] = where[best]
            open_rows = farthest < self.reach(distance[active])
            active = active[open_rows]
            neighbours *= 4
        return distance, site, parameter

    def _candidates(
        self, centre: FloatArray, neighbours: int
    ) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """Distinct (row, site) pairs among the nearest samples, hints, and how far they reach."""
        wanted = min(neighbours, len(self.site))
        away, index = self.tree.query(centre, k=wanted)
        away, index = away.reshape(len(centre), wanted), index.reshape(len(centre), wanted)
        farthest = away[:, -1] if wanted < len(self.site) else np.full(len(centre), np.inf)
        row = np.repeat(np.arange(len(centre)), wanted)
        flat = index.ravel()
        key = row * len(self.sites) + self.site[flat]
        _, first = np.unique(key, return_index=True)
        return row[first], self.site[flat[first]], self.parameter[flat[first]], farthest

    # -- maximal disks ----------------------------------------------------------------------------

    def maximal_disks(
        self,
        tangents: Tangents,
        curvature: FloatArray,
        excluded: IntArray,
        slack: float = 1e-12,
    ) -> Contacts:
        """Maximal disks tangent at boundary points: (A) minimised over all sites not excluded.

        The osculating circle bounds the disk; samples shrink it; then exact contacts with every
        site that still reaches into it, until none does.

        Parameters
        ----------
        tangents : Tangents
        curvature : (n,) float array
            The largest one-sided curvature at the point.
        excluded : (n, e) int array
            The sites that the point lies on.
        slack : float
            Share of its radius by which an osculating disk may be cut and still count as maximal.
        """
        with np.errstate(divide="ignore"):
            limit = np.where(curvature > 0, 1 / np.maximum(curvature, 1e-300), np.inf)
        limit = np.minimum(limit, 2 * self.sites.size)
        count = len(tangents)
        radius = self._shrink(tangents.position, tangents.normal, limit.copy())
        partner = np.full(count, -1, dtype=np.int64)
        parameter = np.full(count, np.nan)
        best = np.full(count, np.inf)
        active = np.arange(count)
        neighbours = np.full(count, _FIRST_NEIGHBOURS)
        while len(active):
            wanted = int(neighbours[active].min())
            rows = active[neighbours[active] == wanted]
            changed, complete = self._improve(
                rows, wanted, tangents, excluded, radius, best, partner, parameter
            )
            neighbours[rows[~changed & ~complete]] *= 4
            done = np.zeros(count, dtype=bool)
            done[rows[~changed & complete]] = True
            active = active[~done[active]]
        bounded = best > limit * (1 + 1e-11)
        partner[bounded] = -1
        osculating = best >= limit * (1 - slack)
        return Contacts(np.minimum(best, limit), partner, parameter, osculating)

    def _shrink(self, position: FloatArray, normal: FloatArray, radius: FloatArray) -> FloatArray:
        """Shrink the disks until no sample lies inside by more than a percent or so."""
        active = np.arange(len(position))
        for _ in range(40):
            if not len(active):
                break
            centre = position[active] + radius[active, None] * normal[active]
            away, index = self.tree.query(centre)
            inside = away < radius[active] * (1 - 1e-7)
            active, index = active[inside], index[inside]
            rho = disk_through(self.point[index] - position[active], normal[active])
            shrunk = rho < radius[active]
            active, rho = active[shrunk], rho[shrunk]
            slow = rho > 0.99 * radius[active]
            radius[active] = rho
            active = active[~slow]
        return radius

    def _improve(
        self,
        rows: IntArray,
        wanted: int,
        tangents: Tangents,
        excluded: IntArray,
        radius: FloatArray,
        best: FloatArray,
        partner: IntArray,
        parameter: FloatArray,
    ) -> tuple[BoolArray, BoolArray]:
        """One exact round: contacts with the sites near each disk. Arrays are updated in place."""
        centre = tangents.position[rows] + radius[rows, None] * tangents.normal[rows]
        row, target, hint, farthest = self._candidates(centre, wanted)
        keep = np.all(excluded[rows][row] != target[:, None], axis=1)
        row, target, hint = row[keep], target[keep], hint[keep]
        complete = farthest >= self.reach(radius[rows])
        changed = np.zeros(len(rows), dtype=bool)
        if not len(row):
            return changed, complete
        where, rho = contact(self.sites, tangents.take(rows[row]), target, hint)
        first, index = _minimum_by_row(row, rho)
        chosen = rows[first]
        better = rho[index] < best[chosen]
        # A site is only worth another round when it moves the disk.
        moved = rho[index] < radius[chosen] * (1 - 1e-14)
        changed[first] = moved & better
        chosen, index = chosen[better], index[better]
        best[chosen] = rho[index]
        partner[chosen] = target[index]
        parameter[chosen] = where[index]
        radius[chosen] = np.minimum(radius[chosen], rho[index])
        return changed, complete


def _minimum_by_row(row: IntArray, value: FloatArray) -> tuple[IntArray, IntArray]:
    """Distinct rows and the index of the smallest value in each; `row` is sorted."""
    order = np.lexsort((value, row))
    ordered = row[order]
    head = np.concatenate([[True], ordered[1:] != ordered[:-1]]) if len(row) else np.zeros(0, bool)
    return ordered[head], order[head]


def _extents(sites: Sites) -> tuple[FloatArray, FloatArray]:
    """Length and total turn of every site (fans: 0, 0)."""
    length = np.zeros(len(sites))
    turn = np.zeros(len(sites))
    line = sites.kind == SiteKind.LINE
    length[line] = np.hypot(*sites.extent[line].T)
    arc = sites.kind == SiteKind.ARC
    turn[arc] = np.abs(sites.extent[arc, 1])
    length[arc] = turn[arc] * sites.radius[arc]
    spiral = np.flatnonzero(sites.kind == SiteKind.SPIRAL)
    if len(spiral):
        fraction = np.linspace(0.0, 1.0, 17)
        low, high = sites.low[spiral, None], sites.high[spiral, None]
        grid = (low + (high - low) * fraction).ravel()
        position, first = sites.derivatives(np.repeat(spiral, 17), grid, 1)
        chord = np.diff(position.reshape(-1, 17, 2), axis=1)
        length[spiral] = np.hypot(chord[..., 0], chord[..., 1]).sum(axis=1)
        angle = np.unwrap(np.arctan2(first[:, 1], first[:, 0]).reshape(-1, 17), axis=1)
        turn[spiral] = np.abs(np.diff(angle, axis=1)).sum(axis=1)
    return length, turn
