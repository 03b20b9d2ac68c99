"""The medial axis transform of a region: graph, Bezier edges, certificate and queries."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike

from grassfire import tolerance as default
from grassfire.errors import GeometryError
from grassfire.geometry import Bezier, Region
from grassfire.medial import (
    archive,
    extrema,
    network,
    opening,
    parts,
    picture,
    queries,
    recover,
    trimmed,
    ways,
)
from grassfire.medial.build import build_sites
from grassfire.medial.certificate import Certificate, certify
from grassfire.medial.edges import Fit, Span
from grassfire.medial.exchange import MultiPolygonLike, Source, as_region
from grassfire.medial.fitting import fit_edges
from grassfire.medial.graph import Graph, build_graph
from grassfire.medial.offset import OffsetNode, Walker, offset_tree
from grassfire.medial.search import BoundarySearch
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, SiteKind, Sites
from grassfire.medial.topology import Topology

if TYPE_CHECKING:
    import networkx


class _Attempt(NamedTuple):
    """How the axis is computed: what samples miss breaks the pairing or the certificate, turns
    between smooth and sharp and vertices that all but agree may defeat both."""

    density: int
    """Of samples and first nodes."""
    widening: float
    """Factor on the smooth angle."""
    least_fan: float
    """As a share of that angle."""
    blur: float
    """Factor on the length below which two boundary points are one by rounding."""
    merged: float
    """Share of the tolerance within which vertices are one."""


_ATTEMPTS = (
    _Attempt(1, 1.0, 0.0, 1.0, 0.1),
    _Attempt(1, 0.5, 0.0, 1.0, 0.4),
    _Attempt(1, 1.0, 1.0, 100.0, 0.4),
    _Attempt(4, 1.0, 0.0, 10.0, 0.0),
    _Attempt(2, 3.0, 1.0, 1.0, 0.4),
    _Attempt(16, 1.0, 1.0, 10.0, 0.4),
)


class Edge(NamedTuple):
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
    angular_tolerance: float
    seconds: dict[str, float] = field(default_factory=dict, compare=False, repr=False)
    """Wall time of each stage: sites, search, graph, edges, certificate."""

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
        held = np.zeros(count, dtype=bool)
        held[self.span.first[kept]] = held[self.span.last[kept]] = True
        if not kept.any():
            held[np.argmax(self.fit.vertex_radius)] = True
        used = held.nonzero()[0]
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
        rows = np.flatnonzero(~self.pruned)
        starts, ends = number[self.span.first[rows]], number[self.span.last[rows]]
        low, high = self.fit.offset[rows], self.fit.offset[rows + 1]
        # All in one array each: every edge has its own rows of them.
        points = self.fit.control[:, :2] + self.sites.origin
        radii = self.fit.control[:, 2].copy()
        columns = zip(starts.tolist(), ends.tolist(), low.tolist(), high.tolist(), strict=True)
        make = tuple.__new__
        return tuple(
            [
                make(Edge, (start, end, points[one:two], radii[one:two]))
                for start, end, one, two in columns
            ]
        )

    # -- queries ----------------------------------------------------------------------------------

    @cached_property
    def table(self) -> queries.AxisTable:
        """Polynomials of the kept edges."""
        return queries.AxisTable(self)

    @cached_property
    def index(self) -> queries.AxisIndex:
        """All kept edges, prepared for nearest points."""
        return queries.whole_index(self.table)

    @cached_property
    def walker(self) -> Walker:
        """The boundary, prepared for offsets."""
        return Walker(self)

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
        distance, site, parameter = self.search.nearest(local, outside=True)
        position, normal = sites.tangents(site, parameter)
        inside = np.einsum("ij,ij->i", local - position, normal) >= 0
        inside |= sites.kind.take(site) == SiteKind.POINT
        low, high = parameter <= sites.low.take(site), parameter >= sites.high.take(site)
        rows = (low | high).nonzero()[0]
        if len(rows):
            # The nearest point is a convex corner only from outside, a reflex one from inside.
            low, high, end = low[rows], high[rows], site[rows]
            before, after, reflex_before, reflex_after = [flag[end] for flag in sites.ends]
            reflex = (high & reflex_after) | (low & reflex_before)
            convex = (high & after) | (low & before)
            inside[rows] = np.where(convex, distance[rows] == 0, inside[rows] | reflex)
        return np.where(inside, distance, -distance)

    @cached_property
    def critical(self) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Interior extrema of r along the pieces: row, fraction, (k, 3) disk, sign of curvature.

        The sign is -1 for maxima and +1 for minima (necks).
        """
        return extrema.critical(self)

    def disks(self, row: IntArray, fraction: FloatArray) -> FloatArray:
        """(k, 3) disks (x, y, r) of pieces `row` at `fraction`, relative to the sites' origin."""
        return recover.jets(self.fit, row, fraction, orders=0)[0]

    def largest_disk(self) -> tuple[FloatArray, float]:
        """Centre and radius of a largest inscribed disk, mm; see `extrema.largest_disk`."""
        return extrema.largest_disk(self)

    def narrowest_neck(self) -> tuple[FloatArray, float] | None:
        """Axis point and radius where the region is locally narrowest, or None without a neck.

        See `grassfire.medial.extrema.narrowest_neck`.
        """
        return extrema.narrowest_neck(self)

    def offset_tree(self, distances: FloatArray) -> tuple[OffsetNode, ...]:
        """Trimmed offsets at ascending distances, as a tree of connected components.

        See `grassfire.medial.offset.offset_tree`.
        """
        return offset_tree(self, np.asarray(distances, dtype=np.float64))

    def nearest_axis_point(self, points: ArrayLike) -> queries.Nearest:
        """Nearest points of the axis; see `queries.nearest_axis_point`."""
        return queries.nearest_axis_point(self, points)

    def point(self, edge: ArrayLike, fraction: ArrayLike) -> FloatArray:
        """Points (n, 2) at fractions of edges; see `queries.disk`."""
        return queries.disk(self, edge, fraction)[0]

    def radius(self, edge: ArrayLike, fraction: ArrayLike) -> FloatArray:
        """Radii (n,) at fractions of edges; see `queries.disk`."""
        return queries.disk(self, edge, fraction)[1]

    def tangent(self, edge: ArrayLike, fraction: ArrayLike) -> FloatArray:
        """Unit tangents (n, 2) at fractions of edges; see `queries.tangent`."""
        return queries.tangent(self, edge, fraction)

    def separation_angle(self, edge: ArrayLike, fraction: ArrayLike) -> FloatArray:
        """Angles (n,) between the feet of disks; see `queries.separation_angle`."""
        return queries.separation_angle(self, edge, fraction)

    def prune(self, angle: float) -> parts.AxisGraph:
        """The axis cut back to a separation angle; see `parts.prune`."""
        return parts.prune(self, angle)

    def subgraph(self, minimum_radius: float) -> parts.AxisGraph:
        """The part of the axis with r >= `minimum_radius`; see `parts.subgraph`."""
        return parts.subgraph(self, minimum_radius)

    def path(
        self, start: ArrayLike, end: ArrayLike, minimum_clearance: float = 0.0
    ) -> ways.AxisPath:
        """Shortest way along the axis between two points; see `ways.path`."""
        return ways.path(self, start, end, minimum_clearance)

    def trimmed_offset(self, distance: float) -> trimmed.TrimmedOffset:
        """All points with a clearance of `distance`; see `trimmed.trimmed_offset`."""
        return trimmed.trimmed_offset(self, distance)

    def reachable(self, tool_radius: float) -> tuple[Region, ...]:
        """What disks of a radius inside the region cover; see `opening.reachable`."""
        return opening.reachable(self, tool_radius)

    def unreachable(self, tool_radius: float) -> tuple[Region, ...]:
        """What disks of a radius inside the region leave; see `opening.unreachable`."""
        return opening.unreachable(self, tool_radius)

    def recovered_boundary(
        self, samples_per_edge: int = 17
    ) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Edge, fraction, left and right boundary points; see `recover.recover_boundary`."""
        return recover.recover_boundary(self, samples_per_edge)

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

    def to_json(self) -> str:
        """As JSON that `from_json` reads; see `grassfire.medial.archive`."""
        return archive.to_json(self)

    @staticmethod
    def from_json(text: str) -> MedialAxis:
        """The axis that `to_json` wrote, computed and certified anew."""
        return archive.from_json(text)

    def to_networkx(self) -> networkx.MultiGraph[int]:
        """As a NetworkX graph; see `grassfire.medial.network.to_networkx`."""
        return network.to_networkx(self)

    def _repr_svg_(self) -> str:
        """Picture for notebooks; see `grassfire.medial.picture.svg`."""
        return picture.svg(self)

    def __getstate__(self) -> dict[str, Any]:
        """Fields alone: what is derived from them is derived again after unpickling."""
        return {item.name: getattr(self, item.name) for item in fields(self)}


@overload
def medial_axis(
    region: Source, tol: float = default.MEDIAL, angular_tolerance: float = default.ANGULAR
) -> MedialAxis: ...


@overload
def medial_axis(
    region: MultiPolygonLike,
    tol: float = default.MEDIAL,
    angular_tolerance: float = default.ANGULAR,
) -> tuple[MedialAxis, ...]: ...


def medial_axis(
    region: Source | MultiPolygonLike,
    tol: float = default.MEDIAL,
    angular_tolerance: float = default.ANGULAR,
) -> MedialAxis | tuple[MedialAxis, ...]:
    """Exact medial axis transform of a region by offset self-intersections (Dorado 2009).

    Parameters
    ----------
    region : Region, polygon or points
        Lines, arcs, elliptical arcs, Beziers and B-splines, corners and islands included. Also a
        Shapely Polygon, or loops of points: see `grassfire.medial.exchange.as_region`.
    tol : float
        Largest deviation of the polynomial edges from the exact disks, mm.
    angular_tolerance : float
        Convex corners that turn by less get no branch of their own, radians.

    Returns
    -------
    MedialAxis
        For a Shapely MultiPolygon a tuple of them, one a polygon, in its order.

    Raises
    ------
    GeometryError
        When the result cannot be certified, with the place.
    InputError
        When the first argument is no region.
    """
    if not tol > 0:
        raise GeometryError("the tolerance of the medial axis must be above 0")
    given = as_region(region)
    if isinstance(given, tuple):
        return tuple(_certified(member, tol, angular_tolerance) for member in given)
    return _certified(given, tol, angular_tolerance)


def _certified(region: Region, tol: float, angular_tolerance: float) -> MedialAxis:
    """The transform of one region, from the first attempt that can be certified."""
    last: GeometryError | None = None
    for attempt in _ATTEMPTS:
        try:
            return _compute(region, tol, angular_tolerance, attempt)
        except GeometryError as error:
            last = last or error
    assert last is not None
    raise last


def _compute(region: Region, tol: float, angular_tolerance: float, attempt: _Attempt) -> MedialAxis:
    turn = attempt.widening * _smooth_angle(region, tol, angular_tolerance)
    least_fan, merged = max(attempt.least_fan * turn, 1e-9), attempt.merged * tol
    clock = [time.perf_counter()]
    sites, beziers = build_sites(region, turn, least_fan, merged)
    clock.append(time.perf_counter())
    search = BoundarySearch(sites, region.area, attempt.density)
    clock.append(time.perf_counter())
    topology = Topology(
        sites, search, attempt.blur * _rounding(region, sites), turn, attempt.density
    )
    graph = build_graph(topology)
    clock.append(time.perf_counter())
    rounding = 1e-15 * float(np.max(np.abs(region.bounds())))
    accuracy = max(0.05 * tol, min(0.35 * tol, 4e-12 * sites.size)) + rounding
    drawing = max(0.7 * tol, 7e-8, 3e-10 * sites.size)
    fit = _closed(fit_edges(sites, graph, accuracy, drawing, 0.5 * tol))
    clock.append(time.perf_counter())
    certificate = certify(region, sites, search, graph, fit, tol - sites.merged)
    # The boundary that was merged lies that near to the one that was given.
    error = certificate.max_disk_error + sites.merged
    certificate = replace(certificate, max_disk_error=error)
    clock.append(time.perf_counter())
    pruned = _pruned(sites, graph, fit, angular_tolerance)
    stages = ("sites", "search", "graph", "edges", "certificate")
    seconds = dict(zip(stages, np.diff(clock).tolist(), strict=True))
    return MedialAxis(
        region, sites, beziers, search, graph, fit, pruned, certificate, tol, angular_tolerance,
        seconds,
    )  # fmt: skip


def _closed(fit: Fit) -> Fit:
    """The edges from vertex to vertex.

    Nearly parallel contacts leave the end of an edge open along the axis; the vertex decides.
    """
    vertex = np.concatenate([fit.vertex_centre, fit.vertex_radius[:, None]], axis=1)
    control = fit.control.copy()
    control[fit.offset[:-1]] = vertex[fit.span.first]
    control[fit.offset[1:] - 1] = vertex[fit.span.last]
    return replace(fit, control=control)


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
    ends = np.stack([fit.span.first, fit.span.last], axis=1)
    count = len(fit.vertex_radius)
    degree = np.bincount(ends.ravel(), minlength=count)
    joint = degree == 2
    # Of a vertex with one piece left the sum of the numbers of its pieces is the number of that.
    pieces = np.zeros(count, dtype=np.int64)
    np.add.at(pieces, ends, np.arange(len(ends))[:, None])
    tips = np.unique(graph.last[flat[graph.site] & (graph.end >= sites.high[graph.site])])
    while True:
        tips = tips[degree[tips] == 1]
        if not len(tips):
            return pruned
        rows = np.unique(pieces[tips])
        pruned[rows] = True
        np.subtract.at(degree, ends[rows], 1)
        np.subtract.at(pieces, ends[rows], rows[:, None])
        tips = np.unique(ends[rows])
        # a place where branches met ends no branch, however many of them are pruned
        tips = tips[joint[tips]]
