"""Edges of the axis in Bezier form, interpolated at Chebyshev points (Dorado 2009, eq. 7)."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry.chebyshev import bernstein, nodes
from grassfire.medial.contact import Tangents, contact
from grassfire.medial.graph import Graph
from grassfire.medial.sites import FloatArray, IntArray, SiteKind, Sites

DEGREES = (1, 2, 3, 4, 6, 12)
"""Nested: the Chebyshev points of each are among those of the last."""

_MOST_HALVES = 4
"""Open pieces per edge beyond which halving has stopped to help."""

_PREFERENCE = {SiteKind.LINE: 0, SiteKind.SPIRAL: 1, SiteKind.ARC: 2, SiteKind.POINT: 3}


@dataclass(frozen=True)
class Span:
    """Pieces of edges seen from both sides; one row a polynomial edge.

    Along row k the parameter of `site` runs from `start` to `end` (increasing), that of `partner`
    from `facing_start` to `facing_end` (decreasing). The (k, 3) disks (x, y, r) at both ends are
    known, and (A) may be 0 / 0 there; `far_first` and `far_last` are the same disks as found from
    the partner, which differ where the boundary has a kink too flat for a corner.
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

    def __len__(self) -> int:
        return len(self.site)

    def take(self, index: IntArray) -> Span:
        """Rows `index`."""
        return Span(*(getattr(self, item.name)[index] for item in fields(self)))

    def swapped(self) -> Span:
        """The same pieces parametrised by the other side."""
        return Span(
            self.partner, self.site, self.facing_end, self.facing_start, self.end, self.start,
            self.last, self.first, self.edge,
            self.far_last, self.far_first, self.last_disk, self.first_disk,
        )  # fmt: skip

    @staticmethod
    def join(spans: list[Span]) -> Span:
        """All rows of all spans."""
        return Span(
            *(np.concatenate([getattr(span, f.name) for span in spans]) for f in fields(Span))
        )


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


def graph_spans(graph: Graph, sites: Sites) -> Span:
    """One row an edge, parametrised by the side that gives the lower degree."""
    preference = np.array([_PREFERENCE[SiteKind(kind)] for kind in sites.kind])
    rows = np.flatnonzero(graph.mate >= 0)
    mate = graph.mate[rows]
    rank, other = preference[graph.site[rows]], preference[graph.site[mate]]
    better = (rank < other) | ((rank == other) & (rows < mate))
    rows, mate = rows[better], mate[better]
    head = np.concatenate([graph.first_centre, graph.first_radius[:, None]], axis=1)
    tail = np.concatenate([graph.last_centre, graph.last_radius[:, None]], axis=1)
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
        first_disk=head[rows],
        last_disk=tail[rows],
        far_first=tail[mate],
        far_last=head[mate],
    )


def evaluate_span(sites: Sites, span: Span, fraction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Exact disks (k, n, 3) as (x, y, r) and contacts (k, n) at fractions of the spans.

    `fraction` is (n,), the same for all rows, or (k, n).
    """
    fraction = np.broadcast_to(fraction, (len(span), np.shape(fraction)[-1]))
    parameter = span.start[:, None] + (span.end - span.start)[:, None] * fraction
    hint = span.facing_start[:, None] + (span.facing_end - span.facing_start)[:, None] * fraction
    width = fraction.shape[1]
    site, flat = np.repeat(span.site, width), parameter.ravel()
    position, normal, _ = sites.frame(site, flat)
    tangents = Tangents(position, normal, site, flat)
    facing, radius = contact(sites, tangents, np.repeat(span.partner, width), hint.ravel())
    with np.errstate(invalid="ignore"):
        centre = position + radius[:, None] * normal
    disks = np.concatenate([centre, radius[:, None]], axis=1).reshape(len(span), width, 3)
    facing = facing.reshape(len(span), width)
    for end, disk, known in (
        (0.0, span.first_disk, span.facing_start),
        (1.0, span.last_disk, span.facing_end),
    ):
        row, column = np.nonzero(fraction == end)
        disks[row, column], facing[row, column] = disk[row], known[row]
    return disks, facing


def fit_edges(
    sites: Sites, graph: Graph, tolerance: float, drawing_tolerance: float, depth: int = 40
) -> Fit:
    """Interpolate every edge; halve those that no degree up to 12 brings below tolerance.

    Parameters
    ----------
    tolerance : float
        Largest deviation of centre and radius from the exact disk of the same parameter, mm.
    drawing_tolerance : float
        Pieces are short enough for 399 chords to draw each within this, mm.

    Raises
    ------
    GeometryError
        An edge that does not converge, with its place.
    """
    span = graph_spans(graph, sites)
    done: list[tuple[Span, IntArray, FloatArray]] = []
    flat: list[FloatArray] = []
    joints = [np.concatenate([graph.vertex_centre, graph.vertex_radius[:, None]], axis=1)]
    most = _MOST_HALVES * (len(span) + 1)
    for _ in range(depth):
        span, degree, error, coefficients = _best_side(sites, span, tolerance)
        good = np.flatnonzero(degree > 0)
        done.append((span.take(good), degree[good], error[good]))
        flat.extend(coefficients[row] for row in good)
        poor = np.flatnonzero(degree == 0)
        if not len(poor):
            break
        if len(poor) > most:
            place = span.first_disk[poor[0], :2] + sites.origin
            raise GeometryError("edges of the axis do not converge", place=tuple(place))
        span, middle = _halve(sites, span.take(poor), sum(len(part) for part in joints))
        joints.append(middle)
    else:
        place = span.first_disk[0, :2] + sites.origin
        raise GeometryError("an edge of the axis does not converge", place=tuple(place))
    every = Span.join([part[0] for part in done])
    degree = np.concatenate([part[1] for part in done])
    error = np.concatenate([part[2] for part in done])
    every, source, flat = _drawable(sites, every, flat, joints, drawing_tolerance)
    degree, error = degree[source], error[source]
    order = np.lexsort((every.start, every.edge))
    table = np.concatenate(joints)
    return Fit(
        every.take(order), degree[order], [flat[k] for k in order], error[order],
        table[:, :2], table[:, 2],
    )  # fmt: skip


def _drawable(
    sites: Sites,
    span: Span,
    coefficients: list[FloatArray],
    joints: list[FloatArray],
    tolerance: float,
) -> tuple[Span, IntArray, list[FloatArray]]:
    """Halve pieces until 399 chords draw each within `tolerance`; polynomials stay the same.

    The sagitta of a chord is |x' cross x''| / |x'| times its parameter step squared over 8.
    """
    source = np.arange(len(span))
    for _ in range(8):
        bend = np.array([_bend(table) for table in coefficients])
        long = np.flatnonzero(bend / (8 * 399**2) > tolerance)
        if not len(long):
            break
        keep = np.setdiff1d(np.arange(len(span)), long)
        halves, _ = _halve(sites, span.take(long), sum(len(part) for part in joints))
        split = [_split(coefficients[row]) for row in long]
        joints.append(np.array([left[-1] for left, _ in split]))
        span = Span.join([span.take(keep), halves])
        coefficients = [
            *(coefficients[row] for row in keep),
            *(left for left, _ in split),
            *(right for _, right in split),
        ]
        source = np.concatenate([source[keep], source[long], source[long]])
    return span, source, coefficients


def _bend(table: FloatArray) -> float:
    """Largest |x' cross x''| / |x'| of a piece."""
    degree = len(table) - 1
    if degree < 2:
        return 0.0
    first = degree * np.diff(table[:, :2], axis=0)
    second = (degree - 1) * np.diff(first, axis=0)
    fraction = np.linspace(0.0, 1.0, 9)
    one = bernstein(degree - 1, fraction) @ first
    two = bernstein(degree - 2, fraction) @ second
    speed = np.hypot(one[:, 0], one[:, 1])
    cross = np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    return float(np.max(cross / np.maximum(speed, 1e-3 * speed.max() + 1e-300)))


def _split(table: FloatArray) -> tuple[FloatArray, FloatArray]:
    """De Casteljau at 1/2."""
    left, right = [table[0]], [table[-1]]
    level = table
    while len(level) > 1:
        level = 0.5 * (level[:-1] + level[1:])
        left.append(level[0])
        right.append(level[-1])
    return np.array(left), np.array(right[::-1])


def _best_side(
    sites: Sites, span: Span, tolerance: float
) -> tuple[Span, IntArray, FloatArray, list[FloatArray]]:
    """Interpolate; where the preferred side does not converge, try the other."""
    degree, error, coefficients = _interpolate(sites, span, tolerance)
    poor = np.flatnonzero(degree == 0)
    if len(poor):
        other = span.take(poor).swapped()
        second = _interpolate(sites, other, tolerance)
        better = np.flatnonzero(second[1] < error[poor])
        rows = poor[better]
        order = np.arange(len(span))
        order[rows] = len(span) + better
        span = Span.join([span, other]).take(order)
        degree[rows], error[rows] = second[0][better], second[1][better]
        for row, index in zip(rows, better, strict=True):
            coefficients[row] = second[2][index]
    return span, degree, error, coefficients


def _interpolate(
    sites: Sites, span: Span, tolerance: float
) -> tuple[IntArray, FloatArray, list[FloatArray]]:
    """Lowest degree that is good enough (0 where none is), its error, Bezier coefficients."""
    top = DEGREES[-1]
    fraction = nodes(top)
    extra = 0.5 * (fraction[:-1] + fraction[1:])
    both = np.concatenate([fraction, extra])
    order = np.argsort(both)
    disks, _ = evaluate_span(sites, span, both[order])
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
        chosen = position[:: top // trial]
        inverse = np.linalg.inv(bernstein(trial, sorted_fraction[chosen]))
        table = inverse @ disks[open_rows][:, chosen]
        table[:, 0], table[:, -1] = span.first_disk[open_rows], span.last_disk[open_rows]
        fitted = bernstein(trial, sorted_fraction) @ table
        deviation = np.abs(fitted - disks[open_rows]).max(axis=(1, 2))
        good = deviation <= tolerance
        degree[open_rows[good]] = trial
        error[open_rows] = np.minimum(error[open_rows], deviation)
        for row, values in zip(open_rows[good], table[good], strict=True):
            coefficients[row] = values
    return degree, error, coefficients


def _halve(sites: Sites, span: Span, count: int) -> tuple[Span, FloatArray]:
    """Two spans for one, and the (k, 3) disks of the joints between them.

    `count` is the number of the first joint.
    """
    disks, facing = evaluate_span(sites, span, np.array([0.5]))
    middle, facing = disks[:, 0], facing[:, 0]
    lost = ~np.isfinite(middle).all(axis=1)
    if lost.any():
        place = span.first_disk[lost][0, :2] + sites.origin
        raise GeometryError("an edge of the axis is interrupted", place=tuple(place))
    half = 0.5 * (span.start + span.end)
    joint = np.arange(count, count + len(half))
    one = replace(span, end=half, facing_end=facing, last=joint, last_disk=middle, far_last=middle)
    two = replace(
        span, start=half, facing_start=facing, first=joint, first_disk=middle, far_first=middle
    )
    return Span.join([one, two]), middle
