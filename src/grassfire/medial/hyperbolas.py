"""Edges between two reflex corners: straight lines along which the radius is a hyperbola.

Between corners p and q, 2 h apart, the axis runs across the middle of pq: at t from there the
radius is sqrt(h^2 + t^2). With t = h sinh s it is h cosh s, and both are entire functions of the
hyperbolic angle s, along which they are interpolated. The normals at the corners turn by the
Gudermannian of s, whose poles make interpolation by the angle of the normal slow where the edge
leaves the corners far behind. All is known in closed form, errors of interpolation included.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import factorial

import numpy as np

from grassfire.geometry.chebyshev import interpolate_to_bezier, nodes
from grassfire.medial.columns import Columns
from grassfire.medial.edges import DEGREES, NODES, TOP, Span
from grassfire.medial.interpolants import Interpolants, cut_span, deviation_limit
from grassfire.medial.sites import FloatArray, IntArray, SiteKind, Sites, dot, largest

_LEAST = 1e-3
"""Ranges of the hyperbolic angle below which even steps of the parameter are as good."""

_MOST_PARTS = 16
"""Of one edge: more than the range of doubles asks for at any sensible tolerance."""


@dataclass(frozen=True)
class _Hyperbolas(Columns):
    """Stretches between two corners: the middle (k, 2) of the corners, half of what they are apart
    (k,), the direction (k, 2) of the axis, and the hyperbolic angles at both ends (k,)."""

    middle: FloatArray
    half: FloatArray
    along: FloatArray
    first: FloatArray
    last: FloatArray

    @staticmethod
    def of(sites: Sites, span: Span) -> _Hyperbolas:
        """Edges between two corners."""
        one, two = (sites.anchor.take(site, axis=0) for site in (span.site, span.partner))
        apart = two - one
        half = 0.5 * np.hypot(apart[:, 0], apart[:, 1])
        along = np.stack([-apart[:, 1], apart[:, 0]], axis=1) / (2 * half)[:, None]
        middle = 0.5 * (one + two)
        first, last = (
            np.arcsinh(dot(disk[:, :2] - middle, along) / half)
            for disk in (span.first_disk, span.last_disk)
        )
        return _Hyperbolas(middle, half, along, first, last)

    def between(self, row: IntArray, low: FloatArray, high: FloatArray) -> _Hyperbolas:
        """Stretches `row` from fraction `low` to `high`."""
        part = self.take(row)
        width = part.last - part.first
        return replace(part, first=part.first + width * low, last=part.first + width * high)

    def angles(self, fraction: FloatArray) -> FloatArray:
        """(n, k) hyperbolic angles at fractions (n,)."""
        return self.first + (self.last - self.first) * fraction[:, None]

    def disks(self, sine: FloatArray, cosine: FloatArray) -> FloatArray:
        """(k, n, 3) disks (x, y, r) of hyperbolic sines and cosines (n, k)."""
        result = np.empty((*sine.T.shape, 3))
        away = self.half * sine
        for axis in (0, 1):
            result[..., axis] = (self.middle[:, axis] + away * self.along[:, axis]).T
        result[..., 2] = (self.half * cosine).T
        return result

    def ends(self) -> FloatArray:
        """(k, 2, 3) disks at both ends."""
        angles = self.angles(np.array([0.0, 1.0]))
        return self.disks(np.sinh(angles), np.cosh(angles))

    def errors(self, degrees: tuple[int, ...]) -> FloatArray:
        """(k, d) bounds of what interpolation at Chebyshev points is off by, mm.

        |f^(n + 1)| / (n + 1)! times 4 (w / 4)^(n + 1), which the product of the distances from the
        points of eq. (7) does not exceed on a range of width w.
        """
        largest = self.half * np.cosh(np.maximum(np.abs(self.first), np.abs(self.last)))
        quarter = 0.25 * np.abs(self.last - self.first)
        bounds = [largest * 4 * quarter ** (n + 1) / factorial(n + 1) for n in degrees]
        return np.stack(bounds, axis=1)

    def limits(self, degrees: tuple[int, ...], tolerance: float) -> FloatArray:
        """(k, d) errors that are good enough."""
        ends, even = self.ends(), np.ones(len(self.half))
        goal = np.full(len(even), tolerance)
        return deviation_limit(ends[:, 0], ends[:, 1], goal, even, np.array(degrees))


def between_corners(
    sites: Sites, span: Span, tolerance: float, count: int
) -> tuple[Interpolants, FloatArray, Span]:
    """Interpolate the edges between two corners.

    Parameters
    ----------
    sites : Sites
    span : Span
        All edges.
    tolerance : float
        Deviation of centre and radius to aim at, mm.
    count : int
        Number of the first joint.

    Returns
    -------
    Interpolants
        Edges between two corners, in as many parts as the tolerance asks for.
    (j, 3) float array
        Disks at the joints between the parts.
    Span
        The other edges, and those whose ends are not in front of both of their corners.
    """
    point = sites.kind == SiteKind.POINT
    rows = (point[span.site] & point[span.partner]).nonzero()[0]
    shape = _Hyperbolas.of(sites, span.take(rows))
    known = np.stack([span.first_disk[rows], span.last_disk[rows]], axis=1)
    away = largest((shape.ends() - known).reshape(-1, 6))
    number = _numbers(shape, tolerance)
    number[~(away <= 0.1 * tolerance) | (np.abs(shape.last - shape.first) <= _LEAST)] = 0
    kept = np.ones(len(span), dtype=bool)
    kept[rows[number > 0]] = False
    row, low, high = _even_parts(number)
    whole = replace(span.take(rows), angle_start=shape.first, angle_end=shape.last).take(row)
    shape, inner = shape.between(row, low, high), (low > 0).nonzero()[0]
    between = shape.take(inner).ends()[:, 0]
    facing = _facing(whole.take(inner), low[inner, None])[:, 0]
    parts = cut_span(whole, low, high, inner, between, facing, count)
    return _interpolated(parts, shape, tolerance), between, span.take(kept)


def _numbers(shape: _Hyperbolas, tolerance: float) -> IntArray:
    """(k,) parts of edges, even in the angle, for which the highest degree is good enough; or 0."""
    number = np.zeros(len(shape.half), dtype=np.int64)
    left = np.arange(len(number))
    for parts in range(1, _MOST_PARTS + 1):
        row, low, high = _even_parts(np.full(len(left), parts))
        part = shape.between(left[row], low, high)
        good = part.errors((TOP,)) <= part.limits((TOP,), tolerance)
        every = np.all(good.reshape(-1, parts), axis=1)
        number[left[every]] = parts
        left = left[~every]
        if not len(left):
            break
    return number


def _even_parts(number: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Rows in `number` (k,) even parts each: row and range of fractions."""
    row = np.repeat(np.arange(len(number)), number)
    index = np.arange(len(row)) - np.repeat(np.cumsum(number) - number, number)
    return row, index / number[row], (index + 1) / number[row]


def _facing(span: Span, fraction: FloatArray) -> FloatArray:
    """(k, n) contacts on the partners at fractions (n,) or (k, n)."""
    step = span.facing_end - span.facing_start
    return np.asarray(span.facing_start[:, None] + step[:, None] * span.share(fraction))


def _interpolated(span: Span, shape: _Hyperbolas, tolerance: float) -> Interpolants:
    """The lowest degrees that are good enough."""
    errors = shape.errors(DEGREES)
    lowest = np.argmax(errors <= shape.limits(DEGREES, tolerance), axis=1)
    table = np.zeros((len(span), TOP + 1, 3))
    for column in np.bincount(lowest).nonzero()[0]:
        degree, members = DEGREES[column], (lowest == column).nonzero()[0]
        part = shape.take(members)
        angles = part.angles(nodes(degree))
        sine, cosine = (interpolate_to_bezier(f(angles)) for f in (np.sinh, np.cosh))
        table[members, : degree + 1] = part.disks(sine, cosine)
        table[members, 0] = span.first_disk[members]
        table[members, degree] = span.last_disk[members]
    return Interpolants(
        span=span,
        degree=np.array(DEGREES)[lowest],
        table=table,
        error=errors[np.arange(len(span)), lowest],
        facing=_facing(span, NODES),
    )
