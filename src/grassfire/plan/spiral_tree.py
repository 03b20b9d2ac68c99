"""The axis where the tool fits as sampled chains, opened to a tree, and the walk around it.

Every place of the axis sees the wall on both of its sides. Walking once around a tree, the axis on
the left, visits every place twice, once for each side: in the order of the wall.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from grassfire.medial import AxisGraph, MedialAxis
from grassfire.plan.places import BoolArray, IntArray
from grassfire.toolpath import FloatArray

COARSE = 17
"""Places on a stretch from which its length and that of the wall beside it are estimated."""

SAME_CONTACT = 1e-4
"""Contacts in directions that differ by less are one, as lengths of unit vectors."""

NO_FAN = 1e-6
"""Contact arcs of a smaller angle are single contacts, radians."""

ALL_ROUND = 2 * np.pi - 1e-3
"""Larger angles from one contact to the next are rounding of none, radians."""


@dataclass(frozen=True)
class Chain:
    """A stretch of the axis as samples, from one node to another.

    Attributes
    ----------
    start, end : int
        Nodes.
    centre : (n, 2) float array
        Places on the axis, mm.
    room : (n,) float array
        How far the tool can go from there to the wall, mm: the clearance less that of the wall.
    right, left : (n, 2) float arrays
        Unit vectors to the contacts on either side of the direction of the chain.
    closed : (bool, bool)
        Whether its start and end are cuts across the region, where the wall does not go round.
    """

    start: int
    end: int
    centre: FloatArray
    room: FloatArray
    right: FloatArray
    left: FloatArray
    closed: tuple[bool, bool] = (False, False)

    @cached_property
    def along(self) -> FloatArray:
        """(n,) length of the axis from the start, mm."""
        steps = np.hypot(*np.diff(self.centre, axis=0).T)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def reversed(self) -> Chain:
        """The same stretch from its end."""
        return Chain(
            self.end, self.start, self.centre[::-1], self.room[::-1],
            self.left[::-1], self.right[::-1], self.closed[::-1],
        )  # fmt: skip

    def part(self, first: int, last: int, start: int, end: int) -> Chain:
        """Samples `first` to `last` inclusive, between other nodes."""
        rows = slice(first, last + 1)
        closed = (self.closed[0] and first == 0, self.closed[1] and last == len(self.room) - 1)
        return Chain(
            start, end, self.centre[rows], self.room[rows], self.right[rows], self.left[rows],
            closed,
        )  # fmt: skip


# -- sampling -------------------------------------------------------------------------------------


def sampled_chains(axis: MedialAxis, graph: AxisGraph, wall: float, step: float) -> list[Chain]:
    """All stretches of a graph as chains.

    Parameters
    ----------
    axis : MedialAxis
    graph : AxisGraph
        Its part with r >= `wall`.
    wall, step : float
        Samples are about `step` mm apart at most, on the axis and on the wall on both sides.
    """
    if not len(graph.edge):
        return []
    count = np.full(len(graph.edge), COARSE)
    owner = np.repeat(np.arange(len(count)), COARSE)
    share = np.tile(np.linspace(0.0, 1.0, COARSE), len(count))
    centre, room, right, left = _touching(axis, graph, wall, owner, share)
    walls = [centre, centre + room[:, None] * right, centre + room[:, None] * left]
    moved = np.max([np.hypot(*np.diff(points, axis=0).T) for points in walls], axis=0)
    moved = np.concatenate([moved, [0.0]]).reshape(-1, COARSE)[:, :-1]
    # even steps where nothing moves
    moved = moved + 1e-9 + 1e-3 * moved.sum(axis=1, keepdims=True) / COARSE
    reach = np.concatenate([np.zeros((len(count), 1)), np.cumsum(moved, axis=1)], axis=1)
    total = reach[:, -1]
    count = np.maximum(4, np.ceil(total / step).astype(np.int64) + 1)
    owner = np.repeat(np.arange(len(count)), count)
    index = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    wanted = index / (count[owner] - 1)
    # one interpolation for all: stretch k lives on [2 k, 2 k + 1]
    lanes = 2.0 * np.arange(len(count))
    place = np.interp(
        wanted + lanes[owner],
        (reach / total[:, None] + lanes[:, None]).ravel(),
        (np.linspace(0.0, 1.0, COARSE) + lanes[:, None]).ravel(),
    )
    share = np.where(index == 0, 0.0, np.where(wanted == 1.0, 1.0, place - lanes[owner]))
    columns = _touching(axis, graph, wall, owner, np.clip(share, 0.0, 1.0))
    bounds = np.concatenate([[0], np.cumsum(count)])
    ends = zip(graph.start.tolist(), graph.end.tolist(), strict=True)
    result: list[Chain] = []
    for row, (start, end) in enumerate(ends):
        mine = slice(bounds[row], bounds[row + 1])
        centre, room, right, left = (column[mine] for column in columns)
        result.append(Chain(start, end, centre, room, right, left))
    return result


def _touching(
    axis: MedialAxis, graph: AxisGraph, wall: float, owner: IntArray, share: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Centres, room, and unit vectors to both contacts, at shares of stretches."""
    fraction = graph.low[owner] + (graph.high - graph.low)[owner] * share
    fraction = np.where(share == 1.0, graph.high[owner], fraction)
    row = axis.table.row[graph.edge[owner]]
    disks, facing = axis.walker.exact(row, fraction)
    span = axis.span.take(row)
    own = span.parameter(fraction[:, None])[:, 0]
    feet = axis.sites.point(span.site, own), axis.sites.point(span.partner, facing)
    centre = disks[:, :2]
    units = [(foot - centre) / disks[:, 2:] for foot in feet]
    units = [unit / np.hypot(*unit.T)[:, None] for unit in units]
    room = np.maximum(disks[:, 2] - wall, 0.0)
    # the boundary of a site runs with the region on its left: its contact is on the right
    return centre + axis.sites.origin, room, units[0], units[1]


def joined(chains: Sequence[Chain]) -> list[Chain]:
    """Chains that meet two at a node, with the same contacts there, made one."""
    at: dict[int, list[int]] = {}
    for index, chain in enumerate(chains):
        at.setdefault(chain.start, []).append(index)
        at.setdefault(chain.end, []).append(index)
    done: set[int] = set()
    result: list[Chain] = []
    for index in range(len(chains)):
        if index in done:
            continue
        done.add(index)
        run = [chains[index]]
        for _ in range(2):
            while (following := _following(run[-1], chains, at, done)) is not None:
                run.append(following)
            run = [chain.reversed() for chain in reversed(run)]
        result.append(_concatenated(run))
    return result


def without_stubs(chains: Sequence[Chain], most: float) -> list[Chain]:
    """Chains without dead ends that lead hardly further than the disk at their beginning.

    Every corner between the short lines that stand for a curve has one. Laps drawn out into each
    would swing in and out; the wall lap clears what is left there.

    Parameters
    ----------
    chains : sequence of Chain
    most : float
        How much further than the disk dead ends may lead that are left out, mm.
    """
    alive = list(chains)
    beyond: dict[int, float] = {}
    while True:
        degree = Counter(node for chain in alive for node in (chain.start, chain.end))
        kept = []
        for chain in alive:
            loose = [
                way
                for way, node in ((chain.reversed(), chain.start), (chain, chain.end))
                if degree[node] == 1
            ]
            if not loose or any(chain.closed):
                kept.append(chain)
                continue
            # from the narrower end, where both are loose
            way = min(loose, key=lambda it: float(it.room[-1]))
            reach = way.along + way.room
            reach[-1] += beyond.get(way.end, 0.0)
            rise = float(reach.max() - way.room[0])
            if rise > most:
                kept.append(chain)
            else:
                beyond[way.start] = max(beyond.get(way.start, 0.0), rise)
        if len(kept) == len(alive):
            return kept
        alive = kept


def _following(
    chain: Chain, chains: Sequence[Chain], at: dict[int, list[int]], done: set[int]
) -> Chain | None:
    """The only chain that goes on at the end of another, marked as done."""
    around = at[chain.end]
    if len(around) != 2:
        return None
    rest = [index for index in around if index not in done]
    if len(rest) != 1:
        return None
    other = chains[rest[0]]
    if other.start != chain.end:
        other = other.reversed()
    turns = np.abs([other.right[0] - chain.right[-1], other.left[0] - chain.left[-1]])
    if turns.max() > SAME_CONTACT:
        return None
    done.add(rest[0])
    return other


def _concatenated(run: Sequence[Chain]) -> Chain:
    """Chains that follow each other as one."""
    if len(run) == 1:
        return run[0]
    centre, room, right, left = (
        np.concatenate([getattr(run[0], name), *(getattr(chain, name)[1:] for chain in run[1:])])
        for name in ("centre", "room", "right", "left")
    )
    closed = (run[0].closed[0], run[-1].closed[1])
    return Chain(run[0].start, run[-1].end, centre, room, right, left, closed)


# -- opening --------------------------------------------------------------------------------------


def opened(chains: Sequence[Chain], nodes: int) -> tuple[list[Chain], int]:
    """Chains without loops: each loop is cut across at its narrowest place.

    Kruskal's tree of the widest chains keeps, for every loop, all but the narrowest.

    Returns
    -------
    chains : list of Chain
    nodes : int
        Count of nodes with those that cuts added.
    """
    parent = list(range(nodes))

    def root(node: int) -> int:
        while parent[node] != node:
            parent[node] = parent[parent[node]]
            node = parent[node]
        return node

    narrow = [float(chain.room.min()) for chain in chains]
    result: list[Chain] = []
    for index in sorted(range(len(chains)), key=lambda row: -narrow[row]):
        chain = chains[index]
        one, two = root(chain.start), root(chain.end)
        if one != two:
            parent[one] = two
            result.append(chain)
            continue
        last = len(chain.room) - 1
        place = min(max(int(np.argmin(chain.room)), 1), last - 1)
        for half in (
            chain.part(0, place, chain.start, nodes),
            chain.part(place, last, nodes + 1, chain.end).reversed(),
        ):
            result.append(replace(half, closed=(half.closed[0], True)))
        nodes += 2
    return result, nodes


def split(chains: Sequence[Chain], index: int, place: int, node: int) -> list[Chain]:
    """Chain `index` as two that meet at a new node, sample `place` (not an end)."""
    chain = chains[index]
    halves = [
        chain.part(0, place, chain.start, node),
        chain.part(place, len(chain.room) - 1, node, chain.end),
    ]
    return [*chains[:index], *halves, *chains[index + 1 :]]


# -- rooted trees ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Branch:
    """A chain that leads away from the root.

    Attributes
    ----------
    chain : Chain
    parent : int
        Branch that it continues, -1 at the root.
    depth : (n,) float array
        Length of the axis from the root, mm.
    """

    chain: Chain
    parent: int
    depth: FloatArray


def rooted(chains: Sequence[Chain], root: int) -> list[Branch]:
    """Chains of the tree at a node, in an order in which parents come first."""
    at: dict[int, list[int]] = {}
    for index, chain in enumerate(chains):
        at.setdefault(chain.start, []).append(index)
        at.setdefault(chain.end, []).append(index)
    result: list[Branch] = []
    done: set[int] = set()
    queue = [(root, -1, 0.0)]
    while queue:
        node, parent, depth = queue.pop(0)
        for index in at.get(node, []):
            if index in done:
                continue
            done.add(index)
            chain = chains[index]
            if chain.start != node:
                chain = chain.reversed()
            reach = depth + chain.along
            result.append(Branch(chain, parent, reach))
            queue.append((chain.end, len(result) - 1, float(reach[-1])))
    return result


def centre_of(chains: Sequence[Chain], nodes: int) -> tuple[list[Chain], int, int]:
    """The place from which the farthest wall is nearest, as a node.

    Ways lead along the axis, then straight to the wall. The middle of the longest way between two
    walls is that place; its ends are found by going to the farthest wall twice.

    Returns
    -------
    chains : list of Chain
        Cut there.
    root : int
    nodes : int
    """
    begin, reserve = chains[0].start, 0.0
    result = list(chains)
    for _ in range(2):
        branches = rooted(result, begin)
        totals = [float((branch.depth + branch.chain.room).max()) for branch in branches]
        far = int(np.argmax(totals))
        branch = branches[far]
        place = int(np.argmax(branch.depth + branch.chain.room))
        most, started = totals[far], reserve
        reserve = float(branch.chain.room[place])
        last_branches, last = branches, (far, place)
        result, begin, nodes = _node_at(result, branch.chain, place, nodes)
    half = (most - started) / 2
    far, _ = last
    # from one end of the longest way: half of it, less what leads from the wall to the axis
    while last_branches[far].parent >= 0 and last_branches[far].depth[0] > half:
        far = last_branches[far].parent
    branch = last_branches[far]
    place = int(np.argmin(np.abs(branch.depth - half)))
    root_place = branch.chain.centre[place]
    return node_near(result, root_place, nodes)


def _node_at(
    chains: list[Chain], chain: Chain, place: int, nodes: int
) -> tuple[list[Chain], int, int]:
    """A sample of a chain as a node, the chain cut in two if it is none yet."""
    if place == 0:
        return chains, chain.start, nodes
    if place == len(chain.room) - 1:
        return chains, chain.end, nodes
    index = next(
        row
        for row, other in enumerate(chains)
        if {other.start, other.end} == {chain.start, chain.end}
        and len(other.room) == len(chain.room)
    )
    if chains[index].start != chain.start:
        place = len(chain.room) - 1 - place
    return split(chains, index, place, nodes), nodes, nodes + 1


def node_near(chains: list[Chain], point: FloatArray, nodes: int) -> tuple[list[Chain], int, int]:
    """The sample nearest to a point as a node."""
    gaps = [np.hypot(*(chain.centre - point).T) for chain in chains]
    index = int(np.argmin([gap.min() for gap in gaps]))
    return _node_at(chains, chains[index], int(np.argmin(gaps[index])), nodes)


# -- the walk around ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Tour:
    """The walk around a tree of branches as columns, one row a contact with the wall.

    Attributes
    ----------
    branch, place : (n,) int arrays
        Sample `place` of branch `branch`.
    unit : (n, 2) float array
        Direction from the sample to the contact; none where a cut crosses the axis.
    """

    branch: IntArray
    place: IntArray
    unit: FloatArray


def _middle(right: FloatArray, left: FloatArray) -> float:
    """Direction in the middle of the gap between two contacts, from the right one to the left."""
    first, last = np.arctan2(right[1], right[0]), np.arctan2(left[1], left[0])
    return float(first + np.mod(last - first, 2 * np.pi) / 2)


def tour(branches: Sequence[Branch], cut: Sequence[BoolArray], step: float) -> Tour:
    """Once around a tree, the wall on the right.

    Parameters
    ----------
    branches : sequence of Branch
    cut : sequence of (2,) bool arrays
        Whether the wall does not go round the start and the end of each branch.
    step : float
        Of samples on contact arcs, mm.
    """
    # half edge 2 k leads along branch k, 2 k + 1 back
    leaving: dict[int, list[tuple[float, int]]] = {}
    for index, branch in enumerate(branches):
        chain = branch.chain
        head = _middle(chain.right[0], chain.left[0])
        tail = _middle(chain.left[-1], chain.right[-1])
        leaving.setdefault(chain.start, []).append((head, 2 * index))
        leaving.setdefault(chain.end, []).append((tail, 2 * index + 1))
    follow: dict[int, int] = {}
    for around in leaving.values():
        around.sort(key=lambda item: np.mod(item[0], 2 * np.pi))
        for (_, half), (_, following) in zip(around, around[1:] + around[:1], strict=True):
            # who comes in along the reverse of a half edge leaves by the next one to the left
            follow[half ^ 1] = following
    rows: list[tuple[IntArray, IntArray, FloatArray]] = []
    half = 0
    while True:
        rows.append(_side(branches, half))
        closed = bool(cut[half // 2][1 - half % 2])
        after = follow[half]
        if closed and after == half ^ 1:
            rows.append(_crossing(branches, half))
        else:
            rows.append(_fan(branches, half, after, step))
        half = after
        if half == 0:
            break
    return Tour(
        np.concatenate([row[0] for row in rows]),
        np.concatenate([row[1] for row in rows]),
        np.concatenate([row[2] for row in rows]),
    )


def _side(branches: Sequence[Branch], half: int) -> tuple[IntArray, IntArray, FloatArray]:
    chain = branches[half // 2].chain
    count = len(chain.room)
    place = np.arange(count)
    if half % 2:
        return np.full(count, half // 2), place[::-1], chain.left[::-1]
    return np.full(count, half // 2), place, chain.right


def _crossing(branches: Sequence[Branch], half: int) -> tuple[IntArray, IntArray, FloatArray]:
    """The place on the axis itself, where a cut crosses it."""
    last = 0 if half % 2 else len(branches[half // 2].chain.room) - 1
    return np.array([half // 2]), np.array([last]), np.zeros((1, 2))


def _fan(
    branches: Sequence[Branch], half: int, after: int, step: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Contacts between the last of one side and the first of the next, on one disk."""
    chain, following = branches[half // 2].chain, branches[after // 2].chain
    last = 0 if half % 2 else len(chain.room) - 1
    begin = chain.left[0] if half % 2 else chain.right[-1]
    end = following.left[-1] if after % 2 else following.right[0]
    low = np.arctan2(begin[1], begin[0])
    sweep = np.mod(np.arctan2(end[1], end[0]) - low, 2 * np.pi)
    room = float(chain.room[last])
    if not NO_FAN < sweep < ALL_ROUND:
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros((0, 2))
    count = max(2, int(np.ceil(room * sweep / step)), int(np.ceil(sweep / 0.05)))
    angle = low + sweep * np.arange(1, count) / count
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.full(len(angle), half // 2), np.full(len(angle), last), unit


__all__ = [
    "Branch",
    "Chain",
    "Tour",
    "centre_of",
    "node_near",
    "opened",
    "rooted",
    "sampled_chains",
    "tour",
]
