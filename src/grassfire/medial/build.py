"""From a region to its sites: free curves are split where their curvature is extreme."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry import Arc, Bezier, Line, Region
from grassfire.geometry.curve import Curve, cross, dot
from grassfire.geometry.loop import cusp_side
from grassfire.medial.pieces import Pieces, collapse, divide, gather, neighbours
from grassfire.medial.sites import FloatArray, IntArray, SiteKind, Sites

DUPLICATE = 1e-12
"""Distance of points that count as one, relative to the size of the region."""
STRAIGHT = 1e-11
"""Distance of a point from the line between its neighbours that makes no corner, relative to the
size of the region."""
_LINES = 3e-3
"""Share of the smooth angle that makes a corner of two lines."""
_FEWEST = 4
"""Pieces of a loop that are never made fewer."""
CUSP = 1e-9
"""Turn off half a turn below which the sign of a junction's turn is rounding, radians."""


def build_sites(
    region: Region, smooth_angle: float = 1e-6, least_fan: float = 1e-9, merged: float = 0.0
) -> tuple[Sites, tuple[Bezier, ...]]:
    """Sites of a region, and the Bezier curves that its spirals are pieces of.

    Parameters
    ----------
    region : Region
    smooth_angle : float
        Convex turn below which a junction counts as smooth, radians. The disks next to it are
        then off by their radius times half the square of the turn.
    least_fan : float
        Reflex turn below which a corner gets no fan of normals, radians: the axis then misses a
        stretch of its radius times the turn.
    merged : float
        Distance of points that count as one, mm, where it is more than rounding.

    Raises
    ------
    GeometryError
        A loop of no extent, or a curve with no rational form or no tangent.

    Notes
    -----
    Free curves within 1e-11 of the region's size of a line or an arc become that. Points nearer
    to each other than 1e-12 of its size (and than the rounding of its coordinates) are one point:
    what lies between them makes no site, and the turn there is that between the neighbours that
    remain. Points farther apart are taken at their word, however short the line between them:
    its direction is what the coordinates say, and its corners are convex, reflex or smooth by
    the two angles as any other; but where points may be moved at all (`merged`), one that lies
    within 1e-11 of the size of the line between its neighbours is dropped: the contacts on both
    sides of so flat a corner could not be told from the corner. A cusp inside a free curve is a
    corner too, of half a turn; a length of 1e-13 of the curve's size is left out on both sides of
    it, where the curve has no direction.
    """
    xmin, ymin, xmax, ymax = region.bounds()
    origin = np.array([(xmin + xmax) / 2, (ymin + ymax) / 2])
    size = float(np.hypot(xmax - xmin, ymax - ymin))
    if not (np.isfinite(size) and size > 0):
        raise GeometryError("the region has no extent")
    pieces, table, beziers = gather(region, origin, size)
    far = max(abs(xmin), abs(ymin), abs(xmax), abs(ymax))
    least = max(DUPLICATE * size + 1e-15 * far, merged)
    divided = divide(pieces, table, size)
    pieces = collapse(divided, least)
    moved = merged if len(pieces) < len(divided) else 0.0
    pieces, bent = _straightened(pieces, min(STRAIGHT * size + 1e-14 * far, 0.1 * merged))
    moved += bent
    turn = _turns(pieces, beziers, origin, max(least_fan, CUSP))
    sites = _assemble(pieces, table, turn, (smooth_angle, least_fan), origin, size)
    return replace(sites, merged=moved), beziers


def _straightened(pieces: Pieces, limit: float) -> tuple[Pieces, float]:
    """Lines that run on in lines made one, and how far that moved the boundary at most.

    Of corners in a row every second is dropped at a time, so that what they are moved adds up.
    """
    moved = 0.0
    while True:
        after = neighbours(pieces.loop)[0]
        one, two = pieces.extent, pieces.extent.take(after, axis=0)
        whole = one + two
        line = pieces.kind == SiteKind.LINE
        height = np.abs(cross(one, two)) / np.maximum(np.hypot(*whole.T), 1e-300)
        flat = line & line[after] & (dot(one, two) > 0) & (moved + height <= limit)
        flat &= np.bincount(pieces.loop)[pieces.loop] > _FEWEST
        row = np.arange(len(pieces))
        run = row - np.maximum.accumulate(np.where(flat, -1, row))
        # The last corner of a loop, before the first piece, stays: the next round has another.
        rows = np.flatnonzero(flat & (run % 2 == 1) & (after == row + 1))
        if not (limit > 0 and len(rows)):
            return pieces, moved
        moved += float(height[rows].max())
        pieces.set_lines(rows, pieces.start[rows], pieces.end[after[rows]])
        kept = np.ones(len(pieces), dtype=bool)
        kept[after[rows]] = False
        pieces = pieces.take(kept)


def _turns(
    pieces: Pieces, beziers: tuple[Bezier, ...], origin: FloatArray, cusp_angle: float
) -> FloatArray:
    """(p,) turns at the ends of the pieces, radians, positive to the left."""
    following = neighbours(pieces.loop)[0]
    incoming, outgoing = pieces.last, pieces.first[following]
    turn = np.arctan2(cross(incoming, outgoing), dot(incoming, outgoing))
    for row in np.flatnonzero(np.abs(turn) > np.pi - cusp_angle):
        ends = (_curve(pieces, beziers, origin, int(at)) for at in (row, following[row]))
        turn[row] = np.copysign(turn[row], cusp_side(*ends))
    return np.asarray(turn)


def _curve(pieces: Pieces, beziers: tuple[Bezier, ...], origin: FloatArray, row: int) -> Curve:
    """One piece as a curve."""
    if pieces.kind[row] == SiteKind.LINE:
        return Line(pieces.start[row] + origin, pieces.end[row] + origin)
    if pieces.kind[row] == SiteKind.ARC:
        start_angle, sweep = pieces.extent[row].tolist()
        return Arc(pieces.anchor[row] + origin, float(pieces.radius[row]), start_angle, sweep)
    whole = beziers[int(pieces.bezier[row])]
    return whole.subcurve(float(pieces.low[row]), float(pieces.high[row]))


def _assemble(
    pieces: Pieces,
    table: FloatArray,
    turn: FloatArray,
    angles: tuple[float, float],
    origin: FloatArray,
    size: float,
) -> Sites:
    """Add the fans of reflex corners."""
    smooth_angle, least_fan = angles
    fan = turn < -least_fan
    past = np.cumsum(1 + fan)
    site = pieces.take(np.repeat(np.arange(len(pieces)), 1 + fan))
    _add_fans(site, pieces, past[fan] - 1, np.flatnonzero(fan), turn[fan])
    corner_after, turn_after = np.zeros(len(site), dtype=bool), np.zeros(len(site))
    turn_after[past[~fan] - 1] = turn[~fan]
    corner_after[past[~fan] - 1] = (turn > _corner_angle(pieces, smooth_angle, size))[~fan]
    following, preceding = neighbours(site.loop)
    return Sites(
        kind=site.kind,
        anchor=site.anchor,
        extent=site.extent,
        radius=site.radius,
        low=site.low,
        high=site.high,
        coefficients=table,
        bezier=site.bezier,
        following=following,
        preceding=preceding,
        corner_after=corner_after,
        turn_after=turn_after,
        loop=site.loop,
        curve=site.curve,
        origin=origin,
        size=size,
    )


def _corner_angle(pieces: Pieces, smooth_angle: float, size: float) -> FloatArray:
    """Turn above which the end of each piece is a convex corner.

    Where a disk lies in a rounded arc a turn moves its centre by the radius times the turn, not
    by half its square: that is held to the same length. Between lines nothing is gained by
    taking a corner for smooth but where it cannot be told from none.
    """
    line = pieces.kind == SiteKind.LINE
    straight = line & line[neighbours(pieces.loop)[0]]
    radius = np.where(pieces.kind == SiteKind.ARC, pieces.radius, 0.0)
    radius = np.where(pieces.extent[:, 1] > 0, radius, 0.0)
    radius = np.maximum(radius, radius[neighbours(pieces.loop)[0]])
    with np.errstate(divide="ignore"):
        angle = np.minimum(smooth_angle, 10.0 * smooth_angle**2 * size / radius)
    return np.where(straight, _LINES * smooth_angle, angle)


def _add_fans(
    site: Pieces, pieces: Pieces, rows: IntArray, owner: IntArray, turn: FloatArray
) -> None:
    """Make `rows` of the sites the reflex corners at the ends of the pieces `owner`."""
    after = neighbours(pieces.loop)[0][owner]
    tangent = pieces.first[after]
    angle = np.arctan2(tangent[:, 0], -tangent[:, 1]) - turn
    site.kind[rows], site.bezier[rows], site.radius[rows] = SiteKind.POINT, -1, 0.0
    site.anchor[rows] = pieces.start[after]
    site.low[rows], site.high[rows] = 0.0, 1.0
    site.extent[rows] = np.stack([angle, turn], axis=1)
