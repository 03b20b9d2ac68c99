"""The certificate: an answer that proves itself, or an error that says where it does not."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from grassfire.errors import GeometryError
from grassfire.geometry import Region
from grassfire.geometry.chebyshev import bernstein
from grassfire.medial.edges import Fit, Span, evaluate_span
from grassfire.medial.graph import Graph
from grassfire.medial.search import BoundarySearch
from grassfire.medial.sites import FloatArray, IntArray, SiteKind, Sites
from grassfire.medial.topology import WHOLE

_PROBES = np.array([0.0, 0.07, 0.21, 0.4, 0.5, 0.63, 0.82, 0.95, 1.0])


@dataclass(frozen=True)
class Certificate:
    """What was proved about a medial axis transform.

    Attributes
    ----------
    interpolation_error : float
        Largest |1 - n.(c* - c) / r*| of eq. (8) of Dorado 2009, times r*: mm.
    recovery_error : float
        Largest distance between the boundary and the boundary recovered by eqs. (1) and (9), mm.
    area_error : float
        Difference between the area of the region and that of the disks' cells, mm^2.
    max_disk_error : float
        Largest difference between r* and the distance of c* to the whole boundary, mm.
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

    Raises
    ------
    GeometryError
        With the place where it fails.
    """
    euler = _euler(region, fit)
    if not euler:
        raise GeometryError("the medial axis is not connected as its region is")
    centre, radius = fit.vertex_centre, fit.vertex_radius
    interpolation = recovery = 0.0
    if len(fit.degree):
        disks, slope = _probe(fit)
        interpolation = _interpolation_error(sites, fit.span, disks)
        recovery = _recovery_error(sites, fit.span, disks, slope, tolerance)
        centre = np.concatenate([centre, disks[:, :, :2].reshape(-1, 2)])
        radius = np.concatenate([radius, disks[:, :, 2].ravel()])
    distance, _, _ = search.nearest(centre)
    error = np.abs(distance - radius)
    worst = int(np.argmax(error))
    if error[worst] > tolerance:
        raise GeometryError(
            f"a disk of the medial axis is off by {error[worst]:.3g} mm",
            place=tuple(centre[worst] + sites.origin),
        )
    area_error = abs(_cell_area(sites, graph, fit) - region.area)
    limit = 10 * tolerance * search.perimeter + 1e-12 * sites.size**2
    if area_error > limit:
        raise GeometryError(
            f"the cells of the medial axis differ from the area by {area_error:.3g} mm^2",
            place=tuple(sites.origin),
        )
    return Certificate(interpolation, recovery, area_error, float(error[worst]), euler)


def _euler(region: Region, fit: Fit) -> bool:
    vertices, edges = len(fit.vertex_radius), len(fit.degree)
    if vertices - edges != 1 - len(region.islands):
        return False
    rows, columns = fit.span.first, fit.span.last
    matrix = coo_matrix((np.ones(edges), (rows, columns)), shape=(vertices, vertices))
    count, _ = connected_components(matrix, directed=False)
    return bool(count == 1)


def _probe(fit: Fit) -> tuple[FloatArray, FloatArray]:
    """(k, n, 3) disks at the probes and their derivatives by the fraction."""
    count = len(fit.degree)
    disks = np.zeros((count, len(_PROBES), 3))
    slope = np.zeros_like(disks)
    for degree in np.unique(fit.degree):
        rows = np.flatnonzero(fit.degree == degree)
        table = np.stack([fit.coefficients[row] for row in rows])
        disks[rows] = bernstein(int(degree), _PROBES) @ table
        difference = degree * np.diff(table, axis=1)
        slope[rows] = bernstein(int(degree) - 1, _PROBES) @ difference
    return disks, slope


def _frames(sites: Sites, span: Span) -> tuple[FloatArray, FloatArray]:
    width = len(_PROBES)
    parameter = span.start[:, None] + (span.end - span.start)[:, None] * _PROBES
    position, normal, _ = sites.frame(np.repeat(span.site, width), parameter.ravel())
    return position.reshape(-1, width, 2), normal.reshape(-1, width, 2)


def _interpolation_error(sites: Sites, span: Span, disks: FloatArray) -> float:
    """Eq. (8), times r*: how far n.(c* - c) is from r*."""
    position, normal = _frames(sites, span)
    along = np.einsum("kni,kni->kn", normal, disks[:, :, :2] - position)
    return float(np.abs(along - disks[:, :, 2]).max())


def _recovery_error(
    sites: Sites, span: Span, disks: FloatArray, slope: FloatArray, tolerance: float
) -> float:
    """Eq. (9): boundary from eq. (1), the envelope of the disks, against the boundary.

    c = m - r (r' m' -+ sqrt(|m'|^2 - r'^2) J m') / |m'|^2, on the side of the span. Probes
    where the axis stands still (the ends of smooth branches), or pieces shorter than a thousand
    tolerances, determine no envelope and are left out.
    """
    position, _ = _frames(sites, span)
    axis, radius = slope[:, :, :2], slope[:, :, 2]
    square = np.einsum("kni,kni->kn", axis, axis)
    fastest = np.sqrt(square.max(axis=1, keepdims=True))
    steady = square > np.maximum(0.1 * fastest, 1e3 * tolerance) ** 2
    safe = np.where(steady, square, 1.0)
    root = np.sqrt(np.maximum(safe - radius**2, 0.0))
    across = np.stack([-axis[:, :, 1], axis[:, :, 0]], axis=2)
    best = np.full(square.shape, np.inf)
    for sign in (1.0, -1.0):
        direction = radius[:, :, None] * axis + sign * root[:, :, None] * across
        recovered = disks[:, :, :2] - disks[:, :, 2:] * direction / safe[:, :, None]
        away = recovered - position
        best = np.minimum(best, np.hypot(away[:, :, 0], away[:, :, 1]))
    # Tangent disks leave root ~ sqrt(rounding): only well-seen probes measure the fit.
    seen = steady & (root > 1e-2 * np.sqrt(safe))
    seen[:, [0, -1]] = False
    return float(best[seen].max()) if seen.any() else 0.0


def _cell_area(sites: Sites, graph: Graph, fit: Fit) -> float:
    """Sum over the boundary of the integral of r - k r^2 / 2, fans r^2 / 2 by angle."""
    node, weight = np.polynomial.legendre.leggauss(14)
    fraction, weight = 0.5 * (node + 1), 0.5 * weight
    total = 0.0
    for span in (fit.span, fit.span.swapped()) if len(fit.degree) else ():
        disks, _ = evaluate_span(sites, span, fraction)
        total += _side_area(
            sites, span.site, span.start, span.end, disks[:, :, 2], fraction, weight
        )
    whole = np.flatnonzero(graph.partner == WHOLE)
    if len(whole):
        radius = np.repeat(graph.vertex_radius[graph.first[whole], None], len(fraction), axis=1)
        total += _side_area(
            sites, graph.site[whole], graph.start[whole], graph.end[whole], radius, fraction, weight
        )
    # A convex kink that is no corner turns at once: its cells overlap by a wedge.
    kink = ~sites.corner_after[graph.site] & (graph.end >= sites.high[graph.site])
    turn = sites.turn_after[graph.site[kink]]
    return total - float(np.sum(turn * graph.last_radius[kink] ** 2)) / 2


def _side_area(
    sites: Sites,
    site: IntArray,
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    fraction: FloatArray,
    weight: FloatArray,
) -> float:
    width = len(fraction)
    parameter = (start[:, None] + (end - start)[:, None] * fraction).ravel()
    rows = np.repeat(site, width)
    first = sites.derivatives(rows, parameter, 1)[1]
    _, _, curvature = sites.frame(rows, parameter)
    speed = np.hypot(first[:, 0], first[:, 1])
    flat = radius.ravel()
    flat = np.where(np.isfinite(flat), flat, 0.0)
    fan = sites.kind[rows] == SiteKind.POINT
    bend = np.where(fan, 0.0, curvature)
    density = (flat - bend * flat**2 / 2) * speed
    density = np.where(fan, flat**2 / 2 * np.abs(sites.extent[rows, 1]), density)
    scaled = density.reshape(-1, width) @ weight
    return float(np.sum(scaled * (end - start)))
