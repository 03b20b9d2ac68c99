"""Straight segments."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from grassfire.errors import GeometryError
from grassfire.geometry.bezier import Bezier
from grassfire.geometry.curve import (
    Bounds,
    Curve,
    FloatArray,
    affine_parts,
    box,
    check_range,
    cross,
    frozen_array,
)


@dataclass(frozen=True, eq=False)
class Line(Curve):
    """The straight segment from start to end, at constant speed.

    Parameters
    ----------
    start, end : (2,) array_like
        In mm.

    Raises
    ------
    GeometryError
        If the ends coincide or are not finite.
    """

    start: FloatArray = field()
    end: FloatArray = field()

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", frozen_array(self.start, (2,), "a line's start"))
        object.__setattr__(self, "end", frozen_array(self.end, (2,), "a line's end"))
        if np.all(self.start == self.end):
            raise GeometryError("a line must not have zero length", place=self.start.tolist())

    @property
    def size(self) -> float:
        """Length in mm."""
        return float(np.hypot(*(self.end - self.start)))

    def evaluate(self, t: ArrayLike, order: int = 0) -> tuple[FloatArray, ...]:
        """Return the point and the derivatives up to any `order`, each (..., 2)."""
        parameter = np.asarray(t, dtype=np.float64)[..., None]
        change = self.end - self.start
        # The symmetric form returns both ends exactly.
        point = np.asarray((1.0 - parameter) * self.start + parameter * self.end)
        values = [point]
        if order >= 1:
            values.append(np.broadcast_to(change, point.shape).copy())
        values.extend(np.zeros_like(point) for _ in range(2, order + 1))
        return tuple(values)

    def length(self, accuracy: float = 1e-9) -> float:
        """Return the length in mm, exact."""
        return self.size

    def area_integral(self, origin: ArrayLike = (0.0, 0.0), accuracy: float = 1e-9) -> float:
        """Return the signed area of the triangle from `origin`, in mm^2."""
        centre = np.asarray(origin, dtype=np.float64)
        return float(0.5 * cross(self.start - centre, self.end - centre))

    def bounds(self) -> Bounds:
        """Return the exact bounding box."""
        return box(np.stack([self.start, self.end]))

    def extrema(self, axis: int) -> FloatArray:
        """Return no parameters: a line has no inner extrema."""
        return np.empty(0)

    def reversed(self) -> Line:
        """Return the segment run backwards."""
        return Line(self.end, self.start)

    def subcurve(self, t0: float, t1: float) -> Line:
        """Return the part from t0 to t1."""
        check_range(t0, t1)
        return Line(self.point(t0), self.point(t1))

    def transformed(self, matrix: ArrayLike) -> Line:
        """Return the exact image under a (2, 3) affine matrix."""
        linear, shift = affine_parts(matrix)
        return Line(linear @ self.start + shift, linear @ self.end + shift)

    def to_beziers(self) -> tuple[Bezier, ...]:
        """Return one Bezier curve of degree 1."""
        return (Bezier(np.stack([self.start, self.end])),)

    def with_ends(self, start: ArrayLike, end: ArrayLike) -> Line:
        """Return the segment between the new ends."""
        return Line(np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64))
