"""The involution of the boundary: which site faces which, and where that changes.

Every site is cut into intervals that face one partner. The cuts are *events*: images of junctions
(the partner passes from one site to the next), ends (curvature maxima, convex corners, centres of
contact arcs) and branch points. Events come from exact contacts; the partners at samples only say
where to look. Between two nodes that disagree, the radii to both partners cross (a bracketed
root), and the disk there is either empty (a branch point) or shows a site in between.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from grassfire.errors import GeometryError
from grassfire.medial.branches import Branches, continues
from grassfire.medial.contact import Tangents, contact
from grassfire.medial.crossing import crossing
from grassfire.medial.nodes import WHOLE, Intervals, Junctions, Nodes
from grassfire.medial.search import BoundarySearch, Contacts, Rivals
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, SiteKind, Sites, largest
from grassfire.medial.triple import TripleDisks

_SHARP = 1e-6
"""Twice the area of the triangle of three unit normals above which a disk is well determined."""

_PATIENCE = 8
"""Rounds after which crossings are bracketed that Newton's method does not settle."""


class Topology:
    """Builds and refines the nodes of a boundary.

    Parameters
    ----------
    sites : Sites
    search : BoundarySearch
    snap : float
        Length below which two boundary points are one, mm.
    smooth_angle : float
        As given to `build_sites`, radians.
    density : int
        Number of nodes inside each curved site to begin with; one less on the others.
    """

    def __init__(
        self,
        sites: Sites,
        search: BoundarySearch,
        snap: float,
        smooth_angle: float,
        density: int = 1,
    ) -> None:
        self.sites = sites
        # A neighbour at a turn too flat for a corner cuts the disk of an arc by turn^2 / 2.
        self.slack = max(1e-12, smooth_angle**2)
        # What a search leaves out far away could only be missed again.
        self.search = search.seeing_far() if density == 1 else search
        self.snap = snap
        # Length by which disks that are one may differ: lines and points have closed forms.
        self.rounding = snap * 0.1 + 1e-13 * sites.size if sites.curved else 3e-15 * sites.size
        self.branches = Branches(sites, self.search, snap, self.rounding)
        # Distance below which two events are one vertex.
        self.cluster = max(1e-9 * sites.size, 10 * snap)
        self.vertex_count = 0
        self.contact_arc = self._contact_arcs()
        self.nodes = self._first_nodes(density)

    # -- first nodes ------------------------------------------------------------------------------

    def _contact_arcs(self) -> BoolArray:
        """Arcs that one maximal disk touches along their whole length."""
        sites = self.sites
        result = np.zeros(len(sites), dtype=bool)
        rounded = (sites.kind == SiteKind.ARC) & (sites.extent[:, 1] > 0)
        # At a corner, however flat, the neighbour reaches into the disk of the arc.
        rounded &= ~sites.corner_after & ~sites.corner_after[sites.preceding]
        rows = rounded.nonzero()[0]
        if len(rows):
            away, _, _ = self.search.nearest(sites.anchor[rows], self._own(rows))
            result[rows] = away >= sites.radius[rows] * (1 - self.slack) - self.snap
        return result

    def _disks(
        self, site: IntArray, parameter: FloatArray, rivals: Rivals | None = None
    ) -> tuple[FloatArray, FloatArray, Contacts]:
        """Points, normals and maximal disks at parameters of sites."""
        position, normal, curvature = self.sites.frame(site, parameter)
        tangents = Tangents(position, normal, site, parameter)
        own = self._own(site)
        contacts = self.search.maximal_disks(tangents, curvature, own, self.slack, rivals)
        return position, normal, contacts

    def _own(self, site: IntArray) -> IntArray:
        """(n, 3) sites that a disk at `site` cannot touch again: itself, and round a reflex corner.

        A line or an arc and the corner at its end never share a disk of their own; (A) is 0 / 0
        there and rounding would pretend otherwise. Nor do lines that meet at a turn too small for
        a corner.
        """
        return self._excluded.take(site, axis=0)

    @cached_property
    def _excluded(self) -> IntArray:
        """(m, 3) sites that disks at each site cannot touch again."""
        sites, site = self.sites, np.arange(len(self.sites))
        plain = (sites.kind == SiteKind.LINE) | (sites.kind == SiteKind.ARC)
        point = sites.kind == SiteKind.POINT
        before, after = sites.preceding, sites.following
        columns = [site]
        for neighbour, joined in (
            (before, continues(sites, before, site)),
            (after, continues(sites, site, after)),
        ):
            pair = (point & plain[neighbour]) | (plain & point[neighbour]) | joined
            columns.append(np.where(pair, neighbour, site))
        return np.stack(columns, axis=1)

    def _first_nodes(self, density: int) -> Nodes:
        """Events at the ends of the sites and their images on the partners; nodes between.

        All maximal disks are looked for in one search.
        """
        sites = self.sites
        after, corner = sites.following, sites.corner_after
        before = (~corner).nonzero()[0]
        site, parameter = self._samples(density)
        junction = Junctions.of(sites, before, after[before])
        position, normal, curvature = sites.frame(site, parameter)
        inner = Tangents(position, normal, site, parameter)
        own = self._own(site)
        both = np.concatenate([self._own(before), self._own(after[before])], axis=1)
        contacts = self.search.maximal_disks(
            Tangents.join(junction.tangents, inner),
            np.concatenate([junction.curvature, curvature]),
            np.concatenate([both, np.concatenate([own, own], axis=1)]),
            self.slack,
        )
        count = len(before)
        parts = [
            self._corner_nodes(corner.nonzero()[0], after[corner]),
            self._junction_nodes(junction, contacts.take(slice(0, count))),
            self._plain(inner, contacts.take(slice(count, None)), junctions=False),
        ]
        return Nodes.join(*parts)

    def _corner_nodes(self, before: IntArray, after: IntArray) -> Nodes:
        sites = self.sites
        vertex = self._new_vertices(len(before))
        corner = sites.point(after, sites.low[after])
        zero, own = np.zeros(len(before)), np.ones(len(before), dtype=bool)
        low, high = sites.low[after], sites.high[before]
        return Nodes.join(
            Nodes(before, high, zero, after, after, low, vertex, corner, own),
            Nodes(after, low, zero, before, before, high, vertex, corner, own),
        )

    def _new_vertices(self, count: int) -> IntArray:
        result = np.arange(self.vertex_count, self.vertex_count + count)
        self.vertex_count += count
        return result

    def _junction_nodes(self, junction: Junctions, contacts: Contacts) -> Nodes:
        """Smooth junctions and the ends of reflex fans: one disk, seen from both sites."""
        sites = self.sites
        before, after = junction.before, junction.after
        position, mean = junction.tangents.position, junction.tangents.normal
        held = self.contact_arc[before] | self.contact_arc[after]
        ends = contacts.osculating | held
        radius = contacts.radius.copy()
        for arc in (before, after):
            rows = self.contact_arc[arc]
            radius[rows] = sites.radius[arc[rows]]
        centre = position + radius[:, None] * mean
        for arc in (before, after):
            rows = self.contact_arc[arc]
            centre[rows] = sites.anchor[arc[rows]]
        vertex = self._new_vertices(len(before))
        first, last = self._sides(contacts.partner, contacts.parameter, centre)
        # Seen from an end, the two sites face each other; a contact arc faces itself.
        left = np.where(ends, self._beyond(after, sites.following), last)
        right = np.where(ends, self._beyond(before, sites.preceding), first)
        left = np.where(self.contact_arc[before], WHOLE, left)
        right = np.where(self.contact_arc[after], WHOLE, right)
        both_low, both_high = sites.low[after], sites.high[before]
        mine = np.ones(len(before), dtype=bool)
        one = Tangents(position, junction.normal, before, both_high)
        two = Tangents(junction.other_position, junction.other_normal, after, both_low)
        # Beside a contact arc the disk is known from the site across the arc.
        known = np.where(ends, np.nan, contacts.parameter)
        smooth = ends & ~held
        facing = np.where(ends, left, contacts.partner)
        disk = self._side_disks(np.where(smooth, -1, facing), known, one, radius, centre)
        facing = np.where(ends, right, contacts.partner)
        other = self._side_disks(np.where(smooth, -1, facing), known, two, radius, centre)
        own = Nodes.join(
            Nodes(
                before, both_high, disk[1], left, left,
                np.where(ends, both_low, contacts.parameter), vertex, disk[0], mine,
            ),
            Nodes(
                after, both_low, other[1], right, right,
                np.where(ends, both_high, contacts.parameter), vertex, other[0], mine,
            ),
        )  # fmt: skip
        seen = ~ends
        image = Nodes(
            contacts.partner, contacts.parameter, radius, after, before,
            np.full(len(before), np.nan), vertex, centre, ~mine,
        ).take(seen)  # fmt: skip
        image = self._snap_to_ends(image)
        return Nodes.join(own, image)

    def _side_disks(
        self,
        partner: IntArray,
        hint: FloatArray,
        tangents: Tangents,
        radius: FloatArray,
        centre: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """The disk of a junction as one of its sides sees it: they differ where it has a kink."""
        toward = tangents.position + radius[:, None] * tangents.normal - centre
        kinked = largest(toward) > 1e-14 * self.sites.size
        rows = (kinked & (partner >= 0)).nonzero()[0]
        centre, radius = centre.copy(), radius.copy()
        if len(rows):
            _, own = contact(self.sites, tangents.take(rows), partner[rows], hint[rows])
            use = np.isfinite(own) & (np.abs(own - radius[rows]) <= 1e-3 * radius[rows])
            rows, own = rows[use], own[use]
            radius[rows] = own
            centre[rows] = tangents.position[rows] + own[:, None] * tangents.normal[rows]
        return centre, radius

    def _beyond(self, site: IntArray, step: IntArray) -> IntArray:
        """First site from `site` on that is no contact arc."""
        for _ in range(len(self.sites)):
            held = self.contact_arc[site]
            if not held.any():
                break
            site = np.where(held, step[site], site)
        return site

    def _snap_to_ends(self, nodes: Nodes) -> Nodes:
        """Move contacts within the snap length of an end of their site onto it."""
        sites = self.sites
        speed = np.maximum(sites.speed(nodes.site, nodes.parameter, nodes.radius), 1e-300)
        parameter = nodes.parameter.copy()
        for end in (sites.low[nodes.site], sites.high[nodes.site]):
            near = np.abs(parameter - end) * speed <= self.snap
            parameter = np.where(near, end, parameter)
        return replace(nodes, parameter=parameter)

    def _sides(
        self, partner: IntArray, parameter: FloatArray, centre: FloatArray
    ) -> tuple[IntArray, IntArray]:
        """Partners just after and just before a node: they differ where its contact is a junction.

        Along the boundary the contact on the other side runs backwards: before the node the
        partner is the later of the two sites that meet there.
        """
        sites = self.sites
        safe = np.maximum(partner, 0)
        where = np.where(partner >= 0, parameter, sites.low[safe])
        delta = centre - sites.point(safe, where)
        speed = np.maximum(sites.speed(safe, where, np.hypot(delta[:, 0], delta[:, 1])), 1e-300)
        at_low = (np.abs(where - sites.low[safe]) * speed <= self.snap) & (partner >= 0)
        at_high = (np.abs(where - sites.high[safe]) * speed <= self.snap) & (partner >= 0)
        before, after = partner.copy(), partner.copy()
        # `after`: the partner after the node, i.e. the earlier site.
        low_ok = at_low & ~sites.corner_after[sites.preceding[safe]]
        high_ok = at_high & ~sites.corner_after[safe]
        after = np.where(low_ok, sites.preceding[safe], after)
        before = np.where(high_ok, sites.following[safe], before)
        return after, before

    def _samples(self, density: int) -> tuple[IntArray, FloatArray]:
        """Places inside the sites: curved ones show what their ends do not."""
        sites = self.sites
        count = np.full(len(sites), density - 1)
        curved = (sites.kind == SiteKind.SPIRAL) | (sites.kind == SiteKind.ARC)
        count[curved] = density
        count[self.contact_arc] = 0
        return sites.spread(count)

    def plain_nodes(
        self,
        site: IntArray,
        parameter: FloatArray,
        junctions: bool = False,
        rivals: Rivals | None = None,
    ) -> Nodes:
        """Nodes at boundary points, with their images on the partners.

        A node whose contact is a junction is an event; as that junction has a disk of its own, it
        is kept only where `junctions` asks for it.
        """
        position, normal, contacts = self._disks(site, parameter, rivals)
        return self._plain(Tangents(position, normal, site, parameter), contacts, junctions)

    def _plain(self, tangents: Tangents, contacts: Contacts, junctions: bool) -> Nodes:
        position, normal = tangents.position, tangents.normal
        site, parameter = tangents.site, tangents.parameter
        # No partner: the point lies within rounding of an end, which its site's ends carry.
        known = (contacts.partner >= 0).nonzero()[0]
        site, parameter = site.take(known), parameter.take(known)
        radius, partner = contacts.radius.take(known), contacts.partner.take(known)
        facing = contacts.parameter.take(known)
        normal = normal.take(known, axis=0)
        centre = position.take(known, axis=0) + radius[:, None] * normal
        after, before = self._sides(partner, facing, centre)
        plain = after == before
        none = np.full(len(site), -1, dtype=np.int64)
        inner = np.zeros(len(site), dtype=bool)
        own = Nodes(site, parameter, radius, partner, partner, facing, none, centre, inner)
        # Contacts on a contact arc belong to its disk.
        free = plain & ~self.contact_arc[partner]
        image = Nodes(partner, facing, radius, site, site, parameter, none, centre, inner)
        parts = [own.take(plain), image.take(free)]
        if junctions and not plain.all():
            event = replace(own, left=before, right=after, vertex=self._new_vertices(len(site)))
            parts.append(event.take(~plain))
        return Nodes.join(*parts)

    # -- refinement -------------------------------------------------------------------------------

    def resolve(self, rounds: int = 80) -> None:
        """Solve all changes of partner between neighbouring nodes, until none is left open.

        Only sites that got nodes in a round are looked at in the next: what is open is so between
        nodes of one site.
        """
        part = self.nodes
        for turn in range(rounds):
            part = self._sorted(part)
            rows = self._open(part)
            if not len(rows):
                break
            added = Nodes.join(*self._solve(part, rows, turn < _PATIENCE))
            self.nodes = Nodes.join(self.nodes, added)
            dirty = np.zeros(len(self.sites), dtype=bool)
            dirty[added.site] = True
            part = self.nodes.take(dirty[self.nodes.site])
        else:
            place = added.centre[0] + self.sites.origin
            raise GeometryError("the contacts of the boundary do not settle", place=tuple(place))
        self.nodes = self._sorted(self.nodes)

    def _sorted(self, nodes: Nodes) -> Nodes:
        """Order by site and parameter; own ends of a site come outermost among equals."""
        at_low = nodes.parameter <= self.sites.low[nodes.site]
        place = np.where(nodes.own, np.where(at_low, -np.inf, np.inf), nodes.parameter)
        return nodes.take(np.lexsort((place, nodes.site)))

    def _gaps(self, nodes: Nodes) -> tuple[IntArray, IntArray]:
        """Stretches between groups of nodes that are one point: row before each, and its partner.

        The nodes of a group stand in an order that rounding made: a stretch faces what some node
        before it says to come and some node after it says to have been; -1 where there is none.
        """
        speed = self.sites.speed(nodes.site[:-1], nodes.parameter[:-1], nodes.radius[:-1])
        gap = (nodes.parameter[1:] - nodes.parameter[:-1]) * speed
        wide = gap > self.snap
        # Contacts beside a curvature maximum are known to few digits, their disks to all.
        far = gap > self.cluster
        for column in (*nodes.centre.T, nodes.radius):
            far |= np.abs(column[1:] - column[:-1]) > self.cluster
        wide &= far
        same = nodes.site[1:] == nodes.site[:-1]
        rows = (same & wide).nonzero()[0]
        group = np.concatenate([[0], np.cumsum(~same | wide)])
        ahead = nodes.right.take(rows)
        label = np.where(ahead == nodes.left.take(rows + 1), ahead, -1)
        poor = ((label == -1) & (ahead >= 0)).nonzero()[0]
        if len(poor):
            number = np.full(int(group[-1]) + 2, -1, dtype=np.int64)
            number[group[rows[poor]]] = poor
            before = number[group]
            number[:] = -1
            number[group[rows[poor] + 1]] = poor
            after = number[group]
            count = len(self.sites) + 3
            left = ((before >= 0) & (nodes.right >= 0)).nonzero()[0]
            right = ((after >= 0) & (nodes.left >= 0)).nonzero()[0]
            common = np.intersect1d(
                before[left] * count + nodes.right[left], after[right] * count + nodes.left[right]
            )
            label[common // count] = common % count
        return rows, label

    def _open(self, nodes: Nodes) -> IntArray:
        """Rows after which the partner changes without an event."""
        rows, label = self._gaps(nodes)
        return np.asarray(rows[label == -1])

    def _solve(self, nodes: Nodes, rows: IntArray, patient: bool) -> list[Nodes]:
        """Events between nodes that disagree, or nodes on the sites that came to light there."""
        site = nodes.site[rows]
        one, other = nodes.right[rows], nodes.left[rows + 1]
        # A contact arc's disk is no rival of others: its neighbours' labels are exact.
        usable = (one >= 0) & (other >= 0)
        if not usable.all():
            bad = rows[~usable][0]
            place = nodes.centre[bad] + self.sites.origin
            raise GeometryError("a contact arc is interrupted", place=tuple(place))
        guess = self.branches.guess(nodes, rows, one, other)
        disks = self.branches.disks(guess)
        empty, third, where_third = self.branches.empty(guess.triple, disks)
        closed = disks.good & empty
        parts: list[Nodes] = []
        found, triple = [disks.take(closed)], [guess.triple[closed]]
        if patient:
            inner = (~closed & (third >= 0)).nonzero()[0]
            between = guess.through(inner, disks, third, where_third)
            both = self.branches.disks(between)
            good = both.good & (np.abs(both.determinant) > _SHARP)
            good &= self.branches.empty(between.triple, both)[0]
            found.append(both.take(good))
            triple.append(between.triple[good])
            closed[inner[good.nonzero()[0] % max(len(inner), 1)]] = True
        every = TripleDisks.join(*found)
        if len(every.radius):
            parts.append(self._branch_nodes(np.concatenate(triple), every))
        # Another site reaches in, or takes over where a contact leaves its own: look there; or
        # half way, where Newton's method went astray.
        rest = (~closed).nonzero()[0]
        if len(rest) and patient:
            start, end = nodes.parameter[rows], nodes.parameter[rows + 1]
            speed = self.sites.speed(site, disks.parameter[:, 0], disks.radius)
            # Next to a node, as next to the end of a site, disks are rounding.
            beside = np.minimum(disks.parameter[:, 0] - start, end - disks.parameter[:, 0])
            apart = disks.settled & (beside * speed > 100 * self.snap)
            where = np.where(apart, disks.parameter[:, 0], 0.5 * (start + end))[rest]
            rivals = Rivals(
                np.stack([one, other, third], axis=1),
                np.stack([nodes.facing[rows], nodes.facing[rows + 1], where_third], axis=1),
            )
            parts.append(self.plain_nodes(site[rest], where, True, rivals.take(rest)))
        elif len(rest):
            parts.extend(self._bracketed(nodes, rows[rest], one[rest], other[rest]))
        return parts

    def _branch_nodes(self, triple: IntArray, disks: TripleDisks) -> Nodes:
        """Events of branch points on all three of their sites, each branch point once."""
        centre, radius, parameter = disks.centre, disks.radius, disks.parameter
        ranked = np.sort(triple, axis=1)
        order = np.lexsort((*centre.T, *ranked.T))
        ranked, place = ranked.take(order, axis=0), centre.take(order, axis=0)
        differ = ranked[1:] != ranked[:-1]
        step = differ[:, 0] | differ[:, 1] | differ[:, 2]
        away = largest(place[1:] - place[:-1])
        head = np.concatenate([[True], step | (away > 1e-8 * self.sites.size)])
        chosen = order[head]
        triple, parameter = triple.take(chosen, axis=0), parameter.take(chosen, axis=0)
        centre, radius = centre.take(chosen, axis=0), radius.take(chosen)
        vertex = self._new_vertices(len(chosen))
        parts = []
        # Along its site each contact passes from one of the other two to the other.
        for mine, left, right in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            node = Nodes(
                triple[:, mine], parameter[:, mine], radius, triple[:, left], triple[:, right],
                parameter[:, left], vertex, centre, np.zeros(len(chosen), dtype=bool),
            )  # fmt: skip
            parts.append(node)
        joined = Nodes.join(*parts)
        return self._snap_to_ends(joined.take(~self.contact_arc[joined.site]))

    def _bracketed(
        self, nodes: Nodes, rows: IntArray, one: IntArray, other: IntArray
    ) -> list[Nodes]:
        """The same by bracketing, where Newton's method found no disk."""
        site = nodes.site[rows]
        parameter, radius, facing = crossing(self.sites, nodes, rows, one, other)
        position, normal, contacts = self._disks(site, parameter)
        known = contacts.partner >= 0
        third = known & (contacts.radius < radius - self.rounding)
        third &= (contacts.partner != one) & (contacts.partner != other)
        # Where neither partner is in reach, or the disk can grow, nothing crosses.
        third |= known & ~(contacts.radius <= radius * (1 + 1e-6))
        radius = np.where(np.isnan(radius), contacts.radius, radius)
        centre = position + radius[:, None] * normal
        # At a node itself there is nothing between: what differs is rounding.
        speed = self.sites.speed(site, parameter, radius)
        for node in (rows, rows + 1):
            at_node = np.abs(parameter - nodes.parameter[node]) * speed <= self.snap
            third &= ~at_node
            parameter = np.where(at_node, nodes.parameter[node], parameter)
            radius = np.where(at_node, nodes.radius[node], radius)
            centre = np.where(at_node[:, None], nodes.centre[node], centre)
        branch = ~third
        vertex = np.full(len(rows), -1, dtype=np.int64)
        vertex[branch] = self._new_vertices(int(branch.sum()))
        inner = np.zeros(len(rows), dtype=bool)
        events = Nodes(site, parameter, radius, one, other, facing, vertex, centre, inner)
        parts = [events.take(branch)]
        if third.any():
            parts.append(self.plain_nodes(site[third], parameter[third], junctions=True))
        return parts

    # -- intervals --------------------------------------------------------------------------------

    def intervals(self) -> Intervals:
        """Stretches between events; plain nodes have served."""
        nodes = self.nodes
        rows, label = self._gaps(nodes)
        # Group k of a site ends at row `rows` of its stretch or at the end of the site.
        last = np.ones(len(nodes), dtype=bool)
        last[:-1] = nodes.site[1:] != nodes.site[:-1]
        last[rows] = True
        group = np.concatenate([[0], np.cumsum(last[:-1])])
        event = np.zeros(int(group[-1]) + 1, dtype=bool)
        event[group[nodes.vertex >= 0]] = True
        before, after = group[rows], group[rows] + 1
        facing = np.full(len(event), -3, dtype=np.int64)
        facing[after] = label
        # Two plain nodes at one point that see different sites are an event.
        silent = before[(facing[before] != label) & ~event[before]]
        if len(silent):
            vertex = nodes.vertex.copy()
            vertex[np.searchsorted(group, silent)] = self._new_vertices(len(silent))
            nodes = self.nodes = replace(nodes, vertex=vertex)
            event[silent] = True
        holder = np.full(len(event), -1, dtype=np.int64)
        known = (nodes.vertex >= 0).nonzero()[0]
        holder[group[known[::-1]]] = known[::-1]
        # From every event group to the next one of its site.
        start = event[before].nonzero()[0]
        stop = event[after].nonzero()[0]
        first, last_node = holder[before[start]], holder[after[stop]]
        return Intervals(
            site=nodes.site[first],
            start=nodes.parameter[first],
            end=nodes.parameter[last_node],
            partner=label[start],
            first=nodes.vertex[first],
            last=nodes.vertex[last_node],
            first_node=first,
            last_node=last_node,
            group=group,
        )
