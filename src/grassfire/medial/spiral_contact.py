"""Contacts with spirals: (A) minimised by Newton's method, in the frame of the tangent.

In that frame a point q of the target has the coordinates x along the boundary and h along the
normal, relative to p, and (A) is r = (x^2 + h^2) / (2 h). With g = x x' + h h' - r h' its
derivative is r' = g / h, and

    h r'' = x'^2 + h'^2 + x x'' + (h - r) h'' - 2 r' h'.

Where p and q run together, h is of second order and g has a double root there, but r' has none:
so the steps are those for r' = 0. Next to such ends x and h come from divided differences of the
curve, which do not cancel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self

import numpy as np

from grassfire.medial.columns import Columns
from grassfire.medial.sites import (
    BoolArray,
    FloatArray,
    IntArray,
    Sites,
    evaluate_rational,
)

# At flat corners only a sliver next to the end can be touched: the grid crowds towards both ends.
_CROWD = 10.0 ** np.arange(-8, -1)
_GRID = np.concatenate([[0.0], _CROWD, np.linspace(0.0, 1.0, 15)[1:-1], 1 - _CROWD[::-1], [1.0]])

_STEPS = 10
"""Steps of Newton's method after which the contact is bracketed."""


@dataclass(frozen=True)
class Approach(Columns):
    """Tangents against spirals, one row each, and how their chords are formed.

    Attributes
    ----------
    position, normal : (n, 2) float arrays
        The boundary points p.
    own : (n,) float array
        Their parameters.
    target : (n,) int array
        Sites.
    same, adjacent : (n,) bool arrays
        Whether both are on one Bezier curve; whether the sites meet in j, at `end` of the target.
    end : (n,) float array
    relative : (n, 2) float array
        p - j without cancellation.
    rise : (n,) float array
        n.(j - p) without cancellation.
    sine : (n,) float array
        n.t for the direction t of the boundary in j, NaN where that is not the same on both sides.
    """

    position: FloatArray
    normal: FloatArray
    own: FloatArray
    target: IntArray
    same: BoolArray
    adjacent: BoolArray
    end: FloatArray
    relative: FloatArray
    rise: FloatArray
    sine: FloatArray


class _Jet(NamedTuple):
    """x and h at parameters of the targets, and two derivatives of both, each (n,)."""

    x: FloatArray
    h: FloatArray
    first_x: FloatArray
    first_h: FloatArray
    second_x: FloatArray
    second_h: FloatArray


class _Chords(Protocol):
    """Chords from points to targets, in the frames of the points."""

    def take(self, rows: IntArray) -> Self:
        """Rows."""

    def at(self, parameter: FloatArray) -> tuple[FloatArray, FloatArray]:
        """x and h, each (n,)."""

    def jet(self, parameter: FloatArray) -> _Jet:
        """The same with derivatives."""


def spiral_contact(
    sites: Sites, approach: Approach, hint: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Parameters and radii (n,) of the smallest disks that reach spirals; see `contact`."""
    rational = sites.rational[sites.bezier[approach.target]]
    if not rational.any():
        return _solve(sites, approach, hint, _PolynomialChords.of(sites, approach))
    if rational.all():
        return _solve(sites, approach, hint, _RationalChords.of(sites, approach))
    parameter, radius = np.empty(len(hint)), np.empty(len(hint))
    for kind in (rational, ~rational):
        rows = kind.nonzero()[0]
        parameter[rows], radius[rows] = spiral_contact(sites, approach.take(rows), hint[rows])
    return parameter, radius


def _solve(
    sites: Sites, approach: Approach, hint: FloatArray, chords: _Chords
) -> tuple[FloatArray, FloatArray]:
    low, high = sites.low[approach.target], sites.high[approach.target]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        parameter, radius, good = _newton(chords, low, high, hint)
        rows = (~good).nonzero()[0]
        if len(rows):
            parameter[rows], radius[rows] = _bracketed(chords.take(rows), low[rows], high[rows])
    return parameter, radius


# -- chords ---------------------------------------------------------------------------------------


@dataclass
class _Close:
    """Rows of which the chords come from divided differences: their numbers and polynomials.

    With s = t - `start`, x = `x0` + s X(t) and h = `h0` + s H(t), or `h0` + s (`h1` + s H(t))
    where `twice`.
    """

    row: IntArray
    start: FloatArray
    x0: FloatArray
    h0: FloatArray
    h1: FloatArray
    twice: BoolArray
    x: FloatArray
    h: FloatArray

    def take(self, rows: IntArray, count: int) -> _Close:
        place = np.full(count, -1)
        place[self.row] = np.arange(len(self.row))
        place = place[rows]
        kept = (place >= 0).nonzero()[0]
        place = place[kept]
        return _Close(
            kept, self.start[place], self.x0[place], self.h0[place], self.h1[place],
            self.twice[place],
            self.x.take(place, axis=1), self.h.take(place, axis=1),
        )  # fmt: skip

    def put(self, parameter: FloatArray, x: FloatArray, h: FloatArray) -> None:
        """Overwrite x and h of these rows."""
        local = parameter[self.row]
        step = local - self.start
        local = local - 0.5
        along, across = self.x[-1], self.h[-1]
        for power in range(len(self.x) - 2, -1, -1):
            along = along * local + self.x[power]
            across = across * local + self.h[power]
        x[self.row] = self.x0 + step * along
        h[self.row] = self.h0 + step * (self.h1 + np.where(self.twice, step, 1.0) * across)


@dataclass
class _PolynomialChords:
    """Chords to polynomial curves, whose x and h are polynomials (degree + 1, n)."""

    noise: float
    x: FloatArray
    h: FloatArray
    close: _Close | None

    @classmethod
    def of(cls, sites: Sites, approach: Approach) -> _PolynomialChords:
        """Chords of an approach."""
        curve = sites.polynomial.take(sites.bezier[approach.target], axis=2)
        (nx, ny), (px, py) = approach.normal.T, approach.position.T
        close = _close(approach, curve)
        curve_x, curve_y = curve[0], curve[1]
        curve_x[0] -= px
        curve_y[0] -= py
        x, h = ny * curve_x - nx * curve_y, nx * curve_x + ny * curve_y
        return cls(4e-15 * sites.size, x, h, close)

    def take(self, rows: IntArray) -> _PolynomialChords:
        """Rows."""
        close = self.close.take(rows, self.x.shape[1]) if self.close else None
        return _PolynomialChords(
            self.noise, self.x.take(rows, axis=1), self.h.take(rows, axis=1), close
        )

    def _placed(self, parameter: FloatArray, x: FloatArray, h: FloatArray) -> None:
        # Heights that are rounding only are none.
        h[np.abs(h) <= self.noise] = 0.0
        if self.close:
            self.close.put(parameter, x, h)

    def at(self, parameter: FloatArray) -> tuple[FloatArray, FloatArray]:
        """x and h, each (n,)."""
        local = parameter - 0.5
        x, h = self.x[-1], self.h[-1]
        for power in range(len(self.x) - 2, -1, -1):
            x = x * local + self.x[power]
            h = h * local + self.h[power]
        self._placed(parameter, x, h)
        return x, h

    def jet(self, parameter: FloatArray) -> _Jet:
        """The same with derivatives."""
        local = parameter - 0.5
        columns: list[FloatArray] = []
        for table in (self.x, self.h):
            value, first, second = table[-1], np.zeros(1), np.zeros(1)
            for power in range(len(table) - 2, -1, -1):
                second = second * local + first
                first = first * local + value
                value = value * local + table[power]
            columns.extend((value, first, 2.0 * second))
        x, first_x, second_x, h, first_h, second_h = columns
        self._placed(parameter, x, h)
        return _Jet(x, h, first_x, first_h, second_x, second_h)


def _close(approach: Approach, curve: FloatArray) -> _Close | None:
    """Rows on one curve with their target, or next to it; `curve` (2, degree + 1, n)."""
    rows = (approach.same | approach.adjacent).nonzero()[0]
    if not len(rows):
        return None
    adjacent, sine = approach.adjacent[rows], approach.sine[rows]
    # Where the boundary passes smoothly from curve to curve its direction there tells all.
    passing = adjacent & (sine == sine)
    twice = ~adjacent | passing
    start = np.where(adjacent, approach.end[rows], approach.own[rows])
    once = _quotient(curve.take(rows, axis=2), start - 0.5)
    again = np.zeros_like(once)
    again[:, :-1] = _quotient(once, start - 0.5)
    nx, ny = approach.normal[rows].T
    base = -approach.relative[rows]
    x = ny * once[0] - nx * once[1]
    lifted = np.where(twice, again, once)
    h = nx * lifted[0] + ny * lifted[1]
    x0 = np.where(adjacent, ny * base[:, 0] - nx * base[:, 1], 0.0)
    h0 = np.where(adjacent, approach.rise[rows], 0.0)
    h1 = np.zeros(len(rows))
    if passing.any():
        local = start - 0.5
        along = once[:, -1]
        for power in range(once.shape[1] - 2, -1, -1):
            along = along * local + once[:, power]
        h1 = np.where(passing, sine * np.hypot(along[0], along[1]), 0.0)
    return _Close(rows, start, x0, h0, h1, twice, x, h)


def _quotient(curve: FloatArray, place: FloatArray) -> FloatArray:
    """Polynomials (c(t) - c(a)) / (t - a), (2, degree, n), by Horner's rule."""
    result = np.empty((2, max(curve.shape[1] - 1, 1), curve.shape[2]))
    if curve.shape[1] == 1:
        result[:] = 0.0
        return result
    result[:, -1] = curve[:, -1]
    for power in range(curve.shape[1] - 2, 0, -1):
        result[:, power - 1] = curve[:, power] + place * result[:, power]
    return result


@dataclass
class _RationalChords:
    """Chords to rational curves, `table` (n, degree + 1, 3) in homogeneous power form."""

    noise: float
    approach: Approach
    table: FloatArray

    @classmethod
    def of(cls, sites: Sites, approach: Approach) -> _RationalChords:
        """Chords of an approach."""
        table = sites.coefficients[sites.bezier[approach.target]]
        return cls(4e-15 * sites.size, approach, table)

    def take(self, rows: IntArray) -> _RationalChords:
        """Rows."""
        return _RationalChords(self.noise, self.approach.take(rows), self.table[rows])

    def _rotated(self, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        (nx, ny), (x, y) = self.approach.normal.T, vector.T
        return ny * x - nx * y, nx * x + ny * y

    def _chord(self, parameter: FloatArray, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        approach = self.approach
        x, h = self._rotated(point - approach.position)
        h[np.abs(h) <= self.noise] = 0.0
        same = approach.same & ~approach.adjacent
        for rows, start in (
            (same.nonzero()[0], approach.own),
            (approach.adjacent.nonzero()[0], approach.end),
        ):
            if not len(rows):
                continue
            part = _RationalChords(self.noise, approach.take(rows), self.table[rows])
            first, last = start[rows], parameter[rows]
            one, two, weight = divided_differences(part.table, first, last)
            origin = evaluate_rational(part.table, first, 0)[0]
            step = last - first
            along, lifted = part._rotated(_lowered(one, origin, weight))
            if start is approach.own:
                _, lifted = part._rotated(_lowered(two, origin, weight))
                x[rows], h[rows] = step * along, step**2 * lifted
            else:
                back, _ = part._rotated(part.approach.relative)
                x[rows], h[rows] = step * along - back, step * lifted + part.approach.rise
        return x, h

    def at(self, parameter: FloatArray) -> tuple[FloatArray, FloatArray]:
        """x and h, each (n,)."""
        return self._chord(parameter, evaluate_rational(self.table, parameter, 0)[0])

    def jet(self, parameter: FloatArray) -> _Jet:
        """The same with derivatives."""
        point, first, second = evaluate_rational(self.table, parameter, 2)
        (first_x, first_h), (second_x, second_h) = self._rotated(first), self._rotated(second)
        return _Jet(*self._chord(parameter, point), first_x, first_h, second_x, second_h)


def divided_differences(
    coefficients: FloatArray, first: FloatArray, second: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """c[a, b], c[a, a, b] (n, 3) and the weight at b (n,) of curves in power form about 1/2.

    Complete symmetric polynomials: h1' = b h1 + a^k, h2' = a h2 + h1.
    """
    a, b = first - 0.5, second - 0.5
    one, two = np.zeros((len(a), 3)), np.zeros((len(a), 3))
    weight = coefficients[:, 0, 2].copy()
    power_a, power_b = np.ones(len(a)), np.ones(len(a))
    h1, h2 = np.zeros(len(a)), np.zeros(len(a))
    for degree in range(1, coefficients.shape[1]):
        h2 = a * h2 + h1
        h1 = b * h1 + power_a
        power_a, power_b = power_a * a, power_b * b
        one += h1[:, None] * coefficients[:, degree]
        two += h2[:, None] * coefficients[:, degree]
        weight += power_b * coefficients[:, degree, 2]
    return one, two, weight


def turned_differences(
    curve: FloatArray, first: FloatArray, second: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """c'[a, b] and c'(b) (n, 2) of polynomials (2, degree + 1, n) in powers about 1/2."""
    powers = np.arange(1.0, curve.shape[1])
    slope = powers[:, None] * curve[:, 1:]
    a, b = first - 0.5, second - 0.5
    change = _quotient(slope, a)
    direction, bend = slope[:, -1], change[:, -1]
    for power in range(slope.shape[1] - 2, -1, -1):
        direction = direction * b + slope[:, power]
    for power in range(change.shape[1] - 2, -1, -1):
        bend = bend * b + change[:, power]
    return bend.T, direction.T


def _lowered(difference: FloatArray, position: FloatArray, weight: FloatArray) -> FloatArray:
    """Divided difference of the curve from that of its homogeneous form."""
    return np.asarray((difference[:, :2] - position * difference[:, 2:]) / weight[:, None])


def lowered_differences(
    coefficients: FloatArray, first: FloatArray, second: FloatArray, position: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """c[a, b] and c[a, a, b] (n, 2) of curves, of which `position` (n, 2) are the points at a."""
    one, two, weight = divided_differences(coefficients, first, second)
    return _lowered(one, position, weight), _lowered(two, position, weight)


# -- minimum of (A) -------------------------------------------------------------------------------


def disk_radius(x: FloatArray, h: FloatArray) -> FloatArray:
    """(A); infinite where no disk reaches the point. Division by zero is the caller's to allow."""
    radius = (x * x + h * h) / (2 * h)
    return np.where((h > 0) & (radius < np.inf), radius, np.inf)


def _slopes(jet: _Jet, radius: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """g, its derivative at a fixed radius, and h r''."""
    x, h, first_x, first_h, second_x, second_h = jet
    towards = h - radius
    slope = x * first_x + towards * first_h
    curve = first_x * first_x + first_h * first_h + x * second_x + towards * second_h
    return slope, curve, curve - 2 * slope * first_h / h


def _newton(
    chords: _Chords, low: FloatArray, high: FloatArray, hint: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Newton steps from the hints: contact, radius, and whether they may be believed.

    An end of the target is a contact where (A) rises into the target. The radius must not exceed
    that of the hint.
    """
    count = len(hint)
    parameter, radius = hint.copy(), np.full(count, np.inf)
    good = np.zeros(count, dtype=bool)
    rows = (hint == hint).nonzero()[0]
    if len(rows) < count:
        chords, low, high = chords.take(rows), low[rows], high[rows]
    value = np.minimum(np.maximum(hint[rows], low), high)
    span = high - low
    before, limit = span, np.zeros(0)
    for number in range(_STEPS):
        if not len(rows):
            break
        jet = chords.jet(value)
        rho = disk_radius(jet.x, jet.h)
        if number == 0:
            limit = rho * (1 + 1e-9)
        slope, curve, steep = _slopes(jet, rho)
        step = -slope / np.where(steep > 0.1 * curve, steep, curve)
        step = np.where(curve > 0, step, -0.3 * np.sign(slope) * span)
        reached = np.isfinite(step) & (rho < np.inf)
        new = np.minimum(np.maximum(value + np.where(reached, step, 0.0), low), high)
        step = new - value
        moved = np.abs(step)
        done = _settled(moved, before, span, slope * step, rho * jet.h) | ~reached
        if done.any():
            # Two terms of the Taylor series of (A) for the step that is made without it.
            last = rho + step * (slope + 0.5 * step * steep) / jet.h
            ended, stay = done.nonzero()[0], (~done).nonzero()[0]
            which = rows[ended]
            parameter[which] = new[ended]
            radius[which] = np.where(moved > 0, last, rho)[ended]
            good[which] = (reached & (rho <= limit))[ended]
            rows, value, before, limit = rows[stay], new[stay], moved[stay], limit[stay]
            low, high, span = low[stay], high[stay], span[stay]
            chords = chords.take(stay) if len(stay) else chords
        else:
            value, before = new, moved
    return parameter, radius, good


def _settled(
    moved: FloatArray, before: FloatArray, span: FloatArray, change: FloatArray, scale: FloatArray
) -> BoolArray:
    """Whether steps that `moved` so far, after those of `before`, are the last ones needed.

    Where the convergence is quadratic the next step would be shorter by the square of the ratio of
    these two. Where it is slow, as about osculating disks, (A) is flat and settled: by the step it
    changes by `change` of `scale`.
    """
    ratio = moved / before
    done = (moved <= 1e-13 * span) | (
        (ratio <= 0.03) & (moved <= 1e-6 * span) & (moved * ratio * ratio <= 1e-13 * span)
    )
    slow = (ratio > 0.1) & ((moved <= 1e-8 * span) | (np.abs(change) <= 1e-15 * scale))
    return done | slow


def _bracketed(chords: _Chords, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    grid = low[:, None] + (high - low)[:, None] * _GRID
    grid[:, -1] = high
    count, width = grid.shape
    rows = np.arange(count)
    rho = disk_radius(*chords.take(np.repeat(rows, width)).at(grid.ravel())).reshape(count, width)
    best = np.argmin(rho, axis=1)
    left = grid[rows, np.maximum(best - 1, 0)]
    right = grid[rows, np.minimum(best + 1, width - 1)]
    sample, sampled = grid[rows, best], rho[rows, best]
    parameter = sample.copy()
    active = np.isfinite(sampled).nonzero()[0]
    before, span = np.full(len(active), np.inf), (high - low)[active]
    left, right, part = left[active], right[active], chords.take(active)
    for _ in range(60):
        if not len(active):
            break
        value = parameter[active]
        jet = part.jet(value)
        rho = disk_radius(jet.x, jet.h)
        slope, curve, steep = _slopes(jet, rho)
        # Where no disk exists the minimum lies towards the best sample.
        reached = rho < np.inf
        rising = np.where(reached, slope > 0, value > sample[active])
        right = np.where(rising, value, right)
        left = np.where(rising, left, value)
        new = value - slope / np.where(steep > 0.1 * curve, steep, curve)
        inside = (new >= left) & (new <= right) & (curve > 0) & reached
        new = np.where(inside, new, 0.5 * (left + right))
        moved = np.abs(new - value)
        settled = np.abs(slope * (new - value)) <= 1e-15 * rho * jet.h
        done = (moved <= 1e-13 * span) | (settled & (moved > 0.1 * before))
        parameter[active] = new
        stay = (~done).nonzero()[0]
        if len(stay) < len(active):
            active, part, span = active[stay], part.take(stay), span[stay]
            left, right, moved = left[stay], right[stay], moved[stay]
        before = moved
    final = disk_radius(*chords.at(parameter))
    # Radii are flat about the contact: a sample that is lower by rounding is not nearer to it.
    worse = ~(final <= sampled * (1 + 1e-10))
    return np.where(worse, sample, parameter), np.where(worse, sampled, final)
