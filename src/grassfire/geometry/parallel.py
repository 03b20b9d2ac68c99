"""Curves at a constant distance from another curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grassfire.errors import GeometryError
from grassfire.geometry.arc import Arc
from grassfire.geometry.bezier import Bezier
from grassfire.geometry.bspline import BSpline
from grassfire.geometry.chebyshev import real_roots
from grassfire.geometry.curve import (
    PROBE,
    SINGULAR_SPEED,
    Curve,
    FloatArray,
    affine_parts,
    check_range,
    cross,
    dot,
    left_normal,
    similarity_scale,
)
from grassfire.geometry.line import Line


@dataclass(frozen=True, eq=False)
class ParallelCurve(Curve):
    """The offset base.point + distance * left normal, over the base's parameters t0 to t1.

    Parameters
    ----------
    base : Curve
        Smooth inside (a corner would tear the offset apart), and not itself a ParallelCurve.
    distance : float
        In mm, to the left of the base's direction; negative to the right.
    t0, t1 : float
        Part of the base, 0 <= t0 < t1 <= 1.

    Raises
    ------
    GeometryError
        For a base that is parallel or has a corner inside the part, an empty part, a distance
        that is not finite.

    Notes
    -----
    With the base's curvature k and f = 1 - k distance, the derivative is f base' (Dorado 2009,
    eq. 4): where f vanishes the offset has a cusp, where f is negative it runs backwards.
    `evaluate` has orders up to 2.
    """

    base: Curve
    distance: float
    t0: float = 0.0
    t1: float = 1.0

    def __post_init__(self) -> None:
        if isinstance(self.base, ParallelCurve):
            raise GeometryError(
                "a ParallelCurve needs a plain base curve", remedy="use parallel(curve, distance)"
            )
        if not np.isfinite(self.distance):
            raise GeometryError("an offset distance must be a finite number")
        check_range(self.t0, self.t1)
        if self.t0 > self.t1:
            raise GeometryError("a ParallelCurve needs t0 < t1", remedy="use .reversed()")
        for name in ("distance", "t0", "t1"):
            object.__setattr__(self, name, float(getattr(self, name)))
        if isinstance(self.base, BSpline):
            _check_smooth(self.base, self.t0, self.t1)

    @property
    def size(self) -> float:
        """The base's size plus the distance, in mm."""
        return self.base.size + abs(self.distance)

    def _base_parameter(self, t: ArrayLike) -> FloatArray:
        parameter = np.asarray(t, dtype=np.float64)
        return np.asarray((1.0 - parameter) * self.t0 + parameter * self.t1)

    def breaks(self) -> FloatArray:
        """Return the base's breaks within the part, mapped to [0, 1]."""
        inner = self.base.breaks()
        inner = inner[(inner > self.t0) & (inner < self.t1)]
        return np.concatenate([[0.0], (inner - self.t0) / (self.t1 - self.t0), [1.0]])

    def _frame(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the base's point, unit tangent, speed and curvature in one evaluation."""
        parameter = self._base_parameter(t)
        point, first, second = self.base.evaluate(parameter, 2)
        speed = np.hypot(first[..., 0], first[..., 1])
        singular = speed <= SINGULAR_SPEED * self.base.size
        with np.errstate(divide="ignore", invalid="ignore"):
            tangent = np.asarray(first / speed[..., None])
            bend = np.asarray(cross(first, second) / speed**3)
        if np.any(singular):
            tangent[singular] = self.base.tangent(parameter[singular])
            bend[singular] = self.base.curvature(parameter[singular])
        return point, tangent, speed, bend

    def speed_factor(self, t: ArrayLike) -> FloatArray:
        """Return 1 - curvature * distance of the base, shape (...): zero at cusps."""
        return np.asarray(1.0 - self.distance * self._frame(np.asarray(t, dtype=np.float64))[3])

    def evaluate(self, t: ArrayLike, order: int = 0) -> tuple[FloatArray, ...]:
        """Return the point and the derivatives up to `order` <= 2, each (..., 2).

        Where the base's own speed vanishes, derivatives are taken 1e-5 of the part away.
        """
        if order > 2:
            raise GeometryError("a ParallelCurve has derivatives up to the second only")
        parameter = self._base_parameter(t)
        values = self.base.evaluate(parameter, order + 1)
        speed = np.hypot(values[1][..., 0], values[1][..., 1])
        singular = np.asarray(speed <= SINGULAR_SPEED * self.base.size)
        any_singular = bool(np.any(singular))
        if any_singular:
            normal = self.base.normal(parameter)
        else:
            normal = left_normal(values[1]) / speed[..., None]
        result = [np.asarray(values[0] + self.distance * normal)]
        if order == 0:
            return tuple(result)
        if any_singular:
            inward = np.where(parameter >= 1.0, -PROBE, PROBE)
            values = self.base.evaluate(
                np.where(singular, parameter + inward, parameter), order + 1
            )
        span, first, second = self.t1 - self.t0, values[1], values[2]
        squared = dot(first, first)
        turning = cross(first, second) / squared
        tangent = first / np.sqrt(squared)[..., None]
        # n' = -theta' T with theta' the turning rate, finite also where the curvature is not.
        slope = first - (self.distance * turning)[..., None] * tangent
        result.append(np.asarray(span * slope))
        if order == 2:
            rate = (cross(first, values[3]) - 2.0 * turning * dot(first, second)) / squared
            bend = rate[..., None] * tangent + (turning**2)[..., None] * left_normal(tangent)
            result.append(np.asarray(span**2 * (second - self.distance * bend)))
        return tuple(result)

    def tangent(self, t: ArrayLike) -> FloatArray:
        """Return unit tangents (..., 2): the base's, turned round where the offset runs back."""
        parameter = np.asarray(t, dtype=np.float64)
        _, tangent, _, bend = self._frame(parameter)
        factor = np.asarray(1.0 - self.distance * bend)
        at_cusp = np.abs(factor) <= SINGULAR_SPEED
        if np.any(at_cusp):
            inward = np.where(parameter >= 1.0, -PROBE, PROBE)
            factor = np.where(at_cusp, self.speed_factor(parameter + inward), factor)
        return np.asarray(np.where(factor < 0.0, -1.0, 1.0)[..., None] * tangent)

    def curvature(self, t: ArrayLike) -> FloatArray:
        """Return k / |1 - k distance| of the base, shape (...); infinite at cusps."""
        bend = self._frame(np.asarray(t, dtype=np.float64))[3]
        with np.errstate(divide="ignore", invalid="ignore"):
            # The reciprocal form has the right limit where the base's curvature is infinite.
            value = np.where(
                np.abs(bend) * abs(self.distance) > 1.0,
                np.sign(bend) / np.abs(1.0 / np.where(bend == 0.0, 1.0, bend) - self.distance),
                bend / np.abs(1.0 - bend * self.distance),
            )
        return np.asarray(value)

    def cusps(self) -> FloatArray:
        """Return the ascending inner parameters where the offset runs over a curvature centre."""
        roots = real_roots(self.speed_factor, self.breaks(), floor=1e-13)
        return roots[(roots > 0.0) & (roots < 1.0)]

    def extrema(self, axis: int) -> FloatArray:
        """Return ascending inner parameters where coordinate `axis` is stationary."""

        def slope(t: FloatArray) -> FloatArray:
            return np.asarray(self.base.tangent(self._base_parameter(t))[..., axis])

        roots = np.concatenate([real_roots(slope, self.breaks(), floor=1e-14), self.cusps()])
        return np.unique(roots[(roots > 0.0) & (roots < 1.0)])

    def reversed(self) -> ParallelCurve:
        """Return the offset run backwards: the reversed base, to its other side."""
        return ParallelCurve(self.base.reversed(), -self.distance, 1.0 - self.t1, 1.0 - self.t0)

    def subcurve(self, t0: float, t1: float) -> ParallelCurve:
        """Return the part from t0 to t1."""
        check_range(t0, t1)
        if t0 > t1:
            return self.subcurve(t1, t0).reversed()
        low, high = self._base_parameter(np.array([t0, t1]))
        return ParallelCurve(self.base, self.distance, float(low), float(high))

    def transformed(self, matrix: ArrayLike) -> ParallelCurve:
        """Return the image under a similarity.

        Raises
        ------
        GeometryError
            For other affine maps, which take offsets to curves that are none.
        """
        scale = similarity_scale(affine_parts(matrix)[0])
        if scale is None:
            raise GeometryError(
                "an offset curve can only be moved, turned, mirrored and scaled evenly",
                remedy="transform its base, or fit arcs first",
            )
        return ParallelCurve(self.base.transformed(matrix), self.distance * scale, self.t0, self.t1)

    def to_beziers(self) -> tuple[Bezier, ...]:
        """Return the exact Bezier form where there is one: offsets of lines and circular arcs.

        Raises
        ------
        GeometryError
            For any other base: its offset is not rational.
        """
        exact = parallel(self.base.subcurve(self.t0, self.t1), self.distance)
        if isinstance(exact, ParallelCurve):
            raise GeometryError(
                "the offset of a free curve has no exact Bezier form", remedy="use fit_arcs"
            )
        return exact.to_beziers()


def parallel(curve: Curve, distance: float) -> Curve:
    """Return the curve at `distance` mm to the left: a Line, an Arc or a ParallelCurve.

    Raises
    ------
    GeometryError
        If an arc would shrink to its centre or beyond.
    """
    if isinstance(curve, Line):
        shift = distance * curve.normal(0.0)
        return Line(curve.start + shift, curve.end + shift)
    if isinstance(curve, Arc):
        radius = curve.radius - float(np.copysign(distance, distance * curve.sweep))
        if radius <= 0.0:
            raise GeometryError(
                f"an arc of radius {curve.radius:.6g} mm has no offset at {distance:.6g} mm",
                place=curve.centre.tolist(),
            )
        return Arc(curve.centre, radius, curve.start_angle, curve.sweep)
    if isinstance(curve, ParallelCurve):
        return ParallelCurve(curve.base, curve.distance + distance, curve.t0, curve.t1)
    return ParallelCurve(curve, distance)


def _check_smooth(base: BSpline, t0: float, t1: float) -> None:
    """Raise GeometryError where a knot of full multiplicity makes a corner inside the part."""
    edges = base.breaks()
    inner = edges[(edges > t0) & (edges < t1)]
    if not len(inner):
        return
    step = 1e-9
    turn = cross(base.tangent(inner - step), base.tangent(inner + step))
    forward = dot(base.tangent(inner - step), base.tangent(inner + step))
    corner = np.flatnonzero((np.abs(turn) > 1e-4) | (forward < 0.0))
    if len(corner):
        place = base.point(inner[corner[0]]).tolist()
        raise GeometryError(
            "the base of an offset has a corner", place=place, remedy="split it at its corners"
        )
