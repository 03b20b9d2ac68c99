"""Rings of a region: components of its trimmed offsets as chains of lines and arcs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grassfire.geometry.curve import cross
from grassfire.medial import MedialAxis, OffsetNode
from grassfire.plan.path import Path, from_loop
from grassfire.plan.places import IntArray
from grassfire.toolpath import FloatArray

CLEARS = 0.995
"""Part of the tool radius within which a ring counts as clearing all."""

MOST_SPACING = 0.98
"""Largest distance between rings as a part of the tool radius."""

ROUNDING, MOST_CUT_OFF = 0.6, 0.25
"""Radius by which sharp corners of inner rings are rounded, and by how much the corner may move,
as parts of the tool radius."""

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
    dropped : float
        Largest clearance in components of the next level that are cleared by these rings, mm.
    """

    level: int
    distance: float
    rings: tuple[Path, ...]
    children: tuple[int, ...]
    peak: FloatArray
    peak_radius: float
    dropped: float


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


def needed(nodes: Sequence[OffsetNode], tool_radius: float) -> list[bool]:
    """Which components need rings of their own.

    One without such components inside it is left out where the ring around it clears it:
    peak radius - d_k-1 <= R * CLEARS, by the argument of `ring_distances`. Cutting that ring is
    cutting in full width, as is the innermost ring of any lobe. The wall level is never left out.
    """
    keep = [True] * len(nodes)
    inner = [0] * len(nodes)
    for index in range(len(nodes) - 1, -1, -1):
        node = nodes[index]
        if node.parent < 0:
            continue
        cleared = node.peak_radius - nodes[node.parent].distance <= CLEARS * tool_radius
        keep[index] = inner[index] > 0 or not cleared
        inner[node.parent] += keep[index]
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
        spacing, since nothing is left and no wall is touched by that. Their corners are rounded.
    climb : bool
        Whether rings keep the region on the left; reversed otherwise.
    """
    inner_fit = max(wall_fit, min(INNER_FIT * spacing, MOST_INNER_FIT))
    nodes = axis.offset_tree(distances)
    keep, children = needed(nodes, tool_radius), _children(nodes)
    made = _paths(nodes, keep, wall_fit, inner_fit, tool_radius)
    result: list[Component] = []
    for index, node in enumerate(nodes):
        inside = tuple(child for child in children[index] if keep[child])
        dropped = [nodes[child].peak_radius for child in children[index] if not keep[child]]
        result.append(
            Component(
                level=int(node.level),
                distance=float(node.distance),
                rings=tuple(ring if climb else ring.reversed() for ring in made[index]),
                children=inside,
                peak=np.asarray(node.peak, dtype=np.float64),
                peak_radius=float(node.peak_radius),
                dropped=max(dropped, default=0.0),
            )
        )
    return tuple(result)


def _paths(
    nodes: Sequence[OffsetNode],
    keep: Sequence[bool],
    wall_fit: float,
    inner_fit: float,
    tool_radius: float,
) -> list[list[Path]]:
    """Rings of every component that needs them, those of inner ones with rounded corners."""
    made = [
        [from_loop(loop, inner_fit if node.level else wall_fit) for loop in node.loops]
        if kept
        else []
        for node, kept in zip(nodes, keep, strict=True)
    ]
    inner = [ring for node, rings in zip(nodes, made, strict=True) if node.level for ring in rings]
    ready = iter(rounded(inner, ROUNDING * tool_radius, MOST_CUT_OFF * tool_radius))
    return [
        [next(ready) for _ in rings] if node.level else rings
        for node, rings in zip(nodes, made, strict=True)
    ]


def rounded(rings: Sequence[Path], radius: float, most: float, sharp: float = 0.2) -> list[Path]:
    """Closed chains, region on the left, with arcs in place of their sharp left-hand corners.

    Nothing stays uncut by that, as long as `most` is less than the tool's radius: what was nearest
    to a part of the ring that is cut off is nearer to the arc, or in the corner itself, which is
    within `most` of the arc.

    Parameters
    ----------
    rings : sequence of Path
    radius : float
        Of the arcs, mm; less where a corner would move by more than `most`, or where the arc
        would take more than half of a piece. Halved up to four times until it fits.
    most : float
        How far a corner may be from the arc, mm.
    sharp : float
        Least turn that is rounded, radians.
    """
    if not rings:
        return []
    pieces = _Pieces(rings)
    before, count = pieces.before, len(pieces.before)
    arriving, leaving = pieces.ahead_end[before], pieces.ahead_start
    turn = np.arctan2(cross(arriving, leaving), np.sum(arriving * leaving, axis=1))
    slack = 1 / np.cos(np.minimum(turn, 3.1) / 2) - 1
    size = np.where(turn > sharp, np.minimum(radius, most / np.maximum(slack, 1e-9)), 0.0)
    first, last = np.zeros(count), np.ones(count)
    centre = np.full((count, 2), np.nan)
    left = np.flatnonzero(size > 0)
    for _ in range(5):
        if not len(left):
            break
        middle = _touching(pieces, before[left], left, size[left])
        tail, head = _foot(pieces, before[left], middle), _foot(pieces, left, middle)
        away = np.hypot(*(middle - pieces.start[left]).T) - size[left]
        good = (tail >= 0.5) & (tail < 1) & (head <= 0.5) & (head > 0) & (away <= most * 1.001)
        done = left[good]
        last[before[done]], first[done], centre[done] = tail[good], head[good], middle[good]
        left = left[~good]
        size[left] /= 2
    return [
        _with_corners(ring, first[rows], last[rows], centre[rows])
        for ring, rows in zip(rings, pieces.rows, strict=True)
    ]


class _Pieces:
    """Pieces of closed chains as columns: ends, circles, directions, and the piece before each."""

    def __init__(self, rings: Sequence[Path]) -> None:
        count = np.array([len(ring) for ring in rings])
        begin = np.cumsum(count) - count
        self.rows = [slice(low, low + size) for low, size in zip(begin, count, strict=True)]
        self.start = np.concatenate([ring.points[:-1] for ring in rings])
        self.end = np.concatenate([ring.points[1:] for ring in rings])
        self.centre = np.concatenate([ring.centre for ring in rings])
        self.sweep = np.concatenate([ring.sweep for ring in rings])
        self.before = np.arange(len(self.start)) - 1
        self.before[begin] = begin + count - 1
        self.is_arc = self.sweep != 0.0
        spoke = self.start - self.centre
        self.radius = np.where(self.is_arc, np.hypot(spoke[:, 0], spoke[:, 1]), np.inf)
        chord = self.end - self.start
        self.unit = chord / np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-300)[:, None]
        self.ahead_start, self.ahead_end = self._ahead(self.start), self._ahead(self.end)

    def _ahead(self, place: FloatArray) -> FloatArray:
        """(n, 2) unit directions of travel at places on the pieces."""
        side = np.sign(self.sweep) / np.where(self.is_arc, self.radius, 1.0)
        spoke = (place - self.centre) * side[:, None]
        turned = np.stack([-spoke[:, 1], spoke[:, 0]], axis=1)
        return np.where(self.is_arc[:, None], turned, self.unit)


def _touching(pieces: _Pieces, one: IntArray, two: IntArray, size: FloatArray) -> FloatArray:
    """(k, 2) centres of circles on the left that touch both pieces near their common corner.

    Newton's method on the distances to both: from the left of a line, from the circle of an arc.
    NaN where the pieces admit none.
    """
    corner = pieces.start[two]
    normals = [
        np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
        for ahead in (pieces.ahead_end[one], pieces.ahead_start[two])
    ]
    inward = normals[0] + normals[1]
    length = np.sum(inward * normals[0], axis=1)
    place = corner + inward * (size / np.maximum(length, 1e-3))[:, None]
    # between lines the first guess is exact
    rounds = 8 if np.any(pieces.is_arc[one] | pieces.is_arc[two]) else 1
    for _ in range(rounds):
        gap_a, grad_a = _gap(pieces, one, place, normals[0], corner)
        gap_b, grad_b = _gap(pieces, two, place, normals[1], corner)
        miss_a, miss_b = gap_a - size, gap_b - size
        area = cross(grad_a, grad_b)
        safe = np.where(np.abs(area) > 1e-9, area, np.nan)
        step_x = (miss_a * grad_b[:, 1] - miss_b * grad_a[:, 1]) / safe
        step_y = (miss_b * grad_a[:, 0] - miss_a * grad_b[:, 0]) / safe
        place = place - np.stack([step_x, step_y], axis=1)
    moved = np.hypot(step_x, step_y)
    return np.asarray(np.where((moved <= 1e-9)[:, None], place, np.nan))


def _gap(
    pieces: _Pieces, piece: IntArray, place: FloatArray, normal: FloatArray, corner: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Signed distance of places to the left of pieces, and its gradient."""
    arc = pieces.is_arc[piece]
    spoke = place - pieces.centre[piece]
    reach = np.hypot(spoke[:, 0], spoke[:, 1])
    turn = np.sign(pieces.sweep[piece])
    # left of a counter-clockwise arc is towards its centre
    radius = np.where(arc, pieces.radius[piece], 0.0)
    outwards = -turn[:, None] * spoke / np.maximum(reach, 1e-300)[:, None]
    straight = np.sum((place - corner) * normal, axis=1)
    return (
        np.where(arc, turn * (radius - reach), straight),
        np.where(arc[:, None], outwards, normal),
    )


def _foot(pieces: _Pieces, piece: IntArray, place: FloatArray) -> FloatArray:
    """(k,) fraction of each piece where it is nearest to its place; NaN where that is NaN."""
    begin = pieces.start[piece]
    chord = pieces.end[piece] - begin
    along = np.sum((place - begin) * chord, axis=1) / np.maximum(np.sum(chord**2, axis=1), 1e-300)
    start, spoke = begin - pieces.centre[piece], place - pieces.centre[piece]
    angle = np.arctan2(cross(start, spoke), np.sum(start * spoke, axis=1))
    arc = pieces.is_arc[piece]
    sweep = np.where(arc, pieces.sweep[piece], 1.0)
    swept = np.mod(angle * np.sign(sweep), 2 * np.pi) / np.abs(sweep)
    return np.asarray(np.where(arc, swept, along))


def _with_corners(ring: Path, first: FloatArray, last: FloatArray, centre: FloatArray) -> Path:
    """Each piece from fraction `first` to `last`, with an arc before it where `centre` is given."""
    count = len(ring)
    if np.all(np.isnan(centre[:, 0])):
        return ring
    along = ring.cumulative[:-1]
    starts, ends = ring.at(along + first * ring.lengths), ring.at(along + last * ring.lengths)
    starts = np.where((first == 0)[:, None], ring.points[:-1], starts)
    given = ~np.isnan(centre[:, 0])
    spoke_in, spoke_out = np.roll(ends, 1, axis=0) - centre, starts - centre
    turn = np.arctan2(cross(spoke_in, spoke_out), np.sum(spoke_in * spoke_out, axis=1))
    # each piece with the arc before it, arcs that are not given left out
    points = np.stack([np.roll(ends, 1, axis=0), starts], axis=1).reshape(-1, 2)
    middles = np.stack([centre, ring.centre], axis=1).reshape(-1, 2)
    sweep = np.stack([turn, ring.sweep * (last - first)], axis=1).ravel()
    keep = np.stack([given, np.ones(count, dtype=bool)], axis=1).ravel()
    points = points[keep]
    return Path(np.concatenate([points, points[:1]]), middles[keep], sweep[keep])
