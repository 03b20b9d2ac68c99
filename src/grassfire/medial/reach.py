"""How large a disk inside a polygon may be that touches a site: what is far away sees few sites.

About the centre of a star with very many valleys all of these are nearly as far, and a tree of
all samples has to look at most of them. Only few are touched by any disk of that size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grassfire.geometry.curve import cross
from grassfire.geometry.neighbours import Neighbours
from grassfire.medial.sites import FloatArray, IntArray, SiteKind, Sites, disk_through, dot

_STEPS = (1, 2, 4, 8, 16, 32)
"""Reflex corners away along the boundary, at which others bound the disks that touch a corner."""

_CROWDED = 50_000
"""Samples below which leaving some out saves nothing."""

_SHARE = 16
"""Of so many samples one is kept."""

_ROUNDING = 1e-9
"""Share by which bounds are raised."""


@dataclass(frozen=True)
class FarSamples:
    """Samples in `row` of all, which are all that disks larger than `radius`, mm, can touch."""

    radius: float
    row: IntArray
    samples: Neighbours

    @staticmethod
    def among(sites: Sites, site: IntArray, place: FloatArray) -> FarSamples | None:
        """The share of the samples (n, 2) of sites (n,) with the largest reaches.

        None of few samples, of curves, or where the reaches of more of them are not bounded.
        """
        if len(site) < _CROWDED or sites.curved:
            return None
        reach = reaches(sites)[site]
        rank = len(reach) - len(reach) // _SHARE
        least = float(np.partition(reach, rank)[rank])
        if np.isinf(least):
            return None
        row = np.flatnonzero(reach >= least)
        return FarSamples(least, row, Neighbours(place[row]))


def reaches(sites: Sites) -> FloatArray:
    """Upper bounds of the radii of empty disks inside that touch sites, (m,); infinite by default.

    A disk that is tangent at a point and holds no boundary point s is no larger than the one
    through s, (A). Along a line that is convex, and so it is in the angle of the normal at a
    corner: between two normals the larger value of both is a bound. Where two neighbours of a
    corner give the same, at the centre of the circle through all three, one takes over from the
    other.
    """
    result = np.full(len(sites), np.inf)
    point = np.flatnonzero(sites.kind == SiteKind.POINT)
    if len(point) <= 2 * _STEPS[-1]:
        return result
    anchor = sites.anchor[point]
    start, turn = sites.extent[point].T
    first, last = (np.stack([np.cos(at), np.sin(at)], axis=1) for at in (start, start + turn))
    bound = np.full(len(point), np.inf)
    for step in _STEPS:
        before, after = np.roll(anchor, step, axis=0), np.roll(anchor, -step, axis=0)
        bound = np.minimum(bound, _corner_bound(before - anchor, after - anchor, first, last))
    result[point] = bound
    line = np.flatnonzero(sites.kind == SiteKind.LINE)
    result[line] = _line_bounds(sites, line, np.searchsorted(point, line), anchor)
    return result * (1 + _ROUNDING)


def _corner_bound(
    before: FloatArray, after: FloatArray, first: FloatArray, last: FloatArray
) -> FloatArray:
    """Bounds at corners with neighbours at `before` and `after`, normals from `first` to `last`."""
    area = 2 * cross(before, after)
    one, two = dot(before, before), dot(after, after)
    with np.errstate(divide="ignore", invalid="ignore"):
        centre = np.stack(
            [one * after[:, 1] - two * before[:, 1], two * before[:, 0] - one * after[:, 0]], axis=1
        )
        centre /= area[:, None]
    # Reflex corners turn to the right, by less than half a turn.
    between = (cross(first, centre) < 0) & (cross(centre, last) < 0)
    ends = np.maximum(disk_through(before, first), disk_through(after, last))
    radius = np.maximum(ends, np.hypot(centre[:, 0], centre[:, 1]))
    return np.where(between & np.isfinite(radius), radius, np.inf)


def _line_bounds(sites: Sites, line: IntArray, behind: IntArray, anchor: FloatArray) -> FloatArray:
    """Bounds along lines from the corners before and after them, of which `behind` comes next."""
    start, along = sites.anchor[line], sites.extent[line]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    normal /= np.hypot(along[:, 0], along[:, 1])[:, None]
    result = np.full(len(line), np.inf)
    for step in (-2, -1, 0, 1):
        other = anchor.take(behind + step, axis=0, mode="wrap") - start
        ends = np.maximum(disk_through(other, normal), disk_through(other - along, normal))
        result = np.minimum(result, ends)
    return result
