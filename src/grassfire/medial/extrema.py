"""Extremal disks: where r is stationary along the axis, the largest disk, and necks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grassfire.geometry.chebyshev import bernstein
from grassfire.geometry.neighbours import connected
from grassfire.medial.sites import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from grassfire.medial.axis import MedialAxis


def critical(axis: MedialAxis) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Interior extrema of r along the pieces: row, fraction, (k, 3) disk, sign of curvature.

    Rows are those of the fit. The sign is -1 for maxima and +1 for minima (necks).
    """
    found = [_sign_changes(axis, *group) for group in axis.fit.tables() if group[0] >= 2]
    row = np.concatenate([np.zeros(0, np.int64), *(part[0] for part in found)])
    place = np.concatenate([np.zeros(0), *(part[1] for part in found)])
    sign = np.concatenate([np.zeros(0), *(part[2] for part in found)])
    order = np.lexsort((place, row))
    row, place, sign = row[order], place[order], sign[order]
    disks = axis.disks(row, place)
    keep = _clear_of_ends(axis, row, disks[:, 2])
    return row[keep], place[keep], disks[keep], sign[keep]


def _sign_changes(
    axis: MedialAxis, degree: int, members: IntArray, table: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Row, fraction and sign of the changes of sign of r', by bisection between 25 samples."""
    fraction = np.linspace(0.0, 1.0, 25)
    slope = degree * np.diff(table[:, :, 2], axis=1)
    scale = np.abs(slope).max(axis=1)
    values = slope @ bernstein(degree - 1, fraction).T
    values[np.abs(values) <= 1e-12 * scale[:, None]] = 0.0
    # A sample right at an extremum (symmetric pieces have one at 1/2) takes the sign of the last
    # one before it that has a sign: it would hide the change otherwise.
    signed = np.where(values != 0, np.arange(len(fraction)), 0)
    values = np.take_along_axis(values, np.maximum.accumulate(signed, axis=1), axis=1)
    steep = scale > 1e-12 * axis.sites.size
    row, column = np.nonzero((values[:, :-1] * values[:, 1:] < 0) & steep[:, None])
    left, right = fraction[column], fraction[column + 1]
    sign = np.sign(values[row, column])
    for _ in range(50):
        middle = 0.5 * (left + right)
        same = np.sign(np.einsum("ij,ij->i", bernstein(degree - 1, middle), slope[row])) == sign
        left, right = np.where(same, middle, left), np.where(same, right, middle)
    return members[row], 0.5 * (left + right), -sign


def _clear_of_ends(axis: MedialAxis, row: IntArray, radius: FloatArray) -> BoolArray:
    """Extrema (in order along their rows) that differ from the ends of their pieces.

    At smooth ends of the axis r' is 0 by nature, and between parallel walls everywhere: there it
    changes sign by rounding, or by the error of the fit.
    """
    fit, span = axis.fit, axis.fit.span
    slack = _noise(axis, row)
    change = row[1:] != row[:-1]
    lead, tail = np.ones(len(row), dtype=bool), np.ones(len(row), dtype=bool)
    lead[1:], tail[:-1] = change, change
    first, last = fit.vertex_radius[span.first[row]], fit.vertex_radius[span.last[row]]
    at_end = (lead & (np.abs(radius - first) <= slack)) | (tail & (np.abs(radius - last) <= slack))
    highest, lowest = np.full(len(span), -np.inf), np.full(len(span), np.inf)
    np.maximum.at(highest, row, np.maximum(radius, np.maximum(first, last)))
    np.minimum.at(lowest, row, np.minimum(radius, np.minimum(first, last)))
    return np.asarray(~at_end & ((highest - lowest)[row] > slack))


def _noise(axis: MedialAxis, row: IntArray) -> FloatArray:
    """Differences of r that mean nothing on pieces, mm."""
    return np.asarray(1e-11 * axis.sites.size + 2 * axis.fit.error[row])


def largest_disk(axis: MedialAxis) -> tuple[FloatArray, float]:
    """Centre and radius of a largest inscribed disk; of equal ones the leftmost, then lowest."""
    _, _, disks, _ = axis.critical
    vertex = np.column_stack([axis.fit.vertex_centre, axis.fit.vertex_radius])
    every = np.concatenate([vertex, disks])
    return _chosen(axis, every[every[:, 2] >= every[:, 2].max() - 1e-12 * axis.sites.size])


def narrowest_neck(axis: MedialAxis) -> tuple[FloatArray, float] | None:
    """Axis point and radius of the narrowest neck, None without one.

    A neck is a connected part of the axis where r is constant (mostly a point), from which r
    rises along every way out, and there are two ways or more. Of equal necks the leftmost, then
    lowest place counts.
    """
    places = necks(axis)
    if not len(places):
        return None
    return _chosen(axis, places[places[:, 2] <= places[:, 2].min() + 1e-12 * axis.sites.size])


def necks(axis: MedialAxis) -> FloatArray:
    """(k, 3) disks (x, y, r) of all necks, relative to the origin of the sites.

    Of a neck of constant width, the ends.
    """
    _, _, disks, sign = axis.critical
    fit, span = axis.fit, axis.fit.span
    count = len(fit.vertex_radius)
    first_change, last_change, level = _changes(axis)
    label = connected(span.first[level], span.last[level], count)
    groups = int(label.max(initial=-1)) + 1
    ways = np.concatenate([label[span.first[~level]], label[span.last[~level]]])
    change = np.concatenate([first_change[~level], last_change[~level]])
    rising = np.bincount(ways[change > 0], minlength=groups)
    falling = np.bincount(ways[change <= 0], minlength=groups)
    exits = np.zeros(count, dtype=bool)
    exits[np.concatenate([span.first[~level], span.last[~level]])] = True
    neck = ((rising >= 2) & (falling == 0))[label] & exits
    vertex = np.column_stack([fit.vertex_centre, fit.vertex_radius])[neck]
    return np.concatenate([disks[sign > 0], vertex])


def _changes(axis: MedialAxis) -> tuple[FloatArray, FloatArray, BoolArray]:
    """How r changes from both ends of each piece inwards, and where it does not at all."""
    fit, span = axis.fit, axis.fit.span
    rows = np.arange(len(span))
    radius = fit.vertex_radius
    inner = np.stack(
        [axis.disks(rows, np.full(len(rows), share))[:, 2] for share in (0.02, 0.5, 0.98)], axis=1
    )
    ends = np.stack([radius[span.first], radius[span.last]], axis=1)
    every = np.concatenate([ends, inner], axis=1)
    level = np.ptp(every, axis=1) <= _noise(axis, rows)
    return inner[:, 0] - ends[:, 0], inner[:, 2] - ends[:, 1], level


def _chosen(axis: MedialAxis, disks: FloatArray) -> tuple[FloatArray, float]:
    rounded = np.round(disks[:, :2] / (1e-9 * axis.sites.size))
    best = disks[np.lexsort((rounded[:, 1], rounded[:, 0]))[0]]
    return np.asarray(best[:2] + axis.sites.origin), float(best[2])


__all__ = ["critical", "largest_disk", "narrowest_neck", "necks"]
