"""Rational curves cut into spirals: pieces of monotone curvature, all curves at once."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from math import comb

import numpy as np

from grassfire.geometry.chebyshev import interpolate_to_bezier, nodes
from grassfire.geometry.curve import cross, dot, left_normal
from grassfire.medial.sites import BoolArray, FloatArray, IntArray

SLIVER = 1e-6
"""Length of a piece that is not worth a cut, relative to the size of the region."""
SLIVER_TURN = 1e-4
"""Largest turn of such a piece, radians."""
LARGEST_TURN = 0.5 * np.pi
STOPPED = 1e-9
"""Speed, relative to the curve's largest, below which the derivative has no direction."""
CUSP = 1e-7
"""Least speed, relative to the curve's largest, of a place that is taken for a cusp: the bend
there is as small as the square of that."""
_DEEPEST = 16
_HIGHEST_DEGREE = 13
_NOISE = 1e-12
_HALF = np.linspace(0.0, 1.0, 9)

Function = Callable[[IntArray, FloatArray], FloatArray]
Places = tuple[IntArray, FloatArray]


@lru_cache(maxsize=64)
def _power_matrix(degree: int) -> FloatArray:
    """(degree + 1, degree + 1) matrix from control points to powers of t - 1/2, exact."""
    values = np.eye(degree + 1)
    matrix = np.zeros((degree + 1, degree + 1))
    for power in range(degree + 1):
        level = values
        while len(level) > 1:
            level = 0.5 * (level[:-1] + level[1:])
        matrix[power] = comb(degree, power) * level[0]
        values = np.diff(values, axis=0)
    matrix.setflags(write=False)
    return matrix


def power_coefficients(control: FloatArray) -> FloatArray:
    """(n, degree + 1, 3) coefficients in powers of t - 1/2 from homogeneous control points."""
    # The first point is taken off before the differences: coordinates may be far from zero.
    weight = control[:, :1, 2:]
    anchor = control[:, :1, :2] / weight
    local = control.copy()
    local[..., :2] -= anchor * control[..., 2:]
    result = np.asarray(_power_matrix(control.shape[1] - 1) @ local)
    result[..., :2] += anchor * result[..., 2:]
    return result


class _Curves:
    """Rational curves with tables of their derivatives, for evaluation of many at once."""

    def __init__(self, table: FloatArray) -> None:
        self.rational = bool(np.any(table[:, 1:, 2] != 0.0) or np.any(table[:, 0, 2] != 1.0))
        level = table if self.rational else table[..., :2]
        self._tables = [np.ascontiguousarray(level)]
        for _ in range(3):
            power = np.arange(1.0, level.shape[1])
            level = power[:, None] * level[:, 1:] if len(power) else np.zeros_like(level)
            self._tables.append(level)

    def __len__(self) -> int:
        return len(self._tables[0])

    def evaluate(self, row: IntArray, parameter: FloatArray, order: int) -> list[FloatArray]:
        """Point and derivatives up to `order` <= 3 of curves row (n,), each (n, k, 2).

        `parameter` is (n, k).
        """
        power = _powers(parameter, self._tables[0].shape[1])
        values = []
        for table in self._tables[: order + 1]:
            part, chosen = power[..., : table.shape[1]], table[row]
            if parameter.shape[1] == 1:
                values.append(np.einsum("nkp,npc->nkc", part, chosen))
            else:
                values.append(np.matmul(part, chosen))
        return _projected(values) if self.rational else values

    def on_grid(self, parameter: FloatArray) -> list[FloatArray]:
        """Point and three derivatives of all curves at k parameters, each (n, k, 2)."""
        power = _powers(parameter, self._tables[0].shape[1])
        values = [np.matmul(power[:, : table.shape[1]], table) for table in self._tables]
        return _projected(values) if self.rational else values

    def slope(self, row: IntArray, parameter: FloatArray) -> FloatArray:
        """Slope of the curvature of curves row (n,) at (n, k), times a positive polynomial."""
        return self._times_weight(_slope(*self.evaluate(row, parameter, 3)[1:]), row, parameter)

    def _times_weight(self, slope: FloatArray, row: IntArray, parameter: FloatArray) -> FloatArray:
        """Make the slope of rational curves a polynomial: w^8 is its denominator."""
        if not self.rational:
            return slope
        power = _powers(parameter, self._tables[0].shape[1])
        return np.asarray(slope * np.matmul(power, self._tables[0][row][..., 2:])[..., 0] ** 8)

    @property
    def slope_degree(self) -> int:
        """Degree of what `slope` returns."""
        degree = self._tables[0].shape[1] - 1
        return int(max(1, 8 * degree - 11 if self.rational else 4 * degree - 7))


def _powers(parameter: FloatArray, count: int) -> FloatArray:
    """Powers 0 to count - 1 of t - 1/2, shape (..., count)."""
    local = parameter - 0.5
    result = np.ones((*parameter.shape, count))
    for power in range(1, count):
        np.multiply(result[..., power - 1], local, out=result[..., power])
    return result


def _projected(values: list[FloatArray]) -> list[FloatArray]:
    """Plane derivatives from homogeneous ones, by the quotient rule.

    w c^(k) = N^(k) - sum C(k, i) w^(i) c^(k - i).
    """
    result: list[FloatArray] = []
    for order, value in enumerate(values):
        numerator = value[..., :2]
        for inner in range(1, order + 1):
            factor = comb(order, inner) * values[inner][..., 2:]
            numerator = numerator - factor * result[order - inner]
        result.append(np.asarray(numerator / values[0][..., 2:]))
    return result


def spirals(table: FloatArray, size: float) -> tuple[IntArray, FloatArray, FloatArray]:
    """Cut rational curves into pieces of monotone curvature that turn by a quarter at most.

    Parameters
    ----------
    table : (n, degree + 1, 3) float array
        Homogeneous coefficients in powers of t - 1/2.
    size : float
        Diagonal of the region, mm.

    Returns
    -------
    curve, low, high : (m,) arrays
        Rows of `table` and parameter ranges, in order along each curve.

    Notes
    -----
    The slope of the curvature is k' ~ N' S - 3/2 N S' with N = c' x c'', S = |c'|^2, a polynomial
    of degree 4 n - 7 (8 n - 11 for rational curves): where its Bernstein coefficients change sign
    more than once the interval is cut into four (Descartes' rule), so that no root is passed over.
    Above degree 13 they are those of an interpolant on an interval of a sixteenth or less.

    An extremum nearer than a millionth of `size` to an end of its curve makes no cut, and two as
    near to each other cancel: but for that sliver the curvature is monotone. A sliver turns by
    1e-4 at most (else it is a feature), so that the radius of curvature in it, stationary at the
    extremum, is off by half the square of that at most, and for most by 1e-12 of the size; the
    same disk is found next to it. Where the sliver is all there is of a rise before (or fall
    after) a junction the junction itself becomes the extremum, and where it holds both a minimum
    at the junction and a maximum there is none in truth either.
    """
    if not len(table):
        return np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0)
    curves = _Curves(table)
    extrema, cusps, wide = _extrema(curves)
    curve, root = _bounds(curves, extrema, cusps, SLIVER * size)
    count = np.bincount(curve, minlength=len(table)) + 1
    row = np.repeat(np.arange(len(table)), count)
    inner = np.ones(len(row), dtype=bool)
    inner[np.cumsum(count) - count] = False
    low, high = np.zeros(len(row)), np.ones(len(row))
    low[inner] = root
    high[np.flatnonzero(inner) - 1] = root
    return _limit_turn(curves, row, low, high, np.flatnonzero(wide[row]))


def _unit(first: FloatArray) -> FloatArray:
    """Directions (n, k, 2); zero where the curve stops, which has none."""
    speed = np.hypot(first[..., 0], first[..., 1])
    stops = speed <= STOPPED * speed.max(axis=1, keepdims=True)
    return np.asarray(np.where(stops, 0.0, 1.0 / np.where(stops, 1.0, speed))[..., None] * first)


def _steps(tangent: FloatArray) -> FloatArray:
    """Signed turns (n, k - 1) between directions (n, k, 2), radians."""
    before, after = tangent[:, :-1], tangent[:, 1:]
    return np.asarray(np.arctan2(cross(before, after), dot(before, after)))


def _slope(first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
    """Slope of the curvature times |c'|^5, from derivatives (..., 2)."""
    return np.asarray(
        cross(first, third) * dot(first, first) - 3.0 * cross(first, second) * dot(first, second)
    )


def _extrema(curves: _Curves) -> tuple[Places, Places, BoolArray]:
    """Extrema of curvature, cusps, and which curves (n,) may turn by more than a quarter turn."""
    degree = min(curves.slope_degree, _HIGHEST_DEGREE)
    unit = nodes(degree)
    count = 16 if curves.slope_degree > degree else max(4, 40 // degree)
    edges = np.linspace(0.0, 1.0, count + 1)
    grid = np.append((edges[:-1, None] + unit[:-1] / count).ravel(), 1.0)
    _, first, second, third = curves.on_grid(grid)
    every = np.arange(len(curves))
    value = curves._times_weight(
        _slope(first, second, third), every, np.broadcast_to(grid, first.shape[:2])
    )
    samples = [(np.repeat(every, len(grid)), np.tile(grid, len(every)), value.ravel())]
    cells = value[:, np.arange(count)[:, None] * degree + np.arange(degree + 1)]
    owner, cell = np.nonzero(_variations(cells) > 1)
    low, width = edges[cell], 1.0 / count
    for _ in range(_DEEPEST):
        if not len(owner):
            break
        width /= 4.0
        owner = np.repeat(owner, 4)
        low = (low[:, None] + width * np.arange(4)).ravel()
        at = low[:, None] + width * unit
        value = curves.slope(owner, at)
        samples.append((np.repeat(owner, degree + 1), at.ravel(), value.ravel()))
        open_ = _variations(value) > 1
        owner, low = owner[open_], low[open_]
    speed = np.hypot(first[..., 0], first[..., 1])
    slow = speed.min(axis=1) < 0.1 * speed.max(axis=1)
    wide = slow | (np.abs(_steps(_unit(first))).sum(axis=1) > 0.9 * LARGEST_TURN)
    extrema = _sign_changes(curves, *(np.concatenate(part) for part in zip(*samples, strict=True)))
    return extrema, _cusps(curves, grid, first, second, speed), wide


def _cusps(
    curves: _Curves, grid: FloatArray, first: FloatArray, second: FloatArray, speed: FloatArray
) -> Places:
    """Places inside the curves where they stop, from derivatives on the grid (n, k, 2)."""

    def slowing(row: IntArray, parameter: FloatArray) -> FloatArray:
        _, first, second = curves.evaluate(row, parameter, 2)
        return dot(first, second)

    change = dot(first, second)
    # Next to a cusp the first derivative lies along the second.
    along = np.abs(cross(first, second)) <= 0.5 * np.abs(change)
    near = along[:, 1:] & along[:, :-1] & (change[:, :-1] < 0.0) & (change[:, 1:] >= 0.0)
    row, cell = np.nonzero(near)
    if not len(row):
        return row, np.zeros(0)
    slowest = bracketed_roots(
        lambda index, t: slowing(row[index], t[:, None])[:, 0],
        grid[cell], grid[cell + 1], change[row, cell], change[row, cell + 1],
    )  # fmt: skip
    velocity = curves.evaluate(row, slowest[:, None], 1)[1][:, 0]
    stops = np.hypot(velocity[:, 0], velocity[:, 1]) <= CUSP * speed[row].max(axis=1)
    stops &= (slowest > CUSP) & (slowest < 1.0 - CUSP)
    return row[stops], slowest[stops]


@lru_cache(maxsize=64)
def _bernstein_matrix(degree: int) -> FloatArray:
    """Matrix from values at `nodes(degree)` to Bernstein coefficients, transposed."""
    matrix = np.ascontiguousarray(interpolate_to_bezier(np.eye(degree + 1)).T)
    matrix.setflags(write=False)
    return matrix


def _variations(value: FloatArray) -> IntArray:
    """Sign changes (...) of Bernstein coefficients, from values (..., q + 1) at the nodes.

    Coefficients of the size of rounding have no sign; at an end they are roots, and count.
    """
    coefficient = value @ _bernstein_matrix(value.shape[-1] - 1)
    size = np.abs(coefficient)
    coefficient[size <= _NOISE * size.max(axis=-1, keepdims=True)] = 0.0
    index = np.arange(coefficient.shape[-1])
    known = np.maximum.accumulate(np.where(coefficient != 0.0, index, 0), axis=-1)
    sign = np.sign(np.take_along_axis(coefficient, known, axis=-1))
    changes = (sign[..., 1:] * sign[..., :-1] < 0).sum(axis=-1)
    return np.asarray(changes + (coefficient[..., 0] == 0.0) + (coefficient[..., -1] == 0.0))


def _sign_changes(
    curves: _Curves, owner: IntArray, parameter: FloatArray, value: FloatArray
) -> Places:
    """Curve and parameter of the roots of the slope between samples (n,), in order."""
    # Exact zeros take no side: a root there lies between their neighbours.
    known = np.flatnonzero(value)
    order = known[np.lexsort((parameter[known], owner[known]))]
    owner, parameter, value = owner[order], parameter[order], value[order]
    place = np.flatnonzero((owner[1:] == owner[:-1]) & (value[1:] * value[:-1] < 0.0))
    curve = owner[place]
    root = bracketed_roots(
        lambda row, t: curves.slope(curve[row], t[:, None])[:, 0],
        parameter[place], parameter[place + 1], value[place], value[place + 1],
    )  # fmt: skip
    return curve, root


def bracketed_roots(
    function: Function,
    low: FloatArray,
    high: FloatArray,
    at_low: FloatArray,
    at_high: FloatArray,
    accuracy: float = 1e-12,
) -> FloatArray:
    """Roots (n,) of function(row, t) between `low` and `high`, where its signs differ.

    To `accuracy` in t: inverse quadratic steps where they are safe, halving elsewhere (Chandrupatla
    1997).
    """
    a, b, c = high, low, high
    fa, fb, fc = at_high, at_low, at_high
    index = np.arange(len(low))
    share = np.full(len(low), 0.5)
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(100):
            if not np.any(np.abs(b - a) > accuracy):
                break
            x = a + share * (b - a)
            fx = function(index, x)
            same = np.sign(fx) == np.sign(fa)
            c, fc = np.where(same, a, b), np.where(same, fa, fb)
            b, fb = np.where(same, b, a), np.where(same, fb, fa)
            a, fa = x, fx
            b = np.where(fa == 0.0, a, b)
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            inverse = fa / (fb - fa) * fc / (fb - fc)
            inverse = inverse + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
            # Comparisons with NaN, of roots that are found, are false.
            safe = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
            least = np.minimum(0.5, 0.5 * accuracy / np.abs(b - a))
            share = np.where(safe, np.minimum(np.maximum(inverse, least), 1.0 - least), 0.5)
    return np.asarray(np.where(np.abs(fa) < np.abs(fb), a, b))


def _bounds(curves: _Curves, extrema: Places, cusps: Places, sliver: float) -> Places:
    """Cusps, and the extrema that are worth a cut, in order along each curve.

    Of those in slivers at a cusp or an end none is, of a cluster one at most.
    """
    if not len(extrema[0]) and not len(cusps[0]):
        return extrema
    every = np.unique(np.concatenate([extrema[0], cusps[0]]))
    ends = np.zeros(len(every)), np.ones(len(every))
    owner = np.concatenate([every, cusps[0], extrema[0], every])
    bound = np.concatenate([ends[0], cusps[1], extrema[1], ends[1]])
    counts = [len(every), len(cusps[0]), len(extrema[0]), len(every)]
    order = np.lexsort((bound, owner))
    owner, bound = owner[order], bound[order]
    fixed = np.repeat([True, True, False, True], counts)[order]
    inner = np.repeat([False, True, True, False], counts)[order]
    stops = np.repeat([False, True, False, False], counts)[order]
    short = np.concatenate([[False], _short(curves, owner, bound, stops, sliver)])
    cluster = np.cumsum(~short) - 1
    size = np.bincount(cluster)
    rank = np.arange(len(bound)) - (np.cumsum(size) - size)[cluster]
    # Of an odd number of extrema one remains, of an even number none.
    middle = (size[cluster] % 2 == 1) & (rank == size[cluster] // 2)
    held = np.bincount(cluster, weights=fixed)[cluster] > 0
    kept = inner & np.where(held, stops, middle)
    return owner[kept], bound[kept]


def _short(
    curves: _Curves, owner: IntArray, bound: FloatArray, stops: BoolArray, sliver: float
) -> BoolArray:
    """(n - 1,) whether the piece from each bound to the next of the same curve is a sliver."""
    same = owner[1:] == owner[:-1]
    point, first, second = (value[:, 0] for value in curves.evaluate(owner, bound[:, None], 2))
    width = np.where(same, bound[1:] - bound[:-1], np.inf)
    chord = np.hypot(*(point[1:] - point[:-1]).T)
    close = np.flatnonzero(same & (chord <= sliver))
    short = np.asarray(same & (width <= 1e-14))
    if not len(close):
        return short
    speed = np.hypot(first[:, 0], first[:, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.nan_to_num(speed**3 / np.abs(cross(first, second)), nan=np.inf)
    # A cusp has no radius; the curve leaves it straight.
    radius[stops] = np.inf
    limit = np.minimum(sliver, SLIVER_TURN * np.minimum(radius[1:], radius[:-1])[close])
    # A few chords measure a short piece well, and never make a long one short.
    at = bound[close, None] + width[close, None] * _HALF
    step = np.diff(curves.evaluate(owner[close], at, 0)[0], axis=1)
    short[close] |= np.hypot(step[..., 0], step[..., 1]).sum(axis=1) <= limit
    return short


def _limit_turn(
    curves: _Curves, row: IntArray, low: FloatArray, high: FloatArray, wide: IntArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Cut those of the pieces `wide` that turn by more than a quarter turn into equal turns."""
    middle = _inflections(curves, row[wide], low[wide], high[wide])[:, None]
    first_half = low[wide, None] + (middle - low[wide, None]) * _HALF
    at = np.concatenate([first_half, middle + (high[wide, None] - middle) * _HALF[1:]], axis=1)
    tangent = _unit(curves.evaluate(row[wide], at, 1)[1])
    step = _steps(tangent)
    total = np.concatenate([np.zeros((len(wide), 1)), np.cumsum(np.abs(step), axis=1)], axis=1)
    extra = np.maximum(0, np.ceil(total[:, -1] / LARGEST_TURN - 1e-9) - 1).astype(np.int64)
    which = np.repeat(np.arange(len(wide)), extra)
    if not len(which):
        return row, low, high
    number = np.arange(len(which)) - np.repeat(np.cumsum(extra) - extra, extra) + 1
    target = total[which, -1] * number / (extra[which] + 1)
    cell = np.minimum((total[which, 1:] < target[:, None]).sum(axis=1), step.shape[1] - 1)
    angle = (target - total[which, cell]) * np.sign(step[which, cell])
    along, aside = np.cos(angle)[:, None], np.sin(angle)[:, None]
    wanted = along * tangent[which, cell] + aside * left_normal(tangent[which, cell])
    curve = row[wide[which]]

    def off(index: IntArray, parameter: FloatArray) -> FloatArray:
        first = curves.evaluate(curve[index], parameter[:, None], 1)[1][:, 0]
        return cross(wanted[index], first)

    every = np.arange(len(which))
    from_, to = at[which, cell], at[which, cell + 1]
    cut = bracketed_roots(off, from_, to, off(every, from_), off(every, to), 1e-8)
    rows, lows = np.concatenate([row, curve]), np.concatenate([low, cut])
    order = np.lexsort((lows, rows))
    rows, lows = rows[order], lows[order]
    highs = np.ones(len(rows))
    inner = np.flatnonzero(rows[1:] == rows[:-1])
    highs[inner] = lows[inner + 1]
    return rows, lows, highs


def _inflections(curves: _Curves, row: IntArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Inflection (n,) in each piece of monotone curvature, the middle where it has none."""

    def bend(row: IntArray, parameter: FloatArray) -> FloatArray:
        _, first, second = curves.evaluate(row, parameter, 2)
        return cross(first, second)

    ends = bend(row, np.stack([low, high], axis=1))
    result = 0.5 * (low + high)
    found = np.flatnonzero(ends[:, 0] * ends[:, 1] < 0.0)
    result[found] = bracketed_roots(
        lambda index, t: bend(row[found[index]], t[:, None])[:, 0],
        low[found], high[found], ends[found, 0], ends[found, 1], 1e-3,
    )  # fmt: skip
    return result
