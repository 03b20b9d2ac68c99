"""B-spline curves of any degree, rational (NURBS) too."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from grassfire.errors import GeometryError
from grassfire.geometry.bezier import (
    Bezier,
    blend_ends,
    checked_weights,
    from_homogeneous,
    homogeneous,
    project,
)
from grassfire.geometry.chebyshev import bernstein_family, differentiate_bezier
from grassfire.geometry.curve import Curve, FloatArray, affine_parts, check_range, frozen_array


def blossom(
    degree: int, knots: FloatArray, control: FloatArray, span: np.ndarray, arguments: FloatArray
) -> FloatArray:
    """Return the polar form of B-spline segments (Ramshaw 1989), a row each.

    Parameters
    ----------
    span : (m,) int array
        Index j of a non-empty knot span [knots[j], knots[j+1]).
    arguments : (m, degree) array
        The blossom's arguments.

    Returns
    -------
    (m, k) array
    """
    index = span[:, None] - degree + np.arange(degree + 1)
    values = control[index]
    for level in range(1, degree + 1):
        inner = np.arange(level, degree + 1)
        low = knots[span[:, None] - degree + inner]
        high = knots[span[:, None] + 1 + inner - level]
        share = ((arguments[:, level - 1 : level] - low) / (high - low))[..., None]
        values = (1.0 - share) * values[:, :-1] + share * values[:, 1:]
    return np.asarray(values[:, 0])


@dataclass(frozen=True, eq=False)
class BSpline(Curve):
    """A B-spline curve; t in [0, 1] maps linearly to the knots' range of definition.

    Parameters
    ----------
    degree : int
        At least 1.
    knots : (n + degree + 1,) array_like
        Non-decreasing; defined on [knots[degree], knots[n]]. Need not be clamped.
    control_points : (n, 2) array_like
        In mm.
    weights : (n,) array_like, optional
        Positive; equal weights are dropped.

    Raises
    ------
    GeometryError
        For a wrong count of knots, decreasing knots, a knot repeated more than degree + 1 times
        (degree times inside the range, where the curve would come apart), an empty range, values
        that are not finite, weights that are not positive, or a curve that is one point.

    Notes
    -----
    The Bezier segments are computed once by blossoming; evaluation is a Bernstein sum of the
    segment that holds t, the right one at a knot.
    """

    degree: int
    knots: FloatArray
    control_points: FloatArray
    weights: FloatArray | None = None

    def __post_init__(self) -> None:
        points = frozen_array(self.control_points, (None, 2), "control points")
        knots = frozen_array(self.knots, (None,), "knots")
        object.__setattr__(self, "control_points", points)
        object.__setattr__(self, "knots", knots)
        object.__setattr__(self, "weights", checked_weights(self.weights, len(points)))
        _check_knots(self.degree, knots, len(points))
        if np.all(points == points[0]):
            raise GeometryError("a B-spline must not be one point", place=points[0].tolist())

    @property
    def domain(self) -> tuple[float, float]:
        """First and last knot of the range of definition."""
        return float(self.knots[self.degree]), float(self.knots[len(self.control_points)])

    @property
    def singular_order(self) -> int:
        """Highest derivative that can be the first that does not vanish."""
        return max(3, self.degree)

    @cached_property
    def size(self) -> float:
        """Diagonal of the control polygon's box, in mm."""
        return float(np.hypot(*np.ptp(self.control_points, axis=0)))

    @cached_property
    def _segments(self) -> tuple[FloatArray, FloatArray]:
        """Knots (m + 1,) without repetition, and homogeneous Bezier coefficients (m, p+1, k)."""
        degree, count = self.degree, len(self.control_points)
        span = np.arange(degree, count)
        span = span[self.knots[span] < self.knots[span + 1]]
        low, high = self.knots[span], self.knots[span + 1]
        control = homogeneous(self.control_points, self.weights)
        columns = []
        for index in range(degree + 1):
            arguments = np.repeat(low[:, None], degree, axis=1)
            arguments[:, degree - index :] = high[:, None]
            columns.append(blossom(degree, self.knots, control, span, arguments))
        return np.append(low, high[-1]), np.stack(columns, axis=1)

    @cached_property
    def _hodographs(self) -> list[FloatArray]:
        """Coefficients of the segments' derivatives with respect to t, extended when asked."""
        return [self._segments[1]]

    def _hodograph(self, order: int) -> FloatArray:
        table, edges = self._hodographs, self._segments[0]
        scale = ((edges[-1] - edges[0]) / np.diff(edges))[:, None, None]
        while len(table) <= order:
            table.append(differentiate_bezier(table[-1]) * scale)
        return table[order]

    def segment_coefficients(self) -> FloatArray:
        """Return Bezier coefficients (m, degree + 1, 2), or (..., 3) homogeneous, per span."""
        return self._segments[1]

    def breaks(self) -> FloatArray:
        """Return the distinct knots mapped to [0, 1]."""
        return self._breaks

    @cached_property
    def _breaks(self) -> FloatArray:
        edges = self._segments[0]
        result = np.asarray((edges - edges[0]) / (edges[-1] - edges[0]))
        result[-1] = 1.0
        result.setflags(write=False)
        return result

    def evaluate(self, t: ArrayLike, order: int = 0) -> tuple[FloatArray, ...]:
        """Return the point and the derivatives up to any `order`, each (..., 2)."""
        parameter = np.asarray(t, dtype=np.float64)
        edges = self._breaks
        piece = np.clip(np.searchsorted(edges, parameter, side="right") - 1, 0, len(edges) - 2)
        low, high = edges[piece], edges[piece + 1]
        local = np.where(parameter == high, 1.0, (parameter - low) / (high - low))
        values: list[FloatArray] = []
        for level, weights in enumerate(bernstein_family(self.degree, local, order)):
            control = self._hodograph(level)[piece]
            values.append(np.einsum("...i,...ik->...k", weights, control))
        return tuple(values) if self.weights is None else project(values)

    def reversed(self) -> BSpline:
        """Return the curve run backwards."""
        weights = None if self.weights is None else self.weights[::-1]
        knots = self.knots[0] + self.knots[-1] - self.knots[::-1]
        return BSpline(self.degree, knots, self.control_points[::-1], weights)

    def subcurve(self, t0: float, t1: float) -> BSpline:
        """Return the part from t0 to t1, clamped, of the same degree."""
        check_range(t0, t1)
        if t0 > t1:
            return self.subcurve(t1, t0).reversed()
        low, high = self.domain
        first = low + t0 * (high - low) if t0 > 0.0 else low
        last = low + t1 * (high - low) if t1 < 1.0 else high
        degree, knots = self.degree, self.knots
        # A sliver next to a knot would be a segment of no length: the knot gives way.
        margin = 1e-14 * (high - low)
        inner = knots[(knots > first + margin) & (knots < last - margin)]
        new = np.concatenate([np.full(degree + 1, first), inner, np.full(degree + 1, last)])
        count = len(new) - degree - 1
        index = np.arange(count)
        # Any non-empty new span under basis function i serves; take the first at or after it.
        spans = np.flatnonzero(new[:-1] < new[1:])
        chosen = spans[np.searchsorted(spans, index)]
        middle = 0.5 * (new[chosen] + new[chosen + 1])
        span = np.searchsorted(knots, middle, side="right") - 1
        arguments = new[index[:, None] + 1 + np.arange(degree)]
        control = homogeneous(self.control_points, self.weights)
        moved = blossom(degree, knots, control, span, arguments)
        if self.weights is None:
            return BSpline(degree, new, moved)
        return BSpline(degree, new, moved[:, :2] / moved[:, 2:], moved[:, 2])

    def clamped(self) -> BSpline:
        """Return the same curve with end knots of full multiplicity."""
        return self.subcurve(0.0, 1.0)

    def transformed(self, matrix: ArrayLike) -> BSpline:
        """Return the exact image under a (2, 3) affine matrix."""
        linear, shift = affine_parts(matrix)
        points = self.control_points @ linear.T + shift
        return BSpline(self.degree, self.knots, points, self.weights)

    def to_beziers(self) -> tuple[Bezier, ...]:
        """Return the segments between the knots, exact to rounding; consecutive ends agree.

        Segments that are one point (from repeated control points) are left out.
        """
        control = self._segments[1].copy()
        control[1:, 0] = control[:-1, -1]
        points = control[..., :2] if control.shape[-1] == 2 else control[..., :2] / control[..., 2:]
        real = np.ptp(points, axis=1).max(axis=-1) > 0.0
        return tuple(from_homogeneous(rows) for rows in control[real])

    def with_ends(self, start: ArrayLike, end: ArrayLike) -> BSpline:
        """Return the clamped curve with its ends moved, the control points following linearly."""
        curve = self.clamped()
        knots, degree = curve.knots, curve.degree
        count = len(curve.control_points)
        greville = np.array([knots[i + 1 : i + degree + 1].mean() for i in range(count)])
        share = (greville - greville[0]) / (greville[-1] - greville[0])
        points = blend_ends(curve.control_points, share, start, end)
        return BSpline(degree, knots, points, curve.weights)


def _check_knots(degree: int, knots: FloatArray, count: int) -> None:
    """Raise GeometryError unless the knots make a connected curve of `count` control points."""
    if degree < 1:
        raise GeometryError(f"a B-spline needs a degree of at least 1, got {degree}")
    if count < degree + 1:
        raise GeometryError(
            f"a B-spline of degree {degree} needs {degree + 1} control points, got {count}"
        )
    if len(knots) != count + degree + 1:
        raise GeometryError(
            f"a B-spline of degree {degree} with {count} control points needs "
            f"{count + degree + 1} knots, got {len(knots)}"
        )
    falling = np.flatnonzero(np.diff(knots) < 0.0)
    if len(falling):
        raise GeometryError("B-spline knots must not decrease", place=f"knot {falling[0] + 1}")
    low, high = knots[degree], knots[count]
    if not low < high:
        raise GeometryError("a B-spline's knot range must not be empty")
    values, repeats = np.unique(knots, return_counts=True)
    allowed = np.where((values > low) & (values < high), degree, degree + 1)
    excess = np.flatnonzero(repeats > allowed)
    if len(excess):
        raise GeometryError(
            f"a B-spline knot is repeated {repeats[excess[0]]} times, "
            f"at most {allowed[excess[0]]} are possible",
            place=f"knot value {values[excess[0]]:.6g}",
        )
