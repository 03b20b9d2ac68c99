"""Edges of the axis in Bezier form, interpolated at Chebyshev points (Dorado 2009, eq. 7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grassfire.errors import GeometryError
from grassfire.medial.graph import Graph
from grassfire.medial.sites import FloatArray, IntArray, SiteKind, Sites

DEGREES = (1, 2, 3, 4, 6, 12)
"""Nested: the Chebyshev points of each are among those of the last."""

_PREFERENCE = {SiteKind.LINE: 0, SiteKind.SPIRAL: 1, SiteKind.ARC: 2, SiteKind.POINT: 3}


@dataclass(frozen=True)
class Span:
    """Pieces of edges seen from both sides; one row a polynomial edge.

    Along row k the parameter of `site` runs from `start` to `end` (increasing), that of `partner`
    from `facing_start` to `facing_end` (decreasing).
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

    def take(self, index: IntArray) -> Span:
        """Rows `index`."""
        return Span(*(getattr(self, name)[index] for name in self.__dataclass_fields__))

    def swapped(self) -> Span:
        """The same pieces parametrised by the other side."""
        return Span(
            self.partner, self.site, self.facing_end, self.facing_start, self.end, self.start,
            self.last, self.first, self.edge,
        )  # fmt: skip


@dataclass(frozen=True)
class Fit:
    """Polynomial pieces: `span` and, per row, degree, Bezier coefficients (x, y, r) and error.

    `vertex_centre` and `vertex_radius` of the graph are extended by the joints that were added.
    """

    span: Span
    degree: IntArray
    coefficients: list[FloatArray]
    error: FloatArray
    vertex_centre: FloatArray
    vertex_radius: FloatArray


def chebyshev_fractions(degree: int) -> FloatArray:
    """(degree + 1,) Chebyshev points of eq. (7) on [0, 1]."""
    return np.asarray(0.5 * (1 - np.cos(np.pi * np.arange(degree + 1) / degree)))


def bernstein_matrix(degree: int, fraction: FloatArray) -> FloatArray:
    """(n, degree + 1) Bernstein polynomials at `fraction`."""
    table = np.ones((len(fraction), 1))
    value = fraction[:, None]
    for _ in range(degree):
        padded = np.zeros((len(fraction), table.shape[1] + 1))
        padded[:, :-1] += (1 - value) * table
        padded[:, 1:] += value * table
        table = padded
    return table


def graph_spans(graph: Graph, sites: Sites) -> Span:
    """One row an edge, parametrised by the side that gives the lower degree."""
    preference = np.array([_PREFERENCE[SiteKind(kind)] for kind in sites.kind])
    rows = np.flatnonzero(graph.mate >= 0)
    mate = graph.mate[rows]
    rank, other = preference[graph.site[rows]], preference[graph.site[mate]]
    better = (rank < other) | ((rank == other) & (rows < mate))
    rows, mate = rows[better], mate[better]
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
    )


def evaluate_span(
    sites: Sites, span: Span, fraction: FloatArray, ends: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Exact disks (k, n, 3) as (x, y, r) at fractions of the spans, and contacts (k, n).

    `ends` are the (k, 3) disks at both ends, which are known and where (A) may be 0 / 0.
    """
    count, width = len(span.site), len(fraction)
    parameter = span.start[:, None] + (span.end - span.start)[:, None] * fraction
    hint = span.facing_start[:, None] + (span.facing_end - span.facing_start)[:, None] * fraction
    site = np.repeat(span.site, width)
    position, normal, _ = sites.frame(site, parameter.ravel())
    facing, radius = sites.contact(np.repeat(span.partner, width), position, normal, hint.ravel())
    with np.errstate(invalid="ignore"):
        centre = position + radius[:, None] * normal
    disks = np.concatenate([centre, radius[:, None]], axis=1).reshape(count, width, 3)
    facing = facing.reshape(count, width)
    if fraction[0] == 0:
        disks[:, 0], facing[:, 0] = ends[0], span.facing_start
    if fraction[-1] == 1:
        disks[:, -1], facing[:, -1] = ends[1], span.facing_end
    return disks, facing


def fit_edges(sites: Sites, graph: Graph, tolerance: float, depth: int = 40) -> Fit:
    """Interpolate every edge; halve those that no degree up to 12 brings below tolerance.

    Parameters
    ----------
    tolerance : float
        Largest deviation of centre and radius from the exact disk of the same parameter, mm.

    Raises
    ------
    GeometryError
        An edge that does not converge, with its place.
    """
    span = graph_spans(graph, sites)
    first = np.concatenate([graph.first_centre, graph.first_radius[:, None]], axis=1)[span.edge]
    last = np.concatenate([graph.last_centre, graph.last_radius[:, None]], axis=1)[span.edge]
    done: list[tuple[Span, IntArray, FloatArray, list[FloatArray]]] = []
    joints = [np.concatenate([graph.vertex_centre, graph.vertex_radius[:, None]], axis=1)]
    count = len(joints[0])
    for _ in range(depth):
        span, first, last, degree, error, coefficients = _best_side(
            sites, span, first, last, tolerance
        )
        good = np.flatnonzero(degree > 0)
        done.append((span.take(good), degree[good], error[good], [coefficients[k] for k in good]))
        poor = np.flatnonzero(degree == 0)
        if not len(poor):
            break
        span, first, last, middle = _halve(sites, span.take(poor), first[poor], last[poor], count)
        joints.append(middle)
        count += len(middle)
    else:
        place = first[0, :2] + sites.origin
        raise GeometryError("an edge of the axis does not converge", place=tuple(place))
    every = Span(*_join([part[0] for part in done]))
    degree = np.concatenate([part[1] for part in done])
    error = np.concatenate([part[2] for part in done])
    flat = [row for part in done for row in part[3]]
    order = np.lexsort((every.start, every.edge))
    table = np.concatenate(joints)
    return Fit(
        every.take(order), degree[order], [flat[k] for k in order], error[order],
        table[:, :2], table[:, 2],
    )  # fmt: skip


def _join(spans: list[Span]) -> list[np.ndarray]:
    names = list(Span.__dataclass_fields__)
    return [np.concatenate([getattr(span, name) for span in spans]) for name in names]


def _best_side(
    sites: Sites, span: Span, first: FloatArray, last: FloatArray, tolerance: float
) -> tuple[Span, FloatArray, FloatArray, IntArray, FloatArray, list[FloatArray]]:
    """Interpolate; where the preferred side does not converge, try the other."""
    degree, error, coefficients = _interpolate(sites, span, first, last, tolerance)
    poor = np.flatnonzero(degree == 0)
    if len(poor):
        other = span.take(poor).swapped()
        second = _interpolate(sites, other, last[poor], first[poor], tolerance)
        better = second[1] < error[poor]
        rows = poor[better]
        columns = {name: getattr(span, name).copy() for name in Span.__dataclass_fields__}
        for name, column in columns.items():
            column[rows] = getattr(other, name)[better]
        span = Span(**columns)
        first, last = first.copy(), last.copy()
        first[rows], last[rows] = last[rows], first[rows].copy()
        degree[rows], error[rows] = second[0][better], second[1][better]
        for row, index in zip(rows, np.flatnonzero(better), strict=True):
            coefficients[row] = second[2][index]
    return span, first, last, degree, error, coefficients


def _interpolate(
    sites: Sites, span: Span, first: FloatArray, last: FloatArray, tolerance: float
) -> tuple[IntArray, FloatArray, list[FloatArray]]:
    """Lowest degree that is good enough (0 where none is), its error, Bezier coefficients."""
    top = DEGREES[-1]
    fraction = chebyshev_fractions(top)
    extra = 0.5 * (fraction[:-1] + fraction[1:])
    both = np.concatenate([fraction, extra])
    order = np.argsort(both)
    disks, _ = evaluate_span(sites, span, both[order], (first, last))
    count = len(span.site)
    degree = np.zeros(count, dtype=np.int64)
    error = np.full(count, np.inf)
    coefficients: list[FloatArray] = [np.zeros((0, 3))] * count
    # Where the partner is out of reach the edge is not what the graph says: left open.
    finite = np.isfinite(disks).all(axis=(1, 2))
    sorted_fraction = both[order]
    position = np.flatnonzero(np.isin(order, np.arange(top + 1)))
    for trial in DEGREES:
        open_rows = np.flatnonzero((degree == 0) & finite)
        if not len(open_rows):
            break
        nodes = position[:: top // trial]
        inverse = np.linalg.inv(bernstein_matrix(trial, sorted_fraction[nodes]))
        table = inverse @ disks[open_rows][:, nodes]
        table[:, 0], table[:, -1] = first[open_rows], last[open_rows]
        fitted = bernstein_matrix(trial, sorted_fraction) @ table
        deviation = np.abs(fitted - disks[open_rows]).max(axis=(1, 2))
        good = deviation <= tolerance
        degree[open_rows[good]] = trial
        error[open_rows] = np.minimum(error[open_rows], deviation)
        for row, values in zip(open_rows[good], table[good], strict=True):
            coefficients[row] = values
    return degree, error, coefficients


def _halve(
    sites: Sites, span: Span, first: FloatArray, last: FloatArray, count: int
) -> tuple[Span, FloatArray, FloatArray, FloatArray]:
    """Two spans for one, with a joint between them."""
    disks, facing = evaluate_span(sites, span, np.array([0.5]), (first, last))
    middle = disks[:, 0]
    half = 0.5 * (span.start + span.end)
    vertex = np.arange(count, count + len(half))
    if not np.all(np.isfinite(middle)):
        bad = int(np.flatnonzero(~np.isfinite(middle).all(axis=1))[0])
        place = first[bad, :2] + sites.origin
        raise GeometryError("an edge of the axis is interrupted", place=tuple(place))
    facing = facing[:, 0]
    one = Span(
        span.site, span.partner, span.start, half, span.facing_start, facing, span.first, vertex,
        span.edge,
    )  # fmt: skip
    two = Span(
        span.site, span.partner, half, span.end, facing, span.facing_end, vertex, span.last,
        span.edge,
    )  # fmt: skip
    joined = Span(*_join([one, two]))
    return (
        joined,
        np.concatenate([first, middle]),
        np.concatenate([middle, last]),
        middle,
    )
