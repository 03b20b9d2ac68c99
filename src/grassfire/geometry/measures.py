"""Area and bounding box of many curves, each type of curve at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from grassfire.geometry.arc import Arc
from grassfire.geometry.bezier import Bezier
from grassfire.geometry.bspline import BSpline
from grassfire.geometry.chebyshev import bernstein_family, gauss_rule
from grassfire.geometry.curve import Bounds, Curve, FloatArray, box, cross
from grassfire.geometry.line import Line


def swept_area(curves: Sequence[Curve], ends: FloatArray) -> float:
    """Return half the integral of (c - origin) x dc over curves in mm^2, from the first start.

    Parameters
    ----------
    curves : sequence of n Curve
    ends : (n, 2, 2) float array
        Their starts and ends, mm.
    """
    origin = ends[0, 0]
    local = ends - origin
    chords = 0.5 * cross(local[:, 0], local[:, 1])
    total = 0.0
    sectors: list[tuple[float, float]] = []
    plain: dict[int, list[FloatArray]] = {}
    straight = np.ones(len(curves), dtype=bool)
    for index, curve in enumerate(curves):
        if isinstance(curve, Line):
            continue
        if isinstance(curve, Arc):
            # Between the arc and its chord lies the segment of the circle.
            sectors.append((curve.radius, curve.sweep))
        else:
            straight[index] = False
            if isinstance(curve, Bezier) and curve.weights is None:
                plain.setdefault(curve.degree, []).append(curve.control_points)
            else:
                total += curve.area_integral(origin)
    radius, sweep = np.array(sectors or [(0.0, 0.0)]).T
    total += float(chords[straight].sum() + 0.5 * (radius**2 * (sweep - np.sin(sweep))).sum())
    for degree, points in plain.items():
        control = np.array(points) - origin
        unit, rule = gauss_rule(degree)
        point, lower = bernstein_family(degree, 0.5 * (unit + 1.0), 1)
        place, slope = point @ control, lower @ (degree * np.diff(control, axis=1))
        total += float(0.25 * (cross(place, slope) @ rule).sum())
    return total


def polygon_areas(points: FloatArray, first: NDArray[np.int64]) -> FloatArray:
    """Return signed areas (k,) of polygons one after the other in mm^2.

    Parameters
    ----------
    points : (n, 2) float array
        Their corners, mm.
    first : (k,) int array
        Rows of the first corner of each.
    """
    count = np.diff(first, append=len(points))
    x, y = (points - points[first].repeat(count, axis=0)).T
    # each begins at its origin: what leads from one to the next has no area
    swept = np.zeros(len(points))
    swept[:-1] = x[:-1] * y[1:] - y[:-1] * x[1:]
    return np.asarray(0.5 * np.add.reduceat(swept, first))


def joint_box(curves: Sequence[Curve], ends: FloatArray) -> Bounds:
    """Return the exact bounding box of curves with starts and ends `ends` (n, 2, 2).

    Only a curve whose hull reaches out of the box of all ends is looked at closely.
    """
    result = np.array(box(ends.reshape(-1, 2)))
    hulls: list[tuple[float, float, float, float]] = []
    open_: list[Curve] = []
    polygons: list[FloatArray] = []
    hulled: list[Curve] = []
    for curve in curves:
        if isinstance(curve, Arc):
            x, y = curve.centre.tolist()
            reach = curve.radius
            hulls.append((x - reach, y - reach, x + reach, y + reach))
            open_.append(curve)
        elif isinstance(curve, (Bezier, BSpline)):
            polygons.append(curve.control_points)
            hulled.append(curve)
        elif not isinstance(curve, Line):
            hulls.append((-np.inf, -np.inf, np.inf, np.inf))
            open_.append(curve)
    low_high = np.array(hulls).reshape(-1, 4)
    if polygons:
        points = np.concatenate(polygons)
        heads = np.cumsum([0, *(len(polygon) for polygon in polygons[:-1])])
        low = np.minimum.reduceat(points, heads, axis=0)
        high = np.maximum.reduceat(points, heads, axis=0)
        low_high = np.concatenate([low_high, np.concatenate([low, high], axis=1)])
        open_.extend(hulled)
    beyond = np.concatenate([result[:2] - low_high[:, :2], low_high[:, 2:] - result[2:]], axis=1)
    reach = beyond.max(axis=1, initial=0.0)
    # Those that reach farthest first: then most of the others lie inside what is known.
    order = np.argsort(-reach, kind="stable")
    for row in order[: np.count_nonzero(reach > 0.0)]:
        if (low_high[row, :2] < result[:2]).any() or (low_high[row, 2:] > result[2:]).any():
            inside = np.array(open_[int(row)].bounds())
            result[:2] = np.minimum(result[:2], inside[:2])
            result[2:] = np.maximum(result[2:], inside[2:])
    return float(result[0]), float(result[1]), float(result[2]), float(result[3])
