"""Shortest ways along the axis, with a least clearance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grassfire.errors import GeometryError
from grassfire.medial.parts import AxisGraph, subgraph
from grassfire.medial.queries import AxisIndex, checked_points
from grassfire.medial.sites import FloatArray, IntArray

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from scipy.sparse import csr_matrix

    from grassfire.medial.axis import MedialAxis


@dataclass(frozen=True)
class AxisPath:
    """A way along the axis.

    Attributes
    ----------
    axis : MedialAxis
    edge : (k,) int array
    start, end : (k,) float arrays
        Leg i runs along edge[i] from fraction start[i] to end[i], backwards where it is less.
    length : float
        mm.
    clearance : float
        Least radius of the axis along the way, mm.
    """

    axis: MedialAxis
    edge: IntArray
    start: FloatArray
    end: FloatArray
    length: float
    clearance: float

    @property
    def legs(self) -> list[tuple[int, float, float]]:
        """(edge, from fraction, to fraction) of each leg."""
        columns = self.edge.tolist(), self.start.tolist(), self.end.tolist()
        return list(zip(*columns, strict=True))

    def points(self, tolerance: float) -> FloatArray:
        """(n, 2) points of a polyline within `tolerance` mm of the way, its ends included.

        Raises
        ------
        GeometryError
            For a tolerance that is not above 0.
        """
        if not tolerance > 0:
            raise GeometryError("a chord tolerance must be above 0")
        table = self.axis.table
        if not len(self.edge):
            return np.asarray(table.vertex[:1, :2] + table.origin)
        count = np.array([self._chords(leg, tolerance) for leg in range(len(self.edge))])
        leg = np.repeat(np.arange(len(count)), count)
        step = np.arange(len(leg)) - np.repeat(np.cumsum(count) - count, count)
        share = (step + 1) / count[leg]
        fraction = np.where(
            share == 1, self.end[leg], self.start[leg] + (self.end - self.start)[leg] * share
        )
        first = table.evaluate(self.edge[:1], self.start[:1])
        rest = table.evaluate(self.edge[leg], fraction)
        return np.asarray(np.concatenate([first, rest])[:, :2] + table.origin)

    def _chords(self, leg: int, tolerance: float) -> int:
        low, high = sorted((self.start[leg], self.end[leg]))
        edge = self.edge[leg : leg + 1]
        part = self.axis.table.restricted(edge, np.array([low]), np.array([high]))[0, :, :2]
        degree = len(part) - 1
        second = np.diff(part, n=2, axis=0) if degree > 1 else np.zeros((1, 2))
        sag = degree * (degree - 1) / 8 * float(np.hypot(*second.T).max())
        return max(1, int(np.ceil(np.sqrt(sag / tolerance))))


@dataclass(frozen=True)
class _Net:
    """Stretches between numbered nodes; `first` and `last` are the ends of the way."""

    edge: IntArray
    low: FloatArray
    high: FloatArray
    start: IntArray
    end: IntArray
    nodes: int

    def with_place(self, edge: int, fraction: float) -> _Net:
        """The stretch at a place cut in two there, by a new node."""
        at = (self.edge == edge) & (self.low <= fraction) & (fraction <= self.high)
        row = int(np.flatnonzero(at)[0])
        new = self.nodes
        high, end = self.high.copy(), self.end.copy()
        high[row], end[row] = fraction, new
        return _Net(
            np.append(self.edge, edge),
            np.append(self.low, fraction),
            np.append(high, self.high[row]),
            np.append(self.start, new),
            np.append(end, self.end[row]),
            new + 1,
        )

    def matrix(self, weight: FloatArray) -> csr_matrix:
        """Weights of half stretches: each has a node in its middle, so that no two coincide."""
        middle = self.nodes + np.arange(len(self.edge))
        second = np.flatnonzero(self.start != self.end)
        rows = np.concatenate([self.start, self.end[second]])
        columns = np.concatenate([middle, middle[second]])
        total = self.nodes + len(self.edge)
        value = np.concatenate([weight, weight[second]])
        from scipy.sparse import coo_matrix

        return coo_matrix((value, (rows, columns)), shape=(total, total)).tocsr()

    def walk(self, previous: IntArray, begin: int, last: int) -> list[tuple[int, bool]]:
        """Stretches from `begin` to `last` by predecessors, and whether each is run backwards."""
        result = []
        node = last
        while node != begin:
            middle = int(previous[node])
            stretch = middle - self.nodes
            result.append((stretch, bool(self.start[stretch] == node)))
            node = int(previous[middle])
        return result[::-1]


def path(
    axis: MedialAxis, start: ArrayLike, end: ArrayLike, minimum_clearance: float = 0.0
) -> AxisPath:
    """Shortest way along the axis between two points.

    Parameters
    ----------
    start, end : (2,) array_like
        The way leads from the place nearest to `start` to the place nearest to `end`, of those
        with r >= `minimum_clearance`, mm.
    minimum_clearance : float
        Least radius of the axis on the way, mm. A slot or a neck of exactly that radius is let
        through.

    Returns
    -------
    AxisPath
        Its legs on the edges, length and least radius, and points for a polyline.

    Raises
    ------
    GeometryError
        When no place is wide enough, or none of the ways: with the neck that bars the widest one.

    Examples
    --------
    >>> from grassfire.geometry import Line, Loop, Region
    >>> from grassfire.medial import medial_axis
    >>> half = [(-20, -10), (0, -10), (0, -1), (10, -1), (10, -10), (30, -10)]
    >>> corners = half + [(x, -y) for x, y in reversed(half)]
    >>> sides = zip(corners, corners[1:] + corners[:1])
    >>> axis = medial_axis(Region(Loop(tuple(Line(a, b) for a, b in sides))))
    >>> way = axis.path((-10, 0), (20, 0), minimum_clearance=1.0)
    >>> round(way.length, 9), round(way.clearance, 9)
    (30.0, 1.0)
    >>> axis.path((-10, 0), (20, 0), minimum_clearance=3.0)
    Traceback (most recent call last):
    ...
    grassfire.errors.GeometryError: no way with a clearance of 3 mm: ...
    """
    wide = subgraph(axis, minimum_clearance, ties=-1)
    points = np.concatenate([checked_points(start), checked_points(end)]) - axis.sites.origin
    if len(points) != 2:
        raise GeometryError("a way leads from one point to one other")
    if not len(wide.vertex_radius):
        raise _too_narrow(axis, minimum_clearance)
    if not len(wide.edge):
        none = np.zeros(0)
        return AxisPath(axis, none.astype(np.int64), none, none, 0.0, float(wide.vertex_radius[0]))
    index = axis.index
    if minimum_clearance > 0:
        index = AxisIndex(axis.table, wide.edge, wide.low, wide.high)
    edge, fraction = index.query(points)
    net = _net(wide, edge, fraction)
    first, last = net.nodes - 2, net.nodes - 1
    length = axis.table.lengths(net.edge, net.low, net.high)
    # Zero would be no connection at all.
    weight = np.maximum(0.5 * length, 1e-300)
    from scipy.sparse.csgraph import dijkstra

    distance, previous = dijkstra(
        net.matrix(weight), directed=False, indices=first, return_predecessors=True
    )
    if not np.isfinite(distance[last]):
        raise _blocked(axis, edge, fraction, minimum_clearance)
    return _assembled(axis, net, net.walk(previous, first, last), (edge, fraction), length)


def _too_narrow(axis: MedialAxis, clearance: float) -> GeometryError:
    """Error where no place is wide enough."""
    centre, radius = axis.largest_disk()
    return GeometryError(
        f"no place on the axis has a clearance of {clearance:.6g} mm",
        place=(float(centre[0]), float(centre[1])),
        remedy=f"the largest clearance is {radius:.6g} mm",
    )


def _net(graph: AxisGraph, edge: IntArray, fraction: FloatArray) -> _Net:
    nodes = len(graph.vertex_radius)
    net = _Net(graph.edge, graph.low, graph.high, graph.start, graph.end, nodes)
    for index, place in zip(edge, fraction, strict=True):
        net = net.with_place(int(index), float(place))
    return net


def _assembled(
    axis: MedialAxis,
    net: _Net,
    walk: list[tuple[int, bool]],
    ends: tuple[IntArray, FloatArray],
    length: FloatArray,
) -> AxisPath:
    """Legs of a walk: stretches that follow each other on one edge are one leg."""
    legs: list[tuple[int, float, float]] = []
    for row, backward in walk:
        edge, low, high = int(net.edge[row]), float(net.low[row]), float(net.high[row])
        if low == high:
            continue
        begin, stop = (high, low) if backward else (low, high)
        if legs and legs[-1][0] == edge and legs[-1][2] == begin:
            legs[-1] = (edge, legs[-1][1], stop)
        else:
            legs.append((edge, begin, stop))
    if not legs:
        legs = [(int(ends[0][0]), float(ends[1][0]), float(ends[1][0]))]
    along = np.array([leg[0] for leg in legs], dtype=np.int64)
    start, end = np.array([leg[1] for leg in legs]), np.array([leg[2] for leg in legs])
    narrowest, _ = _narrowest(axis, along, np.minimum(start, end), np.maximum(start, end))
    total = float(sum(length[row] for row, _ in walk))
    return AxisPath(axis, along, start, end, total, float(narrowest.min()))


def _narrowest(
    axis: MedialAxis, edge: IntArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Least radius on parts of edges, and the fraction where it is."""
    table = axis.table
    place = np.stack([low, high], axis=1)
    radius = table.evaluate(np.repeat(edge, 2), place.ravel())[:, 2].reshape(-1, 2)
    rows = np.arange(len(edge))
    best = np.argmin(radius, axis=1)
    least, where = radius[rows, best], place[rows, best]
    row, fraction, disks, sign = axis.critical
    dips = np.flatnonzero(sign > 0)
    for index in dips[np.isin(row[dips], table.row[edge])]:
        here = table.row[edge] == row[index]
        inside = here & (low < fraction[index]) & (fraction[index] < high)
        lower = inside & (disks[index, 2] < least)
        least = np.where(lower, disks[index, 2], least)
        where = np.where(lower, fraction[index], where)
    return least, where


def _blocked(
    axis: MedialAxis, edge: IntArray, fraction: FloatArray, clearance: float
) -> GeometryError:
    """Error that names the narrowest place on the widest way."""
    net = _net(subgraph(axis, 0.0), edge, fraction)
    least, where = _narrowest(axis, net.edge, net.low, net.high)
    # The spanning tree of the widest stretches holds the widest way between any two nodes.
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    tree = minimum_spanning_tree(net.matrix(1.0 + least.max() - least))
    _, previous = breadth_first_order(tree, net.nodes - 2, directed=False)
    walk = net.walk(previous, net.nodes - 2, net.nodes - 1)
    row = min((row for row, _ in walk), key=lambda index: float(least[index]))
    place = axis.table.evaluate(net.edge[row : row + 1], where[row : row + 1])[0]
    x, y = place[:2] + axis.sites.origin
    return GeometryError(
        f"no way with a clearance of {clearance:.6g} mm: a neck has {place[2]:.6g} mm only",
        place=(float(x), float(y)),
        remedy=f"ask for a clearance of at most {place[2]:.6g} mm",
    )


__all__ = ["AxisPath", "path"]
