"""SPLINE data to exact curves: clamped, cut at corners, lines and arcs recognised."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from grassfire.geometry import Arc, BSpline, Curve, Line, simplify, split_at_corners

FloatArray = NDArray[np.float64]


def spline_curves(
    degree: int,
    knots: FloatArray,
    control: FloatArray,
    weights: FloatArray,
    fit: FloatArray,
    tangents: FloatArray | None,
    *,
    declared_closed: bool,
    angular_tolerance: float,
) -> tuple[list[Curve], bool]:
    """Return the curves of a SPLINE entity and whether they close.

    Parameters
    ----------
    degree : int
    knots : (n + degree + 1,) array
    control : (n, 2) array, mm
        Empty when only fit points are given.
    weights : (n,) array
        Empty for a polynomial spline.
    fit : (m, 2) array, mm
        Used only without control points.
    tangents : (2, 2) array or None
        Directions at the first and last fit point.
    declared_closed : bool
        The entity's closed flag; closes fit-point splines, and is otherwise judged by the ends.

    angular_tolerance : float
        Turn in radians above which a spline is cut at a knot of full multiplicity or a cusp.

    Returns
    -------
    list of curves in order, bool

    Raises
    ------
    ValueError, GeometryError
        Inconsistent data.
    """
    if len(control) == 0:
        degree, knots, control = _through_fit_points(fit, tangents, closed=declared_closed)
        weights = np.empty(0)
    if len(control) < 2 or degree < 1:
        raise ValueError(f"{len(control)} control points of degree {degree} make no curve")
    if len(knots) == 0:
        knots = _uniform_knots(len(control), degree)
    if len(knots) != len(control) + degree + 1:
        raise ValueError(f"{len(knots)} knots for {len(control)} control points of degree {degree}")
    if np.any(np.diff(knots) < 0.0) or knots[degree] >= knots[len(control)]:
        raise ValueError("its knots do not ascend")
    if len(weights) not in (0, len(control)) or np.any(weights <= 0.0):
        raise ValueError("its weights are not one positive number per control point")
    if not all(np.all(np.isfinite(part)) for part in (knots, control, weights)):
        raise ValueError("coordinates that are no numbers")
    rational = len(weights) > 0 and float(np.ptp(weights)) > 0.0
    spline = BSpline(degree, _merge_close(knots), control, weights if rational else None)
    clamped = spline.clamped()
    size = float(np.hypot(*np.ptp(clamped.control_points, axis=0)))
    parts = _recognise(clamped, 1e-9 * size, angular_tolerance)
    gap = float(np.hypot(*(parts[0].start - parts[-1].end)))
    return parts, gap <= 1e-9 * size


def _uniform_knots(count: int, degree: int) -> FloatArray:
    """Return the open uniform knot vector for `count` control points."""
    inner = np.arange(1, count - degree, dtype=np.float64)
    last = float(max(count - degree, 1))
    return np.concatenate([np.zeros(degree + 1), inner, np.full(degree + 1, last)])


def _merge_close(knots: FloatArray) -> FloatArray:
    """Make knots equal that differ by less than 1e-9 of the range, as writers round them."""
    steps = np.diff(knots)
    fresh = np.concatenate([[True], steps > 1e-9 * (knots[-1] - knots[0])])
    return np.asarray(knots[fresh][np.cumsum(fresh) - 1], dtype=np.float64)


def _through_fit_points(
    fit: FloatArray, tangents: FloatArray | None, *, closed: bool
) -> tuple[int, FloatArray, FloatArray]:
    """Return (degree, knots, control points) of the cubic through the fit points."""
    if len(fit) > 1:
        step = np.hypot(*np.diff(fit, axis=0).T)
        fit = fit[np.concatenate([[True], step > 0.0])]
    if closed and len(fit) > 3:
        from scipy.interpolate import make_interp_spline

        if np.hypot(*(fit[0] - fit[-1])) > 1e-9 * float(np.abs(np.ptp(fit, axis=0)).max()):
            fit = np.vstack([fit, fit[:1]])
        else:
            fit = np.vstack([fit[:-1], fit[:1]])
        parameter = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(fit, axis=0).T))])
        spline = make_interp_spline(parameter, fit, k=3, bc_type="periodic")
        return 3, np.asarray(spline.t, dtype=np.float64), np.asarray(spline.c, dtype=np.float64)
    if len(fit) < 2:
        raise ValueError(f"{len(fit)} different fit points make no curve")
    if len(fit) == 2 and tangents is None:
        return 1, np.array([0.0, 0.0, 1.0, 1.0]), fit
    from ezdxf.math import Vec3, fit_points_to_cad_cv

    tool = fit_points_to_cad_cv(
        [Vec3(x, y) for x, y in fit],
        tangents=None if tangents is None else [Vec3(x, y) for x, y in tangents],
    )
    control = np.array([(point.x, point.y) for point in tool.control_points])
    return tool.degree, np.array(tool.knots(), dtype=np.float64), control


def _recognise(spline: BSpline, tolerance: float, angular_tolerance: float) -> list[Curve]:
    """Return the spline cut at its corners, as lines and arcs where it is nothing else."""
    if spline.degree == 1:
        points = spline.control_points
        moves = np.hypot(*np.diff(points, axis=0).T) > tolerance
        ends = [points[0], *points[1:][moves]]
        return [Line(start, end) for start, end in itertools.pairwise(ends)] or [spline]
    parts: list[Curve] = []
    for section in split_at_corners(spline, angular_tolerance):
        simple = simplify(section, tolerance)
        pieces: tuple[Curve, ...] = (simple,)
        if not isinstance(simple, Line | Arc):
            beziers = tuple(simplify(bezier, tolerance) for bezier in section.to_beziers())
            if all(isinstance(bezier, Line | Arc) for bezier in beziers):
                pieces = beziers
        parts += pieces
    return parts
