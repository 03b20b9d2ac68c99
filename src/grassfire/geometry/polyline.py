"""Polylines that stand for curves, as lines, circular arcs and cubic splines within a tolerance.

Every vertex between two chords is a corner to the medial axis and gets a branch of its own, of
which the curve that the polyline stands for has none (Dorado 2009, Fig. 1). Corners, lines and
circles are recognised first (`runs`), fitted together with the tangency that the data show
(`tangency`), and what is left becomes fair splines (`fairing`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grassfire.errors import GeometryError
from grassfire.geometry.curve import Curve, FloatArray, cross, dot, frozen_array
from grassfire.geometry.flatten import flatten_parameters
from grassfire.geometry.line import Line
from grassfire.geometry.loop import Loop
from grassfire.geometry.neighbours import Neighbours
from grassfire.geometry.outline import Outline, curves_of
from grassfire.geometry.region import Region
from grassfire.geometry.runs import (
    FEWEST_SPACED,
    FREE,
    PLAIN,
    TIGHT,
    Run,
    chord_turns,
    corners,
    next_run,
    recognise,
    stride_over_noise,
)
from grassfire.geometry.selfcrossing import first_crossing

CORNER_ANGLE = float(np.radians(20.0))
"""Turn at a vertex, in radians, from which it is a corner whatever its neighbours do."""
NEAR = 0.001
"""Share of the tolerance within which two vertices are one."""
NOISE_SHARE = 4.0
"""Standard deviations of the noise within which vertices lie from their curve."""
ACCURACY = 0.01
"""Share of the tolerance to which the distance of vertices from the result is measured."""
RAGGED_TURN = 1.0
"""Median turn, in radians, from which a polyline is all corners or all noise."""
STRIDES = 3
"""How many steps along noisy vertices are tried."""
FAIR_SHARE = 0.05
"""Share of the tolerance within which splines follow exact data."""


def fit_polyline(
    points: ArrayLike, tolerance: float, *, corner_angle: float = CORNER_ANGLE
) -> Loop:
    """Return the loop of lines, circular arcs and cubic splines that a closed polyline stands for.

    Parameters
    ----------
    points : (n, 2) array_like
        In mm; the first may be repeated at the end. Repeated points count once.
    tolerance : float
        In mm, above zero: the accuracy of the vertices, not of the chords between them. Noise
        has to stay below half of it; what noise does is in the notes.
    corner_angle : float
        Turn in radians from which a vertex is a corner whatever its neighbours do, unless
        rounding it would stay within 1.5 times the tolerance. Vertices that turn less are
        corners where they turn far more than the vertices beside them foretell.

    Returns
    -------
    Loop
        Of Line, Arc and BSpline (cubic, twice continuously differentiable inside); tangents agree
        wherever the loop has no corner. A polygon, for which nothing else is right, comes back
        as its lines.

    Raises
    ------
    GeometryError
        For a tolerance or corner angle that is not above zero, points that are not finite, fewer
        than three different ones, or a result that crosses itself.

    Notes
    -----
    Guaranteed, and checked on the result: every vertex lies within `tolerance` of the result; and
    every arc and spline, at four places for each chord, lies within `tolerance + h a / 4` of that
    chord, where h is its length and a the larger turn at those of its ends that are no corners.
    A chord of a circle has a sagitta of h a / 8 for equal chords. Vertices closer together than
    eight standard deviations of their noise are thinned out first; the distance of all of them is
    checked, that of the chords between those that are left.

    Lines, arcs and corners of exact data come back where each is long against the tolerance. Under
    noise, bounded by half the tolerance, that is usual but not guaranteed: an arc counts if a line
    in its place would be off by about 80 times the scatter, so that small fillets become splines,
    and a corner may move by a chord.
    Noise above the tolerance leaves the polyline as it is, or is refused where that crosses itself.
    """
    _check_arguments(tolerance, corner_angle)
    chain = _cleaned(frozen_array(points, (None, 2), "a polyline"), tolerance, closed=True)
    curves = _fitted(chain, tolerance, corner_angle, True, (None, None))
    _check_crossings(curves, tolerance, closed=True)
    return Loop(tuple(curves))


def fit_open_polyline(
    points: ArrayLike,
    tolerance: float,
    *,
    corner_angle: float = CORNER_ANGLE,
    start_tangent: ArrayLike | None = None,
    end_tangent: ArrayLike | None = None,
) -> tuple[Curve, ...]:
    """Return the curves that an open polyline stands for, from its first to its last point.

    Parameters
    ----------
    points, tolerance, corner_angle
        As for `fit_polyline`; two points or more.
    start_tangent, end_tangent : (2,) array_like, optional
        Directions that a spline at that end takes.

    Raises
    ------
    GeometryError
        As `fit_polyline`.
    """
    _check_arguments(tolerance, corner_angle)
    chain = _cleaned(frozen_array(points, (None, 2), "a polyline"), tolerance, closed=False)
    ends = tuple(
        None if given is None else frozen_array(given, (2,), "a tangent")
        for given in (start_tangent, end_tangent)
    )
    curves = _fitted(chain, tolerance, corner_angle, False, (ends[0], ends[1]))
    _check_crossings(curves, tolerance, closed=False)
    return tuple(curves)


def fit_region(region: Region, tolerance: float, *, corner_angle: float = CORNER_ANGLE) -> Region:
    """Return a region with every run of lines fitted; other curves stay as they are.

    Parameters
    ----------
    region : Region
    tolerance, corner_angle
        As for `fit_polyline`.

    Notes
    -----
    A run of lines between other curves keeps its ends. Where its first chord leaves the curve
    before it by no more than a chord of a smooth continuation would, the tangent is kept too.

    Raises
    ------
    GeometryError
        As `fit_polyline`, or if two loops of the result cross.
    """
    _check_arguments(tolerance, corner_angle)
    loops = [_fit_loop(loop, tolerance, corner_angle) for loop in region.loops]
    if len(loops) > 1:
        everything = [curve for loop in loops for curve in loop.curves]
        _check_crossings(everything, tolerance, closed=False)
    return Region(loops[0], tuple(loops[1:]))


def _fit_loop(loop: Loop, tolerance: float, corner_angle: float) -> Loop:
    straight = np.array([isinstance(curve, Line) for curve in loop.curves])
    if np.all(straight):
        points = np.array([curve.start for curve in loop.curves])
        return fit_polyline(points, tolerance, corner_angle=corner_angle)
    start = int(np.argmin(straight))
    curves = loop.curves[start:] + loop.curves[:start]
    straight = np.append(np.roll(straight, -start), False)
    result: list[Curve] = []
    run: list[Curve] = []
    for place, curve in enumerate((*curves, curves[0])):
        if straight[place]:
            run.append(curve)
            continue
        if len(run) > 1:
            run = list(_fit_between(result[-1], run, curve, tolerance, corner_angle))
        result += run
        run = []
        if place < len(curves):
            result.append(curve)
    return Loop(tuple(result))


def _fit_between(
    before: Curve, run: list[Curve], after: Curve, tolerance: float, corner_angle: float
) -> tuple[Curve, ...]:
    """Return the curves for a run of lines between two other curves."""
    points = np.array([curve.start for curve in run] + [run[-1].end])
    turn = np.abs(chord_turns(points))
    ends: list[FloatArray | None] = []
    for tangent, chord, beside in (
        (before.tangent(1.0), points[1] - points[0], turn[1]),
        (after.tangent(0.0), points[-1] - points[-2], turn[-2]),
    ):
        off = abs(float(np.arctan2(cross(tangent, chord), dot(tangent, chord))))
        ends.append(tangent if off <= min(0.75 * beside + 1e-3, corner_angle) else None)
    return fit_open_polyline(
        points, tolerance, corner_angle=corner_angle, start_tangent=ends[0], end_tangent=ends[1]
    )


# -- the plan ------------------------------------------------------------------------------------


def _check_arguments(tolerance: float, corner_angle: float) -> None:
    if not (tolerance > 0.0 and np.isfinite(tolerance)):
        raise GeometryError(f"a fitting tolerance must be above zero, got {tolerance:.6g} mm")
    if not corner_angle > 0.0:
        raise GeometryError(f"a corner angle must be above zero, got {corner_angle:.6g} rad")


def _cleaned(points: FloatArray, tolerance: float, closed: bool) -> FloatArray:
    """Return the points without near repetitions, the first again at the end of a closed chain."""
    fewest = 3 if closed else 2
    kept = points[:1]
    if len(points) > 1:
        step = np.hypot(*np.diff(points, axis=0).T)
        size = float(np.abs(points - points[0]).max())
        least = max(min(NEAR * tolerance, 1e-3 * size), 1e-12 * size)
        fresh = np.append(True, step > 0.0)
        if step.min() <= least:
            # One vertex for each `least` of the length: any number of short steps adds up.
            length = np.concatenate([[0.0], np.cumsum(step)])
            number = np.floor(length / max(least, 1e-300) * (1.0 - 1e-9))
            fresh &= np.append(True, np.diff(number) > 0.0)
            if not closed:
                # The last point stays, the one before it gives way.
                inner = np.flatnonzero(fresh[:-1])
                near = np.hypot(*(points[inner[-1]] - points[-1])) <= least
                fresh[inner[-1]] &= not near or inner[-1] == 0
                fresh[-1] = True
        kept = points[fresh]
        if closed and len(kept) > 1 and np.hypot(*(kept[-1] - kept[0])) <= least:
            kept = kept[:-1]
    if len(kept) < fewest or not np.any(kept != kept[0]):
        raise GeometryError(
            f"a polyline needs {fewest} different points, got {len(kept)}",
            place=points[0].tolist() if len(points) else None,
        )
    return np.concatenate([kept, kept[:1]]) if closed else kept


def _check_crossings(curves: Sequence[Curve], tolerance: float, closed: bool) -> None:
    """Raise GeometryError where curves cross."""
    place = first_crossing(curves, 0.25 * tolerance, closed)
    if place is not None:
        raise GeometryError(
            "a fitted polyline crosses itself",
            place=place.tolist(),
            remedy="mend the polyline there, or fit with a smaller tolerance",
        )


def _fitted(
    chain: FloatArray,
    tolerance: float,
    corner_angle: float,
    closed: bool,
    tangents: tuple[FloatArray | None, FloatArray | None],
) -> list[Curve]:
    """Return the curves for a chain, looked at in steps that are long against its noise."""
    vertices = chain[:-1] if closed else chain
    stride, noise = stride_over_noise(vertices, closed, 0.5 * tolerance)
    ragged = stride > 1
    if len(vertices) > FEWEST_SPACED:
        ragged |= float(np.median(np.abs(chord_turns(chain)))) > RAGGED_TURN
    if ragged and noise > 0.5 * tolerance:
        # A finely toothed polygon, or vertices that nothing smooth is within the tolerance of.
        return [Line(first, last) for first, last in pairwise(chain)]
    noise = min(noise, 0.5 * tolerance)
    for _ in range(STRIDES):
        # The last vertex takes the place of one that may be next to it.
        some = np.concatenate([chain[: len(chain) - stride : stride], chain[-1:]])
        outline = _planned(some, tolerance, corner_angle, closed, noise)
        curves = curves_of(replace(outline, tangents=tangents))
        if stride == 1 or _farthest(curves, vertices, tolerance) <= tolerance:
            return curves
        stride //= 2
    return [Line(first, last) for first, last in pairwise(chain)]


def _farthest(curves: Sequence[Curve], points: FloatArray, tolerance: float) -> float:
    """Return a bound above the distances of points (m, 2) from curves, close below `tolerance`."""
    accuracy = ACCURACY * tolerance
    samples = []
    for curve in curves:
        even = np.linspace(0.0, 1.0, int(np.ceil(curve.length(accuracy) / tolerance)) + 2)
        t = np.union1d(even, flatten_parameters(curve, accuracy))
        samples.append(curve.point(t))
    rows = np.concatenate(samples)
    nearest = Neighbours(rows).nearest(points)[1][:, 0]
    off = np.full(len(points), np.inf)
    for other in (np.maximum(nearest - 1, 0), np.minimum(nearest + 1, len(rows) - 1)):
        change, spoke = rows[other] - rows[nearest], points - rows[nearest]
        share = dot(spoke, change) / np.maximum(dot(change, change), 1e-300)
        foot = np.clip(share, 0.0, 1.0)[:, None] * change
        off = np.minimum(off, np.hypot(*(spoke - foot).T))
    return float(off.max()) + accuracy


def _planned(
    chain: FloatArray, tolerance: float, corner_angle: float, closed: bool, noise: float
) -> Outline:
    vertices = chain[:-1] if closed else chain
    corner = corners(vertices, closed, tolerance, corner_angle, noise)
    threshold = float(np.clip(NOISE_SHARE * noise, TIGHT * tolerance, 0.95 * tolerance))
    target = float(np.clip(NOISE_SHARE * noise, FAIR_SHARE * tolerance, 0.95 * tolerance))
    if closed:
        chain, corner, runs = _closed_runs(vertices, corner, threshold, tolerance)
    else:
        runs = _stretches(chain, corner, threshold, tolerance)
    return Outline(chain, corner, tuple(runs), closed, tolerance, threshold, target)


def _stretches(
    chain: FloatArray, corner: NDArray[np.bool_], threshold: float, tolerance: float
) -> list[Run]:
    """Return the runs between consecutive corners of a chain that starts and ends with one."""
    runs: list[Run] = []
    places = np.flatnonzero(corner).tolist()
    for first, last in pairwise(places):
        if last == first + 1:
            runs.append(Run(PLAIN, first, last))
            continue
        found = recognise(chain[first : last + 1], threshold, tolerance)
        runs += [run.shifted(first) for run in found]
    return runs


def _closed_runs(
    vertices: FloatArray, corner: NDArray[np.bool_], threshold: float, tolerance: float
) -> tuple[FloatArray, NDArray[np.bool_], list[Run]]:
    """Return the chain, its corners and runs, from where a run starts."""
    if np.any(corner):
        chain, marks = _rolled(vertices, int(np.argmax(corner)), corner)
        return chain, marks, _stretches(chain, marks, threshold, tolerance)
    # Farthest from the centroid: a start that does not depend on the order of the points.
    reach = np.hypot(*(vertices - vertices.mean(axis=0)).T)
    start = int(np.argmax(np.round(reach / reach.max(), 9)))
    chain, marks = _rolled(vertices, start, corner)
    run = next_run(chain, 0, threshold)
    if run.last == len(vertices):
        return chain, marks, [run]
    shifted, _ = _rolled(vertices, start + run.last, corner)
    runs = recognise(shifted, threshold, tolerance, closed=True)
    solid = [run for run in runs if run.kind != FREE]
    if not solid:
        return chain, marks, [Run(FREE, 0, len(vertices))]
    if runs[0].kind == FREE and runs[-1].kind == FREE:
        first, last = solid[0].first, len(vertices)
        shifted, _ = _rolled(vertices, start + run.last + first, corner)
        moved = [run.shifted(-first) for run in runs[1:-1]]
        runs = [*moved, Run(FREE, moved[-1].last, last)]
    return shifted, marks, runs


def _rolled(
    vertices: FloatArray, start: int, corner: NDArray[np.bool_]
) -> tuple[FloatArray, NDArray[np.bool_]]:
    start %= len(vertices)
    chain, marks = np.roll(vertices, -start, axis=0), np.roll(corner, -start)
    return np.concatenate([chain, chain[:1]]), np.append(marks, marks[0])
