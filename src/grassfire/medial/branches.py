"""Branch points: disks tangent to a stretch of the boundary and to both sites that it faces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from grassfire.medial.columns import Columns, equal_rows
from grassfire.medial.nodes import Nodes
from grassfire.medial.search import BoundarySearch, Feet
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, SiteKind, Sites
from grassfire.medial.triple import TripleDisks, common_disk, triple_disks

_CROWD = 64
"""Neighbouring sites beyond which a disk common to all is tried first."""


@dataclass(frozen=True)
class Guess(Columns):
    """Triples of sites (n, 3), the stretch of the first from `left` to `right`, and where their
    contacts (n, 3) and disks are expected."""

    triple: IntArray
    left: FloatArray
    right: FloatArray
    parameter: FloatArray
    centre: FloatArray
    radius: FloatArray

    def through(
        self, rows: IntArray, disks: TripleDisks, third: IntArray, where: FloatArray
    ) -> Guess:
        """The first and third, then the third and last sites, where the third reaches in."""
        part = replace(
            self.take(rows),
            parameter=disks.parameter.take(rows, axis=0),
            centre=disks.centre.take(rows, axis=0),
            radius=disks.radius[rows],
        )
        both = []
        for column in (2, 1):
            triple, parameter = part.triple.copy(), part.parameter.copy()
            triple[:, column], parameter[:, column] = third[rows], where[rows]
            both.append(replace(part, triple=triple, parameter=parameter))
        return Guess.join(*both)


def continues(sites: Sites, first: IntArray, second: IntArray) -> BoolArray:
    """Whether lines `first` (n,) run on in lines `second` at a turn too small for a corner."""
    line = sites.kind == SiteKind.LINE
    joined = (sites.following[first] == second) & ~sites.corner_after[first]
    return np.asarray(joined & line[first] & line[second])


@dataclass(frozen=True)
class Branches:
    """Finds branch points.

    Attributes
    ----------
    sites : Sites
    search : BoundarySearch
    snap : float
        Length below which two boundary points are one, mm.
    rounding : float
        Length by which disks that are one may differ, mm.
    """

    sites: Sites
    search: BoundarySearch
    snap: float
    rounding: float

    def guess(self, nodes: Nodes, rows: IntArray, one: IntArray, other: IntArray) -> Guess:
        """Where to look for disks tangent to a site and both its partners, between two nodes."""
        left, right = nodes.parameter[rows], nodes.parameter[rows + 1]
        triple = np.stack([nodes.site[rows], one, other], axis=1)
        facing = np.stack([nodes.facing[rows], nodes.facing[rows + 1]], axis=1)
        middle = 0.5 * (self.sites.low + self.sites.high)
        facing = np.where(np.isnan(facing), middle[triple[:, 1:]], facing)
        return Guess(
            triple,
            left,
            right,
            np.concatenate([0.5 * (left + right)[:, None], facing], axis=1),
            0.5 * (nodes.centre.take(rows, axis=0) + nodes.centre.take(rows + 1, axis=0)),
            0.5 * (nodes.radius[rows] + nodes.radius[rows + 1]),
        )

    def disks(self, guess: Guess) -> TripleDisks:
        """Disks tangent to a site and both its partners, within a stretch of the site."""
        triple, left, right = guess.triple, guess.left, guess.right
        site, one, other = triple.T
        disks = self._rounds(triple)
        rest = (~disks.good).nonzero()[0]
        if len(rest):
            part = guess.take(rest)
            found = triple_disks(self.sites, part.triple, part.centre, part.radius, part.parameter)
            disks.put(rest, found)
        mine = disks.parameter[:, 0]
        doubtful = (site == one) | (site == other) | (one == other)
        if SiteKind.SPIRAL in self.sites.curved:
            doubtful |= self._near_singular(triple, disks.determinant)
        if self._flat_corners:
            for first, second in ((site, one), (site, other), (one, other)):
                doubtful |= continues(self.sites, first, second)
                doubtful |= continues(self.sites, second, first)
        # A node may be the branch point itself.
        speed = np.maximum(self.sites.speed(site, mine, disks.radius), 1e-300)
        margin = self.snap / speed
        inside = (mine >= left - margin) & (mine <= right + margin) & ~doubtful
        disks.parameter[:, 0] = np.clip(mine, left, right)
        return replace(disks, good=disks.good & inside, settled=disks.settled & inside)

    @cached_property
    def _flat_corners(self) -> bool:
        """Whether any lines meet at a turn too small for a corner."""
        every = np.arange(len(self.sites))
        return bool(continues(self.sites, every, self.sites.following).any())

    def _near_singular(self, triple: IntArray, determinant: FloatArray) -> BoolArray:
        """Two sites that meet smoothly and a third: too close to singular for Newton's method."""
        site, one, other = triple.T
        near = (self.sites.following[site] == one) | (self.sites.following[site] == other)
        near |= (self.sites.preceding[site] == one) | (self.sites.preceding[site] == other)
        near |= (self.sites.following[one] == other) | (self.sites.preceding[one] == other)
        curved = self.sites.kind[triple] == SiteKind.SPIRAL
        return np.asarray(near & (curved.sum(axis=1) >= 2) & (np.abs(determinant) < 1e-4))

    def empty(self, triple: IntArray, disks: TripleDisks) -> tuple[BoolArray, IntArray, FloatArray]:
        """Whether no other site reaches into the disks of triples (n, 3); equal disks count once.

        Also the sites that reach in farthest and the parameters there; -1 where none does.
        """
        result, parameter = np.zeros(len(disks.good), dtype=bool), np.full(len(disks.good), np.nan)
        site = np.full(len(result), -1, dtype=np.int64)
        rows = disks.good.nonzero()[0]
        if not len(rows):
            return result, site, parameter
        group = equal_rows(np.round(disks.centre.take(rows, axis=0).T / (1e-10 * self.sites.size)))
        members = np.bincount(group)
        first = np.empty(len(members), dtype=np.int64)
        first[group[::-1]] = np.arange(len(group))[::-1]
        chosen = rows[first]
        centre, feet = disks.centre.take(chosen, axis=0), None
        if SiteKind.SPIRAL in self.sites.curved:
            feet = self._feet(triple[chosen], disks.take(chosen))
        away, nearest, where = self.search.nearest(centre, bound=disks.radius[chosen], feet=feet)
        away[members > 1] += 1e-10 * self.sites.size
        result[rows] = disks.radius[rows] <= away[group] + self.rounding
        site[rows], parameter[rows] = nearest[group], where[group]
        return result, site, parameter

    def _feet(self, triple: IntArray, disks: TripleDisks) -> Feet:
        """Where disks touch their triples."""
        foot = self.sites.point(triple.ravel(), disks.parameter.ravel()).reshape(-1, 3, 2)
        apart = foot - disks.centre[:, None]
        return Feet(triple, disks.parameter, np.hypot(apart[..., 0], apart[..., 1]))

    def _rounds(self, triple: IntArray) -> TripleDisks:
        """Disks common to long runs of sites, each of which meets its neighbours.

        About the centre of a regular polygon of very many sides every three neighbours have a disk
        of their own, good to few digits or none; the disk that fits all sides by least squares is
        good to all, and is taken where it touches the three.
        """
        sites = self.sites
        count = len(triple)
        centre, radius = np.zeros((count, 2)), np.zeros(count)
        parameter, good = np.full((count, 3), np.nan), np.zeros(count, dtype=bool)
        mine, one, other = triple.T
        beside = sites.preceding.take(mine) == one
        beside &= sites.following.take(mine) == other
        rows = beside.nonzero()[0]
        rows = rows[np.all(sites.kind.take(triple.take(rows, axis=0)) == SiteKind.LINE, axis=1)]
        run = np.concatenate([[0], np.cumsum(sites.following[mine[rows[:-1]]] != mine[rows[1:]])])
        length = np.bincount(run[: len(rows)]) if len(rows) else np.zeros(0, dtype=np.int64)
        for number in (length > _CROWD).nonzero()[0]:
            members = rows[run == number]
            fit = common_disk(sites, triple[members], self.rounding)
            if fit is None:
                continue
            touching = np.abs(fit.residual).max(axis=1) <= self.rounding
            chosen = members[touching]
            centre[chosen], radius[chosen] = fit.centre, fit.radius
            parameter[chosen], good[chosen] = fit.parameter[touching], True
        return TripleDisks(centre, radius, parameter, good.copy(), good, np.ones(count))
