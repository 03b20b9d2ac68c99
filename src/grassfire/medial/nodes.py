"""Boundary points with known maximal disks, and the stretches between them, as columns."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from grassfire.medial.sites import BoolArray, FloatArray, IntArray

WHOLE = -2
"""Partner of a contact arc: the arc itself, its disk being centred at the arc's centre."""


@dataclass(frozen=True)
class Nodes:
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

    def take(self, index: IntArray | BoolArray) -> Nodes:
        """Rows `index`."""
        return Nodes(*(getattr(self, item.name)[index] for item in fields(self)))

    @staticmethod
    def join(*parts: Nodes) -> Nodes:
        """All rows of all parts."""
        return Nodes(
            *(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Nodes))
        )


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
