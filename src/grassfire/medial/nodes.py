"""Boundary points with known maximal disks, and the stretches between them, as columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grassfire.medial.columns import Columns
from grassfire.medial.contact import Tangents
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, SiteKind, Sites

WHOLE = -2
"""Partner of a contact arc: the arc itself, its disk being centred at the arc's centre."""


@dataclass(frozen=True)
class Nodes(Columns):
    """Boundary points with known maximal disks, one row each.

    `left` and `right` are the partners before and after the node along its site; `vertex` is -1 for
    plain nodes, whose `left` equals `right`. `facing` is the contact on the partner, `own`
    marks the ends of the site itself.
    """

    site: IntArray
    parameter: FloatArray
    radius: FloatArray
    left: IntArray
    right: IntArray
    facing: FloatArray
    vertex: IntArray
    centre: FloatArray
    own: BoolArray

    def __len__(self) -> int:
        return len(self.site)


@dataclass(frozen=True)
class Intervals:
    """Maximal stretches of a site that face one partner, in boundary order.

    `group` numbers the nodes: those of a number are one boundary point.
    """

    site: IntArray
    start: FloatArray
    end: FloatArray
    partner: IntArray
    first: IntArray
    last: IntArray
    first_node: IntArray
    last_node: IntArray
    group: IntArray


@dataclass(frozen=True)
class Junctions:
    """Smooth junctions and ends of fans, between sites `before` and `after`.

    `tangents` have the mean normal; `curvature` is the larger of the two.
    """

    before: IntArray
    after: IntArray
    normal: FloatArray
    other_position: FloatArray
    other_normal: FloatArray
    tangents: Tangents
    curvature: FloatArray

    @staticmethod
    def of(sites: Sites, before: IntArray, after: IntArray) -> Junctions:
        position, normal, curvature = sites.frame(before, sites.high[before])
        other_position, other_normal, other_curvature = sites.frame(after, sites.low[after])
        # A fan has no curvature; its frame is exact at the corner.
        point = sites.kind[before] == SiteKind.POINT
        normal = np.where(point[:, None], other_normal, normal)
        fan = sites.kind[after] == SiteKind.POINT
        mean = normal + np.where(fan[:, None], normal, other_normal)
        mean /= np.hypot(mean[:, 0], mean[:, 1])[:, None]
        return Junctions(
            before,
            after,
            normal,
            other_position,
            other_normal,
            Tangents(position, mean, before, sites.high[before]),
            np.maximum(curvature, other_curvature),
        )
