"""Pieces of the axis: the boundary on both of their sides, their polynomials, exact disks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grassfire.geometry.chebyshev import nodes, resampling
from grassfire.medial.columns import Columns
from grassfire.medial.contact import Tangents, contact
from grassfire.medial.graph import Graph
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, SiteKind, Sites

DEGREES = (1, 2, 3, 4, 6, 12)
"""Nested: the Chebyshev points of each are among those of the last."""

TOP = DEGREES[-1]
NODES = nodes(TOP)

FEET_APART = 0.1
"""Share of the radius below which the feet of a disk are too close for derivatives to tell them."""

_PREFERENCE = np.zeros((4, 4), dtype=np.int64)
_PREFERENCE[SiteKind.LINE] = 3
_PREFERENCE[SiteKind.SPIRAL] = 2
_PREFERENCE[SiteKind.ARC] = 1
# The bisector of a curve and a line is regular along the curve, which also has the closed form.
_PREFERENCE[SiteKind.SPIRAL, SiteKind.LINE] = 4


@dataclass(frozen=True)
class Span(Columns):
    """Pieces of edges seen from both sides; one row a polynomial edge.

    Along row k the parameter of `site` runs from `start` to `end` (increasing), that of `partner`
    from `facing_start` to `facing_end` (decreasing). The (k, 3) disks (x, y, r) at both ends are
    known, and (A) may be 0 / 0 there; `far_first` and `far_last` are the same disks as found from
    the partner, which differ where the boundary has a kink too flat for a corner.

    The parameters run evenly with the fraction of the piece, but between two corners: `angle_start`
    and `angle_end` are hyperbolic angles there (see `grassfire.medial.hyperbolas`), else both 0.
    """

    site: IntArray
    partner: IntArray
    start: FloatArray
    end: FloatArray
    facing_start: FloatArray
    facing_end: FloatArray
    first: IntArray
    last: IntArray
    edge: IntArray
    first_disk: FloatArray
    last_disk: FloatArray
    far_first: FloatArray
    far_last: FloatArray
    angle_start: FloatArray
    angle_end: FloatArray

    def __len__(self) -> int:
        return len(self.site)

    @cached_property
    def hyperbolic(self) -> IntArray:
        """Rows between two corners that have hyperbolic angles."""
        return np.asarray((self.angle_start != self.angle_end).nonzero()[0])

    def share(self, fraction: FloatArray) -> FloatArray:
        """(k, n) shares of the ranges of both parameters run through at fractions (n,) or (k, n).

        Between two corners the angle of the normal is the Gudermannian of the hyperbolic angle.
        """
        rows = self.hyperbolic
        if not len(rows):
            return np.asarray(fraction)
        result = np.array(np.broadcast_to(fraction, (len(self), np.shape(fraction)[-1])))
        first, last = self.angle_start[rows, None], self.angle_end[rows, None]
        turned = [np.arctan(np.sinh(first + (last - first) * at)) for at in (0, result[rows], 1)]
        result[rows] = (turned[1] - turned[0]) / (turned[2] - turned[0])
        return result

    def parameter(self, fraction: FloatArray) -> FloatArray:
        """(k, n) parameters of the sites at fractions (n,) or (k, n)."""
        return np.asarray(
            self.start[:, None] + (self.end - self.start)[:, None] * self.share(fraction)
        )

    def at(self, row: IntArray, fraction: FloatArray) -> FloatArray:
        """(n,) parameters of the sites of pieces `row` at fractions (n,)."""
        return self.take(row).parameter(fraction[:, None])[:, 0]

    def swapped(self) -> Span:
        """The same pieces parametrised by the other side."""
        return Span(
            self.partner, self.site, self.facing_end, self.facing_start, self.end, self.start,
            self.last, self.first, self.edge,
            self.far_last, self.far_first, self.last_disk, self.first_disk,
            self.angle_end, self.angle_start,
        )  # fmt: skip


@dataclass(frozen=True)
class Fit:
    """Polynomial pieces of the axis in Bezier form.

    Attributes
    ----------
    span : Span
        The k pieces as seen from both sides.
    control : (total, 3) float array
        Bezier coefficients (x, y, r) of all pieces, relative to the origin of the sites, mm.
    offset : (k + 1,) int array
        Row k owns control[offset[k] : offset[k + 1]].
    error : (k,) float array
        Largest deviation of a disk from the exact one of the same parameter, mm.
    facing : (k, 13) float array
        Parameters of the contacts on the partner at the Chebyshev points of degree 12. See
        `contacts` for other places.
    exact : (k,) bool array
        Whether the piece is a line or a parabola, because of what its sites are.
    vertex_centre, vertex_radius : (v, 2) and (v,) float arrays
        Vertices of the graph, then the joints that were added.
    """

    span: Span
    control: FloatArray
    offset: IntArray
    error: FloatArray
    facing: FloatArray
    exact: BoolArray
    vertex_centre: FloatArray
    vertex_radius: FloatArray

    @cached_property
    def degree(self) -> IntArray:
        """(k,) polynomial degrees."""
        return np.asarray(np.diff(self.offset) - 1)

    def contacts(self, row: IntArray, fraction: FloatArray, among: FloatArray) -> FloatArray:
        """(n,) contacts on the partners of pieces `row` at fractions (n,), which are all `among`
        few, given in order; interpolated."""
        basis = resampling(TOP, among)
        table = basis.take(np.searchsorted(among, fraction), axis=0)
        result = np.einsum("ij,ij->i", table, self.facing.take(row, axis=0))
        span = self.span
        rows = (span.angle_start[row] != span.angle_end[row]).nonzero()[0]
        if len(rows):
            part = span.take(row[rows])
            share = part.share(fraction[rows, None])[:, 0]
            result[rows] = part.facing_start + (part.facing_end - part.facing_start) * share
        return np.asarray(result)

    def tables(self) -> list[tuple[int, IntArray, FloatArray]]:
        """Pieces grouped by degree: (degree, rows, (n, degree + 1, 3) coefficients)."""
        return self._tables

    @cached_property
    def _tables(self) -> list[tuple[int, IntArray, FloatArray]]:
        groups = []
        for degree in np.bincount(self.degree).nonzero()[0]:
            rows = (self.degree == degree).nonzero()[0]
            table = self.control[self.offset[rows, None] + np.arange(degree + 1)]
            groups.append((int(degree), rows, table))
        return groups


def graph_spans(graph: Graph, sites: Sites) -> Span:
    """One row an edge, parametrised by the side that gives the lower degree."""
    rows = (graph.mate >= 0).nonzero()[0]
    rows = rows[rows < graph.mate[rows]]
    mate = graph.mate[rows]
    head = np.concatenate([graph.first_centre, graph.first_radius[:, None]], axis=1)
    tail = np.concatenate([graph.last_centre, graph.last_radius[:, None]], axis=1)
    one, two = sites.kind[graph.site[rows]], sites.kind[graph.site[mate]]
    rank, other = _PREFERENCE[one, two], _PREFERENCE[two, one]
    worse = other > rank
    tied = ((one == SiteKind.SPIRAL) & (two == SiteKind.SPIRAL)).nonzero()[0]
    if len(tied):
        first = _least_approach(sites, graph, rows[tied])
        second = _least_approach(sites, graph, mate[tied])
        worse[tied] = second < first * (1 - 1e-6)
    rows, mate = np.where(worse, mate, rows), np.where(worse, rows, mate)
    even = np.zeros(len(rows))
    return Span(
        site=graph.site[rows],
        partner=graph.site[mate],
        start=graph.start[rows],
        end=graph.end[rows],
        facing_start=graph.end[mate],
        facing_end=graph.start[mate],
        first=graph.first[rows],
        last=graph.last[rows],
        edge=rows,
        first_disk=head.take(rows, axis=0),
        last_disk=tail.take(rows, axis=0),
        far_first=tail.take(mate, axis=0),
        far_last=head.take(mate, axis=0),
        angle_start=even,
        angle_end=even,
    )


def _least_approach(sites: Sites, graph: Graph, rows: IntArray) -> FloatArray:
    """Smallest 1 - k r at the ends of intervals: the motion of the axis per boundary length.

    The side with the smaller value is the better parameter: the contact on the other side moves
    slowly against it, where the inverse has the singularity of a square root.
    """
    least = np.full(len(rows), np.inf)
    for parameter, radius in (
        (graph.start[rows], graph.first_radius[rows]),
        (graph.end[rows], graph.last_radius[rows]),
    ):
        _, _, curvature = sites.frame(graph.site[rows], parameter)
        least = np.minimum(least, 1 - curvature * radius)
    return np.asarray(np.maximum(least, 1e-9))


# -- exact disks ----------------------------------------------------------------------------------


def evaluate_span(
    sites: Sites, span: Span, fraction: FloatArray, hint: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Exact disks (k, n, 3) as (x, y, r) and contacts (k, n) at fractions of the spans.

    Parameters
    ----------
    fraction : (n,) or (k, n) float array
        The ends of the pieces give the disks that the spans carry.
    hint : (k, n) float array, optional
        Where on the partner the contacts are expected; linear by default.
    """
    fraction = np.broadcast_to(fraction, (len(span), np.shape(fraction)[-1]))
    if hint is None:
        step = span.facing_end - span.facing_start
        hint = span.facing_start[:, None] + step[:, None] * span.share(fraction)
    width, count = fraction.shape[1], fraction.size
    at_end = ((fraction == 0) | (fraction == 1)).ravel()
    inner = np.arange(count) if not at_end.any() else (~at_end).nonzero()[0]
    row = inner // width
    site, parameter = span.site.take(row), span.parameter(fraction).ravel().take(inner)
    position, normal = sites.tangents(site, parameter)
    tangents = Tangents(position, normal, site, parameter)
    hints = np.broadcast_to(hint, fraction.shape).ravel().take(inner)
    where, radius = contact(sites, tangents, span.partner.take(row), hints)
    disks, facing = np.empty((count, 3)), np.empty(count)
    facing[inner], disks[inner, 2] = where, radius
    with np.errstate(invalid="ignore"):
        disks[inner, :2] = position + radius[:, None] * normal
    if len(inner) < count:
        for end, disk, known in (
            (0.0, span.first_disk, span.facing_start),
            (1.0, span.last_disk, span.facing_end),
        ):
            place = (fraction == end).ravel().nonzero()[0]
            disks[place], facing[place] = disk[place // width], known[place // width]
    return disks.reshape(-1, width, 3), facing.reshape(-1, width)


def motion(
    sites: Sites, site: IntArray, parameter: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """How the centre of a maximal disk moves across its normal, curvatures, and speeds, (n,) each,
    and boundary points (n, 2).

    The centre is c = p + r n with n' = -k p', so that dc = (1 - k r) dp + n dr: per unit of
    parameter |p'| (1 - k r), and r times the turn of the normal at a reflex corner. The speed is
    |p'|, or that of the end of the normal at the radius in a fan.
    """
    position, _, curvature, speed = sites.moving_frame(site, parameter)
    point = (sites.kind[site] == SiteKind.POINT).nonzero()[0]
    moved = speed * (1 - np.where(np.isfinite(curvature), curvature, 0.0) * radius)
    speed[point] = np.abs(sites.extent[site[point], 1]) * radius[point]
    moved[point] = speed[point]
    return moved, curvature, speed, position
