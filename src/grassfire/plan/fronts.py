"""What has been cleared: a union of tool disks, and its edges against the stock (the fronts)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from grassfire.plan.path import BoolArray, IntArray
from grassfire.plan.pursuit import unit, wrapped
from grassfire.toolpath import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

GRAZE = 2e-3
"""Disks that overlap by less than this part of the tool radius count as touching."""

WALL_SKIN = 0.02
"""Edges nearer to a wall than this part of the tool radius are left to the wall pass."""

SHORTEST = 0.15
"""Fronts shorter than this part of the tool radius are left to their neighbours."""

JOIN_GAP = 0.25
"""Fronts that end and start within this part of the tool radius are one."""

HEAD = 80
"""Points of a front beside which another one may end to be continued by it."""

JOIN_RIGHT, JOIN_LEFT = np.radians(40.0), np.radians(100.0)
"""Sharpest turns at which fronts are joined: to the right stock juts out, to the left none does."""


AT_WALL = 0.1
"""A front that ends nearer to the wall than this part of the tool radius ends there."""

FOLD = 2.5
"""Where an edge runs back over itself by so many steps at most, its points there are dropped."""

Clearances = Callable[[FloatArray], FloatArray]
"""Distance of points (n, 2) from the walls, (n,) mm."""

Box = tuple[float, float, float, float]
"""Least x and y, largest x and y, mm."""


class Front:
    """An edge of the stock; it does not change, and what is asked of it again is kept.

    Attributes
    ----------
    points : (n, 2) float array
        At least one, the stock on the right of their direction, mm.
    """

    def __init__(self, points: FloatArray) -> None:
        self.points = points

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def box(self) -> Box:
        """Box of its points."""
        return box(self.points)

    @cached_property
    def head(self) -> Box:
        """Box of the points beside which another front may end to be continued."""
        return box(self.points[:HEAD])

    @cached_property
    def length(self) -> float:
        """Length, mm."""
        return length(self.points)

    @cached_property
    def leave(self) -> float:
        """Direction in which it ends, radians."""
        return _direction(self.points[-4:])

    @cached_property
    def tree(self) -> cKDTree:
        """Of its points."""
        from scipy.spatial import cKDTree

        return cKDTree(self.points, compact_nodes=False, balanced_tree=False)


class Fronts:
    """Edges of the stock and their boxes, so that only those near a place are looked at.

    Attributes
    ----------
    items : tuple of Front
    """

    def __init__(self, fronts: Sequence[Front] = ()) -> None:
        self.items = tuple(fronts)
        self._boxes = np.array([front.box for front in self.items]).reshape(-1, 4)

    def near(self, around: Box, reach: float) -> list[int]:
        """Numbers of those whose boxes come within `reach` mm of a box."""
        return _overlapping(self._boxes, around, reach)

    def within(self, places: FloatArray, reach: float) -> BoolArray:
        """(n,) which places have a point of one of them nearer than `reach` mm."""
        result = np.zeros(len(places), dtype=bool)
        if not len(places):
            return result
        for number in self.near(box(places), reach):
            gap = self.items[number].tree.query(places, distance_upper_bound=reach)[0]
            result |= gap < np.inf
        return result


def box(points: FloatArray) -> Box:
    """Least x and y, largest x and y of points (n, 2), mm."""
    x, y = points[:, 0], points[:, 1]
    return float(x.min()), float(y.min()), float(x.max()), float(y.max())


def _overlapping(boxes: FloatArray, around: Box, reach: float) -> list[int]:
    """Rows of boxes (n, 4) that come within `reach` mm of a box."""
    left, low, right, high = around
    apart = (boxes[:, 2] < left - reach) | (boxes[:, 0] > right + reach)
    apart |= (boxes[:, 3] < low - reach) | (boxes[:, 1] > high + reach)
    return [int(row) for row in (~apart).nonzero()[0]]


def touched(places: FloatArray, front: Front, reach: float) -> IntArray:
    """Rows of the places that have a point of a front nearer than `reach`."""
    left, low, right, high = front.box
    x, y = places[:, 0], places[:, 1]
    around = (x > left - reach) & (x < right + reach) & (y > low - reach) & (y < high + reach)
    rows = around.nonzero()[0]
    gap = front.tree.query(places[rows], distance_upper_bound=reach)[0]
    return np.asarray(rows[gap < np.inf])


class Disks:
    """Growing set of disk centres, for distances: trees of doubling size."""

    def __init__(self) -> None:
        self._trees: list[tuple[FloatArray, cKDTree]] = []

    def add(self, centres: FloatArray) -> None:
        """Add (m, 2) centres, mm."""
        from scipy.spatial import cKDTree

        while self._trees and len(self._trees[-1][0]) < 2 * len(centres):
            centres = np.concatenate([self._trees.pop()[0], centres])
        tree = cKDTree(centres, compact_nodes=False, balanced_tree=False)
        self._trees.append((centres, tree))

    def distance(self, points: FloatArray, bound: float) -> FloatArray:
        """(n,) distance to the nearest centre, infinite beyond `bound` mm."""
        result = np.full(len(points), np.inf)
        for _, tree in self._trees:
            result = np.minimum(result, tree.query(points, distance_upper_bound=bound)[0])
        return result

    def nearest(self, point: FloatArray, count: int) -> FloatArray:
        """(m, 2) centres nearest to a point, nearest first; all if there are fewer, mm."""
        near = [
            centres[tree.query(point, k=range(1, min(count, len(centres)) + 1))[1]]
            for centres, tree in self._trees
        ]
        found = np.concatenate(near)
        order = np.argsort(np.hypot(*(found - point).T), kind="stable")
        return np.asarray(found[order[:count]])


def densified(points: FloatArray, step: float) -> FloatArray:
    """A chain of points with more between them, at most `step` mm apart."""
    gap = np.hypot(*np.diff(points, axis=0).T)
    owner, share = _subdivision(gap / step)
    inner = points[owner] + (points[owner + 1] - points[owner]) * share[:, None]
    return np.concatenate([points[:1], inner])


def _subdivision(pieces: FloatArray) -> tuple[IntArray, FloatArray]:
    """Piece and end fraction of every part when each piece is cut into ceil(pieces) equal ones."""
    count = np.maximum(1, np.ceil(pieces)).astype(np.int64)
    owner = np.repeat(np.arange(len(count)), count)
    first = np.repeat(np.cumsum(count) - count, count)
    return owner, (np.arange(len(owner)) - first + 1) / count[owner]


def swept_edge(centres: FloatArray, radius: float, step: float) -> tuple[FloatArray, IntArray]:
    """Right edge of what a disk sweeps along a chain, and the piece that each point belongs to.

    Straight pieces move it, at vertices it turns in place: left turns make arcs, right turns
    swallowtails for the caller to remove. Pieces are numbered by the point at which they begin;
    a turn belongs to the piece before it.

    Parameters
    ----------
    centres : (n, 2) float array
        At least two, mm.
    radius, step : float
        Of the disk; between points of the edge, mm.
    """
    chord = np.diff(centres, axis=0)
    # directions of the shortest pieces are noise
    number = np.flatnonzero(np.hypot(chord[:, 0], chord[:, 1]) > 1e-4 * radius)
    if not len(number):
        return np.zeros((0, 2)), number
    begin = centres[number]
    chord = np.concatenate([begin[1:], centres[-1:]]) - begin
    gap = np.hypot(chord[:, 0], chord[:, 1])
    heading = np.arctan2(chord[:, 1], chord[:, 0])
    bend = np.append(wrapped(np.diff(heading)), 0.0)
    arc = radius * np.abs(bend)
    owner, share = _subdivision((gap + arc) / step)
    straight = (gap / (gap + arc))[owner]
    moved = np.minimum(share / straight, 1.0)
    turned = np.maximum(share - straight, 0.0) / np.maximum(1 - straight, 1e-300)
    angle = np.concatenate([heading[:1], heading[owner] + bend[owner] * turned]) - np.pi / 2
    middle = np.concatenate([begin[:1], begin[owner] + chord[owner] * moved[:, None]])
    # right turns move the edge back: short folds along itself would look like its boundary
    size = np.where((moved == 1) & (bend[owner] < 0) & (turned > 0), -1.0, 1.0)
    along = np.cumsum(size * ((gap + arc) / np.maximum(1, np.ceil((gap + arc) / step)))[owner])
    behind = np.concatenate([[0.0], np.maximum.accumulate(along) - along])
    forward = (behind <= 0) | (behind > FOLD * step)
    edge = middle + radius * unit(angle)
    return edge[forward], number[np.concatenate([[0], owner])[forward]]


def runs(chain: FloatArray, good: BoolArray, gap: float) -> list[FloatArray]:
    """Maximal parts of a chain whose points are good and no more than `gap` mm apart."""
    index = np.flatnonzero(good)
    if not len(index):
        return []
    far = np.hypot(*np.diff(chain[index], axis=0).T) > gap
    breaks = np.flatnonzero((np.diff(index) > 1) | far) + 1
    return [chain[part] for part in np.split(index, breaks)]


def length(chain: FloatArray) -> float:
    """Of a chain of points, mm."""
    return float(np.hypot(*np.diff(chain, axis=0).T).sum())


def outside(
    fronts: Sequence[Front], centres: cKDTree, radius: float, gap: float
) -> list[list[Front]]:
    """Parts of each front outside all disks about some centres; untouched ones are themselves.

    Their points are no more than `gap` mm apart.
    """
    parts = [[front] for front in fronts]
    low, high = centres.mins.tolist(), centres.maxes.tolist()
    for number in Fronts(fronts).near((*low, *high), radius):
        chain = fronts[number].points
        free = np.isinf(centres.query(chain, distance_upper_bound=radius)[0])
        if not free.all():
            parts[number] = [Front(part) for part in runs(chain, free, gap)]
    return parts


def joined(
    fronts: Sequence[Front],
    radius: float,
    step: float,
    clearance: Clearances,
) -> list[Front]:
    """Fronts with those made one that continue each other without a sharp jut of stock.

    One continues another if it starts near its end, or runs along it there. A front that ends at
    a wall (`clearance` tells the distance of points from it) goes on only in the latter case: what
    begins beside it there is beyond a corner of the wall.
    """
    chains = list(fronts)
    while len(chains) > 1:
        best = _continuation(chains, radius, clearance)
        if best is None:
            break
        one, two, skip = best
        before, after = chains[one].points, chains[two].points
        between = densified(np.stack([before[-1], after[skip]]), step)
        chain = np.concatenate([before[:-1], between, after[skip + 1 :]])
        chains = [item for index, item in enumerate(chains) if index not in (one, two)]
        chains.append(Front(chain))
    return chains


def _continuation(
    chains: list[Front],
    radius: float,
    clearance: Clearances,
) -> tuple[int, int, int] | None:
    """The pair of chains that fits best, and the point of the second at which it goes on."""
    found = _neighbours(chains, radius)
    if not found:
        return None
    ends = np.array([chains[one].points[-1] for _, one, _, _ in found])
    walled = clearance(ends) < AT_WALL * radius
    for (_, one, two, skip), at_wall in zip(found, walled.tolist(), strict=True):
        if at_wall and skip == 0:
            continue
        before, after = chains[one], chains[two].points
        at = skip
        if at == 0:
            # what runs back beside the end of the first is left out
            ahead = (after[:8] - before.points[-1]) @ unit(before.leave)
            at = min(int(np.argmax(np.append(ahead > 0, True))), len(after) - 2)
        turn = float(wrapped(np.array(_direction(after[at : at + 4]) - before.leave)))
        if -JOIN_RIGHT <= turn <= JOIN_LEFT:
            return one, two, at
    return None


def _neighbours(chains: list[Front], radius: float) -> list[tuple[float, int, int, int]]:
    """Pairs of chains of which the second begins near the end of the first, the nearest first.

    Distance, numbers of both, and the point of the second at which it goes on beside the first, or
    0 where it begins there.
    """
    heads = np.array([chain.head for chain in chains])
    last = np.array([chain.points[-1] for chain in chains])
    reach = JOIN_GAP * radius
    apart = (heads[:, 2] < last[:, :1] - reach) | (heads[:, 0] > last[:, :1] + reach)
    apart |= (heads[:, 3] < last[:, 1:] - reach) | (heads[:, 1] > last[:, 1:] + reach)
    found = []
    for one, two in np.argwhere(~apart).tolist():
        if one == two:
            continue
        chain = chains[two].points
        head = chain[: min(HEAD, len(chain) - 2)] - last[one]
        gap = np.hypot(head[:, 0], head[:, 1])
        nearest = int(gap.argmin())
        if nearest and gap[nearest] <= 4 * GRAZE * radius:
            found.append((float(gap[nearest]), one, two, nearest))
        elif gap[0] <= reach:
            found.append((float(gap[0]), one, two, 0))
    return sorted(found)


def _direction(points: FloatArray) -> float:
    step = points[-1] - points[0]
    return float(np.arctan2(step[1], step[0]))
