"""Edges of the axis in Bezier form, interpolated at Chebyshev points (Dorado 2009, eq. 7).

An edge is interpolated along the parameter of one of its sides. Its disks are contacts, which are
costly, so each is found once: at nested Chebyshev points, coarse ones first, whose contacts are
interpolated to start the search for the next. Lower degrees are judged at the points that they do
not use, the highest at points of its own. The contacts stay in `Fit`, for the certificate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry.chebyshev import bernstein, interpolate_to_bezier, nodes, resampling
from grassfire.medial.bisectors import between_lines
from grassfire.medial.edges import (
    DEGREES,
    FEET_APART,
    NODES,
    TOP,
    Fit,
    Span,
    evaluate_span,
    graph_spans,
    motion,
)
from grassfire.medial.graph import Graph
from grassfire.medial.hyperbolas import between_corners
from grassfire.medial.interpolants import Interpolants, cut_span, deviation_limit
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, SiteKind, Sites

_COARSE = np.array([3, 6, 9])
_FINE = np.array([1, 2, 4, 5, 7, 8, 10, 11])
_COARSE_AND_ENDS = [0, 3, 6, 9, TOP]
_CHECKS = np.sin(np.pi * (np.array([0, 3, 8, 11]) + 0.5) / (2 * TOP)) ** 2
"""Midway between Chebyshev points, where the error of the highest degree is largest."""

_PLACES = np.concatenate([NODES[:-1], _CHECKS])
"""All places of a piece at which disks may be wanted, its end aside."""

_LATER = np.concatenate([NODES[_FINE], _CHECKS])
"""Of them those that come after the coarse ones."""

_GAIN = 12.0
"""Factor by which halving brings down the error of a piece that is singular at an end, or more."""

_DEEPEST = 8
"""Halvings at once."""

_UNCLEAR = 0.8
"""Share of the halvings that an error asks for, where both ends are off by about as much."""

_HOPELESS = 8
"""Halvings after which those that are left until patience ends are done at once."""

_MOST_HALVES = 4
"""Open pieces per edge beyond which halving has stopped to help."""

_PATIENCE = 14
"""Halvings after which the larger tolerance counts, and derivatives no longer do."""

_CHORDS = 399
"""Chords that a piece is drawn with."""


@dataclass(frozen=True)
class _Trials(Interpolants):
    """Spans whose polynomials are looked for: the degree is 0 where none is good enough. The error
    aimed at, disks (k, 13, 3) at the Chebyshev points, the largest 1 - k r at the ends (k,), which
    is 0 where derivatives do not matter, whether halving has to end soon, slopes (k, 2) of the
    contacts by the fraction at both ends, disks (k, 4, 3) between the points, and how often to
    halve those that are not good enough, towards the start (> 0) or end (< 0)."""

    goal: FloatArray
    disks: FloatArray
    sharpness: FloatArray
    late: BoolArray
    slope: FloatArray
    checks: FloatArray
    grade: IntArray

    def found(self) -> Interpolants:
        """Those that are good enough."""
        rows = (self.degree > 0).nonzero()[0]
        every = Interpolants(self.span, self.degree, self.table, self.error, self.facing)
        return every.take(rows)


def fit_edges(
    sites: Sites,
    graph: Graph,
    tolerance: float,
    drawing_tolerance: float,
    largest: float | None = None,
    depth: int = 40,
) -> Fit:
    """Interpolate every edge; cut those that no degree up to 12 brings below tolerance.

    Parameters
    ----------
    tolerance : float
        Deviation of centre and radius from the exact disk of the same parameter to aim at, mm.
    drawing_tolerance : float
        Pieces are short enough for 399 chords to draw each within this, mm.
    largest : float, optional
        Deviation to put up with where halving no longer helps, as next to vertices that rounding
        leaves open along the axis, mm; `tolerance` by default.

    Raises
    ------
    GeometryError
        An edge that does not converge, with its place.
    """
    span = graph_spans(graph, sites)
    joints = [np.concatenate([graph.vertex_centre, graph.vertex_radius[:, None]], axis=1)]
    most = _MOST_HALVES * (len(span) + 1)
    worst = max(tolerance, largest or 0.0)
    done, span = between_lines(sites, span, tolerance)
    straight, between, span = between_corners(sites, span, tolerance, len(joints[0]))
    done.append(straight)
    joints.append(between)
    trials: list[Interpolants] = []
    known: _Known | None = None
    halvings = np.zeros(len(span), dtype=np.int64)
    for level in range(depth):
        if not len(span):
            break
        patient = halvings < _PATIENCE
        pieces = _interpolate(sites, span, np.where(patient, tolerance, worst), patient, known)
        lost = (pieces.degree == 0) & (_known_degree(sites, span) == 2)
        if level == 0 and lost.any():
            pieces = _turned(sites, pieces, lost, tolerance, worst)
            span = pieces.span
        trials.append(pieces.found())
        poor = (pieces.degree == 0).nonzero()[0]
        if not len(poor):
            break
        if len(poor) > most:
            place = span.first_disk[poor[0], :2] + sites.origin
            raise GeometryError("edges of the axis do not converge", place=tuple(place))
        parts = _parts(pieces.grade[poor], halvings[poor])
        count = sum(len(part) for part in joints)
        span, known, between = _split(sites, pieces, poor[parts.row], parts, count)
        halvings = parts.halvings
        joints.append(between)
    else:
        place = span.first_disk[0, :2] + sites.origin
        raise GeometryError("an edge of the axis does not converge", place=tuple(place))
    parts_found = [*done, Interpolants.join(*trials)] if trials else done
    drawn = [_drawable(sites, part, joints, drawing_tolerance) for part in parts_found]
    return _as_fit(sites, drawn, np.concatenate(joints))


def _as_fit(sites: Sites, parts: list[Interpolants], vertices: FloatArray) -> Fit:
    """All pieces in the order of the boundary."""
    span = Span.join(*[part.span for part in parts])
    order = np.lexsort((span.start, span.edge))
    length = 1 + np.concatenate([part.degree for part in parts])
    offset = np.concatenate([[0], np.cumsum(length.take(order))])
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    control, facing = np.empty((int(offset[-1]), 3)), np.empty((len(order), TOP + 1))
    # Each coefficient is moved once: from its part to its row.
    first = 0
    for part in parts:
        rows = place[first : first + len(part.degree)]
        first += len(rows)
        facing[rows] = part.facing
        for degree in np.bincount(part.degree).nonzero()[0].tolist():
            members = (part.degree == degree).nonzero()[0]
            target = offset.take(rows.take(members))[:, None] + np.arange(degree + 1)
            control[target] = part.table[:, : degree + 1].take(members, axis=0)
    span = span.take(order)
    return Fit(
        span=span,
        control=control,
        offset=offset,
        error=np.concatenate([part.error for part in parts])[order],
        facing=facing,
        exact=_known_degree(sites, span) > 0,
        vertex_centre=vertices[:, :2],
        vertex_radius=vertices[:, 2],
    )


def _turned(
    sites: Sites, pieces: _Trials, lost: BoolArray, tolerance: float, worst: float
) -> _Trials:
    """Parabolas over slivers of their line, beside arcs that they all but collapse on."""
    same = pieces.span.take(lost.nonzero()[0])
    goal, steady = np.full(len(same), worst), np.zeros(len(same), dtype=bool)
    turned = _interpolate(sites, same, goal, steady)
    if not turned.degree.all():
        turned = _interpolate(sites, same.swapped(), np.full(len(same), tolerance), ~steady)
    return _Trials.join(pieces.take((~lost).nonzero()[0]), turned)


class _Ends(NamedTuple):
    """Of the own ends of pieces and of those facing them: how the centre moves and 1 - k r, (4, k)
    each, and how far their feet are apart as a share of the radius, (k,) at most."""

    moved: FloatArray
    level: FloatArray
    apart: FloatArray

    @classmethod
    def of(cls, sites: Sites, span: Span) -> _Ends:
        site = np.concatenate([span.site, span.site, span.partner, span.partner])
        parameter = np.concatenate([span.start, span.end, span.facing_start, span.facing_end])
        radius = np.tile(np.concatenate([span.first_disk[:, 2], span.last_disk[:, 2]]), 2)
        moved, curvature, _, position = motion(sites, site, parameter, radius)
        bend = np.where(np.isfinite(curvature), curvature, 0.0)
        feet = position[: 2 * len(span)] - position[2 * len(span) :]
        apart = np.hypot(feet[:, 0], feet[:, 1]) / np.maximum(radius[: len(feet)], 1e-300)
        level = (1 - bend * radius).reshape(4, -1)
        return cls(moved.reshape(4, -1), level, apart.reshape(2, -1).max(axis=0))


def _end_slopes(span: Span, moved: FloatArray) -> FloatArray:
    """(k, 2) slopes of the contacts by the fraction at both ends; none at smooth ends."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((-moved[:2] * (span.end - span.start) / moved[2:]).T)


def _ratio(slope: FloatArray, chord: FloatArray) -> FloatArray:
    """Slopes at ends over those of chords; beyond 3 a cubic would not be monotone."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = slope / chord
    return np.minimum(np.where(np.isfinite(ratio) & (ratio > 0), ratio, 1.0), 3.0)


def _first_hint(span: Span, moved: FloatArray) -> FloatArray:
    """(k, 3) contacts expected at the coarse points: the cubic with the right slopes at the ends.

    Both contacts see the same motion of the centre, ds (1 - k r) across their normals: `moved`.
    """
    fraction = NODES[_COARSE]
    step = span.facing_end - span.facing_start
    ratio = _ratio(_end_slopes(span, moved), step[:, None]).T[..., None]
    rest = 1 - fraction
    shape = (
        ratio[0] * fraction * rest**2
        - ratio[1] * fraction**2 * rest
        + fraction**2 * (3 - 2 * fraction)
    )
    return np.asarray(span.facing_start[:, None] + step[:, None] * shape)


def _known_degree(sites: Sites, span: Span) -> IntArray:
    """Degree of the edges that are polynomials because of their sites: lines and parabolas; or 0.

    Along a line the bisector with another line is linear, and with a point or a circle (a point
    moved along the normal) quadratic, both in centre and radius.
    """
    one, two = sites.kind[span.site], sites.kind[span.partner]
    line = one == SiteKind.LINE
    degree = np.where(two == SiteKind.LINE, 1, np.where(two == SiteKind.SPIRAL, 0, 2))
    return np.where(line, degree, 0)


class _Known(NamedTuple):
    """Disks (k, 16, 3) and contacts (k, 16) of pieces at all places but their ends."""

    disks: FloatArray
    facing: FloatArray


def _interpolate(
    sites: Sites, span: Span, goal: FloatArray, steady: BoolArray, known: _Known | None = None
) -> _Trials:
    """Lowest degree within the goal (0 where none is), its error, Bezier coefficients.

    `steady` asks for good derivatives, too.
    """
    count = len(span)
    ends = _Ends.of(sites, span)
    # What rounding does to the bisector of two lines, however parallel, it does along it.
    straight = _known_degree(sites, span) == 1
    sharpness = np.maximum(ends.level.max(axis=0), 1.0)
    late = straight | ~steady
    pieces = _Trials(
        span=span,
        degree=np.zeros(count, dtype=np.int64),
        table=np.zeros((count, TOP + 1, 3)),
        error=np.full(count, np.inf),
        facing=np.zeros((count, TOP + 1)),
        goal=goal,
        disks=np.zeros((count, TOP + 1, 3)),
        sharpness=np.where(late | (ends.apart < FEET_APART), 0.0, sharpness),
        late=late,
        slope=_end_slopes(span, ends.moved),
        checks=np.full((count, len(_CHECKS), 3), np.nan),
        grade=np.ones(count, dtype=np.int64),
    )
    disks, facing = pieces.disks, pieces.facing
    disks[:, 0], disks[:, -1] = span.first_disk, span.last_disk
    facing[:, 0], facing[:, -1] = span.facing_start, span.facing_end
    if known is None:
        _coarse_and_fine(sites, pieces, ends.moved)
    else:
        disks[:, 1:-1], facing[:, 1:-1] = known.disks[:, 1:TOP], known.facing[:, 1:TOP]
        pieces.checks[:] = known.disks[:, TOP:]
    _try(pieces)
    rows = ((pieces.degree == 0) & np.isfinite(disks).all(axis=(1, 2))).nonzero()[0]
    if len(rows):
        _try_top(pieces, rows)
    return pieces


def _coarse_and_fine(sites: Sites, pieces: _Trials, moved: FloatArray) -> None:
    """Disks and contacts at all places, coarse ones first."""
    span, disks, facing = pieces.span, pieces.disks, pieces.facing
    first = _first_hint(span, moved)
    disks[:, _COARSE], facing[:, _COARSE] = evaluate_span(sites, span, NODES[_COARSE], first)
    with np.errstate(invalid="ignore"):
        rest = facing[:, _COARSE_AND_ENDS] @ _resampling().T
    found, where = evaluate_span(sites, span, _LATER, rest)
    fine = len(_FINE)
    disks[:, _FINE], facing[:, _FINE] = found[:, :fine], where[:, :fine]
    pieces.checks[:] = found[:, fine:]


@lru_cache(maxsize=1)
def _resampling() -> FloatArray:
    """Values at the later places from those at the coarse ones and the ends."""
    return resampling(len(_COARSE_AND_ENDS) - 1, _LATER)


@lru_cache(maxsize=1)
def _deviations() -> FloatArray:
    """From values at all nodes to what polynomials of lower degrees deviate there, stacked."""
    degrees, count = DEGREES[:-1], TOP + 1
    result = np.zeros((len(degrees), count, count))
    for matrix, degree in zip(result, degrees, strict=True):
        chosen = np.arange(0, count, TOP // degree)
        matrix[:, chosen] = resampling(degree, NODES)
        # At its own nodes a polynomial has the very values.
        matrix[chosen] = 0.0
        others = np.setdiff1d(np.arange(count), chosen)
        matrix[others, others] -= 1.0
    return np.asarray(result.reshape(-1, count))


def _try(pieces: _Trials) -> None:
    """Accept the lowest degree that is good enough at all Chebyshev points."""
    degrees = DEGREES[:-1]
    with np.errstate(invalid="ignore"):
        off = _deviations() @ pieces.disks
    rows = np.arange(len(off))
    away = _deviation(pieces, rows, off).reshape(len(rows), len(degrees), -1).max(axis=2)
    # Where the partner is out of reach the edge is not what the graph says: left open.
    away = np.where(np.isfinite(away), away, np.inf)
    good = away <= _limit(pieces, rows, degrees)
    lowest = np.argmax(good, axis=1)
    found = good.any(axis=1)
    for column, degree in enumerate(degrees):
        members = (found & (lowest == column)).nonzero()[0]
        if len(members):
            table = interpolate_to_bezier(pieces.disks[members, :: TOP // degree])
            _accept(pieces, members, degree, table, away[members, column])


@lru_cache(maxsize=1)
def _top_at_checks() -> FloatArray:
    """Bernstein polynomials of the highest degree between its nodes, (4, 13)."""
    return bernstein(TOP, _CHECKS)


def _try_top(pieces: _Trials, rows: IntArray) -> None:
    """Accept the highest degree where it agrees with the disks between its nodes.

    Where it does not, the cause is at the end where it is off by more: as many halvings towards it
    as the error asks for, some less where it is hardly more than at the other.
    """
    table = interpolate_to_bezier(pieces.disks[rows])
    off = _top_at_checks() @ table - pieces.checks[rows]
    away = _deviation(pieces, rows, off).max(axis=1)
    limit = _limit(pieces, rows, (TOP,))[:, 0]
    good = away <= limit
    _accept(pieces, rows[good], TOP, table[good], away[good])
    side = np.abs(off).max(axis=2)
    head, tail = side[:, :2].max(axis=1), side[:, 2:].max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.log(away / limit) / np.log(_GAIN)
    clear = np.maximum(head, tail) > 2 * np.minimum(head, tail)
    depth = np.where(np.isfinite(depth), np.where(clear, 1.0, _UNCLEAR) * depth, 1)
    depth = np.clip(depth, 1, _DEEPEST).astype(np.int64)
    pieces.grade[rows] = np.where(head >= tail, depth, -depth)


def _deviation(pieces: _Trials, rows: IntArray, away: FloatArray) -> FloatArray:
    """Largest coordinates (n, m) of deviations (n, m, 3).

    Vertices that rounding leaves open along the axis lie on it all the same. So on pieces that
    keep being halved next to them, short as they are, what points along the piece is no error.
    """
    late = pieces.late[rows].nonzero()[0]
    if len(late):
        chord = pieces.disks[rows[late], -1] - pieces.disks[rows[late], 0]
        square = np.maximum(np.einsum("ij,ij->i", chord, chord), 1e-300)
        with np.errstate(invalid="ignore"):
            along = np.einsum("imj,ij->im", away[late], chord) / square[:, None]
            away[late] -= along[..., None] * chord[:, None]
    away = np.abs(away)
    return np.asarray(np.maximum(np.maximum(away[..., 0], away[..., 1]), away[..., 2]))


def _accept(
    pieces: _Trials, rows: IntArray, degree: int, table: FloatArray, away: FloatArray
) -> None:
    """Take a degree, its coefficients and what it is `away` by, (n,)."""
    pieces.degree[rows] = degree
    pieces.table[rows, : degree + 1] = table
    pieces.error[rows] = away


def _limit(pieces: _Trials, rows: IntArray, degrees: tuple[int, ...]) -> FloatArray:
    """Deviations (n, d) up to which degrees of pieces are good enough."""
    first, last = pieces.disks[rows, 0], pieces.disks[rows, -1]
    goal, sharpness = pieces.goal[rows], pieces.sharpness[rows]
    return deviation_limit(first, last, goal, sharpness, np.array(degrees))


@dataclass(frozen=True)
class _Parts:
    """How pieces are cut: the piece of each part (k,), its range of fractions, the number of
    halvings that led to it, and whether a joint is at its start."""

    row: IntArray
    low: FloatArray
    high: FloatArray
    halvings: IntArray
    inner: BoolArray


def _parts(grade: IntArray, halvings: IntArray) -> _Parts:
    """Halves of pieces, halved again towards the end that their grade (n,) tells."""
    rest = np.where(halvings >= _HOPELESS, _PATIENCE - halvings, 0)
    depth = np.maximum(np.abs(grade), rest)
    row = np.repeat(np.arange(len(depth)), depth + 1)
    index = np.arange(len(row)) - np.repeat(np.cumsum(depth + 1) - depth - 1, depth + 1)
    steps, forward = depth[row], grade[row] > 0
    step = np.where(forward, index, steps - index)
    far = 2.0 ** (step - steps)
    near = np.where(step > 0, 0.5 * far, 0.0)
    low, high = np.where(forward, near, 1 - far), np.where(forward, far, 1 - near)
    done = steps - np.maximum(step - 1, 0)
    return _Parts(row, low, high, halvings[row] + done, index > 0)


def _split(
    sites: Sites, pieces: _Trials, row: IntArray, parts: _Parts, count: int
) -> tuple[Span, _Known, FloatArray]:
    """Pieces as parts, of which the first joint has the number `count`.

    `row` (k,) are the pieces of the parts. Returns the parts, the disks and contacts at their
    places, and the disks (j, 3) at the joints between them.
    """
    low, high, inner = parts.low, parts.high, parts.inner.nonzero()[0]
    parents, place = pieces.span.take(row), low[:, None] + (high - low)[:, None] * _PLACES
    hint = _between(pieces.facing.take(row, axis=0), pieces.slope.take(row, axis=0), place)
    known = _Known(*evaluate_span(sites, parents, place, hint))
    disk, facing = known.disks[inner, 0], known.facing[inner, 0]
    lost = ~np.isfinite(disk).all(axis=1)
    if lost.any():
        start = parents.first_disk[inner[lost][0], :2] + sites.origin
        raise GeometryError("an edge of the axis is interrupted", place=tuple(start))
    return cut_span(parents, low, high, inner, disk, facing, count), known, disk


def _between(facing: FloatArray, ends: FloatArray, fraction: FloatArray) -> FloatArray:
    """Contacts (k, n) at fractions (k, n) by monotone cubics between those known (k, 13).

    Slopes (k, 2) at the ends are given; at the nodes they are harmonic means of those of both
    chords (Fritsch and Butland 1984).
    """
    width = np.diff(NODES)
    chord = np.diff(facing, axis=1) / width
    left, right = width[:-1] + 2 * width[1:], 2 * width[:-1] + width[1:]
    slope = np.zeros_like(facing)
    last = chord[:, [0, -1]]
    slope[:, [0, -1]] = last * _ratio(ends, last)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = (left + right) / (left / chord[:, :-1] + right / chord[:, 1:])
    slope[:, 1:-1] = np.where(chord[:, :-1] * chord[:, 1:] > 0, mean, 0.0)
    cell = np.minimum(np.searchsorted(NODES[1:], fraction, side="right"), TOP - 1)
    flat = cell + TOP * np.arange(len(facing))[:, None]
    at = flat + np.arange(len(facing))[:, None]
    along = fraction - NODES.take(cell)
    share = along / width.take(cell)
    secant, head, tail = chord.take(flat), slope.take(at), slope.take(at + 1)
    bend = 3 * secant - 2 * head - tail + share * (head + tail - 2 * secant)
    return np.asarray(facing.take(at) + along * (head + share * bend))


# -- drawing --------------------------------------------------------------------------------------


def _drawable(
    sites: Sites, pieces: Interpolants, joints: list[FloatArray], tolerance: float
) -> Interpolants:
    """Cut pieces into equal parts that 399 chords draw within `tolerance`; they stay the same.

    The sagitta of a chord is |x' cross x''| / |x'| times its parameter step squared over 8.
    """
    if not np.any(pieces.degree > 1):
        return pieces
    parts = np.ones(len(pieces.span), dtype=np.int64)
    bent = np.where(pieces.degree > 1, pieces.degree, 0)
    # Between two corners the axis is straight.
    bent[pieces.span.hyperbolic] = 0
    for degree in np.bincount(bent)[1:].nonzero()[0] + 1:
        rows = (bent == degree).nonzero()[0]
        bend = _bend(pieces.table[rows, : degree + 1, :2])
        parts[rows] = np.ceil(np.sqrt(np.maximum(bend / (8 * _CHORDS**2 * tolerance), 1.0)))
    long = (parts > 1).nonzero()[0]
    if not len(long):
        return pieces
    keep = pieces.take((parts == 1).nonzero()[0])
    return Interpolants.join(keep, _cut(sites, pieces.take(long), parts[long], joints))


def _bend(table: FloatArray) -> FloatArray:
    """Largest |x' cross x''| / |x'| of polynomials (k, degree + 1, 2)."""
    degree = table.shape[1] - 1
    first = degree * np.diff(table, axis=1)
    second = (degree - 1) * np.diff(first, axis=1)
    fraction = np.linspace(0.0, 1.0, 9)
    one = bernstein(degree - 1, fraction) @ first
    two = bernstein(degree - 2, fraction) @ second
    speed = np.hypot(one[..., 0], one[..., 1])
    cross = np.abs(one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])
    least = 1e-3 * speed.max(axis=1, keepdims=True) + 1e-300
    return np.asarray((cross / np.maximum(speed, least)).max(axis=1))


def _cut(
    sites: Sites, pieces: Interpolants, parts: IntArray, joints: list[FloatArray]
) -> Interpolants:
    """Every piece as `parts` equal ones."""
    row = np.repeat(np.arange(len(parts)), parts)
    index = np.arange(len(row)) - np.repeat(np.cumsum(parts) - parts, parts)
    low, high = index / parts[row], (index + 1) / parts[row]
    degree = pieces.degree[row]
    facing = np.empty((len(row), TOP + 1))
    table = np.zeros((len(row), *pieces.table.shape[1:]))
    # Pieces of one degree in as many parts have their parts from one matrix.
    group, own = parts * (TOP + 1) + pieces.degree, parts[row] * (TOP + 1) + degree
    for number in np.unique(group):
        count, value = divmod(int(number), TOP + 1)
        members, source = (own == number).nonzero()[0], (group == number).nonzero()[0]
        at = resampling(TOP, _even_nodes(TOP, count).ravel())
        facing[members] = (pieces.facing[source] @ at.T).reshape(-1, TOP + 1)
        control = interpolate_to_bezier(bernstein(value, _even_nodes(value, count)))
        every = control.reshape(-1, value + 1) @ pieces.table[source, : value + 1]
        table[members, : value + 1] = every.reshape(len(members), value + 1, -1)
    inner = (index > 0).nonzero()[0]
    before = inner - 1
    # Exact disks at the joints; the polynomials meet at their own.
    hint = facing[inner, :1]
    place = low[inner, None]
    exact, where = evaluate_span(sites, pieces.span.take(row[inner]), place, hint)
    table[before, degree[before]] = table[inner, 0]
    first = sum(len(part) for part in joints)
    joints.append(table[inner, 0])
    span = cut_span(pieces.span.take(row), low, high, inner, exact[:, 0], where[:, 0], first)
    facing[:, 0], facing[:, -1] = span.facing_start, span.facing_end
    return Interpolants(
        span,
        degree,
        table,
        pieces.error[row],
        facing,
    )


def _even_nodes(degree: int, parts: int) -> FloatArray:
    """(parts, degree + 1) Chebyshev points of even parts."""
    return np.asarray((np.arange(parts)[:, None] + nodes(degree)) / parts)
