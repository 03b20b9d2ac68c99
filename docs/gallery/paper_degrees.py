"""One polynomial per edge, as in Dorado 2009: eq. (6) solved at the Chebyshev points of eq. (7).

Only curves are used here, not the engine: that makes it a second opinion on the engine's axes,
and shows what a polynomial of a given degree is worth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grassfire.errors import GeometryError
from grassfire.geometry import Loop, curvature_extrema
from grassfire.geometry.chebyshev import evaluate_bezier, interpolate_to_bezier, nodes

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SAMPLES = 400
"""Parameters at which the errors of a polynomial are looked at."""


ACCURACY = 1e-8
"""Last step of Newton's method that counts as converged, mm: that of the paper."""


@dataclass(frozen=True)
class Side:
    """The boundary on one side of an edge: u runs from `start` to `end`, ascending.

    On the other side the parameter runs from `facing_start` down to `facing_end`; both are
    parameters of the loop, which may pass the loop's start.
    """

    loop: Loop
    start: float
    end: float
    facing_start: float
    facing_end: float

    def point(self, u: FloatArray) -> FloatArray:
        """Boundary points (n, 2)."""
        return np.asarray(self.loop.point(np.mod(u, len(self.loop))))

    def normal(self, u: FloatArray) -> FloatArray:
        """Inward unit normals (n, 2)."""
        return np.asarray(self.loop.normal(np.mod(u, len(self.loop))))


@dataclass(frozen=True)
class Polynomial:
    """A polynomial edge and what it is worth.

    Attributes
    ----------
    degree : int
    coefficients : tuple of (degree + 1, 3) float arrays
        Bezier coefficients (x, y, r), mm; one array a piece.
    interpolation_error : float
        Largest s of eq. (8); no unit.
    boundary_error : float
        Largest distance of eq. (9) on both sides, mm.
    recovered : (2, n, 2) float array
        The boundary recovered by eq. (1) on both sides, mm.
    """

    degree: int
    coefficients: tuple[FloatArray, ...]
    interpolation_error: float
    boundary_error: float
    recovered: FloatArray


def whole_edge(loop: Loop, first: ArrayLike, last: ArrayLike) -> Side:
    """The side of a fundamental domain between two terminal points, given by their centres (2,).

    Paper, section 4.1: the terminals sit at corners and where the curvature is greatest.
    """
    start, end = terminal_parameter(loop, first), terminal_parameter(loop, last)
    count = float(len(loop))
    if end <= start:
        start, end = end, start
    return Side(loop, start, end, start + count, end)


def terminal_parameter(loop: Loop, centre: ArrayLike) -> float:
    """Boundary parameter whose osculating circle, or corner, is centred at `centre` (2,)."""
    candidates = [
        index + np.concatenate([[0.0], curvature_extrema(curve)])
        for index, curve in enumerate(loop.curves)
    ]
    u = np.concatenate(candidates)
    point, curvature = loop.point(u), loop.curvature(u)
    reach = np.divide(1.0, curvature, out=np.zeros_like(u), where=curvature > 0)
    osculating = point + reach[:, None] * loop.normal(u)
    away = np.minimum(
        np.linalg.norm(osculating - np.asarray(centre), axis=1),
        np.linalg.norm(point - np.asarray(centre), axis=1),
    )
    return float(u[np.argmin(away)])


def self_intersections(side: Side, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve eq. (6), c(u) + d n(u) = c(v) + d n(v), for v and d at the parameters u.

    Returns
    -------
    (n, 3) disks (x, y, d), mm, and (n,) parameters v

    Raises
    ------
    GeometryError
        When Newton's method does not converge.
    """
    inner = (u > side.start) & (u < side.end)
    point, normal = side.point(u), side.normal(u)
    v = np.where(u <= side.start, side.facing_start, side.facing_end)
    distance = np.zeros_like(u)
    v[inner], distance[inner] = _least_disks(side, point[inner], normal[inner])
    rest, before = np.inf, np.inf
    for _ in range(40):
        step = _newton_step(side, point[inner], normal[inner], v[inner], distance[inner])
        # At most an eighth of the way between the two contacts: v must not run into u.
        bound = np.abs(v[inner] - u[inner]) / 8
        v[inner] -= np.clip(step[:, 0], -bound, bound)
        distance[inner] -= step[:, 1]
        rest, before = float(np.max(np.abs(step[:, 1]), initial=0.0)), rest
        settled = rest <= ACCURACY and rest > before / 2
        if settled or rest <= 1e-12 or not np.isfinite(step).all():
            break
    if not rest <= ACCURACY:
        raise GeometryError("the self-intersections of the offsets do not converge")
    _terminals(side, u, ~inner, distance)
    return np.column_stack([point + distance[:, None] * normal, distance]), v


def _least_disks(
    side: Side, point: FloatArray, normal: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """First values of v and d: the least disk through samples of the other side.

    The disk tangent at p that reaches q has the radius |q - p|^2 / (2 n.(q - p)).
    """
    v = nodes(SAMPLES, side.facing_end, side.facing_start)
    away = side.point(v) - point[:, None]
    height = np.einsum("ijk,ik->ij", away, normal)
    square = np.einsum("ijk,ijk->ij", away, away)
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.where(height > 1e-9 * np.sqrt(square), square / (2 * height), np.inf)
    best = np.argmin(radius, axis=1)
    least = radius[np.arange(len(point)), best]
    if not np.isfinite(least).all():
        place = point[np.argmax(least)]
        raise GeometryError("nothing on the other side faces the boundary", place=tuple(place))
    return v[best], least


def _newton_step(
    side: Side, point: FloatArray, normal: FloatArray, v: FloatArray, distance: FloatArray
) -> FloatArray:
    """(n, 2) steps of (v, d): the gap of eq. (6) against its derivatives by v and d.

    The derivative of c + d n is c' (1 - d k), from eq. (4).
    """
    place = np.mod(v, len(side.loop))
    facing, slope = side.loop.evaluate(place, 1)
    across = side.loop.normal(place)
    gap = facing + distance[:, None] * across - point - distance[:, None] * normal
    by_v = slope * (1 - distance * side.loop.curvature(place))[:, None]
    by_d = across - normal
    matrix = np.stack([by_v, by_d], axis=2)
    return np.asarray(np.linalg.solve(matrix, gap[:, :, None])[:, :, 0])


def _terminals(side: Side, u: FloatArray, outer: BoolArray, distance: FloatArray) -> None:
    """Radii at the terminals: of curvature at smooth ends, 0 in corners."""
    ends = np.flatnonzero(outer)
    if not len(ends):
        return
    before = side.loop.tangent(np.mod(u[ends] - 1e-9, len(side.loop)))
    after = side.loop.tangent(np.mod(u[ends] + 1e-9, len(side.loop)))
    corner = np.linalg.norm(after - before, axis=1) > 1e-3
    curvature = side.loop.curvature(np.mod(u[ends], len(side.loop)))
    distance[ends] = np.where(corner, 0.0, 1 / curvature)


def fit_degrees(
    side: Side, degrees: Sequence[int], breaks: ArrayLike = ()
) -> tuple[Polynomial, ...]:
    """Interpolate the edge with polynomials of each degree: one, or one between any two breaks."""
    edges = np.concatenate([[side.start], np.asarray(breaks, dtype=np.float64), [side.end]])
    intervals = list(pairwise(edges))
    inner = np.linspace(0, 1, max(12, SAMPLES // len(intervals)) + 2)[1:-1]
    fractions = [inner, *(nodes(degree) for degree in degrees)]
    u = [[low + (high - low) * each for low, high in intervals] for each in fractions]
    # Eq. (6) is solved for all degrees and pieces at once.
    disks, facing = self_intersections(side, np.concatenate([part for row in u for part in row]))
    counts = [len(part) for row in u for part in row]
    solved = np.split(disks, np.cumsum(counts)[:-1])
    samples = np.concatenate(u[0])
    contacts = (samples, facing[: len(samples)])
    result = []
    for index, degree in enumerate(degrees, start=1):
        values = solved[index * len(intervals) : (index + 1) * len(intervals)]
        table = tuple(interpolate_to_bezier(each) for each in values)
        fitted = np.concatenate([evaluate_bezier(each, inner) for each in table])
        recovered = np.stack(
            [fitted[:, :2] - fitted[:, 2:] * side.normal(each) for each in contacts]
        )
        away = recovered - np.stack([side.point(each) for each in contacts])
        share = _interpolation_error(side, samples, fitted)
        error = float(np.linalg.norm(away, axis=2).max())
        result.append(Polynomial(degree, table, share, error, recovered))
    return tuple(result)


def _interpolation_error(side: Side, u: FloatArray, disks: FloatArray) -> float:
    """Eq. (8): largest |1 - n.(c* - c) / r*|."""
    along = np.sum(side.normal(u) * (disks[:, :2] - side.point(u)), axis=1)
    return float(np.abs(1 - along / disks[:, 2]).max())


def knot_breaks(side: Side) -> FloatArray:
    """Parameters between which the edge is smooth: knots of this side, images of the others."""
    loop = side.loop
    knots = np.concatenate([index + _breaks(curve)[:-1] for index, curve in enumerate(loop.curves)])
    own = _between(knots, side.start, side.end, len(loop))
    other = _between(knots, side.facing_end, side.facing_start, len(loop))
    swapped = Side(loop, side.facing_end, side.facing_start, side.end, side.start)
    _, image = self_intersections(swapped, other)
    breaks = np.sort(np.concatenate([own, image]))
    # A knot next to a terminal or to another break hardly matters, but eq. (6) is ill-conditioned
    # on a piece that short.
    least = 1e-4 * (side.end - side.start)
    apart = np.diff(breaks, prepend=side.start) > least
    return np.asarray(breaks[apart & (breaks < side.end - least)])


def _breaks(curve: object) -> FloatArray:
    breaks = getattr(curve, "breaks", None)
    return np.asarray(breaks()) if breaks is not None else np.array([0.0, 1.0])


def _between(values: FloatArray, low: float, high: float, period: int) -> FloatArray:
    every = np.concatenate([values - period, values, values + period, values + 2 * period])
    return np.unique(every[(every > low + 1e-9) & (every < high - 1e-9)])
