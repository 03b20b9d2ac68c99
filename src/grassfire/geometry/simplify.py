"""Free curves that are lines or circular arcs in disguise."""

from __future__ import annotations

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry.arc import Arc
from grassfire.geometry.bezier import Bezier
from grassfire.geometry.bspline import BSpline
from grassfire.geometry.chebyshev import nodes
from grassfire.geometry.curve import Curve, FloatArray, cross
from grassfire.geometry.line import Line
from grassfire.geometry.parallel import ParallelCurve

OVERSAMPLING = 1.5
"""A polynomial of degree d stays below 1.42 times its maximum on 2 d + 1 Chebyshev points
(Ehlich and Zeller 1964): what the samples must keep within for the curve to."""


def simplify(curve: Curve, tolerance: float) -> Curve:
    """Return a Line or an Arc with the same ends where the curve is one, else the curve itself.

    Parameters
    ----------
    curve : Curve
        Bezier curves and B-splines (rational too), elliptical arcs and offsets are looked at.
    tolerance : float
        Largest deviation in mm, above zero.

    Raises
    ------
    GeometryError
        If the tolerance is not above zero.
    """
    if not tolerance > 0.0:
        raise GeometryError(f"a tolerance must be above zero, got {tolerance:.6g} mm")
    if isinstance(curve, (Line, Arc)):
        return curve
    if isinstance(curve, ParallelCurve):
        base = simplify(curve.base.subcurve(curve.t0, curve.t1), tolerance)
        if not isinstance(base, (Line, Arc)) or np.any(curve.speed_factor(nodes(8)) <= 0.0):
            return curve
        # Not the parallel of `base`: its normals, so its ends, differ a little from the curve's.
    line = _as_line(curve, tolerance)
    if line is not None:
        return line
    arc = _as_arc(curve, tolerance)
    return curve if arc is None else arc


def _as_line(curve: Curve, tolerance: float) -> Line | None:
    """Return the chord when the curve's control points (so the curve) lie along it."""
    start, end = curve.start, curve.end
    length = float(np.hypot(*(end - start)))
    if length <= 1e-9 * curve.size:
        return None
    if isinstance(curve, (Bezier, BSpline)):
        plain = curve.clamped() if isinstance(curve, BSpline) else curve
        points = plain.control_points
    else:
        points = curve.point(nodes(16))
    direction = (end - start) / length
    along, aside = (points - start) @ direction, cross(direction, points - start)
    straight = np.all(np.abs(aside) <= tolerance / OVERSAMPLING)
    inside = np.all((along >= -tolerance) & (along <= length + tolerance))
    return Line(start, end) if straight and inside else None


def _as_arc(curve: Curve, tolerance: float) -> Arc | None:
    """Return the circle through the ends and the middle when the curve follows it."""
    degree = curve.degree if isinstance(curve, (Bezier, BSpline)) else 8
    edges, unit = curve.breaks(), nodes(max(4 * degree, 16))
    t = np.unique(edges[:-1, None] + np.diff(edges)[:, None] * unit)
    points = curve.point(t)
    start, end = curve.start, curve.end
    closed = float(np.hypot(*(end - start))) <= 1e-9 * curve.size
    candidate = _closed_circle(points) if closed else _open_arc(points, start, end)
    if candidate is None:
        return None
    spokes = points - candidate.centre
    deviation = np.abs(np.hypot(spokes[:, 0], spokes[:, 1]) - candidate.radius)
    if deviation.max() > tolerance / OVERSAMPLING:
        return None
    steps = np.diff(np.unwrap(np.arctan2(spokes[:, 1], spokes[:, 0])))
    turned = float(steps.sum())
    if closed:
        candidate = Arc(
            candidate.centre,
            candidate.radius,
            candidate.start_angle,
            float(np.copysign(2.0 * np.pi, turned)),
        )
    forward = np.all(steps * np.sign(turned) >= -tolerance / candidate.radius)
    return candidate if forward and abs(turned - candidate.sweep) < 1e-3 else None


def _closed_circle(points: FloatArray) -> Arc | None:
    """Return the circle through the first of the points and two that are far from it."""
    first = points[0]
    reach = np.hypot(*(points - first).T)
    second = points[int(np.argmax(reach))]
    aside = np.abs(cross(points - first, second - first))
    third = points[int(np.argmax(aside))]
    try:
        arc = Arc.from_three_points(first, third, second)
    except GeometryError:
        return None
    return Arc(arc.centre, arc.radius, arc.start_angle)


def _open_arc(points: FloatArray, start: FloatArray, end: FloatArray) -> Arc | None:
    """Return the arc from start to end through the point that is farthest from both."""
    reach = np.minimum(np.hypot(*(points - start).T), np.hypot(*(points - end).T))
    try:
        return Arc.from_three_points(start, points[int(np.argmax(reach))], end)
    except GeometryError:
        return None
