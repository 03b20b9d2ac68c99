"""A tree of the axis cut into lobes, each to be cleared by a spiral of its own, where that is
shorter, and the trunk that suits each lobe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from grassfire.plan.places import BoolArray
from grassfire.plan.spiral_tree import Branch, Chain, centre_of, node_near, rooted
from grassfire.plan.spiral_wave import heights, without_needles
from grassfire.toolpath import FloatArray

TRUNKS = (np.inf, 1.45, 1.65, 1.9, 2.2, 2.6, 3.2, 4.0)
"""Heights that are tried for the trunk, as parts of the largest room: all above the diagonal of a
square, so that no trunk runs into right corners. The first is the spiral about a point."""

SLOT = 3.0
"""How many times a length of the first lap, in a full slot, counts when plans are compared."""

NECK = 0.75
"""Necks are tried where the room is less than this part of that on both sides."""

MOUTH = 0.6
"""Corridors are tried where they have less than this part of the largest room elsewhere."""

EVEN = 0.95
"""A corridor's room is at least this part of the largest farther on where it begins."""

LONG = 3.0
"""Length of a corridor worth a spiral of its own, in its room."""

CLEAR_OF_CUTS = 1.0
"""Least way from a trunk to a cut across the region, in radii of the tube."""

CROWDED = 100.0
"""How many times more a plan counts that comes nearer."""

CANDIDATES = 6
"""Most places that are tried before a lobe counts as one."""


@dataclass(frozen=True)
class Sizes:
    """What the cost of a spiral depends on, mm.

    Attributes
    ----------
    spacing, tube : float
        Distance of laps, and the radius of the tube about a trunk.
    narrow : float
        Room up to which a wall lap clears all.
    entry : float
        What another descent with its way there costs, as a length of cut.
    """

    spacing: float
    tube: float
    narrow: float
    entry: float


@dataclass(frozen=True)
class Lobe:
    """A tree, from the place that is best for its spiral.

    Attributes
    ----------
    branches : list of Branch
        Without needles.
    cut : list of (2,) bool arrays
        Whether the wall does not go round the start and the end of each.
    trunk : float
        Height from which on the axis belongs to the trunk, mm.
    cost : float
        mm.
    """

    branches: list[Branch]
    cut: list[BoolArray]
    trunk: float
    cost: float


def lobe(chains: Sequence[Chain], nodes: int, sizes: Sizes) -> Lobe | None:
    """A tree as one lobe; None where wall laps clear all of it."""
    if max(float(chain.room.max()) for chain in chains) <= sizes.narrow:
        return None
    centred, root, _ = centre_of(chains, nodes)
    branches, cut = without_needles(rooted(centred, root), sizes.narrow, sizes.spacing)
    height = heights(branches)
    widest = max(float(branch.chain.room.max()) for branch in branches)
    wall = sum(_walls(branch.chain) for branch in branches)
    best: tuple[float, float] | None = None
    for part in TRUNKS:
        limit = part * widest
        trunk = _trunk_length(branches, height, limit)
        if np.isfinite(part) and trunk < 2 * sizes.tube:
            continue
        farthest = max(float(np.max(item, where=item < limit, initial=0.0)) for item in height)
        turns = max(max(farthest, widest) - sizes.tube, 0.0) / sizes.spacing
        begin = 2 * trunk + 2 * np.pi * sizes.tube
        cost = turns * (begin + wall) / 2 + SLOT * begin
        if _crowded(branches, height, limit, CLEAR_OF_CUTS * sizes.tube):
            cost = max(cost, 1.0) * CROWDED
        if best is None or cost < best[0]:
            best = cost, limit
    assert best is not None
    return Lobe(branches, cut, best[1], best[0])


def _crowded(
    branches: Sequence[Branch], height: Sequence[FloatArray], limit: float, least: float
) -> bool:
    """Whether a cut across the region is nearer to the trunk than `least` mm along the axis."""
    for index, branch in enumerate(branches):
        if not branch.chain.closed[1]:
            continue
        above = index
        while branches[above].parent >= 0 and height[above][0] < limit:
            above = branches[above].parent
        inside = int(np.sum(height[above] >= limit))
        begin = branches[above].depth[max(inside - 1, 0)]
        if branch.depth[-1] - begin < least:
            return True
    return False


def _trunk_length(branches: Sequence[Branch], height: Sequence[FloatArray], limit: float) -> float:
    total = 0.0
    for branch, high in zip(branches, height, strict=True):
        inside = int(np.sum(high >= limit))
        if inside:
            total += float(branch.depth[inside - 1] - branch.depth[0])
    return total


def _walls(chain: Chain) -> float:
    """Length of the wall on both sides of a chain, mm."""
    sides = [chain.centre + chain.room[:, None] * side for side in (chain.right, chain.left)]
    return float(sum(np.sum(np.hypot(*np.diff(side, axis=0).T)) for side in sides))


def lobes(chains: Sequence[Chain], nodes: int, sizes: Sizes) -> list[Lobe]:
    """A tree cut where separate spirals are shorter than one, in a fixed order."""
    result: list[Lobe] = []
    pending = [(list(chains), nodes)]
    while pending:
        tree, count = pending.pop()
        whole = lobe(tree, count, sizes)
        if whole is None:
            continue
        for place in _candidates(tree, count):
            one, other, more = _parted(tree, count, place)
            parts = [lobe(part, more, sizes) for part in (one, other)]
            cost = sum(part.cost for part in parts if part is not None)
            if all(part is not None for part in parts):
                cost += sizes.entry
            if cost < whole.cost:
                pending += [(one, more), (other, more)]
                break
        else:
            result.append(whole)
    return result


def _candidates(chains: Sequence[Chain], nodes: int) -> list[FloatArray]:
    """Places of necks and of the mouths of corridors, those that promise most first."""
    widest = max(chains, key=lambda chain: float(chain.room.max()))
    rest, root, _ = node_near(list(chains), widest.centre[int(np.argmax(widest.room))], nodes)
    branches = rooted(rest, root)
    beyond, elsewhere = _largest(branches)
    height = heights(branches)
    wall = _walls_beyond(branches)
    farthest = float(height[0][0])
    found: list[tuple[float, FloatArray]] = []
    for index, branch in enumerate(branches):
        room, inner = branch.chain.room, slice(2, -2)
        if len(room) < 6:
            continue
        here, there = elsewhere[index], beyond[index]
        # the middle of a corridor of even width
        lowest = np.flatnonzero(room[inner] <= room[inner].min() + 1e-6) + 2
        least = int(lowest[len(lowest) // 2])
        places = [least] if room[least] < NECK * min(here[least], there[least]) else []
        mouth = (room < MOUTH * here) & (room > EVEN * there)
        mouth &= height[index] - room > LONG * room
        places += (np.flatnonzero(mouth[inner])[:1] + 2).tolist()
        for place in places:
            share = 1.0 - place / (len(room) - 1)
            beside = wall[index][0] + share * (wall[index][1] - wall[index][0])
            saved = beside * (farthest - there[place])
            found.append((-float(saved), branch.chain.centre[place]))
    found.sort(key=lambda item: item[0])
    return [place for _, place in found[:CANDIDATES]]


def _walls_beyond(branches: Sequence[Branch]) -> list[tuple[float, float]]:
    """Length of the wall beyond the end of each branch, and beyond its start, mm."""
    total = np.zeros(len(branches))
    result: list[tuple[float, float]] = [(0.0, 0.0)] * len(branches)
    for index in range(len(branches) - 1, -1, -1):
        branch = branches[index]
        result[index] = (float(total[index]), float(total[index]) + _walls(branch.chain))
        if branch.parent >= 0:
            total[branch.parent] += result[index][1]
    return result


def _largest(branches: Sequence[Branch]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Largest room from each sample on, and before it on the way from the root."""
    last = np.zeros(len(branches))
    beyond: list[FloatArray] = [np.zeros(0)] * len(branches)
    before: list[FloatArray] = []
    for index in range(len(branches) - 1, -1, -1):
        room = branches[index].chain.room.copy()
        room[-1] = max(room[-1], last[index])
        beyond[index] = np.maximum.accumulate(room[::-1])[::-1]
        parent = branches[index].parent
        if parent >= 0:
            last[parent] = max(last[parent], float(beyond[index][0]))
    for branch in branches:
        room = branch.chain.room.copy()
        if branch.parent >= 0:
            room[0] = max(room[0], float(before[branch.parent][-1]))
        before.append(np.maximum.accumulate(room))
    return beyond, before


def _parted(
    chains: Sequence[Chain], nodes: int, place: FloatArray
) -> tuple[list[Chain], list[Chain], int]:
    """Two trees, cut across at the sample that is nearest to a place."""
    rest, node, nodes = node_near(list(chains), place, nodes)
    sides: list[list[Chain]] = [[], []]
    owners: list[int] = []
    for branch in rooted(rest, node):
        chain = branch.chain
        if branch.parent >= 0:
            owner = owners[branch.parent]
        else:
            owner = min(len(owners), 1)
            chain = replace(chain, start=nodes + owner, closed=(True, chain.closed[1]))
        owners.append(owner)
        sides[owner].append(chain)
    return sides[0], sides[1], nodes + 2


__all__ = ["Lobe", "Sizes", "lobe", "lobes"]
