"""Rings of a region: components of its trimmed offsets as chains of lines and arcs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grassfire.medial import MedialAxis, OffsetNode
from grassfire.plan.path import Path, from_loop
from grassfire.toolpath import FloatArray

CLEARS = 0.995
"""Part of the tool radius within which a ring counts as clearing all."""

MOST_SPACING = 0.98
"""Largest distance between rings as a part of the tool radius."""

INNER_FIT, MOST_INNER_FIT = 0.005, 0.01
"""Deviation of inner rings: this part of the spacing, and no more than so many mm."""


@dataclass(frozen=True)
class Component:
    """Connected set where the clearance is at least `distance`, with its rings.

    Attributes
    ----------
    level : int
        0 for the wall ring.
    distance : float
        Of its rings from the boundary, mm.
    rings : tuple of Path
        Closed; outer first, region on the left.
    children : tuple of int
        Components of the next level inside it that need rings of their own.
    peak : (2,) float array
        Centre of its largest disk, mm.
    peak_radius : float
        Clearance there, mm.
    """

    level: int
    distance: float
    rings: tuple[Path, ...]
    children: tuple[int, ...]
    peak: FloatArray
    peak_radius: float


def ring_distances(wall: float, spacing: float, most: float) -> FloatArray:
    """Wall distances of all rings: `wall`, then every `spacing` up to below `most`, mm.

    With spacing <= R nothing stays between rings k and k + 1, for a tool of radius R: take a
    point x with clearance c in [d_k, d_k+1] and its nearest boundary point b. On the segment from
    b to x the clearance is the distance from b, so the segment meets ring k at distance c - d_k
    <= d_k+1 - d_k <= R from x: the tool on ring k covers x. The same holds inside the last ring
    of a component, where c <= peak radius < d_k+1.
    """
    count = max(0, int(np.ceil((most - wall) / spacing - 1e-9)) - 1)
    return np.asarray(wall + spacing * np.arange(count + 1))


def needed(nodes: Sequence[OffsetNode], spacing: float, tool_radius: float) -> list[bool]:
    """Which components need rings of their own.

    One without components inside it, whose rings would run within half a spacing of its middle,
    is left out when the ring around it clears it: peak radius - d_k-1 <= R * CLEARS, by the
    argument of `ring_distances`. The wall level is never left out.
    """
    inside = _children(nodes)
    keep = [True] * len(nodes)
    for index, node in enumerate(nodes):
        if node.parent < 0 or inside[index]:
            continue
        thin = node.peak_radius - node.distance <= spacing / 2
        cleared = node.peak_radius - nodes[node.parent].distance <= CLEARS * tool_radius
        keep[index] = not (thin and cleared)
    return keep


def _children(nodes: Sequence[OffsetNode]) -> list[list[int]]:
    inside: list[list[int]] = [[] for _ in nodes]
    for index, node in enumerate(nodes):
        if node.parent >= 0:
            inside[node.parent].append(index)
    return inside


def components(
    axis: MedialAxis,
    distances: FloatArray,
    spacing: float,
    tool_radius: float,
    wall_fit: float,
    climb: bool,
) -> tuple[Component, ...]:
    """Components of all levels, those of level 0 (the pockets) included, in a fixed order.

    Parameters
    ----------
    axis : MedialAxis
    distances : (k,) float array
        Ascending, mm.
    spacing, tool_radius : float
        mm.
    wall_fit : float
        How far wall rings may deviate, mm; inner ones may by more, up to a small part of the
        spacing, since nothing is left and no wall is touched by that.
    climb : bool
        Whether rings keep the region on the left; reversed otherwise.
    """
    inner_fit = max(wall_fit, min(INNER_FIT * spacing, MOST_INNER_FIT))
    nodes = axis.offset_tree(distances)
    keep, children = needed(nodes, spacing, tool_radius), _children(nodes)
    result: list[Component] = []
    for index, node in enumerate(nodes):
        fit = wall_fit if node.level == 0 else inner_fit
        rings = [from_loop(loop, fit) for loop in node.loops] if keep[index] else []
        inside = tuple(child for child in children[index] if keep[child])
        result.append(
            Component(
                level=int(node.level),
                distance=float(node.distance),
                rings=tuple(ring if climb else ring.reversed() for ring in rings),
                children=inside,
                peak=np.asarray(node.peak, dtype=np.float64),
                peak_radius=float(node.peak_radius),
            )
        )
    return tuple(result)
