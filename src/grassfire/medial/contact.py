"""Contacts: the smallest disk that is tangent at one boundary point and reaches another site.

Minimises (A), r = |q - p|^2 / (2 n.(q - p)), over the closed site. Lines, arcs and points have
closed forms, spirals are solved by Newton's method. Near a smooth end or a flat corner both
|q - p|^2 and n.(q - p) are differences of nearly equal numbers; there they are formed from divided
differences of the curves themselves, which do not cancel.
"""

from __future__ import annotations

from dataclasses import dataclass

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
    share_of_turn,
)
from grassfire.medial.spiral_contact import (
    Approach,
    lowered_differences,
    spiral_contact,
    turned_differences,
)


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
    """Tangents against sites: how their chords are formed.

    `same`: both on one Bezier curve. `adjacent`: their curves meet in j, at the parameter `end`
    of the target's; `relative` is p - j, `rise` is n.(j - p), and `sine` n.t of the direction t in
    which the boundary passes j, all without cancellation; NaN where the junction has a kink.
    """

    tangents: Tangents
    target: IntArray
    same: BoolArray
    adjacent: BoolArray
    end: FloatArray
    relative: FloatArray
    rise: FloatArray
    sine: FloatArray

    def approach(self) -> Approach:
        """All rows, whose targets are spirals."""
        tangents = self.tangents
        return Approach(
            tangents.position, tangents.normal, tangents.parameter, self.target, self.same,
            self.adjacent, self.end, self.relative, self.rise, self.sine,
        )  # fmt: skip


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
    near = _near(sites, tangents, target)
    if sites.all_spirals:
        parameter, radius = spiral_contact(sites, near.approach(), hint)
    else:
        parameter, radius = _by_kind(sites, near, hint)
    # The point itself, met as the end of a neighbouring site, is no second contact.
    rows = (radius < 1e-6 * sites.size).nonzero()[0]
    if len(rows):
        site, at = target[rows], parameter[rows]
        end = (at <= sites.low[site]) | (at >= sites.high[site])
        end |= sites.kind[site] == SiteKind.POINT
        chord = sites.point(site, at) - tangents.position[rows]
        same = end & (np.hypot(chord[:, 0], chord[:, 1]) <= 1e-12 * sites.size)
        radius[rows[same]] = np.inf
    return parameter, radius


def _by_kind(sites: Sites, near: _Near, hint: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Contacts and radii, the targets of each kind at once."""
    target = near.target
    kind = sites.kind[target]
    parameter, radius = np.full(len(target), np.nan), np.full(len(target), np.inf)
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
        part = near.take(rows).approach()
        parameter[rows], radius[rows] = spiral_contact(sites, part, hint[rows])
    # The end of a site at a reflex corner is the corner's to touch.
    low, high = parameter <= sites.low[target], parameter >= sites.high[target]
    point = sites.kind == SiteKind.POINT
    corner = (low & point[sites.preceding[target]]) | (high & point[sites.following[target]])
    radius[corner & ~point[target]] = np.inf
    return parameter, radius


def _near(sites: Sites, tangents: Tangents, target: IntArray) -> _Near:
    own, u = tangents.site, tangents.parameter
    # Curves that meet do so however they were cut: beyond a sliver chords would cancel, too.
    runs = sites.runs
    other = runs.number.take(target)
    forward, backward = other == runs.after.take(own), other == runs.before.take(own)
    curve = sites.bezier.take(own)
    same = (curve == sites.bezier.take(target)) & (curve >= 0)
    count = len(own)
    relative, rise, sine, far = np.zeros((count, 2)), *np.zeros((3, count))
    adjacent = (forward | backward) & ~same
    rows = adjacent.nonzero()[0]
    if len(rows):
        site, at = own.take(rows), u.take(rows)
        low, high = runs.low.take(site), runs.high.take(site)
        # Two curves that are a whole loop meet twice: the nearer end counts.
        ahead = forward.take(rows) & (~backward.take(rows) | (high - at <= at - low))
        end = np.where(ahead, high, low)
        relative[rows], rise[rows], lean = _from_end(sites, tangents.take(rows), end)
        smooth = np.where(ahead, runs.smooth_after.take(site), runs.smooth_before.take(site))
        sine[rows] = np.where(smooth, lean, np.nan)
        facing = target.take(rows)
        far[rows] = np.where(ahead, runs.low.take(facing), runs.high.take(facing))
    return _Near(tangents, target, same, adjacent, far, relative, rise, sine)


def _from_end(
    sites: Sites, tangents: Tangents, end: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """p - j, n.(j - p) and n.t for the point j at `end` of the point's own curve, t its direction.

    NaN for the last at points of rational curves and in fans.
    """
    own, u = tangents.site, tangents.parameter
    kind = sites.kind[own]
    relative, rise, sine = np.zeros((len(own), 2)), np.zeros(len(own)), np.full(len(own), np.nan)
    line = (kind == SiteKind.LINE).nonzero()[0]
    if len(line):
        relative[line] = (u - end)[line, None] * sites.extent[own[line]]
        sine[line] = 0.0
    arc = (kind == SiteKind.ARC).nonzero()[0]
    if len(arc):
        start, sweep = sites.extent[own[arc]].T
        half = 0.5 * (u[arc] - end[arc]) * sweep
        middle = start + 0.5 * (u[arc] + end[arc]) * sweep
        chord = 2 * sites.radius[own[arc]] * np.sin(half)
        relative[arc] = chord[:, None] * np.stack([-np.sin(middle), np.cos(middle)], axis=1)
        rise[arc] = np.sign(sweep) * 2 * sites.radius[own[arc]] * np.sin(half) ** 2
        sine[arc] = -np.sin(2 * half)
    spiral = (kind == SiteKind.SPIRAL).nonzero()[0]
    if len(spiral):
        far, place = end[spiral], u[spiral]
        step = far - place
        row, normal = sites.bezier[own[spiral]], tangents.normal[spiral]
        if sites.all_polynomial:
            curve = sites.polynomial.take(row, axis=2)
            one, two, bend, direction = turned_differences(curve, place - 0.5, step)
            speed = np.hypot(direction[:, 0], direction[:, 1])
            sine[spiral] = step * dot(normal, bend) / speed
        else:
            table = sites.coefficients[row]
            one, two = lowered_differences(table, place, far, tangents.position[spiral])
        relative[spiral] = -step[:, None] * one
        rise[spiral] = step**2 * dot(normal, two)
    return relative, rise, sine


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
    with np.errstate(divide="ignore", invalid="ignore"):
        # n.o + s R for nearly parallel contacts: 1 - cos by the sine, as for lines.
        cosine = -sign * dot(normal, offset) / distance
        sine = (normal[:, 0] * offset[:, 1] - normal[:, 1] * offset[:, 0]) / distance
        slack = np.where(cosine > 0, sine**2 / (1 + np.maximum(cosine, 0)), 1 - cosine)
        height = numerator / (rim + distance) + distance * slack
        # About the centre of the arc there is no direction, and nothing cancels.
        height = np.where(distance > 0.1 * rim, height, sign * dot(normal, offset) + rim)
        radius = numerator / (2 * sign * height)
    # Walls that touch leave a disk of no radius, which is a contact.
    valid = np.isfinite(radius) & (radius >= 0) & (numerator * sign >= 0)
    radius = np.where(valid, radius, np.inf)
    towards = offset + np.where(valid, radius, 0.0)[:, None] * normal
    angle = np.arctan2(towards[:, 1], towards[:, 0])
    parameter = np.where(valid, share_of_turn(angle, start, sweep), np.nan)
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
    parameter = np.clip(share_of_turn(angle, start, turn), 0.0, 1.0)
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
