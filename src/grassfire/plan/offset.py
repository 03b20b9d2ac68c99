"""Contour-parallel clearing: rings inside out, entered at every lobe, linked where cleared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from grassfire.medial import MedialAxis
from grassfire.plan import entry, link
from grassfire.plan.link import Facing, Front, Interior, RingPlace, RingSet
from grassfire.plan.path import Path
from grassfire.plan.places import BoolArray
from grassfire.plan.rings import (
    MOST_CUT_OFF,
    MOST_SPACING,
    Component,
    components,
    ring_distances,
)
from grassfire.plan.roadmap import Leg, RoadMap
from grassfire.plan.strategy import SMALLEST_RING, ClearingSettings, PocketPlan, needs_plunge
from grassfire.plan.strokes import Stroke, StrokeKind
from grassfire.plan.wallpass import wall_pass
from grassfire.report import Finding, Severity
from grassfire.toolpath import FloatArray, Role

AIR = 0.4
"""What a length counts that is travelled at the feed of links, where that is higher."""

MAP_STEP = 0.6
"""Distance between places of the road map as a part of the tool radius."""

MOST_WAYS = 2
"""Ways that are laid out before the best is taken."""

NEIGHBOURS = 3
"""Rings among which the next one is chosen."""


@dataclass
class _Frame:
    """A component on the way from the pocket to the lobe that is cut, and its children to do."""

    index: int
    children: list[int]


@dataclass(frozen=True)
class _Route:
    """Legs from a ring just cut, and the place on the next ring to which a straight way leads.

    `length` is that of all, legs in air counted by what they take, mm.
    """

    legs: tuple[Leg, ...]
    place: RingPlace
    length: float


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
    road = RoadMap(axis, settings.wall, MAP_STEP * settings.tool_radius)
    pockets: list[PocketPlan] = []
    for index, part in enumerate(parts):
        if part.level > 0:
            continue
        point = not part.children and max(ring.extent for ring in part.rings) < SMALLEST_RING
        if settings.entry != "plunge" and point:
            findings.append(needs_plunge(part.peak, part.peak_radius))
        else:
            pockets.append(OffsetPocket(axis, parts, index, settings, spacing, road))
    return pockets, findings


class OffsetPocket:
    """One pocket cleared by rings; `peak`, `strokes` and `finish` as in `PocketPlan`.

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
    road : RoadMap
        Of the region.
    """

    def __init__(
        self,
        axis: MedialAxis,
        parts: Sequence[Component],
        root: int,
        settings: ClearingSettings,
        spacing: float,
        road: RoadMap,
    ) -> None:
        self._axis = axis
        self._root = root
        self._road = road
        self._interiors: dict[int, Interior] = {}
        self._places: dict[int, BoolArray] = {}
        self._wide_places: dict[int, BoolArray] = {}
        self._fronts: dict[int, Front] = {}
        self._faced: dict[int, dict[int, Facing]] = {}
        self._done: int | None = None
        self._cut: list[tuple[int, Path]] = []
        self._parent = {child: index for index, part in enumerate(parts) for child in part.children}
        self._parts = parts
        self._settings = settings
        self._spacing = spacing
        self._wall = self._inside(root)
        self.peak = parts[root].peak
        self.strokes: list[Stroke] = []
        self.finish: list[Stroke] = []
        self.findings: list[Finding] = []

    def plan(self, position: FloatArray) -> FloatArray:
        """Visit all components, inner ones first; returns where the last stroke ends, mm."""
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
        settings = self._settings
        if settings.finish:
            self.finish = wall_pass(self._axis, wall.rings, settings, position, self._over_floor)
            position = self.finish[-1].path.end
        self._mark_travels()
        return position

    def _inside(self, index: int) -> Interior:
        """A component, its rings included."""
        if index not in self._interiors:
            part = self._parts[index]
            self._interiors[index] = Interior(self._axis, part.rings, part.distance)
        return self._interiors[index]

    def _on_map(self, index: int) -> BoolArray:
        """Places of the road map strictly inside a component."""
        if index not in self._places:
            part = self._parts[index]
            # off the rings and the corners that were rounded: all places lie strictly inside
            margin = max(self._cut_off(part), 0.05 * self._settings.tool_radius)
            wall = part.distance + min(margin, (part.peak_radius - part.distance) / 2)
            self._places[index] = self._road.component(wall, part.peak)
        return self._places[index]

    def _around_map(self, index: int) -> BoolArray:
        """Places of the road map in a component, its rings and sharp corners included."""
        if index not in self._wide_places:
            part = self._parts[index]
            self._wide_places[index] = self._road.component(part.distance, part.peak)
        return self._wide_places[index]

    def _clear(self, index: int, position: FloatArray) -> FloatArray:
        """Cut the rings of a component whose children are cut; returns where the tool is."""
        part = self._parts[index]
        rings = RingSet(part.rings)
        wall = part.level == 0
        if part.children:
            # straight outwards: the disk about the tool that touches the ring holds no other
            last = self._cross(rings, rings.nearest_left(position)[0], position, None, wall)
        elif self._done is not None and self._pass_into(index, position):
            last = self._cross(rings, rings.nearest_left(part.peak)[0], part.peak, None, wall)
        else:
            last = self._enter(part, rings, position)
        while rings.left.any():
            self._cut.append((index, last))
            last = self._next(index, rings, last)
        self._cut.append((index, last))
        self._road.clear(self._on_map(index), part.distance + self._cut_off(part))
        self._done = index
        return last.end

    def _cut_off(self, part: Component) -> float:
        """How far a corner of the rings may be from where the offset has it, mm."""
        return MOST_CUT_OFF * self._settings.tool_radius if part.level else 0.0

    def _pass_into(self, index: int, position: FloatArray) -> bool:
        """Go from the component just cleared to the middle of one without rings inside it.

        Through cleared area and then along the axis, in a slot at the feed of entries, if that
        is no longer than the descent which it saves.
        """
        source = self._done
        assert source is not None
        common = index
        while not self._within(source, common):
            common = self._parent[common]
        way = self._road.passage(
            position,
            self._parts[index].peak,
            (self._inside(source), self._inside(common)),
            self._on_map(source),
            self._around_map(common),
        )
        settings = self._settings
        if way is None or way.stock > settings.drop / np.tan(settings.slope):
            return False
        self._road.travel(way)
        for leg in way.legs:
            self._feed(leg.path, Role.LINK if leg.air else Role.ENTRY, leg.air)
        return True

    def _enter(self, part: Component, rings: RingSet, position: FloatArray) -> Path:
        """Begin where nothing is cleared yet; returns the first ring, cut."""
        settings = self._settings
        place = rings.nearest_left(part.peak)[0]
        if settings.entry == "plunge":
            self._descend(entry.plunge(place.nearest.point))
            return self._cross(rings, place, place.nearest.point, None, part.level == 0)
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
        around = self._around(part)
        if radius is not None and around is not None:
            radius = max(radius, around)
        if radius is None:
            return self._ramp(rings, longest, position, part.level == 0)
        outwards = place.nearest.point - part.peak
        size = np.hypot(*outwards)
        unit = outwards / size if size > 0 else np.array([1.0, 0.0])
        start = part.peak + radius * unit
        turn = 1 if settings.climb else -1
        way = entry.helix(part.peak, start, settings.drop, settings.slope, turn)
        self._descend(way.down)
        self._feed(way.flat, Role.ENTRY)
        if around is not None:
            rings.left[:] = False
            return way.flat
        # along the radius through the helix, so that the way keeps inside the disk
        return self._cross(rings, place, start, None, part.level == 0)

    def _around(self, part: Component) -> float | None:
        """Radius of a helix whose last turn clears what the only ring of a component would."""
        if len(part.rings) > 1 or part.level == 0:
            return None
        points = part.rings[0].sampled[0]
        reach = float(np.max(np.hypot(*(points - part.peak).T)))
        room = part.peak_radius - self._settings.wall
        return reach if reach <= min(entry.NO_CORE * self._settings.tool_radius, room) else None

    def _ramp(self, rings: RingSet, ring: int, near: FloatArray, wall: bool) -> Path:
        """Descend along a ring from its place nearest to `near`, cut it from where that ends."""
        path = rings.rings[ring]
        path = path.started_at(path.nearest(near).along)
        down, along = entry.ramp(path, self._settings.drop, self._settings.slope)
        self._descend(down)
        lap = path.started_at(along, snap=1e-9)
        rings.left[ring] = False
        self._feed(lap, Role.CUT, wall=wall)
        return lap

    def _descend(self, down: Path) -> None:
        self.strokes.append(Stroke(StrokeKind.DESCEND, down, Role.ENTRY))

    def _feed(self, path: Path, role: Role, air: bool = False, wall: bool = False) -> None:
        self.strokes.append(Stroke(StrokeKind.FEED, path, role, air, wall))

    def _cross(
        self,
        rings: RingSet,
        place: RingPlace,
        position: FloatArray,
        cleared: float | None,
        wall: bool,
    ) -> Path:
        """Straight to a place on a ring, then round it; returns the ring as cut.

        `cleared` is the clearance from which on the area is known to be cleared.
        """
        lap = rings.rings[place.ring].started_at(place.nearest.along)
        way = link.straight(position, lap.start)
        if way is not None:
            self._link(way, cleared)
        rings.left[place.ring] = False
        self._feed(lap, Role.CUT, wall=wall)
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

    def _next(self, index: int, rings: RingSet, last: Path) -> Path:
        """From a ring just cut to the next one of the same component."""
        part, inside = self._parts[index], self._inside(index)
        wall = part.level == 0
        cleared = None
        if part.children:
            cleared = max(part.distance + self._spacing, part.dropped)
            cleared += MOST_CUT_OFF * self._settings.tool_radius
        found = self._route(rings, inside, last)
        if part.children and (found is None or found.length > 2 * self._spacing):
            least = np.inf if found is None else found.length
            found = self._detour(index, rings, last, least) or found
        if found is not None:
            for leg in found.legs:
                self._feed(leg.path, Role.LINK, leg.air)
            start = found.legs[-1].path.end if found.legs else last.end
            return self._cross(rings, found.place, start, cleared, wall)
        ring = rings.nearest_left(last.end)[0].ring
        goal = np.mean(rings.rings[ring].points, axis=0)
        lap = self._hop(rings, inside, index, goal, cleared)
        return self._ramp(rings, ring, last.end, wall) if lap is None else lap

    def _facing(self, index: int, rings: RingSet, chosen: Sequence[int]) -> list[Facing]:
        """Places of chosen rings of a component that face those of the components inside it."""
        known = self._faced.setdefault(index, {})
        missing = [ring for ring in chosen if ring not in known]
        found = self._fronts[index].facing(
            [rings.rings[ring] for ring in missing], self._inside(index)
        )
        known.update(zip(missing, found, strict=True))
        return [known[ring] for ring in chosen]

    def _detour(self, index: int, rings: RingSet, last: Path, most: float) -> _Route | None:
        """Back to a ring of a component inside, along a way in that, and out to a ring left.

        None where that is not shorter than `most`, or so long that a retract is quicker.
        """
        if index not in self._fronts:
            kept = self._parts[index].children
            self._fronts[index] = Front(
                [(child, ring) for child in kept for ring in self._parts[child].rings]
            )
        exits = self._fronts[index].near(last.end, self._inside(index))
        if not exits:
            return None
        options = []
        share = AIR if self._settings.fast_links else 1.0
        chosen_rings = [place.ring for place in rings.nearest_left(last.end, NEIGHBOURS)]
        facing = self._facing(index, rings, chosen_rings)
        for ring, pairs in zip(chosen_rings, facing, strict=True):
            for child, point, gap in exits:
                inner = np.hypot(*(pairs.starts - point).T)
                straight = inner + pairs.distance + gap
                straight[pairs.from_owner != child] = np.inf
                if len(straight) and np.isfinite(straight.min()):
                    chosen = int(np.argmin(straight))
                    floor = float(share * inner[chosen] + pairs.distance[chosen] + gap)
                    key = (float(straight[chosen]), ring, child)
                    options.append((key, floor, point, pairs, chosen))
        best: _Route | None = None
        options.sort(key=lambda option: option[0])
        for (_, ring, child), floor, point, pairs, chosen in options[:MOST_WAYS]:
            place = RingPlace(ring, pairs.target(chosen))
            longest = self._longest(place.nearest.point, last.end)
            # no way is shorter than the straight one
            if floor >= most or floor > longest:
                continue
            legs = self._inner_way(child, last.end, point, pairs.starts[chosen])
            if legs is None:
                continue
            length = sum(self._worth(leg) for leg in legs) + place.nearest.distance
            if length < most and length <= longest:
                best, most = _Route(legs, place, length), length
        return best

    def _worth(self, leg: Leg) -> float:
        """Length of a leg as if it were travelled at the feed of cuts, mm."""
        return leg.path.length * (AIR if leg.air and self._settings.fast_links else 1.0)

    def _inner_way(
        self, child: int, start: FloatArray, point: FloatArray, end: FloatArray
    ) -> tuple[Leg, ...] | None:
        """From `start` straight to `point` on a ring of a cleared component, on to `end` there."""
        first = link.straight(start, point)
        legs: tuple[Leg, ...] = () if first is None else (Leg(first, False),)
        if link.straight(point, end) is None:
            return legs
        way = self._road.way(point, end, self._inside(child), self._on_map(child))
        return None if way is None else (*legs, Leg(way, True))

    def _longest(self, start: FloatArray, end: FloatArray) -> float:
        """How far a link at the floor may go before a retract is quicker, mm."""
        travel = float(np.hypot(*(end - start)))
        return self._settings.longest_walk + self._settings.link_speed * travel

    def _route(self, rings: RingSet, inside: Interior, last: Path) -> _Route | None:
        """A way from a ring just cut to one that is left, at the floor.

        Straight to one of the nearest, or first back along the ring just cut to where another is
        near, if that is not so long that a retract is quicker.
        """
        places = rings.nearest_left(last.end, NEIGHBOURS)
        starts = np.repeat(last.end[None], len(places), axis=0)
        ends = np.array([place.nearest.point for place in places])
        for place, good in zip(places, inside.holds(starts, ends), strict=True):
            gap = place.nearest.distance
            if good and gap <= self._longest(last.end, place.nearest.point):
                return _Route((), place, gap)
        pairs = [link.crossings(last, rings.rings[place.ring]) for place in places]
        counts = [len(item.distance) for item in pairs]
        total = np.concatenate(
            [link.walked(last, item.from_along) + item.distance for item in pairs]
        )
        targets = np.concatenate([item.ends for item in pairs])
        travel = np.hypot(*(targets - last.end).T)
        good = total <= self._settings.longest_walk + self._settings.link_speed * travel
        if good.any():
            good[good] = inside.holds(
                np.concatenate([item.starts for item in pairs])[good], targets[good]
            )
        if not good.any():
            return None
        chosen = int(np.argmin(np.where(good, total, np.inf)))
        length = float(total[chosen])
        which = int(np.searchsorted(np.cumsum(counts), chosen, side="right"))
        chosen -= sum(counts[:which])
        walk = link.walk(last, float(pairs[which].from_along[chosen]))
        legs: tuple[Leg, ...] = () if walk is None else (Leg(walk, True),)
        if walk is not None:
            length += self._worth(legs[0]) - walk.length
        return _Route(legs, RingPlace(places[which].ring, pairs[which].target(chosen)), length)

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
                place = RingPlace(ring, pairs.target(chosen))
                wall = self._parts[outer].level == 0
                return self._cross(rings, place, landing.end, cleared, wall)
        return None

    def _within(self, index: int, outer: int) -> bool:
        """Whether one component is another or lies inside it."""
        while index != outer and index in self._parent:
            index = self._parent[index]
        return index == outer

    def _over_floor(self, start: FloatArray, end: FloatArray) -> Path | None:
        """A way over the last floor, all of which is cleared; None where a retract is quicker."""
        way = self._road.way(start, end, self._wall, self._on_map(self._root))
        return way if way is not None and way.length <= self._longest(start, end) else None

    def _mark_travels(self) -> None:
        """Ways to descents that lie where the pass before has cleared."""
        places = self._on_map(self._root)
        for index, stroke in enumerate(self.strokes):
            if stroke.kind is not StrokeKind.DESCEND:
                continue
            start, end = self.strokes[index - 1].path.end, stroke.path.start
            way = None
            if link.straight(start, end) is not None:
                way = self._road.way(start, end, self._wall, places)
            here = link.straight(start, end) is None
            self.strokes[index] = replace(stroke, air=here, approach=way)
