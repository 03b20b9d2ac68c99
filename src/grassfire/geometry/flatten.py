"""Polylines within a chord tolerance that is guaranteed by bounds on second derivatives."""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry.arc import Arc
from grassfire.geometry.bezier import Bezier, homogeneous, split_left_right
from grassfire.geometry.bspline import BSpline
from grassfire.geometry.chebyshev import fit_piecewise
from grassfire.geometry.curve import Curve, FloatArray
from grassfire.geometry.elliptical_arc import EllipticalArc
from grassfire.geometry.line import Line

if TYPE_CHECKING:
    from grassfire.geometry.loop import Loop


def flatten(curve: Curve | Loop, tolerance: float) -> FloatArray:
    """Return a polyline whose chords stay within a tolerance of the curve.

    Parameters
    ----------
    curve : Curve or Loop
        A loop gives a closed polyline, its first point repeated at the end.
    tolerance : float
        Largest distance between a chord and its piece of the curve, in mm, above zero.

    Returns
    -------
    (m, 2) array
        Points on the curve in order, ends included.

    Raises
    ------
    GeometryError
        If the tolerance is not above zero.
    """
    if isinstance(curve, Curve):
        return curve.point(flatten_parameters(curve, tolerance))
    if curve.vertices is not None:
        return np.concatenate([curve.vertices, curve.vertices[:1]])
    parts = [piece.point(flatten_parameters(piece, tolerance))[:-1] for piece in curve.curves]
    points = np.concatenate(parts)
    return np.concatenate([points, points[:1]])


def flatten_parameters(curve: Curve, tolerance: float) -> FloatArray:
    """Return the ascending parameters (m,) of the points of `flatten`, 0 and 1 included."""
    if not tolerance > 0.0:
        raise GeometryError(f"a flattening tolerance must be above zero, got {tolerance:.6g} mm")
    if isinstance(curve, Line):
        return np.array([0.0, 1.0])
    if isinstance(curve, Arc):
        # Sagitta r (1 - cos(a / 2)); the half-angle sine keeps accuracy for tiny ratios.
        step = 4.0 * np.arcsin(min(1.0, np.sqrt(0.5 * min(1.0, tolerance / curve.radius))))
        return _uniform(abs(curve.sweep) / step, abs(curve.sweep))
    if isinstance(curve, EllipticalArc):
        # |c''| <= sweep^2 times the longest half-diameter (largest singular value).
        longest = np.linalg.norm(np.stack([curve.major, curve.minor]), ord=2)
        steps = np.sqrt(curve.sweep**2 * longest / (8.0 * tolerance))
        return _uniform(float(steps), abs(curve.sweep))
    if isinstance(curve, Bezier):
        control = homogeneous(curve.control_points, curve.weights)[None]
        return _subdivide(np.array([[0.0, 1.0]]), control, tolerance)
    edges = curve.breaks()
    if isinstance(curve, BSpline):
        intervals = np.stack([edges[:-1], edges[1:]], axis=-1)
        return _subdivide(intervals, curve.segment_coefficients(), tolerance)
    # Proxies within 1/64 of the tolerance: their chords move by no more, twice over.
    intervals, control = fit_piecewise(curve.point, edges, tolerance / 64.0)
    return _subdivide(intervals, control, tolerance * (1.0 - 1.0 / 16.0))


def _uniform(steps: float, sweep: float) -> FloatArray:
    """Return uniform parameters; three chords a turn at least, so that a circle has area."""
    least = ceil(sweep * 3.0 / (2.0 * np.pi) - 1e-9)
    return np.linspace(0.0, 1.0, max(ceil(steps - 1e-9), least, 1) + 1)


def _subdivide(intervals: FloatArray, control: FloatArray, tolerance: float) -> FloatArray:
    """Halve pieces, a level at a time, until each chord is within tolerance."""
    done = [intervals[0, :1], intervals[-1, 1:]]
    closed = len(intervals) == 1 and np.all(_plane(control)[0, 0] == _plane(control)[0, -1])
    for level in range(60):
        far = second_difference_bound(control) > tolerance
        if closed and level < 2:
            far[:] = True
        done.append(intervals[~far, 0])
        intervals, control = intervals[far], control[far]
        if not len(intervals):
            break
        middle = intervals.mean(axis=1)
        left, right = split_left_right(control, 0.5)
        control = np.concatenate([left, right])
        low = np.stack([intervals[:, 0], middle], axis=-1)
        high = np.stack([middle, intervals[:, 1]], axis=-1)
        intervals = np.concatenate([low, high])
    return np.unique(np.concatenate(done))


def _plane(control: FloatArray) -> FloatArray:
    """Return the (m, n+1, 2) plane control points of polynomial or homogeneous coefficients."""
    if control.shape[-1] == 2:
        return control
    return np.asarray(control[..., :2] / control[..., 2:])


def second_difference_bound(control: FloatArray) -> FloatArray:
    """Return (m,) upper bounds of the distance between Bezier pieces and their chords, in mm.

    max |c''| / 8 over a unit parameter. For rational pieces c'' is bounded by the quotient rule
    about the first control point: |c''| <= (|N''| + 2 |c'| |w'| + |c| |w''|) / w.
    """
    degree = control.shape[1] - 1
    second = degree * (degree - 1)
    points = _plane(control)
    if degree < 2:
        return np.zeros(len(control))
    if control.shape[-1] == 2:
        bend = np.diff(points, n=2, axis=1)
        return np.asarray(second * np.hypot(bend[..., 0], bend[..., 1]).max(axis=1) / 8.0)
    weight = control[..., 2]
    local = points - points[:, :1]
    numerator = local * weight[..., None]
    reach = np.hypot(local[..., 0], local[..., 1]).max(axis=1)

    def largest(array: FloatArray, order: int) -> FloatArray:
        change = np.diff(array, n=order, axis=1)
        size = np.abs(change) if change.ndim == 2 else np.hypot(change[..., 0], change[..., 1])
        return np.asarray(size.max(axis=1) * (degree if order == 1 else second))

    least = weight.min(axis=1)
    weight_slope = largest(weight, 1)
    slope = (largest(numerator, 1) + reach * weight_slope) / least
    bend_bound = largest(numerator, 2) + 2.0 * slope * weight_slope + reach * largest(weight, 2)
    # A control point's polygon bounds too, and is tighter for coarse pieces.
    return np.asarray(np.minimum(bend_bound / least / 8.0, 2.0 * reach))
