"""The graph of the medial axis: vertices by clustering events, edges by pairing intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry.neighbours import Neighbours, connected
from grassfire.medial.columns import equal_rows, grouped
from grassfire.medial.contact import Tangents, contact
from grassfire.medial.nodes import WHOLE, Intervals, Nodes
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, Sites
from grassfire.medial.topology import Topology


@dataclass(frozen=True)
class Graph:
    """Vertices, boundary intervals and their pairing.

    Attributes
    ----------
    vertex_centre : (v, 2) float array
        In the sites' coordinates.
    vertex_radius : (v,) float array
    site, start, end, partner : (k,) arrays
        Boundary intervals in boundary order: parameters and the site that they face
        (`WHOLE` where the interval shrinks to a vertex).
    first, last : (k,) int arrays
        Vertex at each end of the interval.
    mate : (k,) int array
        The interval on the other side of the same edge; -1 where the axis is one vertex.
    first_centre, last_centre, first_radius, last_radius
        The disks at the ends as found from this side.
    """

    vertex_centre: FloatArray
    vertex_radius: FloatArray
    site: IntArray
    start: FloatArray
    end: FloatArray
    partner: IntArray
    first: IntArray
    last: IntArray
    mate: IntArray
    first_centre: FloatArray
    last_centre: FloatArray
    first_radius: FloatArray
    last_radius: FloatArray


def build_graph(topology: Topology, rounds: int = 6) -> Graph:
    """Resolve the topology and pair all intervals; refine where the pairing fails.

    Raises
    ------
    GeometryError
        When an interval has no mate after all rounds, with its place.
    """
    topology.resolve()
    for _ in range(rounds):
        graph, unpaired = _assemble(topology)
        if not len(unpaired):
            return graph
        _refine(topology, graph, unpaired)
    graph, unpaired = _assemble(topology)
    if len(unpaired):
        place = graph.first_centre[unpaired[0]] + topology.sites.origin
        raise GeometryError(
            f"{len(unpaired)} stretches of the boundary face nothing that faces them",
            place=tuple(place),
        )
    return graph


def _refine(topology: Topology, graph: Graph, unpaired: IntArray) -> None:
    """More nodes inside the intervals that found no mate."""
    fraction = np.array([0.21, 0.5, 0.83])
    span = (graph.end - graph.start)[unpaired]
    parameter = (graph.start[unpaired, None] + span[:, None] * fraction).ravel()
    site = np.repeat(graph.site[unpaired], len(fraction))
    topology.nodes = Nodes.join(topology.nodes, topology.plain_nodes(site, parameter))
    topology.resolve()


def _assemble(topology: Topology) -> tuple[Graph, IntArray]:
    intervals = topology.intervals()
    label, centre, radius = _vertices(topology, intervals)
    nodes = topology.nodes
    first, last = label[intervals.first], label[intervals.last]
    partner = intervals.partner.copy()
    tiny = _tiny(topology, intervals)
    point = (first == last) & (tiny | (partner == WHOLE))
    loops = ((first == last) & ~point).nonzero()[0]
    if len(loops):
        point[loops] = _stays(topology, intervals, loops)
    keep = ~(tiny & point)
    partner[point] = WHOLE
    site, start, end = intervals.site[keep], intervals.start[keep], intervals.end[keep]
    first, last, partner = first[keep], last[keep], partner[keep]
    mate = _pair(site, partner, first, last)
    unpaired = ((mate < 0) & (partner != WHOLE)).nonzero()[0]
    head, tail = intervals.first_node[keep], intervals.last_node[keep]
    graph = Graph(
        vertex_centre=centre,
        vertex_radius=radius,
        site=site,
        start=start,
        end=end,
        partner=partner,
        first=first,
        last=last,
        mate=mate,
        first_centre=nodes.centre.take(head, axis=0),
        last_centre=nodes.centre.take(tail, axis=0),
        first_radius=nodes.radius[head],
        last_radius=nodes.radius[tail],
    )
    return graph, unpaired


def _tiny(topology: Topology, intervals: Intervals) -> BoolArray:
    radius = topology.nodes.radius[intervals.first_node]
    speed = topology.sites.speed(intervals.site, intervals.start, radius)
    return np.asarray((intervals.end - intervals.start) * speed <= topology.snap)


def _stays(topology: Topology, intervals: Intervals, rows: IntArray) -> BoolArray:
    """Whether the axis stays within the cluster tolerance of the vertex along intervals `rows`."""
    sites: Sites = topology.sites
    fraction = np.array([0.25, 0.5, 0.75])
    start, partner = intervals.start[rows], intervals.partner[rows]
    span = intervals.end[rows] - start
    parameter = (start[:, None] + span[:, None] * fraction).ravel()
    site = np.repeat(intervals.site[rows], 3)
    safe = np.maximum(np.repeat(partner, 3), 0)
    position, normal = sites.tangents(site, parameter)
    tangents = Tangents(position, normal, site, parameter)
    _, radius = contact(sites, tangents, safe, np.full(len(site), np.nan))
    radius = np.where(np.isfinite(radius), radius, 0.0)
    centre = position + radius[:, None] * normal
    away = centre - np.repeat(topology.nodes.centre[intervals.first_node[rows]], 3, axis=0)
    limit = 10 * topology.cluster
    return np.asarray(np.all((np.hypot(away[:, 0], away[:, 1]) <= limit).reshape(-1, 3), axis=1))


def _vertices(topology: Topology, intervals: Intervals) -> tuple[IntArray, FloatArray, FloatArray]:
    """Label of each event vertex, and the centre and radius of each label."""
    nodes = topology.nodes
    events = (nodes.vertex >= 0).nonzero()[0]
    identity = nodes.vertex[events]
    centre, radius = nodes.centre.take(events, axis=0), nodes.radius.take(events)
    links = _neighbours(identity, centre, radius, topology.cluster)
    links.append(_triples(topology, events))
    group = intervals.group[events]
    same = group[1:] == group[:-1]
    links.append(np.stack([identity[:-1][same], identity[1:][same]]))
    one, other = np.concatenate(links, axis=1)
    count, apart = topology.vertex_count, one != other
    component = connected(one[apart], other[apart], count)
    seen = np.zeros(count, dtype=bool)
    seen[component[identity]] = True
    used = seen.nonzero()[0]
    label = np.where(seen, np.cumsum(seen) - 1, -1)[component]
    owner = label[identity]
    # an end so near to a branch point that they are one stays where it is
    turning = nodes.left[events] == nodes.right[events]
    end = (np.bincount(identity, turning) == np.bincount(identity))[identity]
    share = np.where(np.bincount(owner, end)[owner] > 0, end, True).astype(float)
    weight = np.bincount(owner, share, minlength=len(used))
    mean = np.stack(
        [
            np.bincount(owner, values * share, minlength=len(used)) / weight
            for values in (*centre.T, radius)
        ]
    )
    return label, np.asarray(mean[:2].T), np.asarray(mean[2])


def _neighbours(
    identity: IntArray, centre: FloatArray, radius: FloatArray, length: float
) -> list[IntArray]:
    """Links between events nearer than `length`: those of a cell in a row, then the cells."""
    disk = np.concatenate([centre, radius[:, None]], axis=1)
    # Most events stand there several times, with the very same disk.
    row = np.arange(len(identity))
    holder = np.empty(int(identity.max(initial=-1)) + 1, dtype=np.int64)
    holder[identity] = row
    holder = holder[identity]
    other = disk.take(holder, axis=0) != disk
    kept = ((holder == row) | other[:, 0] | other[:, 1] | other[:, 2]).nonzero()[0]
    identity, disk = identity[kept], disk.take(kept, axis=0)
    cell = equal_rows(np.floor(disk / (0.5 * length)).T)
    order = np.argsort(cell, kind="stable")
    same = np.diff(cell[order]) == 0
    within = np.stack([identity[order[:-1]][same], identity[order[1:]][same]])
    first = order[np.concatenate([[True], ~same])]
    near = Neighbours(disk.take(first, axis=0)).pairs(length)
    between = np.stack([identity[first[near[:, 0]]], identity[first[near[:, 1]]]])
    return [within, between]


def _triples(topology: Topology, events: IntArray) -> IntArray:
    """Links between events that have the same three sites, each seen from another of them.

    Nearly parallel contacts leave a branch point ill-determined along the axis; the three sites
    still identify it.
    """
    nodes = topology.nodes
    site, left, right = nodes.site[events], nodes.left[events], nodes.right[events]
    branch = (left != right) & (left >= 0) & (right >= 0) & (left != site) & (right != site)
    rows = events[branch]
    if not len(rows):
        return np.zeros((2, 0), dtype=np.int64)
    triple = np.sort(np.stack([site[branch], left[branch], right[branch]], axis=1), axis=1)
    order, differ = grouped(triple.T)
    rows = rows.take(order)
    limit = 1e-6 * topology.sites.size
    pairs = [np.zeros((2, 0), dtype=np.int64)]
    for step in (1, 2):
        if len(rows) <= step:
            continue
        same = ~differ if step == 1 else ~(differ[1:] | differ[:-1])
        one, two = rows[:-step][same], rows[step:][same]
        away = np.hypot(*(nodes.centre.take(one, axis=0) - nodes.centre.take(two, axis=0)).T)
        close = (away <= limit) & (nodes.site.take(one) != nodes.site.take(two))
        pairs.append(nodes.vertex.take(np.stack([one[close], two[close]])))
    return np.concatenate(pairs, axis=1)


def _pair(site: IntArray, partner: IntArray, first: IntArray, last: IntArray) -> IntArray:
    """Mates: (i, j, a, b) pairs with (j, i, b, a)."""
    mate = np.full(len(site), -1, dtype=np.int64)
    rows = (partner != WHOLE).nonzero()[0]
    if not len(rows):
        return mate
    one, other, begin, end = (column[rows] for column in (site, partner, first, last))
    width, count = int(max(site.max(), partner.max())) + 1, int(max(first.max(), last.max())) + 1
    sides = np.concatenate([one * width + other, other * width + one])
    ends = np.concatenate([begin * count + end, end * count + begin])
    rank = equal_rows(np.stack([sides, ends]))
    holder = np.full(int(rank.max()) + 1, -1, dtype=np.int64)
    holder[rank[: len(rows)]] = rows
    mate[rows] = holder[rank[len(rows) :]]
    return mate
