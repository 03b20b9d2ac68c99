"""The certificate: an answer that proves itself, or an error that says where it does not."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry import Region
from grassfire.geometry.chebyshev import (
    bernstein,
    coefficients,
    differentiate_values,
    interpolate_to_bezier,
)
from grassfire.geometry.neighbours import connected
from grassfire.medial.columns import Columns
from grassfire.medial.edges import FEET_APART, NODES, TOP, Fit, Span, evaluate_span, motion
from grassfire.medial.graph import Graph
from grassfire.medial.nodes import WHOLE
from grassfire.medial.recover import envelope, jets
from grassfire.medial.search import BoundarySearch, Feet
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, SiteKind, Sites, dot, largest

_PROBES = np.array([0.09, 0.34, 0.66, 0.91])
"""Between the Chebyshev points of all degrees."""

_FEW = np.array([0.21, 0.79])
"""The same for pieces between lines, arcs and points, whose contacts have closed forms."""

_MIDDLE = np.array([0.5])
"""The same for lines and parabolas."""

_EVERY = np.sort(np.concatenate([_MIDDLE, _FEW, _PROBES]))

_COMMON = 2.0
"""Tolerances by which eqs. (8) and (9) may be off: one for the centre and one for the radius."""

_EXHAUSTIVE = 20_000
"""Disks up to which every one is compared with the whole boundary; of more, so many are."""

_STRAIGHT = 1_000
"""The same of polygons, whose cells have closed forms."""

_SLACK = 1e-3
"""Share of the tolerance by which that search may overrate a distance."""


_PLAIN = NODES, interpolate_to_bezier(np.eye(TOP + 1)).mean(axis=0)
"""Clenshaw-Curtis quadrature: fractions and weights."""


def _crowded() -> tuple[FloatArray, FloatArray]:
    """Quadrature by the substitution tanh(pi/2 sinh(x)) (Takahasi and Mori 1974).

    Its points crowd to both ends: beside an arc that is nearly an arc of contact r comes up from a
    corner within a sliver of it.
    """
    place = np.linspace(-3.2, 3.2, 65)
    inner = 0.5 * np.pi * np.sinh(place)
    weight = 0.1 * 0.25 * np.pi * np.cosh(place) / np.cosh(inner) ** 2
    return 1.0 / (1.0 + np.exp(-2.0 * inner)), weight


_CROWDED = _crowded()


@dataclass(frozen=True)
class Certificate:
    """What was proved about a medial axis transform.

    Attributes
    ----------
    interpolation_error : float
        Largest |1 - n.(c* - c) / r*| of eq. (8) of Dorado 2009, times r*, on both sides of the
        edges: mm.
    recovery_error : float
        Eq. (9): largest distance between the boundary and the boundary recovered by eq. (1), mm;
        with the normals of the boundary at the feet of the centres, which is demanded to be within
        twice the tolerance, and with those that follow from the edges alone, where they are well
        determined: feet at least r / 10 apart, corners aside.
    area_error : float
        Difference between the area of the region and that of the disks' cells, mm^2.
    max_disk_error : float
        Largest difference between r* and the distance of c* to the boundary, mm. Of up to 20,000
        disks (vertices and places on the edges; 1,000 of polygons) each is compared with the whole
        boundary. Of more, so many are, evenly spread; all of them are compared with their own feet
        on both sides, and no other site can be nearer because the spokes are found to cover the
        region once: see "The certificate" in docs/theory.md.
    euler : bool
        Whether vertices - edges = 1 - holes and the axis is connected.
    """

    interpolation_error: float
    recovery_error: float
    area_error: float
    max_disk_error: float
    euler: bool

    def to_dict(self) -> dict[str, float | bool]:
        """As in `mat --json`."""
        return asdict(self)


def certify(
    region: Region, sites: Sites, search: BoundarySearch, graph: Graph, fit: Fit, tolerance: float
) -> Certificate:
    """Prove the transform, or raise.

    Disks are compared with the whole boundary at all vertices and at four places of every piece
    (two between lines, arcs and points); lines and parabolas, which touch both of their sites all
    along, at their middle. A site that
    reached into disks between these places would be counted twice by the area identity. Eqs. (8)
    and (9) must hold at the same places on both sides. Of more than 20,000 disks (1,000 of
    polygons) so many are compared with the whole boundary, and that the others are empty follows
    from the cells.

    Raises
    ------
    GeometryError
        With the place where it fails.
    """
    if not _euler(region, fit):
        raise GeometryError("the medial axis is not connected as its region is")
    places = _Places.of(sites, fit)
    disks, first, second = jets(fit, places.row, places.fraction, _EVERY)
    interpolation, feet = _interpolation_error(sites, places, disks)
    same = np.abs(feet - disks[:, 2]).max(axis=0)
    limit = _COMMON * tolerance
    _demand(sites, disks, interpolation, limit, "a disk of the medial axis misses its site")
    _demand(sites, disks, same, limit, "the recovered boundary is off")
    every, away = _disk_errors(sites, search, fit, places, disks, feet, tolerance)
    if len(every) > _exhaustive(sites):
        _demand_chain(sites, graph, tolerance)
        _demand_orientation(sites, fit, places, disks, limit)
    _demand(sites, every, away, tolerance, "a disk of the medial axis is off")
    left, right = envelope(disks, first, second, places.fraction)
    rows = _seen(sites, places.span, disks, left - right).nonzero()[0]
    sides = np.concatenate([left.take(rows, axis=0), right.take(rows, axis=0)])
    recovery = same.copy()
    alone = _recovery_errors(sites, search, places.take(rows), sides)
    recovery[rows] = np.maximum(same.take(rows), alone)
    area_error = abs(_cell_area(sites, graph, fit, tolerance) - region.area)
    if area_error > 10 * tolerance * search.perimeter + 1e-12 * sites.size**2:
        raise GeometryError(
            f"the cells of the medial axis differ from the area by {area_error:.3g} mm^2",
            place=tuple(sites.origin),
        )
    return Certificate(
        interpolation_error=float(interpolation.max(initial=0.0)),
        recovery_error=float(recovery.max(initial=0.0)),
        area_error=area_error,
        max_disk_error=float(away.max()),
        euler=True,
    )


def _demand(sites: Sites, disks: FloatArray, error: FloatArray, limit: float, message: str) -> None:
    """Raise at the disk with the largest error where that is above the limit, or no number."""
    if not len(error):
        return
    worst = int(np.argmax(np.where(np.isnan(error), np.inf, error)))
    if not error[worst] <= limit:
        place = tuple(disks[worst, :2] + sites.origin)
        raise GeometryError(f"{message} by {error[worst]:.3g} mm", place=place)


def _disk_errors(
    sites: Sites,
    search: BoundarySearch,
    fit: Fit,
    places: _Places,
    disks: FloatArray,
    feet: FloatArray,
    tolerance: float,
) -> tuple[FloatArray, FloatArray]:
    """Disks (n, 3) at the vertices and at places (k, 3), and what their radii are off by, (n,).

    Feet (2, k) on the sites of a piece are boundary points as well: next to centres of curvature,
    where distances are flat, they are known better than what a search finds.
    """
    vertices = np.concatenate([fit.vertex_centre, fit.vertex_radius[:, None]], axis=1)
    every = np.concatenate([vertices, disks])
    most, known = _exhaustive(sites), None
    if len(every) > most:
        at_vertices = _vertex_distance(sites, fit, tolerance)
        nearest = np.concatenate([at_vertices, feet.min(axis=0)])
        chosen = np.linspace(0, len(every) - 1, most).astype(np.int64)
    else:
        span = places.span
        beside = Feet(
            np.stack([span.site, span.partner], axis=1),
            np.stack([places.parameter, places.facing], axis=1),
            feet.T,
        )
        known = Feet.join(_vertex_feet(sites, fit), beside)
        nearest = known.distance.min(axis=1)
        chosen = np.arange(len(every))
    centre, slack = every[chosen, :2], _SLACK * tolerance
    bound = every[chosen, 2] + tolerance
    found = search.nearest(centre, slack=slack, bound=bound, feet=known)[0]
    far = (np.isinf(found) & np.isinf(nearest[chosen])).nonzero()[0]
    if len(far):
        found[far] = search.nearest(centre[far], slack=slack)[0]
    nearest[chosen] = np.minimum(nearest[chosen], found)
    return every, np.abs(nearest - every[:, 2])


def _exhaustive(sites: Sites) -> int:
    """Number of disks that are compared with the whole boundary."""
    return _EXHAUSTIVE if sites.curved else _STRAIGHT


def _euler(region: Region, fit: Fit) -> bool:
    vertices, edges = len(fit.vertex_radius), len(fit.degree)
    if vertices - edges != 1 - len(region.islands):
        return False
    rows, columns = fit.span.first, fit.span.last
    return not connected(rows, columns, vertices).any()


@dataclass(frozen=True)
class _Places(Columns):
    """Pieces (n,), their spans, fractions (n,), and the parameters of both feet (n,), at which the
    disks are tried."""

    row: IntArray
    span: Span
    fraction: FloatArray
    parameter: FloatArray
    facing: FloatArray

    @staticmethod
    def of(sites: Sites, fit: Fit) -> _Places:
        """One place on lines and parabolas, two between closed forms, else four."""
        spiral = sites.kind == SiteKind.SPIRAL
        free = spiral[fit.span.site] | spiral[fit.span.partner]
        rows, fractions = [], []
        for chosen, probes in (
            (fit.exact, _MIDDLE),
            (~fit.exact & ~free, _FEW),
            (~fit.exact & free, _PROBES),
        ):
            members = chosen.nonzero()[0]
            rows.append(np.repeat(members, len(probes)))
            fractions.append(np.tile(probes, len(members)))
        row, fraction = np.concatenate(rows), np.concatenate(fractions)
        span = fit.span.take(row)
        parameter = span.parameter(fraction[:, None])[:, 0]
        # The middle is one of the places where contacts are known.
        middle = len(rows[0])
        rest = fit.contacts(row[middle:], fraction[middle:], _EVERY)
        facing = [fit.facing[rows[0], TOP // 2], rest]
        return _Places(row, span, fraction, parameter, np.concatenate(facing))


def _vertex_feet(sites: Sites, fit: Fit) -> Feet:
    """Feet of all vertices on the sites of a piece that ends there; none without a piece."""
    span = fit.span
    vertex = np.concatenate([span.first, span.last])
    site = np.stack([np.tile(span.site, 2), np.tile(span.partner, 2)], axis=1)
    own = np.concatenate([span.start, span.end])
    other = np.concatenate([span.facing_start, span.facing_end])
    at = np.stack([own, other], axis=1)
    piece = np.full(len(fit.vertex_radius), -1)
    piece[vertex] = np.arange(len(vertex))
    held = (piece >= 0).nonzero()[0]
    shape = len(piece), 2
    feet = Feet(np.full(shape, -1), np.zeros(shape), np.full(shape, np.inf))
    feet.site[held], feet.parameter[held] = site[piece[held]], at[piece[held]]
    centre = np.repeat(fit.vertex_centre[held], 2, axis=0)
    distance = _distance(sites, feet.site[held].ravel(), centre, feet.parameter[held].ravel())
    feet.distance[held] = distance.reshape(-1, 2)
    return feet


# -- cells that cover the region once -------------------------------------------------------------


def _vertex_distance(sites: Sites, fit: Fit, tolerance: float) -> FloatArray:
    """Distances of the vertices from the nearest of the sites that their pieces touch, (v,).

    Raises
    ------
    GeometryError
        A piece that ends in a vertex whose disk misses one of its sites.
    """
    span = fit.span
    vertex = np.concatenate([span.first, span.last, span.first, span.last])
    site = np.concatenate([span.site, span.site, span.partner, span.partner])
    hint = np.concatenate([span.start, span.end, span.facing_start, span.facing_end])
    distance = _distance(sites, site, fit.vertex_centre.take(vertex, axis=0), hint)
    disks = np.concatenate([fit.vertex_centre, fit.vertex_radius[:, None]], axis=1)
    disks = disks.take(vertex, axis=0)
    missed = np.abs(distance - disks[:, 2])
    message = "a disk of the medial axis misses a site at its vertex"
    _demand(sites, disks, missed, _COMMON * tolerance, message)
    nearest = np.full(len(fit.vertex_radius), np.inf)
    np.minimum.at(nearest, vertex, distance)
    return nearest


def _demand_chain(sites: Sites, graph: Graph, tolerance: float) -> None:
    """Raise where the intervals leave some of the boundary out, or their spokes jump.

    Along every loop each interval starts where the one before ended, at the same vertex.
    """
    loop = sites.loop[graph.site]
    final = np.append(loop[1:] != loop[:-1], True)
    after = np.arange(len(loop)) + 1
    after[final] = np.append(True, final[:-1]).nonzero()[0]
    inside = ~final & (graph.site[after] == graph.site)
    goal = np.where(inside, graph.start[after], sites.high[graph.site])
    rest = np.abs(goal - graph.end) * sites.speed(graph.site, graph.end, graph.last_radius)
    ahead = np.empty(len(loop), dtype=bool)
    ahead[after] = inside
    head = np.where(ahead, 0.0, np.abs(graph.start - sites.low[graph.site]))
    rest += head * sites.speed(graph.site, graph.start, graph.first_radius)
    jump = (graph.last != graph.first[after]) | (
        ~inside & (sites.following[graph.site] != graph.site[after])
    )
    rest[jump] = np.inf
    if not np.bincount(loop, minlength=int(sites.loop.max()) + 1).all():
        raise GeometryError("a loop of the boundary has no medial axis", place=tuple(sites.origin))
    disks = np.concatenate([graph.last_centre, graph.last_radius[:, None]], axis=1)
    _demand(sites, disks, rest, tolerance, "the cells of the medial axis leave boundary out")


def _demand_orientation(
    sites: Sites, fit: Fit, places: _Places, disks: FloatArray, limit: float
) -> None:
    """Raise where a cell is turned over: an interval runs backwards or 1 - k r is negative.

    What counts is how far the centre would run backwards, from one end of the piece to the other.
    """
    span = fit.span
    back = np.maximum(span.start - span.end, span.facing_end - span.facing_start)
    ends = (
        (span, span.first_disk, span.start, span.facing_start),
        (span, span.last_disk, span.end, span.facing_end),
        (places.span, disks, places.parameter, places.facing),
    )
    # Lines and corners have no centres of curvature in front of them.
    for piece, disk, own, other in ends if sites.curved else ():
        near, *_ = motion(sites, piece.site, own, disk[:, 2])
        far, *_ = motion(sites, piece.partner, other, disk[:, 2])
        near, far = near * (piece.end - piece.start), far * (piece.facing_start - piece.facing_end)
        message = "a disk of the medial axis passes the centre of curvature of its site"
        _demand(sites, disk, -np.minimum(near, far), limit, message)
    _demand(sites, span.first_disk, back, 0.0, "a cell of the medial axis is turned over")


# -- eqs. (8) and (9) -----------------------------------------------------------------------------


def _interpolation_error(
    sites: Sites, places: _Places, disks: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Eq. (8), times r*, at places (n,): |n.(c* - c) - r*|; and distances to both feet (2, n).

    (8) takes c at the same parameter on the near side; on the far side c is the foot of c*. There
    eq. (9), |c - (c* - r* n)|, is what the distance is off by on either side: it does not count how
    far c* lies along the axis from the exact centre, as vertices between nearly parallel contacts
    are open in that direction.
    """
    span = places.span
    position, normal = sites.tangents(span.site, places.parameter)
    along = np.abs(np.einsum("ij,ij->i", normal, disks[:, :2] - position) - disks[:, 2])
    site = np.concatenate([span.site, span.partner])
    hint = np.concatenate([places.parameter, places.facing])
    distance = _distance(sites, site, np.concatenate([disks[:, :2]] * 2), hint)
    feet = distance.reshape(2, -1)
    return np.maximum(along, np.abs(feet[1] - disks[:, 2])), feet


def _distance(sites: Sites, site: IntArray, point: FloatArray, hint: FloatArray) -> FloatArray:
    """Distances of points (n, 2) from sites, (n,); spirals have their feet next to the hints.

    Two steps of Newton's method from the interpolated contact are more than rounding can tell;
    what they leave only makes the distance longer, and an error larger.
    """
    if not sites.curved:
        return sites.project(site, point, hint)[1]
    result = np.zeros(len(site))
    spiral = sites.kind[site] == SiteKind.SPIRAL
    rows = (~spiral).nonzero()[0]
    if len(rows):
        result[rows] = sites.project(site[rows], point[rows], hint[rows])[1]
    rows = spiral.nonzero()[0]
    if len(rows):
        owner, centre = site[rows], point[rows]
        curves, low, high = sites.curves(owner), sites.low[owner], sites.high[owner]
        foot = np.clip(hint[rows], low, high)
        for _ in range(2):
            place, first, second = curves.at(foot, 2)
            offset = place - centre
            flat = dot(first, first)
            curve = flat + dot(offset, second)
            # Next to a centre of curvature the full second derivative vanishes.
            curve = np.where(curve > 1e-3 * flat, curve, flat)
            foot = np.clip(foot - dot(offset, first) / curve, low, high)
        offset = curves.at(foot, 0)[0] - centre
        result[rows] = np.hypot(offset[:, 0], offset[:, 1])
    return result


def _seen(sites: Sites, span: Span, disks: FloatArray, apart: FloatArray) -> BoolArray:
    """Whether the feet of disks (n,) are `apart` (n, 2) enough for derivatives to tell them.

    Rounding of coordinates, some 1e-13 of the size, turns the tangent of a piece of length l by
    ten times that over l. Where the feet are less than a tenth of r apart, the square root of eq.
    (1) all but vanishes and enlarges whatever the derivatives are off by.
    """
    length = largest(span.last_disk - span.first_disk)
    distance = np.hypot(apart[:, 0], apart[:, 1])
    return np.asarray((length > 1e-9 * sites.size) & (distance > FEET_APART * disks[:, 2]))


def _recovery_errors(
    sites: Sites, search: BoundarySearch, places: _Places, recovered: FloatArray
) -> FloatArray:
    """Larger distance of the left and right recovered points (2 n, 2) from the boundary, (n,)."""
    span = places.span
    site = np.concatenate([span.partner, span.site])
    hint = np.concatenate([places.facing, places.parameter])
    distance = _distance(sites, site, recovered, hint)
    # The foot at a corner is the corner.
    distance[sites.kind[site] == SiteKind.POINT] = 0.0
    # Points that slid beyond the end of their site belong to the next one.
    end = np.concatenate([span.first_disk[:, 2]] * 2) * 1e-7
    rows = (distance > end).nonzero()[0]
    if len(rows):
        distance[rows] = search.nearest(recovered[rows])[0]
    return np.asarray(np.maximum(distance[: len(span)], distance[len(span) :]))


# -- area -----------------------------------------------------------------------------------------


def _cell_area(sites: Sites, graph: Graph, fit: Fit, tolerance: float) -> float:
    """Sum over the boundary of the integral of r - k r^2 / 2, fans r^2 / 2 by angle.

    Clenshaw-Curtis quadrature at the Chebyshev points at which the contacts are known. The cells of
    lines and corners in front of lines are as wide as they are long, times their mean radius.
    The cells of two corners in front of each other are triangles.
    """
    kind = sites.kind[fit.span.partner]
    simple = fit.exact & ((kind == SiteKind.LINE) | (kind == SiteKind.POINT))
    kite = fit.span.hyperbolic
    total = _kites(sites, fit.span.take(kite)) + _before_lines(sites, fit, simple.nonzero()[0])
    other = ~simple
    other[kite] = False
    rows = other.nonzero()[0]
    if len(rows):
        total += _both_sides(sites, fit, rows, tolerance)
    whole = (graph.partner == WHOLE).nonzero()[0]
    if len(whole):
        site, start, end = graph.site[whole], graph.start[whole], graph.end[whole]
        radius = graph.vertex_radius[graph.first[whole], None]
        density, _ = _density(sites, site, 0.5 * (start + end)[:, None], radius)
        total += float(np.sum(density[:, 0] * (end - start)))
    # A convex kink that is no corner turns at once: its cells overlap by a wedge.
    kink = ~sites.corner_after[graph.site] & (graph.end >= sites.high[graph.site])
    turn = sites.turn_after[graph.site[kink]]
    return total - float(np.sum(turn * graph.last_radius[kink] ** 2)) / 2


def _kites(sites: Sites, span: Span) -> float:
    """Area of what two corners and the disks at both ends of pieces between them enclose."""
    apart = sites.anchor.take(span.partner, axis=0) - sites.anchor.take(span.site, axis=0)
    along = span.last_disk[:, :2] - span.first_disk[:, :2]
    return 0.5 * float(np.sum(np.hypot(*apart.T) * np.hypot(*along.T)))


def _before_lines(sites: Sites, fit: Fit, rows: IntArray) -> float:
    """Cells on both sides of pieces `rows` between lines, or lines and corners.

    Along a line the cell is the integral of r. A corner's is that of r^2 / 2 by the angle, and the
    centre moves by r times the angle as it moves along the line: half of the same integral.
    """
    span = fit.span.take(rows)
    mean = np.zeros(len(fit.degree))
    for degree, members, table in fit.tables():
        mean[members] = table[:, :, 2].sum(axis=1) / (degree + 1)
    own = sites.length[span.site] * (span.end - span.start)
    far = sites.length[span.partner] * (span.facing_start - span.facing_end)
    width = own + np.where(sites.kind[span.partner] == SiteKind.POINT, 0.5 * own, far)
    return float(np.sum(mean[rows] * width))


def _both_sides(sites: Sites, fit: Fit, rows: IntArray, tolerance: float) -> float:
    """Cells of pieces `rows` on both sides, by values at the Chebyshev points.

    On the far side the boundary runs as the interpolated contact does. In front of a corner that
    is no polynomial, but both feet see the centre move alike across their normals: by
    ds (1 - k r) on the near side, by r times its turn at the corner.
    """
    span = fit.span.take(rows)
    nodes, weight = _PLAIN
    radius = np.zeros((len(fit.degree), TOP + 1))
    for degree, members, table in fit.tables():
        radius[members] = table[:, :, 2] @ bernstein(degree, nodes).T
    radius = np.maximum(radius[rows], 0.0)
    parameter = span.parameter(nodes)
    near, moved = _density(sites, span.site, parameter, radius)
    length = (span.end - span.start)[:, None]
    pace = -differentiate_values(fit.facing[rows][..., None])[..., 0]
    facing = np.clip(fit.facing[rows], span.facing_end[:, None], span.facing_start[:, None])
    far, _ = _density(sites, span.partner, facing, radius)
    point = (sites.kind[span.partner] == SiteKind.POINT)[:, None]
    far = np.where(point, 0.5 * radius * moved * length, far * pace)
    rough = _rough(sites, fit, rows, tolerance) & ~point[:, 0]
    # Along an arc that is nearly an arc of contact the feet race, unseen by 13 of them; in front
    # of a parabola they were not asked for.
    rounded = (sites.kind[span.partner] == SiteKind.ARC) & (sites.extent[span.partner, 1] > 0)
    close = radius.max(axis=1) > 0.9 * sites.radius[span.partner]
    arc = rounded & (close | fit.exact[rows])
    rough = (rough | arc).nonzero()[0]
    far[rough] = 0.0
    total = float(np.sum((near * length + far) @ weight))
    astray = np.any(np.diff(fit.facing[rows[rough]], axis=1) > 1e-9, axis=1)
    kind = sites.kind
    spirals = (kind[span.site] == SiteKind.SPIRAL) & (kind[span.partner] == SiteKind.SPIRAL)
    plain = spirals[rough] & ~astray
    for members, rule in ((rough[plain], _PLAIN), (rough[~plain], _CROWDED)):
        if len(members):
            total += _from_partner(sites, span.take(members), fit.facing[rows[members]], *rule)
    return total


def _from_partner(
    sites: Sites, span: Span, facing: FloatArray, fraction: FloatArray, weight: FloatArray
) -> float:
    """Cells on the far side of pieces, whose contacts (k, 13) are expected at `facing`.

    By quadrature at fractions (n,) of the partner.
    """
    other = span.swapped()
    parameter = other.parameter(fraction)
    cell = (facing[:, None, :] > parameter[:, :, None]).sum(axis=2) - 1
    cell = np.clip(cell, 0, TOP - 1)
    row = np.arange(len(span))[:, None]
    step = np.maximum(facing[row, cell] - facing[row, cell + 1], 1e-300)
    share = np.clip((facing[row, cell] - parameter) / step, 0.0, 1.0)
    hint = span.parameter(NODES[cell] + share * np.diff(NODES)[cell])
    disks, _ = evaluate_span(sites, other, fraction, hint)
    reach = np.nan_to_num(disks[..., 2], posinf=0.0)
    density, _ = _density(sites, other.site, parameter, reach)
    return float(np.sum((density @ weight) * (other.end - other.start)))


def _rough(sites: Sites, fit: Fit, rows: IntArray, tolerance: float) -> BoolArray:
    """(k,) whether the contact of a piece is resolved worse than the piece itself.

    So it is where the partner's centre of curvature comes close to the axis. Where it is not
    even resolved as to its direction it runs to and fro.
    """
    span = fit.span.take(rows)
    astray = np.any(np.diff(fit.facing[rows], axis=1) > 1e-9, axis=1)
    tail = np.abs(coefficients(fit.facing[rows][..., None])[:, -2:, 0]).sum(axis=1)
    middle = 0.5 * (span.facing_start + span.facing_end)
    unresolved = tail * sites.speed(span.partner, middle, span.first_disk[:, 2]) > tolerance
    return np.asarray(unresolved | astray)


def _density(
    sites: Sites, site: IntArray, parameter: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Area of the cells of `site` (k,) and motion of the centre per unit of parameter, (k, n)."""
    shape = parameter.shape
    owner, flat = np.repeat(site, shape[1]), parameter.ravel()
    reach = radius.ravel()
    moved, curvature, speed, _ = motion(sites, owner, flat, reach)
    point = sites.kind[owner] == SiteKind.POINT
    bend = np.where(point, 0.0, curvature)
    share = np.where(point, 0.5 * reach, reach - bend * reach**2 / 2)
    return (share * speed).reshape(shape), moved.reshape(shape)
