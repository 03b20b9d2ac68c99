"""Disks tangent to three lines and points: closed forms, then Newton steps for their rounding.

A disk is a point X = (x, y, r) of space. Tangent to a line are those of the plane m . x - r = h, m
being its inward normal; those through two points lie on the plane across the middle of both. Two
such planes meet in a line X0 + t d, and on the cone |x - q| = r of a point q this leaves a
quadratic in t.
"""

from __future__ import annotations

import numpy as np

from grassfire.medial.sites import (
    BoolArray,
    FloatArray,
    IntArray,
    SiteKind,
    Sites,
    share_of_turn,
)

_STEPS = 6
"""Most Newton steps; two do unless the disk is ill-determined."""


class PlainTriples:
    """Triples of lines and points; columns are (3, n), of places and directions (2, 3, n).

    Parameters
    ----------
    sites : Sites
    triple : (n, 3) int array
    """

    def __init__(self, sites: Sites, triple: IntArray) -> None:
        self.size = sites.size
        self.triple = np.ascontiguousarray(triple.T)
        self.point = (sites.kind == SiteKind.POINT).take(self.triple)
        self.anchor = sites.anchor.T.take(self.triple, axis=1)
        self.extent = sites.extent.T.take(self.triple, axis=1)
        length = np.hypot(self.extent[0], self.extent[1])
        scale = np.where(self.point, 0.0, 1.0) / length
        self.normal = np.stack([-self.extent[1] * scale, self.extent[0] * scale])
        self.square = length * length

    def distances(self, rows: IntArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Signed distances (3, k) of the centres (2, k) to the sites, carried on beyond their ends,
        and their gradients (2, 3, k)."""
        whole = len(rows) == self.point.shape[1]
        anchor = self.anchor if whole else self.anchor.take(rows, axis=2)
        gradient = self.normal if whole else self.normal.take(rows, axis=2)
        offset = centre[:, None] - anchor
        away = offset[0] * gradient[0] + offset[1] * gradient[1]
        point = self.point if whole else self.point.take(rows, axis=1)
        if not point.any():
            return away, gradient
        reach = np.hypot(offset[0], offset[1])
        away = np.where(point, reach, away)
        gradient = np.where(point, offset / np.maximum(reach, 1e-300), gradient)
        return away, gradient

    def parameters(self, rows: IntArray, centre: FloatArray) -> FloatArray:
        """(3, k) parameters of the contacts, carried on beyond the ends of the sites."""
        offset = centre[:, None] - self.anchor.take(rows, axis=2)
        extent = self.extent.take(rows, axis=2)
        with np.errstate(invalid="ignore"):
            along = offset[0] * extent[0] + offset[1] * extent[1]
        along /= self.square.take(rows, axis=1)
        flat = self.point.take(rows, axis=1).ravel().nonzero()[0]
        start, turn = extent[0].ravel().take(flat), extent[1].ravel().take(flat)
        x, y = offset[0].ravel().take(flat), offset[1].ravel().take(flat)
        along.ravel()[flat] = share_of_turn(np.arctan2(y, x), start, turn)
        return np.asarray(along)

    def closed(self, centre: FloatArray) -> FloatArray:
        """Centres (2, n): with a point among the sites those of tangent disks, else as they are.

        Of the two solutions the one whose contacts lie on the sites, or the one nearer by.
        """
        centre = centre.copy()
        rows = self.point.any(axis=0).nonzero()[0]
        if not len(rows):
            return centre
        both = self._solutions(rows)
        nearest = centre.take(rows, axis=1)
        fit = np.empty((2, len(rows)))
        for number, disk in enumerate(both):
            contact = self.parameters(rows, disk[:2])
            on = np.all((contact > -1e-9) & (contact < 1 + 1e-9), axis=0) & (disk[2] > 0)
            fit[number] = np.hypot(disk[0] - nearest[0], disk[1] - nearest[1])
            fit[number, ~on] += 4 * self.size
        fit = np.where(np.isnan(fit), np.inf, fit)
        best = np.where(fit[0] <= fit[1], both[0, :2], both[1, :2])
        good = np.isfinite(fit.min(axis=0)).nonzero()[0]
        centre[:, rows[good]] = best[:, good]
        return centre

    def _solutions(self, rows: IntArray) -> FloatArray:
        """(2, 3, k) both disks (x, y, r) of the closed form; NaN or infinite where there is none.

        A point is the origin and the apex of the cone.
        """
        last = self.point.take(rows, axis=1).argmax(axis=0)
        width = self.point.shape[1]
        apex = self.anchor.reshape(2, -1).take(last * width + rows, axis=1)
        (one, high), (two, low) = (
            self._plane((last + step) % 3 * width + rows, apex) for step in (1, 2)
        )
        line = _cross(one, two)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            foot = (high * _cross(two, line) + low * _cross(line, one)) / (line * line).sum(axis=0)
            a, b, c = _cone(line, line), _cone(foot, line), _cone(foot, foot)
            root = -(b + np.copysign(np.sqrt(np.maximum(b * b - a * c, 0.0)), b))
            result = np.stack([foot + root / a * line, foot + c / root * line])
        result[:, :2] += apex
        return result

    def _plane(self, place: IntArray, apex: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unit normal (3, k) and height (k,) of the planes of disks tangent to the sites in `place`
        (k,) of the flat columns, or to points and the apex (2, k), which is the origin."""
        away = self.anchor.reshape(2, -1).take(place, axis=1) - apex
        point = self.point.ravel().take(place)
        reach = np.hypot(away[0], away[1])
        normal = self.normal.reshape(2, -1).take(place, axis=1)
        normal = np.where(point, away / np.maximum(reach, 1e-300), normal)
        height = np.where(point, 0.5 * reach, normal[0] * away[0] + normal[1] * away[1])
        return np.stack([*normal, np.where(point, 0.0, -1.0)]), height


def plain_disks(
    sites: Sites, triple: IntArray, centre: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray, FloatArray]:
    """Disks tangent to triples of lines and points, from guesses.

    Returns
    -------
    centre : (n, 2) float array
    radius : (n,) float array
    parameter : (n, 3) float array
        Of the contacts, carried on beyond the ends of the sites.
    settled : (n,) bool array
        Whether there is one.
    determinant : (n,) float array
        Twice the area of the triangle of the three unit normals.
    """
    every = PlainTriples(sites, triple)
    count = len(triple)
    place, radius = every.closed(np.ascontiguousarray(centre.T)), radius.copy()
    settled, determinant = np.zeros(count, dtype=bool), np.zeros(count)
    rows, least = np.arange(count), np.full(count, np.inf)
    for _ in range(_STEPS):
        if not len(rows):
            break
        away, gradient = every.distances(rows, place[:, rows])
        shift, jump, determinant[rows] = newton_step(gradient, away)
        reach = np.hypot(shift[0], shift[1])
        usable = np.isfinite(reach) & np.isfinite(jump) & (reach < 2 * sites.size)
        kept = usable.nonzero()[0]
        chosen = rows[kept]
        place[:, chosen] += shift[:, kept]
        radius[chosen] = jump[kept]
        # Where rounding keeps the steps alive the last ones are as good as any.
        settled[rows] = usable & (reach <= 1e-9 * sites.size)
        done = reach <= 2e-15 * sites.size + 1e-14 * np.abs(jump)
        done |= (reach >= 0.5 * least[rows]) & (reach <= 1e-11 * sites.size)
        least[rows] = reach
        rows = rows[(usable & ~done).nonzero()[0]]
    parameter = every.parameters(np.arange(count), place)
    return place.T, radius, parameter.T, settled & (radius > 0), determinant


def newton_step(
    gradient: FloatArray, away: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Move of the centre (2, n), new radius (n,), determinant of g_k . dc - r = -d_k, k = 1 2 3."""
    one, two = gradient[:, 1] - gradient[:, 0], gradient[:, 2] - gradient[:, 0]
    b1, b2 = away[0] - away[1], away[0] - away[2]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        determinant = one[0] * two[1] - one[1] * two[0]
        step = np.stack([b1 * two[1] - b2 * one[1], one[0] * b2 - two[0] * b1]) / determinant
        radius = away[0] + gradient[0, 0] * step[0] + gradient[1, 0] * step[1]
    return step, radius, determinant


def _cross(one: FloatArray, two: FloatArray) -> FloatArray:
    """(3, n) vector products."""
    return np.stack(
        [
            one[1] * two[2] - one[2] * two[1],
            one[2] * two[0] - one[0] * two[2],
            one[0] * two[1] - one[1] * two[0],
        ]
    )


def _cone(one: FloatArray, two: FloatArray) -> FloatArray:
    """(n,) values of the form that vanishes on the cone x^2 + y^2 = r^2."""
    return np.asarray(one[0] * two[0] + one[1] * two[1] - one[2] * two[2])
