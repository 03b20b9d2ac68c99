"""Search over the whole boundary: the nearest site and the maximal disk at a boundary point."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grassfire.geometry.neighbours import Neighbours
from grassfire.medial.columns import Columns
from grassfire.medial.contact import Tangents, contact
from grassfire.medial.reach import FarSamples
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, SiteKind, Sites, disk_through

_FIRST_NEIGHBOURS = ((512, 10), (96, 16), (0, 32))
"""Numbers of points from which so many samples are looked at first: rounds cost more than samples
where points are few."""
_AMONG_CURVES = ((4096, 10), (512, 12), (0, 32))
"""The same where there are curves, of which contacts cost more."""
_MOST_CROWDED = 8
"""How many more they are at most, where a query sees many samples."""
_FEW_NEIGHBOURS = 8
_EARLIER = np.tri(_FEW_NEIGHBOURS, dtype=bool)
_SAMPLES_PER_SITE = (2, 16)
_CROWDING = 60.0
_TURNED = np.array([(np.cos(0.5), -np.sin(0.5)), (np.sin(0.5), np.cos(0.5))])
"""The tree has its own axes: its nodes split off points that are level with an axis one by one."""
_STRIDE, _STRIDED = 8, 256
"""One search of eight comes first, where there are so many."""
_SOMEWHAT = 2.0
"""How much larger than those beside it a disk begins that nothing else bounds."""
_GLANCE = 0.1
"""Share by which a first look at the distance may be off."""
_ROUGH = 1e-2
"""Share of its radius that a disk which touches a sample may be too large by."""
_CLINGING = 64
"""Of so many samples the longest step along the boundary passes over one."""
_PAIRS = 20_000
"""Points times samples that are compared one by one as quickly as a tree answers."""
_STEPS = 8
"""Sites along which contacts are followed from where samples show them."""
_MANY = 4096
"""Searches of fewer points are given more neighbours."""


@dataclass(frozen=True)
class Contacts(Columns):
    """Maximal disks at boundary points: radius (n,), partner site (n,), its parameter (n,).

    `partner` is -1 where nothing but the curvature at the point bounds the disk; `osculating` tells
    where the disk is the osculating one, whether or not something else touches it too.
    """

    radius: FloatArray
    partner: IntArray
    parameter: FloatArray
    osculating: BoolArray


@dataclass(frozen=True)
class Rivals(Columns):
    """Sites (n, e) that disks at n boundary points are likely to touch, -1 for none, and where
    their contacts are expected (NaN where that is not known)."""

    site: IntArray
    hint: FloatArray


@dataclass(frozen=True)
class Feet(Columns):
    """Places (n, e) on sites that are nearer to n points than any near them, and how far, mm.

    The site is -1 where there is none.
    """

    site: IntArray
    parameter: FloatArray
    distance: FloatArray


@dataclass(frozen=True)
class _Candidates:
    """Pairs of a query row and a site that may be near: parameter and distance of its nearest
    sample.

    `complete` tells per row whether every site that reaches it is among them; where that is
    `partial`, some site is, if there is any.
    """

    row: IntArray
    site: IntArray
    hint: FloatArray
    away: FloatArray
    complete: BoolArray
    partial: BoolArray


class BoundarySearch:
    """A k-d tree of boundary samples that finds candidates; distances are to the exact curves.

    Samples are at most `spacing` apart along each site and turn by at most 0.35 rad from one to
    the next. A boundary point at distance d is at most sqrt(d^2 + h^2) + bulge from a sample of
    its own site, h being half a step: which samples can hide a nearer site follows from this bound,
    and as many are fetched as it demands.

    Parameters
    ----------
    sites : Sites
    area : float
        Of the region, mm^2.
    density : int
        Factor on the number of samples.
    """

    def __init__(self, sites: Sites, area: float, density: int = 1) -> None:
        self.sites = sites
        self._far: FarSamples | None = None
        length, turn = _extents(sites)
        curved = sites.kind != SiteKind.POINT
        self.perimeter = float(length[curved].sum())
        few, many = _SAMPLES_PER_SITE
        # A query sees the samples within a step: about perimeter^3 / (area samples^2) of them.
        crowded = np.sqrt(self.perimeter**3 / (max(area, 1e-300) * _CROWDING))
        samples = density * max(256.0, min(max(few * len(sites), crowded), many * len(sites)))
        self.crowding = min(int(_CROWDING * (crowded / samples) ** 2), _MOST_CROWDED)
        spacing = self.perimeter / samples
        count = np.maximum(np.ceil(length / spacing), np.ceil(turn / 0.35))
        count = np.maximum(count, 1).astype(np.int64)
        count[~curved] = 1
        self.site, self.parameter = sites.spread(count)
        self.point = sites.point(self.site, self.parameter)
        # Points on curves: other nodes make far queries up to 80 times faster.
        self.samples = Neighbours(self.point @ _TURNED)
        self.half, self.bulge = self._cover(turn / count)
        self.half_step, self.most_bulge = float(self.half.max()), float(self.bulge.max())

    def _cover(self, turn: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far each site lies from its own samples, along it and by its bend."""
        sites, site = self.sites, self.site
        start = np.concatenate([[True], site[1:] != site[:-1]]).nonzero()[0]
        last = np.concatenate([start[1:], [len(site)]]) - 1
        gap = np.hypot(*np.diff(self.point, axis=0).T) / 2
        gap[start[1:] - 1] = 0.0
        owner = site[start]
        head = np.hypot(*(self.point[start] - sites.point(owner, sites.low[owner])).T)
        tail = np.hypot(*(self.point[last] - sites.point(owner, sites.high[owner])).T)
        half = np.maximum(np.maximum(head, tail), np.maximum.reduceat(np.append(gap, 0.0), start))
        # An arc over its chord: 2 % longer at most for the turn of 0.35 rad between samples.
        half *= np.where(turn[owner] > 0, 1.02, 1.0)
        # A uniform bend moves them off the tangent by a quarter of this; spirals do not bend so.
        return half, half * turn[owner]

    def _complete(
        self, farthest: FloatArray, radius: FloatArray, slack: float, outside: bool
    ) -> BoolArray:
        """Whether sites none of whose samples is nearer than `farthest` stay out of `radius`.

        From inside the region nearest points are feet of normals; from outside they may be convex
        corners, whose sites fall back from there. Sites that come nearer by no more than `slack`
        do not count: about the centre of a circle all do.
        """
        if outside:
            return np.asarray(farthest >= radius + self.half_step + self.most_bulge)
        least = np.maximum(farthest - self.most_bulge, 0.0) ** 2 - self.half_step**2
        return np.asarray(np.sqrt(np.maximum(least, 0.0)) >= radius - slack)

    def seeing_far(self) -> BoundarySearch:
        """The same search, quicker about the centres of disks that are large beside the detail.

        Those disks are looked for among the samples of the sites alone that so large disks inside
        the region can touch. It takes disks that reach across the boundary for inside ones where
        samples do not tell: what it finds has to be certified.
        """
        far = FarSamples.among(self.sites, self.site, self.samples.points)
        if far is None:
            return self
        result = copy(self)
        result._far = far
        return result

    def _query(
        self,
        centre: FloatArray,
        neighbours: int,
        share: float,
        radius: FloatArray | None,
        reach: FloatArray | None = None,
    ) -> tuple[FloatArray, IntArray, BoolArray]:
        """Nearest samples, or some farther by a `share` of their distance.

        Around disks of a `radius` (n,) that hold no samples to speak of, mm, only those count that
        disks inside the region touch. Samples beyond a `reach` (n,), mm, may be left out; columns
        that this leaves empty are infinitely far. Also where others were left out: the nearest site
        is found then, but some may be missing.
        """
        place, far = centre @ _TURNED, self._far
        if far is None or radius is None:
            found = self.samples.nearest(place, neighbours, share, reach)
            return *found, np.zeros(len(place), dtype=bool)
        away = np.full((len(place), neighbours), np.inf)
        index: IntArray = np.zeros((len(place), neighbours), dtype=np.int64)
        glance = self.samples.nearest(place, 1, _GLANCE)[0][:, 0]
        least = (glance / (1 + _GLANCE)) ** 2 - self.half_step**2
        distant = (least > far.radius**2) & (glance >= (1 - _GLANCE) * radius)
        for chosen, samples, number in (
            (distant, far.samples, far.row),
            (~distant, self.samples, None),
        ):
            rows = chosen.nonzero()[0]
            if len(rows):
                count = min(neighbours, len(samples))
                bound = None if reach is None else reach[rows]
                found = samples.nearest(place[rows], count, share, bound)
                away[rows, :count] = found[0]
                index[rows, :count] = (
                    found[1] if number is None else number.take(found[1], mode="clip")
                )
        return away, index, distant

    def _first_neighbours(self, count: int) -> int:
        """Samples that are looked at first about each of `count` points."""
        steps = _AMONG_CURVES if self.sites.curved else _FIRST_NEIGHBOURS
        least = next(number for points, number in steps if count >= points)
        return least + self.crowding

    # -- nearest ----------------------------------------------------------------------------------

    def nearest(
        self,
        centre: FloatArray,
        excluded: IntArray | None = None,
        outside: bool = False,
        slack: float = 0.0,
        bound: FloatArray | None = None,
        feet: Feet | None = None,
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Distance to the boundary, nearest site and its parameter, each (n,).

        Parameters
        ----------
        centre : (n, 2) float array
            In the sites' coordinates.
        excluded : (n, e) int array, optional
            Sites to leave out, row by row.
        outside : bool
            Whether centres may lie outside the region.
        slack : float
            By how much the distance may be too large where very many sites are as near, mm.
        bound : (n,) float array, optional
            Distances beyond which nothing is looked for, mm: what is farther may be found or not,
            and where nothing is found the distance is infinite and the site -1.
        feet : Feet, optional
            What is known already. The rest of their sites is looked at where samples show more.
        """
        allowance, slack = slack, slack + 1e-13 * self.sites.size
        count = len(centre)
        neighbours = self._first_neighbours(count)
        if excluded is None and outside and 0 < count < _MANY:
            distance, site, parameter, active = self._nearest_few(centre, allowance)
        else:
            distance = np.full(count, np.inf)
            site = np.full(count, -1, dtype=np.int64)
            parameter = np.full(count, np.nan)
            active = np.arange(count)
        if feet is not None:
            nearest = np.arange(count), feet.distance.argmin(axis=1)
            distance, site = feet.distance[nearest], feet.site[nearest]
            parameter = feet.parameter[nearest]
        while len(active):
            found = self._candidates(
                centre[active],
                np.full(len(active), np.inf) if bound is None else bound[active],
                neighbours,
                None if excluded is None else excluded[active],
                slack,
                outside,
                nearest=True,
            )
            row, target, hint = active[found.row], found.site, found.hint
            if feet is not None:
                new = self._unknown(feet, row, target, hint, found.away).nonzero()[0]
                row, target, hint = row[new], target[new], hint[new]
            where, away = self.sites.project(target, centre.take(row, axis=0), hint, allowance)
            chosen, best = _minimum_by_row(row, away)
            nearer = (away[best] < distance[chosen]).nonzero()[0]
            chosen, best = chosen[nearer], best[nearer]
            distance[chosen] = away[best]
            site[chosen] = target[best]
            parameter[chosen] = where[best]
            active = active[~found.complete]
            neighbours *= 2
        return distance, site, parameter

    def _unknown(
        self, feet: Feet, row: IntArray, site: IntArray, parameter: FloatArray, away: FloatArray
    ) -> BoolArray:
        """Whether samples (k,), `away` from the points `row` (k,), show more than feet do.

        They do not beside a foot on the same site that is nearer.
        """
        step = self._step[site]
        result = np.ones(len(row), dtype=bool)
        for column in range(feet.site.shape[1]):
            known = feet.site[row, column] == site
            known &= np.abs(feet.parameter[row, column] - parameter) <= step
            known &= feet.distance[row, column] <= away
            result &= ~known
        return result

    @cached_property
    def _step(self) -> FloatArray:
        """(m,) parameters from sample to sample."""
        return (self.sites.high - self.sites.low) / np.bincount(self.site)

    @cached_property
    def _everywhere(self) -> tuple[Neighbours, IntArray, FloatArray]:
        """The samples and all convex corners, however flat, their sites and parameters.

        With these the nearest boundary point of a place outside, too, is the foot of a normal or a
        sample itself.
        """
        corner = (self.sites.corner_after | (self.sites.turn_after != 0)).nonzero()[0]
        end = self.sites.high[corner]
        point = np.concatenate([self.point, self.sites.point(corner, end)])
        everywhere = Neighbours(point)
        return everywhere, np.append(self.site, corner), np.append(self.parameter, end)

    def _nearest_few(
        self, centre: FloatArray, allowance: float
    ) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
        """As `nearest` for centres anywhere, in one round of few array operations.

        Also the rows (k,) for which sites may be nearer that were not looked at.
        """
        samples, site, parameter = self._everywhere
        count, wanted = len(centre), min(_FEW_NEIGHBOURS, len(site))
        away, index = samples.nearest(centre, wanted)
        owner = site.take(index)
        limit = away[:, :1] * (1 + 1e-9)
        allowed = away <= np.hypot(limit, self.half.take(owner)) + self.bulge.take(owner)
        # One sample of each site, the nearest, where projecting from each of them takes time.
        if SiteKind.SPIRAL in self.sites.curved:
            repeated = owner[:, 1:, None] == owner[:, None, :-1]
            repeated &= _EARLIER[: wanted - 1, : wanted - 1]
            allowed[:, 1:] &= ~repeated.any(axis=2)
        chosen = allowed.ravel().nonzero()[0]
        target, row = owner.ravel().take(chosen), chosen // wanted
        hint = parameter.take(index.ravel().take(chosen))
        where, apart = self.sites.project(target, centre.take(row, axis=0), hint, allowance)
        table, parameters = np.full(count * wanted, np.inf), np.empty(count * wanted)
        table[chosen], parameters[chosen] = apart, where
        best = table.reshape(count, wanted).argmin(axis=1) + np.arange(0, count * wanted, wanted)
        complete = self._complete(away[:, -1], away[:, 0], 1e-13 * self.sites.size, False)
        complete |= wanted == len(site)
        rest = (~complete).nonzero()[0]
        return table.take(best), owner.ravel().take(best), parameters.take(best), rest

    def _candidates(
        self,
        centre: FloatArray,
        radius: FloatArray,
        neighbours: int,
        excluded: IntArray | None,
        slack: float,
        outside: bool = False,
        nearest: bool = False,
    ) -> _Candidates:
        """Sites among the nearest samples that may come within `radius`; only such that may be the
        `nearest` if that is all that is asked for."""
        wanted = min(neighbours, len(self.site))
        reach = self._reach(radius, outside)
        away, index, partial = self._query(centre, wanted, 0.0, None if outside else radius, reach)
        # A disk is wanted to its whole radius: its nearest site may end before it touches.
        limit = radius
        if nearest:
            limit = np.minimum(radius, self._nearest_sample(away, index, excluded))
        complete = self._complete(away[:, -1], limit, slack, outside)
        complete |= wanted == len(self.site)
        away, index = away.ravel(), index.ravel()
        place = (away.reshape(-1, wanted) <= reach[:, None]).ravel().nonzero()[0]
        row, owner = place // wanted, self.site.take(index.take(place))
        near = self._touched(away.take(place), owner, limit.take(row), outside).nonzero()[0]
        place, row, target = place.take(near), row.take(near), owner.take(near)
        # The nearest sample of each site: rows are in order and so are samples within a row.
        key = row * len(self.sites) + target
        order = key.argsort(kind="stable")
        key = key.take(order)
        chosen = order[np.concatenate([[True], key[1:] != key[:-1]])[: len(key)]]
        if excluded is not None:
            own, other = excluded.take(row.take(chosen), axis=0), target.take(chosen)
            chosen = chosen[~_among_columns(other, own)]
        place = place.take(chosen)
        return _Candidates(
            row.take(chosen),
            target.take(chosen),
            self.parameter.take(index.take(place)),
            away.take(place),
            complete,
            partial,
        )

    def _reach(self, radius: FloatArray, outside: bool) -> FloatArray:
        """Distances (n,) beyond which samples are of no site that comes within a radius (n,)."""
        beyond = radius + self.half_step if outside else np.hypot(radius, self.half_step)
        return np.asarray((beyond + self.most_bulge) * (1 + 1e-8))

    def _touched(
        self, away: FloatArray, owner: IntArray, limit: FloatArray, outside: bool
    ) -> BoolArray:
        """Whether samples (k,) so far away are of an `owner` that may come within a limit (k,)."""
        # A sample that the disk touches must not be lost to rounding.
        allowance, half = limit * (1 + 1e-9), self.half.take(owner)
        least = np.maximum(away - self.bulge.take(owner), 0.0) if self.most_bulge else away
        if outside:
            return np.asarray(least <= allowance + half)
        return np.asarray(least * least <= allowance * allowance + half * half)

    def _nearest_sample(
        self, away: FloatArray, index: IntArray, excluded: IntArray | None
    ) -> FloatArray:
        """Least distances (n,) of samples (n, k), nearest first, of sites that are not excluded."""
        if excluded is None:
            return away[:, 0]
        owner, allowed = self.site.take(index, mode="clip"), np.ones(index.shape, dtype=bool)
        for column in excluded.T:
            allowed &= owner != column[:, None]
        return np.asarray(np.where(allowed, away, np.inf).min(axis=1))

    # -- maximal disks ----------------------------------------------------------------------------

    def maximal_disks(
        self,
        tangents: Tangents,
        curvature: FloatArray,
        excluded: IntArray,
        slack: float = 1e-12,
        rivals: Rivals | None = None,
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
        rivals : Rivals, optional
            Sites that are known to be near, which spares part of the search.
        """
        with np.errstate(divide="ignore"):
            limit = np.where(curvature > 0, 1 / np.maximum(curvature, 1e-300), np.inf)
        limit = np.minimum(limit, 2 * self.sites.size)
        count = len(tangents)
        best, partner, parameter = self._among(tangents, excluded, rivals)
        radius, touched = self._first_radius(tangents, np.minimum(limit, best), excluded)
        seen = self._walk(tangents, excluded, touched, best, partner, parameter)
        radius = np.minimum(radius, best)
        active = np.arange(count)
        neighbours = np.full(count, self._first_neighbours(count))
        rounding = 1e-13 * self.sites.size
        restarted = np.zeros(count, dtype=bool)
        while len(active):
            wanted = int(neighbours[active].min())
            rows = active[neighbours[active] == wanted]
            reach, own = radius.take(rows), excluded.take(rows, axis=0)
            normal = tangents.normal.take(rows, axis=0)
            centre = tangents.position.take(rows, axis=0) + reach[:, None] * normal
            found = self._candidates(centre, reach, wanted, own, rounding)
            key = rows.take(found.row) * len(self.sites) + found.site
            new = (~_among(key, seen)).nonzero()[0]
            row, target = rows.take(found.row.take(new)), found.site.take(new)
            where, rho = contact(self.sites, tangents.take(row), target, found.hint.take(new))
            first, index = _minimum_by_row(row, rho)
            better = (rho[index] < best[first]).nonzero()[0]
            first, index = first[better], index[better]
            best[first], partner[first], parameter[first] = (
                rho[index], target[index], where[index],
            )  # fmt: skip
            # A site is only worth another round when it moves the disk.
            shrunk = np.zeros(count, dtype=bool)
            shrunk[first[rho[index] < radius[first] * (1 - 1e-14)]] = True
            radius[first] = np.minimum(radius[first], rho[index])
            changed = shrunk[rows]
            # Contacts that are not where the samples told: start over from the largest disk.
            lost = ~changed & found.complete & (best[rows] > 1.001 * radius[rows])
            lost &= ~restarted[rows]
            restarted[rows[lost]] = True
            radius[rows[lost]] = np.minimum(best[rows[lost]], limit[rows[lost]])
            neighbours[rows[~changed & ~found.complete]] *= 2
            # Disks that are tangent at one point are nested: what reaches into a smaller one
            # reached into the one that was looked at.
            done = np.zeros(count, dtype=bool)
            done[rows[found.complete & ~lost & ~(found.partial & changed)]] = True
            active = active[~done[active]]
            if len(active):
                seen = np.concatenate([seen, key.take(new)])
                seen = seen[~done.take(seen // len(self.sites))]
        self._slide(tangents, excluded, best, partner, parameter)
        bounded = best > limit * (1 + 1e-11)
        partner[bounded] = -1
        osculating = best >= limit * (1 - slack)
        return Contacts(np.minimum(best, limit), partner, parameter, osculating)

    def _among(
        self, tangents: Tangents, excluded: IntArray, rivals: Rivals | None
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Smallest disks that touch rivals alone: radius, partner and its parameter, (n,) each."""
        count = len(tangents)
        best, partner = np.full(count, np.inf), np.full(count, -1, dtype=np.int64)
        parameter = np.full(count, np.nan)
        if rivals is None:
            return best, partner, parameter
        # Contacts with spirals cost more than they spare.
        known = (rivals.site >= 0) & (self.sites.kind[rivals.site] != SiteKind.SPIRAL)
        for column in excluded.T:
            known &= rivals.site != column[:, None]
        row, place = np.nonzero(known)
        if len(row):
            target, hint = rivals.site[row, place], rivals.hint[row, place]
            where, rho = contact(self.sites, tangents.take(row), target, hint)
            first, index = _minimum_by_row(row, rho)
            best[first] = rho[index]
            touched = first[np.isfinite(rho[index])]
            index = index[np.isfinite(rho[index])]
            partner[touched], parameter[touched] = target[index], where[index]
        return best, partner, parameter

    def _walk(
        self,
        tangents: Tangents,
        excluded: IntArray,
        touched: IntArray,
        best: FloatArray,
        partner: IntArray,
        parameter: FloatArray,
    ) -> IntArray:
        """Exact disks from the sites of the samples `touched`, and on along the boundary as long as
        contacts lie at the ends of sites. In place.

        Mostly these are the disks that are looked for. Also keys of the contacts tried.
        """
        sites, count = self.sites, len(self.sites)
        rows = (touched >= 0).nonzero()[0]
        site, hint = self.site[touched[rows]], self.parameter[touched[rows]]
        tried = [np.zeros(0, dtype=np.int64)]
        step = np.zeros(len(rows), dtype=np.int64)
        for _ in range(_STEPS):
            # Contacts with spirals cost more than they spare.
            use = (sites.kind[site] != SiteKind.SPIRAL).nonzero()[0]
            rows, site, hint, step = rows[use], site[use], hint[use], step[use]
            if not len(rows):
                break
            tried.append(rows * count + site)
            where, rho = contact(sites, tangents.take(rows), site, hint)
            better = (rho < best[rows]).nonzero()[0]
            chosen = rows[better]
            best[chosen], partner[chosen], parameter[chosen] = (
                rho[better], site[better], where[better],
            )  # fmt: skip
            low, high = where <= sites.low[site], where >= sites.high[site]
            on = (low & (step <= 0)) | (high & (step >= 0))
            target = np.where(low, sites.preceding[site], sites.following[site])
            on &= ~_among_columns(target, excluded.take(rows, axis=0))
            use = on.nonzero()[0]
            rows, site = rows[use], target[use]
            step = np.where(low[use], -1, 1)
            hint = np.where(low[use], sites.high[site], sites.low[site])
        return np.concatenate(tried)

    def _slide(
        self,
        tangents: Tangents,
        excluded: IntArray,
        best: FloatArray,
        partner: IntArray,
        parameter: FloatArray,
    ) -> None:
        """Move contacts at smooth junctions to the far side where they lie beyond. In place.

        Radii are flat about a contact: they do not tell on which side of a junction it lies when
        it is near, the slope there does.
        """
        sites = self.sites
        rows = (partner >= 0).nonzero()[0]
        for _ in range(4):
            site = partner[rows]
            low, high = parameter[rows] <= sites.low[site], parameter[rows] >= sites.high[site]
            target = np.where(low, sites.preceding[site], sites.following[site])
            corner = np.where(low, sites.corner_after[target], sites.corner_after[site])
            point = (sites.kind[target] == SiteKind.POINT) | (sites.kind[site] == SiteKind.POINT)
            moves = (low | high) & ~corner & ~point
            moves &= ~_among_columns(target, excluded.take(rows, axis=0))
            rows, target, low = rows[moves], target[moves], low[moves]
            if not len(rows):
                break
            end = np.where(low, sites.high[target], sites.low[target])
            where, rho = contact(sites, tangents.take(rows), target, end)
            beyond = (rho <= best[rows] * (1 + 1e-10)) & (where != end)
            rows = rows[beyond]
            best[rows], partner[rows] = rho[beyond], target[beyond]
            parameter[rows] = where[beyond]

    def _first_radius(
        self, tangents: Tangents, limit: FloatArray, excluded: IntArray
    ) -> tuple[FloatArray, IntArray]:
        """Radii of disks that hold no sample, but for a percent or so, and the samples that they
        touch, -1 where that is none.

        Of many points every eighth comes first, and of very many every eighth of these: what it
        touches bounds the disks beside it, and its radius tells about where to begin.
        """
        radius = limit.copy()
        count = len(radius)
        touched = np.full(count, -1, dtype=np.int64)
        strides = [_STRIDE**level for level in (2, 1) if count >= _STRIDED * _STRIDE ** (level - 1)]
        before = 0
        for stride in (*strides, 1):
            rows = np.arange(0, count, stride)
            guess = np.full(len(rows), np.inf)
            if before:
                rows = rows[rows % before > 0]
                guess = self._bounded(tangents, excluded, rows, before, radius, touched)
            position = tangents.position.take(rows, axis=0)
            normal = tangents.normal.take(rows, axis=0)
            start = np.minimum(radius[rows], guess)
            found, shown = self._shrink(position, normal, start)
            # nothing in a disk smaller than it need be: from the largest again
            again = ((shown < 0) & (guess < radius[rows])).nonzero()[0]
            if len(again):
                found[again], shown[again] = self._shrink(
                    position[again], normal[again], radius[rows[again]]
                )
            radius[rows], touched[rows] = found, np.where(shown >= 0, shown, touched[rows])
            before = stride
        self._descend(tangents, excluded, radius, touched)
        return radius, touched

    def _bounded(
        self,
        tangents: Tangents,
        excluded: IntArray,
        rows: IntArray,
        stride: int,
        radius: FloatArray,
        touched: IntArray,
    ) -> FloatArray:
        """Bound the disks of rows by what those at a stride beside them touch. In place.

        Also radii, (n,) mm, to begin with: somewhat larger than those beside.
        """
        position, normal = tangents.position.take(rows, axis=0), tangents.normal.take(rows, axis=0)
        own = excluded.take(rows, axis=0)
        lower = rows // stride * stride
        upper = np.where(lower + stride < len(radius), lower + stride, lower)
        guess = _SOMEWHAT * np.maximum(radius[lower], radius[upper])
        best, sample = radius[rows], touched[rows]
        for shown in (touched[lower], touched[upper]):
            rho = disk_through(self.point.take(shown, axis=0) - position, normal)
            # Samples of a point's own sites tell nothing.
            known = (shown >= 0) & (rho < best) & ~_among_columns(self.site.take(shown), own)
            best, sample = np.where(known, rho, best), np.where(known, shown, sample)
        radius[rows], touched[rows] = best, sample
        return guess

    def _descend(
        self, tangents: Tangents, excluded: IntArray, radius: FloatArray, touched: IntArray
    ) -> None:
        """Go on to samples along the boundary as long as disks become smaller. In place.

        Where a disk all but clings to the boundary, samples far apart are a percent nearer or not.
        """
        step = len(self.point) // _CLINGING
        rows = (touched >= 0).nonzero()[0]
        position, normal = tangents.position.take(rows, axis=0), tangents.normal.take(rows, axis=0)
        best, sample, own = radius.take(rows), touched.take(rows), excluded.take(rows, axis=0)
        while step:
            for shift in (-step, step):
                other = np.minimum(np.maximum(sample + shift, 0), len(self.point) - 1)
                rho = disk_through(self.point.take(other, axis=0) - position, normal)
                better = (rho < best).nonzero()[0]
                # Samples of a point's own sites tell nothing.
                site = self.site.take(other.take(better))
                better = better[~_among_columns(site, own.take(better, axis=0))]
                best[better], sample[better] = rho.take(better), other.take(better)
            step //= 2
        radius[rows], touched[rows] = best, sample

    def _shrink(
        self, position: FloatArray, normal: FloatArray, radius: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Shrink the disks to touch samples; and the sample that each touches, or -1."""
        count = len(radius)
        if count * len(self.point) <= _PAIRS:
            return self._shrink_few(position, normal, radius)
        radius, active = radius.copy(), np.arange(count)
        touched, now = np.full(count, -1, dtype=np.int64), radius
        for _ in range(40):
            away, index, _ = self._query(position + now[:, None] * normal, 1, _ROUGH, now)
            index = index[:, 0]
            rho = disk_through(self.point.take(index, axis=0) - position, normal)
            shrunk = ((away[:, 0] < now * (1 - 1e-7)) & (rho < now)).nonzero()[0]
            active, before, now = active.take(shrunk), now.take(shrunk), rho.take(shrunk)
            radius[active], touched[active] = now, index.take(shrunk)
            stay = (now <= (1 - _ROUGH) * before).nonzero()[0]
            if not len(stay):
                break
            shrunk, active, now = shrunk.take(stay), active.take(stay), now.take(stay)
            position, normal = position.take(shrunk, axis=0), normal.take(shrunk, axis=0)
        return radius, touched

    def _shrink_few(
        self, position: FloatArray, normal: FloatArray, radius: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """The same by looking at all samples."""
        x = self.point[:, 0] - position[:, :1]
        y = self.point[:, 1] - position[:, 1:]
        height = x * normal[:, :1] + y * normal[:, 1:]
        # How far inside samples are, from the difference of two squares.
        excess = x * x + y * y
        inside = excess - 2 * radius[:, None] * height < -2e-7 * (radius * radius)[:, None]
        rho = np.full_like(excess, np.inf)
        np.divide(excess, 2 * height, out=rho, where=inside)
        touched = rho.argmin(axis=1)
        least = rho[np.arange(len(rho)), touched]
        return np.minimum(radius, least), np.where(least < radius, touched, -1)


def _among(number: IntArray, others: IntArray) -> BoolArray:
    """Whether numbers (n,) are among others, in any order."""
    if not len(others):
        return np.zeros(len(number), dtype=bool)
    others = np.sort(others)
    place = others.searchsorted(number)
    return np.asarray(others.take(place, mode="clip") == number)


def _among_columns(site: IntArray, columns: IntArray) -> BoolArray:
    """Whether sites (n,) are among those of their rows (n, e)."""
    result: BoolArray = site == columns[:, 0]
    for other in columns.T[1:]:
        result |= site == other
    return result


def _minimum_by_row(row: IntArray, value: FloatArray) -> tuple[IntArray, IntArray]:
    """Distinct rows and the index of the (first) smallest value in each; `row` is sorted."""
    if not len(row):
        return row, row
    start = np.concatenate([[True], row[1:] != row[:-1]])
    head = start.nonzero()[0]
    least = np.minimum.reduceat(value, head)
    place = (value == least.take(np.cumsum(start) - 1)).nonzero()[0]
    # Of equal values the first: rows are in order.
    owner = row.take(place)
    first = np.concatenate([[True], owner[1:] != owner[:-1]])
    return owner[first], place[first]


def _extents(sites: Sites) -> tuple[FloatArray, FloatArray]:
    """Length and total turn of every site (fans: 0, 0)."""
    length = np.zeros(len(sites))
    turn = np.zeros(len(sites))
    line = sites.kind == SiteKind.LINE
    length[line] = np.hypot(*sites.extent[line].T)
    arc = sites.kind == SiteKind.ARC
    turn[arc] = np.abs(sites.extent[arc, 1])
    length[arc] = turn[arc] * sites.radius[arc]
    spiral = (sites.kind == SiteKind.SPIRAL).nonzero()[0]
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
