"""Contour-parallel clearing: rings inside out, entered at every lobe, linked where cleared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grassfire.medial import MedialAxis
from grassfire.plan import entry, link
from grassfire.plan.link import Crossings, Interior, RingPlace, RingSet
from grassfire.plan.path import Nearest, Path
from grassfire.plan.rings import MOST_SPACING, Component, components, ring_distances
from grassfire.plan.strategy import SMALLEST_RING, ClearingSettings, PocketPlan, needs_plunge
from grassfire.plan.strokes import Stroke, StrokeKind
from grassfire.report import Finding, Severity
from grassfire.toolpath import FloatArray, Role

PROOF = 1e-3
"""Clearance that a straight way may lack, mm: below what the rings themselves may deviate."""


@dataclass
class _Frame:
    """A component on the way from the pocket to the lobe that is cut, and its children to do."""

    index: int
    children: list[int]


def _place(ring: int, pairs: Crossings, chosen: int) -> RingPlace:
    """The far end of a crossing."""
    nearest = Nearest(
        float(pairs.to_along[chosen]), pairs.ends[chosen], float(pairs.distance[chosen])
    )
    return RingPlace(ring, nearest)


def offset_pockets(
    axis: MedialAxis, settings: ClearingSettings
) -> tuple[list[PocketPlan], list[Finding]]:
    """All pockets of a region, to be cleared by rings; and what was noticed."""
    findings: list[Finding] = []
    spacing = min(settings.stepover, MOST_SPACING * settings.tool_radius)
    if settings.stepover > max(spacing, settings.tool_radius) + 1e-12:
        findings.append(
            Finding(
                Severity.WARNING,
                "stepover-bounded",
                f"a stepover of {settings.stepover:.6g} mm could leave stock where rings meet in "
                f"corners; rings are {spacing:.6g} mm apart",
                size=spacing,
            )
        )
    parts = components(
        axis,
        ring_distances(settings.wall, spacing, float(axis.largest_disk()[1])),
        spacing,
        settings.tool_radius,
        settings.tolerance,
        settings.climb,
    )
    pockets: list[PocketPlan] = []
    for index, part in enumerate(parts):
        if part.level > 0:
            continue
        point = not part.children and max(ring.extent for ring in part.rings) < SMALLEST_RING
        if settings.entry != "plunge" and point:
            findings.append(needs_plunge(part.peak, part.peak_radius))
        else:
            pockets.append(OffsetPocket(axis, parts, index, settings, spacing))
    return pockets, findings


class OffsetPocket:
    """Strokes of one pocket, the same for every depth, and those that finish it.

    Parameters
    ----------
    axis : MedialAxis
    parts : sequence of Component
        All components of the region.
    root : int
        The component of the wall level that is the pocket.
    settings : ClearingSettings
    spacing : float
        Distance between rings, mm.

    Attributes
    ----------
    strokes, finish : list of Stroke
        For every pass; after the last one.
    """

    def __init__(
        self,
        axis: MedialAxis,
        parts: Sequence[Component],
        root: int,
        settings: ClearingSettings,
        spacing: float,
    ) -> None:
        self._axis = axis
        self._root = root
        self._wall = Interior(axis, parts[root].rings, parts[root].distance)
        self._cut: list[tuple[int, Path]] = []
        self._parent = {child: index for index, part in enumerate(parts) for child in part.children}
        self._parts = parts
        self._settings = settings
        self._spacing = spacing
        self.peak = parts[root].peak
        self.strokes: list[Stroke] = []
        self.finish: list[Stroke] = []

    def plan(self, position: FloatArray) -> FloatArray:
        """Visit all components, inner ones first, from `position` (2,) on.

        Returns
        -------
        (2,) float array
            Where the last stroke ends, mm.
        """
        wall = self._parts[self._root]
        pending = [_Frame(self._root, list(wall.children))]
        while pending:
            frame = pending[-1]
            if frame.children:
                gaps = [np.hypot(*(self._parts[it].peak - position)) for it in frame.children]
                child = frame.children.pop(int(np.argmin(gaps)))
                pending.append(_Frame(child, list(self._parts[child].children)))
                continue
            pending.pop()
            position = self._clear(frame.index, position)
        if self._settings.finish:
            position = self._finish(wall, position)
        self._mark_travels()
        return position

    def _clear(self, index: int, position: FloatArray) -> FloatArray:
        """Cut the rings of a component whose children are cut; returns where the tool is."""
        part = self._parts[index]
        rings = RingSet(part.rings)
        if part.children:
            # straight outwards: the disk about the tool that touches the ring holds no other
            last = self._cross(rings, rings.nearest_left(position)[0], position, None)
        else:
            last = self._enter(part, rings, position)
        inside = Interior(self._axis, part.rings, part.distance)
        while rings.left.any():
            self._cut.append((index, last))
            last = self._next(index, rings, inside, last)
        self._cut.append((index, last))
        return last.end

    def _enter(self, part: Component, rings: RingSet, position: FloatArray) -> Path:
        """Begin where nothing is cleared yet; returns the first ring, cut."""
        settings = self._settings
        place = rings.nearest_left(part.peak)[0]
        if settings.entry == "plunge":
            self._descend(entry.plunge(place.nearest.point))
            return self._cross(rings, place, place.nearest.point, None)
        longest = int(np.argmax([ring.length for ring in part.rings]))
        radius = None
        # down a ring shorter than the smallest helix a ramp would take laps without end
        small = part.rings[longest].length < entry.smallest_lap(settings.tool_radius)
        if settings.entry == "helix" or small:
            radius = entry.helix_radius(
                part.peak_radius,
                part.distance,
                settings.wall,
                settings.tool_radius,
                part.rings[longest].length,
            )
        if radius is None:
            return self._ramp(rings, longest, position)
        outwards = place.nearest.point - part.peak
        size = np.hypot(*outwards)
        unit = outwards / size if size > 0 else np.array([1.0, 0.0])
        start = part.peak + radius * unit
        turn = 1 if settings.climb else -1
        way = entry.helix(part.peak, start, settings.drop, settings.slope, turn)
        self._descend(way.down)
        self._feed(way.flat, Role.ENTRY)
        # along the radius through the helix, so that the way keeps inside the disk
        return self._cross(rings, place, start, None)

    def _ramp(self, rings: RingSet, ring: int, near: FloatArray) -> Path:
        """Descend along a ring from its place nearest to `near`, cut it from where that ends."""
        path = rings.rings[ring]
        path = path.started_at(path.nearest(near).along)
        down, along = entry.ramp(path, self._settings.drop, self._settings.slope)
        self._descend(down)
        lap = path.started_at(along, snap=1e-9)
        rings.left[ring] = False
        self._feed(lap, Role.CUT)
        return lap

    def _descend(self, down: Path) -> None:
        self.strokes.append(Stroke(StrokeKind.DESCEND, down, Role.ENTRY))

    def _feed(self, path: Path, role: Role, air: bool = False) -> None:
        self.strokes.append(Stroke(StrokeKind.FEED, path, role, air))

    def _cross(
        self, rings: RingSet, place: RingPlace, position: FloatArray, cleared: float | None
    ) -> Path:
        """Straight to a place on a ring, then round it; returns the ring as cut.

        `cleared` is the clearance from which on the area is known to be cleared.
        """
        lap = rings.rings[place.ring].started_at(place.nearest.along)
        way = link.straight(position, lap.start)
        if way is not None:
            self._link(way, cleared)
        rings.left[place.ring] = False
        self._feed(lap, Role.CUT)
        return lap

    def _link(self, way: Path, cleared: float | None) -> None:
        """A link at the floor; its middle at link feed if that is proven to lie in cleared area."""
        margin = 1.5 * self._spacing
        if self._settings.fast_links and cleared is not None and way.length > 4 * margin:
            middle = way.slice(margin, way.length - margin)
            if link.paths_clear(self._axis, [middle], cleared, 0.0)[0]:
                self._feed(way.slice(0.0, margin), Role.LINK)
                self._feed(middle, Role.LINK, air=True)
                self._feed(way.slice(way.length - margin, way.length), Role.LINK)
                return
        self._feed(way, Role.LINK)

    def _next(self, index: int, rings: RingSet, inside: Interior, last: Path) -> Path:
        """From a ring just cut to the next one of the same component."""
        part = self._parts[index]
        cleared = part.distance + self._spacing if part.children else None
        found = self._route(rings, inside, last, self._settings.longest_walk)
        if found is not None:
            return self._follow(rings, last, found, cleared)
        ring = rings.nearest_left(last.end)[0].ring
        goal = np.mean(rings.rings[ring].points, axis=0)
        lap = self._hop(rings, inside, index, goal, cleared)
        return self._ramp(rings, ring, last.end) if lap is None else lap

    def _route(
        self, rings: RingSet, inside: Interior, last: Path, longest: float
    ) -> tuple[Path | None, RingPlace] | None:
        """A way from a ring just cut to one that is left, at the floor.

        Straight to one of the nearest, or first back along the ring just cut to where another is
        near, if that is no longer than `longest` mm.
        """
        places = rings.nearest_left(last.end, 3)
        starts = np.repeat(last.end[None], len(places), axis=0)
        ends = np.array([place.nearest.point for place in places])
        for place, good in zip(places, inside.holds(starts, ends), strict=True):
            if good and place.nearest.distance <= longest:
                return None, place
        pairs = [link.crossings(last, rings.rings[place.ring]) for place in places]
        counts = [len(item.distance) for item in pairs]
        total = np.concatenate(
            [link.walked(last, item.from_along) + item.distance for item in pairs]
        )
        good = total <= longest
        if good.any():
            good[good] = inside.holds(
                np.concatenate([item.starts for item in pairs])[good],
                np.concatenate([item.ends for item in pairs])[good],
            )
        if not good.any():
            return None
        chosen = int(np.argmin(np.where(good, total, np.inf)))
        which = int(np.searchsorted(np.cumsum(counts), chosen, side="right"))
        chosen -= sum(counts[:which])
        walk = link.walk(last, float(pairs[which].from_along[chosen]))
        return walk, _place(places[which].ring, pairs[which], chosen)

    def _follow(
        self,
        rings: RingSet,
        last: Path,
        found: tuple[Path | None, RingPlace],
        cleared: float | None,
    ) -> Path:
        """Take a route and cut the ring that it leads to."""
        walk, place = found
        if walk is None:
            return self._cross(rings, place, last.end, cleared)
        self._feed(walk, Role.LINK, air=True)
        return self._cross(rings, place, walk.end, cleared)

    def _hop(
        self,
        rings: RingSet,
        inside: Interior,
        outer: int,
        goal: FloatArray,
        cleared: float | None,
    ) -> Path | None:
        """Retract and come down on a ring already cut, from where a straight way leads on.

        Parameters
        ----------
        rings : RingSet
            Where to; the one nearest to `goal` that is left is taken.
        inside, outer : Interior, int
            Component that the way must stay in, and its index: only rings cut inside it serve.
        """
        cut = [path for owner, path in self._cut if self._within(owner, outer)]
        if not cut:
            return None
        ring = rings.nearest_left(goal)[0].ring
        for source in RingSet(cut).nearest_left(goal, 4):
            pairs = link.crossings(cut[source.ring], rings.rings[ring])
            good = inside.holds(pairs.starts, pairs.ends)
            if good.any():
                chosen = int(np.argmin(np.where(good, pairs.distance, np.inf)))
                landing = entry.plunge(pairs.starts[chosen])
                self.strokes.append(Stroke(StrokeKind.HOP, landing, Role.LINK))
                return self._cross(rings, _place(ring, pairs, chosen), landing.end, cleared)
        return None

    def _within(self, index: int, outer: int) -> bool:
        """Whether one component is another or lies inside it."""
        while index != outer and index in self._parent:
            index = self._parent[index]
        return index == outer

    def _finish(self, part: Component, position: FloatArray) -> FloatArray:
        """Every wall ring once more, with tangential arcs on and off where there is room."""
        rings = RingSet(part.rings)
        while rings.left.any():
            place = rings.nearest_left(position)[0]
            rings.left[place.ring] = False
            lap, lead_in, lead_out = self._with_leads(rings.rings[place.ring], place)
            start = lap.start if lead_in is None else lead_in.start
            self._approach(position, start)
            for path, role in ((lead_in, Role.LEAD), (lap, Role.FINISH), (lead_out, Role.LEAD)):
                if path is not None:
                    self.finish.append(Stroke(StrokeKind.FEED, path, role))
                    position = path.end
        return position

    def _approach(self, position: FloatArray, target: FloatArray) -> None:
        """To a place on the last floor, all of which is cleared."""
        way = link.straight(position, target)
        if way is None:
            return
        if self._wall.holds(position[None], target[None])[0]:
            self.finish.append(Stroke(StrokeKind.FEED, way, Role.LINK, air=True))
        else:
            self.finish.append(Stroke(StrokeKind.HOP, entry.plunge(target), Role.LINK))

    def _with_leads(self, ring: Path, place: RingPlace) -> tuple[Path, Path | None, Path | None]:
        """A ring from where a tangential lead fits, and quarter arcs on to it and off it.

        The circle of a lead of radius q that touches the ring at p has its centre q inwards; it
        keeps to the pocket exactly where the clearance of that centre is at least wall + q.
        """
        settings = self._settings
        by_length = np.argsort(-ring.lengths, kind="stable")[:6]
        middles = ring.cumulative[by_length] + ring.lengths[by_length] / 2
        alongs = np.concatenate([[place.nearest.along], middles])
        radii = settings.tool_radius * np.array([0.5, 0.25, 0.1])
        side = 1.0 if settings.climb else -1.0
        tangents = np.array([ring.tangent(along) for along in alongs])
        inwards = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1) * side
        points = ring.at(alongs)
        centres = points[None] + radii[:, None, None] * inwards[None]
        room = self._axis.clearance(centres.reshape(-1, 2)).reshape(len(radii), len(alongs))
        fits = np.argwhere(room >= settings.wall + radii[:, None] - PROOF)
        if not len(fits):
            return ring.started_at(place.nearest.along), None, None
        size, which = (int(value) for value in fits[0])
        lap = ring.started_at(float(alongs[which]), snap=1e-9)
        centre, reach = centres[size, which], radii[size] * tangents[which]
        turn = np.array([side * np.pi / 2])
        lead_in = Path(np.stack([centre - reach, lap.start]), centre[None], turn)
        lead_out = Path(np.stack([lap.start, centre + reach]), centre[None], turn)
        return lap, lead_in, lead_out

    def _mark_travels(self) -> None:
        """Prove which ways to a descent lie where the pass before has cleared."""
        descents = [
            index for index, stroke in enumerate(self.strokes) if stroke.kind is StrokeKind.DESCEND
        ]
        starts = np.array([self.strokes[index - 1].path.end for index in descents])
        ends = np.array([self.strokes[index].path.start for index in descents])
        clear = self._wall.holds(starts, ends)
        for index, good in zip(descents, clear, strict=True):
            stroke = self.strokes[index]
            self.strokes[index] = Stroke(stroke.kind, stroke.path, stroke.role, bool(good))
