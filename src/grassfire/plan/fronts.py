"""What has been cleared: a union of tool disks, and its edges against the stock (the fronts)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import overload

import numpy as np

from grassfire.plan.places import BoolArray, Box, IntArray, Places, box, few_nearest
from grassfire.plan.pursuit import unit, wrapped
from grassfire.toolpath import FloatArray

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
"""Where an edge runs back over itself by so many steps at most, the fold is left out."""

SPIKE, NEAR = -0.85, 5e-3
"""Cosine of the turn from which on a chain turns back at a point; chords that are shorter than this
part of the tool radius tell nothing of its direction."""

SLIVER = 20
"""Fronts of so few points are not searched for those near places."""

PAIRS = 6000
"""So many pairs of places and points are looked at one by one, more by trees."""

Clearances = Callable[[FloatArray], FloatArray]
"""Distance of points (n, 2) from the walls, (n,) mm."""


class Front:
    """An edge of the stock; it does not change, and what is asked of it again is kept.

    Attributes
    ----------
    points : (n, 2) float array
        At least one, the stock on the right of their direction, mm.
    settled : bool
        Whether it has been compared with the others that were there, for being continued.
    """

    def __init__(self, points: FloatArray) -> None:
        self.points = points
        self.settled = False
        self._end_clearance: float | None = None

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
        return direction(self.points[-4:])

    @cached_property
    def last(self) -> tuple[float, float]:
        """Last point, mm."""
        x, y = self.points[-1].tolist()
        return x, y

    def end_clearance(self, clearance: Clearances) -> float:
        """Distance of its last point from the walls, mm."""
        if self._end_clearance is None:
            self._end_clearance = float(clearance(self.points[-1:])[0])
        return self._end_clearance

    @cached_property
    def tree(self) -> Places:
        """Of its points."""
        return Places(self.points)


class Fronts(Sequence[Front]):
    """Edges of the stock and their boxes, so that only those near a place are looked at."""

    def __init__(self, fronts: Iterable[Front] = (), sides: FloatArray | None = None) -> None:
        self._items = tuple(fronts)
        # largest x and y, least x and y of each, the latter with the other sign
        self._sides = _sides(self._items) if sides is None else sides

    def __len__(self) -> int:
        return len(self._items)

    def __iter__(self) -> Iterator[Front]:
        return iter(self._items)

    @overload
    def __getitem__(self, index: int) -> Front: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Front, ...]: ...

    def __getitem__(self, index: int | slice) -> Front | tuple[Front, ...]:
        return self._items[index]

    def near(self, around: Box, reach: float) -> list[Front]:
        """Those whose boxes come within `reach` mm of a box."""
        return [self._items[row] for row in self._rows(around, reach)]

    def within(self, places: FloatArray, reach: float) -> BoolArray:
        """(n,) which places have a point of one of them nearer than `reach` mm."""
        if not len(places):
            return np.zeros(0, dtype=bool)
        around = box(places)
        return touching(places, around, [(front, reach) for front in self.near(around, reach)])

    def about(self, places: FloatArray, reach: float) -> FloatArray:
        """(m, 2) points of all that may be nearer than `reach` mm to some places."""
        around = box(places)
        found = [
            front.points.take(_around(front.points, around, reach).nonzero()[0], axis=0)
            for front in self.near(around, reach)
        ]
        return np.concatenate(found) if found else np.zeros((0, 2))

    def without(self, index: int) -> Fronts:
        """All but one."""
        items = self._items[:index] + self._items[index + 1 :]
        return Fronts(items, np.delete(self._sides, index, axis=1))

    def plus(self, fronts: Sequence[Front]) -> Fronts:
        """These and more."""
        if not fronts:
            return self
        sides = np.concatenate([self._sides, _sides(fronts)], axis=1)
        return Fronts((*self._items, *fronts), sides)

    def outside(self, centres: Places, radius: float, gap: float) -> Fronts:
        """Their parts outside all disks about some centres; untouched ones are themselves.

        Their points are no more than `gap` mm apart.
        """
        parts: dict[int, list[Front]] = {}
        for row in self._rows(centres.box, radius):
            chain = self._items[row].points
            covered = centres.near(chain, radius)
            if covered.any():
                parts[row] = [Front(part) for part in runs(chain, ~covered, gap)]
        if not parts:
            return self
        return Fronts(
            part for row, front in enumerate(self._items) for part in parts.get(row, [front])
        )

    def _rows(self, around: Box, reach: float) -> list[int]:
        left, low, right, high = around
        least = [[left - reach], [low - reach], [-right - reach], [-high - reach]]
        near = np.all(self._sides >= least, axis=0).nonzero()[0]
        return [int(row) for row in near]


def _sides(fronts: Sequence[Front]) -> FloatArray:
    """(4, n) largest x and y, least x and y of each, the latter with the other sign, mm."""
    sides = [(right, high, -left, -low) for left, low, right, high in (it.box for it in fronts)]
    return np.array(sides).reshape(-1, 4).T


def _around(places: FloatArray, sides: Box, reach: float) -> BoolArray:
    """(n,) which places are nearer than `reach` mm to a box, seen along both axes."""
    left, low, right, high = sides
    x, y = places[:, 0], places[:, 1]
    return (x > left - reach) & (x < right + reach) & (y > low - reach) & (y < high + reach)


def touching(places: FloatArray, around: Box, fronts: Sequence[tuple[Front, float]]) -> BoolArray:
    """(n,) which places in a box have a point of a front nearer than the reach given with it."""
    result = np.zeros(len(places), dtype=bool)
    few = []
    for front, reach in fronts:
        points = front.points
        if len(points) > SLIVER:
            points = points.take(_around(points, around, reach).nonzero()[0], axis=0)
        if len(points) * len(places) > PAIRS:
            result[touched(places, front, reach)] = True
        elif len(points):
            few.append((points, reach))
    if few:
        points = np.concatenate([points for points, _ in few])
        square = np.array([reach**2 for _, reach in few]).repeat([len(it) for it, _ in few])
        result |= (squares(places, points) < square).any(axis=1)
    return result


def squares(places: FloatArray, points: FloatArray) -> FloatArray:
    """(n, m) squared distances of places (n, 2) from points (m, 2), mm2."""
    across = places[:, :1] - points[:, 0]
    along = places[:, 1:] - points[:, 1]
    across *= across
    along *= along
    across += along
    return across


def touched(places: FloatArray, front: Front, reach: float) -> IntArray:
    """Rows of the places that have a point of a front nearer than `reach`."""
    rows = _around(places, front.box, reach).nonzero()[0]
    if not len(rows):
        return np.asarray(rows)
    return np.asarray(rows[front.tree.near(places.take(rows, axis=0), reach)])


class Disks:
    """Growing set of disk centres, for distances: trees of doubling size."""

    def __init__(self) -> None:
        self._trees: list[Places] = []

    def add(self, centres: FloatArray) -> None:
        """Add (m, 2) centres, mm."""
        while self._trees and len(self._trees[-1]) < 2 * len(centres):
            centres = np.concatenate([self._trees.pop().points, centres])
        self._trees.append(Places(centres))

    def within(self, points: FloatArray, reach: float) -> BoolArray:
        """(n,) which points have a centre nearer than `reach` mm."""
        result = np.zeros(len(points), dtype=bool)
        if not len(points):
            return result
        rows = np.arange(len(points))
        left, low, right, high = box(points)
        # those in the cleared area have one of the last centres near them more often than not
        for tree in reversed(self._trees):
            least_x, least_y, most_x, most_y = tree.box
            across = least_x <= right + reach and most_x >= left - reach
            if across and least_y <= high + reach and most_y >= low - reach:
                near = tree.near(points, reach)
                result[rows[near]] = True
                far = ~near
                rows, points = rows[far], points[far]
                if not len(rows):
                    break
        return result

    def nearest(self, point: FloatArray, count: int) -> FloatArray:
        """(m, 2) centres nearest to a point, nearest first; all if there are fewer, mm."""
        centres = np.concatenate([tree.points for tree in self._trees])
        return np.asarray(centres[few_nearest(centres, point, count)[1]])


def densified(points: FloatArray, step: float) -> FloatArray:
    """A chain of points with more between them, at most `step` mm apart."""
    chord = points[1:] - points[:-1]
    owner, share = _subdivision(np.hypot(chord[:, 0], chord[:, 1]) / step)
    inner = points.take(owner, axis=0)
    inner += chord.take(owner, axis=0) * share[:, None]
    return np.concatenate([points[:1], inner])


def _subdivision(pieces: FloatArray) -> tuple[IntArray, FloatArray]:
    """Piece and end fraction of every part when each piece is cut into ceil(pieces) equal ones."""
    count = np.maximum(1, np.ceil(pieces)).astype(np.int64)
    owner = np.arange(len(count)).repeat(count)
    rank = np.arange(1, len(owner) + 1) - (count.cumsum() - count).take(owner)
    return owner, rank / count.take(owner)


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
    chord = centres[1:] - centres[:-1]
    # directions of the shortest pieces are noise
    number = (np.hypot(chord[:, 0], chord[:, 1]) > 1e-4 * radius).nonzero()[0]
    if not len(number):
        return np.zeros((0, 2)), number
    begin = centres.take(number, axis=0)
    chord = np.concatenate([begin[1:], centres[-1:]]) - begin
    gap = np.hypot(chord[:, 0], chord[:, 1])
    heading = np.arctan2(chord[:, 1], chord[:, 0])
    bend = np.zeros(len(heading))
    bend[:-1] = wrapped(heading[1:] - heading[:-1])
    size = gap + radius * np.abs(bend)
    owner, share = _subdivision(size / step)
    straight = (gap / size).take(owner)
    moved = np.minimum(share / np.maximum(straight, 1e-300), 1.0)
    turned = np.maximum(share - straight, 0.0) / np.maximum(1 - straight, 1e-300)
    bend = bend.take(owner)
    angle = heading.take(owner) + bend * turned
    middle = begin.take(owner, axis=0)
    middle += chord.take(owner, axis=0) * moved[:, None]
    # right turns move the edge back: what they add themselves is never part of the outline, and
    # short folds along itself would look like it
    part = (size / np.maximum(1, np.ceil(size / step))).take(owner)
    back = (moved == 1) & (bend < 0) & (turned > 0)
    along = np.where(back, -part, part).cumsum()
    behind = np.maximum.accumulate(along) - along
    before = along - np.minimum.accumulate(along[::-1])[::-1]
    kept = _unfolded(behind, FOLD * step) & _unfolded(before, FOLD * step)
    forward = (kept & ~back).nonzero()[0]
    edge = middle.take(forward, axis=0) + radius * unit(angle.take(forward) - np.pi / 2)
    first = begin[:1] + radius * unit(heading[:1] - np.pi / 2)
    owner = number.take(owner.take(forward))
    return np.concatenate([first, edge]), np.concatenate([number[:1], owner])


def _unfolded(overlap: FloatArray, deepest: float) -> BoolArray:
    """(n,) where a way that runs back over itself by these lengths is on its outline.

    Both sides of a fold cross half way. Of folds that are deeper than `deepest` all is kept.
    """
    inside = overlap > 0
    begin = (inside & ~np.concatenate([[False], inside[:-1]])).nonzero()[0]
    if not len(begin):
        return ~inside
    depth = np.maximum.reduceat(overlap, begin)
    depth[depth > deepest] = np.inf
    fold = np.maximum(np.cumsum(np.bincount(begin, minlength=len(overlap))) - 1, 0)
    return np.asarray(overlap <= depth.take(fold) / 2)


def runs(chain: FloatArray, good: BoolArray, gap: float) -> list[FloatArray]:
    """Maximal parts of a chain whose points are good and no more than `gap` mm apart."""
    index = good.nonzero()[0]
    if not len(index):
        return []
    kept = chain.take(index, axis=0)
    step = kept[1:] - kept[:-1]
    broken = np.hypot(step[:, 0], step[:, 1]) > gap
    broken |= index[1:] - index[:-1] > 1
    stops = [*(broken.nonzero()[0] + 1).tolist(), len(kept)]
    return [kept[low:high] for low, high in zip([0, *stops], stops, strict=False)]


def unspiked(chain: FloatArray, least: float) -> FloatArray:
    """A chain without points at which it turns back, nor inner ones `least` mm from the one before.

    Of a run of such near ones every other stays, as long as there are any.
    """
    while len(chain) > 2:
        chord = chain[1:] - chain[:-1]
        size = np.hypot(chord[:, 0], chord[:, 1])
        along = (chord[1:] * chord[:-1]).sum(axis=1)
        short = size[:-1] <= least
        short[-1] |= size[-1] <= least
        back = along < SPIKE * size[1:] * size[:-1]
        rank = np.arange(len(short))
        rank -= np.maximum.accumulate(np.where(short, -1, rank))
        back |= short & (rank % 2 == 1)
        if not back.any():
            break
        chain = np.delete(chain, back.nonzero()[0] + 1, axis=0)
    return chain


def length(chain: FloatArray) -> float:
    """Of a chain of points, mm."""
    step = chain[1:] - chain[:-1]
    return float(np.hypot(step[:, 0], step[:, 1]).sum())


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
        chain = unspiked(chain, NEAR * radius)
        chains = [item for index, item in enumerate(chains) if index not in (one, two)]
        chains.append(Front(chain))
    for front in chains:
        front.settled = True
    return chains


def _continuation(
    chains: list[Front],
    radius: float,
    clearance: Clearances,
) -> tuple[int, int, int] | None:
    """The pair of chains that fits best, and the point of the second at which it goes on."""
    for _, one, two, skip in _neighbours(chains, radius):
        before, after = chains[one], chains[two].points
        at = skip
        if at == 0:
            # what runs back beside the end of the first is left out
            ahead = (after[:8] - before.points[-1]) @ unit(before.leave)
            at = min(int(np.argmax(np.append(ahead > 0, True))), len(after) - 2)
        turn = wrapped(direction(after[at : at + 4]) - before.leave)
        if not -JOIN_RIGHT <= turn <= JOIN_LEFT:
            continue
        if skip or before.end_clearance(clearance) >= AT_WALL * radius:
            return one, two, at
    return None


def _neighbours(chains: list[Front], radius: float) -> list[tuple[float, int, int, int]]:
    """Pairs of chains of which the second begins near the end of the first, the nearest first.

    Distance, numbers of both, and the point of the second at which it goes on beside the first, or
    0 where it begins there.
    """
    reach = JOIN_GAP * radius
    # those that are settled both have been refused before
    fresh = [index for index, chain in enumerate(chains) if not chain.settled]
    pairs = set()
    for own in fresh:
        x, y = chains[own].last
        for two, chain in enumerate(chains):
            left, low, right, high = chain.head
            if left - reach <= x <= right + reach and low - reach <= y <= high + reach:
                pairs.add((own, two))
        left, low, right, high = chains[own].head
        for one, chain in enumerate(chains):
            x, y = chain.last
            if left - reach <= x <= right + reach and low - reach <= y <= high + reach:
                pairs.add((one, own))
    found = []
    for one, two in pairs:
        if one == two:
            continue
        before, after = chains[one].points, chains[two].points
        head = after[: min(HEAD, len(after) - 2)]
        gap = np.hypot(*(head - before[-1]).T)
        nearest = int(gap.argmin())
        along = nearest > 0 and gap[nearest] <= 4 * GRAZE * radius
        # what is left out of the second is beside the first: all else is an edge of stock
        if along and squares(head[:nearest], before).min(axis=1).max() <= reach**2:
            found.append((float(gap[nearest]), one, two, nearest))
        elif gap[0] <= reach:
            found.append((float(gap[0]), one, two, 0))
    return sorted(found)


def leaving(points: FloatArray, least: float) -> float:
    """Direction in which a chain leaves its first point: that of the first one `least` mm off."""
    offset = points - points[0]
    far = np.hypot(offset[:, 0], offset[:, 1]) >= least
    x, y = offset[int(far.argmax()) if far.any() else -1].tolist()
    return math.atan2(y, x)


def direction(points: FloatArray) -> float:
    """Of the chord of a chain, radians."""
    x, y = (points[-1] - points[0]).tolist()
    return math.atan2(y, x)
