"""Where a curve bends the other way, bends most, or is not smooth."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from grassfire.geometry.bezier import Bezier
from grassfire.geometry.bspline import BSpline
from grassfire.geometry.chebyshev import real_roots
from grassfire.geometry.curve import Curve, FloatArray, cross, dot
from grassfire.geometry.parallel import ParallelCurve

STALLED = 1e-7
"""Speed, relative to the curve's size, below which a point may be a cusp."""

NEIGHBOURHOOD = 1e-3
"""Parameter distance within which slow points belong to one cusp."""


def inflections(curve: Curve) -> FloatArray:
    """Return the ascending inner parameters where the curvature changes sign."""
    base, low, high = _plain(curve)

    def bend(t: FloatArray) -> FloatArray:
        _, first, second = base.evaluate(t, 2)
        return cross(first, second)

    scale = float(np.abs(bend(_samples(base))).max())
    floor = 1e-13 * max(scale, 1e-3 * base.size**2)
    return _part(real_roots(bend, base.breaks(), floor=floor), low, high)


def curvature_extrema(curve: Curve) -> FloatArray:
    """Return the ascending inner parameters where the curvature is stationary.

    Roots of the numerator of dk/dt, (c' x c''') |c'|^2 - 3 (c' x c'') (c'.c''); where the
    curvature jumps at a knot the knot is listed when the derivative changes sign there. Lines and
    circular arcs, whose curvature is constant, have none.
    """
    base, low, high = _plain(curve)

    def rate(t: FloatArray) -> FloatArray:
        _, first, second, third = base.evaluate(t, 3)
        return np.asarray(
            cross(first, third) * dot(first, first)
            - 3.0 * cross(first, second) * dot(first, second)
        )

    _, first, second, third = base.evaluate(_samples(base), 3)
    terms = np.hypot(*first.T) ** 3 * np.hypot(*third.T)
    terms = terms + np.hypot(*first.T) ** 2 * np.hypot(*second.T) ** 2
    floor = 1e-13 * float(terms.max())
    return _part(real_roots(rate, base.breaks(), floor=floor), low, high)


def cusps(curve: Curve) -> FloatArray:
    """Return the ascending inner parameters where the curve stops: its derivative vanishes."""
    if isinstance(curve, ParallelCurve):
        return curve.cusps()
    if not isinstance(curve, (Bezier, BSpline)):
        return np.empty(0)

    def slowing(t: FloatArray) -> FloatArray:
        _, first, second = curve.evaluate(t, 2)
        return dot(first, second)

    edges = curve.breaks()
    candidates = np.concatenate([edges[1:-1], real_roots(slowing, edges)])
    candidates = np.unique(candidates[(candidates > 1e-9) & (candidates < 1.0 - 1e-9)])
    first = curve.derivative(candidates)
    speed = np.hypot(first[:, 0], first[:, 1])
    stopped = speed <= STALLED * curve.size
    candidates, speed = candidates[stopped], speed[stopped]
    # Around a point where the derivative vanishes to a higher order many are slow: the slowest.
    group = np.cumsum(np.diff(candidates, prepend=-np.inf) > NEIGHBOURHOOD)
    slowest = [
        candidates[group == number][np.argmin(speed[group == number])]
        for number in np.unique(group)
    ]
    return np.array(slowest, dtype=np.float64)


def split_at_corners(curve: Curve, angular_tolerance: float) -> tuple[Curve, ...]:
    """Return the parts between the corners and cusps inside a curve; the curve if there are none.

    Parameters
    ----------
    angular_tolerance : float
        Turn of the tangent, in radians, above which the curve is split: B-splines at knots of
        full multiplicity, Bezier curves, B-splines and offsets at cusps.
    """
    candidates = [cusps(curve)]
    if isinstance(curve, BSpline):
        knots, low_high = curve.knots, curve.domain
        values, repeats = np.unique(knots, return_counts=True)
        full = values[(repeats >= curve.degree) & (values > low_high[0]) & (values < low_high[1])]
        candidates.append((full - low_high[0]) / (low_high[1] - low_high[0]))
    places = np.unique(np.concatenate(candidates))
    if not len(places):
        return (curve,)
    edges = np.concatenate([[0.0], places, [1.0]])
    edges = edges[np.concatenate([[True], np.diff(edges) > 1e-10])]
    edges[-1] = 1.0
    if len(edges) == 2:
        return (curve,)
    ends = np.stack([_one_sided(curve, edges, last=True), _one_sided(curve, edges, last=False)])
    before, after = ends[0, :-1], ends[1, 1:]
    turn = np.abs(np.arctan2(cross(before, after), dot(before, after)))
    kept = np.concatenate([[0.0], edges[1:-1][turn > angular_tolerance], [1.0]])
    if len(kept) == 2:
        return (curve,)
    return tuple(curve.subcurve(float(t0), float(t1)) for t0, t1 in pairwise(kept))


def _one_sided(curve: Curve, edges: Sequence[float] | FloatArray, last: bool) -> FloatArray:
    """Return the (m, 2) end (or start) tangents of the parts between consecutive edges."""
    parts = [curve.subcurve(float(edges[i]), float(edges[i + 1])) for i in range(len(edges) - 1)]
    return np.array([part.tangent(1.0 if last else 0.0) for part in parts])


def _plain(curve: Curve) -> tuple[Curve, float, float]:
    """Return the curve whose curvature has the same features, and the part of it."""
    if isinstance(curve, ParallelCurve):
        return curve.base, curve.t0, curve.t1
    return curve, 0.0, 1.0


def _part(roots: FloatArray, low: float, high: float) -> FloatArray:
    inner = (roots - low) / (high - low)
    return np.asarray(inner[(inner > 0.0) & (inner < 1.0)])


def _samples(curve: Curve) -> FloatArray:
    edges = curve.breaks()
    return np.asarray((edges[:-1, None] + np.diff(edges)[:, None] * np.linspace(0, 1, 9)).ravel())
