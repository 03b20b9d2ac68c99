"""The boundary recovered from the Bezier form of the medial axis transform (Dorado 2009, eq. 1).

Eq. (1) puts the centre of the maximal disk at m = c + r n, so that c = m - r n. Along a piece of
the axis n is known from the piece alone: both feet of a disk see its centre move alike,
r' = m' . n, which leaves two unit vectors,

    n = (r' m' +- sqrt(|m'|^2 - r'^2) J m') / |m'|^2,    J a quarter turn to the left.

The upper sign is the foot on the right of the piece, the lower one that on its left: the two
branches of the envelope of the disks. A recovered point lies on its disk whatever the error of the
derivatives; an error of direction moves it along the disk, hence away from the boundary by its
square only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry.chebyshev import bernstein_among, bernstein_family
from grassfire.medial.edges import Fit
from grassfire.medial.sites import FloatArray, IntArray

if TYPE_CHECKING:
    from grassfire.medial.axis import MedialAxis

_STILL = 1e-7
"""Share of its largest speed below which a piece stands still, as it does at smooth ends."""


def recover_boundary(
    axis: MedialAxis, samples_per_edge: int = 17
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Points of the boundary, from the polynomial edges alone.

    Uses eq. (1) of Dorado 2009 with the normals that the edges themselves imply (see the module).

    Parameters
    ----------
    axis : MedialAxis
    samples_per_edge : int
        Points per edge and side, at equal steps of the fraction from 0 to 1; at least 2.

    Returns
    -------
    edge : (k,) int array
        Index into `axis.edges`.
    fraction : (k,) float array
        Parameter on the edge, 0 to 1.
    left, right : (k, 2) float arrays
        Feet of the disk on either side of the edge, mm. They lie on the disk, and where the feet
        are well apart within a few tol of the boundary. What the derivatives are off by moves them
        along the disk, the more the closer the feet are: by the order of r sqrt(tol / l) on a
        piece of length l next to a smooth end, where the disk clings to the boundary, and in front
        of two corners that are close together, where it does not.

    Raises
    ------
    GeometryError
        Fewer than 2 samples.
    """
    if samples_per_edge < 2:
        raise GeometryError("an edge is recovered from at least 2 samples")
    kept = np.flatnonzero(~axis.pruned)
    fraction = np.linspace(0.0, 1.0, samples_per_edge)
    row = np.repeat(kept, samples_per_edge)
    place = np.tile(fraction, len(kept))
    disks, first, second = jets(axis.fit, row, place, fraction)
    left, right = envelope(disks, first, second, place)
    edge = np.repeat(np.arange(len(kept)), samples_per_edge)
    return edge, place, left + axis.sites.origin, right + axis.sites.origin


def jets(
    fit: Fit,
    row: IntArray,
    fraction: FloatArray,
    among: FloatArray | None = None,
    orders: int = 2,
) -> list[FloatArray]:
    """Disks (x, y, r) of pieces `row` (n,) at `fraction` (n,), and derivatives, (n, 3) each.

    Fractions that are `among` few, given in order, take less time.
    """
    result = [np.zeros((len(row), 3)) for _ in range(orders + 1)]
    degrees = fit.degree[row]
    for degree in np.bincount(degrees).nonzero()[0]:
        members = np.flatnonzero(degrees == degree)
        table = fit.control[fit.offset[row[members], None] + np.arange(degree + 1)]
        place = fraction[members]
        if among is None:
            family = bernstein_family(int(degree), place, orders)
        else:
            family = bernstein_among(int(degree), place, orders, among)
        for order, (values, basis) in enumerate(zip(result, family, strict=True)):
            if order:
                table = (degree + 1 - order) * np.diff(table, axis=1)
            if table.shape[1]:
                values[members] = np.einsum("ij,ijk->ik", basis, table)
    return result


def envelope(
    disks: FloatArray, first: FloatArray, second: FloatArray, fraction: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Left and right feet (n, 2) of disks (n, 3) with their derivatives by the fraction (n,).

    Where the centre stands still the derivatives of the next order take over: the limit of (1).
    """
    speed = np.hypot(first[:, 0], first[:, 1])
    bend = np.hypot(second[:, 0], second[:, 1])
    # Short of the end of a smooth branch m' runs against m''.
    limit = second * np.where(fraction > 0.5, -1.0, 1.0)[:, None]
    # At an end r cannot grow faster than the centre moves: if it does, both are rounding.
    noise = ((fraction <= 0) | (fraction >= 1)) & (np.abs(first[:, 2]) > speed)
    noise &= speed <= 1e-5 * bend
    first = np.where((noise | (speed <= _STILL * bend))[:, None], limit, first)
    slope, growth = first[:, :2], first[:, 2]
    square = np.einsum("ij,ij->i", slope, slope)
    safe = np.where(square > 0, square, 1.0)
    root = np.sqrt(np.maximum(safe - growth**2, 0.0))
    # Where rounding makes r grow faster than the centre moves, both feet are one.
    growth = np.clip(growth, -np.sqrt(safe), np.sqrt(safe))
    across = np.stack([-slope[:, 1], slope[:, 0]], axis=1)
    along = growth[:, None] * slope
    reach = (disks[:, 2] / safe)[:, None]
    left = disks[:, :2] - reach * (along - root[:, None] * across)
    right = disks[:, :2] - reach * (along + root[:, None] * across)
    return left, right
