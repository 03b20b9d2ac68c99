"""Disks tangent to three sites at once, by Newton's method on all candidates together."""

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
    dot,
    polynomial,
    share_of_turn,
)
from grassfire.medial.tritangent import newton_step, plain_disks

_STEPS = 16
"""Most steps; a good start needs 5."""

_SURE_STEPS = 6
"""Steps after which those that do not halve are given up."""


@dataclass(frozen=True)
class TripleDisks(Columns):
    """Disks tangent to three sites each: centre (n, 2), radius (n,), parameters (n, 3).

    `settled` tells where the iteration found a disk of positive radius, `good` where its three
    contacts lie on their sites too; `determinant` (n,) how well they determine it: twice the area
    of the triangle of the three unit normals.
    """

    centre: FloatArray
    radius: FloatArray
    parameter: FloatArray
    settled: BoolArray
    good: BoolArray
    determinant: FloatArray

    def put(self, rows: IntArray, other: TripleDisks) -> None:
        """Overwrite rows."""
        self.centre[rows], self.radius[rows] = other.centre, other.radius
        self.parameter[rows], self.good[rows] = other.parameter, other.good
        self.settled[rows], self.determinant[rows] = other.settled, other.determinant


def triple_disks(
    sites: Sites, triple: IntArray, centre: FloatArray, radius: FloatArray, parameter: FloatArray
) -> TripleDisks:
    """Disks tangent to three sites, from a guess.

    One step solves d_k + g_k . dc = r + dr for the move of the centre, where d_k are the signed
    distances and g_k their gradients: to lines, arcs and points themselves, to spirals from their
    tangents at the last parameters, which then follow the centre. That is Newton's method in all
    unknowns together. Lines and points alone have closed forms (see `tritangent`).

    Parameters
    ----------
    triple : (n, 3) int array
        Sites.
    centre : (n, 2) float array
    radius : (n,) float array
    parameter : (n, 3) float array
        Guesses; parameters matter for spirals only.
    """
    if not sites.curved:
        centre, radius, found, good, determinant = plain_disks(sites, triple, centre, radius)
    else:
        centre, radius, found, good, determinant = _by_newton(
            sites, triple, centre, radius, parameter
        )
    low, high = sites.low.take(triple), sites.high.take(triple)
    margin = 1e-11 * (high - low)
    inside = (found >= low - margin) & (found <= high + margin)
    held = inside[:, 0] & inside[:, 1] & inside[:, 2]
    return TripleDisks(centre, radius, np.clip(found, low, high), good, good & held, determinant)


def _by_newton(
    sites: Sites, triple: IntArray, centre: FloatArray, radius: FloatArray, parameter: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray, FloatArray]:
    """Centres, radii, parameters (n, 3), whether they settled, and determinants."""
    count = len(triple)
    centre, radius = centre.copy(), radius.copy()
    flat, determinant = triple.ravel(), np.zeros(count)
    rows, good = np.arange(count), np.zeros(count, dtype=bool)
    feet = _Feet.of(sites, flat, parameter.ravel())
    found = feet.parameter.copy()
    least = np.full(count, np.inf)
    for number in range(_STEPS):
        if not len(rows):
            break
        away, gradient = feet.distances(np.repeat(centre[rows], 3, axis=0))
        shift, jump, determinant[rows] = newton_step(
            gradient.reshape(-1, 3, 2).transpose(2, 1, 0), away.reshape(-1, 3).T
        )
        shift = shift.T
        reach = np.hypot(shift[:, 0], shift[:, 1])
        usable = np.isfinite(reach) & np.isfinite(jump) & (reach < 2 * sites.size)
        slip = feet.follow(np.repeat(np.where(usable[:, None], shift, 0.0), 3, axis=0))
        slip = slip.reshape(-1, 3).max(axis=1)
        found.reshape(-1, 3)[rows] = feet.parameter.reshape(-1, 3)
        centre[rows[usable]] += shift[usable]
        radius[rows[usable]] = jump[usable]
        done = reach <= 2e-15 * sites.size + 1e-14 * np.abs(jump)
        done &= slip <= 1e-9 * sites.size
        # Where rounding keeps the steps alive the last ones are as good as any.
        settled = (reach <= 1e-9 * sites.size) & (slip <= 1e-6 * sites.size)
        good[rows] = (done | settled) & usable
        moved, before = np.maximum(reach, slip), least[rows]
        stalled = moved >= 0.5 * before
        stalled &= (number >= _SURE_STEPS) | (moved <= 1e-11 * sites.size)
        least[rows] = np.minimum(moved, before)
        stay = (usable & ~done & ~stalled).nonzero()[0]
        if len(stay) < len(rows):
            rows = rows[stay]
            feet = feet.take((3 * stay[:, None] + np.arange(3)).ravel())
    return centre, radius, found.reshape(-1, 3), good & (radius > 0), determinant


@dataclass(frozen=True)
class CommonDisk:
    """One disk for many triples: centre (2,), radius, and (n, 3) parameters and residuals, mm."""

    centre: FloatArray
    radius: float
    parameter: FloatArray
    residual: FloatArray


def common_disk(sites: Sites, triple: IntArray, slack: float) -> CommonDisk | None:
    """The disk tangent, by least squares, to all sites of a run of triples; None without one.

    Parameters
    ----------
    triple : (n, 3) int array
        Lines in boundary order, with their neighbours.
    slack : float
        Largest residual of a sample of the lines, mm.
    """
    few = triple[np.linspace(0, len(triple) - 1, 33).astype(np.int64)[:-1]]
    start = few[[0, 11, 22], 0][None, :]
    guess = triple_disks(
        sites, start, sites.point(start[0], np.full(3, 0.5)).mean(axis=0)[None],
        np.zeros(1), np.full((1, 3), 0.5),
    )  # fmt: skip
    if not (np.isfinite(guess.radius[0]) and guess.radius[0] > 0):
        return None
    centre, radius, residual, _ = _least_squares(sites, few, guess.centre[0])
    if np.abs(residual).max() > slack:
        return None
    centre, radius, residual, parameter = _least_squares(sites, triple, centre)
    return CommonDisk(centre, radius, parameter, residual)


def _least_squares(
    sites: Sites, triple: IntArray, centre: FloatArray
) -> tuple[FloatArray, float, FloatArray, FloatArray]:
    """Centre, radius, residuals (n, 3) and parameters (n, 3) of the disk nearest to all sites."""
    feet = _Feet.of(sites, triple.ravel(), np.full(triple.size, 0.5))
    radius = 0.0
    for _ in range(3):
        away, gradient = feet.distances(np.broadcast_to(centre, (triple.size, 2)))
        matrix = np.concatenate([gradient, -np.ones((len(gradient), 1))], axis=1)
        # Normal equations: three unknowns, each gradient of length one. Sums of very many terms are
        # rounded: what is left after a step makes them smaller for the next.
        step = np.linalg.lstsq(matrix.T @ matrix, matrix.T @ (radius - away), rcond=None)[0]
        centre, radius = centre + step[:2], radius + float(step[2])
    away, _ = feet.distances(np.broadcast_to(centre, (triple.size, 2)))
    return centre, radius, (away - radius).reshape(-1, 3), feet.parameter.reshape(-1, 3)


@dataclass
class _Feet:
    """Contacts under iteration: `parameter` is updated by `distances`, that of spirals by `follow`.

    `curve` (2, degree + 1, s) holds the polynomials of the rows `spiral` (s,), where none of the
    curves is rational; `frame` what `follow` needs of the last evaluation.
    """

    sites: Sites
    site: IntArray
    parameter: FloatArray
    spiral: IntArray
    curve: FloatArray | None
    frame: tuple[FloatArray, FloatArray, FloatArray] | None = None

    @classmethod
    def of(cls, sites: Sites, site: IntArray, parameter: FloatArray) -> _Feet:
        """Feet on sites, at a guess."""
        spiral = (sites.kind[site] == SiteKind.SPIRAL).nonzero()[0]
        curve = None
        if len(spiral) and sites.all_polynomial:
            curve = sites.polynomial.take(sites.bezier[site[spiral]], axis=2)
        return cls(sites, site, parameter.copy(), spiral, curve)

    def take(self, rows: IntArray) -> _Feet:
        """Rows."""
        kept = np.full(len(self.site), -1)
        kept[self.spiral] = np.arange(len(self.spiral))
        place = kept[rows]
        spiral = (place >= 0).nonzero()[0]
        curve = None if self.curve is None else self.curve.take(place[spiral], axis=2)
        return _Feet(self.sites, self.site[rows], self.parameter[rows], spiral, curve)

    def distances(self, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Signed distances (n,) of the centres to the sites, carried on beyond their ends, and
        the gradients (n, 2); for spirals, to the tangents at the parameters."""
        sites, site = self.sites, self.site
        if len(self.spiral) == len(site):
            return self._spiral(centre)
        kind = sites.kind[site]
        away, gradient = np.zeros(len(site)), np.zeros((len(site), 2))
        for value, method in (
            (SiteKind.LINE, self._line),
            (SiteKind.ARC, self._arc),
            (SiteKind.POINT, self._point),
        ):
            rows = np.flatnonzero(kind == value)
            if len(rows):
                away[rows], gradient[rows] = method(rows, centre[rows])
        if len(self.spiral):
            away[self.spiral], gradient[self.spiral] = self._spiral(centre[self.spiral])
        return away, gradient

    def _spiral(self, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
        rows = self.spiral
        if self.curve is None:
            derivatives = self.sites.derivatives(self.site[rows], self.parameter[rows], 2)
        else:
            derivatives = polynomial(self.curve, self.parameter[rows] - 0.5, 2)
        point, first, second = derivatives
        speed = np.hypot(first[:, 0], first[:, 1])
        normal = np.empty_like(first)
        np.divide(first[:, 1], -speed, out=normal[:, 0])
        np.divide(first[:, 0], speed, out=normal[:, 1])
        offset = centre - point
        self.frame = offset, first, second
        return dot(offset, normal), normal

    def follow(self, shift: FloatArray) -> FloatArray:
        """Let the feet on spirals follow their centres, which move by (n, 2); the lengths (n,) by
        which they do."""
        slip = np.zeros(len(self.site))
        if self.frame is None:
            return slip
        offset, first, second = self.frame
        rows = self.spiral
        site = self.site[rows]
        low, high = self.sites.low[site], self.sites.high[site]
        span = high - low
        offset = offset + shift[rows]
        flat = dot(first, first)
        # Beyond the centre of curvature the foot is a maximum, which is as good to Newton's method.
        curve = flat - dot(offset, second)
        curve = np.where(np.abs(curve) > 1e-6 * flat, curve, flat)
        step = np.minimum(np.maximum(dot(offset, first) / curve, -0.25 * span), 0.25 * span)
        before, margin = self.parameter[rows], 0.05 * span
        new = np.minimum(np.maximum(before + step, low - margin), high + margin)
        self.parameter[rows] = new
        slip[rows] = np.abs(new - before) * np.sqrt(flat)
        return slip

    def _line(self, rows: IntArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
        site = self.site[rows]
        direction = self.sites.extent[site]
        offset = centre - self.sites.anchor[site]
        square = dot(direction, direction)
        self.parameter[rows] = dot(offset, direction) / square
        normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1) / np.sqrt(square)[:, None]
        return dot(offset, normal), normal

    def _arc(self, rows: IntArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
        site = self.site[rows]
        offset = centre - self.sites.anchor[site]
        start, sweep = self.sites.extent[site].T
        distance = np.hypot(offset[:, 0], offset[:, 1])
        sign = np.sign(sweep)
        angle = np.arctan2(offset[:, 1], offset[:, 0])
        self.parameter[rows] = share_of_turn(angle, start, sweep)
        outward = offset / np.maximum(distance, 1e-300)[:, None]
        return sign * (self.sites.radius[site] - distance), -sign[:, None] * outward

    def _point(self, rows: IntArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
        site = self.site[rows]
        offset = centre - self.sites.anchor[site]
        start, turn = self.sites.extent[site].T
        distance = np.hypot(offset[:, 0], offset[:, 1])
        angle = np.arctan2(offset[:, 1], offset[:, 0])
        self.parameter[rows] = share_of_turn(angle, start, turn)
        return distance, offset / np.maximum(distance, 1e-300)[:, None]
