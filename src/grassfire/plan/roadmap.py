"""Ways inside a pocket: its medial axis as a road map, pulled straight where that is allowed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from grassfire.geometry.neighbours import Neighbours, connected
from grassfire.medial import MedialAxis
from grassfire.medial.parts import AxisGraph
from grassfire.plan.link import Holding, straight
from grassfire.plan.path import Path, ranges
from grassfire.plan.places import BoolArray, IntArray
from grassfire.toolpath import FloatArray

STOCK = 4.0
"""Weight of a way through stock against one through cleared area."""

SEEN = 12
"""Places of the map that a way looks for from its ends."""

MIDDLES = 40
"""Places that are compared, about, for being in the middle."""

SLACK = 1e-6
"""Rounding of clearances, mm."""


@dataclass(frozen=True)
class Leg:
    """Part of a way, all in cleared area or all not known to be."""

    path: Path
    air: bool


@dataclass(frozen=True)
class Passage:
    """A way into stock: its legs, and the links of the map that they follow.

    Attributes
    ----------
    legs : tuple of Leg
    links : tuple of int
        To be given to `RoadMap.travel` when the way is taken.
    """

    legs: tuple[Leg, ...]
    links: tuple[int, ...]

    @property
    def stock(self) -> float:
        """Length that is not known to be cleared, mm."""
        return float(sum(leg.path.length for leg in self.legs if not leg.air))


def polyline(points: Sequence[FloatArray] | FloatArray) -> Path | None:
    """Straight pieces through points, repeated ones and those on straight ways left out."""
    if len(points) == 2:
        return straight(points[0], points[1])
    table = np.asarray(points, dtype=np.float64)
    step = table[1:] - table[:-1]
    table = np.concatenate([table[:1], table[1:][np.hypot(step[:, 0], step[:, 1]) > 1e-9]])
    if len(table) < 2:
        return None
    unit = table[1:] - table[:-1]
    unit /= np.hypot(unit[:, 0], unit[:, 1])[:, None]
    (one_x, one_y), (two_x, two_y) = unit[:-1].T, unit[1:].T
    bend = np.abs(one_x * two_y - one_y * two_x)
    ahead = one_x * two_x + one_y * two_y > 0
    kept = np.ones(len(table), dtype=bool)
    kept[1:-1] = ~((bend <= 1e-9) & ahead)
    table = table[kept]
    count = len(table) - 1
    return Path(table, np.full((count, 2), np.nan), np.zeros(count))


def _extrema(axis: MedialAxis, graph: AxisGraph) -> tuple[IntArray, FloatArray]:
    """Stretches of a graph and fractions inside them where r is largest or least."""
    row, fraction, _, _ = axis.critical
    stretch, place = np.nonzero(
        (axis.table.row[graph.edge][:, None] == row[None])
        & (graph.low[:, None] < fraction[None])
        & (fraction[None] < graph.high[:, None])
    )
    return stretch, fraction[place]


TIGHTENED, NEARER = 2, (0.1, 0.2, 0.35, 0.5, 0.7, 0.85)
"""How often corners of ways are moved inwards; parts of their distance from the straight way that
are tried."""


class RoadMap:
    """Places on the medial axis of the tool's positions, and links between neighbours.

    Parameters
    ----------
    axis : MedialAxis
    wall : float
        Least distance of the tool centre from the boundary, mm.
    step : float
        Largest distance between neighbours along the axis, nearly, mm.

    Attributes
    ----------
    points, radius : (n, 2) and (n,) float arrays
        Places and their clearance, mm.
    cleared : (n,) float array
        Least wall distance of a cleared component that holds the place, mm; infinite for none.
    """

    def __init__(self, axis: MedialAxis, wall: float, step: float) -> None:
        graph, table = axis.subgraph(wall), axis.table
        size = np.zeros(len(graph.edge))
        for degree in np.unique(table.degree[graph.edge]):
            rows = np.flatnonzero(table.degree[graph.edge] == degree)
            leg = np.diff(table.control(graph.edge[rows], int(degree))[:, :, :2], axis=1)
            size[rows] = np.hypot(leg[:, :, 0], leg[:, :, 1]).sum(axis=1)
        parts = np.maximum(1, np.ceil(size * (graph.high - graph.low) / step)).astype(np.int64)
        owner = np.repeat(np.arange(len(parts)), parts - 1)
        order = np.arange(len(owner)) - np.repeat(np.cumsum(parts - 1) - parts + 1, parts - 1) + 1
        fraction = graph.low[owner] + (graph.high - graph.low)[owner] * order / parts[owner]
        turning, where = _extrema(axis, graph)
        owner, fraction = np.append(owner, turning), np.append(fraction, where)
        order = np.lexsort((fraction, owner))
        owner, fraction = owner[order], fraction[order]
        inner, known = np.bincount(owner, minlength=len(parts)), len(graph.vertex_radius)
        parts = inner + 1
        disks = table.evaluate(graph.edge[owner], fraction)
        self.points = np.concatenate([graph.vertex_point, disks[:, :2] + table.origin])
        self.radius = np.concatenate([graph.vertex_radius, disks[:, 2]])
        stretch = np.repeat(np.arange(len(parts)), parts)
        place = np.arange(len(stretch)) - np.repeat(np.cumsum(parts) - parts, parts)
        before = known + (np.cumsum(inner) - inner)[stretch] + place - 1
        self._first = np.where(place == 0, graph.start[stretch], before)
        self._second = np.where(place == parts[stretch] - 1, graph.end[stretch], before + 1)
        gap = self.points[self._first] - self.points[self._second]
        length = np.hypot(gap[:, 0], gap[:, 1])
        # the shorter of two links between the same places, none from a place to itself
        ends = np.sort(np.stack([self._first, self._second]), axis=0)
        order = np.lexsort((length, ends[1], ends[0]))
        ends, length = ends[:, order], length[order]
        keep = np.any(np.diff(ends, axis=1, prepend=-1) != 0, axis=0) & (ends[0] != ends[1])
        self._first, self._second = ends[0][keep], ends[1][keep]
        self._length = np.maximum(length[keep], 1e-9)
        self._travelled = np.zeros(len(self._first), dtype=bool)
        self._known_parts: dict[float, tuple[BoolArray, IntArray]] = {}
        self._places = Neighbours(self.points)
        self.cleared = np.full(len(self.radius), np.inf)

    @cached_property
    def _rows(self) -> dict[tuple[int, int], int]:
        """Link between two places."""
        pairs = zip(self._first.tolist(), self._second.tolist(), strict=True)
        return {pair: row for row, pair in enumerate(pairs)}

    def component(self, distance: float, inside: FloatArray) -> BoolArray:
        """(n,) which places have a clearance of `distance` or more and are joined to `inside`."""
        wide, label = self._parts(distance)
        near = wide.nonzero()[0]
        if not len(near):
            return wide
        gap = self.points[near] - inside
        return np.asarray(wide & (label == label[near[np.argmin(np.hypot(gap[:, 0], gap[:, 1]))]]))

    def _parts(self, distance: float) -> tuple[BoolArray, IntArray]:
        """(n,) which places have a clearance of `distance` or more, and which are joined."""
        if distance not in self._known_parts:
            wide = self.radius >= distance
            # along a link of length l between places of clearance r and s, it is at least
            # (r + s - l) / 2
            both = wide[self._first] & wide[self._second]
            label = connected(self._first[both], self._second[both], len(wide))
            self._known_parts[distance] = wide, label
        return self._known_parts[distance]

    def middle(self, inside: BoolArray, wide: BoolArray) -> tuple[int, float]:
        """Of the `wide` places the one from which the farthest wall `inside` is nearest; how far.

        Ways lead along links between places that are `inside`, then straight to the wall, mm.
        """
        rows = np.flatnonzero(wide & inside)
        # even a few of many neighbours tell the middle well
        rows = rows[:: max(1, len(rows) // MIDDLES)]
        both = inside[self._first] & inside[self._second]
        away = np.full((len(rows), len(self.radius)), np.inf)
        away[np.arange(len(rows)), rows] = 0.0
        nowhere = np.full(len(self.radius), np.inf)
        self._spread(away, np.where(both, self._length, np.inf), nowhere)
        far = np.max(away[:, inside] + self.radius[inside], axis=1)
        best = int(np.argmin(far))
        return int(rows[best]), float(far[best])

    def clear(self, places: BoolArray, distance: float) -> None:
        """Note that a component is cleared whose rings are `distance` from the wall."""
        self.cleared[places] = np.minimum(self.cleared[places], distance)

    def air(self) -> BoolArray:
        """(m,) which links are proven to lie in cleared components, or were travelled before."""
        floor = np.maximum(self.cleared[self._first], self.cleared[self._second])
        least = (self.radius[self._first] + self.radius[self._second] - self._length) / 2
        return np.asarray((least >= floor - SLACK) | self._travelled)

    def way(
        self, start: FloatArray, end: FloatArray, inside: Holding, allowed: BoolArray
    ) -> Path | None:
        """A short way between two points of an interior that stays in it, or None.

        Parameters
        ----------
        start, end : (2,) float arrays
            mm.
        inside : Holding
        allowed : (n,) bool array
            Places that the way may use.
        """
        tails, heads = self._near(start, allowed), self._near(end, allowed)
        # straight to the end, and to the places near either end
        begins = np.repeat(np.stack([start, start, end]), [1, len(tails), len(heads)], axis=0)
        goals = np.concatenate([end[None], self.points[tails], self.points[heads]])
        held = inside.holds(begins, goals, certain=np.arange(len(goals)) > 0)
        if held[0]:
            return polyline([start, end])
        tails, heads = tails[held[1 : len(tails) + 1]], heads[held[len(tails) + 1 :]]
        nodes = self._shortest(start, end, tails, heads, allowed, self._length)
        if nodes is None:
            return None
        chain = np.concatenate([start[None], self.points[nodes], end[None]])
        path, reached = _pulled(chain, inside, True)
        return path if reached == len(chain) - 1 else None

    def passage(
        self,
        start: FloatArray,
        goal: FloatArray,
        insides: tuple[Holding, Holding],
        own: BoolArray,
        all_: BoolArray,
    ) -> Passage | None:
        """A way from a cleared component into stock, as little of it in stock as the map allows.

        Parameters
        ----------
        start : (2,) float array
            Place in the component, mm.
        goal : (2,) float array
            Place on the axis, mm.
        insides : pair of Holding
            The component, and one around it that holds the goal as well.
        own, all_ : (n,) bool arrays
            Places strictly inside the first, places in the second.
        """
        node = int(self._places.nearest(goal[None])[1][0, 0])
        tails = self._seen(start, insides[0], own)
        seen = len(tails) > 0
        if not seen:
            tails = self._seen(start, insides[1], all_, certain=False)
        air = self.air()
        weight = np.where(air, 1.0, STOCK) * self._length
        nodes = self._shortest(start, goal, tails, np.array([node]), all_, weight)
        if nodes is None:
            return None
        first = 0
        lead = polyline([start, self.points[nodes[0]]])
        if seen:
            left = np.flatnonzero(~own[nodes])
            most = int(left[0]) if len(left) else len(nodes)
            head = np.concatenate([start[None], self.points[nodes[:most]]])
            lead, reached = _pulled(head, insides[0], False)
            first = reached - 1
        links = self._links(nodes[first:])
        legs = [] if lead is None else [Leg(lead, seen)]
        legs += self._legs(nodes[first:], links, air)
        last = polyline([self.points[nodes[-1]], goal])
        if last is not None:
            legs.append(Leg(last, False))
        return Passage(tuple(legs), tuple(links))

    def travel(self, passage: Passage) -> None:
        """Note that the tool went this way: it is cleared now."""
        self._travelled[list(passage.links)] = True

    def _links(self, nodes: IntArray) -> list[int]:
        """Links between places that follow each other."""
        pairs = zip(nodes[:-1].tolist(), nodes[1:].tolist(), strict=True)
        return [
            self._rows[(one, two)] if (one, two) in self._rows else self._rows[(two, one)]
            for one, two in pairs
        ]

    def _legs(self, nodes: IntArray, links: list[int], air: BoolArray) -> list[Leg]:
        """Legs over neighbouring places, one for each run of links in air or in stock."""
        if not links:
            return []
        state = air[links]
        cuts = np.flatnonzero(state[1:] != state[:-1]) + 1
        bounds = [0, *cuts.tolist(), len(links)]
        runs = [
            (polyline(self.points[nodes[low : high + 1]]), bool(state[low]))
            for low, high in pairwise(bounds)
        ]
        return [Leg(path, flag) for path, flag in runs if path is not None]

    def _near(self, point: FloatArray, allowed: BoolArray) -> IntArray:
        """Places near a point, the nearest first."""
        rows = allowed.nonzero()[0]
        gap = self.points[rows] - point
        away = np.hypot(gap[:, 0], gap[:, 1])
        if len(rows) > SEEN:
            close = (away <= np.partition(away, SEEN - 1)[SEEN - 1]).nonzero()[0]
            rows, away = rows[close], away[close]
        return np.asarray(rows[np.argsort(away, kind="stable")[:SEEN]])

    def _seen(
        self, point: FloatArray, inside: Holding, allowed: BoolArray, certain: bool = True
    ) -> IntArray:
        """Places near a point to which the straight way stays in an interior.

        `certain` says that places that are allowed lie strictly inside it.
        """
        near = self._near(point, allowed)
        starts = np.repeat(point[None], len(near), axis=0)
        known = np.full(len(near), certain)
        return np.asarray(near[inside.holds(starts, self.points[near], certain=known)])

    @cached_property
    def _ahead(self) -> tuple[IntArray, IntArray, IntArray]:
        """Neighbours of all places, the links to them, and where those of each place begin."""
        links = np.arange(len(self._first))
        tail = np.concatenate([self._first, self._second])
        order = tail.argsort(kind="stable")
        ends = np.bincount(tail, minlength=len(self.radius)).cumsum()
        head = np.concatenate([self._second, self._first])[order]
        return head, np.concatenate([links, links])[order], np.append(0, ends)

    def _spread(self, away: FloatArray, weight: FloatArray, last: FloatArray) -> IntArray:
        """Bring lengths of ways from k starts down to the least ones, all in rounds of one link.

        Parameters
        ----------
        away : (k, n) float array
            Known ones, infinite elsewhere; changed in place, mm.
        weight : (m,) float array
            Length of the links, infinite where there is no way.
        last : (n,) float array
            What a way takes from a place to its goal: no way is followed that is longer than one
            to a goal, mm.

        Returns
        -------
        (k, n) int array
            Place before each on the way there, -1 where it begins.
        """
        head, link, begin = self._ahead
        count = begin[1:] - begin[:-1]
        total = away.shape[1]
        least, before = away.reshape(-1), np.full(away.size, -1)
        active = np.isfinite(least).nonzero()[0]
        while len(active):
            enough = (away + last).min(axis=1)
            place = active % total
            edge = ranges(begin.take(place), count.take(place))
            tail = active.repeat(count.take(place))
            row = tail // total
            goal = row * total + head.take(edge)
            reach = least.take(tail) + weight.take(link.take(edge))
            better = (reach < np.minimum(least.take(goal), enough.take(row))).nonzero()[0]
            tail, goal, reach = tail.take(better), goal.take(better), reach.take(better)
            np.minimum.at(least, goal, reach)
            best = (reach == least.take(goal)).nonzero()[0]
            before[goal.take(best)] = tail.take(best) % total
            active = np.unique(goal.take(best))
        return before.reshape(away.shape)

    def _shortest(
        self,
        start: FloatArray,
        end: FloatArray,
        tails: IntArray,
        heads: IntArray,
        allowed: BoolArray,
        weight: FloatArray,
    ) -> IntArray | None:
        """Places of the shortest way from `start` over one of `tails` and of `heads` to `end`."""
        if not len(tails) or not len(heads):
            return None
        usable = allowed[self._first] & allowed[self._second]
        away, last = np.full((2, len(self.radius)), np.inf)
        away[tails] = np.hypot(*(self.points[tails] - start).T)
        last[heads] = np.hypot(*(self.points[heads] - end).T)
        before = self._spread(away[None], np.where(usable, weight, np.inf), last)[0]
        node = int((away + last).argmin())
        if not np.isfinite(away[node] + last[node]):
            return None
        nodes = []
        while node >= 0:
            nodes.append(node)
            node = int(before[node])
        return np.array(nodes[::-1], dtype=np.int64)


def tightened(way: Path, inside: Holding) -> Path:
    """A way of lines, its corners moved towards the straight ways between their neighbours.

    The axis leads into the middle of wide places; the shorter way is nearer to the walls.
    """
    if len(way) == 1:
        return way
    chain = way.points.copy()
    for _ in range(TIGHTENED):
        for row in range(1, len(chain) - 1):
            before, here, after = chain[row - 1 : row + 2]
            along, offset = after - before, here - before
            share = float(np.clip(offset @ along / max(float(along @ along), 1e-300), 0.0, 1.0))
            foot = before + share * along
            nearer = foot + np.array(NEARER)[:, None] * (here - foot)
            starts = np.repeat(np.stack([before, after]), len(nearer), axis=0)
            held = inside.holds(starts, np.concatenate([nearer, nearer])).reshape(2, -1)
            good = np.flatnonzero(held.all(axis=0))
            if len(good):
                chain[row] = nearer[good[0]]
    tight, reached = _pulled(chain, inside, True)
    return way if tight is None or reached < len(chain) - 1 else tight


def _pulled(chain: FloatArray, inside: Holding, closed: bool) -> tuple[Path | None, int]:
    """A chain of points with as many left out as straight ways in an interior allow.

    Also the number of the point where it ends: the last, or the first one without a way on.
    `closed` says whether the last point may lie on a ring, as the first may.
    """
    last = len(chain) - 1
    # from each point to the next, to those twice as far each, and to the last
    steps = np.append(1 << np.arange((last - 1).bit_length()), last)
    ahead = np.minimum(np.arange(last)[:, None] + steps, last)
    row = np.arange(last).repeat(ahead.shape[1])
    # all but the ends of the chain are places on the map
    goal = ahead.ravel()
    certain = (goal < last) | (row > 0) | (not closed)
    held = inside.holds(chain[row], chain[goal], certain=certain).reshape(ahead.shape)
    farthest = np.where(held, ahead, -1).max(axis=1).tolist()
    kept, here = [0], 0
    while here < last and farthest[here] > here:
        here = farthest[here]
        kept.append(here)
    return polyline(chain[kept]), here
