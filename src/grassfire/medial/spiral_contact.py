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
    taylor,
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
    """x and h at parameters of the targets, and two derivatives of both, each (2, n)."""

    value: FloatArray
    first: FloatArray
    second: FloatArray


class _Chords(Protocol):
    """Chords from points to targets, in the frames of the points; heights up to `noise` (n,) are
    rounding only, and none."""

    @property
    def noise(self) -> FloatArray: ...

    def take(self, rows: IntArray) -> Self:
        """Rows."""

    def at(self, parameter: FloatArray) -> FloatArray:
        """x and h, (2, n)."""

    def jet(self, parameter: FloatArray) -> _Jet:
        """The same with derivatives."""


def spiral_contact(
    sites: Sites, approach: Approach, hint: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Parameters and radii (n,) of the smallest disks that reach spirals; see `contact`."""
    if sites.all_polynomial:
        return _solve(sites, approach, hint, _PolynomialChords.of(sites, approach))
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
class _PolynomialChords:
    """Chords to polynomial curves: x and h, (2, degree + 1, n), in powers of t - `centre` (n,)."""

    noise: FloatArray
    centre: FloatArray
    table: FloatArray

    @classmethod
    def of(cls, sites: Sites, approach: Approach) -> _PolynomialChords:
        """Chords of an approach."""
        curve = sites.polynomial.take(sites.bezier.take(approach.target), axis=2)
        nx, ny = approach.normal.T
        close = (approach.same | approach.adjacent).nonzero()[0]
        about = _expansions(approach.take(close), curve.take(close, axis=2))
        curve[:, 0] -= approach.position.T
        table = np.empty_like(curve)
        np.subtract(ny * curve[0], nx * curve[1], out=table[0])
        np.add(nx * curve[0], ny * curve[1], out=table[1])
        centre, noise = np.full(len(nx), 0.5), np.full(len(nx), 4e-15 * sites.size)
        centre[close], table[:, :, close] = about
        noise[close] = 0.0
        return cls(noise, centre, table)

    def take(self, rows: IntArray) -> _PolynomialChords:
        """Rows."""
        table = self.table.take(rows, axis=2)
        return _PolynomialChords(self.noise.take(rows), self.centre.take(rows), table)

    def at(self, parameter: FloatArray) -> FloatArray:
        """x and h, (2, n)."""
        return taylor(self.table, parameter - self.centre, 0)[0]

    def jet(self, parameter: FloatArray) -> _Jet:
        """The same with derivatives."""
        return _Jet(*taylor(self.table, parameter - self.centre, 2))


def _expansions(approach: Approach, curve: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parameters (n,), and x and h (2, degree + 1, n) in powers about them, for targets on the
    curve (2, degree + 1, n) of the point, or on one next to it.

    There the lowest coefficients are known, and nothing cancels.
    """
    adjacent, sine = approach.adjacent, approach.sine
    about = np.where(adjacent, approach.end, approach.own)
    curve = recentred(curve, about - 0.5)
    nx, ny = approach.normal.T
    px, py = np.where(adjacent, approach.relative.T, 0.0)
    table = np.stack([ny * curve[0] - nx * curve[1], nx * curve[0] + ny * curve[1]])
    table[0, 0], table[1, 0] = nx * py - ny * px, np.where(adjacent, approach.rise, 0.0)
    if table.shape[1] > 1:
        # Where the boundary passes smoothly from curve to curve its direction there tells all.
        passing = adjacent & (sine == sine)
        lean = np.where(passing, sine * np.hypot(curve[0, 1], curve[1, 1]), 0.0)
        table[1, 1] = np.where(passing | ~adjacent, lean, table[1, 1])
    return about, table


def recentred(curve: FloatArray, place: FloatArray) -> FloatArray:
    """Polynomials (2, degree + 1, n) in powers of t - a, from those in powers of t."""
    result = curve.copy()
    count = curve.shape[1]
    for last in range(count - 1):
        for power in range(count - 2, last - 1, -1):
            result[:, power] += place * result[:, power + 1]
    return result


def turned_differences(
    curve: FloatArray, place: FloatArray, step: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """c[a, b], c[a, a, b], c'[a, b] and c'(b), (n, 2) each, for b = a + step.

    Parameters
    ----------
    curve : (2, degree + 1, n) float array
        Polynomials in powers of t.
    place, step : (n,) float arrays
    """
    curve = recentred(curve, place)
    count = curve.shape[1]
    two, bend = np.zeros((2, 2, len(step)))
    for power in range(count - 1, 1, -1):
        two = two * step + curve[:, power]
        bend = bend * step + power * curve[:, power]
    slope = curve[:, 1] if count > 1 else np.zeros_like(two)
    return (slope + step * two).T, two.T, bend.T, (slope + step * bend).T


@dataclass
class _RationalChords:
    """Chords to rational curves, `table` (n, degree + 1, 3) in homogeneous power form."""

    noise: FloatArray
    approach: Approach
    table: FloatArray

    @classmethod
    def of(cls, sites: Sites, approach: Approach) -> _RationalChords:
        """Chords of an approach."""
        table = sites.coefficients[sites.bezier[approach.target]]
        close = approach.same | approach.adjacent
        return cls(np.where(close, 0.0, 4e-15 * sites.size), approach, table)

    def take(self, rows: IntArray) -> _RationalChords:
        """Rows."""
        return _RationalChords(self.noise[rows], self.approach.take(rows), self.table[rows])

    def _rotated(self, vector: FloatArray) -> FloatArray:
        (nx, ny), (x, y) = self.approach.normal.T, vector.T
        return np.stack([ny * x - nx * y, nx * x + ny * y])

    def _chord(self, parameter: FloatArray, point: FloatArray) -> FloatArray:
        approach = self.approach
        chord = self._rotated(point - approach.position)
        same = approach.same & ~approach.adjacent
        for rows, start in (
            (same.nonzero()[0], approach.own),
            (approach.adjacent.nonzero()[0], approach.end),
        ):
            if not len(rows):
                continue
            part = self.take(rows)
            first, last = start[rows], parameter[rows]
            one, two, weight = divided_differences(part.table, first, last)
            origin = evaluate_rational(part.table, first, 0)[0]
            step = last - first
            along, lifted = part._rotated(_lowered(one, origin, weight))
            if start is approach.own:
                _, lifted = part._rotated(_lowered(two, origin, weight))
                chord[:, rows] = step * along, step**2 * lifted
            else:
                back, _ = part._rotated(part.approach.relative)
                chord[:, rows] = step * along - back, step * lifted + part.approach.rise
        return chord

    def at(self, parameter: FloatArray) -> FloatArray:
        """x and h, (2, n)."""
        return self._chord(parameter, evaluate_rational(self.table, parameter, 0)[0])

    def jet(self, parameter: FloatArray) -> _Jet:
        """The same with derivatives."""
        point, first, second = evaluate_rational(self.table, parameter, 2)
        chord = self._chord(parameter, point)
        return _Jet(chord, self._rotated(first), self._rotated(second))


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


def _radius(chord: FloatArray, noise: FloatArray) -> FloatArray:
    """(A); infinite where no disk reaches the point. Division by zero is the caller's to allow."""
    x, h = chord
    return np.where(h > noise, (x * x + h * h) / (2 * h), np.inf)


def _slopes(jet: _Jet, radius: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """g, its derivative at a fixed radius, and h r''."""
    towards = jet.value.copy()
    towards[1] -= radius
    slope, curve = towards * jet.first, jet.first * jet.first + towards * jet.second
    slope, curve = slope[0] + slope[1], curve[0] + curve[1]
    return slope, curve, curve - 2 * slope * jet.first[1] / jet.value[1]


def _newton(
    chords: _Chords, low: FloatArray, high: FloatArray, hint: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Newton steps from the hints: contact, radius, and whether they may be believed.

    An end of the target is a contact where (A) rises into the target. The radius must never exceed
    that of the hint.
    """
    count = len(hint)
    parameter, radius = hint.copy(), np.full(count, np.inf)
    good = np.zeros(count, dtype=bool)
    rows = (hint == hint).nonzero()[0]
    fixed = np.stack([low, high, high - low, np.full(count, np.inf)])
    if len(rows) < count:
        chords, fixed = chords.take(rows), fixed.take(rows, axis=1)
    value = np.minimum(np.maximum(hint.take(rows), fixed[0]), fixed[1])
    before = np.ones(len(rows))
    for number in range(_STEPS):
        if not len(rows):
            break
        low, high, span, limit = fixed
        jet = chords.jet(value)
        rho = _radius(jet.value, chords.noise)
        if number == 0:
            limit[:] = np.where(rho < np.inf, rho * (1 + 1e-9), -np.inf)
        slope, curve, steep = _slopes(jet, rho)
        step = -slope / np.where(steep > 0.1 * curve, steep, curve)
        step = np.where(curve > 0, step, -0.3 * np.sign(slope) * span)
        new = np.minimum(np.maximum(value + step, low), high)
        step = new - value
        moved = np.abs(step) / span
        height, lower = jet.value[1], rho <= limit
        done = _settled(moved, before, slope * step, rho * height) | ~lower
        if done.any():
            # Two terms of the Taylor series of (A) for the step that is made without it.
            last = np.where(moved > 0, rho + step * (slope + 0.5 * step * steep) / height, rho)
            ended, stay = done.nonzero()[0], (~done).nonzero()[0]
            which = rows.take(ended)
            parameter[which], radius[which] = new.take(ended), last.take(ended)
            good[which] = lower.take(ended)
            rows, value, before = rows.take(stay), new.take(stay), moved.take(stay)
            fixed, chords = fixed.take(stay, axis=1), chords.take(stay)
        else:
            value, before = new, moved
    return parameter, radius, good


def _settled(
    moved: FloatArray, before: FloatArray, change: FloatArray, scale: FloatArray
) -> BoolArray:
    """Whether steps that `moved` so far, after those of `before`, are the last ones needed; both as
    shares of the target.

    Where the convergence is quadratic the next step would be shorter by the square of the ratio of
    these two. Where it is slow, as about osculating disks, (A) is flat and settled: by the step it
    changes by `change` of `scale`.
    """
    ratio = moved / before
    done = (ratio <= 0.03) & (moved <= 1e-6) & (moved * ratio * ratio <= 1e-13)
    slow = (ratio > 0.1) & ((moved <= 1e-8) | (np.abs(change) <= 1e-15 * scale))
    return done | slow | (moved <= 1e-13)


def _bracketed(chords: _Chords, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    grid = low[:, None] + (high - low)[:, None] * _GRID
    grid[:, -1] = high
    count, width = grid.shape
    rows = np.arange(count)
    every = chords.take(np.repeat(rows, width))
    rho = _radius(every.at(grid.ravel()), every.noise).reshape(count, width)
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
        rho = _radius(jet.value, part.noise)
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
        settled = np.abs(slope * (new - value)) <= 1e-15 * rho * jet.value[1]
        done = (moved <= 1e-13 * span) | (settled & (moved > 0.1 * before))
        parameter[active] = new
        stay = (~done).nonzero()[0]
        if len(stay) < len(active):
            active, part, span = active[stay], part.take(stay), span[stay]
            left, right, moved = left[stay], right[stay], moved[stay]
        before = moved
    final = _radius(chords.at(parameter), chords.noise)
    # Radii are flat about the contact: a sample that is lower by rounding is not nearer to it.
    worse = ~(final <= sampled * (1 + 1e-10))
    return np.where(worse, sample, parameter), np.where(worse, sampled, final)
