"""The medial axis transform of a region: graph, Bezier edges, certificate and queries."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from grassfire import tolerance as default
from grassfire.errors import GeometryError
from grassfire.geometry import Bezier, Region
from grassfire.geometry.chebyshev import bernstein
from grassfire.medial.build import build_sites
from grassfire.medial.certificate import Certificate, certify
from grassfire.medial.edges import Fit, Span, fit_edges
from grassfire.medial.graph import Graph, build_graph
from grassfire.medial.offset import OffsetNode, offset_tree
from grassfire.medial.search import BoundarySearch
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, SiteKind, Sites
from grassfire.medial.topology import Topology

_ATTEMPTS = (
    (1, 1.0, 0.0, 1.0),
    (4, 1.0, 0.0, 10.0),
    (1, 1.0, 1.0, 100.0),
    (2, 3.0, 1.0, 1.0),
    (16, 1.0, 1.0, 10.0),
)
"""Density of the samples, factor on the smooth angle, least fan as a share of that angle, factor
on the length below which two boundary points are one."""


@dataclass(frozen=True)
class Edge:
    """A polynomial edge: vertices, (n + 1, 2) control points and (n + 1,) radii, mm."""

    start: int
    end: int
    control_points: FloatArray
    radius: FloatArray


@dataclass(frozen=True)
class MedialAxis:
    """Medial axis transform of a region, certified.

    Made by `medial_axis`. Coordinates of the public attributes are those of the region.
    """

    region: Region
    sites: Sites
    beziers: tuple[Bezier, ...]
    search: BoundarySearch
    graph: Graph
    fit: Fit
    pruned: BoolArray
    certificate: Certificate
    tolerance: float

    @property
    def span(self) -> Span:
        """Polynomial pieces seen from both sides of the boundary."""
        return self.fit.span

    # -- graph ------------------------------------------------------------------------------------

    @cached_property
    def _kept(self) -> tuple[IntArray, IntArray]:
        """Vertices that belong to a kept edge (or are the whole axis), and their new numbers."""
        kept = ~self.pruned
        count = len(self.fit.vertex_radius)
        if kept.any():
            used = np.unique(np.concatenate([self.span.first[kept], self.span.last[kept]]))
        else:
            used = np.flatnonzero(np.arange(count) == np.argmax(self.fit.vertex_radius))
        number = np.full(count, -1, dtype=np.int64)
        number[used] = np.arange(len(used))
        return used, number

    @property
    def vertex_point(self) -> FloatArray:
        """(n, 2) vertices, mm."""
        return np.asarray(self.fit.vertex_centre[self._kept[0]] + self.sites.origin)

    @property
    def vertex_radius(self) -> FloatArray:
        """(n,) radii at the vertices, mm."""
        return np.asarray(self.fit.vertex_radius[self._kept[0]])

    @property
    def vertex_kind(self) -> list[str]:
        """ "corner", "end", "joint" or "branch" for each vertex."""
        _, number = self._kept
        kept = ~self.pruned
        ends = number[np.concatenate([self.span.first[kept], self.span.last[kept]])]
        degree = np.bincount(ends, minlength=len(self.vertex_radius))
        names = np.array(["end", "end", "joint", "branch"])[np.minimum(degree, 3)]
        corner = (self.vertex_radius <= 1e-9 * self.sites.size) & (degree <= 1)
        return [str(name) for name in np.where(corner, "corner", names)]

    @cached_property
    def edges(self) -> tuple[Edge, ...]:
        """Kept edges, in the order of the boundary."""
        _, number = self._kept
        result = []
        for row in np.flatnonzero(~self.pruned):
            first, last = self.span.first[row], self.span.last[row]
            table = self.fit.coefficients[row].copy()
            # Nearly parallel contacts leave an end open along the axis; the vertex decides.
            for index, vertex in ((0, first), (-1, last)):
                table[index, :2] = self.fit.vertex_centre[vertex]
                table[index, 2] = self.fit.vertex_radius[vertex]
            points = table[:, :2] + self.sites.origin
            result.append(Edge(int(number[first]), int(number[last]), points, table[:, 2]))
        return tuple(result)

    # -- queries ----------------------------------------------------------------------------------

    def clearance(self, points: FloatArray) -> FloatArray:
        """Exact distance of points to the boundary, negative outside the region.

        Parameters
        ----------
        points : (n, 2) float array

        Returns
        -------
        (n,) float array, mm
        """
        sites = self.sites
        local = np.asarray(points, dtype=np.float64).reshape(-1, 2) - sites.origin
        distance, site, parameter = self.search.nearest(local)
        position, normal, _ = sites.frame(site, parameter)
        inside = np.einsum("ij,ij->i", local - position, normal) >= 0
        low, high = parameter <= sites.low[site], parameter >= sites.high[site]
        # The nearest point is a convex corner only from outside, a reflex one only from inside.
        convex = (high & sites.corner_after[site]) | (
            low & sites.corner_after[sites.preceding[site]]
        )
        point = sites.kind == SiteKind.POINT
        reflex = point[site] | (high & point[sites.following[site]])
        reflex |= low & point[sites.preceding[site]]
        inside = np.where(convex, distance == 0, inside | reflex)
        return np.where(inside, distance, -distance)

    @cached_property
    def critical(self) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Interior extrema of r along the pieces: row, fraction, (k, 3) disk, sign of curvature.

        The sign is -1 for maxima and +1 for minima (necks).
        """
        fraction = np.linspace(0.0, 1.0, 25)
        rows: list[IntArray] = []
        where: list[FloatArray] = []
        signs: list[FloatArray] = []
        for degree, members, table in self.by_degree:
            if degree < 2:
                continue
            slope = degree * np.diff(table[:, :, 2], axis=1)
            scale = np.abs(slope).max(axis=1)
            values = slope @ bernstein(degree - 1, fraction).T
            values[np.abs(values) <= 1e-12 * scale[:, None]] = 0.0
            # A sample right at an extremum (symmetric pieces have one at 1/2) takes the sign of
            # the last one before it that has a sign: it would hide the change otherwise.
            signed = np.where(values != 0, np.arange(len(fraction)), 0)
            values = np.take_along_axis(values, np.maximum.accumulate(signed, axis=1), axis=1)
            steep = scale > 1e-12 * self.sites.size
            change = (values[:, :-1] * values[:, 1:] < 0) & steep[:, None]
            row, column = np.nonzero(change)
            left, right = fraction[column], fraction[column + 1]
            sign = np.sign(values[row, column])
            for _ in range(50):
                middle = 0.5 * (left + right)
                basis = bernstein(degree - 1, middle)
                same = np.sign(np.einsum("ij,ij->i", basis, slope[row])) == sign
                left, right = np.where(same, middle, left), np.where(same, right, middle)
            rows.append(members[row])
            where.append(0.5 * (left + right))
            signs.append(-sign)
        if not rows:
            return np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 3)), np.zeros(0)
        row, place = np.concatenate(rows), np.concatenate(where)
        # At smooth ends r' is 0 by nature and changes sign by rounding.
        inner = np.flatnonzero((place > 1e-6) & (place < 1 - 1e-6))
        row, place, sign = row[inner], place[inner], np.concatenate(signs)[inner]
        order = np.lexsort((place, row))
        row, place = row[order], place[order]
        return row, place, self.disks(row, place), sign[order]

    @cached_property
    def by_degree(self) -> list[tuple[int, IntArray, FloatArray]]:
        """Pieces grouped by degree: (degree, rows, (k, degree + 1, 3) coefficients)."""
        groups = []
        for degree in np.unique(self.fit.degree):
            members = np.flatnonzero(self.fit.degree == degree)
            groups.append(
                (int(degree), members, np.stack([self.fit.coefficients[m] for m in members]))
            )
        return groups

    def disks(self, row: IntArray, fraction: FloatArray) -> FloatArray:
        """(k, 3) disks (x, y, r) of pieces `row` at `fraction`, relative to the sites' origin."""
        result = np.zeros((len(row), 3))
        degree = self.fit.degree[row]
        for value in np.unique(degree):
            members = np.flatnonzero(degree == value)
            basis = bernstein(int(value), fraction[members])
            table = np.stack([self.fit.coefficients[k] for k in row[members]])
            result[members] = np.einsum("ij,ijk->ik", basis, table)
        return result

    def largest_disk(self) -> tuple[FloatArray, float]:
        """Centre and radius of a largest inscribed disk, mm."""
        _, _, disks, _ = self.critical
        radius = np.concatenate([self.fit.vertex_radius, disks[:, 2]])
        centre = np.concatenate([self.fit.vertex_centre, disks[:, :2]])
        best = int(np.argmax(radius))
        return np.asarray(centre[best] + self.sites.origin), float(radius[best])

    def narrowest_neck(self) -> tuple[FloatArray, float] | None:
        """Axis point and radius where the region is locally narrowest, or None without a neck."""
        _, _, disks, sign = self.critical
        centre, radius = disks[sign > 0, :2], disks[sign > 0, 2]
        vertex, value = self._neck_vertices()
        centre, radius = np.concatenate([centre, vertex]), np.concatenate([radius, value])
        if not len(radius):
            return None
        best = int(np.argmin(radius))
        return np.asarray(centre[best] + self.sites.origin), float(radius[best])

    def _neck_vertices(self) -> tuple[FloatArray, FloatArray]:
        """Vertices of degree two or more from which r rises (or stays) along every edge."""
        count = len(self.fit.vertex_radius)
        lowest = np.full(count, np.inf)
        highest = np.full(count, -np.inf)
        degree = np.zeros(count, dtype=np.int64)
        rows = np.arange(len(self.span.site))
        for vertex, fraction in ((self.span.first, 0.02), (self.span.last, 0.98)):
            near = self.disks(rows, np.full(len(rows), fraction))[:, 2]
            rise = near - self.fit.vertex_radius[vertex]
            np.minimum.at(lowest, vertex, rise)
            np.maximum.at(highest, vertex, rise)
            np.add.at(degree, vertex, 1)
        slack = 1e-12 * self.sites.size
        neck = (degree >= 2) & (lowest >= -slack) & (highest > slack)
        return self.fit.vertex_centre[neck], self.fit.vertex_radius[neck]

    def offset_tree(self, distances: FloatArray) -> tuple[OffsetNode, ...]:
        """Trimmed offsets at ascending distances, as a tree of connected components.

        See `grassfire.medial.offset.offset_tree`.
        """
        return offset_tree(self, np.asarray(distances, dtype=np.float64))

    # -- output -----------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """The region's entry of `mat --json`."""
        points, radii = self.vertex_point, self.vertex_radius
        return {
            "area": float(self.region.area),
            "holes": len(self.region.islands),
            "vertices": [
                {"x": float(point[0]), "y": float(point[1]), "r": float(radius), "kind": kind}
                for point, radius, kind in zip(points, radii, self.vertex_kind, strict=True)
            ],
            "edges": [
                {
                    "start": edge.start,
                    "end": edge.end,
                    "control_points": edge.control_points.tolist(),
                    "radius": edge.radius.tolist(),
                }
                for edge in self.edges
            ],
            "certificate": self.certificate.to_dict(),
        }


def medial_axis(
    region: Region,
    tolerance: float = default.MEDIAL,
    angular_tolerance: float = default.ANGULAR,
) -> MedialAxis:
    """Exact medial axis transform of a region by offset self-intersections (Dorado 2009).

    Parameters
    ----------
    region : Region
        Lines, arcs, elliptical arcs, Beziers and B-splines, corners and islands included.
    tolerance : float
        Largest deviation of the polynomial edges from the exact disks, mm.
    angular_tolerance : float
        Convex corners that turn by less get no branch of their own, radians.

    Raises
    ------
    GeometryError
        When the result cannot be certified, with the place.
    """
    if not tolerance > 0:
        raise GeometryError("the tolerance of the medial axis must be above 0")
    smooth_angle = _smooth_angle(region, tolerance, angular_tolerance)
    last: GeometryError | None = None
    # Whatever the samples missed breaks the pairing or the certificate: look again, closer. Turns
    # between smooth and sharp that rounding cannot resolve are then taken as smooth.
    for factor, widening, least_fan, blur in _ATTEMPTS:
        turn = widening * smooth_angle
        try:
            sites, beziers = build_sites(region, turn, max(least_fan * turn, 1e-9))
            search = BoundarySearch(sites, max(256, 2 * len(sites)) * factor)
            topology = Topology(sites, search, blur * _rounding(region, sites), turn)
            graph = build_graph(topology)
            accuracy = max(0.05 * tolerance, min(0.5 * tolerance, 4e-12 * sites.size))
            fit = fit_edges(sites, graph, accuracy, max(0.5 * tolerance, 3e-8))
            certificate = certify(region, sites, search, graph, fit, tolerance)
        except GeometryError as error:
            last = last or error
            continue
        pruned = _pruned(sites, graph, fit, angular_tolerance)
        return MedialAxis(
            region, sites, beziers, search, graph, fit, pruned, certificate, tolerance
        )
    assert last is not None
    raise last


def _rounding(region: Region, sites: Sites) -> float:
    """Length that the rounding of coordinates makes of a point, mm."""
    return 1e-11 * sites.size + 1e-14 * float(np.max(np.abs(region.bounds())))


def _smooth_angle(region: Region, tolerance: float, angular_tolerance: float) -> float:
    """Largest turn whose disks, off by r turn^2 / 2, stay well within tolerance, radians."""
    xmin, ymin, xmax, ymax = region.bounds()
    size = float(np.hypot(xmax - xmin, ymax - ymin))
    return float(min(angular_tolerance, 0.3 * np.sqrt(tolerance / max(size, 1e-300))))


def _pruned(sites: Sites, graph: Graph, fit: Fit, angular_tolerance: float) -> BoolArray:
    """Pieces on branches that run into corners too flat to count."""
    pruned = np.zeros(len(fit.degree), dtype=bool)
    flat = sites.corner_after & (sites.turn_after <= angular_tolerance)
    if not flat.any():
        return pruned
    span = fit.span
    ends = np.concatenate([span.first, span.last])
    degree = np.bincount(ends, minlength=len(fit.vertex_radius))
    at_flat = flat[graph.site] & (graph.end >= sites.high[graph.site])
    queue = list(graph.last[at_flat])
    while queue:
        vertex = queue.pop()
        rows = np.flatnonzero(((span.first == vertex) | (span.last == vertex)) & ~pruned)
        if len(rows) != 1 or degree[vertex] != 1:
            continue
        row = int(rows[0])
        pruned[row] = True
        other = int(span.first[row] + span.last[row] - vertex)
        stop = degree[other] != 2
        degree[other] -= 1
        degree[vertex] -= 1
        if not stop:
            queue.append(other)
    return pruned
