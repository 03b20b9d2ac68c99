"""Cubic splines of few spans near given points: fair where interpolation would follow the noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grassfire.geometry.bspline import BSpline
from grassfire.geometry.curve import FloatArray, dot

if TYPE_CHECKING:
    from scipy import sparse

DEGREE = 3
FEWEST_PERIODIC = 8
ROUNDS = 24
FEW_ROUNDS = 6
"""How often spans are halved that a part of the points has determined."""
PATIENCE = 8
"""How often spans are halved without the deviation falling by a tenth."""
MANY = 3000
"""Points from which the spans are found."""
DENSE = 150
"""Control points up to which full matrices are faster than sparse ones."""
PENALTY = 1e-9
"""Weight of the squared third derivative times the sixth power of the span, against the data."""


@dataclass(frozen=True, eq=False)
class Spline:
    """A spline, the parameters (m,) of its points' feet in [0, 1], and the distances (m,) in mm."""

    curve: BSpline
    feet: FloatArray
    deviation: FloatArray


@dataclass(frozen=True, eq=False)
class _Task:
    """What is to be fitted, with parameters from 0 to 1."""

    points: FloatArray
    parameter: FloatArray
    edges: FloatArray
    closed: bool
    tangents: tuple[FloatArray | None, FloatArray | None]


def fit_spline(
    points: FloatArray,
    target: float,
    limit: float,
    closed: bool,
    tangents: tuple[FloatArray | None, FloatArray | None] = (None, None),
) -> Spline | None:
    """Return a cubic spline of few spans near points.

    Parameters
    ----------
    points : (m, 2) array
        In mm; the first is repeated at the end of a closed run.
    target, limit : float
        Distance from the points in mm at which to stop, and at which to give up.
    closed : bool
        Periodic with two continuous derivatives; else from the first to the last point.
    tangents : pair of (2,) array or None
        Directions at the ends of an open run.

    Returns
    -------
    Spline or None
        None if no spline comes within the limit.
    """
    parameter = _lengths(points, target, closed)
    edges = np.linspace(0.0, 1.0, (FEWEST_PERIODIC if closed else 1) + 1)
    task = _Task(points, parameter, edges, closed, tangents)
    if len(points) > 2 * MANY:
        # Spans from a part of the points first.
        some = np.unique(np.linspace(0, len(points) - 1, MANY).astype(np.int64))
        part = _Task(points[some], parameter[some], edges, closed, tangents)
        found, part = _search(part, target, ROUNDS)
        if found is None or found.deviation.max() > limit:
            return None
        best = _search(replace(task, edges=part.edges), target, FEW_ROUNDS)[0]
    else:
        best = _search(task, target, ROUNDS)[0]
    return best if best is not None and best.deviation.max() <= limit else None


def _lengths(points: FloatArray, noise: float, closed: bool) -> FloatArray:
    """Return the lengths (m,) up to each point from 0 to 1, along means of neighbours where the
    points are closer together than their noise."""
    step = np.hypot(*np.diff(points, axis=0).T)
    width = min(int(np.ceil(2.0 * noise / float(step.mean()))), len(points) // 50)
    if width > 1:
        if closed:
            ring = np.concatenate([points[-1 - width : -1], points, points[1 : width + 1]])
        else:
            # Mirrored at the ends, so that the means stay there.
            head = 2.0 * points[0] - points[width:0:-1]
            tail = 2.0 * points[-1] - points[-2 : -2 - width : -1]
            ring = np.concatenate([head, points, tail])
        sums = np.concatenate([np.zeros((1, 2)), np.cumsum(ring, axis=0)])
        mean = (sums[2 * width + 1 :] - sums[: -2 * width - 1]) / (2 * width + 1)
        step = np.hypot(*np.diff(mean, axis=0).T)
    length = np.concatenate([[0.0], np.cumsum(step)])
    return np.asarray(length / length[-1])


def _search(task: _Task, target: float, rounds: int) -> tuple[Spline | None, _Task]:
    """Return the best spline as spans are halved, and the last task."""
    best: Spline | None = None
    worst: list[float] = []
    for _ in range(rounds):
        found = _fit(task)
        if found is not None and (best is None or found.deviation.max() < best.deviation.max()):
            best = found
        if found is not None and found.deviation.max() <= target:
            break
        worst.append(np.inf if best is None else float(best.deviation.max()))
        if len(worst) > PATIENCE and worst[-1] > 0.9 * worst[-1 - PATIENCE]:
            break
        finer = _refined(task, found, target)
        if len(finer) == len(task.edges):
            break
        task = replace(task, edges=finer)
    return best, task


def _refined(task: _Task, found: Spline | None, target: float) -> FloatArray:
    """Return the edges with the spans halved that are off by more than the target."""
    edges, spans = task.edges, len(task.edges) - 1
    inside = task.parameter if found is None else found.feet
    span = np.clip(np.searchsorted(edges, inside, side="right") - 1, 0, spans - 1)
    count = np.bincount(span, minlength=spans)
    worst = np.full(spans, np.inf if found is None else 0.0)
    if found is not None:
        np.maximum.at(worst, span, found.deviation)
    # Neighbouring spans stay within a factor of two, or the curvature swings.
    wide = np.diff(edges)
    halve = (worst > target) & (count >= 2)
    for _ in range(spans):
        final = np.where(halve, 0.5 * wide, wide)
        left, right = np.roll(final, 1), np.roll(final, -1)
        if not task.closed:
            left[0], right[-1] = np.inf, np.inf
        more = ~halve & (final > 2.001 * np.minimum(left, right)) & (count >= 2)
        if not np.any(more):
            break
        halve |= more
    middle = 0.5 * (edges[:-1] + edges[1:])[halve]
    return np.sort(np.concatenate([edges, middle]))


def _knots(task: _Task) -> FloatArray:
    edges = task.edges
    if task.closed:
        return np.concatenate([edges[-4:-1] - 1.0, edges, edges[1:4] + 1.0])
    return np.concatenate([np.zeros(DEGREE), edges, np.ones(DEGREE)])


def _fit(task: _Task) -> Spline | None:
    """Return the penalised least-squares spline, its parameters corrected twice to the feet."""
    from scipy import interpolate, sparse

    knots, parameter = _knots(task), task.parameter
    count = len(knots) - DEGREE - 1
    fair = _third_derivative(knots, count)
    freedom = _freedom(task, count)
    control: FloatArray | None = None
    for _ in range(3):
        inside = np.mod(parameter, 1.0) if task.closed else parameter
        basis = interpolate.BSpline.design_matrix(inside, knots, DEGREE)
        square = sparse.csr_matrix(basis.T @ basis + PENALTY * (fair.T @ fair))
        control = _solve(task, square, basis.T @ task.points, freedom)
        if control is None:
            return None
        parameter = _feet(knots, control, task.points, parameter, task.closed)
    assert control is not None
    curve = _as_curve(knots, control, task.closed)
    inside = np.mod(parameter, 1.0) if task.closed else parameter
    deviation = np.hypot(*(curve.point(inside) - task.points).T)
    return Spline(curve, np.clip(parameter, 0.0, 1.0), deviation)


def _as_curve(knots: FloatArray, control: FloatArray, closed: bool) -> BSpline:
    curve = BSpline(DEGREE, knots, control)
    if not closed:
        return curve
    curve = curve.clamped()
    points = curve.control_points.copy()
    points[-1] = points[0]
    return BSpline(DEGREE, curve.knots, points)


def _feet(
    knots: FloatArray, control: FloatArray, points: FloatArray, start: FloatArray, closed: bool
) -> FloatArray:
    """Return the parameters (m,) of the points' feet next to `start`; ends stay."""
    from scipy import interpolate

    curve = interpolate.BSpline(knots, control, DEGREE)
    first, second = curve.derivative(1), curve.derivative(2)
    parameter = start.copy()
    gap = np.diff(start)
    reach = 2.0 * np.maximum(np.append(gap, gap[-1]), np.append(gap[0], gap))
    reach = np.maximum(reach, 4.0 / len(points))
    for _ in range(3):
        inside = np.mod(parameter, 1.0) if closed else parameter
        off, along = curve(inside) - points, first(inside)
        slope = dot(along, along) + dot(off, second(inside))
        slope = np.maximum(slope, 0.3 * dot(along, along) + 1e-300)
        parameter = parameter - np.clip(dot(off, along) / slope, -reach, reach)
        if not closed:
            parameter = np.clip(parameter, 0.0, 1.0)
            parameter[[0, -1]] = 0.0, 1.0
    return parameter


def _third_derivative(knots: FloatArray, count: int) -> sparse.csr_matrix:
    """Return the map from control points to third derivatives, weighted by span^3, per span."""
    from scipy import sparse

    operator = sparse.eye(count, format="csr")
    for level in range(DEGREE):
        degree, rows = DEGREE - level, count - level - 1
        low = knots[level + 1 : level + 1 + rows]
        high = knots[level + 1 + degree : level + 1 + degree + rows]
        scale = degree / (high - low)
        change = sparse.diags([-scale, scale], [0, 1], shape=(rows, rows + 1))
        operator = change @ operator
    span = np.diff(knots[DEGREE : count + 1])
    return sparse.csr_matrix(sparse.diags(span**3) @ operator)


def _solve(
    task: _Task,
    square: sparse.csr_matrix,
    right: FloatArray,
    freedom: tuple[FloatArray, sparse.csr_matrix],
) -> FloatArray | None:
    """Return control points (k, 2), None if an end would run backwards."""
    from scipy import sparse
    from scipy.sparse.linalg import splu

    count = square.shape[0]
    fixed, free = freedom
    both = sparse.block_diag([square, square], format="csr")
    target = np.concatenate([right[:, 0], right[:, 1]]) - both @ fixed
    system = free.T @ both @ free
    try:
        if count <= DENSE:
            values = np.linalg.solve(system.toarray(), free.T @ target)
        else:
            values = splu(sparse.csc_matrix(system)).solve(free.T @ target)
    except (RuntimeError, np.linalg.LinAlgError):
        return None
    bound = sum(tangent is not None for tangent in task.tangents)
    if np.any(values[len(values) - bound :] <= 0.0):
        return None
    control = fixed + free @ values
    return np.stack([control[:count], control[count:]], axis=1)


def _freedom(task: _Task, count: int) -> tuple[FloatArray, sparse.csr_matrix]:
    """Return the fixed part (2 count,) of all coordinates and the map from the free numbers.

    The last of the free numbers are how far the second and the last but one control points lie
    along the end tangents, where there are any.
    """
    from scipy import sparse

    fixed = np.zeros((2, count))
    if task.closed:
        period = count - DEGREE
        wrap = sparse.csr_matrix(
            (np.ones(count), (np.arange(count), np.arange(count) % period)), (count, period)
        )
        return fixed.ravel(), sparse.block_diag([wrap, wrap], format="csr")
    fixed[:, 0], fixed[:, -1] = task.points[0], task.points[-1]
    first, last = task.tangents
    low, high = 1 + (first is not None), count - 1 - (last is not None)
    inner = np.arange(low, high)
    row = [inner, inner + count]
    column = [np.arange(len(inner)), np.arange(len(inner)) + len(inner)]
    entry: list[NDArray[np.float64]] = [np.ones(2 * len(inner))]
    used = 2 * len(inner)
    # Scaled by the size, so that all numbers are alike.
    size = float(np.ptp(task.points, axis=0).max())
    for tangent, place, sign in ((first, 1, 1.0), (last, count - 2, -1.0)):
        if tangent is not None:
            fixed[:, place] = task.points[0 if sign > 0.0 else -1]
            row.append(np.array([place, place + count]))
            column.append(np.full(2, used))
            entry.append(sign * size * tangent)
            used += 1
    where = (np.concatenate(row), np.concatenate(column))
    return fixed.ravel(), sparse.csr_matrix((np.concatenate(entry), where), (2 * count, used))
