"""Edges between two lines, or a line and a reflex corner: lines and parabolas, exactly.

Along a line the centre and the radius of the disks that touch another line are linear, and those
through a point q at the height h above the line quadratic: at a distance t from its foot

    r = (t^2 + h^2) / (2 h).

So the disks at the ends are all of the first, and with the one in the middle all of the second.
"""

from __future__ import annotations

import numpy as np

from grassfire.geometry.chebyshev import bernstein
from grassfire.medial.edges import NODES, Span
from grassfire.medial.interpolants import Interpolants, deviation_limit
from grassfire.medial.sites import (
    BoolArray,
    FloatArray,
    SiteKind,
    Sites,
    dot,
    largest,
    share_of_turn,
)

_QUARTERS = np.array([0.25, 0.5, 0.75])
_HALVES = bernstein(2, NODES)
"""Of parabolas at the Chebyshev points."""


def between_lines(sites: Sites, span: Span, tolerance: float) -> tuple[list[Interpolants], Span]:
    """Interpolate the edges between lines, and between lines and corners.

    Parameters
    ----------
    sites : Sites
    span : Span
        Edges; a line comes before a corner.
    tolerance : float
        Deviation of centre and radius to aim at, mm.

    Returns
    -------
    list of Interpolants
    Span
        The other edges, and those whose ends do not fit.
    """
    line = sites.kind[span.site] == SiteKind.LINE
    kind = sites.kind[span.partner]
    rest = np.ones(len(span), dtype=bool)
    found = []
    for chosen, shape in ((SiteKind.LINE, _lines), (SiteKind.POINT, _parabolas)):
        rows = (line & (kind == chosen)).nonzero()[0]
        if len(rows):
            pieces, good = shape(sites, span.take(rows), tolerance)
            rest[rows[good]] = False
            found.append(pieces.take(good))
    return found, span.take(rest)


def _lines(sites: Sites, span: Span, tolerance: float) -> tuple[Interpolants, BoolArray]:
    """Edges between two lines, and which are off by no more than the tolerance.

    Distances from the lines are linear along the chord. How far vertices that rounding leaves open
    lie along it does not count.
    """
    error = np.zeros(len(span))
    for disk in (span.first_disk, span.last_disk):
        for site in (span.site, span.partner):
            offset = disk[:, :2] - sites.anchor.take(site, axis=0)
            height = dot(sites.inward.take(site, axis=0), offset)
            error = np.maximum(error, np.abs(height - disk[:, 2]))
    table = np.stack([span.first_disk, span.last_disk], axis=1)
    step = span.facing_end - span.facing_start
    facing = span.facing_start[:, None] + step[:, None] * NODES
    degree = np.ones(len(span), dtype=np.int64)
    return Interpolants(span, degree, table, error, facing), error <= tolerance


def _parabolas(sites: Sites, span: Span, tolerance: float) -> tuple[Interpolants, BoolArray]:
    """Edges between lines and corners, and which are off by no more than the tolerance."""
    exact = _parabola(sites, span)
    middle = 2 * exact[:, 1] - 0.5 * (span.first_disk + span.last_disk)
    table = np.stack([span.first_disk, middle, span.last_disk], axis=1)
    off = 0.0625 * table[:, ::2] + 0.375 * table[:, 1:2] + 0.5625 * table[:, ::-2]
    error = largest((off - exact[:, ::-2]).reshape(-1, 6))
    even = np.ones(len(span))
    limit = deviation_limit(span.first_disk, span.last_disk, tolerance * even, even, np.array([2]))[
        :, 0
    ]
    degree = np.full(len(span), 2)
    return Interpolants(span, degree, table, error, _turns(sites, span, table)), error <= limit


def _parabola(sites: Sites, span: Span) -> FloatArray:
    """(k, 3, 3) disks at the quarters between; not finite where corners lie behind their lines."""
    start, along = (part.take(span.site, axis=0) for part in (sites.anchor, sites.extent))
    normal = sites.inward.take(span.site, axis=0)
    apart = sites.anchor.take(span.partner, axis=0) - start
    length = sites.length[span.site]
    height = dot(normal, apart)[:, None]
    at = span.start[:, None] + (span.end - span.start)[:, None] * _QUARTERS
    reach = at * length[:, None] - (dot(along, apart) / length)[:, None]
    result = np.empty((len(span), 3, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.where(height > 0, (reach**2 + height**2) / (2 * height), np.nan)
    for axis in (0, 1):
        base = start[:, [axis]] + at * along[:, [axis]]
        result[:, :, axis] = base + radius * normal[:, [axis]]
    result[:, :, 2] = radius
    return result


def _turns(sites: Sites, span: Span, table: FloatArray) -> FloatArray:
    """(k, 13) contacts on the corners at the Chebyshev points."""
    x, y = (
        table[..., axis] @ _HALVES.T - sites.anchor[span.partner, axis, None] for axis in (0, 1)
    )
    start, turn = sites.extent[span.partner].T[..., None]
    facing = np.clip(share_of_turn(np.arctan2(y, x), start, turn), 0.0, 1.0)
    facing[:, 0], facing[:, -1] = span.facing_start, span.facing_end
    return np.asarray(facing)
