"""Chebyshev nodes, stable conversion to Bezier form, adaptive quadrature and real roots.

Interpolation at the nodes of Dorado 2009, eq. (7), is well conditioned. The values become
Chebyshev coefficients first, which decay, and then Bernstein coefficients by the exact change of
basis of Rababah (2003), evaluated in integers; going through the coefficients keeps the large
entries of that matrix from meeting large numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from math import comb
from typing import TypeAlias

import numpy as np
from numpy.polynomial import chebyshev as series
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike, NDArray

from grassfire.errors import GeometryError

FloatArray: TypeAlias = NDArray[np.float64]
Function: TypeAlias = Callable[[FloatArray], FloatArray]


def nodes(degree: int, start: float = 0.0, end: float = 1.0) -> FloatArray:
    """Return the (degree + 1,) ascending Chebyshev points of [start, end], ends included.

    Dorado 2009, eq. (7); degree 0 gives the midpoint.
    """
    if degree < 0:
        raise GeometryError(f"a polynomial degree must not be negative, got {degree}")
    if degree == 0:
        return np.array([0.5 * (start + end)])
    # sin^2 instead of 1 - cos keeps full relative accuracy next to the start.
    fraction = np.sin(0.5 * np.pi * np.arange(degree + 1) / degree) ** 2
    result = start + (end - start) * fraction
    result[-1] = end
    return np.asarray(result)


@lru_cache(maxsize=256)
def _coefficient_matrix(degree: int) -> FloatArray:
    """Return the matrix from values at `nodes(degree)` to Chebyshev coefficients."""
    if degree == 0:
        return np.ones((1, 1))
    index = np.arange(degree + 1)
    # T_k at the ascending nodes: x_j = -cos(pi j / n), T_k(x_j) = (-1)^k cos(pi k j / n).
    matrix = np.cos(np.pi * np.outer(index, index) / degree) * ((-1.0) ** index)[:, None]
    matrix[:, [0, -1]] *= 0.5
    matrix *= 2.0 / degree
    matrix[[0, -1], :] *= 0.5
    matrix.setflags(write=False)
    return np.asarray(matrix)


@lru_cache(maxsize=256)
def _bernstein_matrix(degree: int) -> FloatArray:
    """Return the (n+1, n+1) matrix from Chebyshev to Bernstein coefficients, exact to rounding."""
    matrix = np.empty((degree + 1, degree + 1))
    for row in range(degree + 1):
        for column in range(degree + 1):
            total = sum(
                (-1) ** (column - inner)
                * comb(2 * column, 2 * inner)
                * comb(degree - column, row - inner)
                for inner in range(max(0, row + column - degree), min(row, column) + 1)
            )
            matrix[row, column] = float(Fraction(total, comb(degree, row)))
    matrix.setflags(write=False)
    return np.asarray(matrix)


def coefficients(values: ArrayLike) -> FloatArray:
    """Return Chebyshev coefficients (..., n+1, k) of the interpolant of values at `nodes(n)`."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim < 2:
        raise GeometryError("values must have shape (..., degree + 1, dimension)")
    return np.asarray(_coefficient_matrix(array.shape[-2] - 1) @ array)


def interpolate_to_bezier(values: ArrayLike) -> FloatArray:
    """Return Bezier coefficients of the polynomial through values at the Chebyshev nodes.

    Parameters
    ----------
    values : (..., n + 1, k) array_like
        Values at `nodes(n)`; leading axes are a batch.

    Returns
    -------
    (..., n + 1, k) array
        Bernstein coefficients; the first and last equal the first and last value.
    """
    array = np.asarray(values, dtype=np.float64)
    degree = array.shape[-2] - 1 if array.ndim >= 2 else 0
    result = np.asarray(_bernstein_matrix(degree) @ coefficients(array))
    result[..., 0, :] = array[..., 0, :]
    result[..., -1, :] = array[..., -1, :]
    return result


@lru_cache(maxsize=256)
def _binomials(degree: int) -> FloatArray:
    row = np.array([comb(degree, index) for index in range(degree + 1)], dtype=np.float64)
    row.setflags(write=False)
    return row


def bernstein(degree: int, t: ArrayLike) -> FloatArray:
    """Return the Bernstein polynomials of a degree at t, shape (..., degree + 1)."""
    return bernstein_family(degree, t, 0)[0]


def resampling(degree: int, t: ArrayLike) -> FloatArray:
    """Return what takes values at `nodes(degree)` to those of the interpolant at t.

    Shape (..., degree + 1), for t of shape (...).
    """
    return np.asarray(bernstein(degree, t) @ interpolate_to_bezier(np.eye(degree + 1)))


def bernstein_family(degree: int, t: ArrayLike, order: int) -> list[FloatArray]:
    """Return the Bernstein polynomials at t of this degree and of the `order` next lower ones.

    Parameters
    ----------
    degree : int
    t : (...) array_like
    order : int
        How many lower degrees to add, one for each derivative; degree 0 repeats.

    Returns
    -------
    list of (..., d + 1) arrays
    """
    parameter = np.asarray(t, dtype=np.float64)
    rest = 1.0 - parameter
    rising = np.empty((*parameter.shape, degree + 1))
    falling = np.empty_like(rising)
    rising[..., 0] = 1.0
    falling[..., 0] = 1.0
    for power in range(1, degree + 1):
        np.multiply(rising[..., power - 1], parameter, out=rising[..., power])
        np.multiply(falling[..., power - 1], rest, out=falling[..., power])
    result = []
    for lower in range(order + 1):
        size = max(degree - lower, 0) + 1
        product = rising[..., :size] * falling[..., size - 1 :: -1][..., :size]
        product *= _binomials(size - 1)
        result.append(product)
    return result


def bernstein_among(degree: int, t: FloatArray, order: int, among: FloatArray) -> list[FloatArray]:
    """As `bernstein_family` at places (n,) that are all `among` few, given in order."""
    which = np.searchsorted(among, t)
    return [basis.take(which, axis=0) for basis in bernstein_family(degree, among, order)]


def evaluate_bezier(coefficients: ArrayLike, t: ArrayLike) -> FloatArray:
    """Return values (..., m, k) of polynomials (..., n+1, k) in Bezier form at t of shape (m,).

    A scalar t drops the m axis.
    """
    control = np.asarray(coefficients, dtype=np.float64)
    weights = bernstein(control.shape[-2] - 1, t)
    return np.asarray(weights @ control)


def differentiate_bezier(coefficients: ArrayLike, order: int = 1) -> FloatArray:
    """Return the Bezier coefficients (..., n + 1 - order, k) of a derivative in t.

    A derivative beyond the degree is the zero polynomial, of degree 0.
    """
    control = np.asarray(coefficients, dtype=np.float64)
    for _ in range(order):
        degree = control.shape[-2] - 1
        if degree == 0:
            return np.zeros_like(control)
        control = degree * np.diff(control, axis=-2)
    return np.asarray(control)


@lru_cache(maxsize=64)
def _differentiation_matrix(degree: int) -> FloatArray:
    """Return the spectral differentiation matrix on [0, 1] (Trefethen 2000, ch. 6)."""
    if degree == 0:
        return np.zeros((1, 1))
    weight = np.ones(degree + 1)
    weight[[0, -1]] = 2.0
    weight *= (-1.0) ** np.arange(degree + 1)
    # Differences of sin^2 by the product formula avoid cancellation between close nodes.
    angle = 0.5 * np.pi * np.arange(degree + 1) / degree
    difference = np.sin(angle[:, None] + angle) * np.sin(angle[:, None] - angle)
    np.fill_diagonal(difference, 1.0)
    matrix = np.outer(weight, 1.0 / weight) / difference
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return np.asarray(matrix)


def differentiate_values(values: ArrayLike, start: float = 0.0, end: float = 1.0) -> FloatArray:
    """Return the derivative, at the nodes of [start, end], of the interpolant of (..., n+1, k)."""
    array = np.asarray(values, dtype=np.float64)
    return np.asarray(_differentiation_matrix(array.shape[-2] - 1) @ array / (end - start))


def fit_piecewise(
    function: Function,
    breaks: ArrayLike,
    tolerance: float,
    degree: int = 12,
) -> tuple[FloatArray, FloatArray]:
    """Approximate a vector function by polynomials in Bezier form on adaptively halved pieces.

    Parameters
    ----------
    function : callable
        Maps parameters (...) to values (..., k).
    breaks : (b,) array_like
        Ascending parameters between which the function is analytic.
    tolerance : float
        Largest error of a component, in the unit of the values; estimated from the last three
        Chebyshev coefficients and from eq. (8)-like checks between the nodes.
    degree : int
        Degree of each piece.

    Returns
    -------
    intervals : (m, 2) array
    control : (m, degree + 1, k) array
        Bezier coefficients of each piece over its interval, in ascending order.
    """
    edges = np.asarray(breaks, dtype=np.float64)
    pending = np.stack([edges[:-1], edges[1:]], axis=-1)
    unit, between = nodes(degree), 0.5 * (nodes(degree)[1:] + nodes(degree)[:-1])
    done_intervals: list[FloatArray] = []
    done_control: list[FloatArray] = []
    for level in range(48):
        width = pending[:, 1:] - pending[:, :1]
        values = function(_spread(pending, unit))
        control = interpolate_to_bezier(values)
        tail = np.abs(coefficients(values)[:, -3:]).sum(axis=1).max(axis=-1)
        check = function(pending[:, :1] + width * between)
        error = np.abs(evaluate_bezier(control, between) - check).max(axis=(1, 2))
        good = np.maximum(tail, error) <= tolerance
        if level == 47:
            good[:] = True
        done_intervals.append(pending[good])
        done_control.append(control[good])
        pending = _halves(pending[~good])
        if not len(pending):
            break
    intervals = np.concatenate(done_intervals)
    order = np.argsort(intervals[:, 0], kind="stable")
    return intervals[order], np.concatenate(done_control)[order]


def _halves(intervals: FloatArray) -> FloatArray:
    middle = intervals.mean(axis=1)
    return np.concatenate(
        [np.stack([intervals[:, 0], middle], axis=-1), np.stack([middle, intervals[:, 1]], axis=-1)]
    )


def _spread(intervals: FloatArray, unit: FloatArray) -> FloatArray:
    """Return nodes (m, n + 1) in intervals (m, 2), the last ones a last bit inside.

    At a break a function may jump to the value of the next piece.
    """
    points = intervals[:, :1] + (intervals[:, 1:] - intervals[:, :1]) * unit
    points[:, -1] = np.nextafter(intervals[:, 1], intervals[:, 0])
    return np.asarray(points)


@lru_cache(maxsize=64)
def gauss_rule(count: int) -> tuple[FloatArray, FloatArray]:
    """Return the nodes and weights (count,) of Gauss-Legendre quadrature on [-1, 1]."""
    points, weights = leggauss(count)
    points.setflags(write=False)
    weights.setflags(write=False)
    return points, weights


def integrate(function: Function, breaks: ArrayLike, accuracy: float) -> float:
    """Return the integral over [breaks[0], breaks[-1]] to an absolute accuracy.

    Gauss-Legendre with 12 points on each piece against its two halves; pieces that differ are
    halved, all of a level at once. Stops at rounding level when `accuracy` is below it.
    """
    rule_nodes, rule_weights = gauss_rule(12)

    def panels(intervals: FloatArray) -> FloatArray:
        half = 0.5 * (intervals[:, 1] - intervals[:, 0])
        points = intervals.mean(axis=1)[:, None] + half[:, None] * rule_nodes
        return np.asarray((function(points) * rule_weights).sum(axis=1) * half)

    edges = np.asarray(breaks, dtype=np.float64)
    pending = np.stack([edges[:-1], edges[1:]], axis=-1)
    coarse = panels(pending)
    scale = float(np.abs(coarse).sum())
    total = 0.0
    for _ in range(48):
        halves = _halves(pending)
        fine = panels(halves)
        count = len(pending)
        summed = fine[:count] + fine[count:]
        # The error shrinks with the width where the integrand has a kink, so a fixed share of
        # the accuracy per piece is enough; 4e-16 of the whole is rounding.
        limit = max(0.05 * accuracy, 4e-16 * scale)
        good = np.abs(summed - coarse) <= limit
        total += float(summed[good].sum())
        keep = np.concatenate([~good, ~good])
        pending, coarse = halves[keep], fine[keep]
        if not len(pending):
            return total
    return total + float(coarse.sum())


def real_roots(
    function: Function, breaks: ArrayLike, floor: float = 0.0, degree: int = 16
) -> FloatArray:
    """Return the ascending real roots of an analytic function inside its range.

    Parameters
    ----------
    function : callable
        Vectorised scalar function of the parameter.
    breaks : (b,) array_like
        Ascending parameters between which the function is analytic; breaks at which the sign
        changes by a jump are roots too.
    floor : float
        Magnitude below which values are noise; a piece that never exceeds it has no roots.
    degree : int
        Degree of the Chebyshev proxies (roots by the colleague matrix, Good 1961, Boyd 2002).

    Returns
    -------
    (n,) array
        Roots of odd order and most of even order, about 1e-13 of the range wide.
    """
    edges = np.asarray(breaks, dtype=np.float64)
    pending = np.stack([edges[:-1], edges[1:]], axis=-1)
    span, unit = float(edges[-1] - edges[0]), nodes(degree)
    found: list[FloatArray] = [_jumps(function, edges, floor)] if len(edges) > 2 else []
    scale = floor
    for level in range(40):
        values = function(_spread(pending, unit))
        table = coefficients(values[..., None])[..., 0]
        size = np.abs(table).sum(axis=1)
        if level == 0:
            scale = max(floor, 1e-15 * float(size.max()))
        tail, lead = np.abs(table[:, -3:]).sum(axis=1), np.abs(table[:, 0])
        # A piece is settled without roots only where its proxy resembles the function.
        away = (2.0 * lead > size * (1.0 + 1e-9)) & (tail < 1e-3 * lead)
        possible = ~away & (size > scale)
        pending, table, size, tail = (each[possible] for each in (pending, table, size, tail))
        narrow = pending[:, 1] - pending[:, 0] < 1e-7 * span
        smooth = tail <= np.maximum(1e-13 * size, scale)
        ready = smooth | narrow
        for interval, row in zip(pending[ready], table[ready], strict=True):
            local = _series_roots(row, max(scale, 1e-15 * float(np.abs(row).sum())))
            found.append(interval[0] + 0.5 * (local + 1.0) * (interval[1] - interval[0]))
        pending = _halves(pending[~ready])
        if not len(pending):
            break
    roots = np.sort(np.concatenate([*found, np.empty(0)]))
    distinct = np.diff(roots, prepend=-np.inf) > 1e-11 * span
    return np.asarray(roots[distinct])


def _jumps(function: Function, edges: FloatArray, floor: float) -> FloatArray:
    """Return inner breaks across which the sign changes."""
    step = 1e-9 * np.minimum(np.diff(edges)[:-1], np.diff(edges)[1:])
    before, after = function(edges[1:-1] - step), function(edges[1:-1] + step)
    change = (before * after < 0.0) & (np.minimum(np.abs(before), np.abs(after)) > floor)
    return edges[1:-1][change]


def _series_roots(row: FloatArray, negligible: float) -> FloatArray:
    """Return the real roots in [-1, 1] of one Chebyshev series, polished by Newton."""
    large = np.flatnonzero(np.abs(row) > negligible)
    if not len(large) or large[-1] == 0:
        return np.empty(0)
    trimmed = row[: large[-1] + 1]
    candidates = np.asarray(series.chebroots(trimmed))
    real = candidates.real[np.abs(candidates.imag) < 1e-7]
    roots = real[np.abs(real) <= 1.0 + 1e-9]
    slope = series.chebder(trimmed)
    for _ in range(2):
        rate = series.chebval(roots, slope)
        safe = np.abs(rate) > 1e-6 * np.abs(trimmed).sum()
        step = series.chebval(roots, trimmed) / np.where(safe, rate, 1.0)
        roots = roots - np.where(safe, np.clip(step, -1e-6, 1e-6), 0.0)
    return np.clip(roots, -1.0, 1.0)
