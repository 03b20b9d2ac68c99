"""Arcs of ellipses."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

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


def checked_sweep(start_angle: float, sweep: float) -> float:
    """Return the sweep clipped to a full turn; raise GeometryError when it cannot be used."""
    if not (isfinite(start_angle) and isfinite(sweep)):
        raise GeometryError("an arc's angles must be finite numbers")
    if sweep == 0.0 or abs(sweep) > 2.0 * np.pi * (1.0 + 1e-9):
        raise GeometryError(
            f"an arc's sweep must be within one turn and not zero, got {sweep:.6g} rad"
        )
    return float(min(max(sweep, -2.0 * np.pi), 2.0 * np.pi))


def stationary_parameters(start_angle: float, sweep: float, first_angle: float) -> FloatArray:
    """Return the ascending inner t at which the angle is `first_angle` plus half turns."""
    low, high = sorted((start_angle, start_angle + sweep))
    index = np.arange(np.ceil((low - first_angle) / np.pi), (high - first_angle) // np.pi + 1)
    t = np.sort((first_angle + index * np.pi - start_angle) / sweep)
    return np.asarray(t[(t > 0.0) & (t < 1.0)])


@dataclass(frozen=True, eq=False)
class EllipticalArc(Curve):
    """The arc centre + cos(a) major + sin(a) minor for a from start_angle over sweep.

    Parameters
    ----------
    centre : (2,) array_like
        In mm.
    major, minor : (2,) array_like
        Conjugate half-diameters in mm; any two independent vectors, at right angles when they
        are the half-axes. (minor to the right of major runs the angle clockwise.)
    start_angle, sweep : float
        Eccentric angles in radians; 0 < |sweep| <= 2 pi.

    Raises
    ------
    GeometryError
        For dependent half-diameters, a zero or excessive sweep, or values that are not finite.
    """

    centre: FloatArray
    major: FloatArray
    minor: FloatArray
    start_angle: float = 0.0
    sweep: float = 2.0 * np.pi

    def __post_init__(self) -> None:
        for name in ("centre", "major", "minor"):
            value = frozen_array(getattr(self, name), (2,), f"an elliptical arc's {name}")
            object.__setattr__(self, name, value)
        scale = float(np.hypot(*self.major) ** 2 + np.hypot(*self.minor) ** 2)
        if scale == 0.0 or abs(float(cross(self.major, self.minor))) <= 1e-12 * scale:
            raise GeometryError("an ellipse's axes must span an area", place=self.centre.tolist())
        object.__setattr__(self, "sweep", checked_sweep(self.start_angle, self.sweep))
        object.__setattr__(self, "start_angle", float(self.start_angle))

    @property
    def size(self) -> float:
        """Larger half-diameter times the smaller of the sweep and a turn, in mm."""
        radius = max(float(np.hypot(*self.major)), float(np.hypot(*self.minor)))
        return radius * min(2.0, abs(self.sweep))

    def evaluate(self, t: ArrayLike, order: int = 0) -> tuple[FloatArray, ...]:
        """Return the point and the derivatives up to any `order`, each (..., 2)."""
        angle = self.start_angle + self.sweep * np.asarray(t, dtype=np.float64)
        cosine, sine = np.cos(angle)[..., None], np.sin(angle)[..., None]
        radial = cosine * self.major + sine * self.minor
        forward = cosine * self.minor - sine * self.major
        values = [np.asarray(self.centre + radial)]
        for level in range(1, order + 1):
            # d/da maps radial -> forward -> -radial -> -forward.
            sign = 1.0 if level % 4 in (0, 1) else -1.0
            vector = forward if level % 2 else radial
            values.append(np.asarray(sign * self.sweep**level * vector))
        return tuple(values)

    def area_integral(self, origin: ArrayLike = (0.0, 0.0), accuracy: float = 1e-9) -> float:
        """Return the area swept from `origin`, in mm^2, in closed form."""
        reach = self.centre - np.asarray(origin, dtype=np.float64)
        sector = cross(self.major, self.minor) * self.sweep
        return float(0.5 * (cross(reach, self.end - self.start) + sector))

    def extrema(self, axis: int) -> FloatArray:
        """Return ascending inner parameters where coordinate `axis` is stationary."""
        angle = float(np.arctan2(self.minor[axis], self.major[axis]))
        return stationary_parameters(self.start_angle, self.sweep, angle)

    def bounds(self) -> Bounds:
        """Return the exact bounding box."""
        inner = np.concatenate([self.extrema(0), self.extrema(1)])
        return box(self.point(np.concatenate([[0.0, 1.0], inner])))

    def reversed(self) -> EllipticalArc:
        """Return the arc run backwards."""
        start = self.start_angle + self.sweep
        return EllipticalArc(self.centre, self.major, self.minor, start, -self.sweep)

    def subcurve(self, t0: float, t1: float) -> EllipticalArc:
        """Return the part from t0 to t1."""
        check_range(t0, t1)
        start = self.start_angle + self.sweep * t0
        return EllipticalArc(self.centre, self.major, self.minor, start, self.sweep * (t1 - t0))

    def transformed(self, matrix: ArrayLike) -> EllipticalArc:
        """Return the exact image under a (2, 3) affine matrix."""
        linear, shift = affine_parts(matrix)
        return EllipticalArc(
            linear @ self.centre + shift,
            linear @ self.major,
            linear @ self.minor,
            self.start_angle,
            self.sweep,
        )

    def to_beziers(self) -> tuple[Bezier, ...]:
        """Return rational quadratic curves of a quarter turn at most, exact as point sets."""
        return conic_beziers(self.centre, self.major, self.minor, self.start_angle, self.sweep)

    def with_ends(self, start: ArrayLike, end: ArrayLike) -> EllipticalArc:
        """Return an arc of the same angles through the new ends; the whole ellipse where they
        coincide.

        Raises
        ------
        GeometryError
            For an ellipse that would have to open, or ends that are nearly together.
        """
        turn = abs(self.sweep)
        new_start, new_end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        if np.pi < turn < 2.0 * np.pi and np.all(new_start == new_end):
            closed_sweep = float(np.copysign(2.0 * np.pi, self.sweep))
            centre = self.centre + new_start - self.start
            return EllipticalArc(centre, self.major, self.minor, self.start_angle, closed_sweep)
        if np.hypot(*(self.end - self.start)) < 0.05 * self.size and np.pi < turn < 2.0 * np.pi:
            raise GeometryError(
                "the ends of an almost closed elliptical arc cannot be moved",
                place=self.start.tolist(),
                remedy="close the ellipse in the drawing",
            )
        return self.transformed(end_map(self, abs(self.sweep), start, end))


def conic_beziers(
    centre: FloatArray, major: FloatArray, minor: FloatArray, start_angle: float, sweep: float
) -> tuple[Bezier, ...]:
    """Return rational quadratics of at most a quarter turn for an elliptical arc."""
    count = int(np.ceil(abs(sweep) / (0.5 * np.pi) - 1e-9))
    half = 0.5 * sweep / count
    angles = start_angle + half * np.arange(2 * count + 1)
    points = centre + np.cos(angles)[:, None] * major + np.sin(angles)[:, None] * minor
    # The middle control point is where the end tangents meet: at 1 / cos(half) of the half angle.
    points[1::2] = centre + (points[1::2] - centre) / np.cos(half)
    weights = np.array([1.0, np.cos(half), 1.0])
    return tuple(Bezier(points[2 * i : 2 * i + 3], weights) for i in range(count))


def end_map(curve: Curve, turn: float, start: ArrayLike, end: ArrayLike) -> FloatArray:
    """Return the (2, 3) affine map that takes a conic arc's ends to new ones.

    A similarity for up to half a turn; beyond, where the chord says little about the size, the
    affine map that also moves the middle by the mean of the ends' moves.
    """
    new_start = frozen_array(start, (2,), "an end point")
    new_end = frozen_array(end, (2,), "an end point")
    old_start, old_end = curve.start, curve.end
    if turn >= 2.0 * np.pi:
        if np.any(new_start != new_end):
            raise GeometryError("a closed curve cannot be opened", place=new_start.tolist())
        return np.column_stack([np.eye(2), new_start - old_start])
    if turn <= np.pi:
        ratio = complex(*(new_end - new_start)) / complex(*(old_end - old_start))
        linear = np.array([[ratio.real, -ratio.imag], [ratio.imag, ratio.real]])
        return np.column_stack([linear, new_start - linear @ old_start])
    middle = curve.point(0.5)
    new_middle = middle + 0.5 * (new_start - old_start + new_end - old_end)
    old = np.column_stack([np.stack([old_start, middle, old_end]), np.ones(3)])
    return np.asarray(np.linalg.solve(old, np.stack([new_start, new_middle, new_end])).T)
