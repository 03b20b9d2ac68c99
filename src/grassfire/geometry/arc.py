"""Circular arcs and full circles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import atan, atan2, copysign, hypot, isfinite, pi

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
    dot,
    frozen_array,
    left_normal,
    similarity_scale,
)
from grassfire.geometry.elliptical_arc import (
    EllipticalArc,
    checked_sweep,
    conic_beziers,
    end_map,
    stationary_parameters,
)


@dataclass(frozen=True, eq=False)
class Arc(Curve):
    """A circular arc at constant speed; |sweep| = 2 pi is a full circle.

    Parameters
    ----------
    centre : (2,) array_like
        In mm.
    radius : float
        In mm, above zero.
    start_angle : float
        Angle of the start seen from the centre, in radians.
    sweep : float
        Angle that the arc runs through, counter-clockwise positive; 0 < |sweep| <= 2 pi.

    Raises
    ------
    GeometryError
        For a radius that is not positive, a zero or excessive sweep, or values not finite.
    """

    centre: FloatArray
    radius: float
    start_angle: float = 0.0
    sweep: float = 2.0 * np.pi

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", frozen_array(self.centre, (2,), "an arc's centre"))
        if not (np.isfinite(self.radius) and self.radius > 0.0):
            raise GeometryError(
                f"an arc needs a radius above zero, got {self.radius:.6g} mm",
                place=self.centre.tolist(),
            )
        object.__setattr__(self, "radius", float(self.radius))
        object.__setattr__(self, "sweep", checked_sweep(self.start_angle, self.sweep))
        object.__setattr__(self, "start_angle", float(self.start_angle))

    @classmethod
    def from_bulge(cls, start: ArrayLike, end: ArrayLike, bulge: float) -> Arc:
        """Return the arc between two points with a DXF bulge, tan(sweep / 4).

        Raises
        ------
        GeometryError
            If the points coincide, or the bulge is zero or not finite.
        """
        first = frozen_array(start, (2,), "an arc's start")
        last = frozen_array(end, (2,), "an arc's end")
        (x0, y0), (x1, y1) = first.tolist(), last.tolist()
        length = hypot(x1 - x0, y1 - y0)
        if length == 0.0:
            raise GeometryError("an arc needs two different ends", place=(x0, y0))
        if bulge == 0.0 or not isfinite(bulge):
            raise GeometryError(
                f"an arc's bulge must be finite and not zero, got {bulge:.6g}", place=(x0, y0)
            )
        sweep = 4.0 * atan(bulge)
        radius = 0.25 * length * (abs(bulge) + 1.0 / abs(bulge))
        # The centre's distance to the left of the chord, as a share of the chord.
        apothem = 0.25 * (1.0 / bulge - bulge)
        centre = (0.5 * (x0 + x1) - apothem * (y1 - y0), 0.5 * (y0 + y1) + apothem * (x1 - x0))
        # The chord's direction less the half sweep is exact where first - centre cancels.
        chord_angle = atan2(y1 - y0, x1 - x0)
        start_angle = chord_angle - copysign(0.5 * pi, sweep) - 0.5 * sweep
        return cls(np.array(centre), radius, start_angle, sweep)

    @classmethod
    def from_three_points(cls, start: ArrayLike, middle: ArrayLike, end: ArrayLike) -> Arc:
        """Return the arc from start through middle to end.

        Coinciding ends give the full circle with `middle` opposite them, counter-clockwise.

        Raises
        ------
        GeometryError
            If the points lie on one line.
        """
        first = frozen_array(start, (2,), "an arc's start")
        inner = frozen_array(middle, (2,), "an arc's point")
        last = frozen_array(end, (2,), "an arc's end")
        if np.all(first == last):
            centre = 0.5 * (first + inner)
            spoke = first - centre
            return cls(centre, float(np.hypot(*spoke)), float(np.arctan2(spoke[1], spoke[0])))
        # The inscribed angle at the middle point is pi - sweep / 2.
        incoming, outgoing = inner - first, last - inner
        sine, cosine = float(cross(incoming, outgoing)), float(dot(incoming, outgoing))
        reach = float(np.hypot(*incoming) * np.hypot(*outgoing))
        if abs(sine) <= 1e-14 * reach:
            raise GeometryError("three points of an arc lie on one line", place=inner.tolist())
        return cls.from_bulge(first, last, float(np.tan(0.5 * np.arctan2(sine, cosine))))

    @property
    def size(self) -> float:
        """Radius times the smaller of the sweep and two, in mm."""
        return self.radius * min(2.0, abs(self.sweep))

    @property
    def bulge(self) -> float:
        """tan(sweep / 4), as in DXF."""
        return float(np.tan(0.25 * self.sweep))

    @property
    def closed(self) -> bool:
        """Whether this is a full circle."""
        return abs(self.sweep) == 2.0 * np.pi

    def evaluate(self, t: ArrayLike, order: int = 0) -> tuple[FloatArray, ...]:
        """Return the point and the derivatives up to any `order`, each (..., 2)."""
        angle = self.start_angle + self.sweep * np.asarray(t, dtype=np.float64)
        radial = self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        values = [np.asarray(self.centre + radial)]
        if not order:
            return tuple(values)
        forward = left_normal(radial)
        for level in range(1, order + 1):
            sign = 1.0 if level % 4 in (0, 1) else -1.0
            vector = forward if level % 2 else radial
            values.append(np.asarray(sign * self.sweep**level * vector))
        return tuple(values)

    @cached_property
    def start(self) -> FloatArray:
        """(2,) point at t = 0."""
        return self._at(self.start_angle)

    @cached_property
    def end(self) -> FloatArray:
        """(2,) point at t = 1; of a full circle exactly the start."""
        return self.start if self.closed else self._at(self.start_angle + self.sweep)

    def _at(self, angle: float) -> FloatArray:
        """(2,) point that is seen from the centre under an angle."""
        return self.centre + self.radius * np.array([np.cos(angle), np.sin(angle)])

    def curvature(self, t: ArrayLike) -> FloatArray:
        """Return the constant curvature, shape (...)."""
        value = np.copysign(1.0 / self.radius, self.sweep)
        return np.full(np.shape(t), value)

    def length(self, accuracy: float = 1e-9) -> float:
        """Return the length in mm, exact."""
        return self.radius * abs(self.sweep)

    def area_integral(self, origin: ArrayLike = (0.0, 0.0), accuracy: float = 1e-9) -> float:
        """Return the area swept from `origin`, in mm^2, in closed form."""
        reach = self.centre - np.asarray(origin, dtype=np.float64)
        sector = self.radius**2 * self.sweep
        return float(0.5 * (cross(reach, self.end - self.start) + sector))

    def extrema(self, axis: int) -> FloatArray:
        """Return ascending inner parameters where coordinate `axis` is stationary."""
        return stationary_parameters(self.start_angle, self.sweep, 0.5 * np.pi * axis)

    def bounds(self) -> Bounds:
        """Return the exact bounding box."""
        inner = np.concatenate([self.extrema(0), self.extrema(1)])
        return box(self.point(np.concatenate([[0.0, 1.0], inner])))

    def reversed(self) -> Arc:
        """Return the arc run backwards."""
        return Arc(self.centre, self.radius, self.start_angle + self.sweep, -self.sweep)

    def subcurve(self, t0: float, t1: float) -> Arc:
        """Return the part from t0 to t1."""
        check_range(t0, t1)
        start = self.start_angle + self.sweep * t0
        return Arc(self.centre, self.radius, start, self.sweep * (t1 - t0))

    def transformed(self, matrix: ArrayLike) -> Arc | EllipticalArc:
        """Return the exact image: an Arc under a similarity, else an EllipticalArc."""
        linear, shift = affine_parts(matrix)
        centre = linear @ self.centre + shift
        scale = similarity_scale(linear)
        if scale is None:
            major, minor = self.radius * linear[:, 0], self.radius * linear[:, 1]
            return EllipticalArc(centre, major, minor, self.start_angle, self.sweep)
        turned = float(np.arctan2(linear[1, 0], linear[0, 0]))
        sign = np.sign(scale)
        start_angle = turned + sign * self.start_angle
        return Arc(centre, self.radius * abs(scale), start_angle, sign * self.sweep)

    def to_elliptical_arc(self) -> EllipticalArc:
        """Return the same arc as an EllipticalArc."""
        major, minor = np.array([self.radius, 0.0]), np.array([0.0, self.radius])
        return EllipticalArc(self.centre, major, minor, self.start_angle, self.sweep)

    def to_beziers(self) -> tuple[Bezier, ...]:
        """Return rational quadratic curves of a quarter turn at most, exact as point sets."""
        major, minor = np.array([self.radius, 0.0]), np.array([0.0, self.radius])
        return conic_beziers(self.centre, major, minor, self.start_angle, self.sweep)

    def with_ends(self, start: ArrayLike, end: ArrayLike) -> Arc:
        """Return an arc between the new ends: of the same sweep up to half a turn, beyond of
        about the same size, a full circle where they coincide.

        Raises
        ------
        GeometryError
            For a circle that would have to open, or ends that are nearly together.
        """
        if abs(self.sweep) <= np.pi:
            return Arc.from_bulge(start, end, self.bulge)
        if self.closed:
            shift = end_map(self, abs(self.sweep), start, end)[:, 2]
            return Arc(self.centre + shift, self.radius, self.start_angle, self.sweep)
        new_start, new_end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        middle = self.point(0.5) + 0.5 * (new_start - self.start + new_end - self.end)
        if np.all(new_start == new_end):
            circle = Arc.from_three_points(new_start, middle, new_end)
            return circle if self.sweep > 0.0 else circle.reversed()
        moved = Arc.from_three_points(new_start, middle, new_end)
        if abs(moved.radius - self.radius) > 0.05 * self.radius:
            raise GeometryError(
                "the ends of an almost closed arc cannot be moved",
                place=self.start.tolist(),
                remedy="close the circle in the drawing",
            )
        return moved
