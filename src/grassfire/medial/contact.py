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

    def chords(self) -> _Chords:
        """What closed forms need of all rows."""
        tangents = self.tangents
        return _Chords(
            tangents.position, tangents.normal, self.target, self.adjacent, self.end,
            self.relative, self.rise,
        )  # fmt: skip

    def approach(self) -> Approach:
        """All rows, whose targets are spirals."""
        tangents = self.tangents
        return Approach(
            tangents.position, tangents.normal, tangents.parameter, self.target, self.same,
            self.adjacent, self.end, self.relative, self.rise, self.sine,
        )  # fmt: skip


@dataclass(frozen=True)
class _Chords(Columns):
    """The same for targets with closed forms."""

    position: FloatArray
    normal: FloatArray
    target: IntArray
    adjacent: BoolArray
    end: FloatArray
    relative: FloatArray
    rise: FloatArray


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
    if not sites.curved:
        parameter, radius = _closed(sites, _straight(sites, tangents, target))
    elif sites.all_spirals:
        near = _near(sites, tangents, target)
        parameter, radius = spiral_contact(sites, near.approach(), hint)
    else:
        parameter, radius = _mixed(sites, _near(sites, tangents, target), hint)
    # The point itself, met as the end of a neighbouring site, is no second contact.
    rows = (radius < 1e-6 * sites.size).nonzero()[0]
    if len(rows):
        site, at = target.take(rows), parameter.take(rows)
        end = (at <= sites.low.take(site)) | (at >= sites.high.take(site))
        end |= sites.kind.take(site) == SiteKind.POINT
        chord = sites.point(site, at) - tangents.position.take(rows, axis=0)
        same = end & (np.hypot(chord[:, 0], chord[:, 1]) <= 1e-12 * sites.size)
        radius[rows[same]] = np.inf
    return parameter, radius


def _mixed(sites: Sites, near: _Near, hint: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Contacts and radii where some of the targets may be spirals."""
    spiral = sites.kind.take(near.target) == SiteKind.SPIRAL
    rows = spiral.nonzero()[0]
    if not len(rows):
        return _closed(sites, near.chords())
    parameter, radius = np.empty(len(spiral)), np.empty(len(spiral))
    part = near.take(rows)
    at, reach = spiral_contact(sites, part.approach(), hint.take(rows))
    _leave_corners(sites, part.target, at, reach)
    parameter[rows], radius[rows] = at, reach
    rows = (~spiral).nonzero()[0]
    if len(rows):
        parameter[rows], radius[rows] = _closed(sites, near.chords().take(rows))
    return parameter, radius


def _closed(sites: Sites, chords: _Chords) -> tuple[FloatArray, FloatArray]:
    """Contacts and radii in closed form, the targets of each kind at once."""
    kind = sites.kind.take(chords.target)
    parameter, radius = np.empty(len(kind)), np.empty(len(kind))
    for value, method in (
        (SiteKind.LINE, _line),
        (SiteKind.ARC, _arc),
        (SiteKind.POINT, _point),
    ):
        rows = (kind == value).nonzero()[0]
        if len(rows) == len(kind):
            parameter, radius = method(sites, chords)
        elif len(rows):
            parameter[rows], radius[rows] = method(sites, chords.take(rows))
    _leave_corners(sites, chords.target, parameter, radius)
    return parameter, radius


def _leave_corners(
    sites: Sites, target: IntArray, parameter: FloatArray, radius: FloatArray
) -> None:
    """The end of a site at a reflex corner is the corner's to touch. In place."""
    _, _, before, after = sites.ends
    corner = (parameter <= sites.low.take(target)) & before.take(target)
    corner |= (parameter >= sites.high.take(target)) & after.take(target)
    rows = corner.nonzero()[0]
    radius[rows[sites.kind.take(target.take(rows)) != SiteKind.POINT]] = np.inf


def _straight(sites: Sites, tangents: Tangents, target: IntArray) -> _Chords:
    """Chords of polygons: lines that meet do so at their ends."""
    own, count = tangents.site, len(target)
    forward, backward = target == sites.following.take(own), target == sites.preceding.take(own)
    relative, zero, adjacent = np.zeros((count, 2)), np.zeros(count), forward | backward
    rows = adjacent.nonzero()[0]
    if len(rows):
        at = tangents.parameter.take(rows)
        # Two lines that are a whole loop meet twice: the nearer end counts.
        ahead = forward.take(rows) & (~backward.take(rows) | (at >= 0.5))
        away = at - np.where(ahead, 1.0, 0.0)
        relative[rows] = away[:, None] * sites.direction.take(own.take(rows), axis=0)
    return _Chords(tangents.position, tangents.normal, target, adjacent, zero, relative, zero)


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


def _line(sites: Sites, chords: _Chords) -> tuple[FloatArray, FloatArray]:
    position, normal, target = chords.position, chords.normal, chords.target
    start, inward = sites.anchor.take(target, axis=0), sites.inward.take(target, axis=0)
    offset, meeting = position - start, chords.adjacent.nonzero()[0]
    offset[meeting] = chords.relative.take(meeting, axis=0)
    height = _above_noise(sites, chords, dot(inward, offset))
    cosine = dot(normal, inward)
    sine = normal[:, 0] * inward[:, 1] - normal[:, 1] * inward[:, 0]
    # 1 - cos loses all digits for nearly parallel lines; sin^2 / (1 + cos) does not.
    slack = np.where(cosine > 0, sine**2 / (1 + np.maximum(cosine, 0)), 1 - cosine)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        radius = np.where((height >= 0) & (slack > 1e-30), height / slack, np.inf)
    finite = np.isfinite(radius)
    centre = position + np.where(finite, radius, 0.0)[:, None] * normal
    along = dot(centre - start, sites.direction.take(target, axis=0))
    parameter = np.where(finite, along / sites.length.take(target) ** 2, np.nan)
    return _clip(sites, chords, parameter, radius)


def _arc(sites: Sites, chords: _Chords) -> tuple[FloatArray, FloatArray]:
    position, normal, target = chords.position, chords.normal, chords.target
    rim = sites.radius[target]
    start, sweep = sites.extent[target].T
    sign = np.sign(sweep)
    offset = position - sites.anchor[target]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    angle = start + chords.end * sweep
    spoke = rim[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    beside = -dot(2 * spoke + chords.relative, chords.relative)
    gap = _above_noise(sites, chords, rim - distance)
    gap = np.where((gap * sign < 0) & (np.abs(gap) <= 1e-12 * sites.size), 0.0, gap)
    numerator = np.where(chords.adjacent, beside, gap * (rim + distance))
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
    return _clip(sites, chords, parameter, radius)


def _point(sites: Sites, chords: _Chords) -> tuple[FloatArray, FloatArray]:
    position, normal, target = chords.position, chords.normal, chords.target
    anchor, meeting = sites.anchor.take(target, axis=0), chords.adjacent.nonzero()[0]
    chord = anchor - position
    chord[meeting] = -chords.relative.take(meeting, axis=0)
    height = dot(chord, normal)
    height[meeting] = chords.rise.take(meeting)
    radius = _disk(chord, height)
    finite = np.isfinite(radius)
    direction = position + np.where(finite, radius, 0.0)[:, None] * normal - anchor
    start, turn = sites.extent.take(target, axis=0).T
    angle = np.arctan2(direction[:, 1], direction[:, 0])
    parameter = np.minimum(np.maximum(share_of_turn(angle, start, turn), 0.0), 1.0)
    return np.where(finite, parameter, np.nan), radius


def _disk(chord: FloatArray, height: FloatArray) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        radius = dot(chord, chord) / (2 * height)
    return np.where((height > 0) & np.isfinite(radius), radius, np.inf)


def _above_noise(sites: Sites, chords: _Chords, height: FloatArray) -> FloatArray:
    """Heights that are rounding only are none, unless the sites meet and they are exact."""
    noise = ~chords.adjacent & (np.abs(height) <= 4e-15 * sites.size)
    return np.where(noise, 0.0, height)


def _clip(
    sites: Sites, chords: _Chords, parameter: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Replace contacts beyond an end of the site by the better of its two ends."""
    low, high = sites.low.take(chords.target), sites.high.take(chords.target)
    rows = (~((parameter >= low) & (parameter <= high))).nonzero()[0]
    if len(rows):
        position, normal = chords.position.take(rows, axis=0), chords.normal.take(rows, axis=0)
        target, low, high = chords.target.take(rows), low.take(rows), high.take(rows)
        first, last = (
            disk_through(sites.point(target, end) - position, normal) for end in (low, high)
        )
        parameter[rows] = np.where(first <= last, low, high)
        radius[rows] = np.where(first <= last, first, last)
    return parameter, radius
