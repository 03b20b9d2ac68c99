"""Disks tangent to three sites at once, by Newton's method on all candidates together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grassfire.medial.sites import BoolArray, FloatArray, IntArray, SiteKind, Sites, dot


@dataclass(frozen=True)
class TripleDisks:
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

    One step projects the centre on the sites and solves d_k + g_k . dc = r + dr for the move of the
    centre, where d_k are the signed distances and g_k their gradients. Since distances are
    stationary in the contacts, the convergence is quadratic in all unknowns together.

    Parameters
    ----------
    triple : (n, 3) int array
        Sites.
    centre : (n, 2) float array
    radius : (n,) float array
    parameter : (n, 3) float array
        Guesses; parameters matter for spirals only.
    """
    count = len(triple)
    centre, radius, parameter = centre.copy(), radius.copy(), parameter.copy()
    flat, determinant = triple.ravel(), np.zeros(count)
    rows, good = np.arange(count), np.zeros(count, dtype=bool)
    # A good start needs 5 steps; strays are given up.
    for _ in range(16):
        if not len(rows):
            break
        part = _Feet(sites, triple[rows].ravel(), parameter[rows].ravel().copy())
        away, gradient = part.distances(np.repeat(centre[rows], 3, axis=0))
        away, gradient = away.reshape(-1, 3), gradient.reshape(-1, 3, 2)
        shift, jump, determinant[rows] = _solve(gradient, away)
        reach = np.hypot(shift[:, 0], shift[:, 1])
        usable = np.isfinite(reach) & np.isfinite(jump) & (reach < 2 * sites.size)
        done = reach <= 2e-15 * sites.size + 1e-14 * np.abs(jump)
        parameter[rows] = part.parameter.reshape(-1, 3)
        centre[rows[usable]] += shift[usable]
        radius[rows[usable]] = jump[usable]
        good[rows] = done & usable
        settled = reach <= 1e-9 * sites.size
        # Where rounding keeps the steps alive the last ones are as good as any.
        good[rows] |= settled & usable
        rows = rows[usable & ~done]
    low, high = sites.low[flat].reshape(-1, 3), sites.high[flat].reshape(-1, 3)
    margin = 1e-11 * (high - low)
    held = np.all((parameter >= low - margin) & (parameter <= high + margin), axis=1)
    good &= radius > 0
    return TripleDisks(
        centre, radius, np.clip(parameter, low, high), good, good & held, determinant
    )


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
    feet = _Feet(sites, triple.ravel(), np.full(triple.size, 0.5))
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
    """Contacts under iteration: `parameter` is updated by `distances`."""

    sites: Sites
    site: IntArray
    parameter: FloatArray

    def distances(self, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Signed distances (n,) of the centres to the sites, carried on beyond their ends, and
        the gradients (n, 2)."""
        sites, site = self.sites, self.site
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
        rows = np.flatnonzero(kind == SiteKind.SPIRAL)
        if len(rows):
            away[rows], gradient[rows] = self._spiral(rows, centre[rows])
        return away, gradient

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
        delta = np.remainder(angle - (start + sweep / 2) + np.pi, 2 * np.pi) - np.pi
        self.parameter[rows] = 0.5 + delta / sweep
        outward = offset / np.maximum(distance, 1e-300)[:, None]
        return sign * (self.sites.radius[site] - distance), -sign[:, None] * outward

    def _point(self, rows: IntArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
        site = self.site[rows]
        offset = centre - self.sites.anchor[site]
        start, turn = self.sites.extent[site].T
        distance = np.hypot(offset[:, 0], offset[:, 1])
        angle = np.arctan2(offset[:, 1], offset[:, 0])
        delta = np.remainder(angle - (start + turn / 2) + np.pi, 2 * np.pi) - np.pi
        self.parameter[rows] = 0.5 + delta / turn
        return distance, offset / np.maximum(distance, 1e-300)[:, None]

    def _spiral(self, rows: IntArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
        site = self.site[rows]
        low, high = self.sites.low[site], self.sites.high[site]
        margin = 0.05 * (high - low)
        point, first, second = self.sites.derivatives(site, self.parameter[rows], 2)
        offset = point - centre
        slope, flat = dot(offset, first), dot(first, first)
        curve = flat + dot(offset, second)
        curve = np.where(curve > 1e-6 * flat, curve, flat)
        new = self.parameter[rows] - slope / curve
        self.parameter[rows] = np.clip(new, low - margin, high + margin)
        point, first = self.sites.derivatives(site, self.parameter[rows], 1)
        speed = np.hypot(first[:, 0], first[:, 1])
        normal = np.stack([-first[:, 1], first[:, 0]], axis=1) / speed[:, None]
        return dot(centre - point, normal), normal


def _solve(gradient: FloatArray, away: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Move of the centre (n, 2), new radius (n,), determinant of g_k . dc - r = -d_k, k = 1 2 3."""
    one, two = gradient[:, 1] - gradient[:, 0], gradient[:, 2] - gradient[:, 0]
    b1, b2 = away[:, 0] - away[:, 1], away[:, 0] - away[:, 2]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        determinant = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
        x = (b1 * two[:, 1] - b2 * one[:, 1]) / determinant
        y = (one[:, 0] * b2 - two[:, 0] * b1) / determinant
        step = np.stack([x, y], axis=1)
        return step, away[:, 0] + np.einsum("ij,ij->i", gradient[:, 0], step), determinant
