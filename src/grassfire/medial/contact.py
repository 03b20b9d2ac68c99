"""Contacts: the smallest disk that is tangent at one boundary point and reaches another site.

Minimises (A), r = |q - p|^2 / (2 n.(q - p)), over the closed site. Lines, arcs and points have
closed forms, spirals are solved by Newton's method. Near a smooth end or a flat corner both
|q - p|^2 and n.(q - p) are differences of nearly equal numbers; there they are formed from divided
differences of the curves themselves, which do not cancel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grassfire.medial.columns import Columns
from grassfire.medial.sites import (
    BoolArray,
    FloatArray,
    IntArray,
    SiteKind,
    Sites,
    disk_through,
    dot,
    evaluate_rational,
)

# At flat corners only a sliver next to the end can be touched: the grid crowds towards both ends.
_CROWD = 10.0 ** np.arange(-8, -1)
_GRID = np.concatenate([[0.0], _CROWD, np.linspace(0.0, 1.0, 15)[1:-1], 1 - _CROWD[::-1], [1.0]])


@dataclass(frozen=True)
class Tangents(Columns):
    """Boundary points p with normals n, one row a contact to be found.

    Attributes
    ----------
    position, normal : (n, 2) float arrays
    site : (n,) int array
        The site that p lies on.
    parameter : (n,) float array
    """

    position: FloatArray
    normal: FloatArray
    site: IntArray
    parameter: FloatArray

    def __len__(self) -> int:
        return len(self.site)


@dataclass(frozen=True)
class _Near(Columns):
    """Tangents against spirals: how their chords are formed.

    `same`: both on one Bezier curve. `adjacent`: the sites meet in j, at `end` of the target;
    `relative` is p - j and `rise` is n.(j - p), both without cancellation. `table` are the
    coefficients of the targets' curves, where they are wanted.
    """

    tangents: Tangents
    target: IntArray
    same: BoolArray
    adjacent: BoolArray
    end: FloatArray
    relative: FloatArray
    rise: FloatArray
    table: FloatArray


def contact(
    sites: Sites, tangents: Tangents, target: IntArray, hint: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Smallest disk tangent at each point (centre along its normal) that reaches `target`.

    Parameters
    ----------
    tangents : Tangents
    target : (n,) int array
    hint : (n,) float array
        Start parameter on the target; NaN where none is known.

    Returns
    -------
    parameter, radius : (n,) float arrays
        Contact on the target and disk radius, mm; infinite where no disk reaches it.
    """
    kind = sites.kind[target]
    parameter = np.full(len(target), np.nan)
    radius = np.full(len(target), np.inf)
    near = _near(sites, tangents, target)
    for value, method in (
        (SiteKind.LINE, _line),
        (SiteKind.ARC, _arc),
        (SiteKind.POINT, _point),
    ):
        rows = np.flatnonzero(kind == value)
        if len(rows):
            parameter[rows], radius[rows] = method(sites, near.take(rows))
    rows = np.flatnonzero(kind == SiteKind.SPIRAL)
    if len(rows):
        parameter[rows], radius[rows] = _spiral(sites, near.take(rows), hint[rows])
    # The end of a site at a reflex corner is the corner's to touch.
    low, high = parameter <= sites.low[target], parameter >= sites.high[target]
    point = sites.kind == SiteKind.POINT
    corner = (low & point[sites.preceding[target]]) | (high & point[sites.following[target]])
    radius[corner & ~point[target]] = np.inf
    # The point itself, met as the end of a neighbouring site, is no second contact.
    rows = np.flatnonzero((radius < 1e-6 * sites.size) & (low | high | point[target]))
    if len(rows):
        chord = sites.point(target[rows], parameter[rows]) - tangents.position[rows]
        same = np.hypot(chord[:, 0], chord[:, 1]) <= 1e-12 * sites.size
        radius[rows[same]] = np.inf
    return parameter, radius


def _near(sites: Sites, tangents: Tangents, target: IntArray) -> _Near:
    own, u = tangents.site, tangents.parameter
    forward, backward = target == sites.following[own], target == sites.preceding[own]
    # Two sites that are a whole loop meet twice: the nearer end counts.
    closer = sites.high[own] - u <= u - sites.low[own]
    forward &= ~backward | closer
    adjacent = forward | backward
    same = (sites.bezier[own] == sites.bezier[target]) & (sites.bezier[own] >= 0)
    relative, rise = np.zeros((len(own), 2)), np.zeros(len(own))
    rows = np.flatnonzero(adjacent)
    if len(rows):
        end = np.where(forward, sites.high[own], sites.low[own])
        relative[rows], rise[rows] = _from_end(sites, tangents.take(rows), end[rows])
    far = np.where(forward, sites.low[target], sites.high[target])
    table = np.zeros((len(own), 0, 3))
    return _Near(tangents, target, same, adjacent & ~same, far, relative, rise, table)


def _from_end(sites: Sites, tangents: Tangents, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """p - j and n.(j - p) for the point j at `end` of the point's own site."""
    own, u = tangents.site, tangents.parameter
    kind = sites.kind[own]
    relative, rise = np.zeros((len(own), 2)), np.zeros(len(own))
    line = kind == SiteKind.LINE
    relative[line] = (u - end)[line, None] * sites.extent[own[line]]
    arc = np.flatnonzero(kind == SiteKind.ARC)
    if len(arc):
        start, sweep = sites.extent[own[arc]].T
        half = 0.5 * (u[arc] - end[arc]) * sweep
        middle = start + 0.5 * (u[arc] + end[arc]) * sweep
        chord = 2 * sites.radius[own[arc]] * np.sin(half)
        relative[arc] = chord[:, None] * np.stack([-np.sin(middle), np.cos(middle)], axis=1)
        rise[arc] = np.sign(sweep) * 2 * sites.radius[own[arc]] * np.sin(half) ** 2
    spiral = np.flatnonzero(kind == SiteKind.SPIRAL)
    if len(spiral):
        step = (end - u)[spiral]
        table = sites.coefficients[sites.bezier[own[spiral]]]
        one, two, weight = divided_differences(table, u[spiral], end[spiral])
        position = tangents.position[spiral]
        relative[spiral] = -step[:, None] * _lowered(one, position, weight)
        bend = dot(tangents.normal[spiral], _lowered(two, position, weight))
        rise[spiral] = step**2 * bend
    return relative, rise


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


# -- closed forms ---------------------------------------------------------------------------------


def _line(sites: Sites, near: _Near) -> tuple[FloatArray, FloatArray]:
    position, normal = near.tangents.position, near.tangents.normal
    start, direction = sites.anchor[near.target], sites.extent[near.target]
    length = np.hypot(direction[:, 0], direction[:, 1])
    inward = np.stack([-direction[:, 1], direction[:, 0]], axis=1) / length[:, None]
    offset = np.where(near.adjacent[:, None], near.relative, position - start)
    height = _above_noise(sites, near, dot(inward, offset))
    cosine = dot(normal, inward)
    sine = normal[:, 0] * inward[:, 1] - normal[:, 1] * inward[:, 0]
    # 1 - cos loses all digits for nearly parallel lines; sin^2 / (1 + cos) does not.
    slack = np.where(cosine > 0, sine**2 / (1 + np.maximum(cosine, 0)), 1 - cosine)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        radius = np.where((height >= 0) & (slack > 1e-30), height / slack, np.inf)
    finite = np.isfinite(radius)
    centre = position + np.where(finite, radius, 0.0)[:, None] * normal
    parameter = np.where(finite, dot(centre - start, direction) / length**2, np.nan)
    return _clip(sites, near, parameter, radius)


def _arc(sites: Sites, near: _Near) -> tuple[FloatArray, FloatArray]:
    position, normal, target = near.tangents.position, near.tangents.normal, near.target
    rim = sites.radius[target]
    start, sweep = sites.extent[target].T
    sign = np.sign(sweep)
    offset = position - sites.anchor[target]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    angle = start + near.end * sweep
    spoke = rim[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    beside = -dot(2 * spoke + near.relative, near.relative)
    gap = _above_noise(sites, near, rim - distance)
    gap = np.where((gap * sign < 0) & (np.abs(gap) <= 1e-12 * sites.size), 0.0, gap)
    numerator = np.where(near.adjacent, beside, gap * (rim + distance))
    denominator = 2 * (dot(normal, offset) + sign * rim)
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = numerator / denominator
    # Walls that touch leave a disk of no radius, which is a contact.
    valid = np.isfinite(radius) & (radius >= 0) & (numerator * sign >= 0)
    radius = np.where(valid, radius, np.inf)
    towards = offset + np.where(valid, radius, 0.0)[:, None] * normal
    angle = np.arctan2(towards[:, 1], towards[:, 0])
    # Angle past the middle in the direction of the sweep, cut opposite to it.
    delta = np.remainder(angle - (start + sweep / 2) + np.pi, 2 * np.pi) - np.pi
    parameter = np.where(valid, 0.5 + delta / sweep, np.nan)
    return _clip(sites, near, parameter, radius)


def _point(sites: Sites, near: _Near) -> tuple[FloatArray, FloatArray]:
    position, normal, target = near.tangents.position, near.tangents.normal, near.target
    chord = np.where(near.adjacent[:, None], -near.relative, sites.anchor[target] - position)
    height = np.where(near.adjacent, near.rise, dot(chord, normal))
    radius = _disk(chord, height)
    finite = np.isfinite(radius)
    centre = position + np.where(finite, radius, 0.0)[:, None] * normal
    direction = centre - sites.anchor[target]
    start, turn = sites.extent[target].T
    angle = np.arctan2(direction[:, 1], direction[:, 0])
    delta = np.remainder(angle - (start + turn / 2) + np.pi, 2 * np.pi) - np.pi
    parameter = np.clip(0.5 + delta / turn, 0.0, 1.0)
    return np.where(finite, parameter, np.nan), radius


def _disk(chord: FloatArray, height: FloatArray) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        radius = dot(chord, chord) / (2 * height)
    return np.where((height > 0) & np.isfinite(radius), radius, np.inf)


def _above_noise(sites: Sites, near: _Near, height: FloatArray) -> FloatArray:
    """Heights that are rounding only are none, unless the sites meet and they are exact."""
    noise = ~near.adjacent & (np.abs(height) <= 4e-15 * sites.size)
    return np.where(noise, 0.0, height)


def _clip(
    sites: Sites, near: _Near, parameter: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Replace contacts beyond an end of the site by the better of its two ends."""
    low, high = sites.low[near.target], sites.high[near.target]
    rows = np.flatnonzero(~((parameter >= low) & (parameter <= high)))
    if len(rows):
        position, normal = near.tangents.position[rows], near.tangents.normal[rows]
        ends = [
            disk_through(sites.point(near.target[rows], end[rows]) - position, normal)
            for end in (low, high)
        ]
        first = ends[0] <= ends[1]
        parameter[rows] = np.where(first, low[rows], high[rows])
        radius[rows] = np.where(first, ends[0], ends[1])
    return parameter, radius


# -- spirals --------------------------------------------------------------------------------------


def _spiral(sites: Sites, near: _Near, hint: FloatArray) -> tuple[FloatArray, FloatArray]:
    near = replace(near, table=sites.coefficients[sites.bezier[near.target]])
    parameter, radius, good = _newton(sites, near, hint)
    rows = np.flatnonzero(~good)
    if len(rows):
        parameter[rows], radius[rows] = _bracketed(sites, near.take(rows))
    return parameter, radius


def _chords(
    sites: Sites, near: _Near, parameter: FloatArray, point: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """q - p (n, 2) and n.(q - p) (n,) at parameters of the targets, where q is `point`."""
    position, normal = near.tangents.position, near.tangents.normal
    chord = point - position
    height = _above_noise(sites, near, dot(chord, normal))
    rows = np.flatnonzero(near.same)
    if len(rows):
        step = (parameter - near.tangents.parameter)[rows]
        table = near.table[rows]
        one, two, weight = divided_differences(
            table, near.tangents.parameter[rows], parameter[rows]
        )
        chord[rows] = step[:, None] * _lowered(one, position[rows], weight)
        height[rows] = step**2 * dot(_lowered(two, position[rows], weight), normal[rows])
    rows = np.flatnonzero(near.adjacent)
    if len(rows):
        end = near.end[rows]
        table = near.table[rows]
        one, _, weight = divided_differences(table, end, parameter[rows])
        joint = sites.point(near.target[rows], end)
        along = (parameter[rows] - end)[:, None] * _lowered(one, joint, weight)
        chord[rows] = along - near.relative[rows]
        height[rows] = dot(along, normal[rows]) + near.rise[rows]
    return chord, height


def _stationarity(
    sites: Sites, near: _Near, parameter: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Derivative of (A) times n.(q - p), its derivative, (A) itself and n.(q - p)."""
    point, first, second = evaluate_rational(near.table, parameter, 2)
    chord, height = _chords(sites, near, parameter, point)
    rho = _disk(chord, height)
    finite = np.where(np.isfinite(rho), rho, 0.0)
    towards = chord - finite[:, None] * near.tangents.normal
    return dot(towards, first), dot(first, first) + dot(towards, second), rho, height


def _newton(
    sites: Sites, near: _Near, hint: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Projected Newton steps from the hints: contact, radius, and whether they may be believed.

    An end of the target is a contact where (A) rises into the target. The radius must not exceed
    that of the hint.
    """
    count = len(hint)
    parameter, radius = hint.copy(), np.full(count, np.inf)
    good = np.zeros(count, dtype=bool)
    rows = np.flatnonzero(~np.isnan(hint))
    near = near.take(rows) if len(rows) < count else near
    low, high = sites.low[near.target], sites.high[near.target]
    value = np.clip(hint[rows], low, high)
    first, before = np.full(len(rows), np.nan), np.full(len(rows), np.inf)
    for step_number in range(24):
        if not len(rows):
            break
        slope, curve, rho, height = _stationarity(sites, near, value)
        if step_number == 0:
            first = rho * (1 + 1e-9)
        span = high - low
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(curve > 0, -slope / curve, -0.3 * np.sign(slope) * span)
        reached = np.isfinite(step) & np.isfinite(rho)
        new = np.clip(value + np.where(reached, step, 0.0), low, high)
        # The step that is left out would be its square, or half of it at a double root.
        done = (np.abs(new - value) <= 1e-13 * span) | ~reached
        parameter[rows], radius[rows] = new, rho
        # About an osculating disk (A) is flat: Newton's method is slow, but (A) is settled.
        moved = np.abs(new - value)
        slow = moved > 0.1 * before
        with np.errstate(invalid="ignore"):
            settled = np.abs(slope * step) <= 1e-15 * rho * height
        done |= slow & ((moved <= 1e-8 * span) | settled)
        good[rows] = done & reached & (rho <= first)
        value, before = new, moved
        if done.any():
            stay = np.flatnonzero(~done)
            before = before[stay]
            rows, value, first = rows[stay], value[stay], first[stay]
            low, high, near = low[stay], high[stay], near.take(stay)
    return parameter, radius, good


def _bracketed(sites: Sites, near: _Near) -> tuple[FloatArray, FloatArray]:
    low, high = sites.low[near.target], sites.high[near.target]
    grid = low[:, None] + (high - low)[:, None] * _GRID
    grid[:, -1] = high
    count, width = grid.shape
    repeated, flat = near.take(np.repeat(np.arange(count), width)), grid.ravel()
    point = evaluate_rational(repeated.table, flat, 0)[0]
    rho = _disk(*_chords(sites, repeated, flat, point)).reshape(count, width)
    best = np.argmin(rho, axis=1)
    rows = np.arange(count)
    left = grid[rows, np.maximum(best - 1, 0)]
    right = grid[rows, np.minimum(best + 1, width - 1)]
    sample, sampled = grid[rows, best], rho[rows, best]
    parameter = sample.copy()
    before = np.full(count, np.inf)
    active = np.flatnonzero(np.isfinite(sampled))
    for _ in range(60):
        if not len(active):
            break
        value = parameter[active]
        slope, curve, current, height = _stationarity(sites, near.take(active), value)
        # Where no disk exists the minimum lies towards the best sample.
        reached = np.isfinite(current)
        rising = np.where(reached, slope > 0, value > sample[active])
        right[active] = np.where(rising, value, right[active])
        left[active] = np.where(rising, left[active], value)
        with np.errstate(divide="ignore", invalid="ignore"):
            new = value - slope / curve
        inside = (new > left[active]) & (new < right[active]) & (curve > 0) & reached
        new = np.where(inside, new, 0.5 * (left[active] + right[active]))
        moved = np.abs(new - value)
        with np.errstate(invalid="ignore"):
            settled = np.abs(slope * (new - value)) <= 1e-15 * current * height
        done = (moved <= 1e-13 * (high - low)[active]) | (settled & (moved > 0.1 * before[active]))
        parameter[active], before[active] = new, moved
        active = active[~done]
    point = evaluate_rational(near.table, parameter, 0)[0]
    final = _disk(*_chords(sites, near, parameter, point))
    # Radii are flat about the contact: a sample that is lower by rounding is not nearer to it.
    worse = ~(final <= sampled * (1 + 1e-10))
    return np.where(worse, sample, parameter), np.where(worse, sampled, final)
