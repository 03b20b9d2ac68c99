"""What every planar curve can do, and the numerics that all curves share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grassfire.errors import GeometryError
from grassfire.geometry.chebyshev import integrate, real_roots

if TYPE_CHECKING:
    from grassfire.geometry.bezier import Bezier

FloatArray: TypeAlias = NDArray[np.float64]
Bounds: TypeAlias = tuple[float, float, float, float]

SINGULAR_SPEED = 1e-9
"""Speed, relative to the curve's own, below which a derivative counts as zero."""

PROBE = 1e-5
"""Parameter step into the curve at which limits at singular points are taken."""


def cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the z component of the cross product of (..., 2) arrays, shape (...)."""
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def dot(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the scalar product of (..., 2) arrays, shape (...)."""
    return np.asarray(first[..., 0] * second[..., 0] + first[..., 1] * second[..., 1])


def left_normal(vector: FloatArray) -> FloatArray:
    """Return (..., 2) vectors turned by a quarter turn to the left."""
    return np.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def frozen_array(values: ArrayLike, shape: tuple[int | None, ...], what: str) -> FloatArray:
    """Return a read-only float64 copy of `values` after checking shape and finiteness.

    Raises
    ------
    GeometryError
        If the shape differs (None matches any length) or a value is not finite.
    """
    array = np.array(values, dtype=np.float64)
    fits = array.ndim == len(shape)
    for wanted, got in zip(shape, array.shape, strict=False):
        fits = fits and (wanted is None or wanted == got)
    if not fits:
        raise GeometryError(f"{what} must have shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise GeometryError(f"{what} must be finite numbers")
    array.setflags(write=False)
    return array


def affine_parts(matrix: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Split a (2, 3) affine matrix into its (2, 2) linear part and (2,) translation.

    Raises
    ------
    GeometryError
        If the matrix has another shape, is not finite or is singular.
    """
    array = frozen_array(matrix, (2, 3), "an affine matrix")
    linear = array[:, :2]
    size = float(np.abs(linear).max())
    if size == 0.0 or abs(float(np.linalg.det(linear / size))) < 1e-12:
        raise GeometryError("an affine matrix must be invertible")
    return linear, array[:, 2]


def similarity_scale(linear: FloatArray) -> float | None:
    """Return the signed scale of a similarity (negative for a reflection), None for others."""
    gram = linear @ linear.T
    scale_squared = 0.5 * (gram[0, 0] + gram[1, 1])
    error = max(abs(gram[0, 0] - gram[1, 1]), 2.0 * abs(gram[0, 1]))
    if error > 1e-12 * scale_squared:
        return None
    return float(np.copysign(np.sqrt(scale_squared), np.linalg.det(linear)))


def box(points: FloatArray) -> Bounds:
    """Return (xmin, ymin, xmax, ymax) of (n, 2) points."""
    low, high = points.min(axis=0), points.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


class Curve(ABC):
    """A planar curve over the parameter t in [0, 1], vectorised over t.

    Subclasses are frozen dataclasses that compare by identity. `t` may be a scalar or an array
    of any shape (...); results append the coordinate axis. Lengths are in mm, angles in radians.
    A parameter outside [0, 1] continues the curve analytically.
    """

    @abstractmethod
    def evaluate(self, t: ArrayLike, order: int = 0) -> tuple[FloatArray, ...]:
        """Return the point and the derivatives up to `order`, each of shape (..., 2)."""

    @abstractmethod
    def reversed(self) -> Curve:
        """Return the same points in the opposite direction: point(t) becomes point(1 - t)."""

    @abstractmethod
    def subcurve(self, t0: float, t1: float) -> Curve:
        """Return the part from t0 to t1, run backwards when t0 > t1.

        Raises
        ------
        GeometryError
            If t0 equals t1 or either lies outside [0, 1].
        """

    @abstractmethod
    def transformed(self, matrix: ArrayLike) -> Curve:
        """Return the image under a (2, 3) affine matrix.

        Raises
        ------
        GeometryError
            If the matrix is singular, or the image has no exact representation.
        """

    @abstractmethod
    def to_beziers(self) -> tuple[Bezier, ...]:
        """Return Bezier curves (rational where needed) that trace the same points exactly.

        Raises
        ------
        GeometryError
            If the curve has no exact rational form (a general `ParallelCurve`).
        """

    def breaks(self) -> FloatArray:
        """Return ascending parameters, 0 and 1 included, between which the curve is analytic."""
        return np.array([0.0, 1.0])

    @property
    def singular_order(self) -> int:
        """Highest derivative that is worth asking for where the lower ones vanish."""
        return 3

    @property
    def size(self) -> float:
        """A length of the order of the curve's extent, in mm; cheap, never zero."""
        low_high = np.array(self.bounds())
        return float(np.hypot(low_high[2] - low_high[0], low_high[3] - low_high[1]))

    def point(self, t: ArrayLike) -> FloatArray:
        """Return points of shape (..., 2) in mm."""
        return self.evaluate(t, 0)[0]

    def derivative(self, t: ArrayLike, order: int = 1) -> FloatArray:
        """Return the derivative of the given order with respect to t, shape (..., 2)."""
        return self.evaluate(t, order)[order]

    @cached_property
    def start(self) -> FloatArray:
        """(2,) point at t = 0."""
        return self.point(0.0)

    @cached_property
    def end(self) -> FloatArray:
        """(2,) point at t = 1."""
        return self.point(1.0)

    def tangent(self, t: ArrayLike) -> FloatArray:
        """Return unit tangents in the direction of travel, shape (..., 2).

        Where the first derivative vanishes the direction is the limit from the right (from the
        left at t = 1), that of the first derivative that does not vanish.
        """
        parameter = np.asarray(t, dtype=np.float64)
        first = self.evaluate(parameter, 1)[1]
        speed = np.hypot(first[..., 0], first[..., 1])
        singular = speed <= SINGULAR_SPEED * self.size
        if np.any(singular):
            first = first.copy()
            first[singular] = self._limit_direction(parameter[singular])
            speed = np.hypot(first[..., 0], first[..., 1])
        return np.asarray(first / speed[..., None])

    def normal(self, t: ArrayLike) -> FloatArray:
        """Return unit normals to the left of the direction of travel, shape (..., 2)."""
        return left_normal(self.tangent(t))

    def curvature(self, t: ArrayLike) -> FloatArray:
        """Return the signed curvature in 1/mm, left turns positive, shape (...).

        At a cusp, where the curvature is unbounded, the value is infinite with the sign of the
        side it is approached from; never NaN.
        """
        parameter = np.asarray(t, dtype=np.float64)
        _, first, second = self.evaluate(parameter, 2)
        speed = np.hypot(first[..., 0], first[..., 1])
        singular = np.asarray(speed <= SINGULAR_SPEED * self.size)
        with np.errstate(divide="ignore", invalid="ignore"):
            value = np.asarray(cross(first, second) / speed**3)
        if np.any(singular):
            value = value.copy()
            value[singular] = self._limit_curvature(parameter[singular])
        return value

    def length(self, accuracy: float = 1e-9) -> float:
        """Return the arc length in mm, to an absolute `accuracy` in mm (adaptive Gauss)."""

        def speed(t: FloatArray) -> FloatArray:
            first = self.evaluate(t, 1)[1]
            return np.hypot(first[..., 0], first[..., 1])

        return integrate(speed, self.breaks(), accuracy)

    def area_integral(self, origin: ArrayLike = (0.0, 0.0), accuracy: float = 1e-9) -> float:
        """Return half the integral of (c - origin) x dc in mm^2: the area swept from `origin`."""
        centre = np.asarray(origin, dtype=np.float64)

        def rate(t: FloatArray) -> FloatArray:
            point, first = self.evaluate(t, 1)
            return np.asarray(0.5 * cross(point - centre, first))

        return integrate(rate, self.breaks(), accuracy)

    def extrema(self, axis: int) -> FloatArray:
        """Return ascending interior parameters where coordinate `axis` is stationary."""
        return real_roots(
            lambda t: np.asarray(self.evaluate(t, 1)[1][..., axis]),
            self.breaks(),
            floor=1e-14 * self._speed_scale(),
        )

    def bounds(self) -> Bounds:
        """Return the exact bounding box (xmin, ymin, xmax, ymax) in mm."""
        parameters = np.concatenate([self.breaks(), self.extrema(0), self.extrema(1)])
        return box(self.point(parameters))

    def with_ends(self, start: ArrayLike, end: ArrayLike) -> Curve:
        """Return the curve with its ends moved a little, its shape otherwise kept.

        Parameters
        ----------
        start, end : (2,) array_like
            New ends in mm. The curve moves nowhere by much more than its ends do.

        Raises
        ------
        GeometryError
            If the curve's ends cannot be moved (a `ParallelCurve`), or it would vanish.
        """
        raise GeometryError(
            f"the ends of a {type(self).__name__} cannot be moved", place=self.start.tolist()
        )

    def _speed_scale(self) -> float:
        """Return a typical derivative magnitude, in mm."""
        first = self.evaluate(np.linspace(0.0, 1.0, 9), 1)[1]
        return float(np.abs(first).max())

    def _limit_direction(self, parameter: FloatArray) -> FloatArray:
        """Return (n, 2) non-zero vectors along the one-sided tangent at singular (n,) t."""
        derivatives = self.evaluate(parameter, self.singular_order)
        result = np.zeros((len(parameter), 2))
        missing = np.ones(len(parameter), dtype=bool)
        for order in range(2, self.singular_order + 1):
            value = derivatives[order]
            usable = missing & (np.hypot(value[:, 0], value[:, 1]) > 1e-7 * self.size)
            # c'(1 - h) ~ c^(k)(1) (-h)^(k-1) / (k-1)!, so even orders turn round at the end.
            backward = (parameter >= 1.0) & (order % 2 == 0)
            result[usable] = np.where(backward[:, None], -value, value)[usable]
            missing &= ~usable
        if np.any(missing):
            place = self.evaluate(parameter[missing][:1], 0)[0][0]
            raise GeometryError("a curve has no tangent", place=place.tolist())
        return result

    def _limit_curvature(self, parameter: FloatArray) -> FloatArray:
        """Return (n,) one-sided limits of the curvature at singular (n,) t, infinite at cusps."""
        inward = np.where(parameter >= 1.0, -1.0, 1.0)
        values = []
        for step in (PROBE, 4.0 * PROBE):
            _, first, second = self.evaluate(parameter + inward * step, 2)
            values.append(cross(first, second) / np.hypot(first[:, 0], first[:, 1]) ** 3)
        near, far = values
        # With c' ~ h^m q the curvature behaves like h^-m: a finite limit differs little between
        # the two probes, an infinite one by a factor of at least two.
        infinite = (np.abs(near) > 1.5 * np.abs(far)) & (np.abs(near) * self.size > 1e-3)
        return np.asarray(np.where(infinite, np.copysign(np.inf, near), near))


def check_range(t0: float, t1: float) -> None:
    """Raise GeometryError unless t0 and t1 are different parameters in [0, 1]."""
    if not (0.0 <= t0 <= 1.0 and 0.0 <= t1 <= 1.0) or t0 == t1:
        raise GeometryError(
            f"a part of a curve needs two different parameters in [0, 1], got {t0:.6g}, {t1:.6g}"
        )
