"""Bezier curves of any degree, polynomial or rational."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb, copysign, sqrt

import numpy as np
from numpy.typing import ArrayLike

from grassfire.errors import GeometryError
from grassfire.geometry.chebyshev import bernstein_family, gauss_rule
from grassfire.geometry.curve import (
    Curve,
    FloatArray,
    affine_parts,
    check_range,
    cross,
    frozen_array,
)


def homogeneous(points: FloatArray, weights: FloatArray | None) -> FloatArray:
    """Return (n, 2) points, or (n, 3) rows (w x, w y, w) where there are weights."""
    if weights is None:
        return points
    return np.concatenate([points * weights[:, None], weights[:, None]], axis=1)


def project(derivatives: list[FloatArray]) -> tuple[FloatArray, ...]:
    """Return the derivatives of (x/w, y/w) from those of (x, y, w), by the quotient rule.

    Piegl & Tiller 1997, eq. (4.8): w c^(k) = N^(k) - sum C(k, i) w^(i) c^(k-i).
    """
    weight = derivatives[0][..., 2:]
    result: list[FloatArray] = []
    for order, value in enumerate(derivatives):
        numerator = value[..., :2]
        for inner in range(1, order + 1):
            factor = comb(order, inner) * derivatives[inner][..., 2:]
            numerator = numerator - factor * result[order - inner]
        result.append(np.asarray(numerator / weight))
    return tuple(result)


def checked_weights(weights: ArrayLike | None, count: int) -> FloatArray | None:
    """Return validated weights, None where all are equal (the curve is polynomial)."""
    if weights is None:
        return None
    array = frozen_array(weights, (count,), "weights")
    if np.any(array <= 0.0):
        raise GeometryError(
            "a rational curve needs weights above zero", place=f"weight {int(np.argmin(array))}"
        )
    return None if np.all(array == array[0]) else array


def blend_ends(
    points: FloatArray, abscissae: FloatArray, start: ArrayLike, end: ArrayLike
) -> FloatArray:
    """Return control points moved linearly along their abscissae so that the ends fit."""
    new_start = frozen_array(start, (2,), "an end point")
    new_end = frozen_array(end, (2,), "an end point")
    share = abscissae[:, None]
    moved = points + (1.0 - share) * (new_start - points[0]) + share * (new_end - points[-1])
    moved[0], moved[-1] = new_start, new_end
    return np.asarray(moved)


def _quadratic_roots(control: FloatArray) -> FloatArray:
    """Return the ascending roots inside (0, 1) of a polynomial of degree 0 to 2 in Bezier form."""
    first, last = float(control[0]), float(control[-1])
    middle = float(control[1]) if len(control) == 3 else 0.5 * (first + last)
    # a t^2 - 2 h t + c; the root of larger size first, the other by Vieta: no cancellation.
    square, half, constant = first - 2.0 * middle + last, first - middle, first
    discriminant = half * half - square * constant
    if len(control) == 1 or discriminant < 0.0:
        return np.empty(0)
    larger = half + copysign(sqrt(discriminant), half)
    roots = []
    # Anything but a quotient below one in size lies outside of the interval.
    for numerator, denominator in ((larger, square), (constant, larger)):
        if 0.0 < abs(numerator) < abs(denominator) and (numerator > 0.0) == (denominator > 0.0):
            roots.append(numerator / denominator)
    return np.unique(roots) if roots else np.empty(0)


def split_left_right(control: FloatArray, t: float) -> tuple[FloatArray, FloatArray]:
    """Split Bezier coefficients (..., n+1, k) at t by de Casteljau: (left, right)."""
    count = control.shape[-2]
    left, right = np.empty_like(control), np.empty_like(control)
    current = control
    for level in range(count):
        left[..., level, :] = current[..., 0, :]
        right[..., count - 1 - level, :] = current[..., -1, :]
        current = (1.0 - t) * current[..., :-1, :] + t * current[..., 1:, :]
    return left, right


@dataclass(frozen=True, eq=False)
class Bezier(Curve):
    """A Bezier curve: sum of control points times Bernstein polynomials, weighted when rational.

    Parameters
    ----------
    control_points : (n + 1, 2) array_like
        In mm; degree n >= 1.
    weights : (n + 1,) array_like, optional
        Positive. Equal weights are dropped, the curve is then polynomial.

    Raises
    ------
    GeometryError
        For fewer than two control points, other shapes, values that are not finite, weights that
        are not positive, or a curve that is one point.

    Notes
    -----
    Evaluated by Bernstein weights, which are positive on [0, 1]: errors stay within a few units
    of rounding of the control polygon's size.
    """

    control_points: FloatArray
    weights: FloatArray | None = None

    def __post_init__(self) -> None:
        points = frozen_array(self.control_points, (None, 2), "control points")
        if len(points) < 2:
            raise GeometryError("a Bezier curve needs two control points or more")
        object.__setattr__(self, "control_points", points)
        object.__setattr__(self, "weights", checked_weights(self.weights, len(points)))
        if np.all(points == points[0]):
            raise GeometryError("a Bezier curve must not be one point", place=points[0].tolist())

    @property
    def degree(self) -> int:
        """Polynomial degree n."""
        return len(self.control_points) - 1

    @property
    def singular_order(self) -> int:
        """Highest derivative that can be the first that does not vanish."""
        return max(3, self.degree)

    @cached_property
    def size(self) -> float:
        """Diagonal of the control polygon's box, in mm."""
        return float(np.hypot(*np.ptp(self.control_points, axis=0)))

    @cached_property
    def _hodographs(self) -> list[FloatArray]:
        """Homogeneous coefficients of the curve and its derivatives, extended when asked."""
        return [homogeneous(self.control_points, self.weights)]

    def _hodograph(self, order: int) -> FloatArray:
        table = self._hodographs
        while len(table) <= order:
            previous = table[-1]
            degree = len(previous) - 1
            table.append(degree * np.diff(previous, axis=0) if degree else np.zeros_like(previous))
        return table[order]

    def evaluate(self, t: ArrayLike, order: int = 0) -> tuple[FloatArray, ...]:
        """Return the point and the derivatives up to any `order`, each (..., 2)."""
        parameter = np.asarray(t, dtype=np.float64)
        family = bernstein_family(self.degree, parameter, order)
        values = [
            np.asarray(weights @ self._hodograph(level)) for level, weights in enumerate(family)
        ]
        return tuple(values) if self.weights is None else project(values)

    @cached_property
    def start(self) -> FloatArray:
        """(2,) first control point."""
        return np.asarray(self.control_points[0])

    @cached_property
    def end(self) -> FloatArray:
        """(2,) last control point."""
        return np.asarray(self.control_points[-1])

    def extrema(self, axis: int) -> FloatArray:
        """Return ascending inner parameters where coordinate `axis` is stationary."""
        if self.weights is not None:
            return super().extrema(axis)
        slope = self._hodograph(1)[:, axis]
        if slope.min() > 0.0 or slope.max() < 0.0:
            return np.empty(0)
        if self.degree > 3:
            return super().extrema(axis)
        return _quadratic_roots(slope)

    def area_integral(self, origin: ArrayLike = (0.0, 0.0), accuracy: float = 1e-9) -> float:
        """Return half the integral of (c - origin) x dc in mm^2, exact for polynomial curves."""
        if self.weights is not None:
            return super().area_integral(origin, accuracy)
        nodes, rule = gauss_rule(self.degree)
        point, first = self.evaluate(0.5 * (nodes + 1.0), 1)
        swept = cross(point - np.asarray(origin, dtype=np.float64), first)
        return float(0.25 * (swept @ rule))

    def reversed(self) -> Bezier:
        """Return the curve run backwards."""
        weights = None if self.weights is None else self.weights[::-1]
        return Bezier(self.control_points[::-1], weights)

    def split(self, t: float) -> tuple[Bezier, Bezier]:
        """Return the parts before and after t, exact to rounding (de Casteljau)."""
        return self.subcurve(0.0, t), self.subcurve(t, 1.0)

    def subcurve(self, t0: float, t1: float) -> Bezier:
        """Return the part from t0 to t1 as a curve of the same degree."""
        check_range(t0, t1)
        if t0 > t1:
            return self.subcurve(t1, t0).reversed()
        control = homogeneous(self.control_points, self.weights)
        if t1 < 1.0:
            control = split_left_right(control, t1)[0]
        if t0 > 0.0:
            control = split_left_right(control, t0 / t1)[1]
        return from_homogeneous(control)

    def elevated(self, degree: int) -> Bezier:
        """Return the same curve with a higher degree."""
        control = homogeneous(self.control_points, self.weights)
        if degree < self.degree:
            raise GeometryError(f"cannot elevate degree {self.degree} to {degree}")
        while len(control) <= degree:
            share = (np.arange(1, len(control)) / len(control))[:, None]
            inner = share * control[:-1] + (1.0 - share) * control[1:]
            control = np.concatenate([control[:1], inner, control[-1:]])
        return from_homogeneous(control)

    def transformed(self, matrix: ArrayLike) -> Bezier:
        """Return the exact image under a (2, 3) affine matrix."""
        linear, shift = affine_parts(matrix)
        return Bezier(self.control_points @ linear.T + shift, self.weights)

    def to_beziers(self) -> tuple[Bezier, ...]:
        """Return the curve itself."""
        return (self,)

    def with_ends(self, start: ArrayLike, end: ArrayLike) -> Bezier:
        """Return the curve with its ends moved, the control points following linearly."""
        abscissae = np.linspace(0.0, 1.0, len(self.control_points))
        return Bezier(blend_ends(self.control_points, abscissae, start, end), self.weights)


def from_homogeneous(control: FloatArray) -> Bezier:
    """Return the Bezier curve of (n + 1, 2) or (n + 1, 3) homogeneous coefficients."""
    if control.shape[1] == 2:
        return Bezier(control)
    return Bezier(control[:, :2] / control[:, 2:], control[:, 2])
